"""The pacer on a clock of the test; the real-time thread's requests to Linux, granted and refused."""

from __future__ import annotations

import ctypes
import os
import resource
import sys
import threading
from collections.abc import Callable
from typing import Any

import pytest

from tcc_sim.nodes.pacing import CATCH_UP, LEAD, LEAD_PART, SLICE, Pacer, attend, prepare_thread

START = 5_000_000_000
_PR_GET_TIMERSLACK = 30
linux = pytest.mark.skipif(sys.platform != "linux", reason="Linux only")


class Clock:
    """Time advances by sleeps and by steps of the test."""

    def __init__(self) -> None:
        self.now = START
        self.slept: list[float] = []

    def __call__(self) -> int:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now += round(seconds * 1e9)


def paced(period: float) -> tuple[Clock, Pacer]:
    clock = Clock()
    return clock, Pacer(period, clock=clock, sleep=clock.sleep)


def never() -> bool:
    return False


def test_deadlines_are_one_period_apart_whatever_a_tick_takes() -> None:
    clock, pacer = paced(1e-3)
    for tick in range(1, 101):
        clock.now += 137_000 + 1_000 * (tick % 7)
        assert pacer.wait(never)
        assert clock.now == START + tick * 1_000_000
    assert (pacer.ticks, pacer.late_ticks, pacer.missed_ticks, pacer.lateness_max, pacer.drift) == (100, 0, 0, 0.0, 0.0)


def test_a_late_tick_is_made_good_and_counted_late_only_beyond_a_period() -> None:
    clock, pacer = paced(1e-3)
    clock.now += 2_000_000
    assert pacer.wait(never)
    assert (pacer.late_ticks, pacer.lateness_max, clock.slept) == (0, 1e-3, [])
    clock.now += 1_500_001
    assert pacer.wait(never)
    assert (pacer.late_ticks, clock.slept) == (1, [])
    assert pacer.lateness_max == pytest.approx(1.500001e-3)
    assert pacer.drift == pytest.approx(1.500001e-3)
    for _ in range(2):
        assert pacer.wait(never)
    assert (clock.now, clock.slept) == (START + 4_000_000, [pytest.approx(0.499999e-3)])
    assert (pacer.late_ticks, pacer.missed_ticks) == (1, 0)


@pytest.mark.parametrize(("late", "missed"), [(CATCH_UP, 0), (CATCH_UP + 1e-9, 100), (CATCH_UP + 2.5e-3, 102)])
def test_beyond_the_catch_up_the_deadlines_move_and_what_was_missed_is_counted(late: float, missed: int) -> None:
    clock, pacer = paced(1e-3)
    clock.now += 1_000_000 + round(late * 1e9)
    began = clock.now
    assert pacer.wait(never)
    assert pacer.missed_ticks == missed
    assert pacer.missed_by == pytest.approx(late if missed else 0.0)
    assert pacer.wait(never)
    assert clock.now == (began + 1_000_000 if missed else began)


def test_an_interrupted_wait_keeps_its_deadline() -> None:
    clock, pacer = paced(10.0)
    looks = iter([False, False, True])
    assert not pacer.wait(lambda: next(looks))
    assert clock.slept == [SLICE, SLICE]
    assert (pacer.ticks, clock.now) == (0, START + round(2 * SLICE * 1e9))
    assert not pacer.wait(lambda: True)
    assert pacer.wait(never)
    assert (pacer.ticks, clock.now, pacer.lateness_max) == (1, START + 10_000_000_000, 0.0)
    assert max(clock.slept) == SLICE


def test_what_has_passed_is_not_interrupted() -> None:
    clock, pacer = paced(1e-3)
    clock.now += 3_000_000
    assert pacer.wait(lambda: True)
    assert pacer.wait(lambda: True)


def test_an_anchor_counts_from_now_with_the_new_period() -> None:
    clock, pacer = paced(1e-3)
    assert pacer.wait(never)
    clock.now += 777
    pacer.period_ns = 2e6
    pacer.anchor()
    assert pacer.wait(never)
    assert clock.now == START + 1_000_777 + 2_000_000
    assert pacer.drift == 0.0


def test_the_last_latenesses_are_kept() -> None:
    clock = Clock()
    pacer = Pacer(1e-3, kept=3, clock=clock, sleep=clock.sleep)
    assert pacer.lateness() == (0.0, 0.0)
    for tick, late in enumerate((5, 1, 2, 4), 1):
        clock.now = START + tick * 1_000_000 + late * 1000
        assert pacer.wait(never)
    assert sorted(pacer.latenesses().tolist()) == pytest.approx([1e-6, 2e-6, 4e-6])
    middle, high = pacer.lateness()
    assert middle == pytest.approx(2e-6)
    assert 2e-6 < high <= pacer.lateness_max == pytest.approx(5e-6)


class Sleepy(Clock):
    """Wakes late by `late` of the number of sleeps; each reading takes a microsecond."""

    def __init__(self, late: Callable[[int], int]) -> None:
        super().__init__()
        self.late = late

    def __call__(self) -> int:
        self.now += 1_000
        return self.now

    def sleep(self, seconds: float) -> None:
        super().sleep(seconds)
        self.now += self.late(len(self.slept))


def latenesses(pacer: Pacer, clock: Clock, ticks: int) -> list[float]:
    """Lateness of each tick, s, from the deadlines themselves."""
    began, result = clock.now, []
    for tick in range(1, ticks + 1):
        assert pacer.wait(never)
        result.append((clock.now - began - tick * pacer.period_ns) * 1e-9)
    return result


def test_a_sleep_ends_ahead_by_what_wake_ups_are_late_and_no_tick_is_early() -> None:
    clock = Sleepy(lambda count: 15_000 + 13_000 * (count % 4 == 0))
    result = latenesses(Pacer(1e-3, clock=clock, sleep=clock.sleep), clock, 600)
    assert min(result) >= 0.0
    assert result[0] >= 15e-6
    settled = sorted(result[100:])
    assert settled[len(settled) // 2] < 3e-6
    assert settled[-1] < 20e-6
    plain = Sleepy(clock.late)
    assert min(latenesses(Pacer(1e-3, clock=plain, sleep=plain.sleep, lead=0.0), plain, 600)) >= 15e-6


@pytest.mark.parametrize("period", [1e-2, 1e-3, 2e-4])
def test_the_lead_is_bounded(period: float) -> None:
    clock = Sleepy(lambda count: round(0.3e9 * period) if count < 300 else 0)
    pacer = Pacer(period, clock=clock, sleep=clock.sleep)
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
def test_the_timer_slack_of_this_thread_alone_is_a_nanosecond() -> None:
    before = slack()
    assert in_a_thread(lambda: (prepare_thread(), slack())) == ([], 1)
    assert slack() == before > 1


@linux
def test_the_thread_runs_on_the_cores_asked_for() -> None:
    mine = os.sched_getaffinity(0)
    core = max(mine)
    assert in_a_thread(lambda: (prepare_thread(cores=[core]), os.sched_getaffinity(0))) == ([], {core})
    assert os.sched_getaffinity(0) == mine


def without_rights(body: Callable[[], list[str]]) -> list[str]:
    """Return the result of `body` in a process that may lock a page and has no other right."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (4096, 4096))
        resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
        if os.geteuid() == 0:
            os.setresuid(65534, 65534, 65534)
        os.write(writing, "\n".join(body()).encode())
        os._exit(0)
    os.close(writing)
    with open(reading) as said:
        result = said.read().splitlines()
    assert os.waitpid(child, 0)[1] == 0
    return result


@linux
def test_what_is_refused_is_one_sentence_each_and_changes_nothing() -> None:
    said = without_rights(lambda: prepare_thread(50, [1023], True))
    assert [sentence.split(" was not granted")[0] for sentence in said] == [
        "cpu_affinity [1023]", "thread_priority 50", "lock_memory"]
    assert ", ".join(map(str, sorted(os.sched_getaffinity(0)))) in said[0]
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
