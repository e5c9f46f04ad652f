"""Kinematic constraints: on grid nodes by elimination, or on material points by the penalty method (Appendix A)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cases import Case
from numerics.sparse_pattern import SymmetricPattern, gather_vector
from physics.exact import MOTIONS

from .active_grid import ActiveGrid
from .grid import GridError
from .placement import PointCloud

DIRECTIONS = {"x": 0, "y": 1}
#: a point stands on an edge when its own extent, with a little slack, reaches it
REACH = 0.53


@dataclass
class Motion:
    """Prescribed motion of a list of places: u = scale * load + value, or a named exact field.

    ``component`` is 0 or 1; ``tied`` places share one free displacement.
    """

    places: NDArray
    component: int
    positions: NDArray
    scale: float = 0.0
    value: float = 0.0
    field: str | None = None
    tied: bool = False

    def displacement(self, case: Case, load: float) -> NDArray:
        """Displacement component (n,) at a load."""
        if self.field is not None:
            return MOTIONS[self.field](case, self.positions, load)[:, self.component]
        return np.full(len(self.places), self.scale * load + self.value)

    def rate(self, case: Case, load: float) -> NDArray:
        """Change of the displacement with the load (n,)."""
        if self.field is None:
            return np.full(len(self.places), self.scale)
        step = 1e-6 * case.mesh.h
        return (self.displacement(case, load + step) - self.displacement(case, load - step)) / (2.0 * step)


def displacement_motions(case: Case, select, positions: NDArray) -> list[Motion]:
    """The case's displacement constraints on places chosen by ``select(boundary set) -> indices``."""
    motions = []
    for constraint in case.constraints:
        if constraint.direction == "phase":
            continue
        places = select(case.boundaries[constraint.on])
        if len(places) == 0:
            raise GridError(f"boundaries.{constraint.on}: no grid node or material point lies on it")
        directions = (0, 1) if constraint.motion else (DIRECTIONS[constraint.direction],)
        for component in directions:
            motions.append(
                Motion(
                    places, component, positions[places], constraint.scale or 0.0, constraint.value or 0.0,
                    constraint.motion, bool(constraint.tied),
                )
            )  # fmt: skip
    return motions


def points_on(case: Case, cloud: PointCloud):
    """Selector of material points on a boundary set."""

    def select(boundary) -> NDArray:
        box = case.bounding_box()
        edges = boundary.edges or ((boundary.edge,) if boundary.edge else ())
        if not edges:
            tolerance = 0.0 if boundary.box else 1.5 * REACH * np.sqrt(cloud.size.prod(axis=1))
            return np.flatnonzero(boundary.select(cloud.positions, tolerance, box))
        chosen = np.zeros(len(cloud.positions), bool)
        for edge in edges:
            across = 0 if edge in ("left", "right") else 1
            one = boundary.model_copy(update={"edge": edge, "edges": None})
            chosen |= one.select(cloud.positions, REACH * cloud.size[:, across], box)
        return np.flatnonzero(chosen)

    return select


def nodes_on(case: Case, nodes: NDArray):
    """Selector of grid nodes on a boundary set."""

    def select(boundary) -> NDArray:
        return np.flatnonzero(boundary.select(nodes, 1e-6 * case.mesh.h, case.bounding_box()))

    return select


class PointPenalty:
    """Motions prescribed on material points by stiff springs, Eqs. A.1-A.6.

    The list of springs is flat: motion after motion, point after point. Tied motions pull their points to one
    more unknown each, numbered after those of the grid.
    """

    def __init__(
        self,
        case: Case,
        motions: list[Motion],
        stiffness: NDArray,
        active: ActiveGrid,
        value: NDArray,
        equations: NDArray,
        size: int,
    ) -> None:
        self._case, self._motions, self._size = case, motions, size
        self._places = _joined([m.places for m in motions], int)
        self._component = _joined([np.full(len(m.places), m.component) for m in motions], int)
        self._stiffness = stiffness[self._places]
        self._value = value[self._places]
        nodes = active.nodes[active.cell[self._places]]
        self._equations = equations[2 * nodes + self._component[:, None]]
        tied = np.cumsum([m.tied for m in motions]) - 1
        masters = [np.full(len(m.places), t if m.tied else -1) for m, t in zip(motions, tied, strict=True)]
        self._master = _joined(masters, int)
        self._first_master = size - sum(m.tied for m in motions)

    @staticmethod
    def coupling(motions: list[Motion], equations: NDArray, grid_size: int) -> NDArray | None:
        """Pairs of equations that tied motions can couple beyond their cells."""
        tied = [m for m in motions if m.tied]
        if not tied:
            return None
        pairs = []
        for number, motion in enumerate(tied):
            column = equations[motion.component :: 2]
            column = column[column >= 0].astype(np.int64)
            pairs.append(np.column_stack([column, np.full(len(column), grid_size + number)]))
        return np.concatenate(pairs)

    def _targets(self, load: float, tied: NDArray) -> NDArray:
        prescribed = [
            np.zeros(len(m.places)) if m.tied else m.displacement(self._case, load) for m in self._motions
        ]
        targets = _joined(prescribed, float)
        is_tied = self._master >= 0
        targets[is_tied] = tied[self._master[is_tied]]
        return targets

    def _gap(self, displacement: NDArray, load: float, tied: NDArray) -> NDArray:
        return displacement[self._places, self._component] - self._targets(load, tied)

    def forces(self, displacement: NDArray, load: float, tied: NDArray) -> NDArray:
        """Spring forces (n_springs,), positive where the point is ahead of its target."""
        return self._stiffness * self._gap(displacement, load, tied)

    def residual(self, forces: NDArray) -> NDArray:
        """Forces of the springs on the equations (size,)."""
        total = gather_vector(self._equations, self._value * forces[:, None], self._size)
        is_tied = self._master >= 0
        np.add.at(total, self._first_master + self._master[is_tied], -forces[is_tied])
        return total

    def rates(self, load: float) -> NDArray:
        """Change of the targets with the load (n_springs,)."""
        return _joined([np.zeros(len(m.places)) if m.tied else m.rate(self._case, load) for m in self._motions], float)

    def add_stiffness(self, pattern: SymmetricPattern, values: NDArray) -> None:
        """Add the springs' stiffness to the stored entries of the tangent, in place (Eq. A.6)."""
        first, second = np.triu_indices(self._value.shape[1])
        rows, columns = self._equations[:, first], self._equations[:, second]
        products = self._stiffness[:, None] * self._value[:, first] * self._value[:, second]
        kept = (rows >= 0) & (columns >= 0)
        np.add.at(values, pattern.positions(rows[kept], columns[kept]), products[kept])
        is_tied = self._master >= 0
        if is_tied.any():
            self._add_tied_stiffness(pattern, values, is_tied)

    def _add_tied_stiffness(self, pattern: SymmetricPattern, values: NDArray, is_tied: NDArray) -> None:
        masters = self._first_master + self._master[is_tied]
        rows = self._equations[is_tied]
        columns = np.broadcast_to(masters[:, None], rows.shape)
        coupling = -self._stiffness[is_tied, None] * self._value[is_tied]
        kept = rows >= 0
        np.add.at(values, pattern.positions(rows[kept], columns[kept]), coupling[kept])
        np.add.at(values, pattern.positions(masters, masters), self._stiffness[is_tied])

    def constraint_error(self, displacement: NDArray, load: float, tied: NDArray) -> float:
        """Largest distance of a point from its target, relative to the largest target; 0 without load."""
        targets = self._targets(load, tied)
        largest = np.abs(targets).max(initial=0.0)
        if largest == 0.0:
            return 0.0
        return float(np.abs(self._gap(displacement, load, tied)).max() / largest)


def _joined(parts: list[NDArray], kind: type) -> NDArray:
    return np.concatenate(parts).astype(kind) if parts else np.zeros(0, kind)
