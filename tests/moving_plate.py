"""A notched plate in motion, for tests of the explicit solvers' phase fields: parts of its case, how to run it."""

import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cases import Case, load_case
from numerics.explicit import number_of_steps

PLATE = """
    title = "Notched plate pulled at once"
    requirement = "The phase field is the same wherever it is solved."
    units = { length = "mm", force = "N", time = "us" }
    plane = { assumption = "strain" }
    materials.glass.young = 32000.0
    materials.glass.poisson = 0.2
    materials.glass.density = 2450.0
    materials.glass.fracture = { toughness = 0.003, length_scale = 0.5 }
    materials.steel = { young = 210000.0, poisson = 0.3, density = 7850.0 }
    bodies.plate.material = "glass"
    bodies.plate.shape = { rectangle = { lower = [0.0, 0.0], upper = [30.0, 20.0] } }
    notches = [{ kind = "history", start = [0.0, 10.0], end = [10.0, 10.0], factor = 1000.0 }]
    mesh = { h = 0.5 }
    mpm = { order = 2, fill_cells = false }
    runs = { mpm = { solver = "mpm" }, fem = { solver = "fem" } }
"""
#: of a material that cannot break, without the notch that the phase field draws
UNBREAKABLE = "\n".join(line for line in PLATE.splitlines() if "notches" not in line).replace(
    'bodies.plate.material = "glass"', 'bodies.plate.material = "steel"'
)
#: no symmetry but that of second derivatives, axis 1 turned by 25 degrees
GENERAL = (
    "order = 4, orientation = 25.0, gamma = { gamma_1111 = 5.0, gamma_2222 = 2.0, gamma_1122 = 0.7,"
    " gamma_1212 = 11.0, gamma_1112 = 1.5, gamma_2212 = -0.8 }"
)
CUBIC = (
    "order = 4, orientation = 60.0, gamma = { gamma_1111 = 1.0, gamma_2222 = 1.0, gamma_1122 = 0.0, gamma_1212 = 74.0 }"
)
#: of the composite plate: the matrix is ill conditioned
FIBRES = (
    "order = 4, orientation = -45.0, gamma = { gamma_1111 = 1.0, gamma_2222 = 2900.0, gamma_1122 = 0.0,"
    " gamma_1212 = 74.0 }"
)


#: as high, so that the waves are the same, and shorter
SHORTER = PLATE.replace("[30.0, 20.0]", "[20.0, 20.0]")


def of_fourth_order(gamma: str) -> str:
    """The plate above with a fracture energy that has a direction."""
    return PLATE.replace("length_scale = 0.5", f"length_scale = 0.5, {gamma}")


MOVING = """
    dynamics = { end_time = 16.0, time_step_rule = "courant", time_step_share = 0.8 }
    staggered = { scheme = "passes", passes = <passes>, tolerance = <tolerance> }
"""
PULLED = '    tractions = [{ on = "top", value = [0.0, 2.0] }, { on = "bottom", value = [0.0, -2.0] }]\n'
FLYING = "    bodies.plate.velocity = [0.05, 0.02]\n"
STILL = """
    load = { path = [0.0] }
    constraints = [{ on = "bottom", direction = "x", value = 0 }, { on = "bottom", direction = "y", value = 0 }]
"""


def plate_case(tmp_path: Path, *texts: str, run: str = "mpm", tolerance: float = 1e-3, passes: int = 1) -> Case:
    """The case of some of the texts above."""
    text = "".join(texts).replace("<tolerance>", str(tolerance)).replace("<passes>", str(passes))
    file = tmp_path / "case.toml"
    file.write_text(textwrap.dedent(text))
    return load_case(file, run=run)


def all_steps(solver) -> int:
    """Number of steps to the end."""
    return number_of_steps(solver.case, solver.stable_step())


def run_to(solver, first: int, last: int) -> None:
    """The steps from one to another."""
    size = solver.case.dynamics.end_time / all_steps(solver)
    for step in range(first, last):
        solver.step(step * size, size)


def check_window(solver_of: Callable[[float], Any], within: float, resting: float = 1e-3) -> None:
    """A solver with a tolerance that lets blocks rest gives the fracture energy of one without, on fewer cells."""
    gains, cells = [], []
    for tolerance in (1e-9, resting):
        solver = solver_of(tolerance)
        start = solver.balance().fracture
        run_to(solver, 0, all_steps(solver))
        gains.append(solver.balance().fracture - start)
        cells.append(solver.costs.count["window_cells"])
    assert gains[0] > 0.01
    assert abs(gains[1] / gains[0] - 1.0) < within
    assert cells[1] < 0.95 * cells[0]
