"""Torque and load against the equations of the model, and the edges of the clamp against its closed form."""

import math
from fractions import Fraction

import numpy as np
import pytest

from tcc_sim.model import equations
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import excitation
from tcc_sim.solvers.series import COLUMNS, ENGINE, LOAD, ROWS
from tcc_sim.solvers.terms import terms_of

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
    found = excitation.load_phase(ratio, (1.0, ratio, 0.25), cycle)
    assert math.remainder(found - exact, 2.0 * math.pi) == pytest.approx(0.0, abs=4e-15)
