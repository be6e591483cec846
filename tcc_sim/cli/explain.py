"""`tcc-sim explain`: what a scene builds and what it leaves out."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcc_sim.cli.arguments import new_file
from tcc_sim.errors import counted
from tcc_sim.output.terminal import say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The scene and where the answer goes."""
    parser.add_argument("scene", metavar="SCENE", help="name of a bundled scene, or a file")
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[], help="change a key of the scene")
    parser.add_argument("--cost", action="store_true", help="measure what a tick of the real-time solver and each of "
                        "its terms cost; this compiles a kernel for every term")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the answer here")


def run(arguments: argparse.Namespace) -> int:
    """Print what is held and left out, and what a step costs."""
    from tcc_sim.scene import load_scene, parse_assignments

    scene = load_scene(arguments.scene).with_values(parse_assignments(arguments.set))
    if arguments.json is not None:
        new_file(arguments.json)
    from tcc_sim.output.closed_forms import closed_form_lines
    from tcc_sim.output.explanation import explain

    found = explain(scene, cost=arguments.cost)
    say(f"{found['scene']}: {found['description']}\nsolver offline: {found['solver']}")
    for what in ("terms", "topics", "modules"):
        say(f"{what}\n  held:     {', '.join(found[what]['held']) or 'none'}"
            f"\n  left out: {', '.join(found[what]['left_out']) or 'none'}")
    say("kernel arguments\n  " + "; ".join(f"{name}: {kind}" for name, kind in found["kernel"].items()))
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
    if arguments.json is not None:
        from tcc_sim.output.files import write_json
        from tcc_sim.output.provenance import document

        write_json(arguments.json, document("explain", {"name": scene.name, **found}, scene, arguments.words))
    return 0
