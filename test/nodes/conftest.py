from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tcc_sim.nodes.children import Domain, NodeProcess
from tcc_sim.nodes.shared_memory import remove_ownerless


class Bench:
    """One ROS 2 context of its own, unseen by any other, with an executor for what the test itself creates."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor

        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.nodes: list[Any] = []

    def add(self, node: Any) -> Any:
        self.executor.add_node(node)
        self.nodes.append(node)
        return node

    def until(self, predicate: Callable[[], Any], limit: float = 120.0) -> Any:
        """Spin until the predicate holds; fail after `limit` seconds, which a busy machine may well need."""
        end = time.monotonic() + limit
        while not (found := predicate()):
            assert time.monotonic() < end, "the condition did not come true in time"
            self.executor.spin_once(timeout_sec=0.01)
        return found

    def close(self) -> None:
        for node in self.nodes:
            node.destroy_node()
        self.context.try_shutdown()


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
