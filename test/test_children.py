"""A test run that is killed leaves no process behind."""

import os
import signal
import subprocess
import sys
from pathlib import Path

from interpreter import environment
from waiting import until

PARENT = """
import os, subprocess, sys
from interpreter import end_children_with_this_process
end_children_with_this_process()
words = [sys.executable, "-c", "import os, sys, threading; print(os.getpid(), flush=True); threading.Event().wait()"]
child = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, start_new_session=True)
print(child.stdout.readline(), flush=True)
os.read(0, 1)
"""


def test_a_killed_test_run_leaves_no_process_behind() -> None:
    """Not even one in a session of its own, as nodes are."""
    parent = subprocess.Popen([sys.executable, "-c", PARENT], env=environment(), stdin=subprocess.PIPE,
                              stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    os.kill(child, 0)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    until(lambda: not Path(f"/proc/{child}").exists() or "State:\tZ" in Path(f"/proc/{child}/status").read_text())
