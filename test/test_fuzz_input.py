"""Random scene files and command lines give one line of refusal or a result."""

from __future__ import annotations

import contextlib
import functools
import io
import re
from pathlib import Path

import pytest

pytest.importorskip("hypothesis")

from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from tcc_sim import cli
from tcc_sim.errors import InputError
from tcc_sim.scene import KNOWN_KEYS, Scene, bundled_scenes, load_scene, parse_assignments, parse_scene

FUZZ = settings(derandomize=True, database=None, deadline=None, max_examples=50,
                suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
"""The same examples every time; what longer searches found stands beside the tests as an example of its own."""
VALID = [path.read_text() for path in bundled_scenes().values()]
HEAD = "/**:\n  ros__parameters:\n"

SCALARS = st.sampled_from([
    "1", "-1", "0", "1e308", "-1e309", ".inf", "-.inf", ".nan", "9" * 400, "0x10", "0o7", "0b1", "1_0", "1:30",
    "2001-01-01", "2001-99-99", "2001-12-14t21:59:43.10-05:00", "~", "null", "true", "no", "''", "'", "\"",
    "\"\\x\"", "\"\\ud800\"", "[]", "{}", "[1", "{a", "<<", "=", "*a", "&a 1", "!!int 1", "!x y",
    "!!python/object:os.system x", "!!binary aGk=", "? a", "- a", "|", ">", "%YAML 9.9", "---", "...", "# x", "\t",
    "\0", "\ufeff", "\u2028", "\U0001f600", "@", "`", "harmonic", "topic", "smoothed", "set_valued", "lockstep",
    "1.5", "[1, 2]", "[[1]]", "{a: 1}", "[a]", "[1e999]", "[true]"])
KEYS = st.sampled_from([
    *KNOWN_KEYS, "engine", "pressure", "friction", "/**", "ros__parameters", "<<", "", "~", "1", "true", "[1]", "{}",
    "a.b.c", "engine."])


@st.composite
def scenes(draw: st.DrawFn) -> str:
    """A parameter file of known and strange keys with strange values."""
    lines = draw(st.lists(st.tuples(KEYS, SCALARS, st.integers(0, 3)), max_size=8))
    return HEAD + "".join(f"{' ' * (4 + 2 * deeper)}{key}: {value}\n" for key, value, deeper in lines)


@st.composite
def mutations(draw: st.DrawFn) -> str:
    """A bundled scene with pieces cut, doubled or replaced."""
    text = draw(st.sampled_from(VALID))
    for _ in range(draw(st.integers(1, 6))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 40)))
        piece = draw(st.one_of(SCALARS, KEYS, st.just(""), st.just(text[start:end] * 2), st.text(max_size=5)))
        text = text[:start] + piece + text[end:]
    return text


def one_short_line(error: InputError) -> None:
    """Check that a refusal is printable and short."""
    assert str(error).isprintable()
    assert len(str(error)) < 1100


def refused_or_scene(text: str) -> None:
    """Check that a scene equals the one read from its own text, or is refused in one line."""
    try:
        scene = parse_scene(text, "s")
    except InputError as error:
        one_short_line(error)
        return
    assert isinstance(scene, Scene)
    assert parse_scene(scene.text(), "s").system == scene.system


@FUZZ
@given(st.text(max_size=200))
def test_any_text(text: str) -> None:
    refused_or_scene(text)


@FUZZ
@given(scenes())
@example(HEAD + "    rate: " + "1:" * 20_000 + "1\n")
@example(HEAD + "    rate: -" + "9" * 4000 + "\n")
@example(HEAD + "    rate: " + "9" * 5000 + "\n")
@example(HEAD + '    "a\\nb": 1\n')
@example(HEAD + '    "\\ud800": 1\n')
@example(HEAD + "    rate: " + "x" * 60_000 + "\n")
@example(HEAD + "    rate: " + "[" * 60_000)
@example("- " * 30_000)
@example("#" * 70_000)
@example(HEAD + "    a: &a [1, 1]\n    b: &b [*a, *a]\n    c: &c [*b, *b]\n    rate: [*c, *c]\n")
def test_strange_keys_and_values(text: str) -> None:
    refused_or_scene(text)


@FUZZ
@given(mutations())
def test_bundled_scenes_with_pieces_changed(text: str) -> None:
    refused_or_scene(text)


@FUZZ
@given(st.binary(max_size=200))
def test_any_bytes_in_a_file(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "x.yaml"
    path.write_bytes(data)
    try:
        load_scene(path)
    except InputError as error:
        one_short_line(error)


@FUZZ
@given(st.lists(st.one_of(st.text(max_size=30), st.builds("{}={}".format, KEYS, SCALARS)), max_size=3))
@example(["driveline.flywheel_inertia=2001-99-99"])
@example(["rate=" + "9" * 5000])
@example(["rate=" + "[" * 1200])
@example(["rate=" + "[" * 100_000])
@example(["a\nb=1"])
def test_any_assignments(words: list[str]) -> None:
    try:
        load_scene("fig02").with_values(parse_assignments(words))
    except InputError as error:
        one_short_line(error)


QUICK = ("scenes", "simulate", "analyse", "recover")
"""Verbs that run; of the others, which take their time, only the command line is read."""
WORDS = st.one_of(st.sampled_from([
    "", "-", "--", "=", "-1", "0", "1e999", "nan", "inf", "x" * 500, "\n", "\t", "\udcff", "\U0001f600", "../..", "/",
    ".", "/dev/null", "/proc/self/mem", "/nowhere/x.json", "x.json", "x.npz", "x.csv", "x.mcap", "fig02", "minimal",
    "fig20", "1:2:3", "-h", "--version", "--help=3", "rate=3", "engine.frequency=-1", "engine.frequency=120",
    "engine.frequency=1:2:3", "pressure.mean=[[", "pressure.mean=2001-99-99", "3", "1.5", "event_driven",
    "fixed_step", "euler", "*", "$(id)", "`id`", "; id", "%s", "{0}"]), st.text(
        max_size=8).filter(lambda text: "\0" not in text))


@functools.cache
def options_of(verb: str) -> list[str]:
    """The options that a verb's help names."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        cli.main([verb, "--help"])
    return sorted(set(re.findall(r"--[a-z][a-z-]*", out.getvalue())))


@st.composite
def command_lines(draw: st.DrawFn) -> list[str]:
    """A verb or another word, with its options and nonsense between them."""
    verb = draw(st.sampled_from([*QUICK, *cli.VERBS, "", "sceens", "--version"]))
    pairs = st.tuples(st.sampled_from(options_of(verb) if verb in cli.VERBS else ["--json"]), WORDS)
    scene = draw(st.sampled_from([[], ["fig02"], ["minimal"]]))
    return [verb, *scene, *(word for pair in draw(st.lists(pairs, max_size=3)) for word in pair),
            *draw(st.lists(WORDS, max_size=2 - len(scene)))]


@FUZZ
@given(command_lines())
@example(["demo", "\n"])
@example(["scenes", "\udcff"])
def test_any_command_line(tmp_path_factory: pytest.TempPathFactory, words: list[str]) -> None:
    folder = tmp_path_factory.mktemp("here")
    out, err = io.TextIOWrapper(io.BytesIO(), "utf-8"), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        patch.chdir(folder)
        if words[0] in cli.VERBS and words[0] not in QUICK:
            with contextlib.suppress(SystemExit):
                cli.build_parser(words[0]).parse_args(words)
            return
        status = cli.main(words)
    assert status in (0, 1, 2)
    if status == 2:
        assert err.getvalue().count("\n") == 1, err.getvalue()
        assert list(folder.iterdir()) == []
