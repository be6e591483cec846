"""Tolerances, rates and edges of both engines for a system of round numbers, by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from tcc_sim.errors import InputError
from tcc_sim.model.equations import Linear
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.profile import SWELL, SWELLS
from tcc_sim.solvers import collocation
from tcc_sim.solvers.event_driven import solve as event_driven
from tcc_sim.solvers.event_driven.setup import bounds_of
from tcc_sim.solvers.key_derivatives import EXCESS_RATIO, NUMBERS
from tcc_sim.solvers.run_output import DEGENERATE, DONE, EVENT_LIMIT, NOT_FINITE, STEP_LIMIT
from tcc_sim.solvers.smoothed import solve as smoothed
from tcc_sim.solvers.smoothed.setup import far_of, limits_of, order_of
from tcc_sim.solvers.terms import Terms, terms_of

LINEAR = Linear(0.25, 0.04, 2.0, 2500.0, 0.5, 0.75, -0.2)
"""omega_n = 250 rad/s, beta = 29; the slip speed decays at 0.5/0.25 + 0.2/0.04 = 7 1/s, and at 10 with 0.75/0.25."""
SYSTEM = replace(System(), {
    "friction.static_coefficient": 0.3, "friction.kinetic_coefficient": 0.2, "clutch.area": 0.05, "clutch.radius": 0.1,
    "pressure.mean": 2e5, "pressure.amplitude": 3e5, "pressure.frequency_ratio": 0.5, "engine.frequency": 100.0,
    "engine.mean_torque": -120.0, "engine.torque_amplitude": 80.0, "engine.harmonic_amplitudes": [20.0],
    "engine.harmonic_phases": [0.3]})
CYCLE = math.pi / 50.0


def terms(changes: dict[str, Any] | None = None, **linear: float) -> Terms:
    """Terms of the system: Te = -120 +- 80 +- 20 N m to 200 rad/s, Ts = 200 +- 300 N m at 50 rad/s."""
    return terms_of(replace(SYSTEM, changes or {}))._replace(linear=LINEAR._replace(**linear))


def check(found: Any, expected: dict[str, Any]) -> None:
    for name, value in expected.items():
        assert getattr(found, name) == pytest.approx(value, rel=1e-9, abs=0.0), name


def test_bounds_of_the_exact_engine() -> None:
    bounds = bounds_of(terms(), CYCLE, 1e-8)
    every = {"period": CYCLE, "ratio": 1.5, "clamped": True, "slip_rate": 250.0 + 50.0 + 10.0 + 200.0,
             "stick_rate": math.sqrt(2500.0 / 0.29) + 2.75 / 0.29 + 200.0, "slip_decay": 10.0,
             "far": math.log(0.5 / 1.5e-10) / 2.0, "truncation": 1e-8, "torque_tolerance": 970e-12,
             "slip_tolerance": 97e-14, "speed_scale": 97.0, "steps": 100_000, "events": 1100}
    assert [*every] == [*bounds._fields]
    check(bounds, every)
    for changes, rtol, cycle, expected in (
            ({"friction.kinetic_coefficient": 0.3}, 1e-8, CYCLE, {"far": 0.0, "truncation": 1e-16, "ratio": 1.0}),
            ({"friction.kinetic_coefficient": 0.3 * (1.0 - 1e-10)}, 1e-8, CYCLE, {"far": 0.5}),
            ({}, 1e-17, CYCLE, {"truncation": 1e-16, "far": math.log(0.5 / 1.5e-19) / 2.0}),
            ({"pressure.amplitude": 2e5}, 1e-8, CYCLE, {"clamped": False, "torque_tolerance": 820e-12}),
            ({"pressure.amplitude": 0.0}, 1e-8, 0.5 * CYCLE, {"clamped": False, "events": 1050}),
            ({}, 1e-8, 1e9, {"events": 1_001_000}), ({"engine.frequency": 500.0}, 1e-8, CYCLE, {"events": 1400})):
        check(bounds_of(terms(changes), cycle, rtol), expected)


def test_bounds_without_any_torque_or_damper_are_finite() -> None:
    still = {"engine.mean_torque": 0.0, "engine.torque_amplitude": 0.0, "engine.harmonic_amplitudes": [],
             "engine.harmonic_phases": [], "pressure.mean": 0.0, "pressure.amplitude": 0.0}
    none = bounds_of(terms(still), CYCLE, 1e-8)
    assert none.torque_tolerance == pytest.approx(1e-312, rel=1e-6, abs=0.0)
    assert none.speed_scale == pytest.approx(1e-301, rel=1e-6, abs=0.0)


def test_limits_of_the_smoothed_engine() -> None:
    found = limits_of(terms(), terms(), CYCLE, 1e-8)
    top = minimize_scalar(lambda v: -(1.0 + 0.5 * math.exp(-2.0 * v)) * math.tanh(50.0 * v), (0.0, 0.05, 0.1),
                          tol=1e-12)
    every = {"period": CYCLE, "sigma": 50.0, "rtol": 1e-9, "slip_floor": 2e-4, "speed_floor": 72e-6 + 1e-12,
             "layer_tolerance": 6e-9, "falling_tolerance": 5e-3, "creep_tolerance": 4e-10,
             "layer": 0.01 * math.log(2.0 / 0.3e-8), "far": 0.5 * math.log(0.5 / 0.03e-8), "nearly_zero": 2e-9,
             "stick_speed": found.creep_speed, "peak": -top.fun, "creep_speed": found.creep_speed,
             "base_rate": 250.0 + 50.0 + 100.0 + 200.0 + 50.0 + 7.0 + 3.0,
             "fastest": 660.0 - 14500.0 * 50.0 * top.fun, "strength": 14500.0, "beta": 29.0, "kappa": 0.25 / 0.29,
             "slip_decay": 7.0, "fast_slip": False, "rest": 72e-26, "order": 16, "linear_order": 22,
             "resolved": math.exp((math.log(1e-6) + math.lgamma(18.0)) / 17.0), "forgotten": math.log(1e9),
             "steps": 2000}
    assert [*every] == [*found._fields]
    check(found, every)
    assert found.creep_speed == pytest.approx(top.x, rel=1e-5)
    flat = 0.02 * math.atanh(1.0 - 1e-6)
    for changes, linear, rtol, expected in (
            ({}, {}, 1e-2, {"rtol": 1e-3, "layer_tolerance": 2e-5, "creep_tolerance": 2e-4, "order": 8,
                            "linear_order": 14, "layer": 0.01 * math.log(2.0 / 0.3e-2)}),
            ({}, {}, 1e-15, {"rtol": 1e-14, "creep_tolerance": 4e-15, "order": 22, "linear_order": 30}),
            ({}, {}, 1e-18, {"layer": 0.38}),
            ({"friction.kinetic_coefficient": 0.3}, {}, 1e-8, {
                "far": found.layer, "falling_tolerance": math.inf, "creep_speed": flat, "peak": 1.0 - 1e-6,
                "stick_speed": 0.02 * math.atanh(0.99)}),
            ({"friction.decay": 0.0}, {}, 1e-8, {"far": math.inf, "peak": 1.5 * (1.0 - 1e-6), "creep_speed": flat,
                                                 "falling_tolerance": math.inf}),
            ({}, {"flywheel_by_slip": 1498.0}, 1e-8, {"fast_slip": False, "fastest": found.fastest + 5990.0}),
            ({}, {"flywheel_by_slip": 1499.0}, 1e-8, {"fast_slip": True, "fastest": 8.0 * (found.fastest + 5994.0)})):
        each = terms(changes, **linear)
        check(limits_of(each, each, CYCLE, rtol), expected)
    wider = limits_of(terms(), terms({"friction.decay": 0.01}), CYCLE, 1e-2)
    assert wider.layer == pytest.approx(1.01 * wider.stick_speed) != pytest.approx(0.01 * math.log(2.0 / 0.3e-2))
    assert [order_of(x, 30) for x in (3.0, 8.9, 9.1, 28.9, 29.1, 40.0)] == [8, 8, 10, 28, 30, 30]
    assert [far_of(x, rate, 1e-8, 0.2) for x, rate in ((0.0, 2.0), (0.5, 0.0), (3e-10, 2.0), (3e-9, 2.0))] == [
        0.2, math.inf, 0.2, pytest.approx(0.5 * math.log(10.0))]
    assert limits_of(terms({"friction.kinetic_coefficient": 0.3}), terms(), CYCLE, 1e-8, 0.5).far == found.layer
    assert limits_of(terms(), terms(), CYCLE, 1e-8, 5.0).far == pytest.approx(0.5 * math.log(5.0 / 0.03e-8))


def test_a_setup_has_the_sines_as_waves_and_a_ladder_from_a_cycle_to_the_fastest_rate() -> None:
    smooth, exact = smoothed.prepared(SYSTEM, 1e-8), event_driven.setup_of(SYSTEM, 1e-8)
    for setup in (smooth, exact):
        assert setup.waves.tolist() == [(100.0, 80.0, 0.0, 0.0, 1.0), (200.0, 20.0, 0.3, 0.0, 1.0)]
        assert (setup.ratio, setup.terms.torque, setup.terms.harmonics) == (0.5, None, None)
        assert not setup.waves.flags.writeable
    assert (smooth.terms.smoothing, exact.terms.smoothing, exact.tables) == (50.0, None, None)
    assert smooth.terms.stribeck == exact.terms.stribeck == pytest.approx((0.5, 2.0))
    lengths = smooth.tables.step_sizes["length"]
    assert lengths[0] <= CYCLE < lengths[0] * math.sqrt(2.0)
    assert lengths[:-1] / lengths[1:] == pytest.approx(np.full(len(lengths) - 1, math.sqrt(2.0)))
    assert lengths[-1] * smooth.limits.fastest <= 200.0 < lengths[-2] * smooth.limits.fastest or len(lengths) == 22
    flat = event_driven.setup_of(replace(SYSTEM, {"friction.decay": 0.0}), 1e-8)
    assert (flat.terms.stribeck, flat.terms.mean_load) == (None, pytest.approx(300.0))
    assert flat.terms.pulsation == pytest.approx((450.0, 50.0, 0.0))


def test_setups_of_derivatives_are_finer_and_keep_what_decays() -> None:
    """Tolerances are a hundredth; an exponential of derivatives counts as 1 at least."""
    still = replace(SYSTEM, {"pressure.amplitude": 0.0, "pressure.phase": 0.4})
    none, by = np.zeros((len(NUMBERS), 1)), np.zeros((len(NUMBERS), 1))
    by[EXCESS_RATIO] = 1.0
    for system, changes, share in ((SYSTEM, none, 0.5), (still, by, 1.0)):
        setup = event_driven.setup_of_changes(system, terms_of(system), changes, 1e-8)
        check(setup.limits, {"truncation": 1e-10, "events": 1000, "far": math.log(share / 1.5e-12) / 2.0, "ratio": 1.5})
        amplitude, phase = (300.0, 0.0) if system is SYSTEM else (0.0, 0.4)
        assert (setup.terms.pulsation, setup.tables) == (pytest.approx((amplitude, 50.0, phase)), None)
    lasting = event_driven.setup_of_changes(SYSTEM, terms({"friction.decay": 0.0}), none, 1e-8)
    assert lasting.terms.stribeck == pytest.approx((0.5, 1e-30), rel=1e-12, abs=0.0)
    smooth = [smoothed.setup_of_changes(SYSTEM, terms_of(SYSTEM), changes, 1e-8) for changes in (none, by)]
    check(smooth[0].limits, {"far": 0.5 * math.log(0.5 / 0.03e-8), "rtol": 1e-9})
    check(smooth[1].limits, {"far": 0.5 * math.log(1.0 / 0.03e-8)})
    assert smooth[0].tables.torque.shape[0] == len(smooth[0].tables.step_sizes)
    with pytest.raises(InputError, match=r"decays at \S+ 1/s, and the derivatives .* more than 100000 steps a cycle"):
        event_driven.setup_of_changes(SYSTEM, terms(damping=7e5), none, 1e-8)
    event_driven.setup_of_changes(SYSTEM, terms(damping=6e5), none, 1e-8)


def test_an_engine_allows_steps_by_cycles_and_says_why_it_ends() -> None:
    smooth, exact = smoothed.prepared(SYSTEM, 1e-8), event_driven.setup_of(SYSTEM, 1e-8)
    engine, other = smoothed.ENGINE, event_driven.ENGINE
    assert (engine.steps(smooth, 3), engine.steps_of_changes(smooth, 3)) == (406_000, 60_000)
    assert (other.steps(exact, 3), other.steps_of_changes(exact, 3)) == (1_000_000, 100_000)
    assert [engine.why(ended, 7, smooth) for ended in (NOT_FINITE, STEP_LIMIT)] == ["the state grew without bound", ""]
    assert [other.why(ended, 7, exact) for ended in (EVENT_LIMIT, NOT_FINITE, STEP_LIMIT, DEGENERATE, DONE)] == [
        "1154 events in one period of excitation", "the state is not finite", "7 steps in one period of excitation",
        "slip ends where its rate is 0 too", ""]
    kernels: list[Any] = [engine.integrate, other.integrate, engine.sections, engine.segments]
    assert [kernel.effort for kernel in kernels] == [1.0, 0.7, 0.8, 2.4]   # Compile times, relative.
    for whole, calls in ((5, [5]), (4096, [4096]), (4097, [4096, 4097]), (9000, [4096, 8192, 9000])):
        problem: Any = SimpleNamespace(whole_cycles=whole, rest=0.25)
        expected = [(cycles, 0.25 if cycles == whole else 0.0) for cycles in calls]
        assert [stretch[1:] for stretch in engine.stretches(problem, smooth)] == expected
        assert [stretch[1:] for stretch in other.stretches(problem, exact)] == expected[-1:]


def test_a_row_of_a_profile_begins_where_a_stretch_does() -> None:
    """Values there, with the rates of their piece; it ends with the piece, the last one never."""
    profile = np.zeros((2, SWELLS + SWELL))
    profile[0, :8], profile[0, SWELLS:] = [1.0, 9.0, 100.0, 10.0, 300.0, -20.0, 500.0, 40.0], [3.0, 0.4, 50.0, 6.0]
    profile[1, :8], profile[1, SWELLS:] = [2.0, 9.0, 110.0, 0.0, 280.0, 2.0, 540.0, -4.0], [3.0, 0.4, 56.0, -1.0]
    for begin, stop, row, swell in (
            (1.5, 1.75, [0.25, 0.7, 105.0, 10.0, 290.0, -20.0, 520.0, 40.0, 0.75, 1.25, 0.3], [3.0, 0.4, 53.0, 6.0]),
            (2.5, 3.0, [1.25, 0.7, 110.0, 0.0, 281.0, 2.0, 538.0, -4.0, math.inf, 1.25, 0.3], [3.0, 0.4, 55.5, -1.0])):
        found = smoothed.profile_row(profile, begin, stop, 1.25, 0.7, 0.3)
        assert found.tolist() == pytest.approx([*row, *swell])
    varying = replace(SYSTEM, {"pressure.amplitude": 0.0, "engine.frequency_times": [0.0, 1.0],
                               "engine.frequency_values": [50.0, 200.0]})
    setup = smoothed.prepared(varying, 1e-8)
    assert (setup.terms.pulsation, setup.limits.period) == ((0.0, 1.0, 0.0), pytest.approx(math.pi / 100.0))
    lengths = setup.tables.step_sizes["length"]
    assert lengths[0] <= math.pi / 25.0 < lengths[0] * math.sqrt(2.0)
    assert len(lengths) == collocation.ladder_of(setup.limits.fastest, math.pi / 25.0)[1] + 4
