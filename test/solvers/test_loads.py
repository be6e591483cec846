"""Loads of each cycle beside dense samples, and those that samples have."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tcc_sim.analysis.steady.summary import cycles_of
from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.trajectory import Loads

FIRST, LAST = 6, 12


def loads_by(system: System, cycles: int = LAST, first: int = 0, **settings: object) -> Loads:
    """The loads of a run."""
    result = solve(system, cycles=cycles, loads_from=first, **settings).raise_for_status().cycles
    return result.loads


@pytest.mark.parametrize(("values", "rtol"), [
    ({"friction.law": "set_valued", "driveline.stiffness": 10.0, "engine.mean_torque": 0.0,
      "engine.torque_amplitude": 368.0, "initial.slip_speed": -100.0}, 1e-8),
    ({"engine.mean_torque": 200.0, "engine.torque_amplitude": 0.0, "engine.frequency": 123.6,
      "engine.harmonic_amplitudes": [146.0, 81.0, 141.0], "engine.harmonic_phases": [25.0, -84.4, -69.8],
      "pressure.mean": 225e3, "pressure.amplitude": 0.0, "initial.slip_speed": -100.0,
      "initial.plate_angle": 0.282}, 1e-10)])
def test_the_shaft_s_torque_is_largest_anywhere_in_a_long_step(values: dict[str, object], rtol: float) -> None:
    """Beside dense samples, also where the extreme lies between a step's end and the place next to it."""
    per_cycle = 8000
    for speed in np.linspace(-30.0, 30.0, 13):
        system = replace(load_scene("fig02").system, {**values, "initial.plate_speed": float(speed)})
        loads, d = loads_by(system, 4, rtol=rtol), system.driveline
        run = solve(system, cycles=4, samples_per_cycle=per_cycle, rtol=rtol)
        shaft = d.damping * run.plate_speed + d.stiffness * run.plate_angle
        for n in range(4):
            part = shaft[per_cycle * n:per_cycle * n + per_cycle + 1]
            assert loads.highest_shaft_torque[n] == pytest.approx(part.max(), abs=1e-6 * np.abs(part).max())
            assert loads.lowest_shaft_torque[n] == pytest.approx(part.min(), abs=1e-6 * np.abs(part).max())


@pytest.mark.parametrize("solver", ["smoothed", "fixed_step", "lsoda"])
def test_samples_have_the_loads_of_the_steps(solver: str) -> None:
    """Ticks of 0.1 ms, and the samples of LSODA."""
    system = load_scene("fig02").system
    exact = loads_by(system, rtol=1e-10)
    if solver == "smoothed":
        run = solve(system, cycles=LAST, samples_per_cycle=420)
        result = cycles_of(type(run)(**{**run.__dict__, "cycles": None})).loads
    else:
        result = loads_by(system, solver=solver, **({"step": 1e-4} if solver == "fixed_step" else {"rtol": 1e-8}))
    for name, rel in (("energy", 2e-4), ("peak_power", 1e-3), ("highest_shaft_torque", 1e-3)):
        assert getattr(result, name) == pytest.approx(getattr(exact, name), rel=rel)
    assert result.lowest_shaft_torque == pytest.approx(exact.lowest_shaft_torque, abs=0.5)
    assert result.breakaways.sum() == exact.breakaways.sum()


@pytest.mark.parametrize(("samples", "missed"), [(40, 0.4), (800, 0.1)])
def test_samples_have_the_time_in_stick_of_the_set_valued_law(samples: int, missed: float) -> None:
    """Slip ends and begins between two samples: on average over many of them nothing is missed."""
    off, count = 0.0, 0.0
    for frequency in np.linspace(60.0, 190.0, 7):
        run = solve(replace(load_scene("fig02").system, {"friction.law": "set_valued", "engine.frequency": frequency}),
                    cycles=40, samples_per_cycle=samples, loads_from=0)
        result = cycles_of(dataclasses.replace(run, cycles=None)).stick_time - run.cycles.stick_time
        off += float(result.sum()) * samples / run.cycle
        count += float(run.cycles.loads.breakaways.sum())
    assert count > 100.0
    assert abs(off) / count < missed
