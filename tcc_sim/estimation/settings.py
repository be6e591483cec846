"""The settings of the room: tolerances, lengths and bounds of measurements, settled motions and their responses.

How a fit is made and judged is in `multiple_shooting.Settings` and `verdicts.Gates`, which callers of `identify` give.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """How a measurement is checked, a motion is found, and its response is worked out and simulated.

    Attributes
    ----------
    parts : of an engine cycle; even, for Simpson's rule. An input is held over each, which costs (omega h)^2/24
    rtol : of the engine
    closed : largest residual of a periodic motion, in natural sizes
    iterations : most of Newton's method
    cycles : most engine cycles solved from the initial state where no slip speed is asked for
    lowest, count : frequencies that are given unless others are asked for: from so many rad/s to the slipping mode, so
        many, evenly in logarithm
    most_frequencies : that may be asked for
    amplitude : of the simulated sine, relative to the mean of the input
    rate, ticks_per_cycle : ticks a second; more where the sine or the engine needs so many a cycle
    settling, periods, longest : engine cycles before the fit of a sine, least periods of it in the fit, and most ticks
    bands : multiples of the motion's frequency whose side bands are fitted
    even : largest deviation of a step between samples from the others, relative
    fewest, most : samples of a measurement
    still : a channel whose spread is below this part of its size is dead
    exact : what the real-time solver promises, relative to a signal's largest value: no smaller noise is estimated
    """

    parts: int = 512
    rtol: float = 1e-10
    closed: float = 1e-8
    iterations: int = 40
    cycles: int = 400
    lowest: float = 2.0
    count: int = 240
    most_frequencies: int = 100_000
    amplitude: float = 2e-3
    rate: float = 4000.0
    ticks_per_cycle: int = 64
    settling: int = 12
    periods: int = 4
    longest: int = 2_000_000
    bands: int = 12
    even: float = 1e-3
    fewest: int = 50
    most: int = 1_000_000
    still: float = 1e-12
    exact: float = 1e-4


DEFAULTS = Settings()
