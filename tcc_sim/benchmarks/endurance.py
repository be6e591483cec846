"""Driveline, recorder and commands for a long time: what is lost, how memory grows, how the clock drifts."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tcc_sim.nodes.children import SENDING, NodeProcess, Session
from tcc_sim.recording.reader import open_run

WARM_UP = 60.0
"""Memory growth counts from here on, s; from a fifth of the duration on where that is shorter."""


def soak(recording: Path, rate: float, duration: float, progress: Callable[[float], Any]) -> dict[str, Any]:
    """Run the scene `commands` at `rate` Hz with as many commands a second, recorded, for `duration` seconds.

    Returns
    -------
    dict : `rate`, `duration_s`, `simulated_s`, `messages` per topic, `lost_messages`, `complete`, `recorder_result`
    (what the recorder counted), `count_is_honest` (the recorder counted as many joint_states lost, by their numbers
    at the publisher, as there are gaps in the stamps that it recorded), `drift_s` (real time beyond simulation time
    over the run), `warnings`, and for `driveline` and `recorder` `memory_first_bytes`, `memory_last_bytes`,
    `memory_growth_bytes` after the warm-up, and `cpu_fraction`
    """
    session = Session(recording, {"scene": "commands", "rate": float(rate)})
    sender = NodeProcess("commander", {"rate": float(rate)}, session.environment)
    processes = {"driveline": session.driveline, "recorder": session.recorder}
    warm = min(WARM_UP, 0.2 * duration)
    memory: dict[str, list[tuple[float, int]]] = {name: [] for name in processes}
    try:
        sender.await_line(SENDING)
        began = time.monotonic()
        cpu = {name: _cpu(p.pid) for name, p in processes.items()}
        while (elapsed := time.monotonic() - began) < duration:
            session.watch(min(1.0, duration - elapsed))
            sender.check()
            for name, process in processes.items():
                memory[name].append((time.monotonic() - began, _resident(process.pid)))
            progress(min(time.monotonic() - began, duration))
        wall = time.monotonic() - began
        share = {name: (_cpu(p.pid) - cpu[name]) / wall for name, p in processes.items()}
    finally:
        sender.stop()
        session.stop()
    found = figures_of(recording)
    for name, samples in memory.items():
        later = [size for when, size in samples if when >= warm] or [samples[-1][1]]
        found[name] = {"memory_first_bytes": later[0], "memory_last_bytes": later[-1],
                       "memory_growth_bytes": later[-1] - later[0], "cpu_fraction": share[name]}
    return {"rate": rate, "duration_s": wall, **found}


def figures_of(recording: Path) -> dict[str, Any]:
    """Counts, losses and drift from the recording itself."""
    run = open_run(recording)
    first: tuple[int, int] | None = None
    last = (0, 0)
    for batch in run.batches():
        if len(batch):
            first = first or (int(batch.stamp_ns[0]), int(batch.log_ns[0]))
            last = (int(batch.stamp_ns[-1]), int(batch.log_ns[-1]))
    begin = first or last
    drift = ((last[1] - begin[1]) - (last[0] - begin[0])) * 1e-9
    result = run.result or {}
    counted = result.get("lost", {}).get(run.joint_states_topic)
    return {"messages": run.messages, "lost_messages": run.lost_messages, "complete": run.complete,
            "recorder_result": result, "count_is_honest": counted == run.lost_messages, "drift_s": drift,
            "warnings": run.warnings, "simulated_s": (last[0] - begin[0]) * 1e-9}


def _resident(pid: int) -> int:
    """Resident memory of a process, bytes."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _cpu(pid: int) -> float:
    """Processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
