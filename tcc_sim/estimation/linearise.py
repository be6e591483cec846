"""`tcc-sim linearise`: transfer function from an input of the clutch to an output, about a settled motion.

About a constant motion: continuous matrices of (2a), (2b) with friction's slope (20b). About a periodic motion the
plant is linear with periodic coefficients. Its frequency response is the harmonic transfer function (N. M. Wereley,
Analysis and Control of Linear Periodically Time Varying Systems, MIT 1991): the response at the frequency of the input,
without the others. It follows from the exact derivatives of the segments of the motion. The matrices are then those of
the cycle-rate model, x[k+1] = A x[k] + B u[k], whose output is the mean over the cycle; it is valid well below half
the rate of cycles.

The input is constant over each segment, and an output is a mean of its ends. Both errors grow with the square of the
angle by which the input turns in a segment. Segments are added until the response of half as many agrees.

The slip controller (`plant.slip_control`) answers every tick: a PI law on the mean slip speed over an engine cycle. Its
pressure is held through the next tick. With whole ticks in an engine cycle, the nearest number to the controller's, the
loop is a linear map of the plant's state, the slip speeds of the last cycle and the integral part, periodic with the
motion. The product of its maps over the motion's period determines stability exactly. Gain margin and largest delay
follow from it, by raising the gains and by delaying commands. The phase margin is that of the open loop's frequency
response, with the harmonic transfer function as the plant.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import brentq

from tcc_sim.analysis.steady.exponents import largest_first, multipliers_of
from tcc_sim.errors import InputError, NumericalFailure, OutOfRange, counted
from tcc_sim.estimation.operating_point import (
    SEGMENTS,
    STATES,
    Constant,
    Periodic,
    cut,
    halved,
    matrices_of,
    mean_rows,
    operating_point,
    stuck_segments,
)
from tcc_sim.model.equations import linear_of
from tcc_sim.model.parameters import System, replace
from tcc_sim.result import Described, Result, reported, reporting, result_class
from tcc_sim.scene import SceneLike, as_scene
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.sweeps.progress import progress_bar
from tcc_sim.trajectory import Floats

MOST_SEGMENTS = 65536  # Most segments of a motion, over each of which an input is held.
LARGEST_TURN = 0.4  # Most of a period of the input in one segment, rad.
RESPONSE_ERROR = 0.01  # Largest relative error of a response.
LOWEST = 2.0  # Lowest default frequency, rad/s.
FREQUENCIES = 240  # Default number of frequencies, to three times the slipping mode, evenly in logarithm.
MOST_FREQUENCIES = 100_000  # Largest number of frequencies.
Complex = NDArray[np.complex128]

INPUTS = {"actuation_pressure": "Pa", "engine_torque": "N m"}
UNEXCITED = {"engine.torque_amplitude": 0.0, "engine.harmonic_amplitudes": (), "engine.harmonic_phases": (),
             "pressure.amplitude": 0.0}
OUTPUTS = {"slip_speed": "rad/s", "friction_torque": "N m", "shaft_torque": "N m"}  # Outputs with their units.
MOST_LATE = 512  # Longest tested delay of commands, ticks.
HIGHEST = 1000.0  # Largest tested factor of the gains.
LEAST_SLIP, SLOWER, WITHIN = 0.1, 0.93, 1e-3
"""Least tested slip speed, relative to the motion's; factor from one to the next; relative error of the result."""


@result_class(repr=False)
class SlipLoop(Described):
    """Stability and margins of a closed loop with the slip controller."""

    proportional: float = reported("proportional gain", "N m s/rad")
    integral: float = reported("integral gain", "N m/rad")
    step: float = reported("time between two commands: a whole part of the period of excitation", "s")
    stable: bool = reported("whether every multiplier is inside the unit circle")
    multipliers: Complex = reported("those of the closed loop above 1e-6, [re, im], largest first")
    gain_margin: float | None = reported(
        "factor on both gains that makes the loop unstable; null if unstable already, or stable up to 1000")
    phase_margin: float | None = reported(
        "least distance of the open loop's phase from -180 degrees at gain 1; null without one", "rad")
    largest_delay: float | None = reported(
        "delay of commands from which on the loop is unstable; null if unstable already, or stable up to 512 ticks",
        "s")
    smallest_stable_slip: float | None = reported(
        "mean slip speed below which the loop becomes unstable; null if unstable already, 0 if stable down to a tenth "
        "of it", "rad/s")


@result_class
class OperatingPoint:
    """Motion about which a scene is linearised."""

    mean_slip: float = reported("mean slip speed", "rad/s")
    pressure: float = reported("mean pressure", "Pa")
    engine_torque: float = reported("mean engine torque", "N m")
    period: int = reported("1 for a constant motion", "periods of excitation")


@result_class(repr=False)
class Linearisation(Result):
    """Response of an output to small changes of an input about a settled motion.

    mean_slip, pressure, engine_torque, period : as in `OperatingPoint`
    response : (m,) output over input at each frequency
    """

    input: str = reported("of the transfer function")
    output: str = reported("of the transfer function")
    kind: str = reported("slip or stick (a constant motion), or periodic")
    mean_slip: float
    pressure: float
    engine_torque: float
    period: int
    multipliers: Complex = reported("Floquet multipliers, [re, im]")
    a: Floats = reported("state matrix, (n, n)", name="A")
    b: Floats = reported("input matrix, (n, 1)", name="B")
    c: Floats = reported("output matrix, (1, n)", name="C")
    d: Floats = reported("feedthrough, (1, 1)", "({output})/({input})", name="D")
    states: tuple[str, ...] = reported("names of the states of A")
    dt: float = reported("period of the cycle-rate model; 0 where the matrices are continuous", "s")
    frequencies: Floats = reported("frequencies of the response", "rad/s")
    response: Complex
    system: System
    controller: SlipLoop | None = reported("closed loop, with --controller", optional=True, default=None)

    def _text(self) -> str:
        return (f"Linearisation of {self.output} by {self.input}: {self.kind}, mean slip {self.mean_slip:.6g} rad/s, "
                f"pressure {self.pressure:.6g} Pa, {counted(len(self.frequencies), 'point')}")

    @reporting("the motion")
    def operating_point(self) -> OperatingPoint:
        return OperatingPoint(self.mean_slip, self.pressure, self.engine_torque, self.period)

    @reporting("amplitude of the output over that of the input", "({output})/({input})")
    def gain(self) -> Floats:
        """(m,) amplitude of the output over that of the input, in SI units."""
        return np.hypot(self.response.real, self.response.imag)

    @reporting("by which the output leads, without jumps of 2 pi", "rad")
    def phase(self) -> Floats:
        """(m,) phase by which the output leads, without jumps of 2 pi, rad."""
        return np.unwrap([cmath.phase(value) for value in self.response])  # NumPy's last bit depends on the processor.

    def columns(self) -> dict[str, Floats]:
        """Return a row for every frequency."""
        return {"frequency": self.frequencies, "gain": self.gain, "phase": self.phase}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of `--out`: A, B, C, D and dt as for ``control.ss`` and ``scipy.signal.StateSpace``."""
        return {"A": self.a, "B": self.b, "C": self.c, "D": self.d, "dt": np.array(self.dt),
                "frequencies": self.frequencies, "gain": self.gain, "phase": self.phase,
                "multipliers": self.multipliers}


def linearise(scene: SceneLike, *, input: Literal["actuation_pressure", "engine_torque"] = "actuation_pressure",
              output: Literal["slip_speed", "friction_torque", "shaft_torque"] = "slip_speed",
              slip: float | None = None, frequencies: Sequence[float] | None = None, mean: bool = False,
              controller: tuple[float, float] | None = None, progress: bool = False) -> Linearisation:
    """Compute the transfer function from an input to an output about a settled motion.

    Parameters
    ----------
    scene : scene, system, or the name or file of a scene
    input, output : input and output of the transfer function
    slip : mean slip speed, rad/s, for which the pressure is computed (default: the scene's pressure)
    frequencies : rad/s, above 0, on a command line spaced evenly in logarithm (default: 240 from 2 to three times the
        slipping mode, 3 sqrt(K23/I2))
    mean : replace torque and pressure by their means; A, B, C, D are then continuous
    controller : add stability, margins, largest delay and smallest stable slip of the loop with the package's slip
        controller, which commands the pressure at the scene's rate: its proportional (N m s/rad) and integral gain
        (N m/rad)
    progress : show tried slip speeds on a terminal or in a notebook, elsewhere a line a minute

    Raises
    ------
    InputError
        A name, frequency or slip speed that is not allowed, a scene that settles in no periodic motion, or a frequency
        so high that the response would be more than 1 % off.
    NumericalFailure
        Newton's method does not close the motion.

    Examples
    --------
    >>> import tcc_sim
    >>> result = tcc_sim.linearise("controlled", slip=20.0, frequencies=[10.0])
    >>> result
    <Linearisation of slip_speed by actuation_pressure: periodic, mean slip 20 rad/s, pressure 92592.6 Pa, 1 point>
    >>> round(float(result.gain[0]), 8)   # mu_k A R/(I1 omega), the integrator
    0.0010728
    """
    for name, optional, known in (("input", input, INPUTS), ("output", output, OUTPUTS)):
        if optional not in known:
            raise InputError(f"{name} is {optional!r}; it must be {' or '.join(known)}")
    scene = as_scene(scene)
    system = scene.system
    system.check_repeats("a transfer function")
    if mean:
        system = replace(system, UNEXCITED)
    requested = _frequencies(system, frequencies)
    motion = operating_point(system, slip)
    system = motion.system
    if isinstance(motion, Constant):
        a, b, c, d, states = matrices_of(motion, input == "actuation_pressure", output)
        # The smoothed law sticks where it creeps in its layer.
        stick = math.isinf(motion.slope) or abs(motion.mean_slip) <= stick_speed_of(terms_of(system))
        kind, period, dt = "stick" if stick else "slip", 1, 0.0
        multipliers = largest_first(np.exp(np.linalg.eigvals(a) * system.cycle))
    else:
        column = [list(INPUTS).index(input)]
        a, b = motion.carried.by_state[-1], motion.carried.by_input[-1][:, column]
        c, d = _cycle_rows(motion, output)
        kind, period, dt, d, states = "periodic", motion.period, motion.seconds, d[:, column], STATES
        multipliers = multipliers_of(a)
    return Linearisation(
        input, output, kind, motion.mean_slip, system.pressure.mean, system.engine.mean_torque, period, multipliers,
        a, b, c, d, states, dt, requested, response_of(motion, input, output, requested), system,
        None if controller is None else slip_loop(motion, controller, scene.operation.rate, progress))


def _frequencies(system: System, requested: Sequence[float] | None) -> Floats:
    if requested is None:
        whole = 3.0 * max(system.natural_frequency, LOWEST) / LOWEST
        return np.array([LOWEST * whole ** (k / (FREQUENCIES - 1)) for k in range(FREQUENCIES)])
    out = np.asarray(requested, dtype=np.float64).ravel()
    if not 1 <= len(out) <= MOST_FREQUENCIES:
        raise InputError(f"there are {len(out)} frequencies; 1 to {MOST_FREQUENCIES} are allowed")
    for value in out:
        if not 1e-6 <= value <= 1e6:
            raise InputError(f"a frequency is {value:g} rad/s; it must be 1e-06 to 1e+06 rad/s")
    return out


def _cycle_rows(motion: Periodic, output: str) -> tuple[Floats, Floats]:
    """Return the derivatives of the output's mean over the period by the start's state and by the inputs."""
    d, (by_state, by_input) = motion.system.driveline, mean_rows(motion)
    if output == "slip_speed":
        return by_state[[0]], by_input[[0]]
    c = d.stiffness * by_state[[1]] + d.damping * by_state[[2]]
    through = d.stiffness * by_input[[1]] + d.damping * by_input[[2]]
    if output == "friction_torque":   # (2b): Tf = I2 theta2'' + C23 theta2' + K23 theta2 + p_v v
        by_slip = linear_of(motion.system).plate_by_slip or 0.0
        c, through = c + by_slip * by_state[[0]], through + by_slip * by_input[[0]]
        c = c + d.plate_inertia * (motion.carried.by_state[-1][[2]] - np.eye(3)[[2]]) / motion.seconds
        through = through + d.plate_inertia * motion.carried.by_input[-1][[2]] / motion.seconds
    return c, through


def response_of(motion: Constant | Periodic, inputs: str, output: str, omegas: Floats) -> Complex:
    """Return the response of an output to small changes of an input at frequencies, rad/s; that to the commanded
    pressure with the lag and delay of the actuator. Raise InputError for a frequency that is too high.
    """
    if isinstance(motion, Constant):
        a, b, c, d, _ = matrices_of(motion, inputs == "actuation_pressure", output)
        out = np.array([(c @ np.linalg.solve(1j * w * np.eye(len(a)) - a, b) + d)[0, 0] for w in omegas])
    else:
        out = _harmonic_response(motion, inputs, output, omegas)
    s, pressure = 1j * omegas, motion.system.pressure
    if inputs == "actuation_pressure" and pressure.actuated:
        out = out * (np.exp(-s * pressure.delay) / (1.0 + s * pressure.time_constant))
    return out


def _harmonic_response(motion: Periodic, inputs: str, output: str, omegas: Floats) -> Complex:
    """Return the harmonic transfer function within RESPONSE_ERROR; raise InputError if it needs too many segments."""
    out, count = np.zeros(len(omegas), np.complex128), SEGMENTS
    left = np.arange(len(omegas))
    while len(left):
        if count * motion.period > MOST_SEGMENTS:
            raise InputError(f"a response at {omegas[left].min():g} rad/s needs more than {MOST_SEGMENTS} "
                             f"segments of a motion of {motion.seconds:.4g} s to be right within "
                             f"{100.0 * RESPONSE_ERROR:g} %; ask for lower frequencies")
        turn = omegas[left] * motion.system.cycle / count
        ready = left[turn <= LARGEST_TURN]
        if len(ready):
            if count * motion.period > len(motion.by_state):
                motion = cut(motion.system, motion.period, motion.states[0], count)
            out[ready] = harmonic_transfer(motion, inputs, output, omegas[ready])
            half = harmonic_transfer(halved(motion), inputs, output, omegas[ready])
            # The error is of second order in the length of the segments: a third of the difference; half is assumed.
            good = np.abs(out[ready] - half) <= 2.0 * RESPONSE_ERROR * np.abs(out[ready])
            left = np.setdiff1d(left, ready[good])
        count *= 2
    return out


def harmonic_transfer(motion: Periodic, inputs: str, output: str, omegas: Floats) -> Complex:
    """Return H0(i omega): the output's component at omega for an input exp(i omega t), without the others.

    The input is constant over each segment, at its value in the middle. The disturbed motion repeats except for exp(i
    omega t), so that its start follows from one linear equation. The component at omega is a mean over the period, to
    second order in the segments' length even where slip ends.
    """
    maps, forces, d = motion.by_state, motion.by_input[..., list(INPUTS).index(inputs)], motion.system.driveline
    h, omega = motion.seconds / len(maps), omegas[:, None]
    whole_map, response = np.eye(3), np.zeros((len(omegas), 3), complex)
    for i in range(len(maps)):
        whole_map = maps[i] @ whole_map
        response = response @ maps[i].T + np.exp(1j * omega * (i + 0.5) * h) * forces[i]
    turned = np.exp(1j * omegas * motion.seconds)[:, None, None] * np.eye(3) - whole_map
    state = np.linalg.solve(turned, response[:, :, None])[:, :, 0]
    slip, angle = np.zeros((2, len(omegas)), np.complex128)
    start, stuck, inertias = state, stuck_segments(motion), 1.0 + d.plate_inertia / d.flywheel_inertia
    for i in range(len(maps)):
        state = state @ maps[i].T + np.exp(1j * omega * (i + 0.5) * h) * forces[i]
        end = state * np.exp(-1j * omega * (i + 1) * h)
        mean, turn = 0.5 * (start + end), end[:, 1] - start[:, 1]
        angle += mean[:, 1]
        # As in `mean_rows`.
        jump = 0.0 if stuck[i] else mean[:, 2] - (turn / h + 1j * omegas * mean[:, 1])
        slip += mean[:, 0] + inertias * jump
        start = end
    if output == "slip_speed":
        return slip / len(maps)
    shaft = (d.stiffness + 1j * omegas * d.damping) * angle / len(maps)
    if output == "friction_torque":   # (2b)
        shaft = shaft + (linear_of(motion.system).plate_by_slip or 0.0) * slip / len(maps)
        shaft = shaft - d.plate_inertia * omegas**2 * angle / len(maps)
    return np.asarray(shaft, np.complex128)


def slip_loop(motion: Constant | Periodic, gains: tuple[float, float], rate: float, progress: bool = False) -> SlipLoop:
    """Judge the closed loop of a slip controller with these gains about a motion in slip.

    gains : proportional, N m per rad/s of the mean slip speed, and integral, N m per rad of its integral
    rate : ticks per second of the controller, Hz
    """
    for name, gain in zip(("proportional", "integral"), gains):
        if not 0.0 < gain < math.inf:
            raise InputError(f"the {name} gain of the controller is {gain:g}; it must be a number above 0")
    system = motion.system
    ticks = round(system.cycle * rate)
    if not 4 <= ticks <= 2000:
        raise InputError(f"a period of excitation holds {system.cycle * rate:.4g} ticks at {rate:g} Hz; a controller "
                         "needs 4 to 2000")
    if isinstance(motion, Constant) and math.isinf(motion.slope):
        raise InputError("the scene sticks, and no controller changes its slip speed; give --slip")
    if motion.mean_slip <= 0.0:
        raise InputError(f"the mean slip speed is {motion.mean_slip:g} rad/s; the slip controller holds one above 0")
    loop = _Loop(motion, ticks, gains)
    multipliers = largest_first(loop.multipliers())
    stable = bool(abs(multipliers[0]) < 1.0)
    return SlipLoop(*gains, loop.step, stable, multipliers[np.abs(multipliers) > 1e-6],
                    loop.gain_margin() if stable else None, loop.phase_margin(),
                    loop.largest_delay() if stable else None, _smallest_slip(loop, progress) if stable else None)


class _Loop:
    """The closed loop about a motion, with `ticks` in an engine cycle."""

    def __init__(self, motion: Constant | Periodic, ticks: int, gains: tuple[float, float]) -> None:
        self.motion, self.system, self.ticks, self.gains = motion, motion.system, ticks, gains
        self.step = motion.system.cycle / ticks
        if isinstance(motion, Periodic):
            parts = cut(motion.system, motion.period, motion.states[0], ticks)
            by_state, by_pressure = parts.by_state, parts.by_input[..., 0]
        else:
            a, b, *_ = matrices_of(motion, True)
            held = expm(np.block([[a, b], [np.zeros((1, 4))]]) * motion.system.cycle / ticks)
            by_state, by_pressure = np.array([held[:3, :3]] * ticks), np.array([held[:3, 3]] * ticks)
        self._by_state, self._by_pressure = by_state, by_pressure

    def multipliers(self, factor: float = 1.0, late: int = 0) -> Complex:
        """Return the eigenvalues of the loop's map over the motion's period, with raised gains and late commands.

        State: the plant's, the integral part, the slip speeds of the cycle but the newest, the commands on their way
        and, for an actuator with a lag, the pressure at the plates, whose mean over a tick acts in it.
        """
        past, lag = self.ticks - 1, self.system.pressure.time_constant
        late += round(self.system.pressure.delay / self.step)
        whole = np.eye(4 + past + late + (lag > 0.0))
        x, integral, slips, waiting = whole[:3], whole[3], whole[4:4 + past], whole[4 + past:4 + past + late]
        plates = whole[4 + past + late:]
        left = math.exp(-self.step / lag) if lag else 0.0
        share = lag / self.step * (1.0 - left)
        proportional, rate = factor * self.gains[0], factor * self.gains[1] * self.step
        for by_state, by_pressure in zip(self._by_state, self._by_pressure):
            mean = (x[0] + slips.sum(0)) / self.ticks
            waiting = np.vstack([waiting, (proportional * mean + integral) / self.system.torque_per_pressure])
            integral, slips = integral + rate * mean, np.vstack([slips[1:], x[0]])
            command, waiting = waiting[0], waiting[1:]
            acting = command + share * (plates[0] - command) if lag else command
            plates = command + left * (plates - command)
            x = by_state @ x + np.outer(by_pressure, acting)
        return np.asarray(np.linalg.eigvals(np.vstack([x, integral, slips, waiting, plates])), np.complex128)

    def stable(self, factor: float = 1.0, late: int = 0) -> bool:
        """Return whether every multiplier is inside the unit circle."""
        return self.growth(factor, late) < 0.0

    def growth(self, factor: float = 1.0, late: int = 0) -> float:
        """Return the logarithm of the largest multiplier's modulus."""
        return math.log(max(float(np.abs(self.multipliers(factor, late)).max()), 1e-300))

    def gain_margin(self) -> float | None:
        """Return the least factor of both gains that makes a stable loop unstable."""
        low = 1.0
        for high in np.geomspace(1.0, HIGHEST, 61)[1:].tolist():
            if not self.stable(high):
                while high - low > 1e-4 * low:
                    middle = 0.5 * (low + high)
                    low, high = (middle, high) if self.stable(middle) else (low, middle)
                return float(high)
            low = high
        return None

    def largest_delay(self) -> float | None:
        """Return the least delay in whole ticks that makes a stable loop unstable, s."""
        low, high = 0, 1
        while self.stable(late=high):
            low, high = high, 2 * high
            if high > MOST_LATE:
                return None
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self.stable(late=middle) else (low, middle)
        return high * self.step

    def phase_margin(self) -> float | None:
        """Return the least distance of the open loop's phase from -180 degrees at gain 1, rad."""
        top = min(3.0 * self.system.natural_frequency, 0.9 * math.pi / self.step)
        omegas = np.unique(np.concatenate([np.geomspace(0.2, top, 400), np.linspace(0.2, top, 800)]))
        s = 1j * omegas
        late = np.exp(-s * self.step)
        mean = (1.0 - late**self.ticks) / (1.0 - late) / self.ticks
        held = (1.0 - late) / (s * self.step)
        law = self.gains[0] + self.gains[1] * self.step * late / (1.0 - late)
        plant = response_of(self.motion, "actuation_pressure", "slip_speed", omegas)
        loop = -plant * mean * held * law / self.system.torque_per_pressure
        with np.errstate(divide="ignore"):  # The mean over a cycle has zeros.
            gain, phase = np.log(np.abs(loop)), np.unwrap(np.angle(loop))
        crossed = np.flatnonzero(gain[:-1] * gain[1:] <= 0.0)
        part = gain[crossed] / (gain[crossed] - gain[crossed + 1])
        at = phase[crossed] + part * (phase[crossed + 1] - phase[crossed])
        margins = np.mod(at + 2.0 * math.pi, 2.0 * math.pi) - math.pi
        return float(margins[np.abs(margins).argmin()]) if len(margins) else None


def _smallest_slip(loop: _Loop, progress: bool) -> float:
    """Return the mean slip speed down to which a loop remains stable, rad/s; 0 if it does down to LEAST_SLIP.

    It is the root of the logarithm of the largest multiplier, between the first two tried slip speeds of which one is
    unstable. They are powers of SLOWER, so that the result does not depend on the motion that the search begins with.
    """
    near, high = loop.motion, loop.motion.mean_slip
    least, known = LEAST_SLIP * high, {high: loop.growth()}

    with progress_bar("slip speed", shown=progress, leave=False) as bar:
        def growth(slip: float) -> float:
            nonlocal near
            if slip not in known:
                bar.update()
                try:
                    point = operating_point(near.system, slip, near)
                    known[slip] = _Loop(point, loop.ticks, loop.gains).growth()
                    near = point if known[slip] < 0.0 else near
                except (OutOfRange, NumericalFailure):   # No motion of this slip speed repeats.
                    known[slip] = 1.0
            return known[slip]

        power = math.floor(math.log(high) / math.log(SLOWER)) + 1
        while (low := SLOWER**power) >= least:
            if growth(low) >= 0.0:
                return float(brentq(growth, low, high, xtol=0.5 * WITHIN * low, rtol=0.5 * WITHIN))
            high, power = low, power + 1
        return 0.0
