"""Results as text: lines of a run, a sweep and its quantiles for a terminal, and Markdown tables for written pages."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tcc_sim.analysis.measured.orders import JudderFigures, OrderComparison, Orders, Spectrum, level
from tcc_sim.analysis.repetition import LONGEST
from tcc_sim.analysis.steady.summary import AFTER_A_GAP, Summary, runaway_cause
from tcc_sim.errors import counted
from tcc_sim.result import units_of_columns
from tcc_sim.shown_units import engine_speed, frequency, key_unit, key_value, shown_unit, speed
from tcc_sim.trajectory import Status

if TYPE_CHECKING:
    from tcc_sim.analysis.loop.tracking import Tracking
    from tcc_sim.analysis.steady.damping import Damping
    from tcc_sim.sweeps.gains import GainMap
    from tcc_sim.sweeps.results import Grid, Sweep
    from tcc_sim.sweeps.scatter import Scattered
    from tcc_sim.sweeps.simulation import Simulation

LINES_SHOWN = 6
"""Largest number of spectral lines shown."""
SECTION_LINES = 16
"""Largest number of section points shown."""
SWEPT = ("max_slip_speed", "period", "stick_fraction", "regime", "equivalent_damping", "negative_slope_mean",
         "lyapunov_exponent", "lyapunov_low", "lyapunov_high", "lyapunov_diagnosis")
"""Columns of a sweep that its table shows, as far as they were computed."""
QUANTILES = ("max_slip_speed", "stick_fraction", "clutch_energy", "max_shaft_torque")
"""Results whose quantiles are printed."""
MANOEUVRE = ("breakaways", "judder_rms", "judder_peak")
"""Further ones of manoeuvres and with orders."""


def aligned(pairs: list[tuple[str, str]]) -> list[str]:
    """Return names and values in two aligned columns."""
    width = max((len(name) for name, _ in pairs), default=0)
    return [f"  {name:<{width}}  {value}" for name, value in pairs]


def friction_formula(constant: float, amplitudes: Iterable[float], rates: Iterable[float]) -> str:
    """Return the sliding coefficient as text, such as "mu(v) = 0.12 + 0.03 exp(-2 |v|)"."""
    terms = (f" {'-' if c < 0.0 else '+'} {abs(c):.6g} exp(-{a:.4g} |v|)" for c, a in zip(amplitudes, rates))
    return f"mu(v) = {constant:.6g}{''.join(terms)}"


def simulation_lines(name: str, result: Simulation) -> list[str]:
    """Return the lines of a simulation: solver, summary and further figures."""
    run = result.trajectory
    lines = [f"{name}: {run.t[-1]:.6g} s, solved by {run.solver} in {counted(run.statistics.steps, 'step')} in "
             f"{run.statistics.seconds:.3g} s"]
    if result.summary is None:
        pairs = [("status", result.status)]
    else:
        varies = run.system is not None and run.system.profile is not None
        pairs = summary_rows(result.summary, "its inputs vary in time" if varies else "raise --cycles or --duration")
        pairs += covers_row(result.summary, 0.0, float(run.t[-1]))
        if result.summary.runaway and run.system is not None:
            pairs.append(("runaway", runaway_cause(run.system)))
    pairs += [("table" if warning in result.notes else "doubtful", warning) for warning in result.warnings or []]
    if result.damping is not None:
        pairs.append(damping_row(result.damping))
    if result.lyapunov is not None:
        found = result.lyapunov
        pairs.append(("largest Lyapunov exponent", f"{found.exponent:.4g} 1/s, {found.low:.4g} to {found.high:.4g} at "
                      f"{100.0 * found.confidence:g} % confidence: {found.diagnosis}"))
    return [*lines, *aligned(pairs)]


def order_lines(orders: Orders) -> list[str]:
    """Return the main results of an order analysis."""
    pairs = [("orders", f"{counted(len(orders.time), 'window')} from "
                        f"{engine_speed(orders.frequency.min(), 6, orders.frequency.max())}, up to order "
                        f"{orders.order[-1]:g}"
                        + (f"; {orders.left_out} more left out because of gaps between samples" if orders.left_out
                           else ""))]
    unknown = np.isnan(orders.shaft_torque).all()
    for order, passed in zip(orders.torque_order, orders.transmissibility.T):
        at_most = (f"shaft torque over engine torque at most {np.nanmax(passed):.4g}, at "
                   f"{engine_speed(orders.frequency[np.nanargmax(passed)])}" if np.isfinite(passed).any() else
                   f"no transmissibility: the {'shaft' if unknown else 'engine'} torque is not known")
        pairs.append((f"order {order:g}", at_most))
    if not len(orders.torque_order):
        pairs.append(("transmissibility", "none: the engine torque has no order of the excitation"))
    judder = orders.judder
    most = f"at most {speed(judder.peak.max())} about the cycle mean, rms {speed(judder.rms.max())}"
    most += ("; breakaways are not known: a table has no states of stick and slip"
             if np.isnan(judder.breakaways).any() else f"; {judder.breakaways.max():.4g} breakaways per second")
    pairs.append(("judder", most))
    return aligned(pairs)


def comparison_lines(comparison: OrderComparison) -> list[str]:
    """Return the differences of simulated and measured orders, where an order is within 30 dB of its largest value."""
    pairs = []
    for name in ("slip_speed", "shaft_torque"):
        for order in comparison.measured.cuts:
            measured = level(comparison.measured.cut(order, name))
            if np.isnan(measured).all():
                pairs.append((f"order {order:g} of {name.replace('_', ' ')}", "not compared: it was not measured"))
                continue
            apart = np.abs(comparison.difference(name, order))[measured > np.nanmax(measured) - 30.0]
            pairs.append((f"order {order:g} of {name.replace('_', ' ')}", f"simulated and measured differ by at "
                          f"most {apart.max():.3g} dB, median {np.median(apart):.3g} dB"))
    return aligned(pairs)


def spectrum_lines(spectrum: Spectrum) -> list[str]:
    """Return the window of a spectrum and its largest lines."""
    pairs = [("spectrum window", spectrum.window)]
    if spectrum.slip_speed is not None and spectrum.shaft_torque is not None:
        largest = np.sort(np.argsort(np.nan_to_num(spectrum.slip_speed[1:]))[::-1][:LINES_SHOWN] + 1)
        for k in largest.tolist():
            torque = spectrum.shaft_torque[k]
            pairs.append((f"order {spectrum.order[k]:g}",
                          f"{frequency(spectrum.frequency[k])}: slip speed {speed(spectrum.slip_speed[k])}"
                          + (", shaft torque not measured" if math.isnan(torque) else
                             f", shaft torque {torque:.6g} N m")))
        if len(spectrum.subharmonics):
            shown = ", ".join(f"{order:g}" for order in spectrum.subharmonics[:LINES_SHOWN])
            more = len(spectrum.subharmonics) - LINES_SHOWN
            pairs.append(("sub-harmonics", f"orders {shown}" + (f" and {more} more" if more > 0 else "")))
    return aligned(pairs)


def summary_rows(summary: Summary, advice: str) -> list[tuple[str, str]]:
    """Return the results of a steady state with their units.

    `advice` is the cause or the remedy of a motion that has not settled.
    """
    if summary.runaway:
        period = "none: slip grows and never sticks"
    elif summary.period:
        period = f"{counted(summary.period, 'period')} of excitation"
        period += (", settled" if summary.settled else
                   f", still converging: the section changes by {summary.section_change:.1e}, relative, per period")
    else:
        most = summary.longest_period
        period = f"none up to {counted(most, 'period')} of excitation" if most else _too_few(summary)
        period += (f", a third of those {'in a row at the end' if summary.broken else 'kept'}"
                   if 0 < most < LONGEST else "")
        period += f"; the motion has not settled: {advice}" if summary.transient else ""
    out = [("largest |slip speed|", speed(summary.max_slip_speed, 9)),
           ("smallest slip speed", speed(summary.min_slip_speed, 9)),
           ("regime", f"{summary.regime}, in stick for {100.0 * summary.stick_fraction:.2f} % of the time")]
    out.append(("period", period if summary.cycles else "none: no whole period of excitation is known"))
    for number, (angle, slip) in enumerate(summary.section[:SECTION_LINES] if summary.period else []):
        out.append(("section: plate angle, slip speed" if number == 0 else "", f"{angle:.9g} rad, {speed(slip, 9)}"))
    if not summary.period and summary.section:
        out.append(("section", counted(len(summary.section), "point")))
    if not math.isnan(summary.clutch_energy):
        out += [("clutch", f"{summary.clutch_energy:.6g} J turned into heat, {summary.mean_power:.6g} W on average, at "
                 f"most {summary.peak_power:.6g} W"
                 + (f"; {counted(summary.breakaways, 'breakaway')}" if summary.breakaways is not None else
                    "; breakaways were not counted")),
                ("shaft torque", f"{summary.min_shaft_torque:.6g} to {summary.max_shaft_torque:.6g} N m")]
        if summary.coupling_energy > 0.0:
            out.append(("converter's fluid", f"{summary.coupling_energy:.6g} J turned into heat"))
    else:
        out.append(("clutch, shaft torque", f"none: solver {summary.solver} did not compute them"))
    dropped = f"the first {summary.discarded}" if summary.discarded else "none"
    out.append(("periods of excitation", f"{summary.cycles}, {dropped} dropped"))
    return out


def _too_few(summary: Summary) -> str:
    """Return the reason for which no period could be looked for."""
    if summary.broken:
        return (f"none: it needs {AFTER_A_GAP} or more whole periods of excitation in a row at the end; "
                f"{summary.broken} of {summary.cycles - summary.discarded} kept ones are not whole or not known")
    return "none: too few were solved"


def covers_row(summary: Summary, begin: float = math.nan, end: float = math.nan) -> list[tuple[str, str]]:
    """Return the time that the figures of a run from `begin` to `end`, s, cover, unless they cover all of it."""
    first, last = summary.covers
    near = 1e-9 * (end - begin)
    if first <= begin + near and last >= end - near and not summary.lost_seconds:
        return []
    whole = "" if math.isnan(begin) else f" of {begin:.6g} to {end:.6g} s"
    lost = (f"; {summary.lost_seconds:.6g} s of them were lost, which leaves {summary.seconds:.6g} s"
            if summary.lost_seconds else "")
    return [("figures cover", f"{first:.6g} to {last:.6g} s{whole}{lost}")]


def tracking_lines(tracking: Tracking) -> list[str]:
    """Return the text of a tracking in lines: target and errors, peaks, verdict, and pressure commands."""
    if not math.isfinite(tracking.rms_error):
        return [f"target {speed(tracking.target)}: no verdict: {tracking.verdict_why}"]
    varies = tracking.target_low < tracking.target_high
    aim = speed(tracking.target_low, 6, tracking.target_high) if varies else speed(tracking.target)
    sign = "+" if tracking.peak_deviation > 0.0 else ""
    lines = [f"target {aim}: mean {speed(tracking.mean_slip)}, rms error {speed(tracking.rms_error, 4)}, "
             f"largest {speed(tracking.largest_error, 4)}",
             f"peak {sign}{speed(tracking.peak_deviation, 4)} at {tracking.peak_time:.6g} s, overshoot "
             f"{speed(tracking.overshoot, 4)}"
             + (f" at {tracking.overshoot_time:.6g} s" if math.isfinite(tracking.overshoot_time) else "")]
    settled = f" after {tracking.settling_time:.4g} s" if tracking.settled else ""
    lines.append(f"{tracking.verdict}{settled}: {tracking.verdict_why}")
    if tracking.time_at_limit > 0.0:
        lines.append(f"pressure at a limit for {100.0 * tracking.time_at_limit:.3g} % of the time")
    if tracking.commands_applied is not None:
        lines.append(f"{counted(tracking.commands_applied, 'command')} applied, {tracking.command_rate:.4g} a second, "
                     f"{tracking.commands_superseded} superseded")
    if tracking.lost_seconds > 0.0:
        lines.append(f"over {tracking.seconds:.6g} s; {tracking.lost_seconds:.4g} s between were not observed")
    return lines


def damping_row(damping: Damping) -> tuple[str, str]:
    """Return the equivalent damping (21), with the mean slope and the threshold of (23)."""
    if math.isnan(damping.weighted):
        reason = ("there is no slip" if math.isfinite(damping.negative_mean) else
                  "no whole period of excitation could be solved")
        return "equivalent damping (21)", f"none: {reason}"
    return ("equivalent damping (21)",
            f"{damping.weighted:.4g} N m s/rad, mean of the negative slope {damping.negative_mean:.4g}; "
            f"-C23 is {damping.threshold:.4g}")


def sweep_lines(sweep: Sweep | Grid, width: int | None = None) -> list[str]:
    """Return a heading with names and units, and one line per point, first the keys with their values.

    Columns that do not fit in the width of the terminal form further tables below.
    """
    columns = sweep.columns()
    units, keys = units_of_columns(type(sweep), columns), list(columns)[:list(columns).index("max_slip_speed")]
    status, failed = columns["status"], np.isnan(columns["max_slip_speed"])
    sampled = []
    for key in keys:
        unit, factor = key_unit(key)
        sampled.append(_padded([key.rpartition(".")[2], unit, *(f"{x * factor:.8g}" for x in columns[key].tolist())]))
    tables: list[list[list[str]]] = []
    used = math.inf
    shown = SWEPT if "judder_rms" not in columns else (
        *SWEPT, "clutch_energy", "max_shaft_torque", *MANOEUVRE, *(name for name in columns if "_order_" in name))
    for name in (name for name in shown if name in columns):
        unit, factor = shown_unit(units.get(name, ""))
        cells = [_cell(columns, name, k, factor) for k in range(len(status))]
        column = _padded([name, "periods" if name == "period" else unit, *cells])
        used += 2 + len(column[0])
        if not tables or (width is not None and used > width):
            tables.append([])
            used = sum(2 + len(one[0]) for one in (*sampled, column)) - 2
        tables[-1].append(column)
    lines = []
    for table in tables:
        for k, line in enumerate(zip(*sampled, *table)):
            fails = k > 1 and failed[k - 2]
            lines.append("  ".join([*line[:len(keys)], str(status[k - 2])] if fails else line).rstrip())
    return lines + unsettled_lines(sweep.sweeps if hasattr(sweep, "sweeps") else [sweep], "* ")


def _padded(cells: list[str]) -> list[str]:
    width = max(map(len, cells))
    return [f"{cell:>{width}}" for cell in cells]


def _cell(columns: Mapping[str, Any], name: str, k: int, factor: float) -> str:
    """Return one result of a sweep; a star marks the period of a motion that has not settled."""
    value = columns[name][k].item()
    if name == "period":
        return "runaway" if columns["runaway"][k] else f"{value or 'none'}{'*' if columns['transient'][k] else ''}"
    if isinstance(value, float):
        return "none" if math.isnan(value) else f"{value * factor:.{7 if name == 'max_slip_speed' else 4}g}"
    return str(value)


def gain_lines(result: GainMap, alone: bool = False) -> list[str]:
    """Return a line with the number of settled loops and the best of them, then one for each loop unless `alone`."""
    trackings = [point.tracking for point in result.points]
    settled = sum(tracking.settled for tracking in trackings)
    lines = [f"{settled} of {counted(len(trackings), 'loop')} settled, in {result.seconds:.3g} s"]
    columns = result.columns()
    keys = [key for key in (result.key, result.second_key) if key is not None]

    def line(k: int) -> str:
        values = ", ".join(f"{key} {columns[key][k]:.6g}" for key in keys)
        figures = ", ".join(f"{name} {value:.4g} {unit}" for name, value, unit in (
            ("settling", trackings[k].settling_time, "s"), ("overshoot", trackings[k].overshoot, "rad/s"),
            ("peak", trackings[k].peak_deviation, "rad/s")) if math.isfinite(value))
        return f"{values}: {trackings[k].verdict or 'not judged'}{', ' * bool(figures)}{figures}"

    if settled:
        best = min((k for k, tracking in enumerate(trackings) if tracking.settled),
                   key=lambda k: trackings[k].settling_time)
        lines.append(f"the first to settle: {line(best)}")
    return lines if alone else [*lines, *map(line, range(len(trackings)))]


def unsettled_lines(sweeps: Sequence[Sweep], mark: str = "") -> list[str]:
    """Return a line with the number of motions that have not settled, and the remedy; no line if all have settled."""
    count, values = sum(s.not_settled for s in sweeps), sum(len(s.points) for s in sweeps)
    return [f"{mark}{count} of {counted(values, 'point')} {'has' if count == 1 else 'have'} not settled; "
            f"{_remedy(sweeps)}"] if count else []


def doubtful_lines(sweeps: Sequence[Sweep]) -> list[str]:
    """Return a line with the number of points whose solver reached the end with a doubt, and the first one's doubt."""
    points, done = [point for sweep in sweeps for point in sweep.points], f"{Status.DONE.value}; "
    doubts = [p.status.removeprefix(done) for p in points if p is not None and p.status.startswith(done)]
    return [f"{len(doubts)} of {counted(len(points), 'point')} {'is' if len(doubts) == 1 else 'are'} doubtful, "
            f"the first one because {doubts[0]}"] if doubts else []


def _remedy(sweeps: Sequence[Sweep]) -> str:
    """Return the cause or the remedy of motions of a sweep that have not settled."""
    if sweeps[0].curve.system.varying:
        return "their inputs vary in time"
    return "raise --cycles" if sweeps[0].plan.duration is None else "raise --duration"


def quantile_lines(scattered: Scattered) -> list[str]:
    """Return quantiles of the main results over the samples, for each value of a swept key."""
    values = scattered.sweeps[0].curve.values if scattered.over else ()
    lines = [f"{counted(scattered.tolerances.samples, 'sample')} of "
             + ", ".join(key_value(key, low, 6, high) for key, low, high in scattered.tolerances.bounds)]
    left_out = scattered.left_out
    if any(left_out.values()):
        lines.append(f"quantiles leave out {counted(left_out['runaway'], 'result')} that ran away and "
                     f"{left_out['not_settled']} that have not settled; {_remedy(scattered.sweeps)}, or give "
                     "--every-sample")
    failed = [p.status for sweep in scattered.sweeps for p in sweep.points if p is not None and p.summary is None]
    if failed:
        lines.append(f"quantiles leave out {counted(len(failed), 'result')} whose solver failed, the first one: "
                     f"{failed[0]}")
    shares = "".join(f"  {100.0 * p:g} %" for p in scattered.tolerances.probabilities)
    starts = [f"  {key_value(scattered.over, value, 8)}" for value in values] or [" "]
    names = [*QUANTILES, *(MANOEUVRE if scattered.sampled else ())]
    units = units_of_columns(Summary, QUANTILES) | units_of_columns(JudderFigures, MANOEUVRE)
    tables = [(name, units.get(name, ""), scattered.quantiles(name)) for name in names]
    orders, quantiles = scattered.orders, scattered.order_quantiles
    if orders is not None and quantiles is not None:
        for name, unit in (("slip_speed", "rad/s"), ("shaft_torque", "N m")):
            of_values = quantiles[name] if scattered.over else quantiles[name][None]
            tables += [(f"{name} of order {order:g} at {engine_speed(omega)}", unit, of_values[:, i, k])
                       for i, omega in enumerate(orders.speeds) for k, order in enumerate(orders.order)]
    for name, unit, rows in tables:
        shown, factor = shown_unit(unit)
        lines.append(f"{name}{shown and f' ({shown})'}{shares}")
        lines += [start + ("  none: no sample is left" if np.isnan(row).all() else
                           "".join(f"  {x:.6g}" for x in row)) for start, row in zip(starts, factor * rows)]
    return lines


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
