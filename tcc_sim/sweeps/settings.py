"""The settings of the room: every tolerance, length and bound that sweeps and exponents work with, in one object.

`steady_state.Settling` says when a motion counts as settled, since callers differ in that.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """How points of a sweep are solved, exponents worked out, and tasks given to others.

    Attributes
    ----------
    rtol : of a sweep that is given none: sections are good to that (fig02: 4e-8, set-valued 2e-7), and over the curves
        of Figs. 4 to 18, 57 values each, the period is that at 1e-10 in all but three of 1995 points
    phases_tried : engine cycles among which one is looked for whose phase of the load is that of the neighbour's end
    most_values : of a range, of a grid, and of samples
    longest_line : of a file of points, bytes
    lyapunov_cycles : engine cycles of a mean growth where nothing is said
    confidence, batches : of its interval, and means of consecutive runs of cycles, long enough to be nearly independent
    aligning_cycles : in which the tangent vector turns to the direction of largest growth, not counted
    neutral : half width per cycle, in natural logarithm, up to which an interval that holds 0 counts as a zero exponent
    fine, coarse, compared : tolerances of a mean growth, and of how many cycles one is taken at both: their difference
        is taken for the error of the finer
    together : cycles whose tangent maps are worked out in one call
    periodic_fine, periodic_coarse : the same tolerances about a periodic motion
    polishings : Newton steps towards a periodic motion
    closed, nearby : largest distance of a state from its image after a period, and largest way to the periodic motion,
        relative to the size of the motion
    passed : logarithm of a multiplier above which a periodic motion is unstable, so that none can have settled on it
    long_period : longest that is looked for before a motion is called anything else, engine cycles
    longest_period : of motion and excitation together, engine cycles
    converged : largest difference, relative to the size of the motion, of bump averages over the halves of a section on
        a torus
    look : seconds without a result after which it is asked whether those who work are still there
    connect_timeout : seconds that a scheduler has to answer
    patience : seconds that it may be silent, or without workers, before a sweep that it works on is given up
    lost_workers : how many may die over one task before the task is given up
    dask_batch : points in one task on a cluster: a task costs the scheduler about a millisecond
    """

    rtol: float = 1e-6
    phases_tried: int = 1000
    most_values: int = 1_000_000
    longest_line: int = 1 << 28
    lyapunov_cycles: int = 2000
    confidence: float = 0.95
    batches: int = 20
    aligning_cycles: int = 50
    neutral: float = 0.02
    fine: float = 1e-7
    coarse: float = 1e-6
    compared: int = 4
    together: int = 1000
    periodic_fine: float = 1e-10
    periodic_coarse: float = 1e-9
    polishings: int = 4
    closed: float = 1e-9
    nearby: float = 0.1
    passed: float = 1e-6
    long_period: int = 128
    longest_period: int = 512
    converged: float = 1e-6
    look: float = 2.0
    connect_timeout: float = 8.0
    patience: float = 60.0
    lost_workers: int = 10
    dask_batch: int = 8


DEFAULTS = Settings()
