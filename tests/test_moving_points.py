"""The explicit material point method: bases, steps, rotation, contact, resuming, errors."""

import numba
import numpy as np
import pytest

from cases import Case, CaseError, case_from_tables
from mpm import ExplicitMaterialPoints
from mpm.explicit import moving_body
from mpm.explicit.cell_splines import spline_values
from mpm.explicit.contact import COUNTERS
from mpm.explicit.moving_body import MovingBody
from mpm.explicit.step_bound import LARGEST_GRADIENT, largest_eigenvalue, proven_step, stable_step
from mpm.explicit.stresses import turned_strain
from numerics.explicit import instants
from numerics.threads import use_threads
from numerics.time_steps import courant_step
from verify import run

STEEL = {"young": 1.0, "poisson": 0.3, "density": 1.0}


def square(left: float, **more) -> dict:
    """A square of side one, its lower left corner at (left, 0)."""
    return {"material": "soft", "shape": {"rectangle": {"lower": [left, 0.0], "upper": [left + 1.0, 1.0]}}, **more}


def case_of(bodies: dict, end_time: float = 1.0, **more) -> Case:
    tables = {
        "title": "t", "requirement": "r", "units": {"length": "mm", "force": "kN", "time": "ms"},
        "plane": {"assumption": "strain"}, "materials": {"soft": STEEL}, "bodies": bodies,
        "dynamics": {"end_time": end_time, **more.pop("dynamics", {})}, "mesh": {"h": more.pop("h", 0.25)},
        "mpm": {"placement": "regular", "points_per_cell": 3, **more.pop("mpm", {})},
        "runs": {"mpm": {"solver": "mpm"}}, **more,
    }  # fmt: skip
    return case_from_tables(tables, "standard", "mpm")


def sharpest(order: int, xi: np.ndarray) -> np.ndarray:
    """Sum of (dN/dx)² / N of the splines of a cell by differences."""
    step = 1e-6
    values = np.array([spline_values(order, x) for x in xi])
    slopes = np.array([(spline_values(order, x + step) - spline_values(order, x - step)) / (2 * step) for x in xi])
    return (slopes**2 / values).sum(axis=1)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_splines_sum_to_one_and_reproduce_places(order):
    for xi in (0.0, 0.3, 0.999):
        value = spline_values(order, xi)
        places = np.arange(order + 1) - 0.5 * (order - 1)
        assert value.sum() == pytest.approx(1.0, abs=1e-14)
        assert value @ places == pytest.approx(xi, abs=1e-14)


@pytest.mark.parametrize("order", [2, 3])
def test_the_sharpest_gradient_is_the_bound(order):
    found = sharpest(order, np.linspace(1e-3, 1.0 - 1e-3, 2000)).max()
    assert LARGEST_GRADIENT[order] * 0.995 < found <= LARGEST_GRADIENT[order] * (1 + 1e-6)


def eigenvalue_of_cloud(body: MovingBody) -> float:
    """Largest eigenvalue of M⁻¹ K of a body's points, K by forces of unit displacements."""
    motion, sums, velocities = body.points.motion, body.window.sums, body.window.velocities
    body.map_to_grid()
    used = np.flatnonzero(sums.m)
    mass, columns = np.repeat(sums.m[used], 2), []
    for node in used:
        for velocity in (velocities.vx, velocities.vy):
            for strain in body.points.elastic[:3]:
                strain[:] = 0.0
            motion.moved_x[:], motion.moved_y[:] = 0.0, 0.0
            velocities.vx[:], velocities.vy[:] = 0.0, 0.0
            velocity[node] = 1.0
            body.update_stresses(1.0)
            body.map_to_grid()
            columns.append(-sums.fields.reshape(-1, 4)[used, 2:].ravel())
    root = 1.0 / np.sqrt(mass)
    stiffness = np.array(columns).T
    return float(np.linalg.eigvalsh(0.5 * (stiffness + stiffness.T) * np.outer(root, root)).max())


@pytest.mark.parametrize(("order", "seed"), [(2, 0), (2, 1), (3, 2)])
def test_no_random_cloud_exceeds_the_proven_eigenvalue(order, seed):
    mpm = {"placement": "random", "points_per_cell": 1, "seed": seed, "order": order}
    case = case_of({"a": square(0.0)}, mpm=mpm, dynamics={"rotation": "additive"})
    body = ExplicitMaterialPoints(case).bodies[0]
    lam, mu = 0.3 / (1.3 * 0.4), 0.5 / 1.3
    bound = largest_eigenvalue(order, 0.25, lam, mu, 1.0)
    found = eigenvalue_of_cloud(body)
    assert 0.3 * bound < found <= bound


def test_the_bound_is_that_of_plane_strain():
    """0.816 sqrt(1 - nu) h / c of quadratic splines, less by sqrt(2) where the points lose motion to the grid."""
    bound = 2 / np.sqrt(6) * np.sqrt(0.7) * 0.25 / np.sqrt(0.7 / (1.3 * 0.4))
    body = {"a": square(0.0)}
    assert proven_step(case_of(body)) == pytest.approx(bound / np.sqrt(2), rel=1e-12)
    assert proven_step(case_of(body, dynamics={"affine": True})) == pytest.approx(bound, rel=1e-12)
    assert proven_step(case_of(body, dynamics={"order_of_update": "musl"})) == pytest.approx(bound, rel=1e-12)


def test_gradients_that_are_never_updated_are_refused():
    with pytest.raises(CaseError, match="unstable at any step with the affine map"):
        case_of({"a": square(0.0)}, dynamics={"affine": True, "order_of_update": "musl"})


def test_hat_functions_have_no_bound():
    with pytest.raises(CaseError, match="courant"):
        proven_step(case_of({"a": square(0.0)}, mpm={"order": 1}))
    with pytest.raises(CaseError, match=r'give mpm\.order = 2 or 3, time_step_rule = "courant", or a time_step'):
        ExplicitMaterialPoints(case_of({"a": square(0.0)}, mpm={"order": 1}))
    for dynamics in ({"time_step": 1e-3}, {"time_step_rule": "courant"}):
        case = case_of({"a": square(0.0)}, mpm={"order": 1}, dynamics=dynamics)
        assert ExplicitMaterialPoints(case).stable_step() == pytest.approx(courant_step(case))


@pytest.mark.parametrize(("corotational", "expected"), [(True, (0.0, 1e-3, 0.0)), (False, (1e-3, 0.0, 0.0))])
def test_strain_of_a_body_that_turns_by_ninety_degrees(corotational, expected):
    """Each step is an exact turn: the corotational strain goes with it, the additive one dilates and stays behind."""
    steps = 90
    angle = 0.5 * np.pi / steps
    turn = np.array([[np.cos(angle) - 1.0, -np.sin(angle)], [np.sin(angle), np.cos(angle) - 1.0]])
    strain = (1e-3, 0.0, 0.0)
    for _ in range(steps):
        strain = turned_strain(*strain, *turn.ravel(), corotational)
    if corotational:
        np.testing.assert_allclose(strain, expected, atol=1e-14)
    else:
        shrunk = steps * (np.cos(angle) - 1.0)
        np.testing.assert_allclose(strain, np.add(expected, (shrunk, shrunk, 0.0)), atol=1e-14)


def approach(by_distance: bool, h: float = 0.25) -> float:
    """Distance of two squares when they first push, in cells."""
    bodies = {"a": square(0.0, velocity=[0.05, 0.0]), "b": square(2.0, velocity=[-0.05, 0.0])}
    case = case_of(bodies, 12.0, h=h, contact={"by_distance": by_distance}, output={"records": 400})
    for instant in instants(ExplicitMaterialPoints(case), case):
        if instant.columns["b_impulse_x"] > 0.0:
            return (1.0 - 0.1 * instant.time) / h
    raise AssertionError("they never met")


def test_bodies_push_when_they_touch_and_not_a_cell_before():
    assert abs(approach(by_distance=True)) < 0.2
    assert approach(by_distance=False) > 1.0


def collision(threads: int = 1, h: float = 0.25, end_time: float = 6.0) -> tuple[dict, list[dict]]:
    """State at the end, with the counts of contact, and the history without its seconds."""
    bodies = {
        "a": {"material": "soft", "shape": {"disc": {"centre": [0.0, 0.0], "radius": 1.0}}, "velocity": [0.02, 0.0]},
        "b": {"material": "soft", "shape": {"disc": {"centre": [2.05, 0.6], "radius": 1.0}}, "velocity": [-0.02, 0.0]},
    }
    case = case_of(bodies, end_time, h=h, contact={"friction": 0.3}, mpm={"placement": "rings"})
    before = numba.get_num_threads()
    use_threads(threads)
    solver = ExplicitMaterialPoints(case)
    rows = [instant.row() | {"seconds": 0.0} for instant in instants(solver, case)]
    use_threads(before)
    return {**solver.checkpoint(), "counts": solver.contact.violations}, rows


def test_free_bodies_keep_their_momentum_and_contact_keeps_its_conditions():
    state, _ = collision()
    x = state["body0_mass"] @ state["body0_vx"] + state["body1_mass"] @ state["body1_vx"]
    y = state["body0_mass"] @ state["body0_vy"] + state["body1_mass"] @ state["body1_vy"]
    assert abs(x) + abs(y) < 1e-14
    assert state["counts"]["contact_nodes"] > 50
    assert not any(state["counts"][f"contact_C{n}"] for n in (2, 3, 4))


def test_going_back_to_a_state_sets_its_counts_back_too():
    bodies = {"a": square(0.0, velocity=[0.05, 0.0]), "b": square(2.0, velocity=[-0.05, 0.0])}
    case = case_of(bodies, 12.0, h=0.25)
    solver = ExplicitMaterialPoints(case)
    list(instants(solver, case))
    before = dict(solver.contact.violations)
    solver.restore(solver.checkpoint())
    assert before["contact_nodes"] > 0 and dict(solver.contact.violations) == before


def test_three_bodies_in_a_row_hand_their_momentum_on():
    bodies = {"a": square(0.0, velocity=[0.1, 0.02]), "b": square(1.1), "c": square(2.2, velocity=[-0.02, 0.0])}
    case = case_of(bodies, 8.0, contact={"friction": 0.2})
    solver = ExplicitMaterialPoints(case)
    rows = [instant.row() for instant in instants(solver, case)]
    for direction, start in (("x", 0.08), ("y", 0.02)):
        assert rows[-1][f"momentum_{direction}"] == pytest.approx(start, rel=1e-12)
        assert sum(rows[-1][f"{body}_impulse_{direction}"] for body in "abc") == pytest.approx(0.0, abs=1e-15)
    assert rows[-1]["c_impulse_x"] > 0.02, "through the one in the middle"
    assert rows[-1]["W_contact"] < 0.0
    assert not any(solver.contact.violations[name] for name in COUNTERS[2:])


@pytest.mark.parametrize("approach", [True, False])
def test_normals_that_agree_are_counted_where_bodies_approach(approach):
    speed = 0.05 if approach else -0.05
    solver = ExplicitMaterialPoints(case_of({"a": square(0.0, velocity=[speed, 0.0]), "b": square(1.0)}))
    for body in solver.bodies:
        body.map_to_grid()
        body.find_trial_velocities(0.01, np.zeros(2), 0.0)
    solver.contact.detect()
    solver.contact.pairs[0].touching.opposed[:] = False
    solver.contact.exchange(0.01)
    assert solver.contact.violations["contact_C1"] == solver.contact.violations["contact_nodes"]
    assert (solver.contact.violations["contact_C1"] > 0) == approach


@pytest.mark.parametrize("named", [True, False])
def test_the_normal_of_a_named_body_holds_at_the_corner_of_another(named):
    ground = {"material": "soft", "shape": {"rectangle": {"lower": [-2.0, -1.0], "upper": [3.0, 0.0]}}}
    bodies = {"block": square(0.0, velocity=[0.0, -0.05]), "ground": ground}
    solver = ExplicitMaterialPoints(case_of(bodies, contact={"normals_of": "ground"} if named else {}))
    for body in solver.bodies:
        body.map_to_grid()
    solver.contact.detect()
    pair = solver.contact.pairs[0]
    leaning = np.abs(pair.touching.normal[0, : pair.count])
    assert pair.count and bool(leaning.max() < 1e-12) == named


def test_a_rigid_body_pushes_on_and_gives_what_it_does_as_work():
    """A wall that moves drives a square before it: momentum and energy come from outside."""
    bodies = {"wall": square(0.0, rigid=True, velocity=[0.05, 0.0]), "a": square(1.05)}
    case = case_of(bodies, 6.0)
    solver = ExplicitMaterialPoints(case)
    last = list(instants(solver, case))[-1]
    assert last.columns["wall_x"] == pytest.approx(0.5 + 0.05 * 6.0, rel=1e-12)
    given = last.balance.momentum[0]
    assert given > 0.04 and last.columns["a_impulse_x"] == pytest.approx(given, rel=1e-12)
    assert last.balance.external_work == pytest.approx(0.05 * given, rel=1e-12)


def test_further_passes_are_told_and_press_on_a_floor_once():
    shape = {"rectangle": {"lower": [-1.0, -1.0], "upper": [2.0, 0.0]}}
    bodies = {"a": square(0.0), "floor": {"material": "soft", "rigid": True, "shape": shape}}
    loads = []
    for passes in (1, 3):
        more = {"dynamics": {"gravity": [0.0, -0.1]}, "staggered": {"scheme": "passes", "passes": passes}}
        case = case_of(bodies, 2.0, **more)
        solver = ExplicitMaterialPoints(case)
        assert {instant.row()["staggered"] for instant in instants(solver, case)} == {passes}
        loads.append(solver.checkpoint()["contact_last_floor_load"])
    assert loads[0][:, 1].sum() > 0.0
    np.testing.assert_array_equal(*loads)


def test_a_rigid_body_sets_no_time_step():
    stiff = {"materials": {"soft": STEEL, "stiff": STEEL | {"young": 100.0}}}
    floor = square(2.0, rigid=True) | {"material": "stiff"}
    for rule in ("proven", "courant"):
        alone, beside = (
            stable_step(case_of(bodies, dynamics={"time_step_rule": rule}, **stiff))
            for bodies in ({"a": square(0.0)}, {"a": square(0.0), "floor": floor})
        )
        assert beside == alone


def test_bodies_far_apart_fill_no_more_cells():
    case = case_of({"a": square(0.0), "b": square(2e4)})
    solver = ExplicitMaterialPoints(case)
    solver.bodies[1].window.corner = solver.bodies[1].window.corner + 2_000_000_000
    fields = solver.fields()
    assert len(fields.grid_cells) == 2 * 16
    assert fields.grid_points[:64].max() == 1.0 and fields.grid_points[64:].min() >= 5e8


def test_points_spread_over_too_many_nodes_end_the_run_in_a_sentence(monkeypatch, tmp_path):
    case = case_of({"a": square(0.0, velocity_gradient=[[2.0, 0.0], [0.0, 2.0]])}, 4.0)
    monkeypatch.setattr(moving_body, "MOST_NODES", 100)
    done = run(case, "mpm", "standard", tmp_path)
    assert done.info["status"] == "blew_up" and not (done.folder / "traceback.txt").exists()
    assert "points of body 'a' are spread over" in done.info["reason"]
    assert "shorten dynamics.end_time" in done.info["reason"]


def test_a_body_without_points_is_refused():
    inner, outer = ({"disc": {"centre": [2.0, 0.0], "radius": radius}} for radius in (0.09, 0.1))
    ring = {"difference": {"of": outer, "minus": [inner]}}
    case = case_of({"a": square(0.0), "b": {"material": "soft", "shape": ring}}, mpm={"points_per_cell": 1})
    with pytest.raises(CaseError, match=r"bodies.b: it is too thin for points to lie in it; make mesh.h smaller"):
        ExplicitMaterialPoints(case)


def spread_of_speed(flip: float) -> float:
    """Of the points of a square at the end that start with random speeds."""
    case = case_of({"a": square(0.0)}, 0.5, dynamics={"flip": flip})
    solver = ExplicitMaterialPoints(case)
    points = solver.bodies[0].points
    points.motion.vx[:] += 1e-3 * np.random.default_rng(0).standard_normal(len(points.number))
    start = points.matter.mass @ points.motion.vx
    last = list(instants(solver, case))[-1]
    assert last.balance.momentum[0] == pytest.approx(start, rel=1e-12)
    return float(solver.bodies[0].points.motion.vx.std())


def test_flip_keeps_what_pic_smooths():
    pic, blend, flip = (spread_of_speed(share) for share in (0.0, 0.9, 1.0))
    assert pic < 0.5 * blend < 0.4 * flip


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="needs two threads")
@pytest.mark.parametrize(("h", "end_time"), [(0.25, 6.0), (0.03, 0.05)])
def test_one_thread_and_two_give_the_same_bits(h, end_time):
    """The linear algebra shares the sums over the many points of the small spacing out among its threads."""
    (one, rows), (two, others) = collision(1, h, end_time), collision(2, h, end_time)
    assert all(np.array_equal(one[name], two[name], equal_nan=True) for name in one if name != "counts")
    assert rows == others


def test_a_run_that_goes_on_from_a_checkpoint_ends_with_the_same_bits():
    turning = square(0.0, velocity_gradient=[[0.0, -0.3], [0.3, 0.0]])
    case = case_of({"a": turning, "b": square(1.2, velocity=[-0.1, 0.0])}, 4.0)
    straight, first, second = (ExplicitMaterialPoints(case) for _ in range(3))
    whole = list(instants(straight, case))
    for instant in instants(first, case):
        if instant.step >= whole[-1].step // 2:
            second.restore({name: array.copy() for name, array in first.checkpoint().items()})
            break
    rest = list(instants(second, case, instant))
    assert rest[-1].step == whole[-1].step
    end, again = straight.checkpoint(), second.checkpoint()
    assert all(np.array_equal(end[name], again[name], equal_nan=True) for name in end)


def test_a_step_above_the_limit_ends_as_blown_up():
    case = case_of({"a": square(0.0, velocity=[0.01, 0.0], velocity_gradient=[[0.1, 0.0], [0.0, 0.1]])}, 400.0,
                   dynamics={"time_step_share": 3.0})  # fmt: skip
    last = list(instants(ExplicitMaterialPoints(case), case))[-1]
    assert last.status == "blew_up" and last.reason.startswith("step ")
    said = "is 3 times the longest one that is stable by dynamics.time_step_rule"
    assert said in last.reason and last.reason.endswith("leave out dynamics.time_step_share, or lower it")
    assert np.isfinite(last.balance.total)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"materials": {"soft": {"young": 1.0, "poisson": 0.3}}}, "density"),
        ({"load": {"path": [0.0]}}, "load"),
        ({"constraints": [{"on": "left", "direction": "x", "scale": 1.0}]}, "velocity"),
        ({"constraints": [{"on": "left", "direction": "x", "value": 0.1}]}, "jump"),
        ({"output": {"snapshots": [0.1]}}, "output.times"),
        ({"contact": {"pairs": [{"bodies": ["a", "c"], "friction": 0.1}]}}, "not a body"),
        ({"contact": {"pairs": [{"bodies": ["a", "a"], "friction": 0.1}]}}, "is a body and itself; name each pair once"),
        (
            {
                "bodies": {"a": square(0.0), "b": square(3.0)},
                "contact": {"pairs": [{"bodies": two, "friction": 0.1} for two in (["a", "b"], ["b", "a"])]},
            },
            r"'contact.pairs\[1\].bodies' = \['b', 'a'\] stands there already",
        ),
        ({"bodies": {"a": square(0.0), "b": square(0.5)}}, "overlaps"),
        ({"bodies": {"a": square(0.0, rigid=True, velocity_gradient=[[0, 1], [0, 0]])}}, "keeps one velocity"),
        ({"bodies": {"a": square(0.0, rigid=True)}}, "leaves nothing that moves freely; give rigid = false"),
        ({"output": {"times": [0.5, 2.0]}}, r"'output.times\[1\]' = 2.0 comes after the end"),
        ({"mesh": {"h": 0.25, "geometry": "updated"}}, r"'mesh.geometry' = 'updated' has no effect in dynamics"),
        ({"mpm": {"penalty": 1e3}}, r"'mpm.penalty' = 1000.0 has no effect in dynamics; remove it\."),
        ({"mpm": {"fill_cells": True}}, "remove it or give false"),
        ({"staggered": {"scheme": "converged"}}, 'remove it or give "passes"'),
    ],
)
def test_a_slip_in_a_dynamic_case_gets_one_sentence(change, said):
    with pytest.raises(CaseError, match=said):
        case_of(change.pop("bodies", {"a": square(0.0)}), **change)


def test_a_phase_field_that_points_cannot_hold_is_refused():
    materials = {"soft": {**STEEL, "fracture": {"toughness": 1.0, "length_scale": 1.0}}}
    held = [{"on": "left", "direction": "phase", "value": 0.0}]
    case = case_of({"a": square(0.0)}, materials=materials, constraints=held)
    with pytest.raises(CaseError, match=r"constraints\[0\].direction = 'phase'.* hold no phase field; remove it"):
        ExplicitMaterialPoints(case)


def test_a_traction_moves_a_free_square_as_newton_says():
    case = case_of({"a": square(0.0)}, 2.0, tractions=[{"on": "left", "value": [1e-3, 0.0]}])
    last = list(instants(ExplicitMaterialPoints(case), case))[-1]
    assert last.balance.momentum[0] == pytest.approx(1e-3 * 2.0, rel=1e-12)
    # the shock of a sudden push is smeared over the four cells
    assert last.balance.external_work == pytest.approx(last.balance.total, rel=0.05)


def test_a_traction_grows_over_its_ramp():
    tractions = [{"on": "left", "value": [1e-3, 0.0], "ramp": 1.0}]
    case = case_of({"a": square(0.0)}, 2.0, tractions=tractions)
    momentum = {instant.time: instant.balance.momentum[0] for instant in instants(ExplicitMaterialPoints(case), case)}
    for time, impulse in momentum.items():
        expected = 0.5e-3 * time**2 if time < 1.0 else 1e-3 * (time - 0.5)
        assert impulse == pytest.approx(expected, abs=0.05e-3)


def test_a_held_edge_moves_as_prescribed():
    """Pushed at a constant velocity between plates that stay: uniaxial strain, and the reaction's work is stored."""
    constraints = [
        {"on": "left", "direction": "x", "value": 0.0}, {"on": "right", "direction": "x", "velocity": -1e-4},
        {"on": "bottom", "direction": "y", "value": 0.0}, {"on": "top", "direction": "y", "value": 0.0},
    ]  # fmt: skip
    case = case_of({"a": square(0.0)}, 100.0, constraints=constraints)
    solver = ExplicitMaterialPoints(case)
    last = list(instants(solver, case))[-1]
    assert np.median(solver.bodies[0].points.elastic.exx) == pytest.approx(-0.01, rel=0.03)
    assert last.balance.external_work == pytest.approx(last.balance.total, rel=0.03)


def test_a_body_that_leaves_its_held_line_ends_the_run_in_a_sentence(tmp_path):
    """Held across its flight only: what the case asks for can no longer be kept, and nobody lets go of it in silence."""
    constraints = [{"on": "left", "direction": "y", "value": 0.0}]
    case = case_of({"a": square(0.0, velocity=[0.2, 0.0])}, 10.0, constraints=constraints)
    done = run(case, "mpm", "standard", tmp_path)
    assert done.info["status"] == "blew_up" and not (done.folder / "traceback.txt").exists()
    assert "none of body 'a' is left on the line of constraints[0].on = 'left'" in done.info["reason"]
    assert 0.5 < done.history["time"].iloc[-1] * 0.2 / case.mesh.h < 3.0


def test_an_edge_of_several_holds_the_bodies_that_it_meets_alone():
    """One square between each of two floors that are held lines; neither may be looked for at the other's."""
    high = {"material": "soft", "shape": {"rectangle": {"lower": [0.0, 4.0], "upper": [1.0, 5.0]}}}
    boundaries = {"sides": {"edges": ["bottom", "top"]}}
    constraints = [{"on": "sides", "direction": "y", "value": 0.0}]
    gravity = {"gravity": [0.0, -0.01]}
    bodies = {"a": square(0.0), "b": high}
    case = case_of(bodies, 2.0, boundaries=boundaries, constraints=constraints, dynamics=gravity)
    solver = ExplicitMaterialPoints(case)
    assert list(instants(solver, case))[-1].status == "complete"
    low, top = (body.positions()[:, 1] for body in solver.bodies)
    assert low.min() > 0.0 and top.max() < 5.0


@pytest.mark.parametrize(
    ("place", "said"),
    [([[2.0, 0.0], [2.0, 1.0]], "no body reaches it"), ([[5.0, 0.0], [5.0, 1.0]], "rigid bodies alone")],
)
def test_a_constraint_that_holds_nothing_is_refused(place, said):
    boundaries = {"line": {"box": {"lower": place[0], "upper": place[1]}}}
    constraints = [{"on": "line", "direction": "x", "value": 0.0}]
    bodies = {"a": square(0.0), "wall": square(5.0, rigid=True)}
    case = case_of(bodies, boundaries=boundaries, constraints=constraints)
    with pytest.raises(CaseError, match=rf"constraints\[0\].on = 'line': .*{said}"):
        ExplicitMaterialPoints(case)


@pytest.mark.parametrize("rigid", [False, "free"])
@pytest.mark.parametrize("order_of_update", ["usl", "musl"])
def test_a_body_falls_as_galileo_says(rigid, order_of_update):
    bodies = {"a": square(0.0) | {"rigid": rigid}, "b": square(5.0)}
    dynamics = {"gravity": [0.0, -0.1], "order_of_update": order_of_update}
    case = case_of(bodies, 2.0, dynamics=dynamics)
    points = ExplicitMaterialPoints(case)
    start = points.monitored()["a_y"]
    last = list(instants(points, case))[-1]
    assert points.monitored()["a_y"] - start == pytest.approx(-0.5 * 0.1 * 4.0, rel=1e-9)
    assert last.balance.external_work == pytest.approx(last.balance.kinetic, rel=1e-9)
