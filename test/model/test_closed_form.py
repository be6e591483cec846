"""Closed forms against direct integration of (1), (2), (12) by SciPy and against the paper's printed identities."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tcc_sim.errors import InputError
from tcc_sim.model import pure_slip, pure_stick
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.sines import common_cycles

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
    angle, torque = pure_stick.plate_angle(system), pure_stick.stuck_interface_torque(system)
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


@pytest.mark.parametrize("omega", [60.0, 200.0])
def test_printed_forms_with_their_errata(omega):
    system = system_of(**{"engine.frequency": omega})
    d, e = system.driveline, system.engine
    both = d.flywheel_inertia + d.plate_inertia
    phase = pure_stick.stick_phase(system, omega)
    assert -math.pi <= phase <= 0.0
    assert (phase < -math.pi / 2) == (omega > system.stuck_natural_frequency)
    t = np.linspace(0.0, system.cycle, 9)
    root = math.sqrt((d.stiffness - both * omega**2) ** 2 + (d.damping * omega) ** 2)
    np.testing.assert_allclose(pure_stick.plate_angle(system)(t), e.mean_torque / d.stiffness
                               + e.torque_amplitude / root * np.sin(omega * t + phase), atol=1e-14, err_msg="(8a)")
    np.testing.assert_allclose(pure_stick.stuck_interface_torque(system)(t),
                               engine(system, t) + d.flywheel_inertia * omega**2
                               * e.torque_amplitude / root * np.sin(omega * t + phase), atol=1e-10, err_msg="(9)")
    assert system.stuck_natural_frequency / system.natural_frequency == pytest.approx(math.sqrt(0.02 / 0.22), rel=1e-14)


@pytest.mark.parametrize(("values", "omega"), [
    ({}, 30.0), ({**RICH, **LOAD}, 30.0), ({**LOAD, "pressure.amplitude": 300e3}, 30.0),
    ({**LOAD, "pressure.frequency_ratio": 4 / 3, "friction.kinetic_coefficient": 0.2}, 150.0),
    ({"engine.mean_torque": -300.0, **LOAD}, 150.0)])
def test_stick_margin_is_the_least_over_a_dense_grid(values, omega):
    system = system_of(values, **{"engine.frequency": omega})
    result = pure_stick.stick_margin(system)
    t = np.linspace(0.0, 3 * system.cycle, 300_001)
    margin = system.friction_ratio * load(system, t) - np.abs(pure_stick.stuck_interface_torque(system)(t))
    assert result.torque <= margin.min() + 1e-9
    assert result.torque == pytest.approx(margin.min(), abs=2e-5 if load(system, t).min() > 0.0 else 2e-2)
    again = (system.friction_ratio * load(system, result.time)
             - abs(float(pure_stick.stuck_interface_torque(system)(result.time))))
    assert again == pytest.approx(result.torque, abs=1e-9)


def test_incommensurable_load_meets_every_phase():
    system = system_of(**{**LOAD, "pressure.frequency_ratio": math.sqrt(2), "pressure.amplitude": 20e3})
    torque = pure_stick.stuck_interface_torque(system)
    peak = torque.mean + torque.swing()
    assert pure_stick.stick_margin(system).torque == pytest.approx(
        system.friction_ratio * (system.saturation_mean - system.saturation_amplitude) - peak, abs=1e-9)


def test_stick_limits_from_both_sides_and_in_closed_form():
    system = system_of(**{"engine.torque_amplitude": 150.0})
    limits = pure_stick.stick_limits(system, 5.0, 2000.0, 60)
    exact = pure_stick.constant_load_limits(system)
    assert len(exact) == 2
    assert limits.lower == pytest.approx(exact[0], rel=1e-10)
    assert limits.higher == pytest.approx(exact[1], rel=1e-10)
    assert exact[0] < system.stuck_natural_frequency < exact[1]
    for omega in exact:
        assert 300.0 + 150.0 * abs(pure_stick.interface_response(system, omega)) == pytest.approx(540.0, rel=1e-12)
    strong = system_of()
    assert pure_stick.stick_limits(strong, 5.0, 2000.0, 60).lower is None
    assert len(pure_stick.constant_load_limits(strong)) == 1


def test_paper_fig_8_pure_stick_reaches_to_018():
    system = system_of(**{"pressure.amplitude": 0.25 * 225e3})
    limits = pure_stick.stick_limits(system, 0.02 * 387.298, 0.29 * 387.298, 60)
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
    result = pure_slip.pure_slip(system, direction)
    np.testing.assert_allclose(result.slip_speed(t), run.y[0], atol=1e-8)
    np.testing.assert_allclose(result.plate_angle(t), run.y[1], atol=1e-10)
    np.testing.assert_allclose(result.plate_speed(t), run.y[2], atol=1e-8)
    growth = (300.0 - direction * system.saturation_mean) / 0.2 if system.converter.coupling == 0.0 else 0.0
    assert result.a1 == pytest.approx(growth, rel=1e-13)


def test_corrected_17_and_18_for_constant_load():
    system = system_of(**{"pressure.mean": 125e3})
    result = pure_slip.pure_slip(system)
    d, omega = system.driveline, system.engine.frequency
    decay = d.damping / (2 * d.plate_inertia)
    wd = math.sqrt(d.stiffness / d.plate_inertia - decay**2)
    t = np.linspace(0.0, 0.3, 50)
    steady = 150.0 + 250.0 / (0.2 * omega) * (1 - np.cos(omega * t))
    assert result.a1 == pytest.approx(0.0, abs=1e-10)
    np.testing.assert_allclose(result.slip(t), steady, rtol=1e-13)
    np.testing.assert_allclose(result.slip_speed(t), steady - 300.0 / (0.02 * wd) * np.exp(-decay * t) * np.sin(wd * t),
                               atol=1e-9)


def test_condition_16_is_the_least_steady_slip_speed_where_omega_f_is_omega():
    system = system_of(**{"pressure.mean": 125e3, "pressure.amplitude": 40e3, "pressure.phase": 1.0,
                          "initial.slip_speed": 20.0})
    result = pure_slip.pure_slip(system)
    t = np.linspace(0.0, system.cycle, 20001)
    assert result.steady
    assert result.margin == pytest.approx(result.slip(t).min(), abs=1e-6)


def test_condition_16_has_a_sign():
    """From v0 = -150 slip in direction +1 is no slip: friction would drive the flywheel ahead."""
    backward = system_of(**{"pressure.mean": 125e3, "initial.slip_speed": -150.0})
    assert pure_slip.pure_slip(backward, 1).margin < 0.0
    assert pure_slip.pure_slip(backward, 1).least_slip_speed < 0.0
    mirrored = replace(backward, {"engine.mean_torque": -300.0})
    t = np.linspace(0.0, mirrored.cycle, 20001)
    result = pure_slip.pure_slip(mirrored, -1)
    assert result.margin == pytest.approx((-result.slip(t)).min(), abs=1e-6)
    assert result.margin > 0.0


@pytest.mark.parametrize(("values", "speed"), [
    ({}, 20.0), ({}, 60.0), ({"driveline.damping": 60.0}, 20.0), ({"driveline.damping": 0.05}, 45.0),
    ({**LOAD, "pressure.frequency_ratio": 1.5, "pressure.amplitude": 30e3}, 20.0), ({**RICH}, 60.0)])
def test_the_least_slip_speed_has_the_transient_in_it(values, speed):
    system = system_of(values, **{"pressure.mean": 125e3, "initial.slip_speed": speed})
    result = pure_slip.pure_slip(system)
    t = np.linspace(0.0, 0.4, 400_001)
    least = result.slip_speed(t).min()
    assert result.least_slip_speed <= least + 1e-9
    assert result.least_slip_speed == pytest.approx(least, abs=2e-5)
    if not values and speed == 20.0:
        assert result.margin > 0.0 > result.least_slip_speed  # (16) as printed passes a slip that the transient ends.


def test_without_a_common_period_or_damping_the_least_slip_speed_is_a_bound():
    rows = {"pressure.mean": 125e3, "pressure.amplitude": 30e3, "initial.slip_speed": 80.0}
    t = np.linspace(0.0, 20.0, 400_001)
    for values in ({"pressure.frequency_ratio": math.sqrt(2)}, {"driveline.damping": 0.0}):
        result = pure_slip.pure_slip(system_of(values, **rows))
        least = result.slip_speed(t).min()
        assert least - 2.0 < result.least_slip_speed <= least + 1e-9
    assert pure_slip.pure_slip(system_of(**{**rows, "pressure.mean": 130e3})).least_slip_speed == -math.inf
    assert pure_slip.pure_slip(system_of(**{**rows, "pressure.mean": 120e3})).least_slip_speed > 0.0


@pytest.mark.parametrize("phase", [0.0, 1.1])
@pytest.mark.parametrize("omega", [30.0, 116.7, 150.0])
def test_29_from_the_motion_of_12(phase, omega):
    """(29a) and I1 v' term by term, from the plate's steady motion under the load alone."""
    system = system_of(**{"pressure.amplitude": 90e3, "pressure.phase": phase, "engine.frequency": omega})
    d, t = system.driveline, np.linspace(0.0, system.cycle, 33)
    spring = complex(d.stiffness - d.plate_inertia * omega**2, d.damping * omega)
    plate = system.saturation_amplitude * np.exp(1j * (omega * t + phase)) / spring
    rate, bend = (1j * omega * plate).imag, (-omega**2 * plate).imag
    torque = engine(system, t) - load(system, t)
    slip = d.flywheel_inertia * (torque / d.flywheel_inertia - bend)
    np.testing.assert_allclose(pure_slip.slip_torque(system)(t), slip, atol=1e-9)
    ratio = d.flywheel_inertia / d.plate_inertia
    spring_torque = d.damping * rate + d.stiffness * (plate.imag + system.saturation_mean / d.stiffness)
    np.testing.assert_allclose(pure_slip.equivalent_torque(system)(t), slip - ratio * spring_torque, atol=1e-8)


def test_29b_rises_with_tsp_while_what_drives_the_slip_falls():
    rows = [system_of(**{"pressure.amplitude": 225e3 * x, "engine.frequency": 1.0}) for x in (0.0, 0.125, 0.25, 0.5)]
    assert [pure_slip.equivalent_torque(s).swing() for s in rows] == pytest.approx([250.0, 492.5, 1235.0, 2720.0])
    assert [pure_slip.slip_torque(s).swing() for s in rows] == pytest.approx([250.0, 182.5, 115.0, 20.0], abs=0.1)


@pytest.mark.parametrize(("values", "message"), [
    ({"friction.kinetic_coefficient": 0.2}, "kinetic_coefficient"),
    ({"pressure.amplitude": 300e3}, "above pressure.mean"),
    ({"driveline.damping": 0.0, "pressure.amplitude": 1e3, "engine.frequency": 1.0, "driveline.stiffness": 0.02},
     "resonance")])
def test_cases_without_a_closed_form_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        pure_slip.pure_slip(system_of(values))


def test_undamped_stuck_resonance_is_refused():
    system = system_of(**{"driveline.damping": 0.0, "driveline.stiffness": 0.22, "engine.frequency": 1.0})
    with pytest.raises(InputError, match="resonance"):
        pure_stick.plate_angle(system)
    with pytest.raises(InputError, match="resonance"):
        pure_stick.stuck_interface_torque(system)


def test_any_pressure_amplitude_counts_for_the_common_period():
    """0.24 N m are few, and the load repeats after three engine cycles all the same."""
    small = replace(System(), {"pressure.amplitude": 100.0, "pressure.frequency_ratio": 2.0 / 3.0})
    assert common_cycles(small) == 3
    assert common_cycles(replace(small, {"pressure.amplitude": 0.0})) == 1
