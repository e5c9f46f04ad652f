"""Sparse patterns, linear solvers and Newton's method."""

import gc
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

from mpm.quasi_static.phase_field import keep_barely_seen
from numerics import linear_solvers
from numerics.acceleration import LARGEST_REFUSALS, Anderson, Momentum
from numerics.costs import Costs
from numerics.linear_solvers import linear_solver
from numerics.newton import load_ratio, newton
from numerics.sparse_pattern import SymmetricPattern, gather_vector
from numerics.staggered import NewtonError, remaining_distance

RANDOM = np.random.default_rng(5)


def chain(n_cells: int, k: int = 3):
    """Cells of k unknowns in a row, each sharing one with the next; one unknown eliminated, two tied."""
    equations = np.arange(n_cells)[:, None] * (k - 1) + np.arange(k)
    equations[0, 0] = -1
    equations[equations == equations.max()] = 2
    factors = RANDOM.random((n_cells, k, k))
    local = factors @ factors.transpose(0, 2, 1) + np.eye(k)
    return equations, local


def dense(equations, local, size):
    matrix = np.zeros((size, size))
    for cell, block in zip(equations, local, strict=True):
        for i, row in enumerate(cell):
            for j, column in enumerate(cell):
                if row >= 0 and column >= 0:
                    matrix[row, column] += block[i, j]
    return matrix


@pytest.fixture
def system():
    equations, local = chain(20)
    size = int(equations.max()) + 1
    matrix = dense(equations, local, size)
    unused = np.diag(matrix) == 0
    matrix[unused, unused] = 1.0
    pattern = SymmetricPattern(equations, size)
    first, second = np.triu_indices(3)
    values = pattern.gather(np.ascontiguousarray(local[:, first, second]))
    values[pattern.diagonal[unused]] = 1.0
    return pattern, values, matrix


def test_gathered_matrix_is_the_sum_of_its_cells(system):
    pattern, values, matrix = system
    assert np.allclose(pattern.full(values).toarray(), matrix, atol=1e-13)
    rows, columns = np.array([4, 2]), np.array([3, 2])
    places = pattern.positions(rows, columns)
    assert np.allclose(values[places], matrix[rows, columns])


@pytest.mark.parametrize("name", ["direct", "well_conditioned", "superlu", "gmres", "cg"])
def test_linear_solvers_agree(system, name):
    pattern, values, matrix = system
    right_side = RANDOM.random(pattern.size)
    solver = linear_solver(pattern, Costs(), name)
    for scale in (1.0, 2.0):
        solution = solver.solve(scale * values, right_side)
        assert np.allclose(solution, np.linalg.solve(scale * matrix, right_side), rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("name", ["direct", "superlu"])
def test_direct_solver_forgets_the_values_of_the_matrix_before(system, name):
    pattern, values, matrix = system
    solver, right_side = linear_solver(pattern, Costs(), name), np.arange(1.0, pattern.size + 1)
    first = values.copy()
    solver.solve(first, right_side)
    first[:] = 0.0
    for scale in (2.0, 3.0):
        assert solver.solve(scale * values, right_side) == pytest.approx(np.linalg.solve(scale * matrix, right_side))


def test_direct_solver_takes_a_matrix_that_is_not_positive_definite(system):
    pattern, values, matrix = system
    values[pattern.diagonal[5]] -= 50.0
    matrix[5, 5] -= 50.0
    right_side = RANDOM.random(pattern.size)
    for name in ("direct", "superlu"):
        solution = linear_solver(pattern, Costs(), name).solve(values, right_side)
        assert np.allclose(matrix @ solution, right_side, atol=1e-9)


def test_a_solver_that_an_interrupt_left_unmade_goes_without_noise(monkeypatch):
    pytest.importorskip("pypardiso")
    noise = []
    monkeypatch.setattr(sys, "unraisablehook", noise.append)

    def interrupted(mtype):
        raise KeyboardInterrupt

    monkeypatch.setattr(linear_solvers, "PyPardisoSolver", interrupted)
    with pytest.raises(KeyboardInterrupt):
        linear_solvers.Pardiso(None, Costs())
    gc.collect()
    assert not noise


def test_the_direct_solvers_library_is_searched_for_once(monkeypatch):
    """The search goes through the whole installation and takes longer than a small case."""
    wrapper = pytest.importorskip("pypardiso.pardiso_wrapper")
    monkeypatch.setattr(wrapper.glob, "glob", lambda *_, **__: pytest.fail("searched again"))
    monkeypatch.setattr(wrapper, "find_library", lambda _: pytest.fail("searched again"))
    linear_solvers.Pardiso(None, Costs())


def test_gather_vector_drops_what_is_eliminated():
    assert gather_vector(np.array([[0, -1], [0, 1]]), np.array([[1.0, 9.0], [2.0, 4.0]]), 2).tolist() == [3.0, 4.0]


class Spring:
    """A bilinear spring: stiff in compression, soft in tension; pulled by a force."""

    def __init__(self, force: float, soft: float) -> None:
        self.force, self.soft = force, soft

    def residual(self, x):
        return np.where(x > 0, self.soft * x, x) - self.force, abs(self.force)

    def correction(self, x, residual):
        return -residual / np.where(x > 0, self.soft, 1.0)


@pytest.mark.parametrize("force", [1.0, -1.0])
def test_newton_passes_a_kink(force):
    costs = Costs()
    x = newton(Spring(force, 1e-4), np.array([-np.sign(force)]), 1e-12, 1e-12, costs)
    assert x[0] == pytest.approx(1e4 if force > 0 else -1.0)
    assert costs.count["loose_equilibria"] == 0


@pytest.mark.parametrize(("miss", "corrections"), [(1e-3, 1), (1e-8, 0)])
def test_newton_corrects_once_what_only_the_looser_tolerance_would_leave(miss, corrections):
    costs = Costs()
    x = newton(Spring(-1.0, 1e-4), np.array([-1.0 + miss]), 1e-2, 1e-6, costs)
    assert costs.count["newton"] == corrections
    assert x[0] == pytest.approx(-1.0, abs=1e-6)


def test_newton_says_when_there_is_no_equilibrium():
    class Nowhere(Spring):
        def correction(self, x, residual):
            return np.zeros_like(x)

    with pytest.raises(NewtonError, match="no equilibrium"):
        newton(Nowhere(1.0, 1.0), np.array([0.3]), 1e-9, 1e-9, Costs())


def iterations_to_rest(memory, matrix, limit):
    """Iterations that x -> limit + matrix (x - limit) takes from zero to within 1e-8 of its limit."""
    acceleration, x = Anderson(memory), np.zeros(len(limit))
    for iteration in range(500):
        image = limit + matrix @ (x - limit)
        if np.abs(image - limit).max() < 1e-8:
            return iteration
        x = acceleration.next(x, image)
    return 500


def test_a_short_memory_finds_the_slow_directions():
    turn = np.linalg.qr(RANDOM.random((8, 8)))[0]
    matrix = turn @ np.diag([0.99, 0.95, 0.2, 0.1, 0.1, 0.0, 0.0, 0.0]) @ turn.T
    limit = 0.02 * RANDOM.random(8)
    assert iterations_to_rest(5, matrix, limit) <= 12
    assert iterations_to_rest(0, matrix, limit) > 200


def test_a_state_of_unstable_equilibrium_is_left():
    acceleration, x = Anderson(5), np.array([0.001])
    for _ in range(20):
        x = acceleration.next(x, 1.2 * x)
    assert x[0] > 0.01


def test_a_running_crack_is_over_relaxed_and_a_step_is_bounded():
    acceleration = Anderson(5)
    assert acceleration.next(np.zeros(2), np.array([0.5, 0.0]))[0] == pytest.approx(1.7 * 0.5)
    x, image = np.zeros(1), np.array([0.05])
    x = acceleration.next(x, image)
    ahead = acceleration.next(x, x + 0.0499)
    assert ahead[0] - x[0] == pytest.approx(0.2)


def iterations_of_a_running_crack(acceleration, length=30.0):
    """Iterations in which a front gets to the end of its way; material behind it breaks by 0.05 each, by itself."""
    x = np.ones(int(length))
    for iteration in range(5000):
        front = int(np.argmax(x > 0.5))
        image = x.copy()
        image[front] -= 0.05
        if x[-1] <= 0.5:
            return iteration
        x = np.clip(acceleration.next(x, np.clip(image, 0.0, 1.0)), 0.0, 1.0)
    return 5000


def test_a_crack_that_runs_gets_further_by_its_momentum():
    costs = Costs()
    with_momentum = iterations_of_a_running_crack(Momentum(Anderson(5), costs))
    assert 2 * with_momentum < iterations_of_a_running_crack(Anderson(5))
    assert 0 < costs.count["momentum_iterations"] <= with_momentum


def test_what_settles_has_no_momentum():
    costs, x, y = Costs(), np.zeros(3), np.zeros(3)
    momentum, anderson, limit = Momentum(Anderson(5), costs), Anderson(5), np.array([0.01, 0.02, 0.03])
    for _ in range(6):
        x, y = momentum.next(x, 0.5 * (x + limit)), anderson.next(y, 0.5 * (y + limit))
        assert np.array_equal(x, y)
    assert costs.count["momentum_iterations"] == 0 and not momentum.crack_runs


def test_momentum_that_goes_uphill_is_refused_and_at_last_given_up_and_each_is_counted():
    costs, x = Costs(), np.zeros(1)
    momentum = Momentum(Anderson(5), costs)
    for iteration in range(200):
        x = momentum.next(x, x + (0.01 if iteration % 10 < 8 else -0.01))
    assert costs.count["momentum_refused"] == LARGEST_REFUSALS
    assert costs.count["momentum_given_up"] == 1


def test_load_ratio_scales_where_it_can():
    assert load_ratio(2.0, before=1.0) == 2.0
    for load, before in [(1.0, 0.0), (-1.0, 1.0), (9.0, 1.0)]:
        assert load_ratio(load, before) == 1.0


def test_remaining_distance_is_that_of_a_geometric_sequence_and_round_off_is_rest():
    assert remaining_distance(0.01, 0.02) == pytest.approx(0.01)
    assert remaining_distance(0.009, 0.01) == pytest.approx(0.009 * 9.0)
    assert remaining_distance(0.01, 0.005) == np.inf
    assert remaining_distance(1e-15, 1e-16) < 1e-11


def test_each_second_is_charged_to_one_part():
    costs = Costs()
    with costs.timed("phase_field"), costs.timed("factorisation"):
        time.sleep(0.02)
    assert costs.seconds["factorisation"] >= 0.02 > 0.01 > costs.seconds["phase_field"]


def test_unknowns_with_next_to_no_stiffness_get_a_usual_diagonal():
    pattern = SimpleNamespace(diagonal=np.array([0, 2, 3, 4, 5]))
    values = keep_barely_seen(pattern, np.array([1.0, -0.5, 2.0, 1.5, 1e-8, 0.0]))
    assert values[4] == values[5] == 1.25, "the median of those that have any"
    assert values[:4] == pytest.approx([1.0, -0.5, 2.0, 1.5], rel=1e-9)
