"""Figures 2 to 18 of the paper from figures.yaml: kind, axis, curves and options of each.

The friction torque of Sections 5 and 6 keeps N(t) while mu_k changes, so mu_s N R = 540 N m (Pm = 225 kPa) in Figs. 4
to 18; the paper does not print the pressure, and of those tried this one agrees with most of its text.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.quantity import Value
from tcc_sim.sweeps.sweep import Curve, Plan, Sweep

PRESSURE = 225e3
"""Mean pressure of Figs. 4 to 18, Pa."""
STATIC = 0.3
SECTION_CYCLES = 2000
"""Section points and cycles of the exponent of a motion without period in Fig. 7."""
QUICK_SHARE = 4
"""`--quick` computes every QUICK_SHARE-th value."""
SWEPT = ("map", "damping", "orbit")
"""Kinds of figures with a sweep, which has a direction."""
BRANCHED = ("map", "orbit", "actuation")
"""Kinds of figures with points on branches, or with histories of periodic orbits."""
SECTION_FIVE: Mapping[str, Value]
SECTION_FIVE, _FIGURES = yaml.safe_load_all(Path(__file__).with_name("figures.yaml").read_text(encoding="utf-8"))
"""Table 1 with a constant pressure, and the initial state (13); the figures."""


@dataclass(frozen=True)
class Series:
    """One curve of a figure: its label and its own scene keys."""

    label: str
    values: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class PaperFigure:
    """One figure.

    number, title, caption : number in the paper, and title and caption in our words, without what the labels show
    kind : solvers, law, map (maxima and orbit diagrams over the frequency), damping, orbit (over mu_k/mu_s), histories,
        delay or actuation
    series : curves, or panels of time histories
    over : swept scene key
    span : ends of the normalised axis, omega/omega_n or mu_k/mu_s
    count : number of values along the axis
    marks : values on the axis that the text names
    """

    number: int
    title: str
    caption: str
    kind: str
    series: tuple[Series, ...]
    over: str = "engine.frequency"
    span: tuple[float, float] = (0.05, 0.5)
    count: int = 226
    marks: tuple[float, ...] = ()


def paper_system(values: Mapping[str, Value] | None = None) -> System:
    """Return the system of Sections 5 and 6 with some keys changed."""
    return replace(System(), {**SECTION_FIVE, **(values or {})})


OMEGA_N = math.sqrt(3000.0 / 0.02)
"""omega_n of Table 1, rad/s."""
NORMALISED: dict[str, tuple[str, float]] = {
    "engine.frequency": ("omega/omega_n", OMEGA_N), "friction.kinetic_coefficient": ("mu_k/mu_s", STATIC),
    "friction.smoothing": ("sigma", 1.0)}
"""Name of the normalised axis, and value at 1 on it, by scene key."""


def values_at(over: str, places: NDArray[np.float64]) -> tuple[float, ...]:
    """Return the values of a scene key at places (n,) on its normalised axis; mu_k is at most mu_s."""
    scaled = places * NORMALISED[over][1]
    return tuple((np.minimum(scaled, STATIC) if over == "friction.kinetic_coefficient" else scaled).tolist())


RATIOS: dict[str, tuple[str, float]] = {
    "mu_k": ("friction.kinetic_coefficient", STATIC), "omega": ("engine.frequency", OMEGA_N),
    "Tsp": ("pressure.amplitude", PRESSURE), "omega_f": ("pressure.frequency_ratio", 1.0),
    "psi": ("pressure.phase", math.pi)}
"""Scene key and value at 1 of the ratios in figures.yaml."""


def plain(label: str) -> str:
    """Return a label without mathematical typesetting."""
    return re.sub(r"[$\\{}]", "", re.sub(r"\\frac\{(\d+)\}\{(\d+)\}", r"\1/\2 ", label))


def _figure(number: int, row: Mapping[str, Any]) -> PaperFigure:
    keys = set(row) - {"label", "common", "curves"}
    fields: dict[str, Any] = {k: tuple(row[k]) if isinstance(row[k], list) else row[k] for k in keys}
    key, choices = row["curves"]
    ratios = ({**row.get("common", {}), key: value} for value in choices.values())
    series = [Series(row.get("label", "%s") % name, {
        RATIOS[k][0] if k in RATIOS else k: x * RATIOS[k][1] if k in RATIOS else x for k, x in values.items()})
        for name, values in zip(choices, ratios)]
    return PaperFigure(number, series=tuple(series), **fields)


FIGURES: dict[int, PaperFigure] = {number: _figure(number, row) for number, row in _FIGURES.items()}
"""Every figure with numbers, by its number in the paper."""


@dataclass(frozen=True)
class FigureOptions:
    """Options of the figures, as of the verb `figure`; `quick` also halves the cycles.

    progress : whether to show a bar on a terminal or in a notebook, elsewhere a line a minute
    kept : finished sweeps, which several figures share
    """

    quick: bool = False
    direction: str | None = None
    law: str = "smoothed"
    jobs: int | None = None
    progress: bool = False
    branches: bool = False
    kept: dict[tuple[Curve, Plan], Sweep] = field(default_factory=dict, compare=False, repr=False)


def check_options(number: int, options: FigureOptions) -> None:
    """Raise InputError if there is no such figure, or if an option does not apply to it."""
    if number not in FIGURES:
        raise InputError(f"figure is {number}; it must be {min(FIGURES)} to {max(FIGURES)}")
    kind = FIGURES[number].kind
    if options.direction is not None and kind not in SWEPT:
        raise InputError(f"direction is {options.direction}; Fig. {number} has no sweep")
    if options.law != "smoothed" and kind in ("law", "solvers"):
        raise InputError(f"law is {options.law}; Fig. {number} shows both laws")
    if options.branches and kind not in BRANCHED:
        numbers = ", ".join(str(n) for n, row in FIGURES.items() if row.kind in BRANCHED)
        raise InputError(f"Fig. {number} has no points on branches; --branches is for {numbers}")


def series_system(series: Series, options: FigureOptions) -> System:
    """Return the system of one curve."""
    return paper_system({**series.values, "friction.law": options.law})
