"""The report: what it shows is what the summary says, and it comes out whatever is missing."""

from __future__ import annotations

import hashlib
import html
import json
import re
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import unquote

import numpy as np
import pandas as pd
import pytest
from synthetic_run import TITLE, write_verification

from cases import load_case
from reports import motion, orientations, style, surface, sweeps, write_report
from reports.fields import point_image
from reports.report import SECTIONS
from reports.results import CaseResults
from reports.words import number, percent, verdict_sentence


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The report of a synthetic verification: its folder and its summary."""
    out = tmp_path_factory.mktemp("out")
    summary = write_verification(out, cells=12)
    assert write_report(out) == out / "index.html"
    return out, summary


def test_pages_made_side_by_side_are_the_same(report: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    out, copy = report[0], tmp_path / "out"
    shutil.copytree(out, copy)
    shutil.rmtree(copy / "pages")
    write_report(copy, jobs=2)
    for page in pages(out):
        assert (copy / page.relative_to(out)).read_text() == page.read_text()


def pages(out: Path) -> list[Path]:
    return [out / "index.html", *sorted((out / "pages").glob("*.html"))]


def text_of(page: Path) -> str:
    """The words of a page without its markup."""
    body = re.sub(r"(?s)<style>.*?</style>", "", page.read_text(encoding="utf-8"))
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
        assert "<script" not in source


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


def test_an_empty_summary_and_none_at_all(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="verify compare"):
        write_report(tmp_path)
    summary = {"version": "1", "created": "now", "tier": "quick", "cases": []}
    (tmp_path / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    assert "no case" in text_of(write_report(tmp_path))


def test_equal_results_give_equal_figures(report: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(report[0], copy, ignore=shutil.ignore_patterns("figures"))
    write_report(copy)
    first, second = (
        {
            file.name: hashlib.sha256(file.read_bytes()).hexdigest()
            for file in (out / "figures").rglob("*.svg")
        }
        for out in (report[0], copy)
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
             "error_kind": "relative"}  # fmt: skip
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
    run = SimpleNamespace(name="mpm", solver="mpm", history=history)
    results: Any = SimpleNamespace(case=case, main_runs=lambda: [run], unit=lambda quantity: quantity)
    drawing = motion.momentum(results, tmp_path)
    assert drawing is not None and (tmp_path / drawing.file).stat().st_size > 0
    assert set(columns) < set(pd.read_csv(tmp_path / str(drawing.data)).columns)


def test_a_metric_is_drawn_over_the_one_number_swept(tmp_path: Path) -> None:
    published = {-0.02: 0.0, -0.1: 0.0, -0.18: 1.0}
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
    loads = {-40: 101.0, 0: 90.0, 40: 100.0, 50: 110.0}
    runs = [
        SimpleNamespace(
            name=f"fem_cubic[orientation={angle}]", solver="fem",
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
        SimpleNamespace(name=name, solver="mpm", history=pd.DataFrame({"u": [0.0, 1.0], "F": [0.0, load]}))
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
