"""Several publishers in one recording are separated by identity, however often simulation time fell back."""

import numpy as np
import pytest
from driveline_bags import TICK, bag, ticked
from mcap.reader import make_reader
from re_encodings import read, save

from tcc_sim.errors import RecordingError
from tcc_sim.messages import cdr
from tcc_sim.recording.mcap_file import McapFile
from tcc_sim.recording.reader import Run
from tcc_sim.replay.recorded import Recording
from tcc_sim.replay.replay import replay
from tcc_sim.scene import load_scene
from tcc_sim.topics import JOINT_STATE

MINIMAL, COMMANDS = load_scene("minimal"), load_scene("commands")


def two(tmp_path, order):
    """Recording of two drivelines at once, with states in this order of owners."""
    rows = {who: ticked(MINIMAL, 300) for who in "ab"}
    taken, mixed, owners = {"a": iter(rows["a"]), "b": iter(rows["b"])}, [], []
    for who in order:
        mixed.append(next(taken[who]))
        owners.append(who)
    cuts = [0] + [k for k in range(1, len(owners)) if owners[k] != owners[k - 1]]
    return bag(tmp_path / "run", mixed, MINIMAL, publishers=[(k, owners[k]) for k in cuts])


@pytest.mark.parametrize("order", ["a" * 100 + "ab" * 100 + "b" * 150, "a" * 200 + "b" * 250])
def test_of_publishers_without_names_of_runs_the_one_with_the_most_states_is_read_and_the_other_on_request(tmp_path,
                                                                                                          order):
    """Nothing states whether one of them is the other one started again."""
    path = two(tmp_path, order)
    numbers = {one.publisher: number for number, one in enumerate(Run(path).drivelines)}
    for number, who, states in ((None, "b", 250), (numbers["b"], "b", 250), (numbers["a"], "a", 200)):
        run = Run(path, driveline=number)
        kept = np.concatenate([batch.stamp_ns for batch in run.columns().runs])
        assert kept.tolist() == [n * TICK for n in range(states)]
        assert (run.driveline.publisher, run.driveline.states) == (who, states)
        assert {one.publisher: one.read for one in run.drivelines} == {"a": who == "a", "b": who == "b"}
        other = 200 if who == "b" else 250
        assert any(f"not read: /joint_states of publisher {'ab'[who == 'a']}: {other} states" in sentence
                   for sentence in run.warnings)
    result = replay(Recording(path, driveline=numbers["a"]), discard=0)
    assert (result.continuity.restarts, result.messages) == (0, 200)


@pytest.mark.parametrize("gone", [(), range(300, 330), range(301)], ids=["none", "begin of a run", "a run"])
def test_pressures_of_unnamed_runs_belong_to_these_by_numbers_and_stamps(tmp_path, gone):
    """No message has a time, and each topic is in one piece."""
    rows = ticked(COMMANDS, 600, torque=lambda k: 300.0, pressure=lambda k: 2e5 + 50.0 * k, resets=(299,))
    kept = [row for k, row in enumerate(rows) if k not in gone]
    made = read(bag(tmp_path / "run", kept, COMMANDS, publishers=[(0, "a")], clock=lambda k: 0) / "run_0.mcap")
    save(tmp_path / "again" / "run_0.mcap", made._replace(messages=sorted(made.messages, key=lambda m: m.channel)))
    result = replay(tmp_path / "again", discard=0, frequency=150.0, verify=True)
    assert result.continuity.runs == 2 - (len(gone) > 300)
    assert result.verification.largest_difference < 1e-9
    assert not any("missing at" in text for text in result.warnings)


def test_where_nothing_tells_them_apart_they_are_refused(tmp_path):
    rows = ticked(MINIMAL, 400)
    mixed = [row for pair in zip(rows[200:400], rows[:200]) for row in pair]
    with pytest.raises(RecordingError, match="publishers are mixed and cannot be separated"):
        list(Run(bag(tmp_path / "run", mixed, MINIMAL)).columns().runs)


@pytest.mark.parametrize(("given", "kept"), [(2**32 - 1, 2**32 - 1), (2**32, 0), (2**32 + 5, 5)])
def test_a_number_of_a_message_wraps_at_32_bits(tmp_path, given, kept):
    output = McapFile(tmp_path / "x.mcap")
    output.write(output.channel("/joint_states", JOINT_STATE), 0, 0, cdr.joint_state(0, *[0.0] * 6), given)
    output.close()
    with (tmp_path / "x.mcap").open("rb") as file:
        ((_, _, message),) = make_reader(file).iter_messages()
    assert message.sequence == kept
