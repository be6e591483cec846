"""Parts of the nodes that need neither a context nor another process: qualities of service, times and counts."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.qos import HistoryPolicy, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from tcc_sim.errors import InputError
from tcc_sim.messages import cdr
from tcc_sim.nodes import loop_topics, middleware, process, track
from tcc_sim.nodes.loop_topics import CommandedInput, Outputs
from tcc_sim.nodes.middleware import (
    CHANGES,
    COMMANDS,
    DIAGNOSTICS,
    LATCHED,
    SequenceNumbers,
    await_peer,
    message_class,
    publisher_of,
    qos_fields,
    states,
    time_of,
)
from tcc_sim.nodes.simulation_clock import SimulationClock
from tcc_sim.nodes.track import SimulatedTime
from tcc_sim.plant.driveline import Reading
from tcc_sim.plant.sensors import Sensors
from tcc_sim.scene import load_scene
from tcc_sim.topics import topic

Unheard = tuple[list[float], list[tuple[bytes, dict[str, Any]]]]
NO_LIMIT = {"sec": 9_223_372_036, "nsec": 854_775_807}
"""The largest number of nanoseconds in 63 bits."""


@pytest.mark.parametrize(("profile", "history", "depth", "durability"), [
    (COMMANDS, "keep_last", 100, "volatile"), (LATCHED, "keep_last", 1, "transient_local"),
    (CHANGES, "keep_last", 1000, "transient_local"), (DIAGNOSTICS, "keep_last", 10, "volatile"),
    (states(0), "keep_all", 0, "volatile"), (states(1), "keep_last", 1, "volatile"),
    (states(250), "keep_last", 250, "volatile")])
def test_qualities_of_service_are_those_of_the_topics(profile: Any, history: str, depth: int, durability: str) -> None:
    assert profile.history == HistoryPolicy[history.upper()]
    assert qos_fields(profile) == {
        "history": history, "depth": depth, "reliability": "reliable", "durability": durability, "deadline": NO_LIMIT,
        "lifespan": NO_LIMIT, "liveliness": "system_default", "liveliness_lease_duration": NO_LIMIT,
        "avoid_ros_namespace_conventions": False}


def test_times_have_seconds_of_31_bits_and_types_are_found_by_name() -> None:
    assert [(time.sec, time.nanosec) for time in map(time_of, (
        0, 999_999_999, 3_000_000_500, (2**31 - 1) * 10**9 + 7, 2**31 * 10**9 + 7))] == [
            (0, 0), (0, 999_999_999), (3, 500), (2**31 - 1, 7), (2**31 - 1, 7)]
    assert message_class("std_msgs/msg/Float64").__name__ == "Float64"
    for name in ("std_msgs/msg/Float6", "no_such_msgs/msg/Float64"):
        with pytest.raises(InputError, match=f"^message type {name} is not installed$"):
            message_class(name)
    assert (publisher_of({}), publisher_of({"publisher_gid": {"data": [1, 255]}})) == (b"", b"\x01\xff")


def test_a_peer_is_awaited_until_it_is_met_or_the_limit_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    now, looks = [10.0], []
    monkeypatch.setattr(middleware.time, "monotonic", lambda: now[0])

    def sleep(seconds: float) -> None:
        looks.append(seconds)
        now[0] += 0.25

    monkeypatch.setattr(middleware.time, "sleep", sleep)
    await_peer(lambda: True)
    assert looks == []
    await_peer(lambda: now[0] > 10.3)
    assert looks == [middleware.LOOK] * 2
    await_peer(lambda: False)
    assert (len(looks), now[0]) == (6, 11.5)


@pytest.mark.parametrize(("messages", "lost", "expected"), [
    ([], 0, {}), ([(b"a", 5)], 0, {b"a": 6}), ([(b"a", 5), (b"a", 6)], 0, {b"a": 7}),
    ([(b"a", 5), (b"a", 7)], 1, {b"a": 8}), ([(b"a", 5), (b"a", 9), (b"a", 11)], 4, {b"a": 12}),
    ([(b"a", 5), (b"a", 3), (b"a", 4)], 0, {b"a": 5}), ([(b"a", 5), (b"b", 1), (b"a", 6), (b"b", 4)], 2,
                                                        {b"a": 7, b"b": 5}),
    ([(b"a", 1), (b"b", 1), (b"a", 3), (b"c", 1), (b"a", 9)], 1, {b"c": 2, b"a": 10})])
def test_gaps_in_the_numbers_of_each_publisher_are_lost_messages(
        messages: list[tuple[bytes, int]], lost: int, expected: dict[bytes, int],
        monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond the largest number of publishers, here two, the one that was heard first is forgotten."""
    monkeypatch.setattr(middleware, "MOST_PUBLISHERS", 2)
    numbers = SequenceNumbers()
    for publisher, number in messages:
        numbers.count(publisher, number)
    assert (numbers.lost, list(numbers.next.items())) == (lost, list(expected.items()))


def test_a_message_has_the_last_time_on_the_clock_before_it_was_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(track, "DEPTH", 2)
    clock = SimulatedTime()
    assert not clock.known
    clock.follow([(cdr.clock(stamp), {"source_timestamp": sent, "received_timestamp": received})
                  for stamp, sent, received in ((1, 100, 999), (2, 0, 200), (3, 150, 999), (4, 300, 999))])
    assert clock.known
    asked = [(99, 1), (100, 1), (199, 1), (200, 3), (299, 3), (300, 4), (10**9, 4)]
    assert [(sent, clock.of({"source_timestamp": sent, "received_timestamp": 1})) for sent, _ in asked] == asked
    assert clock.of({"source_timestamp": 0, "received_timestamp": 250}) == 3
    clock.follow([(cdr.clock(5), {"source_timestamp": 400, "received_timestamp": 1})])
    assert [clock.of({"source_timestamp": sent}) for sent in (1, 399, 400)] == [4, 4, 5]


@pytest.fixture
def unheard(monkeypatch: pytest.MonkeyPatch) -> Unheard:
    """Time, which sleeps advance, and the messages that wait for the subscription of every input."""
    now, waiting = [50.0], list[tuple[bytes, dict[str, Any]]]()
    monkeypatch.setattr(loop_topics, "subscribe", lambda *how: None)
    monkeypatch.setattr(loop_topics, "taker", lambda subscription: lambda: waiting.pop(0) if waiting else None)
    monkeypatch.setattr(loop_topics, "poll", lambda subscription, most: [waiting.pop(0)] if waiting else [])
    monkeypatch.setattr(loop_topics.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(loop_topics.time, "sleep", lambda seconds: now.__setitem__(0, now[0] + seconds))
    return now, waiting


def test_lock_step_takes_the_answer_to_an_older_state_of_the_period_if_none_follows_within_grace(
        unheard: Unheard) -> None:
    """From a timer of simulation time, which may fire before the state of the same time arrives."""
    now, waiting = unheard
    command = CommandedInput(None, topic("actuation_pressure"))  # type: ignore[arg-type]
    command.period_ns, command.timed = 5_000, True

    def told(stamp: int, value: float, tick: int = 10, answers: int = 10_000) -> bool:
        waiting.append((cdr.fluid_pressure(stamp, value), {}))
        return command.answered(tick, answers)

    assert not command.answered(10, 10_000)
    assert not told(5_001, 1e5)
    now[0] += 0.99 * loop_topics.GRACE
    assert not command.answered(10, 10_000)
    assert (command.value, command.received) == (None, 0)
    now[0] += 0.02 * loop_topics.GRACE
    assert command.answered(10, 10_000)
    assert (command.value, command.received, command.refused) == (1e5, 1, 0)
    assert not command.answered(11, 11_000)  # Each command answers one state.
    assert not told(9_999, 2e5)
    assert told(10_000, 3e5)  # The answer itself.
    now[0] += 1.0
    assert not command.answered(11, 11_000)
    assert (command.value, command.received, command.refused) == (3e5, 2, 0)
    assert not told(5_000, 4e5)  # Of the period before.
    assert not told(10_001, 4e5)  # Of a later state.
    assert command.refusal == ("actuation_pressure command with stamp 1.0001e-05 s refused; it must be that of the "
                               "state, 1e-05 s")
    assert told(0, 6e5)
    assert (command.value, command.received, command.refused, command.unstamped) == (6e5, 3, 2, 1)


def test_an_input_counts_losses_and_doubts_its_unit_from_its_first_command_on(unheard: Unheard) -> None:
    _, waiting = unheard
    command = CommandedInput(None, topic("actuation_pressure"))  # type: ignore[arg-type]
    assert (command.doubt(1000, 10), command.fallen_back) == ("", True)
    gid = {"publisher_gid": {"data": [1]}}
    for tick, value, info in ((5, -1.0, {}), (7, 2.5, gid | {"publication_sequence_number": 3}),
                              (9, 1.5, {"publication_sequence_number": 9}), (9, 1.5, gid | {
                                  "publication_sequence_number": 5})):
        waiting.append((cdr.fluid_pressure(0, value), info))
        command.poll(tick, math.inf)
    assert (command.received, command.refused, command.lost, command.value) == (3, 1, 1, 1.5)
    assert [command.doubt(tick, 10) for tick in (17, 18)] == ["", (
        "the largest actuation_pressure command is 2.5 Pa; the unit is Pa: 2.5 bar would be 250000")]
    assert (command.accept(b"", 9), command.refused) == (True, 2)
    assert command.refusal.startswith("actuation_pressure: ")
    assert [(command.poll(tick, 50.0), command.value, command.timeouts)[1:] for tick in (58, 59, 60)] == [
        (1.5, 0), (None, 1), (None, 1)]
    command.accept(cdr.fluid_pressure(0, 7.0), 61)
    command.reset()
    assert (command.value, command.timeouts, command.received) == (None, 1, 4)


@pytest.mark.parametrize(("arrivals", "ended"), [
    ([], 0.3), ([0.2], 0.5), ([0.2, 0.45, 0.7], 1.0), ([0.4], 0.3), ([0.25 * k for k in range(20)], 3.0)])
def test_a_vehicle_has_joined_once_it_is_quiet_and_after_three_seconds_at_the_latest(
        unheard: Unheard, monkeypatch: pytest.MonkeyPatch, arrivals: list[float], ended: float) -> None:
    """Refused messages are answers too."""
    now, _ = unheard
    left = list(arrivals)

    def taken() -> tuple[bytes, dict[str, Any]] | None:
        if left and 50.0 + left[0] <= now[0]:
            return cdr.float64(math.nan if len(left) % 2 else left[0]), {"at": left.pop(0)}
        return None

    monkeypatch.setattr(loop_topics, "taker", lambda subscription: taken)
    command = CommandedInput(None, topic("output_speed"))  # type: ignore[arg-type]
    command.join(40)
    assert command.since == 41
    assert now[0] - 50.0 == pytest.approx(ended, abs=0.0125)
    assert command.received + command.refused == len(arrivals) - len(left)


class Offered:
    """A publisher that takes messages while it is open."""

    def __init__(self, name: str, depth: int) -> None:
        self.topic_name, self.depth, self.open, self.count = f"/left/{name}", depth, True, 0
        self.taken: list[bytes] = []
        self.handle = SimpleNamespace(publish_raw=self.take)
        self.publish = self.take

    def take(self, data: bytes) -> None:
        if not self.open:
            raise RuntimeError("cannot publish data")
        self.taken.append(data)

    def get_subscription_count(self) -> int:
        return self.count


def outputs_of(**changes: Any) -> tuple[Outputs, dict[str, Offered]]:
    """Outputs of a made-up node and its publishers."""
    made: dict[str, Offered] = {}

    def create(kind: type, name: str, profile: Any) -> Offered:
        made[name] = Offered(name, profile.depth)
        return made[name]

    node: Any = SimpleNamespace(create_publisher=create, context=SimpleNamespace(ok=lambda: True),
                                get_fully_qualified_name=lambda: "/left/driveline", count_subscribers=lambda name: 2)
    # Words are new objects, as those of files.
    return Outputs(node, load_scene("minimal").with_values({
        name: "".join(value) if isinstance(value, str) else value for name, value in changes.items()})), made


READING = Reading(5_000_000, *(float(n) for n in range(1, 8)), 1, *(float(n) for n in range(9, 14)))


def test_states_are_sent_where_they_belong_and_losses_of_a_sensor_are_those_of_its_topic(
        monkeypatch: pytest.MonkeyPatch) -> None:
    outputs, made = outputs_of(rate=2000.0)
    met: list[Any] = []
    monkeypatch.setattr(loop_topics, "await_peer", met.append)
    assert {name: one.depth for name, one in made.items()} == {
        "scene": 1, "joint_states": 500, "slip_speed": 500, "friction_torque": 500, "stick_slip_state": 500}
    assert outputs_of(rate=10.0)[1]["joint_states"].depth == 10
    assert [outputs_of(**{name: value})[1]["joint_states"].depth for name, value in (
        ("real_time_factor", 0.0), ("pacing", "lockstep"))] == [0, 0]
    assert (outputs.patient, outputs.add("slip_speed"), outputs.add("shaft_torque"), outputs.begin_at_zero(False)) == (
        False, False, True, False)
    outputs.state(READING)
    values = {"joint_states": cdr.joint_state(5_000_000, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, outputs.run),
              "slip_speed": cdr.float64(7.0),
              "friction_torque": cdr.float64(6.0), "stick_slip_state": cdr.int8(1), "shaft_torque": cdr.float64(11.0)}
    assert {name: one.taken for name, one in made.items() if name != "scene"} == {
        name: [data] for name, data in values.items()}
    outputs.say("nothing", b"")
    outputs.say("scene", b"text")
    assert made["scene"].taken == [b"text"]
    outputs.sensors = Sensors({"slip_speed": {"drop": 1}, "engine_torque": {"offset": 0.5}})
    outputs.state(READING)
    assert {name: len(one.taken) for name, one in made.items()} == {
        "scene": 1, "joint_states": 2, "slip_speed": 1, "friction_torque": 2, "stick_slip_state": 2, "shaft_torque": 2}
    assert made["joint_states"].taken[1] == cdr.joint_state(5_000_000, 1.0, 2.0, 3.0, 4.0, 5.5, 6.0, outputs.run)
    made["joint_states"].count, made["slip_speed"].count = 3, 4
    assert outputs.subscriptions() == (3, 7)
    for made["slip_speed"].count, connected in ((1, False), (2, True), (3, True)):
        outputs.meet("slip_speed")
        assert met.pop()() is connected
    assert len(outputs.handles()) == 6


def test_messages_that_are_refused_wait_in_order_or_are_counted_once() -> None:
    for patient in (True, False):
        outputs, made = outputs_of(real_time_factor=0.0 if patient else 1.0)
        states, slip = made["joint_states"], made["slip_speed"]
        states.open = slip.open = False
        outputs.state(READING)
        slip.open = True
        outputs.state(READING._replace(slip_speed=8.0))
        if patient:
            assert (outputs.flush(), slip.taken, outputs.unsent) == (False, [], {})
            states.open = True
            assert outputs.flush()
            assert (len(states.taken), slip.taken) == (2, [cdr.float64(7.0), cdr.float64(8.0)])
            outputs.tell_unsent()
            assert "unsent_messages" not in made
            continue
        assert outputs.unsent == {"/left/joint_states": 2, "/left/slip_speed": 1}
        for _ in range(2):
            outputs.tell_unsent()
        (data,) = made["unsent_messages"].taken
        said = deserialize_message(data, DiagnosticStatus)
        assert (said.name, said.message, [(item.key, item.value) for item in said.values]) == (
            "/left/driveline", "3 messages not sent", [("/left/joint_states", "2"), ("/left/slip_speed", "1")])
        made["unsent_messages"].open = False
        outputs.state(READING)
        outputs.tell_unsent()
        made["unsent_messages"].open = True
        outputs.tell_unsent()
        assert len(made["unsent_messages"].taken) == 2
        outputs._context.ok = lambda: False  # type: ignore[method-assign]
        with pytest.raises(RuntimeError, match="cannot publish data"):
            outputs.state(READING)


def test_stamps_of_the_wall_clock_never_go_back(monkeypatch: pytest.MonkeyPatch) -> None:
    outputs, made = outputs_of(stamp="wall")
    monkeypatch.setattr(loop_topics.time, "time_ns", lambda: 7_000_000_000)
    assert (outputs.begin_at_zero(False), outputs.zero_ns) == (True, 7_000_000_000)
    outputs.state(READING)
    assert cdr.read_stamp(made["joint_states"].taken[0]) == 7_005_000_000
    assert (outputs.begin_at_zero(False), outputs.zero_ns) == (True, 7_005_000_001)


@pytest.mark.parametrize(("flushes", "acknowledges", "took", "said"), [
    (0.0, 0.0, 0.0, []), (0.05, 0.0, 0.05, []), (0.0, 0.05, 0.05, []),
    (0.0, 2.0, 2.0, ["waits until subscribers have received the last messages of /a"]),
    (2.0, 0.0, 2.0, ["waits until subscribers have received the last messages of "]),
    (0.0, 9.0, 5.0, ["waits until subscribers have received the last messages of /a",
                     "subscribers have not received the last messages of /a within 5 s"])])
def test_a_node_that_ends_waits_for_its_subscribers_and_names_those_topics(
        monkeypatch: pytest.MonkeyPatch, flushes: float, acknowledges: float, took: float, said: list[str]) -> None:
    now, heard = [100.0], list[str]()

    def wait(until: float) -> Any:
        def acked(limit: Any) -> bool:
            now[0] = max(now[0], min(until, now[0] + limit.nanoseconds * 1e-9))
            return now[0] >= until - 1e-9
        return acked

    def sleep(seconds: float) -> None:
        now[0] += seconds

    monkeypatch.setattr(process.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(process.time, "sleep", sleep)
    for name in ("log", "warn"):
        monkeypatch.setattr(process, name, lambda node, sentence: heard.append(sentence))
    node: Any = SimpleNamespace(publishers=[SimpleNamespace(topic_name="/a", wait_for_all_acked=wait(
        100.0 + acknowledges)), SimpleNamespace(topic_name="/b", wait_for_all_acked=lambda limit: True)])
    process.deliver(node, lambda: now[0] >= 100.0 + flushes - 1e-9)
    assert now[0] - 100.0 == pytest.approx(took, abs=0.011)
    assert heard == said


def test_warnings_come_once_a_second_of_each_subject_and_counts_where_they_grow(
        monkeypatch: pytest.MonkeyPatch) -> None:
    now, said = [10.0], list[tuple[float, str]]()
    monkeypatch.setattr(process, "warn", lambda node, sentence: said.append((now[0], sentence)))
    throttle = process.Throttle(None, lambda: now[0])  # type: ignore[arg-type]
    for now[0], what, count in ((10.0, "a", 0), (10.0, "a", 1), (10.5, "a", 2), (10.5, "b", None), (11.0, "a", 2),
                                (11.25, "b", None), (11.5, "b", None), (12.5, "a", 2)):
        throttle.warn(what, what, count)
    for now[0] in (20.0, 30.0):
        throttle.once("a", "again")
        throttle.once("c", "first")
    assert said == [(10.0, "a (1 so far)"), (10.5, "b"), (11.0, "a (2 so far)"), (11.5, "b"), (20.0, "first")]


@pytest.mark.parametrize(("rivals", "followers", "wanted", "lockstep", "published", "due", "said"), [
    ([], [], False, False, False, False, ""), ([], [], True, False, False, True, ""),
    ([], [], True, False, True, False, ""),
    (["/g"], [], True, False, False, False, "/clock is published by /g already, so this node does not publish it"),
    (["/g", "/h"], [], False, True, False, False, ""),
    (["/g", "/h"], [], True, False, True, False,
     "/clock is published by /g, /h too, and simulation time jumps: end one of them"),
    ([], ["/f"], False, True, False, True, ""), ([], ["/f"], False, True, True, False, ""),
    ([], ["/f", "/e"], False, False, False, False,
     "/f, /e with use_sim_time waits for /clock, which nobody publishes: set publish_clock"),
    ([], ["/f"], True, False, True, False, ""), (["/g"], ["/f"], False, False, False, False, "")])
def test_the_clock_is_published_where_it_is_wanted_or_followed_and_by_nobody_else(
        rivals: list[str], followers: list[str], wanted: bool, lockstep: bool, published: bool, due: bool,
        said: str) -> None:
    def ends(names: list[str], reliability: ReliabilityPolicy = ReliabilityPolicy.BEST_EFFORT) -> list[Any]:
        return [SimpleNamespace(node_namespace=space or "/", node_name=name, qos_profile=SimpleNamespace(
            reliability=reliability)) for space, _, name in (one.rpartition("/") for one in names)]

    mine = ["/left/driveline"]
    node: Any = SimpleNamespace(
        resolve_topic_name=lambda name: name, get_fully_qualified_name=lambda: mine[0],
        get_subscriptions_info_by_topic=lambda name: ends(followers + mine) + ends(["/r"], ReliabilityPolicy.RELIABLE),
        get_publishers_info_by_topic=lambda name: ends(mine * published + rivals))
    told: list[Any] = []
    outputs: Any = SimpleNamespace(add=told.append, meet=lambda name: told.append("meets"), zero_ns=7,
                                   say=lambda name, data: told.append(cdr.read_stamp(data)))
    operation: Any = SimpleNamespace(publish_clock=wanted, pacing="".join("lockstep") if lockstep else "real_time")
    clock = SimulationClock(node, outputs, operation)
    clock.published = published
    assert (clock.followers, clock.rivals, clock.due, clock.sentence()) == (followers, rivals, due, said)
    clock.begin(5)
    assert told == ["/clock", *["meets"] * lockstep, 12]
    clock.begin()
    assert (told[-2:], clock.published) == (["/clock", "meets"], True)
