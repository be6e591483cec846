"""Verdicts and figures of controlled runs: loops whose truth is known by construction, in seven ways of observing them.

The slip speed of a loop is a mean as a function of time, a ripple at the excitation, and more. Its truth is worked out
from these functions, or is that of the same functions over three times the time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import cycle

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import tcc_sim
from tcc_sim.analysis.loop.control import Steps
from tcc_sim.analysis.loop.loop_verdict import LoopVerdict, Signal
from tcc_sim.analysis.loop.tracking import (
    Loop,
    LoopCycles,
    Tracking,
    checked_limits,
    loop_of,
    target_jumps,
    target_steps,
)
from tcc_sim.analysis.measured.engine_clock import Scheduled
from tcc_sim.errors import InputError
from tcc_sim.plant.closed_loop import LockstepRun
from tcc_sim.plant.slip_control import SlipController, Tuning
from tcc_sim.result import json_of
from tcc_sim.scene import load_scene
from tcc_sim.trajectory import Trajectory

CONTROLLED = load_scene("controlled").system
FREQUENCY = 150.0
CYCLE = 2.0 * math.pi / FREQUENCY
RIPPLE = 8.3
"""Amplitude of the slip speed within a period of excitation, rad/s."""


@dataclass(frozen=True)
class MadeUp:
    """A loop and the truth about its last segment.

    mean : of the slip speed at time t, rad/s
    targets : pairs of a time and the target from then on, or a function of time, published every 10 ms
    pressure, limits : applied pressure at time t, and stated limits, Pa
    ripple : by time and frequency of the excitation
    peak, at : peak of the deviation after the target was reached first, and its time
    settles : time from the start of the segment
    amplitude, period : of an oscillation of the mean
    judder : amplitude and frequency, Hz
    lag, gain : behind a moving target
    lasts : whether the same verdict, or too short, holds for every part of the run from its start that is observed
    """

    seconds: float
    mean: object
    verdict: str
    targets: object = ((0.0, 20.0),)
    pressure: object = None
    limits: object = None
    ripple: object = field(default=lambda t, w: RIPPLE * np.sin(w * t + 2.0))
    peak: float = math.nan
    at: float = math.nan
    settles: float = math.nan
    amplitude: float = math.nan
    period: float = math.nan
    overshoot: float = math.nan
    judder: tuple = (math.nan, math.nan)
    lag: float = math.nan
    gain: float = math.nan
    lasts: bool = True


def decay(size, tau, start=0.0):
    """Exponential from `start` on; before it, the size."""
    return lambda t: size * np.exp(-np.maximum(t - start, 0.0) / tau)


def flare(size, at, width):
    return lambda t: size * np.exp(-(((t - at) / width) ** 2))


def sine(size, period, lag=0.0):
    return lambda t: size * np.sin(2.0 * math.pi * t / period - lag)


def triangle(size, period):
    return lambda t: 2.0 * size / math.pi * np.arcsin(np.sin(2.0 * math.pi * t / period))


def around(value, *parts):
    return lambda t: value + sum(part(t) for part in parts) + 0.0 * t


def second_order(size, zeta, omega):
    """Step response from `size` to 0, which passes 0 by size exp(-pi zeta/sqrt(1 - zeta^2))."""
    damped = omega * math.sqrt(1.0 - zeta**2)
    return lambda t: size * np.exp(-zeta * omega * t) * (np.cos(damped * t) + zeta / math.sqrt(1.0 - zeta**2)
                                                         * np.sin(damped * t))


def noise(size, seed):
    """Noise of the mean of this size in a cycle, independent from one tick to the next."""
    values = np.random.default_rng(seed).normal(0.0, size * math.sqrt(1000.0 * CYCLE), 40_000)
    return lambda t: values[np.rint(1000.0 * t).astype(int)]


def stuck(level, swing):
    """Slip that stays at 0 within each period although its mean is `level`."""
    phase = np.linspace(0.0, 2.0 * math.pi, 40_001)[:-1]
    low, high = 0.0, 200.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.maximum(middle + swing * np.sin(phase), 0.0).mean() < level else (low, middle)
    return around(0.0), lambda t, w: np.maximum(low + swing * np.sin(w * t), 0.0)


def limited(low, high, at, during):
    """A rate limiter's step from low to high at a time, s, during some time."""
    return lambda t: low + (high - low) * np.clip((t - at) / during, 0.0, 1.0)


def no_ripple(t, w):
    return 0.0 * t


def judders(size, hertz, rate=0.0):
    return lambda t, w: RIPPLE * np.sin(w * t + 2.0) + size * np.exp(rate * t) * np.sin(2.0 * math.pi * hertz * t + 1.0)


SINE = around(20.0, sine(5.0, 2.0))
TRIANGLE = around(20.0, triangle(5.0, 2.0))
RAMP = lambda t: np.clip(20.0 + 20.0 * (t - 0.5) / 3.0, 20.0, 40.0)  # noqa: E731
OVERSHOOT = 30.0 * math.exp(-math.pi * 0.3 / math.sqrt(1.0 - 0.09))
STUCK = stuck(20.0, 45.0)
BAND = 0.02 * 30.0
LOOPS: dict[str, MadeUp] = {
    "good": MadeUp(5.0, around(20.0, decay(30.0, 0.1)), "settled", settles=0.1 * math.log(30.0 / BAND), overshoot=0.0),
    "good from below": MadeUp(5.0, around(20.0, decay(-15.0, 0.2)), "settled", settles=0.2 * math.log(50.0)),
    "overshoot": MadeUp(6.0, around(20.0, second_order(30.0, 0.3, 8.0)), "settled", peak=-OVERSHOOT,
                        at=math.pi / (8.0 * math.sqrt(0.91)), overshoot=OVERSHOOT),
    "overshoot, too short": MadeUp(2.4, around(20.0, second_order(30.0, 0.2, 8.0)), "too short"),
    "flare": MadeUp(6.0, around(20.0, decay(30.0, 0.1), flare(25.0, 1.5, 0.1)), "settled", peak=25.0, at=1.5,
                    settles=1.5 + 0.1 * math.sqrt(math.log(25.0 / BAND)), overshoot=0.0),
    "flare down": MadeUp(6.0, around(20.0, decay(30.0, 0.1), flare(-12.0, 1.5, 0.15)), "settled", peak=-12.0, at=1.5,
                         overshoot=12.0),
    "periodic flares": MadeUp(9.0, around(20.0, *(flare(5.0, k, 0.1) for k in range(1, 28))), "hunting", period=1.0,
                              lasts=False),
    "load step": MadeUp(4.0, lambda t: 20.0 + 15.7 * t / 0.15 * np.exp(1.0 - t / 0.15), "settled", peak=15.7, at=0.15,
                        settles=0.15 * 6.84, overshoot=15.7),
    "late spike": MadeUp(5.0, around(20.0, flare(15.0, 4.92, 0.09)), "too short", peak=15.0, at=4.92, lasts=False),
    "late load": MadeUp(6.0, lambda t: 20.0 + 3.0 * (t > 5.9) * (1.0 - np.exp(-(t - 5.9) / 0.05)), "too short",
                        lasts=False),
    "slow limit cycle": MadeUp(7.8, around(20.0, sine(1.0, 2.6, 0.25)), "hunting", amplitude=1.0, period=2.6),
    "two periods that end at 0": MadeUp(8.25, around(20.0, sine(0.8, 4.0, 0.15)), "hunting", amplitude=0.8, period=4.0),
    "small, slow, at a zero": MadeUp(12.05, around(20.0, sine(0.5, 8.0)), "too short"),
    "hunting within 2 % of the step": MadeUp(8.0, around(10.0, decay(300.0, 0.1), sine(5.5, 1.0 / 0.7)), "hunting",
                                             ((0.0, 10.0),), amplitude=5.5, period=1.0 / 0.7),
    "fast hunting": MadeUp(5.0, around(20.0, sine(3.0, 0.2)), "hunting", amplitude=3.0, period=0.2),
    "hunting about an offset": MadeUp(10.0, around(25.0, decay(30.0, 0.2), sine(2.0, 1.7)), "hunting", amplitude=2.0,
                                      period=1.7),
    "square hunting": MadeUp(10.0, lambda t: 20.0 + 4.0 * np.tanh(8.0 * np.sin(2.0 * math.pi * t / 0.47)), "hunting",
                             amplitude=4.0, period=0.47),
    "hunting at six cycles a period": MadeUp(4.819, around(20.0, sine(2.31, 6.076 * CYCLE, 1.332)), "hunting",
                                             amplitude=2.31, period=6.076 * CYCLE),
    "square at six cycles a period": MadeUp(
        4.356, around(20.0, lambda t: 4.84 * np.tanh(5.0 * np.sin(math.pi * (t / 3.075 / CYCLE + 1.0))),
                      decay(30.0, 0.1)),
        "hunting", amplitude=4.84, period=6.15 * CYCLE),
    "sawtooth": MadeUp(9.0, lambda t: 18.0 + 4.0 * (t / 1.3 % 1.0), "hunting", amplitude=2.0, period=1.3),
    "noisy hunting": MadeUp(10.0, around(20.0, sine(2.0, 2.0), noise(0.3, 1)), "hunting", amplitude=2.0, period=2.0),
    "a limit cycle that builds up": MadeUp(12.0, lambda t: 20.0 + 4.0 * np.tanh(0.02 * np.exp(1.5 * t))
                                           * np.sin(2.0 * math.pi * t / 0.8), "hunting", amplitude=4.0, period=0.8,
                                           lasts=False),
    "hunting from the middle on": MadeUp(12.0, lambda t: 20.0 + 2.0 * (t > 6.5) * np.sin(2.0 * math.pi * t / 1.3),
                                         "hunting", amplitude=2.0, period=1.3, lasts=False),
    "hunting that ends": MadeUp(12.0, lambda t: 20.0 + 2.0 * (t < 6.5) * np.sin(2.0 * math.pi * t / 1.3), "settled",
                                settles=6.5, lasts=False),
    "hunting with lock": MadeUp(10.0, lambda t: np.maximum(20.0 + 35.0 * np.sin(2.0 * math.pi * t / 1.5), 0.0),
                                "hunting", period=1.5, ripple=no_ripple),
    "noise": MadeUp(8.0, around(20.0, noise(0.5, 3)), "settled"),
    "noise after a step": MadeUp(8.0, around(20.0, decay(30.0, 0.2), noise(0.8, 4)), "settled"),
    "noise beside the target": MadeUp(8.0, around(24.0, noise(0.3, 5)), "off target"),
    "growing": MadeUp(8.0, lambda t: 20.0 + 0.02 * np.exp(0.8 * t) * np.sin(2.0 * math.pi * t / 0.9), "growing",
                      period=0.9, lasts=False),
    "growing twofold from swing to swing": MadeUp(
        10.5, lambda t: 20.0 + 7.0 * np.exp(0.86 * (t - 10.5)) * np.sin(2.0 * math.pi * t / 1.76), "growing",
        period=1.76, lasts=False),
    "growing without oscillation": MadeUp(8.0, lambda t: 20.0 + 0.01 * np.exp(t), "growing", lasts=False),
    "drifting": MadeUp(8.0, lambda t: 20.0 + 2.0 * np.maximum(t - 1.0, 0.0), "growing", lasts=False),
    "decaying too slowly": MadeUp(6.0, lambda t: 20.0 + 3.0 * np.exp(-0.15 * t) * np.sin(2.0 * math.pi * t / 0.8),
                                  "too short"),
    "small step, slow": MadeUp(6.0, lambda t: 20.8 - 0.8 * np.exp(-np.maximum(t - 3.0, 0.0) / 5.0), "too short",
                               ((0.0, 20.0), (3.0, 20.8)), peak=-0.8, lasts=False),
    "small step, ignored": MadeUp(8.0, around(100.0), "off target", ((0.0, 100.0), (3.0, 102.0)), peak=-2.0,
                                  lasts=False),
    "small step, followed": MadeUp(8.0, lambda t: 100.0 + 2.0 * (t > 3.0) * (1.0 - np.exp(-(t - 3.0) / 0.2)),
                                   "settled", ((0.0, 100.0), (3.0, 102.0)),
                                   settles=lambda band: 0.2 * math.log(2.0 / band)),
    "offset": MadeUp(6.0, around(23.0, decay(20.0, 0.3)), "off target"),
    "slip for a target of 0": MadeUp(6.0, around(3.0), "off target", ((0.0, 0.0),), peak=3.0,
                                     ripple=lambda t, w: 0.5 * np.sin(w * t)),
    "lock for a target of 0": MadeUp(5.0, lambda t: np.where(t < 0.5, 50.0 * (1.0 - t / 0.5), 0.0), "settled",
                                     ((0.0, 0.0),), settles=0.49, ripple=no_ripple),
    "lock from lock": MadeUp(5.0, around(0.0), "settled", ((0.0, 0.0),), settles=0.0,
                             ripple=lambda t, w: 1e-4 * np.sin(w * t)),
    "target reversed, ignored": MadeUp(6.0, around(20.0), "off target", ((0.0, 20.0), (3.0, -20.0)), peak=40.0,
                                       lasts=False),
    "sine target, followed": MadeUp(6.0, SINE, "follows", SINE, lag=0.0, gain=1.0),
    "sine target, with lag": MadeUp(6.0, around(20.0, sine(4.0, 2.0, 0.5)), "off target", SINE,
                                    lag=0.5 / math.pi, gain=0.8),
    "sine target, for eight periods": MadeUp(16.0, around(20.0, sine(4.0, 2.0, 0.1)), "off target", SINE,
                                             lag=0.1 / math.pi, gain=0.8),
    "sine target, from afar": MadeUp(8.0, around(20.0, sine(5.0, 2.0), decay(40.0, 0.3)), "follows", SINE),
    "sine target, after an approach": MadeUp(1.5, around(20.0, sine(5.0, 2.0), decay(40.0, 0.4)), "too short", SINE),
    "sine target, and hunting": MadeUp(8.0, around(20.0, sine(5.0, 2.0), sine(1.5, 0.6)), "off target", SINE),
    "sine target, growing": MadeUp(8.0, lambda t: SINE(t) + 0.03 * np.exp(0.7 * t) * np.sin(2.0 * math.pi * t / 0.9),
                                   "growing", SINE, lasts=False),
    "sine target, drifting away": MadeUp(8.0, lambda t: SINE(t) + 2.0 * t, "growing", SINE),
    "sine target, out of reach": MadeUp(8.0, lambda t: np.maximum(SINE(t), 24.0) + 3.0, "saturated", SINE,
                                        pressure=around(6e5), limits=(0.0, 6e5)),
    "sine target, followed at a limit": MadeUp(6.0, SINE, "follows", SINE, pressure=around(0.0), limits=(0.0, 6e5)),
    "sine target at 10 Hz": MadeUp(8.0, SINE, "follows", tuple(
        (t, float(SINE(t))) for t in np.arange(0.0, 24.0, 0.1).tolist())),
    "triangular target, with lag": MadeUp(8.0, lambda t: TRIANGLE(t - 0.1), "off target", TRIANGLE, lag=0.1, gain=1.0),
    "triangular target, with lag and noise": MadeUp(
        10.0, around(0.0, lambda t: TRIANGLE(t - 0.13), noise(0.08, 6)), "off target", TRIANGLE, lag=0.13, gain=1.0),
    "ramp, with lag": MadeUp(6.0, lambda t: 20.0 + 2.0 * t - 0.6 * (1.0 - np.exp(-t / 0.3)), "off target",
                             around(20.0, lambda t: 2.0 * t), lag=0.3, gain=1.0),
    "ramp, followed": MadeUp(3.4, RAMP, "follows", RAMP, lasts=False),
    "ramp that ends": MadeUp(8.0, RAMP, "settled", RAMP, settles=0.0, lasts=False),
    "limited step of 250 ms": MadeUp(6.0, lambda t: 20.0 + 30.0 * (t > 3.1) * (1.0 - np.exp(-(t - 3.1) / 0.3)),
                                     "settled", limited(20.0, 50.0, 3.0, 0.25), settles=0.1 + 0.3 * math.log(50.0),
                                     overshoot=0.0, lasts=False),
    "stair": MadeUp(9.0, lambda t: 20.0 + 5.0 * np.floor(t / 1.5) - 5.0 * np.exp(-(t % 1.5) / 0.1) * (t >= 1.5),
                    "settled", tuple((1.5 * k, 20.0 + 5.0 * k) for k in range(6)), settles=0.1 * math.log(50.0),
                    lasts=False),
    "late target": MadeUp(6.0, around(20.0, decay(30.0, 0.3, 2.0)), "settled", ((2.0, 20.0),),
                          settles=0.3 * math.log(50.0), lasts=False),
    "saturated above": MadeUp(6.0, around(60.0), "saturated", pressure=lambda t: np.where(t < 0.001, 1e5, 6e5),
                              peak=40.0, limits=(0.0, 6e5)),
    "saturated below": MadeUp(6.0, around(5.0), "saturated", pressure=lambda t: np.where(t < 0.001, 1e5, 0.0),
                              peak=-15.0, ripple=lambda t, w: np.sin(w * t)),
    "saturated between": MadeUp(6.0, around(35.0, decay(10.0, 1.0)), "saturated", limits=(0.0, 2.5e5), lasts=False,
                                pressure=lambda t: np.where(t < 1.0, 1e5 + flare(3e5, 0.5, 0.2)(t), 2.5e5)),
    "saturated and running away": MadeUp(6.0, lambda t: 20.0 + 20.0 * t, "saturated", limits=(0.0, 6e5),
                                         pressure=lambda t: np.where(t < 0.1, 1e5, 6e5)),
    "saturated at first": MadeUp(6.0, around(20.0, decay(40.0, 0.1, 2.0)), "settled", limits=(0.0, 6e5), lasts=False,
                                 pressure=lambda t: np.where(t < 2.0, 6e5, 92e3 + 3e3 * np.sin(150.0 * t)),
                                 settles=2.0 + 0.1 * math.log(50.0)),
    "at an unstated limit": MadeUp(6.0, around(60.0), "off target", pressure=around(6e5)),
    "beside its limits": MadeUp(6.0, around(25.0), "off target", pressure=around(9e4, sine(20.0, 0.7)),
                                limits=(0.0, 6e5)),
    "at the wrong limit": MadeUp(6.0, around(60.0), "off target", pressure=around(0.0), limits=(0.0, 6e5)),
    "at the wrong limit and away": MadeUp(6.0, lambda t: 30.0 + 20.0 * t, "off target", pressure=around(0.0)),
    "bang-bang": MadeUp(8.0, around(20.0, triangle(3.0, 1.0)), "hunting", limits=(5e4, 3e5), amplitude=3.0, period=1.0,
                        pressure=lambda t: np.where(np.sin(2.0 * math.pi * t) > 0.0, 3e5, 5e4)),
    "a 10 Hz command": MadeUp(6.0, around(20.0, decay(30.0, 0.3)), "settled", settles=0.3 * math.log(50.0),
                              pressure=lambda t: 92e3 + 4e5 * np.exp(-np.floor(10.0 * t) / 3.0)),
    "stick hidden in the mean": MadeUp(5.0, STUCK[0], "sticking", ripple=STUCK[1]),
    "locked instead of 20": MadeUp(5.0, lambda t: np.where(t < 0.5, 50.0 * (1.0 - t / 0.5), 0.0), "sticking",
                                   ripple=no_ripple),
    "judder of 30 Hz": MadeUp(8.0, around(20.0), "settled", ripple=judders(10.0, 30.0), judder=(10.0, 30.0)),
    "judder of 12 Hz": MadeUp(8.0, around(20.0, decay(30.0, 0.2)), "settled", ripple=judders(2.0, 12.0),
                              judder=(2.0, 12.0)),
    "judder of 210 Hz": MadeUp(8.0, around(20.0), "settled", ripple=judders(5.0, 210.0), judder=(5.0, 210.0)),
    "judder near a quarter of the sampling rate": MadeUp(7.0, around(20.0), "settled", ripple=judders(8.3, 221.0),
                                                         judder=(8.3, 221.0)),
    "judder and hunting": MadeUp(9.0, around(20.0, sine(2.0, 1.3)), "hunting", ripple=judders(4.0, 17.0),
                                 judder=(4.0, 17.0), amplitude=2.0, period=1.3),
    "judder below a third of the excitation, and hunting": MadeUp(
        8.0, around(20.0, sine(4.5, 0.37)), "hunting", ripple=judders(3.4, 14.4), judder=(3.4, 14.4), amplitude=4.5,
        period=0.37),
    "growing judder": MadeUp(8.0, around(20.0), "growing", ripple=judders(0.5, 31.0, 0.5), lasts=False),
    "growing ripple": MadeUp(8.0, around(20.0), "growing", ripple=lambda t, w: np.exp(0.3 * t) * np.sin(w * t),
                             lasts=False),
    "three periods of excitation": MadeUp(0.15, around(20.0, decay(30.0, 0.1)), "too short"),
    "half of an approach": MadeUp(0.4, around(20.0, decay(30.0, 0.3)), "too short"),
    "slow approach": MadeUp(5.0, around(20.0, decay(30.0, 1.5)), "too short"),
}


def loop(made: MadeUp, part: float = 1.0, sign: float = 1.0, frequency: float = FREQUENCY, lost: float = 0.0,
         quantum: float = 0.0, added: float = 0.0) -> Loop:
    """Return a part of a made-up loop at 1 kHz, mirrored, at another frequency, with lost samples, quantised, noisy."""
    rng = np.random.default_rng(5)
    t = np.arange(round(made.seconds * part * 1000) + 1) / 1000.0
    v = sign * (np.asarray(made.mean(t)) + made.ripple(t, frequency)) + added * rng.standard_normal(len(t))
    v = np.round(v / quantum) * quantum if quantum else v
    pressure = None if made.pressure is None else made.pressure(t) + 0.0 * t
    kept = np.append(True, rng.random(len(t) - 1) >= lost)
    zero = 0.0 * t
    run = Trajectory(t=t, slip_speed=v, plate_angle=zero, plate_speed=zero, engine_torque=200.0 + zero,
                     saturation_torque=300.0 + zero, friction_torque=200.0 * np.sign(v),
                     state=np.sign(np.where(np.abs(v) < 0.05, 0.0, v)).astype(np.int8), system=CONTROLLED,
                     cycle=CYCLE, solver="none")
    run = replace(run, **{name: getattr(run, name)[kept] for name in (
        "t", "slip_speed", "plate_angle", "plate_speed", "engine_torque", "saturation_torque", "friction_torque",
        "state")})
    given = made.targets if isinstance(made.targets, tuple) else [
        (x, float(made.targets(x))) for x in np.arange(0.0, made.seconds * max(part, 1.0), 0.01).tolist()]
    times, values = np.array(given, dtype=np.float64).T
    return loop_of(run, Scheduled(2.0 * math.pi / frequency), Steps(times, sign * values),
                   None if pressure is None else pressure[kept], made.limits)


def last_segment(result: Loop, stepped: bool | None = True) -> Tracking:
    """Judge from the last jump of the target, or its first value, on."""
    end = float(result.course.ends[-1])
    jumps = result.jumps.t[result.jumps.t < end]
    return result.tracking(float(jumps[-1] if len(jumps) else result.reference.t[0]), end, stepped=stepped)


WAYS = {"as it is": {}, "mirrored, at another frequency": {"sign": -1.0, "frequency": 210.0},
        "1 % lost": {"lost": 0.01}, "quantised": {"quantum": 0.05}, "noisy": {"added": 0.3}}


@pytest.mark.parametrize(("name", "way"), [*((name, "as it is") for name in LOOPS), *zip(
    list(LOOPS)[::3], cycle(list(WAYS)[1:])), ("judder near a quarter of the sampling rate", "1 % lost")])
def test_a_loop_is_judged_by_its_truth(name, way):
    """Each as it is, and every third one in one other way, so that each way has seven loops."""
    made, how = LOOPS[name], WAYS[way]
    segment = last_segment(loop(made, **how))
    sign = how.get("sign", 1.0)
    assert segment.verdict == made.verdict, segment.verdict_why
    assert segment.verdict_why
    assert math.isfinite(segment.settling_time) == (made.verdict == "settled")
    for value, truth, within in (
            (segment.settling_time, made.settles(segment.band) if callable(made.settles) else made.settles,
             {"abs": 1.6 * CYCLE}),
            (segment.peak_deviation, sign * made.peak, {"rel": 0.07}), (segment.peak_time, made.at, {"abs": CYCLE}),
            (segment.overshoot, made.overshoot, {"rel": 0.07, "abs": 0.2 if way == "noisy" else 0.05}),
            (segment.hunting_amplitude, made.amplitude, {"rel": 0.2}),
            (segment.hunting_period, made.period, {"rel": 0.07}), (segment.lag, made.lag, {"abs": 0.02}),
            (segment.gain, made.gain, {"rel": 0.05})):
        assert math.isnan(truth) or value == pytest.approx(truth, **within), (value, truth)
    assert (segment.judder_amplitude, segment.judder_frequency) == pytest.approx(made.judder, rel=0.05, nan_ok=True) \
        or "growing judder" in name
    if made.pressure is not None:
        known = [limit for limit in made.limits or (0.0,) if np.isin(limit, made.pressure(np.arange(0.0, 6.0, 1e-3)))]
        assert (segment.time_at_limit > 0.2) == bool(known)


@pytest.mark.parametrize("samples", [8.25, 8.5, 9.25, 10.25])
def test_a_ripple_of_few_samples_is_no_judder(samples):
    made = MadeUp(5.0, around(20.0), "settled", ripple=lambda t, w: 15.0 * np.sin(w * t))
    segment = last_segment(loop(made, frequency=2000.0 * math.pi / samples))
    assert (segment.verdict, math.isnan(segment.judder_amplitude)) == ("settled", True)


def test_a_loop_of_which_a_fifth_was_lost_has_no_verdict():
    made = LOOPS["good"]
    segment = last_segment(loop(made, lost=0.2))
    assert segment.verdict == "too little observed"
    assert 0.0 < segment.seconds < 0.9 * made.seconds
    assert segment.lost_seconds > 0.0
    for field_ in ("peak_deviation", "overshoot", "settling_time", "peak_mean", "peak_slip", "largest_error"):
        assert math.isnan(getattr(segment, field_))


@pytest.mark.parametrize(("name", "parts"), [*zip(
    [name for name, made in LOOPS.items() if made.lasts][::2], cycle(((0.35, 0.8), (0.5,), (0.65,), (0.35, 0.9))))])
def test_a_run_that_ends_earlier_is_too_short_or_judged_as_the_whole_or_a_longer_one(name, parts):
    made = LOOPS[name]
    truth = made.verdict if made.verdict != "too short" else last_segment(loop(made, 3.0)).verdict
    for part in parts:
        segment = last_segment(loop(made, part))
        assert segment.verdict in (truth, "too short"), (part, segment.verdict_why)


def test_every_verdict_is_that_of_a_loop():
    assert {made.verdict for made in LOOPS.values()} | {"too little observed"} == {each.value for each in LoopVerdict}


def hand_made(means, reference, begin=1.0, before=(), squares=2.5, stick=0.0, **more):
    """A loop of cycles of 0.1 s: these means from `begin` on, others before, and extremes 3 below and 4 above."""
    mean = np.array([*before, *means], dtype=float)
    starts = begin + 0.1 * (np.arange(len(mean)) - len(before))
    course = LoopCycles(starts, starts + 0.1, mean, mean**2 + squares, mean + 4.0, mean - 3.0, stick + 0.0 * mean)
    times, values = np.array(reference, dtype=float).T
    return Loop(course, Steps(times, values), **more)


APPROACH = 22.0, 26.0, 29.0, 31.0, 33.0, 32.0, 30.5, 29.9, 30.05, 30.02, 29.98, 30.03
ROWS = np.arange(45)
PRESSED = Signal(0.05 * (ROWS + 1), np.where(ROWS < 25, 1e5, np.where(ROWS % 2, 3e5, 2e5)))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_every_figure_of_a_segment_is_that_of_its_cycles(sign):
    """A step from a mean of 20.5 to 30, of which the figures are worked out here one by one."""
    made = hand_made(sign * np.array(APPROACH), [(0.0, sign * 20.0), (1.0, sign * 30.0)],
                     before=(sign * 20.1, sign * 20.5), pressure=PRESSED, limits=(1e5, 3e5), note="; noted")
    made.course.stick_time[2:] = [0.01, math.nan, *[0.0] * 10]
    error = np.array(APPROACH) - 30.0
    segment = made.tracking(1.0, 2.2, stepped=True, discard=2, commands=(40, 3))
    pressure = PRESSED.values[20:44]
    rises = np.diff(pressure)
    expected = {
        "target": sign * 30.0, "mean_slip": sign * np.mean(APPROACH[2:]), "rms_error": math.sqrt(np.mean(error[2:]**2)),
        "largest_error": 3.0, "overshoot": 3.0, "overshoot_time": 1.45, "settling_time": 0.7, "verdict": "settled",
        "target_low": sign * 30.0, "target_high": sign * 30.0, "band": 0.19, "peak_deviation": sign * 3.0,
        "peak_time": 1.45, "peak_mean": 8.0, "peak_slip": 11.0 if sign > 0.0 else 12.0,
        "iae": 0.1 * np.abs(error).sum(), "ripple": math.sqrt(2.5), "stick_fraction": 0.01 / 1.1, "pressure_low": 1e5,
        "pressure_high": 3e5, "pressure_rate": math.sqrt(np.sum(rises**2) / 0.05 / 1.2), "limits": (1e5, 3e5),
        "time_at_limit": np.mean((pressure == 1e5) | (pressure == 3e5)), "command_rate": 40.0 / 1.2,
        "commands_applied": 40, "commands_superseded": 3, "seconds": 1.2, "lost_seconds": 0.0}
    for name, value in expected.items():
        assert getattr(segment, name) == (value if isinstance(value, str) else pytest.approx(
            value, rel=1e-9, abs=1e-12)), name
    assert segment.verdict_why.endswith("; noted")
    assert {key for key, value in json_of(segment).items() if value is None} == {
        "hunting_amplitude", "hunting_period", "judder_amplitude", "judder_frequency", "lag", "gain"}


@pytest.mark.parametrize(("cycles", "run", "stepped", "over", "peak"), [
    ((20.5,), math.nan, None, 3.0, 3.0), ((20.5,), math.nan, True, 3.0, 3.0), ((20.5,), math.nan, False, 8.0, -8.0),
    ((), 20.5, None, 3.0, 3.0), ((), 29.95, None, 8.0, -8.0), ((), math.nan, None, 3.0, 3.0),
    ((30.4,), math.nan, None, 8.0, -8.0), ((30.4,), math.nan, True, 8.0, -8.0), ((28.1,), math.nan, None, 8.0, -8.0),
    ((27.9,), math.nan, None, 3.0, -8.0), ((28.1,), math.nan, True, 3.0, -8.0), ((20.5,), 30.4, None, 3.0, 3.0)])
def test_a_step_counts_from_the_last_mean_before_it(cycles, run, stepped, over, peak):
    """Of the cycles, else of the run; else from a start at 20. An uncertain one counts from a quarter of 8 rad/s on."""
    segment = replace(hand_made(APPROACH, [(0.0, 30.0)], before=cycles), before=run).tracking(1.0, 2.2, stepped=stepped)
    assert (segment.overshoot, segment.peak_deviation) == (pytest.approx(over), pytest.approx(peak))


def test_the_approach_to_a_target_is_no_peak():
    for late in (30.3, 29.7):
        means = [22.0, 26.0, 29.0, 29.9, late, *[30.0] * 7]
        segment = hand_made(means, [(0.0, 30.0)], before=(20.5,)).tracking(1.0, 2.2)
        assert (segment.peak_deviation, segment.peak_time) == (pytest.approx(late - 30.0), pytest.approx(1.45))


@pytest.mark.parametrize("stuck_time", [0.00199, 0.00201])
def test_a_fiftieth_of_the_time_in_stick_is_sticking(stuck_time):
    verdict = hand_made([5.0] * 12, [(0.0, 30.0)], stick=stuck_time).tracking(1.0, 2.2).verdict
    assert verdict == ("sticking" if stuck_time > 0.002 else "off target")


@pytest.mark.parametrize(("level", "count", "limits", "verdict"), [
    (4e5, 24, (0.0, 4e5), "off target"), (4e5, 25, (0.0, 4e5), "saturated"), (3.9e5, 120, (0.0, 4e5), "off target"),
    (0.0, 120, None, "off target"), (4e5 - 3.9, 120, (0.0, 4e5), "saturated"),
    (4e5 - 4.1, 120, (0.0, 4e5), "off target")])
def test_half_of_the_last_third_at_the_limit_on_the_side_of_the_error_is_saturated(level, count, limits, verdict):
    """5 rad/s above the target for 12 cycles; the last 0.5 s are 50 samples. A level counts within 1e-5."""
    t = np.arange(1.005, 2.2, 0.01)
    pressure = np.where(np.arange(len(t)) >= len(t) - count, level, 2e5 + 1e3 * (np.arange(len(t)) % 2))
    segment = hand_made([35.1234] * 12, [(0.0, 30.0)], pressure=Signal(t, pressure), limits=limits)
    assert segment.tracking(1.0, 2.2).verdict == verdict


@pytest.mark.parametrize("name", ["slow limit cycle", "two periods that end at 0", "small, slow, at a zero"])
def test_a_band_of_ones_own_counts(name):
    segment = last_segment(replace(loop(LOOPS[name]), floor=1.2))
    assert (segment.verdict, segment.band) == ("settled", 1.2)


def test_without_a_cycle_there_is_no_verdict_but_a_reason():
    empty = Loop(LoopCycles(*(np.empty(0),) * 7), Steps(np.array([0.0]), np.array([20.0])), why="no cycle was found")
    tracking = empty.tracking(0.0, 1.0)
    assert (tracking.verdict, tracking.verdict_why) == (None, "no cycle was found")
    assert {key for key, value in json_of(tracking).items() if value is not None} == {
        "target", "verdict_why", "limits", "seconds", "lost_seconds"}
    assert loop(LOOPS["good"]).tracking(1.01, 1.02).verdict == "too short"


@pytest.mark.parametrize(("times", "values", "jumps"), [
    ([0.0, 1.0, 2.0, 2.05], [20.0, 20.5, 20.55, 25.0], [(1.0, 20.5), (2.05, 25.0)]), ([0.0], [20.0], []), ([], [], []),
    ([0.0, 1.0, 2.0], [20.0, 20.0, 18.0], [(2.0, 18.0)]), ([0.0, 1.0], [20.0, 20.125], []),
    ([0.0, 1.0], [20.0, 20.126], [(1.0, 20.126)]),
    ([0.0, 1.0, 1.25, 1.5], [20.0, 21.0, 25.0, 26.0], [(1.25, 25.0)]),   # Four times its neighbours, and less.
    ([0.0, 1.0, 1.25], [20.0, 21.125, 25.0], [(1.0, 25.0)]), ([0.0, 1.0, 1.25], [20.0, 24.0, 23.0], [(1.0, 24.0)]),
    ([0.0, 1.0, 1.25], [20.0, 24.0, 22.9], []), ([0.0, 1.0, 1.26], [20.0, 21.125, 25.0], [(1.0, 21.125), (1.26, 25.0)]),
    ([0.0, 1.0, 1.25, 1.5], [20.0, 21.0, 23.0, 24.0], [(1.0, 24.0)]),
    ([0.0, 1.0, 1.25, 1.5, 1.51], [20.0, 21.0, 23.0, 24.0, 25.0], [])])
def test_a_jump_is_larger_than_the_least_and_than_its_neighbours(times, values, jumps):
    """Changes in one direction are one jump for half a second at most."""
    for sign in (1.0, -1.0):
        result = target_jumps(Steps(np.array(times), sign * np.array(values)), 0.125, 0.25)
        assert list(zip(result.t.tolist(), (sign * result.values).tolist())) == jumps


def test_the_target_of_a_cycle_in_which_it_jumps_is_its_mean():
    made = hand_made([20.0] * 12, [(0.0, 20.0), (1.05, 24.0), (1.5, 20.0), (1.975, 40.0)])
    away = [made.tracking(1.0 + 0.1 * k, 1.1 + 0.1 * k).largest_error for k in (0, 1, 4, 5, 9)]
    assert away == pytest.approx([2.0, 4.0, 4.0, 0.0, 5.0])


def test_a_run_of_closed_loop_is_judged_with_what_lies_between_its_samples():
    """Pure sliding under a pressure of two values: v rises with the torque's sine and has known figures."""
    run = tcc_sim.closed_loop(tcc_sim.load_scene("controlled").with_values({
        "initial.slip_speed": 400.0, "pressure.amplitude": 0.0, "friction.kinetic_coefficient": 0.3,
        "friction.static_coefficient": 0.3}), lambda reading: 150e3 if reading.slip_speed > 300.0 else 1e5, 0.4)
    tracking = run.tracking_of(390.0, limits=(1e5, 150e3))
    dense = np.linspace(0.0, 0.4, 400_001)
    v = CubicSpline(run.t, run.slip_speed)(dense)
    cycle = run.cycle
    count = int(0.4 / cycle)
    means = np.array([v[(dense >= k * cycle) & (dense < (k + 1) * cycle)].mean() for k in range(count)])
    inside = dense < count * cycle
    number = np.minimum((dense / cycle).astype(int), count - 1)
    assert tracking.peak_slip == pytest.approx(np.abs(v - 390.0)[inside].max(), rel=1e-6)
    assert tracking.peak_mean == pytest.approx(np.abs(means - 390.0).max(), rel=1e-4)
    assert tracking.ripple == pytest.approx(np.sqrt(np.mean((v - means[number])[inside] ** 2)), rel=2e-2)
    assert tracking.iae == pytest.approx(np.abs(means - 390.0).sum() * cycle, rel=1e-4)
    assert (tracking.pressure_low, tracking.pressure_high) == (run.applied_pressure[1:].min(),
                                                               run.applied_pressure.max())
    assert (tracking.stick_fraction, tracking.time_at_limit, tracking.limits) == (0.0, 1.0, (1e5, 150e3))
    steps = np.count_nonzero(np.diff(run.applied_pressure[1:]))
    assert tracking.pressure_rate == pytest.approx(5e7 * math.sqrt(steps * 1e-3 / 0.4))
    assert (tracking.commands_applied, tracking.commands_superseded, tracking.command_rate) == (400, 0, 1000.0)


@pytest.mark.parametrize(("silent", "since"), [((1.0, 1.6), 1.6), ((1.0, 1.03), 0.0), ((2.4, 9.0), 2.4)])
def test_a_run_of_the_kit_is_judged_since_its_last_handover(silent, since):
    """Of a fallback that lasts for a cycle: before it, another controller was at work."""
    law = SlipController(Tuning())
    begin, end = silent
    run = tcc_sim.closed_loop("controlled", lambda r: None if begin <= r.stamp_ns * 1e-9 < end else law.update(
        r.slip_speed, r.engine_torque), 3.0)
    kit = LockstepRun(**{name: getattr(run, name) for name in run.__dataclass_fields__}, targets=((20.0, 0),))
    assert kit.tracking.seconds == pytest.approx(3.0 - since, abs=2.0 * CYCLE)


@pytest.mark.parametrize(("torque", "limit", "verdict"), [(230.0, 6e5, "settled"), (400.0, 1.5e5, "saturated")])
def test_a_load_step_of_closed_loop_shows_its_peak(torque, limit, verdict):
    """The peak is that of the means over each cycle, worked out here from the samples alone."""
    law = SlipController(Tuning(pressure_limit=limit))
    run = tcc_sim.closed_loop("controlled", lambda r: law.update(r.slip_speed, r.engine_torque), 3.0,
                              at={1.5: {"engine.mean_torque": torque}})
    tracking = run.tracking_of(20.0, since=1500, limits=(0.0, limit))
    edges = np.arange(math.ceil(1.5 / CYCLE) - 1, int(3.0 / CYCLE) + 1) * CYCLE
    area = np.interp(edges, run.t, np.append(0.0, np.cumsum(0.5 * (run.slip_speed[1:] + run.slip_speed[:-1]) * 1e-3)))
    means = np.diff(area) / CYCLE - 20.0
    assert tracking.peak_deviation == pytest.approx(means.max(), rel=1e-2)
    assert tracking.overshoot == pytest.approx(tracking.peak_deviation)
    assert tracking.verdict == verdict
    assert (tracking.time_at_limit > 0.9) == (verdict == "saturated")


@pytest.mark.parametrize(("target", "named"), [({}, "target"), (1.001e5, "-100000 to 100000"), (math.nan, "nan"),
                                               (-1.001e5, "-100100"), ({math.nan: 20.0}, "time")])
def test_a_target_that_is_none_is_refused(target, named):
    with pytest.raises(InputError) as refusal:
        target_steps(target)
    assert named in str(refusal.value)


@pytest.mark.parametrize("limits", [(-1.0, 1e5), (2e5, 1e5), (1e5, 1e5), (math.nan, 1e5), (0.0, math.nan)])
def test_limits_that_are_none_are_refused(limits):
    with pytest.raises(InputError) as refusal:
        checked_limits(limits)
    assert all(f"{limit:g}" in str(refusal.value) for limit in limits)


def test_targets_are_steps_in_order_of_time():
    steps = target_steps({3.0: 1e5, 0.5: -1e5, 2.0: 7})
    assert (steps.t.tolist(), steps.values.tolist()) == ([0.5, 2.0, 3.0], [-1e5, 7.0, 1e5])
    assert (target_steps(30).t.tolist(), target_steps(30).values.tolist()) == ([0.0], [30.0])


@pytest.mark.parametrize(("figures", "bounds", "missed"), [
    ({}, {}, []), ({}, {"settling": 0.5, "overshoot": 1.0, "peak": 3.0}, []),
    ({}, {"settling": 0.3999}, ["settling time 0.4", "0.3999 s"]),
    ({}, {"settling": 0.4, "overshoot": 0.7, "peak": 1.9}, ["overshoot 0.8", "0.7 rad/s", "peak deviation 2", "1.9"]),
    ({"verdict": "hunting", "verdict_why": "it swings"}, {"settling": 9.0},
     ["settling time not known", "hunting", "it swings"]),
    ({"overshoot": math.nan}, {"overshoot": 9.0}, ["overshoot not known", "9 rad/s"])])
def test_a_specification_is_met_or_its_misses_are_named(figures: dict[str, object], bounds: dict[str, float],
                                                        missed: list[str]) -> None:
    tracking = Tracking(20.0, **{"verdict": "settled", "settling_time": 0.4, "overshoot": 0.8,  # type: ignore[arg-type]
                                 "peak_deviation": -2.0, **figures})
    if not missed:
        assert tracking.within(**bounds)
        return
    with pytest.raises(AssertionError) as miss:
        tracking.within(**bounds)
    assert [part for part in missed if part not in str(miss.value)] == []
