from __future__ import annotations

import random
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest


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


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture(scope="session")
def domain() -> Iterator[str]:
    """A ROS domain that no other test process on this machine has: a name that only one may bind, until the process
    ends.
    """
    numbers = list(range(1, 102))
    random.shuffle(numbers)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as mine:
        for number in numbers:
            try:
                mine.bind(f"\0tcc_sim_test_domain_{number}")
            except OSError:
                continue
            yield str(number)
            return
    pytest.skip("every ROS domain is taken")
