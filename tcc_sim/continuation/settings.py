"""The settings of the room: every tolerance, length and bound that the study of motions works with, in one object.

Lengths, steps and residuals are in natural sizes where nothing else is said. They stand in groups,
one for each part of the work, as BifurcationKit.jl's `ContinuationPar` holds its `NewtonPar`.
"""

from __future__ import annotations

from dataclasses import dataclass

from tcc_sim.model.quantity import quantity


@dataclass(frozen=True)
class Settings:
    """How orbits are solved for, followed and told apart."""

    # The driveline's map, and how a motion is cut into segments (`driveline.py`, `shooting.py`, `branch_track.py`).
    solver_tolerance: float = quantity(1e-12, "relative tolerance of the driveline's map: what a step leaves is some "
                                       "1e-13 then, and the derivatives are good to 2e-7")
    coarse_tolerance: float = quantity(1e-9, "the same for the first step of a corrector that has far to go")
    stuck: float = quantity(1e-12, "slip speed below which the set-valued law is taken to stick", "rad/s")
    growth: float = quantity(1e2, "growth over a segment above which it is cut: what a step of the solver leaves, some "
                             "1e-13, stays below 1e-10")
    regrowth: float = quantity(10.0, "growth over a segment, in `growth`, above which the orbit is cut anew")
    fewer_after: int = quantity(20, "points after which fewer segments are tried")
    parts: int = quantity(16, "parts of a cycle, or of a part of it, in which the growth is looked at")
    thorough: bool = quantity(False, "whether it is looked at about every change between stick and slip too: what "
                              "grows in slip and is taken back by stick within one part is not in its derivative, but "
                              "in how sharply it bends")

    # Newton's method for an orbit, and when two are the same (`newton.py`).
    newton_tolerance: float = quantity(1e-10, "last step at which an orbit counts as found")
    newton_iterations: int = quantity(25, "most steps of the method")
    newton_rounding: float = quantity(1e-12, "residual below which no further step is worth taking")
    newton_step: float = quantity(2.0, "longest step; a longer one is cut to it")
    newton_parts: tuple[float, ...] = quantity((1.0, 0.5, 0.25, 0.1, 0.03), "parts of a step that are tried in order "
                                               "until the residual falls, or the event sequence stays")
    singular: float = quantity(1e-12, "singular value, relative to the largest one, below which a Jacobian is singular")
    lost: float = quantity(1e-8, "reciprocal of a multiplier that the pencil of several segments has lost digits of: "
                           "some 1e-16 is left of it there, so that 1e-8 stands for half the digits. The product of "
                           "the segments gives it, as it is the largest")
    residual: float = quantity(5e-9, "residual above which nothing counts as an orbit, however short the last step "
                               "was: where the Jacobian is singular (a runaway is one), it may be none at all")
    same: float = quantity(1e-6, "distance below which two orbits are the same")
    neutral: float = quantity(1e-9, "distance of a multiplier from the unit circle that may be rounding: what is no "
                              "further is neither stable nor a change of sign of a test function")

    # The corrector of a continuation (`palc.py`).
    correct_tolerance: float = quantity(1e-9, "last step at which a point counts as found")
    correct_iterations: int = quantity(8, "most steps of the corrector")
    correct_step: float = quantity(10.0, "step above which the corrector is given up")
    squared: float = quantity(1e-5, "a step below this leaves an error of its square; the residual before it then "
                              "decides too")
    slowest: float = quantity(0.7, "share of the step before above which the corrector is given up: a shorter step of "
                              "the continuation costs less")
    missed: float = quantity(1e-8, "distance between predictor and corrector above which the first step of the next "
                             "corrector is one of `coarse_tolerance`")
    grown: float = quantity(10.0, "growth of a residual by the last step above which that has led elsewhere")
    nothing: float = quantity(1e-12, "residual that counts as none there")
    contraction: float = quantity(0.15, "share of the corrector's first step that its second one is to be: four of "
                                  "them then reach rounding")

    # The steps of a continuation and their control (`palc.py`, `follow.py`).
    first_step: float = quantity(0.01, "first step of a continuation")
    flat_step: float = quantity(1e-3, "first step without the amplitudes among the arclength's coordinates")
    smallest_step: float = quantity(1e-9, "smallest step, below which a continuation ends")
    largest_step: float = quantity(0.1, "largest step")
    wanted: float = quantity(2e-3, "distance between predictor and corrector that is aimed at")
    farthest: float = quantity(0.3, "the largest that is taken, relative to the step")
    shorter: float = quantity(0.5, "most that a step is shortened by")
    longer: float = quantity(2.0, "most that a step is lengthened by")
    longer_after_refused: float = quantity(1.2, "the same where a longer one has just been refused")
    turn: float = quantity(0.9, "least cosine between neighbouring tangents")
    branching: float = quantity(1e-4, "step in which a change of the determinant's sign is believed")
    nodes: int = quantity(3, "points before the last one from which the next is predicted")
    max_points: int = quantity(3000, "most points in one direction of a branch")
    max_tries: int = quantity(6000, "most steps tried, halved ones too, in one direction")

    # Where a branch ends, or is closed (`branch_track.py`, `detection.py`, `branch.py`, `diagram.py`).
    canard: float = quantity(1e10, "modulus of a multiplier above which a branch ends: an orbit known to 1e-12 closes "
                             "to no better than 1e-2 over its period, and neither value nor sign of such a multiplier "
                             "can be trusted. Motions along the falling branch of friction get there")
    family: float = quantity(1e-7, "distance of a multiplier from 1, and of the tangent from one without a change of "
                             "the parameter, on a family of motions at one value")
    family_length: float = quantity(1e-2, "how far a branch runs along a family before it counts as one")
    merged: float = quantity(1e-5, "distance, relative to the range, at which a branch ends in a doubling, or two "
                             "begin in one")
    same_end: float = quantity(1e-6, "distance, relative to the range, at which a fold is the end where a branch "
                               "passes into its own shift")
    passing: float = quantity(0.2, "distance from the first point, relative to the step, within which a chord is "
                              "looked at for a closed branch")
    passed: float = quantity(0.02, "distance from the first point, relative to the step, within which the branch is at "
                             "that point")

    # Special points: found and located (`detection.py`, `special_points.py`, `bracket.py`, `augmented.py`).
    detect: bool = quantity(True, "whether special points are looked for")
    root: float = quantity(1e-13, "width of a bracket, relative to the step, at which a root counts as found")
    enough: float = quantity(1e-11, "residual at which a root counts as found, however wide the bracket is")
    spurious: float = quantity(1e-2, "residual above which a change of sign is one of rounding, not of a bifurcation")
    located: float = quantity(1e-8, "last Newton step at which a bifurcation counts as found")
    locate_iterations: int = quantity(15, "most Newton steps towards a bifurcation")
    noise: float = quantity(1e-6, "part of the larger end value below which a test may be rounding")
    idle: int = quantity(2, "evaluations in a row that may then fail to halve the least one before the root counts as "
                         "found: to narrow the bracket further would be to ask the rounding")
    forward: float = quantity(0.1, "least cosine between tangent and chord with which the tangents at its ends tell "
                              "where the branch runs")
    complex_pair: float = quantity(1e-6, "argument above which a pair of multipliers is complex and not real", "rad")
    branch_point_step: float = quantity(1e-6, "difference by which Newton's method on the system of a branch point "
                                        "takes derivatives")
    branch_point_tolerance: float = quantity(1e-9, "last step of that method at which a branch point counts as found")
    branch_point_iterations: int = quantity(12, "most steps of that method")
    branch_point_reach: float = quantity(1e-2, "how far that method may go from where it began")
    branch_point_defect: float = quantity(1e-6, "what may be left of the defect that it carries")
    opposite: float = quantity(0.8, "cosine, but for its sign, beyond which what tells the halves of two orbits apart "
                               "has turned round")
    halves_met: float = quantity(1e-2, "distance between the halves of a fold's orbit at which a curve that goes no "
                                 "further has come to a generalised doubling, whose parameters are then known to its "
                                 "square")
    halves_reach: float = quantity(0.1, "how far a doubling in which such a branch ends may be from where its halves "
                                   "look the same")

    # Sliding bifurcations, where the event sequence changes (`sliding.py`, `detection.py`, `branch_track.py`).
    most_borders: int = quantity(6, "changes of the event sequence that are looked for in one step")
    corner_step: float = quantity(1e-10, "smallest step beyond a corner")
    beside: tuple[float, ...] = quantity((1e-8, 1e-7, 1e-6, 1e-5), "how far beyond a change of the event sequence its "
                                         "other side is looked at")
    border: float = quantity(1e-12, "margin, relative to its natural size, at which a sliding bifurcation counts as "
                             "found")
    border_halvings: tuple[int, ...] = quantity((24, 20, 0), "halvings of the bracket before Newton's method, and "
                                                "further ones where that does not get through; none in the end")
    border_residual: float = quantity(1e-11, "residual of the orbit itself at which it counts as closed")
    border_iterations: int = quantity(40, "most steps of Newton's method towards a border")
    border_left: float = quantity(0.1, "share of the margin that a Newton step leaves, so as to stay on the side that "
                                  "has one")
    border_finest: float = quantity(1e-12, "distance from the border below which it is not resolved where the margin "
                                    "changes very fast (on a canard: slip that follows the falling branch of "
                                    "friction); that distance is the residual then")
    border_astray: float = quantity(10.0, "distance from the bracket beyond which another border has been "
                                    "found", "lengths of the bracket")
    repeats: int = quantity(8, "changes of one kind that are looked for at once (a symmetric motion has them in pairs)")

    # Bifurcation diagrams, the motions they begin with, and what lies on them or ends them (`diagram.py`, `motions.py`,
    # `initial_orbits.py`, `loss_of_stability.py`, `branch.py`).
    amplitudes: tuple[float, ...] = quantity((3e-3, 1e-3, 1e-2, 3e-4, 3e-5, 3e-6, 1e-6), "distances from a doubling at "
                                             "which its branch is looked for; next to a canard, where the map bends "
                                             "within 1e-5, only the smallest are on it")
    max_branches: int = quantity(24, "most branches of a bifurcation diagram")
    longest_period: int = quantity(12, "longest period that is followed in it", "periods of the excitation")
    alike: float = quantity(0.01, "difference of two amplitudes, relative to the largest of a sweep, up to which they "
                            "are those of one motion")
    next_to_nothing: float = quantity(1e-3, "part of the largest size of a sweep below which that of its periodic "
                                      "motions is no measure")
    near_end: float = quantity(0.05, "how far a bifurcation may be from where stability ends, in parts of the range "
                               "and of the largest size together")
    same_segment: float = quantity(1e-3, "difference of the largest sizes, relative to themselves, up to which two "
                                   "stable segments are one")
    narrowest: float = quantity(1e-3, "width, relative to the range, below which a segment is left out: on canards "
                                "stability comes and goes within less")
    settling: int = quantity(4800, "time after which a motion that repeats nowhere is taken for aperiodic",
                             "engine cycles")
    settling_elsewhere: int = quantity(300, "the same at other values of the range", "engine cycles")
    longest_start: int = quantity(16, "longest period to begin with that may be asked for", "engine cycles")
    deepest_switch: int = quantity(8, "most generations of doubled branches that may be asked for")
    guesses: int = quantity(8, "section points from which a first orbit is looked for")
    elsewhere: int = quantity(9, "values of the range at which a motion that settles is looked for where none does at "
                              "the scene's own")
    off_chord: float = quantity(0.3, "how far a motion may be off the chord between two points, relative to how much "
                                "that chord climbs")
    on_chord: float = quantity(1e-3, "the same where the chord does not climb")

    # Curves of bifurcations in two keys (`curve_track.py`, `codim2_points.py`, `augmented.py`).
    curve_step: float = quantity(0.03, "longest step, of which a picture shows every corner")
    curve_regrowth: float = quantity(2.0, "`regrowth` along a curve")
    finer_growths: tuple[float, ...] = quantity(
        (10.0, 3.0), "growths over a segment, in order, with which orbits are cut anew, thoroughly, for want of a step")
    curve_tolerance: float = quantity(1e-8, "last step and residual with which a point of a curve is one")
    curve_root: float = quantity(1e-9, "width of the bracket of a point of codimension two, relative to the step")
    curve_slope: float = quantity(1e-2, "distance from it at which the slope of its test function is taken, relative "
                                  "to the bracket")
    resolved: float = quantity(3.0, "changes of a test function by other difference steps and one more Newton step "
                               "that it must exceed on both sides of such a point")
    curve_exact: float = quantity(1e-11, "least error of a point of codimension two, relative to the ranges")
    singular_apart: float = quantity(0.05, "least distance from a singular end of a curve at which it is extrapolated")
    curve_jump: float = quantity(1e-2, "part of the larger end value above which its test function jumps there")
    difference: float = quantity(1e-8, "step along null vectors of length one for first derivatives of the Jacobian. "
                                 "Beside canards motions bend within 1e-7, and the Jacobian's own noise is some 1e-14: "
                                 "measured by halving, the derivative is good to four digits in both cases")
    bend: float = quantity(8e-3, "the same for second derivatives, relative to the length within which the Jacobian "
                           "changes by one")
    margin_step: float = quantity(1e-6, "step of differences of a margin by the two parameters")

    # Where a bifurcation goes as the smoothing goes to none (`limits.py`).
    limit_landings: tuple[float, ...] = quantity((8e-3, 4e-3, 2e-3, 1e-3), "smoothing of the scene over those at which "
                                                 "a trace over the smoothing has points, the last one its end")
    limit_steps: tuple[float, float] = quantity((0.02, 1e-7), "first and smallest step of that trace")
    limit_least: float = quantity(0.3, "smoothing of the scene over that which a trace must have reached to be "
                                  "extrapolated")
    limit_farthest: float = quantity(100.0, "how far the parameter may go on it, in widths of its range: a limit may "
                                     "lie outside")
    limit_gain: float = quantity(0.1, "part of what an extrapolation adds to a straight line that its error is at "
                                 "least")
    limit_safety: float = quantity(4.0, "times an error that is taken. Of 44 limits that the set-valued law has too, "
                                   "the farthest was 0.8 away without")
    limit_stuck: float = quantity(1e-3, "slip speed on the section at which a smoothed motion is one in stick", "rad/s")
    limit_solved: float = quantity(1e-9, "error, relative to the range, of a bifurcation of the set-valued law")

    @property
    def finest(self) -> float:
        """Shortest part of a segment, cycles."""
        return 1.0 / self.parts**3


DEFAULTS = Settings()
