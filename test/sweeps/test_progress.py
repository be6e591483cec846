"""Bars of long work."""

import subprocess
import sys

REFUSED = """
import multiprocessing

def refuse(*_):
    raise RuntimeError("a semaphore of the system was asked for")

multiprocessing.RLock = refuse
from tcc_sim.sweeps.progress import progress_bar

with progress_bar("part", 3) as bar:
    bar.update()
"""


def test_a_bar_asks_for_no_semaphore_which_an_ended_process_would_leave_behind() -> None:
    ended = subprocess.run([sys.executable, "-c", REFUSED], text=True, capture_output=True, check=False, timeout=60)
    assert (ended.returncode, ended.stderr) == (0, "")
