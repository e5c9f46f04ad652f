"""How a crack ran: arrival of its tips along each branch, their speed, branching, and what it left in pieces.

All is read from one state: where the points are at first, and when each of them broke. This gives the place of a tip at
every time at once, as the furthest broken point of its branch (Borden et al. 2012, threshold c = 0.25).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from verify.metrics.crack_path import Array, resample, trace_tree

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

#: a branch is shorter than this many half widths of the crack: a bulge
SHORTEST = 4.0
#: cells that other tips have broken in a row before a tip comes by: it has met their crack
MET = 4.0
#: points nearer than this many of their spacings hold together
LINK = 1.5


@dataclass(frozen=True, eq=False)
class Branch:
    """The way of one tip from the start of the crack.

    points : (k, 2) evenly spaced [length]. arrival : (k,) when the tip came by, never falling [time].
    along : (k,) distance from the start [length]. forks : places in `points` where other branches leave this one.
    met : times at which the tip ran into the crack of another one, and went on where that began [time].
    """

    points: Array
    arrival: Array
    along: Array
    forks: tuple[int, ...]
    met: tuple[float, ...] = ()

    def position(self, times: ArrayLike) -> Array:
        """Distance of the tip from the start at times (n,), NaN before it sets out and after it came to its end."""
        times = np.asarray(times, dtype=float)
        last = np.searchsorted(self.arrival, times, side="right") - 1
        inside = (last >= 0) & (times <= self.arrival[-1])
        return np.where(inside, self.along[np.maximum(last, 0)], np.nan)

    def speed(self, interval: float, count: int = 5) -> tuple[Array, Array]:
        """Times (n,) and speed (n,): lines fitted to `count` positions in a row, `interval` apart.

        Those across a time at which the tip met another crack are left out: it did not run along that.
        """
        times = np.arange(self.arrival[0], self.arrival[-1], interval)
        position = self.position(times)
        if len(times) < count:
            return np.empty(0), np.empty(0)
        windows = np.lib.stride_tricks.sliding_window_view(position, count)
        centred = interval * (np.arange(count) - 0.5 * (count - 1))
        begin, end = times[: len(windows)], times[count - 1 :]
        runs = np.full(len(begin), True)
        for met in self.met:
            runs &= (end < met) | (met < begin)
        middle = times[count // 2 : len(times) - (count - 1) // 2]
        return middle[runs], (windows @ centred / (centred @ centred))[runs]


def branches(
    points: ArrayLike,
    phase_field: ArrayLike,
    broken_at: ArrayLike,
    h: float,
    start: ArrayLike | None = None,
    notch: ArrayLike | None = None,
    threshold: float = 0.25,
    reach: float | None = None,
) -> list[Branch]:
    """Ways of all tips, the longest first; none where nothing broke.

    points : (n, 2) reference positions. phase_field : (n,) at the end. broken_at : (n,) when it first fell below the
    threshold, NaN where it did not [time]. h, start, notch, reach : as for ``crack_path.trace_crack``.
    """
    points, broken_at = np.asarray(points, dtype=float), np.asarray(broken_at, dtype=float)
    broken = np.isfinite(broken_at)
    ways = trace_tree(points, phase_field, h, threshold, start, notch, SHORTEST, reach)
    if not ways or not broken.any():
        return []
    from scipy.spatial import cKDTree

    tree, when = cKDTree(points[broken]), broken_at[broken]
    lines = [resample(way, 0.5 * h) for way in ways]
    return [_branch(line, lines[:i] + lines[i + 1 :], tree, when, h) for i, line in enumerate(lines)]


def _branch(line: Array, others: list[Array], tree: cKDTree, when: Array, h: float) -> Branch:
    near = tree.query_ball_point(line, h)
    first = np.array([when[places].min() if places else np.nan for places in near])
    known = np.isfinite(first)
    line, first = line[known], first[known]
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    # a crack that sets out beside the start, as from the corner of a wide notch, does not wait for it to break
    beside = along < MET * h
    first[beside] = np.minimum.accumulate(first[::-1])[::-1][beside]
    forks = sorted({_parting(line, other, h) for other in others})
    arrival = np.maximum.accumulate(first)
    return Branch(line, arrival, along, tuple(forks), _times_met(first < arrival, arrival, along, MET * h))


def _times_met(by_others: NDArray, arrival: Array, along: Array, longest: float) -> tuple[float, ...]:
    """When the tip came to stretches longer than that which other tips had broken before."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], by_others, [False]]).astype(int)))
    stretches = edges.reshape(-1, 2)
    return tuple(float(arrival[a]) for a, b in stretches if along[b - 1] - along[a] > longest)


def _parting(line: Array, other: Array, h: float) -> int:
    """Last place of a line that the other one shares with it."""
    from scipy.spatial import cKDTree

    distance, _ = cKDTree(other).query(line)
    apart = np.flatnonzero(distance > h)
    return int(max(apart[0] - 1, 0)) if len(apart) else len(line) - 1


def branching_time(ways: list[Branch]) -> float:
    """When the first tip divided, NaN where none did."""
    times = [way.arrival[fork] for way in ways for fork in way.forks]
    return float(min(times, default=np.nan))


def branching_angle(ways: list[Branch], length: float, h: float) -> float:
    """Angle in degrees between the two longest branches over a length behind the place where they part, NaN for one.

    h : nearer than this they are one [length].
    """
    if len(ways) < 2:
        return float("nan")
    one, other = ways[:2]
    ax, ay = _direction_behind(one, _parting(one.points, other.points, h), length)
    bx, by = _direction_behind(other, _parting(other.points, one.points, h), length)
    return float(abs(np.degrees(np.arctan2(ax * by - ay * bx, ax * bx + ay * by))))


def _direction_behind(way: Branch, place: int, length: float) -> Array:
    """Vector (2,) from a place of a branch to that a length further on, to its end where it is shorter."""
    end = min(int(np.searchsorted(way.along, way.along[place] + length)), len(way.along) - 1)
    return way.points[end] - way.points[place]  # type: ignore[no-any-return]


def fragments(
    points: ArrayLike, volume: ArrayLike, thickness: float, body: ArrayLike, broken: ArrayLike, least_share: float
) -> int:
    """Number of connected pieces of unbroken points larger than a share of their body's volume.

    points : (n, 2) reference positions. volume : (n,) area times thickness. broken : (n,) mask.
    """
    points, volume, body = np.asarray(points, dtype=float), np.asarray(volume), np.asarray(body)
    whole = ~np.asarray(broken, dtype=bool)
    return sum(
        _pieces(
            points[whole & (body == b)], volume[whole & (body == b)], thickness, least_share * volume[body == b].sum()
        )
        for b in np.unique(body)
    )


def _pieces(points: Array, volume: NDArray, thickness: float, smallest: float) -> int:
    if not len(points):
        return 0
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    reach = LINK * np.sqrt(volume.max() / thickness)
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    links = coo_array((np.ones(len(pairs), bool), pairs.T), shape=(len(points),) * 2)
    count, label = connected_components(links, directed=False)
    return int((np.bincount(label, weights=volume, minlength=count) >= smallest).sum())


def enclosed(points: ArrayLike, broken: ArrayLike, h: float, least: float) -> int:
    """Number of unbroken pieces of at least an area that cracks close off from the edges of the body.

    Each was closed by a branch that ran into another one's crack. points : (n, 2). broken : (n,) mask. h : a box of
    this size with a broken point is part of a crack [length].
    """
    from scipy import ndimage

    where = np.asarray(points, dtype=float)[np.asarray(broken, dtype=bool)]
    if not len(where):
        return 0
    box = np.floor((where - where.min(axis=0)) / h).astype(int) + 1
    open_boxes = np.full(box.max(axis=0) + 2, True)
    open_boxes[tuple(box.T)] = False
    piece, _ = ndimage.label(open_boxes)
    area = h * h * np.bincount(piece.ravel())
    return int((np.delete(area, [0, piece[0, 0]]) >= least).sum())


def asymmetry(points: ArrayLike, values: ArrayLike, axis: int, middle: float) -> float:
    """Largest difference between the values at points and at their mirror images.

    points : (n, 2). axis : 0 where x, 1 where y is mirrored about `middle` [length]. The image's value is that of the
    nearest point.
    """
    from scipy.spatial import cKDTree

    points, values = np.asarray(points, dtype=float), np.asarray(values, dtype=float)
    image = points.copy()
    image[:, axis] = 2.0 * middle - image[:, axis]
    _, nearest = cKDTree(points).query(image)
    return float(np.abs(values - values[nearest]).max())
