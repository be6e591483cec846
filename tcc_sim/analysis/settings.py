"""The settings of the room: every tolerance, length and bound that runs are analysed with, in one object."""

from __future__ import annotations

from dataclasses import dataclass

from tcc_sim.model.quantity import quantity


@dataclass(frozen=True)
class Settings:
    """How cycles are found in time, judged, and compared with each other."""

    # The period of a motion on its section (`periodicity.py`).
    maximum_period: int = quantity(16, "longest period looked for", "periods of excitation")
    tolerance: float = quantity(1e-4, "repetition, relative to the size of the motion, that counts as settled")
    fine: float = quantity(1e-8, "repetition of each coordinate, relative to its largest value, over cycles after "
                           "which fewer need not be seen")
    near: float = quantity(0.25, "largest change over a period at the end of a run that still settles, relative to the "
                           "size of the motion")
    distance: float = quantity(0.1, "largest distance of such a run from its limit, relative to the size of the motion")
    same: float = quantity(0.05, "largest distance of two points of the limit that count as one, relative to the "
                           "remaining distance")
    modes: int = quantity(3, "most modes of a decay: the section has three coordinates")
    misfit: float = quantity(0.02, "largest misfit of a decay, relative to its own size")
    exact: float = quantity(1e-3, "misfit at which fewer modes are enough")
    least_shrinking: float = quantity(0.95, "largest part of a difference that a decay leaves over a third of the run")
    least_decay: float = quantity(0.05, "least natural logarithm of a decay over the run that distinguishes it from a "
                                  "lasting motion")
    doubtful: float = quantity(0.5, "a difference may vanish in the limit if its decay leaves less than this part of "
                               "it; a decay whose rate falls below this part within the run may end before")
    shrinking: float = quantity(0.02, "least shrinking over the run, relative to the remaining difference")
    ended: float = quantity(0.01, "a fall of a difference has ended if it varies by less than this part of its last "
                            "third's fall while the period repeats")
    gap: float = quantity(1.5, "distance of neighbouring samples that is a gap, relative to the median one")
    after_a_gap: int = quantity(16, "least length without a gap before a period is stated after one: that of the "
                                "longest", "periods of excitation")
    growth: float = quantity(2.0, "growth of a difference from a third of the run to the next, twice, that shows a "
                             "departing motion")

    # The figures of a steady state (`summary.py`).
    discard: int = quantity(50, "length dropped as transient: the paper's rule", "periods of excitation")
    rounding: float = quantity(1e-12, "largest share of time in stick that counts as 0, and in slip as 1")
    drift: float = quantity(4.0, "change of the largest slip speeds over a run without a period that marks a "
                            "transient, in standard errors")
    growth_errors: float = quantity(4.0, "standard errors by which the slip speed must rise over a run that grows")
    halving_errors: float = quantity(2.0, "standard errors by which the second step of the rise must exceed half of "
                                     "the first")
    passing: float = quantity(5e-3, "largest stick fraction that counts as slip through v = 0: the smoothed law counts "
                              "the passage through its layer")

    # Orders of a torque that was commanded or comes from data (`orders.py`).
    driven: float = quantity(0.05, "least amplitude of an order of the torque, relative to its largest: sidelobes of "
                             "Hann's window reach 0.027")

    # Cycles of a recording while it is read (`stream.py`).
    bridged: float = quantity(2.5, "longest distance of states that is bridged, as by one lost state, in ticks")
    recording_tolerance: float = quantity(2e-3, "`tolerance` of a recorded section: ticks do not fall on cycle ends, "
                                          "and fixed steps are coarse")
    drifting: float = quantity(5e-3, "a cycle that differs by this part of the length of the last ones belongs to no "
                               "period")
    at_the_end: int = quantity(16, "how many these last ones are", "periods of excitation")

    # When engine cycles start (`engine_clock.py`).
    slack: float = quantity(1e-9, "part of a period of excitation by which a sample may miss the instant at which "
                            "the cycle starts")
    memory: int = quantity(6, "blocks from which the next phase is expected, by a parabola")
    full_size: float = quantity(0.7, "part of the amplitude of the next block that the first of a stretch must have, "
                                "and the last of the one before it")
    steady: float = quantity(0.02, "rms deviation of the phases from uniform rotation up to which a frequency is "
                             "constant", "rad")
    noise: float = quantity(3.0, "the same in units of their own noise")
    fewest_for_noise: int = quantity(6, "blocks from which their noise can be told")
    largest_noise: float = quantity(0.17, "the largest that a constant frequency may have", "rad")

    # The phase of a recorded torque (`torque_phase.py`).
    shortest_opening: int = quantity(1 << 8, "samples from which the line is found before it is followed; the shortest "
                                     "stretch that shows it serves")
    longest_opening: int = quantity(1 << 14, "the most of them")
    opening_cycles: float = quantity(6.0, "cycles of the line that such a stretch must hold")
    steepest: float = quantity(0.12, "largest relative change of frequency, either way, that is tried on it", "1/s")
    drifts: int = quantity(13, "how many such changes are tried, evenly")
    cycles_per_block: int = quantity(2, "least size of a block, which has one phase", "cycles of the line")
    samples_per_block: int = quantity(32, "the same", "samples")
    strongest_line: float = quantity(0.2, "part of the variance of a block, its drift apart, that the line must hold")
    largest_surprise: float = quantity(1.0, "largest difference of a block's phase from what the blocks before it let "
                                       "expect", "rad")
    fastest_drift: float = quantity(0.3, "largest relative change of frequency that is expected", "1/s")
    largest_twist: float = quantity(0.5, "largest difference between the phases of the halves of a block", "rad")
    misses: int = quantity(2, "blocks one after the other that may fail within a stretch")
    fewest_blocks: int = quantity(4, "a run of fewer is fitted as a whole, with a constant frequency")
    few_blocks: int = quantity(12, "so is a run of fewer than these where that holds as much of its variance as the "
                               "blocks do")
    as_much: float = quantity(0.02, "part of the variance by which these may differ")
    least_known: float = quantity(0.25, "part of a run in which the phase must be known")

    # Orders along a run (`orders.py`).
    window: int = quantity(16, "length of a window", "periods of excitation")
    hop: int = quantity(4, "from one window to the next", "periods of excitation")
    per_cycle: int = quantity(64, "points in a period of excitation after resampling")
    bridged_hole: float = quantity(0.0625, "longest hole of a table that a cubic bridges", "periods of excitation")
    hysteresis: float = quantity(0.2, "level above and below the middle of a tacho's range that an edge must pass, "
                                 "relative to the range")
    samples_per_pulse: float = quantity(3.5, "samples from pulse to pulse that a tacho must have", "samples")
    plausible: float = quantity(0.25, "largest deviation of an interval between pulses from its neighbours, relative")
    implausible: float = quantity(0.02, "largest share of pulses that may be missing or extra")
    jittery: float = quantity(0.005, "jitter of pulses from which on a sentence names it, relative to their distance")
    jump: float = quantity(0.2, "largest change of an engine speed from row to row, relative")
    lost_speed: float = quantity(0.25, "largest share of rows in which an engine speed may be implausible")
    bridged_phase: float = quantity(0.1, "uncertainty of the phase across rows without a plausible speed up to which "
                                    "they are bridged", "periods of excitation")
    sharp: float = quantity(0.2, "share of a torque's variance in its strongest line that makes the line certain")
    agreement: float = quantity(0.01, "largest deviation of that line from a multiple of the excitation, relative")
    highest_order: int = quantity(10, "highest order that is given")
    least_samples: int = quantity(8, "samples that a cycle must have on average; orders up to a quarter of them, and "
                                  "`highest_order` at most, are given")

    of_samples: float = quantity(0.45, "highest frequency of an order, relative to that of a table's samples")

    # Spectra of steady states (`spectra.py`).
    spectrum_points: int = quantity(256, "points in a cycle of the excitation after resampling, at most")
    spectrum_window: int = quantity(64, "length of a window of a motion without a period, at most",
                                    "cycles of the excitation")
    spectrum_least: int = quantity(16, "the same at least", "cycles of the excitation")
    spectrum_cycles: int = quantity(1024, "length that a motion without a period is solved on for",
                                    "cycles of the excitation")
    subharmonic: float = quantity(1e-3, "part of the largest line above which one between the multiples of the "
                                  "excitation is listed")

    # Equivalent damping (`damping.py`).
    averaged: int = quantity(16, "length that the averages are taken over", "periods of excitation")
    rtol: float = quantity(1e-9, "relative tolerance of the motion and its integrals with the smoothed law")
    growth_between: float = quantity(0.07, "growth of slip on the falling law between two samples, in natural "
                                     "logarithm; the error is about its fourth power")
    fewest_samples: int = quantity(1024, "samples per cycle with the set-valued law, at least: between them the motion "
                                   "is interpolated from its equations")
    most_samples: int = quantity(131072, "the same at most")

    # Control (`control.py`, `replay/control.py`).
    most_steps: int = quantity(200_000, "most values of a held signal that are kept for a picture; the earliest go "
                               "first")
    settled_cycles: int = quantity(5, "least number of cycles to the end of a run that show that the mean stays",
                                   "periods of excitation")
    settled: float = quantity(0.02, "part of the step of the target, or of the peak after a disturbance, within which "
                              "the cycle mean counts as settled")
    band: float = quantity(0.1, "least band that counts as settled, and least jump of a target and amplitude of an "
                           "oscillation that count", "rad/s")
    isolated: float = quantity(4.0, "a change of the target is a jump if it is larger than its neighbours by this "
                               "factor; else the target moves")

    step_time: float = quantity(0.5, "longest change of the target in one direction, with rest before and after it, "
                                "that counts as one step", "s")
    observed: float = quantity(0.9, "least part of a segment whose cycles must be known for a verdict")

    # Judder (`loop_verdict.py`).
    judder: float = quantity(1.0 / 3.0, "least frequency, relative to that of the excitation: cycle means show "
                             "slower ones")
    judder_cycles: int = quantity(12, "shortest stretch that shows it", "periods of excitation")
    judder_points: int = quantity(64, "points in a period of excitation after resampling, at most")
    judder_least: float = quantity(0.05, "least amplitude, relative to the range of the cycle means")
    judder_share: float = quantity(0.5, "least part of what is fast and does not repeat in each period that its line "
                                   "must hold")

    # Verdicts on a controlled run (`loop_verdict.py`).
    reversals: tuple[float, ...] = quantity((0.125, 0.34), "reversals that end a swing, parts of the range of the "
                                            "second half of the run")
    irregular: float = quantity(0.35, "standard deviation of the durations of swings, relative to their mean, that "
                                "marks them as irregular")
    swings: int = quantity(6, "most of the last swings that are judged")
    fewest_swings: int = quantity(3, "fewest swings that make an oscillation")
    nearly: float = quantity(0.8, "part of the size of the other swings that makes one at either end complete")
    quiet_periods: float = quantity(3.0, "periods of the slowest oscillation left that a settled mean must last")
    alive: float = quantity(2.0, "periods after the last swing within which another one may follow")
    growth_of_swings: float = quantity(0.22, "least growth of the swings, in natural logarithm")
    decay_of_swings: float = quantity(0.1, "least decay of them, likewise")
    scatter: float = quantity(2.0, "the same in standard deviations of the swings about it")
    decays_on: float = quantity(0.34, "part of the rate of a decay that the last swings must show")
    coherent: float = quantity(0.5, "part of the variance that an oscillation within the band must hold")
    slowing: float = quantity(0.8, "part of the growth of the third before that the last third of a growth has at "
                              "least")
    blocks: int = quantity(32, "parts of a run whose means show a growth without oscillation")
    blocks_of_ripple: int = quantity(10, "the same of a ripple")
    chance: float = quantity(1e-4, "least probability that noise swings as regularly")
    growing_cycles: int = quantity(10, "least length of a growth without oscillation", "periods of excitation")
    standing: float = quantity(0.05, "change of the error within the last third of the run, relative to it, that "
                               "counts as none")
    of_noise: float = quantity(4.5, "standard deviations of a noise of the cycle means that leave them on target")
    white: float = quantity(-0.4, "largest correlation of neighbouring second differences of a noise; that of white "
                            "noise is -2/3")
    usual: float = quantity(0.4, "least square of a usual second difference of a noise, relative to the mean square")
    random: float = quantity(1.2, "mean square of a signal's differences, relative to that of the signal, from which "
                             "on it does not swing; that of white noise is 2")
    stays: float = quantity(1e-3, "range of the pressure's means over cycles, relative to the largest, that counts as "
                            "none")
    ripple: float = quantity(1.5, "growth of the ripple within the cycles that counts, as a factor")
    approaches: float = quantity(0.8, "an error from a moving target whose last third is at most this part of the one "
                                 "before has not ended its approach")
    lags: int = quantity(400, "delays of a moving target that are tried, up to a quarter of the segment")
    alike: float = quantity(0.5, "part of the variance of the cycle means that a delayed target must explain for a lag "
                            "and a gain")
    unexplained: float = quantity(0.2, "part of the variance of the error that a moving target may leave unexplained")
    held: float = quantity(1e-5, "difference of pressures, relative to the largest, that counts as none")
    at_a_limit: float = quantity(0.5, "part of the end of a run with the pressure at a limit that counts as saturated")
    sticks: float = quantity(0.02, "part of the end of a run in stick that counts as sticking")

DEFAULTS = Settings()
