"""Figures 2 to 18 of the paper as data: kind, axis, curves and options of each.

The friction torque of Sections 5 and 6 keeps N(t) while mu_k changes, so mu_s N R = 540 N m (Pm = 225 kPa) in Figs. 4
to 18; the paper does not print the pressure, and of those tried this one agrees with most of its text. Fig. 2 states
its own. Amplitudes are ratios Tsp/Tsm = Pp/Pm.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.quantity import Value

if TYPE_CHECKING:
    from tcc_sim.sweeps.results import Curve, Sweep
    from tcc_sim.sweeps.simulation import Plan

PRESSURE = 225e3
"""Mean pressure of Figs. 4 to 18, Pa."""
STATIC = 0.3
SUPER_HARMONICS = (1 / 6, 1 / 5, 1 / 4, 1 / 3)
"""omega/omega_n of the super-harmonic peaks that the paper names (0.167, 0.20, 0.25, 0.33)."""
SECTION_CYCLES = 2000
"""Section points and cycles of the exponent of a motion without period in Fig. 7."""
QUICK_SHARE = 4
"""`--quick` computes every QUICK_SHARE-th value."""
SWEPT = ("map", "damping", "orbit")
"""Kinds of figures with a sweep, which has a direction."""
BRANCHED = ("map", "orbit", "actuation")
"""Kinds of figures with points on branches, or with histories of periodic orbits."""
BOTH_LAWS = ("law", "solvers")
"""Kinds of figures that show the smoothed and the set-valued law."""

SECTION_FIVE: Mapping[str, Value] = {
    "driveline.flywheel_inertia": 0.2, "driveline.plate_inertia": 0.02, "driveline.damping": 0.6,
    "driveline.stiffness": 3000.0,
    "friction.law": "smoothed", "friction.static_coefficient": STATIC, "friction.kinetic_coefficient": STATIC,
    "friction.decay": 2.0, "friction.smoothing": 50.0, "clutch.area": 0.08, "clutch.radius": 0.1,
    "engine.source": "harmonic", "engine.mean_torque": 300.0, "engine.torque_amplitude": 250.0,
    "pressure.source": "harmonic", "pressure.mean": PRESSURE, "pressure.amplitude": 0.0,
    "pressure.frequency_ratio": 1.0,
    "pressure.phase": 0.0, "initial.slip_speed": 150.0, "initial.plate_angle": 0.0, "initial.plate_speed": 0.0}
"""Table 1 with a constant pressure, and the initial state (13)."""


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
STUCK_RATIO = math.sqrt(0.02 / 0.22)
"""omega_sn/omega_n of (28)."""
NORMALISED: dict[str, tuple[str, float]] = {
    "engine.frequency": ("omega/omega_n", OMEGA_N), "friction.kinetic_coefficient": ("mu_k/mu_s", STATIC),
    "friction.smoothing": ("sigma", 1.0)}
"""Name of the normalised axis, and value at 1 on it, by scene key."""


def plain(label: str) -> str:
    """Return a label without mathematical typesetting."""
    label = re.sub(r"\\frac\{(\d+)\}\{(\d+)\}", r"\1/\2 ", label)
    for sign in ("$", "\\", "{", "}"):
        label = label.replace(sign, "")
    return label


def _kinetic(ratio: float) -> dict[str, Value]:
    """Return mu_k as a fraction of mu_s."""
    return {"friction.kinetic_coefficient": ratio * STATIC}


def _friction_ratios(*ratios: float) -> tuple[Series, ...]:
    """Return a curve for every mu_k/mu_s."""
    return tuple(Series(rf"$\mu_k = {'' if r == 1.0 else format(r, 'g')}\mu_s$", _kinetic(r)) for r in ratios)


def _loads(label: str, key: str, choices: Mapping[str, float], kinetic: float = 1.0,
           **more: Value) -> tuple[Series, ...]:
    """Return a curve for every choice of a key of the load; otherwise Tsp/Tsm = 0.25, omega_f = omega and psi = 0."""
    usual = {"pressure.amplitude": 0.25 * PRESSURE, "pressure.frequency_ratio": 1.0, "pressure.phase": 0.0}
    return tuple(Series(label % name, {**usual, key: value, **_kinetic(kinetic), **more})
                 for name, value in choices.items())


_phases = partial(_loads, r"$\psi = %s$", "pressure.phase", {"0": 0.0, r"\pi/2": 0.5 * math.pi, r"\pi": math.pi})
_amplitudes = partial(_loads, r"$T_{sp}/T_{sm} = %s$", "pressure.amplitude", {
    f"{x:g}": x * PRESSURE for x in (0.0, 0.125, 0.25, 0.5)})
_frequencies = partial(_loads, r"$\omega_f = %s\omega$", "pressure.frequency_ratio")
HALF_ONE_TWO = {"0.5": 0.5, "": 1.0, "2": 2.0}
THIRDS = {r"\frac{2}{3}": 2.0 / 3.0, "": 1.0, r"\frac{4}{3}": 4.0 / 3.0}
"""Curves for the phases, amplitudes and frequencies of the actuation."""
LOAD = r"$\mu_s N_m R = 540$ N m"
CONSTANT = rf"constant load, {LOAD}"
QUARTER = rf"{LOAD}, $T_{{sp}}/T_{{sm}} = 0.25$"
FALLING_SLOPE = r"$\mu_k = 0.75\mu_s$"

_FIG02: dict[str, Value] = {**_kinetic(0.8), "pressure.mean": 500.0 / (0.24 * 0.08 * 0.1),
                            "pressure.amplitude": 100.0 / (0.24 * 0.08 * 0.1), "engine.frequency": 150.0}

FIGURES: dict[int, PaperFigure] = {row.number: row for row in (
    PaperFigure(2, "The same stick-slip motion by five solvers, and where each friction law settles",
                r"$\omega = \omega_f = 150$ rad/s, $T_m = 300$, $T_p = 250$, $T_{sm} = 500$, $T_{sp} = 0.2T_{sm}$ N m, "
                r"$\psi = 0$, $\mu_k = 0.8\mu_s$," "\n"
                r"$\Omega_e = 150$ rad/s; (a) and (b) start from the steady state of law (7) with $\sigma = 50$ s/rad",
                "solvers", (Series("", _FIG02),)),
    PaperFigure(3, "Smoothed friction law and its slope", r"$\alpha = 2$ s/rad, $\sigma = 50$ s/rad", "law",
                _friction_ratios(1.0, 0.8, 0.75, 0.677)),
    PaperFigure(4, r"Effect of $\mu_k$ at constant normal load",
                rf"{CONSTANT}; dotted: $\omega/\omega_n = 1/6, 1/5, 1/4, 1/3$", "map",
                _friction_ratios(1.0, 0.83, 0.75, 0.667), marks=SUPER_HARMONICS),
    PaperFigure(5, r"Equivalent damping beside the orbit diagram, $\mu_k = 0.667\mu_s$", rf"{CONSTANT}; "
                "(23): unstable below the dashed line", "damping",
                (Series(r"$\mu_k = 0.667\mu_s$", _kinetic(0.667)),), span=(0.08, 0.30), count=221),
    PaperFigure(6, r"Orbit diagram over $\mu_k/\mu_s$ at $\omega/\omega_n = 0.36$", CONSTANT,
                "orbit", (Series("", {"engine.frequency": 0.36 * OMEGA_N}),), over="friction.kinetic_coefficient",
                span=(0.55, 1.0), count=226),
    PaperFigure(7, r"Time histories and Poincaré sections at $\omega/\omega_n = 0.36$",
                rf"{CONSTANT}; sections at $t = 2\pi n/\omega$", "histories",
                tuple(Series(rf"$\mu_k/\mu_s = {r:g}$", {**_kinetic(r), "engine.frequency": 0.36 * OMEGA_N})
                      for r in (0.94, 0.74, 0.64))),
    PaperFigure(8, r"Effect of the phase $\psi$, $\mu_k = \mu_s$",
                rf"{QUARTER}, $\omega_f = \omega$; dotted: $\omega_{{sn}}/\omega_n$", "map", _phases(1.0),
                marks=(STUCK_RATIO,)),
    PaperFigure(9, "Delay of positive slip behind the engine torque",
                rf"{CONSTANT}, $\mu_k = \mu_s$; shaded: positive slip; dashed: $T_e$", "delay",
                tuple(Series(rf"$\omega/\omega_n = {r:.2f}$", {"engine.frequency": r * OMEGA_N})
                      for r in (0.15, 0.18, 0.37, 0.40))),
    PaperFigure(10, r"Effect of $\omega_f$, $\mu_k = \mu_s$", rf"{QUARTER}, $\psi = 0$", "map",
                _frequencies(HALF_ONE_TWO)),
    PaperFigure(11, r"Effect of $\omega_f$, $\mu_k = \mu_s$", rf"{QUARTER}, $\psi = 0$", "map",
                _frequencies(THIRDS)),
    PaperFigure(12, r"Time histories for three $\omega_f$ at $\omega = 150$ rad/s",
                rf"{QUARTER}, $\psi = 0$, $\mu_k = \mu_s$; dashed: $T_s$; dotted: $T_e$", "actuation",
                _frequencies({"0.5": 0.5, **{name: x for name, x in THIRDS.items() if name}},
                             **{"engine.frequency": 150.0})),
    PaperFigure(13, r"Effect of $T_{sp}$, $\mu_k = \mu_s$", rf"{LOAD}, $\omega_f = \omega$, $\psi = 0$", "map",
                _amplitudes(1.0)),
    PaperFigure(14, rf"Phase with a falling friction law, {FALLING_SLOPE}", rf"{QUARTER}, $\omega_f = \omega$", "map",
                _phases(0.75)),
    PaperFigure(15, r"Phase with a falling friction law, $\mu_k = 0.67\mu_s$", rf"{QUARTER}, $\omega_f = \omega$",
                "map", _phases(0.67)),
    PaperFigure(16, rf"Actuation frequency with a falling friction law, {FALLING_SLOPE}", rf"{QUARTER}, $\psi = 0$",
                "map", _frequencies(HALF_ONE_TWO, 0.75)),
    PaperFigure(17, rf"Actuation frequency with a falling friction law, {FALLING_SLOPE}", rf"{QUARTER}, $\psi = 0$",
                "map", _frequencies(THIRDS, 0.75)),
    PaperFigure(18, rf"Actuation amplitude with a falling friction law, {FALLING_SLOPE}",
                rf"{LOAD}, $\omega_f = \omega$, $\psi = 0$", "map", _amplitudes(0.75)),
)}
"""Every figure with numbers, by its number in the paper."""

@dataclass(frozen=True)
class FigureOptions:
    """Options of the figures.

    quick : whether to compute a quarter of the values and half of the cycles
    direction : direction of the sweeps; None for the figure's own
    law : smoothed, as in the paper, or set_valued
    jobs : number of threads; None for all cores
    progress : whether to show a bar on a terminal or in a notebook, elsewhere a line a minute
    branches : whether to follow the branches behind the points and determine the causes of jumps
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
    """Raise InputError if a direction, the set-valued law or branches do not apply to a figure."""
    kind = FIGURES[number].kind
    if options.direction is not None and kind not in SWEPT:
        raise InputError(f"direction is {options.direction}; Fig. {number} has no sweep")
    if options.law != "smoothed" and kind in BOTH_LAWS:
        raise InputError(f"law is {options.law}; Fig. {number} shows both laws")
    if options.branches and kind not in BRANCHED:
        numbers = ", ".join(str(n) for n, row in FIGURES.items() if row.kind in BRANCHED)
        raise InputError(f"Fig. {number} has no points on branches; --branches is for {numbers}")


def series_system(series: Series, options: FigureOptions, **values: Value) -> System:
    """Return the system of one curve."""
    return replace(paper_system(series.values), {"friction.law": options.law, **values})
