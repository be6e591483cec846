"""Recordings whose states name their run: any order, repeat, clock, name or division gives the same figures.

A table of ways to write a recording again and all figures of `analyse --verify`; counts and sources against the inputs
that the driveline was given.
"""

import json
import math
import random
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from tcc_sim.cli import main
from tcc_sim.messages import cdr
from tcc_sim.messages.held import SIZE, held_message
from tcc_sim.plant.driveline import Plant
from tcc_sim.recording.announcements import holding_from
from tcc_sim.recording.bag import BagWriter
from tcc_sim.scene import load_scene
from tcc_sim.topics import FLOAT64, FLOAT64_ARRAY, FLUID_PRESSURE, JOINT_STATE, STRING

TICK, START, TICKS = 1_000_000, 10**18, 700
SCENE = load_scene("commands").with_values({"engine.frequency": 150.0})
FIRST, SECOND = "692a1f3c9b02.001", "692a1f3c9b02.002"
TYPES = {"scene": STRING, "held": FLOAT64_ARRAY, "joint_states": JOINT_STATE, "applied_pressure": FLUID_PRESSURE,
         "engine_torque": FLOAT64, "actuation_pressure": FLUID_PRESSURE}


class Sent(NamedTuple):
    """A message: name of its topic, time of sending, sequence number, bytes; and the tick of what it tells."""

    name: str
    sent: int
    number: int
    data: bytes
    tick: int = 0


def torque(k: int) -> float | None:
    return 300.0 + 250.0 * math.sin(0.15 * k) if 30 <= k < 600 else None


PAUSED, TAKEN_OVER = 450, 520
"""Ticks of the second run after which it is paused, and from which another publisher commands the pressure."""


def run_of(name: str, ticks: int, begin: int, sequence: dict[str, int]) -> list[Sent]:
    """The messages of a run: torque commands act from tick 30 to 599, pressure commands by twos from tick 40 on."""
    plant, out = Plant(SCENE), list[Sent]()

    def send(topic: str, tick: int, data: bytes, late: int) -> None:
        sequence[topic] = sequence.get(topic, 0) + 1
        out.append(Sent(topic, begin + tick * TICK + late, sequence[topic], data, tick))

    send("scene", 0, cdr.string(holding_from(SCENE.text(), 0, run=name, name="/driveline")), -5)
    number, received, superseded, before = 0, [0, 0], 0, None
    for k in range(ticks):
        engine, pressure = torque(k), 2e5 + 10.0 * k if k >= 40 else None
        if k:
            plant.hold(engine, pressure)
            plant.advance()
            if engine is not None:
                received[0] += 1
                send("engine_torque", k - 1, cdr.float64(engine), 300)
            if pressure is not None:
                received[1], superseded = received[1] + 2, superseded + 1
                for value in (1.0, pressure):
                    send("actuation_pressure", k - 1, cdr.fluid_pressure((k - 1) * TICK, value), 310)
        state = plant.reading()
        now = [value for held, count, over, stamp, who in (
            (engine, received[0], 0, math.nan, 1),
            (pressure, received[1], superseded, (k - 1.0) * TICK, 1 + (k >= TAKEN_OVER)))
            for value in ((2.0, held, held, stamp, k, who, count, over, 0, 0) if held is not None else
                          (1.0, *[math.nan] * 4, 0, count, over, 0, 0))]
        for after in (0, 1) if k == ticks - 1 else (0, 2) if k == PAUSED else (0,):
            if after or k % 100 == 0 or [*map(str, now)] != before:
                number, before = number + 1, [*map(str, now)]
                values = [k, k * TICK, number, after, *now]
                send("held", k, held_message(name, values + 2 * [3.0, *[math.nan] * 4, 0, 0, 0, 0, 0]), -2)
                assert len(values) + 20 == SIZE
        send("joint_states", k, cdr.joint_state(*state[:7], frame=name), 0)
        send("applied_pressure", k, cdr.fluid_pressure(state.stamp_ns, state.applied_pressure, frame=name), 1)
    return out


def made() -> list[Sent]:
    """A run that was reset, in the order of sending."""
    sequence: dict[str, int] = {}
    return [*run_of(FIRST, 300, START, sequence), *run_of(SECOND, TICKS, START + 300 * TICK, sequence)]


def save(folder: Path, messages: list[Sent], *, log: Callable[[Sent, int], int] = lambda one, k: one.sent,
         topic: Callable[[str], str] = "/{}".format, publisher: str = "aa", row: bool = True,
         parts: int = 1, listed: bool = True) -> Path:
    """Write a recording; `topic` names a topic, `row` states its own name in the file."""
    folder.mkdir(parents=True)
    size = -(-len(messages) // parts)
    for part in range(parts):
        writer = BagWriter(folder / f"part{part}")
        channels: dict[str, int] = {}
        for k, one in enumerate(messages[part * size:(part + 1) * size], part * size):
            if one.name not in channels:
                channels[one.name] = writer.channel(topic(one.name), TYPES[one.name], publisher=publisher and (
                    publisher * 12 + "0" * 6 + f"{list(TYPES).index(one.name):02d}"), row=one.name if row else "")
            when = log(one, k)
            writer.write(channels[one.name], when, when and one.sent, one.data, one.number)
        writer.close()
        (folder / f"part{part}" / f"part{part}_0.mcap").rename(folder / f"run_{part}.mcap")
        (folder / f"part{part}" / "metadata.yaml").unlink()
        (folder / f"part{part}").rmdir()
    return folder


def shuffled(messages: list[Sent]) -> list[Sent]:
    out = list(messages)
    random.Random(3).shuffle(out)
    return out


def late_by_one(messages: list[Sent]) -> list[Sent]:
    """One state is received after the next one."""
    k = next(k for k, one in enumerate(messages) if one.name == "joint_states" and one.tick == 77)
    after = next(j for j in range(k + 1, len(messages)) if messages[j].name == "joint_states")
    return [*messages[:k], *messages[k + 1:after + 1], messages[k], *messages[after + 1:]]


NAMES = {"joint_states": "/robot/states", "applied_pressure": "/actuation", "actuation_pressure": "/applied_pressure",
         "engine_torque": "/motor", "held": "/h", "scene": "/what"}
WAYS: dict[str, Callable[[Path, list[Sent]], Path]] = {
    "shuffled": lambda folder, all_: save(folder, shuffled(all_)),
    "backwards": lambda folder, all_: save(folder, all_[::-1]),
    "by topic": lambda folder, all_: save(folder, sorted(all_, key=lambda one: one.name)),
    "two recorders": lambda folder, all_: save(folder, [one for one in all_ for _ in range(2)]),
    "a recorder after the other": lambda folder, all_: save(folder, all_ + all_),
    "late by one": lambda folder, all_: save(folder, late_by_one(all_)),
    "no times": lambda folder, all_: save(folder, all_, log=lambda one, k: 0),
    "log times random": lambda folder, all_: save(folder, all_, log=lambda one, k: START + 7919 * k % 10**9),
    "clock set back": lambda folder, all_: save(folder, [
        one._replace(sent=one.sent - (one.sent > START + 500 * TICK) * 3600 * 10**9) for one in all_]),
    "no publisher": lambda folder, all_: save(folder, [one._replace(number=0) for one in all_], publisher=""),
    "remapped": lambda folder, all_: save(folder, all_, topic=NAMES.__getitem__),
    "namespace": lambda folder, all_: save(folder, all_, topic="/left/{}".format, row=False),
    "parts shuffled": lambda folder, all_: save(folder, shuffled(all_), parts=4),
    "parts backwards": lambda folder, all_: save(folder, all_[::-1], parts=4),
}
DIFFER = {"warnings", "drivelines", "real_time_factor", "elapsed_s", "command", "version", "messages", "topic"}
"""Fields that may differ: names, times of receipt, and repeats."""


def figures(path: Path, *options: str) -> dict:
    out = path.parent / f"{path.name}.json"
    assert main(["analyse", str(path), "--verify", "--discard", "1", "--frequency", "150", "--json", str(out),
                 *options]) == 0
    result = json.loads(out.read_text())
    for segment in result["segments"]:
        segment.pop("elapsed_s", None)
    return result


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Sent], dict]:
    folder = tmp_path_factory.mktemp("named")
    messages = made()
    return messages, figures(save(folder / "run", messages))


def test_a_recording_states_what_held_its_inputs_and_what_became_of_its_commands(original) -> None:
    result = original[1]
    assert (result["verified"], result["largest_difference"], result["states"]) == (True, 0.0, 1000)
    assert [(one["began_by"], round(one["start"] * 1e3)) for one in result["segments"]] == [
        ("start", 0), ("reset", 0), ("pause", PAUSED + 1),
        ("controller", TAKEN_OVER)]
    engine, pressure = (result["inputs"][name] for name in ("engine_torque", "actuation_pressure"))
    assert (engine["topic"], engine["fallback"]) == pytest.approx((0.27 + 0.57, 0.029 + 0.029 + 0.1))
    assert [engine[name] for name in ("applied", "superseded", "ignored", "refused", "lost")] == [840, 0, 0, 0, 0]
    assert [pressure[name] for name in ("commands", "applied", "superseded", "ignored")] == [1840, 920, 920, 0]
    assert result["command_age"] == {"median": 0.0, "p95": 0.0, "largest": 0.0}


@pytest.mark.parametrize("name", WAYS)
def test_a_recording_written_again_has_the_same_figures(tmp_path: Path, original, name: str) -> None:
    messages, expected = original
    result = figures(WAYS[name](tmp_path / "again", messages))
    assert {key: result[key] for key in expected.keys() - DIFFER} == {key: expected[key]
                                                                     for key in expected.keys() - DIFFER}


LOST: dict[str, tuple[Callable[[Sent], bool], int]] = {
    "the begin": (lambda one: one.sent < START + 60 * TICK and one.name not in ("scene", "held"), 60),
    "the begin after the reset": (lambda one: one.name == "joint_states" and one.sent >= START + 300 * TICK
                                  and one.tick < 40, 40),
    "the end before the reset": (lambda one: one.name == "joint_states" and one.sent < START + 300 * TICK
                                 and one.tick >= 280, 20),
    "a gap": (lambda one: one.name == "joint_states" and 100 <= one.tick < 110, 20),
}


@pytest.mark.parametrize("name", LOST)
def test_ticks_without_a_state_are_lost_wherever_they_are(tmp_path: Path, original, name: str) -> None:
    gone, count = LOST[name]
    result = figures(save(tmp_path / "run", [one for one in original[0] if not gone(one)]))
    assert result["lost_messages"] == count
    assert result["verified"]


@pytest.mark.parametrize("name", ["applied_pressure", "held", "actuation_pressure"])
def test_lost_messages_of_other_topics_make_nothing_wrong(tmp_path: Path, original, name: str) -> None:
    """Without a message on an input its ticks are unknown, never wrong; an applied pressure is known by `held`."""
    draw = random.Random(5)
    kept = [one for one in original[0] if one.name != name or draw.random() > 0.02 or one.tick in (0, 299, 699)]
    out = tmp_path / "j.json"
    status = main(["analyse", str(save(tmp_path / "run", kept)), "--verify", "--discard", "1", "--frequency", "150",
                   "--json", str(out)])
    result = json.loads(out.read_text())
    assert (status == 0) is result["verified"] is (name == "actuation_pressure" or name == "applied_pressure")
    assert result["largest_difference"] < 1e-9
    for key in ("clutch_energy", "max_slip_speed", "breakaways", "lost_messages"):
        assert result[key] == original[1][key]


def test_a_part_of_a_run_counts_what_acted_in_it(tmp_path: Path, original) -> None:
    path = save(tmp_path / "run", original[0])
    out = tmp_path / "j.json"
    assert main(["analyse", str(path), "--run", "1", "--from", "0.1", "--to", "0.2", "--discard", "0", "--frequency",
                 "150", "--json", str(out)]) == 0
    pressure = json.loads(out.read_text())["inputs"]["actuation_pressure"]
    assert (pressure["applied"], pressure["superseded"], pressure["topic"]) == (100, 100, pytest.approx(0.1))


def test_another_driveline_of_the_same_name_beside_it_is_listed_apart(tmp_path: Path, original) -> None:
    """As where a bag is played into the topics of a running driveline."""
    other = [one._replace(data=one.data.replace(FIRST.encode(), b"00000000ffff.001").replace(
        SECOND.encode(), b"00000000ffff.002")) for one in original[0]]
    mixed = [one for pair in zip(original[0], other) for one in pair]
    result = figures(save(tmp_path / "run", mixed))
    assert [(one["states"], one["read"]) for one in result["drivelines"]] == [(1000, False), (1000, True)]
    assert result["clutch_energy"] == original[1]["clutch_energy"]
