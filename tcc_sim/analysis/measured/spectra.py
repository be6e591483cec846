"""Spectra of a steady state: amplitudes of slip speed and shaft torque over frequency and crank order.

For a motion with a period, whole periods are transformed without a window, and every line is a multiple of the motion's
frequency. Otherwise the result is a power density by Welch's method with Hann's window.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from tcc_sim.analysis.measured.signals import HIGHEST_ORDER, Signals
from tcc_sim.errors import InputError, counted
from tcc_sim.result import Result, reported
from tcc_sim.trajectory import Floats

SPECTRUM_POINTS = 256  # Points in a cycle of the excitation after resampling, at most.
SPECTRUM_WINDOW = 64  # Length of a window of a motion without a period, at most, cycles of the excitation.
SPECTRUM_LEAST = 16  # The same at least, cycles of the excitation.
SUBHARMONIC = 1e-3  # Part of the largest line above which one between the multiples of the excitation is listed.


@dataclass(frozen=True, repr=False)
class Spectrum(Result):
    """Spectrum of slip speed and shaft torque; N lines. It has either amplitudes or densities."""

    frequency: Floats = field(metadata=reported("angular frequency of each line, (N,)", "rad/s"))
    order: Floats = field(metadata=reported("crank order of each line, (N,)"))
    window: str = field(metadata=reported(
        "window in time, its cycles, and the time that it covers"))
    period: int = field(metadata=reported("period of the motion in cycles, 0 for none"))
    subharmonics: Floats = field(metadata=reported(
        "crank orders between multiples of the excitation's, with a line above a thousandth of the largest"))
    slip_speed: Floats | None = field(metadata=reported(
        "amplitudes, (N,); of order 0 the mean", "rad/s", optional=True))
    shaft_torque: Floats | None = field(metadata=reported(
        "amplitudes, (N,); of order 0 the mean", "N m", optional=True))
    slip_speed_density: Floats | None = field(metadata=reported(
        "one-sided power density of a motion without a period, (N,)", "(rad/s)^2/Hz", optional=True))
    shaft_torque_density: Floats | None = field(metadata=reported(
        "one-sided power density of a motion without a period, (N,)", "(N m)^2/Hz", optional=True))

    def _text(self) -> str:
        return (f"Spectrum: {len(self.order)} {'lines' if self.period else 'densities'} up to order "
                f"{self.order[-1]:g}; {self.window}")

    def columns(self) -> dict[str, Floats]:
        """Return a row for every line."""
        names = ("slip_speed", "shaft_torque", "slip_speed_density", "shaft_torque_density")
        values = {name: getattr(self, name) for name in names}
        return {"frequency": self.frequency, "order": self.order,
                **{name: column for name, column in values.items() if column is not None}}


def spectrum_of(signals: Signals, period: int, last: int | None = None) -> Spectrum:
    """Return the spectrum of the end of a run.

    Parameters
    ----------
    period : of the motion in cycles of the excitation; 0 for none
    last : number of cycles at the end that are transformed; None for all

    Raises
    ------
    InputError
        Fewer cycles than a period, or than `SPECTRUM_LEAST` without a period.
    """
    whole = math.floor(float(signals.turns[-1] - signals.turns[0]) + 1e-9)
    per_cycle = min(SPECTRUM_POINTS, 2 ** math.floor(math.log2(len(signals.turns) / max(whole, 1))))
    whole = whole if last is None else min(whole, last)
    needed = period or SPECTRUM_LEAST
    if whole < needed:
        raise InputError(f"a spectrum needs {needed} whole cycles of the excitation, and there are {whole}")
    highest = min(float(HIGHEST_ORDER), 0.25 * per_cycle)
    cycles = whole // period * period if period else whole
    begin = float(signals.turns[-1]) - cycles
    at = signals.when(begin + np.arange(cycles * per_cycle + 1) / per_cycle)
    covers = f"{at[0]:.6g} to {at[-1]:.6g} s"
    omega = 2.0 * math.pi * cycles / float(at[-1] - at[0])
    values = signals.at(at[:-1])[:2]
    each = signals.system.engine.order
    if period:
        lines = math.floor(highest * period) + 1
        order = np.arange(lines) / period
        slip, shaft = (_lines(x, cycles // period, lines) for x in values)
        window = f"none: {counted(cycles // period, 'whole period')} of the motion, {covers}"
        return Spectrum(order * omega, each * order, window, period,
                        each * order[np.logical_or(*(_between(order, period, x) for x in (slip, shaft)))], slip, shaft,
                        None, None)
    length = min(SPECTRUM_WINDOW, whole)
    lines = math.floor(highest * length) + 1
    order = np.arange(lines) / length
    slip, shaft = (_density(x, length * per_cycle, lines, per_cycle * omega / (2.0 * math.pi)) for x in values)
    return Spectrum(order * omega, each * order, f"Hann of {length} cycles, half of each shared with the next, "
                    f"{covers}", 0, np.empty(0), None, None, slip, shaft)


def _lines(values: Floats, periods: int, count: int) -> Floats:
    """Return the amplitudes of the first `count` multiples of a motion's frequency, from whole periods."""
    amplitudes: Floats = 2.0 * np.abs(np.fft.rfft(values)[::periods][:count]) / len(values)
    amplitudes[0] *= 0.5
    return amplitudes


def _density(values: Floats, length: int, count: int, rate: float) -> Floats:
    """Return P. D. Welch's one-sided power density (IEEE Trans. Audio Electroacoust. 15, 1967) at a sampling rate, 1/s.
    """
    hann = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    parts = [values[k:k + length] for k in range(0, len(values) - length + 1, length // 2)]
    mean = values.mean()
    power = np.mean([np.abs(np.fft.rfft((part - mean) * hann)[:count]) ** 2 for part in parts], axis=0)
    power *= 2.0 / (rate * float(hann @ hann))
    power[0] *= 0.5
    return np.asarray(power)


def _between(order: Floats, period: int, amplitude: Floats) -> Floats:
    """Return which lines lie between the multiples of the excitation and are high enough."""
    high = amplitude > SUBHARMONIC * float(amplitude[1:].max(initial=0.0))
    return np.asarray(high & (np.arange(len(order)) % period != 0) & np.isfinite(amplitude))
