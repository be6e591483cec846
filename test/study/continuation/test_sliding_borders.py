"""Bifurcations with sliding on scenes of the driveline, each located once more from SciPy's motion on one side of
it.
"""

import dataclasses

import numpy as np
import pytest
from independent import Piecewise

from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.study.continuation.arclength import corrector
from tcc_sim.study.continuation.bifurcations import special_points_between
from tcc_sim.study.continuation.motions import ContinuationPlan, DrivelineMap, continue_motions
from tcc_sim.study.continuation.orbits import Settings, differ

MU_K, OMEGA, PSI = "friction.kinetic_coefficient", "engine.frequency", "pressure.phase"
ALIKE = replace(System(), {"friction.law": "set_valued", MU_K: 0.299, "pressure.mean": 225e3,
                           "pressure.amplitude": 0.0})
DRY = replace(ALIKE, {MU_K: 0.255, OMEGA: 0.36 * ALIKE.natural_frequency})
PULSATING = replace(ALIKE, {"pressure.amplitude": 170e3, "engine.mean_torque": 0.0, "engine.torque_amplitude": 400.0,
                            PSI: 1.0})


def values_at(plant, t, states):
    """Time, the size of the slip speed, and stick's margin with either sign of lambda, from states in rows."""
    need = np.array([plant.need(u, y) for u, y in zip(t, states)])
    strength = plant.ratio * np.array([plant.load(u) for u in t])
    return np.abs(states[:, 0]), strength - np.abs(need), strength, need


def least_dip(size, within):
    """The smallest local minimum, by polynomials through nine samples about each."""
    near, result = np.arange(-4, 5), []
    for i in range(4, len(size) - 4):
        if within[i - 4:i + 5].all() and size[i] <= size[i - 1] and size[i] < size[i + 1]:
            curve = np.polynomial.Polynomial.fit(near, size[i - 4:i + 5], 6)
            turns = curve.deriv().roots()
            result.append(curve(turns[np.abs(turns).argmin()].real))
    return min(result)


def margin_by_scipy(kind, system, x, cycles, closes=1e-9):
    """The margin that vanishes at this kind of border, of the periodic motion through x; the motion must close."""
    start = dict(zip(("initial.slip_speed", "initial.plate_angle", "initial.plate_speed"), map(float, x)))
    plant, end = Piecewise(replace(system, start), rtol=1e-13), cycles * system.cycle
    times = np.linspace(0.0, end, 4000 * cycles + 1)
    states, changes, _ = plant.run(end, times, slices=25 * cycles)
    np.testing.assert_allclose(states[-1, :3], x, rtol=closes, atol=closes)
    if "crossing" in kind or "switching" in kind:
        ends = np.array([t for t, before, _ in changes if before != 0])
        modes = [before for _, before, _ in changes if before != 0]
        landed, _, _ = plant.run(end, np.sort(np.append(ends, 0.0)), slices=25 * cycles)
        _, _, strength, need = values_at(plant, ends, landed[1:])
        return min(strength + np.array(modes) * need, key=abs)
    speed, margin, _, _ = values_at(plant, times, states)
    slips = speed > 0.0
    return least_dip(speed, slips) if kind == "grazing_sliding" else least_dip(margin, ~slips)


def orbit_beside(result, key, offset):
    """Section of the orbit of the same branch at the border's parameter plus an offset, and its event sequence."""
    shooting, z = result.point.equations, result.point.z
    row = np.zeros(len(z))
    row[-1] = 1.0
    tangent = result.point.tangent
    guess = z + offset / tangent[-1] * tangent
    guess[-1] = z[-1] + offset
    exact = dataclasses.replace(shooting, settings=Settings(correct_tolerance=1e-11))
    got = corrector(exact, guess, row)
    assert got is not None, (key, offset)
    x, values = shooting.nodes(got.z)[0], shooting.values(got.z)
    return x, values[0], shooting.map.evaluate(x, values, 0, shooting.period).seen.events


def located_again(item, system, key, reach):
    """How far from the border the margins of three orbits on its one side are 0 by a parabola, of the key's range."""
    sides = [orbit_beside(item, key, s * 1e-2 * reach)[2] for s in (1.0, -1.0)]
    assert differ(*sides)
    # The margin lives on the side with fewer events.
    offsets = (1.0 if len(sides[0]) <= len(sides[1]) else -1.0) * reach * np.array([1.0, 2.0, 3.0])
    nearby = [orbit_beside(item, key, offset) for offset in offsets]
    margins = [margin_by_scipy(item.kind, replace(system, {key: value}), x, item.point.period)
               for x, value, _ in nearby]
    return abs(np.polynomial.Polynomial.fit(offsets, margins, 2).roots()).min()


SCENES = [(ALIKE, ContinuationPlan(OMEGA, 62.5, 63.1), ["adding_sliding", "grazing_sliding"]),
          (PULSATING, ContinuationPlan(PSI, 0.8, 2.6), ["switching_sliding", "adding_sliding", "crossing_sliding"])]


@pytest.mark.parametrize(("system", "plan", "kinds"), SCENES, ids=["speeds", "arrivals"])
def test_each_kind_is_found_where_scipys_motion_has_it(system, plan, kinds):
    result = continue_motions(system, plan).bifurcations
    assert [f.kind for f in result] == kinds
    for item in result:
        assert item.residual < 1e-11
        assert located_again(item, system, plan.over, 1e-4) < 1e-8


def test_the_adding_sliding_of_period_two_beside_its_fold():
    names = sorted(continue_motions(DRY, ContinuationPlan(MU_K, 0.25, 0.285, period=2)).bifurcations,
                   key=lambda f: f.value)
    assert [f.kind for f in names] == ["adding_sliding", "fold"]
    assert min(abs(m - 1.0) for m in names[1].point.multipliers) < 1e-6
    assert [f.residual < 1e-8 for f in names] == [True, True]
    assert located_again(names[0], DRY, MU_K, 1e-4) < 1e-7


def test_a_change_for_two_reasons_has_the_kind_of_the_margin_that_vanishes():
    map_ = DrivelineMap(ALIKE, (OMEGA,))
    result = continue_motions(ALIKE, ContinuationPlan(OMEGA, 51.5, 54.0)).bifurcations
    assert [f.kind for f in sorted(result, key=lambda f: f.value)] == ["grazing_sliding", "adding_sliding"]
    for item, name in zip(sorted(result, key=lambda f: f.value), ("grazing", "stick")):
        orbit = item.point
        assert abs(map_.margins(orbit.section, orbit.values, 0, orbit.period)[name].value) < 1e-10


def test_every_border_of_a_folded_branch_is_met_with_its_margin() -> None:
    system = load_scene("fig02").system
    system = replace(system, {"pressure.amplitude": 0.0, "pressure.mean": 225e3, "friction.law": "set_valued",
                              "friction.kinetic_coefficient": 0.27, "engine.frequency": 60.1})
    result = continue_motions(system, ContinuationPlan("engine.frequency", 60.0, 61.15, period=1))
    # Both ends are met, whichever way along the branch is the first.
    assert sorted(end.value for end in result.branches[0].ended) == [60.0, 61.15]
    grazing = [f for f in result.bifurcations if f.kind == "grazing_sliding"]
    assert len(grazing) == 3
    for item in grazing:  # Some are so unstable that an orbit beside them closes to 1e-7 only.
        border = replace(system, {OMEGA: item.value})
        assert abs(margin_by_scipy(item.kind, border, item.point.section, 1, closes=1e-6)) < 1e-6
    assert max(f.residual for f in result.bifurcations) < 1e-8


def test_a_branch_turns_at_a_border_beyond_which_it_has_no_motion():
    """At the grazing at 57.4644614 rad/s two unstable motions meet, both on the same side of it: Newton's method goes
    to and fro between the two sides beyond, and what it nearly solves there was taken for a motion, from which the
    branch went back along itself.
    """
    system = replace(System(), {"friction.law": "set_valued", MU_K: 0.26032645180732467, OMEGA: 57.52,
                                "pressure.mean": 225e3, "pressure.amplitude": 28125.0,
                                "pressure.frequency_ratio": 2 / 3, PSI: 6.051853081466417})
    branch, = continue_motions(system, ContinuationPlan(OMEGA, 57.46445, 57.52, period=3)).branches
    assert [branch.points[0].value, branch.points[-1].value] == [57.46445, 57.52]
    near = [f for f in branch.bifurcations if 57.46 < f.value < 57.48]
    assert [f.kind for f in near] == ["fold", "grazing_sliding"]
    assert near[0].value == pytest.approx(near[1].value, abs=1e-6)
    assert min(abs(m - 1.0) for m in near[0].point.multipliers) < 1e-6
    border = replace(system, {OMEGA: near[1].value})
    assert abs(margin_by_scipy("grazing_sliding", border, near[1].point.section, 3)) < 1e-6
    within = [s for s in branch.points if near[1].value < s.value < near[0].value]
    point = min(within, key=lambda s: abs(s.multipliers[0].real + 815.0))
    # It closes by SciPy's motion too.
    margin_by_scipy("grazing_sliding", replace(system, {OMEGA: point.value}), point.section, 3)
    # A step between the pieces that fold and grazing part is seen to leave out both, wherever it lands.
    pieces = ([s for s in branch.points if s.value < 57.4655 and s.multipliers[0].real * m > 0.0 and
               abs(s.multipliers[0]) > least] for m, least in ((-1.0, 100.0), (1.0, 0.3)))
    beyond, before = (min(piece, key=lambda s: abs(s.multipliers[0])) for piece in pieces)
    for one, two in ((beyond, before), (before, beyond)):
        assert differ(one.events, two.events)
        assert one.equations == two.equations
        assert special_points_between(one, two) is None


PULSED = replace(System(), {"friction.law": "set_valued", "pressure.mean": 225e3, "pressure.amplitude": 112.5e3,
                            "pressure.frequency_ratio": 2 / 3})


@pytest.mark.parametrize(("changes", "plan", "ends", "others"), [
    ({OMEGA: 143.36225159413465, MU_K: 0.28861945760876007, PSI: 1.1955}, ContinuationPlan(PSI, 1.1, 1.1968, period=3),
     ("+S+S+S+", "S+S-S+S+S"), ["adding_sliding"]),
    ({OMEGA: 223.2582543030187, MU_K: 0.2176099171331234, PSI: 4.248239135991167, "driveline.damping": 0.5},
     ContinuationPlan("driveline.damping", 0.1, 2.0, period=3), ("S+S", "+S+"), [])], ids=["slip ends", "slip begins"])
def test_an_event_that_passes_phase_0_neither_ends_a_branch_nor_is_a_bifurcation(changes, plan, ends, others):
    """Where slip ends at phase 0 the section has a corner: on one side of it no motion has a slip speed there."""
    branch, = continue_motions(replace(PULSED, changes), plan).branches
    first, last = branch.points[0], branch.points[-1]
    assert (first.value, last.value) == (plan.low, plan.high)
    assert [f.kind for f in branch.bifurcations] == others
    for item in branch.bifurcations:
        assert located_again(item, replace(PULSED, changes), plan.over, 1e-4) < 1e-8
    assert (first.events, last.events) == ends


def test_a_branch_leaves_the_border_at_which_its_two_pieces_meet():
    """Both motions that meet at the grazing at 48.9755788 rad/s exist above it, with tangents that point alike: the
    walk stepped from one to the other beside the border, with its tangent back to it, and went back along itself.
    """
    system = replace(ALIKE, {MU_K: 0.2789029457369511, OMEGA: 49.2})
    branch, = continue_motions(system, ContinuationPlan(OMEGA, 46.4758, 51.0, period=1)).branches
    assert [branch.points[0].value, branch.points[-1].value] == [46.4758, 51.0]
    met = [(f.kind, round(f.value, 7)) for f in branch.bifurcations]
    assert len(set(met)) == len(met)
    (item,) = [f for f in branch.bifurcations if f.kind == "grazing_sliding" and f.value < 49.2]
    border = replace(system, {OMEGA: item.value})
    assert abs(margin_by_scipy(item.kind, border, item.point.section, 1, closes=1e-6)) < 1e-7
