"""`tcc-sim precision`, `stability` and `realtime`: measurements of the program, as reports or figures."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tcc_sim.cli.arguments import add_layout, new_file, number, present
from tcc_sim.errors import printable, require
from tcc_sim.model.parameters import System
from tcc_sim.output.files import new_directory, write_json
from tcc_sim.output.terminal import counted_bar, say, seconds_bar

if TYPE_CHECKING:
    from tcc_sim.study.benchmarks.pacing_benchmark import PacingFigures

REPORTS = {"precision": "shorter ladders, about 40 s of computing on one core",
           "stability": "fewer scenes, some seconds"}
"""Verbs that write a report, with the help of --quick."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add extent and directory of a report, or rate, duration, settings and file of a run of nodes."""
    verb = parser.prog.rpartition(" ")[2]
    extent, output = parser.add_argument_group("extent"), parser.add_argument_group("output")
    if verb in REPORTS:
        extent.add_argument("--quick", action="store_true", help=REPORTS[verb])
        if verb == "precision":
            extent.add_argument("--scenes", nargs="+", default=[], metavar="NAME",
                                help="scenes of the report (default: all)")
        output.add_argument("--out", type=Path, default=Path(verb), metavar="DIR",
                            help=f"new directory for {verb}.png, .svg, .json and .md (default {verb})")
        add_layout(output, "none")
        return
    extent.add_argument("--rate", type=number(1.0, 20000.0, "Hz"), default=1000.0, metavar="HZ",
                        help="rate of the ticks, Hz (default 1000)")
    extent.add_argument("--duration", type=number(0.5, 1e6, "s"), default=60.0, metavar="S",
                        help="duration of the measurement, s (default 60)")
    output.add_argument("--json", type=Path, metavar="FILE", help="write all numbers as JSON")
    loops = parser.add_argument_group("both loops")
    loops.add_argument("--recorder", action="store_true",
                       help="run a recorder in another process, which competes for the cores")
    loops.add_argument("--thread-priority", type=number(0, 99, kind=int), default=0, metavar="N",
                       help="SCHED_FIFO priority; 0, the default, changes nothing")
    loops.add_argument("--cpu-affinity", type=number(0, 1023, kind=int), nargs="+", default=[], metavar="CORE",
                       help="cores to run on (default: all)")
    loops.add_argument("--lock-memory", action="store_true", help="lock memory")


def run(arguments: argparse.Namespace) -> int:
    """Check the outputs, measure, print the results, and write them."""
    if arguments.verb in REPORTS:
        folder = new_directory(arguments.out)
        require("matplotlib", "a picture")
        return _report(arguments, folder)
    from tcc_sim.nodes.children import require_ros
    from tcc_sim.scene import load_scene

    require_ros()
    if arguments.json is not None:
        new_file(arguments.json)
    present(arguments, load_scene("fig02").with_values({"rate": arguments.rate}), _realtime(arguments))
    return 0


def _report(arguments: argparse.Namespace, folder: Path) -> int:
    """Measure, write JSON, tables and a picture, and print the first table; an interrupted report has what is done."""
    from tcc_sim.output.provenance import document
    from tcc_sim.scene import load_scene
    from tcc_sim.study.benchmarks import precision, report_drawings, stability
    from tcc_sim.views.style import width_of

    verb, rows = arguments.verb, list[Any]()
    measured: Iterator[Any]
    with counted_bar("run") as running:
        if verb == "precision":
            effort = precision.QUICK if arguments.quick else precision.FULL
            measured = precision.precision_study(replace(effort, scenes=tuple(arguments.scenes)), running.done)
        else:
            measured = stability.grid(arguments.quick, running.done)
        for row in measured:
            rows.append(row)
    if not rows:
        return 130
    reports: dict[str, tuple[Any, ...]] = {
        "precision": (precision.PrecisionReport, precision.precision_tables, report_drawings.draw_precision),
        "stability": (stability.StabilityReport, stability.stability_tables, report_drawings.draw_stability)}
    kind, tables_of, draw = reports[verb]
    report = kind(rows, arguments.quick, running.complete)
    tables = tables_of(report)
    scene = load_scene("fig02") if verb == "precision" else System()
    folder.mkdir()
    write_json(folder / f"{verb}.json", document(verb, report, scene, arguments.words))
    (folder / f"{verb}.md").write_text(tables, encoding="utf-8")
    draw(folder / verb, report, title=printable(arguments.title or ""), width=width_of(arguments.width))
    print(next(block for block in tables.split("\n\n") if block.startswith("|")))
    say(f"{folder}/{verb}.png, .svg, .json, .md")
    return 0 if running.complete else 130


def _realtime(arguments: argparse.Namespace) -> PacingFigures:
    """Measure the pacing of the driveline node and of a bare absolute-deadline loop."""
    from tcc_sim.study.benchmarks.pacing_benchmark import Settings, measure

    settings = Settings(arguments.thread_priority, tuple(arguments.cpu_affinity), arguments.lock_memory)
    with seconds_bar("realtime", 2.0 * arguments.duration) as done:
        figures = measure(arguments.rate, arguments.duration, lambda part: done(2.0 * arguments.duration * part),
                          arguments.recorder, settings)
    shown = figures.as_json()
    say(f"{shown['ticks']:.0f} ticks at {shown['rate']:g} Hz, {100.0 * shown['late_share']:.3g} % more than a period "
        f"late, {shown['missed_ticks']:.0f} missed, drift {shown['drift_s'] * 1e3:.3f} ms")
    say(f"{'':22}{'driveline node':>15}{'bare loop':>15}{'ratio':>8}")
    for key, name, factor in (("lateness_p50_s", "lateness p50 (us)", 1e6),
                              ("lateness_p99_s", "lateness p99 (us)", 1e6),
                              ("lateness_max_s", "lateness max (us)", 1e6),
                              ("late_share", "late by a period (%)", 100.0),
                              ("cpu_fraction", "CPU (% of a core)", 100.0)):
        node, bare = shown[key] * factor, shown[f"bare_{key}"] * factor
        say(f"{name:<22}{node:>15.1f}{bare:>15.1f}{node / bare if bare > 0.0 else float('nan'):>8.2f}")
    say(f"{'bare loop with':<26}{'p50 (us)':>11}{'p99 (us)':>11}{'max (us)':>11}")
    for trial in shown["settings"]:
        row = "".join(f"{trial[f'lateness_{key}_s'] * 1e6:>11.1f}" for key in ("p50", "p99", "max"))
        say(f"{trial['name']:<26}{row}{'  refused' if trial['refused'] else ''}")
    for sentence in sorted({sentence for trial in shown["settings"] for sentence in trial["refused"]}):
        say(f"  {sentence}")
    return figures
