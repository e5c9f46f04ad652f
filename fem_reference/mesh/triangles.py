"""Unstructured triangles from outlines, by netgen.

Outlines and slits are cut into one planar graph of short straight edges whose lengths follow the wanted size;
netgen fills it without touching these edges. So a slit is a chain of mesh edges from the start.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import netgen.meshing as netgen
import numpy as np
import pyngcore
import shapely
from netgen.geom2d import SplineGeometry
from shapely.geometry.base import BaseGeometry

from cases.errors import MeshError
from cases.geometry import Box, Circle, Shape
from cases.mesh_arrays import Floats, Integers, MeshArrays, signed_areas
from cases.notches import CellsNotch, Segment

# Netgen takes a size as a wish: inside a region of one wanted size, edges come out up to 1.2 times as long.
# Asking for this share of the size gives a median edge within a tenth of the size itself.
ASKED = 0.85
# Netgen's triangles lose their shape when sizes grow faster than this per unit of distance.
STEEPEST = 0.7
# Straight edges round a circle, at the least: their polygon covers 0.3 % less than the disc.
CHORDS_OF_CIRCLE = 48
# Places along a line at which the wanted size is sampled to divide it.
SAMPLES = 200
# An end of a slit this near to an outline, in shares of h, is meant to be on it.
SNAP = 1e-3
# Edges shorter than this share of the bodies, and corners sharper than this angle, are such that netgen may not come to
# an end with them.
SHORTEST = 1e-7
SHARPEST = 2e-4


@dataclass(frozen=True)
class Feature:
    """A circle (a point with radius 0) with smaller elements about it; centre, radius, size [length]."""

    centre: tuple[float, float]
    radius: float
    size: float

    @classmethod
    def of_circle(cls, circle: Circle) -> Feature:
        """Elements small enough for the circle to look round."""
        return cls(circle.centre, circle.radius, 2.0 * np.pi * circle.radius / CHORDS_OF_CIRCLE)


@dataclass(frozen=True)
class SizedBox:
    """A box with elements of a size, from which sizes grow; corners (2,), size [length]."""

    lower: Floats
    upper: Floats
    size: float

    def away(self, points: Floats) -> Floats:
        """Distances (n,) of points (n, 2)."""
        return np.linalg.norm(np.maximum(0.0, np.maximum(self.lower - points, points - self.upper)), axis=1)


@dataclass(frozen=True)
class SizeField:
    """Wanted length of edges [length]: h in the fine box, each next one outside larger by `growth` up to `coarse`.

    fine : None where all is fine
    refined : boxes with sizes of their own, from which sizes below these grow in the same way
    features : places from which sizes below these grow in the same way
    """

    h: float
    coarse: float
    growth: float
    fine: SizedBox | None = None
    refined: tuple[SizedBox, ...] = ()
    features: tuple[Feature, ...] = ()

    @property
    def boxes(self) -> tuple[SizedBox, ...]:
        """The fine box and the refined ones."""
        return (self.fine, *self.refined) if self.fine else ()

    def __call__(self, points: Floats) -> Floats:
        """Wanted sizes (n,) at points (n, 2)."""
        size = np.full(len(points), self.coarse)
        for box in self.boxes:
            size = np.minimum(size, box.size + self.grading * box.away(points))
        for feature in self.features:
            away = np.abs(np.linalg.norm(points - feature.centre, axis=1) - feature.radius)
            size = np.minimum(size, feature.size + self.grading * away)
        return size

    @property
    def grading(self) -> float:
        """Growth of the size per unit of distance: over one element it amounts to the factor `growth`."""
        return min(float(np.log(self.growth)), STEEPEST)

    @property
    def is_uniform(self) -> bool:
        """One size everywhere."""
        return self.coarse <= self.h or self.fine is None


@dataclass(frozen=True)
class Graph:
    """Planar graph of straight edges.

    points : (n_points, 2); ends : (n_edges, 2) point indices
    sides : (n_edges, 2) number of the outline to the left and to the right, 0 for none
    """

    points: Floats
    ends: Integers
    sides: Integers


def triangulate(
    outlines: Sequence[BaseGeometry],
    size: SizeField,
    slits: Sequence[Segment] = (),
    anchors: Sequence[tuple[float, float]] = (),
    circles: Sequence[Circle] = (),
) -> MeshArrays:
    """Triangles over the outlines, numbered by `body` in their order.

    Outlines that share an edge share its nodes. The slits become edges of triangles, still closed. `anchors`
    on an outline become nodes. Nodes that netgen adds on a chord of one of the `circles` are moved onto it.

    Raises MeshError when netgen cannot fill an outline.
    """
    graph = planar_graph(outlines, slits, anchors, size)
    mesh, segments = _filled(graph, size)
    areas = np.bincount(mesh.body, signed_areas(mesh.points, mesh.cells), len(outlines))
    if not np.allclose(areas, [outline.area for outline in outlines], rtol=1e-6):
        raise MeshError("mesh.h: netgen left a part of a body without elements; set a smaller mesh.h")
    mesh = replace(mesh, points=_onto_circles(mesh.points, segments, graph, circles))
    return mesh.without_unused_points()


def outline_of(shape: Shape, size: SizeField, corners: Sequence[tuple[float, float]] = ()) -> BaseGeometry:
    """The shape as a polygon whose corners on circles are as near to each other as the wanted size.

    Those of the points `corners` that lie on a circle are corners of its polygon, and so are the ends of its arcs where
    straight edges cut it.
    """
    if shape.difference:
        corners = [*corners, *_ends_of_arcs(shape)]
    if shape.disc:
        return shapely.Polygon(_circle_corners(shape.disc, size, corners))
    if shape.difference:
        holes = [outline_of(hole, size, corners) for hole in shape.difference.minus]
        return outline_of(shape.difference.of, size, corners) - shapely.union_all(holes)
    return shape.outline()


def _ends_of_arcs(shape: Shape) -> list[tuple[float, float]]:
    """Points at which straight edges of the shape cut its circles."""
    straight = [np.asarray(part.outline().exterior.coords) for part in _parts_of(shape) if not part.disc]
    return [cut for corners in straight for edge in pairwise(corners) for cut in _cuts_of_circles(shape, edge)]


def _cuts_of_circles(shape: Shape, edge: Sequence[Floats]) -> Iterator[tuple[float, float]]:
    """Points at which a straight edge, from its start to its end (2,), cuts the circles of the shape."""
    start, way = np.asarray(edge[0]), np.subtract(edge[1], edge[0])
    for circle in circles_of(shape):
        offset = start - circle.centre
        half, square = way @ offset / (way @ way), (offset @ offset - circle.radius**2) / (way @ way)
        root = np.sqrt(max(0.0, half**2 - square))
        for t in (-half - root, -half + root):
            if 0.0 <= t <= 1.0 and half**2 > square:
                x, y = start + t * way
                yield float(x), float(y)


def cuts_of_box(shape: Shape, box: Box) -> Iterator[tuple[float, float]]:
    """Points at which the sides of a box cut the outline of the shape."""
    sides = pairwise(np.asarray(shapely.box(*box.lower, *box.upper).exterior.coords))
    for edge in (side for side in sides if np.ptp(side, axis=0).any()):  # a flat box has two of no length
        yield from _cuts_of_circles(shape, edge)
        for part in _parts_of(shape):
            if not part.disc:
                cuts = shapely.LineString(edge).intersection(part.outline().boundary)
                yield from ((float(x), float(y)) for x, y in shapely.get_coordinates(cuts))


def _parts_of(shape: Shape) -> list[Shape]:
    """The rectangles, polygons and discs that a shape is made of."""
    if not shape.difference:
        return [shape]
    return [part for other in (shape.difference.of, *shape.difference.minus) for part in _parts_of(other)]


def circles_of(shape: Shape) -> list[Circle]:
    """All circles that bound the shape."""
    if shape.difference:
        return [c for part in (shape.difference.of, *shape.difference.minus) for c in circles_of(part)]
    return [shape.disc] if shape.disc else []


def notch_outline(notch: CellsNotch, outline: BaseGeometry) -> BaseGeometry:
    """The rectangle that the notch leaves out; an end on the outline is carried on beyond it.

    Carried on, because a notch that enters an inclined edge squarely would leave a sliver at its mouth.
    """
    reach = np.outer([-notch.width, notch.width], notch.direction)
    ends = np.array([notch.start, notch.end])
    at_mouth = shapely.dwithin(outline.boundary, shapely.points(ends), 1e-6 * notch.width)
    line = shapely.LineString(ends + np.where(at_mouth[:, None], reach, 0.0))
    return line.buffer(notch.width / 2.0, cap_style="flat")


def snapped(slit: Segment, outlines: Sequence[BaseGeometry], reach: float) -> Segment:
    """The slit with an end that lies within `reach` [length] of an outline moved onto it."""

    def onto(end: tuple[float, float]) -> tuple[float, float]:
        """The end, or its nearest point on an outline within reach."""
        point = shapely.Point(end)
        boundary = min((outline.boundary for outline in outlines), key=point.distance)
        if point.distance(boundary) > reach:
            return end
        nearest = shapely.shortest_line(boundary, point).coords[0]
        return float(nearest[0]), float(nearest[1])

    return slit.model_copy(update={"start": onto(slit.start), "end": onto(slit.end)})


def divided(start: Floats, end: Floats, size: SizeField) -> Floats:
    """Points (n, 2) from start to end, spaced by the wanted size."""
    place = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    return _spaced(start + place * (end - start), size, least=1)


def _circle_corners(circle: Circle, size: SizeField, corners: Sequence[tuple[float, float]]) -> Floats:
    """Corners of the circle's polygon: those given that lie on it, and between them as many as are wanted."""
    offset = np.reshape(corners, (-1, 2)) - circle.centre
    on_circle = np.abs(np.linalg.norm(offset, axis=1) - circle.radius) < SNAP * size.h
    fixed = np.arctan2(*offset[on_circle].T[::-1]) if on_circle.any() else np.zeros(1)
    # Nearer to each other than a millionth of the radius, two corners are one.
    fixed = np.sort(np.mod(fixed + 1e-6, 2.0 * np.pi) - 1e-6)
    fixed = fixed[np.diff(fixed, prepend=-np.inf) > 1e-6]
    arcs = [
        _arc_corners(circle, size, first, last) for first, last in pairwise([*fixed, fixed[0] + 2.0 * np.pi])
    ]
    return np.concatenate([arc[:-1] for arc in arcs])


def _arc_corners(circle: Circle, size: SizeField, first: float, last: float) -> Floats:
    """Points on the circle from one angle to the next [radians]."""
    angle = np.linspace(first, last, 16 * SAMPLES)
    path = circle.centre + circle.radius * np.column_stack([np.cos(angle), np.sin(angle)])
    least = int(np.ceil((last - first) / (2.0 * np.pi) * CHORDS_OF_CIRCLE))
    offset = _spaced(path, size, least) - circle.centre
    return circle.centre + offset * (circle.radius / np.linalg.norm(offset, axis=1))[:, None]


def _spaced(path: Floats, size: SizeField, least: int) -> Floats:
    """Points along the path, `least` intervals or more, each as long as the size wanted there or less."""
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    intervals = np.concatenate([[0.0], np.cumsum(lengths / size(0.5 * (path[1:] + path[:-1])))])
    number = max(least, int(np.ceil(intervals[-1] - 1e-9)))
    place = np.linspace(0.0, intervals[-1], number + 1)
    points = np.column_stack([np.interp(place, intervals, coordinate) for coordinate in path.T])
    points[0], points[-1] = path[0], path[-1]
    return points


def planar_graph(
    outlines: Sequence[BaseGeometry],
    slits: Sequence[Segment],
    anchors: Sequence[tuple[float, float]],
    size: SizeField,
) -> Graph:
    """Outlines and slits, cut where they meet and divided by the wanted size.

    Raises MeshError where an edge is too short or a corner too sharp.
    """
    lines = [outline.boundary for outline in outlines]
    lines += [shapely.LineString([slit.start, slit.end]) for slit in slits]
    extent = np.ptp(np.reshape(shapely.union_all(outlines).bounds, (2, 2)), axis=0).max()
    # On a grid of a power of ten, meeting points are found safely and decimal coordinates stay as they are.
    grid = 10.0 ** (np.floor(np.log10(extent)) - 10)
    noded = shapely.get_parts(shapely.unary_union(lines, grid_size=grid))
    edges = np.concatenate([_consecutive(shapely.get_coordinates(line)) for line in noded])
    edges = np.concatenate([_cut_at(edge, anchors, 10 * grid) for edge in edges])
    edges = np.concatenate([_consecutive(divided(start, end, size)) for start, end in edges])
    sides = _sides(edges, outlines, 10 * grid)
    edges, sides = edges[sides.any(axis=1)], sides[sides.any(axis=1)]
    _refuse_short(edges, SHORTEST * extent)
    points, ends = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    _refuse_sharp(points, ends.reshape(-1, 2))
    return Graph(points, ends.reshape(-1, 2), sides)


def _refuse_short(edges: Floats, shortest: float) -> None:
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    if lengths.min() < shortest:
        x, y = edges[lengths.argmin(), 0]
        raise MeshError(
            f"bodies: an edge at ({x:g}, {y:g}) is {lengths.min():.2g} long, too short for a mesh of these bodies; leave "
            f"out what is so small, or make its edges longer than {shortest:.2g}"
        )


def _refuse_sharp(points: Floats, ends: Integers) -> None:
    at, to = np.concatenate([ends, ends[:, ::-1]]).T
    way = points[to] - points[at]
    angle = np.arctan2(way[:, 1], way[:, 0])
    order = np.lexsort([angle, at])
    # from each edge to the next one about the same point; behind the last one comes the first, a turn later
    first = np.flatnonzero(np.diff(at[order], prepend=-1))
    following = np.append(order[1:], order[0])
    following[np.append(first[1:], len(order)) - 1] = order[first]
    gap = np.mod(angle[following] - angle[order], 2.0 * np.pi)
    gap[following == order] = 2.0 * np.pi
    if gap.min() < SHARPEST:
        x, y = points[at[order[gap.argmin()]]]
        raise MeshError(
            f"bodies: the corner at ({x:g}, {y:g}) of {np.degrees(gap.min()):.2g} degrees is too sharp for a mesh; blunt "
            f"it, or draw a slit where it is meant to be none"
        )


def _consecutive(points: Floats) -> Floats:
    """Pairs of neighbours along a polyline, (n - 1, 2, 2)."""
    return np.stack([points[:-1], points[1:]], axis=1)


def _cut_at(edge: Floats, anchors: Sequence[tuple[float, float]], tolerance: float) -> Floats:
    """The edge as pieces that end at the anchors on it, (n_pieces, 2, 2)."""
    line = shapely.LineString(edge)
    on_edge = [anchor for anchor in anchors if line.distance(shapely.Point(anchor)) < tolerance]
    inner: list[Floats] = []
    for anchor in sorted(on_edge, key=lambda anchor: float(np.linalg.norm(edge[0] - anchor))):
        if np.linalg.norm(np.array([*edge, *inner]) - anchor, axis=1).min() > tolerance:
            inner.append(np.asarray(anchor))
    return _consecutive(np.array([edge[0], *inner, edge[1]]))


def _sides(edges: Floats, outlines: Sequence[BaseGeometry], least_offset: float) -> Integers:
    """Number (from 1) of the outline on the left and on the right of each edge, 0 outside, (n_edges, 2)."""
    along = edges[:, 1] - edges[:, 0]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    left = np.column_stack([-along[:, 1], along[:, 0]]) / length * np.maximum(1e-6 * length, least_offset)
    middle = edges.mean(axis=1)
    sides = np.zeros((len(edges), 2), dtype=np.int64)
    for number, outline in enumerate(outlines, start=1):
        for column, points in enumerate((middle + left, middle - left)):
            sides[shapely.contains_xy(outline, *points.T), column] = number
    return sides


def _filled(graph: Graph, size: SizeField) -> tuple[MeshArrays, Integers]:
    """Netgen's triangles, and its boundary segments as rows (point, point, edge of the graph)."""
    geometry = SplineGeometry()
    numbers = [geometry.AppendPoint(float(x), float(y)) for x, y in graph.points]
    for edge, (ends, sides) in enumerate(zip(graph.ends, graph.sides, strict=True)):
        corners = ["line", numbers[ends[0]], numbers[ends[1]]]
        geometry.Append(corners, leftdomain=int(sides[0]), rightdomain=int(sides[1]), bc=edge + 1)
    pyngcore.SetNumThreads(1)
    try:
        filled = geometry.GenerateMesh(mp=_parameters(size))
    except Exception as problem:
        raise MeshError(
            f"mesh.h: netgen cannot fill the bodies ({problem}); set a smaller mesh.h"
        ) from problem
    triangles, segments = filled.Elements2D().NumPy(), filled.Elements1D().NumPy()
    # Netgen's coordinates are a view of memory that goes with its mesh.
    points = filled.Coordinates()[:, :2].copy()
    cells = triangles["nodes"][:, :3].astype(np.int64) - 1
    mesh = MeshArrays(points, cells, triangles["index"].astype(np.int64) - 1)
    rows = np.column_stack([segments["nodes"][:, :2], segments["index"]]).astype(np.int64) - 1
    return mesh, rows


def _parameters(size: SizeField) -> netgen.MeshingParameters:
    """Largest size, growth, and lines over the boxes along which their sizes are held."""
    parameters = netgen.MeshingParameters(maxh=ASKED * size.coarse, grading=size.grading)
    for feature in size.features:
        _restrict_around(feature, size, parameters)
    if size.is_uniform:
        return parameters
    for box in size.boxes:
        asked = ASKED * box.size
        (left, bottom), (right, top) = box.lower - asked, box.upper + asked
        for y in np.linspace(bottom, top, int(np.ceil((top - bottom) / asked)) + 1):
            parameters.RestrictHLine(netgen.Pnt(left, y, 0.0), netgen.Pnt(right, y, 0.0), asked)
    return parameters


def _restrict_around(feature: Feature, size: SizeField, parameters: netgen.MeshingParameters) -> None:
    """Hold the size on rings about the feature: by itself netgen lets it grow faster than its own grading."""
    away, wanted = 0.0, feature.size
    while wanted < size.coarse:
        for radius in (feature.radius - away, feature.radius + away):
            angle = np.arange(0.0, 2.0 * np.pi, wanted / max(radius, wanted))
            around = feature.centre + radius * np.column_stack([np.cos(angle), np.sin(angle)])
            for x, y in around if radius >= 0.0 else ():
                parameters.RestrictH(x=float(x), y=float(y), z=0.0, h=ASKED * wanted)
        away += wanted
        wanted = feature.size + size.grading * away


def _onto_circles(points: Floats, segments: Integers, graph: Graph, circles: Sequence[Circle]) -> Floats:
    """The points with those between the ends of a circle's chord moved out onto the circle."""
    moved = points.copy()
    for circle in circles:
        centre = np.asarray(circle.centre)
        corners = graph.points[graph.ends] - centre
        off_circle = np.abs(np.linalg.norm(corners, axis=2) / circle.radius - 1.0).max(axis=1)
        reach = np.linalg.norm(corners.mean(axis=1), axis=1) / circle.radius
        # The middle tells a chord of the circle's polygon from a straight edge across the disc.
        is_chord = (off_circle < 1e-8) & (reach > np.cos(1.01 * np.pi / CHORDS_OF_CIRCLE))
        nodes = np.unique(segments[is_chord[segments[:, 2]], :2])
        offset = points[nodes] - centre
        moved[nodes] = centre + offset * (circle.radius / np.linalg.norm(offset, axis=1))[:, None]
    return moved
