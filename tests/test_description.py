"""What solvers say of themselves: sizes as they are set up, at no cost however many there are, and all that a third
method needs."""

import dataclasses
import math
import sys
from pathlib import Path

import fake_solver
import numpy as np
import pytest

from cases import list_cases, load_case
from cases.solvers import SOLVERS, Solver
from cases.spacing import count_cells, grid_lines
from numerics import description
from numerics.description import describe
from verify import cli
from verify.planning.plan import plan, planned_job
from verify.runs import running
from verify.runs.jobs import Job
from verify.runs.memory import TooLargeError

SET_UP = [
    ("plate_with_hole", "fem"),
    ("three_point_bending_notched", "fem"),
    ("elastic_mms", "fem_triangles[h=0.05]"),
    ("sen_tension", "fem"),
    ("sen_tension", "mpm"),
    ("l_panel", "mpm"),
    ("cantilever", "mpm"),
    ("elastic_mms", "mpm_cubic[h=0.1]"),
    ("layered_beam", "fem_case_3"),
    ("layered_beam", "mpm_case_3"),
    ("plate_impact", "fem"),
    ("elastic_rings", "mpm"),
    ("vibrating_bar", "bar[h=7]"),
]
#: solvers that divide bodies into cells
MESHED = [name for name, solver in SOLVERS.items() if solver.describe and not solver.of_rigid_block]
TOY = '''
from fake_solver import FakeSolver
from numerics.description import Description


def describe(case):
    return Description("one square", "", cells=1, points=4, unknowns_displacement=8, unknowns_phase_field=4, order=1)
'''


@pytest.mark.parametrize(("name", "run"), SET_UP)
def test_what_is_set_up_is_what_was_described(name: str, run: str) -> None:
    case = load_case(name, "quick", run)
    said = describe(case, case.run_spec(run).solver)
    solver = running.DISCRETISATIONS[case.run_spec(run).solver](case)
    if case.dynamics is None and case.run_spec(run).solver == "mpm":
        solver.begin_step()
    count = solver.costs.count
    assert said.points == pytest.approx(count["points"], rel=0.05)
    for key in ("unknowns_displacement", "unknowns_phase_field"):
        if key in count:
            assert getattr(said, key) == pytest.approx(count[key], rel=0.06)
    if case.dynamics is not None:
        assert said.stable_step == pytest.approx(solver.stable_step(), rel=1e-6)


def test_no_phase_field_is_promised_in_what_cannot_break() -> None:
    for run in ("fem_case_3", "mpm_case_3"):
        case = load_case("layered_beam", "quick", run)
        breaks = next(material for material in case.materials.values() if material.fracture)
        whole = case.model_copy(update={"materials": dict.fromkeys(case.materials, breaks)})
        solver = case.run_spec(run).solver
        assert describe(case, solver).unknowns_phase_field < describe(whole, solver).unknowns_phase_field


@pytest.mark.parametrize("name", ["sen_tension", "l_panel", "square_plate_anisotropic", "layered_beam"])
def test_cells_are_counted_without_making_any(name: str) -> None:
    case = load_case(name, "standard", "fem" if name in ("sen_tension", "l_panel") else None)
    assert count_cells(case) == math.prod(len(lines) - 1 for lines in grid_lines(case))
    x, y = (0.5 * (lines[1:] + lines[:-1]) for lines in grid_lines(case))
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    exact = ((case.inside(centres) >= 0) & ~case.left_out(centres)).sum()
    assert description.estimated_cells(case).sum() == pytest.approx(exact, rel=0.02)


@pytest.mark.parametrize("solver", MESHED)
def test_a_large_grid_is_estimated_as_a_small_one_is_counted(solver: str, monkeypatch: pytest.MonkeyPatch) -> None:
    case = load_case("sen_tension", "quick", solver)
    counted = describe(case, solver)
    monkeypatch.setattr(sys.modules[SOLVERS[solver].describe.partition(":")[0] + ".describe"], "MOST_SET_UP", 0)
    estimated = describe(case, solver)
    for key in ("cells", "points", "unknowns_displacement", "unknowns_phase_field"):
        assert getattr(estimated, key) == pytest.approx(getattr(counted, key), rel=0.2)
    assert estimated.basis == counted.basis


@pytest.mark.parametrize(
    ("mesh", "key"),
    [
        ("h = 1e-5", "mesh.h = 1e-05"),
        ("h = 1e-4\ngrowth = 1.000001\nfine = { lower = [0.4, 0.4], upper = [0.6, 0.6] }", "mesh.growth = 1"),
        (
            "h = 0.1\nfine = { lower = [0.4, 0.4], upper = [0.6, 0.6] }\n"
            "refine = [{ lower = [0, 0], upper = [1, 1], h = 1e-6 }]",
            "mesh.refine[0].h = 1e-06",
        ),
    ],
)
@pytest.mark.parametrize("solver", MESHED)
def test_more_cells_than_the_machine_holds_are_refused_in_one_sentence(
    tmp_path: Path, mesh: str, key: str, solver: str
) -> None:
    file = fake_solver.write_case(tmp_path / "square")
    text = file.read_text().replace("[tiers.quick.mesh]\nh = 0.2\n", "")
    file.write_text(text.replace("\n[mesh]\nh = 0.25\n", f"\n[mesh]\n{mesh}\n"))
    case = load_case(file, "standard", solver)
    with pytest.raises(TooLargeError) as refused:
        plan(case, solver)
    assert key in str(refused.value) and "make it larger" in str(refused.value)
    with pytest.raises(TooLargeError):
        planned_job(Job(file, case.name, solver, "standard", tmp_path, 1), None)
    with pytest.raises(TooLargeError):
        running.run(case, solver, out=tmp_path)
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("name", list_cases())
def test_every_run_of_the_library_is_described_and_has_a_finite_cost(name: str) -> None:
    for run in load_case(name, "quick").expanded_runs():
        case = load_case(name, "quick", run)
        planned = plan(case, run)
        said, cost = planned.described, planned.cost
        assert said.cells > 0 and said.points >= said.cells and said.unknowns_displacement > 0
        assert (said.unknowns_phase_field > 0) == case.fracture_enabled
        assert (said.stable_step is None) == (case.dynamics is None)
        assert 0.0 < cost.seconds < 1e4 and 100.0 < cost.memory_mb < 1e5 and cost.iterations > 0.0


def test_a_third_method_is_a_package_and_a_registration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, few_sections: None
) -> None:
    (tmp_path / "toy_method").mkdir()
    (tmp_path / "toy_method" / "__init__.py").write_text(TOY)
    monkeypatch.syspath_prepend(str(tmp_path))
    fake_solver.install(monkeypatch)
    toy = Solver("toy", "Toy", "one square", ":", "toy_method:FakeSolver", "toy_method:FakeSolver", "toy_method:describe")
    monkeypatch.setitem(SOLVERS, "toy", toy)

    case = fake_solver.write_case(tmp_path / "square", fake_solver.check("fem").replace('"mpm"', '"toy"'))
    case.write_text(case.read_text() + '[runs.toy]\nsolver = "toy"\n')
    out = tmp_path / "out"

    def verify(*arguments: str) -> int:
        with pytest.raises(SystemExit) as ended:
            cli.main([*arguments, "--out", str(out)])
        return int(ended.value.code or 0)

    planned = plan(load_case(case, "quick", "toy"), "toy")
    assert planned.described.points == 4 and planned.cost.seconds > 0.0
    assert "one square" in dict(planned.rows())["solver"]
    for command in ("run", "compare"):
        assert verify(command, str(case), "--tier", "quick") == 0
    assert verify("report") == 0
    assert any("Toy" in page.read_text(encoding="utf-8") for page in out.rglob("*.html"))


def test_a_description_stays_small() -> None:
    assert len(dataclasses.fields(description.Description)) <= 15
    assert len(dataclasses.fields(type(plan(load_case("sen_tension", "quick", "fem"), "fem")))) <= 15


@pytest.mark.parametrize(
    ("name", "said"), [("bimaterial_strip", "hold together"), ("two_discs", "not joined"), ("sen_tension", None)]
)
def test_a_plan_says_what_bodies_do_to_each_other(name: str, said: str | None) -> None:
    rows = dict(plan(load_case(name, "quick", "mpm"), "mpm").rows())
    assert (said or "") in rows.get("between bodies", "") and ("between bodies" in rows) == bool(said)


def test_a_plan_calls_increments_adaptive_where_they_are() -> None:
    for name, adaptive in (("bimaterial_strip", False), ("sen_tension", True)):
        rows = dict(plan(load_case(name, "quick", "fem"), "fem").rows())
        assert ("adaptive" in rows["increments"]) == adaptive == rows["adaptive increments"].startswith("on")


@pytest.mark.parametrize("run", ["fem", "mpm"])
def test_a_time_step_that_may_blow_up_is_told_before_it_does(run: str) -> None:
    case, shorter = (load_case("plate_impact", "quick", run, {"dynamics": {"time_step_share": s}}) for s in (3.0, 0.5))
    (said,) = (text for what, text in plan(case, run).rows() if what == "note" and "time step" in text)
    assert "is 3 times the longest one that is stable" in said and "leave out dynamics.time_step_share" in said
    assert not any("longest one" in text for _, text in plan(shorter, run).rows())


@pytest.mark.parametrize(("run", "share"), [("fem", 0.6), ("mpm", 6.0**-0.5)])
def test_what_hardens_under_pressure_shortens_the_stable_step(run: str, share: float) -> None:
    """Torn by the star-convex split, a body is six times as stiff under pressure as whole, and bears no shear."""
    names = [*load_case("plate_impact", "quick", run).materials]
    split = {"materials": {name: {"fracture": {"split": "star_convex"}} for name in names}}
    whole, torn = (plan(load_case("plate_impact", "quick", run, given), run).described for given in ({}, split))
    assert whole.stable_step is not None and torn.stable_step is not None
    assert torn.stable_step / whole.stable_step <= share * (1.0 + 1e-9)
