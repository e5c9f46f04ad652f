"""The scheme of ``taichi_elastic.py`` in Taichi: FLIP, quadratic splines, linear elasticity, small strains summed up."""

import time
from typing import TYPE_CHECKING

import numpy as np
import taichi as ti

if TYPE_CHECKING:
    from mpm.explicit.moving_body import MovingBody


@ti.func
def values(xi):
    """Quadratic splines of a cell at xi in [0, 1)."""
    return ti.Vector([0.5 * (1.0 - xi) * (1.0 - xi), 0.5 + xi * (1.0 - xi), 0.5 * xi * xi])


@ti.func
def slopes(xi):
    """Their slopes for cells of size one."""
    return ti.Vector([xi - 1.0, 1.0 - 2.0 * xi, xi])


@ti.func
def basis(x):
    """First node of the cell around a place, and the splines and their slopes along both axes."""
    corner = ti.cast(x, ti.i32)
    xi = x - corner
    return corner, values(xi[0]), values(xi[1]), slopes(xi[0]), slopes(xi[1])


@ti.data_oriented
class TaichiBody:
    """Points and nodes of a body as fields of Taichi.

    Points are in the order in which ``load`` finds them; ``coloured`` chooses how they add to the nodes: strips of one
    colour at once and points of a strip in turn, or all points at once by atomic additions. Arrays are named as the
    body's, vectors for their components.
    """

    def __init__(self, body: "MovingBody", coloured: bool) -> None:
        n, nodes = len(body.points.number), tuple(int(size) for size in body.window.shape)
        self.coloured, self.n_strips = coloured, len(body.window.strips) - 1
        self.h, self.lam, self.mu = body.lattice.h, body.law.lam, body.law.mu
        self.x, self.v = (ti.Vector.field(2, ti.f64, n) for _ in range(2))
        self.strain, self.stress = (ti.Vector.field(3, ti.f64, n) for _ in range(2))
        self.mass, self.volume = (ti.field(ti.f64, n) for _ in range(2))
        self.strips = ti.field(ti.i32, self.n_strips + 1)
        self.grid_m = ti.field(ti.f64, nodes)
        self.grid_p, self.grid_f, self.grid_v, self.grid_dv = (ti.Vector.field(2, ti.f64, nodes) for _ in range(4))

    def load(self, body: "MovingBody") -> None:
        """Take over the state of a body that has just been sorted."""
        p, motion, elastic = body.points, body.points.motion, body.points.elastic
        self.number = p.number.copy()
        self.strips.from_numpy(body.window.strips.astype(np.int32))
        self.mass.from_numpy(p.matter.mass)
        self.volume.from_numpy(p.matter.volume)
        self.x.from_numpy(np.column_stack([motion.x, motion.y]))
        self.v.from_numpy(np.column_stack([motion.vx, motion.vy]))
        self.strain.from_numpy(np.column_stack([elastic.exx, elastic.eyy, elastic.gxy]))
        self.stress.from_numpy(np.column_stack([elastic.sxx, elastic.syy, elastic.sxy]))

    def compile(self, size: float) -> None:
        """Compile every kernel by a first step."""
        started = time.perf_counter()
        self.step(size)
        ti.sync()
        self.compile_seconds = time.perf_counter() - started

    def velocities(self) -> np.ndarray:
        """Of the points (n, 2), by their numbers."""
        found = np.empty((len(self.number), 2))
        found[self.number] = self.v.to_numpy()
        return found

    def step(self, size: float) -> None:
        """Points to nodes, nodes, nodes to points."""
        self.clear()
        if self.coloured:
            self.to_grid_in_strips(0)
            self.to_grid_in_strips(1)
        else:
            self.to_grid()
        self.move_nodes(size)
        self.to_points(size)

    @ti.kernel
    def clear(self):
        for node in ti.grouped(self.grid_m):
            self.grid_m[node] = 0.0
            self.grid_p[node] = ti.Vector([0.0, 0.0])
            self.grid_f[node] = ti.Vector([0.0, 0.0])

    @ti.kernel
    def to_grid(self):
        for p in self.x:
            corner, wx, wy, dx, dy = basis(self.x[p])
            s = self.stress[p] * (self.volume[p] / self.h)
            for a, b in ti.static(ti.ndrange(3, 3)):
                node = corner + ti.Vector([a, b])
                w, gx, gy = wx[a] * wy[b], dx[a] * wy[b], wx[a] * dy[b]
                self.grid_m[node] += w * self.mass[p]
                self.grid_p[node] += w * self.mass[p] * self.v[p]
                self.grid_f[node] += -ti.Vector([s[0] * gx + s[2] * gy, s[2] * gx + s[1] * gy])

    @ti.kernel
    def to_grid_in_strips(self, colour: ti.i32):
        ti.loop_config(block_dim=1)
        for half in range((self.n_strips + 1 - colour) // 2):
            strip = 2 * half + colour
            for p in range(self.strips[strip], self.strips[strip + 1]):
                corner, wx, wy, dx, dy = basis(self.x[p])
                s = self.stress[p] * (self.volume[p] / self.h)
                for a, b in ti.static(ti.ndrange(3, 3)):
                    node = corner + ti.Vector([a, b])
                    w, gx, gy = wx[a] * wy[b], dx[a] * wy[b], wx[a] * dy[b]
                    # an assignment: += would be atomic
                    self.grid_m[node] = self.grid_m[node] + w * self.mass[p]
                    self.grid_p[node] = self.grid_p[node] + w * self.mass[p] * self.v[p]
                    force = ti.Vector([s[0] * gx + s[2] * gy, s[2] * gx + s[1] * gy])
                    self.grid_f[node] = self.grid_f[node] - force

    @ti.kernel
    def move_nodes(self, size: ti.f64):
        for node in ti.grouped(self.grid_m):
            m = self.grid_m[node]
            if m > 0.0:
                self.grid_dv[node] = size * self.grid_f[node] / m
                self.grid_v[node] = self.grid_p[node] / m + self.grid_dv[node]

    @ti.kernel
    def to_points(self, size: ti.f64):
        for p in self.x:
            corner, wx, wy, dx, dy = basis(self.x[p])
            u, change = ti.Vector([0.0, 0.0]), ti.Vector([0.0, 0.0])
            along_x, along_y = ti.Vector([0.0, 0.0]), ti.Vector([0.0, 0.0])
            for a, b in ti.static(ti.ndrange(3, 3)):
                node = corner + ti.Vector([a, b])
                v = self.grid_v[node]
                u += wx[a] * wy[b] * v
                change += wx[a] * wy[b] * self.grid_dv[node]
                along_x += dx[a] * wy[b] * v
                along_y += wx[a] * dy[b] * v
            self.v[p] += change
            self.x[p] += size / self.h * u
            strain = self.strain[p]
            strain += size / self.h * ti.Vector([along_x[0], along_y[1], along_x[1] + along_y[0]])
            self.strain[p] = strain
            pressure = self.lam * (strain[0] + strain[1])
            self.stress[p] = ti.Vector(
                [pressure + 2.0 * self.mu * strain[0], pressure + 2.0 * self.mu * strain[1], self.mu * strain[2]]
            )
