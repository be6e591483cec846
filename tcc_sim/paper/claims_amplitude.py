"""The claims about Fig. 18: a larger amplitude of the normal load and a falling friction law."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tcc_sim.paper.claims_figure4 import JUMPING, NEAR, SPREAD, about
from tcc_sim.paper.claims_varying_load import AXIS, HIGH, maxima, rows
from tcc_sim.paper.criteria import Equal, Holds, Measured, claim
from tcc_sim.paper.evidence import Evidence, share_where, sticks
from tcc_sim.paper.stable_motions import Motion, StableMotions


@claim("18", "6.2, Fig. 18", "larger Tsp: quasi-periodic or chaotic motions at low frequency become pure stick", Holds(
    "to 0.12 the part in pure stick never falls with Tsp and ends at 1, and at Tsp = 0 or 0.125 Tsm some ratio there "
    "has no period up to 16", "the part in pure stick grows from Tsp = 0 to 0.5 Tsm"))
def amplitude_makes_stick(evidence: Evidence) -> Measured:
    sweeps = evidence.curves(rows(18), AXIS)
    low = AXIS <= 0.12
    stuck = [share_where(sticks(s), low) for s in sweeps]
    wild = [share_where(evidence.periods(s) == 0, low) for s in sweeps]
    grows = stuck == sorted(stuck) and stuck[-1] == 1.0
    return Measured((grows and max(wild[:2]) > 0.0, stuck[-1] > stuck[0]),
                    {"pure stick for Tsp/Tsm = 0, 0.125, 0.25, 0.5": stuck, "no period up to 16": wild,
                     "another period than 1": [share_where(evidence.periods(s) != 1, low) for s in sweeps]})


NAMED = (0.25, 0.35)
"""Ratios about which the text of Fig. 18 has jumps and aperiodic motions."""


@claim("18", "6.2, Fig. 18", "a larger Tsp enlarges slip and jumps at higher frequency, around 0.25 and 0.35", Holds(
    f"from Tsp = 0 to 0.5 Tsm the largest jump within {2.0 * NEAR:g} of the two ratios grows with every Tsp "
    f"({JUMPING}), and so does the largest maximum from 0.31 to 0.45", "one of the two does"))
def amplitude_enlarges(evidence: Evidence) -> Measured:
    jumps = [max((abs(size) for x, size in evidence.jumps(row, AXIS)
                  if any(abs(x - mark) <= 2.0 * NEAR for mark in NAMED)), default=0.0) for row in rows(18)]
    slips = [float(x) for x in maxima(evidence, 18)[:, HIGH].max(axis=1)]
    grow = [all(b > a for a, b in pairwise(series)) for series in (jumps, slips)]
    return Measured((all(grow), any(grow)), {
        "largest jump there for Tsp/Tsm = 0, 0.125, 0.25, 0.5 (rad/s)": jumps,
        "largest slip speed from 0.31 to 0.45 (rad/s)": slips},
        "the jumps shrink as Tsp grows" if jumps[-1] < jumps[0] else "")


@claim("18", "6.2, Fig. 18(b)", "larger Tsp: periodic motions turn quasi-periodic or chaotic around 0.25 and 0.35",
       Equal(
    f"at Tsp/Tsm = 0.25 or 0.5 the part of the ratios within {NEAR:g} of each without a period up to 16, from (13), is "
    "larger than that within as far of the ratios from 0.14 to 0.36 on average"))
def amplitude_aperiodic(evidence: Evidence) -> Measured:
    sweeps = evidence.curves(rows(18)[2:], AXIS)
    none = np.asarray(np.any([evidence.periods(sweep) == 0 for sweep in sweeps], axis=0))
    def share(place: float) -> float:
        return float(none[np.abs(AXIS - place) <= NEAR + 1e-9].mean())

    anywhere = float(np.mean([share(x) for x in SPREAD]))
    near = {f"{m:g}": share(m) for m in NAMED}
    return Measured([(part > anywhere, True) for part in near.values()],
                    {"part without a period near": near, "near any ratio, on average": anywhere},
                    "" if min(near.values()) > anywhere else "elsewhere such motions are as frequent")


@claim("18", "6.2, Fig. 18(a)", "larger Tsp: jumps near 0.25 and 0.35", Equal(
    f"a stable motion ends in a jump within {NEAR:g} of each at Tsp/Tsm = 0.25 or 0.5, found from (13) or in a sweep "
    "either way"))
def amplitude_jumps(evidence: StableMotions) -> Measured:
    curves = {f"Tsp/Tsm = {x:g}": row for x, row in zip((0.25, 0.5), rows(18)[2:])}
    found: dict[str, list[float]] = {}
    motions = list[Motion]()
    for mark in NAMED:
        axis = about(mark)
        evidence.stretches(list(curves.values()), axis)
        found[f"{mark:g}"] = [end.value for row in curves.values() for end in evidence.ends(row, axis)
                              if abs(end.value - mark) <= NEAR]
        for name, row in curves.items():
            motions += evidence.motions(name, row, axis)
    return Measured([(bool(places), True) for places in found.values()],
                    {"stable motions end in a jump near": found}, "", tuple(motions))
