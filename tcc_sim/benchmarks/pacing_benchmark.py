"""How well the driveline node keeps its deadlines, measured beside a bare loop that only waits for the same deadlines.
"""

from __future__ import annotations

import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.logging import LoggingSeverity
from rclpy.parameter import Parameter

from tcc_sim.nodes.children import START_LIMIT, NodeProcess, OwnEnvironment
from tcc_sim.nodes.driveline import SWITCH_INTERVAL, DrivelineNode
from tcc_sim.nodes.pacing import LEAD, TIMER_SLACK_NS, Pacer, prepare_thread, release_memory
from tcc_sim.nodes.process import created
from tcc_sim.result import Described, reported

SLICE = 5.0
"""Seconds that node and bare loop run in turn, so that both meet the same disturbances."""
SETTING_SLICE = 0.1
"""Part of the duration that the bare loop runs with each of the settings."""
SHORTEST_TRIAL = 0.2
"""Seconds of a trial at least."""
DEFAULT_SLACK_NS = 50_000
"""Timer slack of a thread that asks Linux for nothing, ns."""


@dataclass(frozen=True)
class Settings:
    """Settings that the threads ask of Linux, named as the parameters of the driveline node."""

    thread_priority: int = 0
    cpu_affinity: tuple[int, ...] = ()
    lock_memory: bool = False

    def prepare(self, timer_slack_ns: int = TIMER_SLACK_NS) -> list[str]:
        """Prepare the calling thread; the wishes that were refused."""
        return prepare_thread(self.thread_priority, self.cpu_affinity, self.lock_memory, timer_slack_ns)

    def parameters(self) -> list[Parameter]:
        """The same for the driveline node."""
        found = {"thread_priority": self.thread_priority, "lock_memory": self.lock_memory}
        return [Parameter(name, value=value) for name, value in found.items()] + (
            [Parameter("cpu_affinity", value=list(self.cpu_affinity))] if self.cpu_affinity else [])


def _trials() -> list[tuple[str, Settings, int, float]]:
    """Name, settings, timer slack, ns, and lead, s, of what is tried one by one."""
    core = max(os.sched_getaffinity(0))
    return [("nothing asked for", Settings(), DEFAULT_SLACK_NS, 0.0),
            ("timer slack 1 ns", Settings(), TIMER_SLACK_NS, 0.0),
            ("slack, awake ahead", Settings(), TIMER_SLACK_NS, LEAD),
            ("slack, thread_priority 50", Settings(thread_priority=50), TIMER_SLACK_NS, 0.0),
            (f"slack, cpu_affinity [{core}]", Settings(cpu_affinity=(core,)), TIMER_SLACK_NS, 0.0),
            ("slack, lock_memory", Settings(lock_memory=True), TIMER_SLACK_NS, 0.0),
            ("all of these", Settings(50, (core,), True), TIMER_SLACK_NS, LEAD)]


@dataclass(frozen=True, kw_only=True)
class LoopFigures:
    """How late a loop was, and what it cost."""

    lateness_p50_s: float = field(metadata=reported("median lateness of a tick", "s"))
    lateness_p99_s: float = field(metadata=reported("lateness that 99 % of the ticks stay within", "s"))
    lateness_max_s: float = field(metadata=reported("largest lateness", "s"))
    cpu_fraction: float = field(metadata=reported("processor time, as a fraction of one core"))


@dataclass(frozen=True)
class Trial(LoopFigures):
    """The bare loop with some settings."""

    name: str = field(metadata=reported("the settings"))
    refused: list[str] = field(metadata=reported("sentences on the settings that the system refused"))


@dataclass(frozen=True)
class PacingFigures(LoopFigures, Described):
    """The driveline node's loop beside a bare one."""

    rate: float = field(metadata=reported("ticks in a second", "Hz"))
    ticks: int = field(metadata=reported("number of ticks of the node"))
    missed_ticks: int = field(metadata=reported("number of ticks given up beyond the catch-up bound"))
    drift_s: float = field(metadata=reported("largest drift of the node's clock against real time", "s"))
    bare_lateness_p50_s: float = field(metadata=reported("median lateness of the bare loop", "s"))
    bare_lateness_p99_s: float = field(metadata=reported("lateness that 99 % of its ticks stay within", "s"))
    bare_lateness_max_s: float = field(metadata=reported("largest lateness of the bare loop", "s"))
    bare_cpu_fraction: float = field(metadata=reported("its processor time, as a fraction of one core"))
    settings: list[Trial] = field(metadata=reported("the bare loop with each setting by itself"))


class Stretches:
    """Latenesses and processor time of the stretches of one loop."""

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
        """Lateness percentiles and maximum, s, and processor time as a fraction of one core."""
        late = np.concatenate([p.latenesses() for p in self.pacers])
        middle, high = np.percentile(late, (50, 99))
        return {f"{prefix}lateness_p50_s": float(middle), f"{prefix}lateness_p99_s": float(high),
                f"{prefix}lateness_max_s": float(late.max()), f"{prefix}cpu_fraction": self.cpu / self.wall}


def measure(rate: float, duration: float, progress: Callable[[float], Any], recorder: bool = False,
            settings: Settings = Settings()) -> PacingFigures:
    """Run the node's loop with its publishing, and the bare loop, `duration` seconds each, with the same settings.

    Parameters
    ----------
    rate : Hz
    duration : s of each loop
    progress : called with the part done so far, 0 to 1
    recorder : publish to a recorder in a process of its own, which works while the node runs and rests beside the bare
        loop
    settings : of both loops

    Returns
    -------
    The figures of `tcc-sim realtime --json`. The drift is that of the node's clock against real time, the largest of
    the stretches; missed ticks are those given up beyond the catch-up bound. `settings` has the bare loop's figures
    with each setting by itself, and what was refused.
    """
    own = OwnEnvironment()
    os.environ.update(own.values)
    sys.setswitchinterval(SWITCH_INTERVAL)
    with tempfile.TemporaryDirectory(prefix="tcc_sim_") as folder, rclpy.init(args=[]):
        listener = NodeProcess("recorder", {"output": str(Path(folder) / "recording")},
                               own.values) if recorder else None
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
            # Compiling beside the loop at the start holds the interpreter; the bare loop has none of it.
            loop.plant.general_ready.wait(START_LIMIT)
            node_side, bare_side = _alternated(node, rate, duration, progress, settings)
        finally:
            node.destroy_node()
            if listener is not None:
                listener.stop()
            own.close()
    worst = max((p.drift for p in node_side.pacers), key=abs)
    return PacingFigures(rate, sum(p.ticks for p in node_side.pacers), sum(p.missed_ticks for p in node_side.pacers),
                         worst, **node_side.figures(""), **bare_side.figures("bare_"), settings=trials)


def _alternated(node: DrivelineNode, rate: float, duration: float, progress: Callable[[float], Any],
                settings: Settings) -> tuple[Stretches, Stretches]:
    """Stretches of the node's loop and of the bare one in turn, so that both meet the same machine."""
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


def _trial(rate: float, length: float, name: str, settings: Settings, timer_slack_ns: int,
           lead: float = 0.0) -> Trial:
    """The bare loop's figures with some settings, and the wishes among them that were refused."""
    pacer = Pacer(1.0 / rate, int(length * rate * 1.5) + 100, lead=lead)
    stretches, refused = Stretches(), list[str]()
    stretches.run(pacer, lambda: refused.extend(_bare_stretch(pacer, length, settings, timer_slack_ns)))
    if settings.lock_memory:
        release_memory()
    return Trial(name, refused, **stretches.figures(""))


def _node_stretch(node: DrivelineNode, pacer: Pacer, length: float) -> None:
    """Let the node's loop run on `pacer` for `length` seconds, then pause it."""
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
    """A thread that only waits for its deadlines for `length` seconds; the settings that it was refused."""
    stop, refused = threading.Event(), list[str]()

    def spin() -> None:
        refused.extend(settings.prepare(timer_slack_ns))
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
