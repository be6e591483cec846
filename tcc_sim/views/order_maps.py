"""Panels over orders: the orders along a run, a measured run-up beside the simulated one, and spectra."""

from __future__ import annotations

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
SIGNALS = {"slip_speed": style.SLIP, "shaft_torque": AxisQuantity("shaft torque", "N m")}
SHORT = {"slip_speed": "Slip", "shaft_torque": "Torque"}
"""Names in the titles of narrow panels."""
ORDER = AxisQuantity("crank order")
BOX = {"facecolor": "black", "alpha": 0.55, "edgecolor": "none", "pad": 0.8}
"""Box behind a label in a map."""


def order_panels(orders: Orders) -> list[Panel]:
    """Return the panels of the orders, over the engine frequency if it always rises or always falls, else over time."""
    orders = orders.with_blanks()
    along, over = _along(orders)
    ends, judder = (along.min(), along.max()), orders.judder

    def unmeasured(axis: Any) -> None:
        axis.text(0.5, 0.5, "not measured", transform=axis.transAxes, ha="center", va="center")
        quantities(axis, over)

    def judders(axis: Any) -> None:
        peaks = np.sort(judder.peak[np.isfinite(judder.peak)])
        few = max(1, round(FEW * len(peaks)))
        top = 1.1 * float(peaks[-few - 1]) if len(peaks) > few else 0.0
        above = int(np.count_nonzero(peaks > top)) if 0.0 < PEAKED * top < peaks[-1] else 0
        axis.plot(along, judder.peak, color=style.BLUE,
                  label=f"peak ({above} of {len(peaks)} windows off scale)" if above else "peak")
        axis.plot(along, judder.rms, color=style.BLUE, ls=":", label="rms")
        axis.set(ylim=(0.0, top if above else None), xlim=ends)
        quantities(axis, over, AxisQuantity("slip about its mean", "rad/s"))

    def heat(axis: Any) -> None:
        if np.isfinite(orders.heat).any():
            axis.plot(along, orders.heat * 1e-3, color=style.ORANGE)
        else:
            unmeasured(axis)
        axis.set(ylim=(0.0, None), xlim=ends)
        quantities(axis, over, style.HEAT)

    known = bool(np.isfinite(orders.shaft_torque).any())
    maps, cuts = ({of: partial(draw, orders=orders, of=of) if known or of == "slip_speed" else unmeasured
                   for of in ("shaft_torque", "slip_speed")} for draw in (_map, _cuts))
    shaft = "shaft_torque" if known else "slip_speed"
    panels = [*(Panel(SIGNALS[of].name.capitalize(), draw, 2.3, beside=of == "slip_speed", named=False,
                      alone=maps[shaft]) for of, draw in maps.items()),
              *(Panel(f"Orders of the {SIGNALS[of].name}", draw, 2.4, beside=of == "slip_speed", over=True)
                for of, draw in cuts.items()),
              Panel("Judder", judders, 1.9), Panel("Cumulative heat", heat, 1.6, beside=True)]
    if over is not style.TIME:
        panels.append(Panel(f"Campbell diagram of the {SIGNALS[shaft].name}",
                            partial(_campbell, orders=orders, of=shaft), 2.7, named=False))
    return panels


def comparison_panels(comparison: OrderComparison) -> list[Panel]:
    """Return the maps of a measured and a simulated run with their difference, and the cuts of both."""
    runs = {"measured": comparison.measured.with_blanks(), "simulated": comparison.simulated.with_blanks()}
    measured = runs["measured"]
    along, over = _along(measured)
    shown = _shown(measured)

    def difference(axis: Any, of: str, top: float) -> None:
        """Draw a map of the simulated minus the measured level, blank where both are below the range of the maps."""
        one, other = (level(getattr(run, of)[:, shown]).T for run in runs.values())
        apart = np.ma.masked_where(~(np.maximum(one, other) >= top - SHOWN), other - one)
        _levels(axis, along, measured.order[shown], apart, cmap="RdBu_r", low=-DIFFERENCE, top=DIFFERENCE,
                label=f"simulated less measured (dB),\nblank below {top - SHOWN:.0f} dB")
        axis.set(ylim=(0.25 * measured.per_revolution, float(measured.order[-1])), xlim=(along.min(), along.max()))
        quantities(axis, over, ORDER)

    def both(axis: Any, of: str) -> None:
        _cuts(axis, measured, of, "_measured", linewidth=2.4, alpha=0.45)
        _cuts(axis, runs["simulated"], of, "", linewidth=0.9)

    names = [name for name in SIGNALS if np.isfinite(getattr(measured, name)).any()]
    panels = []
    for name in names:
        top = max(_top(getattr(run, name), run) for run in runs.values())
        apart = partial(difference, of=name, top=top)
        maps = {which: partial(_map, orders=run, of=name, top=top, named=False) for which, run in runs.items()}
        panels += [Panel(f"{SHORT[name]}, {which}", draw, 2.3, beside=which != "measured", named=False, alone=apart)
                   for which, draw in {**maps, "difference": apart}.items()]
    return panels + [Panel("Wide: measured, thin: simulated", partial(both, of=name), 2.4, beside=k > 0)
                     for k, name in enumerate(names)]


def spectrum_panels(spectrum: Spectrum) -> list[Panel]:
    """Return the spectra of slip speed and shaft torque over the crank order."""
    return [Panel(f"Spectrum of the {quantity.name}", partial(_spectrum, spectrum=spectrum, name=name), 2.4,
                  beside=name == "shaft_torque") for name, quantity in SIGNALS.items()]


def _spectrum(axis: Any, spectrum: Spectrum, name: str) -> None:
    """Draw lines over the order, sub-harmonics in red, or a density; the upper axis is the frequency."""
    values, unit = getattr(spectrum, name), SIGNALS[name].unit
    order = spectrum.order[1:]
    if values is not None:
        heights = values[1:]
        marked = np.isclose(order[:, None], spectrum.subharmonics[None, :]).any(axis=1)
        top = float(np.nanmax(heights, initial=1e-12))
        for mine, colour, label in ((~marked, style.BLUE, "amplitude"), (marked, style.RED, "sub-harmonic")):
            shown = mine & (heights >= top * 10.0**-LINES * (1.0 - 1e-9))
            if shown.any():
                axis.vlines(order[shown], top * 10.0**-LINES, heights[shown], color=colour, linewidth=1.0)
                axis.plot(order[shown], heights[shown], linestyle="none", marker="o", markersize=2.4, color=colour,
                          label=label)
        quantity = AxisQuantity("amplitude", unit)
    else:
        heights = getattr(spectrum, f"{name}_density")[1:]
        top = float(np.nanmax(heights, initial=1e-12))
        axis.plot(order, heights, color=style.BLUE, linewidth=0.7)
        quantity = AxisQuantity("density", f"({unit})$^2$/Hz")
    axis.set(yscale="log", ylim=(top * 10.0**-(LINES if values is not None else 2 * LINES), 3.0 * top),
             xlim=(0.0, float(order[-1])))
    quantities(axis, ORDER, quantity)
    each = float(spectrum.frequency[-1] / spectrum.order[-1])
    above = axis.secondary_xaxis("top", functions=(lambda x: x * each, lambda x: x / each))
    quantities(above, style.FREQUENCY)
    above.spines["top"].set_visible(True)


def _cuts(axis: Any, orders: Orders, of: str, which: str = "", **look: Any) -> None:
    """Draw the first orders along the run, dB; with names of their own, or a label `which` that no legend shows."""
    along, name = _along(orders)
    curves = {order: level(orders.cut(order, of)) for order in orders.cuts}
    top = max(float(np.nanmax(curve)) for curve in curves.values())
    for colour, (order, curve) in zip(style.CYCLE, curves.items()):
        if np.nanmax(curve) >= top - SHOWN:
            axis.plot(along, curve, color=colour, label=which or f"order {order:g}", **look)
        elif not which:
            style.key(axis, f"order {order:g}, below {top - SHOWN:.0f} dB", linestyle="none")
    axis.set(ylim=(top - SHOWN, top + 0.05 * SHOWN), xlim=(along.min(), along.max()))
    quantities(axis, name, AxisQuantity(SIGNALS[of].name, f"dB re 1 {SIGNALS[of].unit}"))


def _along(orders: Orders) -> tuple[Floats, AxisQuantity]:
    """Return the values and the quantity along the run: the frequency, or the time if the frequency is held."""
    steps = np.diff(orders.frequency)
    least = HELD * float(orders.frequency.mean()) / max(len(steps), 1)
    rises = len(steps) > 0 and bool(np.all(steps > least) or np.all(steps < -least))
    return (orders.frequency, style.ENGINE) if rises else (orders.time, style.TIME)


def _top(amplitude: Floats, orders: Orders) -> float:
    return float(5.0 * np.ceil(float(np.nanmax(level(amplitude[:, _shown(orders)]))) / 5.0))


def _shown(orders: Orders) -> Any:
    return orders.order > 0.25 * orders.per_revolution


def _map(axis: Any, orders: Orders, of: str, top: float | None = None, named: bool = True) -> None:
    """Draw an order map of a signal with the two linear modes, which may be named."""
    (along, over), shown, amplitude = _along(orders), _shown(orders), getattr(orders, of)
    levels = level(amplitude[:, shown]).T
    top = _top(amplitude, orders) if top is None else top
    _levels(axis, along, orders.order[shown], levels, f"dB re 1 {SIGNALS[of].unit}", top,
            ticks=np.arange(top - SHOWN, top + 1.0, 10.0))
    lowest, highest = 0.25 * orders.per_revolution, float(orders.order[-1])
    for omega, name in zip(orders.modes, ("stuck", "slipping")):
        order = orders.per_revolution * omega / orders.frequency
        axis.plot(along, np.where((order <= highest) & (order >= lowest), order, np.nan), color="white", lw=0.9,
                  ls=(0, (4, 2)))
        inside = np.flatnonzero((order >= lowest) & (order <= 0.95 * highest) & (along < along.mean()))
        if named and len(inside):
            at = inside[np.argmax(np.abs((order[inside] / orders.per_revolution + 0.5) % 1.0 - 0.5))]  # Between orders.
            axis.annotate(f"{name}, {frequency(omega, 4)}", (along[at], order[at]), xytext=(4, 0), color="white",
                          textcoords="offset points", fontsize=6.5, va="center", bbox=BOX, clip_on=True)
    axis.set(ylim=(lowest, highest), xlim=(along.min(), along.max()))
    quantities(axis, over, ORDER)


def _levels(axis: Any, x: Any, y: Any, levels: Any, label: str, top: float, low: float | None = None,
            cmap: str = "magma", aspect: int = 28, ticks: Any = None) -> None:
    """Draw levels, dB, up to `top` in colours with a bar; by default over a range of SHOWN."""
    image = axis.pcolormesh(x, y, levels, cmap=cmap, vmin=top - SHOWN if low is None else low, vmax=top,
                            shading="nearest", rasterized=True)
    axis.figure.colorbar(image, ax=axis, label=label, pad=0.015, aspect=aspect, ticks=ticks)
    axis.grid(False)


def _campbell(axis: Any, orders: Orders, of: str) -> None:
    """Draw the levels over engine speed and frequency, with the orders that are listed and the two linear modes."""
    amplitude, shown, unit = getattr(orders, of), _shown(orders), SIGNALS[of].unit
    rpm = orders.frequency * UNITS["rpm"][1] / orders.per_revolution
    hertz = np.outer(rpm / 60.0, orders.order[shown])
    top, levels = _top(amplitude, orders), level(amplitude[:, shown])
    highest = 1.05 * max(float(hertz[levels > top - SHOWN].max()), *(0.5 / np.pi * omega for omega in orders.modes))
    _levels(axis, np.broadcast_to(rpm[:, None], hertz.shape), hertz, levels, f"dB re 1 {unit}", top, aspect=20)
    for omega, name in zip(orders.modes, ("stuck", "slipping")):
        if 0.5 / np.pi * omega < hertz.max():
            axis.axhline(0.5 / np.pi * omega, color="white", lw=0.9, ls=(0, (4, 2)))
            axis.annotate(f"{name}, {0.5 / np.pi * omega:.4g} Hz", (rpm.min(), 0.5 / np.pi * omega), xytext=(4, 2),
                          textcoords="offset points", color="white", fontsize=6.5, bbox=BOX)
    for order in orders.cuts:
        at = min(float(rpm.max()), 0.94 * 60.0 * highest / order)
        axis.plot([0.0, at], [0.0, order * at / 60.0], color="white", lw=0.5, alpha=0.45, ls=(0, (1, 2)))
        axis.annotate(f"order {order:g}", (at, order * at / 60.0), xytext=(-6, 0), textcoords="offset points",
                      color="white", fontsize=6.5, va="center", ha="right", bbox=BOX)
    axis.set(xlim=(rpm.min(), rpm.max()), ylim=(0.0, highest))
    quantities(axis, AxisQuantity("engine speed", "rpm"), AxisQuantity("frequency", "Hz"))
