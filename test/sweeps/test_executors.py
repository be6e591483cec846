"""Work in processes, one of which is killed: finished parts stay, others are repeated, and nothing waits."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path

import pytest

from tcc_sim.errors import WorkersLost
from tcc_sim.sweeps.executors import Attendance, each_done, each_in_a_process

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


def test_one_part_is_done_here() -> None:
    assert each_in_a_process(os.path.basename, ["a/b"]) == ["b"]


def test_a_bar_asks_for_no_semaphore_which_an_ended_process_would_leave_behind() -> None:
    ended = subprocess.run([sys.executable, "-c", REFUSED], text=True, capture_output=True, check=False, timeout=60)
    assert (ended.returncode, ended.stderr) == (0, "")
