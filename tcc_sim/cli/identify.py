"""`tcc-sim identify`: parameters of a scene from a recording or a table of measurements."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tcc_sim.cli import arguments as common
from tcc_sim.cli.options import Form, command, keywords_of, of, options_in
from tcc_sim.errors import InputError, counted
from tcc_sim.shown_units import speed

if TYPE_CHECKING:
    from tcc_sim.estimation.curve import IdentifiedCurve
    from tcc_sim.estimation.identify import Identification
    from tcc_sim.scene import Scene

IDENTIFY = "tcc_sim.estimation.identify:identify"
WORDS = {"previous": "held from each sample on (--hold previous)", "linear": "linear between samples (--hold linear)",
         "smooth": "linear between corners that keep the amplitudes of sines (--hold smooth)",
         "next": "held up to each sample (--hold next)"}


@command(of(IDENTIFY, {**common.FORMS, "measured": Form("RUN|FILE", Path), "noise": Form("CHANNEL=S,..."),
                       "likelihood": Form("KEY"), "free": Form("KEY[=START]", repeated=True, required=True)},
            needed="measured free"), common.add_changes,
         common.outputs("estimates, residuals and verdicts", "the scene with the estimated values", "SCENE.yaml"))
def run(arguments: argparse.Namespace) -> int:
    """Check the input, fit, write the files, and print the verdicts."""
    from tcc_sim.output.files import draft

    scene, fit = problem_of(arguments)
    common.check_outputs(arguments, [".yaml"])
    result = fit(progress=True)
    common.say_of_table(result.warnings)
    common.deliver(arguments, scene, result, _lines(result))
    if not result.accepted:
        print(f"tcc-sim: no acceptable fit: {result.why}", file=sys.stderr)
        return 1
    if arguments.out is not None:
        with draft(arguments.out) as part:
            part.write_text(result.scene.text(), encoding="utf-8")
    return 0


def problem_of(arguments: argparse.Namespace) -> tuple[Scene, Callable[..., Identification]]:
    """Return the scene and `identify` with every argument but `progress`."""
    from tcc_sim.estimation.identify import given, identify
    from tcc_sim.scene import load_scene, parse_assignments, unused_beside
    from tcc_sim.tables.chosen_columns import is_table

    free: dict[str, float | None] = {}
    for key, start in (_assigned("--free", word) for word in arguments.free):
        if key in free:
            raise InputError(f"--free gives {key} twice")
        free[key] = start
    noise = None
    if arguments.noise is not None:
        noise = {k: math.nan if v is None else v
                 for k, v in (_assigned("--noise", word) for word in arguments.noise.split(","))}
    if is_table(arguments.measured):
        common.refuse_driveline(arguments, f"{arguments.measured} is a table")
    measured, scene = given(arguments.measured, None if arguments.scene is None else load_scene(arguments.scene),
                            arguments.columns, arguments.from_, arguments.to, **common.driveline_of(arguments))
    values = parse_assignments(arguments.set)
    common.refuse_swept(arguments.set, [key for key, start in free.items() if start is not None])
    scene = replace(scene.with_changes(values), notes=unused_beside(values, measured.inputs))
    return scene, partial(identify, measured, free, scene=scene, noise=noise, **keywords_of(arguments, options_in(
        IDENTIFY, f"{common.DRIVELINE} columns from_ to scene noise")))


def _lines(result: Identification) -> Iterator[str]:
    yield (f"{counted(len(result.measurement.t), 'sample')} of {', '.join(result.noise)}; chi-square per degree of "
           f"freedom {result.chi2_per_dof:.4g}, {counted(result.starts, 'start')}, {result.seconds:.3g} s")
    if result.hold is not None:
        yield f"measured inputs fit best as {WORDS[result.hold]}"
    for p in result.parameters:
        yield f"{p.key:>31}  {p.value:<11.6g} +- {p.standard_error:<9.2g} {p.verdict}: {p.why}"
    if result.curve is not None:
        yield from _curve_lines(result.curve)


def _curve_lines(curve: IdentifiedCurve) -> Iterator[str]:
    """Yield the formula of the friction curve and every tenth of its points."""
    from tcc_sim.estimation.curve import not_visited
    from tcc_sim.output.tables import friction_formula

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
