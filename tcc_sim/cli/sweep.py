"""`tcc-sim sweep`: a scene at many values of one key, on all cores or on a cluster."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tcc_sim.cli.arguments import add_plot, check_plot, new_file
from tcc_sim.errors import InputError, SweepInterrupted, require


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What is swept, how, where, and where the results go."""
    parser.add_argument("scene", metavar="SCENE", help="name of a bundled scene, or a file")
    parser.add_argument("--over", metavar="KEY=START:STOP:COUNT", required=True,
                        help="scene key and its evenly spaced values")
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[], help="change a key of the scene")
    parser.add_argument("--cycles", metavar="N", type=int, default=150,
                        help="engine cycles solved per value (default 150)")
    parser.add_argument("--discard", metavar="N|auto", default=None,
                        help="cycles dropped (default 50); auto drops those until the section has settled, and solves no more")
    parser.add_argument("--direction", choices=("cold", "up", "down"), default="cold",
                        help="start every value from the scene's initial state, or go on from the neighbour's last state")
    parser.add_argument("--solver", metavar="NAME", default="auto", help="name of a solver (default auto)")
    parser.add_argument("--rtol", metavar="R", type=float, help="relative tolerance of an adaptive solver")
    parser.add_argument("--step", metavar="H", type=float, help="step of a fixed-step solver, s")
    parser.add_argument("--damping", action="store_true", help="work out the equivalent damping (21) too")
    parser.add_argument("--lyapunov", action="store_true", help="work out the largest Lyapunov exponent too")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--jobs", metavar="N", type=int, help="threads (default: all cores)")
    where.add_argument("--dask", metavar="ADDRESS", help="Dask scheduler, such as tcp://127.0.0.1:8786")
    parser.add_argument("--json", metavar="FILE", type=Path, help="results in value order; - is standard output")
    parser.add_argument("--out", metavar="FILE", type=Path,
                        help="take every point as it is done; run the same command again to go on from there")
    add_plot(parser)
    parser.add_argument("--force", action="store_true", help="replace the --json file if it exists")


def run(arguments: argparse.Namespace) -> int:
    """Sweep, write what was asked for, and print a table where no file was."""
    from tcc_sim.output.files import STANDARD_OUTPUT, draft, write_json
    from tcc_sim.output.provenance import document, said
    from tcc_sim.scene import load_scene, parse_assignments
    from tcc_sim.studies.sweep import Plan, sweep, values_of_range

    scene = load_scene(arguments.scene).with_values(parse_assignments(arguments.set))
    key, values = values_of_range(arguments.over)
    plan = Plan(cycles=arguments.cycles, discard=_discard(arguments.discard), direction=arguments.direction,
                solver=arguments.solver, rtol=arguments.rtol, step=arguments.step, damping=arguments.damping,
                lyapunov=arguments.lyapunov)
    if arguments.json is not None and arguments.json == arguments.out:
        raise InputError(f"--json and --out are the same file, {arguments.json}")
    if arguments.json not in (None, STANDARD_OUTPUT):
        new_file(arguments.json, arguments.force)
    check_plot(arguments, arguments.json, arguments.out)
    if arguments.dask is not None:
        require("distributed", "--dask")
    interrupted = False
    try:
        found = sweep(scene.system, key, values, plan, jobs=arguments.jobs, dask=arguments.dask, out=arguments.out,
                      said=said("sweep_points", scene, arguments.words), progress=True)
    except SweepInterrupted as stop:
        interrupted, found = True, stop.sweeps[0]
    if arguments.json is not None:
        write_json(arguments.json, document("sweep", found.as_json(), scene, arguments.words))
    if arguments.plot is not None:
        from tcc_sim.views.plots import plot

        with draft(arguments.plot) as part:
            plot(found, part, arguments.width, title=scene.name)
    if arguments.json is None and arguments.out is None and not interrupted:
        print(f"{key:>30}  max slip (rad/s)  period  stick fraction  regime")
        for value, record in zip(values, found.records):
            assert record is not None
            if record["max_slip_speed"] is None:
                print(f"{value:>30.9g}  {record['status']}")
            else:
                print(f"{value:>30.9g}  {record['max_slip_speed']:>16.9g}  {record['period']:>6}  "
                      f"{record['stick_fraction']:>14.4f}  {record['regime']}")
    elif arguments.json != STANDARD_OUTPUT:
        done = sum(r is not None for r in found.records)
        failed = sum(r is not None and r["max_slip_speed"] is None for r in found.records)
        print(f"{done} of {len(values)} values in {found.seconds:.3g} s" + (f"; {failed} failed" if failed else ""))
    if interrupted:
        kept = f"; the same command goes on from {arguments.out}" if arguments.out is not None else ""
        print(f"tcc-sim: interrupted{kept}", file=sys.stderr)
        return 130
    return 0


def _discard(text: str | None) -> int | str | None:
    """A number of cycles, auto, or None where nothing was said."""
    if text is None or text == "auto":
        return text
    try:
        return int(text)
    except ValueError:
        raise InputError(f"--discard is {text!r}; it must be a number of cycles or auto") from None
