"""A small picture of curves for notebooks: SVG of a few lines, without a drawing library."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

import numpy as np
from numpy.typing import ArrayLike

WIDTH, HEIGHT, MARGIN = 420, 220, 12
#: Okabe and Ito's colours, and dashes beside them
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_DASHES = ("", "6 4", "8 3 2 3", "2 3", "10 3", "4 2")


def sketch(curves: Mapping[str, tuple[ArrayLike, ArrayLike]], x: str, y: str) -> str:
    """Curves by their names, pairs of numbers along x and y, as an SVG element; empty without any."""
    pairs = {name: _finite(*xy) for name, xy in curves.items()}
    pairs = {name: points for name, points in pairs.items() if len(points) > 1}
    if not pairs:
        return ""
    together = np.concatenate([*pairs.values(), [[0.0, 0.0]]])
    low, span = together.min(axis=0), np.ptp(together, axis=0)
    size = np.array([WIDTH - 2 * MARGIN, HEIGHT - 2 * MARGIN]) / np.where(span > 0.0, span, 1.0)
    lines = [_line(number, MARGIN + (points - low) * size) for number, points in enumerate(pairs.values())]
    names = ", ".join(
        f'<tspan fill="{_COLOURS[number % len(_COLOURS)]}">{escape(name)}</tspan>' for number, name in enumerate(pairs)
    )
    label = f"{escape(y)} over {escape(x)}, up to {together[:, 0].max():.4g} and {together[:, 1].max():.4g}: {names}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT + 24}" role="img">'
        f'{"".join(lines)}<text x="{MARGIN}" y="{HEIGHT + 16}" font-size="12">{label}</text></svg>'
    )


def _finite(x: ArrayLike, y: ArrayLike) -> np.ndarray:
    points = np.column_stack([np.asarray(x, dtype=float), np.asarray(y, dtype=float)])
    return points[np.isfinite(points).all(axis=1)]


def _line(number: int, places: np.ndarray) -> str:
    points = " ".join(f"{a:.1f},{HEIGHT - b:.1f}" for a, b in places)
    style = f'stroke="{_COLOURS[number % len(_COLOURS)]}" stroke-dasharray="{_DASHES[number % len(_DASHES)]}"'
    return f'<polyline points="{points}" fill="none" stroke-width="1.5" {style}/>'
