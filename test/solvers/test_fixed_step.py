"""The real-time solver, and its scalar root against brentq and long arithmetic."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from tcc_sim.errors import InputError
from tcc_sim.model import closed_forms, friction
from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.fixed_step import ITERATION_BOUND, Stepper, scalar_root
from tcc_sim.solvers.terms import holding, terms_of

TIGHT = {"solver": "radau", "rtol": 1e-10}


def largest(*parts: Any) -> float:
    return max(float(np.abs(p).max()) for p in parts)


@pytest.mark.parametrize(("name", "tolerance"), [("minimal", 1e-4), ("slip", 1e-4), ("stick", 1e-4), ("fig02", 1e-3)])
def test_a_millisecond_tick_is_as_exact_as_promised(name: str, tolerance: float) -> None:
    # A lower initial slip speed than the scene's brings stick within the first cycles.
    start = load_scene(name).system
    system = replace(start, {"initial.slip_speed": min(start.initial.slip_speed, 20.0)}) if name != "slip" else start
    reference = solve(system, cycles=2, solver="smoothed", rtol=1e-9).raise_for_status()
    result = solve(system, cycles=2, solver="fixed_step").raise_for_status()
    top = largest(reference.cycles.highest, reference.cycles.lowest)
    assert largest(result.cycles.highest - reference.cycles.highest) <= tolerance * top
    for column, size in enumerate((top, largest(reference.cycles.section[:, 1]),
                                   largest(reference.cycles.section[:, 2]))):
        assert largest((result.cycles.section - reference.cycles.section)[:, column]) <= tolerance * size
    assert result.statistics.iterations_max <= ITERATION_BOUND == result.statistics.iterations_bound


FALLING = {"friction.static_coefficient": 0.36, "pressure.amplitude": 1.0}
"""Hardly anything else, with the kind of kernel of fig02."""


def ended(system: System, duration: float, count: int) -> np.ndarray:
    """Slip speed, plate angle and plate speed after one tick of so many sub-steps."""
    stepper = Stepper(system, duration)
    stepper.substeps = count
    return np.array(stepper.advance()[:3])


def test_order_3_on_a_smooth_slip_arc() -> None:
    system = replace(load_scene("slip").system, FALLING)
    reference = solve(system, duration=0.032, solver="dop853", rtol=1e-13).raise_for_status()
    exact = np.array([reference.slip_speed[-1], reference.plate_angle[-1], reference.plate_speed[-1]])
    errors = [float(np.abs((ended(system, 0.032, n) - exact) / np.maximum(np.abs(exact), 1e-3)).max())
              for n in (64, 128, 256)]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert orders == pytest.approx([3.0, 3.0], abs=0.25)


def test_order_3_on_a_smooth_stick_arc() -> None:
    system = replace(load_scene("stick").system, FALLING)
    reference = solve(system, cycles=1, **TIGHT).raise_for_status()
    errors = [abs(ended(system, system.cycle, n)[1] - reference.plate_angle[-1]) for n in (250, 500)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(3.0, abs=0.6)


def test_errors_are_flat_in_the_smoothing_factor() -> None:
    # In stick the set-valued limit is the closed form (8); smoothing shifts it by the creep, which falls as 1/sigma.
    base = replace(load_scene("stick").system, {"driveline.damping": 60.0})
    steady = closed_forms.plate_angle(base)
    for sigma in (1e5, 1e7, 1e9):
        system = replace(base, {"friction.smoothing": sigma})
        run = solve(system, cycles=30, solver="fixed_step").raise_for_status()
        assert run.plate_angle[-1] == pytest.approx(float(steady(np.array([30 * system.cycle]))[0]), rel=1e-6), sigma


def test_the_stepper_takes_the_ticks_of_solve() -> None:
    system = load_scene("fig02").system
    stepper = Stepper(system, 1e-3)
    stepper.warm_up(terms_of(system))
    assert stepper.tick == 0
    for _ in range(50):
        stepper.advance()
    run = solve(system, duration=0.05, solver="fixed_step", flywheel_angle=True)
    assert stepper.state.tolist() == pytest.approx([*(run.slip_speed[-1], run.plate_angle[-1], run.plate_speed[-1]),
                                                    run.final.flywheel_angle], rel=1e-12)
    assert 1 < stepper.iterations_most == run.statistics.iterations_max <= stepper.iterations_bound
    stepper.reset(system)
    assert stepper.state.tolist() == [150.0, 0.0, 0.0, 0.0]


def test_a_stepper_follows_what_it_is_told() -> None:
    """Terms that change, and a state and a tick that are set, count in the next call."""
    system = load_scene("fig02").system
    scene_terms = terms_of(system)
    stepper = Stepper(system, 1e-3)
    for tick, terms in enumerate((scene_terms, *(holding(scene_terms, *held) for held in (
            (300.0, 400.0), (200.0, 800.0), (200.0, 8.0), (300.0, 200.0))))):
        stepper.use(terms)
        stepper.tick, stepper.state[0] = 100 * tick, 20.0 + tick
        other = Stepper(system, 1e-3)
        other.use(terms)
        other.tick, other.state[:] = 100 * tick, stepper.state
        for t, reached in ((0.1 * tick, stepper.now()), (0.1 * tick + 1e-3, stepper.advance())):
            load = terms.mean_load + terms.pulsation[0] * math.sin(terms.pulsation[1] * t + terms.pulsation[2])
            assert reached[4:6] == pytest.approx((
                terms.mean_torque + terms.torque[0] * math.sin(terms.torque[1] * t),
                load * friction.smoothed_coefficient(reached[0], terms.smoothing, terms.stribeck)), rel=1e-12)
        assert list(reached[:4]) == stepper.state.tolist() == list(other.advance()[:4])


logs = st.floats(0.0, 1.0)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(w=st.floats(-1e5, 1e5), size=logs, smoothing=logs, guess=st.floats(-1e5, 1e5), excess=logs,
       decay=st.one_of(st.just(0.0), st.floats(1e-3, 10.0)))
def test_the_root_is_the_one_brentq_finds(w, size, smoothing, guess, excess, decay):
    a, sigma = 10.0 ** (-6 + 9 * size), 10.0 ** (1 + 8 * smoothing)
    # The Stribeck slope is at least -alpha (r - 1): sub-steps keep a times it below 1/2, so that F increases.
    stribeck = (min(3.0 * excess, 0.5 / (a * decay)) if decay else 0.0, decay)
    v, count = scalar_root(w, a, guess, sigma, stribeck)
    assert 0 <= count <= ITERATION_BOUND

    def residual(x: float) -> float:
        return float(x + a * friction.smoothed_coefficient(x, sigma, stribeck) - abs(w))

    expected = brentq(residual, 0.0, abs(w), xtol=1e-300, rtol=1e-15, maxiter=2000) if w else 0.0
    assert abs(v) == pytest.approx(expected, rel=1e-11, abs=max(2e-15 * abs(w), 1e-150))
    assert v == 0.0 or (v > 0.0) == (w > 0.0)


@pytest.mark.parametrize("w", [float("nan"), float("inf"), -float("inf")])
def test_the_bound_holds_for_what_is_no_number(w: float) -> None:
    _, count = scalar_root(w, 1.0, 0.0, 50.0, (0.25, 2.0))
    assert count <= ITERATION_BOUND


def test_no_friction_leaves_the_speed_as_it_is() -> None:
    assert scalar_root(3.0, 0.0, 0.0, 50.0, (0.0, 0.0)) == (3.0, 0)
    assert scalar_root(0.0, 1.0, 5.0, 50.0, (0.25, 2.0)) == (0.0, 0)


@pytest.mark.parametrize("values", [
    {}, {"engine.harmonic_amplitudes": [80.0, 40.0], "engine.harmonic_phases": [0.3, 1.0]},
    {"pressure.source": "topic", "pressure.time_constant": 0.02},
    {"engine.mean_torque_times": [0.0, 1.0], "engine.mean_torque_values": [100.0, 300.0]},
])
def test_held_inputs_are_those_of_terms_that_hold_them(values: dict[str, Any]) -> None:
    """A new command changes means and sub-steps alone; terms and states are as if all had been worked out anew."""
    system = load_scene("fig02").with_values(values).system
    quick, plain, terms = Stepper(system, 1e-3), Stepper(system, 1e-3), terms_of(system)
    generator, counts = np.random.default_rng(3), set[int]()
    for k in range(120):
        torque = None if k % 40 < 7 else float(generator.uniform(-100.0, 400.0))
        load = None if k % 50 < 12 else float(generator.uniform(0.0, 2000.0))
        quick.hold(terms, torque, load)
        plain.use(holding(terms, torque, load))
        counts.add(quick.substeps)
        assert (quick.substeps, repr(quick.terms)) == (plain.substeps, repr(plain.terms))
        if not values:
            assert quick.advance() == plain.advance()
    assert len(counts) > 10
    before = quick.terms, quick.substeps
    with pytest.raises(InputError, match="sub-steps"):
        quick.hold(terms, 1.0, 1e9)
    assert (quick.terms, quick.substeps) == before
