"""Tolerances, lengths and bounds of the search for attractors and basins.

Distances are in the map's scales, lengths in cycles.
"""

from __future__ import annotations

from dataclasses import dataclass

from tcc_sim.model.quantity import quantity


@dataclass(frozen=True)
class Settings:
    """How attractors are found and distinguished, and how cells are followed to them."""

    # Finding and distinguishing attractors (`attractors.py`).
    longest_period: int = quantity(16, "longest period looked for", "cycles")
    settling: int = quantity(256, "time after which the search first tests whether a motion repeats; doubled up "
                             "to `longest`", "cycles")
    longest: int = quantity(4096, "time after which a motion that has not repeated counts as one without a "
                            "period", "cycles")
    near: float = quantity(0.3, "distance of two points a period apart below which Newton's method starts")
    returned: float = quantity(1e-3, "the same for a motion that starts near a cloud")
    cloud: int = quantity(2048, "section points in the cloud of a motion without a period")
    most_clouds: int = quantity(32, "how often the search adds that many points while new ones lie off the cloud")
    new: float = quantity(0.05, "part of new points that may lie off a complete cloud")
    witnesses: int = quantity(16, "motions from near a cloud that are followed for `longest`; the cloud is a "
                              "transient if one of them leaves")
    same: float = quantity(1e-6, "distance at which two orbits are one")
    same_cloud: float = quantity(1e-3, "distance at which two clouds' points are one")
    goes_on: float = quantity(0.5, "largest distance between an attractor and its continuation at the next value")
    shared: float = quantity(0.9, "share of a cloud's points that must be that near")

    # Capture by an attractor (`attractors.py`, `proximity.py`, `compute.py`).
    radius: float = quantity(0.2, "largest capture radius")
    smallest_radius: float = quantity(1e-4, "bound below which a capture radius is not halved further")
    apart: float = quantity(0.4, "largest capture radius, relative to the distance of the nearest other attractor")
    probes: int = quantity(24, "motions from the capture sphere that validate the radius")
    probe_cycles: int = quantity(600, "longest time of such a motion", "cycles")
    cycles: int = quantity(600, "longest time that a cell is followed", "cycles")
    chunk: int = quantity(4, "time after which motions are first compared with attractors", "cycles")

    # The cells of a plane (`compute.py`, `driveline.py`).
    seeds: int = quantity(48, "cells from which the search starts, beside the corners and the middle")
    rounds: int = quantity(3, "how often the search starts again from undecided cells")
    searched: int = quantity(24, "undecided cells from which it then starts")
    rtol: float = quantity(1e-8, "relative tolerance of the motions that find attractors")
    rtol_cells: float = quantity(3e-5, "relative tolerance of the motions that label cells: it moves edges of "
                                 "basins by 1e-5 rad/s (median of 195 of two scenes, with either law; at most 1e-4); "
                                 "one of 117 000 cells of seven scenes has another label than at 1e-9. Attractors need "
                                 "more: with this a chaotic one of omega/omega_n = 0.36, mu_k = 0.7 mu_s is left for a "
                                 "motion of period 2")
    constant: float = quantity(40.0, "times 1/alpha, a slip speed beyond which the law's exponential is below 1e-17 of "
                               "the rest")
    most_cells: int = quantity(4_000_000, "most cells of a plane")
    attractors_shown: int = quantity(12, "attractors in the text of a result")
    distances: tuple[int, ...] = quantity((1, 2, 4, 8, 16), "distances over which final states are compared (C. "
                                          "Grebogi et al., Phys. Lett. A 99, 1983)", "cells")


DEFAULTS = Settings()
