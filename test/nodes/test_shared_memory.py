"""Files that a killed process left in Fast DDS's shared memory hang no later node."""

from __future__ import annotations

import fcntl
import mmap
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tcc_sim.errors import TccError
from tcc_sim.nodes.children import CLOCK_STARTED, Domain, NodeProcess
from tcc_sim.nodes.shared_memory import FOLDER, clear, remove_ownerless, unfinished

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

PORT_BYTES = 52400
"""Of a port's segment."""


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_what_no_process_holds_is_removed_and_the_rest_stays(tmp_path: Path) -> None:
    left = {"fastdds_port28911", "fastdds_port28913", "fastdds_port28913_el", "sem.fastdds_port28913_mutex",
            "fastdds_0123456789abcdef", "fastdds_0123456789abcdef_el"}
    held = {"fastdds_port28915", "fastdds_port28915_el", "fastdds_fedcba9876543210", "fastdds_fedcba9876543210_sl"}
    mapped = {"fastdds_port28917", "fastdds_port28919_el", "sem.fastdds_port28919_mutex"}
    foreign = {"fastdds_port28911.txt", "fastdds_portable", "lttng-ust-wait-6", "sem.other"}
    for name in left | held | mapped | foreign:
        (tmp_path / name).write_bytes(bytes(64))
    with ((tmp_path / "fastdds_port28915_el").open("r+b") as one, open(tmp_path / "fastdds_fedcba9876543210_sl") as two,
          (tmp_path / "fastdds_port28917").open("r+b") as three,
          (tmp_path / "sem.fastdds_port28919_mutex").open("r+b") as four):
        fcntl.flock(one, fcntl.LOCK_EX)
        fcntl.flock(two, fcntl.LOCK_SH)
        with mmap.mmap(three.fileno(), 64), mmap.mmap(four.fileno(), 64):
            removed = remove_ownerless(tmp_path)
    assert set(removed) == left
    assert names(tmp_path) == held | mapped | foreign


@pytest.fixture
def domain() -> Iterator[str]:
    """ROS domain of one test: in that of the session a killed process may have left the port's file."""
    own = Domain()
    yield str(own.number)
    own.close()


@pytest.fixture
def begun(domain: str) -> Iterator[Path]:
    """Unfinished file of a dead process for the port that the first participant of the domain opens."""
    port = FOLDER / f"fastdds_port{7411 + 250 * int(domain)}"
    port.unlink(missing_ok=True)  # Nobody is in the domain.
    with port.open("xb") as file:
        file.truncate(PORT_BYTES)
    yield port
    port.unlink(missing_ok=True)


def test_a_node_starts_where_a_process_was_killed_while_it_created_its_participant(begun: Path, domain: str) -> None:
    assert begun in unfinished(int(domain))
    node = NodeProcess("driveline", {"scene": "minimal"}, {**os.environ, "ROS_DOMAIN_ID": domain,
                                                           "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"})
    try:
        node.await_line(CLOCK_STARTED)
        node.send_signal(signal.SIGTERM)
        assert node.wait() == 0
    finally:
        node.kill()
    assert any("scene minimal, 1000 Hz" in line for line in node.lines)
    assert not any(word in line for line in node.lines for word in ("Traceback", "Exception"))


HANGS = """
import ctypes, sys
from tcc_sim.nodes import executables
if sys.argv[1] == "node":
    executables.take()
executables.left_to_the_system(lambda: (print("creates", flush=True), ctypes.PyDLL(None).sleep(3600)))
"""


@pytest.mark.parametrize("who", ["node", "command"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_process_that_hangs_in_the_middleware(who: str, number: signal.Signals) -> None:
    """A call of `PyDLL` holds the interpreter, as the middleware does."""
    hung = subprocess.Popen([sys.executable, "-c", HANGS, who], stdout=subprocess.PIPE, text=True)
    assert hung.stdout is not None
    assert hung.stdout.readline() == "creates\n"
    hung.send_signal(number)
    assert (hung.stdout.read(), hung.wait()) == ("", -number)


def test_a_port_that_a_stopped_process_has_begun_is_named_instead_of_waited_for(begun: Path, domain: str) -> None:
    with begun.open("r+b") as file, mmap.mmap(file.fileno(), PORT_BYTES):  # Held, so that it cannot be removed.
        with pytest.raises(TccError, match=f"would wait for {begun}, which a stopped process has left unfinished"):
            clear(int(domain), within=0.01)
        assert begun.exists()
    clear(int(domain), within=0.01)
    assert not begun.exists()
