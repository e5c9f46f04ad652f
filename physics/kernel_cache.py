"""Where compiled kernels are kept: in the user's cache, under a name that stands for all code that may be in them.

numba keeps a kernel for as long as its own file is as it was, but a kernel holds functions of other files as well: one of
these changed, it would go on with what was there before.
"""

import os
import shutil
import sys
import time
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

#: packages whose functions are in kernels
COMPILED = ("physics", "numerics", "mpm", "fem_reference", "rigid_block")
#: read by numba, and by processes that are started
VARIABLE = "NUMBA_CACHE_DIR"
#: seconds after which kernels that nobody asked for are given up
KEPT = 14 * 24 * 3600


def fingerprint(root: Path) -> str:
    """16 hexadecimal digits that change with any file of compiled packages under ``root``."""
    text = sha256()
    for file in sorted(path for package in COMPILED for path in (root / package).rglob("*.py")):
        text.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes())
    return text.hexdigest()[:16]


def user_cache() -> Path:
    """Folder of this program in the user's cache, as the system has it."""
    home = Path.home()
    places = {"win32": ("LOCALAPPDATA", home / "AppData/Local"), "darwin": ("", home / "Library/Caches")}
    variable, otherwise = places.get(sys.platform, ("XDG_CACHE_HOME", home / ".cache"))
    return Path(os.environ.get(variable) or otherwise) / "fracture-verify"


def keep_kernels() -> None:
    """Tell numba where to keep its kernels, unless the user has; where it cannot write they stay beside the code."""
    given = os.environ.get(VARIABLE)
    if given and Path(given).parent != user_cache():  # by the user, not by a process of ours that started this one
        return
    folder = user_cache() / fingerprint(Path(__file__).parents[1])
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        for other in folder.parent.iterdir():
            if time.time() - other.stat().st_mtime > KEPT:
                shutil.rmtree(other, ignore_errors=True)
        os.environ[VARIABLE] = str(folder)
        if numba := sys.modules.get("numba"):
            numba.config.CACHE_DIR = str(folder)
