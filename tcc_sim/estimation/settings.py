"""The settings of the room: tolerances, lengths and bounds of measurements, settled motions and their responses.

How a fit is made and judged is in `multiple_shooting.Settings` and `verdicts.Gates`, which callers of `identify` give.
"""

from __future__ import annotations

from dataclasses import dataclass

from tcc_sim.model.quantity import quantity


@dataclass(frozen=True)
class Settings:
    """How a measurement is checked, a motion is found, and its response is worked out and simulated."""

    parts: int = quantity(512, "parts of an engine cycle; even, for Simpson's rule. An input is held over each, which "
                          "costs (omega h)^2/24")
    rtol: float = quantity(1e-10, "relative tolerance of the engine")
    closed: float = quantity(1e-8, "largest residual of a periodic motion", "natural sizes")
    iterations: int = quantity(40, "most iterations of Newton's method")
    cycles: int = quantity(400, "longest run from the initial state where no slip speed is asked for", "engine cycles")
    lowest: float = quantity(2.0, "lowest frequency given unless others are asked for", "rad/s")
    count: int = quantity(240, "how many are given from there to the slipping mode, evenly in logarithm")
    most_frequencies: int = quantity(100_000, "most frequencies that may be asked for")
    amplitude: float = quantity(2e-3, "amplitude of the simulated sine, relative to the mean of the input")
    rate: float = quantity(4000.0, "least rate of the ticks that solve it", "Hz")
    ticks_per_cycle: int = quantity(64, "ticks that a cycle of the sine and one of the engine have at least")
    settling: int = quantity(12, "time before the fit of a sine", "engine cycles")
    periods: int = quantity(4, "shortest fit of a sine", "periods of it")
    longest: int = quantity(2_000_000, "longest simulation of a sine", "ticks")
    bands: int = quantity(12, "multiples of the motion's frequency whose side bands are fitted")
    even: float = quantity(1e-3, "largest deviation of a step between samples from the others, relative")
    fewest: int = quantity(50, "shortest measurement", "samples")
    most: int = quantity(1_000_000, "longest measurement", "samples")
    still: float = quantity(1e-12, "a channel whose spread is below this part of its size is dead")
    exact: float = quantity(1e-4, "what the real-time solver promises, relative to a signal's largest value: no "
                            "smaller noise is estimated")


DEFAULTS = Settings()
