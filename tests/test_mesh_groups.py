"""Named groups of mesh files: bodies and boundaries by the names that they have in Gmsh and Abaqus."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import Case, CaseError, case_from_tables
from cases.errors import BrokenRuleError
from cases.mesh_files import read_mesh_file
from cases.mesh_groups import boundary_of_group, names_of_groups
from numerics.description import describe
from verify.runs.running import DISCRETISATIONS, solver_records

NODES = ["0 0 0", "1 0 0", "2 0 0", "0 1 0", "1 1 0", "2 1 0"]
NAMES = '$PhysicalNames\n3\n1 1 "Top"\n2 2 "steel"\n2 3 "glue"\n$EndPhysicalNames\n'
GMSH_2 = (
    f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n{NAMES}$Nodes\n6\n"
    + "".join(f"{number} {node}\n" for number, node in enumerate(NODES, 1))
    + "$EndNodes\n$Elements\n4\n1 1 2 1 1 4 5\n2 1 2 1 1 5 6\n3 3 2 2 1 1 2 5 4\n4 3 2 3 2 2 3 6 5\n$EndElements\n"
)
GMSH_4 = (
    f"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n{NAMES}$Entities\n0 1 2 0\n1 0 1 0 2 1 0 1 1 0\n1 0 0 0 1 1 0 1 2 0\n"
    "2 1 0 0 2 1 0 1 3 0\n$EndEntities\n$Nodes\n1 6 1 6\n2 1 0 6\n1\n2\n3\n4\n5\n6\n"
    + "\n".join(NODES)
    + "\n$EndNodes\n$Elements\n3 4 1 4\n1 1 1 2\n1 4 5\n2 5 6\n2 1 3 1\n3 1 2 5 4\n2 2 3 1\n4 2 3 6 5\n$EndElements\n"
)
ABAQUS = (
    "*NODE\n"
    + "".join(f"{number}, {node.replace(' ', ', ')}\n" for number, node in enumerate(NODES, 1))
    + "*ELEMENT, TYPE=CPE4, ELSET=all\n1, 1, 2, 5, 4\n2, 2, 3, 6, 5\n"
    "*ELSET, ELSET=steel\n1\n*ELSET, ELSET=glue\n2\n*NSET, NSET=Top\n4, 5, 6\n"
)
FILES = {"gmsh2.msh": GMSH_2, "gmsh4.msh": GMSH_4, "abaqus.inp": ABAQUS}

TABLES: dict[str, Any] = {
    "title": "Two plates glued",
    "requirement": "Groups are found by their names.",
    "units": {"length": "mm", "force": "kN"},
    "plane": {"assumption": "stress"},
    "materials": {"hard": {"young": 210.0, "poisson": 0.0}, "soft": {"young": 21.0, "poisson": 0.0}},
    "constraints": [
        {"on": "bottom", "direction": "x", "value": 0},
        {"on": "bottom", "direction": "y", "value": 0},
        {"on": "pulled", "direction": "y", "scale": 1},
    ],
    "load": {"path": [0.0, 0.001], "increment": 1e-3},
    "mesh": {"h": 0.25},
    "mpm": {"order": 1},
    "runs": {"fem": {"solver": "fem"}, "mpm": {"solver": "mpm"}},
}


def glued(folder: Path, file: str, solver: str = "fem", steel: str = "steel", top: str = "Top") -> Case:
    (folder / file).write_text(FILES[file], encoding="utf-8")
    made_of = (("hard", steel), ("soft", "glue"))
    left, right = ({"material": name, "mesh": file, "group": group} for name, group in made_of)
    tables = {**TABLES, "bodies": {"left": left, "right": right}, "boundaries": {"pulled": {"group": top}}}
    return case_from_tables(tables, tier="standard", run=solver, source=folder / "case.toml")


@pytest.mark.parametrize("file", FILES)
def test_a_body_is_a_group_of_cells(file: str, tmp_path: Path) -> None:
    case = glued(tmp_path, file)
    assert [tuple(body.bounds()[1]) for body in case.bodies.values()] == [(1.0, 1.0), (2.0, 1.0)]
    mesh = read_mesh_file(tmp_path / file, 0, "steel")
    assert len(mesh.cells) == 1 and mesh.points[:, 0].max() == 1.0


@pytest.mark.parametrize("file", FILES)
def test_a_boundary_is_a_group_of_lines_or_nodes(file: str, tmp_path: Path) -> None:
    case = glued(tmp_path, file)
    places = np.array([[0.0, 1.0], [0.7, 1.0], [2.0, 1.0], [1.0, 0.99], [1.0, 0.0]])
    chosen = case.boundaries["pulled"].select(places, 1e-6, case.bounding_box())
    assert chosen.tolist() == [True, True, True, False, False]
    assert case.boundaries["pulled"].nearest([[0.5, 0.75]]).tolist() == [[0.5, 1.0]]


@pytest.mark.parametrize("solver", ["fem", "mpm"])
def test_both_solvers_pull_at_the_group(solver: str, tmp_path: Path) -> None:
    """Without contraction each plate carries E u over its width of one, whatever holds it to the other."""
    case = glued(tmp_path, "gmsh4.msh", solver)
    *_, last = solver_records(DISCRETISATIONS[solver](case), case)
    assert pytest.approx((210.0 + 21.0) * 0.001, rel=1e-3) == last.F
    assert describe(case, solver).cells > 0


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize(
    ("names", "key"),
    [({"top": "Bottom"}, "'boundaries.pulled.group' = 'Bottom'"), ({"steel": "stel"}, "'bodies.left.group' = 'stel'")],
)
def test_an_unknown_name_lists_the_groups_found(file: str, names: dict[str, str], key: str, tmp_path: Path) -> None:
    with pytest.raises(CaseError) as error:
        glued(tmp_path, file, **names)
    said = str(error.value)
    assert key in said and "steel" in said and "glue" in said and "\n" not in said


def test_the_content_of_the_mesh_is_part_of_what_is_computed(tmp_path: Path) -> None:
    before = glued(tmp_path, "gmsh2.msh").hash()
    (tmp_path / "elsewhere").mkdir()
    assert glued(tmp_path / "elsewhere", "gmsh2.msh").hash() == before


#: the edge on top in two groups, and beside it an edge and a plate in none, as with Mesh.SaveAll
GMSH_4_SHARED = GMSH_4.replace("$PhysicalNames\n3\n", '$PhysicalNames\n4\n1 4 "Outer"\n').replace(
    "1 0 1 0 2 1 0 1 1 0\n", "1 0 1 0 2 1 0 2 4 1 0\n").replace("2 1 0 0 2 1 0 1 3 0", "2 1 0 0 2 1 0 0 0")
#: and the left plate in two groups, which writes it twice
GMSH_2_SHARED = (
    GMSH_2.replace("$PhysicalNames\n3\n", '$PhysicalNames\n4\n2 4 "half"\n').replace("$Elements\n4\n", "$Elements\n5\n")
).replace("3 3 2 2 1 1 2 5 4\n", "3 3 2 4 1 1 2 5 4\n5 3 2 2 1 1 2 5 4\n")


def test_what_is_in_several_groups_of_gmsh_is_in_each_of_them(tmp_path: Path) -> None:
    (tmp_path / "a.msh").write_text(GMSH_4_SHARED)
    assert [boundary_of_group(tmp_path / "a.msh", name).length for name in ("Top", "Outer")] == [2.0, 2.0]
    assert len(read_mesh_file(tmp_path / "a.msh").cells) == 2
    with pytest.raises(BrokenRuleError, match="holds nothing"):
        boundary_of_group(tmp_path / "a.msh", "glue")
    (tmp_path / "b.msh").write_text(GMSH_2_SHARED)
    assert [len(read_mesh_file(tmp_path / "b.msh", 0, group).cells) for group in (None, "steel", "half")] == [2, 1, 1]


#: as Abaqus/CAE writes it: an edge as its nodes and, by the same name, the elements beside it, or a set of the part
ABAQUS_CAE = (
    f"*Part, name=Plate\n{ABAQUS}*Nset, nset=Set-1, generate\n1, 6, 1\n*Elset, elset=Set-1, generate\n1, 2, 1\n"
    "*End Part\n*Assembly, name=Assembly\n*Instance, name=Plate-1, part=Plate\n*End Instance\n"
    "*Nset, nset=Set-1, instance=Plate-1, generate\n4, 6, 1\n*Elset, elset=Set-1, instance=Plate-1, generate\n1, 2, 1\n"
    "*Nset, nset=both\nPlate-1.Top\n*End Assembly\n"
)


def test_an_edge_of_abaqus_is_its_nodes_and_not_the_elements_beside_it(tmp_path: Path) -> None:
    file = tmp_path / "cae.inp"
    file.write_text(ABAQUS_CAE)
    assert boundary_of_group(file, "Set-1").bounds == (0.0, 1.0, 2.0, 1.0)
    assert boundary_of_group(file, "both").bounds == (0.0, 1.0, 2.0, 1.0)
    assert boundary_of_group(file, "Plate-1.Set-1").area == 2.0
    assert names_of_groups(file) == ["Plate-1.Set-1", "Set-1", "Top", "all", "both", "glue", "steel"]


def test_one_cell_in_two_surfaces_is_refused(tmp_path: Path) -> None:
    (tmp_path / "b.msh").write_text(GMSH_2_SHARED.replace("5 3 2 2 1", "5 3 2 2 2"))
    with pytest.raises(CaseError, match="on the same side of an edge"):
        read_mesh_file(tmp_path / "b.msh")


@pytest.mark.parametrize("file", ["gmsh2.msh", "gmsh4.msh"])
def test_a_body_is_no_group_of_lines(file: str, tmp_path: Path) -> None:
    with pytest.raises(CaseError, match=r"left\.group' = 'Top' is no group of plane cells.*name one of steel, glue"):
        glued(tmp_path, file, steel="Top")


@pytest.mark.parametrize("content", [GMSH_2, GMSH_4])
def test_a_curve_and_a_surface_of_one_name_are_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / "a.msh").write_text(content.replace('"Top"', '"steel"'))
    with pytest.raises(CaseError, match="has two physical groups called 'steel'"):
        read_mesh_file(tmp_path / "a.msh", 0, "steel")
