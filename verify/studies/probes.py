"""Measurements for maps that need no run of the case: parts of the solvers under conditions that are set for them.

A probe is called with the case and the levels of a map by name; it returns a `Verdict`.
"""

import math
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, onenormest, splu

from cases import Case
from mpm.explicit.solver import ExplicitMaterialPoints
from mpm.explicit.stresses import turned_strain
from mpm.quasi_static.solver import MaterialPoints
from mpm.splines import Axis
from numerics.explicit import instants
from physics.exact_motion import sliding_distance
from verify.studies.explicit_clouds import explicit_step
from verify.studies.krylov import krylov
from verify.studies.verdicts import BLEW_UP, HOLDS, SLIDES, STABLE, Verdict

#: cells of the grid in each direction, and those in the middle where the open ends are not felt
CELLS, MIDDLE = 16, (6, 10)
#: elongation of the points that travel across cells
STRETCH = 1.1
#: share of the way without friction that a block may settle by and still hold
HELD = 0.01
#: coefficient of friction by which it settles, over the least that holds it
STICKY = 2.0

# --------------------------------------------------------------------------------------- cell crossing


def cell_crossing(case: Case, *, points_per_cell: int, order: int) -> Verdict:
    """Largest force that an even stress exerts on an inner node while its points travel across a cell.

    The points are evenly elongated by `STRETCH`, so that the cells hold now more and now fewer of them. The force
    should be nothing: value and error are its share of stress times section. It does not depend on the size of the
    cells, so that no refinement of the grid removes it; more points in a cell do.
    """
    spacing = STRETCH / points_per_cell
    start = np.arange(0.5 * spacing, CELLS, spacing)
    travelled = np.linspace(0.0, 1.0, 401)[:-1]
    force = max(_largest_inner_force(start + way, spacing, order) for way in travelled)
    return Verdict(STABLE, value=force, error=force)


def _largest_inner_force(positions: NDArray, spacing: float, order: int) -> float:
    inside = positions[positions < CELLS]
    axis = Axis(np.arange(CELLS + 1.0), order)
    _, slopes = axis.evaluate(inside, axis.locate(inside))
    forces = np.zeros(CELLS + order)
    np.add.at(forces, np.floor(inside).astype(int)[:, None] + np.arange(order + 1), slopes * spacing)
    return float(np.abs(forces[MIDDLE[0] : MIDDLE[1]]).max())


def crossed_bar(case: Case, *, cells: int, distance: float, order: int, of: str = "displacement") -> Verdict:
    """Error of a bar's displacement u = sin(pi x) under its body force, over its size, both root mean squares.

    of : "displacement", or "strain" for that of the points: the noise of their stress

    Its points, two in a cell of the start, have travelled by distance sin(2 pi X) lengths, so that its held ends stay
    where they are while points cross the cells between them.
    """
    start = (np.arange(2 * cells) + 0.5) / (2 * cells)
    positions = start + distance * np.sin(2.0 * np.pi * start)
    volumes = (1.0 + 2.0 * np.pi * distance * np.cos(2.0 * np.pi * start)) / (2 * cells)
    axis = Axis(np.linspace(0.0, 1.0, cells + 1), order)
    located = axis.locate(positions)
    values, slopes = axis.evaluate(positions, located)
    functions = located[:, None] + np.arange(order + 1)
    exact = np.sin(np.pi * positions)
    stiffness, force = np.zeros((axis.n_functions, axis.n_functions)), np.zeros(axis.n_functions)
    pairs = slopes[:, :, None] * slopes[:, None, :] * volumes[:, None, None]
    np.add.at(stiffness, (functions[:, :, None], functions[:, None, :]), pairs)
    np.add.at(force, functions, values * (np.pi**2 * exact * volumes)[:, None])
    solution = np.zeros(axis.n_functions)
    solution[1:-1] = np.linalg.solve(stiffness[1:-1, 1:-1], force[1:-1])  # the outermost functions are the ends' own
    if of == "strain":
        values, exact = slopes, np.pi * np.cos(np.pi * positions)
    found = (values * solution[functions]).sum(axis=1)
    error = float(np.linalg.norm(found - exact) / np.linalg.norm(exact))
    return Verdict(STABLE, value=error, error=error)


# --------------------------------------------------------------------------------------------- penalty


def condition(case: Case, *, penalty: float, h: float) -> Verdict:
    """Condition number of the case's stiffness with its constraints, and the error that round-off may make of it.

    The value is an estimate in the 1-norm; the error is that times the spacing of numbers of double precision.
    """
    mpm = case.mpm.model_copy(update={"penalty": penalty, "constraints_on": "edges"})
    mesh = case.mesh.model_copy(update={"h": h})
    matrix = MaterialPoints(case.model_copy(update={"mpm": mpm, "mesh": mesh})).first_stiffness().tocsc()
    solve = splu(matrix).solve
    inverse = LinearOperator(matrix.shape, matvec=solve, rmatvec=solve)  # of a symmetric matrix
    number = float(onenormest(matrix) * onenormest(inverse))
    return Verdict(STABLE, value=number, error=number * float(np.finfo(float).eps))


# -------------------------------------------------------------------------------------------- rotation


def turned_stress(case: Case, *, angle: float, rotation: str) -> Verdict:
    """Error of the stress of a sheared point that turns as a rigid body, over its size.

    angle : turned, in degrees; at most a degree in each step
    rotation : as in the table of dynamics
    """
    strain, steps = (1.0, -1.0, 0.0), math.ceil(angle)
    step = math.radians(angle) / steps
    for _ in range(steps):
        strain = turned_strain(*strain, 0.0, -step, step, 0.0, rotation == "corotational")
    exx, eyy, gxy = strain
    twice = 2.0 * math.radians(angle)
    # sizes of strain and of the deviatoric, isotropic stress are in proportion
    error = math.hypot(0.5 * (exx - eyy) - math.cos(twice), 0.5 * gxy - math.sin(twice))
    return Verdict(STABLE, value=error, error=error)


# -------------------------------------------------------------------------------------------- friction


def incline(case: Case, *, friction: float, slope: float, time: float) -> Verdict:
    """Whether the case's block holds by friction on an incline (slope in degrees) up to a time, in the solver itself.

    It has settled before, held by more friction: under a sudden weight it rocks, and a block that rocks slides more
    easily. It holds when it has gone less than `HELD` of the way that it would have gone without friction; the verdict's
    error is the way by which it differs from Coulomb's, over the same way.
    """
    tilted = _tilted(case, friction, slope, time)
    settled = _tilted(case, STICKY * math.tan(math.radians(slope)), slope, time)
    solver = ExplicitMaterialPoints(tilted)
    before = ExplicitMaterialPoints(settled)
    deque(instants(before, settled), maxlen=0)
    solver.restore(before.checkpoint())
    first, *_, last = instants(solver, tilted)
    if last.is_last:
        return Verdict(BLEW_UP, step=last.step, u=last.u, reason=last.reason)
    name = next(name for name, body in case.bodies.items() if not body.keeps_velocity)
    way = last.columns[f"{name}_x"] - first.columns[f"{name}_x"]
    free = sliding_distance(_tilted(case, 0.0, slope, time), body=name, time=time)
    error = abs(way - sliding_distance(tilted, body=name, time=time)) / free
    return Verdict(HOLDS if way < HELD * free else SLIDES, value=way, error=error, step=last.step, u=last.time)


def _tilted(case: Case, friction: float, slope: float, time: float) -> Case:
    """The case with gravity turned by a slope in degrees, up to a time."""
    assert case.dynamics is not None
    weight, angle = math.hypot(*case.dynamics.gravity), math.radians(slope)
    turned = {"gravity": (weight * math.sin(angle), -weight * math.cos(angle)), "end_time": time}
    return case.model_copy(
        update={
            "contact": case.contact.model_copy(update={"friction": friction}),
            "dynamics": case.dynamics.model_copy(update=turned),
        }
    )


PROBES: dict[str, Callable[..., Verdict]] = {
    probe.__name__: probe
    for probe in (explicit_step, cell_crossing, crossed_bar, condition, turned_stress, incline, krylov)
}
