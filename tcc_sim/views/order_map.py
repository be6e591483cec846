"""The picture of a run's orders: maps of shaft torque and slip speed, cuts of the first orders, slip and heat."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.analysis.orders import Orders
from tcc_sim.model.parameters import System
from tcc_sim.trajectory import Floats, Trajectory
from tcc_sim.views.style import BLUE, CYCLE, INK, ORANGE, figure, panel_titles, save, width_of

SHOWN = 60.0
"""Range of a map, dB."""
CUTS = (1.0, 2.0, 3.0, 4.0)
LEAST = 1e-12
"""Amplitudes below count as this one, so that they have a level."""


def plot_orders(found: Orders, run: Trajectory, path: Path, width: str = "page", *, title: str = "") -> Path:
    """Draw the orders over the engine frequency where it rises or falls all the time, else over time.

    Parameters
    ----------
    run : that `found` was worked out of, with its system
    width : column or page

    Raises
    ------
    InputError
        A suffix that is no picture's.
    MissingPackage
        matplotlib is not installed.
    """
    steps = np.diff(found.frequency)
    rises = len(steps) > 0 and bool(np.all(steps > 0.0) or np.all(steps < 0.0))
    along, name = (found.frequency, "engine frequency, rad/s") if rises else (found.time, "time, s")
    with figure(width_of(width), 0.86 * width_of(width)) as drawn:
        axes = drawn.subplots(2, 2, sharex="col", height_ratios=(1.25, 1.0))
        _map(drawn, axes[0, 0], along, found, found.shaft_torque, "dB re 1 N m", run.system)
        _map(drawn, axes[0, 1], along, found, found.slip_speed, "dB re 1 rad/s", run.system)
        for colour, order in zip(CYCLE, CUTS):
            if order <= found.order[-1]:
                axes[1, 0].plot(along, level(found.cut(order)), color=colour, label=f"order {order:g}")
        top = max(float(level(found.cut(order)).max()) for order in CUTS if order <= found.order[-1])
        axes[1, 0].set(ylabel="shaft torque, dB re 1 N m", xlabel=name, ylim=(top - SHOWN, top + 0.05 * SHOWN))
        axes[1, 0].legend(ncols=2)
        _slip_and_heat(axes[1, 1], along, found, run, name)
        panel_titles(axes.ravel(), ["Shaft torque", "Slip speed", "Orders of the shaft torque", "Judder and heat"])
        for axis in axes.ravel():
            axis.set_xlim(float(along.min()), float(along.max()))
        if title:
            drawn.suptitle(title, x=0.01, ha="left", fontsize=9, fontweight="bold")
        return save(drawn, path)


def level(amplitude: Floats) -> Floats:
    """20 log10 of an amplitude, dB re 1 of its unit."""
    return 20.0 * np.log10(np.maximum(amplitude, LEAST))


def _map(drawn: Any, axis: Any, along: Floats, found: Orders, amplitude: Floats, unit: str,
         system: System | None) -> None:
    """One order map with its colour scale and the two linear modes."""
    shown = found.order > 0.25
    levels = level(amplitude[:, shown]).T
    top = 5.0 * np.ceil(float(levels.max()) / 5.0)
    image = axis.pcolormesh(along, found.order[shown], levels, cmap="magma", vmin=top - SHOWN, vmax=top,
                            shading="nearest", rasterized=True)
    drawn.colorbar(image, ax=axis, label=unit, pad=0.015, aspect=28, ticks=np.arange(top - SHOWN, top + 1.0, 10.0))
    axis.grid(False)
    highest = float(found.order[-1])
    if system is not None:
        for omega, name, beside in ((system.stuck_natural_frequency, "stuck", 0.62),
                                    (system.natural_frequency, "slipping", 2.3)):
            order = omega / found.frequency
            axis.plot(along, np.where(order <= highest, order, np.nan), color="white", lw=0.9, ls=(0, (4, 2)))
            if order.min() < 0.9 * highest and order.max() > 0.3:
                at = int(np.argmin(np.abs(order - beside)))
                axis.annotate(f"{name}, {omega:.0f} rad/s", (along[at], order[at]), xytext=(4, 2), color="white",
                              textcoords="offset points", fontsize=6.5)
    axis.set(ylabel="order", ylim=(0.25, highest))


def _slip_and_heat(axis: Any, along: Floats, found: Orders, run: Trajectory, name: str) -> None:
    """Judder of the slip speed, and beside it the heat that the clutch has borne by then."""
    axis.plot(along, found.peak, color=BLUE, label="slip about its cycle mean: peak")
    axis.plot(along, found.rms, color=BLUE, ls=":", label="rms")
    axis.set(ylabel="rad/s", xlabel=name, ylim=(0.0, None))
    power = run.friction_torque * run.slip_speed
    heat = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(run.t))])
    beside = axis.twinx()
    beside.plot(along, np.interp(found.time, run.t, heat) * 1e-3, color=ORANGE, label="heat")
    beside.set_ylabel("heat so far, kJ", color=INK)
    beside.set_ylim(0.0, None)
    beside.grid(False)
    beside.spines["right"].set_visible(True)
    lines = [*axis.get_lines(), *beside.get_lines()]
    axis.legend(lines, [line.get_label() for line in lines], loc="center right")
