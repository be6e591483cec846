"""The tutorial runs from end to end as on its page, and prints the lines of the page."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parent.parent / ".github" / "guide" / "tutorial.md"
STEP = re.compile(r"^```(python|text) ?(\S*)\n(.*?)^```|^    (\S[^\n]*)\n", re.DOTALL | re.MULTILINE)
RECORDED, PACED = "--scene controlled --duration 3", "--scene paced.yaml --duration 2"
"""Options of the page, and those of the test: in lock-step, so that a busy machine makes no late commands."""
NOT_RUN = ("tcc-sim demo --scene rig.yaml",)
"""Commands that need a quiet machine: a node against the clock."""
NUMBER = r"[-+]?\d+(?:\.\d+)?"
WITHIN = 0.02
"""Relative difference allowed between a number of the page and the printed one."""


def run(command: str, folder: Path) -> str:
    """Run a shell command with the programs of this environment in a folder, and return its output."""
    paths = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    ended = subprocess.run(["sh", "-c", command], cwd=folder, env={**os.environ, "PATH": paths, "MPLBACKEND": "Agg"},
                           timeout=300, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, f"{command}\n{ended.stdout}\n{ended.stderr}"
    return ended.stdout


def agrees(shown: str, printed: str) -> bool:
    """Whether a line of the page matches a printed one: equal words, numbers within a tolerance, anything for dots."""
    parts = re.split(rf"({NUMBER}|\.\.\.)", " ".join(shown.split()))
    pattern = "".join(".*" if part == "..." else f"({NUMBER})" if re.fullmatch(NUMBER, part) else re.escape(part)
                      for part in parts)
    found = re.fullmatch(pattern, " ".join(printed.split()))
    numbers = [float(part) for part in parts if re.fullmatch(NUMBER, part)]
    return found is not None and all(abs(float(other) - number) <= WITHIN * abs(number)
                                     for number, other in zip(numbers, found.groups()))


@pytest.mark.parametrize(("printed", "agreeing"), [("  gain  4.44", True), ("gain 4.9", False), ("loss 4.43", False)])
def test_a_line_agrees_by_words_and_numbers(printed: str, agreeing: bool) -> None:
    assert agrees("gain 4.43", printed) == agreeing


def test_the_tutorial_runs_and_prints_what_it_shows(tmp_path: Path) -> None:
    pytest.importorskip("rclpy", reason="ROS 2 is not installed")
    pytest.importorskip("matplotlib")
    scene = run("tcc-sim scenes --show controlled", tmp_path)
    (tmp_path / "paced.yaml").write_text(scene.replace("pacing: real_time", "pacing: lockstep"))
    printed = ""
    for kind, name, code, command in STEP.findall(PAGE.read_text()):
        if name:
            (tmp_path / name).write_text(code)
        elif kind == "python":
            printed = run(f"python -c {shlex.quote(code)}", tmp_path)
        elif kind == "text":
            lines = printed.splitlines()
            absent = [line for line in code.splitlines() if not any(agrees(line, other) for other in lines)]
            assert absent == [], printed
        elif not command.startswith(NOT_RUN):
            printed = run(command.replace(RECORDED, PACED), tmp_path)
