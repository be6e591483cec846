"""The list of errata: each number agrees with a derivation by hand or a solve, and the page has all of them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from given import leaves
from scipy.integrate import solve_ivp

from tcc_sim.analysis.steady.damping import damping_of_cycles
from tcc_sim.cli import main
from tcc_sim.solvers import solve
from tcc_sim.study.paper import measures
from tcc_sim.study.paper.catalogue import OMEGA_N, paper_system
from tcc_sim.study.paper.claims import ERRATA
from tcc_sim.study.paper.evidence import FREQUENCY, KINETIC, Evidence, with_kinetic
from tcc_sim.study.paper.harmonic_balance import harmonic_balance, mean_friction_torque

PAGE = Path(__file__).resolve().parents[3] / ".github" / "paper" / "errata.md"
DAMPED = math.sqrt(150e3 - 15.0**2)
NUMBERS = {row["where"]: leaves(row["numbers"]) for row in ERRATA["errata"] if "numbers" in row}


def stick(ratio: float) -> complex:
    """Denominator of (8) and (9)."""
    return complex(3000.0 - 0.22 * (ratio * OMEGA_N) ** 2, 0.6 * ratio * OMEGA_N)


def gain(ratio: float) -> complex:
    """Factor of Ts in the torque that drives the slip, with the plate's motion eliminated."""
    return stick(ratio) / complex(3000.0 - 0.02 * (ratio * OMEGA_N) ** 2, 0.6 * ratio * OMEGA_N)


def least_slip(speed: float) -> float:
    """Least slip speed, rad/s, under (14) with Tm = Tsm = 300 N m from this one on, if friction kept its sign."""
    def rates(t: float, y: np.ndarray) -> list[float]:
        plate = (300.0 - 0.6 * y[2] - 3000.0 * y[1]) / 0.02
        return [250.0 * math.sin(150.0 * t) / 0.2 - plate, y[2], plate]

    run = solve_ivp(rates, (0.0, 1.0), [speed, 0.0, 0.0], rtol=1e-7, atol=1e-9, t_eval=np.linspace(0.0, 1.0, 20_001))
    return float(run.y[0].min())


def held_in_stick() -> list[float]:
    row = with_kinetic(0.55, {FREQUENCY: 0.36 * OMEGA_N})
    near = solve(paper_system(with_kinetic(0.57, row)), cycles=600).final
    settled = solve(paper_system(row), cycles=2000, state=near).final
    run = solve(paper_system(row), cycles=50, start_cycle=2000, samples_per_cycle=2000, state=settled)
    stuck = run.state == 0
    return [300.0, 0.55 * 540.0, run.friction_torque.mean(), run.friction_torque[stuck].mean(), stuck.mean()]


def dissipation() -> list[Any]:
    """Two digits, which an average over an aperiodic motion has."""
    out = list[Any]()
    for ratio in (0.12, 0.20, 0.25):
        system = paper_system(with_kinetic(0.667, {FREQUENCY: ratio * OMEGA_N}))
        before = solve(system, cycles=150)
        run = solve(system, cycles=16, samples_per_cycle=4096, start_cycle=150, state=before.final)
        by_energy = (run.friction_torque * run.slip_speed).sum() / (run.slip_speed**2).sum()
        out += [by_energy, damping_of_cycles(system, before.solved_cycles[134:], 134, 0).weighted]
    return [pytest.approx(x, rel=0.06) for x in out]


def roots() -> list[float]:
    """Eigenvalues of (22) as a matrix."""
    return [np.linalg.eigvals(np.array([
        [-c / 0.2, c / 0.2, 0.0], [c / 0.02, -(0.6 + c) / 0.02, -3000.0 / 0.02], [0.0, 1.0, 0.0]])).real.max()
        for c in (-0.1, -0.3)] + [pytest.approx(-0.6, abs=1e-3)]


def driving_torques() -> list[float]:
    shares = (0.0, 0.125, 0.25, 0.5)
    out = [abs(250.0 - torque * x) for torque in (11.0 * 540.0, 540.0) for x in shares]
    for ratio in (0.20, 0.40):
        out += [abs(250.0 - 540.0 * x * gain(ratio)) for x in shares]
        out += [np.abs(solve(paper_system({"pressure.amplitude": 225e3 * x, FREQUENCY: ratio * OMEGA_N}),
                             cycles=150).solved_cycles.highest[50:]).max() for x in shares]
    return out


def series_means() -> list[float]:
    system = paper_system(measures.actuated(0.5))
    before = solve(system, cycles=600)
    run, off = solve(system, cycles=2, samples_per_cycle=400, start_cycle=600, state=before.final), []
    for count in (10, 20, 40):
        balance = harmonic_balance(system, 2, 2 * count)
        apart = balance.slip_speed(run.t) - run.slip_speed
        off.append(np.sqrt(np.mean(apart**2)) / np.abs(run.slip_speed).max())
    return [mean_friction_torque(system, balance.coefficient, 2, printed=True), 300.0, 500.0 / math.pi,
            balance.slip[0], balance.coefficient[0], *off]


@pytest.mark.parametrize(("where", "derived"), [
    ("(8b), (25b)", lambda: [of(-0.6 * x * OMEGA_N, stick(x).real) for x in (0.2, 0.4) for of in (
        lambda a, b: math.atan(a / b), math.atan2)]),
    ("(9)", lambda: [(0.36 * OMEGA_N) ** 2 * 250.0 * i / abs(x) for i, x in (
        (1.0, stick(0.36).real), (0.2, stick(0.36)))]),
    ("After (14)", held_in_stick),
    ("(16)", lambda: [400.0 / 3.0, -150.0, least_slip(-150.0), 30.0, 30.0, least_slip(30.0)]),
    ("(17a), (18)", lambda: [0.1 * (1.0 - 2.0 * 15.0**2 / 150e3) / DAMPED, 300.0 / (0.02 * DAMPED), pytest.approx(
        0.0, abs=1e-5)]),  # The last one is a difference of rounding and quadrature.
    ("(21)", dissipation), ("(23)", roots),
    ("(27)", lambda: [3000.0 / math.sqrt(0.22), math.sqrt(3000.0 / 0.22)]), ("(29b), Fig. 13", driving_torques),
    ("(29b), Fig. 8", lambda: [abs(250.0 - 135.0 * np.exp(1j * psi) * gain(x)) for x in (0.15, 0.40)
                               for psi in (0.0, 0.5 * math.pi, math.pi)]),
    ("(30), (31), (32), (34)", series_means)])
def test_the_numbers_are_those_of_a_derivation(where: str, derived: Callable[[], list[Any]]) -> None:
    values = derived()
    assert len(values) == len(NUMBERS[where])
    for number, value in zip(NUMBERS[where], values):
        assert number == (pytest.approx(value, rel=1e-3) if isinstance(value, float) else value)


def test_period_two_begins_where_the_page_says() -> None:
    """Of Fig. 6 from (13): the highest mu_k/mu_s depends on the engine speed."""
    (speeds,) = ERRATA["speeds"].values()
    for speed in (0, 200):
        ratios, evidence = np.round(np.arange(speeds[speed], 0.9401, 0.01), 6), Evidence(1e-9)
        row = {FREQUENCY: 0.36 * OMEGA_N, "initial.slip_speed": float(speed)}
        two = evidence.periods(evidence.curves([row], ratios, over=KINETIC)[0]) == 2
        assert two.tolist() == [True] + [False] * (len(ratios) - 1)


def test_the_page_has_every_erratum_with_its_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["claims", "--figures", "3", "--errata", str(tmp_path / "errata.md"), "--json", "-"]
    assert (main(words), json.loads(capsys.readouterr().out)["complete"]) == (0, True)
    assert (tmp_path / "errata.md").read_text() == PAGE.read_text()
    assert main(words) == 2
