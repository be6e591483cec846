"""What differs between continuations: bounds on branches, steps, and the segments of an orbit. Lengths, steps and
residuals are in natural sizes.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Bounds and steps of a continuation."""

    growth: float = 1e2  # growth over a segment above which it is cut: the solver's 1e-13 stays below 1e-10
    regrowth: float = 10.0  # growth over a segment, in `growth`, above which the orbit is cut into other segments
    fewer_after: int = 20  # points after which fewer segments are tried
    # Whether growth is also measured about every change between stick and slip: growth in slip that stick removes
    # within the same part is not in the part's derivative, but in how sharply it bends.
    thorough: bool = False
    # Largest residual of an orbit, however short the last step was: where the Jacobian is singular, as in runaway slip,
    # a short step does not make an orbit.
    residual: float = 5e-9
    correct_tolerance: float = 1e-9  # last step of a point
    first_step: float = 0.01
    smallest_step: float = 1e-9
    largest_step: float = 0.1
    max_points: int = 3000  # most points in one direction of a branch
    max_tries: int = 6000  # most steps tried in one direction
    # Modulus of a multiplier above which a branch ends: an orbit known to 1e-12 closes to 1e-2 only, so that neither
    # value nor sign of the multiplier can be trusted. Motions along the falling branch of friction reach it.
    canard: float = 1e10
    max_branches: int = 24  # most branches of a diagram
    longest_period: int = 12  # longest period in it, periods of the excitation


DEFAULTS = Settings()
