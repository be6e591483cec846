"""The panels of a controller's test: cycle means beside the target, pressures, and marked events, over the whole run.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tcc_sim.analysis.control import Control, Event
from tcc_sim.views import style

MOST_LABELS = 6
"""More events than this are marked without their texts."""
LONGEST_LABEL = 42


def mean_slip_panel(axis: Any, control: Control) -> None:
    """The mean slip speed of every engine cycle, and the target."""
    axis.plot(control.t, control.mean_slip, color=style.BLUE, linewidth=0.9, marker="o", markersize=2.0,
              markeredgewidth=0.0, label="cycle mean")
    if len(control.target.t):
        held = control.target.until(_end(control))
        axis.step(held.t, held.values, where="post", color=style.RED, linewidth=0.9, linestyle=(0, (4, 2)),
                  label="target")
    axis.set_ylabel("slip speed (rad/s)")
    axis.tick_params(labelbottom=False)
    mark_events(axis, control.events, _end(control))
    style.legend_above(axis)


def pressure_panel(axis: Any, control: Control) -> None:
    """Commanded and applied pressure, kPa."""
    end = _end(control)
    for steps, colour, width, name in ((control.applied, style.GREEN, 1.6, "applied"),
                                       (control.command, style.ORANGE, 0.8, "commanded")):
        if len(steps.t):
            held = steps.until(end)
            axis.step(held.t, 1e-3 * held.values, where="post", color=colour, linewidth=width, label=name)
    mark_events(axis, control.events, end, labelled=False)
    axis.set(ylabel="pressure (kPa)", xlabel="time (s)")
    if end > 0.0:
        axis.set_xlim(0.0, end)
    style.legend_above(axis)


def mark_events(axis: Any, events: Sequence[Event], end: float, unit: float = 1.0, labelled: bool = True) -> None:
    """A line at every event with its text; `end` of the run in s, `unit` is what one unit of the axis is in s."""
    for number, event in enumerate(events):
        axis.axvline(event.t / unit, color=style.RED, linewidth=0.8, linestyle=(0, (2, 2)), zorder=0.8,
                     label="event" if number == 0 and len(events) > MOST_LABELS else None)
        if labelled and len(events) <= MOST_LABELS:
            text = event.text if len(event.text) <= LONGEST_LABEL else event.text[:LONGEST_LABEL - 3] + "..."
            late = event.t > 0.5 * end
            axis.annotate(text, (event.t / unit, 0.97 - 0.15 * (number % 3)), (-3.0 if late else 3.0, 0.0),
                          fontsize=6.5,
                          xycoords=("data", "axes fraction"), textcoords="offset points", va="top", color=style.RED,
                          ha="right" if late else "left", bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6})


def _end(control: Control) -> float:
    """The end of what was recorded, s."""
    ends = [steps.t[-1] for steps in (control.target, control.command, control.applied) if len(steps.t)]
    return float(np.max([*ends, *control.t[-1:], 0.0]))
