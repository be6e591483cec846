"""Errata of the paper: their texts from errata.yaml, functions that compute the numbers behind them, and their page."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from tcc_sim.analysis.steady.damping import damping_of_cycles
from tcc_sim.model import closed_forms
from tcc_sim.output.tables import escape, text
from tcc_sim.solvers import solve
from tcc_sim.study.continuation.arclength import chandrupatla
from tcc_sim.study.paper.catalogue import FIGURES, OMEGA_N, paper_system
from tcc_sim.study.paper.evidence import FREQUENCY, KINETIC, Evidence, rms_apart, two_digits, with_kinetic
from tcc_sim.study.paper.harmonic_balance import harmonic_balance, mean_friction_torque
from tcc_sim.study.paper.measures import PURE_SLIP, actuated
from tcc_sim.trajectory import integral

Numbers = Mapping[str, float | Sequence[float]]
"""Numbers that show an erratum, by name."""


def phases() -> Numbers:
    """Return phi of (8b) on both sides of omega_sn, rad."""
    system = paper_system()
    d, out = system.driveline, {}
    for ratio in (0.2, 0.4):
        omega = ratio * OMEGA_N
        printed = -math.atan(d.damping * omega / (d.stiffness - (d.flywheel_inertia + d.plate_inertia) * omega**2))
        out[f"phi at {ratio:g}, printed and right (rad)"] = [printed, closed_forms.stick_phase(system, omega)]
    return out


def amplitude() -> Numbers:
    """Return the second amplitude of (9) at 0.36."""
    d, omega = paper_system().driveline, 0.36 * OMEGA_N
    stuck = d.stiffness - (d.flywheel_inertia + d.plate_inertia) * omega**2
    return {"amplitude at 0.36, printed and right (N m)": [
        omega**2 * 250.0 / abs(stuck), d.flywheel_inertia * omega**2 * 250.0 / abs(complex(stuck, d.damping * omega))]}


def slip_condition() -> Numbers:
    """Evaluate (16) for an engine slower than the plate, and for a slow engine."""
    out = {}
    for speed in (-150.0, 30.0):
        motion = closed_forms.pure_slip(paper_system({**PURE_SLIP, "initial.slip_speed": speed}))
        out[f"Omega_e = {speed:g}: (16) as printed, with its sign, least slip with the transient (rad/s)"] = [
            abs(motion.a0) - motion.slip.swing(), motion.margin, motion.least_slip_speed]
    return out


def held_in_stick() -> Numbers:
    """Return the mean friction torque of a motion that sticks although Tm > Tsm, mu_k/mu_s = 0.55."""
    row = with_kinetic(0.55, {FREQUENCY: 0.36 * OMEGA_N})
    near = solve(paper_system(with_kinetic(0.57, row)), cycles=600).raise_for_status().final
    settled = solve(paper_system(row), cycles=2000, state=near).raise_for_status().final
    run = solve(paper_system(row), cycles=50, start_cycle=2000, samples_per_cycle=2000, state=settled)
    stuck = run.state == 0
    return {"Tm, Tsm, mean friction torque, that in stick (N m)": [
        300.0, paper_system(row).saturation_mean, float(run.friction_torque.mean()),
        float(run.friction_torque[stuck].mean())], "part of the time in stick": float(stuck.mean())}


def transient() -> Numbers:
    """Return the sine's amplitude in (17a), and the difference of the printed terms from the integral of theta2."""
    system = paper_system(PURE_SLIP)
    d = system.driveline
    decay, omega_n = 0.5 * d.damping / d.plate_inertia, system.natural_frequency
    zeta, damped = decay / omega_n, math.sqrt(omega_n**2 - decay**2)
    size = system.saturation_mean / d.stiffness
    t = np.linspace(0.0, 0.1, 20001)
    fade, cosine, sine = np.exp(-decay * t), np.cos(damped * t), np.sin(damped * t)
    printed = size * fade * (2.0 * zeta / omega_n * cosine + (2.0 * zeta**2 - 1.0) / damped * sine)
    angle = closed_forms.pure_slip(system).plate_angle(t)
    rest = integral(angle, t) - size * (t - 2.0 * zeta / omega_n)
    return {"amplitude of the sine, printed and right (rad/s)": [size * (1.0 - 2.0 * zeta**2) / damped,
                                                                 system.saturation_mean / (d.plate_inertia * damped)],
            "printed terms less those of the integral of theta2, largest, relative":
            float(np.abs(printed - rest).max() / np.abs(printed).max())}


def dissipation() -> Numbers:
    """Compare (21) with the damping that dissipates the friction energy of a cycle, mu_k = 0.667 mu_s."""
    out = {}
    for ratio in (0.12, 0.20, 0.25):
        system = paper_system(with_kinetic(0.667, {FREQUENCY: ratio * OMEGA_N}))
        before = solve(system, cycles=150)
        run = solve(system, cycles=16, samples_per_cycle=4096, start_cycle=150, state=before.final).raise_for_status()
        power, square = run.friction_torque * run.slip_speed, run.slip_speed**2
        damping = damping_of_cycles(system, before.solved_cycles[134:], 134, 0)
        out[f"at {ratio:g}, by energy and by (21) (N m s/rad)"] = [
            two_digits(power.sum() / square.sum()), two_digits(damping.weighted)]
    return out


def roots() -> Numbers:
    """Return roots of the characteristic polynomial of (22)."""
    d = paper_system().driveline

    def roots(damping: float) -> list[complex]:
        i1, i2, c, k = d.flywheel_inertia, d.plate_inertia, d.damping, d.stiffness
        return [complex(x) for x in np.roots([i1 * i2, i1 * (c + damping) + i2 * damping, i1 * k + damping * c,
                                              damping * k])]

    def pair(damping: float) -> float:
        return max(x.real for x in roots(damping) if abs(x.imag) > 1.0)

    return {"real root at Cf = -0.1, -0.3 (1/s)": [max(x.real for x in roots(c) if abs(x.imag) <= 1.0)
                                                   for c in (-0.1, -0.3)],
            "Cf at which the oscillatory pair crosses (N m s/rad)": chandrupatla(pair, -2.0 * d.damping,
                                                                                 -0.5 * d.damping)}


def stuck_frequency() -> Numbers:
    """Evaluate (27) and its right form."""
    d = paper_system().driveline
    both = d.flywheel_inertia + d.plate_inertia
    return {"printed and right (rad/s)": [d.stiffness / math.sqrt(both), math.sqrt(d.stiffness / both)]}


def driving_torques() -> Numbers:
    """Evaluate (29b) for Fig. 13, the torque that drives the slip, and the slip."""
    out = dict[str, Sequence[float]]()
    still = [paper_system({**s.values, FREQUENCY: 1e-3 * OMEGA_N}) for s in FIGURES[13].series]
    out["|Tp - (1 + I1/I2) Tsp| for Tsp/Tsm = 0, 0.125, 0.25, 0.5 (N m)"] = [
        closed_forms.equivalent_torque(s).swing() for s in still]
    out["|Tp - Tsp| (N m)"] = [abs(s.engine.torque_amplitude - s.saturation_amplitude) for s in still]
    for ratio in (0.20, 0.40):
        rows = [paper_system({**s.values, FREQUENCY: ratio * OMEGA_N}) for s in FIGURES[13].series]
        out[f"torque that drives the slip at {ratio:.2f}, plate motion eliminated (N m)"] = [
            closed_forms.slip_torque(s).swing() for s in rows]
        out[f"largest slip speed at {ratio:.2f} (rad/s)"] = [
            float(np.abs(solve(system, cycles=150).solved_cycles.highest[50:]).max()) for system in rows]
    return out


def series_means() -> Numbers:
    """Return the mean of (31) with and without c0, for omega_f = omega/2 at 150 rad/s."""
    system = paper_system(actuated(0.5))
    before = solve(system, cycles=600).raise_for_status()
    run = solve(system, cycles=2, samples_per_cycle=400, start_cycle=600, state=before.final).raise_for_status()
    off = []
    for count in (10, 20, 40):
        balance = harmonic_balance(system, 2, 2 * count)
        off.append(rms_apart(balance.slip_speed(run.t), run.slip_speed))
    return {"mean friction torque, printed and with c0 (N m); Tm = 300": [
        mean_friction_torque(system, balance.coefficient, 2, printed=True),
        mean_friction_torque(system, balance.coefficient, 2)],
        "most that the printed form allows, (2/pi) Tp (N m)": 2.0 / math.pi * system.engine.torque_amplitude,
        "a0, c0": [float(balance.slip[0]), float(balance.coefficient[0])],
        "corrected series against the simulation, rms, 10, 20, 40 harmonics of omega": off}


def phase_order() -> Numbers:
    """Return the torque that drives the slip for psi = 0, pi/2, pi."""
    return {f"at {ratio:.2f} for psi = 0, pi/2, pi (N m)": [
        closed_forms.slip_torque(paper_system({**s.values, FREQUENCY: ratio * OMEGA_N})).swing()
        for s in FIGURES[8].series] for ratio in (0.15, 0.40)}


def engine_speeds() -> Mapping[str, Mapping[str, float | None]]:
    """Return the highest mu_k/mu_s with period two in Fig. 6 from (13), for engine speeds that the paper may mean."""
    ratios, evidence = np.round(np.arange(0.76, 0.9401, 0.005), 6), Evidence(1e-9)
    speeds = {}
    for speed in (0.0, 50.0, 100.0, 150.0, 200.0):
        row = {FREQUENCY: 0.36 * OMEGA_N, "initial.slip_speed": speed}
        two = ratios[evidence.periods(evidence.curves([row], ratios, over=KINETIC)[0]) == 2]
        speeds[f"{speed:g}"] = float(two.max()) if len(two) else None
    return {"highest mu_k/mu_s with period 2 in Fig. 6, for an engine speed of (rad/s)": speeds}


@dataclass(frozen=True)
class Erratum:
    """Erratum of the paper with the fields of errata.yaml; `numbers` computes values that show the difference."""

    where: str
    printed: str
    right: str
    why: str
    numbers: Callable[[], Numbers] = dict


_TEXTS = yaml.safe_load(Path(__file__).with_name("errata.yaml").read_text(encoding="utf-8"))
ERRATA = tuple(Erratum(**{**row, "numbers": globals()[row["numbers"]] if "numbers" in row else dict})
               for row in _TEXTS["errata"])
"""Errata in the order of the paper."""
OPEN: dict[str, str] = _TEXTS["open"]
"""Values that the paper leaves open, and those taken here."""


def errata_page() -> str:
    """Return the page of the errata with their numbers, of the right equations, and of the values left open."""
    left_open = "; ".join(f"{name}: {text(value)}" for name, value in engine_speeds().items())
    return "\n".join([
        "# The paper's errata", "", _TEXTS["page"].format(errata=len(ERRATA), open=len(OPEN)),
        *map(erratum_line, ERRATA), "", f"Derived again and found as printed: {escape(_TEXTS['right'])}.", "",
        "## Left open by the paper", "",
        *(f"- {escape(what)}: {escape(here)}" for what, here in OPEN.items()),
        "", f"Figs. 4 to 18: {escape(left_open)}"]) + "\n"


def erratum_line(erratum: Erratum) -> str:
    """Return one erratum as an entry of a list: both forms, the reason, and its numbers."""
    numbers = "; ".join(f"{name}: {text(value)}" for name, value in erratum.numbers().items())
    parts = {"Printed": erratum.printed, "Right": erratum.right, "Why": erratum.why, "Numbers": numbers}
    return " ".join([f"- **{escape(erratum.where)}**", *(f"{name}: {escape(x)}." for name, x in parts.items() if x)])
