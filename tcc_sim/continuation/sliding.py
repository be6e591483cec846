"""Where the event sequence of a motion changes along a branch: the bifurcations that only set-valued friction has.

M. di Bernardo, P. Kowalczyk, A. Nordmark, Bifurcations of dynamical systems with sliding, Physica D 170 (2002):
grazing-, crossing-, switching- and adding-sliding. A sequence is compared as a ring, so an event that passes phase 0 is
none.

A change is bracketed by the sequences, then solved for by the margin that vanishes. The orbit's equations with the
margin as one more are regular up to the border from the side on which the margin is defined, so Newton's method on them
finds it; it goes nine tenths of the way at a time, so as not to leave that side.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tcc_sim.continuation.bracket import Bracket
from tcc_sim.continuation.palc import solution_at, tangent_of
from tcc_sim.continuation.problem import FAILURES, Floats, Margins
from tcc_sim.continuation.settings import DEFAULTS
from tcc_sim.continuation.shooting import Linearised, Shooting
from tcc_sim.continuation.special_points import Bifurcation, ContinuationPoint, point_at


def ring(events: str) -> str:
    """The sequence of a periodic motion without its start: its first and last mode joined, in the least rotation."""
    if len(events) > 1 and events[0] == events[-1]:
        events = events[:-1]
    return min(events[k:] + events[:k] for k in range(len(events))) if events else events


RULES: dict[str, tuple[tuple[str, str], ...]] = {
    "adding_sliding": (("S+S", "S"), ("S-S", "S")),
    "grazing_sliding": (("+S+", "+"), ("-S-", "-"), ("+-+", "+"), ("-+-", "-")),
    "crossing_sliding": (("+S-", "+-"), ("-S+", "-+")),
    "switching_sliding": (("+-S", "+S"), ("-+S", "-S")),
}
"""Per kind, which part of the longer sequence becomes which of the shorter one."""


def _reduced(longer: str, rules: tuple[tuple[str, str], ...], shorter: str) -> bool:
    """Whether replacing parts of the ring `longer`, once or more, gives the ring `shorter`."""
    found = {longer}
    for _ in range(DEFAULTS.repeats):
        found = {new for text in found for pattern, by in rules for new in _replaced(text, pattern, by)}
        if shorter in found:
            return True
    return False


def _replaced(text: str, pattern: str, by: str) -> set[str]:
    """The rings that come of replacing `pattern` by `by` at each of its places on the ring `text`."""
    out = set()
    for k in range(len(text)):
        turned = text[k:] + text[:k]
        if turned.startswith(pattern):
            out.add(ring(by + turned[len(pattern):]))
        elif len(turned) == len(pattern) - 1 and turned + turned[0] == pattern:
            out.add(by[0])
    return out


def kind_of_change(before: str, after: str, near: tuple[Margins, Margins]) -> str:
    """The kind of bifurcation between two event sequences; `near` are the margins on both sides of it.

    Where the sequences can differ for several reasons, the smallest margin decides.
    """
    one, two = ring(before), ring(after)
    longer, shorter = (one, two) if len(one) >= len(two) else (two, one)
    if shorter == "S":
        return "stick_border"
    kinds = [kind for kind, rules in RULES.items() if _reduced(longer, rules, shorter)]
    if kinds:
        # Both an interval of slip and one of stick that vanish make S+S of S+S+S.
        return min(kinds, key=lambda kind: margin_residual(kind, near))
    grazing, arrival = min(m.grazing for m in near), min(abs(m.arrival) for m in near)
    stick = min(abs(m.stick) for m in near)
    if stick <= min(grazing, arrival):
        return "adding_sliding"
    if grazing <= arrival:
        return "grazing_sliding"
    least = min(near, key=lambda m: abs(m.arrival))
    return "switching_sliding" if least.arrival_grows else "crossing_sliding"


def margin_of(kind: str) -> str:
    """The name of the margin that vanishes at a bifurcation of this kind."""
    return {"grazing_sliding": "grazing", "adding_sliding": "stick", "stick_border": "stick"}.get(kind, "arrival")


def margin_residual(kind: str, near: tuple[Margins, ...]) -> float:
    """The margin that vanishes at a bifurcation of this kind, relative to its natural size; the smaller of `near`."""
    return min(abs(float(getattr(m, margin_of(kind)))) for m in near)


def differ(one: str, two: str) -> bool:
    """Whether two event sequences are those of different motions; free intervals are no events of friction."""
    return ring(one) != ring(two)


def sliding_bifurcation(
        bracket: Bracket[ContinuationPoint]) -> tuple[ContinuationPoint, ContinuationPoint, Bifurcation | None]:
    """The points on both sides of a change of the event sequence, and the bifurcation there.

    None where the change is none of friction (the pressure meeting 0), or where no margin vanishes.
    """
    low, high = 0.0, 1.0
    left, right, settings = bracket.a, bracket.b, bracket.a.shooting.settings
    best: tuple[ContinuationPoint, ContinuationPoint, Bifurcation] | None = None
    for count in settings.border_halvings:
        if not count:
            left, right = bracket.a, bracket.b
        for _ in range(count):
            middle = 0.5 * (low + high)
            point = bracket.at(middle)
            if point is None:
                break
            point = observed(point)
            if differ(point.orbit.seen.events, bracket.a.orbit.seen.events):
                high, right = middle, point
            else:
                low, left = middle, point
        events = left.orbit.seen.events, right.orbit.seen.events
        if differ(events[0].replace("F", ""), events[1].replace("F", "")) is False:
            return left, right, None
        near = nearest_margins(left.shooting, left.solution.z), nearest_margins(right.shooting, right.solution.z)
        kind = kind_of_change(*events, (near[0].margins, near[1].margins))
        found = solved(kind, left, right, near)
        if found is not None:
            return left, right, found
        # The margin may vanish on one side alone, and the bracket need not be narrow.
        residual, at = min(((max(margin_residual(kind, (m.margins,)), s.orbit.residual), s)
                            for s, m in zip((left, right), near)), key=lambda side: side[0])
        # Where the bracket is as narrow as rounding, both of its ends may be on one side, without the margin that
        # vanishes; those of the chord are looked at too then.
        if best is None or residual < best[2].residual:
            best = left, right, Bifurcation(kind, at, residual)
    assert best is not None
    # Slip that begins at phase 0 itself, to rounding, changes the sequence too, and nothing vanishes there.
    return best if best[2].residual < settings.spurious else (best[0], best[1], None)


def observed(point: ContinuationPoint) -> ContinuationPoint:
    """The point with what is seen at its very point; a corrector knows it only from before its last step."""
    seen = point.shooting.linearise(point.solution.z).seen
    return point if seen is None else replace(point, orbit=replace(point.orbit, seen=seen))


class Nearest(NamedTuple):
    """The margins of a periodic motion, and their derivatives by the scaled unknowns, by name, where they are known."""

    margins: Margins
    gradients: dict[str, Floats]


def nearest_margins(shooting: Shooting, z: Floats) -> Nearest:
    """The margins over all segments."""
    nodes, values, n, size = shooting.nodes(z), shooting.values(z), shooting.map.dimension, shooting.size
    widths = np.array([w.width(float(u)) for w, u in zip(shooting.ranges, z[size:])])
    least = dict.fromkeys(("grazing", "arrival", "stick"), np.inf)
    gradients: dict[str, Floats] = {}
    grows, first = False, 0.0
    for k, length in enumerate(shooting.segments):
        found = shooting.map.margins(nodes[k], values, first, length)
        first += length
        for name in least:
            value = float(getattr(found, name))
            if not abs(value) < abs(least[name]):
                continue
            least[name] = value
            grows = found.arrival_grows if name == "arrival" else grows
            if name in found.slopes:
                gradients[name] = np.zeros(len(z))
                gradients[name][k * n:k * n + n] = found.slopes[name][0] * shooting.map.scales
                gradients[name][size:] = found.slopes[name][1] * widths
    return Nearest(Margins(least["grazing"], least["arrival"], grows, least["stick"]), gradients)


def solved(kind: str, left: ContinuationPoint, right: ContinuationPoint,
           near: tuple[Nearest, Nearest]) -> Bifurcation | None:
    """The border between two points by Newton's method on its own margin; None where that does not get through."""
    name = margin_of(kind)
    sides = [(s, m) for s, m in zip((left, right), near) if name in m.gradients]
    if not sides:
        return None
    # The margin that is to vanish belongs to the side without the event that it would make.
    start, at = min(sides, key=lambda side: (len(ring(side[0].orbit.seen.events)), abs(getattr(side[1].margins, name))))
    shooting, z, settings = start.shooting, start.solution.z, start.shooting.settings
    apart = max(float(np.linalg.norm(right.solution.z - left.solution.z)), 1e-9)
    one_sided = name != "arrival"
    try:
        found = shooting.linearise(z)
        for _ in range(settings.border_iterations):
            value = float(getattr(at.margins, name))
            if abs(value) <= settings.border and float(np.abs(found.residual).max()) <= settings.border_residual:
                return located(kind, start, z, found, abs(value))
            keep = settings.border_left if one_sided and abs(value) > settings.border else 0.0
            step = np.linalg.solve(np.vstack([found.jacobian, at.gradients[name]]),
                                   np.append(-found.residual, (keep - 1.0) * value))
            distance = float(np.linalg.norm(step))
            if distance <= settings.border_finest and abs(value) > settings.border:
                return located(kind, start, z, found, distance)
            for part in settings.newton_parts:
                trial = z + part * step
                found = shooting.linearise(trial)
                if one_sided and found.seen is not None and differ(found.seen.events, start.orbit.seen.events):
                    continue
                at = nearest_margins(shooting, trial)
                if name in at.gradients and abs(getattr(at.margins, name)) <= 2.0 * abs(value) + settings.border:
                    z = trial
                    break
            else:
                return None
            if float(np.linalg.norm(z - start.solution.z)) > settings.border_astray * apart:
                return None
    except FAILURES:
        return None
    return None


def located(kind: str, near: ContinuationPoint, z: Floats, found: Linearised, margin: float) -> Bifurcation:
    """The bifurcation at a solution."""
    point = point_at(near.shooting, solution_at(z, found, tangent_of(found, near.solution.tangent)))
    return Bifurcation(kind, point, max(margin, point.orbit.residual))
