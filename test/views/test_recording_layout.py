"""The layout beside a recording: Rerun's own tool reads it, for the application that it makes of the file's name."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tcc_sim.errors import InputError
from tcc_sim.views.recording_layout import JOINTS, VIEWS, write_layout

rerun = pytest.importorskip("rerun", reason="rerun-sdk is not installed")


def printed(path: Path) -> str:
    """Return the contents of a file, with values, as printed by Rerun's tool."""
    return subprocess.run([sys.executable, "-m", "rerun", "rrd", "print", "-vvv", str(path)], capture_output=True,
                          text=True, timeout=120, check=True).stdout


def test_the_layout_has_every_signal_and_the_name_of_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "mine_0.mcap").write_bytes(b"")
    path = write_layout(tmp_path)
    assert path == tmp_path / "mine_0.rbl"
    assert b"mine_0" in path.read_bytes()
    text = printed(path)
    for topics in (*VIEWS.values(), [JOINTS]):
        for topic in topics:
            assert topic in text, topic
    for component in ("std_msgs.msg.Float64:message", "std_msgs.msg.Int8:message", "Measurements:values"):
        assert component in text
    with pytest.raises(InputError, match=r"mine_0\.rbl exists already and is not overwritten"):
        write_layout(tmp_path / "mine_0.mcap")


def test_a_directory_without_a_recording_gets_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no MCAP file"):
        write_layout(tmp_path)
