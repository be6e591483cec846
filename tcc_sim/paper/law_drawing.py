"""The drawing of Fig. 3: the friction law, its smoothing and its slope."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tcc_sim.views import style


def paint_law(drawn: Any, data: Mapping[str, Any]) -> None:
    """Fig. 3: law, zoom, slope."""
    wide, near, slope = drawn.subplots(1, 3)
    for k, curve in enumerate(data["curves"]):
        colour = style.CYCLE[k]
        wide.plot(data["slip_speed"], curve["coefficient"], color=colour, label=curve["label"])
        near.plot(data["near_slip_speed"], curve["near_coefficient"], color=colour)
        near.plot(data["near_slip_speed"], curve["near_set_valued"], color=colour, linewidth=0.8, linestyle=(0, (3, 2)))
        slope.plot(data["near_slip_speed"], curve["near_slope"], color=colour)
        if curve["peak_slip_speed"] is not None:
            near.plot(curve["peak_slip_speed"], curve["peak"], marker="o", markersize=3.0, color=colour)
    near.plot([], [], color=style.GREY, linewidth=0.8, linestyle=(0, (3, 2)), label="set-valued law (6)")
    near.plot([], [], color=style.GREY, linestyle="none", marker="o", label="maximum of (7)")
    near.set_ylim(0.8, 1.6)
    slope.set_ylim(-1.5, 1.5)
    slope.axhline(0.0, color=style.GREY, linewidth=0.6)
    wide.set_ylabel(r"$\bar\mu$")
    near.set_ylabel(r"$\bar\mu$")
    slope.set_ylabel(r"$\partial\bar\mu/\partial\dot\delta_1$ (s/rad)")
    for axis in (wide, near, slope):
        axis.set_xlabel(r"$\dot\delta_1$ (rad/s)")
        axis.margins(x=0.0)
    handles, labels = wide.get_legend_handles_labels()
    slope.legend(handles, labels, loc="upper right")
    near.legend(loc="lower right")
    style.panel_titles((wide, near, slope), ["smoothed law (7)", "zoom", "slope (20b)"])
