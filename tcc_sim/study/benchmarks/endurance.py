"""Long run of driveline, recorder and commands: lost messages, growth of memory, drift of the clock."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tcc_sim.nodes.children import SENDING, NodeProcess, Session
from tcc_sim.recording.reader import open_run
from tcc_sim.result import reported

WARM_UP = 60.0
"""Time after which growth of memory counts, s; a fifth of the duration if that is shorter."""


@dataclass(frozen=True)
class ProcessUse:
    """Memory of a process after the warm-up, bytes, and processor time as a fraction of one core."""

    memory_first_bytes: int = field(metadata=reported("memory after the warm-up", "bytes"))
    memory_last_bytes: int = field(metadata=reported("memory at the end", "bytes"))
    memory_growth_bytes: int = field(metadata=reported("growth of the memory", "bytes"))
    cpu_fraction: float = field(metadata=reported("processor time, as a fraction of one core"))


@dataclass(frozen=True)
class RecordedFigures:
    """Counts, losses and drift of a recording."""

    messages: Mapping[str, int] = field(metadata=reported("number of messages by topic"))
    lost_messages: int = field(metadata=reported("number of messages missing by the stamps"))
    complete: bool = field(metadata=reported("whether the recording was closed properly"))
    recorder_result: Mapping[str, Any] = field(metadata=reported("counts by the recorder"))
    count_is_honest: bool = field(metadata=reported(
        "whether the recorder counted as many joint_states lost, by their numbers at the publisher, as there are gaps "
        "in the stamps that it recorded"))
    drift_s: float = field(metadata=reported("growth of real time minus simulation time over the run", "s"))
    warnings: Sequence[str] = field(metadata=reported("a sentence for each damage of the recording"))
    simulated_s: float = field(metadata=reported("simulation time", "s"))


@dataclass(frozen=True)
class SoakFigures:
    """Figures of `tcc-sim soak --json`."""

    rate: float = field(metadata=reported("ticks per second", "Hz"))
    duration_s: float = field(metadata=reported("real time", "s"))
    recorded: RecordedFigures = field(metadata=reported("the recording", spread=True))
    driveline: ProcessUse = field(metadata=reported("use by the driveline's process"))
    recorder: ProcessUse = field(metadata=reported("use by the recorder's process"))


def soak(recording: Path, rate: float, duration: float, progress: Callable[[float], Any]) -> SoakFigures:
    """Run and record the scene `commands` at `rate` Hz, with a command per tick, for `duration` seconds."""
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
    use = {}
    for name, samples in memory.items():
        later = [size for when, size in samples if when >= warm] or [samples[-1][1]]
        use[name] = ProcessUse(later[0], later[-1], later[-1] - later[0], share[name])
    return SoakFigures(rate, wall, figures_of(recording), **use)


def figures_of(recording: Path) -> RecordedFigures:
    """Return counts, losses and drift of a recording."""
    run = open_run(recording)
    first: tuple[int, int] | None = None
    last = (0, 0)
    for states in run.states():
        first = first or (int(states.stamp_ns[0]), int(states.log_ns[0]))
        last = (int(states.stamp_ns[-1]), int(states.log_ns[-1]))
    begin = first or last
    drift = ((last[1] - begin[1]) - (last[0] - begin[0])) * 1e-9
    result = run.result or {}
    counted = result.get("lost", {}).get(run.joint_states_topic)
    return RecordedFigures(run.messages, run.lost_messages, run.complete, result, counted == run.lost_messages, drift,
                           run.warnings, (last[0] - begin[0]) * 1e-9)


def _resident(pid: int) -> int:
    """Return the resident memory of a process, bytes."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _cpu(pid: int) -> float:
    """Return the processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
