"""Normal equations of multiple shooting beside those of all residuals at once, by differences of the residuals."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from fig02_measured import FIG02, moved

from tcc_sim.estimation.measurement import Measurement
from tcc_sim.estimation.multiple_shooting import Fit, MultipleShooting, fit
from tcc_sim.estimation.normal_equations import Normal
from tcc_sim.estimation.settings import FitSettings, Stage
from tcc_sim.estimation.windows import Model, states_of

KEYS = ("friction.static_coefficient", "driveline.stiffness", "engine_torque.offset")
VALUES = np.array([0.31, 2900.0, 4.0])
NOISE = {"slip_speed": 0.2, "plate_speed": 0.1}


def measured(count: int = 60, channels: tuple[str, ...] = ("slip_speed", "plate_speed")) -> Measurement:
    """A measurement of fig02 without noise, with its engine torque."""
    t, states, torque = moved(0.1)
    columns = {"slip_speed": states[:count, 0], "plate_angle": states[:count, 1], "plate_speed": states[:count, 2]}
    return Measurement(t[:count], {name: columns[name] for name in channels}, {"engine_torque": torque[:count]},
                       hold="linear")


def problem(keys: tuple[str, ...] = KEYS, **how: object) -> MultipleShooting:
    """Windows of ten samples."""
    return MultipleShooting(Model(FIG02.system, keys, measured(**how)), NOISE, FitSettings(stuck=20.0), 0.01)


def dense(normal: Normal) -> tuple[np.ndarray, np.ndarray]:
    """The normal equations of all starts and keys, (3 m + P, 3 m + P) and (3 m + P,)."""
    m, size = len(normal.diagonal), len(normal.corner)
    whole = np.zeros((3 * m + size, 3 * m + size))
    for k in range(m):
        at = slice(3 * k, 3 * k + 3)
        whole[at, at], whole[at, 3 * m:], whole[3 * m:, at] = normal.diagonal[k], normal.border[k], normal.border[k].T
        if k < m - 1:
            after = slice(3 * k + 3, 3 * k + 6)
            whole[at, after], whole[after, at] = normal.following[k], normal.following[k].T
    whole[3 * m:, 3 * m:] = normal.corner
    return whole, np.append(normal.slope.ravel(), normal.slope_by_key)


def made(m: int = 4, size: int = 3) -> Normal:
    """Equations of random residuals, each of which depends on a start, the next start and all keys."""
    rng = np.random.default_rng(m)
    rows, left = np.zeros((m, 12, 3 * m + size)), rng.normal(size=(m, 12))
    for k in range(m):
        columns = [*range(3 * k, min(3 * k + 6, 3 * m)), *range(3 * m, 3 * m + size)]
        rows[k][:, columns] = rng.normal(size=(12, len(columns)))
    by = rows.reshape(-1, 3 * m + size)
    whole, slope = by.T @ by, by.T @ left.ravel()
    at = [slice(3 * k, 3 * k + 3) for k in range(m)]
    following = np.array([whole[x, y] for x, y in pairwise(at)]).reshape(-1, 3, 3)
    return Normal(np.array([whole[x, x] for x in at]), following, np.array([whole[x, 3 * m:] for x in at]),
                  whole[3 * m:, 3 * m:], slope[:3 * m].reshape(m, 3), slope[3 * m:])


@pytest.mark.parametrize("damping", [0.0, 0.3])
@pytest.mark.parametrize("windows", [1, 4])
def test_a_step_is_that_of_the_dense_equations(windows: int, damping: float) -> None:
    normal = made(windows)
    whole, slope = dense(normal)
    damped, n = whole + damping * np.diag(np.diag(whole)), 3 * windows
    step = np.linalg.solve(damped, -slope)
    by_start, by_key = normal.solved(damping)
    np.testing.assert_allclose(np.append(by_start, by_key), step, rtol=1e-9)
    eliminated = np.linalg.solve(damped[:n, :n], np.column_stack([whole[:n, n:], slope[:n]]))
    solved = normal.by_starts(damping)
    np.testing.assert_allclose(solved.reshape(n, -1), eliminated, rtol=1e-9)
    squares, left = normal.by_keys(solved, damping)
    np.testing.assert_allclose(squares, damped[n:, n:] - whole[n:, :n] @ eliminated[:, :-1], rtol=1e-9)
    np.testing.assert_allclose(left, slope[n:] - whole[n:, :n] @ eliminated[:, -1], rtol=1e-9)
    held = np.array([False, True, False])
    free = np.append(np.arange(n), n + np.flatnonzero(~held))
    by_start, by_key = normal.holding(held).solved(damping)
    np.testing.assert_allclose(np.append(by_start, by_key[~held]), np.linalg.solve(damped[np.ix_(free, free)],
        -slope[free]),
                               rtol=1e-9)
    assert by_key[1] == 0.0


@pytest.mark.parametrize("channels", [("slip_speed",), ("slip_speed", "plate_angle"), ("slip_speed", "plate_speed"),
                                      ("slip_speed", "plate_angle", "plate_speed")])
def test_starts_come_from_the_measured_channels_and_the_rest_from_the_model(channels: tuple[str, ...]) -> None:
    states = moved(0.1)[1]
    of = MultipleShooting(Model(FIG02.system, (), measured(95, channels)), {
        **NOISE, "plate_angle": 2e-4}, FitSettings(), 0.01)
    assert (of.width, of.count, of.data.shape) == (10, 9, (9, 10, len(channels)))
    assert of.scales.tolist() == [0.2, 2e-4, 0.1]
    starts, index = of.first_starts(np.empty(0)), {"slip_speed": 0, "plate_angle": 1, "plate_speed": 2}
    assert starts.shape == (9, 3)
    for name in channels:
        column = states[:90:10, index[name]].copy()
        if name == "slip_speed":
            assert of.stuck.tolist() == np.flatnonzero(np.abs(column) < 0.8).tolist()
            column[of.stuck] = 0.0
        assert starts[:, index[name]].tolist() == column.tolist()
    if "plate_speed" in channels and "plate_angle" not in channels:
        angle = 0.1 + (np.cumsum(states[:90, 2]) - np.cumsum(states[:90, 2]).mean()) * 1e-3
        assert starts[:, 1] == pytest.approx(angle[::10])
    elif "plate_angle" in channels and "plate_speed" not in channels:
        assert starts[:, 2].tolist() == [0.0] * 9
    elif channels == ("slip_speed",):
        alone = states_of(of.model, np.array([[states[0, 0], 0.1, 0.0]]), 90, np.empty(0),
            of.model.substeps(np.empty(0)))
        assert starts[:, 1:].tolist() == alone[0, :90:10, 1:].tolist()
    for window, width in ((1e-3, 4), (9.0, 47)):
        other = MultipleShooting(of.model, dict.fromkeys(channels, 0.2), FitSettings(), window)
        assert other.width == width
        assert other.scales.tolist() == [0.2, 0.2 if "plate_angle" in channels else 1e-4, 0.2]


def test_starts_of_longer_windows_are_states_of_the_shorter_ones() -> None:
    of = problem(keys=())
    starts, n = of.first_starts(np.empty(0)), of.model.substeps(np.empty(0))
    states = states_of(of.model, starts, 10, np.empty(0), n)
    for window, expected in ((0.02, states[::2, 0]), (0.005, np.stack([states[:, 0], states[:, 5]], 1).reshape(-1, 3)),
                             (0.025, [states[0, 0], states[2, 5]]), (0.007, [states[7 * k // 10, 7 * k % 10]
                                                                            for k in range(8)])):
        other = MultipleShooting(of.model, NOISE, FitSettings(), window)
        np.testing.assert_array_equal(other.regrouped(starts, 10, np.empty(0)), expected)
    short = MultipleShooting(of.model, NOISE, FitSettings(), 0.01)
    short.count = 7
    np.testing.assert_array_equal(short.regrouped(starts, 10, np.empty(0))[-1], states[-1, -2])


def test_the_result_of_a_fit_counts_its_freedom_and_its_largest_gap() -> None:
    of = problem()
    n, starts = of.model.substeps(VALUES), of.first_starts(VALUES)
    states = states_of(of.model, starts, of.width, VALUES, n)
    found = of.result(VALUES, starts, 4.0)
    left = {name: (states[:, :-1, i] - of.data[:, :, k]).ravel() for k, (name, i) in enumerate(
        (("slip_speed", 0), ("plate_speed", 2)))}
    assert {name: column.tolist() for name, column in found.residuals.items()} == {
        name: pytest.approx(column) for name, column in left.items()}
    assert found.freedom == 2 * 60 - 3 - 3
    squares = sum(np.sum((column / NOISE[name]) ** 2) for name, column in left.items())
    assert found.chi2 == pytest.approx(squares / found.freedom)
    assert found.gap == pytest.approx(2.0 * np.abs((states[:-1, -1] - starts[1:]) / [0.2, 1e-4, 0.1]).max())
    assert (found.work, Fit(*[None] * 6).work) == (0.0, 0.0)


def test_stages_follow_each_other_and_the_work_is_counted() -> None:
    """Sub-steps times samples times derivatives by three states and the keys, for every step that was tried."""
    ticks: list[int] = []
    stages = (Stage(0.01, 1.0, 1e-2, 2), Stage(0.02, 1e3, 1e-3, 1))
    found = fit(Model(FIG02.system, KEYS[1:2], measured()), NOISE, np.array([3100.0]), FitSettings(), stages,
                tick=lambda: ticks.append(1))
    assert 2 <= len(ticks) <= 3
    assert (found.starts.shape, found.values.shape) == ((3, 3), (1,))
    n = Model(FIG02.system, KEYS[1:2], measured()).substeps(np.array([3100.0]))
    assert found.work == pytest.approx(len(ticks) * n * 60 * 4.0, rel=0.1)
    assert found.values[0] == pytest.approx(3000.0, rel=0.01)
    assert len(fit(Model(FIG02.system, KEYS[1:2], measured()), NOISE, np.array([3000.0]), FitSettings()).starts) == 2
