"""Work in processes, one of which is killed: finished parts stay, others are repeated, and nothing waits."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tcc_sim.errors import InputError, WorkersLost
from tcc_sim.sweeps import executors
from tcc_sim.sweeps.executors import Attendance, each_done, each_in_a_process
from tcc_sim.sweeps.settings import Settings

REFUSED = """
import multiprocessing

def refuse(*_):
    raise RuntimeError("a semaphore of the system was asked for")

multiprocessing.RLock = refuse
from tcc_sim.sweeps.progress import progress_bar

with progress_bar("part", 3) as bar:
    bar.update()
"""


def killed_once(mark: str) -> int:
    """End this process like the kernel does where memory runs out, the first time that it is asked for a mark."""
    path = Path(mark)
    if path.suffix == ".deadly" and not path.exists():
        path.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


def killed(number: int) -> int:
    """End this process for any argument."""
    os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_a_killed_process_costs_only_what_it_had_in_hand(tmp_path: Path) -> None:
    marks = [str(tmp_path / name) for name in ("one", "two.deadly", "three", "four")]
    result = each_in_a_process(killed_once, marks, 2)
    assert len(result) == 4
    assert os.getpid() not in result


def test_work_that_kills_whoever_does_it_is_given_up_in_one_line() -> None:
    with pytest.raises(WorkersLost, match=r"0 of 2 parts were done$"):
        each_in_a_process(killed, [1, 2], 2)


@pytest.mark.parametrize("failing", range(4))
def test_what_is_done_at_the_moment_of_a_failure_is_kept(failing: int) -> None:
    def submit(task: int) -> Future[int]:
        future: Future[int] = Future()
        if task == failing:
            future.set_exception(KeyboardInterrupt())
        else:
            future.set_result(task)
        return future

    tasks: Iterator[int] = iter(range(4))
    kept: list[int] = []
    with pytest.raises(KeyboardInterrupt):
        kept.extend(result for _, result in each_done(Attendance(4), lambda: next(tasks, None), submit))
    assert sorted(kept) == [k for k in range(4) if k != failing]


@pytest.mark.parametrize(("parts", "jobs", "each", "counts"), [(4, 8, 1, [4, 2, 1]), (3, 3, 1, [3, 1]), (5, 3, 5, [3]),
                                                              (5, 4, 2, [4, 2, 1])])
def test_half_as_many_processes_do_what_is_left(parts: int, jobs: int, each: int, counts: list[int],
                                                monkeypatch: pytest.MonkeyPatch) -> None:
    """Until one works alone; every time `each` parts more are done."""
    begun: list[int] = []

    def pool(work: Any, given: Any, count: int, results: dict[int, Any], bar: Any) -> None:
        begun.append(count)
        results.update({k: work(given[k]) for k in range(min(each * len(begun), parts))})

    monkeypatch.setattr(executors, "_in_a_pool", pool)
    done = min(each * len(counts), parts)
    if done == parts:
        assert each_in_a_process(str, range(parts), jobs) == [str(k) for k in range(parts)]
    else:
        with pytest.raises(WorkersLost, match=f"; {done} of {parts} parts were done$"):
            each_in_a_process(str, range(parts), jobs)
    assert begun == counts


def test_one_part_is_done_here() -> None:
    assert each_in_a_process(os.path.basename, ["a/b"]) == ["b"]


def test_a_bar_asks_for_no_semaphore_which_an_ended_process_would_leave_behind() -> None:
    ended = subprocess.run([sys.executable, "-c", REFUSED], text=True, capture_output=True, check=False, timeout=60)
    assert (ended.returncode, ended.stderr) == (0, "")


def test_threads_are_as_many_as_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    for jobs, count in ((1, 1), (3, 3), (1024, 1024), (None, executors.cores())):
        with executors.workers(jobs, None) as (executor, attendance):
            assert (executor._max_workers, attendance.threads) == (count, count)
            assert executor.submit(int, "7").result() == 7
            attendance.check()
        with pytest.raises(RuntimeError):
            executor.submit(int)
    for jobs in (0, 1025, -1):
        with (pytest.raises(InputError, match=f"^jobs is {jobs}; it must be 1 to 1024$"),
              executors.workers(jobs, None)):
            pass
    assert [executors.processes_for(*given) for given in ((5, 2), (1, 8), (3, 3))] == [2, 1, 3]
    monkeypatch.setattr(executors, "os", SimpleNamespace(cpu_count=lambda: 6))
    assert (executors.cores(), executors.processes_for(9), executors.processes_for(4)) == (6, 6, 4)
    monkeypatch.setattr(executors, "os", SimpleNamespace(cpu_count=lambda: None))
    assert executors.cores() == 1
    monkeypatch.setattr(executors, "os", SimpleNamespace(sched_getaffinity=lambda _: {3, 5}))
    assert executors.cores() == 2


def test_few_tasks_are_handed_out_ahead_and_those_that_nobody_awaits_are_cancelled() -> None:
    handed: list[Future[int]] = []

    def submit(task: int) -> Future[int]:
        handed.append(Future())
        if task == 0:
            handed[-1].set_result(10)
        return handed[-1]

    done = each_done(Attendance(2), iter([*range(40)]).__next__, submit)
    assert next(done) == (0, 10)
    assert len(handed) == 6
    handed[1].set_result(11)
    assert next(done) == (1, 11)
    assert len(handed) == 7
    done.close()
    assert all(future.cancelled() for future in handed[2:])
    lone = each_done(Attendance(0), iter([0, None, None, None]).__next__, submit)
    assert list(lone) == [(0, 10)]


def test_who_waits_looks_after_the_workers_and_notices_that_they_gave_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "DEFAULTS", Settings(look=1e-3))
    first, other, cancelled, failed, broken = futures = [Future() for _ in range(5)]
    looks: list[int] = []

    class Watched(Attendance):
        def check(self) -> None:
            looks.append(1)
            if len(looks) == 2:
                first.set_result(1)

    assert executors.first_done([first, other], Watched(1)) == {first}
    assert len(looks) == 2
    cancelled.cancel()
    cancelled.set_running_or_notify_cancel()
    failed.set_exception(CancelledError())
    broken.set_exception(ValueError())
    for gone in (cancelled, failed):
        with pytest.raises(WorkersLost, match=r"^the workers gave it up$"):
            executors.first_done([gone, other], Watched(1))
    assert executors.first_done([broken, other], Watched(1)) == {broken}
    assert futures[1] is other


def test_workers_may_be_absent_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, answer = [100.0], {"a": 2, "b": 1}
    client = SimpleNamespace(status="running", nthreads=lambda: answer)
    monkeypatch.setattr(executors, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    scheduler = executors.Scheduler(client, "tcp://host:1", 400.0)
    assert scheduler.threads == 3
    answer.clear()
    for clock[0] in (130.0, 160.0):
        scheduler.check()
        assert scheduler.threads == 0
    answer["c"] = 5
    scheduler.check()
    assert scheduler.threads == 5
    client.nthreads = lambda: 1 // 0
    clock[0] = 220.0
    scheduler.check()
    clock[0] = 220.5
    for client.status, gone in (("running", "has no workers"), ("closed", "is gone")):
        with pytest.raises(WorkersLost, match=f"^--dask tcp://host:1: the scheduler {gone} for 60 s now$"):
            scheduler.check()


@pytest.mark.parametrize(("address", "good"), [
    ("tcp://h:1", True), ("tls://h.a-b:65535", True), ("ws://[::1]:80/", True), ("wss://1.2.3.4:8786", True),
    ("h:8786", True), ("ftp://h:1", False), ("h:0", False), ("h:65536", False), ("h:123456", False), ("h", False),
    ("tcp://h:1/x", False), ("tcp://:1", False)])
def test_an_address_has_a_host_and_a_port(address: str, good: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(deadline: float, function: object) -> None:
        raise OSError("refused")

    monkeypatch.setattr(executors, "require", lambda *names: None)
    monkeypatch.setattr(executors, "in_time", refused)
    why = (f"--dask {address}: no Dask scheduler answers (refused)" if good else
           f"--dask is {address!r}; it must be an address such as tcp://127.0.0.1:8786")
    with pytest.raises(InputError, match=f"^{re.escape(why)}$"), executors.cluster(address):
        pass
