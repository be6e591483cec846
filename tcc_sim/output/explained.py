"""Results of `explain`, as JSON has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tcc_sim.output.estimates import Estimates
from tcc_sim.result import Described, reported


@dataclass(frozen=True)
class Held:
    """Names in use, and names left out, by a scene."""

    held: Sequence[str] = field(metadata=reported("names of those that the scene uses"))
    left_out: Sequence[str] = field(metadata=reported("names of those that it leaves out"))


@dataclass(frozen=True)
class StepFigures:
    """A tick of the real-time solver."""

    tick_s: float = field(metadata=reported("tick", "s"))
    sub_steps: int = field(metadata=reported("number of sub-steps in a tick"))
    own_calls: Mapping[str, float] = field(metadata=reported("calls of functions in a sub-step, with this kernel"))
    general_calls: Mapping[str, float] = field(metadata=reported("calls of functions in a sub-step with every term on"))
    own_s: float | None = field(default=None, metadata=reported(
        "time of a tick with the scene's kernel, with --cost", "s", optional=True))
    general_s: float | None = field(default=None, metadata=reported(
        "time of a tick with every term on", "s", optional=True))
    ratio: float | None = field(default=None, metadata=reported("general_s over own_s", optional=True))
    noise_s: float | None = field(default=None, metadata=reported(
        "noise of these times; smaller differences than twice this are null", "s", optional=True))
    terms_s: Mapping[str, float | None] | None = field(default=None, metadata=reported(
        "time that each term held adds to a tick", "s", optional=True))
    saved_s: Mapping[str, float | None] | None = field(default=None, metadata=reported(
        "time that each term left out would add to a tick", "s", optional=True))


@dataclass(frozen=True)
class FrictionFigures:
    """Sliding coefficient mu(v) = constant + sum of amplitudes exp(-rates |v|)."""

    constant: float = field(metadata=reported("coefficient that fast slip tends to"))
    amplitudes: Sequence[float] = field(metadata=reported("amplitudes of the exponentials"))
    rates: Sequence[float] = field(metadata=reported("rates of the exponentials", "s/rad"))
    fit_error: float | None = field(metadata=reported(
        "largest error of the fit of a table, relative to its largest coefficient; null without a table"))
    fit_error_at: float | None = field(metadata=reported(
        "slip speed of the largest error; null without a table", "rad/s"))
    fit_error_between: float | None = field(metadata=reported(
        "largest difference of the fit from a monotone interpolation of the table, likewise"))
    fit_error_between_at: float | None = field(metadata=reported(
        "slip speed of that difference; null without a table", "rad/s"))
    slip_speeds: tuple[float, float] = field(metadata=reported(
        "first and last slip speed that coefficients and slopes are given for: the range of the table, or as far as "
        "the exponential lasts", "rad/s"))
    coefficients: tuple[float, float] = field(metadata=reported("coefficient at the first and at the last of them"))
    slopes: tuple[float, float] = field(metadata=reported(
        "least and largest slope of the coefficient over slip speed between them", "s/rad"))
    stick_speed: float = field(metadata=reported(
        "slip speed up to which the law counts as stick; 0 for the set-valued law", "rad/s"))
    largest_coefficient: float = field(metadata=reported(
        "largest friction coefficient up to the stick speed"))


@dataclass(frozen=True)
class PureSlipFigures:
    """Pure slip (12) to (18) in the direction of the initial slip."""

    direction: int = field(metadata=reported("sign of the initial slip speed"))
    mean: float | None = field(metadata=reported("a0 of (15)", "rad/s"))
    amplitude: float = field(metadata=reported("|a21| + |a22| of (15)", "rad/s"))
    growth: float = field(metadata=reported("a1", "rad/s^2"))
    margin: float | None = field(metadata=reported("margin of (16)", "rad/s"))
    least: float | None = field(metadata=reported(
        "smallest slip speed with the transient; null where the slip ends", "rad/s"))
    least_is_bound: bool = field(metadata=reported("whether `least` is a lower bound, which slip need not reach"))
    pure_slip: bool | None = field(metadata=reported(
        "whether it lasts for ever; null where the bound does not decide"))
    tick_difference: float | None = field(metadata=reported(
        "largest difference of the real-time solver from (14) in 500 ticks of 1 ms; null where that does not apply",
        "rad/s"))


@dataclass(frozen=True)
class PureStickFigures:
    """Pure stick (8) to (11)."""

    margin: float = field(metadata=reported("margin of (10)", "N m"))
    sticks: bool = field(metadata=reported("whether pure stick is possible"))
    mean: float = field(metadata=reported("mean plate angle (8)", "rad"))
    amplitude: float = field(metadata=reported("amplitude of the plate angle (8)", "rad"))


@dataclass(frozen=True)
class ClosedForms:
    """Closed forms of the paper."""

    slip: PureSlipFigures | None = field(metadata=reported(
        "pure slip (12) to (18); null where the scene has no such closed form"))
    stick: PureStickFigures | None = field(metadata=reported(
        "pure stick (8) to (11); null where the scene has no such closed form"))
    slip_why: str = field(metadata=reported("reason why there is no pure slip in closed form; empty where there is"))
    stick_why: str = field(metadata=reported("likewise for pure stick"))


@dataclass(frozen=True)
class SceneExplanation(Described):
    """Expected behaviour of a scene, and its terms, topics and packages in use and left out."""

    name: str = field(metadata=reported("name of the scene"))
    description: str = field(metadata=reported("description of the scene"))
    solver: str = field(metadata=reported("solver that auto takes offline"))
    estimates: Estimates = field(metadata=reported("estimates from the parameters alone"))
    terms: Held = field(metadata=reported("terms of the equations"))
    kernel: Mapping[str, str] = field(metadata=reported("type of every term as the compiler has it"))
    topics: Held = field(metadata=reported("topics of the driveline node"))
    modules: Held = field(metadata=reported("optional packages"))
    step: StepFigures | None = field(metadata=reported(
        "tick of the real-time solver; null for the set-valued law, which it does not take"))
    closed_forms: dict[str, Any] | None = field(metadata=reported(
        "closed forms of the paper; null where a torque comes from a topic", of=(ClosedForms,)))
    friction: dict[str, Any] = field(metadata=reported(
        "sliding coefficient mu(v) = constant + sum of amplitudes exp(-rates |v|)", of=(FrictionFigures,)))
