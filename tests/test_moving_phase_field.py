"""The phase field of points that move, against the quasi-static solver and against itself solved everywhere."""

import numpy as np
import pytest
from moving_plate import (
    FLYING,
    MOVING,
    PLATE,
    PULLED,
    SHORTER,
    STILL,
    UNBREAKABLE,
    all_steps,
    check_window,
    plate_case,
    run_to,
)

from mpm import MaterialPoints
from mpm.explicit.cell_splines import splines
from mpm.explicit.phase_field_kernels import CellEquations, PhaseFieldLaw, loops
from mpm.explicit.points import Matter, PointMotion
from mpm.explicit.solver import ExplicitMaterialPoints
from numerics.phase_field_window import PATIENCE, conjugate_gradients


def test_the_first_phase_field_is_that_of_the_quasi_static_solver(tmp_path):
    moving = ExplicitMaterialPoints(plate_case(tmp_path, PLATE, MOVING, PULLED)).fields()
    still = MaterialPoints(plate_case(tmp_path, PLATE, STILL))
    still.begin_step()
    expected = still.solve_phase_field(still.history_field)
    np.testing.assert_allclose(moving.reference, still.fields().reference)
    assert expected.min() < 0.05
    np.testing.assert_allclose(moving.phase_field, expected, atol=2e-4)


def test_a_window_gives_the_fracture_energy_of_the_whole(tmp_path):
    check_window(
        lambda tolerance: ExplicitMaterialPoints(plate_case(tmp_path, PLATE, MOVING, PULLED, tolerance=tolerance)), 0.01
    )


def test_a_crack_travels_with_its_body(tmp_path):
    points = ExplicitMaterialPoints(plate_case(tmp_path, PLATE, MOVING, FLYING))
    before, energy = points.fields(), points.balance().fracture
    run_to(points, 0, all_steps(points))
    after = points.fields()
    np.testing.assert_allclose(after.displacement, np.tile([0.8, 0.32], (len(after.points), 1)), rtol=1e-9)
    np.testing.assert_allclose(after.phase_field, before.phase_field, atol=1e-9)
    assert points.balance().fracture == pytest.approx(energy, rel=1e-9)


def test_a_phase_field_that_may_heal_is_driven_by_the_present_energy(tmp_path):
    moving = MOVING.replace("passes = <passes>", "passes = <passes>, irreversible = false")
    points = ExplicitMaterialPoints(plate_case(tmp_path, PLATE, moving, PULLED))
    run_to(points, 0, 20)
    crack = points.bodies[0].points.crack
    np.testing.assert_array_equal(crack.history, crack.psi_plus)
    assert crack.psi_plus.max() > 0.0 and crack.c.min() > 0.9, "the notch that a history field draws has healed"


def test_a_body_without_fracture_table_has_no_phase_field(tmp_path):
    points = ExplicitMaterialPoints(plate_case(tmp_path, UNBREAKABLE, MOVING, PULLED))
    run_to(points, 0, 20)
    assert points.phase_fields == []
    np.testing.assert_array_equal(points.fields().phase_field, 1.0)
    assert points.balance().fracture == 0.0 and "phase_field_solves" not in points.costs.count


def test_a_run_goes_on_from_its_checkpoint_bit_by_bit(tmp_path):
    case = plate_case(tmp_path, PLATE, MOVING, PULLED)
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


def fracture_gain(tmp_path, passes: int, share: float = 0.8) -> float:
    moving = MOVING.replace("time_step_share = 0.8", f"time_step_share = {share}").replace("16.0", "10.0")
    points = ExplicitMaterialPoints(plate_case(tmp_path, SHORTER, moving, PULLED, passes=passes))
    start = points.balance().fracture
    run_to(points, 0, all_steps(points))
    return points.balance().fracture - start


def test_further_passes_converge_to_a_phase_field_that_is_a_step_ahead(tmp_path):
    one, two, four = (fracture_gain(tmp_path, passes) for passes in (1, 2, 4))
    halved = fracture_gain(tmp_path, 2, share=0.4)
    assert four == two, "the step keeps its forces, so that the second pass has the history field of its end"
    assert 0.4 < (halved - fracture_gain(tmp_path, 1, share=0.4)) / (two - one) < 0.7, "what they change is of order dt"


def test_further_passes_move_what_does_not_break_to_the_same_bits(tmp_path):
    ends = []
    for passes in (1, 3):
        points = ExplicitMaterialPoints(plate_case(tmp_path, UNBREAKABLE, MOVING, PULLED, passes=passes))
        run_to(points, 0, 40)
        ends.append((points.fields(), points.balance()))
    np.testing.assert_array_equal(ends[0][0].points, ends[1][0].points)
    np.testing.assert_array_equal(ends[0][0].stress, ends[1][0].stress)
    assert ends[0][1] == ends[1][1]


def test_what_points_hardly_see_does_not_spoil_what_they_see_later(tmp_path):
    """A broken row of points that flies away from the plate meets nodes at which the last solution could be anything."""
    points = ExplicitMaterialPoints(plate_case(tmp_path, PLATE, MOVING, PULLED))
    phase_field, body = points.phase_fields[0], points.bodies[0]
    y = body.points.motion.y
    row = np.flatnonzero(y == y.max())
    y[row] += 1.3
    body.points.crack.history[row] = np.geomspace(10.0, 1e5, len(row)) * 0.003 / (4.0 * 0.5)
    phase_field.solve(0.0, everywhere=True)
    body.map_to_grid()
    expected, energy = body.points.crack.c.copy(), points.balance().fracture
    mass = body.window.sums.m
    hardly = (mass > 0.0) & (mass < 1e-2 * mass.max())
    assert hardly.sum() > 20
    phase_field._nodal[hardly] = 6000.0 * (-1.0) ** np.flatnonzero(hardly)
    phase_field.solve(0.0, everywhere=True)
    np.testing.assert_allclose(body.points.crack.c, expected, atol=2e-3)
    assert points.balance().fracture == pytest.approx(energy, rel=1e-3)


def test_a_window_without_a_node_of_its_own_has_nothing_to_solve():
    nothing = np.zeros(0)
    correction, iterations = conjugate_gradients(
        np.zeros((0, 9), np.int32), np.zeros((0, 9)), np.zeros(0, np.int64), nothing, nothing, 1e-4
    )
    assert len(correction) == iterations == 0


def test_points_that_are_torn_cost_few_iterations():
    """Single points with ten thousand times the stiffness of what lies around them, in a plane of hat functions."""
    n, random = 24, np.random.default_rng(5)
    number = np.arange(n * n).reshape(n, n)
    corners = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]], axis=-1).reshape(-1, 4)
    matrix, mass, stiff = np.zeros((n * n, n * n)), np.array([[2, 1], [1, 2]]) / 6.0, np.array([[1, -1], [-1, 1]])
    for cell in corners:
        matrix[np.ix_(cell, cell)] += np.kron(mass, mass) + 4.0 * (np.kron(stiff, mass) + np.kron(mass, stiff))
    for cell, (x, y) in zip(random.permutation(corners)[:60], random.uniform(size=(60, 2)), strict=True):
        at_point = np.kron([1.0 - x, x], [1.0 - y, y])
        matrix[np.ix_(cell, cell)] += 1e4 * np.outer(at_point, at_point)
    around = np.pad(number, 1, constant_values=n * n)
    near = np.stack([around[a : n + a, b : n + b] for a in range(3) for b in range(3)], axis=-1).reshape(-1, 9)
    values = np.where(near < n * n, matrix[np.arange(n * n)[:, None], np.minimum(near, n * n - 1)], 0.0)
    right_side, sources = random.uniform(-1.0, 1.0, n * n), np.full(n * n, 1.0)
    system = near.astype(np.int32), values, np.full(n * n, 4), right_side, sources, 1e-6
    found, iterations = conjugate_gradients(*system, patched=True)
    _, by_diagonal = conjugate_gradients(*system)
    assert iterations - PATIENCE < (by_diagonal - PATIENCE) / 3
    np.testing.assert_allclose(found, np.linalg.solve(matrix, right_side), atol=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_windows_of_any_shape_are_solved(seed):
    """Rows of a window with gaps and ragged sides: what stands before a row is not everywhere as far away."""
    n, random = 20, np.random.default_rng(seed)
    inside = random.uniform(size=(n, n)) < (0.6 if seed else 0.95)
    inside[5:9, 3:15] = True
    number = np.full((n + 2, n + 2), inside.sum())
    number[1:-1, 1:-1][inside] = np.arange(inside.sum())
    x, y = np.nonzero(number < inside.sum())
    near = np.stack([number[x + a, y + b] for a in (-1, 0, 1) for b in (-1, 0, 1)], axis=-1)
    there, rows = near < len(near), np.arange(len(near))[:, None]
    coupling = random.uniform(-1.0, 0.0, (len(near), len(near)))
    matrix = np.zeros_like(coupling)
    matrix[np.broadcast_to(rows, near.shape)[there], near[there]] = (coupling + coupling.T)[
        np.broadcast_to(rows, near.shape)[there], near[there]
    ]
    np.fill_diagonal(matrix, 20.0)
    values = np.where(there, matrix[rows, np.minimum(near, len(near) - 1)], 7.0)
    right_side = random.uniform(-1.0, 1.0, len(near))
    found, _ = conjugate_gradients(
        near.astype(np.int32), values, np.full(len(near), 4), right_side, np.full(len(near), 1e-3), 1e-4
    )
    np.testing.assert_allclose(found, np.linalg.solve(matrix, right_side), atol=2e-6)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_equations_of_cells_are_sums_over_their_points(order):
    k, width, random = order + 1, 12, np.random.default_rng(order)
    # two strips of points in no order, the cells between them empty; some of the cells take no part
    x, y = np.concatenate([random.uniform(0.0, 3.0, 30), random.uniform(4.0, 7.0, 30)]), random.uniform(0.0, 4.0, 60)
    volume, history = random.uniform(0.5, 1.0, (2, 60))
    zero = np.zeros(60)
    number = np.full(10 * width, -1, np.int32)
    taking_part = [i * width + j for i in range(8) for j in range(3)]
    number[taking_part] = np.arange(len(taking_part))
    equations = CellEquations(
        width, number, np.zeros((len(taking_part), k * k * (k * k + 1) // 2)), np.zeros((len(taking_part), k * k))
    )
    law = PhaseFieldLaw(2.0, 3.0, 5.0, 0.0, 1.0, 1.0, np.zeros((3, 3)))
    loops(order).add_points(
        np.array([0, 30, 60]), PointMotion(x, y, zero, zero, zero, zero), Matter(zero, volume, zero, zero), history, law,
        0.5, equations,
    )  # fmt: skip
    matrices, right_sides = np.zeros((len(taking_part), k * k, k * k)), np.zeros((len(taking_part), k * k))
    for p in range(60):
        cell = number[int(x[p]) * width + int(y[p])]
        if cell >= 0:
            (wx, dx), (wy, dy) = (splines(k, place - int(place)) for place in (x[p], y[p]))
            value, slope_x, slope_y = (np.outer(a[:k], b[:k]).ravel() for a, b in ((wx, wy), (dx, wy), (wx, dy)))
            mass = (2.0 * history[p] + 3.0) * volume[p] * np.outer(value, value)
            slopes = np.outer(slope_x, slope_x) + np.outer(slope_y, slope_y)
            matrices[cell] += mass + 5.0 * volume[p] * 0.25 * slopes
            right_sides[cell] += 3.0 * volume[p] * value
    np.testing.assert_allclose(equations.local, [matrix[np.triu_indices(k * k)] for matrix in matrices], atol=1e-13)
    np.testing.assert_allclose(equations.right_side, right_sides, atol=1e-13)
