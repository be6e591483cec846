"""Benchmark of the driveline node's deadlines, with a bare loop that only waits for the same deadlines."""

from __future__ import annotations

import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.logging import LoggingSeverity
from rclpy.parameter import Parameter

from tcc_sim.nodes.children import NodeProcess, private_environment
from tcc_sim.nodes.driveline import SWITCH_INTERVAL, DrivelineNode
from tcc_sim.nodes.executables import created, initialised
from tcc_sim.nodes.pacing import LEAD, TIMER_SLACK_NS, Pacer, prepare_thread, release_memory
from tcc_sim.result import Described, reported, result_class
from tcc_sim.scene import Operation

SLICE = 5.0
"""Length of the alternate stretches of node and bare loop, s; alternation exposes both to the same disturbances."""
SETTING_SLICE = 0.1
"""Fraction of the duration for the bare loop with each of the settings."""
SHORTEST_TRIAL = 0.2
"""Least length of a trial, s."""
DEFAULT_SLACK_NS = 50_000
"""Default timer slack of a thread in Linux, ns."""


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


Stretch = tuple[Pacer, float, float]
"""Deadlines of a loop, and the processor time of the whole process during the loop and its length, s."""


def stretch_of(rate: float, length: float, body: Callable[[Pacer, float], object], lead: float = LEAD) -> Stretch:
    """Run a loop for `length` seconds; its deadlines keep the latenesses of all of its ticks."""
    pacer = Pacer(1.0 / rate, int(length * rate * 1.5) + 100, lead=lead)
    began, cpu = time.monotonic(), time.process_time()
    body(pacer, length)
    return pacer, time.process_time() - cpu, time.monotonic() - began


def figures_of(stretches: Sequence[Stretch]) -> LoopFigures:
    """Return the figures of a loop from its stretches."""
    pacers, cpu, wall = zip(*stretches)
    late = np.concatenate([p.latenesses() for p in pacers])
    middle, high = np.percentile(late, (50, 99)).tolist()
    return LoopFigures(
        lateness_p50_s=middle, lateness_p99_s=high, lateness_max_s=float(late.max()),
        late_share=sum(p.late_ticks for p in pacers) / sum(p.ticks for p in pacers), cpu_fraction=sum(cpu) / sum(wall))


def measure(wished: Operation, duration: float, progress: Callable[[float], Any],
            recorder: bool = False) -> PacingFigures:
    """Run the node's loop with its publishing, and the bare loop, `duration` seconds each.

    wished : rate and settings of the threads of both loops
    duration : duration of each loop, s
    progress : function called with the finished fraction, 0 to 1
    recorder : whether to publish to a recorder in a separate process, which is idle while the bare loop runs
    """
    environment, release = private_environment()
    os.environ.update(environment)
    sys.setswitchinterval(SWITCH_INTERVAL)
    with tempfile.TemporaryDirectory(prefix="tcc_sim_") as folder, initialised([]):
        listener = NodeProcess("recorder", {"output": str(Path(folder) / "recording")},
                               environment) if recorder else None
        trials = list(_trials(wished.rate, max(SHORTEST_TRIAL, SETTING_SLICE * duration)))
        chosen = {"scene": "fig02", "rate": wished.rate, "wait_for_subscribers": int(recorder),
                  "thread_priority": wished.thread_priority, "lock_memory": wished.lock_memory}
        chosen |= {"cpu_affinity": list(wished.cpu_affinity)} if wished.cpu_affinity else {}
        node = created(lambda: DrivelineNode(parameter_overrides=[
            Parameter(name, value=value) for name, value in chosen.items()]))
        node.get_logger().set_level(LoggingSeverity.WARN)
        try:
            node.start()
            loop = node.loop
            if not loop.clock_started.wait(30.0) and listener is not None:
                listener.check()
            loop.request(lambda: loop.pause(True))
            node_side, bare_side = zip(*_alternated(node, wished, duration, progress))
        finally:
            node.destroy_node()
            if listener is not None:
                listener.stop()
            release()
    pacers = [pacer for pacer, _, _ in node_side]
    return PacingFigures(wished.rate, sum(p.ticks for p in pacers), sum(p.missed_ticks for p in pacers),
                         max((p.drift for p in pacers), key=abs), **vars(figures_of(node_side)), settings=trials,
                         **{f"bare_{name}": value for name, value in vars(figures_of(bare_side)).items()})


def _alternated(node: DrivelineNode, wished: Operation, duration: float,
                progress: Callable[[float], Any]) -> Iterator[tuple[Stretch, Stretch]]:
    """Yield stretches of the node's loop and of the bare loop in turn, which exposes both to the same disturbances."""
    done = 0.0
    while done < duration - 1e-9:
        length = min(SLICE, duration - done)
        of_node = stretch_of(wished.rate, length, partial(_node_stretch, node))
        progress((done + 0.5 * length) / duration)
        of_bare = stretch_of(wished.rate, length, partial(_bare_stretch, wished, TIMER_SLACK_NS, []), 0.0)
        done += length
        progress(done / duration)
        yield of_node, of_bare


def _trials(rate: float, length: float) -> Iterator[Trial]:
    """Yield the bare loop's figures with each of the settings, and the refused ones."""
    core = max(os.sched_getaffinity(0))
    every: dict[str, Any] = {"thread_priority": 50, "cpu_affinity": (core,), "lock_memory": True}
    words = "thread_priority 50", f"cpu_affinity [{core}]", "lock_memory"
    alone = ((f"slack, {word}", {name: every[name]}, TIMER_SLACK_NS, 0.0) for word, name in zip(words, every))
    for name, settings, slack, lead in (
            ("nothing asked for", {}, DEFAULT_SLACK_NS, 0.0), ("timer slack 1 ns", {}, TIMER_SLACK_NS, 0.0),
            ("slack, awake ahead", {}, TIMER_SLACK_NS, LEAD), *alone, ("all of these", every, TIMER_SLACK_NS, LEAD)):
        wished, refused = Operation(**settings), list[str]()
        stretch = stretch_of(rate, length, partial(_bare_stretch, wished, slack, refused), lead)
        if wished.lock_memory:
            release_memory()
        yield Trial(name, refused, **vars(figures_of([stretch])))


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


def _bare_stretch(wished: Operation, timer_slack_ns: int, refused: list[str], pacer: Pacer, length: float) -> None:
    """Run a thread that only waits for its deadlines for `length` seconds; add the refused settings to `refused`."""
    stop = threading.Event()

    def spin() -> None:
        refused.extend(prepare_thread(wished.thread_priority, wished.cpu_affinity, wished.lock_memory, timer_slack_ns))
        pacer.anchor()
        pacer.wait(lambda: False)
        while not stop.is_set():
            pacer.wait(stop.is_set)

    thread = threading.Thread(target=spin)
    thread.start()
    stop.wait(length)
    stop.set()
    thread.join()
