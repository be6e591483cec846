"""Write the page of all fields of JSON files: python .ci/instruments/fields_page.py. A test compares the page."""

from __future__ import annotations

from pathlib import Path

from tcc_sim.estimation.identify import Identification
from tcc_sim.estimation.linearise import Linearisation
from tcc_sim.output.explained import SceneExplanation
from tcc_sim.output.fields import fields_of
from tcc_sim.output.provenance import HEAD
from tcc_sim.output.tables import escape, markdown_table
from tcc_sim.replay.measured import MeasuredRun
from tcc_sim.replay.result import Replay
from tcc_sim.result import Reported
from tcc_sim.study.basins.results import Planes
from tcc_sim.study.benchmarks.precision_report import PrecisionReport
from tcc_sim.study.benchmarks.stability import StabilityReport
from tcc_sim.study.continuation.motions import Motions
from tcc_sim.study.paper.claims import ClaimsReport
from tcc_sim.study.paper.figure_results import Figure
from tcc_sim.sweeps.results import Grid, Point, Sweep
from tcc_sim.sweeps.scatter import Scattered
from tcc_sim.sweeps.simulation import Simulation

PAGE = Path(__file__).resolve().parent.parent.parent / ".github" / "guide" / "fields.md"
KINDS: dict[str, tuple[str, tuple[type, ...]]] = {
    "simulate": ("tcc-sim simulate --json", (Simulation,)),
    "analyse": ("tcc-sim analyse --json, and analysis.json of tcc-sim demo", (Replay,)),
    "table": ("tcc-sim analyse FILE.csv --json", (MeasuredRun,)),
    "sweep": ("tcc-sim sweep --json: of one key, of two keys (`second_over`), or of samples (`scatter`)",
              (Sweep, Grid, Scattered)),
    "continue": ("tcc-sim continue --json", (Motions,)),
    "basins": ("tcc-sim basins --json", (Planes,)),
    "explain": ("tcc-sim explain --json", (SceneExplanation,)),
    "linearise": ("tcc-sim linearise --json", (Linearisation,)),
    "identify": ("tcc-sim identify --json", (Identification,)),
    "figure": ("figNN.json of tcc-sim figure", (Figure,)),
    "claims": ("tcc-sim claims --json", (ClaimsReport,)),
    "precision": ("precision.json of tcc-sim precision", (PrecisionReport,)),
    "stability": ("stability.json of tcc-sim stability", (StabilityReport,)),
    "realtime": ("tcc-sim realtime --json", ())}
INTRODUCTION = """`.ci/instruments/fields_page.py` writes this page from the classes of results. The name of a field
within another one, or of the entries of a list, has a dot. The key `units` of a file gives the unit of every field that
has one; files are in SI units."""
LINES = """## Files of lines: `--out FILE.jsonl` of tcc-sim sweep, `FILE.part` of sweep and basins with another --out

The first line begins as every file does and says which work it is of. Each further line is an object: `curve` and
`index` are the numbers of the curve and of its value or row, `record` is the result, `crc32` the CRC-32 of the text
before it. The record of a point has its `value`, {}, `final` (slip speed, plate angle and plate speed at the end) and
`final_cycle`; that of a row of cells has `attractors` (number of those known), `labels`, and `cycles` until each cell
was decided."""


def fields_by_kind(kind: str) -> dict[str, Reported]:
    """All fields of one kind of JSON beside its head."""
    classes = KINDS[kind][1]
    if kind == "realtime":  # It needs rclpy.
        from tcc_sim.study.benchmarks.pacing_benchmark import PacingFigures

        classes = (PacingFigures,)
    return {name: entry for of in classes for name, entry in fields_of(of)}


def unit_of(entry: Reported) -> str:
    """Return a unit as the page prints it."""
    if entry.unit == "{*}":
        return "of each key"
    return entry.unit.replace("{", "unit of `").replace("}", "`") if "{" in entry.unit else entry.unit


def page() -> str:
    """The page."""
    lines = ["# Fields of JSON files", "", INTRODUCTION, "", "## Every file", "",
             *markdown_table(("field", "meaning"), [(f"`{name}`", meaning) for name, meaning in HEAD.items()])]
    for kind, (title, _) in KINDS.items():
        rows = [(f"`{name}`", unit_of(entry), escape(entry.meaning)) for name, entry in fields_by_kind(kind).items()]
        lines += ["", f"## {title}", "", *markdown_table(("field", "unit", "meaning"), rows)]
    of_points = ", ".join(f"`{name}`" for name in dict(fields_of(Point)) if "." not in name)
    return "\n".join([*lines, "", LINES.format(of_points), ""])


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
