"""Many steps in one compiled call end where steps one by one do."""

import numpy as np
import pytest
from numba import njit

from cases import Case, case_from_tables
from mpm import ExplicitMaterialPoints
from mpm.explicit.listed_arrays import TOUCHING, ListedArrays, Touching, group
from numerics.explicit import instants

SIZE = 0.02


def square(left: float, bottom: float = 0.0, **more) -> dict:
    """A square of side one with its lower left corner at a place."""
    lower = [left, bottom]
    return {"material": "soft", "shape": {"rectangle": {"lower": lower, "upper": [left + 1.0, bottom + 1.0]}}, **more}


FLOOR = {"material": "soft", "rigid": True, "shape": {"rectangle": {"lower": [-1.0, -1.0], "upper": [3.0, 0.0]}}}
PUSHED = {"a": square(0.0, velocity=[0.3, 0.0]), "b": square(1.1)}
HELD = [{"on": "left", "direction": "x", "table": [[0.0, 0.0], [1.0, 0.1], [9.0, 0.0]]}]
SETTLING = {"duration": 0.5, "ramp": 0.2, "damping": 1.0}
#: bodies of each scene, and what else acts
SCENES = {
    "alone": ({"a": square(0.0, velocity=[0.5, 0.2])}, {}),
    "pulled by a line": ({"a": square(0.0)}, {"constraints": HELD}),
    "leaves its line": (
        {"a": square(0.0, velocity=[0.4, 0.0])}, {"constraints": [{"on": "left", "direction": "y", "value": 0.0}]}
    ),
    "strains last": (PUSHED, {"dynamics": {"order_of_update": "musl"}}),
    "damped on a floor": (
        {"a": square(0.0), "floor": FLOOR},
        {"dynamics": {"gravity": [0.01, -0.1], "affine": True, "settling": SETTLING}},
    ),
    "three in a row": (PUSHED | {"c": square(2.2)}, {"contact": {"friction": 0.3}}),
    "a rigid one falls": (
        {"a": square(0.0, 0.1, rigid="free"), "b": square(1.5), "floor": FLOOR},
        {"dynamics": {"gravity": [0.0, -0.3]}, "contact": {"friction": 0.4}},
    ),
}  # fmt: skip


def case_of(name: str) -> Case:
    bodies, more = SCENES[name]
    tables = {
        "title": "t", "requirement": "r", "units": {"length": "mm", "force": "kN", "time": "ms"},
        "plane": {"assumption": "strain"}, "materials": {"soft": {"young": 1.0, "poisson": 0.3, "density": 1.0}},
        "bodies": bodies, "mesh": {"h": 0.25}, "mpm": {"placement": "regular", "points_per_cell": 3},
        "runs": {"mpm": {"solver": "mpm"}}, **more,
        "dynamics": {"end_time": 4.0, "time_step": SIZE} | more.get("dynamics", {}),
    }  # fmt: skip
    return case_from_tables(tables, "standard", "mpm")


def solver_of(case: Case, compiled: bool) -> ExplicitMaterialPoints:
    """That takes many steps in one call, or one by one in Python."""
    solver = ExplicitMaterialPoints(case)
    assert solver._march is not None
    if not compiled:
        solver._march = None
    return solver


def end_of(case: Case, compiled: bool) -> tuple[dict[str, np.ndarray], ExplicitMaterialPoints]:
    """What there is after all steps."""
    solver = solver_of(case, compiled)
    list(instants(solver, case))
    return solver.checkpoint(), solver


@pytest.mark.parametrize("name", [name for name in SCENES if name != "leaves its line"])
def test_compiled_steps_end_at_the_same_bits(name):
    case = case_of(name)
    (expected, one_by_one), (found, at_once) = end_of(case, False), end_of(case, True)
    assert found.keys() == expected.keys()
    for array in found:
        np.testing.assert_array_equal(found[array], expected[array], err_msg=array)
    assert at_once.contact.violations == one_by_one.contact.violations
    assert at_once.costs.count["compiled_steps"] == at_once.costs.count["steps"] > 100
    assert one_by_one.costs.count["compiled_steps"] == 0
    if len(at_once.bodies) > 1:
        assert at_once.contact.violations["contact_nodes"] > 0, "or the scene compares nothing"


def test_a_line_that_loses_its_body_in_the_middle_of_a_call_is_told_with_its_step():
    case, ends = case_of("leaves its line"), []
    for compiled in (False, True):
        solver = solver_of(case, compiled)
        ends.append(list(instants(solver, case))[-1])
    assert "is left on the line" in ends[1].reason
    assert ends[0].reason == ends[1].reason and ends[0].balance == ends[1].balance


def test_a_group_holds_the_arrays_that_were_listed():
    """Whole numbers, truth values and two rows, in the second row of the table."""

    @njit
    def read(arrays):
        touching = group(TOUCHING, arrays, 1)
        touching.pushes[2] = 7.0
        return touching

    pairs = [Touching.room(3), Touching.room(4)]
    pairs[1].nodes[1, 3], pairs[1].normal[0, 1], pairs[1].opposed[2] = 5, 0.5, True
    found = read(ListedArrays.of(pairs))
    assert pairs[1].pushes[2] == 7.0
    for array, expected in zip(found, pairs[1], strict=True):
        np.testing.assert_array_equal(array, expected)
