"""The HTML report: a view of ``summary.json`` and the run folders. Nothing is computed or judged here."""

from __future__ import annotations

import functools
import logging
import re
import shutil
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markdown_it import MarkdownIt
from markupsafe import Markup, escape

from cases import UserError
from cases.loader import reading_once
from verify.judging import coverage
from verify.runs.atomic import NO_ROOM, write_text
from verify.runs.processes import fresh_processes

from . import (  # isort: skip
    arch, charts, curves, fields, film, kept, maps, motion, orientations, overview, rocking, rocking_diagram, scene,
    style, surface, sweeps, tables, words,
)  # fmt: skip
from .pages import fill_page
from .results import READING_ERRORS, CaseResults, method_of, read_summary

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import pandas as pd

    from cases import Case

logger = logging.getLogger(__name__)

# Sections of a case's page in reading order, with what draws them.
SECTIONS: tuple[tuple[str, Callable[[CaseResults, Path], Any]], ...] = (
    ("Surface energy", surface.surface_energy),
    ("Load and displacement", curves.load_displacement),
    ("Relative error", curves.relative_errors),
    ("Energies", curves.energies),
    ("Phase field", fields.phase_field),
    ("Crack paths", fields.crack_paths),
    ("Distorted mesh and material points", fields.distortion),
    ("Element quality", fields.element_quality),
    ("Hydrostatic stress", fields.hydrostatic_stress),
    ("Convergence", curves.convergence),
    ("Critical values", sweeps.critical_values),
    ("Values over what was swept", sweeps.values_over_sweep),
    ("Critical load over orientation", orientations.critical_load),
    ("Accuracy against cost", charts.accuracy_against_cost),
    ("Where it fails", maps.where_it_fails),
)
# The same for a case whose bodies move.
MOVING_SECTIONS: tuple[tuple[str, Callable[[CaseResults, Path], Any]], ...] = (
    ("Surface energy", surface.surface_energy),
    ("Motion", film.film),
    ("Angle", rocking.angles),
    ("Failure and safety", rocking_diagram.diagram),
    ("Hinges", arch.hinges),
    ("Ground", rocking.ground),
    ("Energies", motion.energies),
    ("Crack tips", motion.tip_speed),
    ("Phase field", film.phase_field),
    ("Momentum", motion.momentum),
    ("Convergence", curves.convergence),
    ("Critical values", sweeps.critical_values),
    ("Values over what was swept", sweeps.values_over_sweep),
    ("Accuracy against cost", charts.accuracy_against_cost),
    ("Where it fails", maps.where_it_fails),
)


# Sections whose first figure is the main curve of a page; the first of them that is drawn stands on top.
MAIN_CURVES = (
    "Convergence", "Critical values", "Values over what was swept", "Critical load over orientation",
    "Load and displacement", "Crack tips", "Angle", "Energies",
)  # fmt: skip


@dataclass
class Section:
    """A heading with its figures, or the reason why there is none."""

    title: str
    drawings: list[style.Drawing | style.Film] = field(default_factory=list)
    problem: str = ""

    @property
    def anchor(self) -> str:
        """The section's identifier on its page."""
        return style.slug(self.title.lower())


def write_report(out: Path, jobs: int = 1) -> Path:
    """Write ``out/index.html`` and one page per case from ``out/summary.json``; return the overview's path.

    Figures go to ``out/figures/<case>-<tier>/`` as SVG with the CSV behind each curve. Nothing is loaded from
    elsewhere, so that the folder can be moved and read offline. ``jobs`` pages are made at the same time.

    Raises FileNotFoundError when there is no summary yet.
    """
    out = Path(out)
    summary = read_summary(out)
    page = functools.partial(_page_of, summary=summary, out=out)
    if jobs == 1:
        pages = list(map(page, summary["cases"]))
    else:
        processes = fresh_processes("reports.report", "verify.runs.vtk_files")
        with ProcessPoolExecutor(jobs, mp_context=processes) as pool:
            started = {id(entry): pool.submit(page, entry) for entry in _longest_first(summary["cases"], out)}
            pages = [started[id(entry)].result() for entry in summary["cases"]]
    file = out / "index.html"
    with reading_once():
        printed, studies = _write_printed(summary, out), _write_studies(summary, out, pages)
    index = _environment().get_template("index.html").render(
        summary=summary, pages=pages, environment=_computed_with(pages), printed=printed, studies=studies,
        sentence=words.overview_sentence(summary["cases"]), root="",
    )  # fmt: skip
    write_text(file, index)
    return file


def _longest_first(entries: Sequence[Mapping[str, Any]], out: Path) -> list[Mapping[str, Any]]:
    """Those with most states and frames before the others, so that no process is left alone with a long one."""

    def files(entry: Mapping[str, Any]) -> int:
        folders = [out / run["folder"] for run in (entry.get("runs") or {}).values() if run.get("folder")]
        return sum(1 for folder in folders for _ in folder.rglob("*"))

    return sorted(entries, key=files, reverse=True)


def _write_printed(summary: Mapping[str, Any], out: Path) -> str:
    """Write the page of printed numbers beside ours and return its sentence; empty where no case has any."""
    cases = [CaseResults(entry, out).case for entry in summary["cases"]]
    rows = coverage.coverage([case for case in cases if case], out, summary)
    if not rows:
        return ""
    sentence = coverage.coverage_sentence(rows)
    page = _environment().get_template("printed.html").render(rows=rows, sentence=sentence, root="")
    write_text(out / "printed.html", page)
    return sentence


def _write_studies(summary: Mapping[str, Any], out: Path, pages: Sequence[Mapping[str, Any]]) -> str:
    """Write the page of all charts and maps and return its sentence; empty where there are none.

    A report of one case has that case's on its own page and none of the others.
    """
    if len(pages) == 1:
        return ""
    shown = overview.contents(summary, out)
    counts = [(len(shown["costs"]), "case"), (len(shown["borders"]), "map")]
    if not any(count for count, _ in counts) and not shown["problem"]:
        return ""
    charted, mapped = (words.plural(count, noun) for count, noun in counts)
    sentence = f"Error over seconds of {charted}; the borders of {mapped} of failure, beside theory's where there is one."
    page = _environment().get_template("studies.html").render(
        **shown, sentence=sentence, pages={page["name"]: page["page"] for page in pages}, root=""
    )
    write_text(out / "studies.html", page)
    return sentence


def _environment() -> Environment:
    """Templates with escaping on; a variable that is not there is an error and not a gap."""
    environment = Environment(
        loader=PackageLoader("reports"), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters.update(
        number=words.number, percent=words.percent, section=words.section_words, subscripts=_subscripts,
        method=lambda solver: method_of(solver).title, numbers=lambda values: list(map(words.number, values)),
        verdict=lambda verdict: words.VERDICT_WORDS.get(verdict, verdict),
    )  # fmt: skip
    return environment


def _subscripts(text: str) -> Markup:
    """Set ``u_x`` or ``v_y`` with subscripts."""
    return Markup(re.sub(r"\b([uv])_([xy])\b", r"\1<sub>\2</sub>", str(escape(text))))


# ---------------------------------------------------------------- a case's page


def _page_of(entry: Mapping[str, Any], summary: Mapping[str, Any], out: Path) -> dict[str, Any]:
    with reading_once():
        return _write_case_page(CaseResults(entry, out), summary, out)


def _write_case_page(results: CaseResults, summary: Mapping[str, Any], out: Path) -> dict[str, Any]:
    """Write the page of one case and return its row of the overview."""
    name = style.page_name(results.name, results.tier)
    figures = out / "figures" / name
    picture, *sections = _drawn_sections(results, figures)
    main_curve = _main_curve(sections)
    page = _environment().get_template("case.html").render(
        results=results, entry=results.entry, summary=summary, case=results.case, root="../",
        figures=f"../figures/{name}", picture=picture, main_curve=main_curve,
        sections=[section for section in sections if section.drawings or section.problem],
        sentence=words.verdict_sentence(results.entry),
        runs_sentence=words.runs_sentence(list(results.runs.values())),
        boundaries=scene.boundary_rows(results.case) if results.case else [],
        checks=tables.check_groups(results), cost=tables.cost_table(results),
        health=tables.health_table(results),
        cost_sentence=tables.cost_sentence(results), prices=tables.price_rows(results),
        runs=tables.run_rows(results), notices=_notices(results), readme=readme_html(results),
    )  # fmt: skip
    file = out / "pages" / f"{name}.html"
    write_text(file, page)
    return _overview_row(results, f"pages/{name}.html")


def _drawn_sections(results: CaseResults, figures: Path) -> list[Section]:
    """The scene and the sections of a case's page, drawn only if anything has changed since they were drawn last."""
    todo = [("Scene", scene.scene), *_sections_of(results)]
    titles = [title for title, _ in todo]
    key = kept.key_of_case(results, titles)
    if (groups := kept.read(figures, key)) is not None:
        return [Section(title, group) for title, group in zip(titles, groups, strict=True)]
    shutil.rmtree(figures, ignore_errors=True)  # figures of an earlier report must not survive
    with style.drawing_style():
        sections = [_section(title, draw, results, figures) for title, draw in todo]
    if not any(section.problem for section in sections):
        kept.write(figures, key, [section.drawings for section in sections])
    return sections


def _sections_of(results: CaseResults) -> tuple[tuple[str, Callable[[CaseResults, Path], Any]], ...]:
    return MOVING_SECTIONS if results.case is not None and results.case.dynamics else SECTIONS


def _section(
    title: str, draw: Callable[[CaseResults, Path], Any], results: CaseResults, folder: Path
) -> Section:
    """Draw one section; what cannot be drawn becomes a sentence on the page and a warning in the log.

    A disk that takes no more ends the report.
    """
    try:
        drawn = draw(results, folder)
    except READING_ERRORS as problem:
        if isinstance(problem, OSError) and problem.errno in NO_ROOM:
            raise
        logger.warning("%s: %s could not be drawn: %s", results.name, title.lower(), problem)
        return Section(title, problem=f"{type(problem).__name__}: {str(problem).replace(f'{results.out}/', '')}")
    drawings = drawn if isinstance(drawn, list) else [drawn]
    return Section(title, [drawing for drawing in drawings if drawing is not None])


def _main_curve(sections: list[Section]) -> style.Drawing | style.Film | None:
    """Take the main curve out of its section; None where none is drawn."""
    drawn = {section.title: section for section in sections if section.drawings}
    title = next((title for title in MAIN_CURVES if title in drawn), None)
    return drawn[title].drawings.pop(0) if title else None


def _notices(results: CaseResults) -> list[str]:
    """Return what is missing from the page and why."""
    absent: dict[str, list[str]] = {}
    for run in results.runs.values():
        if not run.exists:
            absent.setdefault(run.entry.get("reason") or run.problem or run.status, []).append(run.name)
    suspect = {name: run.entry.get("suspicions") or [] for name, run in results.runs.items()}
    said = [f"Not shown: {words.listed(names)}. Reason: {why}" for why, names in absent.items()]
    said += [f"Suspect: in {name} the {told}" for name, each in suspect.items() for told in each]
    said += results.case.mesh_remarks if results.case else []
    said += dict.fromkeys([*(results.entry.get("remarks") or []), *(_remarks_of(results))])
    said += [f"Curves not compared: {problem}" for problem in results.entry.get("curve_problems") or []]
    if results.case is None:
        said.append(f"The case description could not be read: {results.case_problem}")
    return said


def _remarks_of(results: CaseResults) -> list[str]:
    """Return what runs say of the fields that they came with."""
    return [told for run in results.runs.values() for told in (run.record or {}).get("remarks", [])]


def readme_html(results: CaseResults) -> Markup:
    """Return the case's filled page as HTML below a heading of the report, with markup inside it shown as text."""
    try:
        text = fill_page(results.case) if results.case else ""
    except UserError as problem:
        return Markup("<p class='notice'>{}</p>").format(str(problem))
    text = re.sub(r"^# .*\n+", "", text)  # the report has the case's title already
    text = re.sub(r"^(#+) ", r"#\1 ", text, flags=re.MULTILINE)
    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")
    markdown.add_render_rule("image", _image_as_link)
    return Markup(markdown.render(text))


def _image_as_link(_: Any, tokens: Sequence[Any], index: int, *__: Any) -> str:
    """Set a picture of a page as a link: a report loads nothing from elsewhere, and a page's own files stay behind."""
    image = tokens[index]
    place = str(image.attrs.get("src", ""))
    words = escape(image.content or place)
    return Markup('<a href="{}">{}</a>').format(place, words) if "//" in place else words


# ---------------------------------------------------------------- the overview


def _overview_row(results: CaseResults, page: str) -> dict[str, Any]:
    worst = words.worst_check(results.checks)
    seconds = [(run.entry.get("seconds") or {}).get("total") for run in results.runs.values()]
    gated = [check for check in results.checks if check.get("gate", True)]
    return {
        "name": results.name,
        "title": results.entry.get("title") or results.name,
        "section": results.entry.get("section") or "",
        "tier": results.tier,
        "verdict": results.verdict,
        "page": page,
        "passed": sum(check.get("verdict") == "PASS" for check in gated),
        "gated": len(gated),
        "key_number": words.key_number(results.checks),
        "margin": worst["margin_used"] if worst else None,
        "worst": words.check_in_words(worst) if worst else "",
        "seconds": sum(second for second in seconds if second),
        "records": [run.record for run in results.runs.values() if run.record],
    }


def _computed_with(pages: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Return versions and processors of all runs; several values where runs differ."""
    found: dict[str, dict[str, None]] = {}
    for record in (record for page in pages for record in page["records"]):
        facts = {"code": record.get("code_version"), "processor": record.get("processor")}
        facts |= {"threads": record.get("threads"), **(record.get("versions") or {})}
        for name, value in facts.items():
            if value is not None:
                found.setdefault(name, {})[str(value)] = None
    return [(name, ", ".join(values)) for name, values in found.items()]


# ---------------------------------------------------------------- before anything is solved


def write_surface(case: Case, out: Path) -> pd.DataFrame:
    """Draw the surface energy of a case's materials into ``out/surface/<case>``; return its extremes."""
    folder = Path(out) / "surface" / style.slug(case.name)
    table = surface.extremes(surface.surfaces(case, surface.SIZE))
    with style.drawing_style():
        surface.draw(case, folder)
    style.save_data(table, folder, "extremes")
    return table
