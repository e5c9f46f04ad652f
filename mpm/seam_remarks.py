"""What is to be said of material points of two elastic laws in one cell, before they are computed."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.seams import Seam, seams
from cases.spacing import cell_sizes
from numerics.description import fourth_order
from physics.elasticity import MaterialTable

#: by how many times the cell over its mean thickness a body is too stiff, over the root of how often what is around it is
#: as stiff, less 1; measured on slanted layers 2 to 8 cells thick beside what is 10 and 100 times as stiff
STIFFENED = 0.08
#: what is worth telling
LEAST = 0.01


def seam_remarks(case: Case) -> list[str]:
    """A sentence for each body of a case at rest that the cells across its seams with stiffer ones make too stiff.

    Strain jumps there, and functions that are smooth within a cell cannot follow.
    """
    shares: dict[int, float] = defaultdict(float)
    for seam in seams(case):
        crossing = seam.stretches[_crosses_cells(case, seam.stretches)]
        if len(crossing):
            soft, share = _softer_side(case, seam, crossing)
            shares[soft] += share
    return [
        f"bodies.{list(case.bodies)[soft]}: its seams cross cells, so that material points make it about"
        f" {100.0 * share:.0f} % too stiff; half of mesh.h halves that, and finite elements follow the seams."
        for soft, share in shares.items()
        if share >= LEAST
    ]


def _softer_side(case: Case, seam: Seam, crossing: NDArray) -> tuple[int, float]:
    """Number of the softer body, and by which share stretches (n, 2, 2) of the seam make it too stiff."""
    names, stiffness = list(case.bodies), np.trace(MaterialTable(case).stiffness, axis1=1, axis2=2)
    soft, stiff = sorted((names.index(seam.one), names.index(seam.other)), key=lambda body: stiffness[body])
    lengths = np.linalg.norm(crossing[:, 1] - crossing[:, 0], axis=1)
    across = float(lengths @ cell_sizes(case, crossing.mean(axis=1)).max(axis=1))
    # what two seams hold between them is twice its area over their length thick
    cells_thick = 2.0 * case.outlines()[soft].area / across
    return soft, STIFFENED * float(np.sqrt(stiffness[stiff] / stiffness[soft] - 1.0)) / cells_thick


def _crosses_cells(case: Case, stretches: NDArray) -> NDArray[np.bool_]:
    """Stretches (n, 2, 2) on which the grid has no line with a kink."""
    slanted: NDArray[np.bool_] = (stretches[:, 0] != stretches[:, 1]).all(axis=1)
    return slanted | (fourth_order(case) and case.mpm.order > 1)
