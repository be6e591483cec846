"""What the paper's closed forms say of a scene: pure slip (12) to (18) and pure stick (8) to (11), beside the ticks."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System
from tcc_sim.model.pure_slip import pure_slip
from tcc_sim.model.pure_stick import plate_angle, stick_margin

TICK, TICKS = 1e-3, 500
"""Ticks of the real-time solver that are held against the closed form, s and number."""


def closed_forms(system: System) -> dict[str, Any] | None:
    """`slip` and `stick`, each None where the scene has no such closed form; None for torques from a topic.

    Returns
    -------
    slip : `mean` a0 and `amplitude` |a21| + |a22| of (15), `growth` a1 (rad/s^2), `margin` of (16), `least` slip speed
        with the transient, `pure_slip` whether it lasts for ever, and, for the smoothed law, `tick_difference`: how far
        the real-time solver is from (14) in 500 ticks of 1 ms; rad/s
    stick : `margin` of (10), N m, `sticks`, and the plate angle's `mean` and `amplitude` by (8), rad
    """
    if "topic" in (system.engine.source, system.pressure.source):
        return None
    return {"slip": _slip(system), "stick": _stick(system)}


def _slip(system: System) -> dict[str, Any] | None:
    """Pure slip in the direction of the initial slip."""
    direction = -1 if system.initial.slip_speed < 0.0 else 1
    try:
        form = pure_slip(system, direction)
    except InputError:
        return None
    least = form.least_slip_speed
    lasting = least > 0.0
    return {"direction": direction, "mean": form.a0, "amplitude": form.slip.swing(), "growth": form.a1,
            "margin": form.margin, "least": least if math.isfinite(least) else None, "pure_slip": lasting,
            "tick_difference": _difference(system, form.slip_speed) if lasting else None}


def _difference(system: System, slip_speed: Any) -> float | None:
    """The largest difference of the real-time solver from v(t), rad/s; None for a law that it does not take."""
    if system.friction.law != "smoothed":
        return None
    from tcc_sim.solvers.fixed_step import Stepper
    stepper = Stepper(system, TICK)
    found = np.empty(TICKS)
    for k in range(TICKS):
        stepper.advance()
        found[k] = stepper.state[0]
    return float(np.abs(found - slip_speed(TICK * np.arange(1, TICKS + 1))).max())


def _stick(system: System) -> dict[str, Any] | None:
    """Pure stick."""
    try:
        margin, angle = stick_margin(system), plate_angle(system)
    except InputError:
        return None
    return {"margin": margin.torque, "sticks": margin.sticks, "mean": angle.mean, "amplitude": angle.swing()}


def closed_form_lines(found: dict[str, Any] | None) -> list[str]:
    """The closed forms for a terminal."""
    if found is None:
        return ["closed forms: none, a torque comes from a topic or varies in time"]
    slip, stick = found["slip"], found["stick"]
    lines = ["closed forms"]
    if slip is None:
        lines.append("  pure slip (12) to (18): none, it needs mu_k = mu_s and a pressure above 0")
    else:
        lines.append(f"  pure slip (15): {slip['mean']:.6g} rad/s and sines of {slip['amplitude']:.6g} rad/s"
                     + (f", growing by {slip['growth']:.4g} rad/s^2" if slip["growth"] else ""))
        least = "ends, since the friction torque outweighs the engine's" if slip["least"] is None else (
            f"{slip['least']:.6g} rad/s, so it {'lasts for ever' if slip['pure_slip'] else 'does not last'}")
        lines.append(f"    margin of (16) {slip['margin']:.6g} rad/s; least slip with the transient: {least}")
        if slip["tick_difference"] is not None:
            lines.append(f"    the real-time solver is within {slip['tick_difference']:.2g} rad/s of (14) over "
                         f"{TICKS} ticks")
    if stick is None:
        lines.append("  pure stick (8) to (11): none, the stuck resonance is excited undamped")
    else:
        possible = "is possible" if stick["sticks"] else "is not possible"
        lines.append(f"  pure stick (10): margin {stick['margin']:.6g} N m, so it {possible}; plate angle (8) "
                     f"{stick['mean']:.6g} rad and sines of {stick['amplitude']:.6g} rad")
    return lines
