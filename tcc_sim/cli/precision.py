"""`tcc-sim precision`: error against run time of every solver."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tcc_sim.cli.arguments import new_directory

DEFAULT = Path("precision")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Where the report goes and how much it does."""
    parser.add_argument("--out", type=Path, default=DEFAULT, metavar="DIR",
                        help=f"new directory for precision.png, .svg, .json and .md (default {DEFAULT})")
    parser.add_argument("--quick", action="store_true", help="shorter ladders, done within half a minute")


def run(arguments: argparse.Namespace) -> int:
    """Measure, draw and write; an interrupted study writes the scenes that are complete."""
    folder = new_directory(arguments.out)
    from tqdm import tqdm

    from tcc_sim.reports.output import write_json
    from tcc_sim.reports.precision import as_json, fastest, study
    from tcc_sim.reports.precision_text import markdown
    from tcc_sim.views.precision import precision

    records, complete = [], False
    with tqdm(unit="run", disable=None, leave=False) as bar:
        def done(count: int, total: int, following: str) -> None:
            bar.total = total
            bar.set_description_str(following, refresh=False)
            bar.update(count - bar.n)

        try:
            for record in study(arguments.quick, done):
                records += [record]
            complete = True
        except KeyboardInterrupt:
            print("tcc-sim: interrupted", file=sys.stderr)
            if not records:
                return 130
    found = as_json(records, arguments.quick, complete)
    folder.mkdir()
    write_json(folder / "precision.json", found)
    (folder / "precision.md").write_text(markdown(found, "precision.png"), encoding="utf-8")
    precision(folder / "precision", records)
    for record in records:
        best = fastest(record, 1e-6)
        times = [f"{name} {1e3 * row['seconds']:.3g} ms" for name, row in sorted(best.items(), key=lambda x: x[1]["seconds"])]
        print(f"{record['scene']}: floor {record['reference']['floor']:.1e}; {record['cycles']} cycles with errors up to 1e-6: "
              + (", ".join(times) or "none"))
        for row in record["long_run"]:
            print(f"    {row['solver']} at {row['setting']:g}: {1e3 * row['seconds_per_100_cycles']:.4g} ms per 100 cycles")
    print(f"{folder}/precision.png, .svg, .json, .md")
    return 0 if complete else 130
