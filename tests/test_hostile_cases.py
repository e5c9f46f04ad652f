"""What no case can mean is refused in one sentence, before it is built or written anywhere."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import fake_solver
import pytest
from attack.toml_text import toml_text
from test_strangers import PLATE

from cases import CaseError, load_case
from verify.runs.run_folder import RunFolderError
from verify.runs.running import run

MOVING = {
    "constraints": [{"on": "bottom", "direction": "y", "value": 0}],
    "materials": {"steel": {**PLATE["materials"]["steel"], "density": 7.85e-9}},
    "load": None,
}


def refused(folder: Path, data: bytes, name: str = "case.toml") -> str:
    """The sentence for a case file."""
    path = folder / "plate" / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)
    with pytest.raises(CaseError) as caught:
        load_case(path)
    said = str(caught.value)
    assert said.startswith(str(path.resolve())) and said.endswith(".") and "\n" not in said
    return said


def written(changes: dict[str, Any]) -> bytes:
    """The plate with other tables; None takes one out."""
    tables = {key: value for key, value in {**copy.deepcopy(PLATE), **changes}.items() if value is not None}
    return toml_text(tables).encode()


def body(**table: Any) -> dict[str, Any]:
    return {"bodies": {"plate": {"material": "steel", **table}}}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (body(shape={"rectangle": {"lower": [-1e300, 0], "upper": [2, 1]}}), "is beyond every length"),
        ({"mesh": {"h": 1e-300}}, "'mesh.h' = 1e-300 is beyond every length"),
        ({"materials": {"steel": {"young": 1e300, "poisson": 0.3}}}, "is beyond every stress"),
        ({"materials": {"steel": {"young": "1e200 GPa", "poisson": 0.3}}}, "is beyond every stress"),
        ({**MOVING, "dynamics": {"end_time": 1e-6, "damping": 1e300}}, "'dynamics.damping' = 1e+300 is beyond every"),
        ({**MOVING, "dynamics": {"end_time": 1e-6, "gravity": [0.0, -1e300]}}, "is beyond every acceleration"),
        ({"load": {"path": [0.0, 0.001], "increment": 1e-12}}, "'load.increment' = 1e-12 asks for more than 1000000"),
        ({**MOVING, "dynamics": {"end_time": 1.0, "time_step": 1e-15}}, "asks for more than 1000000000 steps"),
        ({"mpm": {"order": 1, "margin": 10**9}}, "'mpm.margin' = 1000000000 must be at most 100"),
        ({"runs": {"fem": {"solver": "fem", "sweep": {"mpm.seed": list(range(2000))}}}}, "stands for 2000 runs"),
        ({"runs": {"fem": {"solver": "fem", "sweep": {"mesh.element": ["x" * 250]}}}}, "by more than 240 bytes"),
        (body(mesh="/etc/plate.msh"), "holds on one machine only"),
    ],
)
def test_what_no_number_name_or_path_can_be_is_refused(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    assert said in refused(tmp_path, written(changes))


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"#" * 5_000_001, "is larger than 5 MB"),
        (b"a" + b".a" * 20_000 + b" = 1", "has a key of more than 200 parts"),
        (b"\n".join([b"[" + b".".join([b"a"] * 150) + b"]", b".".join([b"b"] * 150) + b" = 1"]), "more than 200 deep"),
        (b"a = " + b"[" * 100_000, "cannot be read"),
        (b"units = { length = 0x" + b"f" * 10_000 + b" }", "'units.length' = ... is not a text"),
    ],
)
def test_a_file_that_is_too_large_or_too_deep_is_not_read(data: bytes, said: str, tmp_path: Path) -> None:
    assert said in refused(tmp_path, data)


@pytest.mark.parametrize("name", ["...toml", ".toml", "a\x7fb.toml", f"{'x' * 240}.toml"])
def test_a_name_that_leads_elsewhere_is_refused(name: str, tmp_path: Path) -> None:
    assert "would name its results" in refused(tmp_path, written({}), name)


def test_a_path_that_no_system_has_is_no_such_case() -> None:
    for name in ("x" * 5000, "a\0b.toml"):
        with pytest.raises(CaseError, match="no such case"):
            load_case(name)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [((3,), "name_or_path' = 3 is neither"), ((None,), "is neither"), ((["bar_profile"],), "is neither"),
     (("bar_profile", "quick", 1), "'run' = 1 is not a run"),
     (("bar_profile", "quick", "fem", [1]), r"change' = \[1\] is not a table"),
     (("bar_profile", "quick", "fem", {"mesh.h": 0.1}), "is a key with dots; give tables as {'mesh': {'h': 0.1}}"),
     (("bar_profile", "quick", "fem", {"units": {"force": "N"}}), "'change.units' may not be changed by a run")],
)  # fmt: skip
def test_what_python_gives_in_place_of_texts_is_one_sentence(arguments: tuple[Any, ...], said: str) -> None:
    with pytest.raises(CaseError, match=said):
        load_case(*arguments)


def test_the_mark_that_some_editors_write_first_is_read_over(tmp_path: Path) -> None:
    path = tmp_path / "plate.toml"
    path.write_bytes(b"\xef\xbb\xbf" + written({}))
    assert load_case(path).title == "Plate"


def test_alternatives_that_multiply_are_counted_before_they_are_made(tmp_path: Path) -> None:
    check = {"metric": "peak_force", "run": "{a,b}" * 40, "against": "none", "limit": 1, "reason": "an attack"}
    assert "stands for too many runs" in refused(tmp_path, written({"checks": [check]}))


def test_a_second_file_of_one_name_does_not_replace_the_results_of_the_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake_solver.install(monkeypatch)
    first, second = (fake_solver.write_case(tmp_path / place / "square") for place in ("one", "two"))
    second.write_text(second.read_text().replace("young = 210.0", "young = 211.0"))
    run(first, "fem", "quick", tmp_path)
    with pytest.raises(RunFolderError, match="rename one of the two"):
        run(second, "fem", "quick", tmp_path)
    first.unlink()  # moved rather than copied
    run(second, "fem", "quick", tmp_path)
