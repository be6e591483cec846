"""The settings of the room: every tolerance, length and bound that the search for attractors and basins works with.

Distances are in the map's natural sizes, lengths in cycles.
"""

from __future__ import annotations

from dataclasses import dataclass

from tcc_sim.model.quantity import quantity


@dataclass(frozen=True)
class Settings:
    """How attractors are found and told apart, and cells followed to them."""

    # How attractors are found and told apart (`attractors.py`).
    longest_period: int = quantity(16, "longest period looked for", "cycles")
    settling: int = quantity(256, "time after which a motion is first asked whether it repeats; doubled until "
                             "`longest`", "cycles")
    longest: int = quantity(4096, "time after which a motion that repeats nowhere counts as one without a "
                            "period", "cycles")
    near: float = quantity(0.3, "distance of two points a period apart from which Newton's method is tried")
    returned: float = quantity(1e-3, "the same for a motion from beside a cloud")
    cloud: int = quantity(2048, "section points that are kept of a motion without a period, as a cloud")
    most_clouds: int = quantity(32, "how often so many more points are added while a part of them lies off the cloud")
    new: float = quantity(0.05, "part of further points that may lie off a cloud that is whole")
    witnesses: int = quantity(16, "motions from beside a cloud that are followed for `longest`: where one of them "
                              "leaves, it was a transient")
    same: float = quantity(1e-6, "distance at which two orbits are one")
    same_cloud: float = quantity(1e-3, "distance at which two clouds' points are one")
    goes_on: float = quantity(0.5, "largest distance of two attractors at neighbouring values of a key that are one")
    shared: float = quantity(0.9, "share of a cloud's points that must be so near")

    # When a motion has come to an attractor (`attractors.py`, `proximity.py`, `compute.py`).
    radius: float = quantity(0.2, "largest capture radius")
    smallest_radius: float = quantity(1e-4, "a capture radius is halved until it is no larger")
    apart: float = quantity(0.4, "largest capture radius, relative to the distance of the nearest other attractor")
    probes: int = quantity(24, "motions from the sphere of a capture radius that validate it")
    probe_cycles: int = quantity(600, "time that each of them may take", "cycles")
    cycles: int = quantity(600, "longest that a cell is followed", "cycles")
    chunk: int = quantity(4, "time after which motions are first asked where they are", "cycles")

    # The cells of a plane (`compute.py`, `driveline.py`).
    seeds: int = quantity(48, "cells of the plane from which attractors are looked for, beside its corners and middle")
    rounds: int = quantity(3, "how often attractors are looked for again from the cells that came to none known")
    searched: int = quantity(24, "undecided cells from which they are then looked for")
    rtol: float = quantity(1e-8, "relative tolerance of the motions that attractors are found from and judged by")
    rtol_cells: float = quantity(3e-5, "relative tolerance of the motions that are followed to one: it moves edges of "
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
