"""Tacho signals and engine speeds as test benches record them: the orders are right, or the table is refused."""

import numpy as np
import pytest

from tcc_sim.analysis.measured.measured_phase import signals_in
from tcc_sim.analysis.measured.orders import orders_of
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.tables.measured_table import MeasuredTable

RATE, END, LOW, HIGH = 5000, 6.0, 100.0, 160.0
T = np.arange(0.0, END, 1.0 / RATE)
SPEED = LOW + (HIGH - LOW) * T / END
ANGLE = LOW * T + 0.5 * (HIGH - LOW) / END * T**2
NOISE = np.random.default_rng(0).normal(size=len(T))
FOUR = replace(System(), {"engine.order": 2.0})


def signals_and_orders(name, values, pulses=1, system=FOUR, t=T, **others):
    """Signals and orders of a table whose slip speed has 5 rad/s at crank order 2."""
    theta = LOW * t + 0.5 * (HIGH - LOW) / END * t**2
    columns = {"t": t, "slip_speed": 20.0 + 5.0 * np.sin(2.0 * theta + 1.0) + 0.8 * np.sin(theta),
               "engine_torque": 200.0 + 180.0 * np.sin(2.0 * theta), name: values, **others}
    signals = signals_in(MeasuredTable({k: v for k, v in columns.items() if v is not None}), system, pulses)
    return signals, orders_of(signals)


def square(x, share=0.5):
    return 5.0 * (x % 1.0 < share)


def smooth(x):
    return 2.5 + 2.5 * np.tanh(8.0 * np.sin(2.0 * np.pi * x))


def pulse(number, begin=0.0, end=1.0):
    return (np.floor(TURNS) == number) & (begin <= TURNS % 1.0) & (end > TURNS % 1.0)


def wheel(teeth, missing, turns):
    return np.where(turns * teeth % teeth < teeth - missing, np.sin(2.0 * np.pi * teeth * turns), -1.0)


TURNS = ANGLE / (2.0 * np.pi)
FAST = np.arange(0.0, 1.0, 1.0 / (4 * RATE))
MANY = (LOW * FAST + 0.5 * (HIGH - LOW) / END * FAST**2) / (2.0 * np.pi)
"""Times for wheels with many teeth, and revolutions then."""
TACHOS = {
    "noise": (smooth(TURNS) + 0.25 * NOISE, 1, ""), "noisy square": (square(TURNS) + 0.25 * NOISE, 1, ""),
    "millivolts": (1e-3 * square(TURNS) - 40.0, 1, ""), "drifting offset": (square(TURNS) + 3.0 * np.sin(T), 1, ""),
    "growing": (np.sin(2.0 * np.pi * TURNS) * SPEED**2, 1, ""), "narrow": (square(TURNS, 0.02), 1, ""),
    "upside down": (5.0 - square(TURNS, 0.1), 1, ""),
    "missing": (np.where(pulse(50), 0.0, square(TURNS)), 1, "1 missing pulse of the tacho inserted, after"),
    "extra": (np.where(pulse(50, 0.7, 0.8), 5.0, square(TURNS)), 1, "1 extra pulse of the tacho left out, at"),
    "two faults": (np.where(pulse(50, 0.7, 0.8), 5.0, np.where(pulse(70), 0.0, square(TURNS))), 1, "missing pulse"),
    "spike": (np.where(np.arange(len(T)) == 15000, 12.0, square(TURNS)), 1, "1 extra pulse"),
    "spikes": (square(TURNS) + 9.0 * (np.arange(len(T)) % 9173 == 77), 1, ""),
    "58 teeth and a gap": (wheel(60, 2, MANY), 60, "a wheel of 60 teeth of which 2 are missing"),
    "named by its pulses": (wheel(36, 1, MANY), 35, "a wheel of 36 teeth of which 1 are missing"),
}


@pytest.mark.parametrize("name", TACHOS)
def test_a_tacho_gives_the_orders(name):
    signal, pulses, said = TACHOS[name]
    signals, orders = signals_and_orders("tacho", signal, pulses, t=T if pulses == 1 else FAST)
    assert np.abs(orders.cut(2.0, "slip_speed") / 5.0 - 1.0).max() < 0.004
    windows = (2.0 * (TURNS if pulses == 1 else MANY)[-1] - 16.0) / 4.0
    assert len(orders.time) > 0.7 * windows
    speed = np.interp(orders.time, T, SPEED)
    assert np.abs(orders.frequency / (2.0 * speed) - 1.0).max() < 0.004
    assert said in " ".join(signals.notes)
    assert said or not signals.notes or "jitter" in signals.notes[0]


@pytest.mark.parametrize(("signal", "pulses", "why"), [
    (np.sin(60.0 * np.pi * 2.0 * ANGLE / (2.0 * np.pi))[::5], 60, "sampled too slowly for its pulses"),
    (square(TURNS), 2, "the strongest line of engine_torque is at 2 times the excitation by tacho with --pulses 2"),
    (square(2.0 * TURNS), 1, "contradicts the torque: .* at 0.5 times the excitation"),
    (wheel(24, 2, TURNS), 1, "shows a wheel of 24 teeth of which 2 are missing, and --pulses is 1; give --pulses 24"),
    (0.0 * T + 2.0, 1, "has 0 rising edges between 2 and 2"), (0.1 * NOISE, 1, "sampled too slowly|as if pulses were"),
    (np.where(NOISE[np.floor(TURNS).astype(int)] > 1.0, 0.0, square(TURNS)), 1, "as if pulses were missing or extra"),
    (square(TURNS * (1.0 + 0.3 * np.sin(2.0 * T))), 1, "contradicts the torque|as if pulses were missing"),
])
def test_a_tacho_that_is_not_to_be_believed_is_refused(signal, pulses, why):
    t = T if len(signal) == len(T) else T[::5]
    with pytest.raises(InputError, match=why):
        signals_and_orders("tacho", signal, pulses, t=t)


def test_a_longer_gap_of_the_tacho_leaves_windows_blank():
    signal = np.where((T > 2.0) & (T < 2.5), 0.0, square(TURNS))
    signals, orders = signals_and_orders("tacho", signal)
    assert "no plausible pulses from 1.9" in " ".join(signals.notes)
    assert np.abs(orders.cut(2.0, "slip_speed") / 5.0 - 1.0).max() < 0.004
    assert len(orders.time) < len(signals_and_orders("tacho", square(TURNS))[1].time)
    assert np.isnan(orders.with_blanks().slip_speed).any()


def with_part(begin, end, value):
    return np.where((begin <= T) & (end > T), value, SPEED)


SPEEDS = {
    "clean": (SPEED, ""), "noise": (SPEED * (1.0 + 0.02 * NOISE), ""),
    "on CAN": (SPEED[np.arange(len(T)) // 50 * 50], ""),
    "drop-out": (with_part(3.0, 3.02, 1.0), "implausible in 100 rows, 3 to 3.0198 s; straight lines replace them"),
    "zeros": (with_part(3.0, 3.02, 0.0), "straight lines"),
    "raw": (with_part(3.0, 3.3, 65535.0), "implausible in 1500"),
    "spikes": (np.where(np.arange(len(T)) % 7001 == 5, 3e4, SPEED), "straight lines"),
    "late": (with_part(0.0, 0.4, 0.0), "implausible in 2000 rows, 0 to 0.3998 s"),
    "frozen": (with_part(2.0, 3.0, SPEED[10000])[np.arange(len(T)) // 5 * 5], "implausible in"),
}


@pytest.mark.parametrize("name", SPEEDS)
def test_an_engine_speed_gives_the_orders(name):
    values, said = SPEEDS[name]
    signals, orders = signals_and_orders("engine_speed", values)
    assert np.abs(orders.cut(2.0, "slip_speed") / 5.0 - 1.0).max() < 0.004
    assert len(orders.time) > 30
    assert said in " ".join(signals.notes)
    assert bool(signals.notes) is bool(said)


@pytest.mark.parametrize(("values", "why"), [
    (SPEED * 30.0 / np.pi, "at 0.1047 times .* looks as if it were in rpm; .* engine_speed=COLUMN:rpm"),
    (SPEED * 0.5 / np.pi, "at 6.28. times .* looks as if it were in hz"), (2.0 * SPEED, "at 0.5 times the excitation"),
    (with_part(1.0, 4.0, 1.0), "jumps or stands still in"), (-SPEED, "above 0"),
    (np.full(len(T), 130.0), "contradicts the torque")])
def test_an_engine_speed_that_is_not_to_be_believed_is_refused(values, why):
    with pytest.raises(InputError, match=why):
        signals_and_orders("engine_speed", values)


def test_without_a_torque_the_slip_speed_gives_a_doubt():
    signals, _ = signals_and_orders("engine_speed", 2.0 * SPEED, engine_torque=None)
    assert "the strongest line of slip_speed is at 0.5 times the excitation by engine_speed" in signals.notes[0]
    assert not signals_and_orders("engine_speed", SPEED, engine_torque=None)[0].notes
    # Crank orders of an engine whose order the scene does not state.
    signals, orders = signals_and_orders("engine_speed", SPEED, system=System())
    assert "engine_torque is at 2 times the excitation" in signals.notes[0]
    assert np.abs(orders.cut(2.0, "slip_speed") / 5.0 - 1.0).max() < 0.004
