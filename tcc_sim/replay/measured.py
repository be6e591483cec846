"""Orders and spectrum of a table of measurements."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tcc_sim.analysis.measured.measured_phase import measured_phase, signals_in
from tcc_sim.analysis.measured.orders import SPECTRUM_LEAST, Orders, Spectrum, orders_of, spectrum_of
from tcc_sim.analysis.measured.signals import Signals
from tcc_sim.analysis.repetition import LONGEST
from tcc_sim.analysis.steady.summary import default_discard, periodicity
from tcc_sim.errors import InputError, counted
from tcc_sim.model.parameters import System
from tcc_sim.model.parameters import replace as changed
from tcc_sim.model.quantity import MOST_POINTS
from tcc_sim.result import Result, reported, result_class
from tcc_sim.scene import Scene
from tcc_sim.tables.measured_table import MeasuredTable, longest_part
from tcc_sim.trajectory import Cycles, Floats


@result_class(repr=False)
class MeasuredRun(Result):
    """Orders and spectrum of measurements."""

    samples: int = reported("rows of the table")
    seconds: float = reported("from the first to the last row", "s")
    orders: Orders | None = reported("orders, transmissibility and judder", optional=True, default=None)
    spectrum: Spectrum | None = reported("amplitudes over frequency and order", optional=True, default=None)
    warnings: tuple[str, ...] = reported("sentences on what was converted, mended or left out", default=())

    def columns(self) -> dict[str, Floats]:
        """Return the columns of the orders or, without these, of the spectrum."""
        figures = self.orders or self.spectrum
        return dict(figures.columns()) if figures is not None else {}


def analyse_table(table: MeasuredTable, system: System, *, orders: bool, spectrum: bool,
                  pulses: int | None = None) -> MeasuredRun:
    """Return orders and spectrum of a table of four rows or more; the spectrum is that of the longest stretch without a
    hole. Errors are those of `analysis.measured.measured_phase.signals_in`, `orders_of` and `spectrum_of`.

    system : system whose shaft, modes and `engine.order` are used
    pulses : number of tacho pulses per crank revolution
    """
    t = table.t
    if len(t) < 4:
        raise InputError(f"{table.source}: at least 4 rows are needed; {counted(len(t), 'row')} selected")
    signals = signals_in(table, system, pulses)
    orders_of_run, notes = orders_of(signals) if orders else None, (*table.notes, *signals.notes)
    if spectrum and len(signals.holes):
        begin, end = longest_part(signals.t, signals.holes)
        inside = (signals.t >= begin) & (signals.t <= end)
        signals = replace(signals, turns=signals.turns[inside], t=signals.t[inside], heat=signals.heat[inside])
        notes = (*notes, f"{table.source}: the spectrum is that of {begin:.6g} to {end:.6g} s, the longest part "
                 "without a hole")
    return MeasuredRun(len(t), float(t[-1] - t[0]), orders_of_run, _spectrum(signals) if spectrum else None, notes)


def _spectrum(signals: Signals) -> Spectrum:
    """Return the spectrum without the cycles that a summary drops by default, as far as enough of them are left."""
    whole, period = int(signals.turns[-1] - signals.turns[0]), _period(signals)
    return spectrum_of(signals, period, max(whole - default_discard(whole), period or SPECTRUM_LEAST))


def at_measured_speed(scene: Scene, table: MeasuredTable, pulses: int | None = None) -> tuple[Scene, Signals | None]:
    """Return the scene with the measured engine speed, and the signals in the table (None without a slip speed);
    InputError if the phase of the engine cannot be determined.
    """
    system = scene.system
    phase = measured_phase(table, system.engine.order, pulses)
    turns = phase.turns
    count = min(max(int(turns[-1] - turns[0]), 1) + 1, MOST_POINTS)
    at = np.linspace(float(turns[0]), float(turns[-1]), count)
    times = phase.when(at)
    frequency = 2.0 * np.pi * np.gradient(at, times)
    times[0] = 0.0
    system = changed(replace(system, inputs=None), {"engine.frequency_times": times.tolist(),
                                                    "engine.frequency_values": frequency.tolist()})
    signals = signals_in(table, system, pulses) if "slip_speed" in table.columns else None
    return replace(scene, system=replace(system, inputs=scene.system.inputs)), signals


def _period(signals: Signals) -> int:
    """Return the period of a measured motion in cycles of the excitation; 0 if its section does not repeat.

    The slip speed may have a shorter period at a phase where the points of a longer one coincide. The period is
    therefore the least common multiple of those at four phases.
    """
    first, last = np.ceil(signals.turns[0]), np.floor(signals.turns[-1])
    if last - first < 4:
        return 0
    numbers = np.arange(first, last + 1.0)
    within = signals.when(np.linspace(first, last, int(last - first) * 64 + 1))
    v, shaft, _ = signals.at(within)
    angle = shaft / signals.system.driveline.stiffness if np.isfinite(shaft).all() else np.zeros(len(shaft))
    rows = v[:-1].reshape(len(numbers) - 1, 64)
    periods = []
    for at in (0, 16, 32, 48):
        section = np.stack([v[at::64], angle[at::64], np.zeros(len(v[at::64]))], axis=1)
        high, low = (each[:len(section) - 1] for each in (rows.max(axis=1), rows.min(axis=1)))
        periods.append(periodicity(Cycles(section, high, low, np.zeros(len(high)))).period)
    period = math.lcm(*periods)
    return period if period <= LONGEST else 0
