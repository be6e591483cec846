"""Per-cycle results of sines with known extremes, sections and stick times."""

import math

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.solvers.per_cycle import cycle_starts, cycles_from_samples

W = 150.0
CYCLE = 2.0 * math.pi / W


def sine_cycles(t, *, offset=0.4, stick_speed=0.1, first_cycle=0, cycle=CYCLE):
    return cycles_from_samples(
        t, offset + np.sin(W * t + 0.3), W * np.cos(W * t + 0.3), np.cos(2 * W * t), -2 * W * np.sin(2 * W * t),
        -4 * W * W * np.cos(2 * W * t), starts=cycle_starts(first_cycle, t[-1], cycle), stick_speed=stick_speed)


@pytest.mark.parametrize("seed", [None, 1, 2])
def test_nonuniform_samples_off_the_cycle_ends(seed):
    t = np.linspace(0.31 * CYCLE, 6.77 * CYCLE, 2000)
    if seed is not None:
        t[1:-1] += np.random.default_rng(seed).uniform(-0.45, 0.45, len(t) - 2) * (t[1] - t[0])
    found = sine_cycles(t, first_cycle=1)
    assert len(found) == 5
    assert found.section.shape == (6, 3)
    np.testing.assert_allclose(found.section[:, 0], 0.4 + math.sin(0.3), atol=1e-10)
    np.testing.assert_allclose(found.section[:, 1], 1.0, atol=1e-13)
    np.testing.assert_allclose(found.section[:, 2], 0.0, atol=1e-6 * W)
    np.testing.assert_allclose(found.highest, 1.4, atol=1e-10)
    np.testing.assert_allclose(found.lowest, -0.6, atol=1e-10)
    exact = 2.0 * (math.asin(-0.3) - math.asin(-0.5)) / W
    np.testing.assert_allclose(found.stick_time, exact, rtol=1e-8)


def test_extremes_and_double_crossings_inside_one_interval():
    t = np.arange(0.0, 3.0 + 1e-9, 0.125) * CYCLE
    found = sine_cycles(t, offset=1.02, stick_speed=0.03)
    assert np.all(found.lowest < 0.03)
    assert np.all(np.abs(found.lowest - 0.02) < 2e-3)
    assert np.all(found.stick_time > 0.0)


def test_cycle_ends_that_are_samples_are_taken_as_they_are():
    t = (7 + np.arange(0, 3 * 64 + 1) / 64) * CYCLE
    v = np.random.default_rng(0).normal(size=len(t))
    still = np.zeros_like(t)
    found = cycles_from_samples(t, v, still, v, still, still, starts=cycle_starts(7, t[-1], CYCLE), stick_speed=0.0)
    np.testing.assert_allclose(found.section[:, 0], v[::64], rtol=1e-9)
    np.testing.assert_allclose(found.section[:, 1], v[::64], rtol=1e-9)
    for k in range(3):
        part = v[64 * k:64 * k + 65]
        assert found.highest[k] == pytest.approx(part.max(), rel=1e-9)
        assert found.lowest[k] == pytest.approx(part.min(), rel=1e-9)


def test_exact_stick_of_the_set_valued_law():
    t = np.arange(0.0, 2.0 + 1e-9, 0.01) * CYCLE
    phase = t / CYCLE % 1.0
    v = np.where(phase < 0.5, 0.0, np.sin(2 * np.pi * (phase - 0.5)) ** 2)
    a = np.where(v == 0.0, 1e-12, 0.0)
    found = cycles_from_samples(t, v, a, v, a, a, starts=cycle_starts(0, t[-1], CYCLE), stick_speed=0.0)
    np.testing.assert_allclose(found.stick_time, 0.5 * CYCLE, rtol=0.03)


def test_less_than_a_cycle_gives_none():
    assert len(sine_cycles(np.linspace(0.0, 0.9, 50) * CYCLE)) == 0


def test_wrong_times_are_refused():
    with pytest.raises(InputError, match="increasing"):
        sine_cycles(np.array([0.0, 0.0, 1.0]))
    with pytest.raises(InputError, match="within the samples"):
        sine_cycles(np.linspace(1.0, 2.0, 10))
