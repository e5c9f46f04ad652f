"""Case descriptions: what is read, what is rejected and in which words."""

from __future__ import annotations

import copy
import json
import math
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cases.loader
from cases import CaseError, case_from_tables, list_cases, load_case
from cases.boundaries import EDGES, BoundarySet
from cases.copies import write_copy
from cases.errors import BrokenRuleError
from cases.files import read_curve
from cases.geometry import Shape
from cases.json_schema import SCHEMA_FILE, case_schema, schema_text
from cases.judging import merge, nest
from cases.material import Material
from cases.units import _EXAMPLES, COMMON, Units, unit_registry

TOY = """
title = "Plate with a slit"
requirement = "Cases are read as they are written."

[units]
length = "mm"
force = "kN"

[plane]
assumption = "strain"

[materials.steel]
young = "210 GPa"
poisson = 0.3
density = "7850 kg/m^3"
[materials.steel.fracture]
toughness = "2.7 N/mm"
length_scale = 0.05
residual_stiffness = 1e-9

[bodies.plate]
material = "steel"
shape = { rectangle = { lower = [0, 0], upper = [1, 1] } }

[[notches]]
kind = "slit"
start = [0, 0.5]
end = [0.5, 0.5]

[boundaries.tip]
point = [0.5, 0.5]

[[constraints]]
on = "bottom"
direction = "y"
value = 0.0
[[constraints]]
on = "top"
direction = "y"
scale = 1.0

[load]
path = [0.0, "6.5 µm"]
increment = 1e-4

[mesh]
h = 0.02

[runs.fem]
solver = "fem"
[runs.mpm]
solver = "mpm"
[runs.gmres]
solver = "mpm"
[runs.gmres.change.mpm]
linear_solver = "gmres"
[runs.levels]
solver = "fem"
sweep = { "mesh.h" = [0.05, 0.025] }

[tiers.quick.mesh]
h = 0.04
[tiers.quick.runs.levels]
sweep = { "mesh.h" = [0.05] }

[references.book]
kind = "table"
source = "A book"
values = { peak_force = 0.7 }

[[checks]]
metric = "peak_force"
run = "mpm"
against = "reference:book"
limit = 0.05
reason = "Read to two digits."
[[checks]]
metric = "convergence_order"
run = "levels"
against = "value:2.0"
measure = "absolute"
limit = 0.2
reason = "Theory."
"""


def toy(**changes: Any) -> dict[str, Any]:
    """Tables of the toy case; keyword names are dotted keys with __ for the dot."""
    tables = tomllib.loads(TOY)
    for key, value in changes.items():
        tables = merge(tables, nest(key.replace("__", "."), value))
    return tables


def without(*path: str | int) -> dict[str, Any]:
    """Tables of the toy case less one key."""
    tables: Any = toy()
    table = tables
    for key in path[:-1]:
        table = table[key]
    del table[path[-1]]
    return tables


def rejection(tables: dict[str, Any], tmp_path: Path, **options: Any) -> str:
    """The sentence with which tables are rejected."""
    with pytest.raises(CaseError) as caught:
        case_from_tables(tables, source=tmp_path / "case.toml", **options)
    return str(caught.value)


@pytest.fixture
def toy_file(tmp_path: Path) -> Path:
    folder = tmp_path / "plate"
    folder.mkdir()
    (folder / "case.toml").write_text(TOY, encoding="utf-8")
    return folder / "case.toml"


# ---- what is read ------------------------------------------------------------------------------------------


def test_a_case_is_named_by_its_folder(toy_file: Path) -> None:
    case = load_case(toy_file.parent)
    assert (case.name, case.tier, case.run) == ("plate", "standard", None)
    assert case.source == toy_file.resolve() and case.folder == toy_file.parent.resolve()


def test_variants_that_were_right_are_not_built_again(toy_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of another text are, so that a mistake in one is told."""
    built, validate = [], cases.loader.Case.model_validate
    monkeypatch.setattr(cases.loader.Case, "model_validate", lambda *a, **b: built.append(1) or validate(*a, **b))
    load_case(toy_file)
    first = len(built)
    load_case(toy_file)
    assert len(built) == first + 1 and first > 2
    toy_file.write_text(TOY.replace("[tiers.quick.mesh]", "[tiers.quick.mesh]\ncoarse = -1.0"), encoding="utf-8")
    with pytest.raises(CaseError, match=r"tiers\.quick\.mesh\.coarse"):
        load_case(toy_file)


def test_a_copy_of_a_case_of_the_library_is_not_passed_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert load_case("homogeneous_bar").folder == cases.loader.LIBRARY / "homogeneous_bar"
    write_copy(load_case("homogeneous_bar"), tmp_path)
    with pytest.raises(CaseError, match=r"bar: is a case of the library .* homogeneous_bar/case\.toml for the"):
        load_case("homogeneous_bar")
    assert load_case("homogeneous_bar/case.toml").folder == tmp_path / "homogeneous_bar"
    monkeypatch.chdir(cases.loader.LIBRARY)
    assert load_case("homogeneous_bar").name == "homogeneous_bar"


def test_strings_with_units_become_numbers_in_the_units_of_the_case(toy_file: Path) -> None:
    case = load_case(toy_file)
    steel = case.materials["steel"]
    assert steel.young == pytest.approx(210.0)
    assert steel.fracture is not None and steel.fracture.toughness == pytest.approx(0.0027)
    assert steel.density == pytest.approx(7.85e-12)
    assert case.load.path[1] == pytest.approx(0.0065)


def test_labels_of_units() -> None:
    units = Units(length="mm", force="kN")
    labels = {kind: units.label(kind) for kind in ("length", "displacement", "force", "stress", "toughness")}
    assert labels == dict(length="mm", displacement="mm", force="kN", stress="kN/mm²", toughness="kN/mm")
    assert (units.label("energy"), units.label("density")) == ("kN·mm", "kN·s²/mm⁴")


@pytest.mark.parametrize("kind", COMMON)
def test_common_units_are_those_of_pint(kind: str) -> None:
    si = Units(length="m", force="N", time="s").expression(kind)
    for name, size in COMMON[kind].items():
        assert unit_registry().Quantity(1.0, name).to(si).magnitude == pytest.approx(size, rel=1e-14)
    common, other = Units(length="mm", force="kN", time="ms"), Units(length="millimeter", force="kN", time="ms")
    for key, (most, least) in common.sizes.items():
        assert other.sizes[key] == pytest.approx((most, least), rel=1e-12)


@pytest.mark.parametrize("text", ["1 N·mm^-2", "1 N/mm²", "1 N*mm/mm^3", "1e6 Pa", "1 MPa", " 1.0MPa "])
def test_spellings_of_one_stress(text: str) -> None:
    assert Units(length="mm", force="kN").convert(text, "stress") == pytest.approx(1e-3)


@pytest.mark.parametrize("text", ["30 deg", "30°", "0.5235987755982988 rad", "0.08333333333333333 turn", "30 degrees"])
def test_spellings_of_one_angle(text: str) -> None:
    assert Units(length="mm", force="kN").convert(text, "angle") == pytest.approx(30.0)


@pytest.mark.parametrize(
    ("text", "kind", "said"),
    [
        ("30 deg", "number", "is not a plain number"),
        ("0.3 rad", "number", "is not a plain number"),
        ("30", "angle", "is not an angle"),
        ("30 %", "angle", "is not an angle"),
        ("30 mm", "angle", "is not a quantity of angle"),
        ("210000 mPa", "stress", 'is in millipascals.* "MPa"'),
        ("2 Hz", "rate", 'counts cycles.* "12.5664 rad/s"'),
        ("2 kHz", "rate", 'counts cycles.* "12566.4 rad/s"'),
    ],
)
def test_turns_cycles_and_plain_numbers_are_not_taken_for_each_other(text: str, kind: str, said: str) -> None:
    with pytest.raises(BrokenRuleError) as caught:
        Units(length="mm", force="kN").convert(text, kind)
    assert re.search(said, f"{caught.value.text} {caught.value.remedy}")


def test_the_examples_of_units_are_of_their_kinds() -> None:
    for kind, example in _EXAMPLES.items():
        Units(length="mm", force="kN").convert(example, kind)


def test_a_snapshot_at_the_end_of_the_path_may_be_in_another_unit() -> None:
    """700 times a thousandth is a little more than 0.7, 600 a little less than 0.6."""
    for end in ("0.3 mm", "0.6 mm", "0.7 mm", "0.9 mm"):
        snapshot = f"{float(end.split()[0]) * 1e3:.0f} um"
        case = case_from_tables(toy(load__path=[0.0, end], output__snapshots=[snapshot]))
        assert case.output.snapshots[0] == pytest.approx(case.load.path[1], rel=1e-12)


def test_tiers_and_runs_are_merged(toy_file: Path) -> None:
    assert load_case(toy_file).mesh.h == 0.02
    assert load_case(toy_file, "quick").mesh.h == 0.04
    assert load_case(toy_file, run="gmres").mpm.linear_solver == "gmres"
    assert load_case(toy_file, run="levels[h=0.025]").mesh.h == 0.025


def test_a_sweep_over_a_key_of_an_entry_leaves_its_other_keys() -> None:
    strains = [{"value": [[1e-3, 0], [0, 2e-3]]}, {"temperature": 1.0, "on": "plate", "ramp": "load"}]
    sweep = {"eigenstrains.1.temperature": [10.0, 20.0], "eigenstrains.0.value.1.1": [3e-3]}
    tables = toy(runs__hot={"solver": "fem", "sweep": sweep}, materials__steel__expansion=1e-5, eigenstrains=strains)
    other, warm = case_from_tables(tables, run="hot[temperature=20,1.1=0.003]").eigenstrains
    assert (warm.temperature, warm.on, warm.ramp) == (20.0, "plate", "load")
    assert other.value == ((1e-3, 0.0), (0.0, 3e-3))
    with pytest.raises(CaseError, match=r"runs\.hot\.sweep\.constraints"):
        case_from_tables(toy(runs__hot={"solver": "fem", "sweep": {"constraints.9.scale": [1.0]}}))


def test_sweeps_expand_to_named_runs(toy_file: Path) -> None:
    case = load_case(toy_file)
    assert case.expanded_runs() == ["fem", "mpm", "gmres", "levels[h=0.05]", "levels[h=0.025]"]
    assert load_case(toy_file, "quick").expanded_runs()[3:] == ["levels[h=0.05]"]
    spec = case.run_spec("levels[h=0.05]")
    assert (spec.solver, spec.family, spec.sweep_values) == ("fem", "levels", {"mesh.h": 0.05})


def test_a_check_of_alternatives_is_one_of_each(toy_file: Path) -> None:
    families = {name: {"solver": name[:3], "sweep": {"mesh.h": [0.05, 0.025]}} for name in ("fem_a", "mpm_a")}
    check = {"metric": "peak_force", "run": "{fem,mpm}_a[*]", "against": "value:1", "limit": 0.01, "reason": "both alike"}
    other = check | {"run": "{fem, mpm}", "against": "{fem, mpm}_a[h=0.05]"}
    tables = toy(runs__fem_a=families["fem_a"], runs__mpm_a=families["mpm_a"], checks=[check, other])
    assert [(number, each.run, each.against) for number, each in case_from_tables(tables).applying_checks()] == [
        (0, "fem_a[h=0.05]", "value:1"),
        (0, "fem_a[h=0.025]", "value:1"),
        (0, "mpm_a[h=0.05]", "value:1"),
        (0, "mpm_a[h=0.025]", "value:1"),
        (1, "fem", "fem_a[h=0.05]"),
        (1, "mpm", "mpm_a[h=0.05]"),
    ]
    tables["checks"] = [check | {"run": "{fem,mmp}_a[*]"}]
    with pytest.raises(CaseError, match=r"'mmp_a.*did you mean 'mpm_a'"):
        case_from_tables(tables)


def test_a_check_of_each_run_of_a_sweep_is_taken_apart_at_every_tier(toy_file: Path) -> None:
    sweep = {"solver": "mpm", "sweep": {"mesh.h": [0.05, 0.025]}}
    check = {"metric": "peak_force", "run": "points[*]", "against": "levels[*]", "limit": 0.01, "reason": "both alike"}
    checks, coarsest = [check, check | {"against": "value:1"}], {"sweep": {"mesh.h": [0.05]}}
    tables = toy(runs__points=sweep, checks=checks, tiers__quick__runs__points=coarsest)
    pairs = [(number, each.run, each.against) for number, each in case_from_tables(tables).applying_checks()]
    assert pairs == [
        (0, "points[h=0.05]", "levels[h=0.05]"),
        (0, "points[h=0.025]", "levels[h=0.025]"),
        (1, "points[h=0.05]", "value:1"),
        (1, "points[h=0.025]", "value:1"),
    ]
    tables = toy(runs__points=sweep, checks=[check | {"but": ["h=0.05"]}], tiers__quick__runs__points=coarsest)
    assert [each.run for _, each in case_from_tables(tables).applying_checks()] == ["points[h=0.025]"]
    assert not case_from_tables(tables, "quick").applying_checks()
    with pytest.raises(CaseError, match=r"checks\[0\].run' = 'point\[\*\]' is not a run of this case"):
        case_from_tables(toy(runs__points=sweep, checks=[check | {"run": "point[*]"}]))
    with pytest.raises(CaseError, match=r"checks\[0\].against' = 'levels\[h=0.025\]' is not a run"):
        case_from_tables(toy(runs__points=sweep, checks=checks))


def test_sweeps_of_two_keys_take_every_combination() -> None:
    sweep = {"mesh.h": [0.05, 0.025], "mpm.order": [1, 2]}
    case = case_from_tables(toy(runs__grid={"solver": "mpm", "sweep": sweep}))
    names = [name for name in case.expanded_runs() if name.startswith("grid")]
    assert names == [
        "grid[h=0.05,order=1]",
        "grid[h=0.05,order=2]",
        "grid[h=0.025,order=1]",
        "grid[h=0.025,order=2]",
    ]


def test_sweeps_of_two_keys_with_one_last_word_are_labelled_in_full() -> None:
    sweep = {"materials.steel.young": [200.0], "materials.foam.young": [1.0]}
    foam = {"young": 1.0, "poisson": 0.0}
    case = case_from_tables(toy(materials__foam=foam, runs__two={"solver": "fem", "sweep": sweep}))
    assert case.expanded_runs()[-1] == "two[materials.steel.young=200,materials.foam.young=1]"


def test_a_sweep_may_go_over_an_entry_of_an_array() -> None:
    tables = toy(runs__ends={"solver": "fem", "sweep": {"load.path.1": [0.5, 0.25]}})
    case = case_from_tables(tables)
    assert case.expanded_runs()[-2:] == ["ends[path.1=0.5]", "ends[path.1=0.25]"]
    changed = case_from_tables(tables, run="ends[path.1=0.25]")
    assert changed.load.path == (case.load.path[0], 0.25, *case.load.path[2:])


def test_the_hash_follows_what_is_computed_and_nothing_else() -> None:
    hashes = [case_from_tables(toy(), run=run).hash() for run in ("fem", "mpm", "gmres")]
    assert len(set(hashes)) == 3 and all(re.fullmatch("[0-9a-f]{16}", value) for value in hashes)
    assert case_from_tables(toy(title="Other", checks=[])).hash() == case_from_tables(toy()).hash()
    assert case_from_tables(toy(mesh__h=0.021)).hash() != case_from_tables(toy()).hash()
    assert case_from_tables(toy(mesh__h=0.04)).hash() == case_from_tables(toy(), "quick").hash()


def test_models_are_frozen() -> None:
    case = case_from_tables(toy())
    with pytest.raises(ValueError, match="frozen"):
        case.mesh.h = 1.0  # type: ignore[misc]


def test_defaults_of_the_load() -> None:
    assert case_from_tables(toy()).load.smallest == pytest.approx(1e-4 / 64)
    one_point = without("load", "increment")
    one_point["load"]["path"] = [0.5]
    assert case_from_tables(one_point).load.path == (0.5,)


def test_fracture_is_enabled_by_a_material_in_use() -> None:
    assert case_from_tables(toy()).fracture_enabled
    assert not case_from_tables(without("materials", "steel", "fracture")).fracture_enabled


PAIRS = [
    {"young": 210.0, "poisson": 0.3},
    {"lame_lambda": 121.15384615384615, "shear_modulus": 80.76923076923077},
    {"bulk_modulus": 175.0, "shear_modulus": 80.76923076923077},
    {"young": 210.0, "shear_modulus": 80.76923076923077},
]


@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: "+".join(pair))
def test_every_elastic_pair_resolves_to_the_same_constants(pair: dict[str, float]) -> None:
    steel = Material(**pair)  # type: ignore[arg-type]
    assert steel.lam == pytest.approx(121.15384615384615)
    assert steel.mu == pytest.approx(80.76923076923077)
    assert steel.young_modulus == pytest.approx(210.0)
    assert steel.poisson_ratio == pytest.approx(0.3)


@given(st.floats(1e-3, 1e6), st.floats(-0.95, 0.49))
def test_elastic_constants_are_consistent(young: float, poisson: float) -> None:
    first = Material(young=young, poisson=poisson)
    again = Material(lame_lambda=first.lam, shear_modulus=first.mu)
    assert math.isclose(again.young_modulus, young, rel_tol=1e-9)
    assert math.isclose(again.poisson_ratio, poisson, rel_tol=1e-9, abs_tol=1e-12)


# ---- geometry and boundary sets ----------------------------------------------------------------------------

HOLED = {
    "difference": {
        "of": {"rectangle": {"lower": [0, 0], "upper": [4, 2]}},
        "minus": [{"disc": {"centre": [1, 1], "radius": 0.5}}],
    }
}


def test_inside_of_a_holed_plate_with_an_inclusion() -> None:
    tables = toy(bodies__core={"material": "steel", "shape": HOLED["difference"]["minus"][0]})
    tables["bodies"]["plate"]["shape"] = HOLED
    case = case_from_tables(tables)
    points = [[0, 0], [1, 1], [1.5, 1], [1.499, 1], [4, 2], [4.001, 2], [3, 1]]
    assert case.inside(points).tolist() == [0, 1, 0, 1, 0, -1, 0]
    assert np.array_equal(case.bounding_box(), [[0, 0], [4, 2]])


def test_the_edge_of_a_polygonal_hole_belongs_to_the_body() -> None:
    hole = {"polygon": {"points": [[1, 1], [2, 1], [1.5, 2]]}}
    shape = Shape.model_validate({"difference": {"of": HOLED["difference"]["of"], "minus": [hole]}})
    assert shape.contains([[1.5, 1], [1.5, 1.1], [1.5, 0.9]], 1e-9).tolist() == [True, False, True]


def test_bounds_of_a_disc_are_exact() -> None:
    lower, upper = Shape.model_validate({"disc": {"centre": [1, 2], "radius": 0.1}}).bounds()
    assert np.array_equal(lower, [0.9, 1.9]) and np.array_equal(upper, [1.1, 2.1])


def test_a_polygon_contains_its_outline_but_not_the_cut_corner() -> None:
    corners = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]
    shape = Shape.model_validate({"polygon": {"points": corners}})
    points = [[1, 1], [1.5, 1.5], [0.5, 0.5], [2, 0.5], [1.5, 1 + 1e-12]]
    assert shape.contains(points, 1e-9).tolist() == [True, False, True, True, True]


@given(st.floats(0, 2 * math.pi), st.floats(0, 2))
def test_a_disc_contains_what_is_within_its_radius(angle: float, distance: float) -> None:
    shape = Shape.model_validate({"disc": {"centre": [1, 1], "radius": 1}})
    point = [1 + distance * math.cos(angle), 1 + distance * math.sin(angle)]
    assert bool(shape.contains([point], 1e-9)[0]) == (distance <= 1 + 1e-9) or abs(distance - 1) < 2e-9


SELECTIONS = [
    ({"edge": "left"}, [True, True, False, False, False]),
    ({"edges": ["left", "top"]}, [True, True, False, True, False]),
    ({"box": {"lower": [0, 0], "upper": [1, 0]}}, [True, False, True, False, False]),
    ({"point": [1, 1]}, [False, False, False, True, False]),
    ({"circle": {"centre": [0, 0], "radius": 1}}, [False, True, True, False, False]),
    ({"segment": [[0, 0], [0.7, 0.7]]}, [True, False, False, False, True]),
]


@pytest.mark.parametrize(
    ("description", "expected"), SELECTIONS, ids=["edge", "edges", "box", "point", "circle", "segment"]
)
def test_selections_of_boundary_sets(description: dict[str, Any], expected: list[bool]) -> None:
    points = [[0, 0], [0, 1], [1, 0], [1, 1], [0.5, 0.5]]
    chosen = BoundarySet.model_validate(description).select(points, 1e-9, ([0, 0], [1, 1]))
    assert chosen.tolist() == expected


def test_a_selection_takes_points_within_the_tolerance() -> None:
    points = [[0.09, 0], [0.11, 0]]
    assert BoundarySet(edge="left").select(points, 0.1, ([0, 0], [1, 1])).tolist() == [True, False]


def test_edges_are_boundaries_without_being_defined_and_can_be_redefined() -> None:
    case = case_from_tables(toy(boundaries__left={"point": [0, 0]}))
    assert set(EDGES) < set(case.boundaries)
    assert case.boundaries["left"].point == (0.0, 0.0) and case.boundaries["right"].edge == "right"


def test_a_mesh_file_gives_bounds_and_inside(tmp_path: Path) -> None:
    import meshio

    points = [[0, 0], [2, 0], [2, 1], [0, 1]]
    meshio.Mesh(np.array(points, dtype=float), [("triangle", [[0, 1, 2], [0, 2, 3]])]).write(
        tmp_path / "a.vtk"
    )
    tables = toy()
    tables["bodies"]["plate"] = {"material": "steel", "mesh": "a.vtk"}
    case = case_from_tables(tables, source=tmp_path / "case.toml")
    assert np.array_equal(case.bounding_box(), [[0, 0], [2, 1]])
    assert case.inside([[1, 0.5], [3, 0.5]]).tolist() == [0, -1]
    before = case.hash()
    with (tmp_path / "a.vtk").open("ab") as file:
        file.write(b"\n")
    assert case.hash() != before


def test_a_mesh_file_that_is_none_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.msh").write_text("no mesh")
    tables = toy()
    tables["bodies"]["plate"] = {"material": "steel", "mesh": "a.msh"}
    with pytest.raises(CaseError, match=r"a\.msh.*cannot be read"):
        case_from_tables(tables, source=tmp_path / "case.toml")


def test_a_reference_curve_is_read(tmp_path: Path) -> None:
    (tmp_path / "book.csv").write_text("# digitised\nF,u,,\n1.0,0.0,,\n2.0,0.1\n")
    case = case_from_tables(toy(references__book__curve="book.csv"), source=tmp_path / "case.toml")
    assert case.reference_curve("book").tolist() == [[0.0, 1.0], [0.1, 2.0]]


# ---- what is rejected --------------------------------------------------------------------------------------

SECOND = {"material": "steel", "shape": {"rectangle": {"lower": [0.9, 0], "upper": [2, 1]}}}
CHECK = {"metric": "peak_force", "run": "mpm", "against": "none", "limit": 0.1, "reason": "none"}
BOTTOM = {"on": "bottom", "direction": "x"}
SLIT = {"kind": "slit", "start": [0, 0.5], "end": [0.5, 0.5]}
BESIDE = {"rectangle": {"lower": [1, 0], "upper": [2, 1]}}

BROKEN: dict[str, tuple[dict[str, Any], str, str]] = {
    # what is wrong: tables, key that must be named, words of the remedy that must appear
    "unknown key": (toy(mesh__hh=1), "mesh.hh", "did you mean 'h'"),
    "unknown key far from all": (toy(mesh__zzz=1), "mesh.zzz", "known: h, coarse"),
    "unknown table": (toy(meshh={}), "meshh", "did you mean 'mesh'"),
    "top-level key in a table": (toy(output__exact="at2"), "output.exact", "above the first [table]"),
    "snapshot off the path": (toy(output__snapshots=[0.001, 7.0]), "output.snapshots[1]", "that load.path passes"),
    "misspelt key of a notch": (toy(notches=[SLIT | {"widht": 1}]), "notches[0].widht", "known: start, end"),
    "missing key": (without("mesh", "h"), "mesh.h", "add it"),
    "missing units": (without("units"), "units", "add the table [units]"),
    "missing requirement": (without("requirement"), "requirement", "add it"),
    "wrong dimension": (toy(materials__steel__young="210 mm"), "materials.steel.young", "kN/mm²"),
    "wrong dimension of a point": (
        toy(boundaries__tip={"point": ["1 kN", 0]}),
        "boundaries.tip.point[0]",
        "in mm",
    ),
    "unknown unit": (toy(mesh__h="1 mmm"), "mesh.h", "plain number in mm"),
    "code instead of a number": (toy(mesh__h="__import__('os')"), "mesh.h", "plain number in mm"),
    "huge power": (toy(mesh__h="1 mm^9^9^9"), "mesh.h", "plain number in mm"),
    "unit of another kind": (toy(units__length="kN"), "units.length", "unit of length"),
    "unknown unit of the case": (toy(units__force="kNN"), "units.force", "unit of force"),
    "true as a number": (toy(mesh__h=True), "mesh.h", "number"),
    "text as a whole number": (toy(mpm__seed="3"), "mpm.seed", "whole number"),
    "number as a switch": (toy(load__adaptive="yes"), "load.adaptive", "true or false"),
    "negative modulus": (toy(materials__steel__young=-210.0), "materials.steel.young", "larger"),
    "poisson of 0.5": (toy(materials__steel__poisson=0.5), "materials.steel.poisson", "smaller"),
    "poisson of -1": (toy(materials__steel__poisson=-1), "materials.steel.poisson", "larger"),
    "three constants": (toy(materials__steel__shear_modulus=80), "materials.steel", "exactly one pair"),
    "one constant": (without("materials", "steel", "poisson"), "materials.steel", "exactly one pair"),
    "unstable pair": (
        toy(materials__foam={"lame_lambda": -10.0, "shear_modulus": 5.0}),
        "materials.foam.lame_lambda",
        "between -1 and 0.5",
    ),
    "forces below the rounding of another body's": (
        toy(materials__gel={"young": 1e-7, "poisson": 0.3}, bodies__pad={"material": "gel", "shape": BESIDE}),
        "materials.gel",
        "8.08e-07 or more",
    ),
    "negative toughness": (
        toy(materials__steel__fracture__toughness=-1),
        "materials.steel.fracture.toughness",
        "larger",
    ),
    "length scale below h": (toy(mesh__h=0.06), "materials.steel.fracture.length_scale", "mesh.h = 0.06"),
    "split of plane stress in plane strain": (
        toy(materials__steel__fracture__split="spectral_plane_stress"),
        "materials.steel.fracture.split",
        '"spectral"',
    ),
    "unknown split": (
        toy(materials__steel__fracture__split="modal"),
        "materials.steel.fracture.split",
        "'spectral'",
    ),
    "not a number": (toy(mesh__h=math.nan), "mesh.h", "finite"),
    "infinite": (toy(load__path=[0.0, math.inf]), "load.path[1]", "finite"),
    "infinite value of a reference": (
        toy(references__book__values={"a": math.inf}),
        "references.book.values.a",
        "finite",
    ),
    "not a number in a sweep": (
        toy(runs__levels__sweep={"mesh.h": [math.nan]}),
        "runs.levels.sweep",
        "finite",
    ),
    "not a number in a check": (
        toy(checks=[CHECK | {"parameters": {"a": [math.nan]}}]),
        "checks[0].parameters.a",
        "finite",
    ),
    "too large for a float": (toy(mesh__h=10**400), "mesh.h", "number"),
    "overlapping bodies": (toy(bodies__second=SECOND), "bodies.second", "'difference'"),
    "no bodies": (without("bodies") | {"bodies": {}}, "bodies", "at least 1"),
    "two shapes": (
        toy(bodies__plate__shape={"disc": {"centre": [0, 0], "radius": 1}}),
        "bodies.plate.shape",
        "give one of rectangle, polygon, disc, arch, difference",
    ),
    "shape and mesh": (toy(bodies__plate__mesh="case.toml"), "bodies.plate.mesh", ".msh"),
    "no geometry": (without("bodies", "plate", "shape"), "bodies.plate", "give one of shape, mesh"),
    "corners exchanged": (
        toy(bodies__plate__shape={"rectangle": {"lower": [2, 2]}}),
        "bodies.plate.shape.rectangle.upper",
        "exchange",
    ),
    "crossing polygon": (
        without("bodies", "plate", "shape")
        | {
            "bodies": {
                "plate": {
                    "material": "steel",
                    "shape": {"polygon": {"points": [[0, 0], [1, 1], [1, 0], [0, 1]]}},
                }
            }
        },
        "bodies.plate.shape.polygon.points",
        "corners once around",
    ),
    "unknown material": (
        toy(bodies__plate__material="steal"),
        "bodies.plate.material",
        "did you mean 'steel'",
    ),
    "unknown boundary": (
        toy(constraints=[BOTTOM | {"on": "botom", "value": 0}]),
        "constraints[0].on",
        "'bottom'",
    ),
    "two selections": (toy(boundaries__tip={"edge": "left"}), "boundaries.tip", "give one of edge, edges"),
    "unknown edge": (toy(boundaries__up={"edge": "up"}), "boundaries.up.edge", "'left'"),
    "constraint of nothing": (toy(constraints=[BOTTOM]), "constraints[0]", "exactly one"),
    "constraint of two things": (
        toy(constraints=[BOTTOM | {"value": 0, "scale": 1}]),
        "constraints[0]",
        "exactly one",
    ),
    "constraint tied and moved": (
        toy(constraints=[BOTTOM | {"tied": True, "scale": 1}]),
        "constraints[0]",
        "exactly one",
    ),
    "constraint without direction": (
        toy(constraints=[{"on": "top", "value": 0}]),
        "constraints[0].direction",
        '"x"',
    ),
    "motion with a direction": (
        toy(constraints=[BOTTOM | {"motion": "mode_one"}]),
        "constraints[0].direction",
        "leave",
    ),
    "phase field that moves": (
        toy(constraints=[{"on": "top", "direction": "phase", "scale": 1}]),
        "constraints[0].scale",
        "'value'",
    ),
    "phase field above one": (
        toy(constraints=[{"on": "top", "direction": "phase", "value": 2}]),
        "constraints[0].value",
        "1 (intact)",
    ),
    "constraint repeated": (
        toy(constraints=[BOTTOM | {"value": 0}, BOTTOM | {"value": 1}]),
        "constraints[1]",
        "remove one",
    ),
    "load without a point": (toy(load__path=[]), "load.path", "at least 1"),
    "load that stands still": (toy(load__path=[0, 1, 1]), "load.path", "remove the repeated"),
    "load without increment": (without("load", "increment"), "load.increment", "add"),
    "increment beyond the path": (toy(load__increment=1), "load.increment", "make it no more than"),
    "smallest above increment": (toy(load__smallest=1), "load.smallest", "no more than"),
    "notch outside": (toy(notches=[SLIT | {"end": [1.5, 0.5]}]), "notches[0].end", "move it into"),
    "notch without length": (toy(notches=[SLIT | {"end": [0, 0.5]}]), "notches[0].end", "move one"),
    "notch that leaves nothing": (
        toy(notches=[SLIT | {"kind": "cells", "width": 9, "end": [1, 0.5]}]), "bodies.plate", "make them narrower"
    ),
    "finite elements of another order of splines": (
        toy(runs__fem__change={"mpm": {"order": 3}}), "runs.fem.change.mpm", 'solver = "mpm"'
    ),
    "change of the update of points for finite elements": (
        toy(runs__fem__change={"dynamics": {"flip": 0.9}}), "runs.fem.change.dynamics.flip", 'solver = "mpm"'
    ),
    "sweep of contact for finite elements": (
        toy(runs__fem__sweep={"contact.friction": [0.1, 0.3]}), 'runs.fem.sweep."contact.friction"', 'solver = "mpm"'
    ),
    "notch of no width": (toy(notches=[SLIT | {"kind": "cells", "width": 0}]), "notches[0].width", "larger"),
    "notch of no kind": (toy(notches=[{"start": [0, 0], "end": [1, 1]}]), "notches[0]", "kind"),
    "notch of unknown kind": (toy(notches=[SLIT | {"kind": "cut"}]), "notches[0].kind", "'slit'"),
    "coarse without fine": (toy(mesh__coarse=0.1), "mesh.coarse", "mesh.fine"),
    "fine box outside": (
        toy(mesh__fine={"lower": [2, 2], "upper": [3, 3]}),
        "mesh.fine",
        "inside [0.0, 0.0]",
    ),
    "far too many cells": (toy(mesh__h=1e-9), "mesh.h", "larger spacing"),
    "missing mesh file": (
        without("bodies", "plate", "shape")
        | {"bodies": {"plate": {"material": "steel", "mesh": "none.msh"}}},
        "bodies.plate.mesh",
        "name a mesh file",
    ),
    "mesh file elsewhere": (
        without("bodies", "plate", "shape")
        | {"bodies": {"plate": {"material": "steel", "mesh": "../none.msh"}}},
        "bodies.plate.mesh",
        "put a mesh file into it",
    ),
    "missing curve": (toy(references__book__curve="none.csv"), "references.book.curve", "columns u,F"),
    "check of an unknown run": (toy(checks=[CHECK | {"run": "femm"}]), "checks[0].run", "did you mean 'fem'"),
    "check against an unknown run": (toy(checks=[CHECK | {"against": "mpn"}]), "checks[0].against", "'mpm'"),
    "check against itself": (toy(checks=[CHECK | {"against": "mpm"}]), "checks[0].against", "name another one"),
    "check against a reference as a run": (
        toy(checks=[CHECK | {"against": "book"}]), "checks[0].against", '"reference:book"'
    ),
    "value of a reference with a unit": (
        toy(references__book__values__peak_force="700 N"), "references.book.values.peak_force", "without a unit"
    ),
    "check against an unknown reference": (
        toy(checks=[CHECK | {"against": "reference:bok"}]),
        "checks[0].against",
        "did you mean 'book'",
    ),
    "check of a value that the reference lacks": (
        toy(checks=[CHECK | {"metric": "energy", "against": "reference:book"}]),
        "checks[0].against",
        "add energy",
    ),
    "check against no number": (
        toy(checks=[CHECK | {"against": "value:two"}]),
        "checks[0].against",
        "value:2.0",
    ),
    "check against no exact solution": (
        toy(checks=[CHECK | {"against": "exact"}]),
        "checks[0].against",
        "'exact'",
    ),
    "check without a reason": (toy(checks=[CHECK | {"reason": ""}]), "checks[0].reason", "write"),
    "unknown tier in the file": (toy(tiers__fast={}), "tiers.fast", "'quick'"),
    "tier that changes physics": (
        toy(tiers__quick__plane={"thickness": 2}),
        "tiers.quick.plane",
        "known: mesh",
    ),
    "tier with an unknown key": (
        toy(tiers__paper={"mesh": {"hh": 1}}),
        "tiers.paper.mesh.hh",
        "did you mean 'h'",
    ),
    "run that changes units": (
        toy(runs__mpm__change={"units": {}}),
        "runs.mpm.change.units",
        "another table",
    ),
    "run with an unknown key": (
        toy(runs__mpm__change={"mpm": {"ordr": 1}}),
        "runs.mpm.change.mpm.ordr",
        "did you mean 'order'",
    ),
    "sweep of an unknown key": (
        toy(runs__levels__sweep={"mesh.x": [1]}),
        "runs.levels.sweep.mesh.x",
        "known: h",
    ),
    "sweep without values": (
        toy(runs__levels__sweep={"mesh.h": []}),
        "runs.levels.sweep.mesh.h",
        "at least 1",
    ),
    "sweep of one value twice": (
        toy(runs__levels__sweep={"mesh.h": [0.02, 0.02]}),
        "runs.levels.sweep",
        "repetition",
    ),
    "sweep that leaves the folder": (
        toy(runs__levels__sweep={"mesh.h": ["../x"]}),
        "runs.levels.sweep",
        "folder",
    ),
    "run with the word of a target": (toy(runs={"none": {"solver": "fem"}}), "runs.none", "call the run otherwise"),
    "name that leaves the folder": (toy(runs={"../x": {"solver": "fem"}}), "runs.../x", "letters"),
    "not a table": (toy(mesh=3), "mesh", "table"),
    "units not a table": (toy(units=3), "units", "table"),
    "tiers not a table": (toy(tiers=3), "tiers", "table"),
}


@pytest.mark.parametrize("what", BROKEN)
def test_mistakes_are_named_with_key_and_remedy(what: str, tmp_path: Path) -> None:
    tables, key, remedy = BROKEN[what]
    message = rejection(copy.deepcopy(tables), tmp_path)
    assert message.startswith(f"{tmp_path.resolve() / 'case.toml'}: '{key}")
    assert remedy in message.partition(";")[2]
    assert message.endswith(".") and "\n" not in message


def test_the_value_is_named(tmp_path: Path) -> None:
    assert "'materials.steel.poisson' = 0.6 must be below 0.5" in rejection(
        toy(materials__steel__poisson=0.6), tmp_path
    )


def leaves(tables: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all tables, lists and values below a table."""
    items = (
        tables.items() if isinstance(tables, dict) else enumerate(tables) if isinstance(tables, list) else ()
    )
    return [way for key, value in items for way in [(*path, key), *leaves(value, (*path, key))]]


WRONG_VALUES = st.one_of(
    st.floats(), st.integers(), st.booleans(), st.text(max_size=8), st.just(10**400),
    st.just([]), st.just({}), st.just([[]]), st.just([{"kind": "slit"}]), st.just({"h": {"h": [1]}}),
)  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(leaves(toy())), WRONG_VALUES)
def test_any_wrong_value_is_a_sentence_and_never_a_traceback(path: tuple[Any, ...], value: Any) -> None:
    tables: Any = toy()
    table = tables
    for key in path[:-1]:
        table = table[key]
    table[path[-1]] = value
    try:
        case_from_tables(tables)
    except CaseError as error:
        assert str(error).endswith(".") and "\n" not in str(error)


CURVES = {
    "empty": ("", "is empty"),
    "comments only": ("# nothing\n", "is empty"),
    "no rows": ("u,F\n", "has no rows"),
    "columns missing": ("x,y\n1,2\n", "no columns u and F"),
    "not a number": ("u,F\n0,nan\n", "row 1"),
    "short row": ("u,F\n0,1\n1\n", "row 2"),
    "words": ("u,F\n0,one\n", "row 1"),
    "no name": (",,\n,,\n", "no columns u and F"),
    "decimal commas": ("u,F\n0,0\n0,001,0,5\n", "4 cells in row 2 and 2 in its header; correct it, and write decimals"),
    "a column twice": ("u,F,F\n0,0,0\n", "names the column F twice"),
}


@pytest.mark.parametrize("what", CURVES)
def test_unusable_reference_curves_are_rejected(what: str, tmp_path: Path) -> None:
    text, words = CURVES[what]
    (tmp_path / "book.csv").write_text(text)
    message = rejection(toy(references__book__curve="book.csv"), tmp_path)
    assert "references.book.curve" in message and "book.csv" in message and words in message


@pytest.mark.parametrize("text", ["u,F,note\n0,0,\n1,2,\n", "u,F\n0,0,\n1,2, ,\n", "u,F,\n0,0\n1,2,\n"])
def test_empty_cells_at_the_end_of_rows_do_no_harm(text: str, tmp_path: Path) -> None:
    (tmp_path / "book.csv").write_text(text)
    assert read_curve(tmp_path / "book.csv").tolist() == [[0.0, 0.0], [1.0, 2.0]]


@pytest.mark.parametrize(
    "text",
    ["u;F\n0;0\n1;2\n", "u\tF\n0\t0\n1\t2\n", " u  F\n 0  0\n 1  2\n", "# u F\n0 0\n1 2\n", '"u","F"\n"0","0"\n1,2\n'],
)
def test_a_curve_is_a_table_as_a_history_is(text: str, tmp_path: Path) -> None:
    (tmp_path / "book.csv").write_text(text)
    assert read_curve(tmp_path / "book.csv").tolist() == [[0.0, 0.0], [1.0, 2.0]]


def test_invalid_toml_is_named_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text('title = "x"\n[mesh\nh = 1\n')
    with pytest.raises(CaseError, match=r"bad\.toml: not valid TOML: .*line 2.*; correct"):
        load_case(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"\xff\xfe", "UTF-8"),
        (b"a = " + b"1" * 5000, "TOML"),
        (b"a = " + b"[" * 9999, "cannot be read|TOML"),
    ],
    ids=["empty", "not text", "endless number", "deep nesting"],
)
def test_unreadable_files_are_rejected(content: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_bytes(content)
    with pytest.raises(CaseError, match=words):
        load_case(path)


def test_unknown_cases_tiers_and_runs_are_rejected(toy_file: Path, tmp_path: Path) -> None:
    with pytest.raises(CaseError, match="no such case"):
        load_case(str(tmp_path / "nowhere"))
    with pytest.raises(CaseError, match="'tier' = 'fast' is not a tier; choose quick"):
        load_case(toy_file, tier="fast")
    with pytest.raises(
        CaseError, match=r"'run' = 'levels\[h=0.5\]' is not a run.*did you mean 'levels\[h=0.05\]'"
    ):
        load_case(toy_file, run="levels[h=0.5]")


# ---- library and schema ------------------------------------------------------------------------------------


def test_the_library_is_listed_and_searched(toy_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cases.loader, "LIBRARY", toy_file.parent.parent)
    assert list_cases() == ["plate"]
    assert load_case("plate").name == "plate"
    with pytest.raises(CaseError, match="did you mean 'plate'"):
        load_case("plato")


def test_an_absent_library_is_empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cases.loader, "LIBRARY", tmp_path / "nowhere")
    assert list_cases() == []


@pytest.mark.parametrize("name", list_cases())
def test_every_case_of_the_library_is_valid(name: str) -> None:
    case = load_case(name)
    assert case.checks, "a case that checks nothing verifies nothing"


def test_the_committed_schema_is_up_to_date() -> None:
    """To write it anew: python -c "import cases; cases.write_schema()"."""
    assert SCHEMA_FILE.read_text(encoding="utf-8") == schema_text()


def test_the_schema_names_the_tables_and_allows_units() -> None:
    schema = case_schema()
    assert {"units", "mesh"} <= set(schema["required"]) and "folder" not in schema["properties"]
    assert schema["additionalProperties"] is False
    assert {"type": "string"} in schema["$defs"]["Mesh"]["properties"]["h"]["anyOf"]
    assert json.dumps(schema)
