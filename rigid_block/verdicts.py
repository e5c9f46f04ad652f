"""Where the verdict on the rigid block of a case changes with the amplitude of its pulse."""

from __future__ import annotations

from cases import Case, CaseError
from physics.rocking.borders import Border, borders
from physics.rocking.motion import Verdict
from physics.rocking.of_case import ground_motion
from physics.rocking.pendulum import Pendulum
from physics.rocking.winkler import WinklerBlock

#: relative width to which a border is bisected
TOLERANCE = 1e-6


def borders_of(case: Case, model: Pendulum | WinklerBlock) -> list[Border]:
    """All changes of the verdict between the amplitudes of ``rocking.borders``, which are over that of uplift.

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

    return borders(verdict_at, case.rocking.borders, TOLERANCE)


def named_borders(found: list[Border]) -> dict[str, float]:
    """Least amplitude of a fall after impacts, the one above which the block stands again, least of a fall without impact."""
    first = [border.amplitude for border in found if border.above is Verdict.AFTER_IMPACTS][:1]
    again = [border.amplitude for border in found if border.above is Verdict.SAFE][-1:]
    last = [border.amplitude for border in found if border.above is Verdict.NO_IMPACT][-1:]
    names = {"border_after_impacts": first, "border_standing_again": again, "border_without_impact": last}
    return {name: values[0] for name, values in names.items() if values}
