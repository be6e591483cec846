"""Pictures of whole runs: a manoeuvre, and a simulation beside its recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tcc_sim.trajectory import Floats, Trajectory
from tcc_sim.views import style
from tcc_sim.views.dense import stuck_in, with_gaps
from tcc_sim.views.overview import mean_slip_panel, pressure_panel, shade_stick

if TYPE_CHECKING:
    from tcc_sim.analysis.control import Control

SHARP = 5000
"""Largest number of points of a line in a vector picture; longer lines are rasterized."""
TWIN_CYCLES = 8
"""Engine cycles of the start and of the end that a picture beside a recording shows."""


def manoeuvre(path: Path, run: Trajectory, width: float = style.PAGE, title: str = "",
              control: Control | None = None) -> Path:
    """Draw torques, slip speed with stick shaded, shaft torque and clutch heat over the whole time.

    For a run under commands, also draw the cycle mean of the slip speed with the target, and both pressures.

    Parameters
    ----------
    run : a run with its system and samples
    width : width, inch
    control : target, cycle means and pressures of the run
    """
    run = with_gaps(run)
    controlled = control is not None and control.controlled
    assert run.system is not None
    driveline, dots = run.system.driveline, len(run.t) > SHARP
    twist, twisting = run.shaft_twist
    shaft = driveline.damping * twisting + driveline.stiffness * twist
    power = run.friction_torque * run.slip_speed
    warmed = 0.5 * (power[1:] + power[:-1]) * np.diff(run.t)
    heat = np.append(0.0, np.cumsum(np.where(np.isfinite(warmed), warmed, 0.0)))
    heat[~np.isfinite(power)] = np.nan
    heights = [1.2, 1.2, *([1.0, 1.0] if controlled else []), 1.0, 0.7]
    with style.figure(width, 1.56 * sum(heights), title) as drawn:
        axes = drawn.subplots(len(heights), 1, sharex=True, height_ratios=heights)
        (torques, slip, *_, second, warm), names = axes, ["Torques", "Slip speed"]
        if control is not None and controlled:
            mean_slip_panel(axes[2], control, float(run.t[-1]))
            pressure_panel(axes[3], control, float(run.t[-1]))
            axes[3].set_xlabel("")
            names += ["Cycle mean of the slip speed", "Actuation pressure"]

        def line(axis: Any, values: Floats, colour: str, label: str = "", **look: Any) -> None:
            axis.plot(run.t, values, color=colour, label=label or None, rasterized=dots, linewidth=0.8, **look)

        line(torques, run.engine_torque, style.ORANGE, "engine")
        line(torques, run.friction_torque, style.BLUE, "friction")
        line(torques, run.saturation_torque, style.GREY, r"$\mu_k N R$", linestyle=(0, (4, 2)))
        if run.system.friction_ratio != 1.0:
            line(torques, run.system.friction_ratio * run.saturation_torque, style.GREY, r"$\mu_s N R$",
                 linestyle=(0, (1, 1.5)))
        torques.set_ylabel("torque (N m)")
        line(slip, run.slip_speed, style.BLUE, "slip speed")
        shade_stick(slip, run.t, stuck_in(run))
        slip.set_ylabel("slip speed (rad/s)")
        line(second, shaft, style.BLUE)
        second.set_ylabel("torque (N m)")
        line(warm, heat * 1e-3, style.RED)
        warm.set(xlabel="time (s)", ylabel="heat (kJ)", xlim=(run.t[0], run.t[-1]))
        for axis in (torques, slip):
            style.legend_above(axis)
        style.panel_titles(axes, [*names, "Shaft torque", "Cumulative heat in the clutch"])
        return style.save(drawn, path)


def draw_twin(path: Path, twin: Any, title: str = "", width: float = style.PAGE) -> Path:
    """Draw a simulation beside a recording: start, end, and the difference over the whole time."""
    span = TWIN_CYCLES * twin.trajectory.cycle
    begin, end = twin.t[0], twin.t[-1]
    with style.figure(width, max(0.75 * width, 4.6), f"{title}: {twin}" if title else str(twin)) as drawn:
        axes = drawn.subplots(3, 1)
        for axis, low, high in ((axes[0], begin, min(begin + span, end)), (axes[1], max(end - span, begin), end)):
            draw_slip_speeds(axis, twin, low, high)
        axes[1].sharey(axes[0])
        style.legend_above(axes[0])
        axes[2].plot(twin.t, twin.difference, color=style.RED, linewidth=0.7)
        axes[2].set(xlabel="time (s)", ylabel="difference (rad/s)")
        axes[2].set_xlim(begin, end)
        style.panel_titles(axes, ["Start", "End", "Simulated less recorded"])
        return style.save(drawn, path)


def draw_slip_speeds(axis: Any, twin: Any, low: float = -np.inf, high: float = np.inf) -> None:
    """Draw both slip speeds between two times into an axis."""
    run = twin.trajectory
    for t, slip, look in ((twin.t, twin.slip_speed, {"color": style.GREY, "linewidth": 2.4, "label": "recorded"}),
                          (run.t, run.slip_speed, {"color": style.BLUE, "linewidth": 0.9, "label": "simulated"})):
        shown = (t >= low) & (t <= high)
        axis.plot(t[shown], slip[shown], **look)
    axis.set(xlabel="time (s)", ylabel="slip speed (rad/s)")
