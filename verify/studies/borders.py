"""Where theory has the border of a map: x at which the verdict should change, for each of its rows."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from cases import Case
from cases.solvers import SOLVERS
from cases.studies import Map
from physics.rocking.borders import Border as Change
from physics.surface_energy import RAISED
from rigid_block.verdicts import borders_of, model_of
from verify.studies.krylov import TOLERANCE
from verify.studies.verdicts import BLEW_UP, HOLDS, NO_CONVERGENCE, NUMERICAL_FRACTURE, accuracy


@dataclass(frozen=True)
class Border:
    """A theory of where a method begins to fail.

    position : (case of the row, map, decided cells of the row) -> x; not a number where the theory says nothing
    inside : (verdict, map) -> whether such a cell lies on the good side of this border; None where it lies at neither
    """

    position: Callable[[Case, Map, pd.DataFrame], float]
    inside: Callable[[str, Map], bool | None]


@dataclass(frozen=True)
class RigidBlock:
    """Borders of a rigid model of the block that rocks; ``solver`` is its name."""

    solver: str

    def between(self, case: Case, below: str, above: str) -> float:
        """Least amplitude over that of uplift at which the verdict changes so; not a number where it does not."""
        found = _rigid_borders(case.model_dump_json(), case, self.solver)
        return next((b.amplitude for b in found if (str(b.below), str(b.above)) == (below, above)), math.nan)


_FOUND: dict[tuple[str, str], list[Change]] = {}


def _rigid_borders(key: str, case: Case, solver: str) -> list[Change]:
    if (key, solver) not in _FOUND:
        _FOUND[key, solver] = borders_of(case, model_of(case, solver))
    return _FOUND[key, solver]


def toughness_of_the_mesh(case: Case, chosen: Map, row: pd.DataFrame) -> float:
    """Spacing at which the toughness that a mesh sees, Gc (1 + h / (4 l0)) with AT2, is off by the error allowed."""
    fracture = next(material.fracture for material in case.materials.values() if material.fracture)
    return fracture.length_scale * _allowed(chosen) / RAISED[fracture.functional][1]


def first_order(case: Case, chosen: Map, row: pd.DataFrame) -> float:
    """Where an error in proportion to x, through the row's cell of least x, reaches the error allowed.

    Where the error falls with growing x, as that of a penalty does, in proportion to 1 / x.
    """
    known = row[row["error"] > 0.0].sort_values("x")
    if len(known) < 2:
        return math.nan
    x, error = known["x"].to_numpy(float), known["error"].to_numpy(float)
    ratio = _allowed(chosen) / error[0]
    return float(x[0] * (ratio if error[-1] > error[0] else 1.0 / ratio))


def round_off(case: Case, chosen: Map, row: pd.DataFrame) -> float:
    """Penalty whose round-off in the forces is as large as the residual allowed."""
    return case.staggered.residual_tolerance / float(np.finfo(float).eps)


def connected_points(case: Case, chosen: Map, row: pd.DataFrame) -> float:
    """Elongation at which points placed regularly can first leave a cell of a linear grid empty between them.

    Neighbours h / n apart are h apart at the stretch n; beyond it some share no function of a grid of order 1. A
    basis of order p bears p - 1 empty cells, so that it is p times as far.
    """
    lower, upper = case.bounding_box()
    return float(upper[0] - lower[0]) * (case.mpm.order * case.mpm.points_per_cell - 1.0)


def _allowed(chosen: Map) -> float:
    return chosen.judged.within[0] if chosen.judged else math.nan


def eigenvalue(case: Case, chosen: Map, row: pd.DataFrame) -> float:
    """Share of the step by rule at which the largest eigenvalue of the worst cloud is reached: the cells' value."""
    return float(row["value"].iloc[0])


def coulomb(case: Case, chosen: Map, row: pd.DataFrame) -> float:
    """Coefficient of friction that holds a block on the row's slope [degrees]: its tangent."""
    return math.tan(math.radians(float(row["y"].iloc[0])))


def turned_shear(case: Case, chosen: Map, row: pd.DataFrame) -> float:
    """Angle [degrees] at which a stress that stays behind is off by the error allowed: 2 sin(angle) of its size."""
    return math.degrees(math.asin(0.5 * _allowed(chosen)))


def conjugate_gradients(case: Case, chosen: Map, row: pd.DataFrame) -> float:
    """Damage up to which the whole body's factor must do within the row's number of iterations.

    The eigenvalues of the preconditioned matrix lie between the least degradation, c² without residual stiffness, and
    one; the error falls below a tolerance t in ln(2 / t) / (2 c) iterations.
    """
    return 1.0 - 0.5 * math.log(2.0 / TOLERANCE) / float(row["y"].iloc[0])


def _accurate(verdict: str, chosen: Map) -> bool | None:
    if chosen.judged is None or not verdict.startswith(("within", "beyond")):
        return None
    return verdict == accuracy(0.0, chosen.judged.within)


#: rigid models whose borders are drawn over maps of a body that rocks
RIGID_BLOCKS = {solver.name: RigidBlock(solver.name) for solver in SOLVERS.values() if solver.of_rigid_block}
BORDERS: dict[str, Border | RigidBlock] = RIGID_BLOCKS | {
    "toughness_of_the_mesh": Border(toughness_of_the_mesh, _accurate),
    "first_order": Border(first_order, _accurate),
    "round_off": Border(round_off, lambda verdict, _: verdict != NO_CONVERGENCE),
    "eigenvalue": Border(eigenvalue, lambda verdict, _: verdict != BLEW_UP),
    "connected_points": Border(connected_points, lambda verdict, _: verdict != NUMERICAL_FRACTURE),
    "coulomb": Border(coulomb, lambda verdict, _: verdict == HOLDS),
    "turned_shear": Border(turned_shear, _accurate),
    "conjugate_gradients": Border(conjugate_gradients, lambda verdict, _: verdict != NO_CONVERGENCE),
}
