"""Tables of a case's page: checks, runs, cost, prices; every number is a text already."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cases import load_case
from numerics.status import RunStatus
from verify.health import INDICATORS
from verify.planning.recorded_prices import current_prices

from .words import (
    against_in_words,
    measured_error,
    metric_in_words,
    metric_meaning,
    metric_unit,
    number,
    percent,
    whole,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd

    from .results import CaseResults, RunResults

COUNTER_WORDS = {
    "unknowns_displacement": "unknowns, displacement",
    "unknowns_phase_field": "unknowns, phase field",
    "points": "integration points",
    "cells": "cells",
}


def check_groups(results: CaseResults) -> list[dict[str, Any]]:
    """Return the checks by metric and its parameters; in each ``parts`` of rows that share reason, source and note."""
    groups: dict[tuple[str, str], dict[str, Any]] = {}
    for check in results.checks:
        metric = str(check["metric"])
        parameters = ", ".join(f"{name} = {value}" for name, value in (check.get("parameters") or {}).items())
        group = groups.setdefault(
            (metric, parameters),
            {
                "metric": metric_in_words(metric), "meaning": metric_meaning(metric), "parameters": parameters,
                "unit": metric_unit(metric, results.case), "parts": {},
            },
        )  # fmt: skip
        why = tuple(str(check.get(key) or "") for key in ("reason", "source", "note"))
        group["parts"].setdefault(why, []).append(_check_row(check))
    return list(groups.values())


def _check_row(check: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "run": check["run"],
        "against": against_in_words(str(check.get("against", ""))),
        "value": number(check.get("value")),
        "target": number(check.get("target")),
        "error": measured_error(check),
        "limit": measured_error(check, "limit"),
        "margin": check.get("margin_used"),
        "margin_text": percent(check.get("margin_used")),
        "verdict": check.get("verdict", "MISSING"),
        "gate": check.get("gate", True),
    }


def staggered_iterations(run: RunResults) -> int:
    """Return the number of staggered iterations of a run, of a moving one those of all steps, told or not."""
    told = run.history["staggered"]
    steps = _steps(run)
    return int(told.sum()) if steps is None else int(steps * told.iloc[-1])


def seconds_per_iteration(run: RunResults) -> float | None:
    """Return the processor seconds per staggered iteration, compilation left out; None without iterations."""
    seconds = run.entry.get("seconds") or {}
    total = seconds.get("processor", seconds.get("total"))
    iterations = staggered_iterations(run)
    return total / iterations if total is not None and iterations else None


def _steps(run: RunResults) -> int | None:
    """Steps in time of a run that moves; None of one at rest, whose history tells every increment."""
    return (run.entry.get("counters") or {}).get("steps")


def cost_table(results: CaseResults) -> dict[str, Any]:
    """Return ``runs`` (column heads) and ``rows`` of (words, one text per run) of what each run took."""
    runs = results.shown_runs()
    rows = [("method", [run.method.title for run in runs])]
    for key in _keys(runs, "counters"):
        counts = [whole((run.entry.get("counters") or {}).get(key)) for run in runs]
        rows.append((COUNTER_WORDS.get(key, key.replace("_", " ")), counts))
    rows += [
        ("increments", [whole(len(run.history) - 1 if _steps(run) is None else None) for run in runs]),
        ("staggered iterations", [whole(staggered_iterations(run)) for run in runs]),
        ("Newton iterations", [whole(run.history["newton"].sum()) for run in runs]),
    ]
    for key in _keys(runs, "seconds"):
        texts = [number((run.entry.get("seconds") or {}).get(key), 3) for run in runs]
        rows.append((f"{key.replace('_', ' ')} [s]", texts))
    rows += [
        ("processor time per staggered iteration [ms]", [_milliseconds(run) for run in runs]),
        ("peak memory [MB]", [number(run.entry.get("memory_mb", run.record.get("memory_mb"))) for run in runs]),
        ("threads", [whole(run.record.get("threads")) for run in runs]),
        ("processor", [str(run.record.get("processor") or "–") for run in runs]),
    ]
    return {"runs": [run.name for run in runs], "rows": rows}


def _keys(runs: list[RunResults], table: str) -> list[str]:
    """Return the keys of all runs in the order of first use."""
    return list(dict.fromkeys(key for run in runs for key in run.entry.get(table) or {}))


def _milliseconds(run: RunResults) -> str:
    seconds = seconds_per_iteration(run)
    return "–" if seconds is None else number(1000 * seconds, 3)


def health_table(results: CaseResults) -> dict[str, Any]:
    """``runs`` (column heads); ``rows``: name, meaning, limit, why there, (text, beyond, why accepted) of each run."""
    runs = [run for run in results.shown_runs() if run.record.get("health")]
    told = [run.record["health"] for run in runs]
    accepted = [_accepted(results, run.name) for run in runs]
    rows = [
        (
            name,
            indicator.meaning,
            number(indicator.limit),
            indicator.why,
            [
                (number(h.get(name), 3), (h.get(name) or 0.0) > indicator.limit, why.get(name, ""))
                for h, why in zip(told, accepted, strict=True)
            ],
        )
        for name, indicator in INDICATORS.items()
        if any(h.get(name) is not None for h in told)
    ]
    return {"runs": [run.name for run in runs], "rows": rows}


def _accepted(results: CaseResults, run: str) -> dict[str, str]:
    specs = results.case.run_specs() if results.case else {}
    return specs[run].accepts if run in specs else {}


def price_rows(results: CaseResults) -> list[dict[str, str]]:
    """Return what each saving of each run spares and changes, as recorded for this tier and the case as it stands."""
    if results.case is None:
        return []
    rows, case = [], results.case
    for run in (name for name, spec in case.run_specs().items() if not spec.sweep_values):
        prices = current_prices(load_case(case.source, results.tier, run), run)
        rows += [_price_row(results, run, str(saving), each) for saving, each in prices.groupby("saving", sort=False)]
    return rows


def _price_row(results: CaseResults, run: str, saving: str, rows: pd.DataFrame) -> dict[str, str]:
    first = rows.iloc[0]
    ratios = {key: number(first[f"{key}_without"] / first[f"{key}_with"], 3) for key in ("seconds", "work", "unknowns")}
    changes = [_price_in_words(results, row) for _, row in rows.iterrows() if isinstance(row["quantity"], str)]
    status = RunStatus(first["status"])
    ended = "" if status.good else status.words
    return {"run": run, "saving": saving, **ratios, "changes": "; ".join(changes) or ended}


def _price_in_words(results: CaseResults, row: pd.Series) -> str:
    """A share of the quantity, or the quantity itself where it is no share."""
    share = row["change"] == row["change"]
    said = percent(row["change"]) if share else f"{number(row['with'], 3)} {metric_unit(row['quantity'], results.case)}"
    return f"{metric_in_words(row['quantity'])} {said}".strip()


def cost_sentence(results: CaseResults) -> str:
    """Return the ratio of MPM to FEM processor seconds per staggered iteration of the main runs."""
    first = {run.method.name: run for run in reversed(results.main_runs(len(results.runs)))}
    timed = [(run, seconds_per_iteration(run)) for run in reversed(first.values())]
    costs = [(f"{run.name} ({run.method.title})", seconds) for run, seconds in timed if seconds]
    if len(costs) < 2:
        return ""
    (reference, base), *others = costs
    compared = [
        f"A staggered iteration of {name} takes {number(seconds / base, 3)} times as long as one of {reference}: "
        f"{number(1000 * seconds, 3)} ms against {number(1000 * base, 3)} ms of processor time."
        for name, seconds in others
    ]
    return " ".join(compared)


def run_rows(results: CaseResults) -> list[dict[str, Any]]:
    """Return how each run ended and where its files lie."""
    return [
        {
            "name": run.name,
            "method": run.method.title,
            "status": run.status.words,
            "good": run.status.good,
            "reason": str(run.entry.get("reason") or ("" if run.exists else run.problem)),
            "increments": whole(len(run.history) - 1) if run.exists else "–",
            "seconds": number((run.entry.get("seconds") or {}).get("total"), 3),
            "folder": run.location if run.exists else "",
        }
        for run in results.runs.values()
    ]
