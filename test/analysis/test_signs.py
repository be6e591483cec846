"""A judgement relative to a size holds for the mirrored motion, and where a part of it is exactly 0."""

import math

import numpy as np
import pytest

from tcc_sim.analysis.steady.summary import cycles_drift, periodicity, repeats_finely, stays
from tcc_sim.scene import load_scene
from tcc_sim.sweeps.simulation import simulate
from tcc_sim.trajectory import Cycles

MIRRORED = pytest.mark.parametrize("sign", [1.0, -1.0])


def cycles(speed: np.ndarray, angle: float = 0.1, swing: float = 5.0) -> Cycles:
    """Cycles with these slip speeds on the section and a plate at rest."""
    section = np.stack([speed, np.full(len(speed), angle), np.zeros(len(speed))], axis=1)
    return Cycles(section, speed[1:] + swing, speed[1:] - swing, np.zeros(len(speed) - 1))


@MIRRORED
@pytest.mark.parametrize(("angle", "speed"), [(0.1, 20.0), (0.0, 20.0), (-0.1, 0.0), (0.0, 0.0)])
def test_a_section_repeats_whatever_its_sign_and_where_a_coordinate_is_0(sign: float, angle: float,
                                                                         speed: float) -> None:
    turns = np.array([1.0, 0.4])[np.arange(61) % 2]
    still = cycles(sign * speed * turns, sign * angle, 0.0)
    period = 2 if speed else 1
    repetition = periodicity(still)
    assert (repetition.period, repetition.settled) == (period, True)
    assert stays(still[:40], still[40:], period)
    assert repeats_finely(still, period, 20)
    assert not cycles_drift(still)
    if speed:
        fading = still.section[:, 0] * (1.0 + 0.01 * np.arange(61))
        assert not periodicity(cycles(fading, sign * angle)).settled
        assert cycles_drift(cycles(sign * speed * (1.0 + 0.01 * np.arange(61)), sign * angle, 0.0))


@pytest.mark.parametrize("name", ["fig02", "slip", "stick", "chaos"])
def test_a_mirrored_scene_is_judged_alike(name: str) -> None:
    scene = load_scene(name)
    e, start = scene.system.engine, scene.system.initial
    # A sine of the opposite sign is one half a period later, and so is the load that goes with it.
    mirror = scene.with_values({
        "engine.mean_torque": -e.mean_torque, "initial.slip_speed": -start.slip_speed,
        "initial.plate_angle": -start.plate_angle, "initial.plate_speed": -start.plate_speed,
        "engine.torque_amplitude": 0.0, "engine.harmonic_amplitudes": (e.torque_amplitude,),
        "engine.harmonic_phases": (math.pi,), "engine.frequency": 0.5 * e.frequency,
        "pressure.frequency_ratio": 2.0 * scene.system.pressure.frequency_ratio})
    one, other = (simulate(each, cycles=count, discard=count // 2).summary
                  for each, count in ((scene, 120), (mirror, 60)))
    assert (one.regime, one.runaway, one.period > 0) == (other.regime, other.runaway, other.period > 0)
    if name != "chaos":
        assert one.max_slip_speed == pytest.approx(other.max_slip_speed, rel=1e-5, abs=1e-9)
        assert one.clutch_energy == pytest.approx(other.clutch_energy, rel=1e-4)
        assert one.max_shaft_torque == pytest.approx(-other.min_shaft_torque, rel=1e-5)
