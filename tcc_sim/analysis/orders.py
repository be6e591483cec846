"""Orders, transmissibility and judder of a run, as reports on noise, vibration and harshness have them.

Slip speed and shaft torque are resampled in equal steps of the engine's phase, so that what goes with the engine stands
at its order however the frequency varies; a window of Hann over 16 cycles goes along them. An amplitude is that of the
sine, not a power.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.errors import InputError
from tcc_sim.model import equations
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import SWELL, SWELLS, phase_at
from tcc_sim.result import Result, reported
from tcc_sim.solvers.per_cycle import hermite
from tcc_sim.solvers.terms import terms_of
from tcc_sim.trajectory import Floats, Trajectory, integral

HANN_LOBE = 3
"""Columns of a spectrum that the mean spreads over: half of the main lobe of Hann's window."""


@dataclass(frozen=True)
class Judder:
    """How the slip speed shakes in each of W windows."""

    rms: Floats = field(metadata=reported("rms of the slip speed about its mean over each engine cycle, (W,)", "rad/s"))
    peak: Floats = field(metadata=reported("largest deviation from that mean, (W,)", "rad/s"))
    breakaways: Floats = field(metadata=reported("changes from stick to slip in a second, (W,)", "1/s"))


@dataclass(frozen=True, repr=False)
class Orders(Result):
    """Orders in windows of 16 engine cycles along a run; W windows, N orders, K orders of the engine torque."""

    time: Floats = field(metadata=reported("middle of each window, (W,)", "s"))
    frequency: Floats = field(metadata=reported("frequency of the engine there, (W,)", "rad/s"))
    order: Floats = field(metadata=reported("multiples of the engine frequency, (N,)"))
    slip_speed: Floats = field(metadata=reported(
        "amplitudes of the sines, (W, N); of order 0 the mean's size", "rad/s"))
    shaft_torque: Floats = field(metadata=reported(
        "amplitudes of the sines, (W, N); of order 0 the mean's size", "N m"))
    torque_order: Floats = field(metadata=reported("orders that the engine torque has, (K,)"))
    transmissibility: Floats = field(metadata=reported("shaft torque over engine torque at these orders, (W, K)"))
    judder: Judder = field(metadata=reported("how the slip speed shakes in each window"))
    heat: Floats = field(metadata=reported("work of the friction torque from the start of the run to there, (W,)", "J"))
    modes: tuple[float, float] = field(metadata=reported(
        "natural frequencies with the clutch stuck and slipping", "rad/s"))

    def __repr__(self) -> str:
        return (f"<Orders: {len(self.time)} windows, {self.frequency.min():.6g} to {self.frequency.max():.6g} rad/s, "
                f"orders up to {self.order[-1]:g}>")

    def columns(self) -> dict[str, Floats]:
        """A row for every window: time, frequency, judder, heat, and the shaft torque of orders 1 to 4."""
        return {"time": self.time, "frequency": self.frequency, **vars(self.judder), "heat": self.heat,
                **{f"shaft_torque_{n}": self.cut(n) for n in range(1, min(4, int(self.order[-1])) + 1)}}

    def cut(self, order: float, of: str = "shaft_torque") -> Floats:
        """The amplitude of one order along the run, (W,)."""
        found: Floats = getattr(self, of)[:, int(np.argmin(np.abs(self.order - order)))]
        return found


def orders_of(run: Trajectory) -> Orders:
    """The orders of a run from its samples.

    Parameters
    ----------
    run : with its system, and samples of which there are `Settings.least_samples` to a cycle

    Raises
    ------
    InputError
        Fewer than `Settings.window` cycles, too few samples, or no system.
    """
    system = run.system
    if system is None:
        raise InputError("the trajectory has no system, which says what the engine's phase is")
    turns, when = _phase_of(run, system)
    whole = math.floor(float(turns[-1] - turns[0]) + 1e-9)
    if whole < DEFAULTS.window:
        raise InputError(f"orders need {DEFAULTS.window} engine cycles, and there are {whole}")
    if len(turns) < DEFAULTS.least_samples * whole:
        raise InputError(f"orders need {DEFAULTS.least_samples} samples in an engine cycle, and there are "
                         f"{len(turns) / whole:.3g}")
    per_cycle = DEFAULTS.per_cycle
    begin = math.ceil(float(turns[0]) * per_cycle - 1e-6)
    count = (math.floor(float(turns[-1]) * per_cycle + 1e-6) - begin) // per_cycle * per_cycle + 1
    at = when((begin + np.arange(count)) / per_cycle)
    v, shaft, torque = _resampled(run, system, at)
    length = DEFAULTS.window * per_cycle
    starts = np.arange(0, count - length, DEFAULTS.hop * per_cycle)
    highest = min(float(DEFAULTS.highest_order), 0.25 * len(turns) / whole)
    order = np.arange(math.floor(highest * DEFAULTS.window) + 1) / DEFAULTS.window
    spectra = [_amplitudes(x, starts, length, len(order)) for x in (v, shaft, torque)]
    driven = _driven(system, spectra[2], order)
    driven = driven[driven <= order[-1]]
    places = np.rint(driven * DEFAULTS.window).astype(int)
    with np.errstate(divide="ignore", invalid="ignore"):
        passed = spectra[1][:, places] / spectra[2][:, places]
    apart = _about_cycle_mean(v)
    ends = starts + length
    broke = _breakaways(run)
    counts = np.searchsorted(broke, at[ends]) - np.searchsorted(broke, at[starts])
    lasted, middle = at[ends] - at[starts], at[(starts + ends) // 2]
    power = run.friction_torque * run.slip_speed
    heat = integral(power, run.t)
    judder = Judder(np.array([math.sqrt(float(np.mean(apart[a:b] ** 2))) for a, b in zip(starts, ends)]),
                    np.array([float(np.abs(apart[a:b]).max()) for a, b in zip(starts, ends)]), counts / lasted)
    return Orders(
        time=middle, frequency=2.0 * np.pi * DEFAULTS.window / lasted, order=order, slip_speed=spectra[0],
        shaft_torque=spectra[1], torque_order=driven, transmissibility=passed,
        judder=judder, heat=np.interp(middle, run.t, heat),
        modes=(system.stuck_natural_frequency, system.natural_frequency))


def turns_at(system: System, t: Floats) -> Floats:
    """Engine cycles passed at the times t, (n,)."""
    return t / system.cycle if system.profile is None else np.asarray(phase_at(system.profile, t)) / (2.0 * math.pi)


def _phase_of(run: Trajectory, system: System) -> tuple[Floats, Callable[[Floats], Floats]]:
    """Engine cycles passed at the samples, and when so many have passed: the scene's or, where the torque was
    commanded, those that were told from it, each of one frequency.
    """
    if system.engine.source != "topic":
        return turns_at(system, run.t), system.cycle_start
    starts = run.cycles.starts if run.cycles is not None else None
    if starts is None or len(starts) < 2 or not np.isfinite(starts).all():
        raise InputError("the torque was commanded, and its engine cycles are not known: there are no orders")
    numbers = np.arange(len(starts), dtype=np.float64)
    within = run.t[(run.t >= starts[0]) & (run.t <= starts[-1])]
    return np.interp(within, starts, numbers), lambda turns: np.interp(turns, numbers, starts)


def _resampled(run: Trajectory, system: System, at: Floats) -> tuple[Floats, Floats, Floats]:
    """Slip speed, shaft torque and engine torque at the times `at`, by cubics with the rates of the equations."""
    d = system.driveline
    twist, twisting = run.shaft_twist
    slip, plate = equations.accelerations(twist, twisting, run.engine_torque, run.friction_torque,
                                          terms_of(system).linear)
    shaft = d.damping * twisting + d.stiffness * twist
    return (hermite(at, run.t, run.slip_speed, slip),
            hermite(at, run.t, shaft, d.damping * plate + d.stiffness * twisting),
            hermite(at, run.t, run.engine_torque, np.gradient(run.engine_torque, run.t)))


def _amplitudes(values: Floats, starts: NDArray[np.int64], length: int, count: int) -> Floats:
    """(W, count) amplitudes of the first `count` multiples of one turn in a window, by Hann's window."""
    hann = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    out = np.empty((len(starts), count))
    for row, start in zip(out, starts.tolist()):
        row[:] = 2.0 * np.abs(np.fft.rfft(values[start:start + length] * hann)[:count]) / hann.sum()
    out[:, 0] *= 0.5
    return out


def _driven(system: System, torque: Floats, order: Floats) -> Floats:
    """The orders that the engine torque has: those of the scene or, where it was commanded or comes from data, the
    peaks of its amplitudes, (W, N), that reach `DEFAULTS.driven` of the largest in their window, most of the time.
    """
    engine = system.engine
    if engine.source != "topic" and (system.inputs is None or system.inputs.torque is None):
        terms = terms_of(system)
        rate = 1.0 if terms.profile is not None else engine.frequency
        driven = [] if terms.torque is None else [1.0]
        driven += [] if terms.harmonics is None else np.round(terms.harmonics[:, 0] / rate).tolist()
        driven += [] if terms.profile is None else terms.profile[0, SWELLS::SWELL].tolist()
        return np.array(sorted(driven), dtype=np.float64)
    torque = torque.copy()
    torque[:, :HANN_LOBE] = 0.0  # The mean's, and what Hann's window spreads of it.
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.median(torque / torque.max(axis=1, keepdims=True), axis=0)
    tops = (share[1:-1] > share[:-2]) & (share[1:-1] >= share[2:]) & (share[1:-1] >= DEFAULTS.driven)
    found: Floats = order[1:-1][tops]
    return found


def _about_cycle_mean(v: Floats) -> Floats:
    """The slip speed less its mean over the engine cycle that it is in."""
    whole = (len(v) - 1) // DEFAULTS.per_cycle * DEFAULTS.per_cycle
    cycles = v[:whole].reshape(-1, DEFAULTS.per_cycle)
    return np.append((cycles - cycles.mean(axis=1, keepdims=True)).ravel(), 0.0)


def _breakaways(run: Trajectory) -> Floats:
    """When the clutch goes from stick to slip, s, ascending."""
    if len(run.transitions.time):
        moves = run.transitions
        return np.asarray(moves.time[moves.before == 0])
    out: Floats = run.t[1:][(run.state[:-1] == 0) & (run.state[1:] != 0)]
    return out
