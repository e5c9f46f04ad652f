"""Mesh files of eight kinds, good and broken: each is read right, or refused by one sentence that names it."""

import io
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import meshio
import numpy as np
import pytest
from test_mesh_groups import ABAQUS, GMSH_2, GMSH_4

from cases.errors import CaseError
from cases.mesh_arrays import signed_areas
from cases.mesh_files import mesh_outline, mesh_slits, read_mesh_file
from cases.mesh_groups import names_of_groups

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
# a slit along the lower half of x = 1: its mouth has two nodes, its end one
SLIT = np.vstack([POINTS[:3], [[0, 0.5, 0], [1, 0.5, 0], [2, 0.5, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0], [1, 0, 0]]])
SLIT_CELLS = np.array([[0, 1, 4, 3], [9, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]])
HANGING = np.vstack([POINTS, [[1, 0.5, 0], [2, 0.5, 0]]])
HANGING_CELLS = np.array([[0, 1, 4, 3], [1, 2, 7, 6], [6, 7, 5, 4]])
TET = ("tetra", np.array([[0, 1, 3, 6]]))
ABOVE = np.vstack([POINTS, [[0.0, 0.0, 1.0]]])
APART = np.vstack([POINTS, POINTS[[1, 4]]])

#: file -> how it is written, and its area, boundary and groups
GOOD: dict[str, tuple[Writer, float, float, list[str]]] = {
    "gmsh 2.2.msh": (text(GMSH_2), 2.0, 6.0, GROUPS),
    "gmsh 4.1.msh": (text(GMSH_4), 2.0, 6.0, GROUPS),
    "gmsh 4.1 binary.msh": (mesh([("triangle", TRIANGLES)], file_format="gmsh"), 2.0, 6.0, []),
    "abaqus.inp": (text(ABAQUS), 2.0, 6.0, ["Top", "all", "glue", "steel"]),
    "abaqus plane stress.inp": (text(ABAQUS.replace("CPE4", "CPS4")), 2.0, 6.0, ["Top", "all", "glue", "steel"]),
    "abaqus clockwise.inp": (text(clockwise(ABAQUS)), 2.0, 6.0, ["Top", "all", "glue", "steel"]),
    "quads.vtu": (mesh([("quad", QUADS)]), 2.0, 6.0, []),
    "triangles with z = 0.vtu": (mesh([("triangle", TRIANGLES)]), 2.0, 6.0, []),
    "unused nodes and lines.vtu": (
        mesh([("line", QUADS[:, :2]), ("quad", QUADS)], np.vstack([POINTS, [[9.0, 9.0, 0.0]]])), 2.0, 6.0, [],
    ),
    "another z.vtk": (mesh([("quad", QUADS)], POINTS + np.array([0, 0, 7.0])), 2.0, 6.0, []),
    "slit of doubled nodes.vtu": (mesh([("quad", SLIT_CELLS)], SLIT), 2.0, 6.0, []),
    "medit.mesh": (mesh([("triangle", TRIANGLES)]), 2.0, 6.0, []),
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
    "second order.vtu": (mesh([("triangle6", np.arange(6)[None])], SECOND), "elements of type triangle6"),
    "tetrahedra.vtu": (mesh([TET], ABOVE), "elements of type tetra"),
    "only lines.vtu": (mesh([("line", QUADS[:, :2])]), "no triangles or quadrilaterals"),
    "curved.vtu": (mesh([("quad", QUADS)], moved(n4=[1, 1, 0.5])), "leaves the x-y plane"),
    "hanging node.vtu": (mesh([("quad", HANGING_CELLS)], HANGING), "a hanging node"),
    "inverted.vtu": (mesh([("quad", np.array([[0, 1, 4, 3], [1, 4, 5, 2]]))]), "inverted or collapsed"),
    "doubled cell.vtu": (mesh([("quad", QUADS[[0, 1, 1]])]), "more than two elements"),
    "doubled nodes all along.vtu": (mesh([("quad", np.array([[0, 1, 4, 3], [6, 2, 5, 7]]))], APART), "into 2 parts"),
    "marked.inp": (text(b"\xef\xbb\xbf" + ABAQUS.encode()), "begins with a byte-order mark"),
    "instances.inp": (text("*Instance, name=a\n1.0, 0.0\n*End Instance\n" + ABAQUS), "instances of parts"),
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


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_one_sentence(name: str, tmp_path: Path) -> None:
    write, said = BROKEN[name]
    write(tmp_path / name)
    with pytest.raises(CaseError) as error:
        read_mesh_file(tmp_path / name)
    assert said in str(error.value)
    assert str(error.value).startswith(f"{tmp_path / name}: ") and "\n" not in str(error.value)


def test_xdmf_is_read_where_its_library_is_there(tmp_path: Path) -> None:
    xdmf(TRIANGLES, POINTS)(tmp_path / "a.xdmf")
    if find_spec("h5py"):
        assert len(read_mesh_file(tmp_path / "a.xdmf").cells) == len(TRIANGLES)
    else:
        with pytest.raises(CaseError, match="install it with pip install h5py"):
            read_mesh_file(tmp_path / "a.xdmf")
