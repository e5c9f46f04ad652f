"""Bodies that stand on others with their corners: told before they slide too little."""

from pathlib import Path
from typing import Any

import pytest

from cases import Case, case_from_tables
from numerics.description import remarks
from verify.planning.plan import plan
from verify.runs.running import _Attempt

SMOOTH: dict[str, Any] = {"contact": {"normals_of": "bed"}}


def sliding(folder: Path, **more: Any) -> Case:
    """A block upon a longer bed, and a disc beside it."""
    shapes: dict[str, Any] = {
        "block": {"rectangle": {"lower": [1.0, 0.0], "upper": [2.0, 0.5]}},
        "bed": {"rectangle": {"lower": [-2.0, -0.25], "upper": [6.0, 0.0]}},
        "disc": {"disc": {"centre": [4.0, 0.5], "radius": 0.5}},
    }
    tables = {
        "title": "Block on a bed",
        "requirement": "It slides.",
        "units": {"length": "m", "force": "MN", "time": "s"},
        "plane": {"assumption": "strain"},
        "materials": {"soft": {"young": 100.0, "poisson": 0.3, "density": 1e-3}},
        "bodies": {name: {"material": "soft", "shape": shape} for name, shape in shapes.items()},
        "dynamics": {"end_time": 0.1, "gravity": [3.0, -9.0]},
        "mesh": {"h": 0.125},
        "runs": {"mpm": {"solver": "mpm"}},
    }
    return case_from_tables({**tables, **more}, run="mpm", source=folder / "case.toml")


def test_a_block_upon_a_bed_is_told_to_name_the_bed(tmp_path: Path) -> None:
    case = sliding(tmp_path)
    (said,) = remarks(case)
    assert said.startswith("bodies.block: stands with its corners on 'bed'") and "contact.normals_of = 'bed'" in said
    assert ("note", said) in plan(case, "mpm").rows()
    assert _Attempt(case, "mpm", None, ()).info()["remarks"] == [f"run mpm: {said}"]


@pytest.mark.parametrize(
    "more",
    [
        SMOOTH,
        {"bodies": {
            name: {"material": "soft", "shape": {"rectangle": {"lower": [x, 0.0], "upper": [x + 2.0, 0.5]}}}
            for name, x in (("a", 0.0), ("b", 2.0))
        }},
    ],
)  # fmt: skip
def test_a_bed_whose_normal_holds_and_bars_end_to_end_are_not_told(more: dict[str, Any], tmp_path: Path) -> None:
    assert remarks(sliding(tmp_path, **more)) == []


@pytest.mark.parametrize(
    ("placement", "friction", "told"), [("gauss", 0.3, True), ("gauss", 0.0, False), ("rings", 0.3, False)]
)
def test_a_disc_that_rolls_is_told_to_have_its_points_on_rings(
    placement: str, friction: float, told: bool, tmp_path: Path
) -> None:
    contact = {"normals_of": "bed", "friction": friction}
    said = remarks(sliding(tmp_path, contact=contact, mpm={"placement": placement}))
    assert [sentence[:12] for sentence in said] == ["bodies.disc:"] * told
