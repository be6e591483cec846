"""Both engines in one suite: independent solutions with SciPy, closed forms, identities, and exact symmetry."""

from __future__ import annotations

import math
from dataclasses import astuple
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
import pytest

from tcc_sim.errors import NumericalFailure
from tcc_sim.model import pure_slip, pure_stick
from tcc_sim.model.friction import stick_speed
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import Status, run_output, solve
from tcc_sim.solvers.event_driven.setup import bounds_of
from tcc_sim.solvers.problem import Problem
from tcc_sim.solvers.stroboscopic import stroboscopic_map
from tcc_sim.solvers.terms import Terms, steps_allowed, terms_of
from tcc_sim.study.benchmarks.references import Piecewise, smoothed_run
from tcc_sim.trajectory import State, Trajectory


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
    return Piecewise(system).run(cycles * system.cycle, times, slices=20 * cycles)


@pytest.mark.parametrize(("name", "scene"), [(name, scene) for name in ENGINES for scene in SCENES]
                         + [("smoothed", scene) for scene in SHARP])
def test_agrees_with_scipy(name, scene):
    engine, cycles, per_cycle = ENGINES[name], {"smoothed": 1, "event_driven": 3}[name], 40
    system = engine.system({**SCENES, **SHARP}[scene])
    run = solve(system, cycles=cycles, samples_per_cycle=per_cycle, rtol=engine.rtol)
    assert (run.status, run.solver) == (Status.DONE, name)
    states, changes, stuck = truth(system, cycles, per_cycle)
    scale = np.abs(states).max(axis=0) + 1e-3
    for column, values in enumerate((run.slip_speed, run.plate_angle, run.plate_speed)):
        assert np.abs(values - states[:, column]).max() <= engine.near * scale[column], column
    assert np.all(np.abs(run.cycles.section - states[::per_cycle, :3]) <= engine.near * scale[:3])
    dense = states[:-1, 0].reshape(cycles, per_cycle)
    assert np.all(run.cycles.highest >= dense.max(axis=1) - engine.near * scale[0])
    assert np.all(run.cycles.lowest <= dense.min(axis=1) + engine.near * scale[0])
    transitions = run.transitions
    assert [(b, a) for _, b, a in changes] == list(zip(transitions.before.tolist(), transitions.after.tolist()))
    np.testing.assert_allclose(transitions.time, [t for t, _, _ in changes], atol=EVENT)
    assert run.cycles.stick_time.sum() == pytest.approx(stuck, abs=len(changes) * EVENT + 1e-12)


@pytest.mark.parametrize("scene", SCENES)
@both
def test_samples_cycles_and_torques_are_of_one_motion(name, scene):
    system = ENGINES[name].system(SCENES[scene])
    run = solve(system, cycles=3, samples_per_cycle=3000).raise_for_status()
    d, f = system.driveline, system.friction
    law = run.saturation_torque * (1 + (system.friction_ratio - 1) * np.exp(-f.decay * np.abs(run.slip_speed)))
    if f.law == "smoothed":
        np.testing.assert_allclose(run.friction_torque, np.tanh(f.smoothing * run.slip_speed) * law, atol=1e-9)
    else:
        slipping, loaded = run.state != 0, run.saturation_torque > 0
        np.testing.assert_array_equal(run.slip_speed[~slipping & loaded], 0.0)
        assert np.all(np.abs(run.friction_torque) <= system.largest_friction_ratio * run.saturation_torque + 1e-9)
        moving = slipping & loaded
        np.testing.assert_allclose(run.friction_torque[moving], (np.sign(run.state) * law)[moving], atol=1e-9)
    balance = (d.plate_inertia * np.gradient(run.plate_speed, run.t) + d.damping * run.plate_speed
               + d.stiffness * run.plate_angle - run.friction_torque)
    calm = np.abs(np.gradient(run.friction_torque)) < 5.0
    assert np.median(np.abs(balance[calm])) < 0.05
    for n in range(3):
        part = run.slip_speed[3000 * n:3000 * n + 3001]
        step = np.abs(np.diff(part)).max()
        assert part.max() <= run.cycles.highest[n] + 1e-12 <= part.max() + step + 1e-12
        assert part.min() >= run.cycles.lowest[n] - 1e-12 >= part.min() - step - 1e-12
    transitions = run.transitions
    assert np.all(np.diff(transitions.time) > 0.0)
    assert np.all(transitions.before[1:] == transitions.after[:-1])
    modes = np.concatenate([transitions.before[:1], transitions.after]) if len(transitions.time) else run.state[:1]
    edges = np.concatenate([[0.0], transitions.time, [run.t[-1]]])
    assert np.diff(edges)[modes == 0].sum() == pytest.approx(run.cycles.stick_time.sum(), rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("scene", ["stick-slip", "fig02", "clamped pressure", "stiff"])
@both
def test_default_tolerance_is_good_to_a_millionth(name, scene):
    system = ENGINES[name].system({**SCENES, **SHARP}[scene], **{"initial.slip_speed": 150.0})
    coarse, fine = (solve(system, cycles=40, rtol=rtol).cycles for rtol in (None, 1e-11))
    assert np.all(np.abs(coarse.section - fine.section) <= 1e-6 * np.abs(fine.section).max(axis=0))
    assert np.all(np.abs(coarse.highest - fine.highest) <= 1e-6 * np.abs(fine.highest).max())


@pytest.mark.parametrize(("name", "module", "limit"), [
    ("smoothed", "smoothed.solve", "STEPS_AT_FIRST"), ("event_driven", "event_driven.solve", "STEP_MAXIMUM")])
def test_a_run_that_ends_early_keeps_its_samples_up_to_its_end(monkeypatch, name, module, limit):
    system = ENGINES[name].system(FIG02, **{"initial.slip_speed": 5.0})
    whole = solve(system, cycles=3, samples_per_cycle=100)
    fewest = 60 - 4 * steps_allowed(terms_of(system), system.cycle) if name == "smoothed" else 8
    monkeypatch.setattr(import_module(f"tcc_sim.solvers.{module}"), limit, fewest)
    cut = solve(system, cycles=3, samples_per_cycle=100)
    assert cut.status is Status.STEP_LIMIT
    assert 0.0 < cut.t[-1] < whole.t[-1]
    count = len(cut.t) - 1
    assert count == np.searchsorted(whole.t, cut.t[-1]) > 20
    for column in ("t", "slip_speed", "plate_angle", "plate_speed"):
        np.testing.assert_array_equal(getattr(cut, column)[:-1], getattr(whole, column)[:count])
    if name == "event_driven":
        assert cut.detail == "8 steps in one period of excitation"


def test_a_motion_with_derivatives_names_the_steps_that_it_was_allowed(monkeypatch):
    system = ENGINES["event_driven"].system(FIG02)
    monkeypatch.setattr(import_module("tcc_sim.solvers.event_driven.setup"), "STEPS_ALLOWED", 0)
    with pytest.raises(NumericalFailure, match="event_driven: 0 steps in one period of excitation after phase 0 of"):
        stroboscopic_map(system, np.zeros(3), 1)


@both
def test_no_transition_is_lost_where_there_are_more_than_one_call_has_room_for(monkeypatch, name):
    system = ENGINES[name].system(SCENES["reversals"])
    whole = solve(system, cycles=80, loads_from=0)
    monkeypatch.setattr(run_output, "TRANSITIONS_MAXIMUM", 100)
    parts = solve(system, cycles=80, loads_from=0)
    assert len(parts.transitions.time) > 3 * run_output.TRANSITIONS_MAXIMUM
    for each, wanted in zip(astuple(parts.transitions), astuple(whole.transitions)):
        np.testing.assert_array_equal(each, wanted)
    np.testing.assert_array_equal(parts.cycles.loads.breakaways, whole.cycles.loads.breakaways)
    np.testing.assert_array_equal(parts.cycles.section, whole.cycles.section)


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
    exact = pure_slip.pure_slip(system)
    np.testing.assert_array_equal(run.state, 1)
    np.testing.assert_allclose(run.slip_speed, exact.slip_speed(run.t), rtol=1e-12)
    np.testing.assert_allclose(run.plate_angle, exact.plate_angle(run.t), atol=1e-12)
    np.testing.assert_allclose(run.plate_speed, exact.plate_speed(run.t), atol=1e-10)
    fine = np.linspace(0.0, system.cycle, 200_001)
    assert run.cycles.highest[0] == pytest.approx(exact.slip_speed(fine).max(), abs=1e-6)
    assert run.cycles.lowest[0] == pytest.approx(exact.slip_speed(fine).min(), abs=1e-6)


@both
def test_pure_stick_closed_form(name):
    """To rounding under the set-valued law; the smoothed one creeps at about 1/sigma."""
    system = ENGINES[name].system({"engine.torque_amplitude": 100.0, "engine.frequency": 60.0, "pressure.mean": 300e3,
                                   "initial.slip_speed": 0.0, "friction.smoothing": 1e6})
    run = solve(system, cycles=400, samples_per_cycle=12)
    angle, creep = pure_stick.plate_angle(system), 0.0 if name == "event_driven" else 1e-6
    late = slice(390 * 12, None)
    assert pure_stick.stick_margin(system).sticks
    np.testing.assert_array_equal(run.state, 0)
    np.testing.assert_allclose(run.plate_angle[late], angle(run.t[late]), atol=1e-13 + creep)
    np.testing.assert_allclose(run.plate_speed[late], angle.rate()(run.t[late]), atol=1e-11 + 10.0 * creep)
    np.testing.assert_allclose(run.friction_torque[late], pure_stick.stuck_interface_torque(system)(run.t[late]),
                               atol=1e-9 + 1e3 * creep)
    np.testing.assert_allclose(run.cycles.stick_time, system.cycle, rtol=1e-12)
    assert np.abs(run.cycles.highest).max() <= math.atanh(0.99) * creep


@pytest.mark.parametrize("values", [FIG02, {"pressure.mean": 225e3}], ids=["fig02", "stick-slip"])
@both
def test_terms_too_small_to_be_felt_give_the_motion_without_them(name, values):
    harmonics = {"engine.harmonic_amplitudes": (1e-12,), "engine.harmonic_phases": (0.0,)}
    small = {} if values is FIG02 else {"pressure.amplitude": 1e-9, "friction.kinetic_coefficient": 0.3 - 1e-14}
    general = ENGINES[name].system({**values, **harmonics, **small})
    terms = terms_of(general)
    assert None not in (terms.pulsation, terms.stribeck)
    assert terms.harmonics is not None
    motion, other = (solve(s, cycles=4, rtol=1e-11).cycles.section
                     for s in (ENGINES[name].system(values), general))
    np.testing.assert_allclose(other, motion, rtol=1e-8, atol=1e-8)


BEGIN = State(5.0, 0.1, -5.0)
LOADED = {"pressure.mean": 260417.0, "pressure.amplitude": 52083.4, "friction.kinetic_coefficient": 0.24}
TURNED: dict[str, dict[str, Any]] = {
    "fig02": LOADED,
    "no stribeck": {**LOADED, "friction.kinetic_coefficient": 0.3, "pressure.amplitude": 0.0},
    "reversals": {**LOADED, "engine.mean_torque": 40.0, "engine.torque_amplitude": 900.0},
    "clamped, harmonics": {**LOADED, "pressure.amplitude": 4e5, "pressure.frequency_ratio": 2.0 / 3.0,
                           "engine.harmonic_amplitudes": (80.0, 40.0), "engine.harmonic_phases": (0.3, 1.0)},
    "overdamped": {**LOADED, "driveline.damping": 9794.0, "driveline.plate_inertia": 0.0016, "engine.mean_torque": 40.3,
                   "engine.torque_amplitude": 900.7},
    "light plate": {**LOADED, "driveline.plate_inertia": 4e-4, "driveline.damping": 10.0},
}
LAWS = {"smoothed": ("smoothed", "smoothed.solve"), "event_driven": ("set_valued", "event_driven.solve"),
        "fixed_step": ("smoothed", "fixed_step_solve")}


def turned(terms: Terms) -> Terms:
    """The terms with every engine torque the other way round."""
    return terms._replace(mean_torque=-terms.mean_torque,
                          torque=None if terms.torque is None else (-terms.torque[0], terms.torque[1]),
                          harmonics=None if terms.harmonics is None else terms.harmonics * (1.0, -1.0, 1.0))


@pytest.mark.parametrize("name", TURNED)
@pytest.mark.parametrize("engine", LAWS)
def test_turning_every_sign_turns_every_bit(engine: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    law, place = LAWS[engine]
    module = import_module(f"tcc_sim.solvers.{place}")

    def run(state: State) -> Trajectory:
        system = replace(System(), {**TURNED[name], "friction.law": law})  # What follows from a system is kept with it.
        cycles = 1 if engine == "fixed_step" else 3  # A light plate takes 1500 sub-steps a tick.
        result: Trajectory = module.solve(Problem(system, state, cycles=cycles, samples_per_cycle=50))
        return result.raise_for_status()

    straight = run(BEGIN)
    monkeypatch.setattr(module, "terms_of", lambda given: turned(terms_of(given)))
    if engine == "event_driven":  # Its tolerances go by the size of the torque: amplitudes are never negative there.
        monkeypatch.setattr(module, "bounds_of", lambda terms, *rest: bounds_of(turned(terms), *rest))
    other = run(State(-5.0, -0.1, 5.0))
    for column in ("slip_speed", "plate_angle", "plate_speed"):
        np.testing.assert_array_equal(getattr(straight, column), -getattr(other, column), err_msg=column)
    one, two = straight.cycles, other.cycles
    np.testing.assert_array_equal(one.section, -two.section)
    np.testing.assert_array_equal(one.highest, -two.lowest)
    np.testing.assert_array_equal(one.lowest, -two.highest)
    # From samples it is a sum over both edges of the layer, whose order the sign decides.
    np.testing.assert_allclose(one.stick_time, two.stick_time, rtol=1e-14 if engine == "fixed_step" else 0.0, atol=0.0)
    np.testing.assert_array_equal(straight.transitions.time, other.transitions.time)
    free = 2  # Without load there is no direction.
    after = straight.transitions.after
    np.testing.assert_array_equal(np.where(after == free, after, -after), other.transitions.after)
    if engine != "fixed_step":
        assert len(straight.transitions.time) > 0
