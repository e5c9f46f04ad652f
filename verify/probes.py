"""Measurements for maps that need no run of the case: parts of the solvers under conditions that are set for them.

A probe is called with the case and the levels of a map by name, dots become underscores; it returns a `Verdict`.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cases import Case
from mpm.splines import Axis
from verify.explicit_clouds import explicit_step
from verify.verdicts import STABLE, Verdict

#: cells of the grid in each direction, and those in the middle where the open ends are not felt
CELLS, MIDDLE = 16, (6, 10)
#: elongation of the points that travel across cells
STRETCH = 1.1

# --------------------------------------------------------------------------------------- cell crossing


def cell_crossing(case: Case, *, points_per_cell: int, order: int) -> Verdict:
    """Largest force that an even stress exerts on an inner node while its points travel across a cell.

    The points are evenly elongated by `STRETCH`, so that the cells hold now more and now fewer of them. The force
    should be nothing: value and error are its share of stress times section. It does not depend on the size of the
    cells, so that no refinement of the grid removes it; more points in a cell do.
    """
    spacing = STRETCH / points_per_cell
    start = np.arange(0.5 * spacing, CELLS, spacing)
    travelled = np.linspace(0.0, 1.0, 401)[:-1]
    force = max(_largest_inner_force(start + way, spacing, order) for way in travelled)
    return Verdict(STABLE, value=force, error=force)


def _largest_inner_force(positions: NDArray, spacing: float, order: int) -> float:
    inside = positions[positions < CELLS]
    axis = Axis(np.arange(CELLS + 1.0), order)
    _, slopes = axis.evaluate(inside, axis.locate(inside))
    forces = np.zeros(CELLS + order)
    np.add.at(forces, np.floor(inside).astype(int)[:, None] + np.arange(order + 1), slopes * spacing)
    return float(np.abs(forces[MIDDLE[0] : MIDDLE[1]]).max())


PROBES: dict[str, Callable[..., Verdict]] = {"explicit_step": explicit_step, "cell_crossing": cell_crossing}
