"""Metrics of running cracks on synthetic runs, frames of moving runs, and the film made of them."""

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from test_crack_front import FORK, LENGTH_SCALE, SPEED, START, H, branched_crack, lattice

from cases import load_case
from cases.material import Fracture, Material
from cases.notches import HistoryNotch
from numerics.fields import Fields
from reports.film import film
from verify.metrics.metric import MetricError
from verify.metrics.registry import METRICS, PAIR_METRICS, find_metric
from verify.runs.frames import MOST_POINTS, FrameWriter, read_frames

GLASS = Material(
    young=32000.0, poisson=0.2, density=2450.0, fracture=Fracture(toughness=0.003, length_scale=LENGTH_SCALE)
)


class DrawnRun(SimpleNamespace):
    """Hashable, as finished runs are."""

    __hash__ = object.__hash__


def synthetic_run(broken: bool = True, shift: float = 0.0):
    """A run whose crack is drawn: a notch to START, broken from the first, and a fork behind it."""
    points = lattice()
    phase, when = branched_crack(points)
    in_notch = (np.abs(points[:, 1] - START[1]) < 0.5) & (points[:, 0] < START[0])
    when, phase = np.where(in_notch, 0.0, when + 1.0), np.where(in_notch, 0.0, phase)
    if not broken:
        when, phase = np.full(len(points), np.nan), np.ones(len(points))
    data = {
        "reference": np.column_stack([points, np.zeros(len(points))]), "phase_field": phase, "broken_at": when,
        "volume": np.full(len(points), (0.5 * H) ** 2), "body": np.zeros(len(points)),
    }  # fmt: skip
    time = np.linspace(0.0, 50.0, 51)
    history = pd.DataFrame({"time": time, "E_el": 0.01 * time, "E_frac": 0.5 + 0.02 * time + shift})
    lower, upper = points.min(axis=0), points.max(axis=0)
    plate = SimpleNamespace(material="glass", bounds=lambda: (lower, upper))
    case = SimpleNamespace(
        bodies={"plate": plate}, fracture_enabled=True, name="drawn",
        mesh=SimpleNamespace(h=H), plane=SimpleNamespace(thickness=1.0), materials={"glass": GLASS},
        all_notches=(HistoryNotch(kind="history", start=(0.0, 20.0), end=tuple(START), factor=1000.0),),
        inside=lambda places: np.zeros(len(places), dtype=int),
    )  # fmt: skip
    info = {"run": "drawn", "seconds": {"phase_field": 2.0, "increments": 8.0}}
    nothing = np.empty((0, 2))
    last = SimpleNamespace(point_data=data)
    return DrawnRun(history=history, info=info, case=case, crack_path=nothing, points=lambda u=None: last)


@pytest.mark.parametrize(
    ("metric", "parameters", "expected", "error"),
    [
        ("initiation_time", {}, 1.0, 2 * LENGTH_SCALE / SPEED),
        ("stored_energy_at_initiation", {}, 0.01, 0.02 * LENGTH_SCALE / SPEED),
        ("branching_time", {}, 1.0 + np.linalg.norm(FORK - START) / SPEED, 3 * H / SPEED),
        ("branching_angle", {"length": 10.0}, 60.0, 3.0),
        ("crack_direction", {"until": 20.0}, 0.0, 2.0),
        ("branch_count", {}, 2.0, 0.0),
        ("branch_count", {"until": 20.0}, 1.0, 0.0),
        ("enclosed_pieces", {}, 0.0, 0.0),
        ("tip_speed", {"interval": 1.0}, SPEED, 0.25 * SPEED),
        ("tip_speed", {"interval": 1.0, "over_rayleigh": 1}, SPEED / 2.12521, 0.25 * SPEED / 2.12521),
        ("fragments", {}, 1.0, 0.0),
        ("fracture_energy_gain", {"after": 10.0, "until": 20.0}, 0.2, 1e-12),
        ("phase_field_share", {}, 0.25, 1e-12),
    ],
)
def test_metrics_of_a_drawn_crack(metric, parameters, expected, error):
    assert METRICS[metric](synthetic_run(), **parameters) == pytest.approx(expected, abs=error + 1e-12)


def test_a_branch_points_half_way_between_its_stem_and_its_arm_of_the_same_length():
    assert abs(METRICS["branch_angle"](synthetic_run())) == pytest.approx(15.0, abs=0.5)


def test_a_crack_has_no_direction_where_nothing_broke_beyond_its_notch():
    arms = METRICS["crack_direction"](synthetic_run())
    assert 10.0 < abs(arms) < 30.0, "from the notch to the tip of an arm that leaves the stem at 30 degrees"
    with pytest.raises(MetricError, match="nothing broke beyond its notch"):
        METRICS["crack_direction"](synthetic_run(), until=0.5)
    without = synthetic_run()
    without.case.all_notches = ()
    with pytest.raises(MetricError, match="0 notches"):
        METRICS["crack_direction"](without)


def test_a_drawn_crack_is_symmetric_about_its_own_axis_only():
    assert METRICS["asymmetry"](synthetic_run(), direction="y", middle=20.0) < 1e-12
    assert METRICS["asymmetry"](synthetic_run(), direction="x", middle=30.0) > 0.9
    with pytest.raises(MetricError, match="give 'x' or 'y'"):
        METRICS["asymmetry"](synthetic_run(), direction="z", middle=0.0)


def test_travel_says_along_which_axis():
    history = pd.DataFrame({"time": [0.0, 1.0, 2.0], "block_x": [0.0, 1.0, 2.0], "block_y": [5.0, 5.0, 5.0]})
    run = SimpleNamespace(history=history, info={"run": "drawn"})
    assert METRICS["travel"](run, body="block", time=2.0, direction="x") == pytest.approx(2.0)
    assert METRICS["travel"](run, body="block", time=2.0, direction="y") == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(MetricError, match="direction"):
        METRICS["travel"](run, body="block", time=2.0)
    with pytest.raises(MetricError, match="give 'x' or 'y'"):
        METRICS["travel"](run, body="block", time=2.0, direction="z")


def test_two_arms_about_the_middle_are_a_cone_and_one_crack_is_none():
    run = synthetic_run()
    across = {"middle": FORK[1], "within": 15.0}
    data = run.points().point_data
    data["reference"] = data["reference"][:, [1, 0, 2]]  # the fork opens upwards
    end = data["reference"][data["phase_field"] < 0.25, 1].max()
    assert METRICS["cone_index"](run, level=end - 2.0 * LENGTH_SCALE, **across) == 1.0
    assert METRICS["cone_index"](run, level=0.5 * (START[0] + FORK[0]), **across) == 0.0
    assert METRICS["cone_index"](run, level=end + 5.0, **across) == 0.0


@pytest.mark.parametrize("metric", ["initiation_time", "branching_time"])
def test_where_nothing_breaks_there_is_no_value(metric):
    with pytest.raises(MetricError, match="nothing broke"):
        METRICS[metric](synthetic_run(broken=False))


def test_histories_differ_by_their_largest_distance():
    difference = PAIR_METRICS["history_difference"]
    run, reference = synthetic_run(shift=0.1), synthetic_run()
    assert difference(run, reference, column="E_frac") == pytest.approx(0.1 / 1.5)
    assert difference(run, reference, column="E_frac", until=10.0) == pytest.approx(0.1 / 0.7)
    assert difference(run, reference, column="E_frac", since_start=1) == pytest.approx(0.0)
    with pytest.raises(MetricError, match="has no values of E_none"):
        difference(run, reference, column="E_none")


# --- frames ---------------------------------------------------------------------------------------


def fields_at(time: float, count: int = 50) -> Fields:
    """A square of points that moves to the right, the lower half of it broken after a while."""
    x, y = np.meshgrid(np.linspace(0.0, 1.0, count), np.linspace(0.0, 1.0, count))
    reference = np.column_stack([x.ravel(), y.ravel()])
    n, nothing = len(reference), np.zeros((len(reference), 2))
    phase = np.where((reference[:, 1] < 0.5) & (time > 1.5), 0.0, 1.0)
    moved = np.tile([time, 0.0], (n, 1))
    return Fields(
        points=reference + moved, reference=reference, volume=np.ones(n), displacement=moved, gradient=np.zeros((n, 4)),
        phase_field=phase, history_field=np.zeros(n), stress=np.tile([3.0, 1.0, 0.0], (n, 1)), energy_density=np.zeros(n),
        body=np.zeros(n, int), grid_points=nothing, grid_cells=np.zeros((1, 4), int), grid_displacement=nothing,
        grid_phase_field=np.ones(n),
    )  # fmt: skip


def write_frames(folder: Path, until: float = 3.0, after: float = -np.inf, count: int = 50) -> None:
    writer = FrameWriter(folder / "frames", (0.0, 1.0, 2.0, 3.0))
    writer.start(SimpleNamespace(u=after), "")
    for time in np.arange(0.0, until + 0.01, 0.25):
        if time > after:
            solver = SimpleNamespace(fields=lambda now=time: fields_at(now, count))
            writer.record(SimpleNamespace(u=time, is_good=True), solver)


def test_frames_come_at_their_times_and_hold_the_points(tmp_path):
    write_frames(tmp_path)
    frames = list(read_frames(tmp_path))
    assert [frame.time for frame in frames] == [0.0, 1.0, 2.0, 3.0]
    np.testing.assert_allclose(frames[2].displacement[:, 0], 2.0)
    np.testing.assert_allclose(frames[2].hydrostatic_stress, 2.0)
    assert frames[1].phase_field.min() == 1.0 and frames[2].phase_field.min() == 0.0


def test_a_resumed_run_writes_the_frames_that_are_left(tmp_path):
    write_frames(tmp_path, until=1.0)
    write_frames(tmp_path, after=1.0)
    assert [frame.time for frame in read_frames(tmp_path)] == [0.0, 1.0, 2.0, 3.0]


def test_frames_of_many_points_hold_some_of_them(tmp_path):
    write_frames(tmp_path, until=0.0, count=300)
    (frame,) = read_frames(tmp_path)
    assert 0.4 * MOST_POINTS < len(frame.reference) <= MOST_POINTS


def test_a_run_without_frames_has_none(tmp_path):
    assert list(read_frames(tmp_path)) == []


def test_the_film_has_a_picture_for_each_frame(tmp_path):
    write_frames(tmp_path)
    run = SimpleNamespace(name="mpm", label="PF-MPM", frames=list(read_frames(tmp_path)))
    results = SimpleNamespace(case=None, main_runs=lambda largest=2: [run], unit=lambda kind: kind)
    made = film(results, tmp_path / "figures")
    assert made.times == [0.0, 1.0, 2.0, 3.0] and len(made.files) == 4
    assert all((tmp_path / "figures" / file).stat().st_size > 2000 for file in made.files)
    run.frames = []
    assert film(results, tmp_path / "figures") is None


def test_waves_of_the_thesis_plate_and_their_critical_step():
    """Printed: 2125 m/s and, with the factor 0.8, 0.026 us at 0.125 mm."""
    run = SimpleNamespace(case=load_case("plate_impact"))
    assert find_metric("rayleigh_speed")(run) == pytest.approx(2.125, rel=1e-3)
    young, poisson, density = 32000.0, 0.2, 2450.0
    speed = math.sqrt(young * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson) * density))
    assert find_metric("critical_step")(run, h=0.125, share=0.8) == pytest.approx(0.1 / speed)
    with pytest.raises(MetricError, match="no material 'steel'"):
        find_metric("critical_step")(run, h=0.125, material="steel")
