"""Faults of commands between a controller and the driveline: lost, late, repeated or corrupt messages, without ROS."""

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
    """Rates of faults: each kind with number n hits one random command of every n on each topic; 0 for none.

    Raises
    ------
    InputError
        A value is not an integer or is below its lowest value.
    """

    drop: int = quantity(0, "the command never arrives", low=0)
    delay: int = quantity(0, "the command arrives `delay_ticks` later, after commands sent meanwhile", low=0)
    duplicate: int = quantity(0, "the command arrives again in the next tick", low=0)
    corrupt: int = quantity(0, "the command is NaN, infinite, out of range, or truncated", low=0)
    delay_ticks: int = quantity(3, "length of a delay, ticks", low=1)
    seed: int = quantity(0, "seed; runs with equal seeds are identical", low=0)

    @staticmethod
    def of(given: Faults | Mapping[str, int] | None) -> Faults:
        """Return Faults from a mapping, from Faults, or from None (no faults)."""
        if given is None or isinstance(given, Faults):
            return given or Faults()
        names = Faults.quantities()
        for name in given:
            if name not in names:
                raise InputError(f"{name} is not a fault; the faults are {', '.join(names)}")
        return Faults(**given)


class Line:
    """Channel of one topic's commands, which delivers each in the tick in which it was sent unless a fault hits it."""

    def __init__(self, name: str, faults: Faults) -> None:
        self._delay_ticks = faults.delay_ticks
        self._schedules = {kind: Schedule(getattr(faults, kind), f"{faults.seed} {name} {kind}")
                           for kind in ("drop", "delay", "duplicate", "corrupt")}
        self._draw = random.Random(f"{faults.seed} {name}")
        self._waiting: list[tuple[int, bool, bytes]] = []

    def send(self, data: bytes, tick: int) -> None:
        """Send a serialised command that answers the state of `tick`."""
        hit = {kind: schedule.hits() for kind, schedule in self._schedules.items()}
        if hit["drop"]:
            return
        data = self._corrupted(data) if hit["corrupt"] else data
        self._waiting.append((tick + (self._delay_ticks if hit["delay"] else 0), hit["delay"], data))
        if hit["duplicate"]:
            self._waiting.append((tick + 1, False, data))

    def deliver(self, tick: int) -> list[bytes]:
        """Return the commands that arrive before the tick after the state of `tick`, delayed ones last."""
        due = [data for late in (False, True) for when, delayed, data in self._waiting
               if when <= tick and delayed == late]
        self._waiting = [row for row in self._waiting if row[0] > tick]
        return due

    def _corrupted(self, data: bytes) -> bytes:
        """Return the command with an invalid value, or truncated."""
        value = self._draw.choice((math.nan, math.inf, -2.0 * PRESSURE_MAXIMUM, 2.0 * PRESSURE_MAXIMUM, None))
        if value is None:
            return data[:-5]
        try:
            return cdr.fluid_pressure(cdr.read_fluid_pressure(data)[0], value)
        except ValueError:
            return cdr.float64(value)
