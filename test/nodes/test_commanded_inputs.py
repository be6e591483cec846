"""Parts of the nodes: qualities of service, lost messages, commanded inputs, requests and throttled warnings."""

from __future__ import annotations

import math
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from sensor_msgs.msg import FluidPressure

from tcc_sim.errors import InputError
from tcc_sim.messages import cdr
from tcc_sim.nodes.executables import Throttle
from tcc_sim.nodes.loop_topics import CommandedInput
from tcc_sim.nodes.middleware import COMMANDS, MOST_PUBLISHERS, SequenceNumbers, message_class, poll, subscribe
from tcc_sim.nodes.track import SimulatedTime
from tcc_sim.topics import topic


def test_types_are_found_by_name() -> None:
    assert message_class("std_msgs/msg/Float64").__name__ == "Float64"
    for name in ("std_msgs/msg/Float6", "no_such_msgs/msg/Float64"):
        with pytest.raises(InputError, match=name):
            message_class(name)


@pytest.mark.parametrize(("messages", "lost"), [
    ([], 0), ([(b"a", 5), (b"a", 6)], 0), ([(b"a", 5), (b"a", 9), (b"a", 11)], 4),
    ([(b"a", 5), (b"a", 3), (b"a", 4)], 0), ([(b"a", 5), (b"b", 1), (b"a", 6), (b"b", 4)], 2),
    ([(b"a", 1), *((n.to_bytes(2, "big"), 1) for n in range(MOST_PUBLISHERS - 1)), (b"a", 5)], 3),
    ([(b"a", 1), *((n.to_bytes(2, "big"), 1) for n in range(MOST_PUBLISHERS)), (b"a", 5)], 0)])
def test_gaps_in_the_numbers_of_each_publisher_are_lost_messages(messages: list[tuple[bytes, int]], lost: int) -> None:
    """Beyond the largest number of publishers the first one is forgotten."""
    numbers = SequenceNumbers()
    for publisher, number in messages:
        numbers.count({"publisher_gid": {"data": publisher}, "publication_sequence_number": number})
    assert numbers.lost == lost


def test_a_message_has_the_last_time_on_the_clock_before_it_was_sent() -> None:
    clock = SimulatedTime()
    assert not clock.known
    clock.follow([(cdr.clock(stamp), {"source_timestamp": sent, "received_timestamp": received})
                  for stamp, sent, received in ((1, 100, 999), (2, 0, 200), (3, 150, 999), (4, 300, 999))])
    asked = [(99, 1), (100, 1), (199, 1), (200, 3), (299, 3), (300, 4), (10**9, 4)]
    assert [(sent, clock.of({"source_timestamp": sent, "received_timestamp": 1})) for sent, _ in asked] == asked
    assert clock.of({"source_timestamp": 0, "received_timestamp": 250}) == 3


def test_an_input_counts_holds_falls_back_and_doubts_its_unit(bench: Any) -> None:
    command = CommandedInput(bench.node("plant"), topic("actuation_pressure"))
    publisher = bench.probe.create_publisher(FluidPressure, "actuation_pressure", COMMANDS)
    bench.until(publisher.get_subscription_count)

    def send(tick: int, *values: float) -> None:
        count = command.received + command.refused + command.lost
        for value in values:
            publisher.publish(cdr.fluid_pressure(0, value))
        bench.until(lambda: (command.poll(tick, math.inf), command.received + command.refused + command.lost
                             >= count + len(values))[1])

    assert (command.doubt(1000, 10), command.value) == ("", None)
    send(5, -1.0)
    send(7, 2.5, 1.5)
    assert (command.received, command.refused, command.value) == (2, 1, 1.5)
    assert command.doubt(17, 10) == ""
    assert "2.5 bar" in command.doubt(18, 10)
    assert [(command.poll(tick, 50.0), command.value, command.timeouts)[1:] for tick in (56, 57, 58)] == [
        (1.5, 0), (None, 1), (None, 1)]
    send(60, *[1e5] * 150)  # The queue holds 100.
    assert (command.received + command.lost, command.lost > 0) == (152, True)
    command.reset()
    assert (command.value, command.timeouts) == (None, 1)


def test_no_more_is_taken_than_asked_for_and_the_rest_waits(bench: Any) -> None:
    """In lock-step a command that is polled together with the one before would be lost."""
    subscription = subscribe(bench.probe, FluidPressure, "actuation_pressure", COMMANDS)
    publisher = bench.node("sender").create_publisher(FluidPressure, "actuation_pressure", COMMANDS)
    bench.until(publisher.get_subscription_count)
    for n in range(5):
        publisher.publish(cdr.fluid_pressure(n, 1e5))
    heard: list[int] = []
    while len(heard) < 5:
        taken = poll(subscription, most=2)
        assert len(taken) <= 2
        heard += [cdr.read_fluid_pressure(data)[0] for data, _ in taken]
    assert heard == list(range(5))


def test_a_subject_is_warned_of_once_a_second_and_counts_where_they_grow(
        bench: Any, capfd: pytest.CaptureFixture[str]) -> None:
    now, printed = [10.0], []
    throttle = Throttle(bench.probe, lambda: now[0])
    for now[0], what, count in ((10.0, "a", 0), (10.0, "a", 1), (10.5, "a", 2), (10.5, "b", None), (11.0, "a", 2),
                                (11.25, "b", None), (11.5, "b", None), (12.5, "a", 2)):
        throttle.warn(what, f"<{what}>", count)
        printed += [(now[0], line.split("<")[1]) for line in capfd.readouterr().err.splitlines()]
    for _ in range(2):
        throttle.once("c", "<c>")
    assert printed == [(10.0, "a> (1 so far)"), (10.5, "b>"), (11.0, "a> (2 so far)"), (11.5, "b>")]
    assert capfd.readouterr().err.count("<c>") == 1
