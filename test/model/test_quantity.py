"""Scene keys as values: meanings, ranges, numbers of lists, figures of a system, and the sentences that refuse."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest
from dataclasses_of import changeable

from tcc_sim.errors import InputError, OutOfRange
from tcc_sim.model import equations, supported_terms
from tcc_sim.model.elements import list_of
from tcc_sim.model.groups import Friction, Pressure
from tcc_sim.model.parameters import System, coerce, replace, unknown_key, values_of
from tcc_sim.model.profile import Inputs
from tcc_sim.model.quantity import (
    Options,
    Quantity,
    apart,
    as_float,
    check_profile,
    number_in,
    number_of,
    quantity,
    sequence_of_numbers,
)
from tcc_sim.model.sines import Sines, common_cycles, smallest

RICH = {"engine.harmonic_amplitudes": [60.0, 20.0], "engine.harmonic_phases": [0.3, 1.0]}


def sentence(work) -> str:
    """The sentence by which a call is refused as wrong input; empty if it is not."""
    try:
        work()
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(("meaning", "words", "good", "bad"), [
    (Quantity("", "s", 1.0, 3.0), "1 to 3 s", (1.0, 2, 3.0), (0.999, 3.001, math.nan, math.inf)),
    (Quantity("", "s", 1.0, 3.0, above=True), "above 1 to 3 s", (1.001, 3.0), (1.0,)),
    (Quantity("", "", 0.0), "0 or more", (0.0, 1e300), (-1e-9, math.inf)),
    (Quantity("", "m", 0.0, above=True), "above 0 m", (1e-9,), (0.0,)),
    (Quantity(""), "", (-1e300,), (math.nan, -math.inf)),
    (Quantity("", "Hz", 2.0, 9.0, zero=True), "0 or 2 to 9 Hz", (0, 0.0, 2.0), (1.0, -0.1)),
    (Quantity("", "", -math.inf, 4.0), "-inf to 4", (-1e9, 4.0), (5.0,))])
def test_a_quantity_takes_its_range_and_names_it(meaning: Quantity, words: str, good, bad) -> None:
    assert meaning.interval() == words
    for value in good:
        meaning.check("key", value)
        meaning.check("key", (value, value))
    for value in bad:
        for given in (value, (*good, value)):
            with pytest.raises(OutOfRange, match=rf"^key is {re.escape(f'{value:g}')}.*; it must be {words}$"):
                meaning.check("key", given)
    for value in (True, "1", None):
        assert sentence(lambda value=value: meaning.check("key", value)) == (
            f"key is {value!r}; it must be a number, {words}")


def test_choices_and_descriptions() -> None:
    kind = Quantity("kind", choices=("a", "b"), otherwise="; no more")
    assert (kind.interval(), kind.described, Quantity("d", "m").described) == ("a or b", "kind", "d, m")
    assert sentence(lambda: kind.check("key", "b")) == ""
    assert sentence(lambda: kind.check("key", "c")) == "key is 'c'; it must be a or b; no more"
    meaning = dataclasses.make_dataclass("Made", [("x", float, quantity(
        1.0, "d", "m", 0.0, 2.0, above=True, live=True, zero=True, otherwise="o", label="l"))]).x
    assert meaning == 1.0
    field, = dataclasses.fields(dataclasses.make_dataclass("Made", [("x", float, quantity(1.0, "d"))]))
    assert field.metadata["quantity"] == Quantity("d", "", -math.inf, math.inf, False, (), False, False, "", "")


def test_numbers_are_printed_as_far_as_they_differ() -> None:
    assert [apart(1.0, *others) for others in ((), (2.0,), (1.0,), (1.0 + 1e-7,), (1.0 + 1e-10,), (1.0 + 1e-13,))] == [
        "1"] * 6
    assert [apart(1.0 + 1.2346 * x, 1.0) for x in (1e-3, 1e-7, 1e-10, 1e-13, 1e-15)] == [
        "1.00123", "1.00000012", "1.00000000012", "1.00000000000012", repr(1.0 + 1.2346e-15)]
    assert (as_float(3), as_float(10**400), as_float(-10**400)) == (3.0, math.inf, -math.inf)


def test_texts_are_numbers_and_speeds_have_units() -> None:
    rpm, turn = math.pi / 30.0, 2.0 * math.pi
    for given, value in (("30rpm", 30.0 * rpm), (" 30 RPM ", 30.0 * rpm), ("2hz", 2.0 * turn), ("2 rad/s", 2.0),
        ("1e3", 1e3),
                         (3, 3.0)):
        assert number_in(given, "rad/s") == pytest.approx(value, rel=1e-15)
    for given, unit in (("30rpm", "s"), ("", "rad/s"), ("x", ""), (None, ""), (True, ""), ([1.0], "")):
        with pytest.raises(TypeError):
            number_in(given, unit)
    assert number_of(10**400) == math.inf
    assert sequence_of_numbers("k", 3) == (3.0,)
    assert sequence_of_numbers("k", np.array([1, 2])) == (1.0, 2.0)
    assert sentence(lambda: sequence_of_numbers("k", [None])) == "k has the values [None]; they must be numbers"


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
    found = getattr(Made(**{name: given}), name)
    assert (found, type(found)) == (result, type(result))
    if isinstance(result, tuple):
        assert [type(x) for x in found] == [type(x) for x in result]


@pytest.mark.parametrize(("name", "given", "allowed"), [
    ("flag", 1, "true or false"), ("count", 4.5, "a whole number"), ("count", 10, "1 to 9"),
    ("count", True, "a number, 1 to 9"), ("size", 2.5, "0 to 2 s"), ("size", "x", "a number, 0 to 2 s"),
    ("kind", "c", "a or b"), ("cores", (8,), "0 to 7"), ("cores", [1.0], "a list of whole numbers"),
    ("cores", [True], "a list of whole numbers"), ("cores", 1, "a list of whole numbers"), ("sizes", [3.0], "0 to 2 s"),
    ("sizes", ["1"], "a list of numbers"), ("words", ["a", ""], "a list of words"), ("words", [1], "a list of words"),
    ("words", "ab", "a list of words")])
def test_an_option_of_another_type_or_range_is_refused(name: str, given: object, allowed: str) -> None:
    shown = f"{given:g}" if name == "count" and given is not True else None
    assert sentence(lambda: Made(**{name: given})) in [
        f"{name} is {x}; it must be {allowed}" for x in (shown, repr(given), "2.5 s", "8", "3 s")]


HARMONICS, PHASES = RICH
NO_PROFILE = ("of a profile; it must have as many of both, and the lists with profiles are engine.harmonic_amplitudes")
NOT_COMMANDED = ("it acts on commanded pressure and needs pressure.source topic, pressure.fallback mean and no "
                 "pressure.mean_times")


@pytest.mark.parametrize(("values", "why"), [
    ({"friction.temperature": 1.0},
     "friction.temperature is not a scene key: temperature is no state of this model; sweep over friction tables that "
     "were measured at several temperatures instead"),
    ({"zzz": 1.0}, "zzz is not a scene key"),
    ({"engine.frequenzy": 1}, "engine.frequenzy is not a scene key; did you mean engine.frequency?"),
    ({"engine.frequency": "a"}, "engine.frequency is 'a'; it must be a number, 0.001 to 100000 rad/s"),
    ({PHASES: 1.0}, f"{PHASES} is 1.0; it must be a list of numbers, each -100 to 100 rad"),
    ({PHASES: ["a"]}, f"{PHASES} is ['a']; it must be a list of numbers, each -100 to 100 rad"),
    ({"friction.law": 3},
     "friction.law is '3'; it must be smoothed or set_valued; laws with memory, such as LuGre, are not modelled: "
     "sweep over friction tables instead"),
    ({"engine.frequency_values": ["7rpm"]},
     "engine.frequency_values is 7rpm; it is the frequency of the excitation, in rad/s or hz: give the crankshaft's "
     "speed in rpm as engine.speed=7rpm"),
    ({HARMONICS: [1.0]}, f"{PHASES} has 0 values; it must have as many as {HARMONICS}, 1"),
    ({HARMONICS: [1.0] * 33, PHASES: [0.0] * 33}, f"{HARMONICS} has 33 values; at most 32 are allowed"),
    ({HARMONICS: [1.0] * 32, PHASES: [0.0] * 32}, ""),
    ({f"{HARMONICS}_times": [0.0], f"{HARMONICS}_values": [1.0]},
     f"{HARMONICS}_values has 1 values; it must have 0 for each of the 1 {HARMONICS}_times, one for each harmonic"),
    ({"pressure.delay": 0.1}, f"pressure.delay is 0.1; {NOT_COMMANDED}"),
    ({"pressure.rate_limit": 5.0, "pressure.source": "topic", "pressure.mean_times": [0.0],
      "pressure.mean_values": [1.0]}, f"pressure.rate_limit is 5; {NOT_COMMANDED}"),
    ({"pressure.rate_limit": 5.0, "pressure.source": "topic"}, ""),
    ({"friction.static_coefficient": 0.012}, ""),
    ({"friction.static_coefficient": 0.0119},
     "friction.kinetic_coefficient is 0.24; it must be 0.000595 to 0.238, one twentieth to twenty times "
     "friction.static_coefficient"),
    ({"friction.slip_speeds": [0.0, 1.0, 2.0], "friction.coefficients": [0.2, 0.2, 0.2], "friction.decay": 1.0}, ""),
    ({"clutch[1]": 1.0}, "clutch[1]: clutch is not a list"),
    ({"friction.law[1]": 1.0}, "friction.law[1]: friction.law is not a list"),
    ({f"{PHASES}[1]": 1.0}, f"{PHASES}[1] does not exist: {PHASES} is empty; give the whole list first"),
    ({**RICH, f"{PHASES}[3]": 1.0},
     f"{PHASES}[3] does not exist: {PHASES} has 2 values, [1] to [2]; give the whole list first"),
    ({**RICH, f"{PHASES}[2]_times": [0.0], f"{PHASES}[2]_values": [0.0]},
     f"{PHASES}[2] has 1 times and 1 values {NO_PROFILE}"),
    ({**RICH, f"{HARMONICS}[2]_times": [], f"{HARMONICS}[2]_values": []},
     f"{HARMONICS}[2] has 0 times and 0 values {NO_PROFILE}")])
def test_values_are_taken_or_refused_by_one_sentence(values: dict[str, object], why: str) -> None:
    assert sentence(lambda: replace(System(), values)) == why


def test_keys_that_others_replace_are_refused_unless_both_change() -> None:
    tabled = replace(System(), {"friction.slip_speeds": [0.0, 1.0, 2.0], "friction.coefficients": [0.2, 0.2, 0.2]})
    assert sentence(lambda: replace(tabled, {"friction.decay": 1.0})) == (
        "friction.decay is not used where friction.slip_speeds and friction.coefficients are given; change that table "
        "instead")
    back = replace(tabled, {"friction.decay": 1.0, "friction.slip_speeds": [], "friction.coefficients": []})
    assert back.friction == dataclasses.replace(Friction(), decay=1.0)
    assert str(unknown_key("mean", ["meant"], "a name")) == "mean is not a name; did you mean meant?"
    assert (coerce("engine.frequency", 3), type(coerce("engine.frequency", 3))) == (3.0, float)
    assert list(dict(values_of(System()))) == list(dict(values_of(tabled)))
    assert {key: value for key, value in values_of(tabled) if System().value(key) != value} == {
        "friction.slip_speeds": (0.0, 1.0, 2.0), "friction.coefficients": (0.2, 0.2, 0.2)}
    assert [list_of(key) for key in ("a.b", "a.b[2]", "a.b[2]_times", "a.b[12]_values", "a.b[x]")] == [
        "a.b", "a.b", "a.b_times", "a.b_values", "a.b[x]"]
    for each, times, values, good in ((1, 3, 3, True), (1, 3, 2, False), (2, 2, 4, True), (0, 0, 0, True),
                                      (0, 1, 0, False), (1, 1000, 1000, True), (1, 1001, 1001, False)):
        given = tuple(map(float, range(times))), (1.0,) * values
        assert (sentence(lambda given=given, each=each: check_profile("k", *given, each)) == "") == good


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
    assert (rising.friction.static, rising.friction.kinetic, rising.friction.stribeck) == (0.1, 0.2, (-0.5, 2.0))
    assert rising.friction.sliding.at(0.5) == pytest.approx(0.2 - 0.1 * math.exp(-1.0))
    assert replace(system, {"friction.static_coefficient": 0.2}).friction.stribeck is None
    for source, fallback, harmonic in (("harmonic", "mean", True), ("topic", "mean", False),
                                       ("topic", "harmonic", True)):
        pressure = Pressure(source=source, fallback=fallback)
        assert pressure.harmonic == harmonic
        swing = dataclasses.replace(system, pressure=pressure).saturation_amplitude
        assert swing == pytest.approx(100.0 / 1.92 * harmonic)
    for name, lagged in (("time_constant", True), ("rate_limit", True), ("delay", False)):
        pressure = Pressure(source="topic", **{name: 1.0})
        assert (pressure.lagged, pressure.actuated) == (lagged, True)
    assert not Pressure().actuated
    assert not Friction().doubts


def test_sines_add_pass_and_swing() -> None:
    """Beside their values at times."""
    t = np.linspace(0.0, 3.0, 50)
    one = Sines.of(2.0, [(3.0, 1.0, 0.2), (3.0, 0.5, 1.4), (5.0, 0.25, -1.0)])
    other = Sines.of(-1.0, [(3.0, 2.0, 0.1), (7.0, 0.1, 0.0)])
    assert (one.frequency.tolist(), other.frequency.tolist()) == ([3.0, 5.0], [3.0, 7.0])

    def value(t):
        return 2.0 + np.sin(3.0 * t + 0.2) + 0.5 * np.sin(3.0 * t + 1.4) + 0.25 * np.sin(5.0 * t - 1.0)

    def second(t):
        return -1.0 + 2.0 * np.sin(3.0 * t + 0.1) + 0.1 * np.sin(7.0 * t)

    np.testing.assert_allclose(one(t), value(t))
    assert one(0.3) == pytest.approx(value(0.3))
    for factor in (1.0, -0.5):
        np.testing.assert_allclose(one.plus(other, factor)(t), value(t) + factor * second(t), atol=1e-14)
    np.testing.assert_array_equal(one.plus(other)(t), one.plus(other, 1.0)(t))
    np.testing.assert_allclose(one.rate()(t), (value(t + 1e-6) - value(t - 1e-6)) / 2e-6, rtol=1e-7, atol=1e-8)
    assert (other.swing(), other.bend()) == pytest.approx((2.1, 18.0 + 4.9))
    delayed = other.through(lambda w: 3.0 * np.exp(-0.1j * w))
    np.testing.assert_allclose(delayed(t), 3.0 * second(t - 0.1), atol=1e-14)
    assert Sines.of(2.0, [])(t).tolist() == [2.0] * 50


@pytest.mark.parametrize("place", [0.0, 0.4321, 1.0, 0.9999])
def test_branch_and_bound_finds_the_least_value_and_its_time(place: float) -> None:
    """Of a parabola, on cells that reach beyond the end; its bend gives the slack."""
    asked: list[float] = []

    def value(t):
        asked.extend(np.ravel(t))
        return 5.0 + 3.0 * (t - place) ** 2

    best, when = smallest(value, lambda t, width: 6.0 * width**2 / 8.0, 1.0, 0.3, 1e-13)
    assert (best, when) == (pytest.approx(5.0, abs=1e-13), pytest.approx(place, abs=2e-6))
    assert len(asked) < 400
    assert max(asked) == pytest.approx(1.2)
    assert smallest(lambda t: 0.0 * t - 2.0, lambda t, width: 0.0, 0.0, 0.5, 1e-9) == (-2.0, 0.0)


def test_the_common_period_is_that_of_the_ratio_in_lowest_terms() -> None:
    for ratio, cycles in ((1.0, 1), (2.0, 1), (0.5, 2), (4.0 / 3.0, 3), (999.0 / 1000.0, 1000), (1000.0 / 1001.0, 0),
                          (math.sqrt(0.5), 0), (0.5 * (1.0 + 0.9e-12), 2), (0.5 * (1.0 + 2e-12), 0)):
        assert common_cycles(replace(System(), {"pressure.frequency_ratio": ratio})) == cycles, ratio
    thirds = replace(System(), {"pressure.frequency_ratio": 4.0 / 3.0})
    assert (common_cycles(thirds, 3), common_cycles(thirds, 2)) == (3, 0)


def test_terms_are_those_of_the_keys_and_a_refusal_names_who_has_them() -> None:
    lines = np.array([[0.0, 1.0, 0.0]])
    table = {"friction.slip_speeds": [0.0, 1.0, 2.0], "friction.coefficients": [0.2, 0.2, 0.2]}
    base = {"smoothed": "friction.law smoothed", "torque": "engine.torque_amplitude", "pulsation": "pressure.amplitude",
            "stribeck": "friction that varies with slip speed"}
    topic = {"engine.source": "topic", "pressure.source": "topic"}
    for system, more, less in (
            (System(), {}, ()), (replace(System(), table), {"curve": "friction.coefficients"}, ("stribeck",)),
            (replace(System(), {"friction.law": "set_valued", "friction.kinetic_coefficient": 0.3}),
             {"set_valued": "friction.law set_valued"}, ("smoothed", "stribeck")),
            (replace(System(), {"engine.torque_amplitude": 0.0, "pressure.amplitude": 0.0}), {},
             ("torque", "pulsation")),
            (replace(System(), {**RICH, **topic}), {}, ("torque", "pulsation")),
            (replace(System(), RICH), {"harmonics": "engine.harmonic_amplitudes"}, ()),
            (replace(System(), {**topic, "pressure.delay": 0.1}), {"approach": "an actuator of the pressure"},
             ("torque", "pulsation")),
            (replace(System(), {"converter.coupling": 0.1}),
             dict.fromkeys(("flywheel_by_slip", "plate_by_slip"), "converter.coupling"), ()),
            (dataclasses.replace(System(), inputs=Inputs(lines, None, 1.0)),
             {"inputs": "inputs", "profile": "inputs"}, ()),
            (dataclasses.replace(System(), inputs=Inputs(None, None, 1.0, lines)),
             {"inputs": "inputs", "profile": "inputs", "far": "inputs with output_speed"}, ()),
            (replace(System(), {"engine.mean_torque_times": [0.0], "engine.mean_torque_values": [1.0]}),
             {"profile": "engine.mean_torque_times"}, ())):
        expected = {**base, **more}
        assert supported_terms.terms_in(system) == {name: expected[name] for name in expected if name not in less}
    odd = replace(System(), {"friction.law": "set_valued", "converter.coupling": 0.1, **RICH})
    assert sentence(lambda: supported_terms.check_supported("peer", odd, "it")) == (
        "it does not know friction.law set_valued, engine.harmonic_amplitudes, converter.coupling; those that do are "
        "event_driven, section map, pure slip, pure stick")
    assert sentence(lambda: supported_terms.check_supported("section map", odd, "it")) == ""
    driven = dataclasses.replace(odd, inputs=Inputs(lines, None, 1.0))
    assert sentence(lambda: supported_terms.check_supported("smoothed", driven, "it")) == (
        "it does not know friction.law set_valued; those that do are event_driven, section map, pure slip, pure "
        "stick, reference")
    assert sentence(lambda: supported_terms.check_supported("event_driven", driven, "it")) == (
        "it does not know inputs; those that do are fixed_step, smoothed, rk45, dop853, radau, bdf, lsoda, rk4, tick "
        "derivatives, node")
    two = replace(odd, {"engine.mean_torque_times": [0.0], "engine.mean_torque_values": [1.0]})
    assert sentence(lambda: supported_terms.check_supported("harmonic balance", two, "it")).endswith("; nothing does")
    assert {"flywheel_by_slip", "flywheel_by_speed", "plate_by_slip"} == set(equations.OPTIONAL)


def test_values_of_the_room_do_not_change() -> None:
    assert changeable("model") == []
