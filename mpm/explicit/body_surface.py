"""Where a body ends, as its contact partners see it at the nodes that they share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mpm.explicit.moving_body import MovingBody

#: own normals whose difference is shorter than this do not tell a direction
SHORTEST_NORMAL = 1e-6


def find_mass_slopes(body: MovingBody, nodes: Sequence[NDArray]) -> None:
    """Mass gradients of a body at nodes of its window, from the points of the cells around them."""
    window, chosen = body.window, nodes[0] if len(nodes) == 1 else np.concatenate(nodes)
    surface, points = window.surface, body.points
    body.transfers.mass_slopes(chosen, window.starts, points.motion, points.matter, window.width, surface)


def find_reach(body: MovingBody) -> None:
    """How far the body reaches from nodes along the normals of its surface, in cells."""
    window, points = body.window, body.points
    has_edges = not body.deforms and not body.keeps_velocity
    body.transfers.reaches(window.starts, points.motion, points.matter, window.width, has_edges, window.surface)


@njit(forceinline=True)
def own_normal(surface, node):
    """Unit vector out of the body (Eq. 6.33), 0 where the sum vanishes.

    The functions of a node outside grow from the points towards it, so that the sum points outwards as it stands.
    """
    x, y = surface.slope_x[node], surface.slope_y[node]
    length = np.hypot(x, y)
    return (x / length, y / length) if length > 0.0 else (0.0, 0.0)


@njit(cache=True)
def find_normals(first, second, first_holds, second_holds, touching, count):
    """Common normals (Eq. 6.34) at the first ``count`` nodes; keeps those that have one and returns how many.

    ``first, second`` : ``NodeSurface`` of both bodies, which take them too. ``first_holds, second_holds`` : this body's
    normal alone holds. ``touching`` : ``Touching``.
    """
    kept = 0
    for n in range(count):
        a, b = touching.nodes[0, n], touching.nodes[1, n]
        ax, ay = own_normal(first, a)
        bx, by = own_normal(second, b)
        x = (0.0 if second_holds else ax) - (0.0 if first_holds else bx)
        y = (0.0 if second_holds else ay) - (0.0 if first_holds else by)
        length = np.hypot(x, y)
        if length <= SHORTEST_NORMAL:
            continue
        x, y = x / length, y / length
        touching.nodes[0, kept], touching.nodes[1, kept] = a, b
        touching.normal[0, kept], touching.normal[1, kept] = x, y
        touching.gap[kept] = touching.offset[0, kept] = touching.offset[1, kept] = 0.0
        touching.pushes[kept] = touching.drags[kept] = 0.0
        touching.opposed[kept] = ax * bx + ay * by <= 0.0
        first.normal_x[a], first.normal_y[a] = x, y
        second.normal_x[b], second.normal_y[b] = -x, -y
        for surface, node in ((first, a), (second, b)):
            surface.reach[node] = surface.farthest[node] = -np.inf
        kept += 1
    return kept


@njit(forceinline=True)
def reach_of(surface, node):
    """How far a body reaches along the normal at a node, and how far to the left of the normal, in cells.

    Where it rises faster than it goes aside from its farthest point within a cell to the node, the node lies off its
    edge: the edge meets what the node carries.
    """
    if surface.farthest[node] - surface.reach[node] > abs(surface.aside[node]):
        return surface.farthest[node], surface.aside[node]
    return surface.reach[node], 0.0


@njit(cache=True)
def find_gaps(first, second, h, touching, count):
    """Gaps between both bodies at their nodes, and where these are [length], from how far the bodies reach."""
    for n in range(count):
        reach, aside = reach_of(first, touching.nodes[0, n])
        other, other_aside = reach_of(second, touching.nodes[1, n])
        touching.gap[n] = -h * (reach + other)
        if touching.gap[n] < np.inf:
            nx, ny = touching.normal[0, n], touching.normal[1, n]
            along, aside = 0.5 * h * (reach - other), h * (aside - other_aside)
            touching.offset[0, n], touching.offset[1, n] = along * nx - aside * ny, along * ny + aside * nx
