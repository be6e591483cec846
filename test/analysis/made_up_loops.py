"""Controlled runs whose verdict, peak and settling are known by construction, without ROS and without a recording."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from tcc_sim.analysis.control import Steps
from tcc_sim.analysis.engine_clock import Uniform
from tcc_sim.analysis.stream import CycleStream
from tcc_sim.analysis.tracking import Loop, LoopReader, Pressures
from tcc_sim.scene import load_scene

CONTROLLED = load_scene("controlled").system
RIPPLE = 8.3
"""Swing of the slip speed within a period of excitation, rad/s."""


@dataclass(frozen=True)
class MadeUp:
    """A loop: mean slip speed as f(t), rad/s, targets (time, value), pressure as f(t), and the truth about its last
    segment.

    verdict : and amplitude, period of an oscillation, at the end
    peak, at : peak of the deviation after the target was reached first, and its time
    settles : time from the start of the segment
    limits : that the pressure was held at
    """

    seconds: float
    mean: object
    verdict: str
    targets: tuple = ((0.0, 20.0),)
    pressure: object = None
    peak: float = math.nan
    at: float = math.nan
    settles: float = math.nan
    amplitude: float = math.nan
    period: float = math.nan
    overshoot: float = math.nan
    limits: tuple = ()
    ripple: object = field(default=lambda t, w: RIPPLE * np.sin(w * t + 2.0))


def decay(size, tau, start=0.0):
    """Exponential from `start` on; before it, the size."""
    return lambda t: size * np.exp(-np.maximum(t - start, 0.0) / tau)


def flare(size, at, width):
    return lambda t: size * np.exp(-(((t - at) / width) ** 2))


def sine(size, period, lag=0.0):
    return lambda t: size * np.sin(2.0 * math.pi * t / period - lag)


def around(value, *parts):
    return lambda t: value + sum(part(t) for part in parts) + 0.0 * t


def second_order(size, zeta, omega):
    """Step response from `size` to 0, which passes 0 by size exp(-pi zeta/sqrt(1 - zeta^2))."""
    damped = omega * math.sqrt(1.0 - zeta**2)
    return lambda t: size * np.exp(-zeta * omega * t) * (np.cos(damped * t) + zeta / math.sqrt(1.0 - zeta**2)
                                                         * np.sin(damped * t))


def published(f, seconds, every):
    """Targets of a function of time, published at a period, s."""
    return tuple((t, float(f(t))) for t in np.arange(0.0, seconds, every).tolist())


def noise(size, seed):
    """Noise of the cycle mean, independent from one 40 ms to the next."""
    values = np.random.default_rng(seed).normal(0.0, size, 400)
    return lambda t: np.interp(t, 0.04 * np.arange(400), values)


def stuck(level, swing):
    """Slip that stays at 0 within each period although its mean is `level`."""
    phase = np.linspace(0.0, 2.0 * math.pi, 40_001)[:-1]
    scale = level / np.maximum(level + swing * np.sin(phase), 0.0).mean()
    return (lambda t: 0.0 * t), (lambda t, w: scale * np.maximum(level + swing * np.sin(w * t), 0.0))


def no_ripple(t, w):
    return 0.0 * t


SINE = around(20.0, sine(5.0, 2.0))
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
    "two flares": MadeUp(9.0, around(20.0, flare(5.0, 2.0, 0.1), flare(5.0, 5.0, 0.1)), "settled", peak=5.0),
    "periodic flares": MadeUp(9.0, around(20.0, *(flare(5.0, k, 0.1) for k in range(1, 9))), "hunting", period=1.0),
    "load step": MadeUp(4.0, lambda t: 20.0 + 15.7 * t / 0.15 * np.exp(1.0 - t / 0.15), "settled", peak=15.7, at=0.15,
                        settles=0.15 * 6.84, overshoot=15.7),
    "late spike": MadeUp(5.0, around(20.0, flare(15.0, 4.92, 0.09)), "too short", peak=15.0, at=4.92),
    "late load": MadeUp(6.0, lambda t: 20.0 + 3.0 * (t > 5.9) * (1.0 - np.exp(-(t - 5.9) / 0.05)), "too short"),
    "slow limit cycle": MadeUp(7.8, around(20.0, sine(1.0, 2.6, 0.25)), "hunting", amplitude=1.0, period=2.6),
    "two periods that end at 0": MadeUp(8.25, around(20.0, sine(0.8, 4.0, 0.15)), "hunting", amplitude=0.8, period=4.0),
    "one period": MadeUp(4.6, around(20.0, sine(0.8, 4.0, 0.15)), "too short"),
    "small, slow, at a zero": MadeUp(12.05, around(20.0, sine(0.5, 8.0)), "too short"),
    "hunting within 2 % of the step": MadeUp(8.0, around(10.0, decay(300.0, 0.1), sine(5.5, 1.0 / 0.7)), "hunting",
                                             ((0.0, 10.0),), amplitude=5.5, period=1.0 / 0.7),
    "fast hunting": MadeUp(5.0, around(20.0, sine(3.0, 0.125)), "hunting", amplitude=3.0, period=0.125),
    "hunting about an offset": MadeUp(10.0, around(25.0, decay(30.0, 0.2), sine(2.0, 1.7)), "hunting", amplitude=2.0,
                                      period=1.7),
    "triangular": MadeUp(9.0, lambda t: 20.0 + 4.0 / math.pi * np.arcsin(np.sin(2.0 * math.pi * t / 1.3)), "hunting",
                         amplitude=2.0, period=1.3),
    "sawtooth": MadeUp(9.0, lambda t: 18.0 + 4.0 * (t / 1.3 % 1.0), "hunting", amplitude=2.0, period=1.3),
    "noisy hunting": MadeUp(10.0, around(20.0, sine(2.0, 2.0), noise(0.3, 1)), "hunting", amplitude=2.0, period=2.0),
    "a limit cycle that builds up": MadeUp(12.0, lambda t: 20.0 + 4.0 * np.tanh(0.02 * np.exp(1.5 * t))
                                           * np.sin(2.0 * math.pi * t / 0.8), "hunting", amplitude=4.0, period=0.8),
    "hunting from the middle on": MadeUp(12.0, lambda t: 20.0 + 2.0 * (t > 6.5) * np.sin(2.0 * math.pi * t / 1.3),
                                         "hunting", amplitude=2.0, period=1.3),
    "hunting that ends": MadeUp(12.0, lambda t: 20.0 + 2.0 * (t < 6.5) * np.sin(2.0 * math.pi * t / 1.3), "settled",
                                settles=6.5),
    "hunting with lock": MadeUp(10.0, lambda t: np.maximum(20.0 + 35.0 * np.sin(2.0 * math.pi * t / 1.5), 0.0),
                                "hunting", period=1.5, ripple=no_ripple),
    "noise": MadeUp(8.0, around(20.0, decay(30.0, 0.2), noise(0.15, 3)), "settled"),
    "growing": MadeUp(8.0, lambda t: 20.0 + 0.02 * np.exp(0.8 * t) * np.sin(2.0 * math.pi * t / 0.9), "growing",
                      period=0.9),
    "growing slowly": MadeUp(9.0, lambda t: 20.0 + 1.5 * np.exp(0.1 * t) * np.sin(2.0 * math.pi * t / 0.9), "growing"),
    "growing without oscillation": MadeUp(8.0, lambda t: 20.0 + 0.01 * np.exp(t), "growing"),
    "drifting": MadeUp(8.0, lambda t: 20.0 + 2.0 * np.maximum(t - 1.0, 0.0), "growing"),
    "decaying too slowly": MadeUp(6.0, lambda t: 20.0 + 3.0 * np.exp(-0.15 * t) * np.sin(2.0 * math.pi * t / 0.8),
                                  "too short"),
    "small step, slow": MadeUp(6.0, lambda t: 20.8 - 0.8 * np.exp(-np.maximum(t - 3.0, 0.0) / 5.0), "too short",
                               ((0.0, 20.0), (3.0, 20.8)), peak=-0.8, at=3.03),
    "small step, ignored": MadeUp(8.0, around(100.0), "off target", ((0.0, 100.0), (3.0, 102.0)), peak=-2.0),
    "small step, followed": MadeUp(8.0, lambda t: 100.0 + 2.0 * (t > 3.0) * (1.0 - np.exp(-(t - 3.0) / 0.2)),
                                   "settled", ((0.0, 100.0), (3.0, 102.0)), settles=0.2 * math.log(20.0)),
    "offset": MadeUp(6.0, around(23.0, decay(20.0, 0.3)), "off target"),
    "slip for a target of 0": MadeUp(6.0, around(3.0), "off target", ((0.0, 0.0),), peak=3.0,
                                     ripple=lambda t, w: 0.5 * np.sin(w * t)),
    "lock for a target of 0": MadeUp(5.0, lambda t: np.where(t < 0.5, 50.0 * (1.0 - t / 0.5), 0.0), "settled",
                                     ((0.0, 0.0),), settles=0.49, ripple=no_ripple),
    "lock from lock": MadeUp(5.0, around(0.0), "settled", ((0.0, 0.0),), settles=0.0,
                             ripple=lambda t, w: 1e-4 * np.sin(w * t)),
    "negative slip": MadeUp(5.0, around(-20.0, decay(-30.0, 0.1)), "settled", ((0.0, -20.0),),
                            settles=0.1 * math.log(50.0), overshoot=0.0),
    "negative slip, hunting": MadeUp(9.0, around(-20.0, sine(2.0, 1.3)), "hunting", ((0.0, -20.0),), amplitude=2.0,
                                     period=1.3),
    "target reversed, ignored": MadeUp(6.0, around(20.0), "off target", ((0.0, 20.0), (3.0, -20.0)), peak=40.0),
    "sine target, followed": MadeUp(6.0, SINE, "settled", published(SINE, 6.0, 0.02), settles=0.0),
    "sine target, with lag": MadeUp(6.0, around(20.0, sine(4.0, 2.0, 0.5)), "off target", published(SINE, 6.0, 0.02)),
    "sine target, and hunting": MadeUp(8.0, around(20.0, sine(5.0, 2.0), sine(1.5, 0.6)), "hunting",
                                       published(SINE, 8.0, 0.02), amplitude=1.5, period=0.6),
    "sine target at 10 Hz": MadeUp(8.0, SINE, "settled", published(SINE, 8.0, 0.1)),
    "ramp, followed": MadeUp(6.0, RAMP, "settled", published(RAMP, 6.0, 0.01), settles=0.0),
    "ramp, with lag": MadeUp(6.0, lambda t: 20.0 + 2.0 * t - 0.6 * (1.0 - np.exp(-t / 0.3)), "off target",
                             published(lambda t: 20.0 + 2.0 * t, 6.0, 0.01), peak=-0.6),
    "stair": MadeUp(9.0, lambda t: 20.0 + 5.0 * np.floor(t / 1.5) - 5.0 * np.exp(-(t % 1.5) / 0.1) * (t >= 1.5),
                    "settled", tuple((1.5 * k, 20.0 + 5.0 * k) for k in range(6)), settles=0.1 * math.log(50.0)),
    "late target": MadeUp(6.0, around(20.0, decay(30.0, 0.3, 2.0)), "settled", ((2.0, 20.0),),
                          settles=0.3 * math.log(50.0)),
    "saturated above": MadeUp(6.0, around(60.0), "saturated", pressure=lambda t: np.where(t < 0.001, 1e5, 6e5),
                              peak=40.0, limits=(0.0, 6e5)),
    "saturated below": MadeUp(6.0, around(5.0), "saturated", pressure=lambda t: np.where(t < 0.001, 1e5, 0.0),
                              peak=-15.0, limits=(0.0, math.nan), ripple=lambda t, w: np.sin(w * t)),
    "saturated between": MadeUp(6.0, around(35.0, decay(10.0, 1.0)), "saturated", limits=(0.0, 2.5e5),
                                pressure=lambda t: np.where(t < 1.0, 1e5 + flare(3e5, 0.5, 0.2)(t), 2.5e5)),
    "saturated and running away": MadeUp(6.0, lambda t: 20.0 + 20.0 * t, "saturated", limits=(0.0, 6e5),
                                         pressure=lambda t: np.where(t < 0.1, 1e5, 6e5)),
    "saturated at first": MadeUp(6.0, around(20.0, decay(40.0, 0.1, 2.0)), "settled", limits=(0.0, 6e5),
                                 pressure=lambda t: np.where(t < 2.0, 6e5, 92e3 + 3e3 * np.sin(150.0 * t)),
                                 settles=2.0 + 0.1 * math.log(50.0)),
    "bang-bang": MadeUp(8.0, lambda t: 20.0 + 6.0 / math.pi * np.arcsin(np.sin(2.0 * math.pi * t)), "hunting",
                        pressure=lambda t: np.where(np.sin(2.0 * math.pi * t) > 0.0, 3e5, 5e4), amplitude=3.0,
                        period=1.0),
    "a 10 Hz command": MadeUp(6.0, around(20.0, decay(30.0, 0.3)), "settled", settles=0.3 * math.log(50.0),
                              pressure=lambda t: 92e3 + 4e5 * np.exp(-np.floor(10.0 * t) / 3.0),
                              limits=(0.0, math.nan)),
    "stick hidden in the mean": MadeUp(5.0, STUCK[0], "sticking", ripple=STUCK[1]),
    "locked instead of 20": MadeUp(5.0, lambda t: np.where(t < 0.5, 50.0 * (1.0 - t / 0.5), 0.0), "sticking",
                                   ripple=no_ripple),
    "three periods of excitation": MadeUp(0.15, around(20.0, decay(30.0, 0.1)), "too short"),
    "half of an approach": MadeUp(0.4, around(20.0, decay(30.0, 0.3)), "too short"),
    "slow approach": MadeUp(5.0, around(20.0, decay(30.0, 1.5)), "too short"),
}


def loop(made: MadeUp, sign: float = 1.0, frequency: float = 150.0, lost: int = 0) -> Loop:
    """Return a made-up loop at 1 kHz, mirrored where `sign` is -1, with one of every `lost` ticks lost."""
    t = np.arange(round(made.seconds * 1000) + 1) / 1000.0
    v = sign * (np.asarray(made.mean(t)) + made.ripple(t, frequency))
    pressure = None if made.pressure is None else made.pressure(t) + 0.0 * t
    if lost:
        kept = np.random.default_rng(5).random(len(t)) > 1.0 / lost
        kept[0] = True
        t, v, pressure = t[kept], v[kept], None if pressure is None else pressure[kept]
    clock, zero = Uniform(2.0 * math.pi / frequency), 0.0 * t
    reader, stream = LoopReader(clock), CycleStream(CONTROLLED, clock)
    reader.extremes(stream.feed(np.rint(t * 1e9).astype(np.int64), v, zero, zero, 200.0 + zero, 200.0 * np.sign(v)))
    for part in np.split(np.arange(len(t)), 1 + np.flatnonzero(np.diff(t) > 2.5e-3)):
        reader.interrupt()
        reader.feed(t[part], v[part])
    times, values = np.array(made.targets, dtype=np.float64).T
    return Loop(reader.course(), Steps(times, sign * values), None if pressure is None else Pressures(t, pressure))
