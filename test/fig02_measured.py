"""Measurements of scene fig02, with a motion by SciPy on separately written equations."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from tcc_sim.estimation.measurement import Measurement
from tcc_sim.estimation.settings import Gates
from tcc_sim.scene import load_scene

KEYS = {"friction.static_coefficient": 0.3, "friction.kinetic_coefficient": 0.24, "driveline.damping": 0.6,
        "driveline.stiffness": 3000.0, "driveline.plate_inertia": 0.02}
FIG02 = load_scene("fig02")
BEGAN, ONCE = 1.0, Gates(starts=1)


@cache
def moved(seconds: float = 0.5, rate: float = 1000.0, held: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, states (n, 3) and engine torque of scene fig02 from `BEGAN` on, by SciPy on equations (1) to (7).

    held : the torque is that of the sample before
    """
    system = FIG02.system
    engine, pressure = system.engine, system.pressure
    ratio = 0.3 / 0.24

    def torque(t: float) -> float:
        t = math.floor(t * rate * (1.0 + 1e-12)) / rate if held else t
        return engine.mean_torque + engine.torque_amplitude * math.sin(engine.frequency * t)

    def rates(t: float, x: np.ndarray) -> list[float]:
        load = 0.24 * 0.08 * 0.1 * (pressure.mean + pressure.amplitude * math.sin(engine.frequency * t))
        friction = (1.0 + (ratio - 1.0) * math.exp(-2.0 * abs(x[0]))) * math.tanh(50.0 * x[0]) * load
        plate = (friction - 0.6 * x[2] - 3000.0 * x[1]) / 0.02
        return [(torque(t) - friction) / 0.2 - plate, x[2], plate]

    t = BEGAN + np.arange(round(seconds * rate)) / rate
    step = 1.0 / rate if held else math.inf
    run = solve_ivp(rates, (0.0, t[-1]), [150.0, 0.0, 0.0], "LSODA", t, rtol=1e-9, atol=1e-10, max_step=step)
    return t, run.y.T, np.array([torque(x) for x in t])


def measured(seed: int = 0, seconds: float = 0.5, colour: float = 0.0) -> tuple[Measurement, dict[str, float]]:
    """Slip and plate speed with noise of 1 % of their spread, and the latter; `colour` correlates samples."""
    t, states, _ = moved(seconds)
    noise = 0.01 * states.std(axis=0)
    drawn = np.random.default_rng(seed).standard_normal(states.shape)
    seen = states + noise * lfilter([math.sqrt(1.0 - colour**2)], [1.0, -colour], drawn, axis=0)
    return (Measurement(t, {"slip_speed": seen[:, 0], "plate_speed": seen[:, 2]}),
            {"slip_speed": noise[0], "plate_speed": noise[2]})
