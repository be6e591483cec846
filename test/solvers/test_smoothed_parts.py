"""Parts of the smoothed engine as plain Python: regions, edges, lengths, and which method takes the next step."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plain import plain

from tcc_sim.model.equations import Linear, matrix_of
from tcc_sim.solvers import shared_collocation
from tcc_sim.solvers.excitation import DRIVE
from tcc_sim.solvers.series import COLUMNS, ROWS, SLIP, SPEED
from tcc_sim.solvers.smoothed import integrate, sensitivity_series, series_step, switching
from tcc_sim.solvers.smoothed.series_step import LocalFriction
from tcc_sim.solvers.smoothed.setup import ACCEPTED, CONTROL, CREEP, SERIES, STATE, STIFF, Limits, Step
from tcc_sim.solvers.stages import FALLING, LAYER, SLIDING, WORK, Place
from tcc_sim.solvers.terms import Terms

LINEAR = Linear(0.2, 0.02, 0.6, 3000.0, 0.5, 0.3, -0.4)
LAW = (0.25, 2.0)
TERMS = Terms(LINEAR, 300.0, None, None, 400.0, None, 50.0, LAW)
LIMITS = Limits(
    period=0.04, sigma=50.0, rtol=1e-6, slip_floor=2e-4, speed_floor=1e-4, layer_tolerance=2e-5, falling_tolerance=5e-5,
    creep_tolerance=1e-6, layer=0.2, far=8.0, nearly_zero=1e-6, stick_speed=0.06, peak=1.2, creep_speed=0.06,
    base_rate=500.0, fastest=1e6, strength=1e4, beta=55.0, kappa=0.2 / 0.22, slip_decay=22.5, fast_slip=False,
    rest=1e-24, order=16, linear_order=22, resolved=3.0, forgotten=20.0, steps=2000)
TABLES: Any = SimpleNamespace(step_sizes=np.array([(0.01 * 2.0 ** (-0.5 * k),) for k in range(26)],
                                                  [("length", float)]).view(np.recarray))
"""Step sizes of a ladder, s; number 21, the last usual one, is 6.9 us, and number 25 is 1.7 us."""


def record(kind: np.dtype[Any], **values: float) -> Any:
    out = np.zeros(1, kind).view(np.recarray)[0]
    for name, value in values.items():
        out[name] = value
    return out


@pytest.mark.parametrize(("v", "loaded", "torque", "region", "sign", "tolerance"), [
    (0.2 * (1.0 + 0.9e-6), True, 0.0, LAYER, 1.0, 5e-6), (0.2 * (1.0 + 1.1e-6), True, 0.0, FALLING, 1.0, 5e-6),
    (-8.0 * (1.0 + 0.9e-6), True, 0.0, FALLING, -1.0, 8e-6), (-8.0 * (1.0 + 1.1e-6), True, 0.0, SLIDING, -1.0, 8e-6),
    (60.0, True, 0.0, SLIDING, 1.0, 60e-6), (60.0, False, 0.0, SLIDING, 0.0, 60e-6),
    (0.1, False, 0.0, SLIDING, 0.0, 5e-6), (0.0, True, 300.0, LAYER, 1.0, 5e-6), (0.0, True, -300.0, LAYER, -1.0, 5e-6),
    (-0.9e-7, True, 300.0, LAYER, 1.0, 5e-6), (-1.1e-7, True, 300.0, LAYER, -1.0, 5e-6)])
def test_a_state_has_the_region_of_its_speed_and_tolerances_of_two_cycles(v, loaded, torque, region, sign,
                                                                          tolerance) -> None:
    """Near v = 0 the sign is that of v' without friction, (Te - f_w theta2')/I1 + (C theta2' + K theta2)/I2."""
    control = record(CONTROL, slip_before=5.0, speed_now=2.0, speed_before=3.0)
    state = record(STATE, slip_speed=v, plate_angle=-0.002, plate_speed=-4.0)
    place = plain(integrate.region_of)(state, loaded, control, LIMITS, TERMS, record(DRIVE, torque=torque))
    assert (place.region, place.sign) == (region, sign)
    assert place.slip_tolerance == pytest.approx(tolerance, rel=1e-5, abs=0.0)
    assert place.speed_tolerance == pytest.approx(4e-6, rel=1e-12, abs=0.0)
    assert (control.slip_now, control.speed_now) == (abs(v), 4.0)
    assert plain(integrate.edge_of)(place, LIMITS) == (8.0 if region == SLIDING else 0.2)


def test_tolerances_have_caps_where_friction_varies_and_floors_where_all_is_slow() -> None:
    region_of, drive = plain(integrate.region_of), record(DRIVE, torque=300.0)
    for v, before, loaded, slip, speed in (
            (0.1, 60.0, True, 2e-5, 6e-8), (0.5, 60.0, True, 5e-5, 6e-8), (0.5, 60.0, False, 6e-5, 6e-8),
            (0.0, 0.0, True, 2e-10, 1e-10), (0.0, 1e-4, True, 2e-10, 1e-10), (0.0, 5.0, True, 5e-6, 5e-9)):
        control = record(CONTROL, slip_before=before)
        place = region_of(record(STATE, slip_speed=v), loaded, control, LIMITS, TERMS, drive)
        assert (place.slip_tolerance, place.speed_tolerance) == pytest.approx((slip, speed), rel=1e-12, abs=0.0)
    for torque, sign in ((123.12, 1.0), (123.08, -1.0)):   # Te/I1 is 615.6 or 615.4, and K theta2/I2 is -615.5 rad/s^2.
        state = record(STATE, plate_angle=-12.31 / 3000.0)
        drive = record(DRIVE, torque=torque)
        assert region_of(state, True, record(CONTROL), LIMITS, TERMS, drive).sign == sign


@pytest.mark.parametrize("side", [1, -1])
def test_a_step_leaves_its_region_at_0_or_at_the_edge_on_the_way_down(side) -> None:
    work = np.zeros(1, WORK).view(np.recarray)[0]
    boundary = plain(integrate.first_boundary)
    for region, method, start, loaded, law, expected in (
            (LAYER, SERIES, 0.1, True, LAW, 0.1), (LAYER, SERIES, 0.1, True, None, math.inf),
            (FALLING, SERIES, 0.5, True, LAW, 0.3), (FALLING, CREEP, 0.5, True, LAW, 0.5),
            (SLIDING, STIFF, 8.5, True, LAW, 0.5), (SLIDING, SERIES, 8.5, True, None, 0.5),
            (FALLING, SERIES, 0.5, False, LAW, math.inf), (FALLING, SERIES, 1.5, True, LAW, math.inf)):
        work.rows[SLIP, :2] = side * start, -side
        found = boundary(Place(region, float(side), 1e-6, 1e-6), 2, 1.0, method, loaded, LIMITS, law, work)
        assert found == (expected if math.isinf(expected) else pytest.approx(expected, abs=3e-6))
        assert work.bernstein[0, :3] == pytest.approx(side * np.array([start, start - 0.5, start - 1.0]))


def test_friction_and_the_rates_of_a_region() -> None:
    state = record(STATE, slip_speed=0.5, plate_angle=0.03, plate_speed=-2.0)
    drive = record(DRIVE, torque=300.0, load=400.0)
    friction = plain(series_step.friction_here)(Place(FALLING, 1.0, 0.0, 0.0), state, LIMITS, TERMS, drive)
    law = 1.0 + 0.25 * math.exp(-1.0)
    expected = (matrix_of(LINEAR) @ [0.5, 0.03, -2.0])[0] + 300.0 / 0.2 - 400.0 * law * 55.0
    assert friction == pytest.approx((law, -0.5 * math.exp(-1.0), 0.25 * math.exp(-1.0), 1.0, 0.0, expected))
    rate = plain(series_step.rate_of_law)
    assert [rate(region, 50.0, law) for region in (SLIDING, FALLING, LAYER) for law in (None, LAW)] == [
        0.0, 0.0, 0.0, 2.0, 50.0, 52.0]
    rows = np.zeros((ROWS, COLUMNS))
    rows[SLIP, 7:9], rows[SPEED, 7:9] = [2.0, 4.0], [5.0, 6.0]
    length = plain(series_step.series_length)
    for tolerance, sizes in ((1e-8, (5e8, 6e8)), (1e-5, (2e6, 4e6))):
        expected = min(sizes[0] ** (-1.0 / 7.0), sizes[1] ** (-1.0 / 8.0))
        assert length(rows, 8, 1e-6, tolerance) == pytest.approx(0.905 * expected, rel=0.02)
    assert length(0.0 * rows, 8, 1e-6, 1e-6) > 1e200
    for row in (SLIP, SPEED):
        broken = rows.copy()
        broken[row, 8] = math.inf
        assert math.isnan(length(broken, 8, 1e-6, 1e-6))


def test_the_next_length_follows_the_error_and_the_ladder() -> None:
    growth, below = plain(shared_collocation.growth), plain(shared_collocation.step_size_below)
    for error, factor in ((1.0, 0.85), (2.0**-16, 1.7), (2.0**16, 0.425), (2.0**40, 0.25),
                          (1e-12, 0.85 * 1e9 ** (1.0 / 16.0))):
        assert growth(error) == pytest.approx(factor)
    sizes = TABLES.step_sizes
    for level, length, found in ((0, 0.01, 0), (0, 0.00999, 1), (3, 0.01, 3), (0, 0.005, 2), (0, 0.0, 26),
                                 (26, 1.0, 26)):
        assert below(sizes, level, length) == found


def test_derivatives_end_a_step_that_the_motion_would_go_on_with() -> None:
    """resolved = 3: of a decay rate times length, of alpha times the change of v, and 0.7 of it of a sine's angle."""
    assert plain(sensitivity_series.reach_of)(LIMITS, 0.0) == math.inf
    assert plain(sensitivity_series.reach_of)(LIMITS, 100.0) == pytest.approx(0.021)
    rows, drive = np.zeros((ROWS, COLUMNS)), record(DRIVE, load=400.0)
    linear, layer = 30.0 + 22.5, 55.0 * 400.0 * 0.5
    for region, slope, x, fastest, change, stribeck, expected, rate in (
            (SLIDING, 0.5, 1.0, 0.0, 0.0, LAW, 1.0, linear), (SLIDING, 0.5, 90.0, 0.0, 0.0, LAW, 3e3 / linear, linear),
            (LAYER, 0.5, 1.0, 0.0, 0.0, LAW, 3e3 / (linear + layer), linear + layer),
            (LAYER, -0.5, 1.0, 0.0, 0.0, LAW, 1.0, linear), (SLIDING, 0.5, 90.0, 1e3, 0.0, LAW, 2.1, linear),
            (FALLING, 0.5, 1.0, 0.0, 1.4, LAW, 1.0, linear), (FALLING, 0.5, 1.0, 0.0, 1.6, LAW, 0.85, linear),
            (SLIDING, 0.5, 1.0, 0.0, 1.6, LAW, 1.0, linear), (FALLING, 0.5, 1.0, 0.0, 1.6, None, 1.0, linear)):
        control = record(CONTROL, unsettled=20.0)
        for row in (1, 2):
            rows[SLIP, 1:3] = 0.0
            rows[SLIP, row] = -change
            control.unsettled = 20.0
            found = plain(sensitivity_series.resolved)(
                Step(ACCEPTED, 1e-3, x, 8, 0.0), Place(region, 1.0, 0.0, 0.0),
                LocalFriction(1.0, slope, 0.0, 0.0, 0.0, 0.0), rows, stribeck, control, LIMITS, TERMS, drive, fastest)
            assert found == pytest.approx(expected)
            assert control.unsettled == pytest.approx(20.0 - rate * 1e-3 * expected)


def test_the_slow_manifold_is_where_the_balance_moves_on() -> None:
    """delta = (v' - v_s')/rho, with rho v_s' the rate of v' = 0 by differences along the stuck motion."""
    state, drive = record(STATE, plate_angle=0.03, plate_speed=-2.0), record(
        DRIVE, torque=300.0, torque_rate=4000.0, load=400.0, load_rate=-3000.0)
    law, rho = 0.6, 1e5

    def push(t: float, theta: float, w: float) -> float:
        """v' of the linear part and friction at constant mubar."""
        engine, load = 300.0 + 4000.0 * t - 0.3 * w, 400.0 - 3000.0 * t
        return engine / 0.2 + (0.6 * w + 3000.0 * theta) / 0.02 - 55.0 * load * law

    pull, h = (300.0 - 0.6 * -2.0 - 3000.0 * 0.03 - 0.3 * -2.0) / 0.22, 1e-6
    rate = (push(h, 0.03 - 2.0 * h, -2.0 + pull * h) - push(-h, 0.03 + 2.0 * h, -2.0 - pull * h)) / (2.0 * h)
    friction = LocalFriction(law, 1.0, 0.0, 0.0, 0.0, 7.0)
    found = plain(switching.distance_to_creep)(friction, rho, state, LIMITS, TERMS, drive)
    assert found == pytest.approx((7.0 - rate / rho) / rho, rel=1e-5, abs=0.0)


NEAR, FAR = 1.9e-6, 2.1e-6
"""Distances from the slow manifold below and above two tolerances, where the slope of mubar is sigma."""


@pytest.mark.parametrize(("delta", "change", "limits", "remaining", "entered"), [
    (NEAR, {}, {}, 0.01, "moved"), (-NEAR, {}, {}, 0.01, "moved"), (FAR, {}, {}, 0.01, ""),
    (NEAR, {"unsettled": 0.1}, {}, 0.01, ""), (NEAR, {"v": 0.061}, {}, 0.01, ""),
    (NEAR, {"v": -0.059}, {}, 0.01, "moved"), (NEAR, {"v": 3.1 * NEAR}, {}, 0.01, "moved"),
    (NEAR, {"v": 2.9 * NEAR}, {}, 0.01, ""), (NEAR, {}, {}, 1.8e-6, "moved"), (NEAR, {}, {}, 1.7e-6, ""),
    # Steps of 6.9 us must be twice as long as 1/rho; flat friction weighs as if its slope were sigma/25.
    (1e-7, {"slope": 13.4}, {}, 0.01, "moved"), (1e-7, {"slope": 13.0}, {}, 0.01, ""),
    (4.9e-5, {"slope": 0.28, "load": 4e5}, {}, 0.01, "moved"), (5.1e-5, {"slope": 0.28, "load": 4e5}, {}, 0.01, ""),
    # The series have taken over at a rate, and have made some steps since.
    (NEAR, {"released": 3.9e5}, {}, 0.01, ""), (NEAR, {"released": 3.6e5}, {}, 0.01, "moved"),
    (NEAR, {"released": 3.9e5, "waited": 7}, {}, 0.01, ""), (NEAR, {"released": 3.9e5, "waited": 8}, {}, 0.01, "moved"),
    # After many steps in the layer, or many of one length with a fast decay, the second order alone counts.
    (7e-5, {"waited": 31}, {}, 0.01, ""), (7e-5, {"waited": 32}, {}, 0.01, "there"),
    (8e-5, {"waited": 32}, {}, 0.01, ""), (7e-5, {"streak": 17, "patience": 16}, {"fast_slip": True}, 0.01, "there"),
    (7e-5, {"streak": 16, "patience": 16}, {"fast_slip": True}, 0.01, ""),
    (7e-5, {"streak": 17, "patience": 16}, {}, 0.01, "")])
def test_creep_begins_near_the_slow_manifold(monkeypatch, delta, change, limits, remaining, entered) -> None:
    given = {"slope": 50.0, "v": 0.05, "load": 400.0, **change}
    slope, v, load = (given.pop(name) for name in ("slope", "v", "load"))
    rho = 55.0 * load * slope + 22.5
    monkeypatch.setitem(plain(switching.enter_creep).__globals__, "distance_to_creep", lambda *_: delta)
    state = record(STATE, slip_speed=v, plate_angle=0.03, plate_speed=-2.0)
    control = record(CONTROL, calm=8, **given)
    found = plain(switching.enter_creep)(
        Place(LAYER, 1.0, 0.0, 0.0), LocalFriction(0.6, slope, 0.0, 0.0, 0.0, 0.0), remaining, state, control,
        LIMITS._replace(**limits), TERMS, record(DRIVE, load=load), TABLES)
    assert found is bool(entered)
    moved = delta if entered == "moved" else 0.0
    assert (state.slip_speed, state.plate_speed, state.plate_angle) == pytest.approx(
        (v + moved, -2.0 - moved / 1.1, 0.03 + moved / 1.1 / rho), rel=3e-16, abs=0.0)
    # The first step is a fifth of a cycle at most, 8 ms: number 1 of the ladder is 7.1 ms.
    assert (control.method, control.rate, control.level) == (
        (CREEP, pytest.approx(rho), 1) if entered else (SERIES, 0.0, 0))


@pytest.mark.parametrize(("region", "acceleration", "v", "given", "fast", "enters", "expected"), [
    # In the layer creep is tried; outside, the waiting begins anew.
    (LAYER, 0.0, 0.1, {"waited": 5}, False, True, {"waited": 5}), (LAYER, 0.0, 0.1, {"waited": 5}, False, False, {}),
    (FALLING, 0.0, 1.0, {"waited": 5, "released": 9.0, "calm": 64}, False, False, {
        "waited": 0, "released": 0.0, "calm": 8}),
    # After steps of equal lengths, 2 ms here, a stiff step of 8 lengths is tried, 10 ms being the longest.
    (SLIDING, 0.0, 9.0, {"streak": 16, "patience": 16, "last": 2e-4}, False, False, {"calm": 8}),
    (SLIDING, 0.0, 9.0, {"streak": 17, "patience": 16, "last": 2e-4}, False, False, {
        "method": STIFF, "streak": 0, "patience": 32, "level": 6, "calm": 8}),
    (SLIDING, 0.0, 9.0, {"streak": 999, "patience": 600, "last": 2e-3}, False, False, {
        "method": STIFF, "streak": 0, "patience": 1024, "level": 0, "calm": 8}),
    (LAYER, 0.0, 0.1, {"streak": 17, "patience": 16, "last": 1e-9}, False, False, {
        "method": STIFF, "streak": 0, "patience": 32, "level": 25}),
    # Towards the layer, 0.8 rad/s away, a fast fall leaves half the time until then: 4 ms, and 6 ms to be near.
    (FALLING, -100.0, 1.0, {"streak": 17, "patience": 16, "last": 2e-3}, True, False, {"calm": 8}),
    (FALLING, -50.0, 1.0, {"streak": 17, "patience": 16, "last": 2e-3}, True, False, {
        "method": STIFF, "streak": 0, "patience": 32, "level": 1, "calm": 8}),
    (FALLING, -100.0, 1.0, {"method": STIFF, "streak": 8}, True, False, {"method": SERIES, "streak": 0, "calm": 8}),
    (FALLING, -100.0, 1.0, {"method": STIFF, "streak": 9}, True, False, {}),
    (FALLING, -50.0, 1.0, {"method": STIFF, "streak": 8}, True, False, {"level": 1}),
    (FALLING, 50.0, 1.0, {"method": STIFF, "streak": 8}, True, False, {}),
    (FALLING, -50.0, 1.0, {"method": STIFF, "streak": 8}, False, False, {}),
    (SLIDING, -50.0, 9.0, {"method": STIFF, "streak": 8}, True, False, {}),
    (LAYER, 0.0, 0.1, {"method": CREEP, "waited": 5}, False, True, {})])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_method_is_chosen_by_the_steps_so_far(monkeypatch, region, acceleration, v, given, fast, enters, expected,
                                                  side) -> None:
    choose = plain(switching.choose_method)
    monkeypatch.setitem(choose.__globals__, "enter_creep", lambda *_: enters)
    control = record(CONTROL, **given)
    before = dict(zip(CONTROL.names or (), control.item()))
    found = choose(Place(region, side, 0.0, 0.0), LocalFriction(1.0, 0.0, 0.0, 0.0, 0.0, side * acceleration), 0.01,
                   record(STATE, slip_speed=side * v), control, LIMITS._replace(fast_slip=fast), TERMS, record(DRIVE),
                   TABLES)
    assert found is (enters and before["method"] == SERIES)
    assert dict(zip(CONTROL.names or (), control.item())) == {**before, **expected}


@pytest.mark.parametrize(("call", "given", "fast", "expected"), [
    # A step in stick must be 20 times as long as 1/rate, and one of a stiff linear part 3 times as 1/(500 + |rate|).
    ("leave", {"method": CREEP, "level": 0, "rate": 2001.0, "calm": 8}, False, {}),
    ("leave", {"method": CREEP, "level": 0, "rate": 1999.0, "calm": 8, "waited": 4}, False, {
        "method": SERIES, "released": 1999.0, "waited": 0, "calm": 16}),
    ("leave", {"method": CREEP, "level": 26, "rate": 1e9, "calm": 200}, False, {
        "method": SERIES, "released": 1e9, "calm": 256}),
    ("leave", {"method": STIFF, "level": 1, "rate": 0.0}, False, {}),
    ("leave", {"method": STIFF, "level": 2, "rate": -101.0}, False, {}),
    ("leave", {"method": STIFF, "level": 2, "rate": -99.0}, False, {"method": SERIES}),
    ("leave", {"method": SERIES, "level": 26}, False, {}),
    # The next length: the same, a longer one by the error or after 17 steps, and a shorter one.
    (1.0, {"method": CREEP, "level": 4, "rate": 1e6}, False, {"level": 5, "streak": 1}),
    (2.0**-10, {"method": CREEP, "level": 4, "rate": 1e6}, False, {"level": 4, "streak": 1}),
    (2.0**-12, {"method": CREEP, "level": 4, "rate": 1e6}, False, {"level": 3, "streak": 1}),
    (2.0**-30, {"method": CREEP, "level": 4, "rate": 1e6}, False, {"level": 1, "streak": 1}),
    (2.0**-30, {"method": CREEP, "level": 1, "rate": 1e6}, False, {"level": 0, "streak": 1}),
    (1.0, {"method": CREEP, "level": 4, "rate": 1e6, "streak": 15}, False, {"level": 5, "streak": 16}),
    (1.0, {"method": CREEP, "level": 4, "rate": 1e6, "streak": 16}, False, {"level": 3, "streak": 17}),
    (1.0, {"method": CREEP, "level": 0, "rate": 1e6, "streak": 16}, False, {"level": 1, "streak": 17}),
    (0.9 * 2.0**-8, {"method": STIFF, "level": 1}, True, {"level": 0, "streak": 1, "patience": 2}),
    (1.1 * 2.0**-8, {"method": STIFF, "level": 1}, True, {"level": 1, "streak": 1, "patience": 2}),
    (0.9 * 2.0**-8, {"method": STIFF, "level": 1}, False, {"level": 1, "streak": 1, "patience": 16}),
    (0.9 * 2.0**-8, {"method": CREEP, "level": 1, "rate": 1e6}, True, {"level": 1, "streak": 1}),
    (1.0, {"method": CREEP, "level": 4, "rate": 1.0, "calm": 8}, False, {
        "level": 5, "streak": 1, "method": SERIES, "released": 1.0, "calm": 16})])
def test_the_next_step_size_or_method_follows_from_a_step(call, given, fast, expected) -> None:
    control, limits = record(CONTROL, **given), LIMITS._replace(fast_slip=fast)
    before = dict(zip(CONTROL.names or (), control.item()))
    if call == "leave":
        plain(switching.leave_if_short)(control, limits, TABLES)
    else:
        length = TABLES.step_sizes[given["level"]].length
        plain(switching.after_step)(Step(ACCEPTED, length, 1.0, 16, call), 1.0, control, limits, TABLES)
    assert dict(zip(CONTROL.names or (), control.item())) == {**before, **expected}


def test_series_steps_of_equal_length_are_counted_and_a_cycle_begins_anew() -> None:
    after_step, control = plain(switching.after_step), record(CONTROL, last=1e-3, streak=4)
    for x, streak in ((1.05, 5), (0.96, 6), (1.2, 0), (1.0, 0), (1.1, 1)):
        after_step(Step(ACCEPTED, 1e-3, 9.0, 16, 0.0), x, control, LIMITS, TABLES)
        assert (control.streak, control.last) == (streak, pytest.approx(1e-3 * x))
    assert control.waited == 5
    control.method = STIFF   # A part of a step of collocation changes nothing.
    before = control.item()
    after_step(Step(ACCEPTED, 1e-3, 1.0, 16, 0.0), 0.5, control, LIMITS, TABLES)
    assert control.item() == before
    state = record(STATE, slip_speed=-3.0, plate_speed=-4.0)
    for fast, patience in ((False, 16), (True, 2)):
        control = np.full(1, 9, CONTROL).view(np.recarray)[0]
        plain(switching.begin)(state, control, LIMITS._replace(fast_slip=fast))
        values = dict(zip(CONTROL.names or (), control.item()))
        assert values == {**dict.fromkeys(values, 0), "slip_now": 3.0, "speed_now": 4.0, "calm": 8,
                          "patience": patience}
        control.slip_now, control.speed_now, control.streak, control.patience = 7.0, 8.0, 5, 99
        plain(switching.begin_cycle)(state, control, LIMITS._replace(fast_slip=fast))
        assert (control.slip_before, control.slip_now, control.speed_before, control.speed_now, control.streak,
                control.patience) == (7.0, 3.0, 8.0, 4.0, 0, patience)
