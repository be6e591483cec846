"""The pacing benchmark: figures of a loop by hand, and the command beside ROS 2."""

import json
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from documents import valid

pacing = pytest.importorskip("tcc_sim.study.benchmarks.pacing_benchmark", reason="ROS 2 is not installed")


def test_figures_of_a_loop_by_hand():
    """Two stretches: percentiles of all latenesses, late ticks of all ticks, processor time of all time."""
    loop = pacing.Stretches()
    late = [np.arange(1.0, 61.0), np.arange(61.0, 101.0)]
    loop.pacers = [SimpleNamespace(latenesses=lambda x=x: x, late_ticks=n, ticks=len(x)) for n, x in enumerate(late)]
    loop.cpu, loop.wall = 1.0, 4.0
    assert loop.figures("bare_") == pytest.approx({
        "bare_lateness_p50_s": 50.5, "bare_lateness_p99_s": 99.01, "bare_lateness_max_s": 100.0,
        "bare_late_share": 0.01, "bare_cpu_fraction": 0.25})


def test_settings_are_parameters_of_the_node():
    given = {p.name: p.value for p in pacing.Settings(50, (2, 3), True).parameters()}
    assert given == {"thread_priority": 50, "lock_memory": True, "cpu_affinity": [2, 3]}
    assert {p.name: p.value for p in pacing.Settings().parameters()} == {"thread_priority": 0, "lock_memory": False}


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
    assert "rate" in line
    assert "20000" in line
