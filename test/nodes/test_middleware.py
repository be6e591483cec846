"""Parts of the nodes that need neither a context nor another process: qualities of service, times and counts."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from rclpy.qos import HistoryPolicy

from tcc_sim.errors import InputError
from tcc_sim.messages import cdr
from tcc_sim.nodes import loop_topics, middleware, track
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
from tcc_sim.nodes.track import SimulatedTime
from tcc_sim.topics import topic

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


def test_lock_step_takes_the_answer_to_an_older_state_of_the_period_if_none_follows_within_grace(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """From a timer of simulation time, which may fire before the state of the same time arrives."""
    waiting: list[tuple[bytes, dict[str, Any]]] = []
    now = [50.0]
    monkeypatch.setattr(loop_topics, "subscribe", lambda *how: None)
    monkeypatch.setattr(loop_topics, "taker", lambda subscription: None)
    monkeypatch.setattr(loop_topics, "poll", lambda subscription, most: [waiting.pop(0)] if waiting else [])
    monkeypatch.setattr(loop_topics.time, "monotonic", lambda: now[0])
    command = loop_topics.CommandedInput(None, topic("actuation_pressure"))
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
