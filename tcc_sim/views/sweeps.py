"""Panels of sweeps: maxima and orbit diagram over one key, or a map over two; for scattered keys, bands of quantiles
over another key, or every result over every scattered key.
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


def sweep_panels(values: Mapping[str, Any]) -> list[Panel]:
    """Return maxima, the orbit diagram (plate angle on the section) and the time in stick over one key."""
    x, over = numbers(values["values"]), style.quantity_of(values["over"])

    def curve(axis: Any, name: str, factor: float, quantity: AxisQuantity) -> None:
        axis.plot(*parted(x, factor * numbers(values[name])), color=style.BLUE, marker="o", markersize=_size(len(x)),
                  markeredgewidth=0.0, linewidth=0.9)
        if name == "stick_fraction":
            axis.set_ylim(-4.0, 104.0)
        quantities(axis, over, quantity)

    def orbit(axis: Any) -> None:
        _orbit(axis, x, values)
        quantities(axis, over, AxisQuantity("plate angle on section", "rad"))

    exponents = [Panel("Largest Lyapunov exponent", partial(_exponents, x=x, values=values), over=True)]
    return [Panel("Maxima", partial(_maxima, values=values), 1.9),
            Panel("Heat", partial(curve, name="clutch_energy", factor=1.0, quantity=RESULTS[2][1]), 1.9, over=True)
            if values.get("varying") else  # A manoeuvre has no orbit.
            Panel("Orbit diagram", orbit, 1.9, over=True),
            Panel("Time in stick", partial(curve, name="stick_fraction", factor=100.0, quantity=RESULTS[1][1]), 1.5,
                  over=True), *(exponents if values.get("lyapunov") else [])]


def _exponents(axis: Any, x: Floats, values: Mapping[str, Any]) -> None:
    middle, low, high = (numbers([(one or {}).get(name) for one in values["lyapunov"]])
                         for name in ("exponent", "low", "high"))
    axis.axhline(0.0, color=style.INK, linewidth=0.6, zorder=1)
    axis.vlines(x, low, high, color=style.SKY, linewidth=1.0)
    axis.plot(x, middle, linestyle="none", marker="o", markersize=_size(len(x)), markeredgewidth=0.0, color=style.BLUE)
    quantities(axis, style.quantity_of(values["over"]), AxisQuantity("exponent", "1/s"))


def _maxima(axis: Any, values: Mapping[str, Any]) -> None:
    quantities(axis, style.quantity_of(values["over"]), style.MAX_SLIP)
    x, largest = numbers(values["values"]), numbers(values["max_slip_speed"])
    regimes = classes(values["regime"], values.get("runaway", []))
    away = regimes["runaway"][1] if "runaway" in regimes else np.zeros(len(x), dtype=bool)
    bounded = np.where(away, np.nan, largest)
    top = float(np.nanmax(bounded, initial=0.0)) or 1.0
    axis.plot(*parted(x, bounded), color=style.GREY, linewidth=0.6, zorder=1)
    open_ = transients(values["regime"], values.get("transient"))
    for regime, (colour, mine) in regimes.items():
        # The size of a runaway depends on the solved time only: it is drawn at the edge and does not set the scale.
        axis.plot(x[mine], np.full(int(mine.sum()), 1.08 * top) if regime == "runaway" else largest[mine],
                    linestyle="none", marker="^" if regime == "runaway" else "o", color=colour, label=regime,
                    markeredgewidth=0.0, markersize=_size(len(x)) * (1.6 if regime == "runaway" else 1.0))
    draw_open(axis, x, largest, open_, _size(len(x)))
    wrong = ~np.isfinite(largest)
    if wrong.any():
        axis.plot(x[wrong], np.zeros(int(wrong.sum())), linestyle="none", marker="x", color=style.RED, label="failed",
                  clip_on=False)
    if len(x) > 1:
        margin = 0.01 * np.ptp(x)  # So that no marker is cut.
        axis.set_xlim(np.nanmin(x) - margin, np.nanmax(x) + margin)
    axis.set_ylim(-0.03 * top, (1.13 if away.any() else 1.05) * top)


def draw_open(axis: Any, x: Floats, y: Floats, which: Bools, size: float) -> None:
    """Draw transients as open circles, because they are no steady states."""
    if which.any():
        axis.plot(x[which], y[which], linestyle="none", marker="o", markersize=size, markerfacecolor="white",
                  markeredgecolor=style.INK, markeredgewidth=0.6, label=f"not settled ({which.sum()})")


def transients(regimes: Sequence[object], transient: Sequence[bool | None] | None) -> Bools:
    """Return which motions have not settled; none if a JSON lacks this."""
    return np.array([bool(x) for x in transient or [False] * len(regimes)], dtype=bool)


def _orbit(axis: Any, x: Floats, values: Mapping[str, Any]) -> None:
    """Draw the section points over the key: one per cycle of the period, or all stored ones without a period."""
    periods = values["period"]
    away = values.get("runaway") or [False] * len(x)
    settling = transients(periods, values.get("transient"))
    kinds = np.where(settling, 2, np.where(np.array(periods, dtype=object).astype(bool), 0, 1))
    for kind, (colour, name) in enumerate(((style.BLUE, "periodic"), (style.RED, "no period up to 16"),
                                           (style.GREY, "not settled"))):
        places, angles = [], []
        for place, section, mine, runs in zip(x, values["section"], kinds, away, strict=True):
            if section and mine == kind and not runs:
                places += [place] * len(section)
                angles += [point[0] for point in section]
        if angles:
            axis.plot(places, angles, linestyle="none", marker="o", markersize=max(0.7 * _size(len(x)), 1.0),
                      markeredgewidth=0.0, color=colour, label=name, rasterized=len(angles) > 5000)
    axis.margins(y=0.1)
    axis.set_ylim(style.widened(axis.get_ylim()))  # A motion that stays the same is no diagram of rounding.


def grid_panels(values: Mapping[str, Any]) -> list[Panel]:
    """Return maps of the largest slip speed and of the period over two keys; the second key is vertical."""
    return [Panel("Maxima", partial(_largest, values=values), 2.7),
            Panel("Period", partial(_period_map, values=values), 2.7, beside=True, named=False)]


def _largest(axis: Any, values: Mapping[str, Any]) -> None:
    """Draw a map of the largest slip speed over two keys; runaways have a separate colour, and cells are hatched that
    have not settled.
    """
    x, y = numbers(values["values"]), numbers(values["second_values"])
    largest = np.array([numbers(row) for row in values["max_slip_speed"]])
    away = runaways(values)
    shade = axis.pcolormesh(edges(x), edges(y), np.ma.masked_where(away | ~np.isfinite(largest), largest),
                            cmap="viridis", vmin=0.0, rasterized=True)
    quantities(axis.figure.colorbar(shade, ax=axis).ax, None, style.MAX_SLIP)
    if away.any():
        draw_cells(axis, x, y, np.where(away, 0.0, np.nan), [style.RUNAWAY])
        style.key(axis, "runaway", area=True, facecolor=style.RUNAWAY, edgecolor=style.GREY)
    if (~away & ~np.isfinite(largest)).any():
        style.key(axis, "failed", area=True, facecolor=NOT_FOUND, edgecolor=style.GREY)
    if count := hatch(axis, x, y, values):
        style.key(axis, f"hatched: {count} of {largest.size} have not settled", area=True, facecolor="none",
                  edgecolor=style.GREY, hatch="////")
    name_two_keys(axis, values)


def hatch(axis: Any, x: Floats, y: Floats, values: Mapping[str, Any]) -> int:
    """Hatch the cells of transients, which are no steady states; return their number."""
    which = np.array([transients(row, values["transient"][k] if "transient" in values else None)
                      for k, row in enumerate(values["regime"])])
    from matplotlib.collections import PolyCollection

    sides, rows = edges(x), edges(y)
    cells = [[(sides[j], rows[k]), (sides[j + 1], rows[k]), (sides[j + 1], rows[k + 1]), (sides[j], rows[k + 1])]
             for k, j in np.argwhere(which)]
    axis.add_collection(PolyCollection(cells, hatch="////", facecolor="none", edgecolor=style.GREY, linewidth=0.0))
    return len(cells)


def name_two_keys(axis: Any, values: Mapping[str, Any]) -> None:
    """Name both keys of a map, whose empty cells are grey."""
    axis.set_facecolor(NOT_FOUND)
    axis.grid(False)
    quantities(axis, style.quantity_of(values["over"]), style.quantity_of(values["second_over"]))


def _period_map(axis: Any, values: Mapping[str, Any]) -> None:
    """Draw a map of the periods: a colour for each, dark without a period, light for pure stick."""
    x, y = numbers(values["values"]), numbers(values["second_values"])
    period = np.array([numbers(row) for row in values["period"]])
    period[np.array([[regime == "stick" for regime in row] for row in values["regime"]])] = PURE_STICK
    period[runaways(values)] = RUNAWAY
    periods = sorted({int(p) for p in period[np.isfinite(period)].ravel()}) or [0]
    looks = {PURE_STICK: ("stick", style.STICK), RUNAWAY: ("runaway", style.RUNAWAY), 0: ("none", style.colour_of(0))}
    colours = [looks[p][1] if p in looks else style.colour_of(p) for p in periods]
    place = np.full(period.shape, np.nan)
    for number, p in enumerate(periods):
        place[period == p] = number
    shade = draw_cells(axis, x, y, place, colours)
    bar = axis.figure.colorbar(shade, ax=axis, ticks=range(len(periods)), label="period (periods of excitation)")
    bar.ax.set_yticklabels([looks[p][0] if p in looks else str(p) for p in periods])
    bar.ax.minorticks_off()
    hatch(axis, x, y, values)
    name_two_keys(axis, values)


def scatter_panels(values: Mapping[str, Any]) -> list[Panel]:
    """Return bands of the outer quantiles over the swept key, or without one samples over each scattered key."""
    over, keys = values.get("over", ""), list(values["scatter"])[:4]
    rows = [[partial(draw_band, values=values, name=name, scale=scale)] if over else
            [partial(_samples, values=values, name=name, key=key, scale=scale) for key in keys]
            for name, _, scale in (OF_MANOEUVRE if values.get("varying") else RESULTS)]

    def named(axis: Any, draw: Any, key: str, quantity: AxisQuantity | None) -> None:
        draw(axis)
        axis.locator_params(axis="x", nbins=9 if len(keys) < 2 else 4)
        quantities(axis, style.quantity_of(key), quantity)

    return [Panel(quantity.name.capitalize() if not k else "", partial(
                named, draw=draw, key=key, quantity=quantity), 1.7, beside=k > 0, over=bool(n), named=not n and not k)
            for n, (row, (_, quantity, _)) in enumerate(zip(rows, OF_MANOEUVRE if values.get("varying") else RESULTS))
            for k, (draw, key) in enumerate(zip(row, [over] if over else keys))]


def draw_band(axis: Any, values: Mapping[str, Any], name: str, scale: float = 1.0) -> None:
    """Draw the band between the outer quantiles of one result, and those between them as lines."""
    x, percentiles = numbers(values["values"]), [100.0 * p for p in values["probabilities"]]
    rows = scale * np.array([numbers(row) for row in values["quantiles"][name]]).T
    if len(percentiles) > 1:
        axis.fill_between(x, rows[0], rows[-1], color=style.SKY, alpha=0.45, linewidth=0.0,
                          label=f"{percentiles[0]:g} to {percentiles[-1]:g} %")
    for share, row in zip(percentiles, rows, strict=True):
        if len(percentiles) == 1 or share not in (percentiles[0], percentiles[-1]):
            axis.plot(x, row, color=style.BLUE, linewidth=1.1, label="median" if share == 50.0 else f"{share:g} %")
    if len(x) > 1:
        axis.set_xlim(x.min(), x.max())


def _samples(axis: Any, values: Mapping[str, Any], name: str, key: str, scale: float) -> None:
    x, y = numbers(values["sampled"][key]), scale * numbers(values[name])
    for regime, (colour, mine) in classes(values["regime"], values["runaway"]).items():
        axis.plot(x[mine], y[mine], linestyle="none", marker="o", markersize=2.4, markeredgewidth=0.0,
                  color=colour, label=regime)
    if not values.get("varying"):   # A manoeuvre does not settle.
        draw_open(axis, x, y, transients(values["regime"], values["transient"]), 2.4)
    for level, share in zip(scale * numbers(values["quantiles"][name]), values["probabilities"], strict=True):
        axis.axhline(level, color=style.INK, linewidth=0.8, linestyle="-" if share == 0.5 else ":",
                     label="median" if share == 0.5 else f"{100.0 * share:g} %")


def classes(regimes: Sequence[str | None], runaway: Sequence[bool | None]) -> dict[str, tuple[str, Bools]]:
    """Return the colour and the motions of every regime that occurs; runaways are a separate regime."""
    away = [bool(x) for x in runaway] or [False] * len(regimes)
    names = ["runaway" if runs else name for name, runs in zip(regimes, away, strict=True)]
    points = {regime: (colour, np.array([name == regime for name in names])) for regime, colour in REGIMES.items()}
    return {regime: look for regime, look in points.items() if look[1].any()}


def runaways(values: Mapping[str, Any]) -> Bools:
    """Return (second, first) whether each motion of a grid runs away."""
    rows = values.get("runaway") or [[False] * len(row) for row in values["period"]]
    return np.array([[bool(x) for x in row] for row in rows])


def parted(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return a curve with NaN inserted at its jumps."""
    change = np.abs(np.diff(y))
    padded = np.pad(change, 2, constant_values=np.nan)
    neighbours = np.stack([padded[k:k + len(change)] for k in (0, 1, 3, 4)])
    around = np.array([np.median(column[np.isfinite(column)]) if np.isfinite(column).any() else np.nan
                       for column in neighbours.T])
    span = float(np.nanmax(y) - np.nanmin(y)) if np.isfinite(y).any() else 0.0
    jumps = np.flatnonzero((change > JUMP * span) & (change > SHARPER * around)) + 1
    return np.insert(x, jumps, np.nan), np.insert(y, jumps, np.nan)


def numbers(values: Sequence[Any]) -> Floats:
    """Return values with NaN for missing ones."""
    return np.array([np.nan if v is None else float(v) for v in values], dtype=np.float64)


def draw_cells(axis: Any, x: Floats, y: Floats, classes: Floats, colours: Sequence[Any]) -> Any:
    """Draw a map in which every cell has the colour of its class.

    Parameters
    ----------
    x, y : (n,) and (m,) centres of the cells
    classes : (m, n) numbers into `colours`; a cell with NaN is not painted

    Returns
    -------
    The mesh, for a colour bar.
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


def _size(count: int) -> float:
    return 3.0 if count <= 80 else 2.0 if count <= 300 else 1.2
