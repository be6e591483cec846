"""Keys beyond their range or of a wrong type, and files that are no scenes: one line, status 2, no file."""

from __future__ import annotations

import math
import os
from pathlib import Path

import pytest

from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import DEFAULTS, QUANTITIES
from tcc_sim.scene import KNOWN_KEYS, OPERATION_QUANTITIES, load_scene, parse_scene

EVERY = {**QUANTITIES, **OPERATION_QUANTITIES}
FIG02 = load_scene("fig02")
NUMBERS = [key for key, quantity in EVERY.items() if quantity.low > -math.inf]
LISTS = ("cpu_affinity", *(key for key, value in DEFAULTS.items() if value == ()))


def written(key: str, value: object) -> str:
    """A parameter file with this one key."""
    return f"/**:\n  ros__parameters:\n    {key}: {value}\n"


def refusal(text: str) -> str:
    with pytest.raises(InputError) as caught:
        parse_scene(text, "s")
    assert str(caught.value).isprintable()
    return str(caught.value)


@pytest.mark.parametrize("key", NUMBERS)
def test_every_number_beyond_its_range_is_named_with_the_range(key: str) -> None:
    quantity = EVERY[key]
    whole = key == "wait_for_subscribers"
    below, above = (quantity.low - 1, quantity.high + 1) if whole else (
        math.nextafter(quantity.low, -math.inf), math.nextafter(quantity.high, math.inf))
    for value in (below, above, math.inf, -math.inf, math.nan, 1e308, -1e308):
        shown = {math.inf: ".inf", -math.inf: "-.inf"}.get(value, ".nan" if value != value else repr(value))
        message = refusal(written(key, f"[{shown}]" if key in LISTS else shown))
        assert key in message
        assert "whole number" in message or f"{quantity.high:g}" in message, message


def test_the_keys_that_are_no_numbers_are_few_and_known() -> None:
    assert sorted(set(EVERY) - set(NUMBERS)) == [
        "engine.fallback", "engine.source", "friction.law", "lock_memory", "pacing", "pressure.fallback",
        "pressure.source", "publish_clock", "publish_diagnostics", "publish_scalars",
        "publish_shaft_torque"]
    assert sorted(EVERY) == sorted(KNOWN_KEYS)


@pytest.mark.parametrize("key", KNOWN_KEYS)
@pytest.mark.parametrize("value", ["word", "[[1.0]]", "{a: 1}", "", "2026-10-05", "[1.0, word]"])
def test_every_key_of_a_wrong_type_is_named(key: str, value: str) -> None:
    assert key.split(".")[-1] in refusal(written(key, value))


@pytest.mark.parametrize("key", KNOWN_KEYS)
def test_every_key_may_be_missing_but_not_twice(key: str) -> None:
    text = FIG02.text()
    name = key.split(".")[-1]
    group = f"    {key.split('.')[0]}:" if "." in key else "  ros__parameters:"
    lines = text.splitlines(keepends=True)
    start = next(n for n, line in enumerate(lines) if line.startswith(group))
    found = [n for n, line in enumerate(lines) if n > start and line.strip().startswith(f"{name}:")]
    if not found:
        assert key in LISTS  # An empty list is not written.
        return
    line = lines[found[0]]
    assert parse_scene(text.replace(group + "\n" + "".join(lines[start + 1:found[0] + 1]),
                                    group + "\n" + "".join(lines[start + 1:found[0]])), "s")
    assert "twice" in refusal("".join([*lines[:found[0]], line, *lines[found[0]:]]))


BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{chr(98 + n)}: &{chr(98 + n)} [{', '.join(['*' + chr(97 + n)] * 9)}]\n" for n in range(12))
FILES = {
    "empty": b"", "binary": bytes(range(256)) * 64, "zeros": bytes(4096), "alias_bomb": BOMB.encode(),
    "tag": written("rate", "!!python/object/apply:os.system [touch evil]").encode(),
    "unknown": written("rat", 3).encode(),
    "twice": (written("rate", 3) + "    rate: 4\n").encode(), "range": written("pressure.mean", -1).encode(),
    "type": written("engine.frequency", "fast").encode(), "other": b"a: 1\nb: [2\n",
    "words": b"to whom it may concern\n"}


@pytest.mark.parametrize("name", [*FILES, "hundred_megabytes", "missing", "directory"])
@pytest.mark.parametrize("words",
                         [["simulate", "{}", "--json", "out.json", "--out", "x.npz"], ["explain", "{}", "--json", "o"],
                                   ["sweep", "{}", "--over", "pressure.mean=1e5:2e5:3", "--json", "o.json", "--out",
                                    "o.jsonl"],
                                   ["demo", "--scene", "{}", "--out", "made"]])
def test_a_file_that_is_no_scene_is_one_line_and_nothing_is_written(name: str, words: list[str], tmp_path: Path,
                                                                    monkeypatch: pytest.MonkeyPatch,
                                                                    capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / f"{name}.yaml"
    if name == "directory":
        file.mkdir()
    elif name == "hundred_megabytes":
        file.touch()
        os.truncate(file, 100_000_000)
    elif name != "missing":
        file.write_bytes(FILES[name])
    before = [path.name for path in tmp_path.iterdir()]
    assert main([word.format(file) for word in words]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert f"{name}.yaml" in err
    assert [path.name for path in tmp_path.iterdir()] == before
