"""Sums over a point's nodes in vector code against the same sums in numpy."""

import numpy as np
import pytest
from numba import njit

from mpm.explicit.stencil_sums import add_fields, add_products, sum_fields

WIDTH, FIRST = 7, 9


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
def test_four_fields_take_their_products_at_once(k: int) -> None:
    @njit
    def added(fields, width, across, along, even, slopes):
        add_fields(k, fields, FIRST, width, across, along, even, slopes[0], slopes[1])

    across, along = (tuple(tuple(four(k, 3 * i + j)) for j in range(3)) for i in range(2))
    even, *slopes = (tuple(four(4, seed)) for seed in range(6, 9))
    fields = np.random.default_rng(9).uniform(size=(6 * WIDTH, 4))
    found = fields.ravel().copy()
    added(found, WIDTH, across, along, even, tuple(slopes))
    for field in range(4):
        part = 1 if field < 2 else 2
        fields[:, field] += even[field] * stencil(k, across[0], along[0])
        fields[:, field] += slopes[0][field] * stencil(k, across[part], along[0])
        fields[:, field] += slopes[1][field] * stencil(k, across[0], along[part])
    np.testing.assert_allclose(found.reshape(-1, 4), fields, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("k", [2, 3, 4])
def test_four_fields_and_their_slopes_are_summed_at_once(k: int) -> None:
    @njit
    def summed(fields, width, across, along):
        return sum_fields(k, fields, FIRST, width, across, along)

    across, along = (tuple(tuple(four(k, 2 * i + j)) for j in range(2)) for i in range(2))
    fields = np.random.default_rng(9).uniform(size=(6 * WIDTH, 4))
    products = ((across[0], along[0]), (across[1], along[0]), (across[0], along[1]))
    expected = np.ravel([stencil(k, *pair) @ fields for pair in products])
    np.testing.assert_allclose(summed(fields.ravel(), WIDTH, across, along), expected, rtol=1e-13)
