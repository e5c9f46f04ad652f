"""pytest plugin: a result of one's own code judged in one's own tests.

    def test_shear(fracture_case):
        fracture_case("sen_shear").judge("force.csv", map="u = U2, F = -2 * RF2 [N]")

It fails with the table of checks where the verdict is not PASS; the page stays in pytest's temporary folder.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest


@dataclass(frozen=True)
class FractureCase:
    """A case to judge results by, and where its pages go."""

    name: str
    folder: Path

    def judge(self, history: Any, map: str = "", crack_path: Any = None, **options: Any) -> Any:
        """Judge a result as `verify.judge` does and return the judgement; the test fails where it does not pass."""
        from verify import judge

        judged = judge(self.name, history, map, crack_path, **{"out": self.folder} | options)
        if judged.verdict != "PASS":
            gated = judged.checks[judged.checks["verdict"] != "INFO"].drop(columns=["unit", "note"])
            remarks = "\n".join(judged.remarks)
            table = gated.to_string(index=False) if len(gated) else "no check of the case applies to this result"
            pytest.fail(f"{self.name}: {judged.verdict}\n{table}\n{remarks}\n{judged.page}", pytrace=False)
        return judged


@pytest.fixture
def fracture_case(tmp_path: Path) -> Callable[[str], FractureCase]:
    """``fracture_case("sen_shear").judge(history)``; a case of the library or the path of a case file."""
    return lambda name: FractureCase(str(name), tmp_path / "judged")
