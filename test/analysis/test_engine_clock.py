"""Start times of engine cycles by three clocks, and phases of blocks that are set by hand."""

import math

import numpy as np
import pytest

from tcc_sim.analysis.measured.engine_clock import Scheduled, Tracked, clock_of_scene
from tcc_sim.scene import load_scene

TURN = 2.0 * math.pi


@pytest.mark.parametrize(("begin", "end", "first", "starts"), [
    (0.0, 0.6, 0, [0.0, 0.25, 0.5]), (0.3, 1.0, 2, [0.5, 0.75, 1.0]), (0.5 + 2e-10, 0.8, 2, [0.5, 0.75]),
    (0.5 + 3e-10, 0.8, 3, [0.75])])
def test_a_uniform_clock_has_the_multiples_of_its_cycle(begin, end, first, starts):
    ((number, found),) = Scheduled(0.25).stretches(7, begin, end)
    assert (number, found.tolist()) == (first, pytest.approx(starts))
    assert (Scheduled(0.25).cycles_until(0.6), Scheduled(0.25).start_of(3)) == (2.4, 0.75)


def test_a_scheduled_clock_follows_the_profile():
    """phi = 100 t + 25 t^2."""
    scene = load_scene("fig02").with_values({"engine.frequency_times": (0.0, 2.0),
                                             "engine.frequency_values": (100.0, 200.0)})
    clock = clock_of_scene(scene.system)
    assert isinstance(clock, Scheduled)
    starts = -2.0 + np.sqrt(4.0 + TURN * np.arange(20) / 25.0)
    ((first, found),) = clock.stretches(0, 0.2, 0.6)
    inside = (starts >= 0.2) & (starts <= 0.6)
    assert (first, found) == (int(np.flatnonzero(inside)[0]), pytest.approx(starts[inside]))
    assert clock.cycles_until(0.2) == pytest.approx(21.0 / TURN)
    assert (clock.start_of(9), clock.cycle) == (pytest.approx(starts[9]), scene.system.cycle)
    assert clock_of_scene(load_scene("fig02").system) == Scheduled(load_scene("fig02").system.cycle)


STARTS = np.array([0.3, 0.4, 0.51, 0.8, 0.9, 1.3])
TRACKED = Tracked(0.1, {2: (np.array([3, 4, 5, 8, 9, 12]), STARTS)})


@pytest.mark.parametrize(("begin", "end", "found"), [
    (0.0, 2.0, [(3, 0, 3), (8, 3, 5)]), (0.35, 0.85, [(4, 1, 3), (8, 3, 4)]), (0.4, 0.4, [(4, 1, 2)]),
    (0.4 + 0.9e-10, 0.51 - 0.9e-10, [(4, 1, 3)]), (0.4 + 1.1e-10, 0.8 - 1.1e-10, []), (0.52, 0.95, [(8, 3, 5)]),
    (0.82, 2.0, []), (1.2, 2.0, []), (0.0, 0.2, [])])
def test_a_tracked_clock_begins_another_stretch_where_a_number_is_missing(begin, end, found):
    """The last start before an unknown stretch begins no cycle."""
    assert [(number, starts.tolist()) for number, starts in TRACKED.stretches(2, begin, end)] == [
        (number, STARTS[a:b].tolist()) for number, a, b in found]
    assert TRACKED.stretches(1, begin, end) == []
