"""Commands of a recording by what became of them: every way to send them, counts and ages known by construction."""

from __future__ import annotations

import math

import numpy as np
import pytest
from driveline_bags import START, TICK, bag, ticked

from tcc_sim.messages import cdr
from tcc_sim.recording.announcements import source_text
from tcc_sim.replay.replay import replay
from tcc_sim.scene import load_scene
from tcc_sim.topics import FLUID_PRESSURE

SCENE = load_scene("controlled")
N = 1500
WALL = 1_700_000_000 * 10**9


def every(period, value=lambda k: 9e4 + k, stamp=lambda k: k * TICK, begin=1, after=TICK // 2):
    """Commands as (time of sending after state k, stamp, value), one after every `period`-th state."""
    return [(k, after, stamp(k), value(k)) for k in range(begin, N - 2) if k % period == 0]


def recorded(folder, commands, *, ignored=(), announced=True, late=(), bursts=1, one=False, target=True):
    """A bag of a driveline that holds each command from the next tick on, or the one after it for indices in `late`,
    and never those in `ignored`, which are of another publisher unless there is but `one`. Of several commands between
    two states it holds the last; it receives them in bursts of so many ticks."""
    held: dict[int, float] = {}
    for number, (k, _, _, value) in enumerate(commands):
        if number not in ignored:
            held[-(-(k + 2 if number in late else k + 1) // bursts) * bursts] = value

    def pressure(k):
        nonlocal now
        now = held.get(k, now)
        return now

    now, sources, others = None, [], {}
    rows = ticked(SCENE, N, pressure=pressure, sources=sources)
    if ignored and len(ignored) == len(commands):
        sources = [(0, 0, source_text({"engine_torque": False, "actuation_pressure": False}))]
    for number, (k, after, stamp, value) in enumerate(commands):
        at = START + k * TICK + after
        data, who = cdr.fluid_pressure(stamp, value), "deaf" if number in ignored and not one else "heard"
        others.setdefault(k, []).append(("/actuation_pressure", FLUID_PRESSURE, at, at, data, who))
    return replay(bag(folder, rows, SCENE, joined=others, sources=sources if announced else (),
                      targets=[(0, 20.0)] if target else ()), discard=0)


TWICE = sorted([*every(1, after=TICK // 4), *every(1, value=lambda k: 8e4 + k, after=TICK // 2)])
WAYS = {
    # name: commands, what the driveline did, applied, superseded, ignored, median and largest age (ticks)
    "lock-step": (every(1), {}, 1497, 0, 0, 0, 0),
    "10 Hz": (every(100), {}, 14, 0, 0, 50, 99),
    "50 ticks late, every 5": (every(5, stamp=lambda k: (k - 50) * TICK, begin=55), {}, 289, 0, 0, 52, 54),
    "two between states": (TWICE, {}, 1497, 1497, 0, 0, 0),
    "a tick later than sent": (every(10), {"late": range(149)}, 149, 0, 0, 5, 10),
    "bursts of 8 ms": (every(1), {"bursts": 8}, 187, 1302, 8, 4, 8),
    "none arrives": (every(1), {"ignored": range(1497)}, 0, 0, 1497, None, None),
    "every third is ignored": (every(1), {"ignored": range(0, 1497, 3)}, 998, 0, 499, 0, 1),
    "not connected at first": (every(1), {"ignored": range(500), "one": True}, 997, 0, 500, 0, 0),
    "without announcements": (every(100), {"announced": False}, 14, 0, 0, 50, 99),
    "stops": (every(10)[:20], {}, 20, 0, 0, 554, 1298),
    "wall clock": (every(5, stamp=lambda k: WALL + k * TICK), {}, 299, 0, 0, None, None),
    "future": (every(5, stamp=lambda k: (k + 20) * TICK), {}, 299, 0, 0, None, None),
    "without stamps": (every(5, stamp=lambda k: 0), {}, 299, 0, 0, None, None),
    "one stamp": (every(5, stamp=lambda k: 5 * TICK), {}, 299, 0, 0, 747, 1493),
    "out of range": ([*every(100), (1300, TICK // 2, 1300 * TICK, -5.0)], {"ignored": [14]}, 14, 0, 1, 50, 99),
}
SAID = {"wall clock": "carry stamps of the wall clock", "future": "later than the state before which they acted",
        "one stamp": "repeat the stamp of the command before", "none arrives": "none of the 1497 recorded commands",
        "a target": "give --target"}


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("way", WAYS)
def test_what_became_of_the_commands(tmp_path, way):
    commands, how, applied, superseded, ignored, median, largest = WAYS[way]
    result = recorded(tmp_path / "run", commands, **how)
    held, (tracking,) = result.inputs["actuation_pressure"], [segment.tracking for segment in result.segments]
    assert (held.commands, held.applied, held.superseded, held.ignored) == (len(commands), applied, superseded, ignored)
    assert (tracking.commands_applied, tracking.commands_superseded) == (applied, superseded)
    assert tracking.command_rate == pytest.approx(applied / ((N - 1) * 1e-3))
    if median is None:
        assert result.command_age is None
    else:
        assert result.command_age.median == pytest.approx(median * 1e-3, abs=1.01e-3)
        assert result.command_age.largest == pytest.approx(largest * 1e-3, abs=1.01e-3)
    for other, text in SAID.items():
        assert any(text in warning for warning in result.warnings) is (other == way), other
    assert any("s old (median)" in text for text in result.warnings) is bool(median and median > 0)


def test_a_controller_without_a_target_is_named(tmp_path):
    result = recorded(tmp_path / "run", every(10), target=False)
    assert any("give --target" in text for text in result.warnings)
    assert result.segments[0].tracking is None


def test_an_actuator_hides_the_command_and_its_order_of_sending_counts(tmp_path):
    scene = SCENE.with_values({"pressure.time_constant": 0.03})
    rows = ticked(SCENE, N, pressure=lambda k: 9e4 + 1e3 * math.sin(0.01 * k))
    commands = every(10)
    others = {}
    for k, after, stamp, value in commands:
        at = START + k * TICK + after
        others[k] = [("/actuation_pressure", FLUID_PRESSURE, at, at, cdr.fluid_pressure(stamp, value))]
    result = replay(bag(tmp_path / "run", rows, scene, joined=others, targets=[(0, 20.0)]), discard=0)
    held = result.inputs["actuation_pressure"]
    assert (held.applied, held.ignored) == (len(commands), 0)
    assert np.isfinite(result.command_age.median)
