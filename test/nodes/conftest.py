from __future__ import annotations

import os
from collections.abc import Callable, Iterator

import pytest
from benches import Bench

from tcc_sim.nodes.children import Domain, NodeProcess
from tcc_sim.nodes.shared_memory import remove_ownerless


@pytest.fixture(autouse=True, scope="session")
def ownerless_segments_are_gone() -> None:
    """What other tests' killed processes left in shared memory hangs nobody who creates a node without more ado."""
    remove_ownerless()


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture(scope="session")
def domain() -> Iterator[str]:
    """A ROS domain where nobody else is, whatever test process or command, until this process ends."""
    mine = Domain()
    yield str(mine.number)
    mine.close()


@pytest.fixture(scope="session")
def discovery(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], str]:
    """Gives a file with which Fast DDS announces a participant five times a second: by itself it does so every 3 s, for
    which whoever looks for a node waits. It takes a participant without a word for gone after so many seconds, 20 by
    itself.
    """
    folder = tmp_path_factory.mktemp("discovery")

    def written(lease: str = "") -> str:
        duration = f"<leaseDuration><sec>{lease}</sec></leaseDuration>" if lease else ""
        file = folder / f"lease_{lease}.xml"
        file.write_text(f"""<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com"><profiles><participant profile_name="quick" is_default_profile="true"><rtps>
<builtin><discovery_config>{duration}<leaseAnnouncement><sec>0</sec><nanosec>200000000</nanosec></leaseAnnouncement>
</discovery_config></builtin></rtps></participant></profiles></dds>
""")
        return str(file)

    return written


@pytest.fixture
def start(domain: str, discovery: Callable[[str], str]) -> Iterator[Callable[..., NodeProcess]]:
    """Starts nodes in processes of their own on a domain of their own; none outlives the test."""
    processes: list[NodeProcess] = []

    def begin(module: str, lease: str = "", **parameters: object) -> NodeProcess:
        processes.append(NodeProcess(module, parameters, {
            **os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": domain,
            "FASTDDS_DEFAULT_PROFILES_FILE": discovery(lease)}))
        return processes[-1]

    yield begin
    for process in processes:
        process.kill()
