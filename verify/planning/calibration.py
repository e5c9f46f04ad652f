"""What runs cost: a small model whose constants are fitted to finished run folders and kept in ``costs.toml``.

The runs that they were fitted to lie beside it, in ``costs.csv``.
"""

import functools
import math
import tomllib
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
import pandas as pd

from cases import Case, CaseError
from cases.solvers import SOLVERS
from numerics.description import Description, describe
from numerics.explicit import number_of_steps
from numerics.status import RunStatus
from verify.runs.atomic import write_text
from verify.runs.run_folder import RunFolder, RunFolderError

COSTS_FILE = Path(__file__).with_name("costs.toml")
RUNS_FILE = COSTS_FILE.with_suffix(".csv")
#: what is solved, from which the number of iterations in an increment follows
KINDS = ("at_rest", "uniform", "elastic", "passes", "fracture", "split", "cyclic")
#: the same for steps in time: nothing breaks, phase field of order 2, of order 4
MOVING_KINDS = ("explicit_elastic", "explicit_fracture", "explicit_smooth")
#: steps in time for each point on a crack's way through a body
RUNNING = 3.0
#: error of a prediction, as the logarithm of a factor, above which it counts less in the fit
USUAL_ERROR = 0.2
#: coefficients that least squares puts at zero begin at this share of the largest one
LEAST_SHARE = 1e-3
Constants = dict[str, dict[str, float]]
#: whose constants stand for those of a solver that none were fitted to
_FIRST = next(iter(SOLVERS))


@dataclass(frozen=True)
class Demand:
    """What of a run its cost depends on, known before it is run.

    solver : by its name, or "gmres" where its systems are solved by iteration; order : of the basis
    passes : of the staggered scheme in an increment or step, one where it converges
    width : l0 / h, the cells in the width of a crack
    breaking, rigid : shares of the cells in bodies that can break and that are rigid
    """

    kind: str
    solver: str
    order: int
    passes: int
    increments: int
    unknowns: int
    points: int
    width: float
    breaking: float
    rigid: float


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


def demand_of(case: Case, solver: str, described: Description) -> Demand:
    """What a run of this solver, which describes itself so for its case, asks for."""
    widths = [m.fracture.length_scale / case.mesh.h for m in case.materials.values() if m.fracture]
    return Demand(
        kind_of(case), "gmres" if described.iterative else solver, described.order, _passes(case),
        _increments(case, described.stable_step), described.unknowns_displacement, described.points,
        max(widths, default=0.0), described.breaking, described.rigid,
    )  # fmt: skip


def predict(demand: Demand, fitted: Constants | None = None) -> Cost:
    """Predicted cost of a run."""
    fitted = fitted or constants()
    iterations = _iterations(demand, fitted)
    name, shapes = _shapes(demand, iterations)
    own = fitted.get(name) or fitted[_FIRST]
    seconds = sum(own[key] * shape for key, shape in shapes.items())
    return Cost(iterations, seconds, sum(fitted["memory"][key] * shape for key, shape in _memory_shapes(demand).items()))


def _iterations(demand: Demand, fitted: Constants) -> float:
    """Steps in time are not iterated."""
    if demand.kind in MOVING_KINDS:
        return demand.increments
    return demand.increments * demand.passes * fitted["iterations"][demand.kind]


def _shapes(demand: Demand, iterations: float) -> tuple[str, dict[str, float]]:
    """What processor seconds are a sum of, by the names of the constants, and the table of these."""
    if demand.kind in MOVING_KINDS:
        return "explicit", _moving_shapes(demand)
    coupled = _coupled(demand)
    if demand.solver == "gmres":  # each system takes so long that nothing else counts
        return "gmres", {"per_unknown": coupled * iterations}
    shapes = {
        "per_iteration": 1.0,
        "per_point": demand.points * (demand.order + 1) ** 4 / 16.0,  # each adds to the couplings of its functions
        "per_unknown": coupled,
        "per_factor": coupled * math.sqrt(demand.unknowns),
    }
    return demand.solver, {"per_run": 1.0} | {name: shape * iterations for name, shape in shapes.items()}


def _coupled(demand: Demand) -> float:
    """Unknowns times what each is coupled to, over that of a linear basis: (2 p + 1)² others, nine of a linear one."""
    return demand.unknowns * (2 * demand.order + 1) ** 2 / 9.0


def _moving_shapes(demand: Demand) -> dict[str, float]:
    """A run, its steps, their phase fields, their points; the cells of cracks that run, as many as are as wide.

    Cracks cross the body once: at two fifths of the waves' speed, in `RUNNING` steps for each point on their way.
    """
    steps, breaks = demand.increments * demand.passes, demand.kind != MOVING_KINDS[0]
    transfers = steps * demand.points * (1.0 - demand.rigid) * (demand.order + 1) ** 2 / 9.0
    running = demand.passes * min(demand.increments, RUNNING * math.sqrt(demand.points))
    solved = running * demand.points * demand.breaking * demand.width * (2 * demand.order + 1) ** 2 / 25.0
    shapes = {"per_run": 1.0, "per_step": steps, "per_solve": steps * breaks, MOVING_KINDS[0]: transfers}
    return shapes | {kind: solved * (kind == demand.kind) for kind in MOVING_KINDS[1:]}


def _memory_shapes(demand: Demand) -> dict[str, float]:
    """Libraries, points, and the matrix's factor where there is one, which fills in with the logarithm of its size."""
    factored = demand.kind not in MOVING_KINDS
    filled = factored * _coupled(demand) * math.log2(max(demand.unknowns, 2))
    return {"libraries": 1.0, "per_point": demand.points, "per_factor": filled}


def kind_of(case: Case) -> str:
    """One of `KINDS` or `MOVING_KINDS`."""
    orders = {material.fracture.order for material in case.materials.values() if material.fracture}
    if case.dynamics is not None:
        return MOVING_KINDS[0 if not case.fracture_enabled else 2 if 4 in orders else 1]
    if len(case.load.path) == 1:
        return "at_rest"
    if case.exact == "homogeneous_bar":  # where all strain alike, the last increment tells the next one
        return "uniform"
    if case.staggered.scheme == "passes" and case.fracture_enabled:
        return "passes"
    splits = {material.fracture.split for material in case.materials.values() if material.fracture}
    if not case.fracture_enabled:
        return "elastic"
    if splits <= {"none"}:
        return "fracture"
    return "split" if len(case.load.path) == 2 else "cyclic"


def _passes(case: Case) -> int:
    return case.staggered.passes if kind_of(case) in ("passes", *MOVING_KINDS) else 1


def _increments(case: Case, stable_step: float | None) -> int:
    """Increments of the load without shortened ones, or steps in time of which the largest stable one is known."""
    if stable_step is not None:
        return number_of_steps(case, stable_step)
    ways = np.abs(np.diff(case.load.path))
    ways[:1] *= 1.0 - case.load.prologue
    return 1 + int(np.ceil(float(np.sum(ways / case.load.increments)) - 1e-9))


# ---------------------------------------------------------------------------------------------- measured


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
    known = [_shapes(*pair) for pair in zip(_demands(table), table["iterations"], strict=True)]
    names = pd.Series([name for name, _ in known], table.index)
    shapes = pd.Series([shape for _, shape in known], table.index)
    for name, part in shapes.groupby(names):
        own = _coefficients(list(part), table.loc[part.index, "seconds"], weight[part.index])
        fitted[str(name)] = fitted.get(str(name), fitted[_FIRST]) | own
    fitted["memory"] |= _coefficients([_memory_shapes(d) for d in _demands(table)], table["memory_mb"], weight)
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
