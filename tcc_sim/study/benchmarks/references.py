"""Reference solutions for the reports: SciPy at tight tolerances, on equations written out here, without the solvers of
this package.

The smoothed law (7) is one smooth problem. The set-valued law (6) is solved from event to event: modes 0 stick, +1 and
-1 slip, 2 free (no load), and SciPy locates each change. Two methods give two references; their difference is the
floor, below which an error is not resolved.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tcc_sim.model.parameters import System
from tcc_sim.model.supported_terms import check_supported
from tcc_sim.trajectory import State

Floats = NDArray[np.float64]
POINTS = 129
"""Number of points of the search around a largest slip speed."""
REARM = 1e-7
"""Time after a change of mode without the event v = 0, s, since a breakaway with mu_k = mu_s starts with v' = 0."""
LONGEST = 0.1
"""Longest step of the set-valued reference, in phase of the fastest oscillation, rad."""
EVALUATIONS = 400_000
"""Largest number of evaluations of the equations of motion in one `final_state`."""


class Unfinished(Exception):
    """SciPy gave no reference; the message gives the reason."""


@dataclass(frozen=True)
class Reference:
    """States at t = 2 pi n/omega, (N + 1, 3): slip speed, plate angle, plate speed; largest |slip speed| per cycle,
    (N,); and each signal's maximum in the second half of the horizon, (3,).
    """

    name: str
    section: Floats
    largest: Floats
    size: Floats


class Law:
    """Equations (1), (2) of one system with its friction law, as plain functions of time and state.

    left : number of further allowed evaluations of `rates`
    """

    def __init__(self, system: System, left: float = math.inf) -> None:
        check_supported("reference", system, "a reference solution")
        self.system, self.left = system, left
        d, e, p, f = system.driveline, system.engine, system.pressure, system.friction
        self._driveline = d.flywheel_inertia, d.plate_inertia, d.damping, d.stiffness
        self._torque = e.mean_torque, e.torque_amplitude, e.frequency
        self._harmonics = [(a, n * e.frequency, phase) for n, (a, phase) in enumerate(
            zip(e.harmonic_amplitudes, e.harmonic_phases), 2)]
        self._load = system.torque_per_pressure, p.mean, p.amplitude, p.frequency_ratio * e.frequency, p.phase
        self._friction = system.friction_ratio - 1.0, f.decay, f.smoothing

    def engine(self, t: float) -> float:
        """Return Te(t), N m."""
        mean, amplitude, frequency = self._torque
        out = mean + amplitude * math.sin(frequency * t)
        for amplitude, frequency, phase in self._harmonics:
            out += amplitude * math.sin(frequency * t + phase)
        return out

    def load(self, t: float) -> float:
        """Return Ts(t) before the clamp at 0, N m."""
        per_pressure, mean, amplitude, frequency, phase = self._load
        return per_pressure * (mean + amplitude * math.sin(frequency * t + phase))

    def need(self, t: float, y: Any) -> float:
        """Return the friction torque at which v' = 0, N m."""
        i1, i2, damping, stiffness = self._driveline
        spring: float = damping * y[2] + stiffness * y[1]
        return (i2 * self.engine(t) + i1 * spring) / (i1 + i2)

    def slope(self, v: float, mode: int) -> float:
        """Return the slope of `coefficient`."""
        excess, decay, smoothing = self._friction
        if mode != 3:
            return -decay * (excess * math.exp(-decay * max(mode * v, 0.0)))
        falling = excess * math.exp(-decay * abs(v))
        step = math.tanh(smoothing * v)
        rise = smoothing * (1.0 - step) * (1.0 + step)
        return rise * (1.0 + falling) - decay * falling * abs(step)

    def coefficient(self, v: float, mode: int) -> float:
        """Return mubar: law (7) for mode 3, the slip branch of (6) for mode +1 and -1."""
        excess, decay, smoothing = self._friction
        if mode != 3:
            return mode * (1.0 + excess * math.exp(-decay * max(mode * v, 0.0)))
        return (1.0 + excess * math.exp(-decay * abs(v))) * math.tanh(smoothing * v)

    def rates(self, t: float, y: Any, mode: int) -> list[float]:
        """Return the derivative of (v, theta2, omega2)."""
        self.left -= 1
        if self.left < 0:
            raise Unfinished(f"more than {EVALUATIONS} evaluations")
        i1, i2, damping, stiffness = self._driveline
        v, angle, speed = map(float, y)
        if mode == 0:
            torque = self.need(t, (v, angle, speed))
        else:
            torque = 0.0 if mode == 2 else max(self.load(t), 0.0) * self.coefficient(v, mode)
        plate = (torque - damping * speed - stiffness * angle) / i2
        return [0.0 if mode == 0 else (self.engine(t) - torque) / i1 - plate, speed, plate]

    def jacobian(self, t: float, y: Any, mode: int) -> Floats:
        """Return the derivative of `rates` with respect to the state."""
        d = self.system.driveline
        slope = 0.0 if mode in (0, 2) else max(self.load(t), 0.0) * self.slope(y[0], mode)
        back: Floats = np.array([slope, -d.stiffness, -d.damping])
        if mode == 0:
            share = d.flywheel_inertia / (d.flywheel_inertia + d.plate_inertia) - 1.0
            return np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0],
                             share * np.array([0.0, d.stiffness, d.damping]) / d.plate_inertia])
        return np.array([-slope / d.flywheel_inertia * np.eye(3)[0] - back / d.plate_inertia, [0.0, 0.0, 1.0],
                         back / d.plate_inertia])


def reference(system: System, cycles: int, method: str, rtol: float) -> Reference:
    """Solve `system` from its initial state with SciPy's `method` at this tolerance.

    Raises
    ------
    Unfinished
        SciPy failed.
    """
    law, start = Law(system), np.array(State.at_start(system).numbers)
    section, largest, size = np.empty((cycles + 1, 3)), np.zeros(cycles), np.zeros(3)
    section[0] = start
    ends = [(n + 1) * system.cycle for n in range(cycles)]
    for n, mode, run, y in _pieces(law, start, ends, method, rtol):
        largest[n] = max(largest[n], _largest(law, run.t, run.y, mode, rtol, rtol * error_scales(system)))
        if n >= cycles // 2:
            size = np.maximum(size, np.abs(run.y).max(axis=1))
        section[n + 1] = y
    law_name = "" if system.friction.law == "smoothed" else " from event to event"
    return Reference(f"SciPy {method}{law_name}, rtol {rtol:g}", section, largest, size)


def final_state(system: System, duration: float, method: str, rtol: float) -> tuple[Floats, Floats]:
    """Return the state after `duration` seconds, and the largest magnitude of each component until then, both (3,).

    Raises
    ------
    Unfinished
        SciPy failed or needed more than EVALUATIONS.
    """
    last: Floats = np.array(State.at_start(system).numbers)
    largest = np.abs(last)
    for _, _, run, y in _pieces(Law(system, EVALUATIONS), last, [duration], method, rtol):
        last, largest = y, np.maximum(largest, np.abs(run.y).max(axis=1))
    return last, largest


def _pieces(law: Law, y: Floats, ends: Sequence[float], method: str, rtol: float) -> Iterator[tuple[int, int, Any,
                                                                                                    Floats]]:
    """Yield every arc up to each of `ends`: number of the end, arc, mode, and state after the arc."""
    mode = 3 if law.system.friction.law == "smoothed" else _first_mode(law, y)
    t, changed, atol = 0.0, -math.inf, rtol * error_scales(law.system)
    for n, end in enumerate(ends):
        while t < end:
            run = _arc(law, t, end, y, mode, changed, method, rtol, atol)
            t, y, solved = float(run.t[-1]), run.y[:, -1].copy(), mode
            if run.status == 1:
                mode, changed = _following(law, t, y, mode, free=len(run.t_events[1]) > 0), t
            yield n, solved, run, y


def disagreement(first: Reference, second: Reference) -> float:
    """Return the floor: the largest of the three errors of one reference against the other."""
    return max(errors(second.section, second.largest, first))


def errors(section: Floats, largest: Floats, truth: Reference) -> tuple[float, float, float]:
    """Return final, section and maximum-slip error, relative to signal maxima in the second half of the horizon.

    Parameters
    ----------
    section : (N + 1, 3) array; the first error is that of its last row, the second the largest of any row
    largest : (N,) array, largest |slip speed| of each cycle, rad/s
    """
    size = np.maximum(truth.size, 1e-300)
    off = np.abs(section - truth.section) / size
    return float(off[-1].max()), float(off.max()), float(np.abs(largest - truth.largest).max() / size[0])


def error_scales(system: System) -> Floats:
    """Return the magnitudes below which errors are absolute: slip speed in stick, static twist, twist at omega_n."""
    twist = max(abs(system.engine.mean_torque) + system.engine.torque_amplitude, 1.0) / system.driveline.stiffness
    slip = max(1.0 / system.friction.smoothing, 1e-6) if system.friction.law == "smoothed" else 1.0
    return np.array([slip, twist, twist * system.natural_frequency])


def _arc(law: Law, t: float, end: float, y: Floats, mode: int, changed: float, method: str, rtol: float,
         atol: Floats) -> Any:
    """Solve one mode up to its end or the end time; the second event is the load's zero."""

    def over(t: float, y: Floats) -> float:
        if mode == 0:
            return law.system.friction_ratio * law.load(t) - abs(law.need(t, y))
        return 1.0 if mode == 2 or t < changed + REARM else mode * float(y[0])

    def clamp(t: float, y: Floats) -> float:
        # A constant load of 0 must not give an event, but SciPy counts two successive zeros as a crossing.
        return (law.load(t) or -1.0) if mode == 2 else -law.load(t)

    events: list[Any] = []
    if mode != 3:
        events = [over, clamp]
        for event, direction in ((over, -1.0), (clamp, 1.0)):
            vars(event).update(terminal=True, direction=direction)
    options: dict[str, Any] = {} if method == "DOP853" else {"jac": lambda t, y: law.jacobian(t, y, mode)}
    if mode != 3:
        # SciPy detects events by the signs at step ends and would miss two events in one step.
        frequency = law.system.engine.frequency * max(1.0, law.system.pressure.frequency_ratio)
        options["max_step"] = LONGEST / max(frequency, law.system.natural_frequency)
    run = solve_ivp(lambda t, y: law.rates(t, y, mode), (t, end), y, method=method, rtol=rtol, atol=atol,
                    events=events or None, **options)
    if run.status < 0:
        raise Unfinished(f"SciPy {method}: {run.message}")
    return run


def _largest(law: Law, t: Floats, y: Floats, mode: int, rtol: float, atol: Floats) -> float:
    """Return the largest |v| of an arc; SciPy's DOP853, with an interpolant of order 7, refines the largest node."""
    if mode == 0:
        return 0.0
    k = int(np.argmax(np.abs(y[0])))
    low, high = max(k - 1, 0), min(k + 1, len(t) - 1)
    if high == low:
        return abs(float(y[0, k]))
    run = solve_ivp(lambda t, y: law.rates(t, y, mode), (t[low], t[high]), y[:, low], method="DOP853",
                    rtol=max(rtol, 3e-14), atol=atol, dense_output=True, max_step=(t[high] - t[low]) / 2)
    times = np.linspace(t[low], t[high], POINTS)
    values = np.abs(run.sol(times)[0])
    i = int(np.argmax(values))
    largest = max(float(values[i]), abs(float(y[0, k])) if k in (0, len(t) - 1) else 0.0)

    def slope(t: float) -> float:
        return law.rates(t, run.sol(t), mode)[0]

    a, b = times[max(i - 1, 0)], times[min(i + 1, POINTS - 1)]
    if slope(a) * slope(b) < 0.0:
        largest = max(largest, abs(float(run.sol(brentq(slope, a, b, xtol=1e-15))[0])))
    return largest


def _first_mode(law: Law, y: Floats) -> int:
    """Return the mode at t = 0 under the set-valued law."""
    if law.load(0.0) <= 0.0:
        return 2
    return int(np.sign(y[0])) or _at_rest(law, 0.0, y)


def _at_rest(law: Law, t: float, y: Floats) -> int:
    """Return the mode that starts at v = 0."""
    need, limit = law.need(t, y), law.system.friction_ratio * law.load(t)
    if abs(need) <= limit * (1.0 + 1e-9):
        return 0
    return 1 if need > 0.0 else -1


def _following(law: Law, t: float, y: Floats, mode: int, free: bool) -> int:
    """Return the mode after an event; set v to exactly 0 where slip ends."""
    if free and mode == 2:
        return int(np.sign(y[0])) if abs(y[0]) > 1e-9 else _at_rest(law, t, y)
    if free:
        return 2
    if mode == 0:
        return 1 if law.need(t, y) > 0.0 else -1
    y[0] = 0.0
    return _at_rest(law, t, y)
