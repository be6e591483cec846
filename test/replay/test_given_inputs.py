"""A scene driven by data: by a table against the node's own plant, by a recording against the run that it holds."""

import csv
import math

import numpy as np
import pytest
from driveline_bags import TICK, bag, readings, ticked
from scipy.integrate import solve_ivp

from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.estimation.measurement import read_recording
from tcc_sim.model.friction import smoothed_coefficient
from tcc_sim.model.profile import Inputs
from tcc_sim.output.samples import write_trajectory
from tcc_sim.plant.driveline import Plant
from tcc_sim.replay.given_inputs import driven_by
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import terms_of, torques_at
from tcc_sim.tables.measured_table import HOLDS, table_in
from tcc_sim.trajectory import State, Status

STEPS = 120


def table(path, **columns):
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values()))
    return path


def commands():
    t = np.arange(STEPS) * 1e-3
    return t, 300.0 + 200.0 * np.sin(190.0 * t), 2e5 + 1e5 * np.cos(77.0 * t)


def test_a_table_gives_what_the_plant_gives_that_holds_its_values(tmp_path):
    t, torque, pressure = commands()
    path = table(tmp_path / "in.csv", t=[*t, STEPS * 1e-3], engine_torque=[*torque, 0.0],
                 actuation_pressure=[*pressure, 0.0])
    scene = load_scene("commands").with_values({"pacing": "lockstep"})
    plant = Plant(scene)
    plant.warm_up()
    for a, b in zip(torque, pressure):
        plant.hold(float(a), float(b))
        plant.stepper.advance()
    driven = driven_by(scene, path)
    assert driven.system.span == pytest.approx(STEPS * 1e-3)
    result = solve(driven, solver="fixed_step", duration=STEPS * 1e-3).final
    v, angle, speed, _ = plant.stepper.state
    # The plant takes as many sub-steps as each pressure needs; a shift by one tick would be 40 N m.
    assert (result.slip_speed, result.plate_angle) == pytest.approx((v, angle), rel=1e-3)
    exact = solve(driven, duration=STEPS * 1e-3, rtol=1e-9).final
    assert (exact.slip_speed, exact.plate_angle) == pytest.approx((v, angle), rel=1e-3)
    assert exact.plate_speed == pytest.approx(speed, abs=0.01)


def test_a_recording_gives_itself_again_and_another_clutch_something_else(tmp_path):
    scene = load_scene("fig02").with_values({"pressure.amplitude": 1e-3})  # Small, so that holding it is exact enough.
    run = solve(scene, cycles=6, samples_per_cycle=200, flywheel_angle=True)
    write_trajectory(tmp_path / "run.mcap", run, scene.text())
    again = solve(driven_by(scene, tmp_path / "run.mcap"), duration=float(run.t[-1]) * 0.999).final
    same = solve(scene, duration=float(run.t[-1]) * 0.999).final
    assert again.plate_angle == pytest.approx(same.plate_angle, rel=2e-3)
    other = scene.with_values({"friction.kinetic_coefficient": 0.2})
    assert solve(driven_by(other, tmp_path / "run.mcap"), duration=0.2).final.plate_angle != pytest.approx(
        solve(scene, duration=0.2).final.plate_angle, rel=1e-3)


def test_a_command_that_no_tick_tells_is_left_to_the_scene(tmp_path):
    """Only the initial state has a pressure; no tick applied it."""
    scene = load_scene("commands")
    rows = ticked(scene, 20, torque=lambda k: 250.0 + k, pressure=lambda k: 2e5)
    rows = [(*row, 2e5 if k == 0 else math.inf) for k, (*row, _) in enumerate(rows)]
    result = driven_by(scene, bag(tmp_path / "run", rows, scene)).system.inputs
    assert result.pressure is None
    assert result.torque[:, 1].tolist() == [250.0 + k for k in range(1, 20)]


def test_a_recording_with_fallbacks_drives_by_commands_and_by_the_scene_in_between(tmp_path):
    """Torque and pressure fall back to the scene's sines at different times; what acted is known at every instant."""
    scene = load_scene("commands")
    e, p = scene.system.engine, scene.system.pressure
    plant, rows, sources = Plant(scene), [], []
    held = {"engine_torque": lambda k: 300.0 + k % 7 if 100 <= k < 180 or k >= 260 else None,
            "actuation_pressure": lambda k: 2e5 + 1e3 * (k % 5) if 60 <= k < 230 else None}
    for k in range(400):
        given = [f(k) for f in held.values()]
        if k:
            plant.hold(*given)
            plant.advance()
        text = ", ".join(f"{name}: {'command' if k > 0 and value is not None else 'fallback'}"
                         for name, value in zip(held, given))
        if not sources or sources[-1][2] != text:
            sources.append((k, k * TICK, text))
        r = plant.reading()
        rows.append((r.stamp_ns, r.flywheel_angle, r.plate_angle, r.flywheel_speed, r.plate_speed, r.engine_torque,
                     r.friction_torque, r.applied_pressure))
    path = bag(tmp_path / "run", rows, scene, sources=sources)
    driven = driven_by(scene, path)
    tick = np.repeat(np.arange(1, 400), 7)
    t = (tick - 1 + np.tile((np.arange(7) + 0.5) / 7.0, 399)) * 1e-3
    sines = (e.mean_torque + e.torque_amplitude * np.sin(e.frequency * t),
             p.mean + p.amplitude * np.sin(p.frequency_ratio * e.frequency * t + p.phase))
    torques = torques_at(terms_of(driven.system), t)
    for f, sine, value in zip(held.values(), sines, (torques[0], torques[1] / driven.system.torque_per_pressure)):
        acted = [sine[i] if (x := f(k)) is None else x for i, k in enumerate(tick.tolist())]
        np.testing.assert_allclose(value, acted, atol=6e-3 * np.ptp(sine))
    for solver in ("fixed_step", "auto"):
        run = solve(driven, solver=solver, duration=0.399, samples_per_cycle=400)
        apart = np.interp([row[0] * 1e-9 for row in rows], run.t, run.slip_speed) - [row[3] - row[4] for row in rows]
        assert np.sqrt(np.mean(apart**2)) < 0.1
    measured, _ = read_recording(path)
    for name, line in zip(held, (driven.system.inputs.torque, driven.system.inputs.pressure)):
        assert measured.inputs[name][:-1, 0] == pytest.approx(line[:399, 1])


def test_what_analyse_writes_of_a_commanded_pressure_drives_as_the_recording_does(tmp_path, capsys):
    """A sine at 1 kHz; the table holds it from row to row, the recording through the tick that ends there."""
    scene = load_scene("commands")
    path = bag(tmp_path / "run", ticked(scene, 400, torque=lambda k: 300.0 + 200.0 * math.sin(0.15 * k),
                                        pressure=lambda k: 2e5 + 5e4 * math.cos(0.07 * k)), scene)
    assert main(["analyse", str(path), "--out", str(tmp_path / "run.csv")]) == 0
    inputs, recorded = (driven_by(scene, it).system.inputs for it in (tmp_path / "run.csv", path))
    assert inputs.pressure == pytest.approx(recorded.pressure, rel=1e-12)
    assert inputs.torque == pytest.approx(recorded.torque, rel=1e-12)
    lines = [line for line in (tmp_path / "run.csv").read_text().splitlines() if not line.startswith("#")]
    assert (lines[0].split(",")[-1], lines[1].split(",")[-1]) == ("actuation_pressure", "Pa")
    slip = [solve(driven_by(scene, it), solver="fixed_step", step=1e-3, duration=0.399).slip_speed
            for it in (tmp_path / "run.csv", path)]
    assert np.abs(slip[0] - slip[1]).max() < 1e-9


@pytest.mark.parametrize(("hold", "torque"), [(None, 250.0), ("previous", 250.0), ("linear", 275.0), ("next", 300.0)])
def test_a_table_holds_as_it_was_told(tmp_path, hold, torque):
    path = table(tmp_path / "in.csv", t=[0.0, 0.1, 0.2], engine_torque=[200.0, 250.0, 300.0])
    driven = driven_by(load_scene("commands"), path, hold)
    assert float(torques_at(terms_of(driven.system), np.array([0.15]))[0][0]) == pytest.approx(torque)
    path = table(tmp_path / "late.csv", t=[0.04, 0.1, 0.2], engine_torque=[200.0, 250.0, 300.0])
    driven = driven_by(load_scene("commands"), path, hold)
    torques = torques_at(terms_of(driven.system), np.array([0.02, 0.039, 0.15]))[0]
    assert torques == pytest.approx(np.array([200.0, 200.0, torque]))


def test_a_table_that_looks_smooth_is_hinted_at_and_one_of_steps_is_not(tmp_path, capsys):
    t = np.arange(0.0, 0.2, 1e-3)
    smooth = table(tmp_path / "smooth.csv", t=t, engine_torque=300.0 + 200.0 * np.sin(150.0 * t))
    stepped = table(tmp_path / "stepped.csv", t=t, engine_torque=300.0 + 50.0 * np.floor(t / 0.02))
    for path, words, hinted in ((smooth, [], True), (smooth, ["--hold", "previous"], False), (stepped, [], False)):
        assert main(["simulate", "commands", "--inputs", str(path), *words]) == 0
        assert ("--hold smooth joins the rows" in capsys.readouterr().out) is hinted
    assert main(["simulate", "commands", "--hold", "linear"]) == 2
    assert main(["simulate", "commands", "--hold", "linear", "--inputs", str(tmp_path)]) == 2
    capsys.readouterr()


PULSES = {"steps": lambda n: 4e5 * (n // 20 % 2), "touches 0": lambda n: 2e5 * (1.0 - np.cos(0.3 * n)),
          "pulses": lambda n: 4e5 * (n % 4 == 0), "limit": lambda n: 1e7 * (n % 3 > 0)}


@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("course", PULSES)
@pytest.mark.parametrize("actuator", [{}, {"pressure.time_constant": 0.02, "pressure.delay": 0.01}])
def test_pressure_stays_in_its_range_after_hold_and_actuator(tmp_path, course, hold, actuator):
    n = np.arange(100)
    path = table(tmp_path / "p.csv", t=0.01 * n, actuation_pressure=PULSES[course](n))
    system = driven_by(load_scene("controlled").with_values(actuator), path, hold).system
    result = torques_at(terms_of(system), np.linspace(0.0, 0.99, 3001))[1] / system.torque_per_pressure
    assert result.min() >= -1e-6
    assert result.max() <= 1e7 * (1.0 + 1e-12)


@pytest.mark.parametrize(("name", "most", "unit"), [("engine_torque", 1e5, "N m"), ("output_speed", 1e5, "rad/s")])
def test_torque_and_far_end_stay_in_their_range_after_a_smooth_hold(tmp_path, name, most, unit):
    n = np.arange(30)
    path = table(tmp_path / "t.csv", t=0.01 * n, **{name: most * np.where(n % 4 < 2, 1.0, -1.0)})
    inputs = driven_by(load_scene("commands"), path, "smooth").system.inputs
    line = inputs.torque if name == "engine_torque" else inputs.output_speed
    assert np.abs(line[:, 1]).max() == most


def test_a_pressure_below_0_is_no_input():
    for lines in ([[0.0, 1e5, 0.0], [0.1, -1.0, 0.0]], [[0.0, 1e5, -1e6]]):
        with pytest.raises(InputError, match=r"the pressure at the plates is .* Pa at 0.*; it .* 0 or more"):
            Inputs(None, np.array(lines), 0.2)


def test_an_actuator_follows_the_pressure_of_a_table_after_its_dead_time(tmp_path):
    (tmp_path / "in.csv").write_text("t,actuation_pressure\n0,100000\n0.1,150000\n0.3,90000\n0.5,90000\n")
    keys = {"pressure.time_constant": 0.03, "pressure.delay": 0.02}
    driven = driven_by(load_scene("controlled").with_values(keys), tmp_path / "in.csv").system
    assert driven.inputs.pressure[0, 0] == 0.0
    t = np.linspace(0.0, 0.499, 300)
    result = torques_at(terms_of(driven), t)[1] / driven.torque_per_pressure
    risen = 1.5e5 - 5e4 * np.exp(-(t - 0.12) / 0.03)
    top = 1.5e5 - 5e4 * np.exp(-0.2 / 0.03)
    expected = np.select([t < 0.12, t < 0.32], [1e5, risen], 9e4 + (top - 9e4) * np.exp(-(t - 0.32) / 0.03))
    np.testing.assert_allclose(result, expected, atol=1.0)


def shaft_torque(t, x, system, begin, before, rate):
    twist, twisting = x[1] - x[3], x[2] - before - rate * (t - begin)
    return system.driveline.damping * twisting + system.driveline.stiffness * twist


def change(t, x, system, begin, before, rate):
    """Rates of slip speed, plate angle, plate speed, angle of the far end (at a linear speed) and clutch energy."""
    torque, load = torques_at(terms_of(system), np.array(t))
    friction = load * smoothed_coefficient(x[0], system.friction.smoothing, system.friction.stribeck)
    speeding = (friction - shaft_torque(t, x, system, begin, before, rate)) / system.driveline.plate_inertia
    return [(torque - friction) / system.driveline.flywheel_inertia - speeding, x[2], speeding,
            before + rate * (t - begin), friction * x[0]]


@pytest.mark.parametrize("hold", ["previous", "linear", "next"])
def test_a_table_moves_the_far_end_as_scipy_does(tmp_path, hold):
    times = np.arange(0.0, 0.105, 0.01)
    speeds = 20.0 * (1.0 - np.cos(30.0 * times))
    path = table(tmp_path / "in.csv", **{"t [s]": times, "output_speed [rad/s]": speeds})
    system = load_scene("fig02").system
    run = solve(driven_by(load_scene("fig02"), path, hold), duration=0.1, samples_per_cycle=100, step=1e-5,
                loads_from=0)
    ends = {"previous": (speeds[:-1], speeds[:-1]), "linear": (speeds[:-1], speeds[1:]),
            "next": (speeds[1:], speeds[1:])}[hold]
    shafts, state = [], np.array([*State.at_start(system).numbers, 0.0, 0.0])
    for begin, before, after in zip(times, *ends):
        given = system, begin, before, (after - before) / 0.01
        part = solve_ivp(change, (begin, begin + 0.01), state, "Radau", rtol=1e-6, atol=1e-7, max_step=5e-4,
                         args=given)
        state = part.y[:, -1]
        shafts.append(shaft_torque(part.t, part.y, *given))
    final = run.final
    assert (final.slip_speed, final.plate_angle, final.plate_speed) == pytest.approx(state[:3], rel=1e-4)
    assert run.output_angle[-1] == pytest.approx(state[3], rel=1e-9)
    parts = [run.cycles.loads, run.rest.loads]
    assert sum(float(part.energy.sum()) for part in parts) == pytest.approx(state[4], rel=2e-4)
    assert max(float(part.highest_shaft_torque.max()) for part in parts) == pytest.approx(np.concatenate(shafts).max(),
                                                                                          rel=1e-3)


def test_a_far_end_in_a_table_is_solved_by_ticks_or_refused(tmp_path, refused):
    path = table(tmp_path / "in.csv", t=[0.0, 0.1, 0.2], output_speed=[0.0, 30.0, 10.0])
    line = refused("simulate", "fig02", "--inputs", path, "--solver", "smoothed")
    assert all(word in line for word in ("smoothed", "output_speed", "fixed_step"))
    for out in ("run.csv", "run.npz"):
        assert main(["simulate", "fig02", "--inputs", str(path), "--out", str(tmp_path / out)]) == 0
    lines = (tmp_path / "run.csv").read_text().splitlines()
    assert (lines[0].split(",")[-2:], lines[1].split(",")[-2:]) == (["output_angle", "output_speed"], ["rad", "rad/s"])
    with np.load(tmp_path / "run.npz") as arrays:
        assert arrays["output_angle"][-1] == pytest.approx(3.0)
        assert dict(zip(arrays.files, arrays["units"].tolist()))["output_angle"] == "rad"
    path.write_text("t,output_speed\ns,bar\n0,1\n1,1\n")
    line = refused("simulate", "fig02", "--inputs", path)
    assert all(word in line for word in ("output_speed", "bar", "rad/s"))
    path.write_text("t,output_speed\n0,1\n1,1e7\n")
    assert "output_speed is 1e+07 rad/s at 1 s" in refused("simulate", "fig02", "--inputs", path)


def test_a_far_end_of_a_recording_moves_again_and_is_in_its_samples(tmp_path, capsys):
    scene = load_scene("fig02")
    rows, ends = readings(scene, 300, lambda _: None, lambda k: 20.0 * math.sin(0.05 * k) if k > 100 else None)
    path = bag(tmp_path / "run", rows, scene, ends=ends)
    assert main(["analyse", str(path), "--discard", "0", "--out", str(tmp_path / "run.csv")]) == 0
    text = (tmp_path / "run.csv").read_text()
    assert "output_speed next" in text
    written = table_in(tmp_path / "run.csv").columns
    angles, speeds = ([0.0] * 101 + [end[k] for end in ends] for k in (1, 2))
    assert (written["output_angle"].tolist(), written["output_speed"].tolist()) == (angles, speeds)
    for source in (path, tmp_path / "run.csv"):
        run = solve(driven_by(scene, source), duration=0.299, step=1e-3)
        assert run.output_angle[-1] == pytest.approx(ends[-1][1], rel=1e-12)
        assert run.final.plate_angle == pytest.approx(rows[-1][2], rel=5e-3)


def test_what_needs_a_far_end_that_stands_still_refuses_one_that_moved(tmp_path, refused):
    scene = load_scene("fig02")
    rows, ends = readings(scene, 60, lambda _: None, lambda k: 0.1 * k)
    path = bag(tmp_path / "run", rows, scene, ends=ends)
    identify, moved = ("identify", "--free", "driveline.stiffness"), "the far end of the shaft moved"
    assert f"{moved} (output_speed up to 5.9 rad/s); identification" in refused(*identify, path)
    assert f"{moved}; --damping is for recordings in which it" in refused("analyse", path, "--damping")
    with_column = table(tmp_path / "in.csv", t=np.arange(60) * 1e-3, slip_speed=np.arange(60) % 7,
                        output_speed=[2.0] * 60)
    assert f"{moved} (output_speed up to 2 rad/s)" in refused(*identify, with_column, "--scene", "fig02")


def test_a_table_that_is_sampled_finely_is_solved_to_its_end(tmp_path):
    """The driveline sticks, where each sample costs several steps: more than the cycles alone would allow."""
    scene = load_scene("fig02").with_values({"initial.slip_speed": 0.0, "pressure.amplitude": 0.0,
                                             "engine.frequency": 10.0})
    ends = []
    for rate in (1e3, 1e4):
        t = np.linspace(0.0, 4.0, round(4.0 * rate) + 1)
        path = table(tmp_path / f"{rate:g}.csv", t=t, engine_torque=200.0 + 20.0 * np.sin(190.0 * t))
        result = solve(driven_by(scene, path, "smooth"), duration=4.0)
        ends.append((result.final.plate_angle, result.final.plate_speed))
        assert result.status is Status.DONE
    assert ends[1] == pytest.approx(ends[0], rel=1e-4)
