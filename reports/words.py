"""Numbers, metrics and verdicts in words; every sentence is made from the summary's numbers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from verify.metrics.metric import MetricError
from verify.metrics.registry import find_metric
from verify.metrics.registry import metric_unit as unit_of_metric

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from cases import Case

VERDICT_WORDS = {
    "PASS": "Pass",
    "FAIL": "Fail",
    "RUN_FAILED": "Run failed",
    "NOT_CHECKED": "Not checked",
    "MISSING": "Missing",
    "SUSPECT": "Suspect",
    "NEEDS_RECORD": "Needs a record",
    "INFO": "Shown only",
}

#: what charts and maps vary, by the last part of its key: in words, and its kind of quantity or its unit
LEVELS = {
    "h": ("cell size h", "length"),
    "points_per_cell": ("points per cell in each direction", ""),
    "order": ("order of the splines", ""),
    "penalty": ("penalty, in multiples of the stiffness", ""),
    "linear_solver": ("linear solver", ""),
    "method": ("linear solver", ""),
    "allowed": ("iterations allowed", ""),
    "damage": ("damage 1 − c of the crack", ""),
    "residual_stiffness": ("share of the stiffness left where broken", ""),
    "length_scale": ("length scale l0", "length"),
    "increment": ("load increment", "load"),
    "passes": ("passes per increment", ""),
    "scheme": ("scheme of an increment", ""),
    "tolerance": ("tolerance of the staggered scheme", ""),
    "u": ("displacement reached", "load"),
    "run": ("run", ""),
    "cells": ("cells in the bar", ""),
    "distance": ("distance travelled, in lengths of the bar", ""),
    "angle": ("angle turned", "°"),
    "rotation": ("rotation of the strain", ""),
    "friction": ("coefficient of friction", ""),
    "slope": ("slope", "°"),
    "share": ("time step, as a share of the one by rule", ""),
    "time_step_share": ("time step, as a share of the one by rule", ""),
    "cloud": ("cloud of points", ""),
    "update": ("order of update", ""),
    "flip": ("share of FLIP, the rest being PIC", ""),
    "end_time": ("time", "time"),
    "young": ("Young's modulus", "stress"),
    "uplift_ratio": ("amplitude of the pulse over that which lifts the block", ""),
    "frequency_ratio": ("frequency of the pulse over the block's", ""),
}


def level_in_words(key: str, case: Case | None = None) -> str:
    """Return the key of what is varied as words with its unit."""
    name = key.rpartition(".")[2]
    words, kind = LEVELS.get(name, (name.replace("_", " "), ""))
    unit = kind
    if case is not None and kind not in ("", "°"):
        unit = case.unit(case.load_kinds[0] if kind == "load" else kind)
    return f"{words} [{unit}]" if unit not in ("", "1") and (case or kind == "°") else words


def number(value: Any, digits: int = 4) -> str:
    """Return a number with ``digits`` significant digits; a dash when there is none."""
    if value is None or isinstance(value, str) or not math.isfinite(value):
        return "–" if value is None or isinstance(value, str) else str(value)
    if value != 0 and not 1e-3 <= abs(value) < 1e5:
        mantissa, exponent = f"{value:.{max(digits - 2, 1)}e}".split("e")
        return f"{mantissa}·10{str(int(exponent)).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))}"
    return f"{value:.{digits}g}" if abs(value) < 10 ** (digits - 1) else f"{value:.0f}"


def whole(value: Any) -> str:
    """Return a count with thin spaces between thousands; a dash when there is none."""
    return "–" if value is None else f"{int(value):,}".replace(",", "\u202f")


def percent(value: Any, digits: int = 3) -> str:
    """Return a share as percent."""
    return "–" if value is None or not math.isfinite(value) else f"{number(100 * value, digits)} %"


def section_words(section: str) -> str:
    """Return ``section 4.4.1 of the thesis``; a source that is no number of a section stands as it is."""
    return f"section {section} of the thesis" if section[:1].isdigit() else section


def plural(count: int, noun: str, nouns: str = "") -> str:
    """Return ``1 check``, ``2 checks``, ``3 bodies``."""
    return f"{count} {noun}" if count == 1 else f"{count} {nouns or noun + 's'}"


def listed(items: Iterable[str]) -> str:
    """Return ``a, b and c``."""
    names = list(items)
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def metric_in_words(metric: str) -> str:
    """Return the metric's name as words."""
    words = metric.replace("_", " ").replace("l2", "L2").strip()
    return words[:1].upper() + words[1:]


def metric_meaning(metric: str) -> str:
    """Return what a metric measures; nothing for one that is not known."""
    try:
        return find_metric(metric).meaning
    except MetricError:
        return ""


def metric_unit(metric: str, case: Case | None) -> str:
    """Return the unit of a metric; nothing for pure numbers and without a case."""
    try:
        unit = unit_of_metric(metric, case) if case else ""
    except MetricError:
        return ""
    return "" if unit == "1" else unit


def against_in_words(against: str) -> str:
    """Return what a value is compared with as words."""
    kind, _, name = against.partition(":")
    sentences = {"none": "is itself an error", "exact": "exact solution", "baseline": "baseline"}
    return {"reference": f"published: {name}", "value": f"value {name}"}.get(
        kind, sentences.get(kind, against)
    )


def worst_check(checks: Iterable[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """Return the gated check that uses most of its limit."""
    gated = [check for check in checks if check.get("gate", True) and check.get("margin_used") is not None]
    return max(gated, key=lambda check: check["margin_used"], default=None)


def measured_error(check: Mapping[str, Any], key: str = "error") -> str:
    """Return a check's error (or limit) in the measure that it is judged in."""
    value = check.get(key)
    is_itself_an_error = check.get("target") is None and check.get("error") is not None
    relative = check.get("measure", "relative") == "relative" and not is_itself_an_error
    return percent(value) if relative else number(value)


def check_in_words(check: Mapping[str, Any]) -> str:
    """Return one check as a clause: metric, run, what against, error and limit."""
    against = check.get("against", "none")
    compared = "" if against == "none" else f" against {against_in_words(against)}"
    return f"{_short(check)}{compared}: error {measured_error(check)}, limit {measured_error(check, 'limit')}"


def key_number(checks: Iterable[Mapping[str, Any]]) -> str:
    """Return the value that the case's first gated check is about, and its target; nothing without a value."""
    gated = [check for check in checks if check.get("gate", True) and check.get("value") is not None]
    if not gated:
        return ""
    check, against = gated[0], str(gated[0].get("against", "none"))
    unit = "" if check.get("unit") in (None, "1") else f" {check['unit']}"
    target = "" if check.get("target") is None else f" against {number(check['target'])}{unit}"
    target += f" ({against_in_words(against)})" if target and not against.startswith("value:") else ""
    said = f"{_short(check)} {number(check['value'])}{unit}{target}"
    return said[:1].upper() + said[1:]


def verdict_sentence(entry: Mapping[str, Any]) -> str:
    """Return what the checks of a case say, in one or two sentences made from their numbers."""
    checks = [check for check in entry.get("checks") or [] if check.get("gate", True)]
    if not checks:
        return "No gated check was evaluated for this case."
    passed = [check for check in checks if check.get("verdict") == "PASS"]
    missing = [check for check in checks if check.get("verdict") in ("MISSING", "NEEDS_RECORD")]
    sentences = [f"{len(passed)} of {plural(len(checks), 'gated check')} within the limit."]
    if missing:
        sentences.append(f"Not evaluated: {listed(_short(check) for check in missing)}.")
    worst = worst_check(checks)
    if worst is not None:
        used = percent(worst["margin_used"])
        sentences.append(f"The tightest uses {used} of its limit ({check_in_words(worst)}).")
    return " ".join(sentences)


def _short(check: Mapping[str, Any]) -> str:
    return f"{metric_in_words(str(check['metric'])).lower().replace('l2', 'L2')} of {check['run']}"


def runs_sentence(runs: Sequence[Any]) -> str:
    """Return how the runs of a case ended, naming those without a usable end."""
    bad = [run for run in runs if not run.status.good]
    if not runs:
        return "No run is recorded for this case."
    if not bad:
        return f"{'All ' if len(runs) > 1 else ''}{plural(len(runs), 'run')} ended as intended."
    said = (f"{run.name} ({run.status.words})" for run in bad)
    return f"{len(bad)} of {plural(len(runs), 'run')} did not end as intended: {listed(said)}."


def overview_sentence(cases: Sequence[Mapping[str, Any]]) -> str:
    """Return the count of verdicts over all cases."""
    counts: dict[str, int] = {}
    for case in cases:
        verdict = str(case.get("verdict") or "MISSING")
        counts[verdict] = counts.get(verdict, 0) + 1
    told = ", ".join(f"{VERDICT_WORDS.get(v, v)} {count}" for v, count in sorted(counts.items()))
    return f"{plural(len(cases), 'case')}: {told}." if cases else "The summary holds no case."
