"""`analyse` and `recover` as commands on recordings that are cut, flipped or zeroed anywhere: figures, or one line and
none.

200 seeded damages go through both commands, in blocks that the workers of a test run share.
"""

import json
import random
import resource

import numpy as np
import pytest
from test_bag_round_trip import TICK, write
from test_damage import damaged

from tcc_sim.cli import main

BLOCKS, EACH, TICKS = 5, 40, 220
LARGEST_GROWTH = 200_000
"""kB of memory; the whole recording has less than 0.1 MB."""


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """Bytes of a recording of 5 engine cycles with pressures in 5 chunks, and what `analyse` says of it."""
    folder = tmp_path_factory.mktemp("whole")
    t = np.arange(TICKS) * 1e-3
    slip_speed, torque = 30.0 + 40.0 * np.sin(150.0 * t), 300.0 + 250.0 * np.sin(150.0 * t)
    rows = np.column_stack([100.0 * t, 0.1 + 0.01 * np.sin(150.0 * t), slip_speed, 0.0 * t, torque, 0.9 * torque])
    path = write(folder / "run", rows, [n * TICK for n in range(TICKS)], pressures=[2e5] * TICKS)
    return path.read_bytes(), analysed(path, folder / "figures.json")


def analysed(path, figures):
    """The figures of the command, without the time that it took and the name that the file gives a scene without one.
    """
    assert main(["analyse", str(path), "--json", str(figures)]) == 0
    found = json.loads(figures.read_text())
    figures.unlink()
    del found["elapsed_s"], found["scene"], found["command"]
    for segment in found["segments"]:
        del segment["elapsed_s"]
    return found


def one_line(status, captured):
    """What a command that ends with status 1 or 2 may say."""
    assert status in (1, 2)
    assert captured.out == ""
    assert captured.err.startswith("tcc-sim: ")
    assert captured.err.count("\n") == 1


@pytest.mark.parametrize("block", range(BLOCKS))
def test_any_damage_ends_in_figures_or_one_line(tmp_path, original, capsys, block):
    data, whole = original
    draw, outcomes = random.Random(f"damage {block}"), []
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for n in range(EACH):
        content = damaged(data, draw) if n % 3 else damaged(damaged(data, draw), draw)
        path, figures, again = tmp_path / f"{n}.mcap", tmp_path / "figures.json", tmp_path / f"{n}_recovered"
        path.write_bytes(content)
        status = main(["analyse", str(path), "--json", str(figures)])
        captured = capsys.readouterr()
        if status == 0:
            found = json.loads(figures.read_text())
            figures.unlink()
            for segment in found["segments"]:
                del segment["elapsed_s"]
            # What is not as it was has a warning.
            assert found["warnings"] or {key: found[key] for key in whole} == whole
            assert captured.err == ""
        else:
            one_line(status, captured)
            assert not figures.exists()
        outcomes.append(status)
        status = main(["recover", str(path)])
        captured = capsys.readouterr()
        if status == 0:
            assert captured.err == ""
            assert "missing" in captured.out
            if outcomes[-1] == 0 and not n % 5:
                recovered = analysed(again, figures)
                capsys.readouterr()
                assert recovered["complete"]
                assert {key: recovered[key] for key in ("messages", "lost_messages", "max_slip_speed", "section")} == {
                    key: found[key] for key in ("messages", "lost_messages", "max_slip_speed", "section")}
        else:
            one_line(status, captured)
            assert not again.exists()
        assert path.read_bytes() == content
    assert outcomes.count(0) > 0.5 * EACH
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory < LARGEST_GROWTH
