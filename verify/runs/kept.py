"""Results that are kept beside a case: history and crack path of a run as small CSV files that tell their provenance.

    results/<tier>/<run>.csv              lines "# key = value" in TOML, then fewer points of the history
    results/<tier>/<run>.crack_path.csv   x,y; only where something broke

So a result from elsewhere is judged, and curves are drawn, where nothing has been computed.
"""

from __future__ import annotations

import io
import itertools
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cases import Case, UserError, load_case
from cases.copies import toml_value
from cases.solvers import SOLVERS
from verify.metrics.curves import Curve, first_branch_end
from verify.runs.atomic import write_text
from verify.runs.run_folder import HISTORY_COLUMNS, RunFolder, run_path
from verify.runs.run_writer import write_run

RESULTS = "results"
#: how far a point that is left out may be from the line between those that are kept, over the range of its column
TOLERANCE = 1e-3
#: the same for what moves, whose energies swing
TOLERANCE_OF_MOTION = 1e-2
#: columns that are kept, besides those of moving bodies
COLUMNS = ("step", "time", "u", "F", "E_el", "E_frac", "E_kin", "W_ext", "c_min")
ENERGIES = ("E_el", "E_frac", "E_kin", "W_ext")
_CRACK_PATH = ".crack_path.csv"


class KeptError(UserError):
    """A kept result is damaged; its text is one sentence."""


@dataclass(frozen=True)
class Kept:
    """A kept result: provenance as in run.json, history with the columns of a run's, crack path (n, 2) [length]."""

    info: dict[str, Any]
    history: pd.DataFrame
    crack_path: np.ndarray

    def fits(self, case: Case) -> bool:
        """It is of the case as its file stands; the case has the changes of its run merged in."""
        return bool(self.info["stated_hash"] == case.hash(stated=True))


def main_runs(case: Case) -> list[str]:
    """The first run of each solver that is no sweep, which stand for the case."""
    first: dict[str, str] = {}
    for name, spec in case.run_specs().items():
        if not spec.sweep_values and not spec.foreign and not spec.expect_failure:
            first.setdefault(spec.solver, name)
    return [first[solver] for solver in SOLVERS if solver in first]


def _file(case: Case, run: str) -> Path:
    return case.kept_folder / RESULTS / case.tier / f"{run}.csv"


# ------------------------------------------------------------------------------------------------ writing


def reduced(history: pd.DataFrame, tolerance: float = TOLERANCE) -> pd.DataFrame:
    """The rows of a history between which all others lie on straight lines, within a share of each column's range.

    Ramer, Douglas and Peucker's rule in the space of `COLUMNS`, the energies over the largest range of one; further ones
    go along. The rows of the least and largest F are kept.
    """
    columns = [name for name in COLUMNS if name in history and name != "step"]
    spread = history[columns].max() - history[columns].min()
    energies = [name for name in columns if name in ENERGIES]
    spread[energies] = spread[energies].max()
    scaled = (history[columns] / spread.where(spread > 0.0, 1.0)).to_numpy(dtype=float)
    kept = {0, len(scaled) - 1, int(history["F"].argmax()), int(history["F"].argmin())}
    ends = sorted(kept)
    todo = list(itertools.pairwise(ends))
    while todo:
        first, last = todo.pop()
        place, distance = _farthest(scaled, first, last)
        if distance > tolerance:
            kept.add(place)
            todo += [(first, place), (place, last)]
    return history.iloc[sorted(kept)]


def _farthest(points: np.ndarray, first: int, last: int) -> tuple[int, float]:
    """Row between two others that is farthest from the line between them, and how far in its worst column."""
    if last - first < 2:
        return first, 0.0
    along, inner = points[last] - points[first], points[first + 1 : last] - points[first]
    length = along @ along
    share = np.clip(inner @ along / length, 0.0, 1.0) if length else np.zeros(len(inner))
    distance = np.abs(inner - share[:, None] * along).max(axis=1)
    return first + 1 + int(distance.argmax()), float(distance.max())


def keep(case: Case, run: RunFolder) -> Path:
    """Write a finished run of a case beside it and return the file."""
    name = run.info["run"]
    of_run = load_case(case.source, case.tier, name)
    further = [column for column in run.history if column not in HISTORY_COLUMNS]
    tolerance = TOLERANCE_OF_MOTION if of_run.dynamics else TOLERANCE
    history = reduced(run.history[[*COLUMNS, *further]], tolerance)
    told = {key: run.info[key] for key in ("run", "tier", "solver", "status", "reason", "code_version", "processor")}
    told |= {
        "stated_hash": of_run.hash(stated=True),
        "seconds": run.info["seconds"].get("total", 0.0),
        "rows": f"{len(history)} of {len(run.history)}, within {tolerance:g} of each column's range",
        "measures": {key: value for key, value in run.info["measures"].items() if value is not None},
    }
    head = "".join(f"# {key} = {toml_value(value)}\n" for key, value in told.items())
    path = _file(case, name)
    write_text(path, head + history.to_csv(index=False, float_format="%.6g", lineterminator="\n"))
    crack = path.with_suffix(_CRACK_PATH)
    if len(run.crack_path) > 1:
        line = pd.DataFrame(_thinned(run.crack_path), columns=["x", "y"])
        write_text(crack, line.to_csv(index=False, float_format="%.6g", lineterminator="\n"))
    else:
        crack.unlink(missing_ok=True)
    return path


def _thinned(path: np.ndarray) -> np.ndarray:
    """A polyline with fewer vertices, within a ten-thousandth of its extent."""
    import shapely

    return shapely.get_coordinates(shapely.simplify(shapely.LineString(path), 1e-4 * float(np.ptp(path, axis=0).max())))


# ------------------------------------------------------------------------------------------------ reading


def read_kept(case: Case, run: str) -> Kept | None:
    """The kept result of a run of a case at its tier, None where there is none; raises KeptError for a damaged one."""
    path = _file(case, run)
    if not path.is_file():
        return None
    try:
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        head = [line for line in lines if line.startswith("#")]
        info = tomllib.loads("".join(line.removeprefix("# ") for line in head))
        history = pd.read_csv(io.StringIO("".join(lines[len(head) :])))
        crack = path.with_suffix(_CRACK_PATH)
        points = pd.read_csv(crack)[["x", "y"]].to_numpy(dtype=float) if crack.exists() else np.empty((0, 2))
        for name in HISTORY_COLUMNS:
            if name not in history:
                history[name] = 0
        further = [name for name in history if name not in HISTORY_COLUMNS]
        return Kept(info, history[[*HISTORY_COLUMNS, *further]].astype({"step": int}), points)
    except (OSError, ValueError, KeyError) as error:
        raise KeptError(f"{path}: is damaged ({' '.join(str(error).split())}); restore the file.") from error


def restore(case: Case, out: Path, first_branch: bool = False) -> tuple[list[str], list[str]]:
    """Kept results of a case at its tier as run folders under ``out``.

    first_branch : only up to where the load first turns back

    Returns
    -------
    runs : that are there now
    remarks : a sentence for each main run that is not, or that is shortened
    """
    runs, remarks = [], []
    for name in main_runs(case):
        kept, of_run = read_kept(case, name), load_case(case.source, case.tier, name)
        if kept is None:
            remarks.append(f"No result of run {name} is kept for tier {case.tier}; {_remedy(case)}.")
        elif not kept.fits(of_run):
            remarks.append(f"The kept result of run {name} is of another version of the case; {_remedy(case)}.")
        else:
            history = kept.history
            if first_branch and (turn := first_branch_end(Curve.from_history(history, name))) < len(history) - 1:
                remarks.append(f"Run {name} is shown up to u = {history['u'].iloc[turn]:g}, where its load turns back.")
                history = history.iloc[: turn + 1]
            write_run(run_path(out, case.name, case.tier, name), history, kept.crack_path, _info(kept, of_run))
            runs.append(name)
    return runs, remarks


def _remedy(case: Case) -> str:
    return f"verify run and then verify accept, both with --tier {case.tier}, keep one"


def _info(kept: Kept, case: Case) -> dict[str, Any]:
    """Contents of run.json."""
    told = {key: kept.info[key] for key in ("run", "tier", "solver", "status", "reason", "code_version", "processor")}
    return told | {
        "case": case.name,
        "title": case.title,
        "case_source": str(case.source),
        "case_hash": case.hash(),
        "measures": kept.info.get("measures", {}),
        "seconds": {"total": float(kept.info["seconds"])},
        "counters": {},
    }
