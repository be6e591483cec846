"""Derivatives: Den Hartog's oscillator, margins, parts that begin anywhere, and ticks of the real-time solver."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from differences import apart, difference

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.engine import GRADIENT, VALUE
from tcc_sim.solvers.exact_engine import ARRIVAL, GRAZING, STUCK
from tcc_sim.solvers.fixed_step import Stepper
from tcc_sim.solvers.fixed_step_sensitivity import advance_windows
from tcc_sim.solvers.key_derivatives import LOAD_AMPLITUDE, LOG_LOAD, MEAN_LOAD, MEAN_TORQUE, NUMBERS, key_derivatives
from tcc_sim.solvers.stroboscopic import stroboscopic_map
from tcc_sim.solvers.terms import Terms, holding, substeps, terms_of
from tcc_sim.study.continuation.motions import ContinuationPlan, check
from tcc_sim.trajectory import State

MU_K, MU_S, OMEGA = "friction.kinetic_coefficient", "friction.static_coefficient", "engine.frequency"
BASE = replace(System(), {"friction.law": "set_valued", "pressure.mean": 225e3, "pressure.amplitude": 0.0})
START = np.array([3.0, 0.1, 2.0])


def by_key(system, key, function):
    """The derivative of a function of the system by one of its keys."""
    at = dict(values_of(system))[key]
    return difference(lambda d: function(replace(system, {key: at + d})), 1e-5 * max(abs(at), 1.0))


def den_hartog(flywheel):
    """Product of the multipliers of a plate on its spring whose flywheel is so heavy that friction hardly moves it.

    In the plate's angle relative to the flywheel this is x'' + x = cos(beta t) - s sgn x' with beta = 1.3, s = 0.2.
    """
    beta, s, plate = 1.3, 0.2, 0.01
    system = replace(System(), {
        "friction.law": "set_valued", "friction.kinetic_coefficient": 0.3, "driveline.flywheel_inertia": flywheel,
        "driveline.plate_inertia": plate, "driveline.stiffness": plate, "driveline.damping": 0.0, OMEGA: beta,
        "engine.mean_torque": 0.0, "engine.torque_amplitude": flywheel / abs(1.0 / beta**2 - 1.0),
        "pressure.amplitude": 0.0, "pressure.mean": s * plate / (0.3 * 0.008)})
    x = np.array([-1.0, 0.3, 0.5])
    for _ in range(30):
        image = stroboscopic_map(system, x, 1)
        step = np.linalg.solve(np.eye(3) - image.derivative, image.state - x)
        x = x + step * min(1.0, 0.5 / np.abs(step).max())
        if np.abs(step).max() < 1e-11:
            break
    assert image.events in ("+-+", "-+-")
    return float(np.linalg.det(image.derivative))


def test_den_hartogs_oscillator():
    gain, swing = 1.0 / (1.0 - 1.3**2), math.sin(math.pi / 1.3) / (1.3 * (1.0 + math.cos(math.pi / 1.3)))
    largest = math.sqrt(gain**2 - (0.2 * swing) ** 2)
    turning = abs(largest / gain - largest)
    expected = ((turning - 0.2) / (turning + 0.2)) ** 2
    one, two = den_hartog(250.0), den_hartog(500.0)
    assert 2.0 * two - one == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(("changes", "row", "start"), [
    ({MU_K: 0.3, OMEGA: 41.7}, STUCK, None), ({"engine.mean_torque": 20.0, "engine.torque_amplitude": 900.0}, ARRIVAL,
                                              None),
    ({MU_K: 0.3, OMEGA: 66.0, "pressure.amplitude": 1e3}, GRAZING, np.array([20.0, 0.12, 5.0]))])
def test_margins_have_the_derivatives_of_their_values(changes, row, start):
    system = replace(BASE, changes)
    start = START if start is None else start
    keys = (OMEGA, "pressure.mean", "driveline.stiffness", "engine.torque_amplitude", "driveline.plate_inertia", MU_S)
    keys = keys if MU_K not in changes else keys[:-1]

    def value(of, x=start):
        return stroboscopic_map(of, np.asarray(x), 1, margins=True).margins[row, VALUE]

    image = stroboscopic_map(system, start, 1, parameters=keys, margins=True).margins[row]
    assert math.isfinite(image[VALUE])
    for k, step in enumerate((1e-3, 1e-5, 1e-3)):
        expected = difference(lambda d, k=k: value(system, start + d * np.eye(3)[k]), step)
        assert image[GRADIENT + k] == pytest.approx(expected, rel=1e-6, abs=1e-6)
    for k, key in enumerate(keys):
        expected = by_key(system, key, value)
        assert image[GRADIENT + 3 + k] == pytest.approx(expected, rel=1e-6, abs=1e-6), key


def test_a_damper_too_stiff_for_derivatives_is_refused_with_the_reason():
    """Steps resolve what decays at C23/I2, and 1e5 of them would make a hundredth of a cycle."""
    light = {"friction.law": "set_valued", "driveline.damping": 1e4, "driveline.plate_inertia": 1e-5}
    with pytest.raises(InputError, match=r"driveline.damping is 10000 N m s/rad.* more than \d+ steps a cycle"):
        stroboscopic_map(replace(System(), light), np.array([5.0, 0.1, 0.0]), 1)
    with pytest.raises(InputError, match=r"driveline\.damping is 10000"):
        check(replace(System(), light), ContinuationPlan("engine.mean_torque", 299.0, 301.0))
    system = replace(System(), {**light, "driveline.damping": 10.0})
    image = stroboscopic_map(system, np.array([5.0, 0.1, 0.0]), 1)
    run = solve(system, cycles=1, state=State(5.0, 0.1, 0.0))
    assert image.state[0] == pytest.approx(run.final.slip_speed, rel=1e-9)


KEY = "pressure.mean"
SIZES, STEPS = np.array([10.0, 0.1, 10.0]), np.array([1e-6, 1e-7, 1e-6])
PARTS = 23


def scene_of(name: str, law: str) -> System:
    return replace(load_scene(name).system, {"friction.law": law})


def settled(system: System) -> np.ndarray:
    result = solve(system, cycles=30, rtol=1e-12).cycles
    return result.section[-1]


def differences(system: System, x: np.ndarray, start: float, held: bool) -> np.ndarray:
    """Derivatives by the state and by KEY; a start that is held in stick has none by the slip speed."""
    def end(of: System, y: np.ndarray) -> np.ndarray:
        return stroboscopic_map(of, y, 1.0 / PARTS, start_cycle=start).state

    out, mean = np.zeros((3, 4)), system.pressure.mean
    for k in range(1 if held else 0, 3):
        h = np.eye(3)[k] * STEPS[k]
        out[:, k] = (end(system, x + h) - end(system, x - h)) / (2.0 * STEPS[k])
    up, down = (replace(system, {KEY: mean * (1.0 + sign)}) for sign in (1e-5, -1e-5))
    out[:, 3] = (end(up, x) - end(down, x)) / (2e-5 * mean)
    return out


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
@pytest.mark.parametrize("name", ["fig02", "chaos"])
def test_parts_that_begin_anywhere_have_the_derivatives_of_differences(name: str, law: str) -> None:
    system = scene_of(name, law)
    x, stuck = settled(system), 0
    for k in range(PARTS):
        image = stroboscopic_map(system, x, 1.0 / PARTS, start_cycle=k / PARTS, rtol=1e-8, parameters=(KEY,))
        held = law == "set_valued" and x[0] == 0.0
        expected = differences(system, x, k / PARTS, held)
        derivatives = np.hstack([image.derivative, image.by_parameter])
        scale = np.abs(expected / SIZES[:, None]).max(axis=0) * SIZES[:, None]
        # A part at whose end the motion has just reached stick, or left it, is nearly not differentiable.
        assert (np.abs(derivatives - expected) <= 1e-4 * np.abs(expected) + 2e-6 * scale).all(), (k, image.events)
        stuck += image.events == "S"
        x = image.state
    assert stuck > PARTS // 3


TICKED_KEYS = ("friction.static_coefficient", "friction.kinetic_coefficient", "friction.decay", "friction.smoothing",
        "driveline.damping", "driveline.stiffness", "driveline.flywheel_inertia", "driveline.plate_inertia",
        "engine.mean_torque")
FIG02 = load_scene("fig02").system
TERMS = terms_of(FIG02)
# From slip through stick, breakaway and the falling slope; and in stick all the time.
STARTS = np.array([[8.0, 0.09, 1.0], [0.0, 0.1, 5.1]])
STEP, WIDTH = 1e-3, 30


def columns(system: System) -> np.ndarray:
    """The derivatives of the numbers by the start and TICKED_KEYS; a friction coefficient scales the whole load."""
    by = key_derivatives(system, TICKED_KEYS)
    by[MEAN_LOAD:LOAD_AMPLITUDE + 1] = 0.0
    by[LOG_LOAD, TICKED_KEYS.index("friction.kinetic_coefficient")] = 1.0 / system.friction.kinetic_coefficient
    return by


def swept(system: System, held: np.ndarray | None = None,
          by: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    terms = terms_of(system) if held is None else holding(terms_of(system), 0.0, 0.0)
    return advance_windows(STARTS, 0.7, STEP, WIDTH, substeps(TERMS, STEP) + 3, terms,
                           None if held is None else np.repeat(held[:, None], 2, axis=1),
                           columns(system) if by is None else by)


def ticked(terms: Callable[[int], Terms], starts: np.ndarray) -> np.ndarray:
    """The states by the solver's own ticks, (2, WIDTH + 1, 3)."""
    stepper, used, out = Stepper(FIG02, STEP), None, np.empty((2, WIDTH + 1, 3))
    for j in range(2):
        stepper.state[:3] = out[j, 0] = starts[j]
        for k in range(WIDTH):
            stepper.tick = 700 + j * WIDTH + k
            if terms(j * WIDTH + k) is not used:
                used = terms(j * WIDTH + k)
                stepper.use(used)
                stepper.substeps = substeps(TERMS, STEP) + 3
            stepper.advance()
            out[j, k + 1] = stepper.state[:3]
    return out


def check_ticks(result: np.ndarray, at: Callable[[float], np.ndarray], size: float) -> None:
    """Within 1e-7 of the largest derivative of each state."""
    assert apart(1e-7, result, at, size, axis=(0, 1)) <= 1e-7


@pytest.mark.parametrize("place", range(3))
def test_derivatives_by_the_start(place: int) -> None:
    unit = np.eye(3)[place]
    check_ticks(swept(FIG02)[1][..., place], lambda e: ticked(lambda tick: TERMS, STARTS + e * unit),
          (2e-3, 2e-5, 2e-3)[place])


@pytest.mark.parametrize("key", TICKED_KEYS)
def test_derivatives_by_keys(key: str) -> None:
    value = dict(values_of(FIG02))[key]

    def at(change: float) -> np.ndarray:
        moved = terms_of(replace(FIG02, {key: value * (1.0 + change)}))
        return ticked(lambda tick: moved, STARTS)

    check_ticks(swept(FIG02)[1][..., 3 + TICKED_KEYS.index(key)] * value, at, 2e-4)


def test_derivatives_where_inputs_are_held() -> None:
    """By mu_k, which scales what is held, and by offsets; one load is 0 and stays there."""
    rng = np.random.default_rng(0)
    held = np.column_stack([rng.uniform(100.0, 500.0, 2 * WIDTH), rng.uniform(300.0, 600.0, 2 * WIDTH)])
    held[7, 1] = 0.0
    by = np.zeros((len(NUMBERS), 3))
    by[LOG_LOAD, 0], by[MEAN_TORQUE, 1], by[MEAN_LOAD, 2] = 1.0, 1.0, 1.0
    result, terms = swept(FIG02, held, by)[1], terms_of(FIG02)

    def at(scale: float, torque: float, load: float) -> np.ndarray:
        return ticked(lambda tick: holding(terms, held[tick, 0] + torque,
                                           max(0.0, held[tick, 1] * (1.0 + scale) + load * (held[tick, 1] > 0.0))),
                      STARTS)

    check_ticks(result[..., 3], lambda e: at(e, 0.0, 0.0), 2e-4)
    check_ticks(result[..., 4], lambda e: at(0.0, e, 0.0), 2e-2)
    check_ticks(result[..., 5], lambda e: at(0.0, 0.0, e), 2e-2)


def test_corners_of_a_profile_cut_sub_steps() -> None:
    times = {"engine.frequency_times": [0.0, 0.7123, 1.0], "engine.frequency_values": [150.0, 140.0, 180.0],
             "pressure.mean_times": [0.0, 0.73347, 1.0], "pressure.mean_values": [2.6e5, 2.4e5, 2.7e5]}
    system = replace(FIG02, times)
    states, derivatives = swept(system)
    terms = terms_of(system)
    assert states == pytest.approx(ticked(lambda tick: terms, STARTS), rel=1e-11, abs=1e-13)

    def at(change: float) -> np.ndarray:
        moved = terms_of(replace(system, {"driveline.stiffness": 3000.0 * (1.0 + change)}))
        return ticked(lambda tick: moved, STARTS)

    check_ticks(derivatives[..., 3 + TICKED_KEYS.index("driveline.stiffness")] * 3000.0, at, 2e-4)
