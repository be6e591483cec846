"""Drawings of the paper's time histories and sections, and of its friction law, from the numbers of `paper.figures`."""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.shown_units import speed
from tcc_sim.study.paper.figure_results import Figure, Labelled
from tcc_sim.views import style

CYCLES = "time (periods of excitation)"
SLIP, ANGLE = r"$\dot\delta_1$ (rad/s)", r"$\delta_2$ (rad)"
LOOKS: dict[str, dict[str, Any]] = {
    "smoothed": {"color": style.SKY, "linewidth": 3.0}, "rk45": {"color": style.INK, "linewidth": 1.0},
    "bdf": {"color": style.ORANGE, "linestyle": (0, (1, 1.5)), "linewidth": 1.6},
    "event_driven": {"color": style.GREEN, "linestyle": (0, (5, 2, 1, 2))},
    "rk4": {"color": style.RED, "linestyle": (0, (4, 2)), "linewidth": 0.8}}
LOOKS_OF_LAWS = (LOOKS["smoothed"], {"color": style.PURPLE, "linewidth": 1.4}, LOOKS["event_driven"])
"""Lines of the solvers of Fig. 2, and of the laws."""
SET_VALUED: dict[str, Any] = {"linewidth": 0.8, "linestyle": (0, (3, 2))}
"""Line of the set-valued law in Fig. 3."""


def paint_histories(drawn: Any, data: Figure) -> None:
    """Draw Fig. 7: slip speed, plate angle and section (plate speed over plate angle) of every value, in equal ranges.

    The sections lie in stick, where the slip speed is 0.
    """
    panels = data.panels
    axes = _rows_of_three(drawn, len(panels))
    for letter, row, panel in zip("abc", axes, panels):
        speed, angle, section = row
        speed.plot(panel.t, panel.slip_speed, color=style.BLUE, linewidth=0.9)
        angle.plot(panel.t, panel.plate_angle, color=style.GREEN, linewidth=0.9)
        section.plot(*np.array(panel.section).reshape(-1, 2).T, linestyle="none", marker="o", color=style.RED,
                     markeredgewidth=0.0, markersize=5.0 if panel.period else 1.6)
        section.margins(0.1)
        speed.set(ylabel=SLIP, xlim=(panel.t[0], panel.t[-1]), title=f"({letter}) {panel.label}")
        angle.set(ylabel=ANGLE, xlim=(panel.t[0], panel.t[-1]))
        section.set_ylabel(r"$\dot\delta_2$ (rad/s)")
        # In a column the section is too narrow for the diagnosis; the slip speed is as wide as the picture.
        _note(section if style.wide(drawn.get_figwidth()) else speed, _diagnosis(panel))
        section.locator_params(axis="x", nbins=4)
    for axis, label in zip(axes[-1], (CYCLES, CYCLES, ANGLE)):
        axis.set_xlabel(label)


def _note(axis: Any, words: str) -> None:
    """Write words above the right end of the axes."""
    axis.set_title(words, loc="right", fontweight="normal", fontsize=7.0)


def _torque_axis(axis: Any, colour: str) -> Any:
    """Return an axis for torques at the right of another one."""
    other = axis.twinx()
    other.grid(False)
    other.spines["right"].set_visible(True)
    other.tick_params(colors=colour)
    return other


def _rows_of_three(drawn: Any, count: int) -> Any:
    """Return (count, 3) axes, each column in shared ranges: in a row, or the first above the two others."""
    if style.wide(drawn.get_figwidth()):
        return drawn.subplots(count, 3, width_ratios=(1.25, 1.25, 1.0), sharex="col", sharey="col")
    grid, axes = drawn.add_gridspec(2 * count, 2, width_ratios=(1.25, 1.0)), np.empty((count, 3), dtype=object)
    for k in range(count):
        for place, cell in enumerate((grid[2 * k, :], grid[2 * k + 1, 0], grid[2 * k + 1, 1])):
            first = axes[0, place] if k else None
            axes[k, place] = drawn.add_subplot(cell, sharex=first, sharey=first)
    return axes


def _diagnosis(panel: Labelled) -> str:
    """Return the period, or the exponent with its interval, as text."""
    if panel.period:
        return f"period {panel.period}"
    exponent = panel.lyapunov
    if exponent is None or not np.isfinite(exponent.exponent):
        return "no period up to 16"
    half = 0.5 * (exponent.high - exponent.low)
    return rf"{exponent.diagnosis}, $\lambda_1 = {exponent.exponent:.1f} \pm {half:.1f}$ s$^{{-1}}$"


def paint_delay(drawn: Any, data: Figure) -> None:
    """Draw Fig. 9: slip speed with positive slip shaded, and the engine torque above it."""
    wide, panels = style.wide(drawn.get_figwidth()), data.panels
    grid = drawn.subplots(2, 2, sharex=True) if wide else drawn.subplots(len(panels), 1, sharex=True)
    for k, (axis, panel) in enumerate(zip(grid.ravel(), panels)):
        t, v = panel.t, panel.slip_speed
        axis.fill_between(t, 0.0, np.where(panel.state == 1, v, 0.0), color=style.STICK, linewidth=0.0)
        axis.plot(t, v, color=style.BLUE, label="slip speed")
        axis.set(xlim=(t[0], t[-1]), title=f"({'abcd'[k]}) {panel.label}")
        other = _torque_axis(axis, style.ORANGE)
        other.plot(t, panel.engine_torque, color=style.ORANGE, linewidth=0.9, linestyle=(0, (4, 2)))
        if k % 2 or not wide:
            other.set_ylabel(r"$T_e$ (N m)", color=style.ORANGE)
        if k % 2 == 0 or not wide:
            axis.set_ylabel(SLIP, color=style.BLUE)
        share = panel.first_half
        _note(axis, f"{100.0 * share:.0f} % in first half cycle" if np.isfinite(share) else "no positive slip")
        if k > 1 and (wide or k == len(panels) - 1):
            axis.set_xlabel(CYCLES)


def paint_actuation(drawn: Any, data: Figure) -> None:
    """Draw Fig. 12: slip speed, engine and saturation torque, with the start of every engine cycle."""
    panels = data.panels
    axes = drawn.subplots(len(panels), 1, sharex=True, sharey=True)
    for letter, axis, panel in zip("abc", axes, panels):
        t = panel.t
        axis.plot(t, panel.slip_speed, color=style.BLUE)
        axis.set(ylabel=SLIP, xlim=(t[0], t[-1]), xticks=np.arange(0, int(t[-1]) + 1),
                 title=f"({letter}) {panel.label}")
        _note(axis, (f"period {panel.period}" if panel.period else "no period up to 16") + orbit_words(panel))
        other = _torque_axis(axis, style.GREY)
        other.plot(t, panel.saturation_torque, color=style.GREY, linewidth=0.9, linestyle=(0, (4, 2)))
        other.plot(t, panel.engine_torque, color=style.ORANGE, linewidth=0.8, linestyle=(0, (1, 1.5)))
        other.set_ylabel(r"$T_s$, $T_e$ (N m)", color=style.GREY)
        axis.set_zorder(other.get_zorder() + 1)
        axis.patch.set_visible(False)
    axes[-1].set_xlabel(CYCLES)


def orbit_words(panel: Labelled) -> str:
    """Return the stability of a panel's periodic orbit in words; empty if it was not followed."""
    if panel.orbit is None:
        return ""
    orbit = panel.orbit
    size = max(float(np.hypot(*m)) for m in orbit["multipliers"])
    return f", {'stable' if orbit['stable'] else 'unstable'}: largest Floquet multiplier {size:.3g}"


def paint_solvers(drawn: Any, data: Figure) -> None:
    """Draw Fig. 2: slip speed by every solver from one state, their divergence, and steady motions from (13)."""
    whole, close, steady = drawn.subplots(3, 1)
    wide, period, first = style.wide(drawn.get_figwidth()), data.cycle, data.curves[0]
    for curve in data.curves:
        difference = curve.rms_difference
        label = curve.label + (f" ({difference:.1e})" if np.isfinite(difference) and curve.solver != "smoothed" else "")
        for axis in (whole, close):
            axis.plot(curve.t * period, curve.slip_speed, label=label, **LOOKS[curve.solver])
    leaving = float(first.t[int(np.argmax(first.slip_speed > 1.0))]) * period
    for axis in (whole, close):
        axis.set(ylabel=SLIP, xlabel="time (s)")
    whole.set_xlim(0.0, first.t[-1] * period)
    close.set(xlim=(leaving - 0.06 * period, leaving + 0.03 * period), ylim=(-0.6, 4.0))
    if not wide:
        close.locator_params(axis="x", nbins=5)
    words = f"in brackets: rms difference from the first curve,{' ' if wide else chr(10)}relative to its maximum"
    style.legend(whole, loc="lower right", bbox_to_anchor=(1.0, 1.02), ncols=3 if wide else 1, fontsize=6.8,
                 title=words, title_fontsize=6.8)
    style.panel_titles((whole, close, steady), [
        "from one state", "leaving stick", f"steady state of each law from (13), after {data.steady_cycles} cycles"])
    for row, look in zip(data.steady, LOOKS_OF_LAWS):
        steady.plot(row.t, row.slip_speed, **look,
                    label=f"{row.label}: period {row.period}, {speed(row.max_slip_speed, 4)}")
    steady.set(ylabel=SLIP, xlabel=CYCLES, xlim=(0.0, data.steady[0].t[-1]))
    steady.set_ylim(top=(1.4 if wide else 1.9) * max(row.max_slip_speed for row in data.steady))
    style.legend(steady, loc="upper center", ncols=3 if wide else 1, fontsize=6.5)


def paint_law(drawn: Any, data: Figure) -> None:
    """Draw Fig. 3: law, zoom, slope."""
    wide, near, slope = drawn.subplots(1, 3) if style.wide(drawn.get_figwidth()) else drawn.subplots(3, 1)
    v, close = data.slip_speed, data.near_slip_speed
    for colour, curve in zip(style.CYCLE, data.curves):
        wide.plot(v, curve.coefficient, color=colour, label=curve.label)
        near.plot(close, curve.near_coefficient, color=colour)
        near.plot(close, curve.near_set_valued, color=colour, **SET_VALUED)
        slope.plot(close, curve.near_slope, color=colour)
        if np.isfinite(curve.peak_slip_speed):
            near.plot(curve.peak_slip_speed, curve.peak, marker="o", markersize=3.0, color=colour)
    style.key(near, "set-valued law (6)", color=style.GREY, **SET_VALUED)
    if any(np.isfinite(curve.peak_slip_speed) for curve in data.curves):
        style.key(near, "maximum of (7)", color=style.GREY, linestyle="none", marker="o")
    near.set_ylim(0.6, 1.6)
    slope.set_ylim(-1.5, 1.5)
    slope.axhline(0.0, color=style.GREY, linewidth=0.6)
    for axis, label in ((wide, r"$\bar\mu$"), (near, r"$\bar\mu$"),
                        (slope, r"$\partial\bar\mu/\partial\dot\delta_1$ (s/rad)")):
        axis.set(xlabel=SLIP, ylabel=label)
        axis.margins(x=0.0)
    style.panel_titles((wide, near, slope), ["smoothed law (7)", "zoom", "slope (20b)"])
    for axis in (wide, near):
        style.legend(axis, loc="lower right", fontsize=6.5)
