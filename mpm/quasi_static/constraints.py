"""Kinematic constraints: on grid nodes by elimination, or on the body by the penalty method (Appendix A).

The thesis holds the material points nearest to an edge, which lie a little inside the body. Holding the points'
edges instead - the displacement there, by the basis of the point's cell - leaves no such offset.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.boundaries import BoundarySet, nearest_on_segment
from cases.course import Course
from cases.geometry import Circle
from cases.messages import sentence
from mpm.grid import Grid, GridError
from mpm.placement import PointCloud
from mpm.quasi_static.point_basis import PointBasis
from numerics.built import Holds
from numerics.closing import ClosingFaces
from numerics.sparse_pattern import SymmetricPattern, gather_vector
from physics.elasticity import MaterialTable
from physics.exact import MOTIONS

DIRECTIONS: dict[str | None, int] = {"x": 0, "y": 1}
#: a point stands on an edge when its own extent, with a little slack, reaches it
REACH = 0.53

#: way in cells beyond which nodes that stay hold points that move the less: a bar of ten cells pressed by so much has an
#: error of 4 %, by a cell 29 %
NODES_HOLD = 0.25
#: share of the largest target of the path so far below which targets are next to nothing: on a way back through zero
UNMOVED = 1e-3


@dataclass
class PrescribedMotion:
    """Prescribed motion of a list of places: u = scale * load + value, a table, or a named exact field.

    ``places`` are nodes or points, held at ``positions`` (n, 2), which are ``offset`` (n, 2) away from the points.
    ``component`` is 0 or 1; ``tied`` places share one free displacement.
    """

    places: NDArray
    offset: NDArray
    component: int
    positions: NDArray
    scale: float = 0.0
    value: float = 0.0
    field: str | None = None
    tied: bool = False
    course: Course | None = None

    def displacement(self, case: Case, load: float) -> NDArray:
        """Displacement component (n,) at a load."""
        if self.field is not None:
            return MOTIONS[self.field](case, self.positions, load)[:, self.component]
        if self.course is not None:
            return np.full(len(self.places), float(self.course.displacement(load)))
        return np.full(len(self.places), self.scale * load + self.value)

    def rate(self, case: Case, load: float, towards: float) -> NDArray:
        """Change of the displacement with the load (n,) on the way to another one."""
        if self.course is not None:
            return np.full(len(self.places), self.course.rate(load, towards) if towards != load else 0.0)
        if self.field is None:
            return np.full(len(self.places), self.scale)
        step = 1e-6 * case.mesh.h
        return (self.displacement(case, load + step) - self.displacement(case, load - step)) / (2.0 * step)


Pair = tuple[float, float]
#: chooses the places of a boundary set: (indices (n,), offsets (n, 2))
Selector = Callable[[BoundarySet], tuple[NDArray, NDArray]]


def displacement_motions(case: Case, select: Selector, positions: NDArray) -> list[PrescribedMotion]:
    """The case's displacement constraints on the places that ``select`` finds among ``positions`` (n, 2)."""
    motions: list[PrescribedMotion] = []
    holder = np.full((2, len(positions)), -1)
    for number, constraint in enumerate(case.constraints):
        if constraint.direction == "phase":
            continue
        places, offset = select(case.boundaries[constraint.on])
        if len(places) == 0:
            raise GridError(
                f"{case.source}: boundaries.{constraint.on}: no grid node or material point lies on it;"
                " move it onto a body"
            )
        directions = (0, 1) if constraint.motion else (DIRECTIONS[constraint.direction],)
        for component in directions:
            _refuse_contradictions(case, number, component, places, holder)
        motions += [
            PrescribedMotion(
                places, offset, component, positions[places] + offset, constraint.scale or 0.0,
                constraint.value or 0.0, constraint.motion, bool(constraint.tied),
                constraint.course,
            )
            for component in directions
        ]  # fmt: skip
    return motions


def _refuse_contradictions(case: Case, number: int, component: int, places: NDArray, holder: NDArray) -> None:
    """Note in ``holder`` (2, n) which constraint holds each place in each direction."""
    for other in np.unique(holder[component, places]):
        if other >= 0 and not case.constraints[number].asks_the_same(case.constraints[other]):
            raise GridError(
                f"{case.source}: constraints[{other}] and constraints[{number}] hold a place in the same direction and"
                " contradict each other; leave it out of one of the two boundary sets"
            )
    holder[component, places] = number


class PointsOn:
    """Selector of material points on a boundary set, held at their edges if ``at_edges``."""

    def __init__(self, case: Case, cloud: PointCloud, at_edges: bool) -> None:
        self._cloud, self._at_edges, self._box = cloud, at_edges, case.bounding_box()

    def __call__(self, boundary: BoundarySet) -> tuple[NDArray, NDArray]:
        """Numbers (n,) of the points and, from each, the offset (n, 2) of the place where it is held [length]."""
        edges = boundary.edges or ((boundary.edge,) if boundary.edge else ())
        if edges:
            places, offsets = zip(*(self._on_edge(boundary, edge) for edge in edges), strict=True)
            return np.concatenate(places), np.concatenate(offsets)
        if self._at_edges and boundary.point:
            return self._in_region(boundary.point, boundary.point)
        if self._at_edges and boundary.box:
            return self._in_region(boundary.box.lower, boundary.box.upper)
        if self._at_edges and boundary.circle:
            return self._on_circle(boundary.circle)
        if self._at_edges and boundary.segment:
            lower, upper = np.sort(boundary.segment, axis=0)
            if (lower == upper).any():  # a flat box
                return self._in_region(lower, upper)
            return self._on_lines(nearest_on_segment(self._cloud.positions, boundary.segment))
        if self._at_edges and boundary.group:
            return self._on_lines(boundary.nearest(self._cloud.positions))
        reach = 0.0 if boundary.box else 1.5 * REACH * np.sqrt(self._cloud.size.prod(axis=1))
        chosen = np.flatnonzero(boundary.select(self._cloud.positions, reach, self._box))  # type: ignore[arg-type]
        return chosen, np.zeros((len(chosen), 2))

    def _on_edge(self, boundary: BoundarySet, edge: str) -> tuple[NDArray, NDArray]:
        """Points whose rectangles reach an edge of the bounding box, held on it."""
        cloud = self._cloud
        across, corner = (0 if edge in ("left", "right") else 1), int(edge in ("right", "top"))
        one = boundary.model_copy(update={"edge": edge, "edges": None})
        reach = REACH * cloud.size[:, across]
        places = np.flatnonzero(one.select(cloud.positions, reach, self._box))  # type: ignore[arg-type]
        offset = np.zeros((len(places), 2))
        if self._at_edges:
            offset[:, across] = self._box[corner][across] - cloud.positions[places, across]
        return places, offset

    def _in_region(self, lower: Pair | NDArray, upper: Pair | NDArray) -> tuple[NDArray, NDArray]:
        """Points whose rectangles reach into a box, held at the nearest place in it.

        A rectangle that only touches the box's end is left out, and so is one that ends on a flat box where one
        beside it begins: a place held from two cells would stiffen both as soon as it moves.
        """
        cloud = self._cloud
        start = cloud.positions + cloud.corner
        end = start + cloud.size
        slack = (REACH - 0.5) * cloud.size
        overlap = np.minimum(end, upper) - np.maximum(start, lower)
        flat = np.asarray(upper) - np.asarray(lower) <= slack
        reaching = np.where(flat, overlap >= -slack, overlap > slack).all(axis=1)
        for direction in (0, 1):
            ends_there = np.abs(end - lower)[:, direction] <= slack[:, direction]
            on_flat = reaching & flat[:, direction]
            ending, other = np.flatnonzero(on_flat & ends_there), on_flat & ~ends_there
            begins, ends, least = (part[:, 1 - direction] for part in (start, end, slack))
            beside = np.minimum(ends[ending, None], ends[other]) - np.maximum(begins[ending, None], begins[other])
            reaching[ending[(beside > least[ending, None]).any(axis=1)]] = False
        held = np.flatnonzero(reaching)
        return held, np.clip(cloud.positions[held], lower, upper) - cloud.positions[held]

    def _on_circle(self, circle: Circle) -> tuple[NDArray, NDArray]:
        """Points that reach the circle, by the ellipses round their rectangles, held at the nearest place on it."""
        cloud = self._cloud
        outward = cloud.positions - np.asarray(circle.centre)
        distance = np.linalg.norm(outward, axis=1)
        reach = REACH * np.sqrt(2.0) * np.linalg.norm(outward * cloud.size, axis=1) / distance
        places = np.flatnonzero(np.abs(distance - circle.radius) <= reach)
        return places, outward[places] * (circle.radius / distance[places] - 1.0)[:, None]

    def _on_lines(self, nearest: NDArray) -> tuple[NDArray, NDArray]:
        """Points whose rectangles reach lines, held at the nearest places (n, 2) on them."""
        cloud = self._cloud
        offset = nearest - cloud.positions
        places = np.flatnonzero((np.abs(offset) <= REACH * cloud.size).all(axis=1))
        return places, offset[places]


def nodes_on(case: Case, nodes: NDArray) -> Selector:
    """Selector of grid nodes on a boundary set that is not beside all bodies, where the grid goes on without points."""

    def select(boundary: BoundarySet) -> tuple[NDArray, NDArray]:
        """Numbers (n,) of the nodes and their distances (n, 2) from the set, none here."""
        chosen = np.flatnonzero(boundary.select(nodes, 1e-6 * case.mesh.h, case.bounding_box()))
        if not any(body.contains(nodes[chosen], 0.5 * case.mesh.h).any() for body in case.bodies.values()):
            chosen = chosen[:0]
        return chosen, np.zeros((len(chosen), 2))

    return select


class NodeMotions:
    """Motions prescribed on grid nodes by elimination, whose unknowns are numbered 2 node + component."""

    def __init__(self, case: Case, motions: list[PrescribedMotion]) -> None:
        self._case, self._motions = case, motions

    def bind(self, size: int) -> tuple[NDArray, NDArray]:
        """Which unknowns (size,) are prescribed, and the one that each of them is tied to, by default itself."""
        master, prescribed = np.arange(size), np.zeros(size, bool)
        for motion in self._motions:
            unknowns = _unknowns(motion)
            if motion.tied:
                master[unknowns] = unknowns[0]
            else:
                prescribed[unknowns] = True
        return prescribed, master

    def holds(self, part: NDArray) -> Holds:
        """What they hold of nodes in connected parts (n_nodes,)."""
        return _holds(self._motions, [m.positions for m in self._motions], part)

    def prescribe(self, increment: NDArray, load: float, before: float) -> None:
        """Set what is prescribed of an increment (n_nodes, 2) of the displacement between two loads, in place."""
        for motion in self._motions:
            if not motion.tied:
                change = motion.displacement(self._case, load) - motion.displacement(self._case, before)
                increment.reshape(-1)[_unknowns(motion)] = change

    def conjugate_force(self, nodal_forces: NDArray, load: float, towards: float) -> float:
        """Work of forces (size,) at the nodes by a change of the load towards another one."""
        total = 0.0
        for motion in self._motions:
            if not motion.tied:
                total += float(nodal_forces[_unknowns(motion)] @ motion.rate(self._case, load, towards))
        return total


def _unknowns(motion: PrescribedMotion) -> NDArray:
    return 2 * motion.places + motion.component


class PointPenalty:
    """Motions prescribed on the body by stiff springs, Eqs. A.1-A.6.

    The list of springs is flat: motion after motion, place after place. Tied motions pull their places to one
    more unknown each, numbered after those of the grid. ``places`` (n_springs,) are the points whose cells hold the
    springs, ``offset`` (n_springs, 2) how far these are from them, ``component`` (n_springs,) the direction of each.
    """

    def __init__(self, case: Case, motions: list[PrescribedMotion], stiffness: NDArray) -> None:
        self._case, self._motions = case, motions
        self.places = _joined([m.places for m in motions], int)
        self.offset = np.concatenate([m.offset for m in motions]) if motions else np.zeros((0, 2))
        self.component = _joined([np.full(len(m.places), m.component) for m in motions], int)
        self._stiffness = stiffness[self.places]
        self.n_tied = sum(m.tied for m in motions)
        tied = np.cumsum([m.tied for m in motions]) - 1
        masters = [np.full(len(m.places), t if m.tied else -1) for m, t in zip(motions, tied, strict=True)]
        self._master = _joined(masters, int)

    def find_in_grid(self, basis: PointBasis, equations: NDArray, size: int) -> None:
        """Take the basis at the springs' present places."""
        self._value = basis.values_beside(self.places, self.offset)
        self._unknowns = 2 * basis.active.nodes_of_points()[self.places] + self.component[:, None]
        self._equations, self._size = equations[self._unknowns], size
        self._first_master = size - self.n_tied

    def holds(self, positions: NDArray, part: NDArray) -> Holds:
        """What they hold of points at positions (n_points, 2) in connected parts (n_points,)."""
        return _holds(self._motions, [positions[m.places] + m.offset for m in self._motions], part)

    def displaced(self, before: NDArray, increment: NDArray) -> NDArray:
        """Displacement (n_springs,) after a grid increment (n_nodes, 2) on top of the one before (n_springs,)."""
        return before + (self._value * increment.reshape(-1)[self._unknowns]).sum(axis=1)

    def coupling(self, equations: NDArray, grid_size: int) -> NDArray | None:
        """Pairs of equations that tied motions can couple beyond their cells."""
        tied = [m for m in self._motions if m.tied]
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
        return displacement - self._targets(load, tied)

    def forces(self, displacement: NDArray, load: float, tied: NDArray) -> NDArray:
        """Spring forces (n_springs,), positive where the point is ahead of its target."""
        return self._stiffness * self._gap(displacement, load, tied)

    def residual(self, forces: NDArray) -> NDArray:
        """Forces of the springs on the equations (size,)."""
        total = gather_vector(self._equations, self._value * forces[:, None], self._size)
        is_tied = self._master >= 0
        np.add.at(total, self._first_master + self._master[is_tied], -forces[is_tied])
        return total

    def rates(self, load: float, towards: float) -> NDArray:
        """Change of the targets with the load (n_springs,) on the way to another one."""
        motions = self._motions
        rates = [np.zeros(len(m.places)) if m.tied else m.rate(self._case, load, towards) for m in motions]
        return _joined(rates, float)

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
        """Largest distance of a point from its target, relative to the largest target.

        0 where targets are next to nothing of those at the turns of the path, so that the distances are what the
        iterations left; what breaks early on its only way is held to its own.
        """
        turns = self._case.load.path[:-1]
        largest, *of_path = (np.abs(self._targets(u, tied)).max(initial=0.0) for u in (load, *turns))
        if largest <= UNMOVED * max(of_path, default=0.0):
            return 0.0
        return float(np.abs(self._gap(displacement, load, tied)).max() / largest)


def _holds(motions: list[PrescribedMotion], places: list[NDArray], part: NDArray) -> Holds:
    numbers = np.concatenate([m.places for m in motions]).astype(int) if motions else np.zeros(0, int)
    component = _joined([np.full(len(m.places), m.component) for m in motions], int)
    tied = _joined([np.full(len(m.places), n if m.tied else -1) for n, m in enumerate(motions)], int)
    return Holds(np.concatenate([np.zeros((0, 2)), *places]), component, part[numbers], tied)


class Supports(NamedTuple):
    """All that holds and moves a body: nodes, springs at points, and the faces of slits that close."""

    nodes: NodeMotions
    springs: PointPenalty
    faces: ClosingFaces


def node_motions(case: Case, grid: Grid) -> NodeMotions:
    """The case's constraints on nodes of the grid, none where it has them on the points."""
    if case.mpm.constraints_on != "nodes":
        return NodeMotions(case, [])
    grid.check_edges_interpolate("mpm.constraints_on", 'constraints_on = "points"')
    motions = displacement_motions(case, nodes_on(case, grid.nodes), grid.nodes)
    if case.mpm.move_points:
        _stay_with_the_points(case, motions)
    return NodeMotions(case, motions)


def _stay_with_the_points(case: Case, motions: list[PrescribedMotion]) -> None:
    """Raise CaseError where an edge of nodes is moved along its normal, away from the points that it is to hold."""
    for motion in motions:
        is_edge = len(motion.places) > 1 and np.ptp(motion.positions[:, motion.component]) <= 1e-9 * case.mesh.h
        way = max(np.abs(motion.displacement(case, load)).max() for load in case.load.path) if is_edge else 0.0
        if way > NODES_HOLD * case.mesh.h:
            text = f"moves an edge by {way:.3g}, more than {NODES_HOLD:g} mesh.h, which the grid's nodes do not follow"
            remedy = 'give "edges", or move_points = false'
            raise sentence(case.source, "mpm.constraints_on", "nodes", text, remedy)


def point_penalty(case: Case, cloud: PointCloud, materials: MaterialTable) -> PointPenalty:
    """The case's constraints on the points, none where it has them on nodes.

    The stiffness of the springs [force/length] is a multiple of the uniaxial modulus times thickness.
    """
    motions = []
    if case.mpm.constraints_on != "nodes":
        on_points = PointsOn(case, cloud, at_edges=case.mpm.constraints_on == "edges")
        motions = displacement_motions(case, on_points, cloud.positions)
    modulus = materials.stiffness[:, [0, 1], [0, 1]].max(axis=1)[cloud.body]
    return PointPenalty(case, motions, case.mpm.penalty * modulus * case.plane.thickness)


def closing_faces(case: Case, grid: Grid, materials: MaterialTable) -> ClosingFaces:
    """Springs between the faces of the grid's slits that the case has in contact.

    None on a grid that follows the crack: a new one does not know how far its faces are apart. The health record tells
    where they go through each other.
    """
    faces = [] if case.mesh.follow_crack else grid.faces()
    return ClosingFaces.of(case, faces, float(materials.stiffness.max()))


def _joined(parts: list[NDArray], kind: type) -> NDArray:
    return np.concatenate(parts).astype(kind) if parts else np.zeros(0, kind)
