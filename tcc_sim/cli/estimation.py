"""`tcc-sim linearise` and `identify`: a transfer function about a settled motion, and parameters from measurements."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tcc_sim.cli import arguments as common
from tcc_sim.cli.options import Form, command, keywords_of, numbers_apart, of, option_of, options_in, reader, spaced
from tcc_sim.errors import InputError, counted, given_in
from tcc_sim.shown_units import frequency, speed

if TYPE_CHECKING:
    from tcc_sim.estimation.identify import Identification
    from tcc_sim.estimation.linearise import Linearisation

LINEARISE, IDENTIFY = "tcc_sim.estimation.linearise:linearise", "tcc_sim.estimation.identify:identify"
SHOWN = 7
"""Number of frequencies printed."""


def _frequencies(text: str) -> list[float]:
    """Return the values of START:STOP:COUNT, evenly in logarithm."""
    try:
        return spaced(text, "--frequencies")
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


@command(common.add_scene, of(LINEARISE, {"frequencies": Form("START:STOP:COUNT", _frequencies),
                                          "controller": Form("KP,KI", reader(
             lambda text: numbers_apart(text, ",", 2), "KP,KI, two numbers above 0"))}),
         common.outputs("operating point, matrices and responses",
                        "the response as .csv or .parquet, with the matrices as .npz or .mat"))
def linearise(arguments: argparse.Namespace) -> None:
    """Give the transfer function from pressure or engine torque about a settled motion.

    example : linearise controlled --slip 20 --controller 3,11.25 --plot bode.png
    prints : operating point, multipliers, gain and phase at seven frequencies, and the margins of a controller
    writes : --json FILE holds all numbers, --out FILE the arrays, --plot FILE a picture
    """
    from tcc_sim.estimation.linearise import linearise as response
    from tcc_sim.output.samples import TABLES

    if arguments.slip is not None:
        common.refuse_swept(arguments.set, ["pressure.mean"])
    scene = common.scene_of(arguments)
    common.check_outputs(arguments, TABLES)
    result = response(scene, **keywords_of(arguments, options_in(LINEARISE)), progress=True)
    common.deliver(arguments, scene, result, _response_lines(result))


def _response_lines(result: Linearisation) -> Iterator[str]:
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
        gain = result.gain[k]  # In SI units of output over input.
        decibels = f"{20.0 * math.log10(gain):9.3f} dB" if gain > 0.0 else "      -inf dB"
        yield f"{frequency(result.frequencies[k], 4):>16}  {decibels}  {math.degrees(result.phase[k]):8.2f} deg"
    loop = result.controller
    if loop is not None:
        yield (f"closed loop with {loop.proportional:g} N m s/rad and {loop.integral:g} N m/rad, a command every "
               f"{1e3 * loop.step:.4g} ms: {'stable' if loop.stable else 'unstable'}, largest multiplier "
               f"{abs(loop.multipliers[0]):.4g}")
        if loop.phase_margin is not None:
            yield f"  phase margin {math.degrees(loop.phase_margin):.4g} deg"
        if loop.stable:
            margin, delay, slip = loop.gain_margin, loop.largest_delay, loop.smallest_stable_slip
            yield "  gain margin " + ("above a factor of 1000" if margin is None else f"a factor of {margin:.4g}")
            yield ("  stable at every tested delay" if delay is None else
                   f"  unstable from a delay of {1e3 * delay:.4g} ms on")
            yield ("  stable down to a tenth of the mean slip speed" if not slip else
                   f"  stable down to a mean slip speed of {speed(slip, 4)}")


WORDS = {"previous": "held from each sample on (--hold previous)", "linear": "linear between samples (--hold linear)",
         "smooth": "linear between corners that keep the amplitudes of sines (--hold smooth)",
         "next": "held up to each sample (--hold next)"}


@command(of(IDENTIFY, {**common.FORMS, "measured": Form("RUN|FILE", Path), "noise": Form("CHANNEL=S,..."),
                       "likelihood": Form("KEY"), "free": Form("KEY[=START]", repeated=True, required=True)},
            needed="measured free"), common.add_changes,
         common.outputs("estimates, residuals and verdicts", "the scene with the estimated values", "SCENE.yaml"))
def identify(arguments: argparse.Namespace) -> int:
    """Estimate parameters of a scene from a recording or a table of measurements.

    example : identify run1 --free friction.kinetic_coefficient --out mine.yaml --plot fit.png
    prints : value, standard error and verdict for each free key
    writes : --json FILE holds all numbers, --out FILE the scene with the estimated values, --plot FILE a picture
    """
    from tcc_sim.estimation.identify import given
    from tcc_sim.estimation.identify import identify as fit
    from tcc_sim.output.files import draft
    from tcc_sim.scene import load_scene, parse_assignments, unused_beside
    from tcc_sim.tables.chosen_columns import is_table

    free: dict[str, float | None] = {}
    for key, start in (_assigned("--free", word) for word in arguments.free):
        if key in free:
            raise InputError(f"--free gives {key} twice")
        free[key] = start
    noise = None if arguments.noise is None else {
        k: math.nan if v is None else v for k, v in (_assigned("--noise", word) for word in arguments.noise.split(","))}
    driveline = keywords_of(arguments, common.DRIVELINE)
    if is_table(arguments.measured) and (wrong := given_in(driveline)):
        raise InputError(f"{', '.join(map(option_of, wrong))}: only for recordings; {arguments.measured} is a table")
    measured, scene = given(arguments.measured, None if arguments.scene is None else load_scene(arguments.scene),
                            arguments.columns, arguments.from_, arguments.to, **driveline)
    values = parse_assignments(arguments.set)
    common.refuse_swept(arguments.set, [key for key, start in free.items() if start is not None])
    scene = replace(scene.with_changes(values), notes=unused_beside(values, measured.inputs))
    common.check_outputs(arguments, [".yaml"])
    result = fit(measured, free, scene=scene, noise=noise, progress=True, **keywords_of(arguments, options_in(
        IDENTIFY, f"{common.DRIVELINE} columns from_ to scene noise")))
    common.say_of_table(result.warnings)

    def write(_: dict[str, Any]) -> None:
        if result.accepted:
            with draft(arguments.out) as part:
                part.write_text(result.scene.text(), encoding="utf-8")

    common.deliver(arguments, scene, result, _estimate_lines(result), write=write)
    if not result.accepted:
        print(f"tcc-sim: no acceptable fit: {result.why}", file=sys.stderr)
    return 0 if result.accepted else 1


def _estimate_lines(result: Identification) -> Iterator[str]:
    from tcc_sim.estimation.curve import not_visited
    from tcc_sim.output.tables import friction_formula

    yield (f"{counted(len(result.measurement.t), 'sample')} of {', '.join(result.noise)}; chi-square per degree of "
           f"freedom {result.chi2_per_dof:.4g}, {counted(result.starts, 'start')}, {result.seconds:.3g} s")
    if result.hold is not None:
        yield f"measured inputs fit best as {WORDS[result.hold]}"
    for p in result.parameters:
        yield f"{p.key:>31}  {p.value:<11.6g} +- {p.standard_error:<9.2g} {p.verdict}: {p.why}"
    curve = result.curve
    if curve is not None:
        yield f"sliding friction: {friction_formula(curve.constant, curve.amplitudes, curve.rates)}"
        yield "      slip speed  coefficient, 95 % band"
        for k in range(0, len(curve.slip_speeds), 10):
            shown = (f"{curve.coefficient[k]:.5f}, {curve.low[k]:.5f} to {curve.high[k]:.5f}" if curve.visited[k] else
                     "not visited")
            yield f"{speed(curve.slip_speeds[k], 4):>16}  {shown}; the scene has {curve.scene[k]:.5f}"
        gaps = (f"{speed(low, 4)} to {speed(high, 4)}" for low, high in not_visited(curve.slip_speeds, curve.visited))
        yield f"not visited: slip speeds {', '.join(gaps)}"


def _assigned(option: str, word: str) -> tuple[str, float | None]:
    """Return the key and the number of KEY=NUMBER; None for a key alone."""
    key, equals, text = word.partition("=")
    if not equals:
        return key, None
    try:
        return key, float(text)
    except ValueError:
        raise InputError(f"{option} is {word!r}; {text!r} is not a number") from None
