"""Mesh files of eight kinds, good and broken: each is read right, or refused by one sentence that names it."""

import io
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import meshio
import numpy as np
import pytest
from test_mesh_groups import ABAQUS, GMSH_2, GMSH_4, TABLES

from cases import Case, case_from_tables
from cases.errors import CaseError
from cases.mesh_arrays import signed_areas
from cases.mesh_files import mesh_outline, mesh_slits, read_mesh_file, second_order_sentence
from cases.mesh_groups import boundary_of_group, names_of_groups
from verify.runs.running import DISCRETISATIONS, solver_records

POINTS = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0]], dtype=float)
QUADS = np.array([[0, 1, 4, 3], [1, 2, 5, 4]])
TRIANGLES = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
GROUPS = ["Top", "glue", "steel"]
Writer = Callable[[Path], None]


def text(content: str | bytes) -> Writer:
    """Writes a text, or bytes, as they are."""
    data = content.encode() if isinstance(content, str) else content
    return lambda file: file.write_bytes(data) and None


def mesh(cells: list[tuple[str, np.ndarray]], points: np.ndarray = POINTS, **options: object) -> Writer:
    """Writes a mesh by meshio in the format of the file's ending."""
    return lambda file: meshio.Mesh(points, cells).write(file, **options)


def xdmf(cells: np.ndarray, points: np.ndarray) -> Writer:
    """Writes triangles as XDMF with the numbers in the text."""

    def item(values: np.ndarray, kind: str) -> str:
        stream = io.StringIO()
        np.savetxt(stream, values, fmt="%g")
        rows, columns = values.shape
        head = f'<DataItem DataType="{kind}" Dimensions="{rows} {columns}" Format="XML" Precision="8">'
        return f"{head}\n{stream.getvalue()}</DataItem>"

    return text(
        '<Xdmf Version="3.0"><Domain><Grid Name="Grid"><Geometry GeometryType="XYZ">'
        f'{item(points, "Float")}</Geometry><Topology TopologyType="Triangle" NumberOfElements="{len(cells)}">'
        f'{item(cells, "Int")}</Topology></Grid></Domain></Xdmf>'
    )


def moved(**changes: list[float]) -> np.ndarray:
    """The points with some elsewhere: n4=[x, y, z]."""
    points = POINTS.copy()
    for name, place in changes.items():
        points[int(name[1:])] = place
    return points


def clockwise(inp: str) -> str:
    return inp.replace("1, 2, 5, 4", "1, 4, 5, 2").replace("2, 3, 6, 5", "2, 5, 6, 3")


SECOND = np.vstack([POINTS[[0, 1, 4]], [[0.5, 0, 0], [1, 0.5, 0], [0.5, 0.5, 0]]])
CURVED = SECOND + np.array([[0, 0, 0]] * 4 + [[0.1, 0, 0]] + [[0, 0, 0]])
QUADS_8 = np.vstack([POINTS[[0, 2, 5, 3]], [[1, 0, 0], [2, 0.5, 0], [1, 1, 0], [0, 0.5, 0]]])
# a slit along the lower half of x = 1: its mouth has two nodes, its end one
SLIT = np.vstack([POINTS[:3], [[0, 0.5, 0], [1, 0.5, 0], [2, 0.5, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0], [1, 0, 0]]])
SLIT_CELLS = np.array([[0, 1, 4, 3], [9, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]])
HANGING = np.vstack([POINTS, [[1, 0.5, 0], [2, 0.5, 0]]])
HANGING_CELLS = np.array([[0, 1, 4, 3], [1, 2, 7, 6], [6, 7, 5, 4]])
TET = ("tetra", np.array([[0, 1, 3, 6]]))
ABOVE = np.vstack([POINTS, [[0.0, 0.0, 1.0]]])
APART = np.vstack([POINTS, POINTS[[1, 4]]])

#: two blocks of elements and of nodes in small letters, lines before them, and sets of sets
ABAQUS_BLOCKS = (
    "*Heading\n** by hand\n*Node, nset=Low\n1, 0., 0.\n2, 1.D0, , 0.,\n3, 2., 0.\n*Element, type=T3D2\n9, 1, 2\n"
    "*Node\n4, 0., 1.\n5, 1., 1.\n6, 2., 1.\n99, 7., 7.\n*Element, type=cpe4h,\nelset=steel\n1, 1, 2,\n5, 4\n"
    "*Nset, nset=Ends, generate\n4, 6, 2\n*Nset, nset=Top\nEnds, 5\n*Element, type=CPS4RT, elset=glue\n2, 2, 3, 6, 5\n"
    "*Elset, elset=all\nSteel, glue\n"
)
NASTRAN = (
    "BEGIN BULK\n" + "".join(f"GRID,{n},{{}},{x:.1f},{y:.1f},{z:.1f}\n" for n, (x, y, z) in enumerate(POINTS, 1))
    + "CQUAD4,1,1,1,2,5,4\nCQUAD4,2,1,2,3,6,5\nENDDATA\n"
)  # fmt: skip
#: file -> how it is written, and its area, boundary and groups
GOOD: dict[str, tuple[Writer, float, float, list[str]]] = {
    "gmsh 2.2.msh": (text(GMSH_2), 2.0, 6.0, GROUPS),
    "gmsh 4.1.msh": (text(GMSH_4), 2.0, 6.0, GROUPS),
    "gmsh 4.1 binary.msh": (mesh([("triangle", TRIANGLES)], file_format="gmsh"), 2.0, 6.0, []),
    "abaqus.inp": (text(ABAQUS), 2.0, 6.0, ["Top", "all", "glue", "steel"]),
    "abaqus plane stress.inp": (text(ABAQUS.replace("CPE4", "CPS4")), 2.0, 6.0, ["Top", "all", "glue", "steel"]),
    "abaqus clockwise.inp": (text(clockwise(ABAQUS)), 2.0, 6.0, ["Top", "all", "glue", "steel"]),
    "GMSH.MSH": (text(GMSH_2), 2.0, 6.0, GROUPS),
    "quoted.INP": (text(ABAQUS.replace("=glue", '="glue 1"')), 2.0, 6.0, ["Top", "all", "glue 1", "steel"]),
    "abaqus in blocks.inp": (text(ABAQUS_BLOCKS), 2.0, 6.0, ["Ends", "Low", "Top", "all", "glue", "steel"]),
    "nastran.bdf": (text(NASTRAN.replace("{}", "")), 2.0, 6.0, []),
    "quads.vtu": (mesh([("quad", QUADS)]), 2.0, 6.0, []),
    "triangles with z = 0.vtu": (mesh([("triangle", TRIANGLES)]), 2.0, 6.0, []),
    "unused nodes and lines.vtu": (
        mesh([("line", QUADS[:, :2]), ("quad", QUADS)], np.vstack([POINTS, [[9.0, 9.0, 0.0]]])), 2.0, 6.0, [],
    ),
    "another z.vtk": (mesh([("quad", QUADS)], POINTS + np.array([0, 0, 7.0])), 2.0, 6.0, []),
    "slit of doubled nodes.vtu": (mesh([("quad", SLIT_CELLS)], SLIT), 2.0, 6.0, []),
    "medit.mesh": (mesh([("triangle", TRIANGLES)]), 2.0, 6.0, []),
    "one clockwise.vtu": (mesh([("quad", np.array([[0, 1, 4, 3], [1, 4, 5, 2]]))]), 2.0, 6.0, []),
    "second order triangle.vtu": (mesh([("triangle6", np.arange(6)[None])], SECOND), 0.5, 2.0 + 2**0.5, []),
    "second order quad.vtu": (mesh([("quad8", np.arange(8)[None])], QUADS_8), 2.0, 6.0, []),
    "second order beside first.vtu": (
        mesh([("triangle", TRIANGLES[2:]), ("triangle6", np.array([[0, 1, 4, 6, 7, 8]]))],
             np.vstack([POINTS, SECOND[3:]])), 1.5, 4.0 + 2**0.5, [],
    ),
}  # fmt: skip

#: file -> how it is written, and what is said of it
BROKEN: dict[str, tuple[Writer, str]] = {
    "empty.msh": (text(""), "cannot be read"),
    "truncated.msh": (text(GMSH_4[: len(GMSH_4) // 2]), "cannot be read"),
    "truncated.vtu": (text("<VTKFile type='UnstructuredGrid'><Unstr"), "cannot be read"),
    "not UTF-8.inp": (text("*NODE\n** Größe\n".encode("latin-1") + ABAQUS.encode()), "is no UTF-8 text"),
    "of no kind.xyz": (text("0 0 0\n"), "cannot be read"),
    "not a number.vtu": (mesh([("quad", QUADS)], moved(n4=[np.nan, 1, 0])), "1 nodes that are no finite numbers"),
    "mixed.vtu": (mesh([("quad", QUADS[:1]), ("triangle", TRIANGLES[2:])]), "triangles and quadrilaterals are mixed"),
    "curved edges.vtu": (mesh([("triangle6", np.arange(6)[None])], CURVED), "1 second-order elements have curved edges"),
    "polygons.vtu": (mesh([("polygon", np.array([[0, 1, 2, 5, 4, 3]]))]), "elements of type polygon"),
    "tetrahedra.vtu": (mesh([TET], ABOVE), "elements of type tetra"),
    "only lines.vtu": (mesh([("line", QUADS[:, :2])]), "no triangles or quadrilaterals"),
    "curved.vtu": (mesh([("quad", QUADS)], moved(n4=[1, 1, 0.5])), "leaves the x-y plane"),
    "hanging node.vtu": (mesh([("quad", HANGING_CELLS)], HANGING), "a hanging node"),
    "crossed.vtu": (mesh([("quad", np.array([[0, 1, 3, 4], [1, 2, 5, 4]]))]), "inverted or collapsed"),
    "folded.vtu": (
        mesh([("quad", QUADS)], moved(n2=[0.5, 0, 0], n5=[0.5, 1, 0])), "the same side of an edge near (1, 0.5)",
    ),
    "doubled cell.vtu": (mesh([("quad", QUADS[[0, 1, 1]])]), "on the same side of an edge"),
    "doubled nodes all along.vtu": (mesh([("quad", np.array([[0, 1, 4, 3], [6, 2, 5, 7]]))], APART), "into 2 parts"),
    "marked.inp": (text(b"\xef\xbb\xbf" + ABAQUS.encode()), "begins with a byte-order mark"),
    "instances.inp": (text("*Instance, name=a\n1.0, 0.0\n*End Instance\n" + ABAQUS), "instances of parts"),
    "two parts.inp": (text("*Part, name=a\n*End Part\n*Part, name=b\n" + ABAQUS), "instances of parts"),
    "made by a rule.inp": (text(ABAQUS + "*NGEN, NSET=a\n1, 3\n"), "has *NGEN, which is not read"),
    "in two files.inp": (text("*INCLUDE, INPUT=a.inp\n" + ABAQUS), "has *INCLUDE, which is not read"),
    "cylindrical.inp": (text(ABAQUS.replace("*NODE", "*NODE, SYSTEM=C")), "coordinates that are not rectangular"),
    "axisymmetric.inp": (text(ABAQUS.replace("CPE4", "CAX4P")), "elements of type CAX4P are not supported"),
    "a node is missing.inp": (text(ABAQUS.replace("\n6, 2", "\n7, 2")), "has no node 6, which an element of it names"),
    "a set without a name.inp": (text(ABAQUS + "*NSET\n1, 2\n"), "has *NSET without the option NSET"),
    "no number.inp": (text(ABAQUS + "*NODE\nx, 1.0, 2.0\n"), "has a line of *NODE that holds no numbers"),
    "a set of nothing.inp": (text(ABAQUS.replace("4, 5, 6", "4, Ends")), "names node Ends, which is not there"),
    "another system.bdf": (text(NASTRAN.replace("{}", "5")), "nodes in coordinates of their own (GRID,1,5,"),
    "another system in columns.bdf": (text("GRID           1       5     0.0\n"), "(GRID 1 5 0.0)"),
    "another system for all.bdf": (text("GRDSET,,5\n" + NASTRAN.replace("{}", "")), "(GRDSET,,5)"),
    "no element.inp": (text(ABAQUS.partition("*ELEMENT")[0]), "no triangles or quadrilaterals"),
}


@pytest.mark.parametrize("name", GOOD)
def test_a_good_file_is_read_right(name: str, tmp_path: Path) -> None:
    write, area, boundary, groups = GOOD[name]
    write(tmp_path / name)
    found = read_mesh_file(tmp_path / name)
    assert signed_areas(found.points, found.cells).sum() == pytest.approx(area)
    assert (signed_areas(found.points, found.cells) > 0).all()
    assert mesh_outline(tmp_path / name).length == pytest.approx(boundary)
    assert names_of_groups(tmp_path / name) == groups
    assert len(mesh_slits(tmp_path / name)) == (1 if name.startswith("slit") else 0)


def test_sets_of_several_blocks_hold_the_elements_of_their_names(tmp_path: Path) -> None:
    (tmp_path / "blocks.inp").write_text(ABAQUS_BLOCKS)
    for group, left, right in (("steel", 0.0, 1.0), ("glue", 1.0, 2.0), ("all", 0.0, 2.0)):
        assert mesh_outline(tmp_path / "blocks.inp", group).bounds == (left, 0.0, right, 1.0)
    assert boundary_of_group(tmp_path / "blocks.inp", "Top").bounds == (0.0, 1.0, 2.0, 1.0)


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_one_sentence(name: str, tmp_path: Path) -> None:
    write, said = BROKEN[name]
    write(tmp_path / name)
    with pytest.raises(CaseError) as error:
        read_mesh_file(tmp_path / name)
    assert said in str(error.value)
    assert str(error.value).startswith(f"{tmp_path / name}: ") and "\n" not in str(error.value)


def pulled(folder: Path, solver: str, *bodies: dict[str, str]) -> Case:
    """Plates of two materials, or of one alone, from 0 to 2 and 0 to 1, pulled along y without contraction."""
    named = {f"body{number}": body for number, body in enumerate(bodies)}
    constraints = [*TABLES["constraints"][:2], {"on": "top", "direction": "y", "scale": 1}]
    tables = {**TABLES, "bodies": named, "constraints": constraints}
    return case_from_tables(tables, tier="standard", run=solver, source=folder / "case.toml")


@pytest.mark.parametrize("solver", ["fem", "mpm"])
@pytest.mark.parametrize(
    "name",
    ["abaqus clockwise.inp", "one clockwise.vtu", "second order quad.vtu", "triangles with z = 0.vtu",
     "unused nodes and lines.vtu", "slit of doubled nodes.vtu"],
)  # fmt: skip
def test_both_solvers_take_it(name: str, solver: str, tmp_path: Path) -> None:
    GOOD[name][0](tmp_path / name)
    case = pulled(tmp_path, solver, {"material": "hard", "mesh": name})
    *_, last = solver_records(DISCRETISATIONS[solver](case), case)
    assert pytest.approx(2.0 * 210.0 * 0.001, rel=1e-3) == last.F
    told = ["second order quad.vtu: 1 elements of second order are taken by their corners."]
    assert case.mesh_remarks == (told if name.startswith("second") else [])


#: the glue of the file of groups as triangles, beside a quadrilateral of steel
MIXED = GMSH_2.replace("$Elements\n4\n", "$Elements\n5\n").replace(
    "4 3 2 3 2 2 3 6 5\n", "4 2 2 3 2 2 3 6\n5 2 2 3 2 2 6 5\n"
)


def test_groups_of_triangles_and_of_quadrilaterals_are_for_material_points_alone(tmp_path: Path) -> None:
    (tmp_path / "mixed.msh").write_text(MIXED)
    made_of = (("hard", "steel"), ("soft", "glue"))
    bodies = [{"material": name, "mesh": "mixed.msh", "group": group} for name, group in made_of]
    case = pulled(tmp_path, "mpm", *bodies)
    *_, last = solver_records(DISCRETISATIONS["mpm"](case), case)
    assert pytest.approx(0.231, rel=1e-3) == last.F
    with pytest.raises(CaseError, match="body0, body1 mix triangles and quadrilaterals; mesh the file with triangles"):
        DISCRETISATIONS["fem"](pulled(tmp_path, "fem", *bodies))
    assert second_order_sentence(tmp_path / "mixed.msh") == ""


def test_xdmf_is_read_where_its_library_is_there(tmp_path: Path) -> None:
    xdmf(TRIANGLES, POINTS)(tmp_path / "a.xdmf")
    if find_spec("h5py"):
        assert len(read_mesh_file(tmp_path / "a.xdmf").cells) == len(TRIANGLES)
    else:
        with pytest.raises(CaseError, match="install it with pip install h5py"):
            read_mesh_file(tmp_path / "a.xdmf")
