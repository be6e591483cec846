"""`tcc-sim continue`: the branches of periodic motions of a scene along one of its keys, with their bifurcations."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from tcc_sim.cli.arguments import add_outputs, add_scene, bounds_of_range, check_outputs, plot_result, present, scene_of
from tcc_sim.errors import counted

if TYPE_CHECKING:
    from tcc_sim.continuation.motions import Motions


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What is followed, what is looked for, and where the results go."""
    add_scene(parser, "; the value of the key of --over is where it begins")
    parser.add_argument("--over", metavar="KEY=START:STOP", required=True,
                        help="scene key that is followed, and its range")
    parser.add_argument("--period", metavar="N", type=int,
                        help="engine cycles of the motion to begin with (default: those of the settled motion)")
    parser.add_argument("--at", metavar="VALUE", type=float, action="append", default=[],
                        help="give the motions at exactly this value of the key, on every branch")
    parser.add_argument("--switch", metavar="DEPTH", type=int, nargs="?", const=1, default=0,
                        help="follow the branches of doubled period too, DEPTH doublings deep (1 if not given)")
    parser.add_argument("--second", metavar="KEY=START:STOP",
                        help="follow every fold, doubling, Neimark-Sacker and stick border in a second key too")
    parser.add_argument("--limit", action="store_true",
                        help="follow every bifurcation of the smoothed law to the set-valued one")
    parser.add_argument("--seeds", metavar="FILE", type=Path,
                        help="follow the branches through the attractors that basins --json wrote to FILE instead")
    add_outputs(parser, "everything that was found")


def run(arguments: argparse.Namespace) -> int:
    """Follow the branches, write what was asked for, and print what was found."""
    from tcc_sim.continuation.initial_orbits import seeds_in
    from tcc_sim.continuation.motions import ContinuationPlan, Motions, check, continue_motions
    from tcc_sim.output.files import read_json
    from tcc_sim.sweeps.progress import point_bar

    scene = scene_of(arguments)
    key, low, high = bounds_of_range(arguments.over, "--over")
    second = None if arguments.second is None else bounds_of_range(arguments.second, "--second")
    seeds = () if arguments.seeds is None else seeds_in(read_json(arguments.seeds), scene.system, key, low, high)
    plan = ContinuationPlan(key, low, high, arguments.period, tuple(arguments.at), arguments.switch,
                            second, arguments.limit, seeds)
    check(scene.system, plan)
    check_outputs(arguments)
    found, interrupted = Motions(plan, scene.system.friction.law), False
    try:
        with point_bar() as tick:
            continue_motions(scene.system, plan, tick, found)
    except KeyboardInterrupt:
        interrupted = True
    present(arguments, scene, found, _lines(found))
    if found.branches:
        plot_result(arguments, found, scene.name)
    if interrupted:
        print("tcc-sim: interrupted; what was found until then is kept", file=sys.stderr)
        return 130
    return 0


def _lines(found: Motions) -> Iterator[str]:
    """The branches, their ends and their bifurcations."""
    for number, branch in enumerate(found.branches):
        values = [s.value for s in branch.points]
        yield (f"branch {number}: period {branch.period}, {found.plan.over} {min(values):.9g} to {max(values):.9g}, "
               f"{counted(len(values), 'point')}, {sum(s.orbit.stable for s in branch.points)} stable")
        for sentence in dict.fromkeys(branch.ended):
            yield f"  {sentence}"
    for index, item in enumerate(found.bifurcations):
        limit = f"  {found.limits[index]}" if index in found.limits else ""
        yield (f"{item.kind:>18}  {item.value:.10g}  branch {item.branch}  "
               f"max slip {item.point.orbit.seen.largest:.8g} rad/s  residual {item.residual:.1e}{limit}")
    for entry in found.at:
        yield (f"at {entry['value']:.9g}: branch {entry['branch']}, period {entry['period']}, max slip "
               f"{entry['max_slip_speed']:.9g} rad/s, {'stable' if entry['stable'] else 'unstable'}, {entry['events']}")
    for curve in found.curves:
        ends = "; ".join(dict.fromkeys(map(str, curve.ended)))
        yield f"curve of {curve.kind}: {counted(len(curve.values), 'point')}; {ends}"
        for point in curve.special:
            yield str(point)
