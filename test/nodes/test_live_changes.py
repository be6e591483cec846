"""Parameters changed while running, pauses, steps and resets: the recording alone gives the same run to the last bit.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from benches import overrides

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import rclpy
from rclpy.parameter import Parameter
from std_msgs.msg import Float64

from tcc_sim.messages import cdr
from tcc_sim.nodes.middleware import COMMANDS
from tcc_sim.nodes.recorder import Recorder
from tcc_sim.replay.replay import Replay, replay
from tcc_sim.scene import parse_scene


class Recorded:
    """A driveline with a recorder beside it, both driven by the test."""

    def __init__(self, bench: Any, output: Path, **parameters: object) -> None:
        self.bench, self.output = bench, output
        self.recorder = Recorder(rclpy.create_node("recorder", context=bench.context,
                                                   parameter_overrides=overrides({"output": str(output)})))
        self.node = bench.started(**{"wait_for_subscribers": 1, "publish_scalars": False, "publish_diagnostics": False,
                                     **parameters})
        self.loop = self.node.loop
        self.run(50)

    def run(self, ticks: int) -> None:
        """Wait until `ticks` more states are recorded."""
        def messages() -> int:
            self.recorder.drain()
            return self.recorder.tracks["/joint_states"].messages

        wanted = messages() + ticks
        self.bench.until(lambda: messages() >= wanted)

    def change(self, **values: object) -> None:
        """Set parameters in one request."""
        assert self.node.set_parameters_atomically(overrides(values)).successful

    def reset(self) -> None:
        assert self.loop.request(self.loop.reset)

    def pause(self, paused: bool) -> None:
        assert self.loop.request(lambda: self.loop.pause(paused))

    def step(self) -> None:
        assert self.loop.request(self.loop.single_step)

    def close(self) -> Replay:
        self.loop.stop()
        self.recorder.close()
        self.recorder.node.destroy_node()
        return replay(self.output, verify=True, frequency=150.0)


def exactly(result: Replay, runs: int, repeated: int = 0) -> None:
    verification = result.verification
    assert verification is not None
    assert (verification.detail, verification.largest_difference, verification.verified) == ("", 0.0, True)
    assert verification.exact == verification.compared == result.messages - repeated
    assert (result.continuity.runs, result.lost_messages) == (runs, 0)


SCRIPTS: dict[str, tuple[dict[str, object], list[object], int]] = {
    "pauses, steps and resets": ({"scene": "minimal"}, [
        {"engine.mean_torque": 260.0}, 60, {"friction.kinetic_coefficient": 0.2, "pressure.amplitude": 3e4},
        {"pressure.phase": 1.0}, 60, "reset", 60, "pause", {"engine.torque_amplitude": 100.0},
        {"engine.torque_amplitude": 150.0}, "step", "step", "reset", {"pressure.mean": 2.2e5}, "reset", "step",
        {"friction.kinetic_coefficient": 0.3, "pressure.amplitude": 0.0}, "resume", 200], 4),
    "frequencies": ({"scene": "fig02"}, [
        {"engine.frequency": 201.0}, 60, {"pressure.frequency_ratio": 0.5, "engine.frequency": 90.0}, 60, "reset", 30,
        {"pressure.frequency_ratio": 1.5}, 30], 2),
    "profiles": ({"scene": "minimal", "engine.frequency_times": [0.0, 0.1503], "pressure.mean_times": [0.0, 0.0701],
                  "engine.frequency_values": [80.0, 300.0], "pressure.mean_values": [1e5, 2.5e5]}, [
        100, {"engine.mean_torque": 250.0}, 80], 1)}
"""Parameters of the driveline, then changes of parameters, ticks to run and calls in turn, and the number of runs."""


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_run_with_changes_of_every_kind_gives_itself_again(bench: Any, tmp_path: Path, name: str) -> None:
    parameters, script, runs = SCRIPTS[name]
    chain = Recorded(bench, tmp_path / "run", **parameters)
    for step in script:
        if isinstance(step, dict):
            chain.change(**step)
        elif isinstance(step, int):
            chain.run(step)
        else:
            {"reset": chain.reset, "step": chain.step, "pause": lambda: chain.pause(True),
             "resume": lambda: chain.pause(False)}[str(step)]()
    assert parse_scene(chain.node.get_parameter("scene_text").value, "run").system == chain.node.scene.system
    if name == "profiles":
        refused = chain.node.set_parameters_atomically([Parameter("engine.frequency", value=100.0)])
        assert "engine.frequency_times" in refused.reason
    exactly(chain.close(), runs)


def test_a_step_of_the_mean_torque_beside_commanded_pressure(bench: Any, tmp_path: Path) -> None:
    """The fallback is the scene's mean value, so it follows the change where no command applies."""
    chain = Recorded(bench, tmp_path / "run", scene="commands", command_timeout=0.0, engine__fallback="mean",
                     pressure__fallback="mean")
    chain.change(pressure__mean=2e5)
    assert chain.loop.inputs["actuation_pressure"].value is None
    assert chain.loop.request(lambda: chain.loop.plant.reading().applied_pressure == 2e5)
    chain.run(60)
    torques = bench.node("commander").create_publisher(
        Float64, "engine_torque", COMMANDS)
    bench.until(torques.get_subscription_count)
    torques.publish(cdr.float64(250.0))
    bench.until(lambda: chain.loop.inputs["engine_torque"].value == 250.0)
    chain.change(engine__mean_torque=400.0, friction__static_coefficient=0.4)
    assert chain.loop.inputs["engine_torque"].value == 250.0
    chain.run(100)
    chain.reset()
    chain.run(60)
    assert chain.loop.inputs["engine_torque"].value is None
    assert chain.loop.request(lambda: chain.loop.plant.reading().engine_torque == 400.0)
    exactly(chain.close(), runs=2)


def test_a_friction_table_changes_as_a_whole_or_not_at_all(bench: Any, tmp_path: Path) -> None:
    """Change from one exponential to two; the kernel has room for the most. The clock pauses during the fit, which may
    be slow on a busy machine: the states of that time would overflow the recorder's queue.
    """
    speeds = [0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0]
    one, two = ([0.2 + 0.04 * math.exp(-0.5 * v) - share * math.exp(-0.02 * v) for v in speeds]
                for share in (0.0, 0.02))
    chain = Recorded(bench, tmp_path / "run", scene="minimal", friction__slip_speeds=speeds,
                     friction__coefficients=one)
    chain.pause(True)
    before = chain.node.scene
    for values, why in (({"friction.coefficients": two[:-1]}, "friction.coefficients"),
                        ({"friction.coefficients": [0.1, 0.2] * 5}, "table"),
                        ({"friction.slip_speeds": [], "friction.coefficients": []}, "friction.slip_speeds"),
                        ({"friction.static_coefficient": 0.2}, "friction.static_coefficient")):
        refused = chain.node.set_parameters_atomically([Parameter(key, Parameter.Type.DOUBLE_ARRAY, value)
                                                        if isinstance(value, list) else Parameter(key, value=value)
                                                        for key, value in values.items()])
        assert why in refused.reason
        assert chain.node.scene == before
    chain.change(friction__slip_speeds=[2.0 * v for v in speeds], friction__coefficients=one)
    chain.pause(False)
    chain.run(60)
    chain.pause(True)
    chain.change(friction__slip_speeds=speeds, friction__coefficients=two)
    chain.pause(False)
    chain.run(60)
    exactly(chain.close(), 1)
