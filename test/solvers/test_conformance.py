"""Conformance of every registered solver: one suite over the registry, so that a new row is tested."""

from __future__ import annotations

import math
import time
from functools import cache

import numpy as np
import pytest
from oracle import smoothed_states
from piecewise import Piecewise
from scipy.integrate import trapezoid

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import SOLVERS, solve
from tcc_sim.trajectory import State, Status, Trajectory

START = State(5.0, 0.1, -5.0, 0.1)
STICK_SLIP = {"pressure.mean": 225e3, "pressure.amplitude": 45e3, "pressure.frequency_ratio": 0.5,
              "friction.kinetic_coefficient": 0.24, "engine.frequency": 142.0, "friction.smoothing": 8.0,
              "initial.slip_speed": START.slip_speed, "initial.plate_angle": START.plate_angle,
              "initial.plate_speed": START.plate_speed}
"""Sticks and slips in both directions of the step; the smoothing keeps explicit methods affordable."""

solvers = pytest.mark.parametrize("name", SOLVERS)


def compared(name: str) -> bool:
    """Return whether the solver is one for comparison: looser, since some of these methods are slow."""
    return SOLVERS[name].module.startswith("comparison.")


def tight(name: str, factor: float = 1.0) -> dict[str, float]:
    """Return a setting at which the solver keeps `accuracy`; a larger factor is looser."""
    if SOLVERS[name].setting == "rtol":
        return {"rtol": (1e-7 if compared(name) else 1e-9) * factor}
    return {"step": 1e-6 * factor}


def loose(name: str) -> float:
    """Return the factor of a setting that is quick."""
    return 64.0 if SOLVERS[name].setting == "rtol" else 6.0


def accuracy(name: str) -> float:
    """Return the error relative to each signal's size that a solver keeps at its `tight` setting."""
    return 1e-4 if compared(name) else 1e-6 if SOLVERS[name].setting == "rtol" else 2e-5


def system_for(name: str, **values: object) -> System:
    law = "smoothed" if "smoothed" in SOLVERS[name].laws else "set_valued"
    return replace(System(), {**STICK_SLIP, "friction.law": law, **values})


def run(name: str, system: System, factor: float = 1.0, **options: object) -> Trajectory:
    return solve(system, solver=name, **tight(name, factor), **options).raise_for_status()  # type: ignore[arg-type]


@cache
def truth(law: str, cycles: int, per_cycle: int) -> np.ndarray:
    system = system_for("smoothed" if law == "smoothed" else "event_driven")
    start = (START.slip_speed, START.plate_angle, START.plate_speed, START.flywheel_angle)
    if system.friction.law == "smoothed":
        return smoothed_states(system, start, cycles, per_cycle)
    times = np.arange(cycles * per_cycle + 1) * (system.cycle / per_cycle)
    return Piecewise(system).run(cycles * system.cycle, times, slices=40 * cycles)[0]


@solvers
def test_it_agrees_with_an_independent_solution(name: str) -> None:
    system = system_for(name)
    found = run(name, system, cycles=1, samples_per_cycle=40)
    exact = truth(system.friction.law, 1, 40)
    states = np.stack([found.slip_speed, found.plate_angle, found.plate_speed], axis=1)
    error = np.abs(states - exact[:, :3]).max(axis=0) / np.abs(exact[:, :3]).max(axis=0)
    assert error.max() <= accuracy(name)
    assert {0, 1} <= set(found.state.tolist())


@solvers
def test_a_tighter_setting_is_nearer_the_truth(name: str) -> None:
    system = system_for(name)
    exact = truth(system.friction.law, 1, 8)[-1, :3]
    size = np.array([10.0, 0.3, 20.0])
    coarse, fine = (np.abs(np.array([r.slip_speed[-1], r.plate_angle[-1], r.plate_speed[-1]]) - exact) / size
                    for r in (run(name, system, factor, cycles=1) for factor in (loose(name), 1.0)))
    assert fine.max() <= max(0.25 * coarse.max(), 2e-9)


@solvers
def test_turning_every_sign_turns_the_motion(name: str) -> None:
    values = {"engine.torque_amplitude": 0.0, "engine.harmonic_amplitudes": (600.0,)}
    straight = run(name, system_for(name, **values, **{"engine.harmonic_phases": (0.3,)}), cycles=1,
                   samples_per_cycle=9)
    turned = run(name, system_for(name, **values, **{
        "engine.harmonic_phases": (0.3 - math.pi,), "engine.mean_torque": -300.0, "initial.slip_speed": -5.0,
        "initial.plate_angle": -0.1, "initial.plate_speed": 5.0}), cycles=1, samples_per_cycle=9)
    scale = np.abs(straight.slip_speed).max()
    assert np.abs(straight.slip_speed + turned.slip_speed).max() <= (accuracy(name) if compared(name) else 1e-8) * scale
    assert straight.cycles is not None
    assert turned.cycles is not None
    assert straight.cycles.highest == pytest.approx(-turned.cycles.lowest, rel=max(1e-7, accuracy(name)))
    np.testing.assert_array_equal(straight.transitions.after, -turned.transitions.after)


@solvers
def test_engine_work_is_stored_or_lost(name: str) -> None:
    system = system_for(name)
    d = system.driveline
    found = run(name, system, cycles=1, samples_per_cycle=40_000)
    v, w = found.slip_speed, found.plate_speed
    power = found.engine_torque * (v + w) - found.friction_torque * v - d.damping * w**2
    energy = 0.5 * (d.flywheel_inertia * (v + w)**2 + d.plate_inertia * w**2 + d.stiffness * found.plate_angle**2)
    through = trapezoid(np.abs(found.engine_torque * (v + w)), found.t)
    assert abs(energy[-1] - energy[0] - trapezoid(power, found.t)) <= accuracy(name) * through


@solvers
@pytest.mark.parametrize("part", [0.03, 1.0, 1.37])
def test_it_ends_exactly_where_it_was_asked_to(name: str, part: float) -> None:
    system = system_for(name)
    found = run(name, system, loose(name), duration=part * system.cycle, samples_per_cycle=7)
    assert found.t[-1] == part * system.cycle
    assert found.t[0] == 0.0
    assert np.all(np.diff(found.t) > 0.0)
    assert len(found.cycles or ()) == int(part)
    assert run(name, system, loose(name), cycles=1).t[-1] == system.cycle


@solvers
def test_a_run_goes_on_from_any_cycle_boundary(name: str) -> None:
    system = system_for(name)
    whole = run(name, system, cycles=2, flywheel_angle=True, loads_from=0)
    first = run(name, system, cycles=1, flywheel_angle=True, loads_from=0)
    rest = run(name, system, cycles=1, start_cycle=1, state=first.final, flywheel_angle=True, loads_from=0)
    assert rest.t[0] == system.cycle
    for one, other in ((rest.final.slip_speed, whole.final.slip_speed),
                       (rest.final.plate_angle, whole.final.plate_angle),
                       (rest.final.plate_speed, whole.final.plate_speed),
                       (rest.final.flywheel_angle, whole.final.flywheel_angle)):
        assert one == pytest.approx(other, rel=accuracy(name), abs=1e-6)


@solvers
def test_results_do_not_depend_on_the_samples_asked_for(name: str) -> None:
    system = system_for(name)
    bare, sampled = (run(name, system, cycles=1, samples_per_cycle=n) for n in (0, 37))
    assert bare.cycles is not None
    assert sampled.cycles is not None
    for field in ("section", "highest", "lowest", "stick_time"):
        one, other = getattr(bare.cycles, field), getattr(sampled.cycles, field)
        if not compared(name):
            np.testing.assert_array_equal(one, other, err_msg=field)
        else:  # Their extremes come from dense output at the samples.
            np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-6, err_msg=field)


@solvers
@pytest.mark.parametrize("state", [State(math.nan, 0.0, 0.0), State(0.0, math.inf, 0.0),
                                   State(0.0, 0.0, 0.0, math.nan)])
def test_a_start_that_is_no_state_is_refused(name: str, state: State) -> None:
    with pytest.raises(InputError, match="must be finite"):
        solve(system_for(name), cycles=1, solver=name, state=state)


@pytest.mark.parametrize("name", [name for name in SOLVERS if not compared(name)])
def test_a_start_beyond_all_bounds_ends_with_a_status(name: str) -> None:
    found = solve(system_for(name), cycles=1, solver=name, state=State(1e300, 0.0, -1e300))
    assert found.status is not Status.DONE or np.all(np.isfinite(found.slip_speed))


@solvers
def test_a_solve_takes_no_longer_than_it_says(name: str) -> None:
    began = time.perf_counter()
    found = run(name, system_for(name), loose(name), cycles=1)
    assert 0.0 < found.statistics.seconds <= time.perf_counter() - began
