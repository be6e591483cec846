"""Verbs of the study print the lines of results written down here, and pass on their options."""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from tcc_sim.cli import main
from tcc_sim.result import Described
from tcc_sim.shown_units import shown_in, shown_unit
from tcc_sim.study.benchmarks import peers, stability, work_precision, worst_cases
from tcc_sim.study.benchmarks.extremes import Examined
from tcc_sim.study.benchmarks.precision_report import PrecisionResult, References, SteadyState, StudiedScene
from tcc_sim.study.cli import figure
from tcc_sim.study.paper import claims, errata, figures
from tcc_sim.study.paper.catalogue import FigureOptions
from tcc_sim.study.paper.rules import Claim, Measured, holds
from tcc_sim.views import style


@pytest.fixture
def printed(capsys: pytest.CaptureFixture[str]) -> Callable[..., list[str]]:
    """Function that runs a command with a status and returns what it prints, line by line."""
    def run(status: int, *words: object) -> list[str]:
        capsys.readouterr()
        assert main([str(word) for word in words]) == status
        return capsys.readouterr().out.splitlines()

    return run


def test_claims_are_printed_as_they_are_judged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, printed: Any) -> None:
    row = Claim("4", "5", "it peaks", holds("it is"), lambda evidence: Measured(
        (evidence.pressure < 221e3,), {"x": 1.5, "list": [1, None]}, "since it is so"), "a")
    monkeypatch.setattr(claims, "CLAIMS", (row, Claim("(35)", "5", "whole", holds("it is"), lambda evidence: Measured(
        (True,), {}), "b", alone=True)))
    asked: list[Any] = []
    judge = claims.judge
    monkeypatch.setattr(claims, "judge", lambda *task, **how: asked.append(how) or judge(*task, **how))
    lines = printed(0, "claims", "--pressures", 220, 230, "--jobs", 1, "--kept", tmp_path / "kept.jsonl")
    blank = 32 * " "
    assert lines == [
        "Fig. 4           depends        it peaks", f"{blank}x: 1.5", f"{blank}list: [1, none]",
        f"{blank}the verdict changes with the mean pressure: confirmed at 220 kPa, not confirmed at 230 kPa; since it "
        "is so", "(35)             confirmed      whole", "Of 2 claims: 1 confirmed, 1 depend, 0 not confirmed"]
    assert {name: asked[0][name] for name in ("pressures", "kept", "thresholds", "jobs", "progress")} == {
        "pressures": (220e3, 230e3), "kept": tmp_path / "kept.jsonl", "thresholds": False, "jobs": 1, "progress": True}
    printed(0, "claims", "--thresholds", "--kept", tmp_path / "kept.jsonl", "--pressures", 100, 1000)
    assert asked.pop()["pressures"] == (100e3, 1000e3)
    printed(0, "claims", "--thresholds", "--kept", tmp_path / "kept.jsonl")
    assert (asked[1]["pressures"], asked[1]["thresholds"], asked[1]["jobs"]) == (claims.PRESSURES, True, None)


@pytest.mark.parametrize("ends", ["", "claims", "errata", "at once"])
def test_claims_are_written_as_far_as_they_are_judged(ends: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                      capsys: pytest.CaptureFixture[str]) -> None:
    def stop(where: str) -> str:
        if ends == where:
            raise KeyboardInterrupt
        return "the errata"

    def judged(each: Callable[[Any], None], **how: Any) -> None:
        stop("at once")
        judge(each=each, **{**how, "progress": False})
        stop("claims")

    judge = claims.judge
    monkeypatch.setattr(claims, "CLAIMS", (Claim("4", "5", "it peaks", holds("it is"), lambda evidence: Measured(
        (True,), {}), "a"),))
    monkeypatch.setattr(claims, "judge", judged)
    monkeypatch.setattr(errata, "errata_page", lambda: stop("errata"))
    files = {name: tmp_path / name for name in ("json", "markdown", "errata")}
    words = [word for name, file in files.items() for word in (f"--{name}", str(file))]
    assert main(["claims", "--jobs", "1", *words]) == (130 if ends else 0)
    out, err = capsys.readouterr()
    assert err == "tcc-sim: interrupted; the claims judged so far are kept\n" * bool(ends)
    if ends == "at once":
        assert (out, list(tmp_path.iterdir())) == ("", [])
        return
    assert out.splitlines()[0] == "Fig. 4           confirmed      it peaks"
    assert out.splitlines()[-1] == "Of 1 claims: 1 confirmed, 0 depend, 0 not confirmed"
    assert json.loads(files["json"].read_text())["complete"] is (not ends)
    assert ("Interrupted" in files["markdown"].read_text()) is bool(ends)
    assert (files["errata"].read_text() if files["errata"].exists() else "") == ("" if ends else "the errata")


class Stopped:
    """Records, after which the user interrupts."""

    def __init__(self, *records: Any, ends: bool = True) -> None:
        self.records, self.ends, self.asked = records, ends, list[Any]()

    def __call__(self, extent: Any, *done: Any) -> Iterator[Any]:
        self.asked.append(extent)
        yield from self.records
        if not self.ends:
            raise KeyboardInterrupt


@pytest.mark.usefixtures("figures")
@pytest.mark.parametrize("ends", [True, False])
def test_precision_prints_its_scenes(ends: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, printed: Any) -> None:
    scene = StudiedScene("fig02", "a scene", "smoothed", 4, References(["a", "b"], 1e-9), SteadyState(
        400, 0, None, None, []), [PrecisionResult("smoothed", 1e-9, 1e-7, 1e-7, 1e-7, None, 2e-3, 2e-3, 5)])
    study = Stopped(scene, ends=ends)
    monkeypatch.setattr(work_precision, "precision_study", study)
    monkeypatch.setattr(peers, "python_loop", lambda system: {"step": 1e-4, "rates": 1e-5})
    folder = tmp_path / "out"
    assert printed(0 if ends else 130, "precision", *["--quick"] * ends, "--out", folder) == [
        "fig02: floor 1.0e-09; 4 cycles with errors up to 1e-06: smoothed 2 ms",
        f"{folder}/precision.png, .svg, .json, .md; precision_section.png, .svg: the first scene"]
    assert study.asked == [work_precision.QUICK if ends else work_precision.FULL]
    document = json.loads((folder / "precision.json").read_text())
    assert (document["quick"], document["complete"], document["peers"]["CVODE"]) == (ends, ends, "not run")
    monkeypatch.setattr(work_precision, "precision_study", Stopped(ends=False))
    assert printed(130, "precision", "--out", tmp_path / "none") == []
    assert not (tmp_path / "none").exists()


@pytest.mark.usefixtures("figures")
@pytest.mark.parametrize("ends", [True, False])
def test_stability_prints_its_engines(ends: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                      printed: Any) -> None:
    run = Examined({"friction.law": "smoothed", "cycles": 2}, "smoothed", None, "DONE", "", False, False, 1e-6, 51, 50,
                   1e-4, 0.5)
    study = Stopped(run, Examined(run.keys, "smoothed", None, why="no"), ends=ends)
    monkeypatch.setattr(stability, "grid", study)
    monkeypatch.setattr(stability, "error_charts", lambda quick, done: [])
    monkeypatch.setattr(worst_cases, "reasons", lambda records: ["a reason"])
    folder = tmp_path / "out"
    assert printed(0 if ends else 130, "stability", *["--quick"] * ends, "--out", folder) == [
        "smoothed: 2 cases (DONE 1, REFUSED 1), 1 not finite, 1 above the energy bound, 1 above the iteration bound",
        *(f"{engine}: 0 cases (), 0 not finite, 0 above the energy bound, 0 above the iteration bound"
          for engine in ("event_driven", "fixed_step")), f"{folder}/stability.png, .svg, .json, .md"]
    assert study.asked == [ends]
    document = json.loads((folder / "stability.json").read_text())
    assert (document["quick"], document["complete"], document["reasons"]) == (ends, ends, ["a reason"] * ends)
    monkeypatch.setattr(stability, "grid", Stopped(ends=False))
    assert printed(130, "stability", "--out", tmp_path / "none") == []


class Pacing(Described):
    """Figures of a loop of 1000 ticks beside a bare one that is twice as late and never late by a period."""

    def as_json(self) -> dict[str, Any]:
        of = {"lateness_p50_s": 1e-5, "lateness_p99_s": 2e-5, "lateness_max_s": 4e-5, "late_share": 0.0123,
              "cpu_fraction": 0.25}
        bare = {f"bare_{name}": 2.0 * x if name.endswith("_s") else 0.0 for name, x in of.items()}
        trials = [{"name": name, "lateness_p50_s": 1e-6, "lateness_p99_s": 2e-6, "lateness_max_s": 3e-6, "refused": why}
                  for name, why in (("nothing asked for", []), ("all of these", ["no right", "no core"]))]
        return {"ticks": 1000, "rate": 500.0, "missed_ticks": 2, "drift_s": -1.5e-3, **of, **bare, "settings": trials}


def test_realtime_prints_both_loops(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, printed: Any) -> None:
    """The module that measures, and the nodes, need ROS 2; this one does not."""
    from tcc_sim.nodes import children

    asked: list[Any] = []
    module: Any = ModuleType("pacing_benchmark")
    module.Settings = lambda *words: words
    module.measure = lambda rate, duration, done, *more: asked.append((rate, duration, *more)) or Pacing()
    monkeypatch.setitem(sys.modules, "tcc_sim.study.benchmarks.pacing_benchmark", module)
    monkeypatch.setattr(children, "require_ros", lambda: None)
    lines = printed(0, "realtime", "--rate", 500, "--duration", 2, "--recorder", "--thread-priority", 50,
                    "--cpu-affinity", 0, 1, "--lock-memory")
    assert asked == [(500.0, 2.0, True, (50, (0, 1), True))]
    assert lines == """\
1000 ticks at 500 Hz, 1.23 % more than a period late, 2 missed, drift -1.500 ms
                       driveline node      bare loop   ratio
lateness p50 (us)                10.0           20.0    0.50
lateness p99 (us)                20.0           40.0    0.50
lateness max (us)                40.0           80.0    0.50
late by a period (%)              1.2            0.0     nan
CPU (% of a core)                25.0            0.0     nan
bare loop with               p50 (us)   p99 (us)   max (us)
nothing asked for                 1.0        2.0        3.0
all of these                      1.0        2.0        3.0  refused
  no core
  no right""".splitlines()
    (tmp_path / "r.json").touch()
    assert printed(2, "realtime", "--json", tmp_path / "r.json") == []
    printed(0, "realtime")
    printed(0, "realtime", "--rate", 1, "--duration", 0.5, "--thread-priority", 99, "--cpu-affinity", 1023)
    printed(0, "realtime", "--rate", 20000, "--duration", 1e6)
    assert asked[1:] == [(1000.0, 60.0, False, (0, (), False)), (1.0, 0.5, False, (99, (1023,), False)),
                         (20000.0, 1e6, False, (0, (), False))]


@pytest.mark.parametrize(("words", "said"), [
    (["claims", "--jobs", "0"], "jobs is 0; it must be 1 or more"), (["claims", "--pressures", "99"], "kPa"),
    (["claims", "--pressures", "1001"], "kPa"), (["realtime", "--duration", "1000001"], "s"),
    (["realtime", "--thread-priority", "-1"], "0 to 99"), (["realtime", "--cpu-affinity", "-1"], "0 to 1023"),
    (["figure", "all", "--jobs", "0"], "jobs is 0; it must be 1 or more"),
    (["figure", "4", "--jobs", "0"], "jobs is 0; it must be 1 or more"),
    *((["figure", n], f"figure is {n}; it must be 2 to 18, or all") for n in ("1", "19", "20")),
    *((["figure", n, "--branches"], f"Fig. {n} has no points on branches; --branches is for 4, 6, 8, 10, 11, 12, 13, "
      "14, 15, 16, 17, 18") for n in "23579"),
    (["figure", "nine"], "figure is 'nine'; it must be 2 to 18, or all"),
    (["figure", "7", "--direction", "up"], "direction is up; Fig. 7 has no sweep"),
    (["figure", "3", "--law", "set_valued"], "law is set_valued; Fig. 3 shows both laws"),
    (["figure", "2", "--law", "set_valued"], "law is set_valued; Fig. 2 shows both laws"),
    (["figure", "all", "--title", "a"], "--title is for one figure; leave it out with all"),
    (["realtime", "--rate", "0.5"], "Hz"), (["realtime", "--rate", "20001"], "Hz"),
    (["realtime", "--duration", "0.4"], "s"),
    (["realtime", "--thread-priority", "100"], "99"), (["realtime", "--cpu-affinity", "1024"], "1023")])
def test_wrong_words_are_refused(words: list[str], said: str, refused: Callable[..., str]) -> None:
    assert said in refused(*words)


def test_a_figure_prints_its_file_and_what_was_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                        printed: Any) -> None:
    """Of three curves one has motions that were not followed; a label without words is that of its direction."""
    behind = SimpleNamespace(left_out=["one motion was left out"])
    curves = [SimpleNamespace(label=label, direction="up", behind=motions) for label, motions in (
        (r"$\mu_k = 1$", behind), ("", behind), ("other", None))]
    asked, drawn = list[Any](), list[Any]()
    monkeypatch.setattr(figures, "figure_data", lambda number, options: asked.append((number, options)) or (
        SimpleNamespace(kind="map" if number == 4 else "law", seconds=1.26, curves=curves)))
    monkeypatch.setattr("tcc_sim.output.provenance.document", lambda *of: {"figure": of[3]})
    monkeypatch.setattr("tcc_sim.study.paper.drawings.draw", lambda data, stem, **how: drawn.append((stem, how)))
    words, file = ("figure", 4, "--out", tmp_path), tmp_path / "fig04"
    assert printed(0, *words) == [f"{file}.png  1.3 s", "  mu_k = 1: one motion was left out",
                                  "  up: one motion was left out"]
    assert [path.name for path in tmp_path.iterdir()] == ["fig04.json"]
    assert printed(2, *words) == []
    assert printed(0, *words, "--force", "--quick", "--direction", "up", "--law", "set_valued", "--branches",
                   "--jobs", 1, "--title", "a title", "--width", "column")[0] == f"{file}.png  1.3 s"
    assert asked == [(4, FigureOptions(progress=True)), (4, FigureOptions(True, "up", "set_valued", 1, True, True))]
    assert drawn == [(file, {"title": "", "width": style.PAGE}), (file, {"title": "a title", "width": style.COLUMN})]


def test_all_figures_are_drawn_in_another_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                  printed: Any) -> None:
    """Which ignores Ctrl-C; the command waits for its pictures."""
    begun, waited = list[Any](), list[Any]()

    class Painter:
        def __init__(self, count: int, context: Any, begin: Any, given: Any) -> None:
            begun.append((count, context.get_start_method(), begin, given))

        def __enter__(self) -> Any:
            return self

        def __exit__(self, *how: object) -> None:
            pass

        def submit(self, draw: Any, data: Any, stem: Path) -> Any:
            return SimpleNamespace(result=lambda: waited.append(stem.name))

    monkeypatch.setattr(figure, "ProcessPoolExecutor", Painter)
    data = SimpleNamespace(kind="law", seconds=1.0, curves=())
    monkeypatch.setattr(figures, "figure_data", lambda number, options: data)
    monkeypatch.setattr("tcc_sim.output.provenance.document", lambda *of: {"figure": of[3]})
    names = [f"fig{number:02d}" for number in range(2, 19)]
    assert printed(0, "figure", "all", "--branches", "--out", tmp_path / "new" / "all") == [
        f"{tmp_path}/new/all/{name}.png  1.0 s" for name in names]
    assert (begun, waited) == ([(1, "spawn", figure._begin_painter, (None,))], names)
    kept = signal.getsignal(signal.SIGINT)
    try:
        with shown_in(None, None):
            figure._begin_painter("rpm")
            assert (signal.getsignal(signal.SIGINT), shown_unit()[0]) == (signal.SIG_IGN, "rpm")
    finally:
        signal.signal(signal.SIGINT, kept)
