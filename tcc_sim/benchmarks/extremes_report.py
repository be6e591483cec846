"""The stability report: extreme scenes for every engine, and error charts of the fixed-step methods."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from tcc_sim.benchmarks.extremes import ENGINES, Truth, cases, examine
from tcc_sim.model.parameters import DEFAULTS

Record = dict[str, Any]
COUNT, QUICK_COUNT = 330, 36


def grid(quick: bool, done: Callable[[int, int, str], None]) -> Iterator[Record]:
    """Every extreme case with every engine, one record each, as stability.json holds them.

    Parameters
    ----------
    done : called with cases done, cases in all, and what comes next
    """
    chosen = cases(QUICK_COUNT if quick else COUNT)
    for count, keys in enumerate(chosen):
        done(count, len(chosen), "extreme scenes")
        truths = {law: Truth(keys, law) for law in dict.fromkeys(law for law, _ in ENGINES.values())}
        for engine, (law, _) in ENGINES.items():
            yield examine(keys, engine, truths[law])


def summary(records: list[Record]) -> Record:
    """For each engine: cases, statuses, violations (none is right), and quantiles of error and power residual."""
    out: Record = {}
    for engine in ENGINES:
        rows = [r for r in records if r["solver"] == engine]
        ran = [r for r in rows if r["status"] != "REFUSED"]
        out[engine] = {
            "cases": len(rows), "statuses": dict(Counter(r["status"] for r in rows)),
            "not_finite": sum(r["finite"] is False for r in ran),
            "not_bounded": sum(r["bounded"] is False for r in ran),
            "iterations_max": max((r["iterations_max"] for r in ran), default=0),
            "iterations_bound": max((r["iterations_bound"] for r in ran), default=0),
            "past_iteration_bound": sum(r["iterations_max"] > r["iterations_bound"] > 0 for r in ran),
            "without_reference": sum(r["error"] is None for r in ran),
            "error": _quantiles([r["error"] for r in ran]),
            "power_residual": _quantiles([r["power_residual"] for r in ran]),
            "longest_seconds": max((r["seconds"] for r in ran), default=0.0)}
    return out


def changes(record: Record) -> Record:
    """The scene keys of a record that differ from the defaults."""
    return {k: v for k, v in record.items() if k in DEFAULTS and k != "friction.law" and DEFAULTS[k] != v}


def markdown(found: Record, picture: str) -> str:
    """The report: criteria, summary, what was refused or fell short, and the worst errors."""
    lines = [
        "# Stiff and extreme cases", "", f"![error charts and extreme cases]({picture})", "",
        f"{len(found['cases'])} runs: {len(found['cases']) // len(ENGINES)} scenes with each of "
        f"{', '.join(map(_code, ENGINES))} (1 ms ticks). mu_s/mu_k 1 to 4, sigma 50 to 1e9 s/rad, Tsp/Tsm 0 to 1.5 "
        "(the pressure clamped at 0), omega 1 to 5000 rad/s, mean pressure 0 to 10 MPa, C23 0 to critical, I2 down to "
        "1e-6 kg m^2, initial slip 0 to 1e4 rad/s, near-grazing undamped stick, and combinations.", "",
        "Bounded: sqrt(E(t)) <= sqrt(E(0)) + t max|Te|/sqrt(2 I1), since friction and damper only take energy. Power: "
        "engine work less losses and stored energy in each cycle, relative to the largest of work and energy; its "
        "quadrature is good to about 1e-5; `fixed_step` is interpolated between its sub-steps, which shows where slip "
        "stops within one. Error: state after at most 60 rad of the natural "
        "frequency, relative to each signal's maximum, against SciPy (LSODA for the smoothed law, DOP853 from event to "
        "event for the set-valued one). Above sigma = 1e5 s/rad the smoothed law is held against the set-valued one, "
        "from which it differs by about 1/sigma.", "",
        "| | " + " | ".join(map(_code, ENGINES)) + " |", "| --- |" + " ---: |" * len(ENGINES)]
    total = found["summary"]
    for name, show in _ROWS:
        lines.append(f"| {name} | " + " | ".join(show(total[engine]) for engine in ENGINES) + " |")
    lines += ["", "## Refused or stopped", ""]
    stopped = Counter((r["solver"], r["status"], r["why"]) for r in found["cases"] if r["status"] != "DONE")
    lines += [f"- `{solver}`, {status}: {why} ({n})" for (solver, status, why),
              n in sorted(stopped.items())] or ["None."]
    lines += ["", "## Largest errors", "", "| solver | error | scene |", "| --- | ---: | --- |"]
    for engine in ENGINES:
        rows = [r for r in found["cases"] if r["solver"] == engine and r["error"] is not None]
        lines += [f"| `{engine}` | {r['error']:.1e} | {', '.join(f'{k} {v:.6g}' for k, v in changes(r).items())} |"
                  for r in sorted(rows, key=lambda r: -r["error"])[:5]]
    if not found["complete"]:
        lines += ["", "**Interrupted: this report is not complete.**"]
    return "\n".join(lines) + "\n"


def _quantiles(values: list[float | None]) -> dict[str, float | None]:
    """Median, 90 %, 99 % and the largest."""
    known = [v for v in values if v is not None]
    return {name: float(np.quantile(known, q)) if known else None
            for name, q in (("median", 0.5), ("p90", 0.9), ("p99", 0.99), ("max", 1.0))}


def _code(name: str) -> str:
    """As code."""
    return f"`{name}`"


def _four(values: dict[str, float | None]) -> str:
    """Median, 90 %, 99 % and the largest in one cell."""
    return " / ".join("-" if v is None else f"{v:.0e}" for v in values.values())


_ROWS: tuple[tuple[str, Callable[[Record], str]], ...] = (
    ("runs", lambda s: str(s["cases"])),
    ("ended", lambda s: ", ".join(f"{k} {v}" for k, v in s["statuses"].items())),
    ("not finite", lambda s: str(s["not_finite"])),
    ("past the energy bound", lambda s: str(s["not_bounded"])),
    ("most iterations of one solve (bound)",
     lambda s: f"{s['iterations_max']} ({s['iterations_bound']})" if s["iterations_bound"] else "none"),
    ("error: median / 90 % / 99 % / largest", lambda s: _four(s["error"])),
    ("power residual: the same", lambda s: _four(s["power_residual"])),
    ("without a reference", lambda s: str(s["without_reference"])),
    ("longest solve (s)", lambda s: f"{s['longest_seconds']:.2g}"))
