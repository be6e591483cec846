"""`tcc-sim continue`: the branches of periodic motions of a scene along one of its keys, with their bifurcations."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tcc_sim.cli.arguments import add_plot, check_outputs, draw
from tcc_sim.errors import counted
from tcc_sim.output.terminal import say

if TYPE_CHECKING:
    from tcc_sim.continuation.motions import Motions


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What is followed, what is looked for, and where the results go."""
    parser.add_argument("scene", metavar="SCENE", help="name of a bundled scene, or a file")
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
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[],
                        help="change a key of the scene; the value of the key of --over is where it begins")
    parser.add_argument("--json", metavar="FILE", type=Path, help="everything that was found; - is standard output")
    add_plot(parser)
    parser.add_argument("--force", action="store_true", help="replace files that exist")


def run(arguments: argparse.Namespace) -> int:
    """Follow the branches, write what was asked for, and print what was found."""
    from tcc_sim.continuation.initial_orbits import seeds_in
    from tcc_sim.continuation.motions import ContinuationPlan, Motions, check, continue_motions
    from tcc_sim.output.files import STANDARD_OUTPUT, read_json, write_json
    from tcc_sim.output.provenance import document
    from tcc_sim.scene import load_scene, parse_assignments
    from tcc_sim.sweeps.ranges import bounds_of_range

    scene = load_scene(arguments.scene).with_values(parse_assignments(arguments.set))
    key, low, high = bounds_of_range(arguments.over, "--over")
    second = None if arguments.second is None else bounds_of_range(arguments.second, "--second")
    seeds = () if arguments.seeds is None else seeds_in(read_json(arguments.seeds), scene.system, key, low, high)
    plan = ContinuationPlan(key, low, high, arguments.period, tuple(arguments.at), arguments.switch,
                            second, arguments.limit, seeds)
    check(scene.system, plan)
    check_outputs(arguments)
    found, interrupted = Motions(plan, scene.system.friction.law), False
    try:
        with _bar() as tick:
            continue_motions(scene.system, plan, tick, found)
    except KeyboardInterrupt:
        interrupted = True
    if arguments.json is not None:
        write_json(arguments.json, document("continue", found.as_json(), scene, arguments.words))
    if found.branches:
        draw(arguments, found, scene.name)
    if arguments.json != STANDARD_OUTPUT:
        _print(found)
    if interrupted:
        print("tcc-sim: interrupted; what was found until then is kept", file=sys.stderr)
        return 130
    return 0


def _print(found: Motions) -> None:
    """The branches, their ends and their bifurcations."""
    for number, branch in enumerate(found.branches):
        values = [s.value for s in branch.points]
        say(f"branch {number}: period {branch.period}, {found.plan.over} {min(values):.9g} to {max(values):.9g}, "
            f"{counted(len(values), 'point')}, {sum(s.orbit.stable for s in branch.points)} stable")
        for sentence in dict.fromkeys(branch.ended):
            say(f"  {sentence}")
    for index, item in enumerate(found.bifurcations):
        limit = f"  {found.limits[index]}" if index in found.limits else ""
        say(f"{item.kind:>18}  {item.value:.10g}  branch {item.branch}  "
            f"max slip {item.point.orbit.seen.largest:.8g} rad/s  residual {item.residual:.1e}{limit}")
    for entry in found.at:
        say(f"at {entry['value']:.9g}: branch {entry['branch']}, period {entry['period']}, max slip "
            f"{entry['max_slip_speed']:.9g} rad/s, {'stable' if entry['stable'] else 'unstable'}, {entry['events']}")
    for curve in found.curves:
        ends = "; ".join(dict.fromkeys(map(str, curve.ended)))
        say(f"curve of {curve.kind}: {counted(len(curve.values), 'point')}; {ends}")
        for point in curve.special:
            say(f"{point.kind:>22}  {point.value:.9g}  {point.second:.9g}")


@contextmanager
def _bar() -> Iterator[Callable[[Any], None]]:
    """A function to call with every point; it moves a count where standard error is a terminal."""
    from tcc_sim.sweeps.progress import progress_bar

    with progress_bar("point") as bar:
        def tick(point: Any) -> None:
            bar.set_postfix_str(f"{point.value:.6g}, period {point.orbit.period}", refresh=False)
            bar.update()

        yield tick
