"""The stroboscopic map of a scene with its derivatives by central differences of the solver.

The signature is that of the engines' exact derivatives, which these differences test; they also serve where an engine
has none. Truncation is of second order in steps of about 1e-5 of the natural sizes; with the solver at 1e-12 that
leaves some 1e-9 in a multiplier.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.solvers import solve
from tcc_sim.trajectory import State

Floats = NDArray[np.float64]
STEPS = np.array([1e-4, 1e-6, 1e-4])
"""Steps of slip speed (rad/s), plate angle (rad) and plate speed (rad/s)."""
PARAMETER_STEP = 3e-6
"""Step of a key, relative to its value."""


class Differences(NamedTuple):
    """State after the cycles (3,), its derivatives by the state before (3, 3) and by the keys (3, P), and the event
    sequence.
    """

    state: Floats
    derivative: Floats
    by_parameter: Floats
    events: str


def event_sequence(before: NDArray[np.int8], after: NDArray[np.int8], only: int) -> str:
    """Modes in order as letters: S stick, + and - slip, F free; `only` is the mode where there is no change."""
    modes = [int(before[0]), *map(int, after)] if len(before) else [only]
    return "".join({0: "S", 1: "+", -1: "-", 2: "F"}[m] for m in modes)


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
        step = np.zeros(3)
        step[k] = STEPS[k]
        derivative[:, k] = (end(system, state + step) - end(system, state - step)) / (2.0 * STEPS[k])
    by_parameter = np.zeros((3, len(parameters)))
    present = dict(values_of(system))
    for k, key in enumerate(parameters):
        at = present[key]
        assert isinstance(at, float)
        by_parameter[:, k] = _by_key(system, key, at, lambda of: end(of, state), value)
    return Differences(value, derivative, by_parameter, events)


def _by_key(system: System, key: str, at: float, end: object, value: Floats) -> Floats:
    """The derivative of the end state by one key, one-sided of second order at the end of the key's range."""
    assert callable(end)
    h = PARAMETER_STEP * (abs(at) if at != 0.0 else 1.0)
    sides: list[Floats | None] = []
    for sign in (1.0, -1.0):
        try:
            sides.append(end(replace(system, {key: at + sign * h})))
        except InputError:
            sides.append(None)
    up, down = sides
    if up is not None and down is not None:
        return (up - down) / (2.0 * h)
    sign, near = (1.0, up) if up is not None else (-1.0, down)
    if near is None:
        raise InputError(f"{key} is {at:g}; it has no room to vary")
    far = end(replace(system, {key: at + 2.0 * sign * h}))
    out: Floats = sign * (4.0 * near - far - 3.0 * value) / (2.0 * h)
    return out
