"""The claims about Figs. 8 to 13, varying load and mu_k = mu_s, that no rule of `claims_families` judges."""

from __future__ import annotations

import numpy as np

from tcc_sim.paper.catalogue import FIGURES, PRESSURE, plain
from tcc_sim.paper.claims_families import (
    AXIS,
    BESIDE,
    HIGH,
    LOW,
    best,
    denominator,
    maxima,
    rows,
    slipping_periods,
)
from tcc_sim.paper.criteria import Equal, Holds, Measured, Shares, claim
from tcc_sim.paper.evidence import FREQUENCY, Evidence, T, first_half, share_where
from tcc_sim.paper.stable_motions import Motion, StableMotions
from tcc_sim.sweeps.sweep import Sweep

MISMATCHED = (0.5, 2.0, 2.0 / 3.0, 4.0 / 3.0)
"""omega_f/omega of Figs. 10 and 11 but 1."""


def actuated(ratio: float) -> dict[str, float]:
    """Tsp/Tsm = 0.25 at omega_f = ratio omega, mu_k = mu_s, 150 rad/s."""
    return {"pressure.amplitude": 0.25 * PRESSURE, "pressure.frequency_ratio": ratio, FREQUENCY: 150.0}


@claim("9", "6.1, Fig. 9", "positive slip falls into the first half cycle at 0.15 and 0.18, into the second at 0.37 "
       "and 0.40", Holds("more than 0.8 of the way slipped in the first half cycle at the first two ratios, less than "
                         "0.2 at the others"), cheap=True, fitted=True)
def delay(evidence: Evidence) -> Measured:
    shares = {plain(s.label): first_half(evidence.last_cycles(s.values, 2, 2000)) for s in FIGURES[9].series}
    parts = list(shares.values())
    return Measured((min(parts[:2]) > 0.8 and max(parts[2:]) < 0.2,), {"part in the first half": shares})


@claim("10, 11, 12", "6.1, after (29)", "omega_f/omega = 1/2, 2, 2/3, 4/3 give period 2, 1, 3, 3", Equal(
    "these periods from (13) at 150 rad/s, and no others at the slipping ratios from 0.05 to 0.5 of Figs. 10 and 11"))
def actuation_periods(evidence: Evidence) -> Measured:
    single = {f"{r:.3f}": evidence.motion(actuated(r)).period for r in MISMATCHED}
    along = slipping_periods(evidence, (10, 11))
    return Measured([*((p, denominator(actuated(r))) for p, r in zip(single.values(), MISMATCHED)),
                     *((found, [n]) for n, found in along.values())],
                    {"at 150 rad/s": single, "at the slipping ratios": {name: found for name, (_, found)
                                                                        in along.items()}})


def _beside_constant(evidence: Evidence, where: np.ndarray, sign: float) -> dict[str, float]:
    """For every omega_f of Figs. 10 and 11 the part of the slipping ratios at which its curve is below that of Tsp = 0
    (sign 1), or above it (-1).
    """
    still = evidence.curves([{}], AXIS)[0].column("max_slip_speed")
    shows, slipping = evidence.limit("shows"), evidence.limit("slipping")
    return {f"{row['pressure.frequency_ratio']:.3f}": share_where(
        sign * (still - found) > shows, where & (np.maximum(found, still) > slipping))
        for n in (10, 11) for row, found in zip(rows(n), maxima(evidence, n))}


@claim("10, 11", "6.1, after (29)", "omega_f = omega attenuates best at low frequency", Shares(
    f"ratios to 0.29 {BESIDE} at which its maximum from (13) is the lowest of its figure (within {T.shows:g} rad/s), "
    f"and more than {T.shows:g} rad/s below that of Tsp = 0"))
def actuation_attenuates(evidence: Evidence) -> Measured:
    shares = {str(n): best(evidence, maxima(evidence, n), 1, LOW) for n in (10, 11)}
    below = _beside_constant(evidence, LOW, 1.0)
    return Measured([*shares.values(), below["1.000"]],
                    {"lowest of its figure": shares, "lower than Tsp = 0, for omega_f/omega": below})


@claim("10, 11", "6.1, after (29)", "at higher frequency this is reversed", Shares(
    f"ratios from 0.31 to 0.45 {BESIDE} at which the maximum of omega_f = omega is more than {T.shows:g} rad/s above "
    f"that of Tsp = 0, and the highest of either figure (within {T.shows:g} rad/s)"))
def actuation_reversed(evidence: StableMotions) -> Measured:
    shares, motions = {}, list[Motion]()
    for n in (10, 11):
        shares[str(n)] = best(evidence, maxima(evidence, n), 1, HIGH, -1.0)
        evidence.stretches(rows(n), AXIS[HIGH])
        for row in [r for r in rows(n) if n == 10 or r["pressure.frequency_ratio"] != 1.0]:
            motions += evidence.motions(f"omega_f = {row['pressure.frequency_ratio']:.3f} omega", row, AXIS[HIGH])
    over = _beside_constant(evidence, HIGH, -1.0)
    alone = any(end.jumps for m in motions for end in (m.stretch.low, m.stretch.high))
    return Measured([over["1.000"], *shares.values()],
                    {"above Tsp = 0, for omega_f/omega": over, "highest of its figure": shares},
                    ("" if alone else "no stable motion ends in a jump, so the start does not matter; ")
                    + "it attenuates no more than constant load, but is not the highest beside the other curves",
                    tuple(motions))


@claim("4 to 18", "3; captions", "fifty dropped cycles suffice: the rest is the steady state", Shares(
    "points of every curve of Figs. 4, 8, 10, 11 and 13 to 18 from (13) whose section has settled after 150 cycles"))
def fifty_suffice(evidence: Evidence) -> Measured:
    found = {str(n): [_settled(s) for s in evidence.curves(rows(n), AXIS)] for n in (4, 8, 10, 11, *range(13, 19))}
    parts = [x for row in found.values() for x in row]
    return Measured(parts, {"settled part, by figure and curve": found}, f"{100.0 * (1.0 - max(parts)):.0f} to "
                    f"{100.0 * (1.0 - min(parts)):.0f} % of the points of a curve have not settled by then")


def _settled(sweep: Sweep) -> float:
    """The part of the points of a sweep whose section has settled by the paper's rule."""
    return float(np.mean([p is not None and p.summary is not None and p.summary.settled for p in sweep.points]))
