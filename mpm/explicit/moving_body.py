"""One body of the explicit material point method: its points, and the window of the grid that goes with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.bodies import Body
from mpm.explicit.body_motion import BodyMotion
from mpm.explicit.points import Points
from mpm.explicit.stresses import BodyLaw, degraded_stresses, elastic_stresses
from mpm.explicit.transfers import DRIFT, PointUpdate, carried, transfers, trial_velocities, work_on_nodes
from mpm.explicit.window import GridWindow, Lattice
from mpm.grid import GridError
from mpm.placement import PointCloud
from numerics.explicit import BlewUpError
from physics.elasticity import MaterialTable

#: nodes of a window beyond which a body has come apart over the whole neighbourhood
MOST_NODES = 50_000_000
#: cells of the window around the body's points
MARGIN = DRIFT + 1


@dataclass
class Wandering:
    """How far points may have gone since they were sorted, in cells, and the largest speed of any [length/time].

    ``fastest`` (n_strips,) is where the points' update leaves the squares of the largest speeds.
    """

    far: float
    largest_speed: float
    fastest: NDArray


class Carried(NamedTuple):
    """What a body carries over a step: mass, momenta (2,) before and after it, and the sum over its mass of the product
    of its velocities before and after [energy]."""

    mass: float
    before: NDArray
    after: NDArray
    damped: float


class MovingBody:
    """A body with its own field of velocity on the grid.

    Attributes
    ----------
    lattice : of all bodies; window : the body's part of it.
    deforms, keeps_velocity : it is not rigid; it is rigid and keeps its velocity whatever meets it.
    breakable : it has a phase field, which whoever solves it writes to ``points.crack.c``.
    has_axes : its fracture energy has a direction.
    lag : (2,) of its places behind the later one of a step's velocities [length/time].
    transfers : compiled loops between points and nodes.
    """

    deforms, keeps_velocity = True, False

    def __init__(self, case: Case, number: int, cloud: PointCloud) -> None:
        assert case.dynamics is not None
        name, body = list(case.bodies.items())[number]
        self.name, self.lag = name, np.zeros(2)
        self._dynamics, self._irreversible = case.dynamics, case.staggered.irreversible
        self.lattice = Lattice(case.bounding_box()[0], case.mesh.h, case.mpm.order)
        self.transfers = transfers(case.mpm.order)
        table = MaterialTable(case)
        constants = table.lame_lambda, table.shear_modulus, table.residual_stiffness
        self.law = BodyLaw(*(float(constant[number]) for constant in constants))
        self._degraded_stresses = degraded_stresses(int(table.law.split[number]))
        self.breakable = bool(table.breakable[number]) and self.deforms
        self.has_axes = bool(table.fourth_order[number]) and self.deforms
        places = np.flatnonzero(cloud.body == number)
        if not len(places):
            raise GridError(f"{case.source}: bodies.{name}: it is too thin for points to lie in it; make mesh.h smaller.")
        self.points = self._make_points(cloud, places, body, float(table.density[number]))
        self._put_window(np.zeros(2, np.int64))

    def _make_points(self, cloud: PointCloud, places: NDArray, body: Body, density: float) -> Points:
        velocity = body.initial_velocity(cloud.positions[places])
        x, y = (cloud.positions[places] - self.lattice.origin).T / self.lattice.h
        size_x, size_y = cloud.size[places].T / self.lattice.h
        volume, one = cloud.volume[places], np.ones(len(places))
        (cxx, cxy), (cyx, cyy) = body.velocity_gradient
        return Points.of({
            "number": places, "x": x, "y": y, "vx": velocity[:, 0], "vy": velocity[:, 1], "mass": density * volume,
            "volume": volume, "size_x": size_x, "size_y": size_y, "c": one, "g": one, "broken_at": np.nan * one,
            "cxx": cxx * one, "cxy": cxy * one, "cyx": cyx * one, "cyy": cyy * one,
        })  # fmt: skip

    # ---------------------------------------------------------------- window

    def sort(self) -> None:
        """Put the window around the points and sort them by columns of cells; list the strips."""
        before = self.window
        self._put_window(before.corner)
        self.window.remember(before)

    def _put_window(self, corner: NDArray) -> None:
        """The same for points whose places are given from a corner (2,) of the lattice."""
        points, order_of_splines = self.points, self.lattice.order
        x, y = points.motion.x, points.motion.y
        cells = np.array([np.floor(x), np.floor(y)]).astype(np.int64) + corner[:, None]
        lower, upper = cells.min(axis=1) - MARGIN, cells.max(axis=1) + MARGIN
        shape = upper - lower + 1 + order_of_splines
        if np.prod(shape.astype(float)) > MOST_NODES:
            raise BlewUpError(
                f"the points of body '{self.name}' are spread over {shape[0]} x {shape[1]} nodes, more than there is room"
                " for; shorten dynamics.end_time, or enlarge mesh.h"
            )
        x += corner[0] - lower[0]
        y += corner[1] - lower[1]
        local = cells - lower[:, None]
        cell = local[0] * int(shape[1]) + local[1]
        # one key in place of three: nearly in order since the last time, which this way of sorting makes use of
        points.reorder(np.argsort(cell * (points.number.max() + 1) + points.number, kind="stable"))
        starts = np.append(0, np.cumsum(np.bincount(cell, minlength=int(np.prod(shape)))))
        self.window = GridWindow.over(lower, shape, starts)
        self.wandering = Wandering(0.0, self.points.largest_speed(), np.zeros(len(self.window.strips) - 1))

    def keep_sorted(self, step: float) -> None:
        """Sort anew before any point can wander more than a cell from where it was sorted."""
        move = step / self.lattice.h * self.wandering.largest_speed
        if not move <= DRIFT:
            raise BlewUpError(
                f"a point of body '{self.name}' moves {move:.2g} cells in one step of {step:.4g}; the step is"
                " above the stability limit or the body is too fast for the grid"
            )
        # it may be half as fast again after this step; points are not looked for before they are sorted once more
        if self.wandering.far + 1.5 * move > DRIFT:
            self.sort()

    # ---------------------------------------------------------------- a step

    def map_to_grid(self) -> None:
        """Mass, momentum and minus internal forces to the nodes."""
        window, points = self.window, self.points
        self.transfers.to_grid(
            window.strips, points.motion, points.matter, points.gradient, points.elastic, self.lattice.h,
            float(self._dynamics.affine), window.width, window.sums,
        )  # fmt: skip

    def find_trial_velocities(self, step: float, acceleration: NDArray, damping: float) -> None:
        """Velocities of the nodes before the step and without contact after it.

        acceleration : (2,) of all free bodies [length/time²]. damping : rate at which velocities fall [1/time].
        """
        window, velocities = self.window, self.window.velocities
        x, y = (float(a) for a in acceleration)
        trial_velocities(window.width, step, x, y, damping, window.sums, velocities)

    def update_points(self, step: float) -> None:
        """Velocities of the points."""
        self._to_points(step, with_velocities=True, with_strains=False)

    def update_all(self, step: float) -> None:
        """`update_points` and `update_stresses` in one pass, for strains from the same velocities of the nodes (USL)."""
        self._to_points(step, with_velocities=True, with_strains=True)

    def update_stresses(self, step: float) -> None:
        """Strains from the nodes' velocities, new places, and stresses."""
        self._to_points(step, with_velocities=False, with_strains=True)

    def _to_points(self, step: float, with_velocities: bool, with_strains: bool) -> None:
        points, dynamics, wandering, h = self.points, self._dynamics, self.wandering, self.lattice.h
        update = PointUpdate(
            step / h, dynamics.flip, dynamics.rotation == "corotational", (dynamics.affine or self.has_axes) / h,
            with_velocities, with_strains, not self.breakable, self.law.lam, self.law.mu, *self.lag,
        )  # fmt: skip
        self.transfers.to_points(
            self.window.strips, self.window.velocities, self.window.width, update, points.motion, points.gradient,
            points.elastic, wandering.fastest,
        )  # fmt: skip
        if with_velocities:
            wandering.largest_speed = float(np.sqrt(wandering.fastest.max()))
            wandering.far += step / h * wandering.largest_speed
        if with_strains and self.has_axes:
            points.turn_axes(step, h)
        if with_strains and self.breakable:
            self.evaluate_stresses()

    def map_momentum_again(self) -> None:
        """Velocities of the nodes from those of the points after the step (MUSL)."""
        sums, velocities = self.window.sums, self.window.velocities
        self.map_to_grid()
        over = np.divide(1.0, sums.m, out=np.zeros_like(sums.m), where=sums.m > 0.0)
        np.multiply(sums.fields[0::4], over, out=velocities.vx)
        np.multiply(sums.fields[1::4], over, out=velocities.vy)
        velocities.last_x[:], velocities.last_y[:] = velocities.vx, velocities.vy

    def evaluate_stresses(self) -> None:
        """Stresses, and energy densities where the body can break, from the strains and the phase field."""
        strips, elastic, crack = self.window.strips, self.points.elastic, self.points.crack
        if self.breakable:
            self._degraded_stresses(strips, self.law, elastic, crack)
            np.maximum(crack.history if self._irreversible else 0.0, crack.psi_plus, out=crack.history)
        else:
            elastic_stresses(strips, self.law, elastic)

    # ---------------------------------------------------------------- what can be seen

    def positions(self) -> NDArray:
        """Places (n, 2) of the points, in their present order [length]."""
        local = np.column_stack([self.points.motion.x, self.points.motion.y]) + self.window.corner
        return self.lattice.origin + self.lattice.h * local

    def energy_density(self) -> NDArray:
        """Elastic energy density (n,) [stress]."""
        e, crack = self.points.elastic, self.points.crack
        if self.breakable:
            return crack.g * crack.psi_plus + crack.psi_minus
        return 0.5 * (e.sxx * e.exx + e.syy * e.eyy + e.sxy * e.gxy)

    def whole_motion(self) -> BodyMotion:
        """Its present motion as a whole."""
        return BodyMotion.of_points(self.window, self.lattice, self.points)

    def carried(self) -> Carried:
        """What it carries over this step, when contact is done."""
        mass, before_x, before_y, x, y, damped = carried(self.window.sums.m, self.window.velocities)
        return Carried(mass, np.array([before_x, before_y]), np.array([x, y]), damped)

    def work_on_nodes(self) -> float:
        """Of all forces in this step, when contact is done [energy]."""
        return float(work_on_nodes(self.window.sums.m, self.window.velocities))

    def checkpoint(self) -> dict[str, NDArray]:
        """Everything that the next step needs, in the points' present order."""
        window, wandering = self.window, self.wandering
        return self.points.arrays() | {
            "corner": window.corner, "shape": window.shape, "starts": window.starts,
            "last": np.array([window.velocities.last_x, window.velocities.last_y]),
            "wandered": np.array([wandering.far, wandering.largest_speed]),
        }  # fmt: skip

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to a checkpoint."""
        self.points = Points.of(saved)
        self.window = GridWindow.over(saved["corner"], saved["shape"], saved["starts"])
        self.window.velocities.last_x[:], self.window.velocities.last_y[:] = saved["last"]
        far, largest_speed = map(float, saved["wandered"])
        self.wandering = Wandering(far, largest_speed, np.zeros(len(self.window.strips) - 1))
