"""Load-displacement curves and their comparison; the comparator must catch every kind of bad curve."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from cases.material import Fracture
from verify.metrics.curves import (
    Curve,
    CurveError,
    closed_stiffness,
    compare_curves,
    displacement_at_peak,
    initial_stiffness,
    max_error_until,
    peak_force,
    preloaded,
)
from verify.metrics.measures import fitted_order
from verify.metrics.metric import MetricError, metric
from verify.metrics.registry import METRICS, PAIR_METRICS, SWEEP_METRICS, find_metric

LIMIT = 0.05  # the comparison of two good solutions passes it, that of each bad curve must not
STIFFNESS, U_PEAK, U_END = 100.0, 1.0, 2.0


def softening(u):
    """Linear up to the peak, then exponential softening."""
    return STIFFNESS * np.where(u <= U_PEAK, u, U_PEAK * np.exp(-3.0 * (u - U_PEAK)))


def curve(scale=1.0, shift=0.0, end=U_END, n=401):
    u = np.linspace(0.0, end, n)
    return Curve(u + shift, scale * softening(u), "a curve")


def brittle(u_break):
    """Linear up to a vertical drop, where the run ends."""
    u = np.linspace(0.0, u_break, 201)
    return Curve(np.append(u, u_break), np.append(STIFFNESS * u, 0.0), "a brittle curve")


# --- what the comparator must catch ---------------------------------------------------------------


def test_same_curve_on_other_points_has_no_error():
    comparison = compare_curves(curve(), curve(n=317))
    assert comparison.l2_percent_whole < 0.05
    assert comparison.coverage == pytest.approx(1.0)


def test_scaled_curve_is_caught():
    comparison = compare_curves(curve(), curve(scale=1.06))
    for part in (
        comparison.l2_percent_before_peak,
        comparison.l2_percent_after_peak,
        comparison.l2_percent_whole,
    ):
        assert part == pytest.approx(6.0, rel=1e-6)
        assert part / 100 > LIMIT
    assert np.allclose(comparison.errors["relative_error_percent"].dropna(), 6.0)


def test_lower_curve_counts_like_a_higher_one():
    assert compare_curves(curve(), curve(scale=0.94)).l2_percent_whole == pytest.approx(6.0, rel=1e-6)


def test_shifted_curve_is_caught():
    comparison = compare_curves(curve(), curve(shift=0.05))
    assert comparison.l2_percent_before_peak / 100 > LIMIT
    assert comparison.l2_percent_whole / 100 > LIMIT


@pytest.mark.parametrize("end", [0.5, 1.2, 1.7])
def test_truncated_curve_is_caught(end):
    with pytest.raises(CurveError, match=r"covers only .* finish the run"):
        compare_curves(curve(), curve(end=end))


def test_slightly_shorter_curve_is_compared_and_says_so():
    assert compare_curves(curve(), curve(end=1.9)).coverage == pytest.approx(0.95, abs=0.01)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", ["u", "F"])
def test_nan_and_infinity_are_caught(bad, column):
    table = pd.DataFrame({"u": curve().u, "F": curve().F})
    table.loc[7, column] = bad
    with pytest.raises(CurveError, match="point 8 is NaN or infinite"):
        Curve.from_history(table)


def test_swapped_columns_are_caught():
    with pytest.raises(CurveError, match="look swapped"):
        Curve(curve().F, curve().u)


def test_a_factor_that_snaps_back_is_no_swapped_column():
    """Of a solver of ours under dissipation control: the loads fall while what they do grows."""
    rows = {"u": [0.0, 0.2, 0.06], "F": [0.0, 0.004, 0.011]}
    assert Curve.from_history(pd.DataFrame(rows | {"staggered": [0, 8, 90]})).cyclic
    with pytest.raises(CurveError, match="look swapped"):
        Curve.from_history(pd.DataFrame(rows))


def test_swapped_columns_of_a_rising_curve_are_caught_by_its_stiffness():
    rising = curve(end=0.9)
    swapped = Curve(rising.F, rising.u)  # on its own nothing is wrong with it
    with pytest.raises(CurveError, match="look swapped"):
        compare_curves(curve(), swapped)


def test_a_history_without_its_columns_is_caught():
    with pytest.raises(CurveError, match=r"has no column u or F \(it has u_mm, F_kN\)"):
        Curve.from_history(pd.DataFrame({"u_mm": [0, 1], "F_kN": [0, 1]}))
    with pytest.raises(CurveError, match="point 2 is NaN"):
        Curve.from_history(pd.DataFrame({"u": [0, 1, 2], "F": [0, "one", 3]}))
    with pytest.raises(CurveError, match="u never moves"):
        Curve([1, 1], [0, 1])


def test_opposite_loading_and_a_dead_reference_are_caught():
    with pytest.raises(CurveError, match="opposite way"):
        compare_curves(curve(), Curve(-curve().u, -curve().F))
    with pytest.raises(CurveError, match="carries no force"):
        compare_curves(Curve([0, 1, 2], [0, 0, 0]), curve())


def test_wrong_sign_of_the_force_is_caught():
    assert compare_curves(curve(), curve(scale=-1)).l2_percent_whole == pytest.approx(200.0)


@pytest.mark.parametrize("u_break", [0.8, 1.25])
def test_breaking_too_early_or_too_late_is_an_error_though_the_run_ends_there(u_break):
    comparison = compare_curves(brittle(1.0), brittle(u_break))
    assert comparison.l2_percent_whole / 100 > LIMIT
    assert comparison.l2_peak_percent_whole / 100 > LIMIT
    assert np.isfinite(comparison.l2_peak_percent_after_peak)
    assert comparison.l2_percent_before_peak < 1e-6


# --- cutting --------------------------------------------------------------------------------------


def test_curve_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        curve().F[0] = 1.0


def test_small_steps_back_of_a_digitised_curve_are_no_cycle():
    u = np.linspace(0, U_END, 200)
    noisy = Curve(u + 0.004 * np.sin(np.arange(200)), softening(u))
    assert not noisy.cyclic
    assert compare_curves(curve(), noisy).l2_peak_percent_whole / 100 < LIMIT


def test_error_until_sees_only_what_lies_before():
    worse_later = Curve(curve().u, np.where(curve().u > 1.5, 2.0, 1.03) * curve().F)
    assert max_error_until(curve(), worse_later, 0.5) == pytest.approx(0.5 * 0.03)
    assert max_error_until(curve(), worse_later, 1.4) == pytest.approx(0.03, rel=1e-3)
    assert max_error_until(curve(), worse_later, 2.0) > 0.1
    with pytest.raises(CurveError, match="does not reach"):
        max_error_until(curve(end=1.5), worse_later, 1.6)
    with pytest.raises(CurveError, match="covers only"):
        max_error_until(curve(), curve(end=0.6), 1.0)


# --- characteristic values ------------------------------------------------------------------------


def test_characteristic_values():
    assert peak_force(curve()) == pytest.approx(STIFFNESS * U_PEAK)
    assert displacement_at_peak(curve()) == pytest.approx(U_PEAK)
    assert initial_stiffness(curve()) == pytest.approx(STIFFNESS)


def test_stiffness_of_few_uneven_points():
    assert initial_stiffness(Curve([0, 1, 1.1, 2], [0, 5, 5.2, 1])) == pytest.approx(5.0)


def test_plateau_gives_its_first_highest_point():
    assert displacement_at_peak(Curve([0, 1, 2, 3, 4], [0, 5, 5, 5, 1])) == 1.0


def test_compression_keeps_its_sign():
    compressed = Curve(-curve().u, -curve().F)
    assert peak_force(compressed) == pytest.approx(-100.0)
    assert displacement_at_peak(compressed) == pytest.approx(-1.0)
    assert initial_stiffness(compressed) == pytest.approx(100.0)
    comparison = compare_curves(compressed, Curve(compressed.u, 1.06 * compressed.F))
    assert comparison.l2_percent_whole == pytest.approx(6.0, rel=1e-6)


def test_a_closed_crack_carries_again() -> None:
    loaded, opened, closed = [0, 1, 2], [1, 0, -1, -2], [-1, 0, 1]
    u = [*loaded, *opened, *closed]
    F = [0, 5, 6, 3, 0, -5, -10, -5, 0, 3]
    assert closed_stiffness(Curve(u, F)) == pytest.approx(5.0)
    with pytest.raises(CurveError, match="never goes to the other side"):
        closed_stiffness(Curve([0, 1, 2], [0, 5, 6]))


def cycle(scale=1.0, n=200):
    """Broken in tension, unloaded to the origin, then elastic in compression up to a larger force."""
    up, back = np.linspace(0, 1.5, n), np.linspace(1.5, 0, n)[1:]
    down = np.linspace(0, -1.2, n)[1:]
    secant = softening(1.5) / 1.5
    F = np.concatenate([softening(up), secant * back, STIFFNESS * down])
    return Curve(np.concatenate([up, back, down]), scale * F, "a cycle")


def test_peak_of_a_cycle_is_that_of_the_breaking_sign():
    assert cycle().cyclic
    assert min(cycle().F) == pytest.approx(-120.0)
    assert peak_force(cycle()) == pytest.approx(100.0, rel=1e-2)


def test_cycles_are_compared_along_the_path():
    comparison = compare_curves(cycle(), cycle(n=331))
    assert comparison.cyclic
    assert comparison.l2_peak_percent_whole < 0.5
    assert comparison.errors["u"].min() == pytest.approx(-1.2)
    assert compare_curves(cycle(), cycle(scale=1.06)).l2_percent_whole == pytest.approx(6.0, rel=1e-6)


def test_a_cycle_is_not_held_against_a_curve_that_was_never_unloaded():
    """As far as both have the same path they agree; beyond it there is nothing to compare."""
    for reference, other in ((curve(), cycle()), (cycle(), curve())):
        with pytest.raises(CurveError, match=r"path of loading .* only up to u = 1.5.*cannot be compared"):
            compare_curves(reference, other)
        comparison = compare_curves(reference, other, minimum_share=0.2)
        assert comparison.errors["u"].max() == pytest.approx(1.5)
        assert comparison.l2_peak_percent_whole < 0.1


def test_cycle_that_stops_unloaded_is_truncated_not_broken():
    whole = cycle()
    unloaded = int(np.argmax(whole.u[1:] == 0.0)) + 2
    with pytest.raises(CurveError, match="covers only"):
        compare_curves(whole, Curve(whole.u[:unloaded], whole.F[:unloaded]))


def test_relative_error_is_skipped_where_the_reference_is_negligible():
    table = compare_curves(curve(), curve(scale=1.06), n=2001).errors
    negligible = table["F_reference"].abs() < 1e-3 * STIFFNESS
    assert negligible.any()
    assert table["relative_error_percent"].isna().equals(negligible)


# --- metrics of runs ------------------------------------------------------------------------------


def run_of(load_curve, path=((0.0, 0.0), (1.0, 0.0)), h=0.1, **measures):
    mean_force = 0.5 * (load_curve.F[1:] + load_curve.F[:-1])
    work = np.concatenate([[0.0], np.cumsum(mean_force * np.diff(load_curve.u))])
    elastic = 0.5 * load_curve.F * load_curve.u
    columns = {"u": load_curve.u, "F": load_curve.F, "W_ext": work, "E_el": elastic}
    history = pd.DataFrame({**columns, "E_frac": 3.0 + work - elastic, "E_kin": 0.0})
    case = SimpleNamespace(mesh=SimpleNamespace(h=h), plane=SimpleNamespace(thickness=2.0), notches=[], dynamics=None)
    info = {"run": "a run", "measures": measures}
    return SimpleNamespace(
        history=history, crack_path=np.array(path), case=case, info=info, snapshots=lambda: []
    )


def test_metrics_of_a_run():
    run = run_of(curve(), path=[(0, 0), (3, 4)], constraint_error=1e-3)
    assert METRICS["peak_force"](run) == pytest.approx(100.0)
    dissipated = STIFFNESS * (0.5 + (1 - np.exp(-3.0)) / 3.0) - 0.5 * U_END * softening(U_END)
    assert METRICS["dissipated_work"](run) == pytest.approx(dissipated, rel=1e-4)
    assert METRICS["fracture_energy"](run) == pytest.approx(3.0 + dissipated, rel=1e-4)
    assert METRICS["dissipated_work"](run_of(curve(end=0.9))) == pytest.approx(0.0, abs=1e-9)
    assert METRICS["energy_balance"](run) == pytest.approx(0.0, abs=1e-12)
    assert METRICS["crack_length"](run) == pytest.approx(5.0)
    assert METRICS["crack_angle"](run) == pytest.approx(np.degrees(np.arctan2(4, 3)))
    assert METRICS["tip_y"](run) == pytest.approx(4.0)
    assert METRICS["constraint_error"](run) == METRICS["measure"](run, name="constraint_error") == 1e-3


def test_crack_angle_in_a_layer_leaves_the_other_layers_out():
    run = run_of(curve(), path=[(0.0, 0.0), (1.0, 1.0), (0.0, 3.0)])
    assert METRICS["crack_angle_in_layer"](run, lower=0.1, upper=0.9) == pytest.approx(45.0, abs=0.1)
    slope = np.degrees(np.arctan2(2.0, -1.0))
    assert METRICS["crack_angle_in_layer"](run, lower=1.1, upper=2.9) == pytest.approx(slope, abs=0.1)
    with pytest.raises(MetricError, match="no crack between y = 4 and 5"):
        METRICS["crack_angle_in_layer"](run, lower=4.0, upper=5.0)


@pytest.mark.parametrize(("angle", "off"), [(23.0, 3.0), (-157.0, 3.0), (115.0, 5.0), (110.0 + 180.0, 0.0)])
def test_crack_is_off_the_nearest_of_the_weak_directions(variant, angle, off):
    tip = (np.cos(np.radians(angle)), np.sin(np.radians(angle)))
    run = run_of(curve(), path=[(0.0, 0.0), tip])
    turned = {"solid": {"fracture": {"orientation": 20.0}}}
    run.case.materials = variant("square_plate_anisotropic", materials=turned).materials
    assert METRICS["angle_off_weak_direction"](run) == pytest.approx(off, abs=0.01)
    run.case.materials = variant("sen_tension").materials
    with pytest.raises(MetricError, match="no weak direction"):
        METRICS["angle_off_weak_direction"](run)


def test_crack_turn_is_what_is_missing_of_the_turn():
    reference = run_of(curve(), path=[(0.0, 0.0), (-1.0, 0.01)])
    run = run_of(curve(), path=[(0.0, 0.0), (-1.0, -1.0)])
    missing = PAIR_METRICS["crack_turn"](run, reference, by=44.0)
    assert missing == pytest.approx(1.0 + np.degrees(np.arctan(0.01)), abs=1e-6)


def test_surface_energy_of_a_run_is_that_of_its_material():
    run = run_of(curve())
    cubic = {"gamma_1111": 1.0, "gamma_2222": 1.0, "gamma_1212": 74.0}
    fracture = Fracture(toughness=0.5, length_scale=1.0, order=4, gamma=cubic)
    run.case.materials = {"solid": SimpleNamespace(fracture=fracture), "rigid": SimpleNamespace(fracture=None)}
    assert METRICS["least_surface_energy"](run) == pytest.approx(0.5 * np.sqrt(2.0))
    assert METRICS["largest_surface_energy"](run, material="solid") == pytest.approx(1.1575, abs=1e-4)
    with pytest.raises(MetricError, match="'rigid' cannot break"):
        METRICS["largest_surface_energy"](run, material="rigid")


def test_energy_balance_sees_lost_work():
    run = run_of(curve())
    run.history["E_frac"] -= 0.02 * run.history["W_ext"]
    assert METRICS["energy_balance"](run) == pytest.approx(0.02)
    assert METRICS["energy_balance"](run, at="end") == pytest.approx(0.02)


def test_energy_balance_of_a_free_body_counts_friction_and_is_a_share_of_its_starting_energy():
    run, lost, friction = run_of(curve()), 0.03, -0.25
    kinetic = np.linspace(1.0, 1.0 + friction - lost, len(run.history))
    run.history = run.history.assign(W_ext=0.0, E_el=0.0, E_frac=0.0, E_kin=8.0 * kinetic)
    run.history["W_contact"] = 8.0 * friction * np.linspace(0.0, 1.0, len(run.history))
    assert METRICS["energy_balance"](run, at="end") == pytest.approx(lost)


def test_what_transfer_takes_is_told_beside_what_is_missing():
    run, grown = run_of(curve()), np.linspace(0.0, 1.0, len(run_of(curve()).history))
    run.history = run.history.assign(W_ext=2.0 * grown, E_el=0.0, E_frac=0.0, E_kin=1.9 * grown, W_contact=0.0)
    run.history["W_transfer"] = 0.5 - 0.08 * grown
    assert METRICS["energy_balance"](run, at="end") == pytest.approx(0.05)
    assert METRICS["transfer_loss"](run) == pytest.approx(0.04)
    assert METRICS["unaccounted_energy"](run) == pytest.approx(0.01)


def test_fracture_energy_rate_is_the_slope_of_the_last_part_over_the_thickness():
    run = run_of(curve())
    run.history["E_frac"] = np.maximum(0.0, 7.0 * (run.history["u"] - 0.8))
    assert METRICS["fracture_energy_rate"](run) == pytest.approx(3.5)


def test_metrics_of_two_runs():
    reference = run_of(curve())
    run = run_of(curve(scale=1.06), path=[(0, 0.02), (1, 0.02)])
    assert PAIR_METRICS["curve_l2_before_peak"](run, reference) == pytest.approx(0.06)
    mean_square = np.mean(softening(np.linspace(0, U_END, 501)) ** 2)
    normalised = 0.06 * np.sqrt(mean_square) / STIFFNESS
    assert PAIR_METRICS["curve_l2_peak_normalised"](run, reference) == pytest.approx(normalised, rel=1e-3)
    assert PAIR_METRICS["curve_l2_whole"](run, curve()) == pytest.approx(0.06)
    assert PAIR_METRICS["curve_max_error_until"](run, curve(), u_max=0.5) == pytest.approx(0.03)
    assert PAIR_METRICS["path_hausdorff"](run, reference) == pytest.approx(0.02)
    assert PAIR_METRICS["path_mean_distance_over_h"](run, reference) == pytest.approx(0.2)


def with_two_cracks(lower):
    """A run whose last state has cracks from (0, 0.6) to (0.4, 0.6) and from (0.6, lower) to (1, lower)."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 1, 101), np.linspace(0, 1, 101)))
    upper = np.hypot(x - np.clip(x, 0.0, 0.4), y - 0.6)
    other = np.hypot(x - np.clip(x, 0.6, 1.0), y - lower)
    data = {"reference": np.column_stack([x, y, 0 * x]), "phase_field": 1 - np.exp(-np.minimum(upper, other) / 0.02)}
    run = run_of(curve(), h=0.02)
    run.points = lambda: SimpleNamespace(point_data=data)
    return run


def test_of_several_cracks_those_from_one_place_are_compared():
    run, reference = with_two_cracks(lower=0.34), with_two_cracks(lower=0.3)
    distance = PAIR_METRICS["path_mean_distance_over_h"]
    assert distance(run, reference, start=[0.6, 0.32]) == pytest.approx(2.0, abs=0.2)
    assert distance(run, reference, start=[0.0, 0.6]) == pytest.approx(0.0, abs=0.01)
    with pytest.raises(MetricError, match="no crack that begins at"):
        distance(run, reference, start=[0.5, 0.9])


def test_metrics_refuse_what_they_cannot_give():
    intact = run_of(curve(), path=np.empty((0, 2)))
    assert METRICS["crack_length"](intact) == 0.0
    for refused in (
        lambda: METRICS["tip_x"](intact),
        lambda: PAIR_METRICS["path_hausdorff"](intact, run_of(curve())),
        lambda: METRICS["peak_force"](intact, u_max=1.0),
        lambda: METRICS["energy_release_rate"](intact, inner=1.0, outer=2.0),
        lambda: METRICS["constraint_error"](intact),
        lambda: find_metric("peek_force"),
    ):
        with pytest.raises(MetricError):
            refused()


def test_two_metrics_cannot_have_one_name():
    with pytest.raises(ValueError, match="two metrics are called 'peak_force'"):
        metric("force", "another peak", name="peak_force")(lambda run: 0.0)


def test_fitted_order():
    h = np.array([0.1, 0.05, 0.025])
    runs = [run_of(curve(), h=size, l2_error_displacement=3 * size**2) for size in h]
    assert SWEEP_METRICS["convergence_order"](runs) == pytest.approx(2.0)
    assert fitted_order(h, 0.5 * h**1.5) == pytest.approx(1.5)
    bad = ([0.1], [1.0]), ([0.1, 0.1], [1, 2]), ([0.1, 0.2], [0, 1]), ([1, 2], [1, np.nan])
    for bad_h, bad_error in bad:
        with pytest.raises(MetricError):
            fitted_order(bad_h, bad_error)


def solved_curve(u, F):
    """As of a solver: it tells how often it iterated."""
    return Curve.from_history(pd.DataFrame({"u": u, "F": F, "staggered": np.ones(len(u))}), "a run")


@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_what_acts_before_the_load_changes_neither_stiffness_nor_the_sign_of_the_peak(turned):
    """A bar that was heated between its ends is pressed first, and breaks in tension."""
    u = np.linspace(0.0, 0.02, 11)
    F = np.minimum(250.0 * (u - 0.004), 2.3 * (1.0 - 20.0 * np.maximum(u - 0.014, 0.0)))
    heated = solved_curve(turned * u, turned * F)
    assert preloaded(heated)
    assert initial_stiffness(heated) == pytest.approx(250.0)
    assert peak_force(heated) == pytest.approx(turned * F.max())


def test_what_unloading_gives_back_is_not_known_of_a_run_that_begins_under_a_force():
    heated = run_of(solved_curve(np.array([0.0, 1.0]), np.array([-1.0, 3.0])))
    heated.history["staggered"] = 1
    with pytest.raises(MetricError, match="begins under a force, and what unloading would give back is not known"):
        METRICS["dissipated_work"](heated)
