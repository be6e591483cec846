"""Every way to write a recording again gives the same figures, or a sentence that names the reason."""

import pytest
from re_encodings import DIFFERS, WAYS, case, made

from tcc_sim.output.provenance import document
from tcc_sim.replay.recorded import read
from tcc_sim.replay.replay import replay

NOT_COMPARED = {"elapsed_s", "command", "version"}


def figures(path):
    """The JSON of `analyse --verify`, without what differs from run to run."""
    recording = read(path)
    found = replay(recording, discard=1, verify=True)
    return cleaned(document("analyse", found, recording.scene, [])), found.warnings


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
    found, _ = original[1]
    assert found["verified"] is True
    assert found["inputs"]["engine_torque"]["topic"] > 0.5 < found["inputs"]["actuation_pressure"]["topic"]
    assert found["inputs"]["engine_torque"]["fallback"] > 0.1
    assert found["real_time_factor"] == pytest.approx(1.0, abs=1e-3)
    assert [(one["states"], one["read"]) for one in found["drivelines"]] == [(700, True)]


@pytest.mark.parametrize("name", WAYS)
def test_a_recording_written_again_is_the_same(tmp_path, original, name):
    source, (expected, before) = original
    fields, sentence = DIFFERS.get(name, (set(), ""))
    found, warnings = figures(case(tmp_path / name, name, source))
    assert {key: found.get(key) for key in expected if key not in fields} == {
        key: value for key, value in expected.items() if key not in fields}
    assert found.keys() == expected.keys()
    new = [text for text in warnings if text not in before]
    assert any(sentence in text for text in new) if sentence else "warnings" in fields or not new
