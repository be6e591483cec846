"""The summary of a run as lines for a terminal."""

from __future__ import annotations

import math

from tcc_sim.analysis.damping import Damping
from tcc_sim.analysis.orders import Orders
from tcc_sim.analysis.periodicity import MAXIMUM_PERIOD
from tcc_sim.analysis.summary import Summary, runaway_cause
from tcc_sim.errors import counted
from tcc_sim.sweeps.exponents import Lyapunov
from tcc_sim.sweeps.simulation import Simulation

SECTION_LINES = 16
"""Most section points shown."""


def rows(pairs: list[tuple[str, str]]) -> list[str]:
    """Names and what they are, in two columns."""
    width = max((len(name) for name, _ in pairs), default=0)
    return [f"  {name:<{width}}  {value}" for name, value in pairs]


def simulation_lines(name: str, found: Simulation) -> list[str]:
    """A simulation of a scene: how it was solved, its summary, and the extras that were asked for."""
    run = found.trajectory
    lines = [f"{name}: {run.t[-1]:.6g} s, solved by {run.solver} in {counted(run.statistics.steps, 'step')} in "
             f"{run.statistics.seconds:.3g} s"]
    pairs = summary_rows(found.summary) if found.summary is not None else [("status", found.status)]
    if found.summary is not None and found.summary.runaway and run.system is not None:
        pairs.append(("runaway", runaway_cause(run.system)))
    if found.damping is not None:
        pairs.append(damping_row(found.damping))
    if found.lyapunov is not None:
        pairs.append(lyapunov_row(found.lyapunov))
    return [*lines, *rows(pairs)]


def order_lines(found: Orders) -> list[str]:
    """The orders of a run in a few figures."""
    pairs = [("orders", f"{counted(len(found.time), 'window')} from {found.frequency.min():.6g} to "
                        f"{found.frequency.max():.6g} rad/s, up to order {found.order[-1]:g}")]
    for order, passed in zip(found.torque_order, found.transmissibility.T):
        pairs.append((f"order {order:g}", f"shaft torque to engine torque at most {passed.max():.4g}, at "
                                          f"{found.frequency[passed.argmax()]:.6g} rad/s"))
    pairs.append(("judder", f"at most {found.peak.max():.6g} rad/s about the cycle mean, rms {found.rms.max():.6g}; "
                            f"{found.breakaways.max():.4g} breakaways a second"))
    return rows(pairs)


def summary_rows(summary: Summary) -> list[tuple[str, str]]:
    """The figures of a steady state with their units."""
    if summary.runaway:
        period = "none: slip grows and never sticks"
    elif summary.period:
        period = counted(summary.period, "engine cycle")
        period += (", settled" if summary.settled else
                   f", still converging: it changes by {summary.section_change:.1e} of it")
    else:
        period = f"none up to {MAXIMUM_PERIOD} engine cycles, as far as can be told yet"
    out = [("largest |slip speed|", f"{summary.max_slip_speed:.9g} rad/s"),
           ("smallest slip speed", f"{summary.min_slip_speed:.9g} rad/s"),
           ("regime", f"{summary.regime}, in stick for {100.0 * summary.stick_fraction:.2f} % of the time")]
    if not summary.cycles:
        return out
    out.append(("period", period))
    for number, (angle, speed) in enumerate(summary.section[:SECTION_LINES] if summary.period else []):
        out.append(("section: plate angle, slip speed" if number == 0 else "", f"{angle:.9g} rad, {speed:.9g} rad/s"))
    if not summary.period and summary.section:
        out.append(("section", counted(len(summary.section), "point")))
    if not math.isnan(summary.clutch_energy):
        out += [("clutch", f"{summary.clutch_energy:.6g} J turned into heat, at most {summary.peak_power:.6g} W"
                 + (f"; {counted(summary.breakaways, 'breakaway')}" if summary.breakaways is not None else "")),
                ("shaft torque", f"{summary.min_shaft_torque:.6g} to {summary.max_shaft_torque:.6g} N m")]
    dropped = f"the first {summary.discarded}" if summary.discarded else "none"
    out.append(("engine cycles", f"{summary.cycles}, {dropped} dropped"))
    return out


def damping_row(found: Damping) -> tuple[str, str]:
    """The equivalent damping (21) beside what (23) compares it with."""
    if math.isnan(found.weighted):
        reason = "no whole engine cycle could be solved" if math.isnan(found.negative_mean) else "there is no slip"
        return "equivalent damping (21)", f"none: {reason}"
    return ("equivalent damping (21)",
            f"{found.weighted:.4g} N m s/rad, mean of the negative slope {found.negative_mean:.4g}; "
            f"-C23 is {found.threshold:.4g}")


def lyapunov_row(found: Lyapunov) -> tuple[str, str]:
    """The largest Lyapunov exponent with its confidence interval."""
    return ("largest Lyapunov exponent", f"{found.exponent:.4g} 1/s, {found.low:.4g} to {found.high:.4g} at "
            f"{100.0 * found.confidence:g} % confidence: {found.diagnosis}")
