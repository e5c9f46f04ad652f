"""Where a body ends, as its contact partners see it at the nodes that they share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mpm.explicit.moving_body import MovingBody
from mpm.explicit.transfers import DRIFT, STRIP


class BodySurface:
    """Inverse masses, normals and reach of a body at nodes of its window."""

    def __init__(self, body: MovingBody) -> None:
        self.body = body
        #: strips of the points near the nodes
        self._near = np.zeros(1, np.int64)

    def inverse_mass(self, nodes: NDArray) -> NDArray:
        """Inverse masses (n,) of nodes, 0 of a rigid body."""
        return np.zeros(len(nodes)) if self.body.rigid else 1.0 / self.body.window.sums.m[nodes]

    def find_mass_slopes(self, nodes: Sequence[NDArray]) -> None:
        """Mass gradients at nodes, from the points of the cells around them."""
        body, window, order = self.body, self.body.window, self.body.lattice.order
        surface, chosen = window.surface, np.concatenate(nodes)
        surface.touches[:] = False
        mark_cells(chosen, window.width, order, surface.touches)
        surface.slope_x[:], surface.slope_y[:] = 0.0, 0.0
        columns = chosen // window.width
        first = max(0, (int(columns.min()) - order - DRIFT) // STRIP)
        self._near = window.strips[first : (int(columns.max()) + DRIFT) // STRIP + 2]
        body.transfers.mass_slopes(self._near, body.points.motion, body.points.matter, window.width, surface)

    def outward_normals(self, nodes: NDArray) -> NDArray:
        """Unit vectors (2, n) out of the body at nodes (Eq. 6.33); 0 where the sum vanishes.

        The functions of a node outside grow from the points towards it, so that the sum points outwards as it stands.
        """
        surface = self.body.window.surface
        slope = np.array([surface.slope_x[nodes], surface.slope_y[nodes]])
        length = np.hypot(*slope)
        return np.divide(slope, length, out=np.zeros_like(slope), where=length > 0.0)

    def reach(self, nodes: NDArray, normal: NDArray) -> NDArray:
        """How far (n,) the body reaches from nodes along normals (2, n) [length]."""
        body, surface = self.body, self.body.window.surface
        surface.normal_x[nodes], surface.normal_y[nodes] = normal
        surface.reach[:] = -np.inf
        body.transfers.reaches(self._near, body.points.motion, body.points.matter, body.window.width, surface)
        return body.lattice.h * surface.reach[nodes]


@njit(cache=True)
def mark_cells(nodes, width, order, touches):
    """Mark the cells whose points reach one of the nodes."""
    for node in nodes:
        i, j = node // width, node % width
        for a in range(max(0, i - order), i + 1):
            for b in range(max(0, j - order), j + 1):
                touches[a * width + b] = True
