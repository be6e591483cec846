"""Panels of a run: its last cycles or all of a manoeuvre, the maxima of its cycles, a controller, and a recording."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.loop.control import Control, Event, Steps
from tcc_sim.analysis.measured.orders import Spectrum
from tcc_sim.analysis.steady.summary import Summary
from tcc_sim.errors import InputError
from tcc_sim.shown_units import speed
from tcc_sim.trajectory import Cycles, Floats, Trajectory
from tcc_sim.views import style
from tcc_sim.views.order_maps import spectrum_panels
from tcc_sim.views.panels import Panel
from tcc_sim.views.style import AxisQuantity, quantities

HISTORY_CYCLES = 6
"""Engine cycles shown in the time histories."""
VARYING = 1e-3
"""Smallest relative difference between lengths of cycles for which maxima are drawn over time."""
ORBIT_CYCLES = 12
"""Engine cycles drawn in the phase portrait of a motion without period."""
FLAT = 0.02
"""Fraction of the largest slip speed below which a section point counts as stick."""
SAMPLED = ("t", "slip_speed", "plate_angle", "plate_speed", "engine_torque", "saturation_torque", "friction_torque",
           "state")
"""Columns of a run that pictures draw."""
MOST_LABELS, LONGEST_LABEL = 6, 42
"""Largest number of events that are drawn with their texts, and longest text."""
MOST_TURNS = 160
"""Largest number of turns of a pressure that is drawn as a line."""
FEW = 150
"""Largest number of samples that are drawn as dots too."""
SHARP = 20_000
"""Largest number of points of a line in a vector picture; longer lines are rasterized."""
TWIN_CYCLES = 8
"""Engine cycles of the start and of the end that a picture beside a recording shows."""
DASHED, DOTTED = (0, (4, 2)), (0, (1, 1.5))


def last_cycles(tail: Trajectory, cycles: Cycles, first_cycle: int, summary: Summary, control: Control | None = None,
                spectrum: Spectrum | None = None) -> list[Panel]:
    """Return the panels of a steady state: torques and slip speed over time with stick shaded, phase portrait with
    section, maxima per cycle.

    If a pressure or a target was recorded, panels of cycle means with the target and of pressures over the whole run
    come in the middle. A run without samples has no panels over time and no orbit in its portrait.

    tail : the end of the run
    cycles : every cycle of the run, NaN for one that was not observed
    first_cycle : number of the first of them
    control : target, pressures and events of the run
    spectrum : of slip speed and shaft torque, below the rest
    """
    orbit = max(summary.period, HISTORY_CYCLES) if summary.period else ORBIT_CYCLES
    sampled, end, alone = len(tail.t) > 2, float(tail.t[-1]), partial(_slip_alone, run=tail)
    tail = _with_gaps(_sliced(tail, _last(tail, orbit)))
    shown = _sliced(tail, _last(tail, HISTORY_CYCLES))
    controlled = control is not None and control.controlled
    marked = control.events if control is not None and not controlled else ()

    def portrait(axis: Any) -> None:
        """Draw slip speed over plate angle for the last period or some cycles, with the section.

        If most section points are in stick, they would lie on a line; then the plate speed replaces the slip speed.
        """
        part = _last(tail, summary.period or ORBIT_CYCLES)
        points = np.array(summary.section_states or []).reshape(-1, 3)
        flat = len(points) > 2 and bool(np.mean(np.abs(points[:, 1]) < FLAT * summary.max_slip_speed) > 0.5)
        height = tail.plate_speed if flat else tail.slip_speed
        if sampled:
            axis.plot(tail.plate_angle[part], height[part], color=style.BLUE, linewidth=0.9 if summary.period else 0.5,
                      **_dots(shown))
        if len(points):
            axis.plot(points[:, 0], points[:, 2 if flat else 1], linestyle="none", marker="o", color=style.RED,
                      markeredgewidth=0.0, markersize=5.0 if summary.period else 2.5, zorder=4,
                      label=f"section, period {summary.period}" if summary.period else "section, no period found")
        axis.margins(0.06)
        axis.set_xlim(style.widened(axis.get_xlim()))
        axis.locator_params(axis="x", nbins=6)
        quantities(axis, style.ANGLE, style.PLATE_SPEED if flat else style.SLIP)

    def maxima(axis: Any) -> None:
        number: NDArray[Any] = first_cycle + np.arange(len(cycles))
        largest = cycles.largest
        dropped = number < first_cycle + summary.discarded
        lengths = np.empty(0) if cycles.starts is None else np.diff(cycles.starts)
        over_time = cycles.starts is not None and (
            not summary.cycles or np.ptp(lengths) > VARYING * float(np.nanmedian(lengths)))
        if over_time and cycles.starts is not None:
            number = cycles.starts[:-1]
        size = 3.0 if len(cycles) <= 300 else 1.5
        known = largest[~dropped & np.isfinite(largest)]
        top = 1.6 * float(known.max()) if len(known) and known.max() > 0.0 else max(1.6 * summary.max_slip_speed, 1e-6)
        for chosen, colour, name in ((dropped, style.GREY, "dropped"), (~dropped, style.BLUE, "kept")):
            if chosen.any():
                above = int(np.count_nonzero(largest[chosen] > top))
                axis.plot(number[chosen], largest[chosen], linestyle="none", marker="o", markersize=size,
                          markeredgewidth=0.0, color=colour, label=f"{name} ({above} off scale)" if above else name)
        axis.axhline(summary.max_slip_speed, color=style.RED, linewidth=0.8, linestyle=DASHED, zorder=1.5)
        axis.annotate(speed(summary.max_slip_speed, 5), (0.99, summary.max_slip_speed), (0.0, 4.0), color=style.RED,
                      ha="right", xycoords=("axes fraction", "data"), textcoords="offset points", fontsize=7.5)
        axis.set_ylim(0.0, top)
        mark_events(axis, marked, end, 1.0 if over_time else tail.cycle)
        quantities(axis, style.TIME if over_time else style.PERIOD, style.MAX_SLIP)

    return [
        *([Panel("Torques", partial(_torques, run=shown), alone=alone),
           Panel("Slip speed", partial(_slip, run=shown, control=control), over=True)] if sampled else []),
        *(_control(control, end) if control is not None and controlled else []),
        Panel("Phase portrait", portrait, 2.2, alone=alone), Panel("Maxima", maxima, 2.2, beside=True),
        *([] if spectrum is None else spectrum_panels(spectrum))]


def manoeuvre(run: Trajectory, control: Control | None = None) -> list[Panel]:
    """Return the panels of a whole run: torques, slip speed, shaft torque and clutch heat over time; for a run under
    commands also the cycle mean of the slip speed with the target, and both pressures.
    """
    run, end = _with_gaps(run), float(run.t[-1])
    assert run.system is not None
    driveline, (twist, twisting) = run.system.driveline, run.shaft_twist
    power = run.friction_torque * run.slip_speed
    warmed = 0.5 * (power[1:] + power[:-1]) * np.diff(run.t)
    heat = np.append(0.0, np.cumsum(np.where(np.isfinite(warmed), warmed, 0.0)))
    heat[~np.isfinite(power)] = np.nan
    shaft = driveline.damping * twisting + driveline.stiffness * twist

    def over_time(axis: Any, values: Floats, colour: str, quantity: AxisQuantity) -> None:
        _draw_line(axis, run, values, colour)
        quantities(axis, style.TIME, quantity)

    return [Panel("Torques", partial(_torques, run=run), 1.9, alone=partial(_slip_alone, run=run)),
            Panel("Slip speed", partial(_slip, run=run, control=None), 1.9, over=True),
            *(_control(control, end, over=True) if control is not None and control.controlled else []),
            Panel("Shaft torque", partial(over_time, values=shaft, colour=style.BLUE, quantity=style.TORQUE),
                  over=True),
            Panel("Cumulative heat in the clutch",
                  partial(over_time, values=1e-3 * heat, colour=style.RED, quantity=style.HEAT), 1.3, over=True)]


def beside_recording(twin: Any) -> list[Panel]:
    """Return the panels of a simulation beside a recording (`replay.given_inputs.Twin`): start, end, and the difference
    over the whole time.
    """
    span, (begin, end) = TWIN_CYCLES * twin.trajectory.cycle, twin.t[[0, -1]]

    def both(axis: Any, low: float = -np.inf, high: float = np.inf) -> None:
        run = twin.trajectory
        for t, slip, look in ((twin.t, twin.slip_speed, {"color": style.GREY, "linewidth": 2.4, "label": "recorded"}),
                              (run.t, run.slip_speed, {"color": style.BLUE, "linewidth": 0.9, "label": "simulated"})):
            shown = (t >= low) & (t <= high)
            axis.plot(t[shown], slip[shown], **look)
        quantities(axis, style.TIME, style.SLIP)

    def difference(axis: Any) -> None:
        axis.plot(twin.t, twin.difference, color=style.RED, linewidth=0.7)
        axis.set_xlim(begin, end)
        quantities(axis, style.TIME, AxisQuantity("difference", "rad/s"))

    return [Panel("Start", partial(both, low=begin, high=min(begin + span, end)), alone=both),
            Panel("End", partial(both, low=max(end - span, begin), high=end), named=False),
            Panel("Simulated less recorded", difference)]


def _sliced(run: Trajectory, part: slice) -> Trajectory:
    """Return consecutive samples of a run."""
    columns: dict[str, Any] = {name: getattr(run, name)[part] for name in SAMPLED}
    return replace(run, **columns, flywheel_angle=None, output_angle=None, output_speed=None, cycles=None)


def _with_gaps(run: Trajectory) -> Trajectory:
    """Return a run with a sample of NaN wherever messages between two samples were lost."""
    gaps = np.flatnonzero(np.diff(run.t) > run.largest_step) + 1
    if not len(gaps):
        return run
    columns: dict[str, Any] = {name: np.insert(values, gaps, 0 if name == "state" else math.nan) for name in (
        *SAMPLED, "output_angle", "output_speed") if (values := getattr(run, name)) is not None}
    columns["t"][gaps + np.arange(len(gaps))] = 0.5 * (run.t[gaps - 1] + run.t[gaps])
    return replace(run, **columns, flywheel_angle=None)


def _slip_alone(axis: Any, run: Trajectory) -> None:
    if len(run.t) < 3:
        raise InputError("the run has no curve for an axis; it needs samples, such as samples_per_cycle=200")
    shown = _with_gaps(run)
    axis.plot(shown.t, shown.slip_speed, color=style.BLUE, linewidth=0.9)
    quantities(axis, style.TIME, style.SLIP)


def _last(tail: Trajectory, cycles: int) -> slice:
    """Return the samples of the last whole engine cycles, at most `cycles` of them."""
    end = np.floor(tail.t[-1] / tail.cycle + 1e-9) * tail.cycle
    if end <= tail.t[0]:
        return slice(0, len(tail.t))
    start, slack = max(end - cycles * tail.cycle, tail.t[0]), 1e-9 * tail.cycle
    first = int(np.searchsorted(tail.t, start + slack, side="right")) - 1
    return slice(max(first, 0), int(np.searchsorted(tail.t, end - slack)) + 1)


def _draw_line(axis: Any, run: Trajectory, values: Floats, colour: str, label: str | None = None, **look: Any) -> None:
    axis.plot(run.t, values, color=colour, label=label, rasterized=len(run.t) > SHARP,
              **{"linewidth": 0.9, **look})


def _dots(run: Trajectory) -> dict[str, Any]:
    """Return the look of the samples of a run on a line; none where there are many."""
    return {"marker": ".", "markersize": 3.0} if len(run.t) <= FEW else {}


def _torques(axis: Any, run: Trajectory) -> None:
    """Draw the torques; an input from a topic holds over the tick that ends at its sample."""
    system = run.system_at(run.t[0])
    engine, pressure = ("steps-pre" if source == "topic" else "default" for source in (
        (system.engine.source, system.pressure.source) if system is not None else ("", "")))
    _draw_line(axis, run, run.engine_torque, style.ORANGE, "engine", drawstyle=engine)
    _draw_line(axis, run, run.friction_torque, style.BLUE, "friction", **_dots(run))
    load = run.saturation_torque
    if np.isfinite(load).any():
        _draw_line(axis, run, load, style.GREY, r"$\mu_k N R$", linestyle=DASHED, drawstyle=pressure)
        ratio = run.along(lambda system: system.friction_ratio)
        if np.isfinite(ratio).any() and (ratio != 1.0).any():
            _draw_line(axis, run, ratio * load, style.GREY, r"$\mu_s N R$", linestyle=DOTTED, drawstyle=pressure)
    quantities(axis, style.TIME, style.TORQUE)
    axis.set_xlim(run.t[0], run.t[-1])


def _slip(axis: Any, run: Trajectory, control: Control | None) -> None:
    _draw_line(axis, run, run.slip_speed, style.BLUE, "slip speed", **_dots(run))
    axis.fill_between(run.t, 0.0, 1.0, where=(run.state == 0) & np.isfinite(run.slip_speed), label="stick", zorder=0,
                      transform=axis.get_xaxis_transform(), facecolor=style.STICK, edgecolor="none", linewidth=0.0,
                      rasterized=len(run.t) > SHARP)
    if control is not None:
        _target(axis, control, float(run.t[-1]))
    quantities(axis, style.TIME, style.SLIP)
    axis.set_xlim(run.t[0], run.t[-1])


def _target(axis: Any, control: Control, end: float) -> None:
    if len(control.target.t) and control.target.t[0] <= end:
        held = control.target.until(end)
        axis.step(held.t, held.values, where="post", color=style.RED, linewidth=0.9, linestyle=DASHED, label="target")


def mark_events(axis: Any, events: Sequence[Event], end: float, unit: float = 1.0, labelled: bool = True) -> None:
    """Draw a line at every event, with its text; `end` of the run, s; `unit` of the axis, s."""
    for number, event in enumerate(events):
        axis.axvline(event.t / unit, color=style.RED, linewidth=0.8, linestyle=(0, (2, 2)), zorder=0.8,
                     label="event" if number == 0 and len(events) > MOST_LABELS else None)
        if labelled and len(events) <= MOST_LABELS:
            text = event.text if len(event.text) <= LONGEST_LABEL else event.text[:LONGEST_LABEL - 3] + "..."
            late = event.t > 0.5 * end
            axis.annotate(text, (event.t / unit, 0.97 - 0.15 * (number % 3)), (-3.0 if late else 3.0, 0.0),
                          fontsize=6.5, xycoords=("data", "axes fraction"), textcoords="offset points", va="top",
                          color=style.RED, ha="right" if late else "left",
                          bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6})


def _held(axis: Any, pressure: Steps, cycles: Floats, **look: Any) -> None:
    """Draw a pressure that is held; where it turns more often than a picture can resolve, its range in each cycle."""
    t, values = pressure.t, 1e-3 * pressure.values
    if np.count_nonzero(np.diff(np.sign(np.diff(values)))) <= MOST_TURNS or not len(cycles):
        axis.step(t, values, where="post", **look)
        return
    edges = np.unique([t[0], *cycles[(cycles > t[0]) & (cycles < t[-1])], t[-1]])
    first = np.searchsorted(t, edges, side="right") - 1
    low, high = (fold(fold.reduceat(values, first[:-1]), values[first[1:]]) for fold in (np.fmin, np.fmax))
    axis.fill_between(edges, np.append(low, low[-1]), np.append(high, high[-1]), facecolor=(look["color"], 0.2),
                      edgecolor=look["color"], linewidth=look["linewidth"], label=f"{look['label']}, range in a cycle")


def _control(control: Control, end: float, over: bool = False) -> list[Panel]:
    def means(axis: Any) -> None:
        axis.plot(control.t, control.mean_slip, color=style.BLUE, linewidth=0.9, marker="o", markersize=2.0,
                  markeredgewidth=0.0, label="cycle mean")
        _target(axis, control, end)
        axis.set_ylim(style.widened(axis.get_ylim()))
        mark_events(axis, control.events, end)
        quantities(axis, style.TIME, style.SLIP)

    def pressures(axis: Any) -> None:
        for steps, colour, width, name in ((control.applied, style.GREEN, 1.6, "applied"),
                                           (control.command, style.ORANGE, 0.8, "commanded")):
            if len(steps.t):
                _held(axis, steps.until(end), control.t, color=colour, linewidth=width, label=name)
        mark_events(axis, control.events, end, labelled=False)
        axis.set_ylim(style.widened(axis.get_ylim()))
        begin = min([float(steps.t[0]) for steps in (control.command, control.applied) if len(steps.t)], default=0.0)
        if end > begin:
            axis.set_xlim(begin, end)
        quantities(axis, style.TIME, AxisQuantity("pressure", "kPa"))

    return [Panel("Cycle mean of the slip speed", means, 1.45, over=over),
            Panel("Actuation pressure", pressures, 1.45, over=True)]
