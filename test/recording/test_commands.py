"""Commands of a recording: decoded whatever the name of their frame, and placed on simulation time."""

import math
import struct

import numpy as np
import pytest
from driveline_bags import START, TICK, ticked

from tcc_sim.messages import cdr
from tcc_sim.recording.bag import BagWriter
from tcc_sim.replay.replay import replay
from tcc_sim.scene import load_scene
from tcc_sim.topics import FLOAT64, FLUID_PRESSURE, topic

LIMIT = 0.2


def framed(pressure, frame):
    """FluidPressure with a frame_id, laid out by the rules of CDR and without this package."""
    name = frame.encode() + b"\0"
    body = struct.pack("<iII", 0, 0, len(name)) + name
    body += b"\0" * (-len(body) % 8)
    return b"\x00\x01\x00\x00" + body + struct.pack("<dd", pressure, 0.0)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """One second at 1 kHz: pressure commands every 10 ms from 0.1 to 0.5 s and at 0.9 s, a target that changes once."""
    scene = load_scene("commands").with_values({"command_timeout": LIMIT, "engine.source": "harmonic"})
    sent = [*range(100, 501, 10), 900]
    at = dict.fromkeys(sent)

    def applied(k):
        last = max((s for s in sent if s < k), default=None)
        return 2.0e5 + last if last is not None and k - last <= 1000 * LIMIT else scene.system.pressure.mean

    folder = tmp_path_factory.mktemp("commands") / "run"
    writer = BagWriter(folder, scene.text())
    channels = {name: writer.channel(f"/{name}", kind) for name, kind in (
        ("joint_states", topic("joint_states").type), ("applied_pressure", FLUID_PRESSURE),
        ("actuation_pressure", FLUID_PRESSURE), ("target_slip_speed", FLOAT64))}
    for k, (stamp, *columns, pressure) in enumerate(ticked(scene, 1000, pressure=applied)):
        log = START + k * TICK
        if k in (0, 600):
            writer.write(channels["target_slip_speed"], log - TICK // 4, log - TICK // 4,
                         cdr.float64(20.0 if k == 0 else 5.0), k)
        writer.write(channels["joint_states"], log, log, cdr.joint_state(stamp, *columns), k)
        writer.write(channels["applied_pressure"], log, log, cdr.fluid_pressure(stamp, pressure), k)
        if k in at:
            frame = ("", "clutch", "a_longer_frame")[k // 10 % 3]
            writer.write(channels["actuation_pressure"], log + TICK // 2, log + TICK // 2, framed(2.0e5 + k, frame), k)
        if k == 300:  # Too short, not a number, and the bytes in another order.
            writer.write(channels["actuation_pressure"], log + TICK // 2, log, b"\x00\x01\x00\x00", k)
            writer.write(channels["target_slip_speed"], log, log, cdr.float64(math.nan), k)
            writer.write(channels["target_slip_speed"], log, log, b"\x00\x00\x00\x00" + struct.pack(">d", 7.0), k)
        if k % 100 == 99:
            writer.flush()
    writer.close({"lost": {}})
    return replay(folder).control, sent


def test_every_command_is_there_at_the_tick_that_came_after_it(found):
    control, sent = found
    np.testing.assert_array_equal(control.command.values, [2.0e5 + k for k in sent])
    np.testing.assert_allclose(control.command.t, [1e-3 * (k + 1) for k in sent], atol=1e-9)
    np.testing.assert_array_equal(control.target.values, [20.0, 5.0])
    np.testing.assert_allclose(control.target.t, [0.0, 0.6], atol=1e-9)
    assert control.controlled


def test_an_input_that_fell_back_is_an_event(found):
    control, _ = found
    assert [event.text for event in control.events] == [f"pressure falls back: no command for {LIMIT:g} s"]
    assert control.events[0].t == pytest.approx(0.501 + LIMIT, abs=2e-3)


def test_the_applied_pressure_follows_the_commands_and_falls_back(found):
    control, _ = found
    mean = load_scene("commands").system.pressure.mean
    at = np.searchsorted(control.applied.t, [0.25, 0.75, 0.95]) - 1
    assert control.applied.values[at[0]] == pytest.approx(2.0e5 + 245, abs=10.0)
    assert control.applied.values[at[1]] == mean
    assert control.applied.values[at[2]] == 2.0e5 + 900


@pytest.mark.parametrize("step", [0, -60, -3600_000, 3600_000])
@pytest.mark.parametrize("at", [99, 100, 250, 333])
def test_commands_are_beside_their_states_after_the_clock_was_set(step, at, tmp_path):
    """Set by `step` ms before the state of tick `at`; a chunk has 100 states. Commands every 7 ms, between states."""
    rows = ticked(load_scene("commands"), 500, pressure=lambda k: 2e5 + k)
    writer = BagWriter(tmp_path / "run", load_scene("commands").text())
    states = writer.channel("/joint_states", topic("joint_states").type)
    commands = writer.channel("/actuation_pressure", FLUID_PRESSURE)
    sent = range(3, 490, 7)
    for k, (stamp, *columns, _) in enumerate(rows):
        log = START + k * TICK + (step * TICK if k >= at else 0)
        writer.write(states, log, log, cdr.joint_state(stamp, *columns), k)
        if k in sent:
            log += TICK // 2
            writer.write(commands, log, log, cdr.fluid_pressure(0, 2e5 + k), k)
        if k % 100 == 99:
            writer.flush()
    writer.close({"lost": {}})
    command = replay(tmp_path / "run", frequency=150.0).control.command
    np.testing.assert_array_equal(command.values, [2e5 + k for k in sent])
    told = np.rint(command.t * 1e3).astype(int).tolist()
    # The first state after a command is the next; the last command before a step has the last state before it.
    assert [k + 1 - t for k, t in zip(sent, told) if t != k + 1] in ([], [1])
