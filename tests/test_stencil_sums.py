"""Sums over a point's nodes in vector code against the same sums in numpy."""

import numpy as np
import pytest
from numba import njit

from mpm.explicit.stencil_sums import add_products, sum_products

WIDTH, FIRST = 7, 9


def four(k: int, seed: int) -> np.ndarray:
    """k numbers and zeros behind them."""
    return np.where(np.arange(4) < k, np.random.default_rng(seed).uniform(-1.0, 1.0, 4), 0.0)


def stencil(k: int, across: np.ndarray, along: np.ndarray) -> np.ndarray:
    """The products on the nodes of a grid of 6 x 7."""
    nodes = np.zeros((6, WIDTH))
    nodes[FIRST // WIDTH :, FIRST % WIDTH :][:k, :4] = np.outer(across[:k], along)
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
def test_the_sum_over_a_stencil_is_that_of_its_products(k: int) -> None:
    @njit
    def summed(array, width, a, b):
        return sum_products(k, array, FIRST, width, a, b)

    a, b = four(k, 0), four(k, 1)
    nodes = np.random.default_rng(9).uniform(size=6 * WIDTH)
    assert summed(nodes, WIDTH, tuple(a), tuple(b)) == pytest.approx(nodes @ stencil(k, a, b), rel=1e-14)
