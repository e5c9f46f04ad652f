"""What acts on bodies at rest: tractions and pressure, body forces, eigenstrains, tables; against exact answers."""

import meshio
import numpy as np
import pandas as pd
import pytest

from cases import CaseError, case_from_tables
from cases.splits import SPLITS
from fem_reference import ExplicitFiniteElements, FiniteElements
from mpm import ExplicitMaterialPoints, MaterialPoints
from numerics.explicit import instants
from numerics.quasi_static import increments
from numerics.status import RunStatus
from verify.health import health, suspicions

SOLVERS = {"fem": FiniteElements, "mpm": MaterialPoints}
YOUNG, POISSON, LENGTH = 1000.0, 0.3, 4.0
STEEL = {"young": YOUNG, "poisson": POISSON, "density": 2e-9, "expansion": 1e-5}
ROLLERS = [{"on": "left", "direction": "x", "value": 0}, {"on": "bottom", "direction": "y", "value": 0}]
ENDS = [*ROLLERS, {"on": "right", "direction": "x", "value": 0}]
RAMPED = {"path": [0.0, 1.0], "increment": 0.25}
both = pytest.mark.parametrize("run", SOLVERS)


def bar(tmp_path, run, **tables):
    """A bar from 0 to 4 by 0 to 1, in plane stress if not otherwise."""
    given = {
        "title": "t", "requirement": "r", "units": {"length": "mm", "force": "N"}, "plane": {"assumption": "stress"},
        "materials": {"steel": STEEL},
        "bodies": {"bar": {"material": "steel", "shape": {"rectangle": {"lower": [0, 0], "upper": [LENGTH, 1]}}}},
        "constraints": ROLLERS, "load": RAMPED, "mesh": {"h": 0.25}, "runs": {run: {"solver": run}},
    }  # fmt: skip
    return case_from_tables(given | tables, run=run, source=tmp_path / "case.toml")


def solved(tmp_path, run, sound=True, **tables):
    """Increments, and the discretisation at the end; a run that ends well is sound."""
    case = bar(tmp_path, run, **tables)
    discretisation = SOLVERS[run](case)
    told = list(increments(discretisation, case))
    rows = pd.DataFrame([record.row() for record in told])
    found = suspicions(health(case, rows, discretisation.fields(), discretisation.measures()), {})
    assert found == [] or not sound
    return told, discretisation


@both
def test_a_bar_under_end_traction_is_as_long_as_hooke_says(tmp_path, run):
    told, discretisation = solved(tmp_path, run, tractions=[{"on": "right", "value": [2.0, 0.0], "ramp": "load"}])
    fields, last = discretisation.fields(), told[-1]
    assert fields.displacement[:, 0] == pytest.approx(2.0 * fields.reference[:, 0] / YOUNG, abs=1e-5)
    # as exact as the strain is small: the material points move on
    assert np.abs(fields.stress - [2.0, 0.0, 0.0]).max() < 2.0 * 2.0 / YOUNG
    assert discretisation.measures()["loaded_length_0"] == pytest.approx(1.0)
    # the load parameter is a factor: F is the force times its displacement, the work half of both
    assert pytest.approx(2.0 * 2.0 * LENGTH / YOUNG, rel=1e-4) == last.F
    assert last.external_work == pytest.approx(0.5 * last.F, rel=1e-4)
    assert last.elastic_energy == pytest.approx(last.external_work, rel=1e-5)


@both
def test_a_constant_pressure_beside_a_moved_edge(tmp_path, run):
    """Plane stress: E strain = s_x - nu s_y; the work of the pressure counts, F stays the moved edge's."""
    moved = [*ROLLERS, {"on": "right", "direction": "x", "scale": 1.0}]
    pressed = [{"on": "top", "pressure": 1.0}]
    load = {"path": [0.0, 0.02], "increment": 0.005}
    told, discretisation = solved(tmp_path, run, constraints=moved, tractions=pressed, load=load)
    stress = YOUNG * 0.02 / LENGTH - POISSON * 1.0
    assert discretisation.fields().stress.mean(axis=0) == pytest.approx([stress, -1.0, 0.0], abs=1e-3)
    assert pytest.approx(stress, rel=1e-3) == told[-1].F
    gained = told[-1].elastic_energy - told[0].elastic_energy
    assert told[-1].external_work == pytest.approx(gained, rel=1e-4)


RING = {
    "of": {"disc": {"centre": [0, 0], "radius": 2.0}},
    "minus": [
        {"disc": {"centre": [0, 0], "radius": 1.0}}, {"rectangle": {"lower": [-3, -3], "upper": [0, 3]}},
        {"rectangle": {"lower": [-3, -3], "upper": [3, 0]}},
    ],
}  # fmt: skip


def lame(radius, pressure=1.0, inner=1.0, outer=2.0):
    """Radial displacement of a thick cylinder under inner pressure in plane strain (Lamé)."""
    share = pressure * inner**2 / (outer**2 - inner**2)
    return (1.0 + POISSON) / YOUNG * share * ((1.0 - 2.0 * POISSON) * radius + outer**2 / radius)


@pytest.mark.parametrize(("run", "error"), [("fem", 0.007), ("mpm", 0.016)])
def test_a_thick_cylinder_under_inner_pressure_is_that_of_lame(tmp_path, run, error):
    """The edge is curved; halving h twice brings the error down at least in proportion."""
    errors = []
    for h in (0.2, 0.1, 0.05):
        _, discretisation = solved(
            tmp_path, run, sound=h < 0.1, plane={"assumption": "strain"}, mesh={"h": h, "element": "triangle"},
            bodies={"ring": {"material": "steel", "shape": {"difference": RING}}},
            boundaries={"hole": {"circle": {"centre": [0, 0], "radius": 1.0}}},
            tractions=[{"on": "hole", "pressure": 1.0}], load={"path": [0.0]},
        )  # fmt: skip
        fields = discretisation.fields()
        radius = np.linalg.norm(fields.reference, axis=1)
        off = (fields.displacement * fields.reference).sum(axis=1) / radius - lame(radius)
        errors.append(float(np.sqrt(fields.volume @ off**2 / (fields.volume @ lame(radius) ** 2))))
        assert discretisation.measures()["loaded_length_0"] == pytest.approx(0.5 * np.pi, rel=0.01)
    assert errors[1] < error
    assert errors[2] < 0.3 * errors[0]


@both
def test_a_bar_under_its_own_weight(tmp_path, run):
    """u = rho g L^2 / 2 E at the end, and rho g (L x - x^2 / 2) / E before it, where nothing contracts."""
    slender = {"steel": STEEL | {"poisson": 0.0}}
    weight = STEEL["density"] * 1e8
    pulled = [{"gravity": [1e8, 0.0], "ramp": "load"}]
    told, discretisation = solved(tmp_path, run, materials=slender, body_forces=pulled)
    fields, x = discretisation.fields(), discretisation.fields().reference[:, 0]
    end = weight * LENGTH**2 / (2.0 * YOUNG)
    assert fields.displacement[:, 0] == pytest.approx(weight * (LENGTH * x - 0.5 * x**2) / YOUNG, abs=2e-3 * end)
    by_value = [{"on": "bar", "value": [weight, 0.0]}]
    _, by_volume = solved(tmp_path, run, materials=slender, body_forces=by_value, load={"path": [0.0]})
    assert by_volume.fields().displacement == pytest.approx(fields.displacement, abs=1e-3 * end)
    assert told[-1].external_work == pytest.approx(weight**2 * LENGTH**3 / (6.0 * YOUNG), rel=5e-3)


@both
@pytest.mark.parametrize("assumption", ["stress", "strain"])
def test_free_expansion_is_without_stress(tmp_path, run, assumption):
    plane = {"assumption": assumption}
    _, discretisation = solved(tmp_path, run, plane=plane, eigenstrains=[{"temperature": 50.0, "ramp": "load"}])
    fields = discretisation.fields()
    strain = 50.0 * STEEL["expansion"] * (1.0 + POISSON * (assumption == "strain"))
    assert fields.displacement == pytest.approx(strain * fields.reference, abs=1e-8)
    assert np.abs(fields.stress).max() < 1e-6 * YOUNG * strain


@both
@pytest.mark.parametrize("split", SPLITS)
def test_a_held_bar_takes_the_stress_and_the_energy_of_its_temperature(tmp_path, run, split):
    """sigma = -E alpha dT in uniaxial stress; cooled, the bar is in tension and all or part of its energy drives."""
    brittle = {"fracture": {"toughness": 1.0, "length_scale": 0.25, "split": split}}
    told, discretisation = solved(
        tmp_path, run, materials={"steel": STEEL | brittle}, constraints=ENDS,
        eigenstrains=[{"temperature": -50.0, "ramp": "load"}],
    )  # fmt: skip
    stress = YOUNG * STEEL["expansion"] * 50.0
    assert np.abs(discretisation.fields().stress - [stress, 0.0, 0.0]).max() < 1e-3
    energy = 0.5 * stress**2 / YOUNG
    contracted = 2.0 * POISSON**2 / (1.0 + POISSON)  # share of both strains across the bar, which some splits leave out
    assert 0.99 * (1.0 - contracted) * energy < discretisation.fields().history_field.mean() < 1.01 * energy
    assert pytest.approx(2.0 * energy * LENGTH, rel=1e-3) == told[-1].F
    assert told[-1].external_work == pytest.approx(energy * LENGTH, rel=1e-3)


@both
def test_a_strip_of_two_materials_bends_as_timoshenko_says(tmp_path, run):
    """Equal halves of one modulus: curvature = 3 (a1 - a2) dT / (2 t) over the thickness t (Timoshenko 1925)."""
    halves = {
        name: {"material": name, "shape": {"rectangle": {"lower": [0, y], "upper": [8, y + 0.5]}}}
        for name, y in (("low", 0.0), ("high", 0.5))
    }
    held = [{"on": "corner", "direction": d, "value": 0} for d in "xy"] + [{"on": "upper", "direction": "x", "value": 0}]
    _, discretisation = solved(
        tmp_path, run, bodies=halves, materials={"low": STEEL | {"expansion": 2e-5}, "high": STEEL}, constraints=held,
        boundaries={"corner": {"point": [0.0, 0.0]}, "upper": {"point": [0.0, 1.0]}}, mesh={"h": 0.125},
        eigenstrains=[{"temperature": 10.0}], load={"path": [0.0]},
    )  # fmt: skip
    fields, curvature = discretisation.fields(), 1.5 * 1e-5 * 10.0 / 1.0
    middle = (np.abs(fields.reference[:, 1] - 0.5) < 0.1) & (fields.reference[:, 0] > 1.0)
    x, y = fields.reference[middle, 0], fields.displacement[middle, 1]
    assert 2.0 * np.polyfit(x, y, 2)[0] == pytest.approx(curvature, rel=0.04)


@both
def test_an_edge_follows_a_table_over_the_load(tmp_path, run):
    rows = [[0.0, 0.0], [1.0, 0.02], [2.0, -0.01]]
    (tmp_path / "way.csv").write_text("pseudo,u2\n" + "\n".join(f"{t},{u}" for t, u in rows) + "\n", encoding="utf-8")
    driven = {"on": "right", "direction": "x"}
    of_file = [*ROLLERS, driven | {"table": "way.csv", "columns": ["pseudo", "u2"]}]
    load = {"path": [0.0, 2.0], "increment": 0.3}
    told, _ = solved(tmp_path, run, constraints=[*ROLLERS, driven | {"table": rows}], load=load)
    assert 1.0 in [record.u for record in told], "the row of the table is an increment"
    # the power at the present rate: stress times 0.02 on the way up, times -0.03 on the way down
    assert pytest.approx(YOUNG * -0.01 / LENGTH * -0.03, rel=1e-3) == told[-1].F
    assert told[-1].external_work == pytest.approx(0.5 * YOUNG / LENGTH * 0.01**2, rel=1e-3)
    assert bar(tmp_path, run, constraints=of_file, load=load).constraints[-1].course.values.tolist() == [0.0, 0.02, -0.01]


def breaking(tmp_path, run, **load):
    """A notched bar pulled by a traction alone."""
    return bar(
        tmp_path, run, mesh={"h": 0.125}, load={"path": [0.0, 10.0], "increment": 0.5} | load,
        materials={"steel": STEEL | {"fracture": {"toughness": 0.01, "length_scale": 0.25, "split": "none"}}},
        bodies={"bar": {"material": "steel", "shape": {"rectangle": {"lower": [0, 0], "upper": [2, 1]}}}},
        notches=[{"kind": "cells", "start": [1.0, 1.0], "end": [1.0, 0.5], "width": 0.25}],
        constraints=[{"on": "left", "direction": "x", "value": 0}, {"on": "left", "direction": "y", "value": 0}],
        tractions=[{"on": "right", "value": [1.0, 0.0], "ramp": "load"}],
    )  # fmt: skip


@both
def test_a_load_that_nothing_holds_ends_the_run_with_the_sentence_why(tmp_path, run):
    case = breaking(tmp_path, run)
    told = list(increments(SOLVERS[run](case), case))
    assert told[-1].status == RunStatus.BROKEN_THROUGH and not told[-1].is_good
    assert "no state is in equilibrium with the load" in told[-1].reason and "after u = 0.6" in told[-1].reason
    # what was reached is the last state that is one
    assert told[-1].u == told[-2].u and told[-1].c_min > 0.5
    assert told[-1].external_work == pytest.approx(told[-1].elastic_energy + told[-1].fracture_energy, rel=0.05)


def test_dissipation_control_follows_the_load_back(tmp_path):
    case = breaking(tmp_path, "fem", control="dissipation", largest_advance=0.1)
    told = list(increments(FiniteElements(case), case))
    assert told[-1].u < 0.3 * max(record.u for record in told)
    assert told[-1].c_min < 0.05 and told[-1].F > 2.0 * told[1].F


@both
def test_a_pressed_slit_opens(tmp_path, run):
    """Both faces of a slit are edges, which a segment on it loads: a crack under pressure in a wide plate (Sneddon)."""
    side = 20.0
    held = [{"on": "corner", "direction": d, "value": 0} for d in "xy"] + [{"on": "foot", "direction": "y", "value": 0}]
    _, discretisation = solved(  # four cells from middle to tip, whose price the health record tells
        tmp_path, run, sound=False, mesh={"h": 0.25, "coarse": 1.0, "fine": {"lower": [8, 8], "upper": [12, 12]}},
        bodies={"plate": {"material": "steel", "shape": {"rectangle": {"lower": [0, 0], "upper": [side, side]}}}},
        boundaries={
            "crack": {"segment": [[9.0, 10.0], [11.0, 10.0]]}, "corner": {"point": [0.0, 0.0]},
            "foot": {"point": [side, 0.0]},
        },
        notches=[{"kind": "slit", "start": [9.0, 10.0], "end": [11.0, 10.0]}], constraints=held,
        tractions=[{"on": "crack", "pressure": 1.0}], load={"path": [0.0]},
    )  # fmt: skip
    fields = discretisation.fields()
    assert discretisation.measures()["loaded_length_0"] == pytest.approx(4.0)
    near = (np.abs(fields.reference[:, 0] - 10.0) < 0.15) & (np.abs(fields.reference[:, 1] - 10.0) < 0.15)
    up = fields.reference[near, 1] > 10.0
    opening = fields.displacement[near, 1][up].mean() - fields.displacement[near, 1][~up].mean()
    assert opening == pytest.approx(4.0 * 1.0 / YOUNG, rel=0.1)


def test_a_pressed_slit_beside_large_cells_takes_the_work_that_sneddon_says(tmp_path):
    """The faces that are loaded are those of the fine cells, however large the largest are: pi p^2 a^2 / E of energy."""
    side, half = 20.0, {"lower": [8.5, 9.7], "upper": [11.5, 10.3]}
    held = [{"on": "corner", "direction": d, "value": 0} for d in "xy"] + [{"on": "foot", "direction": "y", "value": 0}]
    tables = {
        "mesh": {"h": 0.1, "coarse": 4.0, "fine": half}, "mpm": {"order": 1},
        "bodies": {"plate": {"material": "steel", "shape": {"rectangle": {"lower": [0, 0], "upper": [side, side]}}}},
        "boundaries": {
            "crack": {"segment": [[9.0, 10.0], [11.0, 10.0]]}, "corner": {"point": [0.0, 0.0]},
            "foot": {"point": [side, 0.0]},
        },
        "notches": [{"kind": "slit", "start": [9.0, 10.0], "end": [11.0, 10.0], "contact": False}],
        "constraints": held, "tractions": [{"on": "crack", "pressure": 1.0}], "load": {"path": [0.0]},
    }  # fmt: skip
    fem, mpm = (solved(tmp_path, run, sound=False, **tables)[0][-1].row()["E_el"] for run in ("fem", "mpm"))
    assert fem == pytest.approx(np.pi / YOUNG, rel=0.05)
    assert mpm == pytest.approx(fem, rel=1e-6)


@both
def test_a_part_of_an_edge_is_loaded_as_far_as_it_is_drawn(tmp_path, run):
    """The segment ends within cells: forces and lengths are those of the drawn part."""
    part = {"part": {"segment": [[0.3, 1.0], [1.13, 1.0]]}}
    clamped = [{"on": "left", "direction": d, "value": 0} for d in "xy"]
    load = {"path": [0.0]}
    tables = {"boundaries": part, "constraints": clamped, "tractions": [{"on": "part", "pressure": 1.0}], "load": load}
    _, discretisation = solved(tmp_path, run, sound=False, **tables)  # four cells are few across a short cantilever
    assert discretisation.measures()["loaded_length_0"] == pytest.approx(0.83, rel=1e-5)
    fields, cut = discretisation.fields(), (2.2, 2.3)
    beyond = fields.reference[:, 0] > cut[0]
    assert np.abs(fields.stress[beyond]).max() < 0.15, "nothing is loaded beyond the part"


def test_a_constraint_holds_what_is_drawn_or_is_refused(tmp_path):
    """The set ends within cells: those of a file have no nodes there, triangles get some, on straight and round edges."""
    held = [{"on": "part", "direction": d, "value": 0} for d in "xy"]
    tables = {"boundaries": {"part": {"segment": [[0.3, 0.0], [1.13, 0.0]]}}, "constraints": held}
    loads = {"tractions": [{"on": "top", "pressure": 1.0, "ramp": "load"}]}
    drawn = FiniteElements(bar(tmp_path, "fem", **loads)).basis
    meshio.Mesh(np.pad(drawn.nodes, ((0, 0), (0, 1))), [("quad", drawn.elements)]).write(tmp_path / "bar.vtk")
    read = {"bodies": {"bar": {"material": "steel", "mesh": "bar.vtk"}}}
    with pytest.raises(CaseError, match=r"constraints\[0\].on = 'part': 0.5 mm of edge are held of 0.83 drawn; let it"):
        FiniteElements(bar(tmp_path, "fem", **tables, **read, **loads))
    disc = {"bodies": {"disc": {"material": "steel", "shape": {"disc": {"centre": [0, 0], "radius": 1}}}}}
    box = {"box": {"lower": [-0.2, -1], "upper": [0.23, -0.9]}}
    for shape, part in (({}, tables["boundaries"]["part"]), (disc, box)):
        body = {**tables, **shape, "boundaries": {"part": part}, "mesh": {"h": 0.1, "element": "triangle"}}
        case = bar(tmp_path, "fem", **body, body_forces=[{"value": [0, 1], "ramp": "load"}])
        nodes = FiniteElements(case).basis.nodes
        on = nodes[case.boundaries["part"].select(nodes, 1e-6, case.bounding_box())]
        ends = (0.3, 1.13) if not shape else (-0.2, 0.23)
        assert (on[:, 0].min(), on[:, 0].max()) == pytest.approx(ends, abs=1e-6)


def test_what_is_held_along_a_segment_is_what_is_held_along_a_flat_box(tmp_path):
    """Supports that end within large cells of a graded grid, whose hat functions would hold an edge beyond them."""
    graded = {"h": 0.1, "coarse": 1.0, "growth": 2.0, "fine": {"lower": [1.9, 0.0], "upper": [2.1, 0.2]}}

    def energy(run, ends):
        boundaries = {name: ends([x, 0.0], [x + 0.6, 0.0]) for name, x in (("first", 0.0), ("last", LENGTH - 0.6))}
        tables = {
            "boundaries": boundaries, "mesh": graded, "mpm": {"order": 1}, "load": {"path": [0.0]},
            "constraints": [{"on": on, "direction": d, "value": 0} for on in boundaries for d in "xy"],
            "tractions": [{"on": "top", "pressure": 1.0}],
        }  # fmt: skip
        return solved(tmp_path, run, sound=False, **tables)[0][-1].row()["E_el"]

    expected = energy("fem", lambda start, end: {"box": {"lower": start, "upper": end}})
    for run in SOLVERS:
        for ends in (lambda start, end: {"segment": [start, end]}, lambda start, end: {"segment": [end, start]}):
            assert energy(run, ends) == pytest.approx(expected, rel=1e-3)


@both
def test_a_traction_on_an_edge_that_is_held_is_refused(tmp_path, run):
    """All of the edge is held in the direction in which it pulls; across it, or on a part alone, it acts."""
    pull = {"on": "right", "value": [1.0, 0.0], "ramp": "load"}
    with pytest.raises(CaseError, match=r"tractions\[0\]\.on = 'right': .*constraints\[2\] hold all .* do nothing"):
        SOLVERS[run](bar(tmp_path, run, constraints=ENDS, tractions=[pull]))
    SOLVERS[run](bar(tmp_path, run, constraints=ENDS, tractions=[pull | {"value": [0.0, 1.0]}]))
    half = {"half": {"segment": [[LENGTH, 0.0], [LENGTH, 0.5]]}}
    constraints = [*ROLLERS, {"on": "half", "direction": "x", "value": 0}]
    SOLVERS[run](bar(tmp_path, run, boundaries=half, constraints=constraints, tractions=[pull]))


REFUSED = {
    "tractions[0].ramp": ({"tractions": [{"on": "right", "value": [1, 0], "ramp": 2.0}]}, 'give "load"'),
    "tractions[0]": ({"tractions": [{"on": "right", "value": [1, 0], "pressure": 1.0}]}, "give one of value, pressure"),
    "tractions[0].on": ({"tractions": [{"on": "nowhere", "pressure": 1.0}]}, "define the boundary"),
    "body_forces[0].on": ({"body_forces": [{"on": "nobody", "gravity": [0, 1]}]}, "define the body"),
    "eigenstrains[0].value": ({"eigenstrains": [{"value": [[0, 1e-3], [0, 0]]}]}, "write it as"),
    "load.path": ({"tractions": [{"on": "right", "value": [1, 0]}]}, 'ramp = "load"'),
    "constraints[2].table": (
        {"constraints": [*ROLLERS, {"on": "right", "direction": "x", "table": [[0, 0], [0.5, 1]]}]}, "add rows",
    ),
    "constraints[2].of": (
        {"constraints": [*ROLLERS, {"on": "right", "direction": "x", "table": [[0, 0], [1, 1]], "of": "velocity"}]},
        "table of displacements",
    ),
    "load.control": (
        {"tractions": [{"on": "right", "value": [1, 0], "ramp": "load"}, {"on": "top", "pressure": 1.0}],
         "load": RAMPED | {"control": "dissipation"}}, 'give it ramp = "load"',
    ),
    "materials.steel.density": (
        {"materials": {"steel": {"young": 1.0, "poisson": 0.2}}, "body_forces": [{"gravity": [0, 1], "ramp": "load"}]},
        "needs mass",
    ),
    "materials.steel.expansion": (
        {"materials": {"steel": {"young": 1.0, "poisson": 0.2}}, "eigenstrains": [{"temperature": 1.0, "ramp": "load"}]},
        "needs it",
    ),
}  # fmt: skip


@pytest.mark.parametrize("key", REFUSED)
def test_what_does_not_fit_is_refused_with_key_and_remedy(tmp_path, key):
    tables, remedy = REFUSED[key]
    with pytest.raises(CaseError) as error:
        bar(tmp_path, "fem", **tables)
    assert f"'{key}'" in str(error.value) and remedy in str(error.value), error.value


@pytest.mark.parametrize(
    "table",
    [[[0, 0]], [[0, 0], [0, 1]], [[0, 0], [1, "x"]], [[0, 0], [1, float("nan")]], [0, 1], 3, "missing.csv", "../a.csv"],
)
def test_a_table_that_is_none_is_refused(tmp_path, table):
    with pytest.raises(CaseError, match=r"constraints\[2\]"):
        bar(tmp_path, "fem", constraints=[*ROLLERS, {"on": "right", "direction": "x", "table": table}])


@both
def test_a_traction_that_would_load_nothing_is_refused_before_anything_is_computed(tmp_path, run):
    inside = {"inside": {"segment": [[1.0, 0.5], [2.0, 0.5]]}}
    case = bar(tmp_path, run, boundaries=inside, tractions=[{"on": "inside", "value": [0, 1], "ramp": "load"}])
    with pytest.raises(CaseError, match=r"tractions\[0\].on = 'inside': no edge of a body lies on it"):
        SOLVERS[run](case)


def test_a_table_in_a_file_is_part_of_what_is_computed(tmp_path):
    driven = [*ROLLERS, {"on": "right", "direction": "x", "table": "way.csv", "columns": ["t", "u"]}]
    hashes = []
    for end in (0.01, 0.02):
        (tmp_path / "way.csv").write_text(f"t,u\n0,0\n1,{end}\n", encoding="utf-8")
        hashes.append(bar(tmp_path, "fem", constraints=driven).hash())
    assert hashes[0] != hashes[1]


def test_cases_with_the_same_table_are_the_same_and_with_others_are_not(tmp_path):
    """Even after their tables have been looked at, which keeps them as arrays."""
    rows, other = [[0, 0], [0.5, 0.1], [1, 0.2]], [[0, 0], [0.5, 0.1], [1, 0.3]]
    cases = [
        bar(tmp_path, "fem", constraints=[*ROLLERS, {"on": "right", "direction": "x", "table": table}])
        for table in (rows, rows, other)
    ]
    assert all(case.constraints[2].course.moves for case in cases)
    assert cases[0] == cases[1] and cases[0] != cases[2]


@pytest.mark.parametrize(
    "nothing",
    [
        {"tractions": [{"on": "right", "value": [0, 0], "ramp": "load"}]},
        {"body_forces": [{"value": [0, 0], "ramp": "load"}]},
        {"constraints": [*ROLLERS, {"on": "right", "direction": "x", "table": [[0, 0], [1, 0]]}]},
    ],
)
def test_loads_of_zero_alone_move_nothing(tmp_path, nothing):
    with pytest.raises(CaseError, match=r"'load\.path' moves nothing"):
        bar(tmp_path, "fem", **nothing)
    # beside one that acts they may be a level of a sweep
    driven = [*nothing.get("constraints", ROLLERS), {"on": "top", "direction": "y", "scale": 1}]
    FiniteElements(bar(tmp_path, "fem", **nothing | {"constraints": driven}))


MOVING = {
    "materials": {"steel": {"young": YOUNG, "poisson": POISSON, "density": 1e-3}}, "plane": {"assumption": "strain"},
    "mpm": {"order": 2}, "dynamics": {"end_time": 0.1},
}  # fmt: skip


def moved(tmp_path, run, **tables):
    """The same bar in motion: the last instant, and the discretisation."""
    given = {"title": "t", "requirement": "r", "units": {"length": "mm", "force": "N"}, "mesh": {"h": 0.25}}
    given |= MOVING | {"runs": {run: {"solver": run}}}
    given["bodies"] = {"bar": {"material": "steel", "shape": {"rectangle": {"lower": [0, 0], "upper": [LENGTH, 1]}}}}
    case = case_from_tables(given | tables, run=run, source=tmp_path / "case.toml")
    discretisation = {"fem": ExplicitFiniteElements, "mpm": ExplicitMaterialPoints}[run](case)
    return list(instants(discretisation, case))[-1], discretisation


@both
@pytest.mark.parametrize(
    ("of", "rows", "end"),
    [
        ("displacement", [[0.0, 0.0], [0.05, 0.01], [0.1, 0.0]], 0.0),
        ("velocity", [[0.0, 0.0], [0.05, 2.0], [0.1, 0.0]], 0.1),
    ],
)
def test_a_held_edge_follows_a_table_over_time(tmp_path, run, of, rows, end):
    driven = [{"on": "right", "direction": "x", "table": rows, "of": of}, {"on": "right", "direction": "y", "value": 0}]
    last, discretisation = moved(tmp_path, run, constraints=driven)
    fields = discretisation.fields()
    at_edge = fields.reference[:, 0] > LENGTH - 0.1
    assert fields.displacement[at_edge, 0].mean() == pytest.approx(end, abs=1e-3)
    assert last.balance.external_work == pytest.approx(last.balance.total, rel=0.02 if run == "fem" else 0.2)


@both
@pytest.mark.parametrize(
    ("traction", "impulse"),
    [
        ({"on": "right", "pressure": 1.0}, (-0.1, 0.0)),
        ({"on": "part", "pressure": 1.0}, (0.0, -0.13)),
        ({"on": "top", "value": [0.5, 0.5]}, (0.2, 0.2)),
    ],
)
def test_a_free_body_takes_up_the_impulse_of_what_is_drawn(tmp_path, run, traction, impulse):
    part = {"part": {"segment": [[0.0, 1.0], [1.3, 1.0]]}}
    last, discretisation = moved(tmp_path, run, boundaries=part, tractions=[traction])
    assert last.balance.momentum == pytest.approx(impulse, abs=1e-6)
    length = {"right": 1.0, "part": 1.3, "top": LENGTH}[traction["on"]]
    assert discretisation.measures()["loaded_length_0"] == pytest.approx(length, rel=1e-5)


@pytest.mark.parametrize(
    ("tables", "remedy"),
    [
        ({"body_forces": [{"gravity": [0, -1]}]}, "dynamics.gravity"),
        ({"eigenstrains": [{"temperature": 1.0}]}, "the table load"),
        ({"tractions": [{"on": "right", "pressure": 1.0, "ramp": "load"}]}, "give a time"),
        ({"constraints": [{"on": "right", "direction": "x", "table": [[0, 0.1], [1, 0]]}]}, "be 0 at time 0"),
        ({"constraints": [{"on": "right", "direction": "x", "table": [[0, 0], [0.05, 1]]}]}, "add rows"),
        ({"constraints": [{"on": "right", "direction": "x", "velocity": 0}]}, "'dynamics' moves nothing: .* a velocity"),
        ({"tractions": [{"on": "right", "value": [0, 0]}]}, "moves nothing"),
    ],
)
def test_what_does_not_fit_motion_is_refused_with_a_remedy(tmp_path, tables, remedy):
    with pytest.raises(CaseError, match=remedy):
        moved(tmp_path, "mpm", **tables)
