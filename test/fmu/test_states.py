"""States of an FMU are saved and continued to the last bit, starts are shifted, and profiles are checked."""

from __future__ import annotations

import math
import re
import struct
import sys

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed")

from fmpy.fmi1 import FMICallException
from fmus import DISCARD, Driven, needs_compiler, written

from tcc_sim.scene import load_scene
from tcc_sim.solvers.fixed_step import Stepper

pytestmark = needs_compiler


def test_a_kept_state_goes_on_to_the_last_bit_in_another_instance_too() -> None:
    unpacked = written("commands", 2)
    driven = Driven(unpacked).begin()
    driven.put({"engine_torque": 250.0, "actuation_pressure": 1.5e5, "friction.kinetic_coefficient": 0.28})
    driven.go(120)
    kept = driven.slave.getFMUState()
    data, time = driven.slave.serializeFMUstate(kept), driven.time
    driven.go(80)
    names = [name for name, row in driven.references.items() if name not in ("stick_slip_state", "time")]
    expected = driven.get(*names)
    driven.slave.setFMUState(kept)
    driven.time = time
    for _ in range(80):
        driven.go()
    assert driven.get(*names) == expected
    other = Driven(unpacked).begin()
    other.slave.setFMUState(other.slave.deSerializeFMUstate(data))
    other.time = time
    other.go(80)
    assert other.get(*names) == expected


def test_the_points_of_a_profile_are_fixed_parameters_that_are_checked_together() -> None:
    """Between its points the torque is linear, and the phase is the integral of the frequency."""
    scene = load_scene("fig02").with_values({
        "engine.mean_torque_times": [0.0, 0.1], "engine.mean_torque_values": [200.0, 300.0],
        "engine.frequency_times": [0.0, 0.1], "engine.frequency_values": [100.0, 150.0]})
    unpacked = written(scene, 2)
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
    status, sentence = other.said[-1]
    assert (status, sentence.partition(" is ")[0]) == (DISCARD, "engine.mean_torque_times[2]")


def test_a_start_elsewhere_shifts_the_time_and_fixed_values_hold_from_the_start() -> None:
    driven = Driven(written("fig02", 3, 5e-4))
    driven.put({"driveline.stiffness": 2500.0, "initial.slip_speed": 120.0})
    driven.begin(start=3.0)
    assert driven.get("slip_speed") == [120.0]
    driven.go(250)
    stepper = Stepper(load_scene("fig02").with_values({
        "driveline.stiffness": 2500.0, "initial.slip_speed": 120.0}).system, driven.step)
    for _ in range(250):
        stepper.advance()
    assert driven.get("slip_speed") == [stepper.state[0]]
    assert driven.get("time") == [3.125]
    assert not driven.said


def test_times_that_an_importer_adds_up_are_followed() -> None:
    """At 1.7e9 s neighbouring times are 2.4e-7 s apart, and a sum of milliseconds drifts by 7e-8 s each time."""
    start = 1.7e9
    driven = Driven(written("fig02", 2)).begin(start)
    for _ in range(500):
        driven.go()
    for k in range(500):  # Times that are multiples, and steps that are their differences.
        after = start + (501 + k) * driven.step
        driven.slave.doStep(driven.time, after - driven.time if k else driven.step)
        driven.time = after
    stepper = Stepper(load_scene("fig02").system, 1e-3)
    for _ in range(1000):
        stepper.advance()
    assert driven.get("slip_speed") == [stepper.state[0]]
    with pytest.raises(FMICallException):
        driven.slave.doStep(driven.time + 0.5 * driven.step, driven.step)
    said = driven.said[-1][1].replace(",", ".")  # C writes numbers in the locale of the importer.
    wrong, right = re.findall(r"[0-9.e+-]*[0-9]", said)
    assert float(wrong) - float(right) == pytest.approx(0.5 * driven.step, rel=1e-3)


@pytest.mark.parametrize("version", [2, 3])
def test_a_step_that_would_run_for_ever_is_refused(version: int) -> None:
    driven = Driven(written("fig02", version)).begin()
    for length in (1e9, 1e300, math.inf, math.nan):
        with pytest.raises(FMICallException):
            driven.slave.doStep(0.0, length)
        assert driven.said[-1][0] == DISCARD
    driven.go(2000)
    assert driven.get("plate_speed")[0] != 0.0


HEAD = 48
"""Bytes before the model in a kept state: the token and the sum over what follows."""


def forged(data: bytes, place: int, values: bytes) -> bytes:
    """A saved state with other bytes at a place of its model, and the matching checksum."""
    model = bytearray(data[HEAD:])
    place %= len(model)
    model[place:place + len(values)] = values
    total = 14695981039346656037
    for byte in model:
        total = (total ^ byte) * 1099511628211 % 2**64
    return data[:HEAD - 8] + total.to_bytes(8, sys.byteorder) + bytes(model)


def test_a_forged_number_is_refused_or_worked_out_anew() -> None:
    """Whatever a state holds, the next ticks are those of the state that was saved, or it is refused."""
    scene = load_scene("commands").with_values({"engine.mean_torque_times": [0.0, 0.1, 0.2],
                                                "engine.mean_torque_values": [200.0, 300.0, 250.0]})
    driven = Driven(written(scene, 3)).begin()
    driven.put({"pressure.frequency_ratio": 0.5})
    driven.go(50)
    slave, deserialise = driven.slave, driven.slave.deserializeFMUState
    data, time = bytes(slave.serializeFMUState(slave.getFMUState())), driven.time
    driven.go(50)
    expected, names = driven.get("slip_speed", "plate_angle"), ("slip_speed", "plate_angle")
    refused = 0
    for place in range(0, len(data) - HEAD - 8, 8):
        for value in (struct.pack("d", -math.inf), b"\xff" * 8):  # The latter is NaN, or -1.
            try:
                slave.setFMUState(deserialise(forged(data, place, value)))
                driven.time = time
                driven.go(50)
            except FMICallException:
                refused += 1
                continue
            assert driven.get(*names) == expected, place
    assert refused > 100
    number = 8 * driven.references["pressure.mean"]  # Variables come first, by their numbers.
    for value in (-1.0, 1e9):
        with pytest.raises(FMICallException):
            slave.setFMUState(deserialise(forged(data, number, struct.pack("d", value))))
    slave.setFMUState(deserialise(data))
    driven.time = time
    driven.go(50)
    assert driven.get(*names) == expected
