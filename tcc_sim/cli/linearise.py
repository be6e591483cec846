"""`tcc-sim linearise`: the transfer function from pressure or engine torque, about a settled motion."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from tcc_sim.cli.arguments import add_outputs, add_scene, check_outputs, plot_result, present, scene_of, spaced
from tcc_sim.errors import counted

if TYPE_CHECKING:
    from tcc_sim.estimation.linearise import Linearisation

INPUTS, OUTPUTS = ("actuation_pressure", "engine_torque"), ("slip_speed", "friction_torque", "shaft_torque")
SHOWN = 7
"""Frequencies that are printed."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What is linearised, about which motion, and where the results go."""
    add_scene(parser)
    parser.add_argument("--input", choices=INPUTS, default=INPUTS[0], help=f"what is changed (default {INPUTS[0]})")
    parser.add_argument("--output", choices=OUTPUTS, default=OUTPUTS[0], help=f"what answers (default {OUTPUTS[0]})")
    parser.add_argument("--slip", metavar="V", type=float,
                        help="mean slip speed, rad/s; the pressure that gives it is found (default: the scene's "
                        "pressure)")
    parser.add_argument("--frequencies", metavar="START:STOP:COUNT",
                        help="rad/s, evenly in logarithm (default: 240 from 2 to three times the slipping mode)")
    parser.add_argument("--mean", action="store_true",
                        help="leave out the excitation: torque and pressure are their means, and A, B, C, D continuous")
    parser.add_argument("--check", metavar="N", type=int, default=0,
                        help="find the response by simulation at N of the frequencies too")
    add_outputs(parser, "everything that was found", "the arrays: .npz")


def run(arguments: argparse.Namespace) -> int:
    """Check everything, linearise, write what was asked for, and print the result."""
    from tcc_sim.estimation.linearise import linearise
    from tcc_sim.output.files import draft
    from tcc_sim.sweeps.executors import progress_bar

    scene = scene_of(arguments)
    frequencies = None if arguments.frequencies is None else spaced(arguments.frequencies, "--frequencies")
    check_outputs(arguments, [".npz"])
    with progress_bar("point", arguments.check or None) as bar:
        found = linearise(scene, input=arguments.input, output=arguments.output, slip=arguments.slip,
                          frequencies=frequencies, check=arguments.check, mean=arguments.mean,
                          tick=bar.update)
    if arguments.out is not None:
        with draft(arguments.out) as part, open(part, "wb") as file:
            np.savez(file, **found.arrays())  # type: ignore[arg-type]
    plot_result(arguments, found, scene.name)
    present(arguments, scene, found.as_json, _lines(found))
    return 0


def _lines(found: Linearisation) -> Iterator[str]:
    """The motion, and the response at some frequencies."""
    if found.kind == "periodic":
        kind = f"a periodic motion of {counted(found.period, 'engine cycle')}"
    else:
        kind = f"constant {found.kind}"
    yield (f"{found.output} by {found.input} about {kind}: mean slip {found.mean_slip:.6g} rad/s, pressure "
           f"{found.pressure:.8g} Pa, engine torque {found.engine_torque:.6g} N m")
    yield ("A, B, C, D are continuous" if found.dt == 0.0 else
           f"A, B, C, D are those of one period, dt {found.dt:.6g} s; the output is the mean over it")
    words = ", ".join(f"{z.real:.4g}{f'{z.imag:+.4g}i' if abs(z.imag) > 1e-12 else ''}" for z in found.multipliers)
    yield f"multipliers {words}"
    for k in np.unique(np.round(np.linspace(0, len(found.frequencies) - 1, SHOWN)).astype(int)):
        yield f"{found.frequencies[k]:10.4g} rad/s  {_decibels(found.gain[k])}  {math.degrees(found.phase[k]):8.2f} deg"
    for point in found.checked:
        yield f"simulated at {point.frequency:.4g} rad/s  {_decibels(point.gain)}  {math.degrees(point.phase):8.2f} deg"


def _decibels(gain: float) -> str:
    """A gain in dB, re the SI units of output over input."""
    return f"{20.0 * math.log10(gain):9.3f} dB" if gain > 0.0 else "      -inf dB"
