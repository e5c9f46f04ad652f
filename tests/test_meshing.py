"""Meshes of cases: areas, slits, left-out cells, sizes, netgen's triangles, the user's files, errors."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from cases import Case, CaseError, load_case
from cases.mesh_arrays import MeshArrays, corner_jacobians, cross, edge_lengths, edge_table, signed_areas
from cases.notches import CellsNotch, Segment
from cases.spacing import count_cells
from fem_reference.mesh.build import Mesh, MeshError, build_mesh
from fem_reference.mesh.quads import rectilinear
from fem_reference.mesh.slits import cells_cut_by, split_slits
from fem_reference.mesh.triangles import SizedBox, SizeField
from mpm.placement import place_points
from numerics.description import describe
from numerics.element_quality import scaled_jacobian

FRAME = """
title = "Mesh"
requirement = "A mesh is made."
units = { length = "mm", force = "kN" }
plane = { assumption = "strain" }
materials.steel = { young = 210.0, poisson = 0.3, fracture = { toughness = 2.7e-3, length_scale = 100.0 } }
load = { path = [0.0] }
"""
UNIT_SQUARE = "{ rectangle = { lower = [0, 0], upper = [1, 1] } }"
PLATE_WITH_HOLE = (
    "{ difference = { of = { rectangle = { lower = [0, 0], upper = [65, 120] } }, "
    "minus = [{ disc = { centre = [36.5, 51], radius = 10 } }] } }"
)
FINE_BOX = "coarse = 0.1, growth = 1.3, fine = { lower = [0.45, 0], upper = [1, 0.55] }"
BOTH_ELEMENTS = pytest.mark.parametrize("element", ["quad", "triangle"])


def smallest_angle(mesh: Mesh) -> float:
    """Of all corners of all elements [degrees]."""
    corners = mesh.arrays.points[mesh.arrays.cells]
    ahead, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    return float(np.degrees(np.arctan2(cross(ahead, back), (ahead * back).sum(axis=-1))).min())


def write_case(folder: Path, bodies: str, mesh: str, notches: str = "") -> Case:
    """A case of these bodies (one shape, or lines `bodies.<name> = ...`), mesh table entries and notches."""
    if bodies.startswith("{"):
        bodies = f'bodies.plate = {{ material = "steel", shape = {bodies} }}'
    source = folder / "case.toml"
    source.write_text("\n".join([FRAME, bodies, f"mesh = {{ {mesh} }}", f"notches = [{notches}]"]))
    return load_case(source)


def notch(kind: str, start: tuple[float, float], end: tuple[float, float], width: float | None = None) -> str:
    across = f", width = {width}" if width else ""
    return f'{{ kind = "{kind}", start = {list(start)}, end = {list(end)}{across} }}'


def area(mesh: Mesh) -> float:
    return float(signed_areas(mesh.arrays.points, mesh.arrays.cells).sum())


def doubled_points(mesh: Mesh) -> np.ndarray:
    """Positions at which there is more than one node, (n, 2)."""
    points, count = np.unique(mesh.arrays.points, axis=0, return_counts=True)
    return points[count > 1]


def components(cells: np.ndarray) -> np.ndarray:
    """Number of the component of each element; elements that share a node are in one."""
    rows = np.repeat(np.arange(len(cells)), cells.shape[1])
    incidence = coo_array((np.ones(cells.size), (rows, cells.ravel()))).tocsr()
    return connected_components(incidence @ incidence.T, directed=False)[1]


def assert_counter_clockwise(mesh: Mesh) -> None:
    assert corner_jacobians(mesh.arrays.points, mesh.arrays.cells).min() > 0.0
    middle = np.full((2, 1), 0.4)
    assert mesh.mesh.mapping().detDF(middle).min() > 0.0


# ------------------------------------------------------------------ shapes


@BOTH_ELEMENTS
def test_the_unit_square_is_covered_exactly(tmp_path: Path, element: str) -> None:
    mesh = build_mesh(write_case(tmp_path, UNIT_SQUARE, f'h = 0.05, {FINE_BOX}, element = "{element}"'))
    assert area(mesh) == pytest.approx(1.0, abs=1e-12)
    assert mesh.mesh.t.shape[0] == {"quad": 4, "triangle": 3}[element]
    assert_counter_clockwise(mesh)


def test_a_polygon_becomes_triangles_of_its_area(tmp_path: Path) -> None:
    shape = "{ polygon = { points = [[0, 0], [3, 0.2], [2.5, 2], [1, 1.1]] } }"
    mesh = build_mesh(write_case(tmp_path, shape, "h = 0.2"))
    x, y = np.array([[0, 0], [3, 0.2], [2.5, 2], [1, 1.1]]).T
    assert area(mesh) == pytest.approx(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)), rel=1e-9)
    assert_counter_clockwise(mesh)


def test_outlines_along_the_axes_become_quads(tmp_path: Path) -> None:
    corner = "{ polygon = { points = [[0, 0], [0.5, 0], [0.5, 0.5], [1, 0.5], [1, 1], [0, 1]] } }"
    mesh = build_mesh(write_case(tmp_path, corner, "h = 0.1")).arrays
    assert mesh.cells.shape == (75, 4)
    assert signed_areas(mesh.points, mesh.cells).sum() == pytest.approx(0.75)


def test_a_plate_with_a_hole(tmp_path: Path) -> None:
    fine = "h = 1.0, coarse = 5, fine = { lower = [5, 40], upper = [65, 70] }"
    mesh = build_mesh(write_case(tmp_path, PLATE_WITH_HOLE, fine))
    assert area(mesh) == pytest.approx(65 * 120 - np.pi * 10**2, rel=5e-3)
    edges = edge_table(mesh.arrays.cells)
    ends = mesh.arrays.points[edges.ends[edges.count == 1]]
    from_centre = np.linalg.norm(ends - [36.5, 51], axis=2)
    on_hole = (from_centre < 10.5).all(axis=1)
    assert on_hole.sum() >= 48
    assert from_centre[on_hole] == pytest.approx(10.0, abs=1e-8)
    assert smallest_angle(mesh) > 20.0


def test_nodes_that_netgen_adds_on_a_coarse_circle_lie_on_it(tmp_path: Path) -> None:
    # The small hole makes netgen divide the chords of the large one beside it.
    small_hole = "{ polygon = { points = [[44, 58.5], [44.1, 58.5], [44, 58.6]] } }"
    mesh = build_mesh(write_case(tmp_path, PLATE_WITH_HOLE.replace("[{", f"[{small_hole}, {{"), "h = 5"))
    edges = edge_table(mesh.arrays.cells)
    points = mesh.arrays.points[np.unique(edges.ends[edges.count == 1])]
    from_centre = np.linalg.norm(points - [36.5, 51], axis=1)
    on_hole = np.abs(from_centre - 10.0) < 0.1
    assert on_hole.sum() > 48
    assert from_centre[on_hole] == pytest.approx(10.0, abs=1e-8)


@pytest.mark.parametrize("angle", [0.0, 0.0087266, 0.4, 1.0, 2.5])
def test_small_holes_and_slits_beside_a_coarse_circle_give_sound_triangles(
    tmp_path: Path, angle: float
) -> None:
    towards = np.array([np.cos(angle), np.sin(angle)])
    away = np.array([np.cos(angle + 1.0), np.sin(angle + 1.0)])
    small_hole = f"{{ disc = {{ centre = {(np.array([36.5, 51]) + 11 * away).tolist()}, radius = 0.5 }} }}"
    start, end = ((np.array([36.5, 51]) + radius * towards).tolist() for radius in (10, 14))
    shape = PLATE_WITH_HOLE.replace("[{", f"[{small_hole}, {{")
    mesh = build_mesh(write_case(tmp_path, shape, "h = 5", notch("slit", start, end)))
    assert smallest_angle(mesh) > 20.0
    edges = edge_table(mesh.arrays.cells)
    points = mesh.arrays.points[np.unique(edges.ends[edges.count == 1])]
    from_centre = np.linalg.norm(points - [36.5, 51], axis=1)
    assert from_centre[from_centre < 10.2] == pytest.approx(10.0, abs=1e-8)
    opened = np.linalg.norm(doubled_points(mesh) - [36.5, 51], axis=1)
    assert opened.min() == pytest.approx(10.0, abs=1e-8)


@pytest.mark.parametrize("gap", [0.3, 1.0])
def test_sizes_grow_evenly_from_a_small_hole(tmp_path: Path, gap: float) -> None:
    small_hole = f"{{ disc = {{ centre = [{46.7 + gap}, 51.0], radius = 0.2 }} }}"
    mesh = build_mesh(write_case(tmp_path, PLATE_WITH_HOLE.replace("[{", f"[{small_hole}, {{"), "h = 5"))
    assert smallest_angle(mesh) > 20.0


def test_a_body_thinner_than_the_grid_resolves_is_refused(tmp_path: Path) -> None:
    film = "{ rectangle = { lower = [1, 0], upper = [1.00005, 1] } }"
    bodies = f"""
    bodies.plate = {{ material = "steel", shape = {UNIT_SQUARE} }}
    bodies.film = {{ material = "steel", shape = {film} }}"""
    with pytest.raises(MeshError, match=r"bodies\.film: its sides fit no grid lines"):
        build_mesh(write_case(tmp_path, bodies, "h = 0.1"))


@BOTH_ELEMENTS
def test_bodies_apart_are_separate_components(tmp_path: Path, element: str) -> None:
    bodies = """
    bodies.left = { material = "steel", shape = { rectangle = { lower = [0, 0], upper = [1, 1] } } }
    bodies.right = { material = "steel", shape = { rectangle = { lower = [1.2, 0], upper = [2, 0.5] } } }"""
    mesh = build_mesh(write_case(tmp_path, bodies, f'h = 0.1, element = "{element}"'))
    areas = np.bincount(mesh.body, signed_areas(mesh.arrays.points, mesh.arrays.cells))
    assert areas == pytest.approx([1.0, 0.4], abs=1e-9)
    component = components(mesh.arrays.cells)
    assert component.max() == 1
    assert set(zip(mesh.body.tolist(), component.tolist(), strict=True)) == {(0, 0), (1, 1)}


def test_an_inclusion_shares_the_nodes_of_its_matrix(tmp_path: Path) -> None:
    disc = "{ disc = { centre = [0.5, 0.5], radius = 0.2 } }"
    around = f"{{ difference = {{ of = {UNIT_SQUARE}, minus = [{disc}] }} }}"
    bodies = f"""
    bodies.fibre = {{ material = "steel", shape = {disc} }}
    bodies.matrix = {{ material = "steel", shape = {around} }}"""
    mesh = build_mesh(write_case(tmp_path, bodies, "h = 0.1"))
    assert area(mesh) == pytest.approx(1.0, abs=1e-9)
    assert len(doubled_points(mesh)) == 0
    assert components(mesh.arrays.cells).max() == 0
    centres = np.linalg.norm(mesh.arrays.centres() - 0.5, axis=1)
    assert np.array_equal(mesh.body == 0, centres < 0.2)


@BOTH_ELEMENTS
def test_the_same_case_gives_the_same_mesh(tmp_path: Path, element: str) -> None:
    case = write_case(
        tmp_path,
        UNIT_SQUARE,
        f'h = 0.05, {FINE_BOX}, element = "{element}"',
        notch("slit", (0, 0.5), (0.5, 0.5)),
    )
    one, other = build_mesh(case), build_mesh(case)
    assert np.array_equal(one.mesh.p, other.mesh.p)
    assert np.array_equal(one.mesh.t, other.mesh.t)


# ------------------------------------------------------------------- slits


@BOTH_ELEMENTS
def test_a_slit_from_the_boundary_opens_there_and_keeps_its_tip(tmp_path: Path, element: str) -> None:
    slit = notch("slit", (0, 0.5), (0.5, 0.5))
    mesh = build_mesh(write_case(tmp_path, UNIT_SQUARE, f'h = 0.1, element = "{element}"', slit))
    doubled = doubled_points(mesh)
    assert doubled[:, 0] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4], abs=1e-9)
    assert doubled[:, 1] == pytest.approx(0.5, abs=1e-9)
    assert area(mesh) == pytest.approx(1.0, abs=1e-12)
    assert_counter_clockwise(mesh)


@BOTH_ELEMENTS
def test_the_faces_of_a_slit_are_not_connected_and_no_element_crosses_it(
    tmp_path: Path, element: str
) -> None:
    slit = notch("slit", (0, 0.5), (0.5, 0.5))
    mesh = build_mesh(write_case(tmp_path, UNIT_SQUARE, f'h = 0.05, {FINE_BOX}, element = "{element}"', slit))
    assert not cells_cut_by(mesh.arrays, Segment(start=(0, 0.5), end=(0.5, 0.5)), 1e-9).any()
    behind_tip = mesh.arrays.points[mesh.arrays.cells, 0].max(axis=1) < 0.5
    above = mesh.arrays.centres()[behind_tip, 1] > 0.5
    component = components(mesh.arrays.cells[behind_tip])
    assert component.max() == 1
    assert np.array_equal(component == component[np.argmax(above)], above)
    assert components(mesh.arrays.cells).max() == 0


@BOTH_ELEMENTS
def test_a_slit_inside_keeps_both_tips(tmp_path: Path, element: str) -> None:
    slit = notch("slit", (0.5, 0.2), (0.5, 0.6))
    mesh = build_mesh(write_case(tmp_path, UNIT_SQUARE, f'h = 0.1, element = "{element}"', slit))
    assert doubled_points(mesh)[:, 1] == pytest.approx([0.3, 0.4, 0.5], abs=1e-9)


@BOTH_ELEMENTS
def test_a_slit_from_side_to_side_cuts_the_body_in_two(tmp_path: Path, element: str) -> None:
    slit = notch("slit", (0, 0.5), (1, 0.5))
    mesh = build_mesh(write_case(tmp_path, UNIT_SQUARE, f'h = 0.1, element = "{element}"', slit))
    assert components(mesh.arrays.cells).max() == 1


@BOTH_ELEMENTS
def test_crossing_slits_open_into_four_corners(tmp_path: Path, element: str) -> None:
    slits = f"{notch('slit', (0.2, 0.5), (0.8, 0.5))}, {notch('slit', (0.5, 0.2), (0.5, 0.8))}"
    mesh = build_mesh(write_case(tmp_path, UNIT_SQUARE, f'h = 0.1, element = "{element}"', slits))
    at_crossing = np.linalg.norm(mesh.arrays.points - 0.5, axis=1) < 1e-9
    assert at_crossing.sum() == 4


def test_an_inclined_slit_in_triangles(tmp_path: Path) -> None:
    slit = notch("slit", (0.3, 0.3), (0.6, 0.7))
    mesh = build_mesh(write_case(tmp_path, UNIT_SQUARE, 'h = 0.05, element = "triangle"', slit))
    doubled = doubled_points(mesh)
    assert len(doubled) == 9
    assert (doubled - [0.3, 0.3]) @ [0.8, -0.6] == pytest.approx(0.0, abs=1e-9)
    assert not cells_cut_by(mesh.arrays, Segment(start=(0.3, 0.3), end=(0.6, 0.7)), 1e-6).any()


def test_a_slit_that_nearly_reaches_the_boundary_opens_it(tmp_path: Path) -> None:
    shape = "{ polygon = { points = [[0, 0], [1, 0], [1.3333333, 1], [0, 1]] } }"
    slit = notch("slit", (1.16666, 0.5), (0.6, 0.5))
    mesh = build_mesh(write_case(tmp_path, shape, "h = 0.1", slit))
    assert doubled_points(mesh)[:, 0].max() == pytest.approx(1.16666, abs=1e-4)
    assert smallest_angle(mesh) > 20.0


def test_a_slit_off_the_grid_lines_says_what_to_do(tmp_path: Path) -> None:
    case = write_case(tmp_path, UNIT_SQUARE, "h = 0.1", notch("slit", (0.3, 0.3), (0.6, 0.7)))
    with pytest.raises(MeshError, match=r'case\.toml: notches\[0\]: .*set mesh\.element = "triangle"$'):
        build_mesh(case)


def test_a_slit_that_ends_within_an_edge_is_refused() -> None:
    grid = rectilinear(np.linspace(0, 1, 11), np.linspace(0, 1, 11))
    with pytest.raises(MeshError, match="does not lie along edges"):
        split_slits(grid, {"slit": Segment(start=(0.0, 0.5), end=(0.45, 0.5))})
    assert len(split_slits(grid, {"slit": Segment(start=(0.0, 0.5), end=(0.4, 0.5))}).points) == len(grid.points) + 4


def test_a_slit_on_the_boundary_opens_nothing_and_is_refused() -> None:
    grid = rectilinear(np.linspace(0, 1, 11), np.linspace(0, 1, 11))
    with pytest.raises(MeshError, match="does not lie along edges"):
        split_slits(grid, {"slit": Segment(start=(0.0, 0.0), end=(0.5, 0.0))})


def test_a_slit_that_follows_edges_for_a_part_only_is_refused() -> None:
    points = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [2, 1], [2, 2], [1, 2]], dtype=float)
    cells = np.array([[0, 1, 2], [0, 2, 3], [2, 4, 6], [4, 5, 6]])
    mesh = MeshArrays(points, cells, np.zeros(4, dtype=np.int64))
    assert len(split_slits(mesh, {"slit": Segment(start=(0.0, 0.0), end=(1.0, 1.0))}).points) == len(points) + 3
    with pytest.raises(MeshError, match="does not lie along edges"):
        split_slits(mesh, {"slit": Segment(start=(0.0, 0.0), end=(2.0, 2.0))})


def test_cells_cut_by_finds_the_elements_that_a_line_crosses() -> None:
    grid = rectilinear(np.linspace(0, 1, 11), np.linspace(0, 1, 11))
    assert cells_cut_by(grid, Segment(start=(0.0, 0.55), end=(0.45, 0.55)), 1e-6).sum() == 5
    assert cells_cut_by(grid, Segment(start=(0.0, 0.0), end=(1.0, 1.0)), 1e-6).sum() == 10


# ------------------------------------------------------- notches with width


@BOTH_ELEMENTS
def test_cells_are_left_out(tmp_path: Path, element: str) -> None:
    cells = notch("cells", (0, 0.5), (0.5, 0.5), width=0.1)
    mesh = build_mesh(write_case(tmp_path, UNIT_SQUARE, f'h = 0.05, element = "{element}"', cells))
    assert area(mesh) == pytest.approx(1.0 - 0.5 * 0.1, abs=1e-9)
    centres = mesh.arrays.centres()
    assert not ((centres[:, 0] < 0.5) & (np.abs(centres[:, 1] - 0.5) < 0.05)).any()
    assert len(np.unique(mesh.arrays.cells)) == len(mesh.arrays.points)


def test_a_notch_holds_the_rectangle_about_its_segment_with_its_sides() -> None:
    notch = CellsNotch(kind="cells", start=(1.0, 0.0), end=(1.0, 2.0), width=0.5)
    held = [(1.0, 1.0), (1.0, 0.0), (1.25, 2.0), (0.75, 1.0)]
    free = [(1.26, 1.0), (0.74, 1.0), (1.0, 2.01), (1.0, -0.01)]
    assert notch.contains(np.array(held)).all() and not notch.contains(np.array(free)).any()


def test_points_elements_and_plan_leave_out_the_same(tmp_path: Path) -> None:
    case = write_case(tmp_path, UNIT_SQUARE, "h = 0.1", notch("cells", (0.0, 0.1), (0.45, 0.52), 0.25))
    elements = build_mesh(case).arrays.centres()
    assert describe(case, "fem").cells == describe(case, "mpm").cells == len(elements) < count_cells(case)
    case = case.model_copy(update={"mpm": case.mpm.model_copy(update={"points_per_cell": 1})})
    points = place_points(case).positions
    assert np.sort(points @ [1.0, 100.0]) == pytest.approx(np.sort(elements @ [1.0, 100.0]))


def test_an_inclined_notch_leaves_out_the_cells_with_centres_in_it(tmp_path: Path) -> None:
    cells = notch("cells", (0.2, 0.2), (0.5, 0.6), width=0.1)
    case = write_case(tmp_path, UNIT_SQUARE, "h = 0.02", cells)
    centres = build_mesh(case).arrays.centres()
    along, aside = (centres - 0.2) @ [0.6, 0.8], (centres - 0.2) @ [-0.8, 0.6]
    assert not ((along > 0) & (along < 0.5) & (np.abs(aside) < 0.05)).any()
    assert len(centres) / 50**2 == pytest.approx(1.0 - 0.5 * 0.1, rel=0.01)


def test_an_inclined_notch_is_cut_out_of_triangles_and_leaves_no_sliver_at_its_mouth(tmp_path: Path) -> None:
    cells = notch("cells", (0.0, 0.5), (0.4, 0.8), width=0.04)
    mesh = build_mesh(write_case(tmp_path, UNIT_SQUARE, 'h = 0.05, element = "triangle"', cells))
    # The rectangle, and the two halves of its mouth between the square cut and the side of the body.
    assert area(mesh) == pytest.approx(1.0 - 0.5 * 0.04, abs=1e-6)
    assert components(mesh.arrays.cells).max() == 0
    assert smallest_angle(mesh) > 20.0


def test_history_notches_leave_the_mesh_alone(tmp_path: Path) -> None:
    plain = build_mesh(write_case(tmp_path, UNIT_SQUARE, "h = 0.1"))
    notched = build_mesh(write_case(tmp_path, UNIT_SQUARE, "h = 0.1", notch("history", (0, 0.5), (0.5, 0.5))))
    assert np.array_equal(plain.mesh.p, notched.mesh.p)
    assert np.array_equal(plain.mesh.t, notched.mesh.t)


def test_a_body_eaten_by_notches_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match=r"bodies\.plate.*narrower"):
        write_case(tmp_path, UNIT_SQUARE, "h = 0.1", notch("cells", (0, 0.5), (1, 0.5), width=2.0))


@pytest.mark.parametrize(
    ("shape", "problem"),
    [
        ("{ difference = { of = SQUARE, minus = [{ disc = { centre = [0.5, 0.5], radius = 1e-9 } }] } }", "6.9e-11 long"),
        ("[0.5, 2], [0.49999, 1]", None),
        ("[0.5, 1], [0.5, 2], [0.49999, 1]", "0.00057 degrees"),
        ("[0.5, 1], [0.5, 0.5], [0.49999, 1]", "0.0011 degrees"),
    ],
)  # fmt: skip
def test_what_netgen_would_not_come_to_an_end_with_is_refused(shape: str, problem: str | None, tmp_path: Path) -> None:
    if shape.startswith("["):
        shape = f"{{ polygon = {{ points = [[0, 0], [1, 0], [1, 1], {shape}, [0, 1]] }} }}"
    case = write_case(tmp_path, shape.replace("SQUARE", UNIT_SQUARE), 'h = 0.1, element = "triangle"')
    if problem is None:
        assert build_mesh(case).mesh.nelements > 100
        return
    with pytest.raises(MeshError, match=f"bodies: .*{problem}.* too (short|sharp)"):
        build_mesh(case)


# ------------------------------------------------------------------- sizes


def test_quads_grow_by_no_more_than_the_stated_factor(tmp_path: Path) -> None:
    mesh = build_mesh(write_case(tmp_path, UNIT_SQUARE, f"h = 0.02, {FINE_BOX}"))
    for lines in (np.unique(mesh.mesh.p[0]), np.unique(mesh.mesh.p[1])):
        spacing = np.diff(lines)
        ratio = spacing[1:] / spacing[:-1]
        # Spacings between two fixed lines shrink to fit a whole number of them, hence the tenth.
        assert np.maximum(ratio, 1 / ratio).max() <= 1.3 * 1.1
        assert spacing.max() <= 0.1 * 1.001
    in_box = (mesh.arrays.centres() > [0.45, 0.0]).all(axis=1) & (mesh.arrays.centres() < [1.0, 0.55]).all(
        axis=1
    )
    assert edge_lengths(mesh.arrays.points, mesh.arrays.cells)[in_box].max() <= 0.02 * 1.001


def test_triangles_have_the_sizes_asked_for(tmp_path: Path) -> None:
    slit = notch("slit", (0, 0.5), (0.5, 0.5))
    mesh = build_mesh(write_case(tmp_path, UNIT_SQUARE, f'h = 0.02, {FINE_BOX}, element = "triangle"', slit))
    size = SizeField(0.02, 0.1, 1.3, SizedBox(np.array([0.45, 0.0]), np.array([1.0, 0.55]), 0.02))
    relative = edge_lengths(mesh.arrays.points, mesh.arrays.cells) / size(mesh.arrays.centres())[:, None]
    in_box = size(mesh.arrays.centres()) == 0.02
    assert np.median(relative[in_box]) == pytest.approx(1.0, abs=0.1)
    assert np.median(relative[~in_box]) == pytest.approx(1.0, abs=0.25)
    assert relative.max() < 2.0
    # Equilateral triangles of the wanted size, as many as fit.
    place = (np.arange(400) + 0.5) / 400
    x, y = np.meshgrid(place, place)
    ideal = (4 / np.sqrt(3) / size(np.column_stack([x.ravel(), y.ravel()])) ** 2).mean()
    assert len(mesh.body) == pytest.approx(ideal, rel=0.25)
    assert smallest_angle(mesh) > 20.0


def test_refined_boxes_have_triangles_of_their_own_size(tmp_path: Path) -> None:
    def sizes(more: str) -> tuple[np.ndarray, np.ndarray]:
        """Longest edges about the held corner, and near the opposite one."""
        mesh = build_mesh(write_case(tmp_path, UNIT_SQUARE, f'h = 0.01, {FINE_BOX}, element = "triangle"{more}'))
        centres, edges = mesh.arrays.centres(), edge_lengths(mesh.arrays.points, mesh.arrays.cells).max(axis=1)
        return edges[np.linalg.norm(centres, axis=1) < 0.1], edges[np.linalg.norm(centres - [0, 1], axis=1) < 0.1]

    without, corner_without = sizes("")
    refined, corner = sizes(", refine = [{ lower = [0, 0], upper = [0.1, 0], h = 0.02 }]")
    assert np.median(refined) < 0.035 < 0.08 < np.median(without)
    assert np.median(corner) == pytest.approx(np.median(corner_without), rel=0.2)


def test_points_of_support_and_ends_of_loaded_patches_are_nodes(tmp_path: Path) -> None:
    sets = f"""bodies.plate = {{ material = "steel", shape = {UNIT_SQUARE} }}
    boundaries.support = {{ point = [0.3137, 0] }}
    boundaries.patch = {{ box = {{ lower = [0.411, 1], upper = [0.533, 1] }} }}"""
    mesh = build_mesh(write_case(tmp_path, sets, 'h = 0.1, element = "triangle"'))
    for point in ([0.3137, 0.0], [0.411, 1.0], [0.533, 1.0]):
        assert np.linalg.norm(mesh.arrays.points - point, axis=1).min() < 1e-9


# ------------------------------------------------------------ mesh from file

SQUARE_POINTS = np.array(
    [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0], [9, 9, 9]], dtype=float
)
TWO_QUADS = [[0, 1, 4, 3], [1, 2, 5, 4]]
FOUR_TRIANGLES = [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]]


def case_of_file(
    folder: Path, name: str, cells: list, points: np.ndarray = SQUARE_POINTS, notches: str = ""
) -> Case:
    """A case whose body is a mesh file with these meshio cells."""
    meshio.write(folder / name, meshio.Mesh(points, cells))
    return write_case(folder, f'bodies.plate = {{ material = "steel", mesh = "{name}" }}', "h = 1.0", notches)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["plate.msh", "plate.inp", "plate.vtu"])
@pytest.mark.parametrize(("kind", "cells"), [("quad", TWO_QUADS), ("triangle", FOUR_TRIANGLES)])
def test_the_users_mesh_comes_back(tmp_path: Path, name: str, kind: str, cells: list) -> None:
    mesh = build_mesh(case_of_file(tmp_path, name, [(kind, cells)]))
    assert np.array_equal(mesh.arrays.points, SQUARE_POINTS[:6, :2])
    assert np.array_equal(mesh.arrays.cells, cells)
    assert np.array_equal(mesh.body, np.zeros(len(cells)))
    assert_counter_clockwise(mesh)


def test_a_netgen_mesh_survives_a_round_trip_and_is_slit_again(tmp_path: Path) -> None:
    slit = notch("slit", (0, 0.5), (0.5, 0.5))
    made = build_mesh(write_case(tmp_path, UNIT_SQUARE, 'h = 0.1, element = "triangle"', slit))
    points, cells = np.unique(made.arrays.points, axis=0, return_inverse=True)
    closed = np.column_stack([points, np.zeros(len(points))])
    turned = cells.reshape(-1)[made.arrays.cells][:, ::-1]
    mesh = build_mesh(case_of_file(tmp_path, "plate.vtu", [("triangle", turned)], closed, slit))
    assert np.array_equal(doubled_points(mesh), doubled_points(made))
    assert area(mesh) == pytest.approx(1.0, abs=1e-12)
    assert_counter_clockwise(mesh)


def test_lines_and_vertices_in_the_file_are_passed_over(tmp_path: Path) -> None:
    cells = [("vertex", [[0]]), ("line", [[0, 1]]), ("quad", TWO_QUADS[:1]), ("quad", TWO_QUADS[1:])]
    mesh = build_mesh(case_of_file(tmp_path, "plate.vtu", cells))
    assert area(mesh) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ([("line", [[0, 1], [1, 2]])], "holds no triangles or quadrilaterals; save"),
        ([("triangle", FOUR_TRIANGLES[:2]), ("quad", TWO_QUADS[1:])], "are mixed; recombine"),
        ([("quad", [[0, 1, 3, 4]])], "1 elements are inverted or collapsed, .*; repair"),
        ([("triangle", [[0, 1, 2], [0, 1, 4]])], "inverted or collapsed"),
        ([("tetra", [[0, 1, 3, 4]])], "elements of type tetra are not supported; export"),
        ([("triangle6", [[0, 2, 5, 1, 4, 3]])], "1 second-order elements have curved edges, .*; mesh"),
        ([("triangle", [[0, 1, 4], [0, 1, 3], [0, 1, 5]])], "on the same side of an edge .*; remove"),
    ],
)
def test_unfit_mesh_files_are_refused_in_one_sentence(tmp_path: Path, cells: list, message: str) -> None:
    with pytest.raises(CaseError, match=rf"plate\.vtu: .*{message}") as raised:
        case_of_file(tmp_path, "plate.vtu", cells)
    assert "\n" not in str(raised.value)


def test_a_mesh_out_of_the_plane_is_refused(tmp_path: Path) -> None:
    tilted = SQUARE_POINTS + [[0, 0, 0.1]] * SQUARE_POINTS[:, :1]
    with pytest.raises(MeshError, match="leaves the x-y plane"):
        build_mesh(case_of_file(tmp_path, "plate.vtu", [("quad", TWO_QUADS)], tilted))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("plate.msh", "cannot be read .*; export"),
        ("plate.vtu", "cannot be read .*; export"),
        ("plate.inp", "holds no triangles or quadrilaterals; save"),
    ],
)
def test_an_unreadable_file_is_refused(
    tmp_path: Path, name: str, message: str, capfd: pytest.CaptureFixture
) -> None:
    (tmp_path / name).write_text("this is no mesh\n")
    with pytest.raises(MeshError, match=f"{name}: .*{message}"):
        write_case(tmp_path, f'bodies.plate = {{ material = "steel", mesh = "{name}" }}', "h = 1.0")
    assert capfd.readouterr() == ("", "")


def test_a_slit_across_the_users_elements_is_refused(tmp_path: Path) -> None:
    slit = notch("slit", (0.0, 0.5), (1.0, 0.5))
    case = case_of_file(tmp_path, "plate.vtu", [("quad", TWO_QUADS)], notches=slit)
    with pytest.raises(MeshError, match=r"notches\[0\]: .*edges in the mesh file$"):
        build_mesh(case)


def test_one_kind_of_element_only(tmp_path: Path) -> None:
    meshio.write(tmp_path / "a.vtu", meshio.Mesh(SQUARE_POINTS[:6], [("triangle", FOUR_TRIANGLES)]))
    bodies = """
    bodies.given = { material = "steel", mesh = "a.vtu" }
    bodies.drawn = { material = "steel", shape = { rectangle = { lower = [3, 0], upper = [4, 1] } } }"""
    with pytest.raises(MeshError, match=r"mix triangles and quadrilaterals"):
        build_mesh(write_case(tmp_path, bodies, "h = 0.5"))
    mesh = build_mesh(write_case(tmp_path, bodies, 'h = 0.5, element = "triangle"'))
    assert np.bincount(mesh.body, signed_areas(mesh.arrays.points, mesh.arrays.cells)) == pytest.approx(
        [2, 1]
    )


def test_scaled_jacobian_tells_the_shape_of_elements():
    quads = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [1.5, 1]], float)
    square, sheared, inverted = [0, 1, 2, 3], [1, 4, 5, 2], [3, 2, 1, 0]
    assert scaled_jacobian(quads, np.array([square]))[0] == pytest.approx(1.0)
    assert 0.5 < scaled_jacobian(quads, np.array([sheared]))[0] < 1.0
    assert scaled_jacobian(quads, np.array([inverted]))[0] == pytest.approx(-1.0)
    triangle = np.array([[0, 0], [1, 0], [0.5, np.sqrt(0.75)]])
    assert scaled_jacobian(triangle, np.array([[0, 1, 2]]))[0] == pytest.approx(1.0)
