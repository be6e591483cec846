"""`tcc-sim realtime`: the driveline node's pacing beside a bare absolute-deadline loop."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcc_sim.cli.arguments import new_file, number

LABELS = {"ticks": "ticks", "missed_ticks": "missed ticks", "drift_s": "drift (ms)"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Rate, duration and where the figures go."""
    parser.add_argument("--rate", type=number(1.0, 20000.0, "Hz"), default=1000.0, metavar="HZ",
                        help="tick rate (1000)")
    parser.add_argument("--duration", type=number(0.5, 86400.0, "s"), default=60.0, metavar="S",
                        help="of each loop (60)")
    parser.add_argument("--recorder", action="store_true",
                        help="publish to a recorder in a process of its own, which competes for the cores")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")


def run(arguments: argparse.Namespace) -> int:
    """Measure, print a table, write JSON."""
    from tqdm import tqdm

    from tcc_sim.nodes.processes import require_ros

    require_ros()
    if arguments.json is not None:
        new_file(arguments.json)
    from tcc_sim.benchmarks.pacing_benchmark import measure

    with tqdm(total=2.0 * arguments.duration, unit="s", desc="realtime", disable=None, leave=False,
              bar_format="{desc} {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} s") as bar:
        found = measure(arguments.rate, arguments.duration, lambda seconds: bar.update(seconds - bar.n),
                        arguments.recorder)
    print(f"{found['ticks']:.0f} ticks at {found['rate']:g} Hz, {found['missed_ticks']:.0f} missed, "
          f"drift {found['drift_s'] * 1e3:.3f} ms")
    print(f"{'':22}{'driveline node':>15}{'bare loop':>15}{'ratio':>8}")
    for key, name, factor in (("lateness_p50_s", "lateness p50 (us)", 1e6),
                              ("lateness_p99_s", "lateness p99 (us)", 1e6),
                              ("lateness_max_s", "lateness max (us)", 1e6),
                              ("cpu_fraction", "CPU (% of a core)", 100.0)):
        node, bare = found[key] * factor, found[f"bare_{key}"] * factor
        print(f"{name:<22}{node:>15.1f}{bare:>15.1f}{node / bare if bare > 0.0 else float('nan'):>8.2f}")
    if arguments.json is not None:
        from tcc_sim.output.files import write_json
        from tcc_sim.output.provenance import document
        from tcc_sim.scene import load_scene

        scene = load_scene("fig02").with_values({"rate": arguments.rate})
        write_json(arguments.json, document("realtime", found, scene, arguments.words))
    return 0
