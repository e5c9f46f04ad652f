"""The shared laws, checked on their own: stress = d psi / d strain and tangent = d stress / d strain."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from physics.elasticity import SPLIT_CODES, Law, in_plane_first_lame
from physics.energy_splits import responses
from physics.splits import GAMMA

LAM, MU = 121.15, 80.77
SPLITS = sorted(SPLIT_CODES)
STAR_AND_VOLUMETRIC = ("star_convex", "volumetric_deviatoric")
#: equal eigenvalues, all tension, all compression, uniaxial, pure shear, nearly equal eigenvalues
SPECIAL = np.array(
    [
        [1e-3, 1e-3, 0.0], [-1e-3, -1e-3, 0.0], [2e-3, 1e-3, 5e-4], [-2e-3, -1e-3, 5e-4], [1e-3, 0.5e-3, 0.0],
        [1e-3, -0.4e-3, 0.0], [0.0, 0.0, 1e-3], [1e-3, 1e-3 + 1e-9, 0.0], [0.3e-3, -1e-3, -2e-3],
    ]
)  # fmt: skip


def energy(split, g, strain):
    energies, _, _ = responses(Law.isotropic(split, LAM, MU), g, strain)
    return g * energies[:, 0] + energies[:, 1]


def central_difference(function, strain, step=1e-8):
    columns = []
    for k in range(3):
        shift = np.zeros(3)
        shift[k] = step
        columns.append((function(strain + shift) - function(strain - shift)) / (2 * step))
    return np.stack(columns, axis=-1)


def away_from_kinks(strain, margin=1e-6):
    """Strains whose trace, eigenvalues and first stress are not within the difference step of a change of sign."""
    mean, radius = strain[:, :2].mean(1), np.hypot(0.5 * (strain[:, 0] - strain[:, 1]), 0.5 * strain[:, 2])
    first = 2.0 * LAM * mean + 2.0 * MU * (mean + radius)
    parts = (mean, mean + radius, mean - radius, first / LAM)
    return strain[np.all([abs(part) > margin for part in parts], axis=0)]


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("g_value", [1.0, 0.37, 0.0])
def test_stress_and_tangent_are_derivatives(split, g_value):
    random = np.random.default_rng(3).normal(scale=1e-3, size=(400, 3))
    strain = np.vstack([away_from_kinks(random), away_from_kinks(SPECIAL)])
    g = np.full(len(strain), g_value)
    _, stress, tangent = responses(Law.isotropic(split, LAM, MU), g, strain)
    numerical_stress = central_difference(lambda e: energy(split, g, e), strain)
    numerical_tangent = central_difference(lambda e: responses(Law.isotropic(split, LAM, MU), g, e)[1], strain)
    assert np.abs(stress - numerical_stress).max() < 1e-7 * LAM
    assert np.abs(tangent - numerical_tangent).max() < 1e-5 * LAM


@pytest.mark.parametrize("split", SPLITS)
def test_undamaged_law_is_hooke(split):
    strain = np.vstack([np.random.default_rng(0).normal(scale=1e-3, size=(50, 3)), SPECIAL, np.zeros((1, 3))])
    hooke = np.array([[LAM + 2 * MU, LAM, 0], [LAM, LAM + 2 * MU, 0], [0, 0, MU]])
    energies, stress, tangent = responses(Law.isotropic(split, LAM, MU), np.ones(len(strain)), strain)
    assert np.allclose(stress, strain @ hooke, rtol=1e-12, atol=1e-15)
    assert np.allclose(tangent, hooke, rtol=1e-10)
    assert np.allclose(energies.sum(1), 0.5 * np.einsum("pi,ij,pj->p", strain, hooke, strain), rtol=1e-12)


@given(st.tuples(*[st.floats(-0.01, 0.01)] * 3), st.floats(0, 1))
@settings(max_examples=200, deadline=None)
def test_energy_is_split_into_two_parts_that_are_never_negative(strain, g):
    for split in SPLITS:
        energies, _, tangent = responses(Law.isotropic(split, LAM, MU), np.array([g]), np.array([strain]))
        assert split == "star_convex" or energies.min() > -1e-14 * LAM
        assert (np.array([[g, 1.0]]) * energies).sum() > -1e-14 * LAM
        assert np.linalg.eigvalsh(tangent[0]).min() > -1e-9 * LAM


def test_compression_does_not_drive_fracture():
    compression = np.array([[-1e-3, -1e-3, 0.0]])
    for split in ("no_tension", "spectral", "volumetric_deviatoric"):
        energies, stress, _ = responses(Law.isotropic(split, LAM, MU), np.zeros(1), compression)
        assert energies[0, 0] == 0
        assert stress[0, 0] == pytest.approx(-2e-3 * (LAM + MU))


def test_pressure_holds_back_the_star_convex_split_and_makes_it_stiffer():
    pressed = np.array([[-1e-3, -1e-3, 0.0]])
    energies, stress, _ = responses(Law.isotropic("star_convex", LAM, MU), np.zeros(1), pressed)
    volumetric = 0.5 * (LAM + MU) * 4e-6
    assert energies[0] == pytest.approx([-GAMMA * volumetric, (1.0 + GAMMA) * volumetric])
    assert stress[0, 0] == pytest.approx(-2e-3 * (1.0 + GAMMA) * (LAM + MU))


def test_star_convex_and_volumetric_splits_are_one_but_under_pressure():
    strain = np.array([[2e-3, -1e-3, 1e-3], [1e-4, 0.0, 1e-3]])
    ours, known = (responses(Law.isotropic(split, LAM, MU), np.full(2, 0.3), strain) for split in STAR_AND_VOLUMETRIC)
    assert all(np.allclose(one, other, rtol=1e-14) for one, other in zip(ours, known, strict=True))


def test_broken_material_without_tension_is_a_bar_along_its_crack():
    """Free of stress across; along it Young's modulus of the plane; in shear the struts under the pressure alone."""
    young = 4.0 * MU * (LAM + MU) / (LAM + 2.0 * MU)
    strain = np.array([[3e-3, -1e-3, 0.0], [1e-3, 2e-3, 0.0], [0.0, 0.0, 2e-3]])
    energies, stress, _ = responses(Law.isotropic("no_tension", LAM, MU), np.zeros(3), strain)
    assert stress[0] == pytest.approx([0.0, -1e-3 * young, 0.0], abs=1e-15)
    assert energies[0, 1] == pytest.approx(0.5e-6 * young)
    assert stress[1] == pytest.approx([0.0, 0.0, 0.0], abs=1e-15)
    assert energies[2] == pytest.approx([2e-6 * MU - 0.5e-6 * young, 0.5e-6 * young])
    assert stress[2] == pytest.approx(0.5e-3 * young * np.array([-1.0, -1.0, 1.0]))


def test_uniaxial_tension_drives_fracture_with_the_energy_of_a_bar():
    """At plane stress: sigma^2 / 2 E, from which the contraction's own goes where no tension may be left."""
    plane = in_plane_first_lame(LAM, MU, "stress")
    contraction = plane / (plane + 2.0 * MU)
    strain = np.array([[1e-3, -contraction * 1e-3, 0.0]])
    bar = 0.5e-6 * 4.0 * MU * (plane + MU) / (plane + 2.0 * MU)
    shares = {"none": 1.0, "no_tension": 1.0 - contraction**2, "star_convex": 1.0, "volumetric_deviatoric": 1.0}
    for split, share in shares.items():
        assert responses(Law.isotropic(split, plane, MU), np.ones(1), strain)[0][0, 0] == pytest.approx(share * bar)


def test_plane_stress_leaves_youngs_modulus_in_uniaxial_tension():
    young, poisson = 210.0, 0.3
    lam, mu = young * poisson / (1 + poisson) / (1 - 2 * poisson), young / 2 / (1 + poisson)
    plane = in_plane_first_lame(lam, mu, "stress")
    stress = responses(Law.isotropic("none", plane, mu), np.ones(1), np.array([[1e-3, -poisson * 1e-3, 0.0]]))[1][0]
    assert stress == pytest.approx([young * 1e-3, 0, 0], abs=1e-12)


def test_a_bar_in_plane_stress_is_driven_by_the_strain_across_it_or_not():
    """Uniaxial extension e: lambda/2 (1 - 2 nu)^2 + mu of e^2 with three strains, lambda*/2 (1 - nu)^2 + mu with two."""
    poisson, mu = 0.3, 100.0
    lam = 2.0 * mu * poisson / (1.0 - 2.0 * poisson)
    plane, strain = in_plane_first_lame(lam, mu, "stress"), np.array([[1e-3, -poisson * 1e-3, 0.0]])
    three, two = (
        responses(Law.isotropic(split, plane, mu), np.ones(1), strain)[0][0]
        for split in ("spectral_plane_stress", "spectral")
    )
    assert three[0] == pytest.approx((0.5 * lam * (1.0 - 2.0 * poisson) ** 2 + mu) * 1e-6)
    assert two[0] == pytest.approx((0.5 * plane * (1.0 - poisson) ** 2 + mu) * 1e-6)
    assert three.sum() == pytest.approx(two.sum())
    assert three[1] == pytest.approx(2.0 * mu * poisson**2 * 1e-6)


def test_pressed_plane_stress_opens_across():
    """Under biaxial pressure the third strain grows and drives fracture; the broken plate keeps the plane's own part."""
    plane = in_plane_first_lame(LAM, MU, "stress")
    law, pressed = Law.isotropic("spectral_plane_stress", plane, MU), np.array([[-1e-3, -1e-3, 0.0]])
    across = 2e-3 * LAM / (LAM + 2.0 * MU)
    energies, _, _ = responses(law, np.ones(1), pressed)
    assert energies[0, 0] == pytest.approx(MU * across**2)
    _, stress, _ = responses(law, np.zeros(1), pressed)
    assert stress[0, 0] == pytest.approx(-2e-3 * MU)


TENSION = """
from numba import njit
from physics.point_response import PointResponse

@njit(cache=True, inline="always")
def response(g, exx, eyy, gxy, lam, mu):
    f = g if exx + eyy > 0.0 else 1.0
    psi = 0.5 * (lam * (exx + eyy) ** 2 + 2.0 * mu * (exx * exx + eyy * eyy + 0.5 * gxy * gxy))
    return PointResponse(
        psi if f == g else 0.0, 0.0 if f == g else psi,
        f * (lam * (exx + eyy) + 2.0 * mu * exx), f * (lam * (exx + eyy) + 2.0 * mu * eyy), f * mu * gxy,
        f * (lam + 2.0 * mu), f * lam, 0.0, f * (lam + 2.0 * mu), 0.0, f * mu,
    )
"""
USED = """
import numpy as np
from cases import schema_text
from cases.material import Material
from physics.elasticity import Law, in_plane_stiffness
from physics.energy_splits import responses
from physics.splits import SPLIT_CODES

assert '"expansion"' in schema_text()
fracture = {"toughness": 1.0, "length_scale": 1.0, "split": "expansion"}
material = Material(young=3.0, poisson=0.2, fracture=fracture)
stiffness = in_plane_stiffness(material, "stress")
g, strain = np.full(2, 0.25), 1e-3 * np.array([[2.0, -1.0, 0.5], [1.0, -2.0, 0.5]])
for law in (Law.of(material, "stress"), Law.rooted("expansion", stiffness)):
    energies, stress, tangent = responses(law, g, strain)
    for share, ours, bend, e, psi in zip((0.25, 1.0), stress, tangent, strain, energies):
        assert np.allclose(ours, share * stiffness @ e, rtol=1e-12) and np.allclose(bend, share * stiffness)
        assert np.isclose(psi.sum(), 0.5 * e @ stiffness @ e) and psi.min() == 0.0
unknown = law._replace(split=law.split + len(SPLIT_CODES))
assert np.isnan(responses(unknown, g, strain)[1]).all()
"""


def test_a_further_split_is_one_more_file(tmp_path):
    """Cases may name it, and it has a code of its own, with or without a root; a code of no law answers no number."""
    root = Path(__file__).parents[1]
    for package in ("cases", "physics"):
        shutil.copytree(root / package, tmp_path / package, ignore=shutil.ignore_patterns("library", "__pycache__"))
    (tmp_path / "physics/splits/expansion.py").write_text(TENSION, encoding="utf-8")
    done = subprocess.run([sys.executable, "-c", USED], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
