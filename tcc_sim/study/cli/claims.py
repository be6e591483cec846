"""`tcc-sim claims`: claims of the paper, computed numbers, and verdicts."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tcc_sim.cli.arguments import check_outputs, number, present
from tcc_sim.errors import InputError
from tcc_sim.output.terminal import say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add pressures and thresholds, threads, and outputs."""
    judged = parser.add_argument_group("judgement")
    judged.add_argument("--pressures", metavar="KPA", type=number(100.0, 1000.0, "kPa"), nargs="+",
                        help="mean pressures at which claims of Figs. 4 to 18 are judged, kPa (default 225 230 240)")
    judged.add_argument("--figures", metavar="N", nargs="+",
                        help="only claims of these figures or equations, as the page names them: 3 '(35)'")
    judged.add_argument("--thresholds", action="store_true",
                        help="judge again with every threshold halved and doubled, at the first pressure")
    parser.add_argument_group("workers").add_argument("--jobs", metavar="N", type=int,
                                                      help="threads (default: all cores)")
    output = parser.add_argument_group("output")
    output.add_argument("--json", metavar="FILE", type=Path,
                        help="write claims with numbers, criteria and verdicts as JSON; - is standard output")
    output.add_argument("--markdown", metavar="FILE", type=Path, help="write the claims as a Markdown page")
    output.add_argument("--errata", metavar="FILE", type=Path,
                        help="write the errata of the paper, with numbers, as a Markdown page")
    output.add_argument("--kept", metavar="FILE", type=Path,
                        help="write each judged claim at once; an interrupted command resumes from this file")
    output.add_argument("--force", action="store_true", help="replace existing files")


def run(arguments: argparse.Namespace) -> int:
    """Judge every claim, print each verdict at once, and write the files."""
    from tcc_sim.output.files import draft
    from tcc_sim.output.tables import text
    from tcc_sim.result import json_of
    from tcc_sim.study.paper.catalogue import paper_system
    from tcc_sim.study.paper.claims import CLAIMS, PRESSURES, ClaimsReport, Verdict, claims_page, counts_of, judge
    from tcc_sim.study.paper.errata import errata_page

    claims = [claim for claim in CLAIMS if claim.figure in (arguments.figures or [claim.figure])]
    for name in arguments.figures or ():
        if name not in {claim.figure for claim in claims}:
            known = ", ".join(dict.fromkeys(claim.figure for claim in CLAIMS))
            raise InputError(f"figures has {name!r}; there are claims of {known}")
    check_outputs(arguments, (), arguments.markdown, arguments.errata)
    if arguments.jobs is not None and arguments.jobs < 1:
        raise InputError(f"jobs is {arguments.jobs}; it must be 1 or more")

    verdicts: list[Verdict] = []
    interrupted = False

    def show(verdict: Verdict) -> None:
        verdicts.append(verdict)
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
        chosen = tuple(1e3 * p for p in arguments.pressures or ()) or PRESSURES
        judge(claims, pressures=chosen, kept=arguments.kept, thresholds=arguments.thresholds, jobs=arguments.jobs,
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
    present(arguments, paper_system(), ClaimsReport(verdicts, not interrupted))
    if arguments.markdown is not None:
        with draft(arguments.markdown) as part:
            part.write_text(claims_page(verdicts, complete=not interrupted))
    return 130 if interrupted else 0
