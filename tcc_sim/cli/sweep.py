"""`tcc-sim sweep`: solve a scene at many values of one key or two, on all cores or on a cluster."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from tcc_sim.cli import arguments as common
from tcc_sim.cli.ranges import bounds_of_range, values_of_range
from tcc_sim.errors import InputError, SweepInterrupted, WorkersLost, counted
from tcc_sim.model.crank_speed import ORDER
from tcc_sim.model.quantity import SPEED_UNIT, number_in
from tcc_sim.output.files import STANDARD_OUTPUT
from tcc_sim.output.terminal import terminal_width

if TYPE_CHECKING:
    from tcc_sim.model.parameters import System
    from tcc_sim.sweeps.results import Curve, Sweep


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add scene, values, samples, length, solver, workers and outputs."""
    common.add_scene(parser)
    values = parser.add_argument_group("values")
    values.add_argument("--over", metavar="KEY=START:STOP:COUNT[:log]|KEY=V,V,...", action="append", default=[],
                        help="scene key and its values; given twice, a grid of two keys; friction.coefficients takes "
                        "factors of a whole table")
    values.add_argument("--direction", choices=("cold", "up", "down"), default="cold",
                        help="start of each value of the first key: cold from the scene's initial state (default), up "
                        "or down from the last state of the neighbour below or above, with the phases of torque and "
                        "load")
    samples = parser.add_argument_group("tolerances")
    samples.add_argument("--scatter", metavar="KEY=LOW:HIGH", action="append", default=[],
                         help="scene key and the bounds of its tolerance, may be repeated; samples give "
                         "quantiles of every result")
    samples.add_argument("--samples", metavar="N", type=int, help="number of samples; best a power of 2")
    samples.add_argument("--seed", metavar="N", type=int, default=0, help="seed of the samples (default 0)")
    samples.add_argument("--quantiles", metavar="P,P,...", help="probabilities of the quantiles, such as "
                         "0.025,0.5,0.975 (default 0.05,0.5,0.95)")
    samples.add_argument("--every-sample", action="store_true",
                         help="include samples that ran away or have not settled in the quantiles")
    length = parser.add_argument_group("length")
    span = length.add_mutually_exclusive_group()
    span.add_argument("--cycles", metavar="N", type=int, help="periods of excitation solved per value (default 150)")
    span.add_argument("--duration", metavar="S", type=float,
                      help="seconds solved instead (default for a scene with profiles: up to their last point)")
    length.add_argument("--discard", metavar="N|auto", default=None,
                        help="cycles dropped (default 50); auto stops as soon as the section has settled, and drops "
                        "the cycles before")
    figures = common.add_solver(parser)
    figures.add_argument("--orders", metavar="SPEED,...", nargs="?", const="", help="add judder, and "
                         "amplitudes of the first four orders of slip speed and shaft torque at these frequencies of "
                         "the excitation, rad/s or hz, or speeds of the crankshaft, rpm (default: five within the "
                         "range of each run, or its constant one)")
    common.add_workers(parser)
    common.add_outputs(parser, "results in value order", "a table with a row per value as .csv, .parquet, .mat or "
                       ".npz, and until it is complete each point as soon as it is solved in FILE.part; with any other "
                       "suffix the points alone; the same command resumes from them",
                       force="replace an existing --json file, table or picture")


def run(arguments: argparse.Namespace) -> int:
    """Sweep, write the files, and print a table unless a file holds the points."""
    from tcc_sim.output.provenance import HEAD, head_of
    from tcc_sim.output.table_files import TABLES, write_result
    from tcc_sim.output.tables import doubtful_lines, quantile_lines, sweep_lines, unsettled_lines
    from tcc_sim.sweeps.scatter import Scattered
    from tcc_sim.sweeps.sweep import sweep_curves

    scene = common.scene_of(arguments)
    orders = None if arguments.orders is None else _frequencies(arguments, scene.system.engine.order)
    plan = common.plan_of(arguments, direction=arguments.direction, orders=orders)
    table = arguments.out if arguments.out is not None and arguments.out.suffix in TABLES else None
    common.check_outputs(arguments, TABLES if table is not None else ())
    stored = arguments.out if table is None else table.with_name(table.name + ".part")
    curves, gather = _work(arguments, scene.system)
    ended = ""
    try:
        sweeps = sweep_curves(curves, plan, jobs=arguments.jobs, dask=arguments.dask, out=stored,
                              head=head_of("sweep_points", scene, arguments.words), progress=True)
    except (SweepInterrupted, WorkersLost) as stop:
        ended, sweeps = str(stop), stop.sweeps
    result = gather(sweeps)
    resumable = bool(ended) and arguments.out is not None
    if arguments.json is not None or arguments.out is not None or ended:
        points = [p for s in sweeps for p in s.points]
        failed = sum(p is not None and p.summary is None for p in points)
        lines = [f"{sum(p is not None for p in points)} of {counted(len(points), 'value')} in {sweeps[0].seconds:.3g} s"
                 + (f"; {failed} failed" if failed else ""), *unsettled_lines(sweeps)]
    elif isinstance(result, Scattered):
        lines = quantile_lines(result)
    else:
        lines = sweep_lines(result, terminal_width())
    if resumable and arguments.json != STANDARD_OUTPUT:
        arguments.json = None  # Else the resumed command would refuse to overwrite this file.
    common.present(arguments, scene, result, lines + doubtful_lines(sweeps))
    if not resumable:
        common.plot_result(arguments, result, scene.name)
        if table is not None and stored is not None:
            document = common.document_of(arguments, scene, result)
            if table.suffix != ".npz":  # The table has the results already, and the text of many would be long.
                document = {name: document[name] for name in HEAD if name in document}
            write_result(table, type(result), result.columns(), document)
            stored.unlink()
    if ended:
        resume = f"; the same command resumes from {stored}" if resumable else ""
        print(f"tcc-sim: {ended}{resume}", file=sys.stderr)
        return 130 if ended == "interrupted" else 1
    return 0


def _numbers(option: str, text: str) -> tuple[float, ...]:
    """Return the numbers of an option, separated by commas; none for an empty text."""
    try:
        return tuple(float(word) for word in text.split(",") if text)
    except ValueError:
        raise InputError(f"{option} is {text!r}; it must be numbers separated by commas") from None


def _frequencies(arguments: argparse.Namespace, order: float) -> tuple[float, ...]:
    """Return the frequencies of --orders, rad/s; none for an empty text."""
    words = [word for word in arguments.orders.split(",") if arguments.orders]
    turns = [word for word in words if word.strip().lower().endswith("rpm")]
    if turns and any(text.partition("=")[0].strip() == ORDER for text in (*arguments.over, *arguments.scatter)):
        raise InputError(f"--orders has {turns[0]}, the speed of the crankshaft, and {ORDER} differs from run to run; "
                         "give frequencies of the excitation in rad/s or hz")
    try:
        return tuple(number_in(word, SPEED_UNIT) * (order if word in turns else 1.0) for word in words)
    except TypeError:
        raise InputError(f"--orders is {arguments.orders!r}; it must be frequencies of the excitation, in rad/s or "
                         "with hz behind, or speeds of the crankshaft with rpm behind, separated by commas") from None


def _work(arguments: argparse.Namespace, system: System) -> tuple[list[Curve], Callable[[list[Sweep]], Any]]:
    """Return the curves to solve, and the function that makes a result of the solved ones."""
    from tcc_sim.sweeps.scatter import PROBABILITIES, Scattered, Tolerances, scattered_curves
    from tcc_sim.sweeps.sweep import Curve, Grid, curves_of

    over = [values_of_range(text) for text in arguments.over]
    bounds = tuple(bounds_of_range(text, "--scatter", "LOW:HIGH") for text in arguments.scatter)
    common.refuse_swept(arguments.set, [key for key, _ in over] + [key for key, _, _ in bounds])
    if bounds:
        if len(over) > 1:
            raise InputError("--over is given twice; with --scatter it can be given once")
        if arguments.samples is None:
            raise InputError("--scatter needs --samples N, the number of samples")
        probabilities = PROBABILITIES if arguments.quantiles is None else _numbers("--quantiles", arguments.quantiles)
        tolerances = Tolerances(bounds, arguments.samples, arguments.seed, probabilities)
        key, values = (*over, ("", []))[0]
        every = arguments.every_sample
        return (scattered_curves(system, tolerances, key, values),
                lambda sweeps: Scattered(tolerances, key, sweeps, every))
    if arguments.quantiles is not None:
        raise InputError("--quantiles needs --scatter KEY=LOW:HIGH")
    if arguments.every_sample:
        raise InputError("--every-sample needs --scatter KEY=LOW:HIGH")
    if arguments.samples is not None:
        raise InputError("--samples needs --scatter KEY=LOW:HIGH")
    if not 1 <= len(over) <= 2:
        raise InputError(f"--over is given {len(over)} times; give it once for a sweep, twice for a grid")
    (key, values), *second = over
    if second:
        key_two, values_two = second[0]
        return (curves_of(system, key, values, key_two, values_two),
                lambda sweeps: Grid(key_two, tuple(values_two), sweeps))
    return [Curve(system, key, tuple(values))], lambda sweeps: sweeps[0]

