"""What solvers object to in a case, asked before anything is computed."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from cases import Case, UserError
from cases.spacing import count_cells
from verify.runs.running import DISCRETISATIONS

#: cells of a grid up to which a solver is set up to hear whether it takes a case, and of all such grids together
MOST_TRIED, MOST_TRIED_TOGETHER = 60_000, 600_000


@dataclass
class Refusals:
    """Sentences of what was refused, each once, and how many runs were too large to be tried."""

    sentences: list[str] = field(default_factory=list)
    untried: int = 0

    @property
    def note(self) -> str:
        """What is said of runs that were not tried; empty where all were."""
        return f" as it reads; {self.untried} runs are too large to be set up for a try" if self.untried else ""


def refusals(cases: Iterable[Case]) -> Refusals:
    """Set up the solver of each run, the cases with its changes merged in; equal computations once."""
    found, seen, cells = Refusals(), set(), 0
    for case in cases:
        if case.hash() in seen:
            continue
        seen.add(case.hash())
        of_case = count_cells(case)
        if of_case > MOST_TRIED or cells + of_case > MOST_TRIED_TOGETHER:
            found.untried += 1
            continue
        cells += of_case
        sentence = _refusal(case)
        if sentence and sentence not in found.sentences:
            found.sentences.append(sentence)
    return found


def _refusal(case: Case) -> str:
    """What the solver of a case's run says against it; empty where it takes it."""
    try:
        DISCRETISATIONS[case.run_spec(case.run or "").solver](case)
    except UserError as error:
        return str(error)
    except Exception as error:  # a solver that stumbles over a case takes it as little as one that refuses it
        text = " ".join(str(error).split())
        return f"{case.source}: run {case.run}: {type(error).__name__}: {text}; the solver cannot set it up"
    return ""
