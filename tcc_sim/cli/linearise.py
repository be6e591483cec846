"""`tcc-sim linearise`: the transfer function from pressure or engine torque, about a settled motion."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from tcc_sim.cli import arguments as common
from tcc_sim.cli.options import Form, command, keywords_of, of, options_in
from tcc_sim.cli.ranges import spaced
from tcc_sim.errors import InputError, counted
from tcc_sim.shown_units import frequency, speed

if TYPE_CHECKING:
    from tcc_sim.estimation.linearise import Linearisation
    from tcc_sim.estimation.slip_loop import SlipLoop

LINEARISE = "tcc_sim.estimation.linearise:linearise"
SHOWN = 7
"""Number of frequencies printed."""


def gains(text: str) -> tuple[float, float]:
    """Return the two gains KP,KI."""
    try:
        proportional, integral = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} must be KP,KI, two numbers above 0") from None
    return proportional, integral


def frequencies(text: str) -> list[float]:
    """Return the values of START:STOP:COUNT, evenly in logarithm."""
    try:
        return spaced(text, "--frequencies")
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


@command(common.add_scene, of(LINEARISE, {"frequencies": Form("START:STOP:COUNT", frequencies),
                                          "controller": Form("KP,KI", gains)}),
         common.outputs("operating point, matrices and responses",
                        "the response as .csv or .parquet, with the matrices as .npz or .mat"))
def run(arguments: argparse.Namespace) -> int:
    """Check the input, linearise, write the files, and print the result."""
    from tcc_sim.estimation.linearise import linearise
    from tcc_sim.output.table_files import TABLES

    if arguments.slip is not None:
        common.refuse_swept(arguments.set, ["pressure.mean"])
    scene = common.scene_of(arguments)
    common.check_outputs(arguments, TABLES)
    result = linearise(scene, **keywords_of(arguments, options_in(LINEARISE)), progress=True)
    common.deliver(arguments, scene, result, _lines(result), columns=result.columns(), arrays=result.arrays())
    return 0


def _lines(result: Linearisation) -> Iterator[str]:
    if result.kind == "periodic":
        kind = f"a periodic motion of {counted(result.period, 'period')} of excitation"
    else:
        kind = f"constant {result.kind}"
    yield (f"from {result.input} to {result.output} about {kind}: mean slip {speed(result.mean_slip)}, pressure "
           f"{result.pressure:.8g} Pa, engine torque {result.engine_torque:.6g} N m")
    yield ("A, B, C, D are continuous" if result.dt == 0.0 else
           f"A, B, C, D are discrete with dt {result.dt:.6g} s, one period; the output is the mean over a period")
    words = ", ".join(f"{z.real:.4g}{f'{z.imag:+.4g}i' if abs(z.imag) > 1e-12 else ''}" for z in result.multipliers)
    yield f"multipliers {words}"
    for k in np.unique(np.round(np.linspace(0, len(result.frequencies) - 1, SHOWN)).astype(int)):
        yield (f"{frequency(result.frequencies[k], 4):>16}  {_decibels(result.gain[k])}  "
               f"{math.degrees(result.phase[k]):8.2f} deg")
    if result.controller is not None:
        yield from _loop_lines(result.controller)


def _loop_lines(loop: SlipLoop) -> Iterator[str]:
    """Yield lines for stability and margins of the loop with the slip controller."""
    yield (f"closed loop with {loop.proportional:g} N m s/rad and {loop.integral:g} N m/rad, a command every "
           f"{1e3 * loop.step:.4g} ms: {'stable' if loop.stable else 'unstable'}, largest multiplier "
           f"{abs(loop.multipliers[0]):.4g}")
    if loop.phase_margin is not None:
        yield f"  phase margin {math.degrees(loop.phase_margin):.4g} deg"
    if loop.stable:
        gain, delay, slip = loop.gain_margin, loop.largest_delay, loop.smallest_stable_slip
        yield "  gain margin " + ("above a factor of 1000" if gain is None else f"a factor of {gain:.4g}")
        yield ("  stable at every tested delay" if delay is None else
               f"  unstable from a delay of {1e3 * delay:.4g} ms on")
        yield ("  stable down to a tenth of the mean slip speed" if not slip else
               f"  stable down to a mean slip speed of {speed(slip, 4)}")


def _decibels(gain: float) -> str:
    """Return a gain in dB, relative to 1 in SI units of output over input."""
    return f"{20.0 * math.log10(gain):9.3f} dB" if gain > 0.0 else "      -inf dB"
