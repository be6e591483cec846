"""How the paper's figures are made: what each kind of figure can be asked for."""

from __future__ import annotations

from dataclasses import dataclass, field

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.quantity import Value
from tcc_sim.paper.catalogue import FIGURES, Series, figure_row, paper_system
from tcc_sim.sweeps.results import Curve, Sweep
from tcc_sim.sweeps.simulation import Plan

QUICK_SHARE = 4
"""`--quick` takes one value of so many."""
SWEPT = ("map", "damping", "orbit")
"""Kinds of figures with a sweep, which has a direction."""
BRANCHED = ("map", "orbit", "actuation")
"""Kinds of figures whose points lie on branches, or whose histories are of periodic orbits."""
BOTH_LAWS = ("law", "solvers")
"""Kinds of figures that show the smoothed and the set-valued law."""


@dataclass(frozen=True)
class FigureOptions:
    """How the figures are made.

    quick : a quarter of the values and half of the cycles
    direction : of the sweeps; None takes what the figure has
    law : smoothed, as in the paper, or set_valued
    jobs : threads; None takes all cores
    progress : show a bar on a terminal
    branches : follow the branches behind the points, and tell what each jump is
    kept : curves that were swept already; figures share some of them
    """

    quick: bool = False
    direction: str | None = None
    law: str = "smoothed"
    jobs: int | None = None
    progress: bool = False
    branches: bool = False
    kept: dict[tuple[Curve, Plan], Sweep] = field(default_factory=dict, compare=False, repr=False)


def check_options(number: int, options: FigureOptions) -> None:
    """Raise InputError where a figure has nothing that a direction, the set-valued law or branches would change."""
    kind = figure_row(number).kind
    if options.direction is not None and kind not in SWEPT:
        raise InputError(f"direction is {options.direction}; Fig. {number} has no sweep")
    if options.law != "smoothed" and kind in BOTH_LAWS:
        raise InputError(f"law is {options.law}; Fig. {number} shows both laws")
    if options.branches and kind == "chart":
        raise InputError(f"Fig. {number} is made of branches already; --branches is for the paper's own figures")
    if options.branches and kind not in BRANCHED:
        numbers = ", ".join(str(n) for n, row in FIGURES.items() if row.kind in BRANCHED)
        raise InputError(f"Fig. {number} has no points on branches; --branches is for {numbers}")


def system_of(series: Series, options: FigureOptions, **values: Value) -> System:
    """The system of one curve."""
    return replace(paper_system(series.values), {"friction.law": options.law, **values})
