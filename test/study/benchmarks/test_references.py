"""The independent solutions: equations against differences and by hand, and the end of free slip in closed form."""

import math

import numpy as np
import pytest

from tcc_sim.model.parameters import System, replace
from tcc_sim.study.benchmarks import references
from tcc_sim.study.benchmarks.references import Law

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
