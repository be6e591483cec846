"""Parameters and starts of windows that fit a measurement: Gauss-Newton with Levenberg's damping.

Multiple shooting after H. G. Bock (1983): every window has a start of its own, and the ends of windows meet the starts
of the next as equations whose weight grows in stages, for a chaotic motion forgets its start within some windows. In
stick a window's start has no slip speed of its own: noise there would start a false breakaway, so that in the first
stages it is held near 0. In the last ones the window before says where it starts; held on, slow slip that looks like
stick would bend the parameters.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from tcc_sim.errors import NumericalFailure
from tcc_sim.estimation.windows import KINETIC, NEAR_ONE, OFFSETS, STATIC, Model, Swept, states_of, sweep
from tcc_sim.trajectory import Floats

INDEX = {"slip_speed": 0, "plate_angle": 1, "plate_speed": 2}
"""Place of a channel in the state."""


@dataclass(frozen=True)
class Stage:
    """One stage of the fit.

    window : s of a window
    weight : of continuity, per squared noise
    tolerance : relative change of the cost at which the stage ends
    iterations : most
    """

    window: float
    weight: float
    tolerance: float
    iterations: int


@dataclass(frozen=True)
class Settings:
    """How the fit is made.

    stages : from windows all but free to long ones that are all but one motion: short ones with a great weight creep
    layer : slip speed, rad/s, within which a start in stick is held
    joined : weight from which on starts in stick are no longer held
    stuck : slip speeds below so many standard deviations of the noise count as stick in a window's start
    largest_step : of a parameter's logarithm in one iteration
    angle_noise : rad, the scale of a plate angle that was not measured
    """

    stages: tuple[Stage, ...] = (Stage(0.01, 1e-4, 1e-2, 8), Stage(0.01, 1e-2, 1e-2, 8), Stage(0.01, 1.0, 1e-3, 12),
                                 Stage(0.01, 1e3, 1e-3, 12), Stage(0.1, 1e4, 1e-8, 30))
    layer: float = 0.03
    joined: float = 1e3
    stuck: float = 4.0
    largest_step: float = 0.3
    angle_noise: float = 1e-4


@dataclass(frozen=True)
class Fit:
    """What a fit came to.

    values : (P,) of the parameters
    covariance : (P, P), for the noise that was given
    starts : (m, 3) of the windows
    width : samples of a window
    residuals : by channel (n,), in its unit
    chi2 : sum of squared residuals over the noise, a degree of freedom
    cost : the same as a sum, with what continuity costs
    iterations : in all
    """

    values: Floats
    covariance: Floats
    starts: Floats
    width: int
    residuals: dict[str, Floats]
    chi2: float
    cost: float
    iterations: int


def fit(model: Model, noise: dict[str, float], values: Floats, settings: Settings, stages: tuple[Stage, ...] = (),
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
    iterations, width = 0, 0
    for stage in stages or settings.stages:
        problem = Shooting(model, noise, settings, stage.window)
        if starts is None:
            starts = problem.first_starts(values)
        elif width and width != problem.width:
            starts = problem.regrouped(starts, width, values)
        width = problem.width
        values, starts, cost, count = problem.descend(values, starts, stage, tick)
        iterations += count
    assert starts is not None
    return problem.result(values, starts, stage.weight, cost, iterations)


class Shooting:
    """The least-squares problem of one measurement in windows of one length, s."""

    def __init__(self, model: Model, noise: dict[str, float], settings: Settings, window: float) -> None:
        self.model, self.settings = model, settings
        measured = model.measured
        self.width = min(max(4, round(window / measured.step)), len(measured.t) // 2)
        self.count = len(measured.t) // self.width
        used = self.count * self.width
        self.channels = [name for name in INDEX if name in measured.channels]
        self.columns = [INDEX[name] for name in self.channels]
        self.noise = np.array([noise[name] for name in self.channels])
        self.data = np.column_stack([measured.channels[name][:used] for name in self.channels])
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
                tick: Callable[[], None] | None) -> tuple[Floats, Floats, float, int]:
        """One stage: parameters, starts, cost, and how many iterations it took."""
        weight = stage.weight
        damping, size, n = 1e-3, 3 * self.count, self.model.substeps(values)
        found = sweep(self.model, starts, self.width, values, n)
        residual = self._residuals(found.states, starts, weight)
        cost, count = self._cost(residual), 0
        while count < stage.iterations:
            count += 1
            jacobian = self._jacobian(found, values, weight)
            normal, slope = (jacobian.T @ jacobian).tocsc(), jacobian.T @ residual
            diagonal, gain = sparse.diags(normal.diagonal() + 1e-300), 0.0
            while damping < 1e8:
                step = -splu((normal + damping * diagonal).tocsc()).solve(slope)
                tried = self._moved(values, step[size:])
                moved = starts + step[:size].reshape(-1, 3) * self.scales
                try:
                    there = sweep(self.model, moved, self.width, tried, n)
                    left = self._residuals(there.states, moved, weight)
                    now = self._cost(left)
                except NumericalFailure:
                    now = math.inf
                if now < cost:
                    gain, values, starts, cost, found, residual = cost - now, tried, moved, now, there, left
                    damping = max(0.1 * damping, 1e-9)
                    break
                damping *= 10.0
            if tick is not None:
                tick()
            if gain < stage.tolerance * cost:
                break
        return values, starts, cost, count

    def _moved(self, values: Floats, step: Floats) -> Floats:
        """The parameters after a step: of their logarithms, but for offsets; mu_s stays above mu_k."""
        limited = np.clip(step, -self.settings.largest_step, self.settings.largest_step)
        out: Floats = np.where(self.logarithmic, values * np.exp(limited), values + step)
        keys = self.model.keys
        if STATIC in keys:
            kinetic = out[keys.index(KINETIC)] if KINETIC in keys else self.model.system.friction.kinetic_coefficient
            out[keys.index(STATIC)] = max(out[keys.index(STATIC)], kinetic * NEAR_ONE)
        elif KINETIC in keys:
            out[keys.index(KINETIC)] = min(out[keys.index(KINETIC)],
                                           self.model.system.friction.static_coefficient / NEAR_ONE)
        return out

    def _residuals(self, states: Floats, starts: Floats, weight: float) -> Floats:
        """Samples over their noise, then gaps between windows, then starts in stick."""
        stuck, seen = self._held(weight), states[:, :-1][:, :, self.columns]
        fitted = (seen - self.data.reshape(seen.shape)) / self.noise
        fitted[stuck, 0, 0] = 0.0
        gaps = (states[:-1, -1] - starts[1:]) / self.scales * math.sqrt(weight)
        return np.concatenate([fitted.ravel(), gaps.ravel(), starts[stuck, 0] / self.settings.layer])

    def _held(self, weight: float) -> NDArray[np.intp]:
        """The windows whose start is held in stick."""
        return self.stuck if weight < self.settings.joined else self.stuck[:0]

    @staticmethod
    def _cost(residual: Floats) -> float:
        """Sum of squares."""
        return float(residual @ residual)

    def _jacobian(self, found: Swept, values: Floats, weight: float) -> sparse.csr_matrix:
        """Derivatives of the residuals by all starts, in their scales, and all parameters (their logarithms, but for
        offsets).
        """
        m, size = self.count, len(values)
        by_key, by_start = found.by_key * np.where(self.logarithmic, values, 1.0), found.by_start * self.scales
        stuck, noise = self._held(weight), self.noise[:, None]
        rows_start = by_start[:, :-1][:, :, self.columns] / noise
        rows_key = by_key[:, :-1][:, :, self.columns] / noise
        rows_start[stuck, 0, 0], rows_key[stuck, 0, 0] = 0.0, 0.0
        gap = math.sqrt(weight) / self.scales[:, None]
        fitted = sparse.hstack([sparse.block_diag(list(rows_start.reshape(m, -1, 3))),
                                sparse.csr_matrix(rows_key.reshape(-1, size))])
        blocks = sparse.block_diag(list(by_start[:-1, -1] * gap))
        shape = (3 * (m - 1), 3)
        before = sparse.hstack([blocks, sparse.csr_matrix(shape)])
        after = sparse.hstack([sparse.csr_matrix(shape), math.sqrt(weight) * sparse.identity(3 * (m - 1))])
        joined = sparse.hstack([before - after, sparse.csr_matrix((by_key[:-1, -1] * gap).reshape(-1, size))])
        held = sparse.csr_matrix((np.full(len(stuck), self.scales[0] / self.settings.layer),
                                  (np.arange(len(stuck)), 3 * stuck)), (len(stuck), 3 * m + size))
        return sparse.vstack([fitted, joined, held]).tocsr()

    def result(self, values: Floats, starts: Floats, weight: float, cost: float, iterations: int) -> Fit:
        """The fit with its covariance."""
        size = len(values)
        found = sweep(self.model, starts, self.width, values, self.model.substeps(values))
        jacobian, residual = self._jacobian(found, values, weight), self._residuals(found.states, starts, weight)
        factors = splu((jacobian.T @ jacobian).tocsc())
        unit = np.zeros((jacobian.shape[1], size))
        unit[-size:] = np.eye(size)
        scale = np.where(self.logarithmic, values, 1.0)
        covariance = factors.solve(unit)[-size:] * np.outer(scale, scale)
        fitted = residual[:self.data.size].reshape(-1, len(self.channels))
        return Fit(values, 0.5 * (covariance + covariance.T), starts, self.width,
                   {name: fitted[:, i] * self.noise[i] for i, name in enumerate(self.channels)},
                   float(np.sum(fitted**2)) / max(fitted.size - size - 3, 1), cost, iterations)
