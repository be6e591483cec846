"""Commands, target, applied pressure and sources that a viewer shows beside states made up by the test."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from tcc_sim.analysis.control import Event
from tcc_sim.messages import cdr
from tcc_sim.nodes import middleware
from tcc_sim.nodes.middleware import LATCHED, message_class
from tcc_sim.nodes.watcher import ControlWatch, Watcher, readers
from tcc_sim.scene import load_scene
from tcc_sim.topics import JOINT_STATE, topic

MS = 1_000_000
CYCLE = 0.004


class Said:
    """A watch, and a publisher of every topic that it listens to."""

    def __init__(self, bench: Any) -> None:
        node = bench.node("driveline")
        self.bench = bench
        self.watch = ControlWatch(bench.node("watcher"), CYCLE)
        self.publishers = {name: node.create_publisher(message_class(topic(name).type), name, profile)
                           for name, (profile, _) in readers().items()}
        for publisher in self.publishers.values():
            bench.until(publisher.get_subscription_count)

    def say(self, name: str, data: bytes) -> int:
        """Publish, poll the watch, and return the time of receipt, ns."""
        waiting = self.watch._waiting[name]
        count = len(waiting)
        self.publishers[name].publish(data)
        self.bench.until(lambda: (self.watch.poll(), len(waiting) > count)[1])
        return waiting[-1][0]

    def aligned(self, ticks: list[int], received: list[int], slip_speed: float = 2.0, new_run: bool = False) -> Any:
        signals, events = self.watch.aligned(np.array(ticks) * MS, np.array(received), np.full(len(ticks), slip_speed),
                                             new_run=new_run, zeros=np.empty(0, np.int64))
        return {name: list(zip((stamps // MS).tolist(), values.tolist())) for name, (stamps, values)
                in signals.items() if len(stamps)}, events


@pytest.fixture
def said(bench: Any) -> Said:
    return Said(bench)


@pytest.mark.parametrize(("name", "data", "value"), [
    ("engine_torque", cdr.float64(310.0), 310.0), ("target_slip_speed", cdr.float64(5.0), 5.0),
    ("actuation_pressure", cdr.fluid_pressure(0, 2e5), 2e5)])
def test_what_is_asked_for_stands_at_the_state_received_after_it(said: Said, name: str, data: bytes,
                                                                 value: float) -> None:
    when = said.say(name, data)
    assert said.aligned([7, 8], [when - 20, when - 10]) == ({}, [])
    assert said.aligned([9, 10], [when - 5, when + 5]) == ({name: [(10, value)]}, [])
    assert said.aligned([11], [when + 15]) == ({}, [])


def test_applied_pressure_and_sources_have_stamps_of_their_own(said: Said) -> None:
    for tick, value in ((0, 1e5), (1, 1e5), (2, 2e5), (3, 2e5), (4, 1e5)):
        when = said.say("applied_pressure", cdr.fluid_pressure(tick * MS, value))
    then = said.say("input_source", cdr.header(2 * MS, "actuation_pressure: command"))
    signals, events = said.aligned([0, 1, 2, 3, 4, 5], [when] * 5 + [then])
    assert signals["applied_pressure"] == [(0, 1e5), (2, 2e5), (4, 1e5)]
    assert events == [Event(2e-3, "actuation_pressure: command")]


def test_pressure_of_the_run_that_ended_is_not_shown_in_the_next(said: Said) -> None:
    late = said.say("applied_pressure", cdr.fluid_pressure(500 * MS, 3e5))
    said.aligned([499, 500], [late - 9, late - 8])
    fresh = said.say("applied_pressure", cdr.fluid_pressure(0, 1e5))
    signals, _ = said.aligned([0], [fresh], new_run=True)
    assert signals == {"applied_pressure": [(0, 1e5)]}


def test_the_mean_slip_is_that_of_whole_cycles_and_starts_anew_after_a_gap(said: Said) -> None:
    signals, _ = said.aligned(list(range(10)), [1] * 10)
    assert signals == {"mean_slip": [(4, pytest.approx(2.0)), (8, pytest.approx(2.0))]}
    signals, _ = said.aligned(list(range(14, 25)), [1] * 11, slip_speed=6.0)
    assert signals == {"mean_slip": [(20, pytest.approx(6.0)), (24, pytest.approx(6.0))]}
    signals, _ = said.aligned(list(range(9)), [1] * 9, slip_speed=1.0, new_run=True)
    assert signals == {"mean_slip": [(4, pytest.approx(1.0)), (8, pytest.approx(1.0))]}


def test_messages_that_cannot_be_read_are_left_out(said: Said) -> None:
    said.publishers["engine_torque"].publish(b"\0\1\0\0")
    when = said.say("engine_torque", cdr.float64(310.0))
    assert said.aligned([1], [when]) == ({"engine_torque": [(1, 310.0)]}, [])


class View:
    """Receives the output of a watcher."""

    def __init__(self) -> None:
        self.pieces: list[tuple[list[int], bool]] = []

    def samples(self, stamps: np.ndarray, *_: object, new_run: bool) -> None:
        self.pieces.append(((stamps // MS).tolist(), new_run))

    def cycles(self, *_: object) -> None:
        """Ignore."""

    control = text = cycles


def shown(bench: Any, period: float, ticks: list[int]) -> tuple[View, Watcher]:
    """Return the view of a watcher that states with these stamps, ms, reached ten at a time, and the watcher."""
    node = bench.node("driveline")
    node.create_publisher(message_class("std_msgs/msg/String"), "scene", LATCHED).publish(
        cdr.string(load_scene("minimal").text()))
    states = node.create_publisher(message_class(JOINT_STATE), "joint_states", middleware.states(100))
    watcher = Watcher(bench.node("watcher"), str, period)
    bench.until(states.get_subscription_count)
    view: Any = View()
    for n, tick in enumerate(ticks):
        states.publish(cdr.joint_state(tick * MS, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
        if n % 10 == 9:
            bench.until(lambda n=n: watcher.drain(view) or watcher.heard == n + 1)
    watcher.drain(view, everything=True)
    assert watcher.states == len(ticks)
    return view, watcher


@pytest.mark.parametrize("period", [1e9, 0.0])
def test_states_are_handed_on_in_pieces_of_a_period_and_whole_at_the_end(bench: Any, period: float) -> None:
    pieces = shown(bench, period, list(range(30)))[0].pieces
    assert [tick for ticks, _ in pieces for tick in ticks] == list(range(30))
    # The first states are shown at once, and the others after a period or at the end.
    lengths = [len(ticks) for ticks, _ in pieces]
    assert lengths == [10, 20] if period else len(lengths) >= 3


def test_states_before_and_after_a_reset_that_arrive_together_are_two_runs(bench: Any) -> None:
    view, watcher = shown(bench, 1e9, [*range(16), *range(7), *range(7)])
    assert view.pieces == [([*range(10)], False), ([*range(10, 16)], False), ([*range(7)], True), ([*range(7)], True)]
    assert len(watcher._cycles.runs) == 1   # What a watcher keeps does not grow with the runs.


@pytest.mark.parametrize(("scene", "torque", "pressure"), [
    ("controlled", "200 N m on average", "commanded"), ("commands", "commanded", "commanded"),
    ("minimal", "300 N m on average", "208333 Pa on average")])
def test_the_summary_names_the_driveline_its_states_and_the_figures_of_the_last_cycles(
        scene: str, torque: str, pressure: str) -> None:
    watcher: Any = Watcher.__new__(Watcher)
    watcher.scene = load_scene(scene).with_values({"rate": 500.0})
    system = watcher.scene.system
    watcher._node = SimpleNamespace(resolve_topic_name=lambda name: f"/left/{name}")
    watcher._last_stamp, watcher._recent, watcher.states = -1, [], 1
    watcher.numbers = SimpleNamespace(lost=0)
    last = (f"{system.friction.law} friction, engine torque {torque}, pressure {pressure}  \n"
            f"{watcher.scene.description}")
    assert watcher.summary() == f"**/left/driveline**, 0.0 s at 500 Hz: 1 state shown, 0 missed  \n{last}"
    watcher._last_stamp, watcher._recent, watcher.states = 2_500_000_000, [(1.25, 0.0), (3.123456, 0.5)], 7
    watcher.numbers.lost = 4
    assert watcher.summary() == (
        "**/left/driveline**, 2.5 s at 500 Hz: 7 states shown, 4 missed  \nlast 2 cycles: largest slip speed 3.123 "
        f"rad/s, 25 % of the time in stick  \n{last}")
