"""When a motion has settled, by sections made by hand; its spectrum by the closed form of pure slip."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tcc_sim.errors import NumericalFailure
from tcc_sim.model.parameters import replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.sweeps.simulation import Start, repeats_after, settled_from_start, solve_to_steady_state, steady_spectrum
from tcc_sim.trajectory import Cycles, State, Status

FAST = replace(load_scene("slip").system, {"friction.law": "set_valued"})
BEGIN = Start(State(150.0, 0.0, 0.0), 3)


def section(count: int, period: int, last: int | None = None, size: float = 1e-3, column: int = 0) -> Cycles:
    """Cycles whose section repeats with a period; point `last` of one component is off by `size`."""
    points = np.stack([np.arange(count) % period + 1.0, 0.1 * (np.arange(count) % period + 1.0), np.zeros(count)],
                      axis=1)
    if last is not None:
        points[last, column] += size
    return Cycles(points, *np.full((2, count - 1), 20.0), np.zeros(count - 1))


@pytest.mark.parametrize(("cycles", "after"), [
    (section(101, 1), 0), (section(101, 3, 10), 11), (section(100, 3, 11), 12), (section(101, 16, 20), 21),
    (section(101, 17), None), (section(60, 16, 26), 27), (section(60, 16, 27), None), (section(60, 1, 33), 34),
    (section(60, 1, 34), None), (section(101, 1, 10, 1.9e-5), 0), (section(101, 1, 10, 2.1e-5), 11),
    (section(101, 1, 10, -2.1e-5), 11), (section(101, 3, 9, 2.9e-7, 1), 0), (section(101, 3, 9, 3.1e-7, 1), 10),
    (section(101, 1, 10, 1.9e-5, 2), 0), (section(101, 1, 10, 2.1e-5, 2), 11), (section(101, 1, 100), None),
    (section(101, 2, 99), None)])
def test_a_section_repeats_after_the_last_point_that_is_off(cycles: Cycles, after: int | None) -> None:
    """Within 1e-6 of the fastest slip, 20 rad/s, or of the largest angle, 0.1 rad times the period; over 25 cycles and
    two periods at least, and with a period of at most 16.
    """
    assert repeats_after(cycles) == after


def test_a_motion_is_solved_until_its_section_repeats() -> None:
    result = solve_to_steady_state(FAST, BEGIN, 4800)
    whole = result.cycles.section
    assert np.abs(whole[result.after:] - whole[-1]).max() < 1e-5 * 170.0
    assert result.after == repeats_after(result.cycles)
    assert repeats_after(result.cycles[:len(result.cycles) - 25]) is None
    exact = solve(FAST, cycles=len(result.cycles), state=BEGIN.state, start_cycle=3)
    assert whole == pytest.approx(exact.cycles.section, rel=1e-5, abs=1e-6)


def test_a_motion_that_does_not_settle_is_given_up() -> None:
    chaos = load_scene("chaos").system
    result = solve_to_steady_state(chaos, BEGIN, 110)
    assert (len(result.cycles), result.after, result.run.status) == (110, None, Status.DONE)
    cycles, period = settled_from_start(chaos, 60)
    assert (len(cycles), period) == (60, 0)
    with pytest.raises(NumericalFailure, match="fixed_step"):
        settled_from_start(replace(chaos, {"pressure.mean": 1e7}), 60, solver="fixed_step", step=0.1)
    failed = solve_to_steady_state(replace(chaos, {"pressure.mean": 1e7}), BEGIN, 60, solver="fixed_step", step=0.1)
    assert (failed.cycles, failed.after) == (None, None)


def test_the_period_is_that_of_what_has_settled() -> None:
    halved = replace(FAST, {"pressure.frequency_ratio": 0.5, "pressure.amplitude": 1e4})
    cycles, period = settled_from_start(halved, 4800)
    assert period == 2
    assert cycles.section[:2] == pytest.approx(solve(halved, cycles=1).cycles.section, rel=1e-5, abs=1e-6)
    assert repeats_after(cycles) is not None


@pytest.mark.parametrize(("start", "period"), [(0, 2), (3, 2), (3, 0)])
def test_the_spectrum_of_pure_slip_has_the_lines_of_its_closed_form(start: int, period: int) -> None:
    """Tp/(I1 omega) at order 1; without a period a density, whose mean square is that of the same sine."""
    system = replace(FAST, {"engine.order": 2.0})
    cycles, _ = settled_from_start(system, 4800)
    found = steady_spectrum(system, Start(State(*cycles.section[-1].tolist()), start), period)
    amplitude = system.engine.torque_amplitude / system.driveline.flywheel_inertia / system.engine.frequency
    if period:
        assert (found.period, found.order[1], found.frequency[1]) == (2, 1.0,
            pytest.approx(0.5 * system.engine.frequency))
        line = int(np.argmax(found.slip_speed[1:])) + 1
        assert (found.order[line], found.slip_speed[line]) == (2.0, pytest.approx(amplitude, rel=1e-3))
        return
    width = (found.frequency[1] - found.frequency[0]) / (2.0 * math.pi)
    assert float(found.slip_speed_density[1:].sum()) * width == pytest.approx(0.5 * amplitude**2, rel=0.01)
