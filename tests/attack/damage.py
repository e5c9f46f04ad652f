"""Damaged run folders and checkpoints: said to be damaged, or harmless."""

from __future__ import annotations

import json
import random
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import fake_solver
import numpy as np

from cases import load_case
from verify.judging.summary import summarise
from verify.runs import running
from verify.runs.checkpoint import CHECKPOINT_FILE, Checkpoint, CheckpointError
from verify.runs.run_folder import RunFolder, RunFolderError, run_path
from verify.runs.running import run

from .harness import FoundError
from .mutants import hostile

TIER, RUNS = "quick", ("fem", "mpm")


def with_stand_ins() -> None:
    """Solve by closed formulas from now on, in this process."""
    running.DISCRETISATIONS["fem"] = fake_solver.FakeSolver
    running.DISCRETISATIONS["mpm"] = lambda case: fake_solver.FakeSolver(case, 1.004)
    running.solver_records = fake_solver.fake_increments
    running.code_version = lambda: "0.1.0"  # that of code which is not committed is not accepted


CHART = """
[charts.spacing]
quantities = [{ metric = "peak_force" }]
change.mesh.under_resolved = true
reference = { run = "fem", levels = { "mesh.h" = [0.16, 0.12, 0.08] } }
ladders.fem_ladder = { run = "fem", levels = { "mesh.h" = [0.4, 0.25] } }
"""


def case_in(folder: Path) -> Path:
    """The file of a case of two runs, a check between them and a chart."""
    checks = fake_solver.check("fem"), fake_solver.check("baseline", gate=False)
    return fake_solver.write_case(folder / "square", *checks, CHART)


@cache
def finished() -> Path:
    """Results of both runs, made once in this process."""
    with_stand_ins()
    folder = Path(tempfile.mkdtemp(prefix="attack-finished-"))
    for name in RUNS:
        run(case_in(folder), name, TIER, folder)
    return folder


@cache
def _values() -> dict[str, Any]:
    """What the undamaged runs are judged by."""
    return _judged(finished())


def _judged(out: Path) -> dict[str, Any]:
    summary = summarise([load_case(finished() / "square", TIER)], TIER, out)
    checks = summary["cases"][0]["checks"]
    return {check["metric"]: check["value"] for check in checks if check["verdict"] == "PASS"}


def damage_folder(rng: random.Random, folder: Path) -> str:
    """One file of a finished run is damaged; the run is read and judged."""
    out = folder / "out"
    shutil.copytree(finished() / "runs", out / "runs")
    home = run_path(out, "square", TIER, rng.choice(RUNS))
    files = sorted(path for path in home.rglob("*") if path.is_file())
    rng.choice(DAMAGES)(rng, rng.choice([*files, home / "run.json"]), files)
    values = _judged(out)
    if not values.items() <= _values().items():
        raise FoundError(f"a false PASS: {values} instead of {_values()}")
    return _read(home) if values else "judged as missing"


def _read(home: Path) -> str:
    """Everything that a folder holds."""
    try:
        found = RunFolder(home)
        _ = found.history, found.crack_path, found.fields(), list(found.snapshots()), found.checkpoint
    except RunFolderError as error:
        return "harmless to judging, said to be damaged" if str(home) in str(error) else f"says {error}"
    return "harmless"


def damage_checkpoint(rng: random.Random, folder: Path) -> str:
    """A damaged checkpoint is refused or the whole."""
    source = run_path(finished(), "square", TIER, "fem") / CHECKPOINT_FILE
    path = folder / CHECKPOINT_FILE
    shutil.copy(source, path)
    rng.choice([damage for damage in DAMAGES if damage is not _swap])(rng, path, [path])
    try:
        read, whole = Checkpoint.read(path), Checkpoint.read(source)
    except CheckpointError:
        return "said to be unreadable"
    same = all(np.array_equal(read.state[key], whole.state[key]) for key in whole.state)
    if not same or (read.made_by, read.record, read.count) != (whole.made_by, whole.record, whole.count):
        raise FoundError("a damaged checkpoint is taken for whole")
    return "harmless"


Damage = Callable[[random.Random, Path, list[Path]], None]


def _remove(rng: random.Random, path: Path, files: list[Path]) -> None:
    path.unlink()


def _empty(rng: random.Random, path: Path, files: list[Path]) -> None:
    path.write_bytes(b"")


def _cut(rng: random.Random, path: Path, files: list[Path]) -> None:
    path.write_bytes(path.read_bytes()[: rng.randrange(path.stat().st_size)])


def _flip(rng: random.Random, path: Path, files: list[Path]) -> None:
    data = bytearray(path.read_bytes())
    for _ in range(rng.choice([1, 1, 2, 20])):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    path.write_bytes(data)


def _append(rng: random.Random, path: Path, files: list[Path]) -> None:
    path.write_bytes(path.read_bytes() + rng.randbytes(rng.choice([1, 100, 10_000])))


def _double(rng: random.Random, path: Path, files: list[Path]) -> None:
    path.write_bytes(path.read_bytes() * 2)


def _swap(rng: random.Random, path: Path, files: list[Path]) -> None:
    other = rng.choice(files)
    one, two = path.read_bytes(), other.read_bytes()
    path.write_bytes(two)
    other.write_bytes(one)


def _reverse(rng: random.Random, path: Path, files: list[Path]) -> None:
    path.write_bytes(b"\n".join(reversed(path.read_bytes().split(b"\n"))))


def _numbers(rng: random.Random, path: Path, files: list[Path]) -> None:
    digits = rng.choice([(b"1", b"7"), (b"0.", b"nan"), (b"e-", b"e+"), (b",", b";"), (b".", b",")])
    path.write_bytes(path.read_bytes().replace(*digits))


def _folder_instead(rng: random.Random, path: Path, files: list[Path]) -> None:
    path.unlink()
    path.mkdir()


def _ring_of_links(rng: random.Random, path: Path, files: list[Path]) -> None:
    path.unlink()
    path.symlink_to(path)


def _noise(rng: random.Random, path: Path, files: list[Path]) -> None:
    path.write_bytes(rng.randbytes(rng.choice([1, 100, path.stat().st_size])))


def _mistype(rng: random.Random, path: Path, files: list[Path]) -> None:
    """Another kind of value at one key of run.json, or anywhere below it."""
    told = path.parent / "run.json"
    if not told.is_file():
        return _flip(rng, path, files)
    info = json.loads(told.read_text())
    key = rng.choice(list(info))
    holder: Any = info
    while isinstance(holder[key], dict) and holder[key] and rng.random() < 0.7:
        holder = holder[key]
        key = rng.choice(list(holder))
    if rng.random() < 0.2:
        del holder[key]
    else:
        holder[key] = hostile(rng)
    told.write_text(json.dumps(info))
    return None


DAMAGES: list[Damage] = [
    _remove, _empty, _cut, _flip, _append, _double, _swap, _reverse, _numbers, _folder_instead, _ring_of_links, _noise,
    _mistype,
]  # fmt: skip
