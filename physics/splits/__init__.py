"""Splits of the elastic energy into a part that drives fracture and one that does not (thesis 2.6.3), one law a file.

A file NAME.py makes the split NAME: cases may name it and all kernels run it. It holds one function, which numba puts
into the kernels,

    @njit(cache=True)
    def response(g, exx, eyy, gxy, lam, mu): ...  # -> PointResponse

with stress and consistent tangent at one point in closed form: psi = g psi_plus + psi_minus, stress = d psi / d strain
(Eq. 2.50), tangent = d stress / d strain (Eq. 2.51). g is the degradation (Eq. 2.48), the strains are exx, eyy and the
engineering shear gxy; ``lam`` and ``mu`` are in-plane Lamé constants [stress], so that the split acts on in-plane strains
(d = 2 in Eq. 2.63).
"""

from collections.abc import Callable

from cases.splits import SPLITS

Response = Callable[..., tuple]
#: code of each split in kernels by its name
SPLIT_CODES = {name: number for number, name in enumerate(SPLITS)}
#: gamma of the star-convex split: the larger, the stronger under pressure
GAMMA = 5.0
