"""Named groups of mesh files: physical groups of Gmsh (2.2, 4.1), element and node sets of Abaqus.

`meshio` is imported on use: it is slow to import, and few cases bring a mesh.
"""

from __future__ import annotations

import codecs
import contextlib
import io
import re
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from cases.abaqus_files import read_abaqus
from cases.errors import BrokenRuleError, CaseError, MeshError

if TYPE_CHECKING:
    import meshio
    from shapely.geometry.base import BaseGeometry

#: corners of the cells of a plane mesh that lines and areas are made of, those of second order without their other nodes
CORNERS = {
    "vertex": 1, "line": 2, "line3": 2, "triangle": 3, "triangle6": 3, "triangle7": 3, "quad": 4, "quad8": 4, "quad9": 4,
}  # fmt: skip
_GMSH, _ENTITY = "gmsh:physical", "gmsh:geometrical"


def cells_of_groups(mesh: meshio.Mesh) -> dict[str, list[NDArray]]:
    """Name of each group of cells -> the numbers of its cells in each block of the mesh."""
    found: dict[str, list[NDArray]] = {}
    for name, blocks in mesh.cell_sets.items():
        if not name.startswith("gmsh:"):
            empty = np.empty(0, dtype=np.int64)
            found[name] = [empty if cells is None else np.asarray(cells, dtype=np.int64) for cells in blocks]
    if _GMSH in mesh.cell_data:  # one group of each cell; the sets of Gmsh 4.1 know all of them
        for name, (tag, dimension) in mesh.field_data.items():
            tags = zip(mesh.cells, mesh.cell_data[_GMSH], strict=True)
            of_tag = [np.flatnonzero((data == tag) & (block.dim == dimension)) for block, data in tags]
            found.setdefault(name, of_tag)
    return found


def groups_of_areas(mesh: meshio.Mesh) -> list[str]:
    """Names of the groups that a body can be made of, which hold more than lines and points."""
    of_lines = [CORNERS.get(block.type, 3) < 3 for block in mesh.cells]
    return [
        name
        for name, blocks in cells_of_groups(mesh).items()
        if any(len(cells) and not lines for cells, lines in zip(blocks, of_lines, strict=True))
    ]


def only_group(path: Path, mesh: meshio.Mesh, group: str | None) -> meshio.Mesh:
    """The mesh with the cells of a group alone; without one all of them. Raises CaseError for an unknown name."""
    import meshio

    if group is None:
        return meshio.Mesh(mesh.points, _each_once(mesh)) if {_GMSH, _ENTITY} <= mesh.cell_data.keys() else mesh

    groups = cells_of_groups(mesh)
    if group not in groups:
        raise CaseError(f"{path}: has no group {group!r} of cells; it has {_listed(groups)}.")
    chosen = zip(mesh.cells, groups[group], strict=True)
    return meshio.Mesh(mesh.points, [(block.type, block.data[cells]) for block, cells in chosen if len(cells)])


def _each_once(mesh: meshio.Mesh) -> list[tuple[str, NDArray]]:
    """The cells, of which Gmsh 2.2 writes one of several groups once for each of them."""
    kept: list[tuple[str, NDArray]] = []
    first: dict[tuple[int, ...], int] = {}
    for block, groups, entities in zip(mesh.cells, mesh.cell_data[_GMSH], mesh.cell_data[_ENTITY], strict=True):
        rows = map(tuple, np.column_stack([entities, block.data]).tolist())
        first_of = [first.setdefault(row, group) for row, group in zip(rows, groups.tolist(), strict=True)]
        kept.append((block.type, block.data[np.array(first_of) == groups]))
    return [(kind, cells) for kind, cells in kept if len(cells)]


def boundary_of_group(path: Path, group: str) -> BaseGeometry:
    """Lines, areas or points of a group in a mesh file, in the file's own numbers.

    Of a set of nodes the edges on the outline whose ends both belong to it, and where there are none the nodes. Where
    nodes and elements have one name and the nodes are some of those of the elements, they are meant: of an edge
    Abaqus/CAE writes its nodes, and by the same name the elements beside it.

    Raises
    ------
    BrokenRuleError : no such group
    """
    return _boundary(path, group, path.stat().st_mtime_ns)


def names_of_groups(path: Path) -> list[str]:
    """Names of all groups of a mesh file, of cells and of nodes."""
    mesh = read_mesh(path)
    return sorted({*cells_of_groups(mesh), *mesh.point_sets})


def read_mesh(path: Path) -> Any:
    """A mesh file as meshio has it; CaseError where it cannot be read."""
    return _read(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=8)
def _read(path: Path, modified: int) -> Any:
    """meshio prints its complaints and leaves the program; both become one sentence here."""
    import meshio
    from meshio.gmsh import _gmsh41

    with path.open("rb") as file:
        if file.read(len(codecs.BOM_UTF8)) == codecs.BOM_UTF8:
            raise MeshError(f"{path}: begins with a byte-order mark, which no mesh has; save it as UTF-8 without one")
    try:
        if path.suffix.lower() == ".inp":
            return read_abaqus(path)
        if path.suffix.lower() == ".bdf":
            _check_no_coordinate_systems(path)
        if path.suffix.lower() == ".msh":
            _check_each_name_once(path)
        _gmsh41.Mesh = _with_whole_data
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            return meshio.read(path)
    except MeshError:
        raise
    except UnicodeDecodeError as error:
        raise MeshError(f"{path}: is no UTF-8 text (byte {error.start}); save it in UTF-8") from None
    except ModuleNotFoundError as missing:
        remedy = f"install it with pip install {missing.name}, or export it as Gmsh .msh, Abaqus .inp or VTU"
        raise MeshError(f"{path}: is read by {missing.name}, which is missing; {remedy}") from None
    except (Exception, SystemExit) as problem:
        why = " ".join(str(problem).split())[:200]
        raise MeshError(
            f"{path}: the mesh cannot be read ({why or type(problem).__name__}); export it again as Gmsh .msh,"
            " Abaqus .inp or VTU"
        ) from problem


def _check_each_name_once(path: Path) -> None:
    """Gmsh tells groups by name and dimension, meshio by name alone: of two of one name it would keep one."""
    section = re.search(rb"^\$PhysicalNames\s(.*?)^\$EndPhysicalNames", path.read_bytes(), re.DOTALL | re.MULTILINE)
    names = re.findall(r'"(.*)"', section[1].decode("utf-8", "replace")) if section else []
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise MeshError(f"{path}: has two physical groups called {twice!r}; give each a name of its own, curves too")


def _check_no_coordinate_systems(path: Path) -> None:
    """meshio takes the numbers of a node for x, y and z, whatever coordinate system of Nastran they are in."""
    for line in path.read_text(encoding="utf-8").upper().splitlines():
        width = 16 if line.startswith("GRID*") else 8
        system = line.split(",")[2:3] if "," in line else [line[8 + width : 8 + 2 * width]]
        if line.startswith(("GRID", "GRDSET")) and "".join(system).strip() not in ("", "0"):
            shown = " ".join(line.split())[:40]
            raise MeshError(f"{path}: has nodes in coordinates of their own ({shown}); export it in basic ones")


def _with_whole_data(points: NDArray, cells: list[Any], cell_data: dict[str, Any], **rest: Any) -> meshio.Mesh:
    """A mesh of Gmsh 4.1, of which meshio tells no tags of cells that are in no group and then refuses it."""
    import meshio

    whole = {name: data for name, data in cell_data.items() if len(data) == len(cells)}
    return meshio.Mesh(points, cells, cell_data=whole, **rest)


@lru_cache(maxsize=64)
def _boundary(path: Path, group: str, modified: int) -> BaseGeometry:
    mesh = read_mesh(path)
    points, groups = np.asarray(mesh.points)[:, :2], cells_of_groups(mesh)
    if group in groups and not _is_set_of_nodes(mesh, group, groups[group]):
        chosen = zip(mesh.cells, groups[group], strict=True)
        plane = [(block.data[some], CORNERS[block.type]) for block, some in chosen if block.type in CORNERS]
        cells = [cell for data, corners in plane for cell in data[:, :corners]]
        if not cells:
            raise BrokenRuleError("holds nothing", "name another group, or save its elements", "group", group)
        return shapely.union_all([_shape_of(points[cell]) for cell in cells])
    if group not in mesh.point_sets:
        raise BrokenRuleError("is no group of the mesh", f"name one of {_listed(names_of_groups(path))}", "group", group)
    nodes = np.asarray(mesh.point_sets[group], dtype=np.int64)
    if not len(nodes):
        raise BrokenRuleError("holds nothing", "name another group, or give it nodes", "group", group)
    edges = _outline_edges(mesh)
    edges = edges[np.isin(edges, nodes).all(axis=1)]
    if len(edges):
        return shapely.union_all(shapely.linestrings(points[edges]))
    return shapely.union_all(shapely.points(points[nodes]))


def _is_set_of_nodes(mesh: Any, group: str, cells: list[NDArray]) -> bool:
    """Some, but not all, nodes of the cells of this name are in a set of nodes of the same name."""
    chosen = zip(mesh.cells, cells, strict=True)
    of_cells = np.concatenate([np.empty(0, dtype=np.int64), *(block.data[some].ravel() for block, some in chosen)])
    return bool(len(mesh.point_sets.get(group, ()))) and not np.isin(of_cells, mesh.point_sets[group]).all()


def _shape_of(corners: NDArray) -> BaseGeometry:
    kinds = {1: lambda c: shapely.Point(c[0]), 2: shapely.LineString}
    return kinds.get(len(corners), shapely.Polygon)(corners)


def _outline_edges(mesh: Any) -> NDArray:
    """Ends (n, 2) of the edges that belong to one plane cell only."""
    corners = [np.asarray(b.data)[:, : CORNERS[b.type]] for b in mesh.cells if CORNERS.get(b.type, 0) > 2]
    edges = [np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2) for cells in corners]
    if not edges:
        return np.empty((0, 2), dtype=np.int64)
    unique, count = np.unique(np.sort(np.vstack(edges), axis=1), axis=0, return_counts=True)
    return unique[count == 1]


def _listed(names: Any) -> str:
    return ", ".join(map(str, names)) or "none"
