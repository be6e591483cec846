"""Control law of the slip controller example: PI on the slip speed's mean over an engine cycle, without ROS.

In slip and well below its natural frequency, the driveline is an integrator from the clutch torque Ts = mu_k P A R to
the cycle-mean slip speed v: I1 v' = Te - Ts (equation (2a) with the plate at rest in the mean). The controller has:

- Cycle mean: the engine torque pulsates with hundreds of N m; the mean over exactly one engine cycle has a zero at this
  frequency, so the pressure does not follow the pulsation. Its delay of half a cycle limits the bandwidth: with the
  bandwidth w and the cycle T the mean costs a phase of w T/2 (18 degrees at 15 rad/s and T = 42 ms), and the integral
  part costs atan(1/4) = 14 degrees.
- Feed-forward: the cycle's mean engine torque is the clutch torque that holds any slip speed. The integral part only
  corrects the error of the nominal friction coefficient.
- Anti-windup: while the pressure is at a limit, the integral part moves only away from it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.model.quantity import LATEST, Options, check_profile, quantity


@dataclass(frozen=True)
class Tuning(Options):
    """Nominal plant and bandwidth of the controller: the node's parameters.

    Raises
    ------
    InputError
        A value is not a number above 0, or the engine cycle has less than 1 or more than 1e6 steps.
    """

    target: float = quantity(20.0, "slip speed to hold in the mean over a period of excitation", "rad/s", 0.0,
                             above=True, live=True)
    target_times: tuple[float, ...] = quantity((), "times at which target_values hold, the first 0", "s", 0.0, LATEST)
    target_values: tuple[float, ...] = quantity((), "target at these times, linear between them and constant "
                                                "afterwards; target is then not used", "rad/s", 0.0, above=True)
    bandwidth: float = quantity(15.0, "bandwidth of the closed loop; at most about 0.6 divided by the period of "
                                "excitation", "rad/s", 0.0, above=True, live=True)
    frequency: float = quantity(150.0, "engine.frequency; the period of excitation is 2 pi/frequency", "rad/s", 0.0,
                                above=True)
    inertia: float = quantity(0.2, "flywheel inertia I1", "kg m^2", 0.0, above=True)
    torque_per_pressure: float = quantity(0.27 * 0.08 * 0.1, "nominal mu_k A R", "N m/Pa", 0.0, above=True)
    pressure_limit: float = quantity(600e3, "largest commanded pressure", "Pa", 0.0, above=True, live=True)
    step: float = quantity(1e-3, "time between two updates", "s", 0.0, above=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_profile("target", self.target_times, self.target_values)
        if not 1.0 <= self.cycle_steps <= 1e6:
            raise InputError(f"step is {self.step:g} s; the period of excitation must have 1 to 1e+06 steps, not "
                             f"{self.cycle_steps:g}")

    def target_at(self, t: float) -> float:
        """Return the target slip speed, rad/s, at simulation time t, s."""
        return float(np.interp(t, self.target_times, self.target_values)) if self.target_times else self.target

    @property
    def cycle_steps(self) -> float:
        """Number of updates in an engine cycle, in general not an integer."""
        angle = self.frequency * self.step
        return 2.0 * math.pi / angle if angle else math.inf


class CycleMean:
    """Mean of a signal over the last `length` samples, in general not an integer."""

    def __init__(self, length: float) -> None:
        whole = math.floor(length)
        self._part = length - whole
        self._samples: deque[float] = deque(maxlen=whole + 1)

    def update(self, value: float) -> float:
        """Add a sample and return the mean over the cycle, or over all samples within the first cycle."""
        self._samples.append(value)
        if len(self._samples) < (self._samples.maxlen or 0):
            return math.fsum(self._samples) / len(self._samples)
        # The oldest sample has the fraction of a step as its weight.
        oldest = self._samples[0]
        return (math.fsum(self._samples) - (1.0 - self._part) * oldest) / (len(self._samples) - 1 + self._part)


class SlipController:
    """Controller of the actuation pressure from slip speed and engine torque, with one update per tick.

    Attributes
    ----------
    target : slip speed to hold from the next update on, rad/s
    """

    def __init__(self, tuning: Tuning) -> None:
        self.use(tuning)
        self.reset()

    def use(self, tuning: Tuning) -> None:
        """Use another bandwidth and pressure limit from the next update on; means and integral part stay."""
        self.tuning = tuning
        self.proportional = tuning.inertia * tuning.bandwidth
        self.integral = self.proportional * tuning.bandwidth / 4.0

    def reset(self) -> None:
        """Reset to the state before the first update."""
        steps = self.tuning.cycle_steps
        self._slip_speed, self._engine_torque = CycleMean(steps), CycleMean(steps)
        self._correction = 0.0
        self.target = self.tuning.target_at(0.0)

    def update(self, slip_speed: float, engine_torque: float) -> float:
        """Return the pressure to apply until the next update.

        Parameters
        ----------
        slip_speed : measured slip speed, rad/s
        engine_torque : engine torque from the engine control unit, N m

        Returns
        -------
        float : pressure from 0 to `pressure_limit`, Pa
        """
        tuning = self.tuning
        error = self._slip_speed.update(slip_speed) - self.target
        torque = self._engine_torque.update(engine_torque) + self.proportional * error + self._correction
        pressure = torque / tuning.torque_per_pressure
        limited = min(max(pressure, 0.0), tuning.pressure_limit)
        if limited == pressure or (pressure - limited) * error < 0.0:
            self._correction += self.integral * tuning.step * error
        return limited
