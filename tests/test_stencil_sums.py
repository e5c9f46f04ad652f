"""Sums over a point's nodes in vector code against the same sums in numpy."""

import numpy as np
import pytest
from numba import njit

from mpm.explicit.stencil_sums import (
    ACROSS,
    ALONG,
    OFF_ACROSS,
    OFF_ALONG,
    ROWS,
    SLOPES_ACROSS,
    SLOPES_ALONG,
    add_fields,
    add_products,
    sum_fields,
)
from numerics.lanes import TILE

#: of the grid of 6 x 7; the stencil's first node; a point of a tile
WIDTH, FIRST, POINT = 7, 9, 5


def four(k: int, seed: int) -> np.ndarray:
    """k numbers and zeros behind them."""
    return np.where(np.arange(4) < k, np.random.default_rng(seed).uniform(-1.0, 1.0, 4), 0.0)


def stencil(k: int, across: np.ndarray, along: np.ndarray) -> np.ndarray:
    """The products on the nodes of a grid of 6 x 7."""
    nodes = np.zeros((6, WIDTH))
    nodes[FIRST // WIDTH :, FIRST % WIDTH :][:k, :4] = np.outer(np.asarray(across)[:k], along)
    return nodes.ravel()


@pytest.mark.parametrize("k", [2, 3, 4])
def test_products_are_added_to_the_nodes_of_the_stencil_alone(k: int) -> None:
    @njit
    def added(array, width, a, b, c, d):
        add_products(k, array, FIRST, width, ((2.0, a, b), (-0.5, c, d)))

    a, b, c, d = (four(k, seed) for seed in range(4))
    nodes = np.random.default_rng(9).uniform(size=6 * WIDTH)
    expected = nodes + 2.0 * stencil(k, a, b) - 0.5 * stencil(k, c, d)
    untouched = (stencil(k, a, b) == 0.0) & (stencil(k, c, d) == 0.0)
    before = nodes.copy()
    added(nodes, WIDTH, tuple(a), tuple(b), tuple(c), tuple(d))
    np.testing.assert_allclose(nodes, expected, rtol=1e-14)
    assert np.array_equal(nodes[untouched], before[untouched]) and untouched.sum() == 6 * WIDTH - k * k


@pytest.mark.parametrize("k", [2, 3, 4])
def test_mass_and_four_fields_take_what_a_point_of_a_tile_gives(k: int) -> None:
    @njit
    def added(m, fields, width, weights, gifts):
        add_fields(k, m, fields, FIRST, width, weights, gifts, POINT)

    weights, rows = np.random.default_rng(1).uniform(-1.0, 1.0, (ROWS, TILE)), {}
    for number, row in enumerate((ACROSS, SLOPES_ACROSS, OFF_ACROSS, ALONG, SLOPES_ALONG, OFF_ALONG)):
        weights[row : row + 4, POINT] = rows[row] = four(k, number)
    gifts = np.random.default_rng(8).uniform(-1.0, 1.0, (4, TILE, 4))
    gifts[0, POINT, k:] = 0.0
    mass, even, *slopes = gifts[:, POINT]
    m, fields = np.random.default_rng(9).uniform(size=6 * WIDTH), np.random.default_rng(10).uniform(size=(6 * WIDTH, 4))
    found_m, found = m.copy(), fields.ravel().copy()
    added(found_m, found, WIDTH, weights, gifts)
    np.testing.assert_allclose(found_m, m + stencil(k, rows[ACROSS], mass), rtol=1e-14, atol=1e-15)
    for field in range(4):
        across, along = (OFF_ACROSS, OFF_ALONG) if field < 2 else (SLOPES_ACROSS, SLOPES_ALONG)
        fields[:, field] += even[field] * stencil(k, rows[ACROSS], rows[ALONG])
        fields[:, field] += slopes[0][field] * stencil(k, rows[across], rows[ALONG])
        fields[:, field] += slopes[1][field] * stencil(k, rows[ACROSS], rows[along])
    np.testing.assert_allclose(found.reshape(-1, 4), fields, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("k", [2, 3, 4])
def test_four_fields_and_slopes_of_two_are_summed_at_a_point_of_a_tile(k: int) -> None:
    @njit
    def summed(fields, width, weights, sums):
        sum_fields(k, fields, FIRST, width, weights, sums, POINT)

    weights, rows = np.random.default_rng(1).uniform(-1.0, 1.0, (ROWS, TILE)), {}
    for number, row in enumerate((ACROSS, SLOPES_ACROSS, ALONG, SLOPES_ALONG)):
        weights[row : row + 4, POINT] = rows[row] = four(k, number)
    fields, sums = np.random.default_rng(9).uniform(size=(6 * WIDTH, 4)), np.zeros((2, TILE, 4))
    summed(fields.ravel(), WIDTH, weights, sums)
    expected = np.zeros((2, TILE, 4))
    expected[0, POINT] = stencil(k, rows[ACROSS], rows[ALONG]) @ fields
    expected[1, POINT, :2] = stencil(k, rows[SLOPES_ACROSS], rows[ALONG]) @ fields[:, :2]
    expected[1, POINT, 2:] = stencil(k, rows[ACROSS], rows[SLOPES_ALONG]) @ fields[:, :2]
    np.testing.assert_allclose(sums, expected, rtol=1e-13)
