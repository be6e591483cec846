"""Scheduled changes of scene keys at exact ticks of a run, without ROS."""

from __future__ import annotations

from collections.abc import Mapping

from tcc_sim.errors import InputError
from tcc_sim.scene import meaning_of


def changes_of(values: Mapping[str, object] | None, more: Mapping[str, object]) -> dict[str, object]:
    """Return scene keys with their values; keys of `more` have __ in place of the dot."""
    return {**(values or {}), **{key.replace("__", "."): value for key, value in more.items()}}


class TimedChanges:
    """Schedule of changes of scene keys at simulation times, each a whole number of ticks.

    Parameters
    ----------
    rate : tick rate, Hz
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._changes: dict[int, dict[str, object]] = {}

    def add(self, t: float, changes: Mapping[str, object], tick: int = 0) -> None:
        """Schedule a change at time t, s: the tick that begins at t is the first with the new values.

        Parameters
        ----------
        tick : current tick of the run

        Raises
        ------
        InputError
            The time is not a whole number of ticks or has passed, or a key does not exist or cannot change in a run.
        """
        for key in changes:
            if not meaning_of(key).live:
                raise InputError(f"{key} cannot change while the driveline runs")
        if not 0.0 <= t * self._rate < 1e15 or (t * self._rate + 1e-6) % 1.0 > 2e-6:
            raise InputError(f"a change at {t:g} s is not possible; it must be a whole number of ticks of "
                             f"{1.0 / self._rate:g} s")
        at = round(t * self._rate)
        if at < tick:
            raise InputError(f"a change at {t:g} s is not possible; the run is at {tick / self._rate:g} s")
        self._changes.setdefault(at, {}).update(changes)

    def due(self, tick: int) -> dict[str, object] | None:
        """Remove and return the changes before the tick with this number; None without any."""
        return self._changes.pop(tick, None) if self._changes else None
