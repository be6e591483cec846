"""`tcc-sim scenes`: the bundled scenes, one line each."""

from __future__ import annotations

import argparse

from tcc_sim.scene import bundled_scenes, load_scene


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """No arguments."""


def run(arguments: argparse.Namespace) -> int:
    """Print name and description of every bundled scene."""
    scenes = {name: load_scene(path) for name, path in bundled_scenes().items()}
    width = max(map(len, scenes), default=0)
    for name, scene in scenes.items():
        print(f"{name:<{width}}  {scene.description}")
    return 0
