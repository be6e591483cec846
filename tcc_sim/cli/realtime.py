"""`tcc-sim realtime`: the driveline node's pacing beside a bare absolute-deadline loop."""

from __future__ import annotations

import argparse

from tcc_sim.cli.arguments import add_measurement, check_measurement, number, write_measurement
from tcc_sim.output.terminal import say, seconds_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Rate, duration and where the figures go."""
    add_measurement(parser, 0.5, 60.0)
    parser.add_argument("--recorder", action="store_true",
                        help="publish to a recorder in a process of its own, which competes for the cores")
    parser.add_argument("--thread-priority", type=number(0, 99, kind=int), default=0, metavar="N",
                        help="SCHED_FIFO priority of both loops (0: as it is)")
    parser.add_argument("--cpu-affinity", type=number(0, 1023, kind=int), nargs="+", default=[], metavar="CORE",
                        help="cores that both loops may run on (all)")
    parser.add_argument("--lock-memory", action="store_true", help="lock the memory of both loops")


def run(arguments: argparse.Namespace) -> int:
    """Measure, print a table, write JSON."""
    check_measurement(arguments)
    from tcc_sim.benchmarks.pacing_benchmark import Settings, measure

    settings = Settings(arguments.thread_priority, tuple(arguments.cpu_affinity), arguments.lock_memory)
    with seconds_bar("realtime", 2.0 * arguments.duration) as done:
        found = measure(arguments.rate, arguments.duration, lambda part: done(2.0 * arguments.duration * part),
                        arguments.recorder, settings)
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
    write_measurement(arguments, found, "fig02")
    return 0
