"""`tcc-sim analyse`: figures, JSON and a Rerun stream of a recording, complete or cut short."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from tcc_sim.cli import arguments as common
from tcc_sim.cli.options import Form, command, keywords_of, of, options_in
from tcc_sim.errors import InputError, counted, require
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


FORMS = {**common.FORMS, "recording": Form("RUN|FILE", Path), "discard": Form("CYCLES", int),
         "target": Form("V|T:V,T:V", targets), "limits": Form("LOW:HIGH", limits)}


@command(of(common.ANALYSIS, FORMS, needed="recording"), common.outputs(
    "the figures", "the samples of the analysed run as .csv, .npz, .parquet or .mat, with units and scene"))
def run(arguments: argparse.Namespace, layout: bool = False) -> int:
    """Check the outputs, analyse the recording, write the files, and print the figures.

    Parameters
    ----------
    layout : write a layout beside the recording, with which Rerun shows its signals without conversion: rerun
        RUN_0.mcap RUN_0.rbl
    """
    from tcc_sim.functions import analysis
    from tcc_sim.output.samples import write_samples
    from tcc_sim.output.table_files import TABLES
    from tcc_sim.output.tables import order_lines, spectrum_lines
    from tcc_sim.replay.measured import MeasuredRun
    from tcc_sim.scene import load_scene
    from tcc_sim.tables.chosen_columns import is_table

    path, source = arguments.recording, arguments.recording
    drawn: object
    table = is_table(path)
    for name in ("out", "layout") if table else ("columns", "pulses"):
        if getattr(arguments, name):
            raise InputError(f"--{name} is for recordings, and {path} is a table" if table else
                             f"--{name} is for tables, and {path} is a recording")
    common.check_outputs(arguments, TABLES, arguments.rrd)
    if arguments.rrd is not None or arguments.spawn or arguments.connect is not None:
        require("rerun", "Rerun")
    if not table:
        source = common.recording_of(arguments, path, arguments.scene)
    scene = load_scene(arguments.scene or "fig02") if table else source.scene
    show_in(order=scene.system.engine.order)
    if layout:
        from tcc_sim.views.recording_layout import write_layout

        say(f"layout: {write_layout(path)}")
    result = analysis(source, **keywords_of(arguments, options_in(common.ANALYSIS)), progress=True)
    if isinstance(result, MeasuredRun):
        common.say_of_table(result.warnings)
        lines = [f"{path}: {counted(result.samples, 'row')} over {result.seconds:.6g} s"]
        drawn = result.orders or result.spectrum
    else:
        scene, lines, drawn = result.scene, result.lines(), result if result.orders is None else result.orders
        # A manoeuvre is drawn whole, as by `simulate --plot`; any other run by its last cycles and its maxima.
        whole = arguments.plot is not None and scene.system.profile is not None
        if arguments.out is not None or whole:
            samples = source.trajectory(result.run, arguments.from_, arguments.to)
            if whole and result.orders is None and result.spectrum is None:
                drawn = replace(samples, control=result.control)
        if arguments.out is not None:
            write_samples(arguments.out, samples, source.scene.text(), recorded=True,
                          document=common.document_of(arguments, scene, result))
    lines += order_lines(result.orders) if result.orders is not None else []
    lines += spectrum_lines(result.spectrum) if result.spectrum is not None else []
    common.deliver(arguments, scene, result, lines, shown=drawn)
    return 0 if isinstance(result, MeasuredRun) or result.verification is None or result.verification.verified else 1
