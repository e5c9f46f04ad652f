"""Every case of the library, quick tier: run by both solvers, judged by its own checks."""

import pytest

from cases import list_cases, load_case
from verify import compare, run


@pytest.mark.parametrize("name", list_cases())
def test_case_is_within_tolerance(name, tmp_path_factory):
    out = tmp_path_factory.mktemp("library")
    case = load_case(name, tier="quick")
    for run_name in case.expanded_runs():
        run(case, run_name, "quick", out)
    entry = compare(case, "quick", out)
    failed = [
        f"{check['metric']} of {check['run']} against {check['against']}: {check['value']}, error {check['error']}, "
        f"limit {check['limit']}, {check['verdict']}"
        for check in entry["checks"]
        if check["gate"] and check["verdict"] != "PASS"
    ]
    assert not failed, "; ".join(failed)
    assert entry["verdict"] == "PASS"
