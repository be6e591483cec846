"""Turning every sign turns the motion, to the last bit: no engine prefers a direction anywhere, not even in rounding.

Signs of torques are turned in the terms, where -A sin(w t) is exact; a phase of pi would be rounded.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
import pytest

from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers.event_driven.setup import bounds_of
from tcc_sim.solvers.problem import Problem
from tcc_sim.solvers.terms import Terms, terms_of
from tcc_sim.trajectory import State, Trajectory

START = State(5.0, 0.1, -5.0)
FIG02 = {"pressure.mean": 260417.0, "pressure.amplitude": 52083.4, "friction.kinetic_coefficient": 0.24}
SCENES: dict[str, dict[str, Any]] = {
    "fig02": FIG02,
    "no stribeck": {**FIG02, "friction.kinetic_coefficient": 0.3, "pressure.amplitude": 0.0},
    "reversals": {**FIG02, "engine.mean_torque": 40.0, "engine.torque_amplitude": 900.0},
    "clamped, harmonics": {**FIG02, "pressure.amplitude": 4e5, "pressure.frequency_ratio": 2.0 / 3.0,
                           "engine.harmonic_amplitudes": (80.0, 40.0), "engine.harmonic_phases": (0.3, 1.0)},
    "overdamped": {**FIG02, "driveline.damping": 9794.0, "driveline.plate_inertia": 0.0016, "engine.mean_torque": 40.3,
                   "engine.torque_amplitude": 900.7},
    "light plate": {**FIG02, "driveline.plate_inertia": 1e-4, "driveline.damping": 10.0},
}
ENGINES = {"smoothed": ("smoothed", "smoothed.solve"), "event_driven": ("set_valued", "event_driven.solve"),
           "fixed_step": ("smoothed", "fixed_step_solve")}


def turned(terms: Terms) -> Terms:
    """The terms with every engine torque the other way round."""
    return terms._replace(mean_torque=-terms.mean_torque,
                          torque=None if terms.torque is None else (-terms.torque[0], terms.torque[1]),
                          harmonics=None if terms.harmonics is None else terms.harmonics * (1.0, -1.0, 1.0))


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("engine", ENGINES)
def test_turning_every_sign_turns_every_bit(engine: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    law, place = ENGINES[engine]
    module = import_module(f"tcc_sim.solvers.{place}")

    def run(state: State) -> Trajectory:
        system = replace(System(), {**SCENES[name], "friction.law": law})  # What follows from a system is kept with it.
        cycles = 1 if engine == "fixed_step" else 3  # A light plate takes 6000 sub-steps a tick.
        found: Trajectory = module.solve(Problem(system, state, cycles=cycles, samples_per_cycle=50))
        return found.raise_for_status()

    straight = run(START)
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
