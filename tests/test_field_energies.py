"""Energies of fields from elsewhere: exact ones met, our own solver's met on its mesh, what is not told is a sentence."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import Case, case_from_tables
from fem_reference import FiniteElements
from numerics.fields import Fields
from numerics.quasi_static import increments
from verify.runs.field_energies import Energies, energies_of
from verify.runs.foreign_fields import fields_on_mesh

L0, TOUGHNESS = 0.05, 0.0027
STEEL = {"young": 210.0, "poisson": 0.3}
FRACTURE = {"toughness": TOUGHNESS, "length_scale": L0, "split": "spectral"}
PLATE: dict[str, Any] = {
    "title": "plate",
    "requirement": "energies of fields",
    "units": {"length": "mm", "force": "kN"},
    "plane": {"assumption": "strain", "thickness": 2.0},
    "materials": {"steel": {**STEEL, "fracture": FRACTURE}},
    "bodies": {"plate": {"material": "steel", "shape": {"rectangle": {"lower": [0, 0], "upper": [1, 1]}}}},
    "constraints": [
        {"on": "bottom", "direction": "y", "value": 0},
        {"on": "bottom", "direction": "x", "value": 0},
        {"on": "top", "direction": "y", "scale": 1},
    ],
    "load": {"path": [0.0, 0.004], "increment": 0.002},
    "mesh": {"h": 0.05, "under_resolved": True},
    "runs": {"fem": {"solver": "fem"}},
}


def plate(**fracture: Any) -> Case:
    return case_from_tables({**PLATE, "materials": {"steel": {**STEEL, "fracture": FRACTURE | fracture}}})


def fields(case: Case, cells: int = 100, strain: float = 0.001) -> Fields:
    """A crack through the middle of the plate by its exact profile, under a uniform strain along y."""
    x = np.linspace(0.0, 1.0, cells + 1)
    points = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1, 1)
    quads = corner + np.array([0, cells + 1, cells + 2, 1])
    beside = np.abs(points[:, 1] - 0.5)
    (material,) = case.materials.values()
    at1 = material.fracture.functional == "AT1"
    c = 1.0 - (np.maximum(1.0 - beside / (4.0 * L0), 0.0) ** 2 if at1 else np.exp(-beside / (2.0 * L0)))
    return fields_on_mesh(points, quads, c, np.column_stack([0 * x.repeat(cells + 1), strain * points[:, 1]]), 2.0)


@pytest.mark.parametrize("functional", ["AT2", "AT1"])
def test_a_crack_of_the_exact_profile_holds_its_toughness_times_its_area(functional: str) -> None:
    case = plate(functional=functional)
    assert energies_of(fields(case, 200), case).fracture == pytest.approx(2.0 * TOUGHNESS, rel=5e-3)


def test_a_uniform_strain_holds_its_energy_and_a_stress_alone_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    case = plate(split="none")
    (material,) = case.materials.values()
    strained = fields(case)
    modulus = material.lam + 2.0 * material.mu
    # of c^2 = 1 - 2 e + e^2 with e = exp(-|y| / (2 l0))
    across = 1.0 - 8.0 * L0 * (1.0 - np.exp(-0.25 / L0)) + 2.0 * L0 * (1.0 - np.exp(-0.5 / L0))
    expected = 0.5 * modulus * 1e-6 * 2.0 * across
    assert energies_of(strained, case).elastic == pytest.approx(expected, rel=1e-3)
    stress = strained.phase_field[:, None] ** 2 * np.array([material.lam, modulus, 0.0]) * 1e-3
    nothing = np.full_like(strained.gradient, np.nan)
    stressed = Fields(**{**vars(strained), "gradient": nothing, "stress": stress})
    assert energies_of(stressed, case).elastic == pytest.approx(expected, rel=2e-3)
    assert "by the split spectral their stress does not tell" in energies_of(stressed, plate()).missing[0]


def test_the_energies_of_our_own_solver_are_met_on_its_mesh() -> None:
    broken = {"path": [0.0, 0.008], "increment": 0.002}
    case = case_from_tables({**PLATE, "load": broken, "mesh": {"h": 0.05, "under_resolved": True}}, run="fem")
    solver = FiniteElements(case)
    list(increments(solver, case))
    state = solver.fields()
    read = fields_on_mesh(
        state.grid_points, state.grid_cells, state.grid_phase_field, state.grid_displacement, case.plane.thickness
    )
    elastic, fracture = solver.energies()
    assert state.grid_phase_field.min() < 0.1
    assert energies_of(read, case) == Energies(pytest.approx(elastic, rel=0.002), pytest.approx(fracture, rel=0.001))


def test_what_the_data_do_not_tell_is_a_sentence() -> None:
    case = plate()
    whole = fields(case)
    without = Fields(**{**vars(whole), "gradient": np.full_like(whole.gradient, np.nan)})
    found = energies_of(without, case)
    assert np.isnan(found.elastic) and np.isfinite(found.fracture)
    assert found.missing == (
        "No elastic energy is integrated from the fields: they hold neither displacement nor stress; save one and name it"
        " with displacement = NAME.",
    )
    assert "of order 4 needs second derivatives" in energies_of(whole, plate(order=4)).missing[0]
    two = {name: PLATE["bodies"]["plate"] | {"shape": {"rectangle": {"lower": [x, 0], "upper": [x + 0.4, 1]}}}
           for name, x in (("a", 0.0), ("b", 0.4))}  # fmt: skip
    beyond = energies_of(whole, case_from_tables({**PLATE, "bodies": two}))
    assert "20 % of their area lies in no body" in beyond.missing[0]


@pytest.mark.parametrize(("words", "kept"), [("half model", 0.5), ("", 0.5), ("half model", 0.8)])
def test_the_cells_of_a_half_model_count_twice_and_those_of_a_part_not(words: str, kept: float, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("u,F\n0,0\n1,1\n")
    theirs = {"solver": "imported", "history": "a.csv", "map": words}
    case = case_from_tables({**PLATE, "runs": {"a": theirs}}, run="a", source=tmp_path / "case.toml")
    whole, expected = fields(case), energies_of(fields(case), case)
    assert not expected.missing
    chosen = whole.reference[:, 0] < kept
    by_cell = {name: getattr(whole, name)[chosen] for name in ("volume", "grid_cells", "reference", "gradient", "stress")}
    part = energies_of(Fields(**{**vars(whole), **by_cell, "phase_field": whole.phase_field[chosen]}), case)
    if words and kept == 0.5:
        assert part == Energies(pytest.approx(expected.elastic), pytest.approx(expected.fracture))
    else:
        assert np.isnan((part.elastic, part.fracture)).all()
        assert f"their cells cover {100 * kept:g} % of the bodies; give all of them, or the word" in part.missing[0]


def test_without_compiled_laws_the_sentence_says_how_to_install_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numba", None)
    for name in [name for name in sys.modules if name.startswith("physics")]:
        monkeypatch.delitem(sys.modules, name)
    (said,) = energies_of(fields(plate()), plate()).missing
    assert said.startswith("No energies are integrated from the fields: numba is not installed") and "[solve]" in said
