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
    """Return the dead time in ticks of `step` s; raises InputError where it is no whole number of them."""
    ticks = pressure.delay / step
    if (ticks + 1e-6) % 1.0 > 2e-6:
        raise InputError(f"pressure.delay is {pressure.delay:g} s; it must be a whole number of ticks of {step:g} s")
    return round(ticks)


def pressure_after(now: float, target: float, time_constant: float, rate_limit: float, seconds: float) -> float:
    """Return the pressure, Pa, after a time, s, in which the command is held: the exact solution of the lag.

    Parameters
    ----------
    now, target : Pa
    time_constant : T, s; 0 for none
    rate_limit : R, Pa/s; 0 for none
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
    """Return how the pressure goes from one value to another, Pa, within a tick of `step` s: (rise, rate).

    With a rate above 0, 1/s, it is before + rise (1 - exp(-rate t)), else before + rise t. The two values alone say
    which, so that a recording of them gives the same torque to the last bit.
    """
    change = after - before
    if time_constant > 0.0:
        share = 1.0 - math.exp(-step / time_constant)
        if rate_limit == 0.0 or abs(change) <= rate_limit * time_constant * share * 1.000000000001:
            return change / share, 1.0 / time_constant
    return change / step, 0.0


class Actuator:
    """The actuator of one driveline, tick by tick.

    Parameters
    ----------
    pressure : its keys
    step : a tick, s

    Attributes
    ----------
    pressure : at the plates now, Pa

    Raises
    ------
    InputError
        A dead time that is no whole number of ticks.
    """

    def __init__(self, pressure: Pressure, step: float) -> None:
        self._time_constant, self._rate_limit, self._step = pressure.time_constant, pressure.rate_limit, step
        self._ticks = delay_ticks(pressure, step)
        self.reset(pressure.mean)

    def reset(self, pressure: float) -> None:
        """Settle at a pressure, Pa."""
        self.pressure = pressure
        self._waiting = deque([pressure] * self._ticks)

    @property
    def highest(self) -> float:
        """Bound of the pressure, Pa, that commands taken until now lead to."""
        return max(self.pressure, *self._waiting, 0.0)

    def advance(self, command: float) -> tuple[float, float]:
        """Take the command, Pa, that is held through the next tick; the pressure before and after that tick, Pa."""
        self._waiting.append(command)
        before = self.pressure
        self.pressure = pressure_after(before, self._waiting.popleft(), self._time_constant, self._rate_limit,
                                       self._step)
        return before, self.pressure
