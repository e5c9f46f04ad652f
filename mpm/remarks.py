"""What the reader of a case should know before material points compute it."""

from __future__ import annotations

from cases import Case
from mpm.contact_remarks import contact_remarks
from mpm.seam_remarks import seam_remarks


def remarks(case: Case) -> list[str]:
    """Sentences on how its bodies touch, or are welded together."""
    return contact_remarks(case) if case.dynamics is not None else seam_remarks(case)
