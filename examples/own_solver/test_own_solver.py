"""The solver of one's own against the exact solution, with the case's own limits, as an installed package."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import own_solver
import pytest

from cases import UserError
from cases.solvers import SOLVERS
from verify import compare, run

FOLDER = Path(__file__).parent
CASE = FOLDER / "bar.toml"


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the entry point does where the package is installed."""
    monkeypatch.setitem(SOLVERS, "own", own_solver.SOLVER)


def called(installed: Path, *program: str) -> str:
    """Output of a Python program where the packages of a folder are installed."""
    path = os.pathsep.join([str(installed), str(FOLDER.parents[1])])
    done = subprocess.run(
        [sys.executable, *program], capture_output=True, text=True, env=os.environ | {"PYTHONPATH": path}, cwd=installed
    )
    return done.stdout + done.stderr


def test_it_is_found_by_its_name_where_it_is_installed(tmp_path: Path) -> None:
    shutil.copy(FOLDER / "own_solver.py", tmp_path)
    told = tmp_path / "own_solver-0.1.0.dist-info"
    told.mkdir()
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: own-solver\nVersion: 0.1.0\n")
    (told / "entry_points.txt").write_text(
        "[fracture_verify.solvers]\nown = own_solver:SOLVER\nbroken = not_there:SOLVER\n"
    )
    command = ("-m", "verify.cli")
    assert "Own bar" in called(tmp_path, *command, "list", "--solvers")
    loaded = f"import own_solver, cases; print(cases.load_case({str(CASE)!r}).runs['own'].solver)"
    assert called(tmp_path, "-c", loaded).strip() == "own"
    (tmp_path / "bar.toml").write_text(CASE.read_text().replace('solver = "own"', 'solver = "broken"'))
    said = called(tmp_path, *command, "validate", "bar.toml")
    assert "whose package cannot be loaded (ModuleNotFoundError" in said and "uninstall not_there." in said


def test_the_bar_follows_the_exact_solution(tmp_path: Path, registered: None) -> None:
    assert run(CASE, "own", out=tmp_path).history["c_min"].iloc[-1] < 0.95
    entry = compare(CASE, out=tmp_path)
    assert entry["verdict"] == "PASS", entry["checks"]


def test_its_failure_is_recorded_as_ours_are(
    tmp_path: Path, registered: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(case: object) -> None:
        raise ArithmeticError("the bar is too thin")

    monkeypatch.setattr(own_solver, "solve", fails)
    finished = run(CASE, "own", out=tmp_path)
    assert (finished.info["status"], finished.info["reason"]) == ("failed", "ArithmeticError: the bar is too thin")
    assert compare(CASE, out=tmp_path)["verdict"] == "RUN_FAILED"


@pytest.mark.parametrize("made", [None, [0.0, 1.0], {"u": [0.0, 1.0], "F": [0.0, 1.0]}])
def test_what_is_no_table_is_told(
    made: object, tmp_path: Path, registered: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(own_solver, "solve", lambda case: made)
    with pytest.raises(UserError, match="run own: is no table but of the kind"):
        run(CASE, "own", out=tmp_path)
