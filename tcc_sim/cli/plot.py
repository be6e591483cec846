"""`tcc-sim plot`: draw a result again from its .json or .npz file."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from tcc_sim.cli.arguments import add_layout, add_units
from tcc_sim.cli.options import Form, command
from tcc_sim.errors import printable
from tcc_sim.output.files import new_file
from tcc_sim.output.terminal import say


@command(partial(add_layout, title="that of the command"), partial(add_units, default="those of the command"),
         forms={"result": Form("FILE.json|FILE.npz", Path)})
def run(arguments: argparse.Namespace, result: Path, plot: Path | None = None, force: bool = False) -> int:
    """Check the files, draw, and print the name of the picture.

    Parameters
    ----------
    result : file that --json or --out wrote; a run is in that of --out
    plot : the picture: .pdf, .svg or .png (default: the result's name with .pdf, in this directory)
    force : replace an existing file
    """
    from tcc_sim.output.files import draft
    from tcc_sim.views import plots

    path, title = plot or Path(result.with_suffix(".pdf").name), arguments.title
    plots.check_picture(path, arguments.width)
    new_file(path, force)
    with draft(path) as part:
        plots.plot(result, part, arguments.width, title=title and printable(title), units=arguments.units)
    say(f"picture in {path}")
    return 0
