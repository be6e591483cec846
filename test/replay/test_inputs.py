"""Source of the inputs of a recording and lateness of its commands, known from its construction."""

from __future__ import annotations

import math

import pytest
from diagnostics_by_hand import diagnostics
from driveline_bags import START, TICK, bag, ticked

from tcc_sim.messages import cdr
from tcc_sim.recording.bag import BagWriter
from tcc_sim.replay.replay import replay
from tcc_sim.scene import load_scene
from tcc_sim.topics import DIAGNOSTIC_ARRAY, FLOAT64, FLUID_PRESSURE, JOINT_STATE

COMMANDS = load_scene("commands")


def torque(k):
    return 300.0 + 250.0 * math.sin(0.15 * k)


def test_the_seconds_of_commands_and_fallback_are_those_of_the_ticks(tmp_path):
    """Ticks 101 to 400 of 1200 have a pressure command; a reset after tick 600 begins 600 more without one."""
    sources = []
    rows = ticked(COMMANDS, 1200, torque=torque, pressure=lambda k: 2e5 if 100 < k <= 400 else None, resets=(600,),
                  sources=sources)
    found = replay(bag(tmp_path / "run", rows, COMMANDS, sources=sources), discard=0)
    pressure, engine = found.as_json()["inputs"]["actuation_pressure"], found.as_json()["inputs"]["engine_torque"]
    assert pressure["topic"] == pytest.approx(0.3)
    assert pressure["fallback"] == pytest.approx(1.199 - 0.3)
    assert (engine["topic"], engine["fallback"], engine["scene"]) == pytest.approx((1.199, 0.0, 0.0))
    assert found.as_json()["command_age"] is None
    own = replay(bag(tmp_path / "own", ticked(load_scene("fig02"), 900), "fig02")).inputs
    assert {name: held.scene for name, held in own.items()} == pytest.approx(dict.fromkeys(own, 0.899))


@pytest.mark.parametrize("late", [0, 7, None])
def test_the_age_of_commands_is_that_of_the_states_they_answer(tmp_path, late):
    writer = BagWriter(tmp_path / "run", COMMANDS.text())
    joints, applied = writer.channel("/joint_states", JOINT_STATE), writer.channel("/applied_pressure", FLUID_PRESSURE)
    commands = [writer.channel("/actuation_pressure", FLUID_PRESSURE, publisher=who) for who in ("aa", "bb")]
    target, status = writer.channel("/target_slip_speed", FLOAT64), writer.channel("/diagnostics", DIAGNOSTIC_ARRAY)
    writer.write(target, START, START, cdr.float64(20.0))
    for k, (stamp, *columns, _) in enumerate(ticked(COMMANDS, 1500, torque=torque, pressure=lambda k: 2e5)):
        log = START + k * TICK
        writer.write(joints, log, log, cdr.joint_state(stamp, *columns), k)
        writer.write(applied, log, log, cdr.fluid_pressure(stamp, 2e5), k)
        if k >= (late or 0):
            answered = 0 if late is None else stamp - late * TICK  # A stamp of 0 names no state.
            writer.write(commands[k % 2], log + 1000, log + 1000, cdr.fluid_pressure(answered, 2e5), k)
        if k in (500, 1000, 1400):  # After a restart counts begin at 0.
            counts = {500: (3, 5), 1000: (4, 6), 1400: (2, 1)}[k]
            data = diagnostics({"missed ticks": counts[0], "actuation_pressure refused": counts[1], "regime": "slip"})
            writer.write(status, log, log, data, k)
    writer.close({"lost": {}})
    found = replay(tmp_path / "run", discard=0)
    age = found.as_json()["command_age"]
    same = dict.fromkeys(("median", "p95", "largest"), (late or 0) * 1e-3)
    assert age == (None if late is None else pytest.approx(same, abs=1e-12))
    assert any("7 ticks late" in text for text in found.warnings) is (late == 7)
    held = found.inputs["actuation_pressure"]
    assert (held.publishers, held.refused, found.missed_ticks) == (2, 7, 6)
