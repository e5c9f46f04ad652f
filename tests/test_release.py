"""K_I, J and stress concentration of a plate with a crack, however it is loaded; what they cannot tell is refused."""

from pathlib import Path

import numpy as np
import pytest

from verify import run
from verify.metrics.metric import MetricError
from verify.metrics.registry import METRICS

# a crack of 2 a = 8 in a plate of 40 by 40
PLATE = """
title = "Crack in a plate"
requirement = "However it is loaded it has one release rate."
units = { length = "mm", force = "N" }
plane = { assumption = "stress", thickness = 2.0 }
materials.other = { young = 5, poisson = 0.3 }
materials.m = { young = 1000, poisson = 0.3 }
bodies.plate = { material = "m", shape = { rectangle = { lower = [-20, LOWER], upper = [20, 20] } } }
boundaries = { mid = { point = [-20, LOWER] }, ahead = { box = { lower = [4, 0], upper = [20, 0] } }, more = { box = { lower = [-20, 0], upper = [-4, 0] } }, crack = { segment = [[-4, 0], [4, 0]] }, middle = { segment = [[-2, 0], [2, 0]] }, corner = { point = [20, -20] }, inside = { box = { lower = [-4, -0.5], upper = [4, 0.5] } } }
mesh.h = 0.5
runs.fem = { solver = "fem" }
"""  # noqa: E501 (tables in one line end there)
MACHINED = 'notches = [{ kind = "cells", start = [-4, 0], end = [4, 0], width = 1.0 }]\n'
SLIT = 'notches = [{ kind = "slit", start = [-4, 0], end = [4, 0], contact = false }]\n'
MID = '{ on = "mid", direction = "x", value = 0 }'
LOADS = {
    "one side": f'[{MID}, {{ on = "bottom", direction = "y", value = 0 }}, {{ on = "top", direction = "y", scale = 1 }}]',
    "twice": f'[{MID}, {{ on = "bottom", direction = "y", value = 0 }}, {{ on = "top", direction = "y", scale = 2 }}]',
    "both sides": f'[{MID}, {{ on = "bottom", direction = "y", scale = -1 }},'
    ' { on = "top", direction = "y", scale = 1 }]',
    "half": f'[{MID}, {{ on = "ahead", direction = "y", value = 0 }}, {{ on = "more", direction = "y", value = 0 }},'
    ' { on = "top", direction = "y", scale = 1 }]',
    "force": f'[{MID}, {{ on = "mid", direction = "y", value = 0 }}, {{ on = "corner", direction = "y", value = 0 }}]',
}
PRESSURES = {
    "far": '[{ on = "top", value = [0, 1], ramp = "load" }, { on = "bottom", value = [0, -1], ramp = "load" }]',
    "faces": '[{ on = "crack", pressure = 1.0, ramp = "load" }]',
    "middle": '[{ on = "middle", pressure = 1.0, ramp = "load" }]',
    "machined": '[{ on = "inside", pressure = 1.0, ramp = "load" }]',
}
TIP = {"tip": [4.0, 0.0], "direction": [1.0, 0.0]}
BOXES = {"inner": 1.0, "outer": 3.0}


@pytest.fixture(scope="module")
def plate(tmp_path_factory: pytest.TempPathFactory):
    """A run of a plate loaded in one of the ways; of tractions, by their name."""
    folder: Path = tmp_path_factory.mktemp("plates")

    def solved(way: str):
        tractions, notches = way in PRESSURES, {"half": "", "machined": MACHINED}
        path = "load = { path = [0.0, 1.0], increment = 1.0 }\noutput.snapshots = [1.0]\n"
        loads = f"constraints = {LOADS['force' if tractions else way]}\n"
        loads += f"tractions = {PRESSURES[way]}\n" if tractions else ""
        head, table = PLATE.replace("LOWER", "0" if way == "half" else "-20").split("mesh.h", 1)
        file = folder / f"{way.replace(' ', '_')}.toml"
        file.write_text(head + loads + path + notches.get(way, SLIT) + "mesh.h" + table)
        return run(file, "fem", out=folder, threads=1)

    return solved


@pytest.mark.parametrize("way", ["one side", "twice"])
def test_a_geometry_factor_is_that_of_the_force_on_the_section(plate, way):
    """sqrt(1 / cos(pi a / W)) = 1.025 of a long plate."""
    factor = METRICS["geometry_factor"](plate(way), **TIP, **BOXES, length=4.0, section=40.0, u=1.0)
    assert factor == pytest.approx(1.025, rel=0.03)
    far = {"at": [-18.0, 18.0], "component": "yy", "radius": 1.5, "section": 40.0, "u": 1.0}
    assert METRICS["stress_concentration"](plate(way), **far) == pytest.approx(1.07, rel=0.02)


@pytest.mark.parametrize("way", ["both sides", "far"])
def test_where_f_is_no_force_on_a_section_no_factor_is_told(plate, way):
    with pytest.raises(MetricError, match="only where one constraint with a scale is all that acts"):
        METRICS["geometry_factor"](plate(way), **TIP, **BOXES, length=4.0, section=40.0, u=1.0)
    far = {"at": [-18.0, 18.0], "component": "yy", "radius": 1.5, "section": 40.0, "u": 1.0}
    with pytest.raises(MetricError, match="ask for stress_at"):
        METRICS["stress_concentration"](plate(way), **far)


def test_pressure_on_the_faces_releases_what_tension_far_away_does(plate):
    far, faces = (METRICS["energy_release_rate"](plate(way), **TIP, **BOXES) for way in ("far", "faces"))
    assert far == pytest.approx(1.06**2 * np.pi * 4.0 / 1000.0, rel=0.06)
    assert faces == pytest.approx(far, rel=0.04)


@pytest.mark.parametrize(("inner", "outer"), [(0.5, 1.5), (1.0, 3.0), (2.0, 3.5)])
def test_a_box_may_hold_the_end_of_the_pressure_on_the_faces(plate, inner, outer):
    """K = 2 p sqrt(a / pi) asin(b / a) in a wide plate; J is 1.22 times as much in this one, with cells of a / 32."""
    found = METRICS["energy_release_rate"](plate("middle"), **TIP, inner=inner, outer=outer)
    assert found == pytest.approx(1.22 * 4.0 * np.arcsin(0.5) ** 2 * 4.0 / np.pi / 1000.0, rel=0.03)


@pytest.mark.parametrize(
    ("way", "boxes", "said"),
    [
        ("half", BOXES, "bodies fill 50% of the box of outer = 3; make it smaller, or give the whole body"),
        ("one side", {"inner": 1.0, "outer": 24.0}, "bodies fill"),
        ("one side", {"inner": 1.0, "outer": 9.0}, "holds the other end of the slit too"),
    ],
)
def test_a_box_that_is_not_filled_or_holds_two_tips_is_refused(plate, way, boxes, said):
    with pytest.raises(MetricError, match=said):
        METRICS["energy_release_rate"](plate(way), **TIP, **boxes)


def test_pressure_in_a_machined_notch_is_refused(plate):
    """Its faces are edges of the body, on which the integral over the area knows of no traction."""
    with pytest.raises(MetricError, match=r"tractions\[0\] acts on an edge of the bodies in the box of outer = 3.5"):
        METRICS["energy_release_rate"](plate("machined"), **TIP, inner=2.0, outer=3.5)


WEIGHED = """
title = "Crack in a plate that hangs"
requirement = "Its own weight releases energy."
units = { length = "mm", force = "N" }
plane = { assumption = "strain", thickness = 1.0 }
materials.m = { young = 1000.0, poisson = 0.3 }
bodies.plate = { material = "m", shape = { rectangle = { lower = [0, 0], upper = [1, 1] } } }
notches = [{ kind = "slit", start = [0, 0.5], end = [LENGTH, 0.5] }]
constraints = [{ on = "top", direction = "x", value = 0 }, { on = "top", direction = "y", value = 0 }]
body_forces = [{ value = [0.0, -1.0], ramp = "load" }]
load = { path = [0.0, 1.0], increment = 1.0 }
output.snapshots = [1.0]
mesh.h = 0.02
runs.fem = { solver = "fem" }
"""


def test_body_forces_count_in_any_box(tmp_path):
    """At a fixed load J is the growth of the elastic energy over that of the crack."""

    def hanging(length: float):
        file = tmp_path / f"plate_{length:g}.toml"
        file.write_text(WEIGHED.replace("LENGTH", str(length)))
        return run(file, "fem", out=tmp_path, threads=1)

    energies = [hanging(length).history["E_el"].iloc[-1] for length in (0.38, 0.42)]
    for inner, outer in ((0.05, 0.15), (0.1, 0.25), (0.25, 0.39)):
        found = METRICS["energy_release_rate"](hanging(0.4), inner=inner, outer=outer)
        assert found == pytest.approx(np.diff(energies)[0] / 0.04, rel=0.03)


SEAMED = """
title = "Crack beside another material"
requirement = "What the seam would release is not the crack's."
units = { length = "mm", force = "N" }
plane = { assumption = "stress", thickness = 2.0 }
materials.soft = { young = 100, poisson = 0.3, expansion = 1e-5 }
materials.same = { young = 1000, poisson = 0.3, expansion = 1e-5 }
materials.m = { young = 1000, poisson = 0.3, expansion = 1e-5 }
bodies.plate = { material = "m", shape = { rectangle = { lower = [-2, -2], upper = [RIGHT, TOP] } } }
bodies.other = { material = "OTHER", shape = { rectangle = { lower = LOWER, upper = [2, 2] } } }
notches = [{ kind = "slit", start = [-2, 0], end = [0, 0], contact = false }, SECOND]
constraints = [{ on = "bottom", direction = "x", value = 0 }, { on = "bottom", direction = "y", value = 0 }, { on = "top", direction = "y", scale = 1 }]
load = { path = [0.0, 1e-3], increment = 1e-3 }
output.snapshots = [1e-3]
mesh.h = 0.1
runs.fem = { solver = "fem" }
"""  # noqa: E501 (tables in one line end there)
AHEAD = {"RIGHT": "0.6", "TOP": "2", "LOWER": "[0.6, -2]", "OTHER": "soft", "SECOND": ""}
ALONG = {**AHEAD, "RIGHT": "2", "TOP": "0", "LOWER": "[-2, 0]"}
SECOND = '{ kind = "slit", start = [2, 0.5], end = [0.5, 0.5], contact = false }'
HEATED = 'eigenstrains = [{ on = "other", temperature = 10.0 }]\nmesh.h'


@pytest.mark.parametrize(
    ("changes", "outer", "said"),
    [
        (AHEAD, 0.8, "crosses the seam of plate and other in the box of outer = 0.8"),
        (AHEAD, 0.5, ""),
        (ALONG, 0.8, ""),
        ({**AHEAD, "OTHER": "same"}, 0.8, ""),
        ({**AHEAD, "OTHER": "m", "mesh.h": HEATED}, 0.8, "crosses the seam"),
        ({**AHEAD, "OTHER": "m", "SECOND": SECOND}, 0.8, r"holds an end of another slit, at \(0.5, 0.5\)"),
        ({**AHEAD, "OTHER": "m", "SECOND": SECOND}, 0.4, ""),
    ],
)
def test_what_something_else_in_the_box_releases_is_not_taken_for_the_crack_s(tmp_path, changes, outer, said):
    text = SEAMED
    for word, value in changes.items():
        text = text.replace(word, value)
    (tmp_path / "seamed.toml").write_text(text)
    solved = run(tmp_path / "seamed.toml", "fem", out=tmp_path, threads=1)
    around = {"tip": [0.0, 0.0], "direction": [1.0, 0.0], "inner": 0.2, "outer": outer}
    if said:
        with pytest.raises(MetricError, match=said):
            METRICS["energy_release_rate"](solved, **around)
    else:
        assert METRICS["energy_release_rate"](solved, **around) > 0.0
    if changes is ALONG:
        with pytest.raises(MetricError, match="lies on a seam of m and soft, and K_I is no root of J E'"):
            METRICS["geometry_factor"](solved, **around, length=2.0, section=4.0, u=1e-3)
