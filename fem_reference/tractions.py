"""Tractions of a case as forces on the nodes of a mesh, and the edges that its constraints hold."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.loads import Traction
from fem_reference.element_basis import ElementBasis
from numerics.built import check_line_is_followed
from numerics.surface import Edges, check_held_length, check_loaded_length

#: an edge of an element is held where both of its nodes are: all of it but for rounding
WHOLE = 1e-4


class LoadedEdge(NamedTuple):
    """A traction with its full forces on the nodes (n_nodes, 2), and the length of edge that it acts on [length]."""

    traction: Traction
    forces: NDArray
    length: float


def traction_forces(case: Case, basis: ElementBasis) -> list[LoadedEdge]:
    """What each traction of the case does.

    Raises BuiltError where a boundary set holds no edge of the mesh's boundary, or not what is drawn of it.
    """
    if not case.tractions:
        return []
    ends, edges = _boundary_edges(basis)
    loads = []
    for number, traction in enumerate(case.tractions):
        parts = edges.on(case, case.boundaries[traction.on])
        length = float(edges.cut(parts).lengths.sum())
        check_loaded_length(case, number, length)
        force = case.plane.thickness * edges.lengths[:, None] * traction.on_edges(edges.normals)
        # integrals of the two nodes' functions over the part of the edge
        second = 0.5 * (parts[:, 1] ** 2 - parts[:, 0] ** 2)
        first = np.ptp(parts, axis=1) - second
        forces = np.zeros_like(basis.nodes)
        np.add.at(forces, ends, np.stack([first[:, None] * force, second[:, None] * force], axis=1))
        loads.append(LoadedEdge(traction, forces, length))
    return loads


def check_held_edges(case: Case, basis: ElementBasis) -> None:
    """Raise BuiltError where a constraint on the displacement holds edges of another length than the drawn ones, or one
    on a line within bodies holds single nodes.
    """
    remedy = "let it end where nodes are, at multiples of mesh.h from the body's corners, or make mesh.h smaller"
    _, edges = _boundary_edges(basis)
    for number, constraint in enumerate(case.constraints):
        if constraint.direction != "phase":
            whole = np.ptp(edges.on(case, case.boundaries[constraint.on]), axis=1) > 1.0 - WHOLE
            check_held_length(case, number, float(edges.lengths[whole].sum()), remedy)
        instead = ', or draw a notch of kind "history"' if constraint.direction == "phase" else ""
        check_line_is_followed(case, number, basis.nodes, basis.elements, f"lay it along lines of nodes{instead}")


def _boundary_edges(basis: ElementBasis) -> tuple[NDArray, Edges]:
    """Nodes (n, 2) at the ends of the edges of the mesh's boundary, the body on their left, and these edges."""
    facets = basis.mesh.boundary_facets()
    ends = basis.mesh.facets[:, facets].T.copy()
    lines = basis.nodes[ends]
    inside = basis.nodes[basis.elements[basis.mesh.f2t[0, facets]]].mean(axis=1) - lines[:, 0]
    way = lines[:, 1] - lines[:, 0]
    on_the_right = way[:, 0] * inside[:, 1] - way[:, 1] * inside[:, 0] < 0.0
    ends[on_the_right] = ends[on_the_right, ::-1]
    return ends, Edges.around(basis.nodes[ends])
