"""Commands from topics: polled raw, checked, held from one tick to the next."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from typing import Any

from rclpy.node import Node

from tcc_sim.errors import InputError
from tcc_sim.messages import cdr
from tcc_sim.nodes.middleware import COMMANDS, MOST_TAKEN, message_class, poll, subscribe, taker
from tcc_sim.plant.closed_loop import check_command
from tcc_sim.topics import FLUID_PRESSURE, Topic


class Command:
    """One commanded input with zero-order hold: the newest valid command applies from the next tick on.

    Until the first command, and after a time without one, there is none and the scene's fallback applies.

    Parameters
    ----------
    node : owner of the subscription
    row : of the topic
    admit : raises InputError where a value within the range cannot be applied now

    Attributes
    ----------
    value : the command in SI units; None where the fallback applies
    refusal : why the last of the refused ones was
    """

    def __init__(self, node: Node, row: Topic, admit: Callable[[float], None] = lambda _: None) -> None:
        self.name, self._admit = row.name, admit
        self.value: float | None = None
        self.received = self.refused = self.timeouts = 0
        self.refusal = ""
        self._last_tick = 0
        self._stamped = row.type == FLUID_PRESSURE
        self.subscription: Any = subscribe(node, message_class(row.type), row.name, COMMANDS)
        self._take = taker(self.subscription)

    @property
    def fallen_back(self) -> bool:
        """Whether the fallback applies."""
        return self.value is None

    def reset(self) -> None:
        """Back to the fallback, as before the first command."""
        self.value, self._last_tick = None, 0

    def poll(self, tick: int, timeout_ticks: float) -> None:
        """Take what has arrived before tick `tick`; who polls sees to it that the subscription is there."""
        for data, _ in islice(iter(self._take, None), MOST_TAKEN):
            self.accept(data, tick)
        if self.value is not None and tick - self._last_tick >= timeout_ticks:
            self.fall_back()

    def answered(self, tick: int, stamp_ns: int) -> bool:
        """Lock-step: whether the one command that answers the state of `stamp_ns` has arrived by now.

        A stamped command answers the state that has its stamp; a command without a stamp answers the state before it,
        by count. A refused command is an answer too: the value before it holds.
        """
        while taken := poll(self.subscription, most=1):
            if self.accept(taken[0][0], tick, stamp_ns):
                return True
        return False

    def fall_back(self) -> None:
        """Apply the fallback and count the time-out."""
        self.value = None
        self.timeouts += 1

    def accept(self, data: bytes, tick: int, answers: int | None = None) -> bool:
        """Hold the value of a serialised command from tick `tick` on, or count why not.

        False where its stamp says that it answers another state than that of the stamp `answers`, ns.
        """
        try:
            stamp, value = cdr.read_fluid_pressure(data) if self._stamped else (0, cdr.read_float64(data))
        except ValueError as error:
            return self._refuse(f"{self.name}: {error}")
        if answers is not None and stamp not in (0, answers):
            self._refuse(f"{self.name} command with stamp {stamp * 1e-9:.9g} s refused; it must be that of the state, "
                         f"{answers * 1e-9:.9g} s")
            return False
        try:
            check_command(self.name, value, self._admit)
        except InputError as error:
            return self._refuse(str(error))
        self.value, self._last_tick = value, tick
        self.received += 1
        return True

    def _refuse(self, sentence: str) -> bool:
        """Count a command that is not taken; what held before it holds on."""
        self.refused += 1
        self.refusal = sentence
        return True
