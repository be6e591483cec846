"""Changes of the event sequence of a motion: the bifurcations that only set-valued friction has.

M. di Bernardo, P. Kowalczyk, A. Nordmark, Bifurcations of dynamical systems with sliding, Physica D 170 (2002):
grazing-, crossing-, switching- and adding-sliding. Sequences are compared as rings: an event that passes phase 0
changes nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from tcc_sim.continuation.problem import Margins
from tcc_sim.continuation.settings import DEFAULTS


def ring(events: str) -> str:
    """The event sequence of a periodic motion as a ring: first and last mode joined, in the least rotation."""
    if len(events) > 1 and events[0] == events[-1]:
        events = events[:-1]
    return min(events[k:] + events[:k] for k in range(len(events))) if events else events


RULES: dict[str, tuple[tuple[str, str], ...]] = {
    "adding_sliding": (("S+S", "S"), ("S-S", "S")),
    "grazing_sliding": (("+S+", "+"), ("-S-", "-"), ("+-+", "+"), ("-+-", "-")),
    "crossing_sliding": (("+S-", "+-"), ("-S+", "-+")),
    "switching_sliding": (("+-S", "+S"), ("-+S", "-S")),
}
"""By kind, parts of the longer sequence with the parts of the shorter one that replace them."""


def _reduced(longer: str, rules: tuple[tuple[str, str], ...], shorter: str) -> bool:
    """Whether replacing parts of the ring `longer`, once or more, gives the ring `shorter`."""
    found = {longer}
    for _ in range(DEFAULTS.repeats):
        found = {new for text in found for pattern, by in rules for new in _replaced(text, pattern, by)}
        if shorter in found:
            return True
    return False


def _replaced(text: str, pattern: str, by: str) -> set[str]:
    """The rings in which `by` replaces `pattern` at one of its places on the ring `text`."""
    out = set()
    for k in range(len(text)):
        turned = text[k:] + text[:k]
        if turned.startswith(pattern):
            out.add(ring(by + turned[len(pattern):]))
        elif len(turned) == len(pattern) - 1 and turned + turned[0] == pattern:
            out.add(by[0])
    return out


MARGINS = {"adding_sliding": "stick", "grazing_sliding": "grazing", "crossing_sliding": "arrival",
           "switching_sliding": "arrival", "stick_border": "stick"}
"""By kind, the margin that vanishes."""


def kind_of_change(before: str, after: str, near: Sequence[Margins]) -> str:
    """The kind of bifurcation between two event sequences with margins `near` it; the smallest decides between several.
    """
    longer, shorter = sorted((ring(before), ring(after)), key=len, reverse=True)
    if shorter == "S":
        return "stick_border"
    # Both an interval of slip and one of stick that vanish make S+S of S+S+S.
    kinds = [kind for kind, rules in RULES.items() if _reduced(longer, rules, shorter)]
    kind = min(kinds or list(RULES)[:3], key=lambda kind: margin_residual(kind, near))
    if kinds or kind != "crossing_sliding":
        return kind
    arrival = min((m["arrival"] for m in near if "arrival" in m), key=lambda m: abs(m.value))
    return "switching_sliding" if arrival.grows else kind


def margin_residual(kind: str, near: Sequence[Margins]) -> float:
    """The least size of the margin that vanishes at a bifurcation of this kind, relative to its natural size."""
    return min((abs(m[MARGINS[kind]].value) for m in near if MARGINS[kind] in m), default=math.inf)


def differ(one: str, two: str) -> bool:
    """Whether two event sequences differ as rings."""
    return ring(one) != ring(two)
