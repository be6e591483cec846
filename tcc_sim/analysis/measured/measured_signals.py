"""Signals in a table of measurements, interpolated within the stretches that it covers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tcc_sim.analysis.measured.measured_phase import MeasuredPhase, long_holes, measured_phase
from tcc_sim.analysis.measured.signals import Signals, driven_orders
from tcc_sim.errors import InputError, counted
from tcc_sim.model.parameters import System
from tcc_sim.tables.measured_table import MeasuredTable
from tcc_sim.tables.sampling import Spans, in_words, merged
from tcc_sim.topics import FAR_END
from tcc_sim.trajectory import Floats, integral


def signals_in(table: MeasuredTable, system: System, pulses: int | None = None) -> Signals:
    """Return the signals in a table with a slip speed.

    The shaft torque is that of plate_angle and plate_speed, minus output_angle and output_speed if the far end moved.
    Holes of a sixteenth of a period of the excitation or less are bridged by cubics; longer ones are holes of the
    signals.

    Parameters
    ----------
    system : stiffness and damping of the shaft, and `engine.order`
    pulses : of the tacho in a crank revolution

    Raises
    ------
    InputError
        The phase is unknown, or the slip speed has too few values.
    """
    phase = measured_phase(table, system.engine.order, pulses)
    t, slip = table.filled("slip_speed")
    if len(t) < 4:
        raise InputError(f"{table.source}: the column slip_speed has {counted(len(t), 'value')}; 4 or more are needed")
    slip_holes = table.holes("slip_speed")
    holes = long_holes(slip_holes, phase.turns, phase.times)
    short = slip_holes[~np.isin(slip_holes[:, 0], holes[:, 0])]
    notes = [] if not len(short) else [
        f"{table.source}: {counted(len(short), 'hole')} of at most {np.diff(short).max():.3g} s, a sixteenth of a "
        "period of the excitation or less, bridged by cubics"]
    blank = merged(np.concatenate([holes, phase.holes]))
    if len(blank):
        notes.append(f"{table.source}: no slip speed or no phase from {in_words(blank)}; windows that touch "
                     f"{'this hole' if len(blank) == 1 else 'these holes'} are left blank")
    torque = _curve(table, "engine_torque", phase)
    shaft = _shaft_torque(table, system, phase)
    v = _within(_cubic(t, slip), holes)

    def at(times: Floats) -> tuple[Floats, Floats, Floats]:
        """Cubic splines through the samples, NaN in holes."""
        return v(times), shaft(times), torque(times)

    turns = np.interp(t, phase.times, phase.turns)
    inside = (t >= phase.times[0]) & (t <= phase.times[-1])
    if np.count_nonzero(inside) < 4:
        raise InputError(f"{table.source}: the phase of the excitation is known from {phase.times[0]:.6g} to "
                         f"{phase.times[-1]:.6g} s only, where there is no slip speed")
    return Signals(system, turns[inside], phase.when, at,
                   None if "engine_torque" in table.columns else driven_orders(system), None, t[inside],
                   np.full(np.count_nonzero(inside), np.nan), blank,
                   (*notes, *phase.notes), splined=True)


def _cubic(t: Floats, values: Floats, order: int = 0) -> Callable[[Floats], Floats]:
    """Return the cubic spline through samples, or its derivative of an order."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(t, values)
    return lambda times: np.asarray(spline(times, order))


def _within(curve: Callable[[Floats], Floats], holes: Spans) -> Callable[[Floats], Floats]:
    """Return a curve that is NaN in holes."""
    def at(times: Floats) -> Floats:
        values = curve(times)
        place = np.searchsorted(holes[:, 0], times, side="right") - 1
        if len(holes):
            values = np.where((place >= 0) & (times < holes[place, 1]), np.nan, values)
        return values

    return at


def _nothing_known(times: Floats) -> Floats:
    return np.full(len(times), np.nan)


def _curve(table: MeasuredTable, name: str, phase: MeasuredPhase) -> Callable[[Floats], Floats]:
    """Return a column as a curve, NaN in its holes; NaN throughout if it is not there."""
    if name not in table.columns:
        return _nothing_known
    t, values = table.filled(name)
    holes = long_holes(table.holes(name), phase.turns, phase.times)
    return _nothing_known if len(t) < 4 else _within(_cubic(t, values), holes)


def _shaft_torque(table: MeasuredTable, system: System, phase: MeasuredPhase) -> Callable[[Floats], Floats]:
    """Return the shaft torque as a curve, NaN where the plate's angle is unknown."""
    names = [name for name in ("plate_angle", "plate_speed", FAR_END, "output_angle") if name in table.columns]
    complete = np.all([np.isfinite(table.columns[name]) for name in ("t", *names)], axis=0)
    if "plate_angle" not in names or np.count_nonzero(complete) < 4:
        return _nothing_known
    t, d = table.t[complete], system.driveline
    columns = {name: table.columns[name][complete] for name in names}
    angle = columns["plate_angle"]
    speed = columns["plate_speed"] if "plate_speed" in columns else _cubic(t, angle, 1)(t)
    if FAR_END in columns:
        speed = speed - columns[FAR_END]
        angle = angle - (columns["output_angle"] if "output_angle" in columns else integral(columns[FAR_END], t))
    holes = long_holes(table.holes(*names), phase.turns, phase.times)
    return _within(_cubic(t, d.damping * speed + d.stiffness * angle), holes)
