"""Arguments of a solve, times of a run, and numbers of terms, against values by hand."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.profile import Inputs
from tcc_sim.solvers import SOLVERS, choose, solve, terms
from tcc_sim.trajectory import State

CYCLE = 0.25
PLAIN = replace(System(), {"engine.frequency": 2.0 * math.pi / CYCLE})
RAMP = replace(System(), {"engine.frequency_times": [0.0, 1.0], "engine.frequency_values": [
    2.0 * math.pi * 4.0, 2.0 * math.pi * 8.0]})
"""phi/(2 pi) = 4 t + 2 t^2 up to 1 s, at which 6 cycles are over; 8 cycles a second from then on."""
SETVALUED = {"friction.law": "set_valued"}


@pytest.mark.parametrize(("options", "words"), [
    ({}, ["cycles", "duration"]), ({"cycles": 1, "duration": 1.0}, ["cycles", "duration"]),
    ({"cycles": 0}, ["cycles", "0", "1 to 10000000"]), ({"cycles": 10_000_001}, ["cycles", "10000001", "10000000"]),
    ({"duration": 0.99e-8 * CYCLE}, ["duration", "2.475e-09 s", "2.5e-09 to 1e6 s"]),
    ({"duration": 1.1e6}, ["duration", "1.1e+06", "1e6 s"]), ({"duration": math.nan}, ["duration", "nan", "1e6 s"]),
    ({"cycles": 1, "samples_per_cycle": -1}, ["samples per cycle", "-1", "0 to 1000000"]),
    ({"cycles": 1, "samples_per_cycle": 1_000_001}, ["samples per cycle", "1000001", "0 to 1000000"]),
    ({"cycles": 1, "rtol": 0.9e-14}, ["rtol", "9e-15", "1e-14 to 0.1"]),
    ({"cycles": 1, "rtol": 0.11}, ["rtol", "0.11", "1e-14 to 0.1"]),
    ({"cycles": 1, "step": 1e-3}, ["step", "smoothed"]),
    ({"cycles": 1, "solver": "rk4", "rtol": 1e-3}, ["rtol", "rk4"]),
    ({"cycles": 1, "solver": "rk4", "step": 0.9e-9}, ["step", "9e-10 s", "1e-9 to 1 s"]),
    ({"cycles": 1, "solver": "rk4", "step": 1.1}, ["step", "1.1 s", "1e-9 to 1 s"]),
    ({"cycles": 1, "solver": "rk4", "step": math.nan}, ["step", "nan", "1e-9 to 1 s"]),
    ({"cycles": 1, "state": State(1.0, 2.0, -math.inf, 3.0)}, ["plate speed", "-inf", "finite"]),
    ({"cycles": 1, "solver": "euler"}, ["euler", *SOLVERS])])
def test_an_argument_out_of_its_range_is_refused_with_name_value_and_range(options, words) -> None:
    with pytest.raises(InputError) as refused:
        solve(PLAIN, **options)
    assert [word for word in words if word not in str(refused.value)] == []


def test_the_shortest_duration_goes_by_the_cycle_in_which_the_run_starts() -> None:
    assert solve(RAMP, start_cycle=6, duration=1.25e-9).t[-1] == 1.0 + 1.25e-9
    with pytest.raises(InputError, match=r"duration .*1\.25e-09"):
        solve(RAMP, start_cycle=6, duration=1.24e-9)


def test_the_solver_follows_from_law_and_inputs_and_a_refusal_names_those_that_do() -> None:
    set_valued = replace(PLAIN, SETVALUED)
    far = dataclasses.replace(PLAIN, inputs=Inputs(None, None, 1.0, np.array([[0.0, 1.0, 0.0]])))
    still = dataclasses.replace(PLAIN, inputs=Inputs(None, None, 1.0))
    assert [choose(system, "auto") for system in (PLAIN, set_valued, far, still)] == [
        "smoothed", "event_driven", "fixed_step", "smoothed"]
    smooth = [name for name in SOLVERS if name != "event_driven"]
    for system, solver, key, able in ((set_valued, "rk4", "friction.law set_valued", ["event_driven"]),
                                      (PLAIN, "event_driven", "friction.law smoothed", smooth),
                                      (replace(far, SETVALUED), "auto", "friction.law set_valued", ["fixed_step"]),
                                      (replace(RAMP, SETVALUED), "auto", "engine.frequency_times", smooth)):
        with pytest.raises(InputError) as refused:
            choose(system, solver)
        assert key in str(refused.value)
        named = str(refused.value).partition(" are ")[2].partition(", with ")[0]
        assert named.split(", ") == able
    assert {name: (entry.setting, entry.default) for name, entry in SOLVERS.items()} == {
        "fixed_step": ("step", 1e-3), "smoothed": ("rtol", 1e-8), "event_driven": ("rtol", 1e-10),
        "rk4": ("step", 1e-6),
        **dict.fromkeys(("rk45", "dop853", "radau", "bdf", "lsoda"), ("rtol", 1e-6))}


BEGINS = [0.0, math.sqrt(1.5) - 1.0, math.sqrt(2.0) - 1.0]
"""4 t + 2 t^2 = n."""


@pytest.mark.parametrize(("system", "options", "samples", "cycles"), [
    (PLAIN, {"cycles": 2}, [0.0, 0.125, 0.25, 0.375, 0.5], 2),
    (PLAIN, {"cycles": 1, "start_cycle": 3}, [0.75, 0.875, 1.0], 1),
    (PLAIN, {"duration": 0.55}, [0.0, 0.125, 0.25, 0.375, 0.5, 0.55], 2),
    (PLAIN, {"duration": 0.1, "start_cycle": 1}, [0.25, 0.35], 0),
    (PLAIN, {"duration": 0.5}, [0.0, 0.125, 0.25, 0.375, 0.5], 2),
    (PLAIN, {"duration": 0.5 * (1.0 + 1e-13)}, [0.0, 0.125, 0.25, 0.375, 0.5], 2),
    (RAMP, {"cycles": 2}, [0.0, 0.5 * BEGINS[1], BEGINS[1], 0.5 * (BEGINS[1] + BEGINS[2]), BEGINS[2]], 2),
    (RAMP, {"duration": 0.3}, [0.0, 0.5 * BEGINS[1], BEGINS[1], 0.3], 1),
    (RAMP, {"cycles": 3, "start_cycle": 5}, [math.sqrt(3.5) - 1.0, None, 1.0, 1.0625, 1.125, 1.1875, 1.25], 3)])
def test_samples_divide_cycles_and_end_where_the_run_does(system, options, samples, cycles) -> None:
    for solver in ("smoothed", "fixed_step"):
        run = solve(system, samples_per_cycle=2, solver=solver, state=State(1.0, 0.1, 3.0, 4.0), **options)
        expected = [t if t is not None else 0.5 * (samples[k - 1] + samples[k + 1]) for k, t in enumerate(samples)]
        assert run.t.tolist() == pytest.approx(expected, rel=1e-12)
        assert len(run.cycles) == cycles
        bare = solve(system, solver=solver, state=State(1.0, 0.1, 3.0, 4.0), **options)
        assert bare.t.tolist() == [run.t[0], run.t[-1]]


EVERY = {"engine.mean_torque": -50.0, "engine.torque_amplitude": 20.0, "engine.frequency": 100.0,
         "engine.harmonic_amplitudes": [0.0, 7.0, 3.0], "engine.harmonic_phases": [0.1, 0.2, 0.3],
         "pressure.mean": 2e5, "pressure.amplitude": 1e5, "pressure.frequency_ratio": 6.5, "pressure.phase": 0.4,
         "friction.kinetic_coefficient": 0.25, "converter.coupling": 1.5}
VARYING = {**EVERY, "engine.mean_torque_times": [0.0, 1.0], "engine.mean_torque_values": [-300.0, 100.0],
           "engine.frequency_times": [0.0, 1.0], "engine.frequency_values": [100.0, 200.0],
           "engine.torque_amplitude_times": [0.0, 1.0], "engine.torque_amplitude_values": [20.0, 40.0],
           "pressure.mean_times": [0.0, 1.0], "pressure.mean_values": [2e5, 0.5e5]}


def test_a_held_input_is_constant_and_nothing_else_changes() -> None:
    varying = terms.terms_of(replace(System(), VARYING))
    for t in (0.2, 1.3):
        now = np.array([t])
        plain = terms.torques_at(varying, now)
        assert terms.torques_at(terms.holding(varying, 9.0, None), now) == (pytest.approx(9.0), plain[1])
        assert terms.torques_at(terms.holding(varying, None, 8.0), now) == (plain[0], pytest.approx(8.0))
        line, past = min(t, 1.0), max(t - 1.0, 0.0)
        phase = 100.0 * line + 50.0 * line**2 + 200.0 * past
        mean, swell = -300.0 + 400.0 * line, 20.0 + 20.0 * line
        expected = mean + swell * math.sin(phase) + 7.0 * math.sin(3 * phase + 0.2) + 3.0 * math.sin(4 * phase + 0.3)
        pressure = max(2e5 - 1.5e5 * line + 1e5 * math.sin(6.5 * phase + 0.4), 0.0)
        assert plain == (pytest.approx(expected, rel=1e-12), pytest.approx(0.002 * pressure, rel=1e-12))
