"""Results of sweeps: a point at one value, points along one scene key, or on a grid of two keys."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.measured.orders import JudderFigures, OrdersAtSpeeds
from tcc_sim.analysis.steady.damping import Damping, threshold_of
from tcc_sim.analysis.steady.exponents import Lyapunov
from tcc_sim.analysis.steady.summary import Summary
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace, unknown_key
from tcc_sim.model.quantity import MOST_VALUES
from tcc_sim.result import Result, as_lists, json_of, names_in, reported, reported_of, reporting, result_class
from tcc_sim.sweeps.simulation import CONFIRMED, Plan, Start
from tcc_sim.trajectory import Floats, State

MAY_BE_NAN = ("section_change", *(item.name for item in fields(Summary)
                                  if item.type == "float" and item.default is not MISSING))
SCALED = "friction.coefficients"
"""Key of a table, which is scaled as a whole."""
NOT_SOLVED = "not solved: the sweep was interrupted"
EMPTY: dict[str, float | int | bool | str] = {"float": np.nan, "int": -1, "int | None": -1, "bool": False, "str": ""}
"""Value of an empty table cell by the type of its field."""
COLUMNS: dict[str, float | int | bool | str] = {
    **{item.name: EMPTY[str(item.type)] for item in fields(Summary) if item.type in EMPTY}, "confirmed": False,
    **dict.fromkeys(names_in(Damping), np.nan),
    **{f"lyapunov_{item.name}": EMPTY[str(item.type)] for item in fields(Lyapunov) if item.type in EMPTY},
    **dict.fromkeys(names_in(JudderFigures), np.nan), "status": ""}
"""Columns of a table with a row per value, and the value of their empty cells."""


@result_class(slots=True)
class Point:
    """The result at one value.

    summary : its section is empty and stands in `section`; None if the solver failed
    end : end of the motion, from which a run may continue
    """

    value: float
    summary: Summary | None = reported(
        "figures of the steady state; null where the solver failed", spread=True, of=(Summary,))
    section: Floats | None = reported("plate angle and slip speed at t = 2 pi n/omega, (n, 2)", "rad, rad/s")
    confirmed: bool | None = reported(CONFIRMED)
    status: str = reported("how the solver ended, a sentence")
    theta2: Floats | None = reported("plate angle on the last sections, oldest first, (n,)", "rad", optional=True)
    damping: Damping | None = reported("equivalent damping", spread=True, optional=True)
    lyapunov: Lyapunov | None = reported("largest Lyapunov exponent", optional=True)
    end: Start
    judder: JudderFigures | None = reported(
        "judder of a manoeuvre or with orders", spread=True, optional=True, default=None)
    orders: OrdersAtSpeeds | None = reported("orders at given engine speeds", optional=True, default=None)

    def as_record(self) -> dict[str, Any]:
        """Return the value, the results and the end of the motion as JSON values: a line in the file of a sweep."""
        return {"value": self.value, **json_of(self), "final": list(self.end.state.numbers),
                "final_cycle": self.end.cycle}

    def number(self, name: str) -> float:
        """Return a result in numbers by its name in JSON; NaN for one that is missing or not finite."""
        damping, judder = ({entry.name: attribute for attribute, entry in reported_of(kind).items()}
                           for kind in (Damping, JudderFigures))
        part = (self if name == "confirmed" else self.damping if name in damping else self.judder if name in judder else
                self.lyapunov if name.startswith("lyapunov_") else self.summary)
        value = getattr(part, (damping | judder).get(name, name.removeprefix("lyapunov_")), None)
        return float(value) if value is not None and math.isfinite(value) else math.nan

    @staticmethod
    def from_record(record: Mapping[str, Any], system: System) -> Point:
        """Return the point of a record by `as_record`; raise KeyError, TypeError or ValueError for any other record."""
        summary = None
        if record["max_slip_speed"] is not None:
            numbers = {name: record[name] for name in names_in(Summary)}
            unknown = {name: math.nan for name in MAY_BE_NAN if numbers[name] is None}
            summary = Summary(**{**numbers, "section": [], "covers": tuple(numbers["covers"]), **unknown})
            if not all(isinstance(getattr(summary, name), (int, float)) for name in (
                    "max_slip_speed", "min_slip_speed", "period", "stick_fraction", *MAY_BE_NAN)):
                raise TypeError("not a number")

        def numbers_of(kind: type) -> list[float]:
            return [math.nan if record[name] is None else float(record[name]) for name in names_in(kind)]

        damping = lyapunov = orders = None
        if "equivalent_damping" in record:
            weighted, negative = numbers_of(Damping)
            damping = Damping(weighted, negative, threshold_of(system))
        judder = JudderFigures(*numbers_of(JudderFigures)) if "judder_rms" in record else None
        if "lyapunov" in record:
            values: dict[str, Any] = {k: math.nan if v is None else v for k, v in record["lyapunov"].items()}
            lyapunov = Lyapunov(**values)
        if "orders" in record:
            orders = OrdersAtSpeeds(**{name: np.array(each, dtype=np.float64)
                                       for name, each in record["orders"].items()})
        v, angle, speed = map(float, record["final"])
        return Point(float(record["value"]), summary, np.array(record["section"], dtype=np.float64).reshape(-1, 2),
                     bool(record["confirmed"]), str(record["status"]),
                     np.array(record["theta2"], dtype=np.float64).reshape(-1) if "theta2" in record else None,
                     damping, lyapunov,
                     Start(State(v, angle, speed), int(record["final_cycle"])), judder, orders)


def check_effect(system: System, key: str) -> None:
    """Raise InputError if another key of the scene takes the effect from `key`."""
    for by, without, keys in (
            ("friction.law set_valued", system.friction.law == "set_valued", ("friction.smoothing",)),
            ("engine.fallback mean", not system.engine.harmonic, ("engine.torque_amplitude", "engine.harmonic_")),
            ("pressure.fallback mean", not system.pressure.harmonic,
             ("pressure.amplitude", "pressure.frequency_ratio", "pressure.phase"))):
        if without and key.startswith(keys):
            raise InputError(f"{key} has no effect with {by}")


def varied(system: System, key: str, value: float) -> System:
    """Return the system with one scene key changed; SCALED is a table, and the value is the factor of its coefficients.

    Raises InputError: an unknown key, a value out of its range, or no table.
    """
    if key != SCALED:
        return replace(system, {key: value})
    if not system.friction.coefficients:
        raise InputError(f"{SCALED} is empty; a factor scales the friction table of a scene")
    if not 0.0 < value < math.inf:
        raise InputError(f"the factor of {SCALED} is {value:g}; it must be above 0")
    return replace(system, {SCALED: [value * x for x in system.friction.coefficients]})


@result_class
class Curve:
    """A system at many values of one scene key, see `varied`.

    Raises InputError: no value or too many, an unknown key, or a value out of its range.
    """

    system: System
    key: str = reported("scene key that is swept", name="over")
    values: tuple[float, ...] = reported("its values", "{over}")

    def __post_init__(self) -> None:
        if not 1 <= len(self.values) <= MOST_VALUES:
            raise InputError(f"a sweep has {len(self.values)} values; it must have 1 to {MOST_VALUES}")
        check_effect(self.system, self.key)
        for value in self.values:
            varied(self.system, self.key, value)

    def at(self, index: int) -> System:
        """Return the system at one of the values."""
        return varied(self.system, self.key, self.values[index])


@result_class
class Course:
    """How the sweeps of one call were done."""

    direction: str = reported("cold: each value starts from the initial state; up, down: from the neighbour's last one")
    discard: int | str = reported("cycles dropped, default or auto")
    duration: float | None = reported("time solved; null for whole cycles", "s")
    varying: Sequence[str] = reported("what varies in time")
    complete: bool = reported("whether every value was tried")
    not_settled: int = reported("motions that are still transients")
    seconds: float = reported("computing time of the whole sweep", "s", name="wall_s")


@result_class(repr=False)
class Sweep(Result):
    """Results along one curve, in the order of its values.

    points : result per value; None where the sweep was interrupted before
    seconds : wall time of the whole call
    """

    curve: Curve = reported("what is swept", spread=True)
    plan: Plan
    points: list[Point | None]
    seconds: float

    def _text(self) -> str:
        values, solved = self.curve.values, sum(p is not None and p.summary is not None for p in self.points)
        return f"Sweep over {self.curve.key}: {_span(values)}; {solved} solved"

    @property
    def complete(self) -> bool:
        """Whether every value was tried."""
        return all(p is not None for p in self.points)

    @property
    def values(self) -> NDArray[np.float64]:
        """(n,) values of the key."""
        return np.array(self.curve.values)

    @property
    def records(self) -> list[dict[str, Any] | None]:
        """`Point.as_record` per value; None where the sweep was interrupted before."""
        return [None if p is None else p.as_record() for p in self.points]

    def column(self, name: str) -> NDArray[np.float64]:
        """Return a number per value, (n,); NaN for a missing one, 0 or 1 for a truth value.

        Raises
        ------
        InputError
            No result in numbers has this name.
        """
        numbers = [known for known, none in COLUMNS.items() if not isinstance(none, str)]
        if name not in numbers:
            raise unknown_key(name, numbers, "a result in numbers")
        return np.array([np.nan if p is None else p.number(name) for p in self.points])

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the key's values and all results but the section, (n,) each; missing ones are NaN, -1 or empty."""
        rows: list[dict[str, Any]] = [{"status": NOT_SOLVED} if r is None else r for r in self.records]
        flat = [{**r, **{f"lyapunov_{name}": x for name, x in r.get("lyapunov", {}).items()}} for r in rows]
        names = {name for r in flat for name in r}
        return {self.curve.key: self.values,
                **{name: np.array([none if r.get(name) is None else r[name] for r in flat], dtype=type(none))
                   for name, none in COLUMNS.items() if name in names}, **self._order_columns()}

    def _order_columns(self) -> dict[str, NDArray[np.float64]]:
        known = next((p.orders for p in self.points if p is not None and p.orders is not None), None)
        if known is None:
            return {}
        empty = np.full((len(known.speeds), len(known.order)), np.nan)
        return {f"{name}_order_{order:g}_at_{speed:.6g}": np.array([
            (empty if p is None or p.orders is None else getattr(p.orders, name))[i, k] for p in self.points])
            for name in ("slip_speed", "shaft_torque") for i, speed in enumerate(known.speeds)
            for k, order in enumerate(known.order)}

    @reporting("how it was done", spread=True)
    def course(self) -> Course:
        return self.course_with([self])

    def course_with(self, sweeps: Sequence[Sweep]) -> Course:
        """Return how this sweep and others of the same call were done."""
        plan = self.plan
        return Course(plan.direction, "default" if plan.discard is None else plan.discard,
                      plan.seconds(self.curve.system), self.curve.system.varying, all(s.complete for s in sweeps),
                      sum(s.not_settled for s in sweeps), self.seconds)

    @property
    def not_settled(self) -> int:
        """Number of values whose motion is still a transient."""
        return sum(p is not None and p.summary is not None and p.summary.transient for p in self.points)

    @reporting("the results per value, in lists", spread=True, listed=True, of=(Point,))
    def lists(self) -> dict[str, list[Any]]:
        return {**json_of(as_lists(self.points, Point)),
                "status": [NOT_SOLVED if p is None else p.status for p in self.points]}


@result_class(repr=False)
class Grid(Result):
    """Results on a grid of two keys: one Sweep over the first key for every value of the second."""

    second_key: str = reported("second scene key", name="second_over")
    second_values: tuple[float, ...] = reported("its values", "{second_over}")
    sweeps: list[Sweep]

    def _text(self) -> str:
        curve = self.sweeps[0].curve
        return (f"Grid over {curve.key}: {_span(curve.values)}, and {self.second_key}: {_span(self.second_values)}; "
                f"{sum(p is not None and p.summary is not None for s in self.sweeps for p in s.points)} solved")

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the columns of `Sweep` for all rows below each other, with the second key's values first."""
        return {self.second_key: np.repeat(self.second_values, len(self.sweeps[0].points)), **stacked(self.sweeps)}

    @reporting("first scene key", spread=True)
    def curve(self) -> Curve:
        return self.sweeps[0].curve

    @reporting("how it was done", spread=True)
    def course(self) -> Course:
        return self.sweeps[0].course_with(self.sweeps)

    @reporting("the results in lists of lists, rows: second key", spread=True, listed=True, of=(Point,))
    def lists(self) -> dict[str, list[Any]]:
        return lists_of(self.sweeps)


def lists_of(sweeps: Sequence[Sweep]) -> dict[str, list[Any]]:
    """Return per result a list for each sweep."""
    rows = [s.lists for s in sweeps]
    none = [None] * len(sweeps[0].points)
    return {name: [row.get(name, none) for row in rows] for name in dict.fromkeys(n for row in rows for n in row)}


def stacked(sweeps: Sequence[Sweep]) -> dict[str, NDArray[Any]]:
    """Return the columns of sweeps of equal length below each other."""
    rows, length = [s.columns() for s in sweeps], len(sweeps[0].points)
    return {name: np.concatenate([row[name] if name in row else np.full(length, COLUMNS.get(name, np.nan))
                                  for row in rows])
            for name in dict.fromkeys(name for row in rows for name in row)}


def _span(values: Sequence[float]) -> str:
    return f"{len(values)} value{'s' if len(values) > 1 else ''} from {min(values):g} to {max(values):g}"
