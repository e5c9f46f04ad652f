"""Every case of the library, quick tier: run by both solvers, judged by its own checks."""

import pytest

from cases import list_cases, load_case
from verify import compare
from verify.cli import main


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of all cases, computed two runs at a time as ``make verify`` does; a failed run is found by the judge."""
    out = tmp_path_factory.mktemp("library")
    with pytest.raises(SystemExit):
        main(["run", "--tier", "quick", "--jobs", "2", "--out", str(out)])
    return out


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
