"""Plans, results and stable segments of motions made by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import ANY

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System
from tcc_sim.shown_units import shown_in
from tcc_sim.study.cli.continue_ import _lines
from tcc_sim.study.continuation.branch import Branch, BranchOrigin, orbits_at
from tcc_sim.study.continuation.codim2_points import Special
from tcc_sim.study.continuation.diagram import (
    BranchPiece,
    SettledMotion,
    amplitude_of,
    left_out,
    pieces_at,
    place_of,
)
from tcc_sim.study.continuation.driveline import Seed
from tcc_sim.study.continuation.follow import End, StopReason
from tcc_sim.study.continuation.loss_of_stability import Jump, SegmentEnd, StableSegment, _beyond, _end, _runs, _walk
from tcc_sim.study.continuation.motions import ContinuationPlan, Motions
from tcc_sim.study.continuation.newton import Orbit
from tcc_sim.study.continuation.problem import Observation
from tcc_sim.study.continuation.settings import Settings
from tcc_sim.study.continuation.special_points import Bifurcation

MU_K = "friction.kinetic_coefficient"


def point(value: float, largest: float, stable: bool = True, events: str = "+S") -> Any:
    """A point of a branch; its multipliers are m, 0.25 and 0."""
    orbit = Orbit(2, (value,), np.array([[1.0, 0.1, 5.0]]), np.array([0.5 if stable else -1.5, 0.25, 0.0], complex),
                  Observation(largest, 0.25, events), 1e-12)
    return SimpleNamespace(value=value, orbit=orbit, shooting=SimpleNamespace(settings=Settings()))


def branch(*points: Any, period: int = 2, bifurcations: Any = (), ended: Any = (StopReason.RANGE,) * 2,
           origin: BranchOrigin | None = None) -> Branch:
    first, last = (End(reason, MU_K, p.value) for reason, p in zip(ended, (points[0], points[-1])))
    return Branch(period, origin or BranchOrigin(), list(points), (first, last), False, list(bifurcations))


def fold(value: float, largest: float, after: int, kind: str = "fold", number: int = 0) -> Bifurcation:
    return Bifurcation(kind, point(value, largest), 1e-10, number, after, True)


ONE = branch(point(0.2, 30.0), point(0.25, 20.0), point(0.3, 10.0, False), bifurcations=[fold(0.28, 15.0, 1)])
TWO = branch(point(0.3, 4.0, events=""), period=1, ended=(StopReason.BEGAN, StopReason.POINTS),
             origin=BranchOrigin("period_doubling", 0.28, 0))


def motions(**plan: Any) -> Motions:
    return Motions(ContinuationPlan(MU_K, 0.2, 0.3, **plan), System(), [ONE, TWO])


def test_the_figures_of_motions() -> None:
    found = motions(at=(0.25,))
    document = found.as_json()
    assert {key: document[key] for key in ("over", "range", "law", "at", "complete")} == {
        "over": MU_K, "range": [0.2, 0.3], "law": "smoothed", "at": [], "complete": False}
    assert not {"curves", "second_over"} & set(document)
    one, two = document["branches"]
    m, u = [[0.5, 0.0], [0.25, 0.0], [0.0, 0.0]], [[-1.5, 0.0], [0.25, 0.0], [0.0, 0.0]]
    assert one == {
        "period": 2, "closed": False, "origin": "start", "value": [0.2, 0.25, 0.3], "slip_speed": [1.0] * 3,
        "plate_angle": [0.1] * 3, "plate_speed": [5.0] * 3, "max_slip_speed": [30.0, 20.0, 10.0],
        "multipliers": [m, m, u], "stick_fraction": [0.25] * 3, "stable": [True, True, False], "events": ["+S"] * 3,
        "residual": [1e-12] * 3, "reasons": ["range", "range"],
        "ended": [f"{MU_K} reached 0.2, the end of the range", f"{MU_K} reached 0.3, the end of the range"]}
    assert two["origin"] == {"kind": "period_doubling", "value": 0.28, "branch": 0}
    assert two["reasons"] == ["began", "points"]
    (item,) = document["bifurcations"]
    assert item == {"kind": "fold", "residual": 1e-10, "branch": 0, "after": 1, "changes_stability": True,
                    "value": 0.28, "slip_speed": 1.0, "plate_angle": 0.1, "plate_speed": 5.0, "max_slip_speed": 15.0,
                    "multipliers": m, "period": 2}
    assert repr(found) == f"<Motions over {MU_K} from 0.2 to 0.3, smoothed: 2 branches, 1 fold>"
    bare = Motions(found.plan, System(), [TWO])
    assert repr(bare) == f"<Motions over {MU_K} from 0.2 to 0.3, smoothed: 1 branch, no bifurcation>"
    assert found.columns() == {"branch": [0, 0, 0, 1], "period": [2, 2, 2, 1], MU_K: [0.2, 0.25, 0.3, 0.3],
                               "max_slip_speed": [30.0, 20.0, 10.0, 4.0], "stable": [True, True, False, True]}
    second = motions(second=("pressure.mean", 1e5, 2e5)).as_json()
    assert (second["second_over"], second["curves"]) == ("pressure.mean", [])


def test_the_lines_of_the_verb() -> None:
    found = motions(second=("engine.frequency", 120.0, 160.0))
    found.at = [{"value": 0.25, "branch": 0, "period": 2, "max_slip_speed": 20.0, "stable": False, "events": "+S"},
                {"value": 0.3, "branch": 1, "period": 1, "max_slip_speed": 4.0, "stable": True, "events": ""}]
    curve: Any = SimpleNamespace(kind="fold", values=(0.1,), ended=(End(StopReason.RANGE, MU_K, 0.1),) * 2,
                                 special=(Special("cusp", 0.25, 140.5, 0.002, 0.4, point=ANY),))
    found.curves = [curve]
    assert list(_lines(found)) == [
        f"branch 0: period 2, {MU_K} 0.2 to 0.3, 3 points, 2 stable", f"  {MU_K} reached 0.2, the end of the range",
        f"  {MU_K} reached 0.3, the end of the range", f"branch 1: period 1, {MU_K} 0.3 to 0.3, 1 point, 1 stable",
        f"  began in the period doubling at {MU_K} = 0.3", f"  stopped after 0 points at {MU_K} = 0.3",
        f"              fold  {MU_K} 0.28  branch 0  max slip 15 rad/s  residual 1.0e-10",
        f"at {MU_K} 0.25: branch 0, period 2, max slip 20 rad/s, unstable, +S",
        f"at {MU_K} 0.3: branch 1, period 1, max slip 4 rad/s, stable, ",
        f"curve of fold: 1 point; {MU_K} reached 0.1, the end of the range",
        f"                  cusp  {MU_K} 0.2500 +- 0.002  engine.frequency 140.50 +- 0.4 rad/s"]
    with shown_in("rpm", 2.0):
        *_, ended, special = _lines(replace(found, curves=[SimpleNamespace(
            **{**vars(curve), "ended": (End(StopReason.RANGE, "engine.frequency", 120.0 * math.pi),)})]))
    assert (ended, special.split("  ")[-1]) == (
        "curve of fold: 1 point; engine.frequency reached 1800 rpm, the end of the range",
        "engine.frequency 670.8 +- 2 rpm")


@pytest.mark.parametrize(("how", "words"), [
    ({"period": 0}, "--period is 0; it must be 1 to 16 periods of excitation"),
    ({"period": 17}, "--period is 17; it must be 1 to 16 periods of excitation"),
    ({"switch": -1}, "--switch is -1; it must be 0 to 8"), ({"switch": 9}, "--switch is 9; it must be 0 to 8"),
    ({"at": (0.2, 0.19)}, "--at is 0.19; it must be within the range of --over, 0.2 to 0.3"),
    ({"at": (0.31,)}, "--at is 0.31; it must be within the range of --over, 0.2 to 0.3"),
    ({"seeds": (Seed(0.19, (0.0, 0.0, 0.0), 1),)},
     f"a seed is at {MU_K} = 0.19; it must be within the range of --over, 0.2 to 0.3"),
    ({"second": (MU_K, 1.0, 2.0)}, f"--second is {MU_K}, the key of --over; it must be another one"),
    ({"second": ("pressure.mean", 2.0, 2.0)}, "--second has a range from 2 to 2; the two must differ")])
def test_a_plan_beyond_its_bounds_is_refused(how: Any, words: str) -> None:
    with pytest.raises(InputError) as error:
        ContinuationPlan(MU_K, 0.2, 0.3, **how)
    assert str(error.value) == words
    ends = tuple(Seed(value, (0.0, 0.0, 0.0), 1) for value in (0.2, 0.3))
    for allowed in ({"period": 1, "switch": 0, "at": (0.2, 0.3)}, {"period": 16, "switch": 8, "seeds": ends}):
        ContinuationPlan(MU_K, 0.2, 0.3, **allowed)  # type: ignore[arg-type]


def seen(value: float, amplitude: float, period: int = 2) -> SettledMotion:
    return SettledMotion(value, np.zeros(3), 0, period, amplitude)


def test_the_pieces_of_a_branch_across_a_value() -> None:
    """A fold beyond the points extends the branch; on a point both of its pieces are there."""
    bent = branch(point(0.2, 10.0), point(0.3, 20.0), point(0.3, 22.0), point(0.2, 30.0),
                  bifurcations=[fold(0.32, 21.0, 1), fold(0.25, 25.0, 2, "period_doubling")])

    def across(value: float) -> list[tuple[int, float, float, float]]:
        return [(p.after, p.a.value, p.b.value, pytest.approx(p.part)) for p in pieces_at(bent, value)]

    assert across(0.25) == [(0, 0.2, 0.3, 0.5), (2, 0.3, 0.2, 0.5)]
    assert across(0.31) == [(1, 0.3, 0.32, 0.5), (1, 0.32, 0.3, 0.5)]
    assert [p[0] for p in across(0.3)] == [0, 1, 1, 2]
    assert (across(0.33), across(0.19)) == ([], [])
    flat = branch(point(0.2, 10.0), point(0.2, 20.0))
    assert [(p.after, p.part) for p in pieces_at(flat, 0.2)] == [(0, 0.5)]
    piece = BranchPiece(0, point(0.2, 10.0), point(0.3, 20.0), 0.5)
    # A hundredth of the largest size, 100, and three tenths of the rise of 10.
    assert [piece.holds(seen(0.25, 15.0 + away), 100.0) for away in (0.0, -3.9, 3.9, 4.1)] == [
        0.0, pytest.approx(3.9), pytest.approx(3.9), math.inf]


def test_a_motion_lies_on_the_nearest_stable_piece_with_its_period() -> None:
    lower, upper = branch(point(0.2, 10.0), point(0.3, 10.0)), branch(point(0.2, 10.5), point(0.3, 10.5))
    unstable = branch(point(0.2, 10.3, False), point(0.3, 10.3, False))
    half = branch(point(0.2, 10.3), point(0.3, 10.3, False))
    assert place_of(seen(0.25, 10.2), [lower, upper, unstable], 100.0) == (0, 0)
    assert place_of(seen(0.25, 10.3), [lower, upper, unstable], 100.0) == (1, 0)
    assert place_of(seen(0.25, 10.3), [lower, half], 100.0) == (1, 0)
    assert place_of(seen(0.25, 10.3), [unstable], 100.0) is None
    assert place_of(seen(0.25, 10.3, 1), [lower], 100.0) is None
    assert place_of(seen(0.25, 10.3, 1), [lower], 100.0, base=2) == (0, 0)
    assert place_of(seen(0.25, 10.3, 0), [lower], 100.0, base=2) is None


def test_the_size_of_a_sweep_is_that_of_its_periodic_motions_unless_they_are_next_to_nothing() -> None:
    assert amplitude_of([]) == 0.0
    assert amplitude_of([seen(0.2, 5.0), seen(0.3, 7.0), seen(0.3, 90.0, 0)]) == 7.0
    assert amplitude_of([seen(0.2, 0.09), seen(0.3, 90.0, 0)]) == 90.0
    assert amplitude_of([seen(0.2, 0.091), seen(0.3, 90.0, 0)]) == 0.091


def test_the_sentences_of_what_a_diagram_leaves_out() -> None:
    motions_seen = [seen(0.25, 20.0), seen(0.25, 99.0), seen(0.25, 20.0, 13), seen(0.25, 20.0, 25), seen(0.2, 1.0, 0)]
    going = branch(point(0.2, 30.0), point(0.3, 10.0), ended=(StopReason.RANGE, StopReason.POINTS))
    assert left_out(motions_seen, [ONE, going]) == [
        "1 of 5 motions lie on no branch: none was found there",
        "2 of 5 motions have a period above 12 and lie on no branch",
        "1 of 2 branches go on: 200 points are followed either way"]
    assert left_out(motions_seen, [ONE] * 24, base=2) == [
        "2 of 5 motions lie on no branch: 24 branches are followed",
        "1 of 5 motions have a period above 24 and lie on no branch"]
    assert left_out(motions_seen[:1], [ONE]) == []


def test_stable_points_in_a_row_without_a_turn() -> None:
    def runs(*rows: tuple[float, bool]) -> list[tuple[int, int]]:
        return _runs([point(value, 1.0, stable) for value, stable in rows])

    assert runs() == []
    assert runs((0.2, True)) == [(0, 0)]
    assert runs((0.2, True), (0.3, True), (0.4, False), (0.5, True), (0.6, True)) == [(0, 1), (3, 4)]
    assert runs((0.2, True), (0.3, True), (0.25, True), (0.2, True)) == [(0, 1), (2, 3)]
    assert runs((0.3, True), (0.2, True), (0.2, True), (0.25, True), (0.3, True)) == [(0, 2), (3, 4)]
    assert runs((0.2, False), (0.3, True)) == [(1, 1)]


@pytest.mark.parametrize(("reasons", "doubling", "at", "unstable", "end"), [
    (("BEGAN", "RANGE"), 0.2, (0, -1), (), (0.2, "period_doubling")),
    (("BEGAN", "RANGE"), 0.2 + 0.9e-6, (0, -1), (), (0.2 + 0.9e-6, "period_doubling")),
    (("BEGAN", "RANGE"), 0.2 + 1.1e-6, (0, -1), (), (0.2, None)), (("POINTS", "RANGE"), 0.2, (0, -1), (), (0.2, None)),
    (("RANGE", "DOUBLING"), 0.3, (3, 1), (), (0.3, "period_doubling")),
    (("RANGE", "BEGAN"), 0.2, (3, 1), (), (0.3, None)),
    (("RANGE", "DOUBLING"), 0.3, (2, 1), (3,), (0.3, "period_doubling")), (("BEGAN", "RANGE"), 0.2, (1, -1), (0,), (
        0.2, "period_doubling")), (("BEGAN", "DOUBLING"), 0.3, (1, 1), (2,), (0.24, None)),
    (("RANGE", "RANGE"), 0.3, (1, 1), (2,), (0.24, None))])
def test_the_end_of_a_segment_is_the_doubling_that_its_branch_began_or_ends_in(
        reasons: tuple[str, str], doubling: float, at: tuple[int, int], unstable: tuple[int, ...], end: Any) -> None:
    """Values are over 2; the doubling on the simple motion is within 1e-5 of the range."""
    double = branch(*(point(value, 10.0, k not in unstable) for k, value in enumerate((0.2, 0.24, 0.26, 0.3))),
                    ended=[StopReason[reason] for reason in reasons])
    simple = branch(point(0.2, 1.0), period=1, bifurcations=[fold(doubling, 10.0, 0, "period_doubling")])
    found = _end([double, simple], double, *at, (0.2, 0.3), 2.0)
    assert found == SegmentEnd(pytest.approx(0.5 * end[0], rel=1e-12), end[1], 1e-10 if end[1] else None)


def test_a_segment_ends_in_a_fold_nearby_or_in_the_bifurcation_that_changes_its_stability() -> None:
    """Nearby is within a twentieth of range and largest size; a fold jumps."""
    def end(value: float, largest: float, after: int, changes: bool = True) -> SegmentEnd:
        bent = branch(point(0.2, 10.0), point(0.25, 10.0), point(0.27, 10.0, False), bifurcations=[
            replace(fold(value, largest, after), changes_stability=changes)], ended=(StopReason.POINTS,) * 2)
        return _end([bent], bent, 1, 1, (0.2, 0.3), 1.0)

    assert end(0.26, 10.0, 1) == SegmentEnd(0.26, "fold", 1e-10, True)
    assert end(0.29, 10.0, 1) == SegmentEnd(0.29, "fold", 1e-10, True)
    assert end(0.2749, 10.0, 1, False) == end(0.2749, 10.0, 0) == SegmentEnd(0.2749, "fold", 1e-10, True)
    assert end(0.27, 10.49, 0).kind == end(0.1951, 10.0, 0).kind == "fold"
    for far in (end(0.2751, 10.0, 0), end(0.27, 10.51, 0), end(0.1949, 10.0, 0), end(0.2749, 10.02, 0)):
        assert far == SegmentEnd(0.25)


@pytest.mark.parametrize(("after", "goal", "result"), [
    (0, 0.25, (0, True)), (0, 0.3, (0, True)), (0, 0.35, (1, True)), (0, 0.45, (2, True)), (0, 0.5, (2, True)),
    (0, 0.55, (3, False)), (2, 0.25, (0, True)), (2, 0.15, (0, False)), (1, 0.2, (0, True)), (3, 0.45, (3, False)),
    (3, 0.6, (3, False))])
def test_the_way_along_a_branch_to_a_value(after: int, goal: float, result: tuple[int, bool]) -> None:
    """Up to 0.5 and back to an unstable point at 0.4."""
    way = branch(*(point(value, 1.0) for value in (0.2, 0.3, 0.4, 0.5)), point(0.4, 1.0, False))
    assert _walk(way, after, goal) == result


def test_segments_and_jumps_in_words_and_numbers() -> None:
    segment = StableSegment(1, SegmentEnd(0.25), SegmentEnd(0.5, "period_doubling", 2.4e-9), (0.25, 0.5), (2.0, 4.0))
    assert [segment.amplitude(x) for x in (0.25, 0.375, 0.5)] == [2.0, 3.0, 4.0]
    assert [math.isnan(segment.amplitude(x)) for x in (0.2499, 0.5001)] == [True, True]
    assert str(segment.high) == "0.5 (period doubling, residual 2e-09)"
    assert Jump(0.25, 0.5, 1.0, 2.0, "steep").value == 0.375
    assert Jump(0.25, 0.5, 1.0, 2.0, "fold", fold(0.3, 1.0, 0)).value == 0.3
    assert [_beyond(x, [2.0, 1.0, 4.0]) for x in (0.5, 1.0, 3.0, 4.0, 4.5)] == [0.5, 0.0, 0.0, 0.0, 0.5]


def test_orbits_at_the_values_of_points() -> None:
    """Each once, the last one too unless the branch is closed, where it is the first."""
    points = [point(0.2, 1.0), point(0.3, 2.0), point(0.2, 3.0)]
    open_, closed = branch(*points), branch(*points[:2], points[0])
    closed.closed = True
    assert [orbit.seen.largest for orbit in orbits_at(open_, 0.2)] == [1.0, 3.0]
    assert [orbit.seen.largest for orbit in orbits_at(closed, 0.2)] == [1.0]
    assert [orbit.seen.largest for orbit in orbits_at(open_, 0.3)] == [2.0]
    assert orbits_at(open_, 0.4) == []
