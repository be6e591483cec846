"""Diagnostics come once a second of the given clock, and each value is that of commands and ticks of the test."""

from __future__ import annotations

from typing import Any

import pytest
from benches import Commander

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from tcc_sim.messages import cdr
from tcc_sim.nodes.driveline import Diagnostics, DrivelineNode

WARN = DiagnosticStatus.WARN


class Stated:
    """The statuses of a driveline whose ticks the test makes, on a clock of the test."""

    def __init__(self, bench: Any, **parameters: object) -> None:
        self.bench, self.now = bench, 100.0
        self.node: DrivelineNode = bench.driveline(publish_diagnostics=False, **parameters)
        self.heard = bench.listen(DiagnosticArray, "/diagnostics")
        self.diagnostics = Diagnostics(self.node, self.node.loop, self.node.waiting, lambda: self.now)

    def status(self, after: float) -> tuple[Any, dict[str, str]]:
        """The status that is published `after` seconds, and its values."""
        self.now += after
        count = len(self.heard)
        self.diagnostics.publish_when_due()
        self.bench.until(lambda: len(self.heard) > count)
        (status,) = self.heard[-1].status
        return status, {pair.key: pair.value for pair in status.values}


def test_there_is_one_a_second_and_none_is_made_up_for_after_a_pause(bench: Any) -> None:
    stated, sent = Stated(bench, scene="minimal"), []
    for after in (0.5, 1.0, 1.5, 2.0, 7.5, 7.625, 7.75, 8.25, 8.5, 9.5):
        stated.now, count = 100.0 + after, len(stated.heard)
        stated.diagnostics.publish_when_due()
        for _ in range(20):
            bench.executor.spin_once(timeout_sec=0.0)
        sent += [after] * (len(stated.heard) - count)
    assert sent == [1.0, 2.0, 7.5, 8.25, 9.5]


def test_every_value_is_that_of_the_commands_and_ticks(bench: Any) -> None:
    """Rates, shares and losses are since the status before; counts since the start."""
    stated = Stated(bench, scene="commands", engine__fallback="mean", rate=500.0, real_time_factor=0.5,
                    command_timeout=0.01)
    loop, sender = stated.node.loop, Commander(bench)
    loop.begin()
    status, values = stated.status(1.0)
    assert (status.level, status.hardware_id, status.name) == (WARN, loop.outputs.run, "/driveline: driveline")
    assert "no command on engine_torque and actuation_pressure" in status.message
    torque, pressure_command = loop.commands
    sender.torques.publish(cdr.float64(310.0))
    bench.until(lambda: (loop.step(), torque.received)[1])
    for pressure in (1e5, -1.0, 2e5):
        sender.pressures.publish(cdr.fluid_pressure(0, pressure))
    for _ in range(129):
        sender.torques.publish(cdr.float64(310.0))

    def taken() -> bool:
        loop.step()
        return pressure_command.received == 2 and torque.received + torque.lost == 130

    bench.until(taken)
    for _ in range(20):  # Without a command for 5 ticks both fall back.
        loop.step()
    ticks = loop.plant.stepper.tick
    status, values = stated.status(2.0)
    assert float(values["simulation time (s)"]) == pytest.approx(ticks / 500.0)
    assert float(values["rate (Hz)"]) == pytest.approx(ticks / 2.0, abs=0.05)
    assert float(values["real-time factor"]) == pytest.approx(ticks / 1000.0, abs=1e-4)
    assert (values["rate wanted (Hz)"], values["scene"]) == ("250", "commands with overrides")
    expected = {"engine_torque received": str(torque.received), "engine_torque lost": str(torque.lost),
                "engine_torque refused": "0", "actuation_pressure received": "2", "actuation_pressure refused": "1",
                "actuation_pressure source": "fallback", "missed ticks": "0",
                "late ticks": "0", "paced ticks": "0", "first late tick (s)": "", "messages not sent": "0"}
    assert {name: values[name] for name in expected} == expected
    assert "-1 Pa" in values["actuation_pressure last refusal"]
    assert values["actuation_pressure publishers"].startswith("1 publisher on /actuation_pressure: sender")
    applied = loop.plant.reading().applied_pressure
    assert float(values["applied pressure (Pa)"]) == pytest.approx(applied, rel=1e-5)
    assert ("commands lost" in status.message) == (torque.lost > 0)
    loop.pause(True)
    status, values = stated.status(1.0)
    assert (values["regime"], values["rate (Hz)"]) == ("paused", "0.0")
    assert "lost" not in status.message


def test_late_and_missed_ticks_are_counted_with_their_times(bench: Any) -> None:
    """The thread of the loop sleeps through 3 ticks, then through more than the catch-up."""
    import time

    stated = Stated(bench, scene="minimal", rate=1000.0)
    node = stated.node
    node.start()
    try:
        loop = node.loop
        bench.until(lambda: loop.plant.stepper.tick > 20)
        assert loop.request(lambda: time.sleep(0.005), timeout=60.0)
        bench.until(lambda: loop.pacer.late_ticks)
        status, values = stated.status(1.0)
        first = float(values["first late tick (s)"])
        assert 0.0 < first <= float(values["last late tick (s)"])
        assert float(values["lateness max (s)"]) > 1e-3
        assert loop.request(lambda: time.sleep(0.15), timeout=60.0)
        bench.until(lambda: loop.pacer.missed_ticks >= 100)
        status, values = stated.status(1.0)
    finally:
        node.loop.stop()
    assert status.level == WARN
    assert "missed in real time" in status.message
    assert int(values["missed ticks"]) >= 100
    assert int(values["late ticks"]) <= int(values["paced ticks"])
    assert float(values["first late tick (s)"]) == first
