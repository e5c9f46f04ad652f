"""What a solver itself measured (``measures`` of run.json), and orders of convergence over the runs of a sweep."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from verify.metrics.metric import REGISTERED, MetricError, NotGivenError, metric, run_name

if TYPE_CHECKING:
    from cases import Case
    from verify.metrics.metric import RunData


@metric("number", "a scalar that the solver measured, by its name")
def measure(run: RunData, *, name: str) -> float:
    """A scalar that the solver itself measured (``measures`` of run.json)."""
    value = run.info.get("measures", {}).get(name)
    if value is None:
        known = ", ".join(run.info.get("measures", {})) or "none"
        raise NotGivenError(f"{run_name(run)}: has no measure {name}; it has {known}")
    return float(value)


def _register(name: str, meaning: str, unit: str = "number") -> None:
    def value(run: RunData) -> float:
        return measure(run, name=name)

    metric(unit, meaning, name=name)(value)


_register("constraint_error", "largest violation of a constraint")
_register("element_quality", "least scaled Jacobian of the moved elements")
_register("profile_error", "error of the phase-field profile")
_register("l2_error_displacement", "relative L2 error of the displacement")
_register("contact_half_width", "half-width of the pressure on a floor", "length")
_register("peak_pressure", "largest pressure on a floor under the bodies' weight", "stress")
_register("l2_error_stress", "relative L2 error of the stress")
_register("l2_error_phase_field", "relative L2 error of the phase field")
_register("border_after_impacts", "least amplitude over that of uplift at which the block falls after impacts")
_register("border_standing_again", "amplitude over that of uplift above which the block stands again")
_register("border_without_impact", "amplitude over that of uplift above which the block falls without impact")
_register("energy_between_impacts", "largest change of the energy of free rocking between impacts")


def fitted_order(h: ArrayLike, error: ArrayLike) -> float:
    """Order of convergence: slope of the least-squares line of log(error) over log(h)."""
    h, error = np.asarray(h, dtype=float), np.asarray(error, dtype=float)
    usable = len(h) == len(error) >= 2 and np.ptp(h) > 0 and np.all(h > 0) and np.all(error > 0)
    if not (usable and np.all(np.isfinite(error))):
        raise MetricError(
            "an order of convergence needs two or more different sizes with positive errors, "
            f"got h = {h.tolist()} and errors {error.tolist()}; widen the sweep"
        )
    return float(np.polyfit(np.log(h), np.log(error), 1)[0])


@metric("number", "fitted order of convergence of an error", of="sweep")
def convergence_order(runs: Sequence[RunData], *, of: str = "l2_error_displacement", over: str = "mesh.h") -> float:
    """Fitted order of a metric of one run over a number of the case (dotted key), of the runs of a sweep."""
    if of not in REGISTERED or REGISTERED[of].of != "run":
        raise MetricError(f"metric convergence_order: of = {of!r} is no metric of one run; name one")
    return fitted_order([_number(run.case, over) for run in runs], [REGISTERED[of](run) for run in runs])


def _number(case: Case, dotted: str) -> float:
    value: Any = case
    for key in dotted.split("."):
        value = getattr(value, key, None)
    if not isinstance(value, int | float):
        raise MetricError(f"metric convergence_order: {dotted} is no number of the case; try 'mesh.h'")
    return float(value)
