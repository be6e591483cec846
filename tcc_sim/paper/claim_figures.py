"""Judged claims as JSON has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tcc_sim.result import Described, reported


@dataclass(frozen=True)
class EndFigures:
    """An end of a stable motion along a curve."""

    value: float = field(metadata=reported("place on the axis"))
    kind: str | None = field(metadata=reported("bifurcation; null where the motion was followed to there only"))
    residual: float | None = field(metadata=reported("residual of the bifurcation"))
    jumps: bool = field(metadata=reported("whether a motion that comes here goes elsewhere"))


@dataclass(frozen=True)
class MotionFigures(Described):
    """A stable motion along a curve, from wherever it was started."""

    curve: str = field(metadata=reported("curve of the figure; empty where there is one"))
    over: str = field(metadata=reported("name of the axis"))
    period: int = field(metadata=reported("period of the motion", "engine cycles"))
    low: EndFigures = field(metadata=reported("lower end"))
    high: EndFigures = field(metadata=reported("upper end"))
    from_start: Sequence[float] = field(metadata=reported("places at which the initial state (13) leads to it"))
    words: str = field(metadata=reported("the motion in a sentence"))


@dataclass(frozen=True)
class ClaimFigures:
    """A judged claim."""

    figure: str = field(metadata=reported("figure or equation of the paper"))
    where: str = field(metadata=reported("sections of the paper"))
    claim: str = field(metadata=reported("what the paper says, in our words"))
    criterion: str = field(metadata=reported("how it is judged, with every threshold"))
    values: Mapping[str, Any] = field(metadata=reported("numbers that the verdict rests on"))
    verdict: str = field(metadata=reported("confirmed, not confirmed or depends"))
    why: str = field(metadata=reported("what explains the verdict"))
    motions: Sequence[MotionFigures] = field(metadata=reported(
        "where motions coexist: the stable ones, from wherever they were started"))
    verdicts: Mapping[str, str] = field(metadata=reported("verdict at each tolerance, at the first mean pressure"))
    pressures: Mapping[str, str] = field(metadata=reported("verdict at each mean pressure, by its value in kPa"))
    fitted: bool = field(metadata=reported("whether its number chose the mean pressures"))
    thresholds: Mapping[str, Sequence[str]] = field(metadata=reported(
        "with --thresholds: by threshold the verdicts at half and at twice of it"))


@dataclass(frozen=True)
class ClaimsReport(Described):
    """All claims that were judged."""

    claims: Sequence[Mapping[str, Any]] = field(metadata=reported("every claim", of=(ClaimFigures,)))
    complete: bool = field(metadata=reported("whether every claim was judged"))
