"""What runs cost: a small model whose constants are fitted to finished run folders and kept in ``costs.toml``."""

import functools
import math
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import nnls

from cases import Case, CaseError
from verify.atomic import write_text
from verify.run_folder import RunFolder, RunFolderError
from verify.size import Size, size_of

COSTS_FILE = Path(__file__).with_name("costs.toml")
#: what is solved, from which the number of iterations in an increment follows
KINDS = ("at_rest", "elastic", "passes", "fracture", "split")
#: the same for steps in time, from which the time for a point follows: nothing breaks, order 2, order 4
MOVING_KINDS = ("explicit_elastic", "explicit_fracture", "explicit_smooth")
#: processor seconds of a run in time steps: for itself, for each step, for each point in a step
MOVING_SECONDS = ("per_run", "per_step", *MOVING_KINDS)
Constants = dict[str, dict[str, float]]


@dataclass(frozen=True)
class Cost:
    """Predicted cost of one run: Newton iterations, processor seconds on one thread, peak memory [MB]."""

    iterations: float
    seconds: float
    memory_mb: float


@functools.cache
def constants() -> Constants:
    """The fitted constants of ``costs.toml``."""
    return tomllib.loads(COSTS_FILE.read_text(encoding="utf-8"))


def cost_of(case: Case, size: Size, fitted: Constants | None = None) -> Cost:
    """Predicted cost of a run of this size."""
    return _predict(kind_of(case), _passes(case), size.solver, size.increments, size.unknowns, size.points, fitted)


def _predict(
    kind: str, passes: int, solver: str, increments: int, unknowns: int, points: int, fitted: Constants | None = None
) -> Cost:
    fitted = fitted or constants()
    memory = fitted["memory"]
    megabytes = memory["libraries"] + memory["per_unknown"] * unknowns + memory["per_point"] * points
    if kind in MOVING_KINDS:
        each = [fitted["explicit"][name] for name in MOVING_SECONDS]
        return Cost(increments, float(np.dot(each, _moving_shapes(kind, increments, passes * points))), megabytes)
    iterations = increments * passes * fitted["iterations"][kind]
    each = np.array([fitted[solver][name] for name in SECONDS]) @ _shapes(unknowns)
    return Cost(iterations, fitted[solver]["per_run"] + float(each) * iterations, megabytes)


#: processor seconds of an iteration: for itself, for each unknown (laws, assembly), for factorising in the plane
SECONDS = ("per_iteration", "per_unknown", "per_factor")


def _shapes(unknowns: int) -> np.ndarray:
    return np.array([1.0, unknowns, unknowns**1.5])


def _moving_shapes(kind: str, steps: int, points: int) -> list[float]:
    """``points`` once for each pass of a step."""
    return [1.0, steps, *(steps * points if kind == other else 0.0 for other in MOVING_KINDS)]


def kind_of(case: Case) -> str:
    """One of `KINDS` or `MOVING_KINDS`."""
    orders = {material.fracture.order for material in case.materials.values() if material.fracture}
    if case.dynamics is not None:
        return MOVING_KINDS[0 if not case.fracture_enabled else 2 if 4 in orders else 1]
    if len(case.load.path) == 1:
        return "at_rest"
    if case.staggered.scheme == "passes" and case.fracture_enabled:
        return "passes"
    splits = {material.fracture.split for material in case.materials.values() if material.fracture}
    if not case.fracture_enabled:
        return "elastic"
    return "fracture" if splits <= {"none"} else "split"


def _passes(case: Case) -> int:
    return case.staggered.passes if kind_of(case) in ("passes", *MOVING_KINDS) else 1


# ---------------------------------------------------------------------------------------------- measured


MEASURED = (
    "case", "tier", "run", "solver", "kind", "passes", "increments", "unknowns", "points", "counted_unknowns",
    "iterations", "seconds", "memory_mb",
)  # fmt: skip


def measured_runs(out: Path) -> pd.DataFrame:
    """A row for each good run below an output folder whose case file has not changed since."""
    rows = []
    for file in sorted(out.rglob("run.json")):
        try:
            run = RunFolder(file.parent)
            case = run.case
        except (RunFolderError, CaseError):
            continue
        if run.good and case.hash() == run.info["case_hash"] and "processor" in run.info["seconds"]:
            rows.append(_measured(run, case))
    return pd.DataFrame(rows, columns=list(MEASURED))


def _measured(run: RunFolder, case: Case) -> dict[str, object]:
    info, size = run.info, size_of(case, run.info["run"])
    told = {"case": case.name, "tier": case.tier, "run": info["run"], "solver": size.solver, "kind": kind_of(case)}
    told |= {"passes": _passes(case), "increments": size.increments, "unknowns": size.unknowns}
    counters = info["counters"]
    told |= {"points": size.points, "counted_unknowns": counters.get("unknowns_displacement", size.unknowns)}
    # a phase field alone needs none, steps in time are not iterated
    told["iterations"] = size.increments if case.dynamics else max(1, counters.get("newton", 0))
    return told | {"seconds": info["seconds"]["processor"], "memory_mb": info.get("memory_mb", math.nan)}


# ------------------------------------------------------------------------------------------------ fitted


def fit(table: pd.DataFrame) -> Constants:
    """Constants that make the relative errors of all measured runs small.

    Every case has the same weight, however many of its runs there are. Kinds and solvers without runs keep theirs.
    """
    fitted = {name: dict(part) for name, part in constants().items()}
    all_weights = 1.0 / table.groupby("case")["case"].transform("count")
    moves = table["kind"].isin(MOVING_KINDS)
    explicit, table = table[moves], table[~moves]
    if len(explicit):
        fitted["explicit"] |= _fit_moving(explicit, all_weights[moves])
    if table.empty:
        return fitted
    weight = all_weights[~moves]
    # runs whose forces are in balance without iterating say nothing of those that iterate
    moving = table[table["iterations"] >= table["increments"]]
    per_increment = np.log(moving["iterations"] / (moving["increments"] * moving["passes"]))
    for kind, part in per_increment.groupby(moving["kind"]):
        fitted["iterations"][str(kind)] = float(np.exp(np.average(part, weights=weight[part.index])))
    for solver, part in table.groupby("solver"):
        shapes = np.array([_shapes(n) * k for n, k in zip(part["unknowns"], part["iterations"], strict=True)])
        found = _relative(np.column_stack([np.ones(len(part)), shapes]), part["seconds"], weight[part.index])
        fitted[str(solver)] = dict(zip(("per_run", *SECONDS), found, strict=True))
    shapes = np.column_stack([np.ones(len(table)), table["unknowns"], table["points"]])
    found = _relative(shapes, table["memory_mb"], weight)
    fitted["memory"] = dict(zip(("libraries", "per_unknown", "per_point"), found, strict=True))
    return fitted


def _fit_moving(table: pd.DataFrame, weight: pd.Series) -> dict[str, float]:
    """Constants of those kinds of moving runs that there are."""
    known = zip(table["kind"], table["increments"], table["passes"] * table["points"], strict=True)
    shapes = np.array([_moving_shapes(*row) for row in known])
    seen = np.flatnonzero(shapes.any(axis=0))
    found = _relative(shapes[:, seen], table["seconds"], weight)
    return dict(zip((MOVING_SECONDS[i] for i in seen), found, strict=True))


def _relative(shapes: np.ndarray, values: pd.Series, weight: pd.Series) -> list[float]:
    """Coefficients, none negative, of the least weighted relative errors."""
    share = np.sqrt(weight.to_numpy(float))
    scaled = shapes * (share / values.to_numpy(float))[:, None]
    size = np.abs(scaled).max(axis=0)
    coefficients, _ = nnls(scaled / size, share)
    return [float(value) for value in coefficients / size]


def write_constants(fitted: Constants) -> None:
    """Keep fitted constants for all later plans."""
    lines = ["# fitted to finished runs by `verify calibrate`; processor seconds on one thread, memory in MB"]
    for name, part in fitted.items():
        lines += ["", f"[{name}]", *(f"{key} = {value:.4e}" for key, value in part.items())]
    write_text(COSTS_FILE, "\n".join(lines) + "\n")
    constants.cache_clear()


# ------------------------------------------------------------------------------------------------ judged

QUANTITIES = ("unknowns", "iterations", "seconds", "memory_mb")


def predicted(table: pd.DataFrame, fitted: Constants) -> pd.DataFrame:
    """Predicted over measured, columns case, tier, run, unknowns, iterations, seconds, memory_mb."""
    known = ("kind", "passes", "solver", "increments", "unknowns", "points")
    costs = [_predict(**{name: row[name] for name in known}, fitted=fitted) for row in table.to_dict("records")]
    ratios = {"unknowns": table["unknowns"] / table["counted_unknowns"]}
    ratios |= {name: [getattr(cost, name) for cost in costs] / table[name] for name in QUANTITIES[1:]}
    return pd.concat([table[["case", "tier", "run"]], pd.DataFrame(ratios)], axis=1)


def left_out(table: pd.DataFrame) -> pd.DataFrame:
    """As `predicted`, each case by constants that were fitted to all other cases."""
    parts = []
    for name in table["case"].unique():
        others = table[table["case"] != name]
        if len(others):
            parts.append(predicted(table[table["case"] == name], fit(others)))
    return pd.concat(parts) if parts else table.iloc[:0]


def within_factor(ratios: pd.Series, factor: float = 2.0) -> float:
    """Share of the ratios between 1 / factor and factor."""
    return float(((ratios <= factor) & (ratios >= 1.0 / factor)).mean())
