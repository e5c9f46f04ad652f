"""Rules that look across the tables of a case; each raises BrokenRuleError for the first thing that breaks it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import permutations, product
from typing import Any

import numpy as np
import shapely

from cases.errors import BrokenRuleError
from cases.geometry import SLACK, rounding_of, slack_of
from cases.judging import Check
from cases.load_rules import follows_load, loads_fit_dynamics, loads_fit_statics
from cases.notches import CellsNotch
from cases.schema import CaseDescription, changeable_tables
from cases.solvers import SOLVERS
from cases.splits import PLANE_STRESS_SPLITS, ROOTED_SPLITS
from cases.studies import Map, Varied
from cases.table import nearest, only_known

# Cells of spacing h in one direction; more is a slip of the pen.
MOST_CELLS = 100_000
# Rounding of coordinates beyond this share of h would part what is joined.
_FAR = 1e-6
# Bodies overlap when they share more than this part of the smaller one; those from mesh files, whose edges cut circles
# short, where they share what is wider than twice this part of h.
_OVERLAP, _DEPTH = 1e-6, 0.1
#: tables, or keys of them, that finite elements do not look at
OF_POINTS = ("mpm", "contact", *(f"dynamics.{key}" for key in ("affine", "flip", "order_of_update", "rotation")))
# Largest stiffness over smallest; forces of the softer body would be told from the rounding of the harder one's.
_LARGEST_CONTRAST = 1e8
#: solvers of a block whose base stays where it is
_NEVER_SLIDE = ("pendulum", "pendulum_linear")
#: keys that explicit integration does not look at, with the value that says what it does, None where none does
WITHOUT_EFFECT: dict[str, Any] = {
    "mesh.geometry": "initial",
    "mesh.follow_crack": False,
    "mesh.locking_free": False,
    "mpm.constraints_on": "edges",
    "mpm.penalty": None,
    "mpm.strain": "updated",
    "mpm.move_points": True,
    "mpm.fill_cells": False,
    "mpm.margin": None,
    "mpm.linear_solver": "direct",
    "staggered.scheme": "passes",
    "staggered.residual_tolerance": None,
    "staggered.acceleration": None,
    "staggered.memory": None,
    "staggered.largest_iterations": None,
}


def fit_together(case: CaseDescription, checks: Sequence[tuple[int, Check]]) -> None:
    """Raise BrokenRuleError where tables contradict each other; ``checks`` are those that apply, with their numbers."""
    _names_are_defined(case)
    _is_static_or_dynamic(case)
    _stiffnesses_apply(case)
    _stiffnesses_are_comparable(case)
    _length_scales_are_resolved(case)
    _basis_is_smooth_enough(case)
    _bodies_are_apart(case)
    _notches_are_in_bodies(case)
    _slits_are_drawn_once(case)
    _notches_leave_bodies(case)
    _cracks_are_where_material_breaks(case)
    _spacing_fits_the_bodies(case)
    _placement_has_a_mesh(case)
    _rocking_is_of_a_block(case)
    _parts_are_of_bodies(case)
    _runs_change_what_acts(case)
    _checks_have_targets(case, checks)
    _studies_vary_runs(case)


def _names_are_defined(case: CaseDescription) -> None:
    for name, body in case.bodies.items():
        _defined(body.material, list(case.materials), f"bodies.{name}.material", "material")
    prescribed = set()
    for number, constraint in enumerate(case.constraints):
        _defined(constraint.on, list(case.boundaries), f"constraints[{number}].on", "boundary")
        if (constraint.on, constraint.direction) in prescribed:
            text = f"prescribes direction {constraint.direction} of '{constraint.on}' again"
            raise BrokenRuleError(text, "remove one of the two", f"constraints[{number}]")
        prescribed.add((constraint.on, constraint.direction))
    for number, traction in enumerate(case.tractions):
        _defined(traction.on, list(case.boundaries), f"tractions[{number}].on", "boundary")
    for key in ("body_forces", "eigenstrains"):
        for number, item in enumerate(getattr(case, key)):
            if item.on is not None:
                _defined(item.on, list(case.bodies), f"{key}[{number}].on", "body")
    if case.contact.normals_of is not None:
        _defined(case.contact.normals_of, list(case.bodies), "contact.normals_of", "body")
    pairs = [frozenset(pair.bodies) for pair in case.contact.pairs]
    for number, pair in enumerate(case.contact.pairs):
        for name in pair.bodies:
            _defined(name, list(case.bodies), f"contact.pairs[{number}].bodies", "body")
        if len(pairs[number]) == 1 or pairs[number] in pairs[:number]:
            text = "stands there already" if len(pairs[number]) > 1 else "is a body and itself"
            raise BrokenRuleError(text, "name each pair once", f"contact.pairs[{number}].bodies", list(pair.bodies))


def _is_static_or_dynamic(case: CaseDescription) -> None:
    if ("load" in case.model_fields_set) == (case.dynamics is not None):
        has = "both" if case.dynamics else "neither"
        raise BrokenRuleError(
            f"has {has} of the tables load and dynamics", "give one of them", "load" if case.dynamics else ""
        )
    (_fits_dynamics if case.dynamics else _fits_statics)(case)


def _acceleration_applies(case: CaseDescription) -> None:
    settings = case.staggered
    if settings.scheme == "passes" and "acceleration" in settings.model_fields_set:
        remedy = 'remove it or give staggered.scheme = "converged"'
        text = "has no effect: a fixed number of passes is not accelerated"
        raise BrokenRuleError(text, remedy, "staggered.acceleration", settings.acceleration)


def _schemes_apply(case: CaseDescription) -> None:
    for name, material in case.materials.items():
        if case.staggered.scheme == "bfgs" and material.fracture and material.fracture.functional == "AT1":
            text = f"knows no bound c <= 1, as materials.{name}.fracture.functional = 'AT1' needs"
            raise BrokenRuleError(text, 'give "converged"', "staggered.scheme", "bfgs")


def _fits_statics(case: CaseDescription) -> None:
    moving = [f"constraints[{n}].velocity" for n, c in enumerate(case.constraints) if c.velocity is not None]
    for name, body in case.bodies.items():
        moving += [f"bodies.{name}.rigid"] if not body.deforms else []
        moving += [f"bodies.{name}.{key}" for key in ("velocity", "velocity_gradient") if np.any(getattr(body, key))]
    moving += ["contact"] if "contact" in case.model_fields_set else []
    moving += ["output.times"] if case.output.times or case.output.frames else []
    if moving:
        raise BrokenRuleError("acts in dynamics only", "remove it or give the table dynamics", moving[0])
    loads_fit_statics(case)
    _acceleration_applies(case)
    _schemes_apply(case)
    if len(case.load.path) > 1 and case.exact is None and not follows_load(case):
        remedy = (
            'add a constraint with scale = 1, or a motion, on the boundary that the load moves, or give what acts'
            ' ramp = "load"'
        )
        raise BrokenRuleError("moves nothing: no constraint follows the load parameter", remedy, "load.path")
    if case.load.path == (0.0,) and (case.moved_by_load or case.loaded_by_factor):
        raise BrokenRuleError("stays at 0, where nothing has moved", "give a second value", "load.path", [0.0])


def _fits_dynamics(case: CaseDescription) -> None:
    for name in {body.material: None for body in case.bodies.values()}:
        if case.materials[name].density is None:
            raise BrokenRuleError("is missing", "add it, since dynamics needs mass", f"materials.{name}.density")
    if not any(body.deforms for body in case.bodies.values()):
        name, body = next(iter(case.bodies.items()))
        text = "leaves nothing that deforms" if body.is_free_rigid else "leaves nothing that moves freely"
        raise BrokenRuleError(text, "give rigid = false", f"bodies.{name}.rigid", body.rigid)
    _free_rigid_bodies_are_free(case)
    loads_fit_dynamics(case)
    for number, constraint in enumerate(case.constraints):
        if constraint.velocity is None and constraint.value is None and constraint.table is None:
            text = "does not apply in dynamics"
            raise BrokenRuleError(text, "give value = 0, a velocity or a table", f"constraints[{number}]")
        if constraint.value and constraint.direction != "phase":
            remedy = "give value = 0, a velocity or a table"
            raise BrokenRuleError("is a jump in time", remedy, f"constraints[{number}].value", constraint.value)
    if case.dynamics and case.dynamics.settling and any(c.velocity for c in case.constraints):
        number = next(number for number, c in enumerate(case.constraints) if c.velocity)
        remedy = "remove it or dynamics.settling"
        raise BrokenRuleError("moves while bodies settle", remedy, f"constraints[{number}].velocity")
    if case.output.snapshots:
        raise BrokenRuleError("are load parameters", "give output.times instead", "output.snapshots")
    _is_not_passed_over(case)


def _free_rigid_bodies_are_free(case: CaseDescription) -> None:
    """No constraint and no traction reaches a body that moves as a rigid one."""
    for name, body in case.bodies.items():
        for key, on in what_reaches(case, name) if body.is_free_rigid and body.shape else ():
            text = f"reaches the rigid body '{name}', which moves as gravity and contact alone have it"
            remedy = f"choose a boundary away from it, or give bodies.{name}.rigid = false"
            raise BrokenRuleError(text, remedy, key, on)


def what_reaches(case: CaseDescription, name: str) -> Iterator[tuple[str, str]]:
    """Keys and boundaries of the constraints and tractions on the outline of a body, found at places h apart."""
    places = shapely.get_coordinates(case.bodies[name].outline().segmentize(case.mesh.h))
    slack, box = slack_of(case.bounding_box()), case.bounding_box()
    for key in ("constraints", "tractions"):
        for number, item in enumerate(getattr(case, key)):
            if case.boundaries[item.on].select(places, slack, box).any():
                yield f"{key}[{number}].on", item.on


def _is_not_passed_over(case: CaseDescription) -> None:
    """Nothing in a dynamic case asks for what will not be done."""
    for key, done in WITHOUT_EFFECT.items():
        table, name = key.split(".")
        value = getattr(getattr(case, table), name)
        if name in getattr(case, table).model_fields_set and value != done:
            remedy = "remove it" if done is None else f"remove it or give {json.dumps(done)}"
            raise BrokenRuleError("has no effect in dynamics", remedy, key, value)
    assert case.dynamics is not None
    end = case.dynamics.end_time
    for number, time in enumerate(case.output.times):
        if time > end * (1.0 + SLACK):
            remedy = f"give a time up to dynamics.end_time = {end:g}"
            raise BrokenRuleError("comes after the end", remedy, f"output.times[{number}]", time)


def _stiffnesses_apply(case: CaseDescription) -> None:
    for name in {body.material: None for body in case.bodies.values()}:
        stiffness, fracture = case.materials[name].stiffness, case.materials[name].fracture
        if stiffness is not None and stiffness.is_engineering and case.plane.assumption == "strain":
            remedy = 'give C11, C22, C66, C12 of plane strain, or plane.assumption = "stress"'
            raise BrokenRuleError(
                "has engineering constants, which leave plane strain open", remedy, f"materials.{name}.stiffness"
            )
        if fracture is not None and fracture.split in PLANE_STRESS_SPLITS and case.plane.assumption != "stress":
            remedy = f'give "{fracture.split.removesuffix("_plane_stress")}", which is the same there'
            key = f"materials.{name}.fracture.split"
            raise BrokenRuleError("applies in plane stress only", remedy, key, fracture.split)
        if case.dynamics is None:
            continue
        if stiffness is not None:
            remedy = "give an isotropic pair, or the table load instead of dynamics"
            raise BrokenRuleError("applies in quasi-static cases only", remedy, f"materials.{name}.stiffness")
        if fracture is not None and fracture.split in ROOTED_SPLITS:
            remedy = "give another split, or the table load instead of dynamics"
            key = f"materials.{name}.fracture.split"
            raise BrokenRuleError("applies in quasi-static cases only", remedy, key, fracture.split)
        if fracture is not None and fracture.functional == "AT1":
            remedy = 'give "AT2", or the table load instead of dynamics'
            key = f"materials.{name}.fracture.functional"
            raise BrokenRuleError("applies in quasi-static cases only", remedy, key, fracture.functional)


def _stiffnesses_are_comparable(case: CaseDescription) -> None:
    if case.load is None:
        return
    names = {body.material for body in case.bodies.values()}
    moduli = {name: case.materials[name].mu for name in names if not case.materials[name].is_anisotropic}
    if not moduli:
        return
    softest, hardest = (extreme(sorted(moduli), key=moduli.__getitem__) for extreme in (min, max))
    least = moduli[hardest] / _LARGEST_CONTRAST
    if moduli[softest] < least:
        text = f"is more than {_LARGEST_CONTRAST:.0f} times softer than {hardest}: its forces would be lost in rounding"
        remedy = f"give it a shear modulus of {least:.3g} or more, or leave its bodies out"
        raise BrokenRuleError(text, remedy, f"materials.{softest}")


def _length_scales_are_resolved(case: CaseDescription) -> None:
    for name, material in case.materials.items():
        if case.mesh.under_resolved or material.fracture is None:
            continue
        if material.fracture.length_scale < case.mesh.h:
            remedy = f"make mesh.h = {case.mesh.h:g} no more than the length scale"
            key = f"materials.{name}.fracture.length_scale"
            raise BrokenRuleError(
                "is below the mesh spacing", remedy, key, material.fracture.length_scale
            )


def _basis_is_smooth_enough(case: CaseDescription) -> None:
    if case.mpm.order > 1:
        return
    for name, material in case.materials.items():
        if material.fracture is not None and material.fracture.order == 4:
            text = f"has no second derivatives, which materials.{name}.fracture.order = 4 asks for"
            raise BrokenRuleError(text, "set it to 2 or 3", "mpm.order", case.mpm.order)


def _bodies_are_apart(case: CaseDescription) -> None:
    names, bodies = list(case.bodies), list(case.bodies.values())
    outlines = [body.outline() for body in bodies]
    pairs = shapely.STRtree(outlines).query(np.array(outlines, dtype=object), "intersects").T
    for first, second in sorted(pairs[pairs[:, 0] < pairs[:, 1]].tolist()):
        a, b = outlines[first], outlines[second]
        common, from_file = a.intersection(b), bodies[first].mesh or bodies[second].mesh
        if from_file:
            common = common.buffer(-_DEPTH * case.mesh.h)
        if common.area > _OVERLAP * min(a.area, b.area):
            remedy = "move them apart" + ("" if from_file else " or cut one out of the other with 'difference'")
            raise BrokenRuleError(f"overlaps the body '{names[first]}'", remedy, f"bodies.{names[second]}")


def _notches_are_in_bodies(case: CaseDescription) -> None:
    if any(body.mesh for body in case.bodies.values()):
        return  # reading meshes is left to whoever needs them
    # a slit may go on through a gap that is narrower than the cells, such as a notch that tapers
    outlines = [body.shape.outline() for body in case.bodies.values() if body.shape]
    whole, slack = shapely.union_all(outlines), slack_of(case.bounding_box())
    hull, inside = whole.convex_hull.buffer(slack), whole.buffer(-slack)
    for number, notch in enumerate(case.notches):
        for end, point in (("start", notch.start), ("end", notch.end)):
            if not hull.covers(shapely.Point(point)):
                key = f"notches[{number}].{end}"
                raise BrokenRuleError(
                    "lies outside the bodies", "move it into or onto one", key, list(point)
                )
        line = shapely.LineString([notch.start, notch.end])
        if notch.kind == "slit" and not inside.intersection(line).length:
            text = f"from {list(notch.start)} to {list(notch.end)} lies on an edge or in a gap, where it parts nothing"
            raise BrokenRuleError(text, "move it into a body", f"notches[{number}]")


def _slits_are_drawn_once(case: CaseDescription) -> None:
    slits = [(number, notch) for number, notch in enumerate(case.notches) if notch.kind == "slit"]
    for (one, slit), (other, longer) in permutations(slits, 2):
        if slit.lies_on(longer):
            raise BrokenRuleError(f"lies on notches[{other}]", "remove one of the two", f"notches[{one}]")


def _notches_leave_bodies(case: CaseDescription) -> None:
    """Cells that are left out do not take all of a body."""
    notches = [notch for notch in case.notches if isinstance(notch, CellsNotch)]
    if not notches:
        return
    lines = [shapely.LineString([notch.start, notch.end]).buffer(notch.width / 2, cap_style="flat") for notch in notches]
    left_out = shapely.union_all(lines).buffer(slack_of(case.bounding_box()))
    for name, body in case.bodies.items():
        if body.shape and left_out.covers(body.shape.outline()):
            raise BrokenRuleError("is left out by the notches", "make them narrower or shorter", f"bodies.{name}")


def _cracks_are_where_material_breaks(case: CaseDescription) -> None:
    """A crack that the phase field draws needs a body with one."""
    breaking = [body for body in case.bodies.values() if case.materials[body.material].fracture]
    phase = next((n for n, c in enumerate(case.constraints) if c.direction == "phase"), None)
    if phase is not None and not breaking:
        text, remedy = "acts on nothing, since nothing can break", "give a material the table fracture, or remove it"
        raise BrokenRuleError(text, remedy, f"constraints[{phase}].direction", "phase")
    if any(body.mesh for body in breaking):
        return  # reading meshes is left to whoever needs them
    whole = [body.shape.outline() for body in case.bodies.values() if body.shape and body not in breaking]
    outline, beside = (shapely.union_all(shapes) for shapes in ([b.shape.outline() for b in breaking if b.shape], whole))
    for number, notch in enumerate(case.notches):
        line = shapely.LineString([notch.start, notch.end])
        unbroken = line.intersection(beside.difference(outline)).length
        if notch.kind == "history" and (not outline.intersects(line) or unbroken > case.mesh.h):
            remedy = 'give kind = "slit" or "cells", or its material the table fracture'
            text = "draws a history field where the material cannot break"
            raise BrokenRuleError(text, remedy, f"notches[{number}].kind", "history")


def _spacing_fits_the_bodies(case: CaseDescription) -> None:
    lower, upper = case.bounding_box()
    if np.min(upper - lower) < case.mesh.h * (1.0 - SLACK):
        size = " x ".join(f"{side:.3g}" for side in upper - lower)
        text = f"is larger than the bodies, which are {size} {case.units.length}"
        remedy = f"make it smaller, or give coordinates in {case.units.length}"
        raise BrokenRuleError(text, remedy, "mesh.h", case.mesh.h)
    far = np.abs((lower, upper)).max() > 10.0 * np.max(upper - lower)
    if far and rounding_of((lower, upper)) > _FAR * case.mesh.h:
        text = f"is too small for bodies that lie as far from the origin as {upper.tolist()}: rounding moves their places"
        raise BrokenRuleError(text, "move the bodies nearer to the origin", "mesh.h", case.mesh.h)
    if any(body.mesh for body in case.bodies.values()):
        return
    if case.mesh.fine is not None:
        remedy = f"place it inside {lower.tolist()} to {upper.tolist()}"
        for number, box in enumerate(case.mesh.refine):
            if np.any(np.asarray(box.upper) < lower) or np.any(np.asarray(box.lower) > upper):
                raise BrokenRuleError("lies outside the bodies", remedy, f"mesh.refine[{number}]")
        lower, upper = np.maximum(lower, case.mesh.fine.lower), np.minimum(upper, case.mesh.fine.upper)
        if np.any(lower >= upper):
            raise BrokenRuleError("lies outside the bodies", remedy, "mesh.fine")
    if np.max(upper - lower) > MOST_CELLS * case.mesh.h:
        text = f"asks for more than {MOST_CELLS} cells in one direction"
        raise BrokenRuleError(text, "give a larger spacing or a smaller fine box", "mesh.h", case.mesh.h)


def _rocking_is_of_a_block(case: CaseDescription) -> None:
    """The table rocking names a rectangle under gravity, and whatever needs the table has it."""
    rigid = next((name for name, spec in case.run_specs().items() if SOLVERS[spec.solver].of_rigid_block), None)
    ground = case.dynamics.ground if case.dynamics else None
    ratio = ground and next((key for key in ("uplift_ratio", "frequency_ratio") if getattr(ground, key)), None)
    if case.rocking is None:
        if rigid or ratio:
            text = f"is missing, which {rigid or ratio} needs"
            raise BrokenRuleError(text, "name the body that rocks in it", "rocking")
        return
    names = list(case.bodies)
    _defined(case.rocking.body, names, "rocking.body", "body")
    _defined(case.rocking.on or names[0], names, "rocking.on", "body")
    shape = case.bodies[case.rocking.body].shape
    if shape is None or shape.rectangle is None:
        raise BrokenRuleError("is no rectangle", "name a body of that shape", "rocking.body", case.rocking.body)
    if case.dynamics is None:
        raise BrokenRuleError("applies in dynamics only", "remove it or give the table dynamics", "rocking")
    if case.dynamics.gravity[0] != 0.0 or case.dynamics.gravity[1] >= 0.0:
        remedy = "let it act along -y"
        raise BrokenRuleError("is not that of a block that rocks", remedy, "dynamics.gravity", case.dynamics.gravity)
    slides = any(spec.solver not in _NEVER_SLIDE for spec in case.run_specs().values())
    if ground and ground.direction == "x" and slides:
        _rocks_before_it_slides(case, names)


def _rocks_before_it_slides(case: CaseDescription, names: list[str]) -> None:
    """Friction on the base carries the push that lifts the block on a ground that moves horizontally."""
    assert case.rocking is not None
    body, base = names.index(case.rocking.body), names.index(case.rocking.on or names[0])
    width, height = np.subtract(*case.bodies[case.rocking.body].bounds()[::-1])
    friction = case.friction(body, base)
    if body != base and friction <= width / height:
        text = f"lets {case.rocking.body} slide before it can rock"
        remedy = f"make that of both bodies more than its width over its height, {width / height:.4g}"
        raise BrokenRuleError(text, remedy, "contact.friction", friction)


def _placement_has_a_mesh(case: CaseDescription) -> None:
    if case.mpm.placement != "mesh":
        return
    shaped = next((name for name, body in case.bodies.items() if body.mesh is None), None)
    if case.dynamics is not None or shaped:
        text = f"needs a mesh file, which bodies.{shaped} has not" if shaped else "applies in quasi-static cases only"
        raise BrokenRuleError(text, 'give "gauss" or "regular"', "mpm.placement", "mesh")
    if case.mpm.fill_cells and "fill_cells" in case.mpm.model_fields_set:
        text = "has no effect on the points of a mesh, which keep the volumes of their cells"
        raise BrokenRuleError(text, "remove it or give false", "mpm.fill_cells", True)


def _parts_are_of_bodies(case: CaseDescription) -> None:
    """Unbreakable parts are of bodies that break and move; regions are of bodies, and have names of their own."""
    for name, body in case.bodies.items():
        if not body.unbreakable:
            continue
        key = f"bodies.{name}.unbreakable"
        if case.dynamics is None:
            raise BrokenRuleError("applies in dynamics only", "remove it or give the table dynamics", key)
        if case.materials[body.material].fracture is None:
            remedy = f"remove it or give materials.{body.material}.fracture"
            raise BrokenRuleError("is a part of a body that cannot break anyway", remedy, key)
        for number, part in enumerate(body.unbreakable if body.shape else ()):
            if not part.outline().intersection(body.outline()).area:
                raise BrokenRuleError("covers nothing of the body", "move it or remove it", f"{key}[{number}]")
    if case.output.regions and case.dynamics is None:
        raise BrokenRuleError("are told of in dynamics only", "remove them or give the table dynamics", "output.regions")
    for name, region in case.output.regions.items():
        _defined(region.body, list(case.bodies), f"output.regions.{name}.body", "body")
        if name in case.bodies:
            raise BrokenRuleError("has the name of a body", "call it otherwise", f"output.regions.{name}")


def _runs_change_what_acts(case: CaseDescription) -> None:
    """Runs of finite elements that differ in what material points alone look at would be the same."""
    of_fem = ((family, run) for family, run in case.runs.items() if run.solver == "fem")
    for (family, run), key in product(of_fem, OF_POINTS):
        table, _, name = key.partition(".")
        swept = next((one for one in run.sweep if one == key or one.startswith(f"{key}.")), None)
        if swept or (table in run.change and (not name or name in run.change[table])):
            where = f'sweep."{swept}"' if swept else f"change.{key}"
            remedy = 'remove it, or give solver = "mpm"'
            raise BrokenRuleError("has no effect on finite elements", remedy, f"runs.{family}.{where}")


def _checks_have_targets(case: CaseDescription, checks: Sequence[tuple[int, Check]]) -> None:
    runs = list(dict.fromkeys([*case.runs, *case.expanded_runs()]))
    for number, check in checks:
        _defined(check.run, runs, f"checks[{number}].run", "run")
        kind, name = check.target
        if kind == "run":
            key = f"checks[{number}].against"
            if name in case.references and name not in runs:
                raise BrokenRuleError("is a reference, not a run", f'write "reference:{name}"', key, name)
            _defined(name, runs, key, "run")
            if name == check.run:
                raise BrokenRuleError("is the run that is checked", "name another one, or a value", key, name)
        if kind == "reference":
            _reference_has_the_metric(case, name, check.metric, f"checks[{number}].against")
        if kind == "exact" and case.exact is None and not any(c.motion for c in case.constraints):
            key = f"checks[{number}].against"
            raise BrokenRuleError(
                "has no exact solution to compare with", "add the key 'exact'", key, check.against
            )


def _reference_has_the_metric(case: CaseDescription, name: str, metric: str, key: str) -> None:
    _defined(name, list(case.references), key, "reference", f"reference:{name}")
    reference = case.references[name]
    if metric not in reference.values and reference.curve is None:
        remedy = f"add {metric} to references.{name}.values, or a curve"
        raise BrokenRuleError(f"has no value of {metric}", remedy, key, f"reference:{name}")


def _studies_vary_runs(case: CaseDescription) -> None:
    for name, chart in case.charts.items():
        only_known(chart.change, changeable_tables(), f"charts.{name}.change", "may not be varied")
        varied: dict[str, Varied] = {f"ladders.{key}": ladder for key, ladder in chart.ladders.items()}
        varied |= {"reference": chart.reference} if chart.reference else {}
        for key, table in varied.items():
            _varies_a_run(case, table, f"charts.{name}.{key}")
    for name, chosen in case.maps.items():
        if chosen.run is not None:
            _varies_a_run(case, chosen, f"maps.{name}")


def _varies_a_run(case: CaseDescription, varied: Varied | Map, place: str) -> None:
    _defined(str(varied.run), case.expanded_runs(), f"{place}.run", "run")
    only_known(varied.change, changeable_tables(), f"{place}.change", "may not be varied")
    tables = {key.partition(".")[0]: None for key in varied.varied_keys()}
    only_known(tables, changeable_tables(), place, "may not be varied")


def _defined(name: str, known: list[str], key: str, what: str, value: str | None = None) -> None:
    if name not in known:
        remedy = nearest(name, known, f"define the {what}")
        raise BrokenRuleError(f"is not a {what} of this case", remedy, key, value or name)
