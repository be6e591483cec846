"""Bifurcations between two neighbouring points of a branch, and the bordered systems that locate them.

A fold, a doubling or a Neimark-Sacker bifurcation is a root of a test function along the chord between the points
(Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, Section 10.2). A bordered system, an orbit's equations and
further scalars that vanish, is solved by one Newton method where the branch is singular, at branch points and where the
period halves, and where the test has no second sign: the margin of a change of the event sequence is defined on one
side only.

The scalar of a smooth bifurcation comes from a bordered matrix. The derivatives M_k of the segments of an orbit make
L(mu) x = (M_1 x_1 - x_2, ..., M_m x_m - mu x_1), which is singular where mu is a multiplier: mu = 1 at a fold, -1 at a
doubling, exp(i theta) with theta as a further unknown at a Neimark-Sacker bifurcation. With A = L(mu) singular, g of
[A b; c 0] [v; g] = [0; 1] is 0 and smooth there, and its gradient is -w A_z v with w from the transposed system
(W. Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM 2000, Section 3.3; Kuznetsov, Section
10.7). Second derivatives are symmetric, so one difference of the Jacobian along v gives all of w A_z v. At a branch
point A is the Jacobian itself, with two borders. The scalar of a change of the event sequence is the margin that
vanishes there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.steady.exponents import multipliers_of
from tcc_sim.result import Described, reported, reporting, result_class
from tcc_sim.study.continuation import orbits
from tcc_sim.study.continuation.arclength import Bracket, CurvePoint, P, tangent_of, turned_round
from tcc_sim.study.continuation.orbits import Floats, Linearised, Margins, Shooting, Vectors, cyclic

LOCATED = 1e-8  # last Newton step of a bifurcation
BORDER = 1e-12  # margin, relative to its natural size, of a solution
BORDER_RESIDUAL = 1e-11  # residual of the orbit there
BORDER_HALVINGS = (24, 20, 0)  # bisections before Newton's method; further ones after it fails
BORDER_ITERATIONS = 40  # most steps of Newton's method on a bordered system
BORDER_LEFT = 0.1  # share of the margin that a Newton step leaves, to stay on the side that has one
# Distance from the border below which it is not resolved because the margin changes very fast, on canards; the
# distance is the residual then.
BORDER_FINEST = 1e-12
CURVE_STEP = 0.03  # longest step, for pictures
CURVE_REGROWTH = 2.0  # `regrowth` along a curve
CURVE_TOLERANCE = 1e-8  # last step and residual of a point
# Step along null vectors of length one for first derivatives of the Jacobian. Beside canards motions bend within
# 1e-7, and the Jacobian's noise is some 1e-14: by halving, the derivative is good to four digits in both cases.
DIFFERENCE = 1e-8


def solve_bordered(linearise: Callable[[Floats], Linearised], u: Floats, size: int, reach: float,
                   finest: float = LOCATED, left: float = 0.0) -> tuple[Floats, Linearised, float] | None:
    """The solution near `u` of an orbit's equations and further ones, as many as unknowns, by Newton's method.

    With the linearisation beside it and its error (last step, or residual of the further equations); None if Newton's
    method fails or goes further than `reach`.

    linearise : residual and Jacobian; the `size` equations of the orbit come first
    finest : Newton step below which a point is a solution
    left : share of the further residuals that a Newton step leaves, so as to stay on one side of a border
    """
    start = u
    try:
        linearised = linearise(u)
        for _ in range(BORDER_ITERATIONS):
            value = float(np.abs(linearised.residual[size:]).max())
            if value <= BORDER and float(np.abs(linearised.residual).max()) <= BORDER_RESIDUAL:
                return u, linearised, value
            aim = -linearised.residual
            if value > BORDER:
                aim[size:] *= 1.0 - left
            step: Any = np.linalg.solve(linearised.jacobian, aim)
            length = float(np.linalg.norm(step))
            if length <= finest and value > BORDER:
                return u + step, linearised, length
            new = None
            for part in orbits.NEWTON_PARTS:
                try:
                    new = linearise(u + part * step)
                except orbits.FAILURES:
                    continue
                if float(np.abs(new.residual[size:]).max()) <= 2.0 * value + BORDER:
                    break
            else:
                return None
            u, linearised = u + part * step, new
            if float(np.linalg.norm(u - start)) > reach:
                return None
    except orbits.FAILURES:
        return None
    return None


def bordered(a: Vectors, b: Vectors, c: Vectors) -> tuple[Vectors, Vectors, Vectors]:
    """v (k, q), w (d,) and g (k,) of [A b; c 0] [v; g] = [0; I] and of the transposed system; A (d, q), c (k, q)."""
    d, q = a.shape
    matrix = np.zeros((q + 1, q + 1), dtype=a.dtype)
    matrix[:d, :q], matrix[:d, q], matrix[d:, :q] = a, b, c
    unit = np.eye(q + 1)
    right, left = np.linalg.solve(matrix, unit[:, d:]), np.linalg.solve(matrix.T, unit[q])
    return right[:q].T, left[:d], right[q]


class MinimallyAugmented:
    """An orbit and the scalar g of a fold, a doubling or a Neimark-Sacker bifurcation, whose angle is an unknown.

    One free parameter makes it a system with as many equations as unknowns, two make it a curve.
    """

    rounding: ClassVar[float] = 1e-9

    def __init__(self, kind: str, shooting: Shooting, z: Floats) -> None:
        self.kind, self.shooting = kind, shooting
        # Differences leave a larger residual of g than of the orbit, and so does rounding on a canard.
        given = shooting.settings
        self.settings = replace(given, correct_tolerance=CURVE_TOLERANCE, residual=CURVE_TOLERANCE,
                                regrowth=CURVE_REGROWTH, largest_step=min(given.largest_step, CURVE_STEP))
        self.ranges, self.size = shooting.ranges, shooting.size
        self.outer = shooting.outer
        self.turning, self.unknowns = kind == "neimark_sacker", shooting.size + len(shooting.ranges)
        # The period of a fold may halve, in a generalised doubling.
        self.doubled = kind == "fold" and shooting.period % (2 * shooting.map.forcing_period) == 0
        self.bend = 0.0
        """By how much the segments' derivatives change along the null vector."""
        linearised = shooting.linearise(z)
        self.start = z
        if self.turning:  # The argument of the complex pair of multipliers nearest to the unit circle.
            pairs = [m for m in multipliers_of(*linearised.blocks).tolist() if m.imag > 1e-9]
            if not pairs:
                raise ArithmeticError("there is no complex pair of multipliers")
            self.start = np.append(z, np.angle(min(pairs, key=lambda m: abs(abs(m) - 1.0))))
        left, _, right = np.linalg.svd(cyclic(linearised.blocks, self.multiplier(self.start)))
        self.b, self.c = left[:, -1], right[-1]

    def between_halves(self, u: Floats) -> Floats:
        """Distance between the starts of the orbit's halves, in natural sizes."""
        of, z = self.shooting.map, u[:self.unknowns]
        x, half = self.shooting.nodes(z)[0], self.shooting.period // 2
        return np.asarray((of.evaluate(x, self.shooting.values(z), 0, half).value - x) / of.scales)

    def multiplier(self, u: Floats) -> complex:
        """The multiplier on the unit circle."""
        if self.turning:
            return complex(np.exp(1j * u[-1]))
        return 1.0 if self.kind == "fold" else -1.0

    def null_vectors(self, blocks: Floats, mu: complex) -> tuple[Vectors, Vectors, complex]:
        """v and w (m, n) of the bordered systems, and g."""
        v, w, g = bordered(cyclic(blocks, mu), self.b, self.c[None])
        return v[0].reshape(blocks.shape[:2]), w.reshape(blocks.shape[:2]), g[0]

    def update_borders(self, u: Floats, linearised: Linearised, like: MinimallyAugmented | None = None) -> None:
        """Set the borders to the null vectors at a point, the best ones there.

        like : equations in other segments, whose signs they take; first nodes and last residuals are the same
        """
        v, w, _ = self.null_vectors(linearised.blocks, self.multiplier(u))
        n, signs = self.shooting.map.dimension, (1.0, 1.0)
        if like is not None and not self.turning:
            signs = (-1.0 if float(w[-1] @ like.b[-n:]) < 0.0 else 1.0, -1.0 if float(v[0] @ like.c[:n]) < 0.0 else 1.0)
        self.b, self.c = (sign * x.conj().ravel() / np.linalg.norm(x) for sign, x in zip(signs, (w, v)))

    def linearise(self, u: Floats, longer: float = 1.0) -> Linearised:
        """The orbit's equations and g, with derivatives.

        longer : the step of their differences, relative to the usual one
        """
        z, mu = u[:self.unknowns], self.multiplier(u)
        linearised = self.shooting.linearise(z)
        v, w, g = self.null_vectors(linearised.blocks, mu)
        parts: list[tuple[complex, Floats]] = [(1.0, v.real), (1j, v.imag)] if self.turning else [(1.0, v)]
        gradient = -sum(factor * self._along(z, linearised, part, w, longer) for factor, part in parts)
        if self.turning:
            gradient = np.append(gradient, 1j * mu * (w[-1] @ v[0]))
        rows = np.array([gradient.real, gradient.imag] if self.turning else [gradient])
        values = np.array([np.real(g), np.imag(g)] if self.turning else [g])
        # On a canard g changes its sign within the rounding of z, so the residual is the distance of z from there.
        size = max(float(np.linalg.norm(gradient)), 1.0)
        orbit = np.pad(linearised.jacobian, ((0, 0), (0, 1))) if self.turning else linearised.jacobian
        return Linearised(np.append(linearised.residual, values / size), np.vstack([orbit, rows / size]),
                          linearised.blocks, linearised.seen)

    def _along(self, z: Floats, linearised: Linearised, direction: Floats, w: Vectors, longer: float) -> Vectors:
        """w . (derivative of the Jacobian along a change of the nodes), by the nodes and the parameters."""
        size, step = self.shooting.size, longer * DIFFERENCE
        away = np.zeros(len(z))
        away[:size] = step * direction.ravel()
        try:
            changed = self.shooting.linearise(z + away)
        except orbits.FAILURES:  # The map ends there.
            changed, step = self.shooting.linearise(z - away), -step
        blocks = (changed.blocks - linearised.blocks) / step
        self.bend = float(np.abs(blocks).max() / max(np.linalg.norm(direction), 1e-300))
        parameters = (changed.jacobian[:, size:] - linearised.jacobian[:, size:]) / step
        return np.concatenate([np.einsum("ki,kij->kj", w, blocks).ravel(), w.ravel() @ parameters])


def nearest_margins(shooting: Shooting, z: Floats) -> Margins:
    """The margins of an orbit that are least in size over all segments, with derivatives by the scaled unknowns."""
    nodes, values, n, size = shooting.nodes(z), shooting.values(z), shooting.map.dimension, shooting.size
    out: dict[str, orbits.Margin] = {}
    for k, (first, length) in enumerate(zip(shooting.starts, shooting.segments)):
        for name, margins in shooting.map.margins(nodes[k], values, first, length).items():
            if name not in out or abs(margins.value) < abs(out[name].value):
                slopes, scaled = np.zeros(len(z)), margins.slopes * shooting.sizes
                slopes[k * n:k * n + n], slopes[size:] = scaled[:n], scaled[n:]
                out[name] = margins._replace(slopes=slopes)
    return out


SPURIOUS = 1e-2  # residual above which a change of sign is rounding
COMPLEX_PAIR = 1e-6  # argument, rad, above which a pair of multipliers is complex
BRANCH_POINT_REACH = 1e-2  # largest distance of a branch point from where Newton's method begins
BRANCH_POINT_DEFECT = 1e-6  # largest defect of its equations
HALVES_REACH = 0.1  # largest distance of the doubling from the orbit whose halves are alike
MOST_BORDERS = 6  # most changes in one step
BORDER_ASTRAY = 10.0  # distance, in lengths of the bracket, beyond which another border has been found

@dataclass(frozen=True, repr=False)
class ContinuationPoint(CurvePoint[Shooting]):
    """A point of a branch: a periodic orbit."""

    equations: Shooting

    @property
    def slope(self) -> float:
        """The parameter's component of the tangent: 0 at a fold."""
        return float(self.tangent[self.equations.size])

    @property
    def period(self) -> int:
        """Period of the orbit, cycles."""
        return self.equations.period

    @property
    def section(self) -> Floats:
        """(n,) state at phase 0."""
        out: Floats = self.equations.nodes(self.z)[0]
        return out

    @cached_property
    def multipliers(self) -> NDArray[np.complex128]:
        """(n,) Floquet multipliers, largest modulus first."""
        return multipliers_of(*self.linearised.blocks)

    @property
    def seen(self) -> orbits.Observation:
        """Largest size, stick fraction and event sequence."""
        return self.linearised.seen

    @property
    def residual(self) -> float:
        """Largest component of the equations, in natural sizes."""
        return float(np.abs(self.linearised.residual).max())

    @property
    def stable(self) -> bool:
        """Whether every multiplier lies inside the unit circle by more than rounding."""
        return bool(abs(self.multipliers[0]) < 1.0 - orbits.NEUTRAL)

    @property
    def state(self) -> orbits.OrbitState:
        """The figures that every result reports."""
        v, angle, speed = map(float, self.section)
        return orbits.OrbitState(self.value, v, angle, speed, self.seen.largest, self.multipliers)

    @property
    def figures(self) -> orbits.OrbitFigures:
        """All figures that are reported."""
        return orbits.OrbitFigures(**vars(self.state), stick_fraction=self.seen.stick_fraction, stable=self.stable,
                            events=self.events, residual=self.residual)


@result_class(repr=False)
class Bifurcation(Described):
    """A located bifurcation."""

    kind: str = reported(
        "fold, period_doubling, neimark_sacker, branch_point, grazing_sliding, crossing_sliding, switching_sliding, "
        "adding_sliding or stick_border")
    point: ContinuationPoint
    residual: float = reported("of its condition, scaled; at least that of the orbit")
    branch: int = reported("number of its branch", default=0)
    after: int = reported("number of the point before it", default=0)
    changes_stability: bool = reported("whether motions are stable on one side of it only", default=False)

    @property
    def value(self) -> float:
        """The parameter."""
        return self.point.value

    @reporting("the motion at it", spread=True)
    def state(self) -> orbits.OrbitState:
        return self.point.state

    @reporting("period of the motion", "periods of excitation")
    def period(self) -> int:
        return self.point.period


def doubling(m: NDArray[np.complex128]) -> float:
    """det(M + I)."""
    return float(math.prod((1.0 + m).tolist()).real)


def torus(m: NDArray[np.complex128]) -> float:
    """Product of lambda_i lambda_j - 1 over pairs: 0 for a complex pair on the unit circle and for a neutral saddle."""
    return math.prod((x * y - 1.0 for x, y in combinations(m.tolist(), 2)), start=1.0 + 0.0j).real


def _opposite(one: float, two: float, factors: Iterable[float]) -> bool:
    """Whether a test function, the product of `factors`, has changed its sign by more than rounding of one factor."""
    return one * two < 0.0 and max(abs(one), abs(two)) > orbits.NEUTRAL * math.prod(factors)


def _from_circle(point: ContinuationPoint) -> float:
    """Distance of the nearest complex pair from the unit circle; inf where there is none (a neutral saddle)."""
    pairs = [abs(abs(x) ** 2 - 1.0) for x in point.multipliers if abs(np.angle(x)) > COMPLEX_PAIR
             and abs(np.angle(x)) < np.pi - COMPLEX_PAIR]
    return float(min(pairs, default=np.inf))


TESTS: dict[str, tuple[Callable[[ContinuationPoint], float], Callable[[ContinuationPoint], float]]] = {
    "fold": (lambda s: s.slope, lambda s: float(np.abs(s.multipliers - 1.0).min())),
    "period_doubling": (lambda s: doubling(s.multipliers), lambda s: float(np.abs(s.multipliers + 1.0).min())),
    "neimark_sacker": (lambda s: torus(s.multipliers), _from_circle),
    "branch_point": (lambda s: s.sign, lambda s: float(
        np.linalg.svd(s.linearised.jacobian, compute_uv=False)[-1]))}
"""Kinds without a change of the event sequence, with the test function of each and its residual."""


def smooth_bifurcations(bracket: Bracket[ContinuationPoint]) -> list[Bifurcation]:
    """The bifurcations between two points of one smooth piece of a branch, in order along it."""
    a, b, out = bracket.a, bracket.b, []
    m, n = a.multipliers, b.multipliers
    sizes = [max(pair) for pair in zip(map(abs, m.tolist()), map(abs, n.tolist()))]
    crossed = {"fold": a.slope * b.slope < 0.0, "branch_point": a.sign != b.sign,
               "period_doubling": _opposite(doubling(m), doubling(n), (1.0 + x for x in sizes)),
               "neimark_sacker": _opposite(torus(m), torus(n), (1.0 + x * y for x, y in combinations(sizes, 2)))}
    for kind, (test, residual) in TESTS.items():
        if not crossed[kind]:
            continue
        point = branch_point(b) if kind == "branch_point" else bracket.locate(test, residual)
        if point is None or (kind == "neimark_sacker" and not np.isfinite(_from_circle(point))):
            continue
        left = max(residual(point), point.residual)
        if left < SPURIOUS:
            out.append(Bifurcation(kind, point, left))
    along = b.z - a.z
    return sorted(out, key=lambda f: float(along @ f.point.z))


def branch_point(near: ContinuationPoint) -> ContinuationPoint | None:
    """The point where two branches cross, G + beta b = 0 and two scalars, as the Jacobian has one rank less there; None
    where there is none.
    """
    shooting, z = near.equations, near.z
    try:
        vectors, _, right = np.linalg.svd(shooting.linearise(z).jacobian)
        b, c = vectors[:, -1], right[-2:]

        def linearise(u: Floats) -> Linearised:
            """The equations in the orbit's unknowns and beta; their derivatives by differences."""
            linearised, step = shooting.linearise(u[:-1]), DIFFERENCE
            v, w, g = bordered(linearised.jacobian, b, c)
            changes = [(shooting.linearise(u[:-1] + step * x).jacobian - linearised.jacobian) / step for x in v]
            rows = np.array([-w @ change for change in changes])
            jacobian = np.block([[linearised.jacobian, b[:, None]], [rows, np.zeros((2, 1))]])
            return linearised._replace(residual=np.append(linearised.residual + u[-1] * b, g), jacobian=jacobian)

        solved = solve_bordered(linearise, np.append(z, 0.0), shooting.size, BRANCH_POINT_REACH)
        if solved is None or abs(solved[0][-1]) > BRANCH_POINT_DEFECT:
            return None
        z = solved[0][:-1]
        return replace(near, z=z, linearised=shooting.linearise(z))
    except orbits.FAILURES:
        return None


def halve(bracket: Bracket[P], ends: list[P], parts: list[float], count: int) -> None:
    """Halve a bracket `count` times about the change of its event sequence; `parts` of the chord belong to `ends`."""
    for _ in range(count):
        middle = 0.5 * (parts[0] + parts[1])
        point = bracket.at(middle)
        if point is None:
            return
        # The corrector's observation is from before its last step.
        seen = point.equations.linearise(point.z).seen
        point = replace(point, linearised=point.linearised._replace(seen=seen))
        side = int(orbits.differ(point.events, bracket.a.events))
        ends[side], parts[side] = point, middle


def sliding_bifurcation(
        bracket: Bracket[ContinuationPoint]) -> tuple[ContinuationPoint, ContinuationPoint, Bifurcation | None]:
    """The points on both sides of a change of the event sequence, and the bifurcation there.

    None in place of the bifurcation where friction is not the cause (the pressure reaches 0), or no margin vanishes.
    """
    ends, parts = [bracket.a, bracket.b], [0.0, 1.0]
    best: tuple[ContinuationPoint, ContinuationPoint, Bifurcation] | None = None
    for count in BORDER_HALVINGS:
        if not count:
            ends = [bracket.a, bracket.b]
        halve(bracket, ends, parts, count)
        left, right = ends
        events = left.events, right.events
        if not orbits.differ(events[0].replace("F", ""), events[1].replace("F", "")):
            return left, right, None
        near = nearest_margins(left.equations, left.z), nearest_margins(right.equations, right.z)
        kind = orbits.kind_of_change(*events, near)
        border = _on_border(kind, left, right, near)
        if border is not None:
            return left, right, border
        # The margin may vanish on one side only, and the bracket need not be narrow.
        residual, at = min(((max(orbits.margin_residual(kind, (m,)), s.residual), s)
                            for s, m in zip((left, right), near)), key=lambda side: side[0])
        # In a bracket as narrow as rounding both ends may be on the side without the margin; then the next, wider
        # brackets are tried.
        if best is None or residual < best[2].residual:
            best = left, right, Bifurcation(kind, at, residual)
    assert best is not None
    # Slip that begins at phase 0 to rounding changes the sequence too, but no margin vanishes there.
    return best if best[2].residual < SPURIOUS else (best[0], best[1], None)


def _on_border(kind: str, left: ContinuationPoint, right: ContinuationPoint,
               near: tuple[Margins, Margins]) -> Bifurcation | None:
    """The border between two points by Newton's method on its margin; None where that fails."""
    name = orbits.MARGINS[kind]
    sides = [(s, m[name]) for s, m in zip((left, right), near) if name in m]
    if not sides:
        return None
    # The margin that is to vanish belongs to the side without the event that it would make.
    start, _ = min(sides, key=lambda side: (len(orbits.ring(side[0].events)), abs(side[1].value)))
    shooting, size = start.equations, start.equations.size
    apart = max(float(np.linalg.norm(right.z - left.z)), 1e-9)
    events, stays = list[str](), 0.0 if name == "arrival" else BORDER_LEFT

    def linearise(z: Floats) -> Linearised:
        """The orbit's equations and the margin, regular up to the border from the side on which the margin is defined;
        ArithmeticError beyond it.
        """
        linearised = shooting.linearise(z)
        if stays:
            events.append(linearised.seen.events)
            if orbits.differ(events[0], events[-1]):
                raise ArithmeticError("the event sequence has changed")
        margin = nearest_margins(shooting, z).get(name)
        if margin is None:
            raise ArithmeticError("the motion has no such margin")
        return linearised._replace(residual=np.append(linearised.residual, margin.value),
                                   jacobian=np.vstack([linearised.jacobian, margin.slopes]))

    solved = solve_bordered(linearise, start.z, size, BORDER_ASTRAY * apart, BORDER_FINEST, stays)
    if solved is None:
        return None
    z, linearised, error = solved
    linearised = linearised._replace(residual=linearised.residual[:size], jacobian=linearised.jacobian[:size])
    point = replace(start, z=z, linearised=linearised, tangent=tangent_of(linearised, start.tangent))
    return Bifurcation(kind, point, max(error, point.residual))


def special_points_between(a: ContinuationPoint, b: ContinuationPoint,
                           by_amplitude: bool = True) -> list[Bifurcation] | None:
    """The bifurcations between two neighbouring points, in order; None where the step has skipped a piece."""
    bracket = Bracket(a, b, by_amplitude)
    if not (a.equations.map.piecewise and orbits.differ(a.events, b.events)):
        return smooth_bifurcations(bracket)
    out: list[Bifurcation] = []
    for _ in range(MOST_BORDERS):
        left, right, points = sliding_bifurcation(bracket)
        if float(np.linalg.norm(right.z - left.z)) > orbits.SAME:
            return None
        out += smooth_bifurcations(Bracket(bracket.a, left, by_amplitude))
        if points is not None:
            out.append(points)
        bracket = Bracket(right, b, by_amplitude)
        if not orbits.differ(right.events, b.events):
            break
    return out + smooth_bifurcations(bracket)


def period_doubling_end(here: ContinuationPoint, new: ContinuationPoint) -> ContinuationPoint | None:
    """The point between two at which the period of the orbit becomes shorter; None where it does not."""
    # The distance between the halves of the orbit changes its sign there. The branch is singular, so the doubling of
    # the shorter motion is solved instead.
    shooting = here.equations
    of, period = shooting.map, shooting.period
    for shorter in range(of.forcing_period, period, of.forcing_period):
        if period % shorter:
            continue
        one, two = ((of.evaluate(p.section, p.values, 0, shorter).value - p.section) / of.scales
                    for p in (here, new))
        if turned_round(one, two):
            simple = Shooting.single(of, shorter, *shooting.ranges, settings=shooting.settings)
            near = simple.unknowns((here.section + 0.5 * one * of.scales)[None], here.values)
            whole = Shooting.single(of, period, *shooting.ranges, settings=shooting.settings)
            try:
                system = MinimallyAugmented("period_doubling", simple, near)
                solved = solve_bordered(system.linearise, near, simple.size, np.inf)
                if solved is None or not np.abs(solved[0] - near).max() < HALVES_REACH:
                    return here
                linearised = whole.linearise(solved[0])
            except orbits.FAILURES:
                return here
            if float(np.abs(linearised.residual).max()) > shooting.settings.residual:
                return here
            return ContinuationPoint(whole, solved[0], linearised, shooting.outer(here.tangent))
    return None
