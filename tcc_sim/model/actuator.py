"""Actuator of the clutch: dead time, first-order lag and rate limit between a commanded pressure and the plates.

The pressure at the plates follows the commanded one after the dead time by p' = (c - p)/T, limited to +-R. A command is
held through a tick, so the pressure at the end of each tick is exact: a ramp of R as far as |c - p| > R T, then an
exponential. Within a tick it is that exponential or that ramp; in the one tick in which a ramp ends it is a straight
line between its exact ends.
"""

from __future__ import annotations

import math
from collections import deque

from tcc_sim.errors import InputError
from tcc_sim.model.groups import Pressure


def delay_ticks(pressure: Pressure, step: float) -> int:
    """Return the dead time in ticks of `step` s; raise InputError unless it is a whole number."""
    ticks = pressure.delay / step
    if (ticks + 1e-6) % 1.0 > 2e-6:
        raise InputError(f"pressure.delay is {pressure.delay:g} s; it must be a whole number of ticks of {step:g} s")
    return round(ticks)


def pressure_after(now: float, target: float, time_constant: float, rate_limit: float, seconds: float) -> float:
    """Return the pressure, Pa, after a time `seconds` with constant command: the exact solution of the lag.

    now, target : pressure at the plates and commanded pressure, Pa
    time_constant : T, s; 0 for no lag
    rate_limit : R, Pa/s; 0 for no limit
    """
    gap, left = target - now, seconds
    if rate_limit > 0.0:
        ramp = (abs(gap) - rate_limit * time_constant) / rate_limit
        if ramp >= seconds:
            return now + math.copysign(rate_limit * seconds, gap)
        if ramp > 0.0:
            gap, left = math.copysign(rate_limit * time_constant, gap), seconds - ramp
    if time_constant == 0.0:
        return target
    return target - gap * math.exp(-left / time_constant)


def approach_between(before: float, after: float, time_constant: float, rate_limit: float,
                     step: float) -> tuple[float, float]:
    """Return the course of the pressure between two values, Pa, within a tick of `step` s: (rise, rate).

    With a rate above 0, 1/s, the pressure is before + rise (1 - exp(-rate t)), else before + rise t. The choice depends
    on the two values alone, so a recording of them gives the same torque to the last bit.
    """
    change = after - before
    if time_constant > 0.0:
        share = 1.0 - math.exp(-step / time_constant)
        if rate_limit == 0.0 or abs(change) <= rate_limit * time_constant * share * 1.000000000001:
            return change / share, 1.0 / time_constant
    return change / step, 0.0


class Actuator:
    """Actuator of one driveline, advanced in ticks of `step` s; its `pressure` is that at the plates, Pa.

    Raises InputError: the dead time is not a whole number of ticks.
    """

    def __init__(self, pressure: Pressure, step: float) -> None:
        self._time_constant, self._rate_limit, self._step = pressure.time_constant, pressure.rate_limit, step
        self._ticks = delay_ticks(pressure, step)
        self.reset(pressure.mean)

    def reset(self, pressure: float) -> None:
        """Set the pressure at the plates and all delayed commands, Pa."""
        self.pressure = pressure
        self._waiting = deque([pressure] * self._ticks)

    @property
    def highest(self) -> float:
        """Upper bound of the pressure that the commands so far lead to, Pa."""
        return max(self.pressure, *self._waiting, 0.0)

    def advance(self, command: float) -> tuple[float, float]:
        """Advance by a tick with a command held through it; return the pressure before and after it, Pa."""
        self._waiting.append(command)
        before = self.pressure
        self.pressure = pressure_after(before, self._waiting.popleft(), self._time_constant, self._rate_limit,
                                       self._step)
        return before, self.pressure
