"""Sweeps: equal to single solves whatever the number of jobs, hysteresis, failed points, interruption and resumption.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterable
from dataclasses import replace as with_fields

import numpy as np
import pytest
from waiting import until

from tcc_sim.analysis.steady.summary import summarise
from tcc_sim.cli import main
from tcc_sim.errors import InputError, SweepInterrupted
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve
from tcc_sim.sweeps.simulation import repeats_after, simulate
from tcc_sim.sweeps.sweep import Curve, Plan, solve_points, sweep, sweep_curves, sweep_grid
from tcc_sim.trajectory import State

KINETIC = "friction.kinetic_coefficient"
PAPER = {"pressure.mean": 225e3, "pressure.amplitude": 0.0, "initial.slip_speed": 150.0,
         "friction.static_coefficient": 0.3, KINETIC: 0.3, "friction.law": "set_valued"}


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
        smooth = replace(system(0.36), {KINETIC: 0.86 * 0.3, "friction.law": "smoothed", "friction.smoothing": 500.0,
                                        "pressure.amplitude": 1.0})
        checked = summarise(solve(smooth, cycles=12, solver="lsoda", rtol=1e-6, state=State(*record["final"])), 8)
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


@pytest.mark.parametrize("direction", ["cold", "up", "down"])
def test_an_interrupted_sweep_goes_on_from_its_file(tmp_path, direction):
    plan, values = Plan(cycles=30, direction=direction), tuple(np.linspace(0.26, 0.3, 9).tolist())
    curve, out, seen = Curve(system(0.36), KINETIC, values), tmp_path / "sweep.jsonl", []
    whole, = sweep_curves([curve], plan)

    def tick(point) -> None:
        seen.append(point)
        if len(seen) == 4:
            raise KeyboardInterrupt

    with pytest.raises(SweepInterrupted) as interruption:
        sweep_curves([curve], plan, out=out, tick=tick)
    part, = interruption.value.sweeps
    assert (sum(r is not None for r in part.records), part.complete) == (4, False)
    assert len(out.read_bytes().splitlines()) == 1 + 4
    out.write_bytes(out.read_bytes()[:-9])
    resumed, = sweep_curves([curve], plan, out=out)
    assert without_time(resumed.records) == without_time(whole.records)
    assert len(out.read_bytes().splitlines()) == 1 + 9
    again, = sweep_curves([curve], plan, out=out)
    assert again.records == resumed.records


def test_the_command_that_was_interrupted_goes_on_by_itself(tmp_path, capsys):
    """Its own picture and JSON are not in its way."""
    out = tmp_path / "s.jsonl"
    words = ["sweep", "minimal", "--over", "initial.slip_speed=0:3:60", "--cycles", "600", "--discard", "2", "--json",
             str(tmp_path / "s.json"), "--out", str(out), "--jobs", "1"]

    def ctrl_c() -> None:
        until(lambda: out.exists() and out.read_bytes().count(b"\n") > 1)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=ctrl_c)
    thread.start()
    assert main(words) == 130
    thread.join()
    assert str(out) in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["s.jsonl"]
    before = out.read_bytes()
    assert main(words) == 0
    assert out.read_bytes().startswith(before)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s.json", "s.jsonl"]


def test_the_file_of_another_sweep_is_left_as_it_is(tmp_path) -> None:
    out = tmp_path / "sweep.jsonl"
    sweep(system(0.2), KINETIC, [0.3], Plan(cycles=5), out=out)
    before = out.read_bytes()
    with pytest.raises(InputError, match=r"sweep\.jsonl"):
        sweep(system(0.2), KINETIC, [0.3], Plan(cycles=6), out=out)
    assert out.read_bytes() == before
    out.write_text("notes\n")
    with pytest.raises(InputError, match=r"sweep\.jsonl"):
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
        (f"{TORQUE}=10:40", "KEY="), (f"{TORQUE}=10:40:0", "count of 0"),
        (f"{TORQUE}=10:40:-3", "count of -3"), ("engine.torque_amplitud=10:40:3", "engine.torque_amplitude?"),
        (f"{TORQUE}=nan:40:3", "nan"), (f"{KINETIC}=-0.1:0.5:3", "-0.1"), ("friction.law=1:2:2", "friction.law"),
        ("rate=100:200:2", "rate"), (f"{TORQUE}=-1:2:3:log", "above 0"), (f"{TORQUE}=1:2:3:lin", "KEY="),
        (f"{TORQUE}=1,,2", "KEY="))),
    *((over(*ranges), said) for ranges, said in (
        ((f"{KINETIC}=0.2:0.3:2", f"{KINETIC}=0.2:0.3:2"), KINETIC),
        ((f"{KINETIC}=0.2:0.3:2", "pressure.mean=1e5:2e5:2", "engine.frequency=1:2:2"), "3"),
        ((f"{KINETIC}=0.2:0.3:2000", "pressure.mean=1e5:2e5:2000"), "2000"),
        ((f"{KINETIC}=0.2:0.3:2", "pressure.mean=-1:2e5:2"), "pressure.mean is -1 Pa"))),
    *(([*over(f"{TORQUE}=10:40:3"), option, value], option[2:]) for option, value in (
        ("--discard", "150"), ("--discard", "some"), ("--discard", "-1"), ("--jobs", "-1"), ("--jobs", "0"),
        ("--jobs", "1025"),
        ("--solver", "none"), ("--cycles", "0"), ("--rtol", "2"))),
    ([*over(f"{TORQUE}=1:2:3"), "--set", f"{TORQUE}=3"], TORQUE),
    (["--samples", "4"], "--scatter"), (["--scatter", f"{TORQUE}=1:2"], "--samples"),
    (scattered("1", 4), "KEY=LOW:HIGH"), (scattered("1:2", 1), "samples"),
    ([*scattered("1:2", 4), *over(f"{TORQUE}=1:2:3")], TORQUE),
    ([*scattered("1:2", 4), "--set", f"{TORQUE}=3"], TORQUE)])
def test_wrong_input_is_one_line_and_status_2(words: list[str], said: str, refused) -> None:
    assert said in refused("sweep", "fig02", *words, "--out", "out.jsonl")


@pytest.mark.parametrize("values", [150, np.float32(150.0), [150], np.array([150.0]), iter((150.0,)), range(150, 151)])
def test_values_come_in_any_sequence_or_alone(values: Iterable[float]) -> None:
    assert sweep("slip", "engine.frequency", values, cycles=4).values == (150.0,)


@pytest.mark.parametrize("values", ["smoothed", ["smoothed"], [None], None, [[100.0], [150.0]]])
def test_values_that_are_no_numbers_are_wrong_input(values: list[float]) -> None:
    with pytest.raises(InputError, match=r"friction\.law"):
        sweep("slip", "friction.law", values, cycles=4)
    with pytest.raises(InputError, match=r"friction\.law"):
        sweep_grid("slip", "engine.frequency", [150.0], "friction.law", values, cycles=4)


SMOOTHED = replace(system(0.36), {"friction.law": "smoothed"})


@pytest.mark.parametrize(("plan", "rtol"), [
    (Plan(cycles=20), 1e-6), (Plan(cycles=20, rtol=1e-9), 1e-9), (Plan(cycles=20, rtol=1e-3), 1e-3),
    (Plan(cycles=20, discard="auto"), None), (Plan(cycles=20, solver="rk45"), None)])
def test_a_sweep_has_a_tolerance_of_its_own(plan: Plan, rtol: float | None) -> None:
    """Points are those of single runs at that tolerance; settling and solvers with a coarser default keep theirs."""
    pulsating = replace(SMOOTHED, {"pressure.amplitude": 1.0})
    point, = sweep(pulsating, KINETIC, [0.28], plan).points
    alone = simulate(replace(pulsating, {KINETIC: 0.28}), with_fields(plan, rtol=rtol))
    assert point.summary.max_slip_speed == alone.summary.max_slip_speed


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
    with pytest.raises(InputError, match=r"discard is 12.*0 to 11"):
        sweep_curves(curves, Plan(cycles=12, discard=12), out=tmp_path / "none.jsonl")
    assert not (tmp_path / "none.jsonl").exists()
