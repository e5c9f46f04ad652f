"""Closed forms of plates hold their limits; the metrics beside them read made-up fields."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from cases import load_case
from physics.exact_plates import (
    bar_strength,
    double_edge_factor,
    double_edge_strength,
    plane_modulus,
    pressed_disc_stress,
    strip_release_rate,
    strip_stress,
)
from verify.metrics.metric import MetricError
from verify.metrics.registry import METRICS


def test_the_middle_of_a_pressed_disc_and_its_free_rim():
    middle = pressed_disc_stress(np.zeros((1, 2)), 3.0, 25.0, 2.0)
    assert middle[0] == pytest.approx(3.0 / (np.pi * 25.0 * 2.0) * np.array([1.0, -3.0, 0.0]))
    angle = np.linspace(0.0, 1.2, 7)
    normal = np.column_stack([np.cos(angle), np.sin(angle)])
    xx, yy, xy = pressed_disc_stress(25.0 * normal, 3.0, 25.0, 2.0).T
    traction = np.column_stack([xx * normal[:, 0] + xy * normal[:, 1], xy * normal[:, 0] + yy * normal[:, 1]])
    assert np.abs(traction).max() < 1e-12


def test_short_and_deep_edge_cracks_have_their_limits():
    assert double_edge_factor(1e-9) == pytest.approx(1.122, rel=1e-6)
    assert double_edge_factor(1.0 - 1e-9) * np.sqrt(1e-9) == pytest.approx(2.0 / np.pi, rel=2e-3)


def test_the_plate_breaks_where_its_release_rate_is_what_the_cells_see():
    case = load_case("double_edge_notch", tier="quick")
    material = case.materials["steel"]
    stress = double_edge_strength(case) / 2.0
    intensity = stress * np.sqrt(np.pi * 0.5) * double_edge_factor(0.5)
    seen = material.fracture.toughness * (1.0 + case.mesh.h / (4.0 * material.fracture.length_scale))
    assert intensity**2 / plane_modulus(material, "strain") == pytest.approx(seen)
    assert plane_modulus(material, "stress") == pytest.approx(0.91 * plane_modulus(material, "strain"))


def test_a_strip_of_two_bodies_is_two_springs_in_a_row():
    case = load_case("bimaterial_strip", tier="quick")
    tension = strip_stress(case, at=[5.0, 0.25], component="yy")
    assert strip_stress(case, at=[5.0, -0.25], component="yy") == tension
    springs = [0.5 / (m.lam + 2.0 * m.mu) for m in case.materials.values()]
    assert tension == pytest.approx(1e-3 / sum(springs))
    assert strip_release_rate(case) == pytest.approx(0.5 * 1e-3 * tension)


def test_a_bar_is_strongest_at_three_quarters():
    rock = load_case("brazilian_disc", tier="quick").materials["rock"]
    phase = np.linspace(0.5, 1.0, 5001)
    history = (1.0 / phase - 1.0) * rock.fracture.toughness / (4.0 * rock.fracture.length_scale)
    stress = phase**2 * np.sqrt(2.0 * rock.young_modulus * history)
    assert bar_strength(rock) == pytest.approx(stress.max(), rel=1e-6)
    assert phase[stress.argmax()] == pytest.approx(0.75, abs=1e-3)


@pytest.fixture
def made_up():
    points = SimpleNamespace(
        point_data={
            "reference": np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [9.0, 0.0, 0.0]]),
            "volume": np.array([1.0, 3.0, 1.0]),
            "stress": np.array([[1.0, 2.0, 3.0], [5.0, 6.0, 7.0], [90.0, 90.0, 90.0]]),
        }
    )
    return SimpleNamespace(
        snapshots=lambda: [(0.5, 1, points)],
        history=pd.DataFrame({"u": [0.0, 1.0], "F": [0.0, 8.0]}),
        case=SimpleNamespace(
            plane=SimpleNamespace(thickness=2.0), dynamics=None, load=SimpleNamespace(increments=(0.1,)),
            constraints=(SimpleNamespace(follows_load=True, scale=-1.0),),
            tractions=(), body_forces=(), eigenstrains=(),
        ),
        info={"run": "made up"},
    )


def test_a_stress_is_the_mean_about_a_place_over_the_nominal_one(made_up):
    assert METRICS["stress_at"](made_up, at=[0.0, 0.0], component="yy", radius=1.0, u=0.5) == 5.0
    place = {"at": [0.0, 0.0], "component": "xx", "radius": 1.0, "u": 0.5}
    assert METRICS["stress_concentration"](made_up, section=3.0, **place) == 4.0 / (4.0 / 6.0)
    with pytest.raises(MetricError, match=r"no fields at u = 0.7, the nearest are of u = 0.5; add 0.7 to output"):
        METRICS["stress_at"](made_up, at=[0.0, 0.0], component="yy", radius=1.0, u=0.7)
    with pytest.raises(MetricError, match=r"no stress at u = 0.52, which no increment reaches.* a point of load.path"):
        METRICS["stress_at"](made_up, at=[0.0, 0.0], component="yy", radius=1.0, u=0.52)
    with pytest.raises(MetricError, match="no point within"):
        METRICS["stress_at"](made_up, at=[5.0, 0.0], component="yy", radius=1.0, u=0.5)
    with pytest.raises(MetricError, match="no stress 'zz'"):
        METRICS["stress_at"](made_up, at=[0.0, 0.0], component="zz", radius=1.0, u=0.5)
