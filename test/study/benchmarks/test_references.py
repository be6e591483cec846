"""The independent solutions: equations against differences and by hand, modes, and arcs in closed form."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from tcc_sim.model.parameters import System, replace
from tcc_sim.study.benchmarks import references
from tcc_sim.study.benchmarks.references import Law, Unfinished, coefficient, slope

FREE = {"engine.harmonic_amplitudes": (40.0, 10.0), "engine.harmonic_phases": (0.3, -0.2)}
SYSTEM = replace(System(), {**FREE, "pressure.phase": 0.4, "pressure.frequency_ratio": 0.5,
                            "friction.kinetic_coefficient": 0.2})
STATE = np.array([0.03, 0.12, -4.0])
T = 0.0123


def test_torques_and_loads_by_hand():
    law, e, p = Law(SYSTEM), SYSTEM.engine, SYSTEM.pressure
    w = e.frequency
    engine = (e.mean_torque + e.torque_amplitude * math.sin(w * T) + 40.0 * math.sin(2.0 * w * T + 0.3)
              + 10.0 * math.sin(3.0 * w * T - 0.2))
    assert law.engine(T) == pytest.approx(engine)
    assert law.load(T) == pytest.approx(0.2 * 0.008 * (p.mean + p.amplitude * math.sin(0.5 * w * T + 0.4)))
    shaft = 0.6 * -4.0 + 3000.0 * 0.12
    assert law.need(T, STATE) == pytest.approx((0.02 * engine + 0.2 * shaft) / 0.22)
    assert law.rates(T, STATE, 2) == pytest.approx([engine / 0.2 + shaft / 0.02, -4.0, -shaft / 0.02, -3.97])
    assert law.rates(T, STATE, 0)[0] == 0.0
    assert law.rates(T, STATE, 0)[2] == pytest.approx((engine - shaft) / 0.22)  # Both inertias together.
    for mode, v in ((1, 0.3), (-1, -0.3)):
        torque = mode * law.load(T) * (1.0 + 0.5 * math.exp(-2.0 * 0.3))
        rates = law.rates(T, [v, 0.12, -4.0], mode)
        assert rates[2] == pytest.approx((torque - shaft) / 0.02)
        assert rates[0] + rates[2] == pytest.approx((engine - torque) / 0.2)


@pytest.mark.parametrize("mode", [0, 1, -1, 2, 3])
@pytest.mark.parametrize("v", [0.03, -0.02])
def test_the_jacobian_is_that_of_differences(mode, v):
    """Of fourth order; law (6) is taken on its own side of v = 0."""
    law = Law(replace(SYSTEM, {"converter.coupling": 1.5}), drag=0.3)
    state = np.array([abs(v) * mode if mode in (1, -1) else 0.0 if mode == 0 else v, 0.12, -4.0, 0.1])
    steps = np.diag([1e-5, 1e-4, 1e-2, 1e-2])
    columns = [(8.0 * (np.array(law.rates(T, state + h, mode)) - law.rates(T, state - h, mode))
                - (np.array(law.rates(T, state + 2.0 * h, mode)) - law.rates(T, state - 2.0 * h, mode)))
               / (12.0 * h.max()) for h in steps]
    free = slice(int(mode == 0), 4)  # In stick v stays 0.
    np.testing.assert_allclose(np.array(law.jacobian(T, state, mode))[:, free], np.array(columns).T[:, free], rtol=1e-6,
                               atol=1e-6)


def test_slopes_at_rest_and_on_the_other_side():
    law = [(0.5, 2.0)], 50.0
    assert slope(0.0, 3, *law) == pytest.approx(50.0 * 1.5)
    assert slope(-0.1, 1, *law) == slope(0.0, 1, *law) == pytest.approx(-2.0 * 0.5)
    assert coefficient(-0.1, 1, *law) == coefficient(0.0, 1, *law) == -coefficient(0.0, -1, *law) == pytest.approx(1.5)
    assert coefficient(-0.1, 3, *law) == pytest.approx(-math.tanh(5.0) * (1.0 + 0.5 * math.exp(-0.2)))


def held(load, need):
    """Law (6), mu_s/mu_k = 1.5, with a constant load and a constant need of friction torque of an untwisted shaft."""
    system = replace(SYSTEM, {"friction.law": "set_valued"})
    return Law(system, engine=lambda t: need * 0.22 / 0.02, pressure=lambda t: load / (0.2 * 0.008))


@pytest.mark.parametrize(("load", "need", "v", "mode"), [
    (0.0, 0.0, 1.0, 2), (-1.0, 0.0, 1.0, 2), (100.0, 0.0, 1.0, 1), (100.0, 0.0, -1.0, -1), (100.0, 150.0, 0.0, 0),
    (100.0, 151.0, 0.0, 1), (100.0, -151.0, 0.0, -1), (100.0, -150.0, 0.0, 0)])
def test_the_first_mode(load, need, v, mode):
    assert held(load, need).first_mode(np.array([v, 0.0, 0.0])) == mode


@pytest.mark.parametrize(("mode", "free", "v", "need", "following", "after"), [
    (2, True, 1.0, 0.0, 1, 1.0), (2, True, -1.0, 0.0, -1, -1.0), (2, True, 1e-10, 10.0, 0, 1e-10),
    (2, True, 1e-10, 200.0, 1, 1e-10), (1, True, 1.0, 0.0, 2, 1.0), (0, True, 0.0, 0.0, 2, 0.0),
    (0, False, 0.0, 151.0, 1, 0.0), (0, False, 0.0, -151.0, -1, 0.0), (1, False, 1e-8, 10.0, 0, 0.0),
    (-1, False, 1e-8, 200.0, 1, 0.0)])
def test_the_mode_after_an_event(mode, free, v, need, following, after):
    state = np.array([v, 0.0, 0.0])
    assert held(100.0, need).following(T, state, mode, free) == following
    assert state[0] == after


def test_scales_below_which_errors_are_absolute():
    twist = (300.0 + 250.0) / 3000.0
    base = {"engine.mean_torque": -300.0, "engine.torque_amplitude": 250.0}
    natural = math.sqrt(3000.0 / 0.02)
    for change, slip, angle in (({}, 0.02, twist), ({"friction.smoothing": 1e7}, 1e-6, twist),
                                ({"friction.law": "set_valued"}, 1.0, twist),
                                ({"engine.mean_torque": 0.0, "engine.torque_amplitude": 0.5}, 0.02, 1.0 / 3000.0)):
        scales = references.error_scales(replace(System(), {**base, **change}))
        assert scales == pytest.approx([slip, angle, angle * natural])


def test_a_reference_ends_after_its_evaluations():
    law = Law(System(), 2)
    law.rates(0.0, STATE, 3)
    law.rates(0.0, STATE, 3)
    with pytest.raises(Unfinished):
        law.rates(0.0, STATE, 3)


def test_the_final_state_is_where_free_slip_ends():
    """Without a load the flywheel follows its torque, and the undamped plate its spring."""
    system = replace(System(), {"pressure.mean": 0.0, "pressure.amplitude": 0.0, "driveline.damping": 0.0,
                                "friction.law": "set_valued", "initial.slip_speed": 5.0, "initial.plate_angle": 0.1})
    end, largest = references.final_state(system, 0.01, "DOP853", 1e-12)
    w, natural = system.engine.frequency, math.sqrt(150e3)
    plate = -0.1 * natural * math.sin(natural * 0.01)
    flywheel = 5.0 + (300.0 * 0.01 + 250.0 / w * (1.0 - math.cos(w * 0.01))) / 0.2
    assert system.engine.mean_torque == 300.0
    assert end == pytest.approx([flywheel - plate, 0.1 * math.cos(natural * 0.01), plate], rel=1e-8)
    assert largest[1] == pytest.approx(0.1)
    assert largest[2] == pytest.approx(0.1 * natural, rel=1e-3)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("times", "largest"), [
    ([1.0, 1.3, 1.9, 2.2], 1.0), ([0.1, 0.2, 0.3], math.sin(0.3)), ([2.0, 2.2, 2.5], math.sin(2.0)), ([1.5, 1.6], 1.0),
    ([0.3], math.sin(0.3)), ([1.2, 1.4, 4.5, 4.9], 1.0)])
def test_the_largest_speed_of_an_arc_lies_between_its_nodes(side, times, largest):
    """Of v = sin t; an arc in stick has none."""
    law = SimpleNamespace(rates=lambda t, y, mode: [side * math.cos(t), 0.0, 0.0, 0.0])
    t = np.array(times)
    y = side * np.stack([np.sin(t), 0.0 * t, 0.0 * t])
    assert references.largest_speed(law, t, y, 1, 1e-12, np.full(3, 1e-14)) == pytest.approx(largest, abs=1e-12)
    assert references.largest_speed(law, t, y, 0, 1e-12, np.full(3, 1e-14)) == 0.0
