"""An independent solution of the set-valued law: SciPy's DOP853 from event to event, with its own event location.

Slow and plain: modes 0 stick, +-1 slip, 2 free; nothing of the package's solvers is used.
"""

import math

import numpy as np
from oracle import sliding_of
from scipy.integrate import solve_ivp


class Piecewise:
    def __init__(self, system, rtol=1e-13, atol=1e-13):
        self.s, self.rtol, self.atol = system, rtol, atol
        d = system.driveline
        self.i1, self.i2, self.c, self.k = d.flywheel_inertia, d.plate_inertia, d.damping, d.stiffness
        self.kinetic, self.pairs = sliding_of(system.friction)
        self.ratio = 1.0 + sum(c for c, _ in self.pairs)

    def engine(self, t):
        e = self.s.engine
        out = e.mean_torque + e.torque_amplitude * math.sin(e.frequency * t)
        for n, (a, p) in enumerate(zip(e.harmonic_amplitudes, e.harmonic_phases), 2):
            out += a * math.sin(n * e.frequency * t + p)
        return out

    def load(self, t):
        p = self.s.pressure
        return self.s.torque_per_pressure * (p.mean + p.amplitude
                                             * math.sin(p.frequency_ratio * self.s.engine.frequency * t
                                                                             + p.phase))

    def need(self, t, y):
        spring = self.c * y[2] + self.k * y[1]
        return (self.i2 * self.engine(t) + self.i1 * spring) / (self.i1 + self.i2)

    def friction(self, t, y, mode):
        if mode == 0:
            return self.need(t, y)
        if mode == 2:
            return 0.0
        law = 1.0 + sum(c * math.exp(-a * max(mode * y[0], 0.0)) for c, a in self.pairs)
        return mode * self.load(t) * law

    def rates(self, t, y, mode):
        torque = self.friction(t, y, mode)
        plate = (torque - self.c * y[2] - self.k * y[1]) / self.i2
        slip = 0.0 if mode == 0 else (self.engine(t) - torque) / self.i1 - plate
        return [slip, y[2], plate, y[0] + y[2]]

    def rest_mode(self, t, y):
        need, limit = self.need(t, y), self.ratio * self.load(t)
        if abs(need) <= limit * (1 + 1e-9):
            return 0
        return 1 if need > 0 else -1

    def run(self, end, times, slices=200):
        """States at `times` (n, 4), transitions [(t, before, after)], and stick time; [0, end] in short slices."""
        i = self.s.initial
        y = np.array([i.slip_speed, i.plate_angle, i.plate_speed, i.plate_angle])
        t, out, changes, stuck = 0.0, np.empty((len(times), 4)), [], 0.0
        mode = 2 if self.load(0.0) <= 0 else int(np.sign(y[0])) or self.rest_mode(0.0, y)
        departed = 0.0
        while t < end:
            goal = min(end, t + end / slices)

            run = self.piece(t, goal, y, mode, departed)
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

    def piece(self, start, goal, y, mode, departed):
        def crossing(t, y):
            if mode == 0:
                return self.ratio * self.load(t) - abs(self.need(t, y))
            return 1.0 if mode == 2 or t < departed + 1e-7 else mode * y[0]

        def clamp(t, y):
            return self.load(t) if mode == 2 else -self.load(t)

        crossing.terminal = clamp.terminal = True
        crossing.direction, clamp.direction = -1, 1
        return solve_ivp(lambda t, y: self.rates(t, y, mode), (start, goal), y, method="DOP853", rtol=self.rtol,
                         atol=self.atol,
                         events=[crossing, clamp], dense_output=True)
