"""Stable stretches of textbook branches: where each begins and ends, and whether it jumps there."""

import math

import numpy as np
import pytest
from test_diagram import FOLD, Lifted, hysteresis, lifted, period, subcritical, surveyed, swept
from textbook_maps import logistic

from tcc_sim.continuation.diagram import SettledMotion, bifurcation_diagram
from tcc_sim.continuation.loss_of_stability import SegmentEnd, StableSegment, segment_of, stable_segments
from tcc_sim.continuation.shooting import ParameterRange


def test_both_stretches_of_a_hysteresis_end_in_its_folds() -> None:
    seen = lifted(np.linspace(-1.0, 1.0, 21), -1.3, hand_over=True)
    found = stable_segments(bifurcation_diagram(Lifted(hysteresis, 1), ParameterRange(-1.0, 1.0, name="p"), seen), -1.0,
                            1.0, 2.0)
    lower, upper = sorted(found, key=lambda s: s.low.value)
    assert (lower.low.value, lower.low.kind, lower.low.jumps) == (pytest.approx(-0.5), "", False)
    assert (lower.high.kind, lower.high.jumps, lower.high.value) == ("fold", True, pytest.approx(0.5 * FOLD, abs=1e-9))
    assert (upper.low.kind, upper.low.value) == ("fold", pytest.approx(-0.5 * FOLD, abs=1e-9))
    assert upper.high.value == pytest.approx(0.5)
    assert lower.high.residual < 1e-8
    halves = [SettledMotion(0.5 * s.value, s.state, s.cycle, 1, s.amplitude) for s in seen]
    on = [segment_of(s, found, 4.0) for s in halves]
    assert {found[k].high.kind for k, s in zip(on, seen) if s.value < FOLD - 1e-6} == {"fold"}
    assert {found[k].low.kind for k, s in zip(on, seen) if s.value > FOLD} == {"fold"}


def test_a_doubling_jumps_unless_the_doubled_motion_goes_on_stably() -> None:
    seen = swept(logistic, np.linspace(2.5, 3.4, 19), 0.3, 3000, False, period)
    smooth = stable_segments(surveyed(logistic, seen, 2.5, 3.4), 2.5, 3.4)
    one, two = sorted(smooth, key=lambda s: s.period)
    assert (one.high.kind, one.high.jumps, one.high.value) == ("period_doubling", False, pytest.approx(3.0, abs=1e-8))
    assert (two.period, two.low.kind, two.low.jumps) == (2, "period_doubling", False)
    assert two.low.value == pytest.approx(3.0, abs=1e-8)
    seen = swept(subcritical, np.linspace(-0.31, 0.09, 5), 1e-3, 4000, False, period)
    end = stable_segments(surveyed(subcritical, seen, -0.31, 0.09), -0.31, 0.09)[0].high
    assert (end.kind, end.jumps) == ("period_doubling", True)
    assert "period doubling, residual" in str(end)


def test_heights_end_with_the_stretch() -> None:
    stretch = StableSegment(2, SegmentEnd(0.2), SegmentEnd(0.6, "fold", 1e-12, True), (0.2, 0.4, 0.6), (1.0, 3.0, 4.0))
    assert stretch.amplitude(0.3) == pytest.approx(2.0)
    assert math.isnan(stretch.amplitude(0.61))
    assert segment_of(SettledMotion(0.3, np.zeros(1), 0, 2, 2.01), [stretch], 4.0) == 0
    assert segment_of(SettledMotion(0.3, np.zeros(1), 0, 1, 2.0), [stretch], 4.0) is None
    assert segment_of(SettledMotion(0.3, np.zeros(1), 0, 1, 2.0), [stretch], 4.0, base=2) == 0
    assert segment_of(SettledMotion(0.3, np.zeros(1), 0, 2, 3.0), [stretch], 4.0) is None
    assert str(stretch) == "period 2, stable from 0.2 (followed no further) to 0.6 (fold, residual 1e-12)"


def test_a_stretch_that_was_followed_twice_or_is_next_to_nothing_is_left_out() -> None:
    seen = swept(logistic, np.linspace(2.5, 2.9, 9), 0.3, 3000, False, period)
    branches = surveyed(logistic, seen, 2.5, 2.9)
    assert len(stable_segments([*branches, *branches], 2.5, 2.9)) == len(branches) == 1
    assert stable_segments(branches, 2.5, 2.5 + 1e5) == []
