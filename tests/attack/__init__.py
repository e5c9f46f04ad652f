"""Attacks on the program: seeded mutants of its cases, damaged results, kills; see ``python -m tests.attack --help``."""

from .attempts import plan, run, validate
from .harness import Attempt

ATTACKS: dict[str, Attempt] = {"validate": validate, "plan": plan, "run": run}
