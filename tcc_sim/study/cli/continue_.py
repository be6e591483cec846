"""`tcc-sim continue`: the branches of periodic motions of a scene along one of its keys, with their bifurcations."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tcc_sim.cli import arguments as common
from tcc_sim.cli.options import Form, command, keywords_of, of, options_in
from tcc_sim.cli.ranges import bounds_of_range
from tcc_sim.errors import counted
from tcc_sim.shown_units import key_value, speed

PLAN = "tcc_sim.study.continuation.motions:ContinuationPlan"

if TYPE_CHECKING:
    from tcc_sim.study.continuation.motions import Motions


@command(partial(common.add_scene, more="; for the key of --over, its first value"),
         of(PLAN, {"switch": Form("DEPTH", int, optional=1), "at": Form("VALUE", float, repeated=True),
                   "second": Form("KEY=START:STOP")}, without="over seeds"),
         common.outputs("branches, bifurcations and curves"),
         forms={"over": Form("KEY=START:STOP", required=True)})
def run(arguments: argparse.Namespace, over: str, seeds: Path | None = None) -> int:
    """Follow the branches, write the files, and print branches and bifurcations.

    Parameters
    ----------
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
    with common.drawn(arguments, scene, motions if motions.branches else None):
        common.present(arguments, scene, motions, _lines(motions))
    if interrupted:
        print("tcc-sim: interrupted; the results up to here are complete", file=sys.stderr)
        return 130
    return 0


def _lines(motions: Motions) -> Iterator[str]:
    key, second = motions.plan.over, motions.plan.second_over or ""
    for number, branch in enumerate(motions.branches):
        values = [s.value for s in branch.points]
        yield (f"branch {number}: period {branch.period}, {key_value(key, min(values), 9, max(values))}, "
               f"{counted(len(values), 'point')}, {sum(s.orbit.stable for s in branch.points)} stable")
        for sentence in dict.fromkeys(end.described() for end in branch.ended):
            yield f"  {sentence}"
    for item in motions.bifurcations:
        yield (f"{item.kind:>18}  {key_value(key, item.value, 10)}  branch {item.branch}  "
               f"max slip {speed(item.point.orbit.seen.largest, 8)}  residual {item.residual:.1e}")
    for entry in motions.at:
        yield (f"at {key_value(key, entry['value'])}: branch {entry['branch']}, period {entry['period']}, max slip "
               f"{speed(entry['max_slip_speed'], 9)}, {'stable' if entry['stable'] else 'unstable'}, {entry['events']}")
    for curve in motions.curves:
        ends = "; ".join(dict.fromkeys(end.described() for end in curve.ended))
        yield f"curve of {curve.kind}: {counted(len(curve.values), 'point')}; {ends}"
        for point in curve.special:
            yield point.described(key, second)
