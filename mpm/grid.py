"""The background grid: tensor-product B-splines, opened along slits of no width."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from cases import Case
from cases.geometry import SAME_LINE
from cases.seams import seams
from cases.spacing import grid_lines
from mpm.inclined_slits import InclinedSlit, check_apart, inclined_slits
from mpm.slits import GridError, GridSlit, SlitLine, slit_lines
from mpm.splines import Axis
from numerics.closing import Faces
from numerics.description import fourth_order
from numerics.staggered import NewtonError


class LostPointsError(NewtonError):
    """Material points have left the grid: no increment finds equilibrium there."""


class GridCells(NamedTuple):
    """Cells (n,) of the grid in x and y, and which copy of each: 1 is what lies above an inclined slit that cuts it."""

    x: NDArray
    y: NDArray
    copy: NDArray


class Sides(NamedTuple):
    """Where points lie by their first places: `GridSlit.sides` of each slit, above (n_inclined, n_points) or not."""

    of_lines: list[NDArray]
    above: NDArray


class Grid:
    """Tensor-product B-spline grid around the bodies of a case.

    Attributes
    ----------
    axes : the two directions.
    node_number : (nx, ny) number of each function; functions joined across a slit's line share one.
    number_above : (nx, ny) the same, above the inclined slits that part functions.
    cut_by : (n_cells_x, n_cells_y) number of the inclined slit by which each cell has two copies, -1 for none.
    nodes : (n_nodes, 2) Greville points.
    """

    def __init__(self, case: Case) -> None:
        lower, upper = case.bounding_box()
        self.order = case.mpm.order
        self._box, self._source = (lower, upper), case.source
        self._slit_lines = slit_lines(case)
        self.slits = [slit for line in self._slit_lines for slit in line.slits]
        self.inclined = inclined_slits(case)
        self._seams = _lines_of_seams(case)
        lines = [_widened(np.asarray(axis), case.mpm.margin) for axis in grid_lines(case)]
        self.axes = [Axis(lines[d], self.order, self._multiplicity(d, lines[d])) for d in (0, 1)]
        self.node_number, self.n_nodes = self._join_functions()
        self.number_above, self.cut_by = self._double_functions(case)
        abscissae = np.stack(np.meshgrid(*(axis.greville() for axis in self.axes), indexing="ij"), -1).reshape(-1, 2)
        self.nodes = np.empty((self.n_nodes, 2))
        for number in (self.node_number, self.number_above):
            self.nodes[number.ravel()] = abscissae

    def check_edges_interpolate(self, key: str, remedy: str) -> None:
        """Prescribed grid nodes need functions that interpolate on the body's edges; GridError names key and remedy."""
        lower, upper = self._box
        ends = np.array([axis.breakpoints[[0, -1]] for axis in self.axes]).T
        on_edges = (np.abs(ends - [lower, upper]) < SAME_LINE * np.diff(self.axes[0].breakpoints).min()).all()
        if self.order > 1 and not on_edges:
            raise GridError(
                f"{self._source}: {key}: nodes of B-splines of order {self.order} lie on the body's edges only where the"
                f" grid ends there; set mpm.margin = 0, or {remedy}"
            )

    @property
    def shape(self) -> tuple[int, int]:
        """Number of cells in x and y."""
        return self.axes[0].n_cells, self.axes[1].n_cells

    def _multiplicity(self, direction: int, lines: NDArray) -> dict[int, int]:
        """Knots to repeat: broken on a slit's line, C0 at its tips and on seams of two materials."""
        repeats: dict[int, int] = {}
        self._repeat_at(repeats, lines, self._seams[direction])
        for slit_line in self._slit_lines:
            if slit_line.normal == direction:
                repeats[_line_index(lines, slit_line.position)] = self.order + 1
                continue
            self._repeat_at(repeats, lines, slit_line.tips[:, direction])
        for slit in self.inclined:
            self._repeat_at(repeats, lines, slit.tips[:, direction])
        return repeats

    def _repeat_at(self, repeats: dict[int, int], lines: NDArray, places: NDArray) -> None:
        for place in places:
            index = _line_index(lines, place)
            repeats[index] = max(self.order, repeats.get(index, 0))

    def _join_functions(self) -> tuple[NDArray, int]:
        """Number the functions; those on both sides of a slit's line are one except along the slit."""
        shape = tuple(axis.n_functions for axis in self.axes)
        numbers = np.arange(shape[0] * shape[1]).reshape(shape)
        pairs = [self._pairs_to_join(slit_line, numbers) for slit_line in self._slit_lines]
        if not pairs:
            return numbers, numbers.size
        joined = np.concatenate(pairs, axis=1)
        graph = sparse.coo_matrix((np.ones(joined.shape[1]), joined), shape=(numbers.size, numbers.size))
        count, labels = sparse.csgraph.connected_components(graph, directed=False)
        # number in order of first appearance, as without slits
        _, first = np.unique(labels, return_index=True)
        ranks = np.empty(count, dtype=int)
        ranks[np.argsort(first)] = np.arange(count)
        return ranks[labels].reshape(shape), count

    def _double_functions(self, case: Case) -> tuple[NDArray, NDArray]:
        """``number_above``, the copies behind all other numbers, and ``cut_by``.

        Raises GridError where slits are too near to each other.
        """
        supports = self._supports()
        parted = np.array([slit.parted(*supports) for slit in self.inclined], bool).reshape(-1, self.n_nodes)
        cells = np.stack(np.meshgrid(*(np.arange(n) for n in self.shape), indexing="ij"))
        cut: NDArray = np.any(parted[:, _of_cells(self.node_number, self.axes, *cells)], axis=-1)
        check_apart(case, cut)
        cut_by = np.where(cut.any(axis=0), cut.argmax(axis=0), -1) if len(cut) else np.full(self.shape, -1)
        above, doubled = np.arange(self.n_nodes), parted.any(axis=0)
        above[doubled] = self.n_nodes + np.arange(doubled.sum())
        self.n_nodes += int(doubled.sum())
        return above[self.node_number], cut_by

    def _supports(self) -> tuple[NDArray, NDArray]:
        """Lower and upper corners (n_nodes, 2) of what the functions of each node reach over."""
        ends = zip(*(axis.support() for axis in self.axes), strict=True)
        left, right = (np.stack(np.meshgrid(*end, indexing="ij"), -1).reshape(-1, 2) for end in ends)
        lower, upper = np.full((self.n_nodes, 2), np.inf), np.full((self.n_nodes, 2), -np.inf)
        np.minimum.at(lower, self.node_number.ravel(), left)
        np.maximum.at(upper, self.node_number.ravel(), right)
        return lower, upper

    def _pairs_to_join(self, slit_line: SlitLine, numbers: NDArray) -> NDArray:
        """Pairs (2, n) of functions below and above a line that no slit on it parts."""
        below, above = self._along_line(slit_line, numbers)
        parted = slit_line.parted(*self.axes[1 - slit_line.normal].support())
        return np.stack([below[~parted], above[~parted]])

    def _along_line(self, slit: GridSlit | SlitLine, numbers: NDArray) -> tuple[NDArray, NDArray]:
        """Of the functions with these numbers (nx, ny), those that end on a slit's line from below and from above."""
        across = self.axes[slit.normal]
        above = int(np.searchsorted(across.knots, slit.position - 1e-12 * np.ptp(across.breakpoints)))
        by_line = np.moveaxis(numbers, slit.normal, 0)
        return by_line[above - 1], by_line[above]

    def faces(self) -> list[Faces]:
        """The faces of the slits in contact."""
        on_lines = [self._faces_on_line(slit) for slit in self.slits if slit.contact]
        return on_lines + [self._inclined_faces(slit) for slit in self.inclined if slit.notch.contact]

    def _faces_on_line(self, slit: GridSlit) -> Faces:
        """At the nodes of the two faces of a slit on a line."""
        below, above = self._along_line(slit, self.node_number)
        left, right = self.axes[1 - slit.normal].support()
        on_slit = (np.minimum(right, slit.end) > np.maximum(left, slit.start)) & (above != below)
        nodes = np.stack([above[on_slit], below[on_slit]], axis=1)[:, :, None]
        return Faces(nodes, np.ones((len(nodes), 1)), np.eye(2)[slit.normal])

    def _inclined_faces(self, slit: InclinedSlit) -> Faces:
        """At places on each cell's stretch of a slit at an angle."""
        places = slit.places_on_faces(self.axes[0].breakpoints, self.axes[1].breakpoints)
        cells, (dx, dy) = self.locate(places, self.sides(places)), slit.notch.direction
        nodes = [self.cell_nodes(cells._replace(copy=np.full(len(places), copy))) for copy in (1, 0)]
        weights = np.where(nodes[0] != nodes[1], self.evaluate(places, cells)[0], 0.0)
        return Faces(np.stack(nodes, axis=1), weights, np.array([-dy, dx]))

    def points_at_tips(self, positions: NDArray) -> NDArray:
        """Indices of the points (n, 2) in the four cells around the tips of the slits."""
        chosen = np.zeros(len(positions), bool)
        on_lines, inclined = ([tip for slit in slits for tip in slit.tips] for slits in (self._slit_lines, self.inclined))
        for tip in on_lines + inclined:
            near = [
                np.abs(axis.locate(positions[:, d]) - _line_index(axis.breakpoints, tip[d]) + 0.5) < 1.0
                for d, axis in enumerate(self.axes)
            ]
            chosen |= near[0] & near[1]
        return np.flatnonzero(chosen)

    def sides(self, reference: NDArray) -> Sides:
        """Where points lie by their first places (n, 2)."""
        above = np.array([slit.above(reference) for slit in self.inclined], bool).reshape(-1, len(reference))
        return Sides([slit.sides(reference) for slit in self.slits], above)

    def locate(self, positions: NDArray, sides: Sides) -> GridCells:
        """Cells of points (n, 2); those beside a slit stay on their side of it."""
        cells = [axis.locate(positions[:, d]) for d, axis in enumerate(self.axes)]
        for d, axis in enumerate(self.axes):
            if ((cells[d] < 0) | (cells[d] >= axis.n_cells)).any():
                remedy = "enlarge mpm.margin, or keep bodies at rest on their first places with mpm.move_points = false"
                raise LostPointsError(f"material points have left the grid; {remedy}")
        for slit, side in zip(self.slits, sides.of_lines, strict=True):
            line = self.line_of(slit)
            across = cells[slit.normal]
            np.minimum(across, line - 1, out=across, where=side < 0)
            np.maximum(across, line, out=across, where=side > 0)
        copy, cut_by = np.zeros(len(positions), int), self.cut_by[cells[0], cells[1]]
        cut = np.flatnonzero(cut_by >= 0)
        copy[cut] = sides.above[cut_by[cut], cut]
        return GridCells(cells[0], cells[1], copy)

    def line_of(self, slit: GridSlit) -> int:
        """Number of the grid line that a slit lies on."""
        return _line_index(self.axes[slit.normal].breakpoints, slit.position)

    def cell_nodes(self, cells: GridCells) -> NDArray:
        """Nodes (n, (order + 1)^2) whose functions live on the cells."""
        numbers = self.node_number, self.number_above
        below, above = (_of_cells(number, self.axes, cells.x, cells.y) for number in numbers)
        return np.where(cells.copy[:, None] == 1, above, below).astype(np.int32)

    def evaluate(self, positions: NDArray, cells: GridCells) -> tuple[NDArray, NDArray]:
        """Values (n, k) and gradients (n, k, 2) at points of the functions on their cells, Eqs. 3.69-3.70."""
        (x, dx), (y, dy) = (
            axis.evaluate(np.ascontiguousarray(positions[:, d]), cells[d]) for d, axis in enumerate(self.axes)
        )
        count = (self.order + 1) ** 2
        values, gradients = np.empty((len(positions), count)), np.empty((len(positions), count, 2))
        _multiply(x, dx, y, dy, values, gradients)
        return values, gradients

    def second_derivatives(self, positions: NDArray, cells: GridCells) -> NDArray:
        """Second derivatives xx, yy, xy (n, k, 3) at points of the functions on their cells."""
        places = [np.ascontiguousarray(positions[:, d]) for d in (0, 1)]
        (x, dx), (y, dy) = (axis.evaluate(places[d], cells[d]) for d, axis in enumerate(self.axes))
        ddx, ddy = (axis.second_derivatives(places[d], cells[d]) for d, axis in enumerate(self.axes))
        products = [a[:, :, None] * b[:, None, :] for a, b in ((ddx, y), (x, ddy), (dx, dy))]
        return np.stack(products, axis=-1).reshape(len(positions), -1, 3)

    def beside(self, nodes: NDArray) -> NDArray:
        """The nodes (n,) and their neighbours in the grid."""
        chosen = binary_dilation(np.isin(self.node_number, nodes), np.ones((3, 3), bool))
        return np.unique(self.node_number[chosen])


@njit(cache=True)
def _multiply(x, dx, y, dy, values, gradients):
    """Products (n, k) of functions in x and in y (n, order + 1), and their gradients (n, k, 2)."""
    m = x.shape[1]
    for p in range(x.shape[0]):
        for i in range(m):
            for j in range(m):
                values[p, m * i + j] = x[p, i] * y[p, j]
                gradients[p, m * i + j, 0] = dx[p, i] * y[p, j]
                gradients[p, m * i + j, 1] = x[p, i] * dy[p, j]


def _of_cells(number: NDArray, axes: list[Axis], x: NDArray, y: NDArray) -> NDArray:
    """Numbers (..., (order + 1)^2) of the functions that live on cells (...) in x and y."""
    offsets = np.arange(axes[0].order + 1)
    rows, columns = ((axis.spans[c] - axis.order)[..., None] + offsets for axis, c in zip(axes, (x, y), strict=True))
    return number[rows[..., :, None], columns[..., None, :]].reshape(*x.shape, -1)


def _lines_of_seams(case: Case) -> tuple[NDArray, NDArray]:
    """Places in x and in y of the grid's lines along which strain jumps from one body to another.

    None for a phase field of fourth order, whose slope may not jump.
    """
    stretches = [seam.stretches for seam in ([] if fourth_order(case) else seams(case))]
    ends = np.concatenate([np.zeros((0, 2, 2)), *stretches])
    found = []
    for axis, lines in enumerate(grid_lines(case)):
        places = ends[ends[:, 0, axis] == ends[:, 1, axis], 0, axis]
        near = np.abs(places[:, None] - np.asarray(lines)).min(axis=1, initial=np.inf) < SAME_LINE * case.mesh.h
        found.append(np.unique(places[near]))
    return found[0], found[1]


def _line_index(lines: NDArray, position: float) -> int:
    return int(np.argmin(np.abs(lines - position)))


def _widened(lines: NDArray, margin: int) -> NDArray:
    """Grid lines with ``margin`` more cells, as large as the outermost ones, on both sides."""
    steps = np.arange(1, margin + 1)
    before = lines[0] - steps[::-1] * (lines[1] - lines[0])
    after = lines[-1] + steps * (lines[-1] - lines[-2])
    return np.concatenate([before, lines, after])
