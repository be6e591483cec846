"""Periodic motions of a scene along one of its keys: branches, bifurcations and curves.

The scene is a map from engine cycle to engine cycle, with some of its keys as free parameters. First orbits of its
branches are the motion that the scene settles in, or given ones such as attractors of basins.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tcc_sim.analysis.steady.summary import runaway_cause, slip_grows
from tcc_sim.errors import InputError, NumericalFailure, counted
from tcc_sim.model.closed_forms import common_cycles, stick_margin
from tcc_sim.model.parameters import DEFAULTS as SCENE_KEYS
from tcc_sim.model.parameters import SPEED, System, list_of, replace, unknown_key, values_of
from tcc_sim.model.quantity import sequence_of_numbers
from tcc_sim.result import Described, Result, reported, reporting, result_class
from tcc_sim.scene import Scene, system_of
from tcc_sim.solvers.engine import GRADIENT, GROWS, SCALES, VALUE
from tcc_sim.solvers.exact_engine import ARRIVAL, GRAZING, STUCK
from tcc_sim.solvers.stroboscopic import Prepared
from tcc_sim.study.continuation import orbits
from tcc_sim.study.continuation.bifurcations import Bifurcation, ContinuationPoint
from tcc_sim.study.continuation.branch import (
    FAMILY,
    Branch,
    BranchOrigin,
    SettledMotion,
    branch_through,
    first_point,
    orbits_at,
    passes_through,
    point_of,
    switch,
)
from tcc_sim.study.continuation.curves import KINDS, BifurcationCurve, bifurcation_curve, border_curve
from tcc_sim.study.continuation.orbits import Floats, Image, Margins, ParameterRange, Shooting, Values
from tcc_sim.sweeps.progress import point_bar
from tcc_sim.sweeps.results import check_effect
from tcc_sim.sweeps.simulation import settled_from_start
from tcc_sim.trajectory import Cycles

# A step of the map leaves some 1e-13, and its derivatives are good to 2e-7.
SOLVER_TOLERANCE = 1e-12  # relative tolerance of the map
STICKING = 1e-12  # slip speed, rad/s, below which the set-valued law sticks
SETTLING = 4800  # engine cycles after which a motion that does not repeat is aperiodic
SETTLING_ELSEWHERE = 300  # the same at other values of the range
GUESSES = 8  # section points from which a first orbit is tried
ELSEWHERE = 9  # values of the range at which a motion is tried where the scene's own does not settle


class DrivelineMap:
    """`ParameterMap` of one scene; states are slip speed, plate angle and plate speed at phase 0 of the engine.

    Raises InputError: a key that is no number, that only says where a solution starts, or that would make the
    excitation aperiodic.
    """

    dimension, scales, amplitude_scale, divisible = 3, SCALES, 10.0, True

    def __init__(self, system: System, keys: Sequence[str]) -> None:
        system.check_repeats("a map of the section")
        for key in keys:
            _check_key(system, key, keys)
        self.system, self.keys = system, tuple(keys)
        self.piecewise = system.friction.law == "set_valued"
        self.forcing_period = common_cycles(system)
        if self.forcing_period == 0:
            raise InputError(f"pressure.frequency_ratio is {system.pressure.frequency_ratio:g}; periodic motions need "
                             "a ratio of whole numbers up to 1000")
        self._prepared: tuple[Values, Prepared] | None = None
        if self.piecewise:
            # A scene without derivatives is refused here.
            Prepared(system, self.keys, SOLVER_TOLERANCE)

    def system_at(self, values: Values) -> System:
        """The scene's system with the free keys at `values`."""
        return replace(self.system, dict(zip(self.keys, values)))

    def evaluate(self, x: Floats, values: Values, first: float, cycles: float) -> Image:
        """The state `cycles` cycles on, with derivatives by the state and by the free keys."""
        return self.evaluate_each(x[None], values, [first], [cycles])[0]

    def evaluate_each(self, states: Floats, values: Values, firsts: Sequence[float],
                      cycles: Sequence[float]) -> list[Image]:
        """`evaluate` for several starts, with largest |slip speed|, stick fraction and event sequence."""
        prepared, out = self._prepare(values), []
        starts = np.array([self._settled(x) for x in states]) if self.piecewise else states
        ends = [first + count for first, count in zip(firsts, cycles)]
        for image, count in zip(prepared.each(starts, firsts, ends), cycles):
            if not all(math.isfinite(number) for number in image.state.tolist()):
                raise ArithmeticError("the state is not finite")
            seen = orbits.Observation(image.stick_time / (count * prepared.period), image.events,
                                      tuple(image.heights.tolist()))
            out.append(Image(image.state, image.derivatives, seen, image.heights_derivatives))
        return out

    def _prepare(self, values: Values) -> Prepared:
        """The system at these values, ready to be evaluated at many states."""
        if self._prepared is None or self._prepared[0] != values:
            self._prepared = values, Prepared(self.system_at(values), self.keys, SOLVER_TOLERANCE)
        return self._prepared[1]

    def settled(self, values: Values, most: int) -> tuple[Cycles, int]:
        """`settled_from_start` of the scene."""
        # The set-valued law needs the map's tolerance: a border close to the motion decides which branch is followed.
        rtol = SOLVER_TOLERANCE if self.piecewise else None
        return settled_from_start(self.system_at(values), most, rtol=rtol)

    def margins(self, x: Floats, values: Values, first: float, cycles: float) -> Margins:
        """Distances of the motion from grazing, from the edge of stick where slip ends, and from the end of stick."""
        of, system = self._prepare(values), self.system_at(values)
        margins = of.over(self._settled(x), first, first + cycles, margins=True).margins if self.piecewise else None
        if margins is None:
            return {}
        strength = system.friction_ratio * (system.saturation_mean + abs(system.saturation_amplitude))
        sizes = {"grazing": (GRAZING, self.amplitude_scale), "arrival": (ARRIVAL, strength), "stick": (STUCK, strength)}
        return {name: orbits.Margin(float(margins[row, VALUE]) / size, margins[row, GRADIENT:] / size,
                                    bool(margins[row, GROWS]))
                for name, (row, size) in sizes.items() if math.isfinite(margins[row, VALUE])}

    def _settled(self, x: Floats) -> Floats:
        """`x`, where the set-valued law sets a slip speed of rounding to 0."""
        if self.piecewise and abs(x[0]) < STICKING:
            x = x.copy()
            x[0] = 0.0
        return x


def _check_key(system: System, key: str, among: Sequence[str]) -> None:
    """Raise InputError unless periodic motions can be followed in `key`, one `among` those that are free."""
    if key == SPEED:
        raise InputError(f"{key} is engine.frequency over engine.order; motions are followed in engine.frequency, "
                         "whose ends may be in rad/s or hz")
    if list_of(key) not in SCENE_KEYS:
        raise unknown_key(key, SCENE_KEYS)
    value = dict(values_of(system)).get(key, f"a number of {list_of(key)}")
    if not isinstance(value, float):
        raise InputError(f"{key} is {value!r}; motions are followed in a key that is one number")
    if key.startswith("initial."):
        raise InputError(f"{key} is where a solution starts; periodic motions do not depend on it")
    if key == "engine.order" and system.speeds:
        raise InputError(f"{key} changes engine.frequency where engine.speed is given; follow motions in that")
    if key in ("engine.order", "pressure.time_constant", "pressure.delay", "pressure.rate_limit"):
        raise InputError(f"{key} has no effect on periodic motions")
    check_effect(system, key)
    if key in ("pressure.frequency_ratio", "pressure.phase") and system.saturation_amplitude == 0.0 \
            and "pressure.amplitude" not in among:
        raise InputError(f"{key} has no effect where pressure.amplitude is 0")
    coefficients = {"friction.kinetic_coefficient", "friction.static_coefficient"}
    if key == "friction.decay" and system.friction_ratio == 1.0 and not coefficients & set(among):
        raise InputError("friction.decay has no effect where friction.kinetic_coefficient is "
                         "friction.static_coefficient")
    if key == "pressure.frequency_ratio":
        raise InputError("pressure.frequency_ratio cannot be followed: between ratios of whole numbers the excitation "
                         "is not periodic")


@dataclass(frozen=True)
class Seed:
    """A motion near an orbit: parameter; slip speed, plate angle and speed at phase 0; period in engine cycles."""

    value: float
    state: tuple[float, float, float]
    period: int


def start_orbit(map_: DrivelineMap, span: ParameterRange, value: float, period: int | None) -> ContinuationPoint:
    """The orbit near the motion that the scene settles in, by Newton's method.

    Raises NumericalFailure: none was found; the message names a value of the range at which motions settle.
    """
    base = map_.forcing_period
    cycles, summary = map_.settled((value,), SETTLING)
    starts = range(len(cycles.section) - 1 - (len(cycles.section) - 1) % base, len(cycles.section) // 2, -base)
    wanted = [period] if period is not None else [summary] if summary else [base * k for k in (1, 2, 3, 4)]
    for count in [] if slip_grows(cycles) else wanted:
        count = math.lcm(count, base) if period is None else count
        shooting = Shooting.single(map_, count, span)
        # The section points that return closest, nearest first, and their mean.
        kept = [k for k in starts if k >= count]
        away = [float(np.abs((cycles.section[k] - cycles.section[k - count]) / map_.scales).max()) for k in kept]
        guesses = [cycles.section[kept[i] - count] for i in np.argsort(away, kind="stable")[:GUESSES]]
        guesses.append(np.mean(guesses, axis=0))
        known = []  # An orbit of the shortest period, which the search for a longer one deflates.
        if count != base:
            simple = Shooting.single(map_, base, span)
            z = orbits.find_orbit(simple, (value,), [guesses[-1], guesses[0]])
            known = [] if z is None else [simple.nodes(z)[0]]
        z = orbits.find_orbit(shooting, (value,), guesses, known)
        if z is not None:
            return first_point(shooting, z)
    raise NumericalFailure(_no_motion(map_, span, value, cycles, period, wanted))


def _no_motion(map_: DrivelineMap, span: ParameterRange, value: float, cycles: Cycles, period: int | None,
               wanted: Sequence[int]) -> str:
    """Why no orbit was found at a value, and another value at which to begin."""
    away = slip_grows(cycles)
    if away:
        why = f"slip grows without end at {span.name} = {value:.9g}: {runaway_cause(map_.system_at((value,)))}"
    else:
        named = f"of period {period}" if period is not None else f"up to period {wanted[-1]}"
        why = (f"no motion {named} was found near the settled one, from the {GUESSES} of its section points "
               "that come back closest")
    for other in sorted(np.linspace(span.low, span.high, ELSEWHERE).tolist(), key=lambda x: abs(x - value)):
        try:
            settled, summary = map_.settled((other,), SETTLING_ELSEWHERE)
        except orbits.FAILURES:
            continue
        if summary and (period is None or summary == period):
            return f"{why}; begin at --set {span.name}={other:.9g}, where the motion settles in period {summary}"
        away &= slip_grows(settled)
    if away:
        return (f"{why}; it grows at {ELSEWHERE} values of the range too: give another pressure.mean or "
                "engine.mean_torque")
    return (f"{why}; nor does it settle in a period at {ELSEWHERE} values of the range: begin with another "
            "--period, or with --seeds of basins")


def seeded(map_: DrivelineMap, span: ParameterRange, seeds: Sequence[Seed], period: int | None,
           known: Sequence[Branch]) -> Iterator[tuple[ContinuationPoint, BranchOrigin]]:
    """Yield first points of branches, with their origins, at seeds that lie on none of the branches `known` by then.

    Raises InputError: as `refuse_family`. NumericalFailure: No orbit is near any of them.
    """
    met = False
    for number, seed in enumerate(seeds):
        if period not in (None, seed.period):
            continue
        first = point_of(map_, span, SettledMotion(seed.value, np.array(seed.state), 0, seed.period, 0.0))
        if first is None:
            continue
        refuse_family(first, map_.system_at((seed.value,)))
        met = True
        if not any(passes_through(branch, first) for branch in known):
            yield first, BranchOrigin("attractor", seed.value, attractor=number)
    if not met:
        raise NumericalFailure(f"no motion{'' if period is None else f' of period {period}'} was found near any of the "
                               f"{len(seeds)} seeds")


def seeds_in(document: Mapping[str, Any], system: System, over: str, low: float, high: float) -> tuple[Seed, ...]:
    """The periodic attractors of a `basins --json` document within a range of `over`.

    Raises InputError: no such document, another scene (apart from `over` and initial.*), or no attractor in the range.
    """
    try:
        kind = str(document.get("format", "no result of a command"))
        if not kind.startswith("tcc_sim basins "):
            raise InputError(f"--seeds holds {kind}; it must be what basins --json wrote")
        scene, varied = document["scene"], document.get("over")
        if varied not in (None, over):
            raise InputError(f"--seeds varies {varied}; it must be {over}, the key of --over, or none")
        for key, value in values_of(system):
            given = tuple(scene[key]) if isinstance(scene[key], list) else scene[key]
            if key != over and not key.startswith("initial.") and given != value:
                raise InputError(f"--seeds has {key} = {scene[key]!r}; it must be that of the scene, {value!r}")
        values = [scene[over]] if varied is None else document["values"]
        each = [document["attractors"]] if varied is None else document["attractors"]
        out = tuple(Seed(float(value), (float(v), float(angle), float(speed)), int(a["period"]))
                    for value, attractors in zip(values, each) for a in attractors if a["period"]
                    for v, angle, speed in [a["state"]] if low <= value <= high)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"--seeds is no document of basins --json: {error!r}") from None
    if not out:
        raise InputError(f"--seeds has no periodic attractor at {over} from {low:g} to {high:g}")
    return out


def refuse_family(first: ContinuationPoint, system: System) -> None:
    """Raise InputError for a motion of a family in pure slip."""
    events = first.events
    if events in ("+", "-") and np.abs(first.multipliers - 1.0).min() < FAMILY:
        raise InputError("the settled motion is pure slip, with friction that does not depend on slip speed and "
                         f"carries the mean engine torque exactly ({system.engine.mean_torque:g} N m): a family of "
                         "motions with a multiplier of exactly 1, through which no single branch leads")


LONGEST_START = 16  # longest first period that may be asked for, engine cycles
DEEPEST_SWITCH = 8  # most generations of doubled branches that may be asked for


@result_class
class ContinuationPlan:
    """Task of a continuation.

    over : scene key, with its range from `low` to `high`
    period : periods of excitation in a period of the first motion (default: as the settled one)
    at : add the motions of every branch at exactly this value of the key
    switch : follow branches of doubled period too, through so many doublings
    second : follow every fold, doubling, Neimark-Sacker and stick border in a second key
    seeds : motions on further branches; they replace the settled one

    Raises InputError: a wrong range, value, period or depth.
    """

    over: str = reported("scene key that is followed")
    low: float
    high: float
    period: int | None = None
    at: tuple[float, ...] = ()
    switch: int = 0
    second: tuple[str, float, float] | None = None
    seeds: tuple[Seed, ...] = ()

    @reporting("least and largest value of the key", "{over}", name="range")
    def bounds(self) -> tuple[float, float]:
        return self.low, self.high

    @reporting("key of --second", optional=True)
    def second_over(self) -> str | None:
        return None if self.second is None else self.second[0]

    def __post_init__(self) -> None:
        if self.second is not None and self.second[0] == self.over:
            raise InputError(f"--second is {self.over}, the key of --over; it must be another one")
        for option, low, high in (("--over", self.low, self.high), *(
                [] if self.second is None else [("--second", *self.second[1:])])):
            if not low < high:
                raise InputError(f"{option} has a range from {low:g} to {high:g}; the two must differ")
        if self.period is not None and not 1 <= self.period <= LONGEST_START:
            raise InputError(f"--period is {self.period}; it must be 1 to {LONGEST_START} periods of excitation")
        if not 0 <= self.switch <= DEEPEST_SWITCH:
            raise InputError(f"--switch is {self.switch}; it must be 0 to {DEEPEST_SWITCH}")
        for what, value in (*((f"a seed is at {self.over} =", seed.value) for seed in self.seeds),
                            *(("--at is", value) for value in self.at)):
            if not self.low <= value <= self.high:
                raise InputError(f"{what} {value:g}; it must be within the range of --over, {self.low:g} to "
                                 f"{self.high:g}")


@result_class
class OrbitAt(Described):
    """The motion of a branch at a value of `--at`."""

    branch: int = reported("number of the branch")
    period: int = reported("period of the motion", "periods of excitation")
    origin: str | dict[str, Any] = reported("as of its branch")
    orbit: orbits.OrbitFigures = reported("the motion", spread=True)


@result_class(frozen=False, repr=False)
class Motions(Result):
    """The motions found along a key."""

    plan: ContinuationPlan = reported("what was asked for", spread=True)
    system: System
    branches: list[Branch] = reported("branches of periodic motions", default_factory=list)
    at: list[dict[str, Any]] = reported(
        "motions of every branch at every --at value", of=(OrbitAt,), default_factory=list)
    curves: list[BifurcationCurve] = field(default_factory=list)
    complete: bool = reported("false where it was interrupted", default=False)

    def _text(self) -> str:
        kinds = Counter(item.kind for item in self.bifurcations)
        counts = ", ".join(counted(number, kind.replace("_", " ")) for kind, number in kinds.items())
        return (f"Motions over {self.plan.over} from {self.plan.low:g} to {self.plan.high:g}, {self.law}: "
                f"{counted(len(self.branches), 'branch')}, {counts or 'no bifurcation'}")

    def columns(self) -> dict[str, list[Any]]:
        """A row for every point of every branch, in order along it."""
        points = [(number, point) for number, branch in enumerate(self.branches) for point in branch.points]
        return {"branch": [number for number, _ in points], "period": [point.period for _, point in points],
                self.plan.over: [point.value for _, point in points],
                "max_slip_speed": [point.seen.largest for _, point in points],
                "stable": [point.stable for _, point in points]}

    @reporting("friction law")
    def law(self) -> str:
        return self.system.friction.law

    @reporting("of all branches, in order")
    def bifurcations(self) -> list[Bifurcation]:
        return [f for branch in self.branches for f in branch.bifurcations]

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

    Raises InputError: a key that cannot be followed, a range beyond the key's own, or an option without effect.
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

    tick : called with every point
    into : receives results as they are found, also those before Ctrl-C

    Raises InputError: as `check`; also where the settled motion belongs to a family with a multiplier of exactly 1.
    NumericalFailure: No first periodic motion was found.
    """
    map_ = check(system, plan)
    out = into if into is not None else Motions(plan, system)
    span = ParameterRange(plan.low, plan.high, name=plan.over)
    if plan.seeds:
        for first, origin in seeded(map_, span, plan.seeds, plan.period, out.branches):
            branch_through(first, origin, out.branches, tick=tick)
    else:
        start = min(max(_present(system, plan.over), plan.low), plan.high)
        first = start_orbit(map_, span, start, plan.period)
        refuse_family(first, map_.system_at((start,)))
        branch_through(first, keep=out.branches, tick=tick)
    if plan.switch:
        switch(out.branches, plan.switch, tick=tick)
    for value in plan.at:
        for number, branch in enumerate(out.branches):
            out.at += [OrbitAt(number, branch.period, branch.begun,
                               dataclasses.replace(point.figures, value=value)).as_json()
                       for point in orbits_at(branch, value)]
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
