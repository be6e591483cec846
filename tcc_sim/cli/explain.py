"""`tcc-sim explain`: what a scene builds and what it leaves out."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcc_sim.cli.arguments import add_scene, new_file, present, scene_of
from tcc_sim.errors import counted
from tcc_sim.output.terminal import say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The scene and where the answer goes."""
    add_scene(parser)
    parser.add_argument("--cost", action="store_true", help="measure what a tick of the real-time solver and each of "
                        "its terms cost; this compiles a kernel for every term")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the answer here")


def run(arguments: argparse.Namespace) -> int:
    """Print what is held and left out, and what a step costs."""
    scene = scene_of(arguments)
    if arguments.json is not None:
        new_file(arguments.json)
    from tcc_sim.output.explanation import closed_form_lines, explain, friction_line

    found = explain(scene, cost=arguments.cost)
    say(f"{found['scene']}: {found['description']}\nsolver offline: {found['solver']}")
    for what in ("terms", "topics", "modules"):
        say(f"{what}\n  held:     {', '.join(found[what]['held']) or 'none'}"
            f"\n  left out: {', '.join(found[what]['left_out']) or 'none'}")
    say("kernel arguments\n  " + "; ".join(f"{name}: {kind}" for name, kind in found["kernel"].items()))
    say(friction_line(found["friction"]))
    step = found["step"]
    if step is None:
        say("real-time step: none, the real-time solver takes the smoothed law only")
    else:
        say(f"real-time step: {counted(step['sub_steps'], 'sub-step')} in a tick of {step['tick_s'] * 1e3:g} ms")
        if arguments.cost:
            say(f"  a tick costs {step['own_s'] * 1e6:.2f} us; with every term on {step['general_s'] * 1e6:.2f} us, "
                f"{step['ratio']:.2f} times as much")
            for name, seconds in step["terms_s"].items():
                say(f"  of it {name}: {seconds * 1e6:.2f} us, {100.0 * seconds / step['own_s']:.0f} %")
        for name, own in step["own_calls"].items():
            say(f"  {name} a sub-step: {own:.3g}; with every term on {step['general_calls'][name]:.3g}")
    say("\n".join(closed_form_lines(found["closed_forms"])))
    present(arguments, scene, lambda: {"name": scene.name, **found})
    return 0
