"""`tcc-sim realtime`: the driveline node's pacing beside a bare absolute-deadline loop."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcc_sim.cli.arguments import new_file, number, whole_number
from tcc_sim.output.terminal import say

LABELS = {"ticks": "ticks", "missed_ticks": "missed ticks", "drift_s": "drift (ms)"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Rate, duration and where the figures go."""
    parser.add_argument("--rate", type=number(1.0, 20000.0, "Hz"), default=1000.0, metavar="HZ",
                        help="tick rate (1000)")
    parser.add_argument("--duration", type=number(0.5, 86400.0, "s"), default=60.0, metavar="S",
                        help="of each loop (60)")
    parser.add_argument("--recorder", action="store_true",
                        help="publish to a recorder in a process of its own, which competes for the cores")
    parser.add_argument("--thread-priority", type=whole_number(0, 99), default=0, metavar="N",
                        help="SCHED_FIFO priority of both loops (0: as it is)")
    parser.add_argument("--cpu-affinity", type=whole_number(0, 1023), nargs="+", default=[], metavar="CORE",
                        help="cores that both loops may run on (all)")
    parser.add_argument("--lock-memory", action="store_true", help="lock the memory of both loops")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")


def run(arguments: argparse.Namespace) -> int:
    """Measure, print a table, write JSON."""
    from tqdm import tqdm

    from tcc_sim.nodes.children import require_ros

    require_ros()
    if arguments.json is not None:
        new_file(arguments.json)
    from tcc_sim.benchmarks.pacing_benchmark import Settings, measure

    settings = Settings(arguments.thread_priority, tuple(arguments.cpu_affinity), arguments.lock_memory)
    with tqdm(total=1.0, desc="realtime", disable=None, leave=False,
              bar_format="{desc} {percentage:3.0f}%|{bar}|") as bar:
        found = measure(arguments.rate, arguments.duration, lambda part: bar.update(part - bar.n), arguments.recorder,
                        settings)
    say(f"{found['ticks']:.0f} ticks at {found['rate']:g} Hz, {found['missed_ticks']:.0f} missed, "
        f"drift {found['drift_s'] * 1e3:.3f} ms")
    say(f"{'':22}{'driveline node':>15}{'bare loop':>15}{'ratio':>8}")
    for key, name, factor in (("lateness_p50_s", "lateness p50 (us)", 1e6),
                              ("lateness_p99_s", "lateness p99 (us)", 1e6),
                              ("lateness_max_s", "lateness max (us)", 1e6),
                              ("cpu_fraction", "CPU (% of a core)", 100.0)):
        node, bare = found[key] * factor, found[f"bare_{key}"] * factor
        say(f"{name:<22}{node:>15.1f}{bare:>15.1f}{node / bare if bare > 0.0 else float('nan'):>8.2f}")
    say(f"{'bare loop with':<26}{'p50 (us)':>11}{'p99 (us)':>11}{'max (us)':>11}")
    for trial in found["settings"]:
        figures = "".join(f"{trial[f'lateness_{key}_s'] * 1e6:>11.1f}" for key in ("p50", "p99", "max"))
        say(f"{trial['name']:<26}{figures}{'  refused' if trial['refused'] else ''}")
    for sentence in sorted({sentence for trial in found["settings"] for sentence in trial["refused"]}):
        say(f"  {sentence}")
    if arguments.json is not None:
        from tcc_sim.output.files import write_json
        from tcc_sim.output.provenance import document
        from tcc_sim.scene import load_scene

        scene = load_scene("fig02").with_values({"rate": arguments.rate})
        write_json(arguments.json, document("realtime", found, scene, arguments.words))
    return 0
