"""What saves time in a report changes no figure: those kept, laid out once, drawn in parts, painted from the points."""

from __future__ import annotations

import io
import json
import re
import shutil
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from conftest import draw_few_sections
from scipy.spatial import cKDTree
from synthetic_run import write_verification

from cases import load_case
from cases.loader import reading_once
from numerics.nearest_points import nearest_to_pixels
from reports import kept, style, write_report


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The folder of a synthetic verification with its report, of the first sections, and a copy of it."""
    out = tmp_path_factory.mktemp("verified") / "out"
    write_verification(out, cells=12)
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    summary["cases"][0]["source"] = str(out / "cases" / "notched" / "case.toml")
    (out / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    with pytest.MonkeyPatch.context() as monkeypatch:
        draw_few_sections(monkeypatch)
        write_report(out)
    shutil.copytree(out, out.with_name("copy"))
    return out, out.with_name("copy")


@pytest.fixture
def drawn(
    reported: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, few_sections: None
) -> tuple[Path, list[str]]:
    """The verification's folder as it was, and the names of figures that are drawn from then on."""
    (out, copy), names, save = reported, list[str](), style.save
    shutil.rmtree(out)
    shutil.copytree(copy, out)
    monkeypatch.setattr(style, "save", lambda figure, folder, name: (names.append(name), save(figure, folder, name))[1])
    return out, names


def page_of(out: Path) -> str:
    (page,) = (out / "pages").glob("*.html")
    return page.read_text(encoding="utf-8")


def test_a_second_report_of_unchanged_runs_draws_nothing(drawn: tuple[Path, list[str]]) -> None:
    out, names = drawn
    before = page_of(out)
    write_report(out)
    assert names == []
    assert page_of(out) == before


def _run(out: Path) -> None:
    file = out / "runs" / "notched" / "standard" / "mpm" / "history.csv"
    file.write_text(file.read_text(encoding="utf-8").replace("0.0001", "0.00011", 1), encoding="utf-8")


def _curve(out: Path) -> None:
    file = next((out / "curves").rglob("*.csv"))
    file.write_text(file.read_text(encoding="utf-8").replace("0", "1", 1), encoding="utf-8")


def _case(out: Path) -> None:
    file = out / "cases" / "notched" / "case.toml"
    file.write_text(file.read_text(encoding="utf-8").replace("h = 0.025", "h = 0.02"), encoding="utf-8")


def _summary(out: Path) -> None:
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    summary["cases"][0]["title"] = "Another"
    (out / "summary.json").write_text(json.dumps(summary), encoding="utf-8")


def _figure(out: Path) -> None:
    next((out / "figures").rglob("scene.svg")).write_text("<svg/>", encoding="utf-8")


def _lost_figure(out: Path) -> None:
    next((out / "figures").rglob("load-displacement.csv")).unlink()


def _kept(out: Path) -> None:
    file = next((out / "figures").rglob(kept.KEPT_FILE))
    file.write_text(file.read_text(encoding="utf-8")[:-9], encoding="utf-8")


@pytest.mark.parametrize("change", [_run, _curve, _case, _summary, _figure, _lost_figure, _kept])
def test_whatever_a_figure_comes_from_has_it_drawn_again(
    drawn: tuple[Path, list[str]], change: Callable[[Path], None]
) -> None:
    out, names = drawn
    change(out)
    write_report(out)
    assert "scene" in names


def test_other_code_draws_again(drawn: tuple[Path, list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    out, names = drawn
    monkeypatch.setattr(kept, "_code", lambda: ["another"])
    write_report(out)
    assert "scene" in names


def test_what_could_not_be_drawn_is_tried_again(
    drawn: tuple[Path, list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any) -> None:
        raise ValueError("not today")

    out, names = drawn
    monkeypatch.setattr("reports.report.SECTIONS", (("Forces", fails),))
    for _ in range(2):
        names.clear()
        write_report(out)
        assert names == ["scene"] and "not today" in page_of(out)


def _figure_of_many_kinds() -> Any:
    figure, axes = style.panels(2, 2, 7.0, 6.0, grid=True, sharey="row")
    x = np.linspace(0.1, 1234.5, 50)
    axes[0, 0].plot(x, 1e-7 * x**2, label="square, $u_x$")
    axes[0, 1].loglog(x, 1e-7 * x**2, "o-", label="again")
    axes[0, 0].legend(loc="best")
    axes[1, 0].set(xlabel="a label", ylabel="of\ntwo lines", title="title")
    axes[1, 0].text(0.5, 1.2, "outside", rotation=30)
    image = axes[1, 1].imshow(np.arange(12.0).reshape(3, 4), **style.IMAGE)
    figure.colorbar(image, ax=axes[1, 1], label="colours")
    style.legend_below(figure, axes.flat)
    return figure


def test_a_figure_laid_out_once_is_that_of_matplotlib(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with style.drawing_style():
        style.save(_figure_of_many_kinds(), tmp_path, "remembered")
        monkeypatch.setattr(style, "remembered_layout", nullcontext)
        style.save(_figure_of_many_kinds(), tmp_path, "forgotten")
        file = io.StringIO()
        metadata: Any = {"Date": None, "Creator": None}
        _figure_of_many_kinds().savefig(file, format="svg", bbox_inches="tight", dpi=style.RASTER_DPI, metadata=metadata)
    texts = [(tmp_path / f"{name}.svg").read_text(encoding="utf-8") for name in ("remembered", "forgotten")]
    assert texts[0] == texts[1]
    numbers = [np.array(re.findall(r"[ML] (\S+) (\S+)", text), float) for text in (texts[0], file.getvalue())]
    np.testing.assert_allclose(*numbers, atol=1e-4)


def test_pictures_drawn_in_parts_are_whole_ones(tmp_path: Path) -> None:
    with style.drawing_style():
        figure, axes = style.panels(1, 1, 3.0, 2.5)
        image = axes[0, 0].imshow(np.zeros((30, 40)), clim=(0, 1), **style.IMAGE)
        title = figure.suptitle("t = 0")
        pictures = style.Pictures(figure, [image, *axes[0, 0].spines.values(), title], 100)
        pictures.save(tmp_path, "first")
        image.set_data(np.random.default_rng(1).random((30, 40)))
        title.set_text("t = 1")
        parts = matplotlib.image.imread(tmp_path / pictures.save(tmp_path, "second"))
        for artist in (image, *axes[0, 0].spines.values(), title):
            artist.set_animated(False)
        figure.set_layout_engine("none")  # where the first picture has put everything
        figure.savefig(tmp_path / "whole.png", dpi=100)
    whole = matplotlib.image.imread(tmp_path / "whole.png")[..., :3]
    assert np.abs(parts - whole).max() < 0.02
    assert np.abs(parts - matplotlib.image.imread(tmp_path / "first.png")).max() > 0.5


def test_the_nearest_points_are_those_of_a_search() -> None:
    places = np.random.default_rng(2).random((400, 2)) * [2.0, 1.0]
    lower, pixel, shape, reach = np.array([-0.1, -0.2]), np.array([0.021, 0.019]), (110, 70), 0.05
    found = nearest_to_pixels(places, lower, pixel, shape, reach)
    centres = np.stack(np.meshgrid(*(lower[d] + (np.arange(shape[d]) + 0.5) * pixel[d] for d in (0, 1))), axis=-1)
    distance, nearest = cKDTree(places).query(centres, distance_upper_bound=reach)
    np.testing.assert_array_equal(found, np.where(np.isfinite(distance), nearest, -1))
    assert 0.1 < (found < 0).mean() < 0.9


def test_a_case_is_read_once_where_none_changes(tmp_path: Path) -> None:
    assert load_case("sen_tension") is not load_case("sen_tension")
    with reading_once():
        case = load_case("sen_tension")
        assert load_case("sen_tension") is case
        assert load_case("sen_tension", "quick") is not case
        coarse, fine = ({"load": {"increment": u}} for u in (4e-4, 1e-4))
        varied = load_case("sen_tension", "quick", "fem", coarse)
        assert load_case("sen_tension", "quick", "fem", dict(coarse)) is varied
        assert load_case("sen_tension", "quick", "fem", fine) is not varied
    assert load_case("sen_tension") is not case
