"""Where material points start, and the volume that each of them stands for."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.bodies import Body
from cases.geometry import Shape
from cases.spacing import grid_lines
from mpm.inclined_slits import InclinedSlit, inclined_slits
from mpm.mesh_points import mesh_points


@dataclass(frozen=True)
class PointCloud:
    """Material points before loading.

    Attributes
    ----------
    positions : (n, 2).
    volume : (n,) area times thickness.
    size : (n, 2) extent in x and y of the rectangle that the point stands for; on circles, radially and round about.
    corner : (n, 2) lower corner of that rectangle, from the point.
    body : (n,) number of the body.
    """

    positions: NDArray
    volume: NDArray
    size: NDArray
    corner: NDArray
    body: NDArray

    def only(self, kept: NDArray) -> PointCloud:
        """The points of a mask (n,)."""
        return PointCloud(*(getattr(self, each.name)[kept] for each in fields(self)))


def place_points(case: Case) -> PointCloud:
    """Points of a case: at Gauss points, regularly or at random (seeded) in each cell, kept where a body is.

    Or those of `mpm.mesh_points`. Each point stands for a rectangle; on Gauss points its sides are the weights, otherwise
    equal shares of the cell. A rectangle that an inclined slit parts becomes two points.
    """
    if case.mpm.placement == "mesh":
        cloud = PointCloud(*mesh_points(case))
        return cloud.only(~case.left_out(cloud.positions))
    x_lines, y_lines = (np.asarray(lines) for lines in grid_lines(case))
    widths = np.stack(np.meshgrid(np.diff(x_lines), np.diff(y_lines), indexing="ij"), -1).reshape(-1, 1, 2)
    corners = np.stack(np.meshgrid(x_lines[:-1], y_lines[:-1], indexing="ij"), -1).reshape(-1, 1, 2)
    local, lower, extent = _local_points(case, len(corners))
    positions = (corners + widths * local).reshape(-1, 2)
    size = (widths * extent).reshape(-1, 2)
    corner = (widths * (lower - local)).reshape(-1, 2)
    volume = size.prod(axis=1) * case.plane.thickness
    body = case.inside(positions)
    cloud = PointCloud(positions, volume, size, corner, body).only((body >= 0) & ~case.left_out(positions))
    for slit in inclined_slits(case):
        cloud = _halved(cloud, slit)
    return cloud


def _halved(cloud: PointCloud, slit: InclinedSlit) -> PointCloud:
    """The cloud with points on both sides of a slit, each in the middle of a part of a rectangle that the slit parts.

    Four quarters of these are parted, and a rectangle of the same shape and of the part's area stands for each part.
    """
    lower = cloud.positions + cloud.corner
    cut = np.isin(np.arange(len(cloud.volume)), slit.halves(lower, lower + cloud.size).number)
    quarters = _quartered(cloud.only(cut))
    lower = quarters.positions + quarters.corner
    number, area, middle = slit.halves(lower, lower + quarters.size)
    whole = ~np.isin(np.arange(len(quarters.volume)), number)
    clouds = [cloud.only(~cut), quarters.only(whole)]
    for side in (0, 1):
        share = area[:, side] / quarters.size[number].prod(axis=1)
        size = np.sqrt(share)[:, None] * quarters.size[number]
        volume = share * quarters.volume[number]
        clouds.append(PointCloud(middle[:, side], volume, size, -0.5 * size, quarters.body[number]))
    return _joined(clouds)


def _quartered(cloud: PointCloud) -> PointCloud:
    """A point in the middle of each quarter of the rectangles."""
    middle, size = cloud.positions + cloud.corner + 0.5 * cloud.size, 0.5 * cloud.size
    steps = 0.5 * np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]])
    places = [middle + step * size for step in steps]
    return _joined([PointCloud(place, 0.25 * cloud.volume, size, -0.5 * size, cloud.body) for place in places])


def _joined(clouds: list[PointCloud]) -> PointCloud:
    return PointCloud(*(np.concatenate([getattr(part, each.name) for part in clouds]) for each in fields(PointCloud)))


def placement_health(case: Case, cloud: PointCloud) -> dict[str, float]:
    """How well the points fill the grid's cells: indicators of the health record.

    quadrature : share of the volume in cells with fewer than 2 x 2 points. scatter : distance of the points' middle from
    that of their cell, over its width (root mean square over the cells that have all of their points, or, where these are
    those of a mesh, over the cells that have points on all sides).
    """
    lines = [np.asarray(axis) for axis in grid_lines(case)]
    places = [np.clip(np.searchsorted(x, cloud.positions[:, d]) - 1, 0, len(x) - 2) for d, x in enumerate(lines)]
    found, cell, count = np.unique(places[0] * len(lines[1]) + places[1], return_inverse=True, return_counts=True)
    along = zip(cloud.positions.T, lines, places, strict=True)
    local = [(position - x[place]) / (x[place + 1] - x[place]) - 0.5 for position, x, place in along]
    volume = np.bincount(cell, cloud.volume)
    middles = np.array([np.bincount(cell, part * cloud.volume) / volume for part in local])
    full = count == case.mpm.points_per_cell**2
    if case.mpm.placement == "mesh":
        sides = [np.isin(found + step, found) for step in (-1, 1, -len(lines[1]), len(lines[1]))]
        full = np.logical_and.reduce(sides)
    sparse = cloud.volume[count[cell] < 4].sum() / cloud.volume.sum()
    scatter = float(np.sqrt((middles[:, full] ** 2).sum(axis=0).mean())) if full.any() else 0.0
    return {"quadrature": float(sparse), "scatter": scatter}


def placement_health_in_bodies(case: Case, cloud: PointCloud) -> dict[str, float]:
    """The same indicators for `place_in_bodies`; points on rings fill their body evenly."""
    offsets = []
    for number, body in enumerate(case.bodies.values()):
        if case.mpm.placement == "rings" and _circles(body.shape) is not None:
            continue
        (_, n_y), width = _cells_of_body(case, body)
        local = (cloud.positions[cloud.body == number] - body.bounds()[0]) / width
        _, cell, count = np.unique(np.floor(local) @ (n_y, 1), return_inverse=True, return_counts=True)
        middles = np.column_stack([np.bincount(cell, part % 1.0 - 0.5) / count for part in local.T])
        offsets.append(middles[count == case.mpm.points_per_cell**2])
    offset = np.concatenate([*offsets, np.zeros((0, 2))])
    scatter = float(np.sqrt((offset**2).sum(axis=1).mean())) if len(offset) else 0.0
    return {"quadrature": float(case.mpm.points_per_cell < 2), "scatter": scatter}


def place_in_bodies(case: Case) -> PointCloud:
    """Points of a case whose bodies move: each body has cells of its own, as many as fit its bounding box.

    The cells are at most h wide, so that a rectangle keeps its area and a symmetric body its symmetry. Placed on
    "rings", the points of discs and of rings lie on circles: a regular pattern would make polygons of them, which
    tip instead of rolling. Other bodies then have regular ones.
    """
    clouds = [_place_in_body(case, number) for number in range(len(case.bodies))]
    return PointCloud(*(np.concatenate(parts) for parts in zip(*clouds, strict=True)))


def _place_in_body(case: Case, number: int) -> tuple[NDArray, ...]:
    """Positions, volumes, sizes, corners and body numbers of the points of one body."""
    body = list(case.bodies.values())[number]
    circles = _circles(body.shape) if case.mpm.placement == "rings" else None
    if circles is not None:
        positions, size = _on_rings(*circles, case.mesh.h / case.mpm.points_per_cell)
        corner = -0.5 * size
    else:
        lower, _ = body.bounds()
        (n_x, n_y), width = _cells_of_body(case, body)
        cells = np.stack(np.meshgrid(np.arange(n_x), np.arange(n_y), indexing="ij"), -1).reshape(-1, 1, 2)
        local, start, extent = _local_points(case, len(cells))
        positions = (lower + width * (cells + local)).reshape(-1, 2)
        size = np.broadcast_to(width * extent, (len(cells), *extent.shape[1:])).reshape(-1, 2)
        corner = np.broadcast_to(width * (start - local), (len(cells), *extent.shape[1:])).reshape(-1, 2)
    kept = (case.inside(positions) == number) & ~case.left_out(positions)
    volume = size.prod(axis=1) * case.plane.thickness
    return positions[kept], volume[kept], size[kept], corner[kept], np.full(kept.sum(), number)


def cells_in_bodies(case: Case) -> NDArray:
    """Cells (n_bodies,) that the points of `place_in_bodies` fill in each body, from its area: without placing any."""
    areas = [outline.area for outline in case.outlines()]
    bodies = zip(case.bodies.values(), areas, strict=True)
    return np.array([area / _area_of_cell(case, body) for body, area in bodies])


def _area_of_cell(case: Case, body: Body) -> float:
    """Area that ``points_per_cell`` squared points of a body stand for [length²]."""
    circles = _circles(body.shape) if case.mpm.placement == "rings" else None
    if circles is None:
        return float(np.prod(_cells_of_body(case, body)[1]))
    _, inner, outer = circles
    per_cell = case.mpm.points_per_cell
    return (per_cell * (outer - inner) / _number_of_rings(inner, outer, case.mesh.h / per_cell)) ** 2


def _cells_of_body(case: Case, body: Body) -> tuple[NDArray, NDArray]:
    """Number (2,) and width (2,) of the cells over a body's bounding box."""
    lower, upper = body.bounds()
    number = np.maximum(1, np.ceil((upper - lower) / case.mesh.h - 1e-6)).astype(int)
    return number, (upper - lower) / number


def _number_of_rings(inner: float, outer: float, spacing: float) -> int:
    return max(1, int(np.ceil((outer - inner) / spacing - 1e-6)))


def _circles(shape: Shape | None) -> tuple[NDArray, float, float] | None:
    """Centre, inner and outer radius of a disc or a ring; None of other shapes."""
    if shape is not None and shape.disc:
        return np.array(shape.disc.centre), 0.0, shape.disc.radius
    if shape is not None and shape.difference and shape.difference.of.disc and len(shape.difference.minus) == 1:
        outer, inner = shape.difference.of.disc, shape.difference.minus[0].disc
        if inner is not None and inner.centre == outer.centre:
            return np.array(outer.centre), inner.radius, outer.radius
    return None


def _on_rings(centre: NDArray, inner: float, outer: float, spacing: float) -> tuple[NDArray, NDArray]:
    """Positions (n, 2) on circles and sizes (n, 2), radially and round about, that fill a ring without overlap."""
    n_rings = _number_of_rings(inner, outer, spacing)
    thickness = (outer - inner) / n_rings
    positions, size = [], []
    for radius in inner + thickness * (np.arange(n_rings) + 0.5):
        count = 4 * max(1, round(np.pi * radius / (2.0 * thickness)))
        angle = 2.0 * np.pi * (np.arange(count) + 0.5) / count
        positions.append(centre + radius * np.column_stack([np.cos(angle), np.sin(angle)]))
        size.append(np.full((count, 2), (thickness, 2.0 * np.pi * radius / count)))
    return np.concatenate(positions), np.concatenate(size)


def _local_points(case: Case, n_cells: int) -> tuple[NDArray, NDArray, NDArray]:
    """Points in the unit cell, lower corners and extents of their rectangles, all (n_cells or 1, n, 2)."""
    per_direction = case.mpm.points_per_cell
    if case.mpm.placement == "random":
        generator = np.random.default_rng(case.mpm.seed)
        scattered = generator.random((n_cells, per_direction**2, 2))
        share = np.full(scattered.shape, 1.0 / per_direction)
        return scattered, scattered - 0.5 * share, share
    if case.mpm.placement == "gauss":
        abscissae, weights = np.polynomial.legendre.leggauss(per_direction)
        abscissae, weights = 0.5 * (abscissae + 1.0), 0.5 * weights
    else:
        abscissae = (np.arange(per_direction) + 0.5) / per_direction
        weights = np.full(per_direction, 1.0 / per_direction)
    starts = np.cumsum(weights) - weights
    pairs = (np.stack(np.meshgrid(a, a, indexing="ij"), -1).reshape(1, -1, 2) for a in (abscissae, starts, weights))
    points, lower, extent = pairs
    # one cell stands for all
    return points, np.repeat(lower, n_cells, axis=0), np.repeat(extent, n_cells, axis=0)
