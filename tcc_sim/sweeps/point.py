"""One point of a sweep: a simulation at one value of a scene key in little memory, and where its neighbour goes on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tcc_sim.analysis.damping import Damping, damping_as_json
from tcc_sim.analysis.summary import Summary
from tcc_sim.model.parameters import System
from tcc_sim.model.sines import common_cycles
from tcc_sim.solvers import SOLVERS, choose
from tcc_sim.sweeps.exponents import Lyapunov
from tcc_sim.sweeps.settings import DEFAULTS
from tcc_sim.sweeps.simulation import Plan, simulate
from tcc_sim.sweeps.steady_state import Start
from tcc_sim.trajectory import Floats, State

SUMMARY_KEYS = ("max_slip_speed", "min_slip_speed", "section", "period", "stick_fraction", "regime", "cycles",
                "discarded", "settled", "section_change", "solver", "elapsed_s", "runaway",
                "clutch_energy", "peak_power", "max_shaft_torque", "min_shaft_torque", "breakaways")
"""Keys of `simulate --json` that a sweep has per value."""
MAY_BE_NAN = ("section_change", "clutch_energy", "peak_power", "max_shaft_torque", "min_shaft_torque")


@dataclass(frozen=True, slots=True)
class Point:
    """The result at one value.

    value : of the key
    summary : maxima, period, regime, with its section left to `section`; None where the solver failed
    section : (n, 2) array, plate angle (rad) and slip speed (rad/s)
    confirmed : whether the section has settled and further cycles stay on it
    status : sentence of the solver
    theta2 : (n,) array, plate angle on the section over the last cycles, oldest first; rad
    damping, lyapunov : where asked for
    end : where the motion goes on from
    """

    value: float
    summary: Summary | None
    section: Floats
    confirmed: bool
    status: str
    theta2: Floats
    damping: Damping | None
    lyapunov: Lyapunov | None
    end: Start

    def as_json(self) -> dict[str, Any]:
        """The point as JSON values; a failed one has null in every result."""
        found = self.summary.as_json() if self.summary is not None else {}
        out: dict[str, Any] = {"value": self.value, **{name: found.get(name) for name in SUMMARY_KEYS},
                               "section": self.section.tolist(), "confirmed": self.confirmed, "status": self.status}
        if len(self.theta2):
            out["theta2"] = self.theta2.tolist()
        if self.damping is not None:
            out.update(damping_as_json(self.damping))
        if self.lyapunov is not None:
            out["lyapunov"] = self.lyapunov.as_json()
        return out

    def as_record(self) -> dict[str, Any]:
        """`as_json` with the end of the motion: what the file of a sweep holds."""
        return {**self.as_json(), "final": list(self.end.state.numbers), "final_cycle": self.end.cycle}


def point_of(record: Mapping[str, Any], system: System) -> Point:
    """The point that `as_record` gave.

    Raises
    ------
    KeyError, TypeError, ValueError
        A record that no point gives.
    """
    summary = None
    if record["max_slip_speed"] is not None:
        numbers = {name: record[name] for name in SUMMARY_KEYS}
        unknown = {name: math.nan for name in MAY_BE_NAN if numbers[name] is None}
        summary = Summary(**{**numbers, "section": [], **unknown})
        if not all(isinstance(getattr(summary, name), (int, float)) for name in (
                "max_slip_speed", "min_slip_speed", "period", "stick_fraction", *MAY_BE_NAN)):
            raise TypeError("not a number")
    damping = lyapunov = None
    if "equivalent_damping" in record:
        weighted, negative = (math.nan if x is None else float(x)
                              for x in (record["equivalent_damping"], record["negative_slope_mean"]))
        damping = Damping(weighted, negative, -system.driveline.damping)
    if "lyapunov" in record:
        values: dict[str, Any] = {k: math.nan if v is None else v for k, v in record["lyapunov"].items()}
        lyapunov = Lyapunov(**values)
    v, angle, speed = map(float, record["final"])
    return Point(float(record["value"]), summary, np.array(record["section"], dtype=np.float64).reshape(-1, 2),
                 bool(record["confirmed"]), str(record["status"]),
                 np.array(record.get("theta2", []), dtype=np.float64).reshape(-1), damping, lyapunov,
                 Start(State(v, angle, speed), int(record["final_cycle"])))


def solve_point(system: System, value: float, plan: Plan, start: Start | None = None) -> Point:
    """Solve one point of a sweep from `start`, or from the system's own initial state.

    A numerical failure is the status of the point, with no summary; the state at which it stopped is not passed on.
    """
    found = simulate(system, swept(system, plan), start=start)
    summary, section = found.summary, np.empty((0, 2))
    if summary is not None:
        section = np.array(summary.section, dtype=np.float64).reshape(-1, 2)
        summary = replace(summary, section=[])
    return Point(value, summary, section, found.confirmed, found.status, found.angles, found.damping, found.lyapunov,
                 found.end)


def swept(system: System, plan: Plan) -> Plan:
    """The plan with the tolerance of a sweep where it gives none; to settle, a section must repeat more closely."""
    entry = SOLVERS[choose(system, plan.solver)]
    if plan.rtol is not None or plan.discard == "auto" or entry.setting != "rtol" or entry.default >= DEFAULTS.rtol:
        return plan
    return replace(plan, rtol=DEFAULTS.rtol)


def solve_points(systems: Sequence[System], values: Sequence[float], plan: Plan, start: Start | None) -> list[Point]:
    """Points one after the other; up and down go on from the end of the one before."""
    points: list[Point] = []
    for k, (system, value) in enumerate(zip(systems, values)):
        if k and plan.direction != "cold":
            start = handed_over(systems[k - 1], points[-1].end, system)
        points.append(solve_point(system, value, plan, start))
    return points


def handed_over(before: System, end: Start, system: System) -> Start:
    """Where a system takes up the motion of another one.

    The state is that on the section, so the phase of the torque and of its harmonics goes on. The phase of the load is
    2 pi (omega_f/omega) n + psi at cycle n: it goes on too where both systems have the same ratio, whatever the engine
    frequency. Where the ratio is another one, n is the cycle of the first thousand at which the load is nearest to
    where the other one left it, so that psi keeps its meaning.
    """
    ratio, earlier = system.pressure.frequency_ratio, before.pressure.frequency_ratio
    repeats = common_cycles(system)
    if ratio == earlier or repeats == 1:
        return Start(end.state, end.cycle % repeats if repeats else end.cycle)
    trial = np.arange(repeats or DEFAULTS.phases_tried)
    turn = ratio * trial - earlier * end.cycle + (system.pressure.phase - before.pressure.phase) / (2.0 * math.pi)
    apart = np.abs(turn - np.round(turn))
    return Start(end.state, int(np.flatnonzero(apart <= apart.min() + 1e-9)[0]))
