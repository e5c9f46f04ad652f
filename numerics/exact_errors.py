"""Relative errors of the fields against a case's exact solution."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cases import Case
from physics.exact import SOLUTIONS

from .fields import Fields


def exact_errors(case: Case, fields: Fields, load: float) -> dict[str, float]:
    """Relative L2 errors by quadrature at the integration points; empty without an exact solution."""
    if case.exact is None:
        return {}
    solution = SOLUTIONS[case.exact]
    errors = {}
    if solution.displacement is not None:
        exact = solution.displacement(case, fields.reference, load)
        errors["l2_error_displacement"] = _relative_error(fields.displacement, exact, fields.volume)
    if solution.phase_field is not None:
        exact = solution.phase_field(case, fields.reference, load)
        errors["l2_error_phase_field"] = _relative_error(fields.phase_field, exact, fields.volume)
    return errors


def moving_errors(case: Case, fields: Fields) -> dict[str, float]:
    """Relative L2 errors of moved points at the end of a dynamic run; empty without an exact solution."""
    solution = SOLUTIONS.get(case.exact or "")
    if solution is None or solution.stress is None or solution.displacement is None or case.dynamics is None:
        return {}
    end = case.dynamics.end_time
    displacement = solution.displacement(case, fields.reference, end)
    return {
        "l2_error_displacement": _relative_error(fields.displacement, displacement, fields.volume),
        "l2_error_stress": _relative_error(fields.stress, solution.stress(case, fields.points, end), fields.volume),
    }


def _relative_error(values: NDArray, exact: NDArray, volume: NDArray) -> float:
    def norm(field: NDArray) -> float:
        return float(np.sqrt((volume * (field.reshape(len(volume), -1) ** 2).sum(axis=1)).sum()))

    return norm(values - exact) / norm(exact)
