"""Numbers of the figures as frozen results with the fields of `figure`'s JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from tcc_sim.analysis.steady.damping import Damping
from tcc_sim.analysis.steady.exponents import Lyapunov
from tcc_sim.analysis.steady.summary import Summary
from tcc_sim.result import Described, as_in, reported
from tcc_sim.study.continuation.bifurcations import Bifurcation
from tcc_sim.study.continuation.branch import Branch
from tcc_sim.study.continuation.orbits import OrbitFigures
from tcc_sim.sweeps.results import Point

optional, same = partial(reported, optional=True), partial(as_in, optional=True)


@dataclass(frozen=True)
class Reached:
    """Motion that a neighbour's last state leads to."""

    max_slip_speed: float = field(metadata=reported("largest |slip speed|", "rad/s"))
    period: int = field(metadata=reported("period of the motion", "periods of excitation"))


@dataclass(frozen=True)
class Coexisting:
    """Value at which a neighbour's last state leads to another motion than the cold start."""

    index: int = field(metadata=reported("number of the value along the curve"))
    value: float = field(metadata=reported("value of the key", "{over}"))
    max_slip_speed: float = field(metadata=reported("that of the cold start", "rad/s"))
    period: int = field(metadata=reported("that of the cold start", "periods of excitation"))
    other: Reached = field(metadata=reported("the other motion"))
    spike: bool = field(metadata=reported("whether the cold start stands out from both of its neighbours"))


@dataclass(frozen=True)
class JumpBehind:
    """Jump of a curve."""

    value: float = field(metadata=reported("value of the key: at the bifurcation, or in the middle", "{over}"))
    between: tuple[float, float] = field(metadata=reported("the two values of the key", "{over}"))
    max_slip_speed: tuple[float, float] = field(metadata=reported("largest |slip speed| before and after", "rad/s"))
    cause: str = field(metadata=reported(
        "kind of the bifurcation, or basin_boundary (both motions go on), steep (one motion), aperiodic "
        "(beside a motion without a period) or not_followed"))
    bifurcation: int | None = field(metadata=reported("its number in bifurcations"))


@dataclass(frozen=True)
class MotionsBehind:
    """Motions behind a curve."""

    branches: list[dict[str, Any]] = field(metadata=reported("as `continue --json` has them", of=(Branch,)))
    bifurcations: list[dict[str, Any]] = field(metadata=reported("as `continue --json` has them", of=(Bifurcation,)))
    jumps: list[JumpBehind] = field(metadata=reported(
        "jumps of the largest slip speed between neighbours"))
    left_out: list[str] = field(metadata=reported("sentences on what was not followed"))


@dataclass(frozen=True, kw_only=True)
class Labelled:
    """Curve or panel of a figure: label and series; series that it lacks are None."""

    label: str = field(metadata=reported("of the curve or panel"))
    values: Any = field(default=None, metadata=optional("scene keys that set it apart", "{*}"))
    direction: Any = field(default=None, metadata=optional("direction of the sweep"))
    max_slip_speed: Any = field(default=None, metadata=same(Summary, "max_slip_speed"))
    min_slip_speed: Any = field(default=None, metadata=same(Summary, "min_slip_speed"))
    period: Any = field(default=None, metadata=same(Summary, "period"))
    confirmed: Any = field(default=None, metadata=same(Point, "confirmed"))
    settled: Any = field(default=None, metadata=same(Summary, "settled"))
    runaway: Any = field(default=None, metadata=same(Summary, "runaway"))
    stick_fraction: Any = field(default=None, metadata=same(Summary, "stick_fraction"))
    regime: Any = field(default=None, metadata=same(Summary, "regime"))
    theta2: Any = field(default=None, metadata=same(Point, "theta2"))
    equivalent_damping: Any = field(default=None, metadata=same(Damping, "weighted"))
    negative_slope_mean: Any = field(default=None, metadata=same(Damping, "negative_mean"))
    status: Any = field(default=None, metadata=same(Point, "status"))
    coexisting: Sequence[Coexisting] | None = field(default=None, metadata=optional(
        "other motions, from a neighbour's last state"))
    behind: MotionsBehind | None = field(default=None, metadata=optional("motions behind the curve", spread=True))
    coefficient: Any = field(default=None, metadata=optional("friction coefficient over mu_k at slip_speed"))
    slope: Any = field(default=None, metadata=optional("its slope", "s/rad"))
    near_coefficient: Any = field(default=None, metadata=optional("the same at near_slip_speed"))
    near_slope: Any = field(default=None, metadata=optional("slope at near_slip_speed", "s/rad"))
    near_set_valued: Any = field(default=None, metadata=optional("that of the set-valued law at near_slip_speed"))
    peak_slip_speed: Any = field(default=None, metadata=optional(
        "slip speed of the largest coefficient; null without one", "rad/s"))
    peak: Any = field(default=None, metadata=optional("largest coefficient over mu_k"))
    static: Any = field(default=None, metadata=optional("mu_s over mu_k"))
    solver: Any = field(default=None, metadata=optional("name of the solver"))
    seconds: Any = field(default=None, metadata=optional("computing time", "s"))
    rms_difference: Any = field(default=None, metadata=optional(
        "rms difference from the first curve, relative to its largest |slip speed|; null if the solver "
        "stopped"))
    final: Any = field(default=None, metadata=optional(
        "slip speed, plate angle and plate speed at the end", "rad/s, rad, rad/s"))
    t: Any = field(default=None, metadata=optional("time from the first sample on", "periods of excitation"))
    slip_speed: Any = field(default=None, metadata=optional("slip speed", "rad/s"))
    plate_angle: Any = field(default=None, metadata=optional("angle of the clutch plate", "rad"))
    friction_torque: Any = field(default=None, metadata=optional("friction torque", "N m"))
    engine_torque: Any = field(default=None, metadata=optional("torque of the engine", "N m"))
    saturation_torque: Any = field(default=None, metadata=optional("mu_k N R", "N m"))
    state: Any = field(default=None, metadata=optional("-1 negative slip, 0 stick, 1 positive slip"))
    first_half: Any = field(default=None, metadata=optional(
        "part of positive slip in the first half cycle; null without any"))
    section: Any = field(default=None, metadata=optional("plate angle and speed at t = 2 pi n/omega", "rad, rad/s"))
    lyapunov: Any = field(default=None, metadata=optional("largest exponent, without a period", of=(Lyapunov,)))
    orbit: Any = field(default=None, metadata=optional(
        "as an entry of `at` in `continue --json`", of=(OrbitFigures,)))


@dataclass(frozen=True, kw_only=True)
class Figure(Described):
    """Numbers of one figure with its title and caption; numbers that its kind lacks are None."""

    figure: int = field(metadata=reported("number in the paper"))
    kind: str = field(metadata=reported("kind of the figure; other fields depend on it"))
    title: str = field(metadata=reported("in our words"))
    caption: str = field(metadata=reported("in our words"))
    law: str = field(metadata=reported("friction law"))
    quick: bool = field(metadata=reported("whether it has a quarter of the values"))
    parameters: Mapping[str, Any] = field(metadata=reported("scene keys that all of its curves share", "{*}"))
    marks: Sequence[float] = field(metadata=reported("places on the axis that the text names"))
    over: Any = field(default=None, metadata=optional("scene key of the axis"))
    axis: Any = field(default=None, metadata=optional("name of the axis"))
    x: Any = field(default=None, metadata=optional("values on the axis"))
    unit: Any = field(default=None, metadata=optional("value of the key at 1 on the axis"))
    cycles: Any = field(default=None, metadata=optional("cycles solved at every value"))
    discarded: Any = field(default=None, metadata=optional("cycles dropped"))
    threshold: Any = field(default=None, metadata=optional("-C23 of (23)", "N m s/rad"))
    slip_speed: Any = field(default=None, metadata=optional("slip speeds of the curves of Fig. 3", "rad/s"))
    near_slip_speed: Any = field(default=None, metadata=optional("slip speeds near 0, Fig. 3", "rad/s"))
    cycle: Any = field(default=None, metadata=optional("period of excitation", "s"))
    curves: Any = field(default=None, metadata=optional("one for each series", of=(Labelled,)))
    panels: Any = field(default=None, metadata=optional("time histories", of=(Labelled,)))
    steady: Any = field(default=None, metadata=optional("steady state of each law from (13)", of=(Labelled,)))
    steady_cycles: Any = field(default=None, metadata=optional("cycles before a steady state"))
    seconds: float = field(metadata=reported("computing time", "s"))
