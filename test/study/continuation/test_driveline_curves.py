"""A closed branch of a scene, curves in two parameters against bifurcations found anew, and a doubling by a canard."""

import dataclasses

import numpy as np
import pytest
from by_auto import DOUBLING, FOLDS
from independent import multipliers

from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.study.continuation.branch import Branch, BranchOrigin, branch_through, first_point, orbits_at
from tcc_sim.study.continuation.motions import ContinuationPlan, DrivelineMap, continue_motions
from tcc_sim.study.continuation.orbits import ParameterRange, Settings, Shooting, newton
from tcc_sim.trajectory import State

MU_K, OMEGA = "friction.kinetic_coefficient", "engine.frequency"
NATURAL = load_scene("fig02").system.natural_frequency
PLACE = {"pressure.amplitude": 0.0, "pressure.mean": 225e3, OMEGA: 0.36 * NATURAL, MU_K: 0.3 * 0.88}
"""From (13) the large motion of period two at omega/omega_n = 0.36, mu_k/mu_s = 0.88, beside one of period one."""


@pytest.fixture(scope="module")
def system() -> System:
    return replace(load_scene("fig02").system, PLACE)


@pytest.fixture(scope="module")
def closed(system: System) -> Branch:
    """Period two over the engine frequency."""
    (branch,) = continue_motions(system, ContinuationPlan(OMEGA, 0.3 * NATURAL, 0.45 * NATURAL)).branches
    return branch


def followed(system: System, over: str, span: ParameterRange, section: np.ndarray, period: int,
             both: bool = True) -> Branch:
    """The branch over one key through an orbit near a section point."""
    shooting = Shooting.single(DrivelineMap(system, (over,)), period, span)
    z = newton(shooting, shooting.unknowns(section[None], (getattr(*_place(system, over)),)))
    return branch_through(first_point(dataclasses.replace(shooting, settings=Settings(max_points=60)), z), both=both)


def _place(system: System, key: str) -> tuple[object, str]:
    group, name = key.split(".")
    return getattr(system, group), name


def test_the_large_motion_of_period_two_is_a_closed_branch_over_the_frequency(closed: Branch) -> None:
    assert closed.period == 2
    assert closed.closed
    folds = sorted(f.value / NATURAL for f in closed.bifurcations if f.kind == "fold")
    values = [s.value / NATURAL for s in closed.points]
    assert len(folds) == 2
    assert folds == pytest.approx([min(values), max(values)], abs=1e-4)
    assert folds[0] < 0.36 < folds[1]
    assert closed.points[0].section == pytest.approx(closed.points[-1].section)
    assert max(f.residual for f in closed.bifurcations) < 1e-8


def test_the_curve_of_a_fold_passes_the_folds_found_anew_at_its_ends(system: System, closed: Branch) -> None:
    ends = 0.357 * NATURAL, 0.365 * NATURAL
    plan = ContinuationPlan(MU_K, 0.3 * 0.87, 0.3 * 0.96, second=(OMEGA, *ends))
    result = continue_motions(system, plan)
    (item,) = [f for f in result.bifurcations if f.kind == "fold"]
    assert item.value / 0.3 == pytest.approx(FOLDS[1], abs=1e-8)
    (curve,) = [c for c in result.curves if c.kind == "fold"]
    assert sorted({curve.second[0], curve.second[-1]}) == pytest.approx(list(ends), rel=1e-12)
    for value, omega in ((curve.values[k], curve.second[k]) for k in (0, -1)):
        orbit = next(o for o in orbits_at(closed, omega) if o.stable)
        at = replace(system, {OMEGA: omega})
        branch = followed(at, MU_K, ParameterRange(0.3 * 0.87, 0.3 * 0.96), orbit.section, 2, both=False)
        again = next(f for f in branch.bifurcations if f.kind == "fold")
        assert again.value == pytest.approx(value, abs=1e-8)


def test_the_doubled_branch_of_a_saddle_beside_a_canard(system: System) -> None:
    """A doubling 3e-6 of mu_s off the fold, where the map bends within 1e-5 of the natural sizes."""
    at = replace(system, {MU_K: 0.3 * 0.74})
    result = continue_motions(at, ContinuationPlan(MU_K, 0.3 * 0.6675, 0.3 * 0.76, period=2, switch=1))
    parent, child = result.branches
    (doubling,) = [f for f in parent.bifurcations if f.kind == "period_doubling"]
    doubled = replace(at, {MU_K: doubling.value})
    assert np.abs(multipliers(doubled, doubling.point.section, 2) + 1.0).min() < 1e-4
    assert (child.period, child.origin) == (4, BranchOrigin("period_doubling", doubling.value, 0))
    first = child.points[0]
    assert first.value == pytest.approx(doubling.value, abs=1e-7)
    # Beside the doubling a multiplier of the doubled motion is 1 and the other one the square of that of the saddle.
    large = max(abs(m) for m in doubling.point.multipliers)
    assert abs(first.multipliers[0]) == pytest.approx(large**2, rel=0.02)
    assert np.abs(first.multipliers - 1.0).min() < 0.01
    assert max(s.residual for s in child.points) < 1e-8


@pytest.mark.parametrize(("kind", "changes", "plan"), [
    ("period_doubling", {MU_K: 0.3 * 0.78}, ContinuationPlan(
        MU_K, 0.3 * 0.7, 0.3 * 0.85, period=1, second=(OMEGA, 0.357 * NATURAL, 0.363 * NATURAL))),
    ("neimark_sacker", {MU_K: 0.3 * 0.83, OMEGA: 0.2545 * NATURAL}, ContinuationPlan(
        OMEGA, 0.254 * NATURAL, 0.2568 * NATURAL, period=1, second=(MU_K, 0.3 * 0.829, 0.3 * 0.831)))])
def test_a_curve_passes_the_bifurcations_found_anew_at_its_ends(system: System, kind: str, changes,
                                                                plan: ContinuationPlan) -> None:
    at = replace(system, changes)
    result = continue_motions(at, plan)
    (item,), (curve,) = result.bifurcations, result.curves
    assert curve.kind == kind
    if kind == "period_doubling":
        assert item.value / 0.3 == pytest.approx(DOUBLING, abs=1e-8)
    key, *ends = plan.second
    assert sorted({curve.second[0], curve.second[-1]}) == pytest.approx(ends, rel=1e-12)
    for value, second in ((curve.values[k], curve.second[k]) for k in (0, -1)):
        (again,) = continue_motions(replace(at, {key: second}), dataclasses.replace(plan, second=None)).bifurcations
        assert again.value == pytest.approx(value, abs=1e-8 * max(value, 1.0))


def test_at_a_neimark_sacker_bifurcation_motions_nearby_cease_to_come_back(system: System) -> None:
    at = replace(system, {MU_K: 0.3 * 0.83, OMEGA: 0.2545 * NATURAL})
    result = continue_motions(at, ContinuationPlan(OMEGA, 0.254 * NATURAL, 0.2568 * NATURAL, period=1))
    (item,) = result.bifurcations
    assert (item.kind, result.branches[0].period) == ("neimark_sacker", 1)
    assert item.residual < 1e-8
    assert abs(item.point.multipliers[0].imag) > 0.1
    for side, comes_back in ((1.0 - 3e-4, True), (1.0 + 3e-4, False)):
        value = side * item.value
        (orbit,) = orbits_at(result.branches[0], value)
        start = State(*(orbit.section + np.array([1e-5, 0.0, 0.0])))
        run = solve(replace(at, {OMEGA: value}), cycles=60, state=start, rtol=1e-12)
        away = np.abs((run.cycles.section - orbit.section) / np.array([10.0, 0.1, 10.0])).max(axis=1)
        # Over the turns of the pair, 2.5 rad a cycle, the largest distance goes with its modulus.
        early, late = away[10:20].max(), away[50:60].max()
        assert (late < early) == comes_back == (abs(orbit.multipliers[0]) < 1.0)
        assert late / early == pytest.approx(abs(orbit.multipliers[0]) ** 40, rel=0.4)
