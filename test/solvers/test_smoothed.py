"""The smoothed engine where it is stiff, steep or slow: against SciPy, closed forms, and its law's limit."""

import math
from dataclasses import astuple
from dataclasses import replace as changed

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from independent import equations, smoothed_states
from scipy.integrate import solve_ivp

from tcc_sim.model.parameters import DEFAULTS, QUANTITIES, System, replace
from tcc_sim.solvers import SOLVERS, Problem, solve
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.trajectory import State, Status

FIG02 = {"pressure.mean": 260417.0, "pressure.amplitude": 52083.4, "friction.kinetic_coefficient": 0.24}
PERIODIC = {**FIG02, "friction.kinetic_coefficient": 0.3, "pressure.amplitude": 0.0}
SCENES = {
    "no stribeck": PERIODIC,
    "fig02": FIG02,
    "harmonics": {**FIG02, "engine.harmonic_amplitudes": [80.0, 40.0], "engine.harmonic_phases": [0.3, 1.0],
                  "pressure.frequency_ratio": 2.0 / 3.0},
}
START = State(5.0, 0.1, -5.0, 0.1)


def problem(values, cycles=2, state=START, **options):
    return Problem(replace(System(), values), state, cycles=cycles, **options)


def solved(p):
    return SOLVERS["smoothed"].load()(p)


def reference(p, count, per_cycle, **settings):
    """(count * per_cycle + 1, 4), from SciPy."""
    return smoothed_states(p.system, astuple(p.state), count, per_cycle, **settings)


@pytest.mark.parametrize("name", ["no stribeck", "fig02"])
def test_friction_samples_are_as_good_as_the_slip_speed_lets_them_be(name):
    """Also within microseconds of the projection onto the slow manifold, which leaves out a decaying part of v."""
    p = problem(SCENES[name], cycles=4, state=State(150.0, 0.0, 0.0), samples_per_cycle=20000)
    coarse, fine = solved(p), solved(changed(p, rtol=1e-11))
    stuck = np.abs(fine.slip_speed) < 0.8 * stick_speed_of(terms_of(p.system))
    error = np.abs(coarse.friction_torque - fine.friction_torque) / np.abs(fine.friction_torque).max()
    assert np.quantile(error[stuck], 0.99) <= 3e-8
    assert error[stuck].max() <= 3e-7


@settings(max_examples=40, deadline=None, derandomize=True)
@given(kinetic=st.floats(0.075, 0.299), sigma=st.floats(1.0, 12.0), mean=st.sampled_from([0.0, 1e3, 2e5, 1e6, 1e7]),
       ratio=st.floats(0.01, 2.0), frequency=st.floats(1.0, 5000.0), damping=st.sampled_from([0.0, 0.6, 10.0]),
       plate=st.floats(-6.0, 0.0), flywheel=st.floats(-3.0, 3.0), slip=st.sampled_from([0.0, 1e-3, 150.0, -150.0, 1e4]),
       torque=st.sampled_from([0.0, 300.0, -300.0]), decay=st.sampled_from([0.0, 2.0, 50.0]))
def test_extremes_stay_finite_and_bounded(kinetic, sigma, mean, ratio, frequency, damping, plate, flywheel, slip,
                                          torque, decay):
    """A run that needs more steps than its scene is allowed ends with a status and a finite state."""
    p = problem({
        "friction.kinetic_coefficient": kinetic, "friction.smoothing": 10.0**sigma, "friction.decay": decay,
        "pressure.mean": mean, "pressure.amplitude": min(max(mean, 1.0) * ratio, 1e7), "engine.frequency": frequency,
        "engine.mean_torque": torque, "driveline.damping": damping, "driveline.plate_inertia": 10.0**plate,
        "driveline.flywheel_inertia": 10.0**flywheel}, cycles=1, state=State(slip, 0.0, 0.0))
    run = solved(p)
    assert run.status in (Status.DONE, Status.STEP_LIMIT)
    assert np.isfinite(run.slip_speed).all()
    assert np.isfinite(run.plate_speed).all()
    assert np.all(run.cycles.stick_time <= run.cycle * (1.0 + 1e-12))


def test_stiff_steps_in_slip_go_on_where_friction_falls():
    """A stiff step leaves the slope of its friction behind, which in slip is below zero: the next one is tried all the
    same, not refused without end.
    """
    p = problem({"friction.kinetic_coefficient": 0.12, "friction.smoothing": 132.0, "pressure.mean": 1e3,
                 "pressure.amplitude": 138.0, "engine.frequency": 15.7, "driveline.plate_inertia": 0.0135,
                 "driveline.flywheel_inertia": 7.86}, cycles=1, state=State(0.0, 0.0, 0.0))
    run = solved(p)
    assert run.status is Status.DONE
    np.testing.assert_allclose(run.cycles.section[-1], reference(p, 1, 1)[-1, :3], rtol=1e-6)


def fast_slip(system, start, t):
    """(n, 3) states of slip so fast that friction is Ts(t): (2b) is linear, and (2a) a quadrature."""
    i1, i2, c, k = (getattr(system.driveline, name) for name in ("flywheel_inertia", "plate_inertia", "damping",
                                                                 "stiffness"))
    pressure, clutch = system.pressure, system.clutch
    scale = system.friction.kinetic_coefficient * clutch.area * clutch.radius
    w = pressure.frequency_ratio * system.engine.frequency
    mean, swing = scale * pressure.mean, scale * pressure.amplitude * np.exp(1j * pressure.phase)
    answer = swing / (k - i2 * w**2 + 1j * c * w)

    def forced(t):
        turn = np.exp(1j * w * t)
        return mean / k + (answer * turn).imag, (1j * w * answer * turn).imag

    fast = -(c + np.sqrt(c * c - 4.0 * i2 * k)) / (2.0 * i2)
    slow, (angle, speed) = k / (i2 * fast), forced(0.0)
    first = (start.plate_speed - speed - slow * (start.plate_angle - angle)) / (fast - slow)
    parts = [(first, fast), (start.plate_angle - angle - first, slow)]
    angles = forced(t)[0] + sum(a * np.exp(s * t) for a, s in parts)
    speeds = forced(t)[1] + sum(a * s * np.exp(s * t) for a, s in parts)
    worked = (system.engine.mean_torque - mean) * t - (swing * (np.exp(1j * w * t) - 1.0) / (1j * w)).imag
    return np.stack([start.slip_speed + worked / i1 - (speeds - start.plate_speed), angles, speeds], axis=1)


@pytest.mark.parametrize("rtol", [1e-4, 1e-8, 1e-12])
def test_a_light_overdamped_plate_is_stepped_over_in_slip(rtol):
    """C23/I2 = 1e9 1/s limits the series to 1e-8 s, far below the shortest step that an engine cycle suggests; at a
    tight tolerance the errors of its steps are rounding.
    """
    p = problem({"friction.kinetic_coefficient": 0.15, "driveline.damping": 1e3, "driveline.stiffness": 1.0,
                 "driveline.plate_inertia": 1e-6, "engine.torque_amplitude": 0.0, "pressure.mean": 52083.3,
                 "pressure.amplitude": 1e4}, state=State(1e4, 0.0, 0.0, 0.0))
    run = solved(changed(p, rtol=rtol))
    assert run.status is Status.DONE
    # Rounding of a rate of 1e9 1/s stalls SciPy's methods on some processors.
    expected = fast_slip(p.system, p.state, p.system.cycle * np.arange(3.0))
    assert np.all(np.abs(run.cycles.section - expected) <= 1e-6 * np.abs(expected).max(axis=0))


def anywhere(draw):
    """Scene keys log-uniform over their allowed ranges, some of them 0; a friction law that is allowed."""
    def number(low, high, above):
        size = math.exp(draw.uniform(math.log(low if low > 0.0 else 1e-8 * high), math.log(high)))
        sign = -1.0 if low < 0.0 and draw.random() < 0.5 else 1.0
        return 0.0 if low <= 0.0 and not above and draw.random() < 0.15 else sign * size

    # Only commands pass an actuator, and the order changes no motion.
    further = ("pressure.time_constant", "pressure.delay", "pressure.rate_limit", "engine.order")
    keys = {key: number(q.low, q.high, q.above) for key, q in QUANTITIES.items()
            if isinstance(DEFAULTS[key], float) and math.isfinite(q.high) and key not in further}
    share = math.exp(draw.uniform(math.log(0.0501), 0.0))
    keys["friction.decay"] *= keys["pressure.amplitude"] > 0.0  # With neither a pulsation nor a falling law, or both.
    least = QUANTITIES["friction.kinetic_coefficient"].low
    return {**keys, "friction.kinetic_coefficient": max(least, share * keys["friction.static_coefficient"])}


@pytest.mark.parametrize("seed", range(2))
def test_no_scene_is_crawled_through(seed):
    """Three engine cycles, or 300 natural periods, of any scene that is allowed end within its steps."""
    draw = np.random.default_rng(seed)
    for _ in range(25):
        drawn = anywhere(draw)
        # A coupling at a light flywheel decays fast, and one of these sticks 640 times with it.
        for keys in (drawn, {**drawn, "converter.coupling": 0.0}):
            system = replace(System(), keys)
            initial = system.initial
            run = solved(Problem(system, State(initial.slip_speed, initial.plate_angle, initial.plate_speed),
                                         duration=min(3.0 * system.cycle, 2000.0 / system.natural_frequency)))
            assert run.status is Status.DONE, keys


def test_the_sharpest_smoothing_is_the_set_valued_law_anywhere():
    """Against the closed forms and series between located events; where a motion is unstable the two may part."""
    draw, apart = np.random.default_rng(2), 0
    for _ in range(15):
        keys = {**anywhere(draw), "friction.smoothing": 1e11}
        keys["converter.coupling"] *= keys["friction.decay"] > 0.0  # Without a falling law each pair takes two kernels.
        system = replace(System(), keys)
        span = {"duration": min(3.0 * system.cycle, 300.0 / system.natural_frequency)}
        result = solve(system, solver="smoothed", rtol=1e-6, **span).slip_speed
        exact = solve(replace(system, {"friction.law": "set_valued"}), solver="event_driven", **span).slip_speed
        apart += abs(result[-1] - exact[-1]) > 1e-5 * max(np.abs(exact).max(), 1e-6)
    assert apart <= 1


def test_slip_that_dies_down_fast_feels_the_whole_exponential():
    """From v = 8 to 0 in one or two steps exp(-alpha |v|) grows by exp(16): its series must not be cut before it
    converges.
    """
    p = problem({"friction.kinetic_coefficient": 0.15, "pressure.amplitude": 234375.0}, state=State(5.0, 0.0, 0.0, 0.0))
    expected = reference(p, 2, 1)
    run = solved(p)
    states = np.stack([run.cycles.section[:, i] for i in range(3)], axis=1)
    assert np.all(np.abs(states - expected[:, :3]) < 1e-6 * np.array([80.0, 0.3, 70.0]))


@pytest.mark.parametrize("frequency", [1e-3, 1e-2])
def test_a_motion_in_stick_follows_the_slowest_engine(frequency):
    system = replace(System(), {**FIG02, "engine.frequency": frequency})
    result = solved(Problem(system, State(0.0, 0.0, 0.0), cycles=2)).raise_for_status()
    e, d = system.engine, system.driveline
    # K23 theta2 + C23 theta2' = Te, nearly: v creeps.
    lag = e.torque_amplitude * frequency * d.damping / d.stiffness**2
    assert result.cycles.section[1:, 1] == pytest.approx(e.mean_torque / d.stiffness - lag, abs=0.05 * lag)


SOFT = replace(System(), {"pressure.mean": 225e3, "pressure.amplitude": 45e3, "pressure.frequency_ratio": 0.5,
                          "friction.kinetic_coefficient": 0.24, "engine.frequency": 142.0, "friction.smoothing": 4.0})
"""Stick and slip in turn; the smoothing is one that an explicit method affords."""


def test_the_error_follows_the_tolerance():
    """Down to 1e-13, against DOP853 near the end of double precision."""
    rates, _ = equations(SOFT)
    truth = solve_ivp(rates, (0.0, SOFT.cycle), [5.0, 0.1, -5.0, 0.0], "DOP853", rtol=3e-14, atol=1e-15).y[:3, -1]
    for digits in range(3, 14, 2):
        result = solve(SOFT, cycles=1, solver="smoothed", rtol=10.0**-digits, state=START).raise_for_status()
        assert len(result.transitions.time) >= 3
        error = np.abs((result.cycles.section[-1] - truth) / np.array([10.0, 0.3, 20.0])).max()
        assert error <= 0.1 * 10.0**-digits + 5e-14, digits
