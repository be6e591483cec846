"""The exact engine over the extreme ranges: it ends, stays finite and obeys the law in all combinations."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from piecewise import Piecewise

from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import Status, solve

RESONANCES = [math.sqrt(3000.0 / 0.22), math.sqrt(3000.0 / 0.02)]
EXTREMES = st.fixed_dictionaries({
    "friction.kinetic_coefficient": st.sampled_from([0.3, 0.3, 0.285, 0.24, 0.15, 0.075]),
    "friction.decay": st.sampled_from([0.0, 2.0, 1000.0]),
    "pressure.mean": st.sampled_from([0.0, 1e-3, 1e4, 225e3, 1e6, 1e7]),
    "engine.frequency": st.sampled_from([1.0, 10.0, 150.0, 1000.0, 5000.0, *RESONANCES]),
    "driveline.damping": st.sampled_from([0.0, 0.6, 2.0 * math.sqrt(60.0), 40.0]),
    "driveline.plate_inertia": st.sampled_from([0.02, 1e-4, 1e-6]),
    "initial.slip_speed": st.sampled_from([0.0, 1e-12, -5.0, 150.0, 1e4]),
    "engine.mean_torque": st.sampled_from([0.0, 300.0, -300.0]),
    "engine.torque_amplitude": st.sampled_from([0.0, 1e-9, 250.0, 1000.0]),
    "pressure.frequency_ratio": st.sampled_from([1.0, 0.5, 2.0 / 3.0, math.sqrt(2.0), 2.0]),
    "pressure.phase": st.sampled_from([0.0, math.pi / 2, math.pi, 1.0]),
})


@settings(max_examples=150, deadline=None, derandomize=True)
@given(EXTREMES, st.sampled_from([1e-9, 0.5, 0.999, 1.0, 1.0 + 1e-9, 1.5]))
def test_ends_finite_and_within_the_law(values, share):
    amplitude = min(share * max(values["pressure.mean"], 1e-6), 1e7)
    values = {**values, "friction.law": "set_valued", "pressure.amplitude": amplitude}
    system = replace(System(), values)
    run = solve(system, cycles=2, samples_per_cycle=16)
    assert run.status in (Status.DONE, Status.STEP_LIMIT)
    for values in (run.slip_speed, run.plate_angle, run.plate_speed, run.friction_torque, run.cycles.section,
                   run.cycles.highest):
        assert np.all(np.isfinite(values))
    limit = system.friction_ratio * run.saturation_torque
    assert np.all(np.abs(run.friction_torque) <= limit + 1e-9 * (1.0 + limit.max()))
    assert np.all(np.diff(run.transitions.time) >= 0.0)
    stuck = run.cycles.stick_time
    assert np.all((stuck >= 0.0) & (stuck <= system.cycle * (1 + 1e-12)))
    for n in range(len(run.cycles)):
        part = run.slip_speed[16 * n:16 * n + 17]
        rounding = 1e-9 * np.abs(part).max()
        assert run.cycles.lowest[n] - rounding <= part.min()
        assert part.max() <= run.cycles.highest[n] + rounding


@pytest.mark.parametrize("offset", [-1e-3, -1e-9, -1e-12, 0.0, 1e-12, 1e-9, 1e-6, 1e-3])
def test_near_grazing_breakaway(offset):
    """Without damping and from the steady stuck motion, |lambda| just reaches r Ts (1 - offset) once a cycle."""
    gain = 3000.0 - 0.02 * 60.0**2, 3000.0 - 0.22 * 60.0**2
    reach = 300.0 + 100.0 * gain[0] / gain[1]
    system = replace(System(), {
        "friction.law": "set_valued", "friction.kinetic_coefficient": 0.3,
        "pressure.mean": reach * (1.0 - offset) / 0.0024,
        "pressure.amplitude": 0.0, "engine.mean_torque": 300.0, "engine.torque_amplitude": 100.0,
        "engine.frequency": 60.0,
        "driveline.damping": 0.0, "initial.slip_speed": 0.0, "initial.plate_angle": 0.1,
        "initial.plate_speed": 100.0 * 60.0 / gain[1]})
    run = solve(system, cycles=3, samples_per_cycle=40)
    assert run.status is Status.DONE
    if offset < 0.0:
        assert len(run.transitions.time) == 0
    if offset >= 1e-9:
        first = run.transitions.time[0] / system.cycle
        assert first == pytest.approx(0.25 - math.acos(1.0 - offset * reach / (reach - 300.0)) / (2 * math.pi),
                                      abs=1e-6)
        assert np.count_nonzero(run.transitions.after == 1) == 3
    if offset == 1e-3:
        states, _, _ = Piecewise(system).run(3 * system.cycle, run.t, slices=120)
        np.testing.assert_allclose(run.slip_speed, states[:, 0], atol=1e-6 * np.abs(states[:, 0]).max() + 1e-10)


def test_chattering_ends_with_a_sentence(monkeypatch):
    from tcc_sim.solvers.event_driven import solve as event_driven
    limits_of = event_driven.bounds_of
    monkeypatch.setattr(event_driven, "bounds_of", lambda *given: limits_of(*given)._replace(events=3))
    system = replace(System(),
                     {"friction.law": "set_valued", "engine.mean_torque": 0.0, "engine.torque_amplitude": 900.0})
    run = solve(system, cycles=50)
    assert run.status is Status.EVENT_LIMIT
    assert "3 events" in run.detail
    assert np.all(np.isfinite(run.slip_speed))
