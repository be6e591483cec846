"""What the numbers of the figures are: frozen results, whose fields are the keys of `figure`'s JSON in its order.

Slip speeds are in rad/s, angles in rad, torques in N m; `t` is in engine cycles from the first sample on, (n,).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from tcc_sim.analysis.damping import Damping
from tcc_sim.analysis.summary import Summary
from tcc_sim.continuation.branch import Branch
from tcc_sim.continuation.newton import OrbitFigures
from tcc_sim.continuation.special_points import Bifurcation
from tcc_sim.result import Described, as_in, reported
from tcc_sim.sweeps.exponents import Lyapunov
from tcc_sim.sweeps.results import Point

if TYPE_CHECKING:
    from tcc_sim.model.quantity import Value
    from tcc_sim.trajectory import Floats, Modes

Panel = TypeVar("Panel")
Numbers = TypeVar("Numbers")
"""What the figures of one kind consist of."""


@dataclass(frozen=True)
class Labelled:
    """What every curve and panel has: its label, and the scene keys that set it apart."""

    label: str = field(metadata=reported("label of the curve or panel"))
    values: Mapping[str, Value] = field(metadata=reported("scene keys that set it apart", "{*}"))


@dataclass(frozen=True)
class Coexisting:
    """Where a neighbour's last state leads to another motion than the cold start."""

    index: int = field(metadata=reported("number of the value along the curve"))
    value: float = field(metadata=reported("value of the key", "{over}"))
    max_slip_speed: float = field(metadata=reported("largest |slip speed| of the cold start's motion", "rad/s"))
    period: int = field(metadata=reported("period of the cold start's motion", "engine cycles"))
    other: Reached = field(metadata=reported("the other motion"))
    spike: bool = field(metadata=reported("whether the cold start stands out from both of its neighbours"))


@dataclass(frozen=True)
class JumpBehind:
    """A jump of a curve."""

    value: float = field(metadata=reported("value of the key: at the bifurcation, or in the middle", "{over}"))
    between: tuple[float, float] = field(metadata=reported("the two values of the key", "{over}"))
    max_slip_speed: tuple[float, float] = field(metadata=reported("largest |slip speed| before and after", "rad/s"))
    cause: str = field(metadata=reported(
        "kind of the bifurcation (stick_border: one at which the motion still creeps in stick, too), or "
        "basin_boundary (both motions go on), steep (one motion all the way), aperiodic (a motion without a period "
        "beside it) or not_followed"))
    bifurcation: int | None = field(metadata=reported("its number in bifurcations"))


@dataclass(frozen=True)
class MotionsBehind:
    """What is behind a curve."""

    branches: list[dict[str, Any]] = field(metadata=reported("as `continue --json` has them", of=(Branch,)))
    bifurcations: list[dict[str, Any]] = field(metadata=reported("as `continue --json` has them", of=(Bifurcation,)))
    jumps: list[JumpBehind] = field(metadata=reported(
        "changes of the largest slip speed between neighbours, and what each is"))
    left_out: list[str] = field(metadata=reported("sentences on motions and branches that were not followed"))


@dataclass(frozen=True)
class Reached:
    """A motion that a neighbour's last state leads to; the period in engine cycles."""

    max_slip_speed: float = field(metadata=reported("largest |slip speed|", "rad/s"))
    period: int = field(metadata=reported("period of the motion", "engine cycles"))


@dataclass(frozen=True, kw_only=True)
class MapCurve(Labelled):
    """One sweep: per value what `simulate --json` has, and what else was asked for."""

    direction: str = field(metadata=reported("direction of the sweep"))
    max_slip_speed: Sequence[float | None] = field(metadata=as_in(Summary, "max_slip_speed"))
    min_slip_speed: Sequence[float | None] = field(metadata=as_in(Summary, "min_slip_speed"))
    period: Sequence[int | None] = field(metadata=as_in(Summary, "period"))
    confirmed: Sequence[bool | None] = field(metadata=as_in(Point, "confirmed"))
    settled: Sequence[bool | None] = field(metadata=as_in(Summary, "settled"))
    runaway: Sequence[bool | None] = field(metadata=as_in(Summary, "runaway"))
    stick_fraction: Sequence[float | None] = field(metadata=as_in(Summary, "stick_fraction"))
    regime: Sequence[str | None] = field(metadata=as_in(Summary, "regime"))
    theta2: Sequence[Sequence[float] | None] = field(metadata=as_in(Point, "theta2"))
    equivalent_damping: Sequence[float | None] | None = field(
        default=None, metadata=as_in(Damping, "weighted", asked_for=True))
    negative_slope_mean: Sequence[float | None] | None = field(
        default=None, metadata=as_in(Damping, "negative_mean", asked_for=True))
    status: Sequence[str] = field(metadata=as_in(Point, "status"))
    coexisting: Sequence[Coexisting] | None = field(default=None, metadata=reported(
        "motions that a neighbour's last state leads to where they differ from those of the cold start",
        asked_for=True))
    behind: MotionsBehind | None = field(default=None, metadata=reported(
        "motions behind the curve", asked_for=True, spread=True))


@dataclass(frozen=True, kw_only=True)
class Curves:
    """Figs. 4 to 6, 8, 10, 11 and 13 to 18: sweeps over one normalised axis, whose `unit` is the key's value at 1."""

    over: str = field(metadata=reported("scene key of the axis"))
    axis: str = field(metadata=reported("name of the axis"))
    x: Sequence[float] = field(metadata=reported("values on the axis"))
    unit: float = field(metadata=reported("value of the key at 1 on the axis"))
    cycles: int = field(metadata=reported("number of engine cycles solved at every value"))
    discarded: int = field(metadata=reported("number of them dropped"))
    threshold: float | None = field(default=None, metadata=reported("-C23 of (23)", "N m s/rad", asked_for=True))
    curves: Sequence[MapCurve] = field(metadata=reported("one for each series"))


@dataclass(frozen=True)
class LawCurve(Labelled):
    """Fig. 3: friction coefficient over mu_k, and its slope, s/rad, for one ratio; None where it has no maximum."""

    coefficient: Floats = field(metadata=reported("friction coefficient over mu_k at slip_speed"))
    slope: Floats = field(metadata=reported("its slope", "s/rad"))
    near_coefficient: Floats = field(metadata=reported("the same at near_slip_speed"))
    near_slope: Floats = field(metadata=reported("slope at near_slip_speed", "s/rad"))
    near_set_valued: Floats = field(metadata=reported("coefficient of the set-valued law over mu_k at near_slip_speed"))
    peak_slip_speed: float | None = field(metadata=reported(
        "slip speed at which the coefficient is largest; null where it has no largest value", "rad/s"))
    peak: float = field(metadata=reported("largest coefficient over mu_k"))
    static: float = field(metadata=reported("mu_s over mu_k"))


@dataclass(frozen=True)
class Laws:
    """Fig. 3."""

    slip_speed: Floats = field(metadata=reported("slip speeds of the curves", "rad/s"))
    near_slip_speed: Floats = field(metadata=reported("slip speeds near 0", "rad/s"))
    curves: Sequence[LawCurve] = field(metadata=reported("one for each ratio of coefficients"))


@dataclass(frozen=True)
class History(Labelled):
    """A panel of Fig. 7; the section is (plate angle, slip speed), and the exponent is there where no period is."""

    period: int = field(metadata=reported("period of the motion; 0 where none up to 16 is found", "engine cycles"))
    section: Sequence[tuple[float, float]] = field(metadata=reported(
        "plate angle and slip speed at t = 2 pi n/omega", "rad, rad/s"))
    lyapunov: Lyapunov | None = field(metadata=reported("largest Lyapunov exponent; null where there is a period"))
    t: Floats = field(metadata=reported("time from the first sample on", "engine cycles"))
    slip_speed: Floats = field(metadata=reported("slip speed", "rad/s"))
    plate_angle: Floats = field(metadata=reported("angle of the clutch plate", "rad"))


@dataclass(frozen=True)
class Delay(Labelled):
    """A panel of Fig. 9; `first_half` is the part of positive slip in the first half cycle, NaN where there is none."""

    first_half: float = field(metadata=reported(
        "part of the positive slip in the first half cycle; null where there is none"))
    t: Floats = field(metadata=reported("time from the first sample on", "engine cycles"))
    slip_speed: Floats = field(metadata=reported("slip speed", "rad/s"))
    engine_torque: Floats = field(metadata=reported("torque of the engine", "N m"))
    state: Modes = field(metadata=reported("-1 negative slip, 0 stick, 1 positive slip"))


@dataclass(frozen=True)
class Actuation(Labelled):
    """A panel of Fig. 12."""

    period: int = field(metadata=reported("period of the motion; 0 where none up to 16 is found", "engine cycles"))
    t: Floats = field(metadata=reported("time from the first sample on", "engine cycles"))
    slip_speed: Floats = field(metadata=reported("slip speed", "rad/s"))
    saturation_torque: Floats = field(metadata=reported("mu_k N R", "N m"))
    engine_torque: Floats = field(metadata=reported("torque of the engine", "N m"))


@dataclass(frozen=True)
class ActuationOnBranch(Actuation):
    """A panel of Fig. 12 with its periodic orbit, as an entry of `at` in `continue --json`; None where it has none."""

    orbit: dict[str, Any] | None = field(metadata=reported(
        "its periodic orbit, as an entry of `at` in `continue --json`; null where it has none", of=(OrbitFigures,)))


@dataclass(frozen=True)
class Panels(Generic[Panel]):
    """Figs. 7, 9 and 12."""

    panels: Sequence[Panel] = field(metadata=reported("time histories"))


@dataclass(frozen=True)
class SolverCurve:
    """Fig. 2, one solver; `rms_difference` from the first curve, relative to its largest |slip speed|."""

    solver: str = field(metadata=reported("name of the solver"))
    label: str = field(metadata=reported("label of the curve"))
    status: str = field(metadata=reported("how the solver ended"))
    seconds: float = field(metadata=reported("computing time", "s"))
    t: Floats = field(metadata=reported("time from the first sample on", "engine cycles"))
    slip_speed: Floats = field(metadata=reported("slip speed", "rad/s"))
    friction_torque: Floats = field(metadata=reported("friction torque", "N m"))
    rms_difference: float | None = field(metadata=reported(
        "rms difference from the first curve, relative to its largest |slip speed|; null where the solver stopped "
        "early"))


@dataclass(frozen=True)
class Steady(Labelled):
    """Fig. 2, the steady state of one law from the initial state (13); `final` is a state of the driveline."""

    period: int = field(metadata=reported("period of the motion; 0 where none up to 16 is found", "engine cycles"))
    settled: bool = field(metadata=reported("whether the section repeats within the tolerance"))
    max_slip_speed: float = field(metadata=reported("largest |slip speed|", "rad/s"))
    final: tuple[float, float, float] = field(metadata=reported(
        "slip speed, plate angle and plate speed at the end", "rad/s, rad, rad/s"))
    t: Floats = field(metadata=reported("time from the first sample on", "engine cycles"))
    slip_speed: Floats = field(metadata=reported("slip speed", "rad/s"))


@dataclass(frozen=True)
class Solvers:
    """Fig. 2; `cycle` in s."""

    cycle: float = field(metadata=reported("engine cycle", "s"))
    curves: Sequence[SolverCurve] = field(metadata=reported("one for each solver"))
    steady: Sequence[Steady] = field(metadata=reported("steady state of each law from the initial state (13)"))
    steady_cycles: int = field(metadata=reported(
        "number of engine cycles from (13) after which a motion counts as its steady state"))


@dataclass(frozen=True)
class Figure(Described, Generic[Numbers]):
    """The numbers of one figure with what is said of them; `seconds` of computing."""

    figure: int = field(metadata=reported("number in the paper"))
    kind: str = field(metadata=reported("kind of the figure, which tells its other fields"))
    title: str = field(metadata=reported("title in our words"))
    caption: str = field(metadata=reported("caption in our words"))
    law: str = field(metadata=reported("friction law"))
    quick: bool = field(metadata=reported("whether it has a quarter of the values"))
    parameters: Mapping[str, Any] = field(metadata=reported("scene keys that all of its curves share", "{*}"))
    marks: Sequence[float] = field(metadata=reported("places on the axis that the text names"))
    numbers: Numbers = field(metadata=reported("the numbers of its kind", spread=True))
    seconds: float = field(metadata=reported("computing time", "s"))
