"""Arches on buttresses: shape, parts that cannot break, angles of regions, hinges, and limit analysis beside them."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cases import Case, CaseError, case_from_tables, load_case
from cases.geometry import Shape
from mpm import ExplicitMaterialPoints
from physics.rocking.limit_analysis import Arch
from reports.arch import hinges
from reports.film import moved
from reports.results import CaseResults
from reports.rocking import angles
from verify import run
from verify.metrics.metric import MetricError
from verify.metrics.registry import METRICS

ARCH = {
    "crown": [0.0, 2.1], "radius": 3.488, "half_angle": 66.55, "thickness": 0.2, "buttress_width": 0.8,
    "buttress_height": 2.4,
}  # fmt: skip
SHAPE = Shape(arch=ARCH)
STONE = {"young": "300 MPa", "poisson": 0.25, "density": "1700 kg/m^3"}
BUTTRESSES = [
    {"rectangle": {"lower": [-4.1, -3.0], "upper": [-3.15, 0.0]}},
    {"rectangle": {"lower": [3.15, -3.0], "upper": [4.1, 0.0]}},
]
FAR = {"rectangle": {"lower": [10.0, 0.0], "upper": [11.0, 1.0]}}


def arch_case(end_time: float = 0.02, **changes: Any) -> Case:
    """An arch that is held under its buttresses and falls against a weak gravity."""
    tables: dict[str, Any] = {
        "title": "Arch", "requirement": "It stands.", "units": {"length": "m", "force": "MN", "time": "s"},
        "plane": {"assumption": "strain"},
        "materials": {"stone": STONE | {"fracture": {"toughness": "2700 N/m", "length_scale": 0.2}}},
        "bodies": {"arch": {"material": "stone", "shape": {"arch": ARCH}, "unbreakable": BUTTRESSES}},
        "constraints": [{"on": "bottom", "direction": d, "value": 0.0} for d in "xy"],
        "dynamics": {"end_time": end_time, "gravity": [0.0, -9.81], "affine": True},
        "mesh": {"h": 0.2}, "mpm": {"placement": "regular", "points_per_cell": 3},
        "output": {"records": 4, "regions": {"left": {"body": "arch", "within": BUTTRESSES[0]}}},
        "runs": {"mpm": {"solver": "mpm"}},
    }  # fmt: skip
    return case_from_tables(tables | changes, "quick", "mpm")


def test_an_arch_is_a_vault_that_ends_on_its_buttresses():
    assert SHAPE.arch is not None
    half = math.radians(66.55)
    springing = 2.1 - 3.488 * (1.0 - math.cos(half))
    np.testing.assert_allclose(SHAPE.bounds(), [[-4.0, springing - 2.4], [4.0, 2.3]], atol=1e-3)
    outer, inner = 3.688, 3.488
    half_outer, level = math.acos(3.488 * math.cos(half) / outer), 3.488 * math.cos(half)
    segments = [r * r * (a - math.sin(a) * math.cos(a)) for r, a in ((outer, half_outer), (inner, half))]
    assert SHAPE.outline().area == pytest.approx(segments[0] - segments[1] + 2 * 0.8 * 2.4, rel=1e-4)
    assert level == pytest.approx(1.388, abs=1e-3)
    inside = SHAPE.contains([[0.0, 2.2], [0.0, 2.05], [-3.6, -1.0], [0.0, -1.0], [3.3, 0.05], [3.9, 0.05], [3.9, -0.05]])
    assert inside.tolist() == [True, False, True, False, True, False, True]


def test_limit_analysis_takes_the_arch_of_a_case():
    found = Arch.of_shape(SHAPE.arch)
    assert found.collapse().factor == pytest.approx(0.021, abs=5e-4)


def test_a_semicircular_arch_under_its_own_weight_needs_the_thickness_of_the_textbooks():
    """Milankovitch 1907: t / R = 0.1075 of the middle line, for joints along the radii."""

    def stands(ratio: float) -> bool:
        return Arch(1.0 - 0.5 * ratio, 90.0, ratio, voussoirs=120).collapse().factor >= 0.0

    low, high = 0.09, 0.12
    assert stands(high) and not stands(low)
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if stands(middle) else (middle, high)
    assert high == pytest.approx(0.1075, abs=3e-4)


def test_limit_analysis_hinges_of_the_thinnest_semicircle_are_at_crown_haunches_and_springings():
    hinges = [float(name) for name, _ in Arch(1.0 - 0.5 * 0.1078, 90.0, 0.1078, voussoirs=120).collapse().hinges]
    # under a small load to one side the symmetric mechanism of five hinges loses one; haunches: 54.5 degrees
    assert min(abs(abs(hinge) - 54.5) for hinge in hinges) < 3.0


def test_parts_of_a_body_that_cannot_break_keep_their_phase_field():
    points = ExplicitMaterialPoints(arch_case())
    body, (field,) = points.bodies[0], points.phase_fields
    places = body.positions()
    in_buttress = np.abs(places[:, 0]) > 3.15
    in_buttress &= places[:, 1] < 0.0
    assert 0.5 < in_buttress.mean() < 0.9
    body.points.crack.history[:] = 1e-1
    field.solve(1.0)
    crack = body.points.crack
    assert (crack.c[in_buttress] == 1.0).all() and (crack.energy[in_buttress] == 0.0).all()
    assert np.isnan(crack.broken_at[in_buttress]).all()
    beside = ~in_buttress & (places[:, 1] < 0.2)
    assert crack.c[~in_buttress].min() < 0.05, "the vault breaks"
    assert crack.c[beside].min() > 0.2, "and is held by its buttresses"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"bodies": {"arch": {"material": "stone", "shape": {"arch": ARCH | {"half_angle": 95.0}}}}}, "half_angle"),
        ({"output": {"regions": {"left": {"body": "vault", "within": BUTTRESSES[0]}}}}, "regions.left.body"),
        ({"output": {"regions": {"arch": {"body": "arch", "within": BUTTRESSES[0]}}}}, "regions.arch"),
        ({"materials": {"stone": STONE}}, "bodies.arch.unbreakable"),
        ({"bodies": {"arch": {"material": "stone", "shape": {"arch": ARCH}, "unbreakable": [FAR]}}}, "unbreakable[0]"),
        ({"runs": {"mpm": {"solver": "fem"}}}, "bodies.arch.unbreakable"),
    ],
)
def test_what_does_not_fit_an_arch_is_refused(changes, said):
    with pytest.raises(CaseError) as refused:
        case = arch_case(**changes)
        if "runs" in changes:
            from fem_reference import ExplicitFiniteElements

            ExplicitFiniteElements(case)
    assert said in str(refused.value)


def test_the_angle_of_a_region_is_told():
    points = ExplicitMaterialPoints(arch_case())
    assert points.monitored()["left_angle"] == pytest.approx(0.0, abs=1e-12)
    body = points.bodies[0]
    middle = body.positions()[np.abs(body.positions()[:, 0] + 3.6) < 0.5].mean(axis=0)
    away = body.positions() - middle
    turned = away @ [[math.cos(0.3), math.sin(0.3)], [-math.sin(0.3), math.cos(0.3)]]
    body.points.motion.x[:] += (turned - away)[:, 0] / 0.2
    body.points.motion.y[:] += (turned - away)[:, 1] / 0.2
    assert points.monitored()["left_angle"] == pytest.approx(0.3, abs=1e-9)
    told = type("Told", (), {"case": arch_case(), "info": {"run": "mpm"}})()
    told.history = pd.DataFrame({"time": [0.0, 1.0, 2.0], "left_angle": [0.0, -0.02, 0.01]})
    assert METRICS["tilt"](told, start=0.5, end=2.0, of="left") == pytest.approx(math.degrees(0.02))


class Seen:
    """A run as the metrics of hinges see it, from the points of its last state."""

    def __init__(self, case: Case, broken: dict[float, float], depth: float = 0.2) -> None:
        """broken : angle from the crown [degrees] -> time at which the vault broke there, over a depth."""
        points = ExplicitMaterialPoints(case)
        reference = points.cloud.positions
        arch = case.bodies["arch"].shape.arch
        angle, radius = arch.polar(reference)
        self.case, self.info = case, {"run": "mpm"}
        c, when = np.ones(len(reference)), np.full(len(reference), np.nan)
        for place, time in broken.items():
            there = (np.abs(angle - place) < 4.0) & (radius < arch.radius + depth) & arch.in_vault(reference)
            c[there], when[there] = 0.02, time
        self.history = pd.DataFrame({"c_min": [1.0, c.min(), 0.5]})
        sunk = np.where(arch.in_vault(reference)[:, None], [0.0, -2.0 * depth], 0.0)
        self.data = {
            "displacement": sunk, "reference": reference, "phase_field": c, "broken_at": when, "body": points.cloud.body,
        }  # fmt: skip

    def points(self, at: float | None = None) -> Any:
        return type("Snapshot", (), {"point_data": self.data})


def test_hinges_are_where_the_vault_breaks_through_its_thickness():
    seen = Seen(arch_case(), {-48.0: 2.0, 0.0: 3.0, 47.0: 4.0})
    assert METRICS["hinge_count"](seen) == 3
    for number, (angle, time) in enumerate(((-48.0, 2.0), (0.0, 3.0), (47.0, 4.0)), 1):
        assert METRICS["hinge_angle"](seen, number=number) == pytest.approx(angle, abs=2.0)
        assert METRICS["hinge_time"](seen, number=number) == time
    assert METRICS["collapsed"](seen) == 1 and METRICS["collapsed"](Seen(arch_case(), {}, depth=0.05)) == 0
    assert METRICS["least_phase_field"](seen) == 0.02
    # limit analysis: left, crown, right (and a base, which cannot break)
    assert METRICS["hinge_mismatch"](seen) < 3.0
    with pytest.raises(MetricError, match="has 3 hinges"):
        METRICS["hinge_angle"](seen, number=4)


def test_a_vault_that_cannot_stand_has_no_hinges_of_collapse():
    high = ARCH | {"buttress_width": 0.3}
    falling = arch_case(bodies={"arch": {"material": "stone", "shape": {"arch": high}}})
    with pytest.raises(MetricError, match="cannot stand by its weight"):
        METRICS["hinge_mismatch"](Seen(falling, {0.0: 3.0}))


def test_the_page_shows_hinges_and_angles(tmp_path):
    settling = {"duration": 1e-3, "ramp": 1e-3, "damping": 0.0}
    shortly = {"dynamics": {"end_time": 1e-3, "settling": settling}, "output": {"frames": 1}}
    done = run(load_case("arch_buttresses", "quick", "held", shortly), "held", out=tmp_path, threads=1)
    folder = done.folder.relative_to(tmp_path).as_posix()
    entry = {"case": "arch_buttresses", "tier": "quick", "runs": {"held": {"folder": folder, "status": "complete"}}}
    results = CaseResults(entry, tmp_path)
    drawn = hinges(results, tmp_path)
    assert drawn is not None and "held: no hinge" in drawn.caption and "0.021 of its weight" in drawn.caption
    (angle,) = angles(results, tmp_path)
    assert angle.title == "Angle of left buttress over time" and (tmp_path / angle.file).is_file()


def test_a_crack_that_ends_in_the_vault_is_no_hinge():
    assert METRICS["hinge_count"](Seen(arch_case(), {-48.0: 2.0}, depth=0.05)) == 0
    with pytest.raises(MetricError, match="no hinge"):
        METRICS["hinge_mismatch"](Seen(arch_case(), {}))


def test_a_film_marks_the_hinges_where_the_vault_has_carried_them():
    assert SHAPE.arch is not None
    angles = np.array([-50.0, 0.0, 30.0])
    np.testing.assert_allclose(SHAPE.arch.polar(SHAPE.arch.middle(angles)), [angles, 3 * [3.588]], atol=1e-9)
    reference = SHAPE.arch.middle(angles)
    frame = SimpleNamespace(reference=reference, displacement=np.array([[0.0, 0.0], [0.0, -0.5], [0.1, 0.0]]))
    np.testing.assert_allclose(moved(frame, [SHAPE.arch.middle(1.0), reference[2]])[:, 1] - reference[1:, 1],
                               [-0.5 - 3.588 * (1.0 - math.cos(math.radians(1.0))), 0.0], atol=1e-9)  # fmt: skip
    assert moved(frame, []).shape == (0, 2)
