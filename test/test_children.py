"""Processes that a command starts: no working directory decides what they run, and none outlives its parent."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import pytest

from tcc_sim.nodes.children import CLOCK_STARTED, NodeProcess, private_environment
from tcc_sim.sweeps.executors import each_in_a_process


@pytest.fixture
def namesakes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in a directory with a file named as each module of Python, and as the packages that nodes import."""
    for name in (*sys.stdlib_module_names, "numpy", "numba", "yaml", "mcap", "rclpy", "std_msgs", "tcc_sim"):
        (tmp_path / f"{name}.py").write_text(f"raise SystemExit('{name} of the working directory')\n")
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("node", ["driveline", "recorder"])
@pytest.mark.usefixtures("namesakes")
def test_a_node_runs_this_package_whatever_the_working_directory_holds(node: str) -> None:
    pytest.importorskip("rclpy", reason="ROS 2 is not installed")
    environment, release = private_environment()
    running = {"driveline": CLOCK_STARTED, "recorder": "recording"}
    process = NodeProcess(node, {"scene": "minimal"} if node == "driveline" else {}, environment)
    try:
        process.await_line(running[node])
        assert process.stop() == 0, process.lines
        assert not any("working directory" in line for line in process.lines)
    finally:
        process.kill()
        release()


@pytest.mark.skipif(sys.version_info < (3, 11), reason="Python 3.10 has no safe path")
@pytest.mark.usefixtures("namesakes")
def test_processes_of_a_sweep_run_their_modules_whatever_the_working_directory_holds() -> None:
    assert each_in_a_process(math.sqrt, [4.0, 9.0], jobs=2) == [2.0, 3.0]
