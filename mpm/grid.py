"""The background grid: tensor-product B-splines, opened along slits of no width."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from cases import Case
from cases.spacing import SAME_LINE, grid_lines
from mpm.slits import GridError, GridSlit, SlitLine, slit_lines
from mpm.splines import Axis
from numerics.staggered import NewtonError


class LostPointsError(NewtonError):
    """Material points have left the grid: no increment finds equilibrium there."""


class Grid:
    """Tensor-product B-spline grid around the bodies of a case.

    Attributes
    ----------
    axes : the two directions.
    node_number : (nx, ny) number of each function; functions joined across a slit's line share one.
    nodes : (n_nodes, 2) Greville points.
    """

    def __init__(self, case: Case) -> None:
        lower, upper = case.bounding_box()
        self.order = case.mpm.order
        self._box, self._source = (lower, upper), case.source
        self._slit_lines = slit_lines(case)
        self.slits = [slit for line in self._slit_lines for slit in line.slits]
        lines = [_widened(np.asarray(axis), case.mpm.margin) for axis in grid_lines(case)]
        self.axes = [Axis(lines[d], self.order, self._multiplicity(d, lines[d])) for d in (0, 1)]
        self.node_number, self.n_nodes = self._join_functions()
        abscissae = [axis.greville() for axis in self.axes]
        self.nodes = np.empty((self.n_nodes, 2))
        self.nodes[self.node_number.ravel()] = np.stack(np.meshgrid(*abscissae, indexing="ij"), -1).reshape(-1, 2)

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
        """Knots to repeat: broken on a slit's line, C0 at its tips."""
        repeats: dict[int, int] = {}
        for slit_line in self._slit_lines:
            if slit_line.normal == direction:
                repeats[_line_index(lines, slit_line.position)] = self.order + 1
                continue
            for tip in slit_line.tips:
                index = _line_index(lines, tip)
                repeats[index] = max(self.order, repeats.get(index, 0))
        return repeats

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

    def face_pairs(self, slit: GridSlit) -> NDArray:
        """Pairs (n, 2) of nodes on the two faces of a slit, the one above first."""
        below, above = self._along_line(slit, self.node_number)
        left, right = self.axes[1 - slit.normal].support()
        on_slit = (np.minimum(right, slit.end) > np.maximum(left, slit.start)) & (above != below)
        return np.column_stack([above[on_slit], below[on_slit]])

    def points_at_tips(self, positions: NDArray) -> NDArray:
        """Indices of the points (n, 2) in the four cells around the tips of the slits."""
        chosen = np.zeros(len(positions), bool)
        for slit_line in self._slit_lines:
            for end in slit_line.tips:
                tip = np.full(2, end)
                tip[slit_line.normal] = slit_line.position
                near = [
                    np.abs(axis.locate(positions[:, d]) - _line_index(axis.breakpoints, tip[d]) + 0.5) < 1.0
                    for d, axis in enumerate(self.axes)
                ]
                chosen |= near[0] & near[1]
        return np.flatnonzero(chosen)

    def locate(self, positions: NDArray, sides: list[NDArray]) -> tuple[NDArray, NDArray]:
        """Cells (n,) in x and in y of points; those beside a slit stay on their side of it."""
        cells = [axis.locate(positions[:, d]) for d, axis in enumerate(self.axes)]
        for d, axis in enumerate(self.axes):
            if ((cells[d] < 0) | (cells[d] >= axis.n_cells)).any():
                raise LostPointsError("material points have left the grid; enlarge mpm.margin")
        for slit, side in zip(self.slits, sides, strict=True):
            line = self.line_of(slit)
            across = cells[slit.normal]
            np.minimum(across, line - 1, out=across, where=side < 0)
            np.maximum(across, line, out=across, where=side > 0)
        return cells[0], cells[1]

    def line_of(self, slit: GridSlit) -> int:
        """Number of the grid line that a slit lies on."""
        return _line_index(self.axes[slit.normal].breakpoints, slit.position)

    def cell_nodes(self, cells_x: NDArray, cells_y: NDArray) -> NDArray:
        """Nodes (n, (order + 1)^2) whose functions live on the cells."""
        offsets = np.arange(self.order + 1)
        rows = (self.axes[0].spans[cells_x] - self.order)[:, None] + offsets
        columns = (self.axes[1].spans[cells_y] - self.order)[:, None] + offsets
        return self.node_number[rows[:, :, None], columns[:, None, :]].reshape(len(cells_x), -1).astype(np.int32)

    def evaluate(self, positions: NDArray, cells_x: NDArray, cells_y: NDArray) -> tuple[NDArray, NDArray]:
        """Values (n, k) and gradients (n, k, 2) at points of the functions on their cells, Eqs. 3.69-3.70."""
        (x, dx), (y, dy) = (
            axis.evaluate(np.ascontiguousarray(positions[:, d]), cells)
            for d, (axis, cells) in enumerate(zip(self.axes, (cells_x, cells_y), strict=True))
        )
        count = (self.order + 1) ** 2
        values = (x[:, :, None] * y[:, None, :]).reshape(len(positions), count)
        gradients = np.stack([dx[:, :, None] * y[:, None, :], x[:, :, None] * dy[:, None, :]], axis=-1)
        return values, gradients.reshape(len(positions), count, 2)

    def second_derivatives(self, positions: NDArray, cells_x: NDArray, cells_y: NDArray) -> NDArray:
        """Second derivatives xx, yy, xy (n, k, 3) at points of the functions on their cells."""
        places, cells = [np.ascontiguousarray(positions[:, d]) for d in (0, 1)], (cells_x, cells_y)
        (x, dx), (y, dy) = (axis.evaluate(places[d], cells[d]) for d, axis in enumerate(self.axes))
        ddx, ddy = (axis.second_derivatives(places[d], cells[d]) for d, axis in enumerate(self.axes))
        products = [a[:, :, None] * b[:, None, :] for a, b in ((ddx, y), (x, ddy), (dx, dy))]
        return np.stack(products, axis=-1).reshape(len(positions), -1, 3)

    def beside(self, nodes: NDArray) -> NDArray:
        """The nodes (n,) and their neighbours in the grid."""
        chosen = binary_dilation(np.isin(self.node_number, nodes), np.ones((3, 3), bool))
        return np.unique(self.node_number[chosen])


def _line_index(lines: NDArray, position: float) -> int:
    return int(np.argmin(np.abs(lines - position)))


def _widened(lines: NDArray, margin: int) -> NDArray:
    """Grid lines with ``margin`` more cells, as large as the outermost ones, on both sides."""
    steps = np.arange(1, margin + 1)
    before = lines[0] - steps[::-1] * (lines[1] - lines[0])
    after = lines[-1] + steps * (lines[-1] - lines[-2])
    return np.concatenate([before, lines, after])
