"""A law in the loop without ROS: the solver's own ticks with the law's answers, and refused answers."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import tcc_sim
from tcc_sim.errors import InputError
from tcc_sim.plant.driveline import Reading, check_command, doubt_of
from tcc_sim.solvers.fixed_step import Stepper


class Scripted:
    """A law that answers from a list and records its readings."""

    def __init__(self, answers: list[object]) -> None:
        self.answers, self.readings = answers, []

    def __call__(self, reading: Reading) -> object:
        self.readings.append(reading)
        return self.answers[len(self.readings) - 1]


def test_every_tick_is_the_solvers_with_what_the_law_answered() -> None:
    draw = np.random.default_rng(3)
    answers = [(float(draw.uniform(-500.0, 500.0)), float(draw.uniform(0.0, 4e5))) for _ in range(200)]
    scene = tcc_sim.load_scene("commands").with_values({"engine.fallback": "mean", "pressure.fallback": "mean"})
    law = Scripted(answers)
    run = tcc_sim.closed_loop(scene, law, 0.4, rate=500.0)
    system = scene.system
    stepper, states, torques = Stepper(system, 2e-3), [], []
    for torque, pressure in answers:
        states.append(stepper.state.copy())
        stepper.use(stepper.terms._replace(mean_torque=torque, mean_load=system.torque_per_pressure * pressure))
        stepper.advance()
        torques.append(stepper.now()[4:6])
    states = np.array([*states, stepper.state])
    for column, name in enumerate(("slip_speed", "plate_angle", "plate_speed", "flywheel_angle")):
        np.testing.assert_array_equal(getattr(run, name), states[:, column])
    np.testing.assert_array_equal(run.engine_torque[1:], [torque for torque, _ in torques])
    np.testing.assert_array_equal(run.friction_torque[1:], [friction for _, friction in torques])
    np.testing.assert_array_equal(run.applied_pressure[1:], [pressure for _, pressure in answers])
    np.testing.assert_allclose(run.saturation_torque, 0.24 * 0.08 * 0.1 * run.applied_pressure, rtol=1e-15)
    np.testing.assert_allclose(run.t, np.arange(201) * 2e-3, atol=1e-12)
    # The law saw every state before it answered; the last state led to no further tick.
    assert [reading.slip_speed for reading in law.readings] == run.slip_speed[:-1].tolist()
    np.testing.assert_array_equal(np.transpose(list(run.commands.values()))[1:], answers)
    assert all(math.isnan(column[0]) for column in run.commands.values())
    assert (run.refused, run.refusal, len(run.columns()["t"])) == (0, "", 201)


def test_none_is_what_the_scene_says_where_nobody_commands_it() -> None:
    answers = [None, (None, None), (50.0, None), 1e5, (None, 2e5)] * 4
    run = tcc_sim.closed_loop("commands", Scripted(answers), 0.02)
    t, commanded = run.t[1:], [(None, None), (None, None), (50.0, None), (None, 1e5), (None, 2e5)] * 4
    swing = np.sin(50.0 * math.pi * t)
    torque = [300.0 + 250.0 * at if given is None else given for at, (given, _) in zip(swing, commanded)]
    pressure = [225e3 + 45e3 * at if given is None else given for at, (_, given) in zip(swing, commanded)]
    np.testing.assert_allclose(run.engine_torque[1:], torque, rtol=1e-12)
    np.testing.assert_allclose(run.applied_pressure[1:], pressure, rtol=1e-12)
    np.testing.assert_allclose(run.saturation_torque[1:], 0.24 * 0.008 * np.array(pressure), rtol=1e-12)
    held = np.array([[math.nan if given is None else given for given in pair] for pair in commanded])
    np.testing.assert_array_equal(np.transpose(list(run.commands.values()))[1:], held)


def test_a_command_is_held_beside_harmonics_delays_and_a_jump_of_frequency_and_counts_as_applied() -> None:
    scene = tcc_sim.load_scene("commands").with_values({"engine.harmonic_amplitudes": [40.0, 20.0],
                                                        "engine.harmonic_phases": [0.1, 0.2]})
    run = tcc_sim.closed_loop(scene, lambda _: (77.0, 2e5), 0.5, at={0.2: {"engine.frequency": 90.0}})
    assert (set(run.engine_torque[1:]), set(run.applied_pressure[1:])) == ({77.0}, {2e5})
    judged = run.tracking_of(20.0)
    assert (judged.commands_applied, judged.commands_superseded) == (500, 0)
    assert judged.command_rate == pytest.approx(1000.0)
    short = tcc_sim.closed_loop(scene, lambda _: pytest.fail("asked"), 0.0)
    assert (short.t.tolist(), short.received.tolist()) == ([0.0], [0])


def test_what_the_node_refuses_is_refused_counted_and_said_and_the_value_before_it_holds() -> None:
    scene = tcc_sim.load_scene("commands").with_values({"engine.fallback": "mean", "pressure.fallback": "mean"})
    answers = [(100.0, 1e5), (math.nan, 2e5), (2e5, math.inf), (150.0, -1.0), (160.0, 1e7), (None, 3e5)]
    law = Scripted(answers)
    with pytest.warns(UserWarning, match=r"actuation_pressure command of 1e\+07 Pa refused: a step of 0.1 s needs .* "
                                         r"sub-steps; fixed_step allows at most 20000 \(5 refused\)"):
        run = tcc_sim.closed_loop(scene, law, 0.6, rate=10.0)
    assert run.engine_torque.tolist() == [300.0, 100.0, 100.0, 100.0, 150.0, 160.0, 300.0]
    assert run.applied_pressure.tolist() == [225e3, 1e5, 2e5, 2e5, 2e5, 2e5, 3e5]
    assert run.refused == 5
    assert repr(run).endswith("5 commands refused>")
    with pytest.raises(InputError, match=r"engine_torque command of 100000\.01 N m refused"):
        check_command("engine_torque", 100000.01)
    with pytest.warns(UserWarning, match=r"engine_torque command of nan N m refused; it .* -100000 to 100000 N m"):
        tcc_sim.closed_loop(scene, lambda _: (math.nan, None), 0.1, rate=10.0)


def never(_: Reading) -> None:
    pytest.fail("the law was asked")


@pytest.mark.parametrize(("scene", "law", "options", "parts"), [
    ("controlled", lambda _: "much", {}, ["actuation_pressure", "'much'"]),
    ("controlled", lambda _: 10**400, {}, ["actuation_pressure", "000"]),
    ("controlled", lambda _: (1.0, 2.0, 3.0, 4.0), {}, ["(torque, pressure)"]),
    ("controlled", lambda _: (5.0, 1e5), {}, ["engine_torque", "5.0", "engine.source=topic"]),
    ("fig02", lambda _: 1e5, {}, ["actuation_pressure", "100000.0", "pressure.source=topic"]),
    ("controlled", never, {"seconds": -1.0}, ["seconds", "-1", "0 to 100000 s"]),
    ("controlled", never, {"seconds": math.nan}, ["seconds", "nan"]), ("controlled", never, {"seconds": 1e9}, ["1e"]),
    ("controlled", never, {"rate": 0.5}, ["rate", "0.5", "1 to 20000 Hz"]),
    ("controlled", never, {"at": {0.0005: {"engine.mean_torque": 1.0}}}, ["0.0005 s", "ticks"]),
    ("controlled", never, {"at": {0.1: {"engine.mean_torqe": 1.0}}}, ["engine.mean_torqe", "engine.mean_torque"]),
    ("controlled", never, {"at": {0.1: {"driveline.stiffness": 1.0}}}, ["driveline.stiffness"])])
def test_what_makes_no_sense_ends_the_run_with_a_line(scene: str, law: Callable[[Reading], object],
                                                      options: dict[str, Any], parts: list[str]) -> None:
    with pytest.raises(InputError) as refused:
        tcc_sim.closed_loop(scene, law, **{"seconds": 0.3, **options})  # type: ignore[arg-type]
    assert [part for part in parts if part not in str(refused.value)] == []


def test_keys_change_at_the_tick_that_begins_at_their_time() -> None:
    run = tcc_sim.closed_loop("controlled", lambda _: 1e5, 0.3, at={0.1: {"engine.mean_torque": 260.0},
                                                                    0.2: {"engine.torque_amplitude": 0.0}})
    pulse = 250.0 * np.sin(150.0 * run.t)
    np.testing.assert_allclose(run.engine_torque[:101] - pulse[:101], 200.0, atol=1e-9)
    np.testing.assert_allclose(run.engine_torque[101:201] - pulse[101:201], 260.0, atol=1e-9)
    np.testing.assert_allclose(run.engine_torque[201:], 260.0, atol=1e-9)


@pytest.mark.parametrize("changes", [{}, {0.1: {"engine.frequency": 300.0}}], ids=["one frequency", "changed"])
def test_a_run_has_the_means_of_its_slip_over_whole_cycles(changes: dict[float, dict[str, float]]) -> None:
    run = tcc_sim.closed_loop("controlled", lambda _: 1e5, 0.3, at=changes)
    cycle, after = 2.0 * math.pi / 150.0, 2.0 * math.pi / 300.0
    starts = cycle * np.arange(8)
    if changes:   # The phase goes on from that at 0.1 s.
        starts = np.append(starts[:3], 0.1 + after * (np.arange(3.0, 12.0) - 0.1 / cycle))
    np.testing.assert_allclose(run.control.t, starts[1:], atol=2e-6 if changes else 1e-9)
    area = np.append(0.0, np.cumsum(0.5 * (run.slip_speed[1:] + run.slip_speed[:-1]) * 1e-3))
    means = np.diff(np.interp(starts, run.t, area)) / np.diff(starts)
    np.testing.assert_allclose(run.control.mean_slip, means, rtol=1e-3)


@pytest.mark.parametrize(("name", "low", "high", "unit"), [
    ("engine_torque", -1e5, 1e5, "N m"), ("actuation_pressure", 0.0, 1e7, "Pa"), ("output_speed", -1e5, 1e5, "rad/s")])
def test_a_command_is_admitted_up_to_the_ends_of_its_range(name: str, low: float, high: float, unit: str) -> None:
    admitted: list[float] = []
    for value in (low, high):
        check_command(name, value, admitted.append)
    for value in (math.nextafter(low, -math.inf), math.nextafter(high, math.inf), math.nan):
        with pytest.raises(InputError, match=rf"^{name} command of .* {re.escape(f'{low:g} to {high:g} {unit}')}"):
            check_command(name, value, admitted.append)
    assert admitted == [low, high]


def test_a_small_pressure_may_be_meant_in_bar() -> None:
    assert "260000" in doubt_of("actuation_pressure", 2.6)
    assert "9.99e+07" in doubt_of("actuation_pressure", 999.0)
    assert [doubt_of(*asked) for asked in (("actuation_pressure", 1000.0), ("actuation_pressure", 0.0),
                                           ("engine_torque", 2.6))] == [""] * 3


def test_a_law_moves_the_far_end_and_a_refused_speed_leaves_the_one_before_it() -> None:
    """Its angle is the integral of the speed; the torques on the way are the scene's."""
    answers = [(None, None, 30.0), (None, 2e5, 50.0), (None, None, 2e5), (None, 1e5, None), 1e5]
    with pytest.warns(UserWarning, match=r"output_speed command of 200000 rad/s refused; .* \(1 refused\)"):
        run = tcc_sim.closed_loop("commands", Scripted(answers), 0.005)
    assert run.output_speed.tolist() == [0.0, 30.0, 50.0, 50.0, 0.0, 0.0]
    assert run.output_angle == pytest.approx([0.0, 0.03, 0.08, 0.13, 0.13, 0.13])
    assert run.received.tolist() == [0, 0, 1, 1, 2, 3]
    assert np.isnan(run.commands["actuation_pressure"]).tolist() == [True, True, False, True, False, False]
