"""An independent solution of the smoothed law: SciPy's LSODA at tight tolerance on separately written equations.

Slow and plain; nothing of the package's solvers or model is used. Its fellow for the set-valued law is `piecewise`.
"""

import math

import numpy as np
from scipy.integrate import odeint, solve_ivp


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


def equations(system, drag=0.0):
    """(1) to (7): the derivatives of (v, theta2, theta2', theta1) at a time, and their Jacobian; `drag` is a damper of
    the flywheel, N m s/rad.
    """
    e, pr, f, d = system.engine, system.pressure, system.friction, system.driveline
    i1, i2, damping, stiffness, sigma, omega = (d.flywheel_inertia, d.plate_inertia, d.damping, d.stiffness,
                                                f.smoothing, e.frequency)
    kinetic, pairs = sliding_of(f)
    area = kinetic * system.clutch.area * system.clutch.radius
    mean, amplitude, fast, shift = area * pr.mean, area * pr.amplitude, pr.frequency_ratio * omega, pr.phase
    sines = [(e.torque_amplitude, omega, 0.0), *((a, n * omega, phase) for n, (a, phase) in enumerate(
        zip(e.harmonic_amplitudes, e.harmonic_phases), 2))]
    constant, exp, tanh, sin, fluid = e.mean_torque, math.exp, math.tanh, math.sin, system.converter.coupling

    def load(t):
        return max(mean + amplitude * sin(fast * t + shift), 0.0)

    def rates(t, y):
        v, angle, speed, te, law = y[0], y[1], y[2], constant, 1.0
        for a, w, phase in sines:
            te += a * sin(w * t + phase)
        for c, rate in pairs:
            law += c * exp(-rate * abs(v))
        tf = law * tanh(sigma * v) * load(t) + fluid * v
        plate = (tf - damping * speed - stiffness * angle) / i2
        return [(te - tf - drag * (v + speed)) / i1 - plate, speed, plate, v + speed]

    def jacobian(t, y):
        g = coefficient_and_slope(y[0], pairs, sigma)[1] * load(t) + fluid
        slow = drag / i1
        return [[-g / i1 - g / i2 - slow, stiffness / i2, damping / i2 - slow, 0.0], [0.0, 0.0, 1.0, 0.0],
                [g / i2, -stiffness / i2, -damping / i2, 0.0], [1.0, 0.0, 1.0, 0.0]]

    return rates, jacobian


def smoothed_states(system, state, cycles, per_cycle, rtol=1e-12, drag=0.0):
    """States at `per_cycle` samples a cycle, (n, 4), restarted at every cycle."""
    rates, jacobian = equations(system, drag)
    rows = [np.array(state, dtype=float)[None]]
    for n in range(cycles):
        t = (n + np.arange(per_cycle + 1) / per_cycle) * system.cycle
        rows.append(odeint(rates, rows[-1][-1], t, Dfun=jacobian, tfirst=True, rtol=rtol, mxstep=100_000,
                           atol=scales(system) * rtol)[1:])
    return np.vstack(rows)


def scales(system):
    """Magnitudes below which errors of the state are absolute."""
    return np.array([1.0 / max(1.0, system.friction.smoothing / 50.0), 1e-2, 1.0, 0.1])


def smoothed_run(system, state, cycles, per_cycle, stick_speed):
    """As `Piecewise.run`, with the transitions through a stick speed."""
    rates, jacobian = equations(system)
    edges = [lambda t, y: y[0] - stick_speed, lambda t, y: y[0] + stick_speed]
    solution = solve_ivp(rates, (0.0, cycles * system.cycle), state, "LSODA", rtol=1e-12, jac=jacobian, events=edges,
                         atol=scales(system) * 1e-12, dense_output=False)
    changes = sorted((float(u), *((0, side) if rates(u, x)[0] * side > 0.0 else (side, 0)))
                     for side, times, states in zip((1, -1), solution.t_events, solution.y_events)
                     for u, x in zip(times, states))
    marks = [0.0, *(u for u, _, _ in changes), cycles * system.cycle]
    modes = [0 if abs(state[0]) <= stick_speed else 1, *(after for _, _, after in changes)]
    stuck = sum(b - a for a, b, mode in zip(marks, marks[1:], modes) if mode == 0)
    return smoothed_states(system, state, cycles, per_cycle), changes, stuck


def tangent_map(system, x, start, cycles, rtol=1e-11, by=None):
    """The state (3,) some cycles after `start` cycles, and its derivatives by the state and, last, by a number of which
    `by(k)` is the system moved by k steps of one unit, at constant phase; from the variational equations.
    """
    rates, jacobian = equations(system)
    cycle, columns = system.cycle, 3 if by is None else 4
    moved = [] if by is None else [(k, equations(by(n))[0], by(n).cycle / 12.0)
                                   for n, k in ((-2.0, 1.0), (-1.0, -8.0), (1.0, 8.0), (2.0, -1.0))]

    def right(phase, z):  # By the phase in cycles, in which a frequency that varies leaves the sines where they are.
        y, (a, _, b, _) = z[:3].tolist(), jacobian(phase * cycle, z)
        out, tangent = [cycle * rate for rate in rates(phase * cycle, y)[:3]], z[3:].tolist()
        first, second, third = tangent[:columns], tangent[columns:2 * columns], tangent[2 * columns:]
        extra = [[0.0] * columns for _ in range(3)]
        if moved:
            for k, of, length in moved:
                for row, rate in zip(extra, of(phase * length * 12.0, y)):
                    row[3] += k * length * rate
        out += [cycle * (a[0] * p + a[1] * q + a[2] * r) + s for p, q, r, s in zip(first, second, third, extra[0])]
        out += [cycle * r + s for r, s in zip(third, extra[1])]
        out += [cycle * (b[0] * p + b[1] * q + b[2] * r) + s for p, q, r, s in zip(first, second, third, extra[2])]
        return out

    def steering(phase, z):  # What is left out of it only steers LSODA's Newton iteration.
        a = np.array(jacobian(phase * cycle, z))[:3, :3] * cycle
        out = np.zeros((len(z), len(z)))
        out[:3, :3], out[3:, 3:] = a, np.kron(a, np.eye(columns))
        return out

    initial = np.concatenate([x, np.eye(3, columns).ravel()])
    end = odeint(right, initial, [start, start + cycles], Dfun=steering, tfirst=True, rtol=rtol, atol=1e-2 * rtol,
                 mxstep=100_000)[-1]
    return end[:3], end[3:].reshape(3, columns)
