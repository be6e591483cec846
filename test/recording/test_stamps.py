"""Gaps, resets, restarts and runs of stamps made by hand, and bags of other programs: joints, frames, SQLite."""

import random
import re
import struct

import numpy as np
import pytest
from driveline_bags import TICK, by_hand

from tcc_sim.cli import main
from tcc_sim.messages import cdr
from tcc_sim.recording.bag import BagWriter
from tcc_sim.recording.reader import open_run
from tcc_sim.recording.stamps import MOST_DIFFERENCES, Break, StampCounter
from tcc_sim.scene import load_scene
from tcc_sim.topics import JOINT_STATE


def stamps(*parts):
    return np.concatenate([np.asarray(part, dtype=np.int64) for part in parts])


def fed(values, sizes=(10**6,), publisher=None, numbers=None):
    """A counter after these stamps, in batches of these sizes in turn, and the pieces that it returned."""
    c, result, start, k = StampCounter(), [], 0, 0
    while start < len(values):
        end = start + sizes[k % len(sizes)]
        who = 0 if publisher is None else np.asarray(publisher)[start:end]
        pieces = c.pieces(values[start:end], who, None if numbers is None else np.asarray(numbers)[start:end])
        result += [(values[start:end][piece].tolist(), kind) for piece, kind in pieces]
        start, k = end, k + 1
    return c, result


def joined(result):
    """Pieces without the cuts between batches."""
    out = []
    for rows, kind in result:
        if kind is Break.NOTHING and out:
            out[-1] = (out[-1][0] + rows, out[-1][1])
        else:
            out.append((rows, kind))
    return out


def test_pieces_of_a_stream():
    c, result = fed(stamps([5, 6, 7, 9, 10, 10, 11, 3, 4]))
    assert result == [([5, 6, 7], Break.START), ([9, 10], Break.GAP), ([11], Break.NOTHING), ([3, 4], Break.RESET)]
    assert (c.tick, c.gaps, c.lost, c.repeated, c.runs, c.resets, c.restarts, c.messages) == (1, 1, 1, 1, 2, 1, 0, 9)
    assert c.pieces(stamps([5, 6])) == [(slice(0, 2), Break.NOTHING)]


def test_the_size_of_batches_makes_no_difference():
    draw = random.Random(3)
    values = stamps(range(100), range(150, 400), [400] * 3, range(401, 500), range(60), range(2, 300, 2), range(40))
    whole, pieces = fed(values)
    for _ in range(20):
        c, result = fed(values, [draw.randrange(2, 60) for _ in range(9)])
        assert (c.gaps, c.lost, c.uneven, c.repeated, c.runs, c.resets, c.messages) == (
            whole.gaps, whole.lost, whole.uneven, whole.repeated, whole.runs, whole.resets, whole.messages)
        assert joined(result) == joined(pieces)


def test_every_run_has_a_tick_of_its_own():
    c, result = fed(stamps(np.arange(500) * 10, np.arange(300) * 25))
    assert (c.gaps, c.lost, c.uneven, c.runs, c.tick) == (0, 0, 0, 2, 10)
    assert [kind for _, kind in result] == [Break.START, Break.RESET]
    assert fed(stamps(np.arange(300) * 25, np.arange(500) * 10))[0].tick == 10


def test_a_gap_at_the_start_and_uneven_stamps():
    c, _ = fed(stamps([0], 100 * 10**6 + np.arange(50) * 10**6, [150 * 10**6 + 200_000]))
    assert (c.tick, c.gaps, c.lost, c.uneven) == (10**6, 1, 99, 1)


def test_a_gap_begins_beyond_one_and_a_half_ticks():
    assert fed(stamps(np.arange(20) * 10, [205]))[0].gaps == 0
    c, _ = fed(stamps(np.arange(20) * 10, [206]))
    assert (c.gaps, c.lost) == (1, 1)


@pytest.mark.parametrize(("steps", "tick", "jitter", "uneven"), [
    ([1000] * 5 + [990, 1010, 989, 1011], 1000, 0, 2), ([100] * 5 + [98, 102, 97, 103], 100, 0, 2),
    ([990, 995, 1000, 1005, 1010, 1015], 1002, 12, 2), ([990, 995, 1000, 1005, 1010], 1000, 10, 0),
    ([990, 995, 1000, 1005, 1005], 1005, 0, 1)])
def test_steps_more_than_a_hundredth_from_the_tick_are_uneven_and_five_that_differ_jitter(steps, tick, jitter, uneven):
    """Jitter is the 95th percentile of the distance from the median step, by linear interpolation."""
    c, _ = fed(np.cumsum([0, *steps]))
    assert (c.tick, c._run.jitter, c.uneven, c.gaps) == (tick, jitter, uneven, 0)
    assert c._run.longest == tick + tick // 2 + jitter


@pytest.mark.parametrize("sizes", [(10**6,), (102,)])
def test_a_gap_among_steps_that_jitter_is_half_longer_than_the_step_before_too(sizes):
    """Of 1700 after 1500 and 2600 after 1700 only the latter; the longest step that is no gap is about 1550."""
    c, _ = fed(np.cumsum([0, *range(951, 1051), 1500, 1700, 2600]), sizes)
    assert (c.tick, c.gaps, c.lost, c.uneven) == (1002, 1, 2, 81)


@pytest.mark.parametrize(("before", "after", "returns"), [
    ([0, 1], [0, 1, 2], 0), ([0, 1, 2], [0, 3], 1), ([0, 1, 2], [0, 1, 2], 0), ([0, 5, 9], [1, 2, 10, 30], 1),
    ([0, 1, 2], [0, 2, 3], 0), ([0, 1, 2], [0, 9], 1), ([0, 1, 2, 3, 4], [0, 4, 9], 0)])
def test_a_run_that_jumps_to_beyond_the_end_of_the_one_before_returns_to_it(before, after, returns):
    assert fed(stamps(before, after))[0].returns == returns
    assert fed(stamps(before, after), publisher=[1] * (len(before) + len(after)))[0].returns == 0


@pytest.mark.parametrize("resets", [1, 5000])
def test_resets_are_counted_however_many_there_are(resets):
    c, result = fed(stamps(*[range(3)] * (resets + 1)), (7, 100, 1))
    assert (c.runs, c.resets, c.restarts, c.lost, c.mixed) == (resets + 1, resets, 0, 0, False)
    assert [rows for rows, _ in joined(result)] == [[0, 1, 2]] * (resets + 1)


def test_another_publisher_is_a_restart_though_its_stamps_go_on():
    values = stamps(range(100), range(150, 300), range(50))
    c, result = fed(values, publisher=[1] * 100 + [2] * 200)
    assert [kind for _, kind in result] == [Break.START, Break.RESTART, Break.RESET]
    assert (c.runs, c.restarts, c.resets, c.lost) == (3, 1, 1, 0)


def test_where_nobody_says_who_published_the_numbers_of_the_publisher_do():
    values = stamps(range(100), range(100), range(100))
    c, result = fed(values, numbers=[*range(1, 201), *range(1, 101)])
    assert [kind for _, kind in result] == [Break.START, Break.RESET, Break.RESTART]
    assert (c.resets, c.restarts) == (1, 1)


def test_what_a_publisher_says_after_another_took_over_is_left_out():
    values = stamps(range(50), [0, 50, 1, 51, 2, 52], range(3, 90))
    who = [1] * 50 + [2, 1, 2, 1, 2, 1] + [2] * 87
    c, result = fed(values, publisher=who)
    assert joined(result) == [(list(range(50)), Break.START), (list(range(90)), Break.RESTART)]
    assert (c.late, c.restarts, c.lost) == (3, 1, 0)


@pytest.mark.parametrize("block", [1, 7])
def test_two_publishers_by_turns_with_nothing_to_tell_them_apart_are_found(block):
    one, other = (np.arange(start, start + 700).reshape(-1, block) for start in (5000, 200))
    mixed = np.stack([one, other], axis=1).ravel()
    assert fed(mixed, (100,))[0].mixed
    # A reset with losses whose stamps later pass those of the run before is no mixture.
    assert not fed(stamps(range(100), range(95), range(101, 300)))[0].mixed


def test_memory_is_bounded_for_stamps_without_a_tick():
    c, _ = fed(np.cumsum(np.random.default_rng(1).integers(1, 10**12, MOST_DIFFERENCES + 5000)))
    assert len(c._run.differences) == MOST_DIFFERENCES


def test_extreme_stamps_do_not_overflow():
    c, _ = fed(stamps([-(1 << 61), 1 << 61, -(1 << 61), 0, 1 << 61]), (1, 2))
    assert (c.runs, c.messages) == (2, 5)


def test_no_stamps_are_no_run():
    c = StampCounter()
    assert c.pieces(np.empty(0, np.int64)) == []
    assert (c.runs, c.tick, c.gaps, c.lost, c.uneven, c.last) == (0, 0, 0, 0, 0, None)


@pytest.mark.parametrize(("first", "last"), [(60.0, 200.0), (600.0, 60.0), (60.0, 600.0)])
@pytest.mark.parametrize("batch", [500, 3600, 10**6])
def test_so_many_samples_to_a_cycle_of_a_run_up_leave_no_gap(first: float, last: float, batch: int) -> None:
    """Distances of stamps grow or shrink steadily, cycle by cycle; an omitted stamp is still a gap."""
    t = np.linspace(0.0, 4.0, 400_001)
    phase = first * t + 0.5 * (last - first) / 4.0 * t**2
    starts = np.interp(2.0 * np.pi * np.arange(int(phase[-1] / (2.0 * np.pi)) + 1), phase, t)
    stamps = np.round(1e9 * np.interp(np.arange(200 * (len(starts) - 1) + 1) / 200.0, np.arange(len(starts)), starts))
    whole, lossy, missing = StampCounter(), StampCounter(), np.delete(stamps.astype(np.int64), slice(9000, 9010))
    for k in range(0, len(stamps), batch):
        whole.pieces(stamps[k:k + batch].astype(np.int64))
        lossy.pieces(missing[k:k + batch])
    assert (whole.gaps, whole.lost) == (0, 0)
    assert lossy.gaps == 1


def joint_state(stamp, frame, names, columns):
    """A JointState in CDR, encoded without the package."""
    out = bytearray(struct.pack("<iI", stamp // 10**9, stamp % 10**9))

    def align(size):
        out.extend(b"\xaa" * (-len(out) % size))

    def text(word):
        align(4)
        out.extend(struct.pack("<I", len(word) + 1) + word.encode() + b"\0")

    text(frame)
    align(4)
    out.extend(struct.pack("<I", len(names)))
    for name in names:
        text(name)
    for column in columns:
        align(4)
        out.extend(struct.pack("<I", len(column)))
        align(8)
        out.extend(struct.pack(f"<{len(column)}d", *column))
    return b"\0\1\0\0" + bytes(out)


def foreign(path, names, places, frame="base_link", scene="slip"):
    """1.5 s of steady slip with flywheel and plate at these places among the joints."""
    rows = by_hand(1.5, lambda t: 150.0 + 0.0 * t, lambda t: 0.1 + 0.0 * t, lambda t: 0.0 * t,
                   lambda t: 300.0 + 250.0 * np.sin(150.0 * t), lambda t: 300.0 + 0.0 * t)
    writer = BagWriter(path, load_scene(scene).text())
    channel = writer.channel("/joint_states", JOINT_STATE)
    for stamp, *values, _ in rows:
        columns = []
        for pair in zip(values[::2], values[1::2]):
            column = [7.0] * len(names)
            for place, value in zip(places, pair):
                column[place] = value
            columns.append(column)
        writer.write(channel, stamp, stamp, joint_state(stamp, frame, names, columns))
    writer.close()
    return rows


@pytest.mark.parametrize(("names", "places", "joints"), [
    (("clutch_plate", "flywheel"), (1, 0), None),
    (("wheel_left", "flywheel", "x", "clutch_plate"), (1, 3), None),
    (("engine", "turbine"), (0, 1), {"flywheel": "engine", "clutch_plate": "turbine"}),
    (("a_longer_name", "b", "clutch_plate"), (1, 2), {"flywheel": "b"}),
])
def test_joints_stand_where_their_names_do(tmp_path, names, places, joints):
    rows = np.array(foreign(tmp_path / "run", names, places))
    run = open_run(tmp_path / "run", joints=joints)
    (batch,) = run.states()
    for name, column in (("flywheel_angle", 1), ("plate_angle", 2), ("flywheel_speed", 3), ("plate_speed", 4),
                         ("engine_torque", 5), ("friction_torque", 6)):
        assert np.array_equal(getattr(batch, name), rows[:, column])
    assert run.warnings == []


def test_other_joints_are_asked_for(tmp_path, capsys, refused):
    foreign(tmp_path / "run", ("engine", "turbine"), (0, 1))
    assert ("its joints are engine, turbine; say which of them are flywheel and clutch plate: "
            "--joints flywheel=NAME,clutch_plate=NAME") in refused("analyse", tmp_path / "run")
    assert main(["analyse", str(tmp_path / "run"), "--joints", "flywheel=engine,clutch_plate=turbine"]) == 0
    assert re.search(r"largest \|slip speed\| +15\d", capsys.readouterr().out)
    assert "must be flywheel=NAME,clutch_plate=NAME" in refused("analyse", tmp_path / "run", "--joints", "wheel=engine")


def test_the_layout_of_our_own_names_is_our_own():
    layout = cdr.joint_state_layout()
    assert layout.record == cdr.JOINT_STATE
    assert layout.example.tobytes() == cdr.joint_state(0, *[0.0] * 6)


@pytest.mark.parametrize("spread", [0.1, 0.4])
def test_stamps_that_jitter_are_no_losses(spread):
    random = np.random.default_rng(6)
    stamps = (np.arange(5000) * TICK + random.uniform(-spread, spread, 5000) * TICK).astype(np.int64)
    counter = StampCounter()
    for start in range(0, 5000, 700):
        counter.pieces(stamps[start:start + 700])
    assert (counter.lost, counter.gaps, counter.runs) == (0, 0, 1)
    assert counter.tick == pytest.approx(TICK, rel=0.05)
    lossy = StampCounter()
    lossy.pieces(np.delete(stamps, slice(2000, 2030)))
    assert (lossy.gaps, lossy.lost) == (1, 30)
