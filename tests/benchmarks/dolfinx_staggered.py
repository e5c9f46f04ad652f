"""The finite element reference beside a staggered loop on dolfinx, same mesh, increments and iterations, in one run.

    apt install python3-dolfinx                          # Debian 12, Ubuntu 24.04
    python tests/benchmarks/dolfinx_staggered.py --python /usr/bin/python3

The case is ``sen_tension`` on uniform quads, with the notch's doubled nodes; `dolfinx_loop.py` writes its equations in
UFL. An iteration is an equilibrium by Newton's method and a phase field. Seconds are the processor's, on one thread; the
first load is not counted, since the factors' pattern is analysed in it. Leaves ``benchmarks/dolfinx.csv``.
"""

import argparse
import json
import os
import subprocess
import time
from pathlib import Path

LOOP = Path(__file__).with_name("dolfinx_loop.py")
WHOLE = {"lower": [0.0, 0.0], "upper": [1.0, 1.0]}


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=200, help="cells along an edge of the plate")
    parser.add_argument("--iterations", type=int, default=4, help="staggered iterations per increment")
    parser.add_argument("--loads", type=float, nargs="+", default=[0.003, 0.004, 0.005, 0.0054], help="u [mm]")
    parser.add_argument("--tolerance", type=float, default=1e-4, help="of the residual, over the forces")
    parser.add_argument("--python", default="/usr/bin/python3", help="a Python that has dolfinx")
    parser.add_argument("--out", type=Path, default=Path("reports/out"))
    return parser.parse_args()


def ours(elements: "FiniteElements", case: "Case", loads: list[float]) -> list[dict[str, float]]:
    elements.warm_up()
    rows = []
    for u in loads:
        before, started = elements.costs.count["newton"], time.process_time()
        outcome = staggered_step(elements, case, u)
        seconds = time.process_time() - started
        elements.commit(outcome.history_field)
        newton = elements.costs.count["newton"] - before
        rows.append({"u": u, "F": elements.reaction_force(u), "seconds": seconds, "newton": newton})
    return rows


def theirs(elements: "FiniteElements", asked: argparse.Namespace, folder: Path) -> list[dict[str, float]]:
    case, material = elements.case, elements.case.materials["steel"]
    fracture = material.fracture
    np.savez(
        folder / "dolfinx.npz", nodes=elements.basis.nodes, cells=elements.basis.elements, loads=np.array(asked.loads),
        iterations=asked.iterations, residual_tolerance=asked.tolerance, young=material.young, poisson=material.poisson,
        thickness=case.plane.thickness, toughness=fracture.toughness, length_scale=fracture.length_scale,
        residual_stiffness=fracture.residual_stiffness,
    )  # fmt: skip
    subprocess.run([asked.python, LOOP, folder / "dolfinx.npz", folder / "dolfinx.json"], check=True)
    rows: list[dict[str, float]] = json.loads((folder / "dolfinx.json").read_text(encoding="utf-8"))
    return rows


if __name__ == "__main__":
    asked = arguments()
    for name in ("NUMBA_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"
    import numpy as np
    import pandas as pd

    from cases import Case, load_case
    from fem_reference.quasi_static.solver import FiniteElements
    from numerics.staggered import staggered_step
    from reports import style

    folder = asked.out / "benchmarks"
    folder.mkdir(parents=True, exist_ok=True)
    change = {"mesh": {"h": 1.0 / asked.cells, "fine": WHOLE, "under_resolved": True}}
    change["staggered"] = {"scheme": "passes", "passes": asked.iterations, "residual_tolerance": asked.tolerance}
    case = load_case("sen_tension", "standard", "fem", change)
    elements = FiniteElements(case)
    rows, others = ours(elements, case, asked.loads), theirs(elements, asked, folder)
    for row, other in zip(rows, others, strict=True):
        row |= {f"{name}_dolfinx": other[name] for name in ("F", "seconds", "newton")}
    table = pd.DataFrame(rows)
    table["ratio"] = table["seconds_dolfinx"] / table["seconds"]
    table["difference"] = table["F"] / table["F_dolfinx"] - 1.0
    print(table.to_string(index=False))
    counted = table.iloc[1:]
    print(f"ratio of all but the first: {counted['seconds_dolfinx'].sum() / counted['seconds'].sum():.2f}")
    print(f"Table: {folder / style.save_data(table, folder, 'dolfinx')}")
