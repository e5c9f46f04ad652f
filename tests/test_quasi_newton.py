"""Displacement and phase field together, quasi-Newton: the answer of the staggered scheme for few factorisations."""

import numba
import numpy as np
import pytest
from test_increments import COARSE, SOLVERS, march, notched

from cases import CaseError
from numerics.costs import Costs
from numerics.linear_solvers import LinearSolverError, linear_solver
from numerics.quasi_newton import CoupledEquations
from numerics.quasi_static import _LoadPath as LoadPath
from numerics.quasi_static import increments
from numerics.sparse_pattern import SymmetricPattern
from numerics.staggered import StepOutcome
from numerics.threads import use_threads
from verify import run

#: the panel, coarse: it cracks, is closed under pressure and opened again
CYCLE = {"path": [0.0, 0.4, -0.1, 0.5], "increment": 0.05, "smallest": 0.0125, "largest_advance": 2.0}
#: below this phase field the plate's crack has run through, and what force is left depends on the way that it took
RUN_THROUGH = 0.1


def panel(variant, solver, scheme):
    mesh = {"h": 12.5, "coarse": 50.0, "fine": {"lower": [150.0, 225.0], "upper": [265.0, 325.0]}, "refine": []}
    concrete = {"concrete": {"fracture": {"length_scale": 12.5}}}
    return variant("l_panel", solver, materials=concrete, mesh=mesh, load=CYCLE, staggered={"scheme": scheme})


def plate(variant, solver, scheme):
    return notched(variant, solver, staggered={"tolerance": 1e-4, "scheme": scheme})


def in_common(one, other, judged):
    """Forces (n, 2) of the states that two marches share, and how many of the first are to be judged."""
    forces = {(step.march.leg, step.u): step.F for step in other}
    wanted = [step for step in one if judged(step)]
    shared = [(step.F, forces[key]) for step in wanted if (key := (step.march.leg, step.u)) in forces]
    return np.array(shared), len(wanted)


# the plate breaks through in one increment of some twenty, in which the staggered scheme is asked
@pytest.mark.parametrize(
    ("made", "judged", "factorisations"), [(plate, lambda step: step.c_min > RUN_THROUGH, 8), (panel, lambda _: True, 5)]
)
@pytest.mark.parametrize("solver", SOLVERS)
def test_it_follows_the_staggered_schemes_curve_with_few_factorisations(variant, solver, made, judged, factorisations):
    staggered, before = march(made(variant, solver, "converged"))
    together, discretisation = march(made(variant, solver, "bfgs"))
    forces, judgeable = in_common(staggered, together, judged)
    assert len(forces) > 0.6 * judgeable
    assert np.abs(forces[:, 1] - forces[:, 0]).max() <= 2e-3 * forces.max()
    counted = discretisation.costs.count
    assert counted["left_to_staggering"] == 0
    assert counted["quasi_newton_iterations"] > 5 * counted["newton"], "the sweeps behind a crack that has run"
    assert counted["factorisations"] < factorisations * counted["increments"]
    assert counted["factorisations"] < before.costs.count["factorisations"] / 2


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("solver", SOLVERS)
def test_the_phase_fields_residual_needs_no_matrices(variant, solver, order):
    steel, splines = {"steel": {"fracture": {"length_scale": 0.05, "order": order}}}, {"order": 2}
    case = variant("sen_tension", solver, mesh=COARSE, materials=steel, mpm=splines, notches=[])
    discretisation = SOLVERS[solver](case)
    discretisation.begin_step()
    fracture, systems = discretisation.fracture, discretisation.fracture.equation.systems
    history_field = np.linspace(0.0, 1.0, len(discretisation.history_field))
    nodal = np.linspace(0.5, 1.0, len(discretisation.nodal_phase_field))
    fracture.assemble(history_field, nodal)
    whole = systems.vectors.copy()
    systems.matrices[:], systems.vectors[:] = np.nan, np.nan
    fracture.assemble_residual(history_field, nodal)
    assert np.array_equal(systems.vectors, whole)
    assert np.isnan(systems.matrices).all()


def test_an_increment_that_does_not_converge_is_left_to_the_staggered_scheme_and_counted(variant, tmp_path, monkeypatch):
    monkeypatch.setattr("numerics.quasi_newton.LARGEST_ITERATIONS", 12)
    whole, left = (run(plate(variant, "fem", scheme), "fem", "standard", tmp_path / scheme, threads=1)
                   for scheme in ("converged", "bfgs"))  # fmt: skip
    counters = left.info["counters"]
    assert 0 < counters["left_to_staggering"] < counters["increments"]
    assert left.history.F.max() == pytest.approx(whole.history.F.max(), rel=1e-4)


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="needs two threads")
@pytest.mark.parametrize("solver", SOLVERS)
def test_it_gives_the_same_bits_on_any_number_of_threads(variant, solver):
    before, curves = numba.get_num_threads(), []
    for threads in (1, 2):
        use_threads(threads)
        curves.append([(step.u, step.F) for step in march(plate(variant, solver, "bfgs"))[0]])
    use_threads(before)
    assert curves[0] == curves[1]


def test_a_material_whose_phase_field_is_bounded_is_refused(variant):
    materials = {"steel": {"fracture": {"functional": "AT1"}}}
    with pytest.raises(CaseError, match=r"'staggered.scheme' = 'bfgs' knows no bound c <= 1, .* give \"converged\"\.$"):
        variant("sen_tension", materials=materials, staggered={"scheme": "bfgs"})


@pytest.mark.parametrize("name", ["direct", "superlu", "cg", "gmres"])
def test_a_matrix_that_is_kept_solves_again(name):
    pattern = SymmetricPattern(np.array([[0, 1], [1, 2]]), 3)
    solver = linear_solver(pattern, Costs(), name)
    solver.factorise(pattern.gather(np.array([[2.0, -1.0, 2.0], [2.0, -1.0, 2.0]])))
    for right_side in np.eye(3):
        matrix = np.array([[2.0, -1.0, 0.0], [-1.0, 4.0, -1.0], [0.0, -1.0, 2.0]])
        assert matrix @ solver.solve_again(right_side) == pytest.approx(right_side, abs=1e-9)


@pytest.mark.parametrize("solver", SOLVERS)
def test_sweeps_behind_a_crack_that_has_run_leave_the_state_that_they_look_at(variant, solver, monkeypatch):
    """Their steps, made as bad as can be here, may go too far where faces close."""
    at_rest, times_swept = [], 0

    def sweep(equations, times):
        at_rest.append(equations.phase_field(equations.reached))
        equations.residual(1.1 * equations.reached)
        return [0.0] * times

    monkeypatch.setattr(CoupledEquations, "sweep", sweep)
    case = plate(variant, solver, "bfgs")
    discretisation = SOLVERS[solver](case)
    for _ in increments(discretisation, case):
        nodal = discretisation.nodal_phase_field[discretisation.fracture.equation.free]
        assert all(np.array_equal(nodal, values) for values in at_rest)
        times_swept += len(at_rest)
        at_rest.clear()
    assert times_swept


def test_each_state_is_in_equilibrium_and_that_of_a_broken_body_too(variant):
    """Forces out of balance may vanish where nothing is broken."""
    case = plate(variant, "fem", "bfgs")
    discretisation = SOLVERS["fem"](case)
    for step in increments(discretisation, case):
        forces, scale = discretisation.residual(discretisation.go_to(step.u))
        assert np.linalg.norm(forces) <= 2e-3 * scale
    assert step.c_min < RUN_THROUGH


@pytest.mark.parametrize("solver", SOLVERS)
def test_an_equilibrium_that_the_iteration_steps_over_is_found(variant, solver, monkeypatch):
    def broken(equations, *_):
        state = equations.start.copy()
        equations.phase_field(state)[:] = 0.0
        equations.residual(state)
        return StepOutcome("converged", equations.history_field, 1)

    monkeypatch.setattr("numerics.quasi_newton._minimised", broken)
    load = {"path": [0.0, 0.003], "adaptive": False}
    steps, discretisation = march(notched(variant, solver, load=load, staggered={"scheme": "bfgs"}))
    staggered, _ = march(notched(variant, solver, load=load))
    assert [step.F for step in steps] == [step.F for step in staggered]
    assert discretisation.costs.count["nearer_equilibria"] == len(steps)


def test_forces_out_of_balance_do_not_end_a_run(variant, monkeypatch):
    """They may vanish where nothing is broken, and are made to."""
    case = plate(variant, "fem", "bfgs")
    as_it_is, _ = march(case)
    force = LoadPath._force

    def in_balance(path, load):
        discretisation = path.discretisation
        forces, scale = discretisation.residual(discretisation.go_to(load))
        return force(path, load) if np.linalg.norm(forces) <= 2e-2 * scale else 0.0

    monkeypatch.setattr(LoadPath, "_force", in_balance)
    followed, _ = march(case)
    whole = [[step.u for step in steps if step.c_min > RUN_THROUGH] for steps in (followed, as_it_is)]
    assert whole[0] == whole[1]
    assert followed[-1].fracture_energy == pytest.approx(as_it_is[-1].fracture_energy, rel=0.05)


def test_a_matrix_that_only_the_staggered_scheme_cannot_solve_leaves_the_quasi_newton_result(variant, monkeypatch):
    def fails(*_):
        raise LinearSolverError("singular")

    as_it_is, _ = march(plate(variant, "fem", "bfgs"))
    monkeypatch.setattr("numerics.quasi_newton.staggered_step", fails)
    followed, _ = march(plate(variant, "fem", "bfgs"))
    assert [step.u for step in followed] == [step.u for step in as_it_is]
    assert followed[-1].c_min < RUN_THROUGH
