"""Kinds of change of the event sequence, and Den Hartog's oscillator as a map with saltation."""

import math

import numpy as np
import pytest

from tcc_sim.continuation.newton import find_orbit, orbit_at
from tcc_sim.continuation.problem import NO_MARGINS, Floats, Image, Margins, Observation, Values
from tcc_sim.continuation.shooting import ParameterRange, Shooting
from tcc_sim.continuation.sliding import differ, kind_of_change, ring

NEAR = (NO_MARGINS, NO_MARGINS)


def test_sequences_are_rings() -> None:
    assert ring("S+S") == ring("+S") == ring("+S+")
    assert not differ("S+S-S", "-S+S-")
    assert differ("S+S", "S+S+S")
    assert ring("") == ""
    assert ring("S") == "S"


@pytest.mark.parametrize(("before", "after", "kind"), [
    ("S", "S+S", "stick_border"), ("S-S+S", "S", "stick_border"),
    ("+", "+S+", "grazing_sliding"), ("S+S-", "S+S+S-", "adding_sliding"),
    ("S+-S", "S+S-S", "crossing_sliding"), ("S+S", "S+-S", "switching_sliding"),
    ("-", "-S-S-", "grazing_sliding"), ("+-", "+S-S", "crossing_sliding"),
])
def test_the_change_of_a_sequence_names_its_kind(before: str, after: str, kind: str) -> None:
    assert kind_of_change(before, after, NEAR) == kind
    assert kind_of_change(after, before, NEAR) == kind


def test_the_smallest_margin_decides_where_several_events_change() -> None:
    near = Margins(1e-9, 0.2, False, 0.3)
    assert kind_of_change("+S-", "+S-S+S-S+-", (near, NO_MARGINS)) in ("grazing_sliding", "adding_sliding")


class DenHartog:
    """x'' + x = cos(beta t) - s sgn x' at phase 0 of the drive; slip only, closed form, saltation where x' turns."""

    dimension, amplitude_scale, forcing_period, piecewise = 2, 1.0, 1, True
    scales = np.ones(2)
    divisible = False

    def __init__(self, beta: float) -> None:
        self.beta = beta

    def arc(self, t0: float, state: Floats, sign: float, s: float, t: float) -> Floats:
        gain, b = 1.0 / (1.0 - self.beta**2), self.beta
        x = state[0] + s * sign - gain * math.cos(b * t0)
        v = state[1] + gain * b * math.sin(b * t0)
        c, d = math.cos(t - t0), math.sin(t - t0)
        return np.array([x * c + v * d - s * sign + gain * math.cos(b * t), v * c - x * d - gain * b * math.sin(b * t)])

    def evaluate(self, x: Floats, values: Values, first: int, cycles: int) -> Image:
        s, t, end = values[0], 0.0, 2.0 * math.pi / self.beta * cycles
        sign = 1.0 if x[1] > 0.0 else -1.0
        m, by = np.eye(2), np.zeros(2)
        while t < end:
            grid = np.linspace(t, end, 400)[1:]
            crossed = [u for u in grid if sign * self.arc(t, x, sign, s, u)[1] < 0.0]
            stop = end
            if crossed:
                low, stop = max(t, crossed[0] - (grid[1] - grid[0])), crossed[0]
                for _ in range(60):
                    middle = 0.5 * (low + stop)
                    low, stop = (low, middle) if sign * self.arc(t, x, sign, s, middle)[1] < 0.0 else (middle, stop)
            c, d = math.cos(stop - t), math.sin(stop - t)
            turn = np.array([[c, d], [-d, c]])
            by = turn @ by + sign * (np.array([c, -d]) - np.array([1.0, 0.0]))
            x, m = self.arc(t, x, sign, s, stop), turn @ m
            t = stop
            if crossed:
                pull = math.cos(self.beta * t) - x[0]
                jump = np.eye(2)
                jump[1, 1] = (pull + s * sign) / (pull - s * sign)
                x, m, by, sign = np.array([x[0], 0.0]), jump @ m, jump @ by, -sign
        return Image(x, np.column_stack([m, by]))

    @property
    def coarse(self):
        return self

    def evaluate_each(self, states: Floats, values: Values, firsts: list[int], cycles: list[int]) -> list[Image]:
        return [self.evaluate(x, values, first, count) for x, first, count in zip(states, firsts, cycles)]

    def observe(self, x: Floats, values: Values, first: int, cycles: int) -> Observation:
        return Observation(float(abs(x[0])), 0.0, "+-", (float(abs(x[0])),))

    def margins(self, x: Floats, values: Values, first: int, cycles: int) -> Margins:
        return NO_MARGINS


def test_den_hartogs_oscillator_without_stops() -> None:
    beta, s = 1.3, 0.2
    shooting = Shooting.single(DenHartog(beta), 1, ParameterRange(0.0, 0.5))
    z = find_orbit(shooting, (s,), [np.array([-1.2, 0.4])])
    assert z is not None
    found = orbit_at(shooting, z, shooting.linearise(z))
    gain = 1.0 / (1.0 - beta**2)
    swing = math.sin(math.pi / beta) / (beta * (1.0 + math.cos(math.pi / beta)))
    largest = math.sqrt(gain**2 - (s * swing) ** 2)
    turned = abs(largest / gain - largest)  # Acceleration without friction where it turns round.
    map_ = DenHartog(beta)
    sign, t = math.copysign(1.0, found.section[1]), np.linspace(0.0, math.pi / beta, 4001)
    path = np.array([map_.arc(0.0, found.section, sign, s, u) for u in t])
    k = int(np.flatnonzero(sign * path[:, 1] < 0.0)[0])
    seen = abs(path[k - 1:k + 1, 0]).max()
    assert seen == pytest.approx(largest, abs=1e-6)
    assert float(np.prod(found.multipliers).real) == pytest.approx(((turned - s) / (turned + s)) ** 2, abs=1e-8)
    assert found.stable
