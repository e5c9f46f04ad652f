"""A minute of attacks; an hour of them by hand, see ``python -m tests.attack --help``."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from cases import load_case

from . import ATTACKS
from .large_cases import LARGE
from .toml_text import toml_text

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("what", LARGE)
def test_a_large_case_is_checked_in_a_moment(what: str, tmp_path: Path) -> None:
    path = tmp_path / "large.toml"
    path.write_text(toml_text(LARGE[what]()), encoding="utf-8")
    started = time.process_time()
    load_case(path, "quick")
    assert time.process_time() - started < 4.0


# a kill of a solver takes a minute each
@pytest.mark.skipif(sys.platform != "linux", reason="processes are bounded and watched as Linux can")
def test_nothing_is_found_in_a_moment() -> None:
    # in a process of its own: a fork of one that has computed in parallel does not live
    kinds = [kind for kind in ATTACKS if kind != "kill_solver"]
    command = [sys.executable, "-m", "tests.attack", "--seed", "1", "--only", *kinds, "--seconds", "12", "--most", "100"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    told = done.stdout.splitlines()
    assert [line.partition(":")[0] for line in told] == kinds
    assert not [line for line in told if ": 0 attempts" in line]
