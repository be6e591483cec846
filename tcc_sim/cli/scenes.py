"""`tcc-sim scenes` and `tcc-sim explain`: list and print scenes, and estimate how one behaves."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from tcc_sim.cli import arguments as common
from tcc_sim.cli.options import command, keywords_of, of, options_in
from tcc_sim.errors import InputError, counted
from tcc_sim.output.terminal import say
from tcc_sim.parameter_file import description_in
from tcc_sim.scene import bundled_scenes, load_scene, parse_assignments

EXPLANATION = "tcc_sim.functions:explanation"


@command(common.add_changes)
def scenes(arguments: argparse.Namespace, show: str | None = None) -> int:
    """List the bundled scenes.

    example : scenes --show fig02
    prints : name and description of each scene; with --show the parameter file of one scene
    writes : no file; scenes --show fig02 > mine.yaml makes a scene to edit
    show : print this scene (or a file) as a parameter file with every key
    """
    if show is not None:
        sys.stdout.write(load_scene(show).with_changes(parse_assignments(arguments.set)).text())
        return 0
    if arguments.set:
        raise InputError("--set changes the scene that --show prints; give --show NAME too")
    bundled = bundled_scenes()
    width = max(map(len, bundled), default=0)
    for name, path in bundled.items():
        say(f"{name:<{width}}  {description_in(path.read_text(encoding='utf-8'))}")
    return 0


@command(common.add_scene, of(EXPLANATION), common.outputs("the estimates and terms"))
def explain(arguments: argparse.Namespace) -> int:
    """Estimate how a scene behaves, and list the terms of its equations.

    example : explain fig02
    prints : natural frequencies, torques, critical slope, friction law, closed forms, terms in use and left out
    writes : --json FILE holds all numbers, --plot FILE a picture of the friction law
    """
    scene = common.scene_of(arguments)
    common.check_outputs(arguments)
    from tcc_sim.output.estimates import estimate_lines, estimates_of
    from tcc_sim.output.explanation import closed_form_lines, explained, friction_lines

    explanation = explained(scene, **keywords_of(arguments, options_in(EXPLANATION)))
    document = explanation.as_json()
    say(f"{document['name']}: {document['description']}")
    say("\n".join([*estimate_lines(estimates_of(scene.system)), *friction_lines(document["friction"]),
                   *closed_form_lines(document["closed_forms"])]))
    torque = "published" if scene.operation.publish_shaft_torque else "not published (publish_shaft_torque)"
    say(f"far end of the shaft: still, until output_speed moves it; shaft_torque is {torque}")
    say(f"solver offline: {document['solver']}")
    for what in ("terms", "topics", "modules") if arguments.cost else ("terms",):
        say(f"{what}\n  in use:   {', '.join(document[what]['held']) or 'none'}"
            f"\n  left out: {', '.join(document[what]['left_out']) or 'none'}")
    if arguments.cost:
        say("kernel arguments\n  " + "; ".join(f"{name}: {kind}" for name, kind in document["kernel"].items()))
    _say_step(document["step"], arguments.cost)
    common.deliver(arguments, scene, explanation, shown=scene)
    return 0


def _say_step(step: dict[str, Any] | None, cost: bool) -> None:
    """Print the sub-steps, calls and, if `cost`, the measured run time of a tick."""
    if step is None:
        say("real-time step: none; the real-time solver needs friction.law smoothed")
        return
    say(f"real-time step: {counted(step['sub_steps'], 'sub-step')} in a tick of {step['tick_s'] * 1e3:g} ms")
    if cost:
        say(f"  run time of a tick: {step['own_s'] * 1e6:.2f} us; with all terms {step['general_s'] * 1e6:.2f} us, "
            f"{step['ratio']:.2f} times as long")
        for verb, terms in (("takes", step["terms_s"]), ("is left out and saves", step["saved_s"])):
            for name, seconds in terms.items():
                amount = "less than the noise" if seconds is None else (
                    f"{seconds * 1e6:.2f} us, {100.0 * seconds / step['own_s']:.0f} %")
                say(f"  {name} {verb} {amount}")
        say(f"  noise of these times: {step['noise_s'] * 1e6:.2f} us")
    for name, calls in step["own_calls"].items():
        say(f"  {name} per sub-step: {calls:.3g}; with all terms {step['general_calls'][name]:.3g}")
