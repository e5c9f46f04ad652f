"""The material points of one body that moves: named arrays in groups that compiled loops take as they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray


class Matter(NamedTuple):
    """What a point stands for: mass, volume, and its extent in cells."""

    mass: NDArray
    volume: NDArray
    size_x: NDArray
    size_y: NDArray


class PointMotion(NamedTuple):
    """Place in cells from the window's corner, velocity, and the velocity that carries the point."""

    x: NDArray
    y: NDArray
    vx: NDArray
    vy: NDArray
    moved_x: NDArray
    moved_y: NDArray


class VelocityGradient(NamedTuple):
    """Velocity gradient of the points where the map is affine [1/time]."""

    cxx: NDArray
    cxy: NDArray
    cyx: NDArray
    cyy: NDArray


class ElasticState(NamedTuple):
    """Elastic strain (engineering shear) in fixed axes and stress."""

    exx: NDArray
    eyy: NDArray
    gxy: NDArray
    sxx: NDArray
    syy: NDArray
    sxy: NDArray


class CrackState(NamedTuple):
    """What breaks a point and how far it is broken.

    ``c``, ``history`` and ``g`` are phase field, history field [stress] and degradation; ``psi_plus, psi_minus`` the
    energy densities before degradation [stress]; ``solved_for`` is the history field that the phase field was solved
    for, ``energy`` that of cracks in a unit volume [stress] and ``broken_at`` the time at which a point broke, or NaN.
    """

    c: NDArray
    history: NDArray
    g: NDArray
    psi_plus: NDArray
    psi_minus: NDArray
    solved_for: NDArray
    energy: NDArray
    broken_at: NDArray


class MaterialAxes(NamedTuple):
    """Where the fracture energy has a direction: how far the material has turned [radian], and in cells how far the point
    has moved since its phase field was found."""

    turn: NDArray
    stray_x: NDArray
    stray_y: NDArray


#: groups of `Points` by the names of its attributes
GROUPS: dict[str, Any] = {
    "matter": Matter, "motion": PointMotion, "gradient": VelocityGradient, "elastic": ElasticState,
    "crack": CrackState, "axes": MaterialAxes,
}  # fmt: skip


@dataclass
class Points:
    """Arrays over the points of a body, sorted by columns of cells; ``number`` is a point's place in the case's cloud."""

    number: NDArray
    matter: Matter
    motion: PointMotion
    gradient: VelocityGradient
    elastic: ElasticState
    crack: CrackState
    axes: MaterialAxes

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray]) -> Points:
        """Points from copies of their arrays by name; those that are not given are zero."""
        number = arrays["number"].copy()
        zero = np.zeros(len(number))
        groups = (kind(*(np.array(arrays.get(name, zero)) for name in kind._fields)) for kind in GROUPS.values())
        return cls(number, *groups)

    def arrays(self) -> dict[str, NDArray]:
        """All arrays by their names."""
        found = {"number": self.number}
        for group in GROUPS:
            found |= getattr(self, group)._asdict()
        return found

    def reorder(self, order: NDArray) -> None:
        """Put the points into an order (n,)."""
        self.number, spare = self.number[order], np.empty(len(order))
        for name, kind in GROUPS.items():
            arrays = []
            for values in getattr(self, name):
                # each array is written over the one before it: new ones would cost more than the sorting
                take(values, order, spare)
                arrays.append(spare)
                spare = values
            setattr(self, name, kind(*arrays))

    def largest_speed(self) -> float:
        """Of any point [length/time]."""
        return float(np.hypot(self.motion.vx, self.motion.vy).max())

    def turn_axes(self, step: float, h: float) -> None:
        """Count how far the material has turned and strayed, where its fracture energy has a direction."""
        motion, gradient, axes = self.motion, self.gradient, self.axes
        axes.turn[:] += 0.5 * step * (gradient.cyx - gradient.cxy)
        axes.stray_x[:] += step / h * motion.moved_x
        axes.stray_y[:] += step / h * motion.moved_y


@njit(cache=True, parallel=True)
def take(values, order, found):
    """found = values[order], by all threads."""
    for i in prange(len(order)):
        found[i] = values[order[i]]
