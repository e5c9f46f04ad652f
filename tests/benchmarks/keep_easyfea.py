"""Keep EasyFEA's result of a library case beside it as ``easyfea.csv``, a curve that its checks refer to.

    python tests/benchmarks/keep_easyfea.py sen_tension quick
"""

from __future__ import annotations

import sys
from datetime import date
from importlib.metadata import version
from pathlib import Path

from cases import load_case
from cases.copies import write_copy
from cases.loader import read_tables
from verify import RunFolder, run
from verify.runs.atomic import write_text
from verify.runs.kept import reduced


def solved(name: str, tier: str, out: Path) -> RunFolder:
    """The run of a case by EasyFEA under ``out``, of a copy of the case that names it."""
    case = load_case(name, tier)
    tables = read_tables(case.source)
    tables["runs"] = {**tables["runs"], "easyfea": {"solver": "easyfea"}}
    return run(write_copy(case, out / "cases", tables), "easyfea", tier, out)


def keep(name: str, tier: str, made: RunFolder) -> Path:
    """Write its curve beside the case of the library and return the file."""
    history = made.history[["u", "F"]].copy()
    kept = reduced(history.assign(step=range(len(history))))[["u", "F"]]
    head = (
        f"# EasyFEA {version('EasyFEA')} by verify/runs/easyfea.py on the mesh of our finite elements, tier {tier}\n"
        f"# version {made.info['code_version']}, {date.today()}, {made.info['processor']},"
        f" {len(kept)} of {len(history)} rows\n"
    )
    file = load_case(name).folder / "easyfea.csv"
    write_text(file, head + kept.to_csv(index=False, float_format="%.6g", lineterminator="\n"))
    return file


if __name__ == "__main__":
    case_name, case_tier = sys.argv[1:]
    print(keep(case_name, case_tier, solved(case_name, case_tier, Path("reports/out/easyfea"))))
