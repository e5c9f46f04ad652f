"""What a run is spared: each saving is a named change of the case that switches it off."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cases import Case
from cases.judging import merge
from cases.rules import what_reaches
from cases.solvers import SOLVERS

Tables = dict[str, Any]


@dataclass(frozen=True)
class Saving:
    """A named switch that spares work, for one run of a case.

    used : whether it is in use; reason : why, or why not
    off : tables that switch it off; None where it cannot be switched or is not in use
    """

    name: str
    used: bool
    reason: str
    off: Tables | None = None


def savings(case: Case) -> tuple[Saving, ...]:
    """All savings that a run's case could have, used or not."""
    rules = IN_TIME if case.dynamics is not None else QUASI_STATIC
    return tuple(rule(case) for rule in (*rules, *ALWAYS))


def all_off(chosen: tuple[Saving, ...]) -> Tables:
    """The tables that switch all of them off."""
    change: Tables = {}
    for saving in chosen:
        change = merge(change, saving.off or {})
    return change


def _graded_grid(case: Case) -> Saving:
    """Cells are fine only where the crack can go."""
    name, mesh = "graded grid", case.mesh
    lower, upper = (np.asarray(corner, dtype=float) for corner in case.bounding_box())
    if mesh.fine is None or (np.all(lower >= mesh.fine.lower) and np.all(upper <= mesh.fine.upper)):
        return Saving(name, False, f"the spacing is {mesh.h:g} throughout")
    box = {"lower": lower.tolist(), "upper": upper.tolist()}
    where = "mesh.fine and mesh.refine" if mesh.refine else "mesh.fine"
    reason = f"cells are fine only in {where}"
    reason += "; it grows where the crack leaves it" if mesh.follow_crack else ""
    return Saving(name, True, reason, {"mesh": {"fine": box, "refine": [], "follow_crack": False}})


def _adaptive_increments(case: Case) -> Saving:
    name, load = "adaptive increments", case.load
    sizes = " and ".join(f"{size:g}" for size in dict.fromkeys(load.increments or (load.increment,)))
    if len(load.path) < 2 or not load.adaptive or case.staggered.scheme == "passes" or not case.fracture_enabled:
        return Saving(name, False, f"increments are constant, {sizes}")
    reason = f"increments of {sizes} while nothing breaks, down to {load.smallest:g} where it does"
    constant = {"adaptive": False, "increment": load.smallest, "later_increments": [], "control": "displacement"}
    return Saving(name, True, reason, {"load": constant})


def _elastic_prologue(case: Case) -> Saving:
    name, share = "elastic prologue", case.load.prologue
    if share == 0.0:
        return Saving(name, False, "the load path is followed from its start in increments")
    reason = f"the first increment takes {100 * share:g} % of the way to the first target, where nothing breaks"
    return Saving(name, True, reason, {"load": {"prologue": 0.0}})


def _settled_verdict(case: Case) -> Saving:
    name = "end at a settled verdict"
    if case.rocking is None or not case.rocking.stop_when_settled:
        return Saving(name, False, "the run goes on to its end")
    reason = f"the run ends where the verdict on {case.rocking.body} can change no longer"
    return Saving(name, True, reason, {"rocking": {"stop_when_settled": False}})


def _accelerated_staggering(case: Case) -> Saving:
    name, settings = "accelerated staggering", case.staggered
    if settings.scheme == "bfgs" and case.fracture_enabled:
        return Saving(name, False, "displacement and phase field are solved for together")
    if settings.scheme != "converged" or settings.acceleration == "none" or not case.fracture_enabled:
        return Saving(name, False, "the staggered scheme is not iterated, or plainly")
    reason = f"the next phase field is guessed from the last {settings.memory} iterations"
    reason += ", and a crack that runs goes on by its momentum" if settings.acceleration == "momentum" else ""
    return Saving(name, True, reason, {"staggered": {"acceleration": "none"}})


def _end_when_broken(case: Case) -> Saving:
    name, load = "end when broken through", case.load
    if not load.stop_when_broken or not case.fracture_enabled or len(load.path) < 2:
        return Saving(name, False, "the whole load path is followed")
    reason = f"the run ends when the force falls below {load.broken_fraction:g} of its peak"
    return Saving(name, True, reason, {"load": {"stop_when_broken": False}})


def _phase_field_window(case: Case) -> Saving:
    """What changes too little to matter is not solved again in a time step."""
    name, limit = "phase field only where it changes", case.staggered.tolerance
    if not case.fracture_enabled:
        return Saving(name, False, "no material can break")
    reason = f"a step solves it around the cells where it would change by more than {limit:g}"
    return Saving(name, limit > EVERYWHERE, reason, {"staggered": {"tolerance": EVERYWHERE}})


def _rigid_bodies(case: Case) -> Saving:
    name = "rigid bodies"
    rigid = [name for name, body in case.bodies.items() if body.keeps_velocity]
    if not rigid:
        return Saving(name, False, "no body keeps its velocity")
    return Saving(name, True, f"no strains and no forces of {', '.join(rigid)}: kept at its velocity, whatever it meets")


def _rigid_block(case: Case) -> Saving:
    """A body far stiffer than what it stands on moves as a rigid one, so that its waves bound no step."""
    name, free = "rigid block", [name for name, body in case.bodies.items() if body.is_free_rigid]
    if free:
        longer = 1.0 / _longer_step(case, dict.fromkeys(free, False))
        reason = f"{', '.join(free)} moves freely without strains; those would need a step {longer:.2g} times shorter"
        return Saving(name, True, reason, {"bodies": {each: {"rigid": False} for each in free}})
    if case.run and SOLVERS[case.run_spec(case.run).solver].of_rigid_block:
        return Saving(name, False, "the solver knows no other block")
    if case.dynamics is not None and case.dynamics.time_step is not None:
        return Saving(name, False, "the time step is given")
    for stiff, body in case.bodies.items():
        others = any(other.deforms for other_name, other in case.bodies.items() if other_name != stiff)
        if body.deforms and others and not (case.materials[body.material].fracture or any(what_reaches(case, stiff))):
            longer = _longer_step(case, {stiff: "free"})
            if longer > MUCH_LONGER:
                reason = f"{stiff} is so stiff that without its strains the step would be {longer:.2g} times longer"
                return Saving(name, False, f'{reason}; for that write bodies.{stiff}.rigid = "free"')
    return Saving(name, False, "no body that moves freely and cannot break bounds the step")


def _longer_step(case: Case, rigid: dict[str, Any]) -> float:
    """By how much the step by the case's rule grows where bodies are rigid so."""
    from mpm.explicit.step_bound import stable_step  # judging does without compiled laws

    bodies = {name: body.model_copy(update={"rigid": rigid.get(name, body.rigid)}) for name, body in case.bodies.items()}
    return stable_step(case.model_copy(update={"bodies": bodies})) / stable_step(case)


def _no_phase_field(case: Case) -> Saving:
    name = "no phase field where nothing breaks"
    whole = [name for name, body in case.bodies.items() if case.materials[body.material].fracture is None]
    if not whole:
        return Saving(name, False, "every body can break")
    return Saving(name, True, f"none is solved in {', '.join(whole)}, which cannot break")


#: growth of the time step from which on a rigid body is worth a word
MUCH_LONGER = 2.0
#: a tolerance of the moving phase field that leaves nothing out
EVERYWHERE = 1e-12
Rule = Callable[[Case], Saving]
#: a further saving is one more function of the case
QUASI_STATIC: tuple[Rule, ...] = (
    _graded_grid,
    _elastic_prologue,
    _adaptive_increments,
    _accelerated_staggering,
    _end_when_broken,
)
IN_TIME: tuple[Rule, ...] = (_graded_grid, _phase_field_window, _rigid_bodies, _rigid_block, _settled_verdict)
ALWAYS: tuple[Rule, ...] = (_no_phase_field,)
