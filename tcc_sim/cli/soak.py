"""`tcc-sim soak`: driveline, recorder and commands for a long time; losses, memory, drift."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from tcc_sim.cli.arguments import add_measurement, check_measurement, write_measurement
from tcc_sim.errors import counted
from tcc_sim.output.terminal import say, seconds_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Rate, duration and where the figures go."""
    add_measurement(parser, 2.0, 600.0)


def run(arguments: argparse.Namespace) -> int:
    """Run, print the figures, write JSON; the recording is made in a temporary folder."""
    from tcc_sim.benchmarks.endurance import soak

    check_measurement(arguments)
    with tempfile.TemporaryDirectory(prefix="tcc_sim_") as folder, seconds_bar("soak", arguments.duration) as done:
        found = soak(Path(folder) / "recording", arguments.rate, arguments.duration, done)
    say(f"{found['simulated_s']:.1f} s simulated in real time at {found['rate']:g} Hz, drift "
        f"{found['drift_s'] * 1e3:.1f} ms")
    judged = "as many as" if found["count_is_honest"] else "which is not what"
    say(f"{counted(sum(found['messages'].values()), 'message')}; {found['lost_messages']} of joint_states missing by "
        f"the stamps, {judged} the recorder counted")
    for name in ("driveline", "recorder"):
        node = found[name]
        say(f"{name}: {node['memory_last_bytes'] / 1e6:.1f} MB, grown by {node['memory_growth_bytes'] / 1e6:.2f} MB "
            f"after the warm-up, {node['cpu_fraction'] * 100.0:.1f} % of a core")
    for warning in found["warnings"]:
        say(f"warning: {warning}")
    write_measurement(arguments, found, "commands")
    return 0 if found["count_is_honest"] else 1
