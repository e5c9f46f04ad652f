"""The fourth-order phase field of explicit finite elements: exact profile, quasi-static solver, window, checkpoint."""

import numpy as np
import pytest
from moving_plate import (
    CUBIC,
    FIBRES,
    GENERAL,
    MOVING,
    PULLED,
    STILL,
    all_steps,
    check_window,
    of_fourth_order,
    plate_case,
    run_to,
)

from cases import CaseError
from fem_reference import ExplicitFiniteElements, FiniteElements
from mpm.explicit.solver import ExplicitMaterialPoints
from physics.phase_field import crack_density
from physics.surface_energy import SurfaceEnergy, profile

ACROSS = CUBIC.replace("60.0", "150.0")


def elements_of(tmp_path, gamma, *texts, h=0.5, width=30.0, **values) -> ExplicitFiniteElements:
    plate = of_fourth_order(gamma).replace("h = 0.5", f"h = {h}").replace("[30.0, 20.0]", f"[{width}, 20.0]")
    return ExplicitFiniteElements(plate_case(tmp_path, plate, *texts, run="fem", **values))


@pytest.mark.parametrize("gamma", [GENERAL, CUBIC, CUBIC.replace("60.0", "15.0")])
def test_energy_and_profile_of_a_straight_crack_are_exact(tmp_path, gamma):
    """Two columns of broken points clamp c = c' = 0 on the line between them (Eq. 5.11), up to the square of their gap.

    h = l0 / 2. Where the axes are askew the free ends of the crack are felt in its middle: 0.2 % of the energy.
    """
    body = elements_of(tmp_path, gamma, MOVING, h=0.25)
    field, fracture = body._phase_field, body.case.materials["glass"].fracture
    x, y = np.moveaxis(body.basis.gauss_points, -1, 0)
    distance, history = np.abs(x - 15.0), np.zeros(x.shape)
    history[distance < 1.5 * distance.min()] = 1e5 * fracture.toughness
    field.solve(history, np.full(len(x), np.inf), 0.0)
    values = field.points
    inner, surface = np.abs(y - 10.0) < 1.0, SurfaceEnergy.of(fracture)
    density = crack_density(values.value, values.slope_squared, fracture.length_scale, values.curvature_squared)
    energy = fracture.toughness * (density * body.basis.volume)[inner].sum() / 2.0
    assert energy == pytest.approx(float(surface.energy(np.pi / 2)), rel=0.003)
    exact = profile(distance[inner] / fracture.length_scale, float(surface.directional_gamma(np.pi / 2)))[0]
    assert np.abs(values.value[inner] - exact).max() < 0.006


@pytest.mark.parametrize("gamma", [GENERAL, FIBRES])
def test_the_first_phase_field_is_that_of_the_quasi_static_solver(tmp_path, gamma):
    """The same equations on the same points, solved directly in both: round-off of an ill-conditioned matrix is left."""
    body = elements_of(tmp_path, gamma, MOVING, PULLED)
    body.balance()
    reference = FiniteElements(plate_case(tmp_path, of_fourth_order(gamma), STILL, run="fem"))
    expected = reference.solve_phase_field(reference.history_field)
    assert expected.min() < 0.05
    np.testing.assert_allclose(body.fields().phase_field, expected, atol=1e-7)
    np.testing.assert_allclose(body.fields().grid_phase_field, reference.fields().grid_phase_field, atol=1e-7)
    assert body.balance().fracture == pytest.approx(reference.energies()[1], rel=1e-7)


def first_energy(tmp_path, gamma) -> float:
    return elements_of(tmp_path, gamma, MOVING).balance().fracture


def test_a_cubic_material_turned_by_a_quarter_is_the_same_and_by_less_is_not(tmp_path):
    energy = first_energy(tmp_path, CUBIC)
    assert first_energy(tmp_path, ACROSS) == pytest.approx(energy, rel=1e-9), "round-off"
    assert abs(first_energy(tmp_path, CUBIC.replace("60.0", "20.0")) / energy - 1.0) > 0.05


def test_a_notch_takes_the_energy_that_material_points_give_it(tmp_path):
    """Bases and points of their own, one cell for l0."""
    points = ExplicitMaterialPoints(plate_case(tmp_path, of_fourth_order(GENERAL), MOVING))
    assert first_energy(tmp_path, GENERAL) == pytest.approx(points.balance().fracture, rel=0.015)


def test_a_window_gives_the_fracture_energy_of_the_whole(tmp_path):
    moving = MOVING.replace("16.0", "9.0")
    check_window(
        lambda tolerance: elements_of(tmp_path, GENERAL, moving, PULLED, width=20.0, tolerance=tolerance), 0.002, 5e-3
    )


def test_a_run_goes_on_from_its_checkpoint(tmp_path):
    """To round-off: the direct solver's sums may depend on where its arrays lie."""
    moving = MOVING.replace("16.0", "6.0")
    whole = elements_of(tmp_path, GENERAL, moving, PULLED, width=20.0)
    n = all_steps(whole)
    run_to(whole, 0, n // 2)
    saved = {name: np.array(array) for name, array in whole.checkpoint().items()}
    run_to(whole, n // 2, n)
    resumed = elements_of(tmp_path, GENERAL, moving, PULLED, width=20.0)
    resumed.restore(saved)
    run_to(resumed, n // 2, n)
    np.testing.assert_allclose(resumed.motion.displacement, whole.motion.displacement, rtol=0, atol=1e-12)
    np.testing.assert_allclose(resumed.fields().phase_field, whole.fields().phase_field, rtol=0, atol=1e-10)
    assert resumed.balance().total == pytest.approx(whole.balance().total, rel=1e-10)


def test_triangles_have_no_smooth_basis(tmp_path):
    plate = of_fourth_order(GENERAL).replace("h = 0.5", 'h = 0.5, element = "triangle"')
    with pytest.raises(CaseError, match=r'axis-parallel rectangles.*element = "quad"'):
        ExplicitFiniteElements(plate_case(tmp_path, plate, MOVING, run="fem"))
