"""Other programs on the same problem: XPPAUT, Siconos, and SciPy's LSODA called bare. None of them is needed to be
there.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from tcc_sim.benchmarks.references import Floats
from tcc_sim.model.parameters import System
from tcc_sim.solvers.comparison.scipy_methods import jacobian, rates_along, rates_of
from tcc_sim.solvers.per_cycle import cycle_starts, cycles_from_samples
from tcc_sim.solvers.terms import terms_of

TIMEOUT = 60.0
"""Seconds that a peer may take for one run."""
FINE = 256
"""Samples per engine cycle from which a peer's largest slip speeds are taken."""
STICK = 1e-12


class Failed(Exception):
    """A peer did not deliver; the message says why."""


@dataclass(frozen=True)
class PeerRun:
    """What one run gave: states at the cycle ends, largest |slip speed| per cycle, s, and steps where they are known.
    """

    section: Floats
    largest: Floats
    seconds: float
    steps: int | None = None


def bare_lsoda(system: System, cycles: int, rtol: float, repeats: int) -> PeerRun:
    """`scipy.integrate.solve_ivp` with LSODA, compiled right-hand side and Jacobian, and nothing kept but the cycle
    ends.
    """
    terms, start = terms_of(system), system.initial
    twist = max(abs(system.engine.mean_torque) + system.engine.torque_amplitude, 1.0) / system.driveline.stiffness
    y = np.array([start.slip_speed, start.plate_angle, start.plate_speed])
    atol = rtol * np.array([1.0 / system.friction.smoothing, twist, twist * system.natural_frequency])
    ends = np.arange(cycles + 1) * system.cycle

    def solve(dense: bool) -> Any:
        return solve_ivp(lambda t, y: rates_of(t, y, terms), (0.0, float(ends[-1])), y, method="LSODA", t_eval=ends,
                         rtol=rtol,
                         atol=atol, jac=lambda t, y: jacobian(t, y, terms), dense_output=dense)

    best = np.inf
    for _ in range(repeats):
        began = time.process_time()
        solve(False)
        best = min(best, time.process_time() - began)
    run = solve(True)
    found = run.y.T
    if len(found) != cycles + 1:
        raise Failed(str(run.message))
    times = np.linspace(0.0, float(ends[-1]), cycles * FINE + 1)
    states = run.sol(times).T
    return PeerRun(found, _largest(system, times, states), best, len(run.sol.ts) - 1)


def _largest(system: System, t: Floats, states: Floats) -> Floats:
    """Largest |slip speed| per cycle of samples, through the cubics of v and v'."""
    rates = rates_along(t, np.ascontiguousarray(states), terms_of(system))
    found = cycles_from_samples(t, states[:, 0], rates[:, 0], states[:, 1], states[:, 2], rates[:, 2],
                                starts=cycle_starts(0, float(t[-1]), system.cycle), stick_speed=STICK)
    largest: Floats = np.maximum(np.abs(found.highest), np.abs(found.lowest))
    return largest


def xppaut_file(system: System, method: str, tolerance: float, cycles: int, per_cycle: int) -> str:
    """The model as an XPPAUT file; every number stands in it with all its digits."""
    d, f, e, p, start = system.driveline, system.friction, system.engine, system.pressure, system.initial
    number = "{:.17g}".format
    load = number(system.saturation_mean)
    if p.amplitude > 0.0:
        rate = p.frequency_ratio * e.frequency
        load += f"+{number(system.saturation_amplitude)}*sin({number(rate)}*t+{number(p.phase)})"
    excess = system.friction_ratio - 1.0
    falling = f"*(1+{number(excess)}*exp(-{number(f.decay)}*abs(v)))" if excess > 0.0 else ""
    step = system.cycle / per_cycle
    return "\n".join([
        f"ts={load}",
        f"tf=ts*tanh({number(f.smoothing)}*v){falling}",
        f"s={number(d.damping)}*w+{number(d.stiffness)}*q",
        f"v'=({number(e.mean_torque)}+{number(e.torque_amplitude)}*sin({number(e.frequency)}*t)-tf)"
        f"/{number(d.flywheel_inertia)}-(tf-s)/{number(d.plate_inertia)}",
        "q'=w",
        f"w'=(tf-s)/{number(d.plate_inertia)}",
        f"init v={number(start.slip_speed)},q={number(start.plate_angle)},w={number(start.plate_speed)}",
        f"@ total={number(step * (cycles * per_cycle))},dt={number(step)},meth={method},toler={tolerance:g},"
        f"atoler={tolerance:g}",
        "@ maxstor=1000000,bounds=1e9,output=out.dat",
        "done", ""])


def xppaut(system: System, method: str, tolerance: float, cycles: int, repeats: int) -> PeerRun:
    """One of XPPAUT's methods; `seconds` is its CPU time for these cycles less that for one, times cycles/(cycles - 1).

    The difference leaves out start-up and the reading of the file. Time and states come with outputs at the cycle ends
    only.

    Raises
    ------
    Failed
        XPPAUT is not installed, stopped early or took too long.
    """
    if shutil.which("xppaut") is None:
        raise Failed("not installed")
    with tempfile.TemporaryDirectory() as folder:
        def run(count: int, per_cycle: int) -> tuple[Floats, float]:
            place = Path(folder)
            (place / "model.ode").write_text(xppaut_file(system, method, tolerance, count, per_cycle))
            (place / "out.dat").unlink(missing_ok=True)
            before = _children()
            try:
                subprocess.run(["xppaut", "model.ode", "-silent"], cwd=folder, stdin=subprocess.DEVNULL,
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=TIMEOUT, check=False)
            except subprocess.TimeoutExpired:
                raise Failed(f"took more than {TIMEOUT:g} s") from None
            used = _children() - before
            try:
                rows = np.loadtxt(place / "out.dat", ndmin=2)
            except (OSError, ValueError):
                raise Failed("wrote no results") from None
            if len(rows) < count * per_cycle + 1 or not np.all(np.isfinite(rows)):
                raise Failed(f"stopped after {len(rows) - 1} of {count * per_cycle} outputs")
            return rows[:count * per_cycle + 1, 1:4], used

        long = [run(cycles, 1) for _ in range(repeats)]
        short = [run(1, 1)[1] for _ in range(repeats)]
        seconds = max(min(used for _, used in long) - min(short), 0.0) * cycles / (cycles - 1)
        fine, _ = run(cycles, FINE)
    times = np.linspace(0.0, cycles * system.cycle, cycles * FINE + 1)
    return PeerRun(long[0][0], _largest(system, times, fine), seconds)


def siconos(system: System, steps_per_cycle: int, theta: float, cycles: int) -> PeerRun:
    """Siconos's Moreau-Jean time stepping of the relay, timed inside its own process.

    Raises
    ------
    Failed
        Siconos is not installed, or it cannot do this system.
    """
    interpreter = siconos_interpreter()
    if interpreter is None:
        raise Failed("not installed")
    d, e = system.driveline, system.engine
    job = {"linear": [d.flywheel_inertia, d.plate_inertia, d.damping, d.stiffness], "limit": system.saturation_mean,
           "mean": e.mean_torque, "amplitude": e.torque_amplitude, "frequency": e.frequency, "cycles": cycles,
           "steps_per_cycle": steps_per_cycle, "theta": theta,
           "initial": [system.initial.slip_speed, system.initial.plate_angle, system.initial.plate_speed]}
    try:
        ended = subprocess.run([interpreter, str(Path(__file__).with_name("siconos_relay.py"))], input=json.dumps(job),
                               capture_output=True, text=True, timeout=TIMEOUT, check=False, env=_plain_environment())
    except subprocess.TimeoutExpired:
        raise Failed(f"took more than {TIMEOUT:g} s") from None
    _, found, text = ended.stdout.rpartition("RESULT ")
    if ended.returncode or not found:
        raise Failed((ended.stderr.strip().splitlines() or ["no result"])[-1])
    values = json.loads(text)
    return PeerRun(np.array(values["section"]), np.array(values["largest"]), values["seconds"],
                   cycles * steps_per_cycle)


@cache
def siconos_interpreter() -> str | None:
    """A Python that can import Siconos: this one or the system's; None where neither can."""
    for interpreter in (sys.executable, "/usr/bin/python3"):
        if Path(interpreter).exists() and subprocess.run([interpreter, "-c", "import siconos.kernel"],
                                                         capture_output=True,
                                                         check=False, env=_plain_environment()).returncode == 0:
            return interpreter
    return None


def _plain_environment() -> dict[str, str]:
    """The environment without this interpreter's module path."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


def _children() -> float:
    """CPU seconds of the processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
