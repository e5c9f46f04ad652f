"""Where bodies of different elastic laws are welded together: strain jumps across their seams."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from cases.geometry import SAME_LINE

if TYPE_CHECKING:
    from cases.schema import CaseDescription


class Seam(NamedTuple):
    """Names of two bodies, and the stretches (n, 2, 2) along which they touch, from start to end [length]."""

    one: str
    other: str
    stretches: NDArray


def seams(case: CaseDescription) -> Iterator[Seam]:
    """Of each two bodies of a case at rest that touch and have other elastic laws."""
    slack = SAME_LINE * case.mesh.h
    shapes = dict(zip(case.bodies, case.outlines(), strict=True))
    for (one, shape), (other, beside) in combinations(shapes.items(), 2):
        if _law(case, one) == _law(case, other) or not shapely.dwithin(shape, beside, slack):
            continue
        parts = shapely.get_parts(shape.boundary.intersection(beside.buffer(slack)))
        corners = [shapely.get_coordinates(part) for part in parts if part.length > 8.0 * slack]
        stretches = [np.stack([c[:-1], c[1:]], axis=1) for c in corners]
        if stretches:
            yield Seam(one, other, np.concatenate(stretches))


def _law(case: CaseDescription, name: str) -> tuple[object, ...]:
    """What the stress in a body follows: its elastic constants, and the eigenstrains on it."""
    material = case.materials[case.bodies[name].material]
    constants = material.model_dump_json(exclude={"fracture", "density", "expansion"})
    acting = [number for number, item in enumerate(case.eigenstrains) if item.on in (None, name)]
    warm = any(case.eigenstrains[number].temperature for number in acting)
    return constants, tuple(acting), material.expansion if warm else None
