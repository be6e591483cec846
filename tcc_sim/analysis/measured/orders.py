"""Orders, transmissibility and judder of a run, as in reports on noise, vibration and harshness, and spectra.

Slip speed and shaft torque are resampled in equal steps of the engine's phase, so that engine-synchronous components
stay at their order while the frequency varies. A Hann window over 16 cycles moves along them. Amplitudes are those of
sines, not powers. A manoeuvre as a whole has its judder, and amplitudes of orders at given speeds of the engine.

For a steady motion with a period a spectrum transforms whole periods without a window, and every line is a multiple of
the motion's frequency. Otherwise the result is a power density by Welch's method with Hann's window.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.measured.signals import DRIVEN, HIGHEST_ORDER, LEAST_SAMPLES, Signals, run_signals
from tcc_sim.errors import InputError, counted
from tcc_sim.result import Result, reported, result_class
from tcc_sim.tables.sampling import in_words
from tcc_sim.trajectory import Floats, Trajectory

WINDOW = 16  # Length of a window, periods of excitation.
HOP = 4  # From one window to the next, periods of excitation.
PER_CYCLE = 64  # Points in a period of excitation after resampling.
OF_SAMPLES = 0.45  # Highest frequency of an order, relative to that of a table's samples.

HANN_LOBE = 3  # Columns of a spectrum over which the mean spreads: half the main lobe of Hann's window.
CUTS = (1.0, 2.0, 3.0, 4.0)  # Orders of the excitation that are drawn and listed individually.
LEAST = 1e-12  # Lower limit of amplitudes in levels.


@result_class
class Judder:
    """Oscillation of the slip speed in each of W windows."""

    rms: Floats = reported("rms about the mean over each cycle, (W,)", "rad/s")
    peak: Floats = reported("largest deviation from the mean, (W,)", "rad/s")
    breakaways: Floats = reported("changes from stick to slip, (W,)", "1/s")


@result_class(repr=False)
class Orders(Result):
    """Orders in windows of 16 periods of the excitation along a run; W windows, N orders, K of the engine torque."""

    time: Floats = reported("middle of each window without gaps, (W,)", "s")
    frequency: Floats = reported("frequency of the excitation there, (W,)", "rad/s")
    order: Floats = reported("crank orders, (N,)")
    slip_speed: Floats = reported("amplitudes, (W, N); of order 0 the mean's size", "rad/s")
    shaft_torque: Floats = reported("amplitudes, (W, N); of order 0 the mean's size", "N m")
    torque_order: Floats = reported("crank orders of the engine torque, (K,)")
    transmissibility: Floats = reported("shaft torque over engine torque there, (W, K)")
    judder: Judder = reported("shaking of the slip speed in each window")
    heat: Floats = reported("work of friction since the start, (W,)", "J")
    modes: tuple[float, float] = reported("natural frequencies, stuck and slipping", "rad/s")
    per_revolution: float = reported("engine.order: cycles in a crank revolution", default=1.0)
    left_out: int = reported("windows left out because of gaps", default=0)

    def _text(self) -> str:
        return (f"Orders: {len(self.time)} windows, {self.frequency.min():.6g} to {self.frequency.max():.6g} rad/s, "
                f"orders up to {self.order[-1]:g}")

    def columns(self) -> dict[str, Floats]:
        """Return a row for every window: time, frequency, judder, heat, and the shaft torque of orders 1 to 4."""
        return {"time": self.time, "frequency": self.frequency, **vars(self.judder), "heat": self.heat,
                **{f"shaft_torque_{order:g}": self.cut(order) for order in self.cuts}}

    @property
    def cuts(self) -> list[float]:
        """Crank orders of the first multiples of the excitation, as far as they exist."""
        return [self.per_revolution * order for order in CUTS if self.per_revolution * order <= self.order[-1]]

    def _changed(self, change: Callable[[Floats], Floats]) -> Orders:
        """Return the orders with every array over the windows changed by a function."""
        names = ("time", "frequency", "slip_speed", "shaft_torque", "transmissibility", "heat")
        changed: dict[str, Any] = {name: change(getattr(self, name)) for name in names}
        return replace(self, judder=Judder(*map(change, vars(self.judder).values())), **changed)

    def part(self, w: NDArray[np.int64], orders: int) -> Orders:
        """Return the windows of these numbers, and the first orders."""
        out, n = self._changed(lambda values: values[w]), slice(orders)
        return replace(out, order=self.order[n], slip_speed=out.slip_speed[:, n], shaft_torque=out.shaft_torque[:, n])

    def with_blanks(self) -> Orders:
        """Return the orders with blank windows, NaN, in place of those that a hole left out, for pictures over time."""
        steps = np.diff(self.time)
        expected = HOP * math.pi * (1.0 / self.frequency[1:] + 1.0 / self.frequency[:-1])
        missing = np.maximum(np.rint(steps / expected) - 1.0, 0.0) if len(steps) else np.empty(0)
        if not missing.any():
            return self
        places = np.concatenate([np.arange(n + 1.0) / (n + 1.0) + k for k, n in enumerate(missing.tolist())]
                                + [[float(len(steps))]])
        at_window, first = places == np.floor(places), np.floor(places).astype(np.int64)
        out = self._changed(lambda values: np.where(at_window, values[first].T, np.nan).T)
        numbers = np.arange(len(self.time))
        return replace(out, time=np.interp(places, numbers, self.time),
                       frequency=np.interp(places, numbers, self.frequency))

    def cut(self, order: float, of: str = "shaft_torque") -> Floats:
        """Return the amplitude of one order along the run, (W,)."""
        amplitudes: Floats = getattr(self, of)[:, int(np.argmin(np.abs(self.order - order)))]
        return amplitudes


def orders_of(run: Trajectory | Signals) -> Orders:
    """Return the orders of a run from its samples; windows with a gap between samples are left out.

    Parameters
    ----------
    run : trajectory with its system, or signals, with at least `LEAST_SAMPLES` samples in a period of the
        excitation

    Raises
    ------
    InputError
        Fewer than `WINDOW` periods, too few samples, no window without a gap, or no system.

    Examples
    --------
    >>> import tcc_sim
    >>> result = tcc_sim.orders(tcc_sim.solve("slip", cycles=40, samples_per_cycle=64))
    >>> float(result.order[16]), len(result.time)
    (1.0, 7)
    """
    signals = run if isinstance(run, Signals) else run_signals(run)
    turns, system = signals.turns, signals.system
    whole = math.floor(float(turns[-1] - turns[0]) + 1e-9)
    if whole < WINDOW:
        raise InputError(f"orders need {WINDOW} periods of the excitation, and there are {whole}")
    if len(turns) < LEAST_SAMPLES * whole:
        raise InputError(f"orders need {LEAST_SAMPLES} samples in a period of the excitation, and there are "
                         f"{len(turns) / whole:.3g}")
    begin = math.ceil(float(turns[0]) * PER_CYCLE - 1e-6)
    count = (math.floor(float(turns[-1]) * PER_CYCLE + 1e-6) - begin) // PER_CYCLE * PER_CYCLE + 1
    at = signals.when((begin + np.arange(count)) / PER_CYCLE)
    v, shaft, torque = signals.at(at)
    length = WINDOW * PER_CYCLE
    starts = np.arange(0, count - length, HOP * PER_CYCLE)
    first, (hole, end) = (begin + starts) / PER_CYCLE, signals.holes.T
    hidden = ((hole < signals.when(first + WINDOW)[:, None]) & (end > signals.when(first)[:, None])).any(axis=1)
    starts = starts[~hidden]
    if not len(starts):
        raise InputError(f"every window of {WINDOW} periods of the excitation has a gap between samples: "
                         f"{in_words(signals.holes)}")
    highest = min(float(HIGHEST_ORDER), 0.25 * len(turns) / whole)
    order = np.arange(math.floor(highest * WINDOW) + 1) / WINDOW
    spectra = [_amplitudes(x, starts, length, len(order)) for x in (v, shaft, torque)]
    if signals.splined:
        samples = np.searchsorted(signals.t, at[starts + length]) - np.searchsorted(signals.t, at[starts])
        kept = _kept_by_spline(order / (samples / WINDOW)[:, None])
        spectra = [spectrum / kept for spectrum in spectra]
    driven = _driven(spectra[2], order) if signals.driven is None else signals.driven
    driven = driven[driven <= order[-1]]
    places = np.rint(driven * WINDOW).astype(int)
    with np.errstate(divide="ignore", invalid="ignore"):
        passed = spectra[1][:, places] / spectra[2][:, places]
    apart = _about_cycle_mean(v)
    ends = starts + length
    lasted, middle = at[ends] - at[starts], at[(starts + ends) // 2]
    broke = signals.breakaways
    counts = np.full(len(starts), np.nan) if broke is None else np.searchsorted(broke, at[ends]) - np.searchsorted(
        broke, at[starts])
    judder = Judder(np.array([math.sqrt(float(np.mean(apart[a:b] ** 2))) for a, b in zip(starts, ends)]),
                    np.array([float(np.abs(apart[a:b]).max()) for a, b in zip(starts, ends)]), counts / lasted)
    each = system.engine.order
    return Orders(
        time=middle, frequency=2.0 * np.pi * WINDOW / lasted, order=each * order, slip_speed=spectra[0],
        shaft_torque=spectra[1], torque_order=each * driven, transmissibility=passed,
        judder=judder, heat=np.interp(middle, signals.t, signals.heat),
        modes=(system.stuck_natural_frequency, system.natural_frequency), per_revolution=each,
        left_out=int(hidden.sum()))


@result_class(repr=False)
class OrderComparison(Result):
    """Orders of a measured run beside those of the simulated one, in the same windows."""

    measured: Orders = reported("orders of the measurement")
    simulated: Orders = reported("orders of the simulation")

    def _text(self) -> str:
        return f"OrderComparison: {len(self.measured.time)} windows"

    def columns(self) -> dict[str, Floats]:
        """Return a row for every window: time, frequency, and the differences of the drawn orders, dB."""
        cuts = {f"{name}_{order:g}": self.difference(name, order)
                for name in ("slip_speed", "shaft_torque") for order in self.measured.cuts}
        return {"time": self.measured.time, "frequency": self.measured.frequency, **cuts}

    def difference(self, of: str, order: float) -> Floats:
        """Return the simulated level of one order minus the measured one, dB, (W,)."""
        return level(self.simulated.cut(order, of)) - level(self.measured.cut(order, of))


def compared(measured: Signals, run: Trajectory) -> OrderComparison:
    """Compare the orders of a measurement with those of the run that it drove, both by the measured phase.

    Raises InputError: as `orders_of`.
    """
    inside = (measured.t >= run.t[0]) & (measured.t <= run.t[-1])
    measured_orders = orders_of(replace(measured, turns=measured.turns[inside], t=measured.t[inside],
                                        heat=measured.heat[inside]))
    simulated_orders = orders_of(run_signals(run, (measured.turns, measured.when)))
    _, *both = np.intersect1d(np.rint(1e6 * measured_orders.time), np.rint(1e6 * simulated_orders.time),
                              return_indices=True)
    if not len(both[0]):
        raise InputError("no window of the measurement is one of the run")
    orders = min(len(measured_orders.order), len(simulated_orders.order))
    return OrderComparison(measured_orders.part(both[0], orders), simulated_orders.part(both[1], orders))


def level(amplitude: Floats) -> Floats:
    """Return 20 log10 of an amplitude, dB re 1 of its unit."""
    return 20.0 * np.log10(np.maximum(amplitude, LEAST))


def _amplitudes(values: Floats, starts: NDArray[np.int64], length: int, count: int) -> Floats:
    """Return (W, count) amplitudes of the first `count` multiples of one turn in a window, by Hann's window."""
    hann = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    out = np.empty((len(starts), count))
    for row, start in zip(out, starts.tolist()):
        row[:] = 2.0 * np.abs(np.fft.rfft(values[start:start + length] * hann)[:count]) / hann.sum()
    out[:, 0] *= 0.5
    return out


def _kept_by_spline(share: Floats) -> Floats:
    """Return the part of a sine's amplitude that the cubic spline through samples keeps; NaN from 0.45 on.

    share : its frequency over that of the samples. M. Unser, Splines, IEEE Signal Processing Magazine 16 (1999),
    equation (23): sinc(f)^4 3/(2 + cos(2 pi f))
    """
    kept = np.sinc(share) ** 4 * 3.0 / (2.0 + np.cos(2.0 * np.pi * share))
    return np.where(share < OF_SAMPLES, kept, np.nan)


def _driven(torque: Floats, order: Floats) -> Floats:
    """Return the orders of a measured torque: peaks of (W, N) amplitudes with a median share of `DRIVEN`."""
    torque = torque.copy()
    torque[:, :HANN_LOBE] = 0.0  # The mean, and its spread by Hann's window.
    with np.errstate(divide="ignore", invalid="ignore"):
        share = torque / torque.max(axis=1, keepdims=True)
    known = np.isfinite(share).all(axis=1)
    share = np.median(share[known], axis=0) if known.any() else np.zeros(len(order))
    tops = (share[1:-1] > share[:-2]) & (share[1:-1] >= share[2:]) & (share[1:-1] >= DRIVEN)
    peaks: Floats = order[1:-1][tops]
    return peaks


def _about_cycle_mean(v: Floats) -> Floats:
    """Return the slip speed minus its mean over each engine cycle."""
    whole = (len(v) - 1) // PER_CYCLE * PER_CYCLE
    cycles = v[:whole].reshape(-1, PER_CYCLE)
    return np.append((cycles - cycles.mean(axis=1, keepdims=True)).ravel(), 0.0)


SPECTRUM_POINTS = 256  # Points in a cycle of the excitation after resampling, at most.
SPECTRUM_WINDOW = 64  # Length of a window of a motion without a period, at most, cycles of the excitation.
SPECTRUM_LEAST = 16  # The same at least, cycles of the excitation.
SUBHARMONIC = 1e-3  # Part of the largest line above which one between the multiples of the excitation is listed.


@result_class(repr=False)
class Spectrum(Result):
    """Spectrum of slip speed and shaft torque; N lines. It has either amplitudes or densities."""

    frequency: Floats = reported("angular frequency of each line, (N,)", "rad/s")
    order: Floats = reported("crank order of each line, (N,)")
    window: str = reported("window in time, its cycles, and the time that it covers")
    period: int = reported("period of the motion in cycles, 0 for none")
    subharmonics: Floats = reported(
        "crank orders between multiples of the excitation's, with a line above a thousandth of the largest")
    slip_speed: Floats | None = reported(
        "amplitudes, (N,); of order 0 the mean", "rad/s", optional=True, default=None)
    shaft_torque: Floats | None = reported(
        "amplitudes, (N,); of order 0 the mean", "N m", optional=True, default=None)
    slip_speed_density: Floats | None = reported(
        "one-sided power density of a motion without a period, (N,)", "(rad/s)^2/Hz", optional=True, default=None)
    shaft_torque_density: Floats | None = reported(
        "one-sided power density of a motion without a period, (N,)", "(N m)^2/Hz", optional=True, default=None)

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

    period : of the motion in cycles of the excitation; 0 for none
    last : number of cycles at the end that are transformed; None for all

    Raises InputError: fewer cycles than a period, or than `SPECTRUM_LEAST` without a period.
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
    from scipy.signal import welch

    length = min(SPECTRUM_WINDOW, whole)
    lines, samples = math.floor(highest * length) + 1, length * per_cycle
    order = np.arange(lines) / length
    slip, shaft = (welch(x - x.mean(), per_cycle * omega / (2.0 * math.pi), nperseg=samples,
                         noverlap=samples - samples // 2, detrend=False)[1][:lines] for x in values)
    return Spectrum(order * omega, each * order, f"Hann of {length} cycles, half of each shared with the next, "
                    f"{covers}", 0, np.empty(0), None, None, slip, shaft)


def _lines(values: Floats, periods: int, count: int) -> Floats:
    """Return the amplitudes of the first `count` multiples of a motion's frequency, from whole periods."""
    amplitudes: Floats = 2.0 * np.abs(np.fft.rfft(values)[::periods][:count]) / len(values)
    amplitudes[0] *= 0.5
    return amplitudes


def _between(order: Floats, period: int, amplitude: Floats) -> Floats:
    """Return which lines lie between the multiples of the excitation and are high enough."""
    high = amplitude > SUBHARMONIC * float(amplitude[1:].max(initial=0.0))
    return np.asarray(high & (np.arange(len(order)) % period != 0) & np.isfinite(amplitude))


SPEEDS = 5  # Default number of speeds within the range of a run.
SAME = 1e-6  # Relative range of a frequency that is constant.


@result_class
class JudderFigures:
    """Judder over all whole periods of excitation that are kept."""

    rms: float = reported(
        "rms of the slip speed about its mean over each cycle", "rad/s", name="judder_rms", scatters=True)
    peak: float = reported("largest deviation from that mean", "rad/s", name="judder_peak", scatters=True)


@result_class
class OrdersAtSpeeds:
    """Amplitudes of the first K orders of the excitation at S speeds; NaN where the run does not pass a speed."""

    speeds: Floats = reported("frequencies of the excitation, (S,)", "rad/s")
    order: Floats = reported("crank orders, (K,)")
    slip_speed: Floats = reported("amplitudes, (S, K); the largest where a run passes a speed repeatedly", "rad/s")
    shaft_torque: Floats = reported("likewise, (S, K)", "N m")


def judder_of(run: Trajectory, since: float) -> JudderFigures:
    """Return the judder of a sampled run in all whole periods of excitation from `since`, s, on; NaN without any."""
    signals = run_signals(run)
    begin = math.ceil(float(signals.turns[0]) - 1e-9)
    count = max(math.floor(float(signals.turns[-1]) + 1e-9) - begin, 0) * PER_CYCLE
    at = signals.when(begin + np.arange(count + 1) / PER_CYCLE)
    kept = _about_cycle_mean(signals.at(at)[0])[:-1][at[:-1] >= since - 1e-9]
    if not len(kept):
        return JudderFigures(math.nan, math.nan)
    return JudderFigures(float(np.sqrt(np.mean(kept**2))), float(np.abs(kept).max()))


def orders_at_speeds(run: Trajectory, speeds: Sequence[float], since: float) -> OrdersAtSpeeds:
    """Return the amplitudes of orders at given speeds.

    They are interpolated between the windows before and after the frequency passes a speed; at a constant frequency
    they are the largest of all windows.

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
