"""`tcc-sim explain`: estimate how a scene behaves, and list the terms of its equations."""

from __future__ import annotations

import argparse
from functools import partial
from typing import Any

from tcc_sim.cli.arguments import add_outputs, add_scene, check_outputs, plot_result, present, scene_of
from tcc_sim.cli.options import command, of
from tcc_sim.errors import counted
from tcc_sim.output.terminal import say


@command(add_scene, of("tcc_sim.functions:explanation"), partial(add_outputs, json="the estimates and terms"))
def run(arguments: argparse.Namespace) -> int:
    """Print the estimates, the terms in use and left out, and the cost of a step."""
    scene = scene_of(arguments)
    check_outputs(arguments)
    from tcc_sim.output.estimates import estimate_lines, estimates_of
    from tcc_sim.output.explanation import closed_form_lines, explained, friction_lines

    explanation = explained(scene, cost=arguments.cost)
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
    plot_result(arguments, scene, scene.name)
    present(arguments, scene, explanation)
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
