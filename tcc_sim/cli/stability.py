"""`tcc-sim stability`: stiff and extreme cases."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tcc_sim.cli.arguments import new_directory

DEFAULT = Path("stability")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Where the report goes and how much it does."""
    parser.add_argument("--out", type=Path, default=DEFAULT, metavar="DIR",
                        help=f"new directory for stability.png, .svg, .json and .md (default {DEFAULT})")
    parser.add_argument("--quick", action="store_true", help="fewer scenes and coarser charts, done within half a minute")


def run(arguments: argparse.Namespace) -> int:
    """Solve, draw and write; an interrupted report holds what is done."""
    folder = new_directory(arguments.out)
    from tqdm import tqdm

    from tcc_sim.reports.charts import charts
    from tcc_sim.reports.output import write_json
    from tcc_sim.reports.stability import grid, markdown, summary
    from tcc_sim.views.stability import stability

    records, maps, complete = [], [], False
    with tqdm(unit="scene", disable=None, leave=False) as bar:
        def done(count: int, total: int, following: str) -> None:
            bar.total = total
            bar.set_description_str(following, refresh=False)
            bar.update(count - bar.n)

        try:
            for record in grid(arguments.quick, done):
                records += [record]
            maps = charts(arguments.quick, bar.set_description_str)
            complete = True
        except KeyboardInterrupt:
            print("tcc-sim: interrupted", file=sys.stderr)
            if not records:
                return 130
    found = {"cases": records, "summary": summary(records), "charts": maps, "quick": arguments.quick, "complete": complete}
    folder.mkdir()
    write_json(folder / "stability.json", found)
    (folder / "stability.md").write_text(markdown(found, "stability.png"), encoding="utf-8")
    stability(folder / "stability", maps, records)
    for engine, total in found["summary"].items():
        ended = ", ".join(f"{name} {count}" for name, count in total["statuses"].items())
        print(f"{engine}: {total['cases']} cases ({ended}), {total['not_finite']} not finite, {total['not_bounded']} past the "
              f"energy bound, {total['past_iteration_bound']} past the iteration bound")
    print(f"{folder}/stability.png, .svg, .json, .md")
    return 0 if complete else 130
