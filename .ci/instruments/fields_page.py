"""Write the page of all fields of JSON files: python .ci/instruments/fields_page.py. A test compares the page."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

from tcc_sim.estimation.identify import Identification
from tcc_sim.estimation.linearise import Linearisation
from tcc_sim.output.explanation import SceneExplanation
from tcc_sim.output.provenance import HEAD
from tcc_sim.output.tables import escape
from tcc_sim.replay.measured import MeasuredRun
from tcc_sim.replay.result import Replay
from tcc_sim.result import Reported, fields_of, reported_parts
from tcc_sim.study.basins.results import Planes
from tcc_sim.study.continuation.motions import Motions
from tcc_sim.study.paper.claims import ClaimsReport
from tcc_sim.study.paper.figures import Figure
from tcc_sim.sweeps.gains import GainMap
from tcc_sim.sweeps.results import Grid, Sweep
from tcc_sim.sweeps.scatter import Scattered
from tcc_sim.sweeps.simulation import Simulation

PAGE = Path(__file__).resolve().parent.parent.parent / ".github" / "guide" / "fields.md"
KINDS: dict[str, tuple[str, tuple[type, ...]]] = {
    "simulate": ("tcc-sim simulate --json", (Simulation,)),
    "analyse": ("tcc-sim analyse --json, and analysis.json of tcc-sim demo", (Replay,)),
    "table": ("tcc-sim analyse FILE.csv --json", (MeasuredRun,)),
    "sweep": ("tcc-sim sweep --json: of one key, of two keys (`second_over`), of samples (`scatter`), or of a `law`",
              (Sweep, Grid, Scattered, GainMap)),
    "continue": ("tcc-sim continue --json", (Motions,)),
    "basins": ("tcc-sim basins --json", (Planes,)),
    "explain": ("tcc-sim explain --json", (SceneExplanation,)),
    "linearise": ("tcc-sim linearise --json", (Linearisation,)),
    "identify": ("tcc-sim identify --json", (Identification,)),
    "figure": ("figNN.json of tcc-sim figure", (Figure,)),
    "claims": ("tcc-sim claims --json", (ClaimsReport,)),
    "precision": ("precision.json of tcc-sim precision", ()),
    "stability": ("stability.json of tcc-sim stability", ()),
    "realtime": ("tcc-sim realtime --json", ())}
OF_BENCHMARKS = ("precision", "stability")
"""Reports on the package itself; the modules declare their fields with meaning and unit."""
INTRODUCTION = """`.ci/instruments/fields_page.py` writes this page. A file is an object with the fields of its class
below. Units follow the name; a cycle is a period of excitation. A field with a link holds an object of that class, or
a list or mapping of such objects. "Fields of" a class stand directly in the object; "lists of" a class are one list for
each field."""
LINES = """## Files of lines: `--out FILE.jsonl` of tcc-sim sweep, `FILE.part` of sweep and basins with another --out

The first line begins as every file does and says which work it is of. Each further line is an object: `curve` and
`index` are the numbers of the curve and of its value or row, `record` is the result, `crc32` the CRC-32 of the text
before it. The record of a point has its `value`, the fields of [Point](#point), `final` (slip speed, plate angle and
plate speed at the end) and `final_cycle`; that of a row of cells has `attractors` (number of those known), `labels`,
and `cycles` until each cell was decided."""


def classes_of(kind: str) -> tuple[type, ...]:
    """The classes of one kind of JSON."""
    if kind == "realtime":  # It needs rclpy.
        from tcc_sim.study.benchmarks.pacing_benchmark import PacingFigures

        return (PacingFigures,)
    return KINDS[kind][1]


def fields_by_kind(kind: str) -> dict[str, Reported]:
    """All fields of one kind of JSON beside its head."""
    return {name: entry for of in classes_of(kind) for name, entry in fields_of(of)}


def unit_of(entry: Reported) -> str:
    """Return a unit as the page prints it."""
    if entry.unit == "{*}":
        return "of each key"
    unit = entry.unit.replace("periods of excitation", "cycles")
    return unit.replace("{", "unit of `").replace("}", "`") if "{" in unit else unit


def link_to(kind: type) -> str:
    """A link to the class on the page."""
    return f"[{kind.__name__}](#{kind.__name__.lower()})"


def list_of(kind: type, later: list[type], before: dict[str, type]) -> list[str]:
    """The fields of a class, each with a link to the class of its value; rows of an earlier class are named only.

    Adds classes not yet listed to `later`, and new rows with their class to `before`.
    """
    own, spread, listed, known = [], [], [], defaultdict(list)
    for attribute, entry, below in reported_parts(kind):
        later += [part for part in dict.fromkeys(below) if part not in later]
        links, unit = [link_to(part) for part in dict.fromkeys(below)], entry.unit and f", {unit_of(entry)}"
        if below and (entry.spread or entry.listed):
            (listed if entry.listed else spread).extend(links)
            continue
        name = "of each key" if entry.spread else f"`{entry.name or attribute}`"
        named = f"[{name}]({links[0].partition('](')[2]}" if len(links) == 1 else " ".join([name, *links])
        ending = ": " + "`".join(text if k % 2 else escape(text) for k, text in enumerate(entry.meaning.split("`")))
        row = f"- {named}{unit}{ending}"
        if before.setdefault(row, kind) is kind:
            if own and own[-1].endswith(ending):
                own[-1] = f"{own[-1].removesuffix(ending)}, {named}{unit}{ending}"
            else:
                own.append(row)
        else:
            known[before[row]].append((named, row))
    own += [rows[0][1] for rows in known.values() if len(rows) == 1]
    alike = {of: ", ".join(named for named, _ in rows) for of, rows in known.items() if len(rows) > 1}
    return [*own, *(f"- {names} as of {link_to(of)}" for of, names in alike.items()),
            *(f"- {word} of {', '.join(links)}" for word, links in (("fields", spread), ("lists", listed)) if links)]


def page() -> str:
    """The page."""
    lines = ["# Fields of JSON files", "", INTRODUCTION, "", "## Every file", "",
             *(f"- `{name}`: {meaning}" for name, meaning in HEAD.items()), "",
             "## Classes by file", ""]
    classes: list[type] = []
    before: dict[str, type] = {}
    for kind, (title, _) in KINDS.items():
        of_kind = classes_of(kind)
        classes += [of for of in of_kind if of not in classes and kind not in OF_BENCHMARKS]
        lines.append(f"- {title}: " + (f"[{kind}.py](../../tcc_sim/study/benchmarks/{kind}.py)"
                                       if kind in OF_BENCHMARKS else ", ".join(map(link_to, of_kind))))
    for of in classes:  # It grows meanwhile.
        lines += ["", f"## {of.__name__}", "", *list_of(of, classes, before)]
    return "\n".join([*lines, "", LINES, ""])


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
