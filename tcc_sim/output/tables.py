"""Results as text: lines of a run, a sweep and its quantiles for a terminal, and Markdown tables for written pages."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.analysis.summary import Summary, runaway_cause
from tcc_sim.errors import counted

if TYPE_CHECKING:
    from tcc_sim.analysis.damping import Damping
    from tcc_sim.analysis.orders import OrderComparison, Orders
    from tcc_sim.analysis.spectra import Spectrum
    from tcc_sim.sweeps.exponents import Lyapunov
    from tcc_sim.sweeps.results import Sweep
    from tcc_sim.sweeps.scatter import Scattered
    from tcc_sim.sweeps.simulation import Simulation

LINES_SHOWN = 6
"""Largest number of spectral lines shown."""
SECTION_LINES = 16
"""Largest number of section points shown."""
Row = dict[str, Any]
Column = tuple[str, int, Callable[[Row], str]]

COLUMNS: list[Column] = [
    ("max |slip|", 11, lambda r: f"{r['max_slip_speed']:.7g}"),
    ("period", 7, lambda r: _period(r)),
    ("stick", 6, lambda r: f"{r['stick_fraction']:.4f}"),
    ("regime", 10, lambda r: str(r["regime"]))]
"""Heading, width and text of the columns of every sweep."""
DAMPING: list[Column] = [
    ("Cf (21)", 9, lambda r: _number(r.get("equivalent_damping"))),
    ("neg. slope", 10, lambda r: _number(r.get("negative_slope_mean")))]
EXPONENT: list[Column] = [
    ("exponent", 9, lambda r: _number(r["lyapunov"]["exponent"])),
    ("+-", 7, lambda r: _half(r["lyapunov"])),
    ("diagnosis", 14, lambda r: str(r["lyapunov"]["diagnosis"]))]
QUANTILES = (("max_slip_speed", "largest |slip speed|", "rad/s", 1.0), ("stick_fraction", "in stick", "%", 100.0),
             ("clutch_energy", "clutch energy", "J", 1.0), ("max_shaft_torque", "largest shaft torque", "N m", 1.0))


def aligned(pairs: list[tuple[str, str]]) -> list[str]:
    """Return names and values in two aligned columns."""
    width = max((len(name) for name, _ in pairs), default=0)
    return [f"  {name:<{width}}  {value}" for name, value in pairs]


def simulation_lines(name: str, found: Simulation) -> list[str]:
    """Return the lines of a simulation: solver, summary and further figures."""
    run = found.trajectory
    lines = [f"{name}: {run.t[-1]:.6g} s, solved by {run.solver} in {counted(run.statistics.steps, 'step')} in "
             f"{run.statistics.seconds:.3g} s"]
    pairs = summary_rows(found.summary) if found.summary is not None else [("status", found.status)]
    if found.summary is not None:
        pairs += covers_row(found.summary, 0.0, float(run.t[-1]))
    if found.summary is not None and found.summary.runaway and run.system is not None:
        pairs.append(("runaway", runaway_cause(run.system)))
    if found.damping is not None:
        pairs.append(damping_row(found.damping))
    if found.lyapunov is not None:
        pairs.append(lyapunov_row(found.lyapunov))
    return [*lines, *aligned(pairs)]


def order_lines(found: Orders) -> list[str]:
    """Return the main results of an order analysis."""
    pairs = [("orders", f"{counted(len(found.time), 'window')} from engine frequency {found.frequency.min():.6g} to "
                        f"{found.frequency.max():.6g} rad/s, up to order {found.order[-1]:g}")]
    for order, passed in zip(found.torque_order, found.transmissibility.T):
        if not np.isnan(passed).any():
            pairs.append((f"order {order:g}", f"shaft torque over engine torque at most {passed.max():.4g}, at "
                                              f"engine frequency {found.frequency[passed.argmax()]:.6g} rad/s"))
    judder = found.judder
    most = f"at most {judder.peak.max():.6g} rad/s about the cycle mean, rms {judder.rms.max():.6g} rad/s"
    if not np.isnan(judder.breakaways).any():
        most += f"; {judder.breakaways.max():.4g} breakaways per second"
    pairs.append(("judder", most))
    return aligned(pairs)


def comparison_lines(found: OrderComparison) -> list[str]:
    """Return the differences of simulated and measured orders, where an order is within 30 dB of its largest value."""
    from tcc_sim.analysis.orders import level

    pairs = []
    for name in ("slip_speed", "shaft_torque"):
        for order in found.measured.cuts:
            measured = level(found.measured.cut(order, name))
            if np.isnan(measured).any():
                continue
            apart = np.abs(found.difference(name, order))[measured > measured.max() - 30.0]
            pairs.append((f"order {order:g} of {name.replace('_', ' ')}", f"simulated and measured differ by at "
                          f"most {apart.max():.3g} dB, median {np.median(apart):.3g} dB"))
    return aligned(pairs)


def spectrum_lines(found: Spectrum) -> list[str]:
    """Return the window of a spectrum and its largest lines."""
    pairs = [("spectrum window", found.window)]
    if found.slip_speed is not None and found.shaft_torque is not None:
        largest = np.sort(np.argsort(np.nan_to_num(found.slip_speed[1:]))[::-1][:LINES_SHOWN] + 1)
        for k in largest.tolist():
            torque = found.shaft_torque[k]
            pairs.append((f"order {found.order[k]:g}", f"{found.frequency[k]:.6g} rad/s: slip speed "
                          f"{found.slip_speed[k]:.6g} rad/s"
                          + ("" if math.isnan(torque) else f", shaft torque {torque:.6g} N m")))
        if len(found.subharmonics):
            shown = ", ".join(f"{order:g}" for order in found.subharmonics[:LINES_SHOWN])
            more = len(found.subharmonics) - LINES_SHOWN
            pairs.append(("sub-harmonics", f"orders {shown}" + (f" and {more} more" if more > 0 else "")))
    return aligned(pairs)


def summary_rows(summary: Summary) -> list[tuple[str, str]]:
    """Return the results of a steady state with their units."""
    if summary.runaway:
        period = "none: slip grows and never sticks"
    elif summary.period:
        period = counted(summary.period, "engine cycle")
        period += (", settled" if summary.settled else
                   f", still converging: the section changes by {summary.section_change:.1e}, relative, per period")
    else:
        period = f"none up to {DEFAULTS.maximum_period} engine cycles" + (
            "; the motion has not settled: raise --cycles" if summary.transient else "")
    out = [("largest |slip speed|", f"{summary.max_slip_speed:.9g} rad/s"),
           ("smallest slip speed", f"{summary.min_slip_speed:.9g} rad/s"),
           ("regime", f"{summary.regime}, in stick for {100.0 * summary.stick_fraction:.2f} % of the time")]
    if summary.cycles:
        out.append(("period", period))
    for number, (angle, speed) in enumerate(summary.section[:SECTION_LINES] if summary.period else []):
        out.append(("section: plate angle, slip speed" if number == 0 else "", f"{angle:.9g} rad, {speed:.9g} rad/s"))
    if not summary.period and summary.section:
        out.append(("section", counted(len(summary.section), "point")))
    if not math.isnan(summary.clutch_energy):
        out += [("clutch", f"{summary.clutch_energy:.6g} J turned into heat, {summary.mean_power:.6g} W on average, at "
                 f"most {summary.peak_power:.6g} W"
                 + (f"; {counted(summary.breakaways, 'breakaway')}" if summary.breakaways is not None else "")),
                ("shaft torque", f"{summary.min_shaft_torque:.6g} to {summary.max_shaft_torque:.6g} N m")]
    dropped = f"the first {summary.discarded}" if summary.discarded else "none"
    out.append(("engine cycles", f"{summary.cycles}, {dropped} dropped"))
    return out


def covers_row(summary: Summary, begin: float, end: float) -> list[tuple[str, str]]:
    """Return the time span that the figures of a run from `begin` to `end`, s, cover, unless they cover all of it."""
    first, last = summary.covers
    near = 1e-9 * (end - begin)
    if first <= begin + near and last >= end - near:
        return []
    return [("figures cover", f"{first:.6g} to {last:.6g} s of {begin:.6g} to {end:.6g} s")]


def damping_row(found: Damping) -> tuple[str, str]:
    """Return the equivalent damping (21), with the mean slope and the threshold of (23)."""
    if math.isnan(found.weighted):
        reason = "no whole engine cycle could be solved" if math.isnan(found.negative_mean) else "there is no slip"
        return "equivalent damping (21)", f"none: {reason}"
    return ("equivalent damping (21)",
            f"{found.weighted:.4g} N m s/rad, mean of the negative slope {found.negative_mean:.4g}; "
            f"-C23 is {found.threshold:.4g}")


def lyapunov_row(found: Lyapunov) -> tuple[str, str]:
    """Return the largest Lyapunov exponent with its confidence interval."""
    return ("largest Lyapunov exponent", f"{found.exponent:.4g} 1/s, {found.low:.4g} to {found.high:.4g} at "
            f"{100.0 * found.confidence:g} % confidence: {found.diagnosis}")


def sweep_lines(sweeps: Sequence[Sweep], second_key: str = "", second_values: Sequence[float] = (),
                width: int | None = None) -> list[str]:
    """Return a heading and one line per point; in a grid, the value of the second key comes first.

    Columns that do not fit in the width of the terminal form further tables below.
    """
    extras = {name for sweep in sweeps for name in sweep.lists}
    columns = [*COLUMNS, *(DAMPING if "equivalent_damping" in extras else []),
               *(EXPONENT if "lyapunov" in extras else [])]
    keys = [*([second_key] if second_key else []), sweeps[0].curve.key]
    lines = [", ".join(keys) + "; slip speed in rad/s" + ("; exponent in 1/s" if "lyapunov" in extras else "")
             + ("; Cf and slope in N m s/rad" if "equivalent_damping" in extras else "")]
    rows = [("  ".join(f"{x:>12.8g}" for x in ([*second_values[k:k + 1], value])), record)
            for k, sweep in enumerate(sweeps) for value, record in zip(sweep.curve.values, sweep.records)]
    start = "  ".join(f"{name.rpartition('.')[2][:12]:>12}" for name in keys)
    for table in _tables(columns, len(start), width):
        lines.append(start + "".join(f"  {name:>{wide}}" for name, wide, _ in table))
        for values, record in rows:
            if record is None or record["max_slip_speed"] is None:
                lines.append(f"{values}  {record['status'] if record is not None else 'not solved'}")
            else:
                lines.append(values + "".join(f"  {text(record):>{wide}}" for _, wide, text in table))
    return lines + unsettled_lines(sweeps, "* ")


def unsettled_lines(sweeps: Sequence[Sweep], mark: str = "") -> list[str]:
    """Return a line with the number of motions that have not settled, and the remedy; no line if all have settled."""
    count, values = sum(s.not_settled for s in sweeps), sum(len(s.points) for s in sweeps)
    return [f"{mark}{count} of {counted(values, 'point')} {'has' if count == 1 else 'have'} not settled; raise --cycles"
            ] if count else []


def quantile_lines(found: Scattered) -> list[str]:
    """Return quantiles of the main results over the samples, for each value of a swept key."""
    from tcc_sim.sweeps.scatter import PROBABILITIES

    values = found.sweeps[0].curve.values if found.over else ()
    lines = [f"{counted(found.tolerances.samples, 'sample')} of "
             + ", ".join(f"{key} {low:g} to {high:g}" for key, low, high in found.tolerances.bounds)]
    left_out = found.left_out
    if any(left_out.values()):
        lines.append(f"quantiles leave out {counted(left_out['runaway'], 'result')} that ran away and "
                     f"{left_out['not_settled']} that have not settled; raise --cycles, or give --every-sample")
    for name, label, unit, scale in QUANTILES:
        lines.append(f"{label} ({unit})" + "".join(f"  {100.0 * p:g} %" for p in PROBABILITIES))
        for k, row in enumerate(scale * found.quantiles(name)):
            start = f"  {found.over} {values[k]:.8g}" if found.over else " "
            lines.append(start + "".join(f"  {x:.6g}" for x in row))
    return lines


def _tables(columns: list[Column], start: int, width: int | None) -> list[list[Column]]:
    """Distribute the columns over tables no wider than `width`, each after `start` characters of keys."""
    tables: list[list[Column]] = [[]]
    for column in columns:
        used = start + sum(2 + wide for _, wide, _ in tables[-1])
        if width is not None and tables[-1] and used + 2 + column[1] > width:
            tables.append([])
        tables[-1].append(column)
    return tables


def _period(record: Row) -> str:
    """Return the period in engine cycles, with a star if the motion has not settled; else runaway or none."""
    if record["runaway"]:
        return "runaway"
    return f"{record['period'] or 'none'}{'*' if record['transient'] else ''}"


def _number(value: float | None) -> str:
    """Return a number with four digits, or none."""
    return "none" if value is None else f"{value:.4g}"


def _half(found: Row) -> str:
    """Return half the width of a confidence interval."""
    return "none" if found["low"] is None else f"{0.5 * (found['high'] - found['low']):.2g}"


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]], align: str = "---",
                   first: str | None = None) -> list[str]:
    """Return the lines of a Markdown table.

    `align` is the rule below every heading, ``---`` for left and ``---:`` for right alignment; `first` is the rule
    below the first heading if that differs.
    """
    rules = [align if first is None else first, *[align] * (len(head) - 1)]
    return ["| " + " | ".join(cells) + " |" for cells in (head, rules, *rows)]


def escape(words: str) -> str:
    """Return words with the special characters of Markdown escaped."""
    return words.replace("|", "\\|").replace("*", "\\*").replace("_", "\\_").replace("<", "&lt;")


def text(value: Any) -> str:
    """Return a value of a result as text, numbers with five digits."""
    if isinstance(value, Mapping):
        return ", ".join(f"{k}: {text(v)}" for k, v in value.items())
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(text(v) for v in value) + "]"
    return f"{value:.5g}" if isinstance(value, float) else "none" if value is None else str(value)
