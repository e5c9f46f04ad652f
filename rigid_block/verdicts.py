"""Where the verdict on the rigid block of a case changes with the amplitude of its pulse."""

from __future__ import annotations

import numpy as np

from cases import Case, CaseError
from physics.rocking.borders import Border, borders
from physics.rocking.motion import Verdict
from physics.rocking.of_case import ground_motion, pendulum_of, winkler_of
from physics.rocking.pendulum import Pendulum
from physics.rocking.winkler import WinklerBlock

#: relative width to which a border is bisected: that of the pendulum, and of the Winkler model, which takes much longer
PENDULUM_TOLERANCE, WINKLER_TOLERANCE = 1e-6, 1e-4


#: amplitudes over that of uplift between which changes are sought where the case names none
AMPLITUDES = tuple(map(float, np.geomspace(1.0, 16.0, 160)))


def model_of(case: Case, solver: str) -> Pendulum | WinklerBlock:
    """The model that a solver of rigid blocks makes of the case's block."""
    return winkler_of(case) if solver == "winkler" else pendulum_of(case, linear=solver == "pendulum_linear")


def borders_of(case: Case, model: Pendulum | WinklerBlock) -> list[Border]:
    """All changes of the verdict between the amplitudes of ``rocking.borders`` or `AMPLITUDES`, over that of uplift.

    Raises
    ------
    CaseError : the ground moves by a table or a record, which has no amplitude.
    """
    assert case.rocking is not None and case.dynamics is not None
    if case.dynamics.ground is None or case.dynamics.ground.pulse is None:
        raise CaseError(f"{case.source}: rocking.borders: are amplitudes of a pulse; give dynamics.ground.pulse.")
    motion = ground_motion(case, model.uplift_acceleration)

    def verdict_at(amplitude: float) -> Verdict:
        return model.respond(motion._replace(amplitude=amplitude * model.uplift_acceleration)).verdict

    tolerance = PENDULUM_TOLERANCE if isinstance(model, Pendulum) else WINKLER_TOLERANCE
    return borders(verdict_at, case.rocking.borders or AMPLITUDES, tolerance)


def named_borders(found: list[Border]) -> dict[str, float]:
    """Amplitudes above which the block falls after impacts, stands again, and falls without impact."""
    first = [border.amplitude for border in found if border.above is Verdict.AFTER_IMPACTS][:1]
    again = [border.amplitude for border in found if border.above is Verdict.SAFE][-1:]
    last = [border.amplitude for border in found if border.above is Verdict.NO_IMPACT][-1:]
    names = {"border_after_impacts": first, "border_standing_again": again, "border_without_impact": last}
    return {name: values[0] for name, values in names.items() if values}
