"""What solvers object to in a case, asked before anything is computed."""

import time
from collections.abc import Iterable
from dataclasses import dataclass, field

from cases import Case, UserError
from cases.solvers import IMPORTED, SOLVERS
from cases.spacing import count_cells
from physics.exact_rules import require_exact
from physics.rocking.records import missing_record
from verify.runs.importing import history_of, read_foreign
from verify.runs.running import DISCRETISATIONS

#: cells of a grid up to which a solver is set up to hear whether it takes a case
MOST_TRIED = 30_000
#: processor seconds after which no further run is tried of a solver that has been
MOST_SECONDS = 8.0


@dataclass
class Refusals:
    """Sentences of what was refused, each once, and of records of measured motions that are not on this machine; how many
    runs were too large to be tried, and whether time ran out."""

    sentences: list[str] = field(default_factory=list)
    needs: list[str] = field(default_factory=list)
    too_large: int = 0
    out_of_time: bool = False

    @property
    def note(self) -> str:
        """What is said of runs that were not tried; empty where all were."""
        untried = [f"{self.too_large} runs with large grids"] if self.too_large else []
        untried += ["some of its runs"] if self.out_of_time else []
        return f" as it reads; {' and '.join(untried)} were not set up for a try" if untried else ""


def refusals(cases: Iterable[Case]) -> Refusals:
    """Set up the solver of each run, the cases with its changes merged in; equal computations once."""
    found, seen, tried, until = Refusals(), set(), set(), time.process_time() + MOST_SECONDS
    for case in cases:
        if case.hash() in seen:
            continue
        seen.add(case.hash())
        solver = case.run_spec(case.run or "").solver
        if time.process_time() > until and solver in tried:
            found.out_of_time = True
            continue
        tried.add(solver)
        if count_cells(case) > MOST_TRIED:
            found.too_large += 1
            continue
        if (needs := missing_record(case)) and needs not in found.needs:
            found.needs.append(needs)
        sentence = "" if needs else _refusal(case)
        if sentence and sentence not in found.sentences:
            found.sentences.append(sentence)
    return found


def _refusal(case: Case) -> str:
    """What the solver of a case's run says against it; empty where it takes it."""
    solver = case.run_spec(case.run or "").solver
    try:
        require_exact(case)
        if SOLVERS[solver].table and solver != IMPORTED:
            return ""
        if solver == IMPORTED:
            history_of(read_foreign(case)[0], case)
            return ""
        DISCRETISATIONS[solver](case)
    except UserError as error:
        return str(error)
    except ModuleNotFoundError:  # an extra that is not installed is no fault of the case
        raise
    except Exception as error:  # a solver that stumbles over a case takes it as little as one that refuses it
        text = " ".join(str(error).split())
        return f"{case.source}: run {case.run}: {type(error).__name__}: {text}; the solver cannot set it up"
    return ""
