"""Certified crossings and extremes against rational and long arithmetic: none is missed, none is false."""

import math
from fractions import Fraction

import numpy as np
import pytest

from tcc_sim.polynomials import polynomial
from tcc_sim.polynomials.polynomial import DEGREE_MAXIMUM, to_bernstein

WORKSPACE = np.zeros(polynomial.WORKSPACE)
GRID = np.linspace(0, 1, 513, dtype=np.longdouble)


def row_of(coefficients):
    """Coefficients as row 1 of an array whose other places would show if they were read."""
    c = np.full((3, DEGREE_MAXIMUM + 3), 1e300)
    c[1, :len(coefficients)] = coefficients
    return c, len(coefficients) - 1


def extremes(c, row, degree, end, highest, lowest):
    """`highest` and `lowest` widened by what the polynomial reaches over [0, end]."""
    to_bernstein(c, row, degree, end, WORKSPACE)
    return polynomial.extremes_of(c, row, degree, end, highest, lowest, WORKSPACE)


def exact(coefficients, x):
    total = Fraction(0)
    for a in reversed(coefficients):
        total = total * Fraction(x) + Fraction(float(a))
    return total


def product(*factors):
    """Coefficients of a product, rounded once."""
    out = [Fraction(1)]
    for factor in factors:
        factor = [Fraction(f) for f in factor]
        rows = [[Fraction(0)] * k + [f * x for x in out] + [Fraction(0)] * (len(factor) - 1 - k)
                for k, f in enumerate(factor)]
        out = [sum(column) for column in zip(*rows)]
    return [float(x) for x in out]


def positive(random, degree):
    """A polynomial without a real root, of about this degree, 1 at 0."""
    pairs = [random.normal(size=2) for _ in range(degree // 2)]
    factors = [[a * a + b * b + 0.05, -2.0 * a, 1.0] for a, b in pairs]
    return [[x / factor[0] for x in factor] for factor in factors]


def first(coefficients, level=0.0, sign=1.0, end=1.0, accuracy=None):
    c, degree = row_of(coefficients)
    size = sum(abs(a) * end**k for k, a in enumerate(coefficients))
    return polynomial.first_crossing(c, 1, degree, end, sign, level, 1e-14 * size if accuracy is None else accuracy,
                                     WORKSPACE)


def test_a_dip_counts_from_half_of_the_accuracy_on():
    for depth, found in ((0.49, False), (0.51, True), (1.0, True)):
        for sign in (1.0, -1.0):
            x = first([sign * (0.25 - depth * 1e-6), -sign, sign], sign=sign, accuracy=1e-6)
            assert x == (pytest.approx(0.5 - 1e-3 * math.sqrt(depth), abs=5e-4) if found else math.inf)


def test_the_first_crossing_of_random_polynomials():
    """It is a root, and in long arithmetic the polynomial is above the level on a grid and between its roots before."""
    random = np.random.default_rng(0)
    for _ in range(100):
        degree = int(random.integers(1, 29))
        end, sign, level = 10.0 ** random.uniform(-3, 3), random.choice([-1.0, 1.0]), random.normal()
        roots = random.uniform(-0.3, 1.3, int(random.integers(0, min(degree, 6) + 1)))
        a = np.array(product(*[[r, -1.0] for r in roots], *positive(random, degree - len(roots))))
        a *= np.sign(a[0]) * 10.0 ** random.uniform(-3, 3)
        size = np.abs(a).sum()
        q = a.copy()
        a = sign * a
        a[0] += sign * level
        a /= end ** np.arange(len(a))
        x = first(a, level, sign, end) / end
        tiny = 2e-13 * (size + abs(level))
        edges = np.sort(np.concatenate([roots, [1.0]]))
        grid = np.concatenate([GRID, 0.5 * (edges[1:] + edges[:-1])])
        before = grid[(grid >= 0.0) & (grid < x * (1.0 - 1e-9)) & (grid <= 1.0)]
        assert before.size == 0 or np.polyval(np.longdouble(q[::-1]), before).min() >= -tiny
        if x < math.inf:
            assert abs(exact(q, x)) <= tiny
            assert 0.0 <= x <= 1.0 + 1e-15


@pytest.mark.parametrize("depth", [1e-2, 1e-6, 1e-10, 1e-12])
def test_near_grazing_dips_are_found_and_near_misses_are_not(depth):
    random = np.random.default_rng(5)
    for _ in range(8):
        at = random.uniform(0.1, 0.9)
        others = positive(random, int(random.integers(2, 20)))
        for sign in (1.0, -1.0):
            a = product([at * at - sign * depth, -2.0 * at, 1.0], *others)
            x = first(a)
            result = float(exact(product(*others), at))
            if depth * result <= 1e-13 * sum(abs(b) for b in a):
                assert x == math.inf or x == pytest.approx(at, abs=1e-3)
            elif sign > 0.0:
                assert x == pytest.approx(at - math.sqrt(depth), abs=1e-11 / math.sqrt(depth))
            else:
                assert x == math.inf


def test_roots_at_the_ends():
    assert first(product([1.0, -1.0], [2.0, 1.0])) in (pytest.approx(1.0, abs=1e-14), math.inf)
    assert first([1.0 - 1e-9, -1.0]) == pytest.approx(1.0 - 1e-9, abs=1e-15)
    assert first([1.0 + 1e-9, -1.0]) == math.inf
    assert first([0.0, -1.0, 3.0]) == 0.0
    assert first([0.0, 1.0, -2.0]) == pytest.approx(0.5, abs=1e-15), "leaves the level and comes back"
    assert first([0.0, 1.0, 1.0]) == math.inf
    assert first([0.0, 0.0, 1.0, -4.0]) == pytest.approx(0.25, abs=1e-15), "without a slope at first"
    assert first([0.0, 0.0, -1.0, 1.0]) == pytest.approx(0.0, abs=1e-7)
    assert first([0.0, 0.0, 0.0]) == math.inf
    assert first([-0.1, -1.0, 5.0]) == 0.0, "below the level and falling"
    assert first([-0.1, 1.0, -1.0]) == pytest.approx(0.5 + math.sqrt(0.15), abs=1e-14), "below, then over it"
    assert first([-0.3, 1.0, -1.0]) == math.inf, "never above"
    assert first([3.0]) == math.inf


def test_starts_within_the_accuracy_are_at_the_level():
    for start in (1e-13, -1e-13):
        assert first([start, -1.0, 0.5], accuracy=1e-12) == 0.0
        assert first([start, 1.0, -2.0], accuracy=1e-12) == pytest.approx(0.5, abs=1e-12)
        assert first([start, 1.0, 0.5], accuracy=1e-12) == math.inf


def test_extremes():
    random = np.random.default_rng(100)
    for _ in range(60):
        degree = int(random.integers(1, 29))
        a = random.normal(size=degree + 1) * 0.8 ** np.arange(degree + 1)
        c, _ = row_of(a)
        end = random.uniform(0.3, 1.5)
        slope = np.polynomial.polynomial.polyroots(np.polynomial.polynomial.polyder(a))
        inner = [float(z.real) for z in slope if abs(z.imag) < 1e-4 and 0.0 < z.real < end]
        values = [float(exact(a, x)) for x in (0.0, end, *inner)]
        size = sum(abs(b) * end**k for k, b in enumerate(a))
        highest, lowest = extremes(c, 1, degree, end, a[0], a[0])
        assert highest == pytest.approx(max(values), abs=2e-13 * size)
        assert lowest == pytest.approx(min(values), abs=2e-13 * size)
        assert extremes(c, 1, degree, end, 1e9, -1e9) == (1e9, -1e9)


@pytest.mark.parametrize("slope", [0.0, 1e-17, -1e-17])
def test_an_extreme_after_a_start_without_slope(slope):
    """Slip begins so: v = 3 x^2 - 2.1 x^3 has its largest value at x = 20/21."""
    c, degree = row_of([0.0, slope, 3.0, -2.1])
    for sign in (1.0, -1.0):
        c[1, :4] *= sign
        highest, lowest = extremes(c, 1, degree, 1.2, 0.0, 0.0)
        result = highest if c[1, 2] > 0.0 else lowest
        assert result == pytest.approx(math.copysign(400.0 / 441.0, c[1, 2]), abs=1e-14)


@pytest.mark.parametrize("mode", [-1, 0, 1])
def test_leaving_a_mode(mode):
    """Against the real roots of v - level and v + level that numpy finds."""
    random = np.random.default_rng(11 + mode)
    met = 0
    for _ in range(200):
        roots = random.uniform(-0.2, 1.2, int(random.integers(2, 5)))
        a = np.array(product(*[[r, -1.0] for r in roots])) * 10.0
        level = 0.05
        c, degree = row_of(a)
        crossings = []
        for edge in (level, -level):
            shifted = a.copy()
            shifted[0] -= edge
            crossings += [(z.real, edge) for z in np.polynomial.polynomial.polyroots(shifted) if abs(z.imag) < 1e-9]
        mids = random.uniform(0.0, 0.8)
        v = float(exact(a, mids))
        if (0 if abs(v) <= level else int(np.sign(v))) != mode:
            continue
        after = sorted(x for x, edge in crossings if mids < x <= 1.0 and (mode == 0 or edge == mode * level))
        polynomial.to_bernstein(c, 1, degree, 1.0, WORKSPACE)
        x = polynomial.stick_crossing(c, 1, degree, mids, 1.0, mode, level, WORKSPACE)
        assert x == (pytest.approx(after[0], abs=1e-8) if after else math.inf)
        met += 1
    assert met > 5


def test_from_a_start_at_the_level_the_next_fall_is_the_first_root():
    """x times factors with known roots: it rises from its start, exactly at the level or within the accuracy of it."""
    random = np.random.default_rng(1)
    for _ in range(150):
        roots = np.sort(random.uniform(0.05, 1.3, int(random.integers(1, 6))))
        if len(roots) > 1 and roots[1] - roots[0] < 1e-3:
            continue
        a = product([0.0, 1.0], *([float(r), -1.0] for r in roots), *positive(random, int(random.integers(0, 8))))
        size = sum(map(abs, a))
        a[0] = random.choice([0.0, 0.5e-14, -0.5e-14]) * size
        x = first(a)
        if roots[0] <= 1.0 - 1e-6:
            assert x == pytest.approx(roots[0], abs=1e-6)
        elif roots[0] > 1.0 + 1e-6:
            assert x == math.inf
