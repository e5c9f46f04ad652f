"""The crack path as a polyline finer than a cell, traced from a phase field on points, and its metrics.

The points are rasterised near the crack, thresholded and thinned to a skeleton; the skeleton's path is then
moved to the ridge, the line where the phase field is least along its normal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from cases.mesh_arrays import signed_areas

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from cases import Case
    from numerics.fields import Fields

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Field = Callable[[Array], Array]

PIXELS_PER_CELL = 4
SUPPORT = 1.5  # farther from every point than a cell and this many of its spacings is outside the bodies
FLAT = 1e-9  # a triangle of less than this share of a cell's square is none
CELLS_OF_REACH = 4.0  # within so many cells of a notch's end a path begins at the end
# By order, in units of l0: nearer than this to a notch of history c may be below the threshold by the notch itself, at
# order 2 up to 2.4 without a load and 3.1 at the peak, at order 4 for γ_θ up to about 6
WIDTH_OF_HISTORY = {2: 4.0, 4: 5.0}
TORN_WIDTH_OF_HISTORY = {2: 2.0, 4: 0.0}  # the same below the threshold of running cracks; at order 4 cells alone tell
EQUAL_SHARE = 0.2  # of the largest piece's area: pieces above it are rivals, the one nearest the start wins


@dataclass(frozen=True, eq=False)
class CrackPath:
    """A traced crack.

    points : (k, 2) polyline from the start of the crack to its tip, k = 0 where there is no crack.
    branches : side branches of the skeleton longer than the crack is wide and two cells.
    endpoints : free ends of the crack, 2 without branches, 0 where there is no crack.
    """

    points: Array
    branches: int
    endpoints: int


NO_CRACK = CrackPath(np.empty((0, 2)), 0, 0)


def crack_path(fields: Fields, case: Case) -> Array:
    """(k, 2) crack path of a state in reference coordinates, from the notch end where there is one notch."""
    return trace_case_crack(fields.reference, fields.phase_field, case).points


def trace_case_crack(points: ArrayLike, phase_field: ArrayLike, case: Case) -> CrackPath:
    """``trace_crack`` with the cell size, the start where there is one notch, and the notches of history.

    Of several notches of history the crack is that from the end of one of them, the longest.
    """
    notches = case.all_notches
    drawn = [notch for notch in notches if notch.kind == "history"]
    if not drawn:
        start = np.asarray(notches[0].end, dtype=float) if len(notches) == 1 else None
        return trace_crack(points, phase_field, case.mesh.h, start=start)
    lines = np.array([[notch.start, notch.end] for notch in drawn], dtype=float)
    reach = reach_of_history(case, lines)
    found = [trace_crack(points, phase_field, case.mesh.h, start=end, notch=lines, reach=reach) for end in lines[:, 1]]
    return max(zip(found, lines[:, 1], strict=True), key=lambda one: _rank(one[0], one[1]))[0]


def _rank(crack: CrackPath, start: Array) -> tuple[bool, float]:
    """Whether a crack begins at its start, and its length."""
    return len(crack.points) > 0 and bool((crack.points[0] == start).all()), path_length(crack.points)


def reach_of_history(case: Case, notches: Array, widths: dict[int, float] = WIDTH_OF_HISTORY) -> float:
    """How far from notches of history (n, 2, 2) the phase field is taken for their own [length].

    widths : in units of l0, by the order of the phase field.
    """
    bodies = list(case.bodies.values())
    broken = {bodies[number].material for number in case.inside(notches.reshape(-1, 2)) if number >= 0}
    fractures = [case.materials[name].fracture for name in broken]
    of_field = max((widths[f.order] * f.length_scale for f in fractures if f), default=0.0)
    return max(CELLS_OF_REACH * case.mesh.h, of_field)


def trace_crack(
    points: ArrayLike,
    phase_field: ArrayLike,
    h: float,
    threshold: float = 0.5,
    start: ArrayLike | None = None,
    notch: ArrayLike | None = None,
    reach: float | None = None,
) -> CrackPath:
    """Trace the crack of a phase field (1 intact, 0 broken) known on scattered points.

    points : (n, 2), of any arrangement and density; rows with NaN are left out. phase_field : (n,).
    h : cell size where the crack runs; a quarter of it is the pixel, a half the spacing of the polyline.
    threshold : broken where phase_field is below it; the largest connected piece is traced, or of the large
        ones the nearest to the start.
    start : (2,) point where the crack starts, the end of a notch: the path begins exactly there when it
        passes within ``reach`` (four cells if not given). Without it the path starts at its end of smaller x
        (smaller y for equal x).
    notch : (2, 2) mouth and end of a notch that is itself part of the phase field, or (n, 2, 2) of several, which are not
        traced; what does not leave them by more than ``reach`` is no crack.

    The tip is where the field along the ridge has risen half-way from the crack's median to the threshold. A
    crack that runs through a body ends with its outermost points, up to a cell short of the edge. Of a
    branched crack the longest path is returned. A broken spot no longer than it is wide counts as no crack.
    """
    start = None if start is None else np.asarray(start, dtype=float)
    reach = CELLS_OF_REACH * h if reach is None else reach
    found = _skeleton_of(points, phase_field, h, threshold, start, notch, reach)
    if found is None:
        return NO_CRACK
    skeleton, field = found
    path = skeleton.longest_path(start, reach)
    half_width = float(np.median(skeleton.half_width[path]))
    if path_length(skeleton.nodes[path]) < 2.0 * half_width:
        return NO_CRACK
    branches = skeleton.side_branches(path, half_width + 2.0 * h)
    core = skeleton.nodes[_without_hooks(path, skeleton.half_width[path])]
    polyline = _refine(core, field, h, half_width, threshold)
    polyline = _begin_at(polyline, start, reach)
    if len(polyline) < 2 or (notch is not None and _near(polyline, notch, reach).all()):
        return NO_CRACK
    return CrackPath(polyline, branches, 2 + branches)


def trace_tree(
    points: ArrayLike,
    phase_field: ArrayLike,
    h: float,
    threshold: float,
    start: ArrayLike | None,
    notch: ArrayLike | None,
    shortest: float,
    reach: float | None = None,
) -> list[Array]:
    """Polylines (k, 2) from the start of a branched crack to each of its ends along its skeleton, the longest first.

    Arguments as for ``trace_crack``; branches that leave the others by less than ``shortest`` half widths are bulges.
    """
    start = None if start is None else np.asarray(start, dtype=float)
    reach = CELLS_OF_REACH * h if reach is None else reach
    found = _skeleton_of(points, phase_field, h, threshold, start, notch, reach)
    if found is None:
        return []
    skeleton, _ = found
    path = skeleton.longest_path(start, reach)
    if path_length(skeleton.nodes[path]) < 2.0 * h:
        return []
    least = shortest * float(np.median(skeleton.half_width[path]))
    ways = [path, *skeleton.ways_to_other_ends(path, least)]
    return [_begin_at(_smooth(skeleton.nodes[way]), start, reach) for way in ways]


def _skeleton_of(
    points: ArrayLike,
    phase_field: ArrayLike,
    h: float,
    threshold: float,
    start: Array | None,
    notch: ArrayLike | None,
    reach: float,
) -> tuple[_Skeleton, Field] | None:
    """Skeleton of the crack without its notch, and the phase field as a function; None where nothing is broken."""
    points, phase_field = _usable(points, phase_field)
    broken = phase_field < threshold
    if not broken.any():
        return None
    field, raster = _rasterise(points, phase_field, broken, h)
    mask = raster.values < threshold
    if notch is not None:
        mask &= ~_near(raster.positions(), notch, reach, beside=True).reshape(mask.shape)
    mask = _main_piece(mask, raster, start)
    return (_Skeleton(mask, raster), field) if mask.any() else None


def _usable(points: ArrayLike, phase_field: ArrayLike) -> tuple[Array, Array]:
    points, phase_field = np.asarray(points, dtype=float), np.asarray(phase_field, dtype=float)
    finite = np.isfinite(points).all(axis=1) & np.isfinite(phase_field)
    return points[finite], phase_field[finite]


# --- raster ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Raster:
    origin: Array
    pixel: float
    values: Array  # (nx, ny), NaN where nothing is known or the crack is far

    def positions(self, pixels: NDArray[np.int64] | None = None) -> Array:
        """Centres of the given pixels (n, 2), of all of them without."""
        if pixels is None:
            pixels = np.indices(self.values.shape).reshape(2, -1).T
        return self.origin + self.pixel * pixels


def _rasterise(points: Array, phase_field: Array, broken: Mask, h: float) -> tuple[Field, _Raster]:
    """The field as a function of position, and its raster, both only in boxes around the broken points."""
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    box = max(3.0 * h, 1.5 * float(_spacing(tree, points[broken]).max()))
    pixel = h / PIXELS_PER_CELL
    origin = points[broken].min(axis=0) - 2.0 * box
    shape = np.ceil((points[broken].max(axis=0) + 2.0 * box - origin) / pixel).astype(int) + 1
    near = _boxes_near(points[broken], origin, box, shape * pixel)

    kept = _in_boxes(points, near, origin, box)
    field = _interpolation(points[kept], phase_field[kept], h)
    raster = _Raster(origin, pixel, np.full(tuple(shape), np.nan))
    positions = raster.positions()
    inside = np.flatnonzero(_in_boxes(positions, near, origin, box))
    raster.values.ravel()[inside] = field(positions[inside])
    return field, raster


def _boxes_near(points: Array, origin: Array, box: float, extent: Array) -> Mask:
    """Boxes that hold one of the points, and the neighbours of these boxes."""
    from scipy import ndimage

    near = np.zeros(tuple(np.ceil(extent / box).astype(int) + 1), dtype=bool)
    i, j = ((points - origin) / box).astype(int).T
    near[i, j] = True
    return ndimage.binary_dilation(near, np.ones((3, 3), dtype=bool))


def _in_boxes(positions: Array, near: Mask, origin: Array, box: float) -> Mask:
    index = np.floor((positions - origin) / box).astype(int)
    valid = ((index >= 0) & (index < near.shape)).all(axis=1)
    inside = np.zeros(len(positions), dtype=bool)
    inside[valid] = near[index[valid, 0], index[valid, 1]]
    return inside


def _interpolation(points: Array, values: Array, h: float) -> Field:
    """Linear interpolation that is NaN outside the bodies: off the hull or far from any point."""
    from matplotlib.tri import LinearTriInterpolator, Triangulation
    from scipy.spatial import Delaunay, QhullError, cKDTree

    centre = points.mean(axis=0)  # for round-off
    centred = points - centre
    try:
        triangles = Delaunay(centred).simplices.astype(np.int64)
    except QhullError:  # too few points, or all on a line
        return lambda positions: np.full(len(positions), np.nan)
    x, y = centred.T
    flat = np.abs(signed_areas(centred, triangles)) < FLAT * h**2
    # scipy's interpolator solves a small system in each triangle, on all threads
    linear = LinearTriInterpolator(Triangulation(x, y, triangles, mask=flat), values)
    tree = cKDTree(points)
    support = np.maximum(SUPPORT * _spacing(tree, points), h)

    def field(positions: Array) -> Array:
        """Values (n,), NaN outside the bodies."""
        distance, nearest = tree.query(positions)
        inside = distance <= support[nearest]
        result = np.full(len(positions), np.nan)
        result[inside] = linear(*(positions[inside] - centre).T).filled(np.nan)
        return result

    return field


def _spacing(tree: cKDTree, points: Array) -> Array:
    """Spacing of the tree's points at some of them: the distance of the fourth neighbour."""
    distance, _ = tree.query(points, k=[min(5, tree.n)])
    return np.asarray(distance)[:, 0]


def _near(positions: Array, notches: ArrayLike, width: float, *, beside: bool = False) -> Mask:
    """Positions within a width of one of the notches (mouth, end); beside : and not past its end."""
    found = np.zeros(len(positions), dtype=bool)
    for mouth, end in np.asarray(notches, dtype=float).reshape(-1, 2, 2):
        axis = end - mouth
        along = (positions - mouth) @ axis / (axis @ axis)
        foot = mouth + np.clip(along, 0.0, 1.0)[:, None] * axis
        found |= (np.linalg.norm(positions - foot, axis=1) <= width) & ((along < 1.0) | (not beside))
    return found


def _main_piece(mask: Mask, raster: _Raster, start: Array | None) -> Mask:
    """The connected piece to trace; of equally large ones always the same."""
    from scipy import ndimage

    labels, count = ndimage.label(mask, np.ones((3, 3)))
    if count <= 1:
        return mask
    area = ndimage.sum_labels(mask, labels, np.arange(1, count + 1))
    if start is None:
        return labels == 1 + int(np.argmax(area > 0.95 * area.max()))  # labels run with x, then y
    rivals = 1 + np.flatnonzero(area >= EQUAL_SHARE * area.max())
    pieces = [raster.positions(np.argwhere(labels == label)) for label in rivals]
    distance = [np.linalg.norm(piece - start, axis=1).min() for piece in pieces]
    return labels == rivals[int(np.argmin(distance))]


# --- skeleton -------------------------------------------------------------------------------------


class _Skeleton:
    """The thinned mask as a graph of neighbouring pixels.

    nodes : (m, 2) positions of its pixels; half_width : (m,) distance from there to the rim of the mask.
    """

    def __init__(self, mask: Mask, raster: _Raster) -> None:
        from scipy import ndimage
        from scipy.sparse import csr_array
        from skimage.morphology import skeletonize  # only fields need it, and it is slow to import

        skeleton = skeletonize(np.pad(mask, 1))[1:-1, 1:-1]
        pixels = np.argwhere(skeleton)
        self.nodes = raster.positions(pixels)
        self.half_width = raster.pixel * ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1][skeleton]
        number = np.full((mask.shape[0] + 2, mask.shape[1] + 2), -1)
        number[pixels[:, 0] + 1, pixels[:, 1] + 1] = np.arange(len(pixels))
        rows, columns, lengths = [], [], []
        for step in ((1, 0), (0, 1), (1, 1), (1, -1)):
            neighbour = number[pixels[:, 0] + 1 + step[0], pixels[:, 1] + 1 + step[1]]
            linked = np.flatnonzero(neighbour >= 0)
            rows.append(linked)
            columns.append(neighbour[linked])
            lengths.append(np.full(len(linked), raster.pixel * np.hypot(*step)))
        edges = (np.concatenate(rows), np.concatenate(columns))
        self.graph = csr_array((np.concatenate(lengths), edges), shape=(len(pixels), len(pixels)))

    def _distances(self, sources: list[int]) -> tuple[Array, NDArray[np.int32]]:
        """Way from the nearest source to every node (-1: none), and the node before it on that way."""
        from scipy.sparse.csgraph import dijkstra

        distance, previous, _ = dijkstra(
            self.graph, directed=False, indices=sources, return_predecessors=True, min_only=True
        )
        return np.where(np.isfinite(distance), distance, -1.0), previous

    @staticmethod
    def _way_to(node: int, previous: NDArray[np.int32]) -> list[int]:
        way = [node]
        while previous[way[-1]] >= 0:
            way.append(int(previous[way[-1]]))
        return way[::-1]

    def longest_path(self, start: Array | None, reach: float) -> list[int]:
        """Nodes of the longest path, from the start if the skeleton comes within reach of it."""
        source = None
        if start is not None:
            distance = np.linalg.norm(self.nodes - start, axis=1)
            source = int(np.argmin(distance)) if distance.min() <= reach else None
        if source is None:
            # two sweeps find the longest path of a tree
            one = int(np.argmax(self._distances([0])[0]))
            other = int(np.argmax(self._distances([one])[0]))
            source = min((one, other), key=lambda node: tuple(self.nodes[node]))
        distance, previous = self._distances([source])
        return self._way_to(int(np.argmax(distance)), previous)

    def side_branches(self, path: list[int], shortest: float) -> int:
        """Number of branches that leave the path, or one another, by more than a shortest length."""
        known, count = path, 0
        while True:
            distance, previous = self._distances(known)
            node = int(np.argmax(distance))
            if distance[node] <= shortest:
                return count
            known, count = known + self._way_to(node, previous), count + 1

    def ways_to_other_ends(self, path: list[int], shortest: float) -> list[list[int]]:
        """Ways from the start of the path to the ends of the branches that leave it, or one another, by more."""
        _, from_start = self._distances([path[0]])
        known = path
        ends: list[int] = []
        while True:
            distance, previous = self._distances(known)
            node = int(np.argmax(distance))
            if distance[node] <= shortest:
                return [self._way_to(end, from_start) for end in ends]
            ends.append(node)
            known = known + self._way_to(node, previous)


def _without_hooks(path: list[int], half_width: Array) -> list[int]:
    """The path without its ends nearer to the rim: there a skeleton leaves the middle for a corner."""
    wide = np.flatnonzero(half_width >= 0.8 * np.median(half_width))
    return path[wide[0] : wide[-1] + 1]


# --- ridge ----------------------------------------------------------------------------------------


def _refine(path: Array, field: Field, h: float, half_width: float, threshold: float) -> Array:
    """Move the skeleton's path to the ridge of the field and end it at the crack's tips."""
    spacing = 0.5 * h
    length = path_length(path)
    window = max(1.5 * h, 0.5 * half_width)
    cut = min(half_width, length / 3.0)  # the skeleton's ends lean to the rim or stop short of the tip
    core = _shortened(resample(_smooth(resample(path, spacing)), spacing), cut, spacing)
    core = _smooth(_to_ridge(core, field, window, spacing))
    extension = int(np.ceil((cut + 3.0 * half_width + 2.0 * h) / spacing))
    line = _extended(core, extension, spacing, 2.0 * half_width)
    for _ in range(3):
        line = _smooth(_to_ridge(line, field, window, spacing))
    values = field(line)
    first, last = extension, len(line) - 1 - extension
    level = 0.5 * (float(np.nanmedian(values[first : last + 1])) + threshold)
    return resample(_between_tips(line, values, first, last, level), spacing)


def _shortened(line: Array, cut: float, spacing: float) -> Array:
    drop = min(int(cut / spacing), max(0, (len(line) - 3) // 2))
    return line[drop : len(line) - drop]


def _extended(line: Array, count: int, spacing: float, base: float) -> Array:
    """Carry both ends on straight, in the direction of the last piece of about a base length."""
    reach = min(len(line) - 1, max(3, int(base / spacing)))
    steps = spacing * np.arange(1, count + 1)[:, None]
    backward = _unit(line[0] - line[reach])
    forward = _unit(line[-1] - line[-1 - reach])
    return np.vstack([line[0] + steps[::-1] * backward, line, line[-1] + steps * forward])


def _to_ridge(line: Array, field: Field, window: float, spacing: float) -> Array:
    """Move each vertex along its normal to the vertex of a parabola fitted over plus and minus a window.

    The field has a cusp at the crack, which a symmetric window does not mind: its fit is centred when the
    window is.
    """
    # normals that turn from vertex to vertex would let neighbours drift apart
    normal = _normals(line, window / spacing)
    t = np.linspace(-window, window, 13)
    positions = line[:, None, :] + t[:, None] * normal[:, None, :]
    samples = field(positions.reshape(-1, 2)).reshape(len(line), len(t))
    known = np.isfinite(samples) & np.isfinite(samples[:, ::-1])
    c = np.where(known, samples, 0.0)
    n, t2, t4 = known.sum(axis=1), (known * t**2).sum(axis=1), (known * t**4).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (c * t).sum(axis=1) / t2
        curvature = (n * (c * t**2).sum(axis=1) - t2 * c.sum(axis=1)) / (n * t4 - t2**2)
        shift = -slope / (2.0 * curvature)
    reliable = (n >= 5) & (curvature > 0) & np.isfinite(shift)
    shift = np.where(reliable, np.clip(shift, -0.5 * window, 0.5 * window), 0.0)
    return line + shift[:, None] * normal


def _between_tips(line: Array, values: Array, first: int, last: int, level: float) -> Array:
    """The part of the line between the tips, where the field rises through a level (NaN counts as risen)."""
    inside = values <= level
    while first > 0 and inside[first - 1]:
        first -= 1
    while first < last and not inside[first]:
        first += 1
    while last < len(line) - 1 and inside[last + 1]:
        last += 1
    while last > first and not inside[last]:
        last -= 1
    ends = [_crossing(line, values, first, first - 1, level), _crossing(line, values, last, last + 1, level)]
    return np.vstack([ends[0], line[first : last + 1], ends[1]])


def _crossing(line: Array, values: Array, inner: int, outer: int, level: float) -> Array:
    if not 0 <= outer < len(line) or not values[outer] > values[inner]:
        return line[inner : inner + 1]
    share = (level - values[inner]) / (values[outer] - values[inner])
    return line[inner : inner + 1] + np.clip(share, 0.0, 1.0) * (line[outer] - line[inner])


def _begin_at(line: Array, start: Array | None, reach: float) -> Array:
    """Let the path begin at the start, without what lies behind it, when it passes within reach."""
    if start is None or len(line) < 2:
        return line
    distance = np.linalg.norm(line - start, axis=1)
    nearest = int(np.argmin(distance))
    if distance[nearest] > reach:
        return line
    rest = line[nearest:]
    ahead = rest[1:] if len(rest) > 1 and (rest[0] - start) @ (rest[1] - rest[0]) <= 0 else rest
    return np.vstack([start, ahead[np.linalg.norm(ahead - start, axis=1) > 0]])


def _normals(line: Array, vertices: float) -> Array:
    """Unit normals, smoothed over a number of vertices."""
    from scipy import ndimage

    tangent = ndimage.gaussian_filter1d(np.gradient(line, axis=0), vertices, axis=0, mode="nearest")
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), np.finfo(float).tiny)
    return np.column_stack([-tangent[:, 1], tangent[:, 0]])


def _smooth(line: Array) -> Array:
    from scipy.signal import savgol_filter  # a second to import, and only fields need it

    return savgol_filter(line, 7, 2, axis=0) if len(line) >= 7 else line


def _unit(vector: Array) -> Array:
    length = np.linalg.norm(vector)
    return vector / length if length > 0 else vector


# --- metrics of polylines -------------------------------------------------------------------------


def resample(line: Array, spacing: float) -> Array:
    """The polyline (k, 2) with vertices evenly spaced, at most ``spacing`` apart; both ends stay."""
    step = np.linalg.norm(np.diff(line, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(step)])
    if along[-1] == 0.0:
        return line[:1]
    even = np.linspace(0.0, along[-1], max(2, int(np.ceil(along[-1] / spacing)) + 1))
    return np.column_stack([np.interp(even, along, line[:, axis]) for axis in (0, 1)])


def path_length(line: Array) -> float:
    """Length of a polyline (k, 2); 0 when it is empty."""
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def tip_position(line: Array) -> Array:
    """(2,) last vertex of a polyline that is not empty."""
    return np.asarray(line, dtype=float)[-1]


def path_angle(line: Array) -> float:
    """Overall direction in degrees from the x axis, -180 to 180: the principal axis, from start to tip."""
    even = resample(line, path_length(line) / 400)
    axis = np.linalg.svd(even - even.mean(axis=0), full_matrices=False)[2][0]
    axis = axis if axis @ (line[-1] - line[0]) >= 0 else -axis
    return float(np.degrees(np.arctan2(axis[1], axis[0])))


def hausdorff(one: Array, other: Array) -> float:
    """Largest distance from any point of either polyline to the other one (shapely's is that from its vertices)."""
    return max(float(_distances_to(a, b).max()) for a, b in ((one, other), (other, one)))


def mean_distance(one: Array, other: Array) -> float:
    """Mean distance from the points of one polyline to the other one, averaged over both ways."""
    return 0.5 * sum(float(_distances_to(a, b).mean()) for a, b in ((one, other), (other, one)))


def _distances_to(line: Array, target: Array, samples: int = 1000) -> Array:
    """Distances from evenly spaced points of one polyline to the segments of another."""
    points = resample(line, path_length(line) / samples) if len(line) > 1 else line
    goal = shapely.LineString(target) if len(target) > 1 else shapely.Point(target[0])
    return shapely.distance(shapely.points(points), goal)  # type: ignore[no-any-return]
