"""A point of the frequency response by simulation: the output at the frequency of a small sine on the input.

The real-time solver holds the input over each tick at its value in the tick's middle. The difference from the same run
without the sine is the response at its frequency, side bands of the periodic motion, and a slow drift if the plant is
an integrator; a least-squares fit separates them. A sine is the sum of two inputs exp(i omega t), exp(-i omega t). At
half the motion's frequency, or a multiple, a side band of the one coincides with the response to the other. A second
run with a cosine therefore gives the response to exp(i omega t) alone.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError
from tcc_sim.estimation.operating_point import Constant, Periodic
from tcc_sim.estimation.settings import DEFAULTS
from tcc_sim.model import equations
from tcc_sim.model.actuator import pressure_after
from tcc_sim.model.equations import linear_of
from tcc_sim.solvers.fixed_step import Stepper
from tcc_sim.solvers.terms import Terms, holding, terms_of
from tcc_sim.trajectory import Floats


def simulated(motion: Constant | Periodic, inputs: str, output: str, omega: float) -> complex:
    """Return output over input at `omega`, rad/s, about a motion.

    Raise InputError for the set-valued law, which the real-time solver does not have, for an input with mean 0, and for
    a frequency so low that the simulation would take more than 2 million ticks.
    """
    system = motion.system
    if system.friction.law != "smoothed":
        raise InputError(f"friction.law is {system.friction.law}; the response can be simulated for smoothed only")
    pressure = inputs == "actuation_pressure"
    mean = system.pressure.mean if pressure else system.engine.mean_torque
    if mean == 0.0:
        raise InputError(f"the mean of {inputs} is 0; a response about it cannot be simulated with a small sine")
    cycle = system.cycle if isinstance(motion, Periodic) else 2.0 * math.pi / omega
    step = min(1.0 / DEFAULTS.rate, min(cycle, 2.0 * math.pi / omega) / DEFAULTS.ticks_per_cycle)
    before = DEFAULTS.settling * cycle
    length = math.ceil(max(DEFAULTS.periods * 2.0 * math.pi / omega, 24.0 * cycle) / step)
    if length > DEFAULTS.longest:
        raise InputError(f"a response at {omega:g} rad/s takes {length} ticks to simulate; at most "
                         f"{DEFAULTS.longest} are allowed")
    skipped = math.ceil(before / step)
    height = DEFAULTS.amplitude * abs(mean)
    cosine, sine, free = (_driven(motion, pressure, (each, omega, lead), step, skipped + length)
                          for each, lead in ((height, 0.5 * math.pi), (height, 0.0), (0.0, 0.0)))
    states = (cosine - free + 1j * (sine - free))[skipped:]
    times = np.arange(skipped + 1.0, skipped + length + 1.0) * step
    base = 2.0 * math.pi / (motion.period * system.cycle) if isinstance(motion, Periodic) else None
    slip, angle, speed = _fitted(times, states, omega, base) / height
    d = system.driveline
    if output == "slip_speed":
        return complex(slip)
    shaft = d.stiffness * angle + d.damping * speed
    if output == "shaft_torque":
        return complex(shaft)
    fluid_torque = (linear_of(system).plate_by_slip or 0.0) * slip
    return complex(shaft + d.plate_inertia * 1j * omega * speed + fluid_torque)   # (2b)


def _driven(motion: Constant | Periodic, pressure: bool, sine: tuple[float, float, float], step: float,
            ticks: int) -> Floats:
    """Return the state at the end of every tick, (ticks, 3), with a sine (height, frequency, lead) on the input."""
    system = motion.system
    terms, stepper, out = terms_of(system), Stepper(system, step), np.empty((ticks, 3))
    # At a constant slip speed the spring carries the mean torque.
    still = system.engine.mean_torque / system.driveline.stiffness
    stepper.state[:3] = motion.segments[0].state if isinstance(motion, Periodic) else (motion.mean_slip, still, 0.0)
    (height, omega, lead), settings = sine, system.pressure
    plates = settings.mean
    for k in range(ticks):
        middle = (k + 0.5) * step
        more = height * math.sin(omega * (middle - settings.delay * pressure) + lead)
        if settings.lagged:
            before, command = plates, settings.mean + more * pressure
            plates = pressure_after(before, command, settings.time_constant, settings.rate_limit, step)
            stepper.press(before, plates, system.torque_per_pressure)
        stepper.use(_held(system.torque_per_pressure, terms, pressure, middle, more))
        stepper.advance()
        out[k] = stepper.state[:3]
    return out


def _held(torque_per_pressure: float, terms: Terms, pressure: bool, middle: float, more: float) -> Terms:
    """Return the terms of a tick, with the input held at its value in the tick's middle plus `more`."""
    if pressure:
        load = equations.saturation_torque(middle, terms.mean_load, terms.pulsation)
        return holding(terms, None, max(0.0, float(load) + torque_per_pressure * more))
    torque = equations.engine_torque(middle, terms.mean_torque, terms.torque, terms.harmonics)
    return holding(terms, float(torque) + more, None)


def _fitted(times: Floats, states: NDArray[np.complex128], omega: float, base: float | None) -> NDArray[np.complex128]:
    """Return the amplitudes at `omega` of the (n, 3) response to exp(i omega t)."""
    bands = [omega]
    if base is not None:
        apart = 2.0 * math.pi / (times[-1] - times[0])
        bands += [value for n in range(1, DEFAULTS.bands + 1) for value in (omega - n * base, omega + n * base)
                  if abs(value) > apart]
    columns = [*(np.exp(1j * value * times) for value in bands), np.ones_like(times), times - times.mean()]
    return np.asarray(np.linalg.lstsq(np.column_stack(columns), states, rcond=None)[0][0])
