"""Periodic motions by harmonic balance: the series (30) to (34) of the paper in a corrected form.

In the print, (30) to (32) start at n = 1, and the first factor of (31) is Tm + Tp sin(omega t/N). Here the slip speed
and the friction coefficient have a mean, and the load is Ts(t) of (5b):

    v = a0 + sum a_n cos(n w t) + b_n sin(n w t),  w = omega/N                                     (30)
    Tf = [Tsm + Tsp sin(omega_f t + psi)] [c0 + sum c_n cos(n w t) + d_n sin(n w t)]               (31)

The mean of (32) is then that of Tf, which must be Tm: c0 Tsm + (Tsp/2)(c_M sin psi + d_M cos psi) = Tm. Without c0
only the product with the load's sine remains. As |d_M| <= (4/pi) mu_s/mu_k, it is at most (2/pi) (mu_s/mu_k) Tsp.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.model import friction
from tcc_sim.model.closed_forms import Floats, engine_series, load_series
from tcc_sim.model.equations import check_supported
from tcc_sim.model.parameters import System

LADDER = (0.001, 0.004, 0.01, 0.02, 0.04, 0.1, 0.2, 0.4, 1.0)
"""Fractions of sigma for which the balance is solved in turn, each from the one before; the first is nearly linear."""
ITERATIONS, HALVINGS = 80, 12
OVERSAMPLING = 8
"""Samples of the friction coefficient per harmonic."""


@dataclass(frozen=True)
class Balance:
    """Periodic motion as Fourier series.

    base : w, rad/s
    slip : (2 n + 1,) a0, a_1 ... a_n, b_1 ... b_n of (30), rad/s
    coefficient : (2 n + 1,) c0, c_n, d_n of (31)
    residual : largest remainder of any harmonic of (32), N m
    """

    base: float
    slip: Floats
    coefficient: Floats
    residual: float

    def slip_speed(self, t: Floats) -> Floats:
        """Return v at the times t (n,), rad/s."""
        return series(self.slip, self.base, t)


def series(coefficients: Floats, base: float, t: Floats) -> Floats:
    """Return a0 + sum a_n cos(n w t) + b_n sin(n w t) at the times t."""
    count = len(coefficients) // 2
    angle = np.multiply.outer(np.asarray(t, dtype=np.float64), base * np.arange(1, count + 1))
    out: Floats = coefficients[0] + np.cos(angle) @ coefficients[1:count + 1] + np.sin(angle) @ coefficients[count + 1:]
    return out


def mean_friction_torque(system: System, coefficient: Floats, period: int, *, printed: bool = False) -> float:
    """Return the mean of (31), N m: c0 Tsm plus the mean product of the load's sine and the coefficient.

    printed : take the form of the print, without c0 and with the load Tm + Tp sin(omega t/N)
    """
    count, base = len(coefficient) // 2, system.engine.frequency / period
    if printed:
        return 0.5 * system.engine.torque_amplitude * float(coefficient[count + 1])
    t = 2.0 * math.pi / base * np.arange(OVERSAMPLING * count) / (OVERSAMPLING * count)
    return float(np.mean(load_series(system)(t) * series(coefficient, base, t)))


def harmonic_balance(system: System, period: int, harmonics: int, iterations: int = ITERATIONS) -> Balance:
    """Solve (32) for a motion of `period` engine cycles by Newton's method, starting with zero slip and a soft law.

    The motion may be unstable; if several exist, the result is one of them.

    system : system with the smoothed law and torques that repeat after `period` engine cycles
    harmonics : number n of harmonics of w = omega/period
    iterations : largest number of Newton steps per smoothing factor
    """
    if system.friction.law != "smoothed":
        raise InputError(f"friction.law is {system.friction.law}; the harmonic balance needs the smoothed law")
    check_supported("harmonic balance", system, "the harmonic balance")
    if period < 1 or harmonics < 1:
        raise InputError(f"period is {period} and harmonics {harmonics}; both must be 1 or more")
    d, base = system.driveline, system.engine.frequency / period
    count = OVERSAMPLING * harmonics
    angle = 2.0 * math.pi * np.arange(count) / count
    load, engine = np.maximum(load_series(system)(angle / base), 0.0), engine_series(system)(angle / base)
    order = np.arange(1, harmonics + 1)
    grid = np.multiply.outer(angle, order)
    basis = np.hstack([np.ones((count, 1)), np.cos(grid), np.sin(grid)])
    project = basis.T * (2.0 / count)
    project[0] *= 0.5
    omega = order * base
    # v = (Te - Tf)/(i w I1) - i w Tf/(K23 - w^2 I2 + i w C23), harmonic by harmonic.
    engine_share = 1.0 / (1j * omega * d.flywheel_inertia)
    mobility = engine_share + 1j * omega / (d.stiffness - d.plate_inertia * omega**2 + 1j * omega * d.damping)
    linear = _real_form(1.0 / mobility)
    torque = project @ engine
    drive = _real_form(engine_share / mobility) @ torque
    drive[0] = torque[0]
    stribeck = system.friction.stribeck

    slip = np.zeros(2 * harmonics + 1)
    for part in LADDER:
        slip, rest = _newton(slip, basis, project, linear, drive, load, part * system.friction.smoothing, stribeck,
                             iterations)
    coefficient = project @ friction.smoothed_coefficient(basis @ slip, system.friction.smoothing, stribeck)
    return Balance(base, slip, coefficient, rest)


def _real_form(factor: NDArray[np.complex128]) -> Floats:
    """Return the matrix on (mean, a, b) that multiplies the phasors a - i b by `factor` and the mean by 0."""
    n = len(factor)
    k = np.arange(1, n + 1)
    out = np.zeros((2 * n + 1, 2 * n + 1))
    out[k, k] = out[n + k, n + k] = factor.real
    out[k, n + k], out[n + k, k] = factor.imag, -factor.imag
    return out


def _newton(slip: Floats, basis: Floats, project: Floats, linear: Floats, drive: Floats, load: Floats, sigma: float,
            stribeck: friction.Stribeck, iterations: int) -> tuple[Floats, float]:
    """Return the coefficients of the slip for one smoothing factor, by damped Newton steps, and the residual, N m."""
    def remainder(x: Floats) -> tuple[Floats, Floats]:
        value, slope = friction.smoothed_and_slope(basis @ x, sigma, stribeck)
        return linear @ x + project @ (load * value) - drive, load * slope

    size = float(np.abs(drive).max()) + 1.0
    rest, slope = remainder(slip)
    for _ in range(iterations):
        largest = float(np.abs(rest).max())
        if largest <= 1e-11 * size:
            return slip, largest
        step = np.linalg.solve(linear + project @ (slope[:, None] * basis), rest)
        for _ in range(HALVINGS):
            further, slope = remainder(slip - step)
            if float(np.abs(further).max()) < largest:
                break
            step = 0.5 * step
        slip, rest = slip - step, further
    if float(np.abs(rest).max()) <= 1e-8 * size:
        return slip, float(np.abs(rest).max())
    raise NumericalFailure(f"harmonic balance at sigma = {sigma:g} s/rad: the residual is still "
                           f"{np.abs(rest).max():.3g} N m")
