"""The functional AT1: its coefficients, its threshold, its bound, and where it is refused."""


import numpy as np
import pytest

from cases import CaseError
from numerics.costs import Costs
from numerics.phase_field_equation import PhaseFieldEquation
from physics.elasticity import MaterialTable
from physics.exact import SOLUTIONS
from physics.phase_field import PhaseFieldCoefficients
from physics.surface_energy import seen_toughness
from verify.planning.plan import plan

LINEAR = {"steel": {"fracture": {"functional": "AT1"}}}


def test_a_bar_is_whole_up_to_the_strength(variant):
    case = variant("homogeneous_bar", materials=LINEAR)
    steel, length, section = case.materials["steel"], 0.5, 0.25
    strength = np.sqrt(3.0 * steel.fracture.toughness * steel.young / (16.0 * steel.fracture.length_scale))
    force = SOLUTIONS["homogeneous_bar"].force
    at_peak = strength / steel.young * length
    assert force(case, at_peak) == pytest.approx(strength * section)
    assert force(case, 0.5 * at_peak) == pytest.approx(0.5 * strength * section)
    assert force(case, 1.01 * at_peak) == pytest.approx(strength * section / 1.01**3)


def test_the_profile_ends_and_costs_half_of_the_toughness_by_the_coefficients_energy(variant):
    case = variant("bar_profile", materials=LINEAR)
    fracture = case.materials["steel"].fracture
    x = (np.arange(40_000) + 0.5) * 1e-4 * fracture.length_scale
    profile = SOLUTIONS["crack_profile"].phase_field
    shift = np.column_stack([np.full_like(x, 1e-6 * fracture.length_scale), 0.0 * x])
    points = np.column_stack([x, 0.0 * x])
    c = profile(case, points, 0.0)
    slope = (profile(case, points + shift, 0.0) - c) / shift[0, 0]
    energy = PhaseFieldCoefficients(MaterialTable(case), np.zeros(len(x), int)).energy_density(c, slope**2, 0.0 * x)
    assert energy.sum() * 1e-4 * fracture.length_scale == pytest.approx(0.5 * fracture.toughness, rel=1e-4)
    assert profile(case, np.array([[4.1 * fracture.length_scale, 0.0]]), 0.0) == 1.0
    assert seen_toughness(fracture, fracture.length_scale) == pytest.approx(fracture.toughness * 19.0 / 16.0)
    told = f"raised by 3 h / (16 l0) = {300.0 * case.mesh.h / (16.0 * fracture.length_scale):.2g} %"
    assert any(told in note for note in plan(case, next(iter(case.run_specs()))).notes)


def test_unknowns_stay_at_the_bound_while_they_are_pushed_and_leave_it_when_pulled():
    """Springs in a row: -c'' = source, c(0) = 0, c <= 1; the solution is a parabola that touches 1 where it is level."""
    n, source = 40, 0.02
    cells = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    free = np.arange(n + 1) > 0
    equation = PhaseFieldEquation(cells, free, Costs(), is_bounded=True)
    nodal = np.where(free, 1.0, 0.0)
    equation.systems.matrices[:] = [1.0, -1.0, 1.0]
    slope = np.diff(nodal)
    equation.systems.vectors[:] = source / 2.0 + np.column_stack([slope, -slope])
    found = equation.corrected(nodal)
    touches = np.argmax(found == 1.0)
    assert found.max() == 1.0 and touches == 10
    k = np.arange(touches)
    assert found[:touches] == pytest.approx(1.0 - source / 2.0 * (touches - k) ** 2, abs=2e-2)
    bend = found[:-2] - 2.0 * found[1:-1] + found[2:]
    assert bend[: touches - 1] == pytest.approx(-source)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"materials": {"glass": {"fracture": {"functional": "AT1"}}}}, "fracture.functional.*quasi-static cases only"),
        ({"materials": {"glass": {"fracture": {"functional": "AT3"}}}}, "functional"),
    ],
)
def test_it_is_refused_in_dynamics(variant, tables, message):
    with pytest.raises(CaseError, match=message):
        variant("plate_impact", **tables)
