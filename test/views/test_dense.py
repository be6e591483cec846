"""Between samples a picture shows the motion itself, compared with SciPy at a tight tolerance and with arrays."""

from dataclasses import replace

import numpy as np
import pytest
from driveline_bags import bag, ticked
from scipy.integrate import solve_ivp

from tcc_sim.model import equations, friction
from tcc_sim.replay.replay import replay
from tcc_sim.scene import load_scene
from tcc_sim.solvers.terms import terms_of
from tcc_sim.views.dense import SAMPLES, between


def truth(system, t0, state, at):
    """The smoothed model by SciPy's Radau, from (v, theta2, omega2) at t0."""
    terms = terms_of(system)

    def rates(t, y):
        engine = equations.engine_torque(t, terms.mean_torque, terms.torque, terms.harmonics)
        load = equations.saturation_torque(t, terms.mean_load, terms.pulsation)
        torque = load * friction.smoothed_coefficient(y[0], terms.smoothing, terms.stribeck)
        slip, plate = equations.accelerations(y[0], y[1], y[2], engine, torque, terms.linear)
        return [slip, y[2], plate]

    solution = solve_ivp(rates, (t0, at[-1]), state, method="Radau", t_eval=at, rtol=1e-10, atol=1e-10)
    assert solution.success
    return solution.y


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Three seconds of fig02 at 1 kHz, as the driveline ticks: 42 samples per engine cycle."""
    return replay(bag(tmp_path_factory.mktemp("dense") / "run", ticked(load_scene("fig02"), 3000), "fig02"))


def test_between_ticks_the_recorded_motion_is_a_curve(recorded):
    tail = recorded.trajectory
    dense = between(tail)
    per_cycle = np.count_nonzero(dense.t > dense.t[-1] - dense.cycle)
    assert per_cycle >= SAMPLES
    # The recorded samples are among the dense ones, as they were.
    place = np.searchsorted(dense.t, tail.t - 1e-9)
    np.testing.assert_allclose(dense.t[place], tail.t, atol=1e-12)
    np.testing.assert_array_equal(dense.plate_angle[place], tail.plate_angle)
    np.testing.assert_array_equal(dense.slip_speed[place], tail.slip_speed)
    # A polygon of 42 samples misses a slip peak by far more than what SciPy finds between two samples.
    begin = int(np.argmax(tail.slip_speed[-50:])) + len(tail.t) - 50
    inside = (dense.t >= tail.t[begin - 2]) & (dense.t <= tail.t[begin + 1])
    state = [tail.slip_speed[begin - 2], tail.plate_angle[begin - 2], tail.plate_speed[begin - 2]]
    exact = truth(tail.system, tail.t[begin - 2], state, dense.t[inside])
    size = np.abs(tail.slip_speed).max()
    assert np.abs(exact[0] - dense.slip_speed[inside]).max() < 1e-4 * size
    assert np.abs(exact[1] - dense.plate_angle[inside]).max() < 1e-5


def test_changed_parameters_and_gaps_are_not_drawn_as_if_solved(recorded):
    tail = recorded.trajectory
    other = replace(tail, system=load_scene("slip").system)  # ticks of another scene lead elsewhere: interpolated
    dense = between(other)
    assert np.isfinite(dense.slip_speed).all()
    assert dense.slip_speed.max() < 1.02 * tail.slip_speed.max()
    assert dense.slip_speed.min() > tail.slip_speed.min() - 0.02 * tail.slip_speed.max()
    keep = np.r_[0:100, 140:len(tail.t)]
    names = ("t", "slip_speed", "plate_angle", "plate_speed", "engine_torque", "saturation_torque", "friction_torque",
             "state")
    holed = between(replace(tail, **{name: getattr(tail, name)[keep] for name in names}))
    hole = (holed.t > tail.t[99] + 1e-9) & (holed.t < tail.t[140] - 1e-9)
    assert hole.any()
    assert np.isnan(holed.slip_speed[hole]).all()
    assert np.isfinite(holed.slip_speed[~hole]).all()
