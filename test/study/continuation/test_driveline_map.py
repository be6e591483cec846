"""Scenes as maps: pure stick in closed form, its border, derivatives, refusals, and known bifurcations."""

import math
from typing import Any

import by_auto
import numpy as np
import pytest
from independent import multipliers
from interpreter import python

from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.model.closed_forms import constant_load_limits
from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.study.continuation.arclength import StopReason
from tcc_sim.study.continuation.branch import branch_through, first_point
from tcc_sim.study.continuation.motions import (
    ContinuationPlan,
    DrivelineMap,
    Motions,
    Seed,
    check,
    continue_motions,
    start_orbit,
)
from tcc_sim.study.continuation.orbits import ParameterRange, Settings, Shooting, newton

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
    result = start_orbit(map_, ParameterRange(290.0, 310.0), 300.0, None)
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
    assert np.abs(multipliers(doubled_scene, item.point.section, 1) + 1.0).min() < 1e-6
    if law == "smoothed":
        assert item.value / 0.3 == pytest.approx(by_auto.DOUBLING, abs=1e-8)
    assert result.branches[0].points[0].stable != result.branches[0].points[-1].stable


def a_canard_ends_a_branch_with_a_sentence() -> None:
    """Check the branch of period two down to its canard; a test calls this in a process of its own."""
    result = continue_motions(coexistence("smoothed", 0.85), ContinuationPlan(MU_K, 0.18, 0.297, period=2))
    (branch,) = result.branches
    assert any(end.reason is StopReason.CANARD and "1e+10" in str(end) for end in branch.ended)
    assert max(abs(s.multipliers[0]) for s in branch.points) <= 1e10
    folds = sorted((f for f in result.bifurcations if f.kind == "fold"), key=lambda f: f.value)
    assert [f.value / 0.3 for f in folds] == pytest.approx(by_auto.FOLDS, abs=1e-8)
    assert max(np.abs(f.point.multipliers - 1.0).min() for f in folds) < 1e-7
    assert max(s.residual for s in branch.points) < 1e-8
    assert not branch.points[0].stable
    assert not branch.points[-1].stable
    assert max(f.residual for f in result.bifurcations) < 1e-8
    # Branch ends in the doubling of period one, which is no fold.
    assert min(s.value for s in branch.points[-3:]) / 0.3 == pytest.approx(by_auto.DOUBLING, abs=1e-7)


def test_a_canard_ends_a_branch_and_rounding_lets_none_pass_the_doubling_at_its_end() -> None:
    """These kernels of OpenBLAS round so that the determinant changes its sign beside the doubling."""
    code = "import test_driveline_map as here; here.a_canard_ends_a_branch_with_a_sentence()"
    ended = python("-c", code, OPENBLAS_CORETYPE="Sandybridge")
    assert ended.returncode == 0, ended.stderr


def test_period_one_through_pure_creep_has_a_doubling_and_every_fold() -> None:
    system = coexistence("smoothed", 0.83)
    unit = system.natural_frequency
    plan = ContinuationPlan("engine.frequency", 0.35 * unit, 0.47 * unit, period=1, switch=1)
    result = continue_motions(replace(system, {"engine.frequency": 0.4 * unit}), plan)
    first = result.branches[0]
    assert [end.value / unit for end in first.ended] == pytest.approx([0.35, 0.47])
    at = {f.kind: f.value / unit for f in first.bifurcations if f.value < 0.43 * unit}
    assert at.keys() == {"period_doubling", "fold"}
    assert at["fold"] == pytest.approx(at["period_doubling"], abs=1e-7)  # A canard has all multipliers within that.
    assert max(f.residual for f in first.bifurcations) < 1e-8
    assert max(abs(s.multipliers[0]) for s in first.points) > 1e9
    for branch in result.branches:  # Where the largest slip is no good coordinate too.
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
    assert branch.ended[1].reason is StopReason.POINTS
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


@pytest.mark.parametrize(("key", "values", "words"), [
    ("friction.law", {}, "smoothed"), ("engine.harmonic_amplitudes", {}, "one number"),
    ("engine.speed", {}, "engine.frequency"), ("initial.slip_speed", {}, ""),
    *((key, {}, "") for key in ("engine.order", "pressure.time_constant", "pressure.delay", "pressure.rate_limit")),
    ("friction.smoothing", SET_VALUED, "friction.law"), (RATIO, {}, ""),
    *((key, {"pressure.amplitude": 0.0}, "pressure.amplitude is 0") for key in (RATIO, "pressure.phase")),
    ("friction.decay", {MU_K: 0.3}, MU_K), ("engine.frequncy", {}, "engine.frequency"),
    ("engine.mean_torque", {RATIO: math.pi}, "")])
def test_keys_in_which_no_motion_can_be_followed(key: str, values: dict[str, object], words: str) -> None:
    with pytest.raises(InputError) as error:
        DrivelineMap(replace(load_scene("fig02").system, values), (key,))
    assert words in str(error.value)
    assert key in str(error.value) or RATIO in values


def test_a_key_may_have_effect_under_another_law_or_beside_another_free_one() -> None:
    for free, laws in (("friction.smoothing", {}), ("friction.decay", SET_VALUED), ("pressure.phase", SET_VALUED)):
        assert DrivelineMap(replace(load_scene("fig02").system, laws), (free,)).piecewise is bool(laws)
    system = replace(load_scene("fig02").system, {"pressure.amplitude": 0.0, MU_K: 0.3})
    assert DrivelineMap(system, ("pressure.amplitude", "pressure.phase")).keys[1] == "pressure.phase"
    assert DrivelineMap(system, (MU_K, "friction.decay")).keys[1] == "friction.decay"
    assert DrivelineMap(system, ("engine.frequency",)).keys == ("engine.frequency",)


PRESSURE = "pressure.mean"
TO_STATIC = ("friction.static_coefficient", 0.2, 0.5)


@pytest.mark.parametrize(("low", "high", "how", "words"), [
    (0.2, 0.2, {}, ("0.2",)), (0.3, 0.2, {}, ("0.3", "0.2")),
    (0.2, 0.3, {"period": 0}, ("--period", "0", "1 to 16")), (0.2, 0.3, {"period": 17}, ("--period", "17", "1 to 16")),
    (0.2, 0.3, {"period": 3}, ("--period", "3", "2")),
    (0.2, 0.3, {"switch": -1}, ("--switch", "-1", "0 to 8")), (0.2, 0.3, {"switch": 9}, ("--switch", "9", "0 to 8")),
    (0.2, 0.3, {"at": (0.2, 0.19)}, ("--at", "0.19", "0.2 to 0.3")),
    (0.2, 0.3, {"at": (0.31,)}, ("0.31", "0.2 to 0.3")),
    (0.2, 0.3, {"seeds": (Seed(0.19, (0.0, 0.0, 0.0), 1),)}, (MU_K, "0.19", "0.2 to 0.3")),
    (0.2, 0.3, {"second": (MU_K, 1.0, 2.0)}, ("--second", MU_K)),
    (0.2, 0.3, {"second": (PRESSURE, 2.0, 2.0)}, ("--second", "2")),
    (0.2, 0.3, {"second": (PRESSURE, 1e5, 2e5)}, ("--second", "100000", "200000", PRESSURE, "260417")),
    (0.02, 0.3, {"second": TO_STATIC}, (MU_K, "0.02", "0.025 to 10"))])
def test_a_plan_that_cannot_be_carried_out_is_refused(low: float, high: float, how: dict[str, Any],
                                                      words: tuple[str, ...]) -> None:
    system = replace(load_scene("fig02").system, {RATIO: 0.5})
    with pytest.raises(InputError) as error:
        check(system, ContinuationPlan(MU_K, low, high, **how))
    assert all(word in str(error.value) for word in words), str(error.value)


def test_a_plan_may_reach_its_bounds() -> None:
    ends = tuple(Seed(value, (0.0, 0.0, 0.0), 1) for value in (0.2, 0.3))
    for period, switch in ((1, 0), (16, 8)):
        check(load_scene("fig02").system, ContinuationPlan(MU_K, 0.2, 0.3, period, (0.2, 0.3), switch, seeds=ends))


RUNNING_AWAY = {"friction.law": "set_valued", PRESSURE: 150e3, "pressure.amplitude": 0.0}
# mu_s Pm A R = 360 N m holds the mean torque in stick up to mu_k = mu_s; at 0.2 there are 240 N m against 300.
CREEPING = {**CONSTANT_LOAD, "engine.frequency": 0.36 * load_scene("fig02").system.natural_frequency, MU_K: 0.255}


@pytest.mark.parametrize(("changes", "plan", "words"), [
    (CREEPING, ContinuationPlan(MU_K, 0.25, 0.26, period=3), ("period 3",)),
    ({**RUNNING_AWAY, MU_K: 0.2}, ContinuationPlan(MU_K, 0.19, 0.29), (f"--set {MU_K}=0.", "period")),
    ({**RUNNING_AWAY, PRESSURE: 2.6}, ContinuationPlan("engine.frequency", 100.0, 160.0), ("300 N m", "0.004992 N m"))],
    ids=["another period", "runaway at the scene's value", "runaway everywhere"])
def test_where_no_motion_is_found_the_error_says_why_and_where_to_begin(changes, plan: ContinuationPlan,
                                                                        words: tuple[str, ...]) -> None:
    with pytest.raises(NumericalFailure) as error:
        continue_motions(replace(load_scene("fig02").system, changes), plan)
    assert all(word in str(error.value) for word in words), str(error.value)
    if "--set" in words[0]:  # There the scene settles, and its motion is followed.
        value = float(str(error.value).split(f"{MU_K}=")[1].split(",")[0])
        begun = replace(load_scene("fig02").system, {**changes, MU_K: value})
        assert continue_motions(begun, ContinuationPlan(MU_K, value - 1e-3, value + 1e-3)).branches


def test_a_branch_goes_through_a_doubling_where_its_parameter_stands_still() -> None:
    system = replace(load_scene("fig02").system, {"friction.smoothing": 1e4, "friction.decay": 0.02})
    (branch,) = continue_motions(system, ContinuationPlan("friction.decay", 0.0, 0.03)).branches
    assert branch.period == 2
    assert branch.ended[0].reason is StopReason.DOUBLING


def test_rounding_makes_no_bifurcation_of_a_motion_without_damping() -> None:
    system = replace(load_scene("stick").system, {"friction.law": "set_valued", "driveline.damping": 0.0})
    result = continue_motions(system, ContinuationPlan("driveline.stiffness", 2500.0, 3500.0))
    assert result.bifurcations == []
    assert not any(s.stable for s in result.branches[0].points)


def test_a_family_of_pure_slip_is_refused() -> None:
    system = replace(load_scene("slip").system, {"friction.kinetic_coefficient": 0.3})
    mean = system.engine.mean_torque / (0.3 * 0.08 * 0.1)
    system = replace(system, {"pressure.mean": mean / 1.0, "pressure.amplitude": 0.0})
    with pytest.raises(InputError):
        continue_motions(system, ContinuationPlan("engine.frequency", 140.0, 160.0))
