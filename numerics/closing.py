"""Faces of slits that close: what presses them together is carried from one to the other without friction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cases import Case
from numerics.sparse_pattern import SymmetricPattern

#: stiffness of a spring over that of the stiffest body: faces go through each other by this part of a cell's shortening
PENALTY = 1e3


class Faces(NamedTuple):
    """Places (n,) on the two faces of a slit, where nodes (n, 2, k), seen from above and from below, weigh (n, k).

    normal : (2,) of the slit. A node with one number on both sides must weigh nothing: no face goes without the other.
    """

    nodes: NDArray
    weights: NDArray
    normal: NDArray


class ClosingFaces:
    """Springs between places on the two faces of slits, which press and do not pull.

    Unknowns are numbered 2 node + component, and each spring sees m of them: ``unknowns`` (n, m), x and y of the nodes on
    the upper face and of those below.
    """

    def __init__(self, unknowns: NDArray, rate: NDArray, stiffness: float) -> None:
        """Springs by how the distance of the faces goes with the unknowns, rate (n, m); stiffness [force/length]."""
        self.unknowns, self._rate, self._stiffness = unknowns, rate, stiffness

    @classmethod
    def of(cls, case: Case, slits: Sequence[Faces], modulus: float) -> ClosingFaces:
        """Of the faces of each slit; modulus : of the stiffest body [stress]."""
        width = 4 * max((faces.weights.shape[1] for faces in slits), default=0)
        unknowns, rates = [np.zeros((0, width), int)], [np.zeros((0, width))]
        for nodes, weights, normal in slits:
            of_nodes = np.stack([weights, -weights], axis=1)[..., None] * normal
            for parts, part in ((unknowns, 2 * nodes[..., None] + np.arange(2)), (rates, of_nodes)):
                flat = part.reshape(len(part), 4 * weights.shape[1])
                # what a spring sees less than others weighs nothing
                parts.append(np.pad(flat, ((0, 0), (0, width - flat.shape[1]))))
        return cls(np.concatenate(unknowns), np.concatenate(rates), PENALTY * modulus * case.plane.thickness)

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
        first, second = np.triu_indices(self.unknowns.shape[1])
        numbers = equations[self.unknowns]
        rows, columns = numbers[:, first].ravel(), numbers[:, second].ravel()
        product = (self._rate[:, first] * self._rate[:, second]).ravel()
        spring = np.repeat(np.arange(len(self.unknowns)), len(first))
        free = (rows >= 0) & (columns >= 0) & (product != 0.0)
        return rows[free], columns[free], spring[free], product[free]
