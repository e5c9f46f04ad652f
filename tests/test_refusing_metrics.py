"""Metrics of runs to which they do not apply say so: nothing that did not happen passes a check."""

from __future__ import annotations

from pathlib import Path

import pytest

from cases import load_case
from verify import compare, run
from verify.judging.judge import checks_of
from verify.judging.targets import JudgeError
from verify.metrics.metric import MetricError
from verify.metrics.registry import METRICS, PAIR_METRICS
from verify.runs.run_folder import RunFolder

CASE = """
title = "Two squares"
requirement = "What does not happen is not judged."
units = { length = "mm", force = "N", time = "ms" }
plane = { assumption = "strain", thickness = 1.0 }
dynamics = { end_time = 0.5 }
mesh.h = 1.0
output = { records = 10, times = [0.1] }
runs.mpm = { solver = "mpm" }
materials.whole = { young = "1 GPa", poisson = 0.3, density = "1000 kg/m^3" }
materials.brittle = { young = "1 GPa", poisson = 0.3, density = "1000 kg/m^3", fracture = FRACTURE }
""".replace("FRACTURE", "{ toughness = 1.0, length_scale = 1.0 }")
SQUARES = """
bodies.left = { material = "whole", velocity = [VELOCITY, 0], shape = { rectangle = { lower = [0, 0], upper = [4, 4] } } }
bodies.right = { material = "MATERIAL", shape = { rectangle = { lower = [6, 0], upper = [10, 4] } } }
"""


def check(metric: str, parameters: str = "") -> str:
    known = f'[[checks]]\nmetric = "{metric}"\nrun = "mpm"\nagainst = "none"\nlimit = 0.0\nreason = "none"\n'
    return f"{known}parameters = {{ {parameters} }}\n"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, RunFolder]:
    """Bodies that stand apart, those that meet, and those of which one could break."""
    made = {}
    for name, velocity, material in (("apart", 0, "whole"), ("meeting", 8, "whole"), ("brittle", 0, "brittle")):
        folder = tmp_path_factory.mktemp(name)
        file = folder / f"{name}.toml"
        file.write_text(CASE + SQUARES.replace("VELOCITY", str(velocity)).replace("MATERIAL", material))
        made[name] = run(file, "mpm", out=folder, threads=1)
    return made


def test_bodies_that_never_touch_meet_no_condition_of_contact(runs: dict[str, RunFolder]) -> None:
    assert METRICS["contact_violations"](runs["meeting"]) == 0.0
    with pytest.raises(MetricError, match="no body touches another; run it longer"):
        METRICS["contact_violations"](runs["apart"])


def test_bodies_at_rest_have_no_momentum_or_energy_to_keep(runs: dict[str, RunFolder]) -> None:
    assert METRICS["momentum_drift"](runs["meeting"]) < 1e-9
    with pytest.raises(MetricError, match="begin at rest, with no momentum to keep; give one a velocity"):
        METRICS["momentum_drift"](runs["apart"])
    for metric, parameters in (("energy_left", {}), ("energy_drift", {"length": 4.0})):
        assert METRICS[metric](runs["meeting"], **parameters) < 1.1
        with pytest.raises(MetricError, match="begins without energy"):
            METRICS[metric](runs["apart"], **parameters)


def test_a_check_of_contact_without_any_fails(tmp_path: Path) -> None:
    file = tmp_path / "apart.toml"
    file.write_text(CASE + SQUARES.replace("VELOCITY", "0").replace("MATERIAL", "whole") + check("contact_violations"))
    run(file, "mpm", out=tmp_path, threads=1)
    assert compare(file, out=tmp_path)["verdict"] == "FAIL"


@pytest.mark.parametrize(
    ("name", "metric", "said"),
    [
        ("apart", "asymmetry", "no body can break"),
        ("brittle", "asymmetry", "has no crack that could be asymmetric"),
        ("apart", "phase_field_share", "has no phase field"),
    ],
)
def test_what_cannot_break_has_no_crack_to_judge(runs: dict[str, RunFolder], name: str, metric: str, said: str) -> None:
    parameters = {"direction": "y", "middle": 2.0} if metric == "asymmetry" else {}
    with pytest.raises(MetricError, match=said):
        METRICS[metric](runs[name], **parameters)


def test_bodies_are_mirrored_about_their_middle(runs: dict[str, RunFolder]) -> None:
    with pytest.raises(MetricError, match=r"their middle at x = 8, not at 5; give middle = 8"):
        METRICS["asymmetry"](runs["brittle"], direction="x", middle=5.0)


def test_stress_of_a_moving_body_is_that_of_its_time(runs: dict[str, RunFolder]) -> None:
    place = {"at": (2.0, 2.0), "component": "xx", "radius": 2.0}
    assert METRICS["stress_at"](runs["meeting"], u=0.1, **place) == pytest.approx(0.0, abs=1e-6)
    assert abs(METRICS["stress_at"](runs["meeting"], u=0.5, **place)) > 1e-3
    with pytest.raises(MetricError, match=r"has no fields at t = 0.3, .* add 0.3 to output.times"):
        METRICS["stress_at"](runs["meeting"], u=0.3, **place)
    with pytest.raises(MetricError, match="has no force on a section"):
        METRICS["stress_concentration"](runs["meeting"], u=0.1, section=4.0, **place)


@pytest.mark.parametrize("metric", ["peak_force", "end_displacement", "initial_stiffness", "dissipated_work"])
def test_a_run_in_time_has_no_force_over_displacement(runs: dict[str, RunFolder], metric: str) -> None:
    with pytest.raises(MetricError, match="moves in time, and its F is the power"):
        METRICS[metric](runs["meeting"])


def test_a_body_in_motion_has_no_release_rate_of_statics(runs: dict[str, RunFolder]) -> None:
    with pytest.raises(MetricError, match="of the elastic one, and inertia has no part in the integral"):
        METRICS["energy_release_rate"](runs["meeting"], inner=0.5, outer=1.5, tip=(2.0, 2.0), direction=(1.0, 0.0))


def test_times_of_which_nothing_is_recorded_are_told(runs: dict[str, RunFolder]) -> None:
    with pytest.raises(MetricError, match=r"has nothing between t = 0.5 and 0.5"):
        METRICS["fracture_energy_gain"](runs["brittle"], after=0.5)
    with pytest.raises(MetricError, match=r"records nothing from t = 0.6 to inf"):
        PAIR_METRICS["history_difference"](runs["apart"], runs["meeting"], column="E_kin", after=0.6)
    with pytest.raises(MetricError, match=r"its W_ext is zero throughout, .* name another column"):
        PAIR_METRICS["history_difference"](runs["apart"], runs["meeting"], column="W_ext")
    with pytest.raises(MetricError, match=r"has no t = -1, it goes from 0 to 0.5"):
        METRICS["angular_velocity"](runs["apart"], body="left", time=-1.0)


@pytest.mark.parametrize(
    ("metric", "parameters"), [("fracture_energy_gain", "after = 0.9"), ("tilt", "start = 0.0, end = 0.9")]
)
def test_a_check_of_a_time_that_no_run_reaches_is_refused(metric: str, parameters: str, tmp_path: Path) -> None:
    file = tmp_path / "late.toml"
    text = CASE + SQUARES.replace("VELOCITY", "0").replace("MATERIAL", "brittle") + check(metric, parameters)
    file.write_text(text)
    with pytest.raises(JudgeError, match=r"0\.9 comes after dynamics\.end_time = 0\.5"):
        checks_of(load_case(file))
    file.write_text(text.replace('solver = "mpm" }', 'solver = "mpm", change = { dynamics = { end_time = 1.0 } } }'))
    assert len(checks_of(load_case(file))) == 1
