"""The settings of the room: every tolerance, length and bound that the search for attractors and basins works with.

Distances are in the map's natural sizes, lengths in cycles.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """How attractors are found and told apart, and cells followed to them.

    Attributes
    ----------
    longest_period : looked for
    settling : after which a motion is first asked whether it repeats; doubled until `longest`
    longest : after which a motion that repeats nowhere counts as one without a period
    near : distance of two points a period apart from which Newton's method is tried
    returned : the same for a motion from beside a cloud
    cloud, most_clouds : section points kept of a motion without a period, and how often so many more while they lie
        elsewhere
    new : part of further points that may lie off a cloud that is whole
    witnesses : motions from beside a cloud that are followed for `longest`: where one of them leaves, it was a
        transient
    same, same_cloud, shared : distance at which two orbits are one, and two clouds' points; share of a cloud's points
        that must be so near
    radius, smallest_radius : bounds of a capture radius
    apart : largest capture radius, relative to the distance of the nearest other attractor
    probes, probe_cycles : motions from the sphere of a capture radius that validate it, and how long each may take
    cycles : most that a cell is followed
    chunk : after which motions are asked where they are
    seeds : cells of the plane from which attractors are looked for, beside its corners and middle
    rounds : how often attractors are looked for again from the cells that came to none of those known
    searched : undecided cells from which they are then looked for
    rtol, rtol_cells : relative tolerances of what is said of an attractor, and of the motions that are followed to one:
        of 1600 cells at mu_k/mu_s = 0.85 none has another label than at 1e-10, with either law
    constant : times 1/alpha, a slip speed beyond which the law's exponential is below 1e-17 of the rest
    most_cells : of a plane
    attractors_shown : in the text of a result
    ahead : rows handed out per thread, so that Ctrl-C ends soon
    distances : in cells, over which final states are compared (C. Grebogi et al., Phys. Lett. A 99, 1983)
    """

    longest_period: int = 16
    settling: int = 256
    longest: int = 4096
    near: float = 0.3
    returned: float = 1e-3
    cloud: int = 2048
    most_clouds: int = 32
    new: float = 0.05
    witnesses: int = 16
    same: float = 1e-6
    same_cloud: float = 1e-3
    shared: float = 0.9
    radius: float = 0.2
    smallest_radius: float = 1e-4
    apart: float = 0.4
    probes: int = 24
    probe_cycles: int = 600
    cycles: int = 600
    chunk: int = 4
    seeds: int = 48
    rounds: int = 3
    searched: int = 24
    rtol: float = 1e-8
    rtol_cells: float = 1e-6
    constant: float = 40.0
    most_cells: int = 4_000_000
    attractors_shown: int = 12
    ahead: int = 3
    distances: tuple[int, ...] = (1, 2, 4, 8, 16)


DEFAULTS = Settings()
