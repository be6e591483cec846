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
    from tcc_sim.benchmarks.precision_drawing import precision as draw
    from tcc_sim.benchmarks.precision_text import markdown, scene_lines
    from tcc_sim.benchmarks.sweep_speed import speed_summary, sweep_speed
    from tcc_sim.output.files import write_json
    from tcc_sim.output.provenance import document
    from tcc_sim.scene import load_scene

    effort = precision.QUICK if arguments.quick else precision.FULL
    records, speed = [], None
    with counted_bar("run") as running:
        for record in precision.study(effort, running.done):
            records += [record]
        speed = sweep_speed(effort.speed, running.done)
    if not records:
        return 130
    found = precision.as_json(records, speed, arguments.quick, running.complete)
    found = document("precision", found, load_scene("fig02"), arguments.words)
    folder.mkdir()
    write_json(folder / "precision.json", found)
    (folder / "precision.md").write_text(markdown(found, "precision.png"), encoding="utf-8")
    draw(folder / "precision", records)
    for line in [line for record in records for line in scene_lines(record)] + (speed_summary(speed) if speed else []):
        say(line)
    say(f"{folder}/precision.png, .svg, .json, .md; precision_section.png, .svg: one row of it")
    return 0 if running.complete else 130
