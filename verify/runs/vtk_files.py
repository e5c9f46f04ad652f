"""Fields of a discretisation as pyvista meshes and back."""

from dataclasses import fields as dataclass_fields
from pathlib import Path
from typing import Any

import numpy as np
import pyvista
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

from cases.units import Units
from numerics.fields import Fields

CELL_TYPES = {3: pyvista.CellType.TRIANGLE, 4: pyvista.CellType.QUAD}
# ParaView shows and warps by three components only; these are stored with a zero z.
PLANE_VECTORS = ("reference", "displacement")
POINT_DATA = (
    "reference", "volume", "displacement", "gradient", "phase_field",
    "history_field", "stress", "energy_density", "body",
)  # fmt: skip


#: components of arrays that ParaView would take for vectors
COMPONENTS = {"stress": ("xx", "yy", "xy"), "gradient": ("ux,x", "ux,y", "uy,x", "uy,y")}
#: arrays with a unit -> kind of quantity, as in `cases.units.KINDS`
KINDS_OF_ARRAYS = {
    "reference": "length", "displacement": "length", "stress": "stress", "hydrostatic_stress": "stress",
    "history_field": "stress", "energy_density": "stress", "broken_at": "time",
}  # fmt: skip
#: VTK's texts are plain ASCII
_PLAIN_SIGNS = str.maketrans({"²": "^2", "³": "^3", "⁴": "^4", "·": "*", "µ": "u", "μ": "u"})


def hydrostatic_stress(stress: np.ndarray) -> np.ndarray:
    """In-plane mean stress (s_xx + s_yy) / 2, the measure of pressure used in two dimensions.

    Parameters
    ----------
    stress : (n, 3) [case stress unit], Voigt xx, yy, xy.
    """
    return 0.5 * (stress[:, 0] + stress[:, 1])


def _in_space(plane: np.ndarray) -> np.ndarray:
    return np.column_stack([plane, np.zeros(len(plane))])


def points_mesh(fields: Fields) -> pyvista.UnstructuredGrid:
    """Integration points at their current places as vertex cells.

    Point data are named as in `numerics.fields.Fields`, and ``hydrostatic_stress`` beside them.
    """
    number = len(fields.points)
    cells = np.column_stack([np.ones(number, dtype=np.int64), np.arange(number)]).ravel()
    types = np.full(number, pyvista.CellType.VERTEX, dtype=np.uint8)
    mesh = pyvista.UnstructuredGrid(cells, types, _in_space(fields.points))
    for name in POINT_DATA:
        values = np.asarray(getattr(fields, name))
        if np.isnan(values).all():  # a result from elsewhere need not have it, and VTK cannot read a range that is none
            continue
        mesh.point_data[name] = _in_space(values) if name in PLANE_VECTORS else values
    if fields.broken_at is not None:
        mesh.point_data["broken_at"] = fields.broken_at
    if "stress" in mesh.point_data:
        mesh.point_data["hydrostatic_stress"] = hydrostatic_stress(np.asarray(fields.stress))
    return mesh


def describe(mesh: pyvista.UnstructuredGrid, u: float, units: Units | None) -> None:
    """Tell the components of its arrays, and as field data ``u``, load or time, and ``units``, such as "stress kN/mm^2".

    volume is in the cube of the unit of length, what is not listed a plain number.
    """
    for name, components in COMPONENTS.items():
        for number, component in enumerate(components if name in mesh.point_data else ()):
            mesh.GetPointData().GetArray(name).SetComponentName(number, component)
    mesh.field_data["u"] = np.array([u])
    if units is not None:
        told = {name: units.label(kind) for name, kind in KINDS_OF_ARRAYS.items() if name in mesh.point_data}
        told |= {"volume": f"{units.length}^3"} if "volume" in mesh.point_data else {}
        named = {"points": units.length, **told}.items()
        mesh.field_data["units"] = [f"{name} {unit.translate(_PLAIN_SIGNS)}" for name, unit in named]


def with_all_point_data(mesh: pyvista.UnstructuredGrid) -> pyvista.UnstructuredGrid:
    """The mesh of `points_mesh` as it was read, with NaN for what it does not hold."""
    components = {"reference": 3, "displacement": 3, "gradient": 4, "stress": 3}
    for name in (*POINT_DATA, "hydrostatic_stress"):
        if name not in mesh.point_data:
            shape = (mesh.n_points, components[name]) if name in components else mesh.n_points
            mesh.point_data[name] = np.full(shape, np.nan)
    return mesh


def grid_mesh(fields: Fields) -> pyvista.UnstructuredGrid:
    """The grid or finite element mesh in its reference place with ``displacement`` and ``phase_field``."""
    number, corners = fields.grid_cells.shape
    cells = np.column_stack([np.full(number, corners, dtype=np.int64), fields.grid_cells]).ravel()
    types = np.full(number, CELL_TYPES[corners], dtype=np.uint8)
    mesh = pyvista.UnstructuredGrid(cells, types, _in_space(fields.grid_points))
    if not np.isnan(fields.grid_displacement).all():
        mesh.point_data["displacement"] = _in_space(fields.grid_displacement)
    mesh.point_data["phase_field"] = np.asarray(fields.grid_phase_field)
    return mesh


def fields_of(points: pyvista.UnstructuredGrid, grid: pyvista.UnstructuredGrid) -> Fields:
    """The fields that `points_mesh` and `grid_mesh` were made from."""
    values: dict[str, Any] = {name: np.asarray(points.point_data[name]) for name in POINT_DATA}
    values |= {name: values[name][:, :2] for name in PLANE_VECTORS}
    values["broken_at"] = np.asarray(points.point_data["broken_at"]) if "broken_at" in points.point_data else None
    values["points"] = np.asarray(points.points)[:, :2]
    values["grid_points"] = np.asarray(grid.points)[:, :2]
    values["grid_cells"] = next(iter(grid.cells_dict.values()))
    values["grid_displacement"] = grid_displacement(grid)
    values["grid_phase_field"] = np.asarray(grid.point_data["phase_field"])
    return Fields(**{field.name: values[field.name] for field in dataclass_fields(Fields)})


def grid_displacement(grid: pyvista.UnstructuredGrid) -> np.ndarray:
    """Nodal displacement (m, 2) of the mesh of `grid_mesh`, NaN where it has none."""
    if "displacement" not in grid.point_data:
        return np.full((grid.n_points, 2), np.nan)
    return np.asarray(grid.point_data["displacement"])[:, :2]


def write_mesh(mesh: pyvista.UnstructuredGrid, path: Path) -> None:
    """Write a VTU file (binary, compressed).

    Made in memory and written by Python: on a full disk VTK's own writer ends the process.
    """
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(mesh)
    writer.SetDataModeToBinary()
    writer.SetCompressorTypeToZLib()
    writer.WriteToOutputStringOn()
    writer.Write()
    path.write_text(writer.GetOutputString(), encoding="utf-8", newline="\n")
