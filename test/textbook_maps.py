"""Maps of textbooks with known bifurcations, in the protocol of `continuation`."""

from collections.abc import Callable

import numpy as np

from tcc_sim.study.continuation.problem import Floats, Image, Margins, Observation, Values

Step = Callable[[Floats, Values], tuple[Floats, Floats, Floats]]


class TextbookMap:
    """A smooth map given by one step: value, derivative by the state, derivative by the parameters."""

    amplitude_scale = 1.0
    forcing_period = 1
    piecewise = False
    divisible = False

    def __init__(self, step: Step, dimension: int) -> None:
        self.step, self.dimension = step, dimension
        self.scales = np.ones(dimension)
        self.evaluations = 0

    def evaluate(self, x: Floats, values: Values, first: int, cycles: int) -> Image:
        self.evaluations += 1
        seen = self.observe(x, values, first, cycles)
        jacobian, by_parameter = np.eye(self.dimension), np.zeros((self.dimension, len(values)))
        for _ in range(cycles):
            x, a, b = self.step(x, values)
            jacobian, by_parameter = a @ jacobian, a @ by_parameter + b
        if not np.isfinite(x).all():
            raise ArithmeticError("not finite")
        return Image(x, np.hstack([jacobian, by_parameter]), seen)

    @property
    def coarse(self):
        return self

    def evaluate_each(self, states, values: Values, firsts, cycles) -> list[Image]:
        return [self.evaluate(x, values, first, count) for x, first, count in zip(states, firsts, cycles)]

    def observe(self, x: Floats, values: Values, first: int, cycles: int) -> Observation:
        largest = float(np.abs(x).max())
        return Observation(largest, 0.0, "", (largest,) * cycles)

    def margins(self, x: Floats, values: Values, first: int, cycles: int) -> Margins:
        return {}


def henon(x: Floats, p: Values) -> tuple[Floats, Floats, Floats]:
    """x' = a - x^2 + b y, y' = x: fold at a = -(1 - b)^2/4, doubling at 3 (1 - b)^2/4; parameters a, b."""
    a, b = p[0], p[1] if len(p) > 1 else 0.3
    by = np.array([[1.0, x[1]], [0.0, 0.0]])[:, :len(p)]
    return np.array([a - x[0] ** 2 + b * x[1], x[0]]), np.array([[-2.0 * x[0], b], [1.0, 0.0]]), by


def delayed_logistic(x: Floats, p: Values) -> tuple[Floats, Floats, Floats]:
    """x' = r x (1 - y), y' = x: Neimark-Sacker at r = 2 on x = 1 - 1/r."""
    r = p[0]
    return (np.array([r * x[0] * (1.0 - x[1]), x[0]]), np.array([[r * (1.0 - x[1]), -r * x[0]], [1.0, 0.0]]),
            np.array([[x[0] * (1.0 - x[1])], [0.0]]))


def logistic(x: Floats, p: Values) -> tuple[Floats, Floats, Floats]:
    """x' = r x (1 - x): doublings at r = 3, 1 + sqrt 6, 3.5440903595..., a transcritical branch point at r = 1."""
    return p[0] * x * (1.0 - x), np.array([[p[0] * (1.0 - 2.0 * x[0])]]), (x * (1.0 - x))[:, None]


def isola(x: Floats, p: Values) -> tuple[Floats, Floats, Floats]:
    """x' = x + (x^2 + p^2 - 1)/4: fixed points on the unit circle, folds at p = -1 and 1."""
    return (x + 0.25 * (x**2 + p[0] ** 2 - 1.0), np.array([[1.0 + 0.5 * x[0]]]), np.array([[0.5 * p[0]]]))
