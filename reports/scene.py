"""The picture of a case: bodies, notches, boundary conditions, dimensions, close-ups of mesh and points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from cases.loads import Acting, Traction
from cases.solvers import SOLVERS
from cases.spacing import grid_lines

from . import style
from .outlines import body_polygons, cells_in, draw_notches, draw_outlines, polygon_patch
from .words import listed, number, plural

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

    from cases import Case
    from cases.geometry import Box
    from cases.loading import Constraint

    from .results import CaseResults, RunResults

FIXED, MOVED, PRESCRIBED_PHASE, TIED = style.INK, style.OKABE_ITO[1], style.OKABE_ITO[3], style.OKABE_ITO[2]
BODY_TINTS = ("#dde6ee", "#f3e6d3", "#dcebe1", "#eee0ea", "#e9e9e2")
SYMBOLS_ON_A_SIDE = 6
SAMPLES_ON_A_RING = 1200
CELLS_IN_A_CLOSE_UP = 12
AXES_OF = {"x": np.array([1.0, 0.0]), "y": np.array([0.0, 1.0])}


# ---------------------------------------------------------------- what acts on the bodies


def conditions(case: Case) -> dict[str, list[Constraint | Traction]]:
    """Return the constraints and tractions on each boundary set that has any."""
    found: dict[str, list[Constraint | Traction]] = {}
    for constraint in case.constraints:
        found.setdefault(constraint.on, []).append(constraint)
    for traction in case.tractions:
        found.setdefault(traction.on, []).append(traction)
    return found


def condition_in_words(condition: Constraint | Traction, case: Case, mathematics: bool = False) -> str:
    """Return a condition as text: ``u_y = u``, ``v_x = 2 mm/ms``, ``u_x tied``, ``c = 0``, ``traction (0, 1) kN/mm²``."""
    if isinstance(condition, Traction):
        unit = case.units.label("stress")
        if condition.pressure is not None:
            return f"pressure {number(condition.pressure)} {unit}{_ramp_in_words(condition, case, mathematics)}"
        return f"traction {_pair(condition.value)} {unit}{_ramp_in_words(condition, case, mathematics)}"
    if condition.motion is not None:
        return f"u from the exact field {condition.motion}".replace("_", " ")
    letter = "u" if condition.velocity is None and condition.of == "displacement" else "v"
    name = "c" if condition.direction == "phase" else f"{letter}_{condition.direction}"
    name = f"${name}$" if mathematics else name
    if condition.tied:
        return f"{name} tied"
    if condition.course is not None:
        return f"{name} from a table over {'time' if case.dynamics else '$u$' if mathematics else 'u'}"
    if condition.velocity is not None:
        return f"{name} = {number(condition.velocity)} {case.units.label('velocity')}"
    if condition.scale is not None:
        factor = {1.0: "", -1.0: "−"}.get(condition.scale, f"{number(condition.scale)} ")
        return f"{name} = {factor}{'$u$' if mathematics else 'u'}"
    return f"{name} = {number(condition.value)}"


def _ramp_in_words(acting: Acting, case: Case, mathematics: bool = False) -> str:
    if acting.follows_load:
        return " × $u$" if mathematics else " × u"
    return f" over {number(acting.ramp)} {case.units.label('time')}" if acting.ramp else ""


def gravity_in_words(case: Case) -> str:
    """Return gravity as text, empty without."""
    gravity = case.dynamics.gravity if case.dynamics else (0.0, 0.0)
    return f"gravity {_pair(gravity)} {case.units.label('acceleration')}" if any(gravity) else ""


def on_volume(case: Case) -> list[tuple[str, str, Any]]:
    """Return of all that acts on the volume of bodies the body, words, and the direction where it has one."""
    units = case.units
    found: list[tuple[str, str, Any]] = []
    if case.dynamics and any(case.dynamics.gravity):
        found.append(("all bodies", gravity_in_words(case), case.dynamics.gravity))
    for force in case.body_forces:
        words = f"gravity {_pair(force.gravity)} {units.label('acceleration')}" if force.gravity else (
            f"force {_pair(force.value)} {units.label('force_density')}")  # fmt: skip
        found.append((force.on or "all bodies", words + _ramp_in_words(force, case), force.gravity or force.value))
    for strain in case.eigenstrains:
        words = f"temperature {strain.temperature:+g} K" if strain.value is None else (
            f"eigenstrain [{_pair(strain.value[0])}, {_pair(strain.value[1])}]")  # fmt: skip
        found.append((strain.on or "all bodies", words + _ramp_in_words(strain, case), None))
    return found


def velocity_in_words(case: Case, body: str) -> str:
    """Return how a body moves at the start as text, empty when it is at rest."""
    velocity, gradient = case.bodies[body].velocity, case.bodies[body].velocity_gradient
    said = [f"velocity {_pair(velocity)} {case.units.label('velocity')}"] if any(velocity) else []
    if np.any(gradient):
        said.append(f"velocity gradient [{_pair(gradient[0])}, {_pair(gradient[1])}] {case.units.label('rate')}")
    return ", ".join(said)


def place_in_words(case: Case, boundary: str) -> str:
    """Return where a boundary set lies."""
    chosen, unit = case.boundaries[boundary], case.units.label("length")
    if chosen.box:
        return f"box {_pair(chosen.box.lower)} to {_pair(chosen.box.upper)} {unit}"
    if chosen.point:
        return f"point {_pair(chosen.point)} {unit}"
    if chosen.circle:
        return f"circle around {_pair(chosen.circle.centre)}, radius {number(chosen.circle.radius)} {unit}"
    if chosen.segment:
        return f"segment from {_pair(chosen.segment[0])} to {_pair(chosen.segment[1])} {unit}"
    if chosen.group:
        return f"group {chosen.group} of {chosen.mesh.name if chosen.mesh else 'a mesh'}"
    return f"{listed(chosen.edges or [str(chosen.edge)])} of the bounding box"


def _pair(point: Any) -> str:
    return f"({number(point[0])}, {number(point[1])})"


def boundary_rows(case: Case) -> list[dict[str, str]]:
    """Return name, place and conditions of all that acts: boundary sets, forces and strains of bodies, velocities."""
    said = {name: ", ".join(condition_in_words(c, case) for c in acting) for name, acting in conditions(case).items()}
    rows = [(name, place_in_words(case, name), words) for name, words in said.items()]
    for body, words, _ in on_volume(case):
        name, _, rest = words.partition(" ")
        rows.append((name, body, rest))
    rows += [(body, "the body, at the start", velocity_in_words(case, body)) for body in case.bodies]
    return [dict(zip(("name", "place", "conditions"), row, strict=True)) for row in rows if row[2]]


# ---------------------------------------------------------------- where they act


@dataclass(frozen=True)
class Side:
    """A stretch of outline with one outward normal: places (n, 2) in order along it, normal (2,)."""

    places: np.ndarray
    normal: np.ndarray

    def spread(self, count: int = SYMBOLS_ON_A_SIDE) -> np.ndarray:
        """Return ``count`` places evenly along the side, its ends left free."""
        if len(self.places) <= 2:
            return self.places[:1]
        return self.places[np.linspace(0, len(self.places) - 1, 2 * count + 1).round().astype(int)[1::2]]

    @property
    def middle(self) -> np.ndarray:
        """The place halfway along."""
        return self.places[len(self.places) // 2]


def outline_samples(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Return places (n, 2) along the outlines of all bodies and their outward normals (n, 2)."""
    places, normals = [], []
    for body in case.bodies.values():
        for polygon in body_polygons(body):
            for outer, ring in [(True, polygon.exterior), *((False, hole) for hole in polygon.interiors)]:
                along = np.linspace(0.0, ring.length, SAMPLES_ON_A_RING, endpoint=False)
                points = np.array([ring.interpolate(s).coords[0] for s in along])
                chord = np.array([ring.interpolate(s + 1e-4 * ring.length).coords[0] for s in along]) - points
                chord /= np.maximum(np.hypot(*chord.T), 1e-300)[:, None]
                outward = 1.0 if ring.is_ccw == outer else -1.0
                places.append(points)
                normals.append(outward * np.column_stack([chord[:, 1], -chord[:, 0]]))
    return np.vstack(places), np.vstack(normals)


def sides_of(case: Case, boundary: str, samples: tuple[np.ndarray, np.ndarray]) -> list[Side]:
    """Return the stretches of outline that belong to a boundary set, one for each outward direction.

    A set that touches no outline (a point or a box inside a body) gives one place at its middle, a circle its top.
    """
    places, normals = samples
    lower, upper = case.bounding_box()
    chosen = case.boundaries[boundary]
    on_set = chosen.select(places, 2e-3 * float((upper - lower).max()), (lower, upper))
    if chosen.circle:
        top = np.array([chosen.circle.centre[0], chosen.circle.centre[1] + chosen.circle.radius])
        return [Side(top[None, :], np.array([0.0, 1.0]))]
    if chosen.point or not on_set.any():
        middle = _middle_of(case, boundary)
        outward = np.array([0.0, 1.0 if middle[1] >= (lower + upper)[1] / 2 else -1.0])
        return [Side(middle[None, :], outward)]
    directions = np.round(np.arctan2(normals[:, 1], normals[:, 0]) / (np.pi / 2)).astype(int) % 4
    sides = []
    for direction in np.unique(directions[on_set]):
        found = on_set & (directions == direction)
        if found.sum() < 0.06 * on_set.sum():
            continue  # the corner samples of a neighbouring edge
        normal = np.round([np.cos(direction * np.pi / 2), np.sin(direction * np.pi / 2)])
        order = np.argsort(places[found] @ np.array([-normal[1], normal[0]]))
        sides.append(Side(places[found][order], normal))
    return sides


def _middle_of(case: Case, boundary: str) -> np.ndarray:
    chosen = case.boundaries[boundary]
    if chosen.box:
        return (np.asarray(chosen.box.lower) + np.asarray(chosen.box.upper)) / 2
    if chosen.segment:
        return np.mean(chosen.segment, axis=0)
    if chosen.group:
        return np.ravel(chosen.geometry().centroid.coords[0])
    return np.asarray(chosen.circle.centre if chosen.circle else chosen.point, dtype=float)


# ---------------------------------------------------------------- drawing symbols


def _draw_boundary(axes: Any, case: Case, boundary: str, samples: Any, size: float) -> None:
    """Draw the set's place, its symbols and its label outside the body."""
    acting = conditions(case)[boundary]
    _draw_place(axes, case.boundaries[boundary])
    for condition in acting:
        if isinstance(condition, Traction) and condition.pressure:
            _draw_pressure(axes, case, boundary, samples, np.sign(condition.pressure) * size)
    words = ", ".join(condition_in_words(condition, case, mathematics=True) for condition in acting)
    for side in _area(case.boundaries[boundary].box, acting) or sides_of(case, boundary, samples):
        depth = _draw_symbols(axes, side, acting, size)
        place = side.middle + side.normal * (depth + 0.3) * size
        upright = abs(side.normal[0]) > 0.5
        across = "left" if side.normal[0] > 0 else "right"
        axes.text(
            *place, f"{boundary}: {words}", rotation=90 if upright else 0, fontsize=8.5, zorder=6,
            ha=across if upright else "center",
            va="center" if upright else "bottom" if side.normal[1] > 0 else "top",
        )  # fmt: skip


def _draw_pressure(axes: Any, case: Case, boundary: str, samples: Any, size: float) -> None:
    """Draw arrows against the edge from outside, or away from it for a negative size."""
    places, normals = samples
    (lower, upper), count = case.bounding_box(), 2 * SYMBOLS_ON_A_SIDE
    on_set = np.flatnonzero(case.boundaries[boundary].select(places, 2e-3 * float((upper - lower).max()), (lower, upper)))
    for index in on_set[np.linspace(0, len(on_set) - 1, 2 * count + 1).round().astype(int)[1::2]] if len(on_set) else ():
        away = 1.2 * abs(size) * normals[index]
        start, along = (places[index] + away, -away) if size > 0 else (places[index], away)
        _draw_arrow(axes, start, along)


def _area(box: Box | None, acting: list[Constraint | Traction]) -> list[Side]:
    """Return the top of a box with a prescribed phase field alone: it holds in the box, not on the outline there."""
    if box is None or box.is_flat or any(isinstance(c, Traction) or c.direction != "phase" for c in acting):
        return []
    top = np.array([(box.lower[0] + box.upper[0]) / 2, box.upper[1]])
    return [Side(top[None, :], np.array([0.0, 1.0]))]


def _draw_place(axes: Axes, chosen: Any) -> None:
    if chosen.box:
        corner, extent = np.asarray(chosen.box.lower), np.subtract(chosen.box.upper, chosen.box.lower)
        axes.add_patch(
            Rectangle(tuple(corner), *extent, fill=False, hatch="////", edgecolor=style.GREY, linewidth=0.6)
        )
    if chosen.circle:
        axes.add_patch(
            Circle(chosen.circle.centre, chosen.circle.radius, fill=False, edgecolor=MOVED, linewidth=1.2)
        )
    if chosen.segment:
        axes.plot(*np.transpose(chosen.segment), color=MOVED, linewidth=1.2)
    if chosen.point:
        axes.plot(*chosen.point, "o", color=style.INK, markersize=4, zorder=5)


def _draw_symbols(axes: Axes, side: Side, acting: list[Constraint | Traction], size: float) -> float:
    """Draw the symbols of one side; return how far they reach outwards, in symbol sizes."""
    constraints = [condition for condition in acting if not isinstance(condition, Traction)]
    fixed = [c.direction for c in constraints if c.value == 0 and c.direction in AXES_OF]
    depth = 0.0
    if any(c.direction == "phase" for c in constraints):
        axes.plot(*side.places.T, color=PRESCRIBED_PHASE, linewidth=3, linestyle=(0, (1, 1)), zorder=4)
    if len(fixed) == 2:
        depth = _draw_clamp(axes, side, size)
    elif fixed:
        depth = _draw_rollers(axes, side, AXES_OF[fixed[0]], size)
    for constraint in constraints:
        depth = max(depth, _draw_motion(axes, side, constraint, size, depth))
    tractions = [condition for condition in acting if isinstance(condition, Traction)]
    if any(traction.pressure for traction in tractions):
        depth = max(depth, 1.3)
    for traction in tractions:
        if traction.value is not None and any(traction.value):
            depth = max(depth, _draw_arrows(axes, side, _unit(traction.value), size, depth))
    return depth


def _unit(vector: Any) -> np.ndarray:
    return np.asarray(vector, float) / np.hypot(*vector)


def _draw_clamp(axes: Axes, side: Side, size: float) -> float:
    """Hatching: both displacements are zero."""
    places = side.spread(26) if len(side.places) > 2 else side.places
    tangent = np.array([-side.normal[1], side.normal[0]])
    tips = places + size * 0.45 * (side.normal - tangent)
    axes.plot(*side.places.T, color=FIXED, linewidth=1.8, zorder=4)
    axes.add_collection(LineCollection(list(np.stack([places, tips], axis=1)), colors=FIXED, linewidths=0.7))
    return 0.5


def _draw_rollers(axes: Axes, side: Side, direction: np.ndarray, size: float) -> float:
    """Triangles along the direction that is held: against the side, or beside it when it may open."""
    along_normal = abs(direction @ side.normal) > 0.5
    axis = side.normal if along_normal else direction
    across = np.array([-axis[1], axis[0]])
    start = 0.0 if along_normal else 0.55
    for place in side.spread(5):
        apex = place + side.normal * start * size - (0 if along_normal else 0.35) * axis * size
        base = apex + 0.6 * size * axis
        corners = np.array([apex, base + 0.32 * size * across, base - 0.32 * size * across])
        axes.fill(*corners.T, facecolor="white", edgecolor=FIXED, linewidth=0.8, zorder=4)
        ground = base + 0.14 * size * axis + np.outer([-0.42, 0.42], across) * size
        axes.plot(*ground.T, color=FIXED, linewidth=0.9, zorder=4)
    return 0.8 if along_normal else 1.0


def _draw_motion(axes: Axes, side: Side, constraint: Any, size: float, depth: float) -> float:
    """Draw load arrows, the bar of tied points or the dots of an exact field; return the depth reached."""
    if constraint.tied:
        bar = side.places[[0, -1]] + side.normal * (depth + 0.25) * size
        axes.plot(*bar.T, color=TIED, linewidth=2.5, solid_capstyle="butt", zorder=4)
        return depth + 0.35
    if constraint.motion is not None:
        axes.plot(*side.spread(12).T, "o", color=MOVED, markersize=3, zorder=4)
        return max(depth, 0.15)
    of_table = None if constraint.course is None else constraint.course.values[np.abs(constraint.course.values).argmax()]
    given = (constraint.scale, constraint.velocity, constraint.value, of_table)
    amount = next((a for a in given if a is not None), 0.0)
    if not amount or constraint.direction not in AXES_OF:
        return depth
    return _draw_arrows(axes, side, np.sign(amount) * AXES_OF[constraint.direction], size, depth)


def _draw_arrows(axes: Axes, side: Side, direction: np.ndarray, size: float, depth: float) -> float:
    outward = float(direction @ side.normal)
    length, gap = 1.5 * size, (depth + 0.15) * size
    room = np.inf if abs(outward) > 0.5 else float(np.ptp(side.places, axis=0).max()) / (1.3 * length)
    start = side.spread(int(np.clip(room, 1, 5))) + side.normal * (
        gap + (0.25 * size if abs(outward) < 0.5 else 0.0)
    )
    if outward < -0.5:
        start = start + side.normal * length  # pushing: the arrow ends at the side
    if abs(outward) < 0.5:
        start = start - direction * length / 2
    for place in start:
        _draw_arrow(axes, place, length * direction)
    return depth + (1.7 if abs(outward) > 0.5 else 0.65)


def _draw_arrow(axes: Axes, start: np.ndarray, along: np.ndarray) -> None:
    arrow = {"arrowstyle": "-|>,head_width=0.22,head_length=0.45", "color": MOVED, "lw": 1.3}
    axes.annotate("", tuple(start + along), tuple(start), arrowprops={**arrow, "shrinkA": 0, "shrinkB": 0}, zorder=5)


def _draw_on_volume(axes: Axes, case: Case, size: float) -> None:
    """Draw what acts on the bodies' volume above their left corner: words, and an arrow where it has a direction."""
    (left, _), (_, top) = case.bounding_box()
    for line, (body, words, direction) in enumerate(on_volume(case)):
        middle = np.array([left + size, top + (2.6 + 1.5 * line) * size])
        if direction is not None:
            along = 2.0 * size * _unit(direction)
            _draw_arrow(axes, middle - along / 2, along)
        said = words if body == "all bodies" else f"{body}: {words}"
        axes.text(middle[0] + 1.5 * size, middle[1], said, ha="left", va="center", fontsize=8.5, zorder=6)


# ---------------------------------------------------------------- drawing the body


def _draw_bodies(axes: Axes, case: Case, size: float) -> None:
    tints = dict(zip(case.materials, BODY_TINTS * len(case.materials), strict=False))
    for name, body in case.bodies.items():
        polygons = body_polygons(body)
        for polygon in polygons:
            look = {"facecolor": tints[body.material], "edgecolor": style.INK, "linewidth": 1.0}
            axes.add_patch(polygon_patch(polygon, zorder=1, **look))
        place = np.array(polygons[0].representative_point().coords[0])
        said = [f"{name}\n({body.material})"] if len(case.bodies) > 1 else []
        said += filter(None, [velocity_in_words(case, name).replace(", velocity", ",\nvelocity")])
        axes.text(place[0], place[1], "\n".join(said), ha="center", va="center", fontsize=8, zorder=6)
        if any(body.velocity):
            along = 2.0 * size * _unit(body.velocity)
            _draw_arrow(axes, place - [0.0, 2.6 * size] - along / 2, along)


def _draw_dimensions(axes: Axes, case: Case, size: float) -> None:
    """Draw width and height of the bounding box outside the labels, and the length of each notch."""
    (lower, upper), unit = case.bounding_box(), case.units.label("length")
    short = (upper - lower)[1] < 0.2 * (upper - lower)[0]
    below, left = lower[1] - 3.4 * size, lower[0] - 3.4 * size
    _dimension(axes, (lower[0], below), (upper[0], below), f"{number(upper[0] - lower[0])} {unit}")
    _dimension(axes, (left, lower[1]), (left, upper[1]), f"{number(upper[1] - lower[1])} {unit}", short)
    for notch in case.all_notches:
        start, end = np.asarray(notch.start, float), np.asarray(notch.end, float)
        length = np.hypot(*(end - start))
        width = f", {number(notch.width)} {unit} wide" if notch.kind == "cells" else ""
        angle = float(np.degrees(np.arctan2(*(end - start)[::-1]) + np.pi / 2) % 180 - 90)
        axes.annotate(
            f"notch ({notch.kind}) {number(length)} {unit}{width}", (start + end) / 2, xytext=(0, 5),
            textcoords="offset points", ha="center", va="bottom", fontsize=8, rotation=angle,
            rotation_mode="anchor", zorder=6,
            bbox={"facecolor": BODY_TINTS[0], "edgecolor": "none", "pad": 0.8},
        )  # fmt: skip


def _dimension(
    axes: Any, start: tuple[float, float], end: tuple[float, float], text: str, short: bool = False
) -> None:
    """Draw a dimension line with its text on it, or left of it where the line is too short to hold it."""
    head = "<->,head_width=0.15,head_length=0.35"
    arrow = {"arrowstyle": head, "color": style.GREY, "lw": 0.8, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops=arrow, annotation_clip=False)
    upright = start[0] == end[0]
    middle = (np.asarray(start) + np.asarray(end)) / 2
    axes.text(
        *middle, text, rotation=90 if upright and not short else 0, ha="right" if short else "center",
        va="center", fontsize=8.5, color="#3b4046",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5},
    )  # fmt: skip


# ---------------------------------------------------------------- close-ups


def close_up_window(case: Case) -> np.ndarray:
    """Return the corners (2, 2) of the close-ups: the notch's inner end, else the fine box."""
    lower, upper = case.bounding_box()
    half = min(CELLS_IN_A_CLOSE_UP / 2 * case.mesh.h, 0.6 * float((upper - lower).min()))
    if case.all_notches:
        ends = np.array([case.all_notches[0].start, case.all_notches[0].end], dtype=float)
        inside = np.minimum(ends - lower, upper - ends).min(axis=1)
        centre = ends[int(inside.argmax())]
    elif case.mesh.fine:
        centre = (np.asarray(case.mesh.fine.lower) + np.asarray(case.mesh.fine.upper)) / 2
    else:
        centre = (lower + upper) / 2
    return np.array([centre - half, centre + half])


def _draw_mesh_close_up(axes: Axes, run: RunResults, window: np.ndarray) -> None:
    grid = run.grid(float(run.stored[0]))
    corners = grid.points[grid.cells]
    near = corners[cells_in(window, corners)]
    colour = "#b9bec5" if run.method.by_points else style.OKABE_ITO[0]
    many = len(near) > style.RASTER_ABOVE
    axes.add_collection(
        PolyCollection(near, facecolors="none", edgecolors=colour, linewidths=0.7, rasterized=many)
    )


def _draw_points_close_up(axes: Axes, run: RunResults, window: np.ndarray) -> None:
    points = run.points(float(run.stored[0])).reference
    near = points[np.all((points >= window[0]) & (points <= window[1]), axis=1)]
    look: Any = {"markersize": 2.6, "markeredgewidth": 0, "color": style.OKABE_ITO[1]}
    axes.plot(*near.T, "o", rasterized=len(near) > style.RASTER_ABOVE, **look)


def _draw_planned_grid(axes: Axes, case: Case) -> None:
    x_lines, y_lines = grid_lines(case)
    axes.vlines(x_lines, y_lines[0], y_lines[-1], color=style.OKABE_ITO[0], linewidth=0.6)
    axes.hlines(y_lines, x_lines[0], x_lines[-1], color=style.OKABE_ITO[0], linewidth=0.6)


def _close_up(axes: Axes, results: CaseResults, case: Case, solver: str, window: np.ndarray) -> str:
    """Draw mesh, or grid and points, of the run of one solver; return its title."""
    runs = (run for run in results.main_runs(len(results.runs)) if run.method.name == solver)
    run = next((run for run in runs if run.stored.size), None)
    axes.set(xlim=window[:, 0], ylim=window[:, 1], aspect="equal", xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(True)
    draw_outlines(axes, case, notches=False)
    draw_notches(axes, case, widen=1.6)
    if run is None:
        _draw_planned_grid(axes, case)
        return "planned grid"
    _draw_mesh_close_up(axes, run, window)
    if run.method.by_points:
        _draw_points_close_up(axes, run, window)
    return run.method.shown


# ---------------------------------------------------------------- the figure


def _arrange(case: Case, close_ups: int) -> tuple[Figure, Axes, list[Axes]]:
    """Return the figure with the close-ups beside a compact body, below a long one."""
    lower, upper = case.bounding_box()
    width, height = upper - lower
    if height < 0.45 * width:
        figure = Figure(figsize=(8.4, 3.0 + 8.4 * (height / width + 0.25)), layout="constrained")
        grid = figure.add_gridspec(2, close_ups, height_ratios=[8.4 * (height / width + 0.25), 2.6])
        main, beside = grid[0, :], [grid[1, i] for i in range(close_ups)]
    else:
        figure = Figure(figsize=(8.4, 5.4), layout="constrained")
        grid = figure.add_gridspec(close_ups, 2, width_ratios=[2.1, 1.0])
        main, beside = grid[:, 0], [grid[i, 1] for i in range(close_ups)]
    return figure, figure.add_subplot(main), [figure.add_subplot(place) for place in beside]


def scene(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Draw the case; None when its description cannot be read."""
    case = results.case
    if case is None:
        return None
    solvers = list(dict.fromkeys(run.method.name for run in results.shown_runs() if run.stored.size)) or list(SOLVERS)[:1]
    figure, main, close_ups = _arrange(case, len(solvers))
    window, unit = close_up_window(case), case.units.label("length")
    _draw_main(main, case, window)
    titles = [_close_up(axes, results, case, s, window) for axes, s in zip(close_ups, solvers, strict=True)]
    for axes, title in zip(close_ups, titles, strict=True):
        axes.set_title(f"{title}, {number(np.ptp(window[:, 0]), 3)} {unit} wide")
    caption = (
        f"{case.title}: {plural(len(case.bodies), 'body', 'bodies')}, plane {case.plane.assumption}, "
        f"thickness {number(case.plane.thickness)} {unit}, spacing h = {number(case.mesh.h)} {unit}. "
        "Orange arrows: what drives the bodies; hatching: held in both directions; "
        "triangles: held along their axis. The dashed frame is shown "
        f"enlarged: {listed(dict.fromkeys(titles))}."
    )
    return style.drawing(figure, folder, "scene", "Scene", caption)


def _draw_main(axes: Axes, case: Case, window: np.ndarray) -> None:
    lower, upper = case.bounding_box()
    size = 0.045 * float((upper - lower).max())  # of a symbol
    _draw_bodies(axes, case, size)
    draw_notches(axes, case, widen=1.4)
    samples = outline_samples(case)
    for boundary in conditions(case):
        _draw_boundary(axes, case, boundary, samples, size)
    _draw_on_volume(axes, case, size)
    _draw_dimensions(axes, case, size)
    axes.add_patch(
        Rectangle(tuple(window[0]), *(window[1] - window[0]), fill=False, linestyle="--", linewidth=0.9,
                  edgecolor=style.INK, zorder=5)
    )  # fmt: skip
    axes.set(
        xlim=(lower[0] - 4.6 * size, upper[0] + 3.4 * size), ylim=(lower[1] - 4 * size, upper[1] + 4 * size)
    )
    axes.set_aspect("equal")
    axes.axis("off")
