"""`tcc-sim claims`: what the paper claims, what comes out, and the verdict."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tcc_sim.cli.arguments import check_outputs, number, present
from tcc_sim.errors import InputError
from tcc_sim.output.terminal import say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Where the table goes, and how many threads."""
    parser.epilog = ("Takes 8 to 10 minutes of processor time for each pressure, about half an hour at the three; "
                     "--thresholds about 10 minutes more. With --kept an interrupted run goes on.")
    parser.add_argument("--json", metavar="FILE", type=Path, help="claims with numbers, criteria and verdicts")
    parser.add_argument("--markdown", metavar="FILE", type=Path, help="the same as a page")
    parser.add_argument("--errata", metavar="FILE", type=Path, help="the paper's errata as a page, with numbers")
    parser.add_argument("--kept", metavar="FILE", type=Path,
                        help="lines of what was judged; a run that was interrupted goes on from them")
    parser.add_argument("--pressures", metavar="KPA", type=number(100.0, 1000.0, "kPa"), nargs="+",
                        help="mean pressures of Figs. 4 to 18 to judge at (225 230 240)")
    parser.add_argument("--thresholds", action="store_true",
                        help="judge with every threshold halved and doubled too, at the first pressure")
    parser.add_argument("--force", action="store_true", help="replace files that exist")
    parser.add_argument("--jobs", metavar="N", type=int, help="threads (default: all cores)")


def run(arguments: argparse.Namespace) -> int:
    """Judge every claim, print each as it is reached, and write what was asked for."""
    from tcc_sim.output.files import draft
    from tcc_sim.output.tables import text
    from tcc_sim.paper.catalogue import paper_system
    from tcc_sim.paper.claim_figures import ClaimsReport
    from tcc_sim.paper.claims import PRESSURES, Verdict, claims_page, counts_of, judge
    from tcc_sim.paper.errata import errata_page
    from tcc_sim.result import json_of

    check_outputs(arguments, (), arguments.markdown, arguments.errata)
    if arguments.jobs is not None and arguments.jobs < 1:
        raise InputError(f"jobs is {arguments.jobs}; it must be 1 or more")

    verdicts: list[Verdict] = []
    interrupted = False

    def show(verdict: Verdict) -> None:
        verdicts.append(verdict)
        found = verdict.finding
        say(f"Fig. {found.figure:<10}  {verdict.verdict:<13}  {found.claim}" if found.figure[0].isdigit() else
            f"{found.figure:<15}  {verdict.verdict:<13}  {found.claim}")
        for name, value in json_of(found.values).items():
            say(f"{'':<32}{name}: {text(value)}")
        for motion in found.motions:
            say(f"{'':<32}{motion['words']}")
        if verdict.why:
            say(f"{'':<32}{verdict.why}", flush=True)

    try:
        chosen = tuple(1e3 * p for p in arguments.pressures or ()) or PRESSURES
        judge(pressures=chosen, kept=arguments.kept, thresholds=arguments.thresholds, jobs=arguments.jobs,
              progress=True, each=show)
        if arguments.errata is not None:
            with draft(arguments.errata) as part:
                part.write_text(errata_page())
    except KeyboardInterrupt:
        interrupted = True
        print("tcc-sim: interrupted; the claims judged so far are kept", file=sys.stderr)
    if not verdicts:
        return 130
    say(counts_of(verdicts))
    present(arguments, paper_system(), ClaimsReport([v.as_json() for v in verdicts], not interrupted))
    if arguments.markdown is not None:
        with draft(arguments.markdown) as part:
            part.write_text(claims_page(verdicts, complete=not interrupted))
    return 130 if interrupted else 0
