"""The table of a case that says what is written, and when."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cases.geometry import Shape
from cases.table import Name, Table, Whole
from cases.units import Length, Time


class Region(Table):
    """A part of a body, of which a dynamic run of material points tells the angle by which it has turned.

    body : a body of the case. within : what it covers at the start
    """

    body: Name
    within: Shape


class Output(Table):
    """What is written.

    snapshots : load parameters at which fields are written, besides the last state [length]
    times : the same for dynamics [time]
    frames : number of pictures of a dynamic run for its animation, evenly spaced in time, besides the first state
    records : number of evenly spaced rows of the history of a dynamic run
    regions : parts of bodies whose angle is told, by their names
    """

    snapshots: tuple[Length, ...] = ()
    times: tuple[Annotated[Time, Field(ge=0)], ...] = ()
    frames: Annotated[Whole, Field(ge=0, le=10_000)] = 0
    records: Annotated[Whole, Field(ge=1, le=1_000_000)] = 200
    regions: dict[Name, Region] = Field(default_factory=dict)
