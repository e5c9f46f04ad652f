"""The solver of one's own against the exact solution, with the case's own limits."""

from pathlib import Path

import own_solver
import pytest

from cases.solvers import SOLVERS
from verify import compare, run

CASE = Path(__file__).with_name("bar.toml")


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the entry point does where the package is installed."""
    monkeypatch.setitem(SOLVERS, "own", own_solver.SOLVER)


def test_the_bar_follows_the_exact_solution(tmp_path: Path) -> None:
    assert run(CASE, "own", out=tmp_path).history["c_min"].iloc[-1] < 0.95
    entry = compare(CASE, out=tmp_path)
    assert entry["verdict"] == "PASS", entry["checks"]


def test_its_failure_is_recorded_as_ours_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(case: object) -> None:
        raise ArithmeticError("the bar is too thin")

    monkeypatch.setattr(own_solver, "solve", fails)
    finished = run(CASE, "own", out=tmp_path)
    assert (finished.info["status"], finished.info["reason"]) == ("failed", "ArithmeticError: the bar is too thin")
    assert compare(CASE, out=tmp_path)["verdict"] == "RUN_FAILED"
