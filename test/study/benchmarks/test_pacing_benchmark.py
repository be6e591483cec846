"""The pacing benchmark: the command beside ROS 2."""

import json
import subprocess
import sys

import pytest
from documents import valid

pytest.importorskip("rclpy", reason="ROS 2 is not installed")


def test_the_command_measures_both_loops(tmp_path):
    """In a process of its own, whose settings of threads do not reach other tests."""
    file = tmp_path / "realtime.json"
    words = [sys.executable, "-m", "tcc_sim", "realtime", "--rate", "200", "--duration", "0.5", "--json", str(file)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    result = valid("realtime", json.loads(file.read_text()))
    assert (result["rate"], result["ticks"] > 0, result["missed_ticks"] >= 0) == (200.0, True, True)
    trials = result["settings"]
    assert len({row["name"] for row in trials}) == len(trials) > 3
    for row, start in [(result, ""), (result, "bare_"), *((row, "") for row in trials)]:
        middle, high, most = (row[f"{start}lateness_{key}_s"] for key in ("p50", "p99", "max"))
        assert 0.0 <= middle <= high <= most
        assert 0.0 <= row[f"{start}late_share"] <= 1.0
        assert row[f"{start}cpu_fraction"] > 0.0
    assert f"{result['ticks']:.0f} ticks at 200 Hz" in done.stdout


def test_a_rate_beyond_the_range_is_refused(refused):
    line = refused("realtime", "--rate", "30000")
    assert all(word in line for word in ("rate", "20000"))
