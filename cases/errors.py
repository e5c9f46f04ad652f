"""Errors that a user can put right, and the one that a rule of the schema raises."""

from __future__ import annotations

from typing import Any


class UserError(Exception):
    """Something that a user can put right: ``str(error)`` is one sentence with place, value and remedy.

    ``exit_code`` is the program's: 3 for bad input, 2 where a run did not come to its end.
    """

    exit_code = 3


class CaseError(UserError):
    """A mistake in a case description.

    ``str(error)`` is one sentence that names the file, the dotted key, the value and the remedy.
    """


class MissingRecordError(CaseError):
    """A measured motion of the ground that is not on this machine: no mistake in the case."""


class MeshError(CaseError):
    """No mesh can be made as the case asks; the message is one sentence that ends with the remedy."""


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
