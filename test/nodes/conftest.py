from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
from benches import Bench

from tcc_sim.nodes.children import Domain, NodeProcess
from tcc_sim.nodes.executables import status_of
from tcc_sim.nodes.shared_memory import remove_ownerless


@pytest.fixture(autouse=True, scope="session")
def ownerless_segments_are_gone() -> None:
    """Remove files in shared memory that killed processes of other tests left; they could hang a new node."""
    remove_ownerless()


@pytest.fixture(autouse=True, scope="session")
def profile(discovery: Callable[[str], str]) -> Iterator[None]:
    """Set the profile before the first participant of this process, since Fast DDS reads it once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FASTDDS_DEFAULT_PROFILES_FILE", discovery(""))
        yield


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture
def entered(monkeypatch: pytest.MonkeyPatch,
            capfd: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Function that runs a node in a thread of this process, which keeps its signals; status, output and messages."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")

    def run(module: str, *words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", [f"{module}_node", *map(str, words)])
        with ThreadPoolExecutor(1) as thread:
            return (thread.submit(status_of, module).result(), *capfd.readouterr())

    return run


@pytest.fixture(scope="session")
def domain() -> Iterator[str]:
    """ROS domain that no other test process or command uses until this process ends."""
    mine = Domain()
    yield str(mine.number)
    mine.close()


@pytest.fixture(scope="session")
def discovery(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], str]:
    """Return a function that writes a profile for Fast DDS: a participant announces itself five times a second instead
    of every 3 s, a silent one counts as gone after `lease` seconds instead of 20, and a publisher asks for
    acknowledgements every 0.05 s instead of every 3 s.
    """
    folder = tmp_path_factory.mktemp("discovery")

    def written(lease: str = "") -> str:
        duration = f"<leaseDuration><sec>{lease}</sec></leaseDuration>" if lease else ""
        file = folder / f"lease_{lease}.xml"
        file.write_text(f"""<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com"><profiles><participant profile_name="quick" is_default_profile="true"><rtps>
<builtin><discovery_config>{duration}<leaseAnnouncement><sec>0</sec><nanosec>200000000</nanosec></leaseAnnouncement>
</discovery_config></builtin></rtps></participant>
<data_writer profile_name="asking" is_default_profile="true"><times><heartbeat_period><sec>0</sec>
<nanosec>50000000</nanosec></heartbeat_period></times></data_writer></profiles></dds>
""")
        return str(file)

    return written


@pytest.fixture
def start(domain: str, discovery: Callable[[str], str]) -> Iterator[Callable[..., NodeProcess]]:
    """Function that starts nodes in separate processes on a separate domain; none outlives the test."""
    processes: list[NodeProcess] = []

    def begin(module: str, lease: str = "", **parameters: object) -> NodeProcess:
        processes.append(NodeProcess(module, parameters, {
            **os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": domain,
            "FASTDDS_DEFAULT_PROFILES_FILE": discovery(lease)}))
        return processes[-1]

    yield begin
    for process in processes:
        process.kill()
