"""Running cases, judging results, comparing them; the command line.

>>> from verify import load_case, run, compare
>>> run(load_case("sen_tension", tier="quick"), "mpm").history  # doctest: +SKIP
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from cases import load_case
    from verify.judging.summary import compare
    from verify.runs.run_folder import RunFolder, RunFolderError
    from verify.runs.running import run

    judge: Callable[..., Any]

__all__ = ["RunFolder", "RunFolderError", "compare", "judge", "load_case", "run"]

_HOMES = {
    "RunFolder": "verify.runs.run_folder",
    "RunFolderError": "verify.runs.run_folder",
    "compare": "verify.judging.summary",
    "judge": "reports.judging",  # the page is drawn, which no other part of this package does
    "load_case": "cases",
    "run": "verify.runs.running",
}


def __getattr__(name: str) -> Any:
    """Import on first use: whoever needs only a curve should not wait for all libraries."""
    if name not in _HOMES:
        raise AttributeError(f"module 'verify' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
