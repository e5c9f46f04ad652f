"""Tips, speeds, branching, fragments and symmetry on cracks that are drawn, not computed."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from verify.metrics import crack_front
from verify.metrics.crack_path import TORN_WIDTH_OF_HISTORY, reach_of_history

H, LENGTH_SCALE = 0.5, 0.5
SPEED, FORK, HALF_ANGLE = 0.8, np.array([30.0, 20.0]), 30.0
START = np.array([10.0, 20.0])


def lattice(width=60.0, height=40.0, spacing=0.5 * H):
    x, y = np.arange(0.5 * spacing, width, spacing), np.arange(0.5 * spacing, height, spacing)
    return np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)


def distance_and_place(points, start, end):
    """Distance (n,) from a segment and the length along it (n,) where the foot lies."""
    direction = (end - start) / np.linalg.norm(end - start)
    along = np.clip((points - start) @ direction, 0.0, np.linalg.norm(end - start))
    return np.linalg.norm(points - start - along[:, None] * direction, axis=1), along


def drawn_crack(points, *segments):
    """Phase field and break times of a crack along segments (start, end, way of the tip to the start)."""
    phase, when = np.ones(len(points)), np.full(len(points), np.inf)
    for start, end, before in segments:
        distance, along = distance_and_place(points, start, end)
        phase = np.minimum(phase, 1.0 - np.exp(-distance / (2.0 * LENGTH_SCALE)))
        near = distance < -2.0 * LENGTH_SCALE * np.log(0.75)
        when[near] = np.minimum(when[near], (before + along[near]) / SPEED)
    return phase, np.where(np.isfinite(when), when, np.nan)


def arm(angle, length=20.0):
    """Vector of an arm that leaves the crack's line by an angle in degrees."""
    return length * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])


def branched_crack(points, half_angle=HALF_ANGLE, *more):
    """A crack that runs at constant speed and forks into two."""
    stem = np.linalg.norm(FORK - START)
    arms = [(FORK, FORK + arm(side * half_angle), stem) for side in (1, -1)]
    return drawn_crack(points, (START, FORK, 0.0), *arms, *more)


@pytest.fixture(scope="module")
def ways():
    points = lattice()
    return crack_front.branches(points, *branched_crack(points), H, start=START)


def test_both_branches_of_a_fork_are_found(ways):
    ends = sorted((way.points[-1] for way in ways), key=lambda end: end[1])
    assert len(ways) == 2
    np.testing.assert_allclose(ends, [FORK + arm(-HALF_ANGLE), FORK + arm(HALF_ANGLE)], atol=2 * H)


def test_the_speed_of_each_tip_is_that_of_the_drawn_crack(ways):
    for way in ways:
        _, speed = way.speed(interval=1.0)
        assert len(speed) > 30
        assert np.median(speed) == pytest.approx(SPEED, rel=0.03)
        assert speed.max() < 1.25 * SPEED


def test_branching_time_and_angle(ways):
    assert crack_front.branching_time(ways) == pytest.approx(20.0 / SPEED, abs=3 * H / SPEED)
    assert crack_front.branching_angle(ways, 10.0, H) == pytest.approx(60.0, abs=3.0)


def test_the_angle_is_that_where_the_two_longest_ways_part_not_where_a_shorter_one_left_before():
    points, side = lattice(), np.array([20.0, 20.0])
    shorter = (side, side + arm(90.0, 8.0), 10.0)
    three = crack_front.branches(points, *branched_crack(points, 60.0, shorter), H, start=START)
    assert len(three) == 3 and all(len(way.forks) == 2 for way in three[:2])
    assert crack_front.branching_angle(three, 10.0, H) == pytest.approx(120.0, abs=3.0)


def test_a_branch_that_runs_into_another_ones_crack_encloses_a_piece():
    points = lattice()
    first, stem = FORK + arm(HALF_ANGLE, 12.0), np.linalg.norm(FORK - START)
    across = (first, FORK + arm(-HALF_ANGLE, 12.0), stem + 12.0)
    apart = np.isfinite(branched_crack(points)[1])
    _, when = branched_crack(points, HALF_ANGLE, across)
    met = np.isfinite(when)
    assert crack_front.enclosed(points, apart, H, least=4.0) == 0
    assert crack_front.enclosed(points, met, H, least=4.0) == 1
    assert crack_front.enclosed(points, met, H, least=200.0) == 0
    assert crack_front.enclosed(points, met & (when < (stem + 18.0) / SPEED), H, least=4.0) == 0
    assert crack_front.enclosed(points, np.zeros(len(points), bool), H, least=4.0) == 0


def test_a_straight_crack_does_not_branch():
    points = lattice()
    distance, along = distance_and_place(points, START, FORK)
    when = np.where(distance < 0.5, along / SPEED, np.nan)
    way, *others = crack_front.branches(points, np.where(distance < 0.5, 0.0, 1.0), when, H, start=START)
    assert not others and way.forks == ()
    assert np.isnan(crack_front.branching_time([way]))
    assert way.along[-1] == pytest.approx(20.0, abs=2 * H)


def test_a_tip_that_waits_does_not_move(ways):
    before, after = ways[0].position([-1.0, 1e6])
    assert np.isnan(before) and np.isnan(after)


def test_the_band_of_a_history_notch_in_small_cells_is_no_branch():
    """It is torn up to a length scale from the notch and c rises from there on, over more cells than four."""
    points, mouth, fine = lattice(spacing=0.125), np.array([0.0, 20.0]), 0.25 * LENGTH_SCALE
    phase, when = drawn_crack(points, (START, START + arm(0.0), 0.0))
    distance, _ = distance_and_place(points, mouth, START)
    phase = np.minimum(phase, 1.0 - np.exp(-np.maximum(distance - LENGTH_SCALE, 0.0) / (2.0 * LENGTH_SCALE)))
    when[distance < 1.6 * LENGTH_SCALE] = 0.0
    case = SimpleNamespace(
        mesh=SimpleNamespace(h=fine), bodies={"plate": SimpleNamespace(material="glass")},
        materials={"glass": SimpleNamespace(fracture=SimpleNamespace(order=2, length_scale=LENGTH_SCALE))},
        inside=lambda points: np.zeros(len(points), dtype=int),
    )  # fmt: skip
    notch = np.array([mouth, START])
    reach = reach_of_history(case, notch, TORN_WIDTH_OF_HISTORY)
    (way,) = crack_front.branches(points, phase, when, fine, START, notch, reach=reach)
    np.testing.assert_allclose(way.points[-1], START + arm(0.0), atol=2 * H)


def test_nothing_broken_gives_no_branches():
    points = lattice()
    assert crack_front.branches(points, np.ones(len(points)), np.full(len(points), np.nan), H) == []


def test_a_crack_through_a_body_makes_two_fragments_and_crumbs_do_not_count():
    points, thickness = lattice(10.0, 6.0), 2.0
    volume = np.full(len(points), (0.5 * H) ** 2 * thickness)
    body = np.where(points[:, 0] < 4.0, 0, 1)
    through = np.abs(points[:, 0] - 7.0) < 0.5
    half = through & (points[:, 1] < 3.0)
    arguments = (points, volume, thickness, body)
    assert crack_front.fragments(*arguments, broken=np.zeros(len(points), bool), least_share=0.01) == 2
    assert crack_front.fragments(*arguments, broken=half, least_share=0.01) == 2
    assert crack_front.fragments(*arguments, broken=through, least_share=0.01) == 3
    ring = (np.abs(points - [9.0, 3.0]).max(axis=1) < 0.8) & (np.abs(points - [9.0, 3.0]).max(axis=1) > 0.3)
    assert crack_front.fragments(*arguments, broken=ring, least_share=0.1) == 2
    assert crack_front.fragments(*arguments, broken=ring, least_share=1e-4) == 3


def test_asymmetry_is_the_largest_difference_of_mirror_images():
    points = lattice(10.0, 6.0)
    values = np.cos(points[:, 1] - 3.0) * points[:, 0]
    assert crack_front.asymmetry(points, values, axis=1, middle=3.0) < 1e-12
    values[7] += 0.25
    assert crack_front.asymmetry(points, values, axis=1, middle=3.0) == pytest.approx(0.25)
    assert crack_front.asymmetry(points, values, axis=0, middle=5.0) > 5.0


def test_a_tip_that_meets_a_crack_does_not_run_along_it():
    """At 10 mm it meets what another tip broke from 20 mm back to 10 mm, and goes on from there at its own speed."""
    along = np.linspace(0.0, 30.0, 301)
    line = np.column_stack([along, 0.0 * along])
    broken_at = np.where(along < 10.0, along, np.where(along < 20.0, 20.0 - along, along - 10.0))
    branch = crack_front._branch(line, [], cKDTree(line), broken_at + 5.0, h=0.2)
    assert branch.met == pytest.approx([15.0], abs=0.3)
    assert branch.position(24.0) > 28.0, "the way goes on beyond"
    times, speed = branch.speed(0.5)
    assert speed == pytest.approx(np.ones(len(speed)), abs=0.1)
    assert (times < 14.0).any() and (times > 16.0).any() and not (np.abs(times - 15.0) < 0.5).any()


def test_a_tip_does_not_wait_for_what_breaks_late_beside_its_start():
    points = lattice()
    phase, when = drawn_crack(points, (START, START + arm(0.0, 30.0), 0.0))
    start = np.isfinite(when) & (np.linalg.norm(points - START, axis=1) < 2.0 * H)
    when[start] = 30.0
    (way,) = crack_front.branches(points, phase, when, H, START)
    times, speed = way.speed(interval=1.0)
    assert times[0] < 6.0
    assert np.mean(speed) == pytest.approx(SPEED, rel=0.02)
    assert not way.met
