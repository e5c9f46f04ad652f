"""Writing run folders, so that half a run is never taken for one: see `verify.runs.run_folder` for the layout."""

import csv
import itertools
import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO
from xml.etree import ElementTree

import numpy as np
import pandas as pd

from numerics.status import RunStatus
from verify.runs.atomic import replace_folder, write_file, write_table, write_text, writing
from verify.runs.checkpoint import CHECKPOINT_FILE, Checkpoint, CheckpointError
from verify.runs.listeners import Listener, ObservedDiscretisation
from verify.runs.lock import WriterLock
from verify.runs.run_folder import (
    HISTORY_COLUMNS,
    INDEX_COLUMNS,
    RunFolder,
    RunFolderError,
    file_checksum,
    partial_folder,
)

if TYPE_CHECKING:
    from cases.units import Units
    from numerics.fields import Fields
    from numerics.records import Record


class RunWriter(Listener):
    """Writes history, snapshots and, at the end, run.json; use as ``with RunWriter(...) as writer``.

    Parameters
    ----------
    folder : final place of the run; everything goes to ``<folder>.partial`` until `close`.
    snapshots : load parameters or times at which fields are written, besides the last state.
    units : those of the case, which the files of fields tell.

    Raises
    ------
    WriteError : disk full, no permission, or another process writes the same run.
    """

    def __init__(self, folder: Path, snapshots: Sequence[float] = (), units: "Units | None" = None) -> None:
        self.folder, self._units = folder, units
        self.partial = partial_folder(folder)
        self._lock = WriterLock(folder.with_name(folder.name + ".writer"))
        self._pending = list(snapshots)
        self._last: Record | None = None
        self._rows = 0
        self._index: list[tuple[int, int, float, str, str]] = []
        self._history: TextIO | None = None

    def __enter__(self) -> "RunWriter":
        self._lock.take()
        return self

    def __exit__(self, *_: object) -> None:
        self._close_history()
        self._lock.release()

    # ------------------------------------------------------------------------------------ beginning

    def checkpoint(self, made_by: str) -> Checkpoint | None:
        """The checkpoint to go on behind: of a run that was stopped, or of one that ran out of time.

        Raises
        ------
        CheckpointError : there is one, but it is damaged, ahead of its history or made by another case or code.
        """
        source = self._stopped_run()
        if source is None:
            return None
        saved = Checkpoint.read(source / CHECKPOINT_FILE)
        if saved.made_by != made_by:
            raise CheckpointError("is of another version of the case or of the code")
        _rows_until(source, saved.record.step)
        _snapshots_until(source, saved.record.step)
        return saved

    def _stopped_run(self) -> Path | None:
        if (self.partial / CHECKPOINT_FILE).exists():
            return self.partial
        with suppress(RunFolderError):
            if RunFolder(self.folder).info["status"] == RunStatus.TIMED_OUT:
                return self.folder
        return None

    @property
    def set_aside(self) -> Path:
        """Where the folder of a stopped run waits while one begins anew that may go wrong as well."""
        return next(path for path in self._places_aside() if not path.exists())

    def _places_aside(self) -> Iterator[Path]:
        names = itertools.chain([".stopped"], (f".stopped-{number}" for number in itertools.count(2)))
        return (self.folder.with_name(self.folder.name + name) for name in names)

    def start(self, after: "Record | None", note: str) -> None:
        """Take up the unfinished folder behind a record, or begin a new one."""
        with writing(self.partial):
            if after is not None:
                self._go_on(after)
            else:
                self._begin()

    def _begin(self) -> None:
        if (self.partial / CHECKPOINT_FILE).exists():
            os.replace(self.partial, self.set_aside)
        elif self.partial.exists():
            shutil.rmtree(self.partial)
        (self.partial / "fields").mkdir(parents=True)
        self._history = (self.partial / "history.csv").open("w", encoding="utf-8", newline="")

    def _go_on(self, after: "Record") -> None:
        """Increments and snapshots younger than the checkpoint will be computed again."""
        if self._stopped_run() == self.folder:
            shutil.rmtree(self.partial, ignore_errors=True)
            os.replace(self.folder, self.partial)
        (self.partial / "run.json").unlink(missing_ok=True)
        lines, loads = _rows_until(self.partial, after.step)
        write_text(self.partial / "history.csv", "".join(lines))
        self._last, self._rows = after, len(loads)
        for before, now in zip(loads[:1] + loads, loads, strict=False):
            self._snapshot_due(before, now)
        self._index = _snapshots_until(self.partial, after.step)
        if self._index:
            self._write_indices()
        self._history = (self.partial / "history.csv").open("a", encoding="utf-8", newline="")

    # ------------------------------------------------------------------------------------ on the way

    def _write_row(self, values: Iterable[object]) -> None:
        """Flushed at once, so that a killed run still shows how far it came."""
        assert self._history is not None
        csv.writer(self._history, lineterminator="\n").writerow(values)
        self._history.flush()

    def record(self, record: "Record", discretisation: ObservedDiscretisation) -> None:
        """Append a good record to the history; write fields when they are due."""
        if not record.is_good:
            return
        before = self._last.u if self._last else record.u
        self.append(record.row())
        self._last = record
        if self._snapshot_due(before, record.u):
            self._write_snapshot(record.step, record.u, discretisation.fields())

    def append(self, row: Mapping[str, float]) -> None:
        """Append a row to the history, below its columns' names."""
        with writing(self.partial / "history.csv"):
            if not self._rows:
                self._write_row(row)
            self._write_row(row.values())
        self._rows += 1

    def _snapshot_due(self, before: float, now: float) -> bool:
        """True at the first record that reaches or passes a wanted load parameter."""
        slack = 1e-9 * max(abs(before), abs(now))
        low, high = min(before, now) - slack, max(before, now) + slack
        reached = [u for u in self._pending if low <= u <= high]
        self._pending = [u for u in self._pending if u not in reached]
        return bool(reached)

    def _write_snapshot(self, step: int, u: float, fields: "Fields") -> None:
        from verify.runs.vtk_files import describe, grid_mesh, points_mesh, write_mesh

        number = len(self._index)
        points_file, grid_file = f"fields/points_{number:04d}.vtu", f"fields/grid_{number:04d}.vtu"
        for file, mesh in ((points_file, points_mesh(fields)), (grid_file, grid_mesh(fields))):
            describe(mesh, u, self._units)
            write_file(self.partial / file, partial(write_mesh, mesh))
        self._index.append((number, step, u, points_file, grid_file))
        self._write_indices()

    def _write_indices(self) -> None:
        table = pd.DataFrame(self._index, columns=list(INDEX_COLUMNS))
        write_table(self.partial / "fields" / "index.csv", table)
        # ParaView wants times that grow, which displacements of a cyclic load do not.
        times = table["u"] if table["u"].is_monotonic_increasing and table["u"].is_unique else table["step"]
        for name in ("points", "grid"):
            text = _pvd_text([float(value) for value in times], table[f"{name}_file"].tolist())
            write_text(self.partial / f"{name}.pvd", text)

    def flush_to_disk(self) -> None:
        """The history so far outlives a power cut."""
        assert self._history is not None
        with writing(self.partial / "history.csv"):
            os.fsync(self._history.fileno())

    # ------------------------------------------------------------------------------------ at the end

    def finish(self, discretisation: ObservedDiscretisation, fields: "Fields") -> None:
        """Write the last good state as the last snapshot."""
        if self._last is not None and (not self._index or self._index[-1][1] != self._last.step):
            self._write_snapshot(self._last.step, self._last.u, fields)

    def add_state(self, row: Mapping[str, float], fields: "Fields") -> None:
        """Write fields that belong to a row of the history."""
        self._write_snapshot(int(row["step"]), float(row["u"]), fields)

    def _close_history(self) -> None:
        if self._history is not None:
            with writing(self.partial / "history.csv"):
                self._history.close()

    def close(self, info: dict[str, Any], crack_path: np.ndarray) -> None:
        """Write what is known at the end only, and give the folder its final name.

        Parameters
        ----------
        info : contents of run.json; number of increments and checksums of the files are added.
        crack_path : (n, 2) polyline in reference coordinates [case length unit]; n = 0 when nothing broke.
        """
        if not self._rows:
            self._write_row(HISTORY_COLUMNS)
        self._close_history()
        table = pd.DataFrame(np.asarray(crack_path, dtype=float).reshape(-1, 2), columns=["x", "y"])
        write_table(self.partial / "crack_path.csv", table)
        if not self._index:
            self._write_indices()
        with writing(self.partial):
            info = info | {"increments": self._rows, "checksums": self._checksums()}
        write_text(self.partial / "run.json", json.dumps(info, indent=2) + "\n")
        replace_folder(self.partial, self.folder)
        if RunStatus(info["status"]).good:
            for stopped in itertools.takewhile(Path.exists, self._places_aside()):
                shutil.rmtree(stopped, ignore_errors=True)

    def discard(self) -> None:
        """Leave nothing behind of a run that its solver refuses."""
        shutil.rmtree(self.partial, ignore_errors=True)

    def history(self) -> pd.DataFrame:
        """What has been written of it, without rows of a run that has none."""
        try:
            return pd.read_csv(self.partial / "history.csv")
        except pd.errors.EmptyDataError:
            return pd.DataFrame(columns=list(HISTORY_COLUMNS))

    def _checksums(self) -> dict[str, str]:
        files = ["history.csv", "crack_path.csv", "fields/index.csv"]
        files += [file for row in self._index for file in row[3:]]
        return {file: file_checksum(self.partial / file) for file in files}


def write_run(
    folder: Path,
    history: pd.DataFrame,
    crack_path: np.ndarray,
    info: dict[str, Any],
    states: "Mapping[int, Fields] | None" = None,
    units: "Units | None" = None,
) -> None:
    """Write the folder of a run of which a table of its history, a crack path (n, 2) and some fields are all there is.

    info : contents of run.json, as in `RunWriter.close`. states : row of the history -> fields. units : of the
    case
    """
    with RunWriter(folder, units=units) as files:
        files.start(None, "")
        for number, row in enumerate(history.to_dict("records")):
            named = {str(name): value for name, value in row.items()}
            files.append(named)
            if states and number in states:
                files.add_state(named, states[number])
        files.close(info, crack_path)


def _pvd_text(times: list[float], files: list[str]) -> str:
    """A ParaView collection: one data set for each of ``files``, at ``times``."""
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(root, "Collection")
    for time, file in zip(times, files, strict=True):
        ElementTree.SubElement(collection, "DataSet", timestep=repr(time), part="0", file=file)
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _rows_until(folder: Path, step: int) -> tuple[list[str], list[float]]:
    """Lines of a history up to the row of a step, the head first, and the rows' load parameters.

    Raises CheckpointError where the history does not reach it or is none.
    """
    with suppress(OSError, ValueError, IndexError):
        lines = (folder / "history.csv").read_text(encoding="utf-8").splitlines(keepends=True)
        rows = [line.split(",") for line in lines[1:] if line.endswith("\n")]
        steps = [row[HISTORY_COLUMNS.index("step")] for row in rows]
        number = steps.index(str(step)) + 1
        loads = [float(row[HISTORY_COLUMNS.index("u")]) for row in rows[:number]]
        return lines[: number + 1], loads
    raise CheckpointError(f"is of step {step}, which its history.csv does not reach")


def _snapshots_until(folder: Path, step: int) -> list[tuple[int, int, float, str, str]]:
    """Rows of the index of snapshots up to a step; CheckpointError where it is damaged."""
    try:
        index = pd.read_csv(folder / "fields" / "index.csv").astype({"step": int, "u": float})[list(INDEX_COLUMNS)]
    except FileNotFoundError:
        return []
    except (OSError, ValueError, KeyError) as error:
        raise CheckpointError("has a damaged fields/index.csv beside it") from error
    return list(index[index["step"] <= step].itertuples(index=False, name=None))
