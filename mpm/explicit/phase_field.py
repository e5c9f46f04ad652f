"""The phase field of a body that moves: solved around the points where it can change."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cases import Case
from mpm.explicit import phase_field_kernels
from mpm.explicit.moving_body import MovingBody
from mpm.explicit.phase_field_kernels import CellEquations, NodalPhaseField, PhaseFieldLaw
from numerics.costs import Costs
from numerics.phase_field_window import BLOCK, RESIDUAL, RINGS, SMOOTH_RESIDUAL, conjugate_gradients, fold
from physics.elasticity import MaterialTable
from physics.phase_field import PhaseFieldCoefficients

#: cells that a point may stray before the nodal phase field at its place is found anew, at order 4
STRAY = 0.05
#: range of nodal values to start a solution from: nodes that points hardly see can take any, and see more points later
SANE = (-1.0, 2.0)
#: driving energy over resistance above which the phase field, then below its inverse, is zero for all that it does: more
#: would make the equations of wide open cracks stiff for nothing
LARGEST_DRIVE = 1e4
#: toughness of parts that cannot break over the body's, which holds the phase field at 1 beside them (thesis 7.4.2.1)
TOUGHER = 1000.0


class PointPhaseField:
    """The phase field of one body (Eq. 4.16), solved on blocks of cells around the points where it would change.

    One further ring of blocks is solved for and forgotten. At order 2 nothing is held at the rim of the blocks, where
    the solution is cut off, and the nodal values are kept as the start of the next solution. At order 4, whose bends
    reach further, the nodes outside keep theirs: points in cracks that stray from where these were found count as
    changing.
    """

    def __init__(self, case: Case, number: int, body: MovingBody, costs: Costs) -> None:
        self._body, self._costs, self._tolerance = body, costs, case.staggered.tolerance
        materials = MaterialTable(case)
        of_body = PhaseFieldCoefficients(materials, np.array([number]))
        self._law = PhaseFieldLaw(
            float(of_body.drive[0]), float(of_body.resistance[0]), float(of_body.diffusion[0]), float(of_body.bending[0]),
            float(of_body.toughness[0]), float(of_body.length_scale[0]), materials.curvature[number],
        )  # fmt: skip
        body_of_case = list(case.bodies.values())[number]
        # over the numbers of the body's points; None where all of it can break
        self._breakable: NDArray | None = None
        if body_of_case.unbreakable:
            self._breakable = np.ones(body.points.number.max() + 1, bool)
            self._breakable[body.points.number] = body_of_case.can_break(body.positions())
        self._block = max(1, round(BLOCK * self._law.length_scale / body.lattice.h))
        self._window = (np.zeros(2, np.int64), np.zeros(2, np.int64))
        self._nodal = np.ones(0)

    def solve(self, now: float, everywhere: bool = False) -> None:
        """Write the phase field of the body's points for their history field, at their present places."""
        largest = LARGEST_DRIVE * self._law.resistance / self._law.drive
        history = np.minimum(self._body.points.crack.history, largest)
        if self._breakable is not None:
            history *= self._breakable[self._body.points.number]
        marked = self._changing_blocks(history)
        marked[:] |= everywhere
        if not marked.any():
            return
        self._keep_nodes()
        cells = self._cells_around(marked, RINGS + 1)
        iterations = self._solve_on(cells, history)
        self._costs.count.update(phase_field_solves=1, window_cells=len(cells), cg_iterations=iterations)
        inside = np.zeros(len(self._nodal), bool)
        inside[self._cells_around(marked, RINGS)] = True
        nodal = NodalPhaseField(self._body.window.width, inside, self._nodal)
        self._map_to_points(nodal, history, now)

    def _map_to_points(self, nodal: NodalPhaseField, history: NDArray, now: float) -> None:
        order, strips, over_h = self._body.lattice.order, self._body.window.strips, 1.0 / self._body.lattice.h
        p, law = self._body.points, self._law
        phase_field_kernels.loops(order).to_points(strips, p.motion, history, law, over_h, nodal, now, p.crack)
        if self._breakable is not None:
            whole = ~self._breakable[p.number]
            p.crack.c[whole], p.crack.energy[whole], p.crack.broken_at[whole] = 1.0, 0.0, np.nan
        if law.bending:
            phase_field_kernels.add_curvature_energy(order, strips, p.motion, p.axes, law, over_h, nodal, p.crack.energy)
            found = nodal.inside[p.motion.x.astype(int) * nodal.width + p.motion.y.astype(int)]
            p.axes.stray_x[found], p.axes.stray_y[found] = 0.0, 0.0

    def _changing_blocks(self, history: NDArray) -> NDArray:
        window, p = self._body.window, self._body.points
        marked = np.zeros(-(-window.shape // self._block), bool)
        phase_field_kernels.mark_changing(
            window.strips, p.motion, p.crack, history, self._law, self._tolerance, self._block, marked
        )
        if self._law.bending:
            far = np.maximum(np.abs(p.axes.stray_x), np.abs(p.axes.stray_y)) > STRAY
            strayed = (p.crack.c < 1.0 - self._tolerance) & far
            x, y = p.motion.x[strayed].astype(int), p.motion.y[strayed].astype(int)
            marked[x // self._block, y // self._block] = True
        return marked

    def _keep_nodes(self) -> None:
        """Take the nodal values along when the body's window of the lattice has moved."""
        corner, shape = self._body.window.corner, self._body.window.shape
        old_corner, old_shape = self._window
        if np.array_equal(corner, old_corner) and np.array_equal(shape, old_shape):
            return
        nodal, old = np.ones(shape), self._nodal.reshape(old_shape)
        lower, upper = np.maximum(corner, old_corner), np.minimum(corner + shape, old_corner + old_shape)
        if (upper > lower).all():
            here, there = (np.s_[x:X, y:Y] for (x, y), (X, Y) in ((lower - c, upper - c) for c in (corner, old_corner)))
            nodal[here] = old[there]
        self._window, self._nodal = (corner.copy(), shape.copy()), nodal.reshape(-1)

    def _cells_around(self, marked: NDArray, rings: int) -> NDArray:
        """Cells (m,) within so many rings of the marked blocks, as numbers of their first nodes."""
        lattice, shape = self._body.lattice, self._body.window.shape
        return phase_field_kernels.cells_around(marked, rings, self._block, shape, lattice.order)

    def _solve_on(self, cells: NDArray, history: NDArray) -> int:
        """Find the nodal phase field on cells; returns the number of iterations."""
        equations = self._equations(cells, history)
        order, width = self._body.lattice.order, self._body.window.width
        rows = phase_field_kernels.number_rows(cells, order, width, self._held(equations.number))
        n, reach = len(rows.nodes), 2 * order + 1
        # one row more stands for all nodes that do not take part
        values, right_side = np.zeros((n + 1, reach * reach)), np.zeros(n + 1)
        fold(rows.of_cells, self._slots, equations.local, equations.right_side, values, right_side)
        self._nodal[rows.nodes] = np.clip(self._nodal[rows.nodes], *SANE)
        correction, iterations = conjugate_gradients(
            rows.neighbours, values[:-1], np.full(n, reach * reach // 2),
            phase_field_kernels.left_over(rows.nodes, order, width, values, self._nodal, right_side),
            right_side[:-1], SMOOTH_RESIDUAL if self._law.bending else RESIDUAL, patched=not self._law.bending,
        )  # fmt: skip
        self._nodal[rows.nodes] += correction
        return iterations

    def _equations(self, cells: NDArray, history: NDArray) -> CellEquations:
        """Equations of cells (m,), summed up over their points."""
        lattice, window, p = self._body.lattice, self._body.window, self._body.points
        order, over_h = lattice.order, 1.0 / lattice.h
        number, size = np.full(len(self._nodal), -1, np.int32), (order + 1) ** 2
        number[cells] = np.arange(len(cells), dtype=np.int32)
        halves, right_side = np.zeros((len(cells), size * (size + 1) // 2)), np.zeros((len(cells), size))
        equations = CellEquations(window.width, number, halves, right_side)
        matter = p.matter
        if self._breakable is not None:
            matter = matter._replace(volume=np.where(self._breakable[p.number], 1.0, TOUGHER) * matter.volume)
        loops = phase_field_kernels.loops(order)
        loops.add_points(window.strips, p.motion, matter, history, self._law, over_h, equations)
        if self._law.bending:
            phase_field_kernels.add_curvature_terms(
                order, window.strips, p.motion, matter, p.axes, self._law, over_h, equations
            )
        return equations

    def _held(self, number: NDArray) -> NDArray:
        """Nodes (n_nodes,) that keep their value: at order 4, those of points in cells outside the window."""
        body, held = self._body, np.zeros(len(self._nodal), bool)
        if self._law.bending:
            phase_field_kernels.mark_outside(body.lattice.order, body.points.motion, body.window.width, number, held)
        return held

    @cached_property
    def _slots(self) -> NDArray:
        """Entry (1, k², k²) of a node's row in which another node of the cell stands."""
        order = self._body.lattice.order
        across, up = (place.ravel() for place in np.indices((order + 1, order + 1)))
        away = across - across[:, None] + order, up - up[:, None] + order
        return (away[0] * (2 * order + 1) + away[1])[None].astype(np.uint8)

    def fracture_energy(self) -> float:
        """Energy of the body's cracks [energy] (Eq. 2.49)."""
        return float((self._body.points.crack.energy * self._body.points.matter.volume).sum())

    def checkpoint(self) -> dict[str, NDArray]:
        """Where the next solution starts from."""
        return {"corner": self._window[0], "shape": self._window[1], "nodal": self._nodal}

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to a checkpoint."""
        self._window, self._nodal = (saved["corner"], saved["shape"]), saved["nodal"].copy()
