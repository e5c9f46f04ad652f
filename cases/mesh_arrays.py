"""Meshes as plain arrays, the measures taken of them and the error raised about them.

Elements are triangles or convex quadrilaterals with straight edges; the corners of each element are listed
counter-clockwise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cases.errors import CaseError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class MeshError(CaseError):
    """No mesh can be made as the case asks; the message is one sentence that ends with the remedy."""


@dataclass(frozen=True)
class MeshArrays:
    """A mesh before it is handed to scikit-fem.

    points : (n_points, 2) positions [case length unit]
    cells : (n_elements, 3 or 4) point indices, counter-clockwise
    body : (n_elements,) index of the body that each element belongs to
    """

    points: Floats
    cells: Integers
    body: Integers

    def keep(self, wanted: NDArray[np.bool_]) -> MeshArrays:
        """The wanted elements alone; `wanted` is a mask over elements."""
        return replace(self, cells=self.cells[wanted], body=self.body[wanted]).without_unused_points()

    def without_unused_points(self) -> MeshArrays:
        """The same elements without the points that belong to none."""
        used, cells = np.unique(self.cells, return_inverse=True)
        return replace(self, points=self.points[used], cells=cells.reshape(self.cells.shape))

    def centres(self) -> Floats:
        """Means of the corners of each element, (n_elements, 2)."""
        return self.points[self.cells].mean(axis=1)


def joined(parts: list[MeshArrays]) -> MeshArrays:
    """Several meshes of one element type as one mesh of separate components."""
    first_points = np.cumsum([0] + [len(part.points) for part in parts[:-1]])
    return MeshArrays(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.cells + first for part, first in zip(parts, first_points, strict=True)]),
        np.concatenate([part.body for part in parts]),
    )


def cross(a: Floats, b: Floats) -> Floats:
    """Out-of-plane component of the product of plane vectors along the last axis."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def signed_areas(points: Floats, cells: Integers) -> Floats:
    """Area of each element, negative where its corners run clockwise, (n_elements,) [length²]."""
    corners = points[cells]
    return 0.5 * cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1)


def corner_jacobians(points: Floats, cells: Integers) -> Floats:
    """Twice the area spanned at each corner by its two edges, (n_elements, n_corners) [length²].

    All of them are positive exactly when the map from the reference element is invertible everywhere.
    """
    corners = points[cells]
    forward = np.roll(corners, -1, axis=1) - corners
    return cross(forward, np.roll(corners, 1, axis=1) - corners)


def edge_lengths(points: Floats, cells: Integers) -> Floats:
    """Length of the edge that leaves each corner, (n_elements, n_corners) [length]."""
    corners = points[cells]
    return np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=-1)


@dataclass(frozen=True)
class EdgeTable:
    """Edges of a mesh.

    ends : (n_edges, 2) point indices, the lower first
    of_corner : (n_elements, n_corners) index of the edge from each corner to the next
    count : (n_edges,) number of elements that share the edge
    """

    ends: Integers
    of_corner: Integers
    count: Integers


def edge_table(cells: Integers) -> EdgeTable:
    """All edges of the elements, each listed once."""
    pairs = np.stack([cells, np.roll(cells, -1, axis=1)], axis=-1).reshape(-1, 2)
    ends, of_corner, count = np.unique(
        np.sort(pairs, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return EdgeTable(ends, of_corner.reshape(cells.shape), count)


def kinds_of(features: NDArray, digits: int) -> tuple[NDArray, NDArray]:
    """Rows (n, m) that are alike: the first one of each kind (n_kinds,), and the kind of each row (n,).

    digits : to which rows of a kind agree, relative to the largest value of each column.
    """
    scale = np.abs(features).max(axis=0)
    rounded = np.round(features / np.where(scale > 0, scale, 1.0), digits)
    _, first, kind = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    return first, kind.reshape(-1).astype(np.int32)
