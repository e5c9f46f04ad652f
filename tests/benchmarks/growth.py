"""How the cost of a staggered iteration grows with the number of unknowns, for both solvers.

    python tests/benchmarks/growth.py --out reports/out

Runs ``sen_tension`` on uniform cells up to where the crack begins, with a fixed number of passes, and fits
seconds = constant * unknowns^exponent. Leaves ``benchmarks/growth.csv`` and ``growth.svg``; compilation and set-up are
left out of the seconds. The largest size takes some GB and minutes.
"""

import argparse
import os
from pathlib import Path

from cases.solvers import SOLVERS

SIZES = (57, 100, 180, 320, 577)
WHOLE = {"lower": [0.0, 0.0], "upper": [1.0, 1.0]}
LOAD = {"path": [0.0, 0.0055], "increment": 0.0011, "adaptive": False, "smallest": 0.0011}


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, nargs="+", default=SIZES, help="cells along an edge of the plate")
    parser.add_argument("--passes", type=int, default=2, help="passes per increment")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("reports/out"))
    return parser.parse_args()


def measured(asked: argparse.Namespace) -> "pd.DataFrame":
    """A row for each solver and size."""
    rows = []
    for solver in ("fem", "mpm"):
        for cells in asked.cells:
            change = {
                "mesh": {"h": 1.0 / cells, "fine": WHOLE},
                "staggered": {"scheme": "passes", "passes": asked.passes},
                "load": LOAD,
                "materials": {"steel": {"fracture": {"length_scale": 1.0 / min(asked.cells)}}},
            }
            case = load_case("sen_tension", "standard", solver, change)
            finished = run(case, solver, out=asked.out, threads=asked.threads, force=True)
            counters, seconds = finished.info["counters"], finished.info["seconds"]
            unknowns = counters["unknowns_displacement"] + counters["unknowns_phase_field"]
            iterations = counters["staggered_iterations"]
            row = {"solver": solver, "cells_along_edge": cells, "unknowns": unknowns, "iterations": iterations}
            row |= {"newton": counters["newton"], "seconds_per_iteration": seconds["increments"] / iterations}
            row |= {"memory_mb": finished.info["memory_mb"], "threads": asked.threads}
            rows.append(row)
            print(row, flush=True)
    return pd.DataFrame(rows)


def draw(table: "pd.DataFrame", folder: Path) -> None:
    """Seconds over unknowns, with the fitted exponents in the legend."""
    figure, axes = style.curve_axes(5.6, 4.0, "unknowns", "seconds per staggered iteration")
    axes.set(xscale="log", yscale="log")
    for colour, (solver, part) in zip(style.OKABE_ITO, table.groupby("solver"), strict=False):
        exponent, constant = np.polyfit(np.log(part["unknowns"]), np.log(part["seconds_per_iteration"]), 1)
        label = f"{SOLVERS[solver].title}: exponent {exponent:.2f}"
        axes.plot(part["unknowns"], part["seconds_per_iteration"], "o", color=colour, label=label)
        fitted = np.exp(constant) * part["unknowns"] ** exponent
        axes.plot(part["unknowns"], fitted, SOLVERS[solver].line, color=colour)
        print(label)
    axes.legend()
    style.save(figure, folder, "growth")


if __name__ == "__main__":
    asked = arguments()
    for name in ("NUMBA_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ[name] = str(asked.threads)
    import numpy as np
    import pandas as pd

    from cases import load_case
    from reports import style
    from verify import run

    found = measured(asked)
    home = asked.out / "benchmarks"
    style.save_data(found, home, "growth")
    with style.drawing_style():
        draw(found, home)
    print(f"Table and figure: {home / 'growth.csv'}, {home / 'growth.svg'}")
