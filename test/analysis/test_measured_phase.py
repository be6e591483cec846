"""The phase of short tables: rows of an engine speed that are left out, and references that the torque contradicts."""

import numpy as np
import pytest

from tcc_sim.analysis.measured.measured_phase import measured_phase, signals_in
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.tables.measured_table import MeasuredTable

TURN = 2.0 * np.pi


FAST = 0.002 * np.arange(2001)
OMEGA = 20.0 * np.pi


def table(source="t.csv", **columns):
    given = {"t": FAST, "slip_speed": 20.0 + np.sin(OMEGA * FAST), **columns}
    return MeasuredTable({name: values for name, values in given.items() if values is not None}, source=source)


TORQUE = 200.0 + 100.0 * np.sin(OMEGA * FAST + 0.4)


def test_the_phase_is_that_of_the_first_reference():
    speed = np.full(2001, OMEGA)
    by_speed = measured_phase(table(engine_speed=speed, engine_torque=TORQUE))
    assert by_speed.turns == pytest.approx(OMEGA * FAST / TURN)
    assert (by_speed.times.tolist(), by_speed.holes.tolist(), by_speed.notes) == (FAST.tolist(), [], ())
    assert by_speed.when(np.array([1.0])) == pytest.approx([TURN / OMEGA])
    half = measured_phase(table(engine_speed=0.5 * speed, engine_torque=TORQUE), 2.0)
    assert half.turns == pytest.approx(OMEGA * FAST / TURN)
    for first, doubted in ((6.0, False), (4.0, True)):   # Of a line at twice the excitation, a twentieth of it counts.
        double = 100.0 * np.sin(2.0 * OMEGA * FAST) + first * np.sin(OMEGA * FAST)
        assert bool(measured_phase(table(engine_speed=speed, engine_torque=double)).notes) is doubted
    by_torque = measured_phase(table(engine_torque=TORQUE), pulses=1)
    assert by_torque.times == pytest.approx((TURN * by_torque.turns - 0.4) / OMEGA, abs=1e-6)
    by_tacho = measured_phase(table(tacho=np.sin(OMEGA * FAST)), 1.0, 1)
    assert np.interp(10.0, by_tacho.turns, by_tacho.times) - np.interp(4.0, by_tacho.turns, by_tacho.times) == (
        pytest.approx(6.0 * TURN / OMEGA, rel=1e-4))
    doubted = measured_phase(table(tacho=np.sin(OMEGA * FAST), engine_torque=TORQUE), 1.0, 2)
    assert "2 times the excitation by tacho with --pulses 2" in doubted.notes[0]
    two = measured_phase(table(tacho=np.sin(OMEGA * FAST)), 3.0, 2)
    assert np.ptp(two.turns) == pytest.approx(1.5 * np.ptp(by_tacho.turns))


@pytest.mark.parametrize(("columns", "order", "pulses", "words"), [
    ({}, 1.0, None, ["engine_speed", "tacho", "engine_torque"]),
    ({"engine_speed": np.full(2001, OMEGA)}, 1.0, 2, ["engine_speed", "--pulses 2", "tacho"]),
    ({"engine_speed": np.where(FAST < 0.005, OMEGA, np.nan)}, 1.0, None, ["engine_speed", "3 values", "4 or more"]),
    ({"engine_speed": np.full(2001, -OMEGA)}, 1.0, None, ["engine_speed", "-62.8319 rad/s", "above 0"]),
    ({"engine_torque": np.full(2001, 200.0)}, 1.0, None, ["engine torque is constant", "engine_speed", "tacho"]),
    ({"engine_speed": np.full(2001, 1e3 * OMEGA), "engine_torque": TORQUE}, 1.0, None,
     ["engine_torque", "0.001 times", "t=COLUMN:ms"]),
    ({"tacho": np.sin(OMEGA * FAST), "engine_torque": TORQUE}, 2.0, 4,
     ["tacho", "2 times", "--pulses 4", "engine.order, which is 2"])])
def test_a_reference_without_a_phase_is_refused_with_what_contradicts_it(columns, order, pulses, words):
    with pytest.raises(InputError) as refusal:
        measured_phase(table(**columns), order, pulses)
    assert [word for word in ("t.csv", *words) if word not in str(refusal.value)] == []


def test_signals_of_a_table_are_cubics_and_the_shaft_torque_is_that_of_its_twist():
    system = replace(System(), {"driveline.damping": 0.7, "driveline.stiffness": 3000.0})
    angle, speed = 0.1 + 0.02 * np.sin(40.0 * FAST), 0.8 * np.cos(40.0 * FAST)
    at = np.linspace(0.5, 3.5, 301)
    a, w = 0.1 + 0.02 * np.sin(40.0 * at), 0.8 * np.cos(40.0 * at)
    turning = {"engine_speed": np.full(2001, OMEGA), "engine_torque": TORQUE, "plate_angle": angle}
    for more, torque in (({"plate_speed": speed}, 0.7 * w + 3000.0 * a), ({}, 0.7 * w + 3000.0 * a),
                         ({"output_speed": np.full(2001, 3.0), "output_angle": 0.5 + 3.0 * FAST},
                          0.7 * (w - 3.0) + 3000.0 * (a - 0.5 - 3.0 * at)),
                         ({"output_speed": np.full(2001, 3.0)}, 0.7 * (w - 3.0) + 3000.0 * (a - 3.0 * at))):
        result = signals_in(table(**turning, **more), system)
        slip, shaft, engine = result.at(at)
        assert slip == pytest.approx(20.0 + np.sin(OMEGA * at), abs=1e-5)
        assert shaft == pytest.approx(torque, abs=2e-3)
        assert engine == pytest.approx(200.0 + 100.0 * np.sin(OMEGA * at + 0.4), abs=1e-3)
        assert (result.driven, result.breakaways, result.notes) == (None, None, ())
    unknown = signals_in(table(engine_speed=np.full(2001, OMEGA)), system)
    assert np.isnan(unknown.at(at)[1]).all()
    assert np.isnan(unknown.at(at)[2]).all()
    assert unknown.driven.tolist() == [1.0]
    assert np.isnan(unknown.heat).all()


def test_holes_of_a_table_are_bridged_or_blank_and_named():
    """A sixteenth of a period is 6.5 ms: a hole of two steps is bridged, one of ten is not."""
    slip = 20.0 + np.sin(OMEGA * FAST)
    slip[[500, 800]] = np.nan
    slip[1000:1009] = np.nan
    result = signals_in(table(slip_speed=slip, engine_speed=np.full(2001, OMEGA)), System())
    assert result.holes.tolist() == [pytest.approx([1.998, 2.018])]
    assert result.notes == (
        "t.csv: 2 holes of at most 0.004 s, a sixteenth of a period of the excitation or less, bridged by cubics",
        "t.csv: no slip speed or no phase from 1.998 to 2.018 s; windows that touch this hole are left blank")
    found = result.at(np.array([1.0, 1.6, 2.0, 2.0179, 2.019]))[0]
    assert np.isnan(found).tolist() == [False, False, True, True, False]
    assert found[:2] == pytest.approx(20.0 + np.sin(OMEGA * np.array([1.0, 1.6])), abs=1e-3)
    few = np.where(np.arange(2001) < 3, slip, np.nan)
    for columns, sentence in (
            ({"slip_speed": few}, r"t.csv: .*slip_speed .*3 .*4 or more"),
            ({"slip_speed": np.where(FAST < 1.0, slip, np.nan), "engine_speed": np.where(FAST > 2.0, OMEGA, np.nan)},
             r"t.csv: .*2.002 to 4 s")):
        with pytest.raises(InputError, match=sentence):
            signals_in(table(**{"engine_speed": np.full(2001, OMEGA), **columns}), System())
