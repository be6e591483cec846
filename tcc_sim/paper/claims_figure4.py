"""The claims about Fig. 4: the map over the frequency, constant normal load."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from tcc_sim.errors import counted
from tcc_sim.model import pure_stick
from tcc_sim.paper.catalogue import OMEGA_N, SUPER_HARMONICS
from tcc_sim.paper.claims_families import FINER, JUMPING
from tcc_sim.paper.criteria import Equal, Holds, Measured, Shares, claim
from tcc_sim.paper.evidence import FREQUENCY, KINETIC, Evidence, T, Values, slips_at, with_kinetic
from tcc_sim.paper.stable_motions import Motion, StableMotions
from tcc_sim.trajectory import Floats

FRICTION_RATIOS = (1.0, 0.83, 0.75, 0.667)
FALLING = FRICTION_RATIOS[1:]
WAYS = ("cold", "up", "down")
"""How a sweep starts every value: from (13), or from the neighbour below or above."""
SPREAD = np.round(np.arange(0.14, 0.3601, 1e-3), 6)
"""Ratios about those that the text names; the average over them is the base rate of being near a named one."""
NINE = "of the nine curves of 0.83, 0.75 and 0.667 mu_s, each from (13), swept up and swept down, more have "
ANYWHERE = " than of the ratios from 0.14 to 0.36 on average"


def about(place: float, width: float = T.near) -> Floats:
    """Frequency ratios about one that the text names, over which branches are followed."""
    return np.round(np.linspace(place - width, place + width, 15), 6)


def around(mark: float) -> Floats:
    """Frequency ratios that begin so far from a super-harmonic that sweeps reach the motions which end there."""
    return np.round(np.linspace(mark - 2.0 * T.near, mark + 2.0 * T.near, 21), 6)


def nearest(places: Sequence[float], mark: float) -> float | None:
    """The place nearest to a mark."""
    return min(places, key=lambda x: abs(x - mark), default=None)


def rate_anywhere(share: Callable[[float], float]) -> float:
    """The base rate: the mean of a share over SPREAD."""
    return float(np.mean([share(float(x)) for x in SPREAD]))


def beside_named(evidence: Evidence, places: Sequence[np.ndarray], values: Mapping[str, Any],
                 motions: tuple[Motion, ...] = ()) -> Measured:
    """Judge whether more curves have one of their places near each named ratio than near any ratio."""
    def count(x: float) -> int:
        return sum(bool((np.abs(row - x) <= evidence.limit("near")).any()) for row in places)

    near, anywhere = {f"{m:.3f}": count(m) for m in SUPER_HARMONICS}, rate_anywhere(count)
    names = ", ".join(name for name, found in near.items() if found <= anywhere)
    return Measured([(found > anywhere, True) for found in near.values()],
                    {"curves of nine near": near, "near any ratio, on average": anywhere, **values},
                    f"near {names} there are no more of them than near any ratio" if names else "", motions)


def jump_places(evidence: Evidence, ratio: float) -> list[float]:
    """Where the map of one mu_k/mu_s from (13) jumps, omega/omega_n."""
    return [round(x, 4) for x, _ in evidence.jumps(with_kinetic(ratio), FINER)]


def peaks_of(evidence: Evidence, way: str = "cold") -> dict[str, list[float]]:
    """Prominent maxima for every mu_k/mu_s, omega/omega_n."""
    curves = evidence.curves([with_kinetic(r) for r in FRICTION_RATIOS], FINER, direction=way)
    return {f"{r:g}": prominent_maxima(evidence, FINER, c.column("max_slip_speed"))
            for r, c in zip(FRICTION_RATIOS, curves)}


def prominent_maxima(evidence: Evidence, axis: Floats, values: Floats) -> list[float]:
    """Places of the local maxima that stand out on either side within five values."""
    least, reach = evidence.limit("prominent") * float(np.nanmax(values)), 5
    return [float(axis[k]) for k in range(1, len(values) - 1)
            if values[k] == np.nanmax(values[max(k - reach, 0):k + reach + 1])
            and values[k] - np.nanmin(values[max(k - reach, 0):k]) > least
            and values[k] - np.nanmin(values[k + 1:k + reach + 1]) > least]


@claim("4", "Abstract; 5; 7", "the negative slope exaggerates stick-slip", Holds(
    "the mean of the maxima from (13) over the ratios to 0.5 at which mu_k = mu_s slips grows with every fall of mu_k"))
def slope_exaggerates(evidence: Evidence) -> Measured:
    found = np.array([s.column("max_slip_speed") for s in evidence.curves([with_kinetic(r) for r in FRICTION_RATIOS],
                                                                          FINER)])
    moving = found[0] > evidence.limit("slipping")
    means = [float(x) for x in found[:, moving].mean(axis=1)]
    return Measured((all(b > a for a, b in pairwise(means)),), {
        "mean maxima for mu_k/mu_s = 1, 0.83, 0.75, 0.667 (rad/s)": means,
        "largest of all (rad/s)": [float(x) for x in found.max(axis=1)]})


@claim("4", "5, Fig. 4(a)", "super-harmonic peaks near 0.167, 0.20, 0.25, 0.33 appear as mu_k falls", Equal(
    f"{NINE}a peak within {T.near:g} of a named ratio{ANYWHERE} (a peak stands {T.prominent:g} of the curve's "
    "largest value above its surroundings)"))
def super_harmonic_peaks(evidence: Evidence) -> Measured:
    peaks = {way: peaks_of(evidence, way) for way in WAYS}
    return beside_named(evidence, [np.array(peaks[way][f"{r:g}"]) for way in WAYS for r in FALLING],
                        {"peaks from (13), upward, downward, for mu_k/mu_s": list(peaks.values())})


@claim("4", "5, Fig. 4(a)", "these peaks appear along with jumps", Equal(
    f"{NINE}within {T.near:g} of a named ratio a peak with a jump within {T.close:g} of it{ANYWHERE}; the jump changes "
    f"the maximum by more than {T.jump:g} of the curve's between ratios 0.003 apart, and a stable motion ends in it "
    f"within {T.ends:g}"), fitted=True)
def super_harmonic_jumps(evidence: StableMotions) -> Measured:
    both, left, motions = list[np.ndarray](), list[float](), list[Motion]()
    for r in FALLING:
        row = with_kinetic(r)
        ends = [end.value for mark in SUPER_HARMONICS for end in evidence.ends(row, around(mark))]
        for way in WAYS:
            values = evidence.curves([row], FINER, direction=way)[0].column("max_slip_speed")
            steps = [0.5 * (FINER[k] + FINER[k + 1]) for k in evidence.steep(values)]
            met = [x for x in ends if any(abs(x - step) <= evidence.limit("ends") for step in steps)]
            both.append(np.array([x for x in prominent_maxima(evidence, FINER, values)
                                  if any(abs(x - end) <= evidence.limit("close") for end in met)]))
            left += met
        motions += [m for mark in SUPER_HARMONICS for m in evidence.motions(f"mu_k = {r:g} mu_s", row, around(mark))
                    if any(end.jumps and end.value in left for end in (m.stretch.low, m.stretch.high))]
    return beside_named(evidence, both, {
        "nearest end in a jump": {f"{m:.3f}": nearest(left, m) for m in SUPER_HARMONICS},
        "jumps from (13)": {f"{r:g}": jump_places(evidence, r) for r in FALLING}}, tuple(motions))


@claim("4", "5, after Fig. 4", "the super-harmonic peaks shift up as mu_k falls, from mu_k = mu_s on", Holds(
    f"every peak of mu_k = mu_s above 0.15, followed to the nearest one within {T.near:g} for 0.83, 0.75 and 0.667 "
    "mu_s, never moves down and ends higher (from (13), ratios 0.003 apart)", "some peak does so"))
def peaks_move(evidence: Evidence) -> Measured:
    peaks = peaks_of(evidence)
    chains = [[x] for x in peaks["1"] if x > 0.15]
    for r in FALLING:
        for chain in chains:
            x = nearest(peaks[f"{r:g}"], chain[-1])
            chain += [x] if x is not None and abs(x - chain[-1]) <= evidence.limit("near") else []
    rising = [len(c) > len(FALLING) and all(b >= a for a, b in pairwise(c)) and c[-1] > c[0] for c in chains]
    return Measured((bool(rising) and all(rising), any(rising)),
                    {"peaks followed from mu_k/mu_s = 1 to 0.83, 0.75, 0.667": chains,
                     "all peaks for mu_k/mu_s": peaks},
                    "" if all(rising) else f"{sum(rising)} of {counted(len(chains), 'peak')} do so")


@claim("4", "5, after Fig. 4; 7", "stability is lost around the super-harmonic peaks", Holds(
    f"0.75 or more of the jumps of the maps from (13) for 0.83, 0.75 and 0.667 mu_s lie within {T.close:g} of a peak "
    f"of their curve; {JUMPING}, a peak stands {T.prominent:g} of its curve's largest value above its surroundings",
    "more of the jumps than of all ratios from 0.12 on, for every mu_k, are so near"))
def lost_at_peaks(evidence: Evidence) -> Measured:
    peaks, close = peaks_of(evidence), evidence.limit("close")
    near, covered = [], []
    for r in FALLING:
        row = np.array(peaks[f"{r:g}"])
        near += [bool((np.abs(row - x) <= close).any()) for x in jump_places(evidence, r)]
        covered.append(float((np.abs(FINER[FINER > 0.12, None] - row) <= close).any(axis=1).mean()))
    share = float(np.mean(near)) if near else 0.0
    return Measured((share >= 0.75, share > max(covered)), {"jumps": len(near), "part of them at a peak": share,
                    "part of the ratios from 0.12 on that are as near, for mu_k/mu_s = 0.83, 0.75, 0.667": covered},
                    "more of the jumps lie there than chance has, but not most of them"
                    if 0.75 > share > max(covered) else "")


@claim("4", "5, after Fig. 4", "the transition between stick and stick-slip lies near 0.4 and moves with mu_k", Holds(
    f"the highest slipping ratio from (13) lies within {T.near:g} of 0.4 for mu_k = mu_s, and elsewhere for every "
    "mu_k"),
       fitted=True)
def stick_transition(evidence: Evidence) -> Measured:
    found = last_slips(evidence, "smoothed")
    ends = list(found.values())
    return Measured((abs(ends[0] - 0.4) <= evidence.limit("near") and len(set(ends)) == len(ends),),
                    {"last slip from (13) for mu_k/mu_s": found})


@claim("4", "4, after (11); 5", "the transition moves with mu_k because the law is smoothed", Holds(
    "from mu_k = mu_s to 0.667 mu_s it moves by less than half as far with the set-valued law"))
def transition_by_smoothing(evidence: Evidence) -> Measured:
    values = {law: last_slips(evidence, law) for law in ("smoothed", "set_valued")}
    moved = [abs(row["0.667"] - row["1"]) for row in values.values()]
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


def long_runs(evidence: Evidence, ratio: float) -> dict[float, Any]:
    """By frequency ratio, in steps of 0.009, the last 64 of 650 cycles from (13) for one mu_k/mu_s."""
    return {float(x): evidence.run(evidence.system(with_kinetic(ratio, {FREQUENCY: float(x) * OMEGA_N})),
                                   650).solved_cycles for x in FINER[::3]}


@claim("4", "5, after Fig. 4", "a bifurcation in delta_2 shows in delta_1' too", Shares(
    "ratios 0.05 to 0.5 in steps of 0.009, for 0.75 mu_s, at which the section in delta_2 and the maxima of delta_1' "
    "per cycle repeat to 1e-5 after one and the same number of cycles, or neither does after up to 16,"))
def shows_in_both(evidence: Evidence) -> Measured:
    periods = {x: [repeats(series[-64:]) for series in (cycles.section[:, 1], cycles.highest)]
               for x, cycles in long_runs(evidence, 0.75).items()}
    apart = [[x, *pair] for x, pair in periods.items() if pair[0] != pair[1]]
    share = 1.0 - len(apart) / len(periods)
    return Measured([share], {"part": share, "not at (ratio, periods)": apart})


@claim("4", "5, before Fig. 4", "at the fixed phase point delta_2 varies less than delta_1'", Shares(
    "ratios 0.05 to 0.5 in steps of 0.009, for 0.75 mu_s, whose section does not repeat after one cycle, at which the "
    "standard deviation over the mean magnitude of the section is smaller for delta_2 than for delta_1'"))
def section_varies_less(evidence: Evidence) -> Measured:
    sections = [cycles.section[-64:] for cycles in long_runs(evidence, 0.75).values()]
    variation = np.array([s.std(axis=0) / np.abs(s).mean(axis=0) for s in sections if repeats(s[:, 1]) != 1])
    share = float((variation[:, 1] < variation[:, 0]).mean()) if len(variation) else 1.0
    return Measured([share], {"ratios": len(variation), "part of them": share, "median variation of delta_1', delta_2":
                              np.median(variation[:, :2], axis=0).tolist() if len(variation) else []},
                    "" if share == 1.0 else "the section mostly lies in stick, where delta_1' is nearly 0 and delta_2 "
                    "is what varies")


def repeats(series: Floats) -> int:
    """After how many of its values a series repeats to 1e-5 of its spread or size; 0 for none up to 16."""
    size = 1e-5 * max(float(np.ptp(series)), 1e-3 * float(np.abs(series).max()))
    return next((p for p in range(1, 17) if float(np.abs(series[p:] - series[:-p]).max()) <= size), 0)


@claim("4", "5, after Fig. 4", "a jump near 0.20 at mu_k = 0.83 mu_s turns period one into two", Holds(
    f"from (13) a jump within {T.near:g} of 0.20 with period 1 at 0.002 below it and 2 at 0.002 above; {JUMPING}"))
def jump_doubles_period(evidence: Evidence) -> Measured:
    row = with_kinetic(0.83)
    beside = {f"{x:.4f}": [evidence.motion({**row, FREQUENCY: (x + d) * OMEGA_N}).period for d in (-2e-3, 2e-3)]
              for x in jump_places(evidence, 0.83) if abs(x - 0.20) <= evidence.limit("near")}
    return Measured(([1, 2] in beside.values(),), {"periods around": beside})


LONG = 20000
"""Cycles of an exponent that is too near 0 for fewer."""
FALLS = np.round(np.arange(0.56, 0.8301, 0.01), 6)


@claim("4", "5, after Fig. 4", "near 0.20 period two becomes quasi-periodic or chaotic as mu_k falls further",
       Holds("0.002 above the jump period 2 at 0.83 mu_s, and at a smaller mu_k no period up to 16 and the whole "
             "confidence interval of the largest Lyapunov exponent above 0, or a motion on a torus",
             "at a smaller mu_k there is no period up to 16"))
def doubling_to_chaos(evidence: Evidence) -> Measured:
    places = [x for x in jump_places(evidence, 0.83) if abs(x - 0.20) <= evidence.limit("near")]
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
