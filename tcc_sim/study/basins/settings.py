"""Tolerances, lengths and bounds of the search for attractors and basins; distances are in the map's scales."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Settings of the search for attractors, of their distinction, and of the motions of cells."""

    # Finding and distinguishing attractors (`attractors.py`).
    longest_period: int = 16  # longest period of an attractor, cycles
    settling: int = 256  # cycles before the first test of whether a motion repeats; doubled up to `longest`
    longest: int = 4096  # cycles after which a motion that has not repeated has no period
    near: float = 0.3  # distance of two points a period apart below which Newton's method starts
    returned: float = 1e-3  # the same for a motion that starts near a cloud
    cloud: int = 2048  # section points in the cloud of a motion without a period
    most_clouds: int = 32  # largest number of additions of as many points while new ones lie off the cloud
    new: float = 0.05  # fraction of new points that may lie off a complete cloud
    witnesses: int = 16  # motions from near a cloud, followed for `longest`; it is a transient if one leaves
    same: float = 1e-6  # distance at which two orbits are one
    same_cloud: float = 1e-3  # distance at which two clouds' points are one
    goes_on: float = 0.5  # largest distance between an attractor and its continuation at the next value
    shared: float = 0.9  # share of a cloud's points that must be that near

    # Capture by an attractor (`attractors.py`, `proximity.py`, `compute.py`).
    radius: float = 0.2  # largest capture radius
    smallest_radius: float = 1e-4  # bound below which a capture radius is not halved further
    apart: float = 0.4  # largest capture radius, relative to the distance of the nearest other attractor
    probes: int = 24  # motions from the capture sphere that validate the radius
    probe_cycles: int = 600  # longest time of a probe, cycles
    cycles: int = 600  # longest time that a cell is followed, cycles
    chunk: int = 4  # cycles after which motions are first compared with attractors

    # The cells of a plane (`compute.py`, `driveline.py`).
    cells_together: int = 128  # most cells of a task with several rows
    seeds: int = 48  # cells from which the search starts, beside the corners and the middle
    rounds: int = 3  # number of further searches from undecided cells
    searched: int = 24  # undecided cells from which a further search starts
    rtol: float = 1e-8  # relative tolerance of the motions that find attractors
    # Relative tolerance of the motions that label cells. It moves edges of basins by 1e-5 rad/s (median of 195 of two
    # scenes, with either law; at most 1e-4); one of 117 000 cells of seven scenes has another label than at 1e-9.
    # Attractors need a smaller one: with this tolerance a motion leaves the chaotic attractor of omega/omega_n = 0.36,
    # mu_k = 0.7 mu_s for one of period 2.
    rtol_cells: float = 3e-5
    constant: float = 40.0  # times 1/alpha, a slip speed with the law's exponential below 1e-17 of the rest
    most_cells: int = 4_000_000  # largest number of cells of a plane
    attractors_shown: int = 12  # attractors in the text of a result
    # Distances, cells, over which final states are compared (C. Grebogi et al., Phys. Lett. A 99, 1983).
    distances: tuple[int, ...] = (1, 2, 4, 8, 16)


DEFAULTS = Settings()
