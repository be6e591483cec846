"""The tutorial runs from end to end as on its page, and prints the lines of the page."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest
from documents import valid

from tcc_sim.cli import main
from tcc_sim.recording.reader import Run
from tcc_sim.scene import load_scene

PAGE = Path(__file__).resolve().parent.parent / ".github" / "guide" / "tutorial.md"
STEP = re.compile(r"^```(python|text) ?(\S*)\n(.*?)^```|^    (\S[^\n]*)\n", re.DOTALL | re.MULTILINE)
RECORDED, PACED = "--scene controlled --duration 3", "--scene paced.yaml --duration {}"
"""Options of the page, and those of the test: in lock-step, so that a busy machine makes no late commands."""
ENOUGH = 500
"""Number of recorded states with which a controller's loop is judged; a busy machine needs longer for them."""
NOT_RUN = ("tcc-sim demo --scene rig.yaml", "tcc-sim analyse mine1")
"""Commands that need a quiet machine, a node against the clock, and what is made of its recording."""
NUMBER = r"[-+]?\d+(?:\.\d+)?"
QUICKER = {'{"friction.kinetic_coefficient": 0.25}, {"pressure.time_constant": 0.04}, ': "", "3 passed": "1 passed"}
"""Parts of the page, and what is tested instead: the last of its three tolerances."""
WITHIN = 0.02
"""Relative difference allowed between a number of the page and the printed one."""


def run(command: str, capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command of tcc-sim in this process, and return its output, which may go to a file too."""
    command, _, file = command.partition(" > ")
    status, (out, err) = main(shlex.split(command)[1:]), capsys.readouterr()
    assert status == 0, f"{command}\n{out}\n{err}"
    if file:
        Path(file).write_text(out)
    return out


def run_python(command: str) -> str:
    """Run a command of Python in a process of its own, and return its output."""
    ended = subprocess.run([sys.executable, *shlex.split(command)[1:]], timeout=300, capture_output=True, text=True,
                           check=False)
    assert ended.returncode == 0, f"{command}\n{ended.stdout}\n{ended.stderr}"
    return ended.stdout


def agrees(shown: str, printed: str) -> bool:
    """Whether a line of the page matches a printed one: equal words, numbers within a tolerance, anything for dots."""
    parts = re.split(rf"({NUMBER}|\.\.\.)", " ".join(shown.split()))
    pattern = "".join(".*" if part == "..." else f"({NUMBER})" if re.fullmatch(NUMBER, part) else re.escape(part)
                      for part in parts)
    match = re.fullmatch(pattern, " ".join(printed.split()))
    numbers = [float(part) for part in parts if re.fullmatch(NUMBER, part)]
    return match is not None and all(abs(float(other) - number) <= WITHIN * abs(number)
                                     for number, other in zip(numbers, match.groups()))


def demonstrated(command: str, capsys: pytest.CaptureFixture[str]) -> str:
    """Run the demo of the page until its recording has enough states; return what it prints."""
    for seconds in (1, 4, 16):
        shutil.rmtree("clutch1", ignore_errors=True)
        printed = run(command.replace(RECORDED, PACED.format(seconds)), capsys)
        if json.loads(Path("clutch1/analysis.json").read_text())["messages"] >= ENOUGH:
            break
    return printed


@pytest.mark.parametrize(("printed", "agreeing"), [("  gain  4.44", True), ("gain 4.9", False), ("loss 4.43", False)])
def test_a_line_agrees_by_words_and_numbers(printed: str, agreeing: bool) -> None:
    assert agrees("gain 4.43", printed) == agreeing


def test_the_tutorial_runs_and_prints_what_it_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                    capsys: pytest.CaptureFixture[str], without_layout: None) -> None:
    """Its demo starts the example controller, whose target and commands are recorded and judged."""
    for name in ("rclpy", "matplotlib", "rerun"):
        pytest.importorskip(name, reason=f"{name} is not installed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    monkeypatch.setenv("MPLBACKEND", "Agg")
    for name in ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE"):
        monkeypatch.delenv(name, raising=False)
    Path("paced.yaml").write_text(load_scene("controlled").with_values({"pacing": "lockstep"}).text())
    page = PAGE.read_text()
    for part, other in QUICKER.items():
        assert page.count(part) == 1
        page = page.replace(part, other)
    steps = STEP.findall(page)
    for _, name, code, _ in steps:
        if name:
            Path(name).write_text(code)
    printed, aside = [""], dict[str, Future[str]]()
    with ThreadPoolExecutor(1) as pool:
        for kind, name, code, command in steps:
            if kind == "python" and not name:
                exec(compile(code, str(PAGE), "exec"), {})
                printed.append(capsys.readouterr().out)
            elif kind == "text":
                lines = printed[-1].splitlines()
                absent = [line for line in code.splitlines() if not any(agrees(line, other) for other in lines)]
                assert absent == [], printed[-1]
            elif command.startswith("python "):
                printed.append(aside[command].result())
            elif command and not command.startswith(NOT_RUN):
                printed.append(demonstrated(command, capsys) if RECORDED in command else run(command, capsys))
                if command.endswith("> rig.yaml"):  # All that the other process needs is there now.
                    aside = {other: pool.submit(run_python, other) for *_, other in steps
                             if other.startswith("python ")}
    for name in ("law", "trial"):
        monkeypatch.delitem(sys.modules, name)
    assert "slip controller: holds a mean slip speed of 20 rad/s\n" in printed[1]
    assert "target 20 rad/s: mean " in printed[1]
    document = valid("analyse", json.loads(Path("clutch1/analysis.json").read_text()))
    assert (document["lost_messages"], document["complete"], document["command"][0]) == (0, True, "demo")
    first = document["segments"][0]
    assert (first["began_by"], first["tracking"]["target"]) == ("start", 20.0)
    recorded = Run(Path("clutch1/recording"))
    assert {"/target_slip_speed", "/actuation_pressure", "/applied_pressure", "/held"} <= set(recorded.topics)
    held = document["inputs"]["actuation_pressure"]
    assert (held["publishers"], held["refused"], held["lost"], held["ignored"]) == (1, 0, 0, 0)
    assert held["topic"] > 0.0
