"""The time that a solve says it took is that of solving."""

import os
import subprocess
import sys

import pytest

from tcc_sim.solvers import SOLVERS

PROGRAM = """
import sys, time
from numba.core.dispatcher import Dispatcher
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve

def compiled_so_far():
    modules = [m for name, m in list(sys.modules.items()) if name.startswith("tcc_sim")]
    found = {id(f): f for m in modules for f in vars(m).values() if isinstance(f, Dispatcher)}
    return sum(len(f.overloads) for f in found.values())

counts, clock = [], time.perf_counter
def perf_counter():
    counts.append(compiled_so_far())
    return clock()
time.perf_counter = perf_counter
name = sys.argv[1]
law = "set_valued" if name == "event_driven" else "smoothed"
run = solve(replace(System(), {"friction.law": law}), cycles=1, solver=name)
assert run.status.name == "DONE" and run.statistics.seconds > 0.0
sys.exit(0 if len(counts) >= 2 and counts[0] == counts[-1] > 0 else f"compiled functions at each look at the clock: {counts}")
"""


@pytest.mark.parametrize("name", [n for n in SOLVERS if n not in ("radau", "bdf", "dop853", "rk45")])
def test_nothing_is_compiled_or_loaded_while_the_clock_runs(name):
    ended = subprocess.run([sys.executable, "-c", PROGRAM, name], capture_output=True, text=True, check=False,
                           timeout=120,
                           env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)})
    assert ended.returncode == 0, ended.stderr
