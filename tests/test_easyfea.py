"""What the adapter refuses, and, where EasyFEA is installed, that an elastic step is ours."""

import sys
from pathlib import Path

import pytest

from cases import load_case
from cases.errors import CaseError
from verify.extras import MissingExtraError
from verify.runs import easyfea
from verify.runs.running import tabulate


@pytest.mark.parametrize(
    ("case", "said"),
    [("two_discs", "knows no dynamics"), ("off_axis_notch", "fracture.split")],
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
