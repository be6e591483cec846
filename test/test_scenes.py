"""Scene files: accepted ones, and the errors of wrong ones."""

from __future__ import annotations

import math
import os
import re
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import DEFAULTS, QUANTITIES, System
from tcc_sim.parameter_file import LARGEST_FILE, description_in, read_parameters
from tcc_sim.scene import (
    KNOWN_KEYS,
    LONGEST_VALUE,
    OPERATION_QUANTITIES,
    Operation,
    Scene,
    as_scene,
    bundled_scenes,
    load_scene,
    parse_assignments,
    parse_profiles,
    parse_scene,
    system_of,
)


def body(*lines: str) -> str:
    return "/**:\n  ros__parameters:\n" + "".join(f"    {line}\n" for line in lines)


TWO = {"engine.mean_torque": 100.0, "engine.frequency": 90.0}


def refusal(text: str) -> str:
    with pytest.raises(InputError) as caught:
        parse_scene(text, "s")
    message = str(caught.value)
    assert message.isprintable()
    return message


@pytest.mark.parametrize(("lines", "values"), [
    (("rate: 500.0",), {"rate": 500.0}), (("engine:", "  mean_torque: 100", "  frequency: 90"), TWO),
    (("engine.mean_torque: 100", "engine.frequency: 90"), TWO),
    (("engine: {mean_torque: 1.0e+2, frequency: 9e1}",), TWO),
    (("rate: 2000", "wait_for_subscribers: 2.0", "command_timeout: 1"),
     {"rate": 2000.0, "wait_for_subscribers": 2, "command_timeout": 1.0}),
    (("engine: {harmonic_amplitudes: [10, 2.5], harmonic_phases: [0, 1.5]}",),
     {"engine.harmonic_amplitudes": (10.0, 2.5), "engine.harmonic_phases": (0.0, 1.5)})])
def test_keys_of_a_file_change_their_defaults(lines: tuple[str, ...], values: dict[str, object]) -> None:
    result = parse_scene("# a clutch\n# more\n" + body(*lines), "s")
    assert result.values() == {**Scene("s", System()).values(), **values}
    assert all(type(result.value(key)) is type(value) for key, value in values.items())
    assert result.description == "a clutch"
    assert parse_scene(result.text(), "s") == result


@pytest.mark.parametrize(("line", "words"), [
    ("engine.frequency: -1.0", ["engine.frequency is -1 rad/s", "0.001 to 100000 rad/s"]),
    ("engine.frequency: true", ["engine.frequency", "True"]), ("engine: 5", ["engine"]),
    (f"engine.frequency: {'9' * 400}", ["engine.frequency"]), ("engine.frequency: 1e999", ["engine.frequency"]),
    ("engine.frequncy: 1.0", ["engine.frequncy", "engine.frequency?"]),
    ("engin.mean_torque: 1.0", ["engin.mean_torque", "engine.mean_torque?"]),
    ("publish_clok: true", ["publish_clok", "publish_clock?"]),
    ("friction.law: coulomb", ["friction.law is 'coulomb'", "smoothed or set_valued"]),
    ("friction.law: 3", ["friction.law is '3'", "smoothed or set_valued"]),
    ("friction.kinetic_coefficient: 0.01", ["friction.kinetic_coefficient is 0.01", "0.015 to 6"]),
    ("engine.harmonic_amplitudes: [1.0]", ["engine.harmonic_phases", "0", "engine.harmonic_amplitudes, 1"]),
    ("engine.harmonic_amplitudes: [a]", ["engine.harmonic_amplitudes"]),
    ("publish_clock: 1", ["publish_clock is 1", "true or false"]),
    ("wait_for_subscribers: 1.5", ["wait_for_subscribers is 1.5", "whole number"]),
    ("pacing: hurried", ["pacing is 'hurried'", "real_time or lockstep"]), ("5: 1.0", ["5"])])
def test_a_wrong_value_is_named_with_key_value_unit_and_range(line: str, words: list[str]) -> None:
    message = refusal(body(line))
    assert [word for word in words if word not in message] == []


@pytest.mark.parametrize(("text", "words"), [
    ("", ""), ("# only words\n", ""), ("3\n", ""), ("- a\n- b\n", ""),
    ("a: 1\nb: 2\n", "one node"), ("/**: 3\n", "ros__parameters"), ("/**:\n  ros__parameters: 3\n", "ros__parameters"),
    ("/**:\n  ros__parameters: {}\n  more: 1\n", "nothing else"), ("/**:\n  parameters: {}\n", "ros__parameters"),
    (body("rate: 1.0", "rate: 2.0"), "line 4: rate is given twice"),
    (body("engine: {frequency: 1.0}", "engine.frequency: 2.0"), "engine.frequency is given twice"),
    (body("engine: &a {frequency: 1.0}", "pressure: *a"), "line 3: YAML anchors and aliases"),
    (body("rate: !!float 3"), "line 3: YAML tags"), (body("rate: !!python/name:os.system x"), "line 3: YAML tags"),
    ("/**: [\n", "not valid YAML"), (body("rate: 'a"), "not valid YAML"), ("\t: 1\n", "not valid YAML"),
    ("a: 1\n---\nb: 2\n", "not valid YAML"), ("\x00\x01", "not valid YAML"),
    ("[" * 300, "nested more than 20 deep"), ("[" * 300 + "]" * 300, "nested more than 20 deep"),
    ("[" * 3000, "nest"), ("[" * 60_000, "nest"),  # Newer libyaml has a limit of its own.
    (body("rate: 2026-13-45"), "not valid YAML"),
    (body("rate: 2026-10-05"), "rate"),
    (body("a: {b: {c: {d: {e: {f: 1}}}}}"), "is not a scene key"),
    (body("? [rate]\n    : 1.0"), "not")])
def test_what_is_not_a_scene_is_refused_in_one_line(text: str, words: str) -> None:
    assert words in refusal(text)


def test_the_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(body("rate: -1.0"))
    with pytest.raises(InputError, match=r"mine\.yaml: rate is -1 Hz.*1 to 20000 Hz"):
        load_scene(path)


def test_bytes_that_are_no_text_and_files_that_are_too_large_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match=r"mine\.yaml"):
        load_scene(path)
    path.write_text(body("rate: 10.0") + "#" * LARGEST_FILE)
    with pytest.raises(InputError, match=r"mine\.yaml.*65536"):
        load_scene(path)
    path.write_text((body("rate: 10.0") + "#" * LARGEST_FILE)[:LARGEST_FILE])
    assert load_scene(path).operation.rate == 10.0


def test_a_scene_that_is_not_there_is_refused_with_the_nearest_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"fig20.*fig02"):
        load_scene("fig20")
    with pytest.raises(InputError, match=r"nowhere\.yaml.*aged_fluid, apply, chaos"):
        load_scene(tmp_path / "nowhere.yaml")
    with pytest.raises(InputError, match=re.escape(str(tmp_path))):
        load_scene(tmp_path)
    for file in ("fig20.yaml", "fig20.yml", "./fig20", "zzzzzz"):  # Only a name has a nearest name.
        with pytest.raises(InputError) as caught:
            load_scene(file)
        assert all(word in str(caught.value) for word in (file, *bundled_scenes()))


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
def test_a_file_that_may_not_be_read_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(body("rate: 10.0"))
    path.chmod(stat.S_IWUSR)
    with pytest.raises(InputError, match=r"mine\.yaml"):
        load_scene(path)


@pytest.mark.parametrize("where", ["lib/python3.11/site-packages", "lib/python3/dist-packages",
                                   "local/lib/python3.10/dist-packages"])
def test_scenes_are_found_beside_the_installed_package(where: str, tmp_path: Path) -> None:
    """Wheels and colcon both put the module below the prefix whose share holds the scenes."""
    package = tmp_path / "prefix" / where / "tcc_sim"
    config = tmp_path / "prefix" / "share" / "tcc_sim" / "config"
    package.mkdir(parents=True)
    config.mkdir(parents=True)
    (config / "own.yaml").write_text(body("rate: 10.0"))
    result = bundled_scenes(str(package / "scene.py"))
    assert result == {"own": config / "own.yaml"}
    assert load_scene(result["own"]).operation.rate == 10.0


def test_a_module_outside_any_prefix_finds_the_scenes_of_the_interpreter(tmp_path: Path) -> None:
    config = tmp_path / "prefix" / "share" / "tcc_sim" / "config"
    config.mkdir(parents=True)
    (config / "own.yaml").write_text(body("rate: 10.0"))
    module = tmp_path / "elsewhere" / "tcc_sim" / "scene.py"
    assert list(bundled_scenes(str(module), str(tmp_path / "prefix"))) == ["own"]


def test_assignments_are_read_as_a_file_would_be() -> None:
    assert parse_assignments(["engine.frequency=90", "friction.law=set_valued", "engine.harmonic_phases=[0, 1.5]"]) == {
        "engine.frequency": 90, "friction.law": "set_valued", "engine.harmonic_phases": [0, 1.5]}


@pytest.mark.parametrize(("words", "match"), [
    (["rate"], "'rate'.*KEY=VALUE"), (["=3"], "'=3'.*KEY=VALUE"), (["rate="], "'rate='.*KEY=VALUE"),
    (["rat=3"], r"rat\b.*rate\b"), (["rate=1", "rate=2"], "rate"), (["rate=[1"], r"rate: '\[1'"),
    (["pacing=" + (LONGEST_VALUE + 1) * "a"], "pacing.*4001.*4000")])
def test_a_wrong_assignment_is_named(words: list[str], match: str) -> None:
    with pytest.raises(InputError, match=match):
        parse_assignments(words)
    assert parse_assignments(["pacing=" + LONGEST_VALUE * "a"]) == {"pacing": LONGEST_VALUE * "a"}


@pytest.mark.parametrize(("words", "values"), [
    ([], {}),
    (["pressure.mean=0:1e5,0.5:2e5"], {"pressure.mean_times": [0.0, 0.5], "pressure.mean_values": [1e5, 2e5]}),
    (["engine.speed=0:30rpm,1:2", "engine.harmonic_amplitudes[2]=0:1"],
     {"engine.speed_times": [0.0, 1.0], "engine.speed_values": pytest.approx([math.pi, 2.0]),
      "engine.harmonic_amplitudes[2]_times": [0.0], "engine.harmonic_amplitudes[2]_values": [1.0]})])
def test_profiles_are_times_and_values(words: list[str], values: dict[str, object]) -> None:
    assert parse_profiles(words) == values


@pytest.mark.parametrize(("words", "shown"), [
    (["clutch.area=0:1"], "clutch.area=0:1"), (["engine.harmonic_amplitudes=0:1"], "engine.harmonic_amplitudes=0:1"),
    (["pressure.mean=0:1", "pressure.mean=0:1"], "pressure.mean"), (["pressure.mean"], "pressure.mean"),
    (["pressure.mean=0:1:2"], "pressure.mean=0:1:2"), (["pressure.mean=0:x"], "pressure.mean=0:x"),
    (["engine.frequency=0:1500rpm"], "engine.speed=1500rpm"), (["engine.speeds=0:1"], "engine.speeds"),
    (["engine.frequency=0:60,20"], "engine.frequency=0:60,20"), (["pressure.mean=0:8rpm"], "pressure.mean=0:8rpm")])
def test_a_wrong_profile_is_named(words: list[str], shown: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_profiles(words)
    assert shown in str(caught.value)
    for long in ("pressure.mean=" + 5000 * "0", "x" * 5000):
        with pytest.raises(InputError) as caught:
            parse_profiles([long])
        assert len(str(caught.value)) < 400


@pytest.mark.parametrize(("period", "ticks"), [(0.0, 1), (0.001, 1), (0.004, 4), (0.003 + 5e-10, 3), (0.003 - 5e-10, 3),
                                               (0.0005, 0), (0.003 + 3e-9, 0), (0.003 - 3e-9, 0)])
def test_commands_come_after_whole_ticks(period: float, ticks: int) -> None:
    if ticks:
        assert Operation(command_period=period).answer_ticks == ticks
    else:
        with pytest.raises(InputError, match=r"command_period is .*0\.001 s"):
            Operation(command_period=period)


def test_a_value_is_found_by_its_key_and_a_scene_in_every_form(tmp_path: Path) -> None:
    scene = load_scene("fig02").with_values({"engine.order": 2.0, "rate": 500.0})
    assert [scene.value(key) for key in ("engine.speed", "engine.frequency", "clutch.radius", "rate")] == [
        75.0, 150.0, 0.1, 500.0]
    with pytest.raises(InputError, match=r"ratee\b.*rate\b"):
        scene.value("ratee")
    assert system_of(scene.system) is scene.system is system_of(scene)
    assert (as_scene(scene.system).name, as_scene(scene.system).operation) == ("system", Operation())
    assert as_scene(scene) is scene
    assert system_of("minimal") == load_scene("minimal").system
    (tmp_path / "mine.yaml").write_text(Scene("bare", scene.system).text())
    mine = as_scene(str(tmp_path / "mine.yaml"))
    assert (mine.name, mine.description, mine.system) == ("mine", "bare", scene.system)
    html = scene._repr_html_()
    assert html.startswith(f"<p>fig02: {scene.description}</p><table>")
    assert html.count("<tr>") == 1 + len(KNOWN_KEYS)
    assert "<td>engine.order</td><td>2</td>" in html


def test_a_table_replaces_keys_which_are_named_and_not_written(tmp_path: Path) -> None:
    (tmp_path / "mu.csv").write_text("slip_speed,coefficient\n0,0.14\n1,0.12\n4,0.11\n")
    path = tmp_path / "mine.yaml"
    path.write_text(body("friction: {table: mu.csv, kinetic_coefficient: 0.2, static_coefficient: 0.3}"))
    scene = load_scene(path)
    assert (scene.system.friction.slip_speeds, scene.system.friction.coefficients) == ((0.0, 1.0, 4.0),
                                                                                      (0.14, 0.12, 0.11))
    assert [line.partition(" ")[0] for line in scene.warnings() if "is not used" in line] == [
        "friction.static_coefficient", "friction.kinetic_coefficient"]
    assert scene.with_values({"friction.slip_speeds": [], "friction.coefficients": []}).warnings() == []
    (tmp_path / "mu.csv").write_text("slip_speed,coefficient\n0,0.14\n1,x\n4,0.11\n")
    with pytest.raises(InputError, match=r"friction\.table.*mu\.csv.*coefficient"):
        load_scene(path)
    path.write_text(body("friction: {table: mu.csv, slip_speeds: [0.0]}"))
    with pytest.raises(InputError, match=r"friction\.table.*friction\.slip_speeds"):
        load_scene(path)


def test_a_file_is_as_deep_and_as_long_as_its_limits() -> None:
    for lists, fine in ((17, True), (18, False)):
        text = "/**: {ros__parameters: {a: " + lists * "[" + lists * "]" + "}}"
        if fine:
            assert list(read_parameters(text)) == ["a"]
        else:
            with pytest.raises(InputError, match=r"line 1\b.*20"):
                read_parameters(text)
    assert read_parameters(body("a: {b: {c: {d: {e: {f: 1}}}}}")) == {"a.b.c.d.e": {"f": 1}}
    text = body("rate: 10.0") + "#"
    assert parse_scene(text.ljust(LARGEST_FILE, "#"), "s").operation.rate == 10.0
    with pytest.raises(InputError, match="65536"):
        parse_scene(text.ljust(LARGEST_FILE + 1, "#"), "s")
    for text, description in (("# a\n", "a"), ("\n\n## a clutch  \nmore", "a clutch"), ("rate: 1", ""), ("", "")):
        assert description_in(text) == description


def test_changed_keys_are_checked_together() -> None:
    scene = load_scene("fig02")
    changed = scene.with_values({"friction.static_coefficient": 0.9, "friction.kinetic_coefficient": 0.8, "rate": 100})
    assert changed.system.friction_ratio == pytest.approx(0.9 / 0.8, rel=1e-15)
    assert changed.operation.rate == 100.0
    assert scene.operation.rate == 1000.0
    with pytest.raises(InputError, match=r"friction\.kinetic_coefficient.*friction\.static_coefficient"):
        scene.with_values({"friction.static_coefficient": 0.01})


EVERY = {**QUANTITIES, **OPERATION_QUANTITIES}
FIG02 = load_scene("fig02")
NUMBERS = [key for key, quantity in EVERY.items() if quantity.low > -math.inf]
LISTS = ("cpu_affinity", *(key for key, value in DEFAULTS.items() if value == ()))


@pytest.mark.parametrize("key", NUMBERS)
def test_every_number_beyond_its_range_is_named_with_the_range(key: str) -> None:
    quantity = EVERY[key]
    whole = key == "wait_for_subscribers"
    below, above = (quantity.low - 1, quantity.high + 1) if whole else (
        math.nextafter(quantity.low, -math.inf), math.nextafter(quantity.high, math.inf))
    for value in (below, above, math.inf, -math.inf, math.nan, 1e308, -1e308):
        shown = {math.inf: ".inf", -math.inf: "-.inf"}.get(value, ".nan" if value != value else repr(value))
        message = refusal(body(f"{key}: [{shown}]" if key in LISTS else f"{key}: {shown}"))
        assert key in message
        assert "whole number" in message or f"{quantity.high:g}" in message, message


@pytest.mark.parametrize("key", KNOWN_KEYS)
@pytest.mark.parametrize("value", ["word", "[[1.0]]", "{a: 1}", "", "2026-10-05", "[1.0, word]"])
def test_every_key_of_a_wrong_type_is_named(key: str, value: str) -> None:
    assert key.split(".")[-1] in refusal(body(f"{key}: {value}"))


@pytest.mark.parametrize("key", KNOWN_KEYS)
def test_every_key_may_be_missing_but_not_twice(key: str) -> None:
    text = FIG02.text()
    name = key.split(".")[-1]
    group = f"    {key.split('.')[0]}:" if "." in key else "  ros__parameters:"
    lines = text.splitlines(keepends=True)
    start = next(n for n, line in enumerate(lines) if line.startswith(group))
    values = [n for n, line in enumerate(lines) if n > start and line.strip().startswith(f"{name}:")]
    if not values:
        assert key in LISTS  # An empty list is not written.
        return
    line = lines[values[0]]
    alone = key == "converter.coupling"  # A group without a key has no line.
    assert parse_scene("".join([*lines[:start + (not alone)], *lines[start + 1:values[0]], *lines[values[0] + 1:]]),
                       "s")
    assert "twice" in refusal("".join([*lines[:values[0]], line, *lines[values[0]:]]))


BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{chr(98 + n)}: &{chr(98 + n)} [{', '.join(['*' + chr(97 + n)] * 9)}]\n" for n in range(12))
FILES = {
    "empty": b"", "binary": bytes(range(256)) * 64, "alias_bomb": BOMB.encode(), "words": b"to whom it may concern\n",
    "tag": body("rate: !!python/object/apply:os.system [touch evil]").encode(),
    "range": body("pressure.mean: -1").encode()}


@pytest.mark.parametrize("name", [*FILES, "hundred_megabytes", "missing", "directory"])
@pytest.mark.parametrize("words", [
    ["simulate", "{}", "--json", "out.json", "--out", "x.npz"], ["explain", "{}", "--json", "o"],
    ["sweep", "{}", "--over", "pressure.mean=1e5:2e5:3", "--json", "o.json", "--out", "o.jsonl"],
    ["demo", "--scene", "{}", "--out", "made"]])
def test_a_file_that_is_no_scene_is_one_line_and_nothing_is_written(name: str, words: list[str], tmp_path: Path,
                                                                    refused: Callable[..., str]) -> None:
    file = tmp_path / f"{name}.yaml"
    if name == "directory":
        file.mkdir()
    elif name == "hundred_megabytes":
        file.touch()
        os.truncate(file, 100_000_000)
    elif name != "missing":
        file.write_bytes(FILES[name])
    assert f"{name}.yaml" in refused(*(word.format(file) for word in words))
