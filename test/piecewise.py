"""An independent solution of the set-valued law: SciPy's DOP853 from event to event, with its own event location.

Slow and plain: modes 0 stick, +-1 slip, 2 free; nothing of the package's solvers is used.
"""

import math

import numpy as np
from oracle import sliding_of
from scipy.integrate import solve_ivp


class Piecewise:
    def __init__(self, system, rtol=1e-12, atol=1e-13, drag=0.0):
        self.s, self.rtol, self.atol, self.drag = system, rtol, atol, drag
        d, e, p = system.driveline, system.engine, system.pressure
        self.i1, self.i2, self.c, self.k = d.flywheel_inertia, d.plate_inertia, d.damping, d.stiffness
        self.kinetic, self.pairs = sliding_of(system.friction)
        self.ratio = 1.0 + sum(c for c, _ in self.pairs)
        self.sines = [(e.torque_amplitude, e.frequency, 0.0), *((a, n * e.frequency, phase) for n, (a, phase) in
                                                                enumerate(zip(e.harmonic_amplitudes,
                                                                              e.harmonic_phases), 2))]
        self.mean, self.fluid = e.mean_torque, system.converter.coupling
        self.pressure = (system.torque_per_pressure * p.mean, system.torque_per_pressure * p.amplitude,
                         p.frequency_ratio * e.frequency, p.phase)

    def engine(self, t):
        out = self.mean
        for a, w, phase in self.sines:
            out += a * math.sin(w * t + phase)
        return out

    def load(self, t):
        mean, amplitude, fast, phase = self.pressure
        return mean + amplitude * math.sin(fast * t + phase)

    def need(self, t, y):
        spring, engine = self.c * y[2] + self.k * y[1], self.engine(t) - self.drag * y[2]
        return (self.i2 * engine + self.i1 * spring) / (self.i1 + self.i2)

    def rates(self, t, y, mode):
        v, angle, speed = float(y[0]), float(y[1]), float(y[2])
        spring, engine = self.c * speed + self.k * angle, self.engine(t) - self.drag * (v + speed)
        if mode == 0:
            plate = (engine - spring) / (self.i1 + self.i2)
            return [0.0, speed, plate, v + speed]
        torque = 0.0
        if mode != 2:
            law = 1.0
            for c, a in self.pairs:
                law += c * math.exp(-a * max(mode * v, 0.0))
            torque = mode * self.load(t) * law
        torque += self.fluid * v
        plate = (torque - spring) / self.i2
        return [(engine - torque) / self.i1 - plate, speed, plate, v + speed]

    def rest_mode(self, t, y):
        need, limit = self.need(t, y), self.ratio * self.load(t)
        if abs(need) <= limit * (1 + 1e-9):
            return 0
        return 1 if need > 0 else -1

    def run(self, end, times, slices=200):
        """States at `times` (n, 4), transitions [(t, before, after)], and stick time; steps of end/slices at most."""
        i = self.s.initial
        y = np.array([i.slip_speed, i.plate_angle, i.plate_speed, i.plate_angle])
        t, out, changes, stuck, dense = 0.0, np.empty((len(times), 4)), [], 0.0, len(times) > 0
        mode = 2 if self.load(0.0) <= 0 else int(np.sign(y[0])) or self.rest_mode(0.0, y)
        departed = 0.0
        while t < end:
            run = self.piece(t, end, y, mode, departed, dense, end / slices)
            new = run.t[-1]
            inside = (times >= t) & (times <= new)
            if inside.any():
                out[inside] = run.sol(times[inside]).T
            stuck += new - t if mode == 0 else 0.0
            before, y, t = mode, run.y[:, -1].copy(), new
            if run.status == 1:
                if len(run.t_events[1]):
                    mode = (int(np.sign(y[0])) if abs(y[0]) > 1e-9 else self.rest_mode(t, y)) if mode == 2 else 2
                elif mode == 0:
                    mode = 1 if self.need(t, y) > 0 else -1
                else:
                    y[0] = 0.0
                    mode = self.rest_mode(t, y)
                departed = t
            if mode == 0:
                y[0] = 0.0
            if mode != before:
                changes.append((t, before, mode))
        return out, changes, stuck

    def piece(self, start, goal, y, mode, departed, dense, longest):
        def crossing(t, y):
            if mode == 0:
                return self.ratio * self.load(t) - abs(self.need(t, y))
            return 1.0 if mode == 2 or t < departed + 1e-7 else mode * y[0]

        def clamp(t, y):
            return self.load(t) if mode == 2 else -self.load(t)

        crossing.terminal = clamp.terminal = True
        crossing.direction, clamp.direction = -1, 1
        return solve_ivp(lambda t, y: self.rates(t, y, mode), (start, goal), y, method="DOP853", rtol=self.rtol,
                         atol=self.atol, max_step=longest, events=[crossing, clamp], dense_output=dense)
