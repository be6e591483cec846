"""Commands, target, applied pressure and sources that a viewer shows beside states made up by the test."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from tcc_sim.analysis.control import Event
from tcc_sim.messages import cdr, held
from tcc_sim.nodes.middleware import LATCHED, message_class
from tcc_sim.nodes.watcher import ControlWatch, Watcher, readers, watch
from tcc_sim.scene import load_scene
from tcc_sim.topics import topic

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
    values = [2.0, 2.0 * MS, 1.0, 0.0, *[0.0] * (held.SIZE - held.HEAD)]
    values[held.index_in_held("actuation_pressure", "source")] = held.COMMAND
    then = said.say("held", held.held_message("692a1f3c9b02.001", values))
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


class View:
    """Keeps what a watcher hands to it."""

    def __init__(self) -> None:
        self.said: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []

    def __getattribute__(self, name: str) -> Any:
        said = object.__getattribute__(self, "said")
        return said if name == "said" else lambda *given, **named: said.append((name, given, named))


def rows(ticks: list[int], slip_speed: float, speed: float = 0.0) -> np.ndarray:
    """States without torques: those without motion of the plate are not accelerated."""
    return cdr.joint_state_layout().records([cdr.joint_state(
        tick * MS, 0.0, 0.25 * speed, slip_speed + speed, speed, 7.0 * speed, 5.0 * speed) for tick in ticks])[0]


@pytest.fixture
def watcher(bench: Any) -> Watcher:
    """A watcher of a driveline with a cycle of 4 ms."""
    driveline = bench.node("driveline", "/left")
    driveline.create_publisher(message_class("std_msgs/msg/String"), "scene", LATCHED).publish(cdr.string(
        load_scene("minimal").with_values({"engine.frequency": math.tau / CYCLE, "rate": 500.0}).text()))
    return Watcher(bench.node("watcher", "/left"), said_to.append)


said_to: list[str] = []


def test_states_are_shown_once_with_their_modes_and_the_figures_of_their_cycles(watcher: Watcher) -> None:
    view: Any = View()
    watcher._recent = deque(maxlen=4)
    for ticks, slip_speed in ((range(9), 2.0), ([8, 9, 9, 10], 0.0), (range(10, 21), 0.0)):
        given = list(ticks)
        watcher._show(view, np.array(given) * MS, rows(given, slip_speed), np.array(given))
    shown = [(given, named) for name, given, named in view.said if name == "samples"]
    assert [(given[0] // MS).tolist() for given, _ in shown] == [[*range(9)], [9, 10], [*range(11, 21)]]
    assert [given[-1].tolist() for given, _ in shown] == [[1] * 9, [0, 0], [0] * 10]
    assert [named for _, named in shown] == [{"new_run": False}] * 3
    cycles = [given for name, given, _ in view.said if name == "cycles"]
    assert [(first, len(whole)) for whole, first in cycles] == [(0, 2), (2, 3)]
    assert [figure for n, figure in enumerate(watcher._recent) if n != 1] == [(2.0, 0.0), (0.0, 1.0), (0.0, 1.0)]
    assert (watcher.states, watcher._last_stamp, len(watcher._cycles.runs[0].pieces)) == (21, 20 * MS, 0)
    before = len(view.said)
    watcher._show(view, np.array([20]) * MS, rows([20], 0.0), np.array([20]))
    assert len(view.said) == before
    watcher._show(view, np.array([5]) * MS, rows([5], 3.0, 2.0), np.array([21]))
    (name, columns, named), control = view.said[before:]
    assert (name, named, [column.tolist() for column in columns]) == (
        "samples", {"new_run": True}, [[5 * MS], [3.0], [0.5], [2.0], [14.0], [10.0], [1]])
    assert len(watcher._cycles.runs) == 1   # What a watcher keeps does not grow with the runs.
    assert control[0] == "control"
    assert list(control[1][0]) == ["mean_slip"]


def test_missed_states_are_told_once_a_second_and_silence_once(watcher: Watcher,
                                                               monkeypatch: pytest.MonkeyPatch) -> None:
    said_to.clear()
    heard, told = 10.0, []
    for now, lost, heard in ((10.0, 0, 10.0), (10.25, 1, 10.25), (11.0, 3, 11.0), (11.25, 3, 11.25), (11.5, 6, 11.25),
                             (14.25, 6, 11.25), (14.5, 6, 11.25), (15.0, 6, 11.25), (16.0, 6, 15.5), (19.0, 6, 15.5)):
        monkeypatch.setattr("tcc_sim.nodes.watcher.time.monotonic", lambda now=now: now)
        watcher.numbers.lost, watcher._heard = lost, heard
        watcher._report()
        told += [(now, sentence) for sentence in said_to]
        said_to.clear()
    silence = "no states for 3 s: paused, stopped, or waiting for subscribers"
    assert told == [(10.25, "missed 1 state, 1 in all"), (11.25, "missed 2 states, 3 in all"),
                    (14.25, "missed 3 states, 6 in all"), (14.5, silence), (19.0, silence)]


def test_arrived_states_are_counted_joined_and_shown_when_due(watcher: Watcher,
                                                              monkeypatch: pytest.MonkeyPatch) -> None:
    now, waiting, view = [100.0], [], View()
    monkeypatch.setattr("tcc_sim.nodes.watcher.time.monotonic", lambda: now[0])
    monkeypatch.setattr("tcc_sim.nodes.watcher.time.time_ns", lambda: 99)
    monkeypatch.setattr("tcc_sim.nodes.watcher.poll", lambda subscription, most=0: (
        waiting if subscription is watcher._states else []))
    watcher._period, shown = 2.0, []
    monkeypatch.setattr(watcher, "_show", lambda view, *pieces: shown.append((now[0], *(
        (piece // MS).tolist() if n == 0 else len(piece) if n == 1 else piece.tolist()
        for n, piece in enumerate(pieces)))))

    def info(number: int | None, received: int = 5) -> dict[str, Any]:
        return {"publication_sequence_number": number, "publisher_gid": {"data": [1]}, "received_timestamp": received}

    def state(tick: int) -> bytes:
        return cdr.joint_state(tick * MS, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)

    for now[0], ticks in ((100.0, [0]), (100.5, []), (101.0, [1, 2]), (101.75, [3, 0]), (102.0, []), (104.0, [1])):
        waiting[:] = [(state(tick), info(None)) for tick in ticks]
        watcher.drain(view)  # type: ignore[arg-type]
    assert shown == [(100.0, [0], 1, [5]), (102.0, [1, 2, 3], 3, [5] * 3), (102.0, [0], 1, [5]), (104.0, [1], 1, [5])]
    assert len(view.said) == 4  # Summaries, at most one a second.
    assert (watcher.heard, watcher.numbers.lost, watcher._heard) == (6, 0, 104.0)
    waiting[:] = [(state(2), info(7)), (cdr.float64(1.0), info(8)), (state(3), info(11, 0)), (state(4), info(0, 6))]
    stamps, received = watcher._taken()
    assert (cdr.stamps(stamps) // MS).tolist() == [2, 3, 4]
    assert (received.tolist(), watcher.numbers.lost) == ([5, 99, 6], 2)
    watcher.drain(view, everything=True)  # type: ignore[arg-type]
    assert (shown[-1][1], len(view.said)) == ([2, 3, 4], 5)


def test_a_scene_that_cannot_be_read_is_told_and_a_view_shows_what_is_published(
        watcher: Watcher, bench: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    said_to.clear()
    texts = [b"none", cdr.string("a: 1"), cdr.string(load_scene("slip").text()), cdr.string(
        load_scene("controlled").text() + "# holds from stamp 0 ns on, simulation time 0 is 7 ns of the wall clock\n")]
    monkeypatch.setattr("tcc_sim.nodes.watcher.poll", lambda subscription, most=0: [(text, {}) for text in texts])
    scene = watcher._scene()
    assert scene is not None
    assert scene.system == load_scene("controlled").system
    assert [sentence.partition(": ")[0] for sentence in said_to] == ["a scene could not be read"] * 2
    assert watcher._zeros.tolist() == [7]
    made: list[tuple[Any, ...]] = []
    monkeypatch.setattr("tcc_sim.nodes.watcher.RerunStream", lambda *given, **named: made.append((given, named)))
    driveline = bench.node("driveline", "/left")
    target = "target_slip_speed"
    for one, name, controlled, topics in ((watcher.scene, "", False, []), (watcher.scene, target, True, [target]),
                                          (scene, "", True, [])):
        watcher.scene = one
        publisher = driveline.create_publisher(message_class(topic(name).type), name, LATCHED) if name else None
        if publisher:
            bench.until(lambda name=name: watcher._node.count_publishers(name))
        watcher.view(url="here")
        assert made[-1] == (("/left/driveline", one.system.cycle), {
            "controlled": controlled, "topics": topics, "say": watcher._say, "url": "here"})
        if publisher:
            driveline.destroy_publisher(publisher)
            bench.until(lambda name=name: not watcher._node.count_publishers(name))


@pytest.mark.parametrize(("web", "where", "period", "history", "left_out", "said"), [
    (False, {"file": "a.rrd"}, 2.0, 0.0, 0, "1 state shown, 3 missed"),
    (True, {"url": "here"}, 0.5, 2.0, 1, "0 states shown, 3 missed, 1 left out by the viewer"),
    (False, {"spawn": True}, 0.0, 0.0, 0, "1 state shown, 3 missed")])
def test_watch_drains_until_ctrl_c_and_sums_up(web: bool, where: dict[str, Any], period: float, history: float,
                                               left_out: int, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    drained, slept, told = [], [], []

    @contextmanager
    def known(name: str, namespace: str) -> Iterator[Any]:
        assert (name, namespace) == ("watcher", "/left")
        yield SimpleNamespace(resolve_topic_name=lambda name: f"/left/{name}")

    @contextmanager
    def view(**given: Any) -> Iterator[Any]:
        assert given == {**where, "history": history}
        yield SimpleNamespace(left_out=left_out)

    def made(node: Any, say: Any, every: float) -> Any:
        assert every == period
        return SimpleNamespace(scene=SimpleNamespace(description="" if web else "what it is"), states=1, view=view,
                               numbers=SimpleNamespace(lost=3),
                               drain=lambda view, everything=False: drained.append(everything))

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        if len(slept) == 3:
            raise KeyboardInterrupt

    for name, stub in (("node_of_command", known), ("Watcher", made), ("time.sleep", sleep)):
        monkeypatch.setattr(f"tcc_sim.nodes.watcher.{name}", stub)
    assert watch("/left", told.append, web, **where) == said
    assert (drained, slept) == ([False] * 3 + [True], [0.1] * 3)
    assert told == [f"watching /left/driveline: {'a scene' if web else 'what it is'}; Ctrl-C ends it"]
