"""Run folders: what one run of one case leaves behind, written so that half a run is never taken for one.

Layout of ``<out>/runs/<case>/<tier>/<run>/``::

    run.json         what ran, on what, how it ended, how much it took; checksums of the tables and fields below
    history.csv      one row for each converged increment or recorded time, the first state first
    crack_path.csv   polyline x, y in reference coordinates (header only when nothing broke)
    fields/          index.csv, points_0000.vtu (vertex cells), grid_0000.vtu
    points.pvd, grid.pvd
    checkpoint.npz   the last good state, from which a run that was stopped goes on

While a run goes on its folder is called ``<run>.partial``, and ``<run>.writer`` is locked. A stopped run that has a
checkpoint and is not gone on with waits as ``<run>.stopped`` until a run of that name has come to a good end.
"""

import functools
import hashlib
import json
import re
from collections.abc import Iterator
from html import escape
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from pydantic import BaseModel, ConfigDict, ValidationError

from cases.errors import UserError
from numerics.status import FINISHED_STATUSES, RunStatus
from verify.metrics.metric import NotGivenError
from verify.runs.atomic import restore_folder
from verify.runs.checkpoint import CHECKPOINT_FILE, Checkpoint, CheckpointError

if TYPE_CHECKING:
    import pyvista

    from cases import Case
    from numerics.fields import Fields

HISTORY_COLUMNS = (
    "step", "time", "u", "F", "E_el", "E_frac", "E_kin", "W_ext", "c_min", "staggered", "newton", "seconds",
)  # fmt: skip
INDEX_COLUMNS = ("snapshot", "step", "u", "points_file", "grid_file")


class RunFolderError(UserError):
    """A run folder is missing, unfinished or damaged; its text is one sentence with path and remedy."""


class Snapshot(NamedTuple):
    """Fields written at one load parameter (or time): its value, step, points as a pyvista mesh."""

    u: float
    step: int
    points: "pyvista.UnstructuredGrid"


class RunInfo(BaseModel):
    """What readers of run.json rely on: keys that must be there, and the kind of those that may."""

    model_config = ConfigDict(strict=True, extra="allow")

    case: str
    tier: str
    run: str
    solver: str
    status: str
    reason: str
    case_hash: str
    code_version: str
    increments: int
    checksums: dict[str, str]
    title: str = ""
    case_source: str = ""
    units: dict[str, str] = {}
    source_hash: str = ""
    processor: str = ""
    change: dict[str, Any] = {}
    versions: dict[str, str] = {}
    counters: dict[str, int] = {}
    seconds: dict[str, float] = {}
    measures: dict[str, float | None] = {}
    health: dict[str, float | None] = {}
    threads: int = 1
    memory_mb: float = 0.0
    resumed_after_step: int | None = None


def run_path(out: Path, case: str, tier: str, run: str) -> Path:
    """Folder of a finished run under the output folder ``out``."""
    # the label of a sweep may hold a path
    return out / "runs" / case / tier / re.sub(r"[/\\\\:]", "_", run)


def case_folder(out: Path, case: "Case", run: str) -> Path:
    """Folder of a run of a loaded case; of a varied one it is named by what is computed, so that all may share it."""
    if not case.change:
        return run_path(out, case.name, case.tier, run)
    return run_path(out, case.name, case.tier, "varied") / case.hash()


def require_own_folder(folder: Path, case: "Case") -> None:
    """Raise RunFolderError where the folder holds the run of another case file, which is still there."""
    try:
        other = RunFolder(folder).info["case_source"]
    except RunFolderError:  # nothing that could be lost
        return
    if other and Path(other) != Path(case.source).resolve() and not case.change and Path(other).is_file():
        raise RunFolderError(
            f"{case.source}: its results would replace those of {other} in {folder}, since both cases are called "
            f"{case.name!r}; rename one of the two or choose another place with --out."
        )


def partial_folder(folder: Path) -> Path:
    """Folder of the same run while it is not finished."""
    return folder.with_name(folder.name + ".partial")


def as_expected(status: RunStatus, case: "Case", run_name: str) -> RunStatus:
    """The status of a run that failed in the light of what the case expects of it."""
    failure = RunStatus.BLEW_UP if case.dynamics else RunStatus.NO_CONVERGENCE
    if status not in (RunStatus.NO_CONVERGENCE, RunStatus.BLEW_UP, RunStatus.EXPECTED_FAILURE):
        return status
    if case.run_spec(run_name).expect_failure:
        return RunStatus.EXPECTED_FAILURE
    return failure if status == RunStatus.EXPECTED_FAILURE else status


def file_checksum(path: Path) -> str:
    """SHA-256 of a file in hexadecimal digits; raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@functools.lru_cache(maxsize=2)
def _read_mesh(path: Path, checksum: str) -> Any:
    """Kept, since one metric after the other asks for the same state; ``checksum`` tells which file it was."""
    import pyvista

    return pyvista.read(path)


class RunFolder:
    """A finished run, read only when asked for.

    Raises
    ------
    RunFolderError : the run is missing, unfinished or damaged.
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        restore_folder(self.folder)
        if not self.folder.is_dir():
            raise RunFolderError(self._why_missing())
        if self.folder.name.endswith(".partial"):
            raise RunFolderError(f"{self.folder}: this run is not finished; let it finish or run it again.")
        self._place = self.folder.absolute()  # files are read when asked for, wherever the reader has gone by then
        self.info: dict[str, Any] = self._read_info()

    def _why_missing(self) -> str:
        if partial_folder(self.folder).exists():
            return (
                f"{self.folder}: this run is not finished (there is only a .partial folder); "
                "let it finish or run it again with `verify run`."
            )
        return f"{self.folder}: there is no such run; compute it with `verify run`."

    def _damaged(self, file: str, what: str) -> RunFolderError:
        return RunFolderError(f"{self.folder / file}: {what}; run it again with `verify run --force`.")

    def _read_info(self) -> dict[str, Any]:
        try:
            info = json.loads((self.folder / "run.json").read_text(encoding="utf-8"))
            RunInfo.model_validate(info)
        except OSError as error:
            raise self._damaged("run.json", "is missing or unreadable") from error
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(map(str, first["loc"])) or "the whole"
            raise self._damaged("run.json", f"is damaged at {key!r}: {first['msg'].lower()}") from error
        except (ValueError, RecursionError) as error:
            raise self._damaged("run.json", "is not valid JSON") from error
        if info["status"] not in FINISHED_STATUSES:
            raise self._damaged("run.json", f"has the unknown status {info['status']!r}")
        return info | {"status": RunStatus(info["status"])}

    def _checked(self, file: str) -> Path:
        """A file of the folder that is what the run has written."""
        path = self._place / file
        try:
            found = file_checksum(path)
        except OSError as error:
            raise self._damaged(file, "is missing or unreadable") from error
        if found != self.info["checksums"].get(file):
            raise self._damaged(file, "is damaged or of another run: it is not what run.json tells of it")
        return path

    def _table(self, file: str, columns: tuple[str, ...]) -> pd.DataFrame:
        try:
            table = pd.read_csv(self._checked(file))
        except ValueError as error:  # pandas' parser errors, wrong encodings
            raise self._damaged(file, "is not a readable table") from error
        if tuple(table.columns)[: len(columns)] != columns:
            raise self._damaged(file, f"has not the columns {', '.join(columns)}")
        return table

    def _numbers(self, file: str, columns: tuple[str, ...]) -> pd.DataFrame:
        table = self._table(file, columns)
        if len(table) and not all(pd.api.types.is_numeric_dtype(table[column]) for column in table):
            raise self._damaged(file, "has entries that are not numbers")
        return table

    @property
    def good(self) -> bool:
        """True when the run went to its end, broke the specimen through, or failed as the case expects."""
        return self.info["status"].good

    @functools.cached_property
    def history(self) -> pd.DataFrame:
        """One row for each increment or recorded time: `HISTORY_COLUMNS`, then further ones, in case units.

        ``history.attrs["units"]`` tells those of u, F, the time and the energies.
        """
        table = self._numbers("history.csv", HISTORY_COLUMNS)
        if len(table) != self.info["increments"]:
            raise self._damaged("history.csv", f"has {len(table)} of {self.info['increments']} increments")
        table.attrs["units"] = self.info.get("units", {})
        return table

    @functools.cached_property
    def crack_path(self) -> np.ndarray:
        """(n, 2) polyline in reference coordinates [case length unit]; n = 0 when nothing broke."""
        return self._numbers("crack_path.csv", ("x", "y")).to_numpy(dtype=float).reshape(-1, 2)

    @functools.cached_property
    def index(self) -> pd.DataFrame:
        """One row for each snapshot, columns `INDEX_COLUMNS`."""
        return self._table("fields/index.csv", INDEX_COLUMNS)

    def _mesh(self, file: str) -> "pyvista.UnstructuredGrid":
        import pyvista

        mesh = _read_mesh(self._checked(file), self.info["checksums"][file])
        if not isinstance(mesh, pyvista.UnstructuredGrid) or mesh.n_points == 0:
            raise self._damaged(file, "holds no mesh")
        return mesh.copy()

    def _points(self, file: str) -> "pyvista.UnstructuredGrid":
        from verify.runs.vtk_files import with_all_point_data

        return with_all_point_data(self._mesh(file))

    def _nearest(self, u: float | None) -> pd.Series:
        if self.index.empty and self.info["increments"]:
            raise NotGivenError(f"run {self.info['run']}: has no fields, a history and a crack path are all there is")
        if self.index.empty:
            raise self._damaged("fields/index.csv", "lists no snapshot")
        row = len(self.index) - 1 if u is None else int(np.abs(self.index["u"].to_numpy() - u).argmin())
        return self.index.iloc[row]

    def _stored(self, u: float | None) -> pd.Series:
        """The row of the snapshot of ``u``, within the longest increment or time between two records."""
        if u is not None and not isinstance(u, Real):
            remedy = "give a number, or None for the last state"
            raise RunFolderError(f"run {self.info['run']}: {u!r} is no load or time; {remedy}.")
        found, near = self._nearest(u), np.abs(np.diff(self.history["u"])).max(initial=0.0)
        if u is not None and not abs(found["u"] - u) <= max(near, 1e-9 * abs(u)):
            kept = ", ".join(f"{stored:.6g}" for stored in self.index["u"])
            key = "snapshots" if (self.history["u"] != self.history["time"]).any() else "times"
            text = f"has no fields at {u:.6g}; give one of {kept}, or add it to output.{key} and run the case again"
            raise NotGivenError(f"run {self.info['run']}: {text}")
        return found

    def snapshots(self) -> Iterator[Snapshot]:
        """All snapshots in the order of the run, the last state last."""
        for _, row in self.index.iterrows():
            yield Snapshot(float(row["u"]), int(row["step"]), self._points(row["points_file"]))

    def nearest(self, u: float) -> float:
        """Displacement of the snapshot nearest to ``u``."""
        return float(self._nearest(u)["u"])

    def points(self, u: float | None = None) -> "pyvista.UnstructuredGrid":
        """Integration points of the snapshot at load or time ``u``, to an increment; the last state without it.

        ``field_data["u"]`` tells where it is, ``field_data["units"]`` the units of the arrays.
        Raises NotGivenError where no snapshot is near.
        """
        return self._points(self._stored(u)["points_file"])

    def grid(self, u: float | None = None) -> "pyvista.UnstructuredGrid":
        """Grid or mesh of the snapshot at load or time ``u``; as `points`."""
        return self._mesh(self._stored(u)["grid_file"])

    def fields(self, u: float | None = None) -> "Fields":
        """All fields as arrays from the snapshot at load or time ``u``; as `points`."""
        from verify.runs.vtk_files import fields_of

        return fields_of(self.points(u), self.grid(u))

    def __repr__(self) -> str:
        return f"RunFolder({str(self.folder)!r}): {self.info['run']}, {self.info['status'].words}"

    def _repr_html_(self) -> str:
        """How it ended and its curve, in a notebook."""
        from verify.runs.sketch import sketch

        info, history = self.info, self.history
        over = "time" if history["u"].equals(history["time"]) else "u"
        told = f"{info['case']}, tier {info['tier']}, run {info['run']}: {info['status']}"
        seconds = info.get("seconds", {}).get("total", 0.0)
        units = info.get("units", {})
        x, y = (f"{name} [{units[name]}]" if name in units else name for name in (over, "F"))
        curve = sketch({info["run"]: (history[over], history["F"])}, x, y)
        return (
            f"<p><b>{escape(told)}</b> {escape(info['reason'])}<br>{len(history)} increments, {seconds:.3g} s,"
            f" largest |F| {history['F'].abs().max():.5g} {escape(units.get('F', ''))}</p>{curve}"
        )

    @property
    def checkpoint(self) -> Checkpoint:
        """The last good state."""
        try:
            return Checkpoint.read(self._place / CHECKPOINT_FILE)
        except CheckpointError as error:
            raise self._damaged(CHECKPOINT_FILE, str(error)) from error

    @property
    def case(self) -> "Case":
        """The case as its file stands now; see `verify.judging.judge` for runs that are older than it."""
        from cases import load_case

        source, change = self.info.get("case_source", self.info["case"]), self.info.get("change")
        return load_case(source, self.info["tier"], self.info["run"], change)
