"""`tcc-sim simulate` and `analyse`: figures and files of a motion that is solved, and of a recording or a table."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from tcc_sim.background import awaited
from tcc_sim.cli import arguments as common
from tcc_sim.cli.options import Form, command, keywords_of, of, options_in
from tcc_sim.errors import InputError, counted, require
from tcc_sim.output.terminal import say
from tcc_sim.shown_units import show_in

if TYPE_CHECKING:
    from tcc_sim.replay.recorded import Recording
    from tcc_sim.scene import Scene
    from tcc_sim.tables.measured_table import MeasuredTable

SAMPLES, LARGEST_OUTPUT = 200, 50_000_000
DRAWN, MOST_DRAWN = 2000, 400_000
"""Samples per period of excitation of a run that is drawn but not written, a multiple of SAMPLES; fewer where there
would be more than MOST_DRAWN, and none where SAMPLES of them would be more than LARGEST_OUTPUT.
"""


@command(common.add_scene, of(common.SIMULATION, common.FORMS), of(common.PLAN, common.FORMS, without=common.OF_SWEEPS),
         common.outputs("the summary", "the samples: .npz, .csv, .parquet, .mat or .mcap"))
def simulate(arguments: argparse.Namespace, samples: int = 200) -> None:
    """Solve a scene and summarise its steady state.

    example : simulate fig02 --plot fig02.png
    prints : largest slip speed, regime, period, section points, heat and shaft torque, and the figures asked for
    writes : --json FILE holds all numbers, --out FILE the samples, --plot FILE a picture
    samples : samples per period of excitation in --out
    """
    from tcc_sim.analysis.measured.orders import OrderComparison
    from tcc_sim.functions import simulation
    from tcc_sim.output.samples import SUFFIXES, write_samples
    from tcc_sim.output.tables import comparison_lines, order_lines, simulation_lines, spectrum_lines
    from tcc_sim.scene import parse_assignments
    from tcc_sim.tables.measured_table import MeasuredTable

    plan = common.plan_of(arguments)
    solved: list[tuple[Scene, MeasuredTable | Recording | None]] = []

    def ready(scene: Scene, source: MeasuredTable | Recording | None) -> int:
        """Check the outputs of the run that is to be solved, and return its samples per cycle."""
        solved.append((scene, source))
        if source is not None and not isinstance(source, MeasuredTable):
            common.say_of_own_scene(source, arguments.inputs_scene)
        common.check_outputs(arguments, SUFFIXES)
        duration = plan.seconds(scene.system)
        cycles = plan.most if duration is None else duration / scene.system.cycle
        _check_samples(arguments, cycles)
        sampled = arguments.orders or source is not None
        if arguments.out is not None:
            return samples
        if arguments.plot is not None and not sampled and SAMPLES * cycles <= LARGEST_OUTPUT:
            return SAMPLES * min(max(int(MOST_DRAWN / cycles) // SAMPLES, 1), DRAWN // SAMPLES)
        return SAMPLES if sampled or cycles < 1.0 - 1e-12 else 0

    result = awaited(lambda: simulation(
        arguments.scene, plan, set=parse_assignments(arguments.set), ready=ready,
        flywheel_angle=arguments.out is not None and arguments.out.suffix == ".mcap",
        **keywords_of(arguments, options_in(common.SIMULATION)))).raise_for_status()
    (scene, source), = solved
    show_in(order=scene.system.engine.order)
    lines = simulation_lines(scene.name, result)
    drawn: object = result
    if source is not None:
        from tcc_sim.replay.given_inputs import smooth_inputs, twin_of

        common.say_of_table(result.notes)
        if isinstance(source, MeasuredTable) and arguments.hold is None and (smooth := smooth_inputs(source)):
            lines.append(f"note: {' and '.join(smooth)} of {arguments.inputs.name} changes smoothly from row to row "
                         "but is held constant between rows; --hold smooth joins the rows")
        twin = twin_of(source, result.trajectory)
        if twin is not None:
            drawn = twin
            lines.append(str(twin))
    if result.orders is not None:
        drawn = result.orders
        if result.measured_orders is not None:
            drawn = OrderComparison(result.measured_orders, result.orders)
            lines += comparison_lines(drawn)
        lines += order_lines(result.orders)
    if result.spectrum is not None:
        drawn = result if not arguments.orders and source is None else drawn
        lines += spectrum_lines(result.spectrum)
    if arguments.out is not None:
        lines.append(f"{counted(len(result.trajectory.t), 'sample')} in {arguments.out}")
    common.deliver(arguments, scene, result, lines, shown=drawn, write=lambda document: write_samples(
        arguments.out, result.trajectory, scene.text(), document=document))


def _check_samples(arguments: argparse.Namespace, cycles: float) -> None:
    """Raise InputError for a number of samples per cycle out of range or without a file, or for too many in it."""
    if not 1 <= arguments.samples <= 1_000_000:
        raise InputError(f"--samples is {arguments.samples}; it must be 1 to 1000000 per period of excitation")
    common.check_used(arguments, {"samples": (SAMPLES, ("out",))})
    samples = cycles * arguments.samples
    if arguments.out is not None and samples > LARGEST_OUTPUT:
        raise InputError(f"--out would hold {samples:.3g} samples; it must be at most {LARGEST_OUTPUT:g}")


@command(of(common.ANALYSIS, {**common.FORMS, "recording": Form("RUN|FILE", Path), "discard": Form("CYCLES", int)},
            needed="recording"), common.outputs(
    "the figures", "the samples of the analysed run as .csv, .npz, .parquet or .mat, with units and scene"))
def analyse(arguments: argparse.Namespace, layout: bool = False) -> int:
    """Summarise a recording, show it in Rerun, solve it again.

    example : analyse run1 --verify --plot run1.png
    prints : contents and losses of the recording, the summary of its motion, and the figures asked for
    writes : --json FILE holds all numbers, --out FILE the samples, --rrd FILE a Rerun recording, --plot FILE a picture
    layout : write a layout beside the recording, with which Rerun shows its signals without conversion: rerun
        RUN_0.mcap RUN_0.rbl
    """
    from tcc_sim.functions import analysis
    from tcc_sim.output.samples import TABLES, write_samples
    from tcc_sim.output.tables import order_lines, spectrum_lines
    from tcc_sim.replay.measured import MeasuredRun
    from tcc_sim.replay.recorded import read
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
        source = read(path, arguments.scene, **keywords_of(arguments, common.DRIVELINE))
        common.say_of_own_scene(source, arguments.scene)
    scene = load_scene(arguments.scene or "fig02") if table else source.scene
    show_in(order=scene.system.engine.order)
    if layout:
        from tcc_sim.views.rerun_layout import write_layout

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
    lines += order_lines(result.orders) if result.orders is not None else []
    lines += spectrum_lines(result.spectrum) if result.spectrum is not None else []
    common.deliver(arguments, scene, result, lines, shown=drawn, write=lambda document: write_samples(
        arguments.out, samples, source.scene.text(), recorded=True, document=document))
    return 0 if isinstance(result, MeasuredRun) or result.verification is None or result.verification.verified else 1
