"""`tcc-sim precision`: error against run time of every solver."""

from __future__ import annotations

import argparse

from tcc_sim.cli.arguments import add_report_arguments
from tcc_sim.errors import require
from tcc_sim.output.files import new_directory
from tcc_sim.output.terminal import counted_bar, say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Where the report goes and how much it does."""
    add_report_arguments(parser, "precision", "shorter ladders, done within half a minute")


def run(arguments: argparse.Namespace) -> int:
    """Measure, draw and write; an interrupted study writes the scenes that are complete."""
    folder = new_directory(arguments.out)
    require("matplotlib", "a picture")
    from tcc_sim.benchmarks import work_precision as precision
    from tcc_sim.benchmarks.precision_report import PrecisionReport, precision_page, scene_lines, took_part
    from tcc_sim.benchmarks.report_drawings import draw_precision
    from tcc_sim.benchmarks.sweep_speed import speed_summary, sweep_speed
    from tcc_sim.output.files import write_json
    from tcc_sim.output.provenance import document
    from tcc_sim.scene import load_scene

    effort = precision.QUICK if arguments.quick else precision.FULL
    records, speed = [], None
    with counted_bar("run") as running:
        for record in precision.precision_study(effort, running.done):
            records += [record]
        speed = sweep_speed(effort.speed, running.done)
    if not records:
        return 130
    found = PrecisionReport(records, speed, took_part(records), arguments.quick, running.complete)
    folder.mkdir()
    write_json(folder / "precision.json", document("precision", found.as_json(), load_scene("fig02"), arguments.words))
    (folder / "precision.md").write_text(precision_page(found, "precision.png"), encoding="utf-8")
    draw_precision(folder / "precision", records)
    for line in [line for record in records for line in scene_lines(record)] + (speed_summary(speed) if speed else []):
        say(line)
    say(f"{folder}/precision.png, .svg, .json, .md; precision_section.png, .svg: one row of it")
    return 0 if running.complete else 130
