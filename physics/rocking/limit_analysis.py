"""Limit analysis of blocks without tension: the factor of horizontal load that makes them a mechanism, and its hinges.

Static theorem (Heyman 1966; Livesley 1978): of all forces in the joints that are in equilibrium with the weights and a
horizontal load in proportion to them, and that neither pull nor slide, the largest load is the collapse load. A joint
carries a normal force at each of its two ends and a shear force, so that all is linear.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import csr_matrix, lil_matrix

from cases import geometry

#: blocks that are the ground
GROUND = -1


@dataclass(frozen=True)
class Joint:
    """The joint between two blocks, from one end of it to the other [length]; ``normal`` points into the second block."""

    first: int
    second: int
    ends: tuple[tuple[float, float], tuple[float, float]]
    name: str = ""

    @property
    def normal(self) -> NDArray:
        """Unit vector (2,) to the left of the direction from one end to the other."""
        along = np.subtract(self.ends[1], self.ends[0]) / math.dist(*self.ends)
        return np.array([-along[1], along[0]])


@dataclass(frozen=True)
class Collapse:
    """The mechanism.

    Attributes
    ----------
    factor : horizontal over vertical load at collapse; minus infinity where the weights alone cannot stand.
    hinges : names of the joints that open, each with its end that stays closed (0 or 1).
    """

    factor: float
    hinges: list[tuple[str, int]]


def collapse(centres: NDArray, weights: NDArray, joints: list[Joint], friction: float = math.inf) -> Collapse:
    """Collapse of blocks under their weights and a horizontal load in proportion to them.

    Parameters
    ----------
    centres : (n, 2) of the blocks [length]. weights : (n,) [force], downwards; the load acts towards +x.
    friction : Coulomb's coefficient of all joints; without, they do not slide.
    """
    n, m = len(weights), len(joints)
    balance = lil_matrix((3 * n, 3 * m + 1))
    for number, joint in enumerate(joints):
        along = np.array([joint.normal[1], -joint.normal[0]])
        for column, place, direction in (
            (3 * number, joint.ends[0], joint.normal),
            (3 * number + 1, joint.ends[1], joint.normal),
            (3 * number + 2, joint.ends[0], along),
        ):
            for block, sign in ((joint.second, 1.0), (joint.first, -1.0)):
                if block != GROUND:
                    lever = np.subtract(place, centres[block])
                    turning = lever[0] * direction[1] - lever[1] * direction[0]
                    for row, value in enumerate((*direction, turning)):
                        balance[3 * block + row, column] += sign * value
    balance[0::3, 3 * m] = weights[:, None]
    load = np.zeros(3 * n)
    load[1::3] = weights
    bounds = [(0.0, None), (0.0, None), (None, None)] * m + [(None, None)]
    objective = np.zeros(3 * m + 1)
    objective[-1] = -1.0
    # all as one mapping: scipy's stubs know no sparse matrices here
    given: dict[str, Any] = {"A_eq": balance.tocsr(), "b_eq": load, "bounds": bounds, "method": "highs-ds"}
    if friction < math.inf:
        given |= {"A_ub": _friction_cones(m, friction), "b_ub": np.zeros(2 * m)}
    found = linprog(objective, **given)
    if not found.success:
        return Collapse(-math.inf, [])
    return Collapse(float(found.x[-1]), _hinges(joints, found.x, float(weights.sum())))


def _friction_cones(number: int, friction: float) -> csr_matrix:
    """|shear| <= friction times the normal force, of all joints."""
    rows = lil_matrix((2 * number, 3 * number + 1))
    for joint in range(number):
        for side, sign in enumerate((1.0, -1.0)):
            for column, value in enumerate((-friction, -friction, sign)):
                rows[2 * joint + side, 3 * joint + column] = value
    return rows.tocsr()


def _hinges(joints: list[Joint], forces: NDArray, scale: float) -> list[tuple[str, int]]:
    """Joints whose thrust stands on one of their ends."""
    hinges = []
    for number, joint in enumerate(joints):
        pair = forces[3 * number : 3 * number + 2] / scale
        if pair.min() < 1e-9 < pair.max():
            hinges.append((joint.name, int(pair.argmax())))
    return hinges


@dataclass(frozen=True)
class Arch:
    """A circular vault on two buttresses of rectangular section [length].

    ``radius`` is that of the intrados, ``half_angle`` [degrees] from the crown to a springing; a buttress begins at the
    intrados; without ``buttress_height`` the vault springs from the ground.
    """

    radius: float
    half_angle: float
    thickness: float
    buttress_width: float = 0.0
    buttress_height: float = 0.0
    voussoirs: int = 134

    @classmethod
    def of_shape(cls, shape: geometry.Arch) -> Arch:
        """That of a body of a case."""
        return cls(shape.radius, shape.half_angle, shape.thickness, shape.buttress_width, shape.buttress_height)

    def collapse(self, friction: float = math.inf) -> Collapse:
        """The collapse under its own weight and a horizontal load towards +x; joints are named by their angle [degrees]
        from the crown, those under the buttresses "left base" and "right base"."""
        centres, weights, joints = self._vault()
        if self.buttress_height:
            self._put_on_buttresses(centres, weights, joints)
        return collapse(np.array(centres), np.array(weights), joints, friction)

    def _point(self, angle: float, radius: float) -> tuple[float, float]:
        return radius * math.sin(angle), radius * math.cos(angle)

    def _vault(self) -> tuple[list, list, list]:
        outer, half = self.radius + self.thickness, math.radians(self.half_angle)
        angles = np.linspace(-half, half, self.voussoirs + 1)
        step = angles[1] - angles[0]
        area = 0.5 * step * (outer**2 - self.radius**2)
        # centre of gravity of a ring's sector
        middle = 2.0 / 3.0 * (outer**3 - self.radius**3) / (outer**2 - self.radius**2) * math.sin(step / 2) / (step / 2)
        centres = [self._point(angle, middle) for angle in 0.5 * (angles[1:] + angles[:-1])]
        joints = []
        for number, angle in enumerate(angles):
            first, second = number - 1, number if number < self.voussoirs else GROUND
            # the outer end first: the normal then points on along the vault
            ends = (self._point(angle, outer), self._point(angle, self.radius))
            joints.append(Joint(first, second, ends, f"{math.degrees(angle):.1f}"))
        return centres, [area] * self.voussoirs, joints

    def _put_on_buttresses(self, centres: list, weights: list, joints: list) -> None:
        half = math.radians(self.half_angle)
        springing = self.radius * math.cos(half)
        width, height = self.buttress_width, self.buttress_height
        inner = self.radius * math.sin(half)
        for side, name in ((-1.0, "left base"), (1.0, "right base")):
            block = len(centres)
            centres.append((side * (inner + 0.5 * width), springing - 0.5 * height))
            weights.append(width * height)
            base = springing - height
            edges = sorted((side * inner, side * (inner + width)))
            joints.append(Joint(GROUND, block, ((edges[0], base), (edges[1], base)), name))
            place = 0 if side < 0 else self.voussoirs
            old = joints[place]
            first, second = (block, old.second) if side < 0 else (old.first, block)
            joints[place] = Joint(first, second, old.ends, old.name)
