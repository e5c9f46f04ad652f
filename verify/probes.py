"""Measurements for maps that need no run: small clouds of material points on a uniform grid of cells of size one.

A probe is called with the case and the levels of a map by name, dots become underscores; it returns a `Verdict`.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvalsh

from cases import Case
from mpm.splines import Axis
from physics.elasticity import MaterialTable
from verify.verdicts import BLEW_UP, STABLE, Verdict

#: cells of the grid in each direction, and those in the middle where the open ends are not felt
CELLS, MIDDLE = 16, (6, 10)
#: elongation of the points that travel across cells
STRETCH = 1.1
#: random clouds behind each cell of a map, steps integrated, growth that counts as blown up
CLOUDS, STEPS, GROWTH = 20, 400, 1e6


# ------------------------------------------------------------------------------------------- time steps


def explicit_step(case: Case, *, share: float, cloud: str, order: int) -> Verdict:
    """Central differences of elastic clouds of points with lumped mass, at a share of the step by rule.

    share : of the proven step; of the Courant step where the order is one, for which no step is proven
    cloud : "full" body of 4 by 4 cells, a "fragment" of 2 to 6 points in a cell, a "single" point
    order : of the splines

    The verdict's value is the least step 2 / sqrt(lambda_max) of all clouds, over the step by rule.
    """
    step = share * _step_by_rule(case, order)
    blown = [_steps_until_blown(stiffness, step) for stiffness in _clouds(case, cloud, order)]
    critical = least_critical_step(case, cloud, order) / _step_by_rule(case, order)
    early = [steps for steps in blown if steps is not None]
    if not early:
        return Verdict(STABLE, value=critical, step=STEPS)
    return Verdict(BLEW_UP, value=critical, step=min(early), reason=f"{len(early)} of {len(blown)} clouds")


def least_critical_step(case: Case, cloud: str, order: int) -> float:
    """The least of 2 / sqrt(lambda_max) over the random clouds of a kind [time]."""
    largest = max(float(eigvalsh(stiffness)[-1]) for stiffness in _clouds(case, cloud, order))
    return 2.0 / np.sqrt(largest)


def _step_by_rule(case: Case, order: int) -> float:
    """Step that no single point of splines of order 2 or 3 can blow up; h / c for hat functions. Density one."""
    lam, mu = _constants(case)
    if order == 1:
        return 1.0 / np.sqrt(lam + 2.0 * mu)
    return 2.0 / np.sqrt(max(2.0 * (lam + mu), 2.0 * mu) * _largest_gradient(order))


@cache
def _largest_gradient(order: int) -> float:
    """Largest sum over I of (dN_I/dx)^2 / N_I in a cell."""
    x = MIDDLE[0] + np.linspace(1e-9, 1.0 - 1e-9, 100_001)
    values, slopes = _functions(x, order)
    return float((slopes**2 / values).sum(axis=1).max())


def _constants(case: Case) -> tuple[float, float]:
    table = MaterialTable(case)
    return float(table.lame_lambda[0]), float(table.shear_modulus[0])


def _functions(x: NDArray, order: int) -> tuple[NDArray, NDArray]:
    axis = Axis(np.arange(CELLS + 1.0), order)
    return axis.evaluate(x, axis.locate(x))


def _clouds(case: Case, cloud: str, order: int, count: int = CLOUDS) -> list[NDArray]:
    """M^-1/2 K M^-1/2 of random clouds, the same ones for every step."""
    random = np.random.default_rng(order)
    return [scaled_stiffness(points_of(cloud, random), order, *_constants(case)) for _ in range(count)]


def points_of(cloud: str, random: np.random.Generator) -> NDArray:
    """Positions (n, 2) of a random cloud of a kind, in cells."""
    if cloud == "single":
        return MIDDLE[0] + random.random((1, 2))
    if cloud == "fragment":
        return MIDDLE[0] + random.random((random.integers(2, 7), 2))
    places = np.arange(*MIDDLE, 0.5) + 0.25
    regular = np.stack(np.meshgrid(places, places), axis=-1).reshape(-1, 2)
    return regular + random.uniform(-0.05, 0.05, regular.shape) + random.random(2)


def scaled_stiffness(points: NDArray, order: int, lam: float, mu: float) -> NDArray:
    """M^-1/2 K M^-1/2 of points of equal mass and volume, over the nodes that have mass."""
    (nx, dx), (ny, dy) = (_functions(points[:, k], order) for k in (0, 1))
    size, width = 2 * (CELLS + order) ** 2, CELLS + order
    mass, stiffness = np.zeros(size), np.zeros((size, size))
    law = np.array([[lam + 2 * mu, lam, 0.0], [lam, lam + 2 * mu, 0.0], [0.0, 0.0, mu]])
    for p, (x, y) in enumerate(np.floor(points).astype(int)):
        nodes = ((x + np.arange(order + 1))[:, None] + width * (y + np.arange(order + 1))).ravel()
        value = np.outer(nx[p], ny[p]).ravel()
        slope = np.stack([np.outer(dx[p], ny[p]).ravel(), np.outer(nx[p], dy[p]).ravel()])
        strain = np.zeros((3, 2 * len(nodes)))
        strain[0, 0::2], strain[1, 1::2], strain[2, 0::2], strain[2, 1::2] = slope[0], slope[1], slope[1], slope[0]
        unknowns = (2 * nodes[:, None] + np.arange(2)).ravel()
        stiffness[np.ix_(unknowns, unknowns)] += strain.T @ law @ strain
        mass[unknowns] += np.repeat(value, 2)
    held = np.flatnonzero(mass > 0.0)
    root = np.sqrt(mass[held])
    return stiffness[np.ix_(held, held)] / root[:, None] / root


def _steps_until_blown(stiffness: NDArray, step: float) -> int | None:
    """Step at which free vibration by central differences has grown beyond all bounds; None when it does not."""
    before = np.random.default_rng(0).standard_normal(len(stiffness))
    now, limit = before.copy(), GROWTH * np.abs(before).max()
    for number in range(1, STEPS + 1):
        before, now = now, 2.0 * now - before - step**2 * (stiffness @ now)
        # rigid motion grows in proportion to time; what blows up grows by a factor in each step
        if np.abs(now).max() > limit:
            return number
    return None


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
    _, slopes = _functions(inside, order)
    forces = np.zeros(CELLS + order)
    np.add.at(forces, np.floor(inside).astype(int)[:, None] + np.arange(order + 1), slopes * spacing)
    return float(np.abs(forces[MIDDLE[0] : MIDDLE[1]]).max())


PROBES: dict[str, Callable[..., Verdict]] = {"explicit_step": explicit_step, "cell_crossing": cell_crossing}
