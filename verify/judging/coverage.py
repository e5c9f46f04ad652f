"""Printed numbers beside ours: every value of every reference, whether a check holds us to it, and how far off we are."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from cases import Case, Check, UserError, load_case
from cases.judging import TIERS
from verify.judging.baseline import key_of, read_baseline
from verify.judging.judge import Judge, UnavailableError, checks_of, find_runs
from verify.judging.targets import is_printed
from verify.metrics.metric import MetricError
from verify.metrics.registry import metric_unit

#: misses up to which a printed number counts as met, and as near
MET, NEAR = 0.02, 0.05
NO_CHECK = "no check compares it"
#: how the reason of a check begins that shows a miss whose cause an experiment has found
SHOWN = "shown"


@dataclass(frozen=True)
class Printed:
    """A printed value and what we have for it.

    ours : of the finest tier that has one, found in a run or a baseline; None without
    limit : of the check, which gates or only shows, and why; 0 where no check compares the two
    is_relative : the limit is a share of the printed value
    """

    case: str
    source: str
    kind: str
    quantity: str
    unit: str
    printed: float
    run: str = ""
    tier: str = ""
    ours: float | None = None
    found: str = ""
    limit: float = 0.0
    gated: bool = False
    reason: str = NO_CHECK
    is_relative: bool = True

    @property
    def share(self) -> float | None:
        """Miss as a share of the printed value, infinite where nought is printed; None without a value of ours."""
        if self.ours is None:
            return None
        miss = abs(self.ours - self.printed)
        return miss / abs(self.printed) if self.printed else (math.inf if miss else 0.0)

    @property
    def standing(self) -> str:
        """Where our value stands: "met" or "near", or farther off but "gated", "shown" by its cause or "open"; "without".

        What is gated is within what print leaves open.
        """
        if self.ours is None or self.share is None:
            return "without"
        if self.share <= NEAR:
            return "met" if self.share <= MET else "near"
        if self.gated and (self.share if self.is_relative else abs(self.ours - self.printed)) <= self.limit:
            return "gated"
        return "shown" if self.reason.startswith(SHOWN) else "open"


def coverage(cases: Iterable[Case], out: Path, summary: Mapping[str, Any] | None = None) -> list[Printed]:
    """Every printed value of the cases, from the finished runs under ``out`` and the baselines. Nothing is computed.

    cases : at any tier; all tiers are looked at.
    summary : of the runs under ``out``; values that it tells are taken from it.
    """
    told = _values_told(summary) if summary else {}
    all_tiers = ([load_case(case.source, tier) for tier in reversed(TIERS)] for case in cases)
    return [row for tiers in all_tiers for row in _of_case(tiers, out, told)]


#: case, tier, run, metric and parameters of a value
Told = tuple[str, str, str, str, str]


def _values_told(summary: Mapping[str, Any]) -> dict[Told, float]:
    return {
        (case["case"], case["tier"], check["run"], check["metric"], json.dumps(check["parameters"])): check["value"]
        for case in summary["cases"]
        for check in case["checks"]
        if check["value"] is not None
    }


def _of_case(tiers: list[Case], out: Path, told: Mapping[Told, float]) -> Iterator[Printed]:
    found = [row for case in tiers for row in _of_tier(case, out, told)]
    best: dict[tuple[str, str, str, str], Printed] = {}
    for row in found:  # the finest tier comes first
        key = (row.source, row.quantity, row.run, f"{row.printed:g}")
        if key not in best or (best[key].ours is None and row.ours is not None):
            best[key] = row
    yield from best.values()
    held = {(row.source, row.quantity) for row in found}
    for reference in tiers[0].references.values():
        for quantity, value in reference.values.items():
            if (reference.source, quantity) not in held:
                yield Printed(tiers[0].name, reference.source, reference.kind, quantity, _unit(quantity, tiers[0]), value)


def _unit(quantity: str, case: Case) -> str:
    try:
        return metric_unit(quantity, case)
    except MetricError:
        return ""


def _of_tier(case: Case, out: Path, told: Mapping[Told, float]) -> Iterator[Printed]:
    checks = [check for check in checks_of(case) if is_printed(case, check)]
    if not checks:
        return
    judge, baseline = Judge(case, find_runs(case, out)), {row.key: row for row in read_baseline(case)}
    for check in checks:
        name = check.target[1]
        reference, printed = case.references[name], float(case.references[name].values[check.metric])
        ours, found = _ours(check, judge, told)
        if ours is None and (row := baseline.get(key_of(check, case))):
            ours, found = row.value, f"baseline of {row.date}"
        yield Printed(
            case.name, reference.source, reference.kind, check.metric, metric_unit(check.metric, case), printed,
            check.run, case.tier, ours, found, check.limit, check.gate, check.reason, check.measure == "relative",
        )  # fmt: skip


def _ours(check: Check, judge: Judge, told: Mapping[Told, float]) -> tuple[float | None, str]:
    case, parameters = judge.case, check.model_dump(mode="json")["parameters"]
    key = (case.name, case.tier, check.run, check.metric, json.dumps(parameters))
    if key in told:
        return told[key], "run"
    try:
        return judge.value(check), "run"
    except (UnavailableError, UserError, ValueError):
        return None, ""


def coverage_table(rows: Iterable[Printed]) -> pd.DataFrame:
    """The rows as a table, and how far off each is, as a share."""
    return pd.DataFrame([vars(row) | {"share": row.share, "standing": row.standing} for row in rows])


def coverage_sentence(rows: list[Printed]) -> str:
    """How many of the printed numbers are met, one sentence."""
    count = Counter(row.standing for row in rows)
    return (
        f"{len(rows)} comparisons with printed numbers: {count['met']} within {MET:.0%}, {count['near']} more within "
        f"{NEAR:.0%}, {count['gated']} farther off within what print leaves open, {count['shown']} by a cause that runs "
        f"showed, {count['open']} of open discrepancies; {count['without']} without a value of ours."
    )
