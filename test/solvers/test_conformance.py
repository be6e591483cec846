"""Conformance of every registered solver: one suite over the registry; SciPy's methods, and the reported time."""

from __future__ import annotations

import time
from dataclasses import astuple
from functools import cache

import numpy as np
import pytest
from independent import Piecewise, smoothed_states
from scipy.integrate import trapezoid

from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import SOLVERS, solve
from tcc_sim.sweeps.simulation import simulate
from tcc_sim.trajectory import State, Status, Trajectory

START = State(5.0, 0.1, -5.0, 0.1)
STICK_SLIP = {"pressure.mean": 225e3, "pressure.amplitude": 45e3, "pressure.frequency_ratio": 0.5,
              "friction.kinetic_coefficient": 0.24, "engine.frequency": 142.0, "friction.smoothing": 8.0,
              "engine.mean_torque": 40.0, "engine.torque_amplitude": 900.0,
              "initial.slip_speed": START.slip_speed, "initial.plate_angle": START.plate_angle,
              "initial.plate_speed": START.plate_speed}
"""Sticks and slips in both directions; the smoothing keeps explicit methods affordable."""

solvers = pytest.mark.parametrize("name", [name for name in SOLVERS if name not in ("dop853", "bdf", "radau")])
"""Without methods of SciPy that go the way of lsoda."""


def compared(name: str) -> bool:
    """Return whether the solver is one for comparison: looser, since some of these methods are slow."""
    return SOLVERS[name].module == "comparison"


def tight(name: str, factor: float = 1.0) -> dict[str, float]:
    """Return a setting at which the solver keeps `accuracy`; a larger factor is looser."""
    if SOLVERS[name].setting == "rtol":
        return {"rtol": (1e-7 if compared(name) else 1e-9) * factor}
    return {"step": 4e-6 * factor}


def loose(name: str) -> float:
    """Return the factor of a setting that is quick."""
    return 64.0 if SOLVERS[name].setting == "rtol" else 4.0


def accuracy(name: str) -> float:
    """Return the error relative to each signal's size that a solver keeps at its `tight` setting."""
    return 1e-4 if compared(name) else 1e-6 if SOLVERS[name].setting == "rtol" else 2e-5


def system_for(name: str, **values: object) -> System:
    law = "smoothed" if "smoothed" in SOLVERS[name].laws else "set_valued"
    return replace(System(), {**STICK_SLIP, "friction.law": law, **values})


def run(name: str, system: System, factor: float = 1.0, **options: object) -> Trajectory:
    return solve(system, solver=name, **tight(name, factor), **options).raise_for_status()


@cache
def truth(law: str, cycles: int, per_cycle: int) -> np.ndarray:
    system = system_for("smoothed" if law == "smoothed" else "event_driven")
    start = (START.slip_speed, START.plate_angle, START.plate_speed, START.flywheel_angle)
    if system.friction.law == "smoothed":
        return smoothed_states(system, start, cycles, per_cycle)
    times = np.arange(cycles * per_cycle + 1) * (system.cycle / per_cycle)
    return Piecewise(system).run(cycles * system.cycle, times, slices=40 * cycles)[0]


@cache
def whole(name: str) -> Trajectory:
    """Two cycles with all that can be stored."""
    return run(name, system_for(name), cycles=2, samples_per_cycle=40, flywheel_angle=True)


def states_of(result: Trajectory) -> np.ndarray:
    return np.stack([result.slip_speed, result.plate_angle, result.plate_speed, result.flywheel_angle], axis=1)


@pytest.mark.parametrize("name", SOLVERS)
def test_it_agrees_with_an_independent_solution(name: str) -> None:
    result = whole(name)
    exact = truth(result.system.friction.law, 1, 40)
    states = states_of(result)[:41]
    error = np.abs(states - exact).max(axis=0) / np.abs(exact).max(axis=0)
    assert error.max() <= accuracy(name)
    assert {-1, 0, 1} <= set(result.state.tolist())


@solvers
def test_engine_work_is_stored_or_lost(name: str) -> None:
    system = system_for(name)
    d = system.driveline
    result = run(name, system, cycles=1, samples_per_cycle=4000)
    v, w = result.slip_speed, result.plate_speed
    power = result.engine_torque * (v + w) - result.friction_torque * v - d.damping * w**2
    energy = 0.5 * (d.flywheel_inertia * (v + w)**2 + d.plate_inertia * w**2 + d.stiffness * result.plate_angle**2)
    through = trapezoid(np.abs(result.engine_torque * (v + w)), result.t)
    assert abs(energy[-1] - energy[0] - trapezoid(power, result.t)) <= accuracy(name) * through


@solvers
@pytest.mark.parametrize("part", [0.03, 1.0 + 2.0**-42])
def test_it_ends_exactly_where_it_was_asked_to(name: str, part: float) -> None:
    system = system_for(name)
    began = time.perf_counter()
    result = run(name, system, loose(name), duration=part * system.cycle, samples_per_cycle=7)
    assert 0.0 < result.statistics.seconds <= time.perf_counter() - began
    assert result.t[-1] == part * system.cycle
    assert result.t[0] == 0.0
    assert np.all(np.diff(result.t) > 0.0)
    assert len(result.cycles or ()) == int(part)


@solvers
def test_a_run_goes_on_from_any_cycle_boundary(name: str) -> None:
    system, states = system_for(name), states_of(whole(name))[::40]
    rest = run(name, system, cycles=1, start_cycle=1, state=State(*states[1]), flywheel_angle=True)
    assert rest.t[0] == system.cycle
    assert astuple(rest.final) == pytest.approx(states[2], rel=accuracy(name), abs=1e-6)


@pytest.mark.parametrize("name", [name for name in SOLVERS if not compared(name)])
def test_a_start_beyond_all_bounds_ends_with_a_status(name: str) -> None:
    result = solve(system_for(name), cycles=1, solver=name, state=State(1e300, 0.0, -1e300))
    assert result.status is not Status.DONE or np.all(np.isfinite(result.slip_speed))


FALLING = replace(System(), {"pressure.mean": 225e3, "pressure.amplitude": 5e4, "friction.kinetic_coefficient": 0.24,
                             "engine.frequency": 142.0, "initial.slip_speed": 1.0})


def test_blow_up_is_a_status() -> None:
    system = replace(FALLING, {"friction.smoothing": 1e6, "driveline.plate_inertia": 1e-3, "driveline.damping": 100.0})
    result = solve(system, cycles=30, solver="rk4", step=1e-3)
    assert result.status is Status.NOT_FINITE
    assert np.all(np.isfinite(result.slip_speed))


def test_a_step_of_rk4_that_lets_stick_ring_is_doubtful() -> None:
    scene = load_scene("fig02").with_values({"initial.slip_speed": 0.0, "friction.smoothing": 5.0, "pressure.amplitude":
                                             1.0, "engine.torque_amplitude": 1.0})
    system = scene.system
    limit = 2.785 / (system.inverse_inertia * (system.saturation_mean + system.saturation_amplitude)
                     * system.friction_ratio * system.friction.smoothing)

    def warned(step: float, **change: float) -> list[str] | None:
        keys = {key.replace("__", "."): value for key, value in change.items()}
        return simulate(scene.with_values(keys), cycles=2, discard=1, solver="rk4", step=step).warnings

    assert warned(1.01 * limit) == [
        f"rk4: the step of {1.01 * limit:g} s is above {limit:.3g} s, the largest one that is stable in stick"]
    assert warned(0.99 * limit) is None
    assert warned(50.0 * limit, engine__mean_torque=800.0, initial__slip_speed=50.0) is None


def test_too_many_steps_are_refused() -> None:
    system = replace(System(), {"engine.frequency": 1.0})
    assert solve(system, cycles=1000, solver="rk4", step=1e-9).status is Status.REFUSED


@pytest.mark.parametrize(("name", "cycles"), [
    *((name, None) for name in SOLVERS if name not in ("bdf", "dop853", "radau")), *(
        (name, 3) for name in SOLVERS if not compared(name) or name == "lsoda")])
def test_samples_change_nothing_else_and_lie_on_the_run(name: str, cycles: int | None) -> None:
    """Samples at the starts of cycles are the section; the extremes of many samples are those of the cycles."""
    law = {"friction.law": "set_valued"} if name == "event_driven" else {"friction.smoothing": 5.0}
    system = replace(FALLING, law)
    span = {"cycles": cycles} if cycles else {"duration": 3.4 * system.cycle}
    setting = {} if not compared(name) else {"step": 2e-5} if name == "rk4" else {"rtol": 1e-4}
    none, few, many = (solve(system, solver=name, samples_per_cycle=count, **span, **setting) for count in (0, 3, 400))
    for run in (few, many):
        for column in ("section", "highest", "lowest", "stick_time"):
            np.testing.assert_array_equal(getattr(run.cycles, column), getattr(none.cycles, column))
        assert run.statistics.steps == none.statistics.steps
        assert run.final == none.final
    states = np.stack([many.slip_speed, many.plate_angle, many.plate_speed], axis=1)
    size = np.abs(states).max(axis=0)
    np.testing.assert_allclose(states[:1201:400] / size, none.cycles.section / size, atol=1e-6)
    np.testing.assert_allclose(many.slip_speed[::400][:3], few.slip_speed[::3][:3], atol=1e-9 * size[0])
    highest = many.slip_speed[:1200].reshape(3, 400).max(axis=1)
    np.testing.assert_allclose(highest, none.cycles.highest, atol=2e-4 * size[0])
