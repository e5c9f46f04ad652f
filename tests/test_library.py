"""Every case of the library, quick tier: run by both solvers, judged by its own checks."""

from pathlib import Path

import pytest

from cases import list_cases, load_case
from verify import compare
from verify.cli import main

#: kept from one session to the next: runs whose case, solvers and libraries are unchanged are up to date
OUT = Path(__file__).parents[1] / "build" / "library"


@pytest.fixture(scope="module")
def results():
    """Results of all cases, computed two runs at a time as ``make verify`` does; a failed run is found by the judge."""
    with pytest.raises(SystemExit):
        main(["run", "--tier", "quick", "--jobs", "2", "--out", str(OUT)])
    return OUT


@pytest.mark.parametrize("name", list_cases())
def test_case_is_within_tolerance(name, results):
    entry = compare(load_case(name, tier="quick"), "quick", results)
    failed = [
        f"{check['metric']} of {check['run']} against {check['against']}: {check['value']}, error {check['error']}, "
        f"limit {check['limit']}, {check['verdict']}"
        for check in entry["checks"]
        if check["gate"] and check["verdict"] not in ("PASS", "NEEDS_RECORD")
    ]
    assert not failed, "; ".join(failed)
    if entry["verdict"] == "NEEDS_RECORD":
        pytest.skip("needs the record of a measured motion")
    assert entry["verdict"] == "PASS"
