"""Constraints of a case on the nodes of a mesh, by elimination."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.course import Course
from cases.errors import MeshError
from numerics.built import Holds
from physics.exact import MOTIONS

DIRECTIONS: dict[str | None, int] = {"x": 0, "y": 1, "phase": 2}


class NodeConstraints:
    """Which displacement and phase field unknowns are prescribed or tied, and to what.

    Displacement unknowns are numbered 2 node + component. Two constraints may meet at a node where they ask the same of
    it. Raises MeshError for a constraint that holds no node and for two that contradict each other.

    Attributes
    ----------
    equations : (2 n_nodes,) equation number, -1 where prescribed, shared where tied; ``size`` is their number.
    prescribed : (2 n_nodes,) displacement unknowns without an equation.
    phase_prescribed, phase_value : (n_nodes,) where the phase field is held, and at what; 1 elsewhere.
    """

    def __init__(self, case: Case, nodes: NDArray) -> None:
        self._case, self._nodes = case, nodes
        n_nodes = len(nodes)
        self._scale, self._value = np.zeros(2 * n_nodes), np.zeros(2 * n_nodes)
        self._motions: list[tuple[str, NDArray]] = []
        self._courses: list[tuple[Course, NDArray]] = []
        self.phase_value = np.ones(n_nodes)
        prescribed, phase_prescribed = np.zeros(2 * n_nodes, bool), np.zeros(n_nodes, bool)
        master, tied = np.arange(2 * n_nodes), np.zeros(2 * n_nodes, bool)
        holder = np.full((3, n_nodes), -1)
        for number, constraint in enumerate(case.constraints):
            selected = self._nodes_of(number)
            self._refuse_contradictions(holder, number, selected)
            if constraint.motion is not None:
                self._motions.append((constraint.motion, selected))
                prescribed[2 * selected] = prescribed[2 * selected + 1] = True
            elif constraint.direction == "phase":
                phase_prescribed[selected], self.phase_value[selected] = True, constraint.value
            else:
                unknowns = 2 * selected + DIRECTIONS[constraint.direction]
                if constraint.tied:
                    master[unknowns], tied[unknowns] = unknowns[0], True
                else:
                    prescribed[unknowns] = True
                    if constraint.course is not None:
                        self._courses.append((constraint.course, unknowns))
                    self._scale[unknowns], self._value[unknowns] = constraint.scale or 0.0, constraint.value or 0.0
        self.prescribed, self.phase_prescribed = prescribed, phase_prescribed
        self.equations = _number(prescribed, master)
        self.size = int(self.equations.max()) + 1

    def _nodes_of(self, number: int) -> NDArray:
        """Nodes (n,) that a constraint holds."""
        case, on = self._case, self._case.constraints[number].on
        selected = np.flatnonzero(case.boundaries[on].select(self._nodes, 1e-6 * case.mesh.h, box=case.bounding_box()))
        if not len(selected):
            raise MeshError(
                f"{case.source}: constraints[{number}].on = '{on}': no node of the mesh lies on it, so it would hold"
                " nothing; move it onto a body, within one along lines of nodes, or make mesh.h smaller than it"
            )
        return selected

    def _refuse_contradictions(self, holder: NDArray, number: int, selected: NDArray) -> None:
        """Note in ``holder`` (3, n_nodes) which constraint holds x, y and the phase field of each node."""
        constraint = self._case.constraints[number]
        for direction in (0, 1) if constraint.motion else (DIRECTIONS[constraint.direction],):
            for other in np.unique(holder[direction, selected]):
                if other >= 0 and not constraint.asks_the_same(self._case.constraints[other]):
                    place = self._nodes[selected[holder[direction, selected] == other][0]].tolist()
                    raise MeshError(
                        f"{self._case.source}: constraints[{other}] and constraints[{number}] hold the node at {place}"
                        " in the same direction and contradict each other; leave it out of one of the two boundary sets"
                    )
            holder[direction, selected] = number

    def holds(self, part: NDArray) -> Holds:
        """What they hold of nodes in connected parts (n_nodes,)."""
        shared = np.bincount(self.equations[self.equations >= 0], minlength=self.size) > 1
        tied = (self.equations >= 0) & np.append(shared, False)[self.equations]
        unknowns = np.flatnonzero(self.prescribed | tied)
        group = np.where(self.prescribed, -1, self.equations)[unknowns]
        return Holds(self._nodes[unknowns // 2], unknowns % 2, part[unknowns // 2], group)

    def prescribed_values(self, load: float) -> NDArray:
        """Values (2 n_nodes,) at a load; only the prescribed ones mean anything."""
        values = self._scale * load + self._value
        for name, nodes in self._motions:
            displacement = MOTIONS[name](self._case, self._nodes[nodes], load)
            values[2 * nodes], values[2 * nodes + 1] = displacement.T
        for course, unknowns in self._courses:
            values[unknowns] = course.displacement(load)
        return values

    def prescribed_velocity(self) -> NDArray:
        """Constant velocities (2 n_nodes,) of the prescribed unknowns of a moving case [length/time], zero elsewhere."""
        velocity = np.zeros(2 * len(self._nodes))
        for number, constraint in enumerate(self._case.constraints):
            if constraint.velocity is not None:
                velocity[2 * self._nodes_of(number) + DIRECTIONS[constraint.direction]] = constraint.velocity
        return velocity

    def prescribe_velocity(self, velocity: NDArray, start: float, end: float) -> None:
        """Set those of unknowns that follow a table, in a velocity (2 n_nodes,) between two times, in place."""
        for course, unknowns in self._courses:
            velocity[unknowns] = course.rate(start, end)

    def prescribed_rates(self, load: float, towards: float) -> NDArray:
        """Change of the prescribed values with the load (2 n_nodes,) on the way to another one, zero where free."""
        rates = self._scale.copy()
        step = 1e-6 * self._case.mesh.h
        for name, nodes in self._motions:
            ahead, behind = (MOTIONS[name](self._case, self._nodes[nodes], load + s) for s in (step, -step))
            rates[2 * nodes], rates[2 * nodes + 1] = (ahead - behind).T / (2.0 * step)
        for course, unknowns in self._courses if towards != load else ():
            rates[unknowns] = course.rate(load, towards)
        return np.where(self.prescribed, rates, 0.0)


def _number(prescribed: NDArray, master: NDArray) -> NDArray:
    """Equation numbers of the free unknowns, in order; tied ones share their master's."""
    free = ~prescribed & (master == np.arange(len(master)))
    numbers = np.where(free, np.cumsum(free) - 1, -1)
    return np.where(prescribed, -1, numbers[master]).astype(np.int32)
