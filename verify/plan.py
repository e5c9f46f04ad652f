"""What will be modelled before anything runs: sizes, increments, memory, time, and the savings in use."""

from dataclasses import dataclass

import numpy as np

from cases import Case
from cases.spacing import grid_lines

# Times and sizes are measured on two cores at REFERENCE_UNKNOWNS, a bilinear grid of 250 by 250 cells.
REFERENCE_UNKNOWNS = 126_000
FACTOR_SECONDS = 0.16
SOLVE_SECONDS = 0.04
POINT_SECONDS = 1.0e-6  # laws and assembly, for each integration point
FRACTURE_ITERATIONS = 20  # staggered iterations that a planned increment takes, halved and undone ones included
NEWTON_ITERATIONS = 2  # in each of them, where a split makes the law nonlinear
LIBRARIES_MB = 350.0
POINT_BYTES = 500.0
POINT_STEPS_PER_SECOND = 1.5e7  # of explicit steps
RULE = (
    "increments x staggered and Newton iterations x (factorisation ~ n^1.5 + solution ~ n + laws ~ points)"
    ", from a measured grid of 250 x 250 cells on two cores; adaptive increments may add to it"
    "; explicit runs: steps x points"
)


@dataclass(frozen=True)
class Saving:
    """A named switch that spares work: whether it is in use and what it does here."""

    name: str
    used: bool
    effect: str


@dataclass(frozen=True)
class Plan:
    """Predicted size and cost of one run; seconds and memory are rough (a factor of two)."""

    case: str
    tier: str
    run: str
    solver: str
    basis: str
    notches: str
    cells: int
    points: int
    unknowns_displacement: int
    unknowns_phase_field: int
    increments: int
    adaptive: bool
    iterations: int
    memory_mb: float
    seconds: float
    savings: tuple[Saving, ...]


def plan(case: Case, run_name: str) -> Plan:
    """The plan of one run; ``case`` must be loaded with that run's changes merged in."""
    solver = case.run_spec(run_name).solver
    order = case.mpm.order if solver == "mpm" else 1
    x_lines, y_lines = grid_lines(case)
    filled = filled_cells(case, x_lines, y_lines)
    triangles = solver == "fem" and case.mesh.element == "triangle"
    cells = int(filled.sum()) * (2 if triangles else 1)
    functions = int(_active_functions(filled, order).sum())
    smooth = solver == "fem" and fourth_order(case)
    points = cells * _points_per_cell(case, solver, triangles)
    breakable = case.fracture_enabled
    staggered = breakable and case.staggered.scheme == "converged" and not case.dynamics
    iterations = FRACTURE_ITERATIONS if staggered else 1
    steps = _time_steps(case) if case.dynamics else _increments(case)
    unknowns = 2 * functions
    implicit = iterations * _newton_iterations(case) * _iteration_seconds(unknowns, points)
    return Plan(
        case=case.name,
        tier=case.tier,
        run=run_name,
        solver=solver,
        basis=_basis(case, solver, triangles),
        notches=_notches(case),
        cells=cells,
        points=points,
        unknowns_displacement=unknowns,
        unknowns_phase_field=(4 if smooth else 1) * functions if breakable else 0,
        increments=steps,
        adaptive=case.load.adaptive and not case.dynamics,
        iterations=iterations,
        memory_mb=_memory_mb(unknowns, points, order),
        seconds=steps * (points / POINT_STEPS_PER_SECOND if case.dynamics else implicit),
        savings=(_grading(case, cells, triangles), _no_phase_field(breakable)),
    )


def fourth_order(case: Case) -> bool:
    """Some body has a phase field of fourth order."""
    return any((f := case.materials[body.material].fracture) and f.order == 4 for body in case.bodies.values())


def filled_cells(case: Case, x_lines: np.ndarray, y_lines: np.ndarray) -> np.ndarray:
    """(n_x, n_y) bool: cells whose centre is in a body and not in a notch of left-out cells."""
    x, y = (0.5 * (lines[1:] + lines[:-1]) for lines in (x_lines, y_lines))
    centres = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    filled = np.asarray(case.inside(centres)) >= 0
    for notch in case.notches:
        if notch.kind == "cells":
            filled &= ~_within(centres, np.asarray(notch.start), np.asarray(notch.end), notch.width)
    return filled.reshape(len(x), len(y))


def _within(points: np.ndarray, start: np.ndarray, end: np.ndarray, width: float) -> np.ndarray:
    """Points of the rectangle of ``width`` along the segment from ``start`` to ``end``."""
    length = float(np.linalg.norm(end - start))
    along_direction = (end - start) / length
    offset = points - start
    along = offset @ along_direction
    across = offset @ np.array([-along_direction[1], along_direction[0]])
    return (along > 0) & (along < length) & (np.abs(across) < 0.5 * width)


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


def _basis(case: Case, solver: str, triangles: bool) -> str:
    if solver == "mpm":
        return f"B-splines of order {case.mpm.order}, points placed {case.mpm.placement}"
    if fourth_order(case):
        return "bilinear quads, 3 x 3 Gauss points; phase field on Bogner-Fox-Schmit quads"
    return "linear triangles, 3 Gauss points" if triangles else "bilinear quads, 2 x 2 Gauss points"


def _notches(case: Case) -> str:
    said = {
        "slit": "a slit of no width",
        "cells": "left-out cells",
        "history": "an initial history field (Eq. 6.51)",
    }
    return ", ".join(said[notch.kind] for notch in case.notches) or "none"


def _increments(case: Case) -> int:
    path = float(np.abs(np.diff(case.load.path)).sum())
    return 1 + int(np.ceil(path / case.load.increment - 1e-9))


def _time_steps(case: Case) -> int:
    """By the rule for a uniform grid, in the finite elements too."""
    from numerics.explicit import number_of_steps
    from numerics.time_steps import stable_step

    return number_of_steps(case, stable_step(case))


def _newton_iterations(case: Case) -> int:
    splits = {material.fracture.split for material in case.materials.values() if material.fracture}
    return 1 if splits <= {"none"} else NEWTON_ITERATIONS


def _memory_mb(unknowns: int, points: int, order: int) -> float:
    """A direct factor in the plane holds about 8 n log2 n numbers; wider splines couple more."""
    factor = 8.0 * unknowns * np.log2(max(unknowns, 2)) * 8.0 * (order + 1) / 2
    matrix = unknowns * 2 * (2 * order + 1) ** 2 * 12.0
    return LIBRARIES_MB + (factor + matrix + points * POINT_BYTES) / 1e6


def _iteration_seconds(unknowns: int, points: int) -> float:
    size = unknowns / REFERENCE_UNKNOWNS
    return FACTOR_SECONDS * size**1.5 + SOLVE_SECONDS * size + POINT_SECONDS * points


def _grading(case: Case, cells: int, triangles: bool) -> Saving:
    """Cells are fine only where the crack can go."""
    lower, upper = case.bounding_box()
    uniform = int(np.prod(np.ceil((np.asarray(upper) - np.asarray(lower)) / case.mesh.h - 1e-9)))
    uniform *= 2 if triangles else 1
    if case.mesh.fine is None:
        return Saving("graded grid", False, f"the spacing is {case.mesh.h:g} throughout")
    effect = f"{cells} cells instead of up to {uniform} at h = {case.mesh.h:g} throughout"
    return Saving("graded grid", cells < uniform, effect)


def _no_phase_field(breakable: bool) -> Saving:
    effect = "some material can break" if breakable else "no material can break: no phase field is solved"
    return Saving("no phase field where nothing breaks", not breakable, effect)
