"""Parameters and starts of windows that fit a measurement: Gauss-Newton with Levenberg's damping.

Multiple shooting after H. G. Bock (1983): every window has its own start, and the ends of windows match the starts of
the next as equations whose weight grows in stages, because a chaotic motion forgets its start within some windows. In
stick, noise in the slip speed of a window's start would begin a false breakaway, so that the first stages hold it near
0. In the last ones the window before determines the start; holding it would bias the parameters in slow slip that
resembles stick.

While the parameters are a few per cent off, a window in which stick ends says little: the time of breakaway is wrong by
more than a sample, and its residuals are nearly a step function of the parameters. In the first stages such windows
count by Cauchy's loss (P. J. Huber and E. M. Ronchetti, Robust Statistics, 2009, Section 7.8), and may restart where
the window before ends.

Windows are solved by the real-time solver's method, with the exact derivatives of its result
(`solvers.fixed_step_sensitivity`). The number of sub-steps per sample is constant during a stage: a change of it would
make the cost jump.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from tcc_sim.errors import InputError, NumericalFailure, OutOfRange
from tcc_sim.estimation.curve import CONSTANT, CURVE, LARGEST_SHARE, RATES, SHARES, pairs_of, rates_allowed
from tcc_sim.estimation.measurement import Measurement
from tcc_sim.model.groups import TABLE
from tcc_sim.model.parameters import DEFAULTS as SCENE_KEYS
from tcc_sim.model.parameters import QUANTITIES, System, unknown_key
from tcc_sim.model.parameters import replace as changed
from tcc_sim.solvers import key_derivatives as keyed
from tcc_sim.solvers.fixed_step_sensitivity import advance_windows
from tcc_sim.solvers.terms import Terms, holding, least_mean_load, substeps, terms_of
from tcc_sim.topics import INPUTS, topic
from tcc_sim.trajectory import Floats

LEAST_RATIO, EQUAL = 1.0005, 1.0 + 1e-9
"""Least ratio of mu_s and mu_k while one is free, with the decay, which has no effect at 1, and without it."""
SPARE = 1.25  # Sub-steps relative to those that the values need.
OFFSETS = {f"{name}.offset": name for name in INPUTS}
"""Free parameters besides scene keys: the offset of an input's sensor, N m or Pa."""
FREE = ("friction.static_coefficient", "friction.kinetic_coefficient", "friction.decay", "friction.smoothing",
        "driveline.damping", "driveline.stiffness", "driveline.flywheel_inertia", "driveline.plate_inertia",
        "converter.coupling", *OFFSETS)
"""Keys that can be identified, besides friction.curve."""
LINEAR = {*OFFSETS, *SHARES}  # Free parameters of either sign, whose logarithms a fit does not use.
CURVE_ROWS = dict(zip((*SHARES, *RATES), (*keyed.EXCESSES, *keyed.DECAYS)))
"""Rows of the derivatives for the numbers of a curve."""
UNKNOWN = 100.0  # Standard error of a parameter's logarithm above which a measurement holds nothing about it.
FAILED = NumericalFailure, OutOfRange, RuntimeError
"""Errors of a fit that leads nowhere; SciPy raises RuntimeError for a singular matrix."""
STATIC, KINETIC = "friction.static_coefficient", "friction.kinetic_coefficient"
NUDGE = 1e-4  # Relative change of an input for its derivatives.
INDEX = {"slip_speed": 0, "plate_angle": 1, "plate_speed": 2}  # Index of a channel in the state.


@dataclass(frozen=True)
class Stage:
    """One stage of the fit.

    window : length of a window, s
    weight : of continuity, per squared noise
    tolerance : relative change of the cost at which the stage ends
    iterations : largest number
    robust : mean square of a window's residuals, over their median (at least 1), above which it counts less; infinite
        if all windows count alike
    """

    window: float
    weight: float
    tolerance: float
    iterations: int
    robust: float = math.inf


@dataclass(frozen=True)
class FitSettings:
    """Settings of the fit.

    The stages go from nearly independent windows to long ones that nearly form one motion; short ones with a large
    weight converge slowly.
    """

    stages: tuple[Stage, ...] = (Stage(0.01, 1e-4, 1e-2, 20, 4.0), Stage(0.01, 1e-2, 1e-2, 20, 4.0),
                                 Stage(0.01, 1.0, 1e-2, 20, 4.0), Stage(0.01, 1e3, 1e-3, 20, 4.0),
                                 Stage(0.1, 1e4, 1e-2, 12, 4.0), Stage(0.1, 1e4, 1e-8, 60))
    layer: float = 0.03  # Slip speed within which a start in stick is held, rad/s.
    joined: float = 1e3  # Weight above which starts in stick are not held.
    stuck: float = 4.0  # Standard deviations of noise below which the slip speed of a window's start counts as stick.
    largest_step: float = 0.3  # Largest step of a parameter's logarithm in one iteration.
    least_gain: float = 0.03  # Gain of chi-square, over chi-square per residual, at which every stage ends.
    far: float = 10.0  # Chi-square per residual above which the last stage ends at gains below 1 %.
    angle_noise: float = 1e-4  # Scale of a plate angle that was not measured, rad.


@dataclass(frozen=True)
class Gates:
    """Limits of an acceptable fit and of an identified parameter."""

    beyond: float = 4.0  # Largest excess of chi-square per degree of freedom over 1, in standard deviations.
    guessed: float = 3.5
    """Relative standard deviation of a variance of noise estimated from a signal, by the root of the samples."""
    explained: float = 4.0  # Largest change of a held quantity that residuals suggest, in its standard errors.
    white: float = 1e-4  # Least probability of the residuals as noise.
    gap: float = 4.0  # Largest gap between windows, see `multiple_shooting.Fit`.
    relative: float = 0.15  # Largest standard error of an identified parameter, relative to its value.
    negligible: float = 0.01
    """Size of a parameter that may be 0, relative to that of a full effect, up to which it has no effect."""
    correlated: float = 0.99  # Largest correlation with another free parameter of an identified one.
    starts: int = 5  # Number of starts, the first at the given values, the others in a Sobol set around them.
    work: float = 1.5e8  # Sub-steps times derivatives after which no other start is tried: about 15 s.
    spread: float = 0.15  # Spread of that set, relative.
    louder: float = 3.0  # Largest ratio of residuals that are noise to the stated noise.
    turned: float = 0.25
    """Largest chi-square with the sign of a column turned, relative to that without, that shows a wrong sign."""
    drift: float = 0.15
    """Largest change between the first and last quarter of the data's phase against that of the fitted motion, rad."""


def on_its_side(value: float, other: float, falls: bool | None = None, ratio: float = LEAST_RATIO) -> float:
    """Return a coefficient at least `ratio` above another one, or as much below it if friction does not fall."""
    above = value >= other if falls is None else falls
    return max(value, other * ratio) if above else min(value, other / ratio)


def least_ratio(keys: Collection[str]) -> float:
    """Return the least ratio of mu_s and mu_k with these free keys."""
    return LEAST_RATIO if "friction.decay" in keys else EQUAL


def largest_errors(keys: tuple[str, ...]) -> Floats:
    """Return the standard errors, (P,), of logarithms or of offsets, above which a measurement holds nothing about a
    key; infinite for the numbers of a curve, which mean nothing individually.
    """
    return np.array([math.inf if key.startswith(CURVE) else
                     QUANTITIES[topic(OFFSETS[key]).key].high if key in OFFSETS else UNKNOWN for key in keys])


def check_key(key: str) -> None:
    """Raise InputError unless a key can be identified."""
    if key not in FREE:
        if key in SCENE_KEYS:
            raise InputError(f"{key} cannot be identified; what can: {', '.join((CURVE, *FREE))}")
        raise unknown_key(key, dict.fromkeys((CURVE, *FREE)))


@dataclass(frozen=True)
class Model:
    """A driveline with free `keys`, driven by a measurement."""

    system: System
    keys: tuple[str, ...]
    measured: Measurement

    def drive(self, values: Floats) -> tuple[Terms, Floats | None, Floats]:
        """Return its input for values of the keys; raise OutOfRange if one is out of its range.

        These are the terms of the scene, where measured inputs are 0; engine torque and saturation torque, N m, at the
        start and end of each sample's step, (n, 2, 2), that are added to them, or None; and derivatives of the numbers
        of the equations by the keys, (len(NUMBERS), P).
        """
        named = {k: float(v) for k, v in zip(self.keys, values) if k in SCENE_KEYS}
        curve = {k: float(v) for k, v in zip(self.keys, values) if k.startswith(CURVE)}
        offsets = {OFFSETS[k]: float(v) for k, v in zip(self.keys, values) if k in OFFSETS}
        # Friction of a curve is its constant times a shape, which `terms` have.
        alone = {STATIC: curve[CONSTANT], KINETIC: curve[CONSTANT], **dict.fromkeys(TABLE, ())} if curve else {}
        system = changed(self.system, named | alone)
        inputs, by = self.measured.inputs, np.zeros((len(keyed.NUMBERS), len(self.keys)))
        per_pressure, terms = system.torque_per_pressure, terms_of(system)
        if curve:
            terms = terms._replace(stribeck=tuple(pairs_of(curve)))
        for i, key in enumerate(self.keys):
            if OFFSETS.get(key) == "engine_torque":
                by[keyed.MEAN_TORQUE, i] = -1.0
            elif key in OFFSETS:
                by[keyed.MEAN_LOAD, i] = -per_pressure
            elif key in CURVE_ROWS:
                by[CURVE_ROWS[key], i] = 1.0
            elif key == CONSTANT:
                by[keyed.LOG_LOAD, i] = 1.0 / curve[CONSTANT]
            else:
                by[:, i] = keyed.key_derivatives(system, (key,))[:, 0]
            if key == KINETIC:   # It scales the load, also a measured one.
                by[keyed.MEAN_LOAD:keyed.LOAD_AMPLITUDE + 1, i] = 0.0
                by[keyed.LOG_LOAD, i] = 1.0 / system.friction.kinetic_coefficient
        if not inputs and not offsets:
            return terms, None, by
        terms = holding(terms, *(0.0 if name in inputs else None for name in INPUTS))
        torque, pressure = (self.measured.ends_of(name) - offsets.get(name, 0.0) for name in INPUTS)
        load = np.maximum(per_pressure * pressure, -least_mean_load(terms))
        return terms, np.stack([torque, load], axis=2), by

    def within(self, values: Floats) -> Floats:
        """Return values with the numbers of a curve limited to their ranges."""
        low, high = rates_allowed(float(np.abs(self.measured.channels["slip_speed"]).max()))
        bounds = dict.fromkeys(SHARES, (-LARGEST_SHARE, LARGEST_SHARE)) | dict.fromkeys(RATES, (low, high))
        least, most = np.array([bounds.get(key, (-math.inf, math.inf)) for key in self.keys]).reshape(-1, 2).T
        return np.asarray(np.clip(values, least, most))

    def effect(self, key: str) -> float:
        """Return the value of a key that may be 0 at which it acts as strongly as the other torques; 0 for other keys.

        Critical damping of the plate on its shaft; a fluid torque as large as the engine's mean torque, or a fall of
        friction by 1 - 1/e, at the largest slip speed.
        """
        driveline, engine = self.system.driveline, self.system.engine
        fastest = float(np.abs(self.measured.channels["slip_speed"]).max()) or math.inf
        return {"driveline.damping": 2.0 * math.sqrt(driveline.stiffness * driveline.plate_inertia),
                "converter.coupling": abs(engine.mean_torque) / fastest, "friction.decay": 1.0 / fastest}.get(key, 0.0)

    def substeps(self, values: Floats) -> int:
        """Return the sub-steps per sample, with a reserve for slightly different values; raise OutOfRange for too many.
        """
        terms, held, _ = self.drive(values)
        most = 0.0 if held is None else float(held[..., 1].max())
        return math.ceil(SPARE * substeps(terms, self.measured.step, most))


def states_of(model: Model, starts: Floats, width: int, values: Floats, n: int) -> Floats:
    """Return the states of windows of `width` samples, (m, width + 1, 3), from their starts, (m, 3), in n sub-steps."""
    return sensitivities(model, starts, width, values, n, by_keys=False)[0]


def sensitivities(model: Model, starts: Floats, width: int, values: Floats, n: int,
                  by_keys: bool = True) -> tuple[Floats, Floats]:
    """Return the states of every window, and their derivatives by its start and the keys, (m, width + 1, 3, 3 + P).

    Raise NumericalFailure if a state is not finite.
    """
    measured, (terms, held, by) = model.measured, model.drive(values)
    advanced = advance_windows(starts, float(measured.t[0]), measured.step, width, n, terms, held,
                               by if by_keys else np.empty((len(keyed.NUMBERS), 0)))
    if not np.isfinite(advanced[0]).all():
        raise NumericalFailure("the state is not finite")
    return advanced


@dataclass(frozen=True)
class Fit:
    """Result of a fit.

    values : (P,) of the parameters
    starts : (m, 3) of the windows
    residuals : by channel (n,), in its unit
    chi2 : sum of squared residuals over the noise, per degree of freedom
    freedom : degrees of freedom
    work : sub-steps times computed derivatives
    gap : largest weighted gap between windows; large values mean that they do not join to one motion
    """

    values: Floats
    starts: Floats
    residuals: dict[str, Floats]
    chi2: float
    gap: float
    freedom: int
    work: float = 0.0


def fit(model: Model, noise: dict[str, float], values: Floats, settings: FitSettings, stages: tuple[Stage, ...] = (),
        starts: Floats | None = None, tick: Callable[[], None] | None = None) -> Fit:
    """Fit a measurement, starting from `values`; raise one of FAILED if the solution there cannot be computed.

    noise : standard deviation of every measured channel
    values : (P,) of the model's keys
    stages : by default those of the settings
    starts : of the first stage's windows; by default from the measurement
    tick : function called after every iteration
    """
    width, work = 0, 0.0
    for stage in stages or settings.stages:
        problem = MultipleShooting(model, noise, settings, stage.window)
        if starts is None:
            starts = problem.first_starts(values)
        elif width and width != problem.width:
            states = states_of(model, starts, width, values, model.substeps(values))[:, :-1].reshape(-1, 3)
            starts = states[np.minimum(np.arange(problem.count) * problem.width, len(states) - 1)]
        width = problem.width
        values, starts = problem.descend(values, starts, stage, tick)
        work += problem.work
    assert starts is not None
    return replace(problem.result(values, starts, stage.weight), work=work)


class Normal(NamedTuple):
    """Normal equations of m windows: a band for their starts, of which each depends on the next one too, with a border
    for the P parameters.

    diagonal : (m, 3, 3) of the starts
    following : (m - 1, 3, 3) of a start (rows) and the next one (columns)
    border : (m, 3, P) of the starts and the parameters
    corner : (P, P) of the parameters
    slope, slope_by_key : (m, 3), (P,) right-hand sides
    """

    diagonal: Floats
    following: Floats
    border: Floats
    corner: Floats
    slope: Floats
    slope_by_key: Floats

    def holding(self, held: NDArray[np.bool_]) -> Normal:
        """Return the equations with some parameters, (P,), held."""
        free = ~held
        return self._replace(border=self.border * free, corner=self.corner * np.outer(free, free) + np.diag(1.0 * held),
                             slope_by_key=self.slope_by_key * free)

    def solved(self, damping: float) -> tuple[Floats, Floats]:
        """Return steps of the starts and of the parameters with Levenberg's damping; raise LinAlgError if singular."""
        solved = self.by_starts(damping)
        squares, slope = self.by_keys(solved, damping)
        by_key = -np.linalg.inv(squares) @ slope
        return -solved[..., -1] - solved[..., :-1] @ by_key, by_key

    def by_starts(self, damping: float) -> Floats:
        """Solve the starts' equations for the columns of the parameters and for the slope, (m, 3, P + 1)."""
        m, size = len(self.diagonal), len(self.corner)
        banded = np.zeros((6, 3 * m))   # as SciPy's solveh_banded takes it: the diagonal is the last row
        for i in range(3):
            for j in range(3):
                if j >= i:
                    banded[5 + i - j, j::3] = self.diagonal[:, i, j]
                banded[2 + i - j, 3 + j::3] = self.following[:, i, j]
        banded[5] *= 1.0 + damping
        banded[5] += 1e-300
        right = np.concatenate([self.border.reshape(3 * m, size), self.slope.reshape(3 * m, 1)], axis=1)
        return np.asarray(solveh_banded(banded, right)).reshape(m, 3, size + 1)

    def by_keys(self, solved: Floats, damping: float) -> tuple[Floats, Floats]:
        """Return the equations of the parameters (P, P), (P,) after the elimination of the starts, `by_starts`."""
        size = len(self.corner)
        both = np.concatenate(self.border).T @ np.concatenate(solved)
        corner = self.corner + damping * np.diag(np.diag(self.corner))
        return corner - both[:, :size], self.slope_by_key - both[:, size]


class MultipleShooting:
    """Least-squares problem of a measurement in windows of one length, s."""

    def __init__(self, model: Model, noise: dict[str, float], settings: FitSettings, window: float) -> None:
        self.model, self.settings, self.work = model, settings, 0.0
        measured = model.measured
        self.width = min(max(4, round(window / measured.step)), len(measured.t) // 2)
        self.count = len(measured.t) // self.width
        used = self.count * self.width
        self.channels = [name for name in INDEX if name in measured.channels]
        self.columns = [INDEX[name] for name in self.channels]
        self.noise = np.array([noise[name] for name in self.channels])
        self.data = np.column_stack([measured.channels[name][:used] for name in self.channels]).reshape(
            self.count, self.width, -1)
        self.scales = np.array([noise["slip_speed"], noise.get("plate_angle", settings.angle_noise),
                                noise.get("plate_speed", noise["slip_speed"])])
        slip = measured.channels["slip_speed"][:used:self.width]
        self.stuck = np.flatnonzero(np.abs(slip) < settings.stuck * noise["slip_speed"])
        self.largest = largest_errors(model.keys)
        self.logarithmic = np.array([k not in LINEAR for k in model.keys])

    def first_starts(self, values: Floats) -> Floats:
        """Return starts of the windows from the measurement; other states are solved from the first sample on."""
        measured, used, system = self.model.measured, self.count * self.width, self.model.system
        whole, twist = np.zeros((used, 3)), system.engine.mean_torque / system.driveline.stiffness
        whole[:, self.columns] = self.data.reshape(used, -1)
        if "plate_speed" in self.channels and "plate_angle" not in self.channels:
            angle = np.cumsum(whole[:, 2]) * measured.step
            whole[:, 1] = angle - angle.mean() + twist
        elif "plate_angle" not in self.channels:
            begin = np.array([[whole[0, 0], twist, 0.0]])
            whole[:, 1:] = states_of(self.model, begin, used, values, self.model.substeps(values))[0, :used, 1:]
        starts: Floats = whole[::self.width].copy()
        starts[self.stuck, 0] = 0.0
        return starts

    def descend(self, values: Floats, starts: Floats, stage: Stage,
                tick: Callable[[], None] | None) -> tuple[Floats, Floats]:
        """Run one stage; return parameters and starts."""
        damping, n = 1e-3, self.model.substeps(values)
        linear = sensitivities(self.model, starts, self.width, values, n)
        for _ in range(stage.iterations):
            rows = self._rows(linear[0], starts, stage.weight)
            limit = stage.robust * max(1.0, float(np.median(np.mean(rows**2, axis=1))))
            cost, gain = self._cost(rows, limit), 0.0
            normal = self._normal(rows, linear[1] * self._scales(values), stage.weight, limit)
            while damping < 1e8:
                try:
                    by_start, by_key = self._step(normal, damping, values)
                    tried, moved = self._moved(values, by_key), starts + by_start * self.scales
                    self.work += n * self.count * self.width * (3.0 + len(values))
                    trial = sensitivities(self.model, moved, self.width, tried, n)
                    now = self._cost(self._rows(trial[0], moved, stage.weight), limit)
                except (NumericalFailure, OutOfRange, np.linalg.LinAlgError):
                    now = math.inf
                if now < cost:
                    gain, values, starts, linear = cost - now, tried, moved, trial
                    damping = max(0.1 * damping, 1e-9)
                    break
                damping *= 10.0
            if tick is not None:
                tick()
            # A fit that creeps far above the noise is in a wrong minimum; another start is better.
            wrong = math.isinf(stage.robust) and cost > self.settings.far * rows.size
            if gain < max(stage.tolerance, self.settings.least_gain / rows.size, 0.01 * wrong) * cost:
                break
        if math.isfinite(stage.robust):
            starts = self._mended(values, starts, linear[0], stage.weight, n)
        return values, starts

    def _step(self, normal: Normal, damping: float, values: Floats) -> tuple[Floats, Floats]:
        """Return the steps of starts and parameters.

        Parameters without an effect on the measurement, and those that would leave their range from a bound, are held.
        """
        held = np.sqrt(np.diag(normal.corner)) * self.largest < 1.0
        while True:
            by_start, by_key = (normal.holding(held) if held.any() else normal).solved(damping)
            beyond = (self._within(values, np.clip(by_key, -1.0, 1.0)) == values) & (by_key != 0.0)
            if not beyond.any():
                return by_start, by_key
            held |= beyond

    def _within(self, values: Floats, step: Floats) -> Floats:
        """Return the parameters after a step, in their ranges; all but those in LINEAR by their logarithms."""
        factor = np.exp(np.where(self.logarithmic, step, 0.0))
        return self.model.within(np.where(self.logarithmic, values * factor, values + step))

    def _mended(self, values: Floats, starts: Floats, states: Floats, weight: float, n: int) -> Floats:
        """Return the starts, replaced by the end of the window before where that costs less."""
        ends = np.concatenate([starts[:1], states[:-1, -1]])
        other = states_of(self.model, ends, self.width, values, n)
        costs, moved_costs = (np.sum(self._rows(x, starts, weight) ** 2, axis=1) for x in (states, other))
        # The gap to the window before vanishes; those after it are measured to the old starts.
        costs[1:] += weight * np.sum(((ends - starts)[1:] / self.scales) ** 2, axis=1)
        return np.where((moved_costs < costs)[:, None], ends, starts)

    def _moved(self, values: Floats, step: Floats) -> Floats:
        """Return the parameters after a step of their logarithms, except offsets; mu_s stays on its side of mu_k."""
        largest = self.settings.largest_step
        out = self._within(values, np.where(self.logarithmic, np.clip(step, -largest, largest), step))
        keys, friction = self.model.keys, self.model.system.friction
        fixed = {STATIC: friction.static_coefficient, KINETIC: friction.kinetic_coefficient}
        before, after = ([float(of[keys.index(key)]) if key in keys else value for key, value in fixed.items()]
                         for of in (values, out))
        falls = before[0] >= before[1]
        if STATIC in keys:
            out[keys.index(STATIC)] = on_its_side(after[0], after[1], falls, least_ratio(keys))
        elif KINETIC in keys:
            out[keys.index(KINETIC)] = on_its_side(after[1], after[0], not falls, least_ratio(keys))
        return out

    def _fitted(self, states: Floats) -> Floats:
        """Return the residuals of every window over the noise, (m, samples)."""
        out: Floats = ((states[:, :-1][:, :, self.columns] - self.data) / self.noise).reshape(self.count, -1)
        return out

    def _rows(self, states: Floats, starts: Floats, weight: float) -> Floats:
        """Return the residuals of every window, (m, R): samples over noise, the gap after it, a start held in stick."""
        fitted, rows = self._fitted(states), np.zeros((self.count, 4))
        rows[:-1, :3] = (states[:-1, -1] - starts[1:]) / self.scales * math.sqrt(weight)
        stuck = self._held(weight)
        fitted[stuck, 0] = 0.0
        rows[stuck, 3] = starts[stuck, 0] / self.settings.layer
        return np.concatenate([fitted, rows], axis=1)

    def _held(self, weight: float) -> NDArray[np.intp]:
        """Return the windows whose start is held in stick."""
        return self.stuck if weight < self.settings.joined else self.stuck[:0]

    @staticmethod
    def _cost(rows: Floats, limit: float) -> float:
        """Return the sum of squares of the windows' residuals, by Cauchy's loss if `limit` is finite."""
        squares = np.sum(rows**2, axis=1)
        bound = limit * rows.shape[1]
        return float(np.sum(squares if math.isinf(bound) else bound * np.log1p(squares / bound)))

    def _scales(self, values: Floats) -> Floats:
        """Return factors (3 + P,) that turn derivatives into those by scaled starts and by logarithms of keys."""
        return np.append(self.scales, np.where(self.logarithmic, values, 1.0))

    def _normal(self, rows: Floats, by: Floats, weight: float, limit: float) -> Normal:
        """Return the normal equations of all starts and parameters, from derivatives by `_scales`."""
        m, size, root = self.count, by.shape[-1] - 3, math.sqrt(weight)
        fitted = (by[:, :-1][:, :, self.columns] / self.noise[:, None]).reshape(m, -1, 3 + size)
        others = np.zeros((m, 4, 3 + size))
        others[:-1, :3] = by[:-1, -1] * (root / self.scales[:, None])
        stuck = self._held(weight)
        fitted[stuck, 0] = 0.0
        others[stuck, 3, 0] = self.scales[0] / self.settings.layer
        trust = 1.0 / (1.0 + np.mean(rows**2, axis=1) / limit)   # Cauchy's loss as weights
        matrix = np.concatenate([fitted, others], axis=1)
        turned = (matrix * trust[:, None, None]).transpose(0, 2, 1)
        squares, slopes = turned @ matrix, (turned @ rows[:, :, None])[:, :, 0]
        # The gap of a window depends on the start of the next one, too.
        gap, before = others[:-1, :3] * trust[:-1, None, None], rows[:-1, -4:-1] * trust[:-1, None]
        diagonal, border, slope = squares[:, :3, :3], squares[:, :3, 3:], slopes[:, :3]
        diagonal[1:] += weight * trust[:-1, None, None] * np.eye(3)
        border[1:] -= root * gap[:, :, 3:]
        slope[1:] -= root * before
        return Normal(diagonal, -root * gap[:, :, :3].transpose(0, 2, 1), border, squares[:, 3:, 3:].sum(axis=0), slope,
                      slopes[:, 3:].sum(axis=0))

    def result(self, values: Floats, starts: Floats, weight: float) -> Fit:
        """Return the fit."""
        states = states_of(self.model, starts, self.width, values, self.model.substeps(values))
        rows, fitted = self._rows(states, starts, weight), self._fitted(states).reshape(-1, len(self.channels))
        freedom = max(fitted.size - len(values) - 3, 1)
        return Fit(values, starts, {name: fitted[:, i] * self.noise[i] for i, name in enumerate(self.channels)},
                   float(np.sum(fitted**2)) / freedom, float(np.abs(rows[:, -4:-1]).max()), freedom)

    def _by_inputs(self, values: Floats, starts: Floats, states: Floats) -> Iterator[Floats]:
        """Yield the derivatives of all states by scale and delay (s) of each measured input, (m, width + 1, 3, 1)."""
        measured, n = self.model.measured, self.model.substeps(values)
        for name, column in measured.inputs.items():
            for change, size in ((column, NUDGE), (-np.gradient(column, measured.step, axis=0), NUDGE * measured.step)):
                moved = replace(measured, inputs={**measured.inputs, name: column + size * change})
                other = states_of(replace(self.model, measured=moved), starts, self.width, values, n)
                yield (other - states)[..., None] / size

    def explained(self, values: Floats, starts: Floats, weight: float) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the residuals of a fit with the effect of changes of the keys and of the channels.

        These are residuals over the noise, (n, C), with their total derivatives, (n, C, Q), and the normal equations
        (Q, Q), (Q,). The starts follow the Q columns: keys, in logarithms except offsets, then offset, scale and delay
        (s) of every channel, then scale and delay of every measured input.
        """
        states, derivatives = sensitivities(self.model, starts, self.width, values, self.model.substeps(values))
        rows, size = self._rows(states, starts, weight), len(self.channels)
        seen = np.zeros((*states.shape, 3 * size))
        for i, column in enumerate(self.columns):   # The last sample belongs to the gap, not to a channel.
            signal = states[:, :, column]
            rate = np.gradient(signal, self.model.measured.step, axis=1)
            seen[:, :-1, column, 3 * i:3 * i + 3] = np.stack([np.ones_like(signal), signal, -rate], 2)[:, :-1]
        by = np.concatenate([derivatives * self._scales(values), seen, *self._by_inputs(values, starts, states)], 3)
        normal = self._normal(rows, by, weight, math.inf)
        solved = normal.by_starts(0.0)
        columns = by[:, :-1][:, :, self.columns] / self.noise[:, None]
        total = columns[..., 3:] - columns[..., :3] @ solved[:, None, :, :-1]
        return (self._fitted(states).reshape(-1, size), total.reshape(-1, size, total.shape[-1]),
                *normal.by_keys(solved, 0.0))
