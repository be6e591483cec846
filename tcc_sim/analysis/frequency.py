"""The angular frequency of a recorded engine torque, where no scene says it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tcc_sim.recording.stamps import Break, StampCounter, Stamps
from tcc_sim.trajectory import Floats

OPENING = 1 << 14
"""Samples of a run, at most, that give the first estimate."""
CYCLES_PER_BLOCK = 4
SAMPLES_PER_BLOCK = 64
STRONGEST_LINE = 0.2
"""Part of the torque's variance that its strongest line must hold for the torque to count as periodic."""
LARGEST_WANDER = 0.5
"""Largest rms deviation of the line's phase from uniform rotation, rad."""


@dataclass(frozen=True)
class Line:
    """The strongest line of a torque: angular frequency (rad/s), amplitude (N m), part of the variance that it holds.
    """

    frequency: float
    amplitude: float
    share: float


class FrequencyFinder:
    """Finds the strongest line of the engine torque from batches in the order of recording, with bounded memory.

    The first samples give an estimate, the peak of a windowed Fourier transform; from then on every few cycles come to
    one phase by least squares, and the slope of the phases over the whole run refines the frequency. The run with the
    most samples counts.
    """

    def __init__(self) -> None:
        self._continuity = StampCounter()
        self._best: _Run | None = None
        self._run = _Run()

    def feed(self, stamp_ns: Stamps, engine_torque: Floats, run: int = 0) -> None:
        """Take the next batch: stamps in ns, torques in N m, and the number of its run where that is known."""
        finite = np.isfinite(engine_torque)
        stamp_ns, engine_torque = stamp_ns[finite], engine_torque[finite]
        for piece, preceded in self._continuity.pieces(stamp_ns, run):
            if preceded.begins_a_run:
                self._settle()
            elif preceded is Break.GAP:
                self._run.interrupt()
            self._run.take(stamp_ns[piece].astype(np.float64) * 1e-9, engine_torque[piece])

    def line(self) -> Line | None:
        """The line found, or None where the torque is not periodic: constant, noise, or of changing frequency."""
        self._settle()
        return self._best.line() if self._best is not None else None

    def _settle(self) -> None:
        """End the run at hand and keep it if it is the longest."""
        if self._best is None or self._run.samples >= self._best.samples:
            self._best = self._run
        self._run = _Run()


class _Run:
    """One run: an opening estimate, then (mid time, complex amplitude) of each block, and the torque's moments."""

    def __init__(self) -> None:
        self.samples = 0
        self._sum = 0.0
        self._squares = 0.0
        self._reference: float | None = None
        self._rough = 0.0
        self._blocks: list[tuple[float, complex]] = []
        self._t: list[Floats] = []
        self._torque: list[Floats] = []
        self._held = 0
        self._opening: tuple[Floats, Floats] = (np.empty(0), np.empty(0))

    def take(self, t: Floats, torque: Floats) -> None:
        """Add samples that follow the last without a gap."""
        if self._reference is None:
            self._reference = float(torque[0])
        self.samples += len(t)
        self._sum += float(np.sum(torque - self._reference))
        self._squares += float(np.sum((torque - self._reference) ** 2))
        self._t.append(t)
        self._torque.append(torque)
        self._held += len(t)
        if self._held >= OPENING or self._rough:
            self._work()

    def interrupt(self) -> None:
        """A gap: nothing that waits may be joined with what comes."""
        self._work(last=True)
        self._t, self._torque, self._held = [], [], 0

    def line(self) -> Line | None:
        """The line of this run."""
        self._work(last=True)
        if not self._blocks or self._reference is None:
            return None
        mean = self._sum / self.samples
        variance = self._squares / self.samples - mean * mean
        where = np.array([t for t, _ in self._blocks])
        values = np.array([c for _, c in self._blocks])
        amplitude = float(np.sqrt(np.mean(np.abs(values) ** 2)))
        size = max(abs(self._reference + mean), amplitude)
        if variance <= (1e-9 * size) ** 2:
            return None
        share = 0.5 * amplitude * amplitude / variance
        phase = np.unwrap(np.angle(values))
        slope = 0.0
        if len(where) == 1:
            frequency, amplitude = _fitted(self._rough, *self._opening)
            slope = frequency - self._rough
            share = 0.5 * amplitude * amplitude / variance
        else:
            slope, start = np.polyfit(where - where[0], phase, 1)
            if float(np.sqrt(np.mean((phase - start - slope * (where - where[0])) ** 2))) > LARGEST_WANDER:
                return None
        return Line(self._rough + float(slope), amplitude, min(share, 1.0)) if share >= STRONGEST_LINE else None

    def _work(self, last: bool = False) -> None:
        """Turn what waits into blocks."""
        if not self._t:
            return
        t, torque = np.concatenate(self._t), np.concatenate(self._torque)
        if not self._rough:
            self._opening = t[:OPENING], torque[:OPENING]
            self._rough = _strongest(*self._opening)
            if not self._rough:
                self._t, self._torque, self._held = [], [], 0
                return
        length = CYCLES_PER_BLOCK * 2.0 * math.pi / self._rough
        while len(t) and (t[-1] - t[0] >= length or (last and not self._blocks and len(t) >= 8)):
            count = max(int(np.searchsorted(t, t[0] + length)), SAMPLES_PER_BLOCK)
            block, values = t[:count], torque[:count]
            angle = self._rough * block
            design = np.stack([np.ones_like(block), np.cos(angle), np.sin(angle)], axis=1)
            _, c, s = np.linalg.lstsq(design, values, rcond=None)[0]
            # c cos + s sin = |z| cos(rough t + arg z) with z = c - i s
            self._blocks.append((float(0.5 * (block[0] + block[-1])), complex(c, -s)))
            t, torque = t[count:], torque[count:]
        self._t, self._torque, self._held = [t], [torque], len(t)


def _sine(frequency: float, t: Floats, torque: Floats) -> tuple[float, float]:
    """Sum of squares that a constant and a sine of this frequency leave, and the sine's amplitude."""
    design = np.stack([np.ones_like(t), np.cos(frequency * t), np.sin(frequency * t)], axis=1)
    found = np.linalg.lstsq(design, torque, rcond=None)[0]
    left = torque - design @ found
    return float(left @ left), float(np.hypot(found[1], found[2]))


def _fitted(rough: float, t: Floats, torque: Floats) -> tuple[float, float]:
    """Frequency and amplitude of a sine fitted to few cycles, whose Fourier peak is only near (0.7 to 1.4 times)."""
    from scipy.optimize import minimize_scalar

    t = t - t[0]
    guess = min(np.linspace(0.7, 1.4, 71).tolist(), key=lambda factor: _sine(factor * rough, t, torque)[0])
    best = minimize_scalar(lambda factor: _sine(factor * rough, t, torque)[0], bounds=(guess - 0.01, guess + 0.01),
                           method="bounded", options={"xatol": 1e-10})
    return float(best.x) * rough, _sine(float(best.x) * rough, t, torque)[1]


def _strongest(t: Floats, torque: Floats) -> float:
    """Peak of the Fourier transform of uniform samples under a Hann window, refined by a parabola; 0 where there is
    none.
    """
    if len(t) < 16:
        return 0.0
    step = float(t[-1] - t[0]) / (len(t) - 1)
    size = 4 * (1 << (len(t) - 1).bit_length())
    spectrum = np.abs(np.fft.rfft((torque - torque.mean()) * np.hanning(len(t)), size))
    lowest = 8 * size // (2 * len(t))
    k = lowest + int(np.argmax(spectrum[lowest:]))
    if spectrum[k] <= 1e-9 * max(float(np.abs(torque).max()), 1e-300) * len(t):
        return 0.0
    shift = 0.0
    if 0 < k < len(spectrum) - 1 and spectrum[k - 1] > 0.0 and spectrum[k + 1] > 0.0:
        a, b, c = np.log(spectrum[k - 1:k + 2])
        shift = 0.5 * (a - c) / (a - 2.0 * b + c) if a - 2.0 * b + c != 0.0 else 0.0
    return 2.0 * math.pi * (k + float(shift)) / (size * step)
