"""Known largest Lyapunov exponents: stick, slip, Floquet multipliers, and SciPy's variational equations.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from differences import difference
from independent import tangent_map
from scipy.stats import sem, t

from tcc_sim.analysis.steady.exponents import (
    CONFIDENCE,
    FIRST,
    batch_means,
    change_of_averages,
    diagnosis,
    floquet_exponent,
    largest_lyapunov_exponent,
    mapped,
    tangent_growth,
)
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import State, solve
from tcc_sim.solvers.stroboscopic import sections
from tcc_sim.sweeps.simulation import simulate

BASE = {"pressure.mean": 225e3, "pressure.amplitude": 0.0, "friction.kinetic_coefficient": 0.3,
        "engine.frequency": 139.0}


def section_of(system: System, cycles: int) -> np.ndarray:
    """The state on the section after some cycles."""
    end = solve(system, cycles=cycles).final
    return np.array([end.slip_speed, end.plate_angle, end.plate_speed])


def by_differences(system: System, at: np.ndarray, first: int, cycles: int) -> float:
    """The exponent of a periodic motion in stick at phase 0, where the map is one of plate angle and speed, from the
    solver.
    """
    def end(x: np.ndarray) -> np.ndarray:
        result = solve(system, cycles=cycles, start_cycle=first, state=State(*x), rtol=1e-12).raise_for_status().final
        return np.array([result.plate_angle, result.plate_speed])

    matrix = np.column_stack([difference(lambda d, u=unit: end(at + d * u), step)
                              for unit, step in zip(np.eye(3)[1:], (1e-7, 1e-5))])
    return math.log(np.abs(np.linalg.eigvals(matrix)).max()) / (cycles * system.cycle)


@pytest.mark.parametrize(("scene", "values"), [
    ("fig02", {"friction.smoothing": 1e3, "pressure.frequency_ratio": 0.5, "pressure.phase": 1.0}), ("chaos", {})])
def test_the_tangent_map_is_that_of_scipys_variational_equations(scene: str, values: dict[str, object]) -> None:
    system = replace(load_scene(scene).system, values)
    start = section_of(system, 31)
    state, tangent = tangent_map(system, start, 31, 1, 1e-9)
    at, matrix = mapped(system, start, 31, 1, 1e-9)
    assert at == pytest.approx(state, rel=1e-6, abs=1e-6)
    assert matrix == pytest.approx(tangent, rel=1e-5, abs=1e-5 * np.abs(tangent).max())


def test_a_step_that_cannot_be_taken_is_said_and_no_exponent_is_given() -> None:
    system = load_scene("fig02").system
    assert np.isnan(mapped(system, np.array([math.nan, 0.0, 0.0]), 0, 1, 1e-8)[1]).all()
    result = largest_lyapunov_exponent(system, State(math.nan, 0.0, 0.0), cycles=40)
    assert math.isnan(result.exponent)
    assert (result.diagnosis, result.as_json()["exponent"]) == ("unresolved", None)


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
def test_in_stick_it_is_the_decay_of_the_stuck_oscillator(law: str) -> None:
    system = replace(System(), {**BASE, "friction.law": law, "pressure.mean": 400e3, "engine.torque_amplitude": 20.0,
                                "friction.smoothing": 1e6, "initial.slip_speed": 0.0, "initial.plate_angle": 0.1})
    end = solve(system, cycles=40).final
    for period in (0, 1):
        result = largest_lyapunov_exponent(system, end, cycles=100, period=period)
        near = 1e-3 if period == 0 else 1e-5 if law == "smoothed" else 1e-9
        assert result.exponent == pytest.approx(-0.6 / (2.0 * 0.22), rel=near)
        assert result.diagnosis == ("periodic" if period else "contracting")


def test_in_slip_at_constant_friction_it_is_zero() -> None:
    system = replace(System(), {**BASE, "engine.mean_torque": 540.0})
    result = largest_lyapunov_exponent(system, State(150.0, 0.18, 0.0), cycles=100)
    assert result.exponent == pytest.approx(0.0, abs=1e-2)
    # A family of motions: the map has no single fixed point that Newton's method could look for.
    assert largest_lyapunov_exponent(system, State(150.0, 0.18, 0.0), period=1).exponent == pytest.approx(0.0, abs=1e-6)


def test_a_periodic_motion_has_the_exponent_of_its_floquet_multiplier() -> None:
    """By LSODA's variational equations."""
    system = load_scene("fig02").system
    at = section_of(system, 2000)
    result = largest_lyapunov_exponent(system, State(*at), start_cycle=2000, period=1)
    expected = math.log(np.abs(np.linalg.eigvals(tangent_map(system, at, 0, 1, 1e-9)[1])).max()) / system.cycle
    assert result.low - 1e-6 <= expected <= result.high + 1e-6
    assert result.exponent == pytest.approx(expected, rel=5e-5)
    assert (result.diagnosis, result.cycles) == ("periodic", 1)


def test_the_exponent_of_sharp_smoothing_is_that_of_the_set_valued_law() -> None:
    exponents = []
    for values in ({"friction.law": "set_valued"}, {"friction.smoothing": 1e5}):
        system = replace(load_scene("fig02").system, {"friction.kinetic_coefficient": 0.285, **values})
        at = section_of(system, 300)
        result = largest_lyapunov_exponent(system, State(*at), start_cycle=300, period=1)
        assert result.exponent == pytest.approx(by_differences(system, at, 300, 1), rel=2e-4)
        exponents.append(result.exponent)
    assert exponents[1] == pytest.approx(exponents[0], rel=2e-3)


def test_a_state_beside_the_motion_gives_the_exponent_of_the_motion() -> None:
    system = load_scene("fig02").system
    at = section_of(system, 300)
    exact, _ = floquet_exponent(system, at, 0, 1)
    perturbed, error = floquet_exponent(system, at + np.array([0.0, 1e-4, 0.02]), 0, 1)
    assert perturbed == pytest.approx(exact, abs=max(error, 1e-5))


def test_an_orbit_that_a_motion_only_passes_by_gives_no_exponent() -> None:
    """Fig. 2 with law (6) is for hundreds of cycles beside an unstable motion of period one, then of period two."""
    system = replace(load_scene("fig02").system, {"friction.law": "set_valued"})
    passing = State(*section_of(system, 60))
    settled = section_of(system, 2000)
    assert settled[0] == 0.0
    expected = by_differences(system, settled, 0, 2)
    result = largest_lyapunov_exponent(system, passing, start_cycle=60)
    assert (result.diagnosis, result.cycles) == ("periodic", 2)
    assert result.exponent == pytest.approx(expected, rel=1e-3)
    nearby = largest_lyapunov_exponent(system, passing, start_cycle=60, period=1)
    assert nearby.diagnosis == "unresolved"
    assert math.isnan(nearby.exponent)


def test_the_multipliers_of_a_half_frequency_load_belong_to_two_cycles() -> None:
    values = {"pressure.frequency_ratio": 0.5, "friction.kinetic_coefficient": 0.285}
    system = replace(load_scene("fig02").system, values)
    result = largest_lyapunov_exponent(system, State(*section_of(system, 300)), start_cycle=300, period=1)
    assert result.cycles == 2
    largest = np.abs(np.linalg.eigvals(tangent_map(system, section_of(system, 300), 300, 2, 1e-8)[1])).max()
    assert result.exponent == pytest.approx(math.log(largest) / (2.0 * system.cycle), rel=1e-3)


def energy(system: System, vector: np.ndarray) -> float:
    """The norm of a disturbance."""
    d, (v, angle, speed) = system.driveline, vector
    return math.sqrt(d.flywheel_inertia * (v + speed) ** 2 + d.plate_inertia * speed**2 + d.stiffness * angle**2)


def test_the_growth_along_a_chaotic_motion_is_that_of_scipys_variational_equations() -> None:
    """The same orbit for as long as two programs stay together."""
    system = load_scene("chaos").system
    start = section_of(system, 100)
    growth, rough, run = tangent_growth(system, start, 100, 8)
    vector, expected = FIRST, []
    for n in range(8):
        vector = tangent_map(system, run.section[n], 100 + n, 1, 1e-9)[1] @ vector
        expected.append(math.log(energy(system, vector)))
        vector /= energy(system, vector)
    assert growth == pytest.approx(expected, abs=1e-3)
    assert np.abs(rough).max() < 1e-2
    again = solve(system, cycles=8, state=State(*start), start_cycle=100).cycles
    assert np.array_equal(run.section, again.section)  # What else is asked of these cycles needs no second solve.


def test_the_interval_of_a_chaotic_motion_has_the_growth_of_the_distance_to_a_motion_beside_it() -> None:
    """Brought back to 1e-7 at the end of every cycle."""
    system, vector, growth = load_scene("chaos").system, FIRST, []
    start = State(*section_of(system, 110))
    result = largest_lyapunov_exponent(system, start, cycles=400, start_cycle=110)
    assert result.diagnosis == "chaotic"
    trajectory = solve(system, cycles=400, state=start, start_cycle=110).cycles
    for n, (x, following) in enumerate(pairwise(trajectory.section), 110):
        vector = 1e-7 / energy(system, vector) * vector
        vector = sections(system, (x + vector)[None], n, 1, 1e-10)[0, 1] - following
        growth.append(math.log(energy(system, vector) / 1e-7))
    assert result.low < np.mean(growth) / system.cycle < result.high


def test_the_interval_of_a_mean_is_students_of_the_means_of_batches() -> None:
    growth = np.random.default_rng(1).normal(0.3, 0.2, 2007)
    means = [growth[7 + 100 * k:107 + 100 * k].mean() for k in range(20)]
    mean, half = batch_means(growth)
    assert mean == pytest.approx(growth[7:].mean())
    assert (mean - half, mean + half) == pytest.approx(t.interval(CONFIDENCE, 19, np.mean(means), sem(means)))


def test_diagnosis_looks_at_the_whole_interval() -> None:
    assert diagnosis(0.2, 0.1) == "chaotic"
    assert diagnosis(0.25, 0.25) == diagnosis(-0.25, 0.25) == "unresolved"
    assert (diagnosis(0.0, 0.02), diagnosis(0.0, 0.0201)) == ("quasi-periodic", "unresolved")
    assert diagnosis(0.2, 0.3) == "unresolved"
    assert diagnosis(0.001, 0.004) == "quasi-periodic"
    assert diagnosis(-0.2, 0.01) == "contracting"
    assert diagnosis(-0.2, 0.3) == "unresolved"


def test_a_runaway_is_not_quasi_periodic() -> None:
    system = replace(load_scene("chaos").system, {"friction.kinetic_coefficient": 0.15})
    result = simulate(system, cycles=150, lyapunov=True)
    assert (result.lyapunov.diagnosis, result.summary.runaway) == ("runaway", True)


@pytest.mark.parametrize(("coefficient", "settling", "verdicts", "cycles"), [
    (0.195, 600, {"periodic"}, 30), (0.201, 150, {"chaotic", "unresolved"}, 2000)])
def test_long_periods_and_weak_chaos_are_not_quasi_periodic(coefficient: float, settling: int, verdicts: set[str],
                                                            cycles: int) -> None:
    """Beside the jump of Fig. 4 at 0.2057: period 30 at 0.65, and at 0.67 weak chaos, of exponent 0.03 to 0.09 1/s
    over 30 000 cycles.
    """
    system = replace(load_scene("chaos").system, {"engine.frequency": 0.2057 * System().natural_frequency,
                                                  "friction.kinetic_coefficient": coefficient})
    result = largest_lyapunov_exponent(system, State(*section_of(system, settling)), start_cycle=settling)
    assert result.diagnosis in verdicts
    assert result.cycles == cycles


def test_slip_under_a_load_of_a_golden_ratio_is_quasi_periodic() -> None:
    """By (14) the slip is a constant and sines of both excitations where Tm = Tsm, and so fast that mu is mu_k."""
    golden = replace(System(), {**BASE, "engine.mean_torque": 432.0, "friction.kinetic_coefficient": 0.24,
                                "pressure.amplitude": 20e3,
                                "pressure.frequency_ratio": 0.5 * (1.0 + math.sqrt(5.0)), "initial.plate_angle": 0.18})
    result = simulate(golden, cycles=300, lyapunov=True)
    assert result.lyapunov.diagnosis == "quasi-periodic"
    points = solve(golden, cycles=2000).cycles.section[100:]
    assert change_of_averages(points) < 1e-8
    chaos = solve(load_scene("chaos"), cycles=2000).cycles.section[100:]
    assert change_of_averages(chaos) > 1e-4  # Some 1e-3, by how the motion happens to go.


@pytest.mark.parametrize("cycles", [39, 10_000_001])
def test_a_number_of_cycles_without_an_interval_is_refused(cycles: int) -> None:
    with pytest.raises(InputError) as error:
        largest_lyapunov_exponent(System(), State(0.0, 0.0, 0.0), cycles=cycles)
    assert all(word in str(error.value) for word in ("cycles", str(cycles), "40 to 10000000"))
