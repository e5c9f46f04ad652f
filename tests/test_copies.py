"""A copy of a case has all files that the case names, each its own content, and is the same computation."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import fake_solver
import numpy as np
import pytest
from pydantic import BaseModel

from cases import load_case
from cases.copies import FILE_KEYS, write_copy
from cases.schema import CaseDescription
from verify.judging.foreign import ForeignResult, judge_foreign

MOVING = """
title = "Block"
requirement = "Its files go with it."
units = { length = "m", force = "N" }
plane = { assumption = "strain" }
materials.stone = { young = 1e6, poisson = 0.2, density = 1e3 }
bodies.block = { material = "stone", shape = { rectangle = { lower = [0, 0], upper = [1, 1] } } }
mesh = { h = 0.5 }
runs.fem = { solver = "fem" }
"""


def parts(annotation: object) -> Iterator[object]:
    """A type and all that it is made of, however deep."""
    yield annotation
    for each in get_args(annotation):
        yield from parts(each)


def file_keys(model: type[BaseModel], seen: set[type[BaseModel]]) -> set[str]:
    """Names of the keys, in a table and those below it, whose values are files."""
    seen.add(model)
    found = set()
    for key, field in model.model_fields.items():
        for part in parts(field.annotation):
            if part is Path:
                found.add(key)
            elif isinstance(part, type) and issubclass(part, BaseModel) and part not in seen:
                found |= file_keys(part, seen)
    return found


def test_every_key_that_names_a_file_is_known() -> None:
    assert file_keys(CaseDescription, set()) == set(FILE_KEYS)


@pytest.mark.parametrize(
    "named",
    [
        'constraints = [{ on = "bottom", direction = "x", table = "sub/rows.csv" }]\ndynamics = { end_time = 1.0 }',
        'dynamics = { end_time = 1.0, ground = { table = "sub/rows.csv" } }',
        'dynamics = { end_time = 1.0, ground = { record = "rows" } }',
    ],
)
def test_tables_and_records_go_with_the_case(named: str, tmp_path: Path) -> None:
    path = tmp_path / "block.toml"
    path.write_text(MOVING.replace("mesh =", f"{named}\nmesh ="))
    for place in (tmp_path / "rows.csv", tmp_path / "sub" / "rows.csv"):
        place.parent.mkdir(exist_ok=True)
        place.write_text("time,acceleration,displacement\n0,0,0\n1,1,1\n")
    case = load_case(path)
    assert load_case(write_copy(case, tmp_path / "copy")).hash() == case.hash()


def test_a_result_of_the_name_of_a_reference_is_the_one_that_is_judged(tmp_path: Path) -> None:
    curves = [tmp_path / folder / "curve.csv" for folder in ("square", "mine", "path")]
    for factor, curve in enumerate(curves, 1):
        curve.parent.mkdir()
        curve.write_text("u,F,x,y\n" + "".join(f"{u},{factor * u},{u},{factor}\n" for u in np.linspace(0, 0.01, 11)))
    published = "\n[references.print]\nkind = 'table'\nsource = 'a book'\ncurve = 'curve.csv'\n"
    path = fake_solver.write_case(curves[0].parent, published, fake_solver.check("reference:print"))
    judged = judge_foreign(load_case(path), ForeignResult(curves[1], crack_path=curves[2]), tmp_path / "out")
    peak = judged.checks.set_index(["metric", "against"]).loc[("peak_force", "reference:print")]
    assert (peak["value"], peak["target"], peak["verdict"]) == (0.02, 0.01, "FAIL")
    assert judged.run.crack_path[:, 1].tolist() == [3.0] * 11
