"""Work in threads and processes, one of which is killed, and its progress on standard error."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace

import pytest

from tcc_sim.errors import InputError, WorkersLost
from tcc_sim.sweeps.executors import Attendance, cores, each_done, each_in_a_process, workers
from tcc_sim.sweeps.progress import ProgressLines, in_notebook, progress_bar


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
    assert each_in_a_process(os.path.basename, ["a/b"]) == ["b"]


def test_work_that_kills_whoever_does_it_is_given_up_in_one_line() -> None:
    with pytest.raises(WorkersLost, match="0 of 2 parts"):
        each_in_a_process(killed, [1, 2], 2)


@pytest.mark.parametrize("failing", range(4))
def test_results_of_the_moment_of_a_failure_are_kept(failing: int) -> None:
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


@pytest.mark.parametrize("jobs", [1, 3, None])
def test_work_is_done_by_so_many_threads_at_once(jobs: int | None) -> None:
    count = jobs or cores()
    together = threading.Barrier(count)
    with workers(jobs, None) as (executor, attendance):
        assert attendance.threads == count
        ended = [executor.submit(together.wait, 60.0) for _ in range(count)]
        assert sorted(future.result() for future in ended) == list(range(count))
    with pytest.raises(RuntimeError):
        executor.submit(int)


@pytest.mark.parametrize("jobs", [0, 1025, -1])
def test_a_number_of_jobs_out_of_its_range_is_refused(jobs: int) -> None:
    with pytest.raises(InputError, match=rf"jobs.*{jobs}.*1 to 1024"), workers(jobs, None):
        pass


def test_tasks_that_nobody_awaits_are_cancelled() -> None:
    submitted: list[Future[int]] = []

    def submit(task: int) -> Future[int]:
        submitted.append(Future())
        if task < 2:
            submitted[-1].set_result(10 + task)
        return submitted[-1]

    done = each_done(Attendance(2), iter([*range(1000)]).__next__, submit)
    assert {next(done), next(done)} == {(0, 10), (1, 11)}
    assert len(submitted) < 100
    done.close()
    assert all(future.cancelled() for future in submitted[2:])
    alone = each_done(Attendance(0), iter([0, None, None, None]).__next__, submit)
    assert list(alone) == [(0, 10)]


REFUSED = """
import multiprocessing

def refuse(*_):
    raise RuntimeError("a semaphore of the system was asked for")

multiprocessing.RLock = refuse
from tcc_sim.sweeps.progress import progress_bar

with progress_bar("part", 3) as bar:
    bar.update()
"""


class Written(io.StringIO):
    """A standard error that is no terminal, and reports each line."""

    def __init__(self) -> None:
        super().__init__()
        self.lines = threading.Semaphore(0)

    def flush(self) -> None:
        self.lines.release()


def test_without_a_terminal_lines_come_even_when_no_part_finishes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", written := Written())
    bar = ProgressLines("point", 40, 3, every=1e-3)
    for _ in range(2):
        assert written.lines.acquire(timeout=60.0)
    bar.close()
    assert set(written.getvalue().splitlines()) == {"tcc-sim: 3 of 40 points after 0 s"}


@pytest.mark.parametrize(("unit", "total", "words"), [
    ("point", 40, "2 of 40 points"), ("branches", 5, "2 of 5 branches"), (" states", None, "2 states"),
    ("s", 90.5, "2 of 90 s")])
def test_a_line_counts_finished_parts(unit, total, words, capsys):
    with progress_bar(unit, total) as bar:
        bar.set_postfix_str("at 7", refresh=False)
        bar.update(2)
        assert capsys.readouterr().err == ""
        bar.tell(60.0)
    line = capsys.readouterr().err
    assert all(each in line for each in (words, "60 s", "at 7"))
    with progress_bar(unit, total, shown=False) as hidden:
        hidden.update(2)
    assert capsys.readouterr().err == ""


def test_a_notebook_shows_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    """Standard error of a kernel is no terminal; a plain IPython has no kernel."""
    shell = SimpleNamespace()
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    assert not in_notebook()
    shell.kernel = object()
    assert in_notebook()
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with progress_bar("point", 2) as bar:
        bar.update(2)
    assert "100%" in sys.stderr.getvalue()
    assert "2/2" in sys.stderr.getvalue()


def test_a_bar_asks_for_no_semaphore_which_an_ended_process_would_leave_behind() -> None:
    ended = subprocess.run([sys.executable, "-c", REFUSED], text=True, capture_output=True, check=False, timeout=60)
    assert (ended.returncode, ended.stderr) == (0, "")
