"""`tcc-sim soak`: driveline, recorder and commands for a long time; losses, memory, drift."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from tcc_sim.cli.arguments import new_file, number
from tcc_sim.errors import counted
from tcc_sim.output.terminal import say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Rate, duration and where the figures go."""
    parser.add_argument("--duration", type=number(2.0, 1e6, "s"), default=600.0, metavar="S", help="seconds (600)")
    parser.add_argument("--rate", type=number(1.0, 20000.0, "Hz"), default=1000.0, metavar="HZ",
                        help="ticks and commands a second (1000)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")


def run(arguments: argparse.Namespace) -> int:
    """Run, print the figures, write JSON; the recording is made in a temporary folder."""
    from tqdm import tqdm

    from tcc_sim.benchmarks.endurance import soak
    from tcc_sim.nodes.children import require_ros

    require_ros()
    if arguments.json is not None:
        new_file(arguments.json)
    with tempfile.TemporaryDirectory(prefix="tcc_sim_") as folder, tqdm(
            total=arguments.duration, unit="s", desc="soak", disable=None, leave=False,
            bar_format="{desc} {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} s") as bar:
        found = soak(Path(folder) / "recording", arguments.rate, arguments.duration, lambda s: bar.update(s - bar.n))
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
    if arguments.json is not None:
        from tcc_sim.output.files import write_json
        from tcc_sim.output.provenance import document
        from tcc_sim.scene import load_scene

        scene = load_scene("commands").with_values({"rate": arguments.rate})
        write_json(arguments.json, document("soak", found, scene, arguments.words))
    return 0 if found["count_is_honest"] else 1
