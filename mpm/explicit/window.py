"""The lattice that all moving bodies share, and the part of it that goes with one body."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mpm.explicit.transfers import STRIP


@dataclass(frozen=True)
class Lattice:
    """Nodes of spacing h [length] for splines of an order; node (i, j) is at origin + (i, j) h - (order - 1) h / 2."""

    origin: NDArray
    h: float
    order: int


class NodeSums(NamedTuple):
    """What points give to the nodes: mass, and momentum x, y and force x, y side by side (4 n_nodes,)."""

    m: NDArray
    fields: NDArray


class NodeVelocities(NamedTuple):
    """Velocity of the nodes before and after the step; ``packed`` (4 n_nodes,) holds that after it and its change, side
    by side for each node.

    ``last_x, last_y`` is that with which the step before left them, NaN where the body was not: points that follow it
    bring other velocities to the nodes than they have taken from them.
    """

    old_x: NDArray
    old_y: NDArray
    vx: NDArray
    vy: NDArray
    last_x: NDArray
    last_y: NDArray
    packed: NDArray


class NodeTractions(NamedTuple):
    """The part of the force that comes from tractions."""

    x: NDArray
    y: NDArray


class NodeSurface(NamedTuple):
    """Where bodies meet: mass gradient, normal, how far the body reaches along it; how far a free rigid body reaches
    within a cell beside it, and how far to the left of the normal that is.

    ``low, high`` (n_columns,) are the rows of the cells in each column whose points are near.
    """

    slope_x: NDArray
    slope_y: NDArray
    normal_x: NDArray
    normal_y: NDArray
    reach: NDArray
    farthest: NDArray
    aside: NDArray
    low: NDArray
    high: NDArray


@dataclass
class GridWindow:
    """A body's nodes of the lattice; arrays over them are flat, x before y.

    Attributes
    ----------
    corner, shape : (2,) first node in the lattice, and the number of nodes.
    starts : (n_nodes + 1,) first point of each cell, of the number of its first node, in which points were sorted.
    strips : (n_strips + 1,) first point of each strip of columns of cells.
    """

    corner: NDArray
    shape: NDArray
    starts: NDArray
    strips: NDArray
    sums: NodeSums
    velocities: NodeVelocities
    tractions: NodeTractions
    surface: NodeSurface

    @classmethod
    def over(cls, corner: NDArray, shape: NDArray, starts: NDArray) -> GridWindow:
        """A window whose arrays are zero."""
        size, width = int(np.prod(shape)), int(shape[1])
        sums, velocities, tractions, surface = ([np.zeros(size) for _ in range(count)] for count in (1, 6, 2, 7))
        velocities[4][:] = velocities[5][:] = np.nan
        for group in (sums, velocities):
            group.append(np.zeros(4 * size))
        surface += [np.zeros(shape[0], np.int64) for _ in range(2)]
        firsts = starts[: -1 : STRIP * width]
        strips = np.append(firsts[firsts < starts[-1]], starts[-1])
        return cls(
            corner, shape, starts, strips, NodeSums(*sums), NodeVelocities(*velocities), NodeTractions(*tractions),
            NodeSurface(*surface),
        )  # fmt: skip

    def remember(self, other: GridWindow) -> None:
        """Take the velocities with which the step before left the nodes from another window."""
        lower = np.maximum(self.corner, other.corner)
        upper = np.minimum(self.corner + self.shape, other.corner + other.shape)
        for now, before in zip(self.velocities[4:6], other.velocities[4:6], strict=True):
            common = [tuple(map(slice, lower - w.corner, upper - w.corner)) for w in (self, other)]
            now.reshape(self.shape)[common[0]] = before.reshape(other.shape)[common[1]]

    def first_node(self, lattice: Lattice) -> NDArray:
        """Place (2,) of the window's first node [length]."""
        return lattice.origin + lattice.h * (self.corner - 0.5 * (lattice.order - 1))  # type: ignore[no-any-return]

    @cached_property
    def width(self) -> int:
        """Nodes in y."""
        return int(self.shape[1])
