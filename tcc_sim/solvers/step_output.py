"""What is kept of a step of the smoothed engine: samples, extremes, time in stick, transitions, and the counts."""

from __future__ import annotations

from typing import Any

from tcc_sim.solvers import polynomial
from tcc_sim.solvers.compiled import compiled_without_allocation

STEPS, REJECTED, ITERATIONS, ITERATIONS_MAX, TRANSITIONS, SAMPLES, MODE, STATUS, CYCLES = range(9)
"""Places in the array of counts."""

SLIP, ANGLE, SPEED, FLYWHEEL = range(4)
"""Rows of a step's polynomials: slip speed, plate angle, plate speed, flywheel angle."""


@compiled_without_allocation
def record(series: Any, degree: int, unit: float, x: float, tau: float, time: float, inside: bool, sign: float,
           stick_speed: float, tally: Any, extent: Any, period: float, per_cycle: int, first_sample: int, samples: Any,
           times: Any, before: Any, after: Any, angle: Any) -> None:
    """Keep what a step of length x * unit says: samples, extremes, time in stick and transitions."""
    extent[0], extent[1] = polynomial.extremes(series, SLIP, degree, x, extent[0], extent[1])
    if per_cycle > 0:
        spacing = period / per_cycle
        end = tau + x * unit
        while tally[SAMPLES] < samples.shape[0] and (tally[SAMPLES] - first_sample) * spacing < end:
            local = (tally[SAMPLES] - first_sample) * spacing
            if tally[SAMPLES] - first_sample >= per_cycle:
                break
            at = min(max((local - tau) / unit, 0.0), x)
            row = tally[SAMPLES]
            samples[row, 0] = polynomial.value(series, SLIP, degree, at)
            samples[row, 1] = polynomial.value(series, ANGLE, degree, at)
            samples[row, 2] = polynomial.value(series, SPEED, degree, at)
            if angle is not None:
                samples[row, 3] = polynomial.value(series, FLYWHEEL, degree, at)
            tally[SAMPLES] += 1
    mode = tally[MODE]
    start = 0.0
    reach = polynomial.variation(series, SLIP, degree, x) if inside else 0.0
    while inside or mode != sign:
        low, high = abs(series[SLIP, 0]) - reach, abs(series[SLIP, 0]) + reach
        if (mode == 0 and high <= stick_speed) or (mode != 0 and low > stick_speed and mode * series[SLIP, 0] > 0.0):
            break
        at = polynomial.stick_crossing(series, SLIP, degree, start, x, mode, stick_speed)
        if at > x:
            break
        if mode == 0:
            extent[2] += (at - start) * unit
            new = 1 if polynomial.value(series, SLIP, degree, at) > 0.0 else -1
        else:
            new = 0
        row = tally[TRANSITIONS]
        if row < times.shape[0]:
            times[row] = time + tau + at * unit
            before[row] = mode
            after[row] = new
            tally[TRANSITIONS] += 1
        mode = new
        start = at
    if mode == 0:
        extent[2] += (x - start) * unit
    tally[MODE] = mode
