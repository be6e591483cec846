"""Records of the work-precision study (precision.json), and its page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from tcc_sim.errors import counted
from tcc_sim.output.provenance import environment
from tcc_sim.output.tables import markdown_table
from tcc_sim.result import Described, reported, reporting
from tcc_sim.solvers import SOLVERS
from tcc_sim.study.benchmarks.peers import TIMED

TARGETS = (1e-3, 1e-6, 1e-9)
"""Errors for which the fastest setting of every solver is listed."""
TARGET = 1e-6
"""Error in the first sentences of the page."""
ENGINES = {"smoothed": "smoothed", "set_valued": "event_driven"}
"""Engine with which the other solvers of each friction law are compared."""
PAPERS = ", the paper's method"
APART = 0.05
"""Relative difference of largest slip speeds above which two motions differ."""


@dataclass(frozen=True)
class References:
    """Names of two references, and their difference, below which an error is not resolved."""

    solvers: Sequence[str] = field(metadata=reported("names of the two references"))
    floor: float = field(metadata=reported("relative difference of the references; an error below it is not resolved"))


@dataclass(frozen=True)
class SteadyState:
    """Steady motion from the initial state."""

    cycles: int = field(metadata=reported("number of periods of excitation from the initial state"))
    period: int = field(metadata=reported("period of the motion; 0 for none up to 16", "periods of excitation"))
    max_slip_speed: float | None = field(metadata=reported(
        "largest |slip speed| of SciPy's solution; null if the motion has no period or SciPy failed", "rad/s"))
    closure: float | None = field(metadata=reported(
        "distance of SciPy's solution from its start after one period, relative to each signal's maximum"))
    solvers: Sequence[str] = field(metadata=reported("names of the solvers that found the motion and solved it again"))


@dataclass(frozen=True)
class SolverSetting:
    """A solver at one of its tolerances or steps."""

    solver: str = field(metadata=reported("name of the solver"))
    setting: float = field(metadata=reported("relative tolerance, or step in s"))


@dataclass(frozen=True)
class PrecisionResult(SolverSetting):
    """Errors, fastest and slowest run time, s, and number of steps of a solver at a setting; None if not measured."""

    error_final: float = field(metadata=reported("error of the final state, relative to each signal's maximum"))
    error_section: float = field(metadata=reported("largest error on the section, relative to each signal's maximum"))
    error_max_slip: float = field(metadata=reported("relative error of the largest |slip speed|"))
    error_steady: float | None = field(metadata=reported(
        "relative error of the largest |slip speed| of the steady state; null if not measured"))
    seconds: float = field(metadata=reported("run time, minimum of several runs", "s"))
    slowest: float = field(metadata=reported("run time, maximum of several runs", "s"))
    steps: int | None = field(metadata=reported("number of steps; null if unknown"))

    @property
    def largest_error(self) -> float:
        """Largest of the three errors that every result has."""
        return max(self.error_final, self.error_section, self.error_max_slip)


@dataclass(frozen=True)
class Omitted(SolverSetting):
    """Solver at a setting without a result."""

    why: str = field(metadata=reported("reason of the missing result"))


@dataclass(frozen=True)
class LongRun(SolverSetting):
    """Run time of a solver over so many cycles that the cost of a call is negligible."""

    cycles: int = field(metadata=reported("number of periods of excitation"))
    seconds_per_100_cycles: float = field(metadata=reported(
        "run time of 100 periods of excitation in a run so long that the cost of a call is negligible", "s"))


@dataclass
class StudiedScene:
    """Measurements on one scene; `warm_up` is each solver's first call, which compiles, s."""

    scene: str = field(metadata=reported("name of the scene"))
    description: str = field(metadata=reported("description of the scene"))
    law: str = field(metadata=reported("friction law"))
    cycles: int = field(metadata=reported("number of periods of excitation solved"))
    reference: References = field(metadata=reported("the two references"))
    steady: SteadyState = field(metadata=reported("steady motion from the initial state"))
    results: list[PrecisionResult] = field(default_factory=list, metadata=reported("errors and run times"))
    omitted: list[Omitted] = field(default_factory=list, metadata=reported("solvers without a result"))
    warm_up: dict[str, float] = field(default_factory=dict, metadata=reported(
        "time of each solver's first call, which compiles", "s"))
    long_run: list[LongRun] = field(default_factory=list, metadata=reported(
        "run times of long runs, in which the cost of a call is negligible"))


@dataclass(frozen=True)
class PrecisionReport(Described):
    """Contents of precision.json."""

    scenes: Sequence[StudiedScene] = field(metadata=reported(
        "measurements on each scene; the fields of the first are also at the top"))
    peers: Mapping[str, str] = field(metadata=reported("participation of each other program, by its name"))
    quick: bool = field(metadata=reported("whether fewer settings were measured"))
    complete: bool = field(metadata=reported("false where it was interrupted"))
    python_loop: Mapping[str, float] = field(default_factory=dict, metadata=reported(
        "time of a step of dop853, and of its twelve evaluations of the equations; empty where not measured", "s"))
    machine: str = field(default_factory=lambda: machine(), metadata=reported("processor and versions"))

    @property
    @reporting("the first scene", spread=True)
    def first(self) -> StudiedScene:
        """First scene, whose fields are also at the top of the file."""
        return self.scenes[0]


def fastest_results(record: StudiedScene, target: float) -> dict[str, PrecisionResult]:
    """Return for each solver the fastest result with all three errors at most `target`."""
    out: dict[str, PrecisionResult] = {}
    for row in record.results:
        if row.largest_error <= target and (row.solver not in out or row.seconds < out[row.solver].seconds):
            out[row.solver] = row
    return out


def took_part(records: Sequence[StudiedScene]) -> dict[str, str]:
    """Return for each other program that it joined, or the reason why it did not."""
    out = {}
    for name in ("numbalsoda", "CVODE", "XPPAUT"):
        joined = any(row.solver.startswith(name) for record in records for row in record.results)
        missing = [row.why for record in records for row in record.omitted if row.solver.startswith(name)]
        out[name] = "joined" if joined else (missing[0] if missing else "not run")
    return out


def precision_page(report: PrecisionReport, picture: str) -> str:
    """Return the page: results, method, fastest settings and omitted settings; the JSON has every run."""
    lines = ["# Error against run time", "", *_head(report), "", f"![error against run time]({picture})", "",
             *_method(report), ""]
    for record in report.scenes:
        lines += _summary(record, report.scenes)
    for record in report.scenes:
        lines += [f"### {record.scene}, omitted", "", *_omitted(record)] if record.omitted else []
    return "\n".join(lines).rstrip() + "\n"


def code_name(solver: str) -> str:
    """Return the name of a registered solver as code, any other name unchanged."""
    return f"`{solver}`" if solver in SOLVERS else solver


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return a table of names and numbers."""
    return markdown_table(head, rows, "---:", "---")


def _head(report: PrecisionReport) -> list[str]:
    """Return the results in sentences."""
    said = ["This page is generated: `tcc-sim precision" + (" --quick" if report.quick else "") + "` writes it."]
    cycles = report.scenes[0].cycles
    for law, engine in ENGINES.items():
        scenes = [record for record in report.scenes if record.law == law]
        best = [fastest_results(record, TARGET) for record in scenes]
        seconds = [row[engine].seconds for row in best if engine in row]
        if not seconds:
            continue
        said += ["", f"With all three errors at most {_power(TARGET)}, {cycles} periods of excitation take "
                 f"{code_name(engine)} {_range([1e3 * x for x in seconds])} ms on the "
                 f"{counted(len(scenes), 'scene')} of its friction law."]
        names = dict.fromkeys(r.solver for record in scenes for r in record.results)
        others = [name for name in names if name != engine]
        said += ["", f"Run time relative to {code_name(engine)}:", ""] if others else []
        for name in others:
            ratios = [row[name].seconds / row[engine].seconds for row in best if name in row and engine in row]
            where = f", on {len(ratios)} of {len(scenes)} scenes" if 0 < len(ratios) < len(scenes) else ""
            said.append(f"- {code_name(name)}{PAPERS if name == 'rk45' else ''}: " + (
                f"{_range(ratios)}{where}" if ratios else f"does not reach {_power(TARGET)} before it fails or its "
                "tolerance ends"))
    return said


def machine() -> str:
    """Name the processor and the versions that times depend on."""
    versions = environment()
    packages = ", ".join(f"{name} {versions[name]}" for name in ("numpy", "scipy", "numba"))
    return f"{versions['processor']} (Python {versions['python']}, {packages})"


def _range(values: list[float]) -> str:
    """Return least and largest value with two digits."""
    low, high = (_digits(x, 2) for x in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def _method(report: PrecisionReport) -> list[str]:
    """Return the method in sentences."""
    peers = "; ".join(f"{name} {'joined' if why == 'joined' else f'did not join: {why}'}" for name,
                      why in report.peers.items())
    cycles = report.scenes[0].cycles if report.scenes else 0
    out = [
        "Errors are relative to each signal's maximum in the second half of the horizon, the largest over slip speed, "
        "plate angle and plate speed: of the final state, of all states at t = 2 pi n/omega (section), and of each "
        "cycle's largest slip speed.",
        f"Measured on {report.machine}.",
        f"The horizon is {cycles} periods of excitation from a settled state; that of a scene named so begins in its "
        "initial state, in slip, which a general solver passes in few steps. Errors over a "
        "longer horizon have no meaning if the motion is chaotic.",
        "The steady state is that of a long run from the initial state; its error is that of the largest slip speed "
        "of the last cycles. It is not measured for solvers that would take too long and for motions without a "
        "period.",
        "Times are minima of the CPU time of repeated calls of `solve` (one thread), per-cycle results included; in "
        "brackets how much longer the slowest of several calls took. The "
        "first call, which compiles, is listed separately (`warm_up` in the JSON). Settings are tolerances of adaptive "
        "solvers and steps in s of fixed-step ones.",
        "The floor is the disagreement of two SciPy references, which use nothing of this package's solvers; an error "
        "below it is not resolved, and drawn faded.",
        "`event_driven` solves the set-valued law, against references solved from event to event; everything else "
        "solves the smoothed law.",
        f"Other programs: {peers}. CVODE is that of SUNDIALS in a C program, which calls no Python and times itself. "
        "XPPAUT's CVODE interprets the equations in C. XPPAUT's results are in single precision, so its errors below "
        f"about 1.2e-7 are not resolved; its time is that of {TIMED} cycles minus that of one, scaled to the horizon, "
        "so start-up is excluded. `solve_ivp LSODA` is SciPy's function with a compiled right-hand side and Jacobian "
        "that stores the section only. numbalsoda is LSODA in C++ with compiled equations, without SciPy's loop."]
    if report.python_loop:
        out.append(f"A step of `dop853` takes {_digits(1e6 * report.python_loop['step'], 3)} us, of which the twelve "
                   f"evaluations of the compiled equations take {_digits(1e6 * report.python_loop['rates'], 2)} us; "
                   "the rest is SciPy's loop in Python, which a compiled DOP853 would not have.")
    if not report.complete:
        out.append("**Interrupted: this report is not complete.**")
    return [line for text in out for line in (text, "")][:-1]


def _summary(record: StudiedScene, scenes: Sequence[StudiedScene]) -> list[str]:
    """Return the steady state of a scene, and the fastest setting of each solver for some errors."""
    best = [fastest_results(record, target) for target in TARGETS]
    reference = record.reference
    lines = [f"## {record.scene}", "",
             f"{record.description}. References: {' and '.join(reference.solvers)}; floor "
             f"{reference.floor:.1e}.", "", comparison(record, scenes), ""]
    names = [n for n in dict.fromkeys(r.solver for r in record.results) if any(n in b for b in best)]
    lines += _table(["time of a cycle (us) for all three errors at most", *map(_power, TARGETS)],
                    [[code_name(n), *(_cost(b[n], record.cycles) if n in b else "-" for b in best)] for n in names])
    if record.long_run:
        lines += ["", *_table(("long run, at the setting for 1e-6", "cycles", "us a cycle"),
                              [(f"{code_name(r.solver)} at {_power(r.setting)}", str(r.cycles),
                                _digits(1e4 * r.seconds_per_100_cycles, 4)) for r in record.long_run])]
    return [*lines, ""]


def _cost(row: PrecisionResult, cycles: int) -> str:
    """Return the time of a cycle, us, and how much longer the slowest run took."""
    more = f" (+{100.0 * (row.slowest / row.seconds - 1.0):.0f} %)" if row.slowest > row.seconds else ""
    return _digits(1e6 * row.seconds / cycles, 3) + more


def _digits(value: float, count: int) -> str:
    """Return a number with some digits and without an exponent."""
    return f"{float(f'{value:.{count}g}'):.12g}"


def _power(value: float) -> str:
    """Return a power of ten, such as 1e-6."""
    return f"{value:g}".replace("e-0", "e-")


def comparison(record: StudiedScene, others: Sequence[StudiedScene]) -> str:
    """Return a sentence on the steady state of a scene, and on the same scene with the other friction law."""
    ours = record.steady
    if ours.max_slip_speed is None:
        return f"From the initial state the motion has no period up to 16 after {ours.cycles} cycles."
    said = (f"From the initial state it settles in period {ours.period} with {ours.max_slip_speed:.5g} rad/s "
            f"({ours.cycles} cycles; SciPy closes it to {ours.closure:.1e}).")
    base = record.scene.removesuffix(", set-valued")
    for other in others:
        steady = other.steady
        if other is record or other.scene.removesuffix(", set-valued") != base or steady.max_slip_speed is None:
            continue
        apart = abs(steady.max_slip_speed / ours.max_slip_speed
                    - 1.0) > APART or steady.period != ours.period
        law = "(6)" if record.law == "smoothed" else "(7)"
        said += f" With law {law} it is period {steady.period} with {steady.max_slip_speed:.5g} rad/s"
        said += ": the smoothing decides which motion is reached." if apart else "."
    return said


def scene_lines(record: StudiedScene) -> list[str]:
    """Return the fastest settings of a scene as lines for a terminal."""
    best = fastest_results(record, TARGET)
    times = [f"{name} {1e3 * row.seconds:.3g} ms" for name,
             row in sorted(best.items(), key=lambda x: x[1].seconds)]
    head = (f"{record.scene}: floor {record.reference.floor:.1e}; "
            f"{record.cycles} cycles with errors up to {TARGET:g}: ")
    return [head + (", ".join(times) or "none"), *(
        f"    {row.solver} at {row.setting:g}: {1e3 * row.seconds_per_100_cycles:.4g} ms per 100 cycles"
        for row in record.long_run)]


def _omitted(record: StudiedScene) -> list[str]:
    """Return the omitted settings with their reasons."""
    return [*(f"- {code_name(row.solver)} at {row.setting:.3g}: {row.why}" for row in record.omitted), ""]
