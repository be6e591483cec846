"""The settings of the room: every tolerance, length and bound that sweeps and exponents work with, in one object."""

from __future__ import annotations

from dataclasses import dataclass

from tcc_sim.model.quantity import quantity


@dataclass(frozen=True)
class Settings:
    """How points of a sweep are solved, exponents worked out, and tasks given to others."""

    cycles: int = quantity(150, "default length of a solve", "periods of excitation")

    # The points of a sweep and their file (`sweep.py`, `file.py`).
    rtol: float = quantity(1e-6, "default relative tolerance of a sweep: that of sections (fig02: 4e-8, "
                           "set-valued 2e-7), and over the curves of Figs. 4 to 18, 57 values each, the period is "
                           "that at 1e-10 in all but three of 1995 points")
    phases_tried: int = quantity(1000, "number in which the nearest load's phase is searched", "periods of excitation")
    most_values: int = quantity(1_000_000, "most values of a range, of a grid, and of samples")
    longest_line: int = quantity(1 << 28, "longest line of a file of points; the first one of a sweep over a million "
                                 "values has a tenth of that", "bytes")

    order_samples: int = quantity(64, "samples of a run whose judder or orders are computed, per period of excitation")

    # When a motion counts as settled (`steady_state.py`).
    settled: float = quantity(1e-6, "repetition of a settled section, relative to the size of the motion")
    settled_window: int = quantity(50, "length over which it repeats: three longest periods", "periods of excitation")
    settled_block: int = quantity(25, "length that is solved at a time", "periods of excitation")

    # Lyapunov exponents (`exponents.py`, `simulation.py`).
    lyapunov_cycles: int = quantity(2000, "default length of a mean growth", "periods of excitation")
    confidence: float = quantity(0.95, "confidence of the interval of a mean growth")
    batches: int = quantity(20, "means of consecutive runs of cycles, each long enough to be nearly independent")
    aligning_cycles: int = quantity(50, "first part, not counted, in which the tangent vector turns to the direction "
                                    "of largest growth", "periods of excitation")
    neutral: float = quantity(0.02, "half width per cycle, in natural logarithm, up to which an interval that holds 0 "
                              "counts as a zero exponent")
    fine: float = quantity(1e-7, "relative tolerance of a mean growth")
    coarse: float = quantity(1e-6, "the tolerance whose difference from the finer one is taken for its error")
    compared: int = quantity(4, "of how many cycles one is taken at both")
    together: int = quantity(1000, "length over which tangent maps are worked out in one call", "periods of excitation")
    periodic_fine: float = quantity(1e-10, "`fine` about a periodic motion")
    periodic_coarse: float = quantity(1e-9, "`coarse` about a periodic motion")
    polishings: int = quantity(4, "Newton steps towards a periodic motion")
    closed: float = quantity(1e-9, "largest distance of a state from its image after a period, relative to the size of "
                             "the motion")
    nearby: float = quantity(0.1, "largest distance to the periodic motion, relative to its size")
    passed: float = quantity(1e-6, "logarithm of a multiplier above which a periodic motion is unstable, so that no "
                           "motion settles on it")
    long_period: int = quantity(128, "longest period that is searched before another "
                                     "diagnosis", "periods of excitation")
    longest_period: int = quantity(512, "longest period of motion and excitation together", "periods of excitation")
    converged: float = quantity(1e-6, "largest difference, relative to the size of the motion, of bump averages over "
                                "the halves of a section on a torus")

    # Tasks given to processes and clusters (`executors.py`, `sweep.py`).
    look: float = quantity(2.0, "time without a result after which the workers are checked", "s")
    connect_timeout: float = quantity(8.0, "time that a scheduler has to answer", "s")
    patience: float = quantity(60.0, "time without an answer or without workers before a sweep is given up", "s")
    lost_workers: int = quantity(10, "workers that may die over one task before the task is given up")
    ahead: int = quantity(3, "tasks handed out per thread")
    batch: int = quantity(32, "most points that a thread judges at once")
    batch_cycles: int = quantity(4800, "most cycles of them", "periods of excitation")
    dask_batch: int = quantity(8, "points in one task on a cluster: a task costs the scheduler about a millisecond")


DEFAULTS = Settings()
