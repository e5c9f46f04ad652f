"""Frictional contact of bodies that share grid nodes (thesis 6.3.2.2)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cases import Case
from mpm.explicit.body_surface import BodySurface
from mpm.explicit.moving_body import MovingBody

#: relative round-off allowed in the checks C.1 to C.4
ROUND_OFF = 1e-9
#: own normals whose difference is shorter than this do not tell a direction
SHORTEST_NORMAL = 1e-6
#: nodes in contact, and those of them at which a condition of Algorithm 3 did not hold
COUNTERS = ("contact_nodes", "contact_C1", "contact_C2", "contact_C3", "contact_C4")
#: passes over the pairs where a node may belong to more than two bodies
SWEEPS = 5


@dataclass
class Touching:
    """Nodes that a pair of bodies shares in this step.

    ``nodes`` (2, n) in each body's window; ``normal`` (2, n) outwards of the first body, ``gap`` (n,) [length];
    ``opposed`` (n,) where the bodies' own normals oppose each other, as those of two that meet do (C.1).
    """

    nodes: NDArray
    normal: NDArray
    gap: NDArray
    opposed: NDArray


class ContactSide(NamedTuple):
    """One body at the nodes (n,) that it shares: their numbers in its window, inverse masses, 0 of a rigid body, and the
    velocities of all nodes of its window."""

    nodes: NDArray
    inverse_mass: NDArray
    vx: NDArray
    vy: NDArray


class Impulses(NamedTuple):
    """Outcome of a meeting: normal impulses ``pushes`` (n,) at the nodes, ``totals`` of the impulse x, y on the second
    body and of the work on both, and ``counts`` of nodes as `COUNTERS`."""

    pushes: NDArray
    totals: NDArray
    counts: NDArray

    @classmethod
    def none(cls, n_nodes: int) -> Impulses:
        """Before bodies meet at nodes."""
        return cls(np.zeros(n_nodes), np.zeros(3), np.zeros(len(COUNTERS), np.int64))


class Contact:
    """All pairs of bodies of a case.

    Attributes
    ----------
    work : of friction on all bodies together since the start, at most zero [energy]. The normal forces' is left to the
        balance of energy: what a step takes on the grid, FLIP gives back to the points.
    impulse : (n_bodies, 2) that contact has given to each body since the start [force time].
    violations : numbers of nodes by the names of `COUNTERS`.
    """

    def __init__(self, case: Case, bodies: Sequence[MovingBody]) -> None:
        self._bodies, self._by_distance = bodies, case.contact.by_distance
        self._surfaces = [BodySurface(body) for body in bodies]
        pairs = combinations(range(len(bodies)), 2)
        self._pairs = [(a, b, case.friction(a, b)) for a, b in pairs if not (bodies[a].rigid and bodies[b].rigid)]
        self._sweeps = 1 if len(bodies) == 2 else SWEEPS
        self.work, self.work_of_rigid = 0.0, 0.0
        self.impulse = np.zeros((len(bodies), 2))
        self.violations: Counter[str] = Counter()
        self._touching: list[tuple[int, int, float, Touching]] = []
        #: push on rigid bodies by columns of nodes since the last record, and between the last two [force time]
        self._floor_load: dict[int, float] = {}
        self._last_floor_load: dict[int, float] = {}

    def warm_up(self) -> None:
        """Compile what contact needs."""
        for surface in self._surfaces:
            first = np.zeros(1, np.int64)
            surface.find_mass_slopes([first])
            surface.reach(first, np.zeros((2, 1)))
        a, b = self._bodies[:2]
        shared_nodes(a, b)
        none, nothing = np.zeros(0, np.int64), np.zeros(0)
        one, two = (ContactSide(none, nothing, *body.window.velocities[2:4]) for body in (a, b))
        meet(one, two, np.zeros((2, 0)), nothing, np.zeros(0, bool), 0.0, Impulses.none(0))

    def detect(self) -> None:
        """Nodes with mass of two bodies (Remark 1), their collinear normals (6.34) and the gaps there."""
        found = []
        for a, b, friction in self._pairs:
            nodes = shared_nodes(self._bodies[a], self._bodies[b])
            if nodes.shape[1]:
                found.append((a, b, friction, nodes))
        for number in {n for a, b, _, _ in found for n in (a, b)}:
            own = [nodes[int(number == b)] for a, b, _, nodes in found if number in (a, b)]
            self._surfaces[number].find_mass_slopes(own)
        self._touching = [(a, b, mu, touching) for a, b, mu, nodes in found if (touching := self._touch(a, b, nodes))]

    def _touch(self, a: int, b: int, nodes: NDArray) -> Touching | None:
        first, second = self._surfaces[a], self._surfaces[b]
        own_first, own_second = first.outward_normals(nodes[0]), second.outward_normals(nodes[1])
        # the corners of a soft body are rounded on the grid: where one is rigid, its normal holds
        normal = (not second.body.rigid) * own_first - (not first.body.rigid) * own_second
        length = np.hypot(*normal)
        opposed = (own_first * own_second).sum(axis=0) <= 0.0
        kept = length > SHORTEST_NORMAL
        if not kept.any():
            return None
        nodes, normal = nodes[:, kept], normal[:, kept] / length[kept]
        gap = np.zeros(nodes.shape[1])
        if self._by_distance:
            gap = -first.reach(nodes[0], normal) - second.reach(nodes[1], -normal)
        return Touching(nodes, normal, gap, opposed[kept])

    def exchange(self, step: float) -> None:
        """Correct the nodes' velocities by the contact forces (Eqs. 6.28 to 6.40)."""
        for _ in range(self._sweeps):
            for a, b, friction, touching in self._touching:
                self._meet(a, b, friction, touching, step)
        if self._sweeps > 1:
            for a, b, _, touching in self._touching:
                self._check_impenetrability(a, b, touching, step)

    def _meet(self, a: int, b: int, friction: float, touching: Touching, step: float) -> None:
        first, second = self._bodies[a], self._bodies[b]
        impulses = Impulses.none(touching.nodes.shape[1])
        meet(
            self._side(a, touching.nodes[0]), self._side(b, touching.nodes[1]), touching.normal,
            np.maximum(touching.gap, 0.0) / step, touching.opposed, friction, impulses,
        )  # fmt: skip
        pushes, totals, counts = impulses
        if first.rigid or second.rigid:
            columns = first.window.corner[0] + touching.nodes[0] // first.window.width
            for column, push in zip(columns.tolist(), pushes.tolist(), strict=True):
                self._floor_load[column] = self._floor_load.get(column, 0.0) + push
        self.impulse[a] -= totals[:2]
        self.impulse[b] += totals[:2]
        self.work += totals[2]
        for body, sign in ((first, 1.0), (second, -1.0)):
            if body.rigid:  # what moves it gives as much as it hands on
                self.work_of_rigid += sign * float(totals[:2] @ body.rigid_velocity)
        for name, count in zip(COUNTERS, counts, strict=True):
            self.violations[name] += int(count)

    def _side(self, number: int, nodes: NDArray) -> ContactSide:
        velocities = self._bodies[number].window.velocities
        return ContactSide(nodes, self._surfaces[number].inverse_mass(nodes), velocities.vx, velocities.vy)

    def begin_record(self) -> None:
        """Keep the loads on rigid bodies since the last record apart."""
        self._last_floor_load, self._floor_load = self._floor_load, {}

    def pressure_on_floor(self, order: int) -> dict[str, float]:
        """Half-width and peak of the pressure on a rigid floor along x between the last two records.

        The half-width is that of an ellipse with the load's second moment, less that of the splines that spread it.
        Both are empty without load; widths in cells, the peak as a share of the whole load for each cell.
        """
        place, load = np.array(sorted(self._last_floor_load.items())).reshape(-1, 2).T
        if not load.sum() > 0.0:
            return {}
        share = load / load.sum()
        moment = share @ (place - share @ place) ** 2 - (order + 1) / 12.0
        return {"half_width": 2.0 * float(np.sqrt(max(moment, 0.0))), "peak": float(share.max())}

    def checkpoint(self) -> dict[str, NDArray]:
        """Sums since the start and since the last record."""
        loads = {"floor_load": self._floor_load, "last_floor_load": self._last_floor_load}
        arrays = {name: np.array(list(load.items())).reshape(-1, 2) for name, load in loads.items()}
        return arrays | {
            "work": np.array([self.work, self.work_of_rigid]), "impulse": self.impulse.copy(),
            "violations": np.array([self.violations[name] for name in COUNTERS]),
        }  # fmt: skip

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to a checkpoint."""
        self.work, self.work_of_rigid = map(float, saved["work"])
        self.impulse = saved["impulse"].copy()
        self.violations = Counter(dict(zip(COUNTERS, saved["violations"].tolist(), strict=True)))
        floor_loads = (saved[name].tolist() for name in ("floor_load", "last_floor_load"))
        self._floor_load, self._last_floor_load = ({int(column): push for column, push in load} for load in floor_loads)

    def _check_impenetrability(self, a: int, b: int, touching: Touching, step: float) -> None:
        """C.3 once more: another pair may have pushed this one together again."""
        first, second = self._bodies[a].window.velocities, self._bodies[b].window.velocities
        ia, ib = touching.nodes
        relative = np.array([first.vx[ia] - second.vx[ib], first.vy[ia] - second.vy[ib]])
        approach = (relative * touching.normal).sum(axis=0)
        speed = np.hypot(first.vx[ia], first.vy[ia]) + np.hypot(second.vx[ib], second.vy[ib])
        allowed = np.maximum(touching.gap, 0.0) / step
        self.violations["contact_C3"] += int(np.count_nonzero(approach > allowed + 1e-3 * speed))


def shared_nodes(first: MovingBody, second: MovingBody) -> NDArray:
    """Nodes (2, n) at which both bodies have mass, numbered in each one's window."""
    one, two = first.window, second.window
    corner = np.maximum(one.corner, two.corner)
    end = np.minimum(one.corner + one.shape, two.corner + two.shape)
    if (end <= corner).any():
        return np.zeros((2, 0), np.int64)
    (ia, ja), (ib, jb) = corner - one.corner, corner - two.corner
    extent = end - corner
    return _shared(one.sums.m, one.width, ia, ja, two.sums.m, two.width, ib, jb, extent[0], extent[1])


@njit(cache=True)
def _shared(mass_a, width_a, ia, ja, mass_b, width_b, ib, jb, n_x, n_y):
    found = np.empty((2, n_x * n_y), np.int64)
    count = 0
    for i in range(n_x):
        for j in range(n_y):
            a, b = (ia + i) * width_a + ja + j, (ib + i) * width_b + jb + j
            if mass_a[a] > 0.0 and mass_b[b] > 0.0:
                found[0, count], found[1, count] = a, b
                count += 1
    return found[:, :count].copy()


@njit(cache=True)
def meet(first, second, normal, allowed, opposed, friction, impulses):
    """Impulses between two bodies at their shared nodes, and the checks of Algorithm 3.

    ``first, second`` : `ContactSide`. ``allowed`` (n,) is the normal speed at which the gap closes within the step.
    """
    nodes_a, inverse_a, vxa, vya = first
    nodes_b, inverse_b, vxb, vyb = second
    pushes, totals, counts = impulses
    for n in range(len(nodes_a)):
        a, b, nx, ny = nodes_a[n], nodes_b[n], normal[0, n], normal[1, n]
        rx, ry = vxa[a] - vxb[b], vya[a] - vyb[b]
        approach = rx * nx + ry * ny - allowed[n]
        if approach <= 0.0:  # Eq. 6.40
            continue
        reduced = 1.0 / (inverse_a[n] + inverse_b[n])
        push = reduced * approach  # Eqs. 6.32, 6.35, times the step
        pushes[n] = push
        slip = -rx * ny + ry * nx
        stick = reduced * slip  # Eq. 6.37
        drag = min(friction * push, abs(stick)) * np.sign(stick)  # Eq. 6.38
        jx, jy = push * nx - drag * ny, push * ny + drag * nx  # Eq. 6.39
        before = np.array([vxa[a], vya[a], vxb[b], vyb[b]])
        vxa[a] -= inverse_a[n] * jx
        vya[a] -= inverse_a[n] * jy
        vxb[b] += inverse_b[n] * jx
        vyb[b] += inverse_b[n] * jy
        totals[0] += jx
        totals[1] += jy
        totals[2] -= drag * (slip - drag * (inverse_a[n] + inverse_b[n]))
        counts[0] += 1
        counts[1] += not opposed[n]
        speed = abs(rx) + abs(ry)
        if inverse_a[n] > 0.0 and inverse_b[n] > 0.0:
            lost = (vxa[a] - before[0]) / inverse_a[n] + (vxb[b] - before[2]) / inverse_b[n]
            lost = abs(lost) + abs((vya[a] - before[1]) / inverse_a[n] + (vyb[b] - before[3]) / inverse_b[n])
            scale = (abs(before[0]) + abs(before[1])) / inverse_a[n] + (abs(before[2]) + abs(before[3])) / inverse_b[n]
            counts[2] += lost > ROUND_OFF * (scale + abs(jx) + abs(jy))
        rx, ry = vxa[a] - vxb[b], vya[a] - vyb[b]
        largest = np.abs(before).max() + speed
        counts[3] += abs(rx * nx + ry * ny - allowed[n]) > ROUND_OFF * largest
        slides = abs(-rx * ny + ry * nx) > ROUND_OFF * largest
        counts[4] += slides and abs(abs(drag) - friction * push) > ROUND_OFF * push
