"""Cases as strangers bring them: both solvers give the right value, or one sentence says what to change."""

from __future__ import annotations

from typing import Any

import meshio
import numpy as np
import pandas as pd
import pytest

from cases import Case, CaseError, case_from_tables
from fem_reference.mesh.build import build_mesh
from mpm.grid import Grid
from verify.health import health, suspicions
from verify.runs.running import DISCRETISATIONS, run, solver_records

PLATE: dict[str, Any] = {
    "title": "Plate",
    "requirement": "Both solvers give the right force.",
    "units": {"length": "mm", "force": "kN"},
    "plane": {"assumption": "strain", "thickness": 1.0},
    "materials": {"steel": {"young": 210.0, "poisson": 0.3}},
    "bodies": {"plate": {"material": "steel", "shape": {"rectangle": {"lower": [0, 0], "upper": [2, 1]}}}},
    "boundaries": {"corner": {"point": [1.0, 0.0]}},
    "constraints": [
        {"on": "bottom", "direction": "y", "value": 0},
        {"on": "corner", "direction": "x", "value": 0},
        {"on": "top", "direction": "y", "scale": 1},
    ],
    "load": {"path": [0.0, 0.001], "increment": 1e-3},
    "mesh": {"h": 0.05},
    "mpm": {"order": 1},
    "runs": {"fem": {"solver": "fem"}, "mpm": {"solver": "mpm"}},
}


def plate(solver: str, **changes: Any) -> Case:
    """The elastic plate with other tables."""
    return case_from_tables({**PLATE, **changes}, tier="standard", run=solver)


def force(case: Case, solver: str) -> float:
    """Force at the end of the load path."""
    *_, last = solver_records(DISCRETISATIONS[solver](case), case)
    assert last.is_good
    return last.row()["F"]


def slit(start: float, end: float, y: float = 0.5) -> dict[str, Any]:
    return {"kind": "slit", "start": [start, y], "end": [end, y]}


@pytest.mark.parametrize(
    "notches",
    [
        [slit(0.0, 0.5), slit(1.5, 2.0)],
        [slit(0.25, 0.75), slit(1.25, 1.75)],
        [slit(0.0, 0.5), slit(1.0, 1.25), slit(1.5, 2.0)],
        [slit(0.0, 0.5, 0.25), slit(0.0, 0.5, 0.75)],
        [slit(0.0, 0.5), {"kind": "slit", "start": [1.0, 0.25], "end": [1.0, 0.75]}],
    ],
)
def test_every_slit_is_open_in_both_solvers(notches):
    whole = force(plate("fem"), "fem")
    fem, mpm = (force(plate(solver, notches=notches), solver) for solver in ("fem", "mpm"))
    assert fem < 0.98 * whole
    assert mpm == pytest.approx(fem, rel=5e-3)


def less(cut: dict[str, Any]) -> dict[str, Any]:
    """The plate with a shape cut out."""
    shape = {"difference": {"of": PLATE["bodies"]["plate"]["shape"], "minus": [cut]}}
    return {"plate": {"material": "steel", "shape": shape}}


def window(*corners: float) -> dict[str, Any]:
    """The plate with a rectangle cut out."""
    return less({"rectangle": {"lower": list(corners[:2]), "upper": list(corners[2:])}})


HOLE = less({"disc": {"centre": [1.0, 0.5], "radius": 0.2}})


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    ("bodies", "notches"),
    [
        (window(0.8, 0.3, 1.2, 0.7), [slit(0.5, 0.8), slit(1.2, 1.5)]),
        (HOLE, [slit(0.5, 0.8), slit(1.2, 1.5)]),
        (window(0.0, 0.5, 0.5, 1.0), [slit(0.5, 1.0)]),
        (window(0.0, 0.5, 0.5, 1.0), [slit(0.5, 1.0, 0.75)]),
        (PLATE["bodies"], [{"kind": "cells", "start": [0.0, 0.5], "end": [0.5, 0.5], "width": 0.2}, slit(0.5, 0.75)]),
    ],
    ids=["window", "hole", "corner", "wall", "cells"],
)
def test_a_slit_is_open_where_it_meets_an_edge_within_the_bounding_box(bodies, notches, order):
    changes = {"bodies": bodies, "notches": notches, "mesh": {"h": 0.05}}
    fem, mpm = force(plate("fem", **changes), "fem"), force(plate("mpm", **changes, mpm={"order": order}), "mpm")
    assert mpm == pytest.approx(fem, rel=0.005 if order == 1 else 0.025)


@pytest.mark.parametrize("solver", ["fem", "mpm"])
def test_slits_that_meet_part_a_body_as_one_slit_does(solver):
    with pytest.raises(CaseError, match="a part of plate, cut off from the rest, can move in x freely"):
        DISCRETISATIONS[solver](plate(solver, notches=[slit(0.0, 1.0), slit(1.0, 2.0)]))


def test_a_slit_that_ends_in_a_gap_narrower_than_the_functions_is_refused():
    changes = {"bodies": window(0.8, 0.3, 0.82, 0.7), "notches": [slit(0.5, 0.8)], "mpm": {"order": 2}}
    with pytest.raises(CaseError, match=r"notches.*0\.8.*gap.*make mesh\.h smaller"):
        DISCRETISATIONS["mpm"](plate("mpm", **changes))
    Grid(plate("mpm", **changes, mesh={"h": 0.01}))


@pytest.mark.parametrize("ends", [([0.0, 0.0], [0.5, 0.0]), ([2.0, 0.25], [2.0, 0.75]), ([0.0, 0.0], [2.0, 0.0])])
def test_a_slit_on_the_edge_of_a_body_is_refused(ends):
    with pytest.raises(CaseError, match=r"notches\[0\].*lies on an edge.*into a body"):
        plate("mpm", notches=[{"kind": "slit", "start": ends[0], "end": ends[1]}])


@pytest.mark.parametrize("twice", [[slit(0.0, 0.5), slit(0.5, 0.0)], [slit(0.25, 0.5), slit(0.0, 1.0)]])
def test_a_slit_that_lies_on_another_is_refused(twice):
    with pytest.raises(CaseError, match=r"notches\[[01]\].*lies on notches\[[01]\]; remove one"):
        plate("fem", notches=twice)
    plate("fem", notches=[slit(0.0, 0.5), slit(0.5, 1.0), slit(0.25, 0.75, 0.25)])


@pytest.mark.parametrize("solver", ["fem", "mpm"])
def test_a_slit_of_one_cell_between_tips_is_refused_and_one_of_two_opens(solver):
    with pytest.raises(CaseError, match=r"the slit from .*1\.05.* make mesh.h smaller"):
        DISCRETISATIONS[solver](plate(solver, notches=[slit(1.0, 1.05)]))
    assert force(plate(solver, notches=[slit(1.0, 1.1)]), solver) < (1.0 - 1e-3) * force(plate(solver), solver)


def test_a_path_that_never_leaves_zero_is_refused():
    with pytest.raises(CaseError, match=r"load\.path.*stays at 0.*second value"):
        plate("fem", load={"path": [0.0], "increment": 1e-3})


def test_two_notches_on_one_line_have_the_stiffness_of_a_fine_mesh():
    notches = [slit(0.0, 0.5), slit(1.5, 2.0)]
    assert force(plate("mpm", notches=notches), "mpm") == pytest.approx(0.2736, rel=0.02)


@pytest.mark.parametrize("solver", ["fem", "mpm"])
@pytest.mark.parametrize("place", [{"point": [0.03, -1.0]}, {"box": {"lower": [2.5, 0.3], "upper": [2.6, 0.45]}}])
def test_a_constraint_that_holds_nothing_is_refused(solver, place):
    constraints = [*PLATE["constraints"], {"on": "nowhere", "direction": "x", "value": 0}]
    case = plate(solver, boundaries={**PLATE["boundaries"], "nowhere": place}, constraints=constraints)
    with pytest.raises(CaseError, match="nowhere"):
        DISCRETISATIONS[solver](case)


@pytest.mark.parametrize("solver", ["fem", "mpm"])
def test_constraints_that_contradict_each_other_in_a_corner_are_refused(solver):
    constraints = [
        {"on": "left", "direction": "y", "value": 0},
        {"on": "left", "direction": "x", "value": 0},
        {"on": "top", "direction": "y", "scale": 1},
    ]
    for order in (constraints, constraints[::-1]):
        with pytest.raises(CaseError, match="contradict each other"):
            DISCRETISATIONS[solver](plate(solver, constraints=order))


@pytest.mark.parametrize("solver", ["fem", "mpm"])
def test_constraints_may_meet_where_they_ask_the_same(solver):
    bottom, _, top = PLATE["constraints"]
    held = [{"on": edge, "direction": "x", "value": 0} for edge in ("left", "top")]
    assert force(plate(solver, constraints=[bottom, *held, top]), solver) > 0.0


@pytest.mark.parametrize("way", [0.012, -0.012])
def test_nodes_that_leave_their_points_are_refused(way):
    held = {"constraints_on": "nodes", "order": 1}
    for load, mpm in (((0.0, 0.012), held), ((0.0, way), {**held, "move_points": False})):
        force(plate("mpm", load={"path": load, "increment": 0.012}, mpm=mpm), "mpm")
    far = {"path": (0.0, 2 * way), "increment": 0.012}
    with pytest.raises(CaseError, match=r'an edge by 0\.024, more than 0\.25 mesh\.h.* give "edges", or move_points'):
        DISCRETISATIONS["mpm"](plate("mpm", load=far, mpm=held))
    constraints = [*PLATE["constraints"][:2], {"on": "top", "direction": "x", "scale": 1}]
    DISCRETISATIONS["mpm"](plate("mpm", load=far, mpm=held, constraints=constraints))


def test_a_load_that_moves_nothing_is_refused():
    with pytest.raises(CaseError, match=r"moves nothing.*scale = 1"):
        plate("fem", constraints=PLATE["constraints"][:2])


BREAKING = {"steel": {**PLATE["materials"]["steel"], "fracture": {"toughness": 0.0027, "length_scale": 0.1}}}


def test_unloading_a_cracked_plate_is_no_break():
    """Up, back to zero, pressed, and up again: all legs are followed, and the closed crack carries pressure."""
    notch = {"kind": "history", "start": [0.0, 0.5], "end": [0.5, 0.5]}
    path = [0.0, 0.003, 0.0, -0.003, 0.0, 0.0045]
    case = plate("fem", materials=BREAKING, notches=[notch], load={"path": path, "increment": 1.5e-3}, mesh={"h": 0.1})
    records = list(solver_records(DISCRETISATIONS["fem"](case), case))
    loads = [record.u for record in records]
    assert min(loads) == -0.003 and loads[-1] == 0.0045
    assert records[-1].status == "complete"


@pytest.mark.parametrize(
    ("changes", "path"),
    [
        ({"table": [[0, 0], [1, 0.003], [2, 0.0], [3, -0.003], [4, 0.0]]}, [0.0, 4.0]),
        ({"table": [[0, 0], [1, 0.003], [2, 0.003], [3, 0.00301], [4, 0.0035]]}, [0.0, 4.0]),
        ({"table": [[0, 0], [1, 0.003], [2, 0.003]], "aside": [[0, 0], [1, 0], [2, 0.002]]}, [0.0, 2.0]),
        ({"traction": 0.05}, [0.0, 1.0, 0.0, -1.0, 0.0]),
    ],
)
def test_neither_a_table_that_rests_or_turns_nor_a_load_that_is_taken_off_is_a_break(changes, path):
    """What F stands for changes with a table's slope; at a load of zero any displacement would be out of proportion."""
    axes = {"table": "y", "aside": "x"}.items()
    moved = [{"on": "top", "direction": axis, "table": changes[key]} for key, axis in axes if key in changes]
    pulled = [{"on": "top", "value": [0, changes["traction"]], "ramp": "load"}] if "traction" in changes else []
    case = plate(
        "fem", materials=BREAKING, notches=[{"kind": "history", "start": [0.0, 0.5], "end": [0.5, 0.5]}], mesh={"h": 0.1},
        constraints=[*PLATE["constraints"][:2], *moved], tractions=pulled, load={"path": path, "increment": 0.5},
    )  # fmt: skip
    *_, last = solver_records(DISCRETISATIONS["fem"](case), case)
    assert last.is_good and not last.is_last and last.u == path[-1]



@pytest.mark.parametrize("solver", ["fem", "mpm"])
def test_a_heated_plate_that_is_pulled_is_not_broken_where_its_force_is_zero(solver):
    """It is pressed at first: alpha T L = 0.001 relieves it, with what plane strain adds 0.0013."""
    steel = BREAKING["steel"] | {"expansion": 1e-5}
    steel["fracture"] = steel["fracture"] | {"split": "no_tension"}
    changes = {"materials": {"steel": steel}, "eigenstrains": [{"temperature": 100}], "mesh": {"h": 0.1}}
    notch = {"kind": "history", "start": [0.0, 0.5], "end": [0.5, 0.5]}
    load = {"path": [0.0, 0.0026], "increment": 1.3e-3}
    case = plate(solver, notches=[notch], load=load, **changes)
    records = list(solver_records(DISCRETISATIONS[solver](case), case))
    assert pytest.approx(-0.6, rel=0.01) == records[0].F and abs(records[1].F) < 1e-3
    assert records[-1].u == 0.0026 and records[-1].F > 0.1 and records[-1].status == "complete"


def test_a_prologue_ends_at_the_first_state_that_is_wanted():
    changes = {"load": {"path": [0.0, 0.002], "increment": 5e-4, "prologue": 0.8}, "output": {"snapshots": [4e-4]}}
    case = plate("fem", materials=BREAKING, **changes)
    loads = [record.u for record in solver_records(DISCRETISATIONS["fem"](case), case)]
    assert loads[1] == pytest.approx(4e-4, rel=1e-12)


@pytest.mark.parametrize("solver", ["fem", "mpm"])
def test_a_crack_of_a_mesh_file_carries_pressure_and_opens(solver, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    drawn = build_mesh(plate("fem", notches=[slit(0.0, 0.5)], mesh={"h": 0.125})).arrays
    meshio.Mesh(np.pad(drawn.points, ((0, 0), (0, 1))), [("quad", drawn.cells)]).write("cracked.vtu")
    cracked = {"bodies": {"plate": {"material": "steel", "mesh": "cracked.vtu"}}, "mesh": {"h": 0.125}}
    pressed = [*PLATE["constraints"][:2], {"on": "top", "direction": "y", "scale": -1}]
    whole = force(plate(solver, mesh={"h": 0.125}), solver)
    assert force(plate(solver, **cracked, constraints=pressed), solver) == pytest.approx(whole, rel=1e-3)
    assert force(plate(solver, **cracked), solver) < 0.9 * whole


def test_the_remedy_for_a_phase_constraint_on_smooth_splines_works():
    held = {"on": "top", "direction": "phase", "value": 1}
    changes = {"materials": BREAKING, "constraints": [*PLATE["constraints"], held], "mesh": {"h": 0.1}}
    with pytest.raises(CaseError, match=r"constraints\[3\].*phase.*mpm\.order = 1"):
        DISCRETISATIONS["mpm"](plate("mpm", **changes, mpm={"order": 2}))
    assert force(plate("mpm", **changes, mpm={"order": 1}), "mpm") > 0.0


@pytest.mark.parametrize("solver", ["fem", "mpm"])
def test_a_part_that_a_slit_cuts_off_is_named_as_one(solver):
    cut = [{"kind": "slit", "start": [1.0, 0.0], "end": [1.0, 1.0]}]
    held = [*({"on": "left", "direction": d, "value": 0} for d in "xy"), {"on": "right", "direction": "x", "scale": 1}]
    with pytest.raises(CaseError, match="a part of plate, cut off from the rest, can move in y freely"):
        DISCRETISATIONS[solver](plate(solver, notches=cut, constraints=held))


@pytest.mark.parametrize("solver", ["fem", "mpm"])
def test_what_draws_a_crack_in_a_material_that_cannot_break_is_refused(solver):
    with pytest.raises(CaseError, match=r"notches\[0\].*'history'.*cannot break.*kind = \"slit\""):
        plate(solver, notches=[{"kind": "history", "start": [0.0, 0.5], "end": [0.5, 0.5]}])
    beside = {"material": "glass", "shape": {"rectangle": {"lower": [-1, 0], "upper": [0, 1]}}}
    glass = {"young": 70.0, "poisson": 0.2, "fracture": {"toughness": 0.01, "length_scale": 0.1}}
    two = {"materials": PLATE["materials"] | {"glass": glass}, "bodies": PLATE["bodies"] | {"beside": beside}}
    with pytest.raises(CaseError, match=r"notches\[0\].*'history'.*cannot break"):
        plate(solver, **two, notches=[{"kind": "history", "start": [-0.5, 0.5], "end": [0.5, 0.5]}])
    held = {"on": "top", "direction": "phase", "value": 0}
    with pytest.raises(CaseError, match=r"constraints\[3\]\.direction.*nothing can break"):
        plate(solver, constraints=[*PLATE["constraints"], held])


BEAM: dict[str, Any] = {
    **{key: PLATE[key] for key in ("title", "requirement", "plane", "runs")},
    "units": {"length": "m", "force": "N", "time": "s"},
    "materials": {"m": {"young": 1e6, "poisson": 0.0, "density": 1000.0}},
    "bodies": {"beam": {"material": "m", "shape": {"rectangle": {"lower": [0, 0], "upper": [2, 1]}}}},
    "constraints": [{"on": "left", "direction": direction, "value": 0} for direction in "xy"],
    "dynamics": {"end_time": 0.3, "gravity": [0, -0.01]},
    "mesh": {"h": 0.1},
}


@pytest.mark.parametrize("solver", ["fem", "mpm"])
def test_a_moving_notch_that_does_not_part_its_body_is_refused(solver):
    notch = {"kind": "cells", "start": [1.0, 1.0], "end": [1.0, 0.5], "width": 0.03}
    inclined = {**notch, "end": [1.4, 0.4]}
    case = case_from_tables({**BEAM, "notches": [inclined if solver == "fem" else notch]}, run=solver)
    with pytest.raises(CaseError, match=r"notches\[0\]\.width = 0\.03.*hang together; make mesh\.h no more"):
        DISCRETISATIONS[solver](case)
    remedy = {"notches": [notch], "mesh": {"h": 0.015}}
    DISCRETISATIONS[solver](case_from_tables({**BEAM, **remedy}, run=solver))


def test_an_angle_of_a_region_that_no_one_tells_is_refused() -> None:
    region = {"body": "plate", "within": {"rectangle": {"lower": [0.0, 0.0], "upper": [0.5, 0.5]}}}
    with pytest.raises(CaseError, match=r"'output.regions' are told of in dynamics only"):
        case_from_tables({**PLATE, "output": {"regions": {"corner": region}}})


@pytest.mark.parametrize("solver", ["fem", "mpm"])
def test_a_place_far_from_the_origin_changes_nothing(solver):
    """Coordinates as maps have them: what is near is so by the spacing, not by the size of the numbers."""

    def at(x: float, y: float) -> Case:
        moved = {"start": [x, y + 0.5], "end": [x + 0.5, y + 0.5], "kind": "slit"}
        square = {"material": "steel", "shape": {"rectangle": {"lower": [x, y], "upper": [x + 2, y + 1]}}}
        return plate(
            solver, bodies={"plate": square}, boundaries={"corner": {"point": [x + 1, y]}}, notches=[moved],
            mesh={"h": 0.125},
        )  # fmt: skip

    assert force(at(5e5, 4e6), solver) == pytest.approx(force(at(0.0, 0.0), solver), rel=1e-6)
    with pytest.raises(CaseError, match=r"'mesh.h' = 0.125 is too small for bodies that lie as far from the origin"):
        at(0.0, 4e8)


@pytest.mark.parametrize("solver", ["fem", "mpm"])
@pytest.mark.parametrize(
    "changes",
    [
        {"constraints": [PLATE["constraints"][0], {"on": "left", "direction": "x", "scale": 1}]},
        {
            "bodies": {
                name: {"material": "steel", "shape": {"rectangle": {"lower": [x, 0], "upper": [x + 0.9, 1]}}}
                for name, x in (("one", 0.0), ("other", 1.1))
            },
            "constraints": [
                PLATE["constraints"][0],
                {"on": "left", "direction": "x", "value": 0},
                {"on": "right", "direction": "x", "scale": 1},
            ],
        },
    ],
    ids=["one", "apart"],
)
def test_bodies_that_are_moved_as_a_whole_carry_nothing(solver, changes):
    case = plate(solver, **changes)
    discretisation = DISCRETISATIONS[solver](case)
    records = list(solver_records(discretisation, case))
    assert records[-1].is_good and records[-1].u == 0.001
    rows, fields = pd.DataFrame([record.row() for record in records]), discretisation.fields()
    assert abs(rows["F"].iloc[-1]) < 1e-9 * 210.0 * 0.001
    assert fields.displacement[-1, 0] == pytest.approx(0.001, rel=1e-9)
    assert not suspicions(health(case, rows, fields, discretisation.measures()), {})


def grid_of_quads(lower: tuple[float, float], size: tuple[float, float], n: int = 4) -> meshio.Mesh:
    """A rectangle of n x n elements."""
    x, y = np.meshgrid(*(np.linspace(start, start + side, n + 1) for start, side in zip(lower, size, strict=True)))
    corner = (np.arange(n) + (n + 1) * np.arange(n)[:, None]).ravel()
    points = np.column_stack([x.ravel(), y.ravel(), 0.0 * x.ravel()])
    return meshio.Mesh(points, [("quad", corner[:, None] + [0, 1, n + 2, n + 1])])


@pytest.mark.parametrize(
    "other", [{"mesh": "a.vtk"}, {"mesh": "b.vtk"}, {"shape": {"rectangle": {"lower": [0.5, 0.5], "upper": [2, 2]}}}]
)
def test_bodies_from_mesh_files_do_not_overlap(other, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    grid_of_quads((0.0, 0.0), (1.0, 1.0)).write("a.vtk")
    grid_of_quads((0.9, 0.0), (1.0, 1.0)).write("b.vtk")
    bodies = {"a": {"material": "steel", "mesh": "a.vtk"}, "b": {"material": "steel", **other}}
    with pytest.raises(CaseError, match=r"'bodies\.b' overlaps the body 'a'; move them apart\.$"):
        plate("mpm", bodies=bodies)


def test_facets_of_mesh_files_along_a_circle_may_overlap(tmp_path, monkeypatch):
    """A disc within a ring whose nodes are others: each cuts the circle short elsewhere."""
    monkeypatch.chdir(tmp_path)
    for name, radii, count in (("disc", (0.3, 1.0), 40), ("ring", (1.0, 1.5), 36)):
        angle = 2.0 * np.pi * np.arange(count) / count
        circle = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
        number = np.arange(count)
        cells = np.column_stack([number, number + count, np.roll(number, -1) + count, np.roll(number, -1)])
        meshio.Mesh(np.concatenate([radius * circle for radius in radii]), [("quad", cells)]).write(f"{name}.vtk")
    bodies = {name: {"material": "steel", "mesh": f"{name}.vtk"} for name in ("disc", "ring")}
    assert plate("mpm", bodies=bodies, mesh={"h": 0.1}).bounding_box()[1].tolist() == pytest.approx([1.5, 1.5])


def test_elements_that_lie_upon_others_are_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    below, above = grid_of_quads((0.0, 0.0), (2.0, 1.0)), grid_of_quads((0.3, 0.3), (0.35, 0.35), 1)
    points = np.concatenate([below.points, above.points])
    cells = np.concatenate([below.cells[0].data, above.cells[0].data + len(below.points)])
    meshio.Mesh(points, [("quad", cells)]).write("twice.vtk")
    with pytest.raises(CaseError, match=r"twice\.vtk: elements lie upon each other; remove"):
        plate("mpm", bodies={"plate": {"material": "steel", "mesh": "twice.vtk"}})


SLOPE, LEVEL = {"segment": [[0.5, 0.2], [1.5, 0.8]]}, {"segment": [[0.5, 0.5], [1.5, 0.5]]}
INNER = {"circle": {"centre": [1.0, 0.5], "radius": 0.3}}
AROUND = {"plate": {"material": "steel", "shape": {"difference": {
    "of": {"rectangle": {"lower": [0, 0], "upper": [2, 1]}}, "minus": [{"disc": INNER["circle"]}],
}}}}  # fmt: skip


@pytest.mark.parametrize("held", [{"direction": "phase", "value": 0}, {"direction": "x", "value": 0}])
@pytest.mark.parametrize(
    ("changes", "lies_on_nodes"),
    [
        ({"boundaries": {"line": SLOPE}}, False),
        ({"boundaries": {"line": INNER}}, False),
        ({"boundaries": {"line": LEVEL}}, True),
        ({"boundaries": {"line": {"segment": [[0.5, 0.0], [1.5, 1.0]]}}}, True),
        ({"boundaries": {"line": {"segment": [[1.0, 0.5], [5.0, 0.5]]}}}, True),
        ({"boundaries": {"line": {"box": {"lower": [0.5, 0.5], "upper": [1.5, 0.5]}}}}, True),
        ({"boundaries": {"line": LEVEL}, "notches": [{"kind": "slit", "start": [1.0, 0.2], "end": [1.0, 0.8]}]}, True),
        ({"boundaries": {"line": INNER}, "bodies": AROUND}, True),
    ],
)
def test_a_line_that_would_be_held_at_single_nodes_is_refused(changes, lies_on_nodes, held):
    boundaries = {**PLATE["boundaries"], **changes["boundaries"]}
    constraints = [*PLATE["constraints"], {"on": "line", **held}]
    given = {**changes, "boundaries": boundaries, "constraints": constraints, "materials": BREAKING, "mesh": {"h": 0.1}}
    # the grid of the material points does not follow a circle, and holds displacements by places of their own
    for solver in ("fem", "mpm") if held["direction"] == "phase" and "bodies" not in changes else ("fem",):
        case = plate(solver, **given)
        if lies_on_nodes:
            DISCRETISATIONS[solver](case)
            continue
        with pytest.raises(CaseError, match=r"constraints\[3\]\.on = 'line': no node lies on it from .* lay it along"):
            DISCRETISATIONS[solver](case)


@pytest.mark.parametrize(("order", "margin"), [(2, 5), (2, 0), (3, 0)])
def test_smooth_splines_hold_no_phase_field_on_a_line_within_a_body(order, margin):
    """Order 3 had a node there, the phase field was 1/3 beside it, and the plate bore a quarter more."""
    held = [*PLATE["constraints"], {"on": "line", "direction": "phase", "value": 0}]
    changes = {"boundaries": {**PLATE["boundaries"], "line": LEVEL}, "constraints": held, "materials": BREAKING}
    with pytest.raises(CaseError, match=f"splines of order {order} do not take the values .* set mpm.order = 1"):
        DISCRETISATIONS["mpm"](plate("mpm", **changes, mesh={"h": 0.1}, mpm={"order": order, "margin": margin}))


def test_a_crack_in_a_box_thinner_than_cells_is_held_side_by_side_or_refused():
    """Triangles have a node here and there in it, so that the crack would have holes."""
    thin = {**PLATE["boundaries"], "line": {"box": {"lower": [0.5, 0.48], "upper": [1.5, 0.52]}}}
    held = [*PLATE["constraints"], {"on": "line", "direction": "phase", "value": 0}]
    changes = {"boundaries": thin, "constraints": held, "materials": BREAKING}
    DISCRETISATIONS["fem"](plate("fem", **changes, mesh={"h": 0.1}))
    with pytest.raises(CaseError, match=r"constraints\[3\]\.on = 'line': no node lies on it from"):
        DISCRETISATIONS["fem"](plate("fem", **changes, mesh={"h": 0.1, "element": "triangle"}))


@pytest.mark.parametrize(
    "place", [{"segment": [[2.1, 0.2], [2.1, 0.8]]}, {"box": {"lower": [2.1, 0], "upper": [2.4, 1]}}]
)
@pytest.mark.parametrize(("held", "mpm"), [("phase", {"order": 1}), ("x", {"order": 1, "constraints_on": "nodes"})])
def test_what_would_be_held_beside_the_bodies_is_refused_where_the_grid_goes_on(place, held, mpm):
    constraints = [*PLATE["constraints"], {"on": "beside", "direction": held, "value": 0}]
    changes = {"boundaries": {**PLATE["boundaries"], "beside": place}, "constraints": constraints, "mpm": mpm}
    with pytest.raises(CaseError, match=r"beside.* no .*node"):
        DISCRETISATIONS["mpm"](plate("mpm", materials=BREAKING, mesh={"h": 0.1}, **changes))


def test_a_phase_field_that_would_be_held_between_the_lines_of_a_grid_is_refused():
    between = {**PLATE["boundaries"], "line": {"segment": [[0.5, 0.52], [1.5, 0.52]]}}
    held = [*PLATE["constraints"], {"on": "line", "direction": "phase", "value": 0}]
    changes = {"boundaries": between, "constraints": held, "materials": BREAKING, "mesh": {"h": 0.1}}
    for solver in ("fem", "mpm"):
        with pytest.raises(CaseError, match=r"constraints\[3\]\.on = 'line': no node .* it would hold nothing"):
            DISCRETISATIONS[solver](plate(solver, **changes))


def layers(width: float, height: float) -> dict[str, Any]:
    """A plate of 2 by 1 whose part beyond a width and a height is another body of a softer material that expands."""
    sizes = {"stiff": ([0, 0], [width, height]), "soft": ([0, height] if width == 2 else [width, 0], [2, 1])}
    return {
        "materials": {"stiff": {"young": 210.0, "poisson": 0.0}, "soft": {"young": 10.0, "poisson": 0.0}},
        "bodies": {
            name: {"material": name, "shape": {"rectangle": {"lower": lower, "upper": upper}}}
            for name, (lower, upper) in sizes.items()
        },
        "constraints": [{"on": "left", "direction": "x", "value": 0}, {"on": "bottom", "direction": "y", "value": 0}],
        "boundaries": {}, "mesh": {"h": 0.25},
    }  # fmt: skip


def pulled(**changes: Any) -> Case:
    """Two materials in series."""
    series = layers(1.0, 1.0)
    constraints = [*series["constraints"], {"on": "right", "direction": "x", "scale": 1}]
    return plate("mpm", **{**series, "constraints": constraints, **changes})


@pytest.mark.parametrize("order", [2, 3])
def test_strain_jumps_across_the_seam_of_two_materials(order):
    """In series, and in a layer that swells freely on one that does not."""
    assert force(pulled(mpm={"order": order}), "mpm") == pytest.approx(1e-3 / (1 / 210 + 1 / 10), rel=1e-4)
    swollen = [{"on": "soft", "value": [[0.0, 0.0], [0.0, 1e-3]], "ramp": "load"}]
    ramped = {"eigenstrains": swollen, "load": {"path": [0.0, 1.0], "increment": 1.0}}
    swelling = plate("mpm", **{**layers(2.0, 0.5), **ramped, "mpm": {"order": order}})
    *_, last = solver_records(DISCRETISATIONS["mpm"](swelling), swelling)
    assert last.row()["E_el"] < 1e-6 * 10.0 * 1e-3**2


@pytest.mark.parametrize(("order", "kinks"), [(2, 1), (4, 0)])
def test_a_grid_has_kinks_on_seams_unless_the_phase_field_is_of_fourth_order(order, kinks):
    fracture = {"toughness": 0.0027, "length_scale": 0.5, "order": order}
    materials = {name: {**material, "fracture": fracture} for name, material in layers(1.0, 1.0)["materials"].items()}
    axis = Grid(pulled(materials=materials, mpm={"order": 2})).axes[0]
    assert axis.n_functions == axis.n_cells + 2 + kinks


@pytest.mark.parametrize("table", [PLATE, BEAM])
def test_the_grid_of_material_points_shows_no_displacement_in_place_of_none_at_all(table, tmp_path):
    """It is made anew for each increment; points and finite elements have moved."""
    cases = {solver: case_from_tables(table, run=solver) for solver in ("fem", "mpm")}
    done = {solver: run(case, solver, out=tmp_path, threads=1) for solver, case in cases.items()}
    assert all(np.abs(each.points()["displacement"]).max() > 0.0 for each in done.values())
    assert np.abs(done["fem"].grid()["displacement"]).max() > 0.0
    assert "displacement" not in done["mpm"].grid().point_data


@pytest.mark.parametrize("scheme", ["converged", "bfgs"])
@pytest.mark.parametrize("element", ["quad", "triangle"])
def test_one_element_whose_nodes_are_all_held_breaks_as_its_closed_form_says(element, scheme):
    toughness, length_scale, strain, modulus = 0.005, 0.1, 0.1, 210.0 * 0.7 / (1.3 * 0.4)
    fracture = {"toughness": toughness, "length_scale": length_scale}
    ends = [{"on": on, "direction": direction, "value": 0} for on, direction in (("bottom", "x"), ("top", "x"))]
    case = plate(
        "fem",
        materials={"steel": {**PLATE["materials"]["steel"], "fracture": fracture}},
        bodies={"plate": {"material": "steel", "shape": {"rectangle": {"lower": [0, 0], "upper": [1, 1]}}}},
        constraints=[PLATE["constraints"][0], PLATE["constraints"][2], *ends],
        load={"path": [0.0, strain], "increment": 0.01, "adaptive": False, "stop_when_broken": False},
        mesh={"h": 1.0, "under_resolved": True, "element": element},
        staggered={"scheme": scheme},
    )
    phase_field = 1.0 / (1.0 + 2.0 * length_scale * modulus * strain**2 / toughness)
    assert force(case, "fem") == pytest.approx(phase_field**2 * modulus * strain, rel=1e-4)


def test_the_part_of_an_edge_that_a_segment_holds_stays_as_long_when_the_points_move():
    held = [{"on": "part", "direction": "y", "value": 0}, *PLATE["constraints"][2:]]
    held.append({"on": "top", "direction": "x", "value": 0})
    boundaries = {"part": {"segment": [[0.8, 0.0], [2.0, 0.0]]}}
    load = {"path": [0.0, 4e-3], "increment": 1e-3}
    case = plate("mpm", constraints=held, boundaries=boundaries, load=load)
    _, first, *_, last = solver_records(DISCRETISATIONS["mpm"](case), case)
    assert last.row()["F"] == pytest.approx(4.0 * first.row()["F"], rel=2e-3)
