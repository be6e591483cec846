"""Pytest plugin `tcc_sim` with the fixture `driveline`, which skips the test if ROS 2 is not installed."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import pytest

from tcc_sim.errors import InputError

if TYPE_CHECKING:
    from tcc_sim.testing.rig import Rig


RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
"""Environment variable that rclpy.init() reads: OFF disables discovery of other processes."""


@pytest.fixture
def driveline() -> Iterator[Callable[..., Rig]]:
    """Start a driveline in lock-step in this process: ``driveline(scene, changes=None, rate=1000.0, faults=None)``.

    All nodes of rclpy's default context are isolated from other processes, so that tests can run in parallel. The
    fixture destroys the driveline and the nodes under test after the test.

    Raises
    ------
    InputError
        A test or a fixture has called rclpy.init() before without isolation.
    """
    rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")
    from tcc_sim.nodes.shared_memory import remove_ownerless
    from tcc_sim.testing.rig import Rig

    initialised = rclpy.ok()
    if initialised and os.environ.get(RANGE) != "OFF":
        raise InputError("rclpy.init() was called before the fixture driveline, so this test would receive from and "
                         "command nodes of other processes; leave rclpy.init() to the fixture, or set "
                         f"{RANGE}=OFF before it")
    rigs: list[Rig] = []

    def start(*words: object, **options: object) -> Rig:
        for rig in rigs:
            rig.close()
        rigs.append(Rig(*words, **options))  # type: ignore[arg-type]
        return rigs[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(RANGE, "OFF")
        if not initialised:
            remove_ownerless()
            rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
        yield start
        for rig in rigs:
            rig.close()
        if not initialised:
            rclpy.try_shutdown()
