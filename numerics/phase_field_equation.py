"""The phase field equation of a discretisation: its factors, its values at points, numbers and solver of its unknowns."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .costs import Costs
from .linear_solvers import LinearSolverError, linear_solver
from .sparse_pattern import LocalSystems, SymmetricPattern, gather_vector

#: distance from the bound, and from balance over the stiffness, that is round-off
AT_BALANCE = 1e-12
#: solves for the unknowns at the bound; a crack's flanks set out from it a cell a time
LARGEST_SETS = 500


class PhaseFieldTerms(NamedTuple):
    """Factors of the phase field equation: one for each point or each cell.

    ``reaction`` [stress] stands before c, ``resistance`` [stress] on the right, ``diffusion`` [force] before the slopes,
    ``bending`` [force length²] before the second derivatives of order 4.
    """

    reaction: NDArray
    resistance: NDArray
    diffusion: NDArray
    bending: NDArray


class ScalarAtPoints(NamedTuple):
    """A scalar, its squared slope and the quadratic form of gamma in its second derivatives, all of one shape."""

    value: NDArray
    slope_squared: NDArray
    curvature_squared: NDArray

    @classmethod
    def intact(cls, shape: int | tuple[int, ...]) -> ScalarAtPoints:
        """The phase field of whole material."""
        return cls(np.ones(shape), np.zeros(shape), np.zeros(shape))


class PhaseFieldEquation:
    """Numbers, pattern and solver of the phase field's unknowns.

    Parameters
    ----------
    cells : (n_cells, k) unknowns of each cell.
    free : (n_unknowns,) those to be solved for; the others keep their values.
    is_bounded : no unknown may be above 1, which equations without a restoring term do not see to by themselves.
    guard : may change the stored entries of the matrix.
    """

    def __init__(
        self,
        cells: NDArray,
        free: NDArray,
        costs: Costs,
        is_bounded: bool = False,
        guard: Callable[[SymmetricPattern, NDArray], NDArray] = lambda pattern, values: values,
    ) -> None:
        self.free, self._is_bounded, self._guard = free, is_bounded, guard
        numbers = np.where(free, np.cumsum(free) - 1, -1).astype(np.int32)
        self._equations = numbers[cells]
        self.size = int(free.sum())
        #: to be filled before `corrected`
        self.systems = LocalSystems.empty(*cells.shape)
        self._pattern = SymmetricPattern(self._equations, self.size)
        #: of the equations' matrix
        self.solver = linear_solver(self._pattern, costs, "well_conditioned")
        costs.count["unknowns_phase_field"] = self.size

    def residual(self) -> NDArray:
        """Residual (size,) of the cells' systems."""
        return -gather_vector(self._equations, self.systems.vectors, self.size)

    def matrix(self) -> NDArray:
        """Stored entries of the matrix of the cells' systems."""
        return self._guard(self._pattern, self._pattern.gather(self.systems.matrices))

    def corrected(self, nodal: NDArray) -> NDArray:
        """Unknowns (n_unknowns,) that solve the cells' systems, which were made at ``nodal`` (n_unknowns,)."""
        right_side, values = -self.residual(), self.matrix()
        corrected = nodal.copy()
        if (np.abs(right_side) <= AT_BALANCE * values[self._pattern.diagonal]).all():
            return corrected
        if self._is_bounded:
            corrected[self.free] += self._bounded_correction(values, right_side, 1.0 - nodal[self.free])
        else:
            corrected[self.free] += self.solver.solve(values, right_side)
        return corrected

    def _bounded_correction(self, values: NDArray, right_side: NDArray, room: NDArray) -> NDArray:
        """Correction (size,) that is no more than the room (size,): active sets of Hintermüller, Ito and Kunisch (2002).

        doi 10.1137/S1052623401383558. Unknowns at the bound stay there while the equations push them further.
        """
        matrix, diagonal = self._pattern.full(values), self._pattern.diagonal
        rows = np.repeat(np.arange(self.size), np.diff(self._pattern.indptr))
        columns = self._pattern.indices
        stiffness = values[diagonal]
        held = (room <= AT_BALANCE) & (right_side > 0.0)
        for _ in range(LARGEST_SETS):
            correction = np.where(held, room, 0.0)
            rest = np.where(held, 0.0, right_side - matrix @ correction)
            apart = np.where((held[rows] | held[columns]) & (rows != columns), 0.0, values)
            correction += self.solver.solve(apart, rest)
            push = right_side - matrix @ correction
            held, before = np.where(held, push > -AT_BALANCE * stiffness, correction > room + AT_BALANCE), held
            if np.array_equal(held, before):
                return correction
        raise LinearSolverError(f"no set of unknowns at the bound of the phase field was found in {LARGEST_SETS} solves")
