"""Independent solutions by SciPy at tight tolerances, for the reports and the tests, on equations written out here,
without the solvers of this package.

The smoothed law (7) is one smooth problem. The set-valued law (6) is solved from event to event: modes 0 stick, +1 and
-1 slip, 2 free (no load), and SciPy locates each change. Two methods give two references; their difference is the
floor, below which an error is not resolved. States are slip speed, plate angle, plate speed, flywheel angle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tcc_sim.errors import NumericalFailure
from tcc_sim.model.equations import check_supported
from tcc_sim.model.groups import Friction
from tcc_sim.model.parameters import System
from tcc_sim.trajectory import Floats, State

Pairs = Sequence[tuple[float, float]]
POINTS = 129
"""Number of points of the search around a largest slip speed."""
REARM = 1e-7
"""Time after a change of mode without the event v = 0, s, since a breakaway with mu_k = mu_s starts with v' = 0."""
LONGEST = 0.1
"""Longest step of the set-valued reference, in phase of the fastest oscillation, rad."""
EVALUATIONS = 400_000
"""Largest number of evaluations of the equations of motion in one `final_state`."""


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
    drag : damper of the flywheel against the ground, N m s/rad
    """

    def __init__(self, system: System, left: float = math.inf, drag: float = 0.0) -> None:
        self.system, self.left, self.drag = system, left, drag
        d, e, p = system.driveline, system.engine, system.pressure
        self._driveline = d.flywheel_inertia, d.plate_inertia, d.damping, d.stiffness
        self._sines = [(e.torque_amplitude, e.frequency, 0.0), *((a, n * e.frequency, phase) for n, (a, phase) in
                                                                 enumerate(zip(e.harmonic_amplitudes,
                                                                               e.harmonic_phases), 2))]
        self._pressure = p.mean, p.amplitude, p.frequency_ratio * e.frequency, p.phase
        kinetic, pairs = sliding_of(system.friction)
        self._per_pressure = kinetic * system.clutch.area * system.clutch.radius
        self.ratio = 1.0 + sum(c for c, _ in pairs)
        self.sliding = partial(coefficient_and_slope, pairs=pairs, sigma=system.friction.smoothing)

    def engine(self, t: float) -> float:
        """Return Te(t), N m."""
        out = self.system.engine.mean_torque
        for amplitude, frequency, phase in self._sines:
            out += amplitude * math.sin(frequency * t + phase)
        return out

    def load(self, t: float) -> float:
        """Return Ts(t) before the clamp at 0, N m."""
        mean, amplitude, frequency, phase = self._pressure
        return self._per_pressure * (mean + amplitude * math.sin(frequency * t + phase))

    def need(self, t: float, y: Any) -> float:
        """Return the friction torque at which v' = 0 where v = 0, N m."""
        i1, i2, damping, stiffness = self._driveline
        spring = damping * y[2] + stiffness * y[1]
        return float((i2 * (self.engine(t) - self.drag * y[2]) + i1 * spring) / (i1 + i2))

    def rates(self, t: float, y: Any, mode: int) -> list[float]:
        """Return the derivatives of (v, theta2, omega2, theta1); y may be without theta1."""
        self.left -= 1
        if self.left < 0:
            raise NumericalFailure(f"more than {EVALUATIONS} evaluations")
        i1, i2, damping, stiffness = self._driveline
        v, angle, speed = float(y[0]), float(y[1]), float(y[2])
        if mode == 0:
            torque = self.need(t, (v, angle, speed))
        else:
            load = 0.0 if mode == 2 else max(self.load(t), 0.0)
            torque = load * self.sliding(v, mode=mode)[0] + self.system.converter.coupling * v
        plate = (torque - damping * speed - stiffness * angle) / i2
        slip = 0.0 if mode == 0 else (self.engine(t) - torque - self.drag * (v + speed)) / i1 - plate
        return [slip, speed, plate, v + speed]

    def jacobian(self, t: float, y: Any, mode: int) -> list[list[float]]:
        """Return the derivatives of `rates` by the four states."""
        i1, i2, damping, stiffness = self._driveline
        if mode == 0:
            both = i1 + i2
            return [[0.0] * 4, [0.0, 0.0, 1.0, 0.0], [0.0, -stiffness / both, -(damping + self.drag) / both, 0.0],
                    [1.0, 0.0, 1.0, 0.0]]
        load, slow = 0.0 if mode == 2 else max(self.load(t), 0.0), self.drag / i1
        rise = self.system.converter.coupling + load * self.sliding(float(y[0]), mode=mode)[1]
        return [[-rise / i1 - rise / i2 - slow, stiffness / i2, damping / i2 - slow, 0.0], [0.0, 0.0, 1.0, 0.0],
                [rise / i2, -stiffness / i2, -damping / i2, 0.0], [1.0, 0.0, 1.0, 0.0]]

    def arc(self, t: float, end: float, y: Floats, mode: int, changed: float, method: str, rtol: float, atol: Any,
            longest: float = math.inf, dense: bool = False) -> Any:
        """Solve one mode up to its end or the end time; the second event is the load's zero.

        changed : time before which a mode +1 or -1 does not end, s, less REARM
        """
        def over(t: float, y: Floats) -> float:
            if mode == 0:
                return self.ratio * self.load(t) - abs(self.need(t, y))
            return 1.0 if mode == 2 or t < changed + REARM else mode * float(y[0])

        def clamp(t: float, y: Floats) -> float:
            # A constant load of 0 must not give an event, but SciPy counts two successive zeros as a crossing.
            return (self.load(t) or -1.0) if mode == 2 else -self.load(t)

        n, events = len(y), None
        if mode != 3:
            events = [over, clamp]
            for event, direction in ((over, -1.0), (clamp, 1.0)):
                vars(event).update(terminal=True, direction=direction)
        options: dict[str, Any] = {} if method == "DOP853" else {
            "jac": lambda t, y: np.array(self.jacobian(t, y, mode))[:n, :n]}
        run = solve_ivp(lambda t, y: self.rates(t, y, mode)[:n], (t, end), y, method=method, rtol=rtol, atol=atol,
                        events=events, max_step=longest, dense_output=dense, **options)
        if run.status < 0:
            raise NumericalFailure(f"SciPy {method}: {run.message}")
        return run

    def first_mode(self, y: Floats) -> int:
        """Return the mode at t = 0."""
        if self.system.friction.law == "smoothed":
            return 3
        if self.load(0.0) <= 0.0:
            return 2
        return int(np.sign(y[0])) or self.at_rest(0.0, y)

    def at_rest(self, t: float, y: Floats) -> int:
        """Return the mode that starts at v = 0 under the set-valued law."""
        need, limit = self.need(t, y), self.ratio * self.load(t)
        if abs(need) <= limit * (1.0 + 1e-9):
            return 0
        return 1 if need > 0.0 else -1

    def following(self, t: float, y: Floats, mode: int, free: bool) -> int:
        """Return the mode after an event, which is the load's zero if `free`; set v to exactly 0 where slip ends."""
        if free and mode == 2:
            return int(np.sign(y[0])) if abs(y[0]) > 1e-9 else self.at_rest(t, y)
        if free:
            return 2
        if mode == 0:
            return 1 if self.need(t, y) > 0.0 else -1
        y[0] = 0.0
        return self.at_rest(t, y)

    def arcs(self, y: Floats, ends: Sequence[float], method: str, rtol: float, atol: Any = None, longest: float = 0.0,
             dense: bool = False) -> Iterator[tuple[int, int, Any, Floats, int]]:
        """Yield every arc from t = 0 up to each of `ends`: number of the end, mode of the arc, its solution by SciPy,
        the state after it and the mode that follows.

        atol, longest : absolute tolerance, by default of `error_scales`, and longest step of the set-valued law, s, by
            default of LONGEST, since SciPy would miss two events in one step
        """
        frequency = self.system.engine.frequency * max(1.0, self.system.pressure.frequency_ratio)
        longest = longest or LONGEST / max(frequency, self.system.natural_frequency)
        atol = rtol * error_scales(self.system) if atol is None else atol
        mode, t, changed = self.first_mode(y), 0.0, -math.inf
        for n, end in enumerate(ends):
            while t < end:
                run = self.arc(t, end, y, mode, changed, method, rtol, atol, longest if mode != 3 else math.inf, dense)
                t, y, solved = float(run.t[-1]), run.y[:, -1].copy(), mode
                if run.status == 1:
                    mode, changed = self.following(t, y, mode, free=len(run.t_events[1]) > 0), t
                if mode == 0:
                    y[0] = 0.0
                yield n, solved, run, y, mode


def sliding_of(friction: Friction) -> tuple[float, list[tuple[float, float]]]:
    """Return the coefficient of fast slip, and amplitude over it and rate, s/rad, of each exponential beside it."""
    if friction.curve is not None:
        curve = friction.curve
        return curve.constant, [(c / curve.constant, a) for c, a in zip(curve.amplitudes, curve.rates)]
    kinetic = friction.kinetic_coefficient
    return kinetic, [(friction.static_coefficient / kinetic - 1.0, friction.decay)]


def coefficient_and_slope(v: float, pairs: Pairs, sigma: float, mode: int = 3) -> tuple[float, float]:
    """Return mubar of (7), or for mode +1 or -1 the slip branch of (6), with pairs of `sliding_of`; and its slope."""
    size, value, falling = abs(v) if mode == 3 else max(mode * v, 0.0), 1.0, 0.0
    for c, a in pairs:
        part = c * math.exp(-a * size)
        value += part
        falling -= a * part
    if mode != 3:
        return value * mode, falling
    step = math.tanh(sigma * v)
    return value * step, sigma * (1.0 - step) * (1.0 + step) * value + falling * abs(step)


def reference(system: System, cycles: int, method: str, rtol: float) -> Reference:
    """Solve `system` from its initial state with SciPy's `method` at this tolerance; NumericalFailure if it fails."""
    check_supported("reference", system, "a reference solution")
    law, start = Law(system), np.array(State.at_start(system).numbers)
    section, largest, size = np.empty((cycles + 1, 3)), np.zeros(cycles), np.zeros(3)
    section[0] = start
    ends = [(n + 1) * system.cycle for n in range(cycles)]
    for n, mode, run, y, _ in law.arcs(start, ends, method, rtol):
        largest[n] = max(largest[n], largest_speed(law, run.t, run.y, mode, rtol))
        if n >= cycles // 2:
            size = np.maximum(size, np.abs(run.y).max(axis=1))
        section[n + 1] = y
    how = "" if system.friction.law == "smoothed" else " from event to event"
    return Reference(f"SciPy {method}{how}, rtol {rtol:g}", section, largest, size)


def final_state(system: System, duration: float, method: str, rtol: float) -> tuple[Floats, Floats]:
    """Return the state after `duration` seconds, and the largest magnitude of each component until then, both (3,);
    raise NumericalFailure if SciPy failed or needed more than EVALUATIONS.
    """
    check_supported("reference", system, "a reference solution")
    last: Floats = np.array(State.at_start(system).numbers)
    largest = np.abs(last)
    for _, _, run, y, _ in Law(system, EVALUATIONS).arcs(last, [duration], method, rtol):
        last, largest = y, np.maximum(largest, np.abs(run.y).max(axis=1))
    return last, largest


def errors(run: Any, truth: Reference) -> tuple[float, float, float]:
    """Return final, section and maximum-slip error, relative to signal maxima in the second half of the horizon, of a
    run with `section` and `largest` as a reference has them. The largest one between two references is the floor.
    """
    size = np.maximum(truth.size, 1e-300)
    off = np.abs(run.section - truth.section) / size
    return float(off[-1].max()), float(off.max()), float(np.abs(run.largest - truth.largest).max() / size[0])


def error_scales(system: System) -> Floats:
    """Return the magnitudes below which errors are absolute: slip speed in stick, static twist, twist at omega_n."""
    twist = max(abs(system.engine.mean_torque) + system.engine.torque_amplitude, 1.0) / system.driveline.stiffness
    slip = max(1.0 / system.friction.smoothing, 1e-6) if system.friction.law == "smoothed" else 1.0
    return np.array([slip, twist, twist * system.natural_frequency])


def largest_speed(law: Law, t: Floats, y: Floats, mode: int, rtol: float) -> float:
    """Return the largest |v| of an arc; SciPy's DOP853, with an interpolant of order 7, refines the largest node."""
    if mode == 0:
        return 0.0
    k = int(np.argmax(np.abs(y[0])))
    low, high = max(k - 1, 0), min(k + 1, len(t) - 1)
    if high == low:
        return abs(float(y[0, k]))
    run = solve_ivp(lambda t, y: law.rates(t, y, mode)[:3], (t[low], t[high]), y[:, low], method="DOP853",
                    rtol=max(rtol, 3e-14), atol=rtol * error_scales(law.system), dense_output=True,
                    max_step=(t[high] - t[low]) / 2)
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
