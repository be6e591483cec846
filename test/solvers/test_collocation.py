"""The long collocation step: its tables against identities of Radau IIA, its linear part and stages against closed
solves.
"""


import numpy as np
import pytest
from plain import plain
from scipy.integrate import solve_ivp

from tcc_sim.compiling.compiled import compiled
from tcc_sim.model.equations import Linear, coefficients_of
from tcc_sim.model.friction import sliding, sliding_slope, smoothed_and_slope, smoothed_coefficient
from tcc_sim.solvers import collocation as tables
from tcc_sim.solvers import stages
from tcc_sim.solvers.stages import LAYER, WORK, Place

LINEAR = Linear(0.2, 0.02, 0.6, 3000.0)
EVERY = Linear(0.2, 0.02, 0.6, 3000.0, 15.0, 4.0, -11.0)
RATE = 150.0
STRIBECK = (0.25, 2.0)


def test_the_tableau_integrates_polynomials_up_to_degree_30():
    for k in range(1, tables.NODES + 1):
        np.testing.assert_allclose(tables.A @ tables.C ** (k - 1), tables.C**k / k, atol=1e-14)
    weights = tables.A[-1]
    for k in range(1, 2 * tables.NODES):
        assert weights @ tables.C ** (k - 1) == pytest.approx(1.0 / k, rel=1e-13)
    assert tables.C[-1] == 1.0


def test_chebyshev_coefficients_and_powers_give_the_nodal_values_back():
    nodes = np.concatenate([[0.0], tables.C])
    values = np.cos(3.0 * nodes)
    coefficients = values @ tables.TO_CHEBYSHEV
    np.testing.assert_allclose(np.polynomial.chebyshev.chebval(2.0 * nodes - 1.0, coefficients), values, atol=1e-15)
    powers = coefficients @ tables.TO_POWERS
    np.testing.assert_allclose(np.polynomial.polynomial.polyval(nodes, powers), values, atol=1e-13)


@pytest.mark.parametrize("linear", [LINEAR, EVERY], ids=["paper", "every coefficient"])
@pytest.mark.parametrize("level", [1, 4, 12])
def test_the_plate_follows_a_given_slip_as_its_equation_says(level, linear):
    result = tables.tables(linear, (RATE,), RATE, *tables.ladder_of(2e6, 2.0 * np.pi / RATE))
    step_size, sources = result.step_sizes[level], result.sources[level]
    i1, i2, damping, stiffness, by_slip, by_speed, plate_by_slip = coefficients_of(linear)
    inertia, kappa, h = i1 + i2, i1 / (i1 + i2), float(step_size["length"])
    assert h <= 2.0 * np.pi / RATE

    def slip(t):
        return 0.03 * np.sin(40.0 * t)

    def torque(t):
        return 300.0 + 250.0 * np.sin(RATE * t + 0.4)

    def rates(t, y):
        speed = y[1] - kappa * slip(t)
        fluid = by_speed * speed + (by_slip + plate_by_slip) * slip(t)
        return [speed, (torque(t) - stiffness * y[0] - damping * speed - fluid) / inertia]

    times = h * np.concatenate([[0.0], tables.C])
    truth = solve_ivp(rates, (0.0, h), [0.1, -3.0], "DOP853", times, rtol=1e-13, atol=1e-14).y
    weights = np.array([0.1, -3.0, 300.0, 250.0 * np.sin(0.4), 250.0 * np.cos(0.4)])
    v = slip(times[1:])
    for name, exact in zip(("angle", "speed"), truth):
        coefficients = weights @ sources[name] + v @ step_size[name]
        values = np.polynomial.chebyshev.chebval(2.0 * times / h - 1.0, coefficients)
        np.testing.assert_allclose(values, exact, atol=1e-11 * np.abs(exact).max())
        assert weights @ sources["end_" + name] + v @ step_size["end_" + name] == pytest.approx(exact[-1], rel=1e-11)
    u = truth[1, 1:] - kappa * v
    free = ((torque(times[1:]) - by_slip * v - by_speed * u) / i1
            + (damping * u + stiffness * truth[0, 1:] + plate_by_slip * v) / i2 - 1.2 * np.cos(40.0 * times[1:]))
    balance = weights @ sources["balance"] + step_size["start"] * slip(0.0) - v @ step_size["coupling"]
    np.testing.assert_allclose(balance, free, atol=1e-9 * np.abs(free).max() + 1e-9 / h)


@compiled
def law(work, sign, sigma, stribeck):
    stages.evaluate_law(0, work.slip, work.law, work.slope, sign, sigma, stribeck)


@compiled
def correct(work, step_size, v):
    stages.evaluate_residual(0, step_size.coupling, work.slip, work.law, work.slope, work.friction_rate, work.balance,
                             step_size.start, v, work.change, work.measure)
    stages.eliminate(0, work.change, step_size.coupling, work.friction_rate, work.slope, work.measure)


def test_the_correction_solves_newtons_equations():
    step_size = tables.tables(LINEAR, (RATE,), RATE, 10, tables.LEVELS).step_sizes[5]
    work, draw = np.zeros(1, WORK)[0], np.random.default_rng(0)
    work["slip"], work["friction_rate"] = draw.uniform(0.01, 0.05, 16), draw.uniform(2e4, 3e4, 16)
    work["balance"] = draw.normal(size=16) * 1e4
    law(work, 1.0, 50.0, STRIBECK)
    correct(work, step_size, 0.03)
    residual = (work["balance"] - work["friction_rate"] * work["law"] + step_size["start"] * 0.03
                - work["slip"] @ step_size["coupling"])
    exact = np.linalg.solve(step_size["coupling"].T + np.diag(work["friction_rate"] * work["slope"]), residual)
    np.testing.assert_allclose(work["change"], exact, rtol=1e-10)
    assert work["measure"][0] == pytest.approx(np.abs(exact).max(), rel=1e-10)


def stuck(work, friction_rate):
    """Slip speeds at the nodes of a step that solve its equations to rounding, for v = 0.02 rad/s at its start."""
    step_size = tables.tables(LINEAR, (RATE,), RATE, 10, tables.LEVELS).step_sizes[5]
    exact = 0.02 + 0.008 * np.sin(2.0 * tables.C)
    work["slip"], work["friction_rate"] = exact, friction_rate
    law(work, 1.0, 50.0, None)
    work["balance"] = exact @ step_size["coupling"] + work["friction_rate"] * work["law"] - step_size["start"] * 0.02
    return step_size, exact


@pytest.mark.parametrize("friction_rate", [2e3, 3e4])
def test_a_good_guess_does_not_end_the_iteration_before_its_error_is_known(friction_rate):
    """The diagonal alone removes only a part of the error, for any size of the first correction."""
    work = np.zeros(1, WORK)[0]
    step_size, exact = stuck(work, friction_rate)
    dominant = friction_rate * work["slope"].min() > stages.DOMINANT * step_size["diagonal"][-1]
    assert dominant == (friction_rate == 3e4)
    work["slip"] = exact * (1.0 + 1e-6 * np.cos(5.0 * tables.C))
    assert 0 < stages.solve_stages(step_size, 0.02, Place(LAYER, 1.0, 1e-9, 1e-9), 50.0, 50.0, None, 1e-12, work) < 12
    np.testing.assert_allclose(work["slip"], exact, rtol=0.0, atol=2e-12)


def test_the_guess_in_stick_follows_the_slow_manifold():
    work = np.zeros(1, WORK)[0]
    step_size, exact = stuck(work, 3e4)
    work["slip"] = exact * 1.01
    stages.follow_manifold(step_size, 0.02, 1.0, 50.0, None, work)
    assert np.abs(work["slip"] - exact).max() < 0.1 * np.abs(0.01 * exact).max()


def test_the_first_guess_in_stick_is_good_to_some_per_cent():
    """Tanh and mubar to two, as far as the demand is below 0.98."""
    y = np.linspace(-0.985, 0.985, 400)
    assert np.abs(np.tanh(stages.inverse_tanh(y)) / y - 1.0).max() < 0.0204
    x = np.linspace(-1.5, 1.5, 31)
    exact = 1.0 + np.clip(x, -1.0, 1.0) + 0.5 * np.clip(x, -1.0, 1.0) ** 2
    np.testing.assert_allclose(stages.quadratic(x), exact, rtol=1e-15)
    slip, demand = np.zeros(16), np.linspace(0.05, 0.97, 16)
    for stribeck, sign in ((None, 1.0), (STRIBECK, 1.0), (STRIBECK, -1.0), ((0.25, 2.0, 0.1, 6.0), 1.0)):
        plain(stages.guess)(0, sign * demand, slip, sign, 50.0, stribeck)
        assert np.abs(smoothed_coefficient(slip, 50.0, stribeck) / (sign * demand) - 1.0).max() < 0.02
    work = np.zeros(1, WORK).view(np.recarray)[0]
    work.change[:], work.friction_rate[:], work.slip[:] = np.linspace(-900.0, 900.0, 16), 1e3, 0.02
    work.slope[:] = np.linspace(-10.0, 60.0, 16)
    expected = 0.02 + np.clip(work.change / (1e3 * np.maximum(work.slope / 50.0, 0.05)), -0.7, 0.7) / 50.0
    plain(stages.correct_by_friction)(0, work.change, work.slip, work.friction_rate, work.slope, 50.0)
    np.testing.assert_allclose(work.slip, expected, rtol=1e-14)
    diagonal = np.linspace(1e3, 2e3, 16)
    exact = work.change / (diagonal + 1e3 * work.slope)
    plain(stages.divide)(0, work.change, diagonal, work.friction_rate, work.slope, work.measure)
    np.testing.assert_allclose(work.change, exact, rtol=1e-14)
    assert work.measure[0] == pytest.approx(np.abs(exact).max())


def test_operations_on_all_nodes_are_those_of_matrices():
    """As plain Python: the law and its slope, the residual, both eliminations, and polynomials of nodal values."""
    draw, work = np.random.default_rng(4), np.zeros(1, WORK).view(np.recarray)[0]
    coupling, v = draw.normal(size=(16, 16)) + 20.0 * np.eye(16), 0.03
    work.slip[:], work.friction_rate[:] = draw.uniform(0.01, 0.9, 16), draw.uniform(2.0, 3.0, 16)
    work.balance[:], start = draw.normal(size=16), draw.normal(size=16)
    for sign, sigma, stribeck in ((1.0, 50.0, STRIBECK), (-1.0, 50.0, None), (1.0, None, STRIBECK),
                                  (-1.0, None, STRIBECK)):
        slip = sign * work.slip
        plain(stages.evaluate_law)(0, slip, work.law, work.slope, sign, sigma, stribeck)
        law, slope = (smoothed_and_slope(slip, sigma, stribeck) if sigma is not None else
                      (sliding(slip, sign, stribeck), sliding_slope(slip, stribeck)))
        np.testing.assert_allclose(work.law, law, rtol=1e-14)
        np.testing.assert_allclose(work.slope, slope, rtol=1e-11, atol=1e-13)
    plain(stages.evaluate_residual)(0, coupling, work.slip, work.law, work.slope, work.friction_rate, work.balance,
                                    start, v, work.change, work.measure)
    residual = work.balance - work.friction_rate * work.law + start * v - work.slip @ coupling
    np.testing.assert_allclose(work.change, residual, rtol=1e-12)
    assert work.measure[stages.LEAST] == (work.friction_rate * work.slope).min()
    matrix, several = coupling.T + np.diag(work.friction_rate * work.slope), draw.normal(size=(4, 16))
    expected = np.linalg.solve(matrix, several.T).T
    plain(stages.eliminate_rows)(0, several, coupling, work.friction_rate, work.slope)
    np.testing.assert_allclose(several, expected, rtol=1e-11)
    plain(stages.eliminate)(0, work.change, coupling, work.friction_rate, work.slope, work.measure)
    exact = np.linalg.solve(matrix, residual)
    np.testing.assert_allclose(work.change, exact, rtol=1e-11)
    assert work.measure[stages.LARGEST] == pytest.approx(np.abs(exact).max())
    chebyshev, powers, shares = np.zeros(tables.TERMS), np.zeros(32), draw.normal(size=(16, tables.TERMS))
    plain(stages.slip_polynomial)(0, work.slip, v, chebyshev, powers)
    at, through = np.append(0.0, tables.C), np.append(v, work.slip)
    np.testing.assert_allclose(np.polynomial.chebyshev.chebval(2.0 * at - 1.0, chebyshev), through, rtol=1e-10)
    np.testing.assert_allclose(np.polynomial.polynomial.polyval(at, powers), through, atol=1e-5)  # Powers lose digits.
    before = chebyshev.copy()
    plain(stages.add_slip)(0, work.slip, shares, chebyshev)
    plain(stages.add_share)(0, chebyshev, shares[0], 2.5)
    np.testing.assert_allclose(chebyshev, before + work.slip @ shares + 2.5 * shares[0], rtol=1e-12)


@pytest.mark.parametrize(("region", "expected"), [(stages.SLIDING, (-1.0, 0.0)), (stages.FALLING, None)])
def test_a_law_is_constant_in_fast_slip(region, expected):
    work = np.zeros(1, WORK).view(np.recarray)[0]
    work.slip[:] = np.linspace(-3.0, -1.0, 16)
    plain(stages.law_at_nodes)(Place(region, -1.0, 0.0, 0.0), None, STRIBECK, work)
    law, slope = expected or (sliding(work.slip, -1.0, STRIBECK), sliding_slope(work.slip, STRIBECK))
    np.testing.assert_allclose(work.law, law)
    np.testing.assert_allclose(work.slope, slope)
