"""What a scene builds and what it leaves out: terms, kernel, modules, topics, and what a step costs because of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import FunctionType, SimpleNamespace
from typing import Any

import numpy as np

from tcc_sim.model.parameters import System
from tcc_sim.output.closed_forms import closed_forms
from tcc_sim.scene import Scene
from tcc_sim.solvers import choose
from tcc_sim.solvers.terms import Terms, general_terms, held_and_left_out, substeps, terms_of
from tcc_sim.topics import TOPICS

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
    needed = [row.name for row in TOPICS if row.wanted(scene.value)]
    real_time = terms.smoothing is not None
    return {
        "scene": scene.name, "description": scene.description, "solver": choose(scene.system, "auto"),
        "terms": {"held": held, "left_out": left_out},
        "kernel": {name: _kind(value) for name, value in zip(terms._fields, terms)},
        "topics": {"held": needed, "left_out": [row.name for row in TOPICS
                                                if row.name not in needed and row.direction != "beside"]},
        "modules": {"held": [], "left_out": list(OPTIONAL_MODULES)},  # What neither engine imports.
        "step": {"tick_s": TICK, "sub_steps": substeps(terms_of(scene.system), TICK), **(_cost(scene) if cost else {}),
                 **count_calls(scene.system)} if real_time else None,
        "closed_forms": closed_forms(scene.system),
    }


def _kind(value: object) -> str:
    """A term as the compiler sees it."""
    if value is None:
        return "left out"
    if isinstance(value, np.ndarray):
        return f"array of {' by '.join(map(str, value.shape))} numbers"
    return f"{len(value)} numbers" if isinstance(value, tuple) else "number"


def count_calls(system: System) -> dict[str, dict[str, float]]:
    """Calls per sub-step of the first tick, whose kernel runs as Python: `own_calls`, `general_calls`."""
    from tcc_sim.solvers.fixed_step import Stepper, advance

    found: dict[str, dict[str, float]] = {}
    for which, terms in (("own_calls", terms_of(system)), ("general_calls", general_terms(system))):
        counts = dict.fromkeys(FUNCTIONS.values(), 0.0)

        def counted(name: str, counts: dict[str, float] = counts) -> Callable[[Any], Any]:
            def call(x: Any) -> Any:
                counts[FUNCTIONS[name]] += 1.0
                return getattr(np, name)(x)
            return call

        stepper = Stepper(system, TICK)
        n = stepper.substeps
        run = _interpreted(advance, SimpleNamespace(**{**vars(np), **{name: counted(name) for name in FUNCTIONS}}), {})
        run(stepper.state, 0.0, TICK / n, n, terms, True, None)
        found[which] = {name: count / n for name, count in counts.items()}
    return found


def _interpreted(kernel: Any, numpy: Any, known: dict[Any, Any]) -> Callable[..., Any]:
    """A kernel as Python, and all those that it calls, with another NumPy."""
    if kernel not in known:
        names = {**kernel.py_func.__globals__, "np": numpy}
        known[kernel] = FunctionType(kernel.py_func.__code__, names)
        for name in kernel.py_func.__code__.co_names:
            if hasattr(names.get(name), "py_func"):
                names[name] = _interpreted(names[name], numpy, known)
    out: Callable[..., Any] = known[kernel]
    return out


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
