"""`tcc-sim sweep`: solve a scene at many values of one key or two, on all cores or on a cluster."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from tcc_sim.cli import arguments as common
from tcc_sim.cli.options import Form, bounds_of_range, command, keywords_of, of, option_of, options_in, values_of_range
from tcc_sim.errors import InputError, SweepInterrupted, WorkersLost, counted, given_in
from tcc_sim.model.parameters import ORDER
from tcc_sim.model.quantity import SPEED_UNIT, number_in
from tcc_sim.output.files import STANDARD_OUTPUT
from tcc_sim.output.terminal import terminal_width

SCATTER, GAINS = "tcc_sim.sweeps.scatter:scattering", "tcc_sim.sweeps.gains:gain_map"
WITH_SCATTER = ("samples", *options_in(SCATTER, "over values"))
WITH_LAW = ("target", *options_in(GAINS, "duration jobs dask"))
"""Options that need --scatter, and those that need --law."""
FORMS = {**common.FORMS, "orders": Form("SPEED,...", optional=""), "direction": Form("cold|up|down"),
         "law": Form("FILE.py:NAME")}

if TYPE_CHECKING:
    from tcc_sim.model.parameters import System
    from tcc_sim.sweeps.results import Curve, Sweep


@command(common.add_scene, of(SCATTER, FORMS, WITH_SCATTER, seed=None),
         of(common.PLAN, FORMS, without=common.UNPLANNED),
         of(GAINS, FORMS, ("law", *WITH_LAW), target=None),
         of("tcc_sim.sweeps.sweep:sweep_curves", FORMS, "jobs dask"), common.outputs(
             "results in value order", "a table with a row per value as .csv, .parquet, .mat or .npz, and until it is "
             "complete each point as soon as it is solved in FILE.part; with any other suffix the points alone; the "
             "same command resumes from them", force="replace an existing --json file, table or picture"),
         forms={"over": Form("KEY=START:STOP:COUNT[:log]|KEY=V,V,...", repeated=True),
                "scatter": Form("KEY=LOW:HIGH", repeated=True)})
def sweep(arguments: argparse.Namespace, over: Sequence[str] = (), scatter: Sequence[str] = ()) -> None:
    """Solve a scene at many values of one key or two.

    example : sweep fig02 --over engine.frequency=40:300:131 --cycles 600 --discard 500 --plot sweep.png
    prints : one line for each value, or quantiles with --scatter; with --json or --out only the number of values
    writes : --json FILE holds all numbers, --out FILE each point as soon as it is solved, --plot FILE a picture
    over : scene key and its values; given twice, a grid of two keys; friction.coefficients takes factors of a whole
        table
    scatter : scene key and the bounds of its tolerance; samples give quantiles of every result
    """
    from tcc_sim.output.provenance import HEAD, head_of
    from tcc_sim.output.samples import TABLES, write_result
    from tcc_sim.output.tables import doubtful_lines, quantile_lines, sweep_lines, unsettled_lines
    from tcc_sim.sweeps.scatter import Scattered
    from tcc_sim.sweeps.sweep import sweep_curves

    if arguments.law is not None:
        _map_gains(arguments)
        return
    for name in _given(arguments, WITH_LAW if scatter else (*WITH_LAW, *WITH_SCATTER)):
        needed = "--law FILE.py:NAME" if name in WITH_LAW else "--scatter KEY=LOW:HIGH"
        raise InputError(f"{option_of(name)} needs {needed}")
    scene = common.scene_of(arguments)
    orders = None if arguments.orders is None else _frequencies(arguments, scene.system.engine.order)
    plan = common.plan_of(arguments, direction=arguments.direction, orders=orders)
    table = arguments.out if arguments.out is not None and arguments.out.suffix in TABLES else None
    common.check_outputs(arguments, TABLES if table is not None else ())
    stored = arguments.out if table is None else table.with_name(table.name + ".part")
    curves, gather = _work(arguments, scene.system)
    ended: BaseException | None = None
    try:
        sweeps = sweep_curves(curves, plan, jobs=arguments.jobs, dask=arguments.dask, out=stored,
                              head=head_of("sweep_points", scene, arguments.words), progress=True)
    except (SweepInterrupted, WorkersLost) as stop:
        ended, sweeps = stop, stop.sweeps
    result = gather(sweeps)
    resumable = ended is not None and arguments.out is not None
    if arguments.json is not None or arguments.out is not None or ended is not None:
        points = [p for s in sweeps for p in s.points]
        failed = sum(p is not None and p.summary is None for p in points)
        lines = [f"{sum(p is not None for p in points)} of {counted(len(points), 'value')} in {sweeps[0].seconds:.3g} s"
                 + (f"; {failed} failed" if failed else ""), *unsettled_lines(sweeps)]
        if isinstance(result, Scattered) and "quantiles" in vars(arguments) and ended is None:
            lines = [lines[0], *quantile_lines(result)]
    elif isinstance(result, Scattered):
        lines = quantile_lines(result)
    else:
        lines = sweep_lines(result, terminal_width())
    if resumable:  # The resumed command writes the files, and would refuse to overwrite them.
        arguments.out = arguments.plot = None
        arguments.json = arguments.json if arguments.json == STANDARD_OUTPUT else None

    def write(document: dict[str, Any]) -> None:
        if table is not None and stored is not None:
            if table.suffix != ".npz":  # The table has the results already, and the text of many would be long.
                document = {name: document[name] for name in HEAD if name in document}
            write_result(table, result, document)
            stored.unlink()

    common.deliver(arguments, scene, result, lines + doubtful_lines(sweeps), write=write)
    if ended is not None:
        ended.args = (f"{ended}; the same command resumes from {stored}" if resumable else str(ended),)
        raise ended


def _map_gains(arguments: argparse.Namespace) -> None:
    """Judge the closed loops of a law, write the files, and print a line for each loop unless a file holds them."""
    from tcc_sim.output.samples import TABLES
    from tcc_sim.output.tables import gain_lines
    from tcc_sim.sweeps.gains import gain_map
    from tcc_sim.sweeps.simulation import Plan

    defaults = vars(Plan(duration=arguments.duration)) | {"scatter": []}
    for name in [name for name, value in defaults.items() if vars(arguments).get(name, value) != value] + [
            *_given(arguments, WITH_SCATTER)]:
        raise InputError(f"--law runs closed loops in real-time ticks, which takes no {option_of(name)}; remove it")
    if arguments.target is None:
        raise InputError("--law needs --target V, the slip speed to hold in rad/s")
    over = [values_of_range(text) for text in arguments.over]
    common.refuse_swept(arguments.set, [key for key, _ in over])
    if len(dict(over)) < len(over):
        raise InputError(f"--over gives {over[0][0]} twice")
    scene = common.scene_of(arguments)
    common.check_outputs(arguments, TABLES)
    duration = {} if arguments.duration is None else {"duration": arguments.duration}
    result = gain_map(scene, arguments.law, dict(over), arguments.target, **duration, progress=True,
                      **keywords_of(arguments, options_in(GAINS, "duration")))
    files = arguments.json is not None or arguments.out is not None
    common.deliver(arguments, scene, result, gain_lines(result, alone=files))


def _given(arguments: argparse.Namespace, names: Sequence[str]) -> dict[str, Any]:
    """Return those of these options, which have no default here, that are given."""
    options = keywords_of(arguments, names)
    return {name: options[name] for name in given_in(options)}


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
    from tcc_sim.sweeps.scatter import scattering
    from tcc_sim.sweeps.sweep import Curve, Grid, curves_of

    over = [values_of_range(text) for text in arguments.over]
    bounds = tuple(bounds_of_range(text, "--scatter", "LOW:HIGH") for text in arguments.scatter)
    common.refuse_swept(arguments.set, [key for key, _ in over] + [key for key, _, _ in bounds])
    if bounds:
        if len(over) > 1:
            raise InputError("--over is given twice; with --scatter it can be given once")
        if arguments.samples is None:
            raise InputError("--scatter needs --samples N, the number of samples")
        return scattering(system, bounds, over=over[0][0] if over else "", values=over[0][1] if over else (),
                          **_given(arguments, WITH_SCATTER))
    if not 1 <= len(over) <= 2:
        raise InputError(f"--over is given {len(over)} times; give it once for a sweep, twice for a grid")
    (key, values), *second = over
    if second:
        key_two, values_two = second[0]
        return (curves_of(system, key, values, key_two, values_two),
                lambda sweeps: Grid(key_two, tuple(values_two), sweeps))
    return [Curve(system, key, tuple(values))], lambda sweeps: sweeps[0]

