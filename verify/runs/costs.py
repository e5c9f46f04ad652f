"""What a run will cost: a small model whose constants lie in ``costs.toml``, where `verify calibrate` writes them."""

import functools
import math
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cases import Case
from cases.solvers import SOLVERS
from numerics.description import Description
from numerics.explicit import number_of_steps

COSTS_FILE = Path(__file__).with_name("costs.toml")
#: what is solved, from which the number of iterations in an increment follows
KINDS = ("at_rest", "uniform", "elastic", "passes", "fracture", "split", "cyclic")
#: the same for steps in time: nothing breaks, phase field of order 2, of order 4
MOVING_KINDS = ("explicit_elastic", "explicit_fracture", "explicit_smooth")
#: steps in time for each point on a crack's way through a body
RUNNING = 3.0
Constants = dict[str, dict[str, float]]
#: whose constants stand for those of a solver that none were fitted to
FIRST = next(iter(SOLVERS))


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
    name, shapes = shapes_of(demand, iterations)
    own = fitted.get(name) or fitted[FIRST]
    seconds = sum(own[key] * shape for key, shape in shapes.items())
    return Cost(iterations, seconds, sum(fitted["memory"][key] * shape for key, shape in memory_shapes(demand).items()))


def _iterations(demand: Demand, fitted: Constants) -> float:
    """Steps in time are not iterated."""
    if demand.kind in MOVING_KINDS:
        return demand.increments
    return demand.increments * demand.passes * fitted["iterations"][demand.kind]


def shapes_of(demand: Demand, iterations: float) -> tuple[str, dict[str, float]]:
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


def memory_shapes(demand: Demand) -> dict[str, float]:
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
