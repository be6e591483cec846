"""The parameters of every node in one table: name, unit, range, default, and whether a running node may change it. The
page on nodes, `--help`, what a node declares and what it refuses come from here. Free of rclpy.
"""

from __future__ import annotations

from dataclasses import dataclass

from tcc_sim.model.quantity import Options, quantity
from tcc_sim.plant.slip_control import Tuning
from tcc_sim.scene import Operation
from tcc_sim.topics import TOPICS


@dataclass(frozen=True)
class RecorderOptions(Options):
    """What the recorder records, where, and how often it writes."""

    output: str = quantity("", "directory to create for the recording; tcc_sim_ and the local time where none is given")
    topics: tuple[str, ...] = quantity(tuple(row.name for row in TOPICS), "topics to record")
    flush_period: float = quantity(0.25, "a kill loses at most this much and one drain", "s", 0.0, 10.0, above=True)
    fsync_period: float = quantity(0.0, "a power cut loses at most this much and one drain; 0 leaves it to the "
                                   "operating system", "s", 0.0, 3600.0)
    max_bag_duration: float = quantity(3600.0, "a file of the bag that holds this much is followed by another; 0 for "
                                       "no limit", "s", 1.0, 1e9, zero=True)
    max_bag_size: int = quantity(0, "a file of the bag that has this many bytes is followed by another; 0 for no limit",
                                 "bytes", 10_000, 1e18, zero=True)


@dataclass(frozen=True)
class CommanderOptions(Options):
    """How fast the commander sends."""

    rate: float = quantity(1000.0, "commands a second", "Hz", 1.0, 20000.0)


OPTIONS: dict[str, type[Options]] = {"driveline": Operation, "recorder": RecorderOptions, "slip_controller": Tuning,
                                     "commander": CommanderOptions}
"""The options of every node. The driveline has the keys of a scene beside them."""
