"""A signal at any time of a node's life, from its first statement on: status 0, no traceback, no files left behind.
During the node's creation, a few hundredths of a second, the signal itself ends the process.

The tests recognise the stage of a process by its blocked SIGTERM, its mapped libraries and its processor time.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from interpreter import environment, python
from waiting import until_or_ended

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from tcc_sim.nodes import executables

LIBRARIES = 130
"""About the number of shared libraries of a running driveline."""
COMPILES = 1.5
"""Processor time, s, after which a driveline with an empty cache compiles."""


def started(module: str, domain: str, folder: Path, *words: str, **more: str) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-m", f"tcc_sim.nodes.{module}", *words], cwd=folder, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment(
                                ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST", ROS_DOMAIN_ID=domain, **more))


def taken(process: subprocess.Popen[str]) -> bool:
    """Return whether the process has blocked SIGTERM, for which a thread of it waits."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    blocked = int(status.split("SigBlk:")[1].split()[0], 16)
    return bool(blocked >> (signal.SIGTERM - 1) & 1)


def libraries(process: subprocess.Popen[str]) -> int:
    """Number of mapped shared libraries."""
    maps = Path(f"/proc/{process.pid}/maps").read_text()
    return len({line.split()[-1] for line in maps.splitlines() if ".so" in line})


def spent(process: subprocess.Popen[str]) -> float:
    """Processor time so far, s."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def ended_by(process: subprocess.Popen[str], number: signal.Signals) -> None:
    """Send the signal and judge the end."""
    process.send_signal(number)
    try:
        _, said = process.communicate(timeout=300)
    finally:
        process.kill()
    assert process.returncode in (0, -number), said
    assert "Traceback" not in said
    assert "Exception" not in said


def moments(module: str, count: int, seed: int) -> list[tuple[str, signal.Signals, int]]:
    draw = random.Random(seed)
    numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
    return [(module, draw.choice(numbers), draw.randint(0, LIBRARIES)) for _ in range(count)]


@pytest.mark.parametrize(("module", "number", "mapped"), [
    ("driveline", signal.SIGTERM, 0), ("recorder", signal.SIGINT, 0), *moments("driveline", 2, 1),
    *moments("slip_controller", 1, 3)])
def test_a_signal_while_it_loads_ends_a_node_with_status_0(module: str, number: signal.Signals, mapped: int,
                                                           domain: str, tmp_path: Path) -> None:
    process = started(module, domain, tmp_path)
    try:
        until_or_ended(lambda: taken(process) and (libraries(process) >= mapped or spent(process) > 20.0), process)
    finally:
        if process.poll() is not None:
            process.kill()
    ended_by(process, number)


def test_a_signal_while_it_compiles_ends_the_driveline_at_once(domain: str, tmp_path: Path) -> None:
    """With an empty cache of compiled code. LLVM does not check for signals; Numba would report them as errors."""
    process = started("driveline", domain, tmp_path, XDG_CACHE_HOME=str(tmp_path / "empty"))
    until_or_ended(lambda: taken(process) and libraries(process) >= 90 and spent(process) >= COMPILES, process)
    ended_by(process, signal.SIGINT)


@pytest.mark.parametrize("ignored", [True, False])
def test_a_node_under_nohup_outlives_its_terminal(ignored: bool) -> None:
    before = "signal.signal(signal.SIGHUP, signal.SIG_IGN)" if ignored else "pass"
    code = (f"import os, signal\n{before}\nfrom tcc_sim.nodes import executables\nexecutables.take()\n"
            "os.kill(os.getpid(), signal.SIGHUP)\nif signal.getsignal(signal.SIGHUP) is signal.SIG_IGN: os._exit(7)\n"
            "signal.pause()\n")
    assert python("-c", code).returncode == (7 if ignored else 0)


ASKED = """
from tcc_sim.nodes import executables
executables.take()
import os, signal
from tcc_sim.nodes.executables import {module}_node
leave = executables.end_in_order

def left():
    leave()
    os.kill(os.getpid(), signal.{number})

executables.end_in_order = left
import sys
sys.argv += ["--ros-args", *{words!r}]
{module}_node()
"""


@pytest.mark.parametrize(("module", "words", "number"), [
    ("driveline", ["-p", "scene:=minimal"], "SIGHUP"), ("recorder", ["-p", "output:=run"], "SIGTERM")])
def test_a_signal_as_soon_as_a_node_ends_in_order_ends_it_so(module: str, words: list[str], number: str,
                                                             tmp_path: Path) -> None:
    ended = python("-c", ASKED.format(module=module, words=words, number=number), cwd=tmp_path,
                   ROS_AUTOMATIC_DISCOVERY_RANGE="OFF")
    assert ended.returncode == 0, ended.stderr
    for sign in ("Traceback", "Exception", "Failed to publish"):
        assert sign not in ended.stderr
    assert (tmp_path / "run" / "metadata.yaml").exists() == (module == "recorder")


def test_ctrl_c_in_a_command_waits_for_what_must_be_whole() -> None:
    before = signal.getsignal(signal.SIGINT)
    done = []

    def hold() -> None:
        with executables.deferred():
            signal.raise_signal(signal.SIGINT)
            done.append("whole")

    with pytest.raises(KeyboardInterrupt):
        hold()
    assert (done, signal.getsignal(signal.SIGINT)) == (["whole"], before)


@pytest.mark.parametrize("command", ["driveline_node", "slip_controller_node", "recorder_node"])
def test_the_entry_points_take_the_signals_before_they_load_anything_slow(command: str) -> None:
    """As by `ros2 run` and from the path: the console script imports a function and calls it."""
    code = ("import sys, os, signal\n"
            "before = set(sys.modules)\n"
            f"from tcc_sim.nodes.executables import {command}\n"
            "class Look:\n"
            "    def find_spec(self, name, path=None, target=None):\n"
            "        if name.split('.')[0] in ('numpy', 'numba', 'rclpy', 'yaml', 'scipy'):\n"
            "            from tcc_sim.nodes import executables\n"
            "            print(name, *(n.name for n in executables.ENDING if n in signal.pthread_sigmask(0, [])))\n"
            "            sys.stdout.flush()\n"
            "            os._exit(7)\n"
            "sys.meta_path.insert(0, Look())\n"
            f"sys.argv = ['{command}']\n"
            f"{command}()\n")
    ended = python("-c", code)
    assert ended.returncode == 7, ended.stderr
    assert ended.stdout.split()[1:] == ["SIGINT", "SIGTERM", "SIGHUP"]
