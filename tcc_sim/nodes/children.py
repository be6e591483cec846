"""Start driveline and recorder as processes on this machine in an unused ROS domain, and Rerun's viewer for a browser
on the loopback address, without rclpy.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

from tcc_sim.errors import InputError, MissingPackage, TccError, require

PACKAGE = Path(__file__).parents[1]
"""Directory of this package."""
_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1
CLOCK_STARTED = "clock started"
"""Log line of the driveline node when its first tick is due."""
START_LIMIT = 120.0
"""Largest real time of a start, s, mostly for the first compilation of the kernels on a busy machine."""
LOOK = 0.05
"""Real time between two looks at the lines of a process that starts, s."""
END_LIMIT = 60.0
"""Largest real time for a process to end before it is killed, s."""
DOMAINS = range(1, 102)
"""ROS domains to choose from; up to 101 their ports do not overlap the ephemeral ports of Linux."""
PRIORITIES = 40, 30, 20
"""SCHED_FIFO priorities of driveline, sender of commands and recorder."""
FIRST_PORT, PORTS = 7400, 250
"""First UDP port of domain 0 and number of UDP ports of a domain, from the DDS standard."""
ADDRESS = "127.0.0.1"
"""Address of the viewer and its data; it is not reachable from the network."""
PAGE_PORT, DATA_PORT = 9090, 9876
"""Rerun's default ports, used if they are free."""
HOSTING, LISTENING = "Hosting a web-viewer", "Listening for gRPC connections"
"""Log lines of Rerun once it serves the page and accepts data."""


def require_ros() -> None:
    """Raise MissingPackage if rclpy or a message package is not installed."""
    for name in ("rclpy", "std_msgs", "sensor_msgs", "diagnostic_msgs", "rosgraph_msgs", "std_srvs"):
        if importlib.util.find_spec(name) is None:
            raise MissingPackage(f"ROS 2 package {name} is not installed: source your ROS 2, or pip install "
                                 "'tcc_sim[ros]'")


class Domain:
    """An unused ROS domain, reserved on this machine until it is closed or the process ends.

    A participant binds ports of its domain, so a domain with a bound port is in use. An abstract socket with a name
    reserves the domain against processes that choose at the same time and have no participant yet.

    Raises TccError: every domain is in use.
    """

    def __init__(self, domains: Sequence[int] = DOMAINS) -> None:
        self._guard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        taken: set[int] = set()
        for table in Path("/proc/net/udp"), Path("/proc/net/udp6"):
            with suppress(OSError):
                ports = (int(line.split()[1].rpartition(":")[2], 16) for line in table.read_text().splitlines()[1:])
                taken.update((port - FIRST_PORT) // PORTS for port in ports)
        for number in secrets.SystemRandom().sample(domains, len(domains)):
            if number not in taken:
                with suppress(OSError):
                    self._guard.bind(f"\0tcc_sim_domain_{number}")
                    self.number = number
                    return
        self._guard.close()
        raise TccError(f"every ROS domain from {domains[0]} to {domains[-1]} is in use on this machine; set "
                       "ROS_DOMAIN_ID")

    def close(self) -> None:
        """Release the domain."""
        self._guard.close()


def private_environment() -> tuple[dict[str, str], Callable[[], None]]:
    """Return environment variables for child processes, and a function that releases them: discovery is limited to this
    machine, and the domain is unused unless the user set one.
    """
    values = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", **os.environ}
    if "ROS_DOMAIN_ID" in values:
        return values, lambda: None
    domain = Domain()
    return {**values, "ROS_DOMAIN_ID": str(domain.number)}, domain.close


class ChildProcess(subprocess.Popen[str]):
    """Child process whose lines on standard error are stored."""

    def __init__(self, name: str, command: Sequence[str], environment: dict[str, str]) -> None:
        self.name = name
        # In a new session Ctrl-C on the terminal reaches only the parent, which ends its children in order.
        super().__init__(command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                         stderr=subprocess.PIPE, text=True, errors="replace", start_new_session=True,
                         preexec_fn=end_with_parent())
        self.lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.stderr is not None
        for line in self.stderr:
            self.lines.append(line.rstrip("\n"))

    def await_line(self, text: str) -> None:
        """Wait until a line contains `text`; raise TccError if the process ends or START_LIMIT passes first."""
        end = time.monotonic() + START_LIMIT
        while not self.has_said(text) and self._reader.is_alive() and time.monotonic() < end:
            self._reader.join(LOOK)
        if not self.has_said(text):
            self.check()
            raise TccError(f"{self.name} did not start within {START_LIMIT:g} s")

    def has_said(self, text: str) -> bool:
        """Return whether a line contains `text`."""
        return any(text in line for line in self.lines)

    def check(self) -> None:
        """Raise TccError with the last line if the process has ended."""
        status = self.poll()
        if status is not None:
            self._reader.join(timeout=1.0)
            raise TccError(f"{self.name} ended with status {status}: "
                           f"{self.lines[-1] if self.lines else 'no output'}")

    def stop(self) -> int:
        """End the process with SIGINT, or kill it after END_LIMIT, and return its exit status."""
        self.send_signal(signal.SIGINT)
        try:
            status = super().wait(timeout=END_LIMIT)
        except subprocess.TimeoutExpired:
            super().kill()
            status = super().wait()
        self._reader.join(timeout=1.0)
        return status

    def kill(self) -> None:
        """Kill the process and wait for its end."""
        super().kill()
        self.wait()

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the process to end and return its exit status; `lines` is then complete."""
        status = super().wait(timeout)
        self._reader.join()
        return status


class NodeProcess(ChildProcess):
    """Child process that runs a node of this package: of this process's files, whatever the working directory holds.

    Python puts the working directory first on the path of `-m` and `-c`, so a file `queue.py` there would end the node.

    node : driveline, recorder, slip_controller or commander
    priority : SCHED_FIFO priority; 0 for none
    """

    def __init__(self, node: str, parameters: dict[str, object], environment: dict[str, str],
                 priority: int = 0) -> None:
        words = [word for key, value in parameters.items() for word in (
            "-p", f"{key}:={str(value).lower() if isinstance(value, bool) else value}")]
        code = (f"import sys; sys.path[:] = [{str(PACKAGE.parent)!r}, *filter(None, sys.path)]; import tcc_sim; "
                f"del sys.path[0]; from tcc_sim.nodes.executables import run; run({node!r})")
        super().__init__(node, [sys.executable, "-c", code, "--ros-args", *words], environment)
        if priority:
            with suppress(OSError):  # It may have ended.
                os.sched_setscheduler(self.pid, os.SCHED_FIFO, os.sched_param(priority))


class Session:
    """A driveline node with a recorder node, started so that the recording holds the first message.

    Raises MissingPackage: ROS 2 is not installed. Raises TccError: a node did not start; the message has its last line.

    recording : directory that the recorder creates
    controller : node of this package that sends commands, with its parameters, or the words of a command that starts a
        controller; None for no controller. The driveline waits until the controller subscribes to joint_states.
    real_time : whether the nodes of this package run under SCHED_FIFO, where the system grants it
    """

    def __init__(self, recording: Path, driveline: dict[str, object],
                 controller: tuple[str, dict[str, object]] | list[str] | None = None, real_time: bool = False) -> None:
        require_ros()
        self.environment, self._release = private_environment()
        self.controllers: list[ChildProcess] = []
        priorities = PRIORITIES if real_time and grants_priority() else (0, 0, 0)
        if isinstance(controller, tuple):
            self.controllers.append(NodeProcess(*controller, self.environment, priorities[1]))
        elif controller is not None:
            try:
                self.controllers.append(ChildProcess(" ".join(controller), controller, self.environment))
            except OSError as error:
                raise InputError(f"{controller[0]}: {error.strerror}") from None
        self.recorder = NodeProcess("recorder", {"output": str(recording)}, self.environment, priorities[2])
        parameters = {"wait_for_subscribers": 1 + len(self.controllers)} | (
            {"thread_priority": priorities[0]} if any(priorities) else {})
        self.driveline = NodeProcess("driveline", {**driveline, **parameters}, self.environment)
        try:
            self._await_clock()
        except BaseException:
            self.stop()
            raise

    def stop(self) -> None:
        """End the driveline, then the controller, then the recorder, so that the recording is complete."""
        for process in (self.driveline, *self.controllers, self.recorder):
            process.stop()
        self._release()

    def watch(self, seconds: float) -> None:
        """Sleep, then raise TccError with the last line of a node that has ended."""
        time.sleep(seconds)
        for process in (self.recorder, *self.controllers, self.driveline):
            process.check()

    def _await_clock(self) -> None:
        """Wait for the first tick, and pass on that kernels are compiled; raise TccError if a node ends first."""
        end, compiling = time.monotonic() + START_LIMIT, ""
        while not self.driveline.has_said(CLOCK_STARTED):
            self.watch(LOOK)
            if not compiling:
                compiling = next((line for line in self.driveline.lines if line.startswith("tcc-sim: ")), "")
                sys.stderr.write(f"{compiling}\n" if compiling else "")
            if time.monotonic() > end:
                waits = "; no controller subscribes to joint_states" if self.controllers else ""
                raise TccError(f"the driveline's first tick did not come within {START_LIMIT:g} s{waits}")


def grants_priority() -> bool:
    """Return whether the system lets this process run children under SCHED_FIFO and leaves a core to others."""
    if sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2:
        return False
    policy, level = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except OSError:
        return False
    os.sched_setscheduler(0, policy, level)
    return True


def end_with_parent(number: signal.Signals = signal.SIGINT) -> Callable[[], None]:
    """Return a `preexec_fn` with which Linux sends a child this signal when the thread that started it ends.

    So a command that is killed leaves no node behind. A child whose parent has ended before sends it to itself.
    """
    parent = os.getpid()

    def ask() -> None:
        """Ask Linux for the signal."""
        if sys.platform == "linux":
            _LIBC.prctl(_PR_SET_PDEATHSIG, number)
            if os.getppid() != parent:
                os.kill(os.getpid(), number)

    return ask


@contextmanager
def web_viewer() -> Iterator[tuple[str, str]]:
    """Serve Rerun's viewer on the loopback address for the duration of a `with` block; yield its address for a browser
    and that for a stream of data.

    Raises MissingPackage: rerun-sdk is not installed. Raises TccError: Rerun does not start.
    """
    require("rerun", "Rerun")
    program = _program()
    page, data = _free_port(PAGE_PORT), _free_port(DATA_PORT)
    server = ChildProcess("rerun", [program, "--serve-web", "--bind", ADDRESS, "--port", str(data),
                                    "--web-viewer-port", str(page), "--hide-welcome-screen"], dict(os.environ))
    try:
        for line in (HOSTING, LISTENING):
            server.await_line(line)
        url = f"rerun+http://{ADDRESS}:{data}/proxy"
        yield f"http://{ADDRESS}:{page}/?url={quote(url, safe='')}", url
    finally:
        server.kill()


def _program() -> str:
    """Return the viewer's program in rerun-sdk itself, since killing the script on the path would leave it running."""
    spec = importlib.util.find_spec("rerun_cli")
    for folder in (spec.submodule_search_locations or ()) if spec is not None else ():
        if (Path(folder) / "rerun").is_file():
            return str(Path(folder) / "rerun")
    program = shutil.which("rerun")
    if program is None:
        raise TccError("the program rerun, which comes with rerun-sdk, is not installed")
    return program


def _free_port(wanted: int) -> int:
    for port in (wanted, 0):
        with socket.socket() as probe, suppress(OSError):
            probe.bind((ADDRESS, port))
            return int(probe.getsockname()[1])
    raise TccError(f"no port of {ADDRESS} is free")
