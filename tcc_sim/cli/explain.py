"""`tcc-sim explain`: how a scene will behave, what it builds and what it leaves out."""

from __future__ import annotations

import argparse
from typing import Any

from tcc_sim.cli.arguments import add_outputs, add_scene, check_outputs, plot_result, present, scene_of
from tcc_sim.errors import counted
from tcc_sim.output.terminal import say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The scene and where the answer goes."""
    add_scene(parser)
    parser.add_argument("--cost", action="store_true", help="measure what a tick of the real-time solver costs, what "
                        "each of its terms adds, and what those that are left out save; this compiles a kernel for "
                        "every term")
    add_outputs(parser, "the answer")


def run(arguments: argparse.Namespace) -> int:
    """Print how the scene will behave, then what is held and left out, and what a step costs."""
    scene = scene_of(arguments)
    check_outputs(arguments)
    from tcc_sim.output.estimates import estimate_lines, estimates_of
    from tcc_sim.output.explanation import closed_form_lines, explained, friction_lines

    explanation = explained(scene, cost=arguments.cost)
    found = explanation.as_json()
    say(f"{found['name']}: {found['description']}")
    say("\n".join([*estimate_lines(estimates_of(scene.system)), *friction_lines(found["friction"]),
                   *closed_form_lines(found["closed_forms"])]))
    say(f"solver offline: {found['solver']}")
    for what in ("terms", "topics", "modules"):
        say(f"{what}\n  held:     {', '.join(found[what]['held']) or 'none'}"
            f"\n  left out: {', '.join(found[what]['left_out']) or 'none'}")
    say("kernel arguments\n  " + "; ".join(f"{name}: {kind}" for name, kind in found["kernel"].items()))
    _say_step(found["step"], arguments.cost)
    plot_result(arguments, scene, scene.name)
    present(arguments, scene, explanation)
    return 0


def _say_step(step: dict[str, Any] | None, cost: bool) -> None:
    """Print the sub-steps, calls and, where it was measured, the cost of a tick."""
    if step is None:
        say("real-time step: none, the real-time solver takes the smoothed law only")
        return
    say(f"real-time step: {counted(step['sub_steps'], 'sub-step')} in a tick of {step['tick_s'] * 1e3:g} ms")
    if cost:
        say(f"  a tick costs {step['own_s'] * 1e6:.2f} us; with every term on {step['general_s'] * 1e6:.2f} us, "
            f"{step['ratio']:.2f} times as much")
        for verb, terms in (("costs", step["terms_s"]), ("left out, saves", step["saved_s"])):
            for name, seconds in terms.items():
                amount = "below what can be measured" if seconds is None else (
                    f"{seconds * 1e6:.2f} us, {100.0 * seconds / step['own_s']:.0f} %")
                say(f"  {name} {verb}: {amount}")
        say(f"  noise of these figures: {step['noise_s'] * 1e6:.2f} us")
    for name, own in step["own_calls"].items():
        say(f"  {name} a sub-step: {own:.3g}; with every term on {step['general_calls'][name]:.3g}")
