"""Derivatives of the real-time solver's ticks beside central differences of fourth order of the ticks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from differences import apart

from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.scene import load_scene
from tcc_sim.solvers.fixed_step import advance, advance_ticks
from tcc_sim.solvers.fixed_step_sensitivity import advance_windows
from tcc_sim.solvers.key_derivatives import LOAD_AMPLITUDE, LOG_LOAD, MEAN_LOAD, MEAN_TORQUE, NUMBERS, key_derivatives
from tcc_sim.solvers.terms import Terms, holding, substeps, terms_of

KEYS = ("friction.static_coefficient", "friction.kinetic_coefficient", "friction.decay", "friction.smoothing",
        "driveline.damping", "driveline.stiffness", "driveline.flywheel_inertia", "driveline.plate_inertia",
        "engine.mean_torque")
FIG02 = load_scene("fig02").system
# From slip through stick, breakaway and the falling slope; and in stick all the time.
STARTS = np.array([[8.0, 0.09, 1.0], [0.0, 0.1, 5.1]])
STEP, WIDTH = 1e-3, 30


def columns(system: System) -> np.ndarray:
    """The derivatives of the numbers by the start and KEYS; a friction coefficient scales the whole load."""
    by = key_derivatives(system, KEYS)
    by[MEAN_LOAD:LOAD_AMPLITUDE + 1] = 0.0
    by[LOG_LOAD, KEYS.index("friction.kinetic_coefficient")] = 1.0 / system.friction.kinetic_coefficient
    return by


def swept(system: System, held: np.ndarray | None = None,
          by: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    terms = terms_of(system) if held is None else holding(terms_of(system), 0.0, 0.0)
    return advance_windows(STARTS, 0.7, STEP, WIDTH, substeps(terms_of(FIG02), STEP) + 3, terms,
                           None if held is None else np.repeat(held[:, None], 2, axis=1),
                           columns(system) if by is None else by)


def ticked(terms: Callable[[int], Terms], starts: np.ndarray) -> np.ndarray:
    """The states by the solver's own ticks, (2, WIDTH + 1, 3)."""
    n, out = substeps(terms_of(FIG02), STEP) + 3, np.empty((2, WIDTH + 1, 3))
    for j in range(2):
        state = starts[j].copy()
        out[j, 0] = state
        for k in range(WIDTH):
            tick = j * WIDTH + k
            advance(state, 0.7 + tick * STEP, STEP / n, n, terms(tick), None, None)
            out[j, k + 1] = state
    return out


def check(found: np.ndarray, at: Callable[[float], np.ndarray], size: float) -> None:
    """Within 1e-7 of the largest derivative of each state."""
    assert apart(found, at, size, axis=(0, 1)) <= 1e-7


def test_states_are_those_of_the_ticks() -> None:
    n, states = substeps(terms_of(FIG02), STEP) + 3, swept(FIG02)[0]
    state, out = STARTS[0].copy(), np.empty((WIDTH * n, 3))
    advance_ticks(state, 0.7, STEP, 0, WIDTH, n, terms_of(FIG02), None, out)
    assert states[0, 1:] == pytest.approx(out[n - 1::n], rel=1e-12, abs=1e-15)
    assert np.ptp(np.sign(np.round(states[0, :, 0], 1))) > 0.0, "the motion sticks and slips"


@pytest.mark.parametrize("place", range(3))
def test_derivatives_by_the_start(place: int) -> None:
    unit = np.eye(3)[place]
    check(swept(FIG02)[1][..., place], lambda e: ticked(lambda tick: terms_of(FIG02), STARTS + e * unit),
          (2e-3, 2e-5, 2e-3)[place])


@pytest.mark.parametrize("key", KEYS)
def test_derivatives_by_keys(key: str) -> None:
    value = dict(values_of(FIG02))[key]

    def at(change: float) -> np.ndarray:
        moved = terms_of(replace(FIG02, {key: value * (1.0 + change)}))
        return ticked(lambda tick: moved, STARTS)

    check(swept(FIG02)[1][..., 3 + KEYS.index(key)] * value, at, 2e-4)


def test_derivatives_where_inputs_are_held() -> None:
    """By mu_k, which scales what is held, and by offsets; one load is 0 and stays there."""
    rng = np.random.default_rng(0)
    held = np.column_stack([rng.uniform(100.0, 500.0, 2 * WIDTH), rng.uniform(300.0, 600.0, 2 * WIDTH)])
    held[7, 1] = 0.0
    by = np.zeros((len(NUMBERS), 3))
    by[LOG_LOAD, 0], by[MEAN_TORQUE, 1], by[MEAN_LOAD, 2] = 1.0, 1.0, 1.0
    found, terms = swept(FIG02, held, by)[1], terms_of(FIG02)

    def at(scale: float, torque: float, load: float) -> np.ndarray:
        return ticked(lambda tick: holding(terms, held[tick, 0] + torque,
                                           max(0.0, held[tick, 1] * (1.0 + scale) + load * (held[tick, 1] > 0.0))),
                      STARTS)

    check(found[..., 3], lambda e: at(e, 0.0, 0.0), 2e-4)
    check(found[..., 4], lambda e: at(0.0, e, 0.0), 2e-2)
    check(found[..., 5], lambda e: at(0.0, 0.0, e), 2e-2)


def test_corners_of_a_profile_cut_sub_steps() -> None:
    times = {"engine.frequency_times": [0.0, 0.7123, 1.0], "engine.frequency_values": [150.0, 140.0, 180.0],
             "pressure.mean_times": [0.0, 0.73347, 1.0], "pressure.mean_values": [2.6e5, 2.4e5, 2.7e5]}
    system = replace(FIG02, times)
    states, derivatives = swept(system)
    assert states == pytest.approx(ticked(lambda tick: terms_of(system), STARTS), rel=1e-12, abs=1e-14)

    def at(change: float) -> np.ndarray:
        moved = terms_of(replace(system, {"driveline.stiffness": 3000.0 * (1.0 + change)}))
        return ticked(lambda tick: moved, STARTS)

    check(derivatives[..., 3 + KEYS.index("driveline.stiffness")] * 3000.0, at, 2e-4)
