"""The stroboscopic maps: Den Hartog's oscillator, margins, too stiff dampers, and parts that begin anywhere."""

import math

import numpy as np
import pytest
from differences import difference
from oracle import tangent_map

from tcc_sim.continuation.motions import ContinuationPlan, check
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.engine import GRADIENT, VALUE
from tcc_sim.solvers.event_driven.margins import ARRIVAL, GRAZING, STUCK
from tcc_sim.solvers.stroboscopic import stroboscopic_map
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
        found = stroboscopic_map(system, x, 1)
        step = np.linalg.solve(np.eye(3) - found.derivative, found.state - x)
        x = x + step * min(1.0, 0.5 / np.abs(step).max())
        if np.abs(step).max() < 1e-11:
            break
    assert found.events in ("+-+", "-+-")
    return float(np.linalg.det(found.derivative))


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

    found = stroboscopic_map(system, start, 1, parameters=keys, margins=True).margins[row]
    assert math.isfinite(found[VALUE])
    for k, step in enumerate((1e-3, 1e-5, 1e-3)):
        expected = difference(lambda d, k=k: value(system, start + d * np.eye(3)[k]), step)
        assert found[GRADIENT + k] == pytest.approx(expected, rel=1e-6, abs=1e-6)
    for k, key in enumerate(keys):
        expected = by_key(system, key, value)
        assert found[GRADIENT + 3 + k] == pytest.approx(expected, rel=1e-6, abs=1e-6), key


def test_a_damper_too_stiff_for_derivatives_is_refused_with_the_reason():
    """Stiff arcs step over what decays at C23/I2; derivatives do not, and 1e5 of their steps would make a hundredth of
    a cycle. At a thousandth of that rate they are those of the motion all the same.
    """
    light = {"friction.law": "set_valued", "driveline.damping": 1e4, "driveline.plate_inertia": 1e-5}
    with pytest.raises(InputError, match=r"driveline.damping is 10000 N m s/rad.* more than \d+ steps a cycle"):
        stroboscopic_map(replace(System(), light), np.array([5.0, 0.1, 0.0]), 1)
    with pytest.raises(InputError, match=r"driveline\.damping is 10000"):
        check(replace(System(), light), ContinuationPlan("engine.mean_torque", 299.0, 301.0))
    system = replace(System(), {**light, "driveline.damping": 10.0})
    found = stroboscopic_map(system, np.array([5.0, 0.1, 0.0]), 1)
    run = solve(system, cycles=1, state=State(5.0, 0.1, 0.0))
    assert found.state[0] == pytest.approx(run.final.slip_speed, rel=1e-9)


KEY = "pressure.mean"
SIZES, STEPS = np.array([10.0, 0.1, 10.0]), np.array([1e-6, 1e-7, 1e-6])
PARTS = 23


def scene_of(name: str, law: str) -> System:
    return replace(load_scene(name).system, {"friction.law": law})


def settled(system: System) -> np.ndarray:
    found = solve(system, cycles=30, rtol=1e-12).cycles
    return found.section[-1]


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


@pytest.mark.parametrize("rtol", [1e-8, 1e-12])
@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
@pytest.mark.parametrize("name", ["fig02", "chaos"])
def test_parts_that_begin_anywhere_have_the_derivatives_of_differences(name: str, law: str, rtol: float) -> None:
    system = scene_of(name, law)
    x, stuck = settled(system), 0
    for k in range(PARTS):
        found = stroboscopic_map(system, x, 1.0 / PARTS, start_cycle=k / PARTS, rtol=rtol, parameters=(KEY,))
        held = law == "set_valued" and x[0] == 0.0
        expected = differences(system, x, k / PARTS, held)
        own = np.hstack([found.derivative, found.by_parameter])
        scale = np.abs(expected / SIZES[:, None]).max(axis=0) * SIZES[:, None]
        # A part at whose end the motion has just reached stick, or left it, is nearly not differentiable.
        assert (np.abs(own - expected) <= 1e-4 * np.abs(expected) + 2e-6 * scale).all(), (k, found.events)
        stuck += found.events == "S"
        x = found.state
    assert stuck > PARTS // 3


@pytest.mark.parametrize("name", ["fig02", "chaos"])
def test_parts_in_stick_have_the_derivatives_of_the_variational_equations(name: str) -> None:
    system = scene_of(name, "smoothed")
    x, seen = settled(system), 0
    for k in range(PARTS):
        found = stroboscopic_map(system, x, 1.0 / PARTS, start_cycle=k / PARTS, parameters=(KEY,))
        if found.events == "S" and seen < 3:
            unit = 1e-3 * system.pressure.mean
            state, tangent = tangent_map(system, x, k / PARTS, 1 / PARTS, by=lambda n, unit=unit: replace(
                system, {KEY: system.pressure.mean + n * unit}))
            tangent[:, 3] /= unit
            seen += 1
            assert found.state == pytest.approx(state, abs=1e-9)
            own = np.hstack([found.derivative, found.by_parameter])
            assert own == pytest.approx(tangent, rel=1e-5, abs=1e-8)
        x = found.state
    assert seen == 3
