"""The accelerations of the staggered scheme on the notched plate, coarse: the same answer for less work."""

import numba
import numpy as np
import pytest
from test_increments import SOLVERS, march, notched

from cases import CaseError
from numerics.threads import use_threads
from verify import run


def accelerated(variant, solver, acceleration, **settings):
    """Load, force and staggered iterations of each increment, and the costs."""
    staggered = {"acceleration": acceleration, "tolerance": 1e-4, **settings}
    followed, discretisation = march(notched(variant, solver, staggered=staggered))
    return np.array([(step.u, step.F, step.staggered) for step in followed]), discretisation.costs.count


@pytest.mark.parametrize("solver", SOLVERS)
def test_each_acceleration_gives_the_answer_of_plain_staggering_in_fewer_iterations(variant, solver):
    plain, _ = accelerated(variant, solver, "none")
    anderson, _ = accelerated(variant, solver, "anderson")
    momentum, counted = accelerated(variant, solver, "momentum")
    for other in (anderson, momentum):
        assert np.array_equal(other[:, 0], plain[:, 0]), "the crack runs in the same increment"
        assert other[:-1, 1] == pytest.approx(plain[:-1, 1], rel=1e-3)
    of_jump = [steps[:, 2].max() for steps in (momentum, anderson, plain)]
    assert 1.3 * of_jump[0] < of_jump[1] < of_jump[2] / 1.5
    assert counted["momentum_iterations"] > 0.5 * of_jump[0]


def test_the_record_tells_how_often_momentum_was_used_and_refused(variant, tmp_path, monkeypatch):
    monkeypatch.setattr("numerics.acceleration.RESTING_SHARE", 0.0)
    case = notched(variant, staggered={"acceleration": "momentum"}, load={"stop_when_broken": False})
    counters = run(case, "fem", "standard", tmp_path, threads=1).info["counters"]
    assert counters["momentum_iterations"] > counters["momentum_refused"] > 0


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="needs two threads")
@pytest.mark.parametrize("solver", SOLVERS)
def test_momentum_gives_the_same_bits_on_any_number_of_threads(variant, solver):
    before, steps = numba.get_num_threads(), []
    for threads in (1, 2):
        use_threads(threads)
        steps.append(accelerated(variant, solver, "momentum")[0])
    use_threads(before)
    assert np.array_equal(*steps)


def test_a_fixed_number_of_passes_is_not_accelerated(variant):
    with pytest.raises(CaseError, match=r"'staggered.acceleration' = 'momentum' has no effect: .* \"converged\"\.$"):
        notched(variant, staggered={"scheme": "passes", "acceleration": "momentum"})


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_phase_field_that_is_in_balance_is_not_solved_again(variant, solver):
    discretisation = march(notched(variant, solver, load={"path": [0.0, 0.002]}, mpm={"move_points": False}))[1]
    solved, resting = discretisation.costs.count["factorisations"], discretisation.nodal_phase_field
    discretisation.solve_phase_field(discretisation.history_field)
    assert discretisation.costs.count["factorisations"] == solved
    assert np.array_equal(discretisation.nodal_phase_field, resting)
    discretisation.solve_phase_field(1.01 * discretisation.history_field)
    assert discretisation.costs.count["factorisations"] == solved + 1
