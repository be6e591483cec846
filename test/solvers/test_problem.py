"""Arguments of a solve, times of a problem, numbers of terms and torques on the way, against values by hand."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.model.equations import Linear
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.profile import Inputs
from tcc_sim.solvers import SOLVERS, Entry, choose, solve, terms, torques
from tcc_sim.solvers.problem import Problem
from tcc_sim.trajectory import State

CYCLE = 0.25
PLAIN = replace(System(), {"engine.frequency": 2.0 * math.pi / CYCLE})
RAMP = replace(System(), {"engine.frequency_times": [0.0, 1.0], "engine.frequency_values": [
    2.0 * math.pi * 4.0, 2.0 * math.pi * 8.0]})
"""phi/(2 pi) = 4 t + 2 t^2 up to 1 s, at which 6 cycles are over; 8 cycles a second from then on."""
START = {"solver": "smoothed", "cycles": 1}


@pytest.fixture
def given(monkeypatch):
    """Function that returns the problem of a call of `solve`."""
    monkeypatch.setattr(Entry, "load", lambda self: lambda problem: problem)
    return lambda system=PLAIN, **options: solve(system, **options)


@pytest.mark.parametrize(("options", "sentence"), [
    ({}, "give either a number of cycles or a duration in s"),
    ({"cycles": 1, "duration": 1.0}, "give either a number of cycles or a duration in s"),
    ({"cycles": 0}, "cycles is 0; it must be 1 to 10000000"),
    ({"cycles": 10_000_001}, "cycles is 10000001; it must be 1 to 10000000"),
    ({"duration": 0.99e-8 * CYCLE}, "duration is 2.475e-09 s; it must be 2.5e-09 to 1e6 s"),
    ({"duration": 1.1e6}, "duration is 1.1e+06 s; it must be 2.5e-09 to 1e6 s"),
    ({"duration": math.nan}, "duration is nan s; it must be 2.5e-09 to 1e6 s"),
    ({"cycles": 1, "samples_per_cycle": -1}, "samples per cycle is -1; it must be 0 to 1000000"),
    ({"cycles": 1, "samples_per_cycle": 1_000_001}, "samples per cycle is 1000001; it must be 0 to 1000000"),
    ({"cycles": 1, "rtol": 0.9e-14}, "rtol is 9e-15; it must be 1e-14 to 0.1"),
    ({"cycles": 1, "rtol": 0.11}, "rtol is 0.11; it must be 1e-14 to 0.1"),
    ({"cycles": 1, "step": 1e-3}, "step is not a setting of solver smoothed"),
    ({"cycles": 1, "solver": "rk4", "rtol": 1e-3}, "rtol is not a setting of solver rk4"),
    ({"cycles": 1, "solver": "rk4", "step": 0.9e-9}, "step is 9e-10 s; it must be 1e-9 to 1 s"),
    ({"cycles": 1, "solver": "rk4", "step": 1.1}, "step is 1.1 s; it must be 1e-9 to 1 s"),
    ({"cycles": 1, "solver": "rk4", "step": math.nan}, "step is nan s; it must be 1e-9 to 1 s"),
    ({"cycles": 1, "state": State(1.0, 2.0, -math.inf, 3.0)}, "the initial plate speed is -inf; it must be finite"),
    ({"cycles": 1, "solver": "euler"}, "solver 'euler' is unknown; the solvers are auto, " + ", ".join(SOLVERS))])
def test_what_is_out_of_its_range_is_refused(given, options, sentence) -> None:
    with pytest.raises(InputError) as refused:
        given(**options)
    assert str(refused.value) == sentence


def test_bounds_belong_to_their_range_and_arguments_go_on_as_they_are(given) -> None:
    for options in ({"cycles": 10_000_000}, {"duration": 1e-8 * CYCLE}, {"duration": 1e6},
                    {"cycles": 1, "samples_per_cycle": 1_000_000}, {"cycles": 1, "rtol": 1e-14},
                    {"cycles": 1, "rtol": 0.1}, {"cycles": 1, "solver": "rk4", "step": 1e-9},
                    {"cycles": 1, "solver": "rk4", "step": 1.0}):
        problem = given(**options)
        assert all(getattr(problem, name) == value for name, value in options.items() if name != "solver")
    started = replace(PLAIN, {"initial.slip_speed": 3.0, "initial.plate_angle": 0.2, "initial.plate_speed": -1.0})
    assert given(started, cycles=1) == Problem(started, State(3.0, 0.2, -1.0, 0.2), 0, 1, None, 0, None, None, False,
                                               None)
    assert given(cycles=2, state=State(1.0, 2.0, 3.0, 4.0), start_cycle=5, samples_per_cycle=6, rtol=1e-3,
                 flywheel_angle=True, loads_from=1) == Problem(PLAIN, State(1.0, 2.0, 3.0, 4.0), 5, 2, None, 6, 1e-3,
                                                               None, True, 1)
    # The shortest duration goes by the cycle in which the run starts.
    assert given(RAMP, start_cycle=6, duration=1.25e-9).duration == 1.25e-9
    with pytest.raises(InputError, match=r"must be 1\.25e-09 to"):
        given(RAMP, start_cycle=6, duration=1.24e-9)


def test_the_solver_follows_from_law_and_inputs_and_a_refusal_names_those_that_do() -> None:
    set_valued = replace(PLAIN, {"friction.law": "set_valued"})
    moved = Inputs(None, None, 1.0, np.array([[0.0, 1.0, 0.0]]))
    far = dataclasses.replace(PLAIN, inputs=moved)
    assert [choose(system, "auto") for system in (PLAIN, set_valued, far)] == ["smoothed", "event_driven", "fixed_step"]
    still = dataclasses.replace(PLAIN, inputs=Inputs(None, None, 1.0))
    assert choose(still, "auto") == "smoothed"
    smooth = "those that do are fixed_step, smoothed, rk45, dop853, radau, bdf, lsoda, rk4"
    for system, solver, sentence in (
            (set_valued, "rk4", "solver rk4 does not solve friction.law set_valued; those that do are event_driven"),
            (PLAIN, "event_driven", f"solver event_driven does not solve friction.law smoothed; {smooth}"),
            (replace(far, {"friction.law": "set_valued"}), "auto", "solver fixed_step does not solve "
             "friction.law set_valued; those that do are fixed_step, with friction.law smoothed"),
            (replace(RAMP, {"friction.law": "set_valued"}), "auto", "solver event_driven does not solve "
             f"engine.frequency_times; {smooth}, with friction.law smoothed")):
        with pytest.raises(InputError) as refused:
            choose(system, solver)
        assert str(refused.value) == sentence
    assert {name: (entry.name, entry.setting, entry.default) for name, entry in SOLVERS.items()} == {
        "fixed_step": ("fixed_step", "step", 1e-3), "smoothed": ("smoothed", "rtol", 1e-8),
        "event_driven": ("event_driven", "rtol", 1e-10), "rk4": ("rk4", "step", 1e-6),
        **{name: (name, "rtol", 1e-6) for name in ("rk45", "dop853", "radau", "bdf", "lsoda")}}
    assert SOLVERS["rk4"].laws == ("smoothed",)
    assert SOLVERS["event_driven"].laws == ("set_valued",)
    assert (SOLVERS["rk4"].solves(PLAIN), SOLVERS["rk4"].solves(set_valued)) == (True, False)


def problem_of(system: System = PLAIN, **options: Any) -> Problem:
    return Problem(system, State(1.0, 2.0, 3.0, 4.0), **options)


def test_times_of_a_problem() -> None:
    """Starts of cycles and samples; what is left behind whole cycles is rounding below 1e-12, or 1e-9 of the output."""
    for options, start, end, whole, rest, starts, samples in (
            ({"cycles": 2}, 0.0, 0.5, 2, 0.0, [0.0, 0.25, 0.5], [0.0, 0.125, 0.25, 0.375, 0.5]),
            ({"cycles": 1, "start_cycle": 3}, 0.75, 1.0, 1, 0.0, [0.75, 1.0], [0.75, 0.875, 1.0]),
            ({"duration": 0.55}, 0.0, 0.55, 2, 0.05, [0.0, 0.25, 0.5, 0.55], [0.0, 0.125, 0.25, 0.375, 0.5, 0.55]),
            ({"duration": 0.1, "start_cycle": 1}, 0.25, 0.35, 0, 0.1, [0.25, 0.35], [0.25, 0.35]),
            ({"duration": 0.5}, 0.0, 0.5, 2, 0.0, [0.0, 0.25, 0.5], [0.0, 0.125, 0.25, 0.375, 0.5]),
            ({"duration": 0.5 * (1.0 + 1e-10)}, 0.0, 0.5, 2, 5e-11, [0.0, 0.25, 0.5], None),
            ({"duration": 0.5 * (1.0 + 1e-13)}, 0.0, 0.5, 2, 0.0, [0.0, 0.25, 0.5], [0.0, 0.125, 0.25, 0.375, 0.5])):
        problem = problem_of(samples_per_cycle=2, **options)
        assert (problem.start, problem.whole_cycles) == (start, whole)
        assert (problem.end, problem.rest) == (pytest.approx(end, rel=1e-9), pytest.approx(rest, rel=1e-5))
        assert problem.cycle_starts().tolist() == pytest.approx(starts, rel=1e-9)
        assert problem.breaks().tolist() == [problem.start, problem.end]
        if samples is not None:
            assert problem.sample_times().tolist() == pytest.approx(samples, rel=1e-12)
        assert problem.sample_times()[-1] == problem.end
    bare = problem_of(cycles=2)
    assert bare.sample_times().tolist() == [0.0, 0.5]
    assert (bare.first, problem_of(cycles=2, flywheel_angle=True).first) == ((1.0, 2.0, 3.0), (1.0, 2.0, 3.0, 4.0))


def test_times_of_a_problem_whose_cycles_change_their_length() -> None:
    begins = [0.0, math.sqrt(1.5) - 1.0, math.sqrt(2.0) - 1.0]  # 4 t + 2 t^2 = n.
    for options, end, starts in (({"cycles": 2}, begins[2], begins), ({"duration": 0.3}, 0.3, [*begins[:2], 0.3]),
                                 ({"duration": begins[2]}, begins[2], begins)):
        problem = problem_of(RAMP, samples_per_cycle=2, **options)
        assert problem.end == pytest.approx(end, rel=1e-14)
        assert problem.cycle_starts().tolist() == pytest.approx(starts, rel=1e-12)
        samples = [0.0, 0.5 * begins[1], begins[1], 0.5 * (begins[1] + begins[2]), begins[2]]
        expected = [*(t for t in samples if t < end - 1e-9), end]
        assert problem.sample_times().tolist() == pytest.approx(expected, rel=1e-12)
        assert problem.sample_times()[-1] == problem.end
    later = problem_of(RAMP, cycles=3, start_cycle=5)
    assert later.breaks().tolist() == pytest.approx([math.sqrt(3.5) - 1.0, 1.0, 1.25], rel=1e-12)
    assert problem_of(RAMP, cycles=2, start_cycle=6).breaks().tolist() == pytest.approx([1.0, 1.25])


EVERY = {"engine.mean_torque": -50.0, "engine.torque_amplitude": 20.0, "engine.frequency": 100.0,
         "engine.harmonic_amplitudes": [0.0, 7.0, 3.0], "engine.harmonic_phases": [0.1, 0.2, 0.3],
         "pressure.mean": 2e5, "pressure.amplitude": 1e5, "pressure.frequency_ratio": 6.5, "pressure.phase": 0.4,
         "friction.kinetic_coefficient": 0.25, "converter.coupling": 1.5}
VARYING = {**EVERY, "engine.mean_torque_times": [0.0, 1.0], "engine.mean_torque_values": [-300.0, 100.0],
           "engine.frequency_times": [0.0, 1.0], "engine.frequency_values": [100.0, 200.0],
           "engine.torque_amplitude_times": [0.0, 1.0], "engine.torque_amplitude_values": [20.0, 40.0],
           "pressure.mean_times": [0.0, 1.0], "pressure.mean_values": [2e5, 0.5e5]}
BARE = {"engine.torque_amplitude": 0.0, "pressure.amplitude": 0.0, "friction.kinetic_coefficient": 0.3}


@pytest.mark.parametrize(("values", "numbers"), [
    (EVERY, [600.0, 400.0, 650.0, 650.0, 50.0, 30.0]), (VARYING, [600.0, 100.0, 1300.0, 1300.0, 300.0, 50.0]),
    ({**EVERY, "pressure.amplitude": 0.0}, [400.0, 400.0, 400.0, 0.0, 50.0, 30.0]),
    ({**VARYING, "pressure.amplitude": 0.0}, [400.0, 100.0, 800.0, 0.0, 300.0, 50.0]),
    ({**BARE, "engine.mean_torque": 3.0, "pressure.mean": 1e5}, [240.0, 240.0, 0.0, 0.0, 3.0, 0.0])])
def test_numbers_of_terms(values, numbers) -> None:
    """Loads are mu_k A R P with A R = 0.008 m^3: 200 N m per 100 kPa, 240 with mu_k = 0.3."""
    of = terms.terms_of(replace(System(), values))
    got = [terms.peak_load(of), terms.least_mean_load(of), terms.excitation_frequency(of), terms.load_frequency(of),
           terms.largest_mean_torque(of), terms.torque_swing(of)]
    assert got == pytest.approx(numbers, rel=1e-12)


def test_terms_that_are_there_and_their_numbers() -> None:
    named = ["engine torque sine", "engine torque harmonics 2, 3, ...", "pressure sine", "smoothing tanh",
             "Stribeck exponential", "pressure clamp", "profiles in time", "fluid coupling"]
    for values, absent in ((EVERY, {"pressure clamp", "profiles in time"}), (VARYING, {"engine torque sine"}),
                           ({**EVERY, "pressure.amplitude": 2.1e5}, {"profiles in time"}),
                           (BARE, set(named) - {"smoothing tanh"})):
        assert terms.held_and_left_out(terms.terms_of(replace(System(), values))) == (
            [name for name in named if name not in absent], [name for name in named if name in absent])
    of = terms.terms_of(replace(System(), EVERY))
    assert (of.torque, of.mean_torque, of.smoothing, of.profile, of.far) == ((20.0, 100.0), -50.0, 50.0, None, None)
    assert of.harmonics.tolist() == [[300.0, 7.0, 0.2], [400.0, 3.0, 0.3]]
    assert of.pulsation == pytest.approx((200.0, 650.0, 0.4))
    assert of.stribeck == pytest.approx((0.2, 2.0))
    varying = terms.terms_of(replace(System(), VARYING))
    assert (varying.torque, varying.pulsation) == (None, pytest.approx((200.0, 6.5, 0.4)))
    bare, every = (terms.for_ticks(terms.terms_of(replace(System(), values))) for values in (BARE, EVERY))
    assert (bare.torque, bare.harmonics.tolist(), bare.pulsation, bare.stribeck) == (
        (0.0, 0.0), [[0.0, 0.0, 0.0]], (0.0, 0.0, 0.0), None)
    assert (bare.linear.flywheel_by_slip, bare.linear.plate_by_slip) == (0.0, 0.0)
    assert every == terms.terms_of(replace(System(), EVERY))._replace(linear=every.linear, harmonics=every.harmonics)
    assert terms.padded((0.1, 2.0)) == (0.1, 2.0, 0.0, 1.0, 0.0, 1.0)


def test_what_is_held_is_constant_and_nothing_else_changes() -> None:
    of, varying = (terms.terms_of(replace(System(), values)) for values in (EVERY, VARYING))
    torque, load = terms.holding(of, 9.0, None), terms.holding(of, None, 8.0)
    assert torque == of._replace(mean_torque=9.0, torque=(0.0, 100.0), harmonics=torque.harmonics)
    assert torque.harmonics.tolist() == [[300.0, 0.0, 0.2], [400.0, 0.0, 0.3]]
    assert load == of._replace(mean_load=8.0, pulsation=(0.0, 650.0, 0.4))
    assert terms.same_but_means(of, of._replace(mean_torque=9.0, mean_load=8.0))
    for name, other in (("torque", (1.0, 100.0)), ("harmonics", of.harmonics.copy()), ("stribeck", None),
                        ("pulsation", None), ("smoothing", 51.0), ("linear", of.linear._replace(damping=1.0)),
                        ("profile", varying.profile), ("approach", np.zeros((1, 4))), ("far", np.zeros((1, 4)))):
        assert not terms.same_but_means(of, of._replace(**{name: other})), name
    for t in (0.2, 1.3):
        now = np.array([t])
        plain = terms.torques_at(varying, now)
        assert terms.torques_at(terms.holding(varying, 9.0, None), now) == (pytest.approx(9.0), plain[1])
        assert terms.torques_at(terms.holding(varying, None, 8.0), now) == (plain[0], pytest.approx(8.0))
        line, past, phase = min(t, 1.0), max(t - 1.0, 0.0), 0.0
        phase = 100.0 * line + 50.0 * line**2 + 200.0 * past
        mean, swell = -300.0 + 400.0 * line, 20.0 + 20.0 * line
        expected = mean + swell * math.sin(phase) + 7.0 * math.sin(3 * phase + 0.2) + 3.0 * math.sin(4 * phase + 0.3)
        pressure = max(2e5 - 1.5e5 * line + 1e5 * math.sin(6.5 * phase + 0.4), 0.0)
        assert plain == (pytest.approx(expected, rel=1e-12), pytest.approx(0.002 * pressure, rel=1e-12))
        piece = terms.piece_of(varying, t - 0.1, t + 0.1)
        assert len(piece.profile) == 1
        assert terms.torques_at(piece, now) == plain
    assert terms.piece_of(of, 0.0, 1.0) is of


def test_steps_that_cycles_and_ticks_are_allowed() -> None:
    """A tick resolves the fastest oscillation by 0.04 rad, and keeps the scalar equation's root unique."""
    natural = math.sqrt(3000.0 / 0.02)
    for period, allowed in ((40.0 * 2.0 * math.pi / natural, 2000), (40.1 * 2.0 * math.pi / natural, 4000),
                            (100.0 * 2.0 * math.pi / natural, 6000)):
        assert terms.steps_allowed(terms.terms_of(replace(System(), BARE)), period * (1.0 - 1e-12)) == allowed
    fast, slow = (terms.terms_of(replace(System(), {**EVERY, **more})) for more in (
        {"converter.coupling": 0.0}, {"pressure.amplitude": 0.0, "engine.harmonic_amplitudes": [], "pressure.mean": 1e3,
                                      "engine.harmonic_phases": []}))
    of_law = 2.0 * 1e-3 * 55.0 * (600.0 + 200.0) * 0.2 * 2.0
    assert terms.substeps(slow, 1e-3) == math.ceil(1e-3 * natural / 0.04)
    assert terms.substeps(fast, 1e-3, 200.0) == math.ceil(of_law)
    assert terms.substeps(slow, 1e-9) == 1
    assert terms.substeps_needed(fast, 0.04 / 650.0 * 7.0) >= 7.0
    plain = terms.terms_of(replace(System(), {**BARE, "pressure.mean": 1e9 / 240.0, "engine.torque_amplitude": 1.0,
                                              "engine.frequency": 4000.0}))
    assert [terms.substeps(plain, n * 1e-5 * f) for n, f in ((3, 1.0), (3, 1.0001), (1, 1.0))] == [3, 4, 1]
    assert terms.substeps(plain, 20_000 * 1e-5) == 20_000
    with pytest.raises(InputError, match=r"^a step of 0\.20001 s needs 20001 sub-steps; fixed_step allows at most 2"):
        terms.substeps(plain, 20_001 * 1e-5)
    assert terms.substeps_needed(plain, math.inf) == math.inf


def test_torques_on_the_way_by_hand() -> None:
    """Loads of an actuator, the pull of a moving far end, and pieces of a profile."""
    approach = np.array([[1.0, 100.0, 40.0, 2.0]])
    load, pull, piece, after = (getattr(torques, name).py_func for name in ("load_on_approach", "pull_of_far_end",
                                                                            "piece_at", "break_after"))
    assert load(1.5, 7.0, None) == 7.0
    assert load(1.5, 7.0, approach) == pytest.approx(100.0 + 40.0 * (1.0 - math.exp(-1.0)))
    assert load(1.5, 7.0, approach * [[1.0, 1.0, 1.0, 0.0]]) == 120.0
    assert load(1.5, 7.0, approach * [[1.0, 1.0, -6.0, 0.0]]) == 0.0
    far, linear = np.array([[0.0, 0.1, 2.0, 4.0], [1.0, 0.5, 3.0, -2.0]]), Linear(0.2, 0.02, 0.6, 3000.0)
    assert pull(0.5, None, 0, linear) == 0.0
    assert pull(0.5, far, 0, linear) == pytest.approx(0.6 * 4.0 + 3000.0 * (0.1 + 1.0 + 0.5))
    assert pull(1.5, far, 1, linear) == pull(1.5, far, 7, linear) == pytest.approx(0.6 * 2.0 + 3000.0 * (2.0 - 0.25))
    profile = np.array([[0.0, 9.0], [1.0, -9.0], [2.0, 1.5]])
    assert (piece(None, 5.0), after(None, 5.0, 0.25)) == (0, 0.25)
    assert [piece(profile, t) for t in (-1.0, 0.0, 0.9, 1.0, 2.0, 9.0)] == [0, 0, 0, 1, 2, 2]
    for t, h, expected in ((0.5, 0.25, 0.25), (0.5, 0.5, 0.5), (0.5, 0.75, 0.5), (1.0, 2.0, 1.0), (2.0, 1.0, 1.0),
                           (0.5, 0.5 * (1.0 + 5e-10), 0.5 * (1.0 + 5e-10)), (1.0 - 1e-12, 1.0, 1e-9)):
        assert after(profile, t, h) == pytest.approx(expected, rel=1e-12), (t, h)
