"""Periodic motions of a scene along one of its keys: branches, bifurcations and curves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from tcc_sim.errors import InputError, counted
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.model.pure_stick import stick_margin
from tcc_sim.model.quantity import sequence_of_numbers
from tcc_sim.result import Described, Result, reported, reporting
from tcc_sim.scene import Scene, system_of
from tcc_sim.study.continuation.branch import Branch, branch_through, first_point, orbits_at
from tcc_sim.study.continuation.curves import KINDS, BifurcationCurve, bifurcation_curve, border_curve
from tcc_sim.study.continuation.diagram import switch
from tcc_sim.study.continuation.driveline import DrivelineMap, Seed, refuse_family, seeded, start_orbit
from tcc_sim.study.continuation.newton import OrbitFigures
from tcc_sim.study.continuation.shooting import ParameterRange
from tcc_sim.study.continuation.special_points import Bifurcation, ContinuationPoint
from tcc_sim.sweeps.progress import point_bar

LONGEST_START = 16  # longest first period that may be asked for, engine cycles
DEEPEST_SWITCH = 8  # most generations of doubled branches that may be asked for


@dataclass(frozen=True)
class ContinuationPlan:
    """Task of a continuation.

    over : scene key, with its range from `low` to `high`
    period : periods of excitation in a period of the first motion (default: as the settled one)
    at : add the motions of every branch at exactly this value of the key
    switch : follow branches of doubled period too, through so many doublings
    second : follow every fold, doubling, Neimark-Sacker and stick border in a second key
    seeds : motions on further branches; they replace the settled one

    Raises
    ------
    InputError
        A wrong range, value, period or depth.
    """

    over: str = field(metadata=reported("scene key that is followed"))
    low: float
    high: float
    period: int | None = None
    at: tuple[float, ...] = ()
    switch: int = 0
    second: tuple[str, float, float] | None = None
    seeds: tuple[Seed, ...] = ()

    @property
    @reporting("least and largest value of the key", "{over}", name="range")
    def bounds(self) -> tuple[float, float]:
        """Least and largest value of the key."""
        return self.low, self.high

    @property
    @reporting("key of --second", optional=True)
    def second_over(self) -> str | None:
        """The second key."""
        return None if self.second is None else self.second[0]

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise InputError(f"--over has a range from {self.low:g} to {self.high:g}; the two must differ")
        if self.period is not None and not 1 <= self.period <= LONGEST_START:
            raise InputError(f"--period is {self.period}; it must be 1 to {LONGEST_START} periods of "
                             "excitation")
        if not 0 <= self.switch <= DEEPEST_SWITCH:
            raise InputError(f"--switch is {self.switch}; it must be 0 to {DEEPEST_SWITCH}")
        for seed in self.seeds:
            if not self.low <= seed.value <= self.high:
                raise InputError(f"a seed is at {self.over} = {seed.value:g}; it must be within the range of --over, "
                                 f"{self.low:g} to {self.high:g}")
        for value in self.at:
            if not self.low <= value <= self.high:
                raise InputError(f"--at is {value:g}; it must be within the range of --over, {self.low:g} to "
                                 f"{self.high:g}")
        if self.second is not None:
            key, low, high = self.second
            if key == self.over:
                raise InputError(f"--second is {key}, the key of --over; it must be another one")
            if not low < high:
                raise InputError(f"--second has a range from {low:g} to {high:g}; the two must differ")


@dataclass(frozen=True)
class OrbitAt(Described):
    """The motion of a branch at a value of `--at`."""

    branch: int = field(metadata=reported("number of the branch"))
    period: int = field(metadata=reported("period of the motion", "periods of excitation"))
    origin: str | dict[str, Any] = field(metadata=reported("as of its branch"))
    orbit: OrbitFigures = field(metadata=reported("the motion", spread=True))


@dataclass(repr=False)
class Motions(Result):
    """The motions found along a key."""

    plan: ContinuationPlan = field(metadata=reported("what was asked for", spread=True))
    system: System
    branches: list[Branch] = field(default_factory=list, metadata=reported("branches of periodic motions"))
    at: list[dict[str, Any]] = field(default_factory=list, metadata=reported(
        "motions of every branch at every --at value", of=(OrbitAt,)))
    curves: list[BifurcationCurve] = field(default_factory=list)
    complete: bool = field(default=False, metadata=reported("false where it was interrupted"))

    def _text(self) -> str:
        kinds = Counter(item.kind for item in self.bifurcations)
        counts = ", ".join(counted(number, kind.replace("_", " ")) for kind, number in kinds.items())
        return (f"Motions over {self.plan.over} from {self.plan.low:g} to {self.plan.high:g}, {self.law}: "
                f"{counted(len(self.branches), 'branch')}, {counts or 'no bifurcation'}")

    def columns(self) -> dict[str, list[Any]]:
        """A row for every point of every branch, in order along it."""
        points = [(number, branch, p.orbit) for number, branch in enumerate(self.branches) for p in branch.points]
        return {"branch": [number for number, *_ in points], "period": [branch.period for _, branch, _ in points],
                self.plan.over: [orbit.values[0] for *_, orbit in points],
                "max_slip_speed": [orbit.seen.largest for *_, orbit in points],
                "stable": [orbit.stable for *_, orbit in points]}

    @property
    @reporting("friction law")
    def law(self) -> str:
        """Return the friction law."""
        return self.system.friction.law

    @property
    @reporting("of all branches, in order")
    def bifurcations(self) -> list[Bifurcation]:
        """Bifurcations of all branches, in order."""
        return [f for branch in self.branches for f in branch.bifurcations]

    @property
    @reporting("bifurcations followed in two keys", optional=True, name="curves")
    def second_curves(self) -> list[BifurcationCurve] | None:
        """The curves; None where there is no second key."""
        return None if self.plan.second is None else self.curves


def continuation(scene: Scene | System | str, over: str, start: float, stop: float, *, period: int | None = None,
                 at: Sequence[float] | float = (), switch: int = 0, second: tuple[str, float, float] | None = None,
                 seeds: Sequence[Seed] = (), progress: bool = False) -> Motions:
    """The branches of periodic motions along one scene key, with their bifurcations.

    Parameters
    ----------
    scene : a scene, its name or file, or a system
    over : scene key that is followed, from the smaller of `start` and `stop` to the larger
    period, at, switch, second, seeds : as in `ContinuationPlan`
    progress : show points on a terminal or in a notebook, elsewhere a line a minute

    Raises
    ------
    InputError, NumericalFailure
        As `continue_motions`.

    Examples
    --------
    >>> from tcc_sim import load_scene
    >>> scene = load_scene("stick").with_values({"friction.law": "set_valued"})
    >>> result = continuation(scene, "engine.mean_torque", 295.0, 305.0, at=(301.5,))
    >>> [(branch.period, branch.origin.kind) for branch in result.branches], result.at[0]["stable"]
    ([(1, 'start')], True)
    """
    plan = ContinuationPlan(over, min(start, stop), max(start, stop), period, sequence_of_numbers(over, at), switch,
                            second, tuple(seeds))
    with point_bar(progress) as tick:
        return continue_motions(system_of(scene), plan, tick)


def check(system: System, plan: ContinuationPlan) -> DrivelineMap:
    """Check a plan, and return the map of the scene with the plan's key free.

    Raises
    ------
    InputError
        A key that cannot be followed, a range beyond the key's own, or an option without effect.
    """
    map_ = DrivelineMap(system, (plan.over,))
    for value in (plan.low, plan.high):
        replace(system, {plan.over: value})
    if plan.second is not None:
        key, low, high = plan.second
        DrivelineMap(system, (plan.over, key))
        for first in (plan.low, plan.high):
            for value in (low, high):
                replace(system, {plan.over: first, key: value})
        present = _present(system, key)
        if not low <= present <= high:
            raise InputError(f"--second runs from {low:g} to {high:g}; it must include the scene's {key}, {present:g}")
    if plan.period is not None and plan.period % map_.forcing_period:
        raise InputError(f"--period is {plan.period}; the excitation repeats after {map_.forcing_period} engine "
                         "cycles, and the period must be a multiple of that")
    return map_


def continue_motions(system: System, plan: ContinuationPlan, tick: Callable[[ContinuationPoint], None] | None = None,
                     into: Motions | None = None) -> Motions:
    """Follow the branch through the scene's settled motion, or the branches through seeds, as planned.

    Parameters
    ----------
    tick : called with every point
    into : receives results as they are found, also those before Ctrl-C

    Raises
    ------
    InputError
        As `check`; also where the settled motion belongs to a family with a multiplier of exactly 1.
    NumericalFailure
        No first periodic motion was found.
    """
    map_ = check(system, plan)
    out = into if into is not None else Motions(plan, system)
    span = ParameterRange(plan.low, plan.high, name=plan.over)
    if plan.seeds:
        for first, origin in seeded(map_, span, plan.seeds, plan.period, out.branches):
            branch_through(first, origin, len(out.branches), tick=tick, keep=out.branches)
    else:
        start = min(max(_present(system, plan.over), plan.low), plan.high)
        shooting, z = start_orbit(map_, span, start, plan.period)
        first = first_point(shooting, z)
        refuse_family(first, map_.system_at((start,)))
        branch_through(first, tick=tick, keep=out.branches)
    if plan.switch:
        switch(out.branches, plan.switch, tick=tick)
    for value in plan.at:
        for number, branch in enumerate(out.branches):
            out.at += [OrbitAt(number, branch.period, branch.begun, orbit.figures).as_json()
                       for orbit in orbits_at(branch, value)]
    if plan.second is not None:
        _curves(system, plan, span, out)
    out.complete = True
    return out


def _present(system: System, key: str) -> float:
    value = dict(values_of(system))[key]
    assert isinstance(value, float)
    return value


def _curves(system: System, plan: ContinuationPlan, span: ParameterRange, out: Motions) -> None:
    """Two-parameter curves of every bifurcation that has one."""
    assert plan.second is not None
    key, low, high = plan.second
    ranges, present = (span, ParameterRange(low, high, name=key)), _present(system, key)
    map_ = DrivelineMap(system, (plan.over, key))
    for item in out.bifurcations:
        if item.kind not in KINDS:
            continue
        if item.kind == "stick_border":
            def margin(first: float, second: float) -> float:
                at = map_.system_at((first, second))
                return stick_margin(at).torque / (at.friction_ratio * at.saturation_mean)

            out.curves.append(border_curve(margin, ranges, item.value, present))
        else:
            out.curves.append(bifurcation_curve(item, map_, ranges, present))
