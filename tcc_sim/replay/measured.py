"""Orders and spectrum of a table of measurements."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tcc_sim.analysis.orders import Orders, orders_of
from tcc_sim.analysis.periodicity import periodicity
from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.analysis.signals import Signals, measured_phase, measured_signals
from tcc_sim.analysis.spectra import Spectrum, spectrum_of
from tcc_sim.analysis.summary import default_discard
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System
from tcc_sim.model.parameters import replace as changed
from tcc_sim.model.quantity import MOST_POINTS
from tcc_sim.recording.table import TIME, read_columns
from tcc_sim.result import Result, reported
from tcc_sim.scene import Scene
from tcc_sim.trajectory import Cycles, Floats


@dataclass(frozen=True, repr=False)
class MeasuredRun(Result):
    """Orders and spectrum of measurements."""

    samples: int = field(metadata=reported("number of rows of the table"))
    seconds: float = field(metadata=reported("time from the first to the last row", "s"))
    orders: Orders | None = field(default=None, metadata=reported(
        "orders, transmissibility and judder", asked_for=True))
    spectrum: Spectrum | None = field(default=None, metadata=reported(
        "amplitudes over frequency and order", asked_for=True))

    def columns(self) -> dict[str, Floats]:
        """Return the columns of the orders or, without these, of the spectrum."""
        found = self.orders or self.spectrum
        return dict(found.columns()) if found is not None else {}


def measured_columns(path: Path, start: float | None = None, end: float | None = None) -> dict[str, Floats]:
    """Return the columns of a table with a slip speed, optionally between two times, s.

    Raises
    ------
    InputError
        As `recording.table.read_columns`; or the times do not increase, or fewer than four rows are selected.
    """
    columns = read_columns(path, (TIME, "slip_speed"))
    t = columns[TIME]
    within = (t >= (-np.inf if start is None else start)) & (t <= (np.inf if end is None else end))
    if np.count_nonzero(within) < 4 or not np.all(np.diff(t) > 0.0):
        raise InputError(f"{path}: the times in column t must increase, and at least 4 rows are needed; "
                         f"{np.count_nonzero(within)} are selected")
    return {name: values[within] for name, values in columns.items()}


def analyse_table(path: Path, system: System, *, orders: bool, spectrum: bool, pulses: int = 1,
                  start: float | None = None, end: float | None = None) -> MeasuredRun:
    """Return orders and spectrum of a table.

    Parameters
    ----------
    system : system whose shaft, modes and `engine.order` are used
    pulses : number of tacho pulses per crank revolution

    Raises
    ------
    InputError
        As `measured_columns`, `analysis.signals.measured_signals`, `orders_of` and `spectrum_of`.
    """
    columns = measured_columns(path, start, end)
    signals, t = measured_signals(columns, system, pulses, str(path)), columns[TIME]
    return MeasuredRun(len(t), float(t[-1] - t[0]), orders_of(signals) if orders else None,
                       _spectrum(signals) if spectrum else None)


def _spectrum(signals: Signals) -> Spectrum:
    """Return the spectrum without the cycles that a summary drops by default, as far as enough of them are left."""
    whole, period = int(signals.turns[-1] - signals.turns[0]), _period(signals)
    return spectrum_of(signals, period, max(whole - default_discard(whole), period or DEFAULTS.spectrum_least))


def at_measured_speed(scene: Scene, path: Path, pulses: int = 1) -> tuple[Scene, Signals | None]:
    """Return the scene with the measured engine speed, and the signals in the table (None without a slip speed).

    Raises
    ------
    InputError
        The phase of the engine cannot be determined.
    """
    columns = read_columns(path, (TIME,))
    system = scene.system
    turns, when = measured_phase(columns, system.engine.order, pulses, str(path))
    count = min(max(int(turns[-1] - turns[0]), 1) + 1, MOST_POINTS)
    at = np.linspace(float(turns[0]), float(turns[-1]), count)
    times = when(at)
    frequency = 2.0 * np.pi * np.gradient(at, times)
    times[0] = 0.0
    system = changed(replace(system, inputs=None), {"engine.frequency_times": times.tolist(),
                                                    "engine.frequency_values": frequency.tolist()})
    found = measured_signals(columns, system, pulses, str(path)) if "slip_speed" in columns else None
    return replace(scene, system=replace(system, inputs=scene.system.inputs)), found


def _period(signals: Signals) -> int:
    """Return the period of a measured motion in cycles of the excitation; 0 if its section does not repeat."""
    first, last = np.ceil(signals.turns[0]), np.floor(signals.turns[-1])
    if last - first < 4:
        return 0
    numbers = np.arange(first, last + 1.0)
    within = signals.when(np.linspace(first, last, int(last - first) * 64 + 1))
    v, shaft, _ = signals.at(within)
    angle = np.nan_to_num(shaft) / signals.system.driveline.stiffness
    rows = v[:-1].reshape(len(numbers) - 1, 64)
    section = np.stack([v[::64], angle[::64], np.zeros(len(numbers))], axis=1)
    return periodicity(Cycles(section, rows.max(axis=1), rows.min(axis=1), np.zeros(len(rows)))).period
