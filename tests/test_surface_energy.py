"""Surface energy of the fourth-order phase field: exact profile, extremes in print, rotation, forbidden directions."""

import numpy as np
import pytest
from scipy.integrate import quad

from cases import CaseError
from cases.material import Fracture
from physics.surface_energy import SurfaceEnergy, curvature_operator, profile, rotation

CUBIC = {"gamma_1111": 1.0, "gamma_2222": 1.0, "gamma_1212": 74.0}
GENERAL = {
    "gamma_1111": 5.0,
    "gamma_2222": 2.0,
    "gamma_1122": 0.7,
    "gamma_1212": 11.0,
    "gamma_1112": 1.5,
    "gamma_2212": -0.8,
}
ANGLES = np.linspace(0.0, np.pi, 37)
# Toughness, entries, least and largest in print, and the last printed digit.
IN_PRINT = {
    "Table 5.1, cubic": (0.5, CUBIC, 0.7071, 1.1575),
    "Table 5.1, orthotropic": (0.5, {**CUBIC, "gamma_1111": 20.0}, 0.7071, 1.2292),
    "Table 6.2, cubic": (0.002121, CUBIC, 0.003, 0.0049),
    "Table 6.2, orthotropic": (0.002121, {**CUBIC, "gamma_2222": 80.0}, 0.003, 0.0067),
    "Table 6.4": (7.5, {**CUBIC, "gamma_1111": 80.0}, 10.6066, 23.6892),
    "Table 6.7": (4.175, {**CUBIC, "gamma_2222": 2900.0}, 5.9067, 30.9044),
}


def fracture(gamma, toughness=1.0, **more):
    return Fracture(toughness=toughness, length_scale=1.0, order=4, gamma=gamma, **more)


def profile_energy(gamma):
    """Eq. 5.17 for l0 = 1 and Ḡc = 1, by quadrature."""

    def density(x):
        c, slope, bend = profile(x, gamma)
        return float((c - 1.0) ** 2 / 4.0 + slope**2 + gamma * bend**2)

    return 2.0 * (quad(density, 0.0, 5.0)[0] + quad(density, 5.0, 400.0, limit=400)[0])


@pytest.mark.parametrize("gamma", [0.0, 1e-3, 0.3, 1.0, 1.0 + 1e-9, 19.0, 2900.0])
def test_profile_solves_its_equation_and_holds_the_energy_in_closed_form(gamma):
    x, step = np.linspace(0.2, 20.0, 80), 1e-3
    c, slope, bend = profile(x, gamma)
    ahead, behind = profile(x + step, gamma), profile(x - step, gamma)
    fourth = (ahead[2] - 2.0 * bend + behind[2]) / step**2
    assert np.abs(c - 1.0 - 4.0 * bend + 4.0 * gamma * fourth).max() < 1e-4
    assert slope == pytest.approx((ahead[0] - behind[0]) / (2 * step), abs=1e-6)
    assert bend == pytest.approx((ahead[1] - behind[1]) / (2 * step), abs=1e-5)
    at_crack = profile(0.0, gamma)
    assert float(at_crack[0]) == pytest.approx(0.0, abs=1e-12)
    assert float(at_crack[1]) == pytest.approx(0.5 if gamma == 0.0 else 0.0, abs=1e-12)
    assert profile_energy(gamma) == pytest.approx(np.sqrt(1.0 + np.sqrt(gamma)), rel=1e-7)


@pytest.mark.parametrize("name", IN_PRINT)
def test_extremes_are_those_of_the_exact_profile_and_of_print(name):
    toughness, entries, least, largest = IN_PRINT[name]
    energy = SurfaceEnergy.of(fracture(entries, toughness))
    for (value, theta), printed in zip(energy.extremes(), (least, largest), strict=True):
        gamma = float(energy.directional_gamma(theta))
        assert value == pytest.approx(toughness * profile_energy(gamma), rel=1e-3)
        assert value == pytest.approx(printed, rel=1e-2)
    assert energy.energy(ANGLES).min() >= energy.extremes()[0][0] * (1 - 1e-12)
    assert energy.energy(ANGLES).max() <= energy.extremes()[1][0] * (1 + 1e-12)


@pytest.mark.parametrize("entries", [CUBIC, GENERAL])
def test_orientation_turns_the_surface_energy(entries):
    as_it_is = SurfaceEnergy.of(fracture(entries))
    turned = SurfaceEnergy.of(fracture(entries, orientation=33.0))
    assert turned.energy(ANGLES + np.radians(33.0)) == pytest.approx(as_it_is.energy(ANGLES))


def test_rotation_in_print_does_not_turn_the_surface_energy():
    """Eq. C.12 fits a form in (c,11, c,22, 2 c,12), but Eqs. 5.9 and 5.13 count the mixed derivative once."""
    gamma, turn = fracture(CUBIC).gamma.matrix(), np.radians(30.0)
    printed = SurfaceEnergy(1.0, rotation(-turn) @ gamma @ rotation(-turn).T)
    right = SurfaceEnergy(1.0, rotation(-turn).T @ gamma @ rotation(-turn))
    exact = SurfaceEnergy(1.0, gamma).extremes()[1][0]
    assert right.extremes()[1][0] == pytest.approx(exact, rel=1e-9)
    assert abs(printed.extremes()[1][0] / exact - 1.0) > 0.2


def test_directional_gamma_is_the_form_of_a_straight_crack():
    """A field that varies only across a crack along θ, differentiated in x and y, gives γ_θ (Eq. 5.9)."""
    operator = curvature_operator(fracture(GENERAL, orientation=-20.0))
    for theta in ANGLES:
        across = np.array([-np.sin(theta), np.cos(theta)])
        curvature = np.array([across[0] ** 2, across[1] ** 2, across[0] * across[1]])
        exact = SurfaceEnergy.of(fracture(GENERAL, orientation=-20.0)).directional_gamma(theta)
        assert np.sum((operator @ curvature) ** 2) == pytest.approx(float(exact))


def test_isotropic_tensor_knows_no_direction():
    energy = SurfaceEnergy.of(Fracture(toughness=0.5, length_scale=1.0, order=4))
    assert energy.energy(ANGLES) == pytest.approx(0.5 * np.sqrt(2.0))
    assert energy.is_convex
    second = SurfaceEnergy.of(Fracture(toughness=0.5, length_scale=1.0))
    assert second.energy(ANGLES) == pytest.approx(0.5)
    assert second.stiffness(ANGLES) == pytest.approx(0.5)


@pytest.mark.parametrize("entries", [CUBIC, GENERAL])
def test_surface_stiffness_is_the_second_derivative_and_the_energy(entries):
    energy, step = SurfaceEnergy.of(fracture(entries)), 1e-4
    second = (energy.energy(ANGLES + step) - 2.0 * energy.energy(ANGLES) + energy.energy(ANGLES - step)) / step**2
    assert energy.stiffness(ANGLES) == pytest.approx(second + energy.energy(ANGLES), rel=1e-4, abs=1e-4)


def test_forbidden_directions_of_the_two_examples_in_print():
    """Figs. 5.10-5.13: cubic with γ_1212 = 74 is not convex, with γ_1212 = 0 it is."""
    strong = SurfaceEnergy.of(fracture(CUBIC, 0.5))
    intervals = np.degrees(strong.forbidden())
    assert intervals.shape == (2, 2)
    assert intervals.mean(axis=1) == pytest.approx([45.0, 135.0])
    assert not strong.is_convex
    assert SurfaceEnergy.of(fracture({**CUBIC, "gamma_1212": 0.0}, 0.5)).is_convex


def test_mistakes_in_the_fracture_table_are_told(variant):
    with pytest.raises(CaseError, match=r"fracture.gamma' has a negative energy .* no negative eigenvalue"):
        variant(
            "sen_tension", materials={"steel": {"fracture": {"order": 4, "gamma": {"gamma_1111": 1, "gamma_2222": -1}}}}
        )
    with pytest.raises(CaseError, match=r"orientation' .*no effect with order 2; set order = 4"):
        variant("sen_tension", materials={"steel": {"fracture": {"orientation": 20}}})
    with pytest.raises(CaseError, match=r"mpm.order' = 1 has no second derivatives.*; set it to 2 or 3"):
        variant("sen_tension", materials={"steel": {"fracture": {"order": 4}}}, mpm={"order": 1})


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("entries", "weak"),
    [
        ({"gamma_1111": 0.0, "gamma_2222": 1.0}, [90.0]),
        ({"gamma_1111": 0.0, "gamma_2222": 0.0, "gamma_1212": 1.0}, [0.0, 90.0]),
    ],
)
def test_a_direction_without_gamma_is_a_kink_of_the_energy(entries, weak):
    """γ may be semidefinite: the energy has its least value at a kink, where the stiffness is infinite."""
    energy = SurfaceEnergy.of(fracture(entries))
    assert np.degrees(energy.weak_directions()) == pytest.approx(weak) and energy.is_convex
    stiffness = energy.stiffness(np.radians([*weak, 30.0, 60.0]))
    assert np.isinf(stiffness[:-2]).all() and (stiffness[-2:] > 0.0).all()
