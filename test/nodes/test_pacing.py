"""The pacer on a clock of the test; the real-time thread's requests to Linux, granted and refused."""

from __future__ import annotations

import ctypes
import os
import random
import sys
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from interpreter import python

from tcc_sim.nodes.pacing import CATCH_UP, LEAD, LEAD_PART, SLICE, Pacer, attend, prepare_thread

START, NS = 5_000_000_000, 1e-9
_PR_GET_TIMERSLACK = 30
linux = pytest.mark.skipif(sys.platform != "linux", reason="Linux only")


class Clock:
    """Time advances by steps of the test, and by sleeps, which end `late` ns of their number after the time asked for.

    Each reading takes `reading` ns.
    """

    def __init__(self, late: Callable[[int], int] = lambda _: 0, reading: int = 0) -> None:
        self.now, self.late, self.reading = START, late, reading
        self.slept: list[float] = []

    def __call__(self) -> int:
        self.now += self.reading
        return self.now

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now += round(seconds * 1e9) + self.late(len(self.slept))

    def pacer(self, period: float, **options: Any) -> Pacer:
        return Pacer(period, clock=self, sleep=self.sleep, **options)


def never() -> bool:
    return False


@pytest.mark.parametrize("period", [200_000, 1_000_000, 250_000_000])
@pytest.mark.parametrize("seed", range(4))
def test_every_tick_and_count_is_that_of_a_plain_schedule(period: int, seed: int) -> None:
    """Work of any length between ticks, interruptions, and new anchors with another period; all in whole ns."""
    draw, clock = random.Random(seed), Clock()
    pacer = clock.pacer(period / 1e9, kept=50)
    most = round(CATCH_UP * 1e9)
    works = [0, period // 7, period - 1, period, period + 1, 2 * period, 2 * period + 1, 3 * period, period + most,
             period + most + 1, period + most + 5 * period // 2]
    anchor = first = clock.now
    n = since = late = missed = 0
    missed_by, lateness = 0, []
    for _ in range(400):
        clock.now += draw.choice(works)
        deadline, looks = anchor + (n + 1) * period, draw.choice([1, 2, 9])
        if draw.random() < 0.1:
            began, looked = clock.now, iter([*[False] * (looks - 1), True, *[True] * 9])
            if deadline - began > looks * SLICE * 1e9 or (looks == 1 and deadline > began):
                assert not pacer.wait(lambda it=looked: next(it))
                assert clock.now == began + (looks - 1) * round(SLICE * 1e9)
        due, passed = max(clock.now, deadline), clock.now >= deadline
        assert pacer.wait(lambda it=passed: it)  # What has passed is not interrupted.
        assert clock.now == due
        n, since = n + 1, since + 1
        lateness.append(due - deadline)
        late += due - deadline > period
        if due - deadline > most:
            missed, missed_by = missed + (due - deadline) // period, due - deadline
            anchor, n = due, 0
        assert (pacer.ticks, pacer.late_ticks, pacer.missed_ticks) == (len(lateness), late, missed)
        assert (pacer.missed_by, pacer.lateness_max, pacer.drift) == pytest.approx(
            (missed_by * NS, max(lateness) * NS, (due - first - since * period) * NS), abs=1e-12)
        if draw.random() < 0.03:
            clock.now += 777
            period = draw.choice([period // 2, 2 * period])
            pacer.period_ns = float(period)
            pacer.anchor()
            anchor, first, n, since = clock.now, clock.now, 0, 0
    assert min(late, missed) > 0
    assert max(clock.slept) <= SLICE
    last = np.array(lateness[-50:]) * NS
    assert sorted(pacer.latenesses()) == pytest.approx(sorted(last), abs=1e-12)


def latenesses(pacer: Pacer, clock: Clock, ticks: int) -> list[float]:
    """Lateness of each tick, s, from the deadlines themselves."""
    began, result = clock.now, []
    for tick in range(1, ticks + 1):
        assert pacer.wait(never)
        result.append((clock.now - began - tick * pacer.period_ns) * 1e-9)
    return result


def test_a_sleep_ends_ahead_by_what_wake_ups_are_late_and_no_tick_is_early() -> None:
    def wakes(count: int) -> int:
        return 15_000 + 13_000 * (count % 4 == 0)

    clock, plain = Clock(wakes, 1000), Clock(wakes, 1000)
    result = latenesses(clock.pacer(1e-3), clock, 600)
    assert min(result) >= 0.0
    assert result[0] >= 15e-6
    settled = sorted(result[100:])
    assert settled[len(settled) // 2] < 3e-6
    assert settled[-1] < 20e-6
    assert min(latenesses(plain.pacer(1e-3, lead=0.0), plain, 600)) >= 15e-6


@pytest.mark.parametrize("period", [1e-2, 1e-3, 2e-4])
def test_the_lead_is_bounded(period: float) -> None:
    clock = Clock(lambda count: round(0.3e9 * period) if count < 300 else 0, 1000)
    pacer = clock.pacer(period)
    latenesses(pacer, clock, 301)
    began = clock.now
    pacer.anchor()
    assert pacer.wait(never)
    assert clock.slept[-1] >= period - min(LEAD, LEAD_PART * period) - 2e-6
    assert clock.now - began <= period * 1e9 + 3_000


def in_a_thread(body: Callable[[], Any]) -> Any:
    """Return the result of `body` in a new thread; its settings end with the thread."""
    values: list[Any] = []
    thread = threading.Thread(target=lambda: values.append(body()))
    thread.start()
    thread.join()
    return values[0]


def slack() -> int:
    return int(ctypes.CDLL(None).prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0))


@linux
def test_timer_slack_and_cores_are_those_of_this_thread_alone() -> None:
    before, mine = slack(), os.sched_getaffinity(0)
    core = max(mine)
    assert in_a_thread(lambda: (prepare_thread(cores=[core]), slack(), os.sched_getaffinity(0))) == ([], 1, {core})
    assert (slack(), os.sched_getaffinity(0)) == (before, mine)
    assert before > 1


WITHOUT_RIGHTS = """
import contextlib, os, resource
from tcc_sim.nodes.pacing import prepare_thread
resource.setrlimit(resource.RLIMIT_MEMLOCK, (4096, 4096))
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
with contextlib.suppress(PermissionError):  # Another user, or root without capabilities.
    os.setresuid(65534, 65534, 65534)
print(*prepare_thread(50, [1023], True), sep="\\n")
print(*sorted(os.sched_getaffinity(0)), sep=", ")
"""


@linux
def test_what_is_refused_is_one_sentence_each_and_changes_nothing() -> None:
    ended = python("-c", WITHOUT_RIGHTS, LC_ALL="C")
    assert (ended.returncode, ended.stderr) == (0, "")
    *said, cores = ended.stdout.splitlines()
    assert [sentence.split(" was not granted")[0] for sentence in said] == [
        "cpu_affinity [1023]", "thread_priority 50", "lock_memory"]
    assert cores == ", ".join(map(str, sorted(os.sched_getaffinity(0))))
    assert cores in said[0]
    assert "CAP_SYS_NICE" in said[1]
    assert "Cannot allocate memory" in said[2]


@linux
def test_the_priority_is_fifo_where_it_is_granted() -> None:
    refused, policy, priority = in_a_thread(lambda: (prepare_thread(priority=7), os.sched_getscheduler(0),
                                                     os.sched_getparam(0).sched_priority))
    assert (policy, priority) == ((os.SCHED_OTHER, 0) if refused else (os.SCHED_FIFO, 7))
    assert len(refused) <= 1


@linux
def test_the_other_threads_of_the_process_are_one_below_the_real_time_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """The real-time thread waits for any thread that holds the interpreter or a lock of the middleware."""
    priorities: dict[int, tuple[int, int]] = {}

    def take(thread: int, policy: int, param: os.sched_param) -> None:
        priorities[thread] = policy, param.sched_priority
        if thread == threading.get_native_id():
            raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", take)
    stop, other = threading.Event(), threading.Thread(target=lambda: stop.wait())
    other.start()
    try:
        attend(50, (other.native_id,))
        mine = threading.get_native_id()
        assert priorities[mine] == (os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, 49)
        assert other.native_id not in priorities
        assert priorities.keys() < set(map(int, os.listdir("/proc/self/task")))
        attend(1)
        assert set(priorities.values()) == {(os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, 1)}
        attend(0)
        assert set(priorities.values()) == {(os.SCHED_OTHER, 0)}
    finally:
        stop.set()
        other.join()
