"""An independent solution of the smoothed law: SciPy's LSODA at tight tolerance on separately written equations.

Slow and plain; nothing of the package's solvers or model is used. Its fellow for the set-valued law is `piecewise`.
"""

import math

import numpy as np
from scipy.integrate import solve_ivp


def sliding_of(friction):
    """Coefficient of fast slip, and pairs of amplitude over it and rate, of the exponentials beside it."""
    if friction.slip_speeds:
        curve = friction.curve
        return curve.constant, [(c / curve.constant, a) for c, a in zip(curve.amplitudes, curve.rates)]
    kinetic = friction.kinetic_coefficient
    return kinetic, [(friction.static_coefficient / kinetic - 1.0, friction.decay)]


def coefficient_and_slope(v, pairs, sigma):
    """(7) and its derivative."""
    parts = [(c * math.exp(-a * abs(v)), a) for c, a in pairs]
    ratio, step = 1.0 + sum(part for part, _ in parts), math.tanh(sigma * v)
    slope = ratio * sigma * (1.0 - step * step) - math.copysign(1.0, v) * sum(a * part for part, a in parts) * step
    return ratio * step, slope


def equations(system):
    """(1) to (7): the derivatives of (v, theta2, theta2', theta1) at a time, and their Jacobian."""
    e, pr, f, d = system.engine, system.pressure, system.friction, system.driveline
    i1, i2 = d.flywheel_inertia, d.plate_inertia
    kinetic, pairs = sliding_of(f)
    per_pressure = kinetic * system.clutch.area * system.clutch.radius

    def load(t):
        phase = pr.frequency_ratio * e.frequency * t + pr.phase
        return per_pressure * max(pr.mean + pr.amplitude * math.sin(phase), 0.0)

    def rates(t, y):
        te = e.mean_torque + e.torque_amplitude * math.sin(e.frequency * t)
        for n, (a, phase) in enumerate(zip(e.harmonic_amplitudes, e.harmonic_phases), 2):
            te += a * math.sin(n * e.frequency * t + phase)
        tf = coefficient_and_slope(y[0], pairs, f.smoothing)[0] * load(t)
        plate = (tf - d.damping * y[2] - d.stiffness * y[1]) / i2
        return [(te - tf) / i1 - plate, y[2], plate, y[0] + y[2]]

    def jacobian(t, y):
        g = coefficient_and_slope(y[0], pairs, f.smoothing)[1] * load(t)
        return np.array([[-g / i1 - g / i2, d.stiffness / i2, d.damping / i2, 0.0], [0.0, 0.0, 1.0, 0.0],
                         [g / i2, -d.stiffness / i2, -d.damping / i2, 0.0], [1.0, 0.0, 1.0, 0.0]])

    return rates, jacobian


def smoothed_run(system, state, cycles, per_cycle, rtol=1e-12, first=0, stick_speed=None):
    """As `Piecewise.run` for states at `per_cycle` samples a cycle, (n, 4): with the transitions [(t, before, after)]
    through a stick speed and the stick time where that is given. Restarted at every cycle.
    """
    rates, jacobian = equations(system)
    edges = [] if stick_speed is None else [lambda t, y: y[0] - stick_speed, lambda t, y: y[0] + stick_speed]
    y = np.array(state, dtype=float)
    rows, changes = [y[:, None]], []
    for n in range(first, first + cycles):
        t = (n + np.arange(per_cycle + 1) / per_cycle) * system.cycle
        found = solve_ivp(rates, (t[0], t[-1]), y, "LSODA", t, rtol=rtol, jac=jacobian, events=edges or None,
                          atol=np.array([1.0 / max(1.0, system.friction.smoothing / 50.0), 1e-2, 1.0, 0.1]) * rtol)
        y = found.y[:, -1]
        rows.append(found.y[:, 1:])
        for side, times, states in zip((1, -1), found.t_events or (), found.y_events or ()):
            changes += [(float(u), *((0, side) if rates(u, x)[0] * side > 0.0 else (side, 0)))
                        for u, x in zip(times, states)]
    stuck = 0.0
    if edges:
        changes.sort()
        marks = [first * system.cycle, *(u for u, _, _ in changes), (first + cycles) * system.cycle]
        modes = [0 if abs(state[0]) <= stick_speed else 1, *(after for _, _, after in changes)]
        stuck = sum(b - a for a, b, mode in zip(marks, marks[1:], modes) if mode == 0)
    return np.hstack(rows).T, changes, stuck


def smoothed_states(*question, **settings):
    """The states of `smoothed_run`."""
    return smoothed_run(*question, **settings)[0]


def tangent_map(system, x, start, cycles, rtol=1e-11, by=None):
    """The state (3,) some cycles after `start` cycles, and its derivatives by the state and, last, by a number of which
    `by(k)` is the system moved by k steps of one unit, at constant phase; from the variational equations.
    """
    rates, jacobian = equations(system)
    cycle, columns = system.cycle, 3 if by is None else 4
    moved = {} if by is None else {k: (equations(by(k))[0], by(k).cycle) for k in (-2.0, -1.0, 1.0, 2.0)}

    def right(phase, z):  # By the phase in cycles, in which a frequency that varies leaves the sines where they are.
        y, tangent = np.append(z[:3], 0.0), z[3:].reshape(3, columns)
        out = jacobian(phase * cycle, y)[:3, :3] @ tangent * cycle
        if moved:
            a, b, c, d = (of[1] * np.array(of[0](phase * of[1], y)[:3]) for of in moved.values())
            out[:, 3] += (a - 8.0 * b + 8.0 * c - d) / 12.0
        return np.concatenate([np.array(rates(phase * cycle, y)[:3]) * cycle, out.ravel()])

    def steering(phase, z):  # What is left out of it only steers LSODA's Newton iteration.
        a = jacobian(phase * cycle, np.append(z[:3], 0.0))[:3, :3] * cycle
        out = np.zeros((len(z), len(z)))
        out[:3, :3], out[3:, 3:] = a, np.kron(a, np.eye(columns))
        return out

    initial = np.concatenate([x, np.eye(3, columns).ravel()])
    found = solve_ivp(right, (start, start + cycles), initial, method="LSODA", rtol=rtol, atol=1e-2 * rtol,
                      jac=steering)
    return found.y[:3, -1], found.y[3:, -1].reshape(3, columns)
