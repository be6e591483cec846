"""Scenes as maps: pure stick in closed form, its border, derivatives, refusals, and known bifurcations."""

import math
from types import SimpleNamespace
from typing import Any

import by_auto
import numpy as np
import pytest

from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.pure_stick import constant_load_limits
from tcc_sim.scene import load_scene
from tcc_sim.study.benchmarks.references import multipliers
from tcc_sim.study.continuation.branch import branch_through, first_point
from tcc_sim.study.continuation.driveline import DrivelineMap, _no_motion, start_orbit
from tcc_sim.study.continuation.follow import StopReason
from tcc_sim.study.continuation.loss_of_stability import nearest_bifurcation
from tcc_sim.study.continuation.motions import ContinuationPlan, Motions, check, continue_motions
from tcc_sim.study.continuation.newton import newton, orbit_at
from tcc_sim.study.continuation.palc import cosine_between
from tcc_sim.study.continuation.settings import Settings
from tcc_sim.study.continuation.shooting import ParameterRange, Shooting
from tcc_sim.trajectory import Cycles

CONSTANT_LOAD = {"pressure.amplitude": 0.0, "pressure.mean": 225e3}
MU_K = "friction.kinetic_coefficient"


def coexistence(law: str, ratio: float) -> System:
    """omega/omega_n = 0.36 under a constant load of 225 kPa."""
    system = load_scene("fig02").system
    return replace(system, {**CONSTANT_LOAD, "engine.frequency": 0.36 * system.natural_frequency, "friction.law": law,
                            MU_K: 0.3 * ratio})


def test_multipliers_of_pure_stick_are_those_of_one_oscillator() -> None:
    system = replace(load_scene("stick").system, {"friction.law": "set_valued"})
    map_ = DrivelineMap(system, ("engine.mean_torque",))
    shooting, z = start_orbit(map_, ParameterRange(290.0, 310.0), 300.0, None)
    result = orbit_at(shooting, z, shooting.linearise(z))
    both = system.driveline.flywheel_inertia + system.driveline.plate_inertia
    roots = np.roots([both, system.driveline.damping, system.driveline.stiffness]) * system.cycle
    expected = sorted([*np.exp(roots), 0.0], key=lambda m: (-round(abs(m), 12), -m.imag))
    assert result.multipliers == pytest.approx(expected, abs=1e-8)
    assert (result.seen.events, result.seen.stick_fraction, result.seen.largest) == ("S", 1.0, 0.0)


def test_the_border_of_pure_stick_is_that_of_the_closed_form() -> None:
    system = replace(load_scene("stick").system, {"friction.law": "set_valued", "friction.kinetic_coefficient": 0.3})
    border = next(w for w in constant_load_limits(system) if w > 50.0)
    result = continue_motions(system, ContinuationPlan("engine.frequency", 40.0, border + 3.0,
                                          second=("pressure.mean", 29e4, 31e4)))
    (item,) = [f for f in result.bifurcations if f.kind == "stick_border"]
    assert item.value == pytest.approx(border, abs=1e-7)
    assert item.residual < 1e-8
    (curve,) = result.curves
    for omega, mean in list(zip(curve.values, curve.second))[::5]:
        assert min(abs(w - omega) for w in constant_load_limits(replace(system, {"pressure.mean": mean}))) < 1e-6


@pytest.fixture(scope="module")
def doubled() -> dict[str, Motions]:
    """Where the motion of period one doubles under either law."""
    return {law: continue_motions(coexistence(law, 0.85), ContinuationPlan(
        MU_K, 0.3 * low, 0.3 * high, period=1))
            for law, low, high in (("smoothed", 0.772, 0.784), ("set_valued", 0.8, 0.81))}


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
def test_the_doubling_of_period_one(law: str, doubled: dict[str, Motions]) -> None:
    result = doubled[law]
    (item,) = result.bifurcations
    assert item.kind == "period_doubling"
    doubled_scene = replace(coexistence(law, 0.85), {MU_K: item.value})
    assert np.abs(multipliers(doubled_scene, item.point.orbit.section, 1) + 1.0).min() < 1e-6
    if law == "smoothed":
        assert item.value / 0.3 == pytest.approx(by_auto.DOUBLING, abs=1e-8)
    assert result.branches[0].points[0].orbit.stable != result.branches[0].points[-1].orbit.stable


def test_a_canard_ends_a_branch_with_a_sentence() -> None:
    result = continue_motions(coexistence("smoothed", 0.85), ContinuationPlan(MU_K, 0.18, 0.297, period=2))
    (branch,) = result.branches
    assert any("a multiplier is above 1e+10, a canard, which double precision does not resolve" in str(end)
               for end in branch.ended)
    assert max(abs(s.orbit.multipliers[0]) for s in branch.points) <= 1e10
    folds = sorted((f for f in result.bifurcations if f.kind == "fold"), key=lambda f: f.value)
    assert [f.value / 0.3 for f in folds] == pytest.approx(by_auto.FOLDS, abs=1e-8)
    assert max(np.abs(f.point.orbit.multipliers - 1.0).min() for f in folds) < 1e-7
    assert max(s.orbit.residual for s in branch.points) < 1e-8
    assert not branch.points[0].orbit.stable
    assert not branch.points[-1].orbit.stable
    assert max(f.residual for f in result.bifurcations) < 1e-8
    # Branch ends in the doubling of period one, which is no fold.
    assert min(s.value for s in branch.points[-3:]) / 0.3 == pytest.approx(by_auto.DOUBLING, abs=1e-7)


def test_period_one_through_pure_creep_has_a_doubling_and_a_fold() -> None:
    system = coexistence("smoothed", 0.83)
    unit = system.natural_frequency
    result = continue_motions(system, ContinuationPlan("engine.frequency", 0.4 * unit, 0.45 * unit, period=1))
    assert tuple(map(str, result.branches[0].ended)) == tuple(
        f"engine.frequency reached {share * unit:.9g} rad/s, the end of the range" for share in (0.4, 0.45))
    at = {f.kind: f.value / unit for f in result.bifurcations if f.value < 0.43 * unit}
    assert at.keys() == {"period_doubling", "fold"}
    assert at["fold"] == pytest.approx(at["period_doubling"], abs=1e-7)  # A canard has all multipliers within that.
    assert max(f.residual for f in result.bifurcations) < 1e-8
    assert max(abs(s.orbit.multipliers[0]) for s in result.branches[0].points) > 1e9


def test_no_fold_is_lost_where_the_largest_slip_is_no_good_coordinate() -> None:
    system = coexistence("smoothed", 0.83)
    unit = system.natural_frequency
    plan = ContinuationPlan("engine.frequency", 0.35 * unit, 0.47 * unit, period=1, switch=1)
    result = continue_motions(replace(system, {"engine.frequency": 0.4 * unit}), plan)
    for branch in result.branches:
        steps = np.diff([s.value for s in branch.points])
        # Where a branch ends in a doubling its parameter stands still, so that the last step may be one of rounding.
        turns = np.count_nonzero(np.diff(np.sign(steps[np.abs(steps) > 1e-8])))
        assert turns == sum(f.kind == "fold" for f in branch.bifurcations) > 0


def test_a_branch_passes_a_node_at_the_onset_of_slip() -> None:
    system = replace(load_scene("fig02").system, {**CONSTANT_LOAD, "friction.law": "set_valued", MU_K: 0.27})
    map_, span, value = DrivelineMap(system, ("engine.frequency",)), ParameterRange(60.0, 120.0), 61.0889
    shooting = Shooting(map_, 1, (span,), (0.25, 0.28515625, 0.46484375),
                        Settings(max_points=60))  # Slip starts at the third node at 61.0891144.
    x = np.array([0.0, 0.0634500, 19.3206])
    ends = [map_.evaluate(x, (value,), 0.0, part).value for part in (0.25, 0.53515625)]
    z = newton(shooting, shooting.unknowns(np.array([x, *ends]), (value,)))
    branch = branch_through(first_point(shooting, z), both=False)
    assert str(branch.ended[1]).startswith("stopped after 60 points")
    assert max(s.value for s in branch.points) > 61.09


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
def test_the_gradient_of_the_amplitudes_is_that_of_differences(law: str) -> None:
    """By central differences, in natural sizes; the largest of them is the largest slip speed."""
    system = replace(load_scene("fig02").system, {"friction.law": law})
    of = DrivelineMap(system, ("engine.frequency",))
    shooting = Shooting.single(of, 1, ParameterRange(100.0, 200.0, name="engine.frequency"))
    z = shooting.unknowns(np.array([[10.0, 0.1, 5.0]]), (150.0,))
    linearised = shooting.linearise(z)
    largest = of.evaluate(shooting.nodes(z)[0], (150.0,), 0, 1).seen.largest
    assert float(linearised.amplitudes.max()) * of.amplitude_scale == pytest.approx(largest, rel=1e-6)
    for k, step in enumerate(np.eye(len(z)) * 1e-5):
        ahead, behind = (shooting.linearise(z + sign * step).amplitudes for sign in (1.0, -1.0))
        assert linearised.amplitude_gradient[:, k] == pytest.approx((ahead - behind) / 2e-5, rel=1e-3, abs=1e-5)


RATIO = "pressure.frequency_ratio"
SET_VALUED = {"friction.law": "set_valued"}


@pytest.mark.parametrize(("key", "values", "line"), [
    ("friction.law", {}, "friction.law is 'smoothed'; motions are followed in a key that is one number"),
    ("engine.harmonic_amplitudes", {}, "engine.harmonic_amplitudes is (); motions are followed in a key that is one "
     "number"),
    ("engine.speed", {}, "engine.speed is engine.frequency over engine.order; motions are followed in "
     "engine.frequency, whose ends may be in rad/s or hz"),
    ("initial.slip_speed", {}, "initial.slip_speed is where a solution starts; periodic motions do not depend on it"),
    *((key, {}, f"{key} has no effect on periodic motions") for key in (
        "engine.order", "pressure.time_constant", "pressure.delay", "pressure.rate_limit")),
    ("friction.smoothing", SET_VALUED, "friction.smoothing has no effect with friction.law set_valued"),
    (RATIO, {}, f"{RATIO} cannot be followed: between ratios of whole numbers the excitation is not periodic"),
    *((key, {"pressure.amplitude": 0.0}, f"{key} has no effect where pressure.amplitude is 0") for key in (
        RATIO, "pressure.phase")),
    ("friction.decay", {MU_K: 0.3}, f"friction.decay has no effect where {MU_K} is friction.static_coefficient"),
    ("engine.frequncy", {}, "engine.frequncy is not a scene key; did you mean engine.frequency?"),
    ("engine.mean_torque", {RATIO: math.pi}, "a map of the section needs "),
])
def test_keys_in_which_no_motion_can_be_followed(key: str, values: dict[str, object], line: str) -> None:
    with pytest.raises(InputError) as error:
        DrivelineMap(replace(load_scene("fig02").system, values), (key,))
    assert str(error.value) == line or (line.endswith(" ") and "ratio of whole numbers" in str(error.value))
    for free, laws in (("friction.smoothing", {}), ("friction.decay", SET_VALUED), ("pressure.phase", SET_VALUED)):
        assert DrivelineMap(replace(load_scene("fig02").system, laws), (free,)).piecewise is bool(laws)


def test_a_key_has_effect_beside_another_that_is_free() -> None:
    system = replace(load_scene("fig02").system, {"pressure.amplitude": 0.0, MU_K: 0.3})
    assert DrivelineMap(system, ("pressure.amplitude", "pressure.phase")).keys[1] == "pressure.phase"
    assert DrivelineMap(system, (MU_K, "friction.decay")).keys[1] == "friction.decay"
    assert DrivelineMap(system, ("engine.frequency",)).keys == ("engine.frequency",)


def test_a_period_that_the_settled_motion_does_not_come_back_in() -> None:
    with pytest.raises(NumericalFailure, match="no motion of period 3 was found near the settled one"):
        continue_motions(coexistence("smoothed", 0.85), ContinuationPlan(MU_K, 0.25, 0.26, period=3))


RESTING = Cycles(np.zeros((9, 3)), np.ones(8), np.zeros(8), np.ones(8))
TRIED = "no motion {} was found near the settled one, from the 8 of its section points that come back closest; "
ELSEWHERE = f"begin at --set {MU_K}=0.2625, where the motion settles in period 2"
NOWHERE = ("nor does it settle in a period at 9 values of the range: begin with another --period, or with --seeds of "
           "basins")


@pytest.mark.parametrize(("period", "settling", "line"), [
    (None, {}, TRIED.format("up to period 8") + NOWHERE), (6, {}, TRIED.format("of period 6") + NOWHERE),
    (6, {0.275: 2}, TRIED.format("of period 6") + NOWHERE),
    (None, {0.2625: 2}, TRIED.format("up to period 8") + ELSEWHERE),
    (2, {0.2625: 2}, TRIED.format("of period 2") + ELSEWHERE),
    (None, {0.2: 3, 0.2625: 2, 0.3: 4}, TRIED.format("up to period 8") + ELSEWHERE)])
def test_what_was_looked_for_in_vain_is_named(period: int | None, settling: dict[float, int], line: str) -> None:
    """With the periods that were tried, and the nearest value of nine at which a map settles."""
    def settled(values: tuple[float, ...], most: int) -> tuple[Cycles, int]:
        if abs(values[0] - 0.225) < 1e-9:
            raise ArithmeticError("no map")
        assert most == 300
        return RESTING, next((n for at, n in settling.items() if abs(at - values[0]) < 1e-9), 0)

    map_: Any = SimpleNamespace(settled=settled)
    span = ParameterRange(0.2, 0.3, name=MU_K)
    assert _no_motion(map_, span, 0.25, RESTING, period, [2, 4, 6, 8]) == line


def point_of(*amplitudes: float, value: float = 0.0, z: tuple[float, ...] = (0.0,)) -> Any:
    """A point of a branch or of a curve, with the derivative 2 of its first amplitude by its first unknown."""
    seen = SimpleNamespace(largest=amplitudes[0])
    gradient = np.array([[2.0, *[0.0] * (len(z) - 1)]])
    return SimpleNamespace(value=value, orbit=SimpleNamespace(seen=seen), z=np.array(z), tangent=np.array([0.6, 0.8]),
                           linearised=SimpleNamespace(amplitudes=np.array(amplitudes), amplitude_gradient=gradient))


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_directions_and_distances_do_not_depend_on_the_units(scale: float) -> None:
    """A cosine whatever the lengths, and the nearest bifurcation by parts of range and largest size."""
    for way, amplitude, cosine in (((0.6, 0.8), 1.2, 1.0), ((-0.6, -0.8), -1.2, -1.0), ((0.8, -0.6), 0.0, 0.0)):
        scaled = point_of(scale * amplitude, z=(scale * way[0], scale * way[1]))
        assert cosine_between(point_of(0.0, z=(0.0, 0.0)), scaled, True) == pytest.approx(cosine)
        assert cosine_between(point_of(0.0, z=(0.0, 0.0)), scaled, False) == pytest.approx(cosine)
    points = [point_of(scale * size, value=scale * value) for value, size in ((1.0, 10.0), (2.0, 11.0), (3.0, 12.0))]
    both = [SimpleNamespace(value=scale * value, point=point_of(scale * size))
            for value, size in ((3.1, 12.2), (2.0, 12.4))]
    branch = SimpleNamespace(points=points, bifurcations=both)
    # 0.1 of a range of 100 and 0.2 of a size of 10 are less than 0.4 of that size; 0.4 of a size of 1 is too far.
    assert nearest_bifurcation(branch, 1, 10.0 * scale, 100.0 * scale) is both[0]
    assert nearest_bifurcation(branch, 1, 1.0 * scale, 1.0 * scale) is None


@pytest.mark.parametrize(("plan", "words"), [
    (ContinuationPlan(MU_K, 0.2, 0.3, period=3), "multiple"),
    (ContinuationPlan(MU_K, 0.2, 0.3, second=("pressure.mean", 1e5, 2e5)), "include"),
    (ContinuationPlan(MU_K, 0.02, 0.3, second=("friction.static_coefficient", 0.2, 0.5)), "one twentieth"),
    (ContinuationPlan("friction.static_coefficient", 0.2, 1.9, second=(MU_K, 0.08, 0.3)), "one twentieth"),
])
def test_plans_that_cannot_be_carried_out(plan: ContinuationPlan, words: str) -> None:
    system = replace(load_scene("fig02").system, {"pressure.frequency_ratio": 0.5})
    with pytest.raises(InputError, match=words):
        check(system, plan)


@pytest.mark.parametrize("ends", [(0.2, 0.2), (0.3, 0.2)])
def test_a_plan_goes_from_a_lower_value_to_a_higher_one(ends: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="the two must differ"):
        ContinuationPlan(MU_K, *ends)


def test_a_branch_goes_through_a_doubling_where_its_parameter_stands_still() -> None:
    system = replace(load_scene("fig02").system, {"friction.smoothing": 1e4, "friction.decay": 0.02})
    (branch,) = continue_motions(system, ContinuationPlan("friction.decay", 0.0, 0.03)).branches
    assert branch.period == 2
    assert branch.ended[0].reason is StopReason.DOUBLING


def test_rounding_makes_no_bifurcation_of_a_motion_without_damping() -> None:
    system = replace(load_scene("stick").system, {"friction.law": "set_valued", "driveline.damping": 0.0})
    result = continue_motions(system, ContinuationPlan("driveline.stiffness", 2500.0, 3500.0))
    assert result.bifurcations == []
    assert not any(s.orbit.stable for s in result.branches[0].points)


RUNNING_AWAY = {"friction.law": "set_valued", "pressure.mean": 150e3, "pressure.amplitude": 0.0}


@pytest.mark.parametrize(("changes", "plan", "words"), [
    # mu_s Pm A R = 360 N m holds the mean torque in stick up to mu_k = mu_s; at 0.2 there are 240 N m against 300.
    ({MU_K: 0.2}, ContinuationPlan(MU_K, 0.19, 0.29),
     r"slip grows without end at .* begin at --set .*=0\.\d+, where the motion settles in period \d+"),
    ({"pressure.mean": 2.6}, ContinuationPlan("engine.frequency", 100.0, 160.0),
     r"mean torque 300 N m exceeds what the clutch carries in slip, 0\.004992 N m .* 9 values of the range too")],
    ids=["at the scene's value", "everywhere"])
def test_where_slip_runs_away_the_error_says_why_and_where_to_begin(changes, plan: ContinuationPlan,
                                                                    words: str) -> None:
    with pytest.raises(NumericalFailure, match=words):
        continue_motions(replace(load_scene("fig02").system, {**RUNNING_AWAY, **changes}), plan)


def test_a_family_of_pure_slip_is_refused() -> None:
    system = replace(load_scene("slip").system, {"friction.kinetic_coefficient": 0.3})
    mean = system.engine.mean_torque / (0.3 * 0.08 * 0.1)
    system = replace(system, {"pressure.mean": mean / 1.0, "pressure.amplitude": 0.0})
    with pytest.raises(InputError, match="multiplier of exactly 1"):
        continue_motions(system, ContinuationPlan("engine.frequency", 140.0, 160.0))
