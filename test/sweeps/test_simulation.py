"""`simulate` is a sweep of one point: the same numbers from the verb, from a sweep and from Python."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from tcc_sim.analysis.steady.summary import summarise
from tcc_sim.cli import main
from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.model.parameters import replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.sweeps.simulation import Plan, Start, simulate
from tcc_sim.sweeps.sweep import handed_over, sweep
from tcc_sim.trajectory import State

PLAN = Plan(cycles=60, discard=20, rtol=1e-8, damping=True, lyapunov=True)


def untimed(values: dict[str, object]) -> dict[str, object]:
    return {k: v for k, v in values.items() if k not in ("elapsed_s", "scene")}


def test_the_verb_a_sweep_and_python_give_the_same(tmp_path) -> None:
    path = tmp_path / "one.json"
    assert main(["simulate", "fig02", "--cycles", "60", "--discard", "20", "--rtol", "1e-8", "--damping", "--lyapunov",
                 "--json", str(path)]) == 0
    verb = untimed(json.loads(path.read_text()))
    scene = load_scene("fig02")
    alone = untimed(json.loads(json.dumps(simulate(scene, PLAN).as_json())))
    for key, value in alone.items():
        assert verb[key] == value, key
    assert untimed(json.loads(json.dumps(simulate("fig02", cycles=60, discard=20, rtol=1e-8, damping=True,
                                                  lyapunov=True).as_json()))) == alone
    (record,) = sweep(scene.system, "engine.frequency", [scene.system.engine.frequency], PLAN).records
    point = untimed(json.loads(json.dumps(record)))
    assert alone.keys() - point.keys() == {"section_states", "plan"}  # Those of a sweep would be long, and the same.
    for key in alone.keys() & point.keys():
        assert point[key] == alone[key], key


@pytest.mark.parametrize("law", ["set_valued", "smoothed"])
def test_a_driveline_at_rest_has_period_one(law: str) -> None:
    """Stuck under constant inputs: the plate's speed is rounding."""
    for torque in (39.0, 116.0, 300.0):
        result = simulate(load_scene("stick").with_values({
            "friction.law": law, "engine.mean_torque": torque, "engine.torque_amplitude": 0.0,
            "pressure.amplitude": 0.0, "driveline.damping": 60.0}))
        assert (result.summary.period, result.summary.settled, result.confirmed) == (1, True, True)
        assert result.summary.section[0][0] == pytest.approx(torque / 3000.0)


def test_a_decaying_spiral_near_a_resonance_has_the_period_of_its_limit() -> None:
    """The plate's free vibration turns by nearly a third of a turn a cycle while it dies out."""
    scene = load_scene("slip").with_values({"driveline.damping": 0.1233, "engine.frequency": 1161.858217})
    result = simulate(scene)
    assert (result.summary.period, result.summary.settled, result.confirmed) == (1, False, False)
    ((angle, _),) = result.summary.section
    late = simulate(scene, cycles=2000, discard=1900)
    assert (late.summary.period, late.summary.settled, late.confirmed) == (1, True, True)
    assert angle == pytest.approx(late.summary.section[0][0], rel=0.15)
    (record,) = sweep(scene.system, "engine.frequency", [1161.858217]).records
    assert (record["period"], record["settled"], record["confirmed"]) == (1, False, False)


@pytest.mark.parametrize(("amplitude", "ratio", "kinetic", "frequency", "period"), [
    (56250.0, 0.5, 0.3, 193.64916731037084, 2), (56250.0, 2.0 / 3.0, 0.3, 193.64916731037084, 3),
    (56250.0, 4.0 / 3.0, 0.3, 193.64916731037084, 3), (112500.0, 1.0, 0.225, 140.0232440551912, 1)])
def test_motions_of_the_paper_that_settle_slowly_have_the_period_of_2000_cycles(
        amplitude: float, ratio: float, kinetic: float, frequency: float, period: int) -> None:
    """Figs. 10, 11 and 18. Those with mu_k = mu_s have that of the load, as the paper says of omega_f = (M/N) omega."""
    scene = load_scene("fig02").with_values({
        "pressure.mean": 225e3, "pressure.amplitude": amplitude, "pressure.frequency_ratio": ratio,
        "friction.kinetic_coefficient": kinetic, "engine.frequency": frequency})
    late = simulate(scene, cycles=2000, discard=1800)
    assert (late.summary.period, late.confirmed) == (period, True)
    early = simulate(scene)
    assert early.summary.period in (0, period)
    assert not early.confirmed or early.summary.settled


def test_what_is_asked_for_is_there_and_nothing_else() -> None:
    plain = simulate("fig02", cycles=20)
    assert plain.damping is None
    assert plain.lyapunov is None
    assert "lyapunov" not in plain.as_json()
    assert len(plain.trajectory.t) == 2
    sampled = simulate("fig02", cycles=20, samples_per_cycle=10, section_points=5)
    assert len(sampled.trajectory.t) == 201
    cycles = sampled.trajectory.cycles
    assert sampled.angles.tolist() == cycles.section[-5:, 1].tolist()
    assert sampled.end == Start(State(*cycles.section[-1].tolist()), 20)


def test_a_start_sets_the_phase_and_goes_on_where_another_run_ended() -> None:
    system = replace(load_scene("fig02").system, {"pressure.frequency_ratio": 0.5})
    first = simulate(system, cycles=31, discard=0)
    second = simulate(system, cycles=20, discard=0, start=first.end)
    whole = solve(system, cycles=51).cycles
    assert second.end.cycle == 51
    kept = simulate(system, cycles=20, discard=5, start=first.end).summary
    assert (kept.covers, kept.discarded) == (pytest.approx((36 * system.cycle, 51 * system.cycle)), 5)
    assert kept.section == pytest.approx(np.array(summarise(solve(system, cycles=51), 36).section), rel=1e-4)
    assert second.end.state.plate_angle == pytest.approx(whole.section[-1, 1], rel=1e-5)


RANGE = "1 to 10000000"


@pytest.mark.parametrize(("options", "words"), [
    ({"cycles": 10, "discard": 10}, ("discard", "10", "0 to 9")), ({"cycles": 2}, None),
    ({"discard": -1}, ("discard", "-1")), ({"discard": np.int64(-1)}, ("discard", "-1")),
    ({"discard": 1.5}, ("discard", "1.5")), ({"discard": "some"}, ("discard", "some", "auto")),
    ({"duration": -1.0}, ("duration", "-1 s")), ({"duration": 0.1, "discard": 2}, ("discard", "2", "0 to 1")),
    ({"duration": 0.5, "cycles": 3}, ("duration", "0.5 s", "cycles")),
    ({"duration": 0.5, "discard": "auto"}, ("duration", "0.5 s", "auto")),
    ({"cycles": 1.5}, ("cycles", "1.5", RANGE)), ({"cycles": "3"}, ("cycles", "3", RANGE)),
    ({"cycles": 2.0}, ("cycles", "2.0", RANGE)), ({"cycles": 0}, ("cycles", "0", RANGE)),
    ({"cycles": 10_000_001}, ("cycles", "10000001", RANGE)), ({"solver": "euler"}, ("euler",)),
    ({"cycle": 3}, ("cycle", "cycles")), ({"direction": "left"}, ("direction", "left", "cold or up or down")),
    ({"section_points": -1}, ("section_points", "-1", "0 to 10000000")),
    ({"section_points": 10_000_001}, ("section_points", "10000001", "0 to 10000000")),
    ({"orders": (100.0, 0.0)}, ("orders", "100, 0 rad/s", "above 0")),
    ({"orders": (math.inf,)}, ("orders", "inf rad/s", "above 0")),
    ({"solver": "fixed_step", "rtol": 1e-6}, ("rtol",))])
def test_wrong_settings_are_refused(options: dict[str, object], words: tuple[str, ...] | None) -> None:
    if words is None:
        assert simulate("fig02", **options).summary.discarded == 1
        return
    with pytest.raises(InputError) as error:
        simulate("fig02", **options)
    assert all(word in str(error.value) for word in words), str(error.value)
    with pytest.raises(InputError):
        simulate("fig02", Plan(), cycles=3)


def test_a_profile_is_solved_to_its_end_and_has_no_steady_state() -> None:
    """A word of the command line is equal to a literal, and another object."""
    runup = load_scene("tip_in")
    run = simulate(runup)
    assert run.trajectory.t[-1] == pytest.approx(runup.system.span)
    assert simulate(runup, duration=0.5).trajectory.t[-1] == pytest.approx(0.5)
    assert run.summary.discarded == simulate(runup, duration=0.5).summary.discarded == 0
    for options in ({"lyapunov": True}, {"damping": True}, {"direction": "up"}, {"discard": "".join(["au", "to"])}):
        with pytest.raises(InputError, match="_times"):
            simulate(runup, **options)


def test_a_failure_is_a_status_and_can_be_raised() -> None:
    refused = simulate("fig02", solver="fixed_step", step=1.0, cycles=3)
    assert refused.summary is None
    assert refused.as_json().keys() == {"confirmed", "plan"}
    with pytest.raises(InputError):
        refused.raise_for_status()
    failed = simulate("fig02", solver="rk4", step=0.02, cycles=400)
    assert failed.summary is None
    assert failed.end == Start(State(150.0, 0.0, 0.0), 0)
    with pytest.raises(NumericalFailure):
        failed.raise_for_status()


@pytest.mark.parametrize("cycles", [400, 401])
def test_a_neighbour_takes_up_both_phases(cycles: int) -> None:
    """Two values that differ by 1e-12: the second point must go on as if nothing had changed."""
    scene = load_scene("fig02").with_values({"pressure.frequency_ratio": 0.5, "friction.kinetic_coefficient": 0.29})
    for key, value in (("friction.kinetic_coefficient", 0.29), ("engine.frequency", 150.0)):
        swept = sweep(scene.system, key, [value, value * (1.0 + 1e-12)],
                      Plan(cycles=cycles, discard=cycles - 1, direction="up"))
        whole = solve(scene.system, cycles=cycles + 2).cycles
        point = swept.points[1]
        assert point.end.state.plate_angle == pytest.approx(whole.section[cycles + cycles % 2, 1], abs=1e-6)
        first = simulate(replace(scene.system, {key: value * (1.0 + 1e-12)}), cycles=2, discard=0,
                         start=handed_over(scene.system, swept.points[0].end, scene.system))
        run = first.trajectory.cycles
        assert run.section[1] == pytest.approx(whole.section[cycles + 1], abs=1e-5)


def load_phase(system, cycle: int) -> float:
    """Of the pressure at the start of an engine cycle, in turns."""
    return (system.pressure.frequency_ratio * cycle + system.pressure.phase / (2.0 * math.pi)) % 1.0


@pytest.mark.parametrize(("before", "after", "largest"), [
    (0.5, 0.5, 1e-12), (0.5, 2.0 / 3.0, 0.17), (0.7, 0.71, 0.005), (2.0, 0.5, 1e-12),
                                                          (math.sqrt(0.5), math.sqrt(0.5), 0.0),
    (math.sqrt(0.5), math.sqrt(0.7), 1e-3)])
def test_the_load_goes_on_at_the_nearest_phase_where_its_own_ratio_is_swept(before, after, largest):
    system = load_scene("fig02").system
    old, new = (replace(system, {"pressure.frequency_ratio": x, "pressure.phase": 0.4}) for x in (before, after))
    for cycle in (7, 150, 401):
        start = handed_over(old, Start(State(1.0, 2.0, 3.0), cycle), new)
        assert start.state == State(1.0, 2.0, 3.0)
        apart = abs(load_phase(new, start.cycle) - load_phase(old, cycle))
        assert min(apart, 1.0 - apart) <= largest + 1e-12
    assert handed_over(replace(old, {"pressure.amplitude": 0.0}), start,
                       replace(new, {"pressure.amplitude": 0.0})).cycle == 0


def test_up_from_a_file_takes_up_the_phase_too(tmp_path) -> None:
    system = replace(load_scene("fig02").system, {"pressure.frequency_ratio": math.sqrt(0.5)})
    plan, out = Plan(cycles=15, direction="up"), tmp_path / "up.jsonl"
    values = [140.0, 145.0, 150.0]
    whole = sweep(system, "engine.frequency", values, plan, out=out)
    lines = out.read_bytes().splitlines(keepends=True)
    assert [json.loads(line)["record"]["final_cycle"] for line in lines[1:]] == [15, 30, 45]
    out.write_bytes(b"".join(lines[:2]))
    again = sweep(system, "engine.frequency", values, plan, out=out)
    assert [untimed(r) for r in again.records if r] == [untimed(r) for r in whole.records if r]
    cold = sweep(system, "engine.frequency", values, Plan(cycles=15))
    assert not np.allclose(cold.column("max_slip_speed")[1:], whole.column("max_slip_speed")[1:])


@pytest.mark.parametrize("rest", [0.0, 0.5])
def test_a_duration_has_its_whole_cycles_and_the_part_behind_them(rest: float) -> None:
    """A third of them is dropped, and at most 50."""
    system = load_scene("slip").system
    for whole, dropped in ((10, 3), (180, 50)):
        run = simulate(system, duration=(whole + rest) * system.cycle).summary
        assert (run.cycles, run.discarded) == (whole, dropped)
        assert run.covers == pytest.approx((dropped * system.cycle, (whole + rest) * system.cycle))
        assert run.seconds == pytest.approx((whole + rest - dropped) * system.cycle)


@pytest.mark.parametrize(("most", "dropped"), [(60, 50), (130, 65), (131, 66), (1, 0)])
def test_auto_drops_half_and_at_least_fifty_if_nothing_settles(most: int, dropped: int) -> None:
    result = simulate("chaos", cycles=most, discard="auto")
    assert (result.summary.cycles, result.summary.discarded) == (most, dropped)
    assert result.summary.transient
    sampled = simulate("chaos", cycles=most, discard="auto", samples_per_cycle=4)
    assert len(sampled.trajectory.t) == 4 * most + 1
    assert sampled.summary.max_slip_speed == pytest.approx(result.summary.max_slip_speed, rel=1e-6)
