"""The work-precision study as Markdown."""

from __future__ import annotations

from typing import Any

from tcc_sim.benchmarks.steady_state import comparison
from tcc_sim.benchmarks.sweep_speed import STRETCHES, speed_rows, speed_summary
from tcc_sim.benchmarks.work_precision import fastest
from tcc_sim.solvers import SOLVERS

Record = dict[str, Any]
TARGETS = (1e-3, 1e-6, 1e-9)
"""Errors for which the fastest setting of every solver is listed."""


def markdown(found: Record, picture: str) -> str:
    """The report: how it was made, the fastest settings, every run, and what was left out."""
    lines = ["# Error against run time", "", f"![error against run time]({picture})", "", *_method(found), ""]
    for record in found["scenes"]:
        lines += _summary(record, found["scenes"])
    if found["sweep_speed"] is not None:
        lines += _speed(found["sweep_speed"])
    lines += ["## Every run", ""]
    for record in found["scenes"]:
        lines += [f"### {record['scene']}", "",
                  "| solver | setting | final | section | maximum slip | steady state | time (ms) | steps |",
                  "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"]
        lines += [f"| {_name(r['solver'])} | {r['setting']:.3g} | {r['error_final']:.1e} | {r['error_section']:.1e} | "
                  f"{r['error_max_slip']:.1e} | {_or_dash(r['error_steady'])} | {1e3 * r['seconds']:.3g} | "
                  f"{'' if r['steps'] is None else r['steps']} |"
                  for r in record["results"]]
        lines += ["", *(_omitted(record) if record["omitted"] else [])]
    return "\n".join(lines).rstrip() + "\n"


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
        "below it is not resolved.",
        "`event_driven` and Siconos solve the set-valued law, against references solved from event to event; "
        "everything else solves the smoothed law.",
        f"Other programs: {peers}. XPPAUT's results are in single precision, so errors of it below about 1.2e-7 mean "
        "nothing; its time is that of the whole horizon less that of one cycle, scaled to the horizon, so start-up is "
        "left out. Siconos's time is that of its loop. `solve_ivp LSODA` is SciPy's function with a compiled "
        "right-hand side and Jacobian that keeps the section only."]
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
             f"{reference['floor']:.1e}.", "", comparison(record, scenes), "",
             "| time (ms) for all three errors at most | " + " | ".join(f"{t:g}" for t in TARGETS) + " |",
             "| --- |" + " ---: |" * len(TARGETS)]
    names = [n for n in dict.fromkeys(r["solver"] for r in record["results"]) if any(n in b for b in best)]
    for name in names:
        cells = [f"{1e3 * b[name]['seconds']:.3g}" if name in b else "-" for b in best]
        lines.append(f"| {_name(name)} | " + " | ".join(cells) + " |")
    if record["long_run"]:
        lines += ["", "| long run, at the setting for 1e-6 | cycles | ms per 100 cycles |", "| --- | ---: | ---: |"]
        lines += [f"| {_name(r['solver'])} at {r['setting']:g} | {r['cycles']} | "
                  f"{1e3 * r['seconds_per_100_cycles']:.4g} |"
                  for r in record["long_run"]]
    return [*lines, ""]


def _speed(found: Record) -> list[str]:
    """Cycles per second on the scenes of Fig. 4."""
    lines = ["## Engine cycles a second, on the scenes of Fig. 4", "",
             f"Each program at its loosest tolerance with a section error of at most {found['error']:g} over "
             f"{found['horizon']} cycles, from the initial state and from a state on the attractor; the time is that "
             f"of {found['cycles']} cycles from there, on one core.", ""]
    for stretch in STRETCHES:
        lines += [f"| {stretch}: mu_k/mu_s | omega/omega_n | `smoothed`: cycles a second | rtol | error | "
                  "at the default rtol | error | XPPAUT cvode: cycles a second | toler | error | ratio |",
                  "|" + " ---: |" * 11]
        for row in speed_rows(found, stretch):
            cells = [f"{row.kinetic_ratio:.3g}", f"{row.frequency_ratio:g}", *_cells(row.loosest, True),
                     *_cells(row.default, False), *_cells(row.peer, True),
                     "-" if row.ratio is None else f"{row.ratio:.2g}"]
            lines.append("| " + " | ".join(cells) + " |")
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
    best = fastest(record, 1e-6)
    times = [f"{name} {1e3 * row['seconds']:.3g} ms" for name,
             row in sorted(best.items(), key=lambda x: x[1]["seconds"])]
    head = (f"{record['scene']}: floor {record['reference']['floor']:.1e}; "
            f"{record['cycles']} cycles with errors up to 1e-6: ")
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
