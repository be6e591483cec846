"""Sensitivities of both engines over parts that begin anywhere in a cycle, in stick too, beside differences of their
own states and the variational equations by SciPy.
"""

import numpy as np
import pytest
from oracle import tangent_map

from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.stroboscopic import stroboscopic_map

KEY = "pressure.mean"
SIZES, STEPS = np.array([10.0, 0.1, 10.0]), np.array([1e-6, 1e-7, 1e-6])
PARTS = 23


def scene(name: str, law: str) -> System:
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
    system = scene(name, law)
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
    system = scene(name, "smoothed")
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
