"""Fields of a result from elsewhere, from files of VTK, XDMF or Exodus to the fields that our own solvers show."""

from __future__ import annotations

import locale
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.errors import BrokenRuleError
from cases.foreign_fields import ForeignFields
from cases.mesh_arrays import signed_areas
from numerics.fields import Fields
from verify.runs.imported_error import ImportedError, listed
from verify.runs.xdmf_files import without_includes

if TYPE_CHECKING:
    import pyvista

#: names under which arrays are looked for, capitals apart
USUAL_NAMES = {
    "phase_field": ("phase_field", "c"),
    "damage": ("damage", "d", "damage_field", "phi", "s"),
    "displacement": ("displacement", "u", "disp", "displacements"),
    "stress": ("stress", "sigma", "stresses", "s"),
}
#: beyond 0 and 1 by more than this an array is no phase field
_SLACK = 0.1
#: a mesh this many times larger or smaller than the bodies is one of another unit
_OTHER_UNIT = 3.0
#: share of its width and height that a mesh has in common with the bodies of a case at rest
_COMMON = 0.75
#: part of the extent by which a plane mesh may leave its plane
_FLATNESS = 1e-6
_PLANE_CELL = 2


def read_states(fields: ForeignFields, case: Case) -> list[tuple[float | None, Fields]]:
    """The states of a file in their order with their times, None for a file of one state without; in units of the case.

    Integration points are the centres of the triangles that the cells are cut into; what the file does not hold is NaN.

    Raises
    ------
    ImportedError : nothing that can be read, no such array, another unit, three dimensions without a cut
    """
    reading = _Reading(fields, case)
    with same_locale():
        return [(time, reading.fields_of(mesh)) for time, mesh in _meshes(fields)]


@contextmanager
def same_locale() -> Iterator[None]:
    """VTK's legacy reader and writer leave the process in the locale "C", in which Python opens text as ASCII."""
    before = locale.setlocale(locale.LC_ALL)
    try:
        yield
    finally:
        locale.setlocale(locale.LC_ALL, before)


def _meshes(fields: ForeignFields) -> Iterator[tuple[float | None, pyvista.UnstructuredGrid]]:
    import pyvista

    file = fields.file
    try:
        with _without_warnings():
            reader = _Xdmf(file) if file.suffix.lower() in (".xdmf", ".xmf") else pyvista.get_reader(file)
    except Exception as problem:  # of an ending without a reader, or a head that is no XML
        raise _unreadable(fields, " ".join(str(problem).split())[:200]) from None
    times = list(reader.time_values) if hasattr(reader, "time_values") else []
    for time in times or [None]:
        yield time, _one_mesh(fields, reader, time)


class _Xdmf:
    """What pyvista's readers offer, for XDMF files with and without times; pyvista's own refuses the latter."""

    def __init__(self, file: Path) -> None:
        from vtkmodules.vtkIOXdmf2 import vtkXdmfReader

        self._folder = TemporaryDirectory()  # as long as there is something to read
        self._reader = vtkXdmfReader()
        self._reader.SetFileName(str(without_includes(file, Path(self._folder.name))))

    @property
    def time_values(self) -> list[float]:
        """Times of the states, none for a single one without."""
        from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline

        with _without_warnings():
            self._reader.UpdateInformation()
        return list(self._reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS()) or ())

    def set_active_time_value(self, time: float) -> None:
        """Read the state at a time."""
        self._reader.UpdateTimeStep(time)

    def read(self) -> Any:
        """The mesh."""
        import pyvista

        self._reader.Update()
        return pyvista.wrap(self._reader.GetOutputDataObject(0))


@contextmanager
def _without_warnings() -> Iterator[None]:
    """VTK prints what is wrong and goes on with nothing, which is found afterwards."""
    from vtkmodules.vtkCommonCore import vtkObject

    shown = vtkObject.GetGlobalWarningDisplay()
    vtkObject.GlobalWarningDisplayOff()
    try:
        yield
    finally:
        vtkObject.SetGlobalWarningDisplay(shown)


def _unreadable(fields: ForeignFields, why: str) -> ImportedError:
    return ImportedError(f"{fields.file}: cannot be read ({why}); give a .vtu, .pvd, .vtk, .xdmf or .exo file.")


def _one_mesh(fields: ForeignFields, reader: Any, time: float | None) -> pyvista.UnstructuredGrid:
    import pyvista

    try:
        with _without_warnings():
            if time is not None:
                reader.set_active_time_value(time)
            mesh = reader.read()
        if isinstance(mesh, pyvista.MultiBlock):
            mesh = mesh.combine()
        mesh = mesh.cast_to_unstructured_grid()
    except Exception as problem:
        raise _unreadable(fields, " ".join(str(problem).split())[:200] or type(problem).__name__) from None
    if not mesh.n_cells:
        raise _unreadable(fields, "no cells are found in it")
    return mesh


class _Reading:
    """From meshes of one file to the fields of a case."""

    def __init__(self, fields: ForeignFields, case: Case) -> None:
        self.fields, self.case = fields, case
        self.scale = self._scale()

    def _error(self, text: str) -> ImportedError:
        return ImportedError(f"{self.fields.file}: {text}.")

    def _scale(self) -> float:
        if not self.fields.unit:
            return 1.0
        try:
            return self.case.units.convert(f"1 {self.fields.unit}", "length")
        except BrokenRuleError as error:
            remedy = f"give a unit of length, such as {self.case.units.length}"
            raise self._error(f"unit = {self.fields.unit!r} {error.text}; {remedy}") from None

    def fields_of(self, mesh: pyvista.UnstructuredGrid) -> Fields:
        """The fields of one state."""
        present = [*mesh.point_data.keys(), *mesh.cell_data.keys()]
        mesh, axes = self._plane(mesh)
        kinds, first = np.unique(mesh.celltypes, return_index=True)
        plane = [kind for kind, one in zip(kinds, first, strict=True) if mesh.get_cell(int(one)).dimension == _PLANE_CELL]
        mesh = mesh.extract_cells(np.flatnonzero(np.isin(mesh.celltypes, plane)).tolist())
        if not mesh.n_cells:
            raise self._error("holds no triangles or quadrilaterals; save its surface cells")
        names = self._arrays(present)
        mesh = mesh.cell_data_to_point_data(pass_cell_data=True).triangulate()
        cells = np.asarray(mesh.cells_dict[np.uint8(5)], dtype=np.int64)
        grid_points = self.scale * np.asarray(mesh.points, dtype=float)[:, axes]
        self._require_place(grid_points)
        nodal = {key: np.asarray(mesh.point_data[name], dtype=float) for key, name in names.items()}
        nodal = self._in_plane(nodal, axes, len(grid_points))
        given = {key: np.asarray(mesh.cell_data[name]) for key, name in names.items() if name in mesh.cell_data}
        central = {key: values[cells].mean(axis=1) for key, values in nodal.items()}
        central |= self._in_plane(given, axes, len(cells))
        self._require_phase_field(central["phase_field"], signed_areas(grid_points, cells), names)
        return _fields(grid_points, cells, nodal, central, self.case.plane.thickness)

    # -------------------------------------------------------------------------------------------- checks

    def _plane(self, mesh: pyvista.UnstructuredGrid) -> tuple[pyvista.UnstructuredGrid, list[int]]:
        """The plane mesh and which coordinates are x and y."""
        extent, plane = np.ptp(np.asarray(mesh.points), axis=0), self.fields.plane
        if plane is None:
            if extent[2] > _FLATNESS * extent.max():
                raise self._error(
                    f'is three-dimensional, z from {mesh.bounds[4]:g} to {mesh.bounds[5]:g}; name a plane such as'
                    f' cut = "z = {0.5 * (mesh.bounds[4] + mesh.bounds[5]):g}" (crack fronts are not judged)'
                )
            return mesh, [0, 1]
        axis, place = plane
        low, high = mesh.bounds[2 * axis : 2 * axis + 2]
        if extent[axis] > _FLATNESS * extent.max():
            mesh = mesh.slice(normal=np.eye(3)[axis], origin=np.eye(3)[axis] * place).cast_to_unstructured_grid()
        elif abs(place - low) > _FLATNESS * extent.max():
            mesh = mesh.extract_cells([])
        if not mesh.n_cells:
            raise self._error(f'cut = "{self.fields.cut}" meets no cell; the mesh reaches from {low:g} to {high:g}')
        return mesh, [other for other in range(3) if other != axis]

    def _arrays(self, present: list[str]) -> dict[str, str]:
        """What is held -> name of its array; "damage" or "phase_field" is among them."""
        found: dict[str, str] = {}
        for key, usual in USUAL_NAMES.items():
            asked = getattr(self.fields, key)
            if asked and asked not in present:
                raise self._error(f"has no array {asked!r} for {key}; it has {listed(present) or 'none'}")
            name = asked or next((name for name in present if name.lower() in usual), "")
            if name and name not in found.values():
                found[key] = name
        if self.fields.phase_field or (self.fields.damage == "" and "phase_field" in found):
            found.pop("damage", None)
        elif "damage" in found:
            found.pop("phase_field", None)
        else:
            example = 'phase_field = "NAME" (1 intact) or damage = "NAME" (1 broken)'
            raise self._error(f"no array is phase field or damage; say which with {example}; it has {listed(present)}")
        return found

    def _require_place(self, points: NDArray) -> None:
        mine, bodies = (points.min(axis=0), points.max(axis=0)), self.case.bounding_box()
        ratio = np.abs(np.log(np.ptp(points, axis=0) / np.subtract(bodies[1], bodies[0])))
        apart = np.any(mine[0] > bodies[1]) or np.any(mine[1] < bodies[0])
        common = np.minimum(mine[1], bodies[1]) - np.maximum(mine[0], bodies[0])
        smaller = np.minimum(np.ptp(points, axis=0), np.subtract(bodies[1], bodies[0]))
        # moving bodies may have been drawn where they are
        elsewhere = self.case.dynamics is None and bool(np.any(common < _COMMON * smaller))
        other_size = not (ratio <= np.log(_OTHER_UNIT)).all()
        if apart or other_size or elsewhere:
            spans = [", ".join(f"{a:g} to {b:g}" for a, b in zip(*box, strict=True)) for box in (mine, bodies)]
            said = f"its mesh spans {spans[0]} in x and y, the bodies of the case {spans[1]} {self.case.units.length}"
            unit = 'give the unit of its lengths, such as unit = "m", or the right file'
            raise self._error(f"{said}; {'move it to where they are' if elsewhere and not other_size else unit}")

    def _in_plane(self, arrays: dict[str, NDArray], axes: list[int], count: int) -> dict[str, NDArray]:
        """The arrays with the components of the plane, c for d, and displacements in the unit of the case."""
        found: dict[str, NDArray] = {}
        for key, values in arrays.items():
            components = values.reshape(count, -1)
            if key in ("phase_field", "damage"):
                found["phase_field"] = 1.0 - components[:, 0] if key == "damage" else components[:, 0]
                key, ok = "phase_field", components.shape[1] == 1
            elif key == "displacement":
                ok = components.shape[1] > max(axes)
                found[key] = self.scale * components[:, axes] if ok else values
            else:
                ok = components.shape[1] in _PLANE_STRESS and axes == [0, 1]
                found[key] = components[:, _PLANE_STRESS[components.shape[1]]] if ok else np.full((count, 3), np.nan)
                ok = ok or axes != [0, 1]
            if not ok:
                raise self._error(f"the array for {key} has {components.shape[1]} components; name another one")
        return found

    def _require_phase_field(self, c: NDArray, areas: NDArray, names: dict[str, str]) -> None:
        name = names.get("phase_field") or names["damage"]
        if not np.isfinite(c).all() or c.min() < -_SLACK or c.max() > 1.0 + _SLACK:
            said = "is not finite" if not np.isfinite(c).all() else "leaves the range from 0 to 1"
            raise self._error(f"array {name!r} {said}; name the one that holds the phase field or damage")
        if np.average(c, weights=np.abs(areas)) < 0.5:
            other = "phase_field" if "damage" in names else "damage"
            raise self._error(f'by array {name!r} most of the body is broken; name it with {other} = "{name}"')


#: number of components -> those that are xx, yy and xy
_PLANE_STRESS = {3: [0, 1, 2], 4: [0, 1, 3], 6: [0, 1, 3], 9: [0, 4, 1]}


def fields_on_mesh(
    points: NDArray, cells: NDArray, phase_field: NDArray, displacement: NDArray, thickness: float
) -> Fields:
    """The fields of nodal values on triangles or quadrilaterals (k, 3 or 4) with counter-clockwise corners.

    points, displacement : (n, 2) [length]. phase_field : (n,). What does not follow from them is NaN.
    """
    if cells.shape[1] == 4:
        cells = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    nodal = {"phase_field": phase_field, "displacement": displacement}
    return _fields(points, cells, nodal, {"phase_field": phase_field[cells].mean(axis=1)}, thickness)


def _fields(
    points: NDArray, cells: NDArray, nodal: dict[str, NDArray], central: dict[str, NDArray], thickness: float
) -> Fields:
    count, nothing = len(cells), np.full(len(cells), np.nan)
    displacement = nodal.get("displacement", np.full((len(points), 2), np.nan))
    gradient = _gradient(points, cells, displacement)
    stress = central.get("stress", np.full((count, 3), np.nan))
    strain = np.stack([gradient[:, 0], gradient[:, 3], gradient[:, 1] + gradient[:, 2]], axis=1)
    centres, moved = points[cells].mean(axis=1), displacement[cells].mean(axis=1)
    return Fields(
        points=centres + np.nan_to_num(moved), reference=centres, volume=np.abs(signed_areas(points, cells)) * thickness,
        displacement=moved, gradient=gradient, phase_field=central["phase_field"], history_field=nothing,
        stress=stress, energy_density=0.5 * (stress * strain).sum(axis=1), body=np.zeros(count, dtype=np.int64),
        grid_points=points, grid_cells=cells, grid_displacement=displacement, grid_phase_field=nodal["phase_field"],
    )  # fmt: skip


def _gradient(points: NDArray, cells: NDArray, displacement: NDArray) -> NDArray:
    """ux,x ux,y uy,x uy,y (n, 4) of linear triangles."""
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    steps = displacement[cells[:, 1:]] - displacement[cells[:, :1]]
    flat = np.abs(np.linalg.det(edges)) <= 0.0
    edges[flat] = np.eye(2)
    gradient = np.linalg.solve(edges, steps)
    gradient[flat] = np.nan
    return gradient.transpose(0, 2, 1).reshape(-1, 4)
