"""Ground motions of cases: what is refused, what both explicit solvers make of them, and bodies that settle before."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import Case, CaseError, case_from_tables
from fem_reference import ExplicitFiniteElements
from mpm import ExplicitMaterialPoints
from numerics.explicit import instants
from physics.moving_frame import MovingFrame
from physics.rocking.of_case import ground_motion

SINE = {"pulse": "sine", "amplitude": 2.0, "period": 0.5}


def block_case(folder: Path, dynamics: dict[str, Any], run: str = "mpm", floor: bool = False) -> Case:
    """A block of one by two metres, on a rigid floor if asked."""
    bodies: dict[str, Any] = {"block": {"material": "soft", "shape": {"rectangle": {"lower": [0, 0], "upper": [1, 2]}}}}
    if floor:
        below = {"rectangle": {"lower": [-1, -0.5], "upper": [2, 0]}}
        bodies["floor"] = {"material": "soft", "rigid": True, "shape": below}
    tables = {
        "title": "Block", "requirement": "It moves as the ground has it.",
        "units": {"length": "m", "force": "kN", "time": "s"}, "plane": {"assumption": "strain"},
        "materials": {"soft": {"young": 2e3, "poisson": 0.3, "density": 0.5}}, "bodies": bodies,
        "dynamics": {"end_time": 0.6, "affine": True, "time_step_share": 0.5, **dynamics},
        "contact": {"friction": 0.6}, "mesh": {"h": 0.25}, "mpm": {"placement": "regular", "points_per_cell": 2},
        "runs": {"mpm": {"solver": "mpm"}, "fem": {"solver": "fem"}},
    }  # fmt: skip
    if floor:
        del tables["runs"]["fem"]
    return case_from_tables(tables, "standard", run, source=folder / "case.toml")


def missing(instant: Any) -> float:
    """Energy that neither forces nor contact gave."""
    balance = instant.balance
    return balance.total - balance.external_work - balance.contact_work


@pytest.mark.parametrize(
    ("ground", "said"),
    [
        ({}, "must have exactly one motion"),
        ({"pulse": "sine", "period": 1.0}, "must have exactly one size of the pulse"),
        ({"pulse": "sine", "amplitude": 1.0}, "must have exactly one length of the pulse"),
        (SINE | {"cut": [0.0, 1.0]}, "ground.cut"),
        (SINE | {"table": "motion.csv"}, "must have exactly one motion"),
        ({"table": "../motion.csv"}, "leaves the folder of the case"),
        ({"table": "none.csv"}, "is not a file"),
        ({"table": "back.csv"}, "row 3 that is not later"),
        ({"table": "infinite.csv"}, "no finite time and acceleration in row 2"),
        ({"table": "motion.csv", "cycles": 2}, "of a pulse only"),
        ({"table": "motion.csv", "cut": [0.4, 0.2]}, "does not run forward"),
        ({"pulse": "sine", "uplift_ratio": 1.0, "period": 1.0}, "rocking is missing"),
    ],
)
def test_a_ground_motion_that_is_none_is_refused(tmp_path: Path, ground: dict[str, Any], said: str) -> None:
    for name, rows in {"motion": "0,0\n1,2", "back": "0,0\n1,2\n0.5,1", "infinite": "0,0\n1,inf"}.items():
        (tmp_path / f"{name}.csv").write_text(f"time,acceleration\n{rows}\n")
    with pytest.raises(CaseError, match=r"case\.toml") as refused:
        block_case(tmp_path, {"ground": ground})
    assert said in str(refused.value).replace("'", "")


def test_a_table_is_linear_scaled_cut_and_part_of_the_case(tmp_path: Path) -> None:
    table = tmp_path / "motion.csv"
    table.write_text("time,acceleration\n1,0\n2,4\n3,0\n")
    case = block_case(tmp_path, {"ground": {"table": "motion.csv", "scale": 0.5, "cut": [1.5, 2.5]}})
    motion = ground_motion(case)
    np.testing.assert_allclose(motion.acceleration([-0.1, 0.0, 0.25, 0.5, 1.0, 1.1]), [0.0, 1.0, 1.5, 2.0, 1.0, 0.0])
    before = case.hash()
    table.write_text("time,acceleration\n1,0\n2,5\n3,0\n")
    assert case.hash() != before
    late = block_case(tmp_path, {"ground": {"table": "motion.csv", "cut": [2.0, 9.0]}})
    with pytest.raises(CaseError, match=r"ground.cut = \[2.0, 9.0\]: leaves the motion"):
        ground_motion(late)


@pytest.mark.parametrize(("run", "made_by"), [("mpm", ExplicitMaterialPoints), ("fem", ExplicitFiniteElements)])
def test_a_free_body_lags_behind_the_ground(tmp_path: Path, run: str, made_by: Any) -> None:
    """Its momentum is that of minus the ground's velocity; forces do just the work that it holds."""
    case = block_case(tmp_path, {"ground": SINE | {"direction": "y"}}, run)
    for instant in instants(made_by(case), case):
        at = min(instant.time, 0.5)
        expected = -2.0 * 0.5 / (2 * np.pi) * (1.0 - np.cos(2 * np.pi * at / 0.5))
        assert instant.balance.momentum == pytest.approx((0.0, expected), abs=2e-2)
        assert abs(missing(instant)) < 2e-2 * 0.05


@pytest.mark.parametrize(("run", "made_by"), [("mpm", ExplicitMaterialPoints), ("fem", ExplicitFiniteElements)])
def test_gravity_comes_on_in_a_damped_stage_before_time_0(tmp_path: Path, run: str, made_by: Any) -> None:
    settling = {"duration": 0.4, "ramp": 0.2, "damping": 30.0}
    case = block_case(tmp_path, {"gravity": [0.0, -10.0], "settling": settling, "end_time": 0.01}, run)
    frame = MovingFrame(case)
    np.testing.assert_allclose([frame.acceleration(t)[1] for t in (-0.4, -0.3, -0.2, 0.0)], [0.0, -5.0, -10.0, -10.0])
    assert (frame.damping(-0.1), frame.damping(0.0)) == (30.0, 0.0)
    told = list(instants(made_by(case), case))
    assert (told[0].time, told[-1].time) == (-0.4, pytest.approx(0.01))
    # what has fallen freely against the damping from -0.4 s on
    fallen = -told[-1].balance.momentum[1] / (0.5 * 2.0)
    assert fallen == pytest.approx(10.0 / 30.0 + 0.1, rel=0.02)


def test_a_block_that_has_settled_rests_on_its_floor(tmp_path: Path) -> None:
    settling = {"duration": 0.5, "ramp": 0.2, "damping": 30.0}
    dynamics = {"gravity": [0.0, -10.0], "settling": settling, "end_time": 0.3, "ground": SINE | {"amplitude": 0.5}}
    case = block_case(tmp_path, dynamics, floor=True)
    told = list(instants(ExplicitMaterialPoints(case), case))
    given = max(abs(instant.balance.external_work) for instant in told)
    assert max(abs(missing(instant)) for instant in told) < 0.02 * given
    rest = [instant for instant in told if abs(instant.time) < 0.01]
    assert all(instant.balance.kinetic < 1e-3 * instant.balance.elastic for instant in rest)
