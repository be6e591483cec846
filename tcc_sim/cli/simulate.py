"""`tcc-sim simulate`: solve a scene offline and summarise its steady state."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from tcc_sim.background import awaited
from tcc_sim.cli import arguments as common
from tcc_sim.cli.options import command, of, option_of
from tcc_sim.errors import InputError, counted

if TYPE_CHECKING:
    from tcc_sim.replay.recorded import Recording
    from tcc_sim.tables.measured_table import MeasuredTable

Result = TypeVar("Result")
SAMPLES, LARGEST_OUTPUT = 200, 50_000_000
DRAWN, MOST_DRAWN = 2000, 400_000
"""Samples per period of excitation of a run that is drawn but not written, a multiple of SAMPLES; fewer where there
would be more than MOST_DRAWN, and none where SAMPLES of them would be more than LARGEST_OUTPUT.
"""


@command(common.add_scene, of(common.SIMULATION, common.FORMS), of(common.PLAN, common.FORMS, without=common.OF_SWEEPS),
         common.outputs("the summary", "the samples: .npz, .csv, .parquet, .mat or .mcap"))
def run(arguments: argparse.Namespace, samples: int = 200) -> int:
    """Check the input, solve, write the files, and print the summary.

    Parameters
    ----------
    samples : samples per period of excitation in --out
    """
    from tcc_sim.analysis.measured.orders import OrderComparison
    from tcc_sim.output.samples import SUFFIXES, write_samples
    from tcc_sim.output.tables import comparison_lines, order_lines, simulation_lines, spectrum_lines
    from tcc_sim.scene import parse_assignments, parse_profiles
    from tcc_sim.sweeps.simulation import simulate

    profiles = parse_profiles(arguments.profile)
    scene, measured, table = common.scene_of(arguments, profiles), None, None
    if arguments.inputs is None:
        common.refuse_driveline(arguments, "give the recording with --inputs")
    if arguments.inputs is not None:
        from tcc_sim.functions import driven_scene
        from tcc_sim.tables.measured_table import MeasuredTable

        source = inputs_of(arguments)
        table = source if isinstance(source, MeasuredTable) else None
        scene, measured = driven_scene(scene, source, arguments.hold, arguments.orders, arguments.pulses,
                                       {**parse_assignments(arguments.set), **profiles})
    elif arguments.inputs_scene is not None:
        raise InputError("--scene is for a recording without a scene; give the recording with --inputs")
    for name in ("hold", "columns", "from_", "to", "pulses"):
        if getattr(arguments, name) is not None and arguments.inputs is None:
            raise InputError(f"{option_of(name)} is for the inputs of a table; give the table with --inputs")
    if arguments.spectrum:
        scene.system.check_repeats("a spectrum")
    plan = common.plan_of(arguments)
    cycle, duration = scene.system.cycle, plan.seconds(scene.system)
    common.check_outputs(arguments, SUFFIXES)
    cycles = plan.most if duration is None else duration / cycle
    _check_samples(arguments, cycles)
    sampled = arguments.orders or arguments.inputs is not None or cycles < 1.0 - 1e-12
    samples = arguments.samples if arguments.out is not None else SAMPLES if sampled else 0
    further = arguments.out is not None or arguments.orders or arguments.inputs is not None
    if arguments.plot is not None and not further and SAMPLES * cycles <= LARGEST_OUTPUT:
        samples = SAMPLES * min(max(int(MOST_DRAWN / cycles) // SAMPLES, 1), DRAWN // SAMPLES)
    result = awaited(lambda: simulate(
        scene, plan, samples_per_cycle=samples,
        flywheel_angle=arguments.out is not None and arguments.out.suffix == ".mcap")).raise_for_status()
    if table is not None or arguments.orders or arguments.spectrum:
        from tcc_sim.functions import with_figures

        result = with_figures(result, scene, table, measured, orders=arguments.orders, spectrum=arguments.spectrum)
    lines = simulation_lines(scene.name, result)
    drawn: object = result
    if arguments.inputs is not None:
        from tcc_sim.replay.given_inputs import smooth_inputs, twin_of

        common.say_of_table(result.notes)
        if table is not None and arguments.hold is None and (smooth := smooth_inputs(table)):
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
        drawn = result if not arguments.orders and arguments.inputs is None else drawn
        lines += spectrum_lines(result.spectrum)
    if arguments.out is not None:
        write_samples(arguments.out, result.trajectory, scene.text(),
                      document=common.document_of(arguments, scene, result))
        lines.append(f"{counted(len(result.trajectory.t), 'sample')} in {arguments.out}")
    if arguments.plot is not None:
        lines.append(f"picture in {arguments.plot}")
    common.deliver(arguments, scene, result, lines, drawn=drawn)
    return 0


def inputs_of(arguments: argparse.Namespace) -> MeasuredTable | Recording:
    """Return the table or the recording of --inputs."""
    from tcc_sim.replay.given_inputs import input_table

    inputs: Path = arguments.inputs
    table = input_table(inputs, arguments.columns, arguments.from_, arguments.to)
    if table is not None:
        common.refuse_driveline(arguments, f"{inputs} is a table")
        return table
    return common.recording_of(arguments, inputs, arguments.inputs_scene)


def _check_samples(arguments: argparse.Namespace, cycles: float) -> None:
    """Raise InputError for a number of samples per cycle out of range, or for too many samples in a file."""
    if not 1 <= arguments.samples <= 1_000_000:
        raise InputError(f"--samples is {arguments.samples}; it must be 1 to 1000000 per period of excitation")
    samples = cycles * arguments.samples
    if arguments.out is not None and samples > LARGEST_OUTPUT:
        raise InputError(f"--out would hold {samples:.3g} samples; it must be at most {LARGEST_OUTPUT:g}")
