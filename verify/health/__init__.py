"""The health record of a run: whether its method stayed within the range in which its numbers mean something.

Each indicator is a number with a limit; a run beyond one is suspect, which fails its case with the sentence what to do.
A case that shows a failure on purpose says so at the run, in its table ``accepts``.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from cases import Case
from numerics.fields import Fields
from verify.health.bodies import of_bodies
from verify.health.cells import of_cells
from verify.health.course import of_history
from verify.health.cracks import of_cracks
from verify.health.indicators import INDICATORS
from verify.health.meeting import of_gaps
from verify.health.notches import of_notches


def health(case: Case, history: pd.DataFrame, fields: Fields | None, measures: Mapping[str, float]) -> dict[str, float]:
    """The indicators that apply to a run, from its history, its last state and what its solver tells."""
    found = {name: value for name, value in measures.items() if name in INDICATORS}
    found |= of_history(case, history, fields)
    if fields is not None:
        found |= of_cracks(case, fields) | of_bodies(case, fields) | of_gaps(case, fields)
        found |= of_notches(case, fields, history) | of_cells(case, fields, history)
    return {name: float(value) for name, value in found.items() if np.isfinite(value)}


def suspicions(found: Mapping[str, float | None], accepted: Mapping[str, str]) -> list[str]:
    """One sentence for each indicator beyond its limit that is not accepted, after its name."""
    return [
        f"{name}: {indicator.meaning} is {value:.3g}, more than {indicator.limit:g}; {indicator.remedy}"
        for name, indicator in INDICATORS.items()
        if name not in accepted and (value := found.get(name)) is not None and value > indicator.limit
    ]
