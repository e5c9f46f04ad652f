"""Load-displacement curves: validating, characteristic values, and the comparison of two curves.

A curve is the force F that does work on the load parameter u over u, in load order. Nothing here knows units: both
curves of a comparison must be in the same ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from cases.errors import UserError

Array = NDArray[np.float64]

REVERSAL_TOLERANCE = 0.01  # share of the range that digitising noise may step back without being a cycle
BROKEN_FRACTION = 0.05  # a curve that ends below this share of its peak has lost its load for good
NEGLIGIBLE_FORCE = 1e-3  # share of the peak under which a relative error says nothing
STIFFNESS_SHARE = 0.1  # share of the displacement at peak over which the initial stiffness is fitted
ROUND_OFF = 1e-9  # share of the largest force that is none
MINIMUM_SHARE = 0.9  # share of the reference's loaded range that a comparison must cover


class CurveError(UserError):
    """A curve that cannot be used; the message is one sentence: source, what is wrong, remedy."""


def reversal(values: Array) -> float:
    """Largest step back against the main direction, as a share of the range of ``values`` (0: monotonic)."""
    span = float(np.ptp(values))
    if span == 0.0:
        return 0.0
    fall = float(np.max(np.maximum.accumulate(values) - values))
    rise = float(np.max(values - np.minimum.accumulate(values)))
    return min(fall, rise) / span


@dataclass(frozen=True, eq=False)
class Curve:
    """A validated load-displacement curve.

    u : (n,) load parameter in load order; F : (n,) force conjugate to u; source : what to call it in messages;
    solved : by a solver of ours, which names its columns right.

    Raises CurveError for fewer than two points, unequal lengths, NaN or infinity, a u that never moves, and
    swapped columns. Columns count as swapped when u steps back by more than ``REVERSAL_TOLERANCE`` of its
    range although F does not: a specimen cannot be unloaded at an ever growing force, whereas the force of a
    monotonic test does fall after its peak. A curve without a falling branch or with cycles in both columns
    cannot be judged on its own; ``compare_curves`` catches it by its stiffness.
    """

    u: Array
    F: Array
    source: str = "curve"
    solved: bool = False

    def __post_init__(self) -> None:
        for name in ("u", "F"):
            values = np.array(getattr(self, name), dtype=float).ravel()
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        _require_values(self)
        if not self.solved:
            _require_columns_in_order(self)

    @classmethod
    def from_history(cls, history: pd.DataFrame, source: str = "history") -> Curve:
        """The curve of a run's history table (columns u and F); a cell that is no number counts as NaN."""
        missing = [name for name in ("u", "F") if name not in history.columns]
        if missing:
            present = ", ".join(map(str, history.columns)) or "none"
            raise CurveError(f"{source}: has no column {' or '.join(missing)} (it has {present}); add or name it")
        u, F = (pd.to_numeric(history[name], errors="coerce").to_numpy(dtype=float) for name in ("u", "F"))
        counts = pd.to_numeric(history.get("staggered", pd.Series(dtype=float)), errors="coerce")
        return cls(u, F, source, solved=bool((counts > 0).any()))

    @property
    def cyclic(self) -> bool:
        """Whether the load parameter turns back by more than digitising noise."""
        return reversal(self.u) > REVERSAL_TOLERANCE

    @property
    def broken(self) -> bool:
        """Whether a monotonic curve ends having lost its load (below ``BROKEN_FRACTION`` of the peak).

        Never true of a cyclic one, whose force also vanishes on unloading.
        """
        return not self.cyclic and abs(self.F[-1]) <= BROKEN_FRACTION * abs(peak_force(self))

    @property
    def direction(self) -> float:
        """+1 where u grows, -1 where it falls (over the whole curve; of the first branch when cyclic)."""
        step = self.u[first_branch_end(self)] - self.u[0]
        return 1.0 if step >= 0 else -1.0

    def until(self, u_max: float) -> Curve:
        """The part of a monotonic curve up to ``u_max``, which becomes its last point by interpolation."""
        if self.cyclic:
            raise CurveError(f"{self.source}: cannot be cut at u = {u_max:g}, u turns back; leave out u_max")
        along = self.direction * _levelled(self)
        end = self.direction * u_max
        if along[-1] <= end:
            return self
        before = along < end
        F_end = float(np.interp(end, along, self.F))
        return Curve(np.append(self.u[before], u_max), np.append(self.F[before], F_end), self.source)


def _require_values(curve: Curve) -> None:
    u, F, source = curve.u, curve.F, curve.source
    if len(u) != len(F):
        raise CurveError(f"{source}: has {len(u)} values of u but {len(F)} of F; give as many of each")
    if len(u) < 2:
        raise CurveError(f"{source}: has {len(u)} point(s); a curve needs at least two")
    bad = ~(np.isfinite(u) & np.isfinite(F))
    if bad.any():
        first = int(np.argmax(bad)) + 1
        raise CurveError(f"{source}: point {first} is NaN or infinite ({bad.sum()} in all); mend or drop it")
    if np.ptp(u) == 0.0:
        raise CurveError(f"{source}: u never moves from {u[0]:g}; give the load parameter as u")


def _require_columns_in_order(curve: Curve) -> None:
    if reversal(curve.u) > REVERSAL_TOLERANCE and reversal(curve.F) <= REVERSAL_TOLERANCE:
        raise CurveError(
            f"{curve.source}: u turns back although F never does, so the columns look swapped; "
            "name the displacement column u and the force column F"
        )


# --- characteristic values ------------------------------------------------------------------------


def preloaded(curve: Curve) -> bool:
    """Whether a solver's curve begins under a force, of what acts from the first state on."""
    return curve.solved and abs(float(curve.F[0])) > ROUND_OFF * float(np.abs(curve.F).max())


def recoverable_energy(curve: Curve) -> float:
    """Elastic energy at the end of the curve, F u / 2: the material unloads along a secant to the origin."""
    return 0.5 * float(curve.F[-1] * curve.u[-1])


def loading_sign(curve: Curve) -> float:
    """Sign of F under which the specimen is broken: +1 or -1.

    The sign under which more work was dissipated; where (nearly) nothing was, the one under which more work
    was exchanged. So a crack that opens in tension and closes in compression keeps its tensile peak although
    the compressive force may be the larger one. Of a solver's curve, whose F does work on u, the force of what acts
    from the first state on gives work back while the load takes it off, and dissipates nothing.
    """
    dissipated, exchanged = {}, {}
    for sign in (1.0, -1.0):
        part = np.maximum(sign * curve.F, 0.0)
        recoverable = 0.5 * part[-1] * abs(curve.u[-1])
        given = float(np.trapezoid(part, curve.u))
        dissipated[sign] = (sign * given if preloaded(curve) else abs(given)) - recoverable
        exchanged[sign] = float(np.trapezoid(part, path_coordinate(curve)))
    decisive = max(dissipated.values()) > 0.01 * sum(exchanged.values())
    work = dissipated if decisive else exchanged
    # a percent does not decide: a body bent to and fro has its peak on the positive side
    return 1.0 if work[1.0] >= 0.99 * work[-1.0] else -1.0


def peak_index(curve: Curve) -> int:
    """Index of the peak: the first of the largest forces in the sense of ``loading_sign``."""
    return int(np.argmax(loading_sign(curve) * curve.F))


def peak_force(curve: Curve) -> float:
    """Largest force, with its sign: negative where the specimen is broken by negative forces."""
    return float(curve.F[peak_index(curve)])


def displacement_at_peak(curve: Curve) -> float:
    """Load parameter of the point with the peak force, not interpolated between points.

    On a plateau this is its first highest point, and small differences of force move it a long way: such
    curves are better compared as curves.
    """
    return float(curve.u[peak_index(curve)])


def initial_stiffness(curve: Curve) -> float:
    """Slope of the least-squares line through the origin over the first tenth of the way to the peak.

    The first loading branch is sampled evenly over that tenth (linearly between its points), so that uneven
    or large increments do not change what is fitted. Of a solver's curve the force at u = 0, of what acts from the first
    state on, takes the origin's place.
    """
    end = max(1, min(peak_index(curve), first_branch_end(curve)))
    along = curve.direction * _levelled(curve)[: end + 1]
    u = np.linspace(along[0], along[0] + STIFFNESS_SHARE * (along[-1] - along[0]), 21)
    F = np.interp(u, along, curve.F[: end + 1]) - (curve.F[0] if preloaded(curve) and curve.u[0] == 0.0 else 0.0)
    u = curve.direction * u
    return float(u @ F / (u @ u)) if u @ u > 0 else float("nan")


def closed_stiffness(curve: Curve) -> float:
    """Slope of the least-squares line through the points of the first reversed branch beyond the origin.

    Once loaded one way, a specimen is pushed the other way: cracks that close carry the force as before.

    Raises CurveError for a curve that never goes beyond the origin.
    """
    beyond = -curve.direction * curve.u > 0.0
    if not beyond.any():
        raise CurveError(f"{curve.source}: never goes to the other side of u = 0; close the crack in load.path")
    start = int(np.argmax(beyond))
    turned = np.diff(-curve.direction * curve.u[start:]) <= 0.0
    end = start + (int(np.argmax(turned)) if turned.any() else len(turned)) + 1
    u, F = curve.u[start:end], curve.F[start:end]
    return float(np.polyfit(u, F, 1)[0]) if len(u) > 1 else float(F[0] / u[0])


# --- coordinates along a curve --------------------------------------------------------------------


def path_coordinate(curve: Curve) -> Array:
    """Path travelled by the load parameter, the running sum of abs(du), starting at 0."""
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(curve.u)))])


def first_branch_end(curve: Curve) -> int:
    """Index of the last point before u first turns back by more than noise."""
    return _branch_end(curve.u, REVERSAL_TOLERANCE * float(np.ptp(curve.u)))


def _branch_end(u: Array, noise: float) -> int:
    moved = np.abs(u - u[0]) > noise
    along = np.sign(u[int(np.argmax(moved))] - u[0]) * u
    reached = np.maximum.accumulate(along)
    back = reached - along > noise
    if not back.any():
        return len(along) - 1
    return int(np.argmax(along[: int(np.argmax(back))]))


def _levelled(curve: Curve) -> Array:
    """u without the small steps back of digitising noise, in the direction of loading, for interpolation."""
    return curve.direction * np.maximum.accumulate(curve.direction * curve.u)


def _loaded_length(curve: Curve, along: Array) -> float:
    """Coordinate of the last point that still carries load; a tail of nothing need not be covered."""
    carries = np.abs(curve.F) > BROKEN_FRACTION * abs(peak_force(curve))
    last = len(along) - 1 - int(np.argmax(carries[::-1]))
    return float(along[min(last + 1, len(along) - 1)])


# --- comparison -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class CurveComparison:
    """How far a curve is from its reference, over their common range.

    errors : table with columns coordinate (u in loading direction, or the path travelled when cyclic), u,
        F_reference, F, relative_error_percent (Eq. 4.19; where the reference is below ``NEGLIGIBLE_FORCE`` of
        its peak NaN, or, if the other curve still is above ``BROKEN_FRACTION`` of it, over that force) and
        peak_error_percent (difference over the reference's peak force).
    l2_percent_* : root of the mean over u of the squared relative error, in percent; before the peak means up
        to the smaller of the two displacements at peak. NaN where the range holds no point.
    l2_peak_percent_* : the same of peak_error_percent, which stays finite where a converged scheme drops
        vertically.
    coverage : share of the reference's loaded range that was compared.
    """

    errors: pd.DataFrame
    cyclic: bool
    coverage: float
    l2_percent_before_peak: float
    l2_percent_after_peak: float
    l2_percent_whole: float
    l2_peak_percent_before_peak: float
    l2_peak_percent_after_peak: float
    l2_peak_percent_whole: float
    max_peak_percent: float


def compare_curves(
    reference: Curve, other: Curve, n: int = 501, minimum_share: float = MINIMUM_SHARE
) -> CurveComparison:
    """Compare ``other`` with ``reference`` on ``n`` evenly spaced displacements (Eq. 4.19 of the thesis).

    Where u turns back, both are compared over the path travelled instead, as far as they turn at the same places: from
    there on one would be held against another state of loading. A curve that ended broken is carried on with its last
    force as long as the other one is loaded, so that breaking too early or too late is an error and not a missing piece.

    Raises CurveError when a curve that is not broken leaves less than ``minimum_share`` of the reference's
    loaded range to compare (truncated, or on another path), when the curves are loaded in opposite directions, and when
    the stiffness of ``other`` is about the inverse of the reference's (swapped columns).
    """
    _require_same_sense(reference, other)
    cyclic = reference.cyclic or other.cyclic
    along_reference, along_other = (_coordinate(curve, cyclic) for curve in (reference, other))
    parting = _parting(reference, other) if cyclic else None
    start, end, coverage = _common_range(
        reference, other, along_reference, along_other, parting.after if parting else np.inf
    )
    if end <= start or coverage < minimum_share:
        covers = f"{max(coverage, 0.0):.1%} of the loaded range of {reference.source}"
        needed = f"(at least {minimum_share:.0%} are needed)"
        if parting is not None:
            raise CurveError(
                f"{other.source}: has the path of loading of {reference.source} only up to u = {parting.u:g}, which is "
                f"{covers} {needed}, so that they cannot be compared; load both alike"
            )
        raise CurveError(f"{other.source}: covers only {covers} {needed}; finish the run or give the whole curve")
    grid = np.linspace(start, end, n)
    errors = _error_table(reference, other, along_reference, along_other, grid)
    split = min(along_reference[peak_index(reference)], along_other[peak_index(other)])
    return _summarise(errors, split, cyclic, coverage)


def max_error_until(reference: Curve, other: Curve, u_max: float, n: int = 501) -> float:
    """Largest abs(F - F_reference) up to ``u_max``, as a fraction of the peak of the whole reference.

    Raises CurveError where either curve does not reach ``u_max`` and is not broken before.
    """
    span = reference.direction * (u_max - reference.u[0])
    reached = float(np.max(reference.direction * (reference.u - reference.u[0])))
    if span <= 0 or (reached < (1 - 1e-9) * span and not reference.broken):
        raise CurveError(f"{reference.source}: does not reach u = {u_max:g}; give a u_max within the curve")
    comparison = compare_curves(reference.until(u_max), other.until(u_max), n)
    difference = comparison.errors["F"] - comparison.errors["F_reference"]
    return float(np.max(np.abs(difference)) / abs(peak_force(reference)))


def _require_same_sense(reference: Curve, other: Curve) -> None:
    if peak_force(reference) == 0.0:
        raise CurveError(f"{reference.source}: carries no force, so it is no reference; give another curve")
    if reference.direction != other.direction:
        raise CurveError(
            f"{other.source}: u runs the opposite way to {reference.source}; use the same sign of u in both"
        )
    stiffness, expected = initial_stiffness(other), initial_stiffness(reference)
    if not (stiffness * expected > 0):
        return
    ratio, inverse = abs(np.log(stiffness / expected)), abs(np.log(stiffness * expected))
    if ratio > np.log(3.0) and inverse < np.log(2.0):
        raise CurveError(
            f"{other.source}: its initial stiffness is the inverse of that of {reference.source}, "
            "so the columns look swapped; name the displacement column u and the force column F"
        )


def _coordinate(curve: Curve, cyclic: bool) -> Array:
    return path_coordinate(curve) if cyclic else curve.direction * _levelled(curve)


class _Stop(NamedTuple):
    """Where a branch of a path of loading ends: at a load parameter, after so much of the path; whether u turns there."""

    u: float
    after: float
    turns: bool


def _parting(one: Curve, other: Curve) -> _Stop | None:
    """Where one of two curves turns back and the other one goes on; None where they turn alike to the shorter's end."""
    noise = REVERSAL_TOLERANCE * max(np.ptp(one.u), np.ptp(other.u))
    direction = one.direction
    for stops in zip(_stops(one), _stops(other), strict=False):
        first, last = sorted(stops, key=lambda stop: direction * stop.u)
        if abs(last.u - first.u) > noise:
            return first if first.turns else None
        direction = -direction
    return None


def _stops(curve: Curve) -> list[_Stop]:
    """Ends of the branches between which u turns back by more than noise."""
    noise, along = REVERSAL_TOLERANCE * float(np.ptp(curve.u)), path_coordinate(curve)
    last, ends = len(curve.u) - 1, [_branch_end(curve.u, noise)]
    while ends[-1] < last and np.ptp(curve.u[ends[-1] :]) > noise:
        ends.append(ends[-1] + _branch_end(curve.u[ends[-1] :], noise))
    return [_Stop(float(curve.u[end]), float(along[end]), end < last) for end in ends]


def _common_range(
    reference: Curve, other: Curve, along_reference: Array, along_other: Array, parting: float
) -> tuple[float, float, float]:
    """Start and end of the comparison and the share of the reference's loaded range that it covers."""
    start = max(along_reference[0], along_other[0])
    end = min(along_reference[-1], along_other[-1])
    if other.broken:
        end = max(end, _loaded_length(reference, along_reference))
    if reference.broken:
        end = max(end, _loaded_length(other, along_other))
    end = min(end, parting)
    loaded = _loaded_length(reference, along_reference)
    coverage = (min(end, loaded) - start) / (loaded - along_reference[0])
    return float(start), float(end), float(coverage)


def _error_table(
    reference: Curve, other: Curve, along_reference: Array, along_other: Array, grid: Array
) -> pd.DataFrame:
    F_reference = np.interp(grid, along_reference, reference.F)
    F = np.interp(grid, along_other, other.F)
    peak = abs(peak_force(reference))
    longer = reference if along_reference[-1] >= along_other[-1] else other
    longest = along_reference if longer is reference else along_other
    return pd.DataFrame(
        {
            "coordinate": grid,
            "u": np.interp(grid, longest, longer.u),
            "F_reference": F_reference,
            "F": F,
            "relative_error_percent": _relative_error_percent(F_reference, F, peak),
            "peak_error_percent": 100.0 * (F - F_reference) / peak,
        }
    )


def _relative_error_percent(F_reference: Array, F: Array, peak: float) -> Array:
    """Eq. 4.19; NaN where both forces are next to nothing.

    Where only the reference is, the other curve has outlived it: that is an error, and a finite one.
    """
    significant = np.abs(F_reference) >= NEGLIGIBLE_FORCE * peak
    outlived = ~significant & (np.abs(F) > BROKEN_FRACTION * peak)
    scale = np.where(significant, F_reference, np.where(outlived, BROKEN_FRACTION * peak, np.nan))
    return 100.0 * (F - F_reference) / scale


def _summarise(errors: pd.DataFrame, split: float, cyclic: bool, coverage: float) -> CurveComparison:
    before = errors["coordinate"] < split  # at the peak itself the force may already have dropped
    relative, of_peak = errors["relative_error_percent"], errors["peak_error_percent"]
    return CurveComparison(
        errors=errors,
        cyclic=cyclic,
        coverage=coverage,
        l2_percent_before_peak=_root_mean_square(relative[before]),
        l2_percent_after_peak=_root_mean_square(relative[~before]),
        l2_percent_whole=_root_mean_square(relative),
        l2_peak_percent_before_peak=_root_mean_square(of_peak[before]),
        l2_peak_percent_after_peak=_root_mean_square(of_peak[~before]),
        l2_peak_percent_whole=_root_mean_square(of_peak),
        max_peak_percent=float(of_peak.abs().max()),
    )


def _root_mean_square(values: ArrayLike) -> float:
    """Root of the mean square of the finite values; NaN when there are none."""
    array = np.asarray(values, dtype=float)
    array = array[np.isfinite(array)]
    return float(np.sqrt(np.mean(array**2))) if array.size else float("nan")
