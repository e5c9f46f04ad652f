"""Frames of a moving run: light pictures of its points in ``<run>/frames``, many more than there are full snapshots.

Each frame is a compressed file of single-precision arrays: some of the points with what is to be seen of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from verify.runs.atomic import write_file
from verify.runs.listeners import Listener, ObservedDiscretisation

if TYPE_CHECKING:
    from numerics.fields import Fields
    from numerics.records import Record

#: points in a frame: more are not told apart on a screen
MOST_POINTS = 60_000


@dataclass(frozen=True)
class Frame:
    """Points at one time: reference and displacement (n, 2) [length], phase field and in-plane mean stress (n,)."""

    time: float
    reference: NDArray
    displacement: NDArray
    phase_field: NDArray
    hydrostatic_stress: NDArray


class FrameWriter(Listener):
    """Writes the frames that are due."""

    def __init__(self, folder: Path, times: Sequence[float]) -> None:
        self._folder, self._due = folder, list(enumerate(times))

    def start(self, after: Record | None, note: str) -> None:
        """Those up to a record behind which the run goes on are there."""
        self._reached(after)

    def _reached(self, record: Record | None) -> list[int]:
        """Numbers of the frames whose times a record reaches, which are due no longer."""
        reached = [number for number, time in self._due if record and time <= record.u * (1.0 + 1e-9)]
        self._due = self._due[len(reached) :]
        return reached

    def record(self, record: Record, discretisation: ObservedDiscretisation) -> None:
        """Write the frame whose time this record reaches, if there is one."""
        reached = self._reached(record) if record.is_good else []
        if not reached:
            return
        self._folder.mkdir(exist_ok=True)
        arrays = _arrays(discretisation.fields())
        write_file(
            self._folder / f"frame_{reached[-1]:04d}.npz",
            lambda path: np.savez_compressed(path, time=record.u, **arrays),  # type: ignore[arg-type]
        )


def _arrays(fields: Fields) -> dict[str, NDArray]:
    every = -(-len(fields.reference) // MOST_POINTS)
    arrays = {
        "reference": fields.reference,
        "displacement": fields.displacement,
        "phase_field": fields.phase_field,
        "hydrostatic_stress": 0.5 * (fields.stress[:, 0] + fields.stress[:, 1]),
    }
    return {name: values[::every].astype(np.float32) for name, values in arrays.items()}


def read_frames(run: Path) -> Iterator[Frame]:
    """Frames of a run folder in the order of time; none where it has none."""
    for file in sorted((run / "frames").glob("frame_*.npz")):
        with np.load(file, allow_pickle=False) as arrays:
            told = dict(arrays)
        yield Frame(time=float(told.pop("time")), **told)
