"""What is said of layers whose seams cross the cells of material points, and whether it is so."""

import numpy as np
import pytest

from cases import Case, case_from_tables
from numerics.description import remarks
from verify.planning.plan import plan
from verify.runs.running import DISCRETISATIONS, solver_records


def layered(run: str, slope: float, stiffer: float = 10.0, **more: object) -> Case:
    """A block with a soft layer through its middle, two cells thick, pulled apart."""
    half = 0.1 * np.hypot(1.0, slope)
    low, high = ([[x, slope * x + side * half] for x in (-1.0, 1.0)] for side in (-1.0, 1.0))
    parts = {
        "below": ("stiff", [[-1.0, -1.5], [1.0, -1.5], low[1], low[0]]),
        "layer": ("soft", [low[0], low[1], high[1], high[0]]),
        "above": ("stiff", [high[0], high[1], [1.0, 1.5], [-1.0, 1.5]]),
    }
    held = [{"on": on, "direction": "x", "value": 0.0} for on in ("bottom", "top")]
    return case_from_tables(
        {
            "title": "layer", "requirement": "a slanted seam", "units": {"length": "mm", "force": "kN"},
            "plane": {"assumption": "strain"},
            "materials": {"stiff": {"young": stiffer, "poisson": 0.3}, "soft": {"young": 1.0, "poisson": 0.3}},
            "bodies": {name: {"material": of, "shape": {"polygon": {"points": at}}} for name, (of, at) in parts.items()},
            "constraints": [
                *held, {"on": "bottom", "direction": "y", "value": 0.0}, {"on": "top", "direction": "y", "scale": 1.0},
            ],
            "load": {"path": [0.0, 0.01], "increment": 0.01}, "mesh": {"h": 0.1}, "mpm": {"order": 2},
            "runs": {"fem": {"solver": "fem"}, "mpm": {"solver": "mpm"}}, **more,
        },
        run=run,
    )  # fmt: skip


def force(case: Case, solver: str) -> float:
    *_, last = solver_records(DISCRETISATIONS[solver](case), case)
    return last.row()["F"]


def test_a_slanted_layer_is_as_much_too_stiff_as_is_said():
    case, fine = layered("mpm", 0.5), layered("fem", 0.5, mesh={"h": 0.05})
    (said,) = remarks(case)
    share = float(said.split("about ")[1].split(" %")[0]) / 100.0
    assert said.startswith("bodies.layer: its seams cross cells") and ("note", said) in plan(case, "mpm").rows()
    assert share / 2 < force(case, "mpm") / force(fine, "fem") - 1.0 < 2 * share


@pytest.mark.parametrize(("run", "slope", "stiffer"), [("mpm", 0.0, 10.0), ("mpm", 0.5, 1.01), ("fem", 0.5, 10.0)])
def test_nothing_is_said_of_seams_that_the_cells_follow_or_that_hardly_are_any(run, slope, stiffer):
    assert remarks(layered(run, slope, stiffer)) == []


def test_seams_in_a_grid_without_kinks_are_told():
    """A phase field of fourth order leaves the grid smooth, along its lines too."""
    fracture = {"toughness": 0.0027, "length_scale": 0.5, "order": 4}
    materials = {name: {"young": E, "poisson": 0.3, "fracture": fracture} for name, E in (("stiff", 10.0), ("soft", 1.0))}
    (said,) = remarks(layered("mpm", 0.0, materials=materials))
    assert said.startswith("bodies.layer")
