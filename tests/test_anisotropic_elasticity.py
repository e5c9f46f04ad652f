"""Anisotropic elasticity and the energy-orthogonal split: the law, what files may say, both solvers, exact results."""

import tomllib

import numpy as np
import pytest

from cases import CaseError, case_from_tables, load_case
from cases.material import Fracture, Material, Stiffness
from fem_reference import FiniteElements
from mpm import MaterialPoints
from numerics.quasi_static import increments
from physics.elasticity import Law, MaterialTable, in_plane_stiffness
from physics.energy_splits import responses
from physics.surface_energy import rotation
from verify.studies.krylov import CrackedBody

SOLVERS = [FiniteElements, MaterialPoints]
LAMINA = {"young_1": 140.0, "young_2": 10.0, "poisson_12": 0.3, "shear_modulus_12": 5.0}
GENERAL = {"C11": 90.0, "C22": 30.0, "C66": 12.0, "C12": 8.0, "C16": 10.0, "C26": -4.0}


def random_stiffnesses(count=20):
    """Symmetric positive definite matrices whose eigenvalues span two decades."""
    random = np.random.default_rng(1)
    for _ in range(count):
        axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
        yield axes @ np.diag(10.0 ** random.uniform(0, 2, 3)) @ axes.T


def random_strains(count=200):
    return np.random.default_rng(2).normal(scale=1e-3, size=(count, 3))


@pytest.mark.parametrize("split", ["none", "orthogonal"])
def test_undamaged_law_is_that_of_the_stiffness(split):
    strain = random_strains()
    for stiffness in random_stiffnesses():
        energies, stress, tangent = responses(Law.rooted(split, stiffness), np.ones(len(strain)), strain)
        assert np.allclose(stress, strain @ stiffness, rtol=1e-12, atol=1e-12)
        assert np.allclose(tangent, stiffness, rtol=1e-10, atol=1e-10)
        assert np.allclose(energies.sum(1), 0.5 * np.einsum("pi,ij,pj->p", strain, stiffness, strain), rtol=1e-12)


@pytest.mark.parametrize("split", ["none", "orthogonal"])
@pytest.mark.parametrize("g_value", [0.37, 0.0])
def test_stress_and_tangent_are_derivatives(split, g_value):
    strain, step = random_strains(), 1e-8
    g = np.full(len(strain), g_value)
    for stiffness in random_stiffnesses(5):
        law = Law.rooted(split, stiffness)

        def energy(e, law=law):
            energies = responses(law, g, e)[0]
            return g * energies[:, 0] + energies[:, 1]

        _, stress, tangent = responses(law, g, strain)
        for k, shift in enumerate(step * np.eye(3)):
            slope = (energy(strain + shift) - energy(strain - shift)) / (2 * step)
            bend = (responses(law, g, strain + shift)[1] - responses(law, g, strain - shift)[1]) / (2 * step)
            assert np.abs(stress[:, k] - slope).max() < 1e-7 * stiffness.max()
            assert np.abs(tangent[:, :, k] - bend).max() < 1e-5 * stiffness.max()


def test_parts_of_the_strain_are_orthogonal_in_energy():
    """The stress of each part does no work on the other: sigma+ : C^-1 : sigma- = 0."""
    strain = random_strains()
    for stiffness in random_stiffnesses():
        law = Law.rooted("orthogonal", stiffness)
        energies, whole, _ = responses(law, np.ones(len(strain)), strain)
        minus = responses(law, np.zeros(len(strain)), strain)[1]
        plus = whole - minus
        compliance = np.linalg.inv(stiffness)
        work = np.einsum("pi,ij,pj->p", plus, compliance, minus)
        assert np.abs(work).max() < 1e-12 * energies.max()
        for part, energy in ((plus, energies[:, 0]), (minus, energies[:, 1])):
            assert 0.5 * np.einsum("pi,ij,pj->p", part, compliance, part) == pytest.approx(energy, abs=1e-14)
        assert (energies > 1e-3 * energies.max()).all(axis=1).any(), "no strain has both parts"


def test_isotropic_split_is_the_spectral_one_without_lateral_contraction_only():
    strain, g = random_strains(), np.full(200, 0.2)
    for lam, same in ((0.0, True), (60.0, False)):
        stiffness = np.array([[lam + 160, lam, 0.0], [lam, lam + 160, 0.0], [0.0, 0.0, 80.0]])
        spectral = responses(Law.isotropic("spectral", lam, 80.0), g, strain)
        orthogonal = responses(Law.rooted("orthogonal", stiffness), g, strain)
        gaps = [np.abs(a - b).max() / np.abs(a).max() for a, b in zip(spectral, orthogonal, strict=True)]
        assert (max(gaps) < 1e-12) == same and (min(gaps) > 1e-2) != same


def test_turned_material_has_the_turned_stress():
    strain, g = random_strains(), np.full(200, 0.3)
    for angle in (17.0, 45.0, 120.0):
        fracture = Fracture(toughness=1, length_scale=1, split="orthogonal")
        material = Material(stiffness=Stiffness(**GENERAL), fracture=fracture)
        turned = material.model_copy(update={"stiffness": Stiffness(**GENERAL, orientation=angle)})
        stresses_back, forth = rotation(-np.radians(angle)), rotation(np.radians(angle))
        # engineering strains turn by the transposed inverse
        strain_turned = strain @ forth
        energy, stress, _ = responses(Law.of(material, "stress"), g, strain)
        energy_turned, stress_turned, _ = responses(Law.of(turned, "stress"), g, strain_turned)
        assert np.allclose(stress_turned, stress @ stresses_back.T, rtol=1e-12, atol=1e-12)
        assert np.allclose(energy_turned, energy, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 20.0, 45.0, 70.0, 90.0])
def test_modulus_off_axis(angle):
    stiffness = in_plane_stiffness(Material(stiffness=Stiffness(**LAMINA, orientation=angle)), "stress")
    assert 1.0 / np.linalg.inv(stiffness)[0, 0] == pytest.approx(off_axis_modulus(angle), rel=1e-12)


def test_orientation_is_counter_clockwise():
    """Extension along (cos 30°, sin 30°) meets the stiffness of axis 1, of the mirrored direction it does not."""
    stiffness = in_plane_stiffness(Material(stiffness=Stiffness(**GENERAL, orientation=30.0)), "stress")
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    along, mirrored = (np.array([c * c, s * s, sign * 2 * c * s]) for sign in (1, -1))
    assert along @ stiffness @ along == pytest.approx(GENERAL["C11"])
    assert mirrored @ stiffness @ mirrored < 0.6 * GENERAL["C11"]


def off_axis_modulus(angle):
    """Young's modulus of LAMINA along a line that axis 1 leaves by an angle [degrees]."""
    e1, e2, nu, shear = LAMINA.values()
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return 1.0 / (c**4 / e1 + (1 / shear - 2 * nu / e1) * c**2 * s**2 + s**4 / e2)


# ---- both solvers --------------------------------------------------------------------------------------------------


UNUSED = {"fracture": {"length_scale": 1.0}}


def composite(variant, split="none", **changes):
    """The notched plate of coarse cells, of a lamina at 30 degrees."""
    return variant(
        "sen_tension",
        **{
            "plane": {"assumption": "stress"},
            "materials": {"steel": UNUSED, "lamina": {"stiffness": {**LAMINA, "orientation": 30.0}, "fracture": {
                "toughness": 0.0027, "length_scale": 0.06, "residual_stiffness": 1e-6, "split": split}}},
            "bodies": {"plate": {"material": "lamina"}},
            "mesh": {"h": 0.04, "coarse": 0.1, "fine": {"lower": [0.4, 0.2], "upper": [1.0, 0.8]}},
            "mpm": {"constraints_on": "nodes", "move_points": False},
            "load": {"path": [0.0, 0.04], "increment": 2e-3, "adaptive": False, "smallest": 2e-3,
                     "stop_when_broken": False},
            "staggered": {"tolerance": 1e-6, "residual_tolerance": 1e-10},
            **changes,
        },
    )  # fmt: skip


def march(solver, case):
    discretisation = solver(case)
    history = [(i.u, i.F, i.elastic_energy, i.fracture_energy, i.c_min) for i in increments(discretisation, case)]
    return np.array(history), discretisation


@pytest.mark.parametrize("split", ["none", "orthogonal"])
def test_mpm_on_gauss_points_is_the_fem_through_fracture(variant, split):
    case = composite(variant, split)
    fem, mpm = march(FiniteElements, case)[0], march(MaterialPoints, case)[0]
    assert fem[:, 4].min() < 0.05, "the specimen did not break"
    assert (np.abs(mpm - fem).max(axis=0) <= 1e-8 * np.abs(fem).max(axis=0)).all()


@pytest.mark.parametrize("solver", SOLVERS)
def test_even_strain_of_an_off_axis_body_has_the_exact_force(variant, solver):
    """Pulled between smooth grips that let it shear: the stress is uniaxial. A body that cannot break."""
    case = composite(
        variant, notches=[], load={"path": [0.0, 1e-3], "increment": 1e-3},
        materials={"steel": UNUSED, "lamina": {"stiffness": {**LAMINA, "orientation": 30.0}}},
        boundaries={"corner": {"point": [0.0, 0.0]}},
        constraints=[
            {"on": "left", "direction": "x", "value": 0.0}, {"on": "right", "direction": "x", "scale": 1.0},
            {"on": "corner", "direction": "y", "value": 0.0},
        ],
    )  # fmt: skip
    history, discretisation = march(solver, case)
    assert history[-1, 1] == pytest.approx(1e-3 * off_axis_modulus(30.0), rel=1e-9)
    stress, gradient = discretisation.fields().stress, discretisation.fields().gradient
    assert np.abs(stress[:, 1:]).max() < 1e-9 * stress[:, 0].max()
    assert np.abs(gradient[:, 2]).max() > 2e-4, "extension and shear are not coupled"


@pytest.mark.parametrize("run, order", [("fem", 2.0), ("mpm_linear", 2.0), ("mpm_quadratic", 3.0)])
def test_smooth_field_converges(run, order):
    tables = tomllib.loads(load_case("elastic_mms").source.read_text(encoding="utf-8"))
    tables["materials"]["solid"] = {"stiffness": {**GENERAL, "orientation": 25.0}}
    errors = []
    for spacing in (0.05, 0.025):
        case = case_from_tables({**tables, "tiers": {}}, run=f"{run}[h={spacing:g}]")
        solver = FiniteElements if case.run_spec(case.run).solver == "fem" else MaterialPoints
        errors.append(march(solver, case)[1].measures()["l2_error_displacement"])
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize("solver", SOLVERS)
def test_motion_of_an_isotropic_body_is_refused(solver):
    tables = tomllib.loads(load_case("surfing").source.read_text(encoding="utf-8"))
    tables["materials"]["steel"] = {"stiffness": GENERAL, "fracture": tables["materials"]["steel"]["fracture"]}
    case = case_from_tables(tables, "quick")
    with pytest.raises(CaseError, match=r"materials.steel.stiffness: .*give an isotropic pair"):
        march(solver, case)


def test_matrices_of_a_cracked_body_have_its_stiffness(variant):
    """Elasticity alone, whatever the split: rows of the stiffness are those of the undamaged solver."""
    case = composite(variant, "orthogonal", load={"path": [0.0, 1e-3], "increment": 1e-3})
    unsplit = composite(variant, "none", load={"path": [0.0, 1e-3], "increment": 1e-3})
    matrices = [CrackedBody(c).equations(0.5, 0.0)[0] for c in (case, unsplit)]
    assert abs(matrices[0] - matrices[1]).max() == 0.0
    assert MaterialTable(case).law.split[0] != MaterialTable(unsplit).law.split[0]


# ---- what files may say --------------------------------------------------------------------------------------------

REFUSED = {
    "both kinds of constants": ({**LAMINA, "C11": 1.0}, {}, "stiffness", "or else young_1"),
    "a missing entry": ({"C11": 1.0, "C22": 1.0, "C66": 1.0}, {}, "stiffness", "C12 (and C16, C26)"),
    "a missing constant": ({"young_1": 1.0, "young_2": 1.0, "poisson_12": 0.3}, {}, "stiffness", "shear_modulus_12"),
    "an indefinite matrix": ({**GENERAL, "C12": 60.0}, {}, "stiffness", "every strain a positive energy"),
    "a negative modulus": ({**LAMINA, "young_2": -10.0}, {}, "stiffness.young_2", "larger"),
    "a poisson ratio too large": ({**LAMINA, "poisson_12": 4.0}, {}, "stiffness.poisson_12", "3.74166"),
    "an unknown constant": ({**LAMINA, "poisson_21": 0.1}, {}, "stiffness.poisson_21", "poisson_12"),
    "a wrong unit": ({**GENERAL, "C11": "3 mm"}, {}, "stiffness.C11", "stress"),
    "an isotropic constant beside": (LAMINA, {"young": 3.0}, "stiffness", "isotropic constants"),
    "an isotropic split": (LAMINA, {"fracture": {"split": "spectral"}}, "fracture.split", '"orthogonal" or "none"'),
    "no split chosen": (LAMINA, {"fracture": {}}, "fracture.split", '"orthogonal" or "none"'),
}  # fmt: skip


def plate(stiffness, **more):
    material = {"stiffness": stiffness, **more}
    if "fracture" in more:
        material["fracture"] = {"toughness": 0.1, "length_scale": 0.3, **more["fracture"]}
    return {
        "title": "Plate", "requirement": "none", "units": {"length": "mm", "force": "kN"},
        "plane": {"assumption": "stress"}, "materials": {"lamina": material},
        "bodies": {"plate": {"material": "lamina", "shape": {"rectangle": {"lower": [0, 0], "upper": [1, 1]}}}},
        "load": {"path": [0.0]}, "mesh": {"h": 0.1}, "runs": {"fem": {"solver": "fem"}},
    }  # fmt: skip


@pytest.mark.parametrize("reason", REFUSED)
def test_refused_with_one_sentence(reason):
    stiffness, more, key, words = REFUSED[reason]
    with pytest.raises(CaseError) as refusal:
        case_from_tables(plate(stiffness, **more))
    assert f"materials.lamina.{key}'" in str(refusal.value) and words in str(refusal.value)


def test_engineering_constants_are_those_of_plane_stress():
    with pytest.raises(CaseError, match=r"'materials.lamina.stiffness' has engineering constants.*give C11"):
        case_from_tables({**plate(LAMINA), "plane": {"assumption": "strain"}})
    assert case_from_tables({**plate(GENERAL), "plane": {"assumption": "strain"}}).materials["lamina"].is_anisotropic


@pytest.mark.parametrize("material, key", [
    ({"stiffness": LAMINA}, "stiffness"),
    ({"young": 1.0, "poisson": 0.3, "fracture": {"toughness": 1.0, "length_scale": 0.3, "split": "orthogonal"}},
     "fracture.split"),
])  # fmt: skip
def test_refused_in_motion(material, key):
    tables = {**plate(LAMINA), "materials": {"lamina": {**material, "density": 1.0}}, "dynamics": {"end_time": 1.0}}
    del tables["load"]
    with pytest.raises(CaseError, match=rf"'materials.lamina.{key}'.* quasi-static cases only; .*table load"):
        case_from_tables(tables)


def test_units_are_converted():
    stiffness = {**LAMINA, "young_1": "140 GPa", "young_2": "10000 MPa"}
    entries = case_from_tables(plate(stiffness)).materials["lamina"].stiffness
    assert (entries.young_1, entries.young_2) == pytest.approx((140.0, 10.0))
