"""The elastic step of explicit material points beside the same scheme in Taichi (pip install taichi), in one process.

    python tests/benchmarks/taichi_elastic.py --out reports/out

A free square flies and deforms: linear elasticity, small strains summed up, FLIP, quadratic splines, 3 x 3 points a
cell, double precision. Each round starts all schemes from the same sorted points and runs them in turn; the fastest
round counts. Ours is the solver's whole step, and the square flies so fast that its points are sorted anew once in a
round. Taichi adds points to nodes by atomic additions, as is usual there, or strip by strip in two colours without
them, and need not sort. All must end at the same velocities.

The memory limit is the bandwidth of a triad (a = b + c s, three numbers counted) over the fewest bytes that a step of a
point can move: what is mapped to the nodes read once, what is updated read and written once, nodes written and read once.
Leaves ``benchmarks/taichi_elastic.csv``; compilation, without caches on disk, is counted apart.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

#: numbers that a step reads or writes: of a point its place, velocity, mass, volume and stress on the way to the nodes;
#: back from them its place, velocity and strain twice, its stress once; mass, momentum, force, velocity and its change
#: of a node twice
NUMBERS_OF_POINT, NUMBERS_OF_NODE = 9 + 17, 18
#: of the largest velocity
LARGEST_DIFFERENCE = 1e-10
OURS = "explicit material points"


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, nargs="+", default=[500_000, 2_300_000], help="about so many")
    parser.add_argument("--steps", type=int, default=100, help="steps in a round")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("reports/out"))
    return parser.parse_args()


def flying_square(n_points: int, steps: int) -> "Case":
    """A square of side one; its points wander about a cell in the steps, so that they are sorted anew once."""
    tables = {
        "title": "Flying square", "requirement": "A step of a free elastic body is fast.",
        "units": {"length": "mm", "force": "N", "time": "us"}, "plane": {"assumption": "strain"},
        "materials": {"glass": {"young": 32000.0, "poisson": 0.2, "density": 2450.0}},
        "bodies": {"square": {
            "material": "glass", "shape": {"rectangle": {"lower": [0.0, 0.0], "upper": [1.0, 1.0]}},
        }},
        "dynamics": {"end_time": 1.0, "rotation": "additive"}, "mesh": {"h": 1.0 / round((n_points / 9.0) ** 0.5)},
        "mpm": {"placement": "regular", "points_per_cell": 3}, "runs": {"mpm": {"solver": "mpm"}},
    }  # fmt: skip
    case = case_from_tables(tables, run="mpm")
    speed = case.mesh.h / (steps * step_size(case, stable_step(case)))
    flight = {"velocity": [speed, 0.5 * speed], "velocity_gradient": [[0.2 * speed, 0.1 * speed], [0.0, -0.2 * speed]]}
    return case_from_tables(tables, run="mpm", change={"bodies": {"square": flight}})


class OurBody:
    """The solver, its only body, and its state at the start of a round."""

    def __init__(self, case: "Case") -> None:
        with compilation() as spent:
            self.solver = ExplicitMaterialPoints(case)
            self.solver.warm_up()
        self.compile_seconds = spent.wall
        self.start = {name: np.array(values) for name, values in self.solver.checkpoint().items()}

    @property
    def body(self) -> "MovingBody":
        return self.solver.bodies[0]

    def load(self) -> None:
        """Go back to the start of a round."""
        self.solver.restore(self.start)

    def step(self, size: float) -> None:
        self.solver.step(0.0, size)

    def velocities(self) -> "np.ndarray":
        """Of the points (n, 2), by their numbers."""
        points, found = self.body.points, np.empty((len(self.body.points.number), 2))
        found[points.number] = np.column_stack([points.motion.vx, points.motion.vy])
        return found


def seconds_of(step: Callable[[float], None], steps: int, size: float) -> float:
    """Of a step, on the wall's clock."""
    started = time.perf_counter()
    for _ in range(steps):
        step(size)
    taichi.sync()
    return (time.perf_counter() - started) / steps


def bandwidth() -> float:
    """Of a triad on arrays that no cache holds [byte/s]."""
    a, b, c = (np.full(25_000_000, value) for value in (0.0, 1.0, 2.0))
    seconds = []
    for _ in range(4):
        started = time.perf_counter()
        triad(a, b, c, 3.0)
        seconds.append(time.perf_counter() - started)
    return 3 * a.nbytes / min(seconds)


def measured(asked: argparse.Namespace, n_points: int) -> "pd.DataFrame":
    """A row for each scheme."""
    case = flying_square(n_points, asked.steps)
    size, ours = step_size(case, stable_step(case)), OurBody(case)
    schemes = {OURS: ours}
    for name, coloured in (("Taichi, atomic", False), ("Taichi, coloured", True)):
        schemes[name] = TaichiBody(ours.body, coloured)
        schemes[name].compile(size)
    best, fastest = dict.fromkeys(schemes, np.inf), 0.0
    for _ in range(asked.rounds):
        ours.load()
        for name in list(schemes)[1:]:
            schemes[name].load(ours.body)
        fastest = max(fastest, bandwidth())
        for name, scheme in schemes.items():
            best[name] = min(best[name], seconds_of(scheme.step, asked.steps, size))
        check(schemes)
    n, nodes = len(ours.body.points.number), len(ours.body.window.sums.m)
    moved = 8.0 * (NUMBERS_OF_POINT + NUMBERS_OF_NODE * nodes / n)
    rows = []
    for name, scheme in schemes.items():
        row = {"points": n, "threads": asked.threads, "scheme": name, "seconds_per_step": best[name]}
        row |= {"million_point_steps_per_second": n / best[name] / 1e6, "ratio_of_ours": best[name] / best[OURS]}
        row |= {"share_of_memory_limit": moved * n / best[name] / fastest, "compile_seconds": scheme.compile_seconds}
        row |= {"bytes_per_point_step": moved, "bandwidth_GB_per_second": fastest / 1e9}
        rows.append(row)
        print(", ".join(f"{key} {value:.4g}" if key != "scheme" else value for key, value in row.items()), flush=True)
    return pd.DataFrame(rows)


def check(schemes: dict) -> None:
    """All schemes end at the same velocities."""
    expected = schemes[OURS].velocities()
    for name, scheme in schemes.items():
        difference = np.abs(scheme.velocities() - expected).max() / np.abs(expected).max()
        assert difference < LARGEST_DIFFERENCE, (
            f"{name} ends at other velocities than ours: they differ by {difference:.2g} of the largest one, more than"
            f" {LARGEST_DIFFERENCE:g}, so that the schemes are not the same"
        )


if __name__ == "__main__":
    asked = arguments()
    for name in ("NUMBA_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ[name] = str(asked.threads)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["NUMBA_CACHE_DIR"] = folder
        import numpy as np
        import pandas as pd
        import taichi
        from numba import njit, prange
        from taichi_scheme import TaichiBody

        from cases import Case, case_from_tables
        from mpm import ExplicitMaterialPoints
        from mpm.explicit.moving_body import MovingBody
        from mpm.explicit.step_bound import stable_step
        from numerics.compilation import compilation
        from numerics.time_steps import step_size
        from reports import style

        @njit(parallel=True)
        def triad(a: np.ndarray, b: np.ndarray, c: np.ndarray, s: float) -> None:
            for i in prange(len(a)):
                a[i] = b[i] + s * c[i]

        taichi.init(
            arch=taichi.cpu, default_fp=taichi.f64, cpu_max_num_threads=asked.threads, offline_cache=False,
            log_level=taichi.ERROR,
        )  # fmt: skip
        table = pd.concat([measured(asked, n_points) for n_points in asked.points])
    home = asked.out / "benchmarks"
    print(f"Table: {home / style.save_data(table, home, 'taichi_elastic')}")
