"""Transfer functions beside closed forms, SciPy and simulated responses."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from documents import valid
from independent import Piecewise
from scipy.integrate import odeint
from scipy.signal import StateSpace

from tcc_sim import cli
from tcc_sim.errors import InputError
from tcc_sim.estimation.linearise import INPUTS, OUTPUTS, harmonic_transfer, linearise
from tcc_sim.estimation.operating_point import mean_rows, operating_point
from tcc_sim.model.parameters import replace as changed
from tcc_sim.scene import load_scene

CONTROLLED = load_scene("controlled")
CONSTANT = {"engine.torque_amplitude": 0.0}


def apart(one: complex, other: complex) -> np.ndarray:
    """Difference of two responses, dB and degrees."""
    ratio = one / other
    return np.abs([20.0 * math.log10(abs(ratio)), math.degrees(np.angle(ratio))])


def slip_rates(x: np.ndarray, pressure: float, torque: float) -> tuple[float, float, float, float, float]:
    """Rates of `controlled` by (2a), (2b), (7), and its friction and shaft torque."""
    law = (1.0 + (0.3 / 0.27 - 1.0) * math.exp(-2.0 * abs(x[0]))) * math.tanh(50.0 * x[0])
    friction, spring = law * 0.27 * 0.08 * 0.1 * pressure, 3000.0 * x[1] + 0.6 * x[2]
    plate = (friction - spring) / 0.02
    return (torque - friction) / 0.2 - plate, x[2], plate, friction, spring


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
@pytest.mark.parametrize("output", OUTPUTS)
@pytest.mark.parametrize("inputs", INPUTS)
def test_constant_slip_is_the_linear_model_of_the_equations(inputs: str, output: str, law: str) -> None:
    """Differences of the equations, written out here; at this slip tanh(50 v) is 1, so that both laws are one."""
    v, which = 0.8, list(INPUTS).index(inputs)
    linearised = linearise(CONTROLLED.with_values(CONSTANT | {"friction.law": law}), slip=v, input=inputs,
                           output=output, frequencies=[3.0, 400.0])
    assert (linearised.kind, linearised.dt) == ("slip", 0.0)

    def motion(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        *rates, friction, spring = slip_rates(x, *u)
        return np.array([*rates, {"slip_speed": x[0], "friction_torque": friction, "shaft_torque": spring}[output]])

    x, u = np.array([v, 200.0 / 3000.0, 0.0]), np.array([linearised.pressure, 200.0])
    assert np.abs(motion(x, u)[:3]).max() < 1e-8
    rows = np.array([(motion(x + h, u) - motion(x - h, u)) / 2e-6 for h in 1e-6 * np.eye(3)]).T
    step = np.diag([1.0, 1e-3])[which]
    by_input = (motion(x, u + step) - motion(x, u - step)) / (2.0 * step[which])
    assert linearised.a == pytest.approx(rows[:3], rel=1e-5, abs=1e-4)
    assert linearised.b[:, 0] == pytest.approx(by_input[:3], rel=1e-5, abs=1e-9)
    assert linearised.c[0] == pytest.approx(rows[3], rel=1e-5, abs=1e-5)
    assert linearised.d[0, 0] == pytest.approx(by_input[3], rel=1e-5, abs=1e-9)
    s = 1j * linearised.frequencies[:, None, None]
    bode = (linearised.c @ np.linalg.solve(s * np.eye(3) - linearised.a, linearised.b[None]) + linearised.d)[:, 0, 0]
    assert linearised.response == pytest.approx(bode, rel=1e-9, abs=1e-12 * np.abs(bode).max())
    assert (np.diff(np.abs(linearised.multipliers)) <= 0.0).all()


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
def test_constant_stick_is_one_oscillator(law: str) -> None:
    scene = CONTROLLED.with_values(CONSTANT | {"friction.law": law, "pressure.mean": 2e5, "friction.smoothing": 1e5})
    linearised = linearise(scene, input="engine_torque", output="shaft_torque", frequencies=[1.0, 50.0, 116.0, 300.0])
    omega = linearised.frequencies
    stuck = (3000.0 + 0.6j * omega) / (3000.0 - 0.22 * omega**2 + 0.6j * omega)
    assert linearised.kind == "stick"
    assert linearised.response == pytest.approx(stuck, rel=1e-9 if law == "set_valued" else 1e-4)


def test_slip_without_slope_is_the_integrator_behind_the_plate() -> None:
    """mu_k = mu_s and a pulsating torque: slip is linear for any motion."""
    scene = CONTROLLED.with_values({"friction.kinetic_coefficient": 0.3})
    omegas = np.array([2.0, 30.0, 150.0, 380.0])
    linearised = linearise(scene, slip=30.0, frequencies=omegas)
    gain, s = 0.3 * 0.08 * 0.1, 1j * omegas
    exact = -gain * (1.0 / (0.2 * s) + s / (0.02 * s**2 + 0.6 * s + 3000.0))
    assert linearised.kind == "periodic"
    assert linearised.response == pytest.approx(exact, rel=2e-3)
    assert linearised.mean_slip == pytest.approx(30.0, abs=1e-6)


@pytest.mark.parametrize(("engine", "amplitude", "highest"), [(5.0, 12.0, 400.0), (150.0, 120.0, 2e4)])
def test_a_response_is_within_one_percent_or_refused(engine: float, amplitude: float, highest: float) -> None:
    """Slip alone, as above: coarse segments were 22 % off at 387 rad/s for an engine at 2 rad/s."""
    scene = CONTROLLED.with_values({"friction.kinetic_coefficient": 0.3, "engine.frequency": engine,
                                    "engine.torque_amplitude": amplitude})
    omegas = np.geomspace(3.0, highest, 4)
    result, s = linearise(scene, slip=30.0, frequencies=omegas), 1j * omegas
    exact = -0.3 * 0.08 * 0.1 * (1.0 / (0.2 * s) + s / (0.02 * s**2 + 0.6 * s + 3000.0))
    assert np.abs(result.response / exact - 1.0).max() < 0.01
    with pytest.raises(InputError, match=r"1e\+06 rad/s needs more than 65536 segments"):
        linearise(scene, slip=30.0, frequencies=[10.0, 1e6])


def test_the_discrete_model_of_a_motion_with_stick_is_right_for_slow_inputs() -> None:
    """Friction carries the engine's mean torque at last, and a pressure changes the slip speed alone."""
    slow = harmonic_transfer(operating_point(CONTROLLED.system, 6.0), "actuation_pressure", "slip_speed",
                             np.array([1e-3]))[0].real
    for inputs, output, steady in (("actuation_pressure", "slip_speed", slow),
                                   ("engine_torque", "friction_torque", 1.0),
                                   ("actuation_pressure", "friction_torque", 0.0)):
        m = linearise(CONTROLLED, slip=6.0, input=inputs, output=output, frequencies=[1.0])
        found = (m.c @ np.linalg.solve(np.eye(3) - m.a, m.b) + m.d)[0, 0]
        assert found == pytest.approx(steady, rel=1e-3, abs=1e-5 if output == "friction_torque" else 0.0)


def test_the_default_range_reaches_three_times_the_slipping_mode() -> None:
    linearised = linearise(CONTROLLED.with_values(CONSTANT), slip=20.0)
    assert (linearised.frequencies[0], linearised.frequencies[-1]) == pytest.approx((2.0,
                                                                                     3.0 * math.sqrt(3000.0 / 0.02)))


def test_a_mean_motion_is_that_without_excitation() -> None:
    scene = CONTROLLED.with_values({"engine.harmonic_amplitudes": [20.0], "engine.harmonic_phases": [0.3]})
    result, constant = linearise(scene, slip=6.0, mean=True), linearise(CONTROLLED.with_values(CONSTANT), slip=6.0)
    assert (result.dt, result.kind, result.mean_slip) == (0.0, "slip", 6.0)
    for name in ("a", "b", "c", "d", "response"):
        assert np.array_equal(getattr(result, name), getattr(constant, name)), name


def test_a_set_valued_motion_that_sticks_is_found_and_its_section_differentiated() -> None:
    """Beside SciPy from event to event: the motion returns with its mean slip; and differences by the slip speed, which
    ends at once and leaves its angular momentum to the plate: that column was 0.
    """
    motion = operating_point(CONTROLLED.with_values({"friction.law": "set_valued"}).system, 6.0)
    assert motion.system.pressure.mean == pytest.approx(101226.4, abs=0.2)
    start, cycle = motion.states[0], motion.system.cycle

    def after(slip_speed: float) -> np.ndarray:
        named = {"initial.slip_speed": slip_speed, "initial.plate_angle": start[1], "initial.plate_speed": start[2],
                 "pressure.amplitude": 0.0}
        return Piecewise(changed(motion.system, named)).run(cycle, np.array([0.0, cycle]))[0]

    still = after(0.0)
    assert still[1, :3] == pytest.approx(start, abs=1e-6)
    assert (np.diff(still[:, 3])[0] - np.diff(still[:, 1])[0]) / cycle == pytest.approx(6.0, abs=1e-4)
    column = (after(1e-2) - after(-1e-2))[1, :3] / 2e-2
    assert start[0] == 0.0
    assert motion.carried.by_state[-1][:, 0] == pytest.approx(column, rel=2e-3, abs=1e-6)
    assert motion.carried.by_state[-1][2, 0] > 0.4


def answers(slip: float, pressure: float, omegas: list[float]) -> list[complex]:
    """Answers of the slip speed to exp(i omega t) of the pressure, about the settled motion, by SciPy's LSODA.

    From runs with a cosine, with a sine and without; side bands at multiples of the engine's frequency are fitted too.
    """
    cycle, height = 2.0 * math.pi / 150.0, 2e-3
    t = np.arange(20.0 * cycle, 40.0 * cycle, cycle / 64.0)
    begin = operating_point(CONTROLLED.system, slip).states[0]

    def run(omega: float = 0.0, lead: float = 0.0) -> np.ndarray:
        def rates(at: float, x: np.ndarray) -> tuple[float, ...]:
            more = height * math.sin(omega * at + lead)
            return slip_rates(x, pressure * (1.0 + more), 200.0 + 250.0 * math.sin(150.0 * at))[:3]

        return odeint(rates, begin, np.append(0.0, t), tfirst=True, rtol=1e-8, atol=1e-9, mxstep=100_000)[1:, 0]

    free, out = run(), []
    for omega in omegas:
        moved = run(omega, 0.5 * math.pi) - free + 1j * (run(omega) - free)
        bands = [omega, *(w for n in range(1, 9) for w in (omega - 150.0 * n, omega + 150.0 * n) if abs(w) > 4.0)]
        columns = np.column_stack([*(np.exp(1j * w * t) for w in bands), np.ones_like(t), t])
        out.append(complex(np.linalg.lstsq(columns, moved, rcond=None)[0][0]) / (height * pressure))
    return out


@pytest.mark.parametrize(("slip", "frequencies"), [
    (20.0, [387.0]), (6.0, [75.0, 226.0])])
def test_periodic_motions_answer_as_simulated_ones(slip: float, frequencies: list[float]) -> None:
    """In slip, and with stick in every cycle, where a linear model about the mean is 20 dB and 80 degrees off; also at
    multiples of half the engine frequency and beside them, where side bands of a sine meet the answer to it.
    """
    linearised = linearise(CONTROLLED, slip=slip, frequencies=frequencies)
    assert (np.diff(np.abs(linearised.multipliers)) <= 0.0).all()
    for response, found in zip(linearised.response, answers(slip, linearised.pressure, frequencies)):
        assert np.all(apart(response, found) < (0.3, 2.0))


def test_a_lag_and_a_delay_of_the_actuator_cost_the_phase_of_their_closed_form() -> None:
    """The engine's torque does not pass the actuator."""
    acted, omegas = CONTROLLED.with_values({"pressure.time_constant": 0.03, "pressure.delay": 0.005}), [60.0]
    plain, result = (linearise(scene, slip=20.0, frequencies=omegas) for scene in (CONTROLLED, acted))
    np.testing.assert_allclose(result.gain / plain.gain, 1.0 / np.hypot(1.0, 0.03 * result.frequencies), rtol=1e-12)
    late = np.arctan(0.03 * result.frequencies) + 0.005 * result.frequencies
    np.testing.assert_allclose(plain.phase - result.phase, late, atol=1e-12)
    torque = [linearise(scene, slip=20.0, frequencies=omegas, input="engine_torque").response
              for scene in (CONTROLLED, acted)]
    np.testing.assert_allclose(*torque, rtol=1e-12)


def test_outputs_balance_where_slip_ends_within_a_part() -> None:
    """(2a): I1 d/dt (v + theta2') = Te - Tf, with theta2 from the shaft's torque, at every frequency and for means."""
    motion = operating_point(CONTROLLED.system, 2.0)
    omegas, d = np.array([4.0, 110.0, 226.0, 350.0]), motion.system.driveline
    s, carried = 1j * omegas, motion.carried
    by_state, by_input = mean_rows(motion)
    for column, inputs in enumerate(INPUTS):
        slip, friction, shaft = (harmonic_transfer(motion, inputs, output, omegas) for output in OUTPUTS)
        balanced = ((inputs == "engine_torque") - friction) / (d.flywheel_inertia * s)
        assert slip == pytest.approx(balanced - s * shaft / (d.stiffness + d.damping * s), rel=1e-3)
        start = np.linalg.solve(np.eye(3) - carried.by_state[-1], carried.by_input[-1])
        steady = (by_state @ start + by_input)[:, column]
        slow = [harmonic_transfer(motion, inputs, output, np.array([1e-4]))[0].real
                for output in ("slip_speed", "shaft_torque")]
        assert [steady[0], d.stiffness * steady[1]] == pytest.approx(slow, rel=1e-4)
        assert abs(steady[2]) < 1e-9 * abs(steady[0])


def test_the_command_writes_what_control_tools_take(tmp_path, capsys, pictures) -> None:
    names = {suffix: tmp_path / f"found{suffix}" for suffix in (".json", ".npz", ".png")}
    words = ["linearise", "controlled", "--slip", "20", "--frequencies", "200:300:3", "--json",
             str(names[".json"]), "--out", str(names[".npz"]), "--plot", str(names[".png"])]
    assert cli.main(words) == 0
    assert "periodic motion of 1 period of excitation" in capsys.readouterr().out
    document = valid("linearise", json.loads(names[".json"].read_text()))
    with np.load(names[".npz"]) as arrays:
        model = StateSpace(arrays["A"], arrays["B"], arrays["C"], arrays["D"], dt=float(arrays["dt"]))
        assert model.A.tolist() == document["A"]
    assert document["frequencies"][0] == pytest.approx(200.0)
    assert cli.main(words) == 2
    assert cli.main(["linearise", "controlled", "--frequencies", "2:0:5"]) == 2
