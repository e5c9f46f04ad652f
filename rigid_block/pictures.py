"""What there is to be seen of rigid bodies: a coarse raster of each, moved as a whole."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cases import Case
from numerics.fields import Fields

#: cells along the longer side of each body
CELLS = 16


def picture(case: Case, centre: NDArray, angle: float) -> Fields:
    """The bodies' bounding boxes as cells and points in their middles.

    The body that rocks has its centre at ``centre`` (2,) [length] and is turned by ``angle`` [rad]; the others stand.
    """
    assert case.rocking is not None
    names, boxes = list(case.bodies), [body.bounds() for body in case.bodies.values()]
    nodes, quads = map(list, zip(*(_raster(*box) for box in boxes), strict=True))
    first_nodes = np.cumsum([0, *(len(corners) for corners in nodes)])
    middles = [corners[cells].mean(axis=1) for corners, cells in zip(nodes, quads, strict=True)]
    counts = [len(cells) for cells in quads]
    areas = [float(np.prod(box[1] - box[0])) / count for box, count in zip(boxes, counts, strict=True)]
    rocks = names.index(case.rocking.body)
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, -sine], [sine, cosine]])
    first = np.mean(case.bodies[case.rocking.body].bounds(), axis=0)

    def moved(places: list[NDArray]) -> NDArray:
        each = [(p - first) @ turn.T + centre - p if n == rocks else np.zeros_like(p) for n, p in enumerate(places)]
        return np.vstack(each)

    of_body = np.repeat(np.arange(len(names)), counts)
    count, displacement = len(of_body), moved(middles)
    cells = np.vstack([each + first_node for each, first_node in zip(quads, first_nodes, strict=False)])
    gradient = np.where((of_body == rocks)[:, None], (turn - np.eye(2)).ravel(), 0.0)
    reference, volume = np.vstack(middles), case.plane.thickness * np.repeat(areas, counts)
    return Fields(
        points=reference + displacement, reference=reference, volume=volume, displacement=displacement,
        gradient=gradient, phase_field=np.ones(count), history_field=np.zeros(count), stress=np.zeros((count, 3)),
        energy_density=np.zeros(count), body=of_body, grid_points=np.vstack(nodes), grid_cells=cells,
        grid_displacement=moved(nodes), grid_phase_field=np.ones(first_nodes[-1]),
        broken_at=np.full(count, np.nan),
    )  # fmt: skip


def _raster(lower: NDArray, upper: NDArray) -> tuple[NDArray, NDArray]:
    """Corners (m, 2) and quads (k, 4) of nearly square cells."""
    size = upper - lower
    nx, ny = (max(1, round(CELLS * side / size.max())) for side in size)
    x, y = np.meshgrid(np.linspace(lower[0], upper[0], nx + 1), np.linspace(lower[1], upper[1], ny + 1), indexing="ij")
    first = (np.arange(nx)[:, None] * (ny + 1) + np.arange(ny)).ravel()
    quads = np.column_stack([first, first + ny + 1, first + ny + 2, first + 1])
    return np.column_stack([x.ravel(), y.ravel()]), quads
