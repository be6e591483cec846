"""Harmonic fallback: the driveline moves by itself until commands come, and its recording alone gives the same run."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benches import Commander

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from test_live_changes import Recorded, exactly

from tcc_sim.messages import cdr
from tcc_sim.messages.held import COMMAND, FALLBACK
from tcc_sim.recording.announcements import zeros_of
from tcc_sim.recording.reader import Run
from tcc_sim.scene import load_scene


class Commanded(Recorded):
    """A recorded driveline with a sender of commands."""

    def __init__(self, bench: Any, output: Path, **parameters: object) -> None:
        super().__init__(bench, output, **parameters)
        self.sender = Commander(bench)

    def send(self, torque: float | None = None, pressure: float | None = None) -> None:
        engine, actuation = self.loop.commands
        before = engine.received, actuation.received
        if torque is not None:
            self.sender.torques.publish(cdr.float64(torque))
        if pressure is not None:
            self.sender.pressures.publish(cdr.fluid_pressure(0, pressure))
        expected = before[0] + (torque is not None), before[1] + (pressure is not None)
        self.bench.until(lambda: (engine.received, actuation.received) == expected)


def test_without_arguments_it_subscribes_to_both_and_moves_as_its_scene_says(bench: Any, tmp_path: Path) -> None:
    chain = Recorded(bench, tmp_path / "run")
    assert chain.node.get_parameter("scene").value == "commands"
    assert [command.name for command in chain.loop.commands] == ["engine_torque", "actuation_pressure"]
    chain.run(200)
    exactly(chain.close(), runs=1)
    batches = list(Run(tmp_path / "run").columns().runs)
    t = np.concatenate([b.stamp_ns for b in batches]) * 1e-9
    engine = np.concatenate([b.engine_torque for b in batches])
    pressure = np.concatenate([b.of("applied_pressure") for b in batches])
    system = load_scene("commands").system
    assert np.abs(engine - (300.0 + 250.0 * np.sin(50.0 * np.pi * t))).max() < 1e-9
    assert np.abs(pressure - (system.pressure.mean + system.pressure.amplitude * np.sin(50.0 * np.pi * t))).max() < 1e-6
    assert system.pressure.amplitude > 0.0


def test_commands_time_outs_changes_and_resets_are_verified_to_the_last_bit(bench: Any, tmp_path: Path) -> None:
    began = time.time_ns()
    chain = Commanded(bench, tmp_path / "run", scene="commands", command_timeout=0.04, stamp="wall",
                      publish_stamped=True)
    chain.send(torque=310.0)
    chain.run(20)
    chain.send(pressure=2.1e5)
    chain.run(60)
    chain.bench.until(lambda: [command.timeouts for command in chain.loop.commands] == [1, 1])
    chain.run(40)
    chain.send(torque=-50.0, pressure=1.5e5)
    chain.change(engine__torque_amplitude=100.0, pressure__phase=1.0)
    chain.run(20)
    chain.reset()
    chain.run(50)
    chain.change(command_timeout=0.0)
    chain.send(torque=250.0)
    chain.change(pressure__amplitude=0.0)
    chain.change(friction__static_coefficient=0.24)
    chain.run(100)
    exactly(chain.close(), runs=2)
    names = "engine_torque", "actuation_pressure"
    sources = [tuple(row) for states in Run(tmp_path / "run").columns().runs for row in np.stack(
        [states.input(name, "source") for name in names], axis=1).tolist()]
    assert set(sources) >= {(FALLBACK, FALLBACK), (COMMAND, FALLBACK), (COMMAND, COMMAND)}
    assert (sources[0], sources[-1]) == ((FALLBACK, FALLBACK), (COMMAND, FALLBACK))
    run = Run(tmp_path / "run")
    assert [states.stamp_ns[0] for states in run.columns().runs] == [0, 0]
    assert run.stamps.lost == 0
    assert [one.topic for one in run.drivelines] == ["/joint_states"]  # Stamped topics are no drivelines.
    zeros = zeros_of(scene.text for scene in run.scenes).tolist()
    assert len(zeros) == 2
    assert all(began <= zero <= time.time_ns() for zero in zeros)
    answers = (run.result or {})["missing_stamps"]
    assert answers["/joint_states"] == 0


def test_a_scene_file_is_that_scene_and_not_a_change_of_the_default(bench: Any) -> None:
    """Where parameters state the sources of inputs, other keys have the defaults of a scene file."""
    node = bench.driveline(engine__source="harmonic", pressure__source="topic", cpu_affinity=[0])
    assert node.scene.system == load_scene("fig02").with_values({"pressure.source": "topic"}).system
    assert node.scene.operation.cpu_affinity == (0,)
    assert not math.isnan(node.scene.system.pressure.mean)
