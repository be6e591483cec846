"""Branches of periodic motions beside AUTO-07p in one run: CPU time a point, and the values of the bifurcations.

`python .ci/instruments/branch_speed.py` follows the motions of period one and two of the scene in which they
coexist (omega/omega_n = 0.36, constant load, 225 kPa) with mu_k, by this package and by AUTO-07p (Debian packages
`auto-07p` and `gfortran`). The mesh of AUTO is refined until it crosses the range. The forcing is an added oscillator,
as in AUTO's demo `frc`. The time of AUTO is that of its compiled program, without compilation.
"""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tcc_sim.model.parameters import System, replace
from tcc_sim.output.terminal import say
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.study.benchmarks.peers import repeated
from tcc_sim.study.continuation.branch import branch_through
from tcc_sim.study.continuation.motions import ContinuationPlan, check, start_orbit
from tcc_sim.study.continuation.orbits import ParameterRange, Settings
from tcc_sim.trajectory import State

AUTO = Path(os.environ.get("AUTO_DIR", "/usr/lib/auto-07p"))
KEY = "friction.kinetic_coefficient"
MESHES = (200, 400, 800)
"""Mesh intervals of AUTO, tried in order until it crosses the range."""
TUNED = {1: (4, 0.02), 2: (5, 0.01)}
"""Collocation points per interval (NCOL) and longest step (DSMAX) by period. With those of period one AUTO finds the
upper fold of period two on no mesh; with the others it does on 400 intervals."""
MOST = 45
"""Points followed to either side from the middle of the branch of period two, enough to pass both folds."""
REPEATS = 5
"""Number of runs of this package per branch, a second or less each; the fastest counts."""
SAMPLES = 4000
TIMEOUT = 300.0
"""Time limit of AUTO per branch, s; meshes beyond it are left out, and a sentence says so."""
NAMES = {"fold": "LP", "period_doubling": "PD", "neimark_sacker": "TR"}
"""Kinds of bifurcations as AUTO names them."""

SCRIPT = """
import json, resource
import auto

def used():
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime

auto.run(e="model", c="model", NMX=1)
for mesh in {meshes}:
    before, points, found, complete = used(), 0, [], True
    for step in (1.0, -1.0):
        run = auto.run(e="model", c="model", NTST=mesh, DS=0.001 * step)
        points += len(run[0])
        kinds = [(s["TY name"], s["PAR(1)"]) for s in run()]
        found += [k for k in kinds if k[0] in ("LP", "PD", "TR")]
        complete = complete and not any(k[0] == "MX" for k in kinds)
    print("RESULT", json.dumps([mesh, points, used() - before, found, complete]), flush=True)
    if complete:
        break
"""


class Followed(NamedTuple):
    """A branch: points, CPU seconds, bifurcations as (AUTO's name, mu_k/mu_s), and the method."""

    points: int
    seconds: float
    bifurcations: tuple[tuple[str, float], ...]
    options: str
    complete: bool = True


def coexistence() -> System:
    """The scene: fig02 at omega/omega_n = 0.36 with a constant load of 225 kPa and mu_k/mu_s = 0.85."""
    system = load_scene("fig02").system
    static = system.friction.static_coefficient
    return replace(system, {"pressure.amplitude": 0.0, "pressure.mean": 225e3, "friction.law": "smoothed",
                            "engine.frequency": 0.36 * system.natural_frequency, KEY: 0.85 * static})


def follow(system: System, period: int, low: float, high: float) -> tuple[Followed, System]:
    """This package's branch, and the system that starts on its first motion."""
    static = system.friction.static_coefficient
    map_ = check(system, ContinuationPlan(KEY, low, high, period=period))
    span = ParameterRange(low, high, name=KEY)
    first = start_orbit(map_, span, system.friction.kinetic_coefficient, period)
    first = dataclasses.replace(first, equations=dataclasses.replace(first.equations,
                                                                     settings=Settings(max_points=MOST)))
    used, branch = repeated(lambda: branch_through(first), REPEATS)
    seconds = min(used)
    result = tuple((NAMES.get(f.kind, f.kind), f.value / static) for f in branch.bifurcations)
    started = State.of(first.section).starting(system)
    return Followed(len(branch.points), seconds, result, "default settings"), started


def model(system: System) -> str:
    """The equations with their Jacobian in Fortran; PAR(1) is mu_k, u(4) and u(5) are sine and cosine of the
    forcing.
    """
    d, e, f, c = system.driveline, system.engine, system.friction, system.clutch
    numbers = {"i1": d.flywheel_inertia, "i2": d.plate_inertia, "damping": d.damping, "stiffness": d.stiffness,
               "mean": e.mean_torque, "swing": e.torque_amplitude, "omega": e.frequency, "static": f.static_coefficient,
               "alpha": f.decay, "sigma": f.smoothing, "press": c.area * c.radius * system.pressure.mean}
    constants = "\n".join(f"  double precision, parameter :: {name} = {value:.17e}".replace("e+", "d+").replace("e-",
                                                                                                                "d-")
                          for name, value in numbers.items())
    return FORTRAN.replace("CONSTANTS", constants)


FORTRAN = """subroutine func(ndim, u, icp, par, ijac, f, dfdu, dfdp)
  implicit none
  integer, intent(in) :: ndim, icp(*), ijac
  double precision, intent(in) :: u(ndim), par(*)
  double precision, intent(out) :: f(ndim)
  double precision, intent(inout) :: dfdu(ndim, ndim), dfdp(ndim, *)
  double precision :: fall, excess, step, tf, slope, by, pull, square
CONSTANTS
  fall = exp(-alpha*abs(u(1)))
  excess = (static/par(1) - 1d0)*fall
  step = tanh(sigma*u(1))
  tf = par(1)*press*(1d0 + excess)*step
  pull = (tf - damping*u(3) - stiffness*u(2))/i2
  square = u(4)*u(4) + u(5)*u(5)
  f(1) = (mean + swing*u(4) - tf)/i1 - pull
  f(2) = u(3)
  f(3) = pull
  f(4) = u(4) + omega*u(5) - u(4)*square
  f(5) = -omega*u(4) + u(5) - u(5)*square
  if (ijac == 0) return
  slope = par(1)*press*(sigma*(1d0 + excess)*(1d0 - step*step) - alpha*sign(1d0, u(1))*excess*step)
  by = press*(1d0 - fall)*step
  dfdu = 0d0
  dfdu(3, 1) = slope/i2
  dfdu(3, 2) = -stiffness/i2
  dfdu(3, 3) = -damping/i2
  dfdu(1, :) = -dfdu(3, :)
  dfdu(1, 1) = dfdu(1, 1) - slope/i1
  dfdu(1, 4) = swing/i1
  dfdu(2, 3) = 1d0
  dfdu(4, 4) = 1d0 - square - 2d0*u(4)*u(4)
  dfdu(4, 5) = omega - 2d0*u(4)*u(5)
  dfdu(5, 4) = -omega - 2d0*u(4)*u(5)
  dfdu(5, 5) = 1d0 - square - 2d0*u(5)*u(5)
  if (ijac == 1) return
  dfdp(:, 1) = 0d0
  dfdp(1, 1) = -by/i1 - by/i2
  dfdp(3, 1) = by/i2
end subroutine
subroutine stpnt(ndim, u, par, t)
  integer, intent(in) :: ndim
  double precision, intent(inout) :: u(ndim), par(*)
  double precision, intent(in) :: t
end subroutine
""" + "".join(f"subroutine {name}\nend subroutine\n" for name in ("bcnd", "icnd", "fopt", "pvls"))


def constants(system: System, period: int, low: float, high: float) -> str:
    """AUTO's file of constants."""
    points, longest = TUNED[period]
    return "\n".join([
        "dat='model.dat'", f"PAR={{1: {system.friction.kinetic_coefficient!r}, 11: {period * system.cycle!r}}}",
        f"NDIM=5, IPS=2, IRS=0, ILP=1, ICP=[1, 11], NCOL={points}, IAD=3, ISP=2, ISW=1, IPLT=0, NBC=0, NINT=0",
        "NMX=600, NPR=0, MXBF=0, IID=2, ITMX=9, ITNW=10, NWTN=10, JAC=1", "EPSL=1e-8, EPSU=1e-8, EPSS=1e-8",
        f"DS=0.001, DSMIN=1e-5, DSMAX={longest!r}, IADS=1", f"THL={{11: 0.0}}, UZSTOP={{1: [{low!r}, {high!r}]}}", ""])


def auto_installed() -> bool:
    """Return whether AUTO and its compiler are installed."""
    return (AUTO / "python").is_dir() and shutil.which("gfortran") is not None


def auto(system: System, period: int, low: float, high: float, limit: float = TIMEOUT) -> tuple[list[Followed], str]:
    """AUTO's branch from the same motion, one entry per mesh, and a sentence if `limit` seconds were too short."""
    if not auto_installed():
        return [], f"period {period}  AUTO-07p is not installed: apt install auto-07p gfortran"
    run = solve(system, cycles=period, rtol=1e-11, samples_per_cycle=SAMPLES).raise_for_status()
    phase = system.engine.frequency * run.t
    rows = np.column_stack([run.t, run.slip_speed, run.plate_angle, run.plate_speed, np.sin(phase), np.cos(phase)])
    # One thread: AUTO's others wait by counting, which is CPU time too.
    environment = {**os.environ, "AUTO_DIR": str(AUTO), "OMP_NUM_THREADS": "1",
                   "PATH": os.environ.get("PATH", "") + os.pathsep + str(AUTO / "cmds"),
                   "PYTHONPATH": os.pathsep.join([str(AUTO / "python"), str(AUTO / "python" / "auto")])}
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        np.savetxt(place / "model.dat", rows, fmt="%.16g")
        (place / "model.f90").write_text(model(system))
        (place / "c.model").write_text(constants(system, period, low, high))
        (place / "run.py").write_text(SCRIPT.format(meshes=MESHES))
        # Its own session, as AUTO's program outlives the script that has started it.
        process = subprocess.Popen(["/usr/bin/python3", "run.py"], cwd=folder, env=environment, text=True,
                                   stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True)
        try:
            output, sentence = process.communicate(timeout=limit)[0], ""
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            output = process.communicate()[0]
            sentence = f"period {period}  AUTO-07p was stopped after {limit:.0f} s; finer meshes are left out"
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    return runs_of(output, system.friction.static_coefficient), sentence


def runs_of(text: str, static: float) -> list[Followed]:
    """Results printed by AUTO's script, one per finished mesh."""
    out = []
    for line in text.splitlines():
        if line.startswith("RESULT "):
            mesh, points, seconds, result, complete = json.loads(line[7:])
            out.append(Followed(points, seconds, tuple((kind, value / static) for kind, value in result),
                                f"NTST {mesh}", complete))
    return out


@dataclass(frozen=True)
class Compared:
    """A branch of one period by both programs, and a sentence if AUTO is not installed or did not finish."""

    period: int
    mine: Followed
    others: list[Followed]
    sentence: str = ""


def compared() -> Iterator[Compared]:
    """The branches of period one and two, each followed by both programs."""
    system, low, high = coexistence(), 0.6, 1.0
    static = system.friction.static_coefficient
    for period, (start, stop) in {1: (low, high), 2: (0.6679, 0.925)}.items():
        follow(system, period, 0.84 * static, 0.86 * static)  # Compiling is not following.
        mine, started = follow(system, period, start * static, stop * static)
        others, sentence = auto(started, period, start * static, stop * static)
        yield Compared(period, mine, others, sentence)


def page_lines(rows: Iterable[Compared]) -> list[str]:
    """A section of Markdown with the table of both programs."""
    lines = ["## Beside AUTO-07p", "",
             "The branches through the motions of period one and two at omega/omega\\_n = 0.36, followed with "
             "mu\\_k in one run",
             "of both programs on one core (`python .ci/instruments/branch_speed.py`): CPU time a point, with "
             "multipliers and",
             "bifurcations. LP: fold, PD: period doubling, as values of mu\\_k/mu\\_s; the mesh of AUTO is refined "
             "until it gets through.", "",
             "| period | program | points | ms a point | bifurcations | largest difference |",
             "| ---: | --- | ---: | ---: | --- | ---: |"]
    sentences = []
    for row in rows:
        for name, run in [("tcc-sim", row.mine), *(("AUTO-07p", other) for other in row.others)]:
            result = ", ".join(f"{kind} {value:.9f}" for kind, value in run.bifurcations) or "none"
            away = [min((abs(value - mine) for other, mine in row.mine.bifurcations if other == kind), default=np.inf)
                    for kind, value in run.bifurcations]
            most = f"{max(away):.1e}" if away and run is not row.mine else ""
            lines.append(f"| {row.period} | {name}, {run.options}{'' if run.complete else ', did not get through'} | "
                         f"{run.points} | {1e3 * run.seconds / max(run.points, 1):.2f} | {result} | {most} |")
        sentences += ["", row.sentence + "."] if row.sentence else []
    return lines + sentences


def main() -> int:
    """Follow both branches with both programs and print the table."""
    say("\n".join(page_lines(compared())))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
