"""The real-time loop without its thread, on a clock of the test: lock-step, subscribers, requests and changes."""

from __future__ import annotations

import math
import queue
from collections import Counter
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from tcc_sim.nodes import loop as module
from tcc_sim.nodes.loop import LOCKSTEP_EAGER, LOCKSTEP_LOOK, LOCKSTEP_REST, Outcome, RealTimeLoop
from tcc_sim.scene import load_scene


class Answering:
    """A commanded input that answers at given times."""

    def __init__(self, name: str, clock: list[float], *times: float) -> None:
        self.name, self._clock, self._times = name, clock, list(times)
        self.since = self.timeouts = 0
        self.value: float | None = 1.0
        self.asked: list[tuple[int, int]] = []
        self.polled: list[tuple[int, float]] = []

    def answered(self, tick: int, stamp: int) -> bool:
        self.asked.append((tick, stamp))
        return bool(self._times) and self._clock[0] >= self._times[0] and bool(self._times.pop(0))

    def fall_back(self) -> None:
        self.timeouts += 1

    def poll(self, tick: int, limit: float) -> None:
        self.polled.append((tick, limit))


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Time, which sleeps advance; they are kept behind it."""
    times = [100.0]

    def sleep(seconds: float) -> None:
        times[0] += seconds
        times.append(seconds)

    monkeypatch.setattr(module.time, "monotonic", lambda: times[0])
    monkeypatch.setattr(module.time, "sleep", sleep)
    return times


def loop_of(commands: list[Any] = [], **changes: Any) -> Any:  # noqa: B006
    """A loop without node and thread, whose plant is at tick 12; words are new objects, as those of files."""
    changes = {name: "".join(value) if isinstance(value, str) else value for name, value in changes.items()}
    loop: Any = RealTimeLoop.__new__(RealTimeLoop)
    loop.plant = SimpleNamespace(scene=load_scene("controlled").with_values(changes), stamp_of=lambda tick: 1000 * tick,
                                 stepper=SimpleNamespace(tick=12), stamp_ns=12_000)
    loop.outputs = SimpleNamespace(zero_ns=7)
    loop.commands, loop._inputs, loop.far_end, loop._unanswered = commands, tuple(commands), None, None
    loop.target = None
    loop._stopping, loop._requests, loop._answer_ticks, loop._waits_since = False, queue.SimpleQueue(), 5, 0.0
    loop._thread = SimpleNamespace(is_alive=lambda: False)
    loop._wake = SimpleNamespace(wait=lambda seconds: module.time.sleep(seconds), clear=lambda: None, set=lambda: None)
    return loop


def test_lock_step_waits_for_the_inputs_due_at_a_tick_and_at_most_for_the_time_out(now: list[float]) -> None:
    torque, pressure, far = (Answering(name, now, *times) for name, times in (
        ("torque", (100.0, 101.0)), ("pressure", (100.0625,)), ("far", (100.0, 100.0, 200.0))))
    loop = loop_of([torque, pressure], pacing="lockstep", command_timeout=0.25)
    loop.commands, loop.far_end, far.since = [*loop.commands, far], far, 11
    assert loop._answered(10) is False
    assert (loop.waits_for, now[1:]) == ([pressure], [LOCKSTEP_LOOK])
    while not loop._answered(10):
        pass
    assert Counter(now[1:]).keys() == {LOCKSTEP_LOOK, LOCKSTEP_REST}
    assert Counter(now[1:])[LOCKSTEP_REST] == pytest.approx((0.0625 - LOCKSTEP_EAGER) / LOCKSTEP_REST, abs=1.0)
    assert (set(torque.asked), set(pressure.asked), far.asked) == ({(10, 10_007)}, {(10, 10_007)}, [])
    for tick in (11, 12):  # The far end answers every state from the one after it joined on.
        loop._unanswered = None
        assert loop._answered(tick) is True
        assert far.asked[-1] == (tick, 1000 * tick + 7)
    assert len(torque.asked) == 1
    loop._unanswered, began = None, now[0]
    while not loop._answered(15):
        assert now[0] - began <= 0.251
    assert now[0] - began == pytest.approx(0.25, abs=0.002)
    assert [one.timeouts for one in (torque, pressure, far)] == [1, 1, 1]
    loop.plant.scene, loop._unanswered = loop.plant.scene.with_values({"command_timeout": 0.0}), None
    now[0] = 100.5
    assert loop._answered(20) is False
    now[0] = 1000.0
    assert (loop._answered(20), loop.waits_for) == (False, [pressure])
    assert [one.timeouts for one in (torque, pressure, far)] == [1, 1, 1]


@pytest.mark.parametrize(("changes", "limit"), [({"command_timeout": 0.25, "rate": 2000.0}, 500.0),
                                                ({"command_timeout": 0.0}, math.inf)])
def test_a_tick_in_real_time_takes_commands_with_the_time_out_in_ticks_unless_a_request_comes(
        now: list[float], changes: dict[str, Any], limit: float) -> None:
    loop = loop_of([Answering("torque", now)], **changes)
    for period, waits, due in ((0.0, False, True), (1e6, True, True), (1e6, False, False)):
        loop.pacer = SimpleNamespace(period_ns=period, late_ticks=0, wait=lambda interrupted, waits=waits: waits)
        assert loop._due() is due
    assert loop.commands[0].polled == [(12, limit)] * 2
    lockstep = loop_of([Answering("torque", now, now[0])], pacing="lockstep", **changes)
    assert lockstep._due()  # By the answer.
    assert not lockstep.commands[0].polled
    assert not loop._interrupted()
    loop._requests.put(0)
    assert loop._interrupted()
    loop._requests.get()
    loop._stopping = True
    assert loop._interrupted()


@pytest.mark.parametrize(("wanted", "arrivals", "ended"), [
    (0, {}, 0.0), (1, {0.0: (1, 2)}, 0.25), (2, {0.0: (1, 1), 0.125: (2, 2), 0.25: (2, 3)}, 0.5),
    (1, {0.0: (0, 5), 0.5: (1, 5)}, 0.5), (1, {0.0: (0, 0), 0.5: (3, 3), 0.75: (1, 1)}, 1.0)])
def test_the_first_tick_waits_until_its_subscribers_are_there_and_no_more_come(
        now: list[float], wanted: int, arrivals: dict[float, tuple[int, int]], ended: float,
        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LOOK", 1 / 64)
    monkeypatch.setattr(module, "SETTLED", 0.25)
    loop = loop_of(wait_for_subscribers=wanted)
    loop.outputs.subscriptions = lambda: next(counts for after, counts in reversed(arrivals.items())
                                              if now[0] >= 100.0 + after)
    assert loop._await_subscribers()
    assert (now[0] - 100.0, set(now[1:]) <= {1 / 64}) == (ended, True)
    loop._stopping = True
    assert not loop._await_subscribers()


def test_requests_are_answered_by_what_they_return_or_raise(now: list[float]) -> None:
    loop = loop_of()

    def fails(error: Exception) -> Any:
        raise error

    outcomes = [loop.request(action) for action in (lambda: None, lambda: True, lambda: 3, lambda: 0, lambda: False,
                                                    lambda: fails(ValueError("why")), lambda: fails(KeyError()))]
    assert outcomes == [Outcome(True)] * 3 + [Outcome(False)] * 2 + [Outcome(False, "why"), Outcome(False, "KeyError")]
    assert [bool(one) for one in outcomes] == [True] * 3 + [False] * 4
    done: list[int] = []
    loop._thread = SimpleNamespace(is_alive=lambda: True)
    assert loop.request(lambda: done.append(1), timeout=0.001) == Outcome(
        False, "the real-time loop did not answer within 0.001 s")
    loop._serve()
    assert done == []  # Withdrawn.


def test_pauses_steps_changes_and_a_far_end_that_leaves(now: list[float], monkeypatch: pytest.MonkeyPatch) -> None:
    loop = loop_of(real_time_factor=0.5)
    anchors, used, steps, moved = [], [], [], []
    loop.pacer = SimpleNamespace(period_ns=2e6, anchor=lambda: anchors.append(loop.pacer.period_ns))
    loop.plant.use = used.append
    for scene in (loop.scene, loop.scene.with_values({"real_time_factor": 2.0}), loop.scene.with_values({
            "real_time_factor": 0.0})):
        loop.use(scene)
    assert (len(used), anchors) == (3, [5e5, 0.0])
    loop.clock_started = SimpleNamespace(is_set=lambda: started)
    monkeypatch.setattr(loop, "step", lambda: steps.append(1))
    for loop.paused, started in ((False, False), (False, True), (True, False), (True, True)):
        assert loop.single_step() is (loop.paused and started)
    assert len(steps) == 1
    loop.pause(True)
    assert (loop.paused, len(anchors), loop._waits_since) == (True, 2, 0.0)
    loop.pause(False)
    assert (loop.paused, len(anchors), loop._waits_since) == (False, 3, 100.0)
    torque, far = Answering("torque", now), Answering("far", now)
    loop.plant.move_far_end = moved.append
    for unanswered, left in ((None, None), ([torque, far], [torque]), ([far], [])):
        loop.commands, loop.far_end, loop._unanswered = [torque, far], far, unanswered
        loop.detach()
        assert (loop.commands, loop.far_end, loop._unanswered, moved.pop()) == ([torque], None, left, None)
    for loop._node, loop.far_end, waits in ((SimpleNamespace(count_publishers=lambda name, count=count: count), *rest)
                                            for count, *rest in ((0, None, False), (1, None, True), (1, far, False))):
        assert loop.vehicle_waits is waits
