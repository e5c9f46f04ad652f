"""Explicit finite elements against exact motion, and their phase field against the one solved everywhere."""

import textwrap
from pathlib import Path

import numba
import numpy as np
import pytest
from moving_plate import MOVING, PLATE, PULLED, SHORTER, STILL, all_steps, check_window, plate_case, run_to

from cases import CaseError, load_case
from fem_reference import ExplicitFiniteElements, FiniteElements
from mpm import ExplicitMaterialPoints
from numerics.explicit import instants, number_of_steps
from numerics.threads import use_threads

BAR = """
    title = "Bar in motion"
    requirement = "The lowest mode swings with its exact period."
    units = { length = "mm", force = "N", time = "us" }
    plane = { assumption = "strain" }
    materials.soft = { young = 100.0, poisson = 0.0, density = 1.0 }
    bodies.bar = { material = "soft", shape = { rectangle = { lower = [0.0, 0.0], upper = [10.0, 1.0] } } }
    constraints = [
        { on = "left", direction = "x", value = 0.0 },
        { on = "bottom", direction = "y", value = 0.0 },
        { on = "top", direction = "y", value = 0.0 },
    ]
    dynamics = { end_time = 4.0, time_step_share = <share> }
    mesh = { h = <h> }
    runs = { fem = { solver = "fem" } }
"""
LENGTH, SPEED = 10.0, 10.0


def case_of(tmp_path: Path, text: str, **values):
    for name, value in values.items():
        text = text.replace(f"<{name}>", str(value))
    file = tmp_path / "case.toml"
    file.write_text(textwrap.dedent(text))
    return load_case(file, run="fem")


def swinging_bar(tmp_path: Path, h: float, share: float = 0.5) -> ExplicitFiniteElements:
    """The bar at the middle of its lowest mode, v = sin(pi x / 2 L)."""
    body = ExplicitFiniteElements(case_of(tmp_path, BAR, h=h, share=share))
    mode = np.sin(0.5 * np.pi * body.basis.nodes[:, 0] / LENGTH)
    body.motion.velocity[:, 0] = np.where(body._nodes.held[:, 0], 0.0, mode)
    return body


def end_history(body: ExplicitFiniteElements) -> tuple[np.ndarray, np.ndarray]:
    """Times and displacements of the free end until the end of the case."""
    steps = number_of_steps(body.case, body.stable_step())
    size, end = body.case.dynamics.end_time / steps, np.isclose(body.basis.nodes[:, 0], LENGTH)
    moved = []
    for step in range(steps):
        body.step(step * size, size)
        moved.append(body.motion.displacement[end, 0].mean())
    return size * np.arange(1, steps + 1), np.array(moved)


def period_error(tmp_path: Path, h: float) -> float:
    times, moved = end_history(swinging_bar(tmp_path, h))
    crossings = np.flatnonzero(np.diff(np.sign(moved)) != 0)
    zero = crossings[0]
    half = times[zero] - moved[zero] * (times[zero + 1] - times[zero]) / (moved[zero + 1] - moved[zero])
    return abs(2.0 * half / (4.0 * LENGTH / SPEED) - 1.0)


def test_a_bar_swings_with_its_exact_period_to_second_order(tmp_path):
    errors = [period_error(tmp_path, h) for h in (1.0, 0.5, 0.25)]
    assert errors[-1] < 1e-3
    assert np.polyfit(np.log([1.0, 0.5, 0.25]), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.15)


def test_a_swinging_bar_keeps_its_energy(tmp_path):
    body = swinging_bar(tmp_path, 0.5)
    energy = [instant.balance.kinetic + instant.balance.elastic for instant in instants(body, body.case)]
    assert len(energy) > 20
    np.testing.assert_allclose(energy, energy[0], rtol=2e-3)


def test_the_bound_of_the_time_step_is_stable_and_a_little_more_is_not(tmp_path):
    grown = []
    for share in (0.999, 1.3):
        body = swinging_bar(tmp_path, 1.0, share)
        last = list(instants(body, body.case))[-1]
        grown.append(last.status)
    assert grown == ["complete", "blew_up"]


def test_the_work_of_a_moved_boundary_becomes_energy(tmp_path):
    text = BAR.replace('"left", direction = "x", value = 0.0', '"left", direction = "x", velocity = 0.1')
    # the jump of the velocity at the start is resolved by short steps only
    body = ExplicitFiniteElements(case_of(tmp_path, text, h=0.5, share=0.1))
    balance = list(instants(body, body.case))[-1].balance
    start = ExplicitFiniteElements(body.case).balance().total
    assert balance.external_work > 0.5 * start
    assert balance.total - start == pytest.approx(balance.external_work, rel=2e-3)


def test_damping_slows_a_free_body_and_its_work_is_counted(tmp_path):
    free = BAR[: BAR.index("    constraints")] + BAR[BAR.index("    dynamics") :]
    moving = free.replace("shape =", "velocity = [1.0, 0.5], shape =")
    case = case_of(tmp_path, moving, h=0.5, share="0.5, damping = 0.3")
    first, *_, last = (instant.balance for instant in instants(ExplicitFiniteElements(case), case))
    slowed = np.exp(-0.3 * 4.0)
    assert last.momentum == pytest.approx((10.0 * slowed, 5.0 * slowed), rel=1e-3)
    assert last.external_work == pytest.approx(last.total - first.total, rel=1e-3)
    assert last.external_power == pytest.approx(-2.0 * 0.3 * last.kinetic, rel=1e-12)


def test_the_columns_of_a_free_bar_follow_it_as_a_whole(tmp_path):
    free = BAR[: BAR.index("    constraints")] + BAR[BAR.index("    dynamics") :]
    turning = "velocity = [1.0, 0.5], velocity_gradient = [[0.0, -1e-4], [1e-4, 0.0]], shape ="
    case = case_of(tmp_path, free.replace("shape =", turning), h=0.5, share=0.5)
    first, *_, last = (instant.columns for instant in instants(ExplicitFiniteElements(case), case))
    assert (first["bar_x"], first["bar_y"]) == pytest.approx((5.0, 0.5))
    assert last["bar_x"] - first["bar_x"] == pytest.approx(4.0 * first["bar_momentum_x"] / 10.0, rel=1e-9)
    assert last["bar_momentum_y"] == pytest.approx(first["bar_momentum_y"], rel=1e-9)
    assert first["bar_spin"] == pytest.approx(1e-4, rel=1e-9)
    assert last["bar_spin"] == pytest.approx(1e-4, rel=0.05)


def test_a_run_starts_from_the_exact_velocity_and_from_no_exact_strain(variant):
    bar = variant("vibrating_bar", "fem", mesh={"h": 5.0})
    start = ExplicitFiniteElements(bar).balance().kinetic
    assert start == pytest.approx(ExplicitMaterialPoints(bar).balance().kinetic, rel=0.02)
    with pytest.raises(CaseError, match=r"exact = 'spinning_disc': it starts strained.*solver = \"mpm\""):
        ExplicitFiniteElements(variant("rotating_stressed_disc", "fem"))


def plate(tmp_path: Path, tolerance: float = 1e-3, passes: int = 1) -> ExplicitFiniteElements:
    texts = (PLATE, MOVING, PULLED)
    return ExplicitFiniteElements(plate_case(tmp_path, *texts, run="fem", tolerance=tolerance, passes=passes))


def test_the_first_phase_field_is_that_of_the_quasi_static_solver(tmp_path):
    body = plate(tmp_path)
    body.balance()
    reference = FiniteElements(plate_case(tmp_path, PLATE, STILL, run="fem"))
    expected = reference.solve_phase_field(reference.history_field)
    assert expected.min() < 0.05
    np.testing.assert_allclose(body.fields().phase_field, expected, atol=2e-4)


def test_a_window_gives_the_fracture_energy_of_the_whole(tmp_path):
    check_window(lambda tolerance: plate(tmp_path, tolerance), 0.01)


def test_elements_that_are_ten_times_the_length_scale_are_solved_on_with_their_neighbours(tmp_path):
    """A window of the one element that changes would have no node of its own."""
    coarse = PLATE.replace("h = 0.5", "h = 5.0, under_resolved = true")
    moving = MOVING.replace("end_time = 16.0", "end_time = 80.0")
    body = ExplicitFiniteElements(plate_case(tmp_path, coarse, moving, PULLED, run="fem"))
    last = list(instants(body, body.case))[-1]
    assert (last.status, last.reason) == ("complete", "")
    one = np.zeros(len(body.basis.elements))
    one[7] = 1.0
    window = body._phase_field._blocks.around(one, 0.5)
    assert set(body.basis.elements[7]) <= set(window.nodes)


def fracture_energy(tmp_path: Path, share: float, passes: int) -> float:
    moving = MOVING.replace("time_step_share = 0.8", f"time_step_share = {share}").replace("16.0", "12.0")
    texts = (SHORTER, moving, PULLED)
    body = ExplicitFiniteElements(plate_case(tmp_path, *texts, run="fem", passes=passes, tolerance=1e-4))
    start = body.balance().fracture
    run_to(body, 0, all_steps(body))
    return body.balance().fracture - start


def test_further_passes_look_ahead_by_a_step_and_make_no_difference_in_the_limit(tmp_path):
    """A second pass takes the phase field of the step's end, an error that falls with the step; a third adds nothing."""
    one, two, three = (fracture_energy(tmp_path, 0.8, passes) for passes in (1, 2, 3))
    short_one, short_two = (fracture_energy(tmp_path, 0.4, passes) for passes in (1, 2))
    assert three == pytest.approx(two, rel=0.005)
    assert (short_two - short_one) / (two - one) == pytest.approx(0.45, abs=0.15)
    assert short_one == pytest.approx(one, rel=0.015)


def test_points_tell_when_they_broke(tmp_path):
    body = plate(tmp_path)
    run_to(body, 0, all_steps(body))
    fields = body.fields()
    broken = np.isfinite(fields.broken_at)
    assert (fields.broken_at[broken] > 0.0).any() and fields.broken_at[broken].max() <= 16.0
    np.testing.assert_array_equal(broken[fields.phase_field < 0.25], True)
    assert (fields.reference[broken & (fields.broken_at == 0.0)][:, 0] < 11.0).all()


def test_a_run_goes_on_from_its_checkpoint_bit_by_bit(tmp_path):
    whole = plate(tmp_path)
    n = all_steps(whole)
    run_to(whole, 0, n // 2)
    saved = {name: np.array(array) for name, array in whole.checkpoint().items()}
    run_to(whole, n // 2, n)
    resumed = plate(tmp_path)
    resumed.restore(saved)
    run_to(resumed, n // 2, n)
    np.testing.assert_array_equal(resumed.motion.displacement, whole.motion.displacement)
    np.testing.assert_array_equal(resumed.fields().phase_field, whole.fields().phase_field)
    assert resumed.balance() == whole.balance()


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="needs two threads")
def test_one_thread_and_two_give_the_same_bits(tmp_path):
    case = plate_case(tmp_path, PLATE.replace("h = 0.5", "h = 0.15"), MOVING, PULLED, run="fem")
    before, states = numba.get_num_threads(), []
    for threads in (1, 2):
        use_threads(threads)
        body = ExplicitFiniteElements(case)
        run_to(body, 0, 20)
        states.append((body.balance(), body.fields().phase_field))
    use_threads(before)
    assert states[0][0] == states[1][0]
    np.testing.assert_array_equal(states[0][1], states[1][1])


def test_several_bodies_are_refused_with_a_remedy(tmp_path):
    shape = "{ rectangle = { lower = [11.0, 0.0], upper = [12.0, 1.0] } }"
    second = f'bodies.other = {{ material = "soft", shape = {shape} }}\n'
    with pytest.raises(CaseError, match="no contact; run several bodies with"):
        ExplicitFiniteElements(case_of(tmp_path, textwrap.dedent(BAR) + second, h=0.5, share=0.5))


def test_a_traction_on_no_edge_is_refused_with_a_remedy(tmp_path):
    text = BAR + '    tractions = [{ on = "spot", value = [1.0, 0.0] }]\n    boundaries.spot = { point = [0.0, 0.0] }\n'
    with pytest.raises(CaseError, match="'spot': no edge of a body lies on it"):
        ExplicitFiniteElements(case_of(tmp_path, text, h=0.5, share=0.5))
