"""The lattice that all moving bodies share, and the part of it that goes with one body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Lattice:
    """Nodes of spacing h [length] for splines of an order; node (i, j) is at origin + (i, j) h - (order - 1) h / 2."""

    origin: NDArray
    h: float
    order: int


class NodeSums(NamedTuple):
    """What points give to the nodes: mass, momentum, force."""

    m: NDArray
    px: NDArray
    py: NDArray
    fx: NDArray
    fy: NDArray


class NodeVelocities(NamedTuple):
    """Velocity of the nodes before and after the step; ``packed`` (4 n_nodes,) holds that after it and its change, side
    by side for each node."""

    old_x: NDArray
    old_y: NDArray
    vx: NDArray
    vy: NDArray
    packed: NDArray


class NodeTractions(NamedTuple):
    """The part of the force that comes from tractions."""

    x: NDArray
    y: NDArray


class NodeSurface(NamedTuple):
    """Where bodies meet: mass gradient, normal, how far the body reaches along it, and the cells around shared nodes."""

    slope_x: NDArray
    slope_y: NDArray
    normal_x: NDArray
    normal_y: NDArray
    reach: NDArray
    touches: NDArray


@dataclass
class GridWindow:
    """A body's nodes of the lattice; arrays over them are flat, x before y.

    Attributes
    ----------
    corner, shape : (2,) first node in the lattice, and the number of nodes.
    strips : (n_strips + 1,) first point of each strip of columns of cells.
    is_mapped : the nodes' sums are those of the body's points.
    """

    corner: NDArray
    shape: NDArray
    strips: NDArray
    sums: NodeSums
    velocities: NodeVelocities
    tractions: NodeTractions
    surface: NodeSurface
    is_mapped: bool = False

    @classmethod
    def over(cls, corner: NDArray, shape: NDArray, strips: NDArray) -> GridWindow:
        """A window whose arrays are zero."""
        size = int(np.prod(shape))
        sums, velocities, tractions, surface = ([np.zeros(size) for _ in range(count)] for count in (5, 4, 2, 5))
        velocities.append(np.zeros(4 * size))
        surface.append(np.zeros(size, bool))
        return cls(
            corner, shape, strips, NodeSums(*sums), NodeVelocities(*velocities), NodeTractions(*tractions),
            NodeSurface(*surface),
        )  # fmt: skip

    @property
    def width(self) -> int:
        """Nodes in y."""
        return int(self.shape[1])
