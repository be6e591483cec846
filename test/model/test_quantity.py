"""Scene keys as values: ranges as the page states them, types, numbers of lists, figures of a system, and refusals."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from ranges import Stated, check, of_page, shown

from tcc_sim.errors import InputError, OutOfRange
from tcc_sim.model.closed_forms import Sines, common_cycles, smallest
from tcc_sim.model.groups import Pressure
from tcc_sim.model.parameters import DEFAULTS, GROUPS, QUANTITIES, System, coerce, replace
from tcc_sim.model.quantity import Options, Quantity, apart, number_in, quantity, sequence_of_numbers

HARMONICS, PHASES = "engine.harmonic_amplitudes", "engine.harmonic_phases"
RICH = {HARMONICS: [60.0, 20.0], PHASES: [0.3, 1.0]}


def missing(work, *words: str) -> list[str]:
    """The words that the sentence does not have by which a call is refused as wrong input."""
    with pytest.raises(InputError) as refused:
        work()
    return [word for word in words if word not in str(refused.value)]


@pytest.mark.parametrize(("meaning", "words", "good", "bad"), [
    (Quantity("", "s", 1.0, 3.0), "1 to 3 s", (1.0, 2, 3.0), (0.999, 3.001, math.nan, math.inf)),
    (Quantity("", "s", 1.0, 3.0, above=True), "above 1 to 3 s", (1.001, 3.0), (1.0,)),
    (Quantity("", "", 0.0), "0 or more", (0.0, 1e300), (-1e-9, math.inf)),
    (Quantity("", "m", 0.0, above=True), "above 0 m", (1e-9,), (0.0,)),
    (Quantity(""), "", (-1e300,), (math.nan, -math.inf)),
    (Quantity("", "Hz", 2.0, 9.0, zero=True), "0 or 2 to 9 Hz", (0, 0.0, 2.0), (1.0, -0.1)),
    (Quantity("", "", -math.inf, 4.0), "-inf to 4", (-1e9, 4.0), (5.0,)),
    (Quantity("", choices=("a", "b")), "a or b", ("b",), ())])
def test_a_quantity_takes_its_range_and_names_it(meaning: Quantity, words: str, good, bad) -> None:
    assert meaning.interval() == words
    for value in good:
        meaning.check("key", value)
        if not meaning.choices:
            meaning.check("key", (value, value))
    for value in bad:
        for given in (value, (*good, value)):
            with pytest.raises(OutOfRange) as refused:
                meaning.check("key", given)
            assert [word for word in ("key", f"{value:g}", words) if word not in str(refused.value)] == []
    for value in (True, "1", None):
        assert missing(lambda value=value: meaning.check("key", value), "key", repr(value), words) == []


def test_numbers_are_printed_as_far_as_they_differ() -> None:
    assert [apart(1.0, *others) for others in ((), (2.0,), (1.0,), (1.0 + 1e-7,), (1.0 + 1e-10,), (1.0 + 1e-13,))] == [
        "1"] * 6
    assert [apart(1.0 + 1.2346 * x, 1.0) for x in (1e-3, 1e-7, 1e-10, 1e-13, 1e-15)] == [
        "1.00123", "1.00000012", "1.00000000012", "1.00000000000012", repr(1.0 + 1.2346e-15)]


def test_texts_are_numbers_and_speeds_have_units() -> None:
    rpm, turn = math.pi / 30.0, 2.0 * math.pi
    for given, value in (("30rpm", 30.0 * rpm), (" 30 RPM ", 30.0 * rpm), ("2hz", 2.0 * turn), ("2 rad/s", 2.0),
                         ("1e3", 1e3), (3, 3.0)):
        assert number_in(given, "rad/s") == pytest.approx(value, rel=1e-15)
    for given, unit in (("30rpm", "s"), ("", "rad/s"), ("x", ""), (None, ""), (True, ""), ([1.0], "")):
        with pytest.raises(TypeError):
            number_in(given, unit)
    assert sequence_of_numbers("k", 3) == (3.0,)
    assert sequence_of_numbers("k", np.array([1, 2])) == (1.0, 2.0)
    assert missing(lambda: sequence_of_numbers("k", [None]), "k", "[None]", "numbers") == []


@dataclasses.dataclass(frozen=True)
class Made(Options):
    """One option of each type."""

    flag: bool = quantity(False, "")
    count: int = quantity(3, "", "", 1, 9)
    size: float = quantity(0.5, "", "s", 0.0, 2.0)
    word: str = quantity("any", "")
    kind: str = quantity("a", "", choices=("a", "b"))
    cores: tuple[int, ...] = quantity((), "", "", 0, 7)
    sizes: tuple[float, ...] = quantity((), "", "s", 0.0, 2.0)
    words: tuple[str, ...] = quantity((), "")


@pytest.mark.parametrize(("name", "given", "result"), [
    ("flag", True, True), ("count", 4, 4), ("count", 4.0, 4), ("size", 2, 2.0), ("word", 7, "7"), ("kind", "b", "b"),
    ("cores", [0, 7], (0, 7)), ("sizes", [1, 0.5], (1.0, 0.5)), ("words", ["a", "b"], ("a", "b"))])
def test_an_option_has_the_type_of_its_field(name: str, given: object, result: object) -> None:
    assert list(Made.quantities()) == [item.name for item in dataclasses.fields(Made)]
    value = getattr(Made(**{name: given}), name)
    assert (value, type(value)) == (result, type(result))
    if isinstance(result, tuple):
        assert [type(x) for x in value] == [type(x) for x in result]


@pytest.mark.parametrize(("name", "given", "shown", "allowed"), [
    ("flag", 1, "1", "true or false"), ("count", 4.5, "4.5", "whole number"), ("count", 10, "10", "1 to 9"),
    ("count", True, "True", "1 to 9"), ("size", 2.5, "2.5 s", "0 to 2 s"), ("size", "x", "'x'", "0 to 2 s"),
    ("kind", "c", "'c'", "a or b"), ("cores", (8,), "8", "0 to 7"), ("cores", [1.0], "[1.0]", "whole numbers"),
    ("cores", [True], "[True]", "whole numbers"), ("cores", 1, "1", "whole numbers"), ("sizes", [3.0], "3 s", "0 to 2"),
    ("sizes", ["1"], "['1']", "numbers"), ("words", ["a", ""], "['a', '']", "words"), ("words", [1], "[1]", "words"),
    ("words", "ab", "'ab'", "words")])
def test_an_option_of_another_type_or_range_is_refused(name: str, given: object, shown: str, allowed: str) -> None:
    assert missing(lambda: Made(**{name: given}), name, shown, allowed) == []


@pytest.mark.parametrize(("values", "words"), [
    ({"friction.temperature": 1.0}, ["friction.temperature", "friction tables"]), ({"zzz": 1.0}, ["zzz"]),
    ({"engine.frequenzy": 1}, ["engine.frequenzy", "engine.frequency?"]),
    ({"engine.frequency": "a"}, ["engine.frequency", "'a'", "0.001 to 100000 rad/s"]),
    ({PHASES: 1.0}, [PHASES, "1.0", "-100 to 100 rad"]), ({PHASES: ["a"]}, [PHASES, "['a']", "-100 to 100 rad"]),
    ({"friction.law": 3}, ["friction.law", "3", "smoothed or set_valued", "friction tables"]),
    ({"engine.frequency_values": ["7rpm"]}, ["engine.frequency_values", "7rpm", "engine.speed=7rpm"]),
    ({HARMONICS: [1.0]}, [PHASES, "0", HARMONICS, "1"]),
    ({HARMONICS: [1.0] * 33, PHASES: [0.0] * 33}, [HARMONICS, "33", "32"]),
    ({HARMONICS: [1.0] * 32, PHASES: [0.0] * 32}, None),
    ({f"{HARMONICS}_times": [0.0], f"{HARMONICS}_values": [1.0]}, [f"{HARMONICS}_values", "1", "0"]),
    ({"pressure.delay": 0.1}, ["pressure.delay", "0.1", "pressure.source topic"]),
    ({"pressure.rate_limit": 5.0, "pressure.source": "topic", "pressure.mean_times": [0.0],
      "pressure.mean_values": [1.0]}, ["pressure.rate_limit", "5", "pressure.mean_times"]),
    ({"pressure.rate_limit": 5.0, "pressure.source": "topic"}, None), ({"friction.static_coefficient": 0.012}, None),
    ({"friction.static_coefficient": 0.0119},
     ["friction.kinetic_coefficient", "0.24", "0.000595 to 0.238", "friction.static_coefficient"]),
    ({"friction.slip_speeds": [0.0, 1.0, 2.0], "friction.coefficients": [0.2] * 3, "friction.decay": 1.0}, None),
    ({"clutch[1]": 1.0}, ["clutch[1]"]), ({"friction.law[1]": 1.0}, ["friction.law[1]"]),
    ({f"{PHASES}[1]": 1.0}, [f"{PHASES}[1]", "empty"]), ({**RICH, f"{PHASES}[3]": 1.0}, [f"{PHASES}[3]", "[1] to [2]"]),
    ({**RICH, f"{PHASES}[2]_times": [0.0], f"{PHASES}[2]_values": [0.0]}, [f"{PHASES}[2]", HARMONICS]),
    ({**RICH, f"{HARMONICS}[2]_times": [], f"{HARMONICS}[2]_values": []}, [f"{HARMONICS}[2]", "0"])])
def test_values_are_taken_or_refused_with_key_value_and_range(values: dict[str, object], words) -> None:
    if words is None:
        replace(System(), values)
    else:
        assert missing(lambda: replace(System(), values), *words) == []


def test_a_system_has_the_figures_of_its_keys() -> None:
    system = replace(System(), {
        "driveline.flywheel_inertia": 0.25, "driveline.plate_inertia": 0.04, "driveline.stiffness": 2500.0,
        "friction.static_coefficient": 0.3, "friction.kinetic_coefficient": 0.2, "clutch.area": 0.05,
        "clutch.radius": 0.1, "pressure.mean": 2e5, "pressure.amplitude": 3e4, "engine.frequency": 100.0})
    assert (system.natural_frequency, system.stuck_natural_frequency, system.inverse_inertia, system.cycle,
            system.torque_per_pressure, system.saturation_mean, system.saturation_amplitude, system.friction_ratio,
            system.largest_friction_ratio) == pytest.approx(
                (250.0, math.sqrt(2500.0 / 0.29), 29.0, math.pi / 50.0, 1e-3, 200.0, 30.0, 1.5, 1.5))
    rising = replace(system, {"friction.static_coefficient": 0.1})
    assert (rising.friction_ratio, rising.largest_friction_ratio) == (0.5, 1.0)
    assert rising.friction.sliding.at(0.5) == pytest.approx(0.2 - 0.1 * math.exp(-1.0))
    for source, fallback, swing in (("harmonic", "mean", 100.0 / 1.92), ("topic", "mean", 0.0),
                                    ("topic", "harmonic", 100.0 / 1.92)):
        pressure = Pressure(source=source, fallback=fallback)
        assert dataclasses.replace(system, pressure=pressure).saturation_amplitude == pytest.approx(swing)


def test_sines_add_pass_and_swing() -> None:
    """Beside their values at times."""
    t = np.linspace(0.0, 3.0, 50)
    one = Sines.of(2.0, [(3.0, 1.0, 0.2), (3.0, 0.5, 1.4), (5.0, 0.25, -1.0)])
    other = Sines.of(-1.0, [(3.0, 2.0, 0.1), (7.0, 0.1, 0.0)])

    def value(t):
        return 2.0 + np.sin(3.0 * t + 0.2) + 0.5 * np.sin(3.0 * t + 1.4) + 0.25 * np.sin(5.0 * t - 1.0)

    def second(t):
        return -1.0 + 2.0 * np.sin(3.0 * t + 0.1) + 0.1 * np.sin(7.0 * t)

    np.testing.assert_allclose(one(t), value(t))
    for factor in (1.0, -0.5):
        np.testing.assert_allclose(one.plus(other, factor)(t), value(t) + factor * second(t), atol=1e-14)
    np.testing.assert_allclose(one.rate()(t), (value(t + 1e-6) - value(t - 1e-6)) / 2e-6, rtol=1e-7, atol=1e-8)
    assert (other.swing(), other.bend()) == pytest.approx((2.1, 18.0 + 4.9))
    delayed = other.through(lambda w: 3.0 * np.exp(-0.1j * w))
    np.testing.assert_allclose(delayed(t), 3.0 * second(t - 0.1), atol=1e-14)


@pytest.mark.parametrize("place", [0.0, 0.4321, 1.0, 0.9999])
def test_branch_and_bound_finds_the_least_value_and_its_time(place: float) -> None:
    """Of a parabola; its bend gives the slack."""
    best, when = smallest(lambda t: 5.0 + 3.0 * (t - place) ** 2, lambda t, width: 6.0 * width**2 / 8.0, 1.0, 0.3,
                          1e-13)
    assert (best, when) == (pytest.approx(5.0, abs=1e-13), pytest.approx(place, abs=2e-6))


def test_the_common_period_is_that_of_the_ratio_in_lowest_terms() -> None:
    for ratio, cycles in ((1.0, 1), (2.0, 1), (0.5, 2), (4.0 / 3.0, 3), (999.0 / 1000.0, 1000), (1000.0 / 1001.0, 0),
                          (math.sqrt(0.5), 0), (0.5 * (1.0 + 0.9e-12), 2), (0.5 * (1.0 + 2e-12), 0)):
        assert common_cycles(replace(System(), {"pressure.frequency_ratio": ratio})) == cycles, ratio


STATED = of_page("scenes")


def test_every_key_is_on_the_page() -> None:
    assert [*QUANTITIES] == [*STATED]


@pytest.mark.parametrize(("key", "stated"), STATED.items(), ids=STATED)
def test_a_key_takes_its_range_and_refuses_the_rest_by_a_sentence(key: str, stated: Stated) -> None:
    group, name = key.split(".")
    default = DEFAULTS[key]
    assert shown(default) == stated.default
    several = isinstance(default, tuple)
    kind = str if isinstance(default, str) else float
    check(key, stated.allowed, kind, lambda value: coerce(key, [value] if several else value))
    check(key, stated.allowed, kind, lambda value: GROUPS[group](**{name: (value,) if several else value}))
