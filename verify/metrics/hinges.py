"""Hinges of a vault: places where its phase field has fallen through the thickness."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from verify.metrics.metric import MetricError, metric, run_name

if TYPE_CHECKING:
    from cases import Case
    from cases.geometry import Arch
    from verify.metrics.metric import RunData

#: degrees on either side of the crown that tell how far it has sunk
CROWN = 5.0
#: layers of the vault that must have broken, all of them
LAYERS = 3


class Hinge(NamedTuple):
    """Angle from the crown towards +x [degrees], and when the last layer broke there [time]."""

    angle: float
    time: float


def arch_of(case: Case) -> tuple[int, Arch]:
    """Number and shape of the body that is an arch; MetricError for a case without."""
    for number, body in enumerate(case.bodies.values()):
        if body.shape is not None and body.shape.arch is not None:
            return number, body.shape.arch
    raise MetricError(f"{case.name}: no body is an arch; give one the shape arch")


def vault_of(run: RunData) -> tuple[NDArray, NDArray, dict[str, NDArray]]:
    """Angle from the crown towards +x [degrees] and radius [length] at the start of the vault's points (n,), and when
    they broke, and their phase field and displacement in the last state."""
    number, arch = arch_of(run.case)
    data = run.points().point_data
    reference = np.asarray(data["reference"])[:, :2]
    inside = arch.in_vault(reference) & (np.asarray(data["body"]) == number)
    angle, radius = arch.polar(reference[inside])
    return angle, radius, {name: np.asarray(data[name])[inside] for name in ("broken_at", "phase_field", "displacement")}


def exact_hinges(arch: Arch) -> tuple[float, NDArray]:
    """Horizontal over vertical load at collapse without tension, and the hinges of the vault (n,) [degrees]."""
    from physics.rocking.limit_analysis import Arch  # scipy: on use

    found = Arch.of_shape(arch).collapse()
    return found.factor, np.array([float(name) for name, _ in found.hinges if "base" not in name])


def hinges_of(run: RunData) -> list[Hinge]:
    """Hinges in the order in which they opened.

    The vault is parted into sectors as wide as a cell. In one that is a hinge, or in it and its neighbours, some point of
    each layer broke; sectors nearer to each other than the vault is thick are of one hinge, which is where the phase
    field is least.
    """
    _, arch = arch_of(run.case)
    angle, radius, data = vault_of(run)
    when, phase_field = data["broken_at"], data["phase_field"]
    layer = np.clip((LAYERS * (radius - arch.radius) / arch.thickness).astype(int), 0, LAYERS - 1)
    width = np.degrees(run.case.mesh.h / (arch.radius + 0.5 * arch.thickness))
    opened = _opened(angle, layer, when, width)
    found = []
    for first, last in _groups(opened, np.degrees(arch.thickness / arch.radius) / width):
        low, high = ((edge + shift) * width for edge, shift in ((first, -1.0), (last, 1.0)))
        there = np.flatnonzero((angle >= low) & (angle <= high))
        depth = 1.0 - phase_field[there]
        middle = float((angle[there] * depth).sum() / depth.sum())
        found.append(Hinge(middle, min(time for sector, time in opened.items() if first <= sector <= last)))
    return sorted(found, key=lambda hinge: hinge.time)


def _opened(angle: NDArray, layer: NDArray, when: NDArray, width: float) -> dict[int, float]:
    """Numbers of the sectors of a width that are broken through, from that at angle 0, and since when."""
    sector, opened = np.round(angle / width).astype(int), {}
    for number in np.unique(sector):
        near = np.abs(sector - number) <= 1
        firsts = [when[near & (layer == one) & ~np.isnan(when)] for one in range(LAYERS)]
        if all(len(times) for times in firsts):
            opened[int(number)] = max(float(times.min()) for times in firsts)
    return opened


def _groups(opened: dict[int, float], gap: float) -> list[tuple[int, int]]:
    """First and last of sectors that are no further apart than a gap."""
    groups: list[tuple[int, int]] = []
    for sector in sorted(opened):
        if groups and sector - groups[-1][1] <= max(1.0, gap):
            groups[-1] = groups[-1][0], sector
        else:
            groups.append((sector, sector))
    return groups


@metric("number", "hinges of the vault")
def hinge_count(run: RunData) -> float:
    """Places where the vault has broken through its thickness."""
    return float(len(hinges_of(run)))


def _hinge(run: RunData, number: float) -> Hinge:
    found = hinges_of(run)
    if not 1 <= number <= len(found):
        raise MetricError(f"{run_name(run)}: has {len(found)} hinges, of which {number:g} is none; ask for another one")
    return found[int(number) - 1]


@metric("degree", "where a hinge of the vault opened, from the crown")
def hinge_angle(run: RunData, *, number: float) -> float:
    """Angle from the crown towards +x of the hinge that opened as the first, second, ..."""
    return _hinge(run, number).angle


@metric("time", "when a hinge of the vault opened")
def hinge_time(run: RunData, *, number: float) -> float:
    """Time at which the hinge that opened as the first, second, ... had gone through the thickness."""
    return _hinge(run, number).time


@metric("degree", "largest distance of a hinge of limit analysis from the nearest of the run")
def hinge_mismatch(run: RunData) -> float:
    """Distance along the vault, of its collapse without tension under a horizontal load, towards the nearer side."""
    found = np.array([hinge.angle for hinge in hinges_of(run)])
    if not len(found):
        raise MetricError(f"{run_name(run)}: the vault has no hinge; shake it longer or harder")
    _, exact = exact_hinges(arch_of(run.case)[1])
    if not len(exact):
        raise MetricError(f"case {run.case.name}: its vault cannot stand by its weight; judge its hinge_angle")
    return min(float(np.abs(side * exact[:, None] - found).min(axis=1).max()) for side in (1.0, -1.0))


@metric("number", "1 where the crown has sunk by more than the vault is thick, else 0")
def collapsed(run: RunData) -> float:
    """Whether the vault has come down by the end."""
    angle, _, data = vault_of(run)
    sunk = -data["displacement"][np.abs(angle) < CROWN, 1].mean()
    return float(sunk > arch_of(run.case)[1].thickness)
