"""A few of the random scenes; ``python -m tests.random_scenes`` draws more of them."""

import pytest

from tests.random_scenes import outcome


@pytest.mark.parametrize("seed", [0, 1, 3, 6])
def test_solvers_agree_on_a_random_scene_or_say_why_not(seed, tmp_path):
    found = outcome(seed, tmp_path)
    assert found.fem > 0.0
    assert not found.silent
    assert not found.suspicions


def test_a_short_slit_by_which_the_solvers_part_is_told(tmp_path):
    found = outcome(1054, tmp_path)
    assert found.apart > 0.02 and not found.silent
    assert all("tips of slits" in text for text in found.suspicions)


@pytest.mark.parametrize("seed", [10, 17, 84])
def test_solvers_agree_on_a_slit_at_a_random_angle(seed, tmp_path):
    found = outcome(seed, tmp_path, turned=True)
    assert found.apart < 0.02 and not found.suspicions


def test_a_slit_at_an_angle_by_which_the_solvers_part_is_told(tmp_path):
    found = outcome(38, tmp_path, turned=True)
    assert found.apart > 0.02 and not found.silent


def test_solvers_agree_on_a_random_scene_that_breaks(tmp_path):
    assert not outcome(4, tmp_path, breaking=True).silent
