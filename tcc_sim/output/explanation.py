"""What a scene builds and what it leaves out: terms, kernel, modules, topics, and what a step costs because of it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from tcc_sim.model.parameters import System
from tcc_sim.output.closed_forms import closed_forms
from tcc_sim.scene import Scene
from tcc_sim.solvers import choose
from tcc_sim.solvers.terms import Terms, general_terms, held_and_left_out, substeps, terms_of
from tcc_sim.topics import TOPICS, Topic

OPTIONAL_MODULES = ("scipy", "mcap", "matplotlib", "rerun", "rclpy", "distributed")
"""Packages that only some scenes and verbs need."""
TICK = 1e-3
"""The tick whose cost is measured, s."""
REPEATS, TICKS = 7, 400
OPTIONAL = {"torque": "engine torque sine", "harmonics": "engine torque harmonics", "pulsation": "pressure sine",
            "stribeck": "Stribeck exponential"}
"""Terms whose cost is measured by leaving them out, with their names for people."""
FUNCTIONS = {"sin": "sines", "exp": "exponentials", "tanh": "hyperbolic tangents"}
"""NumPy's functions that the kernels call, the dear part of a sub-step."""


def explain(scene: Scene, *, cost: bool = False) -> dict[str, Any]:
    """Terms held and left out, kernel argument types, modules, topics, and the calls of a sub-step.

    Parameters
    ----------
    cost : measure also what a tick costs, with every term on and without each of those held; it compiles them

    Returns
    -------
    A dict that can go to JSON: `terms`, `topics` and `modules` with `held` and `left_out`; `solver`; `kernel`: the type
    of every term; `step`: `tick_s`, `sub_steps`, and per sub-step of the first tick `own_calls` and `general_calls` of
    sine, exponential and hyperbolic tangent, with `cost` also `own_s`, `general_s`, their `ratio`, and `terms_s`: what
    each term adds (None where the real-time solver does not apply: the set-valued law); `closed_forms`: pure slip and
    pure stick as `closed_forms` gives them.
    """
    terms = terms_of(scene.system)
    held, left_out = held_and_left_out(terms)
    needed = [row.name for row in TOPICS if needs(scene, row)]
    real_time = terms.smoothing is not None
    looked = _look(scene, real_time)
    loaded = looked["modules"]
    return {
        "scene": scene.name, "description": scene.description, "solver": choose(scene.system, "auto"),
        "terms": {"held": held, "left_out": left_out},
        "kernel": {name: _kind(value) for name, value in zip(terms._fields, terms)},
        "topics": {"held": needed, "left_out": [row.name for row in TOPICS
                                                if row.name not in needed and row.direction != "beside"]},
        "modules": {"held": loaded, "left_out": [m for m in OPTIONAL_MODULES if m not in loaded]},
        "step": {"tick_s": TICK, "sub_steps": substeps(terms_of(scene.system), TICK), **(_cost(scene) if cost else {}),
                 **looked["calls"]} if real_time else None,
        "closed_forms": closed_forms(scene.system),
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


def _look(scene: Scene, real_time: bool) -> dict[str, Any]:
    """What only a process of its own can tell: optional packages that an offline solve imports, and calls a sub-step.

    There the kernels run as Python, so that nothing is compiled and their calls can be counted.
    """
    code = ("import json, sys\n"
            "from tcc_sim.output.explanation import count_calls\n"
            "from tcc_sim.scene import parse_scene\n"
            "from tcc_sim.solvers import SOLVERS, choose\n"
            "system = parse_scene(sys.stdin.read(), 'scene').system\n"
            "SOLVERS[choose(system, 'auto')].load()\n"
            f"modules = [m for m in {OPTIONAL_MODULES!r} if m in sys.modules]\n"
            f"print(json.dumps({{'modules': modules, 'calls': count_calls(system) if {real_time} else {{}}}}))")
    ended = subprocess.run([sys.executable, "-c", code], input=scene.text(), capture_output=True, text=True, check=True,
                           env={**os.environ, "NUMBA_DISABLE_JIT": "1"})
    found: dict[str, Any] = json.loads(ended.stdout)
    return found


def count_calls(system: System) -> dict[str, dict[str, float]]:
    """Calls per sub-step of the first tick, where the kernels are not compiled: `own_calls`, `general_calls`."""
    from tcc_sim.solvers.fixed_step import Stepper, advance
    found: dict[str, dict[str, float]] = {}
    kept = {name: getattr(np, name) for name in FUNCTIONS}
    for which, terms in (("own_calls", terms_of(system)), ("general_calls", general_terms(system))):
        counts = dict.fromkeys(FUNCTIONS.values(), 0.0)

        def counted(name: str, counts: dict[str, float] = counts) -> Callable[[Any], Any]:
            def call(x: Any) -> Any:
                counts[FUNCTIONS[name]] += 1.0
                return kept[name](x)
            return call

        stepper = Stepper(system, TICK)
        n = stepper.substeps
        try:
            for name in FUNCTIONS:
                setattr(np, name, counted(name))
            advance(stepper.state, 0.0, TICK / n, n, terms, True, None)
        finally:
            for name, function in kept.items():
                setattr(np, name, function)
        found[which] = {name: count / n for name, count in counts.items()}
    return found


def _cost(scene: Scene) -> dict[str, Any]:
    """Seconds of a tick of the node's solver with this scene's kernel, with every term on and with each term that can
    be left out left out, in turn, fastest of several.
    """
    from tcc_sim.solvers.fixed_step import Stepper, advance
    stepper = Stepper(scene.system, TICK)
    n = stepper.substeps
    own = stepper.terms
    kernels = {"own": own, "general": general_terms(scene.system)}
    kernels |= {name: Terms(**{**own._asdict(), name: None}) for name in OPTIONAL if getattr(own, name) is not None}
    best = dict.fromkeys(kernels, np.inf)
    for _ in range(REPEATS):
        for name, terms in kernels.items():
            advance(stepper.state.copy(), 0.0, TICK / n, 1, terms, True, None)
            state = stepper.state.copy()
            began = time.thread_time()
            advance(state, 0.0, TICK / n, TICKS * n, terms, True, None)
            best[name] = min(best[name], (time.thread_time() - began) / TICKS)
    return {"own_s": best["own"], "general_s": best["general"], "ratio": best["general"] / best["own"],
            "terms_s": {OPTIONAL[name]: best["own"] - best[name] for name in kernels if name in OPTIONAL}}
