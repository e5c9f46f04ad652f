"""What the report reads: ``summary.json``, the run folders it names and the case descriptions."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from cases import Case, CaseError, load_case
from cases.solvers import SOLVERS, Solver
from numerics.status import RunStatus
from verify.runs.frames import Frame, read_frames
from verify.runs.run_folder import RunFolder, RunFolderError

if TYPE_CHECKING:
    from collections.abc import Mapping

#: what summary.json and its entry of a case hold
_SUMMARY_KEYS = {"version", "created", "tier", "cases"}
_ENTRY_KEYS = {"case", "source", "title", "tier", "verdict", "runs", "checks", "curves", "crack_paths"}
# A damaged or missing result leaves a notice on the page; it does not end the report.
READING_ERRORS = (RunFolderError, OSError, ValueError, KeyError, IndexError, AttributeError, TypeError)
SNAPSHOT_MATCH = 0.02  # a stored state stands for a wanted displacement when within this share of the path


def method_of(solver: str) -> Solver:
    """Return the solver of this name; one that the registry does not know is shown under its name, dotted."""
    return SOLVERS.get(solver) or Solver(solver, solver, solver, ":", "", "", "")


@dataclass(frozen=True)
class PointState:
    """Integration points of one snapshot: arrays of length n, coordinates (n, 2) [case length unit]."""

    reference: np.ndarray
    displacement: np.ndarray
    volume: np.ndarray
    phase_field: np.ndarray
    hydrostatic_stress: np.ndarray


@dataclass(frozen=True)
class GridState:
    """Mesh or background grid of one snapshot: points (m, 2), cells (k, 3 or 4), nodal fields."""

    points: np.ndarray
    cells: np.ndarray
    displacement: np.ndarray
    phase_field: np.ndarray

    def least_phase_field(self) -> np.ndarray:
        """Return the least nodal phase field of each cell, shape (k,)."""
        return self.phase_field[self.cells].min(axis=1)

    def triangles(self) -> np.ndarray:
        """Return the cells as triangles (quadrilaterals halved), shape (k', 3)."""
        if self.cells.shape[1] == 3:
            return self.cells
        return np.vstack([self.cells[:, [0, 1, 2]], self.cells[:, [0, 2, 3]]])


class RunResults:
    """One run of a case: its entry in ``summary.json`` and, read when asked for, its folder."""

    def __init__(self, name: str, entry: Mapping[str, Any], out: Path) -> None:
        self.name = name
        self.entry = entry
        self.location = str(entry.get("folder") or "")
        self.problem = "" if self.location else "summary.json names no folder for this run."
        self._folder: RunFolder | None = None
        if self.location:
            self._open(out / self.location)

    def _open(self, folder: Path) -> None:
        try:
            self._folder = RunFolder(folder)
            if self._folder.history.empty:
                self.problem = "no increment converged"
        except READING_ERRORS as problem:
            self._folder, self.problem = None, str(problem).replace(f"{folder}", self.location)

    @property
    def folder(self) -> RunFolder:
        """The run folder.

        Raises RunFolderError when it is missing, unfinished or damaged.
        """
        if self._folder is None:
            raise RunFolderError(self.problem)
        return self._folder

    @property
    def exists(self) -> bool:
        """Whether the run left increments to show, of the case as it stands."""
        return self._folder is not None and self.status.finished and not self._folder.history.empty

    @property
    def status(self) -> RunStatus:
        """How the run ended, ``missing`` when it has no folder."""
        return RunStatus(self.entry.get("status") or self.record.get("status") or RunStatus.MISSING)

    @property
    def record(self) -> Mapping[str, Any]:
        """The run's ``run.json``; empty when absent."""
        return self._folder.info if self._folder else {}

    @property
    def method(self) -> Solver:
        """The solver that made it, or that its name tells."""
        name = self.record.get("solver") or self.entry.get("solver") or re.split(r"[_\[]", self.name)[0]
        return method_of(str(name))

    @property
    def label(self) -> str:
        """Name with method, ``mpm_gmres (PF-MPM)``; the method alone where both agree."""
        return self.method.title if self.name == self.method.name else f"{self.name} ({self.method.title})"

    @property
    def history(self) -> pd.DataFrame:
        """The converged increments, one row each, in case units."""
        return self.folder.history

    @property
    def crack_path(self) -> np.ndarray:
        """The crack as a polyline in reference coordinates, shape (n, 2), n = 0 when nothing broke."""
        return self.folder.crack_path if self._folder else np.empty((0, 2))

    @cached_property
    def stored(self) -> np.ndarray:
        """Displacements u of the stored states in the order of the load path."""
        return self.folder.index["u"].to_numpy(float) if self._folder else np.empty(0)

    @cached_property
    def frames(self) -> list[Frame]:
        """The frames of a moving run in the order of time; none where it has none."""
        return list(read_frames(self.folder.folder))

    def nearest_stored(self, u: float) -> float | None:
        """Return the u of the stored state nearest to ``u``; None when none is near."""
        if not self.stored.size:
            return None
        nearest = float(self.stored[np.abs(self.stored - u).argmin()])
        near = abs(nearest - u) <= SNAPSHOT_MATCH * max(np.abs(self.stored).max(), abs(u))
        return nearest if near else None

    @lru_cache(maxsize=8)  # noqa: B019  a page's runs are few and dropped together with their page
    def points(self, u: float) -> PointState:
        """Read the integration points of the stored state nearest to ``u``."""
        data = self.folder.points(u).point_data
        return PointState(
            reference=np.asarray(data["reference"])[:, :2],
            displacement=np.asarray(data["displacement"])[:, :2],
            volume=np.asarray(data["volume"]),
            phase_field=np.asarray(data["phase_field"]),
            hydrostatic_stress=np.asarray(data["hydrostatic_stress"]),
        )

    @lru_cache(maxsize=8)  # noqa: B019
    def grid(self, u: float) -> GridState:
        """Read the mesh or grid of the stored state nearest to ``u``."""
        from verify.runs.vtk_files import grid_displacement

        mesh = self.folder.grid(u)
        return GridState(
            points=np.asarray(mesh.points)[:, :2],
            cells=np.asarray(next(iter(mesh.cells_dict.values()))),
            displacement=grid_displacement(mesh),
            phase_field=np.asarray(mesh.point_data["phase_field"]),
        )


def tells(run: RunResults, *columns: str) -> bool:
    """Whether a run's history has values of these columns, which a result from elsewhere need not have."""
    return all(name in run.history and run.history[name].notna().any() for name in columns)


class CaseResults:
    """One case of ``summary.json`` with its runs and, where it can still be read, its description."""

    def __init__(self, entry: Mapping[str, Any], out: Path) -> None:
        self.entry = entry
        self.out = out
        self.name = str(entry["case"])
        self.tier = str(entry.get("tier") or "")
        self.case_problem = ""
        self.runs = {name: RunResults(name, run, out) for name, run in (entry.get("runs") or {}).items()}

    @property
    def verdict(self) -> str:
        """PASS, FAIL, RUN_FAILED, SUSPECT, NEEDS_RECORD, NOT_CHECKED or MISSING."""
        return str(self.entry.get("verdict") or "MISSING")

    @property
    def checks(self) -> list[dict[str, Any]]:
        """The judged checks as ``summary.json`` holds them."""
        return list(self.entry.get("checks") or [])

    @property
    def source(self) -> str:
        """What to load the case from: the file that was judged, else its name in the library."""
        source = self.entry.get("source")
        return str(source) if source and Path(source).exists() else self.name

    @cached_property
    def case(self) -> Case | None:
        """The case description at this tier; None, with ``case_problem`` saying why, when unreadable."""
        try:
            return load_case(self.source, tier=self.tier or None)
        except (CaseError, *READING_ERRORS) as problem:
            self.case_problem = str(problem)
            return None

    def unit(self, quantity: str) -> str:
        """Return the case's unit of a quantity for an axis label."""
        return self.case.unit(quantity) if self.case else "case unit"

    @property
    def by_factor(self) -> bool:
        """The load parameter is a number, a factor on what acts, and F the work per factor."""
        return self.case is not None and self.case.load_kinds[0] == "number"

    @property
    def force_name(self) -> str:
        """What F is: the reaction force where all that the load moves goes by u one way, else what does work on u."""
        if self.by_factor:
            return "work per load factor"
        ways = {(c.direction, c.scale) for c in self.case.constraints if c.follows_load} if self.case else set()
        is_reaction = not ways or (len(ways) == 1 and abs(next(iter(ways))[1] or 1.0) == 1.0)
        return "reaction force" if is_reaction else "force that does work on u,"

    @property
    def load_label(self) -> str:
        """Return the axis label of the load parameter."""
        return f"{'load factor' if self.by_factor else 'displacement'} u [{self.unit('displacement')}]"

    def shown_runs(self) -> list[RunResults]:
        """Return the runs that left results, in the order of the solvers."""
        order = [*SOLVERS, *(run.method.name for run in self.runs.values())]
        return sorted((run for run in self.runs.values() if run.exists), key=lambda run: order.index(run.method.name))

    def main_runs(self, largest: int = 2) -> list[RunResults]:
        """Return one run per solver and then further ones, at most ``largest``; of a sweep the last level."""
        runs = list({re.sub(r"\[.*\]$", "", run.name): run for run in self.shown_runs()}.values())
        firsts = list({run.method.name: run for run in reversed(runs)}.values())[::-1]
        return [*firsts, *(run for run in runs if run not in firsts)][:largest]


def read_summary(out: Path) -> dict[str, Any]:
    """Return ``out/summary.json``.

    Raises FileNotFoundError when the cases have not been judged yet, RunFolderError when the file is damaged.
    """
    file = out / "summary.json"
    if not file.is_file():
        raise FileNotFoundError(f"{file} does not exist: run `verify compare` first, it writes this file")
    try:
        summary: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        whole = summary.keys() >= _SUMMARY_KEYS and all(entry.keys() >= _ENTRY_KEYS for entry in summary["cases"])
    except (ValueError, TypeError, AttributeError):
        whole = False
    if not whole:
        raise RunFolderError(f"{file}: is damaged; judge again with `verify compare`.")
    return summary
