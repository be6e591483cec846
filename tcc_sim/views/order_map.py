"""The picture of a run's orders: maps of shaft torque and slip speed, cuts of the first orders, slip and heat."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.analysis.orders import Orders
from tcc_sim.trajectory import Floats
from tcc_sim.views.style import BLUE, COLUMN, CYCLE, ORANGE, PAGE, figure, panel_titles, save

SHOWN = 60.0
"""Range of a map, dB."""
CUTS = (1.0, 2.0, 3.0, 4.0)
LEAST = 1e-12
"""Amplitudes below count as this one, so that they have a level."""


def plot_orders(path: Path, found: Orders, title: str = "", width: float = PAGE) -> Path:
    """Draw the orders over the engine frequency where it rises or falls all the time, else over time."""
    along, name = _along(found)
    wide = width > 0.5 * (COLUMN + PAGE)
    with figure(width, 0.86 * width if wide else 2.6 * width) as drawn:
        grid = drawn.add_gridspec(6, 2) if wide else drawn.add_gridspec(11, 1)
        rows = [(slice(0, 3), 0), (slice(0, 3), 1), (slice(3, 6), 0), (slice(3, 5), 1), (5, 1)] if wide else [
            (slice(0, 3), 0), (slice(3, 6), 0), (slice(6, 8), 0), (slice(8, 10), 0), (10, 0)]
        shaft, slip, cuts, judder, heat = axes = [drawn.add_subplot(grid[place]) for place in rows]
        into(shaft, found)
        _map(slip, found, found.slip_speed, "dB re 1 rad/s")
        shown = [order for order in CUTS if order <= found.order[-1]]
        for colour, order in zip(CYCLE, shown):
            cuts.plot(along, level(found.cut(order)), color=colour, label=f"order {order:g}")
        top = max(float(level(found.cut(order)).max()) for order in shown)
        cuts.set(ylabel="shaft torque, dB re 1 N m", xlabel=name, ylim=(top - SHOWN, top + 0.05 * SHOWN))
        cuts.legend(ncols=2)
        judder.plot(along, found.peak, color=BLUE, label="peak")
        judder.plot(along, found.rms, color=BLUE, ls=":", label="rms")
        judder.set(ylabel="slip about its\ncycle mean, rad/s", ylim=(0.0, None))
        judder.legend()
        heat.plot(along, found.heat * 1e-3, color=ORANGE)
        heat.set(ylabel="heat, kJ", xlabel=name, ylim=(0.0, None))
        panel_titles(axes, ["Shaft torque", "Slip speed", "Orders of the shaft torque", "Judder", "Heat until then"])
        for axis in axes:
            axis.set_xlim(float(along.min()), float(along.max()))
        for axis in axes[:2] + axes[3:4] if wide else axes[:4]:
            axis.set_xlabel("")
            axis.tick_params(labelbottom=False)
        if title:
            drawn.suptitle(title, x=0.01, ha="left", fontsize=9, fontweight="bold")
        return save(drawn, path)


def into(axis: Any, found: Orders) -> None:
    """Draw the map of the shaft torque into an axis."""
    _map(axis, found, found.shaft_torque, "dB re 1 N m")


def _along(found: Orders) -> tuple[Floats, str]:
    """What the orders are drawn over, and its name."""
    steps = np.diff(found.frequency)
    rises = len(steps) > 0 and bool(np.all(steps > 0.0) or np.all(steps < 0.0))
    return (found.frequency, "engine frequency, rad/s") if rises else (found.time, "time, s")


def level(amplitude: Floats) -> Floats:
    """20 log10 of an amplitude, dB re 1 of its unit."""
    return 20.0 * np.log10(np.maximum(amplitude, LEAST))


def _map(axis: Any, found: Orders, amplitude: Floats, unit: str) -> None:
    """One order map with its colour scale and the two linear modes."""
    along, over = _along(found)
    shown = found.order > 0.25
    levels = level(amplitude[:, shown]).T
    top = 5.0 * np.ceil(float(levels.max()) / 5.0)
    image = axis.pcolormesh(along, found.order[shown], levels, cmap="magma", vmin=top - SHOWN, vmax=top,
                            shading="nearest", rasterized=True)
    axis.figure.colorbar(image, ax=axis, label=unit, pad=0.015, aspect=28,
                         ticks=np.arange(top - SHOWN, top + 1.0, 10.0))
    axis.grid(False)
    highest = float(found.order[-1])
    for omega, name, beside in zip(found.modes, ("stuck", "slipping"), (0.42, 2.3)):
        order = omega / found.frequency
        axis.plot(along, np.where(order <= highest, order, np.nan), color="white", lw=0.9, ls=(0, (4, 2)))
        if order.min() < 0.9 * highest and order.max() > 0.3:
            at = int(np.argmin(np.abs(order - beside)))
            axis.annotate(f"{name}, {omega:.0f} rad/s", (along[at], order[at]), xytext=(4, 2), color="white",
                          textcoords="offset points", fontsize=6.5)
    axis.set(xlabel=over, ylabel="order", ylim=(0.25, highest))
