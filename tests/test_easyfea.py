"""What the adapter refuses, and, where EasyFEA is installed, that an elastic step is ours."""

import sys
from pathlib import Path
from typing import Any

import pytest
from test_field_energies import PLATE, plate

from cases import case_from_tables, load_case
from cases.errors import CaseError
from verify.extras import MissingExtraError
from verify.runs import easyfea
from verify.runs.running import tabulate


@pytest.mark.parametrize(
    ("case", "said"),
    [
        ("two_discs", "knows no dynamics"), ("off_axis_notch", "knows no anisotropic stiffness"),
        ("fourth_order", "fracture.split"),
    ],
)
def test_what_it_does_not_know_is_one_sentence(case: str, said: str) -> None:
    with pytest.raises(CaseError, match=said):
        easyfea.solve(load_case(case, "quick"))


def test_without_easyfea_the_sentence_says_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "EasyFEA", None)
    case = load_case("three_point_bending_notched", "quick", "fem")
    spec = case.run_spec("fem")
    monkeypatch.setattr(type(case), "run_spec", lambda self, run: type(spec)("fem", "easyfea", "fem"))
    with pytest.raises(MissingExtraError, match=r"pip install 'fracture-verify\[easyfea\]'"):
        tabulate(case, "fem", tmp_path / "fem")


def test_an_elastic_step_agrees_with_our_finite_elements() -> None:
    pytest.importorskip("EasyFEA")
    model = easyfea.Model(load_case("three_point_bending_notched", "quick", "fem"))
    assert model.step(0.004)
    assert model.row(0.004)["F"] == pytest.approx(0.00412417, rel=1e-3)  # of the kept result


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"tractions": [{"on": "right", "value": [0.1, 0]}]}, "tractions, body forces or eigenstrains"),
        ({"mesh": {"h": 0.1, "under_resolved": True, "geometry": "updated"}}, "geometry that moves"),
    ],
)
def test_what_would_change_the_answer_is_not_passed_over(changed: dict[str, Any], said: str) -> None:
    with pytest.raises(CaseError, match=f"knows no {said}"):
        easyfea.solve(case_from_tables({**PLATE, **changed}, run="fem"))


def test_the_functional_at1_is_refused() -> None:
    with pytest.raises(CaseError, match="knows no functional AT1"):
        easyfea.solve(plate(functional="AT1"))
