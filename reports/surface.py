"""Figures of the surface energy of a case's materials: polar plots, stiffness and profiles, before anything is solved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from cases import Case, load_case
from cases.material import Fracture
from physics.surface_energy import SurfaceEnergy, profile

from . import style
from .words import listed, number

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from typing import Any

    from .results import CaseResults

# Directions over a full turn, and distances from the crack in units of l0.
DIRECTIONS = np.linspace(0.0, 2.0 * np.pi, 721)
REACH = 12.0
# Keys of a fracture table: in one picture the orientation tells no materials apart.
SHAPE, SIZE = ("order", "gamma", "length_scale"), ("order", "gamma", "toughness")
PROFILE_QUANTITIES = ("c", "slope", "crack_density")


@dataclass(frozen=True)
class Surface:
    """A fracture table of the case, with the name of its material (and of the run that brings it)."""

    name: str
    fracture: Fracture

    @property
    def energy(self) -> SurfaceEnergy:
        """Its surface energy."""
        return SurfaceEnergy.of(self.fracture)


def surfaces(case: Case, distinct: tuple[str, ...], family: str = "") -> list[Surface]:
    """The materials that can break, of the case and of its runs; of those equal in the ``distinct`` keys the first.

    Runs of sweeps over gamma are left out unless their ``family`` is asked for, which then comes alone.
    """
    found: dict[str, Surface] = {}
    cases = [] if family else [("", case)]
    for name, spec in case.run_specs().items():
        label, swept = name.partition("[")[0], _swept_gamma(spec.sweep_values)
        if (spec.family if swept else "") == family:
            cases.append((swept or label, load_case(case.source, case.tier, name)))
    for label, described in cases:
        for material, table in described.materials.items():
            if table.fracture is not None:
                name = ", ".join(part for part in (material, label) if part)
                key = table.fracture.model_dump_json(include=set(distinct))
                found.setdefault(key, Surface(name, table.fracture))
    return list(found.values())


def _swept_gamma(values: Mapping[str, Any]) -> str:
    """Entries of gamma that a run of a sweep sets, such as "γ_1212 = 74"; empty where there are none."""
    entries = {key.rpartition(".")[2]: value for key, value in values.items() if ".gamma." in key}
    return ", ".join(f"{key.replace('gamma', 'γ')} = {value:g}" for key, value in entries.items())


def _families(case: Case) -> list[str]:
    """Sweeps over entries of gamma."""
    return list(dict.fromkeys(spec.family for spec in case.run_specs().values() if _swept_gamma(spec.sweep_values)))


def surface_energy(results: CaseResults, folder: Path) -> list[style.Drawing]:
    """Draw the surface energies of a case that has a material of order 4; nothing for other cases."""
    return draw(results.case, folder) if results.case and needs_figures(results.case) else []


def needs_figures(case: Case) -> bool:
    """Whether some surface energy depends on the direction or on the fourth order."""
    return any(surface.fracture.order == 4 for surface in surfaces(case, SHAPE))


def draw(case: Case, folder: Path) -> list[style.Drawing]:
    """Polar plots, stiffness over direction, and profiles, each with the CSV behind it."""
    shown = surfaces(case, SHAPE)
    drawings = [_polar(case, shown, folder), _stiffness(case, shown, folder), _profiles(case, shown, folder)]
    return drawings + [_polar(case, surfaces(case, SHAPE, name), folder, name) for name in _families(case)]


def extremes(shown: list[Surface]) -> pd.DataFrame:
    """Least and largest surface energy of each material, where they are, and the forbidden directions [degrees]."""
    rows = []
    for surface in shown:
        (least, at_least), (largest, at_largest) = surface.energy.extremes()
        intervals = np.degrees(surface.energy.forbidden())
        said = ", ".join(f"{a:.1f} to {b:.1f}" for a, b in intervals) or "none"
        angles = (np.degrees(at_least), np.degrees(at_largest))
        rows.append((surface.name, surface.fracture.order, least, angles[0], largest, angles[1], said))
    columns = ["material", "order", "least", "theta_least", "largest", "theta_largest", "forbidden"]
    return pd.DataFrame(rows, columns=columns)


def _table(shown: list[Surface]) -> pd.DataFrame:
    """Energy, reciprocal, second derivative and stiffness over direction, all over the toughness (or times it)."""
    tables = []
    for surface in shown:
        factor = surface.fracture.toughness
        energy, stiffness = surface.energy.energy(DIRECTIONS) / factor, surface.energy.stiffness(DIRECTIONS) / factor
        columns = {"theta": np.degrees(DIRECTIONS), "energy": energy, "reciprocal": 1.0 / energy}
        columns |= {"second_derivative": stiffness - energy, "stiffness": stiffness}
        tables.append(pd.DataFrame(columns).assign(material=surface.name, toughness=factor))
    return pd.concat(tables, ignore_index=True)


def _polar(case: Case, shown: list[Surface], folder: Path, family: str = "") -> style.Drawing:
    table = _table(shown)
    figure, axes = style.panels(1, 2, 8.4, 4.4, subplot_kw={"projection": "polar"})
    colours = style.colours_of([surface.name for surface in shown])
    titles = (("energy", "surface energy over toughness [1]"), ("reciprocal", "toughness over surface energy [1]"))
    for axis, (column, title) in zip(axes.flat, titles, strict=True):
        for surface in shown:
            part = table[table["material"] == surface.name]
            _draw_direction(axis, np.radians(part["theta"]), part, column, colours[surface.name], surface.name)
        axis.set_title(title)
        axis.set_ylim(bottom=0.0)
        axis.tick_params(labelsize=7)
    style.legend_below(figure, [axes.flat[0]])
    return style.drawing(
        figure, folder, f"surface-energy-{family}".rstrip("-"), f"Surface energy over direction {family}".rstrip(),
        f"{_in_words(case, shown)} Dotted: directions in which no crack runs.",
        table[["material", "toughness", "theta", "energy", "reciprocal"]],
    )  # fmt: skip


def _draw_direction(axis: Any, theta: Any, part: pd.DataFrame, column: str, colour: str, name: str) -> None:
    axis.plot(theta, part[column], color=colour, label=name)
    forbidden = part[column].where(part["stiffness"] < 0.0)
    if forbidden.notna().any():
        axis.plot(theta, forbidden, ":", color="black", linewidth=1.8, label="forbidden")


def _in_words(case: Case, shown: list[Surface]) -> str:
    unit = case.units.label("toughness")
    said = [
        f"{row.material}: {number(row.least)} at {row.theta_least:.0f}° to {number(row.largest)} {unit} "
        f"at {row.theta_largest:.0f}°"
        for row in extremes(shown).itertuples()
    ]
    return f"Energy to open a unit of crack along each direction, from the exact profile. {listed(said)}."


def _stiffness(case: Case, shown: list[Surface], folder: Path) -> style.Drawing:
    table = _table(shown)
    figure, axes = style.panels(1, 2, 8.4, 3.6, grid=True, sharex=True)
    colours = style.colours_of([surface.name for surface in shown])
    titles = (
        ("second_derivative", "second derivative of the surface energy"),
        ("stiffness", "surface stiffness, Eq. 5.18"),
    )
    for axis, (column, title) in zip(axes.flat, titles, strict=True):
        for surface in shown:
            part = table[table["material"] == surface.name]
            _draw_direction(axis, part["theta"], part, column, colours[surface.name], surface.name)
        axis.axhline(0.0, color=style.GREY, linewidth=0.8)
        axis.set(xlabel="direction of the crack [°]", ylabel=f"{title} over toughness [1]", xlim=(0.0, 180.0))
        axis.set_xticks(np.arange(0, 181, 45))
    style.legend_below(figure, [axes.flat[0]])
    caption = (
        "Second derivative of the surface energy and surface stiffness (Eq. 5.18); where it is negative, no crack runs."
    )
    data = table[["material", "toughness", "theta", "second_derivative", "stiffness"]]
    return style.drawing(figure, folder, "surface-stiffness", "Surface stiffness", caption, data)


def _profile_table(shown: list[Surface]) -> pd.DataFrame:
    """Exact profiles across cracks in the weakest and in the strongest direction of each material."""
    x = np.linspace(-REACH, REACH, 481)
    tables = []
    for surface in shown:
        scale = surface.fracture.length_scale
        extreme = surface.energy.extremes()
        for energy, theta in extreme if extreme[1][0] > extreme[0][0] * (1 + 1e-9) else extreme[:1]:
            gamma = float(surface.energy.directional_gamma(theta))
            c, slope, bend = profile(x, gamma)
            density = ((c - 1.0) ** 2 / 4.0 + slope**2 + gamma * bend**2) / scale
            columns = {"x": x * scale, "c": c, "slope": slope / scale, "crack_density": density}
            label = f"{surface.name}, {np.degrees(theta):.0f}°"
            tables.append(pd.DataFrame(columns).assign(material=surface.name, crack=label, energy=energy))
    return pd.concat(tables, ignore_index=True)


def _profiles(case: Case, shown: list[Surface], folder: Path) -> style.Drawing:
    table, unit = _profile_table(shown), case.units.label("length")
    figure, axes = style.panels(1, 3, 8.4, 3.4, grid=True)
    colours = style.colours_of([surface.name for surface in shown])
    names = ("phase field c", f"slope of c [1/{unit}]", f"crack density [1/{unit}]")
    for axis, column, name in zip(axes.flat, PROFILE_QUANTITIES, names, strict=True):
        seen: dict[str, int] = {}
        for (material, crack), part in table.groupby(["material", "crack"], sort=False):
            line = ("-", "--")[seen.setdefault(str(material), 0)]
            seen[str(material)] = 1
            axis.plot(part["x"], part[column], line, color=colours[str(material)], label=str(crack))
        axis.set(xlabel=f"distance from the crack [{unit}]", ylabel=name)
    style.legend_below(figure, [axes.flat[0]])
    caption = (
        "Exact solutions of Eqs. 5.10-5.11 across a crack in the weakest (solid) and in the strongest direction (dashed)"
        " of each material."
    )
    title = "Profiles of the phase field across a crack"
    return style.drawing(figure, folder, "surface-profiles", title, caption, table)
