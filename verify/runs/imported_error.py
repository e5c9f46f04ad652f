"""What is said of a result from elsewhere that cannot be read."""

from collections.abc import Iterable

from cases.errors import UserError

_MOST_SHOWN = 30


class ImportedError(UserError):
    """A result from elsewhere that cannot be read; its text is one sentence that lists what was found."""


def listed(names: Iterable[object]) -> str:
    """The first names, and how many more there are."""
    known = list(map(str, names))
    more = f" and {len(known) - _MOST_SHOWN} more" if len(known) > _MOST_SHOWN else ""
    return ", ".join(known[:_MOST_SHOWN]) + more
