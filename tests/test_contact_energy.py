"""What contact and the way from points to nodes and back take of the energy, where it is known."""

import numpy as np
import pytest

from mpm import ExplicitMaterialPoints
from numerics.explicit import Balance, instants
from tests.test_moving_points import case_of, square

FLOOR = {"material": "soft", "rigid": True, "shape": {"rectangle": {"lower": [-1.0, -1.0], "upper": [3.0, 0.0]}}}
DISC = {"material": "soft", "shape": {"disc": {"centre": [2.05, 0.9], "radius": 1.0}}}
WEIGHT = {"gravity": [0.0, -0.1]}


def rows_of(bodies: dict, end_time: float, **more):
    case = case_of(bodies, end_time, **more)
    return list(instants(ExplicitMaterialPoints(case), case))


def unaccounted(balance: Balance) -> float:
    """Energy that neither forces, contact nor transfer gave."""
    assert balance.transfer_work is not None
    return balance.total - balance.external_work - balance.contact_work - balance.transfer_work


@pytest.mark.parametrize("gap", [0.0, 0.2])
def test_bodies_that_meet_and_stick_lose_what_is_left_of_their_approach(gap):
    """Half the reduced mass times the square of the velocity between them."""
    bodies = {"a": square(0.0, rigid="free", velocity=[0.1, 0.0]), "b": square(1.0 + gap, rigid="free")}
    first, *_, last = rows_of(bodies | {"far": square(20.0)}, 4.0)
    # a gap closes in steps, the last of which is open
    assert last.balance.contact_work == pytest.approx(-0.5 * 0.5 * 0.1**2, rel=0.05 if gap else 1e-9)
    assert last.balance.contact_work == pytest.approx(last.balance.kinetic - first.balance.kinetic, rel=1e-9)
    assert abs(last.balance.friction_work) < 1e-12 and abs(last.balance.transfer_work) < 1e-12


def test_a_body_that_falls_on_a_rigid_floor_loses_all_of_its_motion():
    bodies = {"block": square(0.0, rigid="free", velocity=[0.0, -0.01]), "floor": FLOOR, "far": square(20.0)}
    *_, last = rows_of(bodies, 1.0)
    assert last.balance.contact_work == pytest.approx(-0.5 * 0.01**2, rel=1e-9)


def test_a_sliding_block_loses_its_friction_times_its_way():
    bodies = {"block": square(0.0, rigid="free", velocity=[0.1, 0.0]), "floor": FLOOR, "far": square(20.0)}
    first, *_, last = rows_of(bodies, 1.5, contact={"friction": 0.3}, dynamics=WEIGHT)
    way = last.columns["block_x"] - first.columns["block_x"]
    assert way == pytest.approx(0.1 * 1.5 - 0.5 * 0.3 * 0.1 * 1.5**2, rel=1e-2)
    assert last.balance.friction_work == pytest.approx(-0.3 * 0.1 * way, rel=1e-3)
    assert last.balance.contact_work == pytest.approx(last.balance.friction_work, rel=1e-3)


@pytest.mark.parametrize(
    ("bodies", "more"),
    [
        ({"a": square(0.0, velocity=[0.1, 0.02]), "b": square(1.1)}, {}),
        ({"a": square(0.0, velocity=[0.1, 0.02]), "b": square(1.1), "c": square(2.2, velocity=[-0.02, 0.0])}, {}),
        ({"a": square(0.0, velocity=[0.1, 0.02]), "b": DISC}, {"dynamics": {"affine": True}}),
        ({"a": square(0.0, velocity=[0.1, 0.02]), "b": DISC}, {"dynamics": {"flip": 0.9}}),
        ({"a": square(0.0, velocity=[0.1, 0.02], rigid="free"), "b": DISC}, {}),
        ({"a": square(0.0, velocity=[0.1, -0.02]), "floor": FLOOR}, {"dynamics": WEIGHT}),
    ],
)  # fmt: skip
def test_the_balance_closes_with_what_contact_and_transfer_take(bodies, more):
    """But for what the time integration takes and gives back, in proportion to the step."""
    off = {}
    for share in (0.4, 0.1):
        dynamics = more.get("dynamics", {}) | {"time_step_share": share}
        rows = rows_of(bodies, 8.0, contact={"friction": 0.3}, output={"records": 50}, dynamics=dynamics)
        first, last = rows[0].balance, rows[-1].balance
        assert last.contact_work + last.transfer_work < -0.02 * first.total
        most = max(row.balance.total for row in rows)
        off[share] = np.array([abs(unaccounted(row.balance) - first.total) / most for row in rows])
    assert off[0.4].max() < 0.02
    assert off[0.1].max() < 0.3 * off[0.4].max()


def test_where_strains_are_updated_last_the_loss_of_transfer_is_not_told():
    """They follow velocities that are mapped once more: the nodes' forces do their work on others."""
    dynamics = {"order_of_update": "musl"}
    rows = rows_of({"a": square(0.0, velocity=[0.1, 0.02]), "b": square(1.1)}, 1.0, dynamics=dynamics)
    assert rows[-1].balance.transfer_work is None and "W_transfer" not in rows[-1].row()
