"""The fourth-order phase field of points that move: exact profile, quasi-static solver, material axes, window."""

import numba
import numpy as np
import pytest
from moving_plate import (
    FLYING,
    GENERAL,
    MOVING,
    PULLED,
    STILL,
    all_steps,
    check_window,
    of_fourth_order,
    plate_case,
    run_to,
)  # fmt: skip

from cases import CaseError
from mpm import MaterialPoints
from mpm.explicit.solver import ExplicitMaterialPoints
from physics.surface_energy import SurfaceEnergy, profile

FOURTH = of_fourth_order(GENERAL)
SHORT = MOVING.replace("end_time = 16.0", "end_time = 4.0")


def points_of(tmp_path, *texts, plate=FOURTH, **values):
    return ExplicitMaterialPoints(plate_case(tmp_path, plate, *texts, **values))


@pytest.mark.parametrize(("order", "limit"), [(2, 0.0065), (3, 0.003)])
def test_energy_and_profile_of_a_straight_crack_are_exact(tmp_path, order, limit):
    """Two columns of broken points clamp c = c' = 0 on the line between them (Eq. 5.11), up to the square of their gap.

    h = l0 / 2; the best quadratic splines themselves miss 0.65 % of the energy.
    """
    text = FOURTH.replace("h = 0.5", "h = 0.25").replace("order = 2,", f"order = {order},")
    text = text.replace("[30.0, 20.0]", "[20.0, 12.0]").replace("notches =", "notches = []#")
    points = points_of(tmp_path, MOVING, plate=text)
    body, fracture = points.bodies[0], points.case.materials["glass"].fracture
    x, y = body.positions().T
    distance = np.abs(x - 10.0)
    body.points.crack.history[distance < 1.5 * distance.min()] = 1e5 * fracture.toughness
    points.phase_fields[0].solve(0.0, everywhere=True)
    inner = np.abs(y - 6.0) < 1.0
    surface = SurfaceEnergy.of(fracture)
    energy = body.points.crack.energy[inner] @ body.points.matter.volume[inner] / 2.0
    assert energy == pytest.approx(float(surface.energy(np.pi / 2)), rel=limit)
    exact = profile(distance[inner] / fracture.length_scale, float(surface.directional_gamma(np.pi / 2)))[0]
    assert np.abs(body.points.crack.c[inner] - exact).max() < 0.006


def test_the_first_phase_field_is_that_of_the_quasi_static_solver(tmp_path):
    moving = points_of(tmp_path, MOVING, PULLED)
    still = MaterialPoints(plate_case(tmp_path, FOURTH, STILL))
    still.begin_step()
    expected = still.solve_phase_field(still.history_field)
    assert expected.min() < 0.05
    np.testing.assert_allclose(moving.fields().phase_field, expected, atol=1e-3)
    assert moving.balance().fracture == pytest.approx(still.energies()[1], rel=1e-4)


def test_material_axes_turn_with_the_points(tmp_path):
    """A quarter turn takes the lattice of points onto itself: nothing may change but by the solution's tolerance."""
    points = points_of(tmp_path, MOVING, FLYING)
    body, before, energy = points.bodies[0], points.fields().phase_field, points.balance().fracture
    middle, motion, lattice = body.positions().mean(axis=0), body.points.motion, body.lattice
    x, y = (body.positions() - middle).T
    turned = np.column_stack([-y, x]) + middle
    motion.x[:], motion.y[:] = ((turned - lattice.origin) / lattice.h - body.window.corner).T
    body.sort()
    points.phase_fields[0].solve(0.0, everywhere=True)
    assert abs(points.balance().fracture / energy - 1.0) > 0.01, "the axes stayed behind and nobody sees it"
    body.points.axes.turn[:] = np.pi / 2
    points.phase_fields[0].solve(0.0, everywhere=True)
    assert points.balance().fracture == pytest.approx(energy, rel=1e-4)
    np.testing.assert_allclose(points.fields().phase_field, before, atol=1e-3)


def test_the_turn_of_a_spinning_body_is_followed(tmp_path):
    spin = "    bodies.plate.velocity_gradient = [[0.0, -0.01], [0.01, 0.0]]\n"
    points = points_of(tmp_path, SHORT, spin)
    run_to(points, 0, all_steps(points))
    turn = points.bodies[0].points.axes.turn
    assert np.median(turn) == pytest.approx(0.01 * 4.0, rel=0.02)


def test_a_window_gives_the_fracture_energy_of_the_whole(tmp_path):
    smaller = FOURTH.replace("[30.0, 20.0]", "[20.0, 20.0]")
    moving = MOVING.replace("end_time = 16.0", "end_time = 12.0")
    check_window(lambda tolerance: points_of(tmp_path, moving, PULLED, plate=smaller, tolerance=tolerance), 0.03)


def test_a_crack_travels_with_its_body(tmp_path):
    points = points_of(tmp_path, SHORT, FLYING)
    before, energy = points.fields(), points.balance().fracture
    run_to(points, 0, all_steps(points))
    after = points.fields()
    np.testing.assert_allclose(after.displacement, np.tile([0.2, 0.08], (len(after.points), 1)), rtol=1e-9)
    np.testing.assert_allclose(after.phase_field, before.phase_field, atol=0.02)
    assert points.balance().fracture == pytest.approx(energy, rel=5e-3)


def test_bits_do_not_depend_on_the_number_of_threads(tmp_path):
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("needs two threads")
    states = []
    for threads in (1, 2):
        numba.set_num_threads(threads)
        points = points_of(tmp_path, MOVING, PULLED)
        run_to(points, 0, 20)
        states.append(points.fields().phase_field)
    assert np.array_equal(*states)


def test_what_has_no_second_derivatives_is_refused(tmp_path):
    with pytest.raises(CaseError, match=r"mpm\.order.*second derivatives"):
        points_of(tmp_path, MOVING, plate=FOURTH.replace("mpm = { order = 2", "mpm = { order = 1"))
