"""Verification follows scenes by their order and stamps; a clock that is set back changes nothing."""

import pytest
from driveline_bags import START, TICK, bag, ticked

from tcc_sim.recording.announcements import SceneRecord, holding_from
from tcc_sim.recording.columns import JointStates
from tcc_sim.recording.reader import open_run
from tcc_sim.replay.replay import replay
from tcc_sim.replay.timeline import places_of
from tcc_sim.scene import load_scene

FIG02, COMMANDED = load_scene("fig02"), load_scene("commands")
CHANGES = [(100, {"engine.mean_torque": 250.0}, False), (250, {"pressure.amplitude": 0.0}, True)]
SECOND = 10**9


def stepping(*steps):
    """A clock that is set by these times (ns) before these rows."""
    return lambda number: START + number * TICK + sum(by for row, by in steps if number >= row)


def paired(first, second):
    """Each of the first with one of the second, in turn."""
    return [(one, second[n % len(second)]) for n, one in enumerate(first)]


def verified(tmp_path, resets, clock, changes=CHANGES, ticks=400):
    said = []
    rows = ticked(FIG02, ticks, changes=changes, resets=resets, said=said)
    result = replay(bag(tmp_path / "run", rows, FIG02, said=said, clock=clock), verify=True)
    return result.verification, len(rows), result


@pytest.mark.parametrize(("steps", "resets"), paired([
    [(50, -3600 * SECOND)], [(100, -SECOND)], [(101, -SECOND)], [(249, -50 * TICK)], [(251, -200 * TICK)],
    [(300, -10 * TICK)], [(80, -SECOND), (200, -SECOND)], [(120, -300 * TICK), (240, 3600 * SECOND)]],
    [(), (99,), (100, 250), (60, 180, 300)]))
def test_after_a_step_of_the_clock_every_state_is_followed_to_the_last_bit(tmp_path, resets, steps):
    result, count, _ = verified(tmp_path, resets, stepping(*steps))
    assert (result.verified, result.largest_difference, result.exact) == (True, 0.0, count)


def test_a_change_of_the_second_run_is_not_taken_for_one_of_the_first(tmp_path):
    """The clock is set back by more than the first run took, so times do not show to which run a scene belongs."""
    said = []
    first = ticked(FIG02, 500)
    second = ticked(FIG02, 400, changes=[(150, {"engine.mean_torque": 250.0}, False)], said=said)
    path = bag(tmp_path / "run", first + second, FIG02, said=[(row + 500, text) for row, text in said],
               clock=stepping((490, -400 * TICK)))
    result = replay(path, verify=True).verification
    assert (result.verified, result.exact) == (True, 900)


STEPS = [[(50, -3600 * SECOND)], [(70, -SECOND)], [(71, -30 * TICK)], [(200, -120 * TICK)], [(281, -SECOND)],
         [(80, -SECOND), (200, -SECOND)], [(120, -300 * TICK), (240, 3600 * SECOND)]]


def fallen_back(tmp_path, resets, clock, changes=()):
    """A driveline with inputs by commands for part of the time, and by its scene's harmonics for the rest."""
    said, sources = [], []
    rows = ticked(COMMANDED, 400, torque=lambda k: 310.0 if 70 <= k < 130 or k >= 280 else None,
                  pressure=lambda k: 2.1e5 if 100 <= k < 200 or 230 <= k < 240 else None, resets=resets,
                  changes=changes, said=said, sources=sources)
    return replay(bag(tmp_path / "run", rows, COMMANDED, said=said, sources=sources, clock=clock),
                  verify=True).verification, len(rows)


@pytest.mark.parametrize(("steps", "resets"), paired([[], *STEPS], [(60, 180, 300), (99,), ()]))
def test_after_a_step_of_the_clock_every_fallback_is_followed_to_the_last_bit(tmp_path, resets, steps):
    result, count = fallen_back(tmp_path, resets, stepping(*steps))
    assert (result.verified, result.largest_difference, result.exact) == (True, 0.0, count)


def test_fallbacks_and_changed_parameters_are_followed_together(tmp_path):
    changes = [(150, {"engine.torque_amplitude": 100.0}, False), (250, {"pressure.amplitude": 0.0}, True)]
    result, count = fallen_back(tmp_path, (180,), stepping((170, -100 * TICK)), changes)
    assert (result.verified, result.exact) == (True, count)


def test_sources_that_a_recorder_got_twice_count_once(tmp_path):
    """A recorder that subscribes again receives all latched messages again, with their first times of sending."""
    sources = []
    rows = ticked(COMMANDED, 300, torque=lambda k: 310.0 if k >= 70 else None, pressure=lambda k: None, sources=sources)
    path = bag(tmp_path / "run", rows, COMMANDED,
               sources=[*sources, *((200, stamp, text, row) for row, stamp, text in sources)])
    assert [source.first_stamp_ns for source in open_run(path).columns().sources] == [0, 70 * TICK]
    assert replay(path, verify=True).verification.verified


def test_the_pace_does_not_count_a_step(tmp_path):
    result = verified(tmp_path, (), stepping((200, -3600 * SECOND)))[2]
    assert result.pace == pytest.approx(1.0, abs=0.5)


def states(run, ticks, sent, index=0):
    """States with these stamps and times of sending; all values are 0."""
    import numpy as np

    zero = np.zeros(len(ticks))
    return JointStates(np.array(ticks) * TICK, np.array(sent), np.array(sent), *[zero] * 6, run=run, index=index)


def record(stamp, said):
    return SceneRecord(holding_from("a: 1\n", stamp) if stamp is not None else "a: 1\n", "1", said)


def test_places_of_scenes():
    records = [record(None, 5), record(3 * TICK, 1025), record(0, 2005), record(2 * TICK, 2016),
               record(99 * TICK, 2030)]
    runs = [states(0, range(5), [1000, 1010, 1020, 1030, 1040]), states(1, range(4), [2010, 2015, 2020, 2030], 5)]
    assert places_of(records, runs) == [(0, 0), (3, 1), (5, 2),
                                        (7, 3)]  # The last never came into force.


@pytest.mark.parametrize(("said", "runs", "row"), [(1005, 1, 2), (1035, 1, 2), (1005, 2, 2), (1035, 2, 7)])
def test_a_scene_that_was_said_at_another_time_holds_from_its_stamp_on(said, runs, row):
    """Sent before the preceding state, or after its own; it belongs to the run with the later state."""
    records = [record(None, 5), record(2 * TICK, said)]
    assert places_of(records, [states(run, range(5), [1000 * (run + 1) + 10 * k for k in range(5)], 5 * run)
                               for run in range(runs)]) == [(0, 0), (row, 1)]


def test_two_changes_before_one_tick_are_taken_in_their_order():
    records = [record(None, 5), record(TICK, 1001), record(TICK, 1002)]
    assert places_of(records, [states(0, [0, 1, 2], [1000, 1010, 1020])]) == [
        (0, 0), (1, 1), (1, 2)]


def test_a_recorder_that_came_late_has_the_scene_in_force_from_its_first_state_on():
    records = [record(3 * TICK, 50)]
    assert places_of(records, [states(0, [500, 501], [1000, 1010])]) == [(0, 0)]


@pytest.mark.parametrize("steps", [[], [(50, -3600 * SECOND)], [(251, -200 * TICK)], [(120, -300 * TICK)]])
def test_changed_parameters_are_drawn_where_they_came_into_force(tmp_path, steps):
    result = verified(tmp_path, (), stepping(*steps))[2].control
    assert [(round(event.t / (TICK * 1e-9)), event.text) for event in result.events] == [
        (100, "engine.mean_torque = 250"), (250, "engine.mean_torque = 300, pressure.amplitude = 0")]
