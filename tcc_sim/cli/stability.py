"""`tcc-sim stability`: stiff and extreme cases."""

from __future__ import annotations

import argparse

from tcc_sim.cli.arguments import add_report_arguments
from tcc_sim.errors import counted, require
from tcc_sim.output.files import new_directory
from tcc_sim.output.terminal import counted_bar, say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Where the report goes and how much it does."""
    add_report_arguments(parser, "stability", "fewer scenes and coarser charts, done within half a minute")


def run(arguments: argparse.Namespace) -> int:
    """Solve, draw and write; an interrupted report holds what is done."""
    folder = new_directory(arguments.out)
    require("matplotlib", "a picture")
    from tcc_sim.benchmarks.report_drawings import draw_stability
    from tcc_sim.benchmarks.stability import StabilityReport, engine_summaries, error_charts, grid, stability_page
    from tcc_sim.model.parameters import System
    from tcc_sim.output.files import write_json
    from tcc_sim.output.provenance import document
    from tcc_sim.result import json_of

    records, maps = [], []
    with counted_bar("scene") as running:
        for record in grid(arguments.quick, running.done):
            records += [record]
        maps = error_charts(arguments.quick, running.name)
    if not records:
        return 130
    found = StabilityReport(records, engine_summaries(records), maps, arguments.quick, running.complete)
    folder.mkdir()
    write_json(folder / "stability.json", document("stability", json_of(found), System(), arguments.words))
    (folder / "stability.md").write_text(stability_page(found, "stability.png"), encoding="utf-8")
    draw_stability(folder / "stability", maps, records)
    for engine, total in found.summary.items():
        ended = ", ".join(f"{name} {count}" for name, count in total.statuses.items())
        say(f"{engine}: {counted(total.cases, 'case')} ({ended}), {total.not_finite} not finite, "
            f"{total.not_bounded} past the energy bound, {total.past_iteration_bound} past the iteration bound")
    say(f"{folder}/stability.png, .svg, .json, .md")
    return 0 if running.complete else 130
