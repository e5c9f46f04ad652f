"""What the finite elements of a case will be, before anything is computed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.spacing import count_cells
from fem_reference.boundary import NodeConstraints
from fem_reference.element_basis import ElementBasis
from fem_reference.mesh.build import build_mesh, expected_triangles, uses_quads
from fem_reference.smooth_basis import SmoothBasis
from numerics import description
from numerics.description import MOST_SET_UP, Description
from numerics.time_steps import courant_step
from physics.elasticity import MaterialTable


class _Counts(NamedTuple):
    """Corners of an element, elements (n_bodies,) of each body, nodes, free unknowns of u, free nodes that can break."""

    corners: int
    elements: NDArray
    nodes: float
    displacement: float
    breaking: float


def describe(case: Case) -> Description:
    """Sizes, basis and step of the finite elements.

    Quadrilaterals and meshes from files are made and counted, unless there are many; triangles, which netgen takes its
    time to make, are estimated from the wanted sizes to a few per cent.

    Raises MeshError where a mesh that is made cannot be.
    """
    few, smooth = count_cells(case) <= MOST_SET_UP, description.fourth_order(case)
    is_made = few and (uses_quads(case) or any(body.mesh for body in case.bodies.values()))
    counts = _made(case) if is_made else _estimated(case, few)
    cells = float(counts.elements.sum())
    breaking, rigid = description.shares(case, counts.elements)
    moving = case.dynamics is not None
    return Description(
        basis=_basis(counts.corners, smooth),
        fine=description.where_fine(case, cells),
        cells=round(cells),
        points=round(cells) * (9 if smooth else 4 if counts.corners == 4 else 3),
        unknowns_displacement=round(2 * counts.nodes if moving else counts.displacement),
        unknowns_phase_field=round(counts.breaking * (SmoothBasis.PLACES if smooth else 1)),
        # C1 elements have about as many couplings as quadratic splines, and as many functions at a point as cubic ones
        order=(3 if moving else 2) if smooth else 1,
        breaking=breaking,
        rigid=rigid,
        stable_step=_stable_step(case, is_made) if moving else None,
    )


def _basis(corners: int, smooth: bool) -> str:
    if smooth:
        return "bilinear quads, 3 x 3 Gauss points; phase field on Bogner-Fox-Schmit quads"
    return "bilinear quads, 2 x 2 Gauss points" if corners == 4 else "linear triangles, 3 Gauss points"


def _made(case: Case) -> _Counts:
    """The mesh itself."""
    mesh = build_mesh(case).arrays
    constraints = NodeConstraints(case, mesh.points)
    breaks = np.zeros(len(mesh.points), bool)
    breaks[mesh.cells[description.breakable(case)[mesh.body]]] = True
    if case.dynamics is None:
        breaks &= ~constraints.phase_prescribed
    elements = np.bincount(mesh.body, minlength=len(case.bodies))
    return _Counts(mesh.cells.shape[1], elements, len(mesh.points), constraints.size, int(breaks.sum()))


def _estimated(case: Case, few: bool) -> _Counts:
    """Of triangles those on outlines are known where there are few, and with them those held there."""
    if uses_quads(case):
        corners, elements, on_outlines = 4, description.estimated_cells(case), np.zeros((0, 2))
        nodes = float(elements.sum())
    else:
        corners, (elements, on_outlines) = 3, expected_triangles(case, with_outlines=few)
        nodes = 0.5 * float(elements.sum() + len(on_outlines)) + 1.0  # Euler's formula
    held = _held(case, on_outlines)
    breaking = nodes * description.shares(case, elements)[0] - held["phase"]
    return _Counts(corners, elements, nodes, 2.0 * nodes - held["x"] - held["y"], max(0.0, breaking))


def _held(case: Case, nodes: NDArray) -> dict[str, int]:
    """How many of the nodes (n, 2) have a displacement x, y or a phase field that is prescribed, or tied to another's."""
    held = {direction: np.zeros(len(nodes), bool) for direction in ("x", "y", "phase")}
    for constraint in case.constraints:
        selected = case.boundaries[constraint.on].select(nodes, 1e-6 * case.mesh.h, case.bounding_box())
        for direction in (constraint.direction,) if constraint.direction else ("x", "y"):
            held[direction] |= selected & (np.cumsum(selected) > int(constraint.tied))
    return {direction: int(of.sum()) for direction, of in held.items()}


def _stable_step(case: Case, is_made: bool) -> float:
    """By the case's rule; of a mesh that is not made, by Courant's number [time]."""
    assert case.dynamics is not None
    if case.dynamics.time_step_rule == "courant" or not is_made:
        return courant_step(case)
    return ElementBasis(case).stable_step(MaterialTable(case))
