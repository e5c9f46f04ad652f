"""What several indicators ask of a run's last state."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from cases import Case
from cases.notches import HistoryNotch, Segment
from cases.solvers import SOLVERS
from numerics.fields import Fields

#: a quasi-static run is held to its balance while nothing is broken: what a crack sets free in a jump, no state keeps
WHOLE = 0.5
#: a state that holds a smaller share of the largest elastic energy has been unloaded
LOADED = 0.05
#: energies below this share of that which eigenstrains would store in bodies that are held all round are none
ROUND_OFF = 1e-5
#: kinetic energy over the elastic one below which bodies are at rest: no wave closes a notch on its way
_AT_REST = 1e-4


def uses_points(case: Case) -> bool:
    """Whether the run's solver carries its state by material points."""
    return SOLVERS[case.run_spec(case.run or "").solver].by_points


def is_unloaded(case: Case, history: pd.DataFrame) -> bool:
    """Whether the last state of a run at rest is left without load and stress, so that round-off moves faces."""
    if case.dynamics or not len(history):
        return False
    last = (np.abs(history[name].to_numpy(float)) for name in ("u", "E_el"))
    return all(size[-1] < LOADED * size.max() for size in last)


def rests(case: Case, history: pd.DataFrame) -> bool:
    """The last state is one of equilibrium."""
    return not case.dynamics or (len(history) > 0 and history["E_kin"].iloc[-1] < _AT_REST * history["E_el"].iloc[-1])


def most_stress(case: Case, strain: NDArray) -> float:
    """What strains could make of stress [stress]."""
    from physics.elasticity import MaterialTable  # judging does without compiled laws

    return float(MaterialTable(case).stiffness.max() * strain.max(initial=0.0))


def length_scales(case: Case, fields: Fields) -> NDArray:
    """Of the points (n,) [length]; infinite where nothing breaks."""
    fractures = [case.materials[body.material].fracture for body in case.bodies.values()]
    return np.array([np.inf if of is None else of.length_scale for of in fractures])[fields.body]


def whole_bodies(case: Case, fields: Fields) -> Iterator[int]:
    """Bodies that have not broken anywhere."""
    for number in range(len(case.bodies)):
        of_body = fields.body == number
        if of_body.any() and fields.phase_field[of_body].min() > WHOLE:
            yield number


def torn_from_the_start(case: Case) -> list[Segment]:
    """Notches drawn by the history field, and the pieces of lines on which the phase field is held broken."""
    broken = [c.on for c in case.constraints if c.direction == "phase" and c.value is not None and c.value < WHOLE]
    lines = [case.boundaries[on].line() for on in broken]
    ends = [pair for line in lines if line is not None for pair in pairwise(line.coords)]
    drawn = [notch for notch in case.all_notches if isinstance(notch, HistoryNotch)]
    return [*drawn, *(Segment(start=start, end=end) for start, end in ends)]
