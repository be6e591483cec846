"""The product of terms of the model and those who support them: every cell is right by an independent answer, or
refused.
"""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
from differences import difference
from independent import Piecewise, equations, smoothed_states, tangent_map
from scipy.integrate import solve_ivp, trapezoid

from tcc_sim.analysis.steady.damping import damping_of_cycles
from tcc_sim.analysis.steady.exponents import largest_lyapunov_exponent
from tcc_sim.errors import InputError
from tcc_sim.estimation.identify import identify
from tcc_sim.estimation.linearise import linearise
from tcc_sim.estimation.measurement import Measurement
from tcc_sim.fmi.export import fmu_of
from tcc_sim.model.closed_forms import plate_angle, pure_slip, stick_margin
from tcc_sim.model.equations import SUPPORTED, unsupported
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.profile import Inputs
from tcc_sim.plant.driveline import Plant
from tcc_sim.scene import load_scene
from tcc_sim.solvers import SOLVERS, solve
from tcc_sim.solvers.stroboscopic import sections, stroboscopic_map
from tcc_sim.study.basins.compute import basins
from tcc_sim.study.benchmarks.peers import xppaut_file
from tcc_sim.study.benchmarks.references import coefficient_and_slope, reference, sliding_of
from tcc_sim.study.continuation.motions import DrivelineMap, continuation
from tcc_sim.study.paper.harmonic_balance import harmonic_balance
from tcc_sim.trajectory import State

BASE = replace(System(), {"friction.smoothing": 8.0, "pressure.mean": 225e3, "pressure.amplitude": 45e3,
                          "engine.mean_torque": 200.0, "engine.torque_amplitude": 350.0, "initial.slip_speed": 5.0,
                          "initial.plate_angle": 0.1, "initial.plate_speed": -5.0})
"""Sticks and slips; the smoothing keeps explicit methods affordable."""
V = (np.linspace(0.0, 1.0, 25) ** 2 * 60.0).tolist()
SPEED = np.array([[0.0, 0.0, 100.0], [0.05, 5.0, 0.0]])
CASES: dict[str, System] = {
    "harmonics": replace(BASE, {"engine.harmonic_amplitudes": [60.0], "engine.harmonic_phases": [0.4]}),
    "curve": replace(BASE, {"friction.slip_speeds": V, "friction.coefficients": [0.3 - 0.016 * np.log1p(2.0 * v)
                                                                                 for v in V]}),
    "profile": replace(BASE, {"engine.mean_torque_times": [0.0, 0.06], "engine.mean_torque_values": [200.0, 320.0]}),
    "far": dataclasses.replace(BASE, inputs=Inputs(None, None, 0.2, SPEED)),
    "plate_by_slip": replace(BASE, {"converter.coupling": 2.0}),
    "every term": replace(BASE, {"friction.slip_speeds": V, "friction.coefficients": [
        0.3 - 0.016 * np.log1p(2.0 * v) for v in V], "converter.coupling": 2.0, "engine.harmonic_amplitudes": [60.0],
                                 "engine.harmonic_phases": [0.4]}),
}
"""A scene with each term besides those that BASE has; `far` brings inputs too."""
START, CYCLES = (5.0, 0.1, -5.0, 0.1), 2


def derivative(of, x: np.ndarray, step: float) -> np.ndarray:
    """The Jacobian at x by differences of fourth order."""
    return np.stack([difference(lambda h, e=e: of(x + h * e), step) for e in np.eye(len(x))], axis=1)


@cache
def truth(name: str, law: str, per_cycle: int = 10) -> np.ndarray:
    """States by SciPy on separately written equations."""
    system = CASES[name]
    if law == "set_valued":
        times = np.arange(CYCLES * per_cycle + 1) * system.cycle / per_cycle
        return Piecewise(system).run(CYCLES * system.cycle, times, slices=100)[0]
    if name not in ("profile", "far"):
        return smoothed_states(system, START, CYCLES, per_cycle)
    rates, _ = equations(system)
    d, fixed = system.driveline, system.engine.mean_torque

    def right(t, y):
        """The torque of the profile less the constant one; the far end's speed and angle."""
        out = np.array(rates(t, y[:4]))
        more = np.interp(t, [0.0, 0.06], [200.0, 320.0]) - fixed if name == "profile" else 0.0
        speed = min(100.0 * t, 5.0) if name == "far" else 0.0
        pull = (d.damping * speed + d.stiffness * y[4]) / d.plate_inertia
        return [out[0] + more / d.flywheel_inertia - pull, out[1], out[2] + pull, out[3], speed]

    times = np.arange(CYCLES * per_cycle + 1) * system.cycle / per_cycle
    return solve_ivp(right, (0.0, times[-1]), [*START, 0.0], "LSODA", times, rtol=1e-10, atol=1e-10,
                     max_step=1e-3).y[:4].T


def states(run) -> np.ndarray:
    return np.stack([run.slip_speed, run.plate_angle, run.plate_speed], axis=1)


@pytest.mark.parametrize(("name", "solver"), [
    (name, solver) for name in CASES for solver in SOLVERS
    if SOLVERS[solver].module != "comparison" or name == "far" or (
        name, solver) == ("every term", "rk45")])
def test_solvers(name, solver) -> None:
    """Solvers for comparison share what knows the terms; "every term" has all but inputs and profiles."""
    system = CASES[name]
    law = "smoothed" if "smoothed" in SOLVERS[solver].laws else "set_valued"
    system = dataclasses.replace(system, friction=replace(system, {"friction.law": law}).friction)
    if unsupported(solver, system):
        with pytest.raises(InputError, match=f"solver {solver} does not solve .*; those that do are") as refused:
            solve(system, cycles=1, solver=solver)
        able, smooth, _ = str(refused.value).partition(" are ")[2].partition(", with friction.law smoothed")
        shown = dataclasses.replace(system, friction=replace(system, {"friction.law": "smoothed"}).friction)
        solves = {which: [n for n in SOLVERS if not unsupported(n, which)] for which in (system, shown)}
        assert able.split(", ") == solves[system] or (not solves[system] and able.split(", ") == solves[shown])
        assert bool(smooth) == (not solves[system])
        return
    options = {"step": 2e-6 if solver == "rk4" else 2e-5} if SOLVERS[solver].setting == "step" else {"rtol": 1e-8}
    cycles = 1 if SOLVERS[solver].module == "comparison" else CYCLES
    result = states(solve(system, cycles=cycles, samples_per_cycle=10, solver=solver, **options).raise_for_status())
    exact = truth(name, law)[:10 * cycles + 1, :3]
    tolerance = 1e-5 if solver == "fixed_step" else 2e-6
    assert (np.abs(result - exact).max(axis=0) <= tolerance * np.abs(exact).max(axis=0)).all()


def test_section_maps_and_their_derivatives() -> None:
    """Of all terms with one exponential, whose kernels are shipped."""
    system, point = replace(CASES["harmonics"], {"converter.coupling": 2.0}), np.array(START[:3])
    exact = smoothed_states(system, START, CYCLES, 10)
    image = stroboscopic_map(system, point, CYCLES)
    np.testing.assert_allclose(image.state, exact[-1, :3], rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(sections(system, point[None], 0, CYCLES, 1e-10)[0, -1], exact[-1, :3], rtol=1e-6,
                               atol=1e-7)
    _, derivatives = tangent_map(system, point, 0, CYCLES)
    np.testing.assert_allclose(image.derivative, derivatives, rtol=1e-4, atol=1e-5 * np.abs(derivatives).max())


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
@pytest.mark.parametrize("coupling", [0.0, 2.0])
def test_derivatives_by_the_coupling(law, coupling) -> None:
    """Also where there is none, whose kernel has the term at 0."""
    system = replace(BASE, {"converter.coupling": coupling, "friction.law": law, "initial.slip_speed": 40.0})
    state = np.array([40.0, 0.1, -5.0])
    image = stroboscopic_map(system, state, 1, parameters=["converter.coupling"]).by_parameter[:, 0]
    base = max(coupling, 0.1)

    def after(b):
        moved = replace(system, {"converter.coupling": float(b[0])})
        if law == "smoothed":
            return smoothed_states(moved, (*state, 0.1), 1, 1)[-1, :3]
        start = replace(moved, {"initial.plate_angle": 0.1, "initial.plate_speed": -5.0})
        return Piecewise(start).run(start.cycle, np.array([start.cycle]), slices=100)[0][-1, :3]

    if coupling:
        expected = derivative(after, np.array([base]), 1e-3)[:, 0]
    else:  # On the side that is allowed, of second order.
        zero, one, two = (after([h]) for h in (0.0, 1e-3, 2e-3))
        expected = (4.0 * one - 3.0 * zero - two) / 2e-3
    np.testing.assert_allclose(image, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())


def test_equivalent_damping() -> None:
    """(21) over the motion with the coupling, of friction's slope alone; its threshold has the coupling."""
    system = CASES["plate_by_slip"]
    run = solve(system, cycles=1, rtol=1e-9)
    damping = damping_of_cycles(system, run.cycles, 0, 1)
    dense = smoothed_states(system, START, 1, 20000)
    t = np.linspace(0.0, system.cycle, 20001)
    load = system.saturation_mean + system.saturation_amplitude * np.sin(system.engine.frequency * t)
    pairs = sliding_of(system.friction)[1]
    slope = load * [coefficient_and_slope(v, pairs, system.friction.smoothing)[1] for v in dense[:, 0]]
    square = dense[:, 0] ** 2
    assert damping.weighted == pytest.approx(trapezoid(slope * square, t) / trapezoid(square, t), rel=1e-3)
    assert damping.threshold == -0.6 - 2.0


def test_loads_keep_friction_and_the_fluid_apart() -> None:
    system = CASES["every term"]
    t = np.linspace(0.0, system.cycle, 20001)
    dense = smoothed_states(system, START, 1, 20000)
    v = dense[:, 0]
    pairs, sigma = sliding_of(system.friction)[1], system.friction.smoothing
    load = system.saturation_mean + system.saturation_amplitude * np.sin(system.engine.frequency * t)
    friction = load * [coefficient_and_slope(x, pairs, sigma)[0] for x in v]
    for solver, tight in (("smoothed", 1e-6), ("fixed_step", 1e-4), ("rk45", 1e-4)):
        run = solve(system, cycles=1, samples_per_cycle=40, solver=solver, loads_from=0,
                    **({"step": 2e-5} if solver == "fixed_step" else {"rtol": 1e-9}))
        loads = run.cycles.loads
        assert loads.energy[0] == pytest.approx(trapezoid(friction * v, t), rel=tight)
        assert loads.coupling_energy[0] == pytest.approx(trapezoid(2.0 * v * v, t), rel=tight)
        np.testing.assert_allclose(run.friction_torque, friction[::500], atol=1e-2)
        assert run.coupling_torque == pytest.approx(2.0 * run.slip_speed)
        assert "coupling_torque" in run.columns()
    assert "coupling_torque" not in solve(BASE, cycles=1).columns()


def test_linear_models() -> None:
    """About a constant motion by differences of separately written equations; about a periodic one by a simulation."""
    still = replace(CASES["plate_by_slip"], {"engine.torque_amplitude": 0.0, "pressure.amplitude": 0.0,
                                             "engine.mean_torque": 600.0})
    linearised = linearise(still, frequencies=np.array([10.0, 300.0]), slip=30.0)
    held = replace(still, {"pressure.mean": linearised.pressure})
    rates, _ = equations(held)
    twist = 600.0 / 3000.0
    assert np.abs(rates(0.0, [30.0, twist, 0.0, 0.0])).max() == pytest.approx(30.0, rel=1e-9)  # theta1' alone.
    expected = derivative(lambda x: np.array(rates(0.0, [*x, 0.0]))[:3], np.array([30.0, twist, 0.0]), 1e-3)
    np.testing.assert_allclose(linearised.a, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
    runs = linearise(replace(still, {"pressure.mean": 1e5}), frequencies=np.array([10.0]))
    load = 0.24 * 0.008 * 1e5
    assert runs.mean_slip == pytest.approx((600.0 - load) / 2.0, rel=1e-9)  # The fluid carries the rest.


def test_identification_finds_the_coupling() -> None:
    system = replace(BASE, {"converter.coupling": 2.0})
    step, count = 1e-3, 300
    rates, jacobian = equations(system)
    t = np.arange(count + 1) * step
    exact = solve_ivp(rates, (0.0, t[-1]), START, "LSODA", t, jac=jacobian, rtol=1e-10, atol=1e-10, max_step=1e-3).y
    noise = {"slip_speed": 0.05, "plate_speed": 0.05}
    rng = np.random.default_rng(3)
    measured = Measurement(t, {"slip_speed": exact[0] + 0.05 * rng.standard_normal(count + 1),
                               "plate_speed": exact[2] + 0.05 * rng.standard_normal(count + 1)})
    scene = load_scene("fig02").with_values({key: BASE.value(key) for key in (
        "friction.smoothing", "pressure.mean", "pressure.amplitude", "engine.mean_torque", "engine.torque_amplitude")})
    result = identify(measured, {"converter.coupling": 1.5}, scene=scene, noise=noise)
    parameter, = result.parameters
    assert result.accepted, result
    assert abs(parameter.value - 2.0) < 4.0 * parameter.standard_error < 0.4


def test_the_node_follows_a_change_while_running() -> None:
    scene = load_scene("fig02").with_values({"pacing": "lockstep", "friction.smoothing": 8.0, "rate": 20000.0})
    plant, before = Plant(scene), 400
    rows = [plant.advance() for _ in range(before)]
    plant.use(scene.with_values({"converter.coupling": 3.0}))
    rows += [plant.advance() for _ in range(400)]
    systems = scene.system, scene.with_values({"converter.coupling": 3.0}).system
    y, t = np.array([150.0, 0.0, 0.0, 0.0]), 0.0
    for system, end in zip(systems, (before / 20000.0, 2 * before / 20000.0)):
        rates, jacobian = equations(system)
        y, t = solve_ivp(rates, (t, end), y, "LSODA", jac=jacobian, rtol=1e-10, atol=1e-10, max_step=1e-3).y[:, -1], end
    assert rows[-1].slip_speed == pytest.approx(y[0], rel=1e-5)
    assert rows[-1].plate_angle == pytest.approx(y[1], rel=1e-5)


def as_scene(system):
    return load_scene("fig02").with_values({"friction.law": system.friction.law})


CONSUMERS = {
    "section map": [lambda s: stroboscopic_map(s, np.zeros(3), 1), lambda s: sections(s, np.zeros((1, 3)), 0, 1, 1e-8),
                    lambda s: DrivelineMap(s, ("engine.frequency",)).evaluate(np.zeros(3), np.array([150.0]), 0.0, 1.0),
                    lambda s: continuation(s, "engine.mean_torque", 190.0, 210.0),
                    lambda s: largest_lyapunov_exponent(s, State(1.0, 0.0, 0.0, 0.0), cycles=40),
                    lambda s: basins(s, [("initial.slip_speed", [0.0, 1.0]), ("initial.plate_angle", [0.0, 0.1])]),
                    lambda s: damping_of_cycles(s, solve(BASE, cycles=1).cycles, 0, 1), linearise],
    "tick derivatives": [lambda s: identify(Measurement(np.arange(100) * 1e-3, {
        "slip_speed": np.random.default_rng(1).standard_normal(100)}),
                                            {"driveline.damping": 0.5}, scene=as_scene(s))],
    "node": [lambda s: Plant(as_scene(s))], "FMU": [lambda s: fmu_of(as_scene(s))],
    "pure slip": [pure_slip], "pure stick": [stick_margin, plate_angle],
    "harmonic balance": [lambda s: harmonic_balance(s, 1, 3)], "reference": [lambda s: reference(s, 1, "LSODA", 1e-6)],
    "peer": [lambda s: xppaut_file(s, "cvode", 1e-6, 1, 10)],
    **{name: [lambda s, name=name: solve(s, cycles=1, solver=name)] for name in SOLVERS},
}
"""All that a row of SUPPORTED stands for."""
NAMES = {"profile": "engine.mean_torque_times", "far": "inputs", "curve": "friction.coefficients",
         "harmonics": "engine.harmonic_amplitudes", "plate_by_slip": "converter.coupling",
         "smoothed": "friction.law", "set_valued": "friction.law"}
SYSTEMS = {**CASES, "curve": CASES["every term"], "smoothed": BASE,
           "set_valued": replace(BASE, {"friction.law": "set_valued"})}
FLAT = {"friction.kinetic_coefficient": 0.3}
UNKNOWN = [(who, place, name) for who, asks in CONSUMERS.items() for place in range(len(asks)) for name in NAMES
           if name in unsupported(who, SYSTEMS[name]) and (
               who not in ("tick derivatives", "node", "FMU") or NAMES[name] == "friction.law")]


@pytest.mark.parametrize(("who", "place", "name"), UNKNOWN)
def test_a_term_that_a_row_does_not_have_is_refused_with_the_key_that_brings_it(who, place, name) -> None:
    with pytest.raises(InputError) as refused:
        CONSUMERS[who][place](SYSTEMS[name] if who != "pure slip" else replace(SYSTEMS[name], FLAT))
    assert NAMES[name] in str(refused.value)


def test_every_row_is_asked() -> None:
    assert CONSUMERS.keys() == SUPPORTED.keys()
