"""Measurements of scene fig02, with a motion by SciPy on separately written equations."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from scipy.integrate import odeint
from scipy.signal import lfilter

from tcc_sim.estimation.measurement import Measurement
from tcc_sim.estimation.multiple_shooting import FitSettings, Gates
from tcc_sim.scene import load_scene

KEYS = {"friction.static_coefficient": 0.3, "friction.kinetic_coefficient": 0.24, "driveline.damping": 0.6,
        "driveline.stiffness": 3000.0, "driveline.plate_inertia": 0.02}
FIG02 = load_scene("fig02")
BEGAN, ONCE = 1.0, Gates(starts=1)
QUICK = FitSettings(stages=(FitSettings().stages[2], FitSettings().stages[-1]))


@cache
def moved(seconds: float = 0.2, rate: float = 1000.0, held: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, states (n, 3) and engine torque of scene fig02 from `BEGAN` on, by SciPy on equations (1) to (7).

    held : from `BEGAN` on the torque is that of the sample before
    """
    system = FIG02.system
    engine, pressure = system.engine, system.pressure
    ratio = 0.3 / 0.24

    mean, amplitude, omega, sin, load = engine.mean_torque, engine.torque_amplitude, engine.frequency, math.sin, 0.00192

    def torque(t: float) -> float:
        return mean + amplitude * sin(omega * t)

    def rates(t: float, x: np.ndarray, constant: float | None = None) -> list[float]:
        v, angle, speed, te = float(x[0]), float(x[1]), float(x[2]), torque(t) if constant is None else constant
        friction = (1.0 + (ratio - 1.0) * math.exp(-2.0 * abs(v))) * math.tanh(50.0 * v) * load * (
            pressure.mean + pressure.amplitude * sin(omega * t))
        plate = (friction - 0.6 * speed - 3000.0 * angle) / 0.02
        return [(te - friction) / 0.2 - plate, speed, plate]

    def follow(x: Any, times: Any, *constant: float) -> np.ndarray:
        return odeint(rates, x, times, constant, tfirst=True, rtol=1e-9, atol=1e-10, mxstep=100_000)[1:]

    mean, amplitude, omega, sin, load = engine.mean_torque, engine.torque_amplitude, engine.frequency, math.sin, 0.00192
    t = BEGAN + np.arange(round(seconds * rate)) / rate
    torques = np.array([torque(x) for x in t])
    if not held:
        return t, follow([150.0, 0.0, 0.0], np.append(0.0, t)), torques
    states = follow([150.0, 0.0, 0.0], [0.0, BEGAN])
    for n, constant in enumerate(torques[:-1]):
        states = np.vstack([states, follow(states[-1], t[n:n + 2], constant)])
    return t, states, torques


def measured(seed: int = 0, seconds: float = 0.2, colour: float = 0.0) -> tuple[Measurement, dict[str, float]]:
    """Slip and plate speed with noise of 1 % of their spread, and the latter; `colour` correlates samples."""
    t, states, _ = moved(seconds)
    noise = 0.01 * states.std(axis=0)
    drawn = np.random.default_rng(seed).standard_normal(states.shape)
    seen = states + noise * lfilter([math.sqrt(1.0 - colour**2)], [1.0, -colour], drawn, axis=0)
    return (Measurement(t, {"slip_speed": seen[:, 0], "plate_speed": seen[:, 2]}),
            {"slip_speed": noise[0], "plate_speed": noise[2]})
