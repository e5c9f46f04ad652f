"""Faces of slits that close: what presses them together is carried from one to the other without friction."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from cases import Case
from numerics.sparse_pattern import SymmetricPattern

#: stiffness of a spring over that of the stiffest body: faces go through each other by this part of a cell's shortening
PENALTY = 1e3


class ClosingFaces:
    """Springs between pairs of nodes on the two faces of slits, which press and do not pull.

    Unknowns are numbered 2 node + component, and each spring sees four of them: ``unknowns`` (n, 4), x and y of the node
    on the upper face and of the one below.
    """

    def __init__(self, pairs: NDArray, normal: NDArray, stiffness: float) -> None:
        """Of nodes (n, 2), above and below, with the normals (n, 2) of their slits; stiffness [force/length]."""
        self.unknowns = (2 * pairs[:, :, None] + np.arange(2)).reshape(-1, 4)
        self._rate, self._stiffness = np.hstack([normal, -normal]), stiffness

    @classmethod
    def of(cls, case: Case, pairs: Iterable[tuple[NDArray, NDArray]], modulus: float) -> ClosingFaces:
        """Of the pairs (n, 2) of each slit and its normal (2,); modulus : of the stiffest body [stress]."""
        found = [(nodes, np.broadcast_to(normal, nodes.shape)) for nodes, normal in pairs]
        nodes = np.concatenate([np.zeros((0, 2), int), *(n for n, _ in found)])
        normals = np.concatenate([np.zeros((0, 2)), *(n for _, n in found)])
        return cls(nodes, normals, PENALTY * modulus * case.plane.thickness)

    def coupling(self, equations: NDArray) -> NDArray | None:
        """Pairs (m, 2) of equations that the springs couple; ``equations`` (2 n_nodes,), -1 where there is none."""
        if not len(self.unknowns):
            return None
        rows, columns = self._entries(equations)[:2]
        return np.column_stack([rows, columns]).astype(np.int64)

    def forces(self, displacement: NDArray) -> NDArray:
        """Internal forces (2 n_nodes,) at a displacement (n_nodes, 2) of the nodes."""
        total = np.zeros(displacement.size)
        pressed = self._stiffness * np.minimum(self._opening(displacement), 0.0)
        np.add.at(total, self.unknowns, self._rate * pressed[:, None])
        return total

    def add_stiffness(
        self, pattern: SymmetricPattern, values: NDArray, equations: NDArray, displacement: NDArray
    ) -> None:
        """Add the stiffness of the springs that press to the stored entries of the tangent, in place."""
        if not len(self.unknowns):
            return
        rows, columns, spring, product = self._entries(equations)
        presses = (self._opening(displacement) < 0.0)[spring]
        places = pattern.positions(rows[presses], columns[presses])
        np.add.at(values, places, self._stiffness * product[presses])

    def _opening(self, displacement: NDArray) -> NDArray:
        """Distance (n,) of the faces [length]."""
        return (self._rate * displacement.reshape(-1)[self.unknowns]).sum(axis=1)

    def _entries(self, equations: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Rows, columns, spring and product of rates of the upper half of each spring's matrix, where both are free."""
        first, second = np.triu_indices(4)
        numbers = equations[self.unknowns]
        rows, columns = numbers[:, first].ravel(), numbers[:, second].ravel()
        product = (self._rate[:, first] * self._rate[:, second]).ravel()
        spring = np.repeat(np.arange(len(self.unknowns)), len(first))
        free = (rows >= 0) & (columns >= 0) & (product != 0.0)
        return rows[free], columns[free], spring[free], product[free]
