"""Output of steps: a motion that is one polynomial over three cycles, cut into steps at any places."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Chebyshev, Polynomial

from tcc_sim.model.parameters import replace
from tcc_sim.polynomials import polynomial
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.run_output import CYCLE, OUTPUT, TRANSITION, Store, keep_step
from tcc_sim.solvers.series import ANGLE, FLYWHEEL, SLIP, SPEED
from tcc_sim.solvers.stages import WORK

PERIOD, CYCLES, LAYER = 0.5, 3, 0.25
END = PERIOD * CYCLES
SWINGS = Chebyshev([0.05, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0], [0.0, END]).convert(kind=Polynomial)
"""Slip speed that goes through the layer six times, both ways, and has six extremes inside."""
MOTIONS = {SLIP: SWINGS, ANGLE: Polynomial([0.3, -1.0, 0.5, 2.0]), SPEED: Polynomial([-1.0, 1.0, 6.0]),
           FLYWHEEL: Polynomial([2.0, 0.0, -1.0, 0.25])}
PER_CYCLE = 7


def about(p: Polynomial, at: float, unit: float) -> list[float]:
    """Coefficients of p(at + unit x) in powers of x, from exact arithmetic."""
    out = [Fraction(0)] * (p.degree() + 1)
    for a in reversed(p.coef.tolist()):
        out = [(out[k - 1] * Fraction(unit) if k else Fraction(0)) + out[k] * Fraction(at) for k in range(len(out))]
        out[0] += Fraction(a)
    return [float(x) for x in out]


class Run:
    """Output that `keep_step` stores of a run of steps."""

    def __init__(self, ends: list[float], unit: float = 0.1, *, motions: dict[int, Polynomial] = MOTIONS, mode: int = 0,
                 per_cycle: int = PER_CYCLE, transitions: int = 40) -> None:
        self.output: Any = np.zeros(1, OUTPUT)[0]
        self.cycles, self.transitions = np.zeros(CYCLES + 1, CYCLE), np.zeros(transitions, TRANSITION)
        self.samples = np.full((CYCLES * per_cycle, 4), np.nan)
        start = float(motions[SLIP](0.0))
        self.output["mode"], self.output["highest"], self.output["lowest"] = mode, start, start
        work: Any = np.zeros(1, WORK)[0]
        degree = max(p.degree() for p in motions.values())
        begin, tau = 0.0, 0.0
        for end in ends:
            for row, p in motions.items():
                work["rows"][row] = 0.0
                result = about(p, begin, unit)
                work["rows"][row, :len(result)] = result
            x = (end - begin) / unit
            cut = (PERIOD - tau) / unit
            cut = x if abs(cut - x) < 1e-12 else cut
            polynomial.to_bernstein(work["rows"], SLIP, degree, x, work["bernstein"])
            keep_step(work, degree, unit, x, cut, tau, begin, PERIOD, LAYER, self.output,
                               Store(self.cycles, self.samples, per_cycle, self.transitions), True)
            begin, tau = end, end - PERIOD * self.output["cycle"]


def cuts(seed: int, count: int) -> list[float]:
    """Ends of steps at random places, the last at the end."""
    return [*np.sort(np.random.default_rng(seed).uniform(0.0, END, count)).tolist(), END]


def crossings() -> list[tuple[float, int]]:
    """Where the slip speed of MOTIONS meets the edge of the layer, and the mode behind it, by the roots of a
    polynomial.
    """
    at = sorted(float(root.real) for level in (LAYER, -LAYER) for root in (SWINGS - level).roots()
                if abs(root.imag) < 1e-9 and 0.0 < root.real < END)
    return [(t, int(np.sign(v)) * (abs(v) > LAYER)) for t, v in ((t, float(SWINGS(t + 1e-6))) for t in at)]


EACH_CYCLE = [0.5, 1.0, 1.5]
STEPS = pytest.mark.parametrize("ends", [EACH_CYCLE, [0.3, 0.7, 1.4, 1.5], cuts(1, 4), cuts(2, 12), cuts(3, 60)],
                                ids=["a step a cycle", "steps across", "few", "some", "many"])


@STEPS
def test_samples_are_uniform_in_time_and_of_the_motion(ends: list[float]) -> None:
    """Whatever steps they fall in; the one at the end of the last step belongs to the step after it."""
    run = Run(ends)
    t = np.arange(CYCLES * PER_CYCLE) * (PERIOD / PER_CYCLE)
    assert run.output["samples"] == len(t)
    for column, row in enumerate((SLIP, ANGLE, SPEED, FLYWHEEL)):
        assert run.samples[:, column] == pytest.approx(MOTIONS[row](t), abs=1e-11)


def test_nothing_is_stored_without_samples() -> None:
    bare = Run(EACH_CYCLE, per_cycle=0)
    assert bare.output["samples"] == 0
    assert bare.cycles["highest"].tolist() == Run(EACH_CYCLE).cycles["highest"].tolist()


@STEPS
def test_cycles_start_with_the_state_and_hold_the_extremes_within_them(ends: list[float]) -> None:
    run = Run(ends)
    assert run.output["cycle"] == CYCLES
    turns = [float(root.real) for root in SWINGS.deriv().roots() if abs(root.imag) < 1e-9 and 0.0 < root.real < END]
    assert len(turns) == 6
    for n in range(CYCLES):
        low, high = n * PERIOD, (n + 1) * PERIOD
        values = SWINGS(np.array([low, high, *(t for t in turns if low < t < high)]))
        assert run.cycles["highest"][n] == pytest.approx(values.max(), abs=1e-11)
        assert run.cycles["lowest"][n] == pytest.approx(values.min(), abs=1e-11)
        end = run.cycles[n + 1]
        for name, row in (("slip_speed", SLIP), ("plate_angle", ANGLE), ("plate_speed", SPEED)):
            assert end[name] == pytest.approx(MOTIONS[row](high), abs=1e-11)


@STEPS
def test_transitions_are_the_edges_of_the_layer_with_the_mode_on_both_sides(ends: list[float]) -> None:
    run = Run(ends, mode=-1)
    count = int(run.output["transitions"])
    expected = crossings()
    assert {after for _, after in expected} == {-1, 0, 1}
    assert run.transitions["time"][:count] == pytest.approx([t for t, _ in expected], abs=1e-10)
    assert run.transitions["after"][:count].tolist() == [after for _, after in expected]
    assert run.transitions["before"][:count].tolist() == [-1, *(after for _, after in expected[:-1])]
    assert run.output["mode"] == expected[-1][1]


@STEPS
def test_the_time_in_stick_of_each_cycle_is_what_the_layer_holds_of_it(ends: list[float]) -> None:
    run = Run(ends, mode=-1)
    edges = [(0.0, -1), *crossings(), (END, 2)]
    for n in range(CYCLES):
        low, high = n * PERIOD, (n + 1) * PERIOD
        stuck = sum(max(min(end, high) - max(begin, low), 0.0)
                    for (begin, mode), (end, _) in pairwise(edges) if mode == 0)
        assert run.cycles["stick_time"][n] == pytest.approx(stuck, abs=1e-10)


def test_a_dip_into_the_layer_within_one_step_is_two_transitions_and_its_time() -> None:
    """Both ends are far outside: what values at the ends would miss."""
    dip = Polynomial([0.2, 0.0, 64.0])(Polynomial([-0.2, 1.0]))
    for sign in (1, -1):
        run = Run([0.4], motions={**MOTIONS, SLIP: sign * dip}, mode=sign)
        width = 2.0 * np.sqrt(0.05 / 64.0)
        assert run.output["transitions"] == 2
        assert run.transitions["before"][:2].tolist() == [sign, 0]
        assert run.transitions["after"][:2].tolist() == [0, sign]
        assert run.transitions["time"][:2] == pytest.approx([0.2 - width / 2.0, 0.2 + width / 2.0], abs=1e-11)
        assert run.output["stick_time"] == pytest.approx(width, abs=1e-11)
        assert (run.output["lowest"] if sign > 0 else run.output["highest"]) == pytest.approx(sign * 0.2, abs=1e-14)


def test_a_graze_of_the_layer_is_no_transition() -> None:
    miss = Polynomial([LAYER + 1e-9, 0.0, 64.0])(Polynomial([-0.2, 1.0]))
    run = Run([0.4], motions={**MOTIONS, SLIP: miss}, mode=1)
    assert (run.output["transitions"], run.output["stick_time"], run.output["mode"]) == (0, 0.0, 1)


def test_stick_throughout_is_the_whole_time_on_both_sides_of_a_cycles_end() -> None:
    run = Run([0.7, 1.2, END], motions={**MOTIONS, SLIP: Polynomial([0.1, 0.05])})
    assert run.cycles["stick_time"][:CYCLES] == pytest.approx([PERIOD] * CYCLES, abs=1e-14)
    assert run.output["transitions"] == 0


def test_transitions_beyond_their_room_are_left_out_and_the_rest_is_as_before() -> None:
    whole, small = Run(EACH_CYCLE, mode=-1), Run(EACH_CYCLE, mode=-1, transitions=3)
    assert small.output["transitions"] == 3
    assert small.transitions.tolist() == whole.transitions[:3].tolist()
    assert small.cycles.tolist() == whole.cycles.tolist()
    assert small.output["mode"] == whole.output["mode"]


@pytest.mark.parametrize(("law", "start"), [("smoothed", 0), ("set_valued", 3)])
def test_a_rest_of_more_than_a_billionth_of_a_cycle_is_a_part_of_one(law: str, start: int) -> None:
    system = replace(load_scene("fig02").system, {"friction.law": law})
    for more, kept in ((0.8e-9, False), (1.2e-9, True), (0.5, True)):
        run = solve(system, duration=(2.0 + more) * system.cycle, start_cycle=start)
        assert (len(run.cycles), run.rest is not None) == (2, kept)
        if run.rest is not None:
            ends = np.array([start + 2.0, start + 2.0 + more])
            assert run.rest.starts == pytest.approx(ends * system.cycle, rel=1e-15)
            assert run.rest.section[-1] == pytest.approx(run.final.numbers)
