"""The phase field of points that move, against the quasi-static solver and against itself solved everywhere."""

import textwrap
from pathlib import Path

import numpy as np
import pytest

from cases import load_case
from mpm import MaterialPoints
from mpm.explicit import ExplicitMaterialPoints
from numerics.explicit import number_of_steps

PLATE = """
    title = "Notched plate pulled at once"
    requirement = "The phase field is the same wherever it is solved."
    units = { length = "mm", force = "N", time = "us" }
    plane = { assumption = "strain" }
    materials.glass.young = 32000.0
    materials.glass.poisson = 0.2
    materials.glass.density = 2450.0
    materials.glass.fracture = { toughness = 0.003, length_scale = 0.5 }
    materials.steel = { young = 210000.0, poisson = 0.3, density = 7850.0 }
    bodies.plate.material = "glass"
    bodies.plate.shape = { rectangle = { lower = [0.0, 0.0], upper = [30.0, 20.0] } }
    notches = [{ kind = "history", start = [0.0, 10.0], end = [10.0, 10.0], factor = 1000.0 }]
    mesh = { h = 0.5 }
    mpm = { order = 2, fill_cells = false }
    runs = { mpm = { solver = "mpm" } }
"""
MOVING = """
    dynamics = { end_time = 16.0, time_step_rule = "courant", time_step_share = 0.8 }
    staggered = { scheme = "passes", passes = 1, tolerance = <tolerance> }
"""
PULLED = '    tractions = [{ on = "top", value = [0.0, 2.0] }, { on = "bottom", value = [0.0, -2.0] }]\n'
FLYING = "    bodies.plate.velocity = [0.05, 0.02]\n"


def case_of(tmp_path: Path, *texts: str, tolerance: float = 1e-3):
    file = tmp_path / "case.toml"
    file.write_text(textwrap.dedent("".join(texts)).replace("<tolerance>", str(tolerance)))
    return load_case(file, run="mpm")


def run_to(points: ExplicitMaterialPoints, first: int, last: int) -> None:
    size = points.case.dynamics.end_time / all_steps(points)
    for step in range(first, last):
        points.step(step * size, size)


def all_steps(points: ExplicitMaterialPoints) -> int:
    return number_of_steps(points.case, points.stable_step())


def test_the_first_phase_field_is_that_of_the_quasi_static_solver(tmp_path):
    moving = ExplicitMaterialPoints(case_of(tmp_path, PLATE, MOVING, PULLED)).fields()
    still = MaterialPoints(case_of(tmp_path, PLATE, "    load = { path = [0.0] }\n"))
    still.begin_step()
    expected = still.solve_phase_field(still.history_field)
    np.testing.assert_allclose(moving.reference, still.fields().reference)
    assert expected.min() < 0.05
    np.testing.assert_allclose(moving.phase_field, expected, atol=2e-4)


def test_a_window_gives_the_fracture_energy_of_the_whole(tmp_path):
    energies, cells = [], []
    for tolerance in (1e-9, 1e-3):
        points = ExplicitMaterialPoints(case_of(tmp_path, PLATE, MOVING, PULLED, tolerance=tolerance))
        start = points.balance().fracture
        run_to(points, 0, all_steps(points))
        energies.append(points.balance().fracture - start)
        cells.append(points.costs.count["window_cells"])
    assert energies[0] > 0.01
    assert energies[1] == pytest.approx(energies[0], rel=0.01)
    assert cells[1] < cells[0]


def test_a_crack_travels_with_its_body(tmp_path):
    points = ExplicitMaterialPoints(case_of(tmp_path, PLATE, MOVING, FLYING))
    before, energy = points.fields(), points.balance().fracture
    run_to(points, 0, all_steps(points))
    after = points.fields()
    np.testing.assert_allclose(after.displacement, np.tile([0.8, 0.32], (len(after.points), 1)), rtol=1e-9)
    np.testing.assert_allclose(after.phase_field, before.phase_field, atol=1e-9)
    assert points.balance().fracture == pytest.approx(energy, rel=1e-9)


def test_a_body_without_fracture_table_has_no_phase_field(tmp_path):
    text = PLATE.replace('bodies.plate.material = "glass"', 'bodies.plate.material = "steel"')
    points = ExplicitMaterialPoints(case_of(tmp_path, text, MOVING, PULLED))
    run_to(points, 0, 20)
    assert points.phase_fields == []
    np.testing.assert_array_equal(points.fields().phase_field, 1.0)
    assert points.balance().fracture == 0.0 and "phase_field_solves" not in points.costs.count


def test_a_run_goes_on_from_its_checkpoint_bit_by_bit(tmp_path):
    case = case_of(tmp_path, PLATE, MOVING, PULLED)
    whole = ExplicitMaterialPoints(case)
    n = all_steps(whole)
    run_to(whole, 0, n // 2)
    saved = {name: np.array(array) for name, array in whole.checkpoint().items()}
    run_to(whole, n // 2, n)
    resumed = ExplicitMaterialPoints(case)
    resumed.restore(saved)
    run_to(resumed, n // 2, n)
    for name in ("points", "phase_field", "stress", "broken_at"):
        np.testing.assert_array_equal(getattr(resumed.fields(), name), getattr(whole.fields(), name))
    assert resumed.balance().fracture == whole.balance().fracture
