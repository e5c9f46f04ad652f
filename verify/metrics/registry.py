"""The metrics that a check may ask for, collected from all modules of this folder.

>>> METRICS["peak_force"](run)                                      # doctest: +SKIP
>>> PAIR_METRICS["curve_l2_whole"](run, reference_run_or_curve)     # doctest: +SKIP
>>> SWEEP_METRICS["convergence_order"](runs, of="l2_error_displacement")  # doctest: +SKIP

A new metric is a function under ``@metric(unit, meaning)`` in one of the modules, or in a new one.
"""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path
from typing import TYPE_CHECKING

from verify.metrics.metric import REGISTERED, Metric, MetricError

if TYPE_CHECKING:
    from cases import Case


def _collect() -> None:
    for module in pkgutil.iter_modules([str(Path(__file__).parent)]):
        importlib.import_module(f"verify.metrics.{module.name}")


def _of(kind: str) -> dict[str, Metric]:
    return {name: metric for name, metric in REGISTERED.items() if metric.of == kind}


_collect()
#: scalars of one run, of two runs, and of the runs of a sweep
METRICS, PAIR_METRICS, SWEEP_METRICS = _of("run"), _of("pair"), _of("sweep")


def find_metric(name: str) -> Metric:
    """The metric of that name, of any kind. Raises MetricError for a name that is not known."""
    if name not in REGISTERED:
        raise MetricError(f"metric {name}: is not known; choose one of {', '.join(REGISTERED)}")
    return REGISTERED[name]


def metric_unit(name: str, case: Case) -> str:
    """Text of a metric's unit in the units of a case, such as "kN"; "1" for pure numbers."""
    kind = find_metric(name).unit
    return "°" if kind == "degree" else case.unit(kind)
