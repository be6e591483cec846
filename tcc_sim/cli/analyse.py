"""`tcc-sim analyse`: figures, JSON and a Rerun stream of a recording, complete or cut short."""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path

from tcc_sim.cli.arguments import (
    ANALYSIS,
    FORMS,
    add_outputs,
    check_outputs,
    document_of,
    plot_result,
    present,
    recording_of,
    say_of_table,
)
from tcc_sim.cli.options import Form, command, keywords_of, of
from tcc_sim.errors import InputError, counted, given_in, require
from tcc_sim.output.terminal import say
from tcc_sim.shown_units import show_in


def targets(text: str) -> float | dict[float, float]:
    """Return the target in `V`, or the targets by time in `T:V,T:V`."""
    try:
        if ":" not in text:
            return float(text)
        pairs = [part.split(":") for part in text.split(",")]
        steps = {float(t): float(value) for t, value in pairs}
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} must be a slip speed in rad/s, or T:V,T:V with times in "
                                         "s") from None
    if len(steps) < len(pairs):
        raise argparse.ArgumentTypeError(f"{text!r} has two targets for one time")
    return steps


def limits(text: str) -> tuple[float, float]:
    """Return the limits in `LOW:HIGH`."""
    try:
        low, high = text.split(":")
        return float(low), float(high)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} must be LOW:HIGH, two pressures in Pa") from None


FORMS = {**FORMS, "recording": Form("RUN|FILE", Path), "discard": Form("CYCLES", int),
         "target": Form("V|T:V,T:V", targets), "limits": Form("LOW:HIGH", limits)}


@command(of(ANALYSIS, FORMS, needed="recording"), partial(
    add_outputs, json="the figures", out="the samples of the analysed run as .csv, .npz, .parquet or .mat, with units "
    "and scene"))
def run(arguments: argparse.Namespace, layout: bool = False) -> int:
    """Check the outputs, analyse the recording, write the files, and print the figures.

    Parameters
    ----------
    layout : write a layout beside the recording, with which Rerun shows its signals without conversion: rerun
        RUN_0.mcap RUN_0.rbl
    """
    from tcc_sim.output.samples import write_samples
    from tcc_sim.output.table_files import TABLES
    from tcc_sim.output.tables import order_lines, spectrum_lines
    from tcc_sim.recording.window import Window
    from tcc_sim.replay.replay import replay
    from tcc_sim.tables.chosen_columns import is_table

    if is_table(arguments.recording):
        return _table(arguments)
    for name in ("columns", "pulses"):
        if getattr(arguments, name) is not None:
            raise InputError(f"--{name} is for tables, and {arguments.recording} is a recording")
    window = Window(arguments.run, arguments.from_, arguments.to)
    check_outputs(arguments, TABLES, arguments.rrd)
    if arguments.rrd is not None or arguments.spawn or arguments.connect is not None:
        require("rerun", "Rerun")
    recording = recording_of(arguments, arguments.recording, arguments.scene)
    show_in(order=recording.scene.system.engine.order)
    if layout:
        from tcc_sim.views.recording_layout import write_layout

        say(f"layout: {write_layout(arguments.recording)}")
    result = replay(recording, window=window, progress=True, **keywords_of(
        arguments, "rrd spawn connect discard frequency verify damping target band limits"))
    lines = result.lines()
    drawn: object = result
    # A manoeuvre is drawn whole, as by `simulate --plot`; any other run by its last cycles and its maxima.
    whole = arguments.plot is not None and result.scene.system.profile is not None
    if arguments.out is not None or arguments.orders or arguments.spectrum or whole:
        samples = recording.trajectory(result.run, arguments.from_, arguments.to)
        drawn = replace(samples, control=result.control) if whole else result
    if arguments.orders or arguments.spectrum:
        from tcc_sim.functions import with_recorded_figures

        result = with_recorded_figures(result, samples, orders=arguments.orders, spectrum=arguments.spectrum)
    if result.orders is not None:
        drawn = result.orders
        lines += order_lines(result.orders)
    if result.spectrum is not None:
        drawn = drawn if arguments.orders else result
        lines += spectrum_lines(result.spectrum)
    if arguments.out is not None:
        write_samples(arguments.out, samples, recording.scene.text(), recorded=True,
                      document=document_of(arguments, result.scene, result))
    plot_result(arguments, drawn, arguments.recording.name)
    present(arguments, result.scene, result, lines)
    return 0 if result.verification is None or result.verification.verified else 1


def _table(arguments: argparse.Namespace) -> int:
    """Print and write orders and spectrum of a table of measurements."""
    from tcc_sim.output.tables import order_lines, spectrum_lines
    from tcc_sim.replay.measured import analyse_table
    from tcc_sim.scene import load_scene
    from tcc_sim.tables.measured_table import table_in

    others = ("rrd", "spawn", "connect", "out", "discard", "frequency", "damping", "verify", "run", "joints",
              "topic", "driveline", "target", "limits")
    given = [f"--{name}" for name in given_in({name: getattr(arguments, name) for name in others})]
    if given:
        raise InputError(f"{', '.join(given)}: only for recordings; a table takes --orders, --spectrum, --columns, "
                         "--from, --to, --scene and --pulses")
    if not (arguments.orders or arguments.spectrum):
        raise InputError("a table needs --orders or --spectrum; give one of them")
    check_outputs(arguments)
    scene = load_scene(arguments.scene or "fig02")
    show_in(order=scene.system.engine.order)
    table = table_in(arguments.recording, ("slip_speed",), columns=arguments.columns)
    result = analyse_table(table.part(arguments.from_, arguments.to), scene.system, orders=arguments.orders,
                           spectrum=arguments.spectrum, pulses=arguments.pulses)
    lines = [f"{arguments.recording}: {counted(result.samples, 'row')} over {result.seconds:.6g} s"]
    say_of_table(result.warnings)
    lines += order_lines(result.orders) if result.orders is not None else []
    lines += spectrum_lines(result.spectrum) if result.spectrum is not None else []
    plot_result(arguments, result.orders or result.spectrum, arguments.recording.name)
    present(arguments, scene, result, lines)
    return 0
