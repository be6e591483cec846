"""Every way to write a recording again gives the same figures, or a sentence that names the reason."""

import pytest
from driveline_bags import bag, ticked
from re_encodings import (
    DIFFERS,
    SCENE,
    STATES,
    WAYS,
    as_rosbag2,
    forgotten,
    in_parts,
    joint_state,
    joints,
    laid_out,
    made,
    save,
    without,
)

from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.estimation.identify import given as measured_and_scene
from tcc_sim.messages import cdr
from tcc_sim.output.provenance import document
from tcc_sim.recording.bag import BagWriter
from tcc_sim.replay.recorded import read
from tcc_sim.replay.replay import replay
from tcc_sim.scene import load_scene
from tcc_sim.topics import JOINT_STATE

NOT_COMPARED = {"elapsed_s", "command", "version"}


def figures(path, joints=None):
    """The JSON of `analyse --verify`, without what differs from run to run."""
    recording = read(path, joints=joints)
    result = replay(recording, discard=1, verify=True)
    return cleaned(document("analyse", result, recording.scene, [])), result.warnings


def written(folder, name, source):
    WAYS[name](folder, source)
    return folder


def cleaned(value):
    if isinstance(value, dict):
        return {key: cleaned(part) for key, part in value.items() if key not in NOT_COMPARED}
    return [cleaned(part) for part in value] if isinstance(value, list | tuple) else value


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """The recording in parts, and its figures."""
    folder = tmp_path_factory.mktemp("original") / "run"
    return made(folder), figures(folder)


def test_the_original_is_a_driveline_on_commands_and_then_on_its_fallback(original):
    result, _ = original[1]
    assert result["verified"] is True
    assert result["inputs"]["engine_torque"]["topic"] > 0.12 < result["inputs"]["actuation_pressure"]["topic"]
    assert result["inputs"]["engine_torque"]["fallback"] > 0.03
    assert result["real_time_factor"] == pytest.approx(1.0, abs=1e-3)
    assert [(one["states"], one["read"]) for one in result["drivelines"]] == [(220, True)]


@pytest.fixture(scope="module")
def unnamed(tmp_path_factory):
    """The same driveline as a recording of version 1.0."""
    folder = tmp_path_factory.mktemp("unnamed") / "run"
    return made(folder, named=False), figures(folder)


def test_a_recording_of_version_1_0_is_read_with_what_it_knows(tmp_path, original, unnamed):
    """The sources are announced there; what became of the commands is not, nor a source announced before a cut."""
    (new, _), (old, _) = original[1], unnamed[1]
    for name in new.keys() - {"inputs", "drivelines", "warnings", "command_age", "segments", "units"}:
        assert old[name] == new[name], name
    for name, one in old["inputs"].items():
        assert {field: one[field] for field in ("topic", "fallback", "scene", "commands")} == {
            field: new["inputs"][name][field] for field in ("topic", "fallback", "scene", "commands")}
        assert ([one[field] for field in ("applied", "superseded", "ignored", "lost")], bool(one["why"])) == (
            [None] * 4, True)
    save(tmp_path / "run" / "run_0.mcap", unnamed[0]._replace(messages=unnamed[0].messages[-550:]))
    result, _ = figures(tmp_path / "run")
    assert [(one["topic"], one["fallback"]) for one in result["inputs"].values()] == 2 * [(0.0, pytest.approx(0.05))]
    assert result["verified"] is False


OLD_WAYS = ("no_publisher", "by_rosbag2", "parts", "parts_by_rosbag2", "parts_after_the_clock_was_set_back",
            "no_times", "frames", "forgotten_driveline", "forgotten_driveline_received_later",
            "forgotten_driveline_without_pressure")
ONLY_OLD = set(OLD_WAYS[3:])
"""Ways whose frames or publishers tell runs apart, which a run's name does otherwise."""


@pytest.mark.parametrize(("name", "old"), [*((name, False) for name in WAYS if name not in ONLY_OLD),
                                           *((name, True) for name in OLD_WAYS)])
def test_a_recording_written_again_is_the_same(tmp_path, original, unnamed, name, old):
    source, (expected, before) = unnamed if old else original
    fields, sentence = DIFFERS.get(name, (set(), ""))
    result, warnings = figures(written(tmp_path / name, name, source))
    assert {key: result.get(key) for key in expected if key not in fields} == {
        key: value for key, value in expected.items() if key not in fields}
    assert result.keys() == expected.keys()
    new = [text for text in warnings if text not in before]
    assert any(sentence in text for text in new) if sentence else "warnings" in fields or not new


def refusal(folder):
    with pytest.raises(InputError) as error:
        replay(folder)
    return str(error.value)


def no_time(_, data):
    return data[:4] + bytes(8) + data[12:]


def chat(source):
    return source.channel(lambda c: c._replace(topic="/chatter", schema=("std_msgs/msg/String", "ros2msg", b"")))


def of_ros1(source):
    return source.channel(lambda c: c._replace(encoding="ros1", schema=(
        c.schema[0].replace("/msg/", "/"), "ros1msg", b"")))


def two_that_cannot_be_told_apart(source):
    return as_rosbag2(forgotten(source))


def two_with_equal_stamps(source):
    """Another driveline on the same topics, with states of its own at the same times."""
    both = forgotten(source, ahead=0)
    out = []
    for message in both.messages:
        if message.channel >= 100 and both.channels[message.channel].topic == STATES:
            stamp, *values = joints(message.data)
            message = message._replace(data=cdr.joint_state(stamp - 70 * 10**9, *[2.0 * value for value in values]))
        out.append(message)
    return as_rosbag2(both._replace(messages=out))


def one_velocity(_, data):
    stamp, *values = joints(data)
    return joint_state(stamp, ["flywheel", "clutch_plate"], [values[:2], values[2:3], values[4:]])


@pytest.mark.parametrize(("change", "sentence"), [
    (two_with_equal_stamps, "220 of 440 states have the stamp of another one and other values"),
    (lambda source: source.changed(STATES, one_velocity), "velocity has 1 value for 2 names"),
    (lambda source: source.changed(STATES, no_time), "all 220 stamps of /joint_states are 0 s: its publisher does not"),
    (lambda source: source.changed(STATES, laid_out(["engine", "turbine"])), "its joints are engine, turbine; say"),
    (lambda source: source.changed(STATES, without("positions")),
     "plate_angle of the joint states: no state holds a number"),
    (chat, "holds no sensor_msgs/msg/JointState, so no driveline; its topics are /chatter (std_msgs/msg/String)"),
    (of_ros1, "the messages of /joint_states are in the encoding ros1; only cdr, that of ROS 2, is read"),
    (two_that_cannot_be_told_apart, "publishers are mixed and cannot be separated"),
    (lambda source: source._replace(metadata=[], messages=[m for m in source.messages if m.channel != 1]),
     "holds no scene"),
], ids=["equal stamps", "short array", "stamps", "joints", "positions", "no driveline", "ROS 1", "mixed", "no scene"])
def test_a_recording_that_cannot_be_analysed_is_refused_for_its_own_reason(tmp_path, original, unnamed, change,
                                                                            sentence):
    mixed = change in (two_with_equal_stamps, two_that_cannot_be_told_apart)
    for number, (source, _) in enumerate((unnamed,) if mixed else (unnamed, original)):
        save(tmp_path / f"run{number}" / "run_0.mcap", change(source))
        assert sentence in refusal(tmp_path / f"run{number}")


def test_parts_of_which_nothing_states_the_order_are_refused(tmp_path, original, unnamed):
    """They have no metadata.yaml and no numbers; runs or publishers with numbers state the order of the states."""
    for number, (source, known) in enumerate((
            (original[0], True), (as_rosbag2(original[0]), True), (unnamed[0], True), (as_rosbag2(unnamed[0]), False))):
        in_parts(["b.mcap", "a.mcap"])(tmp_path / f"run{number}", source)
        if known:
            assert replay(tmp_path / f"run{number}", discard=0, verify=True).verification.verified
        else:
            assert "run_0.mcap" in refusal(tmp_path / f"run{number}")


def test_a_file_of_another_kind_is_named(tmp_path):
    for name, start, sentence in (("a.bag", b"#ROSBAG V2.0\n", "is a bag of ROS 1"), ("b.mcap", b"x", "not an MCAP"),
                                  ("c.mcap", b"SQLite format 3\0", "is a bag in SQLite"),
                                  ("d.db3", b"SQLite format 3\0", "is a bag in SQLite")):
        (tmp_path / name).write_bytes(start + bytes(100))
        assert sentence in refusal(tmp_path / name)
    for name, sentence in (("x_0.mcap.lz4", "is compressed as .lz4"), ("x_0.db3", "is a bag in SQLite"),
                           ("x.bag", "x.bag is a bag of ROS 1")):
        folder = tmp_path / name.replace(".", "_")
        folder.mkdir()
        (folder / name).write_bytes(bytes(100))
        assert sentence in refusal(folder)


@pytest.mark.parametrize("what", ["NaN", "efforts"])
def test_torques_that_were_not_recorded_are_estimated_with_a_note(tmp_path, what):
    """Central differences of the recorded speeds give them back, but for states next to a change of stick and slip."""
    scene = load_scene("fig02")
    rows, change = ticked(scene, 500), without(what)
    expected, _ = figures(bag(tmp_path / "whole", rows, scene))
    writer = BagWriter(tmp_path / "run", scene.text())
    channel = writer.channel(STATES, JOINT_STATE)
    for k, (stamp, *values, _) in enumerate(rows):
        writer.write(channel, stamp, stamp, change(k, cdr.joint_state(stamp, *values)), k)
    writer.close()
    result, warnings = figures(tmp_path / "run")
    assert "no state has a number for engine_torque and friction_torque (efforts)" in warnings[0]
    assert result["verified"] is True  # The scene gives the torques.
    assert result["verification"].endswith("; not recorded, so not compared: engine_torque, friction_torque")
    for name, error in (("max_slip_speed", 1e-2), ("clutch_energy", 2e-2), ("max_shaft_torque", 1e-3)):
        assert result[name] == pytest.approx(expected[name], rel=error)
        assert result[name] != expected[name]
    assert (result["cycles"], result["breakaways"]) == (expected["cycles"], expected["breakaways"])


def test_a_state_without_a_number_costs_itself_and_is_counted(tmp_path, original):
    source, (expected, _) = original
    nan = without("NaN")
    save(tmp_path / "run" / "run_0.mcap", source.changed(STATES, lambda k, data: nan(k, data) if k == 150 else data))
    result, warnings = figures(tmp_path / "run")
    assert result["lost_seconds"] == pytest.approx(0.002)
    assert any("not finite" in text for text in warnings)
    assert result["cycles"] == expected["cycles"]


def test_a_driveline_is_chosen_by_topic_or_number(tmp_path, original):
    written(tmp_path / "run", "left_and_right", original[0])
    right = {"topic": "right/joint_states"}
    for options, number in (({}, 0), (right, 1), ({"driveline": 1}, 1), ({"driveline": 0}, 0)):
        assert [one.read for one in read(tmp_path / "run", **options).drivelines] == [number == 0, number == 1]
    for options, sentence in (({"driveline": 2}, "driveline is 2; the recording holds 2 drivelines, counted from 0"),
                              ({"topic": "/x"}, "no joint_states were recorded on /x"),
                              ({"topic": "/x", "driveline": 0}, "driveline 0 is on /lef/joint_states, not on /x")):
        with pytest.raises(InputError, match=sentence):
            read(tmp_path / "run", **options)


@pytest.mark.parametrize(("names", "joints"), [
    (["engine", "turbine"], {"flywheel": "engine", "clutch_plate": "turbine"}),
    (["a_longer_name", "b", "clutch_plate"], {"flywheel": "b"})])
def test_joints_of_other_names_are_asked_for_and_found(tmp_path, original, names, joints, refused):
    source, (expected, _) = original
    save(tmp_path / "run" / "run_0.mcap", source.changed(STATES, laid_out(names, **joints)))
    line = refused("analyse", tmp_path / "run")
    assert all(word in line for word in (*names, "--joints flywheel=NAME,clutch_plate=NAME"))
    result, _ = figures(tmp_path / "run", joints)
    assert result | {"drivelines": 0} == expected | {"drivelines": 0}
    written(tmp_path / "other", "another_node_on_the_topic", source)
    with pytest.raises(InputError, match="its joints are finger; say which of them"):
        read(tmp_path / "other", driveline=1)


@pytest.mark.parametrize("verb", [
    ["analyse", "{bag}", "--scene", "{scene}", "--driveline", "0", "--joints", "flywheel=flywheel"],
    ["simulate", "{scene}", "--inputs", "{bag}", "--scene", "{scene}", "--topic", "/joint_states"],
    ["simulate", "{scene}", "--inputs", "{bag}", "--topic", "joint_states"],
])
def test_every_verb_takes_the_same_recordings_and_options(tmp_path, original, capsys, verb):
    """A bag with the scene on its topic, and with `--scene` one without a scene."""
    source = as_rosbag2(original[0])
    if verb[-1] != "joint_states":
        source = source._replace(messages=[m for m in source.messages if m.channel != 1])
    save(tmp_path / "run" / "run_0.mcap", source)
    (tmp_path / "scene.yaml").write_text(SCENE.text())
    words = [word.format(bag=tmp_path / "run", scene=tmp_path / "scene.yaml") for word in verb]
    assert main(words) == 0, capsys.readouterr().err
    measured, scene = measured_and_scene(tmp_path / "run", SCENE, topic=STATES)
    assert (len(measured.t), scene.system) == (220, SCENE.system)


def test_a_recovery_names_what_it_does_not_copy(tmp_path, original, capsys):
    written(tmp_path / "run", "large_attachment", original[0]._replace(
        metadata=[*original[0].metadata, ("other", {"a": "b"})]))
    assert main(["recover", str(tmp_path / "run")]) == 0
    output = capsys.readouterr().out
    assert "note: 1 attachment of other programs not copied" in output
    assert "note: 1 metadata record of other programs not copied" in output
    assert "nothing is missing" not in output
    result, _ = figures(tmp_path / "run_recovered")
    assert result["verified"] is True


def test_options_of_a_recording_are_refused_where_none_is_read(tmp_path, refused):
    (tmp_path / "x.csv").write_text("t,slip_speed\n0,1\n1,1\n2,1\n3,1\n")
    table = tmp_path / "x.csv"
    for option in ("--topic", "--scene"):
        assert all(word in refused("simulate", "minimal", option, "fig02") for word in (option, "--inputs"))
    assert "--driveline: only for recordings" in refused("simulate", "minimal", "--inputs", table, "--driveline", "0")
    assert "--topic: only for recordings" in refused("identify", table, "--scene", "minimal", "--free",
                                                     "driveline.damping", "--topic", "/x")
    assert "--topic: only for" in refused("analyse", table, "--orders", "--topic", "/x")
