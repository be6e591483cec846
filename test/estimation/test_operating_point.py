"""Constant motions by the law written out here, cuts of periodic ones, and loops of the slip controller by hand."""

from __future__ import annotations

import math
import re
from collections import deque
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

from tcc_sim.errors import InputError, NumericalFailure, OutOfRange
from tcc_sim.estimation import linearise as linearisation
from tcc_sim.estimation import slip_loop
from tcc_sim.estimation.linearise import INPUTS, OUTPUTS, linearise
from tcc_sim.estimation.lock_in import simulated
from tcc_sim.estimation.operating_point import (
    Constant,
    MotionSegment,
    Periodic,
    _from_settled,
    closed,
    halved,
    operating_point,
    refined,
    stuck_segments,
)
from tcc_sim.estimation.settings import Settings
from tcc_sim.estimation.slip_loop import _Loop, _smallest_slip
from tcc_sim.model.parameters import System
from tcc_sim.scene import Scene, load_scene

STILL = load_scene("controlled").with_values({"engine.torque_amplitude": 0.0, "pressure.amplitude": 0.0})
"""200 N m; mu_s 0.3, mu_k 0.27, alpha 2 s/rad, sigma 50 s/rad, A R 0.008 m^3."""
PER = 0.27 * 0.008


def system(law: str = "smoothed", **values: float) -> System:
    """STILL with a law and values of a few keys."""
    keys = {"coupling": "converter.coupling", "torque": "engine.mean_torque", "pressure": "pressure.mean"}
    return STILL.with_values({"friction.law": law, **{keys[name]: value for name, value in values.items()}}).system


def law(v: float, name: str) -> float:
    """Friction over mu_k N R."""
    step = math.tanh(50.0 * v) if name == "smoothed" else math.copysign(1.0, v)
    return (1.0 + (0.3 / 0.27 - 1.0) * math.exp(-2.0 * abs(v))) * step


@pytest.mark.parametrize("name", ["smoothed", "set_valued"])
@pytest.mark.parametrize(("coupling", "torque", "slip"), [(0.0, 200.0, 0.7), (0.5, 200.0, 20.0), (0.5, -200.0, -20.0)])
def test_constant_slip_balances_the_mean_torque(name: str, coupling: float, torque: float, slip: float) -> None:
    motion = operating_point(system(name, coupling=coupling, torque=torque), slip)
    load = PER * motion.system.pressure.mean
    assert motion.mean_slip == slip
    assert load * law(slip, name) == pytest.approx(torque - coupling * slip)
    slope = (law(slip + 1e-5, name) - law(slip - 1e-5, name)) / 2e-5
    assert (motion.slope, motion.by_pressure) == (pytest.approx(load * slope, rel=1e-6),
        pytest.approx(PER * law(slip, name)))


def test_without_a_slip_speed_the_pressure_decides() -> None:
    """Stick, as creep of the smoothed law, or the slip at which a coupling carries what friction does not."""
    for name in ("smoothed", "set_valued"):
        for torque in (200.0, -200.0):
            stuck = operating_point(system(name, torque=torque, pressure=2e5), None)
            if name == "set_valued":
                assert (stuck.mean_slip, stuck.slope, stuck.by_pressure) == (0.0, math.inf, 0.0)
                continue
            creep = brentq(lambda v, torque=torque: PER * 2e5 * law(v, "smoothed") - torque, -0.03, 0.03, xtol=1e-15)
            assert stuck.mean_slip == pytest.approx(creep, rel=1e-9)
            slips = operating_point(system(name, torque=torque, pressure=5e4, coupling=0.5), None)
            slip = brentq(lambda v: PER * 5e4 * law(v, "smoothed") + 0.5 * v - 200.0, 1.0, 400.0)
            assert slips.mean_slip == pytest.approx(math.copysign(slip, torque), rel=1e-9)


@pytest.mark.parametrize("name", ["smoothed", "set_valued"])
def test_slip_that_friction_does_not_carry_runs_away_and_slip_on_which_it_rises_settles(name: str) -> None:
    """From 50 rad/s friction carries 216 N m, and stick 240: 230 N m had a constant slip of 1200 rad/s. Where friction
    rises with slip from 72 N m, it carries 75 N m at one slip speed; that was refused as a runaway.
    """
    with pytest.raises(OutOfRange, match=r"^slip runs away: the mean torque of 230 N m exceeds what the clutch "
                       r"carries, 216 N m; "):
        operating_point(system(name, torque=230.0, pressure=1e5), None)
    with pytest.raises(OutOfRange, match=r"^slip runs away: the mean torque of 241 N m exceeds what the clutch "
                       r"carries, 240 N m; "):
        operating_point(system(name, torque=241.0, pressure=1e5), None)
    late = operating_point(system(name, torque=215.9, pressure=1e5), None)
    assert abs(late.mean_slip) < 0.05
    rising = STILL.with_values({"friction.law": name, "friction.kinetic_coefficient": 0.33, "friction.decay": 0.05,
                                "engine.mean_torque": 75.0, "pressure.mean": 3e4, "initial.slip_speed": 1.0}).system
    exact = brentq(lambda v: 240.0 * (0.33 - 0.03 * math.exp(-0.05 * v)) - 75.0, 1.0, 100.0)
    assert operating_point(rising, None).mean_slip == pytest.approx(exact, rel=1e-9)
    equal = STILL.with_values({"friction.law": name, "friction.kinetic_coefficient": 0.3,
                               "pressure.mean": 200.0 / 0.0024})
    found = operating_point(equal.system, None)
    assert found.mean_slip == pytest.approx(50.0, rel=1e-9)
    assert found.slope == 0.0


@pytest.mark.parametrize(("given", "slip", "kind", "why"), [
    (system(pressure=5e4), None, OutOfRange, "slip runs away: the mean torque of 200 N m exceeds what the clutch "
     "carries, 120 N m; give --slip or another pressure"),
    (system(), -5.0, OutOfRange, "a slip speed of -5 rad/s needs an engine torque in its direction; "
     "engine.mean_torque is 200 N m"),
    (system(coupling=20.0), 10.0, OutOfRange, "a slip speed of 10 rad/s needs an engine torque in its direction; "
     "engine.mean_torque is 200 N m, of which 200 N m pass beside friction"),
    (system(), 0.0, InputError, "the mean slip speed is 0 rad/s; it must be a number that is not 0"),
    (system(), math.nan, InputError, "the mean slip speed is nan rad/s; it must be a number that is not 0"),
    (STILL.with_values({"pressure.source": "harmonic", "pressure.amplitude": 1e3,
                        "pressure.frequency_ratio": math.sqrt(0.5)}).system, None,
     InputError,
     "pressure.frequency_ratio is 0.707107; a motion that settles needs a ratio of whole numbers up to 1000"),
    (load_scene("controlled").with_values({"engine.mean_torque": 0.0}).system, 5.0, InputError,
     "engine.mean_torque is 0 N m; no pressure then holds a mean slip speed"),
    (load_scene("controlled").with_values({"pressure.mean": 5e4}).system, None, OutOfRange, "slip runs away: the mean "
     "torque of 200 N m exceeds what the clutch carries while it slips, 108 N m; give --slip or another pressure"),
    (load_scene("chaos").system, None, OutOfRange, "the scene settles in no motion of a period up to 16 periods of "
     "excitation within 400; there is nothing to linearise about")])
def test_what_has_no_settled_motion_is_refused(given: System, slip: float | None, kind: type, why: str) -> None:
    with pytest.raises(kind, match=f"^{re.escape(why)}$"):
        operating_point(given, slip)


@pytest.mark.parametrize(("options", "why"), [
    ({"input": "pressure"}, "input is 'pressure'; it must be actuation_pressure or engine_torque"),
    ({"output": "slip"}, "output is 'slip'; it must be slip_speed or friction_torque or shaft_torque"),
    ({"frequencies": []}, "there are 0 frequencies; 1 to 100000 are allowed"),
    ({"frequencies": [1.0] * 100_001}, "there are 100001 frequencies; 1 to 100000 are allowed"),
    *(({"frequencies": [1.0, x]}, f"a frequency is {x:g} rad/s; it must be 1e-06 to 1e+06 rad/s") for x in (0.9e-6,
        1.1e6)),
    ({"frequencies": [1.0], "check": 2}, "check is 2; it must be 0 to the number of frequencies, 1"),
    ({"frequencies": [1.0], "check": -1}, "check is -1; it must be 0 to the number of frequencies, 1")])
def test_what_is_no_transfer_function_is_refused(options: dict[str, object], why: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(why)}$"):
        linearise(STILL, slip=5.0, **options)


def test_a_linearisation_has_columns_arrays_and_a_text() -> None:
    found = linearise(STILL, slip=5.0, frequencies=[1e-6, 30.0, 1e6])
    assert repr(found) == ("<Linearisation of slip_speed by actuation_pressure: slip, mean slip 5 rad/s, pressure "
                           f"{found.pressure:.6g} Pa, 3 points>")
    assert found.operating_point == linearisation.OperatingPoint(5.0, found.pressure, 200.0, 1)
    assert list(found.columns()) == ["frequency", "gain", "phase"]
    assert set(found.as_json()) == {"input", "output", "kind", "operating_point", "multipliers", "A", "B", "C", "D",
                                    "states", "dt",
                                    "frequencies", "gain", "phase", "checked"}
    turning = replace(found, response=np.exp(1j * np.array([3.0, -3.0, -1.0])) * 2.0)
    assert turning.phase == pytest.approx([3.0, 2.0 * math.pi - 3.0, 2.0 * math.pi - 1.0])
    assert turning.gain == pytest.approx([2.0] * 3)
    arrays = turning.arrays()
    assert {name: np.shape(arrays[name]) for name in arrays} == {
        "A": (3, 3), "B": (3, 1), "C": (1, 3), "D": (1, 1), "dt": (), "frequencies": (3,), "gain": (3,), "phase": (3,),
        "multipliers": (3,)}
    sizes = np.exp(np.linalg.eigvals(found.a).real * STILL.system.cycle)
    assert np.abs(found.multipliers) == pytest.approx(np.sort(sizes)[::-1])
    stiff = linearise(STILL.with_values({"driveline.stiffness": 1.0, "driveline.plate_inertia": 10.0}), slip=5.0)
    assert (len(stiff.frequencies), stiff.frequencies[0], stiff.frequencies[-1]) == (240, 2.0, pytest.approx(6.0))


def test_a_simulated_point_is_in_the_turn_of_the_computed_phase(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tcc_sim.estimation.lock_in.simulated", lambda *given: 2.0 * np.exp(2.5j))
    bar = SimpleNamespace(update=lambda: None)
    for phase, turns in ((2.4, 0), (-3.7, -1), (-3.9, -1), (9.0, 1), (-16.0, -3)):
        linear = SimpleNamespace(phase=np.array([0.0, phase]), frequencies=np.array([1.0, 7.0]), input="", output="")
        found = linearisation._simulated(None, linear, 1, bar)
        assert (found.frequency, found.gain, found.phase) == (7.0, pytest.approx(2.0),
            pytest.approx(2.5 + 2.0 * math.pi * turns))


@pytest.fixture(scope="module")
def halves() -> Periodic:
    """A motion of period two with stick in it."""
    scene = load_scene("controlled").with_values({"pressure.source": "harmonic", "pressure.amplitude": 2e4,
                                                  "pressure.frequency_ratio": 0.5})
    return operating_point(scene.system, 6.0)


def test_a_motion_is_cut_more_finely_or_more_coarsely(halves: Periodic) -> None:
    assert (halves.period, len(halves.segments), halves.seconds) == (2, 1024, pytest.approx(2.0 * halves.system.cycle))
    fine, coarse = refined(halves, 1024), halved(halves)
    assert (len(fine.segments), len(coarse.segments)) == (2048, 512)
    for k in (0, 17, 511):
        np.testing.assert_allclose(coarse.segments[k].state, halves.segments[2 * k].state)
    for other in (coarse, halved(fine)):
        for one, each in zip(halves.carried, other.carried):
            np.testing.assert_allclose(each[-1], one[-1], rtol=1e-6, atol=1e-6 * np.abs(one[-1]).max())
    again = closed(halves.system, 2, halves.segments[0].state * (1.0 + 1e-4), None)
    np.testing.assert_allclose(again.segments[0].state, halves.segments[0].state, atol=1e-6)
    weights = np.array([1.0, *[4.0, 2.0] * 511, 4.0, 1.0]) / 3072.0
    slips = [each.state[0] for each in halves.segments]
    assert weights @ [*slips, slips[0]] == pytest.approx(6.0, abs=1e-6)


def test_a_response_that_needs_too_many_segments_is_refused(halves: Periodic, monkeypatch: pytest.MonkeyPatch) -> None:
    for most, fine in ((1024, True), (1023, False)):
        monkeypatch.setattr(linearisation, "DEFAULTS", Settings(most_segments=most))
        if fine:
            linearisation.response_of(halves, "engine_torque", "slip_speed", np.array([5.0]))
            continue
        with pytest.raises(InputError, match=f"^a response at 5 rad/s needs more than 1023 segments of a motion of "
                                             f"{halves.seconds:.4g} s to be right within 1 %; ask for lower "
                                             "frequencies$"):
            linearisation.response_of(halves, "engine_torque", "slip_speed", np.array([7.0, 5.0]))


def test_a_segment_sticks_if_both_of_its_ends_do(halves: Periodic) -> None:
    for speeds, stuck in (([0.0, 1e-3, 5.0, -1e-3, 0.0, -5.0], [True, False, False, True, False, False]),
                          ([0.0, 5.0, 1e-3, -1e-3], [False, False, True, True]), ([5.0, 0.0], [False, False])):
        made = replace(halves, segments=[MotionSegment(np.array([v, 0.0, 0.0]), np.eye(3), np.zeros((3, 2)))
                                         for v in speeds])
        assert stuck_segments(made).tolist() == stuck


def test_a_motion_is_reached_from_the_settled_one_with_the_nearest_slip(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of sixteen pressures from 0.95 to twice the given one, at most 1e7 Pa; some of them have no motion."""
    tried: list[float] = []

    def found(load: System, period: int, state: object, slip: float | None) -> object:
        pressure = load.pressure.mean
        if slip is None:
            return SimpleNamespace(system=load, period=3, segments=[SimpleNamespace(state=pressure)],
                                   mean_slip=pressure / 1e5)
        tried.append(pressure)
        assert (period, state, slip) == (3, pressure, 5.0)
        if len(tried) < 3:
            raise NumericalFailure("no")
        return "found"

    def settled(load: System) -> tuple[int, str]:
        if 4.2e5 < load.pressure.mean < 5e5:
            raise OutOfRange("runs away")
        return 1, "start"

    monkeypatch.setattr("tcc_sim.estimation.operating_point.closed", found)
    monkeypatch.setattr("tcc_sim.estimation.operating_point._settled", settled)
    pressures = 4e5 * np.geomspace(0.95, 2.0, 16)
    left = pressures[(pressures <= 4.2e5) | (pressures >= 5e5)]
    failed = NumericalFailure("first")
    assert _from_settled(STILL.system, 4e5, 5.0, failed) == "found"
    assert tried == pytest.approx(sorted(left, key=lambda p: abs(p - 5e5))[:3])

    def nowhere(*given: object) -> None:
        raise NumericalFailure("another")

    monkeypatch.setattr("tcc_sim.estimation.operating_point.closed", nowhere)
    with pytest.raises(NumericalFailure, match=r"^first$"):
        _from_settled(STILL.system, 4e5, 5.0, failed)


def test_a_motion_that_is_not_found_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tcc_sim.estimation.operating_point.DEFAULTS", Settings(iterations=3))
    with pytest.raises(NumericalFailure, match=r"^no motion of period 1 with a mean slip speed of -20 rad/s was "
                       r"found: the best one misses its start by .*e.* in natural sizes$"):
        closed(load_scene("controlled").system, 1, np.zeros(3), -20.0)


A, B = np.array([[0.97, 0.4, 0.001], [-0.02, 0.9, 0.05], [0.3, -2.0, 0.8]]), np.array([-4e-5, 2e-7, 1e-5])


def made_loop(ticks: int = 4, lag: float = 0.0, delay: int = 0, gain: float = 1.0) -> _Loop:
    """The loop of a plant made by hand, about a motion of two engine cycles with different maps."""
    given = replace(STILL.system, pressure=replace(STILL.system.pressure, source="topic", time_constant=lag,
                                                   delay=delay * STILL.system.cycle / ticks))
    return _Loop(given, [(A, B)] * ticks + [(A @ A, B)] * ticks, ticks, (3.0 * gain, 11.0 * gain))


def radius(loop: _Loop, factor: float = 1.0, late: int = 0) -> float:
    """The largest multiplier of a loop by simulation from every unit state, tick by tick as the controller runs."""
    lag, h, ticks = loop.system.pressure.time_constant, loop.step, loop.ticks
    late += round(loop.system.pressure.delay / h)
    size, columns = 5 + (ticks - 1) + late, []
    for unit in np.eye(size):
        x, integral, plates = unit[:3], unit[3], unit[4]
        slips, waiting = deque(unit[5:4 + ticks]), deque(unit[4 + ticks:])
        for by_state, by_pressure in loop.maps:
            slips.append(x[0])
            mean = sum(slips) / ticks
            slips.popleft()
            waiting.append((factor * loop.gains[0] * mean + integral) / PER)
            integral += factor * loop.gains[1] * h * mean
            command = waiting.popleft()
            acting = command
            if lag:
                left = math.exp(-h / lag)
                acting = command + lag / h * (1.0 - left) * (plates - command)
                plates = command + left * (plates - command)
            else:
                plates = command
            x = by_state @ x + by_pressure * acting
        columns.append(np.concatenate([x, [integral, plates], slips, waiting]))
    return float(np.abs(np.linalg.eigvals(np.array(columns).T)).max())


@pytest.mark.parametrize(("lag", "delay"), [(0.0, 0), (0.0, 2), (0.02, 0), (0.02, 3)])
def test_margins_of_a_loop_are_where_its_simulation_becomes_unstable(lag: float, delay: int) -> None:
    loop = made_loop(lag=lag, delay=delay)
    for factor, late in ((1.0, 0), (2.5, 0), (1.0, 3), (0.3, 1)):
        assert np.abs(loop.multipliers(factor, late)).max() == pytest.approx(radius(loop, factor, late), rel=1e-6)
        assert loop.growth(factor, late) == pytest.approx(math.log(radius(loop, factor, late)), abs=1e-6)
        assert loop.stable(factor, late) == (radius(loop, factor, late) < 1.0)
    margin, latest = loop.gain_margin(), loop.largest_delay()
    assert loop.stable()
    assert radius(loop, 0.999 * margin) < 1.0 < radius(loop, 1.001 * margin)
    ticks = round(latest / loop.step)
    assert latest == pytest.approx(ticks * loop.step)
    assert radius(loop, late=ticks - 1) < 1.0 <= radius(loop, late=ticks)
    assert len(loop.multipliers()) == 4 + 3 + delay + (lag > 0.0)


def test_a_loop_without_effect_has_no_margins() -> None:
    idle = replace(made_loop(), maps=[(0.5 * np.eye(3), np.zeros(3))] * 4)
    assert idle.growth() == pytest.approx(0.0, abs=1e-9)   # The integral part alone.
    for late, found in ((513, None), (512, 512), (1, 1), (100, 100)):
        loop = made_loop()
        object.__setattr__(loop, "gains", (float(late), 0.0))
        stable = slip_loop._Loop.stable
        try:
            slip_loop._Loop.stable = lambda self, factor=1.0, late=0: late < self.gains[0] and factor < 7.0
            assert loop.largest_delay() == (None if found is None else pytest.approx(found * loop.step))
            assert loop.gain_margin() == pytest.approx(7.0, rel=1e-4)
            slip_loop._Loop.stable = lambda self, factor=1.0, late=0: factor <= 1000.0
            assert loop.gain_margin() is None
        finally:
            slip_loop._Loop.stable = stable


@pytest.mark.parametrize("ticks", [4, 40])
def test_the_phase_margin_is_that_of_an_integrator_behind_the_controller(ticks: int) -> None:
    loop = made_loop(ticks)
    h = loop.step

    def plant(omegas):
        return -PER / (0.2j * np.asarray(omegas))

    def open_loop(omega: float) -> complex:
        late = np.exp(-1j * omega * h)
        mean = sum(late**k for k in range(ticks)) / ticks
        gains = 3.0 + 11.0 * h * late / (1.0 - late)
        return complex(-plant(omega) / PER * mean * (1.0 - late) / (1j * omega * h) * gains)

    crossed = brentq(lambda omega: abs(open_loop(omega)) - 1.0, 3.0, 100.0)
    assert loop.phase_margin(plant) == pytest.approx(math.pi + np.angle(open_loop(crossed)), abs=2e-3)
    assert loop.phase_margin(lambda omegas: 1e-9 * plant(omegas)) is None


@pytest.mark.parametrize("begin", [20.0, 19.0, 7.3])
def test_the_smallest_stable_slip_does_not_depend_on_where_the_search_begins(begin: float, monkeypatch) -> None:
    """The root of the growth, within 0.1 %; slips without a motion are unstable; 0 if all to a tenth are stable."""
    asked: list[float] = []

    def with_slip(motion: Constant, slip: float) -> Constant:
        asked.append(slip)
        if slip < 4.0:
            raise OutOfRange("none")
        return replace(motion, mean_slip=slip)

    monkeypatch.setattr(slip_loop, "_with_slip", with_slip)
    motion = Constant(STILL.system, begin, 0.0, 0.0)
    for root, found in ((6.5, pytest.approx(6.5, rel=1e-3)), (0.01, pytest.approx(4.0, rel=0.08))):
        monkeypatch.setattr(_Loop, "about", lambda motion, ticks, gains, root=root: SimpleNamespace(
            growth=lambda: math.log(root / motion.mean_slip)))
        assert _smallest_slip(motion, 4, (1.0, 1.0), False) == found
    monkeypatch.setattr(slip_loop, "_with_slip", lambda motion, slip: replace(motion, mean_slip=slip))
    asked.clear()
    assert _smallest_slip(motion, 4, (1.0, 1.0), False) == 0.0
    powers = [math.log(slip) / math.log(0.93) for slip in asked]
    assert np.allclose(powers, np.round(powers))


@pytest.mark.parametrize(("scene", "options", "why"), [
    (STILL, {"slip": 5.0, "controller": (0.0, 1.0)}, "the proportional gain of the controller is 0; it must be a "
     "number above 0"),
    (STILL, {"slip": 5.0, "controller": (1.0, math.inf)}, "the integral gain of the controller is inf; it must be a "
     "number above 0"),
    (STILL.with_values({"friction.law": "set_valued", "pressure.mean": 3e5}), {"controller": (1.0, 1.0)}, "the scene "
     "sticks, and no controller changes its slip speed; give --slip"),
    (STILL.with_values({"engine.mean_torque": -200.0}), {"slip": -5.0, "controller": (1.0, 1.0)}, "the mean slip "
     "speed is -5 rad/s; the slip controller holds one above 0"),
    *((STILL.with_values(values), {"slip": 5.0, "controller": (1.0, 1.0)},
       f"a period of excitation holds {ticks} Hz; a controller needs 4 to 2000") for values, ticks in (
           ({"rate": 83.0}, "3.477 ticks at 83"), ({"engine.frequency": 3.1385}, "2002 ticks at 1000")))])
def test_what_has_no_loop_is_refused(scene: Scene, options: dict[str, object], why: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(why)}$"):
        linearise(scene, frequencies=[10.0], **options)


@pytest.mark.parametrize("output", OUTPUTS)
@pytest.mark.parametrize("inputs", INPUTS)
def test_a_simulated_response_of_a_constant_motion_is_that_of_its_matrices(inputs: str, output: str) -> None:
    """Within 1 %, with a fluid's torque and an actuator, which the engine's torque does not pass."""
    scene = STILL.with_values({"converter.coupling": 3.0, "driveline.damping": 6.0, "pressure.time_constant": 0.004,
                               "pressure.delay": 0.001})
    found = linearise(scene, slip=1.5, input=inputs, output=output, frequencies=[250.0, 300.0, 340.0], check=2)
    assert [point.frequency for point in found.checked] == [250.0, 340.0]
    for point, k in zip(found.checked, (0, 2)):
        assert point.gain * np.exp(1j * point.phase) == pytest.approx(found.response[k], rel=0.02)
        assert point.phase == pytest.approx(found.phase[k], abs=0.1)


def test_side_bands_are_at_multiples_of_the_motions_frequency(halves: Periodic, monkeypatch: pytest.MonkeyPatch
                                                              ) -> None:
    bases: list[float | None] = []
    monkeypatch.setattr("tcc_sim.estimation.lock_in._driven", lambda *given: np.zeros((given[-1], 3)))
    monkeypatch.setattr("tcc_sim.estimation.lock_in._fitted", lambda t, states, omega, base: bases.append(base) or
                        np.zeros(3))
    for motion in (halves, operating_point(system(), 5.0)):
        simulated(motion, "actuation_pressure", "slip_speed", 50.0)
    assert bases == [pytest.approx(math.pi / halves.system.cycle), None]


def test_what_cannot_be_simulated_is_refused() -> None:
    motion, ticks = operating_point(system(), 5.0), math.ceil(24.0 * 2.0 * math.pi / 0.05 * 4000.0)
    for of, inputs, omega, why in (
            (operating_point(system("set_valued"), 5.0), "engine_torque", 5.0,
             "friction.law is set_valued; the response can be simulated for smoothed only"),
            (replace(motion, system=system(torque=0.0)), "engine_torque", 5.0,
             "the mean of engine_torque is 0; a response about it cannot be simulated with a small sine"),
            (replace(motion, system=system(pressure=0.0)), "actuation_pressure", 5.0,
             "the mean of actuation_pressure is 0; a response about it cannot be simulated with a small sine"),
            (motion, "engine_torque", 0.05, f"a response at 0.05 rad/s takes {ticks} ticks "
             "to simulate; at most 2000000 are allowed")):
        with pytest.raises(InputError, match=f"^{re.escape(why)}$"):
            simulated(of, inputs, "slip_speed", omega)
