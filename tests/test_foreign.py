"""Results from elsewhere: mapped, kept, judged; what they lack is said, what is wrong in them is one sentence."""

import hashlib
import json
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fake_solver
import numpy as np
import pandas as pd
import pytest

from cases import Case, CaseError, UserError, case_from_tables, load_case
from cases.errors import BrokenRuleError
from cases.loader import LIBRARY
from cases.mapping import parse_mapping
from cases.units import Units
from tests.test_strangers import PLATE
from verify import judge
from verify.cli import main
from verify.judging.acceptance import accept
from verify.judging.archive import METADATA, ArchiveError, Imported, read_archive, write_archive
from verify.judging.foreign import ForeignResult, Judgement, judge_foreign
from verify.judging.summary import compare
from verify.pytest_plugin import FractureCase
from verify.runs import running
from verify.runs.atomic import WriteError, replace_folder
from verify.runs.importing import ImportedError, history_of, mapped, read_table
from verify.runs.kept import main_runs, read_kept, reduced, restore
from verify.runs.run_folder import RunFolder
from verify.runs.running import run

U = np.linspace(0.0, 0.01, 21)
F = 100.0 * np.maximum(0.0, np.minimum(U, 0.005 - (U - 0.005) * 5 / 3))


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The softening square with kept results of both stand-ins, whose peak is 0.5 kN, and the runs that they are of."""
    folder = tmp_path_factory.mktemp("kept")
    with pytest.MonkeyPatch.context() as solving:
        solving.setattr(running, "code_version", lambda: "0.1.0+abc1234")
        fake_solver.install(solving, mpm_factor=1.005)
        path = fake_solver.write_case(folder / "square", fake_solver.check("fem", 0.02))
        case = load_case(path, "quick")
        for name in main_runs(case):
            run(path, name, "quick", folder / "made")
        accept(case, "first values", folder / "made")
    return folder


@pytest.fixture
def square(kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Case:
    """A copy of the softening square with its kept results, and no solver any more."""
    monkeypatch.setattr(running, "code_version", lambda: "0.1.0+abc1234")
    shutil.copytree(kept, tmp_path, dirs_exist_ok=True)
    return load_case(tmp_path / "square" / "case.toml", "quick")


def judged_without_page(case: Case, u: np.ndarray, F: np.ndarray, folder: Path, **others: Any) -> Judgement:
    """The judgement alone, as `judge` has it; a page takes seconds to draw."""
    return judge_foreign(case, ForeignResult(pd.DataFrame({"u": u, "F": F}), **others), folder / "out")


def written(folder: Path, text: str, name: str = "mine.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def csv(u: np.ndarray, F: np.ndarray, header: str = "u,F", newline: str = "\n") -> str:
    return header + newline + newline.join(f"{a},{b}" for a, b in zip(u, F, strict=True)) + newline


# ------------------------------------------------------------------------------------------------ mapping


def test_a_mapping_takes_columns_factors_signs_units_and_words() -> None:
    found = parse_mapping("u = U2, F=-2*RF2 [N]; E_el = 'all, SE'/1e3, half-model, damage")
    assert {name: (s.column, s.factor, s.unit) for name, s in found.sources.items()} == {
        "u": ("U2", 1.0, ""), "F": ("RF2", -2.0, "N"), "E_el": ("all, SE", 1e-3, ""),
    }  # fmt: skip
    assert found.words == ("half model", "damage")


@pytest.mark.parametrize(
    "text", ["F = __import__('os')", "F = RF1 + RF2", "F", "u = ", "F = 2 * 3", "half a horse", "u=a, u=b", "u = a*0"]
)
def test_what_is_no_mapping_is_refused_and_never_evaluated(text: str) -> None:
    with pytest.raises(BrokenRuleError):
        parse_mapping(text)


def table_of(text: str, folder: Path) -> pd.DataFrame:
    return read_table(written(folder, text))


def test_units_words_and_damage_give_the_history_in_case_units(square: Case, tmp_path: Path) -> None:
    table = table_of("U2;RF2;D\n0;0;0\n10;-250;0.25\n", tmp_path)
    mapping = parse_mapping("u = U2 [um], F = -1*RF2 [N], d = D, half model")
    history = mapped(table, mapping, square, "mine.csv")
    assert history["u"].tolist() == pytest.approx([0.0, 0.01])
    assert history["F"].tolist() == pytest.approx([0.0, 0.5])
    assert history["c_min"].tolist() == [1.0, 0.75]
    assert history["W_ext"].iloc[-1] == pytest.approx(0.5 * 0.5 * 0.01)
    assert history["E_el"].isna().all()


@pytest.mark.parametrize(
    "text",
    [
        "\ufeffu,F\n0,0\n1,2\n", "u_mm F_kN\n0 0\n1 2\n", "# u F\n0 0\n1 2\n",
        "# from a paper\nu [mm],F (N)\n0,0\n1,2000\n",
        "u\tF\r\n0\t0\r\n1\t2\r\n", "u_\u03bcm,F_N\n0,0\n1000,2000\n", "u_\u00b5m,F_N\n0,0\n1000,2000\n",
    ],
)  # fmt: skip
def test_tables_as_people_write_them_are_read(text: str, square: Case, tmp_path: Path) -> None:
    history = mapped(table_of(text, tmp_path), parse_mapping(""), square, "mine.csv")
    assert history[["u", "F"]].to_numpy().tolist() == [[0.0, 0.0], [1.0, 2.0]]


@pytest.mark.parametrize(
    ("text", "columns", "said"),
    [
        ("", "", "is empty"),
        ("# only words\n", "", "is empty"),
        ("u,F\n", "", "no rows under its header u, F"),
        ("0,0\n1,2\n", "", "has no header"),
        ("a,b\n0,0\n1,2\n", "", 'no column is u and F; say which with a map such as "u = COLUMN, F = COLUMN"'),
        ("u,F\n0,0\n1,2\n", "u = U2", "has no column 'U2' for u; it has u, F"),
        ("u,F\n0,0\n1,2\n", "F = F [mm]", "[mm] is not a quantity of force; give a unit of force, such as [kN]"),
        ("u,F\n0,0\n1,2\n", "F = F [xyzw]", "[xyzw] has an unknown unit"),
        ("u,F\n0,0\n1,nan\n2,1\n", "", "column 'F' is no finite number in row 2 (1 of 3 rows)"),
        ("u,F\n0,0\n1,\n", "", "column 'F' is no finite number in row 2"),
        ("u;F\n0;0\n1;2,5\n", "", "column 'F' is no finite number in row 2"),
        ("time,u,F\n0,0,0\n2,1,1\n1,2,1\n", "", "the time falls in row 3, from 2 to 1"),
        ("u,F\n0,0\n1,2,3\n", "", "has 3 cells in row 2 and 2 in its header"),
        ("u,u\n0,0\n", "", "names a column twice (u, u)"),
        ("u,F\n2,0\n1,2\n0,0\n", "", "the rows go back from u = 2 to 0; sort them"),
        ("u,F\n0,0\n3,1\n1,2\n4,1\n2,3\n5,0\n", "", "u turns back in 4 of 6 rows, as it does in rows that are out of"),
        ("u,F,d\n0,0,0\n1,2,95\n", "", "or the damage from 0 to 95; give a share of 1"),
        ("u,F,c_min\n0,0,1\n1,2,-1\n", "", "the phase field goes from -1 to 1"),
        ("u,F\n0,0\n", "", "has one row"),
    ],
)
def test_what_is_wrong_is_one_sentence_that_lists_what_was_found(
    text: str, columns: str, said: str, square: Case, tmp_path: Path
) -> None:
    with pytest.raises(ImportedError) as error:
        mapped(table_of(text, tmp_path), parse_mapping(columns), square, str(tmp_path / "mine.csv"))
    assert said in str(error.value)
    assert str(error.value).startswith(str(tmp_path / "mine.csv"))
    assert "\n" not in str(error.value)


# --------------------------------------------------------------------------------------------------- kept


@pytest.mark.parametrize("header", ["u_mm,F", "u,F_kN"])
def test_where_loads_follow_a_factor_lengths_and_forces_are_refused(header: str, tmp_path: Path) -> None:
    pulled = [{"on": "top", "value": [0.0, 0.1], "ramp": "load"}]
    held = [{"on": "bottom", "direction": "y", "value": 0.0}, {"on": "left", "direction": "x", "value": 0.0}]
    case = case_from_tables({**PLATE, "tractions": pulled, "constraints": held, "load": {"path": [0, 1], "increment": 1}})
    table = read_table(written(tmp_path, csv(U, F, "u,F [kN*mm]")))
    assert mapped(table, parse_mapping(""), case, "mine.csv")["F"].to_numpy() == pytest.approx(F)
    with pytest.raises(ImportedError, match="u is the factor of this case's loads and F their work per factor"):
        mapped(read_table(written(tmp_path, csv(U, F, header))), parse_mapping(""), case, "mine.csv")


def test_what_is_left_out_of_a_kept_history_lies_on_lines_between_the_rest() -> None:
    x = np.linspace(0.0, 1.0, 400)
    history = pd.DataFrame({"step": range(400), "u": x, "F": np.where(x < 0.7, np.sin(2 * x), 0.0), "E_el": x**2})
    fewer = reduced(history, 1e-3)
    assert len(fewer) < 60
    assert fewer["F"].max() == history["F"].max()
    for name in ("F", "E_el"):
        assert np.abs(np.interp(x, fewer["u"], fewer[name]) - history[name]).max() < 4e-3 * np.ptp(history[name])


def test_a_kept_result_becomes_the_run_that_it_was(square: Case, tmp_path: Path) -> None:
    restored, left_out = restore(square, tmp_path / "out")
    assert (restored, left_out) == (["fem", "mpm"], [])
    entry = compare(square, "quick", tmp_path / "out")
    assert entry["verdict"] == "PASS"
    assert entry["checks"][0]["value"] == pytest.approx(0.5025, rel=1e-5)
    assert entry["runs"]["fem"]["code_version"] == "0.1.0+abc1234"


def test_a_kept_result_of_another_version_of_the_case_is_no_reference(square: Case, tmp_path: Path) -> None:
    text = square.source.read_text(encoding="utf-8")
    square.source.write_text(text.replace("young = 210.0", "young = 211.0"), encoding="utf-8")
    restored, left_out = restore(load_case(square.source, "quick"), tmp_path / "out")
    assert restored == []
    assert "of another version of the case" in left_out[0]


def test_without_kept_results_the_published_ones_are_left(square: Case, tmp_path: Path) -> None:
    reference = '[references.paper]\nkind = "table"\nsource = "Somebody"\nvalues = { peak_force = 0.5 }\n'
    path = fake_solver.write_case(tmp_path / "other", reference, fake_solver.check("reference:paper", 0.1))
    judged = judged_without_page(load_case(path, "quick"), U, F, tmp_path)
    assert judged.verdict == "PASS"
    remedy = "verify run and then verify accept, both with --tier quick, keep one"
    assert f"No result of run fem is kept for tier quick; {remedy}." in judged.remarks


# ------------------------------------------------------------------------------------------------ judging


@pytest.mark.parametrize(("factor", "verdict"), [(1.0, "PASS"), (1.1, "FAIL")])
def test_a_result_is_judged_against_both_solvers(square: Case, tmp_path: Path, factor: float, verdict: str) -> None:
    judged = judged_without_page(square, U, factor * F, tmp_path)
    assert judged.verdict == verdict
    gated = judged.checks[judged.checks["verdict"] != "INFO"]
    assert gated[["metric", "against"]].to_numpy().tolist() == [["peak_force", "fem"], ["peak_force", "mpm"]]
    assert gated["error"].iloc[0] == pytest.approx(factor - 1.0, abs=1e-5)


def test_a_metric_that_the_data_do_not_allow_is_a_sentence_and_no_failure(square: Case, tmp_path: Path) -> None:
    judged = judged_without_page(square, U, F, tmp_path)
    notes = judged.checks.set_index("metric")["note"]
    assert "has no values of E_frac; it has" in notes["fracture_energy"].iloc[0]
    assert "came without a crack path" in notes["crack_length"].iloc[0]
    with_path = judged_without_page(square, U, F, tmp_path, crack_path=np.array([[0, 0], [1, 0]]))
    assert with_path.checks.set_index("metric")["value"]["crack_length"].iloc[0] == 1.0


def test_a_result_that_does_not_unload_is_held_against_the_first_branch(square: Case, tmp_path: Path) -> None:
    kept = read_kept(square, "fem")
    assert kept is not None
    file = square.folder / "results" / "quick" / "fem.csv"
    last = kept.history.iloc[-1]
    back = f"99,{last['time'] + 1},0.002,0.1,0,0,0,0,0\n"
    file.write_text(file.read_text(encoding="utf-8") + back, encoding="utf-8")
    judged = judged_without_page(square, U, F, tmp_path)
    assert judged.verdict == "PASS"
    assert judged.remarks[1] == "Run fem is shown up to u = 0.01, where its load turns back."
    short = judged_without_page(square, U[:8], F[:8], tmp_path)
    note = short.checks.set_index("metric")["note"]["curve_l2_whole"].iloc[0]
    assert "covers only" in note and short.checks["verdict"].eq("FAIL").sum() == 2  # of the peak, which is there


@pytest.mark.parametrize(
    ("factor", "said"),
    [(0.5, "half model"), (2.0, "write u = 2 * COLUMN"), (4.0, "leave it out"), (1000.0, "unit"), (-1.0, "sign"),
     (1.2, "elastic part differs"), (1.0, "agrees")],
)
def test_the_elastic_part_tells_where_a_difference_comes_from(
    square: Case, tmp_path: Path, factor: float, said: str
) -> None:
    judged = judged_without_page(square, U, factor * F, tmp_path)
    assert said in judged.remarks[0]


@pytest.mark.parametrize("F", [0.0 * F, 0.0 * F + 0.3])
def test_a_force_that_never_grows_is_told(square: Case, tmp_path: Path, F: np.ndarray) -> None:
    """As the reaction in the direction that nothing moves."""
    judged = judged_without_page(square, U, F, tmp_path)
    assert judged.verdict == "FAIL"
    assert f"no force is larger than the first one, {F[0]:g}; map the column of the force" in judged.remarks[0]


UNLOADED, SCATTERED = [0.0, 0.004, 0.008, 0.004, 0.0, 0.006, 0.01], [0.0, 0.004, 0.0039999, 0.008, 0.0079999, 0.01]


@pytest.mark.parametrize("steps", [UNLOADED, SCATTERED])
def test_rows_that_unload_or_scatter_are_in_order(square: Case, steps: list[float]) -> None:
    table = pd.DataFrame({"u": steps, "F": np.interp(steps, U, F)})
    assert mapped(table, parse_mapping(""), square, "mine.csv")["u"].tolist() == steps


def test_both_signs_and_an_end_before_the_peak_are_told(square: Case, tmp_path: Path) -> None:
    both = judged_without_page(square, -U, -F, tmp_path)
    assert "write u = -COLUMN, F = -COLUMN" in both.remarks[1] and both.verdict == "FAIL"
    short = judged_without_page(square, U[:4], F[:4], tmp_path)
    assert f"that of its last row, at u = {U[3]:.4g}: the curve ends before a peak" in short.remarks[1]


def test_an_axis_read_with_an_offset_is_told(square: Case, tmp_path: Path) -> None:
    peak_at = U[np.argmax(F)]
    assert len(judged_without_page(square, U + 0.01 * peak_at, F, tmp_path).remarks) == 1
    judged = judged_without_page(square, U + 0.1 * peak_at, F, tmp_path)
    assert "agrees" in judged.remarks[0] and f"meets F = 0 at u = {0.1 * peak_at:.3g}" in judged.remarks[1]
    assert f"its peak lies at u = {peak_at:.4g} instead of {1.1 * peak_at:.4g}" in judged.remarks[1]


def test_the_command_judges_a_file_and_exits_by_the_verdict(
    square: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str], few_sections: None
) -> None:
    mine = written(tmp_path, csv(1000 * U, -1100 * F, "U2,RF2"))
    arguments = ["judge", str(square.source.parent), "--history", str(mine), "--tier", "quick"]
    arguments += ["--out", str(tmp_path / "out"), "--map", "u = U2 [um], F = -1*RF2 [N]"]
    for more, code in (([], 1), (["--within", "15%"], 0)):
        with pytest.raises(SystemExit) as ended:
            main([*arguments, *more])
        assert ended.value.code == code
    assert "mine" in capsys.readouterr().out
    for more, said in ((["--map", "F = a + b"], "map: 'F = a + b'"), (["--map", "u = x"], f"{mine}: has no column 'x'")):
        with pytest.raises(SystemExit) as ended:
            main([*arguments, *more])
        assert ended.value.code == 3
        assert said in capsys.readouterr().err


def test_a_moving_result_is_judged_by_what_it_tells(tmp_path: Path) -> None:
    table = pd.DataFrame({"time": [0.0, 0.1, 0.2], "E_kin": [13.7, 13.0, 13.7]})
    judged = judge("elastic_rings", table, out=tmp_path)
    assert judged.verdict == "NOT_CHECKED"
    assert judged.checks["note"].str.len().gt(0).all()
    page = judged.page.read_text(encoding="utf-8")
    assert "could not be drawn" not in page and "nan" not in page.replace("finance", "")


def test_an_imported_run_of_a_case_file_is_run_and_compared_like_others(
    square: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake_solver.install(monkeypatch)
    written(square.folder, csv(U, 1.01 * F))
    extra = '[runs.theirs]\nsolver = "imported"\nhistory = "mine.csv"\nmap = "u = u"\n'
    checked = fake_solver.check("fem", 0.02).replace('run = "mpm"', 'run = "theirs"')
    path = fake_solver.write_case(square.folder, extra, checked)
    for name in ("fem", "theirs"):
        run(path, name, "quick", tmp_path / "out")
    entry = compare(path, "quick", tmp_path / "out")
    assert [(check["verdict"], check["run"]) for check in entry["checks"]] == [("PASS", "theirs")]
    before = load_case(path, "quick", "theirs").hash()
    written(square.folder, csv(U, 1.02 * F))
    assert load_case(path, "quick", "theirs").hash() != before


@pytest.mark.parametrize(
    "table",
    ['solver = "imported"', 'solver = "fem"\nhistory = "mine.csv"', 'solver = "imported"\nhistory = "none.csv"',
     'solver = "imported"\nhistory = "mine.csv"\nmap = "F = a + b"'],
)  # fmt: skip
def test_a_table_of_an_imported_run_is_checked(square: Case, table: str) -> None:
    written(square.folder, csv(U, F))
    path = fake_solver.write_case(square.folder, f"[runs.theirs]\n{table}\n")
    with pytest.raises(CaseError, match=r"runs\.theirs"):
        load_case(path, "quick")


def test_a_result_that_no_run_can_read_is_refused_before_any(
    square: Case, capsys: pytest.CaptureFixture[str]
) -> None:
    written(square.folder, "u_mm;F\n0;0\n1;2,5\n")
    path = fake_solver.write_case(square.folder, '[runs.theirs]\nsolver = "imported"\nhistory = "mine.csv"\n')
    with pytest.raises(SystemExit) as ended:
        main(["validate", str(path)])
    assert ended.value.code == 3
    said = capsys.readouterr()
    assert "mine.csv: column 'F' is no finite number in row 2" in " ".join((said.out + said.err).split())


CURVE = pd.DataFrame({"u": U, "F": F})


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ([1, 2, 3], r"TABLE: is no table but of the kind list; give a pandas table"),
        (None, r"TABLE: is no table but of the kind NoneType"),
        (CURVE.astype(str).replace("0.0", "zero"), r"column 'u' is no finite number in row 1"),
        (CURVE.assign(F=F * 1j), r"column 'F' is no finite number in row 1"),
        (pd.concat([CURVE, CURVE["F"]], axis=1), r"names a column twice \(u, F, F\)"),
    ],
)
def test_what_is_no_table_of_numbers_is_told(square: Case, table: Any, said: str, tmp_path: Path) -> None:
    with pytest.raises(ImportedError, match=said):
        judge(square, table, out=tmp_path / "judged")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"within": "5%"}, "within: '5%' is no share"), ({"within": -1}, "within: -1 is no"),
        ({"within": 5}, "within: 5 is no"), ({"map": 3}, "map: 3 is no"),
    ],
)
def test_what_is_no_share_or_map_is_told(square: Case, options: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=said):
        judge(square, CURVE, out=tmp_path / "judged", **options)


@pytest.mark.parametrize(
    "path",
    [np.zeros((4, 3)), np.zeros((2, 4)), np.zeros(4), [[0, 0], [np.nan, 1]], [["a", "b"]], [[0, 0], [1]], CURVE],
)
def test_what_is_no_crack_path_is_told(square: Case, path: Any, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"crack_path: is of .* give an array \(n, 2\)"):
        judged_without_page(square, U, F, tmp_path, crack_path=path)


def test_a_crack_path_may_be_a_table_of_any_order(square: Case, tmp_path: Path) -> None:
    table = pd.DataFrame({"y": [0.5, 0.5, 0.75], "z": [0, 0, 0], "x": [0.0, 0.5, 1.0]})
    judged = judged_without_page(square, U, F, tmp_path, crack_path=table)
    assert judged.run.crack_path.tolist() == [[0.0, 0.5], [0.5, 0.5], [1.0, 0.75]]


def test_a_case_is_judged_at_the_tier_that_is_asked_for(square: Case, tmp_path: Path, few_sections: None) -> None:
    judged = judge(load_case(square.source, "standard"), CURVE, tier="quick", out=tmp_path / "judged")
    assert judged.run.case.tier == "quick" and judged.verdict == "PASS"


def test_judging_leaves_runs_of_the_case_alone(square: Case, tmp_path: Path) -> None:
    own = tmp_path / "out" / "runs" / square.name / square.tier / "fem" / "run.json"
    own.parent.mkdir(parents=True)
    own.touch()
    with pytest.raises(ImportedError, match=r"holds runs of the case.* give another folder"):
        judged_without_page(square, U, F, tmp_path)
    assert own.exists()


def test_judging_loads_no_solver_no_vtk_and_no_table_of_units(square: Case, tmp_path: Path) -> None:
    mine = written(tmp_path, csv(U, F))
    program = f"""
import sys
from verify import judge
judge({str(square.source)!r}, {str(mine)!r}, tier="quick", out={str(tmp_path / "out")!r})
heavy = ("pint", "scipy.sparse", "scipy.spatial", "scipy.optimize")
heavy += ("numba", "skfem", "vtkmodules", "pyvista", "meshio", "netgen")
print([name for name in heavy if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=Path(__file__).parents[1])
    assert done.stdout.strip() == "[]", done.stderr


def test_units_of_a_history_are_those_of_the_case(square: Case) -> None:
    assert isinstance(square.units, Units)
    assert history_of(pd.DataFrame({"u": U, "F": F}), load_case(square.source, "quick", "fem"))["F"].max() == F.max()
    assert read_kept(square, "fem") is not None


# ------------------------------------------------------------------------------------------------ archives


def test_an_archive_is_read_back_to_the_same_verdict(square: Case, tmp_path: Path) -> None:
    there = read_back(square, tmp_path)
    assert there.verdict == there.summary["cases"][0]["verdict"] == "PASS"
    runs = [RunFolder(file.parent) for file in (tmp_path / "there").rglob("run.json")]
    assert runs and all(run.case.folder == tmp_path / "there" / "cases" / "square" for run in runs)
    (tmp_path / "square-quick.zip").write_bytes(b"PK nothing")
    with pytest.raises(ArchiveError, match="no zip file"):
        read_archive(tmp_path / "square-quick.zip", tmp_path / "there")


def read_back(square: Case, folder: Path) -> Imported:
    write_archive(square, folder / "made", folder / "square-quick.zip")
    with zipfile.ZipFile(folder / "square-quick.zip") as archive:
        graph = json.loads(archive.read("ro-crate-metadata.json"))["@graph"]
        assert {entity["@id"] for entity in graph if entity["@type"] == "File"} == {*archive.namelist()} - {METADATA}
        assert not any(name.endswith(".vtu") for name in archive.namelist())
    return read_archive(folder / "square-quick.zip", folder / "there")


def test_fields_that_a_check_is_taken_from_are_in_the_archive(square: Case, tmp_path: Path) -> None:
    needs = fake_solver.check("none", 1e-6).replace("peak_force", "asymmetry")
    parameters = 'parameters = { direction = "x", middle = 0.5 }\n'
    path = fake_solver.write_case(square.folder, needs + parameters)
    assert write_archive(load_case(path, "quick"), tmp_path / "made", tmp_path / "a.zip") == ["mpm"]
    found = read_archive(tmp_path / "a.zip", tmp_path / "there")
    assert found.verdict == found.summary["cases"][0]["verdict"]


@pytest.mark.parametrize("fills", ["copy", "zip", "extraction"])
def test_a_disk_that_fills_up_under_an_archive_is_one_sentence(
    square: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fills: str
) -> None:
    read_back(square, tmp_path)

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    if fills == "copy":
        monkeypatch.setattr(shutil, "copytree", lambda *_, **__: _gathered(full))
    elif fills == "zip":
        monkeypatch.setattr(zipfile.ZipFile, "write", full)
    else:
        monkeypatch.setattr(zipfile.ZipFile, "open", full)
    with pytest.raises(WriteError, match="disk is full"):
        if fills == "extraction":
            read_archive(tmp_path / "square-quick.zip", tmp_path / "elsewhere")
        else:
            write_archive(square, tmp_path / "made", tmp_path / "again.zip", fields=True)
    assert not (tmp_path / "again.zip").exists()


def _gathered(write: Callable[[], None]) -> None:
    """As shutil.copytree tells the errors of its files."""
    try:
        write()
    except OSError as error:
        raise shutil.Error([("from", "to", str(error))]) from None


def test_a_changed_archive_is_refused(square: Case, tmp_path: Path) -> None:
    read_back(square, tmp_path)
    with zipfile.ZipFile(tmp_path / "square-quick.zip") as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(tmp_path / "changed.zip", "w") as changed:
        for name, data in content.items():
            changed.writestr(name, data.replace(b"210", b"211") if name.endswith("case.toml") else data)
    with pytest.raises(ArchiveError, match=r"case\.toml is missing or was changed"):
        read_archive(tmp_path / "changed.zip", tmp_path / "there")


def resealed(archive: Path, summary: bytes) -> Path:
    """The archive with another summary, of which its metadata tell."""
    with zipfile.ZipFile(archive) as opened:
        content = {name: opened.read(name) for name in opened.namelist()} | {"summary.json": summary}
    crate = json.loads(content[METADATA])
    for entity in crate["@graph"]:
        if entity["@type"] == "File":
            entity["sha256"] = hashlib.sha256(content[entity["@id"]]).hexdigest()
    content[METADATA] = json.dumps(crate).encode()
    with zipfile.ZipFile(archive.with_name("other.zip"), "w") as other:
        for name, data in content.items():
            other.writestr(name, data)
    return archive.with_name("other.zip")


@pytest.mark.parametrize(
    ("summary", "said"),
    [
        (b"[", "tells of no case"),
        (b"[]", "tells of no case"),
        (b'{"cases": []}', "tells of no case"),
        (b'{"cases": [{"case": "../own", "tier": "quick", "verdict": "PASS"}]}', "has no runs of case '../own'"),
        (b'{"cases": [{"case": "square", "tier": "..", "verdict": "PASS"}]}', "case 'square' at tier '..'"),
    ],
)
def test_an_archive_that_leads_elsewhere_leaves_what_is_there(
    summary: bytes, said: str, square: Case, tmp_path: Path
) -> None:
    write_archive(square, tmp_path / "made", tmp_path / "square.zip")
    own = tmp_path / "there" / "own" / "mine.txt"
    own.parent.mkdir(parents=True)
    own.touch()
    with pytest.raises(ArchiveError, match=said):
        read_archive(resealed(tmp_path / "square.zip", summary), tmp_path / "there")
    assert own.exists()


@pytest.mark.parametrize("metadata", [b"{", b"{}", b'{"@graph": [{"@id": "x"}]}', b'{"@graph": []}'])
def test_an_archive_whose_metadata_tell_nothing_is_refused(metadata: bytes, square: Case, tmp_path: Path) -> None:
    write_archive(square, tmp_path / "made", tmp_path / "square.zip")
    file = tmp_path / "other.zip"
    with zipfile.ZipFile(tmp_path / "square.zip") as opened, zipfile.ZipFile(file, "w") as other:
        for name in opened.namelist():
            other.writestr(name, metadata if name == METADATA else opened.read(name))
    with pytest.raises(ArchiveError, match=r"(cannot be read|was added); get the archive again"):
        read_archive(file, tmp_path / "there")


def test_an_archive_that_is_damaged_or_none_is_refused(square: Case, tmp_path: Path) -> None:
    write_archive(square, tmp_path / "made", tmp_path / "square.zip")
    with zipfile.ZipFile(tmp_path / "square.zip") as archive:
        at = archive.getinfo("summary.json").header_offset + 60
    data = bytearray((tmp_path / "square.zip").read_bytes())
    data[at : at + 8] = bytes(8)
    (tmp_path / "damaged.zip").write_bytes(data)
    for file, said in (("damaged.zip", "damaged one"), (".", "cannot be read")):
        with pytest.raises(ArchiveError, match=said):
            read_archive(tmp_path / file, tmp_path / "there")


def test_an_archive_does_not_replace_runs_of_ones_own(square: Case, tmp_path: Path) -> None:
    write_archive(square, tmp_path / "made", tmp_path / "square.zip")
    own = tmp_path / "there" / "runs" / "square" / "quick" / "fem" / "run.json"
    own.parent.mkdir(parents=True)
    own.touch()
    with pytest.raises(ArchiveError, match=r"holds runs of a case of this name.* --out"):
        read_archive(tmp_path / "square.zip", tmp_path / "there")
    assert own.exists()
    read_archive(tmp_path / "square.zip", tmp_path / "elsewhere")
    read_archive(tmp_path / "square.zip", tmp_path / "elsewhere")  # one that was read before is replaced


def test_a_folder_that_cannot_be_replaced_keeps_its_name(tmp_path: Path) -> None:
    (tmp_path / "old").mkdir()
    with pytest.raises(WriteError):
        replace_folder(tmp_path / "nothing", tmp_path / "old")
    assert (tmp_path / "old").is_dir()


# ------------------------------------------------------------------------------------ other people's tests


def test_the_fixture_fails_with_the_table_of_checks(
    square: Case, tmp_path: Path, fracture_case: Callable[[str], FractureCase], few_sections: None
) -> None:
    with pytest.raises(pytest.fail.Exception, match=r"(?s)FAIL.*peak_force +fem.*FAIL") as failed:
        fracture_case(str(square.source)).judge(written(tmp_path, csv(U, 1.1 * F)), tier="quick")
    assert Path(str(failed.value).splitlines()[-1]).is_file(), "its page"


def test_a_missing_extra_is_one_sentence_with_its_command(tmp_path: Path) -> None:
    program = "import sys; sys.modules['numba'] = None; from verify.cli import main; main(sys.argv[1:])"
    command = [sys.executable, "-c", program, "run", "bar_profile", "--tier", "quick", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parents[1])
    said = "numba is not installed, which this needs; install it with pip install 'fracture-verify[solve]'.\n"
    assert (done.returncode, done.stderr) == (3, said)


@pytest.mark.parametrize("file", sorted(LIBRARY.glob("*/results/*/*.csv")), ids=lambda file: "-".join(file.parts[-4:]))
def test_a_kept_result_of_the_library_is_of_the_case_as_it_stands(file: Path) -> None:
    """Where it is not, `verify accept` keeps another one."""
    if file.name.endswith(".crack_path.csv"):
        return
    kept = read_kept(load_case(file.parents[2] / "case.toml", file.parent.name), file.stem)
    assert kept is not None and kept.fits(load_case(file.parents[2] / "case.toml", file.parent.name, file.stem))
    assert np.isfinite(kept.history[["time", "u", "F"]].to_numpy(float)).all()


def test_a_force_is_no_power_of_what_moves() -> None:
    case, table = load_case("vibrating_bar", "quick"), {"time": [0.0, 0.1], "F [N]": [0.0, 1.0]}
    with pytest.raises(ImportedError, match=r"'F \[N\]' for F: .*not a quantity of power; give a unit of power"):
        mapped(pd.DataFrame(table), parse_mapping(""), case, "mine.csv")
