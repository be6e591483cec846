"""The friction law of a scene as a picture: the coefficient over slip speed and close to 0, and the slope."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from tcc_sim.model import friction
from tcc_sim.output.estimates import critical_slope
from tcc_sim.scene import SceneLike, system_of
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.views import style
from tcc_sim.views.panels import Panel
from tcc_sim.views.style import AxisQuantity, quantities

POINTS = 801


def friction_panels(scene: SceneLike) -> list[Panel]:
    """Return the coefficient over slip speed with its table, the law close to 0, and the slope of the friction torque.

    Slip speeds go to the end of the table, or of the decay of the slowest exponential.
    """
    system = system_of(scene)
    law, stick, least = system.friction, stick_speed_of(terms_of(system)), critical_slope(system) or 0.0
    rates = [rate for _, rate in friction.exponentials(law.stribeck) if rate > 0.0]
    far = law.slip_speeds[-1] if law.curve is not None else 7.0 / min(rates) if rates else 10.0 / law.smoothing

    def coefficient(axis: Any, far: float, near: bool = False) -> None:
        """Draw the law up to the speed `far`, with names, or `near` 0, with the end of stick."""
        v = np.linspace(0.0, far, POINTS)
        fitted, smoothed, table = [None] * 3 if near else [
            "fit of the table" if law.curve else "sliding, (6)", "smoothed, (7)", "table"]
        axis.plot(v, np.broadcast_to(law.kinetic * friction.sliding(v, 1.0, law.stribeck), v.shape), color=style.BLUE,
                  label=fitted)
        if law.law == "smoothed":
            axis.plot(v, law.kinetic * friction.smoothed_coefficient(v, law.smoothing, law.stribeck), color=style.RED,
                      linestyle=(0, (4, 2)), label=smoothed)
        if near and stick > 0.0:
            axis.axvline(stick, color=style.GREY, linewidth=0.8, linestyle=(0, (1, 1.5)), label="up to here: stick")
        points = np.array([law.slip_speeds, law.coefficients])
        axis.plot(*points[:, points[0] <= far], "o", color=style.INK, label=table)
        axis.set(ylim=(0.0, None), xlim=(0.0, far))
        quantities(axis, style.SLIP, AxisQuantity("friction coefficient"))

    def slope(axis: Any) -> None:
        v = np.linspace(0.0, far, POINTS)
        slopes = system.saturation_mean * np.broadcast_to(friction.sliding_slope(v, law.stribeck), v.shape)
        axis.plot(v, slopes, color=style.BLUE)
        if least < 0.0:
            axis.axhline(least, color=style.ORANGE, linewidth=0.9, linestyle=(0, (4, 2)),
                         label="critical slope (22), mean pressure")
        if np.abs(slopes).max() > 10.0 * abs(least):
            axis.set_yscale("symlog", linthresh=10.0 ** math.ceil(math.log10(max(abs(least), 1.0))))
        quantities(axis, style.SLIP, AxisQuantity("slope", "N m s/rad"))
        axis.set(xlim=(0.0, far), ylim=(min(1.5 * slopes.min(), 1.5 * least, -1e-3),
                                        max(1.5 * slopes.max(), 0.5 * abs(least), 1e-3)))

    return [Panel("Friction law", partial(coefficient, far=far), 2.2),
            Panel("Close to 0", partial(coefficient, far=3.0 * stick if stick > 0.0 else 0.05 * far, near=True), 2.2,
                  beside=True),
            Panel("Slope of the torque", slope, 2.2, beside=True)]
