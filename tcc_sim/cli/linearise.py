"""`tcc-sim linearise`: the transfer function from pressure or engine torque, about a settled motion."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from tcc_sim.cli.arguments import (
    add_outputs,
    add_scene,
    check_outputs,
    document_of,
    plot_result,
    present,
    scene_of,
    spaced,
)
from tcc_sim.errors import InputError, counted

if TYPE_CHECKING:
    from tcc_sim.estimation.linearise import Linearisation
    from tcc_sim.estimation.slip_loop import SlipLoop

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
    parser.add_argument("--controller", metavar="KP,KI",
                        help="judge the loop that the package's slip controller closes with the gains KP (N m s/rad) "
                        "and KI (N m/rad): stability, margins, largest delay, smallest stable slip")
    parser.add_argument("--check", metavar="N", type=int, default=0,
                        help="find the response by simulation at N of the frequencies too")
    add_outputs(parser, "everything that was found", "the arrays: .npz")


def run(arguments: argparse.Namespace) -> int:
    """Check everything, linearise, write what was asked for, and print the result."""
    from tcc_sim.estimation.linearise import linearise
    from tcc_sim.output.files import draft
    from tcc_sim.output.samples import documented
    from tcc_sim.sweeps.progress import progress_bar

    scene = scene_of(arguments)
    frequencies = None if arguments.frequencies is None else spaced(arguments.frequencies, "--frequencies")
    controller = None if arguments.controller is None else _gains(arguments.controller)
    check_outputs(arguments, [".npz"])
    with progress_bar("point", arguments.check or None) as bar:
        found = linearise(scene, input=arguments.input, output=arguments.output, slip=arguments.slip,
                          frequencies=frequencies, check=arguments.check, mean=arguments.mean,
                          controller=controller, tick=bar.update)
    if arguments.out is not None:
        with draft(arguments.out) as part, open(part, "wb") as file:
            said = documented(document_of(arguments, scene, found))
            np.savez(file, **found.arrays(), **said)  # type: ignore[arg-type]
    plot_result(arguments, found, scene.name)
    present(arguments, scene, found, _lines(found))
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
    if found.controller is not None:
        yield from _loop_lines(found.controller)
    for point in found.checked:
        yield f"simulated at {point.frequency:.4g} rad/s  {_decibels(point.gain)}  {math.degrees(point.phase):8.2f} deg"


def _loop_lines(loop: SlipLoop) -> Iterator[str]:
    """What the slip controller makes of the motion."""
    yield (f"closed loop with {loop.proportional:g} N m s/rad and {loop.integral:g} N m/rad, a command every "
           f"{1e3 * loop.step:.4g} ms: {'stable' if loop.stable else 'unstable'}, largest multiplier "
           f"{abs(loop.multipliers[0]):.4g}")
    if loop.phase_margin is not None:
        yield f"  phase margin {math.degrees(loop.phase_margin):.4g} deg"
    if loop.stable:
        gain, delay, slip = loop.gain_margin, loop.largest_delay, loop.smallest_stable_slip
        yield "  gain margin " + ("above a factor of 1000" if gain is None else f"a factor of {gain:.4g}")
        yield "  unstable with " + ("no delay that was tried" if delay is None else f"a delay of {1e3 * delay:.4g} ms")
        yield ("  stable down to a tenth of the mean slip speed" if not slip else
               f"  stable down to a mean slip speed of {slip:.4g} rad/s")


def _gains(text: str) -> tuple[float, float]:
    """The two gains of --controller KP,KI."""
    try:
        proportional, integral = map(float, text.split(","))
    except ValueError:
        raise InputError(f"--controller is {text!r}; it must be KP,KI, two numbers above 0") from None
    return proportional, integral


def _decibels(gain: float) -> str:
    """A gain in dB, re the SI units of output over input."""
    return f"{20.0 * math.log10(gain):9.3f} dB" if gain > 0.0 else "      -inf dB"
