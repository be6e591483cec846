"""Pictures of `linearise`, a Bode plot with simulated points, and of `identify`: measured and fitted speeds, residuals,
and intervals of the parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.estimation.curve import not_visited
from tcc_sim.estimation.linearise import INPUTS, OUTPUTS
from tcc_sim.shown_units import speed
from tcc_sim.views import style
from tcc_sim.views.stored import Record
from tcc_sim.views.sweeps import numbers

UNITS = INPUTS | OUTPUTS
SHOWN = 400
"""Number of samples of measured and fitted speeds in the picture."""


def bode(path: Path, document: Any, title: str = "", width: float = style.PAGE) -> Path:
    """Draw the frequency response of `linearise`, a result or its JSON."""
    values = style.json_values(document)
    with style.figure(width, max(0.62 * width, 4.0), title) as drawn:
        gain, phase = drawn.subplots(2, 1, sharex=True)
        draw_gain(gain, values)
        phase.semilogx(values["frequencies"], np.degrees(numbers(values["phase"])))
        gain.set_xlabel("")
        phase.set(ylabel="phase (degrees)", xlabel="angular frequency (rad/s)")
        parts = [f"{values['output']} by {values['input']}".replace("_", " "),
                 f"mean slip {speed(values['operating_point']['mean_slip'], 4)}"]
        style.legend_into(gain)
        gain.set_title((", " if style.wide(width) else "\n").join(parts), pad=style.room_for_legend(gain))
        return style.save(drawn, path)


def draw_gain(axis: Any, document: Any) -> None:
    """Draw the gain into an axis."""
    values = style.json_values(document)
    frequencies, gain = numbers(values["frequencies"]), numbers(values["gain"])
    inside = gain > 0.0
    axis.semilogx(frequencies[inside], 20.0 * np.log10(gain[inside]), label=_name(values))
    axis.set(xlabel="angular frequency (rad/s)",
             ylabel=f"gain (dB re 1 ({UNITS[values['output']]})/({UNITS[values['input']]}))")


def _name(values: Mapping[str, Any]) -> str:
    """Return the name of the curve."""
    kind = values["kind"]
    return "harmonic transfer function" if kind == "periodic" else f"linear model about constant {kind}"


def identification(path: Path, document: Any, title: str = "", width: float = style.PAGE) -> Path:
    """Draw the fit of `identify`, its residuals and parameters; for JSON, which has no samples, only the parameters."""
    document = Record.of(document) if isinstance(document, Mapping) else document
    if isinstance(document.curve, Record):
        vars(document.curve).update({name: np.array(part) for name, part in vars(document.curve).items()})
    names = list(document.residuals or ())
    above = len(names) + 1 if names else 0
    rows = above + bool(document.parameters) + (document.likelihood is not None) + (document.curve is not None)
    with style.figure(width, 1.5 * rows + 0.6, title) as drawn:
        axes = drawn.subplots(rows, 1, squeeze=False)[:, 0]
        if names:
            draw_fit(axes[0], document)
            axes[above - 1].set_xlabel("time (s)")
        words = f"chi-square per degree of freedom {document.chi2_per_dof:.3g}" + ("" if document.accepted
                                                                                   else ": no fit")
        axes[0].set_title(words)
        for axis, name in zip(axes[1:], names):
            residual = document.residuals[name] / document.noise[name]
            axis.plot(document.measurement.t[:len(residual)], residual, color=style.GREY, linewidth=0.5)
            axis.set_ylabel(f"{name.replace('_', ' ')}\nresidual / noise")
        if document.parameters:
            _parameters(axes[above], document)
        if document.curve is not None:
            draw_curve(axes[-1 - (document.likelihood is not None)], document.curve)
        if document.likelihood is not None:
            axes[-1].plot(document.likelihood.values, document.likelihood.excess, marker="o")
            axes[-1].axhline(3.84, color=style.RED, linewidth=0.8, label="95 %")
            axes[-1].set_xlabel(style.label_of(document.likelihood.key))
            axes[-1].set_ylabel("chi-square over\nthe least one")
            style.legend_into(axes[-1])
        return style.save(drawn, path)


def draw_fit(axis: Any, document: Any) -> None:
    """Draw the first samples of the slip speed, measured and fitted, into an axis."""
    residual = document.residuals["slip_speed"]
    data = document.measurement.channels["slip_speed"][:len(residual)]
    t = document.measurement.t[:len(residual)]
    axis.plot(t[:SHOWN], data[:SHOWN], linestyle="none", marker=".", color=style.GREY, label="measured")
    axis.plot(t[:SHOWN], (data + residual)[:SHOWN], color=style.BLUE, label="fitted")
    axis.set(xlabel="time (s)", ylabel="slip speed (rad/s)")
    style.legend_into(axis)


def draw_curve(axis: Any, curve: Any) -> None:
    """Draw the identified friction curve, its band and the scene's curve into an axis; grey where not visited."""
    v = curve.slip_speeds
    axis.fill_between(v, curve.low, curve.high, color=style.BLUE, alpha=0.25, linewidth=0.0, label="95 % band")
    axis.plot(v, curve.coefficient, color=style.BLUE, label="found")
    axis.plot(v, curve.scene, color=style.RED, linestyle=(0, (4, 2)), label="scene")
    for k, (low, high) in enumerate(not_visited(v, curve.visited)):
        axis.axvspan(low, high, color=style.GREY, alpha=0.2, linewidth=0.0, label="" if k else "not visited")
    axis.set(xlabel="slip speed (rad/s)", ylabel="friction\ncoefficient", xlim=(0.0, v[-1]))
    style.legend_into(axis)


def _parameters(axis: Any, document: Any) -> None:
    """Draw the values relative to their starts, with 95 % intervals."""
    rows = np.arange(len(document.parameters))
    sizes = np.array([abs(p.start) if p.start else max(abs(p.value), 1e-300) for p in document.parameters])
    values = np.array([p.value - p.start for p in document.parameters]) / sizes * 100.0
    errors = np.array([p.high - p.value for p in document.parameters]) / sizes * 100.0
    errors[~np.isfinite(errors)] = np.nan   # Drawn without a bar.
    axis.errorbar(values, rows, xerr=errors, linestyle="none", marker="o", capsize=3.0)
    axis.axvline(0.0, color=style.INK, linewidth=0.7)
    axis.set_yticks(rows, [p.key.partition(".")[2].replace("_", " ") if not p.key.endswith("offset") else p.key
                           for p in document.parameters])
    axis.set(ylim=(len(rows) - 0.5, -0.5), xlabel="value and 95 % interval, from the start (%)")
