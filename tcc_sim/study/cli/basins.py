"""`tcc-sim basins`: attractors and their basins in a plane of two initial conditions."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

from tcc_sim.cli import arguments as common
from tcc_sim.cli.options import Form, command, keywords_of, of, options_in
from tcc_sim.cli.ranges import values_of_range
from tcc_sim.errors import BasinsInterrupted, counted
from tcc_sim.shown_units import key_value

BASINS = "tcc_sim.study.basins.compute:basins"

if TYPE_CHECKING:
    from tcc_sim.study.basins.results import Axis, Basins


@command(common.add_scene, of(BASINS, {
    **common.FORMS, "plane": Form("KEY=START:STOP:COUNT", repeated=True, required=True),
    "over": Form("KEY=START:STOP:COUNT")}, needed="plane"), common.outputs(
        "attractors and fractions", "label and cycles of every cell: .npz, .mat, .csv or .parquet; until it is "
        "complete, finished rows are in FILE.part, and the same command resumes from them"))
def run(arguments: argparse.Namespace, boundary: bool = False) -> int:
    """Check the input, compute the basins, write the files, and print a summary.

    Parameters
    ----------
    boundary : add the uncertainty exponent of the basin boundary
    """
    from tcc_sim.output.provenance import head_of
    from tcc_sim.output.table_files import TABLES
    from tcc_sim.study.basins.compute import basins
    from tcc_sim.study.basins.results import Planes

    scene = common.scene_of(arguments)
    plane = [_axis("--plane", text) for text in arguments.plane]
    over = _axis("--over", arguments.over) if arguments.over is not None else None
    common.refuse_swept(arguments.set, [axis.key for axis in (*plane, *([] if over is None else [over]))])
    common.check_outputs(arguments, TABLES)
    part = None if arguments.out is None else arguments.out.with_name(arguments.out.name + ".part")
    try:
        result = basins(scene, plane, over=over, **keywords_of(arguments, options_in(BASINS, "over")), part=part,
                        progress=True, head=head_of("basin_rows", scene, arguments.words))
        # Drawing takes longest; if it is interrupted, no file is written, and the same command resumes.
        values = Planes(result, over, boundary)
        with common.drawn(arguments, scene, result):
            if arguments.out is not None:
                from tcc_sim.study.basins.results import write_basins

                write_basins(arguments.out, result, over, common.document_of(arguments, scene, values))
            common.present(arguments, scene, values, _lines(result, over, boundary))
    except (BasinsInterrupted, KeyboardInterrupt):
        resume = f"; the same command resumes from {part}" if part is not None else ""
        print(f"tcc-sim: interrupted{resume}", file=sys.stderr)
        return 130
    if part is not None:
        part.unlink()
    return 0


def _axis(option: str, text: str) -> Axis:
    from tcc_sim.study.basins.results import Axis

    key, values = values_of_range(text, option, even=True)
    return Axis(key, tuple(values))


def _lines(planes: list[Basins], over: Axis | None, boundary: bool) -> Iterator[str]:
    for k, one in enumerate(planes):
        if over is not None:
            yield key_value(over.key, over.values[k])
        yield from one.lines()
        uncertain = one.boundary() if boundary else None
        if uncertain is not None:
            yield (f"  boundary: uncertainty exponent {uncertain.exponent:.3f} (standard error {uncertain.error:.3f}), "
                   f"dimension {uncertain.dimension:.3f}")
        elif boundary:
            yield "  boundary: no uncertainty exponent, too few neighbouring cells have different labels"
        yield (f"  {counted(one.labels.size, 'cell')} in {one.seconds:.3g} s, "
               f"{float(one.cycles.mean()):.1f} periods of excitation per cell")
