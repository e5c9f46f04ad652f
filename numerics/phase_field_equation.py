"""The phase field equation of a discretisation: its factors, its values at points, numbers and solver of its unknowns."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .costs import Costs
from .linear_solvers import linear_solver
from .sparse_pattern import LocalSystems, SymmetricPattern, gather_vector


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
    """

    def __init__(self, cells: NDArray, free: NDArray, costs: Costs) -> None:
        self._free = free
        numbers = np.where(free, np.cumsum(free) - 1, -1).astype(np.int32)
        self._equations = numbers[cells]
        self.size = int(free.sum())
        #: to be filled before `corrected`
        self.systems = LocalSystems.empty(*cells.shape)
        self._pattern = SymmetricPattern(self._equations, self.size)
        self._solver = linear_solver(self._pattern, costs, "well_conditioned")
        costs.count["unknowns_phase_field"] = self.size

    def corrected(
        self, nodal: NDArray, guard: Callable[[SymmetricPattern, NDArray], NDArray] = lambda pattern, values: values
    ) -> NDArray:
        """Unknowns (n_unknowns,) that solve the cells' systems, which were made at ``nodal`` (n_unknowns,).

        ``guard`` may change the stored entries of the matrix.
        """
        right_side = gather_vector(self._equations, self.systems.vectors, self.size)
        values = guard(self._pattern, self._pattern.gather(self.systems.matrices))
        corrected = nodal.copy()
        corrected[self._free] += self._solver.solve(values, right_side)
        return corrected
