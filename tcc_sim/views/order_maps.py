"""Pictures over orders: the orders along a run, a measured run-up beside the simulated one, and spectra."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tcc_sim.shown_units import UNITS, frequency
from tcc_sim.trajectory import Floats
from tcc_sim.views import style

if TYPE_CHECKING:
    from tcc_sim.analysis.orders import OrderComparison, Orders
    from tcc_sim.analysis.spectra import Spectrum

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
QUANTITIES = {"slip_speed": ("Slip speed", "rad/s"), "shaft_torque": ("Shaft torque", "N m")}
ORDER, TIME = "crank order", "time (s)"
BOX = {"facecolor": "black", "alpha": 0.55, "edgecolor": "none", "pad": 0.8}
"""Box behind a label in a map."""
SHORT = {"slip_speed": "Slip", "shaft_torque": "Torque"}
"""Names in the titles of narrow panels."""


def plot_orders(path: Path, orders: Orders, title: str = "", width: float = style.PAGE) -> Path:
    """Draw the orders over the engine frequency if it always rises or always falls, else over time."""
    orders = orders.with_blanks()
    along, name = _along(orders)
    wide = style.wide(width)
    campbell = name != TIME
    height = 1.24 + 0.4 * campbell if wide else 3.5 + 0.9 * campbell
    with style.figure(width, height * width, title) as drawn:
        heights = [1.0, 1.0, 0.8] if wide else [1.0, 1.0, 0.8, 0.8, 0.7, 0.5]
        grid = drawn.add_gridspec(len(heights) + campbell, 2 if wide else 1, height_ratios=heights + [1.1] * campbell)
        shaft, slip, cuts, slip_cuts, judder, heat = axes = [
            drawn.add_subplot(grid[divmod(k, 2) if wide else (k, 0)]) for k in range(6)]
        known = bool(np.isfinite(orders.shaft_torque).any())
        if known:
            draw_shaft_map(shaft, orders)
        else:
            shaft.text(0.5, 0.5, "not measured", transform=shaft.transAxes, ha="center")
        _map(slip, orders, orders.slip_speed, "dB re 1 rad/s")
        if known:
            _cuts(cuts, orders, "shaft_torque")
        else:
            cuts.text(0.5, 0.5, "not measured", transform=cuts.transAxes, ha="center")
        _cuts(slip_cuts, orders, "slip_speed")
        judder.plot(along, orders.judder.peak, color=style.BLUE, label="peak")
        judder.plot(along, orders.judder.rms, color=style.BLUE, ls=":", label="rms")
        peaks = np.sort(orders.judder.peak[np.isfinite(orders.judder.peak)])
        few = max(1, round(FEW * len(peaks)))
        top = 1.1 * float(peaks[-few - 1]) if len(peaks) > few else 0.0
        above = int(np.count_nonzero(peaks > top)) if 0.0 < PEAKED * top < peaks[-1] else 0
        judder.set(ylabel="slip about its\ncycle mean (rad/s)", xlabel=name, ylim=(0.0, top if above else None))
        style.legend(judder, title=f"{above} of {len(peaks)} windows off scale" if above else None)
        if np.isfinite(orders.heat).any():
            heat.plot(along, orders.heat * 1e-3, color=style.ORANGE)
        else:
            heat.text(0.5, 0.5, "not measured", transform=heat.transAxes, ha="center", va="center")
        heat.set(ylabel="heat (kJ)", xlabel=name, ylim=(0.0, None))
        for axis in axes:
            axis.set_xlim(float(along.min()), float(along.max()))
        for axis in axes[:4] if wide else axes[:5]:
            axis.tick_params(labelbottom=False)
            axis.xaxis.label.set_visible(False)  # With its text the ticks are those of the panels below.
        titles = ["Shaft torque", "Slip speed", "Orders of the shaft torque", "Orders of the slip speed", "Judder",
                  "Cumulative heat"]
        if campbell:
            axes.append(drawn.add_subplot(grid[-1, :]))
            _campbell(axes[-1], orders, "shaft_torque" if known else "slip_speed")
            titles.append(f"Campbell diagram of the {QUANTITIES['shaft_torque' if known else 'slip_speed'][0].lower()}")
        style.panel_titles(axes, titles)
        return style.save(drawn, path)


def plot_comparison(path: Path, comparison: OrderComparison, title: str = "", width: float = style.PAGE) -> Path:
    """Draw the maps of a measured and a simulated run with their difference, and the cuts of both."""
    comparison = replace(comparison, measured=comparison.measured.with_blanks(),
                         simulated=comparison.simulated.with_blanks())
    names = [name for name in QUANTITIES if np.isfinite(getattr(comparison.measured, name)).any()]
    along, over = _along(comparison.measured)
    wide, count = style.wide(width), len(names)
    with style.figure(width, width * ((0.42 * count + 0.36) if wide else 2.2 * count), title) as drawn:
        if wide:
            maps, cuts = drawn.add_gridspec(2, 1, height_ratios=(count, 1.0))
            places = [*maps.subgridspec(count, 3), *cuts.subgridspec(1, count)]
        else:
            places = list(drawn.add_gridspec(4 * count, 1))
        axes = [drawn.add_subplot(place) for place in places]
        titles = []
        for name, panels in zip(names, zip(*[iter(axes)] * 3)):
            runs, unit = (comparison.measured, comparison.simulated), f"dB re 1 {QUANTITIES[name][1]}"
            top = max(_top(getattr(run, name), run) for run in runs)
            for axis, run, scale in zip(panels, runs, ("" if wide else unit, unit)):
                _map(axis, run, getattr(run, name), scale, top)
            _difference(panels[2], comparison, name, top)
            for axis in panels[1:] if wide else ():
                axis.set_ylabel("")
            word = SHORT[name] if wide else QUANTITIES[name][0]
            titles += [f"{word}, {which}" for which in ("measured", "simulated", "difference")]
        for axis, name in zip(axes[3 * count:], names):
            _cuts(axis, comparison.measured, name, " measured", linewidth=2.4, alpha=0.45)
            _cuts(axis, comparison.simulated, name, "", linewidth=0.9)
            titles.append("Wide: measured, thin: simulated")
            shown = [pair for pair in zip(*style.entries(axis)) if " measured" not in pair[1]]
            axis.legend([handle for handle, _ in shown], [label for _, label in shown], ncols=2)
        for axis in axes:
            axis.set_xlim(float(along.min()), float(along.max()))
            axis.set_xlabel(over)
        style.panel_titles(axes, titles)
        return style.save(drawn, path)


def draw_shaft_map(axis: Any, orders: Orders) -> None:
    """Draw the map of the shaft torque into an axis."""
    _map(axis, orders, orders.shaft_torque, "dB re 1 N m")


def draw_slip_difference(axis: Any, comparison: OrderComparison) -> None:
    """Draw the difference of the maps of the slip speed into an axis."""
    _difference(axis, comparison, "slip_speed", _top(comparison.measured.slip_speed, comparison.measured))


def plot_spectrum(path: Path, spectrum: Spectrum, title: str = "", width: float = style.PAGE) -> Path:
    """Draw the spectra of slip speed and shaft torque over the crank order."""
    wide = style.wide(width)
    with style.figure(width, (0.42 if wide else 1.4) * width, title) as drawn:
        axes = drawn.subplots(1, 2) if wide else drawn.subplots(2, 1)
        spectrum_panels(axes, spectrum)
        style.panel_titles(axes, ["Spectrum of the slip speed", "Spectrum of the shaft torque"])
        return style.save(drawn, path)


def draw_slip_spectrum(axis: Any, spectrum: Spectrum) -> None:
    """Draw the spectrum of the slip speed into an axis."""
    _spectrum(axis, spectrum, "slip_speed")


def spectrum_panels(axes: Any, spectrum: Spectrum) -> None:
    """Draw both spectra into two axes."""
    for axis, name in zip(axes, QUANTITIES):
        _spectrum(axis, spectrum, name)


def _spectrum(axis: Any, spectrum: Spectrum, name: str) -> None:
    """Draw lines over the order, sub-harmonics in red, or a density; the upper axis is the frequency."""
    values, unit = getattr(spectrum, name), QUANTITIES[name][1]
    order = spectrum.order[1:]
    if values is not None:
        heights = values[1:]
        marked = np.isclose(order[:, None], spectrum.subharmonics[None, :]).any(axis=1)
        top = float(np.nanmax(heights, initial=1e-12))
        for mine, colour, label in ((~marked, style.BLUE, "amplitude"), (marked, style.RED, "sub-harmonic")):
            shown = mine & (heights > top * 10.0**-LINES)
            if shown.any():
                axis.vlines(order[shown], top * 10.0**-LINES, heights[shown], color=colour, linewidth=1.0)
                axis.plot(order[shown], heights[shown], linestyle="none", marker="o", markersize=2.4, color=colour,
                          label=label)
        axis.set(ylabel=f"amplitude ({unit})")
        if marked.any():
            style.legend(axis, loc="upper right")
    else:
        heights = getattr(spectrum, f"{name}_density")[1:]
        top = float(np.nanmax(heights, initial=1e-12))
        axis.plot(order, heights, color=style.BLUE, linewidth=0.7)
        unit = f"({unit})" if "/" in unit or " " in unit else unit
        axis.set(ylabel=f"density ({unit}$^2$/Hz)")
    axis.set(yscale="log", ylim=(top * 10.0**-(LINES if values is not None else 2 * LINES), 3.0 * top),
             xlabel=ORDER, xlim=(0.0, float(order[-1])))
    each = float(spectrum.frequency[-1] / spectrum.order[-1])
    above = axis.secondary_xaxis("top", functions=(lambda x: x * each, lambda x: x / each))
    above.set_xlabel("frequency (rad/s)")
    above.spines["top"].set_visible(True)


def _cuts(axis: Any, orders: Orders, of: str, which: str = "", **look: Any) -> None:
    """Draw the first orders along the run, dB."""
    from tcc_sim.analysis.orders import level

    along, name = _along(orders)
    curves = {order: level(orders.cut(order, of)) for order in orders.cuts}
    top = max(float(np.nanmax(curve)) for curve in curves.values())
    for colour, (order, curve) in zip(style.CYCLE, curves.items()):
        if np.nanmax(curve) >= top - SHOWN:
            axis.plot(along, curve, color=colour, label=f"order {order:g}{which}", **look)
        else:
            style.key(axis, f"order {order:g}{which}, below {top - SHOWN:.0f} dB", linestyle="none")
    word, unit = QUANTITIES[of]
    axis.set(ylabel=f"{word.lower()}, dB re 1 {unit}", xlabel=name, ylim=(top - SHOWN, top + 0.05 * SHOWN))
    if not which:
        style.legend(axis, ncols=2)


def _along(orders: Orders) -> tuple[Floats, str]:
    """Return the values and the name of the axis along the run: the frequency, or the time if the frequency is held."""
    steps = np.diff(orders.frequency)
    least = HELD * float(orders.frequency.mean()) / max(len(steps), 1)
    rises = len(steps) > 0 and bool(np.all(steps > least) or np.all(steps < -least))
    return (orders.frequency, "engine frequency (rad/s)") if rises else (orders.time, TIME)


def _top(amplitude: Floats, orders: Orders) -> float:
    """Return the upper end of the colour scale of a map, dB."""
    from tcc_sim.analysis.orders import level

    return float(5.0 * np.ceil(float(np.nanmax(level(amplitude[:, _shown(orders)]))) / 5.0))


def _shown(orders: Orders) -> Any:
    """Return which orders maps show."""
    return orders.order > 0.25 * orders.per_revolution


def _map(axis: Any, orders: Orders, amplitude: Floats, unit: str, top: float | None = None) -> None:
    """Draw an order map with the two linear modes, and with a colour scale if `unit` is given."""
    from tcc_sim.analysis.orders import level

    along, over = _along(orders)
    shown = _shown(orders)
    levels = level(amplitude[:, shown]).T
    top = _top(amplitude, orders) if top is None else top
    image = axis.pcolormesh(along, orders.order[shown], levels, cmap="magma", vmin=top - SHOWN, vmax=top,
                            shading="nearest", rasterized=True)
    if unit:
        axis.figure.colorbar(image, ax=axis, label=unit, pad=0.015, aspect=28,
                             ticks=np.arange(top - SHOWN, top + 1.0, 10.0))
    axis.grid(False)
    lowest, highest = 0.25 * orders.per_revolution, float(orders.order[-1])
    for omega, name in zip(orders.modes, ("stuck", "slipping")):
        order = orders.per_revolution * omega / orders.frequency
        axis.plot(along, np.where((order <= highest) & (order >= lowest), order, np.nan), color="white", lw=0.9,
                  ls=(0, (4, 2)))
        _name_mode(axis, along, order, f"{name}, {frequency(omega, 4)}", (lowest, highest), orders.per_revolution)
    axis.set(xlabel=over, ylabel=ORDER, ylim=(lowest, highest))


def _campbell(axis: Any, orders: Orders, of: str) -> None:
    """Draw the levels over engine speed and frequency, with the orders that are listed and the two linear modes."""
    from tcc_sim.analysis.orders import level

    amplitude, shown, unit = getattr(orders, of), _shown(orders), QUANTITIES[of][1]
    rpm = orders.frequency * UNITS["rpm"][1] / orders.per_revolution
    hertz = np.outer(rpm / 60.0, orders.order[shown])
    top, levels = _top(amplitude, orders), level(amplitude[:, shown])
    highest = 1.05 * max(float(hertz[levels > top - SHOWN].max()), *(0.5 / np.pi * omega for omega in orders.modes))
    image = axis.pcolormesh(np.broadcast_to(rpm[:, None], hertz.shape), hertz, levels, cmap="magma",
                            vmin=top - SHOWN, vmax=top, shading="nearest", rasterized=True)
    axis.figure.colorbar(image, ax=axis, label=f"dB re 1 {unit}", pad=0.015, aspect=20)
    axis.grid(False)
    for omega, name in zip(orders.modes, ("stuck", "slipping")):
        if 0.5 / np.pi * omega < hertz.max():
            axis.axhline(0.5 / np.pi * omega, color="white", lw=0.9, ls=(0, (4, 2)))
            axis.annotate(f"{name}, {0.5 / np.pi * omega:.4g} Hz", (rpm.min(), 0.5 / np.pi * omega), xytext=(4, 2),
                          textcoords="offset points", color="white", fontsize=6.5, bbox=BOX)
    last = int(np.argmax(rpm))
    for order in orders.cuts:
        at = min(float(rpm[last]), 0.94 * 60.0 * highest / order)
        axis.plot([0.0, at], [0.0, order * at / 60.0], color="white", lw=0.5, alpha=0.45, ls=(0, (1, 2)))
        axis.annotate(f"order {order:g}", (at, order * at / 60.0), xytext=(-6, 0), textcoords="offset points",
                      color="white", fontsize=6.5, va="center", ha="right", bbox=BOX)
    axis.set(xlabel="engine speed (rpm)", ylabel="frequency (Hz)", xlim=(rpm.min(), rpm.max()), ylim=(0.0, highest))


def _name_mode(axis: Any, along: Floats, order: Floats, text: str, within: tuple[float, float], each: float) -> None:
    """Name a mode beside its line, inside the map and between the lines of the orders."""
    low, high = within
    place = (along - along.min()) / max(float(np.ptp(along)), 1e-300)
    inside = (order > low + 0.03 * (high - low)) & (order < high - 0.1 * (high - low)) & (place > 0.02) & (place < 0.6)
    if not inside.any():
        inside = (order >= low) & (order <= high)
    if not inside.any():
        return
    between = np.abs((order / each + 0.5) % 1.0 - 0.5)  # Distance to the nearest order line, in multiples.
    at = int(np.argmax(np.where(inside, between - 0.05 * place, -1.0)))
    axis.annotate(text, (along[at], order[at]), xytext=(4, 0), color="white", textcoords="offset points",
                  fontsize=6.5, va="center", bbox=BOX)


def _difference(axis: Any, comparison: OrderComparison, name: str, top: float) -> None:
    """Draw a map of the simulated minus the measured level, blank where both are below the range of the maps."""
    from tcc_sim.analysis.orders import level

    along, over = _along(comparison.measured)
    shown = _shown(comparison.measured)
    one, other = (level(getattr(run, name)[:, shown]).T for run in (comparison.measured, comparison.simulated))
    apart = np.ma.masked_where(~(np.maximum(one, other) >= top - SHOWN), other - one)
    image = axis.pcolormesh(along, comparison.measured.order[shown], apart, cmap="RdBu_r", vmin=-DIFFERENCE,
                            vmax=DIFFERENCE, shading="nearest", rasterized=True)
    axis.figure.colorbar(image, ax=axis, pad=0.015, aspect=28,
                         label=f"simulated less measured, dB;\nblank below {top - SHOWN:.0f} dB")
    axis.grid(False)
    axis.set(xlabel=over, ylabel=ORDER,
             ylim=(0.25 * comparison.measured.per_revolution, float(comparison.measured.order[-1])))
