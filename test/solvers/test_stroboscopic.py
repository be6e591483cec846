"""The stroboscopic map of the smoothed law: its derivatives against SciPy's variational equations and differences."""

import math

import central_differences
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.stroboscopic import stroboscopic_map

SIZES = np.array([10.0, 0.1, 10.0])
VARYING = load_scene("fig02").system
CLAMPED = replace(VARYING, {"pressure.amplitude": 1.5 * VARYING.pressure.mean})
HARMONICS = replace(VARYING, {"engine.harmonic_amplitudes": [60.0, 30.0], "engine.harmonic_phases": [0.3, 1.0],
                              "pressure.frequency_ratio": 0.5, "pressure.phase": 0.4})
EQUAL = replace(load_scene("minimal").system, {"friction.law": "smoothed"})
KEYS = ("driveline.flywheel_inertia", "driveline.plate_inertia", "driveline.damping", "driveline.stiffness",
        "friction.static_coefficient", "friction.kinetic_coefficient", "friction.decay", "friction.smoothing",
        "clutch.area",
        "clutch.radius", "engine.mean_torque", "engine.torque_amplitude", "engine.frequency", "pressure.mean",
        "pressure.amplitude", "pressure.phase")


def settled(system: System, cycles: int = 12) -> np.ndarray:
    found = solve(system, cycles=cycles, rtol=1e-9).cycles
    assert found is not None
    return found.section[-1]


def rates(phase: float, y: np.ndarray, system: System) -> np.ndarray:
    """The equations of motion (1) to (7) by the phase omega t, written out again."""
    d, e, p, f = system.driveline, system.engine, system.pressure, system.friction
    v, angle, speed = y
    torque = e.mean_torque + e.torque_amplitude * math.sin(phase)
    for n, (a, shift) in enumerate(zip(e.harmonic_amplitudes, e.harmonic_phases), 2):
        torque += a * math.sin(n * phase + shift)
    pressure = max(p.mean + p.amplitude * math.sin(p.frequency_ratio * phase + p.phase), 0.0)
    law = 1.0 + (f.static_coefficient / f.kinetic_coefficient - 1.0) * math.exp(-f.decay * abs(v))
    clutch = system.clutch
    friction = f.kinetic_coefficient * clutch.area * clutch.radius * pressure * law * math.tanh(f.smoothing * v)
    plate = (friction - d.damping * speed - d.stiffness * angle) / d.plate_inertia
    return np.array([(torque - friction) / d.flywheel_inertia - plate, speed, plate]) / e.frequency


def varied(system: System, x: np.ndarray, start: float, end: float, key: str) -> tuple[np.ndarray, np.ndarray]:
    """State and derivatives by the state and one key, from the variational equations by SciPy's LSODA."""
    at = dict(values_of(system))[key]
    h = 1e-3 * at if at else 1e-3
    moved = {k: replace(system, {key: at + k * h}) for k in (-2, -1, 1, 2)}

    def slope(phase: float, y: np.ndarray) -> np.ndarray:
        f, law = system.friction, np.empty((3, 3))
        for k in range(1, 3):
            e = np.zeros(3)
            e[k] = 1.0  # Linear in the plate's angle and speed.
            law[:, k] = rates(phase, y + e, system) - rates(phase, y, system)
        v, excess = y[0], f.static_coefficient / f.kinetic_coefficient - 1.0
        falling, step = excess * math.exp(-f.decay * abs(v)), math.tanh(f.smoothing * v)
        part = f.smoothing * (1.0 + falling) * (1.0 - step * step) - f.decay * falling * math.copysign(1.0, v) * step
        pressure = system.pressure
        swing = pressure.amplitude * math.sin(pressure.frequency_ratio * phase + pressure.phase)
        load = max(pressure.mean + swing, 0.0)
        rise = system.torque_per_pressure * load * part / system.engine.frequency
        law[:, 0] = -rise * system.inverse_inertia, 0.0, rise / system.driveline.plate_inertia
        return law

    def right(phase: float, z: np.ndarray) -> np.ndarray:
        y, tangent = z[:3], z[3:].reshape(3, 4)
        out = slope(phase, y) @ tangent
        a, b, c, d = (rates(phase, y, moved[k]) for k in (-2, -1, 1, 2))
        out[:, 3] += (a - 8.0 * b + 8.0 * c - d) / (12.0 * h)
        return np.concatenate([rates(phase, y, system), out.ravel()])

    def jacobian(phase: float, z: np.ndarray) -> np.ndarray:
        out, a = np.zeros((15, 15)), slope(phase, z[:3])
        out[:3, :3], out[3:, 3:] = a, np.kron(a, np.eye(4))  # Only steers LSODA's Newton iteration.
        return out

    initial = np.concatenate([x, np.eye(3, 4).ravel()])
    found = solve_ivp(right, (2.0 * math.pi * start, 2.0 * math.pi * end), initial, method="LSODA", rtol=1e-11,
                      atol=1e-13, jac=jacobian)
    return found.y[:3, -1], found.y[3:, -1].reshape(3, 4)


@pytest.mark.parametrize(("start", "end", "key"), [(0.0, 0.3, "friction.kinetic_coefficient"),
                                                   (0.5, 1.0, "engine.frequency")])
def test_derivatives_are_those_of_the_variational_equations(start: float, end: float, key: str) -> None:
    x = settled(VARYING)
    if start:
        x = stroboscopic_map(VARYING, x, start).state
    found = stroboscopic_map(VARYING, x, end - start, start_cycle=start, parameters=(key,))
    state, tangent = varied(VARYING, x, start, end, key)
    assert found.state == pytest.approx(state, abs=1e-7)
    own = np.hstack([found.derivative, found.by_parameter])
    scale = np.abs(tangent / SIZES[:, None]).max(axis=0)
    assert np.abs((own - tangent) / SIZES[:, None] / scale).max() < 2e-8


@pytest.mark.parametrize(("system", "keys"), [
    (VARYING, KEYS), (CLAMPED, KEYS[:3] + KEYS[4:6] + KEYS[12:]), (HARMONICS, KEYS[2:4] + KEYS[9:13]),
    (EQUAL, ("driveline.damping", "friction.smoothing", "engine.frequency", "pressure.mean")),
    (EQUAL, ("friction.static_coefficient",))])
def test_derivatives_are_those_of_differences(system: System, keys: tuple[str, ...]) -> None:
    x = settled(system)
    found = stroboscopic_map(system, x, 1, start_cycle=12, parameters=keys)
    expected = central_differences.stroboscopic_map(system, x, 1, start_cycle=12, parameters=keys)
    assert found.events == expected.events
    assert found.state == pytest.approx(expected.state, abs=1e-9)
    own = np.hstack([found.derivative * SIZES, found.by_parameter]) / SIZES[:, None]
    other = np.hstack([expected.derivative * SIZES, expected.by_parameter]) / SIZES[:, None]
    assert np.abs(own - other).max(axis=0) == pytest.approx(0.0, abs=1e-6 * max(1.0, np.abs(other[:, :3]).max()))
    large = np.abs(other).max(axis=0) > 1e-2
    assert (np.abs(own - other).max(axis=0) / np.abs(other).max(axis=0))[large].max() < 2e-5


def test_parts_of_a_cycle_make_the_whole() -> None:
    x, keys = settled(VARYING), ("pressure.phase",)
    whole = stroboscopic_map(VARYING, x, 2, parameters=keys)
    first = stroboscopic_map(VARYING, x, 0.6875, parameters=keys)
    second = stroboscopic_map(VARYING, first.state, 1.3125, start_cycle=0.6875, parameters=keys)
    assert second.state == pytest.approx(whole.state, abs=1e-10)
    assert second.derivative @ first.derivative == pytest.approx(whole.derivative, abs=1e-9)
    assert second.derivative @ first.by_parameter + second.by_parameter == pytest.approx(whole.by_parameter, abs=1e-8)
    assert max(*first.heights, second.heights[0]) == pytest.approx(whole.heights[0], abs=1e-11)
    assert first.stick_time + second.stick_time == pytest.approx(whole.stick_time, abs=1e-12)


def test_the_largest_slip_speed_has_its_derivatives() -> None:
    x, key = settled(VARYING), "pressure.mean"
    found = stroboscopic_map(VARYING, x, 2, parameters=(key,))
    mean = VARYING.pressure.mean
    columns = found.heights_by_state[:, 0], found.heights_by_state[:, 1], found.heights_by_parameter[:, 0]
    for column, by in enumerate(columns):
        h = (1e-4, 1e-6, 1e-4 * mean)[column]
        sides = []
        for sign in (1.0, -1.0):
            moved = x + np.eye(3)[column] * sign * h if column < 2 else x
            system = replace(VARYING, {key: mean + sign * h}) if column == 2 else VARYING
            sides.append(stroboscopic_map(system, moved, 2).heights)
        assert by == pytest.approx((sides[0] - sides[1]) / (2.0 * h), rel=1e-5, abs=1e-7)


def test_a_start_on_the_slow_manifold_forgets_its_slip_speed() -> None:
    system = replace(load_scene("stick").system, {"friction.smoothing": 5e3})
    x = settled(system)
    found = stroboscopic_map(system, x, 1)
    i1, i2 = system.driveline.flywheel_inertia, system.driveline.plate_inertia
    roots = np.roots([i1 + i2, system.driveline.damping, system.driveline.stiffness]) * system.cycle
    values = np.linalg.eigvals(found.derivative)
    slow = values[np.argsort(-np.abs(values))]
    assert abs(slow[2]) < 1e-9
    assert np.sort_complex(slow[:2]) == pytest.approx(np.sort_complex(np.exp(roots)), abs=1e-4)  # sigma is finite.


def test_keys_without_a_derivative_are_refused() -> None:
    with pytest.raises(InputError, match=r"initial\.slip_speed"):
        stroboscopic_map(VARYING, np.zeros(3), 1, parameters=("initial.slip_speed",))


def test_parts_that_start_in_stick_have_the_derivatives_of_the_whole() -> None:
    """Collocation steps over stick at once where a part starts on the slow manifold, but for a few series steps."""
    system = replace(VARYING, {"pressure.amplitude": 0.0, "pressure.mean": 225e3, "friction.kinetic_coefficient": 0.255,
                               "engine.frequency": 0.36 * VARYING.natural_frequency, "initial.slip_speed": 150.0})
    x = settled(system, 300)
    whole, product, at = stroboscopic_map(system, x, 1.0), np.eye(3), x
    assert whole.events == "S"
    for k in range(7):
        part = stroboscopic_map(system, at, (k + 1) / 7 - k / 7, start_cycle=k / 7)
        product, at = part.derivative @ product, part.state
    assert at == pytest.approx(whole.state, abs=1e-11)
    one, two = (np.sort_complex(np.linalg.eigvals(m)) for m in (product, whole.derivative))
    assert np.abs(one - two).max() < 1e-8
