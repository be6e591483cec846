"""`tcc-sim figure` and `claims`: the paper's figures as pictures and JSON, and its claims with verdicts."""

from __future__ import annotations

import argparse
import multiprocessing
import signal
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tcc_sim.background import without_working_directory
from tcc_sim.cli.arguments import add_layout, add_units, check_outputs, deliver
from tcc_sim.cli.options import Form, command, number
from tcc_sim.errors import InputError, RecordingError, printable, require
from tcc_sim.output.files import STANDARD_OUTPUT, draft, replaceable, write_json
from tcc_sim.output.terminal import say
from tcc_sim.shown_units import show_in

if TYPE_CHECKING:
    from tcc_sim.study.paper.catalogue import FigureOptions
    from tcc_sim.study.paper.claims import Verdict
    from tcc_sim.views.stored import Record


@command(partial(add_layout, title="its number and title; not with all"), add_units,
         forms={"figure": Form("N|all"), "out": Form("DIR", Path), "jobs": Form("N", number(1, 1024, kind=int))})
def figure(arguments: argparse.Namespace, figure: str, quick: bool = False,
           law: Literal["smoothed", "set_valued"] = "smoothed", direction: Literal["cold", "up", "down"] | None = None,
           branches: bool = False, jobs: int | None = None, out: Path = Path("figures"), force: bool = False) -> None:
    """Draw figures of the paper and write their numbers.

    example : figure 6 --branches
    prints : the name of each picture and its computing time
    writes : figNN.png, figNN.svg and figNN.json in the directory --out
    figure : number of a figure in the paper, 2 to 18, or all of them
    quick : compute only a quarter of the values
    law : friction law: smoothed (7), as in the paper, or set_valued (6), solved exactly
    direction : start of each value in a sweep: cold from the initial state, up or down from the last state of the
        neighbour below or above (default: by figure)
    branches : draw branches of periodic motions, stable and unstable, and name the bifurcation at each jump; with all,
        for the figures that have points on branches
    jobs : threads (default: all cores)
    out : directory for figNN.png, figNN.svg and figNN.json (default: figures)
    force : replace existing figures
    """
    from tcc_sim.study.paper.catalogue import FIGURES, FigureOptions, check_options
    from tcc_sim.study.paper.drawings import draw_figure
    from tcc_sim.views.style import width_of

    numbers = list(FIGURES) if figure == "all" else [int(figure) if figure.isdecimal() else 0]
    if numbers[0] not in FIGURES:
        raise InputError(f"figure is {figure}; it must be {min(FIGURES)} to {max(FIGURES)}, or all")
    stems = {n: out / f"fig{n:02d}" for n in numbers}
    files = [stem.with_suffix(suffix) for stem in stems.values() for suffix in (".png", ".svg", ".json")]
    existing = [path for path in files if replaceable(path)]
    if existing and not force:
        raise RecordingError(f"{existing[0]} exists already; choose another --out, or give --force to replace it")
    if arguments.title and len(numbers) > 1:
        raise InputError("--title is for one figure; leave it out with all")
    options = FigureOptions(quick, direction, law, jobs, progress=True, branches=branches)
    if len(numbers) == 1:
        check_options(numbers[0], options)
    require("matplotlib", "a picture")
    out.mkdir(parents=True, exist_ok=True)
    draw_one = partial(draw_figure, title=printable(arguments.title or ""), width=width_of(arguments.width))
    if len(stems) == 1:
        (one, stem), = stems.items()
        _write(one, stem, options, draw_one, arguments)
        return
    # Drawing takes as long as computing and holds the interpreter lock, so another process draws.
    with without_working_directory(), ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin_painter,
                                                          (arguments.units,)) as painter:
        drawn = [_write(one, stem, options, lambda where, data: painter.submit(draw_one, where, data),
                        arguments)
                 for one, stem in stems.items()]
        for picture in drawn:
            picture.result()


def _begin_painter(units: str | None) -> None:
    """Prepare the process that draws: it ignores Ctrl-C, and draws in the selected unit."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    show_in(units)


def _write(number: int, stem: Path, options: FigureOptions, draw: Callable[[Path, Record], Any],
           arguments: argparse.Namespace) -> Any:
    """Compute one figure, write its numbers, and draw it with `draw`."""
    from tcc_sim.output.provenance import document
    from tcc_sim.study.paper.catalogue import FIGURES, SWEPT, plain, series_system
    from tcc_sim.study.paper.figures import figure_data
    from tcc_sim.views.stored import Record

    row = FIGURES[number]
    data = figure_data(row, options)
    values = document("figure", data, series_system(row.series[0], options), arguments.words, arguments.title or "")
    write_json(stem.with_suffix(".json"), values)
    drawn = draw(stem, Record.of(values))
    say(f"{stem.with_suffix('.png')}  {data.seconds:.1f} s", flush=True)
    for curve in data.curves if data.kind in SWEPT else ():
        for sentence in curve.behind.left_out if curve.behind is not None else ():
            say(f"  {plain(curve.label) or curve.direction}: {sentence}", flush=True)
    return drawn


@command(forms={"pressures": Form("KPA", number(100.0, 1000.0, "kPa"), several=True),
                "figures": Form("N", several=True), "jobs": Form("N", number(1, 1024, kind=int))})
def claims(arguments: argparse.Namespace, pressures: Sequence[float] = (), figures: Sequence[str] = (),
           thresholds: bool = False, jobs: int | None = None, json: Path | None = None, markdown: Path | None = None,
           errata: Path | None = None, kept: Path | None = None, force: bool = False) -> int:
    """Judge the claims of the paper.

    example : claims --pressures 225 --markdown claims.md
    prints : each claim with its verdict and numbers, then the number of claims for each verdict
    writes : --json FILE, --markdown FILE and --errata FILE the tables, --kept FILE progress, to resume from
    takes : 8 to 10 minutes of processor time per pressure, half an hour for all three; 10 minutes more with
        --thresholds
    pressures : mean pressures at which claims of Figs. 4 to 18 are judged, kPa (default 225 230 240)
    figures : only claims of these figures or equations, as the page names them: 3 '(35)'
    thresholds : judge again with every threshold halved and doubled, at the first pressure
    jobs : threads (default: all cores)
    json : write claims with numbers, criteria and verdicts as JSON; - is standard output
    markdown : write the claims as a Markdown page
    errata : write the errata of the paper, with numbers, as a Markdown page
    kept : write each judged claim at once; an interrupted command resumes from this file
    force : replace existing files
    """
    from tcc_sim.output.tables import text
    from tcc_sim.result import json_of
    from tcc_sim.study.paper.catalogue import paper_system
    from tcc_sim.study.paper.claims import CLAIMS, PRESSURES, ClaimsReport, claims_page, counts_of, errata_page, judge

    claims = [claim for claim in CLAIMS if claim.figure in (figures or [claim.figure])]
    for name in figures:
        if name not in {claim.figure for claim in claims}:
            known = "; ".join(dict.fromkeys(claim.figure for claim in CLAIMS))
            raise InputError(f"figures has {name!r}; there are claims of {known}")
    check_outputs(arguments, (), markdown, errata)

    verdicts: list[Verdict] = []
    interrupted = False

    def show(verdict: Verdict) -> None:
        verdicts.append(verdict)
        if json == STANDARD_OUTPUT:
            return
        finding = verdict.finding
        name = f"Fig. {verdict.row.figure}" if verdict.row.figure[0].isdigit() else verdict.row.figure
        say(f"{name:<15}  {verdict.verdict:<13}  {verdict.row.sentence}")
        for name, value in json_of(finding.values).items():
            say(f"{'':<32}{name}: {text(value)}")
        for motion in finding.motions:
            say(f"{'':<32}{motion['words']}")
        if verdict.why:
            say(f"{'':<32}{verdict.why}", flush=True)

    try:
        chosen = tuple(1e3 * p for p in pressures) or PRESSURES
        judge(claims, pressures=chosen, kept=kept, thresholds=thresholds, jobs=jobs,
              progress=True, each=show)
        if errata is not None:
            with draft(errata) as part:
                part.write_text(errata_page())
    except KeyboardInterrupt:
        interrupted = True
        print("tcc-sim: interrupted; the claims judged so far are kept", file=sys.stderr)
    if not verdicts:
        return 130
    deliver(arguments, paper_system(), ClaimsReport(verdicts, not interrupted), [counts_of(verdicts)])
    if markdown is not None:
        with draft(markdown) as part:
            part.write_text(claims_page(verdicts, complete=not interrupted))
    return 130 if interrupted else 0
