"""The J-integral of the exact mode-one field around a crack tip."""

from types import SimpleNamespace

import numpy as np
import pytest

from cases.geometry import Shape
from verify.metrics.energy_release import energy_release_rate
from verify.metrics.registry import METRICS

YOUNG, POISSON, K, THICKNESS = 210.0, 0.3, 1.7, 2.0
EXACT = K**2 * (1 - POISSON**2) / YOUNG  # plane strain
TIP = np.array([0.13, -0.07])


def mode_one_displacement(points, tip=TIP):
    """Displacement of the K-field, plane strain, crack along the negative x axis of the tip."""
    x, y = (points - tip).T
    r, angle = np.hypot(x, y), np.arctan2(y, x)
    shear, kolosov = YOUNG / (2 * (1 + POISSON)), 3 - 4 * POISSON
    radial = K / (2 * shear) * np.sqrt(r / (2 * np.pi)) * (kolosov - np.cos(angle))
    return np.column_stack([radial * np.cos(angle / 2), radial * np.sin(angle / 2)])


def mode_one_state(points, tip=TIP):
    """Gradient by central differences, stress and energy density by Hooke's law."""
    step = 1e-6
    shifted = [
        mode_one_displacement(points + step * axis, tip) - mode_one_displacement(points - step * axis, tip)
        for axis in np.eye(2)
    ]
    dx, dy = (difference / (2 * step) for difference in shifted)
    gradient = np.column_stack([dx[:, 0], dy[:, 0], dx[:, 1], dy[:, 1]])
    strain = np.column_stack([dx[:, 0], dy[:, 1], dy[:, 0] + dx[:, 1]])
    lame = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    shear = YOUNG / (2 * (1 + POISSON))
    trace = strain[:, :1] + strain[:, 1:2]
    stress = np.hstack([lame * trace + 2 * shear * strain[:, :2], shear * strain[:, 2:]])
    return {"stress": stress, "gradient": gradient, "energy_density": 0.5 * np.sum(stress * strain, axis=1)}


def cloud(n=200, side=2.0):
    """Centres of n x n cells around the origin, and their volumes; no centre lies on the crack."""
    x = (np.arange(n) + 0.5) / n * side - side / 2
    points = np.column_stack([grid.ravel() for grid in np.meshgrid(x, x, indexing="ij")])
    return points, np.full(len(points), THICKNESS * (side / n) ** 2)


def release_rate(points, volume, inner=0.3, outer=0.7):
    boxes = {"tip": TIP, "inner": inner, "outer": outer}
    return energy_release_rate(points, volume, THICKNESS, **mode_one_state(points), **boxes)


def test_mode_one_field_gives_its_release_rate():
    assert release_rate(*cloud()) == pytest.approx(EXACT, rel=5e-3)


@pytest.mark.parametrize(("inner", "outer"), [(0.1, 0.3), (0.2, 0.75), (0.5, 0.8), ((0.2, 0.4), (0.8, 0.6))])
def test_any_box_gives_the_same(inner, outer):
    assert release_rate(*cloud(), inner=inner, outer=outer) == pytest.approx(EXACT, rel=5e-3)


def test_scattered_points_give_the_same():
    points, volume = cloud()
    jitter = np.random.default_rng(1).uniform(-0.3, 0.3, points.shape) * 2.0 / 200
    jitter[np.abs(points[:, 1] - TIP[1]) < 0.02] = 0.0  # not across the crack
    assert release_rate(points + jitter, volume) == pytest.approx(EXACT, rel=5e-3)


TURN = np.array([[0.0, -1.0], [1.0, 0.0]])  # by a right angle, so that the crack grows along y


def turned_state(points):
    """Of the crack that is turned; points before the turn."""
    state = mode_one_state(points)
    xx, yy, xy = state["stress"].T
    gradient = (TURN @ state["gradient"].reshape(-1, 2, 2) @ TURN.T).reshape(-1, 4)
    return state | {"gradient": gradient, "stress": np.column_stack([yy, xx, -xy])}


def test_rotated_crack_gives_the_same():
    points, volume = cloud()
    boxes = {"tip": TURN @ TIP, "inner": 0.3, "outer": 0.7}
    found = energy_release_rate(
        points @ TURN.T, volume, THICKNESS, **turned_state(points), **boxes, direction=(0.0, 1.0)
    )
    assert found == pytest.approx(release_rate(points, volume), rel=1e-9)


def made_up_case(h, notches=()):
    """What the metric asks of a case, whose body is large."""
    body = SimpleNamespace(shape=Shape(rectangle={"lower": (-5.0, -5.0), "upper": (5.0, 5.0)}))
    return SimpleNamespace(
        name="made up", plane=SimpleNamespace(thickness=THICKNESS), mesh=SimpleNamespace(h=h), bodies={"plate": body},
        notches=notches, all_notches=notches, tractions=(), body_forces=(), dynamics=None,
        outlines=lambda: [body.shape.outline()],
    )  # fmt: skip


@pytest.mark.parametrize("broken", [True, False])
def test_the_metric_takes_the_direction_of_the_crack_or_of_its_notch(broken):
    """A crack along y: traced, or the only notch of a body in which nothing broke."""
    points, volume = cloud()
    behind = np.minimum(points[:, 0] - TIP[0], 0.0)
    away = np.hypot(points[:, 0] - TIP[0] - behind, points[:, 1] - TIP[1])
    phase = 1 - np.exp(-away / 0.06) if broken else np.ones(len(points))
    data = turned_state(points) | {"reference": points @ TURN.T, "volume": volume, "phase_field": phase}
    notch = SimpleNamespace(kind="slit", start=TURN @ (TIP - (1.0, 0.0)), end=TURN @ TIP)
    case = made_up_case(0.02, () if broken else (notch,))
    run = SimpleNamespace(
        case=case, info={"run": "a run"}, snapshots=lambda: [(0.0, 0, SimpleNamespace(point_data=data))]
    )
    metric = METRICS["energy_release_rate"]
    assert metric(run, inner=0.3, outer=0.6) == pytest.approx(EXACT, rel=1e-2)
    assert metric(run, inner=0.3, outer=0.6, direction=(1.0, 0.0)) == pytest.approx(0.0, abs=1e-2 * EXACT)


def test_uniform_stress_without_a_crack_releases_nothing():
    points, volume = cloud(100)
    n = len(points)
    stress, gradient = np.tile([3.0, 5.0, 1.0], (n, 1)), np.tile([0.01, 0.002, 0.004, 0.02], (n, 1))
    found = energy_release_rate(points, volume, THICKNESS, stress, gradient, np.full(n, 0.07), TIP, 0.3, 0.7)
    assert abs(found) < 1e-4 * 0.07


def test_boxes_must_enclose_one_another_and_points():
    points, volume = cloud(50)
    with pytest.raises(ValueError, match="inner < outer"):
        release_rate(points, volume, inner=0.5, outer=0.4)
    with pytest.raises(ValueError, match="no integration point"):
        release_rate(points, volume, inner=1e-6, outer=1e-5)


def test_metric_averages_the_last_third_of_the_snapshots_around_the_traced_tip():
    points, volume = cloud()
    h, l0 = 2 * 2.0 / 200, 0.03  # two points per cell and direction

    def snapshot(tip, factor):
        behind = np.minimum(points[:, 0] - tip[0], 0.0)
        ahead = points[:, 0] - tip[0] - behind
        c = 1 - np.exp(-np.hypot(ahead, points[:, 1] - tip[1]) / (2 * l0))
        state = mode_one_state(points, tip)
        data = state | {"reference": points, "volume": volume, "phase_field": c}
        data["stress"] = factor * data["stress"]
        data["energy_density"] = factor * data["energy_density"]
        return (0.0, 0, SimpleNamespace(point_data=data))

    tips = [TIP + np.array([x, 0.0]) for x in (-0.2, -0.15, -0.1, -0.05, 0.0, 0.05)]
    snapshots = [snapshot(tip, factor) for tip, factor in zip(tips, [9, 9, 9, 9, 1, 3], strict=True)]
    case = made_up_case(h)
    run = SimpleNamespace(case=case, info={"run": "a run"}, snapshots=lambda: snapshots)
    found = METRICS["energy_release_rate"](run, inner=0.3, outer=0.6)
    assert found == pytest.approx(2 * EXACT, rel=1e-2)
