"""The work-precision study as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from tcc_sim.benchmarks.peers import TIMED
from tcc_sim.benchmarks.steady_state import comparison
from tcc_sim.benchmarks.sweep_speed import STRETCHES, speed_rows, speed_summary
from tcc_sim.benchmarks.work_precision import fastest
from tcc_sim.output.tables import markdown_table
from tcc_sim.solvers import SOLVERS

Record = dict[str, Any]
TARGETS = (1e-3, 1e-6, 1e-9)
"""Errors for which the fastest setting of every solver is listed."""
TARGET = 1e-6
"""The one that the first sentences are about."""
ENGINES = {"smoothed": "smoothed", "set_valued": "event_driven"}
"""The engine that the others of each friction law are compared with."""
PAPERS = ", the paper's method"


def markdown(found: Record, picture: str) -> str:
    """The report: what came out, how it was made, the fastest settings, every run, and what was left out."""
    lines = ["# Error against run time", "", *_head(found), "", f"![error against run time]({picture})", "",
             *_method(found), ""]
    for record in found["scenes"]:
        lines += _summary(record, found["scenes"])
    if found["sweep_speed"] is not None:
        lines += _speed(found["sweep_speed"])
    lines += ["## Every run", ""]
    for record in found["scenes"]:
        lines += [f"### {record['scene']}", "", *_table(
            ("solver", "setting", "final", "section", "maximum slip", "steady state", "time (ms)", "steps"),
            [(_name(r["solver"]), f"{r['setting']:.3g}", f"{r['error_final']:.1e}", f"{r['error_section']:.1e}",
              f"{r['error_max_slip']:.1e}", _or_dash(r["error_steady"]), f"{1e3 * r['seconds']:.3g}",
              "" if r["steps"] is None else str(r["steps"])) for r in record["results"]])]
        lines += ["", *(_omitted(record) if record["omitted"] else [])]
    return "\n".join(lines).rstrip() + "\n"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A table of names and numbers."""
    return markdown_table(head, rows, "---:", "---")


def _head(found: Record) -> list[str]:
    """What came out, in sentences, and that the page is generated."""
    said = ["This page is generated: `tcc-sim precision" + (" --quick" if found["quick"] else "") + "` writes it."]
    cycles = found["scenes"][0]["cycles"]
    for law, engine in ENGINES.items():
        scenes = [record for record in found["scenes"] if record["law"] == law]
        best = [fastest(record, TARGET) for record in scenes]
        own = [row[engine]["seconds"] for row in best if engine in row]
        if not own:
            continue
        said += ["", f"With all three errors at most {TARGET:g}, {cycles} engine cycles take {_name(engine)} "
                 f"{_range([1e3 * x for x in own])} ms on the {len(scenes)} scenes of its friction law."]
        names = dict.fromkeys(r["solver"] for record in scenes for r in record["results"])
        others = [name for name in names if name != engine]
        said += ["", "As many times as long take:", ""] if others else []
        for name in others:
            ratios = [row[name]["seconds"] / row[engine]["seconds"] for row in best if name in row and engine in row]
            where = f", on {len(ratios)} of {len(scenes)} scenes" if 0 < len(ratios) < len(scenes) else ""
            said.append(f"- {_name(name)}{PAPERS if name == 'rk45' else ''}: " + (
                f"{_range(ratios)}{where}" if ratios else f"does not come to {TARGET:g} with the settings below"))
    return [*said, "", *_calls(found)]


def _calls(found: Record) -> list[str]:
    """How much of the time of other programs is calls of Python."""
    rows = [(call, r) for record in found["scenes"] for call in record["calls"] for r in record["results"]
            if (r["solver"], r["setting"]) == (call["solver"], call["setting"])]
    if not rows:
        return []
    shares = [100.0 * min(call["seconds"] / r["seconds"], 1.0) for call, r in rows]
    return ["CVODE is that of SUNDIALS in double precision, through scikit-sundae. The binding takes functions of "
            f"Python only: they call compiled ones, and these calls alone are {_range(shares)} % of its time. XPPAUT's "
            "CVODE interprets the equations in C, and its results come in single precision."]


def _range(values: list[float]) -> str:
    """Least and largest, with two digits."""
    low, high = (f"{float(f'{x:.2g}'):g}" for x in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def _method(found: Record) -> list[str]:
    """What was measured and how."""
    peers = "; ".join(f"{name} {'joined' if why == 'joined' else f'did not join: {why}'}" for name,
                      why in found["peers"].items())
    cycles = found["scenes"][0]["cycles"] if found["scenes"] else 0
    out = [
        "Errors are relative to each signal's maximum in the second half of the horizon, the largest over slip speed, "
        "plate angle and plate speed: of the final state, of all states at t = 2 pi n/omega (section), and of each "
        "cycle's largest slip speed.",
        f"The horizon is {cycles} engine cycles from the initial state, transient included: longer ones say nothing "
        "where the motion is chaotic.",
        "The steady state is that of a long run from the initial state; its error is that of the largest slip speed "
        "of the last cycles. Solvers that would take too long for it have none, nor have motions without a period.",
        "Times are minima of the CPU time of repeated calls of `solve` (one thread), per-cycle results included; the "
        "first call, which compiles, is kept apart (`warm_up` in the JSON). Settings are tolerances of adaptive "
        "solvers and steps in s of fixed-step ones.",
        "The floor is the disagreement of two SciPy references, which use nothing of this package's solvers; an error "
        "below it is not resolved, and drawn faded.",
        "`event_driven` and Siconos solve the set-valued law, against references solved from event to event; "
        "everything else solves the smoothed law.",
        f"Other programs: {peers}. XPPAUT's results are in single precision, so errors of it below about 1.2e-7 mean "
        f"nothing; its time is that of {TIMED} cycles less that of one, scaled to the horizon, so start-up is left out."
        " Siconos's time is that of its loop. `solve_ivp LSODA` is SciPy's function with a compiled right-hand side "
        "and Jacobian that keeps the section only."]
    if not found["complete"]:
        out.append("**Interrupted: this report is not complete.**")
    return [line for text in out for line in (text, "")][:-1]


def _or_dash(value: float | None) -> str:
    """An error, or a dash where there is none."""
    return "-" if value is None else f"{value:.1e}"


def _summary(record: Record, scenes: list[Record]) -> list[str]:
    """The steady state of a scene, and the fastest setting of each solver for some errors."""
    best = [fastest(record, target) for target in TARGETS]
    reference = record["reference"]
    lines = [f"## {record['scene']}", "",
             f"{record['description']}. References: {' and '.join(reference['solvers'])}; floor "
             f"{reference['floor']:.1e}.", "", comparison(record, scenes), ""]
    names = [n for n in dict.fromkeys(r["solver"] for r in record["results"]) if any(n in b for b in best)]
    lines += _table(["time (ms) for all three errors at most", *(f"{t:g}" for t in TARGETS)],
                    [[_name(n), *(f"{1e3 * b[n]['seconds']:.3g}" if n in b else "-" for b in best)] for n in names])
    if record["long_run"]:
        lines += ["", *_table(("long run, at the setting for 1e-6", "cycles", "ms per 100 cycles"),
                              [(f"{_name(r['solver'])} at {r['setting']:g}", str(r["cycles"]),
                                f"{1e3 * r['seconds_per_100_cycles']:.4g}") for r in record["long_run"]])]
    return [*lines, ""]


def _speed(found: Record) -> list[str]:
    """Cycles per second on the scenes of Fig. 4."""
    lines = ["## Engine cycles a second, on the scenes of Fig. 4", "",
             f"Each program at its loosest tolerance with a section error of at most {found['error']:g} over "
             f"{found['horizon']} cycles, from the initial state and from a state on the attractor; the time is that "
             f"of {found['cycles']} cycles from there, on one core.", ""]
    for stretch in STRETCHES:
        head = (f"{stretch}: mu_k/mu_s", "omega/omega_n", "`smoothed`: cycles a second", "rtol", "error",
                "at the default rtol", "error", "XPPAUT cvode: cycles a second", "toler", "error", "ratio")
        lines += markdown_table(head, [(
            f"{row.kinetic_ratio:.3g}", f"{row.frequency_ratio:g}", *_cells(row.loosest, True),
            *_cells(row.default, False), *_cells(row.peer, True), "-" if row.ratio is None else f"{row.ratio:.2g}")
            for row in speed_rows(found, stretch)], "---:")
        lines.append("")
    left_out = [f"{_name(row['solver'])} at {row['kinetic_ratio']:.3g}, {row['frequency_ratio']:g}, {row['stretch']}: "
                f"{row['why']}" for row in found["omitted"]]
    if left_out:
        lines += ["Omitted (mu_k/mu_s, omega/omega_n): " + "; ".join(left_out) + ".", ""]
    return [*lines, *(f"- {line[0].upper()}{line[1:]}." for line in speed_summary(found)), ""]


def _cells(row: Record | None, tolerance: bool) -> list[str]:
    """Cycles a second, the tolerance where it is asked for, and the error."""
    if row is None:
        return ["-", "-", "-"] if tolerance else ["-", "-"]
    return [f"{row['cycles_per_second']:.0f}", *([f"{row['setting']:g}"] if tolerance else []), f"{row['error']:.0e}"]


def scene_lines(record: Record) -> list[str]:
    """The fastest settings of a scene for a terminal."""
    best = fastest(record, TARGET)
    times = [f"{name} {1e3 * row['seconds']:.3g} ms" for name,
             row in sorted(best.items(), key=lambda x: x[1]["seconds"])]
    head = (f"{record['scene']}: floor {record['reference']['floor']:.1e}; "
            f"{record['cycles']} cycles with errors up to {TARGET:g}: ")
    return [head + (", ".join(times) or "none"), *(
        f"    {row['solver']} at {row['setting']:g}: {1e3 * row['seconds_per_100_cycles']:.4g} ms per 100 cycles"
        for row in record["long_run"])]


def _omitted(record: Record) -> list[str]:
    """What failed and why."""
    return ["Omitted:", "",
            *(f"- {_name(row['solver'])} at {row['setting']:.3g}: {row['why']}" for row in record["omitted"]), ""]


def _name(solver: str) -> str:
    """Registered solvers as code."""
    return f"`{solver}`" if solver in SOLVERS else solver
