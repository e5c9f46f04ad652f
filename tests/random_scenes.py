"""Scenes drawn by a seeded generator: the two solvers agree, or a run's health record says why it is not to be trusted.

``python -m tests.random_scenes --scenes 40`` draws and judges many, beside a finer mesh; the tests take the first few.
"""

from __future__ import annotations

import argparse
import math
import random
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from cases import case_from_tables
from verify.health import suspicions
from verify.runs import running
from verify.runs.run_folder import RunFolder

Tables = dict[str, Any]
#: how far the solvers may be apart in the force
AGREEMENT = 0.02
H = 0.05


@dataclass(frozen=True)
class Outcome:
    """Forces of the two solvers, and what their health records say."""

    seed: int
    fem: float
    mpm: float
    suspicions: tuple[str, ...]

    @property
    def apart(self) -> float:
        """Difference of the two solvers over the force of the finite elements."""
        return abs(self.fem - self.mpm) / abs(self.fem)

    @property
    def silent(self) -> bool:
        """They are apart and nothing says so."""
        return self.apart > AGREEMENT and not self.suspicions


def scene(seed: int, breaking: bool = False, turned: bool = False) -> Tables:
    """Tables of a plate with shape, notches, supports and load drawn at random; equal seeds, equal scenes.

    turned : slits are at any angle.
    """
    draw = random.Random(seed)
    width, height = draw.choice([1.0, 1.5, 2.0]), draw.choice([1.0, 1.5])
    split = draw.choice(["spectral", "volumetric_deviatoric"])
    fracture = {"fracture": {"toughness": 0.0027, "length_scale": 0.1, "split": split}} if breaking else {}
    pulled, held = draw.choice([("top", "bottom"), ("right", "left")])
    across = "y" if pulled == "top" else "x"
    direction = draw.choice([across, "y" if across == "x" else "x"])
    supports = [{"on": held, "direction": "x", "value": 0}, {"on": held, "direction": "y", "value": 0}]
    guide = "x" if direction == "y" else "y"
    if draw.random() < 0.7:
        supports.append({"on": pulled, "direction": guide, "value": 0})
    tables = {
        "title": f"Scene {seed}",
        "requirement": "Two solvers give one force.",
        "units": {"length": "mm", "force": "kN"},
        "plane": {"assumption": draw.choice(["strain", "stress"]), "thickness": draw.choice([1.0, 2.0])},
        "materials": {"m": {"young": draw.choice([3.0, 210.0]), "poisson": draw.choice([0.0, 0.2, 0.3, 0.4])} | fracture},
        "bodies": {"plate": {"material": "m", "shape": _shape(draw, width, height)}},
        "notches": _notches(draw, width, height),
        "constraints": [*supports, {"on": pulled, "direction": direction, "scale": draw.choice([1.0, 1.0, -1.0])}],
        "load": {"path": [0.0, 0.02 if breaking else 0.001], "increment": 1e-3},
        "mesh": {"h": H},
        "mpm": {"order": draw.choice([1, 2]), "points_per_cell": draw.choice([2, 3])},
        "runs": {"fem": {"solver": "fem"}, "mpm": {"solver": "mpm"}},
    }
    tables = tables if breaking else tables | _loads(random.Random(f"loads {seed}"), tables, pulled)
    return _turned(tables, seed) if turned else tables


def _loads(draw: random.Random, tables: Tables, pulled: str) -> Tables:
    """In half of the scenes a load takes the place of the moved edge, which is free then."""
    kind = draw.choice(["moved", "moved", "moved", "traction", "pressure", "weight", "warm"])
    if kind == "moved":
        return {}
    material = dict(tables["materials"]["m"], expansion=1e-5)
    stress = 1e-3 * material["young"] * draw.choice([1.0, -1.0])
    acting: Tables = {
        "traction": {"tractions": [{"on": pulled, "value": [stress, 0.5 * stress], "ramp": "load"}]},
        "pressure": {"tractions": [{"on": pulled, "pressure": stress, "ramp": "load"}]},
        "weight": {"body_forces": [{"value": [0.5 * stress, stress], "ramp": "load"}]},
        "warm": {"eigenstrains": [{"temperature": draw.choice([100.0, -100.0]), "ramp": "load"}]},
    }[kind]
    supports = [held for held in tables["constraints"] if held["on"] != pulled]
    load = {"path": [0.0, 1.0], "increment": 0.5}
    return acting | {"materials": {"m": material}, "constraints": supports, "load": load}


def _shape(draw: random.Random, width: float, height: float) -> Tables:
    plate = {"rectangle": {"lower": [0.0, 0.0], "upper": [width, height]}}
    kind = draw.choice(["plate", "plate", "window", "corner"])
    if kind == "plate":
        return plate
    size = draw.choice([0.2, 0.3])
    x, y = (round(draw.uniform(0.3, side - 0.3 - size) / H) * H for side in (width, height))
    lower = (x, y) if kind == "window" else (width - size, 0.4)
    upper = (lower[0] + size, lower[1] + size)
    return {"difference": {"of": plate, "minus": [{"rectangle": {"lower": list(lower), "upper": list(upper)}}]}}


def _notches(draw: random.Random, width: float, height: float) -> list[Tables]:
    kind = draw.choice(["none", "slit", "slit", "cells"])
    if kind == "none":
        return []
    y = round(0.5 * height / H) * H
    length = draw.choice([0.2, 0.25]) * width
    notch: Tables = {"kind": kind, "start": [0.0, y], "end": [round(length / H) * H, y]}
    return [notch | ({"width": 2 * H} if kind == "cells" else {})]


def _turned(tables: Tables, seed: int) -> Tables:
    """In place of the scene's slit one at any angle, from the left edge or within the left half of the plate."""
    if [notch["kind"] for notch in tables["notches"]] != ["slit"]:
        return tables
    draw = random.Random(f"slit {seed}")
    notch, angle = tables["notches"][0], math.radians(draw.uniform(-70.0, 70.0))
    (x, y), size = notch["start"], notch["end"][0]
    x += draw.choice([0.0, 0.0, 0.6 * size])
    end = [x + size * math.cos(angle), y + size * math.sin(angle)]
    mesh = tables["mesh"] | {"element": "triangle"}
    return tables | {"mesh": mesh, "notches": [notch | {"start": [x, y], "end": end}]}


def outcome(seed: int, folder: Path, breaking: bool = False, turned: bool = False) -> Outcome:
    """Both solvers on a scene."""
    tables = scene(seed, breaking, turned)
    ran = [_run(tables, solver, folder / solver) for solver in ("fem", "mpm")]
    told = tuple(f"{run.info['run']}: {text}" for run in ran for text in _doubts(run))
    return Outcome(seed, *(_peak(run) for run in ran), told)


def finer(seed: int, folder: Path, breaking: bool = False, turned: bool = False) -> float:
    """Force of finite elements on half of the spacing."""
    tables = scene(seed, breaking, turned)
    return _peak(_run({**tables, "mesh": {**tables["mesh"], "h": 0.5 * H}}, "fem", folder))


def _run(tables: Tables, solver: str, folder: Path) -> RunFolder:
    return running.run(case_from_tables(tables, run=solver), solver, out=folder, threads=1)


def _doubts(run: RunFolder) -> list[str]:
    bad = [] if run.good else [f"{run.info['status']}: {run.info['reason']}"]
    return bad + suspicions(run.info["health"], {})


def _peak(run: RunFolder) -> float:
    return float(run.history["F"].abs().max())


def main() -> None:
    """Draw, judge and print as many scenes as asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--breaking", action="store_true")
    parser.add_argument("--turned", action="store_true", help="slits at any angle")
    asked = parser.parse_args()
    for seed in range(asked.first, asked.first + asked.scenes):
        with TemporaryDirectory() as folder:
            found = outcome(seed, Path(folder), asked.breaking, asked.turned)
            resolved = finer(seed, Path(folder) / "finer", asked.breaking, asked.turned)
        verdict = "SILENT" if found.silent else "suspect" if found.suspicions else "agree"
        numbers = f"fem {found.fem:.5g} mpm {found.mpm:.5g} finer {resolved:.5g} apart {100 * found.apart:.2f} %"
        print(f"{seed}: {verdict}: {numbers} {'; '.join(found.suspicions)}", flush=True)


if __name__ == "__main__":
    main()
