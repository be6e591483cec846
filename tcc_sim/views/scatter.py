"""Pictures of scattered scene keys: bands of quantiles over another key, or every result against every tolerance."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tcc_sim.sweeps.scatter import Scattered
from tcc_sim.views import style
from tcc_sim.views.sweeps import classes, label_of

RESULTS = (("max_slip_speed", "max |slip speed|\n(rad/s)", 1.0), ("stick_fraction", "stick (%)", 100.0),
           ("clutch_energy", "clutch energy (J)", 1.0))
"""Results drawn, their axes, and the unit of the axis in that of the result."""


def draw_scatter(path: Path, found: Scattered, title: str = "", width: float = style.PAGE) -> Path:
    """Bands of the quantiles 0.05 to 0.95 over the swept key; without one, samples against each scattered key."""
    keys = [] if found.over else [key for key, _, _ in found.tolerances.bounds][:4]
    with style.figure(width, 5.0, title) as drawn:
        axes = drawn.subplots(len(RESULTS), max(len(keys), 1), sharex="col", sharey="row", squeeze=False)
        for row, (name, label, scale) in zip(axes, RESULTS):
            row[0].set_ylabel(label)
            if found.over:
                draw_band(row[0], found, name, scale)
            else:
                for axis, key in zip(row, keys):
                    _samples(axis, found, name, key, scale)
        for axis, key in zip(axes[-1], keys or [found.over]):
            axis.set_xlabel(label_of(key))
        style.legend_above(axes[0][0])
        return style.save(drawn, path)


def into(axis: Any, found: Scattered) -> None:
    """Draw the largest slip speed into an axis: its band over the swept key, or samples against the first scattered."""
    if found.over:
        draw_band(axis, found, "max_slip_speed")
    else:
        _samples(axis, found, "max_slip_speed", found.tolerances.bounds[0][0], 1.0)
    axis.set(xlabel=label_of(found.over or found.tolerances.bounds[0][0]), ylabel="max |slip speed| (rad/s)")


def draw_band(axis: Any, found: Scattered, name: str, scale: float = 1.0) -> None:
    """Median and band of one result."""
    x = found.sweeps[0].values
    low, middle, high = scale * found.quantiles(name).T
    axis.fill_between(x, low, high, color=style.SKY, alpha=0.45, linewidth=0.0, label="5 to 95 %")
    axis.plot(x, middle, color=style.BLUE, linewidth=1.1, label="median")
    if len(x) > 1:
        axis.set_xlim(x.min(), x.max())


def _samples(axis: Any, found: Scattered, name: str, key: str, scale: float) -> None:
    """Samples of one result against one key, with their quantiles."""
    values, y = found.tolerances.values()[key], scale * found.result(name)[:, 0]
    records = [sweep.records[0] or {} for sweep in found.sweeps]
    for regime, (colour, mine) in classes([r.get("regime") for r in records],
                                          [r.get("runaway") for r in records]).items():
        axis.plot(values[mine], y[mine], linestyle="none", marker="o", markersize=2.4, markeredgewidth=0.0,
                  color=colour, label=regime)
    for level, line in zip(scale * found.quantiles(name)[0], (":", "-", ":")):
        axis.axhline(level, color=style.INK, linewidth=0.8, linestyle=line)
