"""Phase of the excitation in a table of measurements: from engine speed, tacho pulses, or the engine torque."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.analysis.torque_phase import PhaseTracker
from tcc_sim.errors import InputError
from tcc_sim.tables.chosen_columns import REFERENCES
from tcc_sim.tables.measured_table import MeasuredTable
from tcc_sim.tables.sampling import Spans
from tcc_sim.trajectory import Floats, integral


@dataclass(frozen=True)
class MeasuredPhase:
    """Periods of the excitation passed, known at some times.

    turns, times : (m,) ascending, s
    holes : (k, 2) stretches of time across which the number of periods is not certain, s
    notes : sentences on what was mended
    """

    turns: Floats
    times: Floats
    holes: Spans
    notes: tuple[str, ...] = ()

    @property
    def when(self) -> Callable[[Floats], Floats]:
        """Function from periods of the excitation to times, s."""
        return lambda turns: np.interp(turns, self.turns, self.times)


def measured_phase(table: MeasuredTable, order: float = 1.0, pulses: int = 1) -> MeasuredPhase:
    """Return the phase of the excitation in a table, from the first of these columns.

    engine_speed : of the crankshaft, rad/s, with `order` periods of the excitation in a revolution
    tacho : signal with `pulses` rising edges in a revolution, at the middle of its range
    engine_torque : its strongest line is the excitation

    Raises
    ------
    InputError
        None of these columns, or one without rotation.
    """
    source, there = table.source, [name for name in (*REFERENCES, "engine_torque") if name in table.columns]
    if not there:
        raise InputError(f"{source}: orders need one of the columns {', '.join(REFERENCES)}, engine_torque, which tell "
                         "the phase of the excitation")
    t, values = table.filled(there[0])
    if there[0] == "engine_speed":
        if values.min() <= 0.0:
            raise InputError(f"{source}: engine_speed is {values.min():g} rad/s; it must be above 0")
        turns, times = integral(values, t) * order / (2.0 * math.pi), t
    elif there[0] == "tacho":
        level = values - 0.5 * (values.min() + values.max())
        edges = np.flatnonzero((level[:-1] < 0.0) & (level[1:] >= 0.0))
        if len(edges) < 2:
            raise InputError(f"{source}: the column tacho has {len(edges)} rising edges; it must have 2 or more")
        times = t[edges] + (t[edges + 1] - t[edges]) * level[edges] / (level[edges] - level[edges + 1])
        turns = np.arange(len(times)) * order / pulses
    else:
        tracker = PhaseTracker()
        tracker.feed(np.rint(t * 1e9).astype(np.int64), values)
        found = tracker.runs()[0]
        if len(found.starts) < 2:
            raise InputError(f"{source}: the engine torque shows no excitation of which periods could be counted"
                             + (f" ({found.why})" if found.why else "") + f"; add the column {' or '.join(REFERENCES)}")
        turns, times = found.numbers.astype(np.float64), found.starts
    return MeasuredPhase(turns, times, long_holes(table.holes(there[0]), turns, times))


def long_holes(holes: Spans, turns: Floats, times: Floats) -> Spans:
    """Return the holes longer than `Settings.bridged_hole`, and those that the phase does not cover."""
    begin, end = (np.interp(holes[:, k], times, turns) for k in (0, 1))
    inside = (holes[:, 0] >= times[0]) & (holes[:, 1] <= times[-1])
    return np.asarray(holes[(end - begin > DEFAULTS.bridged_hole) | ~inside])
