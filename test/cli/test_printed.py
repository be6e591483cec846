"""Verbs print and write the figures that they computed."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

import tcc_sim
from tcc_sim.cli import demo, main
from tcc_sim.errors import InputError
from tcc_sim.scene import load_scene


def printed(capsys, *words):
    assert main(list(map(str, words))) == 0
    return capsys.readouterr().out


def test_the_length_of_a_tick_is_that_of_the_rate(capsys):
    tick = 1e3 / load_scene("slip").operation.rate
    assert f" in a tick of {tick:g} ms" in printed(capsys, "explain", "slip")


def test_a_table_is_fitted_to_the_scene_that_is_named(capsys, tmp_path):
    path = tmp_path / "run.csv"
    assert main(["simulate", "slip", "--set", "friction.kinetic_coefficient=0.31", "--cycles", "5", "--discard", "0",
                 "--samples", "40", "--out", str(path)]) == 0
    capsys.readouterr()
    status = main(["identify", str(path), "--scene", "slip", "--free", "friction.kinetic_coefficient", "--json", "-"])
    out = capsys.readouterr()
    assert status == 0, out.err
    assert json.loads(out.out)["parameters"][0]["value"] == pytest.approx(0.31, rel=1e-3)


def test_a_demo_records_as_long_as_it_says_and_names_its_files(capsys, figures, monkeypatch, tmp_path):
    """With a stand-in for the nodes, which simulates, and for the clock, which goes on while the nodes are watched."""
    pytest.importorskip("rerun")
    clock = [100.0]

    class Session:
        def __init__(self, recording, driveline, controller):
            recording.mkdir()
            self.path, self.environment = recording / "run.mcap", {}
            assert driveline == {"scene": "slip"}

        def watch(self, seconds):
            clock[0] += seconds

        def stop(self):
            assert main(["simulate", "slip", "--cycles", "12", "--out", str(self.path)]) == 0

    monkeypatch.setattr("tcc_sim.nodes.children.Session", Session)
    monkeypatch.setattr("tcc_sim.nodes.children.require_ros", lambda: None)
    monkeypatch.setattr(demo, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    made = tmp_path / "made"
    out = printed(capsys, "demo", "--scene", "slip", "--duration", "3", "--out", made)
    assert clock[0] == pytest.approx(103.0)
    assert f"\n  rerun {made / 'run.rrd'}\n" in out
    assert {path.name for path in made.iterdir()} >= {"recording", "analysis.json", "run.rrd", "overview.png"}
    made.rename(tmp_path / "elsewhere")
    again = printed(capsys, "plot", tmp_path / "elsewhere" / "analysis.json", "--plot", tmp_path / "again.png")
    assert again == ("analysis.json has no samples: the recording is read again\n"
                     f"picture in {tmp_path / 'again.png'}\n")
    first, last = ([line.get_xydata() for axis in drawn.axes for line in axis.lines] for drawn in figures)
    np.testing.assert_equal(last, first)
    with pytest.raises(InputError, match="a result of demo does not name its recording"):
        tcc_sim.plot(json.loads((tmp_path / "elsewhere" / "analysis.json").read_text()))
