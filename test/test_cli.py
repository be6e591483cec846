"""The frame of the command: exit statuses, and one line but no file for wrong input."""

import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from interpreter import python

from tcc_sim import __version__, cli
from tcc_sim.scene import bundled_scenes, load_scene


def test_scenes_are_one_line_each(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["scenes"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(bundled_scenes())
    assert all(len(line) < 130 for line in lines)


def test_a_scene_is_shown_as_a_file_to_start_from(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                                  refused: Callable[..., str]) -> None:
    assert cli.main(["scenes", "--show", "chaos"]) == 0
    (tmp_path / "mine.yaml").write_text(capsys.readouterr().out)
    mine, bundled = load_scene(tmp_path / "mine.yaml"), load_scene("chaos")
    assert (mine.system, mine.operation, mine.description) == (bundled.system, bundled.operation, bundled.description)
    assert "did you mean chaos?" in refused("scenes", "--show", "caos")


@pytest.mark.parametrize("words",
                         [[], ["sceens"], ["scenes", "--all"], ["scenes", "more"], ["sweep"], ["sweep", "fig02"],
                                   ["sweep", "fig02", "--over"], ["recover"],
                                   ["claims", "--json", "a", "--markdown", "a"]])
def test_a_senseless_command_line_is_one_line_and_status_2(words: list[str],
                                                           refused: Callable[..., str]) -> None:
    refused(*words)


@pytest.mark.parametrize(("words", "says"), [
    (["sweep", "fig20", "--over", "engine.frequency=1:2:3"], "did you mean fig02?"),
    (["sweep", "fig02", "--over", "engine.frequncy=1:2:3"], "did you mean engine.frequency?"),
    (["sweep", "fig02", "--over", "engine.frequency=1:2:3", "--set", "no.key=1"], "no.key is not a scene key\n"),
    (["sweep", "fig02", "--over", "engine.frequency=1:2"], "engine.frequency=1:2"),
    (["sweep", "fig02", "--over", "engine.frequency=-5:2:3"], "0.001 to 100000 rad/s"),
    (["sweep", "fig02", "--over", "engine.frequency=100:200:3", "--set", "pressure.mean=-3"], "pressure.mean is -3 Pa"),
    (["sweep", "fig02", "--over", "engine.frequency=100:200:3", "--cycles", "0"], "cycles"),
    (["sweep", "fig02", "--over", "engine.frequency=100:200:3", "--out", "no/sweep.jsonl"], "there is no directory no"),
    (["sweep", "fig02", "--over", "engine.frequency=100:200:3", "--solver", "euler"], "euler")])
def test_wrong_input_is_one_line_and_status_2_and_nothing_is_written(words: list[str], says: str,
                                                                     refused: Callable[..., str]) -> None:
    assert says in refused(*words, "--json", "out.json")


def test_help_and_version_go_to_standard_output(capsys: pytest.CaptureFixture[str],
                                                monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"tcc-sim {__version__}\n"
    assert cli.main(["--help"]) == 0
    out = capsys.readouterr().out
    for name, verb in cli.VERBS.items():
        assert f"{name} " in out
        assert verb.line in out


def test_every_verb_is_in_one_group_and_a_misspelt_one_gets_a_suggestion(refused: Callable[..., str]) -> None:
    grouped = [name for names in cli.GROUPS.values() for name in names]
    assert len(set(grouped)) == len(grouped)
    assert set(cli.VERBS) <= set(grouped)
    assert "did you mean simulate?" in refused("simulte", "fig02")
    assert "see tcc-sim --help" in refused("xyzzy")


@pytest.mark.parametrize(("value", "says"), [
    ("0.01499999999", "is 0.01499999999; it must be 0.015 to 6, one twentieth"), ("0.01", "is 0.01;")])
def test_numbers_that_differ_are_told_apart(value: str, says: str, refused: Callable[..., str]) -> None:
    assert says in refused("simulate", "fig02", "--set", f"friction.kinetic_coefficient={value}")
    assert "rate is 20000.0000001 Hz" in refused("scenes", "--show", "fig02", "--set", "rate=20000.0000001")


def test_scenes_and_explain_take_changes(capsys: pytest.CaptureFixture[str], refused: Callable[..., str]) -> None:
    assert cli.main(["scenes", "--show", "fig02", "--set", "engine.frequency=120"]) == 0
    assert "frequency: 120.0" in capsys.readouterr().out
    assert "--show" in refused("scenes", "--set", "engine.frequency=120")
    assert cli.main(["explain", "fig02"]) == 0
    out = capsys.readouterr().out
    assert "\nterms\n" in out
    assert not re.search("^(topics|modules|kernel arguments)$", out, re.MULTILINE)


@pytest.mark.parametrize("name", cli.VERBS)
def test_help_of_a_verb_fits_a_terminal_and_its_example_parses(
        name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert cli.main([name, "--help"]) == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    example = re.search(r"tcc-sim (.*(?:\n {6,}.*)*)", out.partition("example: ")[2])
    assert example is not None
    words = shlex.split(example.group(1))
    assert words[0] == name
    cli.build_parser(name).parse_args(words)


@pytest.mark.parametrize(("words", "status"), [
    (["simulate", "fig02", "--solver", "rk4", "--step", "1e-3", "--set", "driveline.plate_inertia=1e-6"], 1),
    (["analyse", "nowhere.mcap"], 2),
    (["plot", "nowhere.json"], 2), (["analyse", "a" * 300], 2)])
def test_a_failure_has_a_status_and_one_line(words: list[str], status: int, tmp_path: Path,
                                             monkeypatch: pytest.MonkeyPatch,
                                             capsys: pytest.CaptureFixture[str]) -> None:
    """Steps of 1 ms are far beyond the stability limit of the classical method with so light a plate."""
    monkeypatch.chdir(tmp_path)
    assert cli.main(words) == status
    assert capsys.readouterr().err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_command_waits_for_no_thread() -> None:
    """A thread that compiles or solves a long motion cannot be stopped."""
    program = """
import sys, threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from tcc_sim import cli

def run(arguments):
    begun = threading.Event()
    ThreadPoolExecutor().submit(lambda: (begun.set(), threading.Event().wait()))
    begun.wait()
    print("as far as it came")
    raise KeyboardInterrupt

cli.VERBS["long"] = cli.verbs.Verb("take long")
sys.modules["tcc_sim.cli.long"] = SimpleNamespace(add_arguments=lambda parser: None, run=run)
sys.argv = ["tcc-sim", "long"]
sys.exit(cli.main())
"""
    ended = python("-c", program)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "as far as it came\n", "tcc-sim: interrupted\n")


def test_a_reader_that_goes_away_gets_no_traceback() -> None:
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
    reading, writing = os.pipe()
    os.close(reading)
    try:
        ended = subprocess.run([sys.executable, "-m", "tcc_sim", "scenes"], stdout=writing, stderr=subprocess.PIPE,
                               text=True, env=environment, check=False)
    finally:
        os.close(writing)
    assert (ended.returncode, ended.stderr) == (1, "")


@pytest.mark.parametrize(("words", "status"), [("scenes >&-", 0), ("scenes --show fig20 2>&-", 2)])
def test_what_is_printed_to_a_closed_stream_is_nowhere(words: str, status: int) -> None:
    ended = subprocess.run(["sh", "-c", f'exec "$0" -m tcc_sim {words}', sys.executable], capture_output=True,
                           check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (status, b"", b"")


@pytest.mark.parametrize(("words", "status"), [("--version >&-", 0), ("--nonsense 2>&-", 2)])
def test_a_node_prints_to_a_closed_stream_as_well(words: str, status: int) -> None:
    call = "from tcc_sim.nodes.executables import driveline_node; raise SystemExit(driveline_node())"
    ended = subprocess.run(["sh", "-c", f'exec "$0" -c "$1" {words}', sys.executable, call], capture_output=True,
                           check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (status, b"", b"")


def test_a_name_that_the_terminal_cannot_show_is_escaped(tmp_path: Path) -> None:
    words = ["fmu", "fig02", "--sources-only", "--out", str(tmp_path / "gr\u00fcn.fmu")]
    ended = python("-m", "tcc_sim", *words, PYTHONIOENCODING="ascii", PYTHONUTF8="1")
    assert "gr\\xfcn.fmu: FMI 2.0" in ended.stdout


@pytest.mark.parametrize("name", ["driveline_node", "recorder_node", "slip_controller_node"])
def test_a_node_without_ros_is_one_line(name: str) -> None:
    ended = python("-c", "import sys; sys.modules['rclpy'] = None\n"
                         f"from tcc_sim.nodes.executables import {name}; sys.exit({name}())")
    assert (ended.returncode, ended.stdout, ended.stderr.count("\n")) == (1, "", 1)
    assert "rclpy" in ended.stderr
    assert "tcc_sim[ros]" in ended.stderr


@pytest.mark.parametrize(("module", "words", "command"), [
    ("numba", "simulate fig02 --cycles 61", "'numba>=0.62,<0.69'"),
    ("mcap", "analyse run1", "'mcap>=1.5,<2' lz4 zstandard"),
    ("mcap", "recorder_node", "'mcap>=1.5,<2' lz4 zstandard")])
def test_a_package_that_only_pip_has_is_named_with_the_command(module: str, words: str, command: str) -> None:
    if words == "recorder_node":
        pytest.importorskip("rclpy", reason="rclpy is not installed")
    call = "executables.recorder_node()" if words == "recorder_node" else f"cli.main({words.split()})"
    ended = python("-c", f"import sys; sys.modules[{module!r}] = None\nfrom tcc_sim import cli\n"
                         f"from tcc_sim.nodes import executables\nsys.exit({call})")
    assert ended.returncode == 1
    assert f"is not installed; python3 -m pip install {command} brings it" in ended.stderr
    assert ended.stderr.count("\n") == 1


EARLY = """
import os, runpy, signal, sys

class Look:
    def find_spec(self, name, path=None, target=None):
        if name == "tcc_sim.output.terminal":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Look())
sys.argv = ["tcc-sim", "scenes"]
{start}
"""


@pytest.mark.parametrize("start", ["runpy.run_module('tcc_sim', run_name='__main__', alter_sys=True)",
                                   "from tcc_sim.__main__ import main; sys.exit(main())"])
def test_ctrl_c_while_the_program_is_loaded_prints_nothing(start: str) -> None:
    ended = python("-c", EARLY.format(start=start))
    assert (ended.returncode, ended.stdout, ended.stderr) == (-signal.SIGINT, "", "")


@pytest.mark.parametrize("given", [None, "2"])
def test_the_program_takes_one_thread_for_small_matrices_unless_told(given):
    variables = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    code = "import os, tcc_sim.__main__; print(os.environ['OPENBLAS_NUM_THREADS'])"
    done = subprocess.run([sys.executable, "-c", code],
                          env=variables | ({"OPENBLAS_NUM_THREADS": given} if given else {}),
                          capture_output=True, text=True, check=True)
    assert done.stdout.strip() == (given or "1")
