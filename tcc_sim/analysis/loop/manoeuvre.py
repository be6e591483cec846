"""Figures of a manoeuvre as a whole: judder, and amplitudes of orders at given speeds of the engine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tcc_sim.analysis.measured.orders import WINDOW, Orders, orders_of, slip_about_cycle_mean
from tcc_sim.analysis.measured.signals import run_signals
from tcc_sim.errors import InputError
from tcc_sim.result import reported
from tcc_sim.trajectory import Floats, Trajectory

SPEEDS = 5
"""Default number of speeds within the range of a run."""
SAME = 1e-6
"""Relative range of a frequency that is constant."""


@dataclass(frozen=True)
class JudderFigures:
    """Judder over all whole periods of excitation that are kept."""

    rms: float = field(metadata=reported(
        "rms of the slip speed about its mean over each cycle", "rad/s", name="judder_rms",
        scatters=True))
    peak: float = field(metadata=reported(
        "largest deviation from that mean", "rad/s", name="judder_peak", scatters=True))


@dataclass(frozen=True)
class OrdersAtSpeeds:
    """Amplitudes of the first K orders of the excitation at S speeds; NaN where the run does not pass a speed."""

    speeds: Floats = field(metadata=reported("frequencies of the excitation, (S,)", "rad/s"))
    order: Floats = field(metadata=reported("crank orders, (K,)"))
    slip_speed: Floats = field(metadata=reported(
        "amplitudes, (S, K); the largest where a run passes a speed repeatedly", "rad/s"))
    shaft_torque: Floats = field(metadata=reported("likewise, (S, K)", "N m"))


def judder_of(run: Trajectory, since: float) -> JudderFigures:
    """Return the judder of a sampled run in all whole periods of excitation from `since`, s, on; NaN without any."""
    at, apart = slip_about_cycle_mean(run_signals(run))
    kept = apart[at >= since - 1e-9]
    if not len(kept):
        return JudderFigures(math.nan, math.nan)
    return JudderFigures(float(np.sqrt(np.mean(kept**2))), float(np.abs(kept).max()))


def orders_at_speeds(run: Trajectory, speeds: Sequence[float], since: float) -> OrdersAtSpeeds:
    """Return the amplitudes of orders at given speeds.

    They are interpolated between the windows before and after the frequency passes a speed; at a constant frequency
    they are the largest of all windows.

    run : sampled run
    speeds : frequencies of the excitation, rad/s; without any, five within the range of the run, or its constant one
    since : start of the first window, s

    Raises InputError: as `orders_of`, or no window begins after `since`.
    """
    orders = orders_of(run)
    # A window is symmetric about its middle as far as the frequency is constant.
    kept = orders.time - math.pi * WINDOW / orders.frequency >= since - 1e-6
    if not kept.any():
        raise InputError(f"orders need a window of {WINDOW} periods of the excitation after the dropped ones")
    orders = orders.part(np.flatnonzero(kept), len(orders.order))
    low, high = float(orders.frequency.min()), float(orders.frequency.max())
    constant = high - low <= SAME * high
    requested = np.array(speeds, dtype=np.float64)
    if not len(requested):
        requested = np.array([low]) if constant else np.linspace(low, high, SPEEDS + 2)[1:-1]
    values = {name: np.array([[_largest_at(orders, speed, orders.cut(order, name), constant) for order in orders.cuts]
                              for speed in requested]) for name in ("slip_speed", "shaft_torque")}
    return OrdersAtSpeeds(requested, np.array(orders.cuts), **values)


def _largest_at(orders: Orders, speed: float, amplitude: Floats, constant: bool) -> float:
    """Return the largest amplitude with which the frequency passes a speed; NaN if it never does."""
    frequency = orders.frequency
    if constant:
        return float(amplitude.max()) if abs(speed - frequency[0]) <= SAME * speed else math.nan
    before, after = frequency[:-1], frequency[1:]
    passes = np.flatnonzero((np.minimum(before, after) <= speed) & (speed <= np.maximum(before, after))
                            & (before != after))
    share = (speed - before[passes]) / (after[passes] - before[passes])
    passed = amplitude[passes] + share * np.diff(amplitude)[passes]
    return float(passed.max()) if len(passed) else math.nan
