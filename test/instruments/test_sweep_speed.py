"""Engine cycles a second: the attractor is reached, errors that are too large do not count, and the table."""


import pytest
import sweep_speed

from tcc_sim.benchmarks import peers
from tcc_sim.benchmarks.references import reference
from tcc_sim.paper.catalogue import paper_system
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve

SPEED = sweep_speed.SpeedEffort((0.36,), 2, 2, 10, 1, (1e-6, 1e-9, 1e-10))


def test_the_attractor_is_reached_before_it_is_timed():
    """The period-one motion of minimal with its known largest slip speed repeats from the settled state at once."""
    system = sweep_speed.on_attractor(load_scene("minimal").system)
    cycles = solve(system, cycles=3, rtol=1e-11).cycles
    assert cycles.section[3] == pytest.approx(cycles.section[0], rel=1e-9, abs=1e-9)
    assert max(cycles.highest) == pytest.approx(22.17, abs=2e-3)


def test_a_tolerance_that_leaves_too_large_an_error_does_not_count_as_fast():
    system = paper_system({"friction.kinetic_coefficient": 0.25, "engine.frequency": 77.0})
    truth = reference(system, SPEED.horizon, "LSODA", 1e-12)
    with pytest.raises(peers.Failed, match="its error is at least"):
        sweep_speed.loosest(system, sweep_speed.ENGINE, (1e-1,), truth)
    setting, error = sweep_speed.loosest(system, sweep_speed.ENGINE, (1e-1, 1e-9), truth)
    assert setting == 1e-9
    assert error < 1e-7


def test_every_scene_has_a_row_with_an_error_below_the_bound():
    found = sweep_speed.sweep_speed(SPEED, lambda *at: None)
    engine = [row for row in found.rows if row.solver == sweep_speed.ENGINE]
    assert [row.kinetic_ratio for row in engine[::4]] == pytest.approx([1.0, 0.83, 0.75, 0.667])
    assert [row.stretch for row in engine] == ["transient", "transient", "attractor", "attractor"] * 4
    assert all(row.error <= sweep_speed.ERROR and row.cycles_per_second > 0.0 for row in found.rows)
    assert len([row for row in [*found.rows, *found.omitted] if row.solver == sweep_speed.PEER]) == 8
    assert (found.sweep.points, found.sweep.cycles) == (8, 80)
    assert "\n".join(sweep_speed.speed_section(found)).count("| 0.83 | 0.36 |") == 2
