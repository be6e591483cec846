"""Panels of sweeps: maxima and orbit diagram over one key, or a map over two; for scattered keys, bands of quantiles
over another key, or every result over every scattered key; of a gain map, settling time and peak of each loop.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.trajectory import Floats
from tcc_sim.views import style
from tcc_sim.views.panels import Panel
from tcc_sim.views.style import AxisQuantity, quantities

Bools = NDArray[np.bool_]
NOT_FOUND = "#B0B0B0"
"""Colours in a map: of a motion without period, and of a failed solve."""
PURE_STICK, RUNAWAY = -1, -2
"""Values in a map in place of a period: for pure stick, and for runaway slip."""
REGIMES = {"stick": style.GREY, "stick-slip": style.BLUE, "slip": style.GREEN, "runaway": style.RUNAWAY}
RESULTS = (("max_slip_speed", style.MAX_SLIP, 1.0), ("stick_fraction", AxisQuantity("stick", "%"), 100.0),
           ("clutch_energy", AxisQuantity("clutch energy", "J"), 1.0))
"""Results drawn for scattered keys, with their quantities, and factors to the units of these."""
OF_MANOEUVRE = (RESULTS[0], ("max_shaft_torque", AxisQuantity("max shaft torque", "N m"), 1.0), RESULTS[2],
                ("judder_rms", AxisQuantity("judder, rms", "rad/s"), 1.0))
"""The same for scenes with profiles in time."""
JUMP, SHARPER = 0.05, 4.0
"""A line has a gap between neighbours that differ by more than JUMP of the curve's range and more than SHARPER times
the median difference of the two pairs on either side.
"""
SETTLING = "settling_time"
DOTS: dict[str, Any] = {"linestyle": "none", "marker": "o", "markeredgewidth": 0.0}


def sweep_panels(values: Mapping[str, Any], transient: str = "") -> list[Panel]:
    """Return maxima, the orbit diagram (plate angle on the section) and the time in stick over one key.

    transient : name of maxima that have not settled; by default with their number
    """
    x, over = numbers(values["values"]), style.quantity_of(values["over"])
    size = 3.0 if len(x) <= 80 else 2.0 if len(x) <= 300 else 1.2
    away, open_ = flags(values.get("runaway"), x.shape), flags(values.get("transient"), x.shape)

    def maxima(axis: Any) -> None:
        largest = numbers(values["max_slip_speed"])
        bounded = np.where(away, np.nan, largest)
        top = float(np.nanmax(bounded, initial=0.0)) or 1.0
        axis.plot(*parted(x, bounded), color=style.GREY, linewidth=0.6, zorder=1)
        for regime, (colour, mine) in classes(values["regime"], away).items():
            # The size of a runaway depends on the solved time only: it is drawn at the edge and does not set the scale.
            marked = {"marker": "^", "markersize": 1.6 * size} if regime == "runaway" else {"markersize": size}
            axis.plot(x[mine], np.full(int(mine.sum()), 1.08 * top) if regime == "runaway" else largest[mine],
                      **{**DOTS, **marked}, color=colour, label=regime)
        draw_open(axis, x, largest, open_, size, transient)
        wrong = ~np.isfinite(largest)
        if wrong.any():
            axis.plot(x[wrong], np.zeros(int(wrong.sum())), linestyle="none", marker="x", color=style.RED,
                      label="failed", clip_on=False)
        if len(x) > 1:
            margin = 0.01 * np.ptp(x)  # So that no marker is cut.
            axis.set_xlim(np.nanmin(x) - margin, np.nanmax(x) + margin)
        axis.set_ylim(-0.03 * top, (1.13 if away.any() else 1.05) * top)

    def orbit(axis: Any) -> None:
        """Draw the section points: one per cycle of the period, or all stored ones without a period."""
        kinds = np.where(open_, 2, np.where(np.array(values["period"], dtype=object).astype(bool), 0, 1))
        for kind, (colour, name) in enumerate(((style.BLUE, "periodic"), (style.RED, "no period up to 16"),
                                               (style.GREY, "not settled"))):
            points = [(place, point[0]) for place, section, mine, runs in zip(
                x, values["section"], kinds, away, strict=True) if mine == kind and not runs for point in section or ()]
            if points:
                axis.plot(*zip(*points), **DOTS, markersize=max(0.7 * size, 1.0), color=colour, label=name,
                          rasterized=len(points) > 5000)
        axis.margins(y=0.1)
        axis.set_ylim(style.widened(axis.get_ylim()))  # A motion that stays the same is no diagram of rounding.

    def curve(axis: Any, name: str, factor: float) -> None:
        axis.plot(*parted(x, factor * numbers(values[name])), **{**DOTS, "linestyle": "-"}, markersize=size,
                  color=style.BLUE, linewidth=0.9)
        if name == "stick_fraction":
            axis.set_ylim(-4.0, 104.0)

    def exponents(axis: Any) -> None:
        middle, low, high = (numbers([(one or {}).get(name) for one in values["lyapunov"]])
                             for name in ("exponent", "low", "high"))
        axis.axhline(0.0, color=style.INK, linewidth=0.6, zorder=1)
        axis.vlines(x, low, high, color=style.SKY, linewidth=1.0)
        axis.plot(x, middle, **DOTS, markersize=size, color=style.BLUE)

    stick, energy = (partial(curve, name=name, factor=factor) for name, _, factor in RESULTS[1:])
    return [Panel("Maxima", maxima, 1.9, over, style.MAX_SLIP),
            Panel("Heat", energy, 1.9, over, RESULTS[2][1], over=True) if values.get("varying") else
            Panel("Orbit diagram", orbit, 1.9, over, AxisQuantity("plate angle on section", "rad"),
                  over=True),  # A manoeuvre has no orbit.
            Panel("Time in stick", stick, 1.5, over, RESULTS[1][1], over=True),
            *([Panel("Largest Lyapunov exponent", exponents, 1.6, over, AxisQuantity("exponent", "1/s"), over=True)]
              if values.get("lyapunov") else [])]


def draw_open(axis: Any, x: Floats, y: Floats, which: Bools, size: float, name: str = "") -> None:
    """Draw transients as open circles, because they are no steady states."""
    if which.any():
        axis.plot(x[which], y[which], linestyle="none", marker="o", markersize=size, markerfacecolor="white",
                  markeredgecolor=style.INK, markeredgewidth=0.6, label=name or f"not settled ({which.sum()})",
                  clip_on=False)


def flags(values: Any, shape: tuple[int, ...]) -> Bools:
    """Return a yes or no for each motion: no where it is not known, and for all if a JSON lacks the values."""
    return np.zeros(shape, dtype=bool) if not values else np.array(values, dtype=object).astype(bool)


def grid_panels(values: Mapping[str, Any]) -> list[Panel]:
    """Return maps of the largest slip speed and of the period over two keys; the second key is vertical.

    Runaways have a separate colour; cells that have not settled are hatched, because they are no steady states.
    """
    x, y = numbers(values["values"]), numbers(values["second_values"])
    shape = len(y), len(x)
    away, transient = flags(values.get("runaway"), shape), flags(values.get("transient"), shape)

    def hatch(axis: Any) -> None:
        from matplotlib.collections import PolyCollection

        sides, rows = edges(x), edges(y)
        cells = [[(sides[j], rows[k]), (sides[j + 1], rows[k]), (sides[j + 1], rows[k + 1]), (sides[j], rows[k + 1])]
                 for k, j in np.argwhere(transient)]
        axis.add_collection(PolyCollection(cells, hatch="////", facecolor="none", edgecolor=style.GREY, linewidth=0.0))
        axis.set_facecolor(NOT_FOUND)
        axis.grid(False)

    def largest(axis: Any) -> None:
        speeds = numbers(values["max_slip_speed"])
        shade = axis.pcolormesh(edges(x), edges(y), np.ma.masked_invalid(np.where(away, np.nan, speeds)),
                                cmap="viridis", vmin=0.0, rasterized=True)
        quantities(axis.figure.colorbar(shade, ax=axis).ax, None, style.MAX_SLIP)
        if away.any():
            draw_cells(axis, x, y, np.where(away, 0.0, np.nan), [style.RUNAWAY])
        for shown, name, look in (
                (away, "runaway", {"facecolor": style.RUNAWAY}),
                (~away & ~np.isfinite(speeds), "failed", {"facecolor": NOT_FOUND}),
                (transient, f"hatched: {transient.sum()} of {speeds.size} have not settled",
                 {"facecolor": "none", "hatch": "////"})):
            if shown.any():
                style.key(axis, name, area=True, edgecolor=style.GREY, **look)
        hatch(axis)

    def periods(axis: Any) -> None:
        """Draw a colour for each period, dark without a period, light for pure stick."""
        period = numbers(values["period"])
        period[np.array([[regime == "stick" for regime in row] for row in values["regime"]])] = PURE_STICK
        period[away] = RUNAWAY
        found = sorted({int(p) for p in period[np.isfinite(period)].ravel()}) or [0]
        looks = {PURE_STICK: ("stick", style.STICK), RUNAWAY: ("runaway", style.RUNAWAY),
                 0: ("none", style.colour_of(0))}
        names, colours = zip(*(looks.get(p, (str(p), style.colour_of(p))) for p in found))
        place = np.where(np.isfinite(period), np.searchsorted(found, period), np.nan)
        shade = draw_cells(axis, x, y, place, colours)
        bar = axis.figure.colorbar(shade, ax=axis, ticks=range(len(found)), label="period (periods of excitation)")
        bar.ax.set_yticklabels(names)
        bar.ax.minorticks_off()
        hatch(axis)

    keys = style.quantity_of(values["over"]), style.quantity_of(values["second_over"])
    return [Panel("Maxima", largest, 2.7, *keys), Panel("Period", periods, 2.7, *keys, beside=True, named=False)]


def scatter_panels(values: Mapping[str, Any]) -> list[Panel]:
    """Return bands between the outer quantiles over the swept key, or without one samples over each scattered key."""
    over, keys, shares = values.get("over", ""), list(values["scatter"])[:4], values["probabilities"]

    def band(axis: Any, name: str, key: str, scale: float) -> None:
        x, percentiles = numbers(values["values"]), [100.0 * p for p in shares]
        rows = scale * numbers(values["quantiles"][name]).T
        if len(percentiles) > 1:
            axis.fill_between(x, rows[0], rows[-1], color=style.SKY, alpha=0.45, linewidth=0.0,
                              label=f"{percentiles[0]:g} to {percentiles[-1]:g} %")
        for share, row in zip(percentiles, rows, strict=True):
            if len(percentiles) == 1 or share not in (percentiles[0], percentiles[-1]):
                axis.plot(x, row, color=style.BLUE, linewidth=1.1, label="median" if share == 50.0 else f"{share:g} %")
        if len(x) > 1:
            axis.set_xlim(x.min(), x.max())

    def samples(axis: Any, name: str, key: str, scale: float) -> None:
        x, y = numbers(values["sampled"][key]), scale * numbers(values[name])
        for regime, (colour, mine) in classes(values["regime"], flags(values["runaway"], x.shape)).items():
            axis.plot(x[mine], y[mine], **DOTS, markersize=2.4, color=colour, label=regime)
        if not values.get("varying"):   # A manoeuvre does not settle.
            draw_open(axis, x, y, flags(values["transient"], x.shape), 2.4)
        for level, share in zip(scale * numbers(values["quantiles"][name]), shares, strict=True):
            axis.axhline(level, color=style.INK, linewidth=0.8, linestyle="-" if share == 0.5 else ":",
                         label="median" if share == 0.5 else f"{100.0 * share:g} %")

    def draw(axis: Any, name: str, key: str, scale: float) -> None:
        (band if over else samples)(axis, name, key, scale)
        axis.locator_params(axis="x", nbins=9 if len(keys) < 2 else 4)

    return [Panel("" if k else quantity.name.capitalize(), partial(draw, name=name, key=key, scale=scale), 1.7,
                  style.quantity_of(key), quantity, beside=k > 0, over=n > 0, named=n == k == 0)
            for n, (name, quantity, scale) in enumerate(OF_MANOEUVRE if values.get("varying") else RESULTS)
            for k, key in enumerate([over] if over else keys)]


def gain_panels(values: Mapping[str, Any]) -> list[Panel]:
    """Return maps, or curves over a single parameter, of the settling time and of the peak: the size of the peak
    deviation, or the overshoot where there is none. Loops that have not settled are marked.
    """
    over_two, x = values.get("second_over") is not None, numbers(values["values"])

    def figures(name: str) -> Floats:
        """Return the size of a figure per loop, (n,) or (second, first); NaN for an unknown one."""
        return np.abs(numbers(values[name]))

    def curve(axis: Any, name: str) -> None:
        y, settled = figures(name), np.array([verdict == "settled" for verdict in values["verdict"]])
        axis.plot(x, y, color=style.GREY, linewidth=0.8, zorder=1)
        axis.plot(x[settled], y[settled], **DOTS, markersize=3.0, color=style.BLUE, label="settled")
        others = ~settled & (np.isfinite(y) | (name == SETTLING))
        draw_open(axis, x, np.where(np.isfinite(y), y, 0.0), others, 3.0, "not settled")
        axis.set_ylim(bottom=min(0.0, axis.get_ylim()[0]))

    def cells(axis: Any, name: str) -> None:
        figure, sides = figures(name), []
        for side, centres in (("x", x), ("y", numbers(values["second_values"]))):
            even = len(centres) > 2 and min(centres) > 0.0 and np.ptp(np.diff(np.log(centres))) < 1e-6
            sides.append(np.exp(edges(np.log(centres))) if even else edges(centres))
            axis.set(**{f"{side}scale": "log" if even else "linear"})
        shade = axis.pcolormesh(*sides, np.ma.masked_invalid(figure), cmap="viridis", rasterized=True)
        quantities(axis.figure.colorbar(shade, ax=axis).ax, None, shown[name])
        if not np.isfinite(figure).all() and name == SETTLING:
            style.key(axis, f"not settled ({(~np.isfinite(figure)).sum()} of {figure.size})", area=True,
                      facecolor=NOT_FOUND, edgecolor=style.GREY)
        axis.set_facecolor(NOT_FOUND)
        axis.grid(False)

    peak = "peak_deviation" if np.isfinite(figures("peak_deviation")).any() else "overshoot"
    shown = {SETTLING: AxisQuantity("settling time", "s"), peak: AxisQuantity(peak.replace("_", " "), "rad/s")}
    over, second = style.quantity_of(values["over"]), style.quantity_of(values["second_over"]) if over_two else None
    draw = cells if over_two else curve
    return [Panel("Settling", partial(draw, name=SETTLING), 2.7, over, second or shown[SETTLING]),
            Panel("Peak", partial(draw, name=peak), 2.7, over, second or shown[peak], beside=over_two,
                  over=not over_two, named=not over_two)]


def classes(regimes: Sequence[str | None], away: Bools) -> dict[str, tuple[str, Bools]]:
    """Return the colour and the motions of every regime that occurs; runaways are a separate regime."""
    names = ["runaway" if runs else name for name, runs in zip(regimes, away, strict=True)]
    points = {regime: (colour, np.array([name == regime for name in names])) for regime, colour in REGIMES.items()}
    return {regime: look for regime, look in points.items() if look[1].any()}


def parted(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return a curve with NaN inserted at its jumps."""
    change = np.abs(np.diff(y))
    padded = np.pad(change, 2, constant_values=np.nan)
    neighbours = np.ma.masked_invalid([padded[k:k + len(change)] for k in (0, 1, 3, 4)])
    around = np.ma.median(neighbours, axis=0).filled(np.nan)  # type: ignore[no-untyped-call]
    span = float(np.nanmax(y) - np.nanmin(y)) if np.isfinite(y).any() else 0.0
    jumps = np.flatnonzero((change > JUMP * span) & (change > SHARPER * around)) + 1
    return np.insert(x, jumps, np.nan), np.insert(y, jumps, np.nan)


def numbers(values: Sequence[Any]) -> Floats:
    """Return values, or rows of them, with NaN for missing ones."""
    return np.array(values, dtype=np.float64)


def draw_cells(axis: Any, x: Floats, y: Floats, classes: Floats, colours: Sequence[Any]) -> Any:
    """Draw a map in which every cell has the colour of its class, and return its mesh, for a colour bar.

    x, y : (n,) and (m,) centres of the cells
    classes : (m, n) numbers into `colours`; a cell with NaN is not painted
    """
    from matplotlib.colors import BoundaryNorm, ListedColormap

    norm = BoundaryNorm(np.arange(len(colours) + 1) - 0.5, len(colours))
    axis.grid(False)
    return axis.pcolormesh(edges(x), edges(y), np.ma.masked_invalid(classes), cmap=ListedColormap(colours),
                           rasterized=True, norm=norm)


def edges(centres: Floats) -> Floats:
    """Return the borders of cells around centres, (n + 1,); a single cell is as wide as its centre is large."""
    if len(centres) == 1:
        half = 0.5 * abs(float(centres[0])) or 0.5
        return np.array([centres[0] - half, centres[0] + half])
    middle = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[centres[0] - (middle[0] - centres[0])], middle, [centres[-1] + (centres[-1] - middle[-1])]])
