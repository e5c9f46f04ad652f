"""Attack the program for a while and tell what was found and how to repeat it.

Example: ``python -m tests.attack --seconds 3600 --seed 1``; ``python -m tests.attack --seed 1 --only validate:348``
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import traceback
from pathlib import Path

from . import ATTACKS
from .harness import attack


def main() -> int:
    """0 when nothing was found."""
    asked = _arguments()
    if asked.only and ":" in asked.only[0]:
        return _repeat(asked.seed, *asked.only[0].split(":"))
    kinds, found = asked.only or list(ATTACKS), 0
    for kind in kinds:
        numbers = range(asked.first, asked.first + asked.most)
        findings = attack(ATTACKS[kind], asked.seed, numbers, asked.seconds / len(kinds))
        counts = ", ".join(f"{count} {outcome}" for outcome, count in findings.outcomes.most_common())
        print(f"{kind}: {findings.count} attempts: {counts}", flush=True)
        for number, what in findings.finds:
            print(f"  {what}\n    python -m tests.attack --seed {asked.seed} --only {kind}:{number}", flush=True)
        found += len(findings.finds)
    return int(found > 0)


def _arguments() -> argparse.Namespace:
    as_written = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(prog="python -m tests.attack", description=__doc__, formatter_class=as_written)
    parser.add_argument("--seconds", type=float, default=3600.0, help="for all kinds together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="+", metavar="KIND[:NUMBER]", help=f"of {', '.join(ATTACKS)}, or one attempt")
    parser.add_argument("--first", type=int, default=0, help="number of the first attempt")
    parser.add_argument("--most", type=int, default=10**9, help="attempts of a kind")
    return parser.parse_args()


def _repeat(seed: int, kind: str, number: str) -> int:
    """One attempt again, in this process, with its traceback and its files kept."""
    folder = Path(tempfile.mkdtemp(prefix="attack-"))
    print(f"files: {folder}")
    try:
        print(ATTACKS[kind](random.Random(f"{seed}:{number}"), folder))
    except Exception:
        traceback.print_exc()
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
