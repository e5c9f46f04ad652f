"""Forces of a moving case on the nodes of a mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.loading import Traction
from cases.mesh_arrays import MeshError
from fem_reference.element_basis import ElementBasis


def traction_forces(case: Case, basis: ElementBasis) -> list[tuple[Traction, NDArray]]:
    """Each traction of the case with its full forces on the nodes (n_nodes, 2).

    Raises MeshError where a boundary set holds no edge of the mesh's boundary.
    """
    edges = basis.mesh.facets[:, basis.mesh.boundary_facets()].T
    tolerance = 1e-6 * case.mesh.h
    loads = []
    for traction in case.tractions:
        chosen = case.boundaries[traction.on].select(basis.nodes, tolerance, box=case.bounding_box())
        loaded = edges[chosen[edges].all(axis=1)]
        if not len(loaded):
            raise MeshError(
                f"{case.source}: tractions: the boundary '{traction.on}' holds no edge of the mesh; let it enclose both"
                " ends of at least one"
            )
        length = np.linalg.norm(basis.nodes[loaded[:, 1]] - basis.nodes[loaded[:, 0]], axis=1)
        share = np.bincount(loaded.T.ravel(), weights=np.tile(0.5 * length, 2), minlength=len(basis.nodes))
        loads.append((traction, case.plane.thickness * share[:, None] * np.asarray(traction.value)))
    return loads
