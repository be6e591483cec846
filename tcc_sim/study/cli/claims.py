"""`tcc-sim claims`: claims of the paper, computed numbers, and verdicts."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tcc_sim.cli.arguments import check_outputs, number, present
from tcc_sim.cli.options import Form, command
from tcc_sim.errors import InputError
from tcc_sim.output.terminal import say


@command(forms={"pressures": Form("KPA", number(100.0, 1000.0, "kPa"), several=True),
                "figures": Form("N", several=True), "jobs": Form("N", number(1, 1024, kind=int))})
def run(arguments: argparse.Namespace, pressures: Sequence[float] = (), figures: Sequence[str] = (),
        thresholds: bool = False, jobs: int | None = None, json: Path | None = None, markdown: Path | None = None,
        errata: Path | None = None, kept: Path | None = None, force: bool = False) -> int:
    """Judge every claim, print each verdict at once, and write the files.

    Parameters
    ----------
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
    from tcc_sim.output.files import draft
    from tcc_sim.output.tables import text
    from tcc_sim.result import json_of
    from tcc_sim.study.paper.catalogue import paper_system
    from tcc_sim.study.paper.claims import CLAIMS, PRESSURES, ClaimsReport, Verdict, claims_page, counts_of, judge
    from tcc_sim.study.paper.errata import errata_page

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
    say(counts_of(verdicts))
    present(arguments, paper_system(), ClaimsReport(verdicts, not interrupted))
    if markdown is not None:
        with draft(markdown) as part:
            part.write_text(claims_page(verdicts, complete=not interrupted))
    return 130 if interrupted else 0
