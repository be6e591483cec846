"""Run driveline, recorder and a command per tick for a long time: lost messages, growth of memory, drift of the clock.

    python .ci/instruments/soak.py [--rate HZ] [--lossy LOSS,HELD,MS] [--duration S] [--json FILE]

`--lossy 0.02,0.1,20` loses 2 % of
the UDP datagrams of every node and delays 10 % by at least 20 ms (lossy.c, which needs a C compiler, no right and no
kernel module as netem does).

The status is 0 if the recorder lost no message, counted right and closed its file, else 1.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tcc_sim.errors import TccError, counted
from tcc_sim.nodes.children import Session
from tcc_sim.output.terminal import say
from tcc_sim.recording.reader import Run
from tcc_sim.sweeps.progress import seconds_bar

COMMANDED = ("/engine_torque", "/actuation_pressure")
WARM_UP = 60.0
"""Time after which growth of memory counts, s; a fifth of the duration if that is shorter."""


@dataclass(frozen=True)
class ProcessUse:
    """Memory of a process after the warm-up and at the end, bytes, and processor time as a fraction of one core."""

    first_bytes: int
    last_bytes: int
    cpu_fraction: float


@dataclass(frozen=True)
class Recorded:
    """Counts of a recording, and the growth of real time minus simulation time over it, s.

    lost_messages : number of joint_states missing by their stamps
    count_is_honest : whether the recorder counted as many, by their numbers at the publisher
    """

    messages: dict[str, int]
    lost_messages: int
    complete: bool
    count_is_honest: bool
    drift_s: float
    warnings: list[str]
    simulated_s: float

    @property
    def sound(self) -> bool:
        """Whether nothing was lost and the recorder says so."""
        return self.lost_messages == 0 and self.complete and self.count_is_honest


@dataclass(frozen=True)
class Soak:
    """All figures of a run."""

    rate: float
    duration_s: float
    recorded: Recorded
    driveline: ProcessUse
    recorder: ProcessUse


def soak(recording: Path, rate: float, duration: float, progress: Callable[[float], Any]) -> Soak:
    """Run and record the scene `commands` at `rate` Hz, with a command for every state, for `duration` seconds."""
    session = Session(recording, {"scene": "commands", "rate": float(rate)}, ("commander", {}))
    processes = {"driveline": session.driveline, "recorder": session.recorder}
    warm = min(WARM_UP, 0.2 * duration)
    memory: dict[str, list[tuple[float, int]]] = {name: [] for name in processes}
    try:
        began = time.monotonic()
        cpu = {name: _cpu(p.pid) for name, p in processes.items()}
        while (elapsed := time.monotonic() - began) < duration:
            session.watch(min(1.0, duration - elapsed))
            for name, process in processes.items():
                memory[name].append((time.monotonic() - began, _resident(process.pid)))
            progress(min(time.monotonic() - began, duration))
        wall = time.monotonic() - began
        share = {name: (_cpu(p.pid) - cpu[name]) / wall for name, p in processes.items()}
    finally:
        session.stop()
    use = {}
    for name, samples in memory.items():
        later = [size for when, size in samples if when >= warm] or [samples[-1][1]]
        use[name] = ProcessUse(later[0], later[-1], share[name])
    return Soak(rate, wall, figures_of(recording), **use)


def lossy(folder: Path, shares: str) -> dict[str, str]:
    """Return the environment of nodes whose datagrams are lost or delayed; they use UDP alone."""
    compiler = shutil.which("cc")
    if compiler is None:
        raise TccError("--lossy needs a C compiler, cc")
    library = folder / "lossy.so"
    subprocess.run([compiler, "-O2", "-shared", "-fPIC", "-o", library, Path(__file__).with_name("lossy.c"), "-ldl"],
                   check=True)
    return {"LD_PRELOAD": str(library), "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
            **dict(zip(("LOSSY_LOSS", "LOSSY_HELD", "LOSSY_DELAY"), shares.split(","), strict=True))}


def figures_of(recording: Path) -> Recorded:
    """Return counts, losses and drift of a recording."""
    run = Run(recording)
    first: tuple[int, int] | None = None
    last = (0, 0)
    for states in run.columns().runs:
        first = first or (int(states.stamp_ns[0]), int(states.log_ns[0]))
        last = (int(states.stamp_ns[-1]), int(states.log_ns[-1]))
    begin = first or last
    drift = ((last[1] - begin[1]) - (last[0] - begin[0])) * 1e-9
    result = run.result or {}
    number = result.get("lost", {}).get(run.joint_states_topic)
    return Recorded(dict(run.messages), run.stamps.lost, run.complete, number == run.stamps.lost, drift,
                    list(run.warnings), (last[0] - begin[0]) * 1e-9)


def _resident(pid: int) -> int:
    """Return the resident memory of a process, bytes."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _cpu(pid: int) -> float:
    """Return the processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def lines(result: Soak) -> list[str]:
    """Return the figures as printed lines."""
    recorded = result.recorded
    return [f"{recorded.simulated_s:.1f} s simulated in real time at {result.rate:g} Hz, drift "
            f"{recorded.drift_s * 1e3:.1f} ms",
            f"{counted(sum(recorded.messages.values()), 'message')}; by the stamps {recorded.lost_messages} of "
            f"joint_states are missing; the recorder's own count "
            f"{'agrees' if recorded.count_is_honest else 'differs'}",
            *(f"{name}: {use.last_bytes / 1e6:.1f} MB, {(use.last_bytes - use.first_bytes) / 1e6:.2f} MB more than "
              f"after the warm-up, {use.cpu_fraction * 100.0:.1f} % of a core"
              for name, use in (("driveline", result.driveline), ("recorder", result.recorder))),
            *(f"commands recorded: {number / recorded.simulated_s:.0f} a second on {name}"
              for name, number in recorded.messages.items() if name in COMMANDED),
            *(f"warning: {warning}" for warning in recorded.warnings)]


def main(words: list[str] | None = None) -> int:
    """Run, print the figures, and return the status."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rate", type=float, default=1000.0, help="ticks per second, Hz")
    parser.add_argument("--lossy", metavar="LOSS,HELD,MS", help="shares of datagrams lost and delayed; delay, ms")
    parser.add_argument("--duration", type=float, default=600.0, help="s")
    parser.add_argument("--json", type=Path, help="write all figures as JSON")
    arguments = parser.parse_args(words)
    with tempfile.TemporaryDirectory(prefix="tcc_sim_") as folder, seconds_bar("soak", arguments.duration) as done:
        if arguments.lossy is not None:
            os.environ |= lossy(Path(folder), arguments.lossy)
        result = soak(Path(folder) / "recording", arguments.rate, arguments.duration, done)
    say("\n".join(lines(result)))
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(asdict(result), indent=2))
    return 0 if result.recorded.sound else 1


if __name__ == "__main__":
    sys.exit(main())
