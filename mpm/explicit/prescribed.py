"""What acts on moving bodies from outside: prescribed velocities and tractions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cases import Case
from cases.boundaries import BoundarySet
from cases.loading import Traction
from mpm.explicit.kernels import spline_values
from mpm.explicit.moving_body import MovingBody
from mpm.grid import GridError
from mpm.placement import PointCloud
from mpm.quasi_static.constraints import DIRECTIONS, PointsOn

#: normal direction (0 for x, 1 for y) and corner of the bounding box of each edge
EDGE_NORMALS = {"left": (0, 0), "right": (0, 1), "bottom": (1, 0), "top": (1, 1)}


@dataclass
class HeldLine:
    """A line normal to an axis on which one component of a body's velocity is prescribed.

    On the line the velocity is a sum over the nodes across it, the same one for each row of nodes along it. Each row
    is corrected by the impulse that meets the prescribed velocity with the least change of kinetic energy: splines
    need not interpolate, and the line need not be one of the grid.

    Attributes
    ----------
    normal : direction across. place : coordinate there at the start [length]. low, high : extent along the line.
    component, velocity : what is prescribed [length/time].
    """

    body: MovingBody
    normal: int
    place: float
    low: float
    high: float
    component: int
    velocity: float

    def apply(self, now: float) -> float:
        """Correct the nodes' velocities at a time; the impulse on the body along the component [force time]."""
        body = self.body
        moved = self.velocity * now if self.component == self.normal else 0.0
        across = (self.place + moved - body.origin[self.normal]) / body.h - body.corner[self.normal]
        cell = int(np.floor(across + 1e-9))
        if not 0 <= cell <= body.shape[self.normal] - 1 - body.order:
            return 0.0
        value = spline_values(body.order, across - cell)
        along = 1 - self.normal
        places = body.origin[along] + body.h * (
            body.corner[along] + np.arange(body.shape[along]) - 0.5 * (body.order - 1)
        )
        slack = (0.5 * body.order + 1e-9) * body.h
        rows = np.flatnonzero((places >= self.low - slack) & (places <= self.high + slack))
        steps = (body.width, 1)
        first = rows * steps[along] + cell * steps[self.normal]
        velocity = body.grid.vx if self.component == 0 else body.grid.vy
        return hold(first, steps[self.normal], value, body.grid.m, velocity, self.velocity)


@njit(cache=True)
def hold(first, stride, weights, mass, velocity, target):
    """Give each row of nodes the weighted velocity ``target``; returns the sum of the impulses."""
    total = 0.0
    for start in first:
        present, flexibility = 0.0, 0.0
        for a in range(len(weights)):
            node = start + a * stride
            if mass[node] > 0.0:
                present += weights[a] * velocity[node]
                flexibility += weights[a] * weights[a] / mass[node]
        if flexibility > 0.0:
            impulse = (target - present) / flexibility
            for a in range(len(weights)):
                node = start + a * stride
                if mass[node] > 0.0:
                    velocity[node] += impulse * weights[a] / mass[node]
                    total += impulse * weights[a]
    return total


def held_lines(case: Case, bodies: Sequence[MovingBody], cloud: PointCloud) -> list[HeldLine]:
    """The constraints of a case on its moving bodies."""
    select = PointsOn(case, cloud, at_edges=True)
    lines = []
    for number, constraint in enumerate(case.constraints):
        if constraint.direction == "phase":
            raise GridError(
                f"{case.source}: constraints[{number}].direction = 'phase': explicit material points hold no phase field;"
                ' remove it, draw a notch of kind = "history", or run the case with solver = "fem".'
            )
        boundary = case.boundaries[constraint.on]
        component, velocity = DIRECTIONS[constraint.direction], constraint.velocity or 0.0
        places, _ = select(boundary)
        held = set(np.unique(cloud.body[places]).tolist())
        if not held:
            raise GridError(f"{case.source}: boundaries.{constraint.on}: no body reaches it; move it onto a body.")
        for normal, place, low, high in _lines_of(case, boundary, number):
            lines += [
                HeldLine(body, normal, place, low, high, component, velocity)
                for n, body in enumerate(bodies)
                if n in held and not body.rigid
            ]
    return lines


def _lines_of(case: Case, boundary: BoundarySet, number: int) -> list[tuple[int, float, float, float]]:
    """Normal direction, place and extent of the straight lines of a boundary set."""
    edges = boundary.edges or ((boundary.edge,) if boundary.edge else ())
    if edges:
        box = case.bounding_box()
        normals = [EDGE_NORMALS[edge] for edge in edges]
        return [(normal, float(box[corner][normal]), -np.inf, np.inf) for normal, corner in normals]
    if boundary.box:
        lower, upper = np.array(boundary.box.lower), np.array(boundary.box.upper)
        flat = np.flatnonzero(upper - lower <= 1e-9 * case.mesh.h)
        if len(flat) == 1:
            normal = int(flat[0])
            return [(normal, float(lower[normal]), float(lower[1 - normal]), float(upper[1 - normal]))]
    raise GridError(
        f"{case.source}: constraints[{number}].on: explicit material points are held along edges and flat boxes;"
        " choose one, or make the body rigid."
    )


class Tractions:
    """Tractions along boundary sets, on the points that have an edge there; they go with the points."""

    def __init__(self, case: Case, bodies: Sequence[MovingBody], cloud: PointCloud) -> None:
        select, box = PointsOn(case, cloud, at_edges=True), case.bounding_box()
        self._loads: list[tuple[MovingBody, Traction, NDArray, NDArray]] = []
        for number, traction in enumerate(case.tractions):
            boundary = case.boundaries[traction.on]
            if boundary.edge is None:
                raise GridError(f"{case.source}: tractions[{number}].on: give a boundary set of one edge.")
            normal, corner = EDGE_NORMALS[boundary.edge]
            places, offset = select(boundary)
            # a point inside that lies on the same line, of another body, has no edge there
            kept = np.abs(cloud.positions[places, normal] + offset[:, normal] - box[corner][normal]) < 1e-9 * case.mesh.h
            places = places[kept]
            area = cloud.size[places, 1 - normal] * case.plane.thickness
            for n, body in enumerate(bodies):
                own = cloud.body[places] == n
                if own.any():
                    self._loads.append((body, traction, places[own], area[own]))
        self._bodies = list({id(load[0]): load[0] for load in self._loads}.values())

    def add(self, now: float) -> None:
        """Add the forces at a time to those on the nodes."""
        for body in self._bodies:
            body.grid.ex[:], body.grid.ey[:] = 0.0, 0.0
        for body, traction, numbers, area in self._loads:
            share = traction.share(now)
            chosen = body.places_of(numbers)
            # not at their edges: where a point has just entered a cell, the nodes there have little mass from it
            x, y = body.points.x[chosen], body.points.y[chosen]
            force_x, force_y = share * traction.value[0] * area, share * traction.value[1] * area
            grid = body.grid
            body.kernels.spread(x, y, force_x, force_y, body.width, grid.ex, grid.ey)
        for body in self._bodies:
            body.grid.fx += body.grid.ex
            body.grid.fy += body.grid.ey

    def power(self) -> float:
        """Of the tractions in this step, on the mean of the velocities before and after it."""
        grids = [body.grid for body in self._bodies]
        return sum(float(0.5 * (g.ex * (g.old_x + g.vx) + g.ey * (g.old_y + g.vy)).sum()) for g in grids)
