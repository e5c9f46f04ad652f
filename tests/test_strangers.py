"""Cases as strangers bring them: both solvers give the right value, or one sentence says what to change."""

from __future__ import annotations

from typing import Any

import pytest

from cases import Case, case_from_tables
from verify.runs.running import DISCRETISATIONS, solver_records

PLATE: dict[str, Any] = {
    "title": "Plate",
    "requirement": "Both solvers give the right force.",
    "units": {"length": "mm", "force": "kN"},
    "plane": {"assumption": "strain", "thickness": 1.0},
    "materials": {"steel": {"young": 210.0, "poisson": 0.3}},
    "bodies": {"plate": {"material": "steel", "shape": {"rectangle": {"lower": [0, 0], "upper": [2, 1]}}}},
    "boundaries": {"corner": {"point": [1.0, 0.0]}},
    "constraints": [
        {"on": "bottom", "direction": "y", "value": 0},
        {"on": "corner", "direction": "x", "value": 0},
        {"on": "top", "direction": "y", "scale": 1},
    ],
    "load": {"path": [0.0, 0.001], "increment": 1e-3},
    "mesh": {"h": 0.05},
    "mpm": {"order": 1},
    "runs": {"fem": {"solver": "fem"}, "mpm": {"solver": "mpm"}},
}


def plate(solver: str, **changes: Any) -> Case:
    """The elastic plate with other tables."""
    return case_from_tables({**PLATE, **changes}, tier="standard", run=solver)


def force(case: Case, solver: str) -> float:
    """Force at the end of the load path."""
    *_, last = solver_records(DISCRETISATIONS[solver](case), case)
    assert last.is_good
    return last.row()["F"]


def slit(start: float, end: float, y: float = 0.5) -> dict[str, Any]:
    return {"kind": "slit", "start": [start, y], "end": [end, y]}


@pytest.mark.parametrize(
    "notches",
    [
        [slit(0.0, 0.5), slit(1.5, 2.0)],
        [slit(0.25, 0.75), slit(1.25, 1.75)],
        [slit(0.0, 0.5), slit(1.0, 1.25), slit(1.5, 2.0)],
        [slit(0.0, 0.5, 0.25), slit(0.0, 0.5, 0.75)],
        [slit(0.0, 0.5), {"kind": "slit", "start": [1.0, 0.25], "end": [1.0, 0.75]}],
    ],
)
def test_every_slit_is_open_in_both_solvers(notches):
    whole = force(plate("fem"), "fem")
    fem, mpm = (force(plate(solver, notches=notches), solver) for solver in ("fem", "mpm"))
    assert fem < 0.98 * whole
    assert mpm == pytest.approx(fem, rel=5e-3)


def test_two_notches_on_one_line_have_the_stiffness_of_a_fine_mesh():
    notches = [slit(0.0, 0.5), slit(1.5, 2.0)]
    assert force(plate("mpm", notches=notches), "mpm") == pytest.approx(0.2736, rel=0.02)
