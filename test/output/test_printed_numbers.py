"""Every number that a verb prints is in its JSON, within its digits and in its unit."""

import json
import math
import re

import numpy as np
import pytest
from driveline_bags import bag, ticked

from tcc_sim.cli import main
from tcc_sim.scene import load_scene

EQUATION = r"\(\d+[a-c]?\)"
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\w)")
UNITS = {"rpm": (30.0 / math.pi,), "Hz": (0.5 / math.pi, 1.0), "%": (100.0, 1.0), "ms": (1e3,), "us": (1e6,),
         **dict.fromkeys(("deg", "degrees"), (180.0 / math.pi,)),
         **dict.fromkeys(("rad", "rad/s", "s", "N", "Pa", "J", "W", "dB"), (1.0,))}
"""Factors of what a JSON keeps by the unit behind a number; Hz and % are also kept, in texts."""
STEPS = r"\d+ (?:steps|ticks)\b"
"""Amounts of work, which only a terminal shows."""
CONSTANT = ["--set", "pressure.amplitude=0"]
DAMPED = ["--set", "driveline.damping=20"]
SWEPT = ["--over", "engine.frequency=100:140:2", "--cycles", "20"]
SCATTER = ["--scatter", "pressure.mean=22e4:26e4", "--samples", "4"]
LAGGED = ["--set", "pressure.time_constant=0.03", "--set", "pressure.delay=0.005", "--set", "pressure.rate_limit=2e6"]


def numbers(text):
    """Numbers of a text that stand by themselves, as they are written, each with the word behind it."""
    for each in NUMBER.finditer(text):
        yield each.group(), re.match(r"[ ]?(%|[a-zA-Z]+(?:/[a-z]+)?)?", text[each.end():]).group(1)


def kept_in(values):
    """All numbers of a JSON, those within its texts, lengths of its lists, and magnitudes of complex pairs."""
    if isinstance(values, str):
        yield from (float(number) for number, _ in numbers(values))
    elif isinstance(values, dict | list):
        each = values.values() if isinstance(values, dict) else values
        if isinstance(values, list):
            yield float(len(values))
            if len(values) == 2 and all(isinstance(one, float) for one in values):
                yield math.hypot(*values)
        for one in each:
            yield from kept_in(one)
    elif isinstance(values, int | float) and not isinstance(values, bool):
        yield float(values)


def unknown(text, kept, unit):
    """The numbers of a text that are not kept, with their lines; without a unit behind it a number may be in `unit`."""
    for line in text.splitlines():
        for number, behind in numbers(re.sub(EQUATION, " ", line)):
            mantissa, _, power = number.partition("e")
            half = 0.50001 * 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
            factors = UNITS.get(behind, (1.0, *UNITS.get(unit, ())))
            if not any(abs(abs(float(number)) - abs(value * factor)) <= half + 1e-9 * abs(value * factor)
                       for value in kept for factor in factors):
                yield number, line


def agrees(words, capsys, tmp_path, table=False, more_columns=()):
    """Fail for a number that a verb prints and does not keep."""
    path = tmp_path / "a.json"
    assert main([*words, "--json", str(path)]) == 0
    if table:
        assert main(words) == 0
    printed = re.sub(r"\d+ of \d+ values in .*", "", capsys.readouterr().out)
    document = json.loads(path.read_text())
    kept = [*kept_in(document), *more_columns]
    gains = document.get("gain", []) + [point["gain"] for point in document.get("checked", [])]
    kept += [20.0 * math.log10(gain) for gain in gains]
    unit = words[words.index("--units") + 1] if "--units" in words else None
    shown = re.sub(STEPS, "", printed)
    assert len(list(numbers(shown))) > 5
    assert not re.search(r"\b(nan|None)\b", shown)
    assert list(unknown(shown, kept, {"rpm": "rpm", "hz": "Hz"}.get(unit))) == []


@pytest.mark.parametrize("words", [
    ["explain", "fig02"], ["explain", "slip"], ["explain", "runup"], ["explain", "controlled", *LAGGED],
    ["explain", "fig02", "--units", "rpm"], ["simulate", "fig02", "--cycles", "60", "--damping"],
    ["simulate", "slip", "--cycles", "20", "--spectrum", "--units", "rpm"],
    ["simulate", "minimal", "--duration", "0.9", "--orders", "--spectrum", "--units", "hz"],
    ["simulate", "apply"], ["simulate", "minimal", "--cycles", "30", "--lyapunov"],
    ["linearise", "controlled", "--mean", "--slip", "20", "--frequencies", "200:300:3", "--controller",
     "1,20"],
    ["linearise", "slip", "--frequencies", "10:20:2", "--units", "rpm"],
    ["continue", "fig02", *CONSTANT, "--over", "friction.kinetic_coefficient=0.23:0.25", "--at", "0.24"],
    ["continue", "fig02", "--set", "friction.law=set_valued", "--over", "engine.frequency=140:160", "--units", "rpm"]],
    ids=lambda words: " ".join(words[:2] + words[-1:]))
def test_a_verb_prints_what_its_json_keeps(words, capsys, tmp_path):
    agrees(words, capsys, tmp_path)


@pytest.mark.parametrize("words", [[*SWEPT, "--damping"], [*SWEPT, "--units", "rpm"], [*SCATTER, "--cycles", "20"],
                                   [*SCATTER, *SWEPT, "--units", "hz"],
                                   [*SWEPT, "--over", "pressure.mean=24e4:26e4:2", "--units", "hz"]],
                         ids=["damping", "rpm", "scatter", "scatter in Hz", "grid in Hz"])
def test_the_table_of_a_sweep_is_its_json(words, capsys, tmp_path):
    agrees(["sweep", "fig02", *words], capsys, tmp_path, table=True)


def test_basins_print_what_their_json_keeps(capsys, tmp_path):
    words = ["basins", "fig02", *CONSTANT, *DAMPED, "--plane", "initial.slip_speed=0:300:3", "--plane",
             "initial.plate_angle=0:0.2:2"]
    assert main([*words, "--out", str(tmp_path / "a.npz")]) == 0
    capsys.readouterr()
    with np.load(tmp_path / "a.npz") as arrays:
        agrees(words, capsys, tmp_path, more_columns=(arrays["cycles"].size, arrays["cycles"].mean()))


def test_a_recording_and_a_fit_print_what_their_json_keeps(capsys, tmp_path):
    run = str(bag(tmp_path / "run", ticked(load_scene("fig02"), 800), "fig02"))
    options = ["--discard", "5", "--damping", "--verify", "--target", "8", "--orders", "--spectrum"]
    agrees(["analyse", run, *options], capsys, tmp_path)
    (tmp_path / "a.json").unlink()
    agrees(["identify", run, "--free", "friction.kinetic_coefficient"], capsys, tmp_path, more_columns=(800,))
