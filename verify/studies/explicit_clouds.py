"""The border of explicit integration, measured: small free clouds of material points in the solver itself.

Beside it stands what the eigenvalues of the same cloud say. With M the lumped mass, K the stiffness matrix, e the
strains and v the velocities, a step changes the nodes' velocities by M^-1 times the internal forces, and the points' by
the share P = M^-1 N^T m N of that which survives the way to the points and back. A mode first grows by changing its
sign in each step: inserting -1 for the growth of v and e leaves 4 / step² = largest eigenvalue of A M^-1 K, where A = 2
- P for strains before the points' velocities (USL) and A = P for strains after them (MUSL). No points lose their motion
where P = 1, and both are then the central differences' 2 / sqrt(lambda_max).
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from cases import Case
from mpm.explicit.solver import ExplicitMaterialPoints
from mpm.explicit.step_bound import stable_step
from mpm.placement import PointCloud
from mpm.splines import Axis
from numerics.explicit import BlewUpError
from physics.elasticity import MaterialTable
from verify.studies.verdicts import BLEW_UP, STABLE, Verdict

#: cells of the grid in each direction, and those in the middle where its open ends are not felt
CELLS, MIDDLE = 16, (6, 10)
#: random clouds behind each cell of a map, steps integrated, growth of the strain that counts as blown up
CLOUDS, STEPS, GROWTH = 10, 400, 1e6
#: strain at the start, so small that no point moves before it has grown
STRAIN = 1e-12
#: what a way of updating changes in the table of dynamics
UPDATES = {
    "usl": {"order_of_update": "usl", "affine": False},
    "musl": {"order_of_update": "musl", "affine": False},
    "affine": {"order_of_update": "usl", "affine": True},
}


def explicit_step(case: Case, *, share: float, cloud: str, order: int, update: str) -> Verdict:
    """Whether random clouds stay at rest at a share of the solver's own step by rule.

    share : of the proven step; of the Courant step where the order is one, for which no step is proven
    cloud : "full" body of 4 by 4 cells, a "fragment" of 2 to 6 points in a cell, a "single" point
    order : of the splines
    update : a name of `UPDATES`

    The verdict's value is the least critical step of all clouds by their eigenvalues, over the step by rule.
    """
    free = free_case(case, order, update)
    rule, clouds = stable_step(free), clouds_of(cloud, order)
    critical = min(critical_step(free, points) for points in clouds) / rule
    ends = [steps_until_blown(free, points, share * rule) for points in clouds]
    early = [steps for steps in ends if steps is not None]
    if not early:
        return Verdict(STABLE, value=critical, step=STEPS)
    return Verdict(BLEW_UP, value=critical, step=min(early), reason=f"a strain grew {GROWTH:.0e}-fold")


def free_case(case: Case, order: int, update: str) -> Case:
    """The case without constraints and exact solution, by another basis and way of updating."""
    assert case.dynamics is not None
    rule = "proven" if order > 1 else "courant"
    return case.model_copy(
        update={
            "constraints": (),
            "exact": None,
            "mpm": case.mpm.model_copy(update={"order": order}),
            "dynamics": case.dynamics.model_copy(update=UPDATES[update] | {"time_step_rule": rule}),
        }
    )


def clouds_of(cloud: str, order: int) -> list[NDArray]:
    """Random clouds of a kind, the same ones for every step."""
    random = np.random.default_rng(order)
    return [points_of(cloud, random) for _ in range(CLOUDS)]


def points_of(cloud: str, random: np.random.Generator) -> NDArray:
    """Positions (n, 2) of a random cloud of a kind, in cells."""
    if cloud == "single":
        return MIDDLE[0] + random.random((1, 2))
    if cloud == "fragment":
        return MIDDLE[0] + random.random((random.integers(2, 7), 2))
    places = np.arange(*MIDDLE, 0.5) + 0.25
    regular = np.stack(np.meshgrid(places, places), axis=-1).reshape(-1, 2)
    return regular + random.uniform(-0.05, 0.05, regular.shape) + random.random(2)


# ----------------------------------------------------------------------------------------- the solver


def steps_until_blown(case: Case, points: NDArray, step: float) -> int | None:
    """Steps of a size [time] after which the strain of a cloud (n, 2; in cells) has grown beyond all bounds, or None."""
    solver = _solver_of(case, points)
    for number in range(1, STEPS + 1):
        try:
            solver.step(0.0, step)
        except BlewUpError:
            return number
        if not _largest_strain(solver) < GROWTH * STRAIN:
            return number
    return None


def _solver_of(case: Case, points: NDArray) -> ExplicitMaterialPoints:
    """Four points fill a cell; their strains at the start are random."""
    n, h = len(points), case.mesh.h
    volume = np.full(n, 0.25 * h**2 * case.plane.thickness)
    cloud = PointCloud(h * points, volume, np.full((n, 2), 0.5 * h), np.full((n, 2), -0.25 * h), np.zeros(n, int))
    solver = ExplicitMaterialPoints(case, cloud)
    body, random = solver.bodies[0], np.random.default_rng(0)
    for strain in (body.points.elastic.exx, body.points.elastic.eyy, body.points.elastic.gxy):
        strain[:] = STRAIN * random.uniform(-1.0, 1.0, n)
    body.evaluate_stresses()
    return solver


def _largest_strain(solver: ExplicitMaterialPoints) -> float:
    elastic = solver.bodies[0].points.elastic
    return max(float(np.abs(strain).max()) for strain in (elastic.exx, elastic.eyy, elastic.gxy))


# ----------------------------------------------------------------------------------------- the theory


def critical_step(case: Case, points: NDArray) -> float:
    """2 / sqrt(largest eigenvalue of A M^-1 K) of a cloud (n, 2; in cells) [time]; infinite where no mode can grow."""
    assert case.dynamics is not None
    share, stiffness = _matrices(points, case.mpm.order, case.dynamics.affine, *_constants(case))
    amplified = 2.0 * np.eye(len(share)) - share if case.dynamics.order_of_update == "usl" else share
    largest = float(np.linalg.eigvals(amplified @ stiffness).real.max())
    scale = case.mesh.h * float(np.sqrt(MaterialTable(case).density[0]))
    return 2.0 * scale / np.sqrt(largest) if largest > 1e-9 * np.abs(stiffness).max() else np.inf


def _constants(case: Case) -> tuple[float, float]:
    table = MaterialTable(case)
    return float(table.lame_lambda[0]), float(table.shear_modulus[0])


def _matrices(points: NDArray, order: int, affine: bool, lam: float, mu: float) -> tuple[NDArray, NDArray]:
    """P and M^-1 K of points of equal mass and volume, over both velocities of the nodes that have mass.

    The spacing and the density are one.
    """
    value, slope_x, slope_y, x, y = _node_functions(points, order)
    mass, consistent = value.sum(axis=0), value.T @ value
    if affine:
        arm_x, arm_y = x - points[:, [0]], y - points[:, [1]]
        consistent += (value * arm_x).T @ slope_x + (value * arm_y).T @ slope_y
    share = np.kron(np.eye(2), consistent / mass[:, None])
    zero = np.zeros_like(value)
    strain = np.stack([np.hstack([slope_x, zero]), np.hstack([zero, slope_y]), np.hstack([slope_y, slope_x])])
    law = np.array([[lam + 2 * mu, lam, 0.0], [lam, lam + 2 * mu, 0.0], [0.0, 0.0, mu]])
    stiffness = np.einsum("ipn,ij,jpm->nm", strain, law, strain, optimize=True)
    return share, stiffness / np.tile(mass, 2)[:, None]


@cache
def _axis(order: int) -> Axis:
    return Axis(np.arange(CELLS + 1.0), order)


def _node_functions(points: NDArray, order: int) -> tuple[NDArray, ...]:
    """Values and slopes (n_points, n_nodes) of the functions with mass, and their places (n_nodes,) in cells."""
    axis = _axis(order)
    width = axis.n_functions
    parts = []
    for place in points.T:
        cells = axis.locate(place)
        columns = cells[:, None] + np.arange(order + 1)
        spread = [np.zeros((len(points), width)) for _ in range(2)]
        for dense, local in zip(spread, axis.evaluate(place, cells), strict=True):
            np.put_along_axis(dense, columns, local, axis=1)
        parts.append(spread)
    (nx, dx), (ny, dy) = parts
    values, slope_x, slope_y = ((a[:, :, None] * b[:, None, :]).reshape(len(points), -1)
                                for a, b in ((nx, ny), (dx, ny), (nx, dy)))  # fmt: skip
    held = values.sum(axis=0) > 0.0
    places = axis.greville()
    x, y = np.repeat(places, width)[held], np.tile(places, width)[held]
    return values[:, held], slope_x[:, held], slope_y[:, held], x, y
