"""Four numbers at once against the same in numpy."""

from typing import NamedTuple

import numpy as np
import pytest
from numba import njit

from numerics.lanes import (
    LANES,
    TILE,
    apart,
    borrowed,
    greatest,
    least,
    load,
    load_turned,
    only,
    same,
    store,
    store_rows,
    store_turned,
    store_whole,
    whole,
)


class Pair(NamedTuple):
    one: np.ndarray
    two: np.ndarray


@njit
def calculated(one, two):
    a, b = load(one, 0, LANES), load(two, 0, LANES)
    return apart(2 * a + b * 0.5 - a / b + (1.0 - a) * (-b))


def test_arithmetic_is_that_of_floats() -> None:
    one, two = np.random.default_rng(1).uniform(0.5, 2.0, (2, LANES))
    assert np.array_equal(calculated(one, two), 2 * one + two * 0.5 - one / two + (1.0 - one) * (-two))


@pytest.mark.parametrize("left", [1, 3, 4, 9])
def test_nothing_behind_the_numbers_that_are_left_is_read_or_written(left: int) -> None:
    @njit
    def doubled(pair, left):
        numbers = borrowed(pair)
        store(numbers.two, 2, left, 2.0 * load(numbers.one, 2, left))
        return apart(load(numbers.one, 2, left)), apart(only(same(7.0), left))

    pair = Pair(np.arange(1.0, 8.0), np.full(7, -1.0))
    read, kept = doubled(pair, left)
    some = min(left, LANES)
    assert list(read) == [3.0, 4.0, 5.0, 6.0][:some] + [0.0] * (LANES - some)
    assert list(kept) == [7.0] * some + [0.0] * (LANES - some)
    assert list(pair.two) == [-1.0, -1.0] + [6.0, 8.0, 10.0, 12.0][:some] + [-1.0] * (5 - some)


def test_what_is_not_finite_is_the_largest_for_good() -> None:
    @njit
    def largest(numbers):
        found = same(0.0)
        for p in range(0, len(numbers), LANES):
            found = greatest(least(load(numbers, p, LANES), same(np.inf)), found)
        return apart(found)

    numbers = np.array([1.0, 2.0, np.nan, np.inf, 3.0, 1.0, 5.0, 6.0])
    assert list(largest(numbers)) == [3.0, 2.0, np.inf, np.inf]


def test_whole_parts_become_integers() -> None:
    @njit
    def found(numbers, integers):
        store_whole(integers, 1, whole(load(numbers, 0, LANES)))
        return apart(whole(load(numbers, 0, LANES)))

    integers = np.zeros(6, np.int64)
    assert list(found(np.array([0.0, 1.9, 2.0, 1e6 + 0.5]), integers)) == [0.0, 1.0, 2.0, 1e6]
    assert list(integers) == [0, 0, 1, 2, 1000000, 0]


def test_rows_of_a_tile_and_numbers_side_by_side_find_their_places() -> None:
    @njit
    def put(numbers, rows, fours):
        a, b = load(numbers, 0, LANES), load(numbers, 4, LANES)
        store_rows(2, rows, 1, 8, (a, b, a))
        store_turned(fours, 1, 8, (a, b, 0.0, a))
        back = load_turned(fours, 1, 8)
        return apart(back[0]), apart(back[1]), apart(back[2]), apart(back[3])

    numbers, rows, fours = np.arange(1.0, 9.0), np.zeros((4, TILE)), np.zeros((2, TILE, LANES))
    a, b = numbers[:4], numbers[4:]
    back = put(numbers, rows, fours)
    expected_rows, expected_fours = np.zeros((4, TILE)), np.zeros((2, TILE, LANES))
    expected_rows[1:3, 8:12] = a, b
    expected_fours[1, 8:12] = np.column_stack([a, b, 0.0 * a, a])
    assert np.array_equal(rows, expected_rows) and np.array_equal(fours, expected_fours)
    assert np.array_equal(back, [a, b, 0.0 * a, a])
