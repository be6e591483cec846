"""Options take their words, have their defaults, and verbs print the lines of results."""

from __future__ import annotations

import argparse
import math
import sys
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tcc_sim import cli
from tcc_sim.cli import analyse, arguments, demo, explain, identify, linearise, recover, simulate, sweep
from tcc_sim.cli.ranges import bounds_of_range, spaced, values_of_range
from tcc_sim.errors import InputError
from tcc_sim.scene import load_scene

PICTURE = {"width": "page"}
DEFAULTS: dict[str, tuple[list[str], dict[str, object]]] = {
    "demo": ([], {"duration": 10.0}), "scenes": ([], {}), "explain": (["a"], {"scene": "a", **PICTURE}),
    "simulate": (["a"], {"scene": "a", "solver": "auto", "samples": 200, **PICTURE}),
    "sweep": (["a"], {"scene": "a", "direction": "cold", "solver": "auto", **PICTURE}),
    "linearise": (["a"], {"scene": "a", "input": "actuation_pressure", "output": "slip_speed", **PICTURE}),
    "analyse": (["a"], {"recording": Path("a"), "band": 0.1, **PICTURE}), "recover": (["a"], {"recording": Path("a")}),
    "identify": (["a", "--free", "k"], {"measured": Path("a"), "free": ["k"], **PICTURE}), "watch": ([], {}),
    "control": (["pause"], {"action": "pause"}), "plot": (["a"], {"result": Path("a"), **PICTURE}),
    "fmu": (["a"], {"scene": "a", "fmi": 2})}


@pytest.mark.parametrize("verb", DEFAULTS)
def test_options_that_are_not_given_have_their_defaults(verb: str) -> None:
    """The dictionary leaves out values that are none, off, empty or 0."""
    words, expected = DEFAULTS[verb]
    given = vars(cli.build_parser(verb).parse_args([verb, *words]))
    given.pop("verb")
    assert {name: value for name, value in given.items() if value not in (None, False, 0, "", [])} == expected
    assert (given.get("seed", 0), given.get("check", 0), given.get("namespace", "")) == (0, 0, "")


@pytest.mark.parametrize(("words", "low", "high", "unit"), [
    (["analyse", "a", "--pulses"], 1, 10000, ""), (["simulate", "a", "--pulses"], 1, 10000, ""),
    (["demo", "--duration"], 0.5, 86400.0, " s"), (["fmu", "a", "--step"], 5e-5, 1.0, " s"),
    (["control", "torque", "1", "--rate"], 0.1, 1000.0, " Hz"),
    (["control", "pressure", "1", "--rate"], 0.1, 1000.0, " Hz")])
def test_a_number_may_be_at_both_ends_of_its_range_and_not_beyond(
        words: list[str], low: float, high: float, unit: str, capsys: pytest.CaptureFixture[str]) -> None:
    whole = isinstance(low, int)
    for bound, beyond in ((low, low - 1 if whole else math.nextafter(low, 0.0)),
                          (high, high + 1 if whole else math.nextafter(high, math.inf))):
        given = vars(cli.build_parser(words[0]).parse_args([*words, repr(bound)]))
        value = given[words[-1].removeprefix("--")]
        assert (value, type(value)) == (bound, type(low))
        for wrong in (repr(beyond), "x", "nan", *(["1.5"] if whole else [])):
            with pytest.raises(SystemExit, match="2"):
                cli.build_parser(words[0]).parse_args([*words, wrong])
            assert capsys.readouterr().err.endswith(
                f"{wrong!r} must be {'a whole number' if whole else 'a number'} from {low:g} to {high:g}{unit}\n")


def test_a_verb_is_a_module_of_its_name() -> None:
    assert {verb: cli.module_of(verb).removeprefix("tcc_sim.") for verb in cli.VERBS} == {
        **{verb: f"cli.{verb}" for verb in DEFAULTS}, "continue": "study.cli.continue_",
        **{verb: f"study.cli.{verb}" for verb in ("basins", "figure", "claims")},
        **dict.fromkeys(("precision", "stability", "realtime"), "study.cli.measuring")}
    with pytest.raises(InputError, match=r"^scene is not a verb; did you mean scenes\?$"):
        cli.arguments_of(["--x", "scene"])
    with pytest.raises(InputError, match=r"^the recorded command is none of this version: tcc-sim explain: .*required"):
        cli.arguments_of(["explain"])
    assert cli.arguments_of(["explain", "a"]).words == ["explain", "a"]


FREQUENCY = "engine.frequency"


@pytest.mark.parametrize(("text", "values"), [
    ("a=1:2:1", [1.0]), ("a=1:2:2", [1.0, 2.0]), ("a=-2:2:3", [-2.0, 0.0, 2.0]), ("a=1:16:3:log", [1.0, 4.0, 16.0]),
    ("a=-1:-16:3:log", [-1.0, -4.0, -16.0]), ("a=3", None), ("a=3,1", [3.0, 1.0]), ("a", None),
    ("a=1:2", None), ("a=1:2:3:4", None), ("a=1:2:x", None), ("a=1:2:1.5", None), ("a=1:x:2", None),
    ("a=1,x", None), ("a=1,inf", None), ("a=1:nan:3", None),
    ("a=1:2,3:4", None), (f"{FREQUENCY}=60rpm,1hz", [2.0 * math.pi, 2.0 * math.pi])])
def test_a_range_is_numbers_or_is_refused_with_its_forms(text: str, values: list[float] | None) -> None:
    if values is None:
        with pytest.raises(InputError) as caught:
            values_of_range(text)
        assert str(caught.value) == (f"--over is {text!r}; it must be KEY=START:STOP:COUNT, KEY=START:STOP:COUNT:log "
                                     "or KEY=VALUE,VALUE,...")
    elif "rpm" in text:
        with pytest.raises(InputError, match=FREQUENCY):  # Speeds of the crankshaft are those of engine.speed.
            values_of_range(text)
    else:
        key, numbers = values_of_range(text)
        assert (key, numbers) == ("a", pytest.approx(values))


def test_the_length_and_the_spacing_of_a_range_have_limits() -> None:
    assert len(spaced("1:2:1000000", "--x", False)) == 1_000_000
    for count in (0, 1_000_001, -3):
        with pytest.raises(InputError, match=rf"^--x has a count of {count}; it must be 1 to 1000000$"):
            spaced(f"1:2:{count}", "--x")
    for ends in ("0:2", "-1:2", "2:0"):
        with pytest.raises(InputError) as caught:
            spaced(f"{ends}:3", "--x")
        low, high = ends.split(":")
        assert str(caught.value) == (f"--x goes from {low} to {high}; values spaced evenly in logarithm must all be "
                                     "above 0, or all below 0")
    assert spaced("10:1000:3", "--x") == pytest.approx([10.0, 100.0, 1000.0])
    assert spaced("1hz:2hz:2", "--x", False) == pytest.approx([2.0 * math.pi, 4.0 * math.pi])
    says = "--x is '1:2'; it must be START:STOP:COUNT, two numbers and a whole number"
    assert refusal(spaced, "1:2", "--x") == says
    with pytest.raises(InputError, match=r"^--plane is 'a=1:2:3:log'; it must be KEY=START:STOP:COUNT$"):
        values_of_range("a=1:2:3:log", "--plane", even=True)
    assert bounds_of_range("a=3:-1", "--x") == ("a", -1.0, 3.0)
    for text in ("a", "a=1", "a=1:2:3", "a=1:x"):
        with pytest.raises(InputError, match=rf"^--x is '{text}'; it must be KEY=LOW:HIGH$"):
            bounds_of_range(text, "--x", "LOW:HIGH")
    with pytest.raises(InputError, match=r"^--x is 'a=1:1'; the two values must differ$"):
        bounds_of_range("a=1:1", "--x")


def refusal(function: Any, *given: Any) -> str:
    """Return the message with which a function refuses what it is given."""
    with pytest.raises((InputError, argparse.ArgumentTypeError)) as caught:
        function(*given)
    return str(caught.value)


def test_words_of_options_are_read_or_refused() -> None:
    assert arguments.joint_names("flywheel=a,clutch_plate=b") == {"flywheel": "a", "clutch_plate": "b"}
    assert arguments.joint_names("clutch_plate=b") == {"clutch_plate": "b"}
    for text in ("flywheel=", "flywheel", "wheel=a", "flywheel=a,"):
        assert refusal(arguments.joint_names, text) == f"{text!r} must be flywheel=NAME,clutch_plate=NAME"
    assert analyse.targets("-3") == -3.0
    assert analyse.targets("0:20,2.5:-30") == {0.0: 20.0, 2.5: -30.0}
    for text in ("x", "0:1,2", "0:1:2", "0:x"):
        assert refusal(analyse.targets, text) == f"{text!r} must be a slip speed in rad/s, or T:V,T:V with times in s"
    assert refusal(analyse.targets, "1:2,1.0:3") == "'1:2,1.0:3' has two targets for one time"
    assert linearise._gains("1,2.5") == (1.0, 2.5)
    for text in ("1", "1,2,3", "1,x"):
        assert refusal(linearise._gains, text) == f"--controller is {text!r}; it must be KP,KI, two numbers above 0"
    assert (identify._assigned("--free", "k"), identify._assigned("--free", "k=2")) == (("k", None), ("k", 2.0))
    assert refusal(identify._assigned, "--free", "k=") == "--free is 'k='; '' is not a number"
    assert (sweep._numbers("--q", ""), sweep._numbers("--q", "1,2")) == ((), (1.0, 2.0))
    assert refusal(sweep._numbers, "--q", "1,x") == "--q is '1,x'; it must be numbers separated by commas"
    given = argparse.Namespace(orders="100,60rpm,1hz", over=[], scatter=[])
    assert sweep._frequencies(given, 2.0) == pytest.approx((100.0, 4.0 * math.pi, 2.0 * math.pi))
    assert sweep._frequencies(argparse.Namespace(orders="", over=[], scatter=[]), 2.0) == ()
    given.scatter = ["engine.order=1:2"]
    assert refusal(sweep._frequencies, given, 2.0) == (
        "--orders has 60rpm, the speed of the crankshaft, and engine.order differs from run to run; give frequencies "
        "of the excitation in rad/s or hz")
    given.orders = "100,x"
    assert refusal(sweep._frequencies, given, 2.0) == (
        "--orders is '100,x'; it must be frequencies of the excitation, in rad/s or with hz behind, or speeds of the "
        "crankshaft with rpm behind, separated by commas")


@pytest.mark.parametrize(("words", "says"), [
    ([], "--over is given 0 times; give it once for a sweep, twice for a grid"),
    (["--over", "a=1:2:2"] * 3, "--over is given 3 times; give it once for a sweep, twice for a grid"),
    (["--over", "a=1:2:2", "--quantiles", "0.5"], "--quantiles needs --scatter KEY=LOW:HIGH"),
    (["--over", "a=1:2:2", "--every-sample"], "--every-sample needs --scatter KEY=LOW:HIGH"),
    (["--over", "a=1:2:2", "--samples", "3"], "--samples needs --scatter KEY=LOW:HIGH"),
    (["--scatter", "a=1:2"], "--scatter needs --samples N, the number of samples"),
    (["--scatter", "a=1:2", "--samples", "2", *["--over", "b=1:2:2"] * 2],
     "--over is given twice; with --scatter it can be given once"),
    (["--over", f"{FREQUENCY}=1:2:2", "--set", "engine.speed=3"],
     "--set engine.speed=3: the command itself varies engine.speed; remove one of the two"),
    (["--scatter", "a=1:2", "--samples", "2", "--set", "a=3"],
     "--set a=3: the command itself varies a; remove one of the two")])
def test_options_of_a_sweep_that_do_not_go_together(words: list[str], says: str) -> None:
    given = cli.build_parser("sweep").parse_args(["sweep", "fig02", *words])
    assert refusal(sweep._work, given, load_scene("fig02").system) == says


@pytest.mark.parametrize(("samples", "cycles", "out", "says"), [
    (1, 5e7, "a", ""), (1_000_000, 50.0, "a", ""), (1_000_000, 51.0, None, ""),
    (1_000_000, 50.1, "a", "--out would hold 5.01e+07 samples; it must be at most 5e+07"),
    (0, 1.0, None, "--samples is 0; it must be 1 to 1000000 per period of excitation"),
    (1_000_001, 1.0, None, "--samples is 1000001; it must be 1 to 1000000 per period of excitation")])
def test_samples_in_a_file_are_limited(samples: int, cycles: float, out: str | None, says: str) -> None:
    given = argparse.Namespace(samples=samples, out=out)
    if says:
        assert refusal(simulate._check_samples, given, cycles) == says
    else:
        simulate._check_samples(given, cycles)


PARAMETER = SimpleNamespace(key="driveline.stiffness", value=3030.123456, standard_error=12.345, verdict="good",
                            why="seen")
CURVE = SimpleNamespace(constant=0.12, amplitudes=[0.03], rates=[2.0], slip_speeds=np.arange(21.0),
                        coefficient=np.full(21, 0.123456), low=np.full(21, 0.1), high=np.full(21, 0.2),
                        scene=np.full(21, 0.15), visited=np.arange(21) < 15)
FIT = SimpleNamespace(measurement=SimpleNamespace(t=np.zeros(800)), noise={"slip_speed": 1.0, "plate_speed": 2.0},
                      chi2_per_dof=1.234567, starts=1, seconds=2.345678, hold=None, parameters=[PARAMETER], curve=None)


def test_the_lines_of_a_fit() -> None:
    head = "800 samples of slip_speed, plate_speed; chi-square per degree of freedom 1.235, 1 start, 2.35 s"
    row = "            driveline.stiffness  3030.12     +- 12        good: seen"
    assert list(identify._lines(FIT)) == [head, row]  # type: ignore[arg-type]
    both = list(identify._lines(SimpleNamespace(**{**vars(FIT), "hold": "smooth", "curve": CURVE})))  # type: ignore[arg-type]
    assert both == [
        head, "measured inputs fit best as linear between corners that keep the amplitudes of sines (--hold smooth)",
        row,
        "sliding friction: mu(v) = 0.12 + 0.03 exp(-2 |v|)", "      slip speed  coefficient, 95 % band",
        "         0 rad/s  0.12346, 0.10000 to 0.20000; the scene has 0.15000",
        "        10 rad/s  0.12346, 0.10000 to 0.20000; the scene has 0.15000",
        "        20 rad/s  not visited; the scene has 0.15000", "not visited: slip speeds 14 rad/s to 20 rad/s"]


LOOP = SimpleNamespace(proportional=1.0, integral=20.0, step=1e-3, stable=True, multipliers=[0.5j], phase_margin=1.0,
                       gain_margin=None, largest_delay=None, smallest_stable_slip=None)
POINT = SimpleNamespace(frequency=10.0, gain=0.0, phase=-math.pi / 2.0)
LINEAR = SimpleNamespace(kind="periodic", period=1, input="a", output="b", mean_slip=20.0, pressure=123456.789,
                         engine_torque=300.0, dt=0.0, multipliers=[0.5 + 0.25j, complex(-0.1, 1e-13)],
                         frequencies=np.arange(1.0, 9.0), gain=10.0 ** np.arange(8.0), phase=np.arange(8.0) * math.pi,
                         controller=None, checked=[])


def like(base: SimpleNamespace, **changes: Any) -> Any:
    return SimpleNamespace(**{**vars(base), **changes})


def test_the_lines_of_a_linear_model() -> None:
    rows = [f"{f'{k + 1} rad/s':>16}  {20 * k:9.3f} dB  {180.0 * k:8.2f} deg" for k in (0, 1, 2, 4, 5, 6, 7)]
    lines = list(linearise._lines(LINEAR))  # type: ignore[arg-type]
    assert lines == ["from a to b about a periodic motion of 1 period of excitation: mean slip 20 rad/s, pressure "
                     "123456.79 Pa, engine torque 300 N m", "A, B, C, D are continuous",
                     "multipliers 0.5+0.25i, -0.1", *rows]
    more = list(linearise._lines(like(LINEAR, kind="slip", dt=0.0418879, controller=LOOP, checked=[POINT])))
    assert more[0].startswith("from a to b about constant slip: mean slip")
    assert more[1] == "A, B, C, D are discrete with dt 0.0418879 s, one period; the output is the mean over a period"
    assert more[-1] == "simulated at 10 rad/s        -inf dB    -90.00 deg"
    head = ("closed loop with 1 N m s/rad and 20 N m/rad, a command every 1 ms: {}, largest multiplier 0.5")
    margins = ["  phase margin 57.3 deg", "  gain margin above a factor of 1000", "  stable at every tested delay",
               "  stable down to a tenth of the mean slip speed"]
    assert more[10:-1] == list(linearise._loop_lines(LOOP)) == [head.format("stable"), *margins]  # type: ignore[arg-type]
    limited = like(LOOP, gain_margin=2.5, largest_delay=0.0125, smallest_stable_slip=3.25, phase_margin=None)
    assert list(linearise._loop_lines(limited))[1:] == [
        "  gain margin a factor of 2.5", "  unstable from a delay of 12.5 ms on",
        "  stable down to a mean slip speed of 3.25 rad/s"]
    assert list(linearise._loop_lines(like(limited, stable=False))) == [head.format("unstable")]


STEP = {"tick_s": 1e-3, "sub_steps": 33, "own_calls": {"sines": 6.0}, "general_calls": {"sines": 9.12345},
        "own_s": 4e-6, "general_s": 6e-6, "ratio": 1.5, "terms_s": {"sine": 1e-6}, "saved_s": {"other": None},
        "noise_s": 5e-8}


def test_the_lines_of_a_tick(capsys: pytest.CaptureFixture[str]) -> None:
    explain._say_step(STEP, True)
    assert capsys.readouterr().out.splitlines() == [
        "real-time step: 33 sub-steps in a tick of 1 ms",
        "  run time of a tick: 4.00 us; with all terms 6.00 us, 1.50 times as long", "  sine takes 1.00 us, 25 %",
        "  other is left out and saves less than the noise", "  noise of these times: 0.05 us",
        "  sines per sub-step: 6; with all terms 9.12"]
    explain._say_step(STEP, False)
    assert len(capsys.readouterr().out.splitlines()) == 2
    explain._say_step(None, True)
    assert capsys.readouterr().out == "real-time step: none; the real-time solver needs friction.law smoothed\n"


@pytest.mark.parametrize(("topics", "missing", "complete", "lines"), [
    (2, [], True, ["  topic 0: 1", "  topic 1: 1", "  nothing is missing; the original was complete"]),
    (1, [], False, ["  topic 0: 1", "  nothing is missing"]),
    (1, ["a chunk"], True, ["  topic 0: 1", "  note: a chunk"]),
    (101, ["x"], False, [*(f"  topic {k}: 1" for k in range(100)), "  and 1 more topic", "  note: x"]),
    (100, ["x"], False, [*(f"  topic {k}: 1" for k in range(100)), "  note: x"])])
def test_the_lines_of_a_recovery(topics: int, missing: list[str], complete: bool, lines: list[str],
                                 monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    result = SimpleNamespace(messages={f"topic {k}": 1 for k in range(topics)}, directory="it", missing=missing,
                             complete=complete)
    monkeypatch.setattr("tcc_sim.recording.reader.open_run", lambda path: path)
    monkeypatch.setattr("tcc_sim.recording.recovery.recover", lambda run, out: result if out == Path("it") else None)
    assert recover.run(argparse.Namespace(recording=Path("a"), out=Path("it"))) == 0
    noun = "message" if topics == 1 else "messages"
    assert capsys.readouterr().out.splitlines() == [f"recovered {topics} {noun} into it", *lines]


def test_a_demo_has_a_controller_where_the_pressure_alone_is_commanded(refused: Any) -> None:
    scene = load_scene("controlled").with_values({"rate": 500.0})
    assert demo.controller_of(scene) == {"target": 20.0, "frequency": 150.0, "inertia": 0.2, "step": 0.002,
                                         "torque_per_pressure": scene.system.torque_per_pressure}
    assert demo.controller_of(load_scene("fig02")) is demo.controller_of(load_scene("commands")) is None
    assert demo._words("sh -c 'a b'", scene) == ["sh", "-c", "a b"]
    assert refusal(demo._words, "sh 'a", scene) == "--controller \"sh 'a\": no closing quotation"
    assert refusal(demo._words, "", scene) == "--controller '': there is no program ''"
    assert refusal(demo._words, "no_such a", scene) == "--controller 'no_such a': there is no program 'no_such'"
    assert refusal(demo._words, "sh", load_scene("fig02")) == (
        "scene fig02 takes no commands: engine.source and pressure.source are harmonic; --controller needs topic for "
        "one of them, as in scene controlled")


def test_a_plan_has_the_options_of_its_command() -> None:
    options = {"cycles": 9, "duration": None, "solver": "rk4", "rtol": None, "step": 1e-3, "damping": True,
               "lyapunov": False}
    for discard, kept in ((None, None), ("auto", "auto"), ("7", 7)):
        plan = arguments.plan_of(argparse.Namespace(discard=discard, **options), direction="up")
        assert {name: getattr(plan, name) for name in options} == options
        assert (plan.discard, plan.direction) == (kept, "up")
    assert refusal(arguments.plan_of, argparse.Namespace(discard="1.5", **options)) == (
        "--discard is '1.5'; it must be a number of cycles or auto")


def test_files_of_a_command_are_checked_before_it_computes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old").write_text("mine")

    def check(suffixes: tuple[str, ...] = (), *more: Path, **given: Any) -> None:
        arguments.check_outputs(argparse.Namespace(**{"json": None, "out": None, "plot": None, "force": False,
                                                      "width": "page", **given}), suffixes, *more)

    check((".csv",), json=Path("-"), out=Path("a.csv"), plot=Path("a.png"))
    for name, given in (("distributed", {"dask": "x"}), ("pyarrow", {"out": Path("a.parquet")})):
        with monkeypatch.context() as patch:
            asked: list[str] = []
            patch.setattr(arguments, "require", lambda *what, asked=asked: asked.append(what[0]))
            check((".parquet",), **given)
            assert asked == [name]
    check((), Path("old"), force=True)
    check(out=Path("old"))  # The verb itself checks an --out without suffixes.
    for given, says in (({"json": Path("old")}, "old exists; it is not overwritten"),
                        ({"out": Path("a.txt")}, "--out a.txt must end in .csv"),
                        ({"plot": Path("a.gif")}, "--plot a.gif must end in .png, .svg or .pdf"),
                        ({"json": Path("a.csv"), "out": tmp_path / "a.csv"},
                         f"two options name the file {tmp_path / 'a.csv'}"),
                        ({"json": Path("no/a")}, "no/a: there is no directory no"),
                        ({"json": tmp_path}, f"{tmp_path} is a directory; name a file")):
        with pytest.raises(InputError) as caught:
            check((".csv",), **given)
        assert str(caught.value) == says
    with pytest.raises(InputError, match="two options name the file b"):
        check((), Path("b"), json=Path("b"))


def test_a_result_is_printed_unless_its_json_is(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    given = argparse.Namespace(json=None, verb="explain", words=["explain", "a"])
    for json, lines, out in ((None, ["a", "b"], "a\nb\n"), (None, [], ""), (tmp_path / "a.json", ["a"], "a\n")):
        given.json = json
        arguments.present(given, load_scene("fig02"), {"x": 1}, lines)
        assert capsys.readouterr().out == out
    given.json = Path("-")
    arguments.present(given, load_scene("fig02"), {"x": 1}, ["a"])
    printed = capsys.readouterr().out
    assert printed == (tmp_path / "a.json").read_text()
    assert '\n "command": [\n  "explain",\n  "a"\n ],' in printed
    given.joints, given.topic, given.driveline = {"flywheel": "a"}, None, 0
    assert refusal(arguments.refuse_driveline, given, "why") == "--joints, --driveline: only for recordings; why"
    given.joints = given.driveline = None
    arguments.refuse_driveline(given, "why")


@pytest.mark.parametrize(("words", "name", "controller", "commanded"), [
    ([], "commands", None, True), (["--controller", "sh -c x"], "controlled", ["sh", "-c", "x"], False),
    (["--scene", "fig02"], "fig02", None, False), (["--scene", "commands"], "commands", None, False),
    (["--scene", "controlled"], "controlled", {"target": 20.0}, False)])
def test_a_demo_runs_the_scene_for_its_controller(words: list[str], name: str, controller: Any, commanded: bool,
                                                  tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rclpy", reason="rclpy is not installed")
    made = tmp_path / "made"
    seen: list[Any] = []
    monkeypatch.setattr("tcc_sim.nodes.children.require_ros", lambda: None)
    monkeypatch.setattr(demo, "_record", lambda scene, *more, **named: seen.extend((*more, named)))
    monkeypatch.setattr(demo, "_analyse", lambda scene, recording, directory, missing, words: len(missing))
    assert cli.main(["demo", *words, "--duration", "3", "--out", str(made)]) == 0
    if isinstance(controller, dict):
        seen[3] = {"target": seen[3]["target"]}
    assert seen == [name, made / "recording", 3.0, controller, {"commanded": commanded}]
    assert made.is_dir()


class Nodes:
    """Stand-ins for the processes of a demo and for its clock; the last step ends by Ctrl-C if `stopped`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, stopped: bool) -> None:
        self.now, self.told, self.stopped = 100.0, [], stopped
        monkeypatch.setattr("tcc_sim.nodes.children.Session", self.session)
        monkeypatch.setattr("tcc_sim.nodes.children.NodeProcess", self.sender)
        monkeypatch.setattr(demo, "time", SimpleNamespace(monotonic=lambda: self.now))

    def session(self, *given: Any) -> Any:
        self.told.append(given)
        return SimpleNamespace(environment={"A": "b"}, watch=self.watch, stop=lambda: self.told.append("stop"))

    def watch(self, seconds: float) -> None:
        self.told.append(round(seconds, 6))
        self.now += seconds
        if self.stopped and self.now > 100.15:
            raise KeyboardInterrupt

    def sender(self, *given: Any) -> Any:
        self.told.append(given)
        return SimpleNamespace(check=lambda: self.told.append("check"), stop=lambda: self.told.append("no more"),
                               await_line=lambda text: self.told.append("ready"))


@pytest.mark.parametrize(("controller", "commanded", "stopped", "lines"), [
    (None, True, False, ["commander: publishes engine_torque and actuation_pressure at the driveline's rate"]),
    (["sh", "-c", "a b"], False, False, ["controller: sh -c 'a b'"]),
    ({"target": 20.0}, False, True, ["slip controller: holds a mean slip speed of 20 rad/s"])])
def test_a_demo_watches_its_nodes_ten_times_a_second(controller: Any, commanded: bool, stopped: bool,
                                                     lines: list[str], monkeypatch: pytest.MonkeyPatch,
                                                     capsys: pytest.CaptureFixture[str]) -> None:
    scene, nodes = load_scene("fig02"), Nodes(monkeypatch, stopped)
    demo._record(scene, "fig02", Path("r"), 0.25, controller, commanded=commanded)
    check = ["check"] * commanded
    assert nodes.told == [
        (Path("r"), {"scene": "fig02"}, controller),
        *([("commander", {"rate": 1000.0}, {"A": "b"}), "ready"] * commanded),
        0.1, *check, 0.1, *check, *([] if stopped else [0.05, *check]), *(["no more"] * commanded), "stop"]
    head, more = [f"scene fig02: {scene.description}"], ["recording 0.25 s to r"]
    said = capsys.readouterr().out.splitlines()
    assert said == [*head, *(more + lines if commanded else lines + more),
                    *["stopped early; the recording up to here is analysed"] * stopped]


@pytest.mark.parametrize(("folder", "compiler", "words", "held"), [
    ("linux64", "cc", [], "sources in C99 and a binary for linux64"),
    ("", "cc", [], "sources in C99; importers compile them"),
    ("", None, ["--sources-only"], "sources in C99; importers compile them"),
    ("", None, [], "sources in C99; no C compiler was found here, so importers compile them")])
def test_an_fmu_says_what_is_in_it(folder: str, compiler: str | None, words: list[str], held: str, tmp_path: Path,
                                   monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    given: list[Any] = []
    exports = import_module("tcc_sim.fmu.export")
    monkeypatch.setattr(exports, "export", lambda *more, **named: given.append((more[1:], named)) or folder)
    monkeypatch.setattr(exports, "compiler", lambda: compiler)
    assert cli.main(["fmu", "slip", "--fmi", "3", "--step", "0.002", "--out", str(tmp_path / "a.fmu"), *words]) == 0
    assert given == [((tmp_path / "a.fmu", 3, 0.002), {"sources_only": bool(words)})]
    assert capsys.readouterr().out == f"{tmp_path / 'a.fmu'}: FMI 3.0 for co-simulation, {held}\n"


@pytest.mark.parametrize(("missing", "line"), [
    (["rerun"], "rerun not installed: no run.rrd; to get both: pip install 'tcc_sim[view]'\n"),
    (["matplotlib"], "matplotlib not installed: no overview.png; to get both: pip install 'tcc_sim[view]'\n"),
    (["rerun", "matplotlib"], "rerun and matplotlib not installed: no run.rrd and no overview.png; to get both: pip "
     "install 'tcc_sim[view]'\n")])
def test_a_demo_names_what_it_cannot_make(missing: list[str], line: str, tmp_path: Path,
                                          monkeypatch: pytest.MonkeyPatch,
                                          capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("tcc_sim.nodes.children.require_ros", lambda: None)
    monkeypatch.setattr(demo, "_record", lambda *_, **__: None)
    monkeypatch.setattr(demo, "_analyse", lambda scene, recording, directory, lacking, words: lacking != missing)
    monkeypatch.setattr(demo.importlib.util, "find_spec", lambda name: None if name in missing else name)
    assert cli.main(["demo", "--out", str(tmp_path / "made")]) == 0
    assert capsys.readouterr().out == line


@pytest.mark.parametrize(("words", "asked", "out"), [
    (["pause"], ("serve", "pause"), "done"), (["set", "rate=500", "pressure.mean=2.5"],
                                             ("change", {"rate": 500, "pressure.mean": 2.5}), "done"),
    (["get", "engine.frequency", "rate", "scene"], ("values", ["engine.frequency", "rate", "scene"]),
     "engine.frequency 1 rad/s\nrate 2 Hz\nscene 3"),
    (["torque", "-5"], ("command", "torque", -5.0, 0.0), "done"),
    (["pressure", "1e5", "--rate", "10"], ("command", "pressure", 1e5, 10.0),
     "interrupted; no more commands are sent")])
def test_a_request_is_sent_as_it_was_given(words: list[str], asked: tuple[Any, ...], out: str,
                                           monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    seen: list[Any] = []

    def command(*given: Any, tell: Any) -> str:
        seen.append(("command", *given))
        if given[-1]:
            raise KeyboardInterrupt
        return "done"

    def answered(name: str, answer: Any) -> Any:
        return lambda given: seen.append((name, given)) or answer

    ask = SimpleNamespace(serve=answered("serve", "done"), change=answered("change", "done"), command=command,
                          values=answered("values", {"engine.frequency": 1, "rate": 2, "scene": 3}))
    monkeypatch.setattr("tcc_sim.nodes.children.require_ros", lambda: None)
    monkeypatch.setitem(sys.modules, "tcc_sim.nodes.operator", SimpleNamespace(
        operator=lambda namespace: nullcontext(seen.append(namespace) or ask)))
    assert cli.main(["control", *words, "--namespace", "/a"]) == 0
    assert (seen, capsys.readouterr().out) == (["/a", asked], f"{out}\n")


def test_a_watch_overwrites_no_file_and_starts_a_viewer_where_nothing_else_is_given(
        refused: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rclpy", reason="rclpy is not installed")
    seen: list[dict[str, Any]] = []
    monkeypatch.setattr("tcc_sim.nodes.children.require_ros", lambda: None)
    monkeypatch.setattr("tcc_sim.nodes.watcher.watch", lambda namespace, tell, **named: seen.append(named) or "done")
    (tmp_path / "old.rrd").write_text("mine")
    assert "old.rrd exists; it is not overwritten" in refused("watch", "--rrd", tmp_path / "old.rrd")
    monkeypatch.setattr("tcc_sim.cli.watch.signal.signal", lambda *_: None)
    monkeypatch.setattr("tcc_sim.nodes.web_viewer.web_viewer", lambda: nullcontext(SimpleNamespace(
        page="http://page", url="rerun+http://web")))
    assert cli.main(["watch", "--web"]) == 0
    assert seen == [{"web": True, "file": None, "spawn": False, "url": "rerun+http://web"}]
    for words, file, spawn, url in (([], None, True, None), (["--rrd", "new.rrd"], Path("new.rrd"), False, None),
                                    (["--connect", "rerun+http://x"], None, False, "rerun+http://x")):
        assert cli.main(["watch", *words]) == 0
        assert seen[-1] == {"web": False, "file": file, "spawn": spawn, "url": url}
