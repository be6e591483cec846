"""The stability report: extreme scenes for every engine, and error charts of the fixed-step methods."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from tcc_sim.benchmarks.extremes import ENGINES, MANY, Truth, cases, examine
from tcc_sim.model.parameters import DEFAULTS
from tcc_sim.output.tables import markdown_table

Record = dict[str, Any]
COUNT, QUICK_COUNT = 420, 36


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
    """What a record's case differs in from the defaults: scene keys, more cycles than usual, a coarser tick."""
    out = {k: v for k, v in record.items() if k in DEFAULTS and k != "friction.law" and DEFAULTS[k] != v}
    if record["cycles"] == MANY:
        out["cycles"] = MANY
    if (record["step"] or 0.0) > (ENGINES[record["solver"]][1] or math.inf):
        out["tick"] = record["step"]
    return out


def ended_badly(record: Record) -> bool:
    """Whether a run was stopped, gave what is not finite, or passed its energy or iteration bound."""
    stopped = record["status"] not in ("DONE", "REFUSED")
    return bool(stopped or record["finite"] is False or record["bounded"] is False
                or (record["iterations_max"] or 0) > (record["iterations_bound"] or math.inf))


def markdown(found: Record, picture: str) -> str:
    """The report: what came out, criteria, summary, what ended badly or was refused, and the worst errors."""
    cases, total = found["cases"], found["summary"]
    lines = [
        "# Stiff and extreme cases", "", *_head(found), "", f"![error charts and extreme cases]({picture})", "",
        f"{len(cases)} runs: {len(cases) // len(ENGINES)} cases with each of "
        f"{', '.join(map(_code, ENGINES))} (1 ms ticks). mu_s/mu_k 1 to 4, alpha 0 to 1000 s/rad, sigma 1 to 1e9 s/rad,"
        " Tsp/Tsm 0 to 1.5 (the pressure clamped at 0), omega 1 to 5000 rad/s, omega_f/omega 1e-3 to 100 and "
        "incommensurable, mean pressure 0 to 10 MPa, C23 0 to 65 times critical, K23 1 to 1e8 N m/rad, I1 1e-4 to 1000 "
        "and I2 1e-6 to 100 kg m^2, initial slip 0 to 1e4 rad/s, near-grazing undamped stick, steps of pressure and "
        f"torque commands in stick and in slip, {MANY} cycles, ticks of 5 ms to 1 s, and combinations.", "",
        "Bounded: sqrt(E(t)) <= sqrt(E(0)) + t max|Te|/sqrt(2 I1), since friction and damper only take energy. Power: "
        "engine work less losses and stored energy in each cycle, relative to the largest of work and energy; its "
        "quadrature is good to about 1e-5; `fixed_step` is interpolated between its sub-steps, which shows where slip "
        "stops within one. Error: state after at most 60 rad of the natural "
        "frequency, relative to each signal's maximum, against SciPy (LSODA for the smoothed law, DOP853 from event to "
        "event for the set-valued one). Above sigma = 1e5 s/rad the smoothed law is held against the set-valued one, "
        "from which it differs by about 1/sigma.", "",
        *markdown_table(["", *map(_code, ENGINES)], [[name, *(show(total[engine]) for engine in ENGINES)]
                                                     for name, show in _ROWS], "---:", "---")]
    lines += ["", "## Ended badly", "", *listed(r for r in cases if ended_badly(r)), "", "## Refused", ""]
    refused = [r for r in cases if r["status"] == "REFUSED"]
    lines += [f"- `{engine}`: {len(whys)}, such as: {whys[0]}" for engine in ENGINES
              if (whys := [r["why"] for r in refused if r["solver"] == engine])] or ["None."]
    worst = [row for engine in ENGINES
             for row in sorted((r for r in cases if r["solver"] == engine and r["error"] is not None),
                               key=lambda r: -r["error"])[:5]]
    lines += ["", "## Largest errors", "", *markdown_table(
        ["solver", "error", "scene"], [[_code(r["solver"]), f"{r['error']:.1e}", _scene(r)] for r in worst])]
    if not found["complete"]:
        lines += ["", "**Interrupted: this report is not complete.**"]
    return "\n".join(lines) + "\n"


def _head(found: Record) -> list[str]:
    """What came out, in sentences, and that the page is generated."""
    cases = found["cases"]
    said = ["This page is generated: `tcc-sim stability" + (" --quick" if found["quick"] else "") + "` writes it.", ""]
    for engine in ENGINES:
        rows = [r for r in cases if r["solver"] == engine]
        bad, refused = sum(map(ended_badly, rows)), sum(r["status"] == "REFUSED" for r in rows)
        error, power = found["summary"][engine]["error"], found["summary"][engine]["power_residual"]
        said.append(f"- `{engine}`: of {len(rows)} cases {bad or 'none'} ended badly and {refused or 'none'} "
                    f"{'was' if refused == 1 else 'were'} refused; in 99 % of the others the error is at most "
                    f"{_number(error['p99'])}, the largest {_number(error['max'])}, and the power balance closes to "
                    f"{_number(power['p99'])}.")
    return said


def listed(records: Iterable[Record]) -> list[str]:
    """The exact scene of each."""
    return [f"- `{r['solver']}`, {r['status']}{': ' + r['why'] if r['why'] else ''}: {_scene(r)}"
            for r in records] or ["None."]


def _scene(record: Record) -> str:
    """What differs from the defaults, with all its digits."""
    return ", ".join(f"{k} {v!r}" for k, v in changes(record).items())


def _number(value: float | None) -> str:
    """A number with one digit."""
    return "-" if value is None else f"{value:.0e}"


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
    return " / ".join(map(_number, values.values()))


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
