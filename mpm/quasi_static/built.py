"""Whether the points and their grid are what the case has drawn, asked before anything is computed."""

from __future__ import annotations

from cases import Case
from mpm.grid import Grid, GridError
from mpm.placement import PointCloud
from mpm.quasi_static.constraints import Supports
from numerics.built import check_notches_part, check_support, parts_of_nodes


def check_built(case: Case, grid: Grid, cloud: PointCloud, supports: Supports) -> None:
    """Raise GridError or BuiltError where notches do not part the points, bodies can move freely, or functions lock."""
    if case.mesh.locking_free and grid.order == 1:
        text = "mesh.locking_free: B-splines of order 1 lock and have no B-bar; set mpm.order = 2"
        raise GridError(f"{case.source}: {text}")
    nodes = grid.cell_nodes(grid.locate(cloud.positions, grid.sides(cloud.positions)))
    reach = (grid.order + 1) * case.mesh.h
    remedy = f'make mesh.h no more than 1/{grid.order + 2} of it, or give kind = "slit" or "history"'
    check_notches_part(case, cloud.positions, nodes, reach, remedy)
    of_nodes = parts_of_nodes(nodes, grid.n_nodes)
    part = of_nodes[nodes[:, 0]]
    held = supports.nodes.holds(of_nodes).joined(supports.springs.holds(cloud.positions, part))
    check_support(case, held, part, cloud.body)
