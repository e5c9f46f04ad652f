"""A basis with continuous slopes for the phase field of fourth order: Bogner-Fox-Schmit on axis-parallel rectangles."""

from __future__ import annotations

import numpy as np
import skfem
from numpy.typing import NDArray

from cases import Case
from cases.errors import MeshError
from cases.mesh_arrays import Floats, Integers, kinds_of
from fem_reference.element_basis import ElementBasis
from fem_reference.phase_field_kernels import SmoothValues

#: part of an element's size by which its corners may miss a rectangle
RECTANGULAR = 1e-6
#: steps to the four places beside a node, in x and y
STEPS = np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]])


class SmoothBasis:
    """Bicubic Hermite functions; four unknowns for each node.

    Their values at the node are c + a c,x + b c,y + a b c,xy with a, b = ± ``reach``: unknowns of the size of c, which
    stay between 0 and 1 where it does, in place of derivatives that have units. Nodes doubled along slits have
    unknowns of their own.

    Attributes
    ----------
    unknowns : (n_elements, 16) numbers of each element's unknowns, 4 node + place.
    kind : (n_elements,) elements of one size and operator share what follows.
    value, slope, curvature : (n_kinds, n_gauss, 16), (.., 16, 2), (.., 16, 3) at the Gauss points; second derivatives
        xx, yy, xy are taken through the ``operator``.
    """

    #: unknowns for each node
    PLACES = 4

    def __init__(self, nodes: Floats, elements: Integers, gauss: NDArray, reach: float, operator: NDArray) -> None:
        """Functions at Gauss points (2, n_gauss) of the unit square; ``operator`` (n_elements, 3, 3)."""
        size = _sizes(nodes, elements)
        self._first, self.kind = kinds_of(np.column_stack([size, operator.reshape(-1, 9)]), digits=12)
        size, operator = size[self._first], operator[self._first]
        self.unknowns = (4 * elements[:, :, None] + np.arange(4)).reshape(len(elements), -1).astype(np.int32)
        values, slopes, bends = _on_the_unit_square(gauss)
        share = _shares(size / reach)
        x, y = size.T[..., None, None, None]

        def of_elements(functions: NDArray) -> NDArray:
            """Functions (n_gauss, 4 nodes, 4 Hermite) of the unit square as functions of the unknowns."""
            return np.einsum("qnd,edj->eqnj", functions, share).reshape(len(size), -1, 16)[..., None]

        self.value = np.ascontiguousarray(of_elements(values)[..., 0])
        self.slope = np.concatenate([of_elements(slopes[0]) / x, of_elements(slopes[1]) / y], axis=-1)
        second = [of_elements(bends[0]) / x**2, of_elements(bends[1]) / y**2, of_elements(bends[2]) / (x * y)]
        self.curvature = np.concatenate(second, axis=-1) @ operator.transpose(0, 2, 1)[:, None]

    @classmethod
    def of(cls, case: Case, basis: ElementBasis, operator: NDArray) -> SmoothBasis:
        """The basis on the mesh of a case; MeshError where it has none."""
        if case.mesh.geometry == "updated":
            raise MeshError(
                f'{case.source}: mesh.geometry = "updated" would bend the rectangles that fracture.order = 4 needs;'
                ' set it to "initial"'
            )
        try:
            # Bezier's control points of a cubic over h
            return cls(basis.nodes, basis.elements, basis.reference_points, case.mesh.h / 3.0, operator)
        except MeshError as problem:
            raise MeshError(f"{case.source}: {problem}") from None

    def values(self, elements: NDArray | slice = slice(None)) -> SmoothValues:
        """The functions of the chosen elements, as compiled loops take them."""
        return SmoothValues(self.unknowns[elements], self.kind[elements], self.value, self.slope, self.curvature)

    def forms(self, volume: NDArray) -> tuple[NDArray, NDArray]:
        """Integrals of the products of slopes and of second derivatives, upper halves (n_kinds, 136), from the
        volumes (n_elements, n_gauss)."""
        upper = np.triu_indices(self.value.shape[2])
        slopes, bends = (
            np.ascontiguousarray(np.einsum("eqai,eqbi,eq->eab", parts, parts, volume[self._first])[:, *upper])
            for parts in (self.slope, self.curvature)
        )
        return slopes, bends

    @staticmethod
    def at_nodes(unknowns: NDArray) -> NDArray:
        """Phase field (n_nodes,) at the nodes."""
        return unknowns.reshape(-1, 4).mean(axis=1)

    @staticmethod
    def spread(at_nodes: NDArray) -> NDArray:
        """Unknowns (4 n_nodes,) of values at the nodes with no slope there; a held node holds its slope too, Eq. 5.11."""
        return np.repeat(at_nodes, 4)


def _sizes(nodes: Floats, elements: Integers) -> NDArray:
    """Sides (n_elements, 2); MeshError unless all elements are rectangles with their first corner at the lower left."""
    corners = nodes[elements]
    if elements.shape[1] == 4:
        size = corners[:, 2] - corners[:, 0]
        expected = corners[:, :1] + size[:, None] * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        if (np.abs(corners - expected).max(axis=(1, 2)) <= RECTANGULAR * size.min(axis=1)).all():
            return size
    raise MeshError(
        "mesh.element: fracture.order = 4 needs axis-parallel rectangles; use bodies with axis-parallel edges and"
        ' element = "quad"'
    )


def _on_the_unit_square(gauss: NDArray) -> tuple[NDArray, list[NDArray], list[NDArray]]:
    """Values, slopes x, y and second derivatives xx, yy, xy of the Hermite functions, all (n_gauss, 4 nodes, 4)."""
    square = skfem.Basis(skfem.MeshQuad(), skfem.ElementQuadBFS(), quadrature=(gauss, np.ones(gauss.shape[1])))
    functions = [local[0] for local in square.basis]

    def table(parts: list[NDArray]) -> NDArray:
        """Values (n_gauss, 4, 4) of the functions at the integration points, four for each corner."""
        return np.stack([part[0] for part in parts], axis=-1).reshape(-1, 4, 4)

    values = table([np.asarray(f) for f in functions])
    slopes = [table([f.grad[i] for f in functions]) for i in (0, 1)]
    bends = [table([f.hess[i, j] for f in functions]) for i, j in ((0, 0), (1, 1), (0, 1))]
    return values, slopes, bends


def _shares(size: NDArray) -> NDArray:
    """Hermite degrees of freedom (c, c,x, c,y, c,xy) on the unit square of each unknown beside a node (n, 4, 4)."""
    step = np.broadcast_to(STEPS, (len(size), 4, 2)) * size[:, None]
    along_x, along_y = step[..., 0], step[..., 1]
    return 0.25 * np.stack([np.ones_like(along_x), along_x, along_y, along_x * along_y], axis=1)
