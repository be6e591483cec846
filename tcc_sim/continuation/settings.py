"""The settings of the room: every tolerance, length and bound that the study of motions works with, in one object.

Lengths, steps and residuals are in natural sizes where nothing else is said. BifurcationKit.jl keeps them so
(`ContinuationPar`, `NewtonPar`).
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """How orbits are solved for, followed and told apart.

    Attributes
    ----------
    growth : over a segment, above which it is cut: what a step of the solver leaves, some 1e-13, stays below 1e-10
    regrowth : over a segment, in `growth`, above which the orbit is cut anew
    fewer_after : points after which fewer segments are tried
    parts : of a cycle, or of a part of it, in which the growth is looked at
    newton_tolerance, newton_iterations : last step at which an orbit counts as found, and most steps
    newton_rounding : residual below which no further step is worth taking
    newton_step : longest
    residual : above which nothing counts as an orbit, however short the last step was: where the Jacobian is singular
        (a runaway is one), the shortest step may be none at all
    same : distance below which two orbits are the same
    neutral : distance of a multiplier from the unit circle that may be rounding: what is no further is neither stable
        nor a change of sign of a test function
    correct_tolerance, correct_iterations : the same as Newton's for the corrector of a continuation
    squared : a step below this leaves an error of its square; the residual before it then decides too
    slowest : share of the step before above which the corrector is given up: a shorter step costs less
    grown, nothing : growth of a residual by the last step above which that has led elsewhere; a residual that is none
    contraction : share of the corrector's first step that its second one is to be: four of them then reach rounding
    first_step, flat_step : of a continuation; without the amplitudes among the arclength's coordinates
    smallest_step, largest_step : bounds of the step
    wanted, farthest : distance between predictor and corrector that is aimed at; relative to the step, at most
    turn : least cosine between neighbouring tangents
    branching : step in which a change of the determinant's sign is believed
    nodes : points before the last one from which the next is predicted
    max_points : in one direction of a branch
    max_tries : steps tried, halved ones too, in one direction
    canard : modulus of a multiplier above which a branch ends: an orbit known to 1e-12 closes to no better than 1e-2
        over its period, and neither value nor sign of such a multiplier can be trusted. Motions along the falling
        branch of friction get there
    family, family_length : distance of a multiplier from 1, and of the tangent from one without a change of the
        parameter, on a family of motions at one value; how far a branch runs along it before it counts as one
    detect : whether special points are looked for
    root : width of a bracket, relative to the step, at which a root counts as found
    enough : residual at which a root counts as found, however wide the bracket is
    spurious : residual above which a change of sign is one of rounding, not of a bifurcation
    merged : distance, relative to the range, at which a branch ends in a doubling, or two begin in one
    same_end : distance, relative to the range, at which a fold is the end where a branch passes into its own shift
    located : last Newton step at which a bifurcation counts as found
    beside : how far beyond a change of the event sequence its other side is looked at
    border : margin, relative to its natural size, at which a sliding bifurcation counts as found
    amplitudes : distances from a doubling at which its branch is looked for; next to a canard, where the map bends
        within 1e-5, only the smallest are on it
    max_branches : of a bifurcation diagram
    longest_period : followed in it, in periods of the excitation
    alike : difference of two amplitudes, relative to the largest of a sweep, up to which they are those of one motion
    off_chord : how far a motion may be off the chord between two points, relative to how much that chord climbs
    """

    growth: float = 1e2
    regrowth: float = 10.0
    fewer_after: int = 20
    parts: int = 16
    newton_tolerance: float = 1e-10
    newton_iterations: int = 25
    newton_rounding: float = 1e-12
    newton_step: float = 2.0
    residual: float = 5e-9
    same: float = 1e-6
    neutral: float = 1e-9
    correct_tolerance: float = 1e-9
    correct_iterations: int = 8
    squared: float = 1e-5
    slowest: float = 0.7
    grown: float = 10.0
    nothing: float = 1e-12
    contraction: float = 0.15
    first_step: float = 0.01
    flat_step: float = 1e-3
    smallest_step: float = 1e-9
    largest_step: float = 0.1
    wanted: float = 2e-3
    farthest: float = 0.3
    turn: float = 0.9
    branching: float = 1e-4
    nodes: int = 3
    max_points: int = 3000
    max_tries: int = 6000
    canard: float = 1e10
    family: float = 1e-7
    family_length: float = 1e-2
    detect: bool = True
    root: float = 1e-13
    enough: float = 1e-11
    spurious: float = 1e-2
    merged: float = 1e-5
    same_end: float = 1e-6
    located: float = 1e-8
    beside: tuple[float, ...] = (1e-8, 1e-7, 1e-6, 1e-5)
    border: float = 1e-12
    amplitudes: tuple[float, ...] = (3e-3, 1e-3, 1e-2, 3e-4, 3e-5, 3e-6, 1e-6)
    max_branches: int = 24
    longest_period: int = 12
    alike: float = 0.01
    off_chord: float = 0.3

    @property
    def finest(self) -> float:
        """Shortest part of a segment, cycles."""
        return 1.0 / self.parts**3


DEFAULTS = Settings()
