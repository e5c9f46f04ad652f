"""Curves that a page draws again for whoever moves over them: their numbers, thinned, beside the picture for print.

Drawn by a script of our own, ``templates/curves.js``, over SVG: it weighs a few kilobytes on each page, works offline and
by keyboard, and its lines have the colours and dashes of the picture. uPlot draws on a canvas, which neither prints nor
is read aloud, and Plotly brings megabytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

#: points of a line that a screen tells apart
MOST_POINTS = 500
_DASHES = {"-": (), "--": (6, 4), "-.": (8, 3, 2, 3), ":": (2, 3)}


@dataclass(frozen=True)
class Line:
    """A curve or, with ``points``, single points: its name, colour and dashes, and numbers x, y in the axes' units."""

    name: str
    colour: str
    dash: str
    x: list[float]
    y: list[float]
    points: bool = False


@dataclass(frozen=True)
class Curves:
    """Lines in one pair of axes with their labels."""

    title: str
    x: str
    y: str
    lines: Sequence[Line]

    def content(self) -> dict[str, Any]:
        """As the page's script reads it."""
        return asdict(self)


def line(name: str, colour: str, style: str | tuple[int, tuple[int, ...]], x: ArrayLike, y: ArrayLike) -> Line:
    """A line whose style matplotlib knows; rows that are no numbers are left out, and too many points thinned."""
    dash = _DASHES[style] if isinstance(style, str) else style[1]
    return Line(name, colour, " ".join(map(str, dash)), *_thinned(x, y))


def points(name: str, x: ArrayLike, y: ArrayLike) -> Line:
    """Black points, as published ones are drawn."""
    return Line(name, "#000000", "", *_thinned(x, y), points=True)


def _thinned(x: ArrayLike, y: ArrayLike) -> tuple[list[float], list[float]]:
    pairs = np.column_stack([np.asarray(x, dtype=float), np.asarray(y, dtype=float)])
    pairs = pairs[np.isfinite(pairs).all(axis=1)]
    if len(pairs) > MOST_POINTS:
        # ends and largest values are among those that stay
        even = np.linspace(0, len(pairs) - 1, MOST_POINTS - 2).round().astype(int)
        pairs = pairs[np.unique([*even, pairs[:, 1].argmax(), pairs[:, 1].argmin()])]
    return [float(f"{value:.6g}") for value in pairs[:, 0]], [float(f"{value:.6g}") for value in pairs[:, 1]]
