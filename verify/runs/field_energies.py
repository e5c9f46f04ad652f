"""Energies of fields that come without any: integrals over their triangles, by the laws of the case."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray

from cases import Case
from cases.mapping import parse_mapping
from cases.mesh_arrays import signed_areas
from cases.notches import CellsNotch
from numerics.fields import Fields
from verify.extras import missing_extra

if TYPE_CHECKING:
    from physics.elasticity import MaterialTable

#: part of the area that may lie in no body, where two meshes draw a round outline differently
_OUTSIDE = 0.02
#: part of the bodies' area by which the cells' may differ, for the same reason and cells of notches left out
_UNCOVERED = 0.05


@dataclass(frozen=True)
class Energies:
    """Elastic and fracture energy of a state [energy], NaN where a sentence of ``missing`` says what is not there."""

    elastic: float
    fracture: float
    missing: tuple[str, ...] = ()


def complete(table: pd.DataFrame, states: Mapping[int, Fields], case: Case) -> list[str]:
    """Give the rows of a history what their states tell, where no row has it; return why something is not told.

    states : row -> fields
    """
    empty = {name for name in ("c_min", "E_el", "E_frac") if table[name].isna().all()}
    missing: dict[str, None] = {}
    for row, state in states.items():
        found = {"c_min": state.grid_phase_field.min()}
        if empty & {"E_el", "E_frac"} and state.grid_cells.shape == (len(state.volume), 3):
            energies = energies_of(state, case)
            found |= {"E_el": energies.elastic, "E_frac": energies.fracture}
            missing |= dict.fromkeys(energies.missing)
        for name in empty & found.keys():
            table.loc[row, name] = found[name]
    return list(missing)


def energies_of(fields: Fields, case: Case) -> Energies:
    """The energies of linear phase field and displacement on triangles, as `verify.runs.foreign_fields` makes them.

    The elastic one is that of the case's law (its split, degraded by c) for the strain, or half the complementary
    stress · strain where there is a stress alone and the law is the same in tension and compression.
    """
    try:
        return _integrated(fields, case)
    except ModuleNotFoundError as error:
        said = missing_extra(error)
        if said is None:
            raise
        return Energies(np.nan, np.nan, (f"No energies are integrated from the fields: {said}",))


def _integrated(fields: Fields, case: Case) -> Energies:
    from physics.elasticity import MaterialTable

    body = _bodies(fields, case)
    if (outside := fields.volume[body < 0].sum() / fields.volume.sum()) > _OUTSIDE:
        said_of = f"{100 * outside:.2g} % of their area lies in no body of the case"
        return Energies(np.nan, np.nan, (f"No energies are integrated from the fields: {said_of}.",))
    covered, parts = float(fields.volume.sum()) / (_area(case) * case.plane.thickness), 1.0
    if _is_half(case) and abs(2.0 * covered - 1.0) <= _UNCOVERED:
        parts = 2.0
    elif abs(covered - 1.0) > _UNCOVERED:
        said_of = f"their cells cover {100 * covered:.3g} % of the bodies"
        remedy = "give all of them, or the word 'half model' in the map of one half"
        return Energies(np.nan, np.nan, (f"No energies are integrated from the fields: {said_of}; {remedy}.",))
    table = MaterialTable(case)
    elastic, no_elastic = _elastic(fields, case, body, table)
    fracture, no_fracture = _fracture(fields, body, table)
    told = (("elastic", no_elastic), ("fracture", no_fracture))
    missing = tuple(f"No {kind} energy is integrated from the fields: {why}." for kind, why in told if why)
    return Energies(parts * elastic, parts * fracture, missing)


def _area(case: Case) -> float:
    """Of the bodies without the cells that notches leave out [length²]."""
    bodies = shapely.union_all([body.outline() for body in case.bodies.values()])
    cut = [shapely.LineString([n.start, n.end]).buffer(n.width / 2, cap_style="flat")
           for n in case.notches if isinstance(n, CellsNotch)]  # fmt: skip
    return float((bodies - shapely.union_all(cut)).area)


def _is_half(case: Case) -> bool:
    """The result is said to be that of one half."""
    foreign = case.run_spec(case.run).foreign if case.run else None
    return foreign is not None and "half model" in parse_mapping(foreign.map).words


def _bodies(fields: Fields, case: Case) -> NDArray:
    """Number of the body (n,) at the centre of each triangle, -1 in none."""
    if len(case.bodies) == 1:
        return np.zeros(len(fields.volume), dtype=np.int64)
    return case.inside(fields.reference)


def _fracture(fields: Fields, body: NDArray, table: MaterialTable) -> tuple[float, str]:
    """Gc times the crack density over the triangles, exact for linear c, and why there is none."""
    from physics.phase_field import PhaseFieldCoefficients

    inside = body >= 0
    if table.fourth_order[body[inside]].any():
        return np.nan, "its density of order 4 needs second derivatives of c, which cells with straight edges do not have"
    coefficients = PhaseFieldCoefficients(table, body[inside])
    corners, cells = fields.grid_phase_field, fields.grid_cells[inside]
    slope = _slope(fields.grid_points, cells, corners)
    squared, nothing = (slope**2).sum(axis=1), np.zeros(len(cells))
    density = np.zeros(len(cells))
    for value in _on_edges(corners, cells):
        density += coefficients.energy_density(value, squared, nothing) / 3.0
    density[~table.breakable[body[inside]]] = 0.0
    return float(density @ fields.volume[inside]), ""


def _on_edges(values: NDArray, cells: NDArray) -> NDArray:
    """Nodal values in the middle of the edges (3, n) of triangles, by which squares are integrated exactly."""
    return np.stack([values[cells[:, edge]].mean(axis=1) for edge in ((0, 1), (1, 2), (2, 0))])


def _slope(points: NDArray, cells: NDArray, values: NDArray) -> NDArray:
    """Gradient (n, 2) of nodal values on triangles; zero on those without area."""
    x, y = (points[cells, axis] for axis in (0, 1))
    twice = 2.0 * signed_areas(points, cells)
    opposite = np.stack([np.roll(y, -1, axis=1) - np.roll(y, 1, axis=1), np.roll(x, 1, axis=1) - np.roll(x, -1, axis=1)])
    return np.divide((opposite * values[cells]).sum(axis=2), twice, where=twice != 0, out=np.zeros((2, len(cells)))).T


def _elastic(fields: Fields, case: Case, body: NDArray, table: MaterialTable) -> tuple[float, str]:
    """Elastic energy and why there is none."""
    if case.dynamics or case.eigenstrains:
        return np.nan, "bodies that move or have eigenstrains hold more than the displacement tells"
    strained, stressed = (np.isfinite(values[body >= 0]).all() for values in (fields.gradient, fields.stress))
    if not strained and not stressed:
        return np.nan, "they hold neither displacement nor stress; save one and name it with displacement = NAME"
    density = np.zeros(len(body))
    for number, material in enumerate(case.materials[each.material] for each in case.bodies.values()):
        mine, split = body == number, material.fracture.split if material.fracture else "none"
        if not strained and split != "none":
            return np.nan, f"they hold no displacement, and by the split {split} their stress does not tell the strain"
        g = _degradation(fields, mine, table, number)
        strain = _strain(fields.gradient[mine]) if strained else None
        density[mine] = _density(table, number, g, strain, fields.stress[mine])
    return float(density @ fields.volume), ""


def _degradation(fields: Fields, mine: NDArray, table: MaterialTable, number: int) -> NDArray:
    from physics.phase_field import degradation

    if not table.breakable[number]:
        return np.ones(mine.sum())
    values = _on_edges(fields.grid_phase_field, fields.grid_cells[mine])
    return np.asarray(degradation(values, table.residual_stiffness[number])).mean(axis=0)


def _strain(gradient: NDArray) -> NDArray:
    """Voigt xx, yy, engineering xy (n, 3) of a displacement gradient (n, 4)."""
    return np.stack([gradient[:, 0], gradient[:, 3], gradient[:, 1] + gradient[:, 2]], axis=1)


def _density(table: MaterialTable, number: int, g: NDArray, strain: NDArray | None, stress: NDArray) -> NDArray:
    """Degraded elastic energy density (n,) [stress] of one body."""
    if strain is None:
        intact = np.linalg.solve(table.stiffness[number], stress.T).T
        return 0.5 * np.divide((stress * intact).sum(axis=1), g, where=g > 0, out=np.zeros(len(g)))
    from physics.elasticity import Law
    from physics.energy_splits import responses

    of_body = Law(*(np.asarray(values)[number : number + 1] for values in table.law))
    energies, _, _ = responses(of_body, g, strain)
    return np.asarray(g * energies[:, 0] + energies[:, 1])
