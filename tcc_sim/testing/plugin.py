"""The pytest plugin `tcc_sim`: the fixture `driveline`. Without ROS 2 a test that asks for it is skipped."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tcc_sim.testing.rig import Rig


RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
"""The variable that rclpy.init() reads: OFF keeps everything outside of the process unseen."""


@pytest.fixture
def driveline() -> Iterator[Callable[..., Rig]]:
    """Starts a driveline in lock-step in this process: ``driveline(scene, changes=None, rate=1000.0, faults=None)``.

    It and every node of rclpy's default context are seen by nothing else on this machine or its network, so that tests
    may run at the same time. Whatever the test leaves is destroyed after it.

    Raises
    ------
    InputError
        A test or a fixture has called rclpy.init() before, where other processes are seen.
    """
    pytest.importorskip("rclpy", reason="ROS 2 is not installed")
    from tcc_sim.testing.isolation import alone, initialise
    from tcc_sim.testing.rig import Rig

    alone()
    rigs: list[Rig] = []

    def start(*words: object, **options: object) -> Rig:
        for rig in rigs:
            rig.close()
        rigs.append(Rig(*words, **options))  # type: ignore[arg-type]
        return rigs[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(RANGE, "OFF")
        own = initialise()
        yield start
        for rig in rigs:
            rig.close()
        if own:
            import rclpy

            rclpy.try_shutdown()
