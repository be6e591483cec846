"""What the real-time thread asks of Linux: granted where there is the right to it, one sentence, no harm where not."""

from __future__ import annotations

import ctypes
import os
import resource
import sys
import threading
from collections.abc import Callable
from typing import Any

import pytest

from tcc_sim.nodes.pacing import attend, prepare_thread

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="Linux only")
_PR_GET_TIMERSLACK = 30


def in_a_thread(body: Callable[[], Any]) -> Any:
    """What `body` gives in a thread of its own, whose settings end with it."""
    found: list[Any] = []
    thread = threading.Thread(target=lambda: found.append(body()))
    thread.start()
    thread.join()
    return found[0]


def slack() -> int:
    return int(ctypes.CDLL(None).prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0))


def test_the_timer_slack_of_this_thread_alone_is_a_nanosecond() -> None:
    before = slack()
    assert in_a_thread(lambda: (prepare_thread(), slack())) == ([], 1)
    assert slack() == before > 1


def test_the_thread_runs_on_the_cores_asked_for() -> None:
    mine = os.sched_getaffinity(0)
    core = max(mine)
    assert in_a_thread(lambda: (prepare_thread(cores=[core]), os.sched_getaffinity(0))) == ([], {core})
    assert os.sched_getaffinity(0) == mine


def without_rights(body: Callable[[], list[str]]) -> list[str]:
    """What `body` gives in a process that may lock a page and has no other right."""
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
        found = said.read().splitlines()
    assert os.waitpid(child, 0)[1] == 0
    return found


def test_what_is_refused_is_one_sentence_each_and_changes_nothing() -> None:
    said = without_rights(lambda: prepare_thread(50, [1023], True))
    assert [sentence.split(" was not granted")[0] for sentence in said] == [
        "cpu_affinity [1023]", "thread_priority 50", "lock_memory"]
    assert ", ".join(map(str, sorted(os.sched_getaffinity(0)))) in said[0]
    assert "CAP_SYS_NICE" in said[1]
    assert "Cannot allocate memory" in said[2]


def test_the_priority_is_fifo_where_it_is_granted() -> None:
    refused, policy, priority = in_a_thread(lambda: (prepare_thread(priority=7), os.sched_getscheduler(0),
                                                     os.sched_getparam(0).sched_priority))
    assert (policy, priority) == ((os.SCHED_OTHER, 0) if refused else (os.SCHED_FIFO, 7))
    assert len(refused) <= 1


def test_the_other_threads_of_the_process_are_one_below_the_real_time_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever holds the interpreter or a lock of the middleware is what the real-time thread waits for."""
    asked: dict[int, tuple[int, int]] = {}

    def take(thread: int, policy: int, param: os.sched_param) -> None:
        asked[thread] = policy, param.sched_priority
        if thread == threading.get_native_id():
            raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", take)
    stop, other = threading.Event(), threading.Thread(target=lambda: stop.wait())
    other.start()
    try:
        attend(50, (other.native_id,))
        mine = threading.get_native_id()
        assert asked[mine] == (os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, 49)
        assert other.native_id not in asked
        assert asked.keys() < set(map(int, os.listdir("/proc/self/task")))
        attend(1)
        assert set(asked.values()) == {(os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, 1)}
        attend(0)
        assert set(asked.values()) == {(os.SCHED_OTHER, 0)}
    finally:
        stop.set()
        other.join()
