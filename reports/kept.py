"""Figures kept from an earlier report: where case, runs and code of a page are what they were, nothing is drawn again."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cases.solvers import SOLVERS
from verify.runs.atomic import write_text
from verify.runs.run_folder import file_checksum

from .interactive import Curves, Line
from .style import Drawing, Film

if TYPE_CHECKING:
    from .results import CaseResults

#: what a page's figures were drawn from, how they are shown, and checksums of their files; lies among them
KEPT_FILE = "drawn.json"
CODE = ("cases", "physics", "numerics", "fem_reference", "mpm", "rigid_block", "verify", "reports")
LIBRARIES = ("matplotlib", "numpy", "pandas", "pillow", "pyvista", "scipy", "shapely", "vtk")
#: signs of a text that may still name a file
LONGEST_NAME = 200
Groups = list[list[Drawing | Film]]


def key_of_case(results: CaseResults, sections: Iterable[str]) -> str:
    """Hexadecimal digest of all that the figures of a case's page come from; empty where that cannot be told."""
    if results.case is None:
        return ""
    told = (results.entry, list(sections), results.case.model_dump(mode="json"), results.case.hash())
    try:
        return key_of(told, _files_of(results))
    except OSError:
        return ""


def key_of(told: Any, files: Iterable[Path] = ()) -> str:
    """Hexadecimal digest of what is told, of files with their names and content, and of the code that draws."""
    digest = hashlib.sha256(json.dumps([told, _code()], sort_keys=True, default=str).encode())
    for file in files:
        digest.update(f"{file}\0{file_checksum(file)}\0".encode())
    return digest.hexdigest()


def _files_of(results: CaseResults) -> Iterator[Path]:
    """Files of the case, of its studies, curves and runs; checkpoints are not drawn."""
    assert results.case is not None
    yield results.case.source
    yield from _files_named(results.case.model_dump(), results.case.folder)
    kept, kinds = results.case.kept_folder, ("charts", "maps")
    folders = [kept / kind for kind in kinds] + [results.out / kind / results.case.name for kind in kinds]
    folders += [results.out / run.location for run in results.runs.values() if run.location]
    for folder in folders:
        yield from sorted(f for f in folder.rglob("*") if f.is_file() and f.name != "checkpoint.npz")
    curves = [results.out / curve["file"] for curve in results.entry.get("curves") or [] if curve.get("file")]
    yield from (curve for curve in curves if curve.is_file())


def _files_named(value: Any, folder: Path) -> Iterator[Path]:
    """Files that a case names anywhere, in changes of its runs and tiers too."""
    if isinstance(value, dict | list | tuple):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _files_named(inner, folder)
    elif isinstance(value, Path) or (isinstance(value, str) and "." in value and len(value) < LONGEST_NAME):
        with suppress(ValueError):  # a null in it
            yield from (file for file in (folder / value,) if file.is_file())


@functools.cache
def _code() -> list[str]:
    """Digest of the project's code, versions of what it draws with, and the solvers with their names and lines."""
    root, digest = Path(__file__).parents[1], hashlib.sha256()
    for file in sorted(file for package in CODE for file in (root / package).rglob("*.py")):
        digest.update(f"{file.relative_to(root)}\0".encode() + file.read_bytes())
    return [digest.hexdigest(), *map(_version, LIBRARIES), *map(repr, SOLVERS.values())]


def _version(library: str) -> str:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return ""


def read(folder: Path, key: str) -> Groups | None:
    """The figures of a folder, in groups, if they come from what has this key and lie there as they were written."""
    try:
        kept = json.loads((folder / KEPT_FILE).read_text(encoding="utf-8"))
        if not key or kept["key"] != key or kept["files"] != _checksums(folder):
            return None
        return [[_shown(each) for each in group] for group in kept["groups"]]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def write(folder: Path, key: str, groups: Sequence[Sequence[Drawing | Film]]) -> None:
    """Keep the figures that lie in a folder under a key, none without one."""
    if key and folder.is_dir():
        kept = {"key": key, "groups": [[asdict(each) for each in group] for group in groups], "files": _checksums(folder)}
        write_text(folder / KEPT_FILE, json.dumps(kept))


def _checksums(folder: Path) -> dict[str, str]:
    return {file.name: file_checksum(file) for file in sorted(folder.iterdir()) if file.name != KEPT_FILE}


def _shown(told: dict[str, Any]) -> Drawing | Film:
    if "times" in told:
        return Film(**told)
    if told["curves"]:
        lines = [Line(**line) for line in told["curves"]["lines"]]
        told = told | {"curves": Curves(**told["curves"] | {"lines": lines})}
    return Drawing(**told)
