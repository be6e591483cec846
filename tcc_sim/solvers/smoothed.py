"""Steps of the smoothed engine: its limits, series, collocation, and the choice between them.

Series are cheapest as long as the motion itself, not a decaying rate, limits their step. In stick the decaying rate is
friction's rho = beta Ts mubar': on its slow manifold collocation takes longer steps (Hairer and Wanner, Solving
Ordinary Differential Equations II, Sec. VI.3). Where the linear part is stiff (a light plate, or a coupling at a light
flywheel), stability limits the series, whose steps then have equal lengths.

A step of collocation is Radau IIA with 16 nodes, order 31, on a ladder of step sizes whose linear parts are precomputed
(`collocation`). In stick mubar follows the demand, and a few steps make a cycle. A step takes the longest step size
whose error is expected to pass. The error of a polynomial of degree s goes as h^s (K. Gustafsson's elementary
controller; Sec. IV.8 there).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.compiling.compiled import fast
from tcc_sim.model import friction
from tcc_sim.model.equations import coefficients_of, decay_of_slip
from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers import collocation, series
from tcc_sim.solvers.collocation import Place
from tcc_sim.solvers.model_kernels import exponentials_at, lost_torque, step_and_rest, with_slope
from tcc_sim.solvers.terms import Terms, excitation_frequency, largest_torque, load_frequency, peak_load, steps_allowed

LOCAL = 0.1
"""Tolerance of one step per relative tolerance of a solve: leaving stick amplifies the errors of steps before."""
CREEP_ERROR = 2.0
"""Error of sigma v, and so of mubar, in one step in stick, per relative tolerance of a solve."""
TANH_LEFT_OUT = 0.3
"""1 - tanh(sigma |v|) at the edge of the layer, outside which tanh counts as 1, per relative tolerance of a solve."""
EXPONENTIAL_LEFT_OUT = 0.03
"""Stribeck exponential at the slip speed from which on it counts as 0, per relative tolerance of a solve."""
FALLING_ERROR = 1e-2
"""Largest error of alpha v in one step where the exponential varies: however large v is elsewhere in the motion, a step
from the edge of the layer must not return to it by its error."""
RESOLVED = 1e3
"""Tolerance factor for perturbations that decay within one series step; later decay makes the error smaller."""
FAST = 10.0
"""Decay of the slip speed by the linear part, per rate of everything else but friction, from which on it is fast."""
FINER = 8.0
"""Longest series step there per shortest one of collocation, times that elsewhere: the series must not fill the gap."""
FLAT_PEAK = 1e-6
"""Relative distance below its limit at which mubar counts as at its peak where mu_k = mu_s or alpha = 0."""


class StepErrors(NamedTuple):
    """Largest errors of a step, rad/s, and sizes that decide on them.

    relative : tolerance of a series step relative to the motion
    slip_floor, speed_floor : sizes below which v and theta2' count as this large
    layer, falling, creep : of v in the layer, where the exponential varies, and in stick
    nearly_zero : distance beyond v = 0 at which a step ends, so that v has a certain sign
    rest : plate speed that counts as 0; smaller numbers become denormal and make a series twenty times slower
    """

    relative: float
    slip_floor: float
    speed_floor: float
    layer: float
    falling: float
    creep: float
    nearly_zero: float
    rest: float


class Speeds(NamedTuple):
    """Slip speeds at which the friction law changes, rad/s.

    layer, far : |v| up to which tanh(sigma v) and the Stribeck exponential vary
    stick : |v| at the peak of mubar; stick lies below
    creep, peak : |v| at the largest mubar of collocation in stick, and that mubar
    """

    layer: float
    far: float
    stick: float
    creep: float
    peak: float


class Rates(NamedTuple):
    """Rates, 1/s.

    base : sum of the rates in every region
    fastest : that and friction's largest rate, in stick
    strength : beta times the largest Ts, the deceleration by full friction, rad/s^2
    slip_decay : at which the linear part lets the slip speed decay
    fast_slip : whether that is far faster than everything else but friction
    """

    base: float
    fastest: float
    strength: float
    slip_decay: float
    fast_slip: bool


class SeriesOrders(NamedTuple):
    """Numbers of a series that follow from the tolerance of one step alone.

    falling, linear : order with and without varying friction
    resolved : largest rate of decay times length of a series step that resolves the decay of a perturbation
    forgotten : sum of these after which a perturbation off the slow manifold has decayed
    """

    falling: int
    linear: int
    resolved: float
    forgotten: float


class Limits(NamedTuple):
    """Constants of a solve.

    period : one engine cycle, s
    sigma : smoothing factor, s/rad
    beta, kappa : 1/I1 + 1/I2, 1/(kg m^2), and I1/(I1 + I2)
    steps : most steps of an engine cycle
    """

    period: float
    sigma: float
    beta: float
    kappa: float
    steps: int
    errors: StepErrors
    speeds: Speeds
    rates: Rates
    orders: SeriesOrders


def limits_of(terms: Terms, scene_terms: Terms, period: float, rtol: float, excess: float = 0.0) -> Limits:
    """Return the limits of a solve.

    terms, scene_terms : terms of the kernel, and of the scene, which define stick
    period : one engine cycle, s
    rtol : relative tolerance of the solve
    excess : least mu_s/mu_k - 1 by which `far` is chosen
    """
    sigma, stribeck = terms.smoothing, terms.stribeck
    assert sigma is not None
    i1, i2, damping, stiffness, _, _ = coefficients_of(terms.linear)
    local = max(LOCAL * rtol, 1e-14)
    stick_speed = friction.stick_speed(sigma, scene_terms.stribeck)
    creep_speed, peak = friction.peak(sigma, scene_terms.stribeck)
    if not math.isfinite(creep_speed):
        creep_speed = math.atanh(1.0 - FLAT_PEAK) / sigma
        peak = float(friction.smoothed_coefficient(creep_speed, sigma, scene_terms.stribeck))
    layer = max(min(0.5 * math.log(2.0 / (TANH_LEFT_OUT * rtol)), 19.0) / sigma, 1.01 * stick_speed)
    pairs = friction.exponentials(stribeck)
    far = max([layer, *(far_of(max(abs(share), excess), rate, rtol, layer) for share, rate in pairs)])
    steepest = max([rate for _, rate in pairs], default=0.0)
    speed = largest_torque(terms) / math.sqrt(stiffness * i2)
    beta = 1.0 / i1 + 1.0 / i2
    strength = beta * peak_load(terms)
    slip_decay = decay_of_slip(terms.linear)
    excitation = 2.0 * math.pi / period + excitation_frequency(terms) + load_frequency(terms)
    fast_slip = slip_decay > FAST * (math.sqrt(stiffness / i2) + excitation)
    base_rate = (math.sqrt(stiffness / i2) + damping / i2 + 2.0 * math.pi / period + excitation_frequency(terms)
                 + load_frequency(terms) + slip_decay)
    fastest = base_rate + strength * sigma * peak
    errors = StepErrors(
        relative=local, slip_floor=0.01 / sigma, speed_floor=1e-6 * speed + 1e-12,
        layer=min(1e-3, 300.0 * local) / sigma, falling=FALLING_ERROR / steepest if steepest > 0.0 else math.inf,
        creep=min(CREEP_ERROR * max(rtol, 1e-13), 1e-2) / sigma, nearly_zero=1e-7 / sigma, rest=1e-26 * speed)
    rates = Rates(base_rate, FINER * fastest if fast_slip else fastest, strength, slip_decay, fast_slip)
    order = order_of(4.6 - 0.58 * math.log(local), series.FRICTION_ORDER_MAXIMUM)
    orders = SeriesOrders(order, order_of(10.7 - 0.58 * math.log(local), series.ORDER_MAXIMUM),
                          math.exp((math.log(RESOLVED * local) + math.lgamma(order + 2.0)) / (order + 1.0)),
                          -math.log(local))
    return Limits(period, sigma, beta, i1 / (i1 + i2), steps_allowed(terms, period), errors,
                  Speeds(layer, far, stick_speed, creep_speed, peak), rates, orders)


def far_of(excess: float, decay: float, rtol: float, layer: float) -> float:
    """Return the slip speed, rad/s, beyond which excess * exp(-decay |v|) is below the tolerance; `layer` at least."""
    if excess == 0.0:
        return layer
    return max(layer, math.log(excess / (EXPONENTIAL_LEFT_OUT * rtol)) / decay) if decay > 0.0 else math.inf


def order_of(wished: float, most: int) -> int:
    """Return the even order, 8 at least, nearest to the one at which the series' cost per length is least."""
    return min(max(2 * round(0.5 * wished), 8), most)


ACCEPTED, REFUSED = range(2)
"""Results of a step: taken, if its length is above 0; to be tried again with the method and length in `control`."""

SERIES, CREEP, STIFF = range(3)
"""Methods: Taylor series; collocation in stick, on the slow manifold; collocation where the linear part is stiff."""

STATE = np.dtype([("slip_speed", np.float64), ("plate_angle", np.float64), ("plate_speed", np.float64),
                  ("flywheel_angle", np.float64), ("tau", np.float64), ("shift", np.float64)])
"""The motion, SI units; time into the engine cycle, and the load's phase at its start."""

CONTROL = np.dtype([("method", np.int64), ("level", np.int64), ("rate", np.float64), ("released", np.float64),
                    ("waited", np.int64), ("calm", np.int64),
                    ("last", np.float64), ("streak", np.int64), ("patience", np.int64), ("slip_before", np.float64),
                    ("slip_now", np.float64), ("speed_before", np.float64), ("speed_now", np.float64),
                    ("unsettled", np.float64)])
"""Data by which steps are chosen.

method, level : the present method, and the number of the next collocation step's length
rate : rho = beta Ts mubar' at the end of the last collocation step, 1/s
released : that rate when the series took over in stick; 0 if they did not
waited, calm : series steps in the layer since then, and their number after which collocation is tried again
last, streak, patience : length of the last series step, number of such steps in a row, and the most of them
slip_before, slip_now, speed_before, speed_now : largest |v| and |theta2'| in the cycle before and in this one
unsettled : with derivatives, decay of perturbations, in powers of e, that must come before collocation in stick
"""


class Step(NamedTuple):
    """A step: result, unit of time (s), length in that unit, degree of its polynomials, error per tolerance."""

    status: int
    unit: float
    x: float
    degree: int
    error: float


TAIL_OF_TANH = 3.0
"""sigma |v| above which tanh(sigma |v|) is 1 - 2 exp(-2 sigma |v|) and its series converges like the exponential's."""
SAFETY_SERIES = 0.905


class LocalFriction(NamedTuple):
    """Friction at the state: mubar, its slope (s/rad); value c exp(-a |v|) of the first exponential, tanh(sigma v),
    1 - tanh^2; v' (rad/s^2).
    """

    law: float
    slope: float
    excess: float
    tanh: float
    sech: float
    acceleration: float


@fast
def law_here(v: float, sign: float, region: int, sigma: float,
             stribeck: Stribeck) -> tuple[float, float, float, float, float]:
    """Return the first five fields of LocalFriction by the law in the region; sign is 0 without load."""
    tanh, sech = sign, 0.0
    if region == collocation.LAYER:
        tanh, sech = step_and_rest(sigma * v)
    if stribeck is None:
        return tanh, sigma * sech, 0.0, tanh, sech
    else:
        first, total, fall = 0.0, 0.0, 0.0
        if region != collocation.SLIDING:
            first, total, fall = exponentials_at(sign * v, stribeck)
        law, slope = with_slope(total, fall, sign, sigma, tanh, sech)
        return law, slope, first, tanh, sech


@fast
def friction_here(place: Place, state: Any, limits: Limits, terms: Terms, drive: Any) -> LocalFriction:
    """Return friction and slip acceleration at the state."""
    law, slope, excess, tanh, sech = law_here(state.slip_speed, place.sign, place.region, limits.sigma, terms.stribeck)
    linear, v, plate_speed = terms.linear, state.slip_speed, state.plate_speed
    torque = law * drive.load
    pull = (torque - (linear.damping * plate_speed + linear.stiffness * state.plate_angle)
            - lost_torque(v, linear.plate_by_slip))
    push = drive.torque - torque - lost_torque(v, linear.flywheel_by_slip)
    return LocalFriction(law, slope, excess, tanh, sech, push / linear.flywheel - pull / linear.plate)


@fast
def expand_region(order: int, rows: Any, unit: float, terms: Terms, sigma: float, place: Place, friction: LocalFriction,
                  pulsation: tuple[float, float, float] | None, stribeck: Stribeck) -> None:
    """Expand the motion with the parts of the law that vary in the region: the exponential, and in the layer tanh."""
    sign = place.sign
    if place.region == collocation.LAYER:
        if stribeck is None:
            series.expand(order, rows, unit, terms.linear, sign, pulsation, None, None, sigma, friction.tanh,
                          friction.sech)
        else:
            series.expand(order, rows, unit, terms.linear, sign, pulsation, stribeck, friction.excess, sigma,
                          friction.tanh, friction.sech)
    elif place.region == collocation.SLIDING:
        series.expand(order, rows, unit, terms.linear, sign, pulsation, None, None, None, None, None)
    elif stribeck is not None:
        series.expand(order, rows, unit, terms.linear, sign, pulsation, stribeck, friction.excess, None, None, None)


@fast
def rate_of_law(region: int, sigma: float, stribeck: Stribeck) -> float:
    """Return the rate of mubar by v in a region, s/rad: the exponential's, and that of tanh."""
    rate = sigma if region == collocation.LAYER else 0.0
    if stribeck is not None and region != collocation.SLIDING:
        rate += series.fastest_at(stribeck, 0.0)
    return rate


@fast
def series_length(rows: Any, order: int, slip_tolerance: float, speed_tolerance: float) -> float:
    """Return the length, in units of time of the series, at which its last two terms reach the tolerance."""
    longest = series.ENDLESS
    for k in range(order - 1, order + 1):
        size = max(abs(rows[series.SLIP, k]) / slip_tolerance, abs(rows[series.SPEED, k]) / speed_tolerance)
        if not size < math.inf:
            return math.nan
        if size > 0.0:
            longest = min(longest, series.logarithm(1.0 / size) * series.INVERSE[k])
    return float(SAFETY_SERIES * series.power_of_two(longest))


@fast
def converging_length(rows: Any, order: int, x: float, sign: float, excess: float, decay: float, strength: float,
                      slip_tolerance: float) -> float:
    """Return a length of at most x over which the series of excess * exp(-decay |v|) is accurate too.

    While |v| falls the coefficients of that series rise up to order z = decay |change of v|. If z exceeds half the
    order, the last two terms do not bound the error; Lagrange's remainder z^(p + 1)/(p + 1)!, times the larger of the
    two end values of the exponential, does.
    """
    change = decay * sign * (rows[series.SLIP, 1] * x + rows[series.SLIP, 2] * x * x)
    if abs(change) <= 0.5 * order:
        return x
    goal = math.log(slip_tolerance) + math.lgamma(order + 2.0)
    while abs(change) > 0.5 * order:
        remainder = math.log(strength * excess * x) - decay * abs(rows[series.SLIP, 0]) + max(-change, 0.0)
        if not remainder + (order + 1.0) * math.log(abs(change)) > goal:
            break
        x *= 0.85
        change = decay * sign * (rows[series.SLIP, 1] * x + rows[series.SLIP, 2] * x * x)
    return x


@fast
def exponential_length(rows: Any, order: int, x: float, place: Place, v: float, strength: float, sigma: float,
                       stribeck: Stribeck) -> float:
    """Return `converging_length` for the exponentials that vary in the region."""
    if place.region == collocation.FALLING and stribeck is not None:
        for j in range(0, len(stribeck), 2):
            x = converging_length(rows, order, x, place.sign, abs(stribeck[j]), stribeck[j + 1], strength,
                                  place.slip_tolerance)
        return x
    if place.region == collocation.LAYER and sigma * abs(v) > TAIL_OF_TANH:
        return float(converging_length(rows, order, x, place.sign, 2.0, 2.0 * sigma, strength, place.slip_tolerance))
    return x


@fast
def series_step(place: Place, friction: LocalFriction, remaining: float, loaded: bool, state: Any, limits: Limits,
                terms: Terms, waves: Any, drive: Any, work: Any) -> Step:
    """Expand the motion; return the step up to which the series hold, at most `remaining` s.

    Time is scaled by the sum of all rates, friction's own rho among them, so that no coefficient overflows.
    """
    rate = limits.rates.base
    order = limits.orders.linear
    if place.region != collocation.SLIDING:
        order = limits.orders.falling
        rate += (rate_of_law(place.region, limits.sigma, terms.stribeck) * abs(friction.acceleration)
                 + limits.beta * drive.load * abs(friction.slope))
    unit = 1.0 / rate
    rows = work.rows
    rows[series.SLIP, 0] = state.slip_speed
    rows[series.ANGLE, 0] = state.plate_angle
    rows[series.SPEED, 0] = state.plate_speed
    series.expand_excitation(rows, order, unit, state.tau, loaded, terms, waves, terms.pulsation, terms.profile, drive)
    expand_region(order, rows, unit, terms, limits.sigma, place, friction, terms.pulsation, terms.stribeck)
    x = series_length(rows, order, place.slip_tolerance, place.speed_tolerance)
    x = min(x, min(remaining, 0.5 * limits.period) / unit)
    if x > 0.0 and place.region != collocation.SLIDING:
        x = exponential_length(rows, order, x, place, state.slip_speed, limits.rates.strength * unit, limits.sigma,
                               terms.stribeck)
    return Step(ACCEPTED, unit, x, order, 0.0)


SAFETY = 0.85
SHRINK_MOST = 0.25
SMALLEST_ERROR = 1e-9
"""Smaller errors are rounding and do not depend on the length."""


@fast
def weigh(state: Any, h: float, kappa: float, mean_torque: float, waves: Any, profile: Any, work: Any) -> None:
    """Fill the weights of the sources: the start, and the torque's sines and quadratures, or that at the nodes."""
    weights = work.weights
    weights[collocation.FROM_ANGLE] = state.plate_angle
    weights[collocation.FROM_SPEED] = state.plate_speed + kappa * state.slip_speed
    weights[collocation.FROM_MEAN] = mean_torque
    if profile is None:
        for i in range(waves.shape[0]):
            wave = waves[i]
            weights[collocation.FROM_WAVES + 2 * i] = wave.amplitude * wave.sine
            weights[collocation.FROM_WAVES + 2 * i + 1] = wave.amplitude * wave.cosine
    else:
        for i in range(collocation.NODES):
            weights[collocation.FROM_WAVES + i] = series.torque_about_mean(
                state.tau + collocation.C[i] * h, mean_torque, waves, profile)


@fast
def friction_rate_at_nodes(tau: float, h: float, turn: Any, loaded: bool, beta: float, mean_load: float,
                           pulsation: series.Pulsation, profile: Any, drive: Any, friction_rate: Any) -> None:
    """Fill beta Ts at the nodes of a collocation step."""
    cosine, sine = turn.cosine, turn.sine
    for i in range(collocation.NODES):
        load = mean_load
        if profile is not None:
            load = series.load_and_rate(tau + collocation.C[i] * h, pulsation, profile)[0]
        elif pulsation is not None:
            load += pulsation[0] * (drive.load_sine * cosine[i] + drive.load_cosine * sine[i])
        friction_rate[i] = beta * load if loaded else 0.0


@fast
def balance(sources: Any, level: int, work: Any) -> None:
    """Fill b without the share of v(0) at the nodes."""
    work.balance[:] = 0.0
    for k in range(sources.shape[1]):
        collocation.add_share(0, work.balance, sources[level, k].balance, work.weights[k])


@fast
def fill_plate(step_size: Any, sources: Any, level: int, kappa: float, work: Any) -> None:
    """Fill the polynomials of theta2 and theta2', and work.chebyshev with the Chebyshev coefficients of theta2'."""
    rows, slip, weights, chebyshev = work.rows, work.slip, work.weights, work.chebyshev
    chebyshev[:] = 0.0
    for k in range(sources.shape[1]):
        collocation.add_share(0, chebyshev, sources[level, k].angle, weights[k])
    collocation.add_slip(0, slip, step_size.angle, chebyshev)
    collocation.to_powers(0, chebyshev, rows[series.ANGLE])
    chebyshev[:] = 0.0
    for k in range(sources.shape[1]):
        collocation.add_share(0, chebyshev, sources[level, k].speed, weights[k])
    collocation.add_slip(0, slip, step_size.speed, chebyshev)
    collocation.to_powers(0, chebyshev, rows[series.SPEED])
    for i in range(collocation.TERMS):
        rows[series.SPEED, i] -= kappa * rows[series.SLIP, i]


@fast
def state_at_end(step_size: Any, sources: Any, level: int, kappa: float, work: Any, state: Any) -> None:
    """Set the state to that at the last node, the end of the step."""
    slip, weights, end_angle, end_speed = work.slip, work.weights, step_size.end_angle, step_size.end_speed
    angle, speed = 0.0, 0.0
    for k in range(sources.shape[1]):
        source = sources[level, k]
        angle += weights[k] * source.end_angle
        speed += weights[k] * source.end_speed
    for j in range(collocation.NODES):
        angle += slip[j] * end_angle[j]
        speed += slip[j] * end_speed[j]
    state.slip_speed = slip[collocation.NODES - 1]
    state.plate_angle = angle
    state.plate_speed = speed - kappa * slip[collocation.NODES - 1]


@fast
def step_size_below(step_sizes: Any, level: int, length: float) -> int:
    """Return the level of the longest step size from `level` on that is at most `length`; their number if none is."""
    while level < step_sizes.shape[0] and step_sizes[level].length > length:
        level += 1
    return level


@fast
def growth(error: float) -> float:
    """Return the factor to the length at which the relative error is expected to be a little below 1."""
    return max(SAFETY * math.exp(-math.log(max(error, SMALLEST_ERROR)) / collocation.NODES), SHRINK_MOST)


BEFORE_FOLD = 0.92
"""Longest step per time until the demand passes the peak: a longer one would be refused, since slip speed bends there
as a square root does.
"""
WORTH = 20.0
"""Step times rho above which a collocation step, which costs ten series steps, is longer than those."""
FLAT = 0.04
"""Least slope of mubar, relative to sigma, that weighs an error of v in stick: flat friction does not depend on v, but
the end of stick does."""
CONVERGED = 0.01
"""Error of Newton's method per tolerance of the step."""
ROUNDED = 2e-15
"""Rounding of the last coefficients of slip and plate speed in slip, of the size of the slip speed, since the plate
speed is a difference. Smaller coefficients count as so large: the next step's length must not depend on rounding."""
NEXT = 2.5e-4
"""Error from which `growth` leads to the next longer step, a factor of 2^0.5; at most so much counts for rounding."""


@fast
def time_to_fold(peak: float, work: Any) -> float:
    """Return the time, per length of the step, at which friction would have to pass its peak to hold the plate.

    Lines join the demand at the nodes, and the last one goes on; infinity where it does not rise.
    """
    demand, total, friction_rate = work.demand, work.balance, work.friction_rate
    for i in range(collocation.NODES):
        demand[i] = total[i] / friction_rate[i]
    beyond = 0
    while beyond < collocation.NODES and abs(demand[beyond]) <= peak:
        beyond += 1
    end = min(beyond, collocation.NODES - 1)
    if end == 0:
        return float(collocation.C[0])
    before = abs(demand[end - 1])
    rise = abs(demand[end]) - before
    if rise > 0.0:
        return float(collocation.C[end - 1] + (peak - before) / rise * (collocation.C[end] - collocation.C[end - 1]))
    return math.inf if beyond == collocation.NODES else float(collocation.C[end])


@fast
def collocation_step(place: Place, remaining: float, loaded: bool, state: Any, control: Any, limits: Limits,
                     terms: Terms, waves: Any, drive: Any, tables: collocation.Tables, work: Any,
                     counters: Any) -> Step:
    """Solve on the step size control.level, or the longest below it that fits into `remaining` s.

    Fills the polynomial of the slip speed in work.rows; `fill_plate` fills the others. A refused step sets
    control.level to the step size to try next, or to the number of step sizes if there is none.
    """
    level = step_size_below(tables.step_sizes, control.level, remaining)
    worth = -math.inf  # A falling slope of friction does not refuse a step.
    while True:
        control.level = level
        if level >= tables.step_sizes.shape[0] or tables.step_sizes[level].length * control.rate < worth:
            return Step(REFUSED, 0.0, 0.0, collocation.DEGREE, math.inf)
        h = tables.step_sizes[level].length
        weigh(state, h, limits.kappa, terms.mean_torque, waves, terms.profile, work)
        balance(tables.sources, level, work)
        friction_rate_at_nodes(state.tau, h, tables.turns[level], loaded, limits.beta, terms.mean_load, terms.pulsation,
                               terms.profile, drive, work.friction_rate)
        longest = BEFORE_FOLD * time_to_fold(limits.speeds.peak, work) if control.method == CREEP else math.inf
        if longest >= 1.0:
            break
        level, worth = step_size_below(tables.step_sizes, level + 1, longest * h), WORTH
    step_size = tables.step_sizes[level]
    accuracy, sharpness = CONVERGED * limits.errors.creep, limits.sigma
    if control.method == CREEP:
        collocation.guess(0, work.demand, work.slip, place.sign, limits.sigma, terms.stribeck)
        collocation.follow_manifold(step_size, state.slip_speed, place.sign, limits.sigma, terms.stribeck, work)
    else:
        accuracy = CONVERGED * place.slip_tolerance
        sharpness = rate_of_law(place.region, limits.sigma, terms.stribeck)
        start = work.slip
        for i in range(collocation.NODES):
            start[i] = state.slip_speed
    used = collocation.solve_stages(step_size, state.slip_speed, place, sharpness, limits.sigma, terms.stribeck,
                                    accuracy, work)
    counters.iterations += abs(used)
    counters.iterations_max = max(counters.iterations_max, abs(used))
    if used < 0:
        control.level = step_size_below(tables.step_sizes, level + 1, 0.5 * h)
        return Step(REFUSED, h, 0.0, collocation.DEGREE, math.inf)
    collocation.slip_polynomial(0, work.slip, state.slip_speed, work.chebyshev, work.rows[series.SLIP])
    chebyshev = work.chebyshev
    error = max(abs(chebyshev[collocation.DEGREE]), abs(chebyshev[collocation.DEGREE - 1]))
    if control.method == CREEP:
        slope = work.slope
        steepest = 0.0
        for i in range(collocation.NODES):
            steepest = max(steepest, slope[i])
        error *= max(steepest / limits.sigma, FLAT) / limits.errors.creep
    else:
        rounding = ROUNDED * abs(state.slip_speed)
        fill_plate(step_size, tables.sources, level, limits.kappa, work)
        last = max(abs(chebyshev[collocation.DEGREE]), abs(chebyshev[collocation.DEGREE - 1]))
        error = max((error - rounding) / place.slip_tolerance, (last - rounding) / place.speed_tolerance)
        error = max(error, min(rounding / place.speed_tolerance, NEXT))
    if not error <= 1.0:
        factor = growth(error) if error < math.inf else SHRINK_MOST
        control.level = step_size_below(tables.step_sizes, level + 1, factor * h)
        return Step(REFUSED, h, 0.0, collocation.DEGREE, error)
    control.rate = work.friction_rate[collocation.NODES - 1] * work.slope[collocation.NODES - 1]
    return Step(ACCEPTED, h, 1.0, collocation.DEGREE, error)


WORTH_USUAL = 2.0
"""Step times rho, for the shortest step size of a usual ladder, below which collocation is not even tried in stick."""
RETURN = 3.0
"""Growth of rho since the series took over in stick after which collocation is tried again."""
CALM, CALM_MOST = 8, 256
"""Half the series steps after which it is tried again in any case; doubled each time."""
PROJECTED = 2.0
"""Longest projection onto the slow manifold, in tolerances in stick: samples contain its first-order effect; its
second-order effect on the motion afterwards, sigma delta^2, would allow much more."""
SETTLED = 32
"""Series steps within the layer after which transients have decayed: the state is on the slow manifold itself, not on
the first-order one, and collocation starts without a projection."""
CURVED = 0.3
"""Largest distance of the two then, as sigma delta^2 per tolerance in stick."""
SLOW = 3.0
"""Least slip speed in projections, so that a projection does not pass v = 0."""
FIRST = 0.2
"""Length of the first step in stick, per engine cycle."""
PATIENCE, PATIENCE_MOST = 16, 1024
"""Series steps of equal length after which collocation is tried, doubled each time until it succeeds; and collocation
steps of one step size after which a longer one is tried."""
HURRY = 2
"""PATIENCE with the series where the linear part lets the slip speed decay fast, which alone limits their steps."""
SMALL = 2.0 ** (-0.5 * collocation.NODES)
"""Error there below which the next longer collocation step passes by the power law; the error of a start off the slow
manifold does not depend on the length."""
NEARING, CAUTIOUS = 0.5, 8
"""Length there of a collocation step in slip that falls towards the layer, per time in which it would reach it (as slip
falls friction brakes it more, and across v = 0 Newton's method fails); steps since a refused one to which this holds.
"""
ALIKE = 0.1
"""Relative difference of lengths that count as equal."""
SERIES_REACH = 3.0
"""Step of a series that stability limits, times the sum of the rates; a shorter collocation step is not worth it."""


@fast
def distance_to_creep(friction: LocalFriction, rho: float, state: Any, limits: Limits, terms: Terms,
                      drive: Any) -> float:
    """Return the distance of the slow manifold above v, rad/s: delta = (v' - v_s')/rho to first order in 1/rho.

    v_s' is that of the balance v' = 0 with w' = (Te - C23 theta2' - K23 theta2)/M.
    """
    linear = terms.linear
    i1, i2, damping, stiffness = linear.flywheel, linear.plate, linear.damping, linear.stiffness
    push = (drive.torque - damping * state.plate_speed - stiffness * state.plate_angle) / (i1 + i2)
    creep = (drive.torque_rate / i1 + (damping * push + stiffness * state.plate_speed) / i2
             - limits.beta * drive.load_rate * friction.law) / rho
    return float((friction.acceleration - creep) / rho)


@fast
def enter_creep(friction: LocalFriction, remaining: float, state: Any, control: Any, limits: Limits, terms: Terms,
                drive: Any, tables: collocation.Tables) -> bool:
    """Change to collocation in stick if the state is on the slow manifold, or project it if it is near.

    The projection keeps w = theta2' + kappa v, and corrects theta2 by its change during the decay of delta.
    """
    v = state.slip_speed
    rho = limits.beta * drive.load * friction.slope + limits.rates.slip_decay
    waits = not (rho > RETURN * control.released or control.waited >= control.calm)
    if waits or control.unsettled > 0.0 or abs(v) >= limits.speeds.creep:
        return False
    shortest = tables.step_sizes[tables.step_sizes.shape[0] - 1].length
    if not rho * tables.step_sizes[collocation.LEVELS - 1].length > WORTH_USUAL or remaining < shortest:
        return False
    delta = distance_to_creep(friction, rho, state, limits, terms, drive)
    near = (abs(delta) * max(friction.slope / limits.sigma, FLAT) < PROJECTED * limits.errors.creep
            and abs(v) >= SLOW * abs(delta))
    decayed = control.waited >= SETTLED or (limits.rates.fast_slip and control.streak > control.patience)
    settled = decayed and delta * delta * limits.sigma < CURVED * limits.errors.creep
    if not (near or settled):
        return False
    if near:
        state.slip_speed += delta
        state.plate_speed -= limits.kappa * delta
        state.plate_angle += limits.kappa * delta / rho
    control.method = CREEP
    control.rate = rho
    control.level = step_size_below(tables.step_sizes, 0, FIRST * limits.period)
    return True


@fast
def choose_method(place: Place, friction: LocalFriction, remaining: float, state: Any, control: Any, limits: Limits,
                  terms: Terms, drive: Any, tables: collocation.Tables) -> bool:
    """Set control.method for the next step; return whether collocation in stick begins, which may move the state."""
    room, near = math.inf, False
    if limits.rates.fast_slip and place.region == collocation.FALLING and place.sign * friction.acceleration < 0.0:
        room = NEARING * (abs(state.slip_speed) - limits.speeds.layer) / abs(friction.acceleration)
        near = room < max(SERIES_REACH / limits.rates.base, tables.step_sizes[tables.step_sizes.shape[0] - 1].length)
        if control.method == STIFF and control.streak <= CAUTIOUS:
            if near:
                control.method, control.streak = SERIES, 0
            else:
                control.level = step_size_below(tables.step_sizes, control.level, room)
    if control.method != SERIES:
        return False
    if place.region != collocation.LAYER:
        control.released = 0.0
        control.calm = CALM
        control.waited = 0
    elif enter_creep(friction, remaining, state, control, limits, terms, drive, tables):
        return True
    if control.streak > control.patience and not near:
        control.streak = 0
        control.patience = min(2 * control.patience, PATIENCE_MOST)
        control.method = STIFF
        control.level = min(step_size_below(tables.step_sizes, 0, min(8.0 * control.last, room)),
                            tables.step_sizes.shape[0] - 1)
    return False


@fast
def leave_if_short(control: Any, limits: Limits, tables: collocation.Tables) -> None:
    """Return to the series if the next step size is too short for its cost, or if there is none."""
    length = tables.step_sizes[control.level].length if control.level < tables.step_sizes.shape[0] else 0.0
    if control.method == CREEP and length * control.rate < WORTH:
        control.method = SERIES
        control.released = control.rate
        control.waited = 0
        control.calm = min(2 * control.calm, CALM_MOST)
    elif control.method == STIFF and length * (limits.rates.base + abs(control.rate)) < SERIES_REACH:
        control.method = SERIES


@fast
def after_collocation(error: float, length: float, control: Any, limits: Limits, tables: collocation.Tables) -> None:
    """Choose the step size of the next step, or the series.

    `growth` assumes a power law, which errors of rounding, or of a start off the slow manifold, do not follow.
    Therefore after many steps of one length a longer one is tried.
    """
    longest = length * growth(error)
    control.streak += 1
    level = control.level
    eager = limits.rates.fast_slip and control.method == STIFF and error < SMALL
    if (control.streak > PATIENCE or eager) and level > 0:
        longest = max(longest, tables.step_sizes[level - 1].length)
    while level > 0 and tables.step_sizes[level - 1].length <= longest:
        level -= 1
    control.level = step_size_below(tables.step_sizes, level, longest)
    if control.method == STIFF:
        control.patience = patience_of(limits)
    leave_if_short(control, limits, tables)


@fast
def after_step(step: Step, x: float, control: Any, limits: Limits, tables: collocation.Tables) -> None:
    """Update `control` after [0, x] of a step was taken."""
    if control.method == SERIES:
        length = x * step.unit
        control.waited += 1
        control.streak = control.streak + 1 if abs(length - control.last) < ALIKE * length else 0
        control.last = length
    elif x == step.x:
        after_collocation(step.error, step.unit, control, limits, tables)


@fast
def patience_of(limits: Limits) -> int:
    """Return the number of series steps of equal length after which collocation is tried for the first time."""
    return HURRY if limits.rates.fast_slip else PATIENCE


@fast
def begin(state: Any, control: Any, limits: Limits) -> None:
    """Reset `control` at the start of a motion."""
    control.method, control.level, control.rate, control.last, control.streak = SERIES, 0, 0.0, 0.0, 0
    control.released, control.waited, control.calm, control.patience = 0.0, 0, CALM, patience_of(limits)
    control.unsettled, control.slip_before, control.speed_before = 0.0, 0.0, 0.0
    control.slip_now, control.speed_now = abs(state.slip_speed), abs(state.plate_speed)


@fast
def begin_cycle(state: Any, control: Any, limits: Limits) -> None:
    """Begin a cycle: sizes of the motion are those of this cycle and of the one before."""
    control.slip_before, control.slip_now = control.slip_now, abs(state.slip_speed)
    control.speed_before, control.speed_now = control.speed_now, abs(state.plate_speed)
    control.streak = 0
    control.patience = patience_of(limits)
