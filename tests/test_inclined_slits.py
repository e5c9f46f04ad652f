"""Slits at an angle to the grid of quasi-static material points: force, faces, uniform fields, and what is refused."""

from typing import Any

import numpy as np
import pandas as pd
import pytest

from cases import CaseError, case_from_tables
from cases.notches import SlitNotch
from mpm import MaterialPoints
from mpm.grid import Grid
from numerics.fields import Fields
from verify.health import health
from verify.runs.running import DISCRETISATIONS, solver_records

Tables = dict[str, Any]


def ends(angle: float, length: float = 0.4, middle: tuple[float, float] = (0.5, 0.5)) -> tuple[list[float], list[float]]:
    half = 0.5 * length * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    return (middle - half).tolist(), (middle + half).tolist()


EDGE = {"edge, 30 degrees": ([0.0, 0.4], [0.3464, 0.6]), "edge, 45 degrees": ([0.0, 0.35], [0.3, 0.65])}
CENTRE = {f"centre, {angle} degrees": ends(angle) for angle in (15, 60, -30)}


def plate(*slits: Any, order: int = 1, scale: float = 1.0, **changes: Any) -> Tables:
    """A square clamped below and above, where it is moved, with slits from place to place."""
    notches = [slit if isinstance(slit, dict) else {"kind": "slit", "start": slit[0], "end": slit[1]} for slit in slits]
    return {
        "title": "Plate", "requirement": "Both solvers give one force.", "units": {"length": "mm", "force": "kN"},
        "plane": {"assumption": "strain", "thickness": 1.0}, "materials": {"m": {"young": 210.0, "poisson": 0.3}},
        "bodies": {"plate": {"material": "m", "shape": {"rectangle": {"lower": [0, 0], "upper": [1, 1]}}}},
        "notches": notches,
        "constraints": [
            *({"on": edge, "direction": d, "value": 0} for edge, d in (("bottom", "x"), ("bottom", "y"), ("top", "x"))),
            {"on": "top", "direction": "y", "scale": scale},
        ],
        "load": {"path": [0.0, 1e-3], "increment": 1e-3}, "mesh": {"h": 0.05}, "mpm": {"order": order},
        "runs": {"fem": {"solver": "fem"}, "mpm": {"solver": "mpm"}},
    } | changes  # fmt: skip


def solved(tables: Tables, solver: str = "mpm") -> tuple[float, Fields, dict[str, float]]:
    """Force at the end, fields and health record."""
    case = case_from_tables(tables, run=solver)
    discretisation = DISCRETISATIONS[solver](case)
    *_, last = solver_records(discretisation, case)
    assert last.is_good
    fields = discretisation.fields()
    return last.row()["F"], fields, health(case, pd.DataFrame(), fields, {})


def finer(tables: Tables, h: float = 0.02) -> float:
    """Force of fine triangles along the slit."""
    return solved(tables | {"mesh": {"h": h, "element": "triangle"}}, "fem")[0]


@pytest.mark.parametrize("slit", [*CENTRE.values(), *EDGE.values()], ids=[*CENTRE, *EDGE])
def test_the_force_is_that_of_elements_along_the_slit(slit):
    fine = finer(plate(slit))
    for order, limit in ((1, 0.025), (2, 0.01)):
        force, _, record = solved(plate(slit, order=order))
        assert force == pytest.approx(fine, rel=limit)
        assert abs(force / fine - 1.0) < max(0.01, record["coarse_tips"])


def test_triangles_along_an_inclined_slit_are_told_to_be_too_coarse_where_the_solvers_part():
    slit = ends(30)
    apart = solved(plate(slit) | {"mesh": {"h": 0.05, "element": "triangle"}}, "fem")
    assert abs(apart[0] / solved(plate(slit, order=2))[0] - 1.0) > 0.02
    assert apart[2]["coarse_tips"] > 0.03


@pytest.mark.parametrize("order", [1, 2])
def test_faces_at_an_angle_press_on_each_other(order):
    slit = ends(30)
    pressed = plate(slit, order=order, scale=-1.0)
    force, _, record = solved(pressed)
    assert force == pytest.approx(finer(pressed), rel=0.01)
    assert record["face_overlap"] < 0.005
    free = pressed | {"notches": [{**pressed["notches"][0], "contact": False}]}
    assert solved(free)[2]["face_overlap"] > 0.3


def test_pressure_acts_on_both_faces_at_an_angle():
    slit = ends(45)
    loaded = plate(slit, order=2) | {
        "boundaries": {"faces": {"segment": list(slit)}},
        "tractions": [{"on": "faces", "pressure": 0.1, "ramp": "load"}],
        "constraints": [{"on": edge, "direction": d, "value": 0} for edge in ("bottom", "top") for d in "xy"],
        "load": {"path": [0.0, 1.0], "increment": 1.0},
    }
    assert solved(loaded)[0] == pytest.approx(finer(loaded, 0.0125), rel=0.03)


@pytest.mark.parametrize("slit", [ends(30), EDGE["edge, 30 degrees"]])
def test_a_slit_along_the_pull_leaves_a_uniform_stress(slit):
    along = SlitNotch(kind="slit", start=tuple(slit[0]), end=tuple(slit[1])).direction
    stress = np.outer(along, along)
    normals = {"left": (-1, 0), "right": (1, 0), "bottom": (0, -1), "top": (0, 1)}
    tables = plate(slit) | {
        "boundaries": {"origin": {"point": [0, 0]}, "corner": {"point": [1, 0]}},
        "tractions": [{"on": e, "value": (stress @ n).tolist(), "ramp": "load"} for e, n in normals.items()],
        "constraints": [
            {"on": on, "direction": d, "value": 0} for on, d in (("origin", "x"), ("origin", "y"), ("corner", "y"))
        ],
        "load": {"path": [0.0, 1e-3], "increment": 1e-3}, "mesh": {"h": 0.1},
    }  # fmt: skip
    expected = 1e-3 * np.array([stress[0, 0], stress[1, 1], stress[0, 1]])
    assert np.allclose(solved(tables)[1].stress, expected, atol=1e-8)


@pytest.mark.parametrize("order", [1, 2])
def test_a_rigid_rotation_gives_no_force(order):
    points = MaterialPoints(case_from_tables(plate(ends(30), order=order), run="mpm"))
    points.begin_step()
    nodes = points.basis.grid.nodes
    points.trial.increment = 1e-3 * np.column_stack([-nodes[:, 1], nodes[:, 0]])
    points._evaluate_stresses()
    assert np.abs(points.trial.stress).max() < 1e-10
    turned = 1e-3 * np.column_stack([-points.state.positions[:, 1], points.state.positions[:, 0]])
    assert np.allclose(points.basis.displacement(points.trial.increment), turned, atol=1e-15)


def test_each_side_has_functions_of_its_own_up_to_the_tips():
    tables = plate(ends(30), order=2)
    points = MaterialPoints(case_from_tables(tables, run="mpm"))
    points.begin_step()
    grid, volume = points.basis.grid, points.basis.cloud.volume
    assert volume.sum() == pytest.approx(1.0)
    opened = np.zeros(grid.n_nodes)
    opened[len(np.unique(grid.node_number)) :] = 1.0
    value = (points.basis.own_value * opened[points.basis.active.nodes_of_points()]).sum(axis=1)
    along, aside = SlitNotch.model_validate(tables["notches"][0]).coordinates(points.basis.cloud.positions)
    near = np.abs(aside) < 0.02
    beside = near & (along > 0.1) & (along < 0.3)
    assert np.allclose(value[beside], aside[beside] > 0.0)
    assert np.allclose(value[near & ((along < -0.01) | (along > 0.41))], 0.0, atol=1e-12)


def test_a_slit_that_is_level_but_for_rounding_is_level():
    level, turned = (solved(plate(ends(angle), order=2))[0] for angle in (0.0, 1e-9))
    assert turned == pytest.approx(level, rel=1e-9)
    assert not Grid(case_from_tables(plate(ends(1e-9)), run="mpm")).inclined


def test_a_checkpoint_holds_the_sides():
    case = case_from_tables(plate(ends(30)), run="mpm")
    first, second = MaterialPoints(case), MaterialPoints(case)
    first.begin_step()
    first.solve_displacement(1e-3, 1e-8)
    first.commit(first.history_field)
    second.restore(first.checkpoint())
    for points in (first, second):
        points.begin_step()
        points.solve_displacement(2e-3, 1e-8)
    assert second.reaction_force(3e-3) == pytest.approx(first.reaction_force(3e-3), rel=1e-12)


ACROSS = {"start": [0.35, 0.7], "end": [0.65, 0.3]}
BOX = {"lower": [0.0, 0.0], "upper": [1.0, 1.0]}
REFUSED: dict[str, tuple[Tables, str, Tables]] = {
    "crossing": (
        plate(ends(30, 0.6), tuple(ACROSS.values())),
        r"meets the slit from \[0\.35, 0\.7\].*can meet no other.*with a width of 0\.15",
        {"notches": [*plate(ends(30, 0.6))["notches"], {"kind": "cells", "width": 0.15, **ACROSS}]},
    ),
    "near": (
        plate(ends(30), ends(30, middle=(0.5, 0.56))), r"nearer to each other .* make mesh\.h smaller",
        {"mesh": {"h": 0.0125}},
    ),
    "few points": (
        plate(ends(30), order=3), r"mpm\.points_per_cell = 2: .* too few points .* order 3; set mpm\.points_per_cell = 3",
        {"mpm": {"order": 3, "points_per_cell": 3}},
    ),
    "following": (
        plate(ends(30), mesh={"h": 0.05, "fine": BOX, "follow_crack": True}),
        r"mesh\.follow_crack: .*; leave follow_crack out",
        {"mesh": {"h": 0.05, "fine": BOX}},
    ),
}  # fmt: skip


@pytest.mark.parametrize(("tables", "sentence", "remedy"), REFUSED.values(), ids=REFUSED)
def test_what_a_slit_at_an_angle_cannot_do_is_refused_with_a_remedy(tables, sentence, remedy):
    with pytest.raises(CaseError, match=sentence):
        DISCRETISATIONS["mpm"](case_from_tables(tables, run="mpm"))
    DISCRETISATIONS["mpm"](case_from_tables({**tables, **remedy}, run="mpm"))
