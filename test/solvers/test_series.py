"""Series of steps against the equations of motion, and torque and load against the model."""

import math
from fractions import Fraction

import numpy as np
import pytest
from plain import plain

from tcc_sim.compiling.compiled import compiled
from tcc_sim.model import equations
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import excitation, series
from tcc_sim.solvers.series import ANGLE, COLUMNS, ENGINE, LOAD, ROWS, SLIP, SPEED
from tcc_sim.solvers.terms import terms_of

PAPER = equations.Linear(0.2, 0.02, 0.6, 3000.0)
EVERY = equations.Linear(0.2, 0.02, 0.6, 3000.0, 15.0, 4.0, -11.0)


def test_sine_and_cosine_are_good_to_the_last_bits():
    angles = np.concatenate([np.random.default_rng(0).uniform(-700.0, 700.0, 20000), np.arange(-40, 41) * math.pi / 4,
                             [1e5]])
    values = np.array([series.sine_and_cosine(x) for x in angles])
    assert np.abs(values[:, 0] - [math.sin(x) for x in angles]).max() <= 3e-16
    assert np.abs(values[:, 1] - [math.cos(x) for x in angles]).max() <= 3e-16


@compiled
def expand(order, rows, unit, linear, sign, pulsation, stribeck, excess, sigma, tanh, sech):
    series.expand(order, rows, unit, linear, sign, pulsation, stribeck, excess, sigma, tanh, sech)


CASES = {"sliding": (None, None, None, None, None), "falling": ((0.25, 2.0), 0.22, None, None, None),
         "layer": ((0.25, 2.0), 0.22, 50.0, 0.98, 1.0 - 0.98**2),
         "three exponentials": ((0.25, 2.0, 0.1, 0.5, -0.05, 0.1), 0.22, 50.0, 0.98, 1.0 - 0.98**2),
         "layer without stribeck": (None, None, 50.0, 0.98, 1.0 - 0.98**2)}


@pytest.mark.parametrize("linear", [PAPER, EVERY], ids=["paper", "every coefficient"])
@pytest.mark.parametrize("pulsation", [None, (100.0, 150.0, 0.3)])
@pytest.mark.parametrize("name", CASES)
def test_motion_solves_the_equations(name, pulsation, linear):
    """The coefficients give the derivatives that the equations of motion say, evaluated at a small x."""
    stribeck, excess, sigma, tanh, sech = CASES[name]
    start = np.zeros((ROWS, COLUMNS))
    start[[SLIP, ANGLE, SPEED], 0] = [math.atanh(0.98) / 50.0, 0.1, -3.0]
    start[ENGINE, :3], start[LOAD, :3] = [300.0, 2.0, 0.1], [500.0, 1.0, -0.2]
    plain, unit, order = start.copy(), 1e-6, 14
    text = series.motion(plain, unit, linear, 1.0, pulsation, stribeck, excess, sigma, tanh, sech)
    while next(text) < order:
        pass
    if name == "layer" and pulsation:
        compiled = start.copy()
        expand(order, compiled, unit, linear, 1.0, pulsation, stribeck, excess, sigma, tanh, sech)
        np.testing.assert_allclose(compiled[[SLIP, ANGLE, SPEED], :order], plain[[SLIP, ANGLE, SPEED], :order],
                                   rtol=1e-9, atol=1e-15)
    x = np.array([0.0, 0.2, 0.5])
    v, angle, speed = (np.polynomial.Polynomial(plain[row, :order + 1]) for row in (SLIP, ANGLE, SPEED))
    engine = np.polynomial.Polynomial(start[ENGINE, :3])(x)
    load = np.polynomial.Polynomial(start[LOAD, :3])(x) if pulsation else start[LOAD, 0]
    law = np.tanh(sigma * v(x)) if sigma else 1.0
    if stribeck:
        shares = [excess, *(c * math.exp(-a * v(0.0)) for c, a in zip(stribeck[2::2], stribeck[3::2]))]
        law = law * (1.0 + sum(c * np.exp(-a * (v(x) - v(0.0))) for c, a in zip(shares, stribeck[1::2])))
    i1, i2, damping, stiffness, by_slip, by_speed, plate_by_slip = equations.coefficients_of(linear)
    plate = (law * load - damping * speed(x) - stiffness * angle(x) - plate_by_slip * v(x)) / i2
    flywheel = (engine - law * load - by_slip * v(x) - by_speed * speed(x)) / i1
    np.testing.assert_allclose(speed.deriv()(x) / unit, plate, rtol=1e-9)
    np.testing.assert_allclose(v.deriv()(x) / unit, flywheel - plate, rtol=1e-9)
    np.testing.assert_allclose(angle.deriv()(x) / unit, speed(x), rtol=1e-10)


def test_the_quick_root_is_never_too_large_and_hardly_too_small():
    for base in 10.0 ** np.random.default_rng(1).uniform(-30.0, 30.0, 300):
        for n in (17, 20, 22, 28):
            root = base ** (1.0 / n)
            assert 0.985 * root <= series.power_of_two(series.logarithm(base) / n) <= root


SCENES = {
    "sines": {"engine.harmonic_amplitudes": [80.0, 0.0, 40.0], "engine.harmonic_phases": [0.3, 0.0, 1.0],
              "pressure.frequency_ratio": 2.0 / 3.0, "pressure.phase": 0.5},
    "clamped": {"pressure.mean": 2e5, "pressure.amplitude": 4e5, "pressure.phase": 1.0},
    "constant": {"engine.torque_amplitude": 0.0, "pressure.amplitude": 0.0},
}


@pytest.mark.parametrize("name", SCENES)
def test_values_rates_and_coefficients_are_those_of_the_model(name):
    system = replace(System(), SCENES[name])
    terms, waves = terms_of(system), excitation.waves_of(terms_of(system))
    drive, rows = np.zeros(1, excitation.DRIVE)[0], np.full((ROWS, COLUMNS), np.nan)
    shift = terms.pulsation[2] if terms.pulsation else 0.0
    unit = 1e-3
    for tau in (0.0, 0.011, 0.03):
        _, loaded = excitation.clamp_edge(tau, 1.0, shift, terms.mean_load, terms.pulsation, None)
        excitation.excite(tau, shift, loaded, terms.mean_torque, waves, terms.mean_load, terms.pulsation, None, drive)
        excitation.expand_excitation(rows, 20, unit, tau, loaded, terms.mean_torque, waves, terms.mean_load,
                                     terms.pulsation, None, drive)
        h = 1e-6

        def torque(t):
            return equations.engine_torque(t, terms.mean_torque, terms.torque, terms.harmonics)

        def load(t):
            return equations.saturation_torque(t, terms.mean_load, terms.pulsation)

        assert drive["torque"] == pytest.approx(torque(tau), rel=1e-13)
        assert drive["load"] == pytest.approx(load(tau), rel=1e-13)
        assert drive["torque_rate"] == pytest.approx((torque(tau + h) - torque(tau - h)) / (2 * h), rel=1e-6, abs=1e-4)
        assert drive["load_rate"] == pytest.approx((load(tau + h) - load(tau - h)) / (2 * h), rel=1e-6, abs=1e-4)
        assert np.polynomial.polynomial.polyval(0.7, rows[ENGINE, :20]) == pytest.approx(torque(tau + 0.7 * unit),
                                                                                         rel=1e-13)
        coefficients = rows[LOAD, :20] if terms.pulsation else rows[LOAD, :1]
        assert np.polynomial.polynomial.polyval(0.7, coefficients) == pytest.approx(load(tau + 0.7 * unit), rel=1e-13)


@pytest.mark.parametrize("amplitude", [3.0, -3.0])
def test_the_clamp_sets_in_and_ends_where_the_sine_meets_minus_its_mean(amplitude):
    mean, rate, shift = 2.0, 10.0, 0.4
    tau, seen = 0.0, []
    while tau < 2.0:
        until, loaded = excitation.clamp_edge(tau, 2.0, shift, mean, (amplitude, rate, shift), None)
        middle = mean + amplitude * math.sin(rate * 0.5 * (tau + until) + shift)
        assert loaded == (middle > 0.0)
        assert until > tau
        if until < 2.0:
            assert mean + amplitude * math.sin(rate * until + shift) == pytest.approx(0.0, abs=1e-10)
        seen.append(loaded)
        tau = until
    assert len(seen) >= 6
    assert all(seen[i] != seen[i + 1] for i in range(len(seen) - 1))


def test_a_load_that_stays_above_zero_has_no_edges():
    assert excitation.clamp_edge(0.3, 2.0, 0.0, 2.0, (1.0, 10.0, 0.0), None) == (2.0, True)
    assert excitation.clamp_edge(0.3, 2.0, 0.0, 2.0, None, None) == (2.0, True)
    assert excitation.clamp_edge(0.3, 2.0, 0.0, 0.0, None, None) == (2.0, False)


@pytest.mark.parametrize("ratio", [0.7, 2.0 / 3.0, 1.37])
@pytest.mark.parametrize("cycle", [1, 999_983, 9_999_991])
def test_the_loads_phase_loses_no_digits_after_many_cycles(ratio, cycle):
    exact = 2.0 * math.pi * float(Fraction(ratio) * cycle % 1) + 0.25
    result = excitation.load_phase(ratio, (1.0, ratio, 0.25), cycle)
    assert math.remainder(result - exact, 2.0 * math.pi) == pytest.approx(0.0, abs=4e-15)


ROW = np.array([0.01, 0.5, 150.0, 4000.0, 100.0, 300.0, 500.0, -2000.0, 0.06, 3.0, 0.3, 1.0, 0.0, 50.0, 700.0, 3.0, 0.4,
                20.0, -300.0])
"""A piece of a profile from 0.01 to 0.06 s in a cycle: phase, frequency, mean torque and load with their rates, the
load's phase, and two harmonics of varying amplitude.
"""
WAVES = np.array([(2.0, 30.0, 0.7, 0.0, 0.0), (5.0, -8.0, 1.1, 0.0, 0.0)], excitation.WAVE).view(np.recarray)
PULSATION = (400.0, 1.5, 9.0)


def torque_of_row(t):
    past = t - 0.01
    phase = 0.5 + 150.0 * past + 2000.0 * past**2
    return (100.0 + 300.0 * past + (50.0 + 700.0 * past) * np.sin(phase)
            + (20.0 - 300.0 * past) * np.sin(3.0 * phase + 0.4) + 30.0 * np.sin(2.0 * phase + 0.7)
            - 8.0 * np.sin(5.0 * phase + 1.1))


def load_of_row(t):
    past = t - 0.01
    return 500.0 - 2000.0 * past + 400.0 * np.sin(1.5 * (0.5 + 150.0 * past + 2000.0 * past**2) + 0.3)


def test_an_excitation_that_varies_has_values_and_rates_of_its_row():
    """The phase of `PULSATION` itself and that of the call do not count: the row has the load's phase."""
    of = plain(excitation)
    for tau in (0.01, 0.03, 0.055):
        drive, h = np.zeros(1, excitation.DRIVE).view(np.recarray)[0], 1e-6
        for loaded in (True, False):
            of.excite(tau, 7.0, loaded, 1.0, WAVES, 2.0, PULSATION, ROW, drive)
            load = max(load_of_row(tau), 0.0) if loaded else 0.0
            rate = (load_of_row(tau + h) - load_of_row(tau - h)) / (2 * h) if loaded else 0.0
            assert (drive["torque"], drive["load"]) == pytest.approx((torque_of_row(tau), load), rel=1e-12)
            assert drive["torque_rate"] == pytest.approx((torque_of_row(tau + h) - torque_of_row(tau - h)) / (2 * h),
                                                         abs=1e-2)
            assert drive["load_rate"] == pytest.approx(rate, abs=1e-2)
        for loaded in (True, False):
            rows, at = np.full((ROWS, COLUMNS), np.nan), tau + 0.7 * 2e-3
            of.expand_varying(rows, 24, 2e-3, tau, loaded, WAVES, PULSATION, ROW, drive)
            torque, load = (np.polynomial.polynomial.polyval(0.7, rows[row, :24]) for row in (ENGINE, LOAD))
            assert (torque, load) == pytest.approx((torque_of_row(at), load_of_row(at) if loaded else 0.0), rel=1e-12)
        assert of.torque_about_mean(tau, 40.0, WAVES, ROW) == pytest.approx(torque_of_row(tau) - 40.0)
        value, rate = of.load_and_rate(tau, PULSATION, ROW)
        assert value == pytest.approx(load_of_row(tau), rel=1e-12)
        assert rate == pytest.approx((load_of_row(tau + h) - load_of_row(tau - h)) / (2 * h), abs=1e-2)


@pytest.mark.parametrize(("mean", "slope"), [(500.0, -2000.0), (380.0, 0.0), (-100.0, 3000.0), (399.9, 0.0),
                                             (-399.9, 0.0), (-600.0, 0.0), (0.0, 0.0)])
def test_a_clamp_that_varies_switches_where_the_load_changes_its_sign(mean, slope):
    """Every edge, against a fine grid; one at which the load only nearly meets 0 is found too, and the row's end."""
    row = ROW.copy()
    row[6:8] = mean, slope
    t = np.linspace(0.01, 0.06, 100_001)
    past = t - 0.01
    load = mean + slope * past + 400.0 * np.sin(1.5 * (0.5 + 150.0 * past + 2000.0 * past**2) + 0.3)
    expected = t[1:][np.diff(np.sign(load)) != 0.0]
    tau, edges = 0.01, []
    while tau < 0.06:
        until, loaded = excitation.edge_varying(tau, 0.08, PULSATION, row)
        assert loaded == (load[np.searchsorted(t, 0.5 * (tau + until))] > 0.0)
        edges.append(until)
        tau = until
    assert edges == pytest.approx([*expected, 0.06], abs=1e-6)
    assert excitation.edge_varying(0.01, 0.011, PULSATION, row)[0] == pytest.approx(min(edges[0], 0.011), abs=1e-12)
