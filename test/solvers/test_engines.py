"""Both engines in one suite: independent solutions with SciPy, closed forms, identities, and exact symmetry."""

from __future__ import annotations

import math
from dataclasses import astuple
from typing import NamedTuple

import numpy as np
import pytest
from independent import Piecewise, smoothed_run
from scipy.integrate import trapezoid

from tcc_sim.model import closed_forms
from tcc_sim.model.friction import stick_speed
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import Status, solve
from tcc_sim.trajectory import State


class Engine(NamedTuple):
    """An engine's law, its tolerance, and its largest differences from the independent solution, of samples and section
    relative to each signal's size.
    """

    law: str
    rtol: float | None
    near: float

    def system(self, values=None, **more):
        return replace(BASE, {"friction.law": self.law, **(values or {}), **more})


ENGINES = {"smoothed": Engine("smoothed", 1e-11, 2e-9), "event_driven": Engine("set_valued", None, 1e-10)}
EVENT = 1e-10
"""Largest difference of an event's time, s."""
BASE = replace(System(), {"friction.kinetic_coefficient": 0.3, "pressure.mean": 225e3, "pressure.amplitude": 0.0,
                          "engine.frequency": 150.0, "initial.slip_speed": 10.0})
FIG02 = {"friction.kinetic_coefficient": 0.24, "pressure.mean": 260416.67, "pressure.amplitude": 52083.3}
SCENES = {
    "stick-slip": {},
    "low frequency from rest": {"engine.frequency": 60.0, "initial.slip_speed": 0.0},
    "pressure at 3/2": {"pressure.amplitude": 100e3, "pressure.frequency_ratio": 1.5, "pressure.phase": 0.7},
    "reversals": {"engine.mean_torque": 0.0, "engine.torque_amplitude": 900.0},
    "clamped pressure": {"pressure.amplitude": 300e3},
    "heavy damping": {"driveline.damping": 40.0, "engine.torque_amplitude": 500.0},
    "critical damping": {"driveline.damping": 2.0 * math.sqrt(60.0), "engine.torque_amplitude": 500.0},
    "fig02": FIG02,
    "harmonics, pressure at 2/3": {**FIG02, "engine.harmonic_amplitudes": (80.0, 40.0),
                                   "engine.harmonic_phases": (0.3, 1.0), "pressure.frequency_ratio": 2.0 / 3.0},
    "r = 2, reversals": {"friction.kinetic_coefficient": 0.15, "pressure.mean": 300e3, "engine.torque_amplitude": 700.0,
                         "engine.mean_torque": 0.0},
    "r = 1.5, clamped": {"friction.kinetic_coefficient": 0.2, "pressure.amplitude": 250e3, "engine.mean_torque": 100.0},
    "r = 0.4, slow, reversals": {"friction.kinetic_coefficient": 0.75, "friction.decay": 0.2, "pressure.mean": 1e5,
                                 "engine.torque_amplitude": 700.0, "engine.mean_torque": 0.0},
    "r = 1.5, constant law": {"friction.kinetic_coefficient": 0.2, "friction.decay": 0.0},
    "pure stick": {"pressure.mean": 4e5, "friction.kinetic_coefficient": 0.2, "engine.frequency": 60.0,
                   "initial.slip_speed": 0.0},
}
SHARP = {"stiff": {"friction.smoothing": 1e4}, "very stiff": {"friction.smoothing": 1e6}}
"""Of the smoothed law alone."""
both = pytest.mark.parametrize("name", ENGINES)


def initial(system):
    i = system.initial
    return State(i.slip_speed, i.plate_angle, i.plate_speed, i.plate_angle)


def truth(system, cycles, per_cycle):
    """States (n, 4), transitions and stick time by SciPy."""
    if system.friction.law == "smoothed":
        ratio = system.friction_ratio
        layer = stick_speed(system.friction.smoothing, (ratio - 1.0, system.friction.decay) if ratio != 1.0 else None)
        return smoothed_run(system, astuple(initial(system)), cycles, per_cycle, stick_speed=layer)
    times = np.arange(cycles * per_cycle + 1) * (system.cycle / per_cycle)
    return Piecewise(system).run(times[-1], times, slices=20 * cycles)


def drawn(seed):
    """Keys of a scene drawn at random."""
    draw = np.random.default_rng(seed)
    harmonics = {} if seed % 3 else {"engine.harmonic_amplitudes": draw.uniform(0.0, 200.0, 2).tolist(),
                                     "engine.harmonic_phases": draw.uniform(0.0, 6.0, 2).tolist()}
    one_of = {"friction.kinetic_coefficient": (0.12, 0.24, 0.29, 0.45), "pressure.amplitude": (2e4, 1e5, 3e5),
              "pressure.frequency_ratio": (0.5, 1.0, 1.5, 3.0), "engine.mean_torque": (-200.0, 0.0, 250.0)}
    between = {"pressure.mean": (5e4, 4e5), "pressure.phase": (0.0, 6.0), "engine.torque_amplitude": (100.0, 900.0),
               "engine.frequency": (40.0, 300.0), "initial.slip_speed": (-80.0, 80.0),
               "initial.plate_angle": (-0.2, 0.2), "initial.plate_speed": (-20.0, 20.0)}
    powers = {"friction.decay": (-1.0, 1.0), "friction.smoothing": (1.0, 4.0), "driveline.damping": (-1.0, 1.0),
              "driveline.plate_inertia": (-2.5, -1.0), "converter.coupling": (-2.0, 1.0)}
    return {**{key: float(draw.choice(values)) for key, values in one_of.items()},
            **{key: float(draw.uniform(*ends)) for key, ends in between.items()},
            **{key: float(10.0 ** draw.uniform(*ends)) * (key != "converter.coupling" or seed % 2 == 0)
               for key, ends in powers.items()}, **harmonics}


RANDOM = {f"random {seed}": drawn(seed) for seed in range(6)}


def loads_at(system, t):
    """Saturation torque at some times."""
    p = system.pressure
    return system.torque_per_pressure * np.maximum(
        p.mean + p.amplitude * np.sin(p.frequency_ratio * system.engine.frequency * t + p.phase), 0.0)


def sliding_torque(system, t, v, sign):
    """Friction torque of a slip speed of this sign; that of the smoothed law has the sign of v."""
    f = system.friction
    ratio = 1.0 + (f.static_coefficient / f.kinetic_coefficient - 1.0) * np.exp(-f.decay * np.abs(v))
    return loads_at(system, t) * ratio * (np.tanh(f.smoothing * v) if f.law == "smoothed" else sign)


def check_torques(system, run):
    """Check the torques at the samples: the law's in slip; in stick of the set-valued law those of one inertia."""
    d, stuck = system.driveline, (run.state == 0) & (system.friction.law == "set_valued")
    np.testing.assert_allclose(run.saturation_torque, loads_at(system, run.t), atol=1e-9)
    spring = d.damping * run.plate_speed + d.stiffness * run.plate_angle
    held = (d.plate_inertia * run.engine_torque + d.flywheel_inertia * spring) / (d.flywheel_inertia + d.plate_inertia)
    expected = np.where(stuck, held, sliding_torque(system, run.t, run.slip_speed, run.state))
    loaded = run.saturation_torque > 0.0
    np.testing.assert_allclose(run.friction_torque[loaded], expected[loaded], atol=1e-8)
    np.testing.assert_array_equal(run.slip_speed[stuck & loaded], 0.0)
    assert np.abs(run.friction_torque[~loaded]).max(initial=0.0) <= 1e-9


@pytest.mark.parametrize(("name", "scene"), [
    *((name, scene) for k, name in enumerate(ENGINES) for scene in [*list(SCENES)[k::2], "random 0", "random 1"]),
    ("event_driven", "clamped pressure"), ("event_driven", "random 2"), ("smoothed", "random 5"),
    ("smoothed", "very stiff")])
def test_agrees_with_scipy(name, scene):
    """States, sections, extremes, transitions, times in stick, and the loads of clutch and shaft."""
    engine, cycles, per_cycle = ENGINES[name], {"smoothed": 1, "event_driven": 2}[name], 2000
    system = engine.system({**SCENES, **SHARP, **RANDOM}[scene])
    run = solve(system, cycles=cycles, samples_per_cycle=per_cycle, rtol=engine.rtol, loads_from=0)
    assert (run.status, run.solver) == (Status.DONE, name)
    states, changes, stuck = truth(system, cycles, per_cycle)
    scale = np.abs(states).max(axis=0) + 1e-3
    for column, values in enumerate((run.slip_speed, run.plate_angle, run.plate_speed)):
        assert np.abs(values - states[:, column]).max() <= engine.near * scale[column], column
    assert np.all(np.abs(run.cycles.section - states[::per_cycle, :3]) <= engine.near * scale[:3])
    transitions = run.transitions
    assert [(b, a) for _, b, a in changes] == list(zip(transitions.before.tolist(), transitions.after.tolist()))
    np.testing.assert_allclose(transitions.time, [t for t, _, _ in changes], atol=EVENT)
    assert run.cycles.stick_time.sum() == pytest.approx(stuck, abs=len(changes) * EVENT + 1e-12)
    loads, d, h = run.cycles.loads, system.driveline, system.cycle / per_cycle
    check_torques(system, run)
    sign = np.where(run.state == 0, 0.0, np.sign(states[:, 0]))
    heat = states[:, 0] * sliding_torque(system, run.t, states[:, 0], sign)
    fluid = system.converter.coupling * states[:, 0] ** 2
    shaft = d.damping * states[:, 2] + d.stiffness * states[:, 1]
    times = np.array([t for t, before, _ in changes if before == 0])
    for n in range(cycles):
        part = slice(per_cycle * n, per_cycle * (n + 1) + 1)
        for values, high, low, close in (
                (states[part, 0], run.cycles.highest[n], run.cycles.lowest[n], engine.near),
                (shaft[part], loads.highest_shaft_torque[n], loads.lowest_shaft_torque[n], 1e-6)):
            near, bend = close * np.abs(values).max() + 1e-12, np.abs(np.diff(values, 2)).max()
            assert values.max() - near <= high <= values.max() + near + bend
            assert values.min() + near >= low >= values.min() - near - bend
        power, lost = heat[part], fluid[part]
        near, rise = 1e-6 * np.abs(power).max() + 1e-9, np.abs(np.diff(power)).max()
        assert power.max() - near <= loads.peak_power[n] <= power.max() + near + rise
        assert loads.energy[n] == pytest.approx(trapezoid(power, dx=h), abs=200.0 * near * system.cycle)
        assert loads.coupling_energy[n] == pytest.approx(trapezoid(lost, dx=h), rel=1e-3, abs=1e-9)
        assert loads.breakaways[n] == np.count_nonzero(np.floor(times / system.cycle) == n)


@pytest.mark.parametrize("scene", ["stick-slip", "fig02", "clamped pressure", "stiff"])
@both
def test_default_tolerance_is_good_to_a_millionth(name, scene):
    system = ENGINES[name].system({**SCENES, **SHARP}[scene], **{"initial.slip_speed": 150.0})
    coarse, fine = (solve(system, cycles=40, rtol=rtol).cycles for rtol in (None, 1e-11))
    assert np.all(np.abs(coarse.section - fine.section) <= 1e-6 * np.abs(fine.section).max(axis=0))
    assert np.all(np.abs(coarse.highest - fine.highest) <= 1e-6 * np.abs(fine.highest).max())


@both
def test_no_transition_is_lost_however_many_there_are(name):
    """More than the 65536 that one call of the compiled loop has room for."""
    system = ENGINES[name].system(SCENES["reversals"])
    run = solve(system, cycles=16_500, loads_from=0)
    before, after = run.transitions.before, run.transitions.after
    assert len(before) > 65_536
    np.testing.assert_array_equal(before[1:], after[:-1])
    assert run.cycles.loads.breakaways.sum() == np.count_nonzero(before == 0)
    late = solve(system, cycles=10, start_cycle=16_490, state=State(*run.cycles.section[-11]), rtol=1e-11)
    np.testing.assert_allclose(late.cycles.section, run.cycles.section[-11:], atol=1e-6)


@both
def test_a_start_many_cycles_later_is_the_same_motion(name):
    system = ENGINES[name].system(SCENES["pressure at 3/2"])
    early, late = (solve(system, cycles=6, start_cycle=first, rtol=1e-11) for first in (0, 9_000_000))
    np.testing.assert_allclose(late.cycles.section, early.cycles.section, atol=1e-10)
    np.testing.assert_allclose(late.transitions.time - late.t[0], early.transitions.time, atol=1e-8)


@pytest.mark.parametrize("damping", [0.0, 0.6, 2.0 * math.sqrt(60.0), 90.0])
@both
def test_pure_slip_closed_form(name, damping):
    """As fast as this tanh is 1 to the last bit."""
    system = ENGINES[name].system({
        "initial.slip_speed": 150.0, "pressure.mean": 100e3, "pressure.amplitude": 60e3, "pressure.phase": 0.4,
        "pressure.frequency_ratio": 0.75, "driveline.damping": damping, "initial.plate_speed": 3.0})
    run = solve(system, cycles=12, samples_per_cycle=50, rtol=1e-13)
    exact = closed_forms.pure_slip(system)
    np.testing.assert_array_equal(run.state, 1)
    np.testing.assert_allclose(run.slip_speed, exact.slip_speed(run.t), rtol=1e-12)
    np.testing.assert_allclose(run.plate_angle, exact.plate_angle(run.t), atol=1e-12)
    np.testing.assert_allclose(run.plate_speed, exact.plate_speed(run.t), atol=1e-10)
    fine = np.linspace(0.0, system.cycle, 20_001)
    assert run.cycles.highest[0] == pytest.approx(exact.slip_speed(fine).max(), abs=1e-6)
    assert run.cycles.lowest[0] == pytest.approx(exact.slip_speed(fine).min(), abs=1e-6)


@both
def test_pure_stick_closed_form(name):
    """To rounding under the set-valued law; the smoothed one creeps at about 1/sigma."""
    system = ENGINES[name].system({"engine.torque_amplitude": 100.0, "engine.frequency": 60.0, "pressure.mean": 300e3,
                                   "initial.slip_speed": 0.0, "friction.smoothing": 1e6})
    run = solve(system, cycles=400, samples_per_cycle=12)
    angle, creep = closed_forms.plate_angle(system), 0.0 if name == "event_driven" else 1e-6
    late = slice(390 * 12, None)
    assert closed_forms.stick_margin(system).sticks
    np.testing.assert_array_equal(run.state, 0)
    np.testing.assert_allclose(run.plate_angle[late], angle(run.t[late]), atol=1e-13 + creep)
    np.testing.assert_allclose(run.plate_speed[late], angle.rate()(run.t[late]), atol=1e-11 + 10.0 * creep)
    np.testing.assert_allclose(run.friction_torque[late], closed_forms.stuck_interface_torque(system)(run.t[late]),
                               atol=1e-9 + 1e3 * creep)
    np.testing.assert_allclose(run.cycles.stick_time, system.cycle, rtol=1e-12)
    assert np.abs(run.cycles.highest).max() <= math.atanh(0.99) * creep
