"""Solvers by name. Every solver turns a Problem into a Trajectory; its module is imported on first use."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module

from tcc_sim.errors import InputError
from tcc_sim.model.equations import LAWS, SUPPORTED, unsupported
from tcc_sim.model.parameters import System
from tcc_sim.scene import Scene, system_of
from tcc_sim.solvers.terms import Problem
from tcc_sim.trajectory import State, Status, Trajectory


@dataclass(frozen=True)
class Entry:
    """A registered solver: its name, its module below this package, description and setting."""

    name: str

    module: str
    function: str
    description: str
    setting: str
    """'rtol' for adaptive solvers, 'step' for fixed-step ones."""
    default: float

    @cache  # noqa: B019 (the entries of SOLVERS live as long as the process)
    def load(self) -> Callable[[Problem], Trajectory]:
        """Import the solver's function."""
        solve: Callable[[Problem], Trajectory] = getattr(import_module(f"{__name__}.{self.module}"), self.function)
        return solve

    @property
    def laws(self) -> tuple[str, ...]:
        """Friction laws that it solves."""
        return tuple(law for law in LAWS if law in SUPPORTED[self.name])


COMPARISON = "comparison"
SHORTEST = 1e-8
"""Least duration, in engine cycles: a multiple of the engines' tolerance at the end of a cycle."""

SOLVERS: dict[str, Entry] = {row.name: row for row in (
    Entry("fixed_step", "fixed_step", "solve", "real-time solver: SDIRK3, implicit friction, fixed ticks", "step",
          1e-3),
    Entry("smoothed", "smoothed_engine", "solve", "adaptive: Taylor series in slip, implicit in the layer and in stick",
          "rtol", 1e-8),
    Entry("event_driven", "exact_engine", "solve", "exact: closed forms between located events", "rtol", 1e-10),
    Entry("rk45", COMPARISON, "rk45", "Dormand and Prince 5(4) in the steps of SciPy's RK45, compiled", "rtol", 1e-6),
    Entry("dop853", COMPARISON, "dop853", "SciPy, Dormand and Prince 8(5,3)", "rtol", 1e-6),
    Entry("radau", COMPARISON, "radau", "SciPy, Radau IIA of order 5", "rtol", 1e-6),
    Entry("bdf", COMPARISON, "bdf", "SciPy, backward differentiation (Gear's method)", "rtol", 1e-6),
    Entry("lsoda", COMPARISON, "lsoda", "SciPy, LSODA of ODEPACK", "rtol", 1e-6),
    Entry("rk4", COMPARISON, "rk4", "classical Runge-Kutta of order 4, fixed step", "step", 1e-6),
)}


def solve(scene: Scene | System | str, *, cycles: int | None = None, duration: float | None = None,
          samples_per_cycle: int = 0, solver: str = "auto", rtol: float | None = None, step: float | None = None,
          start_cycle: int = 0, state: State | None = None, flywheel_angle: bool = False,
          loads_from: int | None = None) -> Trajectory:
    """Solve a scene or a system over whole engine cycles or a duration in seconds.

    Parameters
    ----------
    scene : a scene, its name or file, or a system
    cycles, duration : one of the two; engine cycles, or s
    samples_per_cycle : uniform samples per engine cycle; 0 for the two ends and the per-cycle results only
    solver : a name of SOLVERS, or auto: fixed_step where inputs move the shaft's far end, else event_driven for the
        set-valued law, smoothed for the smoothed one
    rtol, step : tolerance of an adaptive solver, or step in s of a fixed-step one
    start_cycle : the engine cycle at which the run starts, which sets the phase of the excitation
    state : initial state; the system's own by default
    flywheel_angle : integrate theta1 too
    loads_from : engine cycle of the run from which on `Cycles.loads` are worked out too; none by default

    Returns
    -------
    Trajectory; a numerical failure is its `status`, not an exception: call `raise_for_status` on it.

    Raises
    ------
    InputError
        An unknown solver, a solver that does not do this friction law, a setting out of its range, or an initial state
        that is not finite.

    Examples
    --------
    >>> import tcc_sim
    >>> scene = tcc_sim.load_scene("minimal").with_values({"engine.frequency": 140.0})
    >>> run = tcc_sim.solve(scene, cycles=60, samples_per_cycle=100)
    >>> run
    <Trajectory by smoothed: 6001 samples over 2.69279 s, 60 periods of excitation; reached the end>
    """
    system = system_of(scene)
    name = choose(system, solver)
    entry = SOLVERS[name]
    if (cycles is None) == (duration is None):
        raise InputError("give either a number of cycles or a duration in s")
    if cycles is not None and not 1 <= cycles <= 10_000_000:
        raise InputError(f"cycles is {cycles}; it must be 1 to 10000000")
    if duration is not None:
        check_duration(system, duration, start_cycle)
    if not 0 <= samples_per_cycle <= 1_000_000:
        raise InputError(f"samples per cycle is {samples_per_cycle}; it must be 0 to 1000000")
    check_setting(name, rtol, step)
    if state is None:
        i = system.initial
        state = State(i.slip_speed, i.plate_angle, i.plate_speed, i.plate_angle)
    if not math.isfinite(state.slip_speed + state.plate_angle + state.plate_speed + state.flywheel_angle):
        for quantity, value in vars(state).items():
            if not math.isfinite(value):
                raise InputError(f"the initial {quantity.replace('_', ' ')} is {value}; it must be finite")
    return entry.load()(Problem(system, state, start_cycle, cycles, duration, samples_per_cycle, rtol, step,
                                flywheel_angle, loads_from))


def check_duration(system: System, duration: float, start_cycle: int = 0) -> None:
    """Raise InputError for a duration, s, that is too short a part of an engine cycle, or too long."""
    least = SHORTEST * float(system.cycle_start(start_cycle + 1) - system.cycle_start(start_cycle))
    if not least <= duration <= 1e6:
        raise InputError(f"duration is {duration:g} s; it must be {least:.3g} to 1e6 s")


def check_setting(name: str, rtol: float | None, step: float | None) -> None:
    """Raise InputError unless the registered solver `name` takes this tolerance, or this step, s."""
    entry = SOLVERS[name]
    if rtol is not None:
        if entry.setting != "rtol":
            raise InputError(f"rtol is not a setting of solver {name}")
        if not 1e-14 <= rtol <= 1e-1:
            raise InputError(f"rtol is {rtol:g}; it must be 1e-14 to 0.1")
    if step is not None:
        if entry.setting != "step":
            raise InputError(f"step is not a setting of solver {name}")
        if not (math.isfinite(step) and 1e-9 <= step <= 1.0):
            raise InputError(f"step is {step:g} s; it must be 1e-9 to 1 s")


def choose(system: System, solver: str) -> str:
    """Return the registered name for `solver`; raise InputError unless it supports every term of the system."""
    if solver == "auto":
        moved = system.inputs is not None and system.inputs.output_speed is not None
        solver = "fixed_step" if moved else "event_driven" if system.friction.law == "set_valued" else "smoothed"
    if solver not in SOLVERS:
        raise InputError(f"solver {solver!r} is unknown; the solvers are auto, {', '.join(SOLVERS)}")
    unknown = unsupported(solver, system)
    if unknown:
        left = {name: unsupported(name, system).keys() for name in SOLVERS}
        able = [name for name, terms in left.items() if not terms]
        smooth = [name for name, terms in left.items() if terms == {system.friction.law} == {"set_valued"}]
        raise InputError(f"solver {solver} does not solve {', '.join(dict.fromkeys(unknown.values()))}; "
                         + (f"those that do are {', '.join(able or smooth)}" if able or smooth else "no solver does")
                         + (", with friction.law smoothed" if smooth and not able else ""))
    return solver


__all__ = ["SOLVERS", "Entry", "Problem", "State", "Status", "Trajectory", "check_setting", "choose", "solve"]
