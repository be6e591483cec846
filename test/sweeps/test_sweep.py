"""Sweeps: equal to single solves whatever the number of jobs, hysteresis, failed points, interruption and resumption.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace as with_fields
from types import SimpleNamespace

import numpy as np
import pytest

from tcc_sim.analysis.summary import summarise
from tcc_sim.cli import main
from tcc_sim.errors import InputError, SweepInterrupted
from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.runs import LONGEST
from tcc_sim.sweeps import sweep as sweeps_of_one_key
from tcc_sim.sweeps.blocks import in_blocks
from tcc_sim.sweeps.steady_state import repeats_after
from tcc_sim.sweeps.sweep import (
    Curve,
    Plan,
    solve_point,
    solve_points,
    sweep,
    sweep_curves,
    sweep_grid,
    with_sweep_tolerance,
)
from tcc_sim.trajectory import State

KINETIC = "friction.kinetic_coefficient"
PAPER = {"pressure.mean": 225e3, "pressure.amplitude": 0.0, "initial.slip_speed": 150.0,
         "friction.static_coefficient": 0.3, KINETIC: 0.3, "friction.law": "set_valued"}


def interrupt(count: int) -> None:
    """Ctrl-C after a point."""
    raise KeyboardInterrupt


def system(ratio: float, **values: object) -> System:
    """The driveline of Sections 5 and 6 at omega/omega_n = `ratio`."""
    start = replace(System(), PAPER)
    return replace(start, {"engine.frequency": ratio * start.natural_frequency, **values})


def without_time(records: list[dict[str, object] | None]) -> list[dict[str, object]]:
    """Records less the one result that differs from run to run."""
    return [{k: v for k, v in r.items() if k != "elapsed_s"} for r in records if r is not None]


@pytest.mark.parametrize("direction", ["cold", "up", "down"])
def test_results_do_not_depend_on_the_number_of_jobs(direction: str) -> None:
    curves = [Curve(system(f), KINETIC, (0.3, 0.27, 0.285, 0.26)) for f in (0.2, 0.36)]
    plan = Plan(cycles=40, direction=direction)
    one, three = sweep_curves(curves, plan, jobs=1), sweep_curves(curves, plan, jobs=3)
    assert [without_time(s.records) for s in one] == [without_time(s.records) for s in three]


def test_up_goes_from_the_lowest_value_in_one_task_or_in_many() -> None:
    """A cluster solves several neighbours in one task."""
    mixed, rising, plan = (0.3, 0.24, 0.27), (0.24, 0.27, 0.3), Plan(cycles=30, direction="up")
    steps = {r["value"]: r for r in without_time(sweep(system(0.36), KINETIC, mixed, plan).records)}
    whole = solve_points([replace(system(0.36), {KINETIC: x}) for x in rising], rising, plan, None)
    assert [p.as_record()["final"] for p in whole] == [steps[x]["final"] for x in rising]
    cold = sweep(system(0.36), KINETIC, rising, Plan(cycles=30))
    assert cold.records[-1] != whole[-1].as_record()
    assert cold.column("max_slip_speed")[0] == steps[0.24]["max_slip_speed"]


def test_up_and_down_find_the_two_motions_that_coexist() -> None:
    """At omega/omega_n = 0.36 and mu_k = 0.86 mu_s period one and a large period two exist side by side."""
    up = sweep(system(0.36), KINETIC, np.linspace(0.74, 0.86, 7) * 0.3, Plan(cycles=150, direction="up"))
    down = sweep(system(0.36), KINETIC, np.linspace(0.86, 0.98, 7) * 0.3, Plan(cycles=150, direction="down"))
    high, low = up.records[-1], down.records[0]
    assert (low["period"], high["period"]) == (1, 2)
    assert high["max_slip_speed"] > 1.1 * low["max_slip_speed"]
    # SciPy agrees on both, from the final state that the sweep gives.
    for record in (low, high):
        smooth = replace(system(0.36), {KINETIC: 0.86 * 0.3, "friction.law": "smoothed", "friction.smoothing": 500.0})
        checked = summarise(solve(smooth, cycles=24, solver="lsoda", rtol=1e-8, state=State(*record["final"])), 16)
        assert checked.max_slip_speed == pytest.approx(record["max_slip_speed"], rel=0.03)


def test_auto_stops_when_the_section_has_settled() -> None:
    plan = Plan(cycles=2000, discard="auto")
    record = sweep(system(0.36), KINETIC, [0.3], plan).records[0]
    assert record["cycles"] < 500
    assert record["settled"]
    assert 0 < record["discarded"] < record["cycles"]
    cycles = solve(system(0.36), cycles=1000).cycles
    assert repeats_after(cycles[:10]) is None
    last = np.array(record["section"][0])
    assert last == pytest.approx(cycles.section[-1, [1, 0]], rel=1e-5, abs=1e-7)
    aperiodic = system(0.36, **{KINETIC: 0.64 * 0.3})
    never = sweep(aperiodic, KINETIC, [0.64 * 0.3], Plan(cycles=120, discard="auto")).records[0]
    assert (never["period"], never["cycles"], never["discarded"]) == (0, 120, 60)


@pytest.mark.parametrize("direction", ["cold", "down"])
def test_an_interrupted_sweep_goes_on_from_its_file(tmp_path, on_point, direction):
    plan = Plan(cycles=30, direction=direction)
    values = [float(x) for x in np.linspace(0.26, 0.3, 9)]
    whole = sweep(system(0.36), KINETIC, values, plan)
    out = tmp_path / "sweep.jsonl"

    def stop(count: int) -> None:
        if count == 4:
            raise KeyboardInterrupt

    on_point(stop)
    with pytest.raises(SweepInterrupted) as interruption:
        sweep(system(0.36), KINETIC, values, plan, out=out)
    assert sum(r is not None for r in interruption.value.sweeps[0].records) == 4
    assert not interruption.value.sweeps[0].complete
    out.write_bytes(out.read_bytes()[:-9])
    before = len(out.read_bytes().splitlines())
    resumed = sweep(system(0.36), KINETIC, values, plan, out=out)
    assert without_time(resumed.records) == without_time(whole.records)
    assert before == 1 + 4
    assert len(out.read_bytes().splitlines()) == 1 + 9
    again = sweep(system(0.36), KINETIC, values, plan, out=out)
    assert again.records == resumed.records


def test_the_command_that_was_interrupted_goes_on_by_itself(tmp_path, on_point, capsys):
    """Its own picture and JSON are not in its way."""
    words = ["sweep", "minimal", "--over", "initial.slip_speed=0:3:3", "--cycles",
                                                  "12", "--discard", "2", "--json", str(tmp_path / "s.json"), "--out",
                                                  str(tmp_path / "s.jsonl"), "--jobs", "1"]
    on_point(interrupt)
    assert main(words) == 130
    assert capsys.readouterr().err.endswith(f"interrupted; the same command resumes from {tmp_path / 's.jsonl'}\n")
    assert [path.name for path in tmp_path.iterdir()] == ["s.jsonl"]
    on_point(None)
    assert main(words) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s.json", "s.jsonl"]


def test_the_file_of_another_sweep_is_left_as_it_is(tmp_path) -> None:
    out = tmp_path / "sweep.jsonl"
    sweep(system(0.2), KINETIC, [0.3], Plan(cycles=5), out=out)
    before = out.read_bytes()
    with pytest.raises(InputError, match="another sweep"):
        sweep(system(0.2), KINETIC, [0.3], Plan(cycles=6), out=out)
    assert out.read_bytes() == before
    out.write_text("notes\n")
    with pytest.raises(InputError, match="not the file of a sweep"):
        sweep(system(0.2), KINETIC, [0.3], Plan(cycles=5), out=out)
    assert out.read_text() == "notes\n"


TORQUE = "engine.torque_amplitude"


def over(*ranges: str) -> list[str]:
    """Words of a sweep over several ranges."""
    return [word for each in ranges for word in ("--over", each)]


def scattered(bounds: str, samples: int) -> list[str]:
    """Words of a scatter of the torque's amplitude."""
    return ["--scatter", f"{TORQUE}={bounds}", "--samples", str(samples)]


@pytest.mark.parametrize(("words", "said"), [
    *((over(each), said) for each, said in (
        (f"{TORQUE}=10:40", "must be KEY="), (f"{TORQUE}=10:40:0", "has a count of 0"),
        (f"{TORQUE}=10:40:-3", "has a count of -3"), ("engine.torque_amplitud=10:40:3", "did you mean"),
        (f"{TORQUE}=nan:40:3", "nan"), (f"{KINETIC}=-0.1:0.5:3", "-0.1"), ("friction.law=1:2:2", "friction.law"),
        ("rate=100:200:2", "rate"), (f"{TORQUE}=-1:2:3:log", "logarithm"), (f"{TORQUE}=1:2:3:lin", "must be KEY="),
        (f"{TORQUE}=1,,2", "must be KEY="))),
    *((over(*ranges), said) for ranges, said in (
        ((f"{KINETIC}=0.2:0.3:2", f"{KINETIC}=0.2:0.3:2"), "swept twice"),
        ((f"{KINETIC}=0.2:0.3:2", "pressure.mean=1e5:2e5:2", "engine.frequency=1:2:2"), "3 times"),
        ((f"{KINETIC}=0.2:0.3:2000", "pressure.mean=1e5:2e5:2000"), "2000 by 2000"),
        ((f"{KINETIC}=0.2:0.3:2", "pressure.mean=-1:2e5:2"), "pressure.mean is -1 Pa"))),
    *(([*over(f"{TORQUE}=10:40:3"), option, value], option[2:]) for option, value in (
        ("--discard", "150"), ("--discard", "some"), ("--discard", "-1"), ("--jobs", "-1"), ("--jobs", "0"),
        ("--jobs", "1025"),
        ("--solver", "none"), ("--cycles", "0"), ("--rtol", "2"))),
    ([*over(f"{TORQUE}=1:2:3"), "--set", f"{TORQUE}=3"], "itself varies"),
    (["--samples", "4"], "--scatter"), (["--scatter", f"{TORQUE}=1:2"], "--samples"),
    (scattered("1", 4), "KEY=LOW:HIGH"), (scattered("1:2", 1), "samples is 1"),
    ([*scattered("1:2", 4), *over(f"{TORQUE}=1:2:3")], "swept and scattered"),
    ([*scattered("1:2", 4), "--set", f"{TORQUE}=3"], "itself varies")])
def test_wrong_input_is_one_line_and_status_2(words: list[str], said: str, refused) -> None:
    assert said in refused("sweep", "fig02", *words, "--out", "out.jsonl")


@pytest.mark.parametrize("values", [150, np.float32(150.0), [150], np.array([150.0]), iter((150.0,)), range(150, 151)])
def test_values_come_in_any_sequence_or_alone(values: Iterable[float]) -> None:
    assert sweep("slip", "engine.frequency", values, cycles=4).values == (150.0,)


@pytest.mark.parametrize("values", ["smoothed", ["smoothed"], [None], None, [[100.0], [150.0]]])
def test_values_that_are_no_numbers_are_wrong_input(values: list[float]) -> None:
    with pytest.raises(InputError, match=r"friction.law has the values .*; they must be numbers"):
        sweep("slip", "friction.law", values, cycles=4)
    with pytest.raises(InputError, match="they must be numbers"):
        sweep_grid("slip", "engine.frequency", [150.0], "friction.law", values, cycles=4)


SMOOTHED = replace(system(0.36), {"friction.law": "smoothed"})


@pytest.mark.parametrize("plan", [
    Plan(cycles=90, section_points=5, damping=True, lyapunov=True, lyapunov_cycles=60), Plan(cycles=120,
        discard="auto"),
    Plan(cycles=60, discard=3), Plan(cycles=30, solver="event_driven")], ids=["extras", "auto", "discard", "solver"])
def test_points_solved_together_are_those_solved_alone(plan: Plan) -> None:
    """Periods one and two, one that does not settle and one that runs away."""
    values = (0.3, 0.258, 0.192, 0.06)
    systems = [replace(system(0.36), {KINETIC: x}) for x in values]
    assert in_blocks(systems, plan)
    together = solve_points(systems, values, plan, None)
    for one, value, each in zip(together, values, systems):
        alone, with_others = solve_point(each, value, plan).as_record(), one.as_record()
        assert with_others == {**alone, "elapsed_s": with_others["elapsed_s"]}
    assert {each.summary.runaway for each in together} == {False, True}


def test_whole_cycles_from_rest_by_an_engine_are_solved_together() -> None:
    one, runup = system(0.36), load_scene("runup").system
    for systems, plan, together in (
            ([one, one], Plan(), True), ([SMOOTHED], Plan(discard="auto"), True), ([one, SMOOTHED], Plan(), False),
            ([one], Plan(direction="up"), False), ([one], Plan(orders=()), False), ([one], Plan(duration=1.0), False),
            ([runup], Plan(), False), ([runup], Plan(cycles=9), False), ([SMOOTHED], Plan(solver="radau"), False),
            ([one], Plan(cycles=LONGEST), True), ([one], Plan(cycles=LONGEST + 1), False)):
        assert in_blocks(systems, plan) == together


def test_only_points_that_failed_together_are_solved_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweeps_of_one_key, "solve_block", lambda systems, values, plan: [None, "together", None])
    monkeypatch.setattr(sweeps_of_one_key, "solve_point", lambda system, value, plan: ("alone", value, plan))
    plan, three = Plan(cycles=30), [system(0.36)] * 3
    assert solve_points(three, (1.0, 2.0, 3.0), plan, None) == [("alone", 1.0, plan), "together", ("alone", 3.0, plan)]


def test_a_sweep_goes_on_behind_its_last_solved_value(monkeypatch: pytest.MonkeyPatch) -> None:
    """Up from 0.26 over 0.28 to 0.3, from the end of the neighbour below."""
    monkeypatch.setattr(sweeps_of_one_key, "handed_over", lambda before, end, after: (
        before.friction.kinetic_coefficient, end, after.friction.kinetic_coefficient))
    curve, end = Curve(system(0.36), KINETIC, (0.3, 0.26, 0.28)), SimpleNamespace(end="its end")
    for solved, batch, tasks in (
            ([], 1, [([(0, 1)], None)]), ([1], 1, [([(0, 2)], (0.26, "its end", 0.28))]),
            ([1], 5, [([(0, 2), (0, 0)], (0.26, "its end", 0.28))]), ([1, 2], 1, [([(0, 0)], (0.28, "its end", 0.3))]),
            ([0, 1, 2], 1, [])):
        points = [[end if k in solved else None for k in range(3)]]
        assert list(sweeps_of_one_key._tasks([curve], Plan(direction="up"), batch, points)) == tasks


def test_the_order_the_batch_and_the_tolerance_of_a_sweep() -> None:
    curve = Curve(system(0.36), KINETIC, (0.3, 0.26, 0.28, 0.26))
    for direction, order in (("cold", [0, 1, 2, 3]), ("up", [1, 3, 2, 0]), ("down", [0, 2, 3, 1])):
        assert sweeps_of_one_key._order(curve, Plan(direction=direction)) == order
    for cycles, points, threads, batch in ((150, 1000, 2, 32), (2000, 1000, 2, 2), (10_000, 1000, 2, 1), (150, 13, 2,
        2),
                                           (150, 4, 2, 1), (150, 1000, 200, 1)):
        assert sweeps_of_one_key._batch(Plan(cycles=cycles), points, threads) == batch
        assert sweeps_of_one_key._batch(Plan(cycles=cycles, direction="up"), points, threads) == 1
    for plan, rtol in ((Plan(), 1e-6), (Plan(rtol=1e-9), 1e-9), (Plan(rtol=1e-3), 1e-3), (Plan(discard="auto"), None),
                       (Plan(solver="fixed_step"), None), (Plan(solver="rk4"), None), (Plan(solver="rk45"), None)):
        assert with_sweep_tolerance(SMOOTHED, plan) == with_fields(plan, rtol=rtol)


def test_curves_of_both_laws_and_of_different_lengths_are_solved_in_one_call(tmp_path) -> None:
    """One of the tasks would have both laws; a file has every point once."""
    curves = [Curve(each, KINETIC, values) for each, values in (
        (system(0.36), (0.3,)), (SMOOTHED, (0.3, 0.25)), (system(0.2), (0.29, 0.28, 0.27)))]
    for plan in (Plan(cycles=12), Plan(cycles=12, direction="down")):
        out = tmp_path / f"{plan.direction}.jsonl"
        together = sweep_curves(curves, plan, jobs=1, out=out)
        assert out.read_bytes().count(b"\n") == 7
        for curve, result in zip(curves, together):
            assert result.complete
            assert result.seconds > 0.0
            alone, = sweep_curves([curve], plan)
            assert without_time(result.records) == without_time(alone.records)
    with pytest.raises(InputError, match=r"^discard is 12; it must be 0 to 11, since 12 whole cycles are solved$"):
        sweep_curves(curves, Plan(cycles=12, discard=12), out=tmp_path / "none.jsonl")
    assert not (tmp_path / "none.jsonl").exists()
