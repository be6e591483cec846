"""The commander of the demo, in lock-step with its driveline."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from tcc_sim.analysis.steady.summary import summarise


def test_its_commands_answer_every_state_and_settle_on_one_motion(driveline: Any) -> None:
    from tcc_sim.nodes.commander import CommanderNode

    rig = driveline("commands")
    rig.add(CommanderNode())
    run = rig.run(seconds=4.0)
    assert (run.missed, run.refused) == (0, 0)
    before = run.t[:-1]  # A sample has the commands that answer the state before it.
    np.testing.assert_allclose(run.commands["engine_torque"][1:], 300.0 + 250.0 * np.sin(50.0 * np.pi * before),
                               rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(run.commands["actuation_pressure"][1:], 225e3 + 45e3 * np.sin(50.0 * np.pi * before),
                               rtol=1e-12, atol=1e-6)
    summary = summarise(run)
    assert (summary.period, summary.breakaways, summary.cycles) == (1, 50, 100)  # 50 of 100 cycles of 40 ms are kept.
