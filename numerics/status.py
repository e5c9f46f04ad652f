"""How a run stands or ended: the one list of states, from which words, verdicts and folders follow."""

from enum import StrEnum


class RunStatus(StrEnum):
    """State of a run, of a finished folder or why there is none to judge."""

    COMPLETE = "complete"
    BROKEN_THROUGH = "broken_through"
    EXPECTED_FAILURE = "expected_failure"
    NO_CONVERGENCE = "no_convergence"
    BLEW_UP = "blew_up"
    TIMED_OUT = "timed_out"
    FAILED = "failed"
    MISSING = "missing"
    UNFINISHED = "unfinished"
    DAMAGED = "damaged"
    CHANGED = "changed"
    NEEDS_RECORD = "needs_record"

    @property
    def words(self) -> str:
        """What a reader is told."""
        return _WORDS.get(self, self.value.replace("_", " "))

    @property
    def good(self) -> bool:
        """The run ended as the case means it to."""
        return self in _GOOD

    @property
    def failed(self) -> bool:
        """The solver ran and did not come to a good end."""
        return self in _FAILED

    @property
    def finished(self) -> bool:
        """A run folder can tell it; the others say why there is none."""
        return self.good or self.failed

    @property
    def repeatable(self) -> bool:
        """Done again the run would end so again; other failures may have met a full disk or a slow machine."""
        return self.finished and self not in (RunStatus.FAILED, RunStatus.TIMED_OUT)


_GOOD = (RunStatus.COMPLETE, RunStatus.BROKEN_THROUGH, RunStatus.EXPECTED_FAILURE)
_FAILED = (RunStatus.NO_CONVERGENCE, RunStatus.BLEW_UP, RunStatus.TIMED_OUT, RunStatus.FAILED)
_WORDS = {
    RunStatus.COMPLETE: "load path completed",
    RunStatus.EXPECTED_FAILURE: "failed, as expected",
    RunStatus.TIMED_OUT: "out of time",
    RunStatus.MISSING: "no results",
    RunStatus.NEEDS_RECORD: "needs a record of a measured motion",
    RunStatus.CHANGED: "of another version of the case",
}
FINISHED_STATUSES = tuple(status for status in RunStatus if status.finished)
