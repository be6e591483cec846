"""A judgement relative to a size holds whatever the sign of what it judges, and where a part of it is exactly 0.

Each tolerance that is relative to a quantity of either sign is tested by the mirrored motion, which is a motion of the
mirrored driveline, and by one of size 0.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from tcc_sim.analysis.orders import orders_of
from tcc_sim.analysis.periodicity import cycles_drift, periodicity, repeats_finely, stays
from tcc_sim.analysis.summary import slip_grows
from tcc_sim.analysis.torque_phase import PhaseTracker
from tcc_sim.estimation.identify import Gates
from tcc_sim.estimation.measurement import Measurement
from tcc_sim.estimation.multiple_shooting import Fit
from tcc_sim.estimation.verdicts import judged
from tcc_sim.estimation.windows import Model
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.per_cycle import with_peaks
from tcc_sim.sweeps.simulation import simulate
from tcc_sim.trajectory import Cycles

MIRRORED = pytest.mark.parametrize("sign", [1.0, -1.0])


def cycles(speed: np.ndarray, angle: float = 0.1, swing: float = 5.0) -> Cycles:
    """Cycles with these slip speeds on the section and a plate at rest."""
    section = np.stack([speed, np.full(len(speed), angle), np.zeros(len(speed))], axis=1)
    return Cycles(section, speed[1:] + swing, speed[1:] - swing, np.zeros(len(speed) - 1))


@MIRRORED
def test_growth_is_relative_to_the_size_of_the_motion(sign: float) -> None:
    """The flywheel's speed on the section is below 0 while the slip is above, and its mean wanders by rounding."""
    n = np.arange(91.0)
    wandering = sign * (-0.4 + 1e-13 * n)
    slow = Cycles(cycles(wandering).section, sign * np.full(90, 0.5) + 0.4, sign * np.full(90, 0.5) - 0.4, np.zeros(90))
    assert not slip_grows(slow)
    assert slip_grows(cycles(sign * (20.0 + 0.3 * n)))
    backwards = cycles(sign * (20.0 + 0.3 * n))
    backwards.section[:, 2] = -sign * 1000.0  # Both rotate backwards, so that the flywheel's speed is below 0.
    assert slip_grows(backwards)


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


@MIRRORED
@pytest.mark.parametrize("mean", [300.0, 0.0])
def test_the_phase_of_a_torque_is_found_whatever_its_mean(sign: float, mean: float) -> None:
    tracker, stamps = PhaseTracker(), np.arange(4000) * 1_000_000
    tracker.feed(stamps, sign * (mean + 100.0 * np.sin(150e-9 * stamps)))
    result = tracker.runs()[0]
    assert (result.low, result.high) == pytest.approx((150.0, 150.0), rel=1e-6)
    turns = 150.0 * result.starts / (2.0 * math.pi) + (0.0 if sign > 0.0 else 0.5)
    assert np.abs(turns - np.rint(turns)).max() < 1e-4


@MIRRORED
def test_a_peak_is_raised_to_its_parabola_below_0_too(sign: float) -> None:
    t = np.linspace(0.0, 1.0, 11) + 0.03
    y = 5.0 * sign - (t - 0.5) ** 2
    assert with_peaks(t, y).max() == pytest.approx(5.0 * sign, abs=1e-12)


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


def test_orders_of_a_mirrored_run_are_the_same() -> None:
    run = solve(load_scene("fig02"), cycles=40, samples_per_cycle=40)
    mirror = replace(run, **{name: -getattr(run, name) for name in (
        "slip_speed", "plate_angle", "plate_speed", "engine_torque", "friction_torque", "state")})
    one, other = orders_of(run), orders_of(mirror)
    assert one.slip_speed == pytest.approx(other.slip_speed)
    assert one.transmissibility == pytest.approx(other.transmissibility)


@pytest.mark.parametrize(("value", "verdict"), [(1e-12, "at its bound"), (0.0, "at its bound"), (0.1, "identified")])
def test_a_parameter_at_an_end_of_0_is_at_its_bound(value: float, verdict: str) -> None:
    """A fit in the logarithm of the damping comes near 0 and never reaches it."""
    t = np.arange(300) * 1e-3
    model = Model(load_scene("fig02").system, ("driveline.damping",), Measurement(t, {"slip_speed": np.sin(40.0 * t)}))
    fitted = Fit(np.array([value]), np.zeros((1, 3)), {}, 1.0, 0.0, 1000)
    assert judged(model, 0, 0.6, fitted, np.array([1e-3]), np.eye(1), True, Gates()).verdict == verdict
