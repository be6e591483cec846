"""Commands from topics: polled raw, checked, held from one tick to the next."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Float64

from tcc_sim.messages import cdr
from tcc_sim.model.parameters import PRESSURE_MAXIMUM, TORQUE_MAXIMUM
from tcc_sim.nodes.polling import COMMANDS, poll, subscribe
from tcc_sim.topics import topic

LOCKSTEP_POLL = 2e-5
"""Real time between two looks for a command in lock-step, s."""


class Command:
    """One commanded input with zero-order hold: the newest valid command applies from the next tick on.

    Until the first command, and after `timeout` seconds of simulated time without one, the fallback applies.
    """

    def __init__(self, node: Node, name: str, low: float, high: float, fallback: float) -> None:
        self.name, self.low, self.high, self.fallback = name, low, high, fallback
        self.unit = topic(name).unit
        self.value = fallback
        self.received = self.refused = self.timeouts = 0
        self.refusal = ""
        self.fallen_back = True
        self._last_tick = 0
        self._pressure = topic(name).type.endswith("FluidPressure")
        kind: Any = FluidPressure if self._pressure else Float64
        self.subscription = subscribe(node, kind, name, COMMANDS)

    def reset(self) -> None:
        """Back to the fallback, as before the first command."""
        self.value, self.fallen_back, self._last_tick = self.fallback, True, 0

    def replace_fallback(self, fallback: float) -> None:
        """Take another fallback, which applies at once where no command does."""
        self.fallback = fallback
        if self.fallen_back:
            self.value = fallback

    def poll(self, tick: int, timeout_ticks: float) -> None:
        """Take what has arrived before tick `tick`."""
        for data, _ in poll(self.subscription):
            self._accept(data, tick)
        if not self.fallen_back and tick - self._last_tick >= timeout_ticks:
            self.fall_back()

    def await_one(self, tick: int, stamp_ns: int, timeout: float, stopped: Callable[[], bool]) -> None:
        """Lock-step: wait in real time for the one command that answers the state of `stamp_ns`.

        A stamped command answers the state that has its stamp; a command without a stamp answers the state before it,
        by count. A refused command is an answer too: the value before it holds. After `timeout` seconds (0: never) the
        fallback applies.
        """
        end = time.monotonic() + timeout if timeout > 0.0 else math.inf
        while not stopped():
            taken = poll(self.subscription, most=1)
            if not taken:
                if time.monotonic() > end:
                    self.fall_back()
                    return
                time.sleep(LOCKSTEP_POLL)
                continue
            if self._accept(taken[0][0], tick, stamp_ns):
                return

    def fall_back(self) -> None:
        """Apply the fallback and count the time-out."""
        self.value, self.fallen_back = self.fallback, True
        self.timeouts += 1

    def _accept(self, data: bytes, tick: int, answers: int | None = None) -> bool:
        """Hold the value of a command, or count why not. False where its stamp says that it answers another state."""
        try:
            stamp, value = cdr.read_fluid_pressure(data) if self._pressure else (0, cdr.read_float64(data))
        except ValueError as error:
            self.refused += 1
            self.refusal = f"{self.name}: {error}"
            return True
        if answers is not None and stamp not in (0, answers):
            self.refused += 1
            self.refusal = (f"{self.name} command with stamp {stamp * 1e-9:.9g} s refused; it must be that of the state, "
                            f"{answers * 1e-9:.9g} s")
            return False
        if not self.low <= value <= self.high:
            self.refused += 1
            self.refusal = f"{self.name} command of {value:g} {self.unit} refused; it must be {self.low:g} to {self.high:g}"
            return True
        self.value, self._last_tick, self.fallen_back = value, tick, False
        self.received += 1
        return True


def engine_torque_command(node: Node, fallback: float) -> Command:
    """The command on engine_torque, N m."""
    return Command(node, "engine_torque", -TORQUE_MAXIMUM, TORQUE_MAXIMUM, fallback)


def pressure_command(node: Node, fallback: float) -> Command:
    """The command on actuation_pressure, Pa."""
    return Command(node, "actuation_pressure", 0.0, PRESSURE_MAXIMUM, fallback)
