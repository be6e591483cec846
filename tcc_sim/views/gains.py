"""Panels of a gain map: settling time and peak over one or two parameters of a control law."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from tcc_sim.views import style
from tcc_sim.views.panels import Panel
from tcc_sim.views.style import AxisQuantity, quantities
from tcc_sim.views.sweeps import NOT_FOUND, edges, name_two_keys, numbers

SETTLING = "settling_time"


def gain_panels(values: Mapping[str, Any]) -> list[Panel]:
    """Return maps, or curves over a single parameter, of the settling time and of the peak: the size of the peak
    deviation, or the overshoot where there is none. Loops that have not settled are marked.
    """
    over_two = values.get("second_over") is not None
    peak = "peak_deviation" if np.isfinite(_figure(values, "peak_deviation")).any() else "overshoot"
    draw = partial(_map if over_two else _curve, values=values)
    return [Panel("Settling", partial(draw, name=SETTLING, quantity=AxisQuantity("settling time", "s")), 2.7),
            Panel("Peak", partial(draw, name=peak, quantity=AxisQuantity(peak.replace("_", " "), "rad/s")), 2.7,
                  beside=over_two, over=not over_two, named=not over_two)]


def _figure(values: Mapping[str, Any], name: str) -> Any:
    """Return the size of a figure per loop, (n,) or (second, first); NaN for an unknown one."""
    rows = values[name] if values.get("second_over") is not None else [values[name]]
    return np.abs(np.array([numbers(row) for row in rows])).squeeze(0 if values.get("second_over") is None else ())


def _curve(axis: Any, values: Mapping[str, Any], name: str, quantity: AxisQuantity) -> None:
    x, y = numbers(values["values"]), _figure(values, name)
    settled = np.array([verdict == "settled" for verdict in values["verdict"]])
    axis.plot(x, y, color=style.GREY, linewidth=0.8, zorder=1)
    axis.plot(x[settled], y[settled], linestyle="none", marker="o", markersize=3.0, color=style.BLUE, label="settled")
    others = ~settled & (np.isfinite(y) | (name == SETTLING))
    if others.any():
        axis.plot(x[others], np.where(np.isfinite(y), y, 0.0)[others], linestyle="none", marker="o", markersize=3.0,
                  markerfacecolor="white", markeredgecolor=style.INK, label="not settled", clip_on=False)
    axis.set_ylim(bottom=min(0.0, axis.get_ylim()[0]))
    quantities(axis, style.quantity_of(values["over"]), quantity)


def _map(axis: Any, values: Mapping[str, Any], name: str, quantity: AxisQuantity) -> None:
    x, y, figure = numbers(values["values"]), numbers(values["second_values"]), _figure(values, name)
    sides = []
    for side, centres in (("x", x), ("y", y)):
        even = len(centres) > 2 and min(centres) > 0.0 and np.ptp(np.diff(np.log(centres))) < 1e-6
        sides.append(np.exp(edges(np.log(centres))) if even else edges(centres))
        axis.set(**{f"{side}scale": "log" if even else "linear"})
    shade = axis.pcolormesh(*sides, np.ma.masked_invalid(figure), cmap="viridis", rasterized=True)
    quantities(axis.figure.colorbar(shade, ax=axis).ax, None, quantity)
    if not np.isfinite(figure).all() and name == SETTLING:
        style.key(axis, f"not settled ({(~np.isfinite(figure)).sum()} of {figure.size})", area=True,
                  facecolor=NOT_FOUND, edgecolor=style.GREY)
    name_two_keys(axis, values)
