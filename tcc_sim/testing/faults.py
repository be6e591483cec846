"""What happens to commands between a controller and the driveline: nothing, or faults by count. Free of ROS."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from dataclasses import dataclass

from tcc_sim.errors import InputError
from tcc_sim.messages import cdr
from tcc_sim.model.groups import PRESSURE_MAXIMUM
from tcc_sim.model.quantity import Options, quantity
from tcc_sim.plant.sensors import Schedule


@dataclass(frozen=True)
class Faults(Options):
    """One of every so many commands of each topic is hit, drawn with the seed; 0: none.

    Raises
    ------
    InputError
        A number that is not a whole one from its lowest value on.
    """

    drop: int = quantity(0, "it never arrives", low=0)
    delay: int = quantity(0, "it arrives `delay_ticks` later, behind those that were sent meanwhile", low=0)
    duplicate: int = quantity(0, "it arrives once more with the next tick", low=0)
    corrupt: int = quantity(0, "its value is not a number, beyond every limit, or its bytes are cut short", low=0)
    delay_ticks: int = quantity(3, "ticks of a delay", low=1)
    seed: int = quantity(0, "two runs with the same seed are the same", low=0)

    @staticmethod
    def of(given: Faults | Mapping[str, int] | None) -> Faults:
        """Faults as they are, by name, or none."""
        if given is None or isinstance(given, Faults):
            return given or Faults()
        known = Faults.quantities()
        for name in given:
            if name not in known:
                raise InputError(f"{name} is not a fault; there are {', '.join(known)}")
        return Faults(**given)


class Line:
    """The way of one topic's commands: what is sent in one tick is delivered in it, or what the faults make of it."""

    def __init__(self, name: str, faults: Faults) -> None:
        self._delay_ticks = faults.delay_ticks
        self._schedules = {kind: Schedule(getattr(faults, kind), f"{faults.seed} {name} {kind}")
                           for kind in ("drop", "delay", "duplicate", "corrupt")}
        self._draw = random.Random(f"{faults.seed} {name}")
        self._waiting: list[tuple[int, bool, bytes]] = []

    def send(self, data: bytes, tick: int) -> None:
        """A serialised command that was sent in answer to the state of `tick`."""
        hit = {kind: schedule.hits() for kind, schedule in self._schedules.items()}
        if hit["drop"]:
            return
        data = self._corrupted(data) if hit["corrupt"] else data
        self._waiting.append((tick + (self._delay_ticks if hit["delay"] else 0), hit["delay"], data))
        if hit["duplicate"]:
            self._waiting.append((tick + 1, False, data))

    def deliver(self, tick: int) -> list[bytes]:
        """The commands that arrive before the tick that follows the state of `tick`, those that were delayed last."""
        due = [data for late in (False, True) for when, delayed, data in self._waiting
               if when <= tick and delayed == late]
        self._waiting = [row for row in self._waiting if row[0] > tick]
        return due

    def _corrupted(self, data: bytes) -> bytes:
        """A command with a value that makes no sense, or cut short."""
        value = self._draw.choice((math.nan, math.inf, -2.0 * PRESSURE_MAXIMUM, 2.0 * PRESSURE_MAXIMUM, None))
        if value is None:
            return data[:-5]
        try:
            return cdr.fluid_pressure(cdr.read_fluid_pressure(data)[0], value)
        except ValueError:
            return cdr.float64(value)
