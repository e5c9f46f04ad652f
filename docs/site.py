"""Pages of the documentation site, made from the README, the cases' pages, the schema and the docstrings.

    python docs/site.py build/docs

writes Markdown and a ``mkdocs.yml`` into the folder; `make docs` does it and builds the site.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import re
import sys
from pathlib import Path
from typing import Any

import physics.splits
import verify.health
from cases import list_cases, load_case
from cases.json_schema import case_schema
from reports.pages import fill_page
from verify.health import INDICATORS
from verify.metrics import registry
from verify.metrics.metric import REGISTERED

REPOSITORY = Path(__file__).parents[1]
_LINK = re.compile(r"(?<!!)\[[^\]]*\]\(([^)\s#]+)(?:#[^)]*)?\)")


def pages() -> dict[str, str]:
    """File -> Markdown of each page; what the README says is said by its own sections and nowhere else."""
    made = _readme() | {
        "contributing.md": (REPOSITORY / "CONTRIBUTING.md").read_text(encoding="utf-8"),
        "public_results.md": (REPOSITORY / "examples/public_results/README.md").read_text(encoding="utf-8"),
        "case_file.md": _case_file(), "metrics.md": _metrics(), "health_record.md": _health_record(),
        "splits.md": _splits(), "cases/index.md": _cases(),
    }  # fmt: skip
    for name in list_cases():
        text = fill_page(load_case(name))
        if text:
            made[f"cases/{name}.md"] = text
    return made


def _readme() -> dict[str, str]:
    """The README's sections as pages, its head as the first one."""
    text = re.sub(r"<!--.*?-->", "", (REPOSITORY / "README.md").read_text(encoding="utf-8"))
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)\n", "", text)
    head, *sections = re.split(r"^## ", text, flags=re.MULTILINE)
    made = {"index.md": head}
    for section in sections:
        title, _, rest = section.partition("\n")
        made[re.sub(r"\W+", "_", title.lower()).strip("_") + ".md"] = f"# {title}\n{rest}"
    return made


def _cases() -> str:
    rows = [(name, load_case(name)) for name in list_cases()]
    lines = [f"- [{case.title}]({name}.md)" if _has_page(case) else f"- {case.title}" for name, case in rows]
    return "# The cases\n\n" + "\n".join(lines) + "\n"


def _has_page(case: Any) -> bool:
    return (case.folder / "README.md").is_file()


def _metrics() -> str:
    """Each metric: what, unit, and what its docstring adds."""
    importlib.import_module(registry.__name__)
    lines = ["# Metrics", "", "| metric | unit | what | how |", "|---|---|---|---|"]
    for name, found in sorted(REGISTERED.items()):
        told = " ".join((inspect.getdoc(found.function) or "").split()).replace("|", "\\|")
        lines.append(f"| `{name}` | {found.unit} | {found.meaning} | {told if told != found.meaning else ''} |")
    return "\n".join(lines) + "\n"


def _health_record() -> str:
    """Each indicator of the health record: what it is, up to where a run is sound and why, and what to do beyond."""
    head = ["| indicator | what | limit | why there | what to do beyond |", "|---|---|---|---|---|"]
    lines = ["# Health record", "", inspect.getdoc(verify.health) or "", "", *head]
    for name, of in INDICATORS.items():
        lines.append(f"| `{name}` | {of.meaning} | {of.limit:g} | {of.why} | {of.remedy} |")
    return "\n".join(lines) + "\n"


def _splits() -> str:
    """Each split of the elastic energy in the words of its module."""
    parts = ["# Splits of the elastic energy", inspect.getdoc(physics.splits) or ""]
    for file in sorted(Path(physics.splits.__path__[0]).glob("[a-z]*.py")):
        # read and not imported: they are compiled, which the plain installation is not for
        parts += [f"## {file.stem}", ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""]
    return "\n\n".join(parts) + "\n"


def _case_file() -> str:
    """The tables of a case file and their keys, from the schema."""
    schema = case_schema()
    parts = ["# The case file"]
    for name, table in [("the whole file", schema), *sorted(schema["$defs"].items())]:
        keys = ", ".join(f"`{key}`" for key in table.get("properties", {}))
        if keys:
            parts += [f"## {name}", f"```text\n{table.get('description', '').strip()}\n```", f"Keys: {keys}"]
    return "\n\n".join(parts) + "\n"


def dead_links(made: dict[str, str]) -> list[str]:
    """Links of pages to files that are neither pages nor in the repository."""
    dead = []
    for file, text in made.items():
        for link in _LINK.findall(text):
            target = (Path(file).parent / link).as_posix()
            known = target in made or (REPOSITORY / target).exists()
            if "://" not in link and not known:
                dead.append(f"{file}: {link}")
    return dead


def write(folder: Path) -> None:
    """Write the pages and the site's settings."""
    made = pages()
    for file, text in made.items():
        path = folder / "pages" / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    settings = {
        "site_name": "fracture-verify", "docs_dir": "pages", "site_dir": "site",
        "theme": {"name": "material", "font": False}, "plugins": ["search"],
    }  # fmt: skip
    # JSON is YAML
    (folder / "mkdocs.yml").write_text(json.dumps(settings, indent=2), encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
