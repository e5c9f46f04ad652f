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

import re
from collections.abc import Callable
from pathlib import Path
from zlib import crc32

from cases.splits import SPLITS

Response = Callable[..., tuple]
_FOLDER = Path(__file__).parent
#: a file that takes its law from another one
_TAKEN = re.compile(r"^from physics\.splits\.(\w+) import response$", re.MULTILINE)


def _code_of(split: str) -> int:
    """Number of a law in kernels, from the text of its file, which is read and not imported: judging needs no numba.

    So a kernel that numba has kept from before a law came or was changed does not know the code, and runs no other law.
    """
    file = (_FOLDER / f"{split}.py").read_bytes()
    taken = _TAKEN.search(file.decode())
    return _code_of(taken[1]) if taken else crc32(file)


#: code of each split by its name; two splits of one law share it
SPLIT_CODES = {name: _code_of(name) for name in SPLITS}
