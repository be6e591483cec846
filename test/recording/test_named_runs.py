"""Recordings whose states name their run: ways to write one again x what is lost x figures.

Figures are sums over the states that are left, whatever their order, repeats, clocks, names and parts. Sources and
counts of the inputs are those that the driveline was given; where messages are missing they are unknown, never wrong.
"""

import json
import math
import os
import random
import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from diagnostics_by_hand import diagnostics

from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.messages import cdr
from tcc_sim.messages.held import SIZE, held_message
from tcc_sim.plant.driveline import Plant
from tcc_sim.recording.announcements import holding_from
from tcc_sim.recording.bag import BagWriter
from tcc_sim.recording.columns import Window
from tcc_sim.recording.reader import BYTES_A_STATE
from tcc_sim.replay.replay import replay
from tcc_sim.scene import Scene, load_scene
from tcc_sim.topics import DIAGNOSTIC_ARRAY, FLOAT64, FLOAT64_ARRAY, FLUID_PRESSURE, JOINT_STATE, STRING

TICK, START, TICKS = 1_000_000, 10**18, 350
SCENE = load_scene("commands").with_values({"engine.frequency": 150.0})
FIRST, SECOND, THIRD = "692a1f3c9b02.001", "692a1f3c9b02.002", "692a20000c11.001"
OTHER = SCENE.with_values({"friction.kinetic_coefficient": 0.2, "pressure.mean": 3e5})
"""Scene of the third run, of a driveline that was started again."""
TYPES = {"scene": STRING, "held": FLOAT64_ARRAY, "joint_states": JOINT_STATE, "applied_pressure": FLUID_PRESSURE,
         "engine_torque": FLOAT64, "actuation_pressure": FLUID_PRESSURE, "diagnostics": DIAGNOSTIC_ARRAY}
COMMANDED = "engine_torque", "actuation_pressure"


class Sent(NamedTuple):
    """A message: name of its topic, time of sending, sequence number, bytes; and run, tick, and the state of what it
    tells: slip speed, friction torque, and whether it is the end of the run.
    """

    name: str
    sent: int
    number: int
    data: bytes
    tick: int = 0
    run: str = ""
    slip: float = 0.0
    friction: float = 0.0
    ends: bool = False


def torque(k: int) -> float | None:
    return 300.0 + 250.0 * math.sin(0.15 * k) if 30 <= k < 300 else None


PAUSED, TAKEN_OVER = 225, 260
"""Ticks of the second run after which it is paused, and from which another publisher commands the pressure."""


def run_of(name: str, ticks: int, begin: int, sequence: dict[str, int], scene: Scene = SCENE) -> list[Sent]:
    """The messages of a run: torque commands act from tick 30 to 299, pressure commands by twos from tick 40 on."""
    plant, out = Plant(scene), list[Sent]()

    def send(topic: str, tick: int, data: bytes, late: int, *what: Any) -> None:
        sequence[topic] = sequence.get(topic, 0) + 1
        out.append(Sent(topic, begin + tick * TICK + late, sequence[topic], data, tick, name, *what))

    send("scene", 0, cdr.string(holding_from(scene.text(), 0, run=name, name="/driveline")), -5)
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
                values += 2 * [3.0, *[math.nan] * 4, 0, 0, 0, 0, 0]
                send("held", k, held_message(name, values), -2, 0.0, 0.0, after == 1)
                assert len(values) == SIZE
        send("joint_states", k, cdr.joint_state(*state[:7], frame=name), 0, state.slip_speed, state.friction_torque)
        send("applied_pressure", k, cdr.fluid_pressure(state.stamp_ns, state.applied_pressure, frame=name), 1)
    return out


def made() -> list[Sent]:
    """A run that was reset, and the run of a driveline that was started again, in the order of sending."""
    sequence: dict[str, int] = {}
    return [*run_of(FIRST, 150, START, sequence), *run_of(SECOND, TICKS, START + 150 * TICK, sequence),
            *run_of(THIRD, 200, START + 10**12, sequence, OTHER)]


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
    "by topic": lambda folder, all_: save(folder, sorted(all_, key=lambda one: one.name)),
    "two recorders": lambda folder, all_: save(folder, [one for one in all_ for _ in range(2)]),
    "a recorder after the other": lambda folder, all_: save(folder, all_ + all_),
    "late by one": lambda folder, all_: save(folder, late_by_one(all_)),
    "no times": lambda folder, all_: save(folder, all_, log=lambda one, k: 0),
    "clock set back": lambda folder, all_: save(folder, [
        one._replace(sent=one.sent - (one.sent > START + 250 * TICK) * 3600 * 10**9) for one in all_]),
    "no publisher": lambda folder, all_: save(folder, [one._replace(number=0) for one in all_], publisher=""),
    "remapped": lambda folder, all_: save(folder, all_, topic=NAMES.__getitem__),
    "namespace": lambda folder, all_: save(folder, all_, topic="/left/{}".format, row=False),
    "parts shuffled": lambda folder, all_: save(folder, shuffled(all_), parts=3),
}
DIFFER = {"warnings", "drivelines", "real_time_factor", "elapsed_s", "command", "version", "messages", "topic",
          "title"}
"""Fields that may differ: names, times of receipt, and repeats."""
PARTED = START + 275 * TICK


def one_of_each(messages: list[Sent]) -> list[Sent]:
    """Without one message of every topic but the scene."""
    gone = {next(k for k, one in enumerate(messages) if one.name == name and one.run == SECOND and one.tick == 175)
            for name in TYPES if name not in ("scene", "diagnostics")}
    return [one for k, one in enumerate(messages) if k not in gone]


def two_percent(messages: list[Sent]) -> list[Sent]:
    draw = random.Random(5)
    return [one for one in messages if one.name == "scene" or draw.random() > 0.02]


def alone(messages: list[Sent]) -> list[Sent]:
    """The part of a split recording after PARTED, which begins with the last scene and the last message of held."""
    before = [one for one in messages if one.sent < PARTED]
    latched = [next(one for one in reversed(before) if one.name == name) for name in ("scene", "held")]
    return [*latched, *(one for one in messages if one.sent >= PARTED)]


LEFT: dict[str, Callable[[list[Sent]], list[Sent]]] = {
    "all": list, "without one of each topic": one_of_each, "without 2 %": two_percent, "a part alone": alone,
    "trimmed": lambda all_: [one for one in all_ if one.sent > PARTED],
    "without the first run": lambda all_: [one for one in all_ if one.run != FIRST],
    "joined late": lambda all_: [one for one in all_ if one.sent > START + 60 * TICK or one.name in ("scene", "held")],
    "without a begin": lambda all_: [one for one in all_ if one.run != SECOND or one.name != "joint_states"
                                     or one.tick >= 40],
    "without an end": lambda all_: [one for one in all_ if one.run != SECOND or one.name != "joint_states"
                                    or one.tick < 325],
    "without held": lambda all_: [one for one in all_ if one.name != "held"],
    "without held for a while": lambda all_: [one for one in all_ if one.name != "held" or not 100 < one.tick < 140],
    "without applied pressures": lambda all_: [one for one in all_ if one.name != "applied_pressure"],
}


def figures(path: Path, *options: str) -> Any:
    out = path.parent / f"{path.name}{''.join(options)}.json"
    status = main(["analyse", str(path), "--verify", "--discard", "0", "--frequency", "150", "--json", str(out),
                   *options])
    result = json.loads(out.read_text())
    assert (status == 0) is result["verified"]
    for segment in result["segments"]:
        segment.pop("elapsed_s", None)
    return result


class Truth:
    """Figures of the messages that are left, by run and tick."""

    def __init__(self, messages: list[Sent]) -> None:
        states = {(one.run, one.tick): one for one in messages if one.name == "joint_states"}
        self.runs = {run: [tick for of, tick in sorted(states) if of == run] for run in (FIRST, SECOND, THIRD)}
        named = {one.run[:12] for one in messages if one.name == "scene"}  # Without it the driveline has no name.
        self.runs = {run: ticks for run, ticks in self.runs.items() if ticks and run[:12] in named}
        ends = {one.run: one.tick for one in messages if one.ends}
        self.lost = sum(max(ends.get(run, 0), ticks[-1]) + 1 - len(ticks) for run, ticks in self.runs.items())
        longest = max(self.runs, key=lambda run: len(self.runs[run]))
        self.ticks = np.array(self.runs[longest])
        slip, friction = np.array([[getattr(states[longest, tick], name) for tick in self.ticks.tolist()]
                                   for name in ("slip", "friction")])
        whole = np.diff(self.ticks) == 1
        power = slip * friction
        self.heat = float((0.5e-3 * (power[1:] + power[:-1]))[whole].sum())
        self.fastest = float(np.abs(slip).max())
        self.seconds = 1e-3 * int(whole.sum())
        # What acted in the tick before each state, by the inputs that the driveline was given.
        pairs = [(run, tick) for run, ticks in self.runs.items() for tick in ticks if tick > ticks[0]]
        before = {run: dict(zip(ticks[1:], ticks)) for run, ticks in self.runs.items()}
        self.by_commands = {name: 1e-3 * sum(tick - before[run][tick] for run, tick in pairs if first <= tick < last)
                            for name, (first, last) in {"engine_torque": (30, 300),
                                                        "actuation_pressure": (40, 10**9)}.items()}
        spans = [(ticks[0], ticks[-1]) for ticks in self.runs.values()]
        self.applied = {"engine_torque": sum(len(range(max(a + 1, 30), min(b, 299) + 1)) for a, b in spans),
                        "actuation_pressure": sum(len(range(max(a + 1, 40), b + 1)) for a, b in spans)}


@pytest.fixture(scope="module")
def original() -> list[Sent]:
    return made()


@pytest.fixture(scope="module")
def stored(original: list[Sent], tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    return cache(lambda left: save(tmp_path_factory.mktemp("named") / "run", LEFT[left](original)))


@pytest.fixture(scope="module")
def expected(stored: Callable[[str], Path]) -> Callable[[str], Any]:
    return cache(lambda left: figures(stored(left)))


@pytest.mark.parametrize("left", LEFT)
def test_figures_are_sums_over_the_states_that_are_left(original: list[Sent], expected: Callable[[str], Any],
                                                        left: str) -> None:
    result, truth = expected(left), Truth(LEFT[left](original))
    assert (result["runs"], result["lost_messages"]) == (len(truth.runs), truth.lost)
    assert result["messages"] == sum(map(len, truth.runs.values()))
    assert result["clutch_energy"] == pytest.approx(truth.heat, rel=0.04)
    assert truth.fastest <= result["max_slip_speed"] * (1 + 1e-9) <= 1.02 * truth.fastest
    assert result["seconds"] == pytest.approx(truth.seconds)
    assert result["covers"] == pytest.approx([truth.ticks[0] * 1e-3, truth.ticks[-1] * 1e-3])
    assert [one["began_by"] for one in result["segments"] if one["began_by"] not in ("pause", "controller")] == [
        None if ticks[0] > 2 else "start" if run == FIRST or (run, *truth.runs) == (THIRD, THIRD) else
        "reset" if run == SECOND else "restart" for run, ticks in truth.runs.items()]
    unknown = left == "without held"
    for name, one in result["inputs"].items():
        assert (one["topic"] is None) is unknown
        if unknown:
            assert (one["applied"], bool(one["why"])) == (None, True)
            continue
        span = sum((ticks[-1] - ticks[0]) * 1e-3 for ticks in truth.runs.values())
        assert one["topic"] + one["fallback"] + one["unknown"] == pytest.approx(span)
        assert -1e-9 <= truth.by_commands[name] - one["topic"] <= one["unknown"] + 1e-9
        assert 0 <= truth.applied[name] - one["applied"] <= 1e3 * one["unknown"] + 1
        if name == "actuation_pressure":
            assert one["superseded"] == one["applied"]
    assert result["largest_difference"] < 1e-6
    lossless = not unknown and all(one["unknown"] == 0.0 for one in result["inputs"].values())
    assert result["verified"] is lossless


@pytest.mark.parametrize(("way", "left"), [
    *((way, "all") for way in WAYS), ("two recorders", "without 2 %"), ("no times", "a part alone"),
    ("parts shuffled", "without 2 %")])
def test_a_recording_written_again_has_the_same_figures(tmp_path: Path, original: list[Sent],
                                                        expected: Callable[[str], Any], way: str, left: str) -> None:
    result, before = figures(WAYS[way](tmp_path / "again", LEFT[left](original))), expected(left)
    assert {key: result[key] for key in before.keys() - DIFFER} == {key: before[key] for key in before.keys() - DIFFER}


def test_a_recording_states_what_held_its_inputs_and_what_became_of_its_commands(expected: Callable[[str], Any]
                                                                                 ) -> None:
    result = expected("all")
    assert (result["verified"], result["largest_difference"], result["states"]) == (True, 0.0, 700)
    assert [(one["began_by"], round(one["start"] * 1e3)) for one in result["segments"]] == [
        ("start", 0), ("reset", 0), ("pause", PAUSED + 1), ("controller", TAKEN_OVER), ("restart", 0)]
    engine, pressure = (result["inputs"][name] for name in ("engine_torque", "actuation_pressure"))
    assert [engine[name] for name in ("applied", "superseded", "ignored", "refused", "lost")] == [560, 0, 0, 0, 0]
    assert [pressure[name] for name in ("commands", "applied", "superseded", "ignored")] == [1160, 580, 580, 0]
    assert result["command_age"] == {"median": 0.0, "p95": 0.0, "largest": 0.0}


@pytest.mark.parametrize("window", [("--from", "0.05", "--to", "0.15"), ("--run", "1")])
def test_commands_outside_of_a_window_are_not_counted_as_ignored(
        stored: Callable[[str], Path], expected: Callable[[str], Any], window: tuple[str, ...]) -> None:
    whole = expected("all")["inputs"]
    inputs, lossy = (figures(stored(left), *window)["inputs"] for left in ("all", "without 2 %"))
    for name, one in inputs.items():
        assert (one["ignored"], one["commands"]) == (0, one["applied"] + one["superseded"])
        assert 0 < one["commands"] < whole[name]["commands"]
        assert (lossy[name]["ignored"], lossy[name]["commands"], bool(lossy[name]["why"])) == (0, None, True)


def test_a_command_that_is_on_its_way_at_the_end_is_not_ignored(tmp_path: Path, original: list[Sent]) -> None:
    """The last commands were sent before the last state, and could not act on it."""
    end = START + 10**12 + 150 * TICK
    messages = [one._replace(sent=one.sent - 5 * TICK * (one.name in COMMANDED)) for one in original]
    inputs = figures(save(tmp_path / "cut", [one for one in messages if one.sent <= end]))["inputs"]
    assert [inputs[name]["ignored"] for name in COMMANDED] == [0, 0]
    # The driveline received nothing in its third run.
    deaf = [one._replace(data=one.data[:-8 * SIZE] + struct.pack(f"<{SIZE}d", *[0.0 if k % 10 == 0 and k > 4 else value
            for k, value in enumerate(struct.unpack(f"<{SIZE}d", one.data[-8 * SIZE:]))]))
            if one.name == "held" and one.run == THIRD else one for one in original]
    inputs = figures(save(tmp_path / "deaf", deaf))["inputs"]
    assert [inputs[name]["ignored"] for name in COMMANDED] == [170, 320]


def test_figures_are_computed_with_the_scene_of_the_longest_run(tmp_path: Path, original: list[Sent],
                                                                expected: Callable[[str], Any]) -> None:
    """A driveline with another shaft and a pressure of its own was recorded before."""
    scene = SCENE.with_values({"pressure.source": "harmonic", "driveline.stiffness": 1000.0})
    earlier = [one for one in run_of("692a00000c11.001", 30, START - 10**12, {}, scene)
               if one.name != "applied_pressure"]
    result, before = figures(save(tmp_path / "run", [*earlier, *original])), expected("all")
    for name in ("max_shaft_torque", "min_shaft_torque", "clutch_energy", "max_slip_speed", "verified"):
        assert result[name] == before[name], name
    assert not any("pressure is missing" in text for text in result["warnings"])


def test_counts_of_diagnostics_are_those_of_the_latest_message(tmp_path: Path, original: list[Sent],
                                                               expected: Callable[[str], Any]) -> None:
    """Whatever the order of the messages."""
    pytest.importorskip("diagnostic_msgs")
    reports = [Sent("diagnostics", START + tick * TICK, tick, diagnostics({
        "missed ticks": tick // 50, "late ticks": tick, "paced ticks": 10 * tick}, SECOND), tick, SECOND)
        for tick in (50, 150, 300)]
    for order in (1, -1):
        result = figures(save(tmp_path / str(order), [*original, *reports][::order]))
        assert (result["missed_ticks"], result["late_ticks"], result["late_share"]) == (6, 300, 0.1)


def test_states_without_efforts_leave_the_counts_of_commands_as_they_are(tmp_path: Path, original: list[Sent],
                                                                         expected: Callable[[str], Any]) -> None:
    nan = struct.pack("<2d", math.nan, math.nan)
    result = figures(save(tmp_path / "run", [
        one._replace(data=one.data[:-16] + nan) if one.name == "joint_states" else one for one in original]))
    before = expected("all")
    assert result["inputs"] == before["inputs"]
    assert result["clutch_energy"] == pytest.approx(before["clutch_energy"], rel=0.05)
    assert result["largest_difference"] < 1e-6


def test_a_part_of_a_run_counts_what_acted_in_it(tmp_path: Path, stored: Callable[[str], Path]) -> None:
    path = stored("all")
    out = tmp_path / "j.json"
    assert main(["analyse", str(path), "--run", "1", "--from", "0.1", "--to", "0.2", "--discard", "0", "--frequency",
                 "150", "--json", str(out)]) == 0
    pressure = json.loads(out.read_text())["inputs"]["actuation_pressure"]
    assert (pressure["applied"], pressure["superseded"], pressure["topic"]) == (100, 100, pytest.approx(0.1))


def test_another_driveline_of_the_same_name_beside_it_is_listed_apart(tmp_path: Path, original: list[Sent],
                                                                      expected: Callable[[str], Any]) -> None:
    """As where a bag is played into the topics of a running driveline."""
    mine = [one for one in original if one.run != THIRD]
    other = [one._replace(number=one.number + 10**6, data=one.data.replace(FIRST.encode(), b"00000000ffff.001").replace(
        SECOND.encode(), b"00000000ffff.002")) for one in mine]
    result = figures(save(tmp_path / "run", [one for pair in zip(mine, other) for one in pair]))
    assert [(one["states"], one["read"]) for one in result["drivelines"]] == [(500, False), (500, True)]
    assert result["clutch_energy"] == expected("all")["clutch_energy"]
    assert [(one["commands"], one["ignored"], bool(one["why"])) for one in result["inputs"].values()] == [
        (None, None, True)] * 2


def test_commands_on_topics_of_swapped_names_are_not_counted(tmp_path: Path, original: list[Sent],
                                                             expected: Callable[[str], Any]) -> None:
    swapped = {"applied_pressure": "/actuation_pressure", "actuation_pressure": "/applied_pressure"}
    result = figures(save(tmp_path / "run", original, topic=lambda name: swapped.get(name, f"/{name}"), row=False))
    pressure, before = (one["inputs"]["actuation_pressure"] for one in (result, expected("all")))
    assert (pressure["commands"], pressure["ignored"], bool(pressure["why"])) == (None, None, True)
    assert {name: pressure[name] for name in ("topic", "applied", "superseded", "lost")} == {
        name: before[name] for name in ("topic", "applied", "superseded", "lost")}


def test_a_part_of_a_recording_beyond_the_memory_has_the_counts_of_that_part(stored, monkeypatch):
    path, window = stored("all"), Window(1, 0.1, 0.25)
    every, part = (replay(path, discard=0, window=one).inputs for one in (None, window))
    assert 0 < part["engine_torque"].commands < every["engine_torque"].commands
    pages = 2 * 300 * BYTES_A_STATE // os.sysconf("SC_PAGE_SIZE")
    monkeypatch.setattr(os, "sysconf", lambda name, known=os.sysconf: pages if name == "SC_PHYS_PAGES" else known(name))
    with pytest.raises(InputError, match="--from and --to"):
        replay(path)
    assert replay(path, discard=0, window=window).inputs == part
