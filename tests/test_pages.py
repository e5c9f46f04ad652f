"""Pages: every measured number on them comes from a record, a typed one is found, and they read without results."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cases import list_cases, load_case
from cases.loader import LIBRARY
from reports.pages import PageError, Quantity, fill_marked, fill_page, read_measured, write_marked
from reports.report import readme_html

ROOT = Path(__file__).parents[1]
PARTS = ["What it shows", "What was chosen and why", "What comes out", "What is open"]
NUMBER = r"[+-]?\d+(?:[.,]\d+)*(?:e[+-]?\d+)?"
SECTION = r"[A-Z]?\d+(?:\.\d+)*[a-z]?(?:\([a-z]\))?"
# What may hold digits and is no number of a result.
ELSEWHERE = (
    r"\{\{.*?\}\}|\{%.*?%\}",  # placeholders
    r"```.*?```",
    r"\]\([^)]*\)",  # links
    rf"(?:Eqs?\.|Figs?\.|Tables?|[Ss]ections?|[Tt]hesis|Algorithm)\s+{SECTION}(?:(?:,|\s+and|\s+to|\s+or)\s+{SECTION})*",
    r"(?:[a-z.]\s+|\()(?:19|20)\d\d(?=[),.;:])",  # years of publications
)
# Words of the configuration of a case and of published statements; no result of ours among them.
PROSE = ("title", "section", "requirement", "reason")


def without_places(page: str) -> str:
    """The page without what may hold digits; a number in backticks stays, it is no code."""
    for pattern in ELSEWHERE:
        page = re.sub(pattern, " ", page, flags=re.DOTALL)
    return re.sub(rf"`(?!{NUMBER}(?:\s*[%°µ\w/]+)?`)[^`]*`", " ", page)


def numbers_of(entry: Any) -> Iterator[float]:
    """All numbers of a parsed case file, those in its texts included, but not those of its prose."""
    if isinstance(entry, dict):
        for key, value in entry.items():
            yield from () if key in PROSE else numbers_of(value)
    elif isinstance(entry, list):
        for value in entry:
            yield from numbers_of(value)
    elif isinstance(entry, str):
        yield from (float(text) for text in re.findall(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?", entry))
    elif not isinstance(entry, bool) and isinstance(entry, (int, float)):
        yield abs(float(entry))


def typed_numbers(page: str, name: str) -> list[str]:
    """Numbers on a page that stand neither in its case file nor in one of its references."""
    tables = tomllib.loads((LIBRARY / name / "case.toml").read_text("utf-8"))
    known = {0.0, *numbers_of(tables)}
    scale = {"%": 1e-2} | ({"mm": 1e-3} if tables["units"]["length"] == "m" else {})
    typed = []
    for found in re.finditer(rf"(?<![\w.])({NUMBER})(?:\s*(%|mm\b))?", without_places(page)):
        value = abs(float(found[1].replace(",", ""))) * scale.get(found[2], 1.0)
        if not any(abs(value - number) <= 1e-12 * number for number in known):
            typed.append(found[0])
    return typed


def page_of(name: str) -> str:
    return (LIBRARY / name / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", list_cases())
def test_a_page_has_no_typed_result_and_its_four_parts(name):
    page = page_of(name)
    assert typed_numbers(page, name) == []
    assert re.findall(r"^## (.*)$", page, flags=re.MULTILINE) == PARTS
    assert len(re.findall(r"^# .", page, flags=re.MULTILINE)) == 1 and page.startswith("# ")


@pytest.mark.parametrize("name", list_cases())
def test_a_page_reads_without_results_and_needs_all_its_measurements(name):
    case = load_case(name, tier="quick")
    filled = fill_page(case)
    assert filled and "{{" not in filled and "{%" not in filled
    used = set(re.findall(r"measured\.([\w.]+)", page_of(name)))
    for key in measured_keys(read_measured(case.folder / "measured.toml")):
        assert key in used, f"{name}: {key} is measured and stands on no page"


def measured_keys(table: dict[str, Any], prefix: str = "") -> Iterator[str]:
    for key, value in table.items():
        if isinstance(value, dict):
            yield from measured_keys(value, f"{prefix}{key}.")
        elif isinstance(value, (Quantity, list)):
            yield prefix + key


@pytest.mark.parametrize(
    "sentence",
    ["The peak is 0.7164 kN.", "It is `0.7164 kN`.", "The two differ by 2.3 %.", "It takes 72 s.", "| 0.7 | 12.34 |"],
)
def test_a_typed_result_is_found(sentence):
    assert typed_numbers(page_of("sen_tension") + sentence, "sen_tension")


def test_facts_of_the_case_and_places_in_books_may_be_typed():
    text = "Cells of 0.004 mm (thesis 4.4.1, Table 4.2 and Eqs. 5.9 and 5.13; Miehe 2010), `h = l0 / 2`, limit 0.1 %."
    assert typed_numbers(text, "sen_tension") == []


def write_page(folder: Path, page: str, measured: str = "") -> Any:
    (folder / "case.toml").write_text((LIBRARY / "bar_profile" / "case.toml").read_text("utf-8"), "utf-8")
    (folder / "README.md").write_text(page, "utf-8")
    (folder / "measured.toml").write_text(measured, "utf-8")
    return load_case(folder / "case.toml")


STUDY = '[study]\nhow = "a run"\ndate = 2026-01-01\n'


def test_numbers_appear_as_recorded_or_as_the_page_asks(tmp_path):
    page = "{% set peak = measured.study.peak %}"
    page += "{{ peak.fem | unit }} {{ peak.fem | digits(2) | unit }} {{ measured.study.error[1] }}"
    page += " {{ (peak.mpm / peak.fem - 1) | percent(2) }} {{ case.quick.mesh.h > 0 }}"
    measured = STUDY + 'peak.fem = "0.620 kN"\npeak.mpm = "0.651 kN"\nerror = ["-7e-8", "+1.50 %"]\n'
    assert fill_page(write_page(tmp_path, page, measured)) == "0.620 kN 0.62 kN +1.50 5.0 % True"


@pytest.mark.parametrize(
    ("page", "measured", "sentence"),
    [
        ("{{ measured.study.pea }}", STUDY + 'peak = "1 kN"\n', "'pea' is none of"),
        ("{{ summary.fem }}", "", "'summary' is undefined"),
        ("{{ case.quick.__class__ }}", "", "'__class__' is none of"),
        ("{{ 'a'.upper() }}", "", "cannot be taken from str"),
        ("{{ range(3) }}", "", "'range' is undefined"),
        ("{{ 1 / 0 }}", "", "division by zero"),
        ("{{ measured", "", "unexpected end"),
        ("", STUDY + "peak = 1.0\n", "is no measurement"),
        ("", STUDY + 'peak = "about 1 kN"\n', "is no measurement"),
        ("", '[study]\npeak = "1 kN"\n', "how and date"),
        ("", "[study\n", "correct this line"),
    ],
)
def test_a_placeholder_without_a_value_is_an_error_in_one_sentence(tmp_path, page, measured, sentence):
    with pytest.raises(PageError, match=re.escape(sentence)):
        fill_page(write_page(tmp_path, page, measured))


def test_the_report_shows_the_parts_of_a_page_below_its_own_heading(tmp_path):
    page = "# Title\n\n## What it shows\n\nA peak of {{ measured.study.peak | unit }} <b>.\n"
    case = write_page(tmp_path, page, STUDY + 'peak = "0.62 kN"\n')
    html = readme_html(SimpleNamespace(case=case))
    assert html == "<h3>What it shows</h3>\n<p>A peak of 0.62 kN &lt;b&gt;.</p>\n"
    (tmp_path / "measured.toml").unlink()
    assert "'study' is none of: nothing" in readme_html(SimpleNamespace(case=case)).unescape()


def test_marked_numbers_are_written_in_place(tmp_path):
    file, record = tmp_path / "page.md", tmp_path / "measured.toml"
    file.write_text("It takes <!--study.time-->1<!--/--> s.\n", "utf-8")
    record.write_text(STUDY + 'time = "2.50 s"\n', "utf-8")
    write_marked(file, record)
    assert file.read_text("utf-8") == "It takes <!--study.time-->2.50<!--/--> s.\n"
    record.write_text(STUDY, "utf-8")
    with pytest.raises(PageError, match=r"study\.time is not measured"):
        write_marked(file, record)


def test_times_and_ratios_of_the_readme_are_those_of_the_record():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert fill_marked(readme, read_measured(ROOT / "docs" / "measured.toml")) == readme, "make readme"
    readme = readme.replace("5 %, 1 % and 0.2 %", "")  # the accuracies that a chart answers for
    elsewhere = re.sub(r"<!--[\w.]+-->.*?<!--/-->|`[^`]*`", " ", re.sub(r"```.*?```", " ", readme, flags=re.DOTALL))
    assert re.findall(r"\d\s*(?:%|times|minutes|seconds|hours|s\b)", elsewhere) == []
