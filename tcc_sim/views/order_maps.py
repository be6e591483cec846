"""Panels over orders: the orders along a run, a measured run-up beside the simulated one, and spectra."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from tcc_sim.analysis.measured.orders import OrderComparison, Orders, Spectrum, level
from tcc_sim.shown_units import UNITS, frequency
from tcc_sim.trajectory import Floats
from tcc_sim.views import style
from tcc_sim.views.panels import Panel
from tcc_sim.views.style import AxisQuantity, quantities

SHOWN = 60.0
"""Range of a map of orders, dB."""
DIFFERENCE = 12.0
"""Largest difference in a map of differences, dB."""
HELD = 1e-3
"""Least change of the frequency from window to window, over the mean change of one that doubles, to draw over it."""
FEW, PEAKED = 0.02, 2.0
"""Part of the windows, one at least, whose judder is off scale where the largest is PEAKED times as high as the rest.
"""
LINES = 5
"""Number of decades in a spectrum."""
SIGNALS = {"shaft_torque": AxisQuantity("shaft torque", "N m"), "slip_speed": style.SLIP}
SHORT = {"slip_speed": "Slip", "shaft_torque": "Torque"}
"""Names in the titles of narrow panels."""
ORDER = AxisQuantity("crank order")
NOTE: dict[str, Any] = {"textcoords": "offset points", "color": "white", "fontsize": 6.5, "bbox": {
    "facecolor": "black", "alpha": 0.55, "edgecolor": "none", "pad": 0.8}}
MODE: dict[str, Any] = {"color": "white", "lw": 0.9, "ls": (0, (4, 2))}
"""Looks of a label and of the line of a mode in a map."""


def order_panels(orders: Orders) -> list[Panel]:
    """Return the panels of the orders, over the engine frequency if it always rises or always falls, else over time."""
    orders = orders.with_blanks()
    along, over = _along(orders)
    ends, judder, known = (along.min(), along.max()), orders.judder, bool(np.isfinite(orders.shaft_torque).any())

    def unmeasured(axis: Any) -> None:
        axis.text(0.5, 0.5, "not measured", transform=axis.transAxes, ha="center", va="center")

    def judders(axis: Any) -> None:
        peaks = np.sort(judder.peak[np.isfinite(judder.peak)])
        few = max(1, round(FEW * len(peaks)))
        top = 1.1 * float(peaks[-few - 1]) if len(peaks) > few else 0.0
        above = int(np.count_nonzero(peaks > top)) if 0.0 < PEAKED * top < peaks[-1] else 0
        axis.plot(along, judder.peak, color=style.BLUE,
                  label=f"peak ({above} of {len(peaks)} windows off scale)" if above else "peak")
        axis.plot(along, judder.rms, color=style.BLUE, ls=":", label="rms")
        axis.set(ylim=(0.0, top if above else None), xlim=ends)

    def heat(axis: Any) -> None:
        if np.isfinite(orders.heat).any():
            axis.plot(along, orders.heat * 1e-3, color=style.ORANGE)
        else:
            unmeasured(axis)
        axis.set(ylim=(0.0, None), xlim=ends)

    def panel(of: str, title: str, draw: Callable[..., None], height: float, y: AxisQuantity, **how: Any) -> Panel:
        there = known or of == "slip_speed"
        return Panel(title, partial(draw, orders=orders, of=of) if there else unmeasured, height, over,
                     y if there else None, beside=of == "slip_speed", **how)

    torque, slip = (panel(of, SIGNALS[of].name.capitalize(), _map, 2.3, ORDER, named=False) for of in SIGNALS)
    panels = [torque._replace(alone=torque if known else slip), slip,
              *(panel(of, f"Orders of the {SIGNALS[of].name}", _cuts, 2.4, _decibels(of), over=True) for of in SIGNALS),
              Panel("Judder", judders, 1.9, over, AxisQuantity("slip about its mean", "rad/s")),
              Panel("Cumulative heat", heat, 1.6, over, style.HEAT, beside=True)]
    if over is not style.TIME:
        shaft = "shaft_torque" if known else "slip_speed"
        panels.append(Panel(f"Campbell diagram of the {SIGNALS[shaft].name}",
                            partial(_campbell, orders=orders, of=shaft), 2.7, AxisQuantity("engine speed", "rpm"),
                            AxisQuantity("frequency", "Hz"), named=False))
    return panels


def comparison_panels(comparison: OrderComparison) -> list[Panel]:
    """Return the maps of a measured and a simulated run with their difference, and the cuts of both."""
    runs = {"measured": comparison.measured.with_blanks(), "simulated": comparison.simulated.with_blanks()}
    measured, simulated = runs.values()
    along, over = _along(measured)

    def difference(axis: Any, of: str, top: float) -> None:
        """Draw a map of the simulated minus the measured level, blank where both are below the range of the maps."""
        (order, one, _), (_, other, _) = (_levels_of(run, of) for run in runs.values())
        apart = np.ma.masked_where(~(np.maximum(one, other) >= top - SHOWN), other - one)
        _levels(axis, along, order, apart, cmap="RdBu_r", low=-DIFFERENCE, top=DIFFERENCE,
                label=f"simulated less measured (dB),\nblank below {top - SHOWN:.0f} dB")
        axis.set(ylim=(0.25 * measured.per_revolution, float(measured.order[-1])), xlim=(along.min(), along.max()))

    def both(axis: Any, of: str) -> None:
        _cuts(axis, measured, of, "_measured", linewidth=2.4, alpha=0.45)
        _cuts(axis, simulated, of, "", linewidth=0.9)

    names = [name for name in reversed(SIGNALS) if np.isfinite(getattr(measured, name)).any()]
    panels = []
    for name in names:
        top = max(_levels_of(run, name)[2] for run in runs.values())
        apart = Panel(f"{SHORT[name]}, difference", partial(difference, of=name, top=top), 2.3, over, ORDER,
                      beside=True, named=False)
        panels += [*(Panel(f"{SHORT[name]}, {which}", partial(_map, orders=run, of=name, top=top, named=False), 2.3,
                           _along(run)[1], ORDER, beside=run is simulated, alone=apart, named=False)
                     for which, run in runs.items()), apart]
    return panels + [Panel("Wide: measured, thin: simulated", partial(both, of=name), 2.4, _along(simulated)[1],
                           _decibels(name), beside=k > 0) for k, name in enumerate(names)]


def spectrum_panels(spectrum: Spectrum) -> list[Panel]:
    """Return the spectra of slip speed and shaft torque over the crank order."""
    return [Panel(f"Spectrum of the {name}", partial(_spectrum, spectrum=spectrum, of=of), 2.4, ORDER,
                  AxisQuantity("density", f"({unit})$^2$/Hz") if getattr(spectrum, of) is None else
                  AxisQuantity("amplitude", unit), beside=of == "shaft_torque")
            for of, (name, unit, _) in reversed(SIGNALS.items())]


def _spectrum(axis: Any, spectrum: Spectrum, of: str) -> None:
    """Draw lines over the order, sub-harmonics in red, or a density; the upper axis is the frequency."""
    lines, order = getattr(spectrum, of) is not None, spectrum.order[1:]
    heights = getattr(spectrum, of if lines else f"{of}_density")[1:]
    top = float(np.nanmax(heights, initial=1e-12))
    low = top * 10.0**-(LINES if lines else 2 * LINES)
    if lines:
        marked = np.isclose(order[:, None], spectrum.subharmonics[None, :]).any(axis=1)
        for mine, colour, label in ((~marked, style.BLUE, "amplitude"), (marked, style.RED, "sub-harmonic")):
            shown = mine & (heights >= low * (1.0 - 1e-9))
            if shown.any():
                axis.vlines(order[shown], low, heights[shown], color=colour, linewidth=1.0)
                axis.plot(order[shown], heights[shown], linestyle="none", marker="o", markersize=2.4, color=colour,
                          label=label)
    else:
        axis.plot(order, heights, color=style.BLUE, linewidth=0.7)
    axis.set(yscale="log", ylim=(low, 3.0 * top), xlim=(0.0, float(order[-1])))
    each = float(spectrum.frequency[-1] / spectrum.order[-1])
    above = axis.secondary_xaxis("top", functions=(lambda x: x * each, lambda x: x / each))
    quantities(above, style.FREQUENCY)
    above.spines["top"].set_visible(True)


def _decibels(of: str) -> AxisQuantity:
    return AxisQuantity(SIGNALS[of].name, f"dB re 1 {SIGNALS[of].unit}")


def _cuts(axis: Any, orders: Orders, of: str, which: str = "", **look: Any) -> None:
    """Draw the first orders along the run, dB; with names of their own, or a label `which` that no legend shows."""
    along, _ = _along(orders)
    curves = {order: level(orders.cut(order, of)) for order in orders.cuts}
    top = max(float(np.nanmax(curve)) for curve in curves.values())
    for colour, (order, curve) in zip(style.CYCLE, curves.items()):
        if np.nanmax(curve) >= top - SHOWN:
            axis.plot(along, curve, color=colour, label=which or f"order {order:g}", **look)
        elif not which:
            style.key(axis, f"order {order:g}, below {top - SHOWN:.0f} dB", linestyle="none")
    axis.set(ylim=(top - SHOWN, top + 0.05 * SHOWN), xlim=(along.min(), along.max()))


def _along(orders: Orders) -> tuple[Floats, AxisQuantity]:
    """Return the values and the quantity along the run: the frequency, or the time if the frequency is held."""
    steps = np.diff(orders.frequency)
    least = HELD * float(orders.frequency.mean()) / max(len(steps), 1)
    rises = len(steps) > 0 and bool(np.all(steps > least) or np.all(steps < -least))
    return (orders.frequency, style.ENGINE) if rises else (orders.time, style.TIME)


def _levels_of(orders: Orders, of: str) -> tuple[Floats, Floats, float]:
    """Return the orders in maps, (m,), their levels along the run, (m, n), dB, and the upper end of the maps' range."""
    shown = orders.order > 0.25 * orders.per_revolution
    levels = level(getattr(orders, of)[:, shown]).T
    return orders.order[shown], levels, float(5.0 * np.ceil(float(np.nanmax(levels)) / 5.0))


def _map(axis: Any, orders: Orders, of: str, top: float | None = None, named: bool = True) -> None:
    """Draw an order map of a signal with the two linear modes, which may be named."""
    (along, _), (shown, levels, own) = _along(orders), _levels_of(orders, of)
    top = own if top is None else top
    _levels(axis, along, shown, levels, _decibels(of).unit, top, ticks=np.arange(top - SHOWN, top + 1.0, 10.0))
    lowest, highest = 0.25 * orders.per_revolution, float(orders.order[-1])
    for omega, name in zip(orders.modes, ("stuck", "slipping")):
        order = orders.per_revolution * omega / orders.frequency
        axis.plot(along, np.where((order <= highest) & (order >= lowest), order, np.nan), **MODE)
        inside = np.flatnonzero((order >= lowest) & (order <= 0.95 * highest) & (along < along.mean()))
        if named and len(inside):
            at = inside[np.argmax(np.abs((order[inside] / orders.per_revolution + 0.5) % 1.0 - 0.5))]  # Between orders.
            axis.annotate(f"{name}, {frequency(omega, 4)}", (along[at], order[at]), (4, 0), **NOTE, va="center",
                          clip_on=True)
    axis.set(ylim=(lowest, highest), xlim=(along.min(), along.max()))


def _levels(axis: Any, x: Any, y: Any, levels: Any, label: str, top: float, low: float | None = None,
            cmap: str = "magma", aspect: int = 28, ticks: Any = None) -> None:
    """Draw levels, dB, up to `top` in colours with a bar; by default over a range of SHOWN."""
    image = axis.pcolormesh(x, y, levels, cmap=cmap, vmin=top - SHOWN if low is None else low, vmax=top,
                            shading="nearest", rasterized=True)
    axis.figure.colorbar(image, ax=axis, label=label, pad=0.015, aspect=aspect, ticks=ticks)
    axis.grid(False)


def _campbell(axis: Any, orders: Orders, of: str) -> None:
    """Draw the levels over engine speed and frequency, with the orders that are listed and the two linear modes."""
    shown, levels, top = _levels_of(orders, of)
    rpm, modes = orders.frequency * UNITS["rpm"][1] / orders.per_revolution, [0.5 / np.pi * x for x in orders.modes]
    hertz = np.outer(rpm / 60.0, shown)
    highest = 1.05 * max(float(hertz[top - SHOWN < levels.T].max()), *modes)
    _levels(axis, np.broadcast_to(rpm[:, None], hertz.shape), hertz, levels.T, _decibels(of).unit, top, aspect=20)
    for mode, name in zip(modes, ("stuck", "slipping")):
        if mode < hertz.max():
            axis.axhline(mode, **MODE)
            axis.annotate(f"{name}, {mode:.4g} Hz", (rpm.min(), mode), (4, 2), **NOTE)
    for order in orders.cuts:
        at = min(float(rpm.max()), 0.94 * 60.0 * highest / order)
        axis.plot([0.0, at], [0.0, order * at / 60.0], color="white", lw=0.5, alpha=0.45, ls=(0, (1, 2)))
        axis.annotate(f"order {order:g}", (at, order * at / 60.0), (-6, 0), **NOTE, va="center", ha="right")
    axis.set(xlim=(rpm.min(), rpm.max()), ylim=(0.0, highest))
