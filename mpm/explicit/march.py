"""Many steps in one compiled call, for bodies that neither break nor are pulled at: what Python would do for each step
costs as much as that of some thousand points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cases import Case
from mpm.explicit.contact import Contact
from mpm.explicit.fused_contact import (
    FAR,
    FIRST_NODE,
    INVERSES,
    LAG,
    LAW,
    PLACE,
    REACH,
    SPEED,
    VELOCITY,
    ContactState,
    ListedBodies,
    ListedPairs,
)  # fmt: skip
from mpm.explicit.fused_step import ALONE, MANY, NO_LINE, PAIR, Driving, ListedLines, Scheme, steps_of
from mpm.explicit.listed_arrays import ListedArrays, Sorting
from mpm.explicit.moving_body import MovingBody
from mpm.explicit.prescribed import HeldLine
from mpm.explicit.rigid_body import BodyOfKeptVelocity, FreeRigidBody
from mpm.explicit.rigid_contact import FREE, KEPT, OWN_MASS
from numerics.explicit import BlewUpError
from physics.moving_frame import MovingFrame

#: steps of points in one call, a few tenths of a second: in between a run can be stopped
MOST_POINT_STEPS = 4_000_000


class March:
    """Steps of a case in compiled code."""

    def __init__(
        self, case: Case, bodies: Sequence[MovingBody], contact: Contact, lines: Sequence[HeldLine], frame: MovingFrame
    ) -> None:
        assert case.dynamics is not None
        self._bodies, self._contact, self._lines, self._frame = bodies, contact, lines, frame
        dynamics, lattice = case.dynamics, bodies[0].lattice
        self._scheme = Scheme(
            lattice.h, lattice.origin.astype(float), dynamics.flip, dynamics.rotation == "corotational",
            float(dynamics.affine), dynamics.order_of_update == "musl", case.contact.by_distance, contact.sweeps,
            not frame.at_rest,
        )  # fmt: skip
        simple = len(bodies) == 2 and not any(pair.is_free_rigid for pair in contact.pairs)
        self._steps = steps_of(lattice.order, ALONE if not contact.pairs else PAIR if simple else MANY)
        self._most = max(1, MOST_POINT_STEPS // sum(len(body.points.number) for body in bodies))
        self._listed: list[object] = []
        self._error: BlewUpError | None = None

    def go(self, times: NDArray, size: float, work: NDArray) -> int:
        """Take some of the steps that begin at times (n,), at least one, and tell how many.

        ``work`` (3,) takes the work from outside, its power in the last step, and that on the nodes. Raises BlewUpError.
        """
        if self._error is not None:
            raise self._error
        for body in self._bodies:
            body.keep_sorted(size)
        self._list_anew()
        times = times[: self._most]
        in_lines = np.zeros((2, len(self._lines), len(times)))
        for n, line in enumerate(self._lines):
            in_lines[:, n] = line.motion(times, size)
        driving = Driving(self._frame.accelerations(times + 0.5 * size), self._frame.dampings(times), in_lines)
        self._take_in()
        done, lost = self._steps(
            self._table, self._pairs, self._contact_state(), self._line_table, driving, self._scheme, size, work
        )
        self._hand_out()
        if lost != NO_LINE:
            self._error = self._lines[lost].lost()
            if not done:
                raise self._error
        return int(done)

    def _list_anew(self) -> None:
        """List bodies, pairs and lines where arrays of a body are others than they were."""
        held: list[object] = []
        for pair in self._contact.pairs:
            pair.overlap()
            held.append(pair.touching)
        for body in self._bodies:
            p = body.points
            held += [body.window, body.wandering.fastest, p.matter, p.motion, p.gradient, p.elastic]
        if len(held) == len(self._listed) and all(new is old for new, old in zip(held, self._listed, strict=True)):
            return
        self._table, self._pairs = self._list_bodies(), self._list_pairs()
        self._line_table = self._list_lines()
        self._listed = held

    def _list_bodies(self) -> ListedBodies:
        rows, whole, numbers = [], np.zeros((len(self._bodies), 5), np.int64), np.zeros((len(self._bodies), 9))
        self._arms = [body.arms() if isinstance(body, FreeRigidBody) else np.zeros((0, 2)) for body in self._bodies]
        for n, (body, arms) in enumerate(zip(self._bodies, self._arms, strict=True)):
            p, window = body.points, body.window
            sorting = Sorting(window.starts, window.strips, body.wandering.fastest, arms)
            groups = (p.matter, p.motion, p.gradient, p.elastic, window.sums, window.velocities, window.surface, sorting)
            rows.append([array for group in groups for array in group])
            whole[n] = _kind(body), window.width, *window.corner, True
            numbers[n, LAW : LAW + 2] = body.law[:2]
            numbers[n, FIRST_NODE : FIRST_NODE + 2] = window.first_node(body.lattice)
        rigid = np.zeros((len(self._bodies), 4, 3))
        return ListedBodies(ListedArrays.of(rows), whole, numbers, rigid, self._contact.kept_velocities)

    def _list_pairs(self) -> ListedPairs:
        pairs = self._contact.pairs
        overlaps = [pair.overlap() for pair in pairs]
        corners = [(overlap.corner_in_one, overlap.corner_in_two) for overlap in overlaps]
        whole = [(*pair.numbers, *pair.holds, pair.on_floor, pair.is_free_rigid) for pair in pairs]
        return ListedPairs(
            ListedArrays.of([pair.touching for pair in pairs]), np.array(whole, np.int64).reshape(-1, 6),
            np.array([pair.friction for pair in pairs], float), np.array(corners, np.int64).reshape(-1, 2, 2),
            np.array([overlap.extent for overlap in overlaps], np.int64).reshape(-1, 2), np.zeros(len(pairs), np.int64),
            np.zeros(sum(len(pair.touching.gap) for pair in pairs), np.int64),
        )  # fmt: skip

    def _contact_state(self) -> ContactState:
        """Sums of contact, with room for the load on floors."""
        contact = self._contact
        for pair in contact.pairs:
            if pair.on_floor:
                contact.make_room_on_floor(pair)
        return ContactState(contact.sums, contact.floor_load.push, contact.floor_load.first)

    def _list_lines(self) -> ListedLines:
        for line in self._lines:
            line.motion(np.zeros(0), 1.0)
        number = {id(body): n for n, body in enumerate(self._bodies)}
        first = np.cumsum([0, *(len(line.rows) for line in self._lines)]).tolist()
        whole = [
            (number[id(line.body)], line.component, line.stride, line.cells, first[n], first[n + 1])
            for n, line in enumerate(self._lines)
        ]
        rows = np.concatenate([np.zeros(0, np.int64), *(line.rows for line in self._lines)])
        return ListedLines(np.array(whole, np.int64).reshape(-1, 6), rows)

    def _take_in(self) -> None:
        """Numbers of the bodies into the table."""
        numbers, rigid = self._table.numbers, self._table.rigid
        for n, body in enumerate(self._bodies):
            numbers[n, FAR], numbers[n, SPEED] = body.wandering.far, body.wandering.largest_speed
            numbers[n, LAG : LAG + 2] = body.lag
            if isinstance(body, FreeRigidBody):
                rigid[n, VELOCITY], rigid[n, PLACE], rigid[n, INVERSES, :2] = body.velocity, body.place, body.inverses
                numbers[n, REACH] = body.reach

    def _hand_out(self) -> None:
        """And back to the bodies."""
        numbers, rigid = self._table.numbers, self._table.rigid
        for n, body in enumerate(self._bodies):
            body.wandering.far, body.wandering.largest_speed = numbers[n, FAR : SPEED + 1].tolist()
            body.lag = numbers[n, LAG : LAG + 2].copy()
            if isinstance(body, FreeRigidBody):
                body.velocity[:], body.place[:] = rigid[n, VELOCITY], rigid[n, PLACE]
        for pair, count in zip(self._contact.pairs, self._pairs.counts.tolist(), strict=True):
            pair.count = count


def _kind(body: MovingBody) -> int:
    """What carries its nodes."""
    if isinstance(body, FreeRigidBody):
        return FREE
    return KEPT if isinstance(body, BodyOfKeptVelocity) else OWN_MASS
