"""Where the load-displacement path snaps back, the fracture energy leads instead of the load."""

from functools import cache

import numpy as np
import pytest

from cases import case_from_tables
from fem_reference import FiniteElements
from mpm import MaterialPoints
from numerics.quasi_static import increments

COARSE = {"h": 0.04, "coarse": 0.1, "fine": {"lower": [0.4, 0.4], "upper": [1.0, 0.6]}}
BLUNT = {"steel": {"fracture": {"length_scale": 0.04, "residual_stiffness": 1e-6}}}
ELEMENTS = {"fem": FiniteElements, "mpm": MaterialPoints}


@pytest.fixture(scope="module")
def path(variant):
    """The increments of a solver under a control, once for all that look at them."""

    @cache
    def followed(solver, control, end=0.012):
        load = {"path": [0.0, end], "increment": 1e-3, "smallest": 1e-4, "largest_advance": 2.0, "control": control}
        case = variant("sen_tension", mesh=COARSE, materials=BLUNT, load=load, staggered={"tolerance": 1e-4})
        return list(increments(ELEMENTS[solver](case), case))

    return followed


@pytest.mark.parametrize("solver", ["fem", "mpm"])
def test_the_path_snaps_back_and_no_energy_is_lost(path, solver):
    followed = path(solver, "dissipation")
    u = np.array([step.u for step in followed])
    assert followed[-1].status == "broken_through"
    assert (np.maximum.accumulate(u) - u).max() > 0.1 * u.max()
    last = followed[-1]
    # increments of two l0 are long for the trapezoids of the work: 4 % measured
    assert last.elastic_energy + last.fracture_energy == pytest.approx(last.external_work, rel=0.06)


def test_displacement_control_loses_what_the_crack_does_not_take(path):
    jumped = path("fem", "displacement")[-1]
    assert jumped.elastic_energy + jumped.fracture_energy < 0.94 * jumped.external_work


def test_both_controls_agree_up_to_the_peak(path):
    peaks = [max(step.F for step in path("fem", control)) for control in ("dissipation", "displacement")]
    assert peaks[0] == pytest.approx(peaks[1], rel=0.005)


@pytest.mark.parametrize("end", [0.00622, 0.0063])
def test_a_path_that_ends_while_the_fracture_energy_leads_comes_to_its_end(path, end):
    followed = path("fem", "dissipation", end)
    assert followed[-1].status == "broken_through" or followed[-1].u == end
    assert max(step.u for step in followed) <= end


PULLED = {
    "title": "Plate that a traction tears", "requirement": "The limit load is that of any control.",
    "units": {"length": "mm", "force": "kN"}, "plane": {"assumption": "strain"},
    "bodies": {"plate": {"material": "steel", "shape": {"rectangle": {"lower": [0, 0], "upper": [1, 1]}}}},
    "notches": [{"kind": "slit", "start": [0, 0.5], "end": [0.5, 0.5]}],
    "constraints": [{"on": "bottom", "direction": axis, "value": 0} for axis in "xy"],
    "tractions": [{"on": "top", "value": [0, 1.0], "ramp": "load"}],
    "mesh": {"h": 0.05}, "runs": {"fem": {"solver": "fem"}},
}  # fmt: skip


@pytest.mark.parametrize("functional", ["AT1", "AT2"])
def test_a_traction_is_followed_from_its_limit_load_until_the_body_is_torn(functional):
    """An advance that finds no equilibrium is shortened; the load leads up to the limit, in its smallest increments."""
    fracture = {"toughness": 0.0027, "length_scale": 0.05, "split": "none", "functional": functional}
    limits, torn = [], 0.0
    for control in ("displacement", "dissipation"):
        load = {"path": [0.0, 1.0], "increment": 0.05, "control": control}
        materials = {"steel": {"young": 210.0, "poisson": 0.3, "fracture": fracture}}
        case = case_from_tables({**PULLED, "materials": materials, "load": load}, tier="standard", run="fem")
        followed = list(increments(FiniteElements(case), case))
        assert followed[-1].status == "broken_through"
        limits.append(max(step.u for step in followed))
        torn = followed[-1].fracture_energy
    assert limits[1] == pytest.approx(limits[0], abs=2 * 0.05 / 64)
    assert torn > 0.9 * 0.0027 * 0.5


def test_a_bar_narrower_than_an_advance_is_followed_back():
    """Its crack takes less than `largest_advance` asks for: an increment of the load would break it through at once."""
    strong, weak = (
        {"young": 210.0, "poisson": 0.0, "fracture": {"toughness": toughness, "length_scale": 0.05}}
        for toughness in (0.0027, 0.0022)
    )
    shapes = {"left": ("strong", 0.0, 0.45), "middle": ("weak", 0.45, 0.55), "right": ("strong", 0.55, 2.0)}
    case = case_from_tables(
        {
            **PULLED, "materials": {"strong": strong, "weak": weak}, "notches": [], "tractions": [], "mesh": {"h": 0.025},
            "bodies": {
                name: {"material": of, "shape": {"rectangle": {"lower": [start, 0.0], "upper": [end, 0.1]}}}
                for name, (of, start, end) in shapes.items()
            },
            "constraints": [
                {"on": "left", "direction": "x", "value": 0}, {"on": "bottom", "direction": "y", "value": 0},
                {"on": "right", "direction": "x", "scale": 1},
            ],
            "load": {"path": [0.0, 0.02], "increment": 1e-3, "smallest": 1e-4, "control": "dissipation"},
        },
        run="fem",
    )  # fmt: skip
    followed = list(increments(FiniteElements(case), case))
    u, last = np.array([step.u for step in followed]), followed[-1]
    assert (np.maximum.accumulate(u) - u).max() > 0.3 * u.max()
    assert last.elastic_energy + last.fracture_energy == pytest.approx(last.external_work, rel=0.06)
