"""Charts and maps of record: kept beside the case with where they come from, and shown by every report."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import fake_solver
import pandas as pd
import pytest

from cases import Case, list_cases, load_case
from reports import drawing_style, write_report
from reports.charts import accuracy_against_cost, costs_of
from reports.maps import label_of, where_it_fails
from reports.overview import fronts
from reports.report import SECTIONS
from reports.results import CaseResults
from reports.words import LEVELS
from verify import cli
from verify.judging.summary import summarise
from verify.judging.targets import JudgeError
from verify.runs import provenance, running
from verify.studies import records
from verify.studies.charts import make_charts
from verify.studies.maps import make_maps
from verify.studies.records import Made, made_of
from verify.studies.study import Options

STUDIES = """
[charts.spacing]
title = "spacing"
quantities = [{ metric = "peak_force", value = 0.5 }]
change.mesh.under_resolved = true
[charts.spacing.ladders.fem]
run = "fem"
levels = { "mesh.h" = [0.4, 0.2] }
[charts.spacing.ladders.mpm]
run = "mpm"
levels = { "mesh.h" = [0.4, 0.2] }
[maps.spacing]
title = "spacing and points"
run = "fem"
x = { "mesh.h" = [0.05, 0.1, 0.2, 0.25] }
y = { "mpm.points_per_cell" = [1] }
judged = { metric = "peak_force", against = "value:0.5", within = [0.01, 0.05] }
borders = ["first_order"]
bisections = 4
"""
VERSION = "0.1.0+abc1234"


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """F (1 + h / 10) of both solvers, by code that is committed, on a processor with a name."""
    fake_solver.install(monkeypatch)
    for solver in ("fem", "mpm"):
        fake = lambda case: fake_solver.FakeSolver(case, 1.0 + 0.1 * case.mesh.h)  # noqa: E731
        monkeypatch.setitem(running.DISCRETISATIONS, solver, fake)
    committed(monkeypatch, VERSION)


def committed(monkeypatch: pytest.MonkeyPatch, version: str) -> None:
    for module in (running, records):
        monkeypatch.setattr(module, "code_version", lambda: version)
        monkeypatch.setattr(module, "processor_name", lambda: "Abacus 4004")


@pytest.fixture(autouse=True)
def stand_ins(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a case, its chart and map of record, and in ``made`` what they were made in."""
    folder = tmp_path_factory.mktemp("kept")
    with pytest.MonkeyPatch.context() as monkeypatch:
        install(monkeypatch)
        case = load_case(fake_solver.write_case(folder / "square", STUDIES), "quick")
        make_charts(case, Options(folder / "made"), record=True)
        make_maps(case, Options(folder / "made"), record=True)
    return folder


@pytest.fixture
def recorded(kept: Path, tmp_path: Path) -> Case:
    """The case with a chart and a map of record, made in a folder that no report sees."""
    shutil.copytree(kept, tmp_path, dirs_exist_ok=True)
    return load_case(tmp_path / "square" / "case.toml", "quick")


@pytest.fixture
def case(tmp_path: Path) -> Case:
    return load_case(fake_solver.write_case(tmp_path / "square", STUDIES), "quick")


def drawn(case: Case, out: Path, tier: str = "quick") -> list:
    results = CaseResults({"case": "square", "tier": tier, "source": str(case.source)}, out)
    with drawing_style():
        return [*accuracy_against_cost(results, out / "figures"), *where_it_fails(results, out / "figures")]


def test_tables_are_kept_with_date_tier_version_and_processor(recorded: Case) -> None:
    for kind, endings in (("charts", ("", "-slopes", "-choices")), ("maps", ("", "-borders", "-powers"))):
        folder = recorded.folder / kind / "quick"
        assert sorted(file.name for file in folder.iterdir()) == sorted(f"spacing{ending}.csv" for ending in endings)
        (told,) = pd.read_csv(folder / "spacing.csv")[list(records.PROVENANCE)].drop_duplicates().to_dict("records")
        assert re.fullmatch(r"\d{4}-\d\d-\d\d", told.pop("date"))
        assert told == {"tier": "quick", "version": VERSION, "processor": "Abacus 4004"}
        assert pd.read_csv(folder / "spacing.csv")["seconds"].notna().all()


@pytest.mark.parametrize("make", [make_charts, make_maps])
def test_code_that_is_not_committed_records_nothing_and_says_so_before_it_runs(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make: object
) -> None:
    committed(monkeypatch, f"{VERSION}-dirty")
    with pytest.raises(JudgeError, match="code that is not committed"):
        make(case, Options(tmp_path / "out"), record=True)
    assert not (tmp_path / "out").exists() and not list(case.folder.glob("*/quick"))


def test_a_report_shows_what_is_recorded_and_where_it_comes_from(recorded: Case, tmp_path: Path) -> None:
    for tier in ("quick", "standard"):
        for drawing in drawn(recorded, tmp_path / "out", tier):
            assert re.match(r"Recorded on \d{4}-\d\d-\d\d at tier quick by version 0\.1\.0\+abc1234", drawing.caption)
            assert "on Abacus 4004." in drawing.caption and "changed since" not in drawing.caption


def test_a_report_says_when_the_code_has_changed_since(
    recorded: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("verify.studies.study.source_hash", lambda: "another")
    drawings = drawn(recorded, tmp_path / "out")
    assert len(drawings) == 2 and all("The case or the code has changed since." in one.caption for one in drawings)


def test_what_the_reports_own_folder_holds_comes_before_the_record(recorded: Case, tmp_path: Path) -> None:
    shutil.copytree(tmp_path / "made" / "charts", tmp_path / "out" / "charts")
    chart, chosen = drawn(recorded, tmp_path / "out")
    assert "Recorded" not in chart.caption and "Recorded" in chosen.caption


def test_of_several_tiers_the_reports_own_is_shown_and_else_the_finest(recorded: Case, tmp_path: Path) -> None:
    make_charts(load_case(recorded.source, "paper"), Options(tmp_path / "made"), record=True)
    tiers = {
        tier: made_of(load_case(recorded.source, tier), "charts", tmp_path / "out")[0].case.tier
        for tier in ("quick", "standard", "paper")
    }
    assert tiers == {"quick": "quick", "standard": "paper", "paper": "paper"}


def test_without_a_case_all_of_the_library_that_have_any_are_made(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = fake_solver.write_case(tmp_path / "plain")
    monkeypatch.setattr("verify.cli.shared.list_cases", lambda: [str(plain), str(case.source)])
    for command in ("chart", "stability"):
        with pytest.raises(SystemExit) as ended:
            cli.main([command, "--record", "--tier", "quick", "--out", str(tmp_path / "out")])
        assert ended.value.code == 0
    assert f"Recorded: {case.folder / 'maps' / 'quick' / 'spacing.csv'}" in capsys.readouterr().out
    assert (case.folder / "charts" / "quick" / "spacing.csv").is_file() and not (plain.parent / "charts").exists()


def test_what_is_recorded_makes_no_code_uncommitted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def git(*arguments: str) -> None:
        subprocess.run(["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b", *arguments], check=True)

    record, code = tmp_path / "cases/library/bar/maps/quick/a.csv", tmp_path / "cases/bodies.py"
    record.parent.mkdir(parents=True)
    for file in (record, code):
        file.write_text("1")
    git("init", "--quiet")
    git("add", ".")
    git("commit", "--quiet", "-m", "first")
    monkeypatch.setattr(provenance, "ROOT", tmp_path)
    record.write_text("2")
    assert not provenance._git_description().endswith("-dirty")
    code.write_text("2")
    assert provenance._git_description().endswith("-dirty")


def test_start_up_is_outside_the_clock(case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process imports a solver's code once: the first run in it is not the dearer for it."""
    clock = {"now": 0.0}

    def imported(name: str) -> object:
        clock["now"] += 100.0
        return object()

    monkeypatch.setattr(running.time, "process_time", lambda: clock["now"])
    monkeypatch.setattr(running, "import_module", imported)
    assert running.run(case, "fem", out=tmp_path / "out").info["seconds"]["processor"] < 1.0
    assert clock["now"] >= 100.0


def test_axes_are_words_with_units() -> None:
    """Each key that a map of the library varies has its words."""
    for case in (load_case(name, tier) for name in list_cases() for tier in ("quick", "standard")):
        for chosen in case.maps.values():
            for levels in (chosen.x, chosen.y):
                varied = [key for key, values in levels.items() if len(set(values)) > 1] or list(levels)[:1]
                assert all(key.rpartition(".")[2] in LEVELS for key in varied)
    tension, bar = load_case("sen_tension", "quick"), load_case("vibrating_bar", "quick")
    assert label_of(tension.maps["increments"].x, tension) == "load increment [mm]"
    assert label_of(tension.maps["increments"].y, tension) == "passes per increment"
    assert label_of(bar.maps["time_step"].x, bar) == "time step, as a share of the one by rule"
    assert costs_of(bar)["work"].endswith("time steps") and costs_of(tension)["seconds"].endswith("[s]")


def test_the_library_has_records_of_at_least_eight_cases() -> None:
    cases = [load_case(name, "quick") for name in list_cases()]
    assert sum(bool(list(case.folder.glob("charts/*/*-choices.csv"))) for case in cases) >= 8
    unmapped = {case.name for case in cases if len(made_of(case, "maps", Path("nowhere"))) < len(case.maps)}
    assert unmapped <= {"l_panel_distortion"}, "its bodies are pulled apart by half a metre, in hundreds of increments"


# ---------------------------------------------------------------------------------------- the page of all cases


def test_the_page_of_all_cases_has_their_fronts_and_their_borders(
    recorded: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("reports.report.SECTIONS", SECTIONS[:3])  # of the cases' own pages
    out = tmp_path / "out"
    (out / "runs").mkdir(parents=True)
    plain = load_case(fake_solver.write_case(tmp_path / "plain"), "quick")
    (out / "summary.json").write_text(json.dumps(summarise([recorded, plain], "quick", out)))
    index = write_report(out)
    page = (out / "studies.html").read_text(encoding="utf-8")
    assert 'href="studies.html"' in index.read_text() and 'href="pages/square-quick.html">Softening square' in page
    assert '<td class="n">cell size h [mm]</td>' in page and re.search(r'<td class="n">0\.09\d+</td>', page)
    assert "within 1 % → within 5 %" in page and "(first order)" in page
    assert "version 0.1.0+abc1234 on Abacus 4004" in page
    table = pd.read_csv(out / "figures" / "studies" / "fronts.csv").query("case == 'square'")
    assert set(table["solver"]) == {"fem", "mpm"}
    for _, front in table.groupby("solver"):
        assert front["error"].is_monotonic_decreasing and front["seconds"].is_monotonic_increasing


def test_a_level_is_as_wrong_as_its_worst_quantity(tmp_path: Path) -> None:
    nothing = ("h", "c", None, 1.0)
    rows = [("h", "a", 0.1, 1.0), ("h", "b", 0.3, 1.0), nothing, ("g", "a", 0.2, 2.0), ("g", "b", 0.25, 2.0)]
    table = pd.DataFrame(rows, columns=["level", "quantity", "error", "seconds"]).assign(solver="fem", ladder="all")
    made = Made("charts", "spacing", tmp_path / "spacing.csv", SimpleNamespace(name="x", title="X"))
    table.to_csv(made.file)
    assert fronts([made])[["level", "error"]].to_numpy().tolist() == [["h", 0.3], ["g", 0.25]]
