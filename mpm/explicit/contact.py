"""Frictional contact of bodies that share grid nodes (thesis 6.3.2.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cases import Case
from mpm.explicit.body_surface import find_gaps, find_mass_slopes, find_normals, find_reach
from mpm.explicit.listed_arrays import Touching
from mpm.explicit.moving_body import MovingBody
from mpm.explicit.rigid_body import BodyOfKeptVelocity
from mpm.explicit.rigid_contact import RigidSide, count_impulses, press, rigid_side
from mpm.explicit.transfers import before_step
from mpm.explicit.window import GridWindow, NodeVelocities

#: relative round-off allowed in the checks C.1 to C.4
ROUND_OFF = 1e-9
#: and relative speed of approach that other pairs may leave
LEFT_BY_OTHERS = 1e-3
#: nodes in contact, and those of them at which a condition of Algorithm 3 did not hold
COUNTERS = ("contact_nodes", "contact_C1", "contact_C2", "contact_C3", "contact_C4")
#: passes over the pairs where a node may belong to more than two bodies, and the most where one of them is free and rigid
SWEEPS, MOST_SWEEPS = 5, 100


class ContactSide(NamedTuple):
    """One body where it meets another: masses and velocities of all nodes of its window, its number, and whether it keeps
    its velocity."""

    mass: NDArray
    velocities: NodeVelocities
    number: int
    keeps_velocity: bool

    @classmethod
    def of(cls, number: int, body: MovingBody) -> ContactSide:
        """The body of a number as it is now."""
        return cls(body.window.sums.m, body.window.velocities, number, body.keeps_velocity)


class ContactSums(NamedTuple):
    """Since the start: impulse (n_bodies, 2) on each body, work (3,) of friction and of pressure on all and of what moves
    bodies that keep their velocity, and numbers (5,) of nodes as `COUNTERS`."""

    impulse: NDArray
    work: NDArray
    counts: NDArray


class Overlap(NamedTuple):
    """Nodes that two windows have in common: their first one (2,) in each, how many (2,) in each direction and in all."""

    one: GridWindow
    two: GridWindow
    corner_in_one: NDArray
    corner_in_two: NDArray
    extent: NDArray
    size: int

    @classmethod
    def of(cls, one: GridWindow, two: GridWindow) -> Overlap:
        """That of two windows of one lattice."""
        corner = np.maximum(one.corner, two.corner)
        extent = np.minimum(one.corner + one.shape, two.corner + two.shape) - corner
        return cls(one, two, corner - one.corner, corner - two.corner, extent, int(extent[0] * extent[1]))


class FloorLoad(NamedTuple):
    """Push (n,) on bodies that keep their velocity by columns of the lattice's nodes from a first one on [force time].

    It is NaN where nothing has touched.
    """

    first: int
    push: NDArray

    @classmethod
    def nowhere(cls) -> FloorLoad:
        """Without columns."""
        return cls(0, np.zeros(0))

    @classmethod
    def of_table(cls, table: NDArray) -> FloorLoad:
        """From columns and pushes (n, 2)."""
        if not len(table):
            return cls.nowhere()
        columns = table[:, 0].astype(np.int64)
        load = cls(int(columns.min()), np.full(np.ptp(columns) + 1, np.nan))
        load.push[columns - load.first] = table[:, 1]
        return load

    def table(self) -> NDArray:
        """Columns that were touched, and their pushes (n, 2)."""
        touched = np.flatnonzero(~np.isnan(self.push))
        return np.column_stack([touched + float(self.first), self.push[touched]])

    def over(self, window: GridWindow) -> FloorLoad:
        """The same with room for the columns of a window."""
        low, high = int(window.corner[0]), int(window.corner[0] + window.shape[0])
        if not len(self.push):
            return FloorLoad(low, np.full(high - low, np.nan))
        before, behind = max(0, self.first - low), max(0, high - self.first - len(self.push))
        if before or behind:
            return FloorLoad(self.first - before, np.pad(self.push, (before, behind), constant_values=np.nan))
        return self


class Pair:
    """Two bodies that may touch.

    Attributes
    ----------
    numbers : (2,) of them. friction : between them. touching, count : nodes that they share, and how many.
    is_free_rigid : one of them moves freely as a rigid body. on_floor : one of them keeps its velocity.
    holds : (2,) whose normal alone holds.
    """

    def __init__(self, case: Case, a: int, b: int, bodies: Sequence[MovingBody]) -> None:
        self.numbers, self.friction = (a, b), case.friction(a, b)
        self._bodies = (bodies[a], bodies[b])
        keeps, other_keeps = (body.keeps_velocity for body in self._bodies)
        self.on_floor = keeps or other_keeps
        self.is_free_rigid = any(not body.deforms and not body.keeps_velocity for body in self._bodies)
        # the corners of other bodies are rounded on the grid: the normal of one that keeps its velocity holds
        first, second = (body.keeps_velocity or body.name == case.contact.normals_of for body in self._bodies)
        self.holds = (first and not other_keeps, second and not keeps)
        self.touching, self.count = Touching.room(0), 0
        self._overlap = Overlap.of(*(body.window for body in self._bodies))

    def share(self) -> bool:
        """Find the nodes at which both bodies have mass (Remark 1), numbered in each one's window; whether any is."""
        (one, two), overlap, self.count = (body.window for body in self._bodies), self.overlap(), 0
        if overlap.extent[0] <= 0 or overlap.extent[1] <= 0:
            return False
        self.count = share_nodes(
            one.sums.m, one.width, overlap.corner_in_one, two.sums.m, two.width, overlap.corner_in_two, overlap.extent,
            self.touching.nodes,
        )  # fmt: skip
        return self.count > 0

    def overlap(self) -> Overlap:
        """Of the present windows, with room for its nodes."""
        one, two = (body.window for body in self._bodies)
        if one is not self._overlap.one or two is not self._overlap.two:
            self._overlap = Overlap.of(one, two)
        if (self._overlap.extent > 0).all() and self._overlap.size > len(self.touching.gap):
            self.touching = Touching.room(self._overlap.size)
        return self._overlap

    def own_nodes(self, number: int) -> NDArray:
        """The shared nodes (n,) in the window of one of the two."""
        return self.touching.nodes[self.numbers.index(number), : self.count]

    def touch(self, by_distance: bool) -> None:
        """Collinear normals (6.34) and gaps at the shared nodes."""
        first, second = self._bodies
        surfaces = first.window.surface, second.window.surface
        self.count = find_normals(*surfaces, *self.holds, self.touching, self.count)
        if by_distance and self.count:
            find_reach(first)
            find_reach(second)
            find_gaps(*surfaces, first.lattice.h, self.touching, self.count)

    def sides(self) -> tuple[ContactSide, ContactSide]:
        """Both bodies as they are now."""
        first, second = (ContactSide.of(n, body) for n, body in zip(self.numbers, self._bodies, strict=True))
        return first, second

    def rigid_sides(self) -> tuple[RigidSide, RigidSide]:
        """The same where one of them moves freely as a rigid body."""
        first, second = (rigid_side(n, body) for n, body in zip(self.numbers, self._bodies, strict=True))
        return first, second


class Contact:
    """All pairs of bodies of a case.

    Attributes
    ----------
    work, work_of_friction : of contact on all bodies together since the start, and its tangential part [energy]. It is
        what impulses do on the mean of the relative velocities with which the bodies go before and after the step.
    pairs : of bodies that may touch, of which one does not keep its velocity.
    impulse : (n_bodies, 2) that contact has given to each body since the start [force time].
    violations : numbers of nodes by the names of `COUNTERS`.
    sums : all of these. kept_velocities : (n_bodies, 2) of those that keep theirs. sweeps : over the pairs in a step.
    floor_load : since the last record.
    """

    def __init__(self, case: Case, bodies: Sequence[MovingBody]) -> None:
        self._bodies, self._by_distance = bodies, case.contact.by_distance
        pairs = combinations(range(len(bodies)), 2)
        self.pairs = [
            Pair(case, a, b, bodies) for a, b in pairs if not (bodies[a].keeps_velocity and bodies[b].keeps_velocity)
        ]
        self.sweeps = 1 if len(bodies) == 2 else SWEEPS
        self.sums = ContactSums(np.zeros((len(bodies), 2)), np.zeros(3), np.zeros(len(COUNTERS), np.int64))
        kept = [body.velocity if isinstance(body, BodyOfKeptVelocity) else np.zeros(2) for body in bodies]
        self.kept_velocities = np.array(kept)
        self.floor_load, self._last_floor_load = FloorLoad.nowhere(), FloorLoad.nowhere()

    @property
    def work(self) -> float:
        """See above."""
        return float(self.sums.work[0] + self.sums.work[1])

    @property
    def work_of_friction(self) -> float:
        """See above."""
        return float(self.sums.work[0])

    @property
    def work_of_rigid(self) -> float:
        """What moves bodies that keep their velocity gives as much as they hand on, since the start [energy]."""
        return float(self.sums.work[2])

    @property
    def impulse(self) -> NDArray:
        """See above."""
        return self.sums.impulse

    @property
    def violations(self) -> dict[str, int]:
        """See above."""
        return dict(zip(COUNTERS, self.sums.counts.tolist(), strict=True))

    def warm_up(self) -> None:
        """Compile what contact needs, whether or not bodies touch."""
        for pair in self.pairs[:1]:
            pair.share()
            pair.touching, pair.count = Touching.room(1), 1
            for number in pair.numbers:
                find_mass_slopes(self._bodies[number], [pair.own_nodes(number)])
                find_reach(self._bodies[number])
            pair.touch(by_distance=True)
            first, second = (self._bodies[number].window.surface for number in pair.numbers)
            find_gaps(first, second, 1.0, pair.touching, 0)
            pair.count = 0
            self._meet(pair, 1.0)
            count_work(*pair.sides(), pair.touching, 0, self.sums.work)
            check_impenetrability(*pair.sides(), pair.touching, 0, 1.0, self.sums.counts)

    def detect(self) -> None:
        """Nodes with mass of two bodies (Remark 1), their collinear normals (6.34) and the gaps there."""
        found = [pair for pair in self.pairs if pair.share()]
        for number in sorted({number for pair in found for number in pair.numbers}):
            own = [pair.own_nodes(number) for pair in found if number in pair.numbers]
            find_mass_slopes(self._bodies[number], own)
        for pair in found:
            pair.touch(self._by_distance)

    def exchange(self, step: float) -> None:
        """Correct the nodes' velocities by the contact forces (Eqs. 6.28 to 6.40)."""
        touching = [pair for pair in self.pairs if pair.count]
        rigid = [pair for pair in touching if pair.is_free_rigid]
        for sweep in range(MOST_SWEEPS):
            moved = [self._press(pair, step) for pair in rigid]
            for pair in touching:
                if not pair.is_free_rigid:
                    self._meet(pair, step)
            if sweep + 1 >= self.sweeps and (len(touching) == 1 or not any(moved)):
                break
        for pair in touching:
            if pair.is_free_rigid:
                self._count_impulses(pair, step)
            else:
                count_work(*pair.sides(), pair.touching, pair.count, self.sums.work)
            self._load_floor(pair)
            if self.sweeps > 1 and not pair.is_free_rigid:
                check_impenetrability(*pair.sides(), pair.touching, pair.count, step, self.sums.counts)

    def _press(self, pair: Pair, step: float) -> bool:
        """Solve for the impulses of a pair with a free rigid body; whether they have changed."""
        passes = press(*pair.rigid_sides(), pair.touching, pair.count, step, pair.friction)
        return bool(passes > 1)

    def _meet(self, pair: Pair, step: float) -> None:
        meet(*pair.sides(), pair.touching, pair.count, step, pair.friction, self.kept_velocities, self.sums)

    def _count_impulses(self, pair: Pair, step: float) -> None:
        count_impulses(
            *pair.rigid_sides(), pair.touching, pair.count, step, pair.friction, self.kept_velocities, self.sums
        )  # fmt: skip

    def _load_floor(self, pair: Pair) -> None:
        if pair.on_floor:
            self.make_room_on_floor(pair)
            window = self._bodies[pair.numbers[0]].window
            first = int(window.corner[0]) - self.floor_load.first
            load_floor(pair.touching, pair.count, first, window.width, self.floor_load.push)

    def make_room_on_floor(self, pair: Pair) -> None:
        """For the load of a pair of which one body keeps its velocity."""
        self.floor_load = self.floor_load.over(self._bodies[pair.numbers[0]].window)

    def begin_record(self) -> None:
        """Keep the loads on bodies that keep their velocity since the last record apart."""
        self._last_floor_load, self.floor_load = self.floor_load, FloorLoad.nowhere()

    def pressure_on_floor(self, order: int) -> dict[str, float]:
        """Half-width and peak of the pressure on a rigid floor along x between the last two records.

        The half-width is that of an ellipse with the load's second moment, less that of the splines that spread it.
        Both are empty without load; widths in cells, the peak as a share of the whole load for each cell.
        """
        place, load = self._last_floor_load.table().T
        if not load.sum() > 0.0:
            return {}
        share = load / load.sum()
        moment = share @ (place - share @ place) ** 2 - (order + 1) / 12.0
        return {"half_width": 2.0 * float(np.sqrt(max(moment, 0.0))), "peak": float(share.max())}

    def checkpoint(self) -> dict[str, NDArray]:
        """Sums since the start and since the last record."""
        loads = {"floor_load": self.floor_load, "last_floor_load": self._last_floor_load}
        arrays = {name: load.table() for name, load in loads.items()}
        return arrays | {name: array.copy() for name, array in self.sums._asdict().items()}

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to a checkpoint."""
        for name, array in self.sums._asdict().items():
            array[:] = saved[name]
        self.floor_load = FloorLoad.of_table(saved["floor_load"])
        self._last_floor_load = FloorLoad.of_table(saved["last_floor_load"])


@njit(cache=True)
def load_floor(touching, count, first, width, push):
    """Add the step's impulses to those of the columns of nodes (n,), of which the window's first one has a number."""
    for n in range(count):
        column = first + touching.nodes[0, n] // width
        push[column] = (0.0 if np.isnan(push[column]) else push[column]) + touching.pushes[n]


@njit(cache=True)
def share_nodes(mass_a, width_a, corner_a, mass_b, width_b, corner_b, extent, nodes):
    """Write the nodes at which both bodies have mass to ``nodes`` (2, m), and tell how many.

    They lie within an extent (2,) from a corner (2,) in each window.
    """
    count = 0
    for i in range(extent[0]):
        a, b = (corner_a[0] + i) * width_a + corner_a[1], (corner_b[0] + i) * width_b + corner_b[1]
        for j in range(extent[1]):
            if mass_a[a + j] > 0.0 and mass_b[b + j] > 0.0:
                nodes[0, count], nodes[1, count] = a + j, b + j
                count += 1
    return count


@njit(cache=True)
def check_impenetrability(first, second, touching, count, step, counts):
    """C.3 once more: another pair may have pushed this one together again."""
    one, two = first.velocities, second.velocities
    for n in range(count):
        a, b = touching.nodes[0, n], touching.nodes[1, n]
        nx, ny = touching.normal[0, n], touching.normal[1, n]
        approach = (one.vx[a] - two.vx[b]) * nx + (one.vy[a] - two.vy[b]) * ny
        speed = np.hypot(one.vx[a], one.vy[a]) + np.hypot(two.vx[b], two.vy[b])
        counts[3] += approach > max(touching.gap[n], 0.0) / step + LEFT_BY_OTHERS * speed


@njit(forceinline=True)
def _mean_velocity(side, node):
    """Of those with which a side's node goes before and after the step."""
    v = side.velocities
    if side.keeps_velocity:
        return v.vx[node], v.vy[node]
    x, y = before_step(v.last_x[node], v.old_x[node]), before_step(v.last_y[node], v.old_y[node])
    return 0.5 * (v.vx[node] + x), 0.5 * (v.vy[node] + y)


@njit(cache=True)
def count_work(first, second, touching, count, work):
    """Add the work (2,) of the step's friction and pressure on both bodies."""
    for n in range(count):
        (ax, ay), (bx, by) = _mean_velocity(first, touching.nodes[0, n]), _mean_velocity(second, touching.nodes[1, n])
        nx, ny, x, y = touching.normal[0, n], touching.normal[1, n], ax - bx, ay - by
        work[0] -= touching.drags[n] * (y * nx - x * ny)
        work[1] -= touching.pushes[n] * (x * nx + y * ny)


@njit(cache=True)
def meet(first, second, touching, count, step, friction, kept_velocities, sums):
    """Add impulses between two bodies at their shared nodes to ``touching``; the checks of Algorithm 3.

    ``first, second`` : `ContactSide`. A gap may close within the step.
    """
    vxa, vya, number_a = first.velocities.vx, first.velocities.vy, first.number
    vxb, vyb, number_b = second.velocities.vx, second.velocities.vy, second.number
    total_x = total_y = 0.0
    for n in range(count):
        a, b = touching.nodes[0, n], touching.nodes[1, n]
        nx, ny, allowed = touching.normal[0, n], touching.normal[1, n], max(touching.gap[n], 0.0) / step
        rx, ry = vxa[a] - vxb[b], vya[a] - vyb[b]
        approach = rx * nx + ry * ny - allowed
        if approach <= 0.0:  # Eq. 6.40
            continue
        inverse_a = 0.0 if first.keeps_velocity else 1.0 / first.mass[a]
        inverse_b = 0.0 if second.keeps_velocity else 1.0 / second.mass[b]
        reduced = 1.0 / (inverse_a + inverse_b)
        push = reduced * approach  # Eqs. 6.32, 6.35, times the step
        touching.pushes[n] += push
        slip = -rx * ny + ry * nx
        stick = reduced * slip  # Eq. 6.37
        drag = min(friction * push, abs(stick)) * np.sign(stick)  # Eq. 6.38
        touching.drags[n] += drag
        jx, jy = push * nx - drag * ny, push * ny + drag * nx  # Eq. 6.39
        before = vxa[a], vya[a], vxb[b], vyb[b]
        vxa[a] -= inverse_a * jx
        vya[a] -= inverse_a * jy
        vxb[b] += inverse_b * jx
        vyb[b] += inverse_b * jy
        total_x += jx
        total_y += jy
        after = vxa[a], vya[a], vxb[b], vyb[b]
        sums.counts[0] += 1
        sums.counts[1] += not touching.opposed[n]
        if inverse_a > 0.0 and inverse_b > 0.0:
            sums.counts[2] += not _momentum_is_kept(before, after, inverse_a, inverse_b, abs(jx) + abs(jy))
        largest = max(abs(before[0]), abs(before[1]), abs(before[2]), abs(before[3])) + abs(rx) + abs(ry)
        rx, ry = after[0] - after[2], after[1] - after[3]
        sums.counts[3] += abs(rx * nx + ry * ny - allowed) > ROUND_OFF * largest
        slides = abs(-rx * ny + ry * nx) > ROUND_OFF * largest
        sums.counts[4] += slides and abs(abs(drag) - friction * push) > ROUND_OFF * push
    given = total_x * kept_velocities[number_a, 0] + total_y * kept_velocities[number_a, 1]
    given -= total_x * kept_velocities[number_b, 0] + total_y * kept_velocities[number_b, 1]
    sums.work[2] += given
    sums.impulse[number_a, 0] -= total_x
    sums.impulse[number_a, 1] -= total_y
    sums.impulse[number_b, 0] += total_x
    sums.impulse[number_b, 1] += total_y


@njit(forceinline=True)
def _momentum_is_kept(before, after, inverse_a, inverse_b, size):
    """C.2, against velocities of both bodies x, y before and after and the size of the impulse."""
    lost = abs((after[0] - before[0]) / inverse_a + (after[2] - before[2]) / inverse_b)
    lost += abs((after[1] - before[1]) / inverse_a + (after[3] - before[3]) / inverse_b)
    scale = (abs(before[0]) + abs(before[1])) / inverse_a + (abs(before[2]) + abs(before[3])) / inverse_b
    return lost <= ROUND_OFF * (scale + size)
