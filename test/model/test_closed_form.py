"""Closed forms against direct integration of (1), (2), (12) by SciPy and against the paper's printed identities."""

import cmath
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from tcc_sim.errors import InputError
from tcc_sim.model import closed_forms
from tcc_sim.model.parameters import System, replace

RICH = {"engine.harmonic_amplitudes": (60.0, 0.0, 35.0), "engine.harmonic_phases": (0.7, 0.0, -2.0)}
LOAD = {"pressure.amplitude": 60e3, "pressure.frequency_ratio": 1.5, "pressure.phase": 0.9}


BASE = replace(System(), {"pressure.mean": 225e3, "pressure.amplitude": 0.0, "friction.kinetic_coefficient": 0.3,
                          "engine.frequency": 150.0})


def system_of(values=None, **groups):
    return replace(BASE, {**(values or {}), **groups})


def engine(system, t):
    e = system.engine
    out = e.mean_torque + e.torque_amplitude * np.sin(e.frequency * t)
    for n, (a, p) in enumerate(zip(e.harmonic_amplitudes, e.harmonic_phases), 2):
        out = out + a * np.sin(n * e.frequency * t + p)
    return out


def load(system, t):
    p = system.pressure
    return system.torque_per_pressure * np.maximum(
        p.mean + p.amplitude * np.sin(p.frequency_ratio * system.engine.frequency * t + p.phase), 0.0)


@pytest.mark.parametrize("omega", [20.0, 118.0, 900.0])
def test_pure_stick_is_the_steady_motion_of_one_inertia(omega):
    system = system_of(RICH, **{"engine.frequency": omega, "driveline.damping": 2.0})
    d = system.driveline
    angle, torque = closed_forms.plate_angle(system), closed_forms.stuck_interface_torque(system)
    t = np.linspace(0.0, 2 * system.cycle, 41)
    both = d.flywheel_inertia + d.plate_inertia
    start = [float(angle(0.0)), float(angle.rate()(0.0))]
    run = solve_ivp(lambda t, y: [y[1], (engine(system, t) - d.damping * y[1] - d.stiffness * y[0]) / both], (0, t[-1]),
                    start, t_eval=t, method="DOP853", rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(angle(t), run.y[0], atol=1e-10)
    acceleration = angle.rate().rate()(t)
    np.testing.assert_allclose(torque(t), engine(system, t) - d.flywheel_inertia * acceleration, atol=1e-8)
    np.testing.assert_allclose(torque(t), d.plate_inertia * acceleration + d.damping * angle.rate()(t)
                               + d.stiffness * angle(t), atol=1e-8, err_msg="(24)")


@pytest.mark.parametrize(("values", "omega"), [
    ({}, 30.0), ({**RICH, **LOAD}, 30.0), ({**LOAD, "pressure.amplitude": 300e3}, 30.0),
    ({**LOAD, "pressure.frequency_ratio": 4 / 3, "friction.kinetic_coefficient": 0.2}, 150.0),
    ({"engine.mean_torque": -300.0, **LOAD}, 150.0)])
def test_stick_margin_is_the_least_over_a_dense_grid(values, omega):
    system = system_of(values, **{"engine.frequency": omega})
    result = closed_forms.stick_margin(system)
    t = np.linspace(0.0, 3 * system.cycle, 300_001)
    margin = system.friction_ratio * load(system, t) - np.abs(closed_forms.stuck_interface_torque(system)(t))
    assert result.torque <= margin.min() + 1e-9
    assert result.torque == pytest.approx(margin.min(), abs=2e-5 if load(system, t).min() > 0.0 else 2e-2)
    again = (system.friction_ratio * load(system, result.time)
             - abs(float(closed_forms.stuck_interface_torque(system)(result.time))))
    assert again == pytest.approx(result.torque, abs=1e-9)


def test_paper_fig_8_pure_stick_reaches_to_018():
    system = system_of(**{"pressure.amplitude": 0.25 * 225e3})
    limits = closed_forms.stick_limits(system, 0.02 * 387.298, 0.29 * 387.298, 60)
    assert limits.lower / system.natural_frequency == pytest.approx(0.18, abs=0.01)


SLIP = {"friction.kinetic_coefficient": 0.3, "initial.plate_angle": 0.05, "initial.plate_speed": -4.0}


@pytest.mark.parametrize(("damping", "values", "direction"), [
    (0.0, LOAD, -1), (0.6, {**RICH, **LOAD}, 1), (60.0, LOAD, 1), (2.0 * math.sqrt(3000.0 * 0.02), {}, -1),
    (0.6, {**RICH, **LOAD, "converter.coupling": 0.8}, 1)])
def test_pure_slip_solves_12(damping, values, direction):
    system = system_of(values, **SLIP, **{"driveline.damping": damping, "pressure.mean": 125e3})
    d, s = system.driveline, system.initial
    t = np.linspace(0.0, 3 * system.cycle, 61)

    def rates(t, y):
        torque = direction * load(system, t) + system.converter.coupling * y[0]
        plate = (torque - d.damping * y[2] - d.stiffness * y[1]) / d.plate_inertia
        return [(engine(system, t) - torque) / d.flywheel_inertia - plate, y[2], plate]

    run = solve_ivp(rates, (0, t[-1]), [s.slip_speed, s.plate_angle, s.plate_speed], t_eval=t, method="DOP853",
                    rtol=1e-12, atol=1e-11)
    result = closed_forms.pure_slip(system, direction)
    np.testing.assert_allclose(result.slip_speed(t), run.y[0], atol=1e-8)
    np.testing.assert_allclose(result.plate_angle(t), run.y[1], atol=1e-10)
    np.testing.assert_allclose(result.plate_speed(t), run.y[2], atol=1e-8)
    growth = (300.0 - direction * system.saturation_mean) / 0.2 if system.converter.coupling == 0.0 else 0.0
    assert result.a1 == pytest.approx(growth, rel=1e-13)
    assert (result.decay, result.stiffness, result.angle_offset, result.speed_offset) == pytest.approx(
        (damping / 0.04, 150e3, 0.05 - float(result.plate(0.0)), -4.0 - float(result.plate.rate()(0.0))))


CRITICAL = 2.0 * math.sqrt(3000.0 * 0.02)
SLIPS = st.fixed_dictionaries({
    "engine.mean_torque": st.sampled_from([300.0, 301.0, 310.0, 290.0]),
    "engine.torque_amplitude": st.floats(0.0, 200.0),
    "engine.frequency": st.floats(40.0, 300.0), "pressure.amplitude": st.sampled_from([0.0, 20e3]),
    "pressure.frequency_ratio": st.sampled_from([1.0, 0.5, 1.5, math.sqrt(2.0)]),
    "driveline.damping": st.sampled_from([0.0, 0.05, 0.6, 5.0, CRITICAL,
                                          CRITICAL * (1.0 + 1e-9), 1.01 * CRITICAL, 60.0]),
    "converter.coupling": st.sampled_from([0.0, 0.1, 1.0, 10.0]), "initial.slip_speed": st.floats(5.0, 150.0),
    "initial.plate_angle": st.floats(0.0, 0.2)})


@settings(max_examples=20, deadline=None, derandomize=True)
@given(SLIPS, st.sampled_from([{}, RICH]))
def test_the_least_slip_speed_is_that_of_a_dense_grid_or_a_bound_of_it(values, harmonics):
    result = closed_forms.pure_slip(system_of(values, **harmonics, **{"pressure.mean": 125e3}))
    least, exact, lasts = result.least_slip
    seen = min(float(result.slip_speed(t).min()) for t in (np.linspace(0.0, 2.0, 20_001),
                                                           np.linspace(0.0, 60.0, 60_001)))
    if least == -math.inf:
        assert result.a1 < 0.0
        assert (exact, lasts) == (True, False)
        return
    assert least <= seen + 1e-6
    assert lasts is (least > 0.0) or (lasts is None and not exact)
    if exact:
        assert least == pytest.approx(seen, abs=0.3)  # A grid of a minute misses some of a quasi-periodic motion.
    repeats = values["pressure.amplitude"] == 0.0 or values["pressure.frequency_ratio"] != math.sqrt(2.0)
    assert exact or not repeats or values["driveline.damping"] == 0.0


def test_slip_that_a_slow_exponential_lets_fall_lasts_above_its_steady_minimum():
    """From 150 rad/s at 0.45 1/s to 10 rad/s, the coupling's 1 N m over 0.1 N m s/rad; the sines have 1.67 rad/s."""
    keys = {"engine.mean_torque": 301.0, "engine.torque_amplitude": 50.0, "pressure.mean": 125e3,
            "converter.coupling": 0.1, "initial.slip_speed": 150.0, "initial.plate_angle": 0.1}
    for damping in (0.6, CRITICAL, CRITICAL * (1.0 + 1e-7)):
        result = closed_forms.pure_slip(system_of(keys, **{"driveline.damping": damping}))
        assert result.a0 == pytest.approx(10.0)
        assert result.least_slip == (pytest.approx(10.0 - result.slip.swing()), True, True)


@pytest.mark.parametrize("speed", [20.0, 60.0])
def test_the_transient_can_end_a_slip_that_16_lets_pass(speed):
    system = system_of(**{"pressure.mean": 125e3, "initial.slip_speed": speed})
    result = closed_forms.pure_slip(system)
    d = system.driveline
    run = solve_ivp(lambda t, y: [(engine(system, t) - 300.0) / d.flywheel_inertia - (300.0 - d.damping * y[2]
                                  - d.stiffness * y[1]) / d.plate_inertia, y[2],
                                  (300.0 - d.damping * y[2] - d.stiffness * y[1]) / d.plate_inertia],
                    (0.0, 0.4), [speed, 0.0, 0.0], "DOP853", np.linspace(0.0, 0.4, 8001), rtol=1e-9, atol=1e-9)
    assert result.least_slip_speed == pytest.approx(run.y[0].min(), abs=1e-2)
    assert result.margin > 0.0
    assert result.least_slip == (result.least_slip_speed, True, speed == 60.0)


@pytest.mark.parametrize("decay", [0.0, 1.0, 3.0 * (1.0 - 1e-15), 3.0, 3.0 * (1.0 + 1e-12), 5.0])
def test_a_damped_pair_is_cosine_and_sine_of_a_complex_frequency(decay):
    t, wd = np.linspace(0.0, 2.0, 9), cmath.sqrt(9.0 - decay**2) or 1e-12
    for result, exact in zip(closed_forms.damped_pair(t, decay, 9.0), (np.cos(wd * t), np.sin(wd * t) / wd)):
        np.testing.assert_allclose(result, (np.exp(-decay * t) * exact).real, atol=1e-6 if decay > 2.0 else 1e-14)


def test_slip_that_the_mean_torque_ends_or_drives_has_a_sign():
    for mean, direction, growth, least in ((310.0, 1, 50.0, True), (290.0, 1, -50.0, False), (-310.0, -1, -50.0, True),
                                           (-290.0, -1, 50.0, False), (300.0 * (1.0 + 1e-15), 1, 0.0, True)):
        result = closed_forms.pure_slip(system_of(**{
            "engine.mean_torque": mean, "pressure.mean": 125e3, "engine.torque_amplitude": 1.0,
            "initial.slip_speed": 150.0 * direction, "initial.plate_angle": 0.1 * direction}), direction)
        assert (result.a1, result.a1 == 0.0, result.direction) == (pytest.approx(growth), growth == 0.0, direction)
        assert (result.least_slip_speed > 0.0) == (result.least_slip_speed > -math.inf) == least
    still = closed_forms.pure_slip(system_of(**{"pressure.mean": 125e3, "engine.torque_amplitude": 0.0,
                                             "initial.plate_angle": 0.1}))
    assert still.least_slip_speed == pytest.approx(150.0)


@pytest.mark.parametrize(("values", "words"), [
    ({"friction.kinetic_coefficient": 0.2}, ["friction.kinetic_coefficient", "0.2", "static_coefficient", "0.3"]),
    ({"friction.slip_speeds": [0.0, 1.0, 2.0], "friction.coefficients": [0.3, 0.2, 0.19]}, ["friction table"]),
    ({"pressure.amplitude": 225.1e3}, ["pressure.amplitude", "pressure.mean"]),
    ({"driveline.damping": 0.0, "pressure.amplitude": 1e3, "engine.frequency": 1.0, "driveline.stiffness": 0.02},
     ["pressure.frequency_ratio", "1 rad/s"])])
def test_cases_without_a_closed_form_are_refused(values, words):
    with pytest.raises(InputError) as refused:
        closed_forms.pure_slip(system_of(values))
    assert [word for word in words if word not in str(refused.value)] == []
    assert closed_forms.pure_slip(system_of(**{"pressure.amplitude": 225e3})).direction == 1


def test_undamped_stuck_resonance_is_refused():
    system = system_of(**{"driveline.damping": 0.0, "driveline.stiffness": 0.22, "engine.frequency": 1.0})
    for work in (closed_forms.plate_angle, closed_forms.stuck_interface_torque, closed_forms.stick_margin):
        with pytest.raises(InputError, match=r"^engine.frequency excites the undamped stuck resonance, 1 rad/s: no "):
            work(system)
    limits = closed_forms.stick_limits(replace(system, {"engine.torque_amplitude": 10.0}), 0.5, 2.0, 12)
    assert (limits.lower, limits.higher) == pytest.approx((math.sqrt(5.06 / 5.26), math.sqrt(5.5 / 5.3)))


def test_margins_without_a_torque_or_a_load_that_varies():
    still = {"engine.torque_amplitude": 0.0}
    for values, torque, time, sticks in (
            (still, 240.0, 0.0, True), ({**still, "engine.mean_torque": -600.0}, -60.0, 0.0, False),
            ({**still, "engine.mean_torque": 540.0}, 0.0, 0.0, True),
            ({**still, "pressure.amplitude": 25e3}, 180.0, math.nan, True),
            ({**still, "pressure.amplitude": 250e3}, -300.0, math.nan, False)):
        result = closed_forms.stick_margin(system_of(values))
        assert (result.torque, result.sticks) == (pytest.approx(torque, abs=1e-9), sticks)
        assert result.time == pytest.approx(time, nan_ok=True)
    system = system_of(**{"pressure.frequency_ratio": math.sqrt(2), "pressure.amplitude": 225e3})
    assert closed_forms.stick_margin(system).torque == pytest.approx(
        -300.0 - 250.0 * abs(closed_forms.interface_response(system, 150.0)), abs=1e-9)
    assert math.isnan(closed_forms.stick_margin(system).time)
    only = system_of(**{"engine.frequency": 30.0})
    turn = (0.5 * math.pi - np.angle(closed_forms.interface_response(only, 30.0))) / 30.0
    assert closed_forms.stick_margin(only).time == pytest.approx(turn, abs=1e-5)


def test_limits_of_stick_exist_where_stick_begins_or_ends():
    """The mean and the amplitude times a gain are 540 N m there; the gain is 1 at low frequency and 0.09 at high."""
    for amplitude, mean, count in ((150.0, -300.0, 2), (250.0, 300.0, 1), (150.0, 540.0, 0)):
        system = system_of(**{"engine.torque_amplitude": amplitude, "engine.mean_torque": mean})
        closed, limits = closed_forms.constant_load_limits(system), closed_forms.stick_limits(system, 5.0, 2000.0, 16)
        assert len(closed) == count
        for omega in closed:
            gain = abs((3000.0 - 0.02 * omega**2 + 0.6j * omega) / (3000.0 - 0.22 * omega**2 + 0.6j * omega))
            assert abs(mean) + amplitude * gain == pytest.approx(540.0)
        expected = {2: closed, 1: (None, *closed), 0: (None, None)}[count]
        assert [x and round(x, 6) for x in limits] == [x and round(x, 6) for x in expected]
    second = {"engine.harmonic_amplitudes": (150.0,), "engine.harmonic_phases": (0.0,), "engine.torque_amplitude": 0.0}
    half = 0.5 * np.array(closed_forms.constant_load_limits(system_of(**{"engine.torque_amplitude": 150.0})))
    assert list(closed_forms.stick_limits(system_of(second), 5.0, 2000.0, 2)) == pytest.approx(half.tolist())
    for low, high in ((0.0, 1.0), (2.0, 2.0), (3.0, 2.0)):
        with pytest.raises(InputError, match=f"{low:g} to {high:g} rad/s"):
            closed_forms.stick_limits(BASE, low, high)
    for values in ({"pressure.amplitude": 1.0}, RICH, {"engine.torque_amplitude": 0.0}):
        with pytest.raises(InputError, match=r"pressure.amplitude"):
            closed_forms.constant_load_limits(system_of(values))
