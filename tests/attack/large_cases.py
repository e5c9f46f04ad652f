"""Cases that are large on purpose: many runs, many bodies, many corners, deep shapes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

Tables = dict[str, Any]


def _square(**changes: Any) -> Tables:
    """A plate of 100 x 100 mm without fracture, with other tables."""
    return {
        "title": "Large",
        "requirement": "It is checked in a moment.",
        "units": {"length": "mm", "force": "kN"},
        "plane": {"assumption": "strain"},
        "materials": {"steel": {"young": 210.0, "poisson": 0.3}},
        "bodies": {"plate": {"material": "steel", "shape": _rectangle(0, 0, 100, 100)}},
        "constraints": [
            {"on": "bottom", "direction": "y", "value": 0},
            {"on": "left", "direction": "x", "value": 0},
            {"on": "top", "direction": "y", "scale": 1},
        ],
        "load": {"path": [0.0, 0.1], "increment": 0.05},
        "mesh": {"h": 5.0},
        "runs": {"fem": {"solver": "fem"}, "mpm": {"solver": "mpm"}},
    } | changes


def _rectangle(x: float, y: float, right: float, top: float) -> Tables:
    return {"rectangle": {"lower": [x, y], "upper": [right, top]}}


def _one_body(shape: Tables) -> Tables:
    return _square(bodies={"plate": {"material": "steel", "shape": shape}})


def sweep(members: int = 400) -> Tables:
    """A sweep over the load."""
    values = [0.1 * (n + 1) / members for n in range(members)]
    return _square(runs={"fem": {"solver": "fem", "sweep": {"load.increment": values}}})


def holes(number: int = 500) -> Tables:
    """A plate with round holes and both solvers."""
    side = math.ceil(math.sqrt(number))
    step = 100.0 / side
    centres = [[step * (n % side + 0.5), step * (n // side + 0.5)] for n in range(number)]
    discs = [{"disc": {"centre": centre, "radius": 0.3 * step}} for centre in centres]
    return _one_body({"difference": {"of": _rectangle(0, 0, 100, 100), "minus": discs}})


def bodies(number: int = 2000) -> Tables:
    """Small plates side by side."""
    side = math.ceil(math.sqrt(number))
    step = 100.0 / side
    made = {}
    for n in range(number):
        x, y = step * (n % side), step * (n // side)
        made[f"b{n}"] = {"material": "steel", "shape": _rectangle(x, y, x + 0.9 * step, y + 0.9 * step)}
    return _square(bodies=made)


def corners(number: int = 50_000) -> Tables:
    """A polygon around a wavy circle."""
    angles = [2.0 * math.pi * n / number for n in range(number)]
    radii = [50.0 + math.sin(40.0 * angle) for angle in angles]
    points = [[r * math.cos(angle), r * math.sin(angle)] for r, angle in zip(radii, angles, strict=True)]
    return _one_body({"polygon": {"points": points}})


def nested(depth: int = 60) -> Tables:
    """A difference of a difference of a difference."""
    shape = _rectangle(0, 0, 100, 100)
    for n in range(depth):
        disc = {"disc": {"centre": [2.0 + 1.5 * n, 50.0], "radius": 0.5}}
        shape = {"difference": {"of": shape, "minus": [disc]}}
    return _one_body(shape)


LARGE: dict[str, Callable[[], Tables]] = {
    "400 members of a sweep": sweep,
    "200 holes": lambda: holes(200),
    "500 holes": holes,
    "2000 bodies": bodies,
    "a polygon of 50000 corners": corners,
    "60 nested differences": nested,
}
