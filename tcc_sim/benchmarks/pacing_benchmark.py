"""How well the driveline node keeps its deadlines, measured beside a bare loop that only waits for the same deadlines.
"""

from __future__ import annotations

import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.logging import LoggingSeverity
from rclpy.parameter import Parameter

from tcc_sim.nodes.children import NodeProcess, isolated_environment
from tcc_sim.nodes.driveline import SWITCH_INTERVAL, DrivelineNode
from tcc_sim.nodes.pacing import Pacer
from tcc_sim.nodes.scheduling import prepare_thread

SLICE = 5.0
"""Seconds that node and bare loop run in turn, so that both meet the same disturbances."""


class Stretches:
    """What the stretches of one loop come to."""

    def __init__(self) -> None:
        self.pacers: list[Pacer] = []
        self.cpu = self.wall = 0.0

    def run(self, pacer: Pacer, body: Callable[[], None]) -> None:
        """Run one stretch and count the processor time of the whole process during it."""
        began, cpu = time.monotonic(), time.process_time()
        body()
        self.cpu += time.process_time() - cpu
        self.wall += time.monotonic() - began
        self.pacers.append(pacer)

    def figures(self, prefix: str) -> dict[str, float]:
        """Lateness percentiles and maximum, s, and processor time as a fraction of one core."""
        late = np.concatenate([p.latenesses() for p in self.pacers])
        middle, high = np.percentile(late, (50, 99))
        return {f"{prefix}lateness_p50_s": float(middle), f"{prefix}lateness_p99_s": float(high),
                f"{prefix}lateness_max_s": float(late.max()), f"{prefix}cpu_fraction": self.cpu / self.wall}


def measure(rate: float, duration: float, progress: Callable[[float], Any], recorder: bool = False) -> dict[str, float]:
    """Run the node's loop with its publishing, and the bare loop, `duration` seconds each.

    Parameters
    ----------
    rate : Hz
    duration : s of each loop
    progress : called with the seconds done so far, of 2 * duration
    recorder : publish to a recorder in a process of its own, which works while the node runs and rests beside the bare
        loop

    Returns
    -------
    The figures of `tcc-sim realtime --json`. The drift is that of the node's clock against real time, the largest of
    the stretches; missed ticks are those given up beyond the catch-up bound.
    """
    environment = isolated_environment()
    os.environ.update(environment)
    sys.setswitchinterval(SWITCH_INTERVAL)
    node_side, bare_side = Stretches(), Stretches()
    with tempfile.TemporaryDirectory(prefix="tcc_sim_") as folder, rclpy.init(args=[]):
        listener = NodeProcess("recorder", {"output": str(Path(folder) / "recording")},
                               environment) if recorder else None
        node = DrivelineNode(parameter_overrides=[Parameter("rate", value=rate),
                                                  Parameter("wait_for_subscribers", value=int(recorder))])
        node.get_logger().set_level(LoggingSeverity.WARN)
        try:
            node.start()
            loop = node.loop
            if not loop.clock_started.wait(30.0) and listener is not None:
                listener.check()
            loop.request(lambda: loop.pause(True))
            done = 0.0
            while done < duration - 1e-9:
                length = min(SLICE, duration - done)
                kept = int(length * rate * 1.5) + 100
                pacer = Pacer(1.0 / rate, kept)
                node_side.run(pacer, lambda length=length,
                              pacer=pacer: _node_stretch(node, pacer, length))  # type: ignore[misc]
                progress(2.0 * done + length)
                bare = Pacer(1.0 / rate, kept)
                bare_side.run(bare, lambda length=length, bare=bare: _bare_stretch(bare, length))  # type: ignore[misc]
                done += length
                progress(2.0 * done)
        finally:
            node.destroy_node()
            if listener is not None:
                listener.stop()
    worst = max((p.drift for p in node_side.pacers), key=abs)
    return {"rate": rate, "ticks": sum(p.ticks for p in node_side.pacers),
            "missed_ticks": sum(p.missed_ticks for p in node_side.pacers), "drift_s": worst,
            **node_side.figures(""), **bare_side.figures("bare_")}


def _node_stretch(node: DrivelineNode, pacer: Pacer, length: float) -> None:
    """Let the node's loop run on `pacer` for `length` seconds, then pause it."""
    loop = node.loop

    def resume() -> bool:
        loop.pacer = pacer
        return loop.pause(False)

    loop.request(resume)
    end = time.monotonic() + length
    while (left := end - time.monotonic()) > 0.0:
        time.sleep(min(left, 0.1))
        node.housekeeping()
    loop.request(lambda: loop.pause(True))


def _bare_stretch(pacer: Pacer, length: float) -> None:
    """A thread that only waits for its deadlines for `length` seconds."""
    stop = threading.Event()

    def spin() -> None:
        pacer.anchor()
        while not stop.is_set():
            pacer.wait(stop.is_set)

    thread = threading.Thread(target=spin)
    thread.start()
    stop.wait(length)
    stop.set()
    thread.join()
