"""Curves and motions made up for the claims, so that a verdict can be made to come out either way."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from tcc_sim.analysis.damping import Damping
from tcc_sim.analysis.summary import Summary
from tcc_sim.paper.catalogue import OMEGA_N, STATIC, paper_system
from tcc_sim.paper.evidence import KINETIC, Evidence
from tcc_sim.studies.point import Plan, Point
from tcc_sim.studies.simulation import Start
from tcc_sim.studies.sweep import Curve, Sweep
from tcc_sim.trajectory import State


def record(slip: float = 10.0, period: int = 1, regime: str = "stick-slip", **more: Any) -> dict[str, Any]:
    return {"max_slip_speed": slip, "period": period, "regime": regime, **more}


def point(value: float, found: dict[str, Any]) -> Point:
    """The point of a sweep that has such a record."""
    summary = Summary(found["max_slip_speed"], 0.0, found["period"], [], float(found["regime"] == "stick"), found["regime"],
                      150, 50, True, 0.0, "smoothed", 0.0)
    damping = Damping(found["equivalent_damping"], found["negative_slope_mean"], 0.0) if "equivalent_damping" in found else None
    nowhere = np.empty((0, 2))
    return Point(value, summary, nowhere, True, "done", nowhere[:, 0], damping, None, Start(State(0.0, 0.0, 0.0), 150))


class Given(Evidence):
    """Evidence that was made up: a record per row, ratio and direction, and jumps per row."""

    def __init__(self, at: Callable[..., dict[str, Any]] = lambda row, x, direction: record(),
                 jumps: Callable[..., list[float]] = lambda row: [], lyapunov: str = "chaotic",
                 steady: Callable[..., Any] | None = None) -> None:
        super().__init__(1e-9, 1)
        self.at, self.leaps, self.diagnosis, self.rests = at, jumps, lyapunov, steady

    def curves(self, rows, axis, *, over="engine.frequency", direction="cold", **how):  # type: ignore
        unit = OMEGA_N if over == "engine.frequency" else STATIC
        keys = tuple(min(float(x) * unit, STATIC) if unit == STATIC else float(x) * unit for x in axis)
        return [Sweep(Curve(paper_system(row), over, keys), Plan(direction=direction),
                      [point(float(x), self.at(row, float(x), direction)) for x in axis], 0.0) for row in rows]

    def motion(self, row, *, lyapunov=False):  # type: ignore
        x = float(row.get("engine.frequency", OMEGA_N)) / OMEGA_N
        found = self.at(row, x, "cold")
        return {**found, "lyapunov": {"low": 0.0, "exponent": 0.0, "high": 1.0, "diagnosis": self.diagnosis}}

    def jumps(self, row, axis):  # type: ignore
        return [(x, 10.0) for x in self.leaps(row)]

    def steady(self, row):  # type: ignore
        assert self.rests is not None
        return self.rests(row)


def ratio_of(row: Any) -> float:
    """mu_k/mu_s of a row."""
    return round(float(row.get(KINETIC, STATIC)) / STATIC, 4)


def phase_is(row: Any, value: float) -> bool:
    return bool(abs(row["pressure.phase"] - value) < 1e-9)


def lowest(key: str, wanted: float, low: float = 1.0, high: float = 1.0, place: float = 0.3) -> Callable[..., Any]:
    """A curve that is lowest below `place` and highest above where `key` has the wanted value."""
    def at(row: Any, x: float, direction: str) -> dict[str, Any]:
        if abs(row[key] - wanted) < 1e-9:
            return record(10.0 - low if x < place else 10.0 + high)
        return record(10.0)
    return at


def law_of(row: Any) -> str:
    return str(row.get("friction.law", "smoothed"))


def slips_to(end: Callable[[Any], float]) -> Callable[..., Any]:
    return lambda row, x, direction: record(regime="stick-slip" if x <= end(row) else "stick")


def slips_from(start: Callable[[Any], float]) -> Callable[..., Any]:
    return lambda row, x, direction: record(regime="stick-slip" if x >= start(row) else "stick")


def by_amplitude(order: tuple[float, float]) -> Callable[..., Any]:
    """Fig. 13: how the maxima change with Tsp below and above 0.3."""
    return lambda row, x, direction: record(10.0 + order[x > 0.3] * row["pressure.amplitude"] / 225e3)


def orbit(cold: float, up: float, down: float, start: float = 0.7) -> Callable[..., Any]:
    """Fig. 6: period two below an end of its own in each direction, none below `start`."""
    def at(row: Any, x: float, direction: str) -> dict[str, Any]:
        end = {"cold": cold, "up": up, "down": down}[direction]
        return record(period=0 if x <= start else 2 if x <= end + 1e-9 else 1)
    return at


def period_at(periods: Callable[[Any, float], int]) -> Callable[..., Any]:
    return lambda row, x, direction: record(period=periods(row, x))


def coprime(row: Any) -> int:
    from fractions import Fraction
    return Fraction(row["pressure.frequency_ratio"]).limit_denominator(12).denominator


def denominators(row: Any, x: float) -> int:
    return coprime(row)


NAMED = [0.167, 0.20, 0.25, 0.333]
SMALL = {0.83: 0.0, 0.75: 0.004, 0.667: 0.008}


def sharp(shift: float) -> Callable[..., Any]:
    """Fig. 4: one peak near 0.2 for every mu_k, each shifted from the last."""
    def at(row: Any, x: float, direction: str) -> dict[str, Any]:
        place = 0.2 + shift * SMALL[ratio_of(row)]
        return record(10.0 + 20.0 * math.exp(-((x - place) / 0.004) ** 2))
    return at


def uneven(severe_where_steep: bool) -> Callable[..., Any]:
    """Fig. 14: a smooth hill and a small saw; period four on one of them."""
    def at(row: Any, x: float, direction: str) -> dict[str, Any]:
        steep = x > 0.35
        slip = (5.0 + 3.0 * (round(x / 0.005) % 2)) if steep else 30.0 - 20.0 * abs(x - 0.2)
        return record(slip, period=4 if steep == severe_where_steep else 1)
    return at


def dampings(cf: Callable[[float], float], changes: bool) -> Callable[..., Any]:
    return lambda row, x, direction: record(period=2 if changes and x > 0.2 else 1, equivalent_damping=cf(x),
                                            negative_slope_mean=-1.0)
