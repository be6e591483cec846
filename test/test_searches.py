"""The product of searches and what their trials may raise: a search goes on after OutOfRange, and a refusal ends it."""

from types import SimpleNamespace

import numpy as np
import pytest

from tcc_sim.errors import InputError, NumericalFailure, OutOfRange
from tcc_sim.estimation import operating_point, search, slip_loop
from tcc_sim.model import pure_stick
from tcc_sim.model.parameters import System
from tcc_sim.replay import segments
from tcc_sim.solvers import fixed_step_solve
from tcc_sim.solvers.problem import Problem
from tcc_sim.study.benchmarks import stability
from tcc_sim.study.continuation import newton, palc
from tcc_sim.study.continuation.problem import FAILURES
from tcc_sim.study.continuation.settings import DEFAULTS
from tcc_sim.trajectory import State, Status
from tcc_sim.views import dense

SYSTEM = System()


def failing(error, at, result):
    """A function that raises `error` at its calls number `at`, from 0 on, and else returns `result` of its
    arguments.
    """
    calls = iter(range(1000))

    def trial(*arguments, **named):
        if next(calls) in at:
            raise error("a trial failed")
        return result(*arguments, **named)

    return trial


def operating_points(patch, error):
    """The motion at the nearest of the pressures that have one."""
    patch(operating_point, "_settled", failing(error, {0, 1}, lambda system: (1, np.zeros(3))))
    patch(operating_point, "closed", lambda system, period, state, slip: SimpleNamespace(
        mean_slip=1.0, system=system, period=period, segments=[SimpleNamespace(state=state)]))
    return operating_point._from_settled(SYSTEM, 3e5, 20.0, NumericalFailure("none")).mean_slip == 1.0


def smallest_slips(patch, error):
    """Slip below 3 rad/s has no motion, which is no stable loop."""
    def motion_of(near, slip):
        if slip < 3.0:
            raise error("a trial failed")
        return near

    patch(slip_loop, "_with_slip", motion_of)
    patch(slip_loop, "_Loop", SimpleNamespace(about=lambda *_: SimpleNamespace(growth=lambda: -1.0)))
    return slip_loop._smallest_slip(SimpleNamespace(mean_slip=20.0), 1, (0.0, 0.0), False) == pytest.approx(3.0,
                                                                                                            rel=1e-2)


def profiles(patch, error):
    """Values of a key at which no fit exists are left out."""
    patch(search, "fit", failing(error, {3}, lambda *_: SimpleNamespace(chi2=2.0)))
    patch(search, "Model", lambda *_: None)
    best = SimpleNamespace(values=np.array([3000.0, 0.1]), residuals={"slip_speed": np.zeros(90)}, chi2=1.0,
                           starts=None)
    model = SimpleNamespace(keys=("driveline.stiffness", "driveline.damping"), system=SYSTEM, measured=None)
    excess = search.profile_likelihood(model, {}, SimpleNamespace(stages=[None]), best, model.keys[0],
                                       np.ones(2)).excess
    return np.flatnonzero(np.isnan(excess)).tolist() == [3]


def stick_limits(patch, error):
    """A frequency without a steady state has no stick."""
    def margin_of(system):
        if system.engine.frequency > 100.0:
            raise error("a trial failed")
        return SimpleNamespace(torque=1.0)

    patch(pure_stick, "stick_margin", margin_of)
    return pure_stick.stick_limits(SYSTEM, 50.0, 200.0).lower == pytest.approx(100.0)


def ticks(patch, error):
    """A tick that needs too many sub-steps is not solved again."""
    patch(dense, "substeps", failing(error, {0}, lambda *_: 1))
    patch(dense, "advance", lambda state, t, h, n, terms, flywheel, out: out.fill(7.0))
    recorded = SimpleNamespace(t=np.arange(3.0), engine_torque=np.ones(3), saturation_torque=np.ones(3))
    states = dense._solved(recorded, SYSTEM, np.zeros((3, 3)), 1, np.ones(2, bool))
    return np.isnan(states[0]).all() and (states[1] == 7.0).all()


def segment_figures(patch, error):
    """A segment without a whole cycle has no figures."""
    stream = SimpleNamespace(numbers={0: 0}, summary=failing(error, {0}, None))
    return segments._summary(SimpleNamespace(states=SimpleNamespace(run=0)), None, stream, None) is None


def extreme_steps(patch, error):
    """A step that a method cannot take has no error."""
    patch(stability, "solve", failing(error, {0}, None))
    return stability._error(SYSTEM, "rk4", 1e-3, SimpleNamespace()) is None


def fixed_steps(patch, error):
    """A scene that needs too many sub-steps has a Status."""
    patch(fixed_step_solve, "substeps", failing(error, {0}, None))
    problem = Problem(SYSTEM, State.at_start(SYSTEM), 1, 0.0, 0, None, 1e-3)
    return fixed_step_solve.solve(problem).status is Status.REFUSED


def correctors(patch, error):
    """A point of a branch outside the ranges is not taken."""
    equations = SimpleNamespace(settings=DEFAULTS, linearise=failing(error, {0}, None))
    return palc.corrector(equations, np.zeros(2), np.ones(2), farthest=1.0, plane=palc.FLAT) is None


def orbits(patch, error):
    """A start outside the ranges leads to no orbit."""
    return newton.newton(SimpleNamespace(settings=DEFAULTS, size=2, linearise=failing(error, {0}, None)),
                         np.zeros(2)) is None


SEARCHES = [operating_points, smallest_slips, profiles, stick_limits, ticks, segment_figures, extreme_steps,
            fixed_steps, correctors, orbits]


@pytest.mark.parametrize("run", SEARCHES)
def test_a_search_goes_on_after_what_it_may_meet_and_ends_with_a_refusal(run, monkeypatch) -> None:
    assert run(monkeypatch.setattr, OutOfRange)
    with pytest.raises(InputError, match=r"^a trial failed$"):
        run(monkeypatch.setattr, InputError)


def test_no_search_of_the_study_catches_a_refusal() -> None:
    assert not issubclass(InputError, FAILURES)
    assert issubclass(OutOfRange, FAILURES)
