"""Overview of a run in one picture: its last cycles and the maxima of all cycles; for a test of a controller also cycle
means beside the target, pressures and events of the whole run.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.control import Control, Event
from tcc_sim.analysis.spectra import Spectrum
from tcc_sim.analysis.summary import Summary
from tcc_sim.shown_units import speed
from tcc_sim.trajectory import Cycles, Trajectory
from tcc_sim.views import style
from tcc_sim.views.dense import between, sliced, stuck_in
from tcc_sim.views.order_maps import spectrum_panels

HISTORY_CYCLES = 6
"""Engine cycles shown in the time histories."""
VARYING = 1e-3
"""Smallest relative difference between lengths of cycles for which maxima are drawn over time."""
ORBIT_CYCLES = 12
"""Engine cycles drawn in the phase portrait of a motion without period."""
FLAT = 0.02
"""Fraction of the largest slip speed below which a section point counts as stick."""
MOST_INTERVALS, COLUMNS = 80, 480
"""Largest number of intervals in stick that are shaded one by one, and number of columns that are shaded otherwise."""
MOST_LABELS = 6
"""Largest number of events that are drawn with their texts."""
LONGEST_LABEL = 42


def overview(path: Path, tail: Trajectory, cycles: Cycles, first_cycle: int, summary: Summary, title: str = "", *,
             control: Control | None = None, width: str = "page", spectrum: Spectrum | None = None) -> Path:
    """Draw a run: torques and slip speed over time with stick shaded, phase portrait with section, maxima per cycle.

    If a pressure or a target was recorded, panels of cycle means with the target and of pressures over the whole run
    come in the middle. A run without samples has no panels over time and no orbit in its portrait. Samples that are too
    far apart for a curve get points in between (`views.dense`).

    Parameters
    ----------
    path : png, svg or pdf file
    tail : the end of the run
    cycles : every cycle of the run, NaN for one that was not observed
    first_cycle : number of the first of them
    summary : the figures of the steady state
    title : name of the scene or recording
    control : target, pressures and events of the run
    width : column or page
    spectrum : of slip speed and shaft torque, below the rest

    Raises
    ------
    MissingPackage
        matplotlib is not installed.
    InputError
        Another width or suffix.
    """
    orbit = max(summary.period, HISTORY_CYCLES) if summary.period else ORBIT_CYCLES
    sampled, end = len(tail.t) > 2, float(tail.t[-1])
    tail = between(sliced(tail, _last(tail, orbit)))
    controlled = control is not None and control.controlled
    wide = style.width_of(width) == style.PAGE
    heights = [*([1.0, 1.0] * sampled), *([0.9, 0.9] * controlled), *([1.35] if wide else [1.5, 1.35])]
    last = len(heights) - 1
    heights += [] if spectrum is None else [1.35] if wide else [1.35, 1.35]
    with style.figure(style.width_of(width), 1.612 * sum(heights), title) as drawn:
        grid = drawn.add_gridspec(len(heights), 2, height_ratios=heights)
        panels, titles = [], []
        if sampled:
            torques = drawn.add_subplot(grid[0, :])
            slip = drawn.add_subplot(grid[1, :], sharex=torques)
            _histories(torques, slip, tail, control)
            panels, titles = [torques, slip], ["Torques", "Slip speed"]
        if control is not None and controlled:
            means = drawn.add_subplot(grid[len(panels), :])
            pressure = drawn.add_subplot(grid[len(panels) + 1, :], sharex=means)
            mean_slip_panel(means, control, end)
            pressure_panel(pressure, control, end)
            panels += [means, pressure]
            titles += ["Cycle mean", "Actuation pressure"]
        phase = drawn.add_subplot(grid[last, 0] if wide else grid[last - 1, :])
        maxima = drawn.add_subplot(grid[last, 1] if wide else grid[last, :])
        _phase_portrait(phase, tail, summary, sampled)
        unit = draw_cycle_maxima(maxima, cycles, first_cycle, summary, tail.cycle)
        if control is not None and not controlled:
            mark_events(maxima, control.events, end, unit)
        panels += [phase, maxima]
        titles += ["Phase portrait", "Maxima"]
        if spectrum is not None:
            below = [drawn.add_subplot(grid[-1, k] if wide else grid[k - 2, :]) for k in (0, 1)]
            spectrum_panels(below, spectrum)
            panels += below
            titles += ["Spectrum of the slip speed", "Spectrum of the shaft torque"]
        style.panel_titles(panels, titles)
        return style.save(drawn, path)


def _last(tail: Trajectory, cycles: int) -> slice:
    """Return the samples of the last whole engine cycles, at most `cycles` of them."""
    end = np.floor(tail.t[-1] / tail.cycle + 1e-9) * tail.cycle
    if end <= tail.t[0]:
        return slice(0, len(tail.t))
    start = max(end - cycles * tail.cycle, tail.t[0])
    slack = 1e-9 * tail.cycle
    first = int(np.searchsorted(tail.t, start + slack, side="right")) - 1
    return slice(max(first, 0), int(np.searchsorted(tail.t, end - slack)) + 1)


def _histories(torques: Any, slip: Any, tail: Trajectory, control: Control | None) -> None:
    """Draw torques and slip speed over the last cycles."""
    part = _last(tail, HISTORY_CYCLES)
    t = tail.t[part]
    torques.plot(t, tail.engine_torque[part], color=style.ORANGE, label="engine")
    torques.plot(t, tail.friction_torque[part], color=style.BLUE, label="friction")
    load = tail.saturation_torque[part]
    if np.isfinite(load).any():
        ratio = tail.system.friction_ratio if tail.system is not None else 1.0
        torques.plot(t, load, color=style.GREY, linestyle=(0, (4, 2)), linewidth=0.9, label=r"$\mu_k N R$")
        if ratio != 1.0:
            torques.plot(t, ratio * load, color=style.GREY, linestyle=(0, (1, 1.5)), linewidth=0.9,
                         label=r"$\mu_s N R$")
    torques.set_ylabel("torque (N m)")
    torques.tick_params(labelbottom=False)
    style.legend_above(torques)
    slip.plot(t, tail.slip_speed[part], color=style.BLUE, label="slip speed")
    shaded = shade_stick(slip, t, stuck_in(tail)[part])
    target = control.target if control is not None else None
    if target is not None and len(target.t) and target.t[0] <= t[-1]:
        held = target.until(float(t[-1]))
        slip.step(held.t, held.values, where="post", color=style.RED, linewidth=0.9, linestyle=(0, (4, 2)),
                  label="target")
    if shaded or len(style.entries(slip)[0]) > 1:
        style.legend_above(slip)
    slip.set(ylabel="slip speed (rad/s)", xlabel="time (s)")
    if len(t) > 1:
        slip.set_xlim(t[0], t[-1])


def shade_stick(axis: Any, t: NDArray[np.float64], stuck: NDArray[np.bool_]) -> bool:
    """Shade the intervals in stick, between successive samples that stick, and return whether there are any.

    Where there are more of them than a picture can resolve, each of COLUMNS columns is shaded by its share of stick.
    """
    edges = np.diff(np.concatenate([[0], stuck.astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    if len(starts) > MOST_INTERVALS:
        _shade_shares(axis, np.linspace(t[0], t[-1], COLUMNS + 1), t, stuck)
        return True
    for number, (start, end) in enumerate(zip(starts.tolist(), ends.tolist())):
        axis.axvspan(t[start], t[end], facecolor=style.STICK, edgecolor="none", zorder=0,
                     label="stick" if number == 0 else None)
    return len(starts) > 0


def _shade_shares(axis: Any, edges: NDArray[np.float64], t: NDArray[np.float64], stuck: NDArray[np.bool_]) -> None:
    """Shade the columns between edges, s, by the share of the samples' intervals in stick."""
    from matplotlib.collections import QuadMesh
    from matplotlib.colors import LinearSegmentedColormap

    since = np.concatenate([[0.0], np.cumsum(np.diff(t) * (stuck[:-1] & stuck[1:]))])
    share = np.diff(np.interp(edges, t, since)) / np.diff(edges)
    corners = np.stack(np.meshgrid(edges, [0.0, 1.0]), axis=-1)
    shades = LinearSegmentedColormap.from_list("stick", ["white", style.STICK_SHARE])
    mesh = QuadMesh(corners, array=share[None, :], cmap=shades, rasterized=True, zorder=0,
                    transform=axis.get_xaxis_transform())
    mesh.set_clim(0.0, 1.0)
    axis.add_collection(mesh, autolim=False)
    style.key(axis, "stick (shade: share)", linestyle="none", marker="s", markersize=6.0, markeredgewidth=0.0,
              color=style.STICK_SHARE)


def _phase_portrait(axis: Any, tail: Trajectory, summary: Summary, sampled: bool) -> None:
    """Draw slip speed over plate angle for the last period or some cycles, with the section.

    If most section points are in stick, they would lie on a line; then the plate speed replaces the slip speed.
    """
    part = _last(tail, summary.period or ORBIT_CYCLES)
    points = np.array(summary.section_states or []).reshape(-1, 3)
    flat = len(points) > 2 and bool(np.mean(np.abs(points[:, 1]) < FLAT * summary.max_slip_speed) > 0.5)
    height = tail.plate_speed if flat else tail.slip_speed
    if sampled:
        axis.plot(tail.plate_angle[part], height[part], color=style.BLUE, linewidth=0.9 if summary.period else 0.5)
    if len(points):
        axis.plot(points[:, 0], points[:, 2 if flat else 1], linestyle="none", marker="o", color=style.RED,
                  markeredgewidth=0.0, markersize=5.0 if summary.period else 2.5, zorder=4,
                  label=f"section, period {summary.period}" if summary.period else "section, no period found")
    axis.set(xlabel="plate angle (rad)", ylabel=f"{'plate' if flat else 'slip'} speed (rad/s)")
    axis.margins(0.06)
    axis.set_xlim(style.widened(axis.get_xlim()))
    axis.locator_params(axis="x", nbins=6)
    style.legend_above(axis)


def draw_cycle_maxima(axis: Any, cycles: Cycles, first_cycle: int, summary: Summary, cycle: float) -> float:
    """Draw the largest slip speed of each cycle, and return the unit of the axis, s; cycles that the summary drops are
    grey.
    """
    number: NDArray[Any] = first_cycle + np.arange(len(cycles))
    largest = cycles.largest
    dropped = number < first_cycle + summary.discarded
    over_time = cycles.starts is not None and (not summary.cycles or np.ptp(np.diff(cycles.starts)) > VARYING * float(
        np.nanmedian(np.diff(cycles.starts))))
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
    axis.axhline(summary.max_slip_speed, color=style.RED, linewidth=0.8, linestyle=(0, (4, 2)), zorder=1.5)
    axis.annotate(speed(summary.max_slip_speed, 5), (0.99, summary.max_slip_speed), (0.0, 4.0), color=style.RED,
                  ha="right", xycoords=("axes fraction", "data"), textcoords="offset points", fontsize=7.5)
    axis.set(xlabel="time (s)" if over_time else "period of excitation", ylabel="max |slip speed| (rad/s)",
             ylim=(0.0, top))
    style.legend_above(axis)
    return 1.0 if over_time else cycle


def mean_slip_panel(axis: Any, control: Control, end: float) -> None:
    """Draw the mean slip speed of every engine cycle, and the target up to the `end` of the run, s."""
    axis.plot(control.t, control.mean_slip, color=style.BLUE, linewidth=0.9, marker="o", markersize=2.0,
              markeredgewidth=0.0, label="cycle mean")
    if len(control.target.t):
        held = control.target.until(end)
        axis.step(held.t, held.values, where="post", color=style.RED, linewidth=0.9, linestyle=(0, (4, 2)),
                  label="target")
    axis.set(ylabel="slip speed (rad/s)", ylim=style.widened(axis.get_ylim()))
    axis.tick_params(labelbottom=False)
    mark_events(axis, control.events, end)
    style.legend_above(axis)


def pressure_panel(axis: Any, control: Control, end: float) -> None:
    """Draw commanded and applied pressure, kPa, up to the `end` of the run, s."""
    for steps, colour, width, name in ((control.applied, style.GREEN, 1.6, "applied"),
                                       (control.command, style.ORANGE, 0.8, "commanded")):
        if len(steps.t):
            held = steps.until(end)
            axis.step(held.t, 1e-3 * held.values, where="post", color=colour, linewidth=width, label=name)
    mark_events(axis, control.events, end, labelled=False)
    axis.set(ylabel="pressure (kPa)", xlabel="time (s)", ylim=style.widened(axis.get_ylim()))
    begin = min([float(steps.t[0]) for steps in (control.command, control.applied) if len(steps.t)], default=0.0)
    if end > begin:
        axis.set_xlim(begin, end)
    style.legend_above(axis)


def mark_events(axis: Any, events: Sequence[Event], end: float, unit: float = 1.0, labelled: bool = True) -> None:
    """Draw a line at every event, with its text; `end` of the run, s; `unit` of the axis, s."""
    for number, event in enumerate(events):
        axis.axvline(event.t / unit, color=style.RED, linewidth=0.8, linestyle=(0, (2, 2)), zorder=0.8,
                     label="event" if number == 0 and len(events) > MOST_LABELS else None)
        if labelled and len(events) <= MOST_LABELS:
            text = event.text if len(event.text) <= LONGEST_LABEL else event.text[:LONGEST_LABEL - 3] + "..."
            late = event.t > 0.5 * end
            axis.annotate(text, (event.t / unit, 0.97 - 0.15 * (number % 3)), (-3.0 if late else 3.0, 0.0),
                          fontsize=6.5,
                          xycoords=("data", "axes fraction"), textcoords="offset points", va="top", color=style.RED,
                          ha="right" if late else "left", bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6})
