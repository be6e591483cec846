"""The reported time of a solve is that of solving."""

import os
import subprocess
import sys

from tcc_sim.solvers import SOLVERS

PROGRAM = """
import os, sys, time
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import SOLVERS, solve
from tcc_sim.compiling.compiled import Kernel
import tcc_sim.compiling.linked  # Numba looks at the clock too.

def compiled_so_far():
    modules = [m for name, m in list(sys.modules.items()) if name.startswith("tcc_sim")]
    found = {id(f): f for m in modules for f in vars(m).values() if isinstance(f, Kernel)}
    return sum(len(f.entries) for f in found.values())

counts, clock = [], time.perf_counter
def perf_counter():
    counts.append(compiled_so_far())
    return clock()
time.perf_counter = perf_counter

def check(name):
    law = "set_valued" if name == "event_driven" else "smoothed"
    run = solve(replace(System(), {"friction.law": law}), cycles=1, solver=name)
    assert run.status.name == "DONE" and run.statistics.seconds > 0.0
    return len(counts) >= 2 and counts[0] == counts[-1] > 0

for name in sys.argv[1:]:
    SOLVERS[name].load()
assert compiled_so_far() == 0
for name in sys.argv[1:]:  # Each in a process that has solved nothing yet.
    child = os.fork()
    if not child:
        fine = check(name)
        print(name, "" if fine else f"compiled functions at each look at the clock: {counts}", flush=True)
        os._exit(0 if fine else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
"""


def test_nothing_is_compiled_or_loaded_while_the_clock_runs():
    names = [n for n in SOLVERS if n not in ("radau", "bdf", "dop853")]
    ended = subprocess.run([sys.executable, "-c", PROGRAM, *names], capture_output=True, text=True, check=False,
                           timeout=300, env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)})
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert ended.stdout.split() == names
