"""Friction by a table: every engine against SciPy on the fitted law, its derivatives, and closed properties."""

from __future__ import annotations

import dataclasses
import errno
import itertools
import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from differences import apart
from independent import Piecewise, smoothed_states

from tcc_sim import cli
from tcc_sim.errors import InputError
from tcc_sim.model.groups import Friction
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.output.explanation import friction_lines, friction_of
from tcc_sim.scene import load_scene, parse_assignments, parse_scene
from tcc_sim.solvers import law, series, solve
from tcc_sim.solvers.key_derivatives import BREAKAWAY, CURVE, DECAYS, EXCESSES, LOAD_AMPLITUDE, MEAN_LOAD, SMOOTHING
from tcc_sim.solvers.key_derivatives import key_derivatives as by_keys
from tcc_sim.solvers.stroboscopic import stroboscopic_map
from tcc_sim.solvers.terms import terms_of
from tcc_sim.trajectory import State

SPEEDS = tuple(map(float, np.round(np.linspace(0.0, 1.0, 25) ** 2 * 60.0, 6)))
SHAPES = {
    "rising": lambda v: 0.11 + 0.006 * np.log1p(v),
    "falling": lambda v: 0.15 - 0.008 * np.log1p(v / 0.5),
    "single": lambda v: 0.14 - 0.02 * np.exp(-0.5 * v),
    "dip": lambda v: 0.14 * (1.0 - 0.12 * np.exp(-0.05 * v)) + 0.02 * np.exp(-1.5 * v),
}
SIZES = np.array([10.0, 0.1, 10.0])


def scene(shape: str, seed: int, **changes: object) -> System:
    """A scene with a table and random numbers; the load of every fourth one is clamped."""
    draw = np.random.default_rng(seed)
    pressure = float(draw.uniform(300e3, 600e3))
    table = tuple(float(x) for x in SHAPES[shape](np.array(SPEEDS)))
    return replace(System(), {
        "friction.slip_speeds": SPEEDS, "friction.coefficients": table,
        "friction.smoothing": float(10.0 ** draw.uniform(math.log10(50.0), 5.0)),
        "engine.frequency": float(draw.uniform(100.0, 200.0)), "engine.mean_torque": float(draw.uniform(150.0, 300.0)),
        "pressure.mean": pressure, "pressure.amplitude": pressure * (1.3 if seed % 4 == 0 else 0.2),
        "pressure.phase": float(draw.uniform(0.0, 6.0)), "driveline.damping": float(draw.uniform(0.5, 3.0)), **changes})


def test_the_smoothed_motion_of_three_exponentials_is_that_of_lsoda() -> None:
    system = scene("falling", 0)
    assert len(system.friction.curve.rates) == 3
    result, i = solve(system, cycles=3, samples_per_cycle=8, rtol=1e-12), system.initial
    states = smoothed_states(system, [i.slip_speed, i.plate_angle, i.plate_speed, 0.0], 3, 8)
    computed = np.column_stack([result.slip_speed, result.plate_angle, result.plate_speed])
    assert np.abs((computed - states[:, :3]) / SIZES).max() < 1e-8
    ticks = solve(system, solver="fixed_step", cycles=1, samples_per_cycle=8, step=1e-5)
    assert np.abs(ticks.slip_speed - result.slip_speed[:9]).max() < 1e-5 * np.abs(result.slip_speed).max()


@pytest.mark.parametrize("shape", ["falling", "steep"])
def test_the_set_valued_motion_is_that_of_filippov(shape: str) -> None:
    """An exponential that died long before slip comes down again counts from its own slip speed on."""
    steep = 0.14 + 0.02 * np.exp(np.outer([-8.0, -0.4, -0.05], SPEEDS)).sum(axis=0)
    settings = {"friction.coefficients": tuple(steep.tolist()), "initial.slip_speed": 60.0} if shape == "steep" else {}
    system = scene("falling", 6, **{"friction.law": "set_valued", **settings})
    assert len(system.friction.curve.rates) == 3
    run = solve(system, cycles=3, samples_per_cycle=8, rtol=1e-11)
    states = Piecewise(system).run(float(run.t[-1]), np.array(run.t))[0]
    motion = np.column_stack([run.slip_speed, run.plate_angle, run.plate_speed])
    assert np.abs((motion - states[:, :3]) / SIZES).max() < 1e-9


def fitted(system: System, key: str, change: float) -> System:
    """The system with one number of its fit changed by a part of itself."""
    curve = system.friction.curve
    name, _, number = key.removeprefix(CURVE).partition("_")
    if name == "constant":
        curve = dataclasses.replace(curve, constant=curve.constant * (1.0 + change))
    else:
        numbers = list(getattr(curve, f"{name}s"))
        numbers[int(number) - 1] *= 1.0 + change
        curve = dataclasses.replace(curve, **{f"{name}s": tuple(numbers)})
    friction = type("Fitted", (Friction,), {"curve": curve})(**vars(system.friction))
    return dataclasses.replace(system, friction=friction)


def moved(system: System, key: str, change: float) -> System:
    if key.startswith(CURVE):
        return fitted(system, key, change)
    return replace(system, {key: float(dict(values_of(system))[key]) * (1.0 + change)})


def value_of(system: System, key: str) -> float:
    curve = system.friction.curve
    if not key.startswith(CURVE) or curve is None:
        return float(dict(values_of(system))[key])
    name, _, number = key.removeprefix(CURVE).partition("_")
    return curve.constant if name == "constant" else float(getattr(curve, f"{name}s")[int(number) - 1])


FIT = tuple(f"{CURVE}{name}" for name in ("constant", "amplitude_1", "rate_1"))


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
def test_derivatives_are_those_of_differences(law: str) -> None:
    """By the state before two cycles, whose eigenvalues are Floquet's multipliers, by keys, and by the table's fit.

    The kernels are those of a law without a table; `test_law_changes` has more exponentials.
    """
    smoothing = {} if law == "set_valued" else {"friction.smoothing": 200.0}
    system, start = scene("single", 1, **{"friction.law": law, **smoothing}), np.array([3.0, 0.1, 2.0])
    keys = ("pressure.mean", "engine.frequency", "driveline.stiffness", *smoothing)

    def end(of: System, x: np.ndarray) -> np.ndarray:
        cycles = solve(of, cycles=2, state=State(*map(float, x)), rtol=1e-12).cycles
        return cycles.section[-1]

    image = stroboscopic_map(system, start, 2, parameters=keys + FIT)
    if law == "set_valued":  # Without numbers of the fit another kernel does less.
        fewer = stroboscopic_map(system, start, 2, parameters=keys)
        assert fewer.derivatives == pytest.approx(image.derivatives[:, :3 + len(keys)], rel=1e-8, abs=1e-10)
    for k, step in enumerate((1e-3, 1e-5, 1e-3)):
        unit = np.eye(3)[k] * step
        assert apart(1e-6, image.derivative[:, k] * step, lambda d, u=unit: end(system, start + d * u), 1.0, SIZES,
                     1e-4 * step / SIZES[k]) < 1e-6, k
    for k, key in enumerate(keys + FIT):
        assert apart(1e-6, image.by_parameter[:, k] * 1e-5 * value_of(system, key), lambda d, key=key:
                     end(moved(system, key, 1e-5 * d), start), 1.0, SIZES, 1e-7) < 1e-6, key

PAIRS = ((0.5, 0.4), (0.5, 0.4, -0.2, 1.3), (0.5, 0.4, -0.2, 1.3, 0.3, 3.0))
"""Amplitudes and rates in turn of one, two and three exponentials."""


class Rows(np.ndarray):
    """Rows of numbers that staged functions set."""

    def set_row(self, row: np.ndarray, k: int) -> None:
        self[k] = row


@pytest.mark.parametrize("stribeck", PAIRS, ids=len)
def test_the_law_has_the_derivatives_of_its_formula_at_a_slip_speed_and_along_a_motion(stribeck) -> None:
    """By slip speed, smoothing factor, amplitudes and rates: complex steps of (1 + sum c exp(-a |v|)) tanh(s v), along
    v = side (0.7 + 0.4 x - 0.2 x^2) under a load of 3 + x as a series at x = 0.3.
    """
    column = {number: cause for cause, number in law.numbers_of(stribeck).items()}
    pairs = list(itertools.chain(*zip(EXCESSES, DECAYS)))[:len(stribeck)]
    causes = [law.OF_SLIP, *(column[number] for number in (SMOOTHING, *pairs))]

    def by(numbers, side, smooth):
        v, sigma, *pairs = numbers
        slid = 1.0 + sum(c * np.exp(-a * side * v) for c, a in zip(pairs[::2], pairs[1::2]))
        return slid * np.tanh(sigma * v) if smooth else slid * side

    for side, smooth in itertools.product((1.0, -1.0), (True, False)):
        x = 0.3
        v = side * (0.7 + 0.4 * x - 0.2 * x * x)
        numbers = np.array([v, 1.6, *stribeck], complex)
        exact = [by(numbers + 1e-30j * unit, side, smooth).imag / 1e-30 for unit in np.eye(len(numbers))]
        value = by(numbers, side, smooth).real
        if smooth:
            found = law.mubar_at(v, side, 1.6, stribeck)
            assert (found.value, *(found.change[cause] for cause in causes)) == pytest.approx((value, *exact))
        elif side > 0.0:
            assert law.sliding_at(v, stribeck) == (pytest.approx(value), pytest.approx(exact[2:]))
        rows, count = np.zeros((6, series.FRICTION_ORDER_MAXIMUM)), series.FRICTION_ORDER_MAXIMUM
        rows[series.SLIP, :3], rows[series.LOAD, :2] = side * np.array([0.7, 0.4, -0.2]), (3.0, 1.0)
        coefficients, filled = np.zeros(count), np.zeros((count, law.WIDE)).view(Rows)
        for _ in law.law_along(rows, coefficients, filled, True, side, True, stribeck, 1.6 if smooth else None):
            pass
        along = np.asarray(filled).T @ x ** np.arange(count)
        assert coefficients @ x ** np.arange(count) == pytest.approx(value, rel=1e-6)
        exact = (3.0 + x) * np.array([value, *exact])
        assert along[[law.FRICTION, *causes]] == pytest.approx(exact, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize(("shape", "count"), [("single", 1), ("dip", 2), ("falling", 3)])
def test_numbers_of_the_equations_have_their_derivatives_by_every_number_of_a_fit(shape: str, count: int) -> None:
    system = scene(shape, 1)
    assert len(system.friction.curve.rates) == count
    keys = [f"{CURVE}constant", *(f"{CURVE}{name}_{j + 1}" for name in ("amplitude", "rate") for j in range(count))]
    of = [MEAN_LOAD, LOAD_AMPLITUDE, BREAKAWAY, *itertools.chain(*zip(EXCESSES[:count], DECAYS[:count]))]

    def numbers(key: str, change: float) -> np.ndarray:
        terms = terms_of(fitted(system, key, change))
        return np.array([terms.mean_load, terms.pulsation[0], 1.0 + sum(terms.stribeck[::2]), *terms.stribeck])

    for key, found in zip(keys, by_keys(system, keys).T):
        slope = (numbers(key, 1e-6) - numbers(key, -1e-6)) / (2e-6 * value_of(system, key))
        np.testing.assert_allclose(found[of], slope, rtol=1e-6, atol=1e-8 * np.abs(slope).max())
        assert np.count_nonzero(found) == np.count_nonzero(found[of])


def test_a_table_takes_the_place_of_the_coefficients() -> None:
    system = scene("dip", 1)
    assert system.friction_ratio == pytest.approx(0.1432 / 0.14, rel=1e-9)
    for key in ("friction.static_coefficient", "friction.kinetic_coefficient", "friction.decay"):
        with pytest.raises(InputError, match=f"{key} is not used where friction.slip_speeds"):
            replace(system, {key: 0.2})
        with pytest.raises(InputError, match=f"{key} is not used where friction.slip_speeds"):
            stroboscopic_map(system, np.zeros(3), 1, parameters=(key,))
    with pytest.raises(InputError, match=r"rate_3 is no number of the fit .* are friction\.curve\.constant, "):
        stroboscopic_map(system, np.zeros(3), 1, parameters=(f"{CURVE}rate_3",))
    with pytest.raises(InputError, match="as many as friction"):
        replace(System(), {"friction.slip_speeds": SPEEDS})


def test_a_table_of_the_law_with_one_exponential_is_that_law() -> None:
    speeds = tuple(map(float, np.linspace(0.0, 5.0, 30)))
    table = tuple(float(0.24 + 0.06 * np.exp(-2.0 * v)) for v in speeds)
    terms = terms_of(replace(System(), {"friction.slip_speeds": speeds, "friction.coefficients": table}))
    assert terms.stribeck == pytest.approx(terms_of(System()).stribeck, rel=1e-8)
    assert terms.mean_load == pytest.approx(terms_of(System()).mean_load, rel=1e-9)


def test_a_scene_file_may_name_a_table(tmp_path: Path) -> None:
    rows = "\n".join(f"{v},{x}" for v, x in zip(SPEEDS, SHAPES["dip"](np.array(SPEEDS))))
    (tmp_path / "lining.csv").write_text(f"slip_speed,coefficient\n{rows}\n")
    file = tmp_path / "own.yaml"
    file.write_text("/**:\n  ros__parameters:\n    friction:\n      table: lining.csv\n")
    result = load_scene(file)
    assert result.system.friction.slip_speeds == SPEEDS
    assert "mu(v) = 0.14 + 0.02 exp(-1.5 |v|) - 0.0168 exp(-0.05 |v|)" in friction_lines(friction_of(result.system))[0]
    assert parse_assignments([f"friction.table={tmp_path / 'lining.csv'}"])["friction.slip_speeds"] == list(SPEEDS)
    (tmp_path / "lining.csv").write_text(  # As a spreadsheet in German writes it, in rpm.
        "\ufeffSlip Speed;coefficient\nrpm;-\n" + "\n".join(
            f"{v * 30.0 / np.pi:.9g};{x:.17g}".replace(".", ",")
            for v, x in zip(SPEEDS, SHAPES["dip"](np.array(SPEEDS)))))
    assert load_scene(file).system.friction.slip_speeds == pytest.approx(SPEEDS)
    assert load_scene(file).system.friction.coefficients == pytest.approx(result.system.friction.coefficients)
    for content, why in (("slip_speed,mu\n0,0.1\n", "no column coefficient; the file has mu"),
                         ("slip_speed,coefficient\n0,x\n", "line 2 has no number in column coefficient: 'x'"),
                         ("slip_speed,coefficient\n0\n", "no columns were recognised"),
                         (f"slip_speed,coefficient\n0,{'9' * 200_000}", "a line of more than 65536 characters"),
                         ("slip_speed,coefficient\n0,0.1\n1,nan\n2,0.1\n", "needs 3 to 1000")):
        (tmp_path / "lining.csv").write_text(content)
        with pytest.raises(InputError, match=why):
            load_scene(file)
    with pytest.raises(InputError, match="both given"):
        parse_scene(file.read_text() + "      slip_speeds: [0.0]\n", "own", tmp_path)
    (tmp_path / "lining.csv").unlink()
    with pytest.raises(InputError, match=os.strerror(errno.ENOENT)):
        load_scene(file)
    (tmp_path / "lining.csv").mkdir()
    with pytest.raises(InputError, match="is not a regular file"):
        load_scene(file)


def test_what_is_doubtful_of_a_table_goes_with_every_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A fit that is more than 2 % off, and keys of the file that the table takes the place of."""
    file = tmp_path / "own.yaml"
    file.write_text("/**:\n  ros__parameters:\n    friction:\n      decay: 3.0\n"
                    "      slip_speeds: [0.0, 1.0, 9.0]\n      coefficients: [0.2, 0.13, 0.14]\n")
    warnings = load_scene(file).warnings()
    assert cli.main(["simulate", str(file), "--cycles", "2", "--json", str(tmp_path / "out.json")]) == 0
    assert "friction.decay is not used" in warnings[0]
    assert "more than 2%" in warnings[1]
    assert json.loads((tmp_path / "out.json").read_text())["warnings"] == warnings
    assert capsys.readouterr().err.splitlines() == [f"tcc-sim: {warning}" for warning in warnings]
    assert cli.main(["fmu", str(file), "--sources-only", "--out", str(tmp_path / "own.fmu")]) == 0
    assert capsys.readouterr().err.splitlines() == [f"tcc-sim: {warning}" for warning in warnings]
    assert load_scene(file).with_values({"friction.slip_speeds": [], "friction.coefficients": []}).warnings() == []
    assert warnings[1] in repr(solve(load_scene(file), cycles=1))
    text = load_scene("aged_fluid").text()
    assert "decay" not in text
    assert parse_scene(text, "aged_fluid").warnings() == []


@pytest.mark.parametrize(("word", "sentence"), [
    ("friction.law=lugre", "such as LuGre, are not modelled: sweep over friction tables instead"),
    ("friction.temperature=80.0", "temperature is no state of this model; sweep over friction tables")])
def test_what_is_not_modelled_is_refused_with_the_way_instead(word: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        load_scene("fig02").with_values(parse_assignments([word]))


def test_numbers_that_change_are_differentiated_by_rule():
    """Against differences with complex steps, by two causes; those that are left out of `Causes` change nothing."""
    def quotient(x, y):
        return 3.0 * x / (y - 2.0 * x) - x * x + 1.0 / y - (-x) + (1.0 - y)

    x, y, step = 0.7, 5.0, 1e-30
    dx, dy = quotient(x + step * 1j, y).imag / step, quotient(x, y + step * 1j).imag / step
    both = quotient(law.Changing(x, np.array([1.0, 0.0])), law.Changing(y, np.array([0.0, 1.0])))
    assert both.value == quotient(x, y)
    assert both.change == pytest.approx([dx, dy], rel=1e-14)
    by_causes = quotient(law.Changing(x, law.Causes({4: 1.0})), law.Changing(y))
    assert by_causes.change == {4: pytest.approx(dx, rel=1e-14)}
