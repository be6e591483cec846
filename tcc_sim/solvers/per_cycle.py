"""Per-cycle results from samples: cubics through states and the accelerations that the equations give.

Derivatives and peaks do not cross a jump, which has two samples a rounding apart.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError
from tcc_sim.model.equations import Linear, coefficients_of
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import TIME
from tcc_sim.solvers.terms import Terms, far_end_along, rates_along, stick_speed_of
from tcc_sim.trajectory import STILL, Cycles, FarEnd, Floats, Loads

BENT = 4.0
"""Largest ratio of second differences of power at neighbouring samples of a smooth top."""


def slopes_between_jumps(t: Floats, y: Floats) -> Floats:
    """Return derivatives of samples, of second order within each piece between jumps; 0 for a single sample."""
    out: Floats = np.zeros(len(t))
    jumps = np.flatnonzero(np.diff(t) <= 2.0 * np.spacing(t[1:])) + 1
    for a, b in pairwise([0, *jumps.tolist(), len(t)]):
        if b - a > 1:
            out[a:b] = np.gradient(y[a:b], t[a:b], edge_order=2 if b - a > 2 else 1)
    return out


def with_peaks(t: Floats, y: Floats) -> Floats:
    """Return samples with maxima raised to the vertex of the parabola through each and its neighbours.

    A maximum beside a jump stays as it is, and one whose parabola is bent `BENT` times as much as a neighbour's: such
    samples show no smooth top.
    """
    out: Floats = np.array(y)
    if len(y) < 3:
        return out
    h = np.diff(t)
    apart = h <= 2.0 * np.spacing(t[1:])
    slope = np.diff(y) / h
    left, right = slope[:-1], slope[1:]
    bend = np.where(apart[:-1] | apart[1:], 0.0, (right - left) / (h[:-1] + h[1:]))
    tilt = (left * h[1:] + right * h[:-1]) / (h[:-1] + h[1:])
    neighbours = np.concatenate([bend[1:2], bend, bend[-2:-1]]) if len(bend) > 1 else np.tile(bend, 3)
    # A neighbour beside a jump has no parabola of its own, and leaves the other one to say.
    least = np.fmax(np.where(neighbours[:-2] == 0.0, np.nan, neighbours[:-2]), np.where(neighbours[2:] == 0.0, np.nan,
                                                                                        neighbours[2:]))
    top = (left >= 0.0) & (right <= 0.0) & (bend < 0.0) & (BENT * least <= bend)
    out[1:-1] += np.where(top, tilt**2 / np.where(top, -4.0 * bend, 1.0), 0.0)
    return out


STAMP = 1e-9
"""Loss of a cycle by the rounding of stamps to whole nanoseconds, s."""
ROUNDING = 1e-12
"""Times closer than this are equal, s."""
LAYER = 7.0
"""Half width of the layer in which the smoothed law is stiff, in stick speeds: tanh is 1 to rounding beyond it."""


def starts_of(system: System | None, first: int, end: float, cycle: float = 0.0) -> Floats:
    """Return the times at which engine cycle `first` and later ones start, up to `end`, s: (m + 1,) for m whole cycles.

    system : its frequency may vary in time; without one cycles are `cycle` s long
    """
    if system is None or system.profile is None:
        cycle = cycle if system is None else system.cycle
        count = max(int(np.floor((end + 1e-9 * cycle) / cycle)) - first, 0)
        return np.asarray((first + np.arange(count + 1)) * cycle, dtype=np.float64)
    count = max(int(np.floor(system.cycles_until(end) + 1e-9)) - first, 0)
    return np.asarray(system.cycle_start(first + np.arange(count + 1)), dtype=np.float64)


def cycles_of_states(t: Floats, states: Floats, terms: Terms, starts: Floats) -> Cycles:
    """Return the cycles of states (n, 3 or 4) of the smoothed law, cut where the excitation has a corner or a jump.

    Every such time gets two samples, one just before it with the rates until then, and one with the rates from then on,
    so that no interpolation crosses it. A missing state there is extrapolated from both sides.

    t, starts : (n,) and (m + 1,) times, s, as `cycles_from_samples` takes them
    """
    states = states[:, :3]
    if terms.profile is not None:
        breaks = terms.profile[:, TIME]
        breaks = breaks[(breaks > t[0]) & (breaks < t[-1])]
        near = np.clip(np.searchsorted(t, breaks - ROUNDING), 0, len(t) - 1)
        new = breaks[np.abs(t[near] - breaks) > ROUNDING]
        if len(new):
            right = np.searchsorted(t, new)
            rates = rates_along(t, states, terms)
            share = ((new - t[right - 1]) / (t[right] - t[right - 1]))[:, None]
            from_left = states[right - 1] + (new - t[right - 1])[:, None] * rates[right - 1]
            from_right = states[right] + (new - t[right])[:, None] * rates[right]
            t, states = np.insert(t, right, new), np.insert(
                states, right, (1.0 - share) * from_left + share * from_right, axis=0)
        at = np.searchsorted(t, breaks - ROUNDING)
        t = np.array(t)
        t[at] = breaks
        t, states = np.insert(t, at, np.nextafter(breaks, -np.inf)), np.insert(states, at, states[at], axis=0)
    held = np.array(t)
    if terms.profile is not None:
        held[-1] = np.nextafter(t[-1], -np.inf)  # Samples that end at a jump end before it.
    slip, _, plate = rates_along(held, states, terms).T
    return cycles_from_samples(t, states[:, 0], slip, states[:, 1], states[:, 2], plate, starts=starts,
                               stick_speed=stick_speed_of(terms), linear=terms.linear, far=far_end_along(held, terms))


def cycles_from_samples(t: Floats, slip_speed: Floats, slip_acceleration: Floats, plate_angle: Floats,
                        plate_speed: Floats, plate_acceleration: Floats, *, starts: Floats,
                        stick_speed: float, linear: Linear | None = None, far: FarEnd = STILL,
                        bridged: NDArray[np.bool_] | None = None) -> Cycles:
    """Return the results of each whole engine cycle within the samples.

    The slip speed is the piecewise cubic through v and v', which gives the section, all extremes and the time within
    +-stick_speed. The plate angle is interpolated by a quintic, the plate speed by a cubic. The error is of order h^4
    on smooth arcs, of order h J where v' jumps by J between two samples.

    t : (n,) array, s, strictly increasing, not necessarily uniform; cycle ends need not be among them
    slip_speed, slip_acceleration : (n,) arrays, rad/s, rad/s^2
    plate_angle, plate_speed, plate_acceleration : (n,) arrays, rad, rad/s, rad/s^2
    starts : (m + 1,) array, s, increasing: where the m cycles start, and where the last of them ends (`starts_of`)
    stick_speed : |v| at or below which the clutch sticks, rad/s; 0 for the set-valued law, whose stick is v = 0 exactly
    linear : linear part, for the loads of clutch and shaft; None without them
    far : motion of the shaft's far end
    bridged : (n - 1,) intervals in which a sample is missing; None for none. They have section points, and nothing else
        between their ends: no energy, no time in stick and no extremes
    returns : Cycles, m of them; extremes are NaN in a cycle without a sample

    Raises InputError: fewer than two samples, times that do not increase, or cycles beyond the samples.
    """
    t = np.asarray(t, dtype=np.float64)
    _check_times(t, starts)
    grid = _grid(t, starts, bridged)
    left, h, u = grid.left, grid.h, grid.u
    v, a = np.asarray(slip_speed, dtype=np.float64), np.asarray(slip_acceleration, dtype=np.float64)
    at_starts, p, dp, q, dq = _cut(grid, v, *_without_overshoot(t, v, a, stick_speed))
    section = np.stack([at_starts, _quintic(u, h, left, plate_angle, plate_speed, plate_acceleration),
                        _cubic(u, plate_speed[left], h * plate_acceleration[left], plate_speed[left + 1],
                               h * plate_acceleration[left + 1])], axis=1)
    if stick_speed == 0.0:
        rest = (p == 0.0) & (q == 0.0)
        dp, dq = np.where(rest, 0.0, dp), np.where(rest, 0.0, dq)
    turns = _turning_points(p, dp, q, dq)
    values = _cubic(turns, p[:, None], dp[:, None], q[:, None], dq[:, None])
    width = grid.width if grid.hidden is None else np.where(grid.hidden, 0.0, grid.width)
    within = width * _share_within(turns, values, p, dp, q, dq, stick_speed)
    if stick_speed == 0.0:
        within += width * _share_at_rest(*_cut(grid, v, a[:-1], a[1:])[1:])
    loads = None if linear is None else _loads(grid, v, a, np.asarray(plate_angle), np.asarray(plate_speed),
                                               np.asarray(plate_acceleration), section, stick_speed, linear, far)
    return Cycles(section, *_extremes(grid, values), np.add.reduceat(within, grid.pieces), loads, starts)


class _Grid(NamedTuple):
    """Samples at times t, (n,), and where the cycles start between them, at `starts`, (m + 1,).

    place, left, h, u : for every start, the number of samples before it, the interval, its length, s, and the part of
        it before the start
    inside, between : of all samples and starts in order, those from the first start to the last, and the intervals
    width : lengths of these intervals, s
    pieces : (m,) the first of these in each cycle
    hidden : which of these intervals lie where a sample is missing; None for none
    neighbours : which samples are neighbours of a missing one; None for none
    """

    t: Floats
    starts: Floats
    place: NDArray[np.int64]
    left: NDArray[np.int64]
    h: Floats
    u: Floats
    inside: slice
    between: slice
    width: Floats
    pieces: NDArray[np.int64]
    hidden: NDArray[np.bool_] | None = None
    neighbours: NDArray[np.bool_] | None = None


def _grid(t: Floats, starts: Floats, bridged: NDArray[np.bool_] | None = None) -> _Grid:
    place = np.searchsorted(t, starts, side="right")
    left = np.clip(place - 1, 0, len(t) - 2)
    h = t[left + 1] - t[left]
    u = np.clip((starts - t[left]) / h, 0.0, 1.0)
    first, last = int(place[0]), int(place[-1]) + len(starts)
    inside, between = slice(first, last), slice(first, last - 1)
    grid = _Grid(t, starts, place, left, h, u, inside, between,
                 np.maximum(np.diff(np.insert(t, place, starts)[inside]), 0.0),
                 (place + np.arange(len(starts)) - first)[:-1])
    if bridged is None or not bridged.any():
        return grid
    return grid._replace(hidden=np.insert(bridged, left + 1, bridged[left])[between],
                         neighbours=np.append(bridged, False) | np.append(False, bridged))


def _extremes(grid: _Grid, values: Floats) -> tuple[Floats, Floats]:
    """Return largest and smallest value of each cycle, from the values at the turning points of the intervals, (k, 4).

    Where a sample is missing, only the samples beside it count.
    """
    high, low = values.max(axis=1), values.min(axis=1)
    if grid.hidden is None:
        return np.maximum.reduceat(high, grid.pieces), np.minimum.reduceat(low, grid.pieces)
    sampled = np.insert(np.ones(len(grid.t), np.bool_), grid.place, (grid.u == 0.0) | (grid.u == 1.0))[grid.inside]
    begin, end = (np.where(known, values[:, k], np.nan) for known, k in ((sampled[:-1], 0), (sampled[1:], -1)))
    return (np.fmax.reduceat(np.where(grid.hidden, np.fmax(begin, end), high), grid.pieces),
            np.fmin.reduceat(np.where(grid.hidden, np.fmin(begin, end), low), grid.pieces))


def _check_times(t: Floats, starts: Floats) -> None:
    """Raise InputError if times of samples do not increase, or engine cycles do not lie within them."""
    if t.ndim != 1 or len(t) < 2 or not np.all(np.diff(t) > 0.0):
        raise InputError("sample times must be two or more and strictly increasing")
    slack = STAMP + 1e-8 * float(starts[1] - starts[0] if len(starts) > 1 else t[-1] - t[0])
    if starts[0] < t[0] - slack or (len(starts) > 1 and starts[-1] > t[-1] + slack):
        raise InputError(f"periods of excitation from {starts[0]:g} to {starts[-1]:g} s must lie within the samples, "
                         f"which go from {t[0]:g} to {t[-1]:g} s")


def _loads(grid: _Grid, v: Floats, slip: Floats, angle: Floats, speed: Floats, plate: Floats, section: Floats,
           stick_speed: float, linear: Linear, far: FarEnd) -> Loads:
    """Return the loads of clutch and shaft, with the torques from (2a) and (2b).

    The clutch's energy is the engine's work less the other dissipation and the change of the stored energy, so that no
    integrand has the jumps of Tf.
    """
    t, starts, place = grid.t, grid.starts, grid.place
    i1, i2, damping, stiffness, by_slip, plate_by_slip = coefficients_of(linear)
    h = np.diff(t)
    far_angle, far_speed, far_acceleration = np.broadcast_to(far.angle, t.shape), far.speed, far.acceleration
    twist, twisting, jerking = angle - far_angle, speed - far_speed, plate - far_acceleration
    shaft, rise = damping * twisting + stiffness * twist, damping * jerking + stiffness * twisting
    friction = i2 * plate + shaft + plate_by_slip * v
    lost, losing = by_slip * v, by_slip * slip
    engine = friction + i1 * (slip + plate) + lost
    net = ((engine - lost) * (v + speed) - plate_by_slip * v * speed - damping * twisting**2 - shaft * far_speed)
    change = ((slopes_between_jumps(t, engine) - losing) * (v + speed) + (engine - lost) * (slip + plate)
              - plate_by_slip * (slip * speed + v * plate)
              - 2.0 * damping * twisting * jerking - rise * far_speed - shaft * far_acceleration)
    passed, total = -plate_by_slip * integral_of(h, v * v, 2.0 * v * slip), integral_of(h, net, change)

    def stored(v: Floats, angle: Floats, speed: Floats) -> Floats:
        """Kinetic energy of both inertias and energy of the twisted shaft."""
        return 0.5 * (i1 * (v + speed) ** 2 + i2 * speed**2 + stiffness * angle**2)

    put_in, through = hermite(starts, t, total, net), hermite(starts, t, passed, -plate_by_slip * v * v)
    held = stored(section[:, 0], section[:, 1] - np.interp(starts, t, far_angle), section[:, 2])
    energy, heat = np.diff(put_in) - np.diff(held), np.diff(through)
    power = friction * v
    top = with_peaks(t, power)
    if grid.hidden is not None and grid.neighbours is not None:
        lost = np.diff((np.insert(total, place, put_in) - np.insert(stored(v, twist, speed), place, held))[grid.inside])
        energy -= np.add.reduceat(np.where(grid.hidden, lost, 0.0), grid.pieces)
        lost = np.diff(np.insert(passed, place, through)[grid.inside])
        heat -= np.add.reduceat(np.where(grid.hidden, lost, 0.0), grid.pieces)
        top = np.where(grid.neighbours, power, top)
    power = np.insert(top, place, np.interp(starts, t, power))[grid.inside]
    _, p, dp, q, dq = _cut(grid, shaft, rise[:-1], rise[1:])
    torques = _cubic(_turning_points(p, dp, q, dq), p[:, None], dp[:, None], q[:, None], dq[:, None])
    stuck = np.abs(v) <= stick_speed
    first = grid.left
    # A value at the start of the last cycle (or of the only one) is there, also where that cycle has no sample.
    breakaways = (stuck[:-1] & ~stuck[1:])[:max(int(first[-1]) + int(grid.u[-1] == 1.0), int(first[-2:][0]) + 1)]
    return Loads(energy, _extremes(grid, np.stack([power[:-1], power[1:]], axis=1))[0],
                 *_extremes(grid, torques), np.add.reduceat(breakaways.astype(np.float64), first[:-1]), heat)


def integral_of(h: Floats, values: Floats, rates: Floats) -> Floats:
    """Return the integral from the first sample to each, (n,), of the cubics between samples h s apart."""
    parts = h * (0.5 * (values[:-1] + values[1:]) + h / 12.0 * (rates[:-1] - rates[1:]))
    return np.concatenate([[0.0], np.cumsum(parts)])


def _cut(grid: _Grid, y: Floats, leaving: Floats, arriving: Floats) -> tuple[Floats, ...]:
    """Return values at the starts, and the cubics between samples and starts from the first start to the last, p, dp,
    q, dq, by values y, (n,), and slopes at both ends of every interval, (n - 1,) each.
    """
    left, h = grid.left, grid.h
    about_starts = y[left], h * leaving[left], y[left + 1], h * arriving[left]
    slope, at_starts = _cubic_slope(grid.u, *about_starts) / h, _cubic(grid.u, *about_starts)
    values = np.insert(y, grid.place, at_starts)[grid.inside]
    return (at_starts, values[:-1], grid.width * np.insert(leaving, left + 1, slope)[grid.between],
            values[1:], grid.width * np.insert(arriving, left, slope)[grid.between])


def _without_overshoot(t: Floats, v: Floats, a: Floats, stick_speed: float) -> tuple[Floats, Floats]:
    """Return slopes at both ends of every interval, (n - 1,) each, limited where an interval lands in the stick layer.

    There the slope at one end lasts for a part of the interval only, and the cubic would swing beyond both ends:
    dp + dq = 2 (q - p) + O(h^3) does not hold, as it does on smooth arcs. The limit, which makes the cubic monotone, is
    that of F. N. Fritsch and R. E. Carlson (1980), SIAM J. Numer. Anal. 17, Section 4.
    """
    chord = np.diff(v) / np.diff(t)
    p, q = a[:-1], a[1:]
    stiff = np.minimum(np.abs(v[:-1]), np.abs(v[1:])) <= LAYER * stick_speed
    landing = stiff & (np.abs(p + q - 2.0 * chord) > 0.03 * (np.abs(p) + np.abs(q)))
    low, high = np.minimum(3.0 * chord, 0.0), np.maximum(3.0 * chord, 0.0)
    return np.where(landing, np.clip(p, low, high), p), np.where(landing, np.clip(q, low, high), q)


def hermite(at: Floats, t: Floats, y: Floats, rate: Floats) -> Floats:
    """Return the piecewise cubic through values `y` and derivatives `rate` at times `t`, all (n,), at times `at`, (m,).
    """
    left = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    h = t[left + 1] - t[left]
    return _cubic(np.clip((at - t[left]) / h, 0.0, 1.0), y[left], h * rate[left], y[left + 1], h * rate[left + 1])


def _cubic(u: Floats, p: Floats, dp: Floats, q: Floats, dq: Floats) -> Floats:
    """Return the cubic on 0 <= u <= 1 with end values p, q and end slopes dp, dq; exactly p and q at the ends."""
    w = 1.0 - u
    out: Floats = w * w * (p * (1.0 + 2.0 * u) + u * dp) + u * u * (q * (1.0 + 2.0 * w) - w * dq)
    return out


def _cubic_slope(u: Floats, p: Floats, dp: Floats, q: Floats, dq: Floats) -> Floats:
    w = 1.0 - u
    out: Floats = 6.0 * u * w * (q - p) + w * (1.0 - 3.0 * u) * dp + u * (3.0 * u - 2.0) * dq
    return out


def _quintic(u: Floats, h: Floats, left: NDArray[np.int64], y: Floats, rate: Floats, second: Floats) -> Floats:
    """Return the quintic through value, first and second derivative at both ends of the intervals `left`, at u."""
    p, q = y[left], y[left + 1]
    dp, dq = h * rate[left], h * rate[left + 1]
    ddp, ddq = h * h * second[left], h * h * second[left + 1]
    c3 = 10.0 * (q - p) - 6.0 * dp - 4.0 * dq - 1.5 * ddp + 0.5 * ddq
    c4 = -15.0 * (q - p) + 8.0 * dp + 7.0 * dq + 1.5 * ddp - ddq
    c5 = 6.0 * (q - p) - 3.0 * (dp + dq) - 0.5 * (ddp - ddq)
    out: Floats = np.where(u == 1.0, q, p + u * (dp + u * (0.5 * ddp + u * (c3 + u * (c4 + u * c5)))))
    return out


def _turning_points(p: Floats, dp: Floats, q: Floats, dq: Floats) -> Floats:
    """Return (m, 4) array: 0, the interior extremes of each cubic in order (or an end, where there are fewer), 1."""
    a, b, c = 3.0 * (2.0 * (p - q) + dp + dq), 3.0 * (q - p) - 2.0 * dp - dq, dp
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        root = b * b - a * c
        s = -(b + np.copysign(np.sqrt(np.maximum(root, 0.0)), b))
        one, two = s / a, c / s
    real = root > 0.0
    ends = np.zeros_like(p)
    one = np.where(real & (one > 0.0) & (one < 1.0), one, ends)
    two = np.where(real & (two > 0.0) & (two < 1.0), two, ends)
    return np.stack([ends, np.minimum(one, two), np.maximum(one, two), ends + 1.0], axis=1)


def _share_within(turns: Floats, values: Floats, p: Floats, dp: Floats, q: Floats, dq: Floats, level: float) -> Floats:
    """Return the part of each interval, 0 to 1, with the cubic within +-level, from its three monotone pieces."""
    begin, end, first, last = turns[:, :-1], turns[:, 1:], values[:, :-1], values[:, 1:]
    low, high = np.minimum(first, last), np.maximum(first, last)
    inside = (low >= -level) & (high <= level)
    share = np.where(inside, end - begin, 0.0)
    part = np.nonzero(~inside & (low <= level) & (high >= -level) & (end > begin))
    if len(part[0]):
        ways = _crossing(np.array([[-level], [level]]), begin[part], end[part], (first < last)[part],
                         *(column[part[0]] for column in (p, dp, q, dq)))
        share[part] = np.abs(ways[1] - ways[0])
    out: Floats = share[:, 0] + share[:, 1] + share[:, 2]
    return out


def _share_at_rest(p: Floats, dp: Floats, q: Floats, dq: Floats) -> Floats:
    """Return the part of each interval, 0 to 1, at rest, where the clutch slips at one end of the interval only.

    Slip ends at a constant deceleration, which jumps to 0 then; it begins with an acceleration that grows from 0.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.where((q == 0.0) & (p * dp < 0.0), 1.0 + p / dp, 0.0)
        begins = np.where((p == 0.0) & (q * dq > 0.0), 1.0 - 2.0 * q / dq, 0.0)
    out: Floats = np.clip(ends, 0.0, 1.0) + np.clip(begins, 0.0, 1.0)
    return out


def _crossing(level: Floats, a: Floats, b: Floats, rising: NDArray[np.bool_], p: Floats, dp: Floats, q: Floats,
              dq: Floats) -> Floats:
    """Return the places, (m, n), at which monotone pieces [a, b], (n,), reach levels, (m, 1), by bisection; else the
    nearer ends.
    """
    for _ in range(50):
        middle = 0.5 * (a + b)
        beyond = (_cubic(middle, p, dp, q, dq) > level) == rising
        a, b = np.where(beyond, a, middle), np.where(beyond, middle, b)
    out: Floats = 0.5 * (a + b)
    return out
