"""The frequency response of `linearise` as a Bode picture: gain and phase, with the points found by simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.estimation.linearise import INPUTS, OUTPUTS
from tcc_sim.views import style

UNITS = INPUTS | OUTPUTS
SIMULATED: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "none", "color": style.RED,
                             "markersize": 5.0}
"""The look of points found by simulation."""


def bode(path: Path, found: Any, title: str = "", width: float = style.PAGE) -> Path:
    """Draw what `linearise` gives."""
    with style.figure(width, 0.62 * width) as drawn:
        gain, phase = drawn.subplots(2, 1, sharex=True)
        into(gain, found)
        phase.semilogx(found.frequencies, np.degrees(found.phase))
        if found.checked:
            phase.plot([p.frequency for p in found.checked], [np.degrees(p.phase) for p in found.checked], **SIMULATED)
        gain.set_xlabel("")
        phase.set(ylabel="phase (degrees)", xlabel="angular frequency (rad/s)")
        words = f"{found.output.replace('_', ' ')} by {found.input.replace('_', ' ')}"
        words += f", mean slip {found.mean_slip:.4g} rad/s"
        gain.set_title(f"{title}: {words}" if title else words)
        gain.legend(loc="best")
        return style.save(drawn, path)


def into(axis: Any, found: Any) -> None:
    """Draw the gain into an axis."""
    inside = found.gain > 0.0
    axis.semilogx(found.frequencies[inside], 20.0 * np.log10(found.gain[inside]), label=_name(found))
    if found.checked:
        axis.plot([p.frequency for p in found.checked], [20.0 * np.log10(p.gain) for p in found.checked],
                  label="simulated", **SIMULATED)
    axis.set(xlabel="angular frequency (rad/s)",
             ylabel=f"gain (dB re 1 ({UNITS[found.output]})/({UNITS[found.input]}))")


def _name(found: Any) -> str:
    """What the curve is."""
    return "harmonic transfer function" if found.kind == "periodic" else f"linear model about constant {found.kind}"
