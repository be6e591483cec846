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


def test_a_scene_is_shown_as_a_file_to_start_from(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["scenes", "--show", "chaos"]) == 0
    (tmp_path / "mine.yaml").write_text(capsys.readouterr().out)
    mine, bundled = load_scene(tmp_path / "mine.yaml"), load_scene("chaos")
    assert (mine.system, mine.operation, mine.description) == (bundled.system, bundled.operation, bundled.description)


SWEEP = ["sweep", "fig02", "--json", "out.json", "--over"]
HUNDRED = "engine.frequency=100:200:3"


@pytest.mark.parametrize(("words", "says"), [
    ([], ""), (["sceens"], "scenes?"), (["scenes", "--all"], "--all"), (["scenes", "more"], "more"), (["sweep"], ""),
    (["sweep", "fig02"], "--over"), (SWEEP, "--over"), (["recover"], ""),
    (["claims", "--json", "a", "--markdown", "a"], "a"), (["simulte", "fig02"], "simulate?"), (["xyzzy"], "--help"),
    (["scenes", "--show", "caos"], "chaos?"), (["scenes", "--set", "engine.frequency=120"], "--show"),
    (["scenes", "--show", "fig02", "--set", "rate=20000.0000001"], "20000.0000001 Hz"),
    (["simulate", "fig02", "--set", "friction.kinetic_coefficient=0.01499999999"], "0.01499999999"),
    (["sweep", "fig20", "--over", HUNDRED], "fig02?"), ([*SWEEP, "engine.frequncy=1:2:3"], "engine.frequency?"),
    ([*SWEEP, HUNDRED, "--set", "no.key=1"], "no.key"), ([*SWEEP, "engine.frequency=1:2"], "engine.frequency=1:2"),
    ([*SWEEP, "engine.frequency=-5:2:3"], "0.001 to 100000 rad/s"),
    ([*SWEEP, HUNDRED, "--set", "pressure.mean=-3"], "pressure.mean is -3 Pa"),
    ([*SWEEP, HUNDRED, "--cycles", "0"], "cycles"), ([*SWEEP, HUNDRED, "--out", "no/sweep.jsonl"], "no"),
    ([*SWEEP, HUNDRED, "--solver", "euler"], "euler"), ([*SWEEP, HUNDRED, "--seed", "3"], "--scatter"),
    ([*SWEEP, HUNDRED, "--law", "no.py:f", "--target", "20"], "no.py"), (["figure", "2", "--out", __file__], __file__),
    (["simulate", "slip", "--topic", "x"], "--inputs"), (["claims", "--figures", "99"], "99")])
def test_wrong_input_is_one_line_and_status_2_and_nothing_is_written(words: list[str], says: str,
                                                                     refused: Callable[..., str]) -> None:
    assert says in refused(*words)


def test_help_and_version_go_to_standard_output(capsys: pytest.CaptureFixture[str],
                                                monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"tcc-sim {__version__}\n"
    assert cli.main(["--help"]) == 0
    out = capsys.readouterr().out
    assert [name for name in cli.VERBS if not re.search(rf"^  {name} +[a-z].{{20}}", out, re.MULTILINE)] == []


def test_scenes_and_explain_take_changes(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["scenes", "--show", "fig02", "--set", "engine.frequency=120"]) == 0
    assert "frequency: 120.0" in capsys.readouterr().out
    assert cli.main(["explain", "fig02", "--set", "engine.frequency=120"]) == 0
    assert "120 rad/s" in capsys.readouterr().out


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


def test_an_interrupted_command_waits_for_no_thread(tmp_path: Path) -> None:
    """A thread that compiles or solves a long motion cannot be stopped."""
    (tmp_path / "lasting.py").write_text("""
import threading
from concurrent.futures import ThreadPoolExecutor
from tcc_sim.cli.options import command

@command()
def long(arguments):
    begun = threading.Event()
    ThreadPoolExecutor().submit(lambda: (begun.set(), threading.Event().wait()))
    begun.wait()
    print("as far as it came")
    raise KeyboardInterrupt
""")
    ended = python("-c", f"""
import sys
from tcc_sim import cli
sys.path.append({str(tmp_path)!r})
cli.VERBS["long"] = "lasting"
sys.argv = ["tcc-sim", "long"]
sys.exit(cli.main())
""")
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


@pytest.mark.parametrize(("words", "status"), [("scenes >&-", 0), ("scenes --show fig20 2>&-", 2),
                                               ("--version >&-", 0), ("--nonsense 2>&-", 2)])
def test_what_is_printed_to_a_closed_stream_is_nowhere(words: str, status: int) -> None:
    """By the command, and by a node, whose options begin with dashes."""
    call = "from tcc_sim.nodes.executables import driveline_node; raise SystemExit(driveline_node())"
    start = '-c "$1"' if words.startswith("--") else "-m tcc_sim"
    ended = subprocess.run(["sh", "-c", f'exec "$0" {start} {words}', sys.executable, call], capture_output=True,
                           check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (status, b"", b"")


def test_a_name_that_the_terminal_cannot_show_is_escaped(tmp_path: Path) -> None:
    words = ["fmu", "fig02", "--sources-only", "--out", str(tmp_path / "gr\u00fcn.fmu")]
    ended = python("-m", "tcc_sim", *words, PYTHONIOENCODING="ascii", PYTHONUTF8="1")
    assert "gr\\xfcn.fmu: FMI 2.0" in ended.stdout


@pytest.mark.parametrize(("module", "call", "words"), [
    ("rclpy", "executables.driveline_node()", "rclpy .*tcc_sim.ros."),
    ("numba", "cli.main(['simulate', 'fig02', '--cycles', '61'])", "pip install 'numba>=0.62,<0.69'"),
    ("mcap", "cli.main(['analyse', 'run1'])", "pip install 'mcap>=1.5,<2' lz4 zstandard"),
    ("mcap", "executables.recorder_node()", "pip install 'mcap>=1.5,<2' lz4 zstandard")])
def test_an_absent_package_is_one_line_with_the_command_that_installs_it(module: str, call: str, words: str) -> None:
    if module == "mcap" and "node" in call:
        pytest.importorskip("rclpy", reason="rclpy is not installed")
    ended = python("-c", f"import sys; sys.modules[{module!r}] = None\nfrom tcc_sim import cli\n"
                         f"from tcc_sim.nodes import executables\nsys.exit({call})")
    assert (ended.returncode, ended.stdout, ended.stderr.count("\n")) == (1, "", 1)
    assert re.search(words, ended.stderr)


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
