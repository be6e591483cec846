"""Other programs on the same problem, all optional: XPPAUT, CVODE of SUNDIALS in C, LSODA in C++ by numbalsoda, and
direct calls of SciPy's LSODA. A program that gives no result raises NumericalFailure, a missing one MissingPackage.
"""

from __future__ import annotations

import atexit
import importlib.util
import math
import resource
import runpy
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from scipy.integrate import solve_ivp

from tcc_sim.errors import MissingPackage, NumericalFailure, one_line
from tcc_sim.fmi.export import compiler
from tcc_sim.model.equations import check_supported
from tcc_sim.model.parameters import System
from tcc_sim.solvers.comparison import jacobian_of, rates_of
from tcc_sim.solvers.per_cycle import cycles_from_samples, starts_of
from tcc_sim.solvers.terms import rates_along, terms_of
from tcc_sim.study.benchmarks.references import error_scales
from tcc_sim.trajectory import Floats, State

TIMEOUT = 60.0
"""Time limit of one run, s."""
FINE = 256
"""Samples per engine cycle for the largest slip speeds of another program."""
TIMED = 100
"""Least number of engine cycles in a timed run of XPPAUT, whose start takes as long as about ten cycles."""
RESOLVED = 1.0
"""CPU time of runs of XPPAUT, s, after which they are neither longer nor repeated, since the clock resolves them."""
SINGLE = 2.0**-23
"""Resolution of single precision, the format of XPPAUT's output."""
LIBRARIES = ("sundials_cvode", "sundials_nvecserial", "sundials_sunmatrixdense", "sundials_sunlinsoldense", "m")
"""Libraries of `cvode.c`, with the names of Debian's libsundials-dev."""
STICK = 1e-12
Timed = TypeVar("Timed")


@dataclass(frozen=True)
class PeerRun:
    """States at the cycle ends, largest |slip speed| per cycle, fastest and slowest run time (s), number of steps."""

    section: Floats
    largest: Floats
    seconds: float
    slowest: float
    steps: int | None = None


def repeated(run: Callable[[], Timed], repeats: int, patience: float = math.inf,
             clock: Callable[[], float] = time.process_time) -> tuple[list[float], Timed]:
    """Return the CPU time of each of at most `repeats` calls, s, and the last result; none begins after `patience`, s.

    clock : function of the CPU seconds so far, of this process or with `of_children` of other programs
    """
    used = list[float]()
    while not used or (len(used) < repeats and sum(used) < patience):
        began = clock()
        result = run()
        used.append(clock() - began)
    return used, result


def of_children() -> float:
    """Return the CPU time of ended child processes, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def bare_lsoda(system: System, cycles: int, rtol: float, repeats: int) -> PeerRun:
    """Call `scipy.integrate.solve_ivp` with LSODA and compiled right-hand side and Jacobian; store cycle ends only."""
    terms, y, ends = terms_of(system), np.array(State.at_start(system).numbers), _times(system, cycles, 1)
    rates, jacobian = rates_of(terms, len(y)), jacobian_of(terms, len(y))

    def solve(dense: bool) -> Any:
        return solve_ivp(rates, (0.0, float(ends[-1])), y, method="LSODA", t_eval=ends, rtol=rtol, jac=jacobian,
                         atol=rtol * error_scales(system), dense_output=dense)

    used, _ = repeated(lambda: solve(False), repeats)
    run = solve(True)
    if run.status < 0:
        raise NumericalFailure(str(run.message))
    return run_of(system, run.y.T, run.sol(_times(system, cycles, FINE)).T, min(used), max(used), len(run.sol.ts) - 1)


def numbalsoda(system: System, cycles: int, rtol: float, repeats: int) -> PeerRun:
    """Call LSODA in C++ (liblsoda) by numbalsoda, with compiled equations and no Python between the cycle ends; its one
    absolute tolerance is that of the smallest signal.
    """
    try:
        package = Path(str(importlib.util.find_spec("numbalsoda").origin))  # type: ignore[union-attr]
        part = runpy.run_path(str(package.with_name("driver.py")))  # The package compiles its other solvers at import.
    except (AttributeError, OSError) as error:
        raise MissingPackage(f"numbalsoda is not installed ({one_line(str(error))})") from None
    from tcc_sim.compiling.linked import address_for_c

    (address, kept), lsoda = address_for_c(rates_for_c(system), part["lsoda_sig"]), part["lsoda"]
    y = np.array(State.at_start(system).numbers)
    atol, nothing = rtol * float(np.min(error_scales(system))), np.zeros(1)

    def solve(per_cycle: int) -> Floats:
        states, good = lsoda(address, y, _times(system, cycles, per_cycle), nothing, rtol, atol, 1_000_000)
        if not (good and np.isfinite(states).all()):
            raise NumericalFailure("stopped early")
        return np.asarray(states)

    solve(1)  # It compiles its own part.
    used, section = repeated(lambda: solve(1), repeats)
    run = run_of(system, section, solve(FINE), min(used), max(used))
    del kept
    return run


def rates_for_c(system: System) -> Callable[..., None]:
    """Return (1), (2) with the smoothed law as a function (t, state, rates, unused) with a scene's numbers in it."""
    d, f, e, p = system.driveline, system.friction, system.engine, system.pressure
    i1, i2, damping, stiffness = d.flywheel_inertia, d.plate_inertia, d.damping, d.stiffness
    excess, decay, sigma = system.friction_ratio - 1.0, f.decay, f.smoothing
    mean, amplitude, omega = e.mean_torque, e.torque_amplitude, e.frequency
    level, swing, rate, phase = system.saturation_mean, system.saturation_amplitude, p.frequency_ratio * omega, p.phase

    def rates(t: float, state: Any, out: Any, _: Any) -> None:
        v, angle, speed = state[0], state[1], state[2]
        load = level + swing * math.sin(rate * t + phase)
        friction = load * math.tanh(sigma * v) * (1.0 + excess * math.exp(-decay * abs(v)))
        shaft = damping * speed + stiffness * angle
        out[0] = (mean + amplitude * math.sin(omega * t) - friction) / i1 - (friction - shaft) / i2
        out[1] = speed
        out[2] = (friction - shaft) / i2

    return rates


def cvode(system: System, cycles: int, rtol: float, repeats: int) -> PeerRun:
    """Run CVODE's BDF of SUNDIALS in double precision with `cvode.c`, a program without Python that times itself."""
    check_supported("peer", system, "CVODE in C")
    d, f, c, e, p = system.driveline, system.friction, system.clutch, system.engine, system.pressure
    numbers = [d.flywheel_inertia, d.plate_inertia, d.damping, d.stiffness, c.area, c.radius, f.static_coefficient,
               f.kinetic_coefficient, f.decay, f.smoothing, e.mean_torque, e.torque_amplitude, e.frequency, p.mean,
               p.amplitude, p.frequency_ratio, p.phase, *State.at_start(system).numbers, rtol,
               *(rtol * error_scales(system))]
    words = " ".join([*(f"{float(x):.17g}" for x in numbers), f"{cycles} {FINE} {repeats}"])
    ended = _ended([cvode_program()], input=words, text=True)
    if ended.returncode:
        raise NumericalFailure(ended.stderr.strip() or f"ended with status {ended.returncode}")
    head, *lines = ended.stdout.splitlines()
    seconds, slowest, steps = head.split()
    rows = np.array([line.split() for line in lines], dtype=np.float64)
    return run_of(system, rows[:cycles + 1], rows[cycles + 1:], float(seconds), float(slowest), int(steps))


@cache
def cvode_program() -> str:
    """Compile `cvode.c`, once per process; the binary is deleted at the end of the process."""
    command = compiler()
    if command is None:
        raise MissingPackage("not compiled: there is no C compiler")
    folder = tempfile.mkdtemp(prefix="tcc_sim_")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    program, source = f"{folder}/cvode", str(Path(__file__).with_name("cvode.c"))
    ended = _ended([command, "-O3", source, "-o", program, *(f"-l{name}" for name in LIBRARIES)], text=True)
    if ended.returncode:
        why = next((line for line in ended.stderr.splitlines() if "error" in line or "cannot find" in line), "")
        raise MissingPackage(
            f"not compiled: SUNDIALS is not installed (Debian: libsundials-dev); {command} says: {why}")
    return program


def _times(system: System, cycles: int, per_cycle: int) -> Floats:
    """Return equidistant times that include the cycle ends, s."""
    return np.linspace(0.0, cycles * system.cycle, cycles * per_cycle + 1)


def _ended(command: list[str], **how: Any) -> Any:
    """Run a program to its end, at most for TIMEOUT."""
    try:
        return subprocess.run(command, capture_output=True, timeout=TIMEOUT, check=False, **how)
    except subprocess.TimeoutExpired:
        raise NumericalFailure(f"took more than {TIMEOUT:g} s") from None


def run_of(system: System, section: Floats, fine: Floats, seconds: float, slowest: float,
           steps: int | None = None) -> PeerRun:
    """Return a run from the states at the cycle ends and at FINE samples a cycle; cubics through samples of v and v'
    give the largest slip speeds.
    """
    t = _times(system, len(section) - 1, FINE)
    rates = rates_along(t, np.ascontiguousarray(fine), terms_of(system))
    cycles = cycles_from_samples(t, fine[:, 0], rates[:, 0], fine[:, 1], fine[:, 2], rates[:, 2],
                                 starts=starts_of(system, 0, float(t[-1])), stick_speed=STICK)
    return PeerRun(section, cycles.largest, seconds, slowest, steps)


def xppaut_file(system: System, method: str, tolerance: float, cycles: int, per_cycle: int) -> str:
    """Return the model as an XPPAUT file, with all digits of every number."""
    check_supported("peer", system, "XPPAUT")
    d, f, e, p, start = system.driveline, system.friction, system.engine, system.pressure, system.initial
    swing, excess, step = system.saturation_amplitude, system.friction_ratio - 1.0, system.cycle / per_cycle
    load = f"{system.saturation_mean:.17g}"
    if p.amplitude > 0.0:
        load += f"+{swing:.17g}*sin({p.frequency_ratio * e.frequency:.17g}*t{p.phase:+.17g})"
    falling = f"*(1{excess:+.17g}*exp(-{f.decay:.17g}*abs(v)))" if excess else ""
    return f"""\
ts={load}
tf=ts*tanh({f.smoothing:.17g}*v){falling}
s={d.damping:.17g}*w+{d.stiffness:.17g}*q
v'=({e.mean_torque:.17g}+{e.torque_amplitude:.17g}*sin({e.frequency:.17g}*t)-tf)/{d.flywheel_inertia:.17g}-(tf-s)/\
{d.plate_inertia:.17g}
q'=w
w'=(tf-s)/{d.plate_inertia:.17g}
init v={start.slip_speed:.17g},q={start.plate_angle:.17g},w={start.plate_speed:.17g}
@ total={step * (cycles * per_cycle):.17g},dt={step:.17g},meth={method},toler={tolerance:g},atoler={tolerance:g}
@ maxstor=1000000,bounds=1e9,output=out.dat
done
"""


def xppaut(system: System, method: str, tolerance: float, cycles: int, repeats: int) -> PeerRun:
    """Run one of XPPAUT's methods; `seconds` is the CPU time of some cycles minus that of one, scaled.

    A fast method solves TIMED cycles for it, a slow one `cycles`. The difference excludes start-up and reading the
    file. Time and states come from runs with outputs at the cycle ends only.
    """
    if shutil.which("xppaut") is None:
        raise MissingPackage("not installed")
    with tempfile.TemporaryDirectory() as folder:
        def run(count: int, per_cycle: int) -> Floats:
            place = Path(folder)
            (place / "model.ode").write_text(xppaut_file(system, method, tolerance, count, per_cycle))
            (place / "out.dat").unlink(missing_ok=True)
            _ended(["xppaut", "model.ode", "-silent"], cwd=folder, stdin=subprocess.DEVNULL)
            try:
                rows = np.loadtxt(place / "out.dat", ndmin=2)
            except (OSError, ValueError):
                raise NumericalFailure("wrote no results") from None
            if len(rows) < count * per_cycle + 1 or not np.all(np.isfinite(rows)):
                raise NumericalFailure(f"stopped after {len(rows) - 1} of {count * per_cycle} outputs")
            return rows[:count * per_cycle + 1, 1:4]

        took, fine = repeated(lambda: run(cycles, FINE), 1, clock=of_children)
        section, many = run(cycles, 1), max(cycles, TIMED) if took[0] < RESOLVED else cycles
        long, _ = repeated(lambda: run(many, 1), repeats, RESOLVED, of_children)
        short, _ = repeated(lambda: run(1, 1), repeats, RESOLVED, of_children)
        seconds, slowest = ((of(long) - min(short)) * cycles / (many - 1) for of in (min, max))
        if seconds <= 0.0:
            raise NumericalFailure(f"{many} cycles take no longer than one, by the clock")
    return run_of(system, section, fine, seconds, slowest)
