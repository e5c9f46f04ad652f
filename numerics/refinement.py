"""Fine cells follow the crack: where it has gone into coarse ones the increment is redone on a finer grid."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from cases import Case
from cases.spacing import cell_sizes

from .fields import Fields
from .staggered import QuasiStaticDiscretisation

#: material is on its way to break below this phase field; coarse cells bear more than fine ones before it falls further
DAMAGED = 0.9
#: cells larger than this many times h are coarse
COARSE = 1.5
#: the fine box goes on beyond the damage, in multiples of the length scale
AHEAD = 8.0


class Refinable(QuasiStaticDiscretisation, Protocol):
    """A discretisation that can begin with the state of another one of the same case."""

    def take_over(self, other: Any) -> None:
        """Begin with the committed state of ``other``, whose grid is another one."""


class FollowingDiscretisation:
    """A discretisation that is rebuilt with a larger fine box whenever the crack has left it.

    All that a discretisation offers is that of the present one; ``refine`` replaces it.
    """

    def __init__(self, make: Callable[[Case], Refinable], case: Case) -> None:
        self._make, self._case, self._present = make, case, make(case)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._present, name)

    def refine(self) -> bool:
        """Whether the trial state has damage in coarse cells: then the last good state is on a finer grid."""
        case = with_larger_fine_box(self._case, self._present.fields())
        if case is None:
            return False
        self._present.undo()
        self._build(case)
        self.costs.count["refinements"] += 1
        return True

    def _build(self, case: Case) -> None:
        finer, before = self._make(case), self._present
        finer.take_over(before)
        for name, value in before.costs.count.items():
            # sizes are those of the present grid
            if name not in finer.costs.count:
                finer.costs.count[name] = value
        for name, seconds in before.costs.seconds.items():
            finer.costs.seconds[name] = finer.costs.seconds.get(name, 0.0) + seconds
        finer.costs.until = before.costs.until
        self._case, self._present = case, finer

    def checkpoint(self) -> dict[str, NDArray]:
        """The state and the fine box that it was computed on."""
        fine = self._case.mesh.fine
        assert fine is not None
        return {**self._present.checkpoint(), "fine": np.array([fine.lower, fine.upper])}

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to the state and the grid of a checkpoint."""
        self._case = _with_fine_box(self._case, saved["fine"][0], saved["fine"][1])
        self._present = self._make(self._case)
        self._present.restore(saved)


def with_larger_fine_box(case: Case, fields: Fields) -> Case | None:
    """The case with a fine box that holds the damage and what lies before it; None where it does already."""
    fine = case.mesh.fine
    damaged = fields.reference[(fields.phase_field < DAMAGED)]
    if fine is None or not len(damaged):
        return None
    outside = damaged[(cell_sizes(case, damaged) > COARSE * case.mesh.h).any(axis=1)]
    if not len(outside):
        return None
    lengths = [m.fracture.length_scale for m in case.materials.values() if m.fracture]
    ahead = AHEAD * max(lengths)
    lower, upper = np.array(fine.lower, float), np.array(fine.upper, float)
    # whole cells further, so that the lines of the present box stay
    below = np.ceil(np.maximum(0.0, lower - (outside.min(axis=0) - ahead)) / case.mesh.h)
    above = np.ceil(np.maximum(0.0, outside.max(axis=0) + ahead - upper) / case.mesh.h)
    return _with_fine_box(case, lower - below * case.mesh.h, upper + above * case.mesh.h)


def _with_fine_box(case: Case, lower: NDArray, upper: NDArray) -> Case:
    assert case.mesh.fine is not None
    corners = {"lower": tuple(map(float, lower)), "upper": tuple(map(float, upper))}
    mesh = case.mesh.model_copy(update={"fine": case.mesh.fine.model_copy(update=corners)})
    return case.model_copy(update={"mesh": mesh})


def carried(
    places: NDArray, points: NDArray, displacement: NDArray, gradient: NDArray
) -> tuple[NDArray, NDArray]:
    """Nearest point (n,) of each of the places (n, 2), and the displacement (n, 2) there by its gradient (m, 4)."""
    nearest = np.asarray(KDTree(points).query(places)[1])
    distance = places - points[nearest]
    moved = displacement[nearest] + np.einsum("nij,nj->ni", gradient[nearest].reshape(-1, 2, 2), distance)
    return nearest, moved
