"""What a running driveline and its controller are asked for, on simulation time: for a viewer beside the states."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node

from tcc_sim.analysis.control import Event
from tcc_sim.analysis.cycle_means import CycleMeans, joined_means
from tcc_sim.analysis.engine_clock import Uniform
from tcc_sim.messages import cdr
from tcc_sim.nodes.message_types import message_class
from tcc_sim.nodes.qos import CHANGES, COMMANDS, LATCHED, states
from tcc_sim.nodes.subscriptions import poll, subscribe
from tcc_sim.topics import topic
from tcc_sim.trajectory import Floats

MOST_WAITING = 20_000
"""Messages of a topic that are kept until states tell their place."""
PROFILES = {"engine_torque": COMMANDS, "actuation_pressure": COMMANDS, "target_slip_speed": LATCHED,
            "applied_pressure": states(MOST_WAITING), "input_source": CHANGES}
"""What is listened to. The first three carry no simulation time of their own."""
READERS: dict[str, Callable[[bytes], tuple[int | None, Any]]] = {
    "engine_torque": lambda data: (None, cdr.read_float64(data)),
    "actuation_pressure": lambda data: (None, cdr.read_fluid_pressure(data)[1]),
    "target_slip_speed": lambda data: (None, cdr.read_float64(data)),
    "applied_pressure": cdr.read_fluid_pressure, "input_source": cdr.read_header}
"""Stamp (ns), where there is one, and content of a message."""
Signal = tuple[NDArray[np.int64], Floats]


class ControlWatch:
    """Takes commands, target, applied pressure and the sources of the inputs, and gives them beside states.

    Parameters
    ----------
    node : in the driveline's namespace
    cycle : engine cycle, s, over which the slip speed is averaged
    """

    def __init__(self, node: Node, cycle: float) -> None:
        self._subscriptions = {name: subscribe(node, message_class(topic(name).type), name, profile)
                               for name, profile in PROFILES.items()}
        self._waiting: dict[str, deque[tuple[int, int | None, Any]]] = {name: deque(maxlen=MOST_WAITING)
                                                                        for name in PROFILES}
        self._means = CycleMeans(Uniform(cycle))
        self._applied = math.nan

    def poll(self) -> None:
        """Take what has arrived; messages that cannot be read are left out."""
        for name, subscription in self._subscriptions.items():
            for data, info in poll(subscription, MOST_WAITING):
                with suppress(ValueError):
                    self._waiting[name].append((info["received_timestamp"] or time.time_ns(), *READERS[name](data)))

    def beside(self, stamp_ns: NDArray[np.int64], received_ns: NDArray[np.int64], slip_speed: Floats, *,
               new_run: bool) -> tuple[dict[str, Signal], list[Event]]:
        """What was received up to the last of the next states: signals by name, stamps (ns) and values, and events.

        What carries no simulation time stands at the first state that was received after it.

        Parameters
        ----------
        stamp_ns, received_ns, slip_speed : (n,) arrays of the states, all of one run: simulation time and time of
            receipt, ns, and rad/s
        new_run : simulation time has started again
        """
        signals: dict[str, Signal] = {}
        events: list[Event] = []
        for name, waiting in self._waiting.items():
            stamps, values = [], []
            while waiting and waiting[0][0] <= received_ns[-1]:
                received, stamp, value = waiting.popleft()
                if name == "applied_pressure" and new_run and received < received_ns[0]:
                    continue  # It follows its state, so this one is of the run that has ended.
                place = int(np.searchsorted(received_ns, received))
                stamps.append(int(stamp_ns[place]) if stamp is None else stamp)
                values.append(value)
            if name == "input_source":
                events = [Event(stamp * 1e-9, text) for stamp, text in zip(stamps, values)]
            elif values:
                signals[name] = np.array(stamps, dtype=np.int64), np.array(values)
        if "applied_pressure" in signals:
            stamps_of, pressure = signals["applied_pressure"]
            changed = np.diff(pressure, prepend=self._applied) != 0.0
            self._applied = float(pressure[-1])
            signals["applied_pressure"] = stamps_of[changed], pressure[changed]
        if new_run:
            self._means.restart()
        signals["mean_slip"] = joined_means(self._means.feed(stamp_ns.astype(np.float64) * 1e-9, slip_speed))
        return signals, events
