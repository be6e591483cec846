"""Verdicts that rest on more than curves: solvers, friction law, stick and slip, section, (21), harmonic balance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from given import Given, law_of, record, rows

from tcc_sim.analysis.damping import slope_of_friction
from tcc_sim.model import friction
from tcc_sim.model.parameters import System
from tcc_sim.model.pure_slip import pure_slip
from tcc_sim.solvers import solve
from tcc_sim.study.paper import claims_methods, claims_stick, harmonic_balance
from tcc_sim.study.paper.catalogue import FIGURES, OMEGA_N, paper_system
from tcc_sim.study.paper.claims import PaperEvidence
from tcc_sim.study.paper.evidence import FAILED, FREQUENCY, KINETIC, Evidence, with_kinetic
from tcc_sim.study.paper.rules import CONFIRMED, DEPENDS, NOT_CONFIRMED
from tcc_sim.trajectory import Cycles


def given_run(section: Any = (), largest: float = 0.0, seconds: float = 0.0, **more: Any) -> Any:
    """A run with the cycles, samples and computing time that a claim reads."""
    n = max(len(section) - 1, 0)
    cycles = Cycles(np.array(section), np.full(n, largest), np.zeros(n), np.zeros(n))
    return SimpleNamespace(solved_cycles=cycles, statistics=SimpleNamespace(seconds=seconds), final=None, **more)


def damped(cf: Callable[[Any, float], float], period: Callable[[float], int] = lambda x: 1) -> Given:
    """A reading of (21) and periods by row and ratio."""
    return Given(lambda row, x, d: record(period=period(x), equivalent_damping=cf(row, x), negative_slope_mean=-1.0))


def delayed(*shares: float) -> Given:
    """Two samples, one in either half of the cycle, for every ratio of Fig. 9."""
    places = {s.values["engine.frequency"]: x for s, x in zip(FIGURES[9].series, shares)}

    def run(system: System) -> Any:
        share = places[system.engine.frequency]
        return given_run(t=np.array([0.25, 0.75]), cycle=1.0, state=np.ones(2), slip_speed=np.array([share, 1 - share]))
    return Given(runs=run)


def sticking(*times: float) -> Given:
    """Stick in the last cycles from (13) and from rest, s."""
    left = iter(times)
    return Given(runs=lambda system: SimpleNamespace(solved_cycles=Cycles(
        np.ones((51, 3)), np.ones(50), np.ones(50), np.full(50, next(left)))))


def crossed(off: float) -> Given:
    """Curves made up to cross beside sqrt(I2/(I1 + I2)), for every pair of inertias."""
    def largest(row: Any, x: float, direction: str) -> Any:
        i1, i2 = row.get("driveline.flywheel_inertia", 0.2), row.get("driveline.plate_inertia", 0.02)
        ratio = x * OMEGA_N / (3000.0 / i2) ** 0.5
        return record(50.0 + (1.0 if row["pressure.phase"] == 0.0 else -1.0) * (ratio - (i2 / (i1 + i2)) ** 0.5 - off))
    return Given(largest)


def alternating(apart: int) -> Given:
    """Of 51 ratios `apart` have a maximum that alternates beside a constant section."""
    number = iter(range(1000))

    def run(system: System) -> Any:
        turn = np.arange(650) % 2 if next(number) < apart else np.zeros(650)
        return SimpleNamespace(solved_cycles=SimpleNamespace(section=np.ones((650, 3)), highest=10.0 + turn))
    return Given(runs=run)


def varying(angle: float) -> Given:
    """A slip speed that alternates by half of its mean beside a plate angle that alternates by `angle` of its own."""
    turn = np.arange(650) % 2 - 0.5
    return Given(runs=lambda system: given_run(np.stack([1.0 + turn, 2.0 + angle * turn, turn], axis=1)))


def smoothings(*slips: float) -> Given:
    """Largest slip speeds for sigma = 50, 100, 1000 s/rad; 63.7 with law (6)."""
    return Given(runs=lambda system: given_run(np.zeros((2001, 3)), 63.7 if system.friction.law == "set_valued" else
                                               slips[(50.0, 100.0, 1000.0).index(system.friction.smoothing)]))


@pytest.mark.parametrize(("name", "given", "verdict"), [
    ("damping_crosses", damped(lambda row, x: -3.0 * x, lambda x: 1 + (x > 0.2)), CONFIRMED),
    ("damping_crosses", damped(lambda row, x: -3.0 * x), NOT_CONFIRMED),
    ("damping_crosses", damped(lambda row, x: 0.0, lambda x: 1 + (x > 0.2)), NOT_CONFIRMED),
    ("damping_falls", damped(lambda row, x: float(row[KINETIC])), CONFIRMED),
    ("damping_falls", damped(lambda row, x: -float(row[KINETIC])), NOT_CONFIRMED),
    ("delay", delayed(1.0, 0.9, 0.1, 0.0), CONFIRMED),
    ("delay", delayed(1.0, 0.7, 0.1, 0.0), NOT_CONFIRMED), ("delay", delayed(1.0, 0.9, 0.3, 0.0), NOT_CONFIRMED),
    ("positive_trend_slips", sticking(0.0, 0.0), CONFIRMED),
    ("positive_trend_slips", sticking(0.0, 0.01), NOT_CONFIRMED), ("critical_frequency", crossed(1e-3), CONFIRMED),
    ("critical_frequency", crossed(3e-3), NOT_CONFIRMED), ("shows_in_both", alternating(0), CONFIRMED),
    ("shows_in_both", alternating(1), CONFIRMED), ("shows_in_both", alternating(5), DEPENDS),
    ("shows_in_both", alternating(40), NOT_CONFIRMED), ("section_varies_less", varying(0.1), CONFIRMED),
    ("section_varies_less", varying(10.0), NOT_CONFIRMED),
    ("smoothing_is_uncertain", smoothings(36.0, 63.0, 63.7), CONFIRMED),
    ("smoothing_is_uncertain", smoothings(36.0, 63.0, 36.0), NOT_CONFIRMED),
    ("smoothing_is_uncertain", smoothings(63.7, 63.7, 63.7), NOT_CONFIRMED),
    *(("discontinuous_is_slow", Given(runs=lambda system, times=times: given_run(
        seconds=times if system.friction.law == "set_valued" else 1.0)), verdict)
      for times, verdict in ((11.0, CONFIRMED), (9.0, NOT_CONFIRMED)))])
def test_verdicts_on_given_runs_and_curves(name: str, given: Given, verdict: str) -> None:
    result = rows[name](given)
    assert result.verdict == verdict
    assert result.values.get("ratios", 51) == 51
    assert set(rows[name].labels.values()) <= set(result.values)


@pytest.mark.parametrize(("differences", "along", "period", "largest", "verdict"), [
    (0.01, 36.0, 1, 36.3, CONFIRMED), (0.01, 36.0, 2, 36.3, DEPENDS), (0.01, 36.0, 1, 63.7, DEPENDS),
    (0.01, 60.0, 1, 36.3, NOT_CONFIRMED), (0.2, 36.0, 1, 36.3, NOT_CONFIRMED)])
def test_solvers_agree_where_their_attractors_do(differences, along, period, largest, verdict,  # type: ignore
                                                 monkeypatch) -> None:
    monkeypatch.setattr(claims_methods, "cycle_differences",
                        lambda chosen: {name: differences for name, *_ in chosen})
    given = Given(runs=lambda system: given_run(np.ones((1001, 3)), along if system.friction.law == "set_valued"
                                                else 36.0),
                  attractors=lambda row: [(period, largest), (2, 63.7)] if law_of(row) == "set_valued"
                  else [(1, 36.3), (2, 63.6)])
    assert rows["solvers_agree"](given).verdict == verdict


@pytest.mark.parametrize(("sizes", "verdict"), [
    ((0.0, 0.2), DEPENDS), ((0.2, 0.2), CONFIRMED), ((0.0, 0.0), NOT_CONFIRMED)])
def test_the_classical_method_differs_at_some_steps(sizes, verdict, monkeypatch) -> None:  # type: ignore
    monkeypatch.setattr(claims_methods, "cycle_differences", lambda chosen: {
        name: sizes[float(name.split()[2]) > 3e-5] for name, *_ in chosen})
    assert rows["classical_differs"](Given()).verdict == verdict


def test_a_difference_over_a_cycle_is_its_root_mean_square() -> None:
    """Of RK4 beyond its limit of stability, by the Euclidean norm of samples at the same times."""
    result = claims_methods.cycle_differences((("rk4, step 5e-05 s", "smoothed", 5e-5), ("smoothed", "smoothed", None)))
    system = paper_system(claims_methods.FIG02)
    start = solve(system, cycles=1000).final
    one, other = (solve(system, cycles=1, samples_per_cycle=400, start_cycle=1000, state=start, solver=name, step=step)
                  for name, step in (("smoothed", None), ("rk4", 5e-5)))
    apart = np.linalg.norm(other.slip_speed - one.slip_speed) / len(one.t) ** 0.5
    assert result["rk4, step 5e-05 s"] == pytest.approx(apart / np.abs(one.slip_speed).max(), rel=1e-3)
    assert result["smoothed"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("name", "law", "flat"), [("maximum_falls", "peak", (0.1, 2.0)),
                                                   ("slope_turns_negative", "smoothed_and_slope", (0.0, np.ones(2)))])
def test_the_law_is_judged_for_the_figure_s_own_mu_k(name, law, flat, monkeypatch) -> None:  # type: ignore
    seen: set[float] = set()

    def made_up(*terms: Any) -> Any:
        seen.add(round(1.0 / (1.0 + (terms[-1] or (0.0,))[0]), 4))
        return flat
    monkeypatch.setattr(friction, law, made_up)
    assert rows[name](Given()).verdict == NOT_CONFIRMED
    assert seen == {1.0, 0.8, 0.75, 0.677}


def test_pure_slip_is_held_against_the_solution() -> None:
    t = np.linspace(0.0, 1.0, 1001)
    v = pure_slip(paper_system(claims_stick.PURE_SLIP)).slip_speed(t)
    for off, verdict in ((0.0, DEPENDS), (1e-3, NOT_CONFIRMED)):
        run = given_run(t=t, slip_speed=v * (1.0 + off))
        result = rows["pure_slip_guaranteed"](Given(runs=lambda system, run=run: run))
        assert result.verdict == verdict
        assert result.values["least Omega_e that slips for ever (rad/s)"] == pytest.approx(35.1, abs=0.1)


def test_a_motion_that_has_not_settled_goes_on() -> None:
    """Law (6) in Fig. 2: no period after 150 cycles from (13), period two once it has settled."""
    row = {**claims_methods.FIG02, "friction.law": "set_valued"}
    kept = Evidence(1e-9, 1)
    sweep = kept.curves([row], np.array([150.0 / OMEGA_N]))[0]
    summary = sweep.points[0].summary
    assert (summary.period, summary.settled) == (0, False)
    assert kept.periods(sweep).tolist() == [2]
    assert kept.motion(row).period == 2
    assert sweep.plan == kept.plan(row)
    assert (sweep.plan.damping, sweep.plan.lyapunov) == (False, False)
    assert kept.motions_near(row, 150.0 / OMEGA_N, 0.0)[0] == kept.motion(row)


def test_a_transient_of_slip_is_stick_once_it_has_settled() -> None:
    """Fig. 14, psi = 0, law (6) at 0.148: from (13) it slips for 2700 cycles; at 0.13 it sticks, at 0.16 it slips."""
    kept = Evidence(1e-9, 1)
    row = {**FIGURES[14].series[0].values, "friction.law": "set_valued"}
    sweep = kept.curves([row], np.array([0.13, 0.16]))[0]
    assert kept.slips(sweep).tolist() == [False, True]
    # A motion in stick is followed until its section no longer changes.
    alone = kept.curves([row], np.array([0.13]))[0]
    for settled in (False, True):
        stuck = replace(alone.points[0].summary, settled=settled, regime="stick-slip")
        changed = replace(alone, points=[replace(alone.points[0], summary=stuck)])
        assert Evidence(1e-9, 1).slips(changed).tolist() == [settled]


def test_a_point_that_failed_is_none_and_never_slips() -> None:
    kept = Evidence(1e-9, 1)
    sweep = Given().curves([FIGURES[14].series[0].values], np.array([0.13, 0.16]))[0]
    failed = replace(sweep, points=[None, replace(sweep.points[1], summary=None)])
    assert kept.periods(failed).tolist() == [FAILED, FAILED]
    assert kept.slips(failed).tolist() == [False, False]


def test_where_two_curves_of_maxima_cross_is_found_to_1e_5() -> None:
    """Two lines that cross at 0.3016, the curves of psi = 0 and of psi = pi."""
    lagging = FIGURES[8].series[2].values

    def slip(row: Any, x: float, direction: str) -> Any:
        return record(10.0 + (20.0 * (x - 0.3016) if row["pressure.phase"] == lagging["pressure.phase"] else 0.0))

    assert Given(slip).crossing({}, OMEGA_N, 0.30) == pytest.approx(0.3016, abs=1e-5)
    assert Given(slip).crossing({}, OMEGA_N, 0.40) is None


def test_a_jump_keeps_its_change_on_a_narrow_interval_and_a_steep_rise_does_not() -> None:
    class Curve(Given):
        jumps = Evidence.jumps

    def slip(row: Any, x: float, direction: str) -> Any:
        return record(10.0 if x < 0.23 else 25.0 + 500.0 * min(max(x - 0.26, 0.0), 0.04))

    (result,) = Curve(slip).jumps({}, np.arange(0.1, 0.5, 0.04))
    assert result == pytest.approx((0.23, 15.0), abs=1e-3)


def test_stick_ends_where_10_says_by_a_run_from_stick() -> None:
    """(10) by hand for psi = pi: Tm + |Tp G + Tsp| at their phases; without a limit there is no value."""
    values = rows["stick_limits_varying"](PaperEvidence(1e-9, 1)).values
    assert len(values) == 4  # For psi = 0 a lower limit too.
    for name, each in values.items():
        limit, simulated = each
        assert simulated == pytest.approx(limit, abs=1e-3), name
        omega = limit * OMEGA_N
        gain = (3000.0 - 0.02 * omega**2 + 0.6j * omega) / (3000.0 - 0.22 * omega**2 + 0.6j * omega)
        t = np.linspace(0.0, 2.0 * np.pi, 200001)
        torque = 300.0 + 250.0 * (gain * np.exp(1j * t)).imag
        psi = {"0": 0.0, "pi/2": 0.5 * np.pi, "pi": np.pi}[name.split("psi = ")[1].split(",")[0]]
        assert (540.0 * (1.0 + 0.25 * np.sin(t + psi)) - np.abs(torque)).min() == pytest.approx(0.0, abs=0.05)
    assert PaperEvidence(1e-9, 1).end_of_stick({}, 0.45, 0.49) is None


@pytest.mark.parametrize(("off", "verdict"), [(5e-4, CONFIRMED), (2e-3, NOT_CONFIRMED), (None, NOT_CONFIRMED)])
def test_limits_of_stick_are_held_against_the_simulation(off, verdict, monkeypatch) -> None:  # type: ignore
    monkeypatch.setattr(Given, "end_of_stick", lambda evidence, row, low, high: None if off is None
                        else 0.5 * (low + high) + off)
    assert [rows[name](Given()).verdict for name in ("limits_of_stick", "stick_limits_varying")] == [verdict] * 2


def test_the_smoothed_law_creeps_where_the_set_valued_one_sticks() -> None:
    """Its slip speed carries the torque: tanh(50 v) is near |Tfi|/(mu_s N R), so v is some hundredths of a rad/s."""
    result = rows["smoothed_stick_creeps"](PaperEvidence(1e-9, 1))
    assert result.verdict == CONFIRMED
    assert 0.01 < result.values["largest slip speed (rad/s)"]["smoothed"] < 0.2


@pytest.mark.parametrize(("mean", "off", "printed", "satisfied", "unsuitable"), [
    (2.0, 0.0, 300.0, CONFIRMED, NOT_CONFIRMED), (2.0, 0.0, -6.4, NOT_CONFIRMED, NOT_CONFIRMED),
    (3.0, 0.0, 300.0, NOT_CONFIRMED, CONFIRMED), (2.0, 3.0, 300.0, NOT_CONFIRMED, CONFIRMED)])
def test_a_balance_is_judged_by_its_series_and_by_the_mean_of_31(mean, off, printed, satisfied, unsuitable,  # type: ignore
                                                                 monkeypatch) -> None:
    """A slip of a + b cos in the simulation and in the series; the rest is the mean of (31)."""
    t = np.linspace(0.0, 0.1, 50)
    series = SimpleNamespace(slip=np.array([2.0]), coefficient=None, slip_speed=lambda t: 2.0 + off + np.cos(t))
    monkeypatch.setattr(harmonic_balance, "harmonic_balance", lambda *how: series)
    monkeypatch.setattr(harmonic_balance, "mean_friction_torque",
                        lambda system, coefficient, period, printed=False, value=printed: value if printed else 300.0)
    given = Given(runs=lambda system: given_run(t=t, slip_speed=mean + np.cos(t)))
    assert rows["series_balance"](given).verdict == satisfied
    assert rows["balance_unsuitable"](given).verdict == unsuitable


def test_the_other_readings_of_21_are_means_of_the_slope() -> None:
    """Against half as many samples, later cycles and NumPy's weighted mean, at the ratio with a short period."""
    row = with_kinetic(0.667, {FREQUENCY: 0.12 * OMEGA_N})
    run = Evidence(1e-9, 1).last_cycles(row, 16, 4096)
    slope, v = slope_of_friction(run), run.slip_speed
    result = PaperEvidence(1e-9, 1).other_readings()
    for name, weights in (("no weight", None), ("|v|", np.abs(v)), ("(v - mean v)^2", (v - np.mean(v)) ** 2),
                          ("v^2 outside stick", v**2 * (run.state != 0))):
        assert len(result[name]) == 3
        assert result[name][0] == pytest.approx(np.average(slope, weights=weights), rel=0.02), name


def test_two_torques_have_the_frequencies_and_amplitudes_of_engine_and_load() -> None:
    """Of M/N = 2/3: 250 N m at 150 rad/s, and a quarter of mu_k N R = 540 N m at 100 rad/s."""
    seen: list[Any] = []
    rows["as_dual_excitation"](Given(lambda row, x, direction: seen.append(row) or record()))
    torques = [{row["engine.frequency"] * (k + 1): float(x) for k, x in enumerate(
        (row["engine.torque_amplitude"], *row["engine.harmonic_amplitudes"])) if x}
        for row in seen if "engine.harmonic_amplitudes" in row]
    assert torques == [pytest.approx({150.0: 250.0, 150.0 * ratio: 135.0}) for ratio in (0.5, 2.0, 2 / 3, 4 / 3)]
    assert all(len(row["engine.harmonic_phases"]) == len(row["engine.harmonic_amplitudes"])
               for row in seen if "engine.harmonic_phases" in row)


@pytest.mark.parametrize(("longer", "verdict"), [("chaotic", CONFIRMED), ("periodic", DEPENDS)])
def test_an_exponent_too_near_0_is_that_of_a_longer_run(longer: str, verdict: str) -> None:
    given = Given(lambda row, x, direction: record(period=2 if x > 0.7 else 0), lambda row: [0.2], "unresolved",
                  longer=longer)
    result = rows["doubling_to_chaos"](given)
    assert result.verdict == verdict
    assert {name for name, *_ in result.values["diagnosis, exponent's interval (1/s)"].values()} == {longer}
