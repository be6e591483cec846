"""The losses that a soak reports are those in the stamps of its recording."""

import pytest
from driveline_bags import bag, ticked

from tcc_sim.benchmarks.endurance import figures_of
from tcc_sim.scene import load_scene

ROWS = ticked(load_scene("minimal"), 300)


@pytest.mark.parametrize(("kept", "gaps"), [(ROWS, 0), (ROWS[:50] + ROWS[51:100] + ROWS[140:], 41)])
@pytest.mark.parametrize("beyond", [0, 1, -1])
def test_the_count_of_the_recorder_is_compared_with_the_gaps_in_the_stamps(tmp_path, kept, gaps, beyond):
    found = figures_of(bag(tmp_path / "run", kept, "minimal", lost=gaps + beyond))
    assert (found.lost_messages, found.messages["/joint_states"], found.complete) == (gaps, 300 - gaps, True)
    assert found.count_is_honest == (beyond == 0)


def test_without_a_count_there_is_nothing_to_believe(tmp_path):
    assert not figures_of(bag(tmp_path / "run", ROWS, "minimal", cut=True)).count_is_honest
