"""A vehicle that joins a driveline node in lock-step while its clock runs and leaves it, beside a controller that
answers every command_period.
"""

from __future__ import annotations

import threading
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import rclpy
from controllers import Slow, Vehicle
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from tcc_sim.nodes import recorder
from tcc_sim.replay.recorded import read
from tcc_sim.replay.replay import replay

PERIOD = 10


def test_a_vehicle_joins_and_leaves_lock_step_while_the_clock_runs_and_verifies_to_the_last_bit(
        bench: Any, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    recorded = recorder.Recorder(rclpy.create_node("recorder", context=bench.context, parameter_overrides=[
        Parameter("output", value=str(tmp_path / "run"))]))
    slow = bench.add(Slow(PERIOD, bench.context))
    node = bench.started(scene="controlled", pacing="lockstep", command_period=PERIOD * 1e-3, command_timeout=0.0,
                 wait_for_subscribers=2, publish_shaft_torque=True, publish_diagnostics=False)

    looks = count()

    def heard(states: int) -> bool:
        if next(looks) % 20 == 0:
            node.housekeeping()
            recorded.drain()
        return slow.states > states

    bench.until(lambda: heard(100))
    assert "output_speed" not in node.loop.inputs
    vehicle, apart, done = Vehicle(bench.context), SingleThreadedExecutor(context=bench.context), threading.Event()
    bench.nodes.append(vehicle)
    apart.add_node(vehicle)

    def drive() -> None:
        while not done.is_set():
            apart.spin_once(timeout_sec=0.05)

    driving = threading.Thread(target=drive)
    driving.start()
    request.addfinalizer(lambda: (done.set(), driving.join()))
    bench.until(lambda: heard(0) and "output_speed" in node.loop.inputs)
    joined = slow.states
    bench.until(lambda: heard(joined + 120))
    far_end, pressure = (node.loop.inputs[name] for name in ("output_speed", "actuation_pressure"))
    done.set()
    driving.join()
    apart.remove_node(vehicle)
    bench.nodes.remove(vehicle)
    vehicle.destroy_node()
    bench.until(lambda: heard(0) and "output_speed" not in node.loop.inputs)
    left = node.loop.plant.stepper.tick
    bench.until(lambda: heard(left + 100))
    node.loop.stop()
    bench.until(lambda: heard(node.loop.plant.stepper.tick))
    recorded.drain()
    assert (far_end.timeouts, far_end.refused, pressure.timeouts, pressure.refused) == (0, 0, 0, 0)
    recorded.close()
    result = replay(tmp_path / "run", discard=0, verify=True)
    assert result.lost_messages == 0
    assert (result.verification.verified, result.verification.largest_difference) == (True, 0.0)
    assert result.verification.exact == result.verification.compared
    run = read(tmp_path / "run").trajectory(0)
    assert not run.output_speed[-90:].any()
    moved = np.flatnonzero(run.output_speed)
    assert moved[0] > 100
    assert len(moved) > 100
    changed = 1 + np.flatnonzero(np.diff(run.saturation_torque[1:]))
    assert set((changed % PERIOD).tolist()) == {0}
