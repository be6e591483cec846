"""Tolerances, lengths and bounds of continuation, in one object.

Lengths, steps and residuals are in natural sizes unless a comment gives another unit.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """How orbits are solved, followed and compared."""

    # The driveline's map, and how a motion is cut into segments (`driveline.py`, `shooting.py`, `branch.py`).
    # A step of the map leaves some 1e-13, and its derivatives are good to 2e-7.
    solver_tolerance: float = 1e-12  # relative tolerance of the map
    coarse_tolerance: float = 1e-9  # the same for the first step of a corrector that has far to go
    stuck: float = 1e-12  # slip speed, rad/s, below which the set-valued law sticks
    growth: float = 1e2  # growth over a segment above which it is cut: the solver's 1e-13 stays below 1e-10
    regrowth: float = 10.0  # growth over a segment, in `growth`, above which the orbit is cut into other segments
    fewer_after: int = 20  # points after which fewer segments are tried
    parts: int = 16  # parts of a cycle, or of a part of it, over which growth is measured
    # Whether growth is also measured about every change between stick and slip: growth in slip that stick removes
    # within the same part is not in the part's derivative, but in how sharply it bends.
    thorough: bool = False

    # Newton's method for an orbit, and when two orbits are the same (`newton.py`).
    newton_tolerance: float = 1e-10  # last step of an orbit
    newton_iterations: int = 25  # most steps
    newton_rounding: float = 1e-12  # residual below which no further step helps
    newton_step: float = 2.0  # longest step; a longer one is scaled to it
    # Parts of a step that are tried in order until the residual falls or the event sequence is unchanged.
    newton_parts: tuple[float, ...] = (1.0, 0.5, 0.25, 0.1, 0.03)
    singular: float = 1e-12  # singular value, relative to the largest one, below which a Jacobian is singular
    # Largest residual of an orbit, however short the last step was: where the Jacobian is singular, as in runaway slip,
    # a short step does not make an orbit.
    residual: float = 5e-9
    same: float = 1e-6  # distance below which two orbits are the same
    neutral: float = 1e-9  # distance from the unit circle that may be rounding: neither stable nor a change of sign

    # The corrector of a continuation (`palc.py`).
    correct_tolerance: float = 1e-9  # last step of a point
    correct_iterations: int = 8  # most steps
    correct_step: float = 10.0  # step above which the corrector fails
    squared: float = 1e-5  # step below which the error is its square, so that the residual before it decides too
    slowest: float = 0.7  # share of the last step above which the corrector fails: a shorter predictor costs less
    missed: float = 1e-8  # error of a predictor above which the next corrector begins with a coarse step
    grown: float = 10.0  # growth of a residual by the last step above which it has left the curve
    nothing: float = 1e-12  # least residual in that comparison
    contraction: float = 0.15  # second step over first step that is aimed at: four steps then reach rounding

    # The steps of a continuation and their control (`follow.py`).
    first_step: float = 0.01
    flat_step: float = 1e-3  # first step without the amplitudes among the coordinates of the arclength
    smallest_step: float = 1e-9
    largest_step: float = 0.1
    wanted: float = 2e-3  # distance between predictor and corrector that is aimed at
    farthest: float = 0.3  # the largest one, relative to the step
    shorter: float = 0.5  # least factor of the step
    longer: float = 2.0  # largest factor of the step
    longer_after_refused: float = 1.2  # the same after a longer step has failed
    turn: float = 0.9  # least cosine between neighbouring tangents
    branching: float = 1e-4  # longest step in which the determinant may change its sign
    nodes: int = 3  # points before the last one that the predictor uses
    max_points: int = 3000  # most points in one direction of a branch
    max_tries: int = 6000  # most steps tried in one direction

    # Where a branch ends or closes (`branch.py`, `follow.py`, `diagram.py`).
    # Modulus of a multiplier above which a branch ends: an orbit known to 1e-12 closes to 1e-2 only, so that neither
    # value nor sign of the multiplier can be trusted. Motions along the falling branch of friction reach it.
    canard: float = 1e10
    family: float = 1e-7  # distance of a multiplier from 1, and slope of the parameter, in a family at one value
    family_length: float = 1e-2  # length of a branch in a family before it ends
    merged: float = 1e-5  # distance, relative to the range, at which two ends of branches are one doubling
    same_end: float = 1e-6  # distance, relative to the range, at which a fold is the doubling where its branch ends
    passing: float = 0.2  # distance from the first point, relative to the step, of a chord that may close a branch
    passed: float = 0.02  # the same of a point on the branch that closes it

    # Special points (`special_points.py`, `bracket.py`, `bordered.py`).
    detect: bool = True  # whether special points are located
    root: float = 1e-13  # width of a bracket, relative to the step, of a root
    enough: float = 1e-11  # residual of a root, however wide the bracket is
    spurious: float = 1e-2  # residual above which a change of sign is rounding
    located: float = 1e-8  # last Newton step of a bifurcation
    noise: float = 1e-6  # part of the larger end value below which a test may be rounding
    idle: int = 2  # evaluations in a row that may then fail to halve the least one: a narrower bracket is noise
    forward: float = 0.1  # least cosine between tangent and chord of a cubic through the ends of a bracket
    complex_pair: float = 1e-6  # argument, rad, above which a pair of multipliers is complex
    branch_point_reach: float = 1e-2  # largest distance of a branch point from where Newton's method begins
    branch_point_defect: float = 1e-6  # largest defect of its equations
    opposite: float = 0.8  # cosine, but for its sign, above which the halves of two orbits are opposite
    # Distance between the halves of a fold's orbit at which a curve that ends has reached a generalised doubling, whose
    # parameters are then known to its square.
    halves_met: float = 1e-2
    halves_reach: float = 0.1  # largest distance of the doubling from the orbit whose halves are alike

    # Changes of the event sequence (`problem.py`, `special_points.py`, `bordered.py`, `branch.py`).
    most_borders: int = 6  # most changes in one step
    corner_step: float = 1e-10  # smallest step beyond a corner
    corner_distances: tuple[float, ...] = (1e-8, 1e-7, 1e-6,
                                           1e-5)  # distances at which the other side of a corner is tried
    border: float = 1e-12  # margin, relative to its natural size, of a solution
    border_residual: float = 1e-11  # residual of the orbit there
    border_halvings: tuple[int, ...] = (24, 20, 0)  # bisections before Newton's method; further ones after it fails
    border_iterations: int = 40  # most steps of Newton's method on a bordered system
    border_left: float = 0.1  # share of the margin that a Newton step leaves, to stay on the side that has one
    # Distance from the border below which it is not resolved because the margin changes very fast, on canards; the
    # distance is the residual then.
    border_finest: float = 1e-12
    border_astray: float = 10.0  # distance, in lengths of the bracket, beyond which another border has been found
    repeats: int = 8  # most changes of one kind at once (a symmetric motion has pairs of them)

    # Bifurcation diagrams, first motions, and the motions on a branch (`diagram.py`, `driveline.py`, `motions.py`,
    # `loss_of_stability.py`, `branch.py`).
    # Distances from a doubling at which its branch is tried; beside a canard, where the map bends within 1e-5, only the
    # smallest ones lie on it.
    amplitudes: tuple[float, ...] = (3e-3, 1e-3, 1e-2, 3e-4, 3e-5, 3e-6, 1e-6)
    max_branches: int = 24  # most branches of a diagram
    longest_period: int = 12  # longest period in it, periods of the excitation
    alike: float = 0.01  # difference of two amplitudes of one motion, relative to the largest of a sweep
    next_to_nothing: float = 1e-3  # part of a sweep's largest size below which its periodic motions are no measure
    near_end: float = 0.05  # distance of a bifurcation from a loss of stability, parts of range and largest size
    same_segment: float = 1e-3  # relative difference of the largest sizes of one stable segment
    narrowest: float = 1e-3  # least width of a segment, relative to the range: canards have many narrower ones
    settling: int = 4800  # engine cycles after which a motion that does not repeat is aperiodic
    settling_elsewhere: int = 300  # the same at other values of the range
    longest_start: int = 16  # longest first period that may be asked for, engine cycles
    deepest_switch: int = 8  # most generations of doubled branches that may be asked for
    guesses: int = 8  # section points from which a first orbit is tried
    elsewhere: int = 9  # values of the range at which a motion is tried where the scene's own does not settle
    off_chord: float = 0.3  # distance of a motion from the chord between two points, relative to its rise
    on_chord: float = 1e-3  # the same where the chord does not rise

    # Curves of bifurcations in two keys (`curves.py`, `codim2_points.py`, `bordered.py`).
    curve_step: float = 0.03  # longest step, for pictures
    curve_regrowth: float = 2.0  # `regrowth` along a curve
    finer_growths: tuple[float, ...] = (10.0, 3.0)  # growths over a segment of thorough cuts after failed steps
    curve_tolerance: float = 1e-8  # last step and residual of a point
    curve_root: float = 1e-9  # width of the bracket of a point of codimension two, relative to the step
    curve_slope: float = 1e-2  # distance from it of the slope of its test, relative to the bracket
    resolved: float = 3.0  # least value of a test on both sides, relative to its changes by steps of differences
    curve_exact: float = 1e-11  # least error of a point of codimension two, relative to the ranges
    singular_apart: float = 0.05  # least distance from a singular end of a curve in its extrapolation
    curve_jump: float = 1e-2  # part of the larger end value above which a test jumps
    # Step along null vectors of length one for first derivatives of the Jacobian. Beside canards motions bend within
    # 1e-7, and the Jacobian's noise is some 1e-14: by halving, the derivative is good to four digits in both cases.
    difference: float = 1e-8
    bend: float = 8e-3  # the same for second derivatives, relative to the length in which the Jacobian changes by one
    margin_step: float = 1e-6  # step of differences of a margin by the two parameters

    @property
    def finest(self) -> float:
        """Shortest part of a segment, cycles."""
        return 1.0 / self.parts**3


DEFAULTS = Settings()
