"""What acts on moving bodies from outside: prescribed velocities and tractions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cases import Case
from cases.boundaries import BoundarySet
from cases.course import Course
from cases.loads import Traction
from mpm.explicit.cell_splines import basis
from mpm.explicit.moving_body import MovingBody
from mpm.explicit.window import GridWindow
from mpm.grid import GridError
from mpm.loaded_places import into_pieces, loaded_places
from mpm.placement import PointCloud
from mpm.quasi_static.constraints import DIRECTIONS, PointsOn
from numerics.explicit import BlewUpError

#: an edge is shared out among its points in pieces, in multiples of the smallest point's extent
PIECE = 1.0 / 16.0
#: normal direction (0 for x, 1 for y) and corner of the bounding box of each edge
EDGE_NORMALS = {"left": (0, 0), "right": (0, 1), "bottom": (1, 0), "top": (1, 1)}


@dataclass
class HeldLine:
    """A line normal to an axis on which one component of a body's velocity is prescribed.

    On the line the velocity is a sum over the nodes across it, the same one for each row of nodes along it. Each row
    is corrected by the impulse that meets the prescribed velocity with the least change of kinetic energy: splines
    need not interpolate, and the line need not be one of the grid. The line goes with the prescribed velocity and stays
    where it is in the direction that is free: a body that leaves it there can no longer be held.

    Attributes
    ----------
    name : of the constraint. normal : direction across. place : coordinate there at the start [length].
    low, high : extent along the line. component, velocity : what is prescribed [length/time].
    rows, cells : first nodes of the rows along the line in the body's present window, and cells across it.
    """

    name: str
    body: MovingBody
    normal: int
    place: float
    low: float
    high: float
    component: int
    velocity: float
    course: Course | None = None
    rows: NDArray = field(default_factory=lambda: np.zeros(0, np.int64))
    cells: int = 0
    _rows_of: GridWindow | None = None
    _from_window: float = 0.0
    _place_now: float = 0.0

    def motion(self, times: NDArray, size: float) -> tuple[NDArray, NDArray]:
        """Velocities (n,) in steps that begin at times (n,), and places then across the body's window, in cells."""
        if self._rows_of is not self.body.window:
            self._find_rows()
        if self.course is None:
            velocities, so_far = np.full(len(times), self.velocity), self.velocity * times
        else:
            velocities = np.array([self.course.rate(now, now + size) for now in times])
            so_far = np.array([float(self.course.displacement(now)) for now in times])
        moved = so_far if self.component == self.normal else np.zeros(len(times))
        return velocities, self._from_window + moved / self.body.lattice.h

    def begin_step(self, now: float, size: float) -> None:
        """Take the velocity of a step from a time on, and the place then."""
        (velocity,), (place,) = self.motion(np.array([now]), size)
        self.velocity, self._place_now = float(velocity), float(place)

    def apply(self) -> float:
        """Correct the nodes' velocities; the impulse on the body along the component [force time].

        Raises BlewUpError where none of the body is left on the line.
        """
        window, order = self.body.window, self.body.lattice.order
        cell = math.floor(self._place_now + 1e-9)
        held, impulse = False, 0.0
        if 0 <= cell < self.cells:
            velocity = window.velocities.vx if self.component == 0 else window.velocities.vy
            held, impulse = hold(
                self.rows, cell * self.stride, self.stride, order, self._place_now - cell, window.sums.m, velocity,
                self.velocity,
            )  # fmt: skip
        if not held:
            raise self.lost()
        return impulse

    def lost(self) -> BlewUpError:
        """What to raise where none of the body is left on the line."""
        return BlewUpError(
            f"none of body '{self.body.name}' is left on the line of {self.name}; hold its other direction too, or"
            " make dynamics.end_time earlier"
        )

    @property
    def stride(self) -> int:
        """From node to node across the line."""
        return 1 if self.normal else self.body.window.width

    def _find_rows(self) -> None:
        """Rows of nodes along the line in the body's present window, and where the line is in it at the start."""
        window, lattice, along = self.body.window, self.body.lattice, 1 - self.normal
        number = window.corner[along] + np.arange(window.shape[along])
        places = lattice.origin[along] + lattice.h * (number - 0.5 * (lattice.order - 1))
        slack = (0.5 * lattice.order + 1e-9) * lattice.h
        rows = np.flatnonzero((places >= self.low - slack) & (places <= self.high + slack))
        self._rows_of, self.rows = window, rows * (window.width if along == 0 else 1)
        self._from_window = float((self.place - lattice.origin[self.normal]) / lattice.h - window.corner[self.normal])
        self.cells = int(window.shape[self.normal]) - lattice.order


@njit(cache=True)
def hold(rows, offset, stride, order, xi, mass, velocity, target):
    """Give each row of nodes the velocity ``target`` at a place of it.

    xi : the place in its cell, which begins at an offset from the row's first node. Returns whether any row has mass, and
    the sum of impulses.
    """
    any_mass, total = False, 0.0
    weights, slopes = np.empty(order + 1), np.empty(order + 1)
    basis(order + 1, xi, weights, slopes)
    for row in rows:
        start = row + offset
        present, flexibility = 0.0, 0.0
        for a in range(len(weights)):
            node = start + a * stride
            if mass[node] > 0.0:
                present += weights[a] * velocity[node]
                flexibility += weights[a] * weights[a] / mass[node]
        if flexibility > 0.0:
            any_mass = True
            impulse = (target - present) / flexibility
            for a in range(len(weights)):
                node = start + a * stride
                if mass[node] > 0.0:
                    velocity[node] += impulse * weights[a] / mass[node]
                    total += impulse * weights[a]
    return any_mass, total


def held_lines(case: Case, bodies: Sequence[MovingBody], cloud: PointCloud) -> list[HeldLine]:
    """The constraints of a case on its moving bodies; GridError for one that holds nothing."""
    select = PointsOn(case, cloud, at_edges=True)
    lines = []
    for number, constraint in enumerate(case.constraints):
        name = f"constraints[{number}].on = '{constraint.on}'"
        if constraint.direction == "phase":
            raise GridError(
                f"{case.source}: constraints[{number}].direction = 'phase': explicit material points hold no phase field;"
                ' remove it, draw a notch of kind = "history", or run the case with solver = "fem".'
            )
        component, velocity = DIRECTIONS[constraint.direction], constraint.velocity or 0.0
        for line, (normal, place, low, high) in _lines_of(case, case.boundaries[constraint.on], name):
            places, _ = select(line)
            reached = [bodies[n] for n in np.unique(cloud.body[places])]
            if not reached:
                raise GridError(f"{case.source}: {name}: no body reaches it; move it onto a body.")
            _refuse_free_rigid(case, f"{name}: it holds", reached)
            if all(body.keeps_velocity for body in reached):
                raise GridError(
                    f"{case.source}: {name}: it holds rigid bodies alone, which keep their velocity anyway; remove it, or"
                    " move it onto another body."
                )
            lines += [
                HeldLine(name, body, normal, place, low, high, component, velocity, constraint.course)
                for body in reached
                if not body.keeps_velocity
            ]
    return lines


def _refuse_free_rigid(case: Case, what: str, bodies: Sequence[MovingBody]) -> None:
    """Raise GridError where one moves as a rigid body, which gravity and contact alone may do to it."""
    free = next((body.name for body in bodies if not body.deforms and not body.keeps_velocity), None)
    if free is not None:
        raise GridError(
            f"{case.source}: {what} the rigid body '{free}', which moves as gravity and contact alone have it; move it"
            f" onto another body, or give bodies.{free}.rigid = false."
        )


def _lines_of(
    case: Case, boundary: BoundarySet, name: str
) -> Iterator[tuple[BoundarySet, tuple[int, float, float, float]]]:
    """The straight lines of a boundary set, each with its normal direction, place and extent."""
    edges = boundary.edges or ((boundary.edge,) if boundary.edge else ())
    box = case.bounding_box()
    for edge in edges:
        normal, corner = EDGE_NORMALS[edge]
        of_edge = boundary.model_copy(update={"edge": edge, "edges": None})
        yield of_edge, (normal, float(box[corner][normal]), -np.inf, np.inf)
    if edges:
        return
    if boundary.box:
        lower, upper = np.array(boundary.box.lower), np.array(boundary.box.upper)
        flat = np.flatnonzero(upper - lower <= 1e-9 * case.mesh.h)
        if len(flat) == 1:
            normal = int(flat[0])
            yield boundary, (normal, float(lower[normal]), float(lower[1 - normal]), float(upper[1 - normal]))
            return
    raise GridError(
        f"{case.source}: {name}: explicit material points are held along edges and flat boxes; choose one, or make the"
        " body rigid."
    )


@dataclass
class LoadedPoints:
    """Points of a body, by their numbers (n,), nearest to an edge on which a traction acts with forces (n, 2) in full."""

    body: MovingBody
    traction: Traction
    numbers: NDArray
    force: NDArray
    _places: NDArray = field(default_factory=lambda: np.zeros(0, np.int64))
    _sorted_in: GridWindow | None = None

    def places(self) -> NDArray:
        """Present indices (n,) of the points; they change when the body is sorted into another window."""
        if self._sorted_in is not self.body.window:
            number = self.body.points.number
            by_number = np.argsort(number)
            self._places = by_number[np.searchsorted(number[by_number], self.numbers)]
            self._sorted_in = self.body.window
        return self._places

    def spread(self, now: float) -> None:
        """Add the forces at a time to those of the nodes."""
        body, motion, chosen = self.body, self.body.points.motion, self.places()
        fx, fy = (self.traction.share(now) * self.force).T
        # not at their edges: where a point has just entered a cell, the nodes there have little mass from it
        x, y = motion.x[chosen], motion.y[chosen]
        body.transfers.spread(x, y, fx, fy, body.window.width, body.window.tractions)


class Tractions:
    """Tractions along boundary sets, on the points nearest to the drawn edges there; they go with the points."""

    def __init__(self, case: Case, bodies: Sequence[MovingBody], cloud: PointCloud) -> None:
        pieces = partial(into_pieces, PIECE * float(cloud.size.min()))
        self._loads: list[LoadedPoints] = []
        self.lengths: list[float] = []
        for number, traction in enumerate(case.tractions):
            places = loaded_places(case, number, cloud, pieces)
            self.lengths.append(places.length)
            points, of_place = np.unique(places.points, return_inverse=True)
            force = np.stack([np.bincount(of_place, part) for part in places.force.T], axis=1)
            for n, body in enumerate(bodies):
                own = cloud.body[points] == n
                if own.any():
                    _refuse_free_rigid(case, f"tractions[{number}].on = '{traction.on}': it pulls at", [body])
                    self._loads.append(LoadedPoints(body, traction, points[own], force[own]))
        self._bodies = list({id(load.body): load.body for load in self._loads}.values())

    def add(self, now: float) -> None:
        """Add the forces at a time to those on the nodes."""
        for body in self._bodies:
            for array in body.window.tractions:
                array[:] = 0.0
        for load in self._loads:
            load.spread(now)
        for body in self._bodies:
            sums, tractions = body.window.sums, body.window.tractions
            sums.fields[2::4] += tractions.x
            sums.fields[3::4] += tractions.y

    def power(self) -> float:
        """Of the tractions in this step, on the mean of the velocities before and after it."""
        total = 0.0
        for body in self._bodies:
            forces, v = body.window.tractions, body.window.velocities
            total += float(0.5 * (forces.x * (v.old_x + v.vx) + forces.y * (v.old_y + v.vy)).sum())
        return total
