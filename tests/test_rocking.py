"""Rocking blocks without a mesh: exact borders, energies, limits of the Winkler model, collapse of arches."""

import math

import numpy as np
import pytest

from physics.rocking.block import Block
from physics.rocking.borders import borders
from physics.rocking.ground import PULSES, cut, pulse, record, response_spectrum
from physics.rocking.limit_analysis import Arch
from physics.rocking.motion import Verdict
from physics.rocking.pendulum import Pendulum, linear_border_without_impact
from physics.rocking.winkler import Foundation, WinklerBlock, half_space

#: the block of thesis 7.3.2
BLOCK = Block(0.795, 3.113, 606.101)


def sine(pendulum: Pendulum, ratio: float, amplitude: float):
    return pulse("sine", amplitude * pendulum.uplift_acceleration, ratio * BLOCK.frequency)


def border_without_impact(pendulum: Pendulum, ratio: float, low: float, high: float) -> float:
    def verdict_at(amplitude: float) -> Verdict:
        return pendulum.respond(sine(pendulum, ratio, amplitude)).verdict

    return borders(verdict_at, [low, high], 1e-9)[-1].amplitude


def test_the_constants_are_those_of_the_thesis():
    assert pytest.approx(2.14008, abs=1e-5) == BLOCK.frequency
    assert pytest.approx(0.90816, abs=1e-5) == BLOCK.housner_restitution
    assert pytest.approx(2.50528, abs=1e-5) == BLOCK.uplift_acceleration


@pytest.mark.parametrize("ratio", [3.0, 5.0])
@pytest.mark.parametrize("restitution", [0.9, None])
def test_the_linear_border_without_impact_is_the_exact_one(ratio, restitution):
    found = border_without_impact(Pendulum(BLOCK, linear=True, restitution=restitution), ratio, ratio, 2.0 * ratio)
    assert found == pytest.approx(linear_border_without_impact(ratio), abs=1e-6)
    assert linear_border_without_impact(5.0) == pytest.approx(7.1681, abs=1e-4)


def test_the_nonlinear_border_does_not_depend_on_the_step():
    coarse, fine = (border_without_impact(Pendulum(BLOCK, step=step), 5.0, 6.0, 9.0) for step in (4e-3, 2e-3))
    assert coarse == pytest.approx(fine, rel=1e-6)


def test_energy_is_kept_between_impacts_and_lost_by_eta_squared_at_them():
    pendulum = Pendulum(BLOCK)
    motion = pendulum.respond(sine(pendulum, 3.0, 1.3), stop_when_settled=False)
    free = motion.time > 2.0 * math.pi / (3.0 * BLOCK.frequency)
    energy = np.array([pendulum.energy(a, r) for a, r in zip(motion.angle[free], motion.rate[free], strict=True)])
    number = np.searchsorted(motion.impacts, motion.time[free], side="right")
    first = number.min()
    assert len(motion.impacts) > first + 2
    for impact in range(first, first + 3):
        piece = energy[number == impact]
        assert np.ptp(piece) < 1e-9 * piece[0]
    ratio = energy[number == first + 1][0] / energy[number == first][0]
    assert ratio == pytest.approx(BLOCK.housner_restitution**2, rel=1e-9)


def test_a_weak_pulse_lifts_nothing():
    pendulum = Pendulum(BLOCK)
    motion = pendulum.respond(sine(pendulum, 3.0, 0.99))
    assert motion.verdict is Verdict.SAFE
    assert not motion.angle.any()


def test_the_settled_verdict_is_that_of_the_whole_motion():
    pendulum = Pendulum(BLOCK)
    for amplitude in (1.5, 2.2, 3.0, 3.5, 4.5):
        ground = sine(pendulum, 3.0, amplitude)
        assert pendulum.respond(ground).verdict is pendulum.respond(ground, stop_when_settled=False).verdict


def winkler(stiffness: float = 3.77e8, **changes: float) -> WinklerBlock:
    foundation = half_space(260e6, 0.3, 1300.0, 0.795, stiffness, 0.625)
    step = changes.pop("step", None)
    return WinklerBlock(BLOCK, Foundation(**(vars(foundation) | changes)), step)


def test_half_the_step_moves_no_border_of_the_winkler_model():
    found = []
    for step in (2e-4, 1e-4):
        model = winkler(step=step)

        def verdict_at(amplitude: float, model: WinklerBlock = model) -> Verdict:
            return model.respond(pulse("sine", amplitude * BLOCK.uplift_acceleration, 5.0 * BLOCK.frequency)).verdict

        found.append([border.amplitude for border in borders(verdict_at, [2.0, 9.0])])
    assert found[0] == pytest.approx(found[1], rel=5e-3)


def test_the_winkler_block_stands_still_on_a_ground_at_rest():
    motion = winkler().respond(pulse("sine", 1e-9, 10.0), stop_when_settled=False, every=100)
    assert np.abs(motion.angle).max() < 1e-9


def test_on_ever_stiffer_ground_the_first_peak_becomes_that_of_the_pendulum():
    pendulum = Pendulum(BLOCK)
    ground = sine(pendulum, 3.0, 1.8)

    def first_peak(motion) -> float:
        return float(np.abs(motion.angle[motion.time < motion.impacts[0]]).max())

    exact = first_peak(pendulum.respond(ground))
    for damping in (0.0, 1e7):
        peaks = [
            first_peak(winkler(k, damping=damping, tangential_stiffness=k, tangential_damping=1e6).respond(ground))
            for k in (1e9, 1e10, 1e11)
        ]
        off = np.subtract(peaks, exact) / exact
        assert (off[1:] < 0.5 * off[:-1]).all()
        assert 0.0 < off[-1] < 0.07


def test_the_samples_of_the_thesis_end_as_printed_in_the_winkler_model():
    verdicts = [
        winkler().respond(pulse("sine", amplitude * BLOCK.uplift_acceleration, 3.0 * BLOCK.frequency)).verdict
        for amplitude in (1.0, 2.5, 3.5)
    ]
    assert verdicts == [Verdict.SAFE, Verdict.AFTER_IMPACTS, Verdict.NO_IMPACT]


@pytest.mark.parametrize("shape", PULSES)
def test_a_pulse_reaches_its_amplitude_and_ends(shape):
    ground = pulse(shape, 3.0, 10.0)
    times = np.linspace(-0.1, 1.0, 20001)
    values = ground.acceleration(times)
    assert np.abs(values).max() == pytest.approx(3.0, rel=1e-6)
    assert not values[(times < 0.0) | (times > ground.end)].any()


def test_a_cut_record_begins_at_the_cut():
    whole = record([0.0, 1.0, 2.0, 3.0], [0.0, 2.0, -2.0, 0.0])
    part = cut(whole, 0.5, 2.5)
    assert part.end == 2.0
    np.testing.assert_allclose(part.acceleration([0.0, 0.5, 1.5, 2.0]), [1.0, 2.0, -2.0, -1.0])


def test_the_spectrum_of_a_long_sine_at_its_period_is_the_resonance():
    times = np.linspace(0.0, 60.0, 12001)
    ground = record(times, np.sin(2.0 * np.pi * times))
    assert response_spectrum(ground, [1.0])[0] == pytest.approx(1.0 / (2.0 * 0.05), rel=0.01)
    assert response_spectrum(ground, [0.02])[0] == pytest.approx(1.0, rel=0.05)


def test_arches_collapse_as_by_hand():
    vault = Arch(3.488, 66.55, 0.2)
    assert vault.collapse().factor == pytest.approx(0.162, abs=1e-3)
    assert [round(float(name)) for name, _ in vault.collapse().hinges] == [-57, -9, 39, 66]
    for height, factor in ((2.0, 0.047), (2.4, 0.021), (2.8, 0.003)):
        found = Arch(3.488, 66.55, 0.2, 0.8, height).collapse()
        assert found.factor == pytest.approx(factor, abs=5e-4)
        assert found.hinges[-1] == ("right base", 1)
    assert Arch(3.488, 66.55, 0.2, 0.8, 3.0).collapse().factor == -math.inf
