"""Between samples a picture shows the motion itself, compared with SciPy at a tight tolerance and with arrays."""

import math
from dataclasses import replace

import numpy as np
import pytest
from driveline_bags import bag, ticked
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

import tcc_sim
from tcc_sim.model import equations, friction
from tcc_sim.replay.replay import replay
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import terms_of
from tcc_sim.trajectory import Trajectory
from tcc_sim.views import dense as dense_
from tcc_sim.views.dense import SAMPLES, between, last_cycles


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


def test_the_friction_torque_between_ticks_has_no_spikes_in_stick(recorded):
    dense = between(recorded.trajectory)
    stuck = dense.state == 0
    inner = stuck & np.roll(stuck, 1) & np.roll(stuck, -1)
    jumps = np.abs(np.diff(dense.friction_torque))[inner[1:] & inner[:-1]]
    assert len(jumps) > 1000
    assert jumps.max() < 2.0  # N m between neighbours; what the ticks themselves hold jumps by more than 100
    trajectory = recorded.trajectory
    both = (trajectory.state[1:] == 0) & (trajectory.state[:-1] == 0)
    assert np.abs(np.diff(trajectory.friction_torque))[both].max() > 30.0
    most = trajectory.system.friction_ratio * dense.saturation_torque
    assert (np.abs(dense.friction_torque) <= most * (1.0 + 1e-9)).all()


def test_commands_are_held_over_a_tick(tmp_path):
    scene = load_scene("commands")
    rows = ticked(scene, 1200, torque=lambda k: 300.0 + 200.0 * math.sin(0.15 * k),
                  pressure=lambda k: 2e5 + 100.0 * (k % 7))
    tail = replay(bag(tmp_path / "run", rows, scene), frequency=150.0).trajectory
    dense = between(tail)
    k = len(tail.t) - 20
    inside = (dense.t > tail.t[k] + 1e-9) & (dense.t <= tail.t[k + 1] + 1e-9)
    assert inside.sum() > 10
    assert set(dense.engine_torque[inside]) == {tail.engine_torque[k + 1]}
    assert set(dense.saturation_torque[inside]) == {tail.saturation_torque[k + 1]}


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


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
def test_the_last_cycles_of_a_solve_again_with_samples(law):
    system = load_scene("fig02").with_values({"friction.law": law}).system
    run = solve(system, cycles=40)
    dense = last_cycles(run, 3)
    assert dense.t[0] == pytest.approx(37 * system.cycle)
    assert dense.t[-1] == pytest.approx(run.t[-1])
    assert len(dense.t) == 3 * SAMPLES + 1
    rounded = replace(dense, t=dense.t * (1.0 + 1e-11))
    assert between(rounded) is rounded
    assert dense.slip_speed.max() == pytest.approx(run.cycles.highest[-3:].max(), rel=1e-5)
    assert dense.final.plate_angle == pytest.approx(run.final.plate_angle, abs=1e-6)
    whole = solve(system, duration=0.5 * system.cycle, samples_per_cycle=100)
    assert last_cycles(whole, 3) is whole


def test_a_scene_whose_frequency_varies_is_drawn_with_its_own_torque(tmp_path):
    scene = load_scene("chaos").with_values({"engine.frequency_times": [0.0, 1.0],
                                               "engine.frequency_values": [80.0, 160.0]})
    result = between(replay(bag(tmp_path / "run", ticked(scene, 900), scene)).trajectory)
    e = scene.system.engine
    exact = e.mean_torque + e.torque_amplitude * np.sin(80.0 * result.t + 40.0 * result.t**2)
    assert np.abs(result.engine_torque - exact).max() < 1e-6 * e.torque_amplitude


def test_where_the_torque_is_not_the_scenes_it_is_that_of_the_samples(recorded):
    tail = recorded.trajectory
    result = between(replace(tail, engine_torque=tail.engine_torque + 100.0))
    place = np.searchsorted(result.t, tail.t - 1e-9)
    np.testing.assert_allclose(result.engine_torque[place], tail.engine_torque + 100.0, rtol=1e-12)


def test_what_is_dense_or_has_no_law_to_solve_stays_on_its_points(recorded):
    tail = recorded.trajectory
    few = {name: getattr(tail, name)[:3] for name in ("t", "slip_speed", "plate_angle", "plate_speed", "engine_torque",
                                                      "saturation_torque", "friction_torque", "state")}
    assert between(replace(tail, system=None)).t is tail.t
    short = replace(tail, **{name: values[:2] for name, values in few.items()})
    assert between(short) is short
    three = replace(tail, **few)
    for samples, points in ((41, 1), (42, 2), (83, 2), (84, 3)):  # There are 41.89 ticks in an engine cycle.
        assert len(between(three, samples).t) == 2 * points + 1
    exact = between(replace(three, system=load_scene("fig02").with_values({"friction.law": "set_valued"}).system), 80)
    assert exact.friction_torque == pytest.approx(np.interp(exact.t, three.t, three.friction_torque))


def test_cubics_have_the_accelerations_of_the_torques_and_stay_between_samples_in_stick():
    """Slopes of Fritsch and Carlson beside and in stick: at most three times the smaller chord, 0 at an extreme."""
    t, v = 0.1 * np.arange(9), np.array([9.0, 6.0, 1.0, 0.5, 0.0, 0.0, -2.0, 3.0, 4.0])
    state = np.array([1, 1, 1, 0, 0, 0, -1, 1, 1], np.int8)
    angle, speed, friction_torque = 1e-3 * np.sin(t), np.cos(3.0 * t), 2.0 * t
    plate = (friction_torque - 0.6 * speed - 3000.0 * angle) / 0.02
    slip = np.array([-5.0, -100.0, -100.0, -8.0, 50.0, -50.0, 7.0, 3.0, 2.0])
    run = Trajectory(t, v, angle, speed, 0.2 * (slip + plate) + friction_torque, 0.0 * t, friction_torque, state, 0.04,
                     "by_hand", load_scene("fig02").system)
    slopes, chords = slip.copy(), np.diff(v) / 0.1
    for k in range(2, 7):  # Those of samples 0, 1, 7 and 8 are away from stick.
        before, after = chords[k - 1], chords[k]
        bound = 3.0 * min(abs(before), abs(after)) if before * after > 0.0 else 0.0
        slopes[k] = min(max(slip[k], -bound), bound)
    assert slopes[2:7].tolist() == pytest.approx([-15.0, -8.0, 0.0, 0.0, 0.0])
    at = np.linspace(0.0, 0.8, 161)
    found = dense_._interpolated(run, terms_of(run.system), at)
    for column, values, rates in ((0, v, slopes), (1, angle, speed), (2, speed, plate)):
        assert found[:, column] == pytest.approx(CubicHermiteSpline(t, values, rates)(at), abs=1e-9)


@pytest.mark.parametrize("sources", [{}, {"engine.source": "topic"}, {"pressure.source": "topic"},
                                     {"engine.source": "topic", "pressure.source": "topic"}])
def test_a_tick_is_solved_with_what_it_applied(sources):
    """Commands that change from tick to tick: a tick that is solved with another one misses the next state."""
    scene = load_scene("fig02").with_values(sources)
    draw = np.random.default_rng(3)

    def law(reading):
        return (float(draw.uniform(200.0, 400.0)) if "engine.source" in sources else None,
                float(draw.uniform(1e5, 3e5)) if "pressure.source" in sources else None)

    run = tcc_sim.closed_loop(scene, law, 0.1)
    known = np.stack([run.slip_speed, run.plate_angle, run.plate_speed], axis=1)
    states = dense_._solved(run, run.system, known, 4, np.ones(len(run.t) - 1, bool))
    size = np.abs(known).max(axis=0)
    np.testing.assert_allclose(states[:, -1] / size, known[1:] / size, atol=2e-4)
    for name, lost in (("engine", math.nan), ("pressure", 1e15)):  # Unknown, or too stiff to solve: that tick alone.
        if f"{name}.source" in sources:
            column = "engine_torque" if name == "engine" else "saturation_torque"
            values = getattr(run, column).copy()
            values[20] = lost
            whole = np.ones(len(run.t) - 1, bool)
            holed = dense_._solved(replace(run, **{column: values}), run.system, known, 4, whole)
            assert np.flatnonzero(np.isnan(holed).any(axis=(1, 2))).tolist() == [19]
    share = np.array([0.5, 1.0])
    torque, load = dense_._excitation(run, run.system, run.t[:-1, None] + 1e-3 * share, share)
    sine = scene.system.engine.mean_torque + 250.0 * np.sin(150.0 * (run.t[:-1] + 0.5e-3))
    np.testing.assert_allclose(torque[:, 0], run.engine_torque[1:] if "engine.source" in sources else sine)
    if "pressure.source" in sources:
        np.testing.assert_array_equal(load[:, 0], run.saturation_torque[1:])
