"""The claims about (30) to (35): the period of the response under a load of the frequency (M/N) omega."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from tcc_sim.errors import NumericalFailure
from tcc_sim.model.harmonic_balance import harmonic_balance, mean_friction_torque
from tcc_sim.paper.claims_families import denominator, slipping_periods
from tcc_sim.paper.claims_varying_load import MISMATCHED, actuated
from tcc_sim.paper.criteria import Equal, Holds, Measured, claim
from tcc_sim.paper.evidence import FREQUENCY, Evidence, T

SERIES = dict(zip(("1/2", "2/1", "2/3", "4/3"), MISMATCHED))
"""M/N of Figs. 10 to 12: omega_f/omega."""
HARMONICS = 40
"""Harmonics of omega in the series."""


@claim("(30) to (34)", "3", "multi-term harmonic balance is not suitable for parameters that vary in time", Holds(
    f"for some omega_f of Figs. 10 to 12 Newton's method fails, or the series of {HARMONICS} harmonics of omega, mean "
    f"terms included, is more than {T.alike:g} off the simulation (rms)"))
def balance_unsuitable(evidence: Evidence, balance: Callable[..., Any] = harmonic_balance) -> Measured:
    found = series_balance.measure(evidence, balance=balance).values
    off = {name: x if isinstance(x, str) else x["rms difference of the corrected series"] for name, x in found.items()}
    failed = any(isinstance(x, str) or x > evidence.limit("alike") for x in off.values())
    return Measured((failed,), {"rms difference": off}, "" if failed else
                    "the Fourier coefficients of the friction torque follow from its samples in time, whatever varies")


@claim("(30) to (34)", "6.1", "the series of harmonic balance satisfy (1) for omega_f = (M/N) omega", Holds(
    f"the mean of (31) as printed is Tm = 300 N m within 1 N m; and with c0 and a0 added the series of {HARMONICS} "
    f"harmonics of omega within {T.alike:g} of the simulation (rms)"))
def series_balance(evidence: Evidence, balance: Callable[..., Any] = harmonic_balance,
                   mean: Callable[..., float] = mean_friction_torque) -> Measured:
    """(30) to (34): with their mean terms the series are the motion; as printed they cannot carry Tm."""
    values: dict[str, Any] = {}
    close, short = [], []
    for name, ratio in SERIES.items():
        row = actuated(ratio)
        period = denominator(row)
        try:
            found = balance(evidence.system(row), period, HARMONICS * period)
        except NumericalFailure as failure:
            values[name] = str(failure)
            close.append(False)
            continue
        run = evidence.last_cycles(row, period, 400)
        size = float(np.abs(run.slip_speed).max())
        off = float(np.sqrt(np.mean((found.slip_speed(run.t) - run.slip_speed) ** 2))) / size
        printed, corrected = (mean(evidence.system(row), found.coefficient, period, printed=p)
                              for p in (True, False))
        values[name] = {"rms difference of the corrected series": off, "a0 (rad/s)": float(found.slip[0]),
                        "mean friction torque, corrected": corrected, "as printed (N m)": printed}
        close.append(off < evidence.limit("alike"))
        short.append(abs(printed - 300.0) > 1.0)
    return Measured((all(close) and not any(short),), values,
                    "as printed the friction torque's mean is at most (2/pi) Tp = 159 N m; with mean terms the "
                    "series agrees" if all(close) else "Newton's method did not end, or the series is another motion")


COPRIME = [(m, n) for n in range(1, 6) for m in range(1, 6) if math.gcd(m, n) == 1]
"""Pairs M, N in lowest terms."""


@claim("(35)", "6.1", "omega_f = (M/N) omega, mu_k = mu_s: the response has period N, whether M and N are "
       "commensurable (1/2, 2/1: one a multiple of the other) or not (2/3, 4/3)",
       Equal("period N from (13) for every M/N in lowest terms up to 5/5, at 150 rad/s and Tsp/Tsm = 0.25"), cheap=True)
def period_is_denominator(evidence: Evidence) -> Measured:
    found = {f"{m}/{n}": evidence.motion(actuated(m / n)).period for m, n in COPRIME}
    return Measured([(found[f"{m}/{n}"], n) for m, n in COPRIME], {"periods": found})


@claim("(35)", "6.1, after (35)", "the response has the frequency that it would have under an excitation by 1 and M/N",
       Equal("for every M/N of Figs. 10 to 12 constant load and a second engine torque of frequency M/N omega and "
             "amplitude Tsp give the period of the varying load"), cheap=True)
def as_dual_excitation(evidence: Evidence) -> Measured:
    pairs, values = [], {}
    for name, ratio in SERIES.items():
        varying, n = evidence.motion(actuated(ratio)).period, denominator(actuated(ratio))
        # omega is the N-th harmonic of omega/N, and omega_f the M-th.
        amplitudes = np.zeros(max(round(ratio * n), n))
        amplitudes[n - 1] += 250.0
        amplitudes[round(ratio * n) - 1] += 0.25 * evidence.system({}).saturation_mean
        dual = evidence.motion({FREQUENCY: 150.0 / n, "engine.torque_amplitude": float(amplitudes[0]),
                                "engine.harmonic_amplitudes": tuple(amplitudes[1:].tolist()),
                                "engine.harmonic_phases": (0.0,) * (len(amplitudes) - 1)}).period
        # Whatever the response repeats after, the torque repeats after too: at least N cycles of omega.
        values[f"{name}: varying load, two torques"] = [varying, dual * n]
        pairs.append((dual * n, varying))
    return Measured(pairs, values)


@claim("(35)", "6.1, after (35)", "the cases of the proof of (35), v = N/K and v not commensurable with N, leave only "
       "v = N; v = KN may be disregarded",
       Holds("no period that is a multiple KN, K > 1, of N in Figs. 16 and 17 (0.05 to 0.5, 0.75 mu_s)",
             "none in Figs. 10 and 11 (mu_k = mu_s)"))
def proof_is_whole(evidence: Evidence) -> Measured:
    """The proof's case v = KN: met where the friction law falls."""
    falling, equal = ({name: [p for p in periods if p > n and p % n == 0]
                       for name, (n, periods) in slipping_periods(evidence, numbers).items()}
                      for numbers in ((16, 17), (10, 11)))
    return Measured((not any(falling.values()), not any(equal.values())),
                    {"multiples of N met at 0.75 mu_s": falling, "at mu_k = mu_s": equal},
                    "a minimal period is a multiple of N where the motion doubles; (34) then has its harmonics, and "
                    "the first two cases do not show v = N for it")
