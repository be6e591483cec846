"""The smoothed engine against SciPy at tight tolerance, and against identities of the equations."""

import math
from dataclasses import replace as changed

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tcc_sim.model import friction
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import smoothed
from tcc_sim.solvers.terms import terms_of
from tcc_sim.solvers.trajectory import Problem, State, Status, stick_speed_of

FIG02 = {"pressure.mean": 260417.0, "pressure.amplitude": 52083.4, "friction.kinetic_coefficient": 0.24}
PERIODIC = {**FIG02, "friction.kinetic_coefficient": 0.3, "pressure.amplitude": 0.0}
SCENES = {
    "no stribeck": PERIODIC,
    "fig02": FIG02,
    "steep": {**FIG02, "friction.kinetic_coefficient": 0.15},
    "harmonics": {**FIG02, "engine.harmonic_amplitudes": [80.0, 40.0], "engine.harmonic_phases": [0.3, 1.0],
                  "pressure.frequency_ratio": 2.0 / 3.0},
    "clamped": {**PERIODIC, "pressure.amplitude": 4e5, "pressure.phase": 1.0},
    "pure stick": {"pressure.mean": 4e5, "friction.kinetic_coefficient": 0.2, "engine.frequency": 60.0},
    "stiff": {**PERIODIC, "friction.smoothing": 1e4},
    "very stiff": {**PERIODIC, "friction.smoothing": 1e6},
}
START = State(5.0, 0.1, -5.0, 0.1)


def problem(values, cycles=2, state=START, **options):
    return Problem(replace(System(), values), state, cycles=cycles, **options)


def reference(p, count, per_cycle):
    """SciPy's Radau on the equations written out once more, restarted at every engine cycle: (count * per_cycle + 1, 4)."""
    s = p.system
    e, pr, f, d = s.engine, s.pressure, s.friction, s.driveline
    i1, i2 = d.flywheel_inertia, d.plate_inertia
    ratio = f.static_coefficient / f.kinetic_coefficient

    def load(t):
        phase = pr.frequency_ratio * e.frequency * t + pr.phase
        return f.kinetic_coefficient * 0.08 * 0.1 * max(pr.mean + pr.amplitude * math.sin(phase), 0.0)

    def rates(t, y):
        v = y[0]
        te = e.mean_torque + e.torque_amplitude * math.sin(e.frequency * t)
        for n, (a, phase) in enumerate(zip(e.harmonic_amplitudes, e.harmonic_phases), 2):
            te += a * math.sin(n * e.frequency * t + phase)
        tf = (1.0 + (ratio - 1.0) * math.exp(-f.decay * abs(v))) * math.tanh(f.smoothing * v) * load(t)
        plate = (tf - d.damping * y[2] - d.stiffness * y[1]) / i2
        return [(te - tf) / i1 - plate, y[2], plate, v + y[2]]

    def jacobian(t, y):
        stribeck = (ratio - 1.0, f.decay) if ratio > 1.0 else None
        g = friction.smoothed_and_slope(y[0], f.smoothing, stribeck)[1] * load(t)
        return np.array([[-g / i1 - g / i2, d.stiffness / i2, d.damping / i2, 0.0], [0.0, 0.0, 1.0, 0.0],
                         [g / i2, -d.stiffness / i2, -d.damping / i2, 0.0], [1.0, 0.0, 1.0, 0.0]])

    y = np.array([p.state.slip_speed, p.state.plate_angle, p.state.plate_speed, p.state.flywheel_angle])
    rows = [y[:, None]]
    for n in range(count):
        t = (n + np.arange(per_cycle + 1) / per_cycle) * s.cycle
        found = solve_ivp(rates, (t[0], t[-1]), y, "Radau", t, rtol=1e-10, jac=jacobian,
                          atol=[1e-10 / max(1.0, f.smoothing / 50.0), 1e-12, 1e-10, 1e-11])
        y = found.y[:, -1]
        rows.append(found.y[:, 1:])
    return np.hstack(rows).T


@pytest.mark.parametrize("name", SCENES)
def test_agrees_with_scipy_radau(name):
    p = problem(SCENES[name], rtol=1e-10, samples_per_cycle=100, flywheel_angle=True)
    got = smoothed.solve(p)
    want = reference(p, 2, 100)
    assert got.status is Status.DONE
    states = np.column_stack([got.slip_speed, got.plate_angle, got.plate_speed, got.flywheel_angle])
    scale = np.abs(want).max(axis=0)
    assert np.all(np.abs(states - want) <= 2e-7 * scale)
    assert np.all(np.abs(got.cycles.section - want[::100, :3]) <= 2e-8 * scale[:3])
    dense = want[:, 0].reshape(-1)[:-1].reshape(2, 100)
    assert np.all(got.cycles.highest >= dense.max(axis=1) - 1e-6 * scale[0])
    assert np.all(got.cycles.lowest <= dense.min(axis=1) + 1e-6 * scale[0])
    share = np.mean(np.abs(dense) <= stick_speed_of(terms_of(p.system)), axis=1)
    assert np.all(np.abs(got.cycles.stick_time / got.cycle - share) <= 0.05)


def test_starts_at_any_cycle():
    p = problem({**FIG02, "pressure.frequency_ratio": 0.5}, cycles=3, rtol=1e-9)
    whole = smoothed.solve(p)
    first = smoothed.solve(changed(p, cycles=1))
    rest = smoothed.solve(changed(p, cycles=2, start_cycle=1, state=first.final))
    np.testing.assert_allclose(rest.cycles.section, whole.cycles.section[1:], rtol=1e-6, atol=1e-6)
