"""The claims about Fig. 4: the map over the frequency, constant normal load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from tcc_sim.errors import counted
from tcc_sim.model import pure_stick
from tcc_sim.paper.catalogue import OMEGA_N, SUPER_HARMONICS
from tcc_sim.paper.criteria import Equal, Holds, Measured, Shares, claim
from tcc_sim.paper.evidence import FREQUENCY, JUMP, KINETIC, Evidence, Values, slips_at, steep, with_kinetic
from tcc_sim.paper.stable_motions import Motion, StableMotions
from tcc_sim.trajectory import Floats

FRICTION_RATIOS = (1.0, 0.83, 0.75, 0.667)
FALLING = FRICTION_RATIOS[1:]
NEAR = 0.02
"""How far from a printed frequency ratio or friction ratio something may be and count as there."""
CLOSE = 0.01
"""The same where places lie so dense that NEAR would take in most of them."""
ENDS = 4e-3
"""How far from a step of a sweep a motion's end may be and count as what the step leaves."""
AXIS = np.round(np.arange(0.05, 0.5001, 0.003), 6)
WAYS = ("cold", "up", "down")
"""How a sweep starts every value: from (13), or from the neighbour below or above."""
JUMPING = f"a jump is a change of more than {JUMP:g} of the curve's maximum on a 1e-5 wide interval"


def about(place: float, width: float = NEAR) -> Floats:
    """Frequency ratios about one that the text names, over which branches are followed."""
    return np.round(np.linspace(place - width, place + width, 15), 6)


def around(mark: float) -> Floats:
    """Frequency ratios that begin so far from a super-harmonic that sweeps come to the motions which end there."""
    return np.round(np.linspace(mark - 2.0 * NEAR, mark + 2.0 * NEAR, 21), 6)


def nearest(places: Sequence[float], mark: float) -> float | None:
    """The place nearest to a mark."""
    return min(places, key=lambda x: abs(x - mark), default=None)


def count_near(curves: Sequence[np.ndarray], place: float) -> int:
    """How many curves have one of their places within NEAR of a ratio."""
    return sum(bool((np.abs(row - place) <= NEAR).any()) for row in curves)


def jump_places(evidence: Evidence, ratio: float) -> list[float]:
    """Where the map of one mu_k/mu_s from (13) jumps, omega/omega_n."""
    return [round(x, 4) for x, _ in evidence.jumps(with_kinetic(ratio), AXIS)]


@claim("4", "5, Fig. 4(a)", "the map is a smooth curve for mu_k = mu_s", Holds(f"no jump; {JUMPING}"))
def smooth_when_equal(evidence: Evidence) -> Measured:
    jumps = evidence.jumps(with_kinetic(1.0), AXIS)
    return Measured((not jumps,), {"jumps (omega/omega_n, rad/s)": jumps})


PROMINENT = 0.02
"""How far a maximum of a curve stands above what surrounds it, as a part of the curve's largest value."""
SPREAD = np.round(np.arange(0.14, 0.3601, 1e-3), 6)
"""Ratios about those that the text names, against which it is held how near to them something is."""


@claim("4", "5, Fig. 4(a)", "super-harmonic peaks near 0.167, 0.20, 0.25, 0.33 appear as mu_k falls", Equal(
    "of the nine curves of 0.83, 0.75 and 0.667 mu_s, each from (13), swept up and swept down, more have a peak within "
    f"{NEAR:g} of a named ratio than of the ratios from 0.14 to 0.36 on average (a peak stands {PROMINENT:g} of the "
    "curve's largest value above what surrounds it)"))
def super_harmonic_peaks(evidence: Evidence) -> Measured:
    peaks = {way: _peaks(evidence, way) for way in WAYS}
    curves = [np.array(peaks[way][f"{r:g}"]) for way in WAYS for r in FALLING]
    anywhere = float(np.mean([count_near(curves, x) for x in SPREAD]))
    near = {f"{m:.3f}": count_near(curves, m) for m in SUPER_HARMONICS}
    return Measured([(count > anywhere, True) for count in near.values()],
                    {"curves of nine with a peak near": near, "near any ratio, on average": anywhere,
                     "for mu_k = mu_s, of three": {
                         f"{m:.3f}": count_near([np.array(peaks[way]["1"]) for way in WAYS], m)
                         for m in SUPER_HARMONICS},
                     "peaks from (13), upward, downward, for mu_k/mu_s": list(peaks.values())}, no_more(near, anywhere))


def no_more(near: Mapping[str, int], anywhere: float) -> str:
    """Name the ratios near which there are no more of something than near any ratio."""
    names = ", ".join(name for name, count in near.items() if count <= anywhere)
    return f"near {names} there are no more of them than near any ratio" if names else ""


def _peaks(evidence: Evidence, way: str = "cold") -> dict[str, list[float]]:
    """Prominent maxima for every mu_k/mu_s, omega/omega_n."""
    curves = evidence.curves([with_kinetic(r) for r in FRICTION_RATIOS], AXIS, direction=way)
    return {f"{r:g}": prominent_maxima(AXIS, c.column("max_slip_speed")) for r, c in zip(FRICTION_RATIOS, curves)}


def prominent_maxima(axis: Floats, values: Floats) -> list[float]:
    """Places of the local maxima that stand out by PROMINENT on either side within five values."""
    least, reach = PROMINENT * float(np.nanmax(values)), 5
    return [float(axis[k]) for k in range(1, len(values) - 1)
            if values[k] == np.nanmax(values[max(k - reach, 0):k + reach + 1])
            and values[k] - np.nanmin(values[max(k - reach, 0):k]) > least
            and values[k] - np.nanmin(values[k + 1:k + reach + 1]) > least]


@claim("4", "5, Fig. 4(a)", "these peaks appear along with jumps", Equal(
    f"of the nine curves of 0.83, 0.75 and 0.667 mu_s more have within {NEAR:g} of a named ratio a peak with a jump "
    f"within {CLOSE:g} of it than of the ratios from 0.14 to 0.36 on average; the jump changes the maximum by more "
    f"than {JUMP:g} of the curve's between ratios 0.003 apart, and a stable motion ends in it within {ENDS:g}"),
       fitted=True)
def super_harmonic_jumps(evidence: StableMotions) -> Measured:
    both: list[np.ndarray] = []
    left: list[float] = []
    motions: list[Motion] = []
    for r in FALLING:
        row = with_kinetic(r)
        ends = [end.value for mark in SUPER_HARMONICS for end in evidence.ends(row, around(mark))]
        for way in WAYS:
            values = evidence.curves([row], AXIS, direction=way)[0].column("max_slip_speed")
            steps = [0.5 * (AXIS[k] + AXIS[k + 1]) for k in steep(values)]
            met = [x for x in ends if any(abs(x - step) <= ENDS for step in steps)]
            both.append(np.array([x for x in prominent_maxima(AXIS, values)
                                  if any(abs(x - end) <= CLOSE for end in met)]))
            left += met
        motions += [m for mark in SUPER_HARMONICS for m in evidence.motions(f"mu_k = {r:g} mu_s", row, around(mark))
                    if any(end.jumps and end.value in left for end in (m.stretch.low, m.stretch.high))]

    near = {f"{m:.3f}": count_near(both, m) for m in SUPER_HARMONICS}
    anywhere = float(np.mean([count_near(both, x) for x in SPREAD]))
    return Measured([(count > anywhere, True) for count in near.values()],
                    {"curves of nine with a peak beside a jump near": near, "near any ratio, on average": anywhere,
                     "nearest end in a jump": {f"{m:.3f}": nearest(left, m) for m in SUPER_HARMONICS},
                     "part of the ratios from 0.14 to 0.36 that are within 0.01 of such an end": float(np.mean(
                         [any(abs(x - w) <= CLOSE for x in left) for w in SPREAD])),
                     "jumps from (13)": {f"{r:g}": jump_places(evidence, r) for r in FALLING}},
                    no_more(near, anywhere), tuple(motions))


@claim("4", "5, after Fig. 4", "the super-harmonic peaks shift up as mu_k falls, from mu_k = mu_s on", Holds(
    f"every peak of mu_k = mu_s above 0.15, followed to the nearest one within {NEAR:g} for 0.83, 0.75 and 0.667 mu_s, "
    "never moves down and ends higher (from (13), ratios 0.003 apart)", "some peak does so"))
def peaks_move(evidence: Evidence) -> Measured:
    peaks = _peaks(evidence)
    chains = [[x] for x in peaks["1"] if x > 0.15]
    for r in FALLING:
        for chain in chains:
            x = nearest(peaks[f"{r:g}"], chain[-1])
            chain += [x] if x is not None and abs(x - chain[-1]) <= NEAR else []
    rising = [len(c) > len(FALLING) and all(b >= a for a, b in pairwise(c)) and c[-1] > c[0] for c in chains]
    return Measured((bool(rising) and all(rising), any(rising)),
                    {"peaks followed from mu_k/mu_s = 1 to 0.83, 0.75, 0.667": chains,
                     "all peaks for mu_k/mu_s": peaks},
                    "" if all(rising) else f"{sum(rising)} of {counted(len(chains), 'peak')} so followed do so")


@claim("4", "5, after Fig. 4; 7", "stability is lost around the super-harmonic peaks", Holds(
    f"0.75 or more of the jumps of the maps from (13) for 0.83, 0.75 and 0.667 mu_s lie within {CLOSE:g} of a peak of "
    f"their curve; {JUMPING}, a peak stands {PROMINENT:g} of its curve's largest value above what surrounds it",
    "more of the jumps than of all ratios from 0.12 on, for every mu_k, are so near"))
def lost_at_peaks(evidence: Evidence) -> Measured:
    peaks = _peaks(evidence)
    near, covered = [], []
    for r in FALLING:
        row = np.array(peaks[f"{r:g}"])
        near += [bool((np.abs(row - x) <= CLOSE).any()) for x in jump_places(evidence, r)]
        covered.append(float((np.abs(AXIS[AXIS > 0.12, None] - row) <= CLOSE).any(axis=1).mean()))
    share = float(np.mean(near)) if near else 0.0
    return Measured((share >= 0.75, share > max(covered)), {"jumps": len(near), "part of them at a peak": share,
                    "part of the ratios from 0.12 on that are as near, for mu_k/mu_s = 0.83, 0.75, 0.667": covered},
                    "more of the jumps lie there than chance has, but not most of them"
                    if 0.75 > share > max(covered) else "")


@claim("4", "5, after Fig. 4", "the transition between stick and stick-slip lies near 0.4 and moves with mu_k", Holds(
    f"the highest slipping ratio from (13) lies within {NEAR:g} of 0.4 for mu_k = mu_s, and elsewhere for every mu_k"),
       fitted=True)
def stick_transition(evidence: Evidence) -> Measured:
    found = list(last_slips(evidence, "smoothed").values())
    return Measured((abs(found[0] - 0.4) <= NEAR and len(set(found)) == len(found),),
                    {"last slip from (13) for mu_k/mu_s": last_slips(evidence, "smoothed")})


@claim("4", "4, after (11); 5", "the transition moves with mu_k because the law is smoothed", Holds(
    "from mu_k = mu_s to 0.667 mu_s it moves by less than half as far with the set-valued law"))
def transition_by_smoothing(evidence: Evidence) -> Measured:
    values = {law: last_slips(evidence, law) for law in ("smoothed", "set_valued")}
    smoothed, exact = (list(v.values()) for v in values.values())
    moved = [abs(row[-1] - row[0]) for row in (smoothed, exact)]
    limit = pure_stick.constant_load_limits(evidence.system({}))[-1] / OMEGA_N
    return Measured((moved[1] < 0.5 * moved[0],),
                    {"last slip from (13)": values, "end of pure stick by (10), any mu_k": limit},
                    "" if moved[1] < 0.5 * moved[0] else
                    "the set-valued law moves it as far. Stick ends at one ratio for every mu_k, by (10); above it "
                    "stick and stick-slip coexist, and (13) leads to stick-slip the farther the smaller mu_k")


def last_slips(evidence: Evidence, law: str) -> dict[str, float]:
    """Highest slipping ratio from (13) for every mu_k/mu_s."""
    rows = [{**with_kinetic(r), "friction.law": law} for r in FRICTION_RATIOS]
    upper = np.round(np.concatenate([np.arange(0.38, 0.48, 0.002), np.arange(0.48, 0.7, 0.005)]), 6)
    return {f"{r:g}": float(slips_at(s).max(initial=0.0))
            for r, s in zip(FRICTION_RATIOS, evidence.curves(rows, upper))}


@claim("4", "5, Fig. 4(b)", "a jump in the maximum yields a bifurcation point: a change in the orbit diagram", Shares(
    f"jumps ({JUMPING}) of the maps from (13) for 0.83, 0.75 and 0.667 mu_s within {2.0 * NEAR:g} of the named ratios "
    "with different periods 0.001 below and above"))
def jump_is_bifurcation(evidence: StableMotions) -> Measured:
    """Fig. 4: the periods on both sides of each jump, and the bifurcation that ends a motion there."""
    kinds: dict[str, str] = {}
    changed: list[bool] = []
    for r in FALLING:
        ends = [end for mark in SUPER_HARMONICS for s in evidence.stretches([with_kinetic(r)], around(mark))[0]
                for end in (s.low, s.high) if end.kind]
        for x in jump_places(evidence, r):
            if any(abs(x - mark) <= 2.0 * NEAR for mark in SUPER_HARMONICS):
                below, above = (evidence.motion(with_kinetic(r, {FREQUENCY: (x + d) * OMEGA_N})).period
                                for d in (-1e-3, 1e-3))
                changed.append(below != above)
                end = min(ends, key=lambda e: abs(e.value - x), default=None)
                kinds[f"{r:g} at {x:.4f}: periods {below}, {above}"] = (
                    "none" if end is None or abs(end.value - x) > 1e-3 else end.kind)
    share = float(np.mean(changed)) if changed else 1.0
    return Measured([share], {"part of the jumps": share, "bifurcation of a stable motion within 0.001": kinds},
                    "" if share == 1.0 else "elsewhere the period stays: the basin of (13) ends, and both motions go "
                    "on, or the motion changes its size alone")


@claim("4", "5, after Fig. 4", "a bifurcation in delta_2 shows in delta_1' too", Shares(
    "ratios 0.05 to 0.5 in steps of 0.009, for 0.75 mu_s, at which the section in delta_2 and the maxima of delta_1' "
    "per cycle repeat to 1e-5 after one and the same number of cycles, or neither does after up to 16,"))
def shows_in_both(evidence: Evidence) -> Measured:
    same, apart = [], []
    for x in AXIS[::3]:
        system = evidence.system(with_kinetic(0.75, {FREQUENCY: float(x) * OMEGA_N}))
        cycles = evidence.run(system, 650).solved_cycles
        last = slice(-64, None)
        periods = [repeats(series) for series in (cycles.section[last, 1], cycles.highest[last])]
        same.append(periods[0] == periods[1])
        if not same[-1]:
            apart.append([float(x), *periods])
    return Measured([float(np.mean(same))], {"part": float(np.mean(same)), "not at (ratio, periods)": apart})


def repeats(series: Floats) -> int:
    """After how many of its values a series repeats to 1e-5 of its spread or size; 0 for none up to 16."""
    size = 1e-5 * max(float(np.ptp(series)), 1e-3 * float(np.abs(series).max()))
    return next((p for p in range(1, 17) if float(np.abs(series[p:] - series[:-p]).max()) <= size), 0)


@claim("4", "5, after Fig. 4", "a jump near 0.20 at mu_k = 0.83 mu_s turns period one into two", Holds(
    f"from (13) a jump within {NEAR:g} of 0.20 with period 1 at 0.002 below it and 2 at 0.002 above; {JUMPING}"))
def jump_doubles_period(evidence: Evidence) -> Measured:
    row = with_kinetic(0.83)
    around = {f"{x:.4f}": [evidence.motion({**row, FREQUENCY: (x + d) * OMEGA_N}).period for d in (-2e-3, 2e-3)]
              for x in jump_places(evidence, 0.83) if abs(x - 0.20) <= NEAR}
    return Measured(([1, 2] in around.values(),), {"periods around": around})


LONG = 20000
"""Cycles of an exponent that is too near 0 for fewer."""
FALLS = np.round(np.arange(0.56, 0.8301, 0.01), 6)


@claim("4", "5, after Fig. 4", "near 0.20 period two becomes quasi-periodic or chaotic as mu_k falls further",
       Holds("0.002 above the jump period 2 at 0.83 mu_s, and at a smaller mu_k no period up to 16 and the whole "
             "confidence interval of the largest Lyapunov exponent above 0, or a motion on a torus",
             "at a smaller mu_k there is no period up to 16"))
def doubling_to_chaos(evidence: Evidence) -> Measured:
    places = [x for x in jump_places(evidence, 0.83) if abs(x - 0.20) <= NEAR]
    place = (places[0] if places else 0.20) + 2e-3
    row = {FREQUENCY: place * OMEGA_N}
    found = evidence.periods(evidence.curves([row], FALLS, over=KINETIC)[0])
    none = FALLS[found == 0]
    diagnoses = {f"{r:g}": _diagnosis(evidence, with_kinetic(float(r), row)) for r in none[::-1][:6]}
    wild = any(name in ("chaotic", "quasi-periodic") for name, *_ in diagnoses.values())
    return Measured((int(found[-1]) == 2 and wild, len(none) > 0),
                    {"omega/omega_n": place, "period at 0.83": int(found[-1]),
                     "mu_k/mu_s without a period": none.tolist(),
                     "diagnosis, exponent's interval (1/s)": diagnoses})


def _diagnosis(evidence: Evidence, row: Values) -> list[Any]:
    """The diagnosis of a motion, and the interval of its exponent, 1/s; of LONG cycles where fewer leave it open."""
    found = evidence.motion(row, lyapunov=True).lyapunov
    if found is not None and found.diagnosis == "unresolved":
        found = evidence.exponent(row, 650, LONG)
    return ["not solved"] if found is None else [found.diagnosis, found.low, found.high]
