"""Settings of the room: tolerances, lengths and bounds of measurements, settled motions and their responses.

Callers of `identify` may give `FitSettings` and `Gates`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tcc_sim.model.quantity import quantity


@dataclass(frozen=True)
class Settings:
    """Settings of the check of measurements, the search for motions, and their responses."""

    segments: int = quantity(512, "fewest segments of a period of excitation; even, for Simpson's rule")
    most_segments: int = quantity(65536, "most segments of a motion, over each of which an input is held")
    turn: float = quantity(0.4, "most of a period of the input in one segment", "rad")
    still_slip: float = quantity(1e-9, "slip speed of a section of the set-valued law that counts as stick", "rad/s")
    within: float = quantity(0.01, "largest relative error of a response")
    pressures: tuple[float, float, int] = (0.95, 2.0, 16)
    rtol: float = quantity(1e-10, "relative tolerance of the engine")
    closed: float = quantity(1e-8, "largest residual of a periodic motion", "natural sizes")
    iterations: int = quantity(40, "most iterations of Newton's method")
    cycles: int = quantity(400, "longest run from the initial state", "periods of excitation")
    lowest: float = quantity(2.0, "lowest default frequency", "rad/s")
    count: int = quantity(240, "default number of frequencies, to three times the slipping mode, evenly in logarithm")
    most_frequencies: int = quantity(100_000, "largest number of frequencies")
    even: float = quantity(1e-3, "largest deviation of a step between samples from the others, relative")
    fewest: int = quantity(50, "shortest measurement", "samples")
    most: int = quantity(1_000_000, "longest measurement", "samples")
    still: float = quantity(1e-12, "a channel whose spread is below this part of its size is dead")
    exact: float = quantity(1e-4, "precision of the real-time solver and least noise, relative to a signal's "
                            "largest value")
    least_ratio: float = quantity(1.0005, "least ratio of mu_s and mu_k while one is free: at 1 decay has no effect")
    orders: int = quantity(4, "longest autoregression of residuals", "samples")
    memory: int = quantity(200, "longest correlation of the noise", "samples")
    lags: int = quantity(20, "correlations of the residuals of the autoregression in one test", "samples")
    lines: int = quantity(12, "multiples of the engine's frequency that are tested in them")
    shown: float = quantity(4.0, "shortest measurement for this test", "periods of excitation")
    unseen: float = quantity(4.0, "standard errors up to which residuals do not show an error of a fixed key")
    moved: float = quantity(2.0, "standard errors by which such a key must move a free one to be named")
    spare: float = quantity(1.25, "sub-steps relative to those that the values need")


DEFAULTS = Settings()


@dataclass(frozen=True)
class Stage:
    """One stage of the fit.

    window : length of a window, s
    weight : of continuity, per squared noise
    tolerance : relative change of the cost at which the stage ends
    iterations : largest number
    robust : mean square of a window's residuals, over their median (at least 1), above which it counts less; infinite
        if all windows count alike
    """

    window: float
    weight: float
    tolerance: float
    iterations: int
    robust: float = math.inf


@dataclass(frozen=True)
class FitSettings:
    """Settings of the fit.

    The stages go from nearly independent windows to long ones that nearly form one motion; short ones with a large
    weight converge slowly.
    """

    stages: tuple[Stage, ...] = (Stage(0.01, 1e-4, 1e-2, 20, 4.0), Stage(0.01, 1e-2, 1e-2, 20, 4.0),
                                 Stage(0.01, 1.0, 1e-2, 20, 4.0), Stage(0.01, 1e3, 1e-3, 20, 4.0),
                                 Stage(0.1, 1e4, 1e-2, 12, 4.0), Stage(0.1, 1e4, 1e-8, 60))
    layer: float = quantity(0.03, "slip speed within which a start in stick is held", "rad/s")
    joined: float = quantity(1e3, "weight above which starts in stick are not held")
    stuck: float = quantity(4.0, "standard deviations of the noise below which the slip speed of a window's start "
                            "counts as stick")
    largest_step: float = quantity(0.3, "largest step of a parameter's logarithm in one iteration")
    least_gain: float = quantity(0.03, "gain of chi-square, over chi-square per residual, at which every stage ends")
    far: float = quantity(10.0, "chi-square per residual above which the last stage ends at gains below 1 %")
    angle_noise: float = quantity(1e-4, "scale of a plate angle that was not measured", "rad")


@dataclass(frozen=True)
class Gates:
    """Limits of an acceptable fit and of an identified parameter."""

    beyond: float = quantity(4.0, "largest excess of chi-square per degree of freedom over 1, in standard deviations")
    guessed: float = quantity(3.5, "relative standard deviation of a variance of noise that was estimated from a "
                              "signal, by the root of the samples")
    explained: float = quantity(4.0, "largest change of a held quantity that residuals suggest, in its standard errors")
    white: float = quantity(1e-4, "least probability of the residuals as noise")
    gap: float = quantity(4.0, "largest gap between windows, see `multiple_shooting.Fit`")
    relative: float = quantity(0.15, "largest standard error of an identified parameter, relative to its value")
    negligible: float = quantity(0.01, "size of a parameter that may be 0, relative to that of a full effect, up to "
                                 "which it has no effect")
    correlated: float = quantity(0.99, "largest correlation with another free parameter of an identified one")
    starts: int = quantity(5, "number of starts, the first at the given values, the others in a Sobol set around "
                           "them")
    work: float = quantity(1.5e8, "sub-steps times derivatives after which no other start is tried: about 15 s")
    spread: float = quantity(0.15, "spread of that set, relative")
    louder: float = quantity(3.0, "largest ratio of residuals that are noise to the stated noise")
    turned: float = quantity(0.25, "largest chi-square with the sign of a column turned, relative to that without, "
                             "that shows a wrong sign")
    drift: float = quantity(0.15, "largest change between the first and last quarter of the phase of the data, against "
                            "that of the fitted motion", "rad")
