"""What the driveline node says of itself once a second on /diagnostics."""

from __future__ import annotations

import time
from contextlib import suppress

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from tcc_sim.errors import counted
from tcc_sim.nodes.loop import RealTimeLoop
from tcc_sim.nodes.middleware import DIAGNOSTICS, time_of

PERIOD = 1.0
"""Real time between two messages, s."""


class Diagnostics:
    """Rate reached, lateness, iterations against their bound, commands, regime; counts are since the start."""

    def __init__(self, node: Node, loop: RealTimeLoop) -> None:
        self._node, self._loop = node, loop
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", DIAGNOSTICS)
        self._due = time.monotonic() + PERIOD
        self._since = time.monotonic()
        self._late = self._stick = self._slip = 0

    def publish_when_due(self) -> None:
        """Publish if a second has passed; one that the middleware does not take is followed by the next."""
        now = time.monotonic()
        if now < self._due:
            return
        self._due = max(self._due + PERIOD, now)
        message = DiagnosticArray(status=[self._status(now)])
        message.header.stamp = time_of(self._node.get_clock().now().nanoseconds)
        with suppress(RuntimeError):
            self._publisher.publish(message)

    def _status(self, now: float) -> DiagnosticStatus:
        """The status over the time since the last message."""
        loop, pacer, operation = self._loop, self._loop.pacer, self._loop.scene.operation
        stepper = loop.plant.stepper
        stick, slip = loop.stick_ticks - self._stick, loop.slip_ticks - self._slip
        rate = (stick + slip) / (now - self._since)
        regime = "paused" if not stick + slip else "stick" if not slip else "slip" if not stick else "stick-slip"
        middle, high = pacer.lateness()
        values = {
            "scene": loop.scene.name, "simulation time (s)": f"{stepper.tick * stepper.step:.3f}",
            "regime": regime,
            "rate (Hz)": f"{rate:.1f}", "rate wanted (Hz)": f"{operation.rate * (operation.real_time_factor or 1.0):g}",
            "real-time factor": f"{rate / operation.rate:.4f}",
            "missed ticks": str(pacer.missed_ticks), "late ticks": str(pacer.late_ticks),
            "messages not sent": str(sum(dict(loop.outputs.unsent).values())),
            "lateness p50 (s)": f"{middle:.6f}", "lateness p99 (s)": f"{high:.6f}",
            "lateness max (s)": f"{pacer.lateness_max:.6f}",
            "sub-steps per tick": str(stepper.substeps), "iterations max": str(stepper.iterations_most),
            "iterations bound": str(stepper.iterations_bound)}
        for command in loop.commands:
            values |= {f"{command.name} listeners": str(self._node.count_subscribers(command.name)),
                       f"{command.name} received": str(command.received),
                       f"{command.name} refused": str(command.refused),
                       f"{command.name} last refusal": command.refusal,
                       f"{command.name} time-outs": str(command.timeouts),
                       f"{command.name} source": "fallback" if command.fallen_back else "topic"}
        waiting = [c.name for c in loop.commands if c.fallen_back]
        wrong = []
        if pacer.missed_ticks > self._late:
            wrong.append(f"{counted(pacer.missed_ticks - self._late, 'tick')} missed in real time")
        if waiting:
            wrong.append(f"no command on {' and '.join(waiting)}; the scene's fallback applies")
        self._since, self._late = now, pacer.missed_ticks
        self._stick, self._slip = self._stick + stick, self._slip + slip
        return DiagnosticStatus(level=DiagnosticStatus.WARN if wrong else DiagnosticStatus.OK,
                                name=f"{self._node.get_fully_qualified_name()}: driveline", hardware_id="simulation",
                                message="; ".join(wrong) or regime,
                                values=[KeyValue(key=k, value=v) for k, v in values.items()])
