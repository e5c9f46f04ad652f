"""The pages say rightly what agrees and what does not: the verdict's remark on the elastic part of each curve."""

from pathlib import Path

import pytest

from cases import load_case
from verify.judging.foreign import ForeignResult, judge_foreign

HERE = Path(__file__).parent
RESULTS = {
    "molnar_tension": ("sen_tension", "standard", "", "the elastic part differs already"),
    "phasefieldx_tension": ("sen_tension", "quick", "", "the elastic part agrees"),
    "phasefieldx_bending": ("three_point_bending_notched", "quick", "", "the elastic part differs already"),
    "raccoon_l_panel": ("l_panel", "standard", "u = time, F = Fy [N]", "the elastic part differs already"),
}


@pytest.mark.parametrize("name", RESULTS)
def test_a_public_result_is_judged_as_its_page_says(name: str, tmp_path: Path) -> None:
    case, tier, columns, said = RESULTS[name]
    judged = judge_foreign(load_case(case, tier), ForeignResult(HERE / f"{name}.csv", columns), tmp_path)
    assert judged.verdict == "FAIL" and said in judged.remarks[0]
    peaks = judged.checks[(judged.checks["metric"] == "peak_force") & judged.checks["against"].isin(["fem", "mpm"])]
    assert (peaks["value"].abs() < peaks["target"].abs()).all(), "each peak is lower"
    shifted = any("an axis read with an offset" in remark for remark in judged.remarks)
    assert shifted == (name == "molnar_tension")
