"""The page on periodic motions: branches, charts and a basin, with what was found.

``python -m tcc_sim.benchmarks.motions`` writes it, its pictures and the JSON behind them; the branches are those of
`tcc-sim figure --branches`, and AUTO-07p follows two of them beside (`branch_speed`).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tcc_sim.errors import BasinsInterrupted, InputError, require
from tcc_sim.output.files import new_directory
from tcc_sim.output.terminal import say

CELLS, QUICK_CELLS = 500, 60


def main(words: Sequence[str] | None = None) -> int:
    """Write the page; exit status 2 and one line for wrong input, 130 where it is interrupted."""
    parser = argparse.ArgumentParser(prog="python -m tcc_sim.benchmarks.motions", description=__doc__)
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path("motions"),
                        help="new directory for motions.md, its pictures and the JSON behind them (default: motions)")
    parser.add_argument("--quick", action="store_true",
                        help="a quarter of the values, a basin of 60 by 60 cells, and no comparison with AUTO-07p")
    parser.add_argument("--jobs", metavar="N", type=int, help="threads (default: all cores)")
    given = list(sys.argv[1:] if words is None else words)
    try:
        return run(parser.parse_args(given), given)
    except InputError as error:
        sys.stderr.write(f"motions: {error}\n")
        return 2


def run(arguments: argparse.Namespace, words: list[str]) -> int:
    """Work out branches, charts and basin, and write the page and its pictures; nothing where it is interrupted."""
    folder = new_directory(arguments.out)
    if arguments.jobs is not None and not 1 <= arguments.jobs <= 1024:
        raise InputError(f"jobs is {arguments.jobs}; it must be 1 to 1024")
    require("matplotlib", "a picture")
    from tcc_sim.basins.compute import Axis
    from tcc_sim.basins.rows import basins
    from tcc_sim.benchmarks.branch_speed import compared, page_lines
    from tcc_sim.paper.catalogue import AT_036_085, CHARTS, paper_system
    from tcc_sim.paper.figure_options import FigureOptions
    from tcc_sim.paper.figures import figure_of
    from tcc_sim.paper.motions_page import motions_page
    from tcc_sim.sweeps.processes import each_in_a_process, processes_for
    from tcc_sim.sweeps.ranges import values_of_range

    cells = QUICK_CELLS if arguments.quick else CELLS
    plane = [Axis(*_values(values_of_range(text))) for text in (f"initial.slip_speed=0:120:{cells}",
                                                                f"initial.plate_angle=-0.1:0.3:{cells}")]
    # A bar counts the figures; those of their parts would write over each other.
    alone = processes_for(1 + len(CHARTS), arguments.jobs) < 2
    branched = FigureOptions(arguments.quick, jobs=arguments.jobs, progress=alone, branches=True)
    plain = FigureOptions(arguments.quick, jobs=arguments.jobs, progress=alone)
    try:
        # The charts take longest, so they come first.
        tasks = [*((number, plain) for number in CHARTS), (6, branched)]
        *drawn, branches = each_in_a_process(figure_of, tasks, arguments.jobs, "figure", True)
        charts = dict(zip(CHARTS, drawn))
        found, = basins(paper_system(AT_036_085), plane, jobs=arguments.jobs, progress=True)
        beside = [] if arguments.quick else page_lines(list(compared()))
    except (KeyboardInterrupt, BasinsInterrupted):
        sys.stderr.write("motions: interrupted; nothing is written\n")
        return 130
    _write(folder, branches, charts, found, words)
    (folder / "motions.md").write_text(motions_page(branches, charts, found, beside), encoding="utf-8")
    say(repr(found))
    say(f"{folder}/motions.md, {folder}/pictures")
    return 0


def _values(found: tuple[str, Any]) -> tuple[str, tuple[float, ...]]:
    """Key and values as an axis has them."""
    return found[0], tuple(found[1])


def _write(folder: Any, branches: dict[str, Any], charts: dict[int, dict[str, Any]], found: Any,
           words: list[str]) -> None:
    """Pictures and JSON."""
    from tcc_sim.output.files import write_json
    from tcc_sim.output.provenance import document
    from tcc_sim.paper.catalogue import AT_036_085, paper_system
    from tcc_sim.paper.drawings import draw
    from tcc_sim.paper.figure_options import FigureOptions
    from tcc_sim.paper.figures import figure_system
    from tcc_sim.paper.motions_page import BASINS, BRANCHES, NAMES
    from tcc_sim.views.basin_map import draw as draw_basins

    pictures = folder / "pictures"
    pictures.mkdir(parents=True)
    for number, data in ((6, branches), *charts.items()):
        name = NAMES.get(number, BRANCHES)
        draw(data, pictures / name)
        write_json(folder / f"{name}.json", document("figure", data, figure_system(number, FigureOptions()), words))
    draw_basins(pictures / f"{BASINS}.png", found)
    write_json(folder / f"{BASINS}.json", document("basins", found.as_json(), paper_system(AT_036_085), words))


if __name__ == "__main__":
    raise SystemExit(main())
