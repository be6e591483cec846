"""The picture of a manoeuvre: the whole of a run whose excitation varies in time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tcc_sim.solvers import solve
from tcc_sim.trajectory import Floats, State, Trajectory, integral
from tcc_sim.views import style

SAMPLES, ENOUGH = 100, 16
"""Samples in an engine cycle where the run is solved again, and those that serve as they are."""
SHARP = 5000
"""Most points of a line that is not made of dots in a drawing of lines."""


def manoeuvre(path: Path, run: Trajectory, width: float = style.PAGE, title: str = "") -> Path:
    """Draw torques, slip speed with stick shaded, the shaft's torque and the clutch's heat over all of the time.

    Parameters
    ----------
    run : with its system; one that kept few samples is solved again from its first state
    width : inch
    """
    run = _sampled(run)
    assert run.system is not None
    driveline, dots = run.system.driveline, len(run.t) > SHARP
    shaft = driveline.damping * run.plate_speed + driveline.stiffness * run.plate_angle
    power = run.friction_torque * run.slip_speed
    heat = integral(power, run.t)
    with style.figure(width, 6.4, title) as drawn:
        axes = drawn.subplots(4, 1, sharex=True, height_ratios=(1.2, 1.2, 1.0, 0.7))
        torques, slip, beside, warm = axes

        def line(axis: Any, values: Floats, colour: str, label: str = "", **look: Any) -> None:
            axis.plot(run.t, values, color=colour, label=label or None, rasterized=dots, linewidth=0.8, **look)

        line(torques, run.engine_torque, style.ORANGE, "engine")
        line(torques, run.friction_torque, style.BLUE, "friction")
        line(torques, run.saturation_torque, style.GREY, r"$\mu_k N R$", linestyle=(0, (4, 2)))
        if run.system.friction_ratio > 1.0:
            line(torques, run.system.friction_ratio * run.saturation_torque, style.GREY, r"$\mu_s N R$",
                 linestyle=(0, (1, 1.5)))
        torques.set_ylabel("torque (N m)")
        line(slip, run.slip_speed, style.BLUE, "slip speed")
        stuck = run.state == 0
        if stuck.any():
            slip.fill_between(run.t, 0.0, 1.0, where=stuck, transform=slip.get_xaxis_transform(), color=style.STICK,
                              linewidth=0.0, zorder=0, label="stick", rasterized=dots)
        slip.set_ylabel("slip speed (rad/s)")
        line(beside, shaft, style.BLUE)
        beside.set_ylabel("torque (N m)")
        line(warm, heat * 1e-3, style.RED)
        warm.set(xlabel="time (s)", ylabel="heat (kJ)", xlim=(run.t[0], run.t[-1]))
        for axis in (torques, slip):
            style.legend_above(axis)
        style.panel_titles(axes, ["Torques", "Slip speed", "Shaft torque", "Heat in the clutch until then"])
        return style.save(drawn, path)


def _sampled(run: Trajectory) -> Trajectory:
    """The run itself, or solved again with samples where it kept too few of them."""
    length = float(run.t[-1] - run.t[0])
    if run.system is None or run.t[0] != 0.0 or len(run.t) >= ENOUGH * length / run.cycle:
        return run
    first = State.of((run.slip_speed[0], run.plate_angle[0], run.plate_speed[0]))
    return solve(run.system, duration=length, samples_per_cycle=SAMPLES, state=first).raise_for_status()
