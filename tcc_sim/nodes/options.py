"""Parameters of every node: name, unit, range and default, for declaration, checks, `--help` and the page on nodes.

This module does not import rclpy.
"""

from __future__ import annotations

from dataclasses import dataclass

from tcc_sim.model.quantity import Options, quantity
from tcc_sim.plant.slip_control import Tuning
from tcc_sim.scene import Operation
from tcc_sim.topics import TOPICS

SCENE, TEXT = "scene", "scene_text"
"""Parameters of the driveline beside the scene's keys: the scene at the start, and the current scene as text, which the
node updates after every change, so it cannot be read-only.
"""


@dataclass(frozen=True)
class RecorderOptions(Options):
    """Parameters of the recorder."""

    output: str = quantity("", "directory to create for the recording; tcc_sim_ and the local time by default")
    topics: tuple[str, ...] = quantity(tuple(row.name for row in TOPICS), "topics to record")
    flush_period: float = quantity(0.25, "time between writes to the operating system, the most that a kill loses "
                                   "(plus 0.1 s)", "s", 0.0, 10.0, above=True)
    fsync_period: float = quantity(0.0, "time between writes to the disk, the most that a power cut loses (plus "
                                   "0.1 s); 0 leaves it to the operating system", "s", 0.0, 3600.0)
    max_bag_duration: float = quantity(3600.0, "longest duration of one file of the bag; 0 for no limit", "s", 1.0, 1e9,
                                       zero=True)
    max_bag_size: int = quantity(0, "largest size of one file of the bag; 0 for no limit", "bytes", 10_000, 1e18,
                                 zero=True)


OPTIONS: dict[str, type[Options]] = {"driveline": Operation, "recorder": RecorderOptions, "slip_controller": Tuning,
                                     "commander": Options}
"""Options of every node; the driveline also has the keys of a scene."""
