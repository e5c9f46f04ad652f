"""Attacks on the program: seeded mutants of its cases, damaged results, kills; see ``python -m tests.attack --help``."""

import sys
from pathlib import Path

# the stand-ins beside this folder, however it has been started
sys.path.insert(0, str(Path(__file__).parents[1]))

from .attempts import compiled, plan, run, validate
from .damage import damage_checkpoint, damage_folder, finished
from .harness import BEFORE, Attempt
from .kills import kill, kill_solver

ATTACKS: dict[str, Attempt] = {
    "validate": validate,
    "plan": plan,
    "run": run,
    "folder": damage_folder,
    "checkpoint": damage_checkpoint,
    "kill": kill,
    "kill_solver": kill_solver,
}
BEFORE.update(run=compiled, damage_folder=finished, damage_checkpoint=finished, kill=finished)
