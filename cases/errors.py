"""The two errors of a case description: the one a reader sees, and the one a rule of the schema raises."""

from __future__ import annotations

from typing import Any


class CaseError(Exception):
    """A mistake in a case description.

    ``str(error)`` is one sentence that names the file, the dotted key, the value and the remedy.
    """


class BrokenRuleError(ValueError):
    """A rule of the schema is broken.

    Raised inside pydantic validators; `cases.messages` turns it into the sentence of a `CaseError`.

    Parameters
    ----------
    text : what is wrong, a predicate ("must be positive", "is unknown")
    remedy : what the writer of the file should do, an imperative
    key : dotted key relative to the table that the validator belongs to
    value : the offending value; left out of the sentence when None
    """

    def __init__(self, text: str, remedy: str, key: str = "", value: Any = None) -> None:
        super().__init__(text)
        self.text, self.remedy, self.key, self.value = text, remedy, key, value
