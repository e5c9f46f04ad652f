"""Run folders: what one run of one case leaves behind, written so that half a run is never taken for one.

Layout of ``<out>/runs/<case>/<tier>/<run>/``::

    run.json         what ran, on what, how it ended, how much it took
    history.csv      one row for each converged increment or recorded time, the first state first
    crack_path.csv   polyline x, y in reference coordinates (header only when nothing broke)
    fields/          index.csv, points_0000.vtu (vertex cells), grid_0000.vtu
    points.pvd, grid.pvd
    checkpoint.npz   the last good state, from which a run that was stopped goes on

While a run goes on its folder is called ``<run>.partial``.
"""

import csv
import functools
import json
import os
import re
import shutil
import time
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TextIO

import numpy as np
import pandas as pd
import psutil

from cases.errors import UserError
from numerics.status import FINISHED_STATUSES, RunStatus
from verify.runs.atomic import WriteError, replace_folder, restore_folder, write_file, write_table, write_text, writing

if TYPE_CHECKING:
    import pyvista

    from cases import Case
    from numerics.costs import Costs
    from numerics.fields import Fields
    from numerics.records import Record

HISTORY_COLUMNS = (
    "step", "time", "u", "F", "E_el", "E_frac", "E_kin", "W_ext", "c_min", "staggered", "newton", "seconds",
)  # fmt: skip
INDEX_COLUMNS = ("snapshot", "step", "u", "points_file", "grid_file")
REQUIRED_INFO = (
    "case",
    "tier",
    "run",
    "solver",
    "status",
    "reason",
    "case_hash",
    "code_version",
    "increments",
)

__all__ = [
    "RunFolder", "RunFolderError", "RunWriter", "Snapshot", "WriteError", "case_folder", "partial_folder", "run_path",
]  # fmt: skip


class RunFolderError(UserError):
    """A run folder is missing, unfinished or damaged; its text is one sentence with path and remedy."""


class Snapshot(NamedTuple):
    """Fields written at one load parameter (or time): its value, step, points as a pyvista mesh."""

    u: float
    step: int
    points: "pyvista.UnstructuredGrid"


class Discretisation(Protocol):
    """What a run needs from a solver besides its march."""

    costs: "Costs"

    def fields(self) -> "Fields": ...

    def measures(self) -> dict[str, float]: ...

    def checkpoint(self) -> dict[str, np.ndarray]: ...

    def restore(self, saved: Mapping[str, np.ndarray]) -> None: ...


@dataclass(frozen=True)
class Checkpoint:
    """The last good state of a run, as it is kept in ``checkpoint.npz``.

    ``made_by`` identifies case and code; ``pending`` are the snapshots still to be written.
    """

    made_by: str
    record: "Record"
    pending: list[float]
    count: dict[str, int]
    seconds: dict[str, float]
    state: dict[str, np.ndarray]

    def write(self, path: Path) -> None:
        """Into one file of arrays and a line of JSON."""
        told = {"made_by": self.made_by, "kind": type(self.record).__name__, "record": asdict(self.record)}  # type: ignore[call-overload]
        told |= {"pending": self.pending, "count": self.count, "seconds": self.seconds}
        np.savez(path, told=np.array(json.dumps(told)), **self.state)  # type: ignore[arg-type]

    @classmethod
    def read(cls, path: Path) -> "Checkpoint":
        """Raises OSError, ValueError, KeyError, TypeError or BadZipFile where there is no whole checkpoint."""
        with np.load(path, allow_pickle=False) as arrays:
            state = dict(arrays)
        told = json.loads(str(state.pop("told")))
        record = _record(told.pop("kind"), told.pop("record"))
        return cls(state=state, record=record, **told)


def _record(kind: str, values: dict[str, Any]) -> "Record":
    from numerics.explicit import Balance, Instant
    from numerics.quasi_static import Increment, MarchState

    values["status"] = RunStatus(values["status"])
    if kind == "Increment":
        return Increment(**(values | {"march": MarchState(**values["march"])}))
    balance = values["balance"]
    return Instant(**(values | {"balance": Balance(**(balance | {"momentum": tuple(balance["momentum"])}))}))


#: what `Checkpoint.read` may meet in a file that is missing, cut or foreign
BROKEN_CHECKPOINT = (OSError, ValueError, EOFError, KeyError, TypeError, zipfile.BadZipFile)


def run_path(out: Path, case: str, tier: str, run: str) -> Path:
    """Folder of a finished run under the output folder ``out``."""
    # the label of a sweep may hold a path
    return out / "runs" / case / tier / re.sub(r"[/\\\\:]", "_", run)


def case_folder(out: Path, case: "Case", run: str) -> Path:
    """Folder of a run of a loaded case; of a varied one it is named by what is computed, so that all may share it."""
    if not case.change:
        return run_path(out, case.name, case.tier, run)
    return run_path(out, case.name, case.tier, "varied") / case.hash()


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


# ---------------------------------------------------------------------------------------------- writing


class RunWriter:
    """Listens to the records of a run and writes its folder; use as ``with RunWriter(...) as writer``.

    Parameters
    ----------
    folder : final place of the run; everything goes to ``<folder>.partial`` until `finish`.
    snapshots : load parameters or times at which fields are written, besides the last state.
    made_by : what identifies case and code, so that a checkpoint of others is not taken up.
    after : checkpoint behind which an unfinished run goes on.

    Raises
    ------
    WriteError : disk full, no permission, or another process writes the same run.
    """

    checkpoint_interval = 20.0  # seconds between two savings of the state, at least
    largest_share = 0.02  # of the time that savings may take: two million points write 600 MB

    def __init__(
        self, folder: Path, snapshots: Sequence[float] = (), made_by: str = "", after: Checkpoint | None = None
    ) -> None:
        self.folder = folder
        self.partial = partial_folder(folder)
        self._made_by, self._after = made_by, after
        self._pending = list(after.pending if after else snapshots)
        self._last = after.record if after else None
        self._rows = 0
        self._index: list[tuple[int, int, float, str, str]] = []
        self._save_after = time.monotonic() + self.checkpoint_interval
        self._history: TextIO

    def __enter__(self) -> "RunWriter":
        self._refuse_a_second_writer()
        with writing(self.partial):
            if self._after is not None:
                write_text(self.partial / "writer.json", json.dumps(_this_process()))
                self._drop_what_came_after(self._after.record.step)
                self._history = (self.partial / "history.csv").open("a", encoding="utf-8", newline="")
                return self
            if self.partial.exists():
                shutil.rmtree(self.partial)
            (self.partial / "fields").mkdir(parents=True)
            write_text(self.partial / "writer.json", json.dumps(_this_process()))
            self._history = (self.partial / "history.csv").open("w", encoding="utf-8", newline="")
        return self

    def _drop_what_came_after(self, step: int) -> None:
        """Increments and snapshots younger than the checkpoint will be computed again."""
        write_text(self.partial / "history.csv", "".join(_history_until(self.partial, step)))
        self._rows = step + 1
        if (self.partial / "fields" / "index.csv").exists():
            index = pd.read_csv(self.partial / "fields" / "index.csv")
            self._index = list(index[index["step"] <= step].itertuples(index=False, name=None))
            self._write_indices()

    def __exit__(self, *_: object) -> None:
        self._history.close()

    def _refuse_a_second_writer(self) -> None:
        """Two processes in one folder would mix two runs."""
        try:
            writer = json.loads((self.partial / "writer.json").read_text(encoding="utf-8"))
            started = psutil.Process(writer["process"]).create_time()
        except (OSError, ValueError, KeyError, psutil.Error):
            return
        if writer["process"] != os.getpid() and abs(started - writer["started"]) < 1.0:
            raise WriteError(
                f"{self.partial}: process {writer['process']} is writing this run now; "
                "wait for it or choose another place with --out."
            )

    def _write_row(self, values: tuple[object, ...]) -> None:
        """Flushed at once, so that a killed run still shows how far it came."""
        csv.writer(self._history, lineterminator="\n").writerow(values)
        self._history.flush()

    def record(self, record: "Record", discretisation: Discretisation) -> None:
        """Append a good record to the history; write fields and the checkpoint when they are due."""
        before = self._last.u if self._last else record.u
        row = record.row()
        with writing(self.partial / "history.csv"):
            if not self._rows:
                self._write_row(tuple(row))
            self._write_row(tuple(row.values()))
        self._last = record
        self._rows += 1
        if self._snapshot_due(before, record.u):
            self._write_snapshot(discretisation.fields())
        if time.monotonic() > self._save_after:
            self._write_checkpoint(discretisation)

    def _snapshot_due(self, before: float, now: float) -> bool:
        """True at the first record that reaches or passes a wanted load parameter."""
        slack = 1e-9 * max(abs(before), abs(now))
        low, high = min(before, now) - slack, max(before, now) + slack
        reached = [u for u in self._pending if low <= u <= high]
        self._pending = [u for u in self._pending if u not in reached]
        return bool(reached)

    def _write_snapshot(self, fields: "Fields") -> None:
        from verify.runs.vtk_files import grid_mesh, points_mesh, write_mesh

        assert self._last is not None
        number = len(self._index)
        points_file, grid_file = f"fields/points_{number:04d}.vtu", f"fields/grid_{number:04d}.vtu"
        write_file(self.partial / points_file, lambda path: write_mesh(points_mesh(fields), path))
        write_file(self.partial / grid_file, lambda path: write_mesh(grid_mesh(fields), path))
        self._index.append((number, self._last.step, self._last.u, points_file, grid_file))
        self._write_indices()

    def _write_indices(self) -> None:
        from verify.runs.vtk_files import pvd_text

        table = pd.DataFrame(self._index, columns=list(INDEX_COLUMNS))
        write_table(self.partial / "fields" / "index.csv", table)
        # ParaView wants times that grow, which displacements of a cyclic load do not.
        times = table["u"] if table["u"].is_monotonic_increasing and table["u"].is_unique else table["step"]
        for name in ("points", "grid"):
            text = pvd_text([float(value) for value in times], table[f"{name}_file"].tolist())
            write_text(self.partial / f"{name}.pvd", text)

    def _write_checkpoint(self, discretisation: Discretisation) -> None:
        assert self._last is not None
        started = time.monotonic()
        with writing(self.partial / "history.csv"):  # no checkpoint ahead of its history
            os.fsync(self._history.fileno())
        costs = discretisation.costs
        checkpoint = Checkpoint(
            made_by=self._made_by,
            record=self._last,
            pending=self._pending,
            count={name: int(value) for name, value in costs.count.items()},
            seconds={name: float(value) for name, value in costs.seconds.items()},
            state=discretisation.checkpoint(),
        )
        write_file(self.partial / "checkpoint.npz", checkpoint.write)
        saved = time.monotonic()
        self._save_after = saved + max(self.checkpoint_interval, (saved - started) / self.largest_share)

    def last_state(self, discretisation: Discretisation) -> "Fields | None":
        """Write and return the last good state as the last snapshot and as the checkpoint."""
        if self._last is None:
            return None
        fields = discretisation.fields()
        if not self._index or self._index[-1][1] != self._last.step:
            self._write_snapshot(fields)
        self._write_checkpoint(discretisation)
        return fields

    def finish(self, info: dict[str, Any], crack_path: np.ndarray) -> None:
        """Write what is known at the end only, and give the folder its final name.

        Parameters
        ----------
        info : contents of run.json.
        crack_path : (n, 2) polyline in reference coordinates [case length unit]; n = 0 when nothing broke.
        """
        if not self._rows:
            self._write_row(HISTORY_COLUMNS)
        self._history.close()
        write_text(self.partial / "crack_path.csv", _crack_path_text(crack_path))
        if not self._index:
            self._write_indices()
        write_text(self.partial / "run.json", json.dumps(info | {"increments": self._rows}, indent=2) + "\n")
        (self.partial / "writer.json").unlink(missing_ok=True)
        replace_folder(self.partial, self.folder)


def _history_until(partial: Path, step: int) -> list[str]:
    """Lines of an unfinished history up to a step, the head included; OSError or ValueError where it is not whole."""
    lines = (partial / "history.csv").read_text(encoding="utf-8").splitlines(keepends=True)[: step + 2]
    if len(lines) < step + 2 or not lines[-1].endswith("\n") or lines[-1].split(",")[0] != str(step):
        raise ValueError(f"{partial / 'history.csv'} ends before step {step}")
    return lines


def unfinished_checkpoint(folder: Path) -> Checkpoint | None:
    """The checkpoint of a run that was stopped, where it is whole and its history reaches to it."""
    partial = partial_folder(folder)
    try:
        saved = Checkpoint.read(partial / "checkpoint.npz")
        _history_until(partial, saved.record.step)
    except BROKEN_CHECKPOINT:
        return None
    return saved


def _this_process() -> dict[str, float]:
    return {"process": os.getpid(), "started": psutil.Process().create_time()}


def _crack_path_text(crack_path: np.ndarray) -> str:
    table = pd.DataFrame(np.asarray(crack_path, dtype=float).reshape(-1, 2), columns=["x", "y"])
    return table.to_csv(index=False, lineterminator="\n")


# ---------------------------------------------------------------------------------------------- reading


@functools.lru_cache(maxsize=2)
def _read_mesh(path: Path, changed: int) -> Any:
    """Kept, since one metric after the other asks for the same state; ``changed`` tells whether it is still the file."""
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
        except OSError as error:
            raise self._damaged("run.json", "is missing or unreadable") from error
        except ValueError as error:
            raise self._damaged("run.json", "is not valid JSON") from error
        missing = (
            [key for key in REQUIRED_INFO if key not in info] if isinstance(info, dict) else ["all keys"]
        )
        if missing:
            raise self._damaged("run.json", f"lacks {', '.join(missing)}")
        if info["status"] not in FINISHED_STATUSES:
            raise self._damaged("run.json", f"has the unknown status {info['status']!r}")
        return info | {"status": RunStatus(info["status"])}

    def _table(self, file: str, columns: tuple[str, ...]) -> pd.DataFrame:
        try:
            table = pd.read_csv(self.folder / file)
        except OSError as error:
            raise self._damaged(file, "is missing or unreadable") from error
        except ValueError as error:  # pandas' parser errors, wrong encodings
            raise self._damaged(file, "is not a readable table") from error
        if tuple(table.columns)[: len(columns)] != columns:
            raise self._damaged(file, f"has not the columns {', '.join(columns)}")
        return table

    @property
    def good(self) -> bool:
        """True when the run went to its end, broke the specimen through, or failed as the case expects."""
        return self.info["status"].good

    @functools.cached_property
    def history(self) -> pd.DataFrame:
        """One row for each increment or recorded time: `HISTORY_COLUMNS`, then further ones, in case units."""
        table = self._table("history.csv", HISTORY_COLUMNS)
        if len(table) != self.info["increments"]:
            raise self._damaged("history.csv", f"has {len(table)} of {self.info['increments']} increments")
        if not all(pd.api.types.is_numeric_dtype(table[column]) for column in table) and len(table):
            raise self._damaged("history.csv", "has entries that are not numbers")
        return table

    @functools.cached_property
    def crack_path(self) -> np.ndarray:
        """(n, 2) polyline in reference coordinates [case length unit]; n = 0 when nothing broke."""
        return self._table("crack_path.csv", ("x", "y")).to_numpy(dtype=float).reshape(-1, 2)

    @functools.cached_property
    def index(self) -> pd.DataFrame:
        """One row for each snapshot, columns `INDEX_COLUMNS`."""
        return self._table("fields/index.csv", INDEX_COLUMNS)

    def _mesh(self, file: str) -> "pyvista.UnstructuredGrid":
        import pyvista

        path = self.folder / file
        if not path.is_file():
            raise self._damaged(file, "is missing")
        mesh = _read_mesh(path, path.stat().st_mtime_ns)
        if not isinstance(mesh, pyvista.UnstructuredGrid) or mesh.n_points == 0:
            raise self._damaged(file, "holds no mesh")
        return mesh.copy()

    def _nearest(self, u: float | None) -> pd.Series:
        if self.index.empty:
            raise self._damaged("fields/index.csv", "lists no snapshot")
        row = len(self.index) - 1 if u is None else int((self.index["u"] - u).abs().argmin())
        return self.index.iloc[row]

    def snapshots(self) -> Iterator[Snapshot]:
        """All snapshots in the order of the run, the last state last."""
        for _, row in self.index.iterrows():
            yield Snapshot(float(row["u"]), int(row["step"]), self._mesh(row["points_file"]))

    def points(self, u: float | None = None) -> "pyvista.UnstructuredGrid":
        """Integration points of the snapshot nearest to displacement ``u``; the last state without it."""
        return self._mesh(self._nearest(u)["points_file"])

    def grid(self, u: float | None = None) -> "pyvista.UnstructuredGrid":
        """Grid or mesh of the snapshot nearest to displacement ``u``; the last state without it."""
        return self._mesh(self._nearest(u)["grid_file"])

    def fields(self, u: float | None = None) -> "Fields":
        """All fields as arrays from the snapshot nearest to displacement ``u``; the last state without."""
        from verify.runs.vtk_files import fields_of

        return fields_of(self.points(u), self.grid(u))

    @property
    def checkpoint(self) -> Checkpoint:
        """The last good state."""
        try:
            return Checkpoint.read(self.folder / "checkpoint.npz")
        except BROKEN_CHECKPOINT as error:
            raise self._damaged("checkpoint.npz", "is missing or unreadable") from error

    @property
    def case(self) -> "Case":
        """The case as its file stands now; see `verify.judging.judge` for runs that are older than it."""
        from cases import load_case

        source, change = self.info.get("case_source", self.info["case"]), self.info.get("change")
        return load_case(source, self.info["tier"], self.info["run"], change)
