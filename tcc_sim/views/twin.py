"""A digital twin as a picture: simulated and recorded slip speed at the start and the end, and their difference."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.views import style

CYCLES = 8
"""Engine cycles that are shown of the start and of the end."""


def draw_twin(path: Path, found: Any, title: str = "", width: float = style.PAGE) -> Path:
    """Draw a simulation beside a recording: its start, its end, and the difference of all of it."""
    span = CYCLES * found.trajectory.cycle
    begin, end = found.t[0], found.t[-1]
    with style.figure(width, 0.75 * width) as drawn:
        axes = drawn.subplots(3, 1)
        for axis, low, high in ((axes[0], begin, min(begin + span, end)), (axes[1], max(end - span, begin), end)):
            into(axis, found, low, high)
        style.legend_above(axes[0])
        axes[2].plot(found.t, found.difference, color=style.RED, linewidth=0.7)
        axes[2].set(xlabel="time (s)", ylabel="difference (rad/s)")
        axes[2].set_xlim(begin, end)
        drawn.suptitle(f"{title}: {found}" if title else str(found), x=0.01, ha="left", fontsize=10.0)
        style.panel_titles(axes, ["Start", "End", "Simulated less recorded"])
        return style.save(drawn, path)


def into(axis: Any, found: Any, low: float = -np.inf, high: float = np.inf) -> None:
    """Draw both slip speeds of some time into an axis."""
    run = found.trajectory
    for t, slip, look in ((found.t, found.slip_speed, {"color": style.GREY, "linewidth": 2.4, "label": "recorded"}),
                          (run.t, run.slip_speed, {"color": style.BLUE, "linewidth": 0.9, "label": "simulated"})):
        shown = (t >= low) & (t <= high)
        axis.plot(t[shown], slip[shown], **look)
    axis.set(xlabel="time (s)", ylabel="slip speed (rad/s)")
