"""The solvers that a run can name: the one list, from which schema, runs, plans, colours and words follow.

A further solver is a package of its own with an entry point of the group `ENTRY_POINTS` that names a `Solver`.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Annotated

from pydantic import AfterValidator, WithJsonSchema

from cases.errors import BrokenRuleError

ENTRY_POINTS = "fracture_verify.solvers"


@dataclass(frozen=True)
class Solver:
    """A method that solves cases, or a place that results come from.

    Attributes
    ----------
    name : in case files
    title : in figures and tables
    shown : what a close-up of its discretisation shows
    line : style of its curves, as matplotlib has it
    quasi_static, dynamic : "module:attribute" of the class that takes a case; imported on use
    describe : "module:attribute" of the function from a case to its ``numerics.description.Description``
    remarks : "module:attribute" of the function from a case to sentences for its reader, before it is computed
    by_points : its state is seen at points that move over a grid, not on a mesh
    table : in place of these three, "module:attribute" of a function from a case, its run merged in, to a
        `pandas.DataFrame` with the columns of a history, or to that and a crack path (n, 2) [length], or to these and
        row -> `numerics.fields.Fields`, of the last of which an empty path is traced
    of_rigid_block : it knows a rigid block that rocks and nothing else; `quasi_static` is empty
    """

    name: str
    title: str
    shown: str
    line: str | tuple[int, tuple[int, ...]]
    quasi_static: str = ""
    dynamic: str = ""
    describe: str = ""
    remarks: str = ""
    by_points: bool = False
    table: str = ""
    of_rigid_block: bool = False


def _of_rigid_block(name: str, title: str, line: str | tuple[int, tuple[int, ...]], made_by: str) -> Solver:
    made_by, described = f"rigid_block:{made_by}", "rigid_block:describe"
    return Solver(name, title, "the block and the ground", line, "", made_by, described, of_rigid_block=True)


#: a result from elsewhere, read from a file
IMPORTED = "imported"
#: in the order in which they are shown; the first one is the reference
SOLVERS: dict[str, Solver] = {
    solver.name: solver
    for solver in (
        Solver(
            "fem", "PF-FEM", "PF-FEM mesh", "-",
            "fem_reference:FiniteElements", "fem_reference:ExplicitFiniteElements", "fem_reference:describe",
        ),
        Solver(
            "mpm", "PF-MPM", "PF-MPM grid and points", "--",
            "mpm:MaterialPoints", "mpm:ExplicitMaterialPoints", "mpm:describe", "mpm:remarks", by_points=True,
        ),
        Solver("easyfea", "EasyFEA", "EasyFEA's mesh", (0, (5, 1, 1, 1)), table="verify.runs.easyfea:solve"),
        Solver(IMPORTED, "imported", "an imported result", "-.", table="verify.runs.importing:read_foreign"),
        _of_rigid_block("pendulum", "pendulum", (0, (3, 1, 1, 1)), "PendulumMotion"),
        _of_rigid_block("pendulum_linear", "linear pendulum", ":", "LinearPendulumMotion"),
        _of_rigid_block("winkler", "Winkler", (0, (5, 1)), "WinklerMotion"),
    )
}  # fmt: skip
#: those that come with this package
OWN = tuple(SOLVERS)


def installed() -> list[str]:
    """Names that entry points of other packages give and that are not registered yet."""
    return [name for name in entry_points(group=ENTRY_POINTS).names if name not in SOLVERS]


def register(name: str) -> None:
    """Register an installed solver. Not on import: its package imports this one.

    Raises BrokenRuleError where its package cannot be loaded.
    """
    (entry,) = list(entry_points(group=ENTRY_POINTS, name=name))[:1]
    try:
        SOLVERS[name] = entry.load()
    except Exception as error:  # whatever a package of somebody else's raises
        text = f"is a solver whose package cannot be loaded ({type(error).__name__}: {error})"
        raise BrokenRuleError(text, f"repair or uninstall {entry.module}", value=name) from None


def _known(name: str) -> str:
    if name in SOLVERS:
        return name
    if name not in installed():
        raise BrokenRuleError("is not a solver", f"give one of {', '.join([*SOLVERS, *installed()])}", value=name)
    register(name)
    return name


SolverName = Annotated[str, AfterValidator(_known), WithJsonSchema({"type": "string", "examples": list(OWN)})]
