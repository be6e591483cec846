"""States of an FMU are kept and go on to the last bit, starts are shifted, and profiles are checked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed")

from fmpy.fmi1 import FMICallException
from fmus import DISCARD, Driven, needs_compiler, written

from tcc_sim.scene import load_scene
from tcc_sim.solvers.fixed_step import Stepper


@needs_compiler
@pytest.mark.parametrize("version", [2, 3])
def test_a_kept_state_goes_on_to_the_last_bit_in_another_instance_too(version: int, tmp_path: Path) -> None:
    unpacked = written(tmp_path, load_scene("commands"), version)
    driven = Driven(unpacked).begin()
    driven.put({"engine_torque": 250.0, "actuation_pressure": 1.5e5, "friction.kinetic_coefficient": 0.28})
    driven.go(120)
    kept = driven.slave.getFMUState()
    serialise = driven.slave.serializeFMUstate if version == 2 else driven.slave.serializeFMUState
    data, time = serialise(kept), driven.time
    driven.go(80)
    names = [name for name, row in driven.references.items() if name not in ("stick_slip_state", "time")]
    expected = driven.get(*names)
    driven.slave.setFMUState(kept)
    driven.time = time
    for _ in range(80):
        driven.go()
    assert driven.get(*names) == expected
    other = Driven(unpacked).begin()
    other.slave.setFMUState((other.slave.deSerializeFMUstate if version == 2 else
                             other.slave.deserializeFMUState)(data))
    other.time = time
    other.go(80)
    assert other.get(*names) == expected


@needs_compiler
def test_the_points_of_a_profile_are_fixed_parameters_that_are_checked_together(tmp_path: Path) -> None:
    """Between its points the torque is linear, and the phase is the integral of the frequency."""
    scene = load_scene("fig02").with_values({
        "engine.mean_torque_times": [0.0, 0.1], "engine.mean_torque_values": [200.0, 300.0],
        "engine.frequency_times": [0.0, 0.1], "engine.frequency_values": [100.0, 150.0]})
    unpacked = written(tmp_path, scene, 2)
    driven = Driven(unpacked)
    assert "engine.mean_torque" not in driven.references
    driven.put({"engine.mean_torque_values[2]": 400.0})
    driven.begin()
    driven.go(50)
    phase = 100.0 * 0.05 + 250.0 * 0.05**2
    assert driven.get("applied_engine_torque")[0] == pytest.approx(300.0 + 250.0 * np.sin(phase), rel=1e-12)
    driven.go(100)
    phase = 12.5 + 150.0 * 0.05
    assert driven.get("applied_engine_torque")[0] == pytest.approx(400.0 + 250.0 * np.sin(phase), rel=1e-12)
    other = Driven(unpacked)
    other.put({"engine.mean_torque_times[2]": 0.0})
    with pytest.raises(FMICallException):
        other.begin()
    assert other.said[-1] == (DISCARD, "engine.mean_torque_times[2] is 0 s; the first time must be 0 and the others "
                                       "increase")


@needs_compiler
@pytest.mark.parametrize("version", [2, 3])
def test_a_start_elsewhere_shifts_the_time_and_fixed_values_hold_from_the_start(version: int, tmp_path: Path) -> None:
    unpacked = written(tmp_path, load_scene("fig02"), version, 5e-4)
    driven = Driven(unpacked)
    driven.put({"driveline.stiffness": 2500.0, "initial.slip_speed": 120.0})
    driven.begin(start=3.0)
    assert driven.get("slip_speed") == [120.0]
    driven.go(250)
    stepper = Stepper(load_scene("fig02").with_values({
        "driveline.stiffness": 2500.0, "initial.slip_speed": 120.0}).system, 5e-4)
    for _ in range(250):
        stepper.advance()
    assert driven.get("slip_speed") == [stepper.state[0]]
    if version == 3:
        assert driven.get("time") == [3.125]
    assert not driven.said
