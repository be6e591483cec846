"""The list of errata: each number agrees with a derivation by hand, and the page has all of them."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tcc_sim.cli import main
from tcc_sim.study.paper import errata, measures
from tcc_sim.study.paper.catalogue import paper_system


def test_16_17_and_27_by_hand() -> None:
    slip = list(errata.slip_condition().values())
    assert slip[0][:2] == pytest.approx([400.0 / 3.0, -150.0])  # a0 = -150 + Tp/(I1 omega), swing 25/3.
    assert slip[1][1] == pytest.approx(30.0)
    assert slip[1][2] < 0.0
    amplitude, rest = errata.transient().values()
    wd = math.sqrt(150e3 - 15.0**2)
    assert amplitude == pytest.approx([0.1 * (1.0 - 2.0 * 15.0**2 / 150e3) / wd, 300.0 / (0.02 * wd)])
    assert rest < 1e-5
    assert next(iter(errata.stuck_frequency().values())) == pytest.approx([3000.0 / math.sqrt(0.22),
                                                                                   math.sqrt(3000.0 / 0.22)])


def test_23_has_a_positive_root_for_any_negative_damping() -> None:
    """The polynomial against the eigenvalues of (22) as a matrix."""
    real, crossing = errata.roots().values()
    for damping, root in zip((-0.1, -0.3), real):
        matrix = np.array([[-damping / 0.2, damping / 0.2, 0.0],
                           [damping / 0.02, -(0.6 + damping) / 0.02, -3000.0 / 0.02], [0.0, 1.0, 0.0]])
        assert np.linalg.eigvals(matrix).real.max() == pytest.approx(root, rel=1e-9)
        assert root > 0.0
    assert crossing == pytest.approx(-0.6, abs=1e-3)


def test_8_9_and_29_by_hand() -> None:
    low, high = errata.phases().values()
    assert low[0] == pytest.approx(low[1])
    assert high[0] - high[1] == pytest.approx(math.pi)
    printed, right = next(iter(errata.amplitude().values()))
    assert printed / right == pytest.approx(5.0, rel=0.01)
    result = errata.driving_torques()
    assert list(result.values())[:2] == [pytest.approx([250.0, 492.5, 1235.0, 2720.0], rel=1e-5),
                                         pytest.approx([250.0, 182.5, 115.0, 20.0])]
    at_low, slip_low, at_high, slip_high = list(result.values())[2:]
    assert sorted(at_low, reverse=True) == at_low
    assert sorted(slip_low, reverse=True) == slip_low
    assert sorted(at_high) == at_high
    assert sorted(slip_high) == slip_high
    below, above = errata.phase_order().values()
    assert sorted(below) == below
    assert sorted(above, reverse=True) == above


def least_slip(speed: float) -> float:
    """Least slip speed, rad/s, under (14) from this one on, if friction did not change sign with it."""
    system = paper_system({**measures.PURE_SLIP, "initial.slip_speed": speed})
    d, e, load = system.driveline, system.engine, system.saturation_mean

    def rates(t: float, y: np.ndarray) -> list[float]:
        plate = (load - d.damping * y[2] - d.stiffness * y[1]) / d.plate_inertia
        engine = e.mean_torque + e.torque_amplitude * math.sin(e.frequency * t)
        return [(engine - load) / d.flywheel_inertia - plate, y[2], plate]

    run = solve_ivp(rates, (0.0, 1.0), [speed, 0.0, 0.0], rtol=1e-10, atol=1e-12, t_eval=np.linspace(0.0, 1.0, 200_001))
    return float(run.y[0].min())


def test_the_page_has_every_erratum_with_its_numbers(tmp_path) -> None:  # type: ignore[no-untyped-def]
    """The engine speed matters: the paper's period two begins at 0.785 for 0 and at 0.89 for 200 rad/s, by trial."""
    file = tmp_path / "errata.md"
    words = ["claims", "--figures", "3", "--errata", str(file)]
    assert main(words) == 0
    page = file.read_text()
    assert page == (Path(__file__).resolve().parents[3] / ".github" / "paper" / "errata.md").read_text()
    assert f"{least_slip(30.0):.4f}" in page
    speeds = re.search(r"engine speed.*: 0: ([\d.]+), .* 200: ([\d.]+)$", page, re.MULTILINE)
    assert speeds
    assert list(map(float, speeds.groups())) == pytest.approx([0.785, 0.89], abs=0.01)
    assert main(words) == 2
