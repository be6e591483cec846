"""Commands of a recording: decoded for any frame_id, and placed on simulation time."""

import math
import struct

import numpy as np
import pytest
from driveline_bags import START, TICK, bag, ticked

from tcc_sim.messages import cdr
from tcc_sim.recording.bag import BagWriter
from tcc_sim.replay.control import _inferred_fallbacks
from tcc_sim.replay.replay import replay
from tcc_sim.scene import load_scene
from tcc_sim.topics import FLOAT64, FLUID_PRESSURE, HEADER, topic

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
            writer.file.flush()
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
    """The clock is set by `step` ms before tick `at`; a chunk has 100 states. Commands every 7 ms, between states."""
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
            writer.file.flush()
    writer.close({"lost": {}})
    command = replay(tmp_path / "run", frequency=150.0).control.command
    np.testing.assert_array_equal(command.values, [2e5 + k for k in sent])
    told = np.rint(command.t * 1e3).astype(int).tolist()
    # The first state after a command is the next; the last command before a step has the last state before it.
    assert [k + 1 - t for k, t in zip(sent, told) if t != k + 1] in ([], [1])


@pytest.mark.parametrize("late", [0.3, 2.5])
def test_a_command_that_is_received_late_stands_where_it_was_sent_and_holds_up_no_other(late, tmp_path):
    """A reliable middleware repeats missed messages, so some states and commands are received after later ones. The
    second of two senders sends a few commands.
    """
    rows = ticked(load_scene("commands"), 3000, pressure=lambda k: 2e5 + k)
    writer = BagWriter(tmp_path / "run", load_scene("commands").text())
    states = writer.channel("/joint_states", topic("joint_states").type)
    mine = writer.channel("/actuation_pressure", FLUID_PRESSURE, publisher="aa")
    others = writer.channel("/actuation_pressure", FLUID_PRESSURE, publisher="bb")
    for k, (stamp, *columns, _) in enumerate(rows):
        sent, held = START + k * TICK, round(late * 1e9) * (k in (400, 401, 402, 901, 1500))
        writer.write(states, sent + held, sent, cdr.joint_state(stamp, *columns), k)
        if k % 2:
            held = round(late * 1e9) * (k in (701, 703, 905))
            writer.write(mine, sent + TICK // 2 + held, sent + TICK // 2, cdr.fluid_pressure(0, 2e5 + k), k)
        elif k % 500 == 4:
            writer.write(others, sent + TICK // 2, sent + TICK // 2, cdr.fluid_pressure(0, 2e5 + k), k)
        if k % 100 == 99:
            writer.file.flush()
    writer.close({"lost": {}})
    command = replay(tmp_path / "run", frequency=150.0).control.command
    sent_at = np.array([k for k in range(2999) if k % 2 or k % 500 == 4])
    np.testing.assert_allclose(command.t, 1e-3 * (sent_at + 1), atol=1e-9)
    np.testing.assert_array_equal(command.values, 2e5 + sent_at)


def test_commands_of_a_machine_whose_clock_alone_is_set_back_are_not_kept_for_ever(tmp_path):
    """The states have no step of the clock that would release them."""
    rows = ticked(load_scene("commands"), 2000, pressure=lambda k: 2e5 + k)
    writer = BagWriter(tmp_path / "run", load_scene("commands").text())
    states = writer.channel("/joint_states", topic("joint_states").type)
    commands = writer.channel("/actuation_pressure", FLUID_PRESSURE)
    for k, (stamp, *columns, _) in enumerate(rows):
        log = START + k * TICK
        writer.write(states, log, log, cdr.joint_state(stamp, *columns), k)
        if k % 10 == 3:
            log += TICK // 2
            writer.write(commands, log, log - 3600 * 10**9 * (k > 500), cdr.fluid_pressure(0, 2e5 + k), k)
        if k % 100 == 99:
            writer.file.flush()
    writer.close({"lost": {}})
    command = replay(tmp_path / "run", frequency=150.0).control.command
    sent_at = np.array([*range(3, 500, 10), *range(1003, 2000, 10)])  # Between, the last delayed ones.
    shown = np.isin(command.values - 2e5, sent_at)
    np.testing.assert_array_equal(command.values[shown], 2e5 + sent_at)
    np.testing.assert_allclose(command.t[shown], 1e-3 * (sent_at + 1), atol=1e-9)


@pytest.mark.parametrize(("says", "until", "after", "fallen"), [
    (True, 100, 800, [0.6]), (False, 100, 800, [0.3]), (False, 795, 1000, [])])
def test_an_input_falls_back_where_the_driveline_says_so(says, until, after, fallen, tmp_path):
    """Commands that the recorder lost, even for longer than command_timeout or before a reset, are no fallback."""
    scene = load_scene("commands").with_values({"engine.source": "harmonic", "command_timeout": LIMIT})
    sources = []
    rows = ticked(scene, 1500, pressure=lambda k: 2e5 if 50 <= k < 600 or k >= 800 else None, resets=(1000,),
                  sources=sources)
    writer = BagWriter(tmp_path / "run", scene.text())
    states = writer.channel("/joint_states", topic("joint_states").type)
    commands = writer.channel("/actuation_pressure", FLUID_PRESSURE)
    said = writer.channel("/input_source", HEADER)
    wished = writer.channel("/target_slip_speed", FLOAT64)
    writer.write(wished, START - TICK, START - TICK, cdr.float64(20.0))
    for k, (stamp, *columns, _) in enumerate(rows):
        log = START + k * TICK
        for since, text in (rest for row, *rest in sources if says and row == k):
            writer.write(said, log - 1, log - 1, cdr.header(since, text))
        writer.write(states, log, log, cdr.joint_state(stamp, *columns), k)
        if 50 <= k < until or k >= after:  # Commands 100 to 600 are lost.
            writer.write(commands, log + TICK // 2, log + TICK // 2, cdr.fluid_pressure(0, 2e5), k)
        if k % 100 == 99:
            writer.file.flush()
    writer.close({"lost": {}})
    control = replay(tmp_path / "run", frequency=150.0).control
    assert [(round(event.t, 2), event.text.partition(":")[0]) for event in control.events] == [
        *((at, "pressure falls back") for at in fallen), (1.0, "reset or restart")]
    later = replay(tmp_path / "run", frequency=150.0, discard=0)
    assert [segment.tracking.target for segment in later.segments] == [20.0, 20.0]


def test_only_inputs_that_come_from_topics_fall_back():
    scene = load_scene("commands").with_values({"engine.source": "harmonic", "command_timeout": LIMIT})
    stamps = np.array([0, 100, 700]) * TICK
    signals = dict.fromkeys(("engine_torque", "actuation_pressure"), (stamps, np.zeros(3)))
    events = [(event.t, event.text.split()[0]) for event in _inferred_fallbacks(scene, signals, 0.75)]
    assert events == [(pytest.approx(0.3), "pressure")]


def test_a_target_outlives_a_reset(tmp_path):
    rows = ticked(load_scene("fig02"), 3000, resets=(400,))
    control = replay(bag(tmp_path / "run", rows, "fig02", targets=[(0, 20.0)])).control
    assert (control.target.t.tolist(), control.target.values.tolist()) == ([0.0], [20.0])
