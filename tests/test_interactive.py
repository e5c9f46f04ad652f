"""Curves that answer to mouse and keyboard, in a browser without a screen."""

import html
import json
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_reports import BROWSER, FLAGS

from reports import interactive, style
from reports.report import _environment

PAGE = """{% extends "base.html" %}{% from "macros.html" import figure %}{% block body %}
{{ figure(drawing, "figures") }}<script>{% include "curves.js" %}</script>{% endblock %}"""
PROBE = """<script>addEventListener("load", function () {
  var told = {}, chart = document.querySelector(".chart"), svg = chart.querySelector("svg");
  var buttons = chart.querySelectorAll("button"), said = () => chart.querySelector("output").textContent;
  var press = (key) => svg.dispatchEvent(new KeyboardEvent("keydown", { key: key }));
  var ticks = () => Array.from(svg.querySelectorAll(".grid text"), (t) => t.textContent).join(" ");
  told.picture = getComputedStyle(document.querySelector("img")).display;
  told.lines = svg.querySelectorAll("polyline").length; told.first = said();
  press("ArrowRight"); told.next = said();
  press("ArrowDown"); told.other = said();
  told.ticks = ticks(); press("+"); told.zoomed = ticks(); press("0"); told.whole = ticks();
  buttons[1].click(); told.off = svg.querySelectorAll("polyline").length;
  told.pressed = buttons[1].getAttribute("aria-pressed");
  var r = svg.getBoundingClientRect();
  svg.dispatchEvent(new PointerEvent("pointermove", { clientX: r.right - 20, clientY: r.top + 20 }));
  told.hovered = said();
  told.milliseconds = performance.now();
  document.body.dataset.told = JSON.stringify(told);
});</script>"""


def twelve_runs() -> style.Drawing:
    """A drawing of twelve runs of ten thousand increments and a published curve."""
    u = np.linspace(0.0, 1.0, 10_000)
    published = interactive.points("published: a paper", [0.0, 0.5, 1.0], [0.0, 1.0, 0.0])
    runs = [interactive.line(f"run {i}", "#0072b2", "--", u, i + u * (1.0 - u)) for i in range(12)]
    curves = interactive.Curves("Load and displacement", "u [mm]", "F [kN]", [published, *runs])
    return style.Drawing("load-displacement", "Load", "Twelve runs.", "a.svg", curves=curves)


def test_long_curves_keep_their_ends_and_their_peak() -> None:
    u = np.linspace(0.0, 1.0, 10_000)
    F = np.where(u == u[1234], 9.0, u)
    thinned = interactive.line("a", "#000000", ":", u, F)
    assert len(thinned.x) <= interactive.MOST_POINTS and thinned.dash == "2 3"
    assert (thinned.x[0], thinned.x[-1], max(thinned.y)) == (0.0, 1.0, 9.0)


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on PATH: the curves are not tried")
def test_curves_answer_to_keys_buttons_and_the_pointer(tmp_path: Path) -> None:
    page = _environment().from_string(PAGE).render(drawing=twelve_runs())
    assert len(page) < 1_000_000
    told = shown(page, tmp_path)
    assert (told["picture"], told["lines"]) == ("none", 12), "the picture is for print"
    assert told["first"].startswith("run 0: u [mm] 0.5, F [kN] 0.25") or told["first"].startswith("run 0: u [mm] 0.49")
    assert told["next"].startswith("run 0: ") and told["next"] != told["first"]
    assert told["other"].startswith("run 1: ")
    assert told["zoomed"] != told["ticks"] == told["whole"]
    assert (told["off"], told["pressed"]) == (11, "false")
    assert told["hovered"].startswith("run 11: ")
    assert told["milliseconds"] < 2000


def shown(page: str, folder: Path) -> dict[str, Any]:
    """What the probe found in a browser."""
    file = folder / "page.html"
    file.write_text(page.replace("</body>", f"{PROBE}</body>"), encoding="utf-8")
    asked = [str(BROWSER), *FLAGS, f"--user-data-dir={folder / 'profile'}", "--window-size=1300,900", file.as_uri()]
    dom = subprocess.run(asked, capture_output=True, text=True, timeout=120, check=True).stdout
    return json.loads(html.unescape(re.findall(r'data-told="([^"]*)"', dom)[0]))


def test_cases_whose_names_differ_in_letters_have_pages_of_their_own() -> None:
    names = {style.page_name(case, "quick") for case in ("Träger ä", "Träger ö", "a b", "a-b")}
    assert len(names) == 4 and all(name.isascii() for name in names)
    assert style.page_name("sen_shear", "quick") == "sen_shear-quick" and style.page_name("sen_shear", "") == "sen_shear"
