"""A crack that has run rests at a minimum of the energy, not between two of them."""

import numpy as np
import pytest
from test_increments import notched

from numerics import staggered
from numerics.costs import Costs

#: places of the tip: where it would rest, and between them, where residuals vanish as well
REST, SADDLE = 0.2, 0.5
#: by so much a sweep enlarges the distance from the saddle point, and what is left of everything else
GROWTH, DECAY = 2.7, 0.1


class Tip:
    """A discretisation of two numbers, the place of the tip and something that comes to rest.

    Both are its phase field, and its history field.
    """

    def __init__(self, start, fracture_energy):
        self.costs = Costs()
        self.history_field = np.zeros(2)
        self.phase_field = self.nodal_phase_field = np.array([start, 1e-4])
        self.fracture_energy, self.sweeps = fracture_energy, 0

    def begin_step(self):
        pass

    def energies(self):
        return 0.0, self.fracture_energy if self.sweeps > 1 else 0.0

    def solve_displacement(self, load, tolerance):
        return self.phase_field.copy()

    def solve_phase_field(self, history_field):
        self.sweeps += 1
        if self.sweeps > 1:  # the first one maps what there is
            tip, other = history_field
            self.set_phase_field(np.array([max(REST, SADDLE + GROWTH * (tip - SADDLE)), DECAY * other]))
        return self.phase_field

    def set_phase_field(self, nodal):
        self.phase_field = self.nodal_phase_field = nodal
        return nodal


def where_it_rests(variant, start, advance, largest_iterations=100):
    """The outcome for a tip that begins at a place, in a crack that advances by so many length scales."""
    settings = {"acceleration": "none", "tolerance": 1e-3, "largest_iterations": largest_iterations}
    case = notched(variant, staggered=settings)
    tip = Tip(start, advance * staggered.energy_of_advance(case))
    return staggered.staggered_step(tip, case, 1.0), tip


@pytest.mark.parametrize(("advance", "place", "count"), [(2.0, REST, 1), (0.5, SADDLE, 0)])
def test_behind_an_advance_of_more_than_a_length_scale_a_saddle_point_is_left(variant, advance, place, count):
    outcome, tip = where_it_rests(variant, SADDLE - 1e-7, advance)
    assert outcome.verdict == "converged"
    assert tip.phase_field[0] == pytest.approx(place, abs=1e-4)
    assert tip.costs.count["unstable_equilibria"] == count


def test_a_tip_at_rest_is_tried_once(variant):
    outcome, tip = where_it_rests(variant, REST, 2.0)
    assert tip.phase_field[0] == REST
    assert tip.costs.count["unstable_equilibria"] == 0
    assert outcome.iterations == 2 + staggered.SWEEPS


def test_iterations_of_both_kinds_are_counted_towards_the_largest_number(variant):
    outcome, _ = where_it_rests(variant, SADDLE - 1e-7, 2.0, largest_iterations=2 + staggered.SWEEPS)
    assert outcome.verdict == "stalled"
    assert outcome.reason == "5 staggered iterations"
