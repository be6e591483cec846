"""Parameters and starts of windows that fit a measurement: Gauss-Newton with Levenberg's damping.

Multiple shooting after H. G. Bock (1983): every window has a start of its own, and the ends of windows meet the starts
of the next as equations whose weight grows in stages, for a chaotic motion forgets its start within some windows. In
stick a window's start has no slip speed of its own: noise there would start a false breakaway, so that in the first
stages it is held near 0. In the last ones the window before says where it starts; held on, slow slip that looks like
stick would bend the parameters.

A window in which stick ends says little while the parameters are some per cent off: the time of the breakaway is then
wrong by more than a sample, and its residuals are all but a step in the parameters. In the first stages such windows
count by Cauchy's loss (P. J. Huber and E. M. Ronchetti, Robust Statistics, 2009, Section 7.8), and they may begin again
where the window before ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from tcc_sim.errors import NumericalFailure
from tcc_sim.estimation.settings import DEFAULTS, FitSettings, Stage
from tcc_sim.estimation.windows import (
    KINETIC,
    OFFSETS,
    STATIC,
    Model,
    Sensitivities,
    sensitivities,
    states_of,
)
from tcc_sim.trajectory import Floats

INDEX = {"slip_speed": 0, "plate_angle": 1, "plate_speed": 2}
"""Place of a channel in the state."""


@dataclass(frozen=True)
class Fit:
    """What a fit came to.

    values : (P,) of the parameters
    covariance : (P, P), for the noise that was given
    starts : (m, 3) of the windows
    residuals : by channel (n,), in its unit
    chi2 : sum of squared residuals over the noise, a degree of freedom
    gap : largest gap between windows, by the root of its weight: above some units the windows are not one motion
    """

    values: Floats
    covariance: Floats
    starts: Floats
    residuals: dict[str, Floats]
    chi2: float
    gap: float


def fit(model: Model, noise: dict[str, float], values: Floats, settings: FitSettings, stages: tuple[Stage, ...] = (),
        starts: Floats | None = None, tick: Callable[[], None] | None = None) -> Fit:
    """Fit a measurement from `values` on.

    Parameters
    ----------
    noise : standard deviation of every measured channel
    values : (P,) of the model's keys
    stages : those of the settings unless others are given
    starts : of the first stage's windows; by default from what was measured
    tick : called after every iteration

    Raises
    ------
    NumericalFailure
        The solution cannot be computed at the start.
    """
    width = 0
    for stage in stages or settings.stages:
        problem = MultipleShooting(model, noise, settings, stage.window)
        if starts is None:
            starts = problem.first_starts(values)
        elif width and width != problem.width:
            starts = problem.regrouped(starts, width, values)
        width = problem.width
        values, starts = problem.descend(values, starts, stage, tick)
    assert starts is not None
    return problem.result(values, starts, stage.weight)


class MultipleShooting:
    """The least-squares problem of one measurement in windows of one length, s."""

    def __init__(self, model: Model, noise: dict[str, float], settings: FitSettings, window: float) -> None:
        self.model, self.settings = model, settings
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
        self.logarithmic = np.array([k not in OFFSETS for k in model.keys])

    def first_starts(self, values: Floats) -> Floats:
        """Starts of the windows from what was measured; what was not comes from a solution from the first sample on."""
        measured, used, system = self.model.measured, self.count * self.width, self.model.system
        whole = np.zeros((used, 3))
        whole[:, 0] = measured.channels["slip_speed"][:used]
        d, rest = system.driveline, system.engine.mean_torque
        if "plate_speed" in measured.channels:
            whole[:, 2] = measured.channels["plate_speed"][:used]
        if "plate_angle" in measured.channels:
            whole[:, 1] = measured.channels["plate_angle"][:used]
        elif "plate_speed" in measured.channels:
            angle = np.cumsum(whole[:, 2]) * measured.step
            whole[:, 1] = angle - angle.mean() + rest / d.stiffness
        else:
            begin = np.array([[whole[0, 0], rest / d.stiffness, 0.0]])
            whole[:, 1:] = states_of(self.model, begin, used, values, self.model.substeps(values))[0, :used, 1:]
        starts: Floats = whole[::self.width].copy()
        starts[self.stuck, 0] = 0.0
        return starts

    def regrouped(self, starts: Floats, width: int, values: Floats) -> Floats:
        """Starts of these windows from those of windows of another `width`."""
        states = states_of(self.model, starts, width, values, self.model.substeps(values))[:, :-1].reshape(-1, 3)
        return np.array([states[min(k * self.width, len(states) - 1)] for k in range(self.count)])

    def descend(self, values: Floats, starts: Floats, stage: Stage,
                tick: Callable[[], None] | None) -> tuple[Floats, Floats]:
        """One stage: parameters and starts."""
        damping, n = 1e-3, self.model.substeps(values)
        found = sensitivities(self.model, starts, self.width, values, n)
        for _ in range(stage.iterations):
            rows = self._rows(found.states, starts, stage.weight)
            limit = stage.robust * max(1.0, float(np.median(np.mean(rows**2, axis=1))))
            cost, gain = self._cost(rows, limit), 0.0
            normal = self._normal(rows, found, values, stage.weight, limit)
            while damping < 1e8:
                try:
                    by_start, by_key, _ = normal.solved(damping)
                    tried, moved = self._moved(values, by_key), starts + by_start * self.scales
                    there = sensitivities(self.model, moved, self.width, tried, n)
                    now = self._cost(self._rows(there.states, moved, stage.weight), limit)
                except (NumericalFailure, np.linalg.LinAlgError):
                    now = math.inf
                if now < cost:
                    gain, values, starts, found = cost - now, tried, moved, there
                    damping = max(0.1 * damping, 1e-9)
                    break
                damping *= 10.0
            if tick is not None:
                tick()
            if gain < stage.tolerance * cost:
                break
        if math.isfinite(stage.robust):
            starts = self._mended(values, starts, found.states, stage.weight, n)
        return values, starts

    def _mended(self, values: Floats, starts: Floats, states: Floats, weight: float, n: int) -> Floats:
        """Starts, where it costs less to begin where the window before ends: from there."""
        ends = np.concatenate([starts[:1], states[:-1, -1]])
        other = states_of(self.model, ends, self.width, values, n)
        own, there = (np.sum(self._rows(x, starts, weight) ** 2, axis=1) for x in (states, other))
        # Its gap to the window before is there no more; those after it are taken to the starts as they are.
        own[1:] += weight * np.sum(((ends - starts)[1:] / self.scales) ** 2, axis=1)
        return np.where((there < own)[:, None], ends, starts)

    def _moved(self, values: Floats, step: Floats) -> Floats:
        """The parameters after a step: of their logarithms, but for offsets; mu_s stays above mu_k."""
        limited = np.clip(step, -self.settings.largest_step, self.settings.largest_step)
        out: Floats = np.where(self.logarithmic, values * np.exp(limited), values + step)
        keys = self.model.keys
        if STATIC in keys:
            kinetic = out[keys.index(KINETIC)] if KINETIC in keys else self.model.system.friction.kinetic_coefficient
            out[keys.index(STATIC)] = max(out[keys.index(STATIC)], kinetic * DEFAULTS.least_ratio)
        elif KINETIC in keys:
            out[keys.index(KINETIC)] = min(out[keys.index(KINETIC)],
                                           self.model.system.friction.static_coefficient / DEFAULTS.least_ratio)
        return out

    def _fitted(self, states: Floats) -> Floats:
        """(m, samples) residuals of every window over the noise."""
        out: Floats = ((states[:, :-1][:, :, self.columns] - self.data) / self.noise).reshape(self.count, -1)
        return out

    def _rows(self, states: Floats, starts: Floats, weight: float) -> Floats:
        """(m, R) residuals of every window: samples over their noise, the gap after it, and a start held in stick."""
        fitted, rows = self._fitted(states), np.zeros((self.count, 4))
        rows[:-1, :3] = (states[:-1, -1] - starts[1:]) / self.scales * math.sqrt(weight)
        stuck = self._held(weight)
        fitted[stuck, 0] = 0.0
        rows[stuck, 3] = starts[stuck, 0] / self.settings.layer
        return np.concatenate([fitted, rows], axis=1)

    def _held(self, weight: float) -> NDArray[np.intp]:
        """The windows whose start is held in stick."""
        return self.stuck if weight < self.settings.joined else self.stuck[:0]

    @staticmethod
    def _cost(rows: Floats, limit: float) -> float:
        """Sum of squares of the windows' residuals, by Cauchy's loss where `limit` is finite."""
        squares = np.sum(rows**2, axis=1)
        bound = limit * rows.shape[1]
        return float(np.sum(squares if math.isinf(bound) else bound * np.log1p(squares / bound)))

    def _normal(self, rows: Floats, found: Sensitivities, values: Floats, weight: float, limit: float) -> Normal:
        """The normal equations by all starts, in their scales, and all parameters: logarithms, but for offsets."""
        m, size, root = self.count, len(values), math.sqrt(weight)
        by = np.concatenate([found.by_start * self.scales, found.by_key * np.where(self.logarithmic, values, 1.0)], 3)
        fitted = (by[:, :-1][:, :, self.columns] / self.noise[:, None]).reshape(m, -1, 3 + size)
        others = np.zeros((m, 4, 3 + size))
        others[:-1, :3] = by[:-1, -1] * (root / self.scales[:, None])
        stuck = self._held(weight)
        fitted[stuck, 0] = 0.0
        others[stuck, 3, 0] = self.scales[0] / self.settings.layer
        trust = 1.0 / (1.0 + np.mean(rows**2, axis=1) / limit)   # Cauchy's loss by weights
        matrix = np.concatenate([fitted, others], axis=1)
        turned = (matrix * trust[:, None, None]).transpose(0, 2, 1)
        squares, slopes = turned @ matrix, (turned @ rows[:, :, None])[:, :, 0]
        # What a window's gap owes to the start of the next one, which it is measured from.
        gap, before = others[:-1, :3] * trust[:-1, None, None], rows[:-1, -4:-1] * trust[:-1, None]
        own, border, slope = squares[:, :3, :3], squares[:, :3, 3:], slopes[:, :3]
        own[1:] += weight * trust[:-1, None, None] * np.eye(3)
        border[1:] -= root * gap[:, :, 3:]
        slope[1:] -= root * before
        return Normal(own, -root * gap[:, :, :3].transpose(0, 2, 1), border, squares[:, 3:, 3:].sum(axis=0), slope,
                      slopes[:, 3:].sum(axis=0))

    def result(self, values: Floats, starts: Floats, weight: float) -> Fit:
        """The fit with its covariance."""
        found = sensitivities(self.model, starts, self.width, values, self.model.substeps(values))
        rows = self._rows(found.states, starts, weight)
        scale = np.where(self.logarithmic, values, 1.0)
        covariance = self._normal(rows, found, values, weight, math.inf).covariance() * np.outer(scale, scale)
        fitted = self._fitted(found.states).reshape(-1, len(self.channels))
        return Fit(values, covariance, starts,
                   {name: fitted[:, i] * self.noise[i] for i, name in enumerate(self.channels)},
                   float(np.sum(fitted**2)) / max(fitted.size - len(values) - 3, 1),
                   float(np.abs(rows[:, -4:-1]).max()))


class Normal(NamedTuple):
    """Normal equations of m windows, each of which knows its own start, the next one's, and the P parameters.

    own : (m, 3, 3) of the starts
    following : (m - 1, 3, 3) of a start (rows) and the next one (columns)
    border : (m, 3, P) of the starts and the parameters
    corner : (P, P) of the parameters
    slope, slope_by_key : (m, 3), (P,) right-hand sides
    """

    own: Floats
    following: Floats
    border: Floats
    corner: Floats
    slope: Floats
    slope_by_key: Floats

    def solved(self, damping: float) -> tuple[Floats, Floats, Floats]:
        """Steps of the starts and of the parameters with Levenberg's damping, and the parameters' covariance.

        Raises
        ------
        numpy.linalg.LinAlgError
            The equations are singular.
        """
        m, size = len(self.own), len(self.corner)
        banded = np.zeros((6, 3 * m))   # as SciPy's solveh_banded takes it: the diagonal is the last row
        for i in range(3):
            for j in range(3):
                if j >= i:
                    banded[5 + i - j, j::3] = self.own[:, i, j]
                banded[2 + i - j, 3 + j::3] = self.following[:, i, j]
        banded[5] *= 1.0 + damping
        banded[5] += 1e-300
        right = np.concatenate([self.border.reshape(3 * m, size), self.slope.reshape(3 * m, 1)], axis=1)
        found = solveh_banded(banded, right)
        corner = self.corner + damping * np.diag(np.diag(self.corner))
        both = right[:, :size].T @ found
        covariance = np.linalg.inv(corner - both[:, :size])
        by_key = -covariance @ (self.slope_by_key - both[:, size])
        by_start = -found[:, size] - found[:, :size] @ by_key
        return by_start.reshape(m, 3), by_key, 0.5 * (covariance + covariance.T)

    def covariance(self) -> Floats:
        """(P, P) of the parameters; with a little damping where rounding leaves the equations no inverse.

        Raises
        ------
        NumericalFailure
            The equations are singular.
        """
        for damping in (0.0, 1e-13, 1e-11, 1e-9):
            try:
                return self.solved(damping)[2]
            except np.linalg.LinAlgError:
                continue
        raise NumericalFailure("the parameters' covariance cannot be worked out")
