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
    solver_tolerance : relative tolerance of the driveline's map: what a step leaves is some 1e-13 then, and the
        derivatives are good to 2e-7
    stuck : slip speed, rad/s, below which the set-valued law is taken to stick
    growth : over a segment, above which it is cut: what a step of the solver leaves, some 1e-13, stays below 1e-10
    regrowth : over a segment, in `growth`, above which the orbit is cut anew
    fewer_after : points after which fewer segments are tried
    parts : of a cycle, or of a part of it, in which the growth is looked at
    newton_tolerance, newton_iterations : last step at which an orbit counts as found, and most steps
    newton_rounding : residual below which no further step is worth taking
    newton_step : longest
    newton_parts : of a step that are tried in order until the residual falls, or the event sequence stays
    singular : singular value, relative to the largest one, below which a Jacobian is singular there
    lost : reciprocal of a multiplier that the pencil of several segments has lost digits of: some 1e-16 is left of it
        there, so that 1e-8 stands for half the digits. The product of the segments gives it, as it is the largest
    residual : above which nothing counts as an orbit, however short the last step was: where the Jacobian is singular
        (a runaway is one), the shortest step may be none at all
    same : distance below which two orbits are the same
    neutral : distance of a multiplier from the unit circle that may be rounding: what is no further is neither stable
        nor a change of sign of a test function
    correct_tolerance, correct_iterations, correct_step : the same as Newton's for the corrector of a continuation; a
        longer step ends it
    squared : a step below this leaves an error of its square; the residual before it then decides too
    slowest : share of the step before above which the corrector is given up: a shorter step costs less
    grown, nothing : growth of a residual by the last step above which that has led elsewhere; a residual that is none
    contraction : share of the corrector's first step that its second one is to be: four of them then reach rounding
    first_step, flat_step : of a continuation; without the amplitudes among the arclength's coordinates
    smallest_step, largest_step : bounds of the step
    wanted, farthest : distance between predictor and corrector that is aimed at; relative to the step, at most
    shorter, longer, longer_after_refused : most that a step is shortened and lengthened by, the last where a longer one
        has just been refused
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
    located, locate_iterations : last Newton step at which a bifurcation counts as found, and most steps
    noise, idle : part of the larger end value below which a test may be rounding, and evaluations in a row that then
        may fail to halve the least one before the root counts as found: to narrow the bracket further would be to ask
        the rounding
    forward : least cosine between tangent and chord with which the tangents at its ends tell where the branch runs
    complex_pair : argument above which a pair of multipliers is complex and not real
    branch_point_step, branch_point_tolerance, branch_point_iterations : of Newton's method on the system of a branch
        point: the difference by which it takes derivatives, its last step, and most steps
    branch_point_reach, branch_point_defect : how far it may go, and what may be left of the defect that it carries
    opposite : cosine, but for its sign, beyond which what tells the halves of two orbits apart has turned round
    halves_met : distance between the halves of a fold's orbit at which a curve that goes no further has come to a
        generalised doubling, whose parameters are then known to its square
    halves_reach : how far a doubling in which such a branch ends may be from where its halves look the same
    passing, passed : distance from its first point, relative to the step, within which a chord is looked at for a
        closed branch, and within which the branch is at that point
    most_borders : changes of the event sequence that are looked for in one step
    corner_step : smallest step beyond a corner
    beside : how far beyond a change of the event sequence its other side is looked at
    border : margin, relative to its natural size, at which a sliding bifurcation counts as found
    border_halvings : of the bracket before Newton's method, and further ones where that does not get through; none in
        the end
    border_residual, border_iterations : residual of the orbit itself at which it counts as closed, and most steps
    border_left : share of the margin that a Newton step leaves, so as to stay on the side that has one
    border_finest : distance from the border below which it is not resolved where the margin changes very fast (on a
        canard: slip that follows the falling branch of friction); that distance is the residual then
    border_astray : distance from the bracket, in its lengths, beyond which another border has been found
    repeats : changes of one kind that are looked for at once (a symmetric motion has them in pairs)
    amplitudes : distances from a doubling at which its branch is looked for; next to a canard, where the map bends
        within 1e-5, only the smallest are on it
    max_branches : of a bifurcation diagram
    longest_period : followed in it, in periods of the excitation
    alike : difference of two amplitudes, relative to the largest of a sweep, up to which they are those of one motion
    next_to_nothing : part of the largest size of a sweep below which that of its periodic motions is no measure
    near_end : how far a bifurcation may be from where stability ends, in parts of the range and of the largest size
        together
    same_segment : difference of the largest sizes, relative to themselves, up to which two stable segments are one
    narrowest : width, relative to the range, below which a segment is left out: on canards stability comes and goes
        within less
    settling : engine cycles after which a scene is asked whether it has settled; after the last ones it is taken for
        aperiodic
    longest_start, deepest_switch : longest period to begin with, engine cycles, and most generations of doubled
        branches, that may be asked for
    guesses : section points from which a first orbit is looked for
    elsewhere : values of the range at which a motion that settles is looked for where none does at the scene's own
    off_chord : how far a motion may be off the chord between two points, relative to how much that chord climbs
    on_chord : the same where the chord does not climb
    curve_step, curve_regrowth : longest step along a curve of bifurcations, of which a picture shows every corner, and
        `regrowth` there
    curve_tolerance : last step and residual with which a point of a curve is one
    curve_root, curve_jump : width of the bracket of a point of codimension two, relative to the step, and part of the
        larger end value above which its test function jumps there
    difference : step along null vectors of length one for first derivatives of the Jacobian. Beside canards motions
        bend within 1e-7, and the Jacobian's own noise is some 1e-14: measured by halving, the derivative is good to
        four digits in both cases
    bend : the same for second derivatives, relative to the length within which the Jacobian changes by one
    margin_step : of differences of a margin by the two parameters
    limit_landings : smoothing of the scene over those at which a trace over the smoothing has points, the last one its
        end
    limit_steps : first and smallest step of that trace
    limit_least : smoothing of the scene over that which a trace must have reached to be extrapolated
    limit_farthest : how far the parameter may go on it, in widths of its range: a limit may lie outside
    limit_gain, limit_safety : part of what an extrapolation adds to a straight line that its error is at least; and
        times an error that is taken. Of 44 limits that the set-valued law has too, the farthest was 0.8 away without
    limit_stuck : slip speed on the section at which a smoothed motion is one in stick
    limit_solved : error, relative to the range, of a bifurcation of the set-valued law
    """

    solver_tolerance: float = 1e-12
    stuck: float = 1e-12
    growth: float = 1e2
    regrowth: float = 10.0
    fewer_after: int = 20
    parts: int = 16
    newton_tolerance: float = 1e-10
    newton_iterations: int = 25
    newton_rounding: float = 1e-12
    newton_step: float = 2.0
    newton_parts: tuple[float, ...] = (1.0, 0.5, 0.25, 0.1, 0.03)
    singular: float = 1e-12
    lost: float = 1e-8
    residual: float = 5e-9
    same: float = 1e-6
    neutral: float = 1e-9
    correct_tolerance: float = 1e-9
    correct_iterations: int = 8
    correct_step: float = 10.0
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
    shorter: float = 0.5
    longer: float = 2.0
    longer_after_refused: float = 1.2
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
    locate_iterations: int = 15
    noise: float = 1e-6
    idle: int = 2
    forward: float = 0.1
    complex_pair: float = 1e-6
    branch_point_step: float = 1e-6
    branch_point_tolerance: float = 1e-9
    branch_point_iterations: int = 12
    branch_point_reach: float = 1e-2
    branch_point_defect: float = 1e-6
    opposite: float = 0.8
    halves_met: float = 1e-2
    halves_reach: float = 0.1
    passing: float = 0.2
    passed: float = 0.02
    most_borders: int = 6
    corner_step: float = 1e-10
    beside: tuple[float, ...] = (1e-8, 1e-7, 1e-6, 1e-5)
    border: float = 1e-12
    border_halvings: tuple[int, ...] = (24, 20, 0)
    border_residual: float = 1e-11
    border_iterations: int = 40
    border_left: float = 0.1
    border_finest: float = 1e-12
    border_astray: float = 10.0
    repeats: int = 8
    amplitudes: tuple[float, ...] = (3e-3, 1e-3, 1e-2, 3e-4, 3e-5, 3e-6, 1e-6)
    max_branches: int = 24
    longest_period: int = 12
    alike: float = 0.01
    next_to_nothing: float = 1e-3
    near_end: float = 0.05
    same_segment: float = 1e-3
    narrowest: float = 1e-3
    settling: tuple[int, ...] = (300, 1200, 4800)
    longest_start: int = 16
    deepest_switch: int = 8
    guesses: int = 8
    elsewhere: int = 9
    off_chord: float = 0.3
    on_chord: float = 1e-3
    curve_step: float = 0.03
    curve_regrowth: float = 2.0
    curve_tolerance: float = 1e-8
    curve_root: float = 1e-9
    curve_jump: float = 1e-2
    difference: float = 1e-8
    bend: float = 1e-3
    margin_step: float = 1e-6
    limit_landings: tuple[float, ...] = (8e-3, 4e-3, 2e-3, 1e-3)
    limit_steps: tuple[float, float] = (0.02, 1e-7)
    limit_least: float = 0.3
    limit_farthest: float = 100.0
    limit_gain: float = 0.1
    limit_safety: float = 4.0
    limit_stuck: float = 1e-3
    limit_solved: float = 1e-9

    @property
    def finest(self) -> float:
        """Shortest part of a segment, cycles."""
        return 1.0 / self.parts**3


DEFAULTS = Settings()
