"""Drawings of the paper's time histories and sections, and of its friction law, from the numbers of `paper.figures`."""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.paper.figure_results import Labelled, Numbers
from tcc_sim.shown_units import speed
from tcc_sim.views import style

CYCLES = "time (periods of excitation)"
SLIP = r"$\dot\delta_1$ (rad/s)"


def paint_histories(drawn: Any, data: Numbers) -> None:
    """Draw Fig. 7: slip speed, plate angle and section (plate speed over plate angle) of every value, in equal ranges.

    The sections lie in stick, where the slip speed is 0.
    """
    panels = data.panels
    axes = _rows_of_three(drawn, len(panels))
    for k, (row, panel) in enumerate(zip(axes, panels)):
        speed, angle, section = row
        t = panel.t
        speed.plot(t, panel.slip_speed, color=style.BLUE, linewidth=0.9)
        angle.plot(t, panel.plate_angle, color=style.GREEN, linewidth=0.9)
        points = np.array(panel.section).reshape(-1, 2)
        periodic = bool(panel.period)
        section.plot(points[:, 0], points[:, 1], linestyle="none", marker="o", color=style.RED, markeredgewidth=0.0,
                     markersize=5.0 if periodic else 1.6)
        section.margins(0.1)
        speed.set_ylabel(SLIP)
        angle.set_ylabel(r"$\delta_2$ (rad)")
        section.set_ylabel(r"$\dot\delta_2$ (rad/s)")
        speed.set_xlim(t[0], t[-1])
        angle.set_xlim(t[0], t[-1])
        speed.set_title(f"({'abc'[k]}) {panel.label}")
        # In a column the section is too narrow for the diagnosis; the slip speed is as wide as the picture.
        (section if style.wide(drawn.get_figwidth()) else speed).set_title(_diagnosis(panel), loc="right",
                                                                           fontweight="normal", fontsize=7.0)
    axes[-1][0].set_xlabel(CYCLES)
    axes[-1][1].set_xlabel(CYCLES)
    axes[-1][2].set_xlabel(r"$\delta_2$ (rad)")
    for axis in axes[:, 2]:
        axis.locator_params(axis="x", nbins=4)


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
    found = panel.lyapunov
    if found is None or not np.isfinite(found.exponent):
        return "no period up to 16"
    half = 0.5 * (found.high - found.low)
    return rf"{found.diagnosis}, $\lambda_1 = {found.exponent:.1f} \pm {half:.1f}$ s$^{{-1}}$"


def paint_delay(drawn: Any, data: Numbers) -> None:
    """Draw Fig. 9: slip speed with positive slip shaded, and the engine torque above it."""
    wide = style.wide(drawn.get_figwidth())
    grid = drawn.subplots(2, 2, sharex=True) if wide else drawn.subplots(len(data.panels), 1, sharex=True)
    for k, (axis, panel) in enumerate(zip(grid.ravel(), data.panels)):
        t, v = panel.t, panel.slip_speed
        axis.fill_between(t, 0.0, np.where(panel.state == 1, v, 0.0), color=style.STICK, linewidth=0.0)
        axis.plot(t, v, color=style.BLUE, label="slip speed")
        axis.set(xlim=(t[0], t[-1]), title=f"({'abcd'[k]}) {panel.label}")
        other = axis.twinx()
        other.plot(t, panel.engine_torque, color=style.ORANGE, linewidth=0.9, linestyle=(0, (4, 2)))
        other.grid(False)
        other.spines["right"].set_visible(True)
        other.tick_params(colors=style.ORANGE)
        if k % 2 or not wide:
            other.set_ylabel(r"$T_e$ (N m)", color=style.ORANGE)
        if k % 2 == 0 or not wide:
            axis.set_ylabel(SLIP, color=style.BLUE)
        share = panel.first_half
        text = f"{100.0 * share:.0f} % in first half cycle" if np.isfinite(share) else "no positive slip"
        axis.set_title(text, loc="right", fontweight="normal", fontsize=7.0)
        if k > 1 and (wide or k == len(data.panels) - 1):
            axis.set_xlabel(CYCLES)


def paint_actuation(drawn: Any, data: Numbers) -> None:
    """Draw Fig. 12: slip speed, engine and saturation torque, with the start of every engine cycle."""
    axes = drawn.subplots(len(data.panels), 1, sharex=True, sharey=True)
    for k, (axis, panel) in enumerate(zip(axes, data.panels)):
        t = panel.t
        axis.plot(t, panel.slip_speed, color=style.BLUE)
        axis.set(ylabel=SLIP, xlim=(t[0], t[-1]))
        axis.set_xticks(np.arange(0, int(t[-1]) + 1))
        axis.set_title(f"({'abc'[k]}) {panel.label}")
        found = f"period {panel.period}" if panel.period else "no period up to 16"
        axis.set_title(found + orbit_words(panel), loc="right", fontweight="normal", fontsize=7.0)
        other = axis.twinx()
        other.plot(t, panel.saturation_torque, color=style.GREY, linewidth=0.9, linestyle=(0, (4, 2)))
        other.plot(t, panel.engine_torque, color=style.ORANGE, linewidth=0.8, linestyle=(0, (1, 1.5)))
        other.set_ylabel(r"$T_s$, $T_e$ (N m)", color=style.GREY)
        other.grid(False)
        other.spines["right"].set_visible(True)
        other.tick_params(colors=style.GREY)
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


def paint_solvers(drawn: Any, data: Numbers) -> None:
    """Draw Fig. 2: slip speed by every solver from one state, their divergence, and steady motions from (13)."""
    whole, close, steady = drawn.subplots(3, 1)
    looks: dict[str, dict[str, Any]] = {
        "smoothed": {"color": style.SKY, "linewidth": 3.0}, "rk45": {"color": style.INK, "linewidth": 1.0},
        "bdf": {"color": style.ORANGE, "linestyle": (0, (1, 1.5)), "linewidth": 1.6},
        "event_driven": {"color": style.GREEN, "linestyle": (0, (5, 2, 1, 2))},
        "rk4": {"color": style.RED, "linestyle": (0, (4, 2)), "linewidth": 0.8}}
    period = data.cycle
    reference = data.curves[0].slip_speed
    for curve in data.curves:
        t = curve.t * period
        difference = curve.rms_difference
        label = curve.label + (f" ({difference:.1e})" if np.isfinite(difference) and curve.solver != "smoothed" else "")
        for axis in (whole, close):
            axis.plot(t, curve.slip_speed, label=label, **looks[curve.solver])
    whole.set_xlim(0.0, data.curves[0].t[-1] * period)
    leaving = float(np.array(data.curves[0].t)[int(np.argmax(reference > 1.0))]) * period
    close.set(xlim=(leaving - 0.06 * period, leaving + 0.03 * period), ylim=(-0.6, 4.0))
    for axis in (whole, close):
        axis.set(ylabel=SLIP, xlabel="time (s)")
    handles, labels = whole.get_legend_handles_labels()
    columns, between = (3, " ") if style.wide(drawn.get_figwidth()) else (1, "\n")
    if columns == 1:
        close.locator_params(axis="x", nbins=5)
    whole.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.02), ncols=columns, fontsize=6.8,
                 title=f"in brackets: rms difference from the first curve,{between}relative to its maximum",
                 title_fontsize=6.8)
    after = f"steady state of each law from (13), after {data.steady_cycles} cycles"
    style.panel_titles((whole, close, steady), ["from one state", "leaving stick", after])
    looks_of_laws: tuple[dict[str, Any], ...] = (
        {"color": style.SKY, "linewidth": 3.0}, {"color": style.PURPLE, "linewidth": 1.4},
        {"color": style.GREEN, "linestyle": (0, (5, 2, 1, 2))})
    for row, look in zip(data.steady, looks_of_laws):
        steady.plot(row.t, row.slip_speed, **look,
                    label=f"{row.label}: period {row.period}, {speed(row.max_slip_speed, 4)}")
    wide = columns > 1
    steady.set_ylim(top=(1.4 if wide else 1.9) * max(row.max_slip_speed for row in data.steady))
    steady.set(ylabel=SLIP, xlabel=CYCLES, xlim=(0.0, data.steady[0].t[-1]))
    steady.legend(loc="upper center", ncols=3 if wide else 1, fontsize=6.5)


def paint_law(drawn: Any, data: Numbers) -> None:
    """Draw Fig. 3: law, zoom, slope."""
    wide, near, slope = drawn.subplots(1, 3) if style.wide(drawn.get_figwidth()) else drawn.subplots(3, 1)
    for k, curve in enumerate(data.curves):
        colour = style.CYCLE[k]
        wide.plot(data.slip_speed, curve.coefficient, color=colour, label=curve.label)
        near.plot(data.near_slip_speed, curve.near_coefficient, color=colour)
        near.plot(data.near_slip_speed, curve.near_set_valued, color=colour, linewidth=0.8, linestyle=(0, (3, 2)))
        slope.plot(data.near_slip_speed, curve.near_slope, color=colour)
        if np.isfinite(curve.peak_slip_speed):
            near.plot(curve.peak_slip_speed, curve.peak, marker="o", markersize=3.0, color=colour)
    near.plot([], [], color=style.GREY, linewidth=0.8, linestyle=(0, (3, 2)), label="set-valued law (6)")
    near.plot([], [], color=style.GREY, linestyle="none", marker="o", label="maximum of (7)")
    near.set_ylim(0.6, 1.6)
    slope.set_ylim(-1.5, 1.5)
    slope.axhline(0.0, color=style.GREY, linewidth=0.6)
    wide.set_ylabel(r"$\bar\mu$")
    near.set_ylabel(r"$\bar\mu$")
    slope.set_ylabel(r"$\partial\bar\mu/\partial\dot\delta_1$ (s/rad)")
    for axis in (wide, near, slope):
        axis.set_xlabel(r"$\dot\delta_1$ (rad/s)")
        axis.margins(x=0.0)
    style.panel_titles((wide, near, slope), ["smoothed law (7)", "zoom", "slope (20b)"])
    wide.legend(loc="lower right", fontsize=6.5)
    near.legend(loc="lower right", fontsize=6.5)
