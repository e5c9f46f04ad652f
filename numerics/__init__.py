"""What is true of any discretisation: staggered scheme, load increments, sparse patterns, linear solvers."""

import os
import re
from contextlib import suppress
from importlib import metadata
from pathlib import Path

import physics  # noqa: F401  says where kernels are kept

# Read by the libraries when they are loaded, thus set before any of them. Threads that wait must sleep: two that spin on
# processors that others use as well take many times the time of one. And MKL sums in an order that does not depend on the
# number of threads.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("KMP_BLOCKTIME", "0")
os.environ.setdefault("MKL_CBWR", "AUTO,STRICT")


def _tell_where_mkl_is() -> None:
    """By its package's list of files: pypardiso would search the whole environment for it, again for each solver."""
    with suppress(metadata.PackageNotFoundError):
        for file in metadata.files("mkl") or ():
            if re.fullmatch(r"(lib)?mkl_rt(\.\d+)?\.(so|dll|dylib)(\.\d+)?", file.name):
                os.environ.setdefault("PYPARDISO_MKL_RT", str(Path(str(file.locate())).resolve()))


_tell_where_mkl_is()
