"""Values of metrics and what they are held against: in a run, in print, in an exact solution."""

import difflib
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from cases import Case, Check, list_cases, load_case
from cases.errors import UserError
from cases.geometry import SLACK
from cases.judging import EACH
from physics.exact import SOLUTIONS
from physics.exact_rules import otherwise_than
from physics.surface_energy import seen_toughness as toughness_of_cells
from verify.metrics.curves import Curve
from verify.metrics.metric import Metric, MetricError
from verify.metrics.registry import METRICS, PAIR_METRICS, SWEEP_METRICS, find_metric
from verify.runs.run_folder import RunFolder

#: parameters of metrics that are times in dynamics
TIMES = {"time", "at", "u", "start", "end", "after"}
CURVE_METRICS = ("peak_force", "displacement_at_peak", "initial_stiffness")  # of a curve alone
Available = Callable[[str], RunFolder]


class JudgeError(UserError):
    """Something asked for cannot be judged; its text is one sentence with place, value and remedy."""


def asked_for(case: Case) -> str:
    """What a command calls the case: its name in the library, or its file as seen from here, quoted for a shell."""
    if case.name in list_cases() and load_case(case.name).source == case.source:
        return case.name
    here, source = Path.cwd(), Path(case.source).resolve()
    return shlex.quote(str(source.relative_to(here) if source.is_relative_to(here) else source))


def require_sense(case: Case, number: int, check: Check) -> None:
    """Refuse a check that no result could ever answer; ``number`` is its place in the case file.

    Raises
    ------
    JudgeError : unknown metric or parameter, or a metric of one run, two or a sweep in the wrong place.
    """
    _require_metric(case, number, check)
    members = members_of(case, check.run)
    kind, name = check.target
    where = f"{case.source}: checks[{number}]"
    if check.metric in PAIR_METRICS and not _has_counterpart(case, check):
        raise JudgeError(
            f"{where}.against: {check.metric} needs another run or curve, not {check.against!r}."
        )
    if check.measure == "relative" and kind != "none" and check.metric not in PAIR_METRICS and check.limit >= 1.0:
        remedy = 'give a share, such as 0.05 for 5 %, or measure = "absolute"'
        raise JudgeError(f"{where}.limit: {check.limit:g} lets a value of 0 pass for any; {remedy}.")
    if check.metric not in SWEEP_METRICS and members != [check.run]:
        raise JudgeError(f"{where}.run: {check.run!r} is a sweep; name {_choice(check.run, members)}.")
    if check.metric in SWEEP_METRICS and kind in ("run", "exact"):
        raise JudgeError(f"{where}.against: {check.metric} of a sweep needs a value, not {check.against!r}.")
    if kind == "run" and members_of(case, name) != [name]:
        raise JudgeError(
            f"{where}.against: {name!r} is a sweep; name {_choice(name, members_of(case, name))}."
        )


def _choice(family: str, members: list[str]) -> str:
    return f"all of them, {family + EACH!r}, or one: {', '.join(members)}"


def require_known(name: str, where: str) -> Metric:
    """The metric of a name; JudgeError with the nearest one where there is none. ``where`` : its place in the file."""
    try:
        return find_metric(name)
    except MetricError as error:
        known = [*METRICS, *PAIR_METRICS, *SWEEP_METRICS]
        near = difflib.get_close_matches(name, known, n=1)
        remedy = f"did you mean {near[0]!r}?" if near else f"choose one of {', '.join(known)}."
        raise JudgeError(f"{where}: {name!r} is not a metric; {remedy}") from error


def _require_metric(case: Case, number: int, check: Check) -> None:
    where = f"{case.source}: checks[{number}]"
    metric = require_known(check.metric, f"{where}.metric")
    for name, value in check.parameters.items():
        if name not in metric.parameters:
            known_names = ", ".join(metric.parameters) or "none"
            raise JudgeError(
                f"{where}.parameters.{name}: {check.metric} has no such parameter; it has: {known_names}."
            )
        called, fits = metric.kind_of(name)
        if not fits(value):
            remedy = f"give a plain {called}, in the units of the case" if "number" in called else f"give a {called}"
            raise JudgeError(f"{where}.parameters.{name}: {value!r} is no {called}; {remedy}.")
    lacking = [name for name in metric.needed_parameters if name not in check.parameters]
    if lacking:
        raise JudgeError(f"{where}.parameters: {check.metric} needs {', '.join(lacking)}; add what is missing.")
    _require_body_and_time(case, check, f"{where}.parameters")


def _require_body_and_time(case: Case, check: Check, where: str) -> None:
    """Refuse a body that the case does not have, and a time that its runs do not reach."""
    body = check.parameters.get("body")
    if body is not None and body not in case.bodies:
        raise JudgeError(f"{where}.body: {body!r} is no body of this case; name one of {', '.join(case.bodies)}.")
    end = _latest_end(case, members_of(case, check.run))
    for name in sorted(TIMES & check.parameters.keys()):
        time = check.parameters[name]
        if isinstance(time, int | float) and time > end * (1.0 + SLACK):
            raise JudgeError(f"{where}.{name}: {time:g} comes after dynamics.end_time = {end:g}; give a time up to it.")


def _latest_end(case: Case, runs: Sequence[str]) -> float:
    """Time at which the last of the runs ends; infinite where none moves in time [time]."""
    if case.dynamics is None:
        return np.inf
    own = (case.run_spec(name).change.get("dynamics", {}).get("end_time", case.dynamics.end_time) for name in runs)
    return max((float(end) if isinstance(end, int | float) else np.inf for end in own), default=case.dynamics.end_time)


def _has_counterpart(case: Case, check: Check) -> bool:
    kind, name = check.target
    if kind == "run":
        return True
    if check.metric.startswith("path_"):
        return False
    return kind == "exact" or (kind == "reference" and case.references[name].curve is not None)


def members_of(case: Case, run_name: str) -> list[str]:
    """The run itself, or all runs of the sweep of that name."""
    if run_name in case.expanded_runs():
        return [run_name]
    return [name for name in case.expanded_runs() if case.run_spec(name).family == run_name]


def is_printed(case: Case, check: Check) -> bool:
    """The check holds a value against one that somebody printed."""
    kind, name = check.target
    return kind == "reference" and check.metric in case.references[name].values


def value_of(check: Check, case: Case, available: Available) -> float:
    """What the run gives for the check's metric; MetricError or CurveError where it gives nothing.

    available : the finished run of a name; it raises where there is none.
    """
    runs = [available(name) for name in members_of(case, check.run)]
    if check.metric in SWEEP_METRICS:
        return SWEEP_METRICS[check.metric](runs, **check.parameters)
    if check.metric in PAIR_METRICS:
        return PAIR_METRICS[check.metric](runs[0], _counterpart(check, case, available), **check.parameters)
    return find_metric(check.metric)(runs[0], **check.parameters)


def _counterpart(check: Check, case: Case, available: Available) -> RunFolder | Curve:
    kind, name = check.target
    if kind == "run":
        return available(name)
    return reference_curve(case, name) if kind == "reference" else exact_curve(available(check.run))


def reference_curve(case: Case, name: str) -> Curve:
    """The published curve of a reference."""
    points = case.reference_curve(name)
    return Curve(points[:, 0], points[:, 1], f"reference {name}")


def exact_curve(run: RunFolder) -> Curve:
    """Exact force at the displacements of a run."""
    case = run.case
    _require_exact(case)
    force = SOLUTIONS[case.exact].force if case.exact in SOLUTIONS else None
    if force is None:
        raise MetricError(
            f"{case.name}: its exact solution {case.exact!r} gives no force; check another metric"
        )
    u = run.history["u"].to_numpy()
    return Curve(u, np.array([force(case, float(value)) for value in u]), "exact solution")


def target_of(check: Check, case: Case, available: Available) -> float | None:
    """The metric's value elsewhere; None where the metric is a distance, whose target is nought."""
    kind, name = check.target
    if kind == "none" or check.metric in PAIR_METRICS:
        return None
    if kind == "value":
        return float(name)
    if kind == "run":
        return find_metric(check.metric)(available(name), **check.parameters)
    if kind == "reference":
        return _published(check, case, name)
    return _exact(check, available(check.run))


def _published(check: Check, case: Case, name: str) -> float:
    values = case.references[name].values
    if check.metric in values:
        return values[check.metric]
    if check.metric not in CURVE_METRICS:
        raise MetricError(
            f"references.{name}.values: has no {check.metric}, nor does its curve tell it; add it"
        )
    return METRICS[check.metric](reference_curve(case, name))


def _exact(check: Check, run: RunFolder) -> float:
    case = run.case
    _require_exact(case)
    solution = SOLUTIONS.get(case.exact or "")
    if solution and check.metric in solution.values:
        return solution.values[check.metric](case, **check.parameters)
    if check.metric in CURVE_METRICS:
        return METRICS[check.metric](exact_curve(run))
    if check.metric == "fracture_energy" and solution and solution.fracture_energy:
        return solution.fracture_energy(case)
    if check.metric in ("energy_release_rate", "fracture_energy_rate") and any(c.motion for c in case.constraints):
        return seen_toughness(case)
    raise MetricError(f"{case.name}: no exact value of {check.metric} is known; check it against a value")


def _require_exact(case: Case) -> None:
    """Raise MetricError for a run that is none of the cases of its exact solution, such as a result kept from before."""
    if case.exact in SOLUTIONS and (otherwise := otherwise_than(case, case.exact)):
        raise MetricError(f"{case.name}: its exact solution {case.exact!r} {otherwise}")


def seen_toughness(case: Case) -> float:
    """Gc (1 + h / (4 l0)) of the first material that breaks: what a mesh of size h makes of the toughness."""
    fractures = [material.fracture for material in case.materials.values() if material.fracture]
    if not fractures:
        raise MetricError(f"{case.name}: no material can break, so there is no toughness; add one")
    return toughness_of_cells(fractures[0], case.mesh.h)
