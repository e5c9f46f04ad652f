"""Indicators of a run's history: balance of energy, range of the phase field, what increments cost the largest force."""

from __future__ import annotations

import numpy as np
import pandas as pd

from cases import Case
from numerics.fields import Fields
from verify.health.peak import lagging_crack, lost_at_crossings, missed_peak
from verify.health.state import ROUND_OFF, WHOLE, uses_points
from verify.metrics.histories import largest_energy, missing_energy

#: energies below this share of that which would stretch a body by as much as it is moved are none
_LEAST = 1e-9


def of_history(case: Case, history: pd.DataFrame, fields: Fields | None) -> dict[str, float]:
    """`energy_balance`, `phase_field_range`, `missed_peak`, `lagging_crack` and `lost_at_crossings`."""
    if not len(history):
        return {}
    found = {}
    if case.fracture_enabled:
        highest = 1.0 if fields is None else float(fields.phase_field.max(initial=1.0))
        found["phase_field_range"] = max(0.0, highest - 1.0, -float(history["c_min"].min()))
    rows = history if case.dynamics else history[history["c_min"].to_numpy() >= WHOLE]
    if len(rows) > 1 and case.exact is None:
        scale = max(largest_energy(rows), ROUND_OFF * _held_back(case, rows), _LEAST * _stretched(case, fields))
        if scale > 0.0:
            found["energy_balance"] = float(np.abs(missing_energy(rows)).max() / scale)
        if not case.dynamics and uses_points(case) and case.mpm.move_points:
            found["lost_at_crossings"] = lost_at_crossings(rows, scale)
    fields_move = case.exact is not None or any(constraint.motion for constraint in case.constraints)
    if case.fracture_enabled and not case.dynamics and not fields_move:
        found["missed_peak"] = missed_peak(history)
        found |= {"lagging_crack": lagging_crack(history)} if case.staggered.scheme == "passes" else {}
    return found


def _stretched(case: Case, fields: Fields | None) -> float:
    """Energy that would stretch bodies at rest by the largest displacement [energy]; 0 in dynamics."""
    if fields is None or case.dynamics:
        return 0.0
    used = [case.materials[body.material] for body in case.bodies.values()]
    stiffest = max(float(m.stiffness.matrix().max()) if m.stiffness else m.lam + 2.0 * m.mu for m in used)
    return stiffest * case.plane.thickness * float((fields.displacement**2).max(initial=0.0))


def _held_back(case: Case, history: pd.DataFrame) -> float:
    """Energy that eigenstrains would store in bodies that are held all round [energy]; 0 without any."""
    if not case.eigenstrains:
        return 0.0
    from physics.acting import eigenstrains, eigenstress, work_density  # judging does without compiled laws
    from physics.elasticity import MaterialTable

    gradient = eigenstrains(case).at(history["u"].abs().max())
    stress = eigenstress(MaterialTable(case), gradient, np.arange(len(case.bodies)))
    lower, upper = case.bounding_box()
    return float(0.5 * work_density(stress, gradient).max() * np.prod(upper - lower) * case.plane.thickness)
