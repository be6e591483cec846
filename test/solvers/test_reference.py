"""SciPy's methods and the classical one against closed forms and each other."""


import numpy as np
import pytest
from scipy.integrate import solve_ivp, trapezoid

from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import Status, solve
from tcc_sim.solvers.per_cycle import cycle_starts, cycles_from_samples
from tcc_sim.solvers.terms import terms_of

BASE = replace(System(), {"pressure.mean": 225e3, "pressure.amplitude": 0.0, "friction.kinetic_coefficient": 0.3})
STICK_SLIP = replace(BASE, {"engine.frequency": 142.0, "initial.slip_speed": 1.0, "friction.kinetic_coefficient": 0.24})


def test_flywheel_angle_is_the_integral_of_its_speed():
    run = solve(STICK_SLIP, cycles=1, samples_per_cycle=2000, solver="rk4", flywheel_angle=True, step=2e-6)
    speed = run.slip_speed + run.plate_speed
    assert run.flywheel_angle[-1] - run.flywheel_angle[0] == pytest.approx(trapezoid(speed, run.t), rel=1e-6)


def test_blow_up_is_a_status():
    run = solve(replace(STICK_SLIP,
                        {"friction.smoothing": 1e6, "driveline.plate_inertia": 1e-3, "driveline.damping": 100.0}),
                cycles=30, solver="rk4", step=1e-3)
    assert run.status is Status.NOT_FINITE
    assert np.all(np.isfinite(run.slip_speed))


def test_too_many_steps_are_refused():
    run = solve(replace(System(), {"engine.frequency": 1.0}), cycles=1000, solver="rk4", step=1e-9)
    assert run.status is Status.REFUSED


def test_jacobian_is_the_derivative_of_the_rates():
    from tcc_sim.solvers.comparison.scipy_methods import jacobian, rates_of
    terms = terms_of(replace(STICK_SLIP, {"pressure.amplitude": 5e4}))
    y = np.array([0.013, 0.1, 3.0, 0.2])
    found = jacobian(0.01, y, terms)
    for k, h in enumerate((1e-6, 1e-6, 1e-4, 1e-4)):
        step = np.zeros(4)
        step[k] = h
        slope = (rates_of(0.01, y + step, terms) - rates_of(0.01, y - step, terms)) / (2 * h)
        np.testing.assert_allclose(found[:, k], slope, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
def test_compiled_steps_of_rk45_are_those_of_scipy(rtol):
    """The same number of steps to the same state, through slip and a stop: SciPy's RK45 on the same equations."""
    from tcc_sim.solvers.comparison.scipy_methods import rates_of
    system = replace(STICK_SLIP, {"friction.smoothing": 5.0, "pressure.amplitude": 5e4})
    run = solve(system, cycles=1, solver="rk45", rtol=rtol, samples_per_cycle=8)
    terms, twist = terms_of(system), 550.0 / system.driveline.stiffness
    sizes = np.array([1.0 / 5.0, twist, twist * system.natural_frequency])
    scipy = solve_ivp(lambda t, y: rates_of(t, y, terms), (0.0, system.cycle), [1.0, 0.0, 0.0], rtol=rtol,
                      atol=rtol * sizes, dense_output=True)
    assert run.statistics.steps == len(scipy.t) - 1
    found = np.array([run.slip_speed, run.plate_angle, run.plate_speed])
    np.testing.assert_allclose(found, scipy.sol(run.t), rtol=1e-10, atol=1e-10)


def test_cycles_are_those_of_dense_samples():
    run = solve(STICK_SLIP, cycles=2, samples_per_cycle=4000, solver="radau", rtol=1e-9)
    rates = np.gradient(run.slip_speed, run.t)
    dense = cycles_from_samples(run.t, run.slip_speed, rates, run.plate_angle, run.plate_speed,
                                np.gradient(run.plate_speed, run.t), stick_speed=0.0,
                                starts=cycle_starts(0, run.t[-1], run.cycle))
    np.testing.assert_allclose(run.cycles.highest, dense.highest, rtol=1e-5)
