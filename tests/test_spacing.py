"""Grid lines: fine where asked, graded outside, and lines where bodies and notches need them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cases import Case, CaseError, case_from_tables
from cases.spacing import grid_lines

UNIT_SQUARE = {"rectangle": {"lower": [0, 0], "upper": [1, 1]}}


#: of a length scale that any spacing resolves
FRACTURE = {"toughness": 2.7e-3, "length_scale": 100.0}


def case_of(mesh: dict[str, Any], notches: tuple[dict[str, Any], ...] = (), shape: Any = None) -> Case:
    return case_from_tables(
        {
            "title": "grid",
            "requirement": "lines",
            "units": {"length": "mm", "force": "kN"},
            "plane": {"assumption": "strain"},
            "materials": {"steel": {"young": 210.0, "poisson": 0.3, "fracture": FRACTURE}},
            "bodies": {"plate": {"material": "steel", "shape": shape or UNIT_SQUARE}},
            "notches": list(notches),
            "load": {"path": [0.0]},
            "mesh": mesh,
        }
    )


def has_line(lines: np.ndarray, coordinate: float) -> bool:
    return bool(np.min(np.abs(lines - coordinate)) < 1e-12)


def test_a_uniform_grid_needs_no_extra_cell() -> None:
    x, y = grid_lines(case_of({"h": 0.1}))
    assert np.allclose(x, np.linspace(0, 1, 11), atol=1e-14) and np.array_equal(x, y)


def test_rounding_adds_no_cell() -> None:
    width = 0.1 * 3
    assert width / 0.1 > 3
    x, _ = grid_lines(case_of({"h": 0.1}, shape={"rectangle": {"lower": [0, 0], "upper": [width, 1]}}))
    assert len(x) == 4


def test_a_spacing_that_does_not_fit_is_made_smaller() -> None:
    x, _ = grid_lines(case_of({"h": 0.3}))
    assert np.allclose(np.diff(x), 0.25)


def test_spacings_grow_from_the_fine_box_to_coarse() -> None:
    fine = {"lower": [0.5, 0.4], "upper": [1, 0.6]}
    _, y = grid_lines(case_of({"h": 0.01, "coarse": 0.05, "growth": 1.2, "fine": fine}))
    steps = np.diff(y)
    ratios = steps[1:] / steps[:-1]
    above = y[:-1] >= 0.6 - 1e-12
    assert np.allclose(steps[(y[:-1] >= 0.4 - 1e-12) & ~above], 0.01)
    assert np.all(np.maximum(ratios, 1 / ratios) <= 1.2 + 1e-9)
    assert steps.max() == pytest.approx(0.05, rel=0.1) and steps.max() <= 0.05 * 1.001
    assert np.all(np.diff(steps[above]) >= -1e-12)
    assert np.allclose(y, 1 - y[::-1])  # the box is in the middle, so the lines are symmetric


def test_without_a_coarse_spacing_growth_has_no_limit() -> None:
    fine = {"lower": [0, 0], "upper": [0.01, 1]}
    x, _ = grid_lines(case_of({"h": 0.01, "growth": 2.0, "fine": fine}))
    ratios = np.diff(x)[2:] / np.diff(x)[1:-1]
    assert np.allclose(ratios, ratios[0]) and 1.5 < ratios[0] <= 2.0 + 1e-9


def test_a_slit_and_its_tip_are_lines() -> None:
    slit = {"kind": "slit", "start": [0, 0.512], "end": [0.481, 0.512]}
    x, y = grid_lines(case_of({"h": 0.1}, (slit,)))
    assert has_line(y, 0.512) and has_line(x, 0.481)


def test_the_outline_of_left_out_cells_is_lines() -> None:
    horizontal = {"kind": "cells", "start": [0, 0.5], "end": [0.45, 0.5], "width": 0.06}
    vertical = {"kind": "cells", "start": [0.7, 0.83], "end": [0.7, 1], "width": 0.1}
    x, y = grid_lines(case_of({"h": 0.1}, (horizontal, vertical)))
    assert all(has_line(y, at) for at in (0.47, 0.53, 0.83)) and not has_line(y, 0.5)
    assert all(has_line(x, at) for at in (0.45, 0.65, 0.75))


def test_a_history_notch_needs_no_line() -> None:
    notch = {"kind": "history", "start": [0, 0.512], "end": [0.481, 0.512]}
    assert np.array_equal(grid_lines(case_of({"h": 0.1}, (notch,)))[1], grid_lines(case_of({"h": 0.1}))[1])


def test_the_corner_of_an_l_shape_and_the_edges_of_a_hole_are_lines() -> None:
    angle = {"polygon": {"points": [[0, 0], [1, 0], [1, 0.43], [0.37, 0.43], [0.37, 1], [0, 1]]}}
    x, y = grid_lines(case_of({"h": 0.1}, shape=angle))
    assert has_line(x, 0.37) and has_line(y, 0.43)
    hole = {"rectangle": {"lower": [0.31, 0.41], "upper": [0.52, 0.63]}}
    x, y = grid_lines(case_of({"h": 0.1}, shape={"difference": {"of": UNIT_SQUARE, "minus": [hole]}}))
    assert all(has_line(x, at) for at in (0.31, 0.52)) and all(has_line(y, at) for at in (0.41, 0.63))


def test_lines_that_nearly_coincide_are_one() -> None:
    slit = {"kind": "slit", "start": [0, 0.5 + 1e-9], "end": [0.5, 0.5 + 1e-9]}
    fine = {"lower": [0, 0.5], "upper": [1, 0.7]}
    _, y = grid_lines(case_of({"h": 0.02, "coarse": 0.1, "fine": fine}, (slit,)))
    assert has_line(y, 0.5 + 1e-9) and np.diff(y).min() > 0.01


def test_a_refined_box_has_its_own_spacing_and_cells_grow_from_both_boxes() -> None:
    fine = {"lower": [0, 0.8], "upper": [1, 1]}
    mesh = {"h": 0.01, "coarse": 0.1, "growth": 1.2, "fine": fine}
    refine = {"lower": [0.2, 0], "upper": [0.3, 0], "h": 0.02}
    x, y = grid_lines(case_of({**mesh, "refine": [refine]}))
    assert np.allclose(x, np.linspace(0, 1, 101))  # the fine box goes over the whole width
    steps, ratios = np.diff(y), np.diff(y)[1:] / np.diff(y)[:-1]
    assert 0.02 <= steps[0] < 0.02 * 1.2 and steps.max() <= 0.1 * 1.001
    assert np.all(np.maximum(ratios, 1 / ratios) <= 1.2 * 1.05)
    assert steps.argmax() not in (0, len(steps) - 1)
    assert len(grid_lines(case_of(mesh))[1]) < len(y) < 1 / 0.02


def test_the_spacing_of_a_refined_box_is_not_above_coarse() -> None:
    fine, box = {"lower": [0, 0.8], "upper": [1, 1]}, {"lower": [0.2, 0], "upper": [0.3, 0], "h": 0.2}
    with pytest.raises(CaseError, match=r"mesh.refine\[0\].h' = 0.2 is above coarse"):
        case_of({"h": 0.01, "coarse": 0.1, "fine": fine, "refine": [box]})


def test_a_refined_box_off_the_bodies_is_told() -> None:
    fine, box = {"lower": [0, 0.8], "upper": [1, 1]}, {"lower": [2, 0], "upper": [3, 0], "h": 0.01}
    with pytest.raises(CaseError, match=r"mesh.refine\[0\]'.* lies outside the bodies"):
        case_of({"h": 0.01, "coarse": 0.1, "fine": fine, "refine": [box]})


#: no numbers that are smaller than any length
PLACES = st.floats(-0.2, 1.2).map(lambda place: round(place, 12))


@settings(max_examples=60, deadline=None)
@given(
    h=st.floats(0.01, 0.2),
    ratio=st.floats(1, 20),
    growth=st.floats(1.05, 2.5),
    ends=st.lists(PLACES, min_size=2, max_size=2, unique=True).map(sorted),
    level=st.floats(1e-3, 0.999).map(lambda level: round(level, 12)),
    tip=st.floats(0.05, 1),
    place=st.floats(0, 1).map(lambda place: round(place, 12)),
    share=st.floats(0, 1),
)
def test_any_grid_is_ascending_fine_in_the_box_and_within_its_limits(
    h: float, ratio: float, growth: float, ends: list[float], level: float, tip: float, place: float, share: float
) -> None:
    lower, upper = max(ends[0], 0.0), min(ends[1], 1.0)
    assume(upper - lower > 1e-3)
    fine = {"lower": [ends[0], -1], "upper": [ends[1], 2]}
    slit = {"kind": "slit", "start": [0, level], "end": [tip, level]}
    refine = {"lower": [place, place], "upper": [place, 1], "h": h * ratio**share}
    mesh = {"h": h, "coarse": h * ratio, "growth": growth, "fine": fine, "refine": [refine]}
    x, y = grid_lines(case_of(mesh, (slit,)))
    for lines in (x, y):
        steps = np.diff(lines)
        assert lines[0] == 0 and lines[-1] == 1 and np.all(steps > 0)
        assert steps.max() <= h * ratio * 1.001 + 1e-12
    in_box = (x[:-1] < upper - 2e-3 * h) & (x[1:] > lower + 2e-3 * h)
    assert np.diff(x)[in_box].max() <= h * 1.001 + 1e-12
    # the cell about the refined place: no larger than the spacing wanted at its far end
    at = min(np.searchsorted(x, place, side="right"), len(x) - 1) - 1
    assert x[at + 1] - x[at] <= h * ratio**share * growth * 1.002 + 1e-12
    assert np.min(np.abs(x - tip)) <= 1e-3 * h and np.min(np.abs(y - level)) <= 1e-3 * h
