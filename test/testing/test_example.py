"""The page on testing shows the example project as it is, and the project's tests pass beside each other, from outside.

`python test/testing/test_example.py` writes the page's code anew. `.ci/run` installs the project in an environment of
its own.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from importlib.metadata import entry_points
from pathlib import Path

import pytest
from interpreter import python

from tcc_sim.plant.driveline import Reading

EXAMPLE = Path(__file__).resolve().parent / "example"
PAGE = Path(__file__).resolve().parents[2] / ".github" / "guide" / "testing.md"
BLOCK = re.compile(r"^```(\w+) (\S+)\n(.*?)^```", re.DOTALL | re.MULTILINE)
PYTEST = "import sys; sys.path.remove(''); import pytest; sys.exit(pytest.main(sys.argv[1:]))"
"""The program `pytest`, which does not see the folder that it runs in, unlike `python -m pytest`."""
installed = pytest.mark.skipif(not [entry for entry in entry_points(group="pytest11") if entry.name == "tcc_sim"],
                               reason="the package is not installed, so pytest does not know its plugin")


def outside(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run pytest in a folder that knows nothing of this project."""
    return python("-c", PYTEST, "-q", "-p", "no:cacheprovider", *words, cwd=folder, PYTHONPATH="")


def test_the_page_shows_the_files_of_the_example() -> None:
    shown = {name: text for _, name, text in BLOCK.findall(PAGE.read_text())}
    assert shown == {name: (EXAMPLE / name).read_text() for name in shown}
    files = {str(path.relative_to(EXAMPLE)) for pattern in ("*/*.py", "*.*") for path in EXAMPLE.glob(pattern)}
    assert set(shown) == {name for name in files if not name.startswith(".")}


def test_the_page_names_every_field_of_a_reading() -> None:
    text = PAGE.read_text()
    assert all(f"`{name}`" in text for name in Reading.__annotations__)


LEAVES = """
import os
import threading


def test_one(driveline):
    import rclpy

    assert rclpy.ok()
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "OFF"
    driveline("fig02").run(ticks=3)


def test_two():
    import rclpy

    assert not rclpy.ok()
    assert "ROS_AUTOMATIC_DISCOVERY_RANGE" not in os.environ
    assert [thread.name for thread in threading.enumerate()] == ["MainThread"]


def test_three(driveline):
    driveline("controlled", patience=0.2).run(ticks=1)
"""


FIRST = """
import pytest
import rclpy


@pytest.fixture(params=["SUBNET", "LOCALHOST", "OFF"])
def mine(request, monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", request.param)
    monkeypatch.setenv("ROS_DOMAIN_ID", "93")
    rclpy.init()
    yield
    rclpy.shutdown()


def test_four(mine, driveline):
    driveline("fig02").run(ticks=3)
"""


@installed
def test_a_test_leaves_nothing_behind_and_where_it_has_initialised_ros_others_must_be_unseen(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the example's folder, beside tests of its own that pass; `.ci/run` runs them all."""
    pytest.importorskip("rclpy", reason="ROS 2 is not installed")
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    shutil.copytree(EXAMPLE, tmp_path / "example")
    (tmp_path / "example" / "tests" / "test_a.py").write_text(LEAVES)
    (tmp_path / "example" / "tests" / "test_b.py").write_text(FIRST)
    ended = outside(tmp_path / "example", "-rA", "-k", "not faults and not sensors and not timer and not node")
    assert re.findall(r"^PASSED \S+::(\S+)", ended.stdout, re.MULTILINE) == [
        "test_one", "test_two", "test_four[OFF]", "test_the_law_holds_its_target"]
    for sentence, times in (("leave rclpy.init() to the fixture, or set ROS_AUTOMATIC_DISCOVERY_RANGE=OFF before", 2), (
            "ControllerFailed: no node under test publishes actuation_pressure, which the scene controlled takes", 1)):
        assert len(re.findall(rf"^E .*{re.escape(sentence)}", ended.stdout, re.MULTILINE)) == times


INTERRUPTED = """
import os, signal, time, rclpy
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState
spin, nodes, message = rclpy.spin, SingleThreadedExecutor.get_nodes, JointState.__init__

def signalled():
    if rclpy.ok():
        os.kill(os.getpid(), number)
    while rclpy.ok():
        time.sleep(0.001)

def before_the_wait_set(executor):
    signalled()
    return nodes(executor)

def converted(self, **fields):
    message(self, **fields)
    if not fields:
        signalled()

def interrupted(node):
    sent = node.create_publisher(JointState, "joint_states", 10)
    if place == "wait set":
        SingleThreadedExecutor.get_nodes = before_the_wait_set
    else:
        JointState.__init__ = converted
        node.create_timer(0.001, lambda: sent.publish(JointState(velocity=[1.0, 2.0])))
    spin(node)

rclpy.spin = interrupted
place, number = "{place}", signal.{number}
{code}
"""


@pytest.mark.parametrize(("place", "number"), [("conversion", "SIGINT"), ("wait set", "SIGTERM")])
def test_the_node_ends_by_a_signal_without_a_traceback(place: str, number: str) -> None:
    """Also where the context ends between two calls of rclpy, or within one that would swallow a KeyboardInterrupt."""
    pytest.importorskip("rclpy", reason="ROS 2 is not installed")
    script = INTERRUPTED.format(place=place, number=number, code="from my_clutch.node import main; main()")
    ended = python("-c", script, cwd=EXAMPLE, PYTHONPATH="", ROS_AUTOMATIC_DISCOVERY_RANGE="OFF")
    assert (ended.returncode, ended.stderr) == (0, "")


@installed
def test_without_ros_the_plugin_is_silent(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text("import sys\nsys.modules['rclpy'] = None\n")
    (tmp_path / "test_mine.py").write_text("def test_one(driveline): pass\n\n\ndef test_two(): pass\n")
    ended = outside(tmp_path, "-rs", "-W", "error")
    assert "1 passed, 1 skipped" in ended.stdout
    assert "ROS 2 is not installed" in ended.stdout
    assert ended.stderr == ""


if __name__ == "__main__":
    PAGE.write_text(BLOCK.sub(lambda match: f"```{match[1]} {match[2]}\n{(EXAMPLE / match[2]).read_text()}```",
                              PAGE.read_text()))
