"""Material points on the Gauss points of mesh files: where they are, what they weigh, and a uniform stress."""

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from cases import Case, CaseError, case_from_tables
from mpm.placement import place_points, placement_health
from numerics.description import describe
from verify.health import INDICATORS
from verify.runs.running import DISCRETISATIONS, solver_records

CELLS = 4
TABLES: dict[str, Any] = {
    "title": "Plate pulled",
    "requirement": "A uniform stress is met on the points of a mesh.",
    "units": {"length": "mm", "force": "kN"},
    "plane": {"assumption": "stress", "thickness": 2.0},
    "materials": {"steel": {"young": 210.0, "poisson": 0.3, "density": "7850 kg/m^3"}},
    "constraints": [
        {"on": "bottom", "direction": "y", "value": 0},
        {"on": "left", "direction": "x", "value": 0},
        {"on": "top", "direction": "y", "scale": 1},
    ],
    "load": {"path": [0.0, 0.001], "increment": 1e-3},
    "mesh": {"h": 1.0 / CELLS},
    "runs": {"mpm": {"solver": "mpm"}},
}


def written(folder: Path, kind: str, distorted: bool = False) -> Path:
    """The square from 0 to 1 as a mesh file of quadrilaterals or triangles, its inner nodes moved if distorted."""
    x = np.linspace(0.0, 1.0, CELLS + 1)
    points = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    inner = ((points > 0) & (points < 1)).all(axis=1)
    points[inner] += distorted * 0.06 * np.sin(9.0 * points[inner, ::-1])
    first = (np.arange(CELLS)[:, None] * (CELLS + 1) + np.arange(CELLS)).reshape(-1, 1)
    cells = first + np.array([0, CELLS + 1, CELLS + 2, 1])
    if kind == "triangle":
        cells = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    meshio.Mesh(np.column_stack([points, 0 * points[:, 0]]), [(kind, cells)]).write(folder / "plate.vtu")
    return folder / "plate.vtu"


def plate(folder: Path, placement: str = "mesh", **changes: Any) -> Case:
    body = changes.pop("body", {"mesh": "plate.vtu"})
    tables = {**TABLES, "bodies": {"plate": {"material": "steel", **body}}, **changes}
    tables["mpm"] = {"placement": placement, **changes.get("mpm", {})}
    if "dynamics" in tables:
        tables = {key: value for key, value in tables.items() if key not in ("load", "constraints")}
    return case_from_tables(tables, run="mpm", source=folder / "case.toml")


@pytest.mark.parametrize("per_direction", [1, 2, 3])
def test_on_a_rectangular_mesh_they_are_the_gauss_points_of_the_grid(per_direction: int, tmp_path: Path) -> None:
    written(tmp_path, "quad")
    found, known = (
        place_points(plate(tmp_path, name, mpm={"points_per_cell": per_direction})) for name in ("mesh", "gauss")
    )
    order, other = (np.lexsort(np.round(cloud.positions, 9).T) for cloud in (found, known))
    for name in ("positions", "volume", "size", "corner", "body"):
        assert getattr(found, name)[order] == pytest.approx(getattr(known, name)[other]), name


@pytest.mark.parametrize(("kind", "points"), [("quad", 4 * CELLS**2), ("triangle", 6 * CELLS**2)])
def test_on_a_distorted_mesh_they_have_the_moments_of_the_body(kind: str, points: int, tmp_path: Path) -> None:
    written(tmp_path, kind, distorted=True)
    case = plate(tmp_path)
    cloud = place_points(case)
    weights = cloud.volume / case.plane.thickness
    assert len(weights) == points == describe(case, "mpm").points
    assert (weights > 0).all() and weights.sum() == pytest.approx(1.0)
    assert weights @ cloud.positions == pytest.approx([0.5, 0.5])
    assert np.einsum("p,pi,pj->ij", weights, *2 * [cloud.positions]) == pytest.approx(np.array([[4, 3], [3, 4]]) / 12)


@pytest.mark.parametrize("kind", ["quad", "triangle"])
@pytest.mark.parametrize("distorted", [False, True])
def test_points_of_a_distorted_mesh_are_told_by_the_health_record(kind: str, distorted: bool, tmp_path: Path) -> None:
    """Uniform stress is several per cent off on them."""
    written(tmp_path, kind, distorted)
    case = plate(tmp_path)
    scatter = placement_health(case, place_points(case))["scatter"]
    assert (scatter > INDICATORS["scatter"].limit) == distorted


def test_a_uniform_stress_is_exact_on_a_rectangular_mesh(tmp_path: Path) -> None:
    written(tmp_path, "quad")
    pulled = {}
    for placement in ("mesh", "gauss"):
        grid = {"fill_cells": False, "move_points": False, "constraints_on": "nodes", "order": 1}
        case = plate(tmp_path, placement, mpm=grid)
        solver = DISCRETISATIONS["mpm"](case)
        *_, last = solver_records(solver, case)
        stress = solver.fields().stress
        assert stress == pytest.approx(np.tile([0.0, 0.21, 0.0], (len(stress), 1)), abs=1e-9)
        pulled[placement] = last.F
    assert pulled["mesh"] == pytest.approx(2.0 * 0.21, rel=1e-8)
    assert pulled["mesh"] == pytest.approx(pulled["gauss"], rel=1e-10)


SQUARE = {"shape": {"rectangle": {"lower": [0, 0], "upper": [1, 1]}}}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"body": SQUARE}, "'mpm.placement' = 'mesh' needs a mesh file, which bodies.plate has not; give \"gauss\""),
        ({"mpm": {"fill_cells": True}}, "'mpm.fill_cells' = true has no effect on the points of a mesh"),
        ({"dynamics": {"end_time": 1.0, "time_step": 0.1}}, "applies in quasi-static cases only"),
        ({"mpm": {"points_per_cell": 3}}, "the triangles of bodies.plate hold 1 point or 3; give 1 or 2"),
    ],
)
def test_what_cannot_be_is_one_sentence(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    written(tmp_path, "triangle")
    with pytest.raises(CaseError) as error:
        place_points(plate(tmp_path, **changes))
    assert said in str(error.value) and "\n" not in str(error.value)
