"""Material points that a processor moves in a second in small explicit scenes, beside another copy of this repository.

    python tests/benchmarks/small_steps.py --against ../other --out reports/out

Each scene is integrated by its solver, with nothing told in between, in processes of their own that take turns between
the copies; the best of the rounds counts, and compilation is left out. Leaves ``benchmarks/small_steps.csv``.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

#: case, tier and run
SCENES = (
    ("rocking_pulse", "quick", "one_impact"), ("rocking_pulse", "paper", "one_impact"),
    ("vibrating_bar", "quick", "musl"), ("vibrating_bar", "quick", "affine"),
    ("ring_collision", "quick", "case_i"), ("free_square", "paper", "usl"),
)  # fmt: skip
#: cells across the free square, of 3 x 3 points each
SQUARE = 42
#: point-steps of a measurement, after as many that do not count
POINT_STEPS = 4_000_000


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, help="another copy of the repository")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("reports/out"))
    parser.add_argument("--measure", action="store_true", help=argparse.SUPPRESS)
    return parser.parse_args()


def measure() -> dict[str, tuple[int, float]]:
    """Points and processor seconds of a step of each scene, by the code of the present folder."""
    import numpy as np

    from cases import load_case
    from mpm import ExplicitMaterialPoints
    from numerics.time_steps import step_size

    found = {}
    for name, tier, run in SCENES:
        if name == "free_square":
            case = load_case(name, "standard", "usl[h=6.25]", {"mesh": {"h": 100.0 / SQUARE}})
        else:
            case = load_case(name, tier, run)
        solver, size = ExplicitMaterialPoints(case), step_size(case, ExplicitMaterialPoints(case).stable_step())
        solver.warm_up()
        n_points = len(solver.cloud.positions)
        steps = max(20, POINT_STEPS // n_points)
        times = case.dynamics.start_time + size * np.arange(2 * steps)
        for part in (times[:steps], times[steps:]):
            started, done = time.process_time(), 0
            while done < steps:
                if hasattr(solver, "steps"):
                    done += solver.steps(part[done : done + 50], size)
                else:
                    solver.step(part[done], size)
                    done += 1
        found[f"{name} {run}, {n_points} points"] = (n_points, (time.process_time() - started) / steps)
    return found


def of_copy(folder: Path) -> dict[str, tuple[int, float]]:
    """`measure` in a process of its own."""
    environment = os.environ | {"PYTHONPATH": str(folder.resolve())}
    command = [sys.executable, str(Path(__file__).resolve()), "--measure"]
    printed = subprocess.run(command, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout
    return json.loads(printed.splitlines()[-1])


if __name__ == "__main__":
    asked = arguments()
    for name in ("NUMBA_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, str(asked.threads))
    if asked.measure:
        print(json.dumps(measure()))
        sys.exit()
    import pandas as pd

    from reports import style

    rows = []
    for number in range(asked.rounds):
        for folder in filter(None, (Path(), asked.against)):
            for scene, (n_points, seconds) in of_copy(folder).items():
                copy = "this one" if folder == Path() else "the other one"
                row = {"scene": scene, "copy": copy, "round": number, "points": n_points}
                rows.append(row | {"seconds_per_step": seconds})
    table = pd.DataFrame(rows).groupby(["scene", "copy", "points"], as_index=False)["seconds_per_step"].min()
    table["million_point_steps_per_second"] = table["points"] / table["seconds_per_step"] / 1e6
    print(table.to_string(index=False))
    home = asked.out / "benchmarks"
    print(f"Table: {home / style.save_data(table, home, 'small_steps')}")
