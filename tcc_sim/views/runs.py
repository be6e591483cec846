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
from tcc_sim.trajectory import SAMPLED, Cycles, Floats, Trajectory
from tcc_sim.views import style
from tcc_sim.views.order_maps import spectrum_panels
from tcc_sim.views.panels import Panel
from tcc_sim.views.style import AxisQuantity
from tcc_sim.views.sweeps import DOTS

HISTORY_CYCLES = 6
"""Engine cycles shown in the time histories."""
VARYING = 1e-3
"""Smallest relative difference between lengths of cycles for which maxima are drawn over time."""
ORBIT_CYCLES = 12
"""Engine cycles drawn in the phase portrait of a motion without period."""
FLAT = 0.02
"""Fraction of the largest slip speed below which a section point counts as stick."""
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
NO_CONTROL = Control(np.empty(0), np.empty(0))


def last_cycles(tail: Trajectory, cycles: Cycles, first_cycle: int, summary: Summary, control: Control = NO_CONTROL,
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
    sampled, end, alone = len(tail.t) > 2, float(tail.t[-1]), _slip_alone(tail)
    tail = _with_gaps(_last(tail, orbit))
    shown = _last(tail, HISTORY_CYCLES)
    points = np.array(summary.section_states or []).reshape(-1, 3)
    flat = len(points) > 2 and bool(np.mean(np.abs(points[:, 1]) < FLAT * summary.max_slip_speed) > 0.5)
    number: NDArray[Any] = np.arange(len(cycles))
    dropped, over, unit = number < summary.discarded, style.PERIOD, tail.cycle
    number = first_cycle + number
    if cycles.starts is not None and (not summary.cycles or np.ptp(lengths := np.diff(cycles.starts))
                                      > VARYING * float(np.nanmedian(lengths))):
        number, over, unit = cycles.starts[:-1], style.TIME, 1.0

    def portrait(axis: Any) -> None:
        """Draw slip speed over plate angle for the last period or some cycles, with the section.

        If most section points are in stick, they would lie on a line; then the plate speed replaces the slip speed.
        """
        if sampled:
            last = _last(tail, summary.period or ORBIT_CYCLES)
            axis.plot(last.plate_angle, last.plate_speed if flat else last.slip_speed, color=style.BLUE,
                      linewidth=0.9 if summary.period else 0.5, **_dots(shown))
        if len(points):
            axis.plot(points[:, 0], points[:, 2 if flat else 1], **DOTS, color=style.RED, zorder=4,
                      markersize=5.0 if summary.period else 2.5,
                      label=f"section, period {summary.period}" if summary.period else "section, no period found")
        axis.margins(0.06)
        axis.set_xlim(style.widened(axis.get_xlim()))
        axis.locator_params(axis="x", nbins=6)

    def maxima(axis: Any) -> None:
        largest = cycles.largest
        known = largest[~dropped & np.isfinite(largest)]
        top = 1.6 * float(known.max()) if len(known) and known.max() > 0.0 else max(1.6 * summary.max_slip_speed, 1e-6)
        for chosen, colour, name in ((dropped, style.GREY, "dropped"), (~dropped, style.BLUE, "kept")):
            if chosen.any():
                above = int(np.count_nonzero(largest[chosen] > top))
                axis.plot(number[chosen], largest[chosen], **DOTS, markersize=3.0 if len(cycles) <= 300 else 1.5,
                          color=colour, label=f"{name} ({above} off scale)" if above else name)
        axis.axhline(summary.max_slip_speed, color=style.RED, linewidth=0.8, linestyle=DASHED, zorder=1.5)
        axis.annotate(speed(summary.max_slip_speed, 5), (0.99, summary.max_slip_speed), (0.0, 4.0), color=style.RED,
                      ha="right", xycoords=("axes fraction", "data"), textcoords="offset points", fontsize=7.5)
        axis.set_ylim(0.0, top)
        mark_events(axis, () if control.controlled else control.events, end, unit)

    return [*(_inputs_and_slip(shown, alone, 1.6, control.target) if sampled else []), *_control(control, end),
            Panel("Phase portrait", portrait, 2.2, style.ANGLE, style.PLATE_SPEED if flat else style.SLIP, alone=alone),
            Panel("Maxima", maxima, 2.2, over, style.MAX_SLIP, beside=True),
            *([] if spectrum is None else spectrum_panels(spectrum))]


def manoeuvre(run: Trajectory, control: Control = NO_CONTROL) -> list[Panel]:
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
    return [*_inputs_and_slip(run, _slip_alone(run), 1.9), *_control(control, end, over=True),
            *(Panel(title, partial(_draw_line, run=run, values=values, colour=colour), height, style.TIME, quantity,
                    over=True)
              for title, values, colour, height, quantity in (
                  ("Shaft torque", shaft, style.BLUE, 1.6, style.TORQUE),
                  ("Cumulative heat in the clutch", 1e-3 * heat, style.RED, 1.3, style.HEAT)))]


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

    def difference(axis: Any) -> None:
        axis.plot(twin.t, twin.difference, color=style.RED, linewidth=0.7)
        axis.set_xlim(begin, end)

    whole = Panel("Start", both, x=style.TIME, y=style.SLIP)
    return [whole._replace(draw=partial(both, low=begin, high=min(begin + span, end)), alone=whole),
            whole._replace(title="End", draw=partial(both, low=max(end - span, begin), high=end), named=False),
            Panel("Simulated less recorded", difference, x=style.TIME, y=AxisQuantity("difference", "rad/s"))]


def _with_gaps(run: Trajectory) -> Trajectory:
    """Return a run with a sample of NaN wherever messages between two samples were lost."""
    gaps = np.flatnonzero(np.diff(run.t) > run.largest_step) + 1
    if not len(gaps):
        return run
    columns: dict[str, Any] = {name: np.insert(values, gaps, 0 if name == "state" else math.nan)
                               for name in SAMPLED if (values := getattr(run, name)) is not None}
    columns["t"][gaps + np.arange(len(gaps))] = 0.5 * (run.t[gaps - 1] + run.t[gaps])
    return replace(run, **columns, flywheel_angle=None)


def _last(run: Trajectory, cycles: int) -> Trajectory:
    """Return a run with the samples of its last whole engine cycles, at most `cycles` of them."""
    end = np.floor(run.t[-1] / run.cycle + 1e-9) * run.cycle
    if end <= run.t[0]:
        return run
    start, slack = max(end - cycles * run.cycle, run.t[0]), 1e-9 * run.cycle
    first = int(np.searchsorted(run.t, start + slack, side="right")) - 1
    part = slice(max(first, 0), int(np.searchsorted(run.t, end - slack)) + 1)
    columns: dict[str, Any] = {name: values[part] for name in SAMPLED if (values := getattr(run, name)) is not None}
    return replace(run, **columns, flywheel_angle=None)


def _slip_alone(run: Trajectory) -> Panel:
    """Return the slip speed over time for an axis of another figure."""
    def draw(axis: Any) -> None:
        if len(run.t) < 3:
            raise InputError("the run has no curve for an axis; it needs samples, such as samples_per_cycle=200")
        shown = _with_gaps(run)
        axis.plot(shown.t, shown.slip_speed, color=style.BLUE, linewidth=0.9)

    return Panel("", draw, x=style.TIME, y=style.SLIP)


def _draw_line(axis: Any, run: Trajectory, values: Floats, colour: str, label: str | None = None, **look: Any) -> None:
    axis.plot(run.t, values, color=colour, label=label, rasterized=len(run.t) > SHARP,
              **{"linewidth": 0.9, **look})


def _dots(run: Trajectory) -> dict[str, Any]:
    """Return the look of the samples of a run on a line; none where there are many."""
    return {"marker": ".", "markersize": 3.0} if len(run.t) <= FEW else {}


def _inputs_and_slip(run: Trajectory, alone: Panel, height: float, target: Steps = NO_CONTROL.target) -> list[Panel]:
    """Return the torques and the slip speed, with stick shaded, over time."""
    def torques(axis: Any) -> None:
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
        axis.set_xlim(run.t[0], run.t[-1])

    def slip(axis: Any) -> None:
        _draw_line(axis, run, run.slip_speed, style.BLUE, "slip speed", **_dots(run))
        axis.fill_between(run.t, 0.0, 1.0, where=(run.state == 0) & np.isfinite(run.slip_speed), label="stick",
                          zorder=0, transform=axis.get_xaxis_transform(), facecolor=style.STICK, edgecolor="none",
                          linewidth=0.0, rasterized=len(run.t) > SHARP)
        _target(axis, target, float(run.t[-1]))
        axis.set_xlim(run.t[0], run.t[-1])

    return [Panel("Torques", torques, height, style.TIME, style.TORQUE, alone=alone),
            Panel("Slip speed", slip, height, style.TIME, style.SLIP, over=True)]


def _target(axis: Any, target: Steps, end: float) -> None:
    if len(target.t) and target.t[0] <= end:
        held = target.until(end)
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
    """Return the cycle means of the slip speed and the pressures over a controlled run."""
    def means(axis: Any) -> None:
        axis.plot(control.t, control.mean_slip, color=style.BLUE, linewidth=0.9, marker="o", markersize=2.0,
                  markeredgewidth=0.0, label="cycle mean")
        _target(axis, control.target, end)
        axis.set_ylim(style.widened(axis.get_ylim()))
        mark_events(axis, control.events, end)

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

    return [Panel("Cycle mean of the slip speed", means, 1.45, style.TIME, style.SLIP, over=over),
            Panel("Actuation pressure", pressures, 1.45, style.TIME, AxisQuantity("pressure", "kPa"), over=True)
            ] if control.controlled else []
