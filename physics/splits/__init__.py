"""Splits of the elastic energy into a part that drives fracture and one that does not (thesis 2.6.3), one law a file.

A file NAME.py makes the split NAME: cases may name it and all kernels run it. It holds one function, which numba puts
into the kernels,

    @njit(cache=True, inline="always")
    def response(g, exx, eyy, gxy, lam, mu): ...  # -> PointResponse

with stress and consistent tangent at one point in closed form: psi = g psi_plus + psi_minus, stress = d psi / d strain
(Eq. 2.50), tangent = d stress / d strain (Eq. 2.51). g is the degradation (Eq. 2.48), the strains are exx, eyy and the
engineering shear gxy; ``lam`` and ``mu`` are in-plane Lamé constants [stress], so that the split acts on in-plane strains
(d = 2 in Eq. 2.63).
"""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from zlib import crc32

from cases.splits import SPLITS

Response = Callable[..., tuple]


def code_of(response: Response) -> int:
    """Number of a law in kernels, from the text of its file.

    So a kernel that numba has kept from before a law came or was changed does not know the code, and runs no other law.
    """
    return crc32(Path(str(import_module(response.__module__).__file__)).read_bytes())


_RESPONSES: dict[str, Response] = {name: import_module(f"physics.splits.{name}").response for name in SPLITS}
#: code of each split by its name; two splits of one law share it
SPLIT_CODES = {name: code_of(response) for name, response in _RESPONSES.items()}
#: the laws by their codes
LAWS = {SPLIT_CODES[name]: response for name, response in _RESPONSES.items()}
