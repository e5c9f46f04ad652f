"""Bodies that move freely without deforming: flight, rest, friction, collisions, what they are refused."""

import numpy as np
import pytest

from cases import Case, CaseError, load_case
from mpm import ExplicitMaterialPoints
from mpm.grid import GridError
from numerics.explicit import Instant, instants
from tests.test_moving_points import STEEL, case_of, square
from verify.planning.savings import savings

SPIN = 2.0 * np.pi / 10.0
HELD = [{"on": "bottom", "direction": direction, "value": 0.0} for direction in "xy"]
DISC = {"material": "soft", "shape": {"disc": {"centre": [2.05, 0.9], "radius": 1.0}}}
WEIGHT = 1e-3


def free(left: float = 0.0, **more) -> dict:
    """A square of side one that moves freely without deforming."""
    return square(left, rigid="free", **more)


def on_ground(end_time: float, block: dict, **more) -> Case:
    """A block on a layer of ground under a weight of `WEIGHT` that has come on before time 0."""
    ground = {"material": "soft", "shape": {"rectangle": {"lower": [-2.0, -1.0], "upper": [3.0, 0.0]}}}
    settling = {"duration": 40.0, "ramp": 10.0, "damping": 0.3}
    dynamics = {"gravity": [0.0, -WEIGHT], "affine": True, "settling": settling, **more.pop("dynamics", {})}
    contact = {"friction": 0.3, "normals_of": "ground"}
    return case_of(
        {"block": block, "ground": ground}, end_time, constraints=HELD, contact=contact, dynamics=dynamics, **more
    )  # fmt: skip


def history(case: Case) -> tuple[ExplicitMaterialPoints, list[Instant]]:
    solver = ExplicitMaterialPoints(case)
    return solver, list(instants(solver, case))


def missing(instant: Instant) -> float:
    """Energy that neither forces nor contact gave."""
    return instant.balance.total - instant.balance.external_work - instant.balance.contact_work


def places(solver: ExplicitMaterialPoints) -> np.ndarray:
    body = solver.bodies[0]
    return body.positions()[np.argsort(body.points.number)]


@pytest.mark.parametrize("update", ["usl", "musl"])
def test_a_body_flies_and_spins_a_full_turn_in_its_shape(update):
    flying = free(velocity=[0.03, 0.05], velocity_gradient=[[0.0, -SPIN], [SPIN, 0.0]])
    dynamics = {"gravity": [0.0, -0.01], "order_of_update": update}
    case = case_of({"a": flying, "b": square(20.0)}, 10.0, dynamics=dynamics)
    solver = ExplicitMaterialPoints(case)
    start = places(solver)
    *_, last = instants(solver, case)
    fall = 0.5 * 0.01 * 10.0**2
    np.testing.assert_allclose(places(solver) - start, np.tile([0.3, 0.5 - fall], (len(start), 1)), atol=1e-12)
    assert last.columns["a_angle"] == pytest.approx(2.0 * np.pi, rel=1e-12)
    assert last.columns["a_spin"] == pytest.approx(SPIN, rel=1e-14)
    assert last.columns["a_momentum_y"] == pytest.approx(0.05 - 0.1, abs=1e-14)


def test_the_inertia_is_that_of_the_body_and_not_of_its_points():
    case = case_of({"a": free(velocity_gradient=[[0.0, -SPIN], [SPIN, 0.0]]), "b": square(20.0)})
    motion = ExplicitMaterialPoints(case).bodies[0].whole_motion()
    assert motion.energy == pytest.approx(0.5 * SPIN**2 / 6.0, rel=1e-12)


def test_a_block_at_rest_presses_with_its_weight_and_does_not_creep():
    solver, rows = history(on_ground(100.0, free(), output={"records": 28}))
    middle, last = next(row for row in rows if row.time >= 40.0), rows[-1]
    push = (last.columns["block_impulse_y"] - middle.columns["block_impulse_y"]) / (last.time - middle.time)
    assert push == pytest.approx(WEIGHT, rel=1e-3)
    sunk = 0.5 - middle.columns["block_y"]
    assert sunk > 5e-4 and last.columns["block_y"] == pytest.approx(middle.columns["block_y"], abs=1e-2 * sunk)
    assert abs(last.columns["block_angle"]) < 1e-10
    assert not any(solver.contact.violations[f"contact_C{n}"] for n in (2, 3, 4))


@pytest.mark.parametrize("more", [{}, {"dynamics": {"affine": True}}, {"dynamics": {"order_of_update": "musl"}}])
def test_a_rigid_and_a_deformable_body_keep_their_momentum(more):
    case = case_of({"a": free(velocity=[0.05, 0.01]), "b": DISC}, 8.0, contact={"friction": 0.3}, **more)
    solver, rows = history(case)
    np.testing.assert_allclose(rows[-1].balance.momentum, rows[0].balance.momentum, atol=1e-12 * 0.05)
    assert rows[-1].columns["b_impulse_x"] > 0.03 and rows[-1].columns["a_spin"] > 0.01
    assert not any(solver.contact.violations[f"contact_C{n}"] for n in (2, 3, 4))
    assert 0.2 < missing(rows[-1]) / rows[0].balance.total < 1.0


def test_friction_slows_a_sliding_block_by_its_coefficient():
    """The ground moves away under a flat block: it follows by friction alone, and the balance holds."""
    flat = {"material": "soft", "rigid": "free", "shape": {"rectangle": {"lower": [0.0, 0.0], "upper": [1.5, 0.25]}}}
    ground = {"pulse": "half_sine", "amplitude": WEIGHT, "period": 120.0}
    _, rows = history(on_ground(40.0, flat, dynamics={"ground": ground}, output={"records": 80}))
    first, last = (next(row for row in rows if row.time >= time) for time in (20.0, 40.0))
    mass = 1.5 * 0.25
    given = (last.columns["block_impulse_x"] - first.columns["block_impulse_x"]) / (last.time - first.time) / mass
    assert given == pytest.approx(0.3 * WEIGHT, rel=0.01)
    assert last.balance.contact_work < 0.0 and last.balance.kinetic > 1e-5
    assert abs(missing(last) - missing(first)) < 0.02 * last.balance.kinetic


def test_a_block_holds_on_ground_that_shakes_less_than_friction():
    flat = {"material": "soft", "rigid": "free", "shape": {"rectangle": {"lower": [0.0, 0.0], "upper": [1.5, 0.25]}}}
    ground = {"pulse": "half_sine", "amplitude": 0.2 * WEIGHT, "period": 60.0}
    _, rows = history(on_ground(30.0, flat, dynamics={"ground": ground}))
    assert abs(rows[-1].columns["block_x"] - rows[0].columns["block_x"]) < 1e-3


def test_a_rigid_block_comes_to_rest_on_a_rigid_floor():
    floor = {"material": "soft", "rigid": True, "shape": {"rectangle": {"lower": [-1.0, -1.0], "upper": [2.0, 0.0]}}}
    bodies = {"block": free(velocity=[0.0, -0.01]), "floor": floor, "far": square(20.0)}
    solver, rows = history(case_of(bodies, 6.0, contact={"friction": 0.5}, dynamics={"gravity": [0.0, -0.1]}))
    last = rows[-1]
    assert abs(last.columns["block_y"] - 0.5) < 1e-3 and abs(last.columns["block_angle"]) < 1e-9
    assert last.columns["block_impulse_y"] == pytest.approx(0.01 + 0.6, rel=0.01)
    assert not any(solver.contact.violations[f"contact_C{n}"] for n in (2, 3, 4))


@pytest.mark.parametrize("aside", [0.0, 0.03, 0.06])
def test_a_block_that_rocks_on_a_rigid_floor_keeps_what_housner_says(aside):
    """Thrown off one corner it falls flat and goes on about the other, 1 - 1.5 sin² alpha of its rate left.

    The corners stay where they stand, at nodes of the grid or ``aside`` of them.
    """
    spin, half, height = 0.1, 0.4, 3.2
    block = {"material": "soft", "rigid": "free", "shape": {"rectangle": {"lower": [-half, 0], "upper": [half, height]}}}
    about_corner = {"velocity": [-0.5 * spin * height, spin * half], "velocity_gradient": [[0.0, -spin], [spin, 0.0]]}
    lower, upper = [-1.95 - aside, -0.5], [1.95 - aside, 0.0]
    floor = {"material": "soft", "rigid": True, "shape": {"rectangle": {"lower": lower, "upper": upper}}}
    case = case_of(
        {"block": block | about_corner, "floor": floor, "far": square(5.0)}, 0.2, h=0.1, output={"records": 100},
        contact={"friction": 0.6}, dynamics={"gravity": [0.0, -9.81], "time_step": 2e-4},
    )  # fmt: skip
    solver, rows = history(case)
    impact = next(number for number, row in enumerate(rows) if number and row.columns["block_angle"] <= 0.0)
    before, after = (rows[impact + way].columns["block_spin"] for way in (-1, 1))
    rise = max(row.columns["block_angle"] for row in rows)
    inertia_over_weight = 4.0 / 3.0 * (half**2 + 0.25 * height**2) / (9.81 * half)
    angle, middle = rows[impact // 2].columns["block_angle"], rows[impact // 2].columns["block_x"]
    assert middle + 0.5 * height * np.sin(angle) - half * np.cos(angle) == pytest.approx(-half, abs=1e-4)
    assert rise == pytest.approx(0.5 * spin**2 * inertia_over_weight, rel=0.01)
    assert after / before == pytest.approx(1.0 - 1.5 * half**2 / (half**2 + 0.25 * height**2), rel=0.02)
    # where the block turns back, speeds are as small as what the impulses leave
    found = solver.contact.violations
    assert sum(found[f"contact_C{n}"] for n in (2, 3, 4)) < 0.005 * found["contact_nodes"]


def test_two_rigid_bodies_in_a_row_hand_on_what_they_have():
    bodies = {"a": free(velocity=[0.1, 0.0]), "b": free(1.2), "c": square(2.4)}
    solver, rows = history(case_of(bodies, 12.0))
    assert rows[-1].balance.momentum[0] == pytest.approx(0.1, rel=1e-12)
    columns = rows[-1].columns
    assert columns["c_momentum_x"] > 0.02 and columns["b_momentum_x"] >= columns["a_momentum_x"] - 1e-12
    assert sum(columns[f"{body}_impulse_x"] for body in "abc") == pytest.approx(0.0, abs=1e-14)
    assert not any(solver.contact.violations[f"contact_C{n}"] for n in (2, 3, 4))


def test_a_body_between_two_others_is_pushed_by_both_at_once():
    """Without the passes over the pairs a block held at two sides would drift."""
    left, right = square(-1.0, velocity=[0.02, 0.0]), square(1.0, velocity=[-0.02, 0.0])
    solver, rows = history(case_of({"block": free(), "left": left, "right": right}, 4.0))
    assert abs(rows[-1].columns["block_x"] - 0.5) < 1e-9 and rows[-1].columns["left_impulse_x"] < -0.01
    assert not any(solver.contact.violations[f"contact_C{n}"] for n in (2, 3, 4))


def test_a_run_that_goes_on_ends_with_the_same_bits():
    case = case_of({"a": free(velocity=[0.1, 0.03]), "b": DISC}, 6.0, contact={"friction": 0.3}, output={"records": 4})
    whole = ExplicitMaterialPoints(case)
    *_, half, _, end = instants(whole, case)
    first = ExplicitMaterialPoints(case)
    for instant in instants(first, case):
        if instant.step == half.step:
            break
    second = ExplicitMaterialPoints(case)
    second.restore(first.checkpoint())
    *_, last = instants(second, case, instant)
    assert end.columns["b_impulse_x"] > 0.0 and last.columns == end.columns
    for name, array in whole.checkpoint().items():
        np.testing.assert_array_equal(second.checkpoint()[name], array)


@pytest.mark.parametrize(
    ("bodies", "more", "said"),
    [
        ({"a": free()}, {}, "leaves nothing that deforms; give rigid = false"),
        ({"a": square(0.0, rigid="loose")}, {}, "'bodies.a.rigid' = 'loose' is no way .* give true, false or \"free\""),
        ({"a": free(velocity_gradient=[[0.1, 0.0], [0.0, 0.0]])}, {}, "deforms a rigid body; give a spin"),
        ({"a": free(unbreakable=[square(0.0)["shape"]])}, {}, "cannot break"),
        ({"a": free(), "b": square(3.0)}, {"constraints": HELD}, "'bottom' reaches the rigid body 'a', which"),
        ({"a": free(), "b": square(3.0)}, {"tractions": [{"on": "left", "value": [1, 0]}]}, "'left' reaches the rigid"),
        ({"a": free(), "b": square(3.0)}, {"materials": {"soft": {"young": 1.0, "poisson": 0.3}}}, "density"),
    ],
)  # fmt: skip
def test_what_a_rigid_body_cannot_be_is_refused_in_a_sentence(bodies, more, said):
    with pytest.raises(CaseError, match=said):
        case_of(bodies, **more)


def test_a_quasi_static_case_has_no_body_that_moves_freely():
    name = next(iter(load_case("homogeneous_bar").bodies))
    with pytest.raises(CaseError, match=rf"bodies\.{name}\.rigid' acts in dynamics only"):
        load_case("homogeneous_bar", "quick", "fem", {"bodies": {name: {"rigid": "free"}}})


@pytest.mark.parametrize(
    ("of_body", "change", "key"),
    [
        ({"rigid": True}, {}, r"bodies\.NAME\.rigid"),
        ({"velocity": [1.0, 0.0]}, {}, r"bodies\.NAME\.velocity"),
        ({"velocity_gradient": [[0.0, -1.0], [1.0, 0.0]]}, {}, r"bodies\.NAME\.velocity_gradient"),
        ({}, {"contact": {"friction": 0.3}}, "contact"),
    ],
)
def test_what_moves_or_touches_is_no_part_of_a_quasi_static_case(of_body, change, key):
    name = next(iter(load_case("homogeneous_bar").bodies))
    with pytest.raises(CaseError, match=rf"{key.replace('NAME', name)}'.* acts in dynamics only"):
        load_case("homogeneous_bar", "quick", "fem", {"bodies": {name: of_body}, **change})


@pytest.mark.parametrize("acting", ["constraints", "tractions"])
def test_what_reaches_a_rigid_body_unseen_is_refused_before_a_run(acting, monkeypatch):
    monkeypatch.setattr("cases.rules.what_reaches", lambda case, name: iter(()))
    item = HELD[0] if acting == "constraints" else {"on": "bottom", "value": [1.0, 0.0]}
    with pytest.raises(GridError, match="the rigid body 'a', which moves as gravity and contact alone have it"):
        ExplicitMaterialPoints(case_of({"a": free(), "b": square(3.0)}, **{acting: [item]}))


def test_a_rigid_body_bounds_no_step_and_the_plan_tells_its_worth():
    stiff = {"soft": STEEL, "stiff": STEEL | {"young": 25.0}}
    said = []
    for rigid in (False, "free"):
        bodies = {"block": square(0.0, rigid=rigid) | {"material": "stiff"}, "ground": square(3.0)}
        case = case_of(bodies, materials=stiff)
        said.append(next(saving for saving in savings(case) if saving.name == "rigid block"))
    plain, used = said
    assert not plain.used and 'step would be 5 times longer; for that write bodies.block.rigid = "free"' in plain.reason
    assert used.used and "5 times shorter" in used.reason and used.off == {"bodies": {"block": {"rigid": False}}}
