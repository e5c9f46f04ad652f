"""The table of a case that says what is written, and when."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cases.table import Table, Whole
from cases.units import Length, Time


class Output(Table):
    """What is written.

    snapshots : load parameters at which fields are written, besides the last state [length]
    times : the same for dynamics [time]
    frames : number of pictures of a dynamic run for its animation, evenly spaced in time, besides the first state
    records : number of evenly spaced rows of the history of a dynamic run
    """

    snapshots: tuple[Length, ...] = ()
    times: tuple[Annotated[Time, Field(ge=0)], ...] = ()
    frames: Annotated[Whole, Field(ge=0, le=10_000)] = 0
    records: Annotated[Whole, Field(ge=1, le=1_000_000)] = 200
