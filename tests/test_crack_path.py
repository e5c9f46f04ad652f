"""Crack paths traced from phase fields whose crack is known."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from verify.metrics.crack_path import (
    crack_path,
    hausdorff,
    mean_distance,
    path_angle,
    path_length,
    tip_position,
    trace_crack,
)
from verify.metrics.metric import MetricError
from verify.metrics.registry import METRICS

H = 1 / 40
S = np.linspace(0.0, 1.0, 31)
LINES = {
    "straight": np.array([[0.2, 0.503], [0.8, 0.503]]),
    "inclined": np.array([[0.2, 0.3], [0.75, 0.62]]),
    "steep": np.array([[0.41, 0.2], [0.37, 0.8]]),
    "kinked": np.array([[0.2, 0.5], [0.5, 0.5], [0.75, 0.25]]),
    "curved": np.column_stack([0.2 + 0.6 * S, 0.5 + 0.15 * np.sin(3 * S)]),
}


def distance(points, line):
    result = np.full(len(points), np.inf)
    for tail, head in pairwise(line):
        edge = head - tail
        along = np.clip((points - tail) @ edge / (edge @ edge), 0, 1)
        result = np.minimum(result, np.linalg.norm(points - tail - along[:, None] * edge, axis=1))
    return result


def profile(points, *lines, l0=1.5 * H):
    """One-dimensional profile of a crack of second order, of the distance to the nearest line."""
    return 1 - np.exp(-np.min([distance(points, line) for line in lines], axis=0) / (2 * l0))


def lattice(x, y=None):
    return np.column_stack([grid.ravel() for grid in np.meshgrid(x, x if y is None else y, indexing="ij")])


def gauss_points(edges=None):
    edges = np.linspace(0, 1, round(1 / H) + 1) if edges is None else edges
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    return lattice(np.sort(np.concatenate([middle - half / np.sqrt(3), middle + half / np.sqrt(3)])))


def random_points(seed=0, h=H):
    n = round(1 / h)
    cells = lattice(np.arange(n))[:, None, :]
    return ((cells + np.random.default_rng(seed).random((n * n, 4, 2))) * h).reshape(-1, 2)


POINTS = {
    "gauss": gauss_points(),
    "regular": lattice((np.arange(80) + 0.5) * H / 2),
    "random": random_points(),
}


@pytest.mark.parametrize("arrangement", POINTS)
@pytest.mark.parametrize("name", LINES)
@pytest.mark.parametrize("l0_over_h", [1.0, 2.0])
def test_known_crack_is_found_within_a_tenth_of_a_cell(name, arrangement, l0_over_h):
    points, line = POINTS[arrangement], LINES[name]
    found = trace_crack(points, profile(points, line, l0=l0_over_h * H), H, start=line[0])
    assert mean_distance(found.points, line) < 0.1 * H
    # the tip is where the ridge has risen to a quarter, 2 ln(4/3) l0 ahead of the line's end for this profile
    assert np.linalg.norm(tip_position(found.points) - line[-1]) < (2 * np.log(4 / 3) * l0_over_h + 0.5) * H
    assert np.array_equal(found.points[0], line[0])
    assert (found.branches, found.endpoints) == (0, 2)


def test_a_path_beside_the_crack_would_not_pass():
    line = LINES["inclined"]
    assert mean_distance(line + np.array([0.0, 0.15 * H]), line) > 0.1 * H


@pytest.mark.parametrize("seed", range(1, 4))
def test_wide_crack_on_random_points(seed):
    """On smaller cells, so that its width stays small beside its length."""
    h, line = 1 / 60, LINES["kinked"]
    points = random_points(seed, h)
    assert mean_distance(trace_crack(points, profile(points, line, l0=4 * h), h).points, line) < 0.1 * h


def test_without_a_start_the_path_runs_with_x():
    points = POINTS["gauss"]
    backward = LINES["inclined"][::-1]
    found = trace_crack(points, profile(points, backward), H).points
    assert found[0, 0] < found[-1, 0]
    reverse = trace_crack(points, profile(points, backward), H, start=backward[0]).points
    assert reverse[0, 0] > reverse[-1, 0]


def test_crack_through_the_body_ends_within_a_cell_of_its_edges():
    line = np.array([[0.0, 0.52], [1.0, 0.45]])
    found = trace_crack(POINTS["gauss"], profile(POINTS["gauss"], line), H).points
    assert mean_distance(found, line) < 0.1 * H
    assert hausdorff(found, line) < H


def test_graded_grid():
    sizes = np.minimum(H * 1.15 ** np.maximum(np.arange(40) - 15, 0), 5 * H)
    right = 0.5 + np.concatenate([[0.0], np.cumsum(sizes)])
    right = right[right < 1.2]
    points = gauss_points(np.concatenate([1 - right[:0:-1], right]))
    line = np.array([[0.3, 0.503], [0.7, 0.503], [0.95, 0.6]])  # ends where cells are several H wide
    found = trace_crack(points, profile(points, line), H)
    assert mean_distance(found.points, line) < 0.1 * H
    assert found.branches == 0


@pytest.mark.parametrize("as_nan", [True, False])
def test_cells_left_out_for_a_notch(as_nan):
    points = POINTS["gauss"]
    line = np.array([[0.5, 0.5], [0.9, 0.6]])
    c = profile(points, line)
    void = (points[:, 0] < 0.5) & (np.abs(points[:, 1] - 0.5) < H)
    c[void] = np.nan
    kept = np.ones(len(points), dtype=bool) if as_nan else ~void
    found = trace_crack(points[kept], c[kept], H, start=[0.5, 0.5]).points
    assert mean_distance(found, line) < 0.1 * H
    assert np.array_equal(found[0], [0.5, 0.5])


def with_history(notches, l0=1.5 * H):
    """A case with notches of history in a body of second order."""
    return SimpleNamespace(
        all_notches=[SimpleNamespace(kind="history", start=start, end=end) for start, end in notches],
        mesh=SimpleNamespace(h=H), bodies={"plate": SimpleNamespace(material="steel")},
        materials={"steel": SimpleNamespace(fracture=SimpleNamespace(order=2, length_scale=l0))},
        inside=lambda points: np.zeros(len(points), dtype=int),
    )  # fmt: skip


@pytest.mark.parametrize("l0_over_h", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("second", [[], [np.array([[-20.0, 12.0], [-10.0, 12.0]])]])
def test_the_band_of_a_history_notch_is_no_crack(l0_over_h, second):
    """The notch breaks all that lies within a length scale of it, and c rises from there on, over any number of cells."""
    l0 = l0_over_h * H
    notch, line = l0 * np.array([[-20.0, 0.0], [0.0, 0.0]]), l0 * np.array([[0.0, 0.0], [4.0, -4.0], [12.0, -8.0]])
    notches = [notch, *(l0 * other for other in second)]
    cells = np.arange(-20.0 * l0, 20.0 * l0, H / 2)
    points = lattice(cells)
    band = [np.maximum(distance(points, one) - l0, 0.0) for one in notches]
    only = 1.0 - np.exp(-np.min(band, axis=0) / (2.0 * l0))
    case = with_history(notches, l0)
    assert len(crack_path(SimpleNamespace(reference=points, phase_field=only), case)) == 0
    both = np.minimum(only, profile(points, line, l0=l0))
    found = crack_path(SimpleNamespace(reference=points, phase_field=both), case)
    assert path_length(found) == pytest.approx(path_length(line), abs=2 * l0)
    assert path_angle(found) == pytest.approx(path_angle(line), abs=3.0)


def test_notch_in_the_phase_field_is_not_traced():
    points, notch = POINTS["gauss"], np.array([[0.0, 0.5], [0.5, 0.5]])
    line = np.array([[0.5, 0.5], [0.62, 0.56]])
    case = with_history([notch])
    fields = SimpleNamespace(reference=points, phase_field=profile(points, notch, line))
    found = crack_path(fields, case)
    assert mean_distance(found, line) < 0.1 * H
    assert path_length(found) == pytest.approx(path_length(line), abs=2 * H)
    fields.phase_field = profile(points, notch)
    assert path_length(crack_path(fields, case)) < 4 * H


def test_branch_is_counted_and_the_longest_path_taken():
    points = POINTS["gauss"]
    longest = np.array([[0.2, 0.5], [0.5, 0.5], [0.8, 0.7]])
    branch = np.array([[0.5, 0.5], [0.7, 0.35]])
    found = trace_crack(points, profile(points, longest, branch), H, start=longest[0])
    assert (found.branches, found.endpoints) == (1, 3)
    assert mean_distance(found.points, longest) < 0.1 * H


def test_of_two_cracks_the_one_at_the_start_is_taken():
    left, right = np.array([[0.1, 0.5], [0.35, 0.5]]), np.array([[0.65, 0.5], [0.95, 0.5]])
    c = profile(POINTS["gauss"], left, right)
    assert mean_distance(trace_crack(POINTS["gauss"], c, H).points, right) < 0.1 * H
    assert mean_distance(trace_crack(POINTS["gauss"], c, H, start=left[1]).points, left[::-1]) < 0.1 * H


def test_nothing_broken_gives_no_path():
    points = POINTS["gauss"]
    spot = np.array([[0.5, 0.5], [0.5 + 1e-6, 0.5]])
    for c in (np.ones(len(points)), np.full(len(points), np.nan), profile(points, spot)):
        found = trace_crack(points, c, H)
        assert found.points.shape == (0, 2)
        assert (found.branches, found.endpoints) == (0, 0)
    on_a_line = np.column_stack([np.arange(6.0), np.zeros(6)])
    assert len(trace_crack(on_a_line, np.zeros(6), 1.0).points) == 0


# --- metrics of polylines -------------------------------------------------------------------------


def test_distances_of_polylines():
    one, other = np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[0.0, 0.1], [0.5, 0.1], [1.5, 0.1]])
    assert hausdorff(one, one) == mean_distance(one, one) == 0.0
    assert hausdorff(one, other) == hausdorff(other, one) == pytest.approx(np.hypot(0.5, 0.1))
    assert mean_distance(one, one + np.array([0.0, 0.2])) == pytest.approx(0.2)


@pytest.mark.parametrize("degrees", [-170.0, -90.0, -15.0, 0.0, 40.0, 135.0])
def test_angle_and_length(degrees):
    direction = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    line = np.array([1.0, 2.0]) + np.outer([0.0, 0.3, 2.0], direction)
    assert path_angle(line) == pytest.approx(degrees)
    assert path_length(line) == pytest.approx(2.0)
    assert np.allclose(tip_position(line), line[-1])


@pytest.mark.parametrize(("least", "said"), [(0.9, "nothing broke"), (0.0, "no longer than it is wide")])
def test_why_there_is_no_path_is_told(least, said):
    info, history = {"solver": "fem"}, pd.DataFrame({"c_min": [1.0, least]})
    run = SimpleNamespace(crack_path=np.zeros((0, 2)), info=info, history=history, case=None, name="fem")
    with pytest.raises(MetricError, match=said):
        METRICS["crack_angle"](run)
