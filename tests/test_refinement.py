"""Fine cells follow the crack, at the answer of a grid that was fine there from the start."""

from functools import cache

import numpy as np
import pytest

from fem_reference import FiniteElements
from mpm import MaterialPoints
from numerics.quasi_static import increments
from numerics.refinement import FollowingDiscretisation

WHOLE = {"lower": [0.4, 0.3], "upper": [1.0, 0.7]}
TIP = {"lower": [0.4, 0.4], "upper": [0.6, 0.6]}
BLUNT = {"steel": {"fracture": {"length_scale": 0.03, "residual_stiffness": 1e-6}}}
LOAD = {"path": [0.0, 0.012], "increment": 1e-3, "smallest": 1e-4}


def case_of(variant, fine, follow, h=0.03, load=LOAD):
    mesh = {"h": h, "coarse": 0.1, "fine": fine, "follow_crack": follow}
    return variant("sen_tension", mesh=mesh, materials=BLUNT, load=load, staggered={"tolerance": 1e-3})


@pytest.fixture(scope="module")
def following(variant):
    """A solver's discretisation whose box has grown, its increments and the cells that it began with."""

    @cache
    def grown(solver):
        discretisation = FollowingDiscretisation(solver, case := case_of(variant, TIP, True))
        cells = discretisation.costs.count["cells"]
        return discretisation, list(increments(discretisation, case)), cells

    return grown


@pytest.mark.parametrize("solver", [FiniteElements, MaterialPoints])
def test_a_small_fine_box_grows_with_the_crack(variant, following, solver):
    from_the_start = list(increments(solver(whole := case_of(variant, WHOLE, False)), whole))
    discretisation, grown, cells = following(solver)
    assert discretisation.costs.count["refinements"] >= 1
    assert discretisation.costs.count["cells"] > cells
    assert grown[-1].status == from_the_start[-1].status == "broken_through"
    peaks = [max(step.F for step in run) for run in (grown, from_the_start)]
    assert peaks[0] == pytest.approx(peaks[1], rel=0.003)
    assert grown[-1].fracture_energy == pytest.approx(from_the_start[-1].fracture_energy, rel=0.03)


def test_a_fine_box_that_misses_the_tip_gets_there_before_it_breaks(variant):
    """Coarse cells at the tip bear a tenth more."""

    def peak(fine, make=FiniteElements, **mesh):
        mesh = {"h": 0.02, "coarse": 0.25, "fine": fine, **mesh}
        load = LOAD | {"path": [0.0, 0.007]}
        case = variant("sen_tension", mesh=mesh, materials=BLUNT, load=load, staggered={"tolerance": 1e-3})
        return max(step.F for step in increments(make(case), case))

    far = {"lower": [0.0, 0.0], "upper": [0.2, 0.2]}
    fine, coarse = peak(WHOLE), peak(far)
    following = peak(far, lambda case: FollowingDiscretisation(FiniteElements, case), follow_crack=True)
    assert coarse > 1.05 * fine and following == pytest.approx(fine, rel=0.01)


@pytest.mark.parametrize("solver", [FiniteElements, MaterialPoints])
def test_a_first_state_that_breaks_has_fine_cells_too(variant, solver):
    def first(fine, follow):
        case = case_of(variant, fine, follow, 0.02, {"path": [0.007], "adaptive": False})
        following = FollowingDiscretisation(solver, case) if follow else solver(case)
        return next(increments(following, case)), following.costs.count["refinements"]

    (from_the_start, _), (grown, refinements) = first(WHOLE, False), first(TIP, True)
    assert refinements >= 1
    assert pytest.approx(from_the_start.F, rel=0.01, abs=1e-3) == grown.F
    assert grown.fracture_energy == pytest.approx(from_the_start.fracture_energy, rel=0.03)


def test_the_grown_box_comes_back_from_a_checkpoint(variant, following):
    grown, *_ = following(FiniteElements)
    restored = FollowingDiscretisation(FiniteElements, case_of(variant, TIP, True))
    restored.restore(grown.checkpoint())
    assert restored.costs.count["cells"] == grown.costs.count["cells"]
    assert np.array_equal(restored.history_field, grown.history_field)
