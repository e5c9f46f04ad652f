"""Sizes of a run before it is run: cells, points, unknowns, increments."""

from dataclasses import dataclass

import numpy as np

from cases import Case
from cases.spacing import grid_lines


@dataclass(frozen=True)
class Size:
    """Predicted sizes of one run; ``unknowns`` are those of the displacement, ``increments`` may be
    steps in time, ``breaking`` and ``rigid`` are the shares of the cells in bodies that can break and that stay rigid."""

    solver: str
    cells: int
    points: int
    unknowns: int
    unknowns_phase_field: int
    increments: int
    breaking: float
    rigid: float


def size_of(case: Case, run_name: str) -> Size:
    """The sizes of one run; ``case`` must be loaded with that run's changes merged in."""
    solver = case.run_spec(run_name).solver
    x_lines, y_lines = grid_lines(case)
    filled = filled_cells(case, x_lines, y_lines)
    triangles = has_triangles(case, solver)
    cells = int(filled.sum()) * (2 if triangles else 1)
    functions = int(_active_functions(filled, case.mpm.order if solver == "mpm" else 1).sum())
    smooth = solver == "fem" and fourth_order(case)
    phase_field = (4 if smooth else 1) * functions if case.fracture_enabled else 0
    points = cells * _points_per_cell(case, solver, triangles)
    steps = _increments(case) if case.dynamics is None else _time_steps(case)
    breaking = [case.materials[body.material].fracture is not None for body in case.bodies.values()]
    rigid = [body.rigid for body in case.bodies.values()]
    body = np.asarray(case.inside(_centres(x_lines, y_lines)))
    of_cells = np.array([breaking, rigid], float)[:, body[body >= 0]]
    shares = of_cells.sum(axis=1) / max(1, of_cells.shape[1])
    return Size(solver, cells, points, 2 * functions, phase_field, steps, *map(float, shares))


def fourth_order(case: Case) -> bool:
    """Some body has a phase field of fourth order."""
    return any((f := case.materials[body.material].fracture) and f.order == 4 for body in case.bodies.values())


def has_triangles(case: Case, solver: str) -> bool:
    """The finite elements are triangles."""
    return solver == "fem" and case.mesh.element == "triangle"


def filled_cells(case: Case, x_lines: np.ndarray, y_lines: np.ndarray) -> np.ndarray:
    """(n_x, n_y) bool: cells whose centre is in a body and not in a notch of left-out cells."""
    centres = _centres(x_lines, y_lines)
    filled = (case.inside(centres) >= 0) & ~case.left_out(centres)
    return filled.reshape(len(x_lines) - 1, len(y_lines) - 1)


def _centres(x_lines: np.ndarray, y_lines: np.ndarray) -> np.ndarray:
    """(n_x n_y, 2): centres of all cells."""
    x, y = (0.5 * (lines[1:] + lines[:-1]) for lines in (x_lines, y_lines))
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)


def _active_functions(filled: np.ndarray, order: int) -> np.ndarray:
    """B-splines of ``order`` that a filled cell carries: cell (i, j) carries i..i+order, j..j+order."""
    active = np.zeros((filled.shape[0] + order, filled.shape[1] + order), dtype=bool)
    for i in range(order + 1):
        for j in range(order + 1):
            active[i : i + filled.shape[0], j : j + filled.shape[1]] |= filled
    return active


def _points_per_cell(case: Case, solver: str, triangles: bool) -> int:
    if solver == "mpm":
        return int(case.mpm.points_per_cell) ** 2
    if fourth_order(case):
        return 9
    return 3 if triangles else 4


def _increments(case: Case) -> int:
    ways = np.abs(np.diff(case.load.path))
    path = float(ways.sum()) - case.load.prologue * float(ways[0] if len(ways) else 0.0)
    return 1 + int(np.ceil(path / case.load.increment - 1e-9))


def _time_steps(case: Case) -> int:
    """By the rule for a uniform grid, in the finite elements too."""
    from mpm.explicit.step_bound import stable_step
    from numerics.explicit import number_of_steps

    return number_of_steps(case, stable_step(case))
