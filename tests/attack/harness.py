"""Attempts in a process of their own, watched from outside: what is no answer, too slow or too large is a find."""

from __future__ import annotations

import json
import os
import random
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import psutil

from cases import UserError

#: processor seconds and bytes that one attempt may take
MOST_SECONDS, MOST_MEMORY = 10.0, 2e9
#: seconds of the wall's clock after which an attempt hangs
PATIENCE = 300.0
# A sentence that nobody would read to its end.
LONGEST_SENTENCE = 3000

Attempt = Callable[[random.Random, Path], str]


#: name of an attempt -> what a process does before its limits hold
BEFORE: dict[str, Callable[[], object]] = {}


class TooSlowError(BaseException):
    """An attempt has used up its processor seconds; no handler of the program catches it."""


class FoundError(Exception):
    """An answer that is wrong without being an error of the program."""


@dataclass
class Findings:
    """How many attempts ended how, and what they found: (number of the attempt, what)."""

    outcomes: Counter[str] = field(default_factory=Counter)
    finds: list[tuple[int, str]] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Attempts made."""
        return self.outcomes.total()


def attack(attempt: Attempt, seed: int, numbers: range, seconds: float) -> Findings:
    """Make the attempts of these numbers until the seconds are over; each is a matter of seed and number alone."""
    findings, until, first = Findings(), time.monotonic() + seconds, numbers.start
    while first < numbers.stop and time.monotonic() < until:
        for number, outcome, found in _by_a_child(attempt, seed, range(first, numbers.stop), until):
            findings.outcomes[outcome] += 1
            if found:
                findings.finds.append((number, found))
            first = number + 1
    return findings


def _by_a_child(attempt: Attempt, seed: int, numbers: range, until: float) -> Iterator[tuple[int, str, str]]:
    """Number, outcome and find of each attempt, to the last one or to the child's death."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        with os.fdopen(writer, "w", buffering=1) as told:
            _make_attempts(attempt, seed, numbers, until, told)
    os.close(writer)
    begun: int | None = None
    with os.fdopen(reader, "r") as lines:
        try:
            lines.readline()  # ready: what it takes to get ready is no matter of an attempt
            while _speaks(lines, child):
                number, outcome, found = json.loads(lines.readline() or "null") or (None, "", "")
                if number is None:
                    break
                begun = number if outcome == "begun" else None
                if begun is None:
                    yield number, outcome, found
        finally:
            with suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
            _, status = os.waitpid(child, 0)
    if begun is not None:
        yield begun, "died", f"the process ended: {_death(status)}"


def _death(status: int) -> str:
    if not os.WIFSIGNALED(status):
        return "exit"
    return f"signal {os.WTERMSIG(status)} (9 after {PATIENCE:g} s or twice the processor time)"


def _speaks(lines: IO[str], child: int) -> bool:
    """Wait for a line of the child, which uses processor time within measure; False where it hangs."""
    process, started = psutil.Process(child), time.monotonic()
    used = sum(process.cpu_times()[:2])
    while not select.select([lines], [], [], 1.0)[0]:
        if sum(process.cpu_times()[:2]) - used > 2 * MOST_SECONDS or time.monotonic() - started > PATIENCE:
            return False
    return True


def _make_attempts(attempt: Attempt, seed: int, numbers: range, until: float, told: IO[str]) -> None:
    """The child's life."""
    started = time.monotonic()
    BEFORE.get(attempt.__name__, lambda: None)()
    until += time.monotonic() - started
    told.write("ready\n")
    signal.signal(signal.SIGPROF, _too_slow)
    sys.stdout = sys.stderr = Path(os.devnull).open("w")  # noqa: SIM115
    limit = psutil.Process().memory_info().vms + int(MOST_MEMORY)
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))
    try:
        for number in numbers:
            if time.monotonic() > until:
                break
            told.write(json.dumps((number, "begun", "")) + "\n")
            outcome, found = made(attempt, seed, number)
            told.write(json.dumps((number, outcome, found)) + "\n")
    finally:
        told.flush()
        os._exit(0)


def made(attempt: Attempt, seed: int, number: int) -> tuple[str, str]:
    """Outcome of one attempt, and what it found."""
    rng = random.Random(f"{seed}:{number}")
    try:
        with _folder() as folder, _limited():
            return attempt(rng, folder), ""
    except UserError as error:
        said = str(error)
        if "\n" in said or len(said) > LONGEST_SENTENCE or not said.strip():
            return "refused", f"no sentence but {len(said)} characters: {said[:200]!r}"
        return "refused", ""
    except (Exception, TooSlowError) as error:
        return "found", f"{type(error).__name__}: {str(error)[:300]} | {_where(error)}"


def _where(error: BaseException) -> str:
    """The innermost frames, without the libraries'."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if "site-packages" not in f.filename]
    return " < ".join(f"{Path(f.filename).name}:{f.lineno}" for f in reversed(frames[-5:]))


@contextmanager
def _folder() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="attack-"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _limited() -> Iterator[None]:
    signal.setitimer(signal.ITIMER_PROF, MOST_SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def _too_slow(*_: Any) -> None:
    raise TooSlowError(f"over {MOST_SECONDS:g} s of the processor")
