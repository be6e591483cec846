"""`tcc-sim plot`: draw a result again from its .json or .npz file."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcc_sim.cli.arguments import add_picture, add_units, new_file
from tcc_sim.errors import printable
from tcc_sim.output.terminal import say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the result and the picture."""
    parser.add_argument_group("result").add_argument(
        "result", metavar="FILE.json|FILE.npz", type=Path,
        help="file that --json or --out wrote; a run is in that of --out")
    add_picture(parser, "the picture: .pdf, .svg or .png (default: the result's name with .pdf, in this directory)",
                "that of the command")
    output = parser.add_argument_group("output")
    add_units(output, "those of the command")
    output.add_argument("--force", action="store_true", help="replace an existing file")


def run(arguments: argparse.Namespace) -> int:
    """Check the files, draw, and print the name of the picture."""
    from tcc_sim.output.files import draft
    from tcc_sim.views.plots import check_picture, plot
    from tcc_sim.views.stored import read_stored, refusing_damage, title_of

    path = arguments.plot or Path(arguments.result.with_suffix(".pdf").name)
    check_picture(path, arguments.width)
    new_file(path, arguments.force)
    values = read_stored(arguments.result)
    with refusing_damage(str(arguments.result)):
        title = title_of(values) if arguments.title is None else arguments.title
    with draft(path) as part, refusing_damage(str(arguments.result)):
        plot(values, part, arguments.width, title=printable(title), units=arguments.units)
    say(f"picture in {path}")
    return 0
