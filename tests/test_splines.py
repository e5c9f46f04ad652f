"""B-splines and grids: partition of unity, slopes, slits."""

import numpy as np
import pytest

from mpm import MaterialPoints
from mpm.grid import Grid, Sides
from mpm.splines import Axis
from numerics.built import BuiltError

LINES = np.array([0.0, 0.1, 0.25, 0.3, 0.6, 1.0])
PLACES = np.sort(np.random.default_rng(1).random(200)) * 0.999


def assembled(axis, coefficients, places):
    cells = axis.locate(places)
    values, slopes = axis.evaluate(places, cells)
    functions = (axis.spans[cells] - axis.order)[:, None] + np.arange(axis.order + 1)
    return (values * coefficients[functions]).sum(1), (slopes * coefficients[functions]).sum(1)


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("repeats", [{}, {2: 2}, {3: 4}])
def test_partition_of_unity_and_linear_reproduction(order, repeats):
    axis = Axis(LINES, order, {index: min(times, order + 1) for index, times in repeats.items()})
    ones, flat = assembled(axis, np.ones(axis.n_functions), PLACES)
    assert np.allclose(ones, 1.0, atol=1e-13)
    assert np.allclose(flat, 0.0, atol=1e-11)
    line, slope = assembled(axis, axis.greville(), PLACES)
    assert np.allclose(line, PLACES, atol=1e-13)
    assert np.allclose(slope, 1.0, atol=1e-11)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_slopes_are_derivatives(order):
    axis, step = Axis(LINES, order), 1e-6
    coefficients = np.random.default_rng(2).random(axis.n_functions)
    away = PLACES[np.abs(PLACES[:, None] - LINES).min(1) > 2 * step]
    ahead, behind = (assembled(axis, coefficients, away + s)[0] for s in (step, -step))
    assert np.allclose(assembled(axis, coefficients, away)[1], (ahead - behind) / (2 * step), atol=1e-6)


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("repeats", [{}, {2: 2}])
def test_second_derivatives_are_derivatives_of_the_slopes(order, repeats):
    axis, step = Axis(LINES, order, repeats), 1e-6
    coefficients = np.random.default_rng(3).random(axis.n_functions)
    away = PLACES[np.abs(PLACES[:, None] - LINES).min(1) > 2 * step]
    cells = axis.locate(away)
    functions = (axis.spans[cells] - order)[:, None] + np.arange(order + 1)
    second = (axis.second_derivatives(away, cells) * coefficients[functions]).sum(1)
    ahead, behind = (assembled(axis, coefficients, away + s)[1] for s in (step, -step))
    assert np.allclose(second, (ahead - behind) / (2 * step), rtol=1e-5, atol=1e-4)


def test_the_functions_of_a_cell_go_on_beyond_it_as_polynomials():
    axis = Axis(LINES, 1)
    values, _ = axis.evaluate(np.array([0.62]), np.array([3]))
    assert values.sum() == pytest.approx(1.0)
    assert values.min() < 0.0


WIDE_CRACK = {"materials": {"steel": {"fracture": {"length_scale": 0.2}}}}


@pytest.mark.parametrize("order", [1, 2, 3])
def test_slit_separates_the_sides_and_closes_at_its_tip(variant, order):
    """A jump across the slit can be represented behind the tip, and none ahead of it."""
    case = variant("sen_tension", mesh={"h": 0.1, "coarse": 0.1, "fine": {"lower": [0, 0], "upper": [1, 1]}},
                   mpm={"order": order}, **WIDE_CRACK)  # fmt: skip
    grid = Grid(case)
    step = (grid.nodes[:, 1] > 0.5).astype(float)
    above = grid.node_number[:, int(np.searchsorted(grid.axes[1].knots, 0.5 - 1e-9))]
    step[above] = 1.0

    def jump(x):
        places = np.array([[x, 0.5], [x, 0.5]])
        cells = grid.locate(places, Sides([np.array([-1, 1])], np.zeros((0, 2), bool)))
        values, _ = grid.evaluate(places, cells)
        below, upper = (values * step[grid.cell_nodes(cells)]).sum(1)
        return upper - below

    assert jump(0.05) == pytest.approx(1.0)
    assert jump(0.75) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("order", "cells"), [(1, 1), (2, 2), (3, 3)])
def test_left_out_cells_that_functions_reach_across_are_refused(variant, order, cells):
    def points(width):
        notch = {"kind": "cells", "start": [0.0, 0.5], "end": [0.5, 0.5], "width": width}
        mesh = {"h": 0.1, "coarse": 0.1, "fine": {"lower": [0, 0], "upper": [1, 1]}}
        return MaterialPoints(variant("sen_tension", notches=[notch], mesh=mesh, mpm={"order": order}, **WIDE_CRACK))

    points(0.1 * cells)
    if order > 1:
        with pytest.raises(BuiltError, match=rf"notches\[0\].width = {0.1 * (cells - 1):g}: .* hang together"):
            points(0.1 * (cells - 1))

