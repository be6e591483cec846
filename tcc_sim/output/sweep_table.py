"""The points of a sweep as lines for a terminal, with a column for every extra that was asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from tcc_sim.errors import counted
from tcc_sim.sweeps.results import Sweep, extras_of
from tcc_sim.sweeps.scatter import PROBABILITIES, Scattered

Row = dict[str, Any]

Column = tuple[str, int, Callable[[Row], str]]

COLUMNS: list[Column] = [
    ("max |slip|", 11, lambda r: f"{r['max_slip_speed']:.7g}"),
    ("period", 7, lambda r: period_of(r)),
    ("stick", 6, lambda r: f"{r['stick_fraction']:.4f}"),
    ("regime", 10, lambda r: str(r["regime"]))]
"""Heading, width and text of the columns that are always there."""
DAMPING: list[Column] = [
    ("Cf (21)", 9, lambda r: _number(r.get("equivalent_damping"))),
    ("neg. slope", 10, lambda r: _number(r.get("negative_slope_mean")))]
EXPONENT: list[Column] = [
    ("exponent", 9, lambda r: _number(r["lyapunov"]["exponent"])),
    ("+-", 7, lambda r: _half(r["lyapunov"])),
    ("diagnosis", 14, lambda r: str(r["lyapunov"]["diagnosis"]))]


def sweep_lines(sweeps: Sequence[Sweep], second_key: str = "", second_values: Sequence[float] = (),
                width: int | None = None) -> list[str]:
    """A heading and a line per point; a grid has the value of its second key first. Columns beyond the width of the
    terminal make tables of their own below.
    """
    extras = extras_of(sweeps)
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
    settling = any(record is not None and record["period"] and not record["settled"] for _, record in rows)
    return [*lines, "* still settling"] if settling else lines


QUANTILES = (("max_slip_speed", "largest |slip speed|", "rad/s", 1.0), ("stick_fraction", "in stick", "%", 100.0),
             ("clutch_energy", "clutch energy", "J", 1.0), ("max_shaft_torque", "largest shaft torque", "N m", 1.0))


def quantile_lines(found: Scattered) -> list[str]:
    """Quantiles of the main results over the samples, per value where there is another key."""
    values = found.sweeps[0].curve.values if found.over else ()
    lines = [f"{counted(found.tolerances.samples, 'sample')} of "
             + ", ".join(f"{key} {low:g} to {high:g}" for key, low, high in found.tolerances.bounds)]
    for name, told, unit, scale in QUANTILES:
        lines.append(f"{told} ({unit})" + "".join(f"  {100.0 * p:g} %" for p in PROBABILITIES))
        for k, row in enumerate(scale * found.quantiles(name)):
            start = f"  {found.over} {values[k]:.8g}" if found.over else " "
            lines.append(start + "".join(f"  {x:.6g}" for x in row))
    return lines


def _tables(columns: list[Column], start: int, width: int | None) -> list[list[Column]]:
    """The columns in as many tables as the width asks for, each behind `start` characters of keys."""
    tables: list[list[Column]] = [[]]
    for column in columns:
        used = start + sum(2 + wide for _, wide, _ in tables[-1])
        if width is not None and tables[-1] and used + 2 + column[1] > width:
            tables.append([])
        tables[-1].append(column)
    return tables


def period_of(record: Row) -> str:
    """The period in engine cycles, with a star where it has not settled; runaway, or none."""
    if record["runaway"]:
        return "runaway"
    return f"{record['period']}{'' if record['settled'] else '*'}" if record["period"] else "none"


def _number(value: float | None) -> str:
    """Four digits, or none."""
    return "none" if value is None else f"{value:.4g}"


def _half(found: Row) -> str:
    """Half the width of an interval."""
    return "none" if found["low"] is None else f"{0.5 * (found['high'] - found['low']):.2g}"
