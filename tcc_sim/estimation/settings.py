"""Settings that callers of `identify` may give: stages and steps of the fit, and limits of an acceptable one."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tcc_sim.model.quantity import quantity


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
