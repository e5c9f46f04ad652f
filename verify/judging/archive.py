"""A case with its finished runs and verdict as one zip file, which another machine reads back to the same verdict.

    cases/<case>/            the case file and all that it refers to
    runs/<case>/<tier>/      run folders; fields where they are asked for, or a check is taken from them
    summary.json, summary.md
    ro-crate-metadata.json   what is in it, made by what, for repositories of research data (RO-Crate 1.1)
"""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from cases import Case, UserError, load_case
from cases.case import CASE_FILE
from cases.copies import write_copy
from cases.judging import TIERS
from verify.judging.judge import find_runs, judge_case
from verify.judging.summary import summarise, write_summary
from verify.judging.views import Json
from verify.runs.atomic import replace_folder, write_file, write_text, writing
from verify.runs.checkpoint import CHECKPOINT_FILE
from verify.runs.provenance import code_version
from verify.runs.run_folder import RunFolder, run_path
from verify.runs.run_writer import write_run

METADATA = "ro-crate-metadata.json"
LARGEST_BYTES = 20 * 10**9
_FORMATS = {".json": "application/json", ".csv": "text/csv", ".toml": "application/toml", ".md": "text/markdown"}


class ArchiveError(UserError):
    """An archive that cannot be made or read; its text is one sentence."""


@dataclass(frozen=True)
class Imported:
    """What an archive gave: the verdict that it was made with, and its cases judged anew, as in summary.json."""

    verdict: str
    summary: Json


# ------------------------------------------------------------------------------------------------ writing


def write_archive(case: Case, out: Path, file: Path, fields: bool = False, licence: str = "") -> list[str]:
    """Write a case with its finished runs into a zip file; returns the runs whose fields are in it.

    fields : of all runs; else of those alone without which a check would end otherwise
    licence : SPDX name of what others may do with it, told in the metadata

    Raises
    ------
    ArchiveError : no run is finished. WriteError : the file cannot be written.
    """
    finished = {name: state.run for name, state in find_runs(case, out).items() if state.run is not None}
    if not finished:
        raise ArchiveError(f"{out / 'runs' / case.name / case.tier}: holds no finished run; do them with `verify run`.")
    with writing(file), tempfile.TemporaryDirectory(dir=_made(file.parent)) as place:
        root = Path(place)
        moved = load_case(write_copy(case, root / "cases"), case.tier)
        for name, run in finished.items():
            _copy_run(run, run_path(root, case.name, case.tier, name), fields)
        needed = list(finished) if fields else _without_which_it_differs(case, moved, out, root)
        for name in [] if fields else needed:
            _copy_run(finished[name], run_path(root, case.name, case.tier, name), True)
        write_summary(summarise([moved], case.tier, root), root)
        (root / METADATA).write_text(json.dumps(_metadata(case, root, licence), indent=2) + "\n", encoding="utf-8")
        write_file(file, lambda path: _zip(root, path))
    return needed


def _copy_run(run: RunFolder, target: Path, fields: bool) -> None:
    if fields:
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(run.folder, target, ignore=shutil.ignore_patterns(CHECKPOINT_FILE))
    else:
        write_run(target, run.history, run.crack_path, run.info)


def _without_which_it_differs(case: Case, moved: Case, out: Path, root: Path) -> list[str]:
    """Runs of the checks that end otherwise where there are no fields."""
    pairs = zip(judge_case(case, out).checks, judge_case(moved, root).checks, strict=True)
    differing = [one.check for one, other in pairs if (one.verdict, one.value) != (other.verdict, other.value)]
    families = {name for check in differing for name in (check.run, check.target[1])}
    specs = case.run_specs().values()
    there = {name for name, state in find_runs(case, out).items() if state.run is not None}
    return [spec.name for spec in specs if {spec.name, spec.family} & families and spec.name in there]


def _zip(root: Path, path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(root.rglob("*")):
            if file.is_file():
                archive.write(file, file.relative_to(root).as_posix())


def _metadata(case: Case, root: Path, licence: str) -> dict[str, Any]:
    """RO-Crate 1.1 (https://w3id.org/ro/crate/1.1)."""
    summary = json.loads((root / "summary.json").read_text(encoding="utf-8"))
    files = [_file_entity(file, root) for file in sorted(root.rglob("*")) if file.is_file()]
    software = {
        "@id": "#fracture-verify", "@type": "SoftwareApplication", "name": "fracture-verify",
        "softwareVersion": code_version(),
    }  # fmt: skip
    dataset = {
        "@id": "./", "@type": "Dataset", "name": case.title,
        "description": f"{case.requirement} Verdict at tier {case.tier}: {summary['cases'][0]['verdict']}.",
        "datePublished": summary["created"], "hasPart": [{"@id": entity["@id"]} for entity in files],
    } | ({"license": {"@id": f"https://spdx.org/licenses/{licence}"}} if licence else {})  # fmt: skip
    action = {
        "@id": "#verification", "@type": "CreateAction", "name": f"Verification of {case.name}, tier {case.tier}",
        "endTime": summary["created"], "instrument": {"@id": "#fracture-verify"}, "result": {"@id": "./"},
    }  # fmt: skip
    descriptor = {
        "@id": METADATA, "@type": "CreativeWork", "conformsTo": {"@id": "https://w3id.org/ro/crate/1.1"},
        "about": {"@id": "./"},
    }  # fmt: skip
    graph = [descriptor, dataset, software, action, *files]
    return {"@context": "https://w3id.org/ro/crate/1.1/context", "@graph": graph}


def _file_entity(file: Path, root: Path) -> dict[str, Any]:
    return {
        "@id": file.relative_to(root).as_posix(), "@type": "File", "contentSize": str(file.stat().st_size),
        "encodingFormat": _FORMATS.get(file.suffix.lower(), "application/octet-stream"),
        "sha256": hashlib.sha256(file.read_bytes()).hexdigest(),
    }  # fmt: skip


# ------------------------------------------------------------------------------------------------ reading


def read_archive(file: Path, out: Path) -> Imported:
    """Put the cases and runs of an archive under an output folder and judge them there.

    Raises
    ------
    ArchiveError : no such file, no archive of ours, or one that was changed.
    """
    with writing(out), _opened(file) as archive, tempfile.TemporaryDirectory(dir=_made(out)) as place:
        root = Path(place)
        _extract(file, archive, root)
        _require_unchanged(file, root)
        name, tier, verdict = _contents(file, root)
        if (out / "runs" / name / tier).exists() and not (out / "cases" / name).exists():
            text = "holds runs of a case of this name, which those of the archive would replace"
            raise ArchiveError(f"{out / 'runs' / name / tier}: {text}; give another folder with --out.")
        _lead_to(out / "cases" / name / CASE_FILE, root / "runs" / name / tier)
        for part in (Path("cases") / name, Path("runs") / name / tier):
            (out / part).parent.mkdir(parents=True, exist_ok=True)
            replace_folder(root / part, out / part)
    judged = summarise([load_case(out / "cases" / name, tier)], tier, out)
    write_summary(judged, out)
    return Imported(verdict, judged)


def _lead_to(case_file: Path, runs: Path) -> None:
    """Make runs say that theirs is this case file, in place of that of the machine on which they were computed."""
    for file in runs.rglob("run.json"):
        with suppress(ValueError, TypeError):  # a damaged one is told where it is judged
            told = json.loads(file.read_text(encoding="utf-8"))
            write_text(file, json.dumps(told | {"case_source": str(case_file.resolve())}, indent=2) + "\n")


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextmanager
def _opened(file: Path) -> Iterator[zipfile.ZipFile]:
    try:
        archive = zipfile.ZipFile(file)
    except FileNotFoundError:
        raise ArchiveError(f"{file}: is no file; name one that `verify archive` wrote.") from None
    except zipfile.BadZipFile:
        raise _damaged(file) from None
    except OSError as error:
        raise ArchiveError(f"{file}: cannot be read ({error.strerror}); name one that `verify archive` wrote.") from None
    with archive:
        names = archive.namelist()
        if not {METADATA, "summary.json"} <= set(names):
            raise ArchiveError(f"{file}: holds no {METADATA} and summary.json; name one that `verify archive` wrote.")
        if any(PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts or "\\" in name for name in names):
            raise ArchiveError(f"{file}: holds files that would leave the folder; do not use it.")
        if sum(entry.file_size for entry in archive.infolist()) > LARGEST_BYTES:
            raise ArchiveError(f"{file}: would unpack to more than {LARGEST_BYTES / 1e9:g} GB; do not use it.")
        yield archive


def _damaged(file: Path) -> ArchiveError:
    return ArchiveError(f"{file}: is no zip file or a damaged one; make it again with `verify archive`.")


def _extract(file: Path, archive: zipfile.ZipFile, root: Path) -> None:
    try:
        archive.extractall(root)
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError):  # or encrypted, or in a way that is not known
        raise _damaged(file) from None


def _require_unchanged(file: Path, root: Path) -> None:
    """Every file is what the metadata say of it, and there is none of which they say nothing."""
    try:
        graph = json.loads((root / METADATA).read_text(encoding="utf-8"))["@graph"]
        told = {entity["@id"]: entity["sha256"] for entity in graph if entity["@type"] == "File"}
    except (ValueError, LookupError, TypeError):
        raise ArchiveError(f"{file}: {METADATA} cannot be read; get the archive again.") from None
    there = {path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()} - {METADATA}
    for name in sorted(map(str, there | told.keys())):
        if name not in there or hashlib.sha256((root / name).read_bytes()).hexdigest() != told.get(name):
            what = "is missing or was changed" if name in told else "was added"
            raise ArchiveError(f"{file}: {name} {what}; get the archive again.")


def _contents(file: Path, root: Path) -> tuple[str, str, str]:
    """Name and tier of the case, which have folders in the archive, and the verdict that it was made with."""
    try:
        (told,) = json.loads((root / "summary.json").read_text(encoding="utf-8"))["cases"]
        name, tier, verdict = (str(told[key]) for key in ("case", "tier", "verdict"))
    except (ValueError, LookupError, TypeError):
        raise ArchiveError(f"{file}: summary.json tells of no case; get the archive again.") from None
    cases = [path.name for path in (root / "cases").glob("*")]
    if name not in cases or tier not in TIERS or not (root / "runs" / name / tier).is_dir():
        text = f"{file}: has no runs of case {name!r} at tier {tier!r}, of which summary.json tells"
        raise ArchiveError(f"{text}; get the archive again.")
    return name, tier, verdict
