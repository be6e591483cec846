"""The stroboscopic map of a scene with its derivatives by central differences of the solver.

The signature is that of the engines' exact derivatives, which these differences test. Truncation is of second order in
steps of about 1e-5 of the natural sizes; with the solver at 1e-12 that leaves some 1e-9 in a multiplier.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.solvers import solve
from tcc_sim.trajectory import State, event_sequence

Floats = NDArray[np.float64]
STEPS = np.array([1e-4, 1e-6, 1e-4])
"""Steps of slip speed (rad/s), plate angle (rad) and plate speed (rad/s)."""
PARAMETER_STEP = 3e-6
"""Step of a key, relative to its value."""
FINER = 0.03
"""Factor of a finer step."""
BEND = 1e-4
"""Second difference over the first above which a step is made finer."""


class Differences(NamedTuple):
    """State after the cycles (3,), its derivatives by the state before (3, 3) and by the keys (3, P), and the event
    sequence.
    """

    state: Floats
    derivative: Floats
    by_parameter: Floats
    events: str


def stroboscopic_map(system: System, state: Floats, cycles: int, *, start_cycle: int = 0, rtol: float = 1e-12,
                     parameters: Sequence[str] = ()) -> Differences:
    """The state after whole engine cycles, and its derivatives by central differences.

    A start in stick under the set-valued law has no derivative by the slip speed (a motion in stick stays on v = 0):
    that column is 0, the projection onto stick.

    Raises
    ------
    NumericalFailure
        The solver stopped early.
    """
    def end(of: System, x: Floats) -> Floats:
        start = State(float(x[0]), float(x[1]), float(x[2]))
        solved = solve(of, cycles=cycles, start_cycle=start_cycle, state=start, rtol=rtol).raise_for_status().final
        return np.array([solved.slip_speed, solved.plate_angle, solved.plate_speed])

    start = State(*map(float, state))
    solved = solve(system, cycles=cycles, start_cycle=start_cycle, state=start, rtol=rtol).raise_for_status()
    moves, final = solved.transitions, solved.final
    value = np.array([final.slip_speed, final.plate_angle, final.plate_speed])
    events = event_sequence(moves.before, moves.after, int(solved.state[0]))
    derivative = np.zeros((3, 3))
    stuck = system.friction.law == "set_valued" and state[0] == 0.0 and events[0] == "S"
    for k in range(1 if stuck else 0, 3):
        def moved(sign: float, finer: float, k: int = k) -> Floats:
            step = np.zeros(3)
            step[k] = sign * finer * STEPS[k]
            return end(system, state + step)

        derivative[:, k] = _central(moved, value) / STEPS[k]
    by_parameter = np.zeros((3, len(parameters)))
    present = dict(values_of(system))
    for k, key in enumerate(parameters):
        at = present[key]
        assert isinstance(at, float)
        h = PARAMETER_STEP * (abs(at) if at != 0.0 else 1.0)

        def turned(sign: float, finer: float, key: str = key, at: float = at, h: float = h) -> Floats:
            return end(replace(system, {key: at + sign * finer * h}), state)

        by_parameter[:, k] = _central(turned, value) / h
    return Differences(value, derivative, by_parameter, events)


def _central(at: Callable[[float, float], Floats], value: Floats) -> Floats:
    """The derivative of `at` by its first argument at 0, where it is `value`; the second one scales the step.

    It is one-sided of second order at the end of a key's range. Where the map bends the step is made finer: the second
    difference over the first, squared, is the relative truncation.
    """
    out = np.zeros_like(value)
    for finer in (1.0, FINER, FINER**2):
        sides: list[Floats | None] = []
        for sign in (1.0, -1.0):
            try:
                sides.append(at(sign, finer))
            except InputError:
                sides.append(None)
        up, down = sides
        if up is None and down is None:
            continue
        if up is None or down is None:
            sign, near = (1.0, up) if up is not None else (-1.0, down)
            assert near is not None
            far = at(2.0 * sign, finer)
            first, second = sign * (4.0 * near - far - 3.0 * value), far - 2.0 * near + value
        else:
            first, second = up - down, up - 2.0 * value + down
        out = first / (2.0 * finer)
        if np.abs(second / STEPS).max() <= BEND * np.abs(first / STEPS).max():
            break
    return out
