"""A solver of one's own, as small as can be: a bar in tension by finite differences along x, staggered.

All that is asked of it is a function from a case to a table with the columns of a history, in the units of the case.
"""

import numpy as np
import pandas as pd
from scipy.linalg import solve_banded

from cases import Case
from cases.solvers import Solver

#: what the entry point of the group "fracture_verify.solvers" names
SOLVER = Solver("own", "Own bar", "one bar", ":", table="own_solver:solve")


def solve(case: Case) -> pd.DataFrame:
    """History of a bar under tension along x in plane stress: u [length], F [force], energies, least phase field."""
    (material,) = case.materials.values()
    length, height = np.subtract(*case.bounding_box()[::-1])
    area, nodes = height * case.plane.thickness, round(length / case.mesh.h) + 1
    h, toughness, l0 = length / (nodes - 1), material.fracture.toughness, material.fracture.length_scale
    width, diffusion = np.r_[0.5, np.ones(nodes - 2), 0.5], 2.0 * toughness * l0 / h**2
    c, history_field, rows = np.ones(nodes), np.zeros(nodes), []
    for u in np.arange(case.load.path[0], case.load.path[-1] + 0.5 * case.load.increment, case.load.increment):
        for _ in range(10_000):
            stress = u / np.sum(h * width / (c**2 * material.young))
            strain = stress / (c**2 * material.young)
            driving = np.maximum(history_field, 0.5 * material.young * strain**2)
            diagonal = width * (2.0 * driving + toughness / (2.0 * l0) + 2.0 * diffusion)
            beside = np.full(nodes, -diffusion)
            before, c = c, solve_banded((1, 1), [beside, diagonal, beside], width * toughness / (2.0 * l0))
            if np.abs(c - before).max() < 1e-12:
                break
        history_field, slope = driving, np.diff(c) / h
        fracture = np.sum(h * width * (c - 1.0) ** 2) / (4.0 * l0) + l0 * np.sum(h * slope**2)
        rows.append((u, stress * area, 0.5 * stress * area * u, toughness * fracture * area, c.min()))
    return pd.DataFrame(rows, columns=["u", "F", "E_el", "E_frac", "c_min"])
