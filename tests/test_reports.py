"""The report: what it shows is what the summary says, and it comes out whatever is missing."""

from __future__ import annotations

import errno
import hashlib
import html
import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import unquote

import numpy as np
import pandas as pd
import pytest
from synthetic_run import TITLE, write_verification
from test_strangers import PLATE

from cases import case_from_tables, load_case
from cases.solvers import SOLVERS, Solver
from reports import curves, motion, orientations, scene, style, surface, sweeps, tables, write_report
from reports.fields import point_image
from reports.report import SECTIONS, readme_html
from reports.results import CaseResults, method_of
from reports.tables import check_groups
from reports.words import key_number, number, percent, section_words, verdict_sentence
from verify.judging.summary import reproduce_command
from verify.runs.atomic import WriteError
from verify.runs.run_folder import RunFolderError


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The report of a synthetic verification: its folder and its summary."""
    out = tmp_path_factory.mktemp("out")
    summary = write_verification(out, cells=12)
    assert write_report(out) == out / "index.html"
    return out, summary


@pytest.fixture(scope="module")
def again(report: tuple[Path, dict[str, Any]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same pages and figures, made once more and side by side."""
    copy = tmp_path_factory.mktemp("again") / "out"
    shutil.copytree(report[0], copy, ignore=shutil.ignore_patterns("figures", "pages"))
    write_report(copy, jobs=2)
    return copy


def test_pages_made_side_by_side_are_the_same(report: tuple[Path, dict[str, Any]], again: Path) -> None:
    for page in pages(report[0]):
        assert (again / page.relative_to(report[0])).read_text() == page.read_text()


def pages(out: Path) -> list[Path]:
    return [out / "index.html", *sorted((out / "pages").glob("*.html"))]


def text_of(page: Path) -> str:
    """The words of a page without its markup."""
    body = re.sub(r"(?s)<(style|script)\b.*?</\1>", "", page.read_text(encoding="utf-8"))
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", body)))


def test_there_is_one_page_per_case_and_an_overview(report: tuple[Path, dict[str, Any]]) -> None:
    out, summary = report
    assert len(pages(out)) == 1 + len(summary["cases"])


def test_every_link_and_figure_exists_and_nothing_comes_from_elsewhere(
    report: tuple[Path, dict[str, Any]],
) -> None:
    out, _ = report
    for page in pages(out):
        links = re.findall(r'(?:href|src)="([^"#]+)"', page.read_text(encoding="utf-8"))
        assert links
        for link in links:
            assert "//" not in link
            assert (page.parent / unquote(html.unescape(link))).exists(), link


def test_all_sections_are_drawn(report: tuple[Path, dict[str, Any]]) -> None:
    out, _ = report
    drawn = {file.stem for file in (out / "figures").rglob("*.svg")}
    assert drawn >= {
        "scene", "load-displacement", "relative-error-fem", "relative-error-someone2010", "energies",
        "phase-field", "crack-paths", "distortion", "hydrostatic-stress", "convergence-l2_error_displacement",
    }  # fmt: skip
    assert "could not be drawn" not in text_of(pages(out)[1])


def test_no_template_variable_is_left(report: tuple[Path, dict[str, Any]]) -> None:
    for page in pages(report[0]):
        assert not re.search(r"\{\{|\}\}|\{%|Undefined|\bNone\b|\bnan\b", text_of(page))


def test_numbers_on_the_page_are_those_of_the_summary(report: tuple[Path, dict[str, Any]]) -> None:
    out, summary = report
    page = text_of(pages(out)[1])
    for check in summary["cases"][0]["checks"]:
        for shown in (
            number(check["value"]),
            percent(check["error"]),
            percent(check["margin_used"]),
            check["reason"],
        ):
            assert shown in page
    for curve in summary["cases"][0]["curves"]:
        assert f"{number(curve['l2_percent_after_peak'], 3)} %" in page
    (paths,) = summary["cases"][0]["crack_paths"]
    assert f"Hausdorff distance {number(paths['hausdorff'], 3)} mm, mean distance {number(paths['mean'], 3)} mm" in page
    assert "takes 1.13 times as long" in page


def test_special_characters_are_escaped(report: tuple[Path, dict[str, Any]]) -> None:
    for page in pages(report[0]):
        assert TITLE in text_of(page)
        source = page.read_text(encoding="utf-8")
        assert "<plate>" not in source
        assert source.count("<script") in (0, 2)  # the script of the curves and their numbers


def test_the_data_behind_a_curve_are_the_history(report: tuple[Path, dict[str, Any]]) -> None:
    out, summary = report
    table = pd.read_csv(next((out / "figures").rglob("load-displacement.csv")))
    history = pd.read_csv(out / summary["cases"][0]["runs"]["mpm"]["folder"] / "history.csv")
    np.testing.assert_allclose(table.loc[table["run"] == "mpm", "F"], history["F"], rtol=1e-9)
    slope = pd.read_csv(next((out / "figures").rglob("convergence-*.csv")))
    assert np.polyfit(np.log(slope["h"]), np.log(slope["error"]), 1)[0] == pytest.approx(3.0)
    assert set(slope["theory"]) == {3.0}


def test_a_missing_run_and_a_damaged_case_are_said(
    report: tuple[Path, dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("reports.report.SECTIONS", SECTIONS[:4])  # the others draw nothing new here
    out = tmp_path / "copy"
    shutil.copytree(report[0], out)
    shutil.rmtree(out / "runs" / "notched" / "standard" / "mpm")
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    summary["cases"][0]["source"] = str(tmp_path / "gone" / "case.toml")
    (out / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    write_report(out)
    page = text_of(pages(out)[1])
    assert "Not shown: mpm. Reason:" in page
    assert "The case description could not be read" in page
    assert (out / "figures" / "notched-standard" / "load-displacement.svg").exists()


def test_an_empty_summary_and_none_at_all(tmp_path: Path, few_sections: None) -> None:
    with pytest.raises(FileNotFoundError, match="verify compare"):
        write_report(tmp_path)
    summary = {"version": "1", "created": "now", "tier": "quick", "cases": []}
    (tmp_path / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    assert "no case" in text_of(write_report(tmp_path))


def test_equal_results_give_equal_figures(report: tuple[Path, dict[str, Any]], again: Path) -> None:
    first, second = (
        {
            file.name: hashlib.sha256(file.read_bytes()).hexdigest()
            for file in (out / "figures").rglob("*.svg")
        }
        for out in (report[0], again)
    )
    assert first
    assert first == second


def test_points_are_painted_where_they_are() -> None:
    places = np.array([[0.25, 0.5], [0.75, 0.25], [0.75, 0.75]])
    image, extent = point_image(load_case("sen_tension"), places, np.array([1.0, 2.0, np.nan]))
    assert extent == pytest.approx((0.0, 1.0, 0.0, 1.0))
    assert image[0, 0] == 1.0
    assert image[0, -1] == 2.0
    assert image.mask[-1, -1], "what has no value is not painted"
    assert 0.15 < image.mask.mean() < 0.3


def test_the_verdict_sentence_names_the_tightest_check() -> None:
    loose = {"metric": "peak_force", "run": "mpm", "against": "fem", "target": 0.7, "error": 1e-3,
             "limit": 1e-2, "margin_used": 0.1, "verdict": "PASS", "gate": True,
             "measure": "relative"}  # fmt: skip
    tight = loose | {"metric": "initial_stiffness", "error": 9e-3, "margin_used": 0.9}
    shown_only = loose | {"metric": "fracture_energy", "margin_used": 7.0, "gate": False}
    sentence = verdict_sentence({"checks": [loose, tight, shown_only]})
    assert sentence.startswith("2 of 2 gated checks within the limit.")
    assert "uses 90 % of its limit (initial stiffness of mpm against fem: error 0.9 %, limit 1 %)" in sentence


def test_sweeps_are_drawn_beside_the_published_values(tmp_path: Path) -> None:
    """Two spacings of two length scales: the caption tells the largest difference and where h resolves l0."""
    checks = []
    for length_scale, h, force in ((5.0, 5.0, 14.0), (5.0, 2.5, 13.8), (2.5, 5.0, 16.0), (2.5, 2.5, 15.0)):
        run = f"spacing[length_scale={length_scale:g},h={h:g}]"
        for metric, value in (("peak_force", force), ("displacement_at_peak", 0.01 * force)):
            row = {"metric": metric, "run": run, "against": "reference:x", "value": value, "target": 1.02 * value}
            checks.append(row)
    results = CaseResults({"case": "l_panel_cell_spacing", "tier": "standard", "checks": checks}, tmp_path)
    (drawing,) = sweeps.critical_values(results, tmp_path)
    assert (tmp_path / drawing.file).stat().st_size > 0
    assert "peak force 2 %" in drawing.caption
    assert "at most 1.4 % where h ≤ l0, and by up to 6.7 % where h > l0" in drawing.caption


def test_momentum_of_two_bodies_is_drawn(tmp_path: Path) -> None:
    case = load_case("two_discs", "quick")
    time = np.linspace(0.0, 1.0, 5)
    signs = dict(zip(case.bodies, (1, -1), strict=True))
    columns = {f"{name}_momentum_{axis}": sign * time for name, sign in signs.items() for axis in "xy"}
    history = pd.DataFrame({"time": time, **columns, "momentum_x": 0.0 * time, "momentum_y": 0.0 * time})
    run = SimpleNamespace(name="mpm", label="PF-MPM", method=method_of("mpm"), history=history)
    results: Any = SimpleNamespace(case=case, main_runs=lambda: [run], unit=lambda quantity: quantity)
    drawing = motion.momentum(results, tmp_path)
    assert drawing is not None and (tmp_path / drawing.file).stat().st_size > 0
    assert set(columns) < set(pd.read_csv(tmp_path / str(drawing.data)).columns)


@pytest.mark.parametrize("solver", SOLVERS.values(), ids=lambda solver: solver.name)
def test_energies_of_every_solver_are_drawn_with_its_line(solver: Solver) -> None:
    """Some have a pattern of dashes in place of one of matplotlib's short names."""
    history = pd.DataFrame({name: [0.0, 1.0] for name in ("u", "time", "E_el", "E_frac", "E_kin", "W_ext")})
    run = SimpleNamespace(name="run", label="run", method=solver, history=history)
    figure, grid = style.panels(1, 2, 4.0, 2.0)
    motion._draw_over_time(grid.flat[0], [run], {"run": "black"}, {"run": history["E_el"]})
    curves._draw_energies(grid.flat[1], run)
    figure.draw_without_rendering()
    assert [len(axes.lines) for axes in grid.flat] == [1, 5]


def test_a_metric_is_drawn_over_the_one_number_swept(tmp_path: Path) -> None:
    published = {-0.04: 0.0, -0.1: 0.0, -0.18: 1.0}
    checks = [
        {"metric": "cone_index", "run": f"disc[velocity.1={v:g}]", "against": "reference:x", "value": 1.0 - target,
         "target": target, "unit": "1"}
        for v, target in published.items()
    ]  # fmt: skip
    results = CaseResults({"case": "disc_beam_velocity", "tier": "standard", "checks": checks}, tmp_path)
    (drawing,) = sweeps.values_over_sweep(results, tmp_path)
    assert (tmp_path / drawing.file).stat().st_size > 0
    table = pd.read_csv(tmp_path / str(drawing.data))
    assert dict(zip(table["x"], table["target"], strict=True)) == published
    assert list(table["value"]) == [0.0, 1.0, 1.0]
    few = CaseResults({"case": "disc_beam_velocity", "tier": "standard", "checks": checks[:2]}, tmp_path)
    assert sweeps.values_over_sweep(few, tmp_path) == []


def test_critical_loads_are_drawn_over_orientation_with_their_asymmetry(tmp_path: Path) -> None:
    loads = {-40: 101.0, 0: 90.0, 20: 95.0, 40: 100.0}
    runs = [
        SimpleNamespace(
            name=f"fem_cubic[orientation={angle}]", method=method_of("fem"),
            history=pd.DataFrame({"u": [0.0, 1.0, 2.0], "F": [0.0, load, 10.0]}),
        )
        for angle, load in loads.items()
    ]  # fmt: skip
    case = load_case("square_plate_anisotropic", "standard")
    results: Any = SimpleNamespace(case=case, shown_runs=lambda: runs, unit=lambda quantity: "kN")
    drawing = orientations.critical_load(results, tmp_path)
    assert drawing is not None and (tmp_path / drawing.file).stat().st_size > 0
    assert "opposite: 0.99 % (fem_cubic)" in drawing.caption
    table = pd.read_csv(tmp_path / str(drawing.data))
    assert dict(zip(table["orientation"], table["peak_force"], strict=True)) == loads


def test_a_family_that_goes_on_under_another_name_is_one_line(tmp_path: Path) -> None:
    """At paper the material points' negative orientations are a family of their own."""
    runs = [
        SimpleNamespace(name=name, method=method_of("mpm"), history=pd.DataFrame({"u": [0.0, 1.0], "F": [0.0, load]}))
        for name, load in {
            "mpm_cubic[orientation=40]": 100.0, "mpm_cubic_upper[orientation=-40]": 102.0,
            "mpm_orthotropic[orientation=40]": 110.0,
        }.items()
    ]  # fmt: skip
    case = load_case("square_plate_anisotropic", "paper")
    results: Any = SimpleNamespace(case=case, shown_runs=lambda: runs, unit=lambda quantity: "kN")
    drawing = orientations.critical_load(results, tmp_path)
    assert drawing is not None and "opposite: 2 % (mpm_cubic)" in drawing.caption
    assert set(pd.read_csv(tmp_path / str(drawing.data))["family"]) == {"mpm_cubic", "mpm_orthotropic"}


def test_surface_energies_belong_to_cases_of_fourth_order(tmp_path: Path) -> None:
    page: Any = SimpleNamespace(case=load_case("layered_beam", "quick"))
    with style.drawing_style():
        drawings = surface.surface_energy(page, tmp_path)
    assert [drawing.name for drawing in drawings] == ["surface-energy", "surface-stiffness", "surface-profiles"]
    assert "0.7071 at 0° to 1.157 kN/m at 45°" in drawings[0].caption
    assert surface.surface_energy(SimpleNamespace(case=load_case("sen_tension", "quick")), tmp_path) == []


# ---------------------------------------------------------------- what must not vanish


@pytest.fixture
def copied(report: tuple[Path, dict[str, Any]], tmp_path: Path, few_sections: None) -> Path:
    """A copy of the verification's folder, of whose page the first sections alone are drawn."""
    out = tmp_path / "copy"
    shutil.copytree(report[0], out)
    return out


def change_entry(out: Path, **changes: Any) -> None:
    """Change keys of the one case of a summary."""
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    summary["cases"][0] |= changes
    (out / "summary.json").write_text(json.dumps(summary), encoding="utf-8")


def test_curves_that_cannot_be_compared_are_named_with_the_reason(copied: Path) -> None:
    change_entry(copied, curves=[], curve_problems=["fem vs x: covers only 57.0% of the loaded range of reference x"])
    write_report(copied)
    page = text_of(pages(copied)[1])
    assert "Curves not compared: fem vs x: covers only 57.0% of the loaded range of reference x" in page
    assert not list((copied / "figures").rglob("relative-error-*.svg"))


def test_a_disk_that_fills_up_ends_the_report_and_spoils_no_figure(copied: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.EDQUOT, "Disk quota exceeded")

    monkeypatch.setattr("reports.report.SECTIONS", (("Forces", full),))
    with pytest.raises(OSError, match="quota"):
        write_report(copied)


def test_a_disk_that_fills_up_under_a_page_or_figure_leaves_the_old_one(
    copied: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def half(self: Path, text: str, **_: Any) -> None:
        with self.open("w", encoding="utf-8") as file:
            file.write(text[:100])
        raise OSError(errno.ENOSPC, "No space left on device")

    before = write_report(copied).read_bytes()
    monkeypatch.setattr(Path, "write_text", half)
    with pytest.raises(WriteError, match="disk is full"):
        write_report(copied)
    assert (copied / "index.html").read_bytes() == before
    assert not [file for file in copied.rglob("*.html") if file.stat().st_size <= 100]


def test_a_solver_that_nobody_registered_is_shown_under_its_name(copied: Path) -> None:
    file = copied / "runs" / "notched" / "standard" / "mpm" / "run.json"
    file.write_text(file.read_text(encoding="utf-8").replace('"solver": "mpm"', '"solver": "imported"'), encoding="utf-8")
    write_report(copied)
    page = text_of(pages(copied)[1])
    assert "mpm (imported)" in page and "could not be drawn" not in page


def test_a_relative_error_is_not_drawn_where_the_reference_carries_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    force = np.array([0.0, 0.5, 1.0, 0.5, 0.01, 0.001])
    table = pd.DataFrame({"u": np.arange(6.0), "F_reference": force, "F": 1.0})
    table["relative_error_percent"] = 100.0 * (1.0 - force) / np.maximum(force, 1e-3)
    table.to_csv(tmp_path / "curve.csv", index=False)
    norms = {"l2_percent_before_peak": 1.25, "l2_percent_after_peak": 48430.0}
    entry = {"curves": [{"run": "fem", "reference": "x", "file": "curve.csv", **norms}]}
    results: Any = SimpleNamespace(out=tmp_path, entry=entry, runs={}, unit=str, shown_runs=list, load_label="u [mm]")
    drawn = figures_of(monkeypatch)
    (drawing,) = curves.relative_errors(results, tmp_path)
    error = drawn[0].axes[0].lines[0].get_ydata()
    assert np.isnan(error[[0, 4, 5]]).all() and np.isfinite(error[1:4]).all()
    assert "1.25 % up to the peak, above 100 % after it" in drawing.caption
    assert "Not drawn where x carries less than 5 % of its peak" in drawing.caption


def figures_of(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The figures that are written from now on."""
    written: list[Any] = []
    save = style.save
    monkeypatch.setattr(style, "save", lambda figure, *where: written.append(figure) or save(figure, *where))
    return written


MOVING = """
title = "A block that is pulled"
requirement = "What acts is drawn."
units = { length = "mm", force = "kN", time = "ms" }
plane = { assumption = "strain" }
materials.steel = { young = 210.0, poisson = 0.3, density = 7.8e-6 }
bodies.block = { material = "steel", velocity = [3.0, 0.0], shape = { rectangle = { lower = [0, 0], upper = [1, 1] } } }
constraints = [{ on = "bottom", direction = "y", velocity = -0.5 }]
tractions = [{ on = "top", value = [0.0, 2.0], ramp = 0.1 }]
dynamics = { end_time = 1.0, gravity = [0.0, -9.81e-3] }
mesh = { h = 0.1 }
runs.mpm = { solver = "mpm" }
"""


def test_all_that_acts_is_drawn_and_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "case.toml").write_text(MOVING, encoding="utf-8")
    case = load_case(tmp_path / "case.toml")
    rows = {(row["name"], row["conditions"]) for row in scene.boundary_rows(case)}
    assert rows == {
        ("bottom", "v_y = -0.5 mm/ms"), ("top", "traction (0, 2) kN/mm² over 0.1 ms"),
        ("gravity", "(0, -0.00981) mm/ms²"), ("block", "velocity (3, 0) mm/ms"),
    }  # fmt: skip
    drawn = figures_of(monkeypatch)
    results = CaseResults({"case": "block", "source": str(case.source)}, tmp_path)
    assert scene.scene(results, tmp_path) is not None
    texts = drawn[0].axes[0].texts
    said = " ".join(text.get_text() for text in texts)
    assert "traction (0, 2)" in said and "$v_y$ = -0.5 mm/ms" in said and "gravity" in said and "velocity (3, 0)" in said
    arrows = [text for text in texts if getattr(text, "arrow_patch", None) and not text.get_text()]
    along = {tuple(np.sign(np.round(np.subtract(arrow.xy, arrow.xyann), 9))) for arrow in arrows}
    assert along >= {(0.0, 1.0), (0.0, -1.0), (1.0, 0.0)}


AT_REST = """
title = "A block that is pressed, pulled and warmed"
requirement = "What acts is drawn."
units = { length = "mm", force = "kN" }
plane = { assumption = "strain" }
materials.steel = { young = 210.0, poisson = 0.3, density = 7.8e-12, expansion = 1.2e-5 }
bodies.block = { material = "steel", shape = { rectangle = { lower = [0, 0], upper = [1, 1] } } }
constraints = [
    { on = "bottom", direction = "y", value = 0 }, { on = "left", direction = "x", table = [[0, 0], [1, 0.1]] },
]
tractions = [{ on = "top", pressure = 2.0, ramp = "load" }]
body_forces = [{ gravity = ["9.81 m/s^2", 0.0] }, { on = "block", value = [0.0, 1.0], ramp = "load" }]
eigenstrains = [{ temperature = 20, ramp = "load" }, { on = "block", value = [[1e-3, 0], [0, 2e-3]] }]
load = { path = [0.0, 1.0], increment = 0.5 }
mesh = { h = 0.1 }
runs.mpm = { solver = "mpm" }
"""


def test_what_acts_at_rest_is_drawn_and_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "case.toml").write_text(AT_REST, encoding="utf-8")
    case = load_case(tmp_path / "case.toml")
    rows = {(row["name"], row["place"], row["conditions"]) for row in scene.boundary_rows(case)}
    assert rows >= {
        ("top", "top of the bounding box", "pressure 2 kN/mm² × u"), ("gravity", "all bodies", "(9810, 0) mm/s²"),
        ("force", "block", "(0, 1) kN/mm³ × u"), ("temperature", "all bodies", "+20 K × u"),
        ("eigenstrain", "block", "[(0.001, 0), (0, 0.002)]"),
        ("left", "left of the bounding box", "u_x from a table over u"),
    }  # fmt: skip
    drawn = figures_of(monkeypatch)
    results = CaseResults({"case": "block", "source": str(case.source)}, tmp_path)
    assert scene.scene(results, tmp_path) is not None
    texts = drawn[0].axes[0].texts
    said = " ".join(text.get_text() for text in texts)
    assert "pressure 2" in said and "temperature +20 K" in said and "gravity (9810, 0)" in said
    arrows = [text for text in texts if getattr(text, "arrow_patch", None) and not text.get_text()]
    along = {tuple(np.sign(np.round(np.subtract(arrow.xy, arrow.xyann), 9))) for arrow in arrows}
    assert along >= {(0.0, -1.0), (1.0, 0.0), (0.0, 1.0)}
    assert results.load_label == "load factor u [1]" and results.unit("force") == "kN·mm"


def test_pictures_from_elsewhere_are_links(tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text(MOVING, encoding="utf-8")
    page = "![a photo](https://example.org/a.png) ![b](//example.org/b.png) ![c](c.png)"
    (tmp_path / "README.md").write_text(page, encoding="utf-8")
    shown = readme_html(CaseResults({"case": "block", "source": str(tmp_path / "case.toml")}, tmp_path))
    assert "<img" not in shown and 'src="' not in shown
    assert '<a href="https://example.org/a.png">a photo</a> <a href="//example.org/b.png">b</a> c' in shown


def test_commands_can_be_pasted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "my cases" / "block; x" / "case.toml"
    file.parent.mkdir(parents=True)
    file.write_text(MOVING, encoding="utf-8")
    case = load_case(file)
    assert shlex.split(reproduce_command(case))[:3] == ["verify", "run", str(file)]
    monkeypatch.chdir(tmp_path)
    assert shlex.split(reproduce_command(case))[2] == "my cases/block; x/case.toml"


def test_checks_of_one_metric_stand_together_and_share_their_reason(tmp_path: Path) -> None:
    entry = {"case": "sen_tension", "checks": many_checks()}
    groups = check_groups(CaseResults(entry, tmp_path))
    assert [group["metric"] for group in groups] == ["Peak force", "Crack angle", "Energy balance", "Crack length"]
    assert [[len(rows) for rows in group["parts"].values()] for group in groups] == [[4]] * 4
    assert key_number(many_checks()) == (
        "Peak force of mpm_orthotropic[orientation=10] 220.2 kN against 220.9 kN (fem_orthotropic[orientation=10])"
    )


# ---------------------------------------------------------------- in a browser

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
         "--disable-background-networking", "--disable-component-update", "--dump-dom")  # fmt: skip
MEASURE = """<script>addEventListener("load", function () {
  var pictures = Array.from(document.querySelectorAll(".first img, .first .chart > svg"));
  pictures = pictures.map((i) => i.getBoundingClientRect()).filter((p) => p.width > 0);
  var checks = document.querySelector("table.wide").parentElement, root = document.documentElement;
  document.body.dataset.layout = JSON.stringify({
    window: innerWidth, hidden: root.scrollWidth - root.clientWidth, table: checks.scrollWidth - checks.clientWidth,
    verdict: document.querySelector(".chip").getBoundingClientRect().bottom,
    pictures: pictures.map((p) => [p.width, p.bottom]), checks: checks.getBoundingClientRect().height,
  });
});</script>"""


def many_checks() -> list[dict[str, Any]]:
    """Sixteen checks of four metrics, of runs with long names."""
    common = {"value": 220.2, "target": 220.9, "unit": "kN", "error": 0.00356, "limit": 0.01, "margin_used": 0.356,
              "verdict": "PASS", "gate": True, "reason": "asked: 1 %, " + 20 * "for a reason ", "source": "a book",
              "parameters": {}}  # fmt: skip
    return [
        common | {"metric": metric, "run": f"mpm_orthotropic[orientation={angle}]",
                  "against": f"fem_orthotropic[orientation={angle}]"}
        for metric in ("peak_force", "crack_angle", "energy_balance", "crack_length") for angle in (10, 20, 30, 40)
    ]  # fmt: skip


def layout(page: Path, width: int, profile: Path) -> dict[str, Any]:
    """What a browser makes of a page in a window so wide."""
    probe = page.with_name(f"probe-{page.name}")
    probe.write_text(page.read_text(encoding="utf-8").replace("</body>", f"{MEASURE}</body>"), encoding="utf-8")
    asked = [str(BROWSER), *FLAGS, f"--user-data-dir={profile}", f"--window-size={width},900", probe.as_uri()]
    shown = subprocess.run(asked, capture_output=True, text=True, timeout=120, check=True).stdout
    return json.loads(html.unescape(re.findall(r'data-layout="([^"]*)"', shown)[0]))


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on PATH: the layout of the pages is not measured")
def test_pages_fit_their_window_and_the_verdict_stands_on_the_first_screen(copied: Path, tmp_path: Path) -> None:
    change_entry(copied, checks=many_checks())
    write_report(copied)
    overview, page = pages(copied)
    for width in (800, 1300, 1900):
        for each in (overview, page):
            found = layout(each, width, tmp_path / "profile")
            assert (found["window"], found["hidden"]) == (width, 0), "no column of the page is hidden"
            assert found["table"] == 0, "no column of the table is hidden"
        assert found["checks"] < 900 or width == 800, "sixteen checks fill one screen"
        if width >= 1300:
            assert found["verdict"] < 300
            assert len(found["pictures"]) == 2, "main curve and scene"
            assert all(wide > 300 and bottom < 900 for wide, bottom in found["pictures"])


@pytest.mark.parametrize(
    ("section", "words"), [("4.4.1", "section 4.4.1 of the thesis"), ("Miehe et al. 2010", "Miehe et al. 2010")]
)
def test_a_section_is_of_the_thesis_where_it_is_a_number(section: str, words: str) -> None:
    assert section_words(section) == words


@pytest.mark.parametrize(
    ("scales", "name"),
    [((1.0,), "reaction force"), ((-1.0, -1.0), "reaction force"), ((0.5,), "force that does work on u,"),
     ((-1.0, 1.0), "force that does work on u,")],
)  # fmt: skip
def test_the_force_is_called_a_reaction_where_it_is_one(scales: tuple[float, ...], name: str, tmp_path: Path) -> None:
    moved = [{"on": on, "direction": "y", "scale": scale} for on, scale in zip(("top", "bottom"), scales, strict=False)]
    results = CaseResults({"case": "plate"}, tmp_path)
    results.__dict__["case"] = case_from_tables({**PLATE, "constraints": [PLATE["constraints"][1], *moved]}, "quick")
    assert results.force_name == name


@pytest.mark.parametrize("content", ["garbage", "[]", "{}", '{"cases": []}', '{"cases": [1]}'])
def test_a_damaged_summary_is_told_in_one_sentence(content: str, tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text(content)
    with pytest.raises(RunFolderError, match=r"summary\.json: is damaged; judge again with `verify compare`\.$"):
        write_report(tmp_path)


def test_the_cost_of_an_iteration_is_processor_time_over_all_of_them() -> None:
    """Neither that of the linear solver alone nor with compilation; of a run that moves all steps, not those told."""
    seconds = {"processor": 6.0, "solve": 0.1, "total": 60.0}
    at_rest: Any = SimpleNamespace(entry={"seconds": seconds}, history=pd.DataFrame({"staggered": [2, 4, 6]}))
    assert tables.seconds_per_iteration(at_rest) == pytest.approx(0.5)
    entry = {"seconds": seconds, "counters": {"steps": 300}}
    moving: Any = SimpleNamespace(entry=entry, history=pd.DataFrame({"staggered": [2] * 7}))
    assert tables.staggered_iterations(moving) == 600
    assert tables.seconds_per_iteration(moving) == pytest.approx(0.01)
