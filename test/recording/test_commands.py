"""Commands of a recording: decoded for any frame_id, and placed on simulation time."""

import math
import struct

import numpy as np
import pytest
from driveline_bags import START, TICK, bag, ticked

from tcc_sim.messages import cdr
from tcc_sim.replay.control import _inferred_fallbacks
from tcc_sim.replay.replay import replay
from tcc_sim.scene import load_scene
from tcc_sim.topics import FLOAT64, FLUID_PRESSURE

LIMIT = 0.2
COMMANDS = load_scene("commands")
MINE = COMMANDS.with_values({"command_timeout": LIMIT, "engine.source": "harmonic"})


def unpressed(scene, ticks, **options):
    """Rows without the applied pressure."""
    return [(*row, math.nan) for *row, _ in ticked(scene, ticks, **options)]


def command(k, log, data=None, held=0, publisher=""):
    """A command that is sent half a tick after the state of row k, at `log`, ns, and received `held` ns later."""
    sent = log + TICK // 2
    return ("/actuation_pressure", FLUID_PRESSURE, sent + held, sent,
            cdr.fluid_pressure(0, 2e5 + k) if data is None else data, publisher)


def commands_in(path, rows, **options):
    """The commands that are found in a recording of these rows."""
    return replay(bag(path, rows, COMMANDS, **options), frequency=150.0).control.command


def framed(pressure, frame):
    """FluidPressure with a frame_id, laid out by the rules of CDR and without this package."""
    name = frame.encode() + b"\0"
    body = struct.pack("<iII", 0, 0, len(name)) + name
    body += b"\0" * (-len(body) % 8)
    return b"\x00\x01\x00\x00" + body + struct.pack("<dd", pressure, 0.0)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """One second at 1 kHz: pressure commands every 10 ms from 0.1 to 0.5 s and at 0.9 s, a target that changes once."""
    sent = [*range(100, 501, 10), 900]

    def applied(k):
        last = max((s for s in sent if s < k), default=None)
        return 2.0e5 + last if last is not None and k - last <= 1000 * LIMIT else MINE.system.pressure.mean

    others = {k: [command(k, START + k * TICK, framed(2.0e5 + k, ("", "clutch", "a_longer_frame")[k // 10 % 3]))]
              for k in sent}
    log = START + 300 * TICK  # Too short, not a number, and the bytes in another order.
    others[300] += [command(300, log, b"\x00\x01\x00\x00"), *(
        ("/target_slip_speed", FLOAT64, log, log, data)
        for data in (cdr.float64(math.nan), b"\x00\x00\x00\x00" + struct.pack(">d", 7.0)))]
    folder = bag(tmp_path_factory.mktemp("commands") / "run", ticked(MINE, 1000, pressure=applied), MINE,
                 targets=[(0, 20.0), (600, 5.0)], joined=others)
    return replay(folder).control, sent


def test_every_command_is_there_at_the_tick_that_came_after_it(result):
    control, sent = result
    np.testing.assert_array_equal(control.command.values, [2.0e5 + k for k in sent])
    np.testing.assert_allclose(control.command.t, [1e-3 * (k + 1) for k in sent], atol=1e-9)
    np.testing.assert_array_equal(control.target.values, [20.0, 5.0])
    np.testing.assert_allclose(control.target.t, [0.0, 0.6], atol=1e-9)
    assert control.controlled


def test_an_input_that_fell_back_is_an_event(result):
    control, _ = result
    assert [event.text for event in control.events] == [f"pressure falls back: no command for {LIMIT:g} s"]
    assert control.events[0].t == pytest.approx(0.501 + LIMIT, abs=2e-3)


def test_the_applied_pressure_follows_the_commands_and_falls_back(result):
    control, _ = result
    mean = COMMANDS.system.pressure.mean
    at = np.searchsorted(control.applied.t, [0.25, 0.75, 0.95]) - 1
    assert control.applied.values[at[0]] == pytest.approx(2.0e5 + 245, abs=10.0)
    assert control.applied.values[at[1]] == mean
    assert control.applied.values[at[2]] == 2.0e5 + 900


@pytest.mark.parametrize("step", [0, -60, -3600_000, 3600_000])
@pytest.mark.parametrize("at", [99, 100, 250, 333])
def test_commands_are_beside_their_states_after_the_clock_was_set(step, at, tmp_path):
    """The clock is set by `step` ms before tick `at`; a chunk has 100 states. Commands every 7 ms, between states."""
    def clock(k):
        return START + k * TICK + (step * TICK if k >= at else 0)

    sent = range(3, 490, 7)
    commands = commands_in(tmp_path / "run", unpressed(COMMANDS, 500, pressure=lambda k: 2e5 + k), clock=clock,
                           joined={k: [command(k, clock(k))] for k in sent})
    np.testing.assert_array_equal(commands.values, [2e5 + k for k in sent])
    counted = np.rint(commands.t * 1e3).astype(int).tolist()
    # The first state after a command is the next; the last command before a step has the last state before it.
    assert [k + 1 - t for k, t in zip(sent, counted) if t != k + 1] in ([], [1])


@pytest.mark.parametrize("late", [0.3, 2.5])
def test_a_command_that_is_received_late_stands_where_it_was_sent_and_holds_up_no_other(late, tmp_path):
    """A reliable middleware repeats missed messages, so some states and commands are received after later ones. The
    second of two senders sends a few commands.
    """
    def held(k, *rows):
        return round(late * 1e9) * (k in rows)

    others = {k: [command(k, START + k * TICK, held=held(k, 701, 703, 905), publisher="aa" if k % 2 else "bb")]
              for k in range(3000) if k % 2 or k % 500 == 4}
    commands = commands_in(tmp_path / "run", unpressed(COMMANDS, 3000, pressure=lambda k: 2e5 + k), joined=others,
                           received=lambda k: START + k * TICK + held(k, 400, 401, 402, 901, 1500))
    sent_at = np.array([k for k in range(2999) if k % 2 or k % 500 == 4])
    np.testing.assert_allclose(commands.t, 1e-3 * (sent_at + 1), atol=1e-9)
    np.testing.assert_array_equal(commands.values, 2e5 + sent_at)


def test_commands_of_a_machine_whose_clock_alone_is_set_back_are_not_kept_for_ever(tmp_path):
    """The states have no step of the clock that would release them."""
    back = [3600 * 10**9 * (k > 500) for k in range(2000)]
    commands = commands_in(tmp_path / "run", unpressed(COMMANDS, 2000, pressure=lambda k: 2e5 + k),
                           joined={k: [command(k, START + k * TICK - back[k], held=back[k])] for k in range(3, 2000,
                                                                                                            10)})
    sent_at = np.array([*range(3, 500, 10), *range(1003, 2000, 10)])  # Between, the last delayed ones.
    shown = np.isin(commands.values - 2e5, sent_at)
    np.testing.assert_array_equal(commands.values[shown], 2e5 + sent_at)
    np.testing.assert_allclose(commands.t[shown], 1e-3 * (sent_at + 1), atol=1e-9)


@pytest.mark.parametrize(("says", "until", "after", "fallen"), [
    (True, 100, 800, [0.6]), (False, 100, 800, [0.3]), (False, 795, 1000, [])])
def test_an_input_falls_back_where_the_driveline_says_so(says, until, after, fallen, tmp_path):
    """Commands that the recorder lost, even for longer than command_timeout or before a reset, are no fallback."""
    sources = []
    rows = unpressed(MINE, 1500, pressure=lambda k: 2e5 if 50 <= k < 600 or k >= 800 else None, resets=(1000,),
                     sources=sources)
    # Commands 100 to 600 are lost.
    bag(tmp_path / "run", rows, MINE, targets=[(0, 20.0)], sources=sources if says else (),
        joined={k: [command(0, START + k * TICK)] for k in range(50, len(rows)) if k < until or k >= after})
    control = replay(tmp_path / "run", frequency=150.0).control
    assert [(round(event.t, 2), event.text.partition(":")[0]) for event in control.events] == [
        *((at, "pressure falls back") for at in fallen), (1.0, "reset or restart")]
    later = replay(tmp_path / "run", frequency=150.0, discard=0)
    assert [segment.tracking.target for segment in later.segments] == [20.0, 20.0]


def test_only_inputs_that_come_from_topics_fall_back():
    stamps = np.array([0, 100, 700]) * TICK
    signals = dict.fromkeys(("engine_torque", "actuation_pressure"), (stamps, np.zeros(3)))
    events = [(event.t, event.text.split()[0]) for event in _inferred_fallbacks(MINE, signals, 0.75)]
    assert events == [(pytest.approx(0.3), "pressure")]


def test_a_target_outlives_a_reset(tmp_path):
    rows = ticked(load_scene("fig02"), 3000, resets=(400,))
    control = replay(bag(tmp_path / "run", rows, "fig02", targets=[(0, 20.0)])).control
    assert (control.target.t.tolist(), control.target.values.tolist()) == ([0.0], [20.0])
