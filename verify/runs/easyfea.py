"""EasyFEA as a third judge: quasi-static cases of ours on the mesh of our finite elements, solved by others' code.

Taken from us are the case and the mesh (nodes, cells). Elements, quadrature, split, staggered scheme and solution are
EasyFEA's, with Miehe's history field; the increments are chosen here.
"""

from __future__ import annotations

import contextlib
import io
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from cases import Case
from cases.errors import CaseError
from cases.material import Fracture
from fem_reference.mesh.build import build_mesh
from verify.runs.foreign_fields import fields_on_mesh

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from numerics.fields import Fields

#: our splits by EasyFEA's names
SPLITS = {"none": "Bourdin", "spectral": "Miehe", "volumetric": "Amor"}
#: largest change of the damage between two staggered iterations that have converged, and how many there may be
TOLERANCE, MOST_ITERATIONS = 1e-4, 300
#: damage from which a node counts as broken
BROKEN = 0.9


def solve(case: Case) -> tuple[pd.DataFrame, NDArray, dict[int, Fields]]:
    """History of a case, no crack path, and the fields of the last row, of which it is traced.

    Raises CaseError for what EasyFEA or this adapter does not know.
    """
    _require_known(case)
    with contextlib.redirect_stdout(io.StringIO()):
        model = Model(case)
        table = pd.DataFrame(_march(model, case))
    return table, np.empty((0, 2)), {len(table) - 1: model.fields()}


def _require_known(case: Case) -> None:
    fractures = [material.fracture for material in case.materials.values()]
    unknown = {
        "dynamics": case.dynamics is not None,
        "more than one material": len(fractures) != 1 or fractures[0] is None,
        "notches of kind history": any(notch.kind == "history" for notch in case.all_notches),
        "constraints of motion or tied": any(c.motion or c.tied for c in case.constraints),
        "tractions, body forces or eigenstrains": bool(case.tractions or case.body_forces or case.eigenstrains),
        "anisotropic stiffness": any(material.is_anisotropic for material in case.materials.values()),
        "functional AT1": any(fracture and fracture.functional == "AT1" for fracture in fractures),
        "geometry that moves": case.mesh.geometry == "updated",
    }
    for what in (what for what, there in unknown.items() if there):
        raise CaseError(f"{case.source}: EasyFEA's adapter knows no {what}; take another solver for this run.")
    fracture = _fracture(case)
    if fracture.split not in SPLITS or fracture.order != 2:
        remedy = f"take one of {', '.join(SPLITS)} of second order"
        raise CaseError(f"{case.source}: fracture.split = {fracture.split!r}: EasyFEA's adapter lacks it; {remedy}.")


def _fracture(case: Case) -> Fracture:
    """That of the one material."""
    (material,) = case.materials.values()
    assert material.fracture is not None
    return material.fracture


class Model:
    """EasyFEA's simulation of a case on our mesh."""

    def __init__(self, case: Case) -> None:
        from EasyFEA import ElemType, Mesh, Models, Simulations
        from EasyFEA.FEM._group_elem import GroupElemFactory

        arrays = build_mesh(case).arrays
        self.case, self.points, self.cells = case, arrays.points, arrays.cells
        kind = ElemType.QUAD4 if self.cells.shape[1] == 4 else ElemType.TRI3
        group = GroupElemFactory.Create(kind, self.cells, np.column_stack([self.points, np.zeros(len(self.points))]))
        (material,) = case.materials.values()
        fracture, stress = _fracture(case), case.plane.assumption == "stress"
        young, poisson = material.young_modulus, material.poisson_ratio
        law = Models.Elastic.Isotropic(2, E=young, v=poisson, planeStress=stress, thickness=case.plane.thickness)
        # its length is that of d² / (2 l) + l |grad d|² / 2
        broken = Models.PhaseField(law, SPLITS[fracture.split], "AT2", fracture.toughness, 2.0 * fracture.length_scale)
        self.simulation: Any = Simulations.PhaseField(Mesh({kind: group}), broken)
        self.simulation.solver = "pypardiso" if find_spec("pypardiso") else "scipy"
        box, slack = case.bounding_box(), 1e-6 * case.mesh.h
        self.held = [(c, np.flatnonzero(case.boundaries[c.on].select(self.points, slack, box))) for c in case.constraints]

    def step(self, u: float) -> bool:
        """Solve at a load; whether the staggered iterations converged."""
        simulation, kinds = self.simulation, self.simulation.ProblemTypes
        simulation.Bc_Init()
        for constraint, nodes in self.held:
            if constraint.direction == "phase":
                simulation.add_dirichlet(nodes, [1.0 - (constraint.value or 0.0)], ["d"], problemType=kinds.damage)
            else:
                value = constraint.value if constraint.scale is None else constraint.scale * u
                simulation.add_dirichlet(nodes, [value], [constraint.direction], problemType=kinds.elastic)
        simulation.Solve(tolConv=1.0)  # its first phase field is that of the last displacement, and changes nothing
        return bool(simulation.Solve(tolConv=TOLERANCE, convOption=0, maxIter=MOST_ITERATIONS)[2])

    def state(self) -> tuple[NDArray, NDArray]:
        """Copies of displacement (2 n,) and damage (n,)."""
        return self.simulation.displacement.copy(), self.simulation.damage.copy()

    def undo(self, state: tuple[NDArray, NDArray]) -> None:
        """Back to a state that `state` gave; the history field goes on from what was saved."""
        kinds = self.simulation.ProblemTypes
        for kind, values in zip((kinds.elastic, kinds.damage), state, strict=True):
            self.simulation._Set_solutions(kind, values)
        self.simulation.Need_Update()

    def row(self, u: float) -> dict[str, float]:
        """The row of the history at a load: force that works on u, elastic energy, least phase field."""
        self.simulation.Need_Update()
        stiffness = self.simulation.Get_K_C_M_F(self.simulation.ProblemTypes.elastic)[0]
        internal = stiffness @ self.simulation.displacement
        of_load = ((c, n) for c, n in self.held if c.scale is not None)
        force = sum(c.scale * internal[2 * nodes + "xy".index(str(c.direction))].sum() for c, nodes in of_load)
        energy = 0.5 * float(internal @ self.simulation.displacement)
        return {"u": u, "F": float(force), "E_el": energy, "c_min": 1.0 - float(self.simulation.damage.max())}

    def advance(self, before: NDArray) -> float:
        """How far the broken nodes reach beyond those that were broken [length]."""
        new = self.points[(self.simulation.damage >= BROKEN) & (before < BROKEN)]
        old = self.points[before >= BROKEN]
        if not len(new):
            return 0.0
        return float(np.max(cKDTree(old if len(old) else new.mean(axis=0, keepdims=True)).query(new)[0]))

    def fields(self) -> Fields:
        """The fields as they are."""
        u, damage = self.state()
        return fields_on_mesh(self.points, self.cells, 1.0 - damage, u.reshape(-1, 2), self.case.plane.thickness)


def _march(model: Model, case: Case) -> list[dict[str, float]]:
    """Increments along the load's path, halved where the crack advances too far or nothing converges."""
    load, farthest = case.load, case.load.largest_advance * _fracture(case).length_scale
    rows, u, increment = [{"u": load.path[0], "F": 0.0, "E_el": 0.0, "c_min": 1.0}], load.path[0], load.increment
    for target, largest in zip(load.path[1:], load.increments, strict=True):
        increment = min(increment, largest)
        while abs(target - u) > 1e-9 * largest:
            increment = min(increment, abs(target - u))
            before, wanted = model.state(), u + np.sign(target - u) * increment
            good = model.step(wanted) and model.advance(before[1]) <= farthest
            if not good and increment > load.smallest:
                model.undo(before)
                increment = max(0.5 * increment, load.smallest)
                continue
            u = wanted
            model.simulation.Save_Iter()
            rows.append(model.row(u))
            increment = min(1.5 * increment, largest)
            if load.stop_when_broken and abs(rows[-1]["F"]) < load.broken_fraction * max(abs(row["F"]) for row in rows):
                return rows
    return rows
