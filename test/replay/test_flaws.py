"""A recording with a flaw gives the figures of the whole run within what the flaw hides, and says how much that is.

The table of all flaws and all figures; the truth comes from the samples that the flaw leaves, by sums over them.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import pytest
from driveline_bags import START, TICK, bag, ticked

from tcc_sim.messages import cdr
from tcc_sim.replay.replay import replay
from tcc_sim.scene import load_scene
from tcc_sim.topics import FLUID_PRESSURE

SCENE = load_scene("fig02").with_values({"pressure.amplitude": 0.0})
"""Stick-slip of period two, with a breakaway in every second cycle."""
TICKS, DISCARD, CYCLE, HOUR = 2001, 15, SCENE.system.cycle, 3600 * 10**9
FRICTION, SPEEDS = SCENE.system.friction, np.linspace(0.0, 0.2, 200_001)
STUCK = SPEEDS[np.argmax(np.tanh(FRICTION.smoothing * SPEEDS) * (
    FRICTION.kinetic_coefficient + (FRICTION.static_coefficient - FRICTION.kinetic_coefficient)
    * np.exp(-FRICTION.decay * SPEEDS)))]
"""Slip speed at which the law of `SCENE` has its peak, rad/s."""


@cache
def clean() -> list[tuple]:
    return ticked(SCENE, TICKS)


def without(*spans: tuple[int, int]) -> list[tuple]:
    return [row for k, row in enumerate(clean()) if not any(a <= k < b for a, b in spans)]


def losing(share: float) -> list[tuple]:
    kept = np.random.default_rng(1).random(TICKS) > share
    return [row for row, stays in zip(clean(), kept) if stays]


@dataclass
class Flaw:
    """A changed recording: rows written, rows of the analysed run that can be used, options of `bag`, printed words."""

    rows: list[tuple]
    used: list[tuple]
    words: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    bytes: float = 1.0


def lost(rows: list[tuple], words: str = " lost") -> Flaw:
    return Flaw(rows, rows, words)


def not_finite() -> Flaw:
    bad = {300, 1050, *range(1500, 1503)}
    rows = [(row[0], *[math.nan] * 6, row[7]) if k in bad else row for k, row in enumerate(clean())]
    return Flaw(rows, [row for k, row in enumerate(clean()) if k not in bad], "5 states are not finite")


def repeated() -> Flaw:
    """Every tenth state has the stamp of the one before."""
    rows = [(clean()[k - 1][0], *row[1:]) if k % 10 == 5 else row for k, row in enumerate(clean())]
    return Flaw(rows, [row for k, row in enumerate(clean()) if k % 10 != 5], "200 repeated")


def twice() -> Flaw:
    return Flaw([row for row in clean() for _ in range(2)], clean(), f"{TICKS} repeated",
                {"clock": lambda k: START + k * TICK // 2})


def paused() -> Flaw:
    rows = [*clean()[:1250], *[clean()[1249]] * 300, *clean()[1250:]]
    return Flaw(rows, clean(), "the driveline paused", {"clock": lambda k: START + k * TICK})


def stepping(by: int) -> Flaw:
    """The wall clock is set, of the driveline and of the recorder."""
    return Flaw(clean(), clean(), f"{'ahead' if by > 0 else 'back'} by {abs(by) / 1e9:.6g} s",
                {"clock": lambda k: START + k * TICK + by * (k >= 850)})


def missing_pressure() -> Flaw:
    """Another topic loses most of its messages."""
    sent = {k: [("/applied_pressure", FLUID_PRESSURE, START + k * TICK, START + k * TICK,
                 cdr.fluid_pressure(k * TICK, 225e3))] for k in range(0, TICKS, 7)}
    return Flaw(clean(), clean(), "pressure is missing at 1715 ticks", {"joined": sent})


def exchanged() -> Flaw:
    """Blocks of the file have changed places; times of receipt and numbers of the publisher say so."""
    order = [*range(250), *range(750, 1000), *range(250, 750), *range(1000, TICKS)]
    return Flaw([clean()[k] for k in order], clean(), "no gap", {
        "clock": lambda k: START + order[k] * TICK, "publishers": [(0, "first")], "numbers": order})


FLAWS: dict[str, Callable[[], Flaw]] = {
    "none": lambda: Flaw(clean(), clean(), "no gap"),
    "0.2 % lost": lambda: lost(losing(0.002)),
    "1 % lost": lambda: lost(losing(0.01)),
    "5 % lost": lambda: lost(losing(0.05)),
    "half a second lost": lambda: lost(without((1100, 1600))),
    "lost within the dropped cycles": lambda: lost(without((150, 600))),
    "start lost": lambda: Flaw(without((0, 400)), without((0, 400))),
    "start lost after a state": lambda: lost(without((1, 400))),
    "end lost": lambda: Flaw(without((1690, TICKS)), without((1690, TICKS))),
    "end lost before a state": lambda: lost(without((1650, TICKS - 1))),
    "not finite": not_finite, "repeated stamps": repeated, "every message twice": twice,
    "clock set forward": lambda: stepping(HOUR), "clock set back": lambda: stepping(-HOUR),
    "clock set forward a little": lambda: stepping(3 * 10**8), "clock set back a little": lambda: stepping(-3 * 10**8),
    "reset amid": lambda: Flaw([*clean()[:500], *clean()], clean(), "2 runs", {"clock": lambda k: START + k * TICK}),
    "restart amid": lambda: Flaw([*clean()[:500], *clean()], clean(), "2 runs",
                                 {"publishers": [(0, "first"), (500, "second")], "named": True,
                                  "clock": lambda k: START + k * TICK}),
    "cut file": lambda: Flaw(clean(), clean(), "cut short", {"cut": True}, bytes=0.8),
    "blocks exchanged": exchanged, "other topic lost": missing_pressure, "paused": paused,
}


class Truth:
    """Figures of the samples that a flaw leaves: t in ticks, and columns within the covered time."""

    def __init__(self, rows: list[tuple]) -> None:
        table = np.array(rows)
        ticks = np.rint(table[:, 0] / TICK).astype(np.int64)
        first = math.ceil(ticks[0] * 1e-3 / CYCLE)
        self.cycles = math.floor(ticks[-1] * 1e-3 / CYCLE) - first
        self.begin, self.end = (first + DISCARD) * CYCLE, ticks[-1] * 1e-3
        within = ticks * 1e-3 >= self.begin
        self.ticks, (self.angle, flywheel, self.plate, _, friction) = ticks[within], table[within, 2:7].T
        self.v = flywheel - self.plate
        self.power = friction * self.v
        self.shaft = 3000.0 * self.angle + 0.6 * self.plate
        steps = np.diff(ticks)[within[1:]]
        length = np.minimum(steps * 1e-3, self.ticks * 1e-3 - self.begin)
        self.lost, self.seconds = float(length[steps > 1].sum()), float(length[steps == 1].sum())
        inner = np.diff(self.ticks) == 1
        self.heat = float((0.5e-3 * (self.power[1:] + self.power[:-1]))[inner].sum())
        stuck = np.abs(self.v) <= STUCK
        self.breakaways = int((stuck[:-1] & ~stuck[1:] & (np.diff(self.ticks) <= 2)).sum())


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Any]:
    @cache
    def results_of(name: str) -> Any:
        flaw = FLAWS[name]()
        clock = {"clock": lambda k: START + flaw.rows[k][0], **flaw.options}
        path = bag(tmp_path_factory.mktemp("flaws") / "run", flaw.rows, SCENE, **clock)
        if flaw.bytes < 1.0:
            (part,) = path.glob("*.mcap")
            part.write_bytes(part.read_bytes()[:round(flaw.bytes * part.stat().st_size)])
        made = replay(path, discard=DISCARD)
        used = flaw.used[:made.messages] if flaw.bytes < 1.0 else flaw.used
        return flaw, made, Truth(used)
    return results_of


def between(low: float, value: float, high: float) -> bool:
    return low - 1e-9 <= value <= high


def largest(value: float, samples: np.ndarray, whole: np.ndarray) -> bool:
    """No sample that is left lies above, and the whole run reaches it: its tops lie between samples."""
    return between(float(samples.max()), value, float(whole.max()) + 3e-3 * float(np.ptp(whole)))


def heat_is_right(s: Any, truth: Truth, whole: Truth) -> bool:
    hidden = float(whole.power.max()) * s.lost_seconds
    same = abs(s.clutch_energy - truth.heat) <= 0.01 * whole.heat
    missing = whole.heat * (truth.end - truth.begin) / (whole.end - whole.begin) - s.clutch_energy
    return bool(same and -0.03 * whole.heat <= missing <= hidden + 0.03 * whole.heat)


FIGURES: dict[str, Callable[[Any, Truth, Truth], bool]] = {
    "covers": lambda s, t, _: s.covers == pytest.approx((t.begin, t.end), abs=1e-9),
    "seconds": lambda s, t, _: s.seconds == pytest.approx(t.seconds, abs=1e-9),
    "lost_seconds": lambda s, t, _: s.lost_seconds == pytest.approx(t.lost, abs=1e-9),
    "max_slip_speed": lambda s, t, w: largest(s.max_slip_speed, np.abs(t.v), np.abs(w.v)),
    "min_slip_speed": lambda s, t, w: largest(-s.min_slip_speed, -t.v, -w.v),
    "clutch_energy": heat_is_right,
    "mean_power": lambda s, _, w: (s.mean_power == pytest.approx(s.clutch_energy / s.seconds)
                                   and s.mean_power == pytest.approx(w.heat / w.seconds, rel=0.1)),
    "peak_power": lambda s, t, w: largest(s.peak_power, t.power, w.power),
    "max_shaft_torque": lambda s, t, w: largest(s.max_shaft_torque, t.shaft, w.shaft),
    "min_shaft_torque": lambda s, t, w: largest(-s.min_shaft_torque, -t.shaft, -w.shaft),
    "breakaways": lambda s, t, w: s.breakaways == t.breakaways <= w.breakaways,
    "stick_fraction": lambda s, _, w: between(0.0, abs(s.stick_fraction - w.stuck), 0.01 + 0.1 * s.lost_seconds),
    "regime": lambda s, _t, _w: s.regime == "stick-slip",
    "cycles": lambda s, t, _: (s.cycles, s.discarded) == (t.cycles, DISCARD),
}


@pytest.mark.parametrize("name", FLAWS)
def test_figures_are_those_of_the_whole_run_within_what_a_flaw_hides(results: Any, name: str) -> None:
    _, result, truth = results(name)
    whole = results("none")[2]
    whole.stuck = float((np.abs(whole.v) <= STUCK).mean())
    wrong = {figure: getattr(result.summary, figure) for figure, right in FIGURES.items()
             if not right(result.summary, truth, whole)}
    assert not wrong, vars(truth)


@pytest.mark.parametrize("name", FLAWS)
def test_what_a_flaw_hides_is_said(results: Any, name: str) -> None:
    flaw, result, truth = results(name)
    text = "\n".join(result.lines())
    assert flaw.words in text
    assert f"{truth.begin:.6g} to {truth.end:.6g} s" in text
    assert (f"{truth.lost:.6g} s of them were lost" in text) is (truth.lost > 0.0)
    summary = result.summary
    assert summary.covers[1] - summary.covers[0] == pytest.approx(summary.seconds + summary.lost_seconds, rel=1e-12)
    assert summary.period == 2 or (summary.period == 0 and "it needs 16 or more whole periods" in text)
    assert result.pace == pytest.approx(1.0, abs=2e-3)
