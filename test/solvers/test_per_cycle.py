"""Results of cycles from samples of a motion in closed form, with all terms, missing samples and jumps."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import asdict

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.model.equations import Linear
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.profile import Inputs
from tcc_sim.solvers.per_cycle import cycles_from_samples, cycles_of_states, starts_of, with_peaks
from tcc_sim.solvers.terms import terms_of
from tcc_sim.trajectory import FarEnd

EVERY = Linear(0.2, 0.02, 0.6, 3000.0, 15.0, -11.0)
W, CYCLE = 40.0, 0.15
"""Fastest frequency of the motion, rad/s, and length of a cycle, s."""


def motion(t):
    """v, v', theta2, theta2', theta2'', theta3, w3, w3' of a plate and a far end that swing."""
    v, slip = 6.0 + 9.0 * np.sin(W * t + 0.3), 9.0 * W * np.cos(W * t + 0.3)
    angle = 0.1 + 0.02 * np.cos(1.7 * W * t)
    speed, plate = -0.034 * W * np.sin(1.7 * W * t), -0.0578 * W * W * np.cos(1.7 * W * t)
    return v, slip, angle, speed, plate, 0.01 * np.sin(9.0 * t), 0.09 * np.cos(9.0 * t), -0.81 * np.sin(9.0 * t)


def powers(t):
    """The friction torque times v, the heat of the fluid's torque, and the shaft's torque, by (2b)."""
    v, _, angle, speed, plate, far, far_speed, _ = motion(t)
    shaft = 0.6 * (speed - far_speed) + 3000.0 * (angle - far)
    return (0.02 * plate + shaft - 11.0 * v) * v, 11.0 * v * v, shaft


def cycles_of(t, starts, bridged=None, stick_speed=0.5):
    v, slip, angle, speed, plate, *far = motion(t)
    return cycles_from_samples(t, v, slip, angle, speed, plate, starts=starts, stick_speed=stick_speed, linear=EVERY,
                               far=FarEnd(*far), bridged=bridged)


def expected(begin, end, hidden=(math.inf, math.inf)):
    """Results of the cycle from `begin` to `end`, s, without the time that is `hidden`, by a fine grid."""
    t = np.union1d(np.linspace(begin, end, 20_001), [each for each in hidden if begin < each < end])
    middle, seen = 0.5 * (t[1:] + t[:-1]), (t <= hidden[0]) | (t >= hidden[1])
    h = np.where((middle < hidden[0]) | (middle > hidden[1]), np.diff(t), 0.0)
    power, heat, shaft = powers(t)
    v = motion(t)[0]
    low, high = np.minimum(v[1:], v[:-1]), np.maximum(v[1:], v[:-1])
    within, inside = (np.clip(high, -0.5, 0.5) - np.clip(low, -0.5, 0.5)) / (high - low), np.abs(v[seen]) <= 0.5
    return {"highest": v[seen].max(), "lowest": v[seen].min(), "stick_time": float(h @ within),
            "energy": float(0.5 * h @ (power[1:] + power[:-1])), "peak_power": power[seen].max(),
            "highest_shaft_torque": shaft[seen].max(), "lowest_shaft_torque": shaft[seen].min(),
            "breakaways": float((inside[:-1] & ~inside[1:]).sum()),
            "coupling_energy": float(0.5 * h @ (heat[1:] + heat[:-1]))}


def compare(result, n, wanted):
    got = {**{name: getattr(result, name)[n] for name in ("highest", "lowest", "stick_time")},
           **{name: values[n] for name, values in asdict(result.loads).items()}}
    assert got.keys() == wanted.keys()
    for name, value in wanted.items():
        scale = {"stick_time": 1e-3, "peak_power": 50.0 * abs(value)}.get(name, max(abs(value), 1.0))
        assert got[name] == pytest.approx(value, abs=2e-5 * scale), name


@pytest.mark.parametrize("count", [400, 397])
def test_all_results_are_those_of_the_closed_form(count):
    """With samples at the starts of the cycles, or between them."""
    t, starts = np.linspace(0.0, 0.8, count + 1), np.array([0.04, 0.19, 0.34, 0.49, 0.76])
    result = cycles_of(t, starts)
    assert len(result) == 4
    for n in range(4):
        compare(result, n, expected(starts[n], starts[n + 1]))
    v, _, angle, speed, *_ = motion(starts)
    for column, exact, error in zip(result.section.T, (v, angle, speed), (3e-6, 1e-9, 3e-6)):
        np.testing.assert_allclose(column, exact, rtol=0.0, atol=error)
    none = cycles_of(t, starts[:1])
    assert (len(none), none.section.shape, {*map(len, asdict(none.loads).values())}) == (0, (1, 3), {0})


@pytest.mark.parametrize("gap", [(0.2501, 0.2899), (0.1701, 0.2199), (0.3301, 0.5299)])
def test_nothing_between_the_neighbours_of_a_missing_sample_counts(gap):
    """Within a cycle, across a start, and a whole cycle, of which nothing is known."""
    t, starts = np.linspace(0.0, 0.8, 401), np.array([0.04, 0.19, 0.34, 0.49, 0.76])
    t = t[(t < gap[0]) | (t > gap[1])]
    bridged = np.diff(t) > 0.01
    hidden = t[:-1][bridged][0], t[1:][bridged][0]
    result = cycles_of(t, starts, bridged)
    few = cycles_of(t, starts[starts < hidden[1]], bridged)  # The last cycle may be one without a sample.
    np.testing.assert_array_equal(few.loads.energy, result.loads.energy[:len(few)])
    for n in range(4):
        begin, end = starts[n], starts[n + 1]
        if hidden[0] <= begin and end <= hidden[1]:
            assert (result.stick_time[n], result.loads.energy[n], result.loads.coupling_energy[n]) == pytest.approx(
                (0.0, 0.0, 0.0), abs=1e-9)
            extremes = result.highest, result.lowest, *result.loads.columns()[1:4]
            assert np.isnan([column[n] for column in extremes]).all()
            continue
        compare(result, n, expected(begin, end, hidden))
    plain, none = cycles_of(t, starts), cycles_of(t, starts, np.zeros(len(t) - 1, bool))
    np.testing.assert_equal(asdict(plain), asdict(none))


def test_the_set_valued_law_is_at_rest_where_both_ends_are_and_after_a_jump_of_the_slope():
    """v falls at 4 rad/s^2 to 0 at 0.5 s, rests, and rises as 9 (t - 1.1)^2 from 1.1 s on."""
    t = np.arange(0.0, 2.0001, 0.2)
    v = np.where(t <= 0.5, 2.0 - 4.0 * t, np.where(t < 1.1, 0.0, 9.0 * (t - 1.1) ** 2))
    a = np.where(t <= 0.5, -4.0, np.where(t < 1.1, 0.0, 18.0 * (t - 1.1)))
    still = np.zeros(len(t))
    for start, end, sign in ((0.0, 2.0, 1.0), (0.1, 1.9, 1.0), (0.0, 2.0, -1.0), (0.1, 1.9, -1.0)):
        result = cycles_from_samples(t, sign * v, sign * a, still, still, still, starts=np.array([start, end]),
                                     stick_speed=0.0)
        assert result.stick_time == pytest.approx(0.6, abs=1e-12)
        assert (result.lowest if sign > 0.0 else result.highest)[0] == pytest.approx(0.0, abs=1e-12)


def test_times_of_samples_and_cycles():
    for first, end, starts in ((0, 0.3, [0.0, 0.15, 0.3]), (1, 0.46, [0.15, 0.3, 0.45]), (3, 0.3, [0.45]),
                               (0, 0.3 - 1e-10, [0.0, 0.15, 0.3]), (0, 0.3 - 1e-9, [0.0, 0.15])):
        assert starts_of(None, first, end, CYCLE).tolist() == pytest.approx(starts, rel=1e-9)
    constant, ramp = replace(System(), {"engine.frequency": 2.0 * math.pi / CYCLE}), replace(System(), {
        "engine.frequency_times": [0.0, 1.0], "engine.frequency_values": [8.0 * math.pi, 16.0 * math.pi]})
    assert starts_of(constant, 1, 0.46).tolist() == pytest.approx([0.15, 0.3, 0.45])
    assert starts_of(ramp, 1, 0.5).tolist() == pytest.approx([math.sqrt(1.0 + n / 2.0) - 1.0 for n in (1, 2)])
    assert starts_of(ramp, 1, math.sqrt(2.0) - 1.0).tolist() == starts_of(ramp, 1, 0.5).tolist()
    assert len(starts_of(ramp, 3, 0.1)) == 1
    t = np.linspace(0.0, 0.9, 91)
    for starts, fine in (([-1e-9, 0.5], True), ([-1e-8, 0.5], False), ([0.1, 0.9 + 4e-9], True), ([0.1, 0.91], False),
                         ([0.95], True), ([-1.0], False)):
        if fine:
            cycles_of(t, np.array(starts))
        else:
            with pytest.raises(InputError) as refused:
                cycles_of(t, np.array(starts))
            assert str(refused.value) == (
                f"periods of excitation from {starts[0]:g} to {starts[-1]:g} s must lie within the samples, which go "
                "from 0 to 0.9 s")
    for wrong in (t[:1], np.array([0.0, 0.1, 0.1]), np.array([[0.0, 1.0]])):
        with pytest.raises(InputError, match=r"sample times .* two or more and strictly increasing"):
            cycles_of(wrong, np.array([0.0]))


def test_a_jump_of_the_torque_cuts_the_samples_on_both_sides():
    """Friction in fast slip is the load: with a load that jumps at 0.31 s the slip speed is two lines."""
    system = replace(System(), {
        "engine.torque_amplitude": 0.0, "engine.mean_torque": 0.0, "engine.frequency": 2.0 * math.pi / CYCLE,
        "driveline.stiffness": 1e-3, "driveline.damping": 0.0, "driveline.plate_inertia": 10.0, "friction.decay": 0.0,
        "friction.kinetic_coefficient": 0.3})
    terms = terms_of(dataclasses.replace(system, inputs=Inputs(None, np.array([[0.0, 4e4, 0.0], [0.31, 1e5, 0.0]]),
                                                               1.0)))
    rate = 2.4e-3 * (1.0 / 0.2 + 1.0 / 10.0)  # Of v, rad/s^2 per Pa; of theta2' by the plate alone.

    def states_at(t):
        past = np.maximum(t - 0.31, 0.0)
        speed = 2.4e-4 * (4e4 * t + 6e4 * past)
        return np.stack([9e3 - rate / 2.4e-4 * speed, 1.2e-4 * (4e4 * t**2 + 6e4 * past**2), speed], axis=1)

    v = states_at(np.array([0.15, 0.3, 0.31, 0.45]))[:, 0]
    for t in (np.arange(0.0, 0.45001, 0.025), np.append(np.arange(0.0, 0.31, 0.025), np.arange(0.31, 0.4501, 0.02))):
        result = cycles_of_states(t, states_at(t), terms, np.array([0.15, 0.3, 0.45]))
        assert result.highest.tolist() == pytest.approx(v[:2].tolist(), rel=1e-6)
        assert result.lowest.tolist() == pytest.approx(v[[1, 3]].tolist(), rel=1e-6)
        energy = 0.5 * np.array([96.0 * 0.15 * (v[0] + v[1]),
                                 96.0 * 0.01 * (v[1] + v[2]) + 240.0 * 0.14 * (v[2] + v[3])])
        assert result.loads.energy.tolist() == pytest.approx(energy.tolist(), rel=2e-5)
        assert result.loads.peak_power.tolist() == pytest.approx([96.0 * v[0], 240.0 * v[2]], rel=1e-4)
        assert result.section == pytest.approx(states_at(np.array([0.15, 0.3, 0.45])), rel=1e-6)


def test_a_peak_is_the_vertex_of_a_parabola_unless_it_is_no_smooth_top():
    t = np.array([0.0, 1.0, 3.0, 4.0, 5.0])
    smooth = 10.0 - (t - 2.5) ** 2
    assert with_peaks(t, smooth).tolist() == pytest.approx([*smooth[:2], 10.0, *smooth[3:]])
    assert with_peaks(t, -smooth).tolist() == (-smooth).tolist()
    assert with_peaks(t[:2], smooth[:2]).tolist() == smooth[:2].tolist()
    assert with_peaks(t[:3], np.array([0.0, 5.0, 1.0]))[1] > 5.0  # It has no neighbour that says how bent it is.
    for before, after, raised in ((0.226, 0.5, True), (0.5, 0.226, True), (0.224, 0.5, False), (0.5, 0.224, False)):
        # Half the second differences; that of the top is 0.9, and its parabola 0.1^2/(4 0.9) higher.
        y = np.array([-2.0 - 2.0 * before, -1.0, 0.0, -0.8, -1.6 - 2.0 * after])
        assert with_peaks(np.arange(5.0), y)[2] == pytest.approx(0.01 / 3.6 if raised else 0.0, rel=1e-9)
    jump = np.array([0.0, 1.0, np.nextafter(1.0, 2.0), 2.0])
    assert with_peaks(jump, np.array([0.0, 3.0, 2.9, 1.0])).tolist() == [0.0, 3.0, 2.9, 1.0]
