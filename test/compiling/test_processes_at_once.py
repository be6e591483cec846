"""Kernels on disk that several processes store at once, and the rest of a killed process."""

import signal
import subprocess
import sys

from kernels_on_disk import hits, modules

from tcc_sim.compiling import kernel_cache

ALONE = """
import os, signal, sys
sys.path.insert(0, {folder!r})
from tcc_sim.compiling import kernel_cache
import {name}
if {killed}:
    os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
else:
    print(flush=True)
    sys.stdin.readline()
assert {name}.kernel(3.0) == 7.0
"""


def alone(folder, name, killed=False):
    """A process that calls the kernel of a module once a line has come."""
    return subprocess.Popen([sys.executable, "-c", ALONE.format(folder=str(folder), name=name, killed=killed)],
                            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def test_two_processes_keep_one_kernel_at_once(cache, tmp_path):
    modules(tmp_path, name="twice")
    both = [alone(tmp_path, "twice_caller") for _ in range(2)]
    for process in both:
        process.stdout.readline()
    for process in both:
        process.stdin.write("\n")
        process.stdin.flush()
    for process in both:
        process.communicate()
    assert [process.returncode for process in both] == [0, 0]
    assert len(list(cache.iterdir())) == 1


def test_a_process_killed_while_it_writes_leaves_nothing_that_is_loaded(cache, tmp_path):
    modules(tmp_path, name="killed")
    process = alone(tmp_path, "killed_caller", killed=True)
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    (left,) = cache.iterdir()
    kernel = modules(tmp_path, name="killed")
    assert (kernel(3.0), hits(kernel)) == (7.0, 0)
    made_in = left.stat().st_mtime
    kernel_cache.remove_unused(cache, made_in + 0.9 * 86400.0)
    assert left.exists()
    kernel_cache.remove_unused(cache, made_in + 1.1 * 86400.0)
    assert not left.exists()
    kernel = modules(tmp_path, name="killed")
    assert (kernel(3.0), hits(kernel)) == (7.0, 1)
