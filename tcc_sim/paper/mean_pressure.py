"""The mean pressure of Figs. 4 to 18, which the paper does not print: which one agrees with most of its text.

The text's numbers that depend on it, each worked out at several pressures by the code that judges the claims.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tcc_sim.model import pure_stick
from tcc_sim.output.tables import escape, markdown_table, text
from tcc_sim.paper.catalogue import FIGURES, OMEGA_N, PRESSURE, paper_system
from tcc_sim.paper.claims_figure4 import NEAR
from tcc_sim.paper.claims_figures5to7 import AT_036, RATIOS
from tcc_sim.paper.claims_varying_load import stick_interval, within
from tcc_sim.paper.evidence import KINETIC, Evidence, Values, first_half, steep, with_kinetic

PRESSURES = (200e3, 210e3, 220e3, 225e3, 230e3, 240e3, 250e3, 260e3)
"""Pa; Table 1 says 200 to 400 kPa."""


@dataclass(frozen=True)
class Number:
    """A number of the text: where it stands, what it is, and what a mean pressure makes of it, with whether it fits."""

    figure: str
    text: str
    found: Callable[[Evidence, float], tuple[Any, bool]]


@dataclass(frozen=True)
class PressureRow:
    """What one mean pressure, Pa, makes of every number, each with whether it fits."""

    pressure: float
    found: tuple[tuple[Any, bool], ...]

    @property
    def count(self) -> int:
        """How many numbers fit."""
        return sum(fits for _, fits in self.found)


@dataclass(frozen=True)
class PressureTable:
    """Rows of several mean pressures over the text's numbers."""

    numbers: tuple[Number, ...]
    rows: tuple[PressureRow, ...]

    def best(self) -> list[PressureRow]:
        """The rows that agree with most numbers."""
        most = max(row.count for row in self.rows)
        return [row for row in self.rows if row.count == most]

    def as_json(self) -> dict[str, Any]:
        """`numbers`: figure and text of each; `rows`: per pressure the values, whether each fits, and how many do."""
        return {"numbers": [{"figure": n.figure, "text": n.text} for n in self.numbers],
                "rows": [{"pressure": row.pressure, "values": [value for value, _ in row.found],
                          "fits": [fits for _, fits in row.found], "count": row.count} for row in self.rows]}


def table(evidence: Evidence, pressures: Sequence[float] = PRESSURES) -> PressureTable:
    """What every pressure makes of all NUMBERS."""
    return PressureTable(NUMBERS, tuple(PressureRow(p, tuple(n.found(evidence, p) for n in NUMBERS))
                                        for p in pressures))


def _near(value: float | None, place: float, within: float = NEAR) -> tuple[Any, bool]:
    """A number and whether it is that of the text."""
    return (None if value is None else round(value, 4)), value is not None and abs(value - place) <= within


def _at(pressure: float, row: Values | None = None) -> Values:
    """Scene keys of a row at another mean pressure, its amplitude in proportion."""
    values = dict(row or {})
    part = float(values.get("pressure.amplitude", 0.0)) / PRESSURE  # type: ignore[arg-type]
    return {**values, "pressure.mean": pressure, "pressure.amplitude": part * pressure}


def _stick_from_below(evidence: Evidence, pressure: float) -> tuple[Any, bool]:
    """Fig. 8, psi = 0: end of pure stick at low frequency by (10)."""
    system = paper_system(_at(pressure, FIGURES[8].series[0].values))
    limits = pure_stick.stick_limits(system, 0.02 * OMEGA_N, 0.29 * OMEGA_N, 60)
    return _near(None if limits.lower is None else limits.lower / OMEGA_N, 0.18)


def _stick_from_above(evidence: Evidence, pressure: float) -> tuple[Any, bool]:
    """Fig. 4: end of pure stick at high frequency by (10)."""
    limits = pure_stick.constant_load_limits(paper_system(_at(pressure)))
    return _near(limits[-1] / OMEGA_N if limits else None, 0.4)


def _first_slip(evidence: Evidence, pressure: float) -> tuple[Any, bool]:
    """Fig. 14, psi = 0: lowest slipping and highest sticking ratio from (13); basins decide between them."""
    axis = np.round(np.arange(0.06, 0.2401, 0.003), 6)
    found = stick_interval(evidence, _at(pressure, FIGURES[14].series[0].values), axis)
    return [x if math.isfinite(x) else None for x in found], within(found, 0.15)


def _third_jump(evidence: Evidence, pressure: float) -> tuple[Any, bool]:
    """Fig. 4, 0.75 mu_s: the lowest ratio that period two of 0.36 is followed down to."""
    axis = np.round(np.arange(0.3, 0.3601, 0.002), 6)
    found = evidence.curves([_at(pressure, with_kinetic(0.75))], axis, direction="down")[0]
    largest = found.column("max_slip_speed")
    drops = [float(axis[k + 1]) for k in steep(largest) if largest[k + 1] > largest[k]]
    return _near(min(drops, key=lambda x: abs(x - 1.0 / 3.0), default=None), 1.0 / 3.0)


def _period_two(evidence: Evidence, pressure: float) -> tuple[Any, bool]:
    """Fig. 6: end of period two, followed upward."""
    axis = RATIOS[RATIOS >= 0.74]
    found = evidence.curves([_at(pressure, AT_036)], axis, over=KINETIC, direction="up")[0]
    two = axis[evidence.periods(found) == 2]
    return _near(float(two.max()) if len(two) else None, 0.92)


def _aperiodic(evidence: Evidence, pressure: float) -> tuple[Any, bool]:
    """Fig. 6: highest ratio below 0.78 without a period, from (13)."""
    axis = RATIOS[(RATIOS >= 0.6) & (RATIOS < 0.78)]
    none = axis[evidence.periods(evidence.curves([_at(pressure, AT_036)], axis, over=KINETIC)[0]) == 0]
    return _near(float(none.max()) if len(none) else None, 0.7, 3.0 * NEAR)


def _three_periods(evidence: Evidence, pressure: float) -> tuple[Any, bool]:
    """Fig. 7: the periods, 0 for none."""
    found = [evidence.motion(_at(pressure, with_kinetic(r, AT_036))).period for r in (0.94, 0.74, 0.64)]
    return found, found == [1, 2, 0]


def _halves(evidence: Evidence, pressure: float) -> tuple[Any, bool]:
    """Fig. 9: part of the way slipped in the first half cycle."""
    shares = [first_half(evidence.last_cycles(_at(pressure, s.values), 2, 500)) for s in FIGURES[9].series]
    return [None if math.isnan(x) else round(x, 3) for x in shares], min(shares[:2]) > 0.8 and max(shares[2:]) < 0.2


NUMBERS = (
    Number("8", "psi = 0: pure stick below 0.18, by (10)", _stick_from_below),
    Number("4", "stick again from near 0.4, by (10)", _stick_from_above),
    Number("4", "a jump near 0.33 at 0.75 mu_s, from 0.36 down", _third_jump),
    Number("14", "psi = 0: pure stick below 0.15; lowest slip, highest stick from (13)", _first_slip),
    Number("6", "period two from 0.92, followed upward", _period_two),
    Number("6", "aperiodic from about 0.7, from (13)", _aperiodic),
    Number("7", "periods 1, 2, none at 0.94, 0.74, 0.64", _three_periods),
    Number("9", "part slipped in the first half cycle at 0.15, 0.18, 0.37, 0.40: above 0.8 twice, below 0.2 twice",
           _halves),
)


def pressure_lines(found: PressureTable) -> list[str]:
    """Which mean pressure agrees with how many of the text's numbers."""
    head = [f"Fig. {n.figure}: {escape(n.text)}" for n in found.numbers]
    rows = [[f"{row.pressure / 1e3:g}", *(f"**{text(x)}**" if fits else text(x) for x, fits in row.found),
             f"{row.count} of {len(row.found)}"] for row in found.rows]
    return ["## The mean pressure of Figs. 4 to 18", "",
            "What each mean pressure makes of numbers in the text; bold where it agrees with them.", "",
            *markdown_table(["kPa", *head, "agree"], rows, "---:"), "", f"{pressure_sentence(found)}."]


def pressure_sentence(found: PressureTable) -> str:
    """Which pressures agree with most."""
    names = [f"{row.pressure / 1e3:g}" for row in found.best()]
    agree = "agrees" if len(names) == 1 else "agree"
    return f"{', '.join(names)} kPa {agree} with {found.best()[0].count} of the {len(found.numbers)} numbers, the most"
