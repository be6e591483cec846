"""Errata of the paper: printed form, right form, reason, and the module with the right form; and their page.

A function computes the numbers that show an erratum, by name and value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tcc_sim.analysis.damping import damping_of_cycles
from tcc_sim.continuation.bracket import chandrupatla
from tcc_sim.model import pure_slip, pure_stick
from tcc_sim.model.harmonic_balance import harmonic_balance, mean_friction_torque
from tcc_sim.output.tables import escape, markdown_table
from tcc_sim.paper.catalogue import FIGURES, OMEGA_N, PRESSURE, paper_system
from tcc_sim.paper.claims import listed_numbers
from tcc_sim.paper.claims_stick import PURE_SLIP
from tcc_sim.paper.evidence import KINETIC, Evidence, Values, two_digits, with_kinetic
from tcc_sim.solvers import solve
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
        out[f"phi at {ratio:g}, printed and right (rad)"] = [printed, pure_stick.stick_phase(system, omega)]
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
        found = pure_slip.pure_slip(paper_system({**PURE_SLIP, "initial.slip_speed": speed}))
        out[f"Omega_e = {speed:g}: (16) as printed, with its sign, least slip with the transient (rad/s)"] = [
            abs(found.a0) - found.slip.swing(), found.margin, found.least_slip_speed]
    return out


def held_in_stick() -> Numbers:
    """Return the mean friction torque of a motion that sticks although Tm > Tsm, mu_k/mu_s = 0.55."""
    row = with_kinetic(0.55, {"engine.frequency": 0.36 * OMEGA_N})
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
    angle = pure_slip.pure_slip(system).plate_angle(t)
    rest = integral(angle, t) - size * (t - 2.0 * zeta / omega_n)
    return {"amplitude of the sine, printed and right (rad/s)": [size * (1.0 - 2.0 * zeta**2) / damped,
                                                                 system.saturation_mean / (d.plate_inertia * damped)],
            "printed terms less those of the integral of theta2, largest, relative":
            float(np.abs(printed - rest).max() / np.abs(printed).max())}


def dissipation() -> Numbers:
    """Compare (21) with the damping that dissipates the friction energy of a cycle, mu_k = 0.667 mu_s."""
    out = {}
    for ratio in (0.12, 0.20, 0.25):
        system = paper_system(with_kinetic(0.667, {"engine.frequency": ratio * OMEGA_N}))
        before = solve(system, cycles=150)
        run = solve(system, cycles=16, samples_per_cycle=4096, start_cycle=150, state=before.final).raise_for_status()
        power, square = run.friction_torque * run.slip_speed, run.slip_speed**2
        found = damping_of_cycles(system, before.solved_cycles[134:], 134, 0)
        out[f"at {ratio:g}, by energy and by (21) (N m s/rad)"] = [
            two_digits(power.sum() / square.sum()), two_digits(found.weighted)]
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
    still = [paper_system({**s.values, "engine.frequency": 1e-3 * OMEGA_N}) for s in FIGURES[13].series]
    out["|Tp - (1 + I1/I2) Tsp| for Tsp/Tsm = 0, 0.125, 0.25, 0.5 (N m)"] = [
        pure_slip.equivalent_torque(s).swing() for s in still]
    out["|Tp - Tsp| (N m)"] = [abs(s.engine.torque_amplitude - s.saturation_amplitude) for s in still]
    for ratio in (0.20, 0.40):
        rows = [paper_system({**s.values, "engine.frequency": ratio * OMEGA_N}) for s in FIGURES[13].series]
        out[f"torque that drives the slip at {ratio:.2f}, plate motion eliminated (N m)"] = [
            pure_slip.slip_torque(s).swing() for s in rows]
        out[f"largest slip speed at {ratio:.2f} (rad/s)"] = [
            float(np.abs(solve(system, cycles=150).solved_cycles.highest[50:]).max()) for system in rows]
    return out


def series_means() -> Numbers:
    """Return the mean of (31) with and without c0, for omega_f = omega/2 at 150 rad/s."""
    row: Values = {"pressure.amplitude": 0.25 * PRESSURE, "pressure.frequency_ratio": 0.5, "engine.frequency": 150.0}
    system = paper_system(row)
    before = solve(system, cycles=600).raise_for_status()
    run = solve(system, cycles=2, samples_per_cycle=400, start_cycle=600, state=before.final).raise_for_status()
    size = float(np.abs(run.slip_speed).max())
    off = []
    for count in (10, 20, 40):
        found = harmonic_balance(system, 2, 2 * count)
        off.append(float(np.sqrt(np.mean((found.slip_speed(run.t) - run.slip_speed) ** 2))) / size)
    return {"mean friction torque, printed and with c0 (N m); Tm = 300": [
        mean_friction_torque(system, found.coefficient, 2, printed=True),
        mean_friction_torque(system, found.coefficient, 2)],
        "most that the printed form allows, (2/pi) Tp (N m)": 2.0 / math.pi * system.engine.torque_amplitude,
        "a0, c0": [float(found.slip[0]), float(found.coefficient[0])],
        "corrected series against the simulation, rms, 10, 20, 40 harmonics of omega": off}


def phase_order() -> Numbers:
    """Return the torque that drives the slip for psi = 0, pi/2, pi."""
    return {f"at {ratio:.2f} for psi = 0, pi/2, pi (N m)": [
        pure_slip.slip_torque(paper_system({**s.values, "engine.frequency": ratio * OMEGA_N})).swing()
        for s in FIGURES[8].series] for ratio in (0.15, 0.40)}


def engine_speeds() -> Mapping[str, Mapping[str, float | None]]:
    """Return the highest mu_k/mu_s with period two in Fig. 6 from (13), for engine speeds that the paper may mean."""
    ratios, evidence = np.round(np.arange(0.76, 0.9401, 0.005), 6), Evidence(1e-9)
    found = {}
    for speed in (0.0, 50.0, 100.0, 150.0, 200.0):
        row = {"engine.frequency": 0.36 * OMEGA_N, "initial.slip_speed": speed}
        two = ratios[evidence.periods(evidence.curves([row], ratios, over=KINETIC)[0]) == 2]
        found[f"{speed:g}"] = float(two.max()) if len(two) else None
    return {"highest mu_k/mu_s with period 2 in Fig. 6, for an engine speed of (rad/s)": found}


@dataclass(frozen=True)
class Erratum:
    """Erratum of the paper.

    where : equation, figure or section
    printed, right : printed and right form, in words and formulas of plain text
    why : short derivation
    code : module of this package with the right form; empty if none has it
    numbers : function that computes values that show the difference
    """

    where: str
    printed: str
    right: str
    why: str
    code: str = ""
    numbers: Callable[[], Numbers] = dict


ERRATA: tuple[Erratum, ...] = (
    Erratum("(3)", "psi is the phase lag between load and engine torque; Nm is the mean pressure",
            "+psi in sin(omega_f t + psi) leads; Nm = Pm A is the mean normal force",
            "the load's maximum comes psi/omega_f before that of sin(omega_f t); by N(t) = P(t) A of Section 2.1 a "
            "pressure has another unit than N", "model.parameters"),
    Erratum("Section 2.3, Table 1", "Np/Nm in [0, 1), and Pp = 0 to Pm", "Pp below Pm, or P clamped at 0",
            "at Pp = Pm the load falls to 0 and the surfaces part; Np/Nm = Pp/Pm", "model.parameters"),
    Erratum("Table 1", "C23 = 0.6 in Nm rad/s", "C23 = 0.6 N m s/rad", "C23 theta2' is a torque in (1b)",
            "model.parameters"),
    Erratum("(4), (6)", "mubar in [0, mu_s/mu_k] at v = 0", "mubar in [-mu_s/mu_k, mu_s/mu_k]",
            "in stick friction holds in both directions", "solvers.event_driven"),
    Erratum("(8b), (25b)", "the arctangent of the quotient", "the four-quadrant arctangent",
            "above omega_sn the denominator of (8b) is negative and the printed phase is off by pi", "model.pure_stick",
            phases),
    Erratum("(9)", "omega^2 Tp/sqrt((K23 - (I1 + I2) omega^2)^2)",
            "I1 omega^2 Tp/sqrt((K23 - (I1 + I2) omega^2)^2 + (C23 omega)^2)",
            "Tfi = Te - I1 theta1'', and theta1'' = theta2'' of (8a); (25a) is the same, and right", "model.pure_stick",
            amplitude),
    Erratum("(10)", "Tfi(t) <= mu_s N(t) R", "|Tfi(t)| <= mu_s N(t) R", "slip begins in either direction",
            "model.pure_stick"),
    Erratum("(11b)", "a period of 2 pi/omega", "N periods of excitation for omega_f = (M/N) omega in lowest terms",
            "mu_s N(t) R repeats with omega_f, so one period of excitation does not show its least "
            "margin", "model.pure_stick"),
    Erratum("After (14)", "a1 > 0: the motion will be of pure slip",
            "so for mu_k = mu_s; for mu_k < mu_s a motion may stick for a part of every cycle beside it",
            "a1 is the trend of a motion that never sticks. In stick friction carries up to mu_s N R, more than Tsm "
            "where mu_k < mu_s, so that its mean may be Tm although Tsm is less", "paper.claims_stick", held_in_stick),
    Erratum("(16)", "|a0| > |a21| + |a22|", "a0 > |a21| + |a22|, and v > 0 through the transient of (14)",
            "an a0 below 0 satisfies the print, but friction was taken for v > 0; and the transient can bring v to 0 "
            "before there is a steady state", "model.pure_slip", slip_condition),
    Erratum("(17a), (18)", "terms Tsm 2 zeta/(K23 omega_n), Tsm (2 zeta^2 - 1)/(K23 omega_d)",
            "v = Omega_e + Tp/(I1 omega) (1 - cos(omega t)) - Tsm/(I2 omega_d) exp(-zeta omega_n t) sin(omega_d t)",
            "the printed terms are an angle times a time: those of the integral of theta2, where its derivative "
            "belongs. "
            "(18) has no such term at all", "model.pure_slip", transient),
    Erratum("(21)", "Cf equates the cyclic energy dissipation", "that is Cf = int T v dt/int v^2 dt, above 0 always",
            "(21) weights the slope dT/dv with v^2; T is not (dT/dv) v, so it is another quantity, not an energy",
            "analysis.damping", dissipation),
    Erratum("(22b)", "-Cf theta1' and no mean", "-Cf (theta1' - delta1c') as in (22a)",
            "the friction torque Cf (delta1' - delta1c') acts on both inertias; otherwise (22a) and (22b) do not add "
            "up to (1a), (1b)", "analysis.damping"),
    Erratum("(23)", "unstable where Cf < -C23", "unstable where Cf < 0; the oscillation grows from Cf near -C23 on",
            "the characteristic polynomial of (22) is I1 I2 s^3 + [I1 (C23 + Cf) + I2 Cf] s^2 + (I1 K23 + Cf C23) s "
            "+ Cf K23: its constant term makes a positive real root for any Cf < 0", "analysis.damping", roots),
    Erratum("(27)", "omega_sn = K23/sqrt(I1 + I2)", "omega_sn = sqrt(K23/(I1 + I2))", "as (28) then uses it",
            "model.parameters", stuck_frequency),
    Erratum("(29b)", "[1 + I1/I2] with a lost symbol, sin(omega t + psi)",
            "[1 + I1/I2] Tsm, and sin(omega_f t + psi)", "(2a) with Tf = Ts", "model.pure_slip"),
    Erratum("(29b), Fig. 13", "a larger Tsp lowers Teq, which lowers slip",
            "I1 v' = Te - Ts [K23 - (I1 + I2) w^2 + i C23 w]/[K23 - I2 w^2 + i C23 w] at each frequency w",
            "|Tp - (1 + I1/I2) Tsp| rises with Tsp while slip falls. The left side of (29a) holds Ts too, by (12b): "
            "I1 (v' + "
            "theta2'') = Te - Ts. With the plate's motion eliminated the amplitude at low frequency is |Tp - Tsp "
            "exp(i psi)|", "model.pure_slip", driving_torques),
    Erratum("(29b), Fig. 8", "psi changes the reduction of Teq; the time delay reverses it at high frequency",
            "the factor of Ts above turns its sign at omega_sn", "Teq of (29b) orders psi = 0, pi/2, pi alike at every "
            "frequency, so it cannot show the reversal; the torque with the plate's motion eliminated does",
            "model.pure_slip", phase_order),
    Erratum("(30), (31), (32), (34)", "series from n = 1 on", "a0 in (30), c0 in (31), and the mean in (32), (34)",
            "the mean of Tf is Tm. Without c0 only the product with the sine of the first factor has a mean, of at "
            "most (2/pi) Tp for mu_k = mu_s as printed; and slip in one direction has a mean",
            "model.harmonic_balance", series_means),
    Erratum("(31)", "[Tm + Tp sin(omega t/N)]", "[Tsm + Tsp sin(M omega t/N + psi)]", "the first factor is Ts of (5b)",
            "model.harmonic_balance"),
    Erratum("Section 6.1, before (30)", "a period identical to omega/N", "a period of N 2 pi/omega",
            "omega/N is an angular frequency", "paper.claims_periods"),
    Erratum("(35)", "v = N for any M and N", "v = N for M/N in lowest terms and mu_k = mu_s",
            "commensurable means to the authors that one is a multiple of the other: 1/2, 2/1 and 2/3, 4/3 are as they "
            "say. But there is no condition on mu_k: for mu_k < mu_s the motion doubles or loses its period by itself",
            "paper.claims_periods"),
    Erratum("Proof of (35)", "v = KN is disregarded, since the least period defines the periodicity",
            "v = KN, K > 1, is a motion of its own", "a least period may be KN: that is what a doubling makes. The "
            "first two cases show that v is a multiple of N, no more; the claim on the proof has the periods met",
            "paper.claims_periods"),
    Erratum("Section 5, Fig. 4", "the transition moves with mu_k because the law is smoothed",
            "stick and stick-slip coexist, and (13) leads to the latter",
            "the set-valued law moves the last slip as far: see the claim", "paper.claims_stick"),
    Erratum("Captions of Figs. 3 and 13", "mu_k = 0.677 mu_s; effect of omega_f",
            "0.667 is meant, if Fig. 5's is; effect of Tsp",
            "Fig. 3 and the claims on it use 0.677 as printed", "paper.catalogue"),
)
"""Errata in the order of the paper."""

RIGHT = ("(1), (2), (3), (5), (7), (8a), (12) to (15), (19), (20), (22a), (24), (25a), (26) within 0.06 rad for "
         "omega/omega_n up to 0.5, (28), (29a), (33)")
"""Equations that are right as printed, by a new derivation."""

OPEN = (
    ("the mean pressure of Figs. 4 to 18", "225 kPa; claims are judged at 225, 230 and 240 kPa, which fit alike"),
    ("the engine speed of Figs. 4 to 18", "150 rad/s, which Fig. 2 has; numbers below"),
    ("the mu_k of the curves of Fig. 4", "1, 0.83, 0.75 and 0.667 mu_s: 0.83 and 0.75 are those of the text and Figs. "
     "14 to 18, 0.667 that of Fig. 5"),
    ("what stays as mu_k changes", "N(t), so Tsm falls with mu_k and mu_s N R = 540 N m stays"),
    ("the step of RK4 in Fig. 2", "several are shown"),
    ("what (21) is in Fig. 5", "as printed, and the time mean of the negative slope, which has the printed order"),
    ("how each value of a map starts", "from (13), the cold start; other directions are an option"),
    ("how many cycles are kept", "100 after the 50 that the paper drops"),
    ("omega_f, omega and Omega_e", "Section 2 has omega = (Ne/2) Omega_e, Fig. 2 has omega = Omega_e = 150 rad/s"),
)
"""Values that the paper leaves open, and those taken here."""


def errata_page() -> str:
    """Return the page of the errata with their numbers, of the right equations, and of the values left open."""
    lines = ["# The paper's errata", "",
             f"{len(ERRATA)} places of the paper where another form is right, and {len(OPEN)} that it leaves open. "
             "This page is generated:",
             "`tcc-sim claims --errata FILE` writes it. Each place was derived again; the numbers are computed for "
             "Table 1 with",
             "mu_s N R = 540 N m unless stated. Ratios are omega/omega_n.", "",
             *markdown_table(["where", "printed", "right", "in the code"], [
                 [escape(e.where), escape(e.printed), escape(e.right), f"`{e.code}`" if e.code else ""]
                 for e in ERRATA])]
    for e in ERRATA:
        lines += ["", f"## {escape(e.where)}: {escape(e.printed)}", "", f"{escape(e.why[0].upper() + e.why[1:])}."]
        lines += listed_numbers(e.numbers())
    return "\n".join([*lines, "", "## Derived again and found as printed", "", f"{escape(RIGHT)}.", "",
                      "## Left open by the paper", "",
                      *markdown_table(["what", "here"], [[escape(what), escape(taken)] for what, taken in OPEN]),
                      *listed_numbers(engine_speeds())]) + "\n"
