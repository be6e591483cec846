"""`tcc-sim plot`: the picture of a result again, from the .json or .npz that a command wrote."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcc_sim.cli.arguments import new_file
from tcc_sim.errors import printable
from tcc_sim.output.terminal import say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The result, and where its picture goes."""
    parser.add_argument("result", metavar="FILE.json|FILE.npz", type=Path,
                        help="a file that --json or --out wrote; one without samples is solved again")
    parser.add_argument("--plot", metavar="FILE", type=Path,
                        help="the picture: .pdf, .svg or .png (default: the result's name with .pdf, here)")
    parser.add_argument("--title", metavar="T", help="over the picture (default: that of the command)")
    parser.add_argument("--width", choices=("column", "page"), default="page", help="of the picture in a paper (page)")
    parser.add_argument("--force", action="store_true", help="replace a file that exists")


def run(arguments: argparse.Namespace) -> int:
    """Check the files, draw, and print where the picture is."""
    from tcc_sim.output.files import draft
    from tcc_sim.views.plots import check_picture, plot
    from tcc_sim.views.stored import missing_data, read_stored, title_of

    path = arguments.plot or Path(arguments.result.with_suffix(".pdf").name)
    check_picture(path, arguments.width)
    new_file(path, arguments.force)
    values = read_stored(arguments.result)
    lacking = missing_data(values)
    if lacking:
        say(f"{arguments.result.name} {lacking}")
    title = title_of(values) if arguments.title is None else arguments.title
    with draft(path) as part:
        plot(values, part, arguments.width, title=printable(title))
    say(f"picture in {path}")
    return 0
