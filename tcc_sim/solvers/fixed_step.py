"""The real-time solver: fixed ticks, a bounded cost per tick, friction solved implicitly.

Scheme: SDIRK3, the L-stable, stiffly accurate, singly diagonally implicit Runge-Kutta method of order 3 in three stages
of R. Alexander (1977), "Diagonally implicit Runge-Kutta methods for stiff O.D.E.'s", SIAM J. Numer. Anal. 14, Theorem
5. The plate is linear, so each stage is one scalar equation for the slip speed. Nominal order 3 on smooth arcs; no
event is located, so a step across a transition costs an error of order 2 (1 at a breakaway jump).

A tick is split into n sub-steps of h: h <= 1/(2 beta Ts alpha (r - 1)) keeps the scalar root unique (the Stribeck slope
limits the step, not the smoothing), and h max(omega_n, omega) <= RESOLUTION resolves the motion.

A stage reduces to the scalar equation v + a mubar(v) = w, a >= 0. Where F(v) = v + a mubar(v) increases (always for
mu_k = mu_s; for mu_k < mu_s while a |min d(mubar)/dv| < 1), the root is unique, has the sign of w, and lies between
lower = max(|w|/(1 + a r sigma), |w| - a r) and |w|: mubar is at most r min(1, sigma v). Newton's method runs inside
that bracket, which every evaluation shrinks; once NEWTON_LIMIT steps have passed the bracket is halved instead, so the
count is at most ITERATION_BOUND whatever the input.

After a small Newton step v is much nearer to the root than the step is long; a small halving proves only that the
bracket is short. So after a halving the equation itself is checked, and halving goes on until it holds.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.compiling.compiled import Call, compiled, timed
from tcc_sim.errors import InputError, OutOfRange
from tcc_sim.model.actuator import approach_between
from tcc_sim.model.equations import Linear, check_supported
from tcc_sim.model.friction import Stribeck
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import FAR_ANGLE, FAR_RATE, FAR_SPEED
from tcc_sim.solvers import model_kernels as model
from tcc_sim.solvers.model_kernels import largest_ratio, lost_torque, smoothed_and_slope, step_after, step_at
from tcc_sim.solvers.per_cycle import STAMP, cycles_of_states, hermite
from tcc_sim.solvers.terms import Problem, Terms, assemble, for_ticks, holding, rates_along, substeps, terms_of
from tcc_sim.trajectory import Floats, Statistics, Status, Trajectory, concatenated, split_cycles

START, BEFORE, RISE, RATE = range(4)
"""Columns of an approach: time, s, at which the load is BEFORE, N m; after t s it is BEFORE + RISE (1 - exp(-RATE t)),
or BEFORE + RISE t where RATE, 1/s, is 0.
"""


@compiled
def torques_now(t: float, piece: int, profile: Floats | None, terms: Terms) -> tuple[float, float]:
    """Return Te and Ts at time t; with a profile, by its piece of this number."""
    angle, mean_torque, mean_load = t, terms.mean_torque, terms.mean_load
    if profile is not None:
        angle, mean_torque, mean_load = model.reached(t, profile[piece])
        mean_torque = mean_torque + model.swelling(t, angle, profile[piece])
    return (model.engine_torque(angle, mean_torque, terms.torque, terms.harmonics),
            load_on_approach(t, model.saturation_torque(angle, mean_load, terms.pulsation), terms.approach))


@compiled
def load_on_approach(t: float, load: float, approach: Floats | None) -> float:
    """Return Ts at time t: `load`, or that of an actuator whose pressure approaches a command."""
    if approach is None:
        return load
    else:
        past, rate = t - approach[0, START], approach[0, RATE]
        share = past
        if rate > 0.0:
            share = 1.0 - np.exp(-rate * past)
        return float(np.maximum(approach[0, BEFORE] + approach[0, RISE] * share, 0.0))


@compiled
def pull_of_far_end(t: float, far: Floats, piece: int, linear: Linear) -> float:
    """Return C23 w3 + K23 theta3 at time t, N m, the torque of the moving far end of the shaft on the plate."""
    row = min(piece, len(far) - 1)
    past = t - far[row, START]
    angle = far[row, FAR_ANGLE] + past * (far[row, FAR_SPEED] + 0.5 * far[row, FAR_RATE] * past)
    return float(linear.damping * (far[row, FAR_SPEED] + far[row, FAR_RATE] * past) + linear.stiffness * angle)


@compiled
def piece_at(profile: Floats | None, t: float) -> int:
    """Return the number of the piece of the profile at time t; 0 without a profile."""
    if profile is None:
        return 0
    else:
        return int(max(np.searchsorted(profile[:, 0], t, side="right") - 1, 0))


@compiled
def break_after(profile: Floats | None, t: float, h: float) -> float:
    """Return the time from t to the next corner or jump of the profile, at most h, s."""
    if profile is None:
        return h
    else:
        following = np.searchsorted(profile[:, 0], t, side="right")
        if following == len(profile) or not profile[following, 0] - t < h * (1.0 - 1e-9):
            return h
        return float(max(profile[following, 0] - t, 1e-9 * h))


NEWTON_LIMIT = 20
SATURATED = 19.1
"""tanh(x) is 1 to the last bit beyond this."""
ITERATION_BOUND = NEWTON_LIMIT + 60
"""After NEWTON_LIMIT steps, 60 halvings shrink any bracket [0, |w|] below 1e-18 |w|."""

ROUNDING = 1e-15
"""Rounding of v + a mubar(v) - w over |w|: four or five operations, tanh and the exponential among them."""


@compiled
def scalar_root(w: float, a: float, guess: float, sigma: Any, stribeck: Stribeck) -> tuple[float, int]:
    """The root v of v + a mubar(v) = w and the iterations that it took, at most ITERATION_BOUND.

    w : right-hand side, rad/s
    a : step times inertia times saturation torque, rad/s, at least 0
    guess : where to start if it lies in the bracket (the root of the stage before), rad/s
    sigma, stribeck : the smoothed law (7), see `model.friction`
    returns : (v in rad/s to within 2e-15 |w| + 1e-13 |v| where F' is at least 1/2, which sub-steps see to; iterations)
    """
    if w == 0.0 or a == 0.0:
        return w, 0
    sign = 1.0 if w > 0.0 else -1.0
    target = abs(w)
    ratio = largest_ratio(stribeck)
    if stribeck is None:  # noqa: SIM102 (Numba leaves out what None rules out only where it is a test of its own)
        if (target - a) * sigma > SATURATED:
            # Slip with mu_k = mu_s: tanh is 1 to the last bit, and nothing is left to solve.
            return sign * (target - a), 0
    low, high = max(target / (1.0 + a * ratio * sigma), target - a * ratio), target
    v = guess * sign
    if not low <= v <= high:
        v = low
    step = step_at(v, sigma)
    count, near = 0, False
    while count < ITERATION_BOUND:
        count += 1
        value, slope = smoothed_and_slope(v, sigma, stribeck, step)
        excess = v + a * value - target
        if excess > 0.0:
            high = v
        else:
            low = v
        derivative = 1.0 + a * slope
        if near and abs(excess) <= derivative * (ROUNDING * target + 1e-13 * v):
            break
        halving = count > NEWTON_LIMIT or derivative <= 0.0
        following = 0.5 * (low + high) if halving else min(max(v - excess / derivative, low), high)
        change = abs(following - v)
        step = step_after(step, sigma, v, following)
        v = following
        # F''/(2 F') is at most about sigma, so the error that is left is at most sigma change^2; 4 is for safety.
        near = 4.0 * sigma * change * change <= 1e-13 * v
        if (near and not halving) or high - low <= 4e-16 * target:
            break
    return sign * v, count


GAMMA = 0.43586652150845899942
"""The root of g^3 - 3 g^2 + 3 g/2 - 1/6 = 0 for which SDIRK3 is L-stable."""
B1 = -0.25 * (6.0 * GAMMA * GAMMA - 16.0 * GAMMA + 1.0)
B2 = 0.25 * (6.0 * GAMMA * GAMMA - 20.0 * GAMMA + 5.0)
C2 = 0.5 * (1.0 + GAMMA)
A21 = 0.5 * (1.0 - GAMMA)


@compiled
def stage(known: tuple[float, float, float], guess: float, engine: float, load: float, hg: float,
          plate: tuple[float, float, float, float, float, float], smoothing: float | None, stribeck: Stribeck,
          t: float, piece: int, far: Floats | None, linear: Linear) -> tuple[float, float, float, int]:
    """Solve an implicit stage x = known + hg f(x) at time t: v, theta2, omega2, and the iterations."""
    share, gain, drop, push, slip, per_slip = plate
    # omega2 = free + gain * (Tf - p_v v), since theta2 = known + hg omega2 and the plate is linear.
    free = share * known[2] - drop * known[1]
    if far is not None:
        free += gain * pull_of_far_end(t, far, piece, linear)
    w = slip_over_all(known[0] + known[2] - free + push * engine, push, gain, linear.flywheel_by_slip,
                      linear.plate_by_slip)
    v, count = scalar_root(w, slip * load, guess, smoothing, stribeck)
    omega = free + gain * ((w - v) * per_slip - lost_torque(v, linear.plate_by_slip))
    return v, known[1] + hg * omega, omega, count


@compiled
def slip_over_all(known: float, push: float, gain: float, by_slip: float | None, plate_by_slip: float | None) -> float:
    """Return v of v (1 + push f_v - gain p_v) = known, the terms of the slip speed in a stage."""
    if by_slip is None:  # noqa: SIM102 (Numba leaves out what None rules out only where it is a test of its own)
        if plate_by_slip is None:
            return known
    total = 1.0 + push * lost_torque(1.0, by_slip)
    return known / (total - gain * lost_torque(1.0, plate_by_slip))  # type: ignore[no-any-return]


@compiled
def plate_of(hg: float, linear: Linear) -> tuple[float, float, float, float, float, float]:
    """Return the constants of the linear part for the stages of a step; `slip`: fall of v per N m of friction."""
    share = 1.0 / (1.0 + hg * (linear.damping + hg * linear.stiffness) / linear.plate)
    gain = share * hg / linear.plate
    push = hg / linear.flywheel
    slip = slip_over_all(push + gain, push, gain, linear.flywheel_by_slip, linear.plate_by_slip)
    return share, gain, gain * linear.stiffness, push, slip, 1.0 / slip


Stages = tuple[float, float, float, float, float, float, float, float, float, float, float, float, float, float, float,
               int, int]
"""v, theta2, omega2, Te and Ts of each of the three stages of a step; iterations in all, and most in a stage."""


@compiled
def stages(v: float, theta: float, omega: float, start: float, h: float,
           plate: tuple[float, float, float, float, float, float], terms: Terms) -> Stages:
    """Make one step of SDIRK3 of h seconds from time `start`; its last stage is the state after it."""
    hg, rate = h * GAMMA, 1.0 / GAMMA
    piece = piece_at(terms.profile, start + 0.5 * h)
    known = (v, theta, omega)
    engine, load = torques_now(start + hg, piece, terms.profile, terms)
    v1, theta1, omega1, count1 = stage(known, v, engine, load, hg, plate, terms.smoothing, terms.stribeck,
                                       start + hg, piece, terms.far, terms.linear)
    # A stage's slope times h is (its value - what was known) / gamma.
    dv1, dtheta1, domega1 = (v1 - known[0]) * rate, (theta1 - known[1]) * rate, (omega1 - known[2]) * rate
    known2 = (v + A21 * dv1, theta + A21 * dtheta1, omega + A21 * domega1)
    engine2, load2 = torques_now(start + C2 * h, piece, terms.profile, terms)
    v2, theta2, omega2, count2 = stage(known2, v1, engine2, load2, hg, plate, terms.smoothing, terms.stribeck,
                                       start + C2 * h, piece, terms.far, terms.linear)
    dv2, dtheta2, domega2 = (v2 - known2[0]) * rate, (theta2 - known2[1]) * rate, (omega2 - known2[2]) * rate
    known3 = (v + B1 * dv1 + B2 * dv2, theta + B1 * dtheta1 + B2 * dtheta2, omega + B1 * domega1 + B2 * domega2)
    engine3, load3 = torques_now(start + h, piece, terms.profile, terms)
    v, theta, omega, count3 = stage(known3, v2, engine3, load3, hg, plate, terms.smoothing, terms.stribeck,
                                    start + h, piece, terms.far, terms.linear)
    return (v1, theta1, omega1, engine, load, v2, theta2, omega2, engine2, load2, v, theta, omega, engine3, load3,
            count1 + count2 + count3, max(max(count1, count2), count3))


@compiled
def _sub_step(v: float, theta: float, omega: float, turn: float, start: float, h: float,
              plate: tuple[float, float, float, float, float, float],
              terms: Terms) -> tuple[float, float, float, float, int, int]:
    """Make one step of SDIRK3: v, theta2, omega2, theta1 after h seconds, iterations in all and most in a stage."""
    (v1, _, omega1, _, _, v2, _, omega2, _, _, v, theta, omega, _, _,
     count, most) = stages(v, theta, omega, start, h, plate, terms)
    turn += h * (B1 * (v1 + omega1) + B2 * (v2 + omega2) + GAMMA * (v + omega))
    return v, theta, omega, turn, count, most


@compiled
def advance(state: Floats, t: float, h: float, n: int, terms: Terms, out: Floats | None) -> tuple[int, int]:
    """Advance `state` in place by n sub-steps of h seconds from time t, in parts where the profile has a corner.

    state : (4,) array: slip speed, plate angle, plate speed, theta1
    t, h : s
    out : (n, 4) array that receives the state after every sub-step, or None
    returns : (iterations in all, most iterations in one stage)
    """
    whole = plate_of(h * GAMMA, terms.linear)
    total, most = 0, 0
    v, theta, omega, turn = state[0], state[1], state[2], state[3]
    for k in range(n):
        start, left, plate = t + k * h, h, whole
        part = break_after(terms.profile, start, left)
        while part < left:
            v, theta, omega, turn, count, worst = _sub_step(v, theta, omega, turn, start, part,
                                                            plate_of(part * GAMMA, terms.linear), terms)
            total += count
            most = max(most, worst)
            start += part
            left -= part
            part = break_after(terms.profile, start, left)
        if left < h:
            plate = plate_of(left * GAMMA, terms.linear)
        v, theta, omega, turn, count, worst = _sub_step(v, theta, omega, turn, start, left, plate, terms)
        total += count
        most = max(most, worst)
        if out is not None:
            out[k, 0], out[k, 1], out[k, 2], out[k, 3] = v, theta, omega, turn
    state[0], state[1], state[2], state[3] = v, theta, omega, turn
    return total, most


Reached = tuple[float, float, float, float, float, float, int]
"""v, theta2, omega2 and theta1 after a tick, engine and friction torque then, and most iterations in a stage of it."""


class HeldInputs(NamedTuple):
    """Terms before inputs are held, the inputs that are not held, and by numbers of sub-steps the least and most
    saturation torque, N m, that are known to need them.
    """

    terms: Terms
    no_torque: bool
    no_load: bool
    known: dict[int, tuple[float, float]]


def initial_state(system: System) -> tuple[float, float, float, float]:
    """Return slip speed, plate angle, plate speed and flywheel angle at the start."""
    start = system.initial
    return start.slip_speed, start.plate_angle, start.plate_speed, start.plate_angle


def course(t: float, before: float, after: float, torque_per_pressure: float, time_constant: float, rate_limit: float,
           step: float) -> tuple[float, float, float, float]:
    """Return the row of `Terms.approach` for a tick from time t in which the pressure goes from one value to another,
    Pa.
    """
    rise, rate = approach_between(before, after, time_constant, rate_limit, step)
    return t, torque_per_pressure * before, torque_per_pressure * rise, rate


class Stepper:
    """The driveline in ticks of a fixed step, for the node: state, tick counter, and the terms that apply to the next
    tick.

    system : with the smoothed law
    step : s

    Raises InputError: the set-valued law, or a step that needs too many sub-steps.
    """

    def __init__(self, system: System, step: float) -> None:
        if system.friction.law != "smoothed":
            raise InputError(f"friction.law is {system.friction.law}; the real-time solver needs smoothed")
        check_supported("node", system, "the real-time solver")
        self.step = step
        self.tick = 0
        self.state = np.zeros(4)
        self.iterations_most = 0
        self.iterations_bound = ITERATION_BOUND
        self._tick = Call(tick, 1, "ddqddd")
        self._laid_out: Terms | None = None
        self._held: HeldInputs | None = None
        self._lag = (system.pressure.time_constant, system.pressure.rate_limit) if system.pressure.lagged else None
        self._approach = None if self._lag is None else np.zeros((1, 4))
        self._far, self._moved = np.zeros((1, 4)), False
        self.use(terms_of(system))
        self.reset(system)

    def reset(self, system: System) -> None:
        """Go back to the initial state at tick 0."""
        self.state[:] = initial_state(system)
        self.tick = 0
        self.press(system.pressure.mean, system.pressure.mean, system.torque_per_pressure)
        self._far[:] = 0.0

    def use(self, terms: Terms) -> None:
        """Use these terms from the next tick on; raise InputError if they need too many sub-steps."""
        self.substeps = substeps(terms, self.step)
        self.terms, self._held = self._completed(terms), None

    def hold(self, terms: Terms, torque: float | None, load: float | None) -> None:
        """Use `terms` with a commanded engine torque and saturation torque, N m, as `terms.holding`, from the next tick
        on; InputError as `use`.

        Where the same inputs were held before, only means change. More load never needs fewer sub-steps, so a load
        between two that need as many needs no count.
        """
        held = self._held
        if held is None or held.terms is not terms or held.no_torque != (torque is None) or held.no_load != (
                load is None):
            self.use(holding(terms, torque, load))
            if terms.profile is None:
                self._held = HeldInputs(terms, torque is None, load is None,
                                        {self.substeps: (self.terms.mean_load, self.terms.mean_load)})
            return
        needed, known = terms.mean_load if load is None else load, held.known
        changed = self.terms._replace(mean_torque=terms.mean_torque if torque is None else torque, mean_load=needed)
        for count in (self.substeps, self.substeps + 1, self.substeps - 1):
            if count in known and known[count][0] <= needed <= known[count][1]:
                break
        else:
            count = substeps(changed, self.step)
            least, most = known.get(count, (needed, needed))
            known[count] = min(least, needed), max(most, needed)
        self.substeps = count
        if self._laid_out is self.terms:
            self._laid_out = changed
        self.terms = changed

    def press(self, before: float, after: float, torque_per_pressure: float) -> None:
        """Move the actuator's pressure, Pa, from one value to another in the next tick; without a lag do nothing."""
        if self._approach is not None and self._lag is not None:
            self._approach[0] = course(self.tick * self.step, before, after, torque_per_pressure, *self._lag, self.step)

    @property
    def far_end(self) -> tuple[float, float] | None:
        """Angle (rad) and speed (rad/s) of the shaft's far end now; None if it never moved."""
        return (float(self._far[0, FAR_ANGLE]), float(self._far[0, FAR_SPEED])) if self._moved else None

    def move_far_end(self, speed: float) -> None:
        """Move the shaft's far end at a speed, rad/s, held from now on, from where it is."""
        self._moved = True
        self._far[0] = self.tick * self.step, self._far[0, FAR_ANGLE], speed, 0.0

    def _completed(self, terms: Terms) -> Terms:
        """Return `terms` for the kernel, with the actuator's and the far end's part in the next tick."""
        return for_ticks(terms)._replace(approach=self._approach, far=self._far if terms.far is None else terms.far)

    def warm_up(self, *variants: Terms) -> None:
        """Compile and run the kernel once for each kind of terms, without touching the state."""
        for terms in (self.terms, *variants):
            self.run_apart(terms, self.state, 1)

    def run_apart(self, terms: Terms, state: Floats, n: int) -> None:
        """Make n sub-steps with these terms, from a copy of a state."""
        tick(state.copy(), 0.0, 0.0, n, self.step / self.substeps, terms.mean_torque, terms.mean_load,
             self._completed(terms))

    def advance(self) -> Reached:
        """Make one tick; return the state and the torques after it."""
        reached = self._called(self.substeps, (self.tick + 1) * self.step)
        if reached[6] > self.iterations_most:
            self.iterations_most = reached[6]
        self.tick += 1
        if self._moved:
            self._far[0, :2] = self.tick * self.step, self._far[0, FAR_ANGLE] + self.step * self._far[0, FAR_SPEED]
        return reached

    def now(self) -> Reached:
        """Return the state and the torques now."""
        return self._called(0, self.tick * self.step)

    def _called(self, n: int, end: float) -> Reached:
        """Call `tick` for n sub-steps from now; lay the terms out again if more than their means has changed."""
        terms = self.terms
        if terms is not self._laid_out:
            if self._laid_out is None or not terms.same_but_means(self._laid_out):
                self._tick.use(self.state, 0.0, 0.0, 0, 0.0, 0.0, 0.0, terms)
            self._laid_out = terms
        reached: Reached = self._tick(self.tick * self.step, end, n, self.step / self.substeps, terms.mean_torque,
                                      terms.mean_load)
        return reached


@compiled
def engine_and_friction(t: float, v: float, terms: Terms) -> tuple[float, float]:
    """Return engine and friction torque at time t and slip speed v, N m."""
    engine, load = torques_now(t, piece_at(terms.profile, t), terms.profile, terms)
    return engine, load * model.smoothed_coefficient(v, terms.smoothing, terms.stribeck)


@compiled
def with_means(terms: Terms, mean_torque: float, mean_load: float, profile: Floats | None) -> Terms:
    """Return `terms` with other means and another profile; the only place of the kernels that lists the fields."""
    return Terms(terms.linear, mean_torque, terms.torque, terms.harmonics, mean_load, terms.pulsation, terms.smoothing,
                 terms.stribeck, profile, terms.approach, terms.far)


@compiled
def tick(state: Floats, t: float, end: float, n: int, h: float, mean_torque: float, mean_load: float,
         terms: Terms) -> Reached:
    """Call `advance` with other means than those of `terms`; return the torques at time `end`, as the next tick counts
    it.
    """
    held = with_means(terms, mean_torque, mean_load, terms.profile)
    _, most = advance(state, t, h, n, held, None)
    engine, friction_torque = engine_and_friction(end, state[0], held)
    return state[0], state[1], state[2], state[3], engine, friction_torque, most


@compiled
def advance_ticks(state: Floats, start: float, step: float, first: int, ticks: int, n: int, terms: Terms,
                  out: Floats) -> tuple[int, int]:
    """Make ticks first, first + 1, ... of n sub-steps each, as a Stepper does; `out` is (ticks * n, 4)."""
    total, most = 0, 0
    for k in range(ticks):
        count, worst = advance(state, start + (first + k) * step, step / n, n, terms, out[k * n:(k + 1) * n])
        total += count
        most = max(most, worst)
    return total, most


BATCH = 400_000
"""Sub-steps kept in memory at a time."""


def solve(problem: Problem) -> Trajectory:
    """Solve a problem offline in the ticks that the node would take; `problem.step` is the tick, 1 ms by default.

    Results within a cycle come from every sub-step, so they are as exact as the method and not as coarse as the ticks.
    """
    step = problem.step or 1e-3
    terms = terms_of(problem.system)
    kernel_terms = for_ticks(terms)
    state, wanted = np.array([*problem.state.numbers, problem.state.flywheel_angle]), len(problem.first)
    t, states = np.array([problem.start]), state[None, :].copy()
    try:
        n = substeps(terms, step)
    except OutOfRange as error:
        return assemble(problem, "fixed_step", t, states[:, :wanted], status=Status.REFUSED, detail=str(error))
    ticks = math.ceil((problem.end - problem.start) / step * (1.0 - 1e-13))
    times = problem.sample_times()
    samples, cycles, ends = [states[:0, :wanted]], [], problem.cycle_starts()
    kept, first, done, total, most, status, seconds = 0, 0, 0, 0, 0, Status.DONE, 0.0
    while done < ticks:
        block = min(ticks - done, max(1, BATCH // n))
        out = np.empty((block * n, len(state)))
        (count, worst), spent = timed(advance_ticks, state, problem.start, step, done, block, n, kernel_terms, out)
        seconds += spent
        total, most = total + count, max(most, worst)
        fresh = problem.start + np.arange(done, done + block)[:, None] * step + np.arange(1, n + 1) * (step / n)
        t, states = np.concatenate([t, fresh.ravel()]), np.concatenate([states, out])
        done += block
        if not np.all(np.isfinite(out)):
            status = Status.NOT_FINITE
            break
        rates = rates_along(t, states, terms)
        due = len(times) if done == ticks else int(np.searchsorted(times, t[-1], side="right"))
        samples.append(np.stack([hermite(times[kept:due], t, states[:, i], rates[:, i]) for i in range(wanted)],
                                axis=1))
        kept = due
        starts = ends[first:] if done == ticks else ends[first:np.searchsorted(ends, t[-1] + STAMP, side="right")]
        cycles.append(cycles_of_states(t, states, terms, starts))
        first += len(cycles[-1])
        keep = max(int(np.searchsorted(t, min(ends[first], t[-1]), side="right")) - 2, 0)
        t, states = t[keep:], states[keep:]
    statistics = Statistics(steps=done * n, iterations=total, iterations_max=most, iterations_bound=ITERATION_BOUND,
                            seconds=seconds)
    whole, rest = split_cycles(concatenated(cycles), problem.whole_cycles) if cycles else (None, None)
    return assemble(problem, "fixed_step", times[:kept], np.concatenate(samples), cycles=whole, rest=rest,
                    status=status, statistics=statistics)
