"""Linear solvers behind one interface: PARDISO where its platform allows, else SuperLU or conjugate gradients."""

from __future__ import annotations

import ctypes
import sys
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, ClassVar, Protocol

import numpy as np
import scipy.sparse as sparse
import scipy.sparse.linalg as sparse_linalg
from numba import njit, prange
from numpy.typing import NDArray

from .costs import Costs
from .sparse_pattern import SymmetricPattern

try:
    from pypardiso import PyPardisoSolver
    from pypardiso.pardiso_wrapper import PyPardisoError
except ImportError:  # platforms without MKL
    PyPardisoSolver = None

#: relative size of the value that keeps unknowns without stiffness (empty cells, broken material) solvable
EMPTY_DIAGONAL = 1e-10


class LinearSolverError(RuntimeError):
    """A linear system could not be solved."""


class LinearSolver(Protocol):
    """Solves K x = b for matrices that share one pattern."""

    def factorise(self, values: NDArray) -> None:
        """Keep the matrix of the pattern's values (nnz,), for solutions to come."""

    def solve_again(self, right_side: NDArray) -> NDArray:
        """Solution (n,) for the matrix that is kept and a right side (n,)."""

    def solve(self, values: NDArray, right_side: NDArray) -> NDArray:
        """Solution (n,) for the pattern's values (nnz,) and the right side (n,)."""


class Pattern(Protocol):
    """Where the entries of a symmetric matrix stand."""

    size: int

    def upper(self, values: NDArray) -> sparse.csr_matrix:
        """The upper half as a scipy matrix with sorted rows."""

    def full(self, values: NDArray) -> sparse.csr_matrix:
        """Both halves as a scipy matrix."""


class DirectSolver(LinearSolver, Protocol):
    """A linear solver that can go over to other matrices."""

    def take(self, pattern: Pattern) -> None:
        """Solve for matrices of another pattern from now on."""


class _Keeping(ABC):
    """A solver that keeps a matrix."""

    @abstractmethod
    def factorise(self, values: NDArray) -> None:
        """Keep the matrix of the pattern's stored entries, for solutions to come."""

    @abstractmethod
    def solve_again(self, right_side: NDArray) -> NDArray:
        """Solution (n,) for the matrix that is kept and a right side (n,)."""

    def solve(self, values: NDArray, right_side: NDArray) -> NDArray:
        """Solution (n,) for the stored entries of the upper half and a right side (n,)."""
        self.factorise(values)
        return self.solve_again(right_side)


class Pardiso(_Keeping):
    """MKL PARDISO: one symbolic factorisation per pattern, Cholesky, or LDL^T where Cholesky breaks down."""

    POSITIVE_DEFINITE, INDEFINITE = 2, -2
    #: MKL's defaults by number, given by hand (1) since those it sets itself refine every solution twice: nested
    #: dissection (2), size of perturbed pivots (10), Bunch-Kaufman pivots (21); only perturbed pivots are refined.
    #: The two-level factors (24) are solved with in a third to a half of the time. Rows and columns count from zero (35)
    SETTINGS: ClassVar = {1: 1, 2: 2, 10: 8, 21: 1, 24: 1, 35: 1}

    _matrix: sparse.csr_matrix

    def __init__(self, pattern: Pattern, costs: Costs) -> None:
        self._pattern, self._costs = pattern, costs
        self._solver = PyPardisoSolver(mtype=self.POSITIVE_DEFINITE)
        for number, value in self.SETTINGS.items():
            self._solver.set_iparm(number, value)
        self._analysed = False

    def __del__(self) -> None:
        # an interrupt may have come before there was a solver, or in the midst of its work
        solver = getattr(self, "_solver", None)
        if solver is not None and not sys.is_finalizing():
            with suppress(PyPardisoError):
                solver.free_memory(everything=True)

    def take(self, pattern: Pattern) -> None:
        """Solve for matrices of another pattern from now on."""
        if self._analysed:
            self._solver.free_memory(everything=True)
        self._pattern, self._analysed = pattern, False

    def factorise(self, values: NDArray) -> None:
        """Keep the matrix of the pattern's stored entries, for solutions to come."""
        matrix = self._pattern.upper(values)
        if self._analysed:  # PARDISO reads later values, too, where those were that it analysed
            self._matrix.data[:] = matrix.data
        else:
            self._matrix = matrix
        with _reported():
            self._factorise_somehow()

    def solve_again(self, right_side: NDArray) -> NDArray:
        """Solution (n,) for the matrix that is kept and a right side (n,)."""
        with _reported(), self._costs.timed("solve"):
            return self._call(33, right_side)

    def _factorise_somehow(self) -> None:
        try:
            self._factorise()
        except PyPardisoError:
            self._solver.free_memory(everything=True)
            self._solver.set_matrix_type(self.INDEFINITE)
            self._analysed = False
            self._factorise()

    def _factorise(self) -> None:
        with self._costs.timed("factorisation"):
            if not self._analysed:
                self._call(11)
                self._analysed = True
            self._call(22)
        self._costs.count["factorisations"] += 1

    def _call(self, phase: int, right_side: NDArray | None = None) -> NDArray:
        solver, matrix = self._solver, self._matrix
        right_side = np.zeros(0) if right_side is None else np.ascontiguousarray(right_side)
        rows, columns = (part.astype(np.int32, copy=False) for part in (matrix.indptr, matrix.indices))
        solution, failed = np.zeros(right_side.size), ctypes.c_int32(0)
        # the last digits of two-level factors would depend on the number of threads
        threads = solver.libmkl.MKL_Set_Num_Threads_Local(1)
        # the wrapper's own call makes copies of the matrix's rows and columns, for each solution anew
        solver._mkl_pardiso(
            _integers(solver.pt, solver._pt_type[0]), _number(1), _number(1), _number(solver.mtype), _number(phase),
            _number(matrix.shape[0]), matrix.data.ctypes.data, _integers(rows), _integers(columns),
            _integers(solver.perm), _number(1), _integers(solver.iparm), _number(0), right_side.ctypes.data,
            solution.ctypes.data, ctypes.byref(failed),
        )  # fmt: skip
        solver.libmkl.MKL_Set_Num_Threads_Local(threads)
        if failed.value:
            raise PyPardisoError(failed.value)
        return solution


def _number(value: int) -> Any:
    return ctypes.byref(ctypes.c_int32(value))


def _integers(array: NDArray, kind: Any = ctypes.c_int32) -> Any:
    return ctypes.cast(array.ctypes.data, ctypes.POINTER(kind))


@contextmanager
def _reported() -> Iterator[None]:
    try:
        yield
    except PyPardisoError as error:
        raise LinearSolverError(f"PARDISO could not solve the system: {error}") from error


class SuperLU(_Keeping):
    """SciPy's SuperLU, for platforms without MKL."""

    def __init__(self, pattern: Pattern, costs: Costs) -> None:
        self._pattern, self._costs = pattern, costs

    def take(self, pattern: Pattern) -> None:
        """Solve for matrices of another pattern from now on."""
        self._pattern = pattern

    def factorise(self, values: NDArray) -> None:
        """Keep the matrix of the pattern's stored entries, for solutions to come."""
        with self._costs.timed("factorisation"):
            try:
                self._factor = sparse_linalg.splu(
                    self._pattern.full(values).tocsc(),
                    permc_spec="MMD_AT_PLUS_A",
                    options={"SymmetricMode": True, "DiagPivotThresh": 0.001},
                )
            except RuntimeError as error:
                raise LinearSolverError(f"SuperLU could not factorise the matrix: {error}") from error
        self._costs.count["factorisations"] += 1

    def solve_again(self, right_side: NDArray) -> NDArray:
        """Solution (n,) for the matrix that is kept and a right side (n,)."""
        with self._costs.timed("solve"):
            return self._factor.solve(right_side)


class _KeepingValues(_Keeping):
    """A solver by iteration, which has nothing to factorise."""

    def factorise(self, values: NDArray) -> None:
        """Keep the matrix of the pattern's stored entries, for solutions to come."""
        self._values = values


class ConjugateGradients(_KeepingValues):
    """Conjugate gradients with the diagonal as preconditioner, for well-conditioned systems and small corrections.

    Stops when the residual is ``tolerance`` times the norm of the diagonal, that is, for unknowns of order one: a
    right side that is already small (a warm start) costs few iterations. Sums run in one fixed order.
    """

    def __init__(self, pattern: SymmetricPattern, costs: Costs, tolerance: float = 1e-11) -> None:
        self._pattern, self._costs, self._tolerance = pattern, costs, tolerance
        self._mirror = pattern.mirror()

    def solve_again(self, right_side: NDArray) -> NDArray:
        """Solution (n,) for the matrix that is kept and a right side (n,)."""
        values, (indptr, indices, sources) = self._values, self._mirror
        diagonal = values[self._pattern.diagonal]
        smallest = self._tolerance * float(np.linalg.norm(diagonal))
        full = values[sources]
        solution = np.zeros_like(right_side)
        iterations = _conjugate_gradients(indptr, indices, full, diagonal, right_side, smallest, solution)
        if iterations < 0:
            raise LinearSolverError("conjugate gradients did not converge; is the matrix positive definite?")
        self._costs.count["cg_iterations"] += iterations
        return solution


@njit(cache=True, parallel=True)
def _multiply(indptr, indices, values, vector, product):
    for row in prange(product.size):
        total = 0.0
        for k in range(indptr[row], indptr[row + 1]):
            total += values[k] * vector[indices[k]]
        product[row] = total


@njit(cache=True)
def _conjugate_gradients(indptr, indices, values, diagonal, right_side, smallest, solution):
    """Solve in place from zero; returns the iterations, or -1 without convergence."""
    residual = right_side.copy()
    direction = residual / diagonal
    product = np.empty_like(residual)
    old = _dot(residual, direction)
    for iteration in range(10 * residual.size):
        if np.sqrt(_dot(residual, residual)) <= smallest:
            return iteration
        _multiply(indptr, indices, values, direction, product)
        step = old / _dot(direction, product)
        new = 0.0
        for i in range(residual.size):
            solution[i] += step * direction[i]
            residual[i] -= step * product[i]
            new += residual[i] * residual[i] / diagonal[i]
        for i in range(residual.size):
            direction[i] = residual[i] / diagonal[i] + new / old * direction[i]
        old = new
    return -1


@njit(cache=True)
def _dot(a, b):
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


class Gmres(_KeepingValues):
    """GMRES without preconditioner and from a zero guess, as in thesis section 3.9.11."""

    def __init__(self, pattern: SymmetricPattern, costs: Costs, tolerance: float = 1e-10) -> None:
        self._pattern, self._costs, self._tolerance = pattern, costs, tolerance

    def solve_again(self, right_side: NDArray) -> NDArray:
        """Solution (n,) for the matrix that is kept and a right side (n,)."""
        size = self._pattern.size
        with self._costs.timed("solve"):
            solution, failed = sparse_linalg.gmres(
                self._pattern.full(self._values),
                right_side,
                rtol=self._tolerance,
                restart=min(size, 500),
                maxiter=20,
                callback=self._count,
                callback_type="pr_norm",
            )
        if failed:
            raise LinearSolverError(f"GMRES did not reach {self._tolerance:g} for {size} unknowns")
        return solution

    def _count(self, _residual) -> None:
        self._costs.count["gmres_iterations"] += 1


class Empty(_Keeping):
    """Of a system without unknowns, such as that of one element whose nodes are all held."""

    def factorise(self, values: NDArray) -> None:
        """Keep nothing."""

    def solve_again(self, right_side: NDArray) -> NDArray:
        """Solution (0,) for a right side (0,)."""
        return right_side


def linear_solver(pattern: SymmetricPattern, costs: Costs, name: str = "direct") -> LinearSolver:
    """The solver called ``name``: "direct" (PARDISO, or SuperLU without MKL), "superlu", "gmres", "cg", or
    "well_conditioned" (PARDISO, which is the fastest up to 10^5 unknowns, or conjugate gradients without MKL)."""
    if not pattern.size:
        return Empty()
    if name == "gmres":
        return Gmres(pattern, costs)
    if name == "cg" or (name == "well_conditioned" and PyPardisoSolver is None):
        return ConjugateGradients(pattern, costs)
    return SuperLU(pattern, costs) if name == "superlu" else direct_solver(pattern, costs)


def direct_solver(pattern: Pattern, costs: Costs) -> DirectSolver:
    """PARDISO, or SuperLU without MKL."""
    return SuperLU(pattern, costs) if PyPardisoSolver is None else Pardiso(pattern, costs)


def lift_empty_diagonal(pattern: SymmetricPattern, values: NDArray) -> NDArray:
    """Give unknowns without stiffness a small diagonal, in place; residuals are never touched by it."""
    diagonal = values[pattern.diagonal]
    values[pattern.diagonal] = diagonal + EMPTY_DIAGONAL * diagonal.max(initial=0.0)
    return values
