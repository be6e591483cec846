"""What goes to Rerun: a file that its own tool accepts, with every sample in it, written while it is fed."""

import re
import socket
import subprocess
import sys

import numpy as np
import pytest

from tcc_sim.errors import InputError, MissingPackage
from tcc_sim.trajectory import Cycles
from tcc_sim.views.rerun_stream import RerunStream

CYCLE = 0.05


@pytest.fixture(autouse=True)
def _home(tmp_path_factory, monkeypatch):
    """Rerun's tool keeps its settings in the home directory."""
    monkeypatch.setenv("HOME", str(tmp_path_factory.mktemp("home")))
    pytest.importorskip("rerun")


def rerun_tool(*arguments):
    return subprocess.run([sys.executable, "-m", "rerun", "rrd", *map(str, arguments)], capture_output=True, text=True,
                          timeout=60, check=False)


def batch(first, count):
    stamps = np.arange(first, first + count) * 1_000_000
    v = 20.0 * np.sin(2.0 * np.pi * stamps * 1e-9 / CYCLE)
    return stamps, v, 0.01 * v, v, 300.0 + v, 2.0 * v, np.sign(np.round(v)).astype(np.int8)


def cycles_of(count):
    return Cycles(np.ones((count + 1, 3)), np.full(count, 20.0), np.full(count, -20.0), np.zeros(count))


def rows(path):
    """Rows by entity path, counted by Rerun itself."""
    found = {}
    for count, entity in re.findall(r"with (\d+) rows .*? - (/\S+) - data", rerun_tool("print", path).stdout):
        found[entity] = found.get(entity, 0) + int(count)
    return found


def test_the_file_is_accepted_and_holds_every_sample(tmp_path):
    path = tmp_path / "run.rrd"
    with RerunStream("by hand", CYCLE, 387.0, file=path) as stream:
        for first in range(0, 1000, 125):
            stream.samples(*batch(first, 125))
        stream.cycles(cycles_of(19), 0)
        stream.samples(*batch(0, 500), new_run=True)
        stream.cycles(cycles_of(9), 0)
        stream.text("# Summary")
    checked = rerun_tool("verify", path)
    assert checked.returncode == 0, checked.stderr
    found = rows(path)
    static = 1
    for entity in ("/torque/engine", "/torque/friction", "/slip/speed", "/plate/angle", "/plate_speed/speed"):
        assert found[entity] == 1500 + static
    for entity in ("/cycles/largest", "/cycles/smallest", "/phase/section"):
        assert found[entity] == 28 + static
    assert found["/phase/orbit"] == 28 + static
    assert found["/events"] == 1
    states = [batch(0, 1000)[6], batch(0, 500)[6]]
    assert found["/state"] == sum(1 + np.count_nonzero(np.diff(s)) for s in states) + static


def test_it_streams_while_it_is_fed(tmp_path):
    path = tmp_path / "run.rrd"
    with RerunStream("by hand", CYCLE, 387.0, file=path) as stream:
        for first in range(0, 200_000, 50_000):
            stream.samples(*batch(first, 50_000))
        stream._recording.flush(timeout_sec=20.0)
        assert path.stat().st_size > 200_000 * 5 * 8
        stream.samples(*batch(200_000, 1000))


def test_an_existing_file_is_not_overwritten(tmp_path):
    path = tmp_path / "run.rrd"
    path.write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        RerunStream("by hand", CYCLE, 387.0, file=path)
    assert path.read_text() == "mine"
    with pytest.raises(InputError, match="cannot be written"):
        RerunStream("by hand", CYCLE, 387.0, file=tmp_path / "no" / "run.rrd")


def test_one_goal_and_a_url_that_answers():
    with pytest.raises(InputError, match="one of"):
        RerunStream("by hand", CYCLE, 387.0)
    with pytest.raises(InputError, match="is not the URL"):
        RerunStream("by hand", CYCLE, 387.0, url="http://example.org")
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        with pytest.raises(InputError, match="no Rerun viewer answers"):
            RerunStream("by hand", CYCLE, 387.0, url=f"rerun+http://127.0.0.1:{unused.getsockname()[1]}/proxy")


def test_without_rerun_the_extra_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingPackage, match=r"tcc_sim\[view\]"):
        RerunStream("by hand", CYCLE, 387.0, file=tmp_path / "run.rrd")
