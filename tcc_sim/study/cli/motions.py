"""`tcc-sim continue` and `basins`: branches of periodic motions with their bifurcations, and attractors with basins."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tcc_sim.cli import arguments as common
from tcc_sim.cli.options import Form, bounds_of_range, command, keywords_of, of, options_in, values_of_range
from tcc_sim.errors import counted
from tcc_sim.shown_units import key_value, speed

PLAN, BASINS = "tcc_sim.study.continuation.motions:ContinuationPlan", "tcc_sim.study.basins.compute:basins"

if TYPE_CHECKING:
    from tcc_sim.study.basins.results import Planes
    from tcc_sim.study.continuation.motions import Motions


@command(partial(common.add_scene, more="; for the key of --over, its first value"),
         of(PLAN, {"switch": Form("DEPTH", int, optional=1), "at": Form("VALUE", float, repeated=True),
                   "second": Form("KEY=START:STOP")}, without="over seeds"),
         common.outputs("branches, bifurcations and curves"),
         forms={"over": Form("KEY=START:STOP", required=True)})
def continue_(arguments: argparse.Namespace, over: str, seeds: Path | None = None) -> None:
    """Follow periodic motions along a key, stable or unstable, with their bifurcations.

    example : continue chaos --over friction.kinetic_coefficient=0.2:0.3 --switch --plot branches.png
    prints : branches, the reasons for their ends, and bifurcations
    writes : --json FILE holds all numbers, --plot FILE a picture
    over : scene key to vary, and its range
    seeds : start from the attractors in FILE, which basins --json wrote
    """
    from tcc_sim.output.files import read_json
    from tcc_sim.study.continuation.motions import ContinuationPlan, Motions, check, continue_motions, seeds_in
    from tcc_sim.sweeps.progress import point_bar

    scene = common.scene_of(arguments)
    key, low, high = bounds_of_range(over, "--over")
    second = None if arguments.second is None else bounds_of_range(arguments.second, "--second")
    starts = () if seeds is None else seeds_in(read_json(seeds), scene.system, key, low, high)
    plan = ContinuationPlan(key, low, high, seeds=starts, **{**keywords_of(arguments, options_in(PLAN, "over seeds")),
                                                             "at": tuple(arguments.at), "second": second})
    check(scene.system, plan)
    common.check_outputs(arguments)
    motions, interrupted = Motions(plan, scene.system), False
    try:
        with point_bar() as tick:
            continue_motions(scene.system, plan, tick, motions)
    except KeyboardInterrupt:
        interrupted = True
    common.deliver(arguments, scene, motions, _branch_lines(motions), shown=motions if motions.branches else None)
    if interrupted:
        raise KeyboardInterrupt("interrupted; the results up to here are complete")


def _branch_lines(motions: Motions) -> Iterator[str]:
    key, second = motions.plan.over, motions.plan.second_over or ""
    for number, branch in enumerate(motions.branches):
        values = [s.value for s in branch.points]
        yield (f"branch {number}: period {branch.period}, {key_value(key, min(values), 9, max(values))}, "
               f"{counted(len(values), 'point')}, {sum(s.stable for s in branch.points)} stable")
        for sentence in dict.fromkeys(end.described() for end in branch.ended):
            yield f"  {sentence}"
    for item in motions.bifurcations:
        yield (f"{item.kind:>18}  {key_value(key, item.value, 10)}  branch {item.branch}  "
               f"max slip {speed(item.point.seen.largest, 8)}  residual {item.residual:.1e}")
    for entry in motions.at:
        yield (f"at {key_value(key, entry['value'])}: branch {entry['branch']}, period {entry['period']}, max slip "
               f"{speed(entry['max_slip_speed'], 9)}, {'stable' if entry['stable'] else 'unstable'}, {entry['events']}")
    for curve in motions.curves:
        ends = "; ".join(dict.fromkeys(end.described() for end in curve.ended))
        yield f"curve of {curve.kind}: {counted(len(curve.values), 'point')}; {ends}"
        for point in curve.special:
            yield point.described(key, second)


@command(common.add_scene, of(BASINS, {
    **common.FORMS, "plane": Form("KEY=START:STOP:COUNT", repeated=True, required=True),
    "over": Form("KEY=START:STOP:COUNT")}, needed="plane"), common.outputs(
        "attractors and fractions", "label and cycles of every cell: .npz, .mat, .csv or .parquet; until it is "
        "complete, finished rows are in FILE.part, and the same command resumes from them"))
def basins(arguments: argparse.Namespace, boundary: bool = False) -> None:
    """Find attractors and their basins in a plane of two initial conditions.

    example : basins chaos --plane initial.slip_speed=-40:40:41 --plane initial.plate_angle=0:0.2:41 --plot basins.png
    prints : attractors with the share of the plane that leads to each
    writes : --json FILE holds all numbers, --out FILE the label of each cell, --plot FILE a picture
    boundary : add the uncertainty exponent of the basin boundary
    """
    from tcc_sim.output.provenance import head_of
    from tcc_sim.output.samples import TABLES
    from tcc_sim.study.basins.compute import basins as compute
    from tcc_sim.study.basins.results import Planes

    scene = common.scene_of(arguments)
    plane = [values_of_range(text, "--plane", even=True) for text in arguments.plane]
    over = None if arguments.over is None else values_of_range(arguments.over, even=True)
    common.refuse_swept(arguments.set, [key for key, _ in (*plane, *([] if over is None else [over]))])
    common.check_outputs(arguments, TABLES)
    part = None if arguments.out is None else arguments.out.with_name(arguments.out.name + ".part")
    try:
        result = compute(scene, plane, over=over, **keywords_of(arguments, options_in(BASINS, "over")), part=part,
                         progress=True, head=head_of("basin_rows", scene, arguments.words))
        planes = Planes(result, boundary)
        common.deliver(arguments, scene, planes, _basin_lines(planes), shown=result)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"interrupted; the same command resumes from {part}" if part else "") from None
    if part is not None:
        part.unlink()


def _basin_lines(planes: Planes) -> Iterator[str]:
    for one in planes.planes:
        if one.over is not None:
            yield key_value(*one.over)
        yield from one.lines()
        uncertain = one.boundary() if planes.bounded else None
        if uncertain is not None:
            yield (f"  boundary: uncertainty exponent {uncertain.exponent:.3f} (standard error {uncertain.error:.3f}), "
                   f"dimension {uncertain.dimension:.3f}")
        elif planes.bounded:
            yield "  boundary: no uncertainty exponent, too few neighbouring cells have different labels"
        yield (f"  {counted(one.labels.size, 'cell')} in {one.seconds:.3g} s, "
               f"{float(one.cycles.mean()):.1f} periods of excitation per cell")
