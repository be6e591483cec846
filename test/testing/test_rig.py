"""The fixture `driveline`: nodes under test in lock-step in this process, faults by count, and failures of a test."""

from __future__ import annotations

import math
import sys
import threading
import traceback
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

import tcc_sim
from tcc_sim.errors import InputError
from tcc_sim.messages import cdr
from tcc_sim.model.groups import PRESSURE_MAXIMUM
from tcc_sim.nodes.slip_controller import SlipControllerNode
from tcc_sim.plant.slip_control import SlipController, Tuning
from tcc_sim.testing.rig import ControllerFailed, Faults, Line


class Controller(Node):
    """Answers every state with a function of it, like any node of a user."""

    def __init__(self, answer: Callable[[JointState], float | None]) -> None:
        super().__init__("my_controller")
        self.answer, self.states = answer, []
        self.publisher = self.create_publisher(FluidPressure, "actuation_pressure", 10)
        self.create_subscription(JointState, "joint_states", self.on_state, 10)

    def on_state(self, state: JointState) -> None:
        self.states.append(state)
        pressure = self.answer(state)
        if pressure is not None:
            command = FluidPressure(fluid_pressure=pressure)
            command.header.stamp = state.header.stamp
            self.publisher.publish(command)


class Counting:
    """100 kPa and 1 Pa more for every state: each command tells which state it answers."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, state: JointState) -> float:
        self.count += 1
        return 1e5 + self.count - 1


def test_a_controller_holds_its_target_and_the_run_is_that_of_its_law_without_ros(driveline: Any) -> None:
    plant = driveline("controlled", changes={"engine.mean_torque": 250.0})
    plant.add(SlipControllerNode())
    run = plant.run(seconds=0.8)
    assert (run.tracking.verdict, run.tracking.commands_applied) == ("settled", 800)
    assert run.tracking.target == 20.0
    assert (run.missed, run.refused, len(run.t)) == (0, 0, 801)
    scene = tcc_sim.load_scene("controlled").with_values({"engine.mean_torque": 250.0})
    law = SlipController(Tuning())
    alone = tcc_sim.closed_loop(scene, lambda r: law.update(r.flywheel_speed - r.plate_speed, r.engine_torque),
                                0.8)
    for name in ("t", "plate_angle", "friction_torque", "saturation_torque", "flywheel_angle", "applied_pressure"):
        assert getattr(run, name).tobytes() == getattr(alone, name).tobytes(), name
    assert run.commands["actuation_pressure"].tobytes() == alone.commands["actuation_pressure"].tobytes()


def test_runs_go_on_where_the_one_before_ended_with_changed_parameters_and_a_target_of_the_test(
        driveline: Any) -> None:
    plant = driveline("controlled", rate=500.0)
    controller = plant.add(Controller(lambda state: 1e5 + 1e3 * (state.velocity[0] - state.velocity[1] - 20.0)))
    first = plant.run(ticks=100)
    plant.pause(0.02)
    plant.change({"engine.mean_torque": 300.0})
    with pytest.raises(InputError, match=r"engine.mean_torque.*1e\+06.*-100000 to 100000 N m"):
        plant.change(engine__mean_torque=1e6)
    with pytest.raises(InputError, match=r"driveline\.stiffness"):
        plant.change({"driveline.stiffness": 1e4})
    second = plant.run(seconds=0.5, target=30.0)
    assert (first.t[0], first.t[-1], second.t[0], second.t[-1]) == (0.0, 0.2, 0.2, 0.7)
    assert first.slip_speed[-1] == second.slip_speed[0]
    mean = np.round(np.concatenate([first.engine_torque, second.engine_torque[1:]]) - 250.0 * np.sin(
        150.0 * np.concatenate([first.t, second.t[1:]])), 6)
    assert mean.tolist() == [200.0] * 101 + [300.0] * 250
    assert [state.header.stamp.nanosec for state in controller.states] == [k * 2_000_000 for k in range(351)]
    assert second.tracking.target == 30.0
    with pytest.raises(InputError, match="no target: no node published target_slip_speed"):
        _ = first.tracking
    with pytest.raises(InputError, match="give either seconds or ticks"):
        plant.run()
    for wrong in ({"ticks": 0}, {"ticks": 2.5}, {"seconds": 0.0}, {"seconds": math.nan}, {"seconds": math.inf}):
        with pytest.raises(InputError, match=f"a run of {next(iter(wrong.values())):g} .* is not possible"):
            plant.run(**wrong)


def held(run: Any) -> list[int]:
    """Which state's command was held through each tick."""
    return [round(value - 1e5) for value in run.commands["actuation_pressure"][1:]]


def test_faults_hit_one_of_every_so_many_commands_and_do_what_they_say(driveline: Any) -> None:
    def run(**faults: int) -> Any:
        plant = driveline("controlled", faults=faults)
        plant.add(Controller(Counting()))
        return plant.run(ticks=60)

    plain, doubled = run(), run(duplicate=4)
    assert held(plain) == held(doubled) == list(range(60))
    assert (plain.missed, doubled.missed, doubled.refused) == (0, 0, 0)
    dropped = run(drop=10, seed=1)
    lost = [tick for tick, number in enumerate(held(dropped)) if number != tick]
    assert [tick // 10 for tick in lost] == [0, 1, 2, 3, 4, 5]
    assert all(held(dropped)[tick] == tick - 1 for tick in lost if tick)
    assert (dropped.missed, dropped.refused) == (6, 0)
    late = run(delay=20, delay_ticks=5, seed=1)
    behind = {tick: number for tick, number in enumerate(held(late)) if number != tick}
    for tick, number in behind.items():
        assert number in (tick - 1, tick - 5)
    assert sum(number == tick - 5 for tick, number in behind.items()) == late.missed == 3
    spoilt = run(corrupt=10, seed=2)
    assert (spoilt.refused, spoilt.missed) == (6, 6)
    assert "actuation_pressure" in spoilt.refusal
    again = run(drop=10, seed=1)
    assert again.slip_speed.tobytes() == dropped.slip_speed.tobytes()
    assert run(drop=10, seed=3).slip_speed.tobytes() != dropped.slip_speed.tobytes()


def test_without_commands_for_its_time_out_the_driveline_falls_back(driveline: Any) -> None:
    plant = driveline("controlled", changes={"command_timeout": 0.005}, faults={"drop": 1})
    plant.add(Controller(Counting()))
    run = plant.run(ticks=20)
    assert np.isnan(run.commands["actuation_pressure"]).all()
    assert set(run.applied_pressure) == {1e5}
    assert run.missed == 20


def test_a_node_that_only_listens_hears_every_state_of_a_scene_that_takes_no_commands(driveline: Any) -> None:
    plant = driveline("fig02")
    heard: list[JointState] = []
    listener = Node("listener")
    listener.create_subscription(JointState, "joint_states", heard.append, 1000)
    plant.add(listener)
    run = plant.run(ticks=50)
    assert [state.velocity[0] - state.velocity[1] for state in heard] == pytest.approx(run.slip_speed.tolist(),
                                                                                      abs=1e-12)


def dies() -> None:
    raise ValueError("no such gear")


def never_comes_back() -> None:
    while True:
        threading.Event().wait(0.01)


def waits_for_ever() -> None:
    threading.Event().wait()


PATIENCE = 3.0
"""Real time for an answer in tests that wait in vain, s; longer than any tick takes on a busy machine."""


@pytest.mark.parametrize(("act", "parts"), [
    (lambda: sys.exit(3), ["sys.exit(3)"]), (rclpy.shutdown, ["ROS 2"]), (dies, ["ValueError: no such gear"]),
    (never_comes_back, ["3 s", "never_comes_back (test_rig.py:"]), (waits_for_ever, ["waits_for_ever (test_rig.py:"]),
    (lambda: None, ["actuation_pressure", "3 s", "stamp"])])
def test_a_controller_that_fails_fails_the_test_with_its_reason_and_the_time(driveline: Any, act: Callable[[], None],
                                                                              parts: list[str]) -> None:
    plant = driveline("controlled", patience=PATIENCE)
    plant.add(Controller(lambda state: act() if state.header.stamp.nanosec == 7_000_000 else 1e5))
    with pytest.raises(ControllerFailed) as failure:
        plant.run(seconds=1.0)
    assert [part for part in ("my_controller", "0.007 s", *parts) if part not in str(failure.value)] == []
    # Only Python code can be stopped.
    assert ("nodes under test" in [thread.name for thread in threading.enumerate()]) >= (act is waits_for_ever)
    for error in filter(None, (failure.value, failure.value.__cause__)):  # The lines of the test alone are shown.
        shown = traceback.extract_tb(error.__traceback__)
        assert 0 < len(shown) <= 3
        assert not any("rclpy" in frame.filename for frame in shown)


def test_a_corrupt_command_is_no_number_or_out_of_range_or_truncated() -> None:
    line, whole, most = Line("x", Faults(corrupt=1)), cdr.fluid_pressure(7, 1e5), 2.0 * PRESSURE_MAXIMUM
    for _ in range(200):
        line.send(whole, 0)
    assert set(line.deliver(0)) == {whole[:-5], *(cdr.fluid_pressure(7, value)
                                                  for value in (math.nan, math.inf, -most, most))}


def test_close_destroys_the_driveline_and_the_nodes_under_test(driveline: Any) -> None:
    plant = driveline("controlled")
    plant.add(Controller(lambda state: 1e5))
    plant.run(ticks=1)
    seen = Node("observer")
    assert {"driveline", "my_controller"} <= set(seen.get_node_names())
    plant.close()
    assert not {"driveline", "my_controller"} & set(seen.get_node_names())
    for use in (lambda: plant.run(ticks=1), lambda: plant.change({"engine.mean_torque": 300.0}), plant.pause):
        with pytest.raises(InputError, match=r"this driveline is closed: by close\(\), or because the test has"):
            use()
    seen.destroy_node()


def test_a_node_that_destroys_itself_and_one_of_another_type_are_one_sentence(driveline: Any) -> None:
    plant = driveline("controlled", patience=10.0)
    controller = plant.add(Controller(lambda state: 1e5))

    def gone(state: JointState) -> float | None:
        if state.header.stamp.nanosec == 3_000_000:
            controller.destroy_node()
            return None
        return 1e5

    controller.answer = gone
    with pytest.raises(ControllerFailed, match=r"my_controller destroyed itself at 0\.003 s of simulated time"):
        plant.run(seconds=1.0)
    plant.close()
    stranger = Node("stranger")
    stranger.create_publisher(Float64, "actuation_pressure", 10)
    with pytest.raises(InputError, match=r"ROS 2 refuses the driveline: .*; another node may already publish one of "
                                         "its topics with another type"):
        driveline("controlled")
    stranger.destroy_node()


def test_what_cannot_be_waited_for_is_said(driveline: Any) -> None:
    plant = driveline("controlled", patience=PATIENCE)
    with pytest.raises(ControllerFailed, match="no node under test publishes actuation_pressure, which the scene"):
        plant.run(ticks=1)
    elsewhere = Context()
    elsewhere.init()
    node = Node("my_node", context=elsewhere)
    with pytest.raises(InputError, match="my_node has another ROS 2 context"):
        plant.add(node)
    node.destroy_node()
    elsewhere.shutdown()
    controller = Controller(lambda state: None)
    clock = controller.create_publisher(FluidPressure, "actuation_pressure", 10)

    def with_its_own_clock(_: JointState) -> None:
        command = FluidPressure(fluid_pressure=1e5)
        command.header.stamp.sec = 1_700_000_000
        clock.publish(command)

    controller.create_subscription(JointState, "joint_states", with_its_own_clock, 10)
    plant.add(controller)
    with pytest.raises(ControllerFailed, match="1 command had the stamp of another state"):
        plant.run(ticks=1)


class Timed(Node):
    """Sends 100 kPa from a timer of 5 ms, and counts its callbacks."""

    def __init__(self, sends: bool = True, stamped: bool = False, **options: Any) -> None:
        super().__init__("timed", **options)
        self.count, self.newest = 0, JointState()
        self.publisher = self.create_publisher(FluidPressure, "actuation_pressure", 10)
        self.create_subscription(JointState, "joint_states", self.take, 10)
        self.sends, self.stamped = sends, stamped
        self.create_timer(0.005, self.on_timer)

    def take(self, state: JointState) -> None:
        self.newest = state
        if not self.sends:
            self.publisher.publish(FluidPressure(header=state.header, fluid_pressure=1e5))

    def on_timer(self) -> None:
        self.count += 1
        if self.sends:
            command = FluidPressure(fluid_pressure=1e5 + self.count)
            if self.stamped:
                command.header = self.newest.header
            self.publisher.publish(command)


SIMULATED = {"parameter_overrides": [Parameter("use_sim_time", value=True)]}


@pytest.mark.parametrize("stamped", [False, True])
def test_a_timer_acts_at_its_period_on_simulation_time_and_is_refused_on_the_wall_clock(driveline: Any,
                                                                                       stamped: bool) -> None:
    plant = driveline("controlled")
    timed = plant.add(Timed(stamped=stamped, **SIMULATED))
    run = plant.run(ticks=100)
    assert timed.count == 20
    assert len(set(run.commands["actuation_pressure"][6:].tolist())) == 19
    plant = driveline("controlled")
    plant.add(Timed(stamped=stamped))
    with pytest.raises(ControllerFailed, match=r"timed sends actuation_pressure from a timer of the wall clock "
                                               r"\(0.005 s\), which answers no state: give the node use_sim_time"):
        plant.run(ticks=1000)


def test_a_timer_of_the_wall_clock_that_sends_no_command_is_no_matter(driveline: Any) -> None:
    """A pause executes callbacks too, and may last longer than the patience."""
    plant = driveline("controlled", patience=1.0)
    timed = plant.add(Timed(sends=False))
    for go_on in (lambda: plant.run(ticks=10), lambda: plant.pause(1.2)):
        before = timed.count
        while timed.count < before + 2:
            go_on()


@pytest.mark.parametrize(("options", "parts"), [
    ({"changes": {"stamp": "wall"}}, ["stamp", "wall"]), ({"faults": {"drop": -1}}, ["drop", "-1", "0 or more"]),
    ({"faults": {"delay_ticks": 0}}, ["delay_ticks", "0", "1 or more"]), ({"faults": {"loss": 3}}, ["loss", "drop"])])
def test_senseless_options_are_refused(driveline: Any, options: dict[str, Any], parts: list[str]) -> None:
    with pytest.raises(InputError) as refused:
        driveline("controlled", **options)
    assert [part for part in parts if part not in str(refused.value)] == []
