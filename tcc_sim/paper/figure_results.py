"""What the numbers of the figures are: frozen results, whose fields are the keys of `figure`'s JSON in its order.

Slip speeds are in rad/s, angles in rad, torques in N m; `t` is in engine cycles from the first sample on, (n,).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from tcc_sim.result import ASKED_FOR, SPREAD, json_of

if TYPE_CHECKING:
    from tcc_sim.model.quantity import Value
    from tcc_sim.sweeps.exponents import Lyapunov
    from tcc_sim.trajectory import Floats, Modes

Panel = TypeVar("Panel")
Numbers = TypeVar("Numbers")
"""What the figures of one kind consist of."""


@dataclass(frozen=True)
class Labelled:
    """What every curve and panel has: its label, and the scene keys that set it apart."""

    label: str
    values: Mapping[str, Value]


@dataclass(frozen=True)
class Coexisting:
    """Where a neighbour's last state leads to another motion than the cold start.

    index, value : along the curve, and of its key
    max_slip_speed, period : of the cold start's motion
    spike : whether the cold start stands out from both of its neighbours
    """

    index: int
    value: float
    max_slip_speed: float
    period: int
    other: Reached
    spike: bool


@dataclass(frozen=True)
class JumpBehind:
    """A jump of a curve.

    value, between : where its bifurcation is, else the middle; and between which values of the key
    max_slip_speed : before and after
    cause : kind of the bifurcation, or what else it is
    bifurcation : its number in those behind the curve
    """

    value: float
    between: tuple[float, float]
    max_slip_speed: tuple[float, float]
    cause: str
    bifurcation: int | None


@dataclass(frozen=True)
class MotionsBehind:
    """What is behind a curve.

    branches, bifurcations : as `continue --json` has them
    left_out : sentences on what was not followed
    """

    branches: list[dict[str, Any]]
    bifurcations: list[dict[str, Any]]
    jumps: list[JumpBehind]
    left_out: list[str]


@dataclass(frozen=True)
class Reached:
    """A motion that a neighbour's last state leads to; the period in engine cycles."""

    max_slip_speed: float
    period: int


@dataclass(frozen=True, kw_only=True)
class MapCurve(Labelled):
    """One sweep: per value what `simulate --json` has, and what else was asked for."""

    direction: str
    max_slip_speed: Sequence[float | None]
    min_slip_speed: Sequence[float | None]
    period: Sequence[int | None]
    confirmed: Sequence[bool | None]
    settled: Sequence[bool | None]
    runaway: Sequence[bool | None]
    stick_fraction: Sequence[float | None]
    regime: Sequence[str | None]
    theta2: Sequence[Sequence[float] | None]
    equivalent_damping: Sequence[float | None] | None = field(default=None, metadata=ASKED_FOR)
    negative_slope_mean: Sequence[float | None] | None = field(default=None, metadata=ASKED_FOR)
    status: Sequence[str]
    coexisting: Sequence[Coexisting] | None = field(default=None, metadata=ASKED_FOR)
    behind: MotionsBehind | None = field(default=None, metadata=ASKED_FOR | SPREAD)


@dataclass(frozen=True, kw_only=True)
class Curves:
    """Figs. 4 to 6, 8, 10, 11 and 13 to 18: sweeps over one normalised axis, whose `unit` is the key's value at 1.

    threshold : -C23 of (23), N m s/rad, Fig. 5
    """

    axis: str
    x: Sequence[float]
    unit: float
    cycles: int
    discarded: int
    threshold: float | None = field(default=None, metadata=ASKED_FOR)
    curves: Sequence[MapCurve]


@dataclass(frozen=True)
class LawCurve(Labelled):
    """Fig. 3: friction coefficient over mu_k, and its slope, s/rad, for one ratio; None where it has no maximum."""

    coefficient: Floats
    slope: Floats
    near_coefficient: Floats
    near_slope: Floats
    near_set_valued: Floats
    peak_slip_speed: float | None
    peak: float
    static: float


@dataclass(frozen=True)
class Laws:
    """Fig. 3."""

    slip_speed: Floats
    near_slip_speed: Floats
    curves: Sequence[LawCurve]


@dataclass(frozen=True)
class History(Labelled):
    """A panel of Fig. 7; the section is (plate angle, slip speed), and the exponent is there where no period is."""

    period: int
    section: Sequence[tuple[float, float]]
    lyapunov: Lyapunov | None
    t: Floats
    slip_speed: Floats
    plate_angle: Floats


@dataclass(frozen=True)
class Delay(Labelled):
    """A panel of Fig. 9; `first_half` is the part of positive slip in the first half cycle, NaN where there is none."""

    first_half: float
    t: Floats
    slip_speed: Floats
    engine_torque: Floats
    state: Modes


@dataclass(frozen=True)
class Actuation(Labelled):
    """A panel of Fig. 12."""

    period: int
    t: Floats
    slip_speed: Floats
    saturation_torque: Floats
    engine_torque: Floats


@dataclass(frozen=True)
class ActuationOnBranch(Actuation):
    """A panel of Fig. 12 with its periodic orbit, as an entry of `at` in `continue --json`; None where it has none."""

    orbit: dict[str, Any] | None


@dataclass(frozen=True)
class Panels(Generic[Panel]):
    """Figs. 7, 9 and 12."""

    panels: Sequence[Panel]


@dataclass(frozen=True)
class SolverCurve:
    """Fig. 2, one solver; `rms_difference` from the first curve, relative to its largest |slip speed|."""

    solver: str
    label: str
    status: str
    seconds: float
    t: Floats
    slip_speed: Floats
    friction_torque: Floats
    rms_difference: float | None


@dataclass(frozen=True)
class Steady(Labelled):
    """Fig. 2, the steady state of one law from the initial state (13); `final` is a state of the driveline."""

    period: int
    settled: bool
    max_slip_speed: float
    final: tuple[float, float, float]
    t: Floats
    slip_speed: Floats


@dataclass(frozen=True)
class Solvers:
    """Fig. 2; `cycle` in s."""

    cycle: float
    curves: Sequence[SolverCurve]
    steady: Sequence[Steady]
    steady_cycles: int


@dataclass(frozen=True)
class Figure(Generic[Numbers]):
    """The numbers of one figure with what is said of them; `seconds` of computing."""

    figure: int
    kind: str
    title: str
    caption: str
    law: str
    quick: bool
    parameters: Mapping[str, Any]
    marks: Sequence[float]
    numbers: Numbers = field(metadata=SPREAD)
    seconds: float

    def as_json(self) -> dict[str, Any]:
        """As `figure` writes it, with the numbers among the other keys."""
        found: dict[str, Any] = json_of(self)
        return found
