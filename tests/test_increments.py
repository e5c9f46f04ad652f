"""The first state and the elastic prologue are judged like any other increment; what cannot break has no phase field."""

from itertools import pairwise

import pytest

from cases import CaseError
from fem_reference import FiniteElements
from mpm import MaterialPoints
from numerics.quasi_static import TOO_FAR, increments
from verify import run

COARSE = {"h": 0.04, "coarse": 0.1, "fine": {"lower": [0.4, 0.4], "upper": [1.0, 0.6]}}
BLUNT = {"steel": {"fracture": {"length_scale": 0.04, "residual_stiffness": 1e-6}}}
SOLVERS = {"fem": FiniteElements, "mpm": MaterialPoints}
BREAKS_AT = 0.0063


def notched(variant, solver="fem", load=None, staggered=None, **changes):
    """The notched plate, coarse; it breaks at a displacement of ``BREAKS_AT``."""
    load = {"path": [0.0, 0.008], "increment": 1e-3, "smallest": 1e-4, "largest_advance": 2.0, **(load or {})}
    staggered = {"tolerance": 1e-3, **(staggered or {})}
    return variant("sen_tension", solver, mesh=COARSE, materials=BLUNT, load=load, staggered=staggered, **changes)


def march(case):
    discretisation = SOLVERS[case.run](case)
    return list(increments(discretisation, case)), discretisation


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_prologue_in_which_the_crack_runs_is_undone_and_the_path_followed(variant, solver):
    at_once, discretisation = march(notched(variant, solver, load={"prologue": 0.9}))
    in_increments, _ = march(notched(variant, solver))
    assert at_once[1].u == 1e-3, "the crack ran in the prologue"
    assert at_once[-1].status == in_increments[-1].status == "broken_through"
    peaks = [max(step.F for step in followed) for followed in (at_once, in_increments)]
    assert peaks[0] == pytest.approx(peaks[1], rel=1e-6)
    assert discretisation.costs.count["undone_increments"] >= 1


def test_a_prologue_that_does_not_converge_is_undone(variant):
    load = {"prologue": 0.5, "adaptive": False, "path": [0.0, 0.008], "increment": 1e-3, "smallest": 1e-3}
    followed, _ = march(notched(variant, load=load, staggered={"largest_iterations": 3}))
    assert followed[1].u == 1e-3
    assert followed[-1].status == "no_convergence"


def test_a_prologue_in_which_nothing_breaks_is_taken_at_once(variant):
    followed, discretisation = march(notched(variant, load={"prologue": 0.5, "path": [0.0, 0.004]}))
    assert followed[1].u == 0.002
    assert discretisation.costs.count["undone_increments"] == 0


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_first_state_that_does_not_converge_is_reported(variant, solver, tmp_path):
    load = {"path": [0.005, 0.006], "largest_advance": 100.0}
    case = notched(variant, solver, load=load, staggered={"largest_iterations": 2})
    followed, discretisation = march(case)
    assert len(followed) == 1
    assert followed[0].status == "no_convergence"
    assert "in the first state, u = 0.005" in followed[0].reason
    assert discretisation.phase_field.min() == pytest.approx(1.0), "the state was not undone"
    folder = run(case, solver, out=tmp_path)
    assert folder.info["status"] == "no_convergence"
    assert folder.info["reason"] == followed[0].reason
    assert not len(folder.history)


def test_a_first_state_in_which_the_crack_runs_is_refused(variant):
    followed, _ = march(notched(variant, load={"path": [1.5 * BREAKS_AT, 2 * BREAKS_AT]}))
    assert len(followed) == 1
    assert followed[0].status == "no_convergence"
    assert followed[0].reason.startswith(TOO_FAR)


@pytest.mark.parametrize("start", [0.0, 0.002])
def test_a_first_state_is_not_charged_with_the_notch(variant, start):
    """A notch in the history field alone has more fracture energy than an increment may add."""
    notch = {"kind": "history", "start": [0.0, 0.5], "end": [0.5, 0.5], "factor": 1000.0}
    load = {"path": [start, 0.003], "largest_advance": 0.5}
    followed, discretisation = march(notched(variant, load=load, notches=[notch]))
    assert followed[0].fracture_energy > 5.0 * 0.5 * 0.0027 * 0.04
    assert followed[-1].status == "complete"
    assert discretisation.phase_field.min() < 0.1


def bar(variant, solver, newtons=False, **mpm):
    """A bar of 30 x 2 cells whose middle third can break, in kN and mm or in N and mm."""
    force = 1e3 if newtons else 1.0
    elastic = {"young": 210.0 * force, "poisson": 0.3}
    fracture = {"toughness": 0.0027 * force, "length_scale": 0.2, "split": "none", "residual_stiffness": 1e-6}

    def part(left, material):
        return {"material": material, "shape": {"rectangle": {"lower": [left, 0.0], "upper": [left + 1.0, 0.2]}}}

    return variant(
        "sen_tension", solver, units={"force": "N" if newtons else "kN", "length": "mm"}, notches=[],
        bodies={"plate": part(1.0, "steel"), "left": part(0.0, "rigid"), "right": part(2.0, "rigid")},
        materials={"steel": {**elastic, "fracture": fracture}, "rigid": elastic},
        mesh={"h": 0.1, "coarse": 0.1, "fine": {"lower": [0.0, 0.0], "upper": [3.0, 0.2]}},
        boundaries={"left": {"edge": "left"}, "right": {"edge": "right"}, "bottom": {"edge": "bottom"}},
        constraints=[
            {"on": "left", "direction": "x", "value": 0.0}, {"on": "right", "direction": "x", "scale": 1.0},
            {"on": "bottom", "direction": "y", "value": 0.0},
        ], load={"path": [0.0, 0.005], "increment": 2.5e-3, "adaptive": False, "smallest": 2.5e-3}, mpm=mpm,
    )  # fmt: skip


@pytest.mark.parametrize("solver", SOLVERS)
def test_what_cannot_break_has_no_phase_field(variant, solver):
    followed, discretisation = march(bar(variant, solver, move_points=False))
    count, fields = discretisation.costs.count["unknowns_phase_field"], discretisation.fields()
    # in the MPM two rings of empty cells more, so that points can wander
    assert count == 33 if solver == "fem" else count < 0.6 * discretisation.costs.count["unknowns_displacement"] / 2
    whole = fields.body > 0
    assert (fields.phase_field[whole] == 1.0).all()
    assert fields.phase_field[~whole].max() < 0.97, "the middle ends without flux"
    assert followed[-1].fracture_energy > 0.0


@pytest.mark.parametrize("solver", SOLVERS)
def test_what_cannot_break_does_not_hold_the_phase_field_by_its_units(variant, solver):
    forces = [march(bar(variant, solver, newtons, move_points=False))[0][-1].F for newtons in (False, True)]
    assert forces[1] == pytest.approx(1e3 * forces[0], rel=1e-6)


@pytest.mark.parametrize("adaptive", [False, True])
def test_each_leg_of_the_path_has_its_increment(variant, adaptive):
    load = {"path": [0.0, 0.001, 0.002, 0.0], "increment": 5e-4, "later_increments": [1e-4, 1e-3], "smallest": 1e-4}
    followed, _ = march(notched(variant, load={**load, "adaptive": adaptive}))
    sizes = [round(abs(after.u - before.u), 12) for before, after in pairwise(followed)]
    assert sizes[:12] == [5e-4] * 2 + [1e-4] * 10
    assert (sizes[12:] == [1e-3] * 2) != adaptive
    assert min(sizes[12:-1]) >= 1e-4
    assert 2e-4 < max(sizes[12:]) <= 1e-3, "they grow where they are adaptive"
    assert sum(sizes[12:]) == pytest.approx(0.002)


@pytest.mark.parametrize(
    ("later", "said"),
    [
        ([1e-4, 1e-4], "later_increments.*give 1, one for each leg after the first"),
        ([2e-3], r"later_increments\[0\].*longer than its leg"),
    ],
)
def test_increments_that_do_not_fit_the_path_are_refused(variant, later, said):
    with pytest.raises(CaseError, match=said):
        notched(variant, load={"path": [0.0, 0.001, 0.002], "increment": 5e-4, "later_increments": later})
