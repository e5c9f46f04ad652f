"""One body of the explicit material point method: its points, and the window of the grid that goes with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from cases import Case
from mpm.explicit import kernels as explicit_kernels
from mpm.explicit.kernels import DRIFT, STRIP, kernels
from mpm.grid import GridError
from mpm.placement import PointCloud
from numerics.explicit import BlewUpError
from physics.elasticity import MaterialTable
from physics.phase_field import degradation

#: nodes of a window beyond which a body has come apart over the whole neighbourhood
MOST_NODES = 50_000_000
#: least moment of inertia of a body that can spin, over that about the window's corner: less is round-off
LEAST_INERTIA = 1e-14
#: cells of the window around the body's points
MARGIN = DRIFT + 1


@dataclass
class Points:
    """Arrays over the points of a body, sorted by columns of cells.

    ``number`` is a point's place in the case's cloud; ``x, y`` are in cells from the window's corner, ``size_x,
    size_y`` in cells; ``exx, eyy, gxy`` is the elastic strain (engineering shear) in fixed axes; ``moved_x, moved_y``
    the velocity that carries the point; ``cxx .. cyy`` its velocity gradient where the map is affine [1/time]; ``c``,
    ``history`` and ``g`` are phase field, history field [stress] and degradation; ``psi_plus, psi_minus`` the energy
    densities before degradation [stress]; ``solved_for`` is the history field that the phase field was solved for,
    ``crack_energy`` the energy of cracks in a unit volume [stress] and ``broken_at`` the time at which a point broke, NaN
    before. Where the fracture energy has a direction, ``turn`` is how far the material has turned [radian] and ``stray_x,
    stray_y`` in cells how far the point has moved since its phase field was found.
    """

    number: NDArray
    x: NDArray
    y: NDArray
    vx: NDArray
    vy: NDArray
    mass: NDArray
    volume: NDArray
    size_x: NDArray
    size_y: NDArray
    exx: NDArray
    eyy: NDArray
    gxy: NDArray
    sxx: NDArray
    syy: NDArray
    sxy: NDArray
    moved_x: NDArray
    moved_y: NDArray
    cxx: NDArray
    cxy: NDArray
    cyx: NDArray
    cyy: NDArray
    c: NDArray
    history: NDArray
    g: NDArray
    psi_plus: NDArray
    psi_minus: NDArray
    solved_for: NDArray
    crack_energy: NDArray
    broken_at: NDArray
    turn: NDArray
    stray_x: NDArray
    stray_y: NDArray


@dataclass(frozen=True)
class Motion:
    """A body as a whole: mass, centre of mass (2,) [length], momentum (2,), angular velocity [1/time], kinetic energy."""

    mass: float
    place: NDArray
    momentum: NDArray
    spin: float
    energy: float


@dataclass
class NodeArrays:
    """Arrays over the nodes of a window: mass, momentum, force, its part from tractions,
    velocity before and after the step, mass gradient, normal, reach along it, cells around shared nodes."""

    m: NDArray
    px: NDArray
    py: NDArray
    fx: NDArray
    fy: NDArray
    ex: NDArray
    ey: NDArray
    old_x: NDArray
    old_y: NDArray
    vx: NDArray
    vy: NDArray
    slope_x: NDArray
    slope_y: NDArray
    normal_x: NDArray
    normal_y: NDArray
    reach: NDArray
    touches: NDArray


def new_nodes(size: int) -> NodeArrays:
    """Nodes of a new window, all zero."""
    names = [f.name for f in fields(NodeArrays)]
    return NodeArrays(**{name: np.zeros(size, np.bool_ if name == "touches" else float) for name in names})


class MovingBody:
    """A body with its own field of velocity on the grid.

    The grid is one lattice for all bodies, of spacing h from ``origin``; node (i, j) stands at
    origin + (i - (order - 1) / 2, j - (order - 1) / 2) h. The body uses a window of it.

    Attributes
    ----------
    corner, shape : (2,) first node of the window in the lattice, and its number of nodes.
    rigid : it keeps its velocity whatever meets it.
    breakable : it has a phase field, which whoever solves it writes to ``points.c`` and ``points.g``.
    """

    def __init__(self, case: Case, number: int, cloud: PointCloud) -> None:
        name, body = list(case.bodies.items())[number]
        self.name, self.rigid, self._dynamics = name, body.rigid, case.dynamics
        self.h, self.order = case.mesh.h, case.mpm.order
        self.origin = case.bounding_box()[0]
        self.kernels = kernels(self.order)
        self._set_material(case, number)
        places = np.flatnonzero(cloud.body == number)
        if not len(places):
            raise GridError(f"{case.source}: bodies.{name}: it is too thin for points to lie in it; make mesh.h smaller.")
        self.rigid_velocity = np.array(body.velocity)
        self.corner = np.zeros(2, np.int64)
        self.points = self._make_points(cloud, places, body.initial_velocity(cloud.positions[places]))
        (xx, xy), (yx, yy) = body.velocity_gradient
        for name, rate in (("cxx", xx), ("cxy", xy), ("cyx", yx), ("cyy", yy)):
            getattr(self.points, name)[:] = rate
        self.sort()

    def _set_material(self, case: Case, number: int) -> None:
        table = MaterialTable(case)
        self.lam, self.mu = float(table.lame_lambda[number]), float(table.shear_modulus[number])
        self.density = float(table.density[number])
        self.breakable, self.split = bool(table.breakable[number]) and not self.rigid, int(table.law.split[number])
        self.residual_stiffness = float(table.residual_stiffness[number])
        self._irreversible = case.staggered.irreversible
        self._has_axes = bool(table.fourth_order[number]) and not self.rigid

    def _make_points(self, cloud: PointCloud, places: NDArray, velocity: NDArray) -> Points:
        x, y = (cloud.positions[places] - self.origin).T / self.h
        size_x, size_y = cloud.size[places].T / self.h
        volume = cloud.volume[places].copy()
        given = {
            "number": places, "x": x, "y": y, "vx": velocity[:, 0], "vy": velocity[:, 1], "mass": self.density * volume,
            "volume": volume, "size_x": size_x, "size_y": size_y, "c": np.ones(len(places)), "g": np.ones(len(places)),
            "broken_at": np.full(len(places), np.nan),
        }  # fmt: skip
        zeros = {f.name: np.zeros(len(places)) for f in fields(Points) if f.name not in given}
        return Points(**{name: np.ascontiguousarray(array) for name, array in (given | zeros).items()})

    # ---------------------------------------------------------------- window

    @property
    def width(self) -> int:
        """Nodes of the window in y."""
        return int(self.shape[1])

    def sort(self) -> None:
        """Put the window around the points and sort them by columns of cells; list the strips."""
        points = self.points
        cells = np.array([np.floor(points.x), np.floor(points.y)]).astype(np.int64) + self.corner[:, None]
        lower, upper = cells.min(axis=1) - MARGIN, cells.max(axis=1) + MARGIN
        self.shape = upper - lower + 1 + self.order
        if np.prod(self.shape.astype(float)) > MOST_NODES:
            raise BlewUpError(
                f"the points of body '{self.name}' are spread over {self.shape[0]} x {self.shape[1]} nodes, more than"
                " there is room for; shorten dynamics.end_time, or enlarge mesh.h"
            )
        shift = self.corner - lower
        points.x += shift[0]
        points.y += shift[1]
        self.corner = lower
        local = cells - lower[:, None]
        # one key in place of three: nearly in order since the last time, which this way of sorting makes use of
        key = (local[0] * self.width + local[1]) * (points.number.max() + 1) + points.number
        order = np.argsort(key, kind="stable")
        points.number, spare = points.number[order], np.empty_like(points.x)
        for name in (f.name for f in fields(Points) if f.name != "number"):
            # each array is written over the one before it: new ones would cost more than the sorting
            values = getattr(points, name)
            reorder(values, order, spare)
            setattr(points, name, spare)
            spare = values
        strip = local[0][order] // STRIP
        self.strips = np.searchsorted(strip, np.arange(strip[-1] + 2)).astype(np.int64)
        self.fastest = np.zeros(len(self.strips) - 1)
        size = int(np.prod(self.shape))
        self.grid = new_nodes(size)
        self._find_order()
        self.wandered = 0.0
        self.largest_speed = float(np.hypot(points.vx, points.vy).max())

    def _find_order(self) -> None:
        self._mapped = False
        self._by_number = np.argsort(self.points.number)
        self._sorted_numbers = self.points.number[self._by_number]

    def places_of(self, numbers: NDArray) -> NDArray:
        """Present indices (n,) of the points with these numbers."""
        return self._by_number[np.searchsorted(self._sorted_numbers, numbers)]

    def keep_sorted(self, step: float) -> None:
        """Sort anew before any point can wander more than a cell from where it was sorted."""
        further = 1.5 * step / self.h * self.largest_speed
        if not further <= DRIFT:
            raise BlewUpError(
                f"a point of body '{self.name}' moves {further / 1.5:.2g} cells in one step of {step:.4g}; the step is"
                " above the stability limit or the body is too fast for the grid"
            )
        if self.wandered + further > DRIFT:
            self.sort()

    # ---------------------------------------------------------------- a step

    def map_to_grid(self) -> None:
        """Mass, momentum and minus internal forces to the nodes."""
        grid, points = self.grid, self.points
        if self.rigid and self._mapped and not self.rigid_velocity.any():
            return
        self._mapped = True
        for array in (grid.m, grid.px, grid.py, grid.fx, grid.fy):
            array[:] = 0.0
        self.kernels.to_grid(
            self.strips, points.x, points.y, points.vx, points.vy, points.mass, points.volume,
            points.sxx, points.syy, points.sxy, 1.0 / self.h, self.width, grid.m, grid.px, grid.py, grid.fx, grid.fy,
        )  # fmt: skip
        self._map_gradients()

    def _map_gradients(self) -> None:
        grid, points = self.grid, self.points
        if self._dynamics is not None and self._dynamics.affine and not self.rigid:
            self.kernels.affine_to_grid(
                self.strips, points.x, points.y, points.mass, points.cxx, points.cxy, points.cyx, points.cyy,
                self.h, self.width, grid.px, grid.py,
            )  # fmt: skip

    def find_trial_velocities(self, step: float) -> None:
        """Velocities of the nodes before the step and without contact after it."""
        grid = self.grid
        assert self._dynamics is not None
        gravity = (0.0, 0.0) if self.rigid else self._dynamics.gravity
        explicit_kernels.trial_velocities(
            self.width, step, *gravity, self._dynamics.damping, grid.m, grid.px, grid.py, grid.fx, grid.fy,
            grid.old_x, grid.old_y, grid.vx, grid.vy,
        )  # fmt: skip
        if self.rigid:
            grid.vx[:], grid.vy[:] = self.rigid_velocity

    def update_points(self, step: float) -> None:
        """Velocities of the points; a rigid body's new places."""
        points = self.points
        if self.rigid:
            points.x += step / self.h * self.rigid_velocity[0]
            points.y += step / self.h * self.rigid_velocity[1]
            self.wandered += step / self.h * float(np.abs(self.rigid_velocity).max())
            return
        self._to_points(step, with_velocities=True, with_strains=False)

    def update_all(self, step: float) -> None:
        """`update_points` and `update_stresses` in one pass, for strains from the same velocities of the nodes (USL)."""
        if self.rigid:
            self.update_points(step)
            return
        self._to_points(step, with_velocities=True, with_strains=True)

    def _to_points(self, step: float, with_velocities: bool, with_strains: bool) -> None:
        grid, points, dynamics = self.grid, self.points, self._dynamics
        assert dynamics is not None
        self.kernels.to_points(
            self.strips, points.x, points.y, points.vx, points.vy, grid.vx, grid.vy, grid.vx - grid.old_x,
            grid.vy - grid.old_y, self.width, step / self.h, dynamics.flip, dynamics.rotation == "corotational",
            (dynamics.affine or self._has_axes) / self.h, with_velocities, with_strains,
            not self.breakable, self.lam, self.mu, points.exx, points.eyy, points.gxy,
            points.sxx, points.syy, points.sxy, points.cxx, points.cxy, points.cyx, points.cyy,
            points.moved_x, points.moved_y, self.fastest,
        )  # fmt: skip
        if with_velocities:
            self.largest_speed = float(np.sqrt(self.fastest.max()))
            self.wandered += step / self.h * self.largest_speed
        if with_strains:
            self._turn_axes(step)
        if with_strains and self.breakable:
            self.evaluate_stresses()

    def map_momentum_again(self) -> None:
        """Velocities of the nodes from those of the points after the step (MUSL)."""
        grid, points = self.grid, self.points
        grid.px[:], grid.py[:] = 0.0, 0.0
        self.kernels.momentum_to_grid(
            self.strips, points.x, points.y, points.vx, points.vy, points.mass, self.width, grid.px, grid.py
        )
        self._map_gradients()
        over = np.divide(1.0, grid.m, out=np.zeros_like(grid.m), where=grid.m > 0.0)
        grid.vx, grid.vy = grid.px * over, grid.py * over

    def update_stresses(self, step: float) -> None:
        """Strains from the nodes' velocities, new places, and stresses."""
        if self.rigid:
            return
        self._to_points(step, with_velocities=False, with_strains=True)

    def _turn_axes(self, step: float) -> None:
        """How far the material has turned and strayed, where its fracture energy has a direction."""
        points = self.points
        if self._has_axes:
            points.turn += 0.5 * step * (points.cyx - points.cxy)
            points.stray_x += step / self.h * points.moved_x
            points.stray_y += step / self.h * points.moved_y

    def evaluate_stresses(self) -> None:
        """Stresses, and energy densities where the body can break, from the strains and the phase field."""
        p = self.points
        if self.breakable:
            p.g = degradation(p.c, self.residual_stiffness)
            explicit_kernels.degraded_stresses(
                p.exx, p.eyy, p.gxy, self.lam, self.mu, self.split, p.g, p.sxx, p.syy, p.sxy, p.psi_plus, p.psi_minus
            )
            np.maximum(p.history if self._irreversible else 0.0, p.psi_plus, out=p.history)
        else:
            explicit_kernels.elastic_stresses(p.exx, p.eyy, p.gxy, self.lam, self.mu, p.sxx, p.syy, p.sxy)

    # ---------------------------------------------------------------- contact

    def inverse_mass(self, nodes: NDArray) -> NDArray:
        """Inverse masses (n,) of nodes, 0 of a rigid body."""
        return np.zeros(len(nodes)) if self.rigid else 1.0 / self.grid.m[nodes]

    def find_mass_slopes(self, nodes: list[NDArray]) -> None:
        """Mass gradients at nodes, from the points of the cells around them."""
        grid, points = self.grid, self.points
        chosen = np.concatenate(nodes)
        grid.touches[:] = False
        mark_cells(chosen, self.width, self.order, grid.touches)
        grid.slope_x[:], grid.slope_y[:] = 0.0, 0.0
        columns = chosen // self.width
        first = max(0, (int(columns.min()) - self.order - DRIFT) // STRIP)
        self._near = self.strips[first : (int(columns.max()) + DRIFT) // STRIP + 2]
        self.kernels.mass_slopes(
            self._near, points.x, points.y, points.mass, grid.touches, self.width, grid.slope_x, grid.slope_y
        )

    def outward_normals(self, nodes: NDArray) -> NDArray:
        """Unit vectors (2, n) out of the body at nodes (Eq. 6.33); 0 where the sum vanishes.

        The functions of a node outside grow from the points towards it, so that the sum points outwards as it stands.
        """
        slope = np.array([self.grid.slope_x[nodes], self.grid.slope_y[nodes]])
        length = np.hypot(*slope)
        return np.divide(slope, length, out=np.zeros_like(slope), where=length > 0.0)

    def reach(self, nodes: NDArray, normal: NDArray) -> NDArray:
        """How far (n,) the body reaches from nodes along normals (2, n) [length]."""
        grid, points = self.grid, self.points
        grid.normal_x[nodes], grid.normal_y[nodes] = normal
        grid.reach[:] = -np.inf
        self.kernels.reaches(
            self._near, points.x, points.y, points.size_x, points.size_y, grid.touches, self.width,
            grid.normal_x, grid.normal_y, grid.reach,
        )  # fmt: skip
        return self.h * grid.reach[nodes]

    # ---------------------------------------------------------------- what can be seen

    def positions(self) -> NDArray:
        """Places (n, 2) of the points, in their present order [length]."""
        local = np.column_stack([self.points.x, self.points.y]) + self.corner
        return self.origin + self.h * local

    def energy_density(self) -> NDArray:
        """Elastic energy density (n,) [stress]."""
        p = self.points
        if self.breakable:
            return p.g * p.psi_plus + p.psi_minus
        return 0.5 * (p.sxx * p.exx + p.syy * p.eyy + p.sxy * p.gxy)

    def damping_power(self) -> float:
        """Power of the damping in this step, at most zero [energy/time]."""
        grid, rate = self.grid, self._dynamics.damping if self._dynamics else 0.0
        return -rate * float((grid.m * (grid.old_x * grid.vx + grid.old_y * grid.vy)).sum()) if rate else 0.0

    def motion(self) -> Motion:
        """The motion of the body as a whole, in one pass over its points."""
        p, parts = self.points, np.zeros((len(self.strips) - 1, 8))
        sum_motion(self.strips, p.x, p.y, p.vx, p.vy, p.mass, parts)
        mass, x, y, square, momentum_x, momentum_y, turning, energy = parts.sum(axis=0)
        middle = np.array([x, y]) / mass
        inertia = square - mass * float(middle @ middle)
        turning -= float(middle[0] * momentum_y - middle[1] * momentum_x)
        # a single point has no spin
        spin = turning / (self.h * inertia) if inertia > LEAST_INERTIA * square else 0.0
        place = self.origin + self.h * (self.corner + middle)
        return Motion(float(mass), place, np.array([momentum_x, momentum_y]), float(spin), float(energy))

    def checkpoint(self) -> dict[str, NDArray]:
        """Everything that the next step needs, in the points' present order."""
        arrays = {f.name: getattr(self.points, f.name) for f in fields(Points)}
        return arrays | {
            "corner": self.corner, "shape": self.shape, "strips": self.strips,
            "wandered": np.array([self.wandered, self.largest_speed]),
        }  # fmt: skip

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to a checkpoint."""
        self.points = Points(**{f.name: saved[f.name].copy() for f in fields(Points)})
        self.corner, self.shape, self.strips = saved["corner"], saved["shape"], saved["strips"]
        self.fastest = np.zeros(len(self.strips) - 1)
        self.wandered, self.largest_speed = map(float, saved["wandered"])
        size = int(np.prod(self.shape))
        self.grid = new_nodes(size)
        self._find_order()


@njit(cache=True, parallel=True)
def reorder(values, order, found):
    """found = values[order], by all threads."""
    for i in prange(len(order)):
        found[i] = values[order[i]]


@njit(cache=True)
def mark_cells(nodes, width, order, touches):
    """Mark the cells whose points reach one of the nodes."""
    for node in nodes:
        i, j = node // width, node % width
        for a in range(max(0, i - order), i + 1):
            for b in range(max(0, j - order), j + 1):
                touches[a * width + b] = True


@njit(cache=True, parallel=True)
def sum_motion(strips, x, y, vx, vy, mass, parts):
    """Sums over the points of each strip (n_strips, 8): mass, its moments and second moment about the window's corner,
    momentum, its moment, and kinetic energy; places in cells."""
    for strip in prange(len(strips) - 1):
        m = mx = my = square = px = py = turning = energy = 0.0
        for p in range(strips[strip], strips[strip + 1]):
            one, two = mass[p] * vx[p], mass[p] * vy[p]
            m += mass[p]
            mx += mass[p] * x[p]
            my += mass[p] * y[p]
            square += mass[p] * (x[p] * x[p] + y[p] * y[p])
            px += one
            py += two
            turning += x[p] * two - y[p] * one
            energy += 0.5 * (one * vx[p] + two * vy[p])
        sums = (m, mx, my, square, px, py, turning, energy)
        for k in range(len(sums)):
            parts[strip, k] = sums[k]
