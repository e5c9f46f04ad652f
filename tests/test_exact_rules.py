"""Exact solutions are held against cases of theirs only, and are right for all of these."""

import numpy as np
import pytest

from cases import CaseError, case_from_tables
from fem_reference import FiniteElements
from numerics.quasi_static import increments
from physics.exact import MOTIONS, SOLUTIONS
from physics.exact_motion import contact_half_width, rolling_distance, rolling_spin, sliding_distance, spinning_stress
from physics.exact_rules import otherwise_than, require_exact

BRITTLE = {"toughness": 0.1, "length_scale": 1.0, "split": "none"}
ROLLERS = [{"on": "left", "direction": "x", "value": 0}, {"on": "bottom", "direction": "y", "value": 0}]
PULLED = {"on": "right", "direction": "x", "scale": 1}


def case_of(tmp_path, **tables):
    """A bar of 4 by 1 that is pulled along x."""
    given = {
        "title": "t", "requirement": "r", "units": {"length": "m", "force": "N", "time": "s"}, "mesh": {"h": 0.5},
        "plane": {"assumption": "stress", "thickness": 2.0}, "runs": {"fem": {"solver": "fem"}},
        "materials": {"m": {"young": 1000.0, "poisson": 0.3, "density": 1.0, "fracture": BRITTLE}},
        "bodies": {"bar": {"material": "m", "shape": {"rectangle": {"lower": [0, 0], "upper": [4, 1]}}}},
        "constraints": [*ROLLERS, PULLED], "load": {"path": [0.0, 0.02], "increment": 0.002}, "exact": "homogeneous_bar",
    }  # fmt: skip
    merged = {key: value for key, value in (given | tables).items() if value is not None}
    return case_from_tables(merged, run="fem", source=tmp_path / "case.toml")


def brittle(**changed):
    return {"m": {"young": 1000.0, "poisson": 0.3, "fracture": BRITTLE | changed}}


@pytest.mark.parametrize(
    "tables",
    [
        {"plane": {"assumption": "strain"}},
        {"materials": brittle(residual_stiffness=0.1)},
        {"materials": brittle(functional="AT1", residual_stiffness=0.1)},
        {"materials": brittle(split="star_convex")},
        {"materials": {"m": {"young": 1000.0, "poisson": 0.3}}, "plane": {"assumption": "strain"}},
        {"constraints": [*ROLLERS, {"on": "top", "direction": "y", "scale": 1}], "plane": {"assumption": "strain"}},
    ],
    ids=["plane strain", "residual stiffness", "AT1", "another split", "unbreakable", "along y"],
)
def test_a_bar_in_even_tension_has_the_exact_force(tmp_path, tables):
    case = case_of(tmp_path, **tables)
    require_exact(case)
    rows = list(increments(FiniteElements(case), case))
    exact = [SOLUTIONS["homogeneous_bar"].force(case, row.u) for row in rows]
    assert np.abs(np.subtract([row.F for row in rows], exact)).max() < 1e-3 * max(exact)


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"materials": brittle(split="spectral")}, r"which split = 'spectral' has not; give split = \"none\""),
        ({"load": {"path": [0.0, 0.02, 0.0], "increment": 0.002}}, "tension that grows"),
        ({"constraints": [*ROLLERS, PULLED, {"on": "top", "direction": "y", "value": 0}]}, "hold one side only"),
        ({"constraints": [*ROLLERS, PULLED | {"scale": 2}]}, "follows the load with scale = 1"),
        ({"exact": "homogenous_bar"}, r"is not an exact solution; did you mean 'homogeneous_bar'\?"),
        ({"exact": "vibrating_bar"}, "is that of a case with the table dynamics"),
        ({"exact": "double_edge_notch"}, "an equal one from its right edge"),
        ({"exact": None, "constraints": [{"on": "left", "motion": "mode_2"}]}, r"motion = 'mode_2' is not"),
    ],
)  # fmt: skip
def test_a_case_that_is_none_of_the_solutions_is_told_so(tmp_path, tables, said):
    with pytest.raises(CaseError, match=said):
        require_exact(case_of(tmp_path, **tables))


def moving(tmp_path, body, gravity, **tables):
    square = {"rectangle": {"lower": [0, 0], "upper": [1, 1]}}
    shapes = {"disc": {"disc": {"centre": [0, 1], "radius": 1}}, "block": square}
    floor = {"material": "m", "rigid": True, "shape": {"rectangle": {"lower": [-9, -1], "upper": [9, 0]}}}
    bodies = {"it": {"material": "m", "shape": shapes[body]} | tables.pop("start", {}), "floor": floor}
    dynamics = {"end_time": 1.0, "gravity": gravity}
    given = {"bodies": bodies, "constraints": None, "load": None, "exact": None, "dynamics": dynamics} | tables
    return case_of(tmp_path, runs={"fem": {"solver": "mpm"}}, **given)


PAIR = {"pairs": [{"bodies": ["floor", "it"], "friction": 0.2}]}


@pytest.mark.parametrize(
    ("start", "gravity", "way"),
    [
        (0.0, (5.0, -10.0), 1.5),
        (0.0, (-5.0, -10.0), -1.5),
        (0.0, (-1.0, -10.0), 0.0),
        (1.0, (0.0, -10.0), 0.25),
        (-1.0, (0.0, -10.0), -0.25),
        (1.0, (-3.0, -10.0), 0.1 - 0.5 * 0.8**2),
    ],
)
def test_a_block_slides_either_way_by_the_friction_of_its_pair(tmp_path, start, gravity, way):
    case = moving(tmp_path, "block", gravity, start={"velocity": [start, 0]}, contact=PAIR)
    assert otherwise_than(case, "sliding_block") == ""
    assert sliding_distance(case, body="it", time=1.0) == pytest.approx(way)


def test_a_cylinder_rolls_either_way_by_the_friction_of_its_pair(tmp_path):
    right, left = (moving(tmp_path, "disc", (side * 8.0, -10.0), contact=PAIR) for side in (1.0, -1.0))
    assert rolling_distance(right, body="it", time=1.0) == pytest.approx(3.0)
    assert rolling_distance(left, body="it", time=1.0) == pytest.approx(-3.0)
    assert rolling_spin(left, body="it", time=1.0) == pytest.approx(4.0) == -rolling_spin(right, body="it", time=1.0)


def test_of_a_block_no_line_contact_is_known(tmp_path):
    assert "is that of a disc" in otherwise_than(moving(tmp_path, "block", (0.0, -10.0)), "line_contact")


def test_plane_stress_is_softer_than_plane_strain_in_contact(tmp_path):
    case = moving(tmp_path, "disc", (0.0, -10.0))
    assert contact_half_width(case) == pytest.approx(np.sqrt(4.0 * np.pi * 10.0 / (np.pi * 1000.0)))


def test_a_disc_spins_in_plane_stress_too(tmp_path):
    gradient = {"velocity_gradient": [[0, -2.0], [2.0, 0]]}
    case = moving(tmp_path, "disc", (0.0, 0.0), start=gradient)
    hoop = spinning_stress(case, np.array([[1.0, 1.0]]), 0.0)[0, 1]  # at the rim
    assert hoop == pytest.approx(2.0**2 * 1.0 * (1.0 - 0.3) / 4.0 + 0.03 * 1000.0 * 8.0)


def test_the_mode_one_field_in_plane_stress_has_the_release_rate_of_the_toughness(tmp_path):
    """Its opening behind the tip is that of K^2 = E Gc: 8 K / E sqrt(r / (2 pi))."""
    case = case_of(tmp_path, exact=None)
    faces = MOTIONS["mode_one"](case, np.array([[-0.5, 1e-12], [-0.5, -1e-12]]), 0.0)
    opening = 8.0 * np.sqrt(1000.0 * 0.1) / 1000.0 * np.sqrt(0.5 / (2.0 * np.pi))
    assert faces[0, 1] - faces[1, 1] == pytest.approx(opening, rel=1e-6)
