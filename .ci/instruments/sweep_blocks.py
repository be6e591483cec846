"""Points of a sweep solved and judged in blocks beside the same points alone, and the cost of both.

`python .ci/instruments/sweep_blocks.py [POINTS] [SEED]` draws random points of both laws (engine frequency, mean
torque and its amplitude, kinetic coefficient), compares their records and prints those that differ; then it prints the
CPU time a point outside of kernels by cause, and the wall time of a sweep with one thread and with two, alternately.
Status 1 if a record differs.
"""

from __future__ import annotations

import dataclasses
import math
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from copy import copy
from typing import Any
from unittest.mock import patch

import numpy as np

from tcc_sim.compiling import compiled
from tcc_sim.model.equations import LAWS
from tcc_sim.model.parameters import System, replace
from tcc_sim.output.terminal import say
from tcc_sim.scene import system_of
from tcc_sim.solvers import stroboscopic
from tcc_sim.solvers.stroboscopic import engine_of
from tcc_sim.sweeps import sweep
from tcc_sim.sweeps.sweep import BATCH, Curve, Plan, solve_point, solve_points, sweep_curves

KERNEL, OUTSIDE = "kernel", "outside"
"""Time within kernels, and all other time of the process."""


def random_systems(law: str, count: int, seed: int) -> list[System]:
    """Return systems of one law whose motions stick, slip, run away, settle and do not."""
    z, scene = np.random.default_rng(seed), replace(system_of("chaos"), {"friction.law": law})
    return [replace(scene, {"engine.frequency": float(z.uniform(40.0, 300.0)),
                            "engine.torque_amplitude": float(z.uniform(10.0, 400.0)),
                            "engine.mean_torque": float(z.uniform(100.0, 700.0)),
                            "friction.kinetic_coefficient": float(z.uniform(0.12, 0.3))}) for _ in range(count)]


def record_of(point: Any) -> dict[str, Any]:
    """Return what a sweep stores of a point, without its computing time."""
    return {name: value for name, value in point.as_record().items() if name != "elapsed_s"}


def differences(law: str, count: int, seed: int, plan: Plan) -> tuple[list[str], Counter[str]]:
    """Return sentences on the points of a law whose records differ, and how many points have each verdict."""
    systems, sentences, kinds = random_systems(law, count, seed), list[str](), Counter[str]()
    for k in range(0, count, BATCH):
        block = systems[k:k + BATCH]
        values = [float(i) for i in range(k, k + len(block))]
        for value, system, together in zip(values, block, solve_points(block, values, plan, None)):
            one, other = record_of(solve_point(system, value, plan)), record_of(together)
            kinds[_kind(one)] += 1
            sentences += [f"{law} {value:g} {name}: alone {one[name]!r:.80}, in a block {other[name]!r:.80}"
                          for name in one if repr(one[name]) != repr(other[name])]
    return sentences, kinds


def _kind(record: dict[str, Any]) -> str:
    """Return the verdict of a record in words."""
    if record["max_slip_speed"] is None:
        return "failed"
    return "runaway" if record["runaway"] else "transient" if record["transient"] else (
        f"period {record['period']}" if record["period"] else "no period")


class Causes:
    """CPU time of this thread by cause, each without that of the causes within it, s."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = defaultdict(float)
        self._inner: list[float] = []

    def timed(self, cause: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function with its time counted."""
        def counted(*arguments: Any, **options: Any) -> Any:
            began = time.thread_time()
            self._inner.append(0.0)
            try:
                return function(*arguments, **options)
            finally:
                spent = time.thread_time() - began
                self.spent[cause] += spent - self._inner.pop()
                if self._inner:
                    self._inner[-1] += spent

        return counted


@contextmanager
def counted() -> Iterator[Causes]:
    """Yield the causes while the pieces of a block are counted."""
    causes = Causes()

    def timed_engine(system: System) -> Any:
        engine = engine_of(system)
        return dataclasses.replace(engine, setup=causes.timed("setups", engine.setup))

    entry = compiled.Kernel.entry

    def timed_entry(*words: Any) -> Any:
        found = copy(entry(*words))
        found.results = causes.timed(KERNEL, found.results)  # type: ignore[method-assign]
        return found

    with ExitStack() as stack:
        for place, name, cause in ((compiled.Calls, "__call__", "arguments"), (sweep, "solve_runs", "results"),
                                   (sweep, "in_blocks", "checks"), (sweep, "summaries_of", "judging"),
                                   (sweep, "_confirmed", "confirming"), (sweep, "solve_block", "points"),
                                   (Curve, "at", "systems")):
            stack.enter_context(patch.object(place, name, causes.timed(cause, getattr(place, name))))
        stack.enter_context(patch.object(stroboscopic, "engine_of", timed_engine))
        stack.enter_context(patch.object(compiled.Kernel, "entry", timed_entry))
        yield causes


def timed_curve(law: str, points: int) -> Curve:
    """Return a curve over the engine frequency, of which half the motions settle."""
    return Curve(replace(system_of("chaos"), {"friction.law": law}), "engine.frequency",
                 tuple(np.linspace(60.0, 250.0, points).tolist()))


def outside_kernels(law: str, points: int, repeats: int) -> dict[str, float]:
    """Return the least CPU time a point by cause, s, of kernels too, and of all but these (OUTSIDE)."""
    curve, least = timed_curve(law, points), dict[str, float]()
    for _ in range(repeats):
        with counted() as causes:
            began = time.process_time()
            sweep_curves([curve], jobs=1)
            whole = time.process_time() - began
        causes.spent["rest"] = whole - sum(causes.spent.values())
        causes.spent[OUTSIDE] = whole - causes.spent[KERNEL]
        least = {cause: min(spent, least.get(cause, spent)) for cause, spent in causes.spent.items()}
    return {cause: spent / points for cause, spent in least.items()}


def scaling(law: str, points: int, repeats: int) -> tuple[float, float]:
    """Return the least wall time of a sweep with one thread and with two, measured alternately, s."""
    curve, walls = timed_curve(law, points), {1: math.inf, 2: math.inf}
    for _ in range(repeats):
        for jobs in walls:
            began = time.perf_counter()
            sweep_curves([curve], jobs=jobs)
            walls[jobs] = min(walls[jobs], time.perf_counter() - began)
    return walls[1], walls[2]


def main(count: int = 5000, seed: int = 1, points: int = 512, repeats: int = 7) -> int:
    """Compare, measure and print."""
    differ = 0
    for law in LAWS:
        result, kinds = differences(law, count, seed, Plan(section_points=5))
        differ += len(result)
        say("\n".join([*result, f"{law}: {len(result)} differences in {count} points; "
                       + ", ".join(f"{kind} {number}" for kind, number in kinds.most_common())]))
    for law in LAWS:
        spent = outside_kernels(law, points, repeats)
        pieces = sorted((row for row in spent.items() if row[0] not in (KERNEL, OUTSIDE)), key=lambda row: -row[1])
        say(f"{law}: {1e3 * spent[KERNEL]:.3f} ms a point in kernels, {1e3 * spent[OUTSIDE]:.3f} ms outside: "
            + ", ".join(f"{cause} {1e6 * x:.0f} us" for cause, x in pieces))
        one, two = scaling(law, points, repeats)
        say(f"{law}: {points} points in {one:.2f} s with one thread, {two:.2f} s with two: "
            f"{one / two:.2f} times as fast")
    return int(differ > 0)


if __name__ == "__main__":
    raise SystemExit(main(*map(int, sys.argv[1:])))
