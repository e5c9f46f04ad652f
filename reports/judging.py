"""The verdict page of a result from elsewhere."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from cases import Case, case_at
from verify.judging.foreign import DEFAULT_FOLDER, ForeignResult, Judgement, judge_foreign

from .report import write_report
from .style import page_name

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd


def judge(
    case: Case | str | Path,
    history: pd.DataFrame | Path | str,
    map: str = "",
    crack_path: np.ndarray | Path | str | None = None,
    *,
    tier: str | None = None,
    fields: Path | str | None = None,
    arrays: str = "",
    name: str = "",
    within: float | None = None,
    out: Path | str | None = None,
) -> Judgement:
    """Judge a result from elsewhere and write its page; nothing is solved.

    Parameters
    ----------
    case : a case, the name of one in the library, or the path of a case file.
    history : table, or CSV file, of force over displacement or of columns over time.
    map : its columns, units and signs as in `cases.mapping`: "u = U2, F = -2 * RF2 [N]".
    crack_path : array (n, 2) or CSV file x,y, from the start of the crack to its tip [case length unit].
    fields : VTU, PVD, VTK, XDMF or Exodus file, from which the crack path follows where none is given.
    arrays : which of its arrays are what, "damage = d, displacement = U"; found by their usual names without.
    tier : whose kept results it is held against; that of a case, "standard" of a name or path when not given.
    name : what it is called; the name of its file without.
    within : share that replaces the limits that the case sets on relative errors.
    out : folder of page, summary and run folders, ``reports/out/judged/<case>`` when not given.

    Raises
    ------
    UserError : a mistake in case, map or files, in one sentence.
    """
    loaded = case_at(case, tier)
    history = Path(history) if isinstance(history, str) else history
    crack_path = Path(crack_path) if isinstance(crack_path, str) else crack_path
    fields = None if fields is None else Path(fields)
    folder = Path(out) if out is not None else DEFAULT_FOLDER / loaded.name
    judged = judge_foreign(loaded, ForeignResult(history, map, crack_path, name, within, fields, arrays), folder)
    write_report(folder)
    return replace(judged, page=folder / "pages" / f"{page_name(loaded.name, loaded.tier)}.html")
