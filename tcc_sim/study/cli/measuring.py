"""`tcc-sim precision`, `stability` and `realtime`: measurements of the program, as reports or figures."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from tcc_sim.cli.arguments import add_layout, deliver
from tcc_sim.cli.options import Form, command, number
from tcc_sim.errors import printable, require
from tcc_sim.model.parameters import System
from tcc_sim.output.files import new_directory, new_file, write_json
from tcc_sim.output.terminal import say
from tcc_sim.sweeps.progress import counted_bar, seconds_bar


@command(partial(add_layout, title="none"), forms={"scenes": Form("NAME", several=True), "out": Form("DIR", Path)})
def precision(arguments: argparse.Namespace, quick: bool = False, scenes: Sequence[str] = (),
              out: Path = Path("precision")) -> int:
    """Measure error against run time of every solver.

    example : precision --quick
    prints : error and run time for each scene and solver
    writes : the directory --out with precision.png, .svg, .json and .md
    quick : shorter ladders, about 40 s of computing on one core
    scenes : scenes of the report (default: all)
    out : new directory for precision.png, .svg, .json and .md (default: precision)
    """
    return _report(arguments, out, scenes)


@command(partial(add_layout, title="none"), forms={"out": Form("DIR", Path)})
def stability(arguments: argparse.Namespace, quick: bool = False, out: Path = Path("stability")) -> int:
    """Try every solver on stiff and extreme scenes.

    example : stability --quick
    prints : number of scenes by outcome for each solver
    writes : the directory --out with stability.png, .svg, .json and .md
    quick : fewer scenes, some seconds
    out : new directory for stability.png, .svg, .json and .md (default: stability)
    """
    return _report(arguments, out)


@command(forms={"rate": Form("HZ", number(1.0, 20000.0, "Hz")), "duration": Form("S", number(0.5, 1e6, "s")),
                "thread_priority": Form("N", number(0, 99, kind=int)),
                "cpu_affinity": Form("CORE", number(0, 1023, kind=int), several=True)})
def realtime(arguments: argparse.Namespace, rate: float = 1000.0, duration: float = 60.0, json: Path | None = None,
             recorder: bool = False, thread_priority: int = 0, cpu_affinity: Sequence[int] = (),
             lock_memory: bool = False) -> None:
    """Compare the pacing of the driveline node with a bare absolute-deadline loop.

    example : realtime --rate 1000 --duration 10 --json realtime.json
    prints : missed ticks, drift, and lateness and CPU time of both loops
    writes : --json FILE, all numbers
    rate : rate of the ticks, Hz
    duration : duration of the measurement, s
    json : write all numbers as JSON
    recorder : run a recorder in another process, which competes for the cores
    thread_priority : SCHED_FIFO priority; 0, the default, changes nothing
    cpu_affinity : cores to run on (default: all)
    lock_memory : lock memory
    """
    from tcc_sim.nodes.children import require_ros
    from tcc_sim.scene import load_scene

    require_ros()
    if json is not None:
        new_file(json)
    from tcc_sim.study.benchmarks.pacing_benchmark import measure

    scene = load_scene("fig02").with_values({"rate": rate, "thread_priority": thread_priority,
                                             "cpu_affinity": list(cpu_affinity), "lock_memory": lock_memory})
    with seconds_bar("realtime", 2.0 * duration) as done:
        figures = measure(scene.operation, duration, lambda part: done(2.0 * duration * part), recorder)
    deliver(arguments, scene, figures, _pacing_lines(figures.as_json()))


def _report(arguments: argparse.Namespace, out: Path, scenes: Sequence[str] = ()) -> int:
    """Measure, write JSON, tables and a picture, and print the first table; an interrupted report has what is done."""
    from tcc_sim.output.provenance import document
    from tcc_sim.scene import load_scene
    from tcc_sim.study.benchmarks import precision, report_drawings, stability
    from tcc_sim.views.style import width_of

    folder = new_directory(out)
    require("matplotlib", "a picture")
    verb, rows = arguments.verb, list[dict[str, Any]]()
    reports: dict[str, tuple[Any, ...]] = {
        "precision": (precision, precision.precision_tables, report_drawings.draw_precision, load_scene("fig02")),
        "stability": (stability, stability.stability_tables, report_drawings.draw_stability, System())}
    of, tables_of, draw, scene = reports[verb]
    complete = False
    try:
        with counted_bar("run") as done:
            effort = replace(precision.QUICK if arguments.quick else precision.FULL, scenes=tuple(scenes))
            for row in (precision.precision_study(effort, done) if of is precision else
                        stability.grid(arguments.quick, done)):
                rows.append(row)
        complete = True
    except KeyboardInterrupt:
        print("tcc-sim: interrupted", file=sys.stderr)
    if not rows:
        return 130
    report = of.report_of(rows, arguments.quick, complete)
    tables, units = tables_of(report), {name: unit for name, (_, unit) in of.FIELDS.items() if unit}
    folder.mkdir()
    write_json(folder / f"{verb}.json", {
        **document(verb, report, scene, arguments.words, arguments.title or ""), "units": units})
    (folder / f"{verb}.md").write_text(tables, encoding="utf-8")
    draw(folder / verb, report, title=printable(arguments.title or ""), width=width_of(arguments.width))
    print(next(block for block in tables.split("\n\n") if block.startswith("|")))
    say(f"{folder}/{verb}.png, .svg, .json, .md")
    return 0 if complete else 130


def _pacing_lines(shown: dict[str, Any]) -> Iterator[str]:
    yield (f"{shown['ticks']:.0f} ticks at {shown['rate']:g} Hz, {100.0 * shown['late_share']:.3g} % more than a "
           f"period late, {shown['missed_ticks']:.0f} missed, drift {shown['drift_s'] * 1e3:.3f} ms")
    yield f"{'':22}{'driveline node':>15}{'bare loop':>15}{'ratio':>8}"
    for key, name, factor in (("lateness_p50_s", "lateness p50 (us)", 1e6),
                              ("lateness_p99_s", "lateness p99 (us)", 1e6),
                              ("lateness_max_s", "lateness max (us)", 1e6),
                              ("late_share", "late by a period (%)", 100.0),
                              ("cpu_fraction", "CPU (% of a core)", 100.0)):
        node, bare = shown[key] * factor, shown[f"bare_{key}"] * factor
        yield f"{name:<22}{node:>15.1f}{bare:>15.1f}{node / bare if bare > 0.0 else float('nan'):>8.2f}"
    yield f"{'bare loop with':<26}{'p50 (us)':>11}{'p99 (us)':>11}{'max (us)':>11}"
    for trial in shown["settings"]:
        row = "".join(f"{trial[f'lateness_{key}_s'] * 1e6:>11.1f}" for key in ("p50", "p99", "max"))
        yield f"{trial['name']:<26}{row}{'  refused' if trial['refused'] else ''}"
    for sentence in sorted({sentence for trial in shown["settings"] for sentence in trial["refused"]}):
        yield f"  {sentence}"
