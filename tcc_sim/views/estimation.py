"""Panels of `linearise`, a Bode plot with simulated points, of `identify`, measured and fitted speeds, residuals and
intervals of the parameters, and of a friction law, its coefficient over slip speed and close to 0, and its slope.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from tcc_sim.model import friction
from tcc_sim.output.estimates import critical_slope
from tcc_sim.scene import SceneLike, system_of
from tcc_sim.shown_units import speed
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.topics import topic
from tcc_sim.trajectory import Floats
from tcc_sim.views import style
from tcc_sim.views.panels import Panel
from tcc_sim.views.stored import Record
from tcc_sim.views.style import AxisQuantity
from tcc_sim.views.sweeps import numbers

SHOWN, POINTS = 400, 801
"""Number of samples of measured and fitted speeds in the picture, and of points of a friction law."""
COEFFICIENT = AxisQuantity("friction coefficient")


def bode(values: Mapping[str, Any]) -> list[Panel]:
    """Return gain and phase of the frequency response of `linearise`, a result or its JSON."""
    gain, kind = numbers(values["gain"]), values["kind"]
    unit = f"dB re 1 ({topic(values['output']).unit})/({topic(values['input']).unit})"
    name = "harmonic transfer function" if kind == "periodic" else f"linear model about constant {kind}"
    about = (f"{values['output']} by {values['input']}".replace("_", " ") + ", mean slip "
             + speed(values["operating_point"]["mean_slip"], 4))

    def curve(axis: Any, y: Floats) -> None:
        axis.semilogx(values["frequencies"], y, label=name)

    decibels, degrees = 20.0 * np.log10(np.where(gain > 0.0, gain, np.nan)), np.degrees(numbers(values["phase"]))
    return [Panel(about, partial(curve, y=decibels), 2.3, style.FREQUENCY, AxisQuantity("gain", unit)),
            Panel("phase", partial(curve, y=degrees), 2.0, style.FREQUENCY, AxisQuantity("phase", "degrees"),
                  over=True, named=False)]


def identification(document: Any) -> list[Panel]:
    """Return the fit of `identify`, its residuals and parameters; for JSON, which has no samples, only the parameters.
    """
    document = Record.of(document) if isinstance(document, Mapping) else document
    residuals, measured, curve = document.residuals or {}, document.measurement, document.curve

    def fit(axis: Any) -> None:
        residual = residuals["slip_speed"]
        data, t = measured.channels["slip_speed"][:len(residual)], measured.t[:len(residual)]
        axis.plot(t[:SHOWN], data[:SHOWN], linestyle="none", marker=".", color=style.GREY, label="measured")
        axis.plot(t[:SHOWN], (data + residual)[:SHOWN], color=style.BLUE, label="fitted")

    def residual(axis: Any, name: str) -> None:
        values = residuals[name] / document.noise[name]
        axis.plot(measured.t[:len(values)], values, color=style.GREY, linewidth=0.5)

    def friction(axis: Any) -> None:
        v = curve.slip_speeds
        axis.fill_between(v, curve.low, curve.high, color=style.BLUE, alpha=0.25, linewidth=0.0, label="95 % band")
        axis.plot(v, curve.coefficient, color=style.BLUE, label="found")
        axis.plot(v, curve.scene, color=style.RED, linestyle=(0, (4, 2)), label="scene")
        seen = np.asarray(curve.visited)
        between = ~(seen & np.append(seen[1:], True)) | ~np.append(True, seen[:-1])  # Up to the next visited speeds.
        axis.fill_between(v, 0.0, 1.0, where=between, transform=axis.get_xaxis_transform(), color=style.GREY, alpha=0.2,
                          linewidth=0.0, label="not visited")
        axis.set_xlim(0.0, v[-1])

    def likelihood(axis: Any) -> None:
        axis.plot(document.likelihood.values, document.likelihood.excess, marker="o")
        axis.axhline(3.84, color=style.RED, linewidth=0.8, label="95 %")

    def parameters(axis: Any) -> None:
        found = document.parameters
        sizes = np.array([abs(p.start) if p.start else max(abs(p.value), 1e-300) for p in found])
        values, errors = (100.0 * np.array(each) / sizes for each in (
            [p.value - p.start for p in found], [p.high - p.value for p in found]))
        errors[~np.isfinite(errors)] = np.nan   # Drawn without a bar.
        axis.errorbar(values, np.arange(len(found)), xerr=errors, linestyle="none", marker="o", capsize=3.0)
        axis.axvline(0.0, color=style.INK, linewidth=0.7)
        axis.set_yticks(np.arange(len(found)), [
            p.key.partition(".")[2].replace("_", " ") if not p.key.endswith("offset") else p.key for p in found])
        axis.set_ylim(len(found) - 0.5, -0.5)

    quality = f"chi-square per degree of freedom {document.chi2_per_dof:.3g}{'' if document.accepted else ': no fit'}"
    panels = [panel for panel, there in (
        (Panel("Fit", fit, 1.6, style.TIME, style.SLIP), residuals),
        *((Panel(f"Residual of the {name.replace('_', ' ')}", partial(residual, name=name), 1.6, style.TIME,
                 AxisQuantity("residual / noise")), True) for name in residuals),
        (Panel("Parameters", parameters, 1.6, AxisQuantity("value and 95 % interval, from the start", "%"),
               named=False), document.parameters),
        (Panel("Friction", friction, 1.9, style.SLIP, COEFFICIENT), curve),
        (Panel("Likelihood", likelihood, 1.6, style.quantity_of(getattr(document.likelihood, "key", "")),
               AxisQuantity("chi-square over the least")), document.likelihood)) if there]
    return [panels[0]._replace(title=f"{panels[0].title}, {quality}"), *panels[1:]]


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

    def slope(axis: Any) -> None:
        v = np.linspace(0.0, far, POINTS)
        slopes = system.saturation_mean * np.broadcast_to(friction.sliding_slope(v, law.stribeck), v.shape)
        axis.plot(v, slopes, color=style.BLUE)
        if least < 0.0:
            axis.axhline(least, color=style.ORANGE, linewidth=0.9, linestyle=(0, (4, 2)),
                         label="critical slope (22), mean pressure")
        if np.abs(slopes).max() > 10.0 * abs(least):
            axis.set_yscale("symlog", linthresh=10.0 ** math.ceil(math.log10(max(abs(least), 1.0))))
        axis.set(xlim=(0.0, far), ylim=(min(1.5 * slopes.min(), 1.5 * least, -1e-3),
                                        max(1.5 * slopes.max(), 0.5 * abs(least), 1e-3)))

    close = partial(coefficient, far=3.0 * stick if stick > 0.0 else 0.05 * far, near=True)
    return [Panel("Friction law", partial(coefficient, far=far), 2.2, style.SLIP, COEFFICIENT),
            Panel("Close to 0", close, 2.2, style.SLIP, COEFFICIENT, beside=True),
            Panel("Slope of the torque", slope, 2.2, style.SLIP, AxisQuantity("slope", "N m s/rad"), beside=True)]
