"""The last samples of a recording's longest run, in bounded memory."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np

from tcc_sim.analysis.engine_clock import EngineClock
from tcc_sim.analysis.stream import CycleStream
from tcc_sim.model import equations
from tcc_sim.model.parameters import System
from tcc_sim.recording.batches import JointStates
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.trajectory import Floats, Modes, Trajectory, no_cycles

TAIL_CYCLES = 24
"""Engine cycles kept as samples, for a picture of the end of the run."""
TAIL_SAMPLES = 200_000
"""Most samples kept."""
_Part = tuple[JointStates, Floats, Modes]


class Tail:
    """The last samples of the longest run so far, bounded."""

    def __init__(self, system: System, clock: EngineClock) -> None:
        self.stick_speed = stick_speed_of(terms_of(system))
        self.run_started = False
        self._system, self._clock, self._cycle = system, clock, clock.cycle
        self._parts: deque[_Part] = deque()
        self._held = 0
        self._kept: tuple[int, deque[_Part]] | None = None
        self._number = -1

    def add(self, batch: JointStates, slip_speed: Floats, state: Modes, stream: CycleStream) -> None:
        """Take the next batch; `stream` has it already."""
        number = len(stream.runs) - 1
        self.run_started = number != self._number and self._number >= 0
        if self.run_started:
            self._keep_longer(stream)
            self._parts, self._held = deque(), 0
        self._number = number
        self._parts.append((batch, slip_speed, state))
        self._held += len(batch)
        self._stream = stream
        start = int(batch.stamp_ns[-1]) - round(TAIL_CYCLES * self._cycle * 1e9)
        while len(self._parts) > 1 and (self._parts[0][0].stamp_ns[-1] < start or self._held > 2 * TAIL_SAMPLES):
            self._held -= len(self._parts.popleft()[0])

    def trajectory(self, solver: str) -> Trajectory:
        """The samples of the longest run's end."""
        self._keep_longer(self._stream)
        assert self._kept is not None
        parts = self._kept[1]
        t = _joined([part[0].stamp_ns for part in parts]) * 1e-9
        late = slice(int(np.searchsorted(t, t[-1] - TAIL_CYCLES * self._cycle)), None)
        plate_angle, plate_speed, engine, friction, flywheel = (
            _joined([getattr(part[0], name) for part in parts])[late]
            for name in ("plate_angle", "plate_speed", "engine_torque", "friction_torque", "flywheel_angle"))
        load = np.full(len(t), math.nan)
        if self._system.pressure.source == "topic":
            pressure = [part[0].applied_pressure for part in parts if part[0].applied_pressure is not None]
            if len(pressure) == len(parts):
                load = self._system.torque_per_pressure * _joined(pressure)
        else:
            terms = terms_of(self._system)
            load = np.asarray(equations.saturation_torque(t, terms.mean_load, terms.pulsation))
        return Trajectory(
            t=t[late], slip_speed=_joined([part[1] for part in parts])[late], plate_angle=plate_angle,
            plate_speed=plate_speed,
            engine_torque=engine, saturation_torque=load[late], friction_torque=friction,
            state=_joined([part[2] for part in parts])[late], cycle=self._cycle, solver=solver, system=self._system,
            flywheel_angle=flywheel, cycles=None if self._clock.told else no_cycles())

    def _keep_longer(self, stream: CycleStream) -> None:
        """Keep the end of the run at hand unless the one kept has more whole cycles."""
        if self._kept is None or stream.runs[self._number].observed() >= stream.runs[self._kept[0]].observed():
            self._kept = self._number, self._parts


def _joined(columns: list[Any]) -> Any:
    """Columns one after the other, the last TAIL_SAMPLES of them."""
    return np.concatenate(columns)[-TAIL_SAMPLES:]
