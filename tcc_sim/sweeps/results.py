"""What sweeps give: a point at one value, points along one scene key, or on a grid of two; as JSON, columns, a line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.damping import Damping, damping_as_json
from tcc_sim.analysis.summary import Summary
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace, unknown_key
from tcc_sim.result import Result
from tcc_sim.sweeps.exponents import Lyapunov
from tcc_sim.sweeps.settings import DEFAULTS
from tcc_sim.sweeps.simulation import Plan
from tcc_sim.sweeps.steady_state import Start
from tcc_sim.trajectory import Floats, State

SUMMARY_KEYS = tuple(item.name for item in fields(Summary))
"""Keys of `simulate --json` that a sweep has per value."""
MAY_BE_NAN = ("section_change", *(item.name for item in fields(Summary)
                                  if item.type == "float" and item.default is not MISSING))
NOT_SOLVED = "not solved: the sweep was interrupted"
EXTRAS = ("theta2", "equivalent_damping", "negative_slope_mean", "lyapunov")
"""Keys per value that are there where they were asked for."""
EMPTY: dict[str, float | int | bool | str] = {"float": np.nan, "int": -1, "int | None": -1, "bool": False, "str": ""}
"""What stands in a column where there is nothing, by the type of its field."""
COLUMNS: dict[str, float | int | bool | str] = {
    **{item.name: EMPTY[str(item.type)] for item in fields(Summary) if item.type in EMPTY}, "confirmed": False,
    "equivalent_damping": np.nan, "negative_slope_mean": np.nan,
    **{f"lyapunov_{item.name}": EMPTY[str(item.type)] for item in fields(Lyapunov) if item.type in EMPTY}, "status": ""}
"""Columns of a table with a line per value, and what stands where there is nothing."""


@dataclass(frozen=True, slots=True)
class Point:
    """The result at one value.

    value : of the key
    summary : maxima, period, regime, with its section left to `section`; None where the solver failed
    section : (n, 2) array, plate angle (rad) and slip speed (rad/s)
    confirmed : whether the section has settled and further cycles stay on it
    status : sentence of the solver
    theta2 : (n,) array, plate angle on the section over the last cycles, oldest first; rad
    damping, lyapunov : where asked for
    end : where the motion goes on from
    """

    value: float
    summary: Summary | None
    section: Floats
    confirmed: bool
    status: str
    theta2: Floats
    damping: Damping | None
    lyapunov: Lyapunov | None
    end: Start

    def as_json(self) -> dict[str, Any]:
        """The point as JSON values; a failed one has null in every result."""
        found = self.summary.as_json() if self.summary is not None else {}
        out: dict[str, Any] = {"value": self.value, **{name: found.get(name) for name in SUMMARY_KEYS},
                               "section": self.section.tolist(), "confirmed": self.confirmed, "status": self.status}
        if len(self.theta2):
            out["theta2"] = self.theta2.tolist()
        if self.damping is not None:
            out.update(damping_as_json(self.damping))
        if self.lyapunov is not None:
            out["lyapunov"] = self.lyapunov.as_json()
        return out

    def as_record(self) -> dict[str, Any]:
        """`as_json` with the end of the motion: what the file of a sweep holds."""
        return {**self.as_json(), "final": list(self.end.state.numbers), "final_cycle": self.end.cycle}

    @staticmethod
    def from_record(record: Mapping[str, Any], system: System) -> Point:
        """The point that `as_record` gave.

        Raises
        ------
        KeyError, TypeError, ValueError
            A record that no point gives.
        """
        summary = None
        if record["max_slip_speed"] is not None:
            numbers = {name: record[name] for name in SUMMARY_KEYS}
            unknown = {name: math.nan for name in MAY_BE_NAN if numbers[name] is None}
            summary = Summary(**{**numbers, "section": [], "covers": tuple(numbers["covers"]), **unknown})
            if not all(isinstance(getattr(summary, name), (int, float)) for name in (
                    "max_slip_speed", "min_slip_speed", "period", "stick_fraction", *MAY_BE_NAN)):
                raise TypeError("not a number")
        damping = lyapunov = None
        if "equivalent_damping" in record:
            weighted, negative = (math.nan if x is None else float(x)
                                  for x in (record["equivalent_damping"], record["negative_slope_mean"]))
            damping = Damping(weighted, negative, -system.driveline.damping)
        if "lyapunov" in record:
            values: dict[str, Any] = {k: math.nan if v is None else v for k, v in record["lyapunov"].items()}
            lyapunov = Lyapunov(**values)
        v, angle, speed = map(float, record["final"])
        return Point(float(record["value"]), summary, np.array(record["section"], dtype=np.float64).reshape(-1, 2),
                     bool(record["confirmed"]), str(record["status"]),
                     np.array(record.get("theta2", []), dtype=np.float64).reshape(-1), damping, lyapunov,
                     Start(State(v, angle, speed), int(record["final_cycle"])))


@dataclass(frozen=True)
class Curve:
    """A system at many values of one scene key.

    Raises
    ------
    InputError
        No value or too many, an unknown key, or a value out of its range.
    """

    system: System
    key: str
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        if not 1 <= len(self.values) <= DEFAULTS.most_values:
            raise InputError(f"a sweep has {len(self.values)} values; it must have 1 to {DEFAULTS.most_values}")
        for value in self.values:
            replace(self.system, {self.key: value})

    def at(self, index: int) -> System:
        """The system at one of the values."""
        return replace(self.system, {self.key: self.values[index]})


@dataclass(frozen=True, repr=False)
class Sweep(Result):
    """The results along one curve, in the order of its values.

    points : what was found per value; None where the sweep was interrupted before
    seconds : wall time of the whole call
    """

    curve: Curve
    plan: Plan
    points: list[Point | None]
    seconds: float

    def __repr__(self) -> str:
        values, solved = self.curve.values, sum(p is not None and p.summary is not None for p in self.points)
        return f"<Sweep over {self.curve.key}: {_span(values)}; {solved} solved>"

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
        """Per value what `Point.as_record` gives; None where the sweep was interrupted before."""
        return [None if p is None else p.as_record() for p in self.points]

    def column(self, name: str) -> NDArray[np.float64]:
        """A number per value, (n,), NaN where there is none; a truth is 0 or 1.

        Raises
        ------
        InputError
            A name that no such result has.
        """
        numbers = [known for known, none in COLUMNS.items() if not isinstance(none, str)]
        if name not in numbers:
            raise unknown_key(name, numbers, "a result in numbers")
        return np.array([np.nan if r.get(name) is None else float(r[name]) for r in self._flat()])

    def columns(self) -> dict[str, NDArray[Any]]:
        """(n,) arrays by name, as ``pandas.DataFrame`` and ``polars.DataFrame`` take them, with the key's values first.

        The section is left out. Numbers are NaN and counts -1 where there is none.
        """
        flat = self._flat()
        there = {name for r in flat for name in r}
        return {self.curve.key: self.values,
                **{name: np.array([none if r.get(name) is None else r[name] for r in flat], dtype=type(none))
                   for name, none in COLUMNS.items() if name in there}}

    def _flat(self) -> list[dict[str, Any]]:
        """The records of all values, with the fields of the exponent beside the others."""
        rows: list[dict[str, Any]] = [{"status": NOT_SOLVED} if r is None else r for r in self.records]
        return [{**r, **{f"lyapunov_{name}": x for name, x in r.get("lyapunov", {}).items()}} for r in rows]

    def as_json(self) -> dict[str, Any]:
        """`over`, `values`, how it was done, and per value the keys of `simulate --json` in lists."""
        return {"over": self.curve.key, "values": list(self.curve.values), **self.how([self]), **self.lists()}

    def how(self, sweeps: Sequence[Sweep]) -> dict[str, Any]:
        """How this sweep, and those of the same call, were done."""
        plan = self.plan
        return {"direction": plan.direction, "discard": "default" if plan.discard is None else plan.discard,
                "duration": plan.seconds(self.curve.system), "varying": self.curve.system.varying,
                "complete": all(s.complete for s in sweeps), "not_settled": sum(s.not_settled for s in sweeps),
                "seconds": self.seconds}

    @property
    def not_settled(self) -> int:
        """How many values have a motion that is still a transient."""
        return sum(p is not None and p.summary is not None and p.summary.transient for p in self.points)

    def lists(self, extras: Sequence[str] | None = None) -> dict[str, list[Any]]:
        """Per key of `simulate --json` a list in value order; `extras` are those of EXTRAS to be there whatever."""
        records = self.records
        there = extras_of([self]) if extras is None else extras
        out = {name: [None if r is None else r.get(name) for r in records]
               for name in (*SUMMARY_KEYS, "confirmed", *there)}
        return {**out, "status": [NOT_SOLVED if r is None else r["status"] for r in records]}


@dataclass(frozen=True, repr=False)
class Grid(Result):
    """The results on a grid of two keys: one Sweep over the first for every value of the second."""

    second_key: str
    second_values: tuple[float, ...]
    sweeps: list[Sweep]

    def __repr__(self) -> str:
        curve = self.sweeps[0].curve
        return (f"<Grid over {curve.key}: {_span(curve.values)}, and {self.second_key}: {_span(self.second_values)}; "
                f"{sum(p is not None and p.summary is not None for s in self.sweeps for p in s.points)} solved>")

    def columns(self) -> dict[str, NDArray[Any]]:
        """The columns of `Sweep` for all rows below each other, with the second key's values first."""
        return {self.second_key: np.repeat(self.second_values, len(self.sweeps[0].points)), **stacked(self.sweeps)}

    def as_json(self) -> dict[str, Any]:
        """As `Sweep.as_json`, with `second_over`, `second_values`, and results as lists of lists, rows: second key."""
        curve, extras = self.sweeps[0].curve, extras_of(self.sweeps)
        rows = [s.lists(extras) for s in self.sweeps]
        return {"over": curve.key, "second_over": self.second_key, "values": list(curve.values),
                "second_values": list(self.second_values), **self.sweeps[0].how(self.sweeps),
                **{name: [row[name] for row in rows] for name in rows[0]}}


def stacked(sweeps: Sequence[Sweep]) -> dict[str, NDArray[Any]]:
    """The columns of sweeps of one length below each other."""
    rows, length = [s.columns() for s in sweeps], len(sweeps[0].points)
    return {name: np.concatenate([row[name] if name in row else np.full(length, COLUMNS[name]) for row in rows])
            for name in dict.fromkeys(name for row in rows for name in row)}


def extras_of(sweeps: Sequence[Sweep]) -> list[str]:
    """Those of EXTRAS that some point has."""
    points = [p for s in sweeps for p in s.points if p is not None]
    found = {"theta2": any(len(p.theta2) for p in points), "lyapunov": any(p.lyapunov is not None for p in points)}
    found |= dict.fromkeys(("equivalent_damping", "negative_slope_mean"), any(p.damping is not None for p in points))
    return [name for name in EXTRAS if found[name]]


def _span(values: Sequence[float]) -> str:
    """How many values there are, and between which."""
    return f"{len(values)} value{'s' if len(values) > 1 else ''} from {min(values):g} to {max(values):g}"
