"""Iterative solvers on the linear systems of a body that a crack has broken through, beside SuperLU's factor.

Bare methods of scipy, to show what each can bear: the solvers' own linear algebra is guarded against such systems.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse.linalg as sparse_linalg
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from cases import Case
from fem_reference.boundary import NodeConstraints
from fem_reference.element_basis import ElementBasis
from fem_reference.quasi_static import displacement_kernels as kernels
from numerics.sparse_pattern import LocalSystems, SymmetricPattern, gather_vector
from physics.elasticity import MaterialTable
from physics.phase_field import degradation
from verify.studies.verdicts import NO_CONVERGENCE, STABLE, Verdict

#: relative residual that a method has to reach, and how much more round-off may make of it
TOLERANCE, ROUND_OFF = 1e-10, 10.0


@dataclass
class System:
    """A matrix, that of the whole body and a right side; the iterations done, of those that are allowed."""

    matrix: csr_matrix
    whole: csr_matrix
    right_side: NDArray
    allowed: int
    done: int = 0

    def count(self, _: object) -> None:
        """One iteration more."""
        self.done += 1


def krylov(case: Case, *, method: str, damage: float, residual_stiffness: float, allowed: int) -> Verdict:
    """Iterations of a method on the stiffness of a body with a crack from side to side at half of its length.

    method : a name of `METHODS`
    damage : 1 - c on the crack, which is two elements wide and fades over four more
    residual_stiffness : k_f of the degradation g = (1 - k_f) c² + k_f
    allowed : iterations after which the method is given up
    """
    body = CrackedBody(case)
    matrix, right_side = body.equations(damage, residual_stiffness)
    system = System(matrix, body.equations(0.0, 0.0)[0], right_side, allowed)
    with np.errstate(divide="ignore", invalid="ignore"), warnings.catch_warnings():
        # a singular matrix shows in the solution
        warnings.simplefilter("ignore", sparse_linalg.MatrixRankWarning)
        solution = METHODS[method](system)
    left = float(np.linalg.norm(matrix @ solution - right_side) / np.linalg.norm(right_side))
    if left <= ROUND_OFF * TOLERANCE:
        return Verdict(STABLE, iterations=system.done)
    return Verdict(NO_CONVERGENCE, iterations=system.done, reason=f"a residual above {TOLERANCE:g} is left")


class CrackedBody:
    """Elastic equations of the body of a case, on its mesh and with its constraints, for any phase field."""

    def __init__(self, case: Case) -> None:
        self._basis, table = ElementBasis(case), MaterialTable(case)
        self._constraints, body = NodeConstraints(case, self._basis.nodes), self._basis.body
        unknowns = (2 * self._basis.elements[:, :, None] + np.arange(2)).reshape(len(body), -1)
        self._equations = self._constraints.equations[unknowns]
        self._pattern = SymmetricPattern(self._equations, self._constraints.size)
        self._law = table.law.without_split(), body.astype(np.uint32)
        lower, upper = case.bounding_box()
        from_crack = np.abs(self._basis.gauss_points[..., 0] - 0.5 * (lower[0] + upper[0])) / case.mesh.h
        self._fade = np.exp(-np.maximum(from_crack - 1.0, 0.0))

    def equations(self, damage: float, residual_stiffness: float) -> tuple[csr_matrix, NDArray]:
        """Stiffness (n, n) [force/length] and right side (n,) [force] of what is prescribed at a load of one."""
        basis, shape = self._basis, self._basis.volume.shape
        prescribed = np.where(self._constraints.prescribed, self._constraints.prescribed_values(1.0), 0.0)
        gradient, stress, psi = np.zeros((*shape, 4)), np.empty((*shape, 3)), np.empty((*shape, 2))
        local, forces = LocalSystems.empty(*self._equations.shape)
        g = degradation(1.0 - damage * self._fade, residual_stiffness)
        kernels.displacement_gradients(
            basis.elements, basis.slope, prescribed.reshape(-1, 2), np.zeros_like(gradient), gradient
        )
        measured = basis.slope, kernels.WITHOUT_DILATION, basis.volume
        kernels.internal_forces(*measured, gradient, g, *self._law, forces, stress, psi)
        kernels.tangents(*measured, gradient, g, *self._law, local)
        matrix = self._pattern.full(self._pattern.gather(local))
        return matrix, -gather_vector(self._equations, forces, self._constraints.size)


def _direct(system: System) -> NDArray:
    return sparse_linalg.spsolve(system.matrix.tocsc(), system.right_side)


def _gmres(system: System) -> NDArray:
    """Without preconditioner and without restart."""
    return sparse_linalg.gmres(
        system.matrix, system.right_side, rtol=TOLERANCE, restart=system.allowed, maxiter=1,
        callback=system.count, callback_type="pr_norm",
    )[0]  # fmt: skip


def _diagonal(system: System) -> NDArray:
    over = 1.0 / system.matrix.diagonal()
    return _conjugate_gradients(system, lambda residual: over * residual)


def _old_factor(system: System) -> NDArray:
    return _conjugate_gradients(system, sparse_linalg.factorized(system.whole.tocsc()))


def _conjugate_gradients(system: System, precondition: Callable[[NDArray], NDArray]) -> NDArray:
    operator = sparse_linalg.LinearOperator(system.matrix.shape, matvec=precondition)
    return sparse_linalg.cg(
        system.matrix, system.right_side, rtol=TOLERANCE, maxiter=system.allowed, M=operator, callback=system.count
    )[0]


#: GMRES as it is, conjugate gradients with the diagonal or with the factor of the whole body, and the direct solver
METHODS: dict[str, Callable[[System], NDArray]] = {
    "gmres": _gmres, "diagonal": _diagonal, "old_factor": _old_factor, "direct": _direct,
}  # fmt: skip
