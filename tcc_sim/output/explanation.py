"""What a scene builds and what it leaves out: terms, kernel, modules, topics, and what a step costs because of it."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from typing import Any

import numpy as np

from tcc_sim.scene import Scene
from tcc_sim.solvers import choose
from tcc_sim.solvers.fixed_step import Stepper, march
from tcc_sim.solvers.terms import general_terms, held_and_left_out, terms_of
from tcc_sim.topics import TOPICS, Topic

OPTIONAL_MODULES = ("scipy", "mcap", "matplotlib", "rerun", "rclpy", "distributed")
"""Packages that only some scenes and verbs need."""
TICK = 1e-3
"""The tick whose cost is measured, s."""
REPEATS, TICKS = 7, 400


def explain(scene: Scene) -> dict[str, Any]:
    """Terms held and left out, kernel argument types, modules, topics, and the measured cost of a tick.

    Returns
    -------
    A dict that can go to JSON: `terms`, `topics` and `modules` with `held` and `left_out`; `solver`; `kernel`: the type
    of every term; `step`: `tick_s`, `sub_steps`, `own_s`, `general_s` and their `ratio` (None where the real-time
    solver does not apply: the set-valued law).
    """
    terms = terms_of(scene.system)
    held, left_out = held_and_left_out(terms)
    needed = [row.name for row in TOPICS if needs(scene, row)]
    loaded = _modules(scene)
    return {
        "scene": scene.name, "description": scene.description, "solver": choose(scene.system, "auto"),
        "terms": {"held": held, "left_out": left_out},
        "kernel": {name: _kind(value) for name, value in zip(terms._fields, terms)},
        "topics": {"held": needed, "left_out": [row.name for row in TOPICS if row.name not in needed]},
        "modules": {"held": loaded, "left_out": [m for m in OPTIONAL_MODULES if m not in loaded]},
        "step": _cost(scene) if terms.smoothing is not None else None,
    }


def needs(scene: Scene, row: Topic) -> bool:
    """Whether the driveline node creates this topic for `scene`."""
    return row.wanted(scene.value)


def _kind(value: object) -> str:
    """A term as the compiler sees it."""
    if value is None:
        return "left out"
    if isinstance(value, np.ndarray):
        return f"array of {value.shape[0]} sines"
    return f"{len(value)} numbers" if isinstance(value, tuple) else "number"


def _modules(scene: Scene) -> list[str]:
    """Which optional packages an offline solve of `scene` imports, looked up in a process of its own."""
    code = ("import sys, json; from tcc_sim.scene import parse_scene; from tcc_sim.solvers import solve\n"
            "solve(parse_scene(sys.stdin.read(), 'scene').system, cycles=1)\n"
            f"print(json.dumps([m for m in {OPTIONAL_MODULES!r} if m in sys.modules]))")
    ended = subprocess.run([sys.executable, "-c", code], input=scene.text(), capture_output=True, text=True, check=True)
    found: list[str] = json.loads(ended.stdout)
    return found


def _cost(scene: Scene) -> dict[str, float]:
    """Seconds of a tick of the real-time solver with this scene's kernel and with every term on, in turn, fastest of
    several.
    """
    stepper = Stepper(scene.system, TICK)
    n = stepper.substeps
    # The general kernel also integrates theta1, which the own one leaves out where nobody asks.
    kernels = {"own": (stepper.terms, None, 3), "general": (general_terms(scene.system), True, 4)}
    best = dict.fromkeys(kernels, np.inf)
    for _ in range(REPEATS):
        for name, (terms, flywheel, size) in kernels.items():
            out = np.empty((TICKS * n, size))
            march(stepper.state[:size].copy(), 0.0, TICK, 0, 1, n, terms, flywheel, out)
            state = stepper.state[:size].copy()
            began = time.perf_counter()
            march(state, 0.0, TICK, 0, TICKS, n, terms, flywheel, out)
            best[name] = min(best[name], (time.perf_counter() - began) / TICKS)
    return {"tick_s": TICK, "sub_steps": n, "own_s": best["own"], "general_s": best["general"],
            "ratio": best["general"] / best["own"]}
