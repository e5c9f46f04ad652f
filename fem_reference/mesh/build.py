"""The mesh of a case: rectilinear quadrilaterals, netgen's triangles, or what the user brings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
import skfem
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from cases import Case
from cases.errors import MeshError
from cases.geometry import Box, Shape
from cases.mesh_arrays import (
    Floats,
    Integers,
    MeshArrays,
    edge_lengths,
    joined,
    signed_areas,
)
from cases.mesh_files import SAME_PLACE, hanging_node, mesh_slits, read_mesh_file
from cases.notches import CellsNotch, Segment, SlitNotch
from cases.spacing import grid_blocks
from fem_reference.mesh.quads import rectangles
from fem_reference.mesh.slits import split_slits
from fem_reference.mesh.triangles import (
    SNAP,
    Feature,
    SizedBox,
    SizeField,
    circles_of,
    cuts_of_box,
    notch_outline,
    outline_of,
    planar_graph,
    snapped,
    triangulate,
)
from numerics.built import check_notches_part

__all__ = ["Mesh", "MeshError", "build_mesh"]

# What to do about a slit that the mesh does not follow.
REMEDY_QUADS = 'set mesh.element = "triangle"'
REMEDY_TRIANGLES = 'move it into a body, or make it a notch of kind "cells"'
REMEDY_FINER = 'make mesh.h no more than half of it, or set mesh.element = "triangle"'
REMEDY_FINER_FILE = "draw the notch as edges in the mesh file"
REMEDY_FILE = "draw the slit as edges in the mesh file"
# Triangles that netgen makes in the square of the wanted size, and where it is held to it in a box: 4 / sqrt(3) would be
# equilateral ones of that size.
TRIANGLES_IN_A_SQUARE, TRIANGLES_IN_A_BOX = 2.75, 2.05
# Blocks along each axis over which triangles are counted before they are made.
BLOCKS = 500


@dataclass(frozen=True)
class Mesh:
    """Elements in the reference configuration.

    mesh : nodes [case length unit] and elements, corners counter-clockwise
    body : (n_elements,) index into list(case.bodies)
    """

    mesh: skfem.MeshQuad1 | skfem.MeshTri1
    body: Integers

    @property
    def arrays(self) -> MeshArrays:
        """The same mesh as plain arrays."""
        return MeshArrays(self.mesh.p.T, self.mesh.t.T.astype(np.int64), self.body)


def build_mesh(case: Case) -> Mesh:
    """The finite elements of a case.

    Shapes with axis-parallel edges become cells of `cases.spacing.grid_lines` unless mesh.element = "triangle"; with
    that, or as soon as one body has another shape, all shapes are filled with triangles. A body given as a file keeps the
    file's elements. Bodies that share an edge share its nodes; in dynamics bodies from files stay apart.
    Notches of kind "slit" are opened, those of kind "cells" left out, those of kind "history" passed over.

    Raises MeshError, a CaseError: one sentence with the case's file, the key and the remedy.
    """
    try:
        mesh = _opened_mesh(case)
    except MeshError as problem:
        raise MeshError(f"{case.source}: {problem}") from problem.__cause__
    kind = skfem.MeshTri1 if mesh.cells.shape[1] == 3 else skfem.MeshQuad1
    # scikit-fem would sort the corners of triangles by number, and half of them would turn clockwise.
    return Mesh(kind(mesh.points.T.copy(), mesh.cells.T.copy(), sort_t=False), mesh.body)


def uses_quads(case: Case) -> bool:
    """The shapes of the case become quadrilaterals."""
    shapes = [body.shape for body in case.bodies.values() if body.shape]
    return case.mesh.element == "quad" and all(shape.is_rectilinear for shape in shapes)


def expected_triangles(case: Case, with_outlines: bool) -> tuple[Floats, Floats]:
    """Number (n_bodies,) of the triangles that `build_mesh` will make of each shape, and its nodes (n, 2) on outlines.

    The number is estimated to a few per cent. with_outlines : find the nodes, which takes its time where there are very
    many; none without.
    """
    shapes = {index: body.shape for index, body in enumerate(case.bodies.values()) if body.shape}
    size, outlines, blocks = _size_field(case), _outlines(case, shapes), grid_blocks(case, BLOCKS)
    held = np.any([box.away(blocks.centres) == 0.0 for box in size.boxes if not size.is_uniform], axis=0)
    density = np.where(held, TRIANGLES_IN_A_BOX, TRIANGLES_IN_A_SQUARE) * blocks.areas / size(blocks.centres) ** 2
    number = np.zeros(len(case.bodies))
    for index, outline in zip(shapes, outlines, strict=True):
        inside = shapely.contains_xy(outline, *blocks.centres.T)
        number[index] = density[inside].sum() * outline.area / blocks.areas[inside].sum() if inside.any() else 1.0
    if not with_outlines:
        return number, np.zeros((0, 2))
    slits = [snapped(slit, outlines, SNAP * case.mesh.h) for slit in _slits(case).values()]
    return number, planar_graph(outlines, slits, _anchors(case), size).points


def _opened_mesh(case: Case) -> MeshArrays:
    """All bodies as one mesh without its notches."""
    slits, remedy = _slits(case), REMEDY_QUADS if uses_quads(case) else REMEDY_TRIANGLES
    shapes = {index: body.shape for index, body in enumerate(case.bodies.values()) if body.shape}
    parts = [
        _without_notches(case, read_mesh_file(body.mesh, index, body.group))
        for index, body in enumerate(case.bodies.values())
        if body.mesh
    ]
    remedy, finer = (REMEDY_FILE, REMEDY_FINER_FILE) if parts else (remedy, REMEDY_FINER)
    if shapes and uses_quads(case):
        parts.append(_without_notches(case, rectangles(case, list(shapes))))
    elif shapes:
        outlines = _outlines(case, shapes)
        slits = {key: snapped(slit, outlines, SNAP * case.mesh.h) for key, slit in slits.items()}
        parts.append(_triangles(case, shapes, outlines, list(slits.values())))
    _check_one_kind(case, parts)
    mesh = joined(parts)
    if case.dynamics is None:
        mesh = _welded(mesh, np.repeat(np.arange(len(parts)), [len(part.points) for part in parts]))
    _check_no_body_is_gone(case, mesh)
    mesh = split_slits(mesh, slits, remedy)
    check_notches_part(case, mesh.centres(), mesh.cells, case.mesh.h, finer)
    return mesh


def _slits(case: Case) -> dict[str, Segment]:
    """Notches of kind "slit" by their keys in the file, less those that a mesh file has open already."""
    slits = {f"notches[{n}]": notch for n, notch in enumerate(case.all_notches) if isinstance(notch, SlitNotch)}
    is_open = [slit for body in case.bodies.values() if body.mesh for slit in mesh_slits(body.mesh, (body.group,))]
    return {key: slit for key, slit in slits.items() if not any(slit.lies_on(other) for other in is_open)}


def _without_notches(case: Case, mesh: MeshArrays) -> MeshArrays:
    """The mesh without the elements whose centres lie in notches of kind "cells"."""
    return mesh.keep(~case.left_out(mesh.centres()))


def _size_field(case: Case) -> SizeField:
    mesh, features = case.mesh, _features(case)
    if mesh.fine is None:
        return SizeField(mesh.h, mesh.h, mesh.growth, features=features)
    coarse = mesh.coarse or float(np.ptp(case.bounding_box(), axis=0).max())
    refined = tuple(_sized(case, box, box.h) for box in mesh.refine)
    return SizeField(mesh.h, coarse, mesh.growth, _sized(case, mesh.fine, mesh.h), refined, features)


def _sized(case: Case, box: Box, size: float) -> SizedBox:
    """The box cut to the bodies, because netgen is told the size along lines all over it."""
    lower, upper = case.bounding_box()
    return SizedBox(np.clip(box.lower, lower, upper), np.clip(box.upper, lower, upper), size)


def _features(case: Case) -> tuple[Feature, ...]:
    """Circles and the ends of narrow notches, which need small elements wherever they are."""
    circles = [c for body in case.bodies.values() if body.shape for c in circles_of(body.shape)]
    narrow = [notch for notch in case.notches if isinstance(notch, CellsNotch)]
    ends = [Feature(end, 0.0, notch.width) for notch in narrow for end in (notch.start, notch.end)]
    return (*(Feature.of_circle(circle) for circle in circles), *ends)


def _anchors(case: Case) -> list[tuple[float, float]]:
    """Points that are to be nodes where they lie on an outline: ends of notches, of supports and of loads."""
    shapes = [body.shape for body in case.bodies.values() if body.shape]
    anchors = [end for notch in case.notches for end in (notch.start, notch.end)]
    moved = {c.on for c in case.constraints if c.direction != "phase"} | {traction.on for traction in case.tractions}
    for name, boundary in case.boundaries.items():
        if boundary.point:
            anchors.append(boundary.point)
        if boundary.segment:
            anchors += boundary.segment
        if boundary.box:
            anchors += [boundary.box.lower, boundary.box.upper]
            if name in moved:
                anchors += [cut for shape in shapes for cut in cuts_of_box(shape, boundary.box)]
    return anchors


def _outlines(case: Case, shapes: dict[int, Shape]) -> list[BaseGeometry]:
    """Polygons of the bodies without the notches of kind "cells"."""
    outlines = [outline_of(shape, _size_field(case), _anchors(case)) for shape in shapes.values()]
    for notch in case.notches:
        if isinstance(notch, CellsNotch):
            outlines = [body - notch_outline(notch, body) for body in outlines]
    return outlines


def _triangles(
    case: Case, shapes: dict[int, Shape], outlines: list[BaseGeometry], slits: list[Segment]
) -> MeshArrays:
    circles = [circle for shape in shapes.values() for circle in circles_of(shape)]
    mesh = triangulate(outlines, _size_field(case), slits, _anchors(case), circles)
    return MeshArrays(mesh.points, mesh.cells, np.array(list(shapes))[mesh.body])


def _check_one_kind(case: Case, parts: list[MeshArrays]) -> None:
    if len({part.cells.shape[1] for part in parts}) > 1:
        remedy = 'mesh the file with triangles and set mesh.element = "triangle"'
        raise MeshError(f"bodies: {', '.join(case.bodies)} mix triangles and quadrilaterals; {remedy}")


def _welded(mesh: MeshArrays, part: Integers) -> MeshArrays:
    """The mesh with one node where nodes of several parts (n_points,) lie on each other; what one doubles stays so."""
    if not part.any():
        return mesh
    near = SAME_PLACE * edge_lengths(mesh.points, mesh.cells).min()
    pairs = cKDTree(mesh.points).query_pairs(near, output_type="ndarray")
    pairs = pairs[part[pairs[:, 0]] != part[pairs[:, 1]]]
    number = np.arange(len(mesh.points))
    for first, other in pairs[np.lexsort(pairs.T[::-1])]:
        number[other] = number[first]
    mesh = replace(mesh, cells=number[mesh.cells]).without_unused_points()
    if (place := hanging_node(mesh)) is not None:
        raise MeshError(
            f"bodies: at ({place[0]:.6g}, {place[1]:.6g}) a node of one lies within an element's edge of another; give"
            " the meshes common nodes where bodies touch"
        )
    return mesh


def _check_no_body_is_gone(case: Case, mesh: MeshArrays) -> None:
    for index, name in enumerate(case.bodies):
        if not signed_areas(mesh.points, mesh.cells[mesh.body == index]).sum() > 0.0:
            raise MeshError(f"bodies.{name}: the notches leave no element of it; make them narrower")
