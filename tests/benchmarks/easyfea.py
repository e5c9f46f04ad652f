"""The finite element reference beside EasyFEA (pip install '.[easyfea]'), in one process, on one mesh and in turn.

    python tests/benchmarks/easyfea.py                   # seconds per staggered iteration, same mesh and iterations
    python tests/benchmarks/easyfea.py --answer          # seconds until the load falls: EasyFEA converged on uniform
                                                         # quads, the reference with the savings of its plan

The case is ``sen_tension`` on uniform quads. EasyFEA's iteration is one phase field and one linear displacement solve;
the reference's is one phase field and an equilibrium by Newton's method. Both use PARDISO on the same threads.
Leaves ``benchmarks/easyfea.csv`` or ``easyfea_answer.csv``.
"""

import argparse
import os
import time
from pathlib import Path

WHOLE = {"lower": [0.0, 0.0], "upper": [1.0, 1.0]}


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=250, help="cells along an edge of the plate")
    parser.add_argument("--iterations", type=int, default=4, help="staggered iterations per increment")
    parser.add_argument("--loads", type=float, nargs="+", default=[0.003, 0.005, 0.0054], help="displacements [mm]")
    parser.add_argument("--answer", action="store_true", help="compare the time to the same peak instead")
    parser.add_argument("--step", type=float, default=2e-5, help="EasyFEA's increment near the peak [mm], --answer")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("reports/out"))
    return parser.parse_args()


def peer(elements: "FiniteElements") -> tuple["Simulations.PhaseField", "Models.PhaseField"]:
    """EasyFEA's simulation on the mesh of the reference, with the same law: spectral split, history field."""
    material = elements.case.materials["steel"]
    coordinates = np.column_stack([elements.basis.nodes, np.zeros(len(elements.basis.nodes))])
    group = GroupElemFactory.Create(ElemType.QUAD4, elements.basis.elements, coordinates)
    law = Models.Elastic.Isotropic(
        2, E=material.young, v=material.poisson, planeStress=False, thickness=elements.case.plane.thickness
    )
    # its length is that of phi² / (2 l) + l |grad phi|² / 2
    model = Models.PhaseField(law, "Miehe", "AT2", material.fracture.toughness, 2.0 * material.fracture.length_scale)
    simulation = Simulations.PhaseField(Mesh({ElemType.QUAD4: group}), model)
    simulation.solver = "pypardiso"
    return simulation, model


def prescribe(simulation: "Simulations.PhaseField", y: "np.ndarray", u: float) -> None:
    """The bottom is held, the top lifted by u."""
    simulation.Bc_Init()
    bottom, top = np.flatnonzero(np.isclose(y, 0.0)), np.flatnonzero(np.isclose(y, 1.0))
    simulation.add_dirichlet(bottom, [0.0, 0.0], ["x", "y"], problemType=simulation.ProblemTypes.elastic)
    simulation.add_dirichlet(top, [u], ["y"], problemType=simulation.ProblemTypes.elastic)


def force(simulation: "Simulations.PhaseField", y: "np.ndarray") -> float:
    """Sum of the internal forces at the top."""
    stiffness = simulation.Get_K_C_M_F(simulation.ProblemTypes.elastic)[0]
    internal = stiffness @ simulation.displacement
    return float(internal[2 * np.flatnonzero(np.isclose(y, 1.0)) + 1].sum())


def uniform(asked: argparse.Namespace) -> "Case":
    change = {"mesh": {"h": 1.0 / asked.cells, "fine": WHOLE, "under_resolved": True}}
    # an equilibrium as loose as the one linear solve of the peer
    change["staggered"] = {"scheme": "passes", "passes": asked.iterations, "residual_tolerance": 1e-2}
    return load_case("sen_tension", "standard", "fem", change)


def iterations_in_turn(asked: argparse.Namespace) -> "pd.DataFrame":
    """Same mesh, same loads, same number of staggered iterations; the first load of each is not counted."""
    case = uniform(asked)
    elements = FiniteElements(case)
    elements.warm_up()
    simulation, _ = peer(elements)
    y, rows = elements.basis.nodes[:, 1], []
    for u in asked.loads:
        started = time.perf_counter()
        outcome = staggered_step(elements, case, u)
        ours = time.perf_counter() - started
        elements.commit(outcome.history_field)
        prescribe(simulation, y, u)
        started = time.perf_counter()
        simulation.Solve(tolConv=1e-300, maxIter=asked.iterations)
        theirs = time.perf_counter() - started
        simulation.Save_Iter()
        row = {"u_mm": u, "iterations": asked.iterations}
        row |= {"F_kN": elements.reaction_force(u), "F_easyfea_kN": force(simulation, y)}
        row |= {"s_per_iteration": ours / asked.iterations, "s_per_iteration_easyfea": theirs / asked.iterations}
        row |= {"ratio": theirs / ours, "difference": row["F_kN"] / row["F_easyfea_kN"] - 1.0}
        rows.append(row)
        print(", ".join(f"{name} {value:.5g}" for name, value in row.items()), flush=True)
    return pd.DataFrame(rows)


def same_answer(asked: argparse.Namespace) -> "pd.DataFrame":
    """Seconds until the load falls: EasyFEA's converged staggering on uniform quads, the reference as planned."""
    elements = FiniteElements(uniform(asked))
    simulation, _ = peer(elements)
    y, forces, iterations = elements.basis.nodes[:, 1], [0.0], 0
    started = time.perf_counter()
    for u in np.concatenate([np.arange(0.0005, 0.00501, 0.0005), np.arange(0.005, 0.0065, asked.step)[1:]]):
        prescribe(simulation, y, float(u))
        simulation.Solve(tolConv=1e-5, convOption=0, maxIter=500)
        simulation.Save_Iter()
        iterations += simulation._PhaseField__Niter
        forces.append(force(simulation, y))
        print(f"EasyFEA u {u:.5g} F {forces[-1]:.5g}, {iterations} iterations", flush=True)
        if forces[-1] < forces[-2]:
            break
    theirs = time.perf_counter() - started
    change = {"mesh": {"h": 1.0 / asked.cells, "under_resolved": True}}
    case = load_case("sen_tension", "standard", "fem", change)
    finished = run(case, "fem", out=asked.out, threads=asked.threads, force=True)
    # to the first increment whose load is below the one before, as the peer's
    ours = float(finished.history["seconds"][np.flatnonzero(np.diff(finished.history["F"]) < 0.0)[0] + 1])
    row = {"F_kN": finished.history["F"].max(), "F_easyfea_kN": max(forces), "s": ours, "s_easyfea": theirs}
    row |= {"iterations_easyfea": iterations, "ratio": theirs / ours}
    row |= {"difference": row["F_kN"] / row["F_easyfea_kN"] - 1.0}
    print(row)
    return pd.DataFrame([row])


if __name__ == "__main__":
    asked = arguments()
    for name in ("NUMBA_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ[name] = str(asked.threads)
    import numpy as np
    import pandas as pd
    from EasyFEA import ElemType, Mesh, Models, Simulations
    from EasyFEA.FEM._group_elem import GroupElemFactory

    from cases import Case, load_case
    from fem_reference.quasi_static.solver import FiniteElements
    from numerics.staggered import staggered_step
    from reports import style
    from verify import run

    table = same_answer(asked) if asked.answer else iterations_in_turn(asked)
    name = "easyfea_answer" if asked.answer else "easyfea"
    print(f"Table: {asked.out / 'benchmarks' / style.save_data(table, asked.out / 'benchmarks', name)}")
