"""Time steps of explicit integration by the Courant number, and the one that a case asks for."""

from __future__ import annotations

import numpy as np

from cases import Case
from physics.elasticity import MaterialTable

#: share by which a step may be longer than another one and yet be the same
SAME_STEP = 1e-9


def deforming_bodies(case: Case) -> list[int]:
    """Numbers of the bodies that waves run through."""
    return [number for number, body in enumerate(case.bodies.values()) if body.deforms]


def courant_step(case: Case) -> float:
    """h / c of the body with the fastest pressure waves, c = sqrt((lambda + 2 mu) / density) (Eq. 6.48) [time]."""
    table = MaterialTable(case)
    speeds = np.sqrt([(lam + 2.0 * mu) / table.density for lam, mu in table.stiffest])
    return case.mesh.h / float(speeds[:, deforming_bodies(case)].max())


def step_size(case: Case, stable: float) -> float:
    """Step that the case asks for where `stable` is the step by its rule [time]."""
    assert case.dynamics is not None
    return case.dynamics.time_step or case.dynamics.time_step_share * stable


def beyond_stable(case: Case, stable: float) -> str:
    """What is wrong with a step that is longer than the one by the case's rule, `stable`; nothing where it is not."""
    size = step_size(case, stable)
    if size <= stable * (1.0 + SAME_STEP):
        return ""
    assert case.dynamics is not None
    key = "time_step" if case.dynamics.time_step else "time_step_share"
    return (
        f"the time step {size:.4g} is {size / stable:.3g} times the longest one that is stable by dynamics.time_step_rule"
        f" ({stable:.4g}); leave out dynamics.{key}, or lower it"
    )
