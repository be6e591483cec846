"""Output of commands: no line wider than the terminal, aligned columns, whole lines for files and pipes, tables."""

from __future__ import annotations

import io
import os
import pty
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import tcc_sim
from tcc_sim.output.tables import sweep_lines
from tcc_sim.output.terminal import open_streams, terminal_width, wrapped

ROOT = Path(__file__).resolve().parent.parent.parent


@pytest.mark.parametrize(("line", "column"), [
    ("short", 0), ("  name  what it is and what else there is to say of it", 8),
    ("        target 20 rad/s: mean 20, rms error 0.0036, largest", 10),
    ("words without columns go on two places further in", 2),
    ("a  b  far to the right another  column is no sign", 6),
    ("/a/path/that/is/longer/than/the/terminal/is/wide-and-whole", 0)])
def test_a_line_goes_on_under_its_own_column(line: str, column: int) -> None:
    first, *rest = wrapped(line, 40).split("\n")
    assert [each[:column].strip() for each in rest] == [""] * len(rest)
    assert all(not each[column].isspace() for each in rest)
    assert all(len(each) <= 40 or " " not in each.strip() for each in (first, *rest))
    assert "".join([first, *rest]).replace(" ", "") == line.replace(" ", "")
    assert wrapped(line, None) == line
    assert wrapped(f"{line}\n\n{line}", 40) == "\n".join([first, *rest, "", first, *rest])


def test_the_width_is_that_of_the_terminal_and_none_for_a_pipe(monkeypatch):
    monkeypatch.setenv("COLUMNS", "72")
    assert terminal_width() == 72
    monkeypatch.setenv("COLUMNS", "10")
    assert terminal_width() == 40
    monkeypatch.delenv("COLUMNS")
    code = "import sys; from tcc_sim.output.terminal import terminal_width; sys.stdout.write(repr(terminal_width()))"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True,
                          check=True).stdout == "None"


@pytest.mark.parametrize("words", [["scenes"], ["simulate", "slip", "--cycles", "20"], ["--help"]])
def test_nothing_is_wider_than_a_terminal_of_eighty_columns(words):
    """A separate terminal for standard output, set to 80 columns by the command started in it."""
    master, slave = pty.openpty()
    with subprocess.Popen(["sh", "-c", 'stty cols 80 && exec "$@"', "sh", sys.executable, "-m", "tcc_sim", *words],
                          cwd=ROOT, stdin=slave, stdout=slave, stderr=subprocess.DEVNULL,
                          env={k: v for k, v in os.environ.items() if k != "COLUMNS"}) as process:
        os.close(slave)
        text = b""
        try:
            while part := os.read(master, 65536):
                text += part
        except OSError:  # The terminal is gone with its last user.
            pass
    os.close(master)
    assert process.returncode == 0
    lines = text.decode().replace("\r\n", "\n").split("\n")
    assert len(lines) > 4
    assert max(map(len, lines)) <= 80


def test_closed_streams_take_any_text_and_what_an_encoding_lacks_is_escaped(monkeypatch):
    ascii_only, other = io.TextIOWrapper(io.BytesIO(), encoding="ascii"), io.StringIO()
    for out, error in ((None, ascii_only), (other, None)):
        monkeypatch.setattr(sys, "stdout", out)
        monkeypatch.setattr(sys, "stderr", error)
        open_streams()
        for stream in (sys.stdout, sys.stderr):
            stream.write("caf\xe9\n")
            stream.flush()
        closed = sys.stdout if out is None else sys.stderr
        assert (closed.name, closed.mode) == (os.devnull, "w")
        closed.close()
        monkeypatch.undo()
    assert (ascii_only.buffer.getvalue(), other.getvalue()) == (b"caf\\xe9\n", "caf\xe9\n")


MU_K = "friction.kinetic_coefficient"


@cache
def swept() -> tcc_sim.Sweep:
    """Runaway, a period, none found, and not settled: by the paper below 0.5556 of mu_s slip grows without bound."""
    return tcc_sim.sweep("chaos", MU_K, [0.15, 0.205, 0.24, 0.3], cycles=60)


@pytest.mark.parametrize("width", [None, 60, 80, 200])
def test_a_sweep_shows_each_of_its_results_at_every_width(width: int | None) -> None:
    sweep, lines = swept(), sweep_lines(swept(), width)
    assert width is None or max(map(len, lines)) <= width
    shown: dict[str, list[str]] = {name: [] for name in ("max_slip_speed", "period", "stick_fraction", "regime")}
    names: list[str] = []
    for line in lines:
        words = line.split()
        if words[:1] == ["kinetic_coefficient"]:
            names = words[1:]
        elif words and re.match(r"0\.\d", words[0]):
            for name, word in zip(names, words[1:]):
                shown[name].append(word)
    columns = sweep.columns()
    assert [float(word) for word in shown["max_slip_speed"]] == pytest.approx(columns["max_slip_speed"], rel=1e-6)
    assert [float(word) for word in shown["stick_fraction"]] == pytest.approx(columns["stick_fraction"], abs=5e-5)
    assert shown["regime"] == list(columns["regime"])
    kinds = [columns[name] for name in ("runaway", "transient", "period")]
    for word, runaway, transient, period in zip(shown["period"], *kinds):
        assert ("runaway" in word) == runaway
        assert runaway or ("*" in word) == transient
        assert runaway or not period or int(word.strip("*")) == period
    assert True in columns["runaway"]
    assert max(columns["period"]) > 0
