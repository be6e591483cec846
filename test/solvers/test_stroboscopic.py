"""The stroboscopic maps of both engines: derivatives against differences of the solver, SciPy's variational equations
and closed forms, parts of a cycle that make the whole, and section points of many motions in one call.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from differences import apart, one_sided
from independent import tangent_map

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.engine import SCALES
from tcc_sim.solvers.key_derivatives import OF_ITSELF
from tcc_sim.solvers.stroboscopic import sections, stroboscopic_map
from tcc_sim.trajectory import Orbits, State, event_sequence

MU_K, MU_S, OMEGA = "friction.kinetic_coefficient", "friction.static_coefficient", "engine.frequency"
BASE = replace(System(), {"pressure.mean": 225e3, "pressure.amplitude": 0.0})
KEYS = (*OF_ITSELF, OMEGA, MU_S, MU_K, "clutch.area", "clutch.radius", "pressure.mean", "pressure.amplitude")
CASES = {
    "stick-slip": {"pressure.amplitude": 40e3, "pressure.phase": 0.7},
    "pressure at 3/2": {"pressure.amplitude": 100e3, "pressure.frequency_ratio": 1.5},
    "reversals": {"engine.mean_torque": 20.0, "engine.torque_amplitude": 900.0, "pressure.amplitude": 20e3},
    "clamped": {"pressure.amplitude": 300e3, "pressure.phase": 0.3},
    "harmonics": {"engine.harmonic_amplitudes": (100.0, 50.0), "engine.harmonic_phases": (0.3, 1.0),
                  "pressure.amplitude": 30e3},
    "r = 0.7": {MU_K: 0.43, "pressure.mean": 150e3, "pressure.amplitude": 50e3},
    "stick": {"pressure.mean": 600e3, "pressure.amplitude": 20e3},
}
START = np.array([3.0, 0.1, 2.0])
SIZES = np.array([10.0, 0.1, 10.0])
STEPS = np.array([1e-3, 1e-5, 1e-3])
CONSTANT = {"smoothed": {"pressure.amplitude": 0.0}, "set_valued": {}}
"""The load pulsates with the set-valued law alone, so that fewer kernels are compiled."""
FALLING = {"friction.kinetic_coefficient": 0.225, "engine.frequency": 120.0, "pressure.frequency_ratio": 0.5}
both = pytest.mark.parametrize("law", ["smoothed", "set_valued"])


def at(system: System, key: str) -> float:
    return float(dict(values_of(system))[key])


def end(system: System, x: np.ndarray, cycles: int = 2) -> np.ndarray:
    """The state behind some cycles by the solver."""
    result = solve(system, cycles=cycles, start_cycle=3, state=State(*map(float, x)), rtol=1e-12).raise_for_status()
    return result.cycles.section[-1]


@both
@pytest.mark.parametrize("name", CASES)
def test_derivatives_are_those_of_the_solver(name: str, law: str) -> None:
    system, start = replace(BASE, {**CASES[name], "friction.law": law}), START * [name != "stick", 1.0, 1.0]
    keys = [key for key in KEYS if key != "friction.smoothing" or law == "smoothed"]
    image = stroboscopic_map(system, start, 2, start_cycle=3, parameters=keys)
    solved = solve(system, cycles=2, start_cycle=3, state=State(*start), rtol=1e-12)
    transitions, cycles = solved.transitions, solved.cycles
    np.testing.assert_allclose(image.state, cycles.section[-1], rtol=1e-10, atol=1e-10)
    assert image.events == event_sequence([*transitions.before[:1], *transitions.after] or [solved.state[0]])
    if law == "set_valued":
        assert [(b, a) for _, b, a in image.transitions] == list(zip(transitions.before, transitions.after))
        np.testing.assert_allclose([t for t, _, _ in image.transitions], transitions.time, atol=1e-12)
    np.testing.assert_allclose(image.heights, np.maximum(cycles.highest, -cycles.lowest), atol=1e-9)
    assert image.stick_time == pytest.approx(cycles.stick_time.sum(), abs=1e-12)
    near = 1e-6 if law == "smoothed" else 1e-7
    held = law == "set_valued" and name == "stick"  # It has no derivative by the slip speed.
    for k in range(held, 3):
        step = np.eye(3)[k] * STEPS[k]
        assert apart(near, image.derivative[:, k] * STEPS[k], lambda d, s=step: end(system, start + d * s), 1.0,
                     SIZES, 1e-4 * STEPS[k] / SIZES[k]) < near, k
    for k, key in enumerate(keys):
        value = at(system, key)
        unit = 1e-5 * (abs(value) or 1.0)
        assert apart(near, image.by_parameter[:, k] * unit, lambda d, key=key, v=value, u=unit:
                     end(replace(system, {key: v + d * u}), start), 1.0, SIZES, 1e-7) < near, key


@both
def test_equal_coefficients_have_one_sided_derivatives(law: str) -> None:
    system = replace(BASE, {MU_K: 0.3, "friction.law": law})
    image = stroboscopic_map(system, START, 2, start_cycle=3, parameters=(MU_K, MU_S, OMEGA, "friction.decay"))
    for k, (key, step) in enumerate(((MU_K, -1e-5), (MU_S, 1e-5))):
        assert apart(1e-5, image.by_parameter[:, k], lambda d, key=key: end(replace(system, {key: 0.3 + d}), START),
                     step, SIZES, by=one_sided) < 1e-5
    assert apart(1e-6, image.by_parameter[:, 2], lambda d: end(replace(system, {OMEGA: 150.0 + d}), START), 1e-3,
                 SIZES) < 1e-6
    assert not image.by_parameter[:, 3].any()


@both
@pytest.mark.parametrize("mean", [225e3, 600e3])
def test_a_fast_sine_of_no_amplitude_has_derivatives_by_it(law: str, mean: float) -> None:
    """Steps would pass over it where they are as long as the motion allows, through slip and stick."""
    system = replace(BASE, {"pressure.mean": mean, "pressure.frequency_ratio": 25.0, "friction.law": law})
    image = stroboscopic_map(system, START, 2, start_cycle=3, parameters=("pressure.amplitude",))
    assert apart(1e-4, image.by_parameter[:, 0], lambda d: end(replace(system, {"pressure.amplitude": d}), START), 1e3,
                 SIZES, by=one_sided) < 1e-4


@pytest.mark.parametrize(("start", "stop", "key"), [(0.0, 0.3, MU_K), (0.5, 1.0, OMEGA)])
def test_derivatives_are_those_of_the_variational_equations(start: float, stop: float, key: str) -> None:
    system = load_scene("fig02").system
    x = end(system, np.zeros(3), 12)
    if start:
        x = stroboscopic_map(system, x, start).state
    image = stroboscopic_map(system, x, stop - start, start_cycle=start, parameters=(key,))
    unit = 1e-3 * at(system, key)
    state, tangent = tangent_map(system, x, start, stop - start,
                                 by=lambda k: replace(system, {key: at(system, key) + k * unit}))
    assert image.state == pytest.approx(state, abs=1e-7)
    derivatives = np.hstack([image.derivative, image.by_parameter * unit])
    scale = np.abs(tangent / SIZES[:, None]).max(axis=0)
    assert np.abs((derivatives - tangent) / SIZES[:, None] / scale).max() < 2e-8


@both
@pytest.mark.parametrize("cuts", [(3.0, 3.6875, 5.0), tuple(3.0 + k / 7 for k in range(15))])
def test_parts_of_a_cycle_make_the_whole(cuts: tuple[float, ...], law: str) -> None:
    system, keys = replace(BASE, {**CASES["stick-slip"], "friction.law": law}), ("pressure.phase", OMEGA)
    whole = stroboscopic_map(system, START, 2, start_cycle=3, parameters=keys)
    x, derivative, by_parameter, stick, heights = START, np.eye(3), np.zeros((3, 2)), 0.0, []
    for start, stop in pairwise(cuts):
        part = stroboscopic_map(system, x, stop - start, start_cycle=start, parameters=keys)
        x, derivative = part.state, part.derivative @ derivative
        by_parameter = part.derivative @ by_parameter + part.by_parameter
        stick += part.stick_time
        heights += list(part.heights)
    assert x == pytest.approx(whole.state, rel=1e-10, abs=1e-10)
    assert derivative == pytest.approx(whole.derivative, rel=1e-8, abs=1e-9)
    assert by_parameter == pytest.approx(whole.by_parameter, rel=1e-8, abs=1e-8)
    assert stick == pytest.approx(whole.stick_time, rel=1e-11)
    assert max(heights) == pytest.approx(whole.heights.max(), abs=1e-10)


@both
@pytest.mark.parametrize("name", ["reversals", "clamped", "stick-slip"])
def test_the_largest_slip_speed_has_its_derivatives(name: str, law: str) -> None:
    system = replace(BASE, {**CASES[name], "friction.law": law})
    keys = (OMEGA, "pressure.mean")
    image = stroboscopic_map(system, START, 2, start_cycle=3, parameters=keys)

    def heights(of: System, x: np.ndarray) -> np.ndarray:
        cycles = solve(of, cycles=2, start_cycle=3, state=State(*x), rtol=1e-12).cycles
        return np.maximum(cycles.highest, -cycles.lowest)

    for k, step in enumerate(STEPS):
        unit = np.eye(3)[k]
        assert apart(1e-5, image.heights_derivatives[:, k], lambda d, u=unit: heights(system, START + d * u), step,
                     floor=1e-2 * 10.0 / SIZES[k]) < 1e-5
    for k, key in enumerate(keys):
        value = at(system, key)
        assert apart(1e-5, image.heights_derivatives[:, 3 + k], lambda d, key=key, v=value:
                     heights(replace(system, {key: v + d}), START), 1e-5 * value, floor=1.0 / value) < 1e-5


@both
def test_pure_stick_has_the_multipliers_of_one_oscillator_and_nought(law: str) -> None:
    system = replace(BASE, {"pressure.mean": 600e3, "friction.law": law, "friction.smoothing": 5e3})
    image = stroboscopic_map(system, end(system, np.zeros(3), 12) if law == "smoothed" else START * [0.0, 1.0, 1.0], 1)
    assert image.events == "S"
    roots = np.roots([0.22, 0.6, 3000.0]) * system.cycle
    multipliers = np.linalg.eigvals(image.derivative)
    small, *pair = multipliers[np.argsort(np.abs(multipliers))]
    # sigma is finite: a start on the slow manifold forgets its slip speed, but stick creeps.
    assert abs(small) < (1e-9 if law == "smoothed" else 1e-300)
    assert np.sort_complex(pair) == pytest.approx(np.sort_complex(np.exp(roots)),
                                                  abs=1e-4 if law == "smoothed" else 1e-12)
    if law == "set_valued":
        assert not image.derivative[:, 0].any()
        assert not image.derivative[0].any()


@both
@pytest.mark.parametrize(("key", "words"), [
    ("friction.law", "continuously"), ("initial.slip_speed", "continuously"),
    ("pressure.frequency_ratio", "continuously"), ("engine.harmonic_amplitudes", "continuously"),
    ("friction.curve.rate_1", "no friction.slip_speeds"), ("engine.frequncy", "did you mean engine.frequency")])
def test_keys_without_a_derivative_are_refused(key: str, words: str, law: str) -> None:
    with pytest.raises(InputError, match=words):
        stroboscopic_map(replace(BASE, {"friction.law": law}), START, 1, parameters=(key,))


def test_an_amplitude_that_no_excitation_has_changes_nothing() -> None:
    """Where torque and pressure come from topics and hold their mean without one."""
    held = replace(BASE, {f"{part}.{name}": value for part in ("engine", "pressure")
                          for name, value in (("source", "topic"), ("fallback", "mean"))})
    keys = ("engine.torque_amplitude", "pressure.amplitude")
    assert not stroboscopic_map(held, START, 1, parameters=keys).by_parameter.any()
    assert stroboscopic_map(BASE, START, 1, parameters=keys).by_parameter.any(axis=0).all()


@pytest.mark.parametrize(("law", "rtol"), [("smoothed", 1e-8), ("set_valued", 1e-10)])
@pytest.mark.parametrize("values", [{}, {**FALLING, "pressure.amplitude": 3e5}])
def test_each_motion_is_as_solved_by_itself(law, rtol, values):
    system = replace(System(), {"friction.law": law, **values, **CONSTANT[law]})
    starts = np.array([[0.0, 0.1, 0.0], [120.0, 0.05, -3.0], [-40.0, 0.2, 1.0], [0.01, 0.1, 0.0]])
    result = sections(system, starts, 3, 5, rtol)
    assert result.shape == (4, 6, 3)
    for start, points in zip(starts, result):
        alone = solve(system, cycles=5, start_cycle=3, state=State(*start), rtol=rtol).cycles.section
        np.testing.assert_allclose(points, alone, rtol=0.0, atol=1e-12)


@both
def test_what_cannot_be_solved_is_nan_and_harms_no_other(law):
    system = replace(System(), {"friction.law": law, **CONSTANT[law]})
    starts = np.array([[0.0, 1e308, 1e308], [50.0, 0.1, 0.0]])
    result = sections(system, starts, 0, 3, 1e-8)
    assert np.isnan(result[0, 1:]).all()
    np.testing.assert_array_equal(result[1], sections(system, starts[1:], 0, 3, 1e-8)[0])


@pytest.mark.parametrize(("law", "rtol"), [("smoothed", 1e-8), ("set_valued", 1e-10)])
def test_a_motion_ends_behind_two_points_by_places_that_follow_each_other_at_their_phase(law, rtol):
    system = replace(System(), {"friction.law": law, **FALLING, **CONSTANT[law]})
    start = np.array([[120.0, 0.05, -3.0]])
    whole = sections(system, start, 3, 8, rtol)[0]
    points, reach = whole[[6, 5]] / SCALES, np.full(2, 1e-10)
    for cycle, following, end in (([1, 0], [1, 0], 6), ([0, 1], [1, 0], 8), ([1, 0], [0, 1], 8)):
        orbits = Orbits(points, reach, np.array(cycle), np.array(following), 2)
        result = sections(system, start, 3, 8, rtol, orbits)[0]
        np.testing.assert_allclose(result[:end + 1], whole[:end + 1], rtol=0.0, atol=1e-6)
        assert np.isnan(result[end + 1:]).all()
