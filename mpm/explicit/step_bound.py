"""The largest time step of material points: a bound proven for B-splines with lumped mass, or the Courant number."""

from __future__ import annotations

import numpy as np

from cases import Case, CaseError
from numerics.time_steps import courant_step, deforming_bodies
from physics.elasticity import MaterialTable

#: h² times the largest sum over I of (dN_I/dx)² / N_I of one direction; hat functions have none
LARGEST_GRADIENT = {2: 6.0, 3: 3.136820}


def largest_eigenvalue(order: int, spacing: float, lam: float, mu: float, density: float) -> float:
    """Bound of the largest eigenvalue of M⁻¹ K for any cloud of points on a uniform grid [1/time²].

    Mass and stiffness are sums over the points, so the largest eigenvalue is at most the largest one of a single
    point, that of D diag(Sx, Sy, Sx + Sy) / density with Sx = sum over I of (dN_I/dx)² / N_I: the functions of the
    other direction sum to one, and mixed products of derivatives to zero. More mass does not raise it, nor does
    damage but of the star-convex split: `MaterialTable.stiffest` has its constants.

    Parameters
    ----------
    order : of the splines. lam, mu : in-plane Lamé constants [stress]. density : [force time²/length⁴].
    """
    gradient = LARGEST_GRADIENT[order] / spacing**2
    return max(2.0 * (lam + mu), 2.0 * mu) * gradient / density


def proven_step(case: Case) -> float:
    """Largest step that is stable for any cloud of points of the case's bodies [time].

    It is 2 / sqrt(a lambda_max). Of a change of the nodes' velocities the points keep the share P = M⁻¹ Nᵀ m N, and
    where strains come before the points' velocities (USL), what counts is the largest eigenvalue of (2 - P) M⁻¹ K, at
    most twice that of M⁻¹ K: a = 2, which a single point reaches. The affine map keeps all of a point's motion, and
    a = 1 there; where strains come last (MUSL) it is that of P M⁻¹ K, and a = 1.

    Raises CaseError for hat functions: a point near a cell's edge may need any step.
    """
    table, order = MaterialTable(case), case.mpm.order
    if order not in LARGEST_GRADIENT:
        raise CaseError(
            f"{case.source}: dynamics.time_step_rule: no step is proven for hat functions (mpm.order = 1); give"
            ' mpm.order = 2 or 3, time_step_rule = "courant", or a time_step.'
        )
    values = [
        largest_eigenvalue(order, case.mesh.h, lam[i], mu[i], table.density[i])
        for lam, mu in table.stiffest
        for i in deforming_bodies(case)
    ]
    assert case.dynamics is not None
    lost = case.dynamics.order_of_update == "usl" and not case.dynamics.affine
    return 2.0 / float(np.sqrt((2.0 if lost else 1.0) * max(values)))


def stable_step(case: Case) -> float:
    """The case's rule for material points on a uniform grid, before its share [time].

    For hat functions whose step is given it is the Courant step. Raises CaseError as `proven_step`.
    """
    dynamics = case.dynamics
    assert dynamics is not None
    is_proven = dynamics.time_step_rule == "proven" and (dynamics.time_step is None or case.mpm.order in LARGEST_GRADIENT)
    return proven_step(case) if is_proven else courant_step(case)
