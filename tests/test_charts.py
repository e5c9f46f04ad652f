"""Charts of accuracy against cost, on stand-ins whose errors are known: F is off by h squared."""

import math
import shutil
from pathlib import Path

import fake_solver
import numpy as np
import pandas as pd
import pytest

from cases import CaseError, load_case
from cases.studies import coordinates
from reports import draw_chart, drawing_style
from reports.charts import accuracy_against_cost
from reports.maps import where_it_fails
from reports.results import CaseResults
from verify import cli
from verify.runs import running
from verify.studies import charts
from verify.studies import study as studies
from verify.studies.charts import choice_sentence, choices, extrapolated, make_charts, slopes
from verify.studies.maps import make_maps
from verify.studies.records import Made
from verify.studies.study import LONG, Options, StudyError, announce

CHART = """
[charts.spacing]
quantities = [{ metric = "peak_force" }, { metric = "curve_l2_before_peak" }]
targets = [0.05, 0.01, 1e-9]
change.mesh.under_resolved = true
[charts.spacing.reference]
run = "fem"
levels = { "mesh.h" = [0.16, 0.12, 0.08] }
order = 2.0
[charts.spacing.ladders.fem_ladder]
run = "fem"
levels = { "mesh.h" = [0.4, 0.3, 0.25, 0.2], "load.increment" = [0.002, 0.001, 0.001, 0.001] }
[charts.spacing.ladders.mpm_ladder]
run = "mpm"
levels = { "mesh.h" = [0.4, 0.3, 0.2] }
"""


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """FEM: F (1 + h^2); MPM: F (1 + 2 h^2)."""
    fake_solver.install(monkeypatch)
    for solver, factor in (("fem", 1.0), ("mpm", 2.0)):
        monkeypatch.setitem(
            running.DISCRETISATIONS,
            solver,
            lambda case, factor=factor: fake_solver.FakeSolver(case, 1.0 + factor * case.mesh.h**2),
        )


@pytest.fixture(autouse=True)
def stand_ins(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch)


@pytest.fixture
def case_file(tmp_path: Path) -> Path:
    return fake_solver.write_case(tmp_path / "square", CHART)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a case, and the output of its charts in ``out``."""
    folder = tmp_path_factory.mktemp("charts")
    with pytest.MonkeyPatch.context() as monkeypatch:
        install(monkeypatch)
        make_charts(load_case(fake_solver.write_case(folder / "square", CHART), "quick"), Options(folder / "out"))
    return folder


@pytest.fixture
def chart(finished: Path) -> Path:
    """The table of a finished chart."""
    return finished / "out" / "charts" / "square" / "quick" / "spacing.csv"


def test_errors_are_measured_from_the_extrapolated_limit(chart: Path) -> None:
    table = pd.read_csv(chart)
    peak = table[table["quantity"] == "peak_force"]
    factor = peak["solver"].map({"fem": 1.0, "mpm": 2.0})
    assert np.allclose(peak["error"], factor * peak["at"] ** 2, rtol=1e-6), "the limit is 0.5 kN, exactly"
    assert np.allclose(peak["reference"], 0.5, rtol=1e-12) and (peak["uncertainty"] < 1e-12).all()


def test_a_wrong_order_shows_as_uncertainty() -> None:
    h = np.array([0.4, 0.2, 0.1])
    limit, uncertainty = extrapolated(h, 3.0 + h, 1.0)
    assert limit == pytest.approx(3.0, abs=1e-12) and uncertainty < 1e-12
    limit, uncertainty = extrapolated(h, 3.0 + h**2, 1.0)
    assert uncertainty > abs(limit - 3.0) > 1e-3
    limit, uncertainty = extrapolated([1, 2, 4], [3.0 + 1.0 / n for n in (1, 2, 4)], 1.0)
    assert limit == pytest.approx(3.0), "a coordinate that grows, such as points per cell"


def test_slopes_are_those_of_the_errors(chart: Path) -> None:
    fitted = pd.read_csv(chart.with_name("spacing-slopes.csv"))
    peak = fitted[fitted["quantity"] == "peak_force"].set_index("ladder")
    assert peak["order"].to_numpy() == pytest.approx([2.0, 2.0], abs=1e-6)
    assert (peak["over"] == "mesh.h").all() and peak["levels"].tolist() == [4, 3]


def table_of(*rows: tuple[str, float, float, float]) -> pd.DataFrame:
    """Ladder, at, seconds, error."""
    table = pd.DataFrame(rows, columns=["ladder", "at", "seconds", "error"])
    return table.assign(
        solver="fem", level=table["at"].astype(str), quantity="peak_force", uncertainty=0.0, work=table["seconds"]
    )


def test_the_cheapest_level_is_chosen_and_an_accident_is_not() -> None:
    table = table_of(
        ("graded", 0.4, 1.0, 0.001),  # crosses the reference by accident: finer ones are worse
        ("graded", 0.2, 2.0, 0.04),
        ("graded", 0.1, 4.0, 0.008),
        ("uniform", 0.2, 8.0, 0.03),
        ("uniform", 0.1, 24.0, 0.006),
    )
    over = {"graded": "mesh.h", "uniform": "mesh.h"}
    chosen = choices(table, over, [0.05, 0.01, 0.001]).set_index("target")
    assert (chosen.loc[0.05, "ladder"], chosen.loc[0.05, "at"]) == ("graded", 0.4), "all of the ladder keeps 5 %"
    assert chosen.loc[0.01, ["at", "next_ladder", "next_factor"]].tolist() == [0.1, "uniform", 6.0]
    said = choice_sentence(chosen.reset_index().iloc[1])
    assert said == "For 1 % in peak force choose graded with h = 0.1 (error 0.8 %, 4 s); uniform takes 6 times as long."
    said = choice_sentence(chosen.reset_index().iloc[2])
    least = "at the finest, error and the reference's uncertainty are 0.6 %"
    assert said == f"For 0.1 % in peak force no level is accurate enough: {least}."


@pytest.mark.parametrize(
    ("quantity", "words"),
    [
        ('{ metric = "crack_angle" }', "crack_angle has no relative error: no level or not every reference gives it."),
        ('{ metric = "energy_release_rate", parameters = { inner = 1.0, outer = 2.0 } }', "not every reference gives it"),
        ('{ metric = "peak_force", value = 0.0 }', "peak_force has no relative error: its reference is zero or unknown."),
    ],
)
def test_a_quantity_without_value_or_with_a_target_of_zero_is_told_and_leaves_its_rows_empty(
    case_file: Path, tmp_path: Path, quantity: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    case_file.write_text(case_file.read_text().replace('{ metric = "peak_force" }', quantity))
    with pytest.raises(SystemExit) as ended:
        cli.main(["chart", str(case_file), "--tier", "quick", "--out", str(tmp_path / "out")])
    assert ended.value.code == 0 and words in capsys.readouterr().out
    table = pd.read_csv(tmp_path / "out" / "charts" / "square" / "quick" / "spacing.csv")
    by_quantity = table.groupby("quantity", sort=False)["error"].count()
    assert by_quantity.iloc[0] == 0 and by_quantity["curve_l2_before_peak"] == 7


def test_a_level_may_be_an_empty_list() -> None:
    assert coordinates({"notches": ([], [1.0, 2.0], 3.0)}) == [[], 2.0, 3.0]


def test_levels_that_failed_are_not_taken_for_the_finest() -> None:
    table = table_of(("graded", 0.2, 1.0, 0.03), ("graded", 0.1, 2.0, math.nan))
    (chosen,) = [row for _, row in choices(table, {"graded": "mesh.h"}, [0.05]).iterrows()]
    said = choice_sentence(chosen)
    assert said == "For 5 % in peak force no level is accurate enough: the finest have no result."


def test_of_all_quantities_each_has_its_own_uncertainty() -> None:
    sure = table_of(("graded", 0.2, 1.0, 0.009))
    unsure = table_of(("graded", 0.2, 1.0, 0.001)).assign(quantity="crack_length", uncertainty=0.005)
    chosen = choices(pd.concat([sure, unsure]), {"graded": "mesh.h"}, [0.01]).set_index("quantity")
    assert (chosen["at"] == 0.2).all(), "0.9 % and 0.1 % + 0.5 % are both within 1 %"


def test_a_curve_is_held_against_the_exact_one_without_a_reference(tmp_path: Path) -> None:
    tables = """exact = "homogeneous_bar"
[charts.increments]
quantities = [{ metric = "curve_l2_whole" }]
[charts.increments.ladders.fem]
run = "fem"
levels = { "load.increment" = [0.002, 0.001] }
"""
    source = fake_solver.write_case(tmp_path / "square", tables)
    source.write_text(tables.split("[", 1)[0] + fake_solver.CASE + "[" + tables.split("[", 1)[1])
    case = load_case(source, "quick")
    (file,) = make_charts(case, Options(tmp_path / "out"))
    table = pd.read_csv(file)
    assert (table["error"] > 0.0).all() and (table["reference"] == 0.0).all()


@pytest.mark.parametrize(
    ("quantity", "words"),
    [
        ('{ metric = "curve_l2_whole", value = 1.0 }', "compares two runs and has no value"),
        ('{ metric = "path_mean_distance" }', "add the table 'reference' with finer levels."),
    ],
)
def test_a_metric_of_two_runs_needs_a_second_one(case_file: Path, tmp_path: Path, quantity: str, words: str) -> None:
    text = case_file.read_text().replace('{ metric = "peak_force" }', quantity)
    start, end = text.index("[charts.spacing.reference]"), text.index("[charts.spacing.ladders.fem_ladder]")
    case_file.write_text(text[:start] + text[end:])
    with pytest.raises(StudyError, match=words):
        make_charts(load_case(case_file, "quick"), Options(tmp_path / "out"))


def test_the_reference_must_be_surer_than_the_target() -> None:
    table = table_of(("graded", 0.1, 1.0, 0.001)).assign(uncertainty=0.02)
    assert choices(table, {"graded": "mesh.h"}, [0.01])["ladder"].tolist() == [""]
    assert math.isnan(slopes(table, {"graded": "mesh.h"})["order"].iloc[0])


def test_the_front_holds_what_nothing_beats(chart: Path) -> None:
    for _, part in pd.read_csv(chart).groupby("quantity"):
        front = part[part["on_front"]].sort_values("seconds")
        assert len(front) and (np.diff(front["error"]) < 0).all()
        assert part.loc[part["error"].idxmin(), "on_front"]


def test_finished_levels_are_used_again_and_repeats_are_added(
    finished: Path, chart: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    shutil.copytree(finished / "out", out)
    case = load_case(finished / "square" / "case.toml", "quick")
    monkeypatch.setattr(running, "solver_records", fake_solver.stopping_at(0, AssertionError("a solver ran")))
    (again,) = make_charts(case, Options(out))
    assert again.read_text() == chart.read_text()
    monkeypatch.setattr(running, "solver_records", fake_solver.fake_increments)
    (again,) = make_charts(case, Options(out), repeats=2)
    assert (pd.read_csv(again)["repeats"] == 2).all()


def test_the_first_run_of_a_process_is_timed_again(chart: Path) -> None:
    """With it the process starts: the coarsest level would seem dearer than it is."""
    levels = pd.read_csv(chart).drop_duplicates(["ladder", "level"])
    assert levels.groupby("ladder")["repeats"].apply(list).to_dict() == {
        "fem_ladder": [2, 1, 1, 1], "mpm_ladder": [2, 1, 1],
    }  # fmt: skip


def test_a_level_that_fails_stays_in_the_table(
    case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "solver_records", failing_at(0.25))
    (file,) = make_charts(load_case(case_file, "quick"), Options(tmp_path / "out"))
    failed = pd.read_csv(file).query("at == 0.25")
    assert (failed["status"] == "no_convergence").all() and failed["error"].isna().all()
    with drawing_style():
        made = Made("charts", "spacing", file, load_case(case_file, "quick"))
        assert "fem_ladder at 0.25" in draw_chart(made, tmp_path).caption


def failing_at(h: float):
    def increments(solver, case, after=None):
        march = fake_solver.stopping_at(2) if case.mesh.h == h else fake_solver.fake_increments
        return march(solver, case, after)

    return increments


def test_the_figure_repeats_the_choice_and_the_order(finished: Path, chart: Path, tmp_path: Path) -> None:
    case = load_case(finished / "square" / "case.toml", "quick")
    with drawing_style():
        drawing = draw_chart(Made("charts", "spacing", chart, case), tmp_path)
    assert (tmp_path / drawing.file).stat().st_size > 1000
    assert "For 5 % in all quantities choose" in drawing.caption and "fem_ladder 2" in drawing.caption


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[0.16, 0.12, 0.08]", "[0.4, 0.3, 0.25]", "is not finer than every level of 'fem_ladder'"),
        ("[0.16, 0.12, 0.08]", "[0.16, 0.08]", "three or more"),
        ("[0.002, 0.001, 0.001, 0.001]", "[0.002]", "not equally many values"),
        ('run = "mpm"\nlevels', 'run = "mmp"\nlevels', "did you mean 'mpm'"),
        ('{ "mesh.h" = [0.4, 0.3, 0.2] }', '{ "units.length" = ["m"] }', "may not be varied"),
    ],
)
def test_a_mistake_in_a_chart_is_told(case_file: Path, old: str, new: str, words: str) -> None:
    case_file.write_text(case_file.read_text().replace(old, new))
    with pytest.raises(CaseError, match=words):
        load_case(case_file, "quick")


def test_an_unknown_quantity_or_chart_is_told(case_file: Path, tmp_path: Path) -> None:
    case = load_case(case_file, "quick")
    with pytest.raises(StudyError, match="it has: spacing"):
        make_charts(case, Options(tmp_path / "out"), ["spaces"])
    case_file.write_text(case_file.read_text().replace('{ metric = "peak_force" }', '{ metric = "peak" }'))
    with pytest.raises(StudyError, match="metric peak: is not known"):
        make_charts(load_case(case_file, "quick"), Options(tmp_path / "out"))


def test_what_takes_long_says_so_before_it_starts() -> None:
    assert announce(LONG + 1.0, "The charts of x").startswith("The charts of x will take about 10 minutes")
    assert announce(LONG - 1.0, "The charts of x") == ""


def test_charts_and_maps_tell_their_predicted_time_before_the_first_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two at a time take half as long; what is finished takes none."""
    case, told = load_case(fake_solver.write_case(tmp_path / "square", CHART, MAP), "quick"), []
    monkeypatch.setattr(studies, "LONG", 0.0)
    monkeypatch.setattr(studies, "expected_seconds", lambda case, run: 1200.0)
    make_charts(case, Options(tmp_path / "out"), tell=told.append)
    make_maps(case, Options(tmp_path / "out", jobs=2), tell=told.append)
    charts = told.index("The charts of square will take about 200 minutes; what is finished is kept if you stop it.")
    maps = told.index("The maps of square will take about 20 minutes; what is finished is kept if you stop it.")
    assert charts == 0 and told[maps + 1].startswith("square quick spacing x=")
    told.clear()
    make_charts(case, Options(tmp_path / "out"), tell=told.append)
    assert not any("will take" in line for line in told)


def test_the_report_shows_charts_and_maps_from_their_tables(finished: Path, tmp_path: Path) -> None:
    """Made from the tables alone: the figures on a page are those of its CSVs."""
    out, case = tmp_path / "out", load_case(fake_solver.write_case(tmp_path / "square", CHART, MAP), "quick")
    shutil.copytree(finished / "out" / "charts", out / "charts")
    make_maps(case, Options(out))
    results = CaseResults({"case": "square", "tier": "quick", "source": str(case.source)}, out)
    with drawing_style():
        # as the command does, which leaves the figure's numbers among the tables
        for table in (out / "charts").rglob("spacing.csv"):
            draw_chart(Made("charts", "spacing", table, case), table.parent)
        drawings = [*accuracy_against_cost(results, tmp_path / "figures"), *where_it_fails(results, tmp_path / "figures")]
    assert [drawing.name for drawing in drawings] == ["chart-spacing", "map-spacing"]
    assert "For 5 % in all quantities choose" in drawings[0].caption and "2 cells: 2 stable" in drawings[1].caption
    assert not any("another state" in drawing.caption for drawing in drawings)
    other = load_case(fake_solver.write_case(tmp_path / "square", CHART.replace("0.002", "0.001"), MAP), "quick")
    results.__dict__["case"] = other
    with drawing_style():
        (chart,) = accuracy_against_cost(results, tmp_path / "again")
    assert chart.caption.startswith("Made with another state of case or code:")
    for drawing in drawings:
        assert (tmp_path / "figures" / drawing.file).is_file() and (tmp_path / "figures" / str(drawing.data)).is_file()


MAP = """
[maps.spacing]
run = "fem"
x = { "mesh.h" = [0.2, 0.25] }
y = { "mpm.points_per_cell" = [2] }
"""


def test_a_number_that_should_be_nought_is_its_own_error(
    case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(charts, "_value", lambda quantity, run: -0.25)
    balanced = '{ metric = "energy_balance", value = 0 }'
    case_file.write_text(case_file.read_text().replace('{ metric = "peak_force" }', balanced))
    (file,) = make_charts(load_case(case_file, "quick"), Options(tmp_path / "out"))
    balance = pd.read_csv(file).query("quantity == 'energy_balance'")
    assert set(balance["error"]) == {0.25}
