"""Benchmark of the driveline node's deadlines, with a bare loop that only waits for the same deadlines."""

from __future__ import annotations

import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.logging import LoggingSeverity
from rclpy.parameter import Parameter

from tcc_sim.nodes.children import NodeProcess, PrivateEnvironment
from tcc_sim.nodes.driveline import SWITCH_INTERVAL, DrivelineNode
from tcc_sim.nodes.executables import created
from tcc_sim.nodes.pacing import LEAD, TIMER_SLACK_NS, Pacer, prepare_thread, release_memory
from tcc_sim.result import Described, reported, result_class

SLICE = 5.0
"""Length of the alternate stretches of node and bare loop, s; alternation exposes both to the same disturbances."""
SETTING_SLICE = 0.1
"""Fraction of the duration for the bare loop with each of the settings."""
SHORTEST_TRIAL = 0.2
"""Least length of a trial, s."""
DEFAULT_SLACK_NS = 50_000
"""Default timer slack of a thread in Linux, ns."""


@dataclass(frozen=True)
class Settings:
    """Linux settings of the threads, named as the parameters of the driveline node."""

    thread_priority: int = 0
    cpu_affinity: tuple[int, ...] = ()
    lock_memory: bool = False

    def parameters(self) -> list[Parameter]:
        """Return the settings as parameters of the driveline node."""
        values = {"thread_priority": self.thread_priority, "lock_memory": self.lock_memory}
        return [Parameter(name, value=value) for name, value in values.items()] + (
            [Parameter("cpu_affinity", value=list(self.cpu_affinity))] if self.cpu_affinity else [])


def _trials() -> list[tuple[str, Settings, int, float]]:
    """Return name, settings, timer slack (ns) and lead (s) of each trial."""
    core = max(os.sched_getaffinity(0))
    return [("nothing asked for", Settings(), DEFAULT_SLACK_NS, 0.0),
            ("timer slack 1 ns", Settings(), TIMER_SLACK_NS, 0.0),
            ("slack, awake ahead", Settings(), TIMER_SLACK_NS, LEAD),
            ("slack, thread_priority 50", Settings(thread_priority=50), TIMER_SLACK_NS, 0.0),
            (f"slack, cpu_affinity [{core}]", Settings(cpu_affinity=(core,)), TIMER_SLACK_NS, 0.0),
            ("slack, lock_memory", Settings(lock_memory=True), TIMER_SLACK_NS, 0.0),
            ("all of these", Settings(50, (core,), True), TIMER_SLACK_NS, LEAD)]


@result_class(kw_only=True)
class LoopFigures:
    """Lateness and processor time of a loop."""

    lateness_p50_s: float = reported("median lateness of a tick", "s")
    lateness_p99_s: float = reported("99th percentile", "s")
    lateness_max_s: float = reported("largest lateness", "s")
    late_share: float = reported("share of ticks more than a period late")
    cpu_fraction: float = reported("processor time over that of one core")


@result_class
class Trial(LoopFigures):
    """The bare loop with some settings."""

    name: str = reported("the settings")
    refused: list[str] = reported("sentences on settings that the system refused")


@result_class
class PacingFigures(LoopFigures, Described):
    """Figures of the driveline node's loop and of a bare loop."""

    rate: float = reported("ticks per second", "Hz")
    ticks: int = reported("ticks of the node")
    missed_ticks: int = reported("ticks dropped beyond the catch-up bound")
    drift_s: float = reported("largest drift of the node's clock", "s")
    bare_lateness_p50_s: float = reported("likewise of the bare loop", "s")
    bare_lateness_p99_s: float = reported("likewise", "s")
    bare_lateness_max_s: float = reported("likewise", "s")
    bare_late_share: float = reported("likewise")
    bare_cpu_fraction: float = reported("likewise")
    settings: list[Trial] = reported("the bare loop with each setting")


class Stretches:
    """Lateness and processor time of the stretches of one loop."""

    def __init__(self) -> None:
        self.pacers: list[Pacer] = []
        self.cpu = self.wall = 0.0

    def run(self, pacer: Pacer, body: Callable[[], object]) -> None:
        """Run one stretch and count the processor time of the whole process during it."""
        began, cpu = time.monotonic(), time.process_time()
        body()
        self.cpu += time.process_time() - cpu
        self.wall += time.monotonic() - began
        self.pacers.append(pacer)

    def figures(self, prefix: str) -> dict[str, float]:
        """Return percentiles and maximum of the lateness, s, and shares of late ticks and of a core."""
        late = np.concatenate([p.latenesses() for p in self.pacers])
        middle, high = np.percentile(late, (50, 99))
        return {f"{prefix}lateness_p50_s": float(middle), f"{prefix}lateness_p99_s": float(high),
                f"{prefix}lateness_max_s": float(late.max()),
                f"{prefix}late_share": sum(p.late_ticks for p in self.pacers) / sum(p.ticks for p in self.pacers),
                f"{prefix}cpu_fraction": self.cpu / self.wall}


def measure(rate: float, duration: float, progress: Callable[[float], Any], recorder: bool = False,
            settings: Settings = Settings()) -> PacingFigures:
    """Run the node's loop with its publishing, and the bare loop, `duration` seconds each, with the same settings.

    rate : tick rate, Hz
    duration : duration of each loop, s
    progress : function called with the finished fraction, 0 to 1
    recorder : whether to publish to a recorder in a separate process, which is idle while the bare loop runs
    settings : settings of both loops
    """
    private = PrivateEnvironment()
    os.environ.update(private.values)
    sys.setswitchinterval(SWITCH_INTERVAL)
    with tempfile.TemporaryDirectory(prefix="tcc_sim_") as folder, rclpy.init(args=[]):
        listener = NodeProcess("recorder", {"output": str(Path(folder) / "recording")},
                               private.values) if recorder else None
        trials = [_trial(rate, max(SHORTEST_TRIAL, SETTING_SLICE * duration), *trial) for trial in _trials()]
        node = created(lambda: DrivelineNode(parameter_overrides=[
            Parameter("scene", value="fig02"), Parameter("rate", value=rate), *settings.parameters(),
            Parameter("wait_for_subscribers", value=int(recorder))]))
        node.get_logger().set_level(LoggingSeverity.WARN)
        try:
            node.start()
            loop = node.loop
            if not loop.clock_started.wait(30.0) and listener is not None:
                listener.check()
            loop.request(lambda: loop.pause(True))
            node_side, bare_side = _alternated(node, rate, duration, progress, settings)
        finally:
            node.destroy_node()
            if listener is not None:
                listener.stop()
            private.close()
    worst = max((p.drift for p in node_side.pacers), key=abs)
    return PacingFigures(rate, sum(p.ticks for p in node_side.pacers), sum(p.missed_ticks for p in node_side.pacers),
                         worst, **node_side.figures(""), **bare_side.figures("bare_"), settings=trials)


def _alternated(node: DrivelineNode, rate: float, duration: float, progress: Callable[[float], Any],
                settings: Settings) -> tuple[Stretches, Stretches]:
    """Alternate stretches of the node's loop and of the bare loop, which exposes both to the same disturbances."""
    node_side, bare_side, done = Stretches(), Stretches(), 0.0
    while done < duration - 1e-9:
        length = min(SLICE, duration - done)
        kept = int(length * rate * 1.5) + 100
        pacer, bare = Pacer(1.0 / rate, kept), Pacer(1.0 / rate, kept, lead=0.0)
        node_side.run(pacer, partial(_node_stretch, node, pacer, length))
        progress((done + 0.5 * length) / duration)
        bare_side.run(bare, partial(_bare_stretch, bare, length, settings))
        done += length
        progress(done / duration)
    return node_side, bare_side


def _trial(rate: float, length: float, name: str, settings: Settings, timer_slack_ns: int, lead: float) -> Trial:
    """Return the bare loop's figures with some settings, and the refused ones."""
    pacer = Pacer(1.0 / rate, int(length * rate * 1.5) + 100, lead=lead)
    stretches, refused = Stretches(), list[str]()
    stretches.run(pacer, lambda: refused.extend(_bare_stretch(pacer, length, settings, timer_slack_ns)))
    if settings.lock_memory:
        release_memory()
    return Trial(name, refused, **stretches.figures(""))


def _node_stretch(node: DrivelineNode, pacer: Pacer, length: float) -> None:
    """Run the node's loop on `pacer` for `length` seconds, then pause it."""
    loop = node.loop

    def resume() -> None:
        loop.pacer = pacer
        loop.pause(False)

    loop.request(resume)
    end = time.monotonic() + length
    while (left := end - time.monotonic()) > 0.0:
        time.sleep(min(left, 0.1))
        node.housekeeping()
    loop.request(lambda: loop.pause(True))


def _bare_stretch(pacer: Pacer, length: float, settings: Settings, timer_slack_ns: int = TIMER_SLACK_NS) -> list[str]:
    """Run a thread that only waits for its deadlines for `length` seconds; return the refused settings."""
    stop, refused = threading.Event(), list[str]()

    def spin() -> None:
        refused.extend(prepare_thread(
            settings.thread_priority, settings.cpu_affinity, settings.lock_memory, timer_slack_ns))
        pacer.anchor()
        pacer.wait(lambda: False)
        while not stop.is_set():
            pacer.wait(stop.is_set)

    thread = threading.Thread(target=spin)
    thread.start()
    stop.wait(length)
    stop.set()
    thread.join()
    return refused
