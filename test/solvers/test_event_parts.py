"""Parts of the exact engine as plain Python: modes, margins and lengths of steps for states and polynomials by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from plain import plain

from tcc_sim.model.equations import Linear, matrix_of
from tcc_sim.solvers.engine import GRADIENT, GROWS, VALUE
from tcc_sim.solvers.event_driven import margins, modes, sensitivity, setup, step
from tcc_sim.solvers.event_driven.step import BREAKAWAY, DOWNWARD, LAW_VARIES, NO_EVENT, REST, UPWARD, Step
from tcc_sim.solvers.excitation import DRIVE, WAVE
from tcc_sim.solvers.series import ANGLE, COLUMNS, ROWS, SLIP, SPEED
from tcc_sim.solvers.stages import WORK
from tcc_sim.solvers.terms import Terms
from tcc_sim.trajectory import FREE

LINEAR = Linear(0.2, 0.02, 0.6, 3000.0, 0.5, 0.3, -0.4)
BOUNDS = setup.Bounds(0.04, 1.5, False, 500.0, 100.0, 5.0, 2.0, 1e-12, 1e-9, 1e-12, 50.0, 99, 9)
WAVES = np.zeros(0, WAVE).view(np.recarray)


def record(kind: np.dtype[Any], **values: float) -> Any:
    out = np.zeros(1, kind).view(np.recarray)[0]
    for name, value in values.items():
        out[name] = value
    return out


def rows_of(**coefficients: list[float]) -> Any:
    """Rows of coefficients of a step by name."""
    rows, places = np.zeros((ROWS + 2, COLUMNS)), {"slip": SLIP, "angle": ANGLE, "speed": SPEED, "up": UPWARD}
    for name, values in coefficients.items():
        rows[places.get(name, DOWNWARD), :len(values)] = values
    return rows


def held(torque: float, angle: float, speed: float) -> float:
    """The torque by which the plate and the flywheel have one acceleration, from the matrix of the linear part."""
    a = matrix_of(LINEAR)
    free = a[0] @ [0.0, angle, speed] + torque / 0.2
    return free / (1.0 / 0.2 + 1.0 / 0.02)  # type: ignore[no-any-return]


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("speed", [-20.0, 0.0, 35.0])
def test_at_breakaway_and_at_the_end_of_slip_the_rate_of_the_margin_decides(speed, side) -> None:
    """|lambda| = r Ts: it sticks if r Ts grows faster than |lambda| as the stuck motion goes on."""
    torque, torque_rate, angle, h = side * 700.0, side * 9000.0, side * 0.2, 1e-5
    pull = (torque - 0.3 * speed - 0.6 * speed - 3000.0 * angle) / 0.22
    rate = side * (held(torque + torque_rate * h, angle + speed * h, speed + pull * h)
                   - held(torque - torque_rate * h, angle - speed * h, speed - pull * h)) / (2.0 * h)
    need = side * held(torque, angle, speed)
    drive = record(DRIVE, torque=torque, torque_rate=torque_rate)
    mode_at_rest, note = plain(modes.mode_at_rest), plain(margins.note_arrival)
    for more, beyond, mode in ((0.5, 0.0, 0), (-0.5, 0.0, side), (-0.5, 1e-8, 0), (0.5, -1e-8, side),
                               (-0.5, 0.9e-9, side), (0.5, -0.9e-9, 0)):
        drive.load, drive.load_rate = (need + beyond) / 1.5, (rate + more) / 1.5
        assert mode_at_rest(angle, speed, drive, 1.5, 1e-9, LINEAR) == mode
    # At the end of slip in direction `side` the margin is r Ts + side lambda; it grows if the stuck motion lets it.
    state = record(setup.STATE, plate_angle=-angle, plate_speed=-speed)
    drive.torque, drive.torque_rate = -torque, -torque_rate
    for more, grows in ((0.5, 1.0), (-0.5, 0.0)):
        least, sines = np.full((3, GRADIENT), math.inf), np.zeros((2, COLUMNS))
        drive.load, drive.load_rate = (need + 7.0) / 1.5, (rate + more) / 1.5
        for before, after in ((math.inf, 7.0), (-7.5, 7.0), (6.9, 6.9), (-6.9, -6.9)):
            least[margins.ARRIVAL, [VALUE, GROWS]] = before, 5.0
            note(side, Step(1e-3, 1.0, 8, REST, 0, 0.0), state, drive, LINEAR, 1.5, np.zeros(0), sines, (0.0, 1.0, 0.0),
                 None, least)
            assert least[margins.ARRIVAL, VALUE] == pytest.approx(after)
            assert least[margins.ARRIVAL, GROWS] == (grows if after == 7.0 else 5.0)


def test_a_state_has_the_mode_of_its_speed_or_of_the_torque_at_rest() -> None:
    drive, mode_of = record(DRIVE, torque=300.0, load=40.0), plain(modes.mode_of)
    for speed, loaded, angle, mode in ((5.0, False, 0.0, FREE), (0.0, False, 0.0, FREE), (1e-300, True, 0.0, 1),
                                       (-1e-300, True, 0.0, -1), (0.0, True, 0.0, 0), (0.0, True, 0.1, 1),
                                       (0.0, True, -0.1, -1)):
        assert mode_of(speed, loaded, angle, 0.0, drive, 1.5, 1e-9, LINEAR) == mode


def terms(mean_load: float, pulsation: Any = None, stribeck: Any = None) -> Terms:
    return Terms(LINEAR, 300.0, None, None, mean_load, pulsation, None, stribeck)


def test_a_start_has_the_mode_of_the_load_there_and_the_clamps_next_switch() -> None:
    """The load is above 0 from sin = -1/2 on, or where its mean is."""
    begin = plain(modes.begin)
    for clamped, mean, speed, shift, mode, edge, at_rest in (
            (False, 0.0, 3.0, 0.0, FREE, math.inf, 0), (False, 1e-9, 3.0, 0.0, 1, math.inf, 0),
            (False, 900.0, 0.0, 0.0, 0, math.inf, 1), (True, 50.0, 0.0, 0.0, 1, 7.0 * math.pi / 6.0, 1),
            (True, 50.0, -3.0, 0.0, -1, 7.0 * math.pi / 6.0, 0),
            (True, 50.0, 0.0, 1.5 * math.pi, FREE, math.pi / 3.0, 0)):
        state, drive = record(setup.STATE, slip_speed=speed, shift=shift, plate_angle=0.1), record(DRIVE)
        begin(BOUNDS._replace(clamped=clamped), terms(mean, (100.0, 20.0, 0.0) if clamped else None), WAVES, state,
              drive)
        assert (state.mode, state.at_rest,) == (mode, at_rest)
        assert state.load_edge == pytest.approx(edge / 20.0)
        assert drive.load == pytest.approx((mean + 100.0 * math.sin(shift) * clamped) * (mode != FREE))


STILL = {"mode": 1, "load_edge": math.inf, "tau": 0.01}


@pytest.mark.parametrize(("now", "of_step", "goal", "after", "event"), [
    # To the goal, or nearly; short of it; without a length; in stick, where no polynomial moves v.
    (STILL, (2.0, NO_EVENT, 0), 0.012, {"tau": 0.012, "slip_speed": 7.0}, False),
    (STILL, (2.0, NO_EVENT, 0), 0.012 * (1.0 + 1e-14), {"tau": 0.012 * (1.0 + 1e-14)}, False),
    (STILL, (1.0, NO_EVENT, 0), 0.012, {"tau": 0.011, "slip_speed": 6.0, "plate_angle": 1.0, "plate_speed": 3.0},
     False),
    (STILL, (0.0, NO_EVENT, 0), 0.012, {"tau": 0.01, "slip_speed": 0.0}, True),
    ({**STILL, "at_rest": 1}, (0.0, NO_EVENT, 0), 0.012, {"tau": 0.01, "at_rest": 1, "mode": 1}, False),
    ({**STILL, "at_rest": 1}, (1.0, NO_EVENT, 0), 0.012, {"at_rest": 0}, False),
    ({**STILL, "mode": 0}, (1.0, NO_EVENT, 0), 0.012, {"tau": 0.011, "slip_speed": 0.0, "plate_angle": 1.0}, False),
    # Events: breakaway either way, the far edge of the law, and the end of slip under a large and a small load.
    ({**STILL, "mode": 0}, (1.0, BREAKAWAY, -1), 0.012, {"mode": -1, "at_rest": 1, "tau": 0.011}, True),
    (STILL, (1.0, LAW_VARIES, 0), 0.012, {"mode": 1, "slip_speed": 6.0}, False),
    (STILL, (1.0, REST, 0), 0.012, {"mode": 1, "slip_speed": 0.0, "at_rest": 1}, True),
    ({**STILL, "mode": -1}, (1.0, NO_EVENT, 0), 0.012, {"mode": 1, "slip_speed": 0.0, "at_rest": 1}, True),
    ({**STILL, "mode": -1}, (1.0, LAW_VARIES, 0), 0.012, {"mode": -1, "slip_speed": 6.0}, False),
    # The clamp switches at the end.
    ({**STILL, "load_edge": 0.011}, (1.0, NO_EVENT, 0), 0.012, {"tau": 0.011, "mode": 1, "load_edge": math.inf}, True),
    ({**STILL, "load_edge": 0.011}, (0.5, NO_EVENT, 0), 0.012, {"tau": 0.0105, "mode": 1, "load_edge": 0.011}, False)])
def test_a_step_ends_in_a_state_and_a_mode(now, of_step, goal, after, event) -> None:
    """v = 5 + x, theta2 = x, theta2' = 2 + x in units of 1 ms."""
    rows, state = rows_of(slip=[5.0, 1.0], angle=[0.0, 1.0], speed=[2.0, 1.0]), record(setup.STATE, **now)
    x, kind, direction = of_step
    assert plain(modes.finish)(BOUNDS, terms(1.0), WAVES, Step(1e-3, x, 8, kind, direction, 0.0), goal, state,
                               record(DRIVE), rows, None) is event
    for name, value in after.items():
        assert state[name] == pytest.approx(value, rel=1e-15, abs=0.0), name


def test_a_speed_that_has_decayed_is_0_and_the_flywheel_turns() -> None:
    for speed, left in ((0.9e-26 * 50.0, 0.0), (1.1e-26 * 50.0, 1.1e-26 * 50.0)):
        rows, state = rows_of(slip=[5.0], speed=[speed]), record(setup.STATE, **STILL)
        rows[3, :2] = 0.25, 2.0   # The flywheel's angle.
        plain(modes.finish)(BOUNDS, terms(1.0), WAVES, Step(1e-3, 1.0, 8, NO_EVENT, 0, 0.0), 1.0, state, record(DRIVE),
                            rows, True)
        assert (state.plate_speed, state.flywheel_angle) == (pytest.approx(left, rel=1e-12, abs=0.0), 2.25)
    near = record(setup.STATE, **{**STILL, "load_edge": 0.011})
    plain(modes.finish)(BOUNDS, terms(900.0), WAVES, Step(1e-3, 1.0, 8, NO_EVENT, 0, 0.0), 1.0, near, record(DRIVE),
                        rows_of(slip=[-0.9e-12]), None)
    assert (near.slip_speed, near.mode, near.at_rest) == (0.0, 0, 1)


@pytest.mark.parametrize(("mode", "following"), [(1, 0), (1, -1), (-1, 0), (-1, 1)])
def test_the_saltation_matrix_is_that_of_the_fields_before_and_after(mode, following) -> None:
    """S = I + (f+ - f-) e_v^T/v'-, with the fields of the linear part and friction mode r Ts, or lambda in stick."""
    drive, state = record(DRIVE, torque=300.0, load=200.0), record(setup.STATE, plate_angle=0.03, plate_speed=-2.0)
    a, x = matrix_of(LINEAR), np.array([0.0, 0.03, -2.0])

    def field(friction: float) -> Any:
        return a @ x + [(300.0 - friction) / 0.2 - friction / 0.02, 0.0, friction / 0.02]

    before, after = field(mode * 300.0), field(held(300.0, 0.03, -2.0) if following == 0 else following * 300.0)
    start = np.random.default_rng(1).normal(size=(3, 4))
    group = np.zeros(1, [("now", float, (3, 4))]).view(np.recarray)
    group[0].now[:] = start
    assert plain(sensitivity.land)(mode, following, state, drive, 1.5, LINEAR, group)
    saltation = np.eye(3) + np.outer(after - before, [1.0, 0.0, 0.0]) / before[0]
    assert group[0].now == pytest.approx(saltation @ start)
    drive.torque = (mode * 300.0 * 55.0 - 50.0 * (0.6 * 2.0 - 90.0) + 0.3 * -2.0 / 0.2) * 0.2
    still = plain(sensitivity.land)(mode, following, state, drive, 1.5, LINEAR, group)
    assert still == (abs(field(mode * 300.0)[0] + (drive.torque - 300.0) / 0.2) > 1e-9)


def test_steps_with_derivatives_resolve_what_the_motion_does_not_show() -> None:
    longest, state, law = plain(sensitivity.longest_step), record(setup.STATE, slip_speed=1.0), (0.5, 2.0)
    slip, stick = math.sqrt(150e3) + 30.0 + 5.0, math.sqrt(3000.0 / 0.22) + 0.6 / 0.22 + 5.0
    fall, rest = (400.0 * 55.0 * 2.0 * 0.5 * math.exp(-2.0 * v) for v in (1.0, 2.01))
    for mode, speed, stribeck, fastest, expected in (
            (1, 1.0, None, 0.0, 3.3 / slip), (0, 1.0, None, 0.0, 3.3 / stick), (0, 0.0, law, 0.0, 3.3 / stick),
            (FREE, 1.0, law, 0.0, 3.3 / slip), (1, 1.0, law, 0.0, 1.6 / (slip + fall)),
            (-1, -1.0, law, 0.0, 1.6 / (slip + fall)), (1, 2.01, law, 0.0, 1.6 / (slip + rest)),
            (1, 2.03, law, 0.0, 3.3 / slip),
            (1, 1.0, None, 900.0, 3.3 / 900.0), (1, 1.0, law, 900.0, 1.6 / (900.0 + fall))):
        state.mode, state.slip_speed = mode, speed
        assert longest(BOUNDS, LINEAR, 400.0, stribeck, fastest, state) == pytest.approx(expected)


CUBIC = [1.0, -9.0, 24.0, -16.0]
"""1 - 9 x + 24 x^2 - 16 x^3 with the slope -48 (x - 1/4)(x - 3/4): its minimum is 0, its maximum 1."""


def test_the_smallest_dip_is_the_least_minimum_inside() -> None:
    dip, work = plain(margins.smallest_dip), np.zeros(1, WORK)[0]["bernstein"]
    for sign, end, below, expected in (
            (1.0, 1.0, math.inf, (0.0, 0.25)), (-1.0, 1.0, math.inf, (-1.0, 0.75)), (1.0, 0.24, math.inf, None),
            (1.0, 0.26, math.inf, (0.0, 0.25)), (1.0, 1.0, 1e-9, (0.0, 0.25)), (1.0, 1.0, -1e-9, None),
            (-1.0, 0.7, math.inf, None), (-1.0, 1.0, -1.1, None), (-1.0, 1.0, -0.9, (-1.0, 0.75))):
        found = dip(rows_of(slip=CUBIC), SLIP, 3, end, sign, below, work)
        assert found == (pytest.approx(expected) if expected else (below, -1.0))
    # Two minima, near 0.2 and 0.8, the second or the first of which is lower.
    wave = np.polynomial.Polynomial.fromroots([0.2, 0.5, 0.8]).integ() * 100.0
    for tilt in (-0.5, 0.5):
        curve = wave + np.polynomial.Polynomial([0.0, tilt])
        places = [float(x.real) for x in curve.deriv().roots() if curve.deriv(2)(x.real) > 0.0]
        least = min(places, key=curve)
        found = dip(rows_of(slip=[*curve.coef]), SLIP, 4, 1.0, 1.0, math.inf, work)
        assert found == pytest.approx((curve(least), least))


@pytest.mark.parametrize(("mode", "height", "expected"), [
    (1, 0.5, (1.0, 0.75, 1.0)), (1, 1.1, (1.1, -1.0, 0.0)), (0, 0.5, (0.5, -1.0, 0.0)), (-1, 0.5, (0.5, -1.0, 0.0)),
    (FREE, 0.5, (1.0, 0.75, 1.0)), (FREE, 0.99, (1.0, 0.75, 1.0))])
@pytest.mark.parametrize("side", [1, -1])
def test_the_largest_slip_speed_of_a_step_is_inside_or_at_its_end(mode, height, expected, side) -> None:
    note, work = plain(sensitivity.note_height), np.zeros(1, WORK)[0]["bernstein"]
    rows, reach = rows_of(slip=[side * c for c in CUBIC]), 49.0
    if side < 0 and mode in (1, -1):
        mode = -mode
    value, place, sign = expected
    found = note(mode, Step(1.0, 0.9, 3, 0, 0, reach), rows, height, work)
    assert found == (pytest.approx(value), pytest.approx(place), side * sign)
    # At the end of a rising line, and where not even the bound of its change reaches the height.
    line = rows_of(slip=[side * 1.0, side * 2.0])
    for start, bound, result in ((2.9, 2.0, (3.0, 1.0, side)), (3.0, 2.0, (3.0, -1.0, 0.0)),
                                 (2.9, 1.9, (2.9, -1.0, 0.0))):
        assert note(FREE, Step(1.0, 1.0, 3, 0, 0, bound), line, start, work) == pytest.approx(result)


def test_a_step_is_searched_for_the_margin_of_its_mode() -> None:
    note, work = plain(margins.note_step), np.zeros(1, WORK)[0]["bernstein"]
    lower = [0.5, *CUBIC[1:]]
    for mode, rows, before, least, places in (
            (1, rows_of(slip=[2.0, *CUBIC[1:]]), math.inf, 1.0, (0.25, None, -1.0)),
            (-1, rows_of(slip=[-c for c in [2.0, *CUBIC[1:]]]), math.inf, 1.0, (0.25, None, -1.0)),
            (1, rows_of(slip=lower), math.inf, math.inf, None), (FREE, rows_of(slip=CUBIC), math.inf, math.inf, None),
            (0, rows_of(up=CUBIC, down=lower), math.inf, -0.5, (-1.0, -1.0, 0.25)),
            (0, rows_of(up=lower, down=CUBIC), math.inf, -0.5, (-1.0, 1.0, 0.25)),
            (0, rows_of(up=CUBIC, down=[9.0]), math.inf, 0.0, (-1.0, 1.0, 0.25)),
            (0, rows_of(up=CUBIC, down=lower), -0.6, -0.6, None)):
        found, marks = np.full((3, GRADIENT), before), np.full(3, 5.0)
        assert note(mode, 3, 1.0, rows, found, marks, work) is (places is not None)
        row = margins.STUCK if mode == 0 else margins.GRAZING
        assert found[row, VALUE] == pytest.approx(least, abs=1e-12)
        for mark, place in zip(marks, places or (-1.0, None, -1.0)):
            assert place is None or mark == pytest.approx(place)


def test_lengths_of_series_and_the_return_of_an_exponential() -> None:
    """Terms of order 7 and 8 may be 1e-6 of the largest early term of v, at x = 2, and of 10 in theta2'."""
    length = plain(step.series_length)
    rows = rows_of(slip=[1.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 4.0], speed=[*[0.0] * 7, 5.0, 6.0])
    limits = [math.log2(1.5e-6) / 6, math.log2(0.75e-6) / 7, math.log2(2e-6) / 7, math.log2(10e-6 / 6.0) / 8]
    assert length(rows, 8, 9.0, 1e-6, 10.0) == pytest.approx(0.95 * 2.0 ** min(limits), rel=0.05)
    for row in (SLIP, SPEED):
        one = rows.copy()
        one[row, 7:] = 0.0
        part = limits[2:] if row == SLIP else limits[:2]
        assert length(one, 8, 9.0, 1e-6, 10.0) == pytest.approx(0.95 * 2.0 ** min(part), rel=0.05)
        assert length(one, 8, 1e-3, 1e-6, 10.0) == 1e-3
    returning = plain(step.returning_at)
    law = (0.5, 0.4, 0.3, 10.0, 0.2, 100.0)
    assert [returning(law, v) for v in (0.1, 1.0, 20.0)] == pytest.approx([0.0, 0.36, 3.6])
    monotone = plain(step.monotone)
    for second, reach, certain in ((0.49, 2.0, True), (0.4996, 2.0, False), (-0.49, 2.0, True), (0.49, 4.01, False)):
        assert monotone(rows_of(slip=[0.0, 1.0, second]), 2, 1.0, reach) is certain


@pytest.mark.parametrize(("up", "down", "event", "x", "direction"), [
    ([1.0, -2.0], [9.0], BREAKAWAY, 0.5, 1), ([9.0], [1.0, -2.0], BREAKAWAY, 0.5, -1),
    ([1.0, -2.0], [1.0, -4.0], BREAKAWAY, 0.25, -1), ([1.0, -0.9], [9.0], NO_EVENT, 1.0, 0),
    ([1.0, 0.5, -1.4], [9.0], NO_EVENT, 1.0, 0)])
def test_stick_ends_at_the_first_zero_of_a_margin(up, down, event, x, direction) -> None:
    found = plain(step.stick_event)(BOUNDS, 1e-3, 1.0, 2, rows_of(up=up, down=down), np.zeros(1, WORK)[0]["bernstein"])
    assert (found.event, found.direction, found.unit) == (event, direction, 1e-3)
    assert found.x == pytest.approx(x)


@pytest.mark.parametrize(("now", "slip", "level", "event", "x"), [
    ({"mode": 1}, [1.0, -2.0], 0.0, REST, 0.5), ({"mode": -1}, [-1.0, 2.0], 0.0, REST, 0.5),
    ({"mode": 1}, [1.0, -2.0], 0.5, LAW_VARIES, 0.25), ({"mode": FREE}, [1.0, -2.0], 0.0, NO_EVENT, 1.0),
    ({"mode": 1}, [1.0, -0.9], 0.0, NO_EVENT, 1.0), ({"mode": 1}, [1.0, 2.0], 0.0, NO_EVENT, 1.0),
    ({"mode": 1, "at_rest": 1}, [0.0, -1e-8, 1.0], 0.0, NO_EVENT, 1.0),
    ({"mode": -1, "at_rest": 1}, [0.0, 1e-8, -1.0], 0.0, NO_EVENT, 1.0)])
def test_slip_ends_at_a_level_but_not_where_it_begins(now, slip, level, event, x) -> None:
    found = plain(step.slip_event)(BOUNDS, 1e-3, 1.0, 2, level, record(setup.STATE, **now), rows_of(slip=slip),
                                   np.zeros(1, WORK)[0]["bernstein"])
    assert (found.event, found.direction, found.reach) == (event, 0, pytest.approx(np.abs(slip[1:]).sum()))
    assert found.x == pytest.approx(x)


@pytest.mark.parametrize(("mode", "v", "stribeck", "degree", "level"), [
    (1, 1.0, (0.5, 2.0), 22, 0.0), (-1, -1.0, (0.5, 2.0), 22, 0.0), (1, 2.03, (0.5, 2.0), 28, 2.0),
    (1, 1.0, None, 28, 0.0), (FREE, 1.0, (0.5, 2.0), 28, 0.0), (1, 1.0, (0.5, 2.0, 0.1, 90.0), 22, 0.4),
    (0, 0.0, (0.5, 2.0), 28, 0.0)])
def test_time_is_scaled_by_the_sum_of_the_rates_of_an_arc(monkeypatch, mode, v, stribeck, degree, level) -> None:
    """500 1/s in slip and 100 in stick; where friction falls alpha |v'| and beta Ts alpha c exp(-alpha |v|) too."""
    arc, ended = plain(step.stick_arc if mode == 0 else step.slip_arc), []
    monkeypatch.setitem(plain(step.slip_arc).__globals__, "slip_event", lambda bounds, unit, x, order, level, *_: (
        ended.append(level) or Step(unit, x, order, NO_EVENT, 0, 0.0)))
    state = record(setup.STATE, mode=mode, slip_speed=v, plate_angle=0.1, plate_speed=-2.0)
    drive, work = record(DRIVE, torque=300.0, load=40.0), np.zeros(1, WORK).view(np.recarray)[0]
    given = (BOUNDS, LINEAR, 300.0, WAVES, 40.0, None, *((stribeck,) if mode else ()), state, drive)
    found = arc(*given, 1e-9, work.rows, work.bernstein)
    rate, sign = 100.0 if mode == 0 else 500.0, float(mode)
    if degree == 22:
        pairs = list(zip(stribeck[::2], stribeck[1::2]))
        law = 1.0 + sum(c * math.exp(-a * abs(v)) for c, a in pairs)
        pull = (matrix_of(LINEAR) @ [v, 0.1, -2.0])[0] + 1500.0 - 55.0 * 40.0 * law * sign
        fastest = 2.0   # The other one has died down.
        rate += fastest * abs(pull) + 55.0 * 40.0 * sum(c * a * math.exp(-a * abs(v)) for c, a in pairs)
    assert (found.degree, found.unit, found.x) == (degree, pytest.approx(1.0 / rate), pytest.approx(1e-9 * rate))
    assert ended == [] if mode == 0 else ended == [level]
    assert 1e-6 < arc(*given, 10.0, work.rows, work.bernstein).x * found.unit < 1.0   # By the last terms.
