"""Rigid blocks as solvers of a case, the verdict on bodies that rock, and the end of a run where it is settled."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cases import Case, CaseError, case_from_tables, load_case
from cases.geometry import Shape
from numerics.explicit import instants
from physics.rocking.block import Block
from physics.rocking.ground import pulse as pulse_of
from physics.rocking.ground import record
from physics.rocking.motion import Verdict, impacts_of, settled_verdict
from physics.rocking.of_case import block_of, foundation_of, ground_motion, pendulum_of
from reports.results import CaseResults
from reports.rocking import _distinct as distinct_motions
from reports.rocking_diagram import diagram
from rigid_block import LinearPendulumMotion, PendulumMotion, WinklerMotion
from verify import compare, run
from verify.cli import main
from verify.metrics.metric import MetricError
from verify.metrics.registry import METRICS
from verify.planning.savings import savings


def case_of(folder: Path, name: str = "pendulum", **changes: Any) -> Case:
    """The library's block with keys of the table rocking and of the ground's motion changed."""
    source = load_case("rocking_pendulum", "quick").source
    return load_case(source, "quick", name, changes)


def pulse(uplift: float, frequency: float = 3.0) -> dict[str, Any]:
    return {"dynamics": {"ground": {"uplift_ratio": uplift, "frequency_ratio": frequency}}}


def no_borders(**more: Any) -> dict[str, Any]:
    return {"rocking": {"borders": [], **more}}


class Told:
    """A run as metrics see it, from a history."""

    def __init__(self, case: Case, history: pd.DataFrame) -> None:
        self.case, self.history, self.info = case, history, {"run": "mpm"}


def history_of(solver: Any, case: Case) -> pd.DataFrame:
    return pd.DataFrame([instant.row() for instant in instants(solver, case)])


def test_the_block_is_that_of_the_case_in_its_units(tmp_path):
    case = case_of(tmp_path)
    block, foundation = block_of(case), foundation_of(case)
    assert block.frequency == pytest.approx(2.14008, abs=1e-5)
    assert block.mass == pytest.approx(606.101e-6 * 0.795 * 3.113)
    assert foundation.stiffness == pytest.approx(377.0, rel=2e-3)  # Wolf; vertical [MN/m³]
    assert foundation.damping == pytest.approx(0.6745, rel=1e-3)
    rocking = foundation_of(case_of(tmp_path, rocking={"stiffness": "rocking"}))
    assert rocking.stiffness == pytest.approx(1030.0, rel=5e-3)
    linear = pendulum_of(case, linear=True)
    assert ground_motion(case, linear.uplift_acceleration).amplitude == pytest.approx(2.5 * 9.81 * block.slenderness)


@pytest.mark.parametrize("made_by", [PendulumMotion, LinearPendulumMotion, WinklerMotion])
def test_its_history_has_the_columns_of_the_material_points(tmp_path, made_by):
    case = case_of(tmp_path, **pulse(1.1), **no_borders(), output={"records": 800}, contact={"friction": 0.625})
    solver = made_by(case)
    history = history_of(solver, case)
    assert {f"block_{c}" for c in ("x", "y", "momentum_x", "momentum_y", "spin", "angle")} <= set(history)
    # spin is the rate of the angle, momentum that of the place
    for rate, of in (("block_spin", "block_angle"), ("block_momentum_x", "block_x")):
        slope = np.gradient(history[of], history["time"])
        scale = solver.block.mass if "momentum" in rate else 1.0
        off = np.abs(scale * slope - history[rate])
        assert np.quantile(off, 0.9) < 0.1 * np.abs(history[rate]).max()
    # the base and impacts take energy only
    assert history["W_contact"].min() > -0.5 * history["E_kin"].max() - 1e-3
    assert history["W_contact"].max() < 0.02 * history["E_kin"].max()
    fields = solver.fields()
    moved = fields.points - fields.reference
    assert np.abs(moved[fields.body == 1]).max() == 0.0
    assert np.isfinite(fields.points).all()


def test_a_restored_block_tells_the_same_time(tmp_path):
    case = case_of(tmp_path, **pulse(1.3), **no_borders())
    solver, other = PendulumMotion(case), PendulumMotion(case)
    assert solver.steps(np.array([0.4, 0.5]), 0.1) == 2
    other.restore(solver.checkpoint())
    assert other.monitored() == solver.monitored()


@pytest.mark.parametrize(("uplift", "frequency", "number"), [(1.2, 3.0, 0), (2.5, 3.0, 1), (4.0, 3.0, 2)])
def test_a_run_ends_where_its_verdict_is_settled_and_tells_it(tmp_path, uplift, frequency, number):
    case = case_of(tmp_path, **pulse(uplift, frequency), **no_borders())
    ended = run(case, "pendulum", out=tmp_path, threads=1)
    assert ended.good and "the verdict on block is settled" in ended.info["reason"]
    assert ended.history["time"].iloc[-1] < case.dynamics.end_time
    assert METRICS["verdict"](ended) == number
    whole = case_of(tmp_path, **pulse(uplift, frequency), **no_borders(stop_when_settled=False))
    assert METRICS["verdict"](Told(whole, history_of(PendulumMotion(whole), whole))) == number
    named = {saving.name: saving for saving in savings(case)}["end at a settled verdict"]
    assert named.used and named.off == {"rocking": {"stop_when_settled": False}}


def test_metrics_of_a_known_motion(tmp_path):
    case = case_of(tmp_path, **pulse(1.2), **no_borders())
    time = np.linspace(0.0, 4.0, 4001)
    angle = np.radians(5.0) * np.sin(2 * np.pi * time / 2.0)  # peak at 0.5, impacts at 1, 2 and 3
    told = Told(case, pd.DataFrame({"time": time, "block_angle": angle, "block_spin": np.gradient(angle, time)}))
    assert METRICS["first_peak_time"](told) == pytest.approx(0.5, abs=1e-3)
    assert METRICS["first_peak_angle"](told) == pytest.approx(5.0, abs=1e-6)
    assert METRICS["first_impact_time"](told) == pytest.approx(1.0, abs=1e-6)
    assert METRICS["impacts"](told) == 3
    assert METRICS["energy_kept"](told) == pytest.approx(1.0, abs=1e-5)
    assert METRICS["tilt"](told, start=0.0, end=0.25) == pytest.approx(5.0 * math.sin(math.pi / 4), abs=1e-3)
    with pytest.raises(MetricError, match="stays below 85 degrees"):
        METRICS["overturning_time"](told)


def block_in_units(length: str, force: str, time: str, size: float, name: str) -> Case:
    """A stone of 0.4 m x 2 m under a pulse, drawn in other units of which a metre has a number."""
    tables = {
        "title": "Block",
        "requirement": "It moves alike.",
        "units": {"length": length, "force": force, "time": time},
        "plane": {"assumption": "strain", "thickness": "1 m"},
        "materials": {"stone": {"young": "5 GPa", "poisson": 0.3, "density": "2000 kg/m^3"}},
        "bodies": {
            body: {"material": "stone", "shape": {"rectangle": {"lower": [-x, low], "upper": [x, up]}}}
            for body, x, low, up in (("block", 0.2 * size, 0.0, 2.0 * size), ("ground", size, -size, 0.0))
        },
        "dynamics": {
            "end_time": "4 s",
            "gravity": [0, "-9.81 m/s^2"],
            "ground": {"pulse": "sine", "uplift_ratio": 1.5, "frequency_ratio": 3.0},
        },
        "rocking": {"body": "block", "on": "ground"},
        "contact": {"friction": 0.6},
        "mesh": {"h": 0.1 * size},
        "runs": {name: {"solver": name}},
    }
    return case_from_tables(tables, run=name)


@pytest.mark.parametrize("made_by", [PendulumMotion, WinklerMotion])
def test_a_block_moves_alike_in_other_units(made_by):
    ends = []
    for length, force, time, size in (("m", "MN", "s", 1.0), ("mm", "N", "ms", 1e3)):
        case = block_in_units(length, force, time, size, made_by.solver)
        told = Told(case, history_of(made_by(case), case))
        ends.append((METRICS["verdict"](told), METRICS["overturning_time"](told) / size))
    assert ends[0] == (1.0, pytest.approx(2.2, abs=0.2)) and ends[1] == pytest.approx(ends[0], rel=1e-6)


@pytest.mark.parametrize("made_by", [PendulumMotion, WinklerMotion])
def test_a_block_on_a_ground_that_never_moves_stands(tmp_path, made_by):
    case = case_of(tmp_path, **no_borders())
    still = case.model_copy(update={"dynamics": case.dynamics.model_copy(update={"ground": None})})
    told = Told(still, history_of(made_by(still), still))
    assert METRICS["tilt"](told, start=0.0, end=4.0) < 1e-9 and METRICS["verdict"](told) == 0.0


def test_a_block_that_never_rests_is_followed_to_the_end(tmp_path):
    more = {"dynamics": {"end_time": 60.0, "ground": {"uplift_ratio": 1.2, "frequency_ratio": 3.0}}}
    case = case_of(tmp_path, **more, **no_borders(restitution=1.0, stop_when_settled=False), output={"records": 3000})
    told = history_of(PendulumMotion(case), case)
    late, early = (np.ptp(told["block_angle"][abs(told["time"] - at) < 5.0]) for at in (50.0, 10.0))
    assert late == pytest.approx(early, rel=0.05) and late > 0.02


@pytest.mark.parametrize(
    ("ground", "said"),
    [({"lower": [0.0, -1.0], "upper": [4.0, 0.0]}, "stands beyond the edge of 'ground'"), (None, "nothing is beneath")],
)
def test_a_block_stands_on_a_body_with_its_whole_base(ground, said):
    case = block_in_units("m", "MN", "s", 1.0, "winkler")
    stone = case.bodies["ground"]
    wider = {} if ground is None else {"ground": stone.model_copy(update={"shape": Shape(rectangle=ground)})}
    alone = case.rocking.model_copy(update={} if wider else {"on": None})
    changed = case.model_copy(update={"bodies": {"block": case.bodies["block"], **wider}, "rocking": alone})
    with pytest.raises(CaseError, match=said):
        WinklerMotion(changed)


def test_records_that_pass_over_impacts_give_no_verdict(tmp_path):
    case = case_of(tmp_path, **pulse(2.5), **no_borders(stop_when_settled=False), output={"records": 6})
    told = Told(case, history_of(PendulumMotion(case), case))
    for name in ("verdict", "impacts", "first_impact_time", "first_peak_angle", "energy_kept", "base_offset"):
        with pytest.raises(MetricError, match=r"is recorded every 0.667 s, .* set output.records to 35 or more"):
            METRICS[name](told)


def test_a_block_that_falls_at_once_has_no_peak(tmp_path):
    case = case_of(tmp_path, **pulse(4.0), **no_borders(stop_when_settled=False))
    with pytest.raises(MetricError, match="has no peak"):
        METRICS["first_peak_angle"](Told(case, history_of(PendulumMotion(case), case)))


@pytest.fixture(scope="module")
def rocked(tmp_path_factory):
    """A pendulum with its history in fine records."""
    folder = tmp_path_factory.mktemp("rocked")
    case = case_of(folder, **pulse(1.2), **no_borders(stop_when_settled=False), output={"records": 4000})
    return case, history_of(PendulumMotion(case), case)


def test_the_corner_of_the_pendulum_is_that_of_its_base(rocked):
    case, history = rocked
    told = Told(case, history.copy())
    assert METRICS["base_offset"](told) < 1e-3
    assert METRICS["force_offset"](told) < 1e-3
    # slower than energy has it: as on a narrower base
    told.history["block_spin"] *= 0.9
    assert METRICS["base_offset"](told) > 0.02


def test_a_force_beside_the_corner_is_found_where_it_passes(rocked):
    case, history = rocked
    told = Told(case, history.copy())
    # upright forces of the block's weight 20 mm beside the corner turn it faster by as much
    time, block = told.history["time"], block_of(case)
    told.history["block_spin"] += 0.02 * block.mass * block.gravity / block.inertia * time
    assert METRICS["force_offset"](told) == pytest.approx(0.02, rel=0.05)


def test_trembling_is_no_impact():
    time = np.linspace(0.0, 1.0, 1001)
    assert impacts_of(time, np.radians(0.09) * np.sin(40 * time)) == []


def test_a_verdict_is_open_until_nothing_can_change_it():
    block = Block(0.795, 3.113)
    time, out = np.array([0.0, 0.5, 1.0]), np.radians([0.0, 2.0, 10.0])
    enough = math.sqrt(2.2 * block.frequency**2 * (1.0 - math.cos(block.slenderness)))
    assert settled_verdict(block, 0.9, time, out, 0.9 * enough) is Verdict.NO_IMPACT
    assert settled_verdict(block, 0.9, time, out, 0.01) is None
    assert settled_verdict(block, 0.9, time, out, -enough) is None  # an impact comes first
    back = np.radians([0.0, 8.0, 5.0])
    little = math.sqrt(2.0 * block.frequency**2 * (1.0 - math.cos(block.slenderness - back[-1])))
    assert settled_verdict(block, 0.9, time, back, -0.1 * little) is Verdict.SAFE
    assert settled_verdict(block, 0.9, time, back, -0.9 * little) is None  # too near to the barrier
    assert settled_verdict(block, 0.9, time, np.radians([0.0, 12.0, 24.0]), -0.1) is None  # falls, hardly braked
    assert settled_verdict(block, 2.0, time, out, enough) is None  # the ground still moves
    assert settled_verdict(block, 9.0, time, np.radians([-1.0, 2.0, 85.1]), 0.0) is Verdict.AFTER_IMPACTS


def test_borders_are_told_by_a_command(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["borders", "rocking_pendulum", "--run", "linear", "--tier", "quick", "--out", str(tmp_path)])
    assert not ended.value.code
    table = pd.read_csv(tmp_path / "borders" / "rocking_pendulum.csv")
    assert table["uplift_ratio"].iloc[-1] == pytest.approx(7.1681, abs=1e-4)
    assert table["above"].iloc[-1] == "overturned without impact"
    assert "7.168" in capsys.readouterr().out


def test_borders_of_a_case_without_a_rigid_block_are_refused(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["borders", "sen_tension", "--out", str(tmp_path)])
    assert ended.value.code == 3
    said = " ".join(capsys.readouterr().err.split())
    assert "no run has a solver of a rigid block; give one the solver pendulum" in said
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"rocking": {"body": "tower"}}, "rocking.body' = 'tower' is not a body"),
        ({"rocking": {"borders": [2.0, 1.0]}}, "rocking.borders"),
        ({"rocking": {"stiffness": -1.0}}, "rocking.stiffness"),
        ({"dynamics": {"gravity": [1.0, -9.81]}}, "dynamics.gravity"),
    ],
)
def test_what_cannot_rock_is_refused(tmp_path, change, said):
    with pytest.raises(CaseError) as refused:
        case_of(tmp_path, **change)
    assert said in str(refused.value)


def test_a_block_that_slides_before_it_rocks_is_refused():
    source = load_case("rocking_winkler", "quick").source
    load_case(source, "quick", "winkler", {"contact": {"friction": 0.26}})
    with pytest.raises(CaseError, match=r"contact.friction' = 0.25 lets block slide .* over its height, 0\.2554\."):
        load_case(source, "quick", "winkler", {"contact": {"friction": 0.25}})
    pair = {"contact": {"pairs": [{"bodies": ["ground", "block"], "friction": 0.1}]}}
    with pytest.raises(CaseError, match=r"contact.friction' = 0.1 lets block slide"):
        load_case(source, "quick", "winkler", pair)
    case_of(source.parent, contact={"friction": 0.0})  # a pendulum does not slide


@pytest.mark.parametrize("name", ["pendulum", "linear"])
@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"dynamics": {"ground": {"direction": "y"}}}, "dynamics.ground.direction"),
        ({"dynamics": {"damping": 1.0}}, "dynamics.damping"),
        ({"bodies": {"block": {"velocity": [0.1, 0.0]}}}, "bodies.block.velocity"),
        ({"bodies": {"block": {"velocity_gradient": [[0.0, -0.1], [0.1, 0.0]]}}}, "bodies.block.velocity_gradient"),
        ({"constraints": [{"on": "bottom", "direction": "x", "velocity": 0.1}]}, r"constraints\[0\]"),
        ({"constraints": [{"on": "bottom", "direction": "x", "table": [[0, 0], [99, 1]]}]}, r"constraints\[0\]"),
        ({"tractions": [{"on": "top", "value": [1e-3, 0.0]}]}, r"tractions\[0\]"),
        ({"bodies": {"ground": {"shape": {"rectangle": {"lower": [-1, -2], "upper": [1, -1]}}}}}, "rocking.on: the"),
    ],
)
def test_what_a_rigid_block_does_not_know_is_refused(change, said, name, tmp_path):
    case = case_of(tmp_path, name, **change)
    with pytest.raises(CaseError, match=rf"toml: {said}.*; (remove it, or give solver = \"mpm\"|set it upon .*)\.$"):
        {"pendulum": PendulumMotion, "linear": LinearPendulumMotion}[name](case)


def test_a_rigid_solver_needs_the_table_rocking(tmp_path):
    tables = {
        "title": "t", "requirement": "r", "units": {"length": "m", "force": "MN"}, "plane": {"assumption": "strain"},
        "materials": {"m": {"young": 1.0, "poisson": 0.3}}, "mesh": {"h": 0.1}, "load": {"path": [0.0]},
        "bodies": {"block": {"material": "m", "shape": {"rectangle": {"lower": [0, 0], "upper": [1, 2]}}}},
        "runs": {"pendulum": {"solver": "pendulum"}},
    }  # fmt: skip
    with pytest.raises(CaseError, match="'rocking' is missing, which pendulum needs"):
        case_from_tables(tables, "standard", "pendulum")


def test_a_map_tells_what_becomes_of_the_block_and_where_theory_has_the_border(tmp_path):
    text = load_case("rocking_pendulum", "quick").source.read_text(encoding="utf-8")
    diagram = (
        '[maps.diagram]\nrun = "pendulum"\nborders = ["winkler"]\nbisections = 3\nlogarithmic = false\n'
        'change = { rocking = { borders = [2.0, 3.0] } }\n'
        'x = { "dynamics.ground.uplift_ratio" = [2.0, 4.0] }\ny = { "dynamics.ground.frequency_ratio" = [5.0] }\n'
    )
    file = tmp_path / "block" / "case.toml"
    file.parent.mkdir()
    file.write_text(f"{text}{diagram}[contact]\nfriction = 0.625\n")
    with pytest.raises(SystemExit) as ended:
        main(["stability", str(file), "--tier", "quick", "--out", str(tmp_path)])
    assert not ended.value.code
    folder = tmp_path / "maps" / "block" / "quick"
    table, found = pd.read_csv(folder / "diagram.csv"), pd.read_csv(folder / "diagram-borders.csv")
    assert set(table["verdict"]) == {"safe", "overturned after impacts"} and len(table) == 5
    assert found["measured"].item() == pytest.approx(2.883, abs=0.13)
    assert found["border"].item() == "winkler" and found["theory"].item() == pytest.approx(2.532, rel=5e-3)


def test_the_diagram_has_borders_of_models_and_verdicts_of_material_points(tmp_path):
    case = load_case("rocking_diagram", "quick")
    for ratio in (3, 5):
        run("rocking_diagram", f"pendulum_borders[frequency_ratio={ratio}]", "quick", tmp_path, threads=1)
    maps = tmp_path / "maps" / "rocking_diagram" / "quick"
    maps.mkdir(parents=True)
    rows = [(2.0, 3.0, Verdict.AFTER_IMPACTS), (1.0, 4.0, Verdict.SAFE)]
    pd.DataFrame(rows, columns=["x", "y", "verdict"]).to_csv(maps / "mpm.csv")
    drawn = diagram(CaseResults(compare(case, "quick", tmp_path), tmp_path), tmp_path)
    table = pd.read_csv(tmp_path / "diagram.csv").set_index(["what", "frequency"])["amplitude"]
    assert table["border_without_impact", 5.0] == pytest.approx(7.336, abs=1e-3)
    assert table["border_after_impacts", 3.0] == pytest.approx(1.402, abs=1e-3)
    assert table[str(Verdict.AFTER_IMPACTS), 3.0] == 2.0 and table[str(Verdict.SAFE), 4.0] == 1.0
    assert "2 runs of material points" in drawn.caption
    (maps / "mpm.csv").unlink()  # those on record are shown then
    drawn = diagram(CaseResults(compare(case, "quick", tmp_path), tmp_path), tmp_path)
    assert "9 runs of material points" in drawn.caption


def test_records_of_different_size_are_drawn_as_two():
    times, up = [0.0, 1.0, 2.0], np.array([0.0, 1.0, 0.0])
    one, other, pulses = record(times, up), record(times, 1.01 * up), pulse_of("sine", 1.0, 3.0)
    shown = distinct_motions({"one": one, "other": other, "again": record(times, up), "sine": pulses})
    assert list(shown) == ["one", "other", "sine"]
