"""Pictures of fluids: fresh and aged, with friction over slip speed and results of a sweep; and the judder of aged
fluid with the converter's fluid beside the clutch.

`python .ci/instruments/fluids.py FILE.png [coupling]` draws one; the clutch is that of scenes fresh_fluid and
aged_fluid.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import tcc_sim
from tcc_sim.views import style

FREQUENCIES = np.linspace(50.0, 300.0, 126)
BELOW_STICK = np.linspace(50.0, 180.0, 131)
"""Frequencies up to a little above the judder; all of these clutches stick from 169 rad/s."""
LOOKS = {"fresh_fluid": ("fresh fluid", style.BLUE), "aged_fluid": ("aged fluid", style.RED)}
COUPLINGS = {0.0: {"color": style.RED}, 1.0: {"color": style.BLUE, "linestyle": (0, (4, 1.5))},
             3.0: {"color": style.INK, "linewidth": 2.0}}
"""Lines by converter.coupling, N m s/rad; they differ in grey too."""


def draw_fluids(path: Path, frequencies: np.ndarray = FREQUENCIES) -> Path:
    """Draw both tables with their fits, and largest slip speed and breakaways over engine frequency."""
    with style.figure(style.PAGE, 2.7) as drawn:
        law, largest, judder = drawn.subplots(1, 3)
        for name, (words, colour) in LOOKS.items():
            scene = tcc_sim.load_scene(name)
            friction = scene.system.friction
            v = np.linspace(0.0, friction.slip_speeds[-1], 400)
            law.plot(friction.slip_speeds, friction.coefficients, linestyle="none", marker="o", color=colour,
                     markersize=3.5)
            law.plot(v, friction.curve.at(v), color=colour, label=words)
            swept = tcc_sim.sweep(scene, "engine.frequency", frequencies, cycles=400, discard=200).columns()
            seconds = 200.0 * 2.0 * np.pi / frequencies
            for axis, values in ((largest, swept["max_slip_speed"]), (judder, swept["breakaways"] / seconds)):
                axis.plot(frequencies, values, linestyle="none", marker=".", color=colour)
        law.set(xlabel="slip speed (rad/s)", ylabel="friction coefficient", xlim=(0.0, None))
        law.legend(loc="best")
        largest.set(xlabel="engine frequency (rad/s)", ylabel="largest slip speed (rad/s)", ylim=(-1.0, None))
        judder.set(xlabel="engine frequency (rad/s)", ylabel="breakaways a second", ylim=(-1.0, None))
        for axis, title in ((law, "(a) Tables and fits"), (largest, "(b) Sweep"), (judder, "(c) Judder")):
            axis.set_title(title)
        return style.save(drawn, path)


def draw_coupling(path: Path, frequencies: np.ndarray = BELOW_STICK) -> Path:
    """Draw the largest slip speed of aged fluid over engine frequency for three values of converter.coupling."""
    with style.figure(style.PAGE, 2.8) as drawn:
        axis = drawn.subplots()
        for coupling, look in COUPLINGS.items():
            scene = tcc_sim.load_scene("aged_fluid").with_values({"converter.coupling": coupling})
            swept = tcc_sim.sweep(scene, "engine.frequency", frequencies, cycles=600, discard=400).columns()
            axis.plot(frequencies, swept["max_slip_speed"], label=f"$b$ = {coupling:g} N m s/rad", **look)
        axis.set(xlabel="engine frequency (rad/s)", ylabel="largest slip speed (rad/s)", ylim=(-1.0, None),
                 xlim=(frequencies[0], frequencies[-1]))
        axis.legend(loc="upper right")
        return style.save(drawn, path)


if __name__ == "__main__":
    (draw_coupling if sys.argv[2:] == ["coupling"] else draw_fluids)(Path(sys.argv[1]))
