"""Constant motions by the law written out here, cuts of periodic ones, and loops of the slip controller by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from tcc_sim.errors import InputError, OutOfRange
from tcc_sim.estimation.linearise import OperatingPoint, linearise
from tcc_sim.estimation.operating_point import operating_point
from tcc_sim.model.parameters import System
from tcc_sim.scene import Scene, load_scene

STILL = load_scene("controlled").with_values({"engine.torque_amplitude": 0.0, "pressure.amplitude": 0.0})
"""200 N m; mu_s 0.3, mu_k 0.27, alpha 2 s/rad, sigma 50 s/rad, A R 0.008 m^3."""
PER = 0.27 * 0.008


def system(law: str = "smoothed", **values: float) -> System:
    """STILL with a law and values of a few keys."""
    keys = {"coupling": "converter.coupling", "torque": "engine.mean_torque", "pressure": "pressure.mean"}
    return STILL.with_values({"friction.law": law, **{keys[name]: value for name, value in values.items()}}).system


def law(v: float, name: str) -> float:
    """Friction over mu_k N R."""
    step = math.tanh(50.0 * v) if name == "smoothed" else math.copysign(1.0, v)
    return (1.0 + (0.3 / 0.27 - 1.0) * math.exp(-2.0 * abs(v))) * step


@pytest.mark.parametrize("name", ["smoothed", "set_valued"])
@pytest.mark.parametrize(("coupling", "torque", "slip"), [(0.0, 200.0, 0.7), (0.5, 200.0, 20.0), (0.5, -200.0, -20.0)])
def test_constant_slip_balances_the_mean_torque(name: str, coupling: float, torque: float, slip: float) -> None:
    motion = operating_point(system(name, coupling=coupling, torque=torque), slip)
    load = PER * motion.system.pressure.mean
    assert motion.mean_slip == slip
    assert load * law(slip, name) == pytest.approx(torque - coupling * slip)
    slope = (law(slip + 1e-5, name) - law(slip - 1e-5, name)) / 2e-5
    assert (motion.slope, motion.by_pressure) == (pytest.approx(load * slope, rel=1e-6),
        pytest.approx(PER * law(slip, name)))


def test_without_a_slip_speed_the_pressure_decides() -> None:
    """Stick, as creep of the smoothed law, or the slip at which a coupling carries what friction does not."""
    for name in ("smoothed", "set_valued"):
        for torque in (200.0, -200.0):
            stuck = operating_point(system(name, torque=torque, pressure=2e5), None)
            if name == "set_valued":
                assert (stuck.mean_slip, stuck.slope, stuck.by_pressure) == (0.0, math.inf, 0.0)
                continue
            creep = brentq(lambda v, torque=torque: PER * 2e5 * law(v, "smoothed") - torque, -0.03, 0.03, xtol=1e-15)
            assert stuck.mean_slip == pytest.approx(creep, rel=1e-9)
            slips = operating_point(system(name, torque=torque, pressure=5e4, coupling=0.5), None)
            slip = brentq(lambda v: PER * 5e4 * law(v, "smoothed") + 0.5 * v - 200.0, 1.0, 400.0)
            assert slips.mean_slip == pytest.approx(math.copysign(slip, torque), rel=1e-9)


@pytest.mark.parametrize("name", ["smoothed", "set_valued"])
def test_slip_that_friction_does_not_carry_runs_away_and_slip_on_which_it_rises_settles(name: str) -> None:
    """From 50 rad/s friction carries 216 N m, and stick 240: 230 N m had a constant slip of 1200 rad/s. Where friction
    rises with slip from 72 N m, it carries 75 N m at one slip speed; that was refused as a runaway.
    """
    for torque, carried in ((230.0, 216), (241.0, 240)):
        with pytest.raises(OutOfRange, match=rf"runs away.* {torque:g} N m.* {carried} N m"):
            operating_point(system(name, torque=torque, pressure=1e5), None)
    late = operating_point(system(name, torque=215.9, pressure=1e5), None)
    assert abs(late.mean_slip) < 0.05
    rising = STILL.with_values({"friction.law": name, "friction.kinetic_coefficient": 0.33, "friction.decay": 0.05,
                                "engine.mean_torque": 75.0, "pressure.mean": 3e4, "initial.slip_speed": 1.0}).system
    exact = brentq(lambda v: 240.0 * (0.33 - 0.03 * math.exp(-0.05 * v)) - 75.0, 1.0, 100.0)
    assert operating_point(rising, None).mean_slip == pytest.approx(exact, rel=1e-9)
    equal = STILL.with_values({"friction.law": name, "friction.kinetic_coefficient": 0.3,
                               "pressure.mean": 200.0 / 0.0024})
    found = operating_point(equal.system, None)
    assert found.mean_slip == pytest.approx(50.0, rel=1e-9)
    assert found.slope == 0.0


@pytest.mark.parametrize(("scene", "options", "words"), [
    (STILL.with_values({"pressure.mean": 5e4}), {}, ("runs away", "200 N m", "120 N m")),
    (STILL, {"slip": -5.0}, ("-5 rad/s", "engine.mean_torque", "200 N m")),
    (STILL.with_values({"converter.coupling": 20.0}), {"slip": 10.0}, ("10 rad/s", "200 N m pass beside friction")),
    *((STILL, {"slip": x}, ("slip speed", f"{x:g} rad/s")) for x in (0.0, math.nan)),
    (STILL.with_values({"pressure.source": "harmonic", "pressure.amplitude": 1e3,
                        "pressure.frequency_ratio": math.sqrt(0.5)}), {}, ("pressure.frequency_ratio", "0.707107")),
    (load_scene("controlled").with_values({"engine.mean_torque": 0.0}), {"slip": 5.0}, ("engine.mean_torque", "0 N m")),
    (load_scene("controlled").with_values({"pressure.mean": 5e4}), {}, ("runs away", "200 N m", "108 N m", "--slip")),
    (load_scene("chaos"), {}, ("no motion", "16", "400")),
    (STILL, {"input": "pressure"}, ("input", "'pressure'", "actuation_pressure or engine_torque")),
    (STILL, {"output": "slip"}, ("output", "'slip'", "slip_speed or friction_torque or shaft_torque")),
    (STILL, {"frequencies": []}, ("0 frequencies", "1 to 100000")),
    (STILL, {"frequencies": [1.0] * 100_001}, ("100001", "1 to 100000")),
    *((STILL, {"slip": 5.0, "frequencies": [1.0, x]}, (f"{x:g} rad/s", "1e-06 to 1e+06")) for x in (0.9e-6, 1.1e6)),
    (STILL, {"slip": 5.0, "controller": (0.0, 1.0)}, ("proportional", "0", "above 0")),
    (STILL, {"slip": 5.0, "controller": (1.0, math.inf)}, ("integral", "inf", "above 0")),
    (STILL.with_values({"friction.law": "set_valued", "pressure.mean": 3e5}), {"controller": (1.0, 1.0)}, ("sticks",)),
    (STILL.with_values({"engine.mean_torque": -200.0}), {"slip": -5.0, "controller": (1.0, 1.0)}, ("-5 rad/s",)),
    *((STILL.with_values(values), {"slip": 5.0, "controller": (1.0, 1.0)}, (ticks, "4 to 2000")) for values, ticks in (
        ({"rate": 83.0}, "3.477 ticks at 83"), ({"engine.frequency": 3.1385}, "2002 ticks at 1000"))),
    (load_scene("runup"), {}, ("periodic excitation",))])
def test_what_has_no_transfer_function_or_loop_is_refused(scene: Scene, options: dict[str, object],
                                                          words: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as error:
        linearise(scene, **{"frequencies": [10.0], **options})
    assert all(word in str(error.value) for word in words), str(error.value)


def test_a_linearisation_has_columns_arrays_and_a_text() -> None:
    found = linearise(STILL, slip=5.0, frequencies=[1e-6, 30.0, 1e6])
    assert found.operating_point == OperatingPoint(5.0, found.pressure, 200.0, 1)
    assert list(found.columns()) == ["frequency", "gain", "phase"]
    turning = replace(found, response=np.exp(1j * np.array([3.0, -3.0, -1.0])) * 2.0)
    assert turning.phase == pytest.approx([3.0, 2.0 * math.pi - 3.0, 2.0 * math.pi - 1.0])
    assert turning.gain == pytest.approx([2.0] * 3)
    arrays = turning.arrays()
    assert {name: np.shape(arrays[name]) for name in arrays} == {
        "A": (3, 3), "B": (3, 1), "C": (1, 3), "D": (1, 1), "dt": (), "frequencies": (3,), "gain": (3,), "phase": (3,),
        "multipliers": (3,)}
    sizes = np.exp(np.linalg.eigvals(found.a).real * STILL.system.cycle)
    assert np.abs(found.multipliers) == pytest.approx(np.sort(sizes)[::-1])
    stiff = linearise(STILL.with_values({"driveline.stiffness": 1.0, "driveline.plate_inertia": 10.0}), slip=5.0)
    assert (len(stiff.frequencies), stiff.frequencies[0], stiff.frequencies[-1]) == (240, 2.0, pytest.approx(6.0))
