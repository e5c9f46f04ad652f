"""The constants of predicted costs: fitted to finished run folders, kept in ``costs.csv``, and judged by them."""

import math
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np
import pandas as pd

from cases import Case, CaseError
from cases.solvers import SOLVERS
from numerics.description import describe
from numerics.status import RunStatus
from verify.runs.atomic import write_text
from verify.runs.costs import (
    COSTS_FILE,
    FIRST,
    MOVING_KINDS,
    Constants,
    Demand,
    constants,
    demand_of,
    memory_shapes,
    predict,
    shapes_of,
)
from verify.runs.run_folder import RunFolder, RunFolderError

RUNS_FILE = Path(__file__).with_name("costs.csv")
#: error of a prediction, as the logarithm of a factor, above which it counts less in the fit
USUAL_ERROR = 0.2
#: coefficients that least squares puts at zero begin at this share of the largest one
LEAST_SHARE = 1e-3

DEMANDED = tuple(entry.name for entry in fields(Demand))
MEASURED = ("case", "tier", "run", *DEMANDED, "counted_unknowns", "iterations", "seconds", "memory_mb")


def measured_runs(out: Path) -> pd.DataFrame:
    """A row for each run below an output folder that went as planned and whose case file has not changed since.

    Rigid blocks are left out: nothing in them grows with unknowns or points.
    """
    rows = []
    for file in sorted(out.rglob("run.json")):
        try:
            run = RunFolder(file.parent)
            case = run.case
        except (RunFolderError, CaseError):
            continue
        rigid = run.info["solver"] in SOLVERS and SOLVERS[run.info["solver"]].of_rigid_block
        planned = run.good and run.info["status"] != RunStatus.EXPECTED_FAILURE and not rigid
        if planned and case.hash() == run.info["case_hash"] and "processor" in run.info["seconds"]:
            rows.append(_measured(run, case))
    return pd.DataFrame(rows, columns=list(MEASURED))


def _measured(run: RunFolder, case: Case) -> dict[str, object]:
    info, solver = run.info, run.info["solver"]
    demand, counters = demand_of(case, solver, describe(case, solver)), info["counters"]
    told = {"case": case.name, "tier": case.tier, "run": info["run"], **asdict(demand)}
    told["counted_unknowns"] = counters.get("unknowns_displacement", demand.unknowns)
    # a phase field alone needs none, steps in time are not iterated
    told["iterations"] = demand.increments if case.dynamics else max(1, counters.get("newton", 0))
    return told | {"seconds": info["seconds"]["processor"], "memory_mb": info.get("memory_mb", math.nan)}


def _demands(table: pd.DataFrame) -> list[Demand]:
    return [Demand(*row) for row in table[list(DEMANDED)].itertuples(index=False)]


# ------------------------------------------------------------------------------------------------ fitted


def fit(table: pd.DataFrame) -> Constants:
    """Constants that make the relative errors of all measured runs small.

    A case weighs as the root of the number of its runs, which are much alike. Kinds and solvers without runs keep theirs.
    """
    fitted = {name: dict(part) for name, part in constants().items()}
    weight = table.groupby("case")["case"].transform("count") ** -0.5
    # runs whose forces are in balance without iterating say nothing of those that iterate
    iterated = table[(table["iterations"] >= table["increments"]) | (table["kind"] == "uniform")]
    iterated = iterated[~iterated["kind"].isin(MOVING_KINDS)]
    per_increment = np.log(iterated["iterations"] / (iterated["increments"] * iterated["passes"]))
    for kind, part in per_increment.groupby(iterated["kind"]):
        fitted["iterations"][str(kind)] = float(np.exp(_median(part, weight[part.index])))
    known = [shapes_of(*pair) for pair in zip(_demands(table), table["iterations"], strict=True)]
    names = pd.Series([name for name, _ in known], table.index)
    shapes = pd.Series([shape for _, shape in known], table.index)
    for name, part in shapes.groupby(names):
        own = _coefficients(list(part), table.loc[part.index, "seconds"], weight[part.index])
        fitted[str(name)] = fitted.get(str(name), fitted[FIRST]) | own
    fitted["memory"] |= _coefficients([memory_shapes(d) for d in _demands(table)], table["memory_mb"], weight)
    return fitted


def _median(values: pd.Series, weight: pd.Series) -> float:
    """The value up to which half of the weight lies."""
    passed = weight[values.sort_values().index].cumsum()
    return float(values[passed.index[passed >= 0.5 * passed.iloc[-1]][0]])


def _coefficients(shapes: list[dict[str, float]], values: pd.Series, weight: pd.Series) -> dict[str, float]:
    """Positive coefficients of the least weighted errors as factors, few of them large; none of shapes that no run has.

    Begins with those of the least relative errors, which have one minimum.
    """
    from scipy.optimize import least_squares, nnls

    table, share = pd.DataFrame(shapes), np.sqrt(weight.to_numpy(float))
    table = table.loc[:, (table != 0.0).any()]
    scaled = table.to_numpy(float) / values.to_numpy(float)[:, None]
    size = scaled.max(axis=0)
    scaled /= size
    start, _ = nnls(scaled * share[:, None], share)

    def errors(logarithms: np.ndarray) -> np.ndarray:
        return share * np.log(scaled @ np.exp(logarithms))

    first = np.log(np.maximum(start, LEAST_SHARE * start.max()))
    best = least_squares(errors, first, loss="soft_l1", f_scale=USUAL_ERROR)
    return {str(name): float(value) for name, value in zip(table.columns, np.exp(best.x) / size, strict=True)}


def write_constants(fitted: Constants, table: pd.DataFrame) -> None:
    """Keep fitted constants for all later plans, and the measured runs that they come from."""
    lines = ["# fitted to finished runs by `verify calibrate`; processor seconds on one thread, memory in MB"]
    for name, part in fitted.items():
        lines += ["", f"[{name}]", *(f"{key} = {value:.4e}" for key, value in part.items())]
    write_text(COSTS_FILE, "\n".join(lines) + "\n")
    write_text(RUNS_FILE, table.to_csv(index=False, float_format="%.5g"))
    constants.cache_clear()


# ------------------------------------------------------------------------------------------------ judged

QUANTITIES = ("unknowns", "iterations", "seconds", "memory_mb")


def predicted(table: pd.DataFrame, fitted: Constants) -> pd.DataFrame:
    """Predicted over measured, columns case, tier, run, unknowns, iterations, seconds, memory_mb."""
    costs = [predict(demand, fitted) for demand in _demands(table)]
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


def judged(table: pd.DataFrame, fitted: Constants) -> pd.DataFrame:
    """How far predictions are off: a row for each of `QUANTITIES`; columns median, least, most, within, left_out.

    The last two are shares within a factor of two, of all runs and of each case with constants fitted to all others.
    """
    ratios, others = predicted(table, fitted), left_out(table)
    rows = {
        name: (r.median(), r.min(), r.max(), within_factor(r), within_factor(others[name]))
        for name, r in ((name, ratios[name]) for name in QUANTITIES)
    }
    return pd.DataFrame.from_dict(rows, orient="index", columns=["median", "least", "most", "within", "left_out"])
